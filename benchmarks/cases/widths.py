"""32-bit numbers beside 64-bit ones."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxnc as nc
from benchmarks.cases.crank_rocker import BARS, Turn
from benchmarks.circles import fraction
from benchmarks.clock import Way
from benchmarks.mechanisms import four_bar
from benchmarks.strut_poses import POINTS, Strut
from benchmarks.suite import Suite

_SINGLE = 1e-5  # of the size: right, of a pose of 32-bit numbers
_EXTENT = 1000.0  # millimetres: size of the suspension


def _way(name: str, note: str, system: nc.System, right: Callable, **options: Any) -> Way:
    def prepare(inputs: dict[str, np.ndarray]) -> dict[str, jax.Array]:
        return {k: jnp.asarray(v, system.dtype) for k, v in inputs.items()}

    return Way(
        name,
        lambda inputs: jax.block_until_ready(nc.solve_position(system, inputs, throw=False, **options)),
        right,
        prepare=prepare,
        compiles=True,
        note=note,
    )


def _both(system: nc.System, right: Callable[[float], Callable], **options: Any) -> list[Way]:
    return [
        _way("jaxnc", "64 bits", system, right(1e-9), **options),
        _way("jaxnc: float32", "right to 1e-5 of the size", system.astype("float32"), right(_SINGLE), **options),
    ]


def of_four_bar(suite: Suite) -> None:
    """The crank-rocker over a full turn."""

    def right(part: float) -> Callable:
        def check(mo: nc.Motion, data: dict[str, np.ndarray]) -> float:
            wanted = BARS.poses(data["phi"])[1]
            return fraction(np.asarray(mo["C"]), wanted, float(BARS.ground), np.asarray(mo.converged), part)

        return check

    def draw(seed: int, count: int) -> dict[str, np.ndarray]:
        return {"phi": Turn.draw(seed, count).phi}

    ways = _both(four_bar(BARS).compile(), right)
    suite.compare("widths four-bar", ways, draw, suite.size(1_000_000, 100_000))


def of_macpherson(suite: Suite) -> None:
    """The suspension over bump and steer."""
    system = nc.library.macpherson().compile()
    strut = Strut(system)
    centre, inner = strut.at["6"][2], strut.at["10"][1]

    def right(part: float) -> Callable:
        def check(mo: nc.Motion, data: dict[str, np.ndarray]) -> float:
            wanted = strut.poses(data["6.z"], data["10.y"])
            found = np.stack([np.asarray(mo[name]) for name in POINTS], axis=1)
            off = np.abs(found - wanted).max(axis=(1, 2))
            return float(np.mean((off <= part * _EXTENT) & np.asarray(mo.converged)))

        return check

    def draw(seed: int, count: int) -> dict[str, np.ndarray]:
        u = np.random.default_rng([seed, 3]).uniform(-1.0, 1.0, (2, count))
        return {"6.z": centre + 70.0 * u[0], "10.y": inner + 30.0 * u[1]}

    suite.compare("widths MacPherson", _both(system, right, hold=("7.x",)), draw, suite.size(100_000, 4_000))
