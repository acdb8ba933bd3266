"""Watt's six-bar: a second loop on the rocker of a four-bar.

Try: drive it at another joint: every coordinate can be the input.
"""

import numpy as np

import jaxnc as nc

m = nc.library.watt_six_bar()

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 181)})
trace = ["F"]
