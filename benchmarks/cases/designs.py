"""Many designs at once: right on every lane up to the Grashof limit, and fast."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxnc as nc
from benchmarks import designs
from benchmarks.circles import FourBars, fraction
from benchmarks.clock import Way
from benchmarks.mechanisms import four_bars
from benchmarks.peers import naive
from benchmarks.suite import Suite

_ANGLES = 49
Data = tuple[FourBars, np.ndarray]


def _draw(seed: int, count: int) -> Data:
    """Designs, and for each of them angles up to half a turn either way from its drawing, ``(designs, angles)``."""
    bars = designs.any_kind(seed, count)
    steps = np.linspace(-np.pi, np.pi, _ANGLES + 2)[1:-1]
    return bars, bars.home[:, None] + steps


def _right(found: np.ndarray, data: Data, accepted: Any) -> float:
    """A lane behind a dead point is right if it is reported as failed."""
    bars, phi = data
    column = bars.column()
    wanted = np.where(column.reachable(phi)[..., None], column.poses(phi)[1], np.nan)
    size = np.max([bars.crank, bars.coupler, bars.rocker, bars.ground], axis=0)[:, None]
    return fraction(found, wanted, size, np.asarray(accepted))


def _ours() -> Way:
    solve = jax.jit(jax.vmap(lambda s, u: nc.solve_position(s, {"phi": u}, throw=False)))

    def run(prepared):
        mo = solve(*prepared)
        return jax.block_until_ready((mo["C"], mo.status))

    return Way(
        "jaxnc",
        run,
        lambda out, data: _right(np.asarray(out[0]), data, out[1] == 0),
        prepare=lambda data: (four_bars(data[0]), jnp.asarray(data[1])),
        compiles=True,
        note="jit(vmap(solve_position)) over designs, 49 angles each; lanes behind a dead point must fail",
    )


def _naive() -> list[Way]:
    def lane(par, home, side, phi):
        pin = par[0] * jnp.stack([jnp.cos(phi), jnp.sin(phi)])

        def residual(x):
            u, v = x - pin, x - jnp.array([1.0, 0.0]) * par[3]
            return jnp.stack([u @ u - par[1] ** 2, v @ v - par[2] ** 2])

        x, ok = naive.newton(residual, home, 1e-12 * par[3] ** 2)
        u, v = x - pin, x - jnp.array([1.0, 0.0]) * par[3]
        return x, ok & (side * (u[0] * v[1] - u[1] * v[0]) > 0)

    solve = jax.jit(jax.vmap(jax.vmap(lane, (None, None, None, 0))))

    def prepare(data):
        bars, phi = data
        par = np.stack([bars.crank, bars.coupler, bars.rocker, bars.ground], axis=1)
        return tuple(jnp.asarray(x) for x in (par, bars.poses(bars.home)[1], bars.side, phi))

    return [
        Way(
            "naive JAX, n = 2",
            lambda prepared: jax.block_until_ready(solve(*prepared)),
            lambda out, data: _right(np.asarray(out[0]), data, out[1]),
            prepare=prepare,
            compiles=True,
            note="one cold guess; side checked at the result, dead points on the way are not noticed",
        )
    ]


def _numpy() -> Way:
    return Way(
        "NumPy closed form",
        lambda data: (data[0].column().poses(data[1])[1], data[0].column().reachable(data[1])),
        lambda out, data: _right(out[0], data, out[1]),
        note="the yardstick itself",
    )


def every_kind(suite: Suite) -> None:
    """Random designs of every Grashof type, a third within one per cent of the limit."""
    ways = [_ours(), *suite.peer("naive JAX", _naive), _numpy()]
    suite.compare("designs-branch", ways, _draw, suite.size(1000, 200), per=_ANGLES)
