"""Newton for the row of four-bars with SciPy's sparse LU: what a careful user writes for one long mechanism."""

import dataclasses
import time

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

FIRST = (0.3, 1.0)  # the tip of the first crank from its foot, as drawn


@dataclasses.dataclass(frozen=True)
class Solved:
    """Tips ``(loops, 2)``, how many Newton steps it took, and the seconds of each."""

    tips: np.ndarray
    steps: int
    seconds_per_step: float


def solve(loops: int, phi: float) -> Solved:
    """Solve a row of `loops` loops for an angle of its first crank, from its drawing."""
    size = float(np.hypot(*FIRST))
    feet = np.stack([np.arange(1, loops + 1), np.zeros(loops)], axis=1)
    first = size * np.array([np.cos(phi), np.sin(phi)])
    tips = feet + np.array(FIRST)
    k = np.arange(loops)
    rows = np.concatenate([2 * k, 2 * k, 2 * k + 1, 2 * k + 1, 2 * k[1:] + 1, 2 * k[1:] + 1])
    columns = np.concatenate([2 * k, 2 * k + 1, 2 * k, 2 * k + 1, 2 * k[:-1], 2 * k[:-1] + 1])
    start = time.process_time()
    steps = 0
    while True:
        before = np.concatenate([first[None], tips[:-1]])
        crank, coupler = tips - feet, tips - before
        rest = np.stack([np.sum(crank**2, axis=1) - size**2, np.sum(coupler**2, axis=1) - 1.0], axis=1)
        if np.abs(rest).max() < 1e-12 or steps == 30:
            break
        steps += 1
        values = np.concatenate([2 * crank.T, 2 * coupler.T, -2 * coupler[1:].T], axis=None)
        jac = scipy.sparse.csc_matrix((values, (rows, columns)), shape=(2 * loops, 2 * loops))
        tips = tips - scipy.sparse.linalg.splu(jac).solve(rest.reshape(-1)).reshape(-1, 2)
    return Solved(tips, steps, (time.process_time() - start) / max(steps, 1))
