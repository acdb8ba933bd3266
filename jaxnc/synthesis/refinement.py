"""Refinement of many designs: lanes of constrained least squares, filled anew as they finish."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxnc.synthesis import levenberg
from jaxnc.synthesis.conditions import Links
from jaxnc.synthesis.ending import LANES, MEETS
from jaxnc.synthesis.evaluation import evaluated, leaves_of
from jaxnc.synthesis.problem import Problem

_ROUND = 20  # iterations between looks at them
_SUITING = 20  # iterations in which an idea gets what suits it
_HEAVY = 10.0  # weight of a condition's violation against an error
_IDLE = 1e-12  # derivatives that are nothing
_HOPELESS = 4  # rounds without getting anywhere after which a lane is given to another start
_LOST = 10  # rounds of it after which one that is behind, or does not meet its conditions, is given up
_STILL = 1e-8  # of the merit: a lane that has won less in a round stands still
ROUGH = 1e-2  # the same where designs are only sought, to be brought to their ends afterwards
LEVEL = 1e-6  # and where the largest error is made small, which goes on by ever less
_QUIET = 2  # rounds of standing still after which a lane that meets its conditions is done


class Refinement:
    """Starts that wait, lanes that are at work, and designs that came out of them.

    Attributes:
        problem: the problem.
        queue: starts that wait for a lane, each its unknowns and the problem's arguments, ``(n + g,)``.
        found: designs that meet the conditions: the sum of the squares of their divided errors, and the same of them.
        done: how many starts have been finished.
        nearest: how far the closest design is from meeting the conditions, and its unknowns.
        broken: gradients that were not finite although the design assembled.
        reached: whether any start reached all its targets.
        unfit: how many random designs could not be moved through their targets.
        spoilt: unknowns of a start that did so without errors, conditions and derivatives being finite.
    """

    def __init__(self, problem: Problem, iterations: int, designs: int = LANES, still: float = _STILL):
        """For so many designs at most, of more so many at once as there are lanes; a gain below `still` is none."""
        self.still = still
        self.problem, self.most, self.width = problem, iterations, min(designs, LANES)
        self.scale, self.leaves = problem.scale, leaves_of(problem)
        self.queue: list[np.ndarray] = []
        self.found: list[tuple[float, np.ndarray]] = []
        self.done = self.broken = self.unfit = 0
        self.lanes: levenberg.Lanes | None = None
        self.given = np.repeat(problem.defaults[None], self.width, axis=0)
        self.live = np.zeros(self.width, dtype=bool)
        self.spent = np.zeros(self.width, dtype=int)
        self.poor = np.zeros(self.width, dtype=int)
        self.quiet = np.zeros(self.width, dtype=int)
        self.last = np.full(self.width, np.inf)
        self.nearest: tuple[float, np.ndarray] | None = None
        self.moving = np.zeros(problem.count, dtype=bool)
        self.reached = False
        self.spoilt: np.ndarray | None = None
        self.shape, self.equal = problem.shape, problem.equalities
        # Rows that tell whether an unknown changes anything; how long links are is of no matter by itself.
        core = problem.core
        own = np.repeat([not isinstance(c, Links) for c in core.conditions], core.counts)
        self.telling = np.ones(sum(self.shape), bool)
        self.telling[self.shape[0] : self.shape[0] + len(own)] = own

    def merits(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Starts with what is linear fitted, their errors and violations; infinite where a target is not reached."""
        moved, out = [], []
        for first in range(0, len(x), self.width):
            at, n = np.minimum(np.arange(first, first + self.width), len(x) - 1), self.problem.count
            unknowns, self.given = x[at, :n], x[at, n:]
            self.lanes = lanes = self._advanced(levenberg.waiting(unknowns / self.scale, *self.shape), 1)
            square, far = self._state()
            good = square < 1e10
            if self.spoilt is None and lanes.broken.any():
                self.spoilt = unknowns[np.argmax(lanes.broken)]
            new, errors = self.problem.fitted(unknowns, lanes.errors)
            moved.append(np.concatenate([np.where(good[:, None], new, unknowns), self.given], axis=1))
            square = np.sum(errors**2, axis=1)
            self.reached = self.reached or bool(good.any())
            self.moving |= np.any(np.abs(lanes.slopes[good][:, self.telling]) > _IDLE, axis=(0, 1))
            out.append(np.where(good, square + _HEAVY * far**2, np.inf))
        self.lanes = None
        return np.concatenate(moved)[: len(x)], np.concatenate(out)[: len(x)]

    def suited(self, x: np.ndarray, held: int) -> np.ndarray:
        """Starts whose first unknowns stay and whose others are made the best; one that meets conditions is found."""
        n, some = self.problem.count, x[: self.width]
        at = np.minimum(np.arange(self.width), len(some) - 1)
        start, self.given = some[at, :n] / self.scale, some[at, n:]
        low, high = (np.repeat((v / self.scale)[None], len(at), axis=0) for v in (self.problem.low, self.problem.high))
        low[:, :held] = high[:, :held] = start[:, :held]
        waiting = levenberg.waiting(start, *self.shape)._replace(settled=np.arange(len(at)) >= len(some))
        self.lanes = lanes = self._advanced(waiting, _SUITING if held < n else 1, (low, high))
        square, far = self._state()
        rows = np.concatenate([lanes.x * self.scale, self.given], axis=1)[: len(some)]
        rows[:, :held] = some[:, :held]
        good = np.flatnonzero((far <= MEETS) & (square < 1e10))
        if len(good):
            best = good[np.argmin(square[good])]
            self.found.append((float(square[best]), rows[best]))
        self.lanes = None
        return rows

    @property
    def idle(self) -> list[str]:
        """Unknowns that change nothing in any of the starts."""
        return [n for n, m in zip(self.problem.names, self.moving, strict=True) if not m] if self.reached else []

    @property
    def best(self) -> float:
        """The least square of a design that meets the conditions, finished or not."""
        out = min((e for e, _ in self.found), default=np.inf)
        if self.lanes is None:
            return out
        square, far = self._state()
        return float(np.min(square[self.live & (far <= MEETS)], initial=out))

    @property
    def busy(self) -> bool:
        """Whether there is anything left to do."""
        return bool(self.live.any() or self.queue)

    def more(self) -> bool:
        """Give free lanes to the next starts; False when there is nothing left to do."""
        free = np.flatnonzero(~self.live)
        some, self.queue = self.queue[: len(free)], self.queue[len(free) :]
        if self.lanes is None:
            x = np.broadcast_to(self.problem.start / self.scale, (self.width, self.problem.count))
            self.lanes = levenberg.waiting(x, *self.shape)._replace(settled=np.ones(self.width, bool))
        if some:
            at = free[: len(some)]
            n, rows = self.problem.count, np.stack(some)
            fresh = levenberg.waiting(rows[:, :n] / self.scale, *self.shape)
            self.given = _with(self.given, at, rows[:, n:])
            self.lanes = levenberg.Lanes(*(_with(a, at, b) for a, b in zip(self.lanes, fresh, strict=True)))
            self.live[at], self.spent[at], self.poor[at], self.quiet[at], self.last[at] = True, 0, 0, 0, np.inf
        return bool(self.live.any())

    def go(self, best: float) -> None:
        """Take a round of iterations, and take out lanes that have nothing left to do.

        While others wait, lanes without prospect of the least square so far (`best`) are taken out too.
        """
        assert self.lanes is not None
        self.lanes = lanes = self._advanced(self.lanes, _ROUND)
        self.spent[self.live] += _ROUND
        square, far = self._state()
        merit = square + far
        self.poor = np.where(merit < 0.9 * self.last, 0, self.poor + 1)
        still = (far <= MEETS) & (np.abs(merit - self.last) <= self.still * merit)
        self.quiet = np.where(still, self.quiet + 1, 0)
        self.last = np.minimum(self.last, merit)
        over = lanes.settled | (self.spent >= self.most) | (self.quiet >= _QUIET)
        over = over | (self.poor >= _LOST) & ((merit > 2.0 * min(best, self.best)) | (far > MEETS))
        if self.queue:
            over = over | (self.poor >= _HOPELESS) & (merit > 2.0 * best)
        self._take_out(self.live & over)

    def stop(self) -> None:
        """Take out all lanes as they are."""
        if self.lanes is not None:
            self._take_out(self.live.copy())

    def run(self) -> list[tuple[float, np.ndarray]]:
        """Go on until nothing is left to do; the designs, best first."""
        while self.more():
            self.go(np.inf)
        return sorted(self.found, key=lambda pair: pair[0])

    # -- keeping -------------------------------------------------------------------------------------------------

    def saved(self) -> dict[str, np.ndarray]:
        """Everything that decides how it goes on, as arrays by name."""
        assert self.lanes is not None
        far, x = self.nearest or (np.inf, np.zeros(0))
        n = len(self.problem.row)
        own = {name: np.asarray(getattr(self, name)) for name in _KEPT}
        own |= {f"lanes.{name}": value for name, value in self.lanes._asdict().items()}
        own |= {"queue": _stacked(self.queue, n), "found": _stacked([x for _, x in self.found], n)}
        return own | {"errors": np.array([e for e, _ in self.found]), "nearest.x": x, "nearest": np.array(far)}

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Go back to what `saved` returned."""
        for name in _KEPT:
            value = arrays[name]
            setattr(self, name, value.copy() if value.ndim else value.item())
        self.lanes = levenberg.Lanes(**{n: arrays[f"lanes.{n}"] for n in levenberg.Lanes._fields})
        self.queue = list(arrays["queue"])
        self.found = list(zip(arrays["errors"].tolist(), arrays["found"], strict=True))
        x = arrays["nearest.x"]
        self.nearest = (float(arrays["nearest"]), x) if len(x) else None

    # -- inside --------------------------------------------------------------------------------------------------

    def _advanced(self, lanes: levenberg.Lanes, count: int, bounds: Any = None) -> levenberg.Lanes:
        """So many iterations; within bounds of their own, in their scales."""
        problem, scale = self.problem, self.scale

        def evaluate(x: np.ndarray, live: np.ndarray) -> levenberg.Evaluated:
            return evaluated(problem, self.leaves, x * scale, self.given, scale, live)

        low, high = bounds or (problem.low / scale, problem.high / scale)
        return levenberg.advance(evaluate, lanes, self.equal, low, high, count)

    def _state(self) -> tuple[np.ndarray, np.ndarray]:
        """Squares of the errors and violations."""
        assert self.lanes is not None
        far = levenberg.violation(self.lanes.conditions, self.equal)
        return np.sum(self.lanes.errors**2, axis=1), np.max(far, axis=1, initial=0.0)

    def _take_out(self, over: np.ndarray) -> None:
        assert self.lanes is not None
        at = np.flatnonzero(over)
        square, far = self._state()
        x = np.concatenate([self.lanes.x * self.scale, self.given], axis=1)
        self.live[at] = False
        self.done += len(at)
        self.broken += int(self.lanes.broken[at].sum())
        self.lanes = self.lanes._replace(settled=_with(self.lanes.settled, at, True))
        for i in at:
            if square[i] < 1e10 and (self.nearest is None or far[i] < self.nearest[0]):
                self.nearest = float(far[i]), x[i]
            if far[i] <= MEETS and np.isfinite(square[i]):
                self.found.append((float(square[i]), x[i]))


_KEPT = ("given", "live", "spent", "poor", "quiet", "last", "moving", "reached", "done", "broken", "unfit")


def _stacked(rows: Sequence[np.ndarray], n: int) -> np.ndarray:
    return np.stack(rows) if len(rows) else np.zeros((0, n))


def _with(old: np.ndarray, at: np.ndarray, new: Any) -> np.ndarray:
    out = old.copy()
    out[at] = new
    return out
