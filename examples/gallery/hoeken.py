"""Hoeken's linkage: half a turn of the crank moves P straight at nearly constant speed.

Try: `motion.velocity('P')` over the straight part; a small search evens it further.
"""

import numpy as np

import jaxnc as nc

m = nc.library.hoeken()

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 181)}, rates={"phi": 1.0})
trace = ["P"]
