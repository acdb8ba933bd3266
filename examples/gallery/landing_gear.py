"""Landing gear: a folding strut that stands in line when the wheel is down.

Try: `nc.travel(system, "leg")` finds the locked position, where the strut is a dead point.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("landing gear", length_unit="m")
m.ground("A", (0, 0))
m.ground("B", (1.2, -0.05))
m.point("W", (0.05, -1.6))  # wheel
m.point("C", (0.02, -0.8))
m.point("K", (0.55, -0.40))  # knee of the strut
m.body("leg", ["A", "C", "W"])
m.body("lower strut", ["C", "K"])
m.body("upper strut", ["B", "K"])
m.angle("leg", at="A", to="W")

motion = nc.sweep(m.compile(), {"leg": np.linspace(-1.54, -0.1, 101)})
trace = ["W", "K"]
