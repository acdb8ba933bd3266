"""Sarrus linkage: two pairs of hinged plates in planes across each other lift a platform exactly straight.

Try: `nc.mobility` counts it: by Grübler's formula it does not move at all.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("Sarrus linkage", dim=3)
m.ground_vector("ux", (1, 0, 0))
m.ground_vector("uy", (0, 1, 0))
m.ground("A", (1, 0, 0))
m.ground("B", (0, 1, 0))
m.vector("px", (1, 0, 0))
m.vector("py", (0, 1, 0))
m.point("C", (1.5, 0, 0.8))
m.point("D", (0, 1.5, 0.8))
m.point("P", (1, 0, 1.6))
m.point("Q", (0, 1, 1.6))
m.body("plate 1", ["A", "C"], vectors=["uy"])
m.body("plate 2", ["C", "P"], vectors=["uy", "py"])
m.body("plate 3", ["B", "D"], vectors=["ux"])
m.body("plate 4", ["D", "Q"], vectors=["ux", "px"])
m.body("platform", ["P", "Q"], vectors=["px", "py"])

motion = nc.sweep(m.compile(), {"P.z": np.linspace(1.75, 0.4, 81)})
trace = ["C", "D", "P"]
