"""Implicit integrators of fixed step: one step of each formulation, pure and differentiable."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.model import forces
from jaxnc.dynamics.saddle import saddle
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
        r, j, *_ = flow.rows(q, v)
        f = (flow.dyn.mass @ a - forces(flow.dyn, t1, q, v))[u] + j.T @ lam
        x, y = solve(-f / (weight * size), -4.0 / h**2 * r)
        return view.move(q, 0.25 * h * h * x / weight), lam + y * size

    def factorise(state):
        q, _ = state
        v = rates(q)[0]
        return factorised(q, v, flow.rows(q, v).unknown)

    q, lam = _iterated(factorise, improve, (q, multipliers))
    v, a = rates(q)
    _, j, known, *_ = flow.rows(q, v)
    _, du, ddu = flow.prescribed(t1)
    solve, nothing = factorised(q, v, j), jnp.zeros(len(weight))
    v = view.move(v, solve(nothing, -(j @ v[u] + known @ du))[0] / weight)
    a = jnp.zeros_like(a).at[view.known].set(ddu).at[u].set(a[u])
    a = view.move(a, solve(nothing, -(j @ a[u] + known @ ddu + flow.rows(q, v).bent))[0] / weight)
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
        j = flow.rows(q, v).unknown
        k, c = _slopes(flow, t1, q, v)
        tangent = (mass + to_v * c + to_q * k) / (weight[:, None] * weight[None] * size)
        return saddle(0.5 * (tangent + tangent.T), j / weight, flow.redundant)

    def improve(carried, solve):
        real, lam = carried
        q, v, _ = state(real)
        r, j, *_ = flow.rows(q, v)
        f = (flow.dyn.mass @ real - forces(flow.dyn, t1, q, v))[u] + j.T @ lam
        # Rows are divided by h² where they meet accelerations, or the matrix would be badly scaled.
        x, y = solve(-f / (weight * size), -r / to_q)
        return real.at[u].add(x / weight), lam + y * size

    _, _, ddu = flow.prescribed(t1)
    real, lam = _iterated(factorise, improve, (real0.at[view.known].set(ddu), lam))
    q, v, a = state(real)
    return Carry(q, flow.project_velocity(q, v), (a, real, lam))


STEPPERS: dict[str, Stepper] = {
    "augmented lagrangian": (_augmented_start, _augmented),
    "generalised alpha": (_alpha_start, _alpha),
}


def count(t: np.ndarray, step: float | None) -> int:
    """How many steps between two times keep every step no longer than wanted."""
    longest = float(np.max(np.abs(np.diff(t)), initial=0.0))
    return 1 if step is None or longest == 0.0 else max(1, int(np.ceil(longest / step * (1 - 1e-12))))
