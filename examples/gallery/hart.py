"""Hart's inversor (1874): an exact straight line with two bars less than Peaucellier.

Try: compare its conditioning over the range with that of Peaucellier's cell.
"""

import numpy as np

import jaxnc as nc

m = nc.library.hart()

motion = nc.sweep(m.compile(), {"phi": np.linspace(-2.1, 2.1, 161)})
trace = ["Q"]
