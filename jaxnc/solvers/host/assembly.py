"""The start pose and the count of freedoms, on the host: nothing is compiled for them."""

from typing import NamedTuple

import numpy as np

from jaxnc.solvers.host.view import HostView


class Closest(NamedTuple):
    """A pose that meets the constraints, or comes closest to it.

    Attributes:
        q: the pose, ``(N,)``.
        gap: its largest residual, a length.
        jacobian: derivatives of the rows with respect to the unknowns there, every coordinate a length, ``(m, n)``.
    """

    q: np.ndarray
    gap: float
    jacobian: np.ndarray


def closest(view: HostView, q: np.ndarray, iterations: int = 200) -> Closest:
    """Levenberg-Marquardt on the unknowns of a plan: a pose that meets the constraints, or comes closest to it.

    Args:
        view: what is solved for; freedoms may be left, and then the pose moves as little as possible.
        q: start pose ``(N,)``, known coordinates at their values.
        iterations: the most trial steps.

    Returns:
        The pose.
    """
    plan, eq, least = view.plan, view.eq, view.least
    floor, n = 2.5 * least.floor * eq.length, len(plan.unknown)
    damping, cost, moved = 1e-2, np.inf, 1.0
    q = np.array(q)
    trial, gap, slope = q, np.inf, np.zeros((len(plan.rows), n), q.dtype)
    for i in range(iterations):
        new = view.residual(trial[:, None])[:, 0]
        size = float(new @ new)
        if size < cost:
            if i:
                moved = float(np.linalg.norm(eq.weights * (trial - q))) / eq.length
            q, r, cost, gap = trial, new, size, float(np.max(np.abs(new), initial=0.0))
            slope = view.matrices(q[:, None])[0][0] / view.inner
            damping = max(0.1 * damping, least.damping)
        else:
            moved, damping = 1.0, damping if i == 0 else 10.0 * damping
        if gap <= floor or damping >= 1e8 or moved <= 2.5 * least.floor or not np.isfinite(cost):
            break
        normal = slope.T @ slope
        normal[np.diag_indices(n)] += damping * np.trace(normal) / n + least.tiny
        try:
            step = np.linalg.solve(normal, slope.T @ r) / view.inner
        except np.linalg.LinAlgError:
            step = np.full(n, np.nan)
        trial = q.copy()
        if np.isfinite(step).all():
            trial[plan.unknown] -= step
    return Closest(q, gap, slope)
