"""A plan's rows and unknowns in NumPy, on lanes: residuals, Jacobians, steps, orientation."""

import functools
from typing import Any

import numpy as np

from jaxnc.solvers.plan import Plan
from jaxnc.system.host import HostEquations
from jaxnc.system.precision import limits


class HostView:
    """What is solved for, with the numbers of one design, or of a design for each lane.

    Poses are ``(N, lanes)``, rows ``(m, lanes)``; matrices have their lanes first, as NumPy's linear algebra wants it.

    Args:
        plan: the plan; not a large one.
        eq: the equations.

    Attributes:
        inner: factors that turn the unknowns into lengths, ``(n,)``, or ``(lanes, 1, n)``, as columns of matrices;
        weights, unknown_weights: of all coordinates and of the unknowns, ``(N or n, 1 or lanes)``.
    """

    def __init__(self, plan: Plan, eq: HostEquations):
        self.plan, self.eq = plan, eq
        self.least = limits(eq.home)
        weights = eq.weights
        self.weights = weights if weights.ndim == 2 else weights[:, None]
        self.unknown_weights = self.weights[plan.unknown]
        self.inner = weights[plan.unknown] if weights.ndim == 1 else self.unknown_weights.T[:, None, :]
        self._outer = self.inner[..., None] if weights.ndim == 1 else np.swapaxes(self.inner, 1, 2)
        # Logarithms of the largest determinants of the diagonal blocks that a design has met: what is small beside.
        blocks = sum(len(rows) for rows, _ in plan.blocks) if plan.square else 0
        self._greatest, self._design = np.full((blocks, eq.designs or 1), -np.inf), np.arange(eq.designs or 1)

    def taken(self, which: np.ndarray) -> "HostView":
        """The same for other lanes, given by places among these or a mask; one design that all lanes share stays."""
        if self.eq.designs is None:
            return self
        out = HostView(self.plan, self.eq.taken(which))
        out._greatest, out._design = self._greatest, self._design[which]
        return out

    @property
    def greatest(self) -> np.ndarray:
        """Logarithms of the largest determinants that each lane's design has met, ``(blocks, lanes)`` or 1."""
        return self._greatest[:, self._design]

    def met(self, sizes: np.ndarray, which: np.ndarray) -> None:
        """Note logarithms of determinants ``(blocks, lanes)`` that some of the lanes have met."""
        if self.eq.designs is None:
            np.maximum(self._greatest[:, 0], np.max(sizes[:, which], axis=1), out=self._greatest[:, 0])
        else:
            met: Any = np.maximum.at  # its stub knows no slices
            met(self._greatest, (slice(None), self._design[which]), sizes[:, which])

    @functools.cached_property
    def redundant(self) -> bool:
        """Whether there are more rows than unknowns."""
        return len(self.plan.rows) > len(self.plan.unknown)

    def residual(self, q: np.ndarray) -> np.ndarray:
        """Rows that are solved for, ``(m, lanes)``."""
        return self.eq.residual(q)[self.plan.rows]

    def tolerance(self, q: np.ndarray) -> np.ndarray:
        """Largest residual of a pose that counts as a solution, ``(lanes,)``."""
        return self.least.accept * self.eq.length + self.least.rounding * np.max(np.abs(q), axis=0, initial=0.0)

    def matrices(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the rows by unknown ``(lanes, m, n)`` and by known coordinates ``(lanes, m, k)``."""
        plan, entries = self.plan, self.eq.entries(q)
        padded = np.concatenate([entries, np.zeros((1, q.shape[1]), entries.dtype)])
        both = sum((padded[g] for g in plan.gathers[1:]), padded[plan.gathers[0]])
        both = np.moveaxis(both, 2, 0)
        n = len(plan.unknown)
        return np.ascontiguousarray(both[:, :, :n]), both[:, :, n:]

    def solve(self, matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Newton or Gauss-Newton steps ``(lanes, n, c)``, coordinates as lengths; not finite where singular."""
        if not matrix.shape[2]:
            return np.zeros((len(matrix), 0, right.shape[2]), matrix.dtype)
        return least_squares(matrix / self.inner, right) / self._outer

    def conditioning(self, matrix: np.ndarray) -> np.ndarray:
        """Estimate of the reciprocal condition number, coordinates as lengths; zero at a singular position."""
        if not matrix.shape[2]:
            return np.ones(len(matrix), matrix.dtype)
        triangle = np.linalg.qr(matrix / self.inner, mode="r")
        pivots = np.abs(np.diagonal(triangle, axis1=1, axis2=2))
        return pivots.min(axis=1) / np.maximum(pivots.max(axis=1), self.least.tiny)

    def orientation(self, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signs of the diagonal blocks' determinants, which a branch keeps, and logarithms of their sizes.

        Both ``(lanes, blocks)``; empty where there are more rows than unknowns, see `relative`.
        """
        signs, sizes = [], []
        for rows, columns in self.plan.blocks if self.plan.square else ():
            sub = matrix[:, rows[:, :, None], columns[:, None, :]]
            if rows.shape[1] == 1:
                value = sub[:, :, 0, 0]
            elif rows.shape[1] == 2:
                value = sub[:, :, 0, 0] * sub[:, :, 1, 1] - sub[:, :, 0, 1] * sub[:, :, 1, 0]
            else:
                sign, size = np.linalg.slogdet(sub)
                signs.append(sign)
                sizes.append(np.maximum(size, np.log(self.least.tiny)))
                continue
            signs.append(np.sign(value))
            sizes.append(np.log(np.maximum(np.abs(value), self.least.tiny)))
        if not signs:
            return np.zeros((len(matrix), 0)), np.zeros((len(matrix), 0))
        return np.concatenate(signs, axis=1), np.concatenate(sizes, axis=1)

    def relative(self, matrix: np.ndarray, other: np.ndarray) -> np.ndarray:
        """det(otherᵀ · matrix) as a part of det(otherᵀ · other), ``(lanes,)``: positive on the same branch."""
        back = np.swapaxes(other, 1, 2)
        sign, size = np.linalg.slogdet(back @ matrix)
        return sign * np.exp(size - np.linalg.slogdet(back @ other)[1])

    def joined(self, unknown: np.ndarray, known: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Poses with other unknown ``(n, lanes)`` and known ``(k, lanes)`` coordinates."""
        out = q.copy() if q.shape[1] == known.shape[1] else np.repeat(q, known.shape[1], axis=1)
        out[self.plan.unknown], out[self.plan.known] = unknown, known
        return out


def least_squares(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions ``(lanes, n, c)``, of all rows in the least-squares sense if they are more; not finite if singular."""
    if matrix.shape[1] > matrix.shape[2]:
        basis, triangle = np.linalg.qr(matrix)
        return _solved(triangle, np.swapaxes(basis, 1, 2) @ right)
    return _solved(matrix, right)


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:  # one of them is singular to the last bit
        out = np.full((len(matrix), matrix.shape[2], right.shape[2]), np.nan, matrix.dtype)
        regular = np.linalg.slogdet(matrix)[0] != 0.0
        out[regular] = np.linalg.solve(matrix[regular], right[regular])
        return out
