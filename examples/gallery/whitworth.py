"""Whitworth quick return: the slotted arm turns all the way round, unevenly.

Try: a longer crank evens it out.
"""

import numpy as np

import jaxnc as nc

m = nc.library.whitworth()

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 181)}, rates={"phi": 1.0})
trace = ["A", "R"]
