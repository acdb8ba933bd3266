"""What became of poses: their known coordinates, and a status for each from what the solvers say of them."""

from collections.abc import Callable

import jax.numpy as jnp

from jaxnc.solvers.evaluation import Evaluation
from jaxnc.solvers.in_order import Followed
from jaxnc.solvers.plan import Plan
from jaxnc.status import Status
from jaxnc.system.equations import Equations, guards
from jaxnc.system.precision import limits
from jaxnc.types import Array


def known_values(view: Plan, q0: Array, values: Array) -> Array:
    """Driven and held coordinates of every pose, ``(T, k)``."""
    held = q0[..., view.known[len(view.driven) :]]
    return jnp.concatenate([values, jnp.broadcast_to(held, (values.shape[0], len(view.held)))], axis=1)


def lost_in_order(found: Followed, assembled: Array) -> Array:
    """What a pose of a sequence has if it is not on the branch: the first one why it ended, the others nothing."""
    good = found.reached
    stopped_before = jnp.concatenate([jnp.zeros(1, bool), found.limit[:-1]])  # the last pose met its limit exactly
    first_gap = (jnp.arange(len(good)) == jnp.argmin(good)) & ~good & ~stopped_before
    stopped = jnp.where(found.exhausted, int(Status.TOO_FAR), int(Status.SINGULAR))
    lost = jnp.where(first_gap, stopped, int(Status.NOT_REACHED))
    return jnp.where(assembled, lost, int(Status.DID_NOT_ASSEMBLE))


def outcome(
    view: Plan,
    method: str,
    eq: Equations,
    begin: Array,
    good: Array,
    limit: Array,
    evaluated: Evaluation,
    lost: Array,
    fits: Callable[[], Array],
) -> Array:
    """Statuses.

    Args:
        view: what was solved for.
        method: how, see `jaxnc.kinematics.analysis.analyse`.
        eq: the equations.
        begin: start pose.
        good: which poses are right.
        limit: which of them are limits of travel.
        evaluated: what is known of them.
        lost: status of those that are not right.
        fits: which of them meet all rows.

    Returns:
        `jaxnc.Status` of each pose as an integer.
    """
    status = jnp.where(good, int(Status.CONVERGED), lost)
    singular = limit | ((status == 0) & (evaluated.pivots <= limits(begin).singular))
    status = jnp.where(singular, int(Status.SINGULAR), status)
    mirrored = jnp.zeros(status.shape, bool)
    if any(block.kind.mirror for block in view.topology.blocks):
        mirrored = (status != 0) & fits() & evaluated.mirrored
    if method != "guess":
        mirrored = mirrored | jnp.any(guards(eq, begin)[1] <= 0.0)
    status = jnp.where(mirrored, int(Status.MIRRORED), status)
    return jnp.where(eq.misfit > limits(begin).misfit, int(Status.LEFT_CLASS), status)
