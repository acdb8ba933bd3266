"""Continuation on the host: branches followed by predictor and corrector, several lanes in lockstep.

The only place with step control. Every lane has its own targets, step length and state, and may have its own design;
what is evaluated is evaluated for all lanes that are still on their way at once.
"""

import math
from typing import NamedTuple

import numpy as np

from jaxnc.solvers.host import judge
from jaxnc.solvers.host.rates import rates
from jaxnc.solvers.host.view import HostView

_FIRST = 1e-3  # of the way to the first value: a short step that shows in which direction determinants change
_BEFORE = 1e-3  # of the mechanism's size: how far from a crossing its pose is read off the branch
_NEWTON = 8  # steps from a predicted pose, of which two are usual
_CORRECTIONS = 6  # of Newton, before a step is given up
_PER_POSE = 250  # evaluations, per target
_MOST = 50_000  # and for the way between them: about 25 for each radian that something turns


class Followed(NamedTuple):
    """Where branches were followed to; lanes are the last axis.

    Attributes:
        poses: ``(T, N, lanes)``; those from `reached` on are not set.
        slopes: derivatives of the unknown coordinates with respect to the driven ones, ``(T, n, driven, lanes)``.
        reached: how many of the targets were reached, ``(lanes,)``.
        limit: whether the branch ends at the target, ``(T, lanes)``.
        crossed: whether it is a singular position where branches cross, ``(T, lanes)``.
        last: the last pose on the branch, ``(N, lanes)``.
        exhausted: whether it was given up for the number of evaluations, not because the branch ends.
    """

    poses: np.ndarray
    slopes: np.ndarray
    reached: np.ndarray
    limit: np.ndarray
    crossed: np.ndarray
    last: np.ndarray
    exhausted: np.ndarray


class _Lanes:
    """The lanes that are on their way; lanes are the last axis of every array.

    Attributes:
        which: their numbers.
        values: known coordinates they go to, ``(T, known, lanes)``.
        target, final: which of these they are on the way to, and which is their last.
        origin, way_end: known coordinates where that way begins and ends, and
        way: their change along it.
        s, h, reach: the part of the way that is done, the next step, and where the current trial is.
        q, guess: the current iterate, and what it was predicted to be.
        base: the last accepted pose, and there:
        slope, slopes: derivatives of all coordinates along the way, and of the unknown ones by the driven ones;
        curve: the change of `slope` along the way, as it was in the last step;
        signs, sizes: of the determinants of the diagonal blocks; or
        reference: the matrix, where there are more rows than unknowns;
        level: sizes of the determinants there, relative to the largest that were met;
        rise: relative change of the determinants per part of the way, in the last step;
        usual: speed along the way where it began.
        leapt: whether a step over a singular position was tried from the base.
        corrections: how many the current trial has had.
    """

    _NAMES = (
        *(
            "which",
            "values",
            "target",
            "final",
            "origin",
            "way_end",
            "way",
            "curve",
            "s",
            "h",
            "reach",
            "q",
            "guess",
            "base",
            "slope",
            "slopes",
            "signs",
        ),
        *("sizes", "reference", "level", "rise", "usual", "leapt", "corrections"),
    )

    def __init__(self, view: HostView, start: np.ndarray, values: np.ndarray, counts: np.ndarray):
        n, driven, count = len(view.plan.unknown), len(view.plan.driven), values.shape[2]
        blocks = sum(len(rows) for rows, _ in view.plan.blocks) if view.plan.square else 1
        self.which, self.values = np.arange(count), values
        self.target, self.corrections = np.zeros(count, int), np.zeros(count, int)
        self.final = counts - 1
        self.origin, self.way_end = start[view.plan.known], values[0]
        self.way, self.curve = self.way_end - self.origin, np.zeros_like(start)
        self.s, self.h, self.reach, self.usual = np.zeros(count), np.ones(count), np.zeros(count), np.zeros(count)
        self.q = self.guess = self.base = start
        self.slope, self.slopes = np.zeros_like(start), np.zeros((n, driven, count))
        self.signs, self.sizes, self.rise = (
            np.ones((blocks, count)),
            np.zeros((blocks, count)),
            np.zeros((blocks, count)),
        )
        self.level, self.leapt = np.ones((blocks, count)), np.zeros(count, bool)
        self.reference = np.zeros((len(view.plan.rows) if view.redundant else 0, n, count))

    def keep(self, which: np.ndarray) -> None:
        """Go on with some of them only."""
        for name in self._NAMES:
            setattr(self, name, getattr(self, name)[..., which])

    def value(self, target: np.ndarray) -> np.ndarray:
        """Known coordinates of targets, ``(known, lanes)``."""
        return self.values[target, :, np.arange(len(target))].T


def follow(view: HostView, start: np.ndarray, values: np.ndarray, counts: np.ndarray | None = None) -> Followed:
    """Follow branches from poses through sequences of input values.

    A step is accepted by `jaxnc.solvers.host.judge`; the other branch, which lies across a fold, is never taken for
    this one, nor its mirror image behind a narrow gap. Where branches cross (a change point), the motion goes on along
    its tangent.

    Args:
        view: what is solved for, of one design or of as many as there are lanes.
        start: poses that meet the constraints, ``(N, lanes)``.
        values: known coordinates to go to, one after the other, ``(T, known, lanes)``.
        counts: how many of them each lane goes to, at least one, ``(lanes,)``; all if not given.

    Returns:
        The poses and how far each lane came.
    """
    total, _, count = values.shape
    n, driven = len(view.plan.unknown), len(view.plan.driven)
    out = Followed(
        np.zeros((total, *start.shape), start.dtype),
        np.zeros((total, n, driven, count), start.dtype),
        np.zeros(count, int),
        np.zeros((total, count), bool),
        np.zeros((total, count), bool),
        np.array(start),
        np.zeros(count, bool),
    )
    lanes = _Lanes(view, start, values, np.full(count, total) if counts is None else counts)
    for _ in range(_PER_POSE * total + _MOST):
        if not len(lanes.which):
            return out
        over = _step(view, lanes, out)
        if over.any():
            lanes.keep(~over)
            view = view.taken(~over)
    out.exhausted[lanes.which] = True
    out.last[:, lanes.which] = lanes.base
    return out


class _Seen(NamedTuple):
    """What one evaluation of the equations says of the lanes' trials."""

    correction: np.ndarray
    slopes: np.ndarray
    signs: np.ndarray
    sizes: np.ndarray
    reference: np.ndarray
    ratio: np.ndarray
    finite: np.ndarray
    met: np.ndarray


def _evaluated(view: HostView, st: _Lanes) -> _Seen:
    r = view.residual(st.q)
    matrix, by_known = view.matrices(st.q)
    x = view.solve(matrix, np.concatenate([r.T[:, :, None], by_known[:, :, : st.slopes.shape[1]]], axis=2))
    signs, sizes, reference = st.signs, st.sizes, st.reference
    if view.redundant:
        reference = np.moveaxis(matrix, 0, 2)
        ratio = view.relative(matrix, np.moveaxis(st.reference, 2, 0))[None]
    else:
        signs, sizes = (a.T for a in view.orientation(matrix))
        ratio = signs * st.signs * np.exp(sizes - st.sizes)
    return _Seen(
        x[:, :, 0].T,
        -np.moveaxis(x[:, :, 1:], 0, 2),
        signs,
        sizes,
        reference,
        ratio,
        np.asarray(np.isfinite(x).all(axis=(1, 2))),
        np.max(np.abs(r), axis=0, initial=0.0) <= view.tolerance(st.q),
    )


def _step(view: HostView, st: _Lanes, out: Followed) -> np.ndarray:
    """One evaluation in every lane: its trial is accepted, given up or corrected. Which lanes are over with it."""
    least, weight, length = view.least, view.weights, view.eq.length
    seen, part = _evaluated(view, st), st.reach - st.s
    fresh = part == 0.0
    new_slope = _along(view, seen.slopes, st.way)
    speed, corrected, bend, after = _sizes(weight, st.slope, st.q - st.guess, new_slope - st.slope, new_slope)
    level = _level(view, st, seen)
    trial = judge.Step(
        part, part * speed, corrected, part * bend, part * after, seen.ratio, level, part * st.rise, fresh
    )
    # Close to a singular position a small residual says little: the next correction has to be small too.
    small = _sizes(view.unknown_weights, seen.correction)[0] <= least.close * length
    converged = seen.finite & seen.met & small
    good = converged & judge.accepted(trial, least, length)
    if good.any():
        good &= view.eq.guards(st.q)[0]
    bad = ~good & (converged | ~seen.finite | (st.corrections >= _CORRECTIONS))
    decided = good | bad
    moved = np.array(st.q)
    moved[view.plan.unknown] -= np.where(seen.finite, seen.correction, 0.0)
    st.corrections = np.where(decided, 0, st.corrections + 1)
    if not decided.any():
        st.q = moved
        return decided

    over_it = judge.crossing(speed, least, length)
    leap = bad & ~fresh & ~st.leapt & (0.25 * part <= over_it)
    felt = (st.s == 0.0) & (part == _FIRST)
    longer = np.where(fresh, _FIRST, np.where(felt, 1.0, 2.0 * st.h))
    st.h = np.where(good, longer, np.where(leap, over_it, np.where(bad, 0.25 * part, st.h)))
    ended = bad & ~leap & (fresh | (st.h < least.smallest))
    if good.any():
        with np.errstate(all="ignore"):
            turned = (seen.ratio - 1.0) / seen.ratio / part
        st.rise = np.where(good, np.where(np.isfinite(turned), turned, 0.0), st.rise)
        st.usual = np.where(good & fresh & (st.s == 0.0), after, st.usual)
        st.curve = np.where(good, (new_slope - st.slope) / np.where(fresh, np.inf, part), st.curve)
        st.s, st.base = np.where(good, st.reach, st.s), np.where(good, st.q, st.base)
        st.slope, st.slopes = np.where(good, new_slope, st.slope), np.where(good, seen.slopes, st.slopes)
        st.signs, st.sizes = np.where(good, seen.signs, st.signs), np.where(good, seen.sizes, st.sizes)
        st.level = np.where(good & ~fresh, np.minimum(level, 1.0), st.level)
        if view.redundant:
            st.reference = np.where(good, seen.reference, st.reference)
        else:
            view.met(seen.sizes, good)
    st.leapt = ~good & (leap | st.leapt)
    over, back = _arrivals(view, st, out, good, ended & ~fresh, ended, speed, over_it)

    step = np.minimum(np.minimum(st.h, 1.0), judge.longest(view.plan, st.way))
    reach = np.where(st.s + step >= 1.0 - least.whole, 1.0, st.s + step)
    st.reach = np.where(back, 0.0, np.where(decided, reach, st.reach))
    ahead = st.reach - st.s
    known = st.origin + st.reach * st.way
    known = np.where(st.reach == 1.0, st.way_end, known)
    predicted = (st.base + ahead * st.slope + 0.5 * ahead * ahead * st.curve)[view.plan.unknown]
    predicted = np.where(back, st.base, view.joined(predicted, known, st.base))
    st.q, st.guess = np.where(decided, predicted, moved), np.where(decided, predicted, st.guess)
    return over


def _arrivals(
    view: HostView,
    st: _Lanes,
    out: Followed,
    good: np.ndarray,
    stopped: np.ndarray,
    ended: np.ndarray,
    speed: np.ndarray,
    over_it: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """What becomes of lanes that have arrived, or can go no further: which are over, and which turn back."""
    least, weight, length = view.least, view.weights, view.eq.length
    arrived = good & (st.s >= 1.0)
    touched = stopped & ((1.0 - st.s < least.touch) | (1.0 - st.s <= 4.0 * over_it))
    visited = arrived | touched
    none = np.zeros(len(good), bool)
    if not visited.any():
        out.last[:, st.which[ended]] = st.base[:, ended]
        return ended, none
    aim, way = st.way_end, st.way
    # Towards the end of a branch the pose changes ever faster; where branches cross it does not.
    crossed = touched & (speed <= judge.FAST * st.usual)
    if crossed.any():
        before = (_BEFORE * length / speed)[crossed]
        at = st.base[:, crossed], st.slopes[:, :, crossed], way[:, crossed], (1.0 - st.s)[crossed]
        st.base[:, crossed] = _met(view.taken(crossed), *at, before, aim[:, crossed])
    at_end, following = st.target >= st.final, np.minimum(st.target + 1, st.final)
    next_aim = st.value(following)
    next_way = next_aim - aim
    square, along = np.sum(way * way, axis=0), np.sum(way * next_way, axis=0)
    onward = along / np.where(square > 0.0, square, 1.0)
    aside = along * along < 0.99 * square * np.sum(next_way * next_way, axis=0)
    # A limit may be touched, not passed: it goes on afresh, only if the way turns back. A crossing is passed.
    back = touched & ~crossed & ~at_end & (onward < 0.0)
    through = crossed & ~at_end
    onwards = (arrived & ~at_end) | back | through
    over = (visited & at_end) | (ended & ~back & ~through)
    _write(st, out, visited, over, st.base, st.slopes, touched & ~crossed, crossed)
    if onwards.any():
        origin = np.where(back, st.base[view.plan.known], aim)
        st.origin = np.where(onwards, origin, st.origin)
        st.target = np.where(onwards, following, st.target)
        st.way_end = np.where(onwards, next_aim, aim)
        st.way = np.where(onwards, st.way_end - st.origin, way)
        st.s = np.where(onwards, 0.0, st.s)
        st.slope = np.where(onwards, _along(view, st.slopes, st.way), st.slope)
        st.rise = np.where(onwards, st.rise * onward, st.rise)
        st.curve = np.where(onwards, np.where(arrived & ~aside, st.curve * onward * onward, 0.0), st.curve)
        fast = _sizes(weight, st.slope)[0]
        st.usual = np.where(onwards, fast, st.usual)
        st.leapt &= ~onwards
        # Onwards from a crossing by a step that leads clear of it, on another way by a short one.
        clear = judge.crossing(fast, least, length)
        st.h = np.where(through, clear, np.where(arrived & aside, _FIRST, st.h))
    return over, back


def _level(view: HostView, st: _Lanes, seen: _Seen) -> np.ndarray:
    """Sizes of the determinants relative to the largest that the whole analysis has met."""
    if view.redundant:
        return np.abs(seen.ratio) * st.level
    return np.exp(seen.sizes - np.maximum(view.greatest, seen.sizes))


def _write(st: _Lanes, out: Followed, visited, over, base, slopes, limit, crossed) -> None:
    """Note the poses of targets that were reached, and where lanes ended."""
    if visited.any():
        lane, place = st.which[visited], st.target[visited]
        out.poses[place, :, lane] = base[:, visited].T
        out.slopes[place, :, :, lane] = np.moveaxis(slopes[..., visited], 2, 0)
        out.limit[place, lane], out.crossed[place, lane] = limit[visited], crossed[visited]
        out.reached[lane] = place + 1
    if over.any():
        out.last[:, st.which[over]] = base[:, over]


def _met(
    view: HostView,
    q: np.ndarray,
    slopes: np.ndarray,
    way: np.ndarray,
    rest: np.ndarray,
    before: np.ndarray,
    aim: np.ndarray,
) -> np.ndarray:
    """Poses where branches cross, by Taylor's series from a little before them, where poses are well determined."""
    begin = q - (before - rest) * _along(view, slopes, way)
    begin[view.plan.known] = aim - before * way
    begin = corrected(view, begin)
    still = np.zeros_like(way)
    terms = rates(view, begin, [way, still, still])
    out = begin + sum(before**k / math.factorial(k) * term for k, term in enumerate(terms, start=1))
    out[view.plan.known] = aim
    return out


def corrected(view: HostView, q: np.ndarray) -> np.ndarray:
    """Newton in all lanes until its steps are rounding."""
    unknown, at, going = view.plan.unknown, np.array(q), np.arange(q.shape[1])
    out = at
    for _ in range(_NEWTON):
        step = view.solve(view.matrices(at)[0], view.residual(at).T[:, :, None])[:, :, 0].T
        step = np.where(np.isfinite(step), step, 0.0)
        at[unknown] -= step
        out[:, going] = at
        on = np.max(np.abs(step) * view.unknown_weights, axis=0, initial=0.0) > view.least.fine * view.eq.length
        if not on.any():
            break
        view, going, at = view.taken(on), going[on], at[:, on]
    return out


def _along(view: HostView, slopes: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Change of all coordinates ``(N, lanes)`` along ways of the known ones ``(known, lanes)``."""
    out = np.zeros((len(view.eq.home), way.shape[1]), slopes.dtype)
    out[view.plan.unknown] = np.sum(slopes * way[: slopes.shape[1]], axis=1)
    out[view.plan.known] = way
    return out


def _sizes(weight: np.ndarray, *x: np.ndarray) -> np.ndarray:
    """Lengths ``(len(x), lanes)`` of changes of coordinates, ``(N, lanes)`` each."""
    y = np.stack(x) * weight
    return np.sqrt(np.einsum("anb,anb->ab", y, y))
