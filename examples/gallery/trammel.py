"""Trammel of Archimedes: a rod whose two shoes slide in crossed slots; every point of it draws an ellipse.

Try: put P beyond B, or halfway between A and B, where the ellipse becomes a circle.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("trammel of Archimedes")
m.ground("O", (0, 0))
m.point("A", (0.3, 0), fixed="y")  # in the slot along x
m.point("B", (0, 0.4), fixed="x")  # in the slot along y
m.point("P", (0.6, -0.4))
m.body("rod", ["A", "B", "P"])
m.angle("phi", at="B", to="A")

motion = nc.sweep(m.compile(), {"phi": np.linspace(-0.93, 2 * np.pi - 0.93, 181)})
trace = ["P"]
