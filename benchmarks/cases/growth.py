"""How cost grows: with the batch, with the number of unknowns, with the number of designs."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxnc as nc
from benchmarks.cases import crank_rocker, ensemble
from benchmarks.circles import RELATIVE
from benchmarks.clock import Way
from benchmarks.mechanisms import row_of_loops
from benchmarks.peers import naive
from benchmarks.peers.sparse_row import FIRST
from benchmarks.suite import Suite


def with_batch(suite: Suite) -> None:
    """One four-bar, 1 to 1,000,000 angles in one call."""
    sizes = (1, 100, 10_000) if suite.quick else (1, 10, 100, 1000, 10_000, 100_000, 1_000_000)
    for size in sizes:
        ways = [
            crank_rocker.ours(),
            crank_rocker.by_hand(2),
            *suite.peer("naive JAX", lambda: [crank_rocker.naive(2)]),
            *suite.peer("numba", crank_rocker.numba_newton, "numba"),
        ]
        suite.compare("growth: batch", ways, crank_rocker.Turn.draw, size)


def with_designs(suite: Suite) -> None:
    """1 to 10,000 four-bar designs, 360 angles each."""
    way = ensemble.ours("jaxnc", lambda s, u: nc.solve_position(s, {"phi": u}, throw=False), "360 angles each")
    for size in (1, 10) if suite.quick else (1, 10, 100, 1000, 10_000):
        others = suite.peer("pylinkage", ensemble.pylinkage, "pylinkage")
        suite.compare("growth: designs", [way, *others], ensemble.draw, size, per=ensemble.ANGLES)


def with_unknowns(suite: Suite) -> None:
    """Rows of 1 to 64 loops, two unknowns a loop, a thousand angles."""
    home, size = float(np.arctan2(FIRST[1], FIRST[0])), float(np.hypot(*FIRST))

    def draw(seed: int, count: int) -> np.ndarray:
        return home + np.linspace(-0.2 - 0.001 * seed, 0.2, count)

    for loops in (1, 4) if suite.quick else (1, 4, 16, 64):
        system = row_of_loops(loops).compile()
        top = system.topology
        columns = np.array([[top.position[f"P{i}.x"], top.position[f"P{i}.y"]] for i in range(1, loops + 1)])
        feet = np.stack([np.arange(1, loops + 1), np.zeros(loops)], axis=1)

        def right(q: Any, accepted: Any, phi: np.ndarray, columns=columns, feet=feet, loops=loops) -> float:
            wanted = feet + size * np.stack([np.cos(phi), np.sin(phi)], axis=1)[:, None]
            off = np.abs(np.asarray(q)[:, columns] - wanted).max(axis=(1, 2))
            return float(np.mean((off <= RELATIVE * loops) & np.asarray(accepted)))

        def run(phi, system=system):
            return jax.block_until_ready(nc.solve_position(system, {"phi": phi}, throw=False))

        def make(system=system, right=right) -> list[Way]:
            solve = naive.of_system(system, ("phi",), ())
            return [
                Way(
                    "naive JAX",
                    lambda u: jax.block_until_ready(solve(u)),
                    lambda out, phi: right(out[0], out[1], phi),
                    prepare=lambda phi: jnp.asarray(phi)[:, None],
                    compiles=True,
                    note="the same residual and unknowns",
                )
            ]

        ours = Way(
            "jaxnc",
            run,
            lambda mo, phi, right=right: right(mo.q, mo.converged, phi),
            prepare=jnp.asarray,
            compiles=True,
            note=f"{2 * loops} unknowns",
        )
        case = f"growth: unknowns, {2 * loops}"
        suite.compare(case, [ours, *suite.peer("naive JAX", make)], draw, suite.size(1000, 200))
