"""Where a search begins: the idea with what suits it best, and thousands of random designs looked at at once.

A part of the unknowns is fitted to the targets where a path or motion is linear in it. Targets without order are put
at the nearest place of a design's whole curve: a search moves them along the curve, where the nearest place need not
be.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from jaxnc.synthesis.evaluate import map_threads, marker_places, reach_targets, solve_curves, solve_poses
from jaxnc.synthesis.path import MotionGeneration, PathGeneration, rotation_vector
from jaxnc.synthesis.problem import Problem, draw_designs, make_motion
from jaxnc.synthesis.search.planar import Pairs, PlanarFit
from jaxnc.synthesis.search.spatial import Spatial, nearest_rotation
from jaxnc.types import AnyArray

# -- the idea ----------------------------------------------------------------------------------------------------------

_IDEA_POSES = 144  # of the idea's curve
_MOST = 7  # that are kept


def initial_guess(problem: Problem, rng: np.random.Generator) -> np.ndarray:
    """Make starts from the idea's drawing, ``(kept, n)``; the first has the problem's own unknowns as they are."""
    if not len(problem.extras.names):
        return problem.start[None]
    rows: list[np.ndarray] = []
    if isinstance(problem, PathGeneration) and (problem.timing is None or problem.offset) and np.ptp(problem.travel):
        rows = [x for _, x in sorted(_idea_timings(problem), key=lambda pair: pair[0])[: _MOST - 1]]
    elif isinstance(problem, MotionGeneration):
        values = problem.inputs(problem.extras.home)
        motion = problem.sweep(problem.system, values)
        if np.asarray(motion.converged).all():
            seen = np.asarray(motion.orientation(problem.body))
            rows = [np.concatenate([problem.extras.home[: -problem.own_turns], _best_turn(problem, seen)])]
    else:
        # 40 guesses of unknowns of which no more is known
        rows = [x for x in problem.guesses(rng, 40) if (x != problem.extras.home).any()]
    extra = np.stack([problem.extras.home, *rows])
    return np.concatenate([np.repeat(problem.variables.home[None], len(extra), axis=0), extra], axis=1)


def _idea_timings(problem: PathGeneration) -> list[tuple[float, np.ndarray]]:
    """Find the best ordered timings on the idea's curve: squares of errors, and the problem's own unknowns."""
    low, high = problem.travel
    values = np.linspace(low, high, _IDEA_POSES + 1)
    motion = problem.sweep(problem.system, values)
    good, place = np.asarray(motion.converged), np.asarray(motion[problem.point])
    cost = np.sum((place - problem.target[:, None]) ** 2, axis=-1)
    seen, tried = None, [(cost, np.zeros(0))]
    if isinstance(problem, MotionGeneration):
        seen = np.asarray(motion.orientation(problem.body))
        if seen.ndim == 1:
            heavy, tried = problem.reach**2, []
            for turn in np.linspace(0.0, 2 * np.pi, 24, endpoint=False):  # 24 turns of the frame of a planar body
                off = 4.0 * np.sin(0.5 * (seen - turn - problem.turns[:, None])) ** 2
                tried.append((cost + heavy * off, np.array([turn])))
    found = []
    for square, turn in tried:
        weighted = np.where(good, square * problem.weights[:, None], 1e300)
        for error, timing, at in _best_timings(problem, weighted, values):
            own = turn
            if isinstance(problem, MotionGeneration) and seen is not None and seen.ndim > 1:
                own = _best_turn(problem, seen[at])
            found.append((error, np.concatenate([timing, own])))
    return [pair for pair in found if pair[0] < 1e300]


def _best_turn(problem: MotionGeneration, seen: np.ndarray) -> np.ndarray:
    """Find the turn of the frame that suits a body with these orientations best."""
    if seen.ndim == 1:
        return np.array([-np.angle(np.sum(problem.weights * np.exp(1j * (problem.turns - seen))))])
    return rotation_vector(nearest_rotation(np.einsum("m,mji,mjk->ik", problem.weights, seen, problem.turns)[None])[0])


def _best_timings(
    problem: PathGeneration, cost: np.ndarray, values: np.ndarray
) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Choose timings by the cost of each pose for each target: errors, unknowns, and the poses."""
    turn = _IDEA_POSES if problem.whole else 0
    if problem.timing is not None:
        found = []
        for way in (1.0, -1.0) if problem.either_sense else (1.0,):
            timing, sense = way * problem.timing, np.full(int(problem.either_sense), way)
            first = values[:: 1 if problem.whole else 4] - timing[0]
            at = np.rint((timing + first[:, None] - values[0]) / (values[1] - values[0])).astype(int)
            inside = np.ones(len(at), bool) if turn else ((at >= 0) & (at <= _IDEA_POSES)).all(axis=1)
            at = at % turn if turn else np.clip(at, 0, _IDEA_POSES)
            error = np.where(inside, cost[np.arange(len(cost)), at].sum(axis=1), np.inf)
            best = np.argsort(error, kind="stable")[:_MOST]
            found += [(float(error[k]), np.append(first[k], sense), at[k]) for k in best]
        return found
    out, step = [], values[1] - values[0]
    for way in (1, -1):
        table = cost[:, :_IDEA_POSES] if turn else cost
        error, at = order_targets(table[:, ::way], bool(turn))
        at = at if way > 0 else table.shape[1] - 1 - at
        # Those of one pose are put apart a little: the order is a condition.
        u = values[0] + step * (at + way * 0.5 * np.arange(len(at)) / len(at))
        out.append((error, np.append(u[0], np.diff(u)), at % turn if turn else at))
    return out


def order_targets(cost: np.ndarray, around: bool) -> tuple[float, np.ndarray]:
    """Place targets in a table in order, at the least sum of costs: the sum, and the places ``(M,)``.

    The cost is that of each target at each place, ``(M, T)``. If the table closes, places count on past its end,
    by less than one round from the first.
    """
    targets, count = cost.shape
    first = np.arange(count if around else 1)
    place = (first[:, None] + np.arange(count)) % count
    sums = cost[0][place]
    if around:
        sums = np.where(np.arange(count) == 0, sums, np.inf)
    came = np.zeros((targets, *place.shape), np.int16)
    for k in range(1, targets):
        least = np.minimum.accumulate(sums, axis=1)
        came[k] = np.maximum.accumulate(np.where(sums <= least, np.arange(count), 0), axis=1)
        sums = least + cost[k][place]
    best = int(np.argmin(sums))
    row, at = best // count, [best % count]
    for k in range(targets - 1, 0, -1):
        at.append(int(came[k, row, at[-1]]))
    return float(sums[row, at[0]]), first[row] + np.array(at[::-1])


# -- random designs ----------------------------------------------------------------------------------------------------

_TABLE = 96  # poses of a design's whole curve


class Screened(NamedTuple):
    """Random starts."""

    x: np.ndarray  # those that are worth refining, (kept, n)
    unfit: int  # how many there were that cannot move through their targets (of free timings: through the whole range)


def screen(problem: Problem, rng: np.random.Generator, count: int, most: int) -> Screened:
    """Draw random starts; where a part of the unknowns is linear, the most promising ones come first."""
    fit = choose_fit(problem)
    z = draw_designs(problem, rng, count, fit)
    width = 256  # designs at once: what is worked on fits into the processor's memory
    if isinstance(fit, Spatial):
        settled, drawings = fit.assemble, z
        z = np.concatenate(map_threads(lambda k: settled(drawings[k : k + width]), range(0, count, width)))
    if fit is None:
        x = np.concatenate([z, problem.guesses(rng, count)], axis=1)
        fit = reach_targets(problem, x)
        return Screened(x[fit], int(np.sum(~fit)))
    assert isinstance(problem, PathGeneration)
    timed = problem.timing is not None and not problem.offset
    each = 1 if timed else _guess_count(problem)
    guesses = problem.guesses(rng, count * each).reshape(count, each, len(problem.extras.names))
    some = range(0, count, width)
    # 0.25 of the shapes are looked at again, with all
    screening = _Screening(problem, fit, max(0.25, 2.0 * most / count))
    screened = screening.fit_timed if timed else screening.fit_best

    def part(k: int) -> tuple[np.ndarray, np.ndarray, int]:
        with np.errstate(all="ignore"):
            return screened(z[k : k + width], guesses[k : k + width])

    parts = map_threads(part, some)
    x, merit = (np.concatenate([one[k] for one in parts]) for k in (0, 1))
    order = np.argsort(merit, kind="stable")[:most]
    return Screened(x[order[np.isfinite(merit[order])]], sum(one[2] for one in parts))


def _guess_count(problem: PathGeneration) -> int:
    """Number of timings that are tried for each shape."""
    if isinstance(problem, MotionGeneration):
        return 5  # timings for each shape, where each target has a direction too
    return 12 if problem.ordered else 4  # timings are tried for each shape; fewer where the points have no order


def choose_fit(problem: Problem) -> PlanarFit | Spatial | None:
    """Choose how designs are fitted to targets; None if nothing of them is linear."""
    if not isinstance(problem, PathGeneration):
        return None
    return (PlanarFit if problem.system.topology.dim == 2 else Spatial).of(problem)


class _Curves(NamedTuple):
    """Tables of shapes: what is fitted, each ``(B, poses, …)``, the input in the first pose, and what bounds leave."""

    rows: tuple[np.ndarray, ...]
    begin: np.ndarray
    limits: AnyArray

    def of(self, at: np.ndarray) -> "_Curves":
        """Select some shapes."""
        return _Curves(tuple(row[at] for row in self.rows), self.begin[at], self.limits.of(at))


class _Screening:
    """A fit of designs to targets whose timings are known, or are taken from the designs' curves."""

    def __init__(self, problem: PathGeneration, fit: PlanarFit | Spatial, share: float):
        self.problem, self.fit, self.share = problem, fit, share
        self.low, self.high = problem.travel
        self.step = (self.high - self.low) / _TABLE
        count = len(problem.target)
        self.every = np.arange(count)
        # 12 targets that the first look takes, of more
        self.few = np.unique(np.rint(np.linspace(0, count - 1, min(count, 12))).astype(int))
        # What lies between those that were looked at is moved in proportion.
        self.spread = np.stack([np.interp(self.every, self.few, row) for row in np.eye(len(self.few))])

    def fit_timed(self, z: np.ndarray, guesses: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
        """Fit designs whose timings are known: unknowns, errors that are left, and how many do not move."""
        seen = solve_poses(self.problem, np.concatenate([z, guesses[:, 0]], axis=1), 0)
        limits: AnyArray = self.fit.limits(z)
        parts, left = self.fit.fit(self.fit.rows(z, seen.q), limits)
        good = np.all(seen.status == 0, axis=1)
        return *self._place(z, parts, np.zeros((len(z), 0)), left, good), int(np.sum(~good))

    def fit_best(self, z: np.ndarray, guesses: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
        """Fit the better part of designs, each with its best guess: unknowns, errors left, how many do not move."""
        problem, fit = self.problem, self.fit
        q, good, begin = solve_curves(problem, z, _TABLE + 1)
        good = np.all(good, axis=1)
        unfit = int(np.sum(~good))
        table = _Curves(fit.rows(z, q), begin, fit.limits(z))
        guesses = guesses[..., : guesses.shape[-1] - fit.own]
        if problem.timing is not None:
            u = PathGeneration.inputs(problem, guesses)
        else:
            u = np.cumsum(guesses, axis=2)  # which are steps
            z, good, table, u = self._likely(z, good, table, u)
            for _ in range(2):  # timings are taken anew from the curve fitted to them
                u = self._move_timings(table, u, self.every)
        parts, left = self._fit(table, u, self.every)
        extra = guesses
        if problem.timing is None:
            extra = np.concatenate([u[..., :1], np.diff(u, axis=-1)], axis=-1)
        at = np.arange(len(z)), np.argmin(np.where(np.isfinite(left), left, np.inf), axis=1)
        return *self._place(z, tuple(part[at] for part in parts), extra[at], left[at], good), unfit

    def _place(
        self, z: np.ndarray, parts: Any, extra: np.ndarray, left: np.ndarray, ok: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Move mechanisms to where they were fitted: unknowns, and merit."""
        flat, turn, grown = self.fit.place_mechanisms(z, parts)
        var = self.problem.variables
        x = np.concatenate([np.clip(flat[:, var.at], var.low, var.high), extra, turn], axis=1)
        good = ok & np.isfinite(left) & (grown > 1e-6) & np.isfinite(x).all(axis=1)
        return np.where(np.isfinite(x), x, 0.0), np.where(good, left / self.problem.size**2, np.inf)

    def _likely(self, z: np.ndarray, good: np.ndarray, table: _Curves, u: np.ndarray) -> AnyArray:
        """Select shapes and timings for a closer look, by a quick one at a part of the targets."""
        first = u[..., self.few]
        new = self._move_timings(table, first, self.few, 2)  # every second pose of the table
        u = u + (new - first) @ self.spread
        left = self._fit(table, new, self.few)[1]
        left = np.where(good[:, None] & np.isfinite(left), left, np.inf)
        order = np.argsort(left, axis=1, kind="stable")[:, :2]  # 2 timings of each of the shapes
        least = left[np.arange(len(z)), order[:, 0]]
        at = np.sort(np.argsort(least, kind="stable")[: max(1, math.ceil(self.share * len(z)))])
        return z[at], good[at], table.of(at), np.take_along_axis(u[at], order[at][..., None], axis=1)

    def _where(self, table: _Curves, u: np.ndarray, count: int = _TABLE) -> tuple[np.ndarray, np.ndarray]:
        """Find the last pose before values of the input, and the part of the way to the next one."""
        s = (u - table.begin[:, None, None]) * (count / (self.high - self.low))
        s = np.mod(s, count) if self.problem.whole else np.clip(s, 0.0, count)
        i = np.clip(s.astype(int), 0, count - 1)
        return i, s - i

    def _fit(self, table: _Curves, u: np.ndarray, some: np.ndarray) -> AnyArray:
        i, part = self._where(table, u)
        lanes = np.arange(len(u))[:, None, None]

        def read(row: np.ndarray) -> np.ndarray:
            before = row[lanes, i]
            return before + part.reshape(*part.shape, *[1] * (row.ndim - 2)) * (row[lanes, i + 1] - before)

        return self.fit.fit(tuple(read(row) for row in table.rows), table.limits, some)

    def _move_timings(self, table: _Curves, u: np.ndarray, some: np.ndarray, stride: int = 1) -> np.ndarray:
        """Move timings of targets to where the curves that are fitted to them are nearer."""
        parts, _ = self._fit(table, u, some)
        pairs = self.fit.curves(tuple(row[:, ::stride] for row in table.rows), parts, some)
        return (self._nearer if self.problem.ordered else self._nearest)(table, pairs, u, stride)

    def _nearest(self, table: _Curves, pairs: Pairs, u: np.ndarray, stride: int) -> np.ndarray:
        """Find timings of the nearest poses of curves, in any order."""
        new = np.empty_like(u)
        for m in range(u.shape[-1]):
            off = [(curve - wanted[m], heavy) for curve, wanted, heavy in pairs]
            square: AnyArray = sum(heavy * (one.real**2 + one.imag**2) for one, heavy in off)
            near = np.argmin(np.where(np.isfinite(square), square, np.inf), axis=-1)
            new[..., m] = table.begin[:, None] + stride * self.step * near
        if self.problem.whole:  # within half a turn of the first one
            new -= 2 * np.pi * np.round((new - new[..., :1]) / (2 * np.pi))
        return new

    def _nearer(self, table: _Curves, pairs: Pairs, u: np.ndarray, stride: int) -> np.ndarray:
        """Find timings at which curves are nearer to the targets, in the same order."""
        count, far = _TABLE // stride, 10 // stride  # a nearer pose of the table is looked for in 10 to both sides
        i, _ = self._where(table, u, count)
        near = np.arange(-far, count + far + 2)
        near = np.mod(near, count) if self.problem.whole else np.clip(near, 0, count)
        lanes = np.arange(len(u))[:, None, None], np.arange(u.shape[1])[None, :, None]
        seen: list[tuple[AnyArray, float]] = []
        for curve, wanted, heavy in pairs:
            window: AnyArray = sliding_window_view(curve[..., near], 2 * far + 2, axis=-1)[(*lanes, i)]
            seen.append((window - wanted[:, None], heavy))
        square: AnyArray = sum(heavy * (off.real**2 + off.imag**2) for off, heavy in seen)
        best = np.clip(np.argmin(square, axis=-1), 1, 2 * far)[..., None]
        # The foot of the perpendicular on the chord about the nearest pose.
        along, long = 0.0, 1e-300
        here: AnyArray
        for off, heavy in seen:
            before, here, after = (np.take_along_axis(off, best + n, axis=-1)[..., 0] for n in (-1, 0, 1))
            way: AnyArray = 0.5 * (after - before)
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


# -- targets without order ---------------------------------------------------------------------------------------------

_CURVE_POSES = 361  # of the curve


def reseat_targets(problem: Problem, rows: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Put each target at the nearest place of a design's whole curve; problems with an order stay as they are."""
    if not (isinstance(problem, PathGeneration) and not problem.ordered and len(rows)):
        return list(rows)
    every = np.stack(rows)
    width = 64  # designs at once
    out = [_reseat_chunk(problem, every[k : k + width]) for k in range(0, len(every), width)]
    return list(np.concatenate(out))


def _reseat_chunk(problem: PathGeneration, rows: np.ndarray) -> np.ndarray:
    n, count = len(problem.variables.names), len(problem.target)
    x = rows[:, : problem.count]
    q, good, begin = solve_curves(problem, x[:, :n], _CURVE_POSES, "close")
    curve = _tracer_places(problem, x, q)
    low, high = problem.travel
    step = (high - low) / (_CURVE_POSES - 1)
    now = np.cumsum(x[:, n : n + count], axis=1)
    new, square = np.empty_like(now), np.empty_like(now)
    with np.errstate(all="ignore"):
        for k, target in enumerate(problem.target):
            part, far = _nearest_on_chords(curve - target, good)
            at = np.argmin(far, axis=1)
            lanes = np.arange(len(x))
            new[:, k], square[:, k] = begin + step * (at + part[lanes, at]), far[lanes, at]
            if problem.whole:  # within half a turn of the first target
                first = new[:, 0] if k else now[:, 0]
                new[:, k] += 2 * np.pi * np.round((first - new[:, k]) / (2 * np.pi))
        apart = now - new
        if problem.whole:
            apart -= 2 * np.pi * np.round(apart / (2 * np.pi))
        here = _target_squares(problem, x, curve, begin, step, now)
        # a place is another one only if it is nearer by 1e-6 of the distance
        # what is nearer to a place than 2 steps of the curve is that place
        stay = (np.abs(apart) <= 2.0 * step) | ~(square < (1 - 1e-6) * here)
    new = np.where(stay & np.isfinite(apart), new + apart, new)
    out = rows.copy()
    fresh = ~stay.all(axis=1) & np.isfinite(new).all(axis=1)
    out[fresh, n : n + count] = np.concatenate([new[:, :1], np.diff(new, axis=1)], axis=1)[fresh]
    return out


def _nearest_on_chords(way: np.ndarray, good: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the nearest point of each chord of curves about a target: its part of the chord, its squared distance."""
    chord, a = np.diff(way, axis=1), way[:, :-1]
    part = -np.sum(a * chord, axis=2) / np.maximum(np.sum(chord**2, axis=2), 1e-300)
    part = np.clip(part, 0.0, 1.0)
    square = np.sum((a + part[..., None] * chord) ** 2, axis=2)
    return part, np.where(good[:, :-1] & good[:, 1:] & np.isfinite(square), square, np.inf)


def _target_squares(
    problem: PathGeneration, x: np.ndarray, curve: np.ndarray, begin: np.ndarray, step: float, now: np.ndarray
) -> np.ndarray:
    """Squared distances of the targets from where they are on the curve, ``(designs, targets)``."""
    s = (now - begin[:, None]) / step
    s = np.mod(s, _CURVE_POSES - 1) if problem.whole else np.clip(s, 0.0, _CURVE_POSES - 1)
    i = np.clip(np.floor(s), 0, _CURVE_POSES - 2).astype(int)
    part, lanes = (s - i)[..., None], np.arange(len(x))[:, None]
    place = curve[lanes, i] + part * (curve[lanes, i + 1] - curve[lanes, i])
    square = np.sum((place - problem.target) ** 2, axis=2)
    return np.where(np.isfinite(square), square, np.inf)


def _tracer_places(problem: PathGeneration, x: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Places of the tracer ``(designs, poses, dim)`` in poses ``(designs, poses, N)``."""
    top = problem.system.topology
    if problem.point in top.points:
        k = top.points.index(problem.point)
        return q[..., k * top.dim : (k + 1) * top.dim]
    if top.dim == 2:
        number = [m.name for m in top.markers].index(problem.point)
        place: AnyArray = marker_places(problem, x[:, : len(problem.variables.names)], q, number)
        return np.stack([place.real, place.imag], axis=-1)
    none, zero = np.zeros(q.shape[1], int), np.zeros(q.shape[1])
    ways = [make_motion(problem, problem.design(one), p, none, zero, zero) for one, p in zip(x, q, strict=True)]
    return np.stack([np.asarray(way[problem.point]) for way in ways])
