"""The joint graph of a spatial mechanism: joints found from what parts share, and those of the description.

A part that is a bar between two others (a rod with ball joints) is no link of the tree: it is one equation, the
distance between its ends. Joints that a tree has no variables for (planar, constant-velocity, a pin in a slot) close
loops.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from jaxnc.families.bodies import Part, Parts
from jaxnc.mechanism import model as record
from jaxnc.system.identity import Owner, Thing

Line = tuple[tuple[int, ...], tuple[int, ...]]
"""A direction: two points, or a vector."""

_PARALLEL = 1e-9  # sine of an angle below which drawn directions are parallel


@dataclass
class SpatialEdge:
    """A joint between two parts in space."""

    how: str  # "revolute", "prismatic", "cylindrical", "universal", "spherical", "free"
    first: int  # a part
    second: int  # the other
    at: tuple[int, int]  # the point of the joint on each of them
    axes: tuple[Line, Line]  # directions of the joint on each of them: the axis, or the two arms of a universal joint
    owner: Owner  # the joint, the point that is shared, or what hangs free
    shared: tuple[tuple[int, ...], tuple[int, ...]] = ((), ())  # points and vectors that it joins
    drops: bool = False  # whether the rows of its name are met by its variables
    angle: str = ""  # the user's coordinate that is its angle
    distance: str = ""  # the user's coordinate that is its distance

    @property
    def freedoms(self) -> int:
        """Relative freedoms."""
        return {"revolute": 1, "prismatic": 1, "cylindrical": 2, "universal": 2, "spherical": 3, "free": 6}[self.how]


def without_rods(parts: Parts) -> Parts:
    """The parts without bars whose ends other parts hold."""
    kept: list[Part] = list(parts.parts)
    for part in parts.parts:
        others = [p for p in kept if p is not part and p.turns == "fully"]
        points = {i for p in others for i in p.points}
        vectors = {v for p in others for v in p.vectors}
        if part.turns == "bar" and set(part.points) <= points and set(part.vectors) <= vectors:
            kept.remove(part)
    parts.parts = kept
    parts.of_point = {p: [k for k, part in enumerate(kept) if p in part.points] for p in parts.a.index.values()}
    parts.of_vector = {
        v: [k for k, part in enumerate(kept) if v in part.vectors] for v in parts.a.vector_index.values()
    }
    return parts


def edges(parts: Parts) -> list[SpatialEdge]:
    """All joints that a tree may be made of."""
    found: list[SpatialEdge] = []
    whole = [k for k, p in enumerate(parts.parts) if p.turns != "no"]
    described = [
        e
        for name, j in parts.model.joints.items()
        if (e := _described(parts, parts.a.owning(Thing.JOINT, name), j)) is not None
    ]
    for i, j in combinations(whole, 2):
        a, b = parts.parts[i], parts.parts[j]
        points = tuple(p for p in a.points if p in b.points)
        vectors = tuple(v for v in a.vectors if v in b.vectors)
        if not points:
            continue
        if any({e.first, e.second} == {i, j} and e.how == "universal" for e in described):
            continue
        axis: Line | None = ((), vectors[:1]) if vectors else (points[:2], ()) if len(points) > 1 else None
        pin = next(iter(points))
        at, owner = (pin, pin), Owner(Thing.POINT, pin)
        if axis is None:
            found.append(SpatialEdge("spherical", i, j, at, (((), ()), ((), ())), owner, (points, ())))
        else:
            found.append(SpatialEdge("revolute", i, j, at, (axis, axis), owner, (points, vectors)))
    found += described
    for edge in found:
        _name(parts, edge)
    return found


def _line(parts: Parts, direction: record.Direction) -> Line:
    if isinstance(direction, str):
        return (), (parts.a.vector_index[direction],)
    return parts.a.pair(direction), ()


def _axis(parts: Parts, line: record.Pair) -> Line:
    """The direction of a line: a point and a vector, or two points."""
    if line[1] in parts.a.vector_index:
        return (), (parts.a.vector_index[line[1]],)
    return parts.a.pair(line), ()


def _holder(parts: Parts, point: int | None, line: Line, but: int | None = None) -> int | None:
    """A part that holds a point and a direction."""
    points = (*line[0], *(() if point is None else (point,)))
    for k, part in enumerate(parts.parts):
        whole = set(points) <= set(part.points) and set(line[1]) <= set(part.vectors)
        if k != but and part.turns != "no" and whole and (points or line[1]):
            return k
    return None


def _described(parts: Parts, owner: Owner, joint: record.Joint) -> SpatialEdge | None:
    """A joint of the description as an edge; None for one that a tree has no variables for."""
    if isinstance(joint, record.Prismatic | record.Cylindrical | record.Screw):
        how = "prismatic" if isinstance(joint, record.Prismatic) else "cylindrical"
        axis, start = _axis(parts, joint.line), parts.a.index[joint.line[0]]
        if isinstance(joint.on, str):
            on, other = parts.a.index[joint.on], axis if axis[1] else None
        else:
            on, other = parts.a.index[joint.on[0]], _axis(parts, joint.on)
        if other is None:
            return None
        directions = getattr(joint, "directions", None)
        i = _both(parts, start, axis, None if directions is None else _line(parts, directions[0]))
        j = _both(parts, on, other, None if directions is None else _line(parts, directions[1]), i)
        if i is None or j is None:
            return None
        shared = axis[1] if axis == other else ()
        edge = SpatialEdge(how, i, j, (start, on), (axis, other), owner, ((), shared), True)
        if isinstance(joint, record.Screw):
            edge.angle, edge.distance = joint.angle, joint.distance
        return edge
    if isinstance(joint, record.Revolute | record.Universal):
        assert joint.axes is not None
        a, b = (_line(parts, axis) for axis in joint.axes)
        first, second = (joint.points and parts.a.pair(joint.points)) or (None, None)
        i = _holder(parts, first, a)
        j = _holder(parts, second, b, i)
        if i is None or j is None:
            return None
        points: tuple[int, ...] = ()
        if first is None or second is None:
            points = tuple(p for p in parts.parts[i].points if p in parts.parts[j].points)
            if not points:
                return None
            first = second = points[0]
        how = "revolute" if isinstance(joint, record.Revolute) else "universal"
        return SpatialEdge(how, i, j, (first, second), (a, b), owner, (points[:1], ()), True)
    if isinstance(joint, record.Spherical):
        p, q = parts.a.pair(joint.points)
        i = _holder(parts, p, ((), ()))
        j = _holder(parts, q, ((), ()), i)
        if i is not None and j is not None:
            return SpatialEdge("spherical", i, j, (p, q), (((), ()), ((), ())), owner, ((), ()), True)
    return None


def _both(parts: Parts, point: int, axis: Line, across: Line | None, but: int | None = None) -> int | None:
    """The part that holds a line, and a direction across it."""
    if across is not None:
        whole = (*axis[0], *across[0]), (*axis[1], *across[1])
        found = _holder(parts, point, whole, but)
        if found is not None:
            return found
    return _holder(parts, point, axis, but)


def drawn(parts: Parts, line: Line) -> np.ndarray:
    """A direction as drawn, a unit vector."""
    d = parts.a.vectors[line[1][0]] if line[1] else parts.a.home[line[0][1]] - parts.a.home[line[0][0]]
    return d / np.linalg.norm(d)


def _name(parts: Parts, edge: SpatialEdge) -> None:
    """Find the user's coordinates that are a joint's."""
    pair = {edge.first, edge.second}
    if edge.how in ("revolute", "cylindrical"):
        for name, angle in parts.model.angles.items():
            ends = ends_of(parts, angle)
            if edge.angle or ends is None:
                continue
            about, start, to = ends
            one = 0 if start is None else _holder(parts, None, start)
            other = _holder(parts, None, to)
            if start is not None and {one, other} != pair:
                # A direction that several parts hold: any pair will do.
                one = next((k for k in pair if holds(parts, k, start)), None)
                other = next((k for k in pair if k != one and holds(parts, k, to)), None)
            along = np.linalg.norm(np.cross(drawn(parts, about), drawn(parts, edge.axes[0]))) < _PARALLEL
            if along and one is not None and other is not None and {one, other} == pair:
                edge.angle = name
    if edge.how in ("prismatic", "cylindrical"):
        for name, distance in parts.model.distances.items():
            if edge.distance or distance.along is None:
                continue
            start, to = parts.a.pair((distance.start, distance.to))
            along = along_of(parts, distance)
            parallel = np.linalg.norm(np.cross(drawn(parts, along), drawn(parts, edge.axes[0]))) < _PARALLEL
            held = [(_points(parts, i, start) and _points(parts, j, to)) for i, j in
                    ((edge.first, edge.second), (edge.second, edge.first))]  # fmt: skip
            if parallel and any(held) and any(holds(parts, k, along) for k in pair):
                edge.distance = name


def holds(parts: Parts, k: int, line: Line) -> bool:
    """Whether a part holds a direction."""
    return _points(parts, k, *line[0]) and set(line[1]) <= set(parts.parts[k].vectors)


def _points(parts: Parts, k: int, *points: int) -> bool:
    return set(points) <= set(parts.parts[k].points)


def ends_of(parts: Parts, angle: record.Angle) -> tuple[Line, Line | None, Line] | None:
    """Axis, start and end of an angle about an axis."""
    if angle.about is None:
        return None

    def end(spec: record.Direction) -> Line:
        if isinstance(spec, str) and spec in parts.a.index:
            assert angle.at is not None
            return parts.a.pair((angle.at, spec)), ()
        return _line(parts, spec)

    return _line(parts, angle.about), None if angle.start is None else end(angle.start), end(angle.to)


def along_of(parts: Parts, distance: record.Distance) -> Line:
    """The direction of a distance along a line."""
    assert distance.along is not None
    if isinstance(distance.along, str) and distance.along in parts.a.index:
        return parts.a.pair((distance.start, distance.along)), ()
    return _line(parts, distance.along)
