"""Rank of a large sparse matrix, by the few directions that it hardly stretches.

Inverse iteration on a block of directions, by sparse LU of [I A; Aᵀ -δ], leaves those of the smallest singular values.
Their number below a threshold is the nullity. Where a value lies so close to the threshold that the next digit of the
drawing would decide, that is said instead of a number.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import scipy.sparse as sp

RANK = 3e-7  # of the largest singular value, as for dense matrices: at a double root poses are known to 1e-8 only
_DOUBT = 10.0  # times smaller or larger than the threshold: too close to decide
_SHIFTS = (1e-9, 1e-8, 1e-7)  # of the largest singular value, squared: the first that keeps the factorisation regular
_ROUNDS = 8
_MOST = 400  # directions that are looked at; a mechanism with so many freedoms is none of the large ones meant here


@dataclass(frozen=True)
class Nullity:
    """The null space of a matrix."""

    count: int  # its dimension
    basis: np.ndarray  # orthonormal directions that span it, (columns, count)
    sure: bool  # whether no singular value is too close to the threshold
    smallest: np.ndarray  # the smallest singular values found, relative to the largest, ascending


def shape(matrix: "sp.csc_matrix") -> tuple[int, int]:
    """Rows and columns."""
    m, n = matrix.shape  # pyright: ignore[reportGeneralTypeIssues] (SciPy's own annotations forget it)
    return m, n


def sparse(data: np.ndarray, rows: np.ndarray, columns: np.ndarray, size: tuple[int, int]) -> "sp.csc_matrix":
    """A sparse matrix of a size by its numbers and their places."""
    from scipy.sparse import csc_matrix

    return csc_matrix((np.asarray(data), (rows, columns)), shape=size)


class Stretch:
    """A sparse matrix and solves with its damped normal equations."""

    def __init__(self, matrix: "sp.csc_matrix"):
        import scipy.sparse as sp
        from scipy.sparse.linalg import splu

        self.matrix = matrix
        m, n = shape(matrix)
        self.size = _largest(matrix)
        # Scaled like the matrix, the identity keeps small singular values from drowning in it.
        self.scale = self.size if self.size > 0 else 1.0
        for shift in _SHIFTS:
            damping = (shift * self.size) ** 2 / self.scale + 1e-300
            whole = sp.bmat(
                [[self.scale * sp.identity(m), matrix], [matrix.T, -damping * sp.identity(n)]], format="csc"
            )
            try:
                self.factors = splu(whole, permc_spec="COLAMD", panel_size=1, relax=1)
                return
            except RuntimeError:  # a pivot has cancelled to the last bit
                if shift == _SHIFTS[-1]:
                    raise

    def inverse(self, directions: np.ndarray) -> np.ndarray:
        """(AᵀA + δ)⁻¹ times directions ``(columns, k)``, but for a factor."""
        m = shape(self.matrix)[0]
        return self.factors.solve(np.concatenate([np.zeros((m, directions.shape[1])), directions]))[m:]

    def nullity(self) -> Nullity:
        """Find the null space."""
        n = shape(self.matrix)[1]
        rng = np.random.default_rng(11)
        width = min(n, 8)
        x = np.linalg.qr(rng.standard_normal((n, width)))[0]
        while True:
            values = np.zeros(0)
            for _ in range(_ROUNDS):
                y = self.inverse(x)
                x = np.linalg.qr(y / np.maximum(np.abs(y).max(axis=0), 1e-300))[0]
                _, values, turn = np.linalg.svd(self.matrix @ x, full_matrices=False)
                x = x @ turn.T
            smallest = np.zeros(width)  # with fewer rows than directions the rest is not stretched at all
            smallest[width - len(values) :] = values[::-1] / max(self.size, 1e-300)
            count = int(np.sum(smallest < RANK))
            if count < width or width == n or width >= _MOST:
                break
            grown = min(n, 4 * width)
            x = np.linalg.qr(np.concatenate([x, rng.standard_normal((n, grown - width))], axis=1))[0]
            width = grown
        doubtful = (smallest > RANK / _DOUBT) & (smallest < RANK * _DOUBT)
        sure = not doubtful.any() and (count < width or width == n)
        return Nullity(count, x[:, ::-1][:, :count], sure, smallest)


def _largest(matrix: "sp.csc_matrix") -> float:
    """The largest singular value, to a per cent."""
    x = np.random.default_rng(2).standard_normal(shape(matrix)[1])
    size = 0.0
    for _ in range(40):
        norm = np.linalg.norm(x)
        if norm == 0:
            break
        y = matrix @ (x / norm)
        size, x = float(np.linalg.norm(y)), matrix.T @ y
    return size


def null_directions(matrix: "sp.csc_matrix") -> Nullity:
    """Directions that a matrix does not see; with fewer rows than columns, those of its transpose: dependent rows."""
    m, n = shape(matrix)
    if not min(m, n) or not matrix.nnz:
        return Nullity(min(m, n), np.eye(min(m, n)), True, np.zeros(min(m, n)))
    return Stretch(matrix if m >= n else matrix.T.tocsc()).nullity()


def dependencies(matrix: "sp.csc_matrix") -> np.ndarray:
    """Orthonormal combinations of rows that vanish, ``(rows, count)``."""
    if not shape(matrix)[0] or not matrix.nnz:
        return np.eye(shape(matrix)[0])
    return Stretch(matrix.T.tocsc()).nullity().basis


def projected(matrix: "sp.csc_matrix", direction: np.ndarray) -> np.ndarray:
    """The part of a direction ``(columns,)`` that a matrix does not see."""
    import scipy.sparse as sp
    from scipy.sparse.linalg import splu

    m, n = shape(matrix)
    size = max(_largest(matrix), 1e-300)
    whole = sp.bmat([[sp.identity(n), matrix.T / size], [matrix / size, -1e-14 * sp.identity(m)]], format="csc")
    factors = splu(whole, permc_spec="COLAMD", panel_size=1, relax=1)
    x = factors.solve(np.concatenate([direction, np.zeros(m)]))[:n]
    return factors.solve(np.concatenate([x, np.zeros(m)]))[:n]
