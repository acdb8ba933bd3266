"""Reactions: what passes through each joint, also where the joint is a shared point and no row stands for it.

The wrenches themselves are made in `jaxnc.dynamics.wrenches`; here they are asked for by name.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.compiling import filter_jit, jit, refuse_fork
from jaxnc.dynamics import sides
from jaxnc.dynamics.exerted import Load, load_of, loads_on, named_rows
from jaxnc.dynamics.extended import extended, known, lift, lift_rates, lifted, shown
from jaxnc.dynamics.model import Dynamics, dynamics, forces
from jaxnc.dynamics.moments import cross
from jaxnc.dynamics.wrenches import Ledger, Parts, all_parts, row_forces
from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.inputs import outside
from jaxnc.kinematics.motion import Motion
from jaxnc.records import record
from jaxnc.system.equations import coefficients
from jaxnc.system.frames import turns
from jaxnc.system.identity import Owner, Thing, addresses, find
from jaxnc.system.topology import Topology
from jaxnc.types import Array

R = TypeVar("R")
_OTHERS = (Thing.RELATION, Thing.CONSTRAINT, Thing.COORDINATE)
"""What `Reactions.joint` is asked for where no joint has the name."""


def _in_one(f: Callable[..., R]) -> Callable[..., R]:
    """Compile a method's small steps as one program where numbers are traced; known ones are NumPy's."""
    compiled = filter_jit(f)

    @functools.wraps(f)
    def call(self: Any, *args: Any) -> R:
        return (f if known(self) else compiled)(self, *args)

    return call


@public
class Wrench(NamedTuple):
    """A force ``(..., dim)``, N, and a moment, N m: ``(...,)`` in the plane, ``(..., 3)`` in space."""

    force: Array
    moment: Array


@public
@record
class Reactions:
    """Reactions of a motion whose multipliers are known.

    Attributes:
        motion: the motion.
        multipliers: Lagrange multipliers of all rows, ``(..., rows)``.
        efforts: efforts on driven and held coordinates, ``(..., inputs)``.
    """

    motion: Motion
    multipliers: Array
    efforts: Array

    def on(self, body: str, about: str | None = None, frame: str | None = None) -> dict[str, Wrench]:
        """All wrenches on a body: their sum is its mass times the acceleration of its centre, and its rate of spin.

        Args:
            body: the body.
            about: the point that moments are about; the body's centre of mass if not given.
            frame: a body whose axes the components are in; the ground's if not given.

        Returns:
            By what exerts them: ``"weight"``; ``"joint J"`` for joints, cables and relations; ``"point P"`` for what
            passes through a point (or only a vector) that it shares; ``"load F"`` for springs, dampers, forces,
            frictions and point masses on what is its own; ``"coordinate phi"`` for the effort of an input. What acts on
            a point that several bodies share is in what passes through it.

        Raises:
            InputError: an unknown body or point.
        """
        return self._listed(self._ledger(), _number(extended(self.motion.system).topology, body), about, frame)

    def all(self) -> dict[str, dict[str, Wrench]]:
        """What `on` gives of every body, about the centre of mass of each."""
        ledger = self._ledger()
        return {body.name: self._listed(ledger, b, None, None) for b, body in enumerate(ledger.top.bodies)}

    def at(self, point: str, on: str, frame: str | None = None) -> Wrench:
        """What passes into a body where it holds a point (and the vectors that it shares there).

        Args:
            point: a point of the body. Where it shares further points or vectors with the same neighbours, as along a
                hinge, or a joint of rows goes with it, these belong to the joint; the moment is about `point`.
            on: the body that is acted on.
            frame: a body whose axes the components are in; the ground's if not given.

        Returns:
            The wrench, with the loads and masses at the point. Where the body alone holds the point, it is that of the
            joints which act there, each as a whole, as `joint` gives it about the point, and the pull of cables and
            inputs on it.

        Raises:
            InputError: an unknown body, or a point that it does not have.
        """
        top = extended(self.motion.system).topology
        b = _number(top, on)
        if point not in top.points or top.points.index(point) not in top.bodies[b].points:
            names = [top.points[p] for p in top.bodies[b].points]
            raise InputError(f"body {on!r} has no point {point!r}; {nearest(point, names)}")
        return self._at(b, top.points.index(point), frame)

    @_in_one
    def _at(self, b: int, p: int, frame: str | None) -> Wrench:
        ledger = self._ledger()
        return self._framed(self._reduced(ledger.at(b, p), ledger.points[..., p, :]), frame)

    def joint(self, name: str, on: str, about: str | None = None, frame: str | None = None) -> Wrench:
        """What a joint that writes rows does to a body, with all that belongs to it: one wrench for a physical joint.

        Of a gear it is the force at the pitch point, of a rolling disc that at the contact.

        Args:
            name: the joint; where no joint is called so also a relation, constraint or coordinate. With its kind in
                front, ``"coordinate phi"``, it is that in any case.
            on: the body that is acted on.
            about: the point that moments are about; the body's first point if not given.
            frame: a body whose axes the components are in; the ground's if not given.

        Returns:
            The wrench; none if the joint does not touch the body. What acts on a point that several bodies share
            passes into each of them there, see `at`; asked by the joint's name it counts for each of them.

        Raises:
            InputError: an unknown body, point or joint; a name of two of these others.
        """
        top = extended(self.motion.system).topology
        b = _number(top, on)
        writing = sorted({o for o in top.owners if o.thing in (Thing.JOINT, *_OTHERS)})
        owner = find(top.names, name, (Thing.JOINT,), writing) or find(top.names, name, _OTHERS, writing)
        if owner is None:
            hint = nearest(name, [top.called(o) for o in writing])
            raise InputError(f"{top.name!r} has no joint {name!r} that writes rows; {hint}")
        return self._joint(b, owner, top.bodies[b].points[0] if about is None else _point(top, about), frame)

    @_in_one
    def _joint(self, b: int, owner: Owner, first: int, frame: str | None) -> Wrench:
        ledger = self._ledger()
        wrench = ledger.wrenches[b].get((owner.thing.noun, ledger.top.called(owner)))
        if wrench is None:
            wrench = ledger.pressed(b, owner)
        return self._framed(self._reduced(wrench, ledger.points[..., first, :]), frame)

    def support(self, point: str) -> Array:
        """Force of the ground on a point in its fixed coordinates, ``(..., dim)``; zero in the others."""
        return self._support(_point(extended(self.motion.system).topology, point))

    @_in_one
    def _support(self, p: int) -> Array:
        top = extended(self.motion.system).topology
        at = slice(p * top.dim, (p + 1) * top.dim)
        fixed = np.array(top.fixed[at])
        whole = self._whole()[..., at]
        elsewhere = jnp.reshape(self._ledger().grounded.get(p, 0.0) + whole.reshape(-1, top.dim) * 0.0, whole.shape)
        return jnp.where(fixed, whole - elsewhere, 0.0)

    def load(self, name: str) -> Load:
        """What a spring, damper, stop, force, torque or friction does, by its name: a spring's tension, its power.

        Args:
            name: as it was given when it was added; where a friction is called as a force, ``"friction rub"`` or
                ``"force rub"``.

        Returns:
            Its value, N or N m (what it means for which load: `jaxnc.dynamics.exerted.Load`), and the power that it
            gives to the mechanism, W ``(...,)``.

        Raises:
            InputError: there is none of this name, or a force and a friction have it.
        """
        return self._load(name)

    @_in_one
    def _load(self, name: str) -> Load:
        dyn, t, _, v, _ = self._states()
        seen = shown(self.motion.system.topology)
        found = load_of(dyn.topology, self._parts(), v.reshape(t.size, v.shape[-1]), name, seen)
        return Load(*(x.reshape((*t.shape, *x.shape[1:])) for x in found))

    def effort(self, name: str) -> Array:
        """Effort of the input on a driven or held coordinate: a torque on an angle, the thrust of a leg, ``(...,)``.

        Raises:
            InputError: the coordinate is not driven in this motion. A torque of `m.torque` is no input but a load: its
                value is that of `load`.
        """
        names = (*self.motion.driven, *self.motion.held)
        if name not in names:
            top = self.motion.system.topology
            if loads := loads_on(top, name):
                many = f"the loads {', '.join(map(repr, loads))} act" if loads[1:] else f"the load {loads[0]!r} acts"
                raise InputError(
                    f"{name!r} is not driven in this motion; {many} on it: reactions.load({loads[0]!r}).value is its "
                    f"effort"
                )
            if name in top.position:
                raise InputError(
                    f"{name!r} is not driven in this motion, and no load acts on it, so that nothing drives it; "
                    + (f"driven: {', '.join(names)}" if names else "no coordinate is driven")
                )
            raise InputError(f"{top.name!r} has no coordinate {name!r}; {nearest(name, names or top.scalars)}")
        return self.efforts[..., names.index(name)]

    def rows(self, of: str | None = None) -> dict[str, Array]:
        """Multipliers by the names of their rows, ``(...,)`` each: row k of `system.residual` pushes with -Φ_k,qᵀ λ_k.

        Args:
            of: a body, joint, relation, constraint or coordinate, whose rows alone are wanted, with its kind in front
                where two have one name, ``"joint slide"``; all if not given.

        Returns:
            By names such as ``"rod: distance B-C"``, in the order of the residual, last those of rows on velocities.

        Raises:
            InputError: nothing of this name writes rows, or two things do.
        """
        top = extended(self.motion.system).topology
        chosen = range(self.multipliers.shape[-1])
        if of is not None:
            owners = [*top.row_owners, *(o for block in top.rates for o in block.owners for _ in block.kind.rows)]
            writing = sorted(top.owners)
            owner = find(top.names, of, (Thing.BODY, Thing.JOINT, *_OTHERS), writing)
            if owner is None:
                hint = nearest(of, [top.called(o) for o in writing])
                raise InputError(f"{top.name!r}: nothing that writes rows is called {of!r}; {hint}")
            chosen = [k for k, those in enumerate(owners) if owner in those]
        names = named_rows(top)
        return {names[k]: self.multipliers[..., k] for k in chosen}

    def unique(self) -> dict[str, bool]:
        """Which reactions and efforts equilibrium alone determines, in the first pose; the rest are of least norm.

        Returns:
            By name: ``"B on coupler"`` for what `at` gives, joints that write rows, points with fixed coordinates
            (their `support`), and driven and held coordinates (their effort); ``"joint phi"`` and ``"coordinate phi"``
            where two have one name.
        """
        from jaxnc.solvers.assembly import evaluate
        from jaxnc.solvers.plan import plan

        outside(self.motion, "unique()")
        motion, system = self.motion, extended(self.motion.system)
        top, dyn = system.topology, dynamics(system)
        q = self._q.reshape(-1, self._q.shape[-1])[0]
        view = plan(top, motion.driven, motion.held)
        inner = np.asarray(evaluate(dyn.eq, q)[1])[view.rows][:, view.unknown]
        left, values, _ = np.linalg.svd(inner)
        rank = int(np.sum(values > 1e-9 * values[0])) if len(values) else 0
        # Self-stress: multipliers that put no force on what moves. A reaction is unique if none of them reaches it.
        stress = np.zeros((left.shape[1] - rank, len(top.rows) + len(top.rate_rows)))
        stress[:, view.rows] = left[:, rank:].T
        reached = _reached(self, dyn, view, q, stress)
        largest = max((float(np.abs(x).max(initial=0.0)) for x in reached.values()), default=0.0)
        return {name: bool(np.abs(x).max(initial=0.0) <= 1e-8 * max(largest, 1e-6)) for name, x in reached.items()}

    # -- inside -------------------------------------------------------------------------------------------------

    @property
    def _q(self) -> Array:
        return self._states()[2]

    def _states(self) -> tuple[Dynamics, Any, Any, Any, Any]:
        return states_of(self.motion)

    def _parts(self) -> Parts:
        dyn, t, q, v, a = self._states()
        flat = [x.reshape(t.size, x.shape[-1]) for x in (q, v, a, self.multipliers)]
        return all_parts(extended(self.motion.system), dyn, t.reshape(-1), *flat)

    def _ledger(self) -> Ledger:
        """All wrenches of all poses, one after another."""
        dyn, t, q, *_ = self._states()
        found = self._parts()
        at = [dyn.topology.position[name] for name in (*self.motion.driven, *self.motion.held)]
        at = [c for c in at if c < len(dyn.topology.coordinates) - len(dyn.topology.scalars)]
        whole = self._whole().reshape(t.size, q.shape[-1]) if at else q
        efforts = {c: whole[:, c] for c in at}  # of angles and distances they are in their rows
        if not any(isinstance(x, Tracer) for x in jax.tree.leaves((found, efforts))):
            found, efforts = jax.tree.map(np.asarray, (found, efforts))
        return Ledger(dyn.topology, found, efforts)

    def _listed(self, ledger: Ledger, b: int, about: str | None, frame: str | None) -> dict[str, Wrench]:
        place = ledger.centre(b) if about is None else ledger.points[..., _point(ledger.top, about), :]
        return {
            " ".join(key).strip(): self._framed(self._reduced(wrench, place), frame)
            for key, wrench in ledger.wrenches[b].items()
        }

    def _reduced(self, wrench: tuple[Any, Any], place: Any) -> Wrench:
        """A wrench about the origin as one about places ``(P, dim)``, in the shape of the motion."""
        force, moment = wrench[0], wrench[1] - cross(place, wrench[0])
        lead = self.motion.q.shape[:-1]
        return Wrench(*(jnp.asarray(x.reshape((*lead, *x.shape[1:]))) for x in (force, moment)))

    def _whole(self) -> Array:
        """What holds the fixed coordinates: M q̈ + Φ_qᵀ λ - Q."""
        dyn, t, q, v, a = self._states()
        flat = [x.reshape(t.size, x.shape[-1]) for x in (q, v, a, self.multipliers)]
        return _open(dyn, t.reshape(-1), *flat).reshape(q.shape)

    def _framed(self, wrench: Wrench, frame: str | None) -> Wrench:
        if frame is None:
            return wrench
        inner = extended(self.motion.system)
        body = inner.topology.bodies[_number(inner.topology, frame)]
        axes = turns(inner.topology, body.segments, dynamics(inner).eq.home, self._q)
        force = jnp.einsum("...ji,...j->...i", axes, wrench.force)
        if inner.topology.dim == 2:
            return Wrench(force, wrench.moment)
        return Wrench(force, jnp.einsum("...ji,...j->...i", axes, wrench.moment))


@filter_jit
def _open(dyn: Dynamics, t: Array, q: Array, v: Array, a: Array, lam: Array) -> Array:
    """What rows and known forces leave open on all coordinates of poses ``(P, N)``."""
    return jax.vmap(lambda t, q, v, a, lam: left_open(dyn, t, q, v, a, lam))(t, q, v, a, lam)


def left_open(dyn: Dynamics, t: Array, q: Array, v: Array, a: Array, lam: Array) -> Array:
    """The same of one pose: the efforts of inputs, and what holds the fixed coordinates."""
    from jaxnc.dynamics.friction import friction_forces, has_friction

    top = dyn.topology
    out = dyn.mass @ a + row_forces(dyn.eq, np.arange(len(top.rows)), q, lam) - forces(dyn, t, q, v)
    if top.rates:
        out = out + lam[len(top.rows) :] @ coefficients(top, dyn.rates, q)
    return out - friction_forces(dyn, q, v, a, lam, None, t) if has_friction(dyn) else out


def _reached(found: Reactions, dyn: Dynamics, view: Any, q: Array, stress: np.ndarray) -> dict[str, np.ndarray]:
    """What multipliers ``(k, rows)`` alone put on joints, supports and inputs, by the names of `Reactions.unique`."""
    top, count = dyn.topology, len(stress) + 1
    rest = jnp.zeros((count, len(q)))
    lam = jnp.concatenate([stress, jnp.zeros((1, stress.shape[1]))])
    parts = all_parts(dyn.system, dyn, jnp.zeros(count), jnp.broadcast_to(q, rest.shape), rest, rest, lam)
    ledger = Ledger(top, jax.tree.map(np.asarray, parts), {})
    out: list[tuple[Owner | None, str, np.ndarray]] = []
    for b, body in enumerate(top.bodies):
        for p in body.points:
            passing = ledger.through(b, p)
            if passing is None or not (len(sides.holders(top)[p]) > 1):
                continue
            force, moment = ledger.wrenches[b][passing[0]]
            moment = moment - cross(ledger.points[:, p], force)
            wrench = np.concatenate([force, moment.reshape(count, -1)], axis=1)
            out.append((None, f"{top.points[p]} on {body.name}", wrench[:-1] - wrench[-1]))
    for j, joint in enumerate(top.joints):
        at = sides.rows(top, j)
        if len(at):
            pull = jax.vmap(lambda x, at=at: row_forces(dyn.eq, at, q, x))(jnp.asarray(stress))
            out.append((joint.owner, "", np.asarray(pull)))
    whole = np.asarray(jax.vmap(lambda x: row_forces(dyn.eq, np.arange(len(top.rows)), q, x))(jnp.asarray(stress)))
    for p in range(len(top.points)):
        fixed = [c for c in range(p * top.dim, (p + 1) * top.dim) if top.fixed[c]]
        if fixed and any(p in b.points for b in top.bodies):
            out.append((Owner(Thing.POINT, p), "", whole[:, fixed]))
    first = len(top.coordinates) - len(top.scalars)
    for c in map(int, view.known):
        owner = Owner(Thing.COORDINATE, c - first) if c >= first else None
        out.append((owner, "" if owner else top.coordinates[c], whole[:, c]))
    names = addresses(top.names, [(owner, key) for owner, key, _ in out])
    return {name: force for name, (_, _, force) in zip(names, out, strict=True)}


@public
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

    refuse_fork()
    if isinstance(motion, Reactions):
        return motion
    if isinstance(motion, InverseDynamics):
        return motion.reactions
    if isinstance(motion, Simulation) and motion.multipliers is not None:
        return held(motion, motion.multipliers)
    if not isinstance(motion, Motion):
        raise InputError(f"reactions() takes a simulation, or a motion with rates, got {type(motion).__name__}")
    return inverse_dynamics(motion.system, motion).reactions


def held(motion: Motion, multipliers: Array) -> Reactions:
    """The reactions of a motion with its multipliers, with the efforts that its inputs then take."""
    found = Reactions(motion, multipliers, jnp.zeros((*motion.status.shape, len(motion.driven) + len(motion.held))))
    if not found.efforts.size:
        return found
    position = extended(motion.system).topology.position
    at = np.array([position[name] for name in (*motion.driven, *motion.held)])
    efforts = jnp.where((motion.status == 0)[..., None], found._whole()[..., at], 0.0)
    return Reactions(motion, multipliers, efforts)


def states_of(motion: Motion) -> tuple[Dynamics, Any, Any, Any, Any]:
    """Equations of motion, times, and poses, rates and accelerations in the coordinates of the dynamics.

    The latter are NumPy's where they are known.
    """
    system = motion.system
    top, dyn = system.topology, dynamics(extended(system))
    t = np.zeros(motion.status.shape) if motion.time is None else motion.time
    given: Any = motion.q, motion.rates[0], motion.rates[1]
    if host := known(given):
        given = tuple(map(np.asarray, given))
    if top.extended is None:
        return dyn, t, *given
    flat = [x.reshape(-1, x.shape[-1]) for x in given]
    found = lifted(top, *flat) if host else _lifted(top, *flat)
    q, v, a = (x.reshape(*given[0].shape[:-1], x.shape[-1]) for x in found)
    return dyn, t, q, v, a


@functools.partial(jit, static_argnums=0)
def _lifted(top: Topology, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
    """As `jaxnc.dynamics.extended.lifted`, of numbers that are traced."""

    def rates(q, v):
        return lift_rates(top, q, v)

    return jax.vmap(lambda q, v, a: (lift(top, q), rates(q, v), jax.jvp(rates, (q, v), (v, a))[1]))(q, v, a)


def _number(top: Topology, name: str) -> int:
    names = [b.name for b in top.bodies]
    if name not in names:
        raise InputError(f"{top.name!r} has no body {name!r}; {nearest(name, names)}")
    return names.index(name)


def _point(top: Topology, name: str) -> int:
    if name not in top.points:
        raise InputError(f"{top.name!r} has no point {name!r}; {nearest(name, top.points)}")
    return top.points.index(name)
