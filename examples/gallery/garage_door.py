"""Overhead door: a roller in a track and a pair of arms bring the door from upright to under the ceiling.

Try: tilt the track (its points are G and H), and look at how far the bottom edge swings out.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("overhead door", length_unit="m")
m.ground("D", (0.15, 1.15))
m.ground("G", (0.1, 2.1))
m.ground("H", (2.2, 2.1))
m.point("B", (0, 0))  # bottom edge
m.point("C", (0, 0.55))  # where the arm holds the door
m.point("T", (0.1, 2.1))  # roller at the top
m.body("door", ["B", "C", "T"])
m.body("arm", ["D", "C"])
m.slot("track", "T", ("G", "H"))
m.angle("arm_angle", at="D", to="C")

motion = nc.sweep(m.compile(), {"arm_angle": np.linspace(-1.83, -4.2, 101)})
trace = ["B", "T"]
