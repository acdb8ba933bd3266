"""Roberts's linkage: the apex of an isosceles coupler goes nearly straight between the ground points.

Try: coupler triangles of other heights.
"""

import numpy as np

import jaxnc as nc

m = nc.library.roberts()

motion = nc.sweep(m.compile(), {"phi": np.linspace(-0.39, 0.39, 121)})
trace = ["P"]
