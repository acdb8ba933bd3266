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

    def solve(phi: float, **start: nc.Motion) -> tuple[float, nc.Motion]:
        begin = time.process_time()
        pose = jax.block_until_ready(nc.solve_position(system, {"phi": phi}, **start))
        return time.process_time() - begin, pose

    first, pose = solve(0.5)
    for way, note in (("jaxnc", "from the drawing"), ("jaxnc: start=", "from the pose before")):
        found = []  # looked at afterwards: this is what takes time in between
        for phi in (*angles[-20:], *angles):
            found.append(solve(float(phi)) if way == "jaxnc" else solve(float(phi), start=pose))
            pose = found[-1][1]
        times = [seconds for seconds, _ in found[20:]]
        rights = [
            fraction(np.asarray(pose["C"]), bars.poses(np.asarray(phi))[1], float(bars.ground))
            for (_, pose), phi in zip(found[20:], angles, strict=True)
        ]
        note = f"{note}; {len(times)} calls; a single pose raises if it fails"
        compiled = first - float(np.median(times)) if way == "jaxnc" else None
        suite.record.rows.append(row("single", way, 1, times, rights, compiled, note))
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
