"""Mechanisms beyond the four-bar: the generic one of figure 22 and the MacPherson suspension, beside naive JAX."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxnc as nc
from benchmarks import rolling_poses
from benchmarks.circles import RELATIVE
from benchmarks.clock import Way
from benchmarks.peers import naive
from benchmarks.strut_poses import POINTS, Strut
from benchmarks.suite import Suite

Inputs = dict[str, np.ndarray]


def _ways(
    suite: Suite,
    system: nc.System,
    driven: Sequence[str],
    hold: Sequence[str],
    names: Sequence[str],
    wanted: Callable[[Inputs], np.ndarray],
    size: float,
    seeds: Inputs | None,
) -> list[Way]:
    """This library and the naive way, both checked at the points `names` against independent poses."""
    top = system.topology
    columns = np.array([[top.position[f"{n}.{axis}"] for axis in "xyz"[: top.dim]] for n in names])
    last: list[Any] = [None, None]

    def right(q: Any, accepted: Any, data: Inputs) -> float:
        if last[0] is not data:
            last[:] = data, wanted(data)
        off = np.abs(np.asarray(q)[:, columns] - last[1]).max(axis=(1, 2))
        return float(np.mean((off <= RELATIVE * size) & np.asarray(accepted)))

    def run(inputs):
        return jax.block_until_ready(nc.solve_position(system, inputs, hold=hold, throw=False))

    ours = Way(
        "jaxnc",
        run,
        lambda mo, data: right(mo.q, mo.converged, data),
        prepare=lambda data: {k: jnp.asarray(v) for k, v in data.items()},
        compiles=True,
        note=f"n = {len(top.unknown)} coordinates, {len(top.rows)} rows",
    )

    def make() -> list[Way]:
        earlier = None if seeds is None else nc.solve_position(system, seeds, hold=hold, throw=False)
        solve = naive.of_system(system, driven, hold, earlier)
        start = "the drawing" if seeds is None else f"the nearest of {len(next(iter(seeds.values())))} earlier poses"
        return [
            Way(
                "naive JAX",
                lambda u: jax.block_until_ready(solve(u)),
                lambda out, data: right(out[0], out[1], data),
                prepare=naive.stacked,
                compiles=True,
                most=20_000,
                note=f"the same residual and unknowns; starts from {start}",
            )
        ]

    return [ours, *suite.peer("naive JAX", make)]


def generic(suite: Suite) -> None:
    """Figure 22, driven by the height of the crank pin."""
    system = nc.library.generic_mechanism().compile()
    seeds = {"P1.y": np.linspace(-0.9, 0.9, 65) * rolling_poses.CRANK}

    def truth(data: Inputs) -> np.ndarray:
        return rolling_poses.poses(data["P1.y"])

    ways = _ways(suite, system, ("P1.y",), (), ("P2", "P5", "P6"), truth, rolling_poses.BAR, seeds)

    def draw(seed: int, count: int) -> Inputs:
        return {"P1.y": np.linspace(-0.9 + 0.01 * (seed % 9), 0.9, count) * rolling_poses.CRANK}

    suite.compare("generic", ways, draw, suite.size(100_000, 10_000))


def macpherson(suite: Suite) -> None:
    """Figure 42 over bump and steer: more rows than unknowns."""
    system = nc.library.macpherson().compile()
    strut = Strut(system)
    centre, inner = strut.at["6"][2], strut.at["10"][1]

    def draw(seed: int, count: int) -> Inputs:
        u = np.random.default_rng([seed, 3]).uniform(-1.0, 1.0, (2, count))
        return {"6.z": centre + 70.0 * u[0], "10.y": inner + 30.0 * u[1]}

    def truth(data: Inputs) -> np.ndarray:
        return strut.poses(data["6.z"], data["10.y"])

    ways = _ways(suite, system, ("6.z", "10.y"), ("7.x",), POINTS, truth, 1000.0, None)
    suite.compare("macpherson", ways, draw, suite.size(100_000, 4_000))
