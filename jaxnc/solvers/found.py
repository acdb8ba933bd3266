"""What an analysis has found, coordinate by coordinate: most of a large batch's coordinates are never looked at."""

from typing import NamedTuple

import jax.numpy as jnp

from jaxnc.solvers.follow import Followed
from jaxnc.solvers.look import Look
from jaxnc.solvers.plan import Plan
from jaxnc.types import Array


class Found(NamedTuple):
    """Poses of sequences of input values; leading axes are those of the sequences.

    Attributes:
        x: unknown coordinates, each ``(..., T)``.
        known: known coordinates; where a pose was not found, those of the last one on the branch.
        reached: whether the pose is on the branch.
        limit: whether the branch ends there.
        size: largest residual.
        pivots: estimate of the reciprocal condition number.
        mirrored: whether a body has turned into its mirror image.
        exhausted: ``(...,)``, whether a walk gave up on the way, which may go on.
    """

    x: tuple[Array, ...]
    known: tuple[Array, ...]
    reached: Array
    limit: Array
    size: Array
    pivots: Array
    mirrored: Array
    exhausted: Array


def taken_apart(plan: Plan, out: Followed) -> Found:
    """Whole poses ``(..., T, N)`` coordinate by coordinate."""
    x, known = (tuple(out.poses[..., int(c)] for c in which) for which in (plan.unknown, plan.known))
    look = out.looks
    return Found(x, known, out.reached, out.limit, look.size, look.pivots, look.mirrored, out.exhausted)


def put_together(plan: Plan, q: Array, found: Found) -> Followed:
    """The way back; `q` has the fixed coordinates, ``(..., N)``."""
    columns = dict(zip((*plan.unknown.tolist(), *plan.known.tolist()), (*found.x, *found.known), strict=True))
    shape = found.reached.shape
    whole = [columns.get(c, jnp.broadcast_to(q[..., c, None], shape)) for c in range(q.shape[-1])]
    look = Look(found.size, found.pivots, jnp.zeros((*shape, 0)), found.reached, found.mirrored)
    nothing = jnp.zeros(found.exhausted.shape)
    return Followed(jnp.stack(whole, axis=-1), found.reached, found.limit, look, nothing, found.exhausted)
