"""Umbrella: a runner on the stick opens a pair of ribs.

Try: a rib of three points that bends down at its end, driven by a second stretcher.
"""

import numpy as np

import jaxnc as nc

m = nc.Mechanism("umbrella")
m.ground("N", (0, 1.0))  # notch at the top
m.point("R", (0, 0.45), fixed="x")  # runner
for k, side in (("1", -1), ("2", 1)):
    m.point("S" + k, (0.28 * side, 0.85))
    m.point("T" + k, (0.5, 0.7) if side > 0 else (-0.5, 0.7))
    m.body("rib " + k, ["N", "S" + k, "T" + k])
    m.body("stretcher " + k, ["R", "S" + k])
runner = np.linspace(0.25, 0.72, 81)

motion = nc.sweep(m.compile(), {"R.y": np.concatenate([runner, runner[::-1]])})
trace = ["T1", "T2"]
