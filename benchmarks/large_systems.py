"""How the cost of a large mechanism grows: one Newton step, solves and gradients of chains of four-bars.

Run ``python benchmarks/large_systems.py``. A step is evaluation of rows and Jacobian, factorisation and solve; best of
many runs, every one from another pose. ``blocks`` is what the library chooses, ``LU`` is its general way (SuperLU on
the host), ``dense`` what it does below the threshold. The growth exponent is the slope of time over unknowns, both as
logarithms: 1 is linear.
"""

import functools
import math
import time

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

import jaxnc as nc  # noqa: E402 (after the switch)
from jaxnc.solvers.assembly import derive  # noqa: E402
from jaxnc.solvers.plan import plan  # noqa: E402

SIZES = (49, 499, 4999)  # loops: about 100, 1,000 and 10,000 unknowns
DENSE = 1100  # unknowns up to which the dense way is timed


@functools.partial(jax.jit, static_argnums=(0, 3))
def step(view, eq, q, host):
    """One Newton step, and what it has to correct."""
    r, jacobian, _ = view.linearise(eq, q)
    dx = view.lu.solve(jacobian, r[:, None]) if host else view.steps(eq, jacobian, r[:, None])
    return view.move(q, -dx[:, 0]), jnp.max(jnp.abs(r))


def best(f, *arguments, seconds=2.0):
    """Seconds of the fastest run, compiled before."""
    jax.block_until_ready(f(*arguments))
    fastest, end = math.inf, time.perf_counter() + seconds
    while time.perf_counter() < end:
        start = time.perf_counter()
        jax.block_until_ready(f(*arguments))
        fastest = min(fastest, time.perf_counter() - start)
    return fastest


def step_time(view, eq, host=False):
    """Seconds of a step, from poses a little off the solution; whether five of them converge."""
    rng = np.random.default_rng(1)
    off = np.zeros((16, len(eq.topology.coordinates)))
    off[:, view.unknown] = 1e-3 * rng.standard_normal((16, len(view.unknown)))
    starts = [jax.device_put(eq.home + x) for x in off]
    q = starts[0]
    for _ in range(5):
        q, size = step(view, eq, q, host)
    fastest, end, k = math.inf, time.perf_counter() + 3.0, 0
    while time.perf_counter() < end:
        start = time.perf_counter()
        jax.block_until_ready(step(view, eq, starts[k % 16], host))
        fastest, k = min(fastest, time.perf_counter() - start), k + 1
    return fastest, float(size) <= 1e-11


def row(loops):
    """Everything about one chain: n, stored numbers, seconds."""
    mechanism = nc.library.four_bar_chain(loops, last=1.05)
    start = time.perf_counter()
    system = mechanism.compile(sparse=True)
    found = {"n": len(system.topology.unknown), "compile": time.perf_counter() - start}
    view, eq = plan(system.topology, ("phi",), (), 1), derive(system)
    found["stored"] = view.stored
    for name, host in (("blocks", False), ("LU", True)):
        start = time.perf_counter()
        jax.block_until_ready(step(view, eq, eq.home, host))
        found[name + " compile"] = time.perf_counter() - start
        found[name], right = step_time(view, eq, host)
        assert right, f"{name}: no quadratic convergence at {loops} loops"
    if found["n"] <= DENSE:
        dense = mechanism.compile(sparse=False) if found["n"] < 300 else None
        if dense is not None:
            found["dense"] = step_time(plan(dense.topology, ("phi",), (), 1), derive(dense))[0]

    def height(s, u):
        return nc.solve_position(s, {"phi": u}, throw=False)[f"B{loops}"][1]

    found["solve"] = best(jax.jit(height), system, 1.1)
    found["solve+gradient"] = best(jax.jit(jax.value_and_grad(height)), system, 1.1)
    return found


def main():
    """Print the table."""
    rows = [row(loops) for loops in SIZES]
    for name in ("stored", "blocks", "LU", "dense", "solve", "solve+gradient", "compile", "blocks compile"):
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
