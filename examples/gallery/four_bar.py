"""Four-bar linkage: a crank, a rocker and the curve of a point on the coupler between them.

Try: move D to the left until the crank no longer turns; the error says how far it goes.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("four-bar")
m.ground("A", (0, 0))
m.ground("D", (4, 0))
m.point("B", (0, 1))
m.point("C", (3.3, 2.9))
m.point("P", (1.8, 2.6))
m.body("crank", ["A", "B"])
m.body("coupler", ["B", "C", "P"])
m.body("rocker", ["C", "D"])
m.angle("phi", at="A", to="B")

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 181)}, rates={"phi": 10.0})
trace = ["B", "C", "P"]
