"""Scotch yoke: a pin in a cross slot, exact harmonic motion.

Try: turn the slot by a few degrees and look at the second harmonic of the yoke.
"""

import numpy as np

import jaxnc as nc

m = nc.library.scotch_yoke()

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 121)}, rates={"phi": 10.0})
trace = ["P", "Y"]
