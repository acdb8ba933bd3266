"""Klann's leg: a spider's step from one crank and six bars.

Try: two legs half a turn apart, as in the lambda walker.
"""

import numpy as np

import jaxnc as nc

m = nc.library.klann_leg()

motion = nc.sweep(m.compile(), {"phi": np.linspace(np.pi, 3 * np.pi, 241)})
trace = ["P"]
