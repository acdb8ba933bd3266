"""Spherical four-bar: four hinges whose axes meet at one point; C stays on a sphere.

Try: shaft angles in place of lengths: all laws of the planar four-bar have their twins.
"""

import numpy as np

import jaxnc as nc

m = nc.library.spherical_four_bar()

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 121)})
trace = ["C"]
