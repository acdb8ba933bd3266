"""Ackermann steering: the two wheels of an axle turn by different angles, so that their axes meet on the rear axle.

Try: change the track arms' slant and compare cot(outer) - cot(inner) with track over wheelbase.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("Ackermann steering")
m.ground("K1", (-0.6, 0))
m.ground("K2", (0.6, 0))
m.point("R1", (-0.54, -0.18))
m.point("R2", (0.54, -0.18))
for k, side in (("1", -1), ("2", 1)):
    m.point("F" + k, (0.6 * side, 0.25))  # front of the wheel
    m.body("knuckle " + k, ["K" + k, "R" + k, "F" + k])
m.body("tie rod", ["R1", "R2"])
m.angle("left", at="K1", to="F1")
m.angle("right", at="K2", to="F2")

motion = nc.sweep(m.compile(), {"left": np.linspace(np.pi / 2 - 0.6, np.pi / 2 + 0.6, 81)})
trace = ["R1", "R2", "F1", "F2"]
