"""Desk lamp: two parallelograms keep the shade level wherever it is.

Try: add `m.mass`, `m.spring` and ask `nc.equilibrium` which springs hold the lamp anywhere.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("desk lamp")
m.ground("A", (0, 0))
m.ground("B", (-0.05, 0.02))
m.point("C", (-0.10, 0.40))
m.point("D", (-0.15, 0.42))
m.point("E", (-0.10, 0.46))  # the elbow plate has two pairs of pins
m.point("F", (0.22, 0.56))
m.point("G", (0.22, 0.62))
m.point("L", (0.30, 0.52))
m.body("lower 1", ["A", "C"])
m.body("lower 2", ["B", "D"])
m.body("elbow", ["C", "D", "E"])
m.body("upper 1", ["C", "F"])
m.body("upper 2", ["E", "G"])
m.body("shade", ["F", "G", "L"])
m.angle("lower", at="A", to="C")
m.angle("upper", at="C", to="F")

t = np.linspace(0, 2 * np.pi, 121)
motion = nc.sweep(m.compile(), {"lower": 1.7 + 0.35 * np.sin(t), "upper": 0.45 + 0.45 * np.cos(t)})
trace = ["L"]
