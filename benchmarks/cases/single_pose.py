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
    """Time single solves, each at another angle; and a compiled function that does nothing, with as many results."""
    bars = FourBars.default()
    system = four_bar(bars).compile()
    angles = np.linspace(0.0, 2 * np.pi, suite.size(500, 100)) + 0.01

    def solve(phi: float) -> tuple[float, nc.Motion]:
        start = time.process_time()
        pose = jax.block_until_ready(nc.solve_position(system, {"phi": phi}))
        return time.process_time() - start, pose

    first = solve(0.5)[0]
    for phi in angles[:20]:
        solve(float(phi))
    found = [solve(float(phi)) for phi in angles]  # looked at afterwards: this is what takes time in between
    times = [seconds for seconds, _ in found]
    size = float(bars.ground)
    rights = [
        fraction(np.asarray(pose["C"]), bars.poses(np.asarray(phi))[1], size)
        for (_, pose), phi in zip(found, angles, strict=True)
    ]
    note = f"{len(times)} calls; a single pose raises if it fails"
    suite.record.rows.append(row("single", "jaxnc", 1, times, rights, first - float(np.median(times)), note))
    note = "a compiled function with two arguments, and as many results as a pose has"
    suite.record.rows.append(row("single", "nothing", 1, _nothing(found[0][1].q, angles), [], None, note))


def _nothing(q: jax.Array, angles: np.ndarray) -> list[float]:
    """Seconds of calls that give back what they get."""

    @jax.jit
    def empty(q, at):
        return q + 1.0, at[1:], at[0], at[1], at[2]

    times = []
    for phi in (*angles[:20], *angles):
        at = np.array([phi, phi, phi])
        start = time.process_time()
        jax.block_until_ready(empty(q, at))
        times.append(time.process_time() - start)
    return times[20:]
