"""Poses that meet the constraints or come closest to it, on the host: nothing is compiled for them."""

from typing import Any, NamedTuple

import numpy as np

from jaxnc.solvers.host.view import HostView, largest


class Closest(NamedTuple):
    """Poses that meet the constraints, or come closest to it: one for JAX, on the host lanes as last axis."""

    q: Any  # the pose, (N,), or the poses, (N, lanes)
    gap: Any  # the largest residual, a length
    # Derivatives of the rows with respect to the unknowns there, every coordinate a length, (m, n), or (lanes, m, n);
    # of a large system the non-zeros. Nothing, or None, in traced code that leaves it to the host.
    jacobian: Any


def closest(view: HostView, q: np.ndarray, iterations: int = 200) -> Closest:
    """Levenberg-Marquardt on the unknowns of a plan, in every lane by itself.

    Freedoms may be left: then poses move as little as possible. Known coordinates of the start poses ``(N, lanes)`` are
    at their values.
    """
    plan, least, lanes = view.plan, view.least, q.shape[1]
    length = np.broadcast_to(view.eq.length, lanes)
    floor = 2.5 * least.floor * (length + view.extent(q))
    q, gap, slope = np.array(q), np.full(lanes, np.inf), np.zeros((lanes, *view.shape), q.dtype)
    rows, trial, going = np.zeros((len(plan.rows), lanes), q.dtype), np.array(q), np.arange(lanes)
    damping, cost, moved = np.full(lanes, 1e-2), np.full(lanes, np.inf), np.ones(lanes)
    for i in range(iterations):
        here = view.taken(going)
        new = here.residual(trial)
        size = np.einsum("ml,ml->l", new, new)
        better = size < cost[going]
        damping[going] = np.where(
            better, np.maximum(0.1 * damping[going], least.damping), (10.0 if i else 1.0) * damping[going]
        )
        moved[going] = 1.0
        at, trial = going[better], trial[:, better]
        if len(at):
            here = view.taken(at)
            if i:
                change = here.weights * (trial - q[:, at])
                moved[at] = np.sqrt(np.einsum("nl,nl->l", change, change)) / length[at]
            q[:, at], cost[at], gap[at], rows[:, at] = trial, size[better], largest(new[:, better]), new[:, better]
            slope[at] = here.lengths(here.matrices(trial)[0])
        on = (gap[going] > floor[going]) & (damping[going] < 1e8) & (moved[going] > 2.5 * least.floor)
        going = going[on & np.isfinite(cost[going])]
        if not len(going):
            break
        here = view.taken(going)
        step = here.damped(slope[going], rows[:, going], damping[going]) / here.inner.reshape(-1, len(plan.unknown))
        trial = q[:, going]
        trial[plan.unknown] -= np.where(np.isfinite(step).all(axis=1), step.T, 0.0)
    return Closest(q, gap, slope)
