"""Excavator: boom, stick and bucket, each moved by the length of a hydraulic cylinder.

Try: drive the bucket's tip T by ``"T.x"`` and ``"T.y"`` with one cylinder held: inverse kinematics is the same call.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("excavator", length_unit="m")
m.ground("A", (0, 0))
m.ground("B", (0.6, -0.4))
m.point("C", (2.6, 2.4))  # on the boom
m.point("D", (5.0, 2.2))  # boom to stick
m.point("E", (2.4, 3.0))  # cylinder of the stick, on the boom
m.point("F", (4.7, 2.9))  # heel of the stick
m.point("G", (6.0, -0.2))  # stick to bucket
m.point("H", (5.6, 1.6))  # cylinder of the bucket, on the stick
m.point("K", (6.5, 0.1))  # ear of the bucket
m.point("T", (6.2, -1.5))  # teeth
m.body("boom", ["A", "C", "D", "E"])
m.body("stick", ["D", "F", "G", "H"])
m.body("bucket", ["G", "K", "T"])
m.distance("lift", "B", "C")
m.distance("crowd", "E", "F")
m.distance("curl", "H", "K")

system = m.compile()
start = nc.solve_position(system, {"lift": 3.4409, "crowd": 2.3022, "curl": 1.7493})
t = np.linspace(0, 2 * np.pi, 121)
motion = nc.sweep(
    system,
    {"lift": 3.3 + 0.35 * np.sin(t), "crowd": 2.4 + 0.3 * np.cos(t), "curl": 1.6 + 0.25 * np.sin(t + 0.8)},
)
trace = ["T"]
