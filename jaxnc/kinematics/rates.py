"""Velocity, acceleration and jerk of all coordinates at solved poses, by linear solves refined to the residual."""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp

from jaxnc.solvers.newton import regular
from jaxnc.solvers.plan import Plan
from jaxnc.system.equations import Equations
from jaxnc.types import Array, Coordinates


def rates(plan: Plan, eq: Equations, q: Coordinates, known: Sequence[Array], ok: Array) -> list[Coordinates]:
    """Time derivatives of all coordinates at one pose.

    The k-th derivative of Φ(q(t)) vanishes; what it contains besides Φ_q times the k-th derivative of q is formed by
    differentiating along the curve that the lower derivatives give.

    Args:
        plan: what was solved for.
        eq: the equations.
        q: a solved pose (differentiable).
        known: first, second, … time derivatives of the known coordinates, each ``(k,)``.
        ok: whether the pose is a solution and not singular.

    Returns:
        As many time derivatives of all coordinates; zero where the pose is not `ok`.
    """
    q = regular(eq, q, ok)
    _, jacobian, _ = plan.linearise(eq, q)
    solve = plan.solver(jacobian, ok)
    still, nothing = jnp.zeros(len(plan.fixed)), jnp.zeros(len(plan.unknown))
    found: list[Coordinates] = []
    for order, known_rate in enumerate(known, start=1):
        terms = [*found, plan.join(nothing, known_rate, still)]

        def along(t, terms=terms):
            x, factor = q, jnp.ones(())
            for k, term in enumerate(terms, start=1):
                factor = factor * t / k
                x = x + factor * term
            return plan.residual(eq, x)

        curve: Callable[[Array], Array] = along
        for _ in range(order):
            curve = _derivative(curve)
        b = jnp.where(ok, curve(jnp.zeros(())), 0.0)
        found.append(plan.join(-solve(b), jnp.where(ok, known_rate, 0.0), still))
    return found


def _derivative(f):
    return lambda t: jax.jvp(f, (t,), (jnp.ones_like(t),))[1]
