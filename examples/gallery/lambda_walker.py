"""Lambda walker: two of Chebyshev's linkages half a turn apart, the feet of his walking machine.

Try: four of them with bodies between; or `PathGeneration` to make the step flatter.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("lambda walker")
m.ground("O", (0, 0))
m.ground("D", (2, 0))
m.point("A1", (-1, 0))
m.point("C1", (1.0, 2.2913))
m.point("P1", (3.0, 4.5826))
m.point("A2", (1, 0))
m.point("C2", (2.5, 2.4495))
m.point("P2", (4.0, 4.899))
m.body("crank", ["O", "A1", "A2"])
for k in "12":
    m.body("leg " + k, ["A" + k, "C" + k, "P" + k], lengths={("A" + k, "C" + k): 2.5, ("A" + k, "P" + k): 5.0})
    m.body("rocker " + k, ["C" + k, "D"], lengths={("C" + k, "D"): 2.5})
m.angle("phi", at="O", to="A1")

motion = nc.sweep(m.compile(), {"phi": np.linspace(np.pi, 3 * np.pi, 161)})
trace = ["P1", "P2"]
