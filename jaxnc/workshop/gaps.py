"""Clearances between plates and pins over a whole motion, between its poses too."""

from dataclasses import dataclass

import numpy as np

from jaxnc.io.workshop.course import Course

_ROUNDS = 24
_FINE = 0.02  # of the clearance: ways that are not looked at more finely
_SURE = 0.02  # of the clearance: how well the least distance is known in the end,
_PART = 0.005  # and of itself


@dataclass(frozen=True)
class Pair:
    """Two things that may come near each other."""

    kind: str  # "parts", "pin and part", "pins" (their spacers) or "slot" (pins in one slot)
    one: int  # number of the first, a pin where there is one
    other: int  # number of the second
    radii: float  # of both together, mm: what their outlines are rounded by


@dataclass
class Gaps:
    """Distances of pairs over a course."""

    course: Course  # the stretches between poses
    pairs: list[Pair]
    shapes: list[tuple[np.ndarray, np.ndarray]]  # of each pair, which places of the course are the corners of both
    ends: np.ndarray  # distance at both ends of each stretch, (2, K, pairs), mm; not positive where they overlap
    ways: np.ndarray  # direction of the distance at both ends, complex, (2, K, pairs); 0 where they overlap
    low: np.ndarray  # what the distance is at least in each stretch, (K, pairs)
    unsure: bool = False  # whether poses could not be looked at finely enough somewhere

    @classmethod
    def of(cls, course: Course, pairs: list[Pair], shapes: list[tuple[np.ndarray, np.ndarray]]) -> "Gaps":
        """Measure all pairs at all poses."""
        none = np.zeros((2, 0, 0))
        found = cls(course, pairs, shapes, none, none, none[0])
        both = [found.measured(z) for z in course.z]
        found.ends, found.ways = np.stack([b[0] for b in both]), np.stack([b[1] for b in both])
        found.low = found.bounds(np.arange(course.s.shape[1]))
        return found

    def measured(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances and their directions ``(K, pairs)`` at places ``(K, places)``."""
        out, ways = np.zeros((len(z), len(self.pairs))), np.zeros((len(z), len(self.pairs)), complex)
        for k, (pair, (one, other)) in enumerate(zip(self.pairs, self.shapes, strict=True)):
            gap, ways[:, k] = parted(z[:, one], z[:, other])
            out[:, k] = gap - pair.radii
        return out, ways

    def bounds(self, at: np.ndarray) -> np.ndarray:
        """What the distance is at least in some stretches, ``(L, pairs)``.

        Along a fixed direction two shapes whose corners move on straight lines are never nearer than at one of the
        ends, and how far corners leave these lines is known.
        """
        z, sags = self.course.z[:, at], self.course.sags[at]
        out = np.full((len(at), len(self.pairs)), -np.inf)
        for k, (pair, (one, other)) in enumerate(zip(self.pairs, self.shapes, strict=True)):
            first, last = self.ways[0, at, k], self.ways[1, at, k]
            middle = first + last
            middle = middle / np.where(middle == 0, 1.0, np.abs(middle))
            for u in (first, last, middle):
                along = np.conj(u)[None, :, None]
                gap = (z[..., other] * along).real.min(axis=-1) - (z[..., one] * along).real.max(axis=-1)
                out[:, k] = np.maximum(out[:, k], np.where(u == 0, -np.inf, gap.min(axis=0)))
            out[:, k] -= sags[:, one].max(axis=1) + sags[:, other].max(axis=1) + pair.radii
        return np.minimum(out, self.ends[:, at].min(axis=0))

    def touching(self, clearance: float) -> np.ndarray:
        """Which pairs come closer than a clearance, ``(pairs,)``; those that may be so too, as far as can be told."""
        for _ in range(_ROUNDS):
            near = self.ends.min(axis=(0, 1), initial=np.inf) < clearance
            open_ = (self.low < clearance) & ~near
            fine = self.ends.min(axis=0) - self.low < _FINE * clearance
            which = (open_ & ~fine).any(axis=1)
            if not which.any():
                return near | open_.any(axis=0)
            if not self.halve(which):
                break
        self.unsure = True
        return near | open_.any(axis=0)

    def least(self, only: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
        """The least distance of some pairs: what it is at least, ``(pairs,)``, and the pose at which it was found."""
        if not only.any():
            return np.full(len(only), np.inf), np.zeros(len(only))
        for _ in range(_ROUNDS):
            best = self.ends.min(axis=(0, 1), initial=np.inf)
            which = ((self.low < best - np.maximum(_SURE * tolerance, _PART * best)) & only).any(axis=1)
            if not which.any():
                break
            if not self.halve(which):
                self.unsure = True
                break
        flat = self.ends.reshape(-1, len(self.pairs))
        return self.low.min(axis=0, initial=np.inf), self.course.s.reshape(-1)[flat.argmin(axis=0)]

    def halve(self, which: np.ndarray) -> bool:
        """Look at the middles of some stretches too."""
        found = self.course.split(which)
        if found is None:
            return False
        course, source = found
        count = int(which.sum())
        first, last = slice(len(source) - 2 * count, len(source) - count), slice(len(source) - count, None)
        new = self.measured(course.z[1, first])
        self.course = course
        self.ends, self.ways, self.low = self.ends[:, source], self.ways[:, source], self.low[source]
        for kept, middle in ((self.ends, new[0]), (self.ways, new[1])):
            kept[1, first] = middle
            kept[0, last] = middle
        at = np.arange(first.start, len(source))
        self.low[at] = self.bounds(at)
        return True


def apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Distance of two convex shapes ``(K, corners)``, complex, anticlockwise; 0 where they overlap, ``(K,)``."""
    return parted(one, other)[0]


def parted(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance of two convex shapes, and its direction from the first to the other; both 0 where they overlap."""
    there, back = _reach(one, other), -_reach(other, one)
    way = np.where(np.abs(there) <= np.abs(back), there, back)
    inside = _crossing(one, other) | _within(one[:, 0], other) | _within(other[:, 0], one)
    size = np.where(inside, 0.0, np.abs(way))
    return size, np.where(size > 0, way / np.where(size > 0, size, 1.0), 0.0)


def _edges(shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    n = shape.shape[1]
    start = shape if n != 2 else shape[:, :1]
    return start, np.roll(shape, -1, axis=1)[:, : start.shape[1]]


def _reach(points: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """The shortest way from corners to the edges of a shape, complex, ``(K,)``."""
    a, b = _edges(shape)
    d, w = (b - a)[:, None], points[:, :, None] - a[:, None]
    size = np.abs(d) ** 2
    t = np.clip(np.real(w * np.conj(d)) / np.where(size > 0, size, 1.0), 0.0, 1.0)
    ways = (t * d - w).reshape(len(points), -1)
    return np.take_along_axis(ways, np.abs(ways).argmin(axis=1)[:, None], axis=1)[:, 0]


def _crossing(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    (a, b), (c, d) = _edges(one), _edges(other)
    a, b, c, d = a[:, :, None], b[:, :, None], c[:, None], d[:, None]

    def side(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
        return np.imag(np.conj(q - p) * (r - p))

    return np.any((side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0), axis=(1, 2))


def _within(point: np.ndarray, shape: np.ndarray) -> np.ndarray:
    if shape.shape[1] < 3:
        return np.zeros(len(point), dtype=bool)
    a, b = _edges(shape)
    return np.all(np.imag(np.conj(b - a) * (point[:, None] - a)) >= 0, axis=1)
