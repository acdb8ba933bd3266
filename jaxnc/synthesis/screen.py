"""Screening: thousands of random designs looked at at once, to find starts that are worth refining."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from jaxnc.kinematics.redesign import flattened
from jaxnc.synthesis.boxes import Boxes, drawn
from jaxnc.synthesis.guidance import MotionGeneration
from jaxnc.synthesis.path import PathGeneration
from jaxnc.synthesis.poses import curves, marker, reached, reaching
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.projection import Limits, Linear, fitted, linear, moved
from jaxnc.synthesis.threads import in_threads

_CHUNK = 256  # designs at once: what is worked on fits into the processor's memory
_TABLE = 96  # poses of a design's whole curve
_GUESSES = 12  # timings tried for each shape
_FEWER = 5  # the same where each target has a direction too
_ANYWHERE = 4  # of them where the points have no order
_POINTS = 12  # targets that the first look takes, of more
_COARSE = 2  # poses of the table from one to the next that it takes
_SHARE = 0.25  # of the shapes that are looked at again, with all
_TIMINGS = 2  # of each of them
_AGAIN = 2  # times that their timings are taken anew from the curve fitted to them
_NEAR = 10  # poses of the table to both sides in which a nearer one is looked for


class Screened(NamedTuple):
    """Random starts.

    Attributes:
        x: those that are worth refining, ``(kept, n)``.
        unfit: how many there were that cannot move through their targets (of free timings: through the whole range).
    """

    x: np.ndarray
    unfit: int


def screen(problem: Problem, rng: np.random.Generator, count: int, most: int) -> Screened:
    """Random starts; where a part of the unknowns is linear, the most promising ones first.

    Args:
        problem: the problem.
        rng: of the random numbers.
        count: designs to look at.
        most: how many to keep.
    """
    found = linear(problem) if isinstance(problem, PathGeneration) else None
    z = drawn(problem, found, rng, count)
    if found is None:
        x = np.concatenate([z, problem.guesses(rng, count)], axis=1)
        fit = reaching(problem, x)
        return Screened(x[fit], int(np.sum(~fit)))
    assert isinstance(problem, PathGeneration)
    timed = problem.timing is not None and not problem.offset
    each = 1 if timed else _guesses(problem)
    guesses = problem.guesses(rng, count * each).reshape(count, each, len(problem.extras.names))
    some = range(0, count, _CHUNK)
    screened = _timed if timed else _Timings(problem, found, max(_SHARE, 2.0 * most / count)).best

    def part(k: int) -> tuple[np.ndarray, np.ndarray, int]:
        with np.errstate(all="ignore"):
            return screened(problem, found, z[k : k + _CHUNK], guesses[k : k + _CHUNK])

    parts = in_threads(part, some)
    x, merit = (np.concatenate([one[k] for one in parts]) for k in (0, 1))
    order = np.argsort(merit, kind="stable")[:most]
    return Screened(x[order[np.isfinite(merit[order])]], sum(one[2] for one in parts))


def _guesses(problem: PathGeneration) -> int:
    """How many timings are tried for each shape."""
    if isinstance(problem, MotionGeneration):
        return _FEWER
    return _GUESSES if problem.ordered else _ANYWHERE


def _places(problem: PathGeneration, found: Linear, z: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first base point of the tracer and the way to the second one, complex, from poses ``(designs, T, N)``."""
    points = len(problem.system.topology.points)

    def place(index: int) -> np.ndarray:
        if index >= points:  # a marker that is not free
            return marker(problem, z, q, index - points)
        return q[..., 2 * index] + 1j * q[..., 2 * index + 1]

    base = place(found.base[0])
    return base, place(found.base[1]) - base


def _limits(problem: PathGeneration, found: Linear, z: np.ndarray) -> Limits | None:
    """What bounds leave of designs; None where they are only drawn in them."""
    if not (any(found.axes) or found.scale or found.free):
        return None
    return Boxes.of(problem).limits(found, _flat(problem, z))


def _flat(problem: PathGeneration, z: np.ndarray) -> np.ndarray:
    """All parameters of designs."""
    flat = np.repeat(np.asarray(flattened(problem.system), dtype=float)[None], len(z), axis=0)
    flat[:, problem.variables.at] = z
    return flat


class _Turn:
    """The turn of a planar body that is guided: how it is turned in its frame is linear by itself.

    Its error is the distance of two complex numbers of length one, to which the mechanism's own turn adds nothing that
    the frame's does not.
    """

    wanted: Any = None

    def __init__(self, problem: PathGeneration):
        if isinstance(problem, MotionGeneration):
            self.reach, self.heavy = problem.reach, problem.weights * problem.reach**2
            self.wanted = np.exp(1j * problem.turns)
            self.base = next(b.base for b in problem.system.topology.bodies if b.name == problem.body)

    def seen(self, q: np.ndarray) -> np.ndarray:
        """The direction of the body in poses ``(designs, T, N)``; ones where no body is guided."""
        if self.wanted is None:
            return np.ones(q.shape[:-1], complex)
        assert self.base is not None
        a, b = self.base
        d = q[..., 2 * b] - q[..., 2 * a] + 1j * (q[..., 2 * b + 1] - q[..., 2 * a + 1])
        return d / np.maximum(np.abs(d), 1e-300)

    def fitted(self, seen: np.ndarray, some: Any = slice(None)) -> tuple[np.ndarray, Any]:
        """By how much bodies ``(…, M)`` are to be turned, complex ``(…,)``, and the squares that are left."""
        if self.wanted is None:
            return np.ones(seen.shape[:-1], complex), 0.0
        heavy, wanted = self.heavy[some], self.wanted[some]
        by = np.conj(seen) @ (heavy * wanted)
        by = by / np.maximum(np.abs(by), 1e-300)
        off = wanted - by[..., None] * seen
        return by, (off.real**2 + off.imag**2) @ heavy

    def extra(self, w: np.ndarray, by: np.ndarray) -> np.ndarray:
        """The problem's unknown for it ``(…, 1)``, of mechanisms that are turned with ``w``."""
        return (np.angle(w) - np.angle(by))[..., None] if self.wanted is not None else np.zeros((*np.shape(w), 0))


def _timed(
    problem: PathGeneration, found: Linear, z: np.ndarray, guesses: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int]:
    """Designs with everything linear fitted, timings known: unknowns, errors that are left, how many do not move."""
    turn = _Turn(problem)
    seen = reached(problem, np.concatenate([z, guesses[:, 0]], axis=1), 0)
    base, direction = _places(problem, found, z, seen.q)
    goal = problem.target @ np.array([1.0, 1j])
    z0, w, k, left = fitted(found, base, direction, goal, problem.weights, _limits(problem, found, z))
    by, more = turn.fitted(turn.seen(seen.q))
    good = np.all(seen.status == 0, axis=1)
    return *_put(problem, found, z, (z0, w, k, turn.extra(w, by)), left + more, good), int(np.sum(~good))


class _Curves(NamedTuple):
    """Tables of shapes, ``(B, poses)``: the tracer's base, the way along it, the direction of what is guided."""

    base: np.ndarray
    along: np.ndarray
    seen: np.ndarray
    begin: np.ndarray
    limits: Limits | None

    def of(self, at: np.ndarray) -> "_Curves":
        """Those of some shapes."""
        limits = self.limits and self.limits.of(at)
        return _Curves(self.base[at], self.along[at], self.seen[at], self.begin[at], limits)


class _Timings:
    """Designs with everything linear fitted and their timings taken from their curves."""

    def __init__(self, problem: PathGeneration, found: Linear, share: float):
        self.problem, self.found, self.share = problem, found, share
        self.target = problem.target @ np.array([1.0, 1j])
        self.low, self.high = problem.travel
        self.step = (self.high - self.low) / _TABLE
        self.turn = _Turn(problem)
        count = len(self.target)
        self.every = np.arange(count)
        self.few = np.unique(np.rint(np.linspace(0, count - 1, min(count, _POINTS))).astype(int))
        # What lies between those that were looked at is moved in proportion.
        self.spread = np.stack([np.interp(self.every, self.few, row) for row in np.eye(len(self.few))])

    def best(
        self, problem: PathGeneration, found: Linear, z: np.ndarray, guesses: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """Unknowns of the better part of designs with the best of its guesses, errors left, how many do not move."""
        q, good, begin = curves(problem, z, _TABLE + 1)
        good = np.all(good, axis=1)
        unfit = int(np.sum(~good))
        base, along = _places(problem, found, z, q)
        table = _Curves(base, along, self.turn.seen(q), begin, _limits(problem, found, z))
        guesses = guesses[..., : guesses.shape[-1] - (self.turn.wanted is not None)]
        if problem.timing is not None:
            u = PathGeneration.inputs(problem, guesses)
        else:
            u = np.cumsum(guesses, axis=2)  # which are steps
            z, good, table, u = self._likely(z, good, table, u)
            for _ in range(_AGAIN):
                u = self._moved(table, u, self.every)
        z0, w, k, by, left = self._fit(table, u, self.every)
        extra = guesses
        if problem.timing is None:
            extra = np.concatenate([u[..., :1], np.diff(u, axis=-1)], axis=-1)
        extra = np.concatenate([extra, self.turn.extra(w, by)], axis=-1)
        at = np.arange(len(z)), np.argmin(np.where(np.isfinite(left), left, np.inf), axis=1)
        return *_put(problem, found, z, (z0[at], w[at], k[at], extra[at]), left[at], good), unfit

    def _likely(self, z: np.ndarray, good: np.ndarray, table: _Curves, u: np.ndarray) -> Any:
        """The shapes and timings that are worth a closer look, from a quick one at a part of the targets."""
        first = u[..., self.few]
        new = self._moved(table, first, self.few, _COARSE)
        u = u + (new - first) @ self.spread
        *_, left = self._fit(table, new, self.few)
        left = np.where(good[:, None] & np.isfinite(left), left, np.inf)
        order = np.argsort(left, axis=1, kind="stable")[:, :_TIMINGS]
        least = left[np.arange(len(z)), order[:, 0]]
        at = np.sort(np.argsort(least, kind="stable")[: max(1, math.ceil(self.share * len(z)))])
        return z[at], good[at], table.of(at), np.take_along_axis(u[at], order[at][..., None], axis=1)

    def _where(self, table: _Curves, u: np.ndarray, count: int = _TABLE) -> tuple[np.ndarray, np.ndarray]:
        """The last pose of so many before values of the input, and the part of the way to the next one."""
        s = (u - table.begin[:, None, None]) * (count / (self.high - self.low))
        s = np.mod(s, count) if self.problem.whole else np.clip(s, 0.0, count)
        i = np.clip(s.astype(int), 0, count - 1)
        return i, s - i

    def _fit(self, table: _Curves, u: np.ndarray, some: np.ndarray) -> Any:
        i, part = self._where(table, u)
        lanes = np.arange(len(u))[:, None, None]

        def read(row: np.ndarray) -> np.ndarray:
            before = row[lanes, i]
            return before + part * (row[lanes, i + 1] - before)

        weights = self.problem.weights[some]
        z0, w, k, left = fitted(
            self.found, read(table.base), read(table.along), self.target[some], weights, table.limits
        )
        by, more = np.ones(left.shape, complex), 0.0
        if self.turn.wanted is not None:
            by, more = self.turn.fitted(read(table.seen), some)
        return z0, w, k, by, left + more

    def _moved(self, table: _Curves, u: np.ndarray, some: np.ndarray, stride: int = 1) -> np.ndarray:
        """Timings of some targets at which the curves that are fitted to them are nearer."""
        z0, w, k, by, _ = self._fit(table, u, some)
        base, along, seen = (v[:, None, ::stride] for v in table[:3])
        curve = z0[..., None] + w[..., None] * base + k[..., None] * along
        if not self.problem.ordered:
            return self._nearest(table, curve, u, some, stride)
        guided = None if self.turn.wanted is None else by[..., None] * seen
        return self._nearer(table, curve, guided, u, some, stride)

    def _nearest(self, table: _Curves, curve: np.ndarray, u: np.ndarray, some: np.ndarray, stride: int) -> np.ndarray:
        """Timings of the nearest poses of curves, in any order."""
        new = np.empty_like(u)
        for m, target in enumerate(self.target[some]):
            off = curve - target
            square = off.real**2 + off.imag**2
            near = np.argmin(np.where(np.isfinite(square), square, np.inf), axis=-1)
            new[..., m] = table.begin[:, None] + stride * self.step * near
        if self.problem.whole:  # within half a turn of the first one
            new -= 2 * np.pi * np.round((new - new[..., :1]) / (2 * np.pi))
        return new

    def _nearer(
        self,
        table: _Curves,
        curve: np.ndarray,
        guided: np.ndarray | None,
        u: np.ndarray,
        some: np.ndarray,
        stride: int,
    ) -> np.ndarray:
        """Timings at which curves are nearer to the targets, in the same order."""
        count, far = _TABLE // stride, _NEAR // stride
        i, _ = self._where(table, u, count)
        near = np.arange(-far, count + far + 2)
        near = np.mod(near, count) if self.problem.whole else np.clip(near, 0, count)
        lanes = np.arange(len(u))[:, None, None], np.arange(u.shape[1])[None, :, None]

        def seen(row: np.ndarray, wanted: np.ndarray) -> Any:
            return sliding_window_view(row[..., near], 2 * far + 2, axis=-1)[(*lanes, i)] - wanted[:, None]

        pairs: list[tuple[Any, float]] = [(seen(curve, self.target[some]), 1.0)]
        if guided is not None:
            pairs.append((seen(guided, self.turn.wanted[some]), self.turn.reach**2))
        square = sum(heavy * (off.real**2 + off.imag**2) for off, heavy in pairs)
        best = np.clip(np.argmin(square, axis=-1), 1, 2 * far)[..., None]
        # The foot of the perpendicular on the chord about the nearest pose.
        along, long = 0.0, 1e-300
        here: Any
        for off, heavy in pairs:
            before, here, after = (np.take_along_axis(off, best + n, axis=-1)[..., 0] for n in (-1, 0, 1))
            way: Any = 0.5 * (after - before)
            along = along - heavy * (way.real * here.real + way.imag * here.imag)
            long = long + heavy * (way.real**2 + way.imag**2)
        part = np.clip(along / long, -1.0, 1.0)
        at = i + (best[..., 0] - far) + np.where(np.isfinite(part), part, 0.0)
        s = (u - table.begin[:, None, None]) / (stride * self.step)
        turns = s - np.mod(s, count) if self.problem.whole else 0.0
        new = table.begin[:, None, None] + stride * self.step * (turns + at)
        if not self.problem.whole:
            new = np.clip(new, self.low, self.high)
        way = np.where(u[..., -1:] >= u[..., :1], 1.0, -1.0)
        steps = np.maximum(way * np.diff(new), 0.2 * way * np.diff(u))
        most = (self.high - self.low) * (1.0 - 0.5 / _TABLE if self.problem.closed else 1.0)
        steps = steps * np.minimum(1.0, most / np.sum(steps, axis=-1, keepdims=True))
        return np.concatenate([new[..., :1], new[..., :1] + way * np.cumsum(steps, axis=-1)], axis=-1)


def _put(
    problem: PathGeneration, found: Linear, z: np.ndarray, parts: tuple, left: np.ndarray, ok: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Unknowns of the mechanisms moved to where they were fitted, and their merit."""
    z0, w, k, extra = parts
    flat = _flat(problem, z)
    place: Any = 0.0
    if found.free:
        a, b = (flat[:, 2 * i] + 1j * flat[:, 2 * i + 1] for i in found.base)
        place = z0 + w * a + k * (b - a)
    new = moved(problem, found, flat, z0, w, place)
    drawing = np.clip(new[:, problem.variables.at], problem.variables.low, problem.variables.high)
    x = np.concatenate([drawing, extra], axis=1)
    good = ok & np.isfinite(left) & (np.abs(w) > 1e-6) & np.isfinite(x).all(axis=1)
    return np.where(np.isfinite(x), x, 0.0), np.where(good, left / problem.size**2, np.inf)
