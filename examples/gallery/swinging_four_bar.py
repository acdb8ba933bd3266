"""Swinging four-bar: released on a spring it swings as a pendulum does, and its energy is kept.

Try: `nc.equilibrium(system)` finds where it would hang, `nc.linearise` how fast it swings about there.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("swinging four-bar")
m.ground("A", (0, 0))
m.ground("D", (0.5, 0.1))
m.point("B", (-0.3, 0.1))
m.point("C", (0.3, -0.45))
m.body("left", ["A", "B"], mass=0.4)
m.body("coupler", ["B", "C"], mass=1.5)
m.body("right", ["C", "D"], mass=0.6)
m.gravity = (0, -9.81)
m.spring("spring", "B", "D", stiffness=8.0)

motion = nc.simulate(m.compile(), np.linspace(0, 4, 161))
trace = ["B", "C"]
