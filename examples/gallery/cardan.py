"""Cardan joint: of two shafts at an angle the second turns unevenly, twice a turn.

Try: shaft angles up to 60 degrees, against tan(psi) = tan(phi) / cos(beta).
"""

import numpy as np

import jaxnc as nc

m = nc.library.cardan_joint(shaft_angle=0.7)

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 121)}, rates={"phi": 1.0})
trace = []
