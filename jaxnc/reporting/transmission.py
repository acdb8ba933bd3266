"""Transmission angles of a planar motion, where its joints have one: found by looking at what moves what."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jaxnc.calls import public
from jaxnc.constraints import DISTANCE_BETWEEN
from jaxnc.kinematics.motion import Motion
from jaxnc.reporting.checked import Quantity
from jaxnc.system.topology import Topology


@public
@dataclass(frozen=True)
class Transmission:
    """The angle under which a coupler drives what it is to move: 90 degrees is best, 0 a dead point.

    Attributes:
        at: the joint.
        between: what meets there.
        values: degrees, ``(T,)``; NaN where a pose was not found.
        sines: of the angle with its sense, ``(T,)``: it goes through zero where they change their sign.
    """

    at: str
    between: str
    values: np.ndarray
    sines: np.ndarray


class _Line(NamedTuple):
    """A line through two points, or an axis of the ground (``a`` its number, ``b`` none), or the normal of it."""

    a: int
    b: int | None = None
    normal: bool = False


def transmissions(motion: Motion) -> list[Transmission]:
    """Find the transmission angles of a planar sweep.

    From the inputs on, links that hang on what moves already are taken two at a time, as they are moved: of a coupler
    and what it turns the angle between them; of a coupler and a slider that between it and the normal of the slider's
    way; of a slot that a pin drives that between its normal and the arm to the pin; of two ways that cross the angle
    between them. It is 90 degrees less the angle between the force and the velocity that it makes.

    Returns:
        One for each of these pairs; none in space.
    """
    top = motion.system.topology
    if top.dim != 2 or motion.status.ndim != 1:
        return []
    bad = ~np.asarray(motion.converged)
    out = []
    for at, between, one, other in _Chain(top, motion.driven).meetings:
        u, v = _direction(motion, one), _direction(motion, other)
        angle = np.arctan2(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0], (u * v).sum(axis=-1))
        values = np.degrees(np.arctan2(np.abs(np.sin(angle)), np.abs(np.cos(angle))))
        values, sines = (np.where(bad, np.nan, x) for x in (values, np.sin(angle)))
        out.append(Transmission(top.points[at], between, values, sines))
    return out


def transmission_quantities(motion: Motion) -> list[Quantity]:
    """List the transmission angles of a planar sweep as quantities; see `transmissions`."""
    return [Quantity(t.at, "deg", t.values, 1.0, parts=t.sines[:, None]) for t in transmissions(motion)]


def unexplained_bodies(motion: Motion) -> list[str]:
    """List the bodies of a planar motion that no link, one after the other, is seen to move; see `transmissions`."""
    top = motion.system.topology
    if top.dim != 2 or motion.status.ndim != 1:
        return []
    chain = _Chain(top, motion.driven)
    return [body.name for b, body in enumerate(top.bodies) if b not in chain.bodies]


def _direction(motion: Motion, line: _Line) -> np.ndarray:
    """Find the directions of a line, ``(T, 2)``."""
    names = motion.system.topology.points
    if line.b is None:
        d = np.broadcast_to(np.eye(2)[line.a], (len(motion.status), 2))
    else:
        d = np.asarray(motion[names[line.b]]) - np.asarray(motion[names[line.a]])
    return np.stack([-d[:, 1], d[:, 0]], axis=1) if line.normal else d


def _move_as_one(bodies: list[set[int]]) -> list[set[int]]:
    """Find of each of some bodies all points that move as one with it: two share two points, or three close a triangle.

    Args:
        bodies: the points of each.
    """
    groups, found = [set(points) for points in bodies], True
    while found:
        found = False
        for one, other in itertools.combinations(groups, 2):
            shared = one & other
            if shared and (len(shared) > 1 or any(x & one - shared and x & other - shared for x in groups)):
                one |= other
                other.clear()
                found = True
    return [own or next(x for x in groups if x >= points) for own, points in zip(groups, bodies, strict=True)]


class _Chain:
    """Order in which the links of a planar mechanism are moved, one by another.

    Attributes:
        groups: points that move as one with the ground, and with each body in turn.
        bodies: those that are found to be moved, by the inputs or by others.
        points: those whose place is known with them, and those of the ground.
        meetings: where one moves another: the point, what meets there, and two lines whose angle is that of
            transmission.
    """

    def __init__(self, top: Topology, driven: tuple[str, ...]):
        self.top = top
        self.fixed = np.array(top.fixed[: 2 * len(top.points)]).reshape(-1, 2)
        ground = set(np.flatnonzero(self.fixed.all(axis=1)).tolist())
        self.groups = _move_as_one([ground, *(set(body.points) for body in top.bodies)])
        self.still = self.groups[0]
        self.slots = [((j.points[0], j.points[1]), j.points[2]) for j in top.joints if j.drawn and j.type == "slot"]
        # Of each prismatic joint its line, and the points of what slides on what, either way round.
        sliding = [j.sides[:2] for j in top.joints if j.drawn and j.type == "prismatic"]
        self.guides = [
            (_Line(one[0], one[1]), set(a), set(b)) for one, other in sliding for a, b in ((one, other), (other, one))
        ]
        self.bodies: set[int] = set()
        self.points, self.meetings = set(self.still), []
        self.rest = [name for name in driven if name in top.scalars]  # angles and distances that place nothing yet
        self._take_driven([name for name in driven if name not in top.scalars])
        while self._follow():
            pass

    def _take(self, body: int) -> None:
        self.bodies.add(body)
        self.points.update(self.groups[body + 1])

    def _take_driven(self, names: list[str]) -> None:
        """Take what driven places of points place: these, and bodies that they turn about the ground."""
        top, known = self.top, self.fixed.copy()
        for point, _, axis in (name.rpartition(".") for name in names):
            known[top.points.index(point), "xy".index(axis)] = True
        self.points.update(np.flatnonzero(known.all(axis=1)).tolist())
        moved = {k for k in range(len(known)) if (known[k] & ~self.fixed[k]).any()}
        for b, body in enumerate(top.bodies):
            if moved & set(body.points) and self.still & set(body.points):
                self._take(b)

    def _take_measured(self, name: str) -> bool:
        """Take what a driven angle or distance places, if it is measured from what is placed; tells whether it is."""
        top = self.top
        block, instance = top.measures[top.scalars.index(name)]
        kind, ends = top.blocks[block].kind, top.blocks[block].points[instance]
        if top.angles[top.scalars.index(name)]:
            lines = ends[:2], ends[2:]  # the second one is none of an angle from the x axis
            turned = [set(other) for one, other in (lines, lines[::-1]) if other and self.points >= set(one)]
            hung = (b for b in self._loose() if self._hung(b) is not None)
            placed = [b for b in hung if any(line <= set(top.bodies[b].points) for line in turned)]
            for b in placed:
                self._take(b)
            return bool(placed)
        if kind is DISTANCE_BETWEEN and self._take_pushed(name, set(ends)):
            return True
        moved = set(ends) - self.points
        if len(moved) != 1 or (kind is DISTANCE_BETWEEN and not self.still & set(ends)):
            return False
        held = [b for b in self._holding(*moved) if self.still & set(top.bodies[b].points)]
        self.points.update(p for p in moved if self._way(p) is not None)
        for b in held:
            self._take(b)
        return bool(held) or self.points >= moved

    def _take_pushed(self, name: str, ends: set[int]) -> bool:
        """Take the body that a driven distance, a cylinder, turns about what is placed; tells whether there is one."""
        for near in ends & self.points:
            for far in ends - self.points:
                for b in self._holding(far):
                    if pivots := self.points & set(self.top.bodies[b].points):
                        between = f"{name} and {self.top.bodies[b].name}"
                        self._meet(far, between, _Line(near, far), _Line(min(pivots), far), b)
                        return True
        return False

    def _meet(self, at: int, between: str, one: _Line, other: _Line, *bodies: int) -> None:
        self.meetings.append((at, between, one, other))
        for b in bodies:
            self._take(b)
        self.points.add(at)

    def _holding(self, point: int) -> list[int]:
        """List the bodies that hold a point and are not moved yet."""
        return [b for b, body in enumerate(self.top.bodies) if point in body.points and b not in self.bodies]

    def _loose(self) -> list[int]:
        return [b for b in range(len(self.top.bodies)) if b not in self.bodies]

    def _hung(self, body: int, but: int = -1) -> int | None:
        """Find a point by which a body hangs on what moves already, or on the ground; what moves comes first."""
        there = [p for p in sorted(self.groups[body + 1]) if p in self.points and p != but]
        return min(there, key=lambda p: p in self.still, default=None)

    def _way(self, point: int) -> _Line | None:
        """Find the line along which a point slides, if that is on the ground or on what moves already."""
        if self.fixed[point].sum() == 1:
            return _Line(int(np.argmin(self.fixed[point])))
        return next((_Line(*way) for way, on in self.slots if on == point and self.points >= set(way)), None)

    def _follow(self) -> bool:
        """Find the next that is moved; tells whether there was one."""
        top = self.top
        if placing := next((name for name in self.rest if self._take_measured(name)), None):
            self.rest.remove(placing)  # what one places another one may be measured from
            return True
        for b in self._loose():
            if len(self.points & (held := self.groups[b + 1])) >= min(2, len(held)):  # by two of its points
                self._take(b)
                return True
        for j in top.joints:
            if j.drawn and j.type == "gear":
                one, other = ([b for b, x in enumerate(top.bodies) if set(s) <= set(x.points)] for s in j.sides[2:4])
                for a, b in ((one, other), (other, one)):
                    hung = [x for x in b if x not in self.bodies and self._hung(x) is not None]
                    if self.bodies & set(a) and hung:
                        self._take(hung[0])
                        return True
        meetings = itertools.chain(self._hinge_meetings(), self._slider_meetings(), self._pin_meetings())
        return any(self._meet(*found) is None for found in meetings)

    def _hinge_meetings(self) -> Iterator[tuple]:
        """Find two links that share a joint and hang each by another: a coupler and what it turns."""
        for c in self._loose():
            for joint in self.top.bodies[c].points:
                start = self._hung(c, joint)
                for f in self._holding(joint):
                    end = self._hung(f, joint)
                    one = self.groups[c + 1] == self.groups[f + 1]
                    if one or start is None or end is None or (start in self.still and end not in self.still):
                        continue
                    between = f"{self.top.bodies[c].name} and {self.top.bodies[f].name}"
                    yield joint, between, _Line(start, joint), _Line(end, joint), c, f

    def _slider_meetings(self) -> Iterator[tuple]:
        """Find a link that moves a slider: a point on a way, or a body on a guide."""
        names = self.top.points
        for c in self._loose():
            for joint in self.top.bodies[c].points:
                start = self._hung(c, joint)
                if start is None:
                    continue
                between = f"{self.top.bodies[c].name} and the normal of the way of {names[joint]}"
                if way := self._way(joint):
                    yield joint, between, _Line(start, joint), way._replace(normal=True), c
                for f in self._holding(joint):
                    if f != c and (way := self._guide(f)):
                        yield joint, between, _Line(start, joint), way._replace(normal=True), c, f

    def _guide(self, body: int) -> _Line | None:
        """Find the line along which a body slides without turning, if it is on the ground or on what moves already."""
        held = set(self.top.bodies[body].points)
        return next((line for line, mine, theirs in self.guides if mine <= held and self.points >= theirs), None)

    def _pin_meetings(self) -> Iterator[tuple]:
        """Find pins that move what they slide in: a slotted arm, a slider with a slot, a point where two ways cross."""
        names = self.top.points
        for line, pin in self.slots:
            for f in self._loose() if pin in self.points else ():
                if set(line) <= set(self.top.bodies[f].points):
                    noun = f"the slot of {self.top.bodies[f].name}"
                    yield from self._slot_meetings(f, _Line(*line), pin, noun)
            ways = [_Line(*way) for way, on in self.slots if on == pin and self.points >= set(way)]
            ways += [way] if (way := self._way(pin)) and way.b is None else []
            if pin not in self.points and len(ways) == 2:
                yield pin, f"the two ways of {names[pin]}", *ways
        for line, mine, theirs in self.guides:
            for c, f in itertools.permutations(self._loose(), 2):
                pin, bodies = self._hung(c), self.top.bodies
                if mine <= set(bodies[c].points) and theirs <= set(bodies[f].points) and pin is not None:
                    for found in self._slot_meetings(f, line, pin, f"the guide of {bodies[f].name}"):
                        yield *found, c

    def _slot_meetings(self, body: int, line: _Line, pin: int, noun: str) -> Iterator[tuple]:
        """Find how a pin moves a body along whose line it slides, or with which it slides."""
        pivot, name = self._hung(body), self.top.points[pin]
        if pivot is not None and pivot != pin:
            between = f"the normal of {noun} and the arm to {name}"
            yield pin, between, line._replace(normal=True), _Line(pivot, pin), body
        elif way := self._guide(body):
            yield pin, f"{noun} and its way", line, way, body
