"""Radial engine: five pistons on one crank pin, by a master rod and four rods that ride on it.

Try: compare the strokes: those of the four are a little different, which is why real engines shift their pins.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("radial engine")
m.ground("O", (0, 0))
m.point("A", (0, 0.05))
turn = [np.array([np.sin(a), np.cos(a)]) for a in 2 * np.pi * np.arange(5) / 5]
crank, knuckle, rod = np.array([0, 0.05]), 0.03, 0.17
m.body("crank", ["O", "A"])
pins = [f"K{k}" for k in range(1, 5)]
m.point("P0", (0, 0.05 + knuckle + rod), fixed="x")
for k in range(1, 5):
    pin = crank + knuckle * turn[k]
    across = pin - (pin @ turn[k]) * turn[k]
    m.point(f"K{k}", tuple(pin))
    m.ground(f"G{k}", tuple(0.10 * turn[k]))
    m.ground(f"H{k}", tuple(0.30 * turn[k]))
    m.point(f"P{k}", tuple(((pin @ turn[k]) + np.sqrt(rod**2 - across @ across)) * turn[k]))
m.body("master rod", ["A", "P0", *pins])
for k in range(1, 5):
    m.body(f"rod {k}", [f"K{k}", f"P{k}"])
    m.slot(f"cylinder {k}", f"P{k}", (f"G{k}", f"H{k}"))
m.angle("phi", at="O", to="A")

motion = nc.sweep(m.compile(), {"phi": np.linspace(np.pi / 2, 2.5 * np.pi, 121)})
trace = ["K1", "K2", "K3", "K4"]
