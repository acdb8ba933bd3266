"""Cardan circles: a wheel rolls inside a ring of twice its size, and every point of its rim goes straight.

Try: P inside the rim (an ellipse), or a ring three times the wheel's size: 1.5, C at (1, 0), P at (1.5, 0).
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("Cardan circles")
m.ground("O", (0, 0))
m.ground("R", (1.0, 0))  # on the ring
m.point("C", (0.5, 0))  # centre of the wheel
m.point("P", (1.0, 0))
m.body("arm", ["O", "C"])
m.body("wheel", ["C", "P"])
m.angle("arm_angle", at="O", to="C")
m.angle("ring", at="O", to="R", start="C")  # both from the line of centres
m.angle("wheel_angle", at="C", to="P", start="O")
m.gear("mesh", "ring", "wheel_angle", radii=(1.0, 0.5), internal=True)

motion = nc.sweep(m.compile(), {"arm_angle": np.linspace(0.2, 0.2 + 2 * np.pi, 181)})
trace = ["P", "C"]
