"""Wobble plate: an inclined journal makes a plate nutate, and pistons go to and fro.

Try: the angle of the journal sets the stroke: `jax.grad` of the stroke.
"""

import numpy as np

import jaxnc as nc

m = nc.library.wobble_plate()

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 121)})
trace = ["P1", "Q1"]
