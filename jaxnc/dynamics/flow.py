"""Motion under forces: accelerations, and the projections that keep positions and velocities on the constraints."""

import functools
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.dynamics.model import Dynamics, forces
from jaxnc.dynamics.saddle import saddle
from jaxnc.errors import InputError, nearest
from jaxnc.records import record, static
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.equations import residual, weights
from jaxnc.system.rates import coefficients, slips
from jaxnc.system.topology import Topology
from jaxnc.types import Array, Coordinates

Drive = tuple[str, Callable]
"""A coordinate that follows a function of time."""


@functools.lru_cache(maxsize=256)
def free_view(topology: Topology, driven: tuple[str, ...]) -> Plan:
    """The plan of a motion: what is neither fixed nor driven is solved for.

    Raises:
        InputError: unknown names, or a mechanism kept sparse.
    """
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
    """The motion of one design under its forces and drives.

    Attributes:
        dyn: its equations of motion.
        view: which coordinates are solved for.
        drives: the driven coordinates, functions of time.
        redundant: whether rows are redundant, or may become so at a singular position.
    """

    dyn: Dynamics
    view: Plan = static()
    drives: tuple[Drive, ...] = static()
    redundant: bool = static()

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
        for _, f in self.drives:
            g = functools.partial(_value, f)
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

    def _scale(self) -> tuple[Array, Array]:
        """Weights of the unknowns as lengths, and the size of the mass matrix."""
        weight = weights(self.dyn.eq)[self.view.unknown]
        diagonal = jnp.diagonal(self.dyn.mass)[self.view.unknown] / weight**2
        size = jax.lax.stop_gradient(jnp.max(diagonal))
        return weight, jnp.where(size > 0, size, 1.0)

    def _inner_mass(self, weight: Array, size: Array) -> Array:
        u = self.view.unknown
        return self.dyn.mass[u[:, None], u[None]] / (weight[:, None] * weight[None] * size)

    # -- rows ---------------------------------------------------------------------------------------------------

    def velocity_rows(self, q: Coordinates) -> tuple[Array, Array, Array]:
        """Rows on the rates: the plan's, then those on velocities alone. ``J v + K v_driven + o = 0``.

        Returns:
            J ``(m, unknowns)``, K ``(m, driven)`` and o ``(m,)``.
        """
        view, top = self.view, self.dyn.topology
        _, j, known = view.linearise(self.dyn.eq, q)
        if not top.rates:
            return j, known, jnp.zeros(j.shape[0])
        b = coefficients(top, self.dyn.rates, q)
        rest = slips(top, self.dyn.rates, q, jnp.zeros_like(q))
        return (
            jnp.concatenate([j, b[:, view.unknown]]),
            jnp.concatenate([known, b[:, view.known]]),
            jnp.concatenate([jnp.zeros(j.shape[0]), rest]),
        )

    def all_rows(self, multipliers: Array) -> Array:
        """Multipliers ``(m,)`` in their places among all rows, those on velocities last."""
        top = self.dyn.topology
        count = len(top.rows)
        at = np.concatenate([self.view.rows, count + np.arange(len(top.rate_rows), dtype=self.view.rows.dtype)])
        return jnp.zeros(count + len(top.rate_rows)).at[at].set(multipliers)

    def bias(self, q: Coordinates, v: Coordinates) -> Array:
        """What the rows accelerate by without accelerations of the coordinates, ``d²Φ/dt² - Φ_q q̈``, ``(m,)``."""
        top = self.dyn.topology
        whole = _second(lambda x: residual(self.dyn.eq, x)[self.view.rows], q, v)
        if not top.rates:
            return whole
        return jnp.concatenate([whole, jax.jvp(lambda x: slips(top, self.dyn.rates, x, v), (q,), (v,))[1]])

    # -- motion -------------------------------------------------------------------------------------------------

    def accelerate(
        self,
        t: Array,
        q: Coordinates,
        v: Coordinates,
        extra: Array | None = None,
        baumgarte: tuple[float, float] | None = None,
    ) -> tuple[Coordinates, Array]:
        """Accelerations ``(N,)`` and multipliers of the plan's rows and of those on velocities ``(m,)``.

        ``M q̈ + Φ_qᵀ λ + Bᵀ μ = Q``.

        Args:
            t: time.
            q: pose.
            v: rates.
            extra: further generalised forces ``(N,)``.
            baumgarte: stabilisation ``(2α, β²)``, or None.
        """
        view, dyn = self.view, self.dyn
        j, known, rest = self.velocity_rows(q)
        _, _, a_known = self.prescribed(t)
        a0 = jnp.zeros_like(q).at[view.known].set(a_known)
        g = -self.bias(q, v) - known @ a_known
        if baumgarte is not None:
            whole = j @ v[view.unknown] + known @ v[view.known] + rest
            r = residual(dyn.eq, q)[view.rows]
            g = (g - baumgarte[0] * whole).at[: len(r)].add(-baumgarte[1] * r)
        right = forces(dyn, t, q, v) - dyn.mass @ a0
        if extra is not None:
            right = right + extra
        weight, size = self._scale()
        solve = saddle(self._inner_mass(weight, size), j / weight, self.redundant)
        x, y = solve(right[view.unknown] / (weight * size), g)
        return a0.at[view.unknown].set(x / weight), y * size

    # -- projections --------------------------------------------------------------------------------------------

    def project_position(self, q: Coordinates, iterations: int = 2) -> Coordinates:
        """The nearest pose that meets the constraints, from one close by."""
        view = self.view
        weight, _ = self._scale()
        eye, nothing = jnp.eye(len(view.unknown)), jnp.zeros(len(view.unknown))

        def closer(q, _):
            r, j, _ = view.linearise(self.dyn.eq, q)
            x, _ = saddle(eye, j / weight, self.redundant)(nothing, -r)
            return view.move(q, x / weight), None

        return closer(q, None)[0] if iterations == 1 else jax.lax.scan(closer, q, None, length=iterations)[0]

    def project_velocity(self, q: Coordinates, v: Coordinates) -> Coordinates:
        """The rates that meet the constraints, least changed in kinetic energy."""
        view = self.view
        j, known, rest = self.velocity_rows(q)
        weight, size = self._scale()
        miss = j @ v[view.unknown] + known @ v[view.known] + rest
        x, _ = saddle(self._inner_mass(weight, size), j / weight, self.redundant)(jnp.zeros(len(weight)), -miss)
        return view.move(v, x / weight)

    def violation(self, q: Coordinates, v: Coordinates) -> tuple[Array, Array]:
        """Largest residual of the rows, and of their rates."""
        j, known, rest = self.velocity_rows(q)
        r = residual(self.dyn.eq, q)[self.view.rows]
        rate = j @ v[self.view.unknown] + known @ v[self.view.known] + rest
        return jnp.max(jnp.abs(r), initial=0.0), jnp.max(jnp.abs(rate), initial=0.0)


def _value(f: Callable, t: Array) -> Array:
    return jnp.asarray(f(t), float)


def _rate(f: Callable, t: Array) -> Array:
    return jax.jvp(f, (t,), (jnp.ones_like(t),))[1]


def _second(f: Callable, q: Array, v: Array) -> Array:
    def first(x):
        return jax.jvp(f, (x,), (v,))[1]

    return jax.jvp(first, (q,), (v,))[1]
