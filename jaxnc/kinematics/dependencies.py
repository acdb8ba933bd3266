"""Rows of a large mechanism that depend on each other, from the few combinations of rows that vanish."""

from typing import TYPE_CHECKING

import numpy as np

from jaxnc.solvers.rank import dependencies

if TYPE_CHECKING:
    import scipy.sparse as sp

_PART = 1e-6  # of the largest share of a row in a dependency: less is rounding


def dependent_rows(matrix: "sp.csc_matrix") -> tuple[list[int], list[int]]:
    """Rows that follow from the rows before them, and all rows that take part in a dependency.

    Args:
        matrix: the Jacobian, every coordinate a length, ``(rows, unknowns)``.

    Returns:
        Both lists of row numbers, ascending.
    """
    left = dependencies(matrix)
    share = np.abs(left).max(axis=1, initial=0.0)
    involved = np.flatnonzero(share > _PART)
    redundant = []
    while left.shape[1]:
        # The last row of a dependency follows from the others; what remains is free of that row.
        last = int(np.flatnonzero(np.linalg.norm(left, axis=1) > _PART)[-1])
        redundant.append(last)
        away = np.linalg.svd(left[last : last + 1], full_matrices=True)[2][1:]
        left = left @ away.T
    return sorted(redundant), involved.tolist()
