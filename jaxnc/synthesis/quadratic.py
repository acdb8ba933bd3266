"""Convex quadratic programs of a few unknowns, and multipliers, by nonnegative least squares.

Source: C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974, chapter 23 (least distance programming).
"""

import numpy as np

_NONE = 1e-13  # of the right side: what is left of a program that no point is feasible for


def nonnegative(matrix: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    """The x ≥ 0 with the least ``‖matrix x − right‖``; None where it was not found.

    The matrix is ``(m, n)``.
    """
    from scipy.optimize import nnls

    if not matrix.shape[1]:
        return np.zeros(0)
    try:
        return nnls(matrix, right, maxiter=20 * (matrix.shape[1] + 10))[0]
    except (RuntimeError, ValueError):  # it goes round in circles, or something is not finite
        return None


def least(
    factor: np.ndarray, errors: np.ndarray, rows: np.ndarray, right: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """The d with the least ``½ ‖factor d + errors‖²`` of those with ``rows d ≥ right``, and multipliers, or None.

    The factor is upper triangular, ``(n, n)``; the rows are ``(k, n)``.
    """
    try:
        across = np.linalg.solve(factor.T, rows.T).T
    except np.linalg.LinAlgError:
        return None
    sizes = np.linalg.norm(across, axis=1)
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    across, level = across / sizes[:, None], (right + across @ errors) / sizes
    far = float(np.max(level, initial=0.0))
    if not np.isfinite(far):
        return None
    if far <= 0.0:
        return np.linalg.solve(factor, -errors), np.zeros(len(right))
    u = nonnegative(np.concatenate([across.T, level[None] / far]), np.append(np.zeros(len(errors)), 1.0))
    if u is None:
        return None
    left = 1.0 - float(level @ u) / far
    if left <= _NONE:
        return None
    u = u * (far / left)
    return np.linalg.solve(factor, across.T @ u - errors), u / sizes
