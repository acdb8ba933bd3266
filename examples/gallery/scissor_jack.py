"""Scissor jack: a screw draws two nuts together and lifts a car.

Try: `nc.sensitivity` of the head's height: the screw lifts more per turn the higher it already is.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("scissor jack", length_unit="mm")
m.ground("O", (0, 0))
m.point("L", (-150, 60))
m.point("R", (150, 60))
m.point("H", (0, 120), fixed="x")
for name, ends in {"lower left": "OL", "lower right": "OR", "upper left": "LH", "upper right": "RH"}.items():
    m.body(name, list(ends))
m.distance("screw", "L", "R")

motion = nc.sweep(m.compile(), {"screw": np.linspace(310, 80, 101)})
trace = ["H", "L", "R"]
