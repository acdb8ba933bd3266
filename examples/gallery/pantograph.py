"""Pantograph: Q draws what P traces, enlarged.

Try: another figure for P, or another ratio of the arms.
"""

import numpy as np

import jaxnc as nc

t = np.linspace(0, 2 * np.pi, 181)
m = nc.library.pantograph()

motion = nc.sweep(m.compile(), {"P.x": 0.3 + 0.06 * np.cos(t) ** 3, "P.y": 0.2 + 0.06 * np.sin(t) ** 3})
trace = ["P", "Q"]
