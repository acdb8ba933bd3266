"""One tracker of solutions from one problem to another: many paths side by side, each with its own step.

Predicted by Padé approximants of power series and corrected by two of Newton's steps. What the equations are is the
problem's business, which gives Newton's steps and power series; the unknowns of a path are a column.

Source: P. Breiding and S. Timme, HomotopyContinuation.jl (2018), for Padé predictors in a tracker.

Square systems of second degree, whose coefficients are polynomials in the path's parameter, are one such problem. A
system of n equations in n unknowns is kept as ``Y' Q_r Y`` of ``Y = (1, y)``. Residuals, derivatives and power series
are products with one matrix for all paths: all of them are exact, since everything is of second degree.
"""

import dataclasses
from math import comb
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


# -- square systems of second degree -----------------------------------------------------------------------------------


_ORDER = 5  # of the power series
_DENSE = 0.8  # of all places: where more are filled, all are multiplied
FIT = 1e-12  # of the largest coefficient: a power of the path's parameter that counts less is none


def fit_powers(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Coefficients of polynomials from their values ``(..., samples)`` at so many roots of unity, ``(powers, ...)``."""
    count = len(at)
    inverse = np.conj(at[:, None] ** np.arange(count)) / count
    found = np.moveaxis(values @ inverse, -1, 0)
    size = np.abs(found).reshape(count, -1).max(axis=1)
    degree = int(np.flatnonzero(size > FIT * size.max())[-1]) if size.any() else 0
    return found[: degree + 1]


class QuadraticPaths:
    """Paths of systems of second degree from 0 to 1, of one target or of several.

    The unknowns of a path are Y in a patch, ``patch Y = 1``: no path gets lost because it passes near infinity.

    `powers` are the coefficients, ``(targets, powers, equations, 1 + n, 1 + n)`` with symmetric last axes. Paths are
    numbered target by target, `each` of them to one.
    """

    def __init__(self, powers: np.ndarray, each: int = 1):
        targets, self.degree, rows, wide, _ = powers.shape
        self.n = wide - 1
        # (targets, powers · (1 + n), equations · (1 + n))
        stacked = np.moveaxis(powers, 3, 2).reshape(targets, self.degree * wide, rows * wide)
        some = np.flatnonzero(stacked.any(axis=(0, 2)))  # powers and unknowns that any coefficient goes with
        self.power, self.place = some // wide, some % wide
        self.filled = np.flatnonzero(stacked.any(axis=(0, 1)))  # rows and unknowns that any coefficient stands at
        if len(self.filled) > _DENSE * stacked.shape[2]:
            self.filled = np.arange(stacked.shape[2])
        self.stacked, self.rows = np.ascontiguousarray(stacked[:, some][:, :, self.filled]), rows
        # Products of two unknowns that any coefficient goes with, each written once.
        i, j = np.triu_indices(wide)
        both = np.where(i == j, 1.0, 2.0) * powers[:, :, :, i, j]
        some = np.flatnonzero(both.any(axis=(0, 1, 2)))
        self.left, self.right = i[some], j[some]
        # (targets, powers · products, equations)
        self.products = np.swapaxes(both[..., some], 2, 3).reshape(targets, self.degree * len(some), rows)
        self.targets, self.each = targets, each
        self.binomials = np.array([[comb(k, m) for k in range(self.degree)] for m in range(_ORDER + 1)], float)
        rng = np.random.default_rng(self.n)
        self.patch = np.exp(2j * np.pi * rng.random(wide)) / np.sqrt(wide)

    def _apply(self, flat: np.ndarray, lanes: np.ndarray) -> np.ndarray:
        """Multiply powers times unknowns, those that `power` and `place` name ``(lanes, …)``, into the coefficients.

        Returns ``(lanes, equations, 1 + n)``.
        """
        out = self._times(flat, lanes, self.stacked)
        if len(self.filled) < self.rows * (self.n + 1):
            every = np.zeros((len(flat), self.rows * (self.n + 1)), complex)
            every[:, self.filled] = out
            out = every
        return out.reshape(len(flat), self.rows, self.n + 1)

    def _multiply(self, y: np.ndarray, at: np.ndarray, lanes: np.ndarray) -> np.ndarray:
        """The matrix of every equation times the unknowns, ``(lanes, equations, 1 + n)``; twice that is its slope."""
        return self._apply(self._weights(at, 0)[0].T[:, self.power] * y[:, self.place], lanes)

    def _times(self, flat: np.ndarray, lanes: np.ndarray, matrices: np.ndarray) -> np.ndarray:
        """Multiply rows ``(lanes, …)`` by the matrices of their targets ``(targets, …, columns)``."""
        if self.targets == 1:
            return flat @ matrices[0]
        # Paths to one target are multiplied together; there are as many to each, some of them over.
        targets, at = np.unique(lanes // self.each, return_inverse=True)
        beside = lanes % self.each
        padded = np.zeros((len(targets), self.each, flat.shape[1]), complex)
        padded[at, beside] = flat
        return np.matmul(padded, matrices[targets])[at, beside]

    def _weights(self, at: np.ndarray, order: int) -> np.ndarray:
        """Series coefficients of the powers of the parameter about `at`, ``(order + 1, powers, lanes)``."""
        left = np.maximum(np.arange(self.degree) - np.arange(order + 1)[:, None], 0)
        return self.binomials[: order + 1, :, None] * (at ** np.arange(self.degree)[:, None])[left]

    def follow(self, w: np.ndarray, pace: Pace) -> PathEnds:
        """Follow solutions ``(n, paths)`` from 0 to 1."""
        y = np.concatenate([np.ones((1, w.shape[1])), w])
        with np.errstate(all="ignore"):
            ends = follow(self, y / (self.patch @ y), pace)
            return dataclasses.replace(ends, w=ends.w[1:] / ends.w[0])

    def evaluate(self, w: np.ndarray, at: np.ndarray, lanes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals ``(lanes, n)`` and Jacobians ``(lanes, n, n)`` at solutions ``(n, lanes)``."""
        y = np.concatenate([np.ones((1, w.shape[1])), w]).T
        g = self._multiply(y, at, lanes)
        return np.matmul(g, y[:, :, None])[:, :, 0], 2.0 * g[:, :, 1:]

    def correct(
        self, w: np.ndarray, at: np.ndarray, lanes: np.ndarray, keep: bool = True
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Take one of Newton's steps; see `jaxnc.continuation.tracker.Problem`."""
        y = w.T
        g = self._multiply(y, at, lanes)
        f = np.concatenate([np.matmul(g, y[:, :, None])[:, :, 0], (y @ self.patch - 1.0)[:, None]], axis=1)
        patch = np.broadcast_to(self.patch, (len(y), 1, self.n + 1))
        matrix = np.concatenate([2.0 * g, patch], axis=1)
        if keep:
            matrix = inverses(matrix)
            step = -np.matmul(matrix, f[:, :, None])[:, :, 0].T
        else:
            step = -_solve(matrix, f).T
        size = np.abs(step).max(axis=0) / np.abs(w).max(axis=0)
        return w + step, matrix, np.where(np.isfinite(size), size, np.inf)

    def series(self, w: np.ndarray, at: np.ndarray, lanes: np.ndarray, linear: np.ndarray) -> list[np.ndarray]:
        """Find the power series; see `jaxnc.continuation.tracker.Problem`."""
        weights = self._weights(at, min(_ORDER, self.degree - 1))  # of no more orders than there are powers
        known: Any = 0.0  # what of an order's products the lower ones say
        terms, left, right, series = [w], [], [], []
        for m in range(_ORDER):
            left.append(terms[m][self.left])
            right.append(terms[m][self.right])
            series.append(known + left[0] * right[m] + left[m] * right[0] if m else left[0] * right[0])
            known = sum(left[j] * right[m + 1 - j] for j in range(1, m + 1))
            flat = weights[0][:, None] * known if m else np.zeros((self.degree, *series[0].shape), complex)
            for shift in range(1, min(m + 1, self.degree - 1) + 1):
                flat[shift:] += weights[shift, shift:, None] * series[m + 1 - shift]
            flat = flat.reshape(self.products.shape[1], len(at))
            rest = self._times(flat.T, lanes, self.products)
            terms.append(-np.matmul(linear[:, :, : self.n], rest[:, :, None])[:, :, 0].T)
        return terms[1:]

    def size(self, w: np.ndarray) -> np.ndarray:
        """Largest unknown of each path."""
        return np.abs(w[1:]).max(axis=0, initial=0.0) / np.abs(w[0])

    def growth(self, w: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """How fast each path goes to infinity, in parts of its size."""
        return np.abs(rate[0] / w[0])


def _solve(lanes: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions of systems ``(lanes, n, n)``, right-hand sides ``(lanes, n)``."""
    try:
        return np.linalg.solve(lanes, right[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        return np.matmul(inverses(lanes), right[:, :, None])[:, :, 0]


def inverses(lanes: np.ndarray) -> np.ndarray:
    """Inverse matrices ``(lanes, n, n)``; of what is singular to the last bit those of neighbours, or no numbers."""
    bad: Any = ~np.isfinite(lanes).all(axis=(1, 2))
    if bad.any():
        lanes = np.where(bad[:, None, None], np.eye(lanes.shape[1]), lanes)
    try:
        return np.linalg.inv(lanes)
    except np.linalg.LinAlgError:
        n = lanes.shape[1]
        nudge = 1e-15 * np.abs(lanes).max(axis=(1, 2), keepdims=True) * np.vander(np.linspace(-1.0, 1.0, n))
        singular = np.equal(np.linalg.det(lanes), 0.0)
        lanes = np.where(singular[:, None, None], lanes + nudge, lanes)
        some, found = np.not_equal(np.linalg.det(lanes), 0.0), np.full_like(lanes, np.nan)
        found[some] = np.linalg.inv(lanes[some])
        return found
