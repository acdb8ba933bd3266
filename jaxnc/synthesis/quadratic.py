"""Convex quadratic programs of a few unknowns, and multipliers, by nonnegative least squares.

Source: C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974, chapter 23 (least distance programming).
"""

import numpy as np

_NONE = 1e-13  # of the right side: what is left of a program that no point is feasible for


def nonnegative(matrix: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    """The x ≥ 0 with the least ``‖matrix x − right‖``; None where it was not found.

    Args:
        matrix: ``(m, n)``.
        right: ``(m,)``.
    """
    from scipy.optimize import nnls

    if not matrix.shape[1]:
        return np.zeros(0)
    try:
        return nnls(matrix, right, maxiter=20 * (matrix.shape[1] + 10))[0]
    except (RuntimeError, ValueError):  # it goes round in circles, or something is not finite
        return None


def least(
    matrix: np.ndarray, gradient: np.ndarray, rows: np.ndarray, right: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """The d with the least ``gradient·d + ½ d·matrix d`` of those with ``rows d ≥ right``.

    Args:
        matrix: positive definite, ``(n, n)``.
        gradient: ``(n,)``.
        rows: ``(k, n)``.
        right: ``(k,)``.

    Returns:
        d and the multipliers of the rows, ``(k,)``; None if no d meets the rows, or none was found.
    """
    try:
        lower = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return None
    inner = np.linalg.solve(lower, np.concatenate([gradient[:, None], rows.T], axis=1))
    centre, across = inner[:, 0], inner[:, 1:].T
    sizes = np.linalg.norm(across, axis=1)
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    across, level = across / sizes[:, None], (right + across @ centre) / sizes
    far = float(np.max(level, initial=0.0))
    if far <= 0.0:
        return np.linalg.solve(lower.T, -centre), np.zeros(len(right))
    u = nonnegative(np.concatenate([across.T, level[None] / far]), np.append(np.zeros(len(gradient)), 1.0))
    if u is None:
        return None
    left = 1.0 - float(level @ u) / far
    if left <= _NONE:
        return None
    u = u * (far / left)
    return np.linalg.solve(lower.T, across.T @ u - centre), u / sizes
