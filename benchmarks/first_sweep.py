"""What a user waits for: import, first and second sweep of a four-bar, and compile time as a mechanism grows.

Run ``python benchmarks/first_sweep.py``. Every first sweep is timed in a process of its own, without a compilation
cache, imports apart; the table shows medians of five processes and the range.
"""

import os
import statistics
import subprocess
import sys

MEASURE = """
import time
t0 = time.perf_counter()
import jax
t1 = time.perf_counter()
import jaxnc
t2 = time.perf_counter()
import numpy as np, scipy.sparse.csgraph
jaxnc.Mechanism, jaxnc.sweep
jax.config.update("jax_enable_x64", True)


def row(bars):
    m = jaxnc.Mechanism("row")
    m.ground("G0", (0, 0)); m.point("P0", (0.3, 1.0)); m.body("b0", ["G0", "P0"])
    for i in range(1, bars // 2 + 1):
        m.ground(f"G{i}", (float(i), 0)); m.point(f"P{i}", (i + 0.3, 1.0))
        m.body(f"r{i}", [f"G{i}", f"P{i}"]); m.body(f"c{i}", [f"P{i-1}", f"P{i}"])
    m.angle("phi", at="G0", to="P0")
    return m


def four_bar():
    m = jaxnc.library.four_bar(coupler_point=(0.06, 0.04))
    return m


m = four_bar() if BARS == 4 else row(BARS)
turn = np.linspace(0, 2 * np.pi, 361) if BARS == 4 else np.linspace(1.28, 1.4, 3)
t3 = time.perf_counter()
system = m.compile()
motion = jaxnc.sweep(system, {"phi": turn}, **RATES)
jax.block_until_ready(motion.q)
t4 = time.perf_counter()
again = []
for _ in range(20):
    t = time.perf_counter()
    motion = jaxnc.sweep(system, {"phi": turn}, **RATES)
    jax.block_until_ready(motion.q)
    again.append(time.perf_counter() - t)
right = float(np.mean(np.asarray(motion.converged)))
print(t2 - t1, t4 - t3, sorted(again)[10], right)
"""


def measure(bars: int, rates: str, runs: int = 5) -> list[list[float]]:
    """Numbers of several processes: import, first sweep, later sweep (seconds), share of right poses."""
    code = MEASURE.replace("BARS", str(bars)).replace("RATES", rates)
    env = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    out = []
    for _ in range(runs):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=env)
        out.append([float(x) for x in done.stdout.split()])
    return out


def main() -> None:
    """Print the table."""
    print(f"{'':34} {'import jaxnc':>13} {'first sweep':>22} {'later sweep':>12}  right")
    for label, bars, rates in (
        ("four-bar, 361 poses", 4, "{}"),
        ("the same with rates", 4, "{'rates': {'phi': 1.0}}"),
        ("row of 30 bars, 3 poses", 30, "{}"),
        ("row of 300 bars, 3 poses", 300, "{}"),
    ):
        columns = list(zip(*measure(bars, rates), strict=True))
        middle = [statistics.median(c) for c in columns]
        spread = f"{middle[1]:.2f} s ({min(columns[1]):.2f}-{max(columns[1]):.2f})"
        print(f"{label:34} {middle[0] * 1e3:10.1f} ms {spread:>22} {middle[2] * 1e3:9.2f} ms  {min(columns[3]):.0%}")


if __name__ == "__main__":
    main()
