"""How the cost of a large mechanism grows: one Newton step, solves and gradients of chains of four-bars.

Run ``python benchmarks/large_systems.py``. A step is evaluation of rows and Jacobian, factorisation and solve, on the
host; best of many runs, every one from another pose. ``dense`` is what the library does below the threshold. The growth
exponent is the slope of time over unknowns, both as logarithms: 1 is linear.
"""

import math
import time

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)

import jaxnc as nc  # noqa: E402 (after the switch)
from jaxnc.solvers.assembly import derive, to_host  # noqa: E402
from jaxnc.solvers.host import view_of  # noqa: E402
from jaxnc.solvers.plan import LargePlan, plan  # noqa: E402

SIZES = (49, 499, 4999)  # loops: about 100, 1,000 and 10,000 unknowns
DENSE = 300  # unknowns up to which the dense way is timed


def best(f, *arguments, seconds=2.0):
    """Seconds of the fastest run, compiled before."""
    jax.block_until_ready(f(*arguments))
    fastest, end = math.inf, time.perf_counter() + seconds
    while time.perf_counter() < end:
        start = time.perf_counter()
        jax.block_until_ready(f(*arguments))
        fastest = min(fastest, time.perf_counter() - start)
    return fastest


def step_time(system):
    """Seconds of a step, from poses a little off the solution; whether five of them converge."""
    eq, rng = to_host(derive(system)), np.random.default_rng(1)
    view = view_of(plan(system.topology, ("phi",), (), 1), eq)
    starts = np.repeat(eq.home[:, None], 16, axis=1)
    starts[view.plan.unknown] += 1e-3 * rng.standard_normal((len(view.plan.unknown), 16))

    def step(q):
        r = view.residual(q)
        q[view.plan.unknown] -= view.solve(view.matrices(q)[0], r.T[:, :, None])[:, :, 0].T
        return np.max(np.abs(r))

    q = starts[:, :1].copy()
    size = [step(q) for _ in range(5)][-1]
    fastest, end, k = math.inf, time.perf_counter() + 3.0, 0
    while time.perf_counter() < end:
        q = starts[:, [k % 16]]
        start = time.perf_counter()
        step(q)
        fastest, k = min(fastest, time.perf_counter() - start), k + 1
    return fastest, float(size) <= 1e-11


def row(loops):
    """Everything about one chain: n, stored numbers, seconds."""
    mechanism = nc.library.four_bar_chain(loops, last=1.05)
    start = time.perf_counter()
    system = mechanism.compile(sparse=True)
    found = {"n": len(system.topology.unknown), "compile": time.perf_counter() - start}
    found["step"], right = step_time(system)
    assert right, f"no quadratic convergence at {loops} loops"
    view = plan(system.topology, ("phi",), (), 1)
    assert isinstance(view, LargePlan)
    found["stored"] = view.stored
    if found["n"] <= DENSE:
        found["dense"] = step_time(mechanism.compile(sparse=False))[0]

    def height(s, u):
        return nc.solve_position(s, {"phi": u}, throw=False)[f"B{loops}"][1]

    found["solve"] = best(jax.jit(height), system, 1.1)
    found["solve+gradient"] = best(jax.jit(jax.value_and_grad(height)), system, 1.1)
    return found


def main():
    """Print the table."""
    rows = [row(loops) for loops in SIZES]
    for name in ("stored", "step", "dense", "solve", "solve+gradient", "compile"):
        values = [(r["n"], r[name]) for r in rows if name in r]
        unit = 1.0 if name == "stored" else 1.0 if "compile" in name else 1e3
        label = name + ("" if name == "stored" else " [s]" if "compile" in name else " [ms]")
        cells = "".join(f"{unit * v:>12.4g}" for _, v in values)
        slope = ""
        if len(values) > 1:
            (a, x), (b, y) = values[-2], values[-1]
            slope = f"   growth exponent {math.log(y / x) / math.log(b / a):.2f}"
        print(f"{label:22s}{cells}{slope}")
    print(f"{'unknowns':22s}" + "".join(f"{r['n']:>12d}" for r in rows))


if __name__ == "__main__":
    main()
