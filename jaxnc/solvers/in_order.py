"""Following a branch of a large system pose by pose: lanes side by side would only cost memory."""

import jax.numpy as jnp
from jax import lax

from jaxnc.solvers.continuation import Followed, inspect, walk
from jaxnc.solvers.newton import newton, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.system.equations import Equations
from jaxnc.types import Array, Coordinates, Float


def follow_in_order(
    plan: Plan, eq: Equations, q: Coordinates, values: Float[Array, "T k"], other: Coordinates
) -> Followed:
    """Follow a branch from a pose through a sequence of input values, one after the other.

    Args:
        plan: what is solved for.
        eq: the equations.
        q: a pose that meets them, where the walk begins.
        values: known coordinates, pose by pose.
        other: where to begin if the first value is not reached from q (the same pose, an angle counted otherwise).

    Returns:
        The poses and which of them are on the branch; those past the end repeat the last one.
    """
    total = values.shape[0]

    def attempt(state):
        second, *_ = state
        seen = walk(plan, eq, jnp.where(second, other, q), values, jnp.ones((), int))
        return ~second, second, seen.poses, seen.reached, seen.touched, seen.last, seen.part, seen.exhausted

    def more(state):
        second, done, _, reached, touched, *_ = state
        return ~done & (~second | ((reached == 0) & ~touched[0] & jnp.any(other != q)))

    no, zero = jnp.zeros((), bool), jnp.zeros(())
    blank = (no, no, jnp.zeros((total, q.shape[0])), jnp.zeros((), int), jnp.zeros(total, bool), q, zero, no)
    _, _, poses, reached, touched, last, part, exhausted = lax.while_loop(more, attempt, blank)
    good = jnp.arange(total) < reached
    poses = jnp.where(good[:, None], poses, last)

    def finish(lane):
        pose, polish = lane
        # At a limit of travel Newton is slow and the input blind: the pose is the one that the walk came to.
        pose = lax.cond(polish, lambda x: newton(plan, eq, x, 6)[0], lambda x: x, pose)
        return pose, inspect(plan, eq, pose), tolerance(eq, pose)

    poses, looks, accepted = lax.map(finish, (poses, good & ~touched))
    good = good & ((looks.size <= accepted) | touched)
    good = jnp.cumsum(~good) == 0  # a branch is followed in order: nothing after the first gap is on it
    return Followed(jnp.where(good[:, None], poses, last), good, touched & good, looks, part, exhausted)
