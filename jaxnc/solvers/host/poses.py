"""Poses of many input values on the host: anchors are followed to, the rest is filled in, judged, and repaired."""

from typing import NamedTuple

import numpy as np

from jaxnc.solvers.host import judge
from jaxnc.solvers.host.follow import Followed, corrected, follow
from jaxnc.solvers.host.view import HostView

_EACH = 8  # poses that are followed to one by one
_SPACING = 0.4  # radians or lengths of the mechanism that inputs change by between anchors


class Poses(NamedTuple):
    """Poses of one design and what became of them; lanes are the last axis.

    Attributes:
        q: the poses ``(N, lanes)``; where one was not found, the last one on the branch.
        reached: whether it is on the branch.
        limit: whether the branch ends there, an input at the limit of its travel.
        crossed: whether branches cross there.
        exhausted: whether following it was given up, which might go on.
        size: largest residual, a length.
        conditioning: estimate of the reciprocal condition number.
        upright, mirrored: whether nothing is met by a mirror image, and whether a body is.
    """

    q: np.ndarray
    reached: np.ndarray
    limit: np.ndarray
    crossed: np.ndarray
    exhausted: np.ndarray
    size: np.ndarray
    conditioning: np.ndarray
    upright: np.ndarray
    mirrored: np.ndarray


def sequence(view: HostView, start: np.ndarray, values: np.ndarray) -> Poses:
    """Poses of one sequence of input values, in order along one branch.

    Args:
        view: what is solved for.
        start: the pose that it begins from, ``(N,)``.
        values: known coordinates, ``(T, known)``.

    Returns:
        The poses; after the first that is not reached none is.
    """
    again = np.flatnonzero(np.all(values[1:] == values[:-1], axis=1)) + 1
    if len(again):  # a value that is there twice has one pose
        first = np.delete(np.arange(len(values)), again)
        found = sequence(view, start, values[first])
        back = np.searchsorted(first, np.arange(len(values)), side="right") - 1
        return Poses(*(x[..., back] for x in found))
    total = len(values)
    found = _Found(view, start, total)
    at = _anchors(view, values)
    seen = follow(view, start[:, None], values[at][:, :, None])
    reached = int(seen.reached[0])
    found.take(at[:reached], seen, 0)
    last = seen
    if reached < len(at) and len(at) < total:  # the branch ends on the way to an anchor: where, pose by pose
        before = int(at[reached - 1]) if reached else -1
        rest = values[before + 1 : int(at[reached]) + 1][:, :, None]
        last = follow(view, (seen.poses[reached - 1, :, :1] if reached else start[:, None]), rest)
        found.take(before + 1 + np.arange(int(last.reached[0])), last, 0)
    between = _between(at[:reached], total)
    found.fill(values, between)
    wrong = np.flatnonzero(~found.good[: int(at[reached - 1]) + 1]) if reached else np.zeros(0, int)
    if len(wrong):
        found.repair(values, wrong, at[:reached])
    found.good &= np.cumsum(~found.good) == 0  # a branch is followed in order
    return found.poses(last.last[:, 0], bool(last.exhausted[0]))


def scattered(view: HostView, start: np.ndarray, values: np.ndarray) -> Poses:
    """Poses of independent input values, each on the straight way from the start pose.

    Args:
        view: what is solved for.
        start: the pose that all begin from, ``(N,)``.
        values: known coordinates, ``(T, known)``.

    Returns:
        The poses.
    """
    moving = np.flatnonzero(np.any(values != start[view.plan.known], axis=0))
    if len(moving) <= 1 and len(values) > _EACH:
        return _on_a_line(view, start, values, int(moving[0]) if len(moving) else 0)
    found = _Found(view, start, len(values))
    seen = follow(view, np.repeat(start[:, None], len(values), axis=1), values.T[None])
    for k in np.flatnonzero(seen.reached).tolist():
        found.take(np.array([k]), seen, k)
    return found.poses(seen.last, seen.exhausted)


def _on_a_line(view: HostView, start: np.ndarray, values: np.ndarray, moving: int) -> Poses:
    """The values below the start in falling order, and those above it in rising order, as two sequences."""
    at, parts, places = start[view.plan.known][moving], [], []
    for side in (values[:, moving] < at, values[:, moving] >= at):
        which = np.flatnonzero(side)
        if not len(which):
            continue
        unique, back = np.unique(values[which, moving], return_inverse=True)
        order = np.arange(len(unique)) if unique[0] >= at else np.arange(len(unique))[::-1]
        line = np.repeat(values[which[:1]], len(unique), axis=0)
        line[:, moving] = unique[order]
        found = sequence(view, start, line)
        parts.append(Poses(*(x[..., np.argsort(order)[back]] for x in found)))
        places.append(which)
    back = np.argsort(np.concatenate(places))
    return Poses(*(np.concatenate(x, axis=-1)[..., back] for x in zip(*parts, strict=True)))


class _Found:
    """Poses as they are found."""

    def __init__(self, view: HostView, start: np.ndarray, total: int):
        n, driven = len(view.plan.unknown), len(view.plan.driven)
        self.view, self.start = view, start
        self.q = np.repeat(start[:, None], total, axis=1)
        self.slopes = np.zeros((n, driven, total), start.dtype)
        self.good, self.limit, self.crossed = (np.zeros(total, bool) for _ in range(3))

    def take(self, at: np.ndarray, seen: Followed, lane: int) -> None:
        """Poses that were followed to, of one lane."""
        count = len(at)
        self.q[:, at] = seen.poses[:count, :, lane].T
        self.slopes[:, :, at] = np.moveaxis(seen.slopes[:count, :, :, lane], 0, 2)
        self.good[at] = True
        self.limit[at], self.crossed[at] = seen.limit[:count, lane], seen.crossed[:count, lane]

    def fill(self, values: np.ndarray, between: np.ndarray) -> None:
        """Poses between two neighbours ``(3, lanes)`` of place, left and right that are known."""
        if not between.shape[1]:
            return
        view, plan = self.view, self.view.plan
        place, left, right = between
        a, b = self.q[:, left], self.q[:, right]
        u, v, w = values[place].T, values[left].T, values[right].T
        way = w - v
        span = np.sum(way * way, axis=0)
        t = np.where(span > 0, np.sum((u - v) * way, axis=0) / np.where(span > 0, span, 1.0), 0.0)
        driven = self.slopes.shape[1]
        rise, fall = (np.sum(self.slopes[:, :, k] * way[:driven], axis=1) for k in (left, right))
        x, y = a[plan.unknown], b[plan.unknown]
        s = 1.0 - t
        guess = s * s * (1.0 + 2.0 * t) * x + t * t * (3.0 - 2.0 * t) * y + t * s * (s * rise - t * fall)
        # What lies aside of the way between the neighbours goes by their tangents.
        aside = (u - v - t * way)[:driven]
        guess = guess + np.sum((s * self.slopes[:, :, left] + t * self.slopes[:, :, right]) * aside, axis=1)
        begin = view.joined(guess, u, a)
        q = corrected(view, begin)
        weight = view.eq.weights[:, None]
        good = np.max(np.abs(view.residual(q)), axis=0, initial=0.0) <= view.tolerance(q)
        good &= view.eq.guards(q)[0]
        far = np.sqrt(np.sum((weight * (b - a)) ** 2, axis=0))
        off = np.sqrt(np.sum((weight * (q - begin)) ** 2, axis=0))
        good &= off <= judge.NEAR * far + view.least.close * view.eq.length
        good &= self._same(left, right, q, a, b)
        self.q[:, place] = np.where(good, q, self.q[:, place])
        self.good[place] = good

    def _same(self, left, right, q, a, b) -> np.ndarray:
        """Whether filled-in poses and both neighbours have one orientation: no singular position lies between."""
        view = self.view
        if view.redundant:
            here, first, last = (view.matrices(x)[0] for x in (q, a, b))
            return (view.relative(here, first) > 0) & (view.relative(last, first) > 0)
        ends, back = np.unique(np.concatenate([left, right]), return_inverse=True)
        known = view.orientation(view.matrices(self.q[:, ends])[0])[0][back]
        first, last, signs = known[: len(left)], known[len(left) :], view.orientation(view.matrices(q)[0])[0]
        return np.all((signs == first) & (signs == last), axis=1) & ~self.crossed[left] & ~self.crossed[right]

    def repair(self, values: np.ndarray, wrong: np.ndarray, anchors: np.ndarray) -> None:
        """Follow to poses, in each gap from the last regular anchor before it (from the start if there is none)."""
        regular = anchors[~self.crossed[anchors] & ~self.limit[anchors]]
        k = np.searchsorted(regular, wrong) - 1
        runs = np.split(np.arange(len(wrong)), np.flatnonzero(np.diff(k)) + 1)
        longest = max(len(r) for r in runs)
        targets = np.stack([values[wrong[r]][np.minimum(np.arange(longest), len(r) - 1)] for r in runs], axis=2)
        before = [int(k[r[0]]) for r in runs]
        begin = np.stack([self.start if j < 0 else self.q[:, regular[j]] for j in before], axis=1)
        seen = follow(self.view, begin, targets)
        for lane, run in enumerate(runs):
            self.take(wrong[run[: int(seen.reached[lane])]], seen, lane)

    def _polish(self) -> None:
        """One more step of Newton for all regular poses: those followed to met a tolerance, not rounding."""
        view = self.view
        at = np.flatnonzero(self.good & ~self.limit & ~self.crossed)
        if not len(at):
            return
        q = self.q[:, at]
        r = view.residual(q)
        step = view.solve(view.matrices(q)[0], r.T[:, :, None])[:, :, 0].T
        new = np.array(q)
        new[view.plan.unknown] -= np.where(np.isfinite(step), step, 0.0)
        before, after = (np.max(np.abs(x), axis=0, initial=0.0) for x in (r, view.residual(new)))
        self.q[:, at] = np.where(after < before, new, q)

    def poses(self, last: np.ndarray, exhausted: np.ndarray | bool) -> Poses:
        """What was found, looked at."""
        view = self.view
        last = last if last.ndim == 2 else last[:, None]
        self._polish()
        q = np.where(self.good, self.q, last)
        size = np.max(np.abs(view.eq.residual(q)), axis=0, initial=0.0)
        upright, mirrored = view.eq.guards(q)
        conditioning = view.conditioning(view.matrices(q)[0])
        given_up = ~self.good & exhausted
        return Poses(q, self.good, self.limit, self.crossed, given_up, size, conditioning, upright, mirrored)


def _anchors(view: HostView, values: np.ndarray) -> np.ndarray:
    """Which poses of a sequence are followed to: as many as its way is long, and where it turns."""
    total = len(values)
    if total <= _EACH:
        return np.arange(total)
    turns = np.zeros(values.shape[1], bool)
    turns[view.plan.angles] = True
    steps = np.diff(values, axis=0) / np.where(turns, 1.0, view.eq.length)
    length = np.concatenate([[0.0], np.cumsum(np.sqrt(np.sum(steps * steps, axis=1)))])
    count = int(np.ceil(length[-1] / _SPACING))
    at = np.searchsorted(length, np.linspace(0.0, length[-1], count + 1)[1:-1])
    along, next_step = steps[:-1], steps[1:]
    product = np.sum(along * next_step, axis=1)
    bends = product * product < 0.999 * np.sum(along * along, axis=1) * np.sum(next_step * next_step, axis=1)
    corners = np.flatnonzero((product < 0.0) | bends) + 1
    if len(corners) > total // 4:  # a way that winds: pose by pose
        return np.arange(total)
    return np.unique(np.concatenate([[0, total - 1], at, corners]))


def _between(at: np.ndarray, total: int) -> np.ndarray:
    """Poses between anchors: place, the anchor before and the one behind, ``(3, lanes)``."""
    if len(at) < 2:
        return np.zeros((3, 0), int)
    place = np.setdiff1d(np.arange(int(at[-1])), at)
    k = np.searchsorted(at, place)
    return np.stack([place, at[k - 1], at[k]])
