"""Bennett's linkage (1903): four hinges on skew axes that move, against the count.

Try: change one length by a tenth of a per cent: it no longer assembles away from the drawing.
"""

import numpy as np

import jaxnc as nc

m = nc.library.bennett()

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 121)})
trace = ["C"]
