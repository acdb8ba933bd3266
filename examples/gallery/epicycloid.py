"""Planet wheel: on a fixed sun three times its size, a point of its rim draws an epicycloid of three arches.

Try: put P outside of the rim, or let the sun turn as well by giving it an angle of its own in the relation.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("epicyclic wheel")
m.ground("O", (0, 0))
m.point("C", (0.4, 0))  # sun of radius 0.3, planet of radius 0.1
m.point("P", (0.5, 0))
m.body("carrier", ["O", "C"])
m.body("planet", ["C", "P"])
m.angle("carrier_angle", at="O", to="C")
m.angle("planet_angle", at="C", to="P")
m.relation({"planet_angle": 1.0, "carrier_angle": -(1.0 + 0.3 / 0.1)})

motion = nc.sweep(m.compile(), {"carrier_angle": np.linspace(0.0, 2 * np.pi, 241)})
trace = ["P"]
