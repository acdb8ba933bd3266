"""Stephenson's six-bar: the second loop hangs on the coupler curve, so it can dwell.

Try: put the last pivot at the centre of curvature of the curve (`nc.path_curvature`): F stands still for a while.
"""

import numpy as np

import jaxnc as nc

m = nc.library.stephenson_six_bar()

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 181)})
trace = ["F"]
