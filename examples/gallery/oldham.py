"""Oldham coupling: a disc that slides on the keys of two parallel shafts carries the rotation over unchanged.

Try: move D: the disc's centre M runs around a circle whose diameter is the shafts' distance, twice a turn.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("Oldham coupling")
shaft1, shaft2 = np.array([0, 0]), np.array([0.3, 0])
one, two = np.array([np.cos(1.2), np.sin(1.2)]), np.array([-np.sin(1.2), np.cos(1.2)])  # the keys, square
centre = shaft2 @ one * one
m.ground("O", tuple(shaft1))
m.ground("D", tuple(shaft2))
m.point("A", tuple(one))
m.point("B", tuple(shaft2 + 0.7 * two))
m.point("M", tuple(centre))
m.point("N", tuple(centre + 0.6 * one))
m.point("K", tuple(centre + 0.6 * two))
m.body("shaft 1", ["O", "A"])
m.body("shaft 2", ["D", "B"])
m.body("disc", ["M", "N", "K"])
m.prismatic("key 1", line=("O", "A"), on=("M", "N"))
m.prismatic("key 2", line=("D", "B"), on=("M", "K"))
m.angle("phi", at="O", to="A")
m.angle("psi", at="D", to="B")

motion = nc.sweep(m.compile(), {"phi": np.linspace(1.2, 1.2 + 2 * np.pi, 161)})
trace = ["M", "N", "K"]
