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
_NEAR, _LARGE, _GROWING = 0.99, 100.0, 0.1  # of paths that end at infinity: how far they got, their size and growth


class Problem(Protocol):
    """Equations that change with a parameter from 0 to 1; `lanes` are the numbers of the paths that are asked about."""

    def correct(self, w: np.ndarray, at: np.ndarray, lanes: np.ndarray) -> tuple[np.ndarray, Any, np.ndarray]:
        """Take one of Newton's steps: the result, the derivative used, the step's size beside the unknowns."""
        ...

    def series(self, w: np.ndarray, at: np.ndarray, lanes: np.ndarray, linear: Any) -> list[np.ndarray]:
        """Coefficients one to three of the paths' power series, by the derivative at (or beside) their points."""
        ...

    def select(self, linear: Any, which: np.ndarray) -> Any:
        """Select lanes of a derivative."""
        ...

    def size(self, w: np.ndarray) -> np.ndarray:
        """How large the unknowns are that may go to infinity."""
        ...


@dataclasses.dataclass(frozen=True)
class PathEnds:
    """Ends of paths."""

    w: np.ndarray  # unknowns at the end of each, (unknowns, paths)
    arrived: np.ndarray  # which ones got there
    at: np.ndarray  # how far the others got, 0 … 1
    growth: np.ndarray  # power of 1 / (1 - at) with which the others grew there: some 1 / k on the way to infinity

    @property
    def at_infinity(self) -> np.ndarray:
        """Which of the others are on their way to infinity, unknowns beside one being large and growing."""
        near, large = self.at > _NEAR, np.abs(self.w).max(axis=0, initial=0.0) > _LARGE
        return ~self.arrived & near & large & (self.growth > _GROWING)


def follow(problem: Problem, w: np.ndarray, accuracy: float = 5e-5, most: int = 3000) -> PathEnds:
    """Follow solutions ``(unknowns, paths)`` of a problem from 0 to 1.

    A smaller `accuracy`, the relative error of a prediction to aim for, is safer and slower. What is under way after
    the `most` rounds is given up.
    """
    lanes = w.shape[1]
    out = PathEnds(np.array(w), np.zeros(lanes, bool), np.zeros(lanes), np.zeros(lanes))
    if not lanes:
        return out
    alive, at, h = np.arange(lanes), np.zeros(lanes), np.full(lanes, _FIRST)
    with np.errstate(all="ignore"):
        w, linear, _ = problem.correct(w, at, alive)
        one, two, three = problem.series(w, at, alive, linear)
        for _ in range(most):
            if not len(alive):
                break
            last = h >= (1.0 - at) * (1.0 - 1e-12)
            h = np.minimum(h, 1.0 - at)
            then = np.where(last, 1.0, at + h)
            down = 1.0 - np.where(np.isfinite(three / two), three / two, 0.0) * h
            bend = np.where(np.abs(down) > 0.2, two / down, two + three * h)
            trial, _, first = problem.correct(w + (one + bend * h) * h, then, alive)
            trial, linear, second = problem.correct(trial, then, alive)
            good = (first < 10 * accuracy) & ((second <= 0.02 * first) & (second < 1e-7) | (second < _FLOOR))
            factor = np.clip((accuracy / np.maximum(first, 1e-16)) ** 0.25, 0.2, 2.0)
            shrink = np.clip((0.002 * first / np.maximum(second, 1e-300)) ** 0.25, 0.2, 2.0)
            factor = np.where(second > _FLOOR, np.minimum(factor, shrink), factor)
            h = np.minimum(h * np.where(good, factor, np.minimum(0.5, factor)), _LONGEST)
            if good.any():
                w[:, good], at[good] = trial[:, good], then[good]
                new = problem.series(w[:, good], at[good], alive[good], problem.select(linear, good))
                for series, value in zip((one, two, three), new, strict=True):
                    series[:, good] = value
            done = good & last
            over = done | (h < _LEAST) | ~(problem.size(w) < 10 * FAR)
            if over.any():
                out.w[:, alive[over]], out.at[alive[over]] = w[:, over], at[over]
                out.arrived[alive[done]] = True
                out.growth[alive[over]] = problem.size(one[:, over]) * (1.0 - at[over]) / problem.size(w[:, over])
                stay = ~over
                alive, at, h = alive[stay], at[stay], h[stay]
                w, one, two, three = (value[:, stay] for value in (w, one, two, three))
    out.w[:, alive], out.at[alive] = w, at
    return out
