"""A robot's description as a mechanism in natural coordinates: points and unit vectors that its links share.

A description is what a file says: a tree of links with joints, what closes its loops, what ties its joints. MJCF and
URDF are read into this description, and a mechanism that is exported becomes one too. All places and directions are
those of the ground in one pose, the home pose. A planar mechanism lies in the plane z = 0.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from itertools import combinations, compress
from typing import Any, NamedTuple

import numpy as np

from jaxnc.constraints.joints import FOLLOWING
from jaxnc.errors import MechanismError, list_first
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism.checks import PUNCTUATION

Vec = np.ndarray


@dataclass
class ElementaryJoint:
    """An elementary joint of a link: ``"hinge"``, ``"slide"``, ``"ball"`` or ``"free"``."""

    name: str
    kind: str
    axis: Vec = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))  # direction of a hinge or slide
    at: Vec = field(default_factory=lambda: np.zeros(3))  # a place on the axis
    reference: float = 0.0  # value at home
    stiffness: float = 0.0  # of the joint's spring; 0 for none
    rest: float = 0.0  # value at which the spring is without force
    damping: float = 0.0  # of the joint's damper
    # Numbers at which the joint is held, so that it is none of the mechanism; empty where it moves.
    held: tuple[float, ...] = ()
    quaternion: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0)  # of a ball at home

    @property
    def width(self) -> int:
        """Count the numbers that say where the joint is."""
        return {"ball": 4, "free": 7}.get(self.kind, 1)


@dataclass
class Inertia:
    """Mass, centre of mass ``(3,)`` and inertia about it ``(3, 3)``."""

    mass: float
    com: Vec
    tensor: np.ndarray


@dataclass
class Link:
    """A rigid link; number 0 is the ground, and a link without joints belongs to its parent.

    Joints act one after the other: those before the first rotation along axes of the parent, slides after it along axes
    of the link.
    """

    name: str
    parent: int  # number of the parent, which comes before the link; -1 for the ground
    origin: Vec  # place of the frame
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))  # axes of the frame as columns
    joints: list[ElementaryJoint] = field(default_factory=list)  # between the parent and the link
    sites: dict[str, Vec] = field(default_factory=dict)  # places by name
    inertia: Inertia | None = None  # None without mass
    # Of an exported mechanism, whose links have frames parallel to the ground's at home, and all joints at zero there:
    # the part of the mechanism that the link is; of a link that only closes a loop the part that it moves with.
    part: int = -1
    reference: int = -1  # of a link that moves with a point and keeps its parent's orientation, that point; else -1
    lines: list[tuple[Vec, Vec]] = field(default_factory=list)  # pairs of places, to be shown
    auxiliary: bool = False  # whether the link is no part of the mechanism but a piece of a joint
    spinless: bool = False  # whether the link is a bar that slides or turns about its own line, as its parent is turned


@dataclass
class LoopClosure:
    """Two links held together at a place of each (``"connect"``), or wholly as they are at home (``"weld"``)."""

    name: str
    kind: str
    first: int
    second: int
    at: tuple[Vec, Vec]


@dataclass
class Tie:
    """Factors of changes of hinges and slides from home, whose sum is zero."""

    name: str
    terms: dict[str, float]


@dataclass
class Follower:
    """A joint whose change from home is a polynomial of the change of another; without another it stands still."""

    name: str
    first: str
    second: str | None
    factors: tuple[float, ...]


@dataclass
class Description:
    """A whole robot."""

    name: str
    links: list[Link] = field(default_factory=list)  # the ground first, parents before their children
    loops: list[LoopClosure] = field(default_factory=list)
    followers: list[Follower] = field(default_factory=list)
    ties: list[Tie] = field(default_factory=list)
    actuated: list[str] = field(default_factory=list)  # names of the joints that motors drive
    gravity: tuple[float, ...] | None = None  # acceleration of free fall; None for none
    left_out: list[str] = field(default_factory=list)  # what was not taken over, each in a phrase
    notes: list[str] = field(default_factory=list)  # what was chosen

    @property
    def joints(self) -> dict[str, ElementaryJoint]:
        """All joints by name, in the order of the file."""
        return {j.name: j for link in self.links for j in link.joints}

    def leave_out(self, what: str, names: list[str]) -> None:
        """Say that things of one sort were not taken over, if there are any."""
        if names:
            self.left_out.append(f"{what}: {list_first(names, 8)}")

    def drive(self, name: str) -> bool:
        """Note that a motor drives a joint, if that is a hinge or slide that moves; return whether it is."""
        joint = self.joints[name]
        if joint.kind not in ("hinge", "slide") or joint.held:
            return False
        if name not in self.actuated:
            self.actuated.append(name)
        return True


def free_name(name: str, taken: Collection[str], between: str = " ") -> str:
    """Return a name as it is, or with a number behind it if it is taken."""
    k, out = 1, name
    while out in taken:
        k += 1
        out = f"{name}{between}{k}"
    return out


def join_inertias(pieces: list[Inertia]) -> Inertia | None:
    """Combine rigid pieces to one; None if there is none."""
    if not pieces:
        return None
    mass = sum(p.mass for p in pieces)
    com: Vec = sum((p.mass * p.com for p in pieces), np.zeros(3)) / mass
    tensor = np.zeros((3, 3))
    for p in pieces:
        x = cross_matrix(p.com - com)
        tensor = tensor + p.tensor - p.mass * (x @ x)
    return Inertia(mass, com, tensor)


def cross_matrix(v: Vec) -> np.ndarray:
    """Return the matrix of ``v ×``."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def rotate_about(axis: Vec, angle: float) -> np.ndarray:
    """Return the rotation by an angle about a unit axis."""
    x = cross_matrix(axis)
    return np.eye(3) + math.sin(angle) * x + (1.0 - math.cos(angle)) * (x @ x)


def perpendicular(axis: Vec) -> Vec:
    """Return a unit vector across another vector."""
    u = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    return u / np.linalg.norm(u)


# -- a description as a mechanism --------------------------------------------------------------------------------------


_CLEAR = 0.2  # sine from which a direction is good to count an angle by

Direction = str | tuple[str, str]
"""A vector, or two points."""


@dataclass
class Rigid:
    """A set of links without joints between them, or a piece between two joints of a link."""

    name: str
    points: list[str] = field(default_factory=list)
    vectors: list[str] = field(default_factory=list)
    links: list[int] = field(default_factory=list)
    loose: bool = True  # whether only balls hold it

    def hold(self, point: str = "", vector: str = "") -> None:
        """Add a point or a vector."""
        for names, name in ((self.points, point), (self.vectors, vector)):
            if name and name not in names:
                names.append(name)


class Anchor(NamedTuple):
    """The point of a joint, its axis (none of a ball), and the rigids before and after it."""

    point: str
    axis: str
    before: int
    after: int


class MovedPlaces(NamedTuple):
    """Places of points and markers and unit vectors by name, and which of them the file has elsewhere."""

    places: Mapping[str, Vec]
    changed: set[str]


class ImportTree:
    """Builds the mechanism of a robot's description.

    Attributes:
        mechanism: the mechanism.
        places: of its points.
        directions: of its vectors.
        rigids: its bodies, the ground first.
        rigid_of: number of the rigid of each link.
        bodies: name of the body of each rigid.
        coordinates: the angle or distance of every hinge and slide that moves.
        anchors: what each joint that moves is made of.
        sliders: of each slide the point that slides.
        pins: the points of each loop, on either side.
        marks: markers: sites by link and name, and frames of links by link and "".
        size: of the robot.
    """

    def __init__(self, description: Description):
        self.description = d = description
        self.places: dict[str, Vec] = {}
        self.directions: dict[str, Vec] = {}
        self._taken: set[str] = set()
        self.rigids = [Rigid("ground", links=[0], loose=False)]
        self.rigid_of = {0: 0}
        self.bodies: dict[int, str] = {}
        self.anchors: dict[str, Anchor] = {}
        self.sliders: dict[str, str] = {}
        self.pins: dict[str, tuple[str, str]] = {}
        self.marks: dict[tuple[int, str], str] = {}
        joints = d.joints
        self.coordinates = {n: self._word(n) for n, j in joints.items() if j.kind in ("hinge", "slide") and not j.held}
        origins = np.array([link.origin for link in d.links] + [j.at for j in joints.values()])
        self.size = float(np.linalg.norm(np.ptp(origins, axis=0))) or 1.0
        self._grounded = self._welded_to_ground()
        for k in range(1, len(d.links)):
            self._hang(k)
        welds = [loop for loop in d.loops if not self._pin(loop)]
        for rigid in self.rigids[1:]:
            self._orient(rigid)
        angles = [self._angle(j) for j in joints.values() if j.kind == "hinge" and not j.held]
        self.mechanism = self._write(angles, welds)

    # -- names --------------------------------------------------------------------------------------------------

    def _word(self, name: str) -> str:
        """Return a name as the mechanism may have it, that nothing has yet."""
        clean = "".join("_" if c in PUNCTUATION or not c.isprintable() else c for c in name) or "part"
        out = free_name(clean, self._taken, "_")
        self._taken.add(out)
        return out

    def _point(self, name: str, at: Vec) -> str:
        name = self._word(name)
        self.places[name] = np.array(at)
        return name

    def _vector(self, name: str, direction: Vec, *rigids: Rigid) -> str:
        name = self._word(name)
        self.directions[name] = np.array(direction) / np.linalg.norm(direction)
        for rigid in rigids:
            rigid.hold(vector=name)
        return name

    # -- joints -------------------------------------------------------------------------------------------------

    def _welded_to_ground(self) -> set[int]:
        """Find the links with joints that welds make part of the ground, so that their chains close there."""
        d, found = self.description, {0}

        def carrier(k: int) -> int:
            while k not in found and all(j.held for j in d.links[k].joints):
                k = d.links[k].parent
            return k

        welds = [loop for loop in d.loops if loop.kind == "weld"]
        for _ in welds:  # one may hold on to what another holds
            for loop in welds:
                ends = {carrier(loop.first), carrier(loop.second)}
                found |= ends if ends & found else set()
        return found

    def _hang(self, k: int) -> None:
        link = self.description.links[k]
        before = self.rigid_of[link.parent]
        joints = [j for j in link.joints if not j.held]
        held = ""
        for i, joint in enumerate(joints, start=1):
            name = link.name if i == len(joints) else f"{link.name} {i}"
            after = 0 if i == len(joints) and k in self._grounded else len(self.rigids)
            if after:
                self.rigids.append(Rigid(name, loose=joint.kind == "ball"))
            at, axis, held = self._join(joint, self.rigids[before], self.rigids[after], held)
            self.rigids[before].loose &= joint.kind == "ball"
            self.anchors[joint.name] = Anchor(at, axis, before, after)
            before = after
        self.rigid_of[k] = before
        self.rigids[before].links.append(k)

    def _join(self, joint: ElementaryJoint, parent: Rigid, child: Rigid, held: str) -> tuple[str, str, str]:
        """Make a joint between two rigids; its point and axis, and the child's point, which the next may have too."""
        at = held if held and self._near(self.places[held], joint.at) else self._point(f"{joint.name} at", joint.at)
        parent.hold(at)
        if joint.kind == "ball":
            child.hold(at)
            return at, "", at
        parallel = (v for v in parent.vectors if self._sine(v, joint.axis) < 1e-9)  # axes are one direction
        axis = next(parallel, None) or self._vector(f"{joint.name} axis", joint.axis, parent)
        child.hold(vector=axis)
        if joint.kind == "hinge":
            child.hold(at)
            return at, axis, at
        across = (v for v in parent.vectors if self._sine(v, self.directions[axis]) > _CLEAR)
        other = next(across, None) or self._vector(f"{joint.name} across", perpendicular(self.directions[axis]), parent)
        child.hold(vector=other)  # with two directions shared the child cannot turn
        on = self._point(f"{joint.name} on", joint.at)
        child.hold(on)
        self.sliders[joint.name] = on
        return at, axis, on

    def sense(self, joint: ElementaryJoint) -> float:
        """Tell whether a joint counts along the vector that is its axis, 1, or against it, -1."""
        return 1.0 if self.directions[self.anchors[joint.name].axis] @ joint.axis > 0 else -1.0

    def _near(self, a: Vec, b: Vec) -> bool:
        return bool(np.linalg.norm(a - b) <= 1e-9 * self.size)  # 1e-9 of the robot's size: places that are one

    def _sine(self, vector: str, direction: Vec) -> float:
        return float(np.linalg.norm(np.cross(self.directions[vector], direction)))

    def _pin(self, loop: LoopClosure) -> bool:
        """Keep a place of two links together; False for a weld."""
        one, other = (self.rigids[self.rigid_of[k]] for k in (loop.first, loop.second))
        if loop.kind == "weld":
            one.loose = other.loose = False
            return one is other
        if one is other:
            return True
        p = q = self._point(f"{loop.name} at", loop.at[0])
        if not self._near(*loop.at):
            q = self._point(f"{loop.name} on", loop.at[1])
        one.hold(p)
        other.hold(q)
        self.pins[loop.name] = (p, q)
        return True

    def carry(self, frames: Mapping[int, tuple[Vec, np.ndarray]]) -> dict[str, Vec]:
        """Place points and vectors that are not of the ground as links in other frames (place, axes) carry them."""
        out: dict[str, Vec] = {}
        for k, (origin, axes) in frames.items():
            rigid, link = self.rigids[self.rigid_of[k]], self.description.links[k]
            if not self.rigid_of[k] or rigid.links[0] != k:
                continue
            turn = axes @ link.turn.T
            for p in rigid.points:
                out.setdefault(p, origin + turn @ (self.places[p] - link.origin))
            for v in rigid.vectors:
                out.setdefault(v, turn @ self.directions[v])
        ground = self.rigids[0]
        return {n: x for n, x in out.items() if n not in (*ground.points, *ground.vectors)}

    # -- orientations -------------------------------------------------------------------------------------------

    def _spans(self, rigid: Rigid) -> tuple[list[Direction], np.ndarray]:
        """List the directions that a rigid has: vectors first, then pairs of points; and all as unit vectors."""
        places = np.reshape([self.places[p] for p in rigid.points], (-1, 3))
        first, second = np.triu_indices(len(places), 1)
        spans = places[second] - places[first]
        far = np.linalg.norm(spans, axis=1) > 1e-3 * self.size
        names: list[Direction] = [*rigid.vectors, *compress(combinations(rigid.points, 2), far)]
        units = spans[far] / np.linalg.norm(spans[far], axis=1, keepdims=True)
        return names, np.concatenate([np.reshape([self.directions[v] for v in rigid.vectors], (-1, 3)), units])

    def _orient(self, rigid: Rigid) -> None:
        """Give a rigid the vectors that it needs to know its orientation."""
        spans = self._spans(rigid)[1]
        if not self.flat(rigid) or self._rod(rigid):
            return
        first = spans[0] if len(spans) else np.array([0.0, 0.0, 1.0])
        if not len(spans):
            self._vector(f"{rigid.name} line", first, rigid)
        self._vector(f"{rigid.name} mark", perpendicular(first), rigid)

    def _rod(self, rigid: Rigid) -> bool:
        """Tell whether a rigid is a rod between two balls, with its centre of mass on the line."""
        if not rigid.loose or len(rigid.points) != 2 or rigid.vectors:
            return False
        p, q = (self.places[n] for n in rigid.points)
        u = (q - p) / np.linalg.norm(q - p)
        whole = self._inertia(rigid)
        off = 0.0 if whole is None else float(np.linalg.norm(np.cross(whole.com - p, u)))
        return off <= 1e-3 * float(np.linalg.norm(q - p))

    def flat(self, rigid: Rigid) -> bool:
        """Tell whether a rigid is a rod, which does not know its rotation about its own line."""
        spans = self._spans(rigid)[1]
        return 1.0 - float(np.min((spans @ spans.T) ** 2, initial=1.0)) <= _CLEAR**2

    def _angle(self, joint: ElementaryJoint) -> tuple[str, dict]:
        """Choose how a hinge's angle is measured, from a direction of its parent to one of its child."""
        anchor = self.anchors[joint.name]
        start, to = (self._zero(joint, self.rigids[k]) for k in (anchor.before, anchor.after))
        if self.sense(joint) < 0:
            start, to = to, start
        return self.coordinates[joint.name], {"start": start, "to": to, "about": anchor.axis}

    def _zero(self, joint: ElementaryJoint, rigid: Rigid) -> Direction:
        """Choose the direction of a rigid that is best across a hinge, a vector if there is a good one; or add one."""
        u = self.directions[self.anchors[joint.name].axis]
        names, units = self._spans(rigid)
        sines = np.linalg.norm(np.cross(units, u), axis=1)
        for of in (sines[: len(rigid.vectors)], sines):
            if of.max(initial=0.0) > _CLEAR:
                return names[int(np.argmax(of))]
        return self._vector(f"{joint.name} zero", perpendicular(u), rigid)

    # -- the mechanism ------------------------------------------------------------------------------------------

    def _write(self, angles: list[tuple[str, dict[str, Any]]], welds: list[LoopClosure]) -> Mechanism:
        d = self.description
        m = Mechanism(d.name or "robot", dim=3)
        ground = self.rigids[0]
        for name, at in self.places.items():
            (m.ground if name in ground.points else m.point)(name, at)
        for name, direction in self.directions.items():
            (m.ground_vector if name in ground.vectors else m.vector)(name, direction)
        m.gravity = d.gravity
        for k, rigid in enumerate(self.rigids[1:], start=1):
            name = rigid.name if rigid.name not in m.model.bodies and rigid.name != "ground" else f"{rigid.name} {k}"
            self.bodies[k] = m.body(name, rigid.points, vectors=rigid.vectors, **self._mass(rigid))
        for name, how in angles:
            m.angle(name, **how)
        for joint, on in self.sliders.items():
            at, axis, *_ = self.anchors[joint]
            m.slot(f"{joint} slot", on, (at, axis))
            ends = (at, on) if self.sense(d.joints[joint]) > 0 else (on, at)
            m.distance(self.coordinates[joint], *ends, along=axis)
        for name, (p, q) in self.pins.items():
            if p != q:
                m.spherical(name, p, q)
        for loop in welds:
            m.weld(loop.name, *(self.bodies[self.rigid_of[k]] for k in (loop.first, loop.second)))
        for follower in d.followers:
            self._follow(m, follower)
        for tie in d.ties:
            terms = {self.coordinates[j]: f for j, f in tie.terms.items() if j in self.coordinates}  # others are held
            if terms:
                m.relation(tie.name, terms)
        for joint in d.joints.values():
            self._load(m, joint)
        for k, link in enumerate(d.links):
            for name, at in (("", link.origin), *link.sites.items()):
                self._mark(m, k, name, at)
        return m

    def _follow(self, m: Mechanism, follower: Follower) -> None:
        first, second = (self.coordinates.get(j or "") for j in (follower.first, follower.second))
        f = (*follower.factors, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
        if first is None:  # held at home: the other joint stands still
            if second is None or not any(f):
                return
            if f[0] and (any(f[2:]) or not f[1]):
                raise MechanismError(f"{follower.name!r} ties {follower.second!r} to {follower.first!r}, which is "
                                     "held, by more than a factor; hold both")  # fmt: skip
            first, second, f = second, None, (f[0] and -f[0] / f[1], *f[1:])
        if second is None:
            f = (f[0], 0.0, 0.0, 0.0, 0.0)
        if f[0] == 0.0 and not any(f[2:]):
            m.relation(follower.name, {first: 1.0, second: -f[1]} if second else {first: 1.0})
        else:
            second = second or first  # without a factor
            given: dict[str, float] = dict(zip(("a0", "a1", "a2", "a3", "a4"), f, strict=True))
            m.constrain(follower.name, FOLLOWING, scalars=[first, second], constants=given)

    def _load(self, m: Mechanism, joint: ElementaryJoint) -> None:
        """Add the spring and the damper of a joint."""
        name = self.coordinates.get(joint.name)
        if name is None:
            if joint.kind == "ball" and not joint.held and (joint.stiffness or joint.damping):
                self.description.left_out.append(f"spring and damper of ball joint {joint.name!r}")
            return
        if joint.stiffness:
            # A spring is without force where the joint is away from home by so much.
            away = joint.rest - joint.reference
            m.spring(f"{joint.name} spring", name, stiffness=joint.stiffness, preload=-joint.stiffness * away)
        if joint.damping:
            m.damper(f"{joint.name} damper", name, damping=joint.damping)

    def _inertia(self, rigid: Rigid) -> Inertia | None:
        masses = [self.description.links[k].inertia for k in rigid.links]
        return join_inertias([m for m in masses if m is not None and m.mass > 0])

    def _mass(self, rigid: Rigid) -> dict[str, Any]:
        whole = self._inertia(rigid)
        if whole is None:
            return {}
        com, tensor = whole.com, whole.tensor
        if self.flat(rigid):
            p, u = self.places[rigid.points[0]], self._spans(rigid)[1][0]
            com = p + ((com - p) @ u) * u
            mean = 0.5 * (np.trace(tensor) - u @ tensor @ u)
            tensor = mean * (np.eye(3) - np.outer(u, u))
            self.description.notes.append(
                f"{rigid.name!r} is a rod between balls: it has no inertia about its own line"
            )
        tensor = 0.5 * (tensor + tensor.T)
        return {"mass": whole.mass, "com": tuple(com), "inertia": tensor}

    def _mark(self, m: Mechanism, k: int, name: str, at: Vec) -> None:
        """Add a site of a link, or without a name the link's frame, as a marker; those of the ground stand still."""
        number, link = self.rigid_of[k], self.description.links[k]
        rigid = self.rigids[number]
        if not number:
            return
        if self.flat(rigid):
            p, u = self.places[rigid.points[0]], self._spans(rigid)[1][0]
            if float(np.linalg.norm(np.cross(at - p, u))) > 1e-6 * self.size:
                what = f"site {name!r}" if name else "frame"
                self.description.left_out.append(
                    f"{what} of {link.name!r}: it is beside the line of a rod, which does not know its own rotation"
                )
                return
        self.marks[k, name] = self._word(name or f"{link.name} frame")
        m.marker(self.marks[k, name], on=self.bodies[number], at=at)
