"""Square systems of second degree whose coefficients are polynomials in the path's parameter, as a tracker's problem.

A system of n equations in n unknowns is kept as ``Y' Q_r Y`` of ``Y = (1, y)``. Residuals, derivatives and power series
are products with one matrix for all paths: all of them are exact, since everything is of second degree.
"""

import dataclasses
import functools
from math import comb
from typing import Any

import numpy as np

from jaxnc.continuation.tracker import Pace, PathEnds, follow

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
        self.targets, self.each = targets, each
        self.binomials = np.array([[comb(k, m) for k in range(self.degree)] for m in range(_ORDER + 1)], float)
        rng = np.random.default_rng(self.n)
        self.patch = np.exp(2j * np.pi * rng.random(wide)) / np.sqrt(wide)

    def _apply(self, flat: np.ndarray, lanes: np.ndarray) -> np.ndarray:
        """Multiply powers times unknowns, those that `power` and `place` name ``(lanes, …)``, into the coefficients.

        Returns ``(lanes, equations, 1 + n)``.
        """
        if self.targets == 1:
            out = flat @ self.stacked[0]
        else:
            # Paths to one target are multiplied together; there are as many to each, some of them over.
            targets, at = np.unique(lanes // self.each, return_inverse=True)
            beside = lanes % self.each
            padded = np.zeros((len(targets), self.each, flat.shape[1]), complex)
            padded[at, beside] = flat
            out = np.matmul(padded, self.stacked[targets])[at, beside]
        if len(self.filled) < self.rows * (self.n + 1):
            every = np.zeros((len(flat), self.rows * (self.n + 1)), complex)
            every[:, self.filled] = out
            out = every
        return out.reshape(len(flat), self.rows, self.n + 1)

    def _weights(self, at: np.ndarray, order: int) -> np.ndarray:
        """Series coefficients of the powers of the parameter about `at`, ``(order + 1, lanes, powers)``."""
        left = np.maximum(np.arange(self.degree) - np.arange(order + 1)[:, None, None], 0)
        return self.binomials[: order + 1, None] * at[:, None] ** left

    def follow(self, w: np.ndarray, pace: Pace) -> PathEnds:
        """Follow solutions ``(n, paths)`` from 0 to 1."""
        y = np.concatenate([np.ones((1, w.shape[1])), w])
        with np.errstate(all="ignore"):
            ends = follow(self, y / (self.patch @ y), pace)
            return dataclasses.replace(ends, w=ends.w[1:] / ends.w[0])

    def evaluate(self, w: np.ndarray, at: np.ndarray, lanes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals ``(lanes, n)`` and Jacobians ``(lanes, n, n)`` at solutions ``(n, lanes)``."""
        y = np.concatenate([np.ones((1, w.shape[1])), w]).T
        g = self._apply(self._weights(at, 0)[0][:, self.power] * y[:, self.place], lanes)
        return np.matmul(g, y[:, :, None])[:, :, 0], 2.0 * g[:, :, 1:]

    def correct(
        self, w: np.ndarray, at: np.ndarray, lanes: np.ndarray, keep: bool = True
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Take one of Newton's steps; see `jaxnc.continuation.tracker.Problem`."""
        y = w.T
        g = self._apply(self._weights(at, 0)[0][:, self.power] * y[:, self.place], lanes)
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
        weights, terms = self._weights(at, _ORDER)[..., self.power], [w.T]
        placed = [terms[0][:, self.place]]
        inner: list[np.ndarray] = []  # Σ Q_l Y_j, order by order
        for m in range(1, _ORDER + 1):
            g = self._apply(functools.reduce(np.add, (weights[m - j] * placed[j] for j in range(m))), lanes)
            rest = np.matmul(g, terms[0][:, :, None])[:, :, 0]
            for j in range(1, m):
                rest = rest + np.matmul(inner[m - j - 1], terms[j][:, :, None])[:, :, 0]
            terms.append(-np.matmul(linear[:, :, : self.n], rest[:, :, None])[:, :, 0])
            if m < _ORDER:
                placed.append(terms[m][:, self.place])
                inner.append(g + self._apply(weights[0] * placed[m], lanes))
        return [term.T for term in terms[1:]]

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
