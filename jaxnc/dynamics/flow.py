"""Motion under forces: accelerations, and the projections that keep positions and velocities on the constraints."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.dynamics.model import Dynamics, forces
from jaxnc.dynamics.rows import evaluate
from jaxnc.dynamics.saddle import saddle
from jaxnc.errors import InputError, nearest
from jaxnc.records import record, static
from jaxnc.remembered import with_owner
from jaxnc.solvers.newton import largest
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.equations import coefficients, slips, weights
from jaxnc.system.topology import Topology
from jaxnc.types import Array, Coordinates

Drive = tuple[str, Callable]
"""A coordinate that follows a function of time."""

ACCELERATION, POSITION, VELOCITY = range(3)
"""What a motion can be asked for, see `Flow.answer`."""


class Rows(NamedTuple):
    """Constraints of a motion in a state."""

    values: Array  # what the plan's rows are off by, lengths (rows,)
    unknown: Array  # derivatives by the unknown coordinates, those of rows on velocities behind them, (m, unknowns)
    known: Array  # by the driven ones, (m, driven)
    slip: Array  # what the rates of all rows are off by, (m,)
    bent: Array  # how they accelerate without accelerations of the coordinates, d²Φ/dt² - Φ_q q̈, (m,)


class Answer(NamedTuple):
    """What a motion says of a state."""

    change: Any  # the accelerations, or by how much the coordinates or rates change, (N,)
    multipliers: Any  # those of the rows that are solved with, (m,)
    gap: Array  # largest residual of the rows in the state, a length
    slip: Array  # the largest of their rates


def pick(what: Any, *options: Callable[[], Any]) -> Any:
    """One of several values, pytrees: only that is calculated, where it is known which."""
    if isinstance(what, int):
        return options[what]()
    return jax.tree.map(
        lambda *values: jax.lax.select_n(what, *(jnp.asarray(x, float) for x in values)), *(f() for f in options)
    )


@with_owner
def free_view(topology: Topology, driven: tuple[str, ...]) -> Plan:
    """The plan of a motion: what is neither fixed nor driven is solved for."""
    if topology.large:
        raise InputError(
            f"{topology.name!r} has {len(topology.unknown)} unknowns and is kept sparse; dynamics works with dense "
            f"matrices: compile(sparse=False)"
        )
    for name in driven:
        if name not in topology.position:
            raise InputError(f"{topology.name!r} has no coordinate {name!r} to drive; "
                             f"{nearest(name, topology.coordinates)}")  # fmt: skip
    return plan(topology, driven)


@record
class Flow:
    """The motion of one design under its forces and drives."""

    dyn: Dynamics  # its equations of motion
    view: Plan = static()  # which coordinates are solved for
    drives: tuple[Drive, ...] = static()  # the driven coordinates, functions of time
    redundant: bool = static()  # whether rows are redundant, or may become so at a singular position
    ready: tuple[Array, Array, Array] | None = None  # what `prepared` has put together
    # Further arguments of the drives' functions, arrays for each; none if it is empty.
    more: tuple[tuple[Array, ...], ...] = ()

    @classmethod
    def of(cls, dyn: Dynamics, freedom: int, drives: Sequence[Drive] = (), singular: bool = False) -> "Flow":
        """The flow of a design with some coordinates driven."""
        top = dyn.topology
        view = free_view(top, tuple(name for name, _ in drives))
        rank = len(top.unknown) - freedom
        many = len(view.rows) > rank or bool(drives) or bool(top.rates)
        return cls(dyn, view, tuple(drives), singular or many)

    # -- what is driven -----------------------------------------------------------------------------------------

    def prescribed(self, t: Array) -> tuple[Array, Array, Array]:
        """Values, rates and accelerations of the driven coordinates, each ``(k,)``."""
        if not self.drives:
            none = jnp.zeros(0)
            return none, none, none
        out = []
        for k, (_, f) in enumerate(self.drives):
            g = functools.partial(_value, f, self.more[k] if self.more else ())
            dg = functools.partial(_rate, g)
            out.append((g(t), dg(t), _rate(dg, t)))
        return tuple(jnp.stack(x) for x in zip(*out, strict=True))  # pyright: ignore[reportReturnType]

    def impose(self, t: Array, q: Coordinates, v: Coordinates) -> tuple[Coordinates, Coordinates]:
        """The state with driven coordinates on their functions of time, and the ground at rest."""
        u, du, _ = self.prescribed(t)
        fixed = self.view.fixed
        q = q.at[self.view.known].set(u)
        return q, v.at[self.view.known].set(du).at[fixed].set(0.0)

    # -- scaled matrices ----------------------------------------------------------------------------------------

    def scaled(self) -> tuple[Array, Array, Array]:
        """Weights of the unknowns as lengths, the size of the mass matrix, and that matrix in both."""
        if self.ready is not None:
            return self.ready
        u = self.view.unknown
        weight = weights(self.dyn.eq)[u]
        mass = self.dyn.mass[u[:, None], u[None]] / (weight[:, None] * weight[None])
        size = jax.lax.stop_gradient(jnp.max(jnp.diagonal(mass), initial=0.0))
        size = jnp.where(size > 0, size, 1.0)
        return weight, size, mass / size

    def prepared(self) -> "Flow":
        """The same with all at hand that does not depend on the state: XLA would put it together in every step."""
        return dataclasses.replace(self, ready=self.scaled())

    # -- rows ---------------------------------------------------------------------------------------------------

    def rows(self, q: Coordinates, v: Coordinates) -> Rows:
        """The plan's rows and, behind them, those on velocities alone, in a state."""
        top, u, known = self.dyn.topology, self.view.unknown, self.view.known
        found = evaluate(self.view, self.dyn.eq, q, v)
        if top.rates:
            b = coefficients(top, self.dyn.rates, q)
            rest, bent = jax.jvp(lambda x: slips(top, self.dyn.rates, x, v), (q,), (v,))
            by_unknown, by_known = (jnp.concatenate(x) for x in ((found[1], b[:, u]), (found[2], b[:, known])))
            slip = jnp.concatenate([found[1] @ v[u] + found[2] @ v[known], rest])
            return Rows(found[0], by_unknown, by_known, slip, jnp.concatenate([found[3], bent]))
        return Rows(*found[:3], found[1] @ v[u] + found[2] @ v[known], found[3])

    def all_rows(self, multipliers: Array) -> Array:
        """Multipliers ``(m,)`` in their places among all rows, those on velocities last."""
        top = self.dyn.topology
        count = len(top.rows)
        at = np.concatenate([self.view.rows, count + np.arange(len(top.rate_rows), dtype=self.view.rows.dtype)])
        return jnp.zeros(count + len(top.rate_rows)).at[at].set(multipliers)

    def no_multipliers(self) -> Array:
        """Zeros in place of the multipliers that `answer` gives."""
        return jnp.zeros(len(self.view.rows) + len(self.dyn.topology.rate_rows))

    # -- motion -------------------------------------------------------------------------------------------------

    def answer(
        self,
        what: Any,
        t: Array | float,
        q: Coordinates,
        v: Coordinates,
        extra: Array | None = None,
        baumgarte: tuple[Any, Any] | None = None,
    ) -> Answer:
        """Solve for accelerations, or for the changes that bring a pose or rates back onto the constraints.

        All three are one system of equations with other right-hand sides, ``M q̈ + Φ_qᵀ λ + Bᵀ μ = Q`` and the same
        without forces: a program that asks in turn, with a traced `what`, contains it once.

        Args:
            what: `ACCELERATION`; `POSITION`, the nearest pose that meets the constraints to first order, by the masses;
                or `VELOCITY`, the rates that meet them, least changed in kinetic energy.
            t: time.
            q: pose.
            v: rates.
            extra: further generalised forces ``(N,)``.
            baumgarte: stabilisation of accelerations ``(2α, β²)``, or None.
        """
        view, dyn, u = self.view, self.dyn, self.view.unknown
        r, j, known, slip, bent = self.rows(q, v)
        apart, still = jnp.concatenate([r, jnp.zeros(len(slip) - len(r))]), jnp.zeros_like(q)
        weight, size, inner = self.scaled()

        def driven() -> Array:
            return still.at[view.known].set(self.prescribed(jnp.asarray(t, float))[2])

        def push() -> Array:
            right = forces(dyn, jnp.asarray(t, float), q, v) - dyn.mass @ driven()
            return (right if extra is None else right + extra)[u] / (weight * size)

        def bend() -> Array:
            g = -bent - known @ driven()[view.known]
            return g if baumgarte is None else g - baumgarte[0] * slip - baumgarte[1] * apart

        f = pick(what, push, lambda: still[u], lambda: still[u])
        g = pick(what, bend, lambda: -apart, lambda: -slip)
        if len(slip) > len(r):  # rows on velocities say nothing of where a pose belongs
            j = j.at[len(r) :].multiply(pick(what, lambda: 1.0, lambda: 0.0, lambda: 1.0))
        x, y = saddle(inner, j / weight, self.redundant)(f, g)
        base = pick(what, driven, lambda: still, lambda: still)
        return Answer(base.at[u].set(x / weight), y * size, largest(r), largest(slip))

    def accelerate(
        self,
        t: Array | float,
        q: Coordinates,
        v: Coordinates,
        extra: Array | None = None,
        baumgarte: tuple[Any, Any] | None = None,
    ) -> tuple[Coordinates, Array]:
        """Accelerations ``(N,)`` and multipliers of the plan's rows and of those on velocities ``(m,)``."""
        return self.answer(ACCELERATION, t, q, v, extra, baumgarte)[:2]

    def project_position(self, q: Coordinates, iterations: int = 2) -> Coordinates:
        """The nearest pose that meets the constraints, by the masses, from one close by."""
        still = jnp.zeros_like(q)

        def closer(q, _):
            return q + self.answer(POSITION, 0.0, q, still).change, None

        return closer(q, None)[0] if iterations == 1 else jax.lax.scan(closer, q, None, length=iterations)[0]

    def project_velocity(self, q: Coordinates, v: Coordinates) -> Coordinates:
        """The rates that meet the constraints, least changed in kinetic energy."""
        return v + self.answer(VELOCITY, 0.0, q, v).change


def _value(f: Callable, more: Sequence[Array], t: Array) -> Array:
    return jnp.asarray(f(t, *more), float)


def _rate(f: Callable, t: Array) -> Array:
    return jax.jvp(f, (t,), (jnp.ones_like(t),))[1]
