"""One tracker of solutions from one problem to another: many paths side by side, each with its own step.

Predicted by Padé approximants of power series and corrected by two of Newton's steps. What the equations are is the
problem's business, which gives Newton's steps and power series; the unknowns of a path are a column.

Source: P. Breiding and S. Timme, HomotopyContinuation.jl (2018), for Padé predictors in a tracker.
"""

import dataclasses
from typing import Any, Protocol

import numpy as np

FAR = 1e7
"""Beside unknowns of size one: a solution beyond is at infinity."""

_FLOOR = 1e-8  # relative size of a second correction that counts as rounding
_LEAST = 1e-10  # shortest step
_LONGEST = 0.2
_FIRST = 0.02
_NEXT = 1.0 - 1e-6
_NEAR, _LARGE, _GROWING = 0.9, 100.0, (0.1, 4.0)  # of paths that end at infinity: how far they got, size and growth


class Problem(Protocol):
    """Equations that change with a parameter from 0 to 1; `lanes` are the numbers of the paths that are asked about."""

    def correct(
        self, w: np.ndarray, at: np.ndarray, lanes: np.ndarray, keep: bool = True
    ) -> tuple[np.ndarray, Any, np.ndarray]:
        """Take one of Newton's steps: the result, the derivative used, the step's size beside the unknowns.

        The derivative may be left out if it is not to be kept; indexing selects some of its lanes.
        """
        ...

    def series(self, w: np.ndarray, at: np.ndarray, lanes: np.ndarray, linear: Any) -> list[np.ndarray]:
        """First coefficients of the paths' power series, by the derivative at (or beside) their points."""
        ...

    def size(self, w: np.ndarray) -> np.ndarray:
        """How large the unknowns are that may go to infinity."""
        ...

    def growth(self, w: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """How fast they grow, in parts of their size."""
        ...


@dataclasses.dataclass(frozen=True)
class PathEnds:
    """Ends of paths."""

    w: np.ndarray  # unknowns at the end of each, (unknowns, paths)
    arrived: np.ndarray  # which ones got there
    at: np.ndarray  # how far the others got, 0 … 1
    size: np.ndarray  # of the unknowns there
    growth: np.ndarray  # power of 1 / (1 - at) with which the others grew there: some 1 / k on the way to infinity

    @property
    def at_infinity(self) -> np.ndarray:
        """Which of the others are on their way to infinity, unknowns beside one being large and growing."""
        growing = (self.growth > _GROWING[0]) & (self.growth < _GROWING[1])
        return ~self.arrived & (self.at > _NEAR) & (self.size > _LARGE) & growing

    @property
    def singular(self) -> np.ndarray:
        """Which of the others got next to a finite end, where paths meet or solutions are not isolated."""
        return ~self.arrived & (self.at > _NEXT) & (self.growth < _GROWING[0])


@dataclasses.dataclass(frozen=True)
class Pace:
    """How boldly steps are taken."""

    accuracy: float = 5e-5  # relative error of a prediction to aim for
    contraction: float = 0.002  # of the first correction: size of the second to aim for
    left: float = 1e-7  # largest relative second correction


USUAL, BOLD, CAREFUL = Pace(), Pace(2e-4, 0.02, 1e-5), Pace(2e-6, 0.001, 1e-8)
"""Paces of power series of fifth order; the last is for paths that were lost."""


def _predict(series: list[np.ndarray], h: np.ndarray) -> np.ndarray:
    """Changes over steps: power series whose last two terms go on like a geometric one, a Padé approximant."""
    *first, two, three = series
    down = 1.0 - np.where(np.isfinite(three / two), three / two, 0.0) * h
    out = np.where(np.abs(down) > 0.2, two / down, two + three * h) * h
    for term in first[::-1]:
        out = (term + out) * h
    return out


def follow(problem: Problem, w: np.ndarray, pace: Pace = USUAL, most: int = 3000) -> PathEnds:
    """Follow solutions ``(unknowns, paths)`` of a problem from 0 to 1.

    A pace of smaller numbers is safer and slower. What is under way after the `most` rounds is given up.
    """
    accuracy = pace.accuracy
    lanes = w.shape[1]
    out = PathEnds(np.array(w), np.zeros(lanes, bool), *np.zeros((3, lanes)))
    if not lanes:
        return out
    alive, at, h = np.arange(lanes), np.zeros(lanes), np.full(lanes, _FIRST)
    with np.errstate(all="ignore"):
        w, linear, _ = problem.correct(w, at, alive)
        series = problem.series(w, at, alive, linear)
        power = 1.0 / (1 + len(series))
        for _ in range(most):
            if not len(alive):
                break
            last = h >= (1.0 - at) * (1.0 - 1e-12)
            h = np.minimum(h, 1.0 - at)
            then = np.where(last, 1.0, at + h)
            trial, _, first = problem.correct(w + _predict(series, h), then, alive, keep=False)
            trial, linear, second = problem.correct(trial, then, alive)
            good = (first < 10 * accuracy) & (
                (second <= 10 * pace.contraction * first) & (second < pace.left) | (second < _FLOOR)
            )
            factor = np.clip((accuracy / np.maximum(first, 1e-16)) ** power, 0.2, 2.0)
            shrink = np.clip((pace.contraction * first / np.maximum(second, 1e-300)) ** power, 0.2, 2.0)
            factor = np.where(second > _FLOOR, np.minimum(factor, shrink), factor)
            h = np.minimum(h * np.where(good, factor, np.minimum(0.5, factor)), _LONGEST)
            if good.any():
                w[:, good], at[good] = trial[:, good], then[good]
                new = problem.series(w[:, good], at[good], alive[good], linear[good])
                for term, value in zip(series, new, strict=True):
                    term[:, good] = value
            done = good & last
            over = done | (h < _LEAST) | ~(problem.size(w) < 10 * FAR)
            if over.any():
                out.w[:, alive[over]], out.at[alive[over]] = w[:, over], at[over]
                out.arrived[alive[done]] = True
                out.growth[alive[over]] = problem.growth(w[:, over], series[0][:, over]) * (1.0 - at[over])
                stay = ~over
                alive, at, h = alive[stay], at[stay], h[stay]
                w, series = w[:, stay], [term[:, stay] for term in series]
    out.w[:, alive], out.at[alive] = w, at
    out.size[:] = problem.size(out.w)
    return out
