"""Scott Russell linkage: a crank on the middle of a rod turns a slide along x into an exact straight line along y.

Try: move the pin C off the middle of the rod A-P: P draws an ellipse.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("Scott Russell linkage")
m.ground("O", (0, 0))
m.point("C", (0.3, 0.4))
m.point("A", (0.6, 0), fixed="y")
m.point("P", (0, 0.8))
m.body("crank", ["O", "C"])
m.body("rod", ["A", "C", "P"])
m.angle("phi", at="O", to="C")

motion = nc.sweep(m.compile(), {"phi": np.linspace(-1.3, 1.3, 121)})
trace = ["P", "C"]
