"""Gardener's ellipse: a pencil keeps a string taut that is tied to two pegs.

Try: a longer string with ``length=``, or three pegs in the cable's list of points for an egg.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("gardener's ellipse")
m.ground("F", (-0.4, 0))
m.ground("G", (0.4, 0))
m.point("P", (0.5, 0.2))
m.cable("string", ["F", "P", "G"], length=1.2)
m.angle("phi", at="F", to="P")  # the direction in which the pencil is seen from one peg

motion = nc.sweep(m.compile(), {"phi": np.linspace(0.2, 0.2 + 2 * np.pi, 181)})
trace = ["P"]
