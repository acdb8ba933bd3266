"""MacPherson strut: a front wheel over its travel, with camber, toe and caster as results.

Try: `nc.suspension(motion)`, `nc.sensitivity(motion, nc.suspension)`, and `jaxnc demo macpherson`.
"""

import numpy as np

import jaxnc as nc

m = nc.library.macpherson()

motion = nc.sweep(m.compile(), {"6.z": np.linspace(230, 390, 81)}, hold=["10.y", "7.x"])
trace = ["6", "contact"]
