"""Joints between the rigid parts of a mechanism, as elementary joints of links that hang one on the other."""

from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from jaxnc.families.bodies import Parts, planar_edges, spatial_edges
from jaxnc.mechanism import model as record
from jaxnc.robots.description import Vec, perpendicular
from jaxnc.robots.pose import TreePose
from jaxnc.system.identity import Thing

Z = np.array([0.0, 0.0, 1.0])
_FREEDOMS = {"revolute": 1, "prismatic": 1, "cylindrical": 2, "universal": 2, "spherical": 3, "rolling": 2}


@dataclass
class TreeEdge:
    """A joint between two parts, all directions as in the home pose."""

    name: str  # what it is called after: a joint, or the point that is shared
    # "revolute", "spherical", "prismatic", "cylindrical", "universal", "slot" (a point of the second slides along
    # `axes` of the first), "planar", "rolling", "free" (the second hangs on nothing).
    how: str
    first: int  # a part; the one that carries the line, the plane, or the ground
    second: int  # the other part
    at: tuple[int, int]  # the joint's point on each of them
    # Its axis; both arms of a universal joint; all directions in which a point may slide.
    axes: list[Vec] = field(default_factory=list)
    points: tuple[int, ...] = ()  # points that it makes one, of those that both parts hold
    vectors: tuple[int, ...] = ()  # vectors that it makes one
    holder: int = -1  # the point whose fixed coordinates it is, or -1
    # Whether it is a joint of the description, which is written once for all parts that hold its point.
    user: bool = False
    wanted: bool = False  # whether a coordinate of the user is its own
    turns: bool = True  # whether both parts know a rotation, so that the second may turn

    def freedoms(self, dim: int) -> int:
        """Count the relative freedoms."""
        turning = (1 if dim == 2 else 3) * self.turns
        if self.how == "slot":
            return len(self.axes) + turning
        if self.how == "planar":
            return 3
        return _FREEDOMS[self.how]

    def sequence(self, parent: int, dim: int) -> tuple[int, list[tuple[str, Vec]]]:
        """Return the child's point of the joint, and its elementary joints (kind, axis) seen from a parent."""
        forward = parent == self.first
        at = self.at[1] if forward else self.at[0]
        slides = [("slide", a) for a in self.axes]
        match self.how:
            case "revolute":
                return at, [("hinge", self.axes[0])]
            case "spherical":
                return at, [("ball", Z)]
            case "prismatic":
                return at, slides
            case "cylindrical" | "rolling":
                return at, [("slide", self.axes[0]), ("hinge", self.axes[-1])]
            case "universal":
                return at, [("hinge", a) for a in (self.axes if forward else self.axes[::-1])]
            case "free":
                if self.turns and dim == 3:
                    return at, [("free", Z)]
                return at, [*(("slide", axis) for axis in np.eye(3)[:dim]), *([("hinge", Z)] if self.turns else [])]
            case "planar":
                normal = self.axes[0]
                one = perpendicular(normal)
                return at, [("slide", one), ("slide", np.cross(normal, one)), ("hinge", normal)]
        turning = [] if not self.turns else [("hinge", Z)] if dim == 2 else [("ball", Z)]
        # The pin turns where it has slid to; a line turns about the pin of its parent, and slides along itself.
        return self.at[1], [*slides, *turning] if forward else [*turning, *slides]


def find_edges(parts: Parts, home: TreePose) -> tuple[list[TreeEdge], dict[str, str]]:
    """Find all joints of a mechanism that a tree of links can be made of, and the kinds of the others by name."""
    lost: dict[str, str] = {}
    found = _planar_edges(parts, home) if parts.dim == 2 else _spatial_edges(parts, home)
    known = {e.name for e in found if e.user}
    for name, joint in parts.model.joints.items():
        if isinstance(joint, record.Rolling) and (pair := _rolling_edges(parts, home, name, joint)):
            found += pair
            known.add(name)
        told = record.Gear | record.BevelGear | record.RackAndPinion | record.Cable | record.Weld
        if name not in known and not isinstance(joint, told):
            lost[name] = "".join(f" {c.lower()}" if c.isupper() else c for c in type(joint).__name__).strip()
    return found, lost


def can_turn(parts: Parts, *ks: int) -> bool:
    """Tell whether all of some parts have an orientation."""
    return all(parts.parts[k].turns != "no" for k in ks)


def _planar_edges(parts: Parts, home: TreePose) -> list[TreeEdge]:
    found = []
    for e in planar_edges(parts):
        if e.how == "held":
            found.append(_edge_of_fixed_point(parts, e.second, e.point))
            continue
        pin = e.how == "revolute"
        at = (e.line[0], e.on[0]) if e.how == "prismatic" else (e.point, e.point)
        axes, shared = ([Z], (e.point,)) if pin else ([home.span(e.line)], ())
        found.append(TreeEdge(parts.a.text(e.owner), e.how, e.first, e.second, at, axes, shared, user=not pin,
                          wanted=bool(e.angle or e.distance), turns=e.turns))  # fmt: skip
    for name, joint in parts.model.joints.items():
        if isinstance(joint, record.Revolute) and joint.points:
            p, q = parts.a.pair(joint.points)
            apart = ((i, j) for i in parts.of_point[p] for j in parts.of_point[q] if i != j)
            if pair := next(apart, None):
                found.append(TreeEdge(name, "revolute", *pair, (p, q), [Z], user=True))
    return found


def _edge_of_fixed_point(parts: Parts, k: int, p: int) -> TreeEdge:
    """Make the edge of a point that slides with fixed coordinates."""
    axes = [np.eye(3)[i] for i in range(parts.dim) if not parts.a.fixed[p][i]]
    return TreeEdge(parts.point(p), "slot", 0, k, (p, p), axes, holder=p, turns=can_turn(parts, k))


def _spatial_edges(parts: Parts, home: TreePose) -> list[TreeEdge]:
    found = []
    for e in spatial_edges(parts):
        name, user = parts.a.text(e.owner), e.owner.thing is Thing.JOINT
        axes = [home.along(axis) for axis in e.axes[: {"spherical": 0, "universal": 2}.get(e.how, 1)]]
        points, vectors = e.shared
        if e.how == "prismatic":  # nothing turns: all that both hold keeps its direction
            one, other = parts.parts[e.first], parts.parts[e.second]
            vectors = tuple(v for v in one.vectors if v in other.vectors)
        found.append(TreeEdge(name, e.how, e.first, e.second, e.at, axes, points, vectors, user=user,
                          wanted=bool(e.angle or e.distance)))  # fmt: skip
    for p, holders in parts.of_point.items():
        fixed = parts.a.fixed[p]
        if fixed.any() and not fixed.all():
            found += [_edge_of_fixed_point(parts, k, p) for k in holders if k]
        loose = [k for k in holders if not can_turn(parts, k)]
        found += [TreeEdge(parts.point(p), "spherical", i, j, (p, p), [], (p,)) for i, j in combinations(holders, 2)
                  if loose and not (i in loose and j in loose)]  # fmt: skip
    for name, joint in parts.model.joints.items():
        if isinstance(joint, record.Slot):
            pin = parts.a.index[joint.point]
            i, axis = _find_carrier(parts, home, joint.line)
            for j in parts.of_point[pin]:
                if i is not None and j != i:
                    found.append(TreeEdge(name, "slot", i, j, (pin, pin), [axis], user=True, turns=can_turn(parts, j)))
        elif isinstance(joint, record.Planar):
            i, normal = _find_carrier(parts, home, joint.plane)
            other = (joint.on, joint.plane[1]) if isinstance(joint.on, str) else joint.on
            j, _ = _find_carrier(parts, home, other)
            if i is not None and j is not None and i != j:
                shared = (parts.a.vector_index[joint.plane[1]],) if joint.plane[1] == other[1] else ()
                at = parts.a.index[joint.plane[0]], parts.a.index[other[0]]
                found.append(TreeEdge(name, "planar", i, j, at, [normal], (), shared, user=True))
    return found


def _find_carrier(parts: Parts, home: TreePose, line: tuple[str, str]) -> tuple[int | None, Vec]:
    """Find the part that carries a line, a point and a vector or two points, and the direction of the line."""
    p = parts.a.index[line[0]]
    if line[1] in parts.a.vector_index:
        points, vectors = (p,), (parts.a.vector_index[line[1]],)
    else:
        points, vectors = (p, parts.a.index[line[1]]), ()
    return parts.holder(points, vectors), home.along((points, vectors))


def _rolling_edges(parts: Parts, home: TreePose, name: str, joint: record.Rolling) -> list[TreeEdge]:
    """Make the edges of a disc that rolls on a line: its centre slides along it and it turns; its contact slides."""
    i, along = _find_carrier(parts, home, joint.line)
    j = parts.holder((parts.a.index[joint.centre], parts.a.index[joint.rim]))
    if i is None or j is None or i == j:
        return []
    axis = Z
    if joint.axis is not None:
        line = joint.axis
        axis = home.span((~parts.a.vector_index[line],) if isinstance(line, str) else parts.a.pair(line))
    centre, contact = parts.a.index[joint.centre], parts.a.index[joint.contact]
    out = [TreeEdge(name, "rolling", i, j, (contact, centre), [along, axis], user=True)]
    for k in parts.of_point[contact]:
        if not can_turn(parts, k):
            out.append(TreeEdge(f"{name} contact", "slot", i, k, (contact, contact), [along], user=True, turns=False))
    return out
