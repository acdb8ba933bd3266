"""A thousand designs through a full turn, beside pylinkage's Ensemble."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxnc as nc
from benchmarks import designs
from benchmarks.circles import FourBars, fraction
from benchmarks.clock import Way
from benchmarks.mechanisms import four_bars
from benchmarks.suite import Suite

ANGLES = 360
_STEP = 2 * np.pi / ANGLES
Data = tuple[FourBars, np.ndarray]


def draw(seed: int, count: int) -> Data:
    """Crank-rockers, and the angles that all of them go through, one step from home onwards."""
    return designs.crank_rockers(seed, count), 1.0 + 1e-3 * seed + _STEP * np.arange(1, ANGLES + 1)


def right(found: np.ndarray, data: Data, accepted: Any = None) -> float:
    """Fraction of right lanes."""
    bars, phi = data
    wanted = bars.column().poses(np.broadcast_to(phi, (len(bars.crank), len(phi))))[1]
    return fraction(found, wanted, bars.ground[:, None], None if accepted is None else np.asarray(accepted))


def ours(name: str, analyse: Callable[[nc.System, Any], nc.Motion], note: str) -> Way:
    """One analysis of this library under ``jit(vmap)`` over designs."""

    @jax.jit
    def solve(systems, phi):
        def one(system):
            motion = analyse(system, phi)
            return motion["C"], motion.status

        return jax.vmap(one)(systems)

    return Way(
        name,
        lambda prepared: jax.block_until_ready(solve(*prepared)),
        lambda out, data: right(np.asarray(out[0]), data, out[1] == 0),
        prepare=lambda data: (four_bars(data[0]), jnp.asarray(data[1])),
        compiles=True,
        note=note,
    )


def pylinkage() -> list[Way]:
    from benchmarks.peers.dyads import ensemble

    return [
        Way(
            "pylinkage Ensemble",
            lambda run: run(ANGLES),
            lambda out, data: right(out, data),
            prepare=lambda data: ensemble(data[0], float(data[1][0]) - _STEP, _STEP),
            note="Ensemble.simulate; designs and start poses prepared before",
            compiles=True,
        )
    ]


def _numpy() -> Way:
    return Way(
        "NumPy closed form",
        lambda data: data[0].column().poses(np.broadcast_to(data[1], (len(data[0].crank), ANGLES)))[1],
        right,
        note="no iteration, no residual",
    )


def full_turn(suite: Suite) -> None:
    """Designs × 360 angles."""
    ways = [
        ours(
            "jaxnc",
            lambda s, u: nc.solve_position(s, {"phi": u}, throw=False),
            "jit(vmap(solve_position)): every angle a lane",
        ),
        ours("jaxnc: sweep", lambda s, u: nc.sweep(s, {"phi": u}), "jit(vmap(sweep)): in order along the branch"),
        *suite.peer("pylinkage", pylinkage, "pylinkage"),
        _numpy(),
    ]
    suite.compare("designs", ways, draw, suite.size(1000, 100), per=ANGLES)
