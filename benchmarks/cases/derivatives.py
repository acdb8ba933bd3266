"""Value, gradient and Hessian-vector product of an objective of very many poses."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxnc as nc
from benchmarks.cases.crank_rocker import BARS, Turn
from benchmarks.circles import RELATIVE
from benchmarks.clock import Way
from benchmarks.mechanisms import four_bar
from benchmarks.suite import Suite

_MARKER = (0.05, 0.07)  # where the coupler point is drawn
_TARGET = (0.06, 0.06)


def _objective(system: nc.System, phi: Any) -> Any:
    """Sum of squared distances of the coupler point from a target."""
    way = nc.solve_position(system, {"phi": phi}, throw=False)["E"] - jnp.array(_TARGET)
    return jnp.sum(way * way)


def _left(v: Any) -> Any:
    return jnp.stack([-v[..., 1], v[..., 0]], axis=-1)


def _closed_form(par: tuple[Any, Any], phi: Any) -> Any:
    """The same from the meeting of two circles; points in the order A, D, B, C, and the marker."""
    (a, d, b, c), e = par[0], par[1]
    base = c - b
    along, across = (e - b) @ base / (base @ base), (e - b) @ _left(base) / (base @ base)
    pin = a + jnp.sqrt((b - a) @ (b - a)) * jnp.stack([jnp.cos(phi), jnp.sin(phi)], axis=-1)
    way = d - pin
    square = jnp.sum(way * way, axis=-1)
    t = 0.5 * (square + base @ base - (c - d) @ (c - d)) / square
    h = float(BARS.side) * jnp.sqrt(base @ base / square - t * t)
    link = t[:, None] * way + h[:, None] * _left(way)
    off = pin + along * link + across * _left(link) - jnp.array(_TARGET)
    return jnp.sum(off * off)


def _near(found: Any, wanted: Any) -> float:
    """Fraction of numbers that agree, relative to the largest."""
    found, wanted = (np.concatenate([np.ravel(x) for x in jax.tree.leaves(t)]) for t in (found, wanted))
    return float(np.mean(np.abs(found - wanted) <= RELATIVE * np.abs(wanted).max()))


def of_coupler_point(suite: Suite) -> None:
    """Derivatives with respect to everything that was drawn."""
    mechanism = four_bar(BARS)
    mechanism.marker("E", on="coupler", at=_MARKER)
    system = mechanism.compile()
    par = (system.parameters.points, system.parameters.markers[0])
    rng = np.random.default_rng(5)
    direction = jax.tree.map(lambda x: jnp.asarray(rng.normal(size=x.shape)), system)
    along = (direction.parameters.points, direction.parameters.markers[0])

    def parts(s):
        return s.parameters.points, s.parameters.markers

    def product(f, x, v, phi):
        return jax.jvp(lambda x: jax.grad(f)(x, phi), (x,), (v,))[1]

    oracle = (
        jax.jit(lambda phi: _closed_form(par, phi)),
        jax.jit(lambda phi: jax.value_and_grad(_closed_form)(par, phi)),
        jax.jit(lambda phi: product(_closed_form, par, along, phi)),
    )
    value = jax.jit(_objective)
    gradient = jax.jit(jax.value_and_grad(_objective))
    hessian = jax.jit(lambda s, phi: product(_objective, s, direction, phi))

    def way(name, function, select, k, note):
        return Way(
            name,
            lambda phi: jax.block_until_ready(function(system, phi)),
            lambda out, data: _near(select(out), oracle[k](jnp.asarray(data.phi))),
            prepare=lambda data: jnp.asarray(data.phi),
            compiles=True,
            note=note,
        )

    ways = [
        way("jaxnc", value, lambda v: v, 0, "value: sum of squared distances of a coupler point from a target"),
        way("jaxnc: value and gradient", gradient, lambda o: (o[0], parts(o[1])), 1, "with respect to the drawing"),
        way("jaxnc: Hessian-vector product", hessian, parts, 2, "forward over reverse"),
    ]
    suite.compare("derivatives", ways, Turn.draw, suite.size(100_000, 10_000))
