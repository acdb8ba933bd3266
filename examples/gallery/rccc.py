"""RCCC: a crank and three cylindrical joints turn like a spherical four-bar, and slide besides.

Try: compare psi with that of `nc.library.spherical_four_bar` of the same angles.
"""

import numpy as np

import jaxnc as nc

m = nc.library.rccc()

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 121)})
trace = ["C3"]
