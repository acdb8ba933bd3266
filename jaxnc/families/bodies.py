"""The rigid parts of a mechanism, as its one description gives them, and the joints between them.

The ground is a part, and so is every body. Bodies that are welded, or share so much that they cannot move against each
other, are one part. A point of no body (a pin that slides in a slot, a planar body of one point, a point of contact) is
a part of its own without orientation.

A joint that shares a point is found from the point, the others are those of the description. A spanning tree of the
joints gives the variables of relative coordinates: every joint left out closes one independent loop. In space a part
that is a bar between two others (a rod with ball joints) is no link of the tree: it is one equation, the distance
between its ends. Joints that a tree has no variables for (planar, constant-velocity, a pin in a slot) close loops; a
slot between parts that share two unit vectors, or one along it, is a prismatic or a cylindrical joint.
"""

import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.mechanism.checks import PARALLEL
from jaxnc.system.assemble import Assembler, PlanarAssembler, SpatialAssembler
from jaxnc.system.identity import GROUND, Owner, Thing, addresses

_GROUND = Owner(Thing.BODY, GROUND)


Line = tuple[tuple[int, ...], tuple[int, ...]]
"""A direction in space: two points, or a vector."""


class Origin(NamedTuple):
    """The reference point of a part: the mean of points, or from the first of them along segments of the part."""

    points: tuple[int, ...]  # the points; or the first one and the ends of those segments that are two points
    vectors: tuple[int, ...] = ()  # the segments that are unit vectors
    # Empty for the mean; else a letter for each segment, "p" or "v", and one factor for each direction: in the plane
    # the segment and its quarter turn, in space the segments and, of two, their vector product.
    how: tuple = ()


_MIDDLE = Origin(())


@dataclass
class Part:
    """One rigid part."""

    # The body's name; that of the first one where several are one part; the point's, or the vector's. Where two have
    # one name, with the kind of thing in front.
    name: str
    points: tuple[int, ...]  # its points, by index
    vectors: tuple[int, ...] = ()  # its unit vectors, by index
    turns: str = "fully"  # whether it has an orientation: "fully", "bar" (a direction only), "no"
    # Where its points are read, in the drawing or in its redrawn shape.
    drawn: dict[int, int] = field(default_factory=dict)
    axis: tuple[int, int] = (0, 0)  # in the plane, the two points that its angle is that of
    segments: tuple[tuple[int, ...], ...] = ()  # in space, the segments of its frame
    angle: str = ""  # in the plane, name of the user's coordinate that is its angle
    bodies: tuple[str, ...] = ()  # names of the bodies that it is made of
    owner: Owner = _GROUND  # what it is called after
    origin: Origin = _MIDDLE  # its reference point; the middle of its points unless said otherwise

    def __post_init__(self):
        self.origin = self.origin if self.origin.points else Origin(self.points)

    def holds(self, points: Iterable[int], vectors: Iterable[int] = ()) -> bool:
        """Say whether all of these are of the part."""
        return set(points) <= set(self.points) and set(vectors) <= set(self.vectors)


class Parts:
    """All parts of a mechanism; the ground is number 0."""

    def __init__(self, mechanism: Mechanism):
        self.mechanism, self.model = mechanism, mechanism.model
        self.dim = self.model.dim
        forms = PlanarAssembler if self.dim == 2 else SpatialAssembler
        self.a: Assembler = forms(mechanism)
        self.a.system()
        self.parts: list[Part] = [self._ground()]
        groups = self._merge()
        for members in groups:
            self.parts.append(self._part(members))
        held = {p for part in self.parts for p in part.points}
        self.parts += [
            Part(name, (i,), turns="no", owner=Owner(Thing.POINT, i))
            for name, i in self.a.index.items()
            if i not in held
        ]
        vectors = {v for part in self.parts for v in part.vectors}
        self.parts += [
            Part(u, (), (i,), "no", owner=Owner(Thing.VECTOR, i))
            for u, i in self.a.vector_index.items()
            if i not in vectors
        ]
        moving = self.parts[1:]
        for part, name in zip(moving, addresses(self.a.owners, [(p.owner, "") for p in moving]), strict=True):
            part.name = name
        self._note_holders()

    def _note_holders(self) -> None:
        parts = list(enumerate(self.parts))
        self.of_point = {p: [k for k, part in parts if p in part.points] for p in self.a.index.values()}
        self.of_vector = {v: [k for k, part in parts if v in part.vectors] for v in self.a.vector_index.values()}

    def drop_rods(self) -> None:
        """Leave out bars whose ends other parts hold."""
        for part in list(self.parts):
            others = [p for p in self.parts if p is not part and p.turns == "fully"]
            points = {i for p in others for i in p.points}
            vectors = {v for p in others for v in p.vectors}
            if part.turns == "bar" and set(part.points) <= points and set(part.vectors) <= vectors:
                self.parts.remove(part)
        self._note_holders()

    def _ground(self) -> Part:
        points = tuple(i for i, f in enumerate(self.a.fixed) if f.all())
        vectors = tuple(i for i, f in enumerate(self.a.fixed_vectors) if f)
        return Part("ground", points, vectors)

    def _rigid(self, points: set[int], vectors: set[int]) -> bool:
        """Say whether two parts that share this cannot move against each other."""
        if not points:
            return False
        if self.dim == 2:
            return len(points) > 1
        first, *rest = points
        spans = [self.a.home[p] - self.a.home[first] for p in rest] + [self.a.vectors[v] for v in vectors]
        units = [d / np.linalg.norm(d) for d in spans if np.linalg.norm(d) > 0]
        return any(np.linalg.norm(np.cross(d, e)) > PARALLEL for d, e in combinations(units, 2))

    def _merge(self) -> list[list[str]]:
        """Bodies by part, in order; those that are the ground become part of it."""
        ground = self.parts[0]
        members = {b.name: (set(b.points), set(b.vectors)) for b in self.a.bodies if self.dim == 3 or len(b.points) > 1}
        welds = [set(j.bodies) for j in self.model.joints.values() if isinstance(j, record.Weld)]
        groups = [[ground.name], *([name] for name in members)]
        members[ground.name] = set(ground.points), set(ground.vectors)

        def whole(group: list[str]) -> tuple[set[int], set[int]]:
            return set().union(*(members[n][0] for n in group)), set().union(*(members[n][1] for n in group))

        def one_part(g: list[str], h: list[str]) -> bool:
            if any(n in self.a.redrawn for n in (*g, *h)):
                return False
            a, b = whole(g), whole(h)
            return any(w & set(g) and w & set(h) for w in welds) or self._rigid(a[0] & b[0], a[1] & b[1])

        while pair := next((pair for pair in combinations(groups, 2) if one_part(*pair)), None):
            pair[0].extend(pair[1])
            groups.remove(pair[1])
        points, vectors = whole(groups[0])
        ground.points, ground.vectors = tuple(sorted(points)), tuple(sorted(vectors))
        return groups[1:]

    def _part(self, members: list[str]) -> Part:
        found = [b for b in self.a.bodies if b.name in members]
        points = tuple(dict.fromkeys(p for b in found for p in b.points))
        vectors = tuple(dict.fromkeys(v for b in found for v in b.vectors))
        drawn = self.a.redrawn.get(members[0], {})
        part = Part(members[0], points, vectors, drawn={p: drawn.get(p, p) for p in points}, bodies=tuple(members))
        part.owner = self.a.owning(Thing.BODY, members[0])
        if self.dim == 2:
            base = found[0].base
            assert base is not None
            part.axis = base
            for name, data in self.a.measured.items():
                ends = data.points
                if name in self.model.angles and len(ends) == 2 and set(ends) <= set(points) and not part.angle:
                    part.angle, part.axis = name, (ends[0], ends[1])
            return part
        fullest = max(found, key=lambda b: len(b.segments))
        part.segments = fullest.segments
        part.turns = "fully" if len(part.segments) > 1 else "bar"
        return part

    # -- who holds what -----------------------------------------------------------------------------------------

    def best(self, points: tuple[int, ...]) -> list[int]:
        """For every point of a constraint the part that carries it: the one that holds most of its points."""
        out = []
        for p in points:
            holders = self.of_point[p]
            out.append(max(holders, key=lambda k: (sum(q in self.parts[k].points for q in points), k == 0, -k)))
        return out

    def holder(
        self, points: Iterable[int], vectors: Iterable[int] = (), but: int | None = None, turning: bool = False
    ) -> int | None:
        """The first part that holds all of these, apart from one; with `turning` one that has an orientation."""
        points, vectors = tuple(points), tuple(vectors)
        for k, part in enumerate(self.parts):
            if k != but and part.holds(points, vectors) and not (turning and part.turns == "no"):
                return k
        return None

    def both_hold(self, first: int, second: int) -> tuple[int, ...]:
        """Unit vectors that two parts share."""
        return tuple(v for v in self.parts[first].vectors if v in self.parts[second].vectors)

    def joint(self, owner: Owner) -> record.Joint | None:
        """The record of a joint; None for what is no joint of the description."""
        return tuple(self.model.joints.values())[owner.number] if owner.thing is Thing.JOINT else None

    def point(self, k: int) -> str:
        """A point's name."""
        return self.a.names[k]

    # -- directions ---------------------------------------------------------------------------------------------

    def line(self, direction: record.Direction, at: str | None = None) -> Line:
        """A direction of the description: a vector, two points, or a point as seen from the point `at`."""
        name = direction if isinstance(direction, str) else direction[1]
        if name in self.a.vector_index:
            return (), (self.a.vector_index[name],)
        return self.a.pair((at or "", direction) if isinstance(direction, str) else direction), ()

    def unit_along(self, line: Line) -> np.ndarray:
        """A direction as drawn, a unit vector."""
        points, vectors = line
        d = self.a.vectors[vectors[0]] if vectors else self.a.home[points[1]] - self.a.home[points[0]]
        return d / np.linalg.norm(d)

    def parallel(self, one: Line, other: Line) -> bool:
        """Say whether two directions are drawn parallel."""
        return bool(np.linalg.norm(np.cross(self.unit_along(one), self.unit_along(other))) < PARALLEL)

    def ends(self, angle: record.Angle) -> tuple[Line | None, Line | None, Line]:
        """Axis, start and end of an angle; without an axis in the plane."""
        about = None if angle.about is None else self.line(angle.about)
        start = None if angle.start is None else self.line(angle.start, angle.at)
        return about, start, self.line(angle.to, angle.at)

    def along(self, distance: record.Distance) -> Line:
        """The direction of a distance along a line."""
        assert distance.along is not None
        return self.line(distance.along, distance.start)


Joined = dict[int, dict[int, int]]
"""For every point (vector) a forest over the parts that hold it: the part before each, or itself."""


def apart(holders: Mapping[int, Sequence[int]]) -> Joined:
    """Nothing joined yet."""
    return {item: {k: k for k in parts} for item, parts in holders.items()}


def root(group: Mapping[int, int], k: int) -> int:
    """The representative of a group."""
    while group[k] != k:
        k = group[k]
    return k


def join(group: dict[int, int], first: int, second: int) -> None:
    """Make one group of two."""
    group[root(group, second)] = root(group, first)


def closures(joined: Joined) -> list[tuple[int, int, int]]:
    """List the items that parts still have to share, ``(item, part, part)``."""
    out = []
    for item, group in joined.items():
        group = dict(group)
        first, *others = group or {-1: -1}
        for k in others:
            if root(group, first) != root(group, k):
                join(group, first, k)
                out.append((item, first, k))
    return out


@dataclass(kw_only=True)
class Edge:
    """A joint between two parts."""

    # "revolute", "prismatic", "slot", "free"; in the plane "held" (a slot along an axis of the ground); in space
    # "cylindrical", "universal", "spherical", "planar".
    how: str
    first: int  # the part that carries the line, or either of them
    second: int  # the other
    owner: Owner  # the joint, the point that is shared, or what hangs free
    turns: bool = True  # of a point in a slot, whether its part has an orientation
    angle: str = ""  # the user's coordinate that is its angle
    distance: str = ""  # the user's coordinate that is its distance

    @property
    def freedoms(self) -> int:
        """Relative freedoms of a joint that a tree may take."""
        two = ("slot", "held", "cylindrical", "universal")
        return (3 if self.how == "spherical" else 2 if self.how in two else 1) - (not self.turns)


@dataclass(kw_only=True)
class PlanarEdge(Edge):
    """A joint between two parts in the plane."""

    point: int  # the pin, or the point that slides
    line: tuple[int, int] = (0, 0)  # the line, two points; of a distance, the direction that it is counted in
    on: tuple[int, int] = (0, 0)  # of a prismatic joint, the direction that slides
    start: int = 0  # where the distance is counted from


@dataclass(kw_only=True)
class SpatialEdge(Edge):
    """A joint between two parts in space."""

    at: tuple[int, int]  # the point of the joint on each of them
    # Directions of the joint on each of them: the axis, or the two arms of a universal joint.
    axes: tuple[Line, Line] = (((), ()), ((), ()))
    shared: tuple[tuple[int, ...], tuple[int, ...]] = ((), ())  # points and vectors that it joins
    drops: bool = False  # whether the rows of its name are met by its variables
    kept: tuple[Line, ...] = ()  # directions that are the same on both: with none anything turns, with two nothing

    @property
    def in_tree(self) -> bool:
        """Tell whether relative coordinates have variables for it."""
        return self.how not in ("slot", "planar")


class _Joint(Protocol):
    """A joint between two parts, by their numbers."""

    first: int
    second: int


_AnyEdge = TypeVar("_AnyEdge", bound=_Joint)


def spanning_tree(
    count: int, edges: Iterable[_AnyEdge], free: Callable[[int], _AnyEdge]
) -> Iterator[tuple[_AnyEdge, int, int]]:
    """The joints of a spanning tree, each with the part before it and the part that hangs on it, from the ground on.

    Args:
        count: how many parts there are.
        edges: joints; the first that join what is not joined yet are those of the tree.
        free: what holds a part that no joint leads to.
    """
    group, chosen = {k: k for k in range(count)}, []
    for edge in edges:
        if root(group, edge.first) != root(group, edge.second):
            join(group, edge.first, edge.second)
            chosen.append(edge)
    reached = {0}
    while len(reached) < count:
        edge = next((e for e in chosen if (e.first in reached) != (e.second in reached)), None)
        if edge is None:
            edge = free(next(k for k in range(1, count) if k not in reached))
        parent, child = (edge.first, edge.second) if edge.first in reached else (edge.second, edge.first)
        reached.add(child)
        yield edge, parent, child


def planar_edges(parts: Parts) -> list[PlanarEdge]:
    """All joints of a planar mechanism that a tree may be made of."""
    found: list[PlanarEdge] = []
    for p, holders in parts.of_point.items():
        owner = Owner(Thing.POINT, p)
        found += [
            PlanarEdge(how="revolute", first=a, second=b, point=p, owner=owner) for a, b in combinations(holders, 2)
        ]
        axes = parts.a.fixed[p]
        if axes.any() and not axes.all():
            for k in holders:
                turns = parts.parts[k].turns != "no"
                found.append(PlanarEdge(how="held", first=0, second=k, point=p, owner=owner, turns=turns))
    for name, joint in parts.model.joints.items():
        owner = parts.a.owning(Thing.JOINT, name)
        if not isinstance(joint, record.Prismatic | record.Slot):
            continue
        line = parts.a.pair(joint.line)
        i = parts.holder(line)
        if i is None:
            continue
        edge = functools.partial(PlanarEdge, first=i, line=line, start=line[0], owner=owner)
        if isinstance(joint, record.Prismatic):
            on = parts.a.pair(joint.on)
            j = parts.holder(on)
            if j is not None and i != j:
                found.append(edge(how="prismatic", second=j, point=on[0], on=on))
        else:
            pin = parts.a.index[joint.point]
            found += [
                edge(how="slot", second=j, point=pin, turns=parts.parts[j].turns != "no")
                for j in parts.of_point[pin]
                if j != i
            ]
    for edge in found:
        if edge.how != "prismatic":
            _name_angle(parts, edge)
        for name, data in parts.a.measured.items():
            ends: tuple[int, ...] = data.points
            if name in parts.model.distances and edge.how in ("prismatic", "slot") and not edge.distance:
                along = len(ends) == 4 and set(ends[2:]) == set(edge.line)
                if along and ends[0] in edge.line and ends[1] == edge.point:
                    edge.distance, edge.start, edge.line = name, ends[0], (ends[2], ends[3])
    return found


def _name_angle(parts: Parts, edge: Edge, axis: Line | None = None) -> None:
    """Find the user's angle that is a joint's, in space about its axis."""
    pair = {edge.first, edge.second}
    for name, angle in parts.model.angles.items():
        about, start, to = parts.ends(angle)
        one = 0 if start is None else parts.holder(*start, turning=True)
        other = parts.holder(*to, turning=True)
        if start is not None and {one, other} != pair:
            # A direction that several parts hold: any pair will do.
            one = next((k for k in pair if parts.parts[k].holds(*start)), None)
            other = next((k for k in pair if k != one and parts.parts[k].holds(*to)), None)
        along = about is None or axis is None or parts.parallel(about, axis)
        if along and not edge.angle and one is not None and other is not None and {one, other} == pair:
            edge.angle = name


def spatial_edges(parts: Parts) -> list[SpatialEdge]:
    """All joints of a spatial mechanism that a tree may be made of."""
    found: list[SpatialEdge] = []
    described = [
        edge
        for name, joint in parts.model.joints.items()
        for edge in _describe_edges(parts, parts.a.owning(Thing.JOINT, name), joint)
    ]
    whole = [k for k, p in enumerate(parts.parts) if p.turns != "no"]
    for i, j in combinations(whole, 2):
        a, b = parts.parts[i], parts.parts[j]
        points = tuple(p for p in a.points if p in b.points)
        vectors = parts.both_hold(i, j)
        if not points or any({e.first, e.second} == {i, j} and e.how == "universal" for e in described):
            continue
        pin = points[0]
        edge = functools.partial(SpatialEdge, first=i, second=j, at=(pin, pin), owner=Owner(Thing.POINT, pin))
        if vectors or len(points) > 1:
            axis: Line = ((), vectors[:1]) if vectors else (points[:2], ())
            found.append(edge(how="revolute", axes=(axis, axis), shared=(points, vectors)))
        else:
            found.append(edge(how="spherical", shared=(points, ())))
    found = [_narrow(parts, edge) for edge in (*found, *described)]
    for edge in found:
        if edge.how in ("revolute", "cylindrical") and not edge.angle:
            _name_angle(parts, edge, edge.axes[0])
        if edge.how in ("prismatic", "cylindrical"):
            _name_distance(parts, edge)
    return found


def _narrow(parts: Parts, edge: SpatialEdge) -> SpatialEdge:
    """A joint as the unit vectors that both parts hold leave it: along a line without a turn it is prismatic."""
    if edge.how == "universal":
        return edge
    vectors, how, axes = parts.both_hold(edge.first, edge.second), edge.how, edge.axes
    kept = [axes[0]] * {"spherical": 0, "slot": 0, "prismatic": 2}.get(how, 1)
    for line in (((), (v,)) for v in vectors):
        if len(kept) < 2 and not any(parts.parallel(line, known) for known in kept):
            kept.append(line)
    mine = next((((), (v,)) for v in vectors if any(axes[0]) and parts.parallel(((), (v,)), axes[0])), axes[1])
    if how in ("slot", "cylindrical") and len(kept) == 2:
        how, axes = "prismatic", (axes[0], mine)
    elif how == "slot" and kept and parts.parallel(kept[0], axes[0]):
        how, axes = "cylindrical", (axes[0], mine)
    elif how == "spherical" and kept:
        how, axes = "revolute", (kept[0], kept[0])
    if how == "revolute":
        vectors = tuple(v for v in vectors if parts.parallel(((), (v,)), axes[0]))
    return replace(edge, how=how, axes=axes, kept=tuple(kept), shared=(edge.shared[0], vectors))


def _describe_edges(parts: Parts, owner: Owner, joint: record.Joint) -> list[SpatialEdge]:
    """A joint of the description as edges: of a pin in a slot one to every part that holds the pin."""
    edge = functools.partial(SpatialEdge, owner=owner, drops=True)
    if isinstance(joint, record.Slot):
        axis, pin = parts.line(joint.line), parts.a.index[joint.point]
        i = _hold_line(parts, parts.a.index[joint.line[0]], axis)
        return [
            edge(how="slot", first=i, second=j, at=(pin, pin), axes=(axis, axis))
            for j in parts.of_point[pin]
            if i is not None and j != i and parts.parts[j].turns != "no"
        ]
    found = _describe_edge(parts, edge, joint)
    return [] if found is None else [found]


def _describe_edge(parts: Parts, edge: Callable[..., SpatialEdge], joint: record.Joint) -> SpatialEdge | None:
    """A joint of the description between two parts; None for one that joins no two."""
    at: tuple[int | None, int | None] = (None, None)
    axes: tuple[Line, ...] = (((), ()), ((), ()))
    across: tuple[Line | None, ...] = (None, None)
    shared: tuple[tuple[int, ...], tuple[int, ...]] = ((), ())
    if isinstance(joint, record.Planar):
        other = (joint.on, joint.plane[1]) if isinstance(joint.on, str) else joint.on
        how, at = "planar", (parts.a.index[joint.plane[0]], parts.a.index[other[0]])
        axes = parts.line(joint.plane), parts.line(other)
    elif isinstance(joint, record.Prismatic | record.Cylindrical | record.Screw):
        axis = parts.line(joint.line)
        if isinstance(joint.on, str) and not axis[1]:
            return None
        on, other = (joint.on, axis) if isinstance(joint.on, str) else (joint.on[0], parts.line(joint.on))
        how = "prismatic" if isinstance(joint, record.Prismatic) else "cylindrical"
        at, axes = (parts.a.index[joint.line[0]], parts.a.index[on]), (axis, other)
        shared = (), axis[1] if axis == other else ()
        if directions := getattr(joint, "directions", None):
            across = tuple(map(parts.line, directions))
    elif isinstance(joint, record.Revolute | record.Universal):
        assert joint.axes is not None
        how = "revolute" if isinstance(joint, record.Revolute) else "universal"
        axes = tuple(map(parts.line, joint.axes))
        if joint.points:
            at = parts.a.pair(joint.points)
    elif isinstance(joint, record.Spherical):
        how, at = "spherical", parts.a.pair(joint.points)
    else:
        return None
    i = _hold_line(parts, at[0], axes[0], across[0])
    j = _hold_line(parts, at[1], axes[1], across[1], i)
    if i is None or j is None:
        return None
    if None in at:
        pin = next((p for p in parts.parts[i].points if p in parts.parts[j].points), None)
        if pin is None:
            return None
        at, shared = (pin, pin), ((pin,), ())
    found = edge(how=how, first=i, second=j, at=at, axes=axes, shared=shared)
    if isinstance(joint, record.Screw):
        found.angle, found.distance = joint.angle, joint.distance
    return found


def _hold_line(
    parts: Parts, point: int | None, axis: Line, across: Line | None = None, but: int | None = None
) -> int | None:
    """The part that holds a point and a direction, and if one does a direction across it too."""
    points, vectors = (*axis[0], *(() if point is None else (point,))), axis[1]
    if across is not None:
        found = parts.holder((*points, *across[0]), (*vectors, *across[1]), but, True)
        if found is not None:
            return found
    return parts.holder(points, vectors, but, True)


def _name_distance(parts: Parts, edge: SpatialEdge) -> None:
    """Find the user's distance that a joint slides by."""
    for name, distance in parts.model.distances.items():
        if edge.distance or distance.along is None:
            continue
        start, to = parts.a.pair((distance.start, distance.to))
        along, sides = parts.along(distance), [parts.parts[k] for k in (edge.first, edge.second)]
        held = any(i.holds((start,)) and j.holds((to,)) for i, j in (sides, sides[::-1]))
        if parts.parallel(along, edge.axes[0]) and held and any(part.holds(*along) for part in sides):
            edge.distance = name
