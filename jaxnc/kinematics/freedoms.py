"""Freedoms by name: those hardly meant, what locks a mechanism, and which joints hold it more than they need to.

For the last, bodies and joints of a spatial mechanism are looked at as twists, which gives Grübler's count too. What
bodies share in natural coordinates (a point, a vector, two points) is a joint that no row shows. Here every body
gets its own six velocities (a bar five), every joint, shared or written, the conditions it puts on them; so joints can
be counted, and exchanged for others, one by one.
"""

import dataclasses
import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc.errors import counted
from jaxnc.solvers.assembly import derive, evaluate, free_plan, rank_of, sample_poses, settle, to_host
from jaxnc.solvers.plan import plan
from jaxnc.system.equations import Equations
from jaxnc.system.frames import spread
from jaxnc.system.identity import GROUND, Owner, Thing
from jaxnc.system.precision import widened
from jaxnc.system.system import System, unheld
from jaxnc.system.topology import JointIndex, Topology

if TYPE_CHECKING:
    from jaxnc.system.topology import BodyIndex

_STILL = 1e-6  # of the largest velocity
_LISTED = 6  # names that a sentence gives
_LOCKING = (Thing.BODY, Thing.JOINT, Thing.RELATION, Thing.CONSTRAINT)


@widened
def loose_motions(system: System, driven: Sequence[str]) -> list[str]:
    """Name what can still move without anything else: bodies that spin about their own line, and what nothing holds.

    Returns:
        For each such body a phrase that names it and its line, and a coordinate that would hold it; also points and
        vectors that nothing holds at all.
    """
    top = system.topology
    stray = unheld(top)
    eq = derive(system)
    q, *_ = settle(eq, np.zeros(len(top.coordinates)))
    view = plan(top, tuple(driven))
    weight = to_host(eq).weights
    _, null = rank_of(np.asarray(evaluate(eq, q)[1])[np.ix_(view.rows, view.unknown)] / weight[view.unknown])
    found = []
    for body in top.bodies:
        spin = _own_spin(system, np.asarray(q), body)
        if spin is None:
            continue
        change, line = spin[0] * weight, spin[1]
        size = np.linalg.norm(change[view.unknown])
        if size == 0.0 or np.abs(change[view.known]).max(initial=0.0) > _STILL * size:
            continue
        rest = change[view.unknown] - null.T @ (null @ change[view.unknown])
        others = np.delete(change, view.unknown)
        if np.linalg.norm(rest) <= _STILL * size and np.abs(others).max(initial=0.0) <= _STILL * size:
            name = top.coordinates[int(np.argmax(np.abs(change)))]
            found.append(f"body {body.name!r} can spin about its own line {line} (hold or drive {name!r})")
    return [*stray, *found]


@widened
def explain_lock(system: System) -> list[str]:
    """Name the bodies, joints and equations that lock a mechanism together, and as few as possible to leave out.

    Returns:
        One sentence; none where the mechanism moves, is large, or stands still without any of them.
    """
    top = system.topology
    if top.large:
        return []
    sample, view = sample_poses(system, 1)[0], free_plan(top)
    if sample.rank < len(view.unknown):
        return []
    owners = [set(top.row_owners[i]) for i in view.rows]
    things = sorted(o for o in top.owners if o.thing in _LOCKING)

    def count_freed(without: set[Owner]) -> int:
        rest = sample.jacobian[[k for k, of in enumerate(owners) if not of or not of <= without]]
        return len(view.unknown) - (rank_of(rest)[0] if len(rest) else 0)

    # Of equals the one that was added last is the likely slip. Where several are too many, the last go first.
    without: list[Owner] = []
    while not (unlocking := {o: n for o in things if o not in without and (n := count_freed({*without, o}))}):
        if len(without) == len(things):
            return []
        without.append(next(o for o in reversed(things) if o not in without))
    least = min(unlocking.values())
    *others, last = [o for o, gained in unlocking.items() if gained == least]
    for o in list(without):
        if count_freed({*without, last} - {o}):
            without.remove(o)
    least = count_freed({*without, last})
    rest, out = ([f"{o.thing.noun} {top.called(o)!r}" for o in some] for some in (others, sorted([last, *without])))
    also = f" (or {', '.join(rest[:_LISTED])}{', …' if len(rest) > _LISTED else ''})" if others and not without else ""
    freedoms = counted(least, "degree of freedom", "degrees of freedom")
    locks = [*rest[:_LISTED], *out]
    together = f"{', '.join(locks)} lock each other" if len(locks) > 1 else f"{locks[0]} locks it"
    return [f"{together}; leave out {' and '.join(out)}{also} and it has {freedoms}"]


@widened
def undriven_freedoms(system: System) -> list[str]:
    """Name what still moves while every angle and distance of a mechanism is driven; none where nothing does."""
    top = system.topology
    view = free_plan(top)
    if top.large or not top.scalars or loose_motions(system, ()):  # these have been named by themselves
        return []
    sample = sample_poses(system, 1)[0]
    scalars = np.asarray(view.unknown) >= len(top.coordinates) - len(top.scalars)
    null = rank_of(np.concatenate([sample.jacobian, np.eye(len(view.unknown))[scalars]]))[1]
    if not len(null):
        return []
    moving = np.zeros(len(top.coordinates))
    moving[view.unknown] = np.abs(null).max(axis=0)
    points = moving[: len(top.points) * top.dim].reshape(-1, top.dim).max(axis=1) > _STILL
    bodies = [b.name for b in top.bodies if any(points[i] for i in b.points)]
    names = bodies or [name for name, moves in zip(top.points, points, strict=True) if moves]
    if not names:
        return []
    count = counted(len(null), "degree of freedom", "degrees of freedom")
    return [
        f"with {', '.join(top.scalars[:_LISTED])} driven {count} would be left, of {', '.join(names[:_LISTED])}: "
        f"a body or a joint is missing there, or drive or hold as many coordinates more"
    ]


def _own_spin(system: System, q: np.ndarray, body: "BodyIndex") -> tuple[np.ndarray, str] | None:
    """Find the velocity of all coordinates while one body turns about the line between the joints that hold it."""
    top = system.topology
    if top.dim != 3 or len(body.segments) < 2:
        return None
    count = len(top.points)
    points = q[: 3 * count].reshape(-1, 3)
    vectors = q[3 * count : 3 * (count + len(top.vectors))].reshape(-1, 3)
    others = [b for b in top.bodies if b is not body]
    tied = {i for b in others for i in b.points} | {i for joint in top.joints for i in joint.points}
    tied |= {i for i in range(count) if any(top.fixed[3 * i : 3 * i + 3])}
    held = [i for i in body.points if i in tied]
    shared = [k for k in body.vectors if top.fixed[3 * (count + k)] or any(k in b.vectors for b in others)]
    axes = [(i, vectors[k], top.vectors[k]) for i in held[:1] for k in shared]
    axes += [(i, points[j] - points[i], f"{top.points[i]}-{top.points[j]}") for i in held for j in held if i < j]
    size = np.ptp(points, axis=0).max(initial=0.0)
    ways = ((i, way, line) for i, way, line in axes if np.linalg.norm(way) > 1e-9 * size)  # not of joints at one place
    start, way, line = next(ways, (0, None, ""))
    if way is None:
        return None
    direction = way / np.linalg.norm(way)
    change = np.zeros(len(q))
    for i in body.points:
        change[3 * i : 3 * i + 3] = np.cross(direction, points[i] - points[start])
    for k in body.vectors:
        at = 3 * (count + k)
        change[at : at + 3] = np.cross(direction, vectors[k])
    return change, line


# -- bodies and joints as twists --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class JointTwists:
    """A joint and its conditions on the velocities of all bodies."""

    name: str  # what it is called in reports
    rows: np.ndarray  # conditions, (conditions, velocities)
    # The two bodies it joins (`GROUND` for the ground), None where it ties more or fewer.
    bodies: tuple[int, int] | None = None
    point: np.ndarray | None = None  # a point of it, and
    axis: np.ndarray | None = None  # a direction of it, None where it has none


_twist_rank = functools.partial(np.linalg.matrix_rank, rtol=1e-7)  # 1e-7 of the largest singular value is none


class Freedoms:
    """Bodies and joints of a spatial mechanism in one pose."""

    def __init__(self, top: Topology, eq: Equations, q: np.ndarray):
        self.eq, self.top, self.q = eq, top, np.asarray(q)
        at: Any = self.q
        points, vectors = (np.asarray(x) for x in spread(top, at))
        self.size = float(eq.length)
        self.points, self.vectors = (points - points.mean(axis=0)) / self.size, vectors
        fixed = np.array(top.fixed[: 3 * (len(points) + len(vectors))]).reshape(-1, 3)
        self.fixed = {i: fixed[i] for i in range(len(points))} | {
            ~k: fixed[len(points) + k] for k in range(len(vectors))
        }
        self.ground = {i for i, f in self.fixed.items() if f.all()}
        self.items = [{*b.points, *(~k for k in b.vectors)} for b in top.bodies]
        self.moving = [k for k, items in enumerate(self.items) if not items <= self.ground]
        self.first = {body: 6 * place for place, body in enumerate(self.moving)}
        held = set().union(*self.items) if self.items else set()
        self.loose = [i for i in self.fixed if i not in held and i not in self.ground]
        first = 6 * len(self.moving)
        self.place = {item: first + 3 * k for k, item in enumerate(self.loose)}
        self.scalars = first + 3 * len(self.loose)
        self.count = self.scalars + len(top.scalars)
        self.joints = [*self._shared_joints(), *self._written_joints()]

    @property
    def grubler(self) -> int:
        """Freedoms by Grübler's count: velocities of the bodies less the conditions of each joint by itself."""
        return int(self.count - sum(_twist_rank(joint.rows) for joint in self.joints))

    # -- velocities ---------------------------------------------------------------------------------------------

    def velocity(self, item: int, body: int | None) -> np.ndarray:
        """Velocity of a point (rate of a vector) of a body, ``(3, velocities)``; of its own where it is loose."""
        out = np.zeros((3, self.count))
        if body is None:
            if item in self.place:
                out[:, self.place[item] : self.place[item] + 3] = np.eye(3)
            return out
        if body in self.first:
            at = self.first[body]
            arm = self.points[item] if item >= 0 else self.vectors[~item]
            if item >= 0:
                out[:, at : at + 3] = np.eye(3)
            out[:, at + 3 : at + 6] = np.cross(np.eye(3), arm).T
        return out

    # -- joints -------------------------------------------------------------------------------------------------

    def _shared_joints(self) -> Iterator[JointTwists]:
        """The joints that sharing makes, and what a bar does not know."""
        top = self.top
        for place, body in enumerate(self.moving):
            name, left = top.bodies[body].name, set(self.items[body])
            fixed = {i for i in left if self.fixed[i].any()}
            # With whom it shares most first, so that a hinge through a point of the ground stays one joint.
            while left:
                other = max(self.moving[:place], key=lambda k: len(left & self.items[k]), default=None)
                shared = set() if other is None else left & self.items[other]
                if other is not None and len(shared) > len(fixed):
                    common = sorted(shared)
                    rows = np.vstack([self.velocity(i, body) - self.velocity(i, other) for i in common])
                    yield self._joint(f"of {top.bodies[other].name} and {name}", rows, (body, other), common)
                    left -= shared
                    fixed -= shared
                elif fixed:
                    rows = np.vstack([self.velocity(i, body)[self.fixed[i]] for i in sorted(fixed)])
                    yield self._joint(f"of {name} and the ground", rows, (body, GROUND), sorted(fixed))
                    left -= self.ground  # what is fixed in part, others may hold further
                    fixed = set()
                else:
                    break
            segments = top.bodies[body].segments
            if len(segments) == 1:
                row = np.zeros((1, self.count))
                at = self.first[body] + 3
                row[0, at : at + 3] = self._direction(segments[0])
                yield JointTwists(f"{name} (a bar)", row)
        for item in self.loose:
            if self.fixed[item].any():
                yield JointTwists("fixed coordinate", self.velocity(item, None)[self.fixed[item]])

    def _joint(self, name: str, rows: np.ndarray, bodies: tuple[int, int], items: list[int]) -> JointTwists:
        points = [i for i in items if i >= 0]
        vectors = [i for i in items if i < 0]
        point = self.points[points[0]] if points else None
        axis = None
        if vectors:
            axis = self.vectors[~vectors[0]]
        elif len(points) > 1:
            axis = self._direction((points[0], points[1]))
        at = ", ".join([self.top.points[i] for i in points] + [self.top.vectors[~i] for i in vectors])
        return JointTwists(f"{name} at {at}", rows, bodies, point, axis)

    def _direction(self, segment: tuple[int, ...]) -> np.ndarray:
        if len(segment) == 1:
            return self.vectors[~segment[0]]
        d = self.points[segment[1]] - self.points[segment[0]]
        return d / np.linalg.norm(d)

    def _written_joints(self) -> Iterator[JointTwists]:
        """The joints, coordinates and relations that rows are written for."""
        top = self.top
        matrix = np.asarray(evaluate(self.eq, self.q)[1])
        motion = np.zeros((len(top.coordinates), self.count))
        for item in self.fixed:
            at = 3 * (item if item >= 0 else len(top.points) + ~item)
            scale = self.size if item >= 0 else 1.0
            holder = next((k for k, items in enumerate(self.items) if item in items), None)
            motion[at : at + 3] = scale * self.velocity(item, holder)
        start = len(top.coordinates) - len(top.scalars)
        motion[start:, self.scalars :] = np.eye(len(top.scalars))
        groups: dict[Owner, list[int]] = {}
        for row, owners in enumerate(top.row_owners):
            others = [owner for owner in owners if owner.thing is not Thing.BODY]
            if others:  # of a body alone it says nothing: its twist keeps it
                groups.setdefault(others[0], []).append(row)
        noted = {j.owner: j for j in top.joints}
        for owner, rows in groups.items():
            yield self._written_joint(owner, matrix[rows] @ motion / self.size, noted.get(owner))

    def _written_joint(self, owner: Owner, rows: np.ndarray, noted: JointIndex | None) -> JointTwists:
        """A written joint; with its two bodies where its conditions are on just two."""
        called = self.top.called(owner)
        name = called if noted is None else f"{noted.type} joint {called!r}"
        touched = [k for k in self.moving if np.abs(rows[:, self.first[k] : self.first[k] + 6]).max() > 1e-12]
        if noted is None or np.abs(rows[:, 6 * len(self.moving) :]).max(initial=0.0) > 1e-12 or len(touched) > 2:
            return JointTwists(name, rows)
        bodies = (touched[0], touched[1]) if len(touched) == 2 else (touched[0], GROUND) if touched else None
        axis = self.vectors[noted.vectors[0]] if noted.vectors else None
        if axis is None and len(noted.points) > 1:
            d = self.points[noted.points[-1]] - self.points[noted.points[0]]
            axis = d / np.linalg.norm(d) if np.linalg.norm(d) > 1e-9 else None
        point = self.points[noted.points[0]] if noted.points else None
        return JointTwists(name, rows, bodies, point, axis)

    # -- proposals ----------------------------------------------------------------------------------------------

    def proposals(self) -> list[str]:
        """Joints that can be exchanged for freer ones until nothing is held twice, the motion staying what it is.

        One sentence for each; empty if nothing is held twice or if no exchange of single joints helps.
        """
        joints = list(self.joints)
        full = _twist_rank(np.vstack([j.rows for j in joints]))
        changed: dict[int, tuple[str, int]] = {}
        while (excess := sum(_twist_rank(j.rows) for j in joints) - full) > 0:
            best = None
            for k, joint in enumerate(joints):
                if joint.bodies is None:
                    continue
                for usual, kind, rows in self._freer(joint):
                    gain = _twist_rank(joint.rows) - _twist_rank(rows)
                    score = (usual, GROUND not in joint.bodies, gain, k)
                    if gain > excess or (best is not None and score <= best[0]):
                        continue
                    if _twist_rank(np.vstack([rows, *(j.rows for i, j in enumerate(joints) if i != k)])) == full:
                        best = (score, k, kind, rows)
            if best is None:
                break
            (_, _, gain, _), k, kind, rows = best
            changed[k] = (kind, gain + changed.get(k, ("", 0))[1])
            joints[k] = dataclasses.replace(joints[k], rows=rows)
        out = []
        for k, (kind, gain) in changed.items():
            called = joints[k].name if "joint" in joints[k].name else f"joint {joints[k].name}"
            out.append(f"make the {called} {kind}: removes {gain} redundant condition{'s' if gain > 1 else ''}")
        return out

    def _freer(self, joint: JointTwists) -> Iterator[tuple[bool, str, np.ndarray]]:
        """Joints in its place that allow what this one allows and more, and whether they are of a usual type."""
        assert joint.bodies is not None
        a, b = joint.bodies
        relative = np.zeros((6, self.count))
        for body, sign in ((a, 1.0), (b, -1.0)):
            if body in self.first:
                relative[:, self.first[body] : self.first[body] + 6] = sign * np.eye(6)
        rows = joint.rows @ np.linalg.pinv(relative)
        held = _twist_rank(rows)
        for usual, kind, twists in _joints_at(joint.point, joint.axis):
            allowed = np.array(twists)
            if len(allowed) > 6 - held:
                # Whatever this joint allows must be allowed still.
                _, _, right = np.linalg.svd(rows)
                free = right[held:]
                if _twist_rank(np.vstack([allowed, free])) == _twist_rank(allowed) == len(allowed):
                    _, _, right = np.linalg.svd(allowed)
                    yield usual, kind, right[len(allowed) :] @ relative


def _joints_at(point: np.ndarray | None, axis: np.ndarray | None) -> Iterator[tuple[bool, str, list[np.ndarray]]]:
    """Twists (velocity of the origin, angular velocity) that joints allow at a point and an axis; usual ones marked."""
    if point is None:
        return
    spins = [np.concatenate([np.cross(point, d), d]) for d in np.eye(3)]
    slide = [] if axis is None else [np.concatenate([axis, np.zeros(3)])]
    if axis is not None:
        yield True, "cylindrical", [np.concatenate([np.cross(point, axis), axis]), *slide]
    yield True, "spherical", spins
    if axis is not None:
        yield False, "a ball in a groove (a point on a line)", [*spins, *slide]
