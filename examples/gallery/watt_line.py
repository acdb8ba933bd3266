"""Watt's linkage (1784): a coupler's point between two arms goes nearly straight; it led pistons, and leads axles.

Try: its deviation from a straight line, and `jax.grad` of that with respect to the arms.
"""

import numpy as np

import jaxnc as nc

m = nc.library.watt_straight_line()

motion = nc.sweep(m.compile(), {"phi": np.linspace(-1.3, 0.55, 161)})
trace = ["P"]
