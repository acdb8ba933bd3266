"""Chebyshev's straight-line linkage: crossed arms of 5, coupler of 2, ground of 4.

Try: the deviation from its tangent: a Chebyshev polynomial, hence the name.
"""

import numpy as np

import jaxnc as nc

m = nc.library.chebyshev()

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 181)})
trace = ["P"]
