"""Rows of four-bars: one pose of a mechanism with up to ten thousand coordinates."""

import subprocess

import numpy as np

from benchmarks import fresh
from benchmarks.clock import row
from benchmarks.suite import Suite

CASE = "row of four-bars, one pose, {:,} coordinates"
STEP = "row of four-bars, Newton step, {:,} coordinates"
_LIMIT = 240.0  # seconds for one size, compilation and all
_HOPELESS = 5.0  # seconds of one pose: ten times as many coordinates are not tried


def one_pose(suite: Suite) -> None:
    """One solve of rows with 100, 1,000 and 10,000 coordinates, each in a fresh process with a limit of time."""
    before = 0.0
    for coordinates in (100, 1000) if suite.quick else (100, 1000, 10_000):
        case, step = CASE.format(coordinates), STEP.format(coordinates)
        sparse = fresh.measure(f"row:sparse:{coordinates // 2}")
        count, rows = sparse["steps"], suite.record.rows
        if before > _HOPELESS:
            suite.record.leave_out(f"{case}, jaxnc", f"a tenth of it took {before:.0f} s")
        else:
            try:
                ours = fresh.measure(f"row:jaxnc:{coordinates // 2}", timeout=_LIMIT)
            except subprocess.TimeoutExpired:
                suite.record.leave_out(f"{case}, jaxnc", f"not done in {_LIMIT:.0f} s")
                before = _LIMIT
            else:
                note = "solve_position from the drawing, a single pose"
                rows.append(row(case, "jaxnc", 1, ours["seconds"], ours["right"], ours["compile_s"], note))
                before = float(np.median(ours["seconds"]))
                note = f"a pose divided by the {count} steps that plain Newton needs from the same start"
                rows.append(row(step, "jaxnc", 1, [s / count for s in ours["seconds"]], [None], None, note))
        note = f"{count} Newton steps from the drawing, sparse LU"
        rows.append(row(case, "SciPy sparse Newton", 1, sparse["seconds"], sparse["right"], None, note))
        rows.append(row(step, "SciPy sparse Newton", 1, sparse["step_seconds"], [None], None, "assembly and solve"))
