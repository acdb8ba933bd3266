"""Cardan circles: a wheel rolls inside a ring of twice its size, and every point of its rim goes straight.

Try: a gear ratio of 3 instead of 2 (a deltoid), or P inside the rim (an ellipse).
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("Cardan circles")
m.ground("O", (0, 0))
m.point("C", (0.5, 0))  # centre of the wheel, of radius 0.5
m.point("P", (1.0, 0))
m.body("arm", ["O", "C"])
m.body("wheel", ["C", "P"])
m.angle("arm_angle", at="O", to="C")
m.angle("wheel_angle", at="C", to="P")
ratio = 2.0  # ring to wheel
m.relation({"wheel_angle": 1.0, "arm_angle": ratio - 1.0})

motion = nc.sweep(m.compile(), {"arm_angle": np.linspace(0.2, 0.2 + 2 * np.pi, 181)})
trace = ["P", "C"]
