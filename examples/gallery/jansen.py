"""Jansen's leg: eleven lengths bred by evolution; the foot stays flat on the ground for half of the turn.

Try: flatten the step further: `nc.synthesis.PathGeneration` with the ground as target.
"""

import numpy as np

import jaxnc as nc

m = nc.library.jansen_leg()

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 241)})
trace = ["F"]
