"""Double wishbone suspension: two arms, a tie rod and a rack.

Try: move the inner pivots of the upper arm and look at the camber in roll.
"""

import numpy as np

import jaxnc as nc

m = nc.library.double_wishbone()

motion = nc.sweep(m.compile(), {"wheel_centre.z": np.linspace(230, 390, 81)}, hold=["tie_inner.y", "rim.x"])
trace = ["wheel_centre", "contact"]
