"""Peaucellier-Lipkin cell (1864): seven bars and the first exact straight line from rotation.

Try: a crank that is shorter than the ground link bends the line into an arc of a large circle.
"""

import numpy as np

import jaxnc as nc

m = nc.library.peaucellier_lipkin()

motion = nc.sweep(m.compile(), {"phi": np.linspace(-1.3, 1.3, 161)})
trace = ["P"]
