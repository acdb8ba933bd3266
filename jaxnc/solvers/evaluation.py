"""Evaluation of a pose: residual, conditioning, orientation, and whether it is a mirror image."""

from typing import NamedTuple

import jax.numpy as jnp

from jaxnc.solvers.newton import largest
from jaxnc.solvers.plan import Plan
from jaxnc.system.equations import Equations, guards, residual
from jaxnc.types import Array, Coordinates


class Evaluation(NamedTuple):
    """What is known of a pose.

    Attributes:
        size: largest residual of all rows, a length.
        pivots: estimate of the reciprocal condition number.
        signs: orientation signs of the diagonal blocks.
        upright: whether no row is met by a mirror image.
        mirrored: whether a body has turned into its mirror image.
    """

    size: Array
    pivots: Array
    signs: Array
    upright: Array
    mirrored: Array


def upright(eq: Equations, q: Coordinates) -> Array:
    """Whether no row and no body is met by a mirror image."""
    rows, bodies = guards(eq, q)
    return jnp.all(rows > 0.0) & jnp.all(bodies > 0.0)


def evaluate(plan: Plan, eq: Equations, q: Coordinates) -> Evaluation:
    """Evaluate one pose: residual, conditioning, orientation and guards, all at once."""
    return with_jacobian(plan, eq, q)[0]


def with_jacobian(plan: Plan, eq: Equations, q: Coordinates) -> tuple[Evaluation, Array]:
    """The same, and the Jacobian of the plan there."""
    _, jacobian, _ = plan.linearise(eq, q)
    rows, bodies = guards(eq, q)
    found = Evaluation(
        largest(residual(eq, q)),
        plan.conditioning(eq, jacobian),
        plan.orientation(jacobian)[0],
        jnp.all(rows > 0.0) & jnp.all(bodies > 0.0),
        jnp.any(bodies <= 0.0),
    )
    return found, jacobian
