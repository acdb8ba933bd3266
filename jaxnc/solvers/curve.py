"""A motion of one freedom as a curve: steps of arc length, and the points where a coordinate turns back.

Nothing is driven here, so that dead points of an input are ordinary points of the curve. Along the curve the tangent t
solves ``[Φ_q; tᵀ] t = (0, 1)``; a coordinate turns back where its component of t vanishes, and that point is found by
Newton on Φ = 0 together with this component (a bordered system), not by bisection.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.compiling import jit
from jaxnc.solvers import dense, linear
from jaxnc.solvers.newton import largest
from jaxnc.solvers.plan import Plan
from jaxnc.system.equations import Equations, weights
from jaxnc.types import Array, Coordinates


def _bordered(plan: Plan, eq: Equations, q: Array, along: Array) -> Array:
    """Jacobian with respect to weighted unknowns, bordered by a direction."""
    _, jacobian, _ = plan.linearise(eq, q)
    w = weights(eq)[plan.unknown]
    return jnp.concatenate([jacobian / w, along[None]])


def _tangent(plan: Plan, eq: Equations, q: Array, along: Array) -> Array:
    """Unit tangent in weighted unknowns on the side of `along`."""
    matrix = _bordered(plan, eq, q, along)
    t = linear.solver(matrix)(jnp.zeros(matrix.shape[0]).at[-1].set(1.0))
    return t / jnp.sqrt(jnp.sum(t * t))


@functools.partial(jit, static_argnums=0)
def first_tangent(plan: Plan, eq: Equations, q: Coordinates) -> Array:
    """A unit tangent of the curve at a pose (the right singular vector of the smallest singular value)."""
    _, jacobian, _ = plan.linearise(eq, q)
    return dense.null_direction(jacobian / weights(eq)[plan.unknown])


@functools.partial(jit, static_argnums=0)
def correct(plan: Plan, eq: Equations, q: Coordinates, t: Array, h: Array) -> tuple[Coordinates, Array, Array, Array]:
    """One step of arc length: predict along the tangent, correct across it.

    Args:
        plan: plan with nothing driven (one freedom left).
        eq: the equations.
        q: pose on the curve.
        t: its unit tangent in weighted unknowns.
        h: step, a length.

    Returns:
        New pose, its tangent, its largest residual, and the size of the correction.
    """
    w = weights(eq)[plan.unknown]
    guess = plan.move(q, h * t / w)

    def improve(state):
        i, x, _ = state
        r = plan.residual(eq, x)
        matrix = _bordered(plan, eq, x, t)
        dx = linear.steps(matrix, jnp.append(r, 0.0)[:, None])[:, 0]
        dx = jnp.where(jnp.all(jnp.isfinite(dx)), dx, 0.0)
        x = plan.move(x, -dx / w)
        return i + 1, x, largest(plan.residual(eq, x))

    _, x, r = lax.while_loop(
        lambda s: (s[0] < 8) & (s[2] > 1e-15 * eq.length), improve, (0, guess, jnp.asarray(jnp.inf))
    )
    moved = jnp.sqrt(jnp.sum((w * (x - guess)[plan.unknown]) ** 2))
    return x, _tangent(plan, eq, x, t), r, moved


@functools.partial(jit, static_argnums=(0, 1))
def turning_point(plan: Plan, coordinate: int, eq: Equations, q: Coordinates, t: Array) -> tuple[Coordinates, Array]:
    """Where a coordinate turns back, from a pose nearby: Newton on Φ = 0 and tangent component = 0.

    Args:
        plan: plan with nothing driven.
        coordinate: index of the coordinate (static).
        eq: the equations.
        q: pose on the curve near the turning point.
        t: tangent there.

    Returns:
        The pose and what is left of the equations (residual, a length; tangent component).
    """
    place = int(np.flatnonzero(plan.unknown == coordinate)[0])
    w = weights(eq)[plan.unknown]

    def rows(x):
        return jnp.append(plan.residual(eq, x), eq.length * _tangent(plan, eq, x, t)[place])

    def improve(_, x):
        r = rows(x)
        matrix = jax.jacfwd(lambda y: rows(plan.move(x, y / w)))(jnp.zeros(len(w)))
        dx = linear.steps(matrix, r[:, None])[:, 0]
        return plan.move(x, -jnp.where(jnp.all(jnp.isfinite(dx)), dx, 0.0) / w)

    x = lax.fori_loop(0, 10, improve, q)
    return x, largest(rows(x))
