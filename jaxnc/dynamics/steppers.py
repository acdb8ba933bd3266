"""Integrators of fixed step: one step of each formulation, pure and differentiable."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import filter_jit
from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.friction import settled_forces
from jaxnc.dynamics.model import forces
from jaxnc.dynamics.saddle import saddle
from jaxnc.dynamics.written import RUNGE_KUTTA, Way, march_written
from jaxnc.solvers import linear
from jaxnc.status import Status
from jaxnc.system.equations import weights
from jaxnc.types import Array

_NEWTON = 3, 3
"""Factorisations in a step of the implicit formulations, and iterations with each; all are made, so that a step is
differentiable."""


class Carry(NamedTuple):
    """What goes from step to step: pose, rates, and what a formulation remembers."""

    q: Array
    v: Array
    memory: Any


Stepper = tuple[Callable[[Flow, Array, Array, Array], Carry], Callable[[Flow, Array, Array, Carry], Carry]]
"""How a formulation starts ``(flow, t, q, v) -> carry`` and steps ``(flow, t, h, carry) -> carry``."""


def _runge_kutta(rates: Callable, flow: Flow, t: Array, h: Array, q: Array, v: Array) -> tuple[Array, Array]:
    """Classical fourth order on (q, v); `rates` gives the accelerations. A loop, so that one stage is compiled."""

    def stage(state, at):
        (dq, dv), (sum_q, sum_v) = state
        reach, share = at[0] * h, at[1] * h
        at_q, at_v = flow.impose(t + reach, q + reach * dq, v + reach * dv)
        dq, dv = at_v, rates(t + reach, at_q, at_v)
        return ((dq, dv), (sum_q + share * dq, sum_v + share * dv)), None

    rest = jnp.zeros_like(q)
    (_, (q, v)), _ = jax.lax.scan(stage, ((rest, rest), (q, v)), RUNGE_KUTTA)
    return flow.impose(t + h, q, v)


def _plain_start(flow: Flow, t: Array, q: Array, v: Array) -> Carry:
    return Carry(q, v, ())


def _projected(flow: Flow, t: Array, h: Array, carry: Carry) -> Carry:
    """Index 1, fourth order, then position and velocity projected onto the constraints."""
    q, v = _runge_kutta(lambda t, q, v: settled_forces(flow, t, q, v)[0], flow, t, h, carry.q, carry.v)
    q = flow.project_position(q, 1)
    return Carry(q, flow.project_velocity(q, v), ())


def _baumgarte(flow: Flow, t: Array, h: Array, carry: Carry) -> Carry:
    """Index 1 stabilised by Baumgarte's terms, critically damped, as fast as the step allows."""
    rate: Any = 0.5 / h
    gains = (2.0 * rate, rate * rate)
    return Carry(
        *_runge_kutta(lambda t, q, v: settled_forces(flow, t, q, v, gains)[0], flow, t, h, carry.q, carry.v), ()
    )


def _null_space(flow: Flow, t: Array, h: Array, carry: Carry) -> Carry:
    """Independent accelerations by the matrix R of the admissible velocities, then projected."""
    q, v = _runge_kutta(lambda t, q, v: independent(flow, t, q, v), flow, t, h, carry.q, carry.v)
    q = flow.project_position(q, 1)
    return Carry(q, flow.project_velocity(q, v), ())


def independent(flow: Flow, t: Array, q: Array, v: Array) -> Array:
    """Accelerations by the matrix R of García de Jalón and Serna: ``Rᵀ M R z̈ = Rᵀ (Q - M S γ)``.

    The admissible velocities are an orthonormal basis of what the rows leave free, made anew in every pose, so that no
    choice of independent coordinates can become singular.
    """
    view, dyn = flow.view, flow.dyn
    j, known, _ = flow.velocity_rows(q)
    _, _, a_known = flow.prescribed(t)
    weight = weights(dyn.eq)[view.unknown]
    a0 = jnp.zeros_like(q).at[view.known].set(a_known)
    g = -flow.bias(q, v) - known @ a_known
    jw = j / weight
    # What is left of the identity when the rows are taken out, and the particular solution, both by one solve.
    solve = saddle(jnp.eye(len(weight)), jw, flow.redundant)
    particular, _ = solve(jnp.zeros(len(weight)), g)
    free = jax.vmap(lambda e: solve(e, jnp.zeros(len(g)))[0], out_axes=1)(jnp.eye(len(weight)))
    u = view.unknown
    mass = dyn.mass[u[:, None], u[None]] / (weight[:, None] * weight[None])
    right = (forces(dyn, t, q, v) - dyn.mass @ a0)[u] / weight - mass @ particular
    size = jnp.trace(mass)
    # R Rᵀ = `free` projects on the admissible velocities; on the rest the identity keeps the matrix regular.
    reduced = free @ mass @ free + size * (jnp.eye(len(weight)) - free)
    x = particular + free @ linear.solver(reduced)(free @ right)
    return a0.at[u].set(x / weight)


def _iterated(factorise: Callable, improve: Callable, start: Any) -> Any:
    """Newton's iterations, some with every factorisation: `factorise(state)` is what `improve(state, _)` takes."""

    def newton(state, _):
        solve = factorise(state)
        return jax.lax.scan(lambda state, _: (improve(state, solve), None), state, None, length=_NEWTON[1])

    return jax.lax.scan(newton, start, None, length=_NEWTON[0])[0]


# -- augmented Lagrangian, index 3 ---------------------------------------------------------------------------------


def _slopes(flow: Flow, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
    """Stiffness and damping of the forces with respect to the unknowns, ``-∂Q/∂q`` and ``-∂Q/∂v``."""
    u = flow.view.unknown

    def at(x, dx):
        return forces(flow.dyn, t, q.at[u].set(x), v.at[u].set(dx))[u]

    k, c = jax.jacfwd(at, argnums=(0, 1))(q[u], v[u])
    return -k, -c


def _inner(flow: Flow) -> Array:
    u = flow.view.unknown
    return flow.dyn.mass[u[:, None], u[None]]


def _augmented_start(flow: Flow, t: Array, q: Array, v: Array) -> Carry:
    a, multipliers = flow.accelerate(t, q, v)
    return Carry(q, v, (a, multipliers))


def _augmented(flow: Flow, t: Array, h: Array, carry: Carry) -> Carry:
    """Trapezoidal rule on positions with penalty and multipliers, then velocities and accelerations projected.

    Every Newton step takes the augmented Lagrangian to its limit in the proximal form of `jaxnc.dynamics.saddle`, whose
    penalty does not depend on the step, and whose multipliers stay finite where rows are or become redundant.

    Source: E. Bayo, R. Ledesma, Nonlinear Dynamics 9 (1996); J. Cuadrado et al., Multibody System Dynamics 4 (2000).
    """
    (q0, v0, (a0, multipliers)), view, u, t1 = carry, flow.view, flow.view.unknown, t + h
    mass, weight = _inner(flow), weights(flow.dyn.eq)[flow.view.unknown]
    size = jnp.max(jnp.diagonal(mass) / weight**2)
    q, _ = flow.impose(t1, q0 + h * v0 + 0.5 * h * h * a0, v0)

    def rates(q):
        v = 2.0 / h * (q - q0) - v0
        a = 4.0 / h**2 * (q - q0) - 4.0 / h * v0 - a0
        _, v = flow.impose(t1, q, v)
        return v, a

    def factorised(q, v, j):
        k, c = _slopes(flow, t1, q, v)
        tangent = (mass + 0.5 * h * c + 0.25 * h * h * k) / (weight[:, None] * weight[None] * size)
        return saddle(0.5 * (tangent + tangent.T), j / weight, flow.redundant)

    def improve(state, solve):
        q, lam = state
        v, a = rates(q)
        r, j, _ = view.linearise(flow.dyn.eq, q)
        f = (flow.dyn.mass @ a - forces(flow.dyn, t1, q, v))[u] + j.T @ lam
        x, y = solve(-f / (weight * size), -4.0 / h**2 * r)
        return view.move(q, 0.25 * h * h * x / weight), lam + y * size

    def factorise(state):
        q, _ = state
        return factorised(q, rates(q)[0], view.linearise(flow.dyn.eq, q)[1])

    q, lam = _iterated(factorise, improve, (q, multipliers))
    v, a = rates(q)
    _, j, known = view.linearise(flow.dyn.eq, q)
    _, du, ddu = flow.prescribed(t1)
    solve, nothing = factorised(q, v, j), jnp.zeros(len(weight))
    v = view.move(v, solve(nothing, -(j @ v[u] + known @ du))[0] / weight)
    a = jnp.zeros_like(a).at[view.known].set(ddu).at[u].set(a[u])
    a = view.move(a, solve(nothing, -(j @ a[u] + known @ ddu + flow.bias(q, v)))[0] / weight)
    return Carry(q, v, (a, lam))


# -- generalised alpha ---------------------------------------------------------------------------------------------

RADIUS = 0.7
"""Spectral radius at infinity of the generalised-α method: what is left of the stiffest motions after a step."""


def _alpha_start(flow: Flow, t: Array, q: Array, v: Array) -> Carry:
    a, multipliers = flow.accelerate(t, q, v)
    return Carry(q, v, (a, a, multipliers))


def _alpha(flow: Flow, t: Array, h: Array, carry: Carry) -> Carry:
    """Generalised-α on index 3, velocities projected.

    Source: J. Chung, G. Hulbert, J. Appl. Mech. 60 (1993); M. Arnold, O. Brüls, Multibody System Dynamics 18 (2007).
    """
    (q0, v0, (a0, real0, lam)), view, u, t1 = carry, flow.view, flow.view.unknown, t + h
    am, af = (2.0 * RADIUS - 1.0) / (RADIUS + 1.0), RADIUS / (RADIUS + 1.0)
    gamma = 0.5 + af - am
    beta = 0.25 * (gamma + 0.5) ** 2
    mass = _inner(flow)
    weight = weights(flow.dyn.eq)[u]
    size = jnp.max(jnp.diagonal(mass) / weight**2)

    def state(real):
        a = ((1.0 - af) * real + af * real0 - am * a0) / (1.0 - am)
        q = q0 + h * v0 + h * h * ((0.5 - beta) * a0 + beta * a)
        v = v0 + h * ((1.0 - gamma) * a0 + gamma * a)
        return (*flow.impose(t1, q, v), a)

    to_q = h * h * beta * (1.0 - af) / (1.0 - am)
    to_v = h * gamma * (1.0 - af) / (1.0 - am)

    def factorise(carried):
        q, v, _ = state(carried[0])
        _, j, _ = view.linearise(flow.dyn.eq, q)
        k, c = _slopes(flow, t1, q, v)
        tangent = (mass + to_v * c + to_q * k) / (weight[:, None] * weight[None] * size)
        return saddle(0.5 * (tangent + tangent.T), j / weight, flow.redundant)

    def improve(carried, solve):
        real, lam = carried
        q, v, _ = state(real)
        r, j, _ = view.linearise(flow.dyn.eq, q)
        f = (flow.dyn.mass @ real - forces(flow.dyn, t1, q, v))[u] + j.T @ lam
        # Rows are divided by h² where they meet accelerations, or the matrix would be badly scaled.
        x, y = solve(-f / (weight * size), -r / to_q)
        return real.at[u].add(x / weight), lam + y * size

    _, _, ddu = flow.prescribed(t1)
    real, lam = _iterated(factorise, improve, (real0.at[view.known].set(ddu), lam))
    q, v, a = state(real)
    return Carry(q, flow.project_velocity(q, v), (a, real, lam))


STEPPERS: dict[str, Stepper] = {
    "rk4": (_plain_start, _projected),
    "baumgarte": (_plain_start, _baumgarte),
    "null space": (_plain_start, _null_space),
    "augmented lagrangian": (_augmented_start, _augmented),
    "generalised alpha": (_alpha_start, _alpha),
}


@filter_jit
def march(way: Way, method: str, t: Array, q: Array, v: Array, steps: int) -> tuple[Array, Array, Array, Array]:
    """States at all times ``(T, N)`` from the first one, with as many equal steps between two times.

    Args:
        way: the motion.
        method: a key of `STEPPERS`.
        t: times, ``(T,)``.
        q: first pose.
        v: first rates.
        steps: steps between two times.

    Returns:
        Poses and rates, where it broke off those of the start; the status of each; the last time that was reached.
    """
    flow, fast = way
    if method == "rk4" and fast is not None:
        qs, vs = march_written(fast, t, q, v, steps)
    else:
        qs, vs = _march(flow, method, t, q, v, steps)
    ok = jnp.isfinite(qs).all(axis=1) & jnp.isfinite(vs).all(axis=1)
    ok = jnp.cumprod(ok.astype(int)) > 0
    qs, vs = (jnp.where(ok[:, None], x, x0[None]) for x, x0 in ((qs, q), (vs, v)))
    return qs, vs, jnp.where(ok, 0, int(Status.CAME_APART)), jnp.max(jnp.where(ok, t, t[0]))


def _march(flow: Flow, method: str, t: Array, q: Array, v: Array, steps: int) -> tuple[Array, Array]:
    start, step = STEPPERS[method]

    def interval(carry, ends):
        t0, t1 = ends
        h = (t1 - t0) / steps

        def one(carry, k):
            return step(flow, t0 + k * h, h, carry), None

        carry, _ = jax.lax.scan(one, carry, jnp.arange(steps, dtype=float))
        return carry, (carry.q, carry.v)

    _, (qs, vs) = jax.lax.scan(jax.checkpoint(interval), start(flow, t[0], q, v), (t[:-1], t[1:]))
    return jnp.concatenate([q[None], qs]), jnp.concatenate([v[None], vs])


def count(t: np.ndarray, step: float | None) -> int:
    """How many steps between two times keep every step no longer than wanted."""
    longest = float(np.max(np.abs(np.diff(t)), initial=0.0))
    return 1 if step is None or longest == 0.0 else max(1, int(np.ceil(longest / step * (1 - 1e-12))))
