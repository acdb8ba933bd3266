"""Springs, dampers and stops: between two points, and on a coordinate (an angle, a distance)."""

import jax.numpy as jnp

from jaxnc.constraints.elementary import ratio
from jaxnc.constraints.kind import dot, norm
from jaxnc.forces.kind import ForceKind

_STIFFNESS = ("stiffness", "free", "preload", "cubic")


def _energy(x, c):
    # Force against lengthening: preload + stiffness x + cubic x³.
    return c[2] * x + 0.5 * c[0] * x * x + 0.25 * c[3] * x**4


def _speed(p, dp):
    d = p[1] - p[0]
    return ratio(dot(d, dp[1] - dp[0]), norm(d))


def _stop(x, c):
    low, high = jnp.minimum(x - c[1], 0.0), jnp.maximum(x - c[2], 0.0)
    return 0.5 * c[0] * (low * low + high * high)


def _stop_damping(x, dx, c):
    # Only inside the stop, and growing with its depth: the force has no jump where it is touched.
    depth = jnp.maximum(jnp.maximum(c[1] - x, x - c[2]), 0.0)
    return 0.5 * c[3] * depth * dx * dx


def _loss(x, c):
    return 0.5 * c[0] * x * x + c[1] * jnp.abs(x) ** 3 / 3.0


SPRING = ForceKind(
    "spring",
    _STIFFNESS,
    points=2,
    potential=lambda p, v, s, c: _energy(norm(p[1] - p[0]) - c[1], c),
    drawn=lambda p, v, s: (None, norm(p[1] - p[0]), 0.0, 0.0),
    positive=("stiffness", "free"),
)

DAMPER = ForceKind(
    "damper",
    ("damping", "quadratic"),
    points=2,
    dissipation=lambda p, v, s, dp, dv, ds, c: _loss(_speed(p, dp), c),
    drawn=lambda p, v, s: (None, 0.0),
    positive=("damping", "quadratic"),
)

STOP = ForceKind(
    "stop",
    ("stiffness", "lower", "upper", "damping"),
    points=2,
    potential=lambda p, v, s, c: _stop(norm(p[1] - p[0]), c),
    dissipation=lambda p, v, s, dp, dv, ds, c: _stop_damping(norm(p[1] - p[0]), _speed(p, dp), c),
    drawn=lambda p, v, s: (None, -1e30, 1e30, 0.0),
    positive=("stiffness", "damping"),
)

COORDINATE_SPRING = ForceKind(
    "coordinate spring",
    _STIFFNESS,
    scalars=1,
    potential=lambda p, v, s, c: _energy(s[0] - c[1], c),
    drawn=lambda p, v, s: (None, s[0], 0.0, 0.0),
    positive=("stiffness",),
)

COORDINATE_DAMPER = ForceKind(
    "coordinate damper",
    ("damping", "quadratic"),
    scalars=1,
    dissipation=lambda p, v, s, dp, dv, ds, c: _loss(ds[0], c),
    drawn=lambda p, v, s: (None, 0.0),
    positive=("damping", "quadratic"),
)

COORDINATE_STOP = ForceKind(
    "coordinate stop",
    ("stiffness", "lower", "upper", "damping"),
    scalars=1,
    potential=lambda p, v, s, c: _stop(s[0], c),
    dissipation=lambda p, v, s, dp, dv, ds, c: _stop_damping(s[0], ds[0], c),
    drawn=lambda p, v, s: (None, -1e30, 1e30, 0.0),
    positive=("stiffness", "damping"),
)
