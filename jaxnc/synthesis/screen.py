"""Screening: thousands of random designs looked at at once, to find starts that are worth refining."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from jaxnc.synthesis.boxes import drawn
from jaxnc.synthesis.guidance import MotionGeneration
from jaxnc.synthesis.path import PathGeneration
from jaxnc.synthesis.planar_fit import Pairs, Planar
from jaxnc.synthesis.poses import curves, reached, reaching
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.spatial_fit import Spatial
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
    """Random starts."""

    x: np.ndarray  # those that are worth refining, (kept, n)
    unfit: int  # how many there were that cannot move through their targets (of free timings: through the whole range)


def screen(problem: Problem, rng: np.random.Generator, count: int, most: int) -> Screened:
    """Random starts; where a part of the unknowns is linear, the most promising ones first."""
    fit = fitting(problem)
    z = drawn(problem, fit and fit.free, rng, count, getattr(fit, "into", None))
    if isinstance(fit, Spatial):
        settled, drawings = fit.settled, z
        z = np.concatenate(in_threads(lambda k: settled(drawings[k : k + _CHUNK]), range(0, count, _CHUNK)))
    if fit is None:
        x = np.concatenate([z, problem.guesses(rng, count)], axis=1)
        fit = reaching(problem, x)
        return Screened(x[fit], int(np.sum(~fit)))
    assert isinstance(problem, PathGeneration)
    timed = problem.timing is not None and not problem.offset
    each = 1 if timed else _guesses(problem)
    guesses = problem.guesses(rng, count * each).reshape(count, each, len(problem.extras.names))
    some = range(0, count, _CHUNK)
    screened = _timed if timed else _Timings(problem, fit, max(_SHARE, 2.0 * most / count)).best

    def part(k: int) -> tuple[np.ndarray, np.ndarray, int]:
        with np.errstate(all="ignore"):
            return screened(problem, fit, z[k : k + _CHUNK], guesses[k : k + _CHUNK])

    parts = in_threads(part, some)
    x, merit = (np.concatenate([one[k] for one in parts]) for k in (0, 1))
    order = np.argsort(merit, kind="stable")[:most]
    return Screened(x[order[np.isfinite(merit[order])]], sum(one[2] for one in parts))


def _guesses(problem: PathGeneration) -> int:
    """How many timings are tried for each shape."""
    if isinstance(problem, MotionGeneration):
        return _FEWER
    return _GUESSES if problem.ordered else _ANYWHERE


def fitting(problem: Problem) -> Planar | Spatial | None:
    """How designs are fitted to targets; None if nothing of them is linear."""
    if not isinstance(problem, PathGeneration):
        return None
    return (Planar if problem.system.topology.dim == 2 else Spatial).of(problem)


def _timed(
    problem: PathGeneration, fit: Planar | Spatial, z: np.ndarray, guesses: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int]:
    """Designs with everything linear fitted, timings known: unknowns, errors that are left, how many do not move."""
    seen = reached(problem, np.concatenate([z, guesses[:, 0]], axis=1), 0)
    limits: Any = fit.limits(z)
    parts, left = fit.fitted(fit.rows(z, seen.q), limits)
    good = np.all(seen.status == 0, axis=1)
    return *_put(problem, fit, z, parts, np.zeros((len(z), 0)), left, good), int(np.sum(~good))


class _Curves(NamedTuple):
    """Tables of shapes: what is fitted, each ``(B, poses, …)``, the input in the first pose, and what bounds leave."""

    rows: tuple[np.ndarray, ...]
    begin: np.ndarray
    limits: Any

    def of(self, at: np.ndarray) -> "_Curves":
        """Those of some shapes."""
        limits = None if self.limits is None else self.limits.of(at)
        return _Curves(tuple(row[at] for row in self.rows), self.begin[at], limits)


class _Timings:
    """Designs with everything linear fitted and their timings taken from their curves."""

    def __init__(self, problem: PathGeneration, fit: Planar | Spatial, share: float):
        self.problem, self.fit, self.share = problem, fit, share
        self.low, self.high = problem.travel
        self.step = (self.high - self.low) / _TABLE
        count = len(problem.target)
        self.every = np.arange(count)
        self.few = np.unique(np.rint(np.linspace(0, count - 1, min(count, _POINTS))).astype(int))
        # What lies between those that were looked at is moved in proportion.
        self.spread = np.stack([np.interp(self.every, self.few, row) for row in np.eye(len(self.few))])

    def best(
        self, problem: PathGeneration, fit: Planar | Spatial, z: np.ndarray, guesses: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """Unknowns of the better part of designs with the best of its guesses, errors left, how many do not move."""
        q, good, begin = curves(problem, z, _TABLE + 1)
        good = np.all(good, axis=1)
        unfit = int(np.sum(~good))
        table = _Curves(fit.rows(z, q), begin, fit.limits(z))
        guesses = guesses[..., : guesses.shape[-1] - fit.own]
        if problem.timing is not None:
            u = PathGeneration.inputs(problem, guesses)
        else:
            u = np.cumsum(guesses, axis=2)  # which are steps
            z, good, table, u = self._likely(z, good, table, u)
            for _ in range(_AGAIN):
                u = self._moved(table, u, self.every)
        parts, left = self._fit(table, u, self.every)
        extra = guesses
        if problem.timing is None:
            extra = np.concatenate([u[..., :1], np.diff(u, axis=-1)], axis=-1)
        at = np.arange(len(z)), np.argmin(np.where(np.isfinite(left), left, np.inf), axis=1)
        return *_put(problem, fit, z, tuple(part[at] for part in parts), extra[at], left[at], good), unfit

    def _likely(self, z: np.ndarray, good: np.ndarray, table: _Curves, u: np.ndarray) -> Any:
        """The shapes and timings that are worth a closer look, from a quick one at a part of the targets."""
        first = u[..., self.few]
        new = self._moved(table, first, self.few, _COARSE)
        u = u + (new - first) @ self.spread
        left = self._fit(table, new, self.few)[1]
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
            return before + part.reshape(*part.shape, *[1] * (row.ndim - 2)) * (row[lanes, i + 1] - before)

        return self.fit.fitted(tuple(read(row) for row in table.rows), table.limits, some)

    def _moved(self, table: _Curves, u: np.ndarray, some: np.ndarray, stride: int = 1) -> np.ndarray:
        """Timings of some targets at which the curves that are fitted to them are nearer."""
        parts, _ = self._fit(table, u, some)
        pairs = self.fit.curves(tuple(row[:, ::stride] for row in table.rows), parts, some)
        return (self._nearer if self.problem.ordered else self._nearest)(table, pairs, u, stride)

    def _nearest(self, table: _Curves, pairs: Pairs, u: np.ndarray, stride: int) -> np.ndarray:
        """Timings of the nearest poses of curves, in any order."""
        new = np.empty_like(u)
        for m in range(u.shape[-1]):
            off = [(curve - wanted[m], heavy) for curve, wanted, heavy in pairs]
            square: Any = sum(heavy * (one.real**2 + one.imag**2) for one, heavy in off)
            near = np.argmin(np.where(np.isfinite(square), square, np.inf), axis=-1)
            new[..., m] = table.begin[:, None] + stride * self.step * near
        if self.problem.whole:  # within half a turn of the first one
            new -= 2 * np.pi * np.round((new - new[..., :1]) / (2 * np.pi))
        return new

    def _nearer(self, table: _Curves, pairs: Pairs, u: np.ndarray, stride: int) -> np.ndarray:
        """Timings at which curves are nearer to the targets, in the same order."""
        count, far = _TABLE // stride, _NEAR // stride
        i, _ = self._where(table, u, count)
        near = np.arange(-far, count + far + 2)
        near = np.mod(near, count) if self.problem.whole else np.clip(near, 0, count)
        lanes = np.arange(len(u))[:, None, None], np.arange(u.shape[1])[None, :, None]
        seen: list[tuple[Any, float]] = []
        for curve, wanted, heavy in pairs:
            window: Any = sliding_window_view(curve[..., near], 2 * far + 2, axis=-1)[(*lanes, i)]
            seen.append((window - wanted[:, None], heavy))
        square: Any = sum(heavy * (off.real**2 + off.imag**2) for off, heavy in seen)
        best = np.clip(np.argmin(square, axis=-1), 1, 2 * far)[..., None]
        # The foot of the perpendicular on the chord about the nearest pose.
        along, long = 0.0, 1e-300
        here: Any
        for off, heavy in seen:
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
    problem: PathGeneration,
    fit: Planar | Spatial,
    z: np.ndarray,
    parts: Any,
    extra: np.ndarray,
    left: np.ndarray,
    ok: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Unknowns of the mechanisms moved to where they were fitted, and their merit."""
    flat, turn, grown = fit.put(z, parts)
    drawing = np.clip(flat[:, problem.variables.at], problem.variables.low, problem.variables.high)
    x = np.concatenate([drawing, extra, turn], axis=1)
    good = ok & np.isfinite(left) & (grown > 1e-6) & np.isfinite(x).all(axis=1)
    return np.where(np.isfinite(x), x, 0.0), np.where(good, left / problem.size**2, np.inf)
