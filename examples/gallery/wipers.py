"""Windscreen wipers: one motor crank swings two blades through a four-bar each.

Try: move the motor O and watch the angle of both blades; `nc.transmission_angle` says how well it pushes.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("windscreen wipers")
m.ground("O", (0.45, -0.10))
m.ground("D1", (0, 0))
m.ground("D2", (0.60, 0))
m.point("A", (0.45, -0.06))
m.point("C1", (0.0, -0.075))
m.point("C2", (0.60, -0.075))
m.point("T1", (-0.02, 0.50))
m.point("T2", (0.58, 0.50))
m.body("motor", ["O", "A"])
m.body("rod 1", ["A", "C1"])
m.body("rod 2", ["C1", "C2"])
m.body("blade 1", ["C1", "D1", "T1"])
m.body("blade 2", ["C2", "D2", "T2"])
m.angle("phi", at="O", to="A")

motion = nc.sweep(m.compile(), {"phi": np.linspace(np.pi / 2, 2.5 * np.pi, 121)})
trace = ["T1", "T2"]
