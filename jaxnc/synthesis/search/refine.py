"""Refinement of many designs: lanes of constrained least squares, filled anew as they finish.

The method is Levenberg-Marquardt inside an augmented Lagrangian. All lanes go on in lockstep, in NumPy. One evaluation
serves the trial point and its Jacobian, whether it is then accepted or not. A trial that does not assemble is refused
like one that is worse, so that nothing is ever not a number. Multipliers follow Hestenes, Powell and Rockafellar
(inequalities); the damping follows Nielsen.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from jaxnc.synthesis.conditions import Links
from jaxnc.synthesis.evaluate import LANES, MEETS, Evaluator, violation
from jaxnc.synthesis.search.goal import Goal
from jaxnc.synthesis.search.planar import solve_finite
from jaxnc.types import ArrayLike

# -- least squares in lanes --------------------------------------------------------------------------------------------

_GENTLE = 1e-3  # damping to begin with, of the largest diagonal element


class LaneState(NamedTuple):
    """Least-squares problems under way, one in each lane."""

    x: np.ndarray  # unknowns (B, n), in their scales
    errors: np.ndarray  # (B, m)
    conditions: np.ndarray  # (B, k)
    slopes: np.ndarray  # derivatives of both, (B, m + k, n)
    multipliers: np.ndarray  # of the conditions, (B, k)
    penalty: np.ndarray  # (B,)
    damping: np.ndarray  # relative, (B,)
    growth: np.ndarray  # factor of the damping at the next refusal, (B,)
    since: np.ndarray  # iterations since the multipliers were updated
    before: np.ndarray  # violation at that update
    settled: np.ndarray  # whether the lane has nothing left to do, (B,)
    broken: np.ndarray  # trials that assembled and of which numbers or derivatives were not finite all the same, (B,)


Evaluated = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Errors ``(B, m)``, conditions ``(B, k)``, slopes of both, and whether they can be trusted, ``(B,)``."""

Evaluate = Callable[[np.ndarray, np.ndarray], Evaluated]
"""From unknowns ``(B, n)``, and which lanes' results are looked at, ``(B,)``."""


def waiting(x: np.ndarray, errors: int, conditions: int) -> LaneState:
    """Make lanes that start at given points, where the first iteration evaluates them."""
    count, n = x.shape
    one = np.ones(count)
    return LaneState(
        x,
        np.full((count, errors), 1e6),  # an error that is worse than any
        np.zeros((count, conditions)),
        np.zeros((count, errors + conditions, n)),
        np.zeros((count, conditions)),
        one,
        _GENTLE * one,
        2.0 * one,
        np.zeros(count, np.int32),
        np.inf * one,
        np.zeros(count, bool),
        np.zeros(count, np.int32),
    )


def advance(
    evaluate: Evaluate, lanes: LaneState, equal: np.ndarray, low: np.ndarray, high: np.ndarray, count: int
) -> LaneState:
    """Take a number of iterations in all lanes.

    Which conditions are equalities is `equal`, ``(k,)``; the others are to be zero or positive. Bounds are in the
    scales of the unknowns, ``(n,)`` or ``(B, n)``.
    """
    with np.errstate(all="ignore"):
        for _ in range(count):
            if lanes.settled.all():
                break
            x, expected = _propose(lanes, equal, low, high)
            lanes = _decide(lanes, x, expected, evaluate(x, ~lanes.settled), equal)
    return lanes


def _augment(now: LaneState, errors: np.ndarray, conditions: np.ndarray, equal: np.ndarray) -> np.ndarray:
    """Join errors and what is left of the conditions to a vector whose half square is the merit."""
    share = now.multipliers / now.penalty[:, None] - conditions
    share = np.where(equal, share, np.maximum(share, 0.0))
    return np.concatenate([errors, np.sqrt(now.penalty)[:, None] * share], axis=1)


def _propose(now: LaneState, equal: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Do the first half of an iteration: where every lane tries next, and the gain that is expected there."""
    m = now.errors.shape[1]
    r = _augment(now, now.errors, now.conditions, equal)
    active = np.where(equal | (r[:, m:] > 0.0), -np.sqrt(now.penalty)[:, None], 0.0)
    slopes = np.concatenate([now.slopes[:, :m], active[:, :, None] * now.slopes[:, m:]], axis=1)
    gradient = np.einsum("bmn,bm->bn", slopes, r)
    # Unknowns at a bound that the descent pushes against stay there.
    free = ~(((now.x <= low) & (gradient > 0.0)) | ((now.x >= high) & (gradient < 0.0)) | (low >= high))
    slopes = np.where(free[:, None, :], slopes, 0.0)
    gradient = np.where(free, gradient, 0.0)
    normal = np.swapaxes(slopes, 1, 2) @ slopes
    diagonal = np.diagonal(normal, axis1=1, axis2=2)
    largest = np.maximum(np.max(diagonal, axis=1, keepdims=True), 1e-30)
    # Marquardt's scaling alone lets directions run away that hardly matter: a small even part holds them.
    damping = now.damping[:, None] * (diagonal + 1e-3 * largest) + 1e-15 * largest
    matrix = normal + damping[:, :, None] * np.eye(damping.shape[1])
    step = -solve_finite(matrix, gradient[:, :, None])[:, :, 0]
    step = np.where(np.isfinite(step), step, 0.0)
    x = np.clip(now.x + step, low, high)
    linear = r + np.einsum("bmn,bn->bm", slopes, x - now.x)
    return x, 0.5 * np.sum(r * r, axis=1) - 0.5 * np.sum(linear * linear, axis=1)


def _decide(now: LaneState, x: np.ndarray, expected: np.ndarray, evaluated: Evaluated, equal: np.ndarray) -> LaneState:
    """Do the second half of an iteration: which lanes take the step, and how they go on."""
    m, moved = now.errors.shape[1], x - now.x
    errors, conditions, tried, ok = evaluated
    old = _augment(now, now.errors, now.conditions, equal)
    merit = 0.5 * np.sum(old * old, axis=1)
    new = _augment(now, errors, conditions, equal)
    better = 0.5 * np.sum(new * new, axis=1)
    finite = np.all(np.isfinite(tried), axis=(1, 2)) & np.isfinite(better)
    broken = now.broken + (ok & ~finite)
    ok = ok & finite
    gain = np.where(expected > 0.0, (merit - better) / np.where(expected > 0.0, expected, 1.0), -1.0)
    take = ok & (better < merit) & ~now.settled
    less = np.where(expected > 0.0, np.maximum(0.1, 1.0 - (2.0 * gain - 1.0) ** 3), 1.0)
    # below 1e-17 damping is lost in rounding
    damping = np.where(take, np.maximum(now.damping * less, 1e-17), now.damping * now.growth)
    growth = np.where(take, 2.0, 2.0 * now.growth)

    def pick(a, b):
        return np.where(take.reshape(-1, *[1] * (a.ndim - 1)), a, b)

    x, errors, conditions, tried = (
        pick(a, b) for a, b in ((x, now.x), (errors, now.errors), (conditions, now.conditions), (tried, now.slopes))
    )
    # Multipliers: when no step is left, or every so often.
    small = np.max(np.abs(moved), axis=1) <= 1e-13 * (1.0 + np.max(np.abs(now.x), axis=1))
    # at a damping of 1e10 no step is possible any more
    still = (damping > 1e10) | (take & (merit - better <= 1e-14 * merit)) | (small & ~take)
    since = now.since + 1
    update = still | (since >= 12)  # 12 iterations between updates of the multipliers
    share = now.multipliers - now.penalty[:, None] * conditions
    share = np.where(equal, share, np.maximum(share, 0.0))
    changed = np.max(np.abs(share - now.multipliers), axis=1, initial=0.0)
    far = np.max(violation(conditions, equal), axis=1, initial=0.0)
    multipliers = np.where(update[:, None], share, now.multipliers)
    none = 1e-11  # violation of a condition
    raised = update & (far > 0.25 * now.before) & (far > none)
    penalty = np.where(raised, np.minimum(10.0 * now.penalty, 1e10), now.penalty)
    top = np.max(np.abs(share), axis=1, initial=0.0)
    done = still & (far <= none) & (changed <= 1e-9 * (top + 1e-12))
    zero = np.sum(errors * errors, axis=1) <= 1e-29 * m
    out = LaneState(
        x,
        errors,
        conditions,
        tried,
        multipliers,
        penalty,
        np.where(update, np.minimum(damping, _GENTLE), damping),
        np.where(update, 2.0, growth),
        np.where(update, 0, since),
        np.where(update, far, now.before),
        now.settled | done | (zero & (far <= none)),
        broken,
    )
    return LaneState(
        *(np.where(now.settled.reshape(-1, *[1] * (a.ndim - 1)), b, a) for a, b in zip(out, now, strict=True))
    )


# -- starts and lanes --------------------------------------------------------------------------------------------------

# Of the merit: a lane that has won less in a round stands still.
ROUGH = 1e-2  # where designs are only sought, to be brought to their ends afterwards
LEVEL = 1e-6  # where the largest error is made small, which goes on by ever less


class Refinement:
    """Starts that wait, lanes at work, and designs that came out of them.

    Attributes:
        goal: what is wanted.
        queue: starts that wait for a lane, each a row of the goal, ``(n + g,)``.
        found: designs that meet the conditions: the sum of the squares of their divided errors, and the same of them.
        done: how many starts have been finished.
        nearest: how far the closest design is from meeting the conditions, and its unknowns.
        broken: gradients that were not finite although the design assembled.
        reached: whether any start reached all its targets.
        unfit: how many random designs could not be moved through their targets.
        spoilt: unknowns of a start that did so without errors, conditions and derivatives being finite.
    """

    def __init__(self, goal: Goal, iterations: int, designs: int = LANES, still: float = 1e-8):
        """Make lanes for `designs` starts, as many as are evaluated at once; a gain below `still` counts as none."""
        self.still = still
        self.goal, self.most, self.width = goal, iterations, min(designs, LANES)
        self.scale, self.evaluate = goal.scale, Evaluator(goal)
        self.queue: list[np.ndarray] = []
        self.found: list[tuple[float, np.ndarray]] = []
        self.done = self.broken = self.unfit = 0
        self.given = np.repeat(goal.arguments[None], self.width, axis=0)
        self.live = np.zeros(self.width, dtype=bool)
        self.spent = np.zeros(self.width, dtype=int)
        self.poor = np.zeros(self.width, dtype=int)
        self.quiet = np.zeros(self.width, dtype=int)
        self.last = np.full(self.width, np.inf)
        self.nearest: tuple[float, np.ndarray] | None = None
        self.moving = np.zeros(goal.count, dtype=bool)
        self.reached = False
        self.spoilt: np.ndarray | None = None
        self.shape, self.equal = goal.shape, goal.equalities
        x = np.broadcast_to(goal.start / self.scale, (self.width, goal.count))
        self.lanes = waiting(x, *self.shape)._replace(settled=np.ones(self.width, bool))
        # Rows that tell whether an unknown changes anything; how long links are is of no matter by itself.
        own = np.repeat([not isinstance(c, Links) for c in goal.problem.conditions], goal.problem.counts)
        self.telling = np.ones(sum(self.shape), bool)
        self.telling[self.shape[0] : self.shape[0] + len(own)] = own

    def merits(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Fit what is linear of starts, and rate them by errors and violations; infinite where they are lost."""
        moved, out = [], []
        for first in range(0, len(x), self.width):
            at, n = np.minimum(np.arange(first, first + self.width), len(x) - 1), self.goal.count
            unknowns, self.given = x[at, :n], x[at, n:]
            lanes = self._advance(waiting(unknowns / self.scale, *self.shape), 1)
            square, far = self._state(lanes)
            good = square < 1e10
            if self.spoilt is None and lanes.broken.any():
                self.spoilt = unknowns[np.argmax(lanes.broken)]
            new, errors = self.goal.fit(unknowns, lanes.errors)
            moved.append(np.concatenate([np.where(good[:, None], new, unknowns), self.given], axis=1))
            square = np.sum(errors**2, axis=1)
            self.reached = self.reached or bool(good.any())
            # derivatives that are nothing
            self.moving |= np.any(np.abs(lanes.slopes[good][:, self.telling]) > 1e-12, axis=(0, 1))
            # a condition's violation weighs 10 times an error
            out.append(np.where(good, square + 10.0 * far**2, np.inf))
        return np.concatenate(moved)[: len(x)], np.concatenate(out)[: len(x)]

    def suit(self, x: np.ndarray, held: int) -> np.ndarray:
        """Hold the first unknowns of starts and refine the others; one that meets all conditions joins `found`."""
        n, some = self.goal.count, x[: self.width]
        at = np.minimum(np.arange(self.width), len(some) - 1)
        start, self.given = some[at, :n] / self.scale, some[at, n:]
        low, high = (np.repeat((v / self.scale)[None], len(at), axis=0) for v in (self.goal.low, self.goal.high))
        low[:, :held] = high[:, :held] = start[:, :held]
        begin = waiting(start, *self.shape)._replace(settled=np.arange(len(at)) >= len(some))
        # 20 iterations in which an idea gets what suits it
        lanes = self._advance(begin, 20 if held < n else 1, (low, high))
        square, far = self._state(lanes)
        rows = np.concatenate([lanes.x * self.scale, self.given], axis=1)[: len(some)]
        rows[:, :held] = some[:, :held]
        good = np.flatnonzero((far <= MEETS) & (square < 1e10))
        if len(good):
            best = good[np.argmin(square[good])]
            self.found.append((float(square[best]), rows[best]))
        return rows

    @property
    def idle(self) -> list[str]:
        """Unknowns that change nothing in any of the starts."""
        return [n for n, m in zip(self.goal.names, self.moving, strict=True) if not m] if self.reached else []

    @property
    def best(self) -> float:
        """The least square of a design that meets the conditions, finished or not."""
        out = min((e for e, _ in self.found), default=np.inf)
        square, far = self._state(self.lanes)
        return float(np.min(square[self.live & (far <= MEETS)], initial=out))

    @property
    def busy(self) -> bool:
        """True as long as there is something to do."""
        return bool(self.live.any() or self.queue)

    def more(self) -> bool:
        """Give free lanes to the next starts; False when there is nothing left to do."""
        free = np.flatnonzero(~self.live)
        some, self.queue = self.queue[: len(free)], self.queue[len(free) :]
        if some:
            at = free[: len(some)]
            n, rows = self.goal.count, np.stack(some)
            fresh = waiting(rows[:, :n] / self.scale, *self.shape)
            self.given = _with(self.given, at, rows[:, n:])
            self.lanes = LaneState(*(_with(a, at, b) for a, b in zip(self.lanes, fresh, strict=True)))
            self.live[at], self.spent[at], self.poor[at], self.quiet[at], self.last[at] = True, 0, 0, 0, np.inf
        return bool(self.live.any())

    def go(self, best: float) -> None:
        """Take a round of iterations, and take out lanes that have nothing left to do.

        While others wait, lanes without prospect of the least square so far (`best`) are taken out too.
        """
        each = 20  # iterations between looks at the lanes
        self.lanes = lanes = self._advance(self.lanes, each)
        self.spent[self.live] += each
        square, far = self._state(lanes)
        merit = square + far
        self.poor = np.where(merit < 0.9 * self.last, 0, self.poor + 1)
        still = (far <= MEETS) & (np.abs(merit - self.last) <= self.still * merit)
        self.quiet = np.where(still, self.quiet + 1, 0)
        self.last = np.minimum(self.last, merit)
        # 2 rounds of standing still: a lane that meets its conditions is done
        over = lanes.settled | (self.spent >= self.most) | (self.quiet >= 2)
        # 10 rounds without getting anywhere: a lane that is behind, or does not meet its conditions, is given up
        over = over | (self.poor >= 10) & ((merit > 2.0 * min(best, self.best)) | (far > MEETS))
        if self.queue:
            # 4 rounds without getting anywhere: the lane is given to another start
            over = over | (self.poor >= 4) & (merit > 2.0 * best)
        self._take_out(self.live & over)

    def stop(self) -> None:
        """Take out all lanes as they are."""
        self._take_out(self.live.copy())

    def run(self) -> list[tuple[float, np.ndarray]]:
        """Go on until nothing is left to do; the designs, best first."""
        while self.more():
            self.go(np.inf)
        return sorted(self.found, key=lambda pair: pair[0])

    # -- keeping ---------------------------------------------------------------------------------------------------

    def to_arrays(self) -> dict[str, np.ndarray]:
        """Write everything that decides how it goes on, as arrays by name."""
        far, x = self.nearest or (np.inf, np.zeros(0))
        n = len(self.goal.row)
        own = {name: np.asarray(getattr(self, name)) for name in _KEPT}
        own |= {f"lanes.{name}": value for name, value in self.lanes._asdict().items()}
        own |= {"queue": _stack_rows(self.queue, n), "found": _stack_rows([x for _, x in self.found], n)}
        return own | {"errors": np.array([e for e, _ in self.found]), "nearest.x": x, "nearest": np.array(far)}

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Go back to what `to_arrays` returned."""
        for name in _KEPT:
            value = arrays[name]
            setattr(self, name, value.copy() if value.ndim else value.item())
        self.lanes = LaneState(**{n: arrays[f"lanes.{n}"] for n in LaneState._fields})
        self.queue = list(arrays["queue"])
        self.found = list(zip(arrays["errors"].tolist(), arrays["found"], strict=True))
        x = arrays["nearest.x"]
        self.nearest = (float(arrays["nearest"]), x) if len(x) else None

    # -- inside ----------------------------------------------------------------------------------------------------

    def _advance(self, lanes: LaneState, count: int, bounds: tuple[np.ndarray, np.ndarray] | None = None) -> LaneState:
        """Take iterations; `bounds` are in the unknowns' scales, those of the goal if not given."""
        goal, scale = self.goal, self.scale

        def look(x: np.ndarray, live: np.ndarray) -> Evaluated:
            return self.evaluate(x * scale, self.given, live)

        low, high = bounds or (goal.low / scale, goal.high / scale)
        return advance(look, lanes, self.equal, low, high, count)

    def _state(self, lanes: LaneState) -> tuple[np.ndarray, np.ndarray]:
        """Squares of the errors, and largest violations, of all lanes."""
        far = violation(lanes.conditions, self.equal)
        return np.sum(lanes.errors**2, axis=1), np.max(far, axis=1, initial=0.0)

    def _take_out(self, over: np.ndarray) -> None:
        at = np.flatnonzero(over)
        square, far = self._state(self.lanes)
        x = np.concatenate([self.lanes.x * self.scale, self.given], axis=1)
        self.live[at] = False
        self.done += len(at)
        self.broken += int(self.lanes.broken[at].sum())
        self.lanes = self.lanes._replace(settled=_with(self.lanes.settled, at, True))
        for i in at:
            if square[i] < 1e10 and (self.nearest is None or far[i] < self.nearest[0]):
                self.nearest = float(far[i]), x[i]
            # a violation of 1e-4 of the size is taken away by steps of second order
            if far[i] <= 1e-4 and np.isfinite(square[i]):
                self.found.append((float(square[i]), x[i]))


_KEPT = ("given", "live", "spent", "poor", "quiet", "last", "moving", "reached", "done", "broken", "unfit")


def _stack_rows(rows: Sequence[np.ndarray], n: int) -> np.ndarray:
    return np.stack(rows) if len(rows) else np.zeros((0, n))


def _with(old: np.ndarray, at: np.ndarray, new: ArrayLike) -> np.ndarray:
    out = old.copy()
    out[at] = new
    return out
