"""Velocity, acceleration and jerk of all coordinates at solved poses.

Of a few poses by linear solves refined to the residual. Of many, where the kernel is written out, by its elimination:
it gives the velocity as a function of the pose and of the velocities of the inputs, and the higher rates are this
function differentiated along the motion.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp

from jaxnc.compiling import jit
from jaxnc.solvers.fill import LEAST
from jaxnc.solvers.kernel import fusion_barrier, kernel, opaque_true, writes_out
from jaxnc.solvers.newton import masked_pose
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.traced import in_chunks
from jaxnc.system.equations import Equations
from jaxnc.types import Array, Coordinates, Float

_FEW, _MANY = 64, 2048  # lanes at a time: of matrices, of written-out elements


def rates(plan: Plan, eq: Equations, q: Coordinates, known: Sequence[Array], ok: Array) -> list[Coordinates]:
    """Time derivatives of all coordinates at one pose; zero where it is not `ok`.

    The k-th derivative of Φ(q(t)) vanishes; what it contains besides Φ_q times the k-th derivative of q is formed by
    differentiating along the curve that the lower derivatives give.

    `known` are first, second, … time derivatives of the known coordinates, each ``(k,)``.
    """
    q = masked_pose(eq, q, ok)
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


def with_held(plan: Plan, orders: Sequence[Float[Array, "T driven"]]) -> tuple[Float[Array, "T k"], ...]:
    """Rates of all known coordinates from those of the driven ones: the held ones stand still."""
    return tuple(jnp.concatenate([o, jnp.zeros((o.shape[0], len(plan.held)))], axis=1) for o in orders)


def rates_in_lanes(
    plan: Plan, eq: Equations, q: Float[Array, "T N"], known: Sequence[Array], ok: Array
) -> tuple[Float[Array, "T N"], ...]:
    """The same as `rates`, of many poses."""
    if plan.square and writes_out(plan) and q.shape[0] >= LEAST:
        return in_chunks(functools.partial(_written_out, plan, eq), _MANY, q, tuple(known), ok)
    one = jax.vmap(lambda *lane: tuple(rates(plan, eq, *lane)))
    return in_chunks(one, _FEW, q, tuple(known), ok)


@functools.partial(jit, static_argnums=0)
def rates_of_batch(plan: Plan, eq: Equations, q: Array, known: Sequence[Array], ok: Array) -> tuple[Array, ...]:
    """`rates_in_lanes`, compiled by itself: for poses that were solved by something else."""
    return rates_in_lanes(plan, eq, q, known, ok)


def _written_out(plan: Plan, eq: Equations, q: Array, known: Sequence[Array], ok: Array) -> tuple[Array, ...]:
    core, lanes, go = kernel(plan), ok.shape, opaque_true(eq)
    q = jax.vmap(functools.partial(masked_pose, eq))(q, ok)
    x = tuple(q[:, c] for c in range(q.shape[1]))
    inputs = [tuple(jnp.where(ok, o[:, k], 0.0) for k in range(len(plan.known))) for o in known]

    def velocity(x, change):
        x_dot: list[Any] = [None] * len(x)
        for c, d in zip(plan.known, change, strict=True):
            x_dot[int(c)] = d
        found = core.tangent(eq, x, x_dot, ok=ok)
        return tuple(jnp.zeros(lanes) if d is None else jnp.broadcast_to(d, lanes) for d in found)

    found, rate = [], velocity
    for order in range(1, len(known) + 1):
        found.append(fusion_barrier(go, rate, x, *inputs[:order]))
        rate = functools.partial(_along_motion, velocity, rate)
    return tuple(jnp.stack(d, axis=1) for d in found)


def _along_motion(velocity: Callable, rate: Callable, x, *inputs):
    """The time derivative of a function of pose and rates of the inputs."""
    return jax.jvp(rate, (x, *inputs[:-1]), (velocity(x, inputs[0]), *inputs[1:]))[1]
