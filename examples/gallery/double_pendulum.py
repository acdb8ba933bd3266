"""Double pendulum: two rods, no input, and motion that cannot be foretold for long.

Try: start it a millionth of a radian higher; or `jax.grad` of where it is after one second, and after ten.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("double pendulum")
m.ground("O", (0, 0))
m.point("A", (0.8, 0.6))
m.point("B", (0.8, 1.6))
m.body("upper", ["O", "A"], mass=1.0)
m.body("lower", ["A", "B"], mass=1.0)
m.gravity = (0, -9.81)

motion = nc.simulate(m.compile(), np.linspace(0, 6, 481))
trace = ["A", "B"]
