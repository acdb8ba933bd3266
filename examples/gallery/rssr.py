"""RSSR: a crank and a rocker on skew axes, joined by a bar with two ball joints.

Try: turn the axes to be parallel, and it is a planar four-bar.
"""

import numpy as np

import jaxnc as nc

m = nc.library.rssr()

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 121)})
trace = ["1", "2"]
