"""Screening: thousands of random designs looked at at once, to find starts that are worth refining."""

from typing import Any

import numpy as np

from jaxnc.kinematics.redesign import flattened
from jaxnc.synthesis.boxes import Boxes, drawn
from jaxnc.synthesis.guidance import MotionGeneration
from jaxnc.synthesis.path import PathGeneration
from jaxnc.synthesis.poses import curves, marker, reached
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.projection import Limits, Linear, fitted, linear, moved

_CHUNK = 256  # designs at once: what is worked on fits into the processor's memory
_TABLE = 96  # poses of a design's whole curve
_GUESSES = 12  # timings tried for each shape
_FEWER = 5  # the same where each target has a direction too
_ANYWHERE = 4  # of them where the points have no order
_AGAIN = 3  # times that timings are taken anew from the curve fitted to them
_NEAR = 10  # poses of the table to both sides in which a nearer one is looked for


def screen(problem: Problem, rng: np.random.Generator, count: int, most: int) -> np.ndarray:
    """Random starts ``(kept, n)``; where a part of the unknowns is linear, the most promising ones first.

    Args:
        problem: the problem.
        rng: of the random numbers.
        count: designs to look at.
        most: how many to keep.
    """
    found = linear(problem) if isinstance(problem, PathGeneration) else None
    z = drawn(problem, found, rng, count)
    if found is None:
        return np.concatenate([z, problem.guesses(rng, count)], axis=1)
    assert isinstance(problem, PathGeneration)
    timed = problem.timing is not None and not problem.offset
    each = 1 if timed else _guesses(problem)
    guesses = problem.guesses(rng, count * each).reshape(count, each, len(problem.extras.names))
    screened = _timed if timed else _Timings(problem, found).best
    with np.errstate(all="ignore"):
        parts = [screened(problem, found, z[k : k + _CHUNK], guesses[k : k + _CHUNK]) for k in range(0, count, _CHUNK)]
    x, merit = (np.concatenate(p) for p in zip(*parts, strict=True))
    order = np.argsort(merit, kind="stable")[:most]
    return x[order[np.isfinite(merit[order])]]


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

    def fitted(self, seen: np.ndarray) -> tuple[np.ndarray, Any]:
        """By how much bodies ``(…, M)`` are to be turned, complex ``(…,)``, and the squares that are left."""
        if self.wanted is None:
            return np.ones(seen.shape[:-1], complex), 0.0
        by = np.sum(self.heavy * self.wanted * np.conj(seen), axis=-1)
        by = by / np.maximum(np.abs(by), 1e-300)
        return by, np.sum(self.heavy * np.abs(self.wanted - by[..., None] * seen) ** 2, axis=-1)

    def extra(self, w: np.ndarray, by: np.ndarray) -> np.ndarray:
        """The problem's unknown for it ``(…, 1)``, of mechanisms that are turned with ``w``."""
        return (np.angle(w) - np.angle(by))[..., None] if self.wanted is not None else np.zeros((*np.shape(w), 0))


def _timed(problem: PathGeneration, found: Linear, z: np.ndarray, guesses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Designs with everything linear fitted, their timings known: unknowns and what error is left."""
    turn = _Turn(problem)
    seen = reached(problem, np.concatenate([z, guesses[:, 0]], axis=1), 0)
    base, direction = _places(problem, found, z, seen.q)
    goal = problem.target @ np.array([1.0, 1j])
    z0, w, k, left = fitted(found, base, direction, goal, problem.weights, _limits(problem, found, z))
    by, more = turn.fitted(turn.seen(seen.q))
    return _put(problem, found, z, (z0, w, k, turn.extra(w, by)), left + more, np.all(seen.status == 0, axis=1))


class _Timings:
    """Designs with everything linear fitted and their timings taken from their curves."""

    def __init__(self, problem: PathGeneration, found: Linear):
        self.problem, self.found = problem, found
        self.target = problem.target @ np.array([1.0, 1j])
        self.low, self.high = problem.travel
        self.step = (self.high - self.low) / _TABLE
        self.turn = _Turn(problem)

    def best(
        self, problem: PathGeneration, found: Linear, z: np.ndarray, guesses: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Unknowns of each design with the best of its guesses, and what error is left."""
        q, good, begin = curves(problem, z, _TABLE + 1)
        self.limits = _limits(problem, found, z)
        a, d = (v[:, None] for v in _places(problem, found, z, q))
        s, begin = self.turn.seen(q)[:, None], begin[:, None, None]
        free = problem.timing is None
        guesses = guesses[..., : guesses.shape[-1] - (self.turn.wanted is not None)]
        u = (
            np.cumsum(guesses, axis=2) if free else PathGeneration.inputs(problem, guesses)
        )  # which are steps, or offsets
        for _ in range(_AGAIN if free else 0):
            u = self._nearer(a, d, s, begin, u) if problem.ordered else self._nearest(a, d, s, begin, u)
        z0, w, k, by, left = self._fit(a, d, s, begin, u)
        extra = np.concatenate([u[..., :1], np.diff(u, axis=-1)], axis=-1) if free else guesses
        extra = np.concatenate([extra, self.turn.extra(w, by)], axis=-1)
        first = np.argmin(np.where(np.isfinite(left), left, np.inf), axis=1)
        at = np.arange(len(z)), first
        return _put(problem, found, z, (z0[at], w[at], k[at], extra[at]), left[at], np.all(good, axis=1))

    def _where(self, begin: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The last pose of the table before values of the input, and the part of the way to the next one."""
        s = (u - begin) / self.step
        s = np.mod(s, _TABLE) if self.problem.whole else np.clip(s, 0.0, _TABLE)
        i = np.clip(np.floor(s), 0, _TABLE - 1).astype(int)
        return i, s - i

    def _fit(self, a: np.ndarray, d: np.ndarray, s: np.ndarray, begin: np.ndarray, u: np.ndarray) -> Any:
        i, part = self._where(begin, u)

        def read(row: np.ndarray) -> np.ndarray:
            row = np.broadcast_to(row, (*u.shape[:2], row.shape[-1]))
            before, after = (np.take_along_axis(row, at, axis=2) for at in (i, i + 1))
            return before + part * (after - before)

        z0, w, k, left = fitted(self.found, read(a), read(d), self.target, self.problem.weights, self.limits)
        by, more = self.turn.fitted(read(s)) if self.turn.wanted is not None else (np.ones(left.shape, complex), 0.0)
        return z0, w, k, by, left + more

    def _nearest(self, a: np.ndarray, d: np.ndarray, s: np.ndarray, begin: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Timings of the nearest poses of the fitted curve, in any order."""
        z0, w, k, _, _ = self._fit(a, d, s, begin, u)
        curve = z0[..., None] + w[..., None] * a + k[..., None] * d
        new = np.empty_like(u)
        for m, target in enumerate(self.target):
            square = np.abs(curve - target)
            near = np.argmin(np.where(np.isfinite(square), square, np.inf), axis=-1)
            new[..., m] = begin[..., 0] + self.step * near
        if self.problem.whole:  # within half a turn of the first one
            new -= 2 * np.pi * np.round((new - new[..., :1]) / (2 * np.pi))
        return new

    def _nearer(self, a: np.ndarray, d: np.ndarray, s: np.ndarray, begin: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Timings at which the fitted curve is nearer to the targets, in the same order."""
        z0, w, k, by, _ = self._fit(a, d, s, begin, u)
        curve = z0[..., None] + w[..., None] * a + k[..., None] * d
        i, part = self._where(begin, u)
        shifts = np.arange(-_NEAR, _NEAR + 1)
        near = i[..., None] + np.arange(-_NEAR, _NEAR + 2)
        near = np.mod(near, _TABLE) if self.problem.whole else np.clip(near, 0, _TABLE)
        rows = np.arange(curve[..., 0].size)[:, None] * curve.shape[-1]

        def square_to(curve: np.ndarray, target: np.ndarray) -> np.ndarray:
            nodes = curve.reshape(-1)[rows + near.reshape(len(rows), -1)].reshape(near.shape) - target[:, None]
            off: Any = nodes[..., :-1] + part[..., None] * (nodes[..., 1:] - nodes[..., :-1])
            return off.real**2 + off.imag**2

        square = square_to(curve, self.target)
        if self.turn.wanted is not None:
            square = square + self.turn.reach**2 * square_to(by[..., None] * s, self.turn.wanted)
        if not self.problem.whole:
            some = u[..., None] + shifts * self.step
            square = np.where((some >= self.low) & (some <= self.high), square, np.inf)
        new = u + self.step * shifts[np.argmin(square, axis=-1)]
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
