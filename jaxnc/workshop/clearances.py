"""Clearances between plates and pins over a whole motion, between its poses too."""

from dataclasses import dataclass, replace

import numpy as np

from jaxnc.kinematics.host_solve import analyse_on_host
from jaxnc.kinematics.inputs import make_plan
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import sweep
from jaxnc.solvers.assembly import derive

_SAME = 1e-6  # of the size: a pose that was found again
_ROUNDS = 24


@dataclass(frozen=True)
class PartCourse:
    """Places of parts over a motion: stretches between neighbouring poses, in order."""

    motion: Motion
    weights: np.ndarray  # places as linear functions of the points, (places, points), complex
    constant: np.ndarray  # what is added, (places,)
    unit: float  # mm in a unit of length
    # Numbers of the poses at both ends of each stretch, (2, K); fractions lie between poses of the motion.
    s: np.ndarray
    z: np.ndarray  # places there, (2, K, places), complex, mm
    a: np.ndarray  # their second derivatives by s
    driven: bool  # whether poses in between can be found, by the inputs

    @classmethod
    def of(cls, motion: Motion, weights: np.ndarray, constant: np.ndarray, unit: float) -> "PartCourse":
        """Make the stretches between the poses of a motion ``(T,)``, T > 2."""
        count = len(np.asarray(motion.status))
        s = np.stack([np.arange(count - 1.0), np.arange(1.0, count)])
        z = complex_points(motion, unit) @ weights.T + constant
        both = np.stack([z[:-1], z[1:]])
        bare = cls(motion, weights, constant, unit, s, both, both, bool(motion.driven))
        if motion.driven:
            found = bare.solve(s, s[0].astype(int))
            size = max(float(np.ptp(np.abs(z))), float(np.abs(z).max()), 1e-300)
            if found is not None and np.abs(found[0] - both).max() <= _SAME * size:
                return replace(bare, a=found[1])
        # Nothing drives it, as in a simulation, or not everywhere, as on a circuit: by differences of its poses.
        step = np.diff(z, 2, axis=0)
        a = np.concatenate([step[:1], step, step[-1:]])
        return replace(bare, a=np.stack([a[:-1], a[1:]]), driven=False)

    @property
    def sags(self) -> np.ndarray:
        """Bounds of how far each place leaves the straight line between both ends of a stretch, mm, ``(K, places)``."""
        # accelerations between two poses are at most 2 times those at them
        return 2.0 / 8 * (self.s[1] - self.s[0])[:, None] ** 2 * np.abs(self.a).max(axis=0)

    def solve(self, s: np.ndarray, stretch: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Solve for places and second derivatives at numbers of poses ``(..., L)``, each in a stretch of the motion."""
        motion = self.motion
        asked = np.asarray(motion.asked, float)
        k = np.broadcast_to(stretch, s.shape).reshape(-1)
        slope = asked[k + 1] - asked[k]
        values = asked[k] + (s.reshape(-1) - k)[:, None] * slope
        near = np.asarray(motion.q, float)[np.minimum(np.rint(s.reshape(-1)).astype(int), len(asked) - 1)]
        view, eq = make_plan(motion.system, motion.driven, motion.held), derive(motion.system)
        found = analyse_on_host(view, "guess", eq, near, values, (slope, np.zeros_like(slope)))
        if found.status.any():
            return None
        z, a = (complex_points(motion, self.unit, x) @ self.weights.T for x in (found.q, found.rates[1]))
        shape = (*s.shape, len(self.weights))
        return (z + self.constant).reshape(shape), a.reshape(shape)

    def halve(self, which: np.ndarray) -> tuple["PartCourse", np.ndarray] | None:
        """Halve some stretches ``(K,)``; also from which one each comes. None where that cannot be done."""
        if not self.driven:
            return None
        at = np.flatnonzero(which)
        middle = self.s[:, at].mean(axis=0)
        found = self.solve(middle, np.floor(self.s[0, at]).astype(int))
        if found is None:
            return None
        if (np.abs(found[0] - self.z[:, at].mean(axis=0)) > self.sags[at] + _SAME * np.abs(found[0])).any():
            return None  # another branch, or no smooth motion

        def join(old: np.ndarray, new: np.ndarray) -> np.ndarray:
            first, last = np.stack([old[0, at], new]), np.stack([new, old[1, at]])
            return np.concatenate([old[:, ~which], first, last], axis=1)

        s, z, a = (join(x, y) for x, y in zip((self.s, self.z, self.a), (middle, *found), strict=True))
        source = np.concatenate([np.flatnonzero(~which), at, at])
        return replace(self, s=s, z=z, a=a), source


def complex_points(motion: Motion, unit: float, q: np.ndarray | None = None) -> np.ndarray:
    """Return points of a motion, or of other coordinates ``(T, N)``, as complex numbers ``(T, points)``, mm."""
    q = np.asarray(motion.q, float) if q is None else q
    x = q[:, : 2 * len(motion.system.topology.points)] * unit
    return x[:, ::2] + 1j * x[:, 1::2]


def follow_between(motion: Motion, unit: float) -> np.ndarray | None:
    """Return points as `complex_points` does, in at least 256 poses: those of a motion and others between, in order.

    None where the poses between cannot be followed, as where nothing drives a motion.
    """
    poses = complex_points(motion, unit)
    last = len(poses) - 1
    pieces = -(-256 // last)
    if pieces == 1 or not motion.driven:
        return poses if pieces == 1 else None
    at = np.linspace(0.0, last, last * pieces + 1)
    asked = {name: np.interp(at, np.arange(last + 1), np.asarray(values)) for name, values in motion.inputs.items()}
    found = sweep(motion.system, asked, hold=motion.held, start=motion.pose(0))
    z = complex_points(found, unit)
    same = np.abs(z[::pieces] - poses).max() <= _SAME * np.abs(poses).max()
    return z if same and not np.asarray(found.status).any() else None


class Gaps:
    """Distances of pairs of things over a course, at all its poses."""

    def __init__(self, course: PartCourse, radii: np.ndarray, shapes: list[tuple[np.ndarray, np.ndarray]]):
        self.course = course  # the stretches between poses
        self.radii = radii  # of each pair, what the outlines of both together are rounded by, mm
        self.shapes = shapes  # of each pair, which places of the course are the corners of both
        # Of both ends of each stretch, (2, K, pairs): distances, mm, not positive where things overlap, and their
        # directions, complex, 0 where they overlap.
        self.ends, self.ways = map(np.stack, zip(*map(self.measure, course.z), strict=True))
        self.low = self.bounds(np.arange(course.s.shape[1]))  # what the distance is at least, (K, pairs)
        self.unsure = False  # whether poses could not be looked at finely enough somewhere

    def measure(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return distances and their directions ``(K, pairs)`` at places ``(K, places)``."""
        out, ways = np.zeros((len(z), len(self.radii))), np.zeros((len(z), len(self.radii)), complex)
        for k, (one, other) in enumerate(self.shapes):
            out[:, k], ways[:, k] = distance(z[:, one], z[:, other])
        return out - self.radii, ways

    def bounds(self, at: np.ndarray) -> np.ndarray:
        """Bound the distance in some stretches from below, ``(L, pairs)``.

        Along a fixed direction two shapes whose corners move on straight lines are never nearer than at one of the
        ends, and how far corners leave these lines is known.
        """
        z, sags = self.course.z[:, at], self.course.sags[at]
        out = np.full((len(at), len(self.radii)), -np.inf)
        for k, (one, other) in enumerate(self.shapes):
            first, last = self.ways[0, at, k], self.ways[1, at, k]
            middle = first + last
            middle = middle / np.where(middle == 0, 1.0, np.abs(middle))
            for u in (first, last, middle):
                along = np.conj(u)[None, :, None]
                gap = (z[..., other] * along).real.min(axis=-1) - (z[..., one] * along).real.max(axis=-1)
                out[:, k] = np.maximum(out[:, k], np.where(u == 0, -np.inf, gap.min(axis=0)))
            out[:, k] -= sags[:, one].max(axis=1) + sags[:, other].max(axis=1) + self.radii[k]
        return np.minimum(out, self.ends[:, at].min(axis=0))

    def touching(self, clearance: float) -> np.ndarray:
        """Find the pairs that come closer than a clearance, ``(pairs,)``, or may do so as far as can be told."""
        for _ in range(_ROUNDS):
            near = self.ends.min(axis=(0, 1), initial=np.inf) < clearance
            open_ = (self.low < clearance) & ~near
            # ways shorter than 0.02 of the clearance are not looked at more finely
            fine = self.ends.min(axis=0) - self.low < 0.02 * clearance
            which = (open_ & ~fine).any(axis=1)
            if not which.any():
                return near | open_.any(axis=0)
            if not self.halve(which):
                break
        self.unsure = True
        return near | open_.any(axis=0)

    def least(self, only: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
        """Bound the least distance of some pairs from below, ``(pairs,)``; also return the pose where it was found."""
        if not only.any():
            return np.full(len(only), np.inf), np.zeros(len(only))
        for _ in range(_ROUNDS):
            best = self.ends.min(axis=(0, 1), initial=np.inf)
            # The least distance is known to 0.02 of the clearance, or 0.005 of itself, in the end.
            which = ((self.low < best - np.maximum(0.02 * tolerance, 0.005 * best)) & only).any(axis=1)
            if not which.any():
                break
            if not self.halve(which):
                self.unsure = True
                break
        flat = self.ends.reshape(-1, len(self.radii))
        return self.low.min(axis=0, initial=np.inf), self.course.s.reshape(-1)[flat.argmin(axis=0)]

    def halve(self, which: np.ndarray) -> bool:
        """Look at the middles of some stretches too."""
        found = self.course.halve(which)
        if found is None:
            return False
        course, source = found
        count = int(which.sum())
        first, last = slice(len(source) - 2 * count, len(source) - count), slice(len(source) - count, None)
        new = self.measure(course.z[1, first])
        self.course = course
        self.ends, self.ways, self.low = self.ends[:, source], self.ways[:, source], self.low[source]
        for kept, middle in ((self.ends, new[0]), (self.ways, new[1])):
            kept[1, first] = middle
            kept[0, last] = middle
        at = np.arange(first.start, len(source))
        self.low[at] = self.bounds(at)
        return True


def distance(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Measure how far convex shapes ``(K, corners)``, complex, anticlockwise, are apart.

    Returns:
        Distances ``(K,)`` and their directions from the first to the other; both 0 where they overlap.
    """
    there, back = _shortest_way(one, other), -_shortest_way(other, one)
    way = np.where(np.abs(there) <= np.abs(back), there, back)
    inside = _edges_cross(one, other) | _is_inside(one[:, 0], other) | _is_inside(other[:, 0], one)
    size = np.where(inside, 0.0, np.abs(way))
    return size, np.where(size > 0, way / np.where(size > 0, size, 1.0), 0.0)


def _edges(shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    n = shape.shape[1]
    start = shape if n != 2 else shape[:, :1]
    return start, np.roll(shape, -1, axis=1)[:, : start.shape[1]]


def _shortest_way(points: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Find the shortest way from corners to the edges of a shape, complex, ``(K,)``."""
    a, b = _edges(shape)
    d, w = (b - a)[:, None], points[:, :, None] - a[:, None]
    size = np.abs(d) ** 2
    t = np.clip(np.real(w * np.conj(d)) / np.where(size > 0, size, 1.0), 0.0, 1.0)
    ways = (t * d - w).reshape(len(points), -1)
    return np.take_along_axis(ways, np.abs(ways).argmin(axis=1)[:, None], axis=1)[:, 0]


def _edges_cross(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    (a, b), (c, d) = _edges(one), _edges(other)
    a, b, c, d = a[:, :, None], b[:, :, None], c[:, None], d[:, None]

    def side(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
        return np.imag(np.conj(q - p) * (r - p))

    return np.any((side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0), axis=(1, 2))


def _is_inside(point: np.ndarray, shape: np.ndarray) -> np.ndarray:
    if shape.shape[1] < 3:
        return np.zeros(len(point), dtype=bool)
    a, b = _edges(shape)
    return np.all(np.imag(np.conj(b - a) * (point[:, None] - a)) >= 0, axis=1)
