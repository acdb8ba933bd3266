"""Pump jack: a crank rocks a beam over an oil well, and the polished rod goes up and down.

Try: `jax.grad` of the stroke with respect to the crank, or a counterweight and `nc.inverse_dynamics` for the torque.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("pump jack", length_unit="m")
m.ground("O", (0.6, 0))
m.ground("S", (3.0, 3.2))  # saddle of the beam
m.point("A", (0.6, 0.9))
m.point("B", (0.6, 3.6))
m.point("H", (5.6, 3.0))  # horse head
m.point("R", (5.6, 1.0), fixed="x")  # polished rod
m.body("crank", ["O", "A"])
m.body("pitman", ["A", "B"])
m.body("beam", ["B", "S", "H"])
m.body("bridle", ["H", "R"])
m.angle("phi", at="O", to="A")

motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 121)}, rates={"phi": 1.0})
trace = ["H", "R"]
