"""Evans's grasshopper beam: half a Scott Russell linkage, with a long rocker in the place of the slide.

Try: lengthen the rocker D-A: P goes straighter.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("grasshopper beam")
m.ground("O", (0, 0))
m.ground("D", (1.0, -1.5))
m.point("C", (0.45, 0.2))
m.point("A", (0.9, 0.0))
m.point("P", (0.0, 0.4))
m.body("link", ["O", "C"])
m.body("beam", ["A", "C", "P"])
m.body("rocker", ["D", "A"])
m.angle("phi", at="O", to="C")

motion = nc.sweep(m.compile(), {"phi": np.linspace(-0.8, 0.8, 121)})
trace = ["P", "A"]
