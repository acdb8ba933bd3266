"""Five-link suspension: the wheel's steering axis is nowhere to be seen, and moves.

Try: `nc.screw_axis` or the steering axis of `nc.suspension` over the travel.
"""

import numpy as np

import jaxnc as nc

m = nc.library.five_link()

motion = nc.sweep(m.compile(), {"wheel_centre.z": np.linspace(230, 390, 81)}, hold=["tie_inner.y", "rim.x"])
trace = ["wheel_centre", "contact"]
