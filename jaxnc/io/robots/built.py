"""A mechanism in natural coordinates built from a robot's file: points and unit vectors that its links share."""

from dataclasses import dataclass, field
from itertools import combinations
from typing import NamedTuple

import numpy as np

from jaxnc.constraints import Kind
from jaxnc.errors import MechanismError
from jaxnc.io.robots.described import Described, FileJoint, FileLoop, FileTie
from jaxnc.io.robots.inertia import joined
from jaxnc.io.robots.pose import across
from jaxnc.io.robots.tree import Vec
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism.checks import PUNCTUATION
from jaxnc.pickling import listed

_PARALLEL = 1e-9  # sine of an angle below which axes are one direction
_CLEAR = 0.2  # sine from which a direction is good to count an angle by
_SAME = 1e-9  # of the robot's size: places that are one


def _followed(p, v, s, c):
    """The change of one coordinate from the drawing as a polynomial of another's."""
    x = s[1] - c[1]
    return (s[0] - c[0] - (c[2] + x * (c[3] + x * (c[4] + x * (c[5] + x * c[6])))),)


FOLLOWED = Kind(
    "joint that follows another",
    _followed,
    rows=("polynomial",),
    powers=(0,),
    scalars=2,
    constants=("home", "of", "a0", "a1", "a2", "a3", "a4"),
    drawn=lambda p, v, s, c: (s[0], s[1], c[2], c[3], c[4], c[5], c[6]),
    source="MuJoCo, XML reference, equality/joint",
)
listed(__name__, (FOLLOWED,))


@dataclass
class Rigid:
    """What moves as one: links without joints between them, or what is between two joints of one link."""

    name: str
    points: list[str] = field(default_factory=list)
    vectors: list[str] = field(default_factory=list)
    links: list[int] = field(default_factory=list)
    loose: bool = True  # whether only balls hold it


class Anchor(NamedTuple):
    """What a joint is made of: its point, its axis (none of a ball), and the rigids before and after it."""

    point: str
    axis: str
    before: int
    after: int


class Builder:
    """Builds a mechanism from a description."""

    def __init__(self, described: Described):
        self.described = described
        self.places: dict[str, Vec] = {}
        self.directions: dict[str, Vec] = {}
        self.taken: set[str] = set()
        self.rigids = [Rigid("ground", links=[0], loose=False)]  # its bodies, the ground first
        self.rigid_of = {0: 0}  # number of the rigid of every link
        self.anchors: dict[str, Anchor] = {}  # what every joint is made of
        self.sliders: dict[str, str] = {}  # of every slide the point that slides
        self.pins: dict[str, tuple[str, str]] = {}  # names of the points of every loop, on either side
        self.marks: dict[tuple[int, str], str] = {}  # names of markers: sites by link and name, and frames of links
        named = [n for n, j in described.joints.items() if j.kind in ("hinge", "slide") and not j.held]
        self.coordinates = {name: self.word(name) for name in named}  # the angle or distance of every hinge and slide
        origins = np.array([link.origin for link in described.links] + [j.at for j in described.joints.values()])
        self.size = float(np.linalg.norm(np.ptp(origins, axis=0))) or 1.0
        for k in range(1, len(described.links)):
            self._hang(k)
        welds = [loop for loop in described.loops if not self._pin(loop)]
        for rigid in self.rigids[1:]:
            self._orient(rigid)
        angles = [self._angle(j) for j in described.joints.values() if j.kind == "hinge" and not j.held]
        self.mechanism = self._write(angles, welds)

    # -- names --------------------------------------------------------------------------------------------------

    def word(self, name: str) -> str:
        """A name as the mechanism may have it, that nothing has yet."""
        clean = "".join("_" if c in PUNCTUATION or not c.isprintable() else c for c in name) or "part"
        k, out = 1, clean
        while out in self.taken:
            k += 1
            out = f"{clean}_{k}"
        self.taken.add(out)
        return out

    def _point(self, name: str, at: Vec) -> str:
        name = self.word(name)
        self.places[name] = np.array(at)
        return name

    def _vector(self, name: str, direction: Vec) -> str:
        name = self.word(name)
        self.directions[name] = np.array(direction) / np.linalg.norm(direction)
        return name

    # -- joints -------------------------------------------------------------------------------------------------

    def _hang(self, k: int) -> None:
        link = self.described.links[k]
        before = self.rigid_of[link.parent]
        joints = [j for j in link.joints if not j.held]
        if not joints:
            self.rigid_of[k] = before
            self.rigids[before].links.append(k)
            return
        held = ""
        for i, joint in enumerate(joints):
            last = i == len(joints) - 1
            rigid = Rigid(link.name if last else f"{link.name} {i + 1}", loose=joint.kind == "ball")
            self.rigids.append(rigid)
            at, axis, held = self._join(joint, self.rigids[before], rigid, held)
            self.rigids[before].loose &= joint.kind == "ball"
            self.anchors[joint.name] = Anchor(at, axis, before, len(self.rigids) - 1)
            before = len(self.rigids) - 1
        self.rigid_of[k] = before
        self.rigids[before].links.append(k)

    def _join(self, joint: FileJoint, parent: Rigid, child: Rigid, held: str) -> tuple[str, str, str]:
        """One joint between two rigids: its point and axis, and the child's point, which the next may have too."""
        at = held if held and self._near(self.places[held], joint.at) else self._point(f"{joint.name} at", joint.at)
        self._hold(parent, at)
        if joint.kind == "ball":
            self._hold(child, at)
            return at, "", at
        axis = self._axis(joint, parent)
        self._hold(child, vector=axis)
        if joint.kind == "hinge":
            self._hold(child, at)
            return at, axis, at
        other = next((v for v in parent.vectors if self._sine(v, axis) > _CLEAR), None)
        if other is None:
            other = self._vector(f"{joint.name} across", across(self.directions[axis]))
            self._hold(parent, vector=other)
        self._hold(child, vector=other)  # with two directions shared it cannot turn
        on = self._point(f"{joint.name} on", joint.at)
        self._hold(child, on)
        self.sliders[joint.name] = on
        return at, axis, on

    def _axis(self, joint: FileJoint, parent: Rigid) -> str:
        """The joint's axis: a direction of its parent that is parallel to it, or a new one."""
        for v in parent.vectors:
            if np.linalg.norm(np.cross(self.directions[v], joint.axis)) < _PARALLEL:
                return v
        new = self._vector(f"{joint.name} axis", joint.axis)
        self._hold(parent, vector=new)
        return new

    @staticmethod
    def _hold(rigid: Rigid, point: str = "", vector: str = "") -> None:
        if point and point not in rigid.points:
            rigid.points.append(point)
        if vector and vector not in rigid.vectors:
            rigid.vectors.append(vector)

    def _near(self, a: Vec, b: Vec) -> bool:
        return bool(np.linalg.norm(a - b) <= _SAME * self.size)

    def _sine(self, a: str, b: str) -> float:
        return float(np.linalg.norm(np.cross(self.directions[a], self.directions[b])))

    def _pin(self, loop: FileLoop) -> bool:
        """A place that two links keep together; False for a weld."""
        one, other = (self.rigids[self.rigid_of[k]] for k in (loop.first, loop.second))
        if loop.kind == "weld":
            one.loose = other.loose = False
            return one is other
        if one is other:
            return True
        p = q = self._point(f"{loop.name} at", loop.at[0])
        if not self._near(*loop.at):
            q = self._point(f"{loop.name} on", loop.at[1])
        self._hold(one, p)
        self._hold(other, q)
        self.pins[loop.name] = (p, q)
        return True

    # -- orientations -------------------------------------------------------------------------------------------

    def _spans(self, rigid: Rigid) -> list[tuple[str | tuple[str, str], Vec]]:
        """Directions that a rigid has: vectors first, then pairs of points."""
        out: list = [(v, self.directions[v]) for v in rigid.vectors]
        for p, q in combinations(rigid.points, 2):
            d = self.places[q] - self.places[p]
            if np.linalg.norm(d) > 1e-3 * self.size:
                out.append(((p, q), d / np.linalg.norm(d)))
        return out

    def _orient(self, rigid: Rigid) -> None:
        """Give a rigid the vectors that it needs to know its orientation."""
        spans = [d for _, d in self._spans(rigid)]
        if not self.flat(rigid) or self._bar(rigid):
            return
        first = spans[0] if spans else np.array([0.0, 0.0, 1.0])
        if not spans:
            self._hold(rigid, vector=self._vector(f"{rigid.name} line", first))
        self._hold(rigid, vector=self._vector(f"{rigid.name} mark", across(first)))

    def _bar(self, rigid: Rigid) -> bool:
        """Whether a rigid is a rod between two balls, with its centre of mass on the line."""
        if not rigid.loose or len(rigid.points) != 2 or rigid.vectors:
            return False
        p, q = (self.places[n] for n in rigid.points)
        u = (q - p) / np.linalg.norm(q - p)
        masses = [self.described.links[k].inertia for k in rigid.links]
        whole = joined([m for m in masses if m is not None])
        off = 0.0 if whole is None else float(np.linalg.norm(np.cross(whole.com - p, u)))
        return off <= 1e-3 * float(np.linalg.norm(q - p))

    def flat(self, rigid: Rigid) -> bool:
        """Whether a rigid is a rod, which does not know its rotation about its own line."""
        spans = [d for _, d in self._spans(rigid)]
        return max((float(np.linalg.norm(np.cross(a, b))) for a, b in combinations(spans, 2)), default=0.0) <= _CLEAR

    def _beside(self, rigid: Rigid, at: Vec) -> bool:
        """Whether a place is off the line of a rod."""
        if not self.flat(rigid):
            return False
        p, u = self.places[rigid.points[0]], self._spans(rigid)[0][1]
        return float(np.linalg.norm(np.cross(at - p, u))) > 1e-6 * self.size

    def _angle(self, joint: FileJoint) -> tuple[str, dict]:
        """How a hinge's angle is measured, from a direction of its parent to one of its child."""
        _, axis, one, other = self.anchors[joint.name]
        u = self.directions[axis]

        def best(rigid: Rigid) -> str | tuple[str, str]:
            found = [(float(np.linalg.norm(np.cross(d, u))), spec) for spec, d in self._spans(rigid)]
            good = [x for x in found if x[0] > _CLEAR]
            vectors = [x for x in good if isinstance(x[1], str)]
            if good:
                return max(vectors or good, key=lambda x: x[0])[1]
            new = self._vector(f"{joint.name} zero", across(u))
            self._hold(rigid, vector=new)
            return new

        start, to = best(self.rigids[one]), best(self.rigids[other])
        if self.directions[axis] @ joint.axis < 0:
            start, to = to, start
        return self.coordinates[joint.name], {"start": start, "to": to, "about": axis}

    # -- the mechanism ------------------------------------------------------------------------------------------

    def _write(self, angles: list[tuple[str, dict]], welds: list[FileLoop]) -> Mechanism:
        d = self.described
        m = Mechanism(d.name or "robot", dim=3)
        ground = self.rigids[0]
        for name, at in self.places.items():
            (m.ground if name in ground.points else m.point)(name, at)
        for name, direction in self.directions.items():
            (m.ground_vector if name in ground.vectors else m.vector)(name, direction)
        m.gravity = d.gravity
        self.bodies: dict[int, str] = {}
        for k, rigid in enumerate(self.rigids[1:], start=1):
            name = rigid.name if rigid.name not in m.model.bodies and rigid.name != "ground" else f"{rigid.name} {k}"
            self.bodies[k] = m.body(name, rigid.points, vectors=rigid.vectors, **self._mass(rigid))
        for name, how in angles:
            m.angle(name, **how)
        for joint, on in self.sliders.items():
            at, axis = self.anchors[joint][:2]
            m.slot(f"{joint} slot", on, (at, axis))
            j, name = d.joints[joint], self.coordinates[joint]
            ends = (at, on) if self.directions[axis] @ j.axis > 0 else (on, at)
            m.distance(name, *ends, along=axis)
        for name, (p, q) in self.pins.items():
            if p != q:
                m.spherical(name, p, q)
        for loop in welds:
            one, other = (self.rigid_of[k] for k in (loop.first, loop.second))
            if 0 in (one, other):
                held = d.links[max(loop.first, loop.second)].name
                raise MechanismError(f"weld {loop.name!r}: it holds {held!r} to the ground, so what is between cannot "
                                     f"move; leave it out with without=[{loop.name!r}]")  # fmt: skip
            m.weld(loop.name, self.bodies[one], self.bodies[other])
        for tie in d.ties:
            self._tie(m, tie)
        for total in d.sums:
            m.relation(total.name, {self.coordinates[j]: f for j, f in total.terms.items()})
        for joint in d.joints.values():
            self._loads(m, joint)
        self._marks(m)
        return m

    def _tie(self, m: Mechanism, tie: FileTie) -> None:
        first = self.coordinates[tie.first]
        if tie.second is None:
            m.relation(tie.name, {first: 1.0})
            return
        second, f = self.coordinates[tie.second], (*tie.factors, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
        if f[0] == 0.0 and not any(f[2:]):
            m.relation(tie.name, {first: 1.0, second: -f[1]})
        else:
            given: dict[str, float] = dict(zip(("a0", "a1", "a2", "a3", "a4"), f, strict=True))
            m.constrain(tie.name, FOLLOWED, scalars=[first, second], constants=given)

    def _loads(self, m: Mechanism, joint: FileJoint) -> None:
        name = self.coordinates.get(joint.name)
        if name is None:
            if joint.kind == "ball" and not joint.held and (joint.stiffness or joint.damping):
                self.described.left_out.append(f"spring and damper of ball joint {joint.name!r}")
            return
        if joint.stiffness:
            # A spring is without force where the joint is away from home by so much.
            away = joint.rest - joint.reference
            m.spring(f"{joint.name} spring", name, stiffness=joint.stiffness, preload=-joint.stiffness * away)
        if joint.damping:
            m.damper(f"{joint.name} damper", name, damping=joint.damping)

    def _mass(self, rigid: Rigid) -> dict:
        masses = [self.described.links[k].inertia for k in rigid.links]
        whole = joined([m for m in masses if m is not None and m.mass > 0])
        if whole is None:
            return {}
        com, tensor = whole.com, whole.tensor
        if self.flat(rigid):
            p, u = self.places[rigid.points[0]], self._spans(rigid)[0][1]
            com = p + ((com - p) @ u) * u
            mean = 0.5 * (np.trace(tensor) - u @ tensor @ u)
            tensor = mean * (np.eye(3) - np.outer(u, u))
            self.described.notes.append(f"{rigid.name!r} is a rod between balls: it has no inertia about its own line")
        tensor = 0.5 * (tensor + tensor.T)
        return {"mass": whole.mass, "com": tuple(com), "inertia": tensor}

    def _marks(self, m: Mechanism) -> None:
        """Sites, and the frames of links, as markers."""
        for k, link in enumerate(self.described.links):
            number = self.rigid_of[k]
            if not number:
                continue
            for name, at in (("", link.origin), *link.sites.items()):
                if self._beside(self.rigids[number], at):
                    what = f"site {name!r}" if name else "frame"
                    self.described.left_out.append(
                        f"{what} of {link.name!r}: it is beside the line of a rod, which does not know its own rotation"
                    )
                    continue
                self.marks[k, name] = self.word(name or f"{link.name} frame")
                m.marker(self.marks[k, name], on=self.bodies[number], at=at)
