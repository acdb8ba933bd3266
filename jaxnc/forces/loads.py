"""Constant loads: a force on a point, an effort on a coordinate, a couple on a body."""

import jax.numpy as jnp

from jaxnc.constraints.kind import dot
from jaxnc.forces.kind import ForceKind


def _on_point(t, p, v, s, dp, dv, ds, c):
    return c[None, :], jnp.zeros_like(v), jnp.zeros_like(s)


def _on_scalar(t, p, v, s, dp, dv, ds, c):
    return jnp.zeros_like(p), jnp.zeros_like(v), c[:1]


def _couple(t, p, v, s, dp, dv, ds, c):
    # Two opposite forces across the segment: their work on any motion of the body is the couple times its rotation.
    d = p[1] - p[0]
    push = c[0] / dot(d, d) * jnp.stack([-d[1], d[0]])
    return jnp.stack([-push, push]), jnp.zeros_like(v), jnp.zeros_like(s)


FORCE = ForceKind("force", ("x", "y"), points=1, force=_on_point, drawn=lambda p, v, s: (0.0, 0.0))
FORCE_IN_SPACE = ForceKind(
    "force in space", ("x", "y", "z"), points=1, force=_on_point, drawn=lambda p, v, s: (0.0, 0.0, 0.0)
)
EFFORT = ForceKind("effort", ("value",), scalars=1, force=_on_scalar)
COUPLE = ForceKind("couple", ("value",), points=2, force=_couple)
