"""Geared five-bar: two cranks in mesh draw curves that no four-bar can.

Try: other ratios of the gears; the curve closes after as many turns as the ratio asks for.
"""

import numpy as np

import jaxnc as nc

m = nc.library.geared_five_bar()

motion = nc.sweep(m.compile(), {"phi": np.linspace(1.0, 1.0 + 2 * np.pi, 241)})
trace = ["C"]
