"""Quick return: a crank swings a slotted rocker, the ram cuts slowly and comes back fast.

Try: ratio of the times of both strokes by `motion.velocity`, and its gradient with respect to the crank.
"""

import numpy as np

import jaxnc as nc

m = nc.library.quick_return()

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 181)}, rates={"phi": 1.0})
trace = ["P2", "P3"]
