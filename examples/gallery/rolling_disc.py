"""Rolling disc: without slip, a point of its rim draws a cycloid.

Try: a point inside the rim with `m.marker`: a curtate cycloid.
"""

import numpy as np

import jaxnc as nc

m = nc.library.rolling_disc(length=3.0)

motion = nc.sweep(m.compile(), {"phi": np.linspace(0.5, -18.0, 241)})
trace = ["P2"]
