"""The rigid parts of a mechanism, as its one description gives them: ground, bodies, and what belongs to no body.

Bodies that are welded, or share so much that they cannot move against each other, are one part. A point of no body (a
pin that slides in a slot, a planar body of one point, a point of contact) is a part of its own without orientation.
"""

from dataclasses import dataclass, field
from itertools import combinations
from typing import NamedTuple

import numpy as np

from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.system.assemble import Assembler, PlanarAssembler, SpatialAssembler
from jaxnc.system.identity import GROUND, Owner, Thing, addresses

_GROUND = Owner(Thing.BODY, GROUND)
_ALONG = 1e-9  # sine of an angle below which directions are parallel


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


class Parts:
    """All parts of a mechanism; the ground is number 0."""

    def __init__(self, mechanism: Mechanism):
        self.mechanism, self.model = mechanism, mechanism.model
        self.dim = self.model.dim
        forms = PlanarAssembler if self.dim == 2 else SpatialAssembler
        self.a: Assembler = forms(mechanism)
        self.a.system()
        self.parts: list[Part] = [self._ground()]
        groups = self._merged()
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
        self.of_point = {p: [k for k, part in enumerate(self.parts) if p in part.points] for p in self.a.index.values()}
        self.of_vector = {
            v: [k for k, part in enumerate(self.parts) if v in part.vectors] for v in self.a.vector_index.values()
        }

    def _ground(self) -> Part:
        points = tuple(i for i, f in enumerate(self.a.fixed) if f.all())
        vectors = tuple(i for i, f in enumerate(self.a.fixed_vectors) if f)
        return Part("ground", points, vectors)

    def _rigid(self, points: set[int], vectors: set[int]) -> bool:
        """Whether two parts that share this cannot move against each other."""
        if not points:
            return False
        if self.dim == 2:
            return len(points) > 1
        first, *rest = points
        spans = [self.a.home[p] - self.a.home[first] for p in rest] + [self.a.vectors[v] for v in vectors]
        units = [d / np.linalg.norm(d) for d in spans if np.linalg.norm(d) > 0]
        return any(np.linalg.norm(np.cross(d, e)) > _ALONG for d, e in combinations(units, 2))

    def _merged(self) -> list[list[str]]:
        """Bodies by part, in order; those that are the ground become part of it."""
        specs = {b.name: b for b in self.a.bodies if self.dim == 3 or len(b.points) > 1}
        members: dict[str, tuple[set[int], set[int]]] = {n: (set(b.points), set(b.vectors)) for n, b in specs.items()}
        welds = [set(j.bodies) for j in self.model.joints.values() if isinstance(j, record.Weld)]
        ground = self.parts[0]
        held = (set(ground.points), set(ground.vectors))
        groups = [[n] for n in specs]

        def whole(group: list[str]) -> tuple[set[int], set[int]]:
            return set().union(*(members[n][0] for n in group)), set().union(*(members[n][1] for n in group))

        merging = True
        while merging:
            merging = False
            for g in list(groups):
                mine = whole(g)
                if self._rigid(mine[0] & held[0], mine[1] & held[1]) and not any(n in self.a.redrawn for n in g):
                    held = (held[0] | mine[0], held[1] | mine[1])
                    groups.remove(g)
                    merging = True
            for g, h in combinations(groups, 2):
                a, b = whole(g), whole(h)
                welded = any(w & set(g) and w & set(h) for w in welds)
                free = not any(n in self.a.redrawn for n in (*g, *h))
                if free and (welded or self._rigid(a[0] & b[0], a[1] & b[1])):
                    g.extend(h)
                    groups.remove(h)
                    merging = True
                    break
        ground.points, ground.vectors = tuple(sorted(held[0])), tuple(sorted(held[1]))
        return groups

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

    def holder(self, points: tuple[int, ...], vectors: tuple[int, ...] = ()) -> int | None:
        """The part that holds all of these."""
        for k, part in enumerate(self.parts):
            if set(points) <= set(part.points) and set(vectors) <= set(part.vectors):
                return k
        return None

    def joint(self, owner: Owner) -> record.Joint | None:
        """The record of a joint; None for what is no joint of the description."""
        return tuple(self.model.joints.values())[owner.number] if owner.thing is Thing.JOINT else None

    def point(self, k: int) -> str:
        """A point's name."""
        return self.a.names[k]
