"""Following a branch of a large system pose by pose: lanes side by side would only cost memory."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxnc.solvers.adaptive import Continued, continued
from jaxnc.solvers.evaluation import Evaluation, evaluate
from jaxnc.solvers.newton import implicit, newton, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.system.equations import Equations
from jaxnc.types import Array, Coordinates, Float


class Followed(NamedTuple):
    """A branch followed through a sequence of input values.

    Attributes:
        poses: ``(T, N)``; those past the end repeat the last pose on the branch.
        reached: ``(T,)``, whether the pose is on the branch.
        limit: ``(T,)``, whether the branch ends there (a limit of travel that the input just touches).
        evaluated: of each pose, see `evaluate`.
        exhausted: whether it gave up on the way, which may go on.
    """

    poses: Array
    reached: Array
    limit: Array
    evaluated: Evaluation
    exhausted: Array


def follow_in_order(
    plan: Plan, eq: Equations, q: Coordinates, values: Float[Array, "T k"], other: Coordinates
) -> Followed:
    """Follow a branch through input values one after the other.

    Args:
        plan: what is solved for.
        eq: the equations.
        q: a pose that meets them, where continuation begins.
        values: known coordinates, pose by pose.
        other: where to begin if the first value is not reached from q (the same pose, an angle counted otherwise).
    """
    total = values.shape[0]

    def attempt(state):
        second, *_ = state
        return ~second, second, continued(plan, eq, jnp.where(second, other, q), values)

    def more(state):
        second, done, seen = state
        return ~done & (~second | ((seen.reached == 0) & ~seen.touched[0] & jnp.any(other != q)))

    no, none = jnp.zeros((), bool), jnp.zeros(total, bool)
    blank = Continued(jnp.zeros((total, q.shape[0])), jnp.zeros((), int), none, q, no, none)
    _, _, (poses, reached, touched, last, exhausted, between) = lax.while_loop(more, attempt, (no, no, blank))
    good = jnp.arange(total) < reached
    poses = jnp.where(good[:, None], poses, last)

    def finish(lane):
        pose, polish = lane
        # At a limit of travel Newton is slow and the input blind: the pose is the one that continuation came to.
        pose = lax.cond(polish, lambda x: newton(plan, eq, x, 6)[0], lambda x: x, pose)
        return pose, evaluate(plan, eq, pose), tolerance(eq, pose)

    poses, evaluated, accepted = lax.map(finish, (poses, good & ~touched & ~between))
    good = good & ((evaluated.size <= accepted) | touched)
    good = jnp.cumsum(~good) == 0  # a branch is followed in order: nothing after the first gap is on it
    return Followed(jnp.where(good[:, None], poses, last), good, touched & good, evaluated, exhausted)


# The rule lies outside the loop: a rule inside one loses its second derivatives in reverse.
@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def attach_in_order(plan: Plan, poses: Float[Array, "T N"], eq: Equations, known: Float[Array, "T k"]) -> Array:
    """Give poses their derivatives, one after the other; arguments as of `jaxnc.solvers.newton.attach`, with poses."""
    return poses


@attach_in_order.defjvp
def _attach_in_order_jvp(plan, primals, tangents):
    poses, eq, known = primals
    _, eq_dot, known_dot = tangents
    poses = attach_in_order(plan, poses, eq, known)
    return poses, lax.map(lambda lane: implicit(plan, lane[0], eq, lane[1], eq_dot, lane[2]), (poses, known, known_dot))
