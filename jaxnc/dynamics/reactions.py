"""Reactions: what passes through each joint, also where no row stands for it; and the efforts of prescribed motions.

The wrenches themselves are made in `jaxnc.dynamics.wrenches`; here they are asked for by name. Beside them stand the
loads by name (springs, dampers, actuators), and all forces of a mechanism at the places where they are drawn.
"""

import dataclasses
import functools
from collections import Counter
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.compiling import filter_jit, refuse_fork
from jaxnc.constraints.elementary import ratio
from jaxnc.constraints.kind import dot, norm
from jaxnc.dynamics.extended import extended, is_concrete, lift_states, shown_places
from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.model import Dynamics, check_loads, dynamics, force_variables, forces, inertias
from jaxnc.dynamics.wrenches import (
    Ledger,
    Masses,
    Parts,
    balance_friction,
    body_masses,
    cross,
    friction_forces,
    frictions,
    has_friction,
    item_holders,
    joint_rows,
    key_of,
    pose_parts,
    row_forces,
    shared_groups,
    vector_tree,
)
from jaxnc.errors import AssemblyError, InputError, nearest
from jaxnc.forces import COUPLE, EFFORT
from jaxnc.kinematics.inputs import check_parameters, outside
from jaxnc.kinematics.motion import Motion
from jaxnc.records import record
from jaxnc.solvers.assembly import evaluate
from jaxnc.solvers.newton import hold_still
from jaxnc.solvers.plan import Plan, plan
from jaxnc.solvers.saddle import saddle
from jaxnc.system.equations import coefficients, refuse_rates
from jaxnc.system.frames import spread, turns
from jaxnc.system.identity import Owner, Thing, addresses, find
from jaxnc.system.precision import as_its_system, limits
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import AnyArray, Array, ArrayLike, Numbers


@public
class Load(NamedTuple):
    """Value and power of a spring, damper, stop, actuator, force or friction.

    Attributes:
        value: of what acts between two points the tension, N ``(...,)``, positive where it draws them together; on an
            angle, distance or single coordinate the effort, N m or N ``(...,)``, positive where it drives it up; of a
            force on a point its components, N ``(..., dim)``; of a couple on a body the couple, N m ``(...,)``; of
            everything else the generalised forces on all coordinates ``(..., N)``.
        power: what it gives to the mechanism, W ``(...,)``: negative where it stores or dissipates.
    """

    value: Array
    power: Array


def _load_by_name(top: Topology, found: Parts, v: Array, name: str, seen: np.ndarray) -> Load:
    """Return a load of poses ``(P, …)`` by name; the user's system has the coordinates that are `seen`."""
    owner = find(top.names, name, (Thing.FORCE, Thing.FRICTION))
    if owner is None:
        known = [*top.names[Thing.FORCE], *top.names[Thing.FRICTION]]
        hint = nearest(name, known) if known else "it has no springs, dampers, forces or frictions"
        raise InputError(f"{top.name!r} has no load {name!r}; {hint}")
    plain = top.names[owner.thing][owner.number]
    at: Any = seen
    if owner.thing is Thing.FRICTION:
        force = sum(found.friction[[index.name for index in top.loads.friction].index(plain)], v * 0.0)
    else:
        for b, block in enumerate(top.loads.forces):
            if plain in block.names:
                return _load_of_kind(top, found, v, b, block.names.index(plain), seen)
        number = [f.name for f in top.loads.functions].index(plain)
        function, force = top.loads.functions[number], found.functions[number]
        if function.acts == "effort":
            at = function.at
        elif function.acts == "force":
            at = slice(function.at * top.dim, (function.at + 1) * top.dim)
    return Load(force[:, at], (force * v).sum(-1))


def _load_of_kind(top: Topology, found: Parts, v: Array, b: int, i: int, seen: np.ndarray) -> Load:
    block = top.loads.forces[b]
    kind, at, force = block.kind, force_variables(top, b)[i], found.loads[b][:, i]
    takes = kind.points, kind.vectors, kind.scalars
    if takes == (0, 0, 1):
        value = force[:, 0]
    elif takes == (1, 0, 0):
        value = force
    elif takes == (2, 0, 0):
        points = spread(top, found.q)[0]
        start, end = block.points[i]
        along = points[:, end] - points[:, start]
        first, second = force[:, : top.dim], force[:, top.dim :]
        if kind == COUPLE:
            value = cross(along, second)
        else:
            value = 0.5 * jax.vmap(lambda f, d: ratio(dot(f, d), norm(d)))(first - second, along)
    else:
        value = jnp.zeros_like(v).at[:, at].add(force)[:, seen]
    return Load(value, (force * v[:, at]).sum(-1))


def _loads_on(top: Topology, coordinate: str) -> list[str]:
    """Name the actuators, then the springs, dampers and stops, that act on a coordinate."""
    at = top.position.get(coordinate)
    found = [
        (block.kind != EFFORT, name)
        for block in top.loads.forces
        for name, scalars in zip(block.names, block.scalars, strict=True)
        if at in scalars
    ]
    found += [(False, f.name) for f in top.loads.functions if f.acts == "effort" and f.at == at]
    return [name for _, name in sorted(found, key=lambda entry: entry[0])]


R = TypeVar("R")
_OTHERS = (Thing.RELATION, Thing.CONSTRAINT, Thing.COORDINATE)
"""Things whose wrench `Reactions.joint` returns where no joint has the name."""


def _in_one_program(f: Callable[..., R]) -> Callable[..., R]:
    """Compile a method's small steps as one program where numbers are traced; known ones are NumPy's."""
    compiled = filter_jit(f)

    @functools.wraps(f)
    def call(self: "Reactions", *args: object, **named: object) -> R:
        return (f if is_concrete(self) else compiled)(self, *args, **named)

    return as_its_system(call)


def all_parts(system: System, dyn: Dynamics, t: Array, q: Array, v: Array, a: Array, lam: Array) -> Parts:
    """Evaluate `Parts` of poses ``(P, …)``, with the frictions that belong to their multipliers."""
    return _all_parts(system, dyn, body_masses(system), t, q, v, a, lam)


@filter_jit
def _all_parts(
    system: System, dyn: Dynamics, masses: Masses, t: Array, q: Array, v: Array, a: Array, lam: Array
) -> Parts:
    def one(t, q, v, a, lam):
        found = pose_parts(system, dyn, t, q, v, a, lam, masses)
        return found._replace(friction=tuple(frictions(dyn, q, v, a, lam, t)))

    return jax.vmap(one)(t, q, v, a, lam)


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
        multipliers: Lagrange multipliers of all rows, ``(..., rows)``, last those of rows on velocities.
        efforts: efforts on driven and held coordinates, ``(..., inputs)``, N m or N.
    """

    motion: Motion
    multipliers: Array
    efforts: Array

    @as_its_system
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
        return self._name_wrenches(self._ledger(), _number(extended(self.motion.system).topology, body), about, frame)

    @as_its_system
    def all(self) -> dict[str, dict[str, Wrench]]:
        """All wrenches on every body, as `on` returns them, about the centre of mass of each."""
        ledger = self._ledger()
        return {body.name: self._name_wrenches(ledger, b, None, None) for b, body in enumerate(ledger.top.bodies)}

    @_in_one_program
    def at(self, point: str, on: str, frame: str | None = None) -> Wrench:
        """The wrench that passes into a body where it holds a point (and the vectors that it shares there).

        Args:
            point: a point of the body. Where it shares further points or vectors with the same neighbours, as along a
                hinge, or a joint of rows goes with it, these belong to the joint; the moment is about `point`.
            on: the body that is acted on.
            frame: a body whose axes the components are in; the ground's if not given.

        Returns:
            The wrench, with the loads and masses at the point. Where the body alone holds the point, it is that of the
            joints which act there, each as a whole, as `joint` gives it about the point, and the pull of cables and
            inputs on it. A weld acts at the point that its bodies share; where they share none ask `joint` for it.

        Raises:
            InputError: an unknown body, or a point that it does not have.
        """
        top = extended(self.motion.system).topology
        b = _number(top, on)
        if point not in top.points or top.points.index(point) not in top.bodies[b].points:
            names = [top.points[p] for p in top.bodies[b].points]
            raise InputError(f"body {on!r} has no point {point!r}; {nearest(point, names)}")
        ledger, p = self._ledger(), top.points.index(point)
        return self._in_frame(self._move_to(ledger.at(b, p), ledger.points[..., p, :]), frame)

    @_in_one_program
    def joint(self, name: str, on: str, about: str | None = None, frame: str | None = None) -> Wrench:
        """The wrench of a joint that writes rows on a body, with all that belongs to it: one for a physical joint.

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
        ledger, first = self._ledger(), top.bodies[b].points[0] if about is None else _point(top, about)
        return self._in_frame(self._move_to(ledger.press_on(b, owner), ledger.points[..., first, :]), frame)

    @_in_one_program
    def support(self, point: str) -> Array:
        """Force of the ground on a point in its fixed coordinates, ``(..., dim)``; zero in the others."""
        top = extended(self.motion.system).topology
        p = _point(top, point)
        at = slice(p * top.dim, (p + 1) * top.dim)
        fixed = np.array(top.fixed[at])
        whole = self._whole()[..., at]
        elsewhere = jnp.reshape(self._ledger().grounded.get(p, 0.0) + whole.reshape(-1, top.dim) * 0.0, whole.shape)
        return jnp.where(fixed & (self.motion.status == 0)[..., None], whole - elsewhere, 0.0)

    @_in_one_program
    def load(self, name: str) -> Load:
        """The effect of a spring, damper, stop, force, torque or friction by its name: a spring's tension, its power.

        Args:
            name: as it was given when it was added; where a friction is called as a force, ``"friction rub"`` or
                ``"force rub"``.

        Returns:
            Its value, N or N m (what it means for which load: `jaxnc.dynamics.reactions.Load`), and the power that it
            gives to the mechanism, W ``(...,)``.

        Raises:
            InputError: there is none of this name, or a force and a friction have it.
        """
        dyn, _, _, v, *_ = self._flat()
        found = _load_by_name(dyn.topology, self._parts(), v, name, shown_places(self.motion.system.topology))
        return Load(*(x.reshape((*self.motion.status.shape, *x.shape[1:])) for x in found))

    def effort(self, name: str) -> Array:
        """Effort of the input on a driven or held coordinate: a torque on an angle, the thrust of a leg, ``(...,)``.

        Raises:
            InputError: the coordinate is not driven in this motion. A torque of `m.torque` is no input but a load: its
                value is that of `load`.
        """
        names = (*self.motion.driven, *self.motion.held)
        if name not in names:
            top = self.motion.system.topology
            if loads := _loads_on(top, name):
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
        names = [*top.rows, *top.rate_rows]
        often = Counter(names)  # each name is there once in the end
        called = [f"{name} (row {k + 1})" if often[name] > 1 else name for k, name in enumerate(names)]
        return {called[k]: self.multipliers[..., k] for k in chosen}

    @as_its_system
    def unique(self) -> dict[str, bool]:
        """Which reactions and efforts equilibrium alone determines, in the first pose; the rest are of least norm.

        Returns:
            By name: ``"B on coupler"`` for what `at` gives, joints that write rows, points with fixed coordinates
            (their `support`), and driven and held coordinates (their effort); ``"joint phi"`` and ``"coordinate phi"``
            where two have one name.
        """
        outside(self.motion, "unique()")
        motion, system = self.motion, extended(self.motion.system)
        top, dyn = system.topology, dynamics(system)
        if not self.motion.status.size:
            raise InputError("unique() says it of the first pose, and this motion has none")
        q = self._q.reshape(-1, self._q.shape[-1])[0]
        view = plan(top, motion.driven, motion.held)
        inner = np.asarray(evaluate(dyn.eq, q)[1])[view.rows][:, view.unknown]
        left, values, _ = np.linalg.svd(inner)
        least = limits(inner).balance
        rank = int(np.sum(values > 0.1 * least * values[0])) if len(values) else 0
        # Self-stress: multipliers that put no force on what moves. A reaction is unique if none of them reaches it.
        stress = np.zeros((left.shape[1] - rank, len(top.rows) + len(top.rate_rows)))
        stress[:, view.rows] = left[:, rank:].T
        reached = _stress_reaches(dyn, view, q, stress)
        sizes = {name: float(np.abs(x).max(initial=0.0)) for name, (x, _) in reached.items()}
        most = least * max(1e-6, *sizes.values()) if sizes else 0.0
        return {name: sizes[name] <= most and not loose for name, (_, loose) in reached.items()}

    # -- inside ---------------------------------------------------------------------------------------------------

    @property
    def _q(self) -> AnyArray:
        return self._states()[2]

    def _states(self) -> tuple[Dynamics, AnyArray, AnyArray, AnyArray, AnyArray]:
        """Return equations of motion, times and states; those of a page come with other equations."""
        return states_of(self.motion)

    def _flat(self) -> tuple[Dynamics, AnyArray, AnyArray, AnyArray, AnyArray, AnyArray]:
        """Return equations of motion, and times, states and multipliers of all poses, one after another."""
        dyn, t, *states = self._states()
        q, v, a, lam = (x.reshape(t.size, x.shape[-1]) for x in (*states, self.multipliers))
        return dyn, t.reshape(-1), q, v, a, lam

    def _parts(self) -> Parts:
        return all_parts(extended(self.motion.system), *self._flat())

    def _ledger(self) -> Ledger:
        """All wrenches of all poses, one after another."""
        dyn, _, q, *_ = self._flat()
        found = self._parts()
        at = [dyn.topology.position[name] for name in (*self.motion.driven, *self.motion.held)]
        at = [c for c in at if c < len(dyn.topology.coordinates) - len(dyn.topology.scalars)]
        whole = self._whole().reshape(q.shape) if at else q
        efforts = {c: whole[:, c] for c in at}  # of angles and distances they are in their rows
        if not any(isinstance(x, Tracer) for x in jax.tree.leaves((found, efforts))):
            found, efforts = jax.tree.map(np.asarray, (found, efforts))
        return Ledger(dyn.topology, found, efforts)

    def _name_wrenches(self, ledger: Ledger, b: int, about: str | None, frame: str | None) -> dict[str, Wrench]:
        place = ledger.centre(b) if about is None else ledger.points[..., _point(ledger.top, about), :]
        return {
            " ".join(key).strip(): self._in_frame(self._move_to(wrench, place), frame)
            for key, wrench in ledger.wrenches[b].items()
        }

    def _move_to(self, wrench: tuple[Numbers, Numbers], place: Numbers) -> Wrench:
        """Return a wrench about the origin as one about places ``(P, dim)``, in the shape of the motion.

        Of a pose that was not found nothing is known, and the wrench is zero.
        """
        found = []
        for x in (wrench[0], wrench[1] - cross(place, wrench[0])):
            x = jnp.asarray(x.reshape((*self.motion.status.shape, *x.shape[1:])))
            good = jnp.reshape(
                self.motion.status == 0, (*self.motion.status.shape, *[1] * (x.ndim - self.motion.status.ndim))
            )
            found.append(jnp.where(good, x, 0.0))
        return Wrench(*found)

    def _whole(self) -> Array:
        """Return what holds the fixed coordinates: M q̈ + Φ_qᵀ λ - Q."""
        found = _open_forces(*self._flat())
        return found.reshape((*self.motion.status.shape, found.shape[-1]))

    def _in_frame(self, wrench: Wrench, frame: str | None) -> Wrench:
        if frame is None:
            return wrench
        inner = extended(self.motion.system)
        body = inner.topology.bodies[_number(inner.topology, frame)]
        axes = turns(inner.topology, body.segments, dynamics(inner).eq.home, self._q)
        turned = functools.partial(jnp.einsum, "...ji,...j->...i", axes)
        return Wrench(turned(wrench.force), wrench.moment if inner.topology.dim == 2 else turned(wrench.moment))


@filter_jit
def _open_forces(dyn: Dynamics, t: Array, q: Array, v: Array, a: Array, lam: Array) -> Array:
    """Evaluate `open_forces` of poses ``(P, N)``."""
    return jax.vmap(lambda t, q, v, a, lam: open_forces(dyn, t, q, v, a, lam))(t, q, v, a, lam)


def open_forces(
    dyn: Dynamics, t: Array, q: Array, v: Array, a: Array, lam: Array, rubbing: Array | None = None
) -> Array:
    """Return what rows and known forces leave open in one pose: efforts of inputs, and what holds the ground.

    `rubbing` are the forces of friction, if they are known.
    """
    top = dyn.topology
    out = dyn.mass @ a + row_forces(dyn.eq, np.arange(len(top.rows)), q, lam) - forces(dyn, t, q, v)
    if top.rates:
        out = out + lam[len(top.rows) :] @ coefficients(top, dyn.rates, q)
    if rubbing is None and has_friction(dyn):
        rubbing = friction_forces(dyn, q, v, a, lam, t)
    return out if rubbing is None else out - rubbing


def _stress_reaches(dyn: Dynamics, view: Plan, q: Array, stress: np.ndarray) -> dict[str, tuple[np.ndarray, bool]]:
    """Return what multipliers ``(k, rows)`` alone put on joints, supports and inputs, named as by `unique`.

    Beside each stands whether something is open there all the same.
    """
    top, count = dyn.topology, len(stress) + 1
    rest = jnp.zeros((count, len(q)))
    lam = jnp.concatenate([stress, jnp.zeros((1, stress.shape[1]))])
    parts = all_parts(dyn.system, dyn, jnp.zeros(count), jnp.broadcast_to(q, rest.shape), rest, rest, lam)
    ledger = Ledger(top, jax.tree.map(np.asarray, parts), {})
    out: list[tuple[Owner | None, str, np.ndarray, bool]] = []
    # A couple that a vector shared in a loop leaves open is there without any multiplier.
    shaken = {
        ledger.key(b, group)
        for b in range(len(top.bodies))
        for group in shared_groups(top, b)
        if not all(vector_tree(top, i)[1] for i in group.items if i < 0)
    }
    # So is a pull between two fixed points of a body: no row is written for their distance.
    still = {p for p in range(len(top.points)) if all(top.fixed[p * top.dim : (p + 1) * top.dim])}
    pulled = [ends if len(ends := still.intersection(body.points)) > 1 else set() for body in top.bodies]
    strained = set().union(*pulled)
    for b, body in enumerate(top.bodies):
        for p in body.points:
            passing = ledger.through(b, p)
            if passing is None or not (len(item_holders(top)[p]) > 1):
                continue
            force, moment = ledger.wrenches[b][passing[0]]
            moment = moment - cross(ledger.points[:, p], force)
            wrench = np.concatenate([force, moment.reshape(count, -1)], axis=1)
            loose = passing[0] in shaken or p in pulled[b]
            out.append((None, f"{top.points[p]} on {body.name}", wrench[:-1] - wrench[-1], loose))
    for j, joint in enumerate(top.joints):
        at = joint_rows(top, j)
        if len(at):
            # Forces along a vector that rows hold give no couple: what counts is the wrench, where a body has it.
            on_body = [found[key_of(joint)] for found in ledger.wrenches if key_of(joint) in found]
            if on_body and key_of(joint) in ledger.held_whole:
                pull = np.concatenate([np.reshape(part, (count, -1)) for part in on_body[0]], axis=1)
                pull = pull[:-1] - pull[-1]
            else:
                pull = jax.vmap(lambda x, at=at: row_forces(dyn.eq, at, q, x))(jnp.asarray(stress))
            out.append((joint.owner, "", np.asarray(pull), key_of(joint) in shaken))
    whole = np.asarray(jax.vmap(lambda x: row_forces(dyn.eq, np.arange(len(top.rows)), q, x))(jnp.asarray(stress)))
    for p in range(len(top.points)):
        fixed = [c for c in range(p * top.dim, (p + 1) * top.dim) if top.fixed[c]]
        if fixed and any(p in b.points for b in top.bodies):
            out.append((Owner(Thing.POINT, p), "", whole[:, fixed], p in strained))
    first = len(top.coordinates) - len(top.scalars)
    for c in map(int, view.known):
        owner = Owner(Thing.COORDINATE, c - first) if c >= first else None
        out.append((owner, "" if owner else top.coordinates[c], whole[:, c], False))
    names = addresses(top.names, [(owner, key) for owner, key, *_ in out])
    return {name: (force, loose) for name, (_, _, force, loose) in zip(names, out, strict=True)}


@as_its_system
def motion_reactions(motion: Motion, multipliers: Array) -> Reactions:
    """Return the reactions of a motion with its multipliers, with the efforts that its inputs then take."""
    found = Reactions(motion, multipliers, jnp.zeros((*motion.status.shape, len(motion.driven) + len(motion.held))))
    if not found.efforts.size:
        return found
    position = extended(motion.system).topology.position
    at = np.array([position[name] for name in (*motion.driven, *motion.held)])
    efforts = jnp.where((motion.status == 0)[..., None], found._whole()[..., at], 0.0)
    return Reactions(motion, multipliers, efforts)


def states_of(motion: Motion) -> tuple[Dynamics, AnyArray, AnyArray, AnyArray, AnyArray]:
    """Return equations of motion, times, and poses, rates and accelerations in the coordinates of the dynamics.

    The latter are NumPy's where they are known.
    """
    system = motion.system
    t = np.zeros(motion.status.shape) if motion.time is None else motion.time
    given: AnyArray = motion.q, motion.rates[0], motion.rates[1]
    if is_concrete(given):
        given = tuple(map(np.asarray, given))
    flat = (x.reshape(-1, x.shape[-1]) for x in given)
    q, v, a = (x.reshape(*given[0].shape[:-1], x.shape[-1]) for x in lift_states(system.topology, *flat))
    return dynamics(extended(system)), t, q, v, a


def _number(top: Topology, name: str) -> int:
    names = [b.name for b in top.bodies]
    if name not in names:
        raise InputError(f"{top.name!r} has no body {name!r}; {nearest(name, names)}")
    return names.index(name)


def _point(top: Topology, name: str) -> int:
    if name not in top.points:
        raise InputError(f"{top.name!r} has no point {name!r}; {nearest(name, top.points)}")
    return top.points.index(name)


# -- inverse dynamics -------------------------------------------------------------------------------------------------


@public
@record
class InverseDynamics(Reactions):
    """Reactions of a prescribed motion, with the efforts that it takes: M q̈ + Φ_qᵀ λ = Q + efforts.

    ``result["phi"]`` is the effort on the driven coordinate phi, a torque on an angle, a force on a distance.
    """

    def __getitem__(self, name: str) -> Array:
        """Effort on a driven or held coordinate, ``(...,)``."""
        return self.effort(name)

    @property
    def power(self) -> Array:
        """Power of all efforts together, W, ``(...,)``."""
        top = self.motion.system.topology
        at = [top.position[name] for name in (*self.motion.driven, *self.motion.held)]
        return jnp.sum(self.efforts * self.motion.rates[0][..., jnp.array(at, dtype=int)], axis=-1)

    @property
    def reactions(self) -> Reactions:
        """Reactions in the joints."""
        return self


@public
@as_its_system
def inverse_dynamics(system: System, motion: Motion) -> InverseDynamics:
    """Find the efforts of the inputs for a prescribed motion, and the reactions in every joint.

    Args:
        system: the system; its bodies have masses. It may be the motion's own, or one with other masses and forces;
            of a motion without inputs nothing takes what those do not fit, and wrenches then miss it.
        motion: poses with velocities and accelerations: of `jaxnc.motion`, or of `jaxnc.sweep` with rates.

    Returns:
        Efforts, multipliers and reactions, differentiable. Where a pose failed they are zero.

    Raises:
        InputError: a motion without rates; nothing has a mass.

    Source: J. García de Jalón, E. Bayo, Kinematic and Dynamic Simulation of Multibody Systems, ch. 6.
    """
    check_loads(system, "inverse_dynamics()")
    if not isinstance(motion, Motion):
        raise InputError(f"inverse_dynamics() needs a motion, of motion() or sweep(); got {type(motion).__name__}")
    if len(motion.rates) < 2:
        raise InputError(
            "inverse_dynamics needs velocities and accelerations: make the motion with motion(system, {'phi': f}, t) "
            "or pass rates= to sweep"
        )
    if motion.q.shape[-1] != len(system.topology.coordinates):
        raise InputError(
            f"inverse_dynamics(): the motion is one of {motion.system.name!r}, and {system.name!r} has other "
            f"coordinates; give inverse_dynamics(motion.system, motion), or the same mechanism with other masses"
        )
    # One that failed in all poses, such as a design that does not assemble, passes no derivative on.
    status = motion.status if isinstance(motion.status, Tracer) else np.asarray(motion.status)
    system, motion = hold_still((status == 0).any(), (system, motion))
    inner = extended(system)
    dyn = dynamics(inner)
    view = plan(inner.topology, motion.driven, motion.held)
    if len(motion.driven) + len(motion.held) + len(inner.topology.rate_rows) > system.degrees_of_freedom:
        refuse_rates(
            inner.topology,
            "inverse_dynamics",
            "with every freedom driven nothing says which part of a force they take. Drive as many fewer in "
            "simulate(inputs=) and hand over that run",
        )
    t = 0.0 if motion.time is None else motion.time
    flow = Flow(dyn, view, (), len(view.rows) + len(dyn.topology.rate_rows) > len(view.unknown))
    efforts, lam, slides = _inverse(system, flow, t, motion.q, *motion.rates[:2], motion.status == 0)
    if not isinstance(slides, Tracer) and not slides.all():
        first = int(np.flatnonzero(~np.asarray(slides))[0])
        names = ", ".join(repr(f.name) for f in dyn.topology.loads.friction)
        raise AssemblyError(
            f"inverse_dynamics: {system.name!r} locks in pose {first}: no force overcomes the friction of {names}; "
            f"take a smaller coefficient or radius"
        )
    if system is not motion.system:  # reactions are those of the masses and forces that were asked for
        motion = dataclasses.replace(motion, system=system)
    return InverseDynamics(motion, lam, efforts)


@filter_jit
def _inverse(system: System, flow: Flow, t: ArrayLike, q: Array, v: Array, a: Array, ok: Array):
    """Find efforts and multipliers of poses ``(..., N)``; zero of poses that are not `ok`."""
    top, lead, dyn, view = system.topology, q.shape[:-1], flow.dyn, flow.view
    t, ok = jnp.broadcast_to(t, lead).reshape(-1), ok.reshape(-1, 1)
    states = lift_states(top, *(x.reshape(-1, x.shape[-1]) for x in (q, v, a)))
    weight, size, inner = flow.scale()

    def one(t, x, dx, ddx):
        right = forces(dyn, t, x, dx) - dyn.mass @ ddx
        solve = saddle(inner + 1e-6 * jnp.eye(len(weight)), flow.rows(x, dx).unknown / weight, flow.redundant)

        def multipliers(right):
            y = solve(right[view.unknown] / (weight * size), flow.zero_multipliers())[1]
            return flow.place_multipliers(y * size)

        def respond(rubbing: Array) -> tuple[Array, Array, Array]:
            lam = multipliers(right + rubbing)
            return ddx, lam, lam

        if has_friction(dyn):
            rubbing, lam, slides = balance_friction(dyn, t, x, dx, respond)
        else:
            rubbing, lam, slides = jnp.zeros_like(x), multipliers(right), jnp.array(True)
        return open_forces(dyn, t, x, dx, ddx, lam, rubbing)[view.known], lam, slides

    *found, slides = jax.vmap(one)(t, *states)
    efforts, lam = (jnp.where(ok, x, 0.0).reshape(*lead, x.shape[-1]) for x in found)
    return efforts, lam, slides | ~ok[:, 0]


@public
def reactions(motion: Motion | Reactions) -> Reactions:
    """The reactions in the joints of a simulation, or of a motion that its inputs drive.

    Args:
        motion: a simulation, a motion with rates (its inputs then take the efforts that it needs), or the result of
            `jaxnc.inverse_dynamics`.

    Returns:
        The reactions; ``.at("B", on="coupler")`` is the wrench on a body at a shared point.
    """
    refuse_fork()
    if isinstance(motion, Reactions):
        return motion
    if not isinstance(motion, Motion):
        raise InputError(f"reactions() takes a simulation, or a motion with rates, got {type(motion).__name__}")
    multipliers = getattr(motion, "multipliers", None)  # of a simulation
    if multipliers is not None:
        check_parameters(motion.system)
        return motion_reactions(motion, multipliers)
    return inverse_dynamics(motion.system, motion).reactions


# -- forces at their places -------------------------------------------------------------------------------------------

KINDS = ("weight", "applied", "reaction")
"""Forces that are drawn: gravity; springs, dampers, stops and loads; what joints and the ground do."""


def nodal_forces(found: Reactions) -> dict[str, tuple[Array, Array]]:
    """Return where forces act in the poses of a motion with rates, and how large they are, N.

    Args:
        found: the reactions of a simulation, or of a motion that carries rates.

    Returns:
        By kind, places and forces, each ``(..., arrows, dim)``. A weight acts at the centre of mass, what is applied at
        the points. A reaction is that of the ground on a fixed point, and where bodies share a point, what the first of
        them feels; joints that write rows of their own, and efforts on angles, have none.
    """
    motion = found.motion
    dyn, t, q, v, _ = found._states()
    top = dyn.topology
    count = len(motion.system.topology.points)
    places = spread(top, q)[0][..., :count, :]
    applied = _apply_loads(dyn, t.reshape(-1), *(x.reshape(-1, q.shape[-1]) for x in (q, v))).reshape(q.shape)
    none = places[..., :0, :]  # of a mechanism without masses
    centres, weights = [none], [none]
    for at, _, first, masses in inertias(extended(motion.system)):
        moments = jnp.einsum("...bk,bdk->...bd", q[..., at], first)
        heavy = masses > 0
        centres.append(jnp.where(heavy[:, None], moments / jnp.where(heavy, masses, 1.0)[:, None], 0.0))
        weights.append(jnp.broadcast_to(masses[:, None] * dyn.gravity, centres[-1].shape))
    shared = _shared_points(found)
    held = [
        found.support(top.points[point]) if on is None else found.at(top.points[point], on).force
        for point, on in shared.items()
    ]
    return {
        "weight": (jnp.concatenate(centres, axis=-2), jnp.concatenate(weights, axis=-2)),
        "applied": (places, spread(top, applied)[0][..., :count, :]),
        "reaction": (places[..., list(shared), :], jnp.stack([*held, places[..., 0, :] * 0.0], axis=-2)[..., :-1, :]),
    }


@filter_jit
def _apply_loads(dyn: Dynamics, t: Array, q: Array, v: Array) -> Array:
    """Return what springs, dampers, stops and loads put on all coordinates of poses ``(P, N)``."""
    return jax.vmap(lambda t, q, v: forces(dyn, t, q, v) - dyn.gravity @ dyn.moments)(t, q, v)


def _shared_points(found: Reactions) -> dict[int, str | None]:
    """Return points that bodies share, with the first of them, and fixed points, with None."""
    top = found.motion.system.topology
    out: dict[int, str | None] = {}
    for p in range(len(top.points)):
        holders = [b.name for b in top.bodies if p in b.points]
        fixed = np.array(top.fixed[p * top.dim : (p + 1) * top.dim])
        if fixed.any():
            out[p] = None
        elif len(holders) > 1:
            out[p] = holders[0]
    return out
