"""Compiling rigid bodies in space (§4.1): which segments carry a body, and which rows keep it rigid.

A segment is a pair of points ``(i, j)`` or a unit vector ``(~k,)``. Two bodies often share one (a hinge's axis): its
length is then written once. That works best if a body's base is made of the segments that it shares, so these are
preferred as long as they are well conditioned.
"""

from collections.abc import Iterable
from itertools import combinations

import numpy as np

from jaxnc import constraints as kinds
from jaxnc.errors import MechanismError
from jaxnc.mechanism import model as record
from jaxnc.system.assembler import COINCIDENT, Assembler
from jaxnc.system.identity import Owner, Thing
from jaxnc.system.topology import BodyIndex, MarkerIndex, Segment

_IN_LINE = 1e-9  # sine of an angle below which directions are parallel
_NEARLY = 2e-3  # below which they are suspiciously nearly so, where a vector was typed in
_NEARLY_POINTS = 1e-5  # the same where all are points
_GOOD = 0.2  # from which a base counts as well conditioned
_NEARLY_FLAT = 1e-3  # volume of a base of three segments below which the text's form is badly conditioned


class SpatialBodies(Assembler):
    """Writes bodies, and knows which distances and angles their rows make constant."""

    def __init__(self, mechanism, sparse=None, hidden=()):
        super().__init__(mechanism, sparse, hidden)
        ground = {i for i, fixed in enumerate(self.fixed) if fixed.all()}
        ground |= {~k for k, fixed in enumerate(self.fixed_vectors) if fixed}
        self.rigid_sets: list[frozenset[int]] = [frozenset(ground)]
        self.members: dict[str, frozenset[int]] = {}

    # -- segments -----------------------------------------------------------------------------------------------

    def segment(self, direction: record.Direction) -> Segment:
        """The segment of a direction given by names."""
        if isinstance(direction, str):
            return (~self.vector_index[direction],)
        return self.pair(direction)

    def drawn(self, segment: Segment) -> np.ndarray:
        """A segment as drawn."""
        if len(segment) == 1:
            return self.vectors[~segment[0]]
        return self.home[segment[1]] - self.home[segment[0]]

    def called(self, segment: Segment) -> str:
        """A segment's name in messages."""
        if len(segment) == 1:
            return f"vector {self.vector_names[~segment[0]]!r}"
        return f"line {self.names[segment[0]]}-{self.names[segment[1]]}"

    def write(self, make, segments, first: tuple[int, ...] = (), **more):
        """Write an instance of a kind over directions, whose own points come first."""
        forms = "".join("v" if len(s) == 1 else "p" for s in segments)
        points = (*first, *(i for s in segments if len(s) == 2 for i in s))
        vectors = tuple(~s[0] for s in segments if len(s) == 1)
        drawn = (*first, *(i for s in segments if len(s) == 2 for i in self.length_of(*s)))
        kind = make(forms)
        if kind.scalars and "scalars" not in more:
            raise AssertionError(f"kind {kind.name!r} wants scalars")
        return self.add(kind, points, vectors=vectors, drawn=drawn, **more)

    def constant(self, *segments: Segment) -> bool:
        """Whether rows written before make the lengths and the angle of these segments constant."""
        items = {i for s in segments for i in s}
        return any(items <= known for known in self.rigid_sets)

    def rigid(self, segment: Segment) -> bool:
        """Whether a segment belongs to one body (or the ground)."""
        return self.constant(segment) or any(set(segment) <= body for body in self.members.values())

    def across_constant(self, axis: Segment, direction: Segment) -> bool:
        """Whether a body (or the ground) holds a direction together with the axis, or with a line drawn along it."""
        for body in (self.rigid_sets[0], *self.members.values()):
            if set(direction) <= body and (set(axis) <= body or self.spans(body, axis)):
                return True
        return False

    def spans(self, items: Iterable[int], axis: Segment, whole: bool = False) -> bool:
        """Whether a drawn axis is along a vector or a pair of points of some items; or with `whole`, if they fix it."""
        vectors: list[Segment] = [(i,) for i in items if i < 0]
        found = [self.drawn(s) for s in (*vectors, *combinations([i for i in items if i >= 0], 2))]
        units = [d / np.linalg.norm(d) for d in found if np.linalg.norm(d) > COINCIDENT * self.size]
        along = self.drawn(axis) / np.linalg.norm(self.drawn(axis))
        if whole and np.linalg.matrix_rank(np.array(units).reshape(-1, 3), tol=_NEARLY) > 1:
            return True
        return any(np.linalg.norm(np.cross(d, along)) < _NEARLY for d in units)

    # -- bodies -------------------------------------------------------------------------------------------------

    def add_bodies(self, specs: dict[str, record.Body]) -> None:
        for name, body in specs.items():
            items = (*self.at(*body.points), *(~self.vector_index[u] for u in body.vectors))
            self.members[name] = frozenset(items)

        def beyond_base(name: str) -> int:
            others = [s for n, s in self.members.items() if n != name] + [self.rigid_sets[0]]
            shared = sum(item < 0 and any(item in other for other in others) for item in self.members[name])
            return -max(shared - 2, 0)

        # Bodies that share more axes than their base can hold come first: what they fix need not be written again.
        found = {name: self.add_body(name, specs[name]) for name in sorted(specs, key=beyond_base)}
        self.bodies.extend(found[name] for name in specs)
        held = frozenset().union(self.rigid_sets[0], *self.members.values())
        for k in range(len(self.vector_names)):
            if ~k not in held:  # of no body: no other row gives it its length
                self.add(kinds.UNIT, (), vectors=(k,), owner=Owner(Thing.VECTOR, k))

    def add_body(self, name: str, body: record.Body) -> BodyIndex:
        self.owner = self.owning(Thing.BODY, name)
        points = self.at(*body.points)
        vectors = tuple(self.vector_index[u] for u in body.vectors)
        base = self.base(name, points, vectors, body.form)
        for segment in base:
            if not self.constant(segment):
                if len(segment) == 1:
                    self.add(kinds.UNIT, (), vectors=(~segment[0],))
                else:
                    self.add(kinds.DISTANCE, segment, drawn=self.length_of(*segment))
        third = self.third(points, vectors, base) if body.form == "text" else None
        if third is not None and not self.constant(third):
            self.add(kinds.DISTANCE, third, drawn=self.length_of(*third))  # (99) instead of a scalar product
            self.rigid_sets.append(frozenset(points))
        for pair in combinations(base, 2):
            if not self.constant(*pair):
                # Segments before vectors, and in order: the same product in two bodies is written once.
                self.write(kinds.product, sorted(pair, key=lambda s: (-len(s), s)))
        if len(base) == 3:
            self.write(kinds.handed, base)
        make = {1: kinds.collinear, 2: kinds.carried, 3: kinds.combined}[len(base)]
        if len(base) == 2 and body.form == "text" and len(points) + len(vectors) > 2:
            make = kinds.coplanar
        for segment in self.rest(points, vectors, base):
            if not self.constant(segment, *base):
                across = len(segment) == 1 and self.vector_names[~segment[0]] in self.hidden
                self.write(kinds.carried if across and len(base) == 2 else make, (*base, segment))
        self.rigid_sets.append(self.members[name])
        return BodyIndex(name, points, base[:2], vectors)

    def third(self, points: tuple[int, ...], vectors: tuple[int, ...], base: tuple[Segment, ...]) -> Segment | None:
        """The side of a triangle of points that its base leaves out; None for every other body."""
        if len(points) != 3 or len(base) != 2 or any(self.vector_names[k] not in self.hidden for k in vectors):
            return None
        return next(s for s in combinations(points, 2) if s not in base and s[::-1] not in base)

    def rest(self, points: tuple[int, ...], vectors: tuple[int, ...], base: tuple[Segment, ...]) -> list[Segment]:
        """Segments that tie what the base does not hold to it: one for each point and vector."""
        group = {p: p for p in points}

        def root(p: int) -> int:
            while group[p] != p:
                p = group[p]
            return p

        for segment in base:
            if len(segment) == 2:
                group[root(segment[1])] = root(segment[0])
        tied: list[Segment] = []
        for p in points[1:]:
            if root(p) != root(points[0]):
                tied.append((points[0], p))
                group[root(p)] = root(points[0])
        return tied + [(~k,) for k in vectors if (~k,) not in base]

    def base(
        self, name: str, points: tuple[int, ...], vectors: tuple[int, ...], form: str = "exact"
    ) -> tuple[Segment, ...]:
        """The segments that carry a body: as many as it has independent directions, at most two, three in text form."""
        pairs = [(i, j) for i, j in combinations(points, 2)]
        span = max((float(np.linalg.norm(self.drawn(s))) for s in pairs), default=0.0)
        pairs = [s for s in pairs if np.linalg.norm(self.drawn(s)) > COINCIDENT * self.size]
        candidates: list[Segment] = [(~k,) for k in vectors if self.vector_names[k] not in self.hidden] + pairs
        if not candidates:
            names = ", ".join(self.names[i] for i in points)
            raise MechanismError(f"body {name!r}: its points {names} are drawn at the same place; move one of them")
        sizes = [1.0 if len(s) == 1 else float(np.linalg.norm(self.drawn(s))) / span for s in candidates]
        units = np.array([self.drawn(s) / np.linalg.norm(self.drawn(s)) for s in candidates])
        shared = [self.shared(name, s) for s in candidates]
        area = np.linalg.norm(np.cross(units[:, None], units[None]), axis=-1)
        if area.max() <= _IN_LINE:
            best = max(range(len(candidates)), key=lambda i: (len(candidates[i]) == 1, shared[i], sizes[i]))
            return (candidates[best],)
        quality = area * np.outer(sizes, sizes)
        limit = _NEARLY if vectors else _NEARLY_POINTS
        if quality.max() < limit:
            i, j = np.unravel_index(int(area.argmax()), area.shape)
            degrees = np.degrees(np.arcsin(min(float(area[i, j]), 1.0)))
            raise MechanismError(
                f"body {name!r}: all its points and vectors are drawn nearly in one line ({self.called(candidates[i])} "
                f"and {self.called(candidates[j])} at {degrees:.2g}°), so its rotation about it is badly determined. "
                f"Draw them exactly in line if it is a bar that need not know it, or give it a point or vector "
                f"across the line"
            )
        chosen = self.best(2, quality, shared)
        if form == "text":
            volume = np.abs(np.einsum("ia,jka->ijk", units, np.cross(units[:, None], units[None])))
            volume = volume * np.einsum("i,j,k->ijk", sizes, sizes, sizes)
            if volume.max() > _IN_LINE:
                if volume.max() < _NEARLY_FLAT:
                    raise MechanismError(
                        f"body {name!r}: its points and vectors are drawn nearly in one plane, where the base of three "
                        f"segments of form='text' is badly conditioned; draw them in the plane, or use form='exact'"
                    )
                chosen = self.best(3, volume, shared)
        return tuple(candidates[i] for i in chosen)

    def shared(self, name: str, segment: Segment) -> int:
        """Whether a segment belongs to another body or the ground as well."""
        others = (s for n, s in self.members.items() if n != name)
        return int(self.constant(segment) or any(set(segment) <= other for other in others))

    @staticmethod
    def best(count: int, quality: np.ndarray, shared: list[int]) -> tuple[int, ...]:
        """The well-conditioned choice with most shared segments; the best-conditioned one if there is none."""
        good = _GOOD if count == 2 else _GOOD / 2

        def score(chosen: tuple[int, ...]):
            q = float(quality[chosen])
            return (q >= good, sum(shared[i] for i in chosen) if q >= good else 0, round(q, 9))

        return max(combinations(range(len(shared)), count), key=score)

    # -- markers ------------------------------------------------------------------------------------------------

    def marker(self, name: str, data: record.Marker) -> MarkerIndex:
        body = next(b for b in self.bodies if b.name == data.on)
        origin = body.points[0]
        given = np.array(data.direction if data.at is None else data.at, dtype=float)
        if data.at is not None:
            given = given - self.home[origin]
        if len(body.segments) == 1:
            along = self.drawn(body.segments[0])
            off = np.linalg.norm(np.cross(given, along / np.linalg.norm(along)))
            if off > 1e-9 * max(self.size, 1.0):
                raise MechanismError(
                    f"marker {name!r}: body {data.on!r} is a bar that does not know its rotation about its own line, "
                    f"and the marker is off that line; give the body a point or vector across it"
                )
        where = tuple(s if len(s) == 1 else self.length_of(*s) for s in body.segments)
        return MarkerIndex(name, data.on, origin, body.segments, where, data.at is None)
