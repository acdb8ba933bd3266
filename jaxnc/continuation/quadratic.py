"""Square systems of second degree whose coefficients are polynomials in the path's parameter, as a tracker's problem.

A system of n equations in n unknowns is kept as ``Y' Q_r Y`` of ``Y = (1, y)``. Residuals, derivatives and power series
are products with one matrix for all paths: all of them are exact, since everything is of second degree.
"""

from math import comb

import numpy as np

_ORDER = 5  # of the power series
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
        self.stacked, self.rows = np.ascontiguousarray(stacked[:, some]), rows
        self.targets, self.each = targets, each

    def _apply(self, pairs: list[tuple[np.ndarray, np.ndarray]], lanes: np.ndarray) -> np.ndarray:
        """Multiply a sum of powers ``(lanes, powers)`` times unknowns ``(lanes, 1 + n)`` into the coefficients.

        Returns ``(lanes, equations, 1 + n)``.
        """
        flat = sum(weights[:, self.power] * y[:, self.place] for weights, y in pairs)
        if self.targets == 1:
            out = flat @ self.stacked[0]
        else:
            # Paths to one target are multiplied together; there are as many to each, some of them over.
            targets, at = np.unique(lanes // self.each, return_inverse=True)
            beside = lanes % self.each
            padded = np.zeros((len(targets), self.each, flat.shape[1]), complex)
            padded[at, beside] = flat
            out = np.matmul(padded, self.stacked[targets])[at, beside]
        return out.reshape(len(flat), self.rows, self.n + 1)

    def _weights(self, at: np.ndarray, order: int) -> list[np.ndarray]:
        """Series coefficients of the powers of the parameter about `at`, each ``(lanes, powers)``."""
        k = np.arange(self.degree)
        out = []
        for m in range(order + 1):
            factors = np.array([comb(j, m) for j in k], float)
            out.append(factors * at[:, None] ** np.maximum(k - m, 0))
        return out

    def evaluate(self, w: np.ndarray, at: np.ndarray, lanes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals ``(lanes, equations)`` and Jacobians ``(lanes, equations, n)``."""
        y = np.concatenate([np.ones((1, w.shape[1])), w]).T
        (weights,) = self._weights(at, 0)
        g = self._apply([(weights, y)], lanes)
        return np.matmul(g, y[:, :, None])[:, :, 0], 2.0 * g[:, :, 1:]

    def correct(self, w: np.ndarray, at: np.ndarray, lanes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Take one of Newton's steps; see `jaxnc.continuation.tracker.Problem`."""
        f, jacobian = self.evaluate(w, at, lanes)
        inverse = inverses(jacobian)
        step = -np.matmul(inverse, f[:, :, None])[:, :, 0].T
        size = np.abs(step).max(axis=0) / (1e-3 + np.abs(w).max(axis=0))
        return w + step, inverse, np.where(np.isfinite(size), size, np.inf)

    def series(self, w: np.ndarray, at: np.ndarray, lanes: np.ndarray, linear: np.ndarray) -> list[np.ndarray]:
        """Find the power series; see `jaxnc.continuation.tracker.Problem`."""
        count = w.shape[1]
        weights = self._weights(at, _ORDER)
        terms = [np.concatenate([np.ones((1, count)), w]).T]
        inner: list[np.ndarray] = []  # Σ Q_l Y_j, order by order
        out = []
        for m in range(1, _ORDER + 1):
            g = self._apply([(weights[m - j], terms[j]) for j in range(m)], lanes)
            rest = np.matmul(g, terms[0][:, :, None])[:, :, 0]
            for j in range(1, m):
                rest = rest + np.matmul(inner[m - j - 1], terms[j][:, :, None])[:, :, 0]
            step = -np.matmul(linear, rest[:, :, None])[:, :, 0]
            out.append(step.T)
            if m < _ORDER:
                terms.append(np.concatenate([np.zeros((count, 1)), step], axis=1))
                inner.append(g + self._apply([(weights[0], terms[m])], lanes))
        return out

    def select(self, linear: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Select lanes of a derivative."""
        return linear[which]

    def size(self, w: np.ndarray) -> np.ndarray:
        """Largest unknown of each path."""
        return np.abs(w).max(axis=0, initial=0.0)


def inverses(lanes: np.ndarray) -> np.ndarray:
    """Inverse matrices ``(lanes, n, n)``; of what is singular to the last bit those of neighbours, or no numbers."""
    bad = ~np.isfinite(lanes).all(axis=(1, 2))
    if bad.any():
        lanes = np.where(bad[:, None, None], np.eye(lanes.shape[1]), lanes)
    try:
        return np.linalg.inv(lanes)
    except np.linalg.LinAlgError:
        n = lanes.shape[1]
        nudge = 1e-15 * np.abs(lanes).max(axis=(1, 2), keepdims=True) * np.vander(np.linspace(-1.0, 1.0, n))
        singular = np.linalg.det(lanes) == 0.0
        lanes = np.where(singular[:, None, None], lanes + nudge, lanes)
        some, found = np.linalg.det(lanes) != 0.0, np.full_like(lanes, np.nan)
        found[some] = np.linalg.inv(lanes[some])
        return found
