"""Bricard's linkage (1897): six hinges at right angles, a ring that turns inside out.

Try: `nc.mobility`: what is redundant, and by how much.
"""

import numpy as np

import jaxnc as nc

m = nc.library.bricard()

motion = nc.sweep(m.compile(), {"phi": np.linspace(-2.0, 2.0, 121)})
trace = ["P3"]
