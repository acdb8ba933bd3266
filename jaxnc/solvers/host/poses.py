"""Poses of many input values on the host: anchors are followed to, the rest is filled in, judged, and repaired."""

import math
from typing import NamedTuple

import numpy as np

from jaxnc import process
from jaxnc.solvers import branch
from jaxnc.solvers.host.follow import Followed, correct_poses, follow
from jaxnc.solvers.host.lockstep import solve_at_once
from jaxnc.solvers.host.view import HostView, largest_of_lanes
from jaxnc.solvers.plan import unwind
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.system.precision import farthest

_EACH = 8  # poses that are followed to one by one


def solve_sequences(
    view: HostView, start: np.ndarray, values: np.ndarray, counts: np.ndarray | None = None
) -> PoseBatch:
    """Solve for sequences of input values, each in order along one branch; all sequences in lockstep.

    Poses to begin from are ``(N, D)``, values ``(T, known, D)``; each sequence has as many as `counts` says, at least
    one.

    Returns:
        The poses, those of one sequence after those of another, ``D T`` lanes; after the first of a sequence that is
        not reached none is, and beyond its last value they are as there.
    """
    total, _, many = values.shape
    winding = _skip_turns(view, start, values)
    if winding is not None:
        near = values.copy()
        near[:, 0] = unwind(values[:, 0], winding.turns)
        return _rewind(solve_sequences(view, start, near, counts), winding, values[:, 0], view.plan.driven[0])
    place, given = np.arange(total)[:, None], np.full(many, total) if counts is None else counts
    # A value that is there twice in succession has one pose.
    new = np.any(values[1:] != values[:-1], axis=1) & (place[1:] < given)
    at = np.concatenate([np.zeros((1, many), int), np.cumsum(new, axis=0)])
    distinct = at[-1] + 1
    if np.any(distinct < total):
        values = values[_to_front(np.concatenate([np.ones((1, many), bool), new])), :, np.arange(many)]
        values = np.moveaxis(values, 1, 2)
    found = _Found(view, start, values[: np.max(distinct)], distinct)
    found.find()
    back = (at + found.first).T.reshape(-1)
    return found.poses().each(lambda x: x[..., back])


def solve_scattered(view: HostView, start: np.ndarray, values: np.ndarray, which: np.ndarray) -> PoseBatch:
    """Solve for independent input values, each on the straight way from a start pose.

    Poses to begin from are ``(N, D)``, values ``(L, known)``; `which` start pose each has is ``(L,)``.
    """
    known = start[view.plan.known]
    moving = np.flatnonzero(np.any(known[:, which] != values.T, axis=1))
    if len(moving) <= 1 and len(values) > _EACH * start.shape[1]:
        return _along_lines(view, start, values, which, int(moving[0]) if len(moving) else 0)
    if len(values) > view.at_once:
        parts = [solve_scattered(view, start, values[at], which[at]) for at in _groups(np.arange(len(values)), view)]
        return parts[0].each(lambda *x: np.concatenate(x, axis=-1), *parts[1:])
    view, start = view.select(which), start[:, which]
    found = _Found(view, start, values.T[None], np.ones(len(values), int))
    found.find()
    return found.poses()


def _along_lines(view: HostView, start: np.ndarray, values: np.ndarray, which: np.ndarray, moving: int) -> PoseBatch:
    """Solve for values below a start in falling order, and those above it in rising order, as two sequences of each."""
    way = values[:, moving] - start[view.plan.known[moving], which]
    line = 2 * which + (way >= 0.0)
    order = np.lexsort((np.abs(way), line))
    used, first, counts = np.unique(line[order], return_index=True, return_counts=True)
    place = np.arange(len(order)) - np.repeat(first, counts)
    at = np.repeat(np.arange(len(used)), counts)
    longest = int(np.max(counts, initial=1))
    lines = values[order[first]].T[None].repeat(longest, axis=0)
    lines[place, moving, at] = values[order, moving]
    found = solve_sequences(view.select(used // 2), start[:, used // 2], lines, counts)
    back = np.empty(len(order), int)
    back[order] = at * longest + place
    return found.each(lambda x: x[..., back])


class _Winding(NamedTuple):
    """Whole turns of a driven angle on which nothing else depends, which need not be followed, and what one changes."""

    turns: np.ndarray  # whole turns that are left out up to each value, (T, lanes)
    change: np.ndarray  # of all coordinates in one turn: whole turns of angles, (N, lanes)


def _skip_turns(view: HostView, start: np.ndarray, values: np.ndarray) -> _Winding | None:
    """Find whole turns of the one input that can be left out of sequences of its values ``(T, known, lanes)``.

    They are those of an angle that nothing else depends on, where a turn leads back to the pose that it began from. A
    branch of one input is closed everywhere if it is closed at the start. None if there are no such turns.
    """
    top, plan = view.plan.topology, view.plan
    if len(plan.driven) != 1 or not plan.periodic[0]:
        return None
    angle = values[:, 0]
    steps = np.diff(angle, axis=0, prepend=start[[plan.driven[0]]]) / math.tau
    # of more than 2 turns in one step whole ones are left out
    many = (np.abs(steps) > 2.0) & (np.abs(angle) <= farthest(start))
    lanes = np.flatnonzero(many.any(axis=0))
    if not len(lanes):
        return None
    begin = start[:, lanes]
    target = begin[plan.known]
    target[0] += math.tau
    inner = view.select(lanes)
    seen = follow(inner, begin, target[None])
    moved = seen.poses[0] - begin
    change = np.where(top.mark(top.angles)[:, None], np.round(moved / math.tau), 0.0) * math.tau
    closed = (seen.reached == 1) & ~seen.limit[0] & ~seen.crossed[0]
    closed &= inner.norm(inner.weights, moved - change) <= inner.least.close * inner.eq.length
    if not closed.any():
        return None
    turns, whole = np.zeros_like(angle), np.zeros_like(start)
    turns[:, lanes] = np.cumsum(np.where(many[:, lanes] & closed, np.trunc(steps[:, lanes]), 0.0), axis=0)
    whole[:, lanes] = change
    return _Winding(turns, whole)


def _rewind(found: PoseBatch, winding: _Winding, values: np.ndarray, driven: int) -> PoseBatch:
    """Put the turns that were left out into poses again, ``(N, D T)``; `values` are what was asked for, ``(T, D)``."""
    total, many = values.shape
    reached = found.good.reshape(many, total).T
    last = np.maximum(np.sum(reached, axis=0) - 1, 0)
    at_end = np.where(reached.any(axis=0), winding.turns[last, np.arange(many)], 0.0)
    turns = np.where(reached, winding.turns, at_end).T.reshape(-1)
    q = found.q + np.repeat(winding.change, total, axis=1) * turns
    q[driven] = np.where(found.good & (turns != 0.0), values.T.reshape(-1), q[driven])
    return found._replace(q=q)


class _Found:
    """Poses of sequences as they are found, those of one after those of another; no value is there twice in succession.

    Attributes:
        total: lanes of each sequence, of which `counts` have values.
        first: the first lane of each.
        owner: sequence of every lane.
        q, slopes: the poses, and derivatives of the unknown coordinates by the driven ones.
        good, limit, crossed: as `PoseBatch` has them.
        settled: whether it is solved to rounding already, and
        conditioning: that of such a pose.
        last, exhausted: of every sequence, the last pose on its branch, and whether it was given up there.
    """

    def __init__(self, view: HostView, start: np.ndarray, values: np.ndarray, counts: np.ndarray):
        n, driven, (self.total, known, many) = len(view.plan.unknown), len(view.plan.driven), values.shape
        self.view, self.start, self.counts, self.ordered = view, start, counts, values
        self.first, self.owner = np.arange(many) * self.total, np.repeat(np.arange(many), self.total)
        self.values = values.transpose(1, 2, 0).reshape(known, many * self.total)
        lanes = many * self.total
        # the memory of 100_000 numbers of matrices is asked for again and again
        if view.program is None and lanes * math.prod(view.shape) >= 100_000:
            process.keep_memory()
        self.q = np.repeat(start, self.total, axis=1)
        self.slopes = np.zeros((n, driven, lanes), start.dtype)
        self.good, self.limit, self.crossed, self.settled = (np.zeros(lanes, bool) for _ in range(4))
        self.conditioning = np.zeros(lanes, start.dtype)

    def find(self) -> None:
        """Find all of them that there are: whole sequences at once where these are sure, the others in order."""
        q, right = solve_at_once(self.view, self.start, self.ordered, self.counts)
        if not right.any():
            self._follow()
            return
        self.last, self.exhausted, place = np.array(self.start), np.zeros(len(right), bool), np.arange(self.total)
        lanes = np.flatnonzero(right[self.owner])
        self.q[:, lanes] = q[:, :, right].transpose(0, 2, 1).reshape(len(q), -1)
        self.good[lanes] = (place < self.counts[right, None]).reshape(-1)
        self.last[:, right] = q[:, self.counts[right] - 1, right]
        rest = np.flatnonzero(~right)
        if len(rest):
            others = _Found(self.view.select(rest), self.start[:, rest], self.ordered[:, :, rest], self.counts[rest])
            others._follow()
            lanes = np.flatnonzero(~right[self.owner])
            self.q[:, lanes], self.good[lanes] = others.q, others.good
            self.limit[lanes], self.crossed[lanes] = others.limit, others.crossed
            self.settled[lanes], self.conditioning[lanes] = others.settled, others.conditioning
            self.last[:, rest], self.exhausted[rest] = others.last, others.exhausted

    def _follow(self) -> None:
        marks = _choose_anchors(self.view, self.ordered, self.counts)
        at, counts, every = _to_front(marks), np.sum(marks, axis=0), np.arange(len(self.counts))
        seen = follow(self.view, self.start, np.moveaxis(self.ordered[at, :, every], 1, 2), counts)
        self._take(at, seen, every)
        self.last, self.exhausted = np.array(seen.last), np.array(seen.exhausted)
        done = np.where(seen.reached > 0, at[np.maximum(seen.reached, 1) - 1, every], -1)
        self._go_on(marks, done, np.flatnonzero(seen.reached < counts))
        kept = marks & (np.arange(self.total)[:, None] <= done)
        self._fill(*self._between(kept))
        self._repair(kept, done)
        good = self.good.reshape(-1, self.total)
        self.good = (np.cumsum(~good, axis=1) == 0).reshape(-1)  # a branch is followed in order

    def _go_on(self, marks: np.ndarray, done: np.ndarray, ended: np.ndarray) -> None:
        """Follow sequences that ended on the way to an anchor pose by pose to it, and from there to all others.

        `done` is the last anchor that each sequence was followed to, and is kept up to date.
        """
        while len(ended):
            ways, singly = [], []
            for k in ended:
                ahead = np.flatnonzero(marks[:, k])
                ahead = ahead[ahead > done[k]]
                singly.append(ahead[0] - done[k])
                ways.append([*range(done[k] + 1, ahead[0]), *ahead])
            open_ = np.array(singly) > 1  # a next pose that is an anchor was tried
            ended, singly, ways = (
                ended[open_],
                np.array(singly)[open_],
                [w for w, b in zip(ways, open_, strict=True) if b],
            )
            if not len(ended):
                return
            counts = np.array([len(way) for way in ways])
            place = np.stack([np.pad(way, (0, int(counts.max()) - len(way)), "edge") for way in ways], axis=1)
            begin = np.where(done[ended] >= 0, self.q[:, self.first[ended] + done[ended]], self.start[:, ended])
            more = follow(self.view.select(ended), begin, np.moveaxis(self.ordered[place, :, ended], 1, 2), counts)
            self._take(place, more, ended)
            self.last[:, ended], self.exhausted[ended] = more.last, more.exhausted
            through = more.reached >= singly
            done[ended[through]] = place[more.reached - 1, np.arange(len(ended))][through]
            ended = ended[through & (more.reached < counts)]

    def _take(self, place: np.ndarray, seen: Followed, which: np.ndarray) -> None:
        """Take over poses ``(T, lanes)`` that some sequences were followed to."""
        t, lane = np.nonzero(np.arange(len(place))[:, None] < seen.reached)
        at = self.first[which[lane]] + place[t, lane]
        self.q[:, at], self.slopes[:, :, at] = seen.poses[t, :, lane].T, np.moveaxis(seen.slopes[t, :, :, lane], 0, 2)
        self.good[at], self.limit[at], self.crossed[at] = True, seen.limit[t, lane], seen.crossed[t, lane]

    def _between(self, marks: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return lanes between anchors that were reached, the anchor before each, and the one behind.

        Where it helps that lanes are in order, regular anchors are among them, each before and behind itself.
        """
        place = np.arange(self.total)[:, None]
        left = np.maximum.accumulate(np.where(marks, place, -1), axis=0)
        right = np.minimum.accumulate(np.where(marks, place, self.total)[::-1], axis=0)[::-1]
        again = (~(self.crossed | self.limit)).reshape(-1, self.total).T if self.view.wants_order else ~marks
        which, t = np.nonzero(((again | ~marks) & (left >= 0) & (right < self.total)).T)
        return tuple(self.first[which] + x for x in (t, left[t, which], right[t, which]))

    def _fill(self, place: np.ndarray, left: np.ndarray, right: np.ndarray) -> None:
        """Fill in poses of lanes between two neighbours that are known."""
        if not len(place):
            return
        if len(place) > self.view.at_once:
            for some in _groups(np.arange(len(place)), self.view):
                self._fill(place[some], left[some], right[some])
            return
        view, plan = self.view.select(self.owner[place]), self.view.plan
        a, b = self.q[:, left], self.q[:, right]
        u, v, w = (self.values[:, x] for x in (place, left, right))
        way = w - v
        span = np.sum(way * way, axis=0)
        t = np.where(span > 0, np.sum((u - v) * way, axis=0) / np.where(span > 0, span, 1.0), 0.0)
        driven, slopes = self.slopes.shape[1], [self.slopes[:, :, k] for k in (left, right)]
        rise, fall = (np.sum(slope * way[:driven], axis=1) for slope in slopes)
        x, y = a[plan.unknown], b[plan.unknown]
        s = 1.0 - t
        guess = s * s * (1.0 + 2.0 * t) * x + t * t * (3.0 - 2.0 * t) * y + t * s * (s * rise - t * fall)
        # What lies aside of the way between the neighbours goes by their tangents.
        aside = (u - v - t * way)[:driven]
        guess = guess + np.sum((s * slopes[0] + t * slopes[1]) * aside, axis=1)
        begin = view.join(guess, u, a)
        close = view.near(begin)
        q = correct_poses(view, begin, close)
        good = largest_of_lanes(view.residual(q)) <= view.tolerance(q)
        good &= view.upright(q)
        far, off = view.norm(view.weights, b - a), view.norm(view.weights, q - begin)
        good &= off <= branch.NEAR * far + view.least.close * view.eq.length
        ends, back = np.unique(np.concatenate([left, right]), return_inverse=True)
        before, behind = np.split(back, 2)
        if close is None:
            good &= view.same_branch(q, self.q[:, ends], before, behind)
        else:
            alike, self.conditioning[place] = view.survey(q, self.q[:, ends], before, behind, close)
            good &= alike
        good &= ~self.crossed[left] & ~self.crossed[right]
        self.q[:, place] = np.where(good, q, self.q[:, place])
        self.good[place] |= good  # an anchor is one all the same
        self.settled[place] = good & (close is not None)

    def _repair(self, marks: np.ndarray, before: np.ndarray) -> None:
        """Follow to poses that could not be filled in, in each gap from the last regular anchor before it.

        From the start if there is none.
        """
        lanes = np.arange(len(self.owner))
        wrong = np.flatnonzero(~self.good & (lanes - self.first[self.owner] <= before[self.owner]))
        if not len(wrong):
            return
        regular = marks.T.reshape(-1) & ~self.crossed & ~self.limit
        base = np.maximum.accumulate(np.where(regular, lanes, -1))[wrong]
        first = self.first[self.owner[wrong]]
        base = np.where(base < first, first - 1, base)  # none in its sequence
        begins = np.flatnonzero(np.diff(base, prepend=-2))
        counts = np.diff(begins, append=len(wrong))
        run = np.repeat(np.arange(len(begins)), counts)
        place = np.zeros((np.max(counts), len(begins)), int) + wrong[begins]
        place[np.arange(len(wrong)) - begins[run], run] = wrong
        owner, base = self.owner[wrong[begins]], base[begins]
        begin = np.where(base < self.first[owner], self.start[:, owner], self.q[:, base])
        seen = follow(self.view.select(owner), begin, np.moveaxis(self.values[:, place], 1, 0), counts)
        self._take(place - self.first[owner], seen, owner)

    def poses(self) -> PoseBatch:
        """Check what was found; where a pose was not found, the last one on the branch is checked.

        Regular poses have one more step of Newton: those that were followed to met a tolerance, not rounding.
        """
        good, rest = np.flatnonzero(self.good), np.flatnonzero(self.limit | self.crossed)
        regular = np.flatnonzero(self.good & ~self.limit & ~self.crossed & ~self.settled)
        q = np.concatenate([self.q, self.last], axis=1)
        owner = np.concatenate([self.owner, np.arange(len(self.counts))])
        conditioning = np.concatenate([self.conditioning, np.zeros(len(self.counts), q.dtype)])
        for some in _groups(regular, self.view):
            view, at = self.view.select(owner[some]), q[:, some]
            r, step, conditioning[some] = view.polish(at)
            new = np.array(at)
            new[view.plan.unknown] -= np.where(np.isfinite(step), step, 0.0)
            before, after = largest_of_lanes(r), largest_of_lanes(view.residual(new))
            q[:, some] = np.where(after < before, new, at)
        ended = np.flatnonzero(~self.good.reshape(-1, self.total).all(axis=1))
        ends = np.concatenate([rest, len(self.owner) + ended])
        if len(ends):
            conditioning[ends] = self.view.select(owner[ends]).conditioning(q[:, ends])
        size, upright, mirrored = np.zeros_like(conditioning), np.zeros(len(owner), bool), np.zeros(len(owner), bool)
        for some in _groups(np.concatenate([good, ends[len(rest) :]]), self.view):
            size[some], upright[some], mirrored[some] = self.view.select(owner[some]).check(q[:, some])
        at = np.where(self.good, np.arange(len(self.owner)), len(self.owner) + self.owner)
        given_up = ~self.good & self.exhausted[self.owner]
        return PoseBatch(
            q[:, at],
            size[at],
            conditioning[at],
            good=self.good,
            limit=self.limit,
            crossed=self.crossed,
            exhausted=given_up,
            upright=upright[at],
            mirrored=mirrored[at],
        )


def _groups(lanes: np.ndarray, view: HostView) -> list[np.ndarray]:
    """Split lanes into as many groups as a view solves one after the other; none of none."""
    return np.array_split(lanes, -(-len(lanes) // view.at_once)) if len(lanes) else []


def _to_front(marks: np.ndarray) -> np.ndarray:
    """Put places of the marks ``(T, D)`` in front of everything else, down to as many as one of the columns has."""
    return np.argsort(~marks, axis=0, kind="stable")[: np.max(np.sum(marks, axis=0))]


def _choose_anchors(view: HostView, values: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Mark poses of sequences that are followed to, as many as a way is long, and where it turns; ``(T, D)``."""
    total, known, many = values.shape
    place, final = np.arange(total)[:, None], counts - 1
    valid = place <= final
    if total <= _EACH:
        return valid
    turns = np.zeros((known, 1), bool)
    turns[view.plan.angles] = True
    steps = np.diff(values, axis=0) / np.where(turns, 1.0, view.eq.length)
    steps = np.where(valid[1:, None], steps, 0.0)
    square = np.sum(steps * steps, axis=1)
    length = np.concatenate([np.zeros((1, many)), np.cumsum(np.sqrt(square), axis=0)])
    whole = np.where(length[-1] > 0.0, length[-1], 1.0)
    # 0.4 radians, or lengths of the mechanism, between anchors
    part = np.floor(length * (np.ceil(length[-1] / 0.4) / whole))
    product = np.sum(steps[:-1] * steps[1:], axis=1)
    bends = (product < 0.0) | (product * product < 0.999 * square[:-1] * square[1:])
    corners = np.zeros((total, many), bool)
    corners[1:-1] = bends & valid[2:]
    marks = corners | (place == 0) | (place == final)
    marks[1:] |= (np.diff(part, axis=0) > 0.0) & valid[1:]
    # A short way, or one that winds: pose by pose.
    return np.where((counts <= _EACH) | (np.sum(corners, axis=0) > counts // 4), valid, marks)
