"""The generalised-α method: implicit steps of fixed length on index 3, for stiff mechanisms."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.model import forces
from jaxnc.dynamics.saddle import saddle
from jaxnc.system.equations import weights
from jaxnc.types import Array

RADIUS = 0.7
"""Spectral radius at infinity: what is left of the stiffest motions after a step."""

_NEWTON = 3, 3
"""Factorisations in a step, and iterations with each; all are made, so that a step is differentiable."""


class AlphaState(NamedTuple):
    """A motion between two steps of the generalised-α method."""

    q: Array  # pose
    v: Array  # rates
    a: Array  # the method's own mean of accelerations
    real: Array  # accelerations that the forces and rows balance
    multipliers: Array  # of the plan's rows


def start_alpha(flow: Flow, t: Array, q: Array, v: Array) -> AlphaState:
    """Begin at a state that meets the constraints."""
    a, multipliers = flow.accelerate(t, q, v)
    return AlphaState(q, v, a, a, multipliers)


def alpha_step(flow: Flow, t: Array, h: Array, old: AlphaState) -> AlphaState:
    """Step by generalised-α on index 3, then project the velocities.

    Source: J. Chung, G. Hulbert, J. Appl. Mech. 60 (1993); M. Arnold, O. Brüls, Multibody System Dynamics 18 (2007).
    """
    view, u, t1 = flow.view, flow.view.unknown, t + h
    am, af = (2.0 * RADIUS - 1.0) / (RADIUS + 1.0), RADIUS / (RADIUS + 1.0)
    gamma = 0.5 + af - am
    beta = 0.25 * (gamma + 0.5) ** 2
    mass, weight = flow.dyn.mass[u[:, None], u[None]], weights(flow.dyn.eq)[u]
    size = jnp.max(jnp.diagonal(mass) / weight**2)

    def state(real: Array) -> tuple[Array, Array, Array]:
        a = ((1.0 - af) * real + af * old.real - am * old.a) / (1.0 - am)
        q = old.q + h * old.v + h * h * ((0.5 - beta) * old.a + beta * a)
        v = old.v + h * ((1.0 - gamma) * old.a + gamma * a)
        return (*flow.impose(t1, q, v), a)

    to_q = h * h * beta * (1.0 - af) / (1.0 - am)
    to_v = h * gamma * (1.0 - af) / (1.0 - am)

    def push(x: Array, dx: Array, q: Array, v: Array) -> Array:
        return forces(flow.dyn, t1, q.at[u].set(x), v.at[u].set(dx))[u]

    def iterate(carried, _):
        """Newton's iterations with one factorisation."""
        q, v, _ = state(carried[0])
        j = flow.rows(q, v).unknown
        k, c = jax.jacfwd(push, argnums=(0, 1))(q[u], v[u], q, v)
        tangent = (mass - to_v * c - to_q * k) / (weight[:, None] * weight[None] * size)
        solve = saddle(0.5 * (tangent + tangent.T), j / weight, flow.redundant)

        def improve(carried, _):
            real, lam = carried
            q, v, _ = state(real)
            r, j, *_ = flow.rows(q, v)
            f = (flow.dyn.mass @ real - forces(flow.dyn, t1, q, v))[u] + j.T @ lam
            # Rows are divided by h² where they meet accelerations, or the matrix would be badly scaled.
            x, y = solve(-f / (weight * size), -r / to_q)
            return (real.at[u].add(x / weight), lam + y * size), None

        return jax.lax.scan(improve, carried, None, length=_NEWTON[1])

    begin = old.real.at[view.known].set(flow.prescribed(t1)[2]), old.multipliers
    real, lam = jax.lax.scan(iterate, begin, None, length=_NEWTON[0])[0]
    q, v, a = state(real)
    return AlphaState(q, flow.project_velocity(q, v), a, real, lam)


def count(t: np.ndarray, step: float | None) -> int:
    """How many steps between two times keep every step no longer than wanted."""
    longest = float(np.max(np.abs(np.diff(t)), initial=0.0))
    return 1 if step is None or longest == 0.0 else max(1, int(np.ceil(longest / step * (1 - 1e-12))))
