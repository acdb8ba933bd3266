"""What one call costs: a single pose of a compiled four-bar, from Python."""

import time

import jax
import numpy as np

import jaxnc as nc
from benchmarks.circles import FourBars, fraction
from benchmarks.clock import row
from benchmarks.mechanisms import four_bar
from benchmarks.suite import Suite


def from_python(suite: Suite) -> None:
    """Time single solves, each at another angle."""
    bars = FourBars.default()
    system = four_bar(bars).compile()
    angles = np.linspace(0.0, 2 * np.pi, suite.size(500, 100)) + 0.01

    def solve(phi: float) -> tuple[float, float]:
        start = time.process_time()
        pose = jax.block_until_ready(nc.solve_position(system, {"phi": phi}))
        seconds = time.process_time() - start
        return seconds, fraction(np.asarray(pose["C"]), bars.poses(np.asarray(phi))[1], float(bars.ground))

    first = solve(0.5)[0]
    for phi in angles[:20]:
        solve(float(phi))
    found = [solve(float(phi)) for phi in angles]
    times, rights = zip(*found, strict=True)
    note = f"{len(times)} calls; a single pose raises if it fails"
    suite.record.rows.append(row("single", "jaxnc", 1, times, rights, first - float(np.median(times)), note))
