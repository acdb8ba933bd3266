"""Motions that are asked otherwise than by `Flow.answer`: with friction, independent accelerations, stabilisation."""

from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxnc.dynamics.flow import ACCELERATION, Answer, Flow
from jaxnc.dynamics.friction import has_friction, settled
from jaxnc.dynamics.model import forces
from jaxnc.dynamics.runge_kutta import Moving
from jaxnc.dynamics.saddle import saddle
from jaxnc.dynamics.written import Fast
from jaxnc.records import record, static
from jaxnc.solvers import dense
from jaxnc.system.equations import weights
from jaxnc.types import Array


@record
class Other:
    """A motion whose accelerations are found in another way."""

    flow: Flow  # the motion
    how: str = static()  # `"friction"`, `"null space"` or `"baumgarte"`
    rate: Any = 0.0  # of Baumgarte's terms, 1/s

    def impose(self, t: Any, q: Array, v: Array) -> tuple[Array, Array]:
        """As `Flow.impose`."""
        return self.flow.impose(t, q, v)

    def answer(self, what: Any, t: Any, q: Array, v: Array) -> Answer:
        """As `Flow.answer`."""
        if isinstance(what, int):
            return self._accelerations(t, q, v) if what == ACCELERATION else self.flow.answer(what, t, q, v)
        return lax.cond(
            what == ACCELERATION, lambda: self._accelerations(t, q, v), lambda: self.flow.answer(what, t, q, v)
        )

    def _accelerations(self, t: Any, q: Array, v: Array) -> Answer:
        if self.how == "null space":
            a = independent(self.flow, t, q, v)
            return Answer(a, self.flow.no_multipliers(), jnp.zeros(()), jnp.zeros(()))
        gains = (2.0 * self.rate, self.rate * self.rate) if self.how == "baumgarte" else None
        return settled(self.flow, t, q, v, gains)


def moving(flow: Flow, fast: Fast | None, method: str) -> Moving:
    """The motion that a method of Runge and Kutta integrates."""
    if method in ("null space", "baumgarte"):
        return Other(flow, method)
    if has_friction(flow.dyn):
        return Other(flow, "friction")
    return flow if fast is None else fast


def independent(flow: Flow, t: Array, q: Array, v: Array) -> Array:
    """Accelerations by the matrix R of García de Jalón and Serna: ``Rᵀ M R z̈ = Rᵀ (Q - M S γ)``.

    The admissible velocities are an orthonormal basis of what the rows leave free, made anew in every pose, so that no
    choice of independent coordinates can become singular.
    """
    view, dyn = flow.view, flow.dyn
    _, j, known, _, bent = flow.rows(q, v)
    _, _, a_known = flow.prescribed(t)
    weight = weights(dyn.eq)[view.unknown]
    a0 = jnp.zeros_like(q).at[view.known].set(a_known)
    g = -bent - known @ a_known
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
    x = particular + free @ dense.solver(reduced)(free @ right)
    return a0.at[u].set(x / weight)
