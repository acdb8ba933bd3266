"""Reactions: what passes through each joint, also where the joint is a shared point and no row stands for it.

Every body obeys ``M_b q̈ + Φ_bᵀ λ - Q_b = f_b`` on its own coordinates, with its own inertia, rows and weight. The
generalised force f_b on a point or vector that it shares is what everything else does to it there: that is the joint's
reaction, whatever the joint is. Reduced to a wrench it does not depend on how the rows inside the body share their
load. Actuators (the rows of angles and distances, couples) act on the body that holds the direction they turn.
"""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import filter_jit
from jaxnc.dynamics.extended import extended, lift, lift_rates
from jaxnc.dynamics.inertia import body_inertia
from jaxnc.dynamics.model import Dynamics, _force, dynamics, variables
from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.motion import Motion
from jaxnc.system.equations import entries
from jaxnc.system.frames import spread, turns
from jaxnc.system.identity import Owner, Thing, addresses, find
from jaxnc.system.rates import coefficients
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import Array

_JOINTS = (Thing.JOINT, Thing.RELATION, Thing.CONSTRAINT, Thing.COORDINATE)
"""What `Reactions.joint` is asked for by name, first come first."""


class Wrench(NamedTuple):
    """A force ``(..., dim)``, N, and a moment, N m: ``(...,)`` in the plane, ``(..., 3)`` in space."""

    force: Array
    moment: Array


class Reactions(eqx.Module):
    """Reactions of a motion whose multipliers are known.

    Attributes:
        motion: the motion.
        multipliers: Lagrange multipliers of all rows, ``(..., rows)``.
        efforts: efforts on driven and held coordinates, ``(..., inputs)``.
    """

    motion: Motion
    multipliers: Array
    efforts: Array

    def at(self, point: str, on: str, frame: str | None = None) -> Wrench:
        """What everything else does to a body where it holds a point (and the vectors that it shares there).

        Args:
            point: a point of the body. Where it shares further points or vectors with the same neighbours, as along a
                hinge, these belong to the joint, and the moment is about `point`.
            on: the body that is acted on.
            frame: a body whose axes the components are in; the ground's if not given.

        Returns:
            The wrench.

        Raises:
            InputError: an unknown body, or a point that it does not have.
        """
        inner = extended(self.motion.system).topology
        body = _body(inner, on)
        if point not in inner.points or inner.points.index(point) not in body.points:
            names = [inner.points[p] for p in body.points]
            raise InputError(f"body {on!r} has no point {point!r}; {nearest(point, names)}")
        at = inner.points.index(point)
        items = joint_items(inner, on, at)
        return self._framed(_wrench(inner, self._q, self._body_force(on), items, at), frame)

    def joint(self, name: str, on: str, about: str | None = None, frame: str | None = None) -> Wrench:
        """What a joint that writes rows does to a body.

        Args:
            name: the joint; also a relation, constraint or coordinate, where need be with its kind in front, such as
                ``"coordinate phi"`` where a joint is called ``"phi"`` too.
            on: the body that is acted on; a point or vector that it shares with the other body counts as its own.
            about: the point that moments are about; the body's first point on the joint if not given.
            frame: a body whose axes the components are in; the ground's if not given.

        Returns:
            The wrench.
        """
        inner = extended(self.motion.system).topology
        writing = sorted({o for o in inner.owners if o.thing in _JOINTS})
        owner = find(inner.names, name, _JOINTS)
        if owner is None or owner not in writing:
            hint = nearest(name, [inner.called(o) for o in writing])
            raise InputError(f"{inner.name!r} has no joint {name!r} that writes rows; {hint}")
        body = _body(inner, on)
        force = -self._rows(inner.rows_of(owner)) - self._slips(inner.rates_of(owner))
        items = [*body.points, *(~u for u in body.vectors)]
        first = inner.points.index(about) if about is not None else body.points[0]
        return self._framed(_wrench(inner, self._q, force, items, first), frame)

    def support(self, point: str) -> Array:
        """Force of the ground on a point in its fixed coordinates, ``(..., dim)``; zero in the others."""
        inner = extended(self.motion.system).topology
        if point not in inner.points:
            raise InputError(f"{inner.name!r} has no point {point!r}; {nearest(point, inner.points)}")
        i = inner.points.index(point) * inner.dim
        whole = self._whole()
        fixed = np.array(inner.fixed[i : i + inner.dim])
        return jnp.where(fixed, whole[..., i : i + inner.dim], 0.0)

    def unique(self) -> dict[str, bool]:
        """Which reactions and efforts equilibrium alone determines, in the first pose; the rest are of least norm.

        Returns:
            By name: ``"B on coupler"`` for what `at` gives, joints that write rows, points with fixed coordinates
            (their `support`), and driven and held coordinates (their effort); ``"joint phi"`` and ``"coordinate phi"``
            where two have one name.
        """
        from jaxnc.solvers.assembly import look
        from jaxnc.solvers.plan import plan

        motion, system = self.motion, extended(self.motion.system)
        top, dyn = system.topology, dynamics(system)
        q = self._q.reshape(-1, self._q.shape[-1])[0]
        view = plan(top, motion.driven, motion.held)
        inner = np.asarray(look(dyn.eq, q)[1])[view.rows][:, view.unknown]
        left, values, _ = np.linalg.svd(inner)
        rank = int(np.sum(values > 1e-9 * values[0])) if len(values) else 0
        # Self-stress: multipliers that put no force on what moves. A reaction is unique if none of them reaches it.
        stress = np.zeros((left.shape[1] - rank, len(top.rows)))
        stress[:, view.rows] = left[:, rank:].T
        reached = {name: np.asarray(x) for name, x in _reached(system, dyn, view, q, jnp.asarray(stress)).items()}
        largest = max((float(np.abs(x).max(initial=0.0)) for x in reached.values()), default=0.0)
        return {name: bool(np.abs(x).max(initial=0.0) <= 1e-8 * max(largest, 1e-6)) for name, x in reached.items()}

    # -- inside -------------------------------------------------------------------------------------------------

    @property
    def _q(self) -> Array:
        top = self.motion.system.topology
        return _flat(lambda q: lift(top, q), self.motion.q)

    def _states(self) -> tuple[Dynamics, Array, Array, Array, Array]:
        return states_of(self.motion)

    def _rows(self, at: np.ndarray) -> Array:
        """Σ Φ_qᵀ λ over some rows, ``(..., N)``."""
        dyn, _, q, _, _ = self._states()
        return _flat(functools.partial(row_forces, dyn.eq, at), q, self.multipliers)

    def _slips(self, at: np.ndarray) -> Array:
        """Σ Bᵀ μ over some rows on velocities, ``(..., N)``."""
        dyn, _, q, _, _ = self._states()
        if not len(at):
            return jnp.zeros_like(q)
        chosen = self.multipliers[..., len(dyn.topology.rows) + at]
        return _flat(lambda q, mu: mu @ coefficients(dyn.topology, dyn.rates, q)[at], q, chosen)

    def _body_force(self, on: str) -> Array:
        dyn, t, q, v, a = self._states()
        f = functools.partial(body_force, extended(self.motion.system), dyn, on)
        return _flat(f, t[..., None], q, v, a, self.multipliers)

    def _whole(self) -> Array:
        """What holds the fixed coordinates: M q̈ + Φ_qᵀ λ - Q."""
        from jaxnc.dynamics.friction import friction_forces, has_friction
        from jaxnc.dynamics.model import forces

        dyn, t, q, v, a = self._states()
        top = dyn.topology
        at = np.arange(len(top.rows))

        def one(t, q, v, a, lam):
            out = dyn.mass @ a + row_forces(dyn.eq, at, q, lam) - forces(dyn, t[0], q, v)
            return out - friction_forces(dyn, q, v, a, lam) if has_friction(dyn) else out

        return _flat(one, t[..., None], q, v, a, self.multipliers)

    def _framed(self, wrench: Wrench, frame: str | None) -> Wrench:
        if frame is None:
            return wrench
        inner = extended(self.motion.system)
        body = _body(inner.topology, frame)
        axes = turns(inner.topology, body.segments, dynamics(inner).eq.home, self._q)
        force = jnp.einsum("...ji,...j->...i", axes, wrench.force)
        if inner.topology.dim == 2:
            return Wrench(force, wrench.moment)
        return Wrench(force, jnp.einsum("...ji,...j->...i", axes, wrench.moment))


@filter_jit
def _reached(system: System, dyn: Dynamics, view: Any, q: Array, stress: Array) -> dict[str, Array]:
    """What multipliers ``(k, rows)`` alone put on joints, supports and inputs, by the names of `Reactions.unique`."""
    top, rest = system.topology, jnp.zeros_like(q)

    def of(lam: Array) -> dict[str, Array]:
        out: list[tuple[Owner | None, str, Array]] = []
        for body in top.bodies:
            force = functools.partial(body_force, system, dyn, body.name, jnp.zeros(1), q, rest, rest)
            pull = force(lam) - force(jnp.zeros_like(lam))
            for p in body.points:
                shared = any(p in b.points for b in top.bodies if b.name != body.name)
                if shared or all(top.fixed[p * top.dim : (p + 1) * top.dim]):
                    wrench = _wrench(top, q, pull, joint_items(top, body.name, p), p)
                    name = f"{top.points[p]} on {body.name}"
                    out.append((None, name, jnp.concatenate([jnp.ravel(x) for x in wrench])))
        for joint in top.joints:
            at = top.rows_of(joint.owner)
            if len(at):
                out.append((joint.owner, "", row_forces(dyn.eq, at, q, lam)))
        whole = row_forces(dyn.eq, np.arange(len(top.rows)), q, lam)
        for p in range(len(top.points)):
            fixed = [c for c in range(p * top.dim, (p + 1) * top.dim) if top.fixed[c]]
            if fixed and any(p in b.points for b in top.bodies):
                out.append((Owner(Thing.POINT, p), "", whole[np.array(fixed)]))
        first = len(top.coordinates) - len(top.scalars)
        for c in map(int, view.known):
            owner = Owner(Thing.COORDINATE, c - first) if c >= first else None
            out.append((owner, "" if owner else top.coordinates[c], whole[c][None]))
        names = addresses(top.names, [(owner, key) for owner, key, _ in out])
        return {name: force for name, (_, _, force) in zip(names, out, strict=True)}

    return jax.vmap(of)(stress)


def reactions(motion: Any) -> Reactions:
    """The reactions in the joints of a simulation, or of a motion that its inputs drive.

    Args:
        motion: a simulation, a motion with rates (its inputs then take the efforts that it needs), or the result of
            `jaxnc.inverse_dynamics`.

    Returns:
        The reactions; ``.at("B", on="coupler")`` is the wrench on a body at a shared point.
    """
    from jaxnc.dynamics.inverse import InverseDynamics, inverse_dynamics
    from jaxnc.dynamics.simulation import Simulation

    if isinstance(motion, InverseDynamics):
        return motion.reactions
    if isinstance(motion, Simulation) and motion.multipliers is not None:
        return Reactions(motion, motion.multipliers, jnp.zeros((*motion.status.shape, len(motion.driven))))
    return inverse_dynamics(motion.system, motion).reactions


def states_of(motion: Motion) -> tuple[Dynamics, Array, Array, Array, Array]:
    """Equations of motion, times, and poses, rates and accelerations in the coordinates of the dynamics."""
    system = motion.system
    top, dyn = system.topology, dynamics(extended(system))
    t = jnp.zeros(motion.status.shape) if motion.time is None else motion.time
    q, v, a = motion.q, motion.rates[0], motion.rates[1]
    if top.extended is None:
        return dyn, t, q, v, a

    def second(q, v, a):
        return jax.jvp(lambda q, v: lift_rates(top, q, v), (q, v), (v, a))[1]

    return (
        dyn,
        t,
        _flat(lambda q: lift(top, q), q),
        _flat(lambda q, v: lift_rates(top, q, v), q, v),
        _flat(second, q, v, a),
    )


def _flat(f: Any, *arrays: Array) -> Array:
    lead = arrays[0].shape[:-1]
    count = int(np.prod(lead, dtype=int))
    out = jax.vmap(f)(*(a.reshape(count, a.shape[-1]) for a in arrays))
    return out.reshape(*lead, *out.shape[1:])


def _body(top: Topology, name: str):
    found = [b for b in top.bodies if b.name == name]
    if not found:
        raise InputError(f"{top.name!r} has no body {name!r}; {nearest(name, [b.name for b in top.bodies])}")
    return found[0]


def joint_items(top: Topology, on: str, point: int) -> list[int]:
    """What a body shares with the neighbours it has at a point: the point, and further points and vectors."""
    me = _body(top, on)
    mine = {*me.points, *(~u for u in me.vectors)}
    others = [b for b in top.bodies if b.name != on and point in b.points]
    ground = {i for i in range(len(top.points)) if all(top.fixed[i * top.dim : (i + 1) * top.dim])}
    offset = len(top.points) * top.dim
    ground |= {~u for u in range(len(top.vectors)) if top.fixed[offset + u * top.dim]}
    items = {point}
    for neighbour in ({*b.points, *(~u for u in b.vectors)} for b in others):
        items |= mine & neighbour
    if point in ground:
        items |= mine & ground
    return sorted(items, reverse=True)


def _wrench(top: Topology, q: Array, force: Array, items: list[int], about: int) -> Wrench:
    """The force on some points and vectors as a wrench about a point."""
    points, vectors = spread(top, q)
    on_points, on_vectors = spread(top, force)
    place = points[..., about, :]
    shape = q.shape[:-1]
    total = jnp.zeros((*shape, top.dim))
    moment = jnp.zeros(shape if top.dim == 2 else (*shape, 3))
    for item in items:
        arm, f = (
            (points[..., item, :] - place, on_points[..., item, :])
            if item >= 0
            else (
                vectors[..., ~item, :],
                on_vectors[..., ~item, :],
            )
        )
        if item >= 0:
            total = total + f
        moment = moment + _cross(arm, f)
    return Wrench(total, moment)


def _cross(a: Array, b: Array) -> Array:
    if a.shape[-1] == 2:
        return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return jnp.cross(a, b)


def row_forces(eq: Any, at: np.ndarray, q: Array, lam: Array) -> Array:
    """Σ Φ_qᵀ λ over some rows, ``(N,)``."""
    top = eq.topology
    from jaxnc.system.equations import places

    rows, columns, _ = places(top)
    chosen = np.isin(rows, at)
    return jnp.zeros(len(top.coordinates)).at[columns].add(jnp.where(chosen, entries(eq, q) * lam[rows], 0.0))


def body_force(system: System, dyn: Dynamics, on: str, t: Array, q: Array, v: Array, a: Array, lam: Array) -> Array:
    """What everything else does to a body, on all coordinates ``(N,)``."""
    top = system.topology
    at, mass, moments, _ = body_inertia(system, on)
    out = jnp.zeros(len(top.coordinates))
    out = out.at[at].add(mass @ a[at] - dyn.gravity @ moments)
    me = Owner(Thing.BODY, top.bodies.index(_body(top, on)))
    rows = [owners[0] == me for owners in top.row_owners]
    out = out + row_forces(dyn.eq, np.flatnonzero(rows), q, lam)
    # Actuators that turn or stretch a direction of this body.
    mask = actuated(top, on)
    values, first = entries(dyn.eq, q), 0
    for b, block in enumerate(top.blocks):
        layout, width = top.layout[b], top.layout[b].variables.shape[1]
        size = block.count * len(block.kind.rows) * width
        if block.kind.measure is not None:
            local = values[first : first + size].reshape(block.count, len(block.kind.rows), width)
            pull = jnp.sum(local * lam[layout.rows][:, :, None], axis=1) * mask[b]
            out = out.at[layout.variables.reshape(-1)].add(pull.reshape(-1))
        first += size
    for number, block in enumerate(top.loads.forces):
        if block.kind.name == "couple":
            where = variables(top, number)
            mine = np.array([float(set(p) <= set(_body(top, on).points)) for p in block.points])
            push = jax.vmap(lambda x, dx, c, b=block: _force(top, b, t[0], x, dx, c))(
                q[where], v[where], dyn.constants[number]
            )
            out = out.at[where.reshape(-1)].add(-(push * mine[:, None]).reshape(-1))
    return out


@functools.cache
def actuated(top: Topology, on: str) -> dict[int, np.ndarray]:
    """Which variables of rows of mixed coordinates are directions that this body, and no earlier one, holds."""
    out = {}
    for b, block in enumerate(top.blocks):
        if block.kind.measure is None:
            continue
        mask = np.zeros(top.layout[b].variables.shape)
        for i in range(block.count):
            for k in range(0, block.kind.points - 1, 2):
                pair = set(block.points[i][k : k + 2])
                if _holder(top, pair) == on:
                    mask[i, k * top.dim : (k + 2) * top.dim] = 1.0
            for k, u in enumerate(block.vectors[i]):
                if _holder(top, {~u}) == on:
                    start = block.kind.points * top.dim + k * top.dim
                    mask[i, start : start + top.dim] = 1.0
        out[b] = mask
    return out


def _holder(top: Topology, items: set[int]) -> str | None:
    """The body that holds a direction, where it is one body alone (or the first of several that share a segment)."""
    ground = all(i >= 0 and all(top.fixed[i * top.dim : (i + 1) * top.dim]) for i in items)
    if ground:
        return None
    holders = [b.name for b in top.bodies if items <= {*b.points, *(~u for u in b.vectors)}]
    if not holders or (len(holders) > 1 and any(i < 0 for i in items)):
        return None
    return holders[0]
