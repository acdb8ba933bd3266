"""Planet wheel: on a fixed sun three times its size, a point of its rim draws an epicycloid of three arches.

Try: put P outside of the rim, or take two wheels of 0.2, with P at (0.6, 0), which draw a heart.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("epicyclic wheel")
m.ground("O", (0, 0))
m.ground("S", (0.3, 0))  # on the sun's rim
m.point("C", (0.4, 0))
m.point("P", (0.5, 0))
m.body("carrier", ["O", "C"])
m.body("planet", ["C", "P"])
m.angle("carrier_angle", at="O", to="C")
m.angle("sun", at="O", to="S", start="C")  # both from the line of centres
m.angle("planet", at="C", to="P", start="O")
m.gear("mesh", "sun", "planet", radii=(0.3, 0.1))

motion = nc.sweep(m.compile(), {"carrier_angle": np.linspace(0.0, 2 * np.pi, 241)})
trace = ["P"]
