"""Delta robot: three arms with parallelograms carry a platform that never turns.

Try: drive T.x, T.y, T.z instead: inverse kinematics is the same call.
"""

import numpy as np

import jaxnc as nc

t = np.linspace(0, 2 * np.pi, 121)
m = nc.library.delta_robot()

motion = nc.sweep(m.compile(), {f"phi{k}": 0.3 + 0.35 * np.sin(t + 2 * np.pi * k / 3) for k in range(1, 4)})
trace = ["T"]
