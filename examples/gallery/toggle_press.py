"""Toggle press: as its two bars come into line the force on the ram grows without bound.

Try: `nc.inverse_dynamics` with a force on R, and see the crank's torque fall as the ram goes down.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("toggle press")
m.ground("O", (-0.5, 0.55))
m.ground("T", (0, 1.0))
m.point("A", (-0.5, 0.65))
m.point("K", (-0.08, 0.61))  # knee
m.point("R", (0, 0.2), fixed="x")  # ram
m.body("crank", ["O", "A"])
m.body("rod", ["A", "K"])
m.body("upper", ["T", "K"])
m.body("lower", ["K", "R"])
m.angle("phi", at="O", to="A")

motion = nc.sweep(m.compile(), {"phi": np.linspace(np.pi / 2, 2.5 * np.pi, 121)})
trace = ["K", "R"]
