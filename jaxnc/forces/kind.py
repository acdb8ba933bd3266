"""Kinds of forces: energy, dissipation or force of one instance, and a record of what it takes; the library's own."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp

from jaxnc.calls import public
from jaxnc.constraints.elementary import root, where
from jaxnc.constraints.kind import dot, norm
from jaxnc.pickling import Remade, register_by_name

_STIFFNESS = ("stiffness", "free", "preload", "cubic")


@public
@dataclass(frozen=True)
class ForceKind(Remade):
    """A kind of force as pure functions of one instance's own points, vectors, scalars and parameters.

    The functions get ``p`` of shape ``(points, dim)``, ``v`` ``(vectors, dim)``, ``s`` ``(scalars,)``, their rates
    ``dp, dv, ds``, parameters ``c`` ``(parameters,)`` and the time ``t``. What is given is added up; generalised forces
    of energies follow by differentiation, so that nothing is derived by hand.

    Args:
        name: unique name, used in reports, files and messages.
        parameters: names of its parameters; each becomes a design variable ``<force>.<parameter>``.
        points: how many points an instance takes.
        vectors: how many unit vectors.
        scalars: how many scalar coordinates (angles, distances, single coordinates of points).
        potential: ``(p, v, s, c) -> energy``, J.
        dissipation: ``(p, v, s, dp, dv, ds, c) -> R``, Rayleigh's function; the force is minus its derivative with
            respect to the rates, N.
        force: ``(t, p, v, s, dp, dv, ds, c) -> (fp, fv, fs)``: forces on what it takes, in the same shapes.
        drawn: ``(p, v, s) -> c``: parameters as the drawing has them (a spring's free length); they stand for what is
            not given. Those of which it says None must be given.
        positive: names of parameters that may not be negative.
    """

    noun = "kind of force"
    name: str
    parameters: tuple[str, ...] = ()
    points: int = 0
    vectors: int = 0
    scalars: int = 0
    potential: Callable | None = None
    dissipation: Callable | None = None
    force: Callable[..., Any] | None = None
    drawn: Callable[..., Any] | None = None
    positive: tuple[str, ...] = ()

    def __post_init__(self):
        if self.potential is None and self.dissipation is None and self.force is None:
            raise ValueError(f"force kind {self.name!r} has neither potential, dissipation nor force")


# -- springs, dampers and stops: between two points, and on a coordinate (an angle, a distance) -----------------------


def _energy(x, square, c):
    # Force against lengthening: preload + stiffness x + cubic x³.
    return c[2] * x + square * (0.5 * c[0] + 0.25 * c[3] * square)


def _stretch_energy(p, v, s, c):
    d, free = p[1] - p[0], c[1]
    square = dot(d, d)
    length = root(square)
    x = length - free
    # Of free length 0 the square is smooth where the points meet, but the length is not.
    return _energy(x, where(free == 0.0, square - free * (length + x), x * x), c)


def _speed_square(p, dp):
    # Points that meet part, with all of their speed. One quotient and no length of a rate: every step pays for it.
    d, rate = p[1] - p[0], dp[1] - dp[0]
    square, along = dot(d, d), dot(d, rate)
    apart = square > 0.0
    return where(apart, along * along, dot(rate, rate)) / where(apart, square, 1.0)


def _stretch_loss(p, v, s, dp, dv, ds, c):
    square = _speed_square(p, dp)
    return _loss(root(square), square, c)


def _stop(x, c):
    low, high = jnp.minimum(x - c[1], 0.0), jnp.maximum(x - c[2], 0.0)
    return 0.5 * c[0] * (low * low + high * high)


def _stop_damping(x, square, c):
    # Only inside the stop, and growing with its depth: the force has no jump where it is touched.
    depth = jnp.maximum(jnp.maximum(c[1] - x, x - c[2]), 0.0)
    return 0.5 * c[3] * depth * square


def _loss(speed, square, c):
    return square * (0.5 * c[0] + c[1] * speed / 3.0)


SPRING = ForceKind(
    "spring",
    _STIFFNESS,
    points=2,
    potential=_stretch_energy,
    drawn=lambda p, v, s: (None, norm(p[1] - p[0]), 0.0, 0.0),
    positive=("stiffness", "free"),
)

DAMPER = ForceKind(
    "damper",
    ("damping", "quadratic"),
    points=2,
    dissipation=_stretch_loss,
    drawn=lambda p, v, s: (None, 0.0),
    positive=("damping", "quadratic"),
)

STOP = ForceKind(
    "stop",
    ("stiffness", "lower", "upper", "damping"),
    points=2,
    potential=lambda p, v, s, c: _stop(norm(p[1] - p[0]), c),
    dissipation=lambda p, v, s, dp, dv, ds, c: _stop_damping(norm(p[1] - p[0]), _speed_square(p, dp), c),
    drawn=lambda p, v, s: (None, -1e30, 1e30, 0.0),
    positive=("stiffness", "damping"),
)

COORDINATE_SPRING = ForceKind(
    "coordinate spring",
    _STIFFNESS,
    scalars=1,
    potential=lambda p, v, s, c: _energy(s[0] - c[1], (s[0] - c[1]) * (s[0] - c[1]), c),
    drawn=lambda p, v, s: (None, s[0], 0.0, 0.0),
    positive=("stiffness",),
)

COORDINATE_DAMPER = ForceKind(
    "coordinate damper",
    ("damping", "quadratic"),
    scalars=1,
    dissipation=lambda p, v, s, dp, dv, ds, c: _loss(jnp.abs(ds[0]), ds[0] * ds[0], c),
    drawn=lambda p, v, s: (None, 0.0),
    positive=("damping", "quadratic"),
)

COORDINATE_STOP = ForceKind(
    "coordinate stop",
    ("stiffness", "lower", "upper", "damping"),
    scalars=1,
    potential=lambda p, v, s, c: _stop(s[0], c),
    dissipation=lambda p, v, s, dp, dv, ds, c: _stop_damping(s[0], ds[0] * ds[0], c),
    drawn=lambda p, v, s: (None, -1e30, 1e30, 0.0),
    positive=("stiffness", "damping"),
)


# -- constant loads: a force on a point, an effort on a coordinate, a couple on a body --------------------------------


def _on_point(t, p, v, s, dp, dv, ds, c):
    return c[None, :], jnp.zeros_like(v), jnp.zeros_like(s)


def _on_scalar(t, p, v, s, dp, dv, ds, c):
    return jnp.zeros_like(p), jnp.zeros_like(v), c[:1]


def _couple_forces(t, p, v, s, dp, dv, ds, c):
    # Two opposite forces across the segment: their work on any motion of the body is the couple times its rotation.
    d = p[1] - p[0]
    push = c[0] / dot(d, d) * jnp.stack([-d[1], d[0]])
    return jnp.stack([-push, push]), jnp.zeros_like(v), jnp.zeros_like(s)


FORCE = ForceKind("force", ("x", "y"), points=1, force=_on_point, drawn=lambda p, v, s: (0.0, 0.0))
FORCE_IN_SPACE = ForceKind(
    "force in space", ("x", "y", "z"), points=1, force=_on_point, drawn=lambda p, v, s: (0.0, 0.0, 0.0)
)
EFFORT = ForceKind("effort", ("value",), scalars=1, force=_on_scalar)
COUPLE = ForceKind("couple", ("value",), points=2, force=_couple_forces)

CATALOGUE: dict[str, ForceKind] = {
    kind.name: kind
    for kind in (
        SPRING,
        DAMPER,
        STOP,
        COORDINATE_SPRING,
        COORDINATE_DAMPER,
        COORDINATE_STOP,
        FORCE,
        FORCE_IN_SPACE,
        EFFORT,
        COUPLE,
    )
}
"""Every kind of force that the library knows, by name."""
register_by_name(__name__, CATALOGUE.values())
