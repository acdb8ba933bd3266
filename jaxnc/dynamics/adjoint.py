"""What a change of an answer means for the motion and the state: the implicit function theorem, in reverse.

An answer (accelerations, or what brings a pose or its rates back onto the constraints) solves ``M c + Jᵀ λ = f,
J c = g``. What it changes by is found by the same matrix, and the rest is the derivative of one number, Lagrange's, in
which the answer and its adjoint stand as constants. It is written as a sum over the constraints, each with its own
coordinates, so that no matrix is put together for it.
"""

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxnc.dynamics.flow import ACCELERATION, POSITION, VELOCITY, Answer, Flow
from jaxnc.dynamics.model import forces
from jaxnc.dynamics.rows import Weights, weighed
from jaxnc.dynamics.saddle import saddle
from jaxnc.records import record
from jaxnc.system.equations import coefficients, slips
from jaxnc.types import Array


class Law(NamedTuple):
    """The numbers of a motion that its accelerations depend on."""

    constants: tuple[Any, ...]
    linear: tuple[Any, ...]
    quadratic: tuple[Any, ...]
    mass: Any
    moments: Any
    gravity: Any
    forces: tuple[Any, ...]
    own: tuple[Any, ...]
    rates: tuple[Any, ...]
    more: tuple[tuple[Any, ...], ...]

    @classmethod
    def of(cls, flow: Flow) -> "Law":
        """Those of a motion."""
        dyn, eq = flow.dyn, flow.dyn.eq
        return cls(
            eq.constants, eq.linear, eq.quadratic, dyn.mass, dyn.moments, dyn.gravity, dyn.constants, dyn.own,
            dyn.rates, flow.more,
        )  # fmt: skip

    def put(self, flow: Flow) -> Flow:
        """The motion with these."""
        eq = dataclasses.replace(flow.dyn.eq, constants=self.constants, linear=self.linear, quadratic=self.quadratic)
        dyn = dataclasses.replace(
            flow.dyn, eq=eq, mass=self.mass, moments=self.moments, gravity=self.gravity, constants=self.forces,
            own=self.own, rates=self.rates,
        )  # fmt: skip
        return dataclasses.replace(flow, dyn=dyn, more=self.more)


@record
class Recalled:
    """A motion whose answers are at hand, and only get their derivatives."""

    flow: Flow  # the motion, `prepared`
    law: Law  # its numbers, by which it is differentiated

    def impose(self, t: Any, q: Array, v: Array) -> tuple[Array, Array]:
        """As `Flow.impose`."""
        return dataclasses.replace(self.flow, more=self.law.more).impose(t, q, v)

    def answer(self, what: Any, t: Any, q: Array, v: Array, found: Answer) -> Answer:
        """As `Flow.answer`, where the answer has been found before."""
        return _recalled(self.flow, self.law, what, t, q, v, found)


@jax.custom_vjp
def _recalled(flow: Flow, law: Law, what: Array, t: Array, q: Array, v: Array, found: Answer) -> Answer:
    return found


def _forward(flow, law, what, t, q, v, found):
    return found, (flow, law, what, t, q, v, found)


def _backward(kept: tuple, change: Answer) -> tuple:
    flow, law, what, t, q, v, found = kept
    top, view, u = flow.dyn.topology, flow.view, flow.view.unknown
    accelerating, placing, moving = (jnp.where(what == k, 1.0, 0.0) for k in (ACCELERATION, POSITION, VELOCITY))
    rows, (weight, size, inner) = flow.rows(q, v), flow.scaled()
    count = len(view.rows)
    here, behind = slice(0, count), slice(count, None)  # rows on positions, and on velocities alone
    j = rows.unknown.at[behind].multiply(1.0 - placing) if top.rates else rows.unknown
    a, b = saddle(inner, j / weight, flow.redundant)(change.change[u] / weight, change.multipliers * size)
    push = jnp.zeros_like(q).at[u].set(a / (weight * size))
    # What is driven moves the others too: its accelerations stand in both equations.
    driven = accelerating * (change.change - law.mass @ push)[view.known] - accelerating * (rows.known.T @ b)
    speeds = _peak(rows.slip) * change.slip - moving * b
    lam = found.multipliers
    each = Weights(
        _peak(rows.values) * change.gap - placing * b[here], speeds[here], -accelerating * b[here],
        -b[here], found.change, -push, lam[here],
    )  # fmt: skip

    def lagrangian(law: Law, t: Array, q: Array, v: Array) -> Array:
        now = law.put(flow)
        dyn, still = now.dyn, v.at[view.fixed].set(0.0)
        total = push @ (accelerating * forces(dyn, t, q, v) - law.mass @ found.change)
        total = total + weighed(view, dyn.eq, q, still, each)
        if flow.drives:
            total = total + driven @ now.prescribed(t)[2]
        if top.rates:
            rest, bent = jax.jvp(lambda x: slips(top, law.rates, x, v), (q,), (v,))
            matrix = coefficients(top, law.rates, q)
            both = lam[behind] @ (matrix @ push) + b[behind] @ (matrix @ found.change)
            total = total + speeds[behind] @ rest - accelerating * b[behind] @ bent - (1.0 - placing) * both
        return total

    of_law, *of_state = jax.grad(lagrangian, (0, 1, 2, 3))(law, t, q, v)
    return None, of_law, None, *of_state, None


def _peak(r: Array) -> Array:
    """The derivative of the largest magnitude; JAX's is no number where a maximum is calculated twice, not alike."""
    if not r.shape[0]:
        return r
    return jnp.where(jnp.arange(r.shape[0]) == jnp.argmax(jnp.abs(r)), jnp.sign(r), 0.0)


_recalled.defvjp(_forward, _backward)
