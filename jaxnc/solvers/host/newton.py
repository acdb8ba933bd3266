"""Newton in NumPy: poses that meet the constraints or come closest to it, and how solved poses change.

Poses change in time and with the design by the theorem of implicit functions. Nothing is compiled.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxnc.solvers.host.matrices import Near
from jaxnc.solvers.host.view import HostView, largest_of_lanes
from jaxnc.solvers.plan import Plan
from jaxnc.system.design import Drawn
from jaxnc.system.host import HostEquations

ITERATIONS = 8  # of Newton from a predicted pose, of which two are usual
SLOW = 0.5  # of a correction: so short the next one of Newton's must be, or it leads nowhere


class Closest(NamedTuple):
    """Poses that meet the constraints, or come closest to it: one for JAX, on the host lanes as last axis."""

    q: Any  # the pose, (N,), or the poses, (N, lanes)
    gap: Any  # the largest residual, a length
    # Derivatives of the rows with respect to the unknowns there, every coordinate a length, (m, n), or (lanes, m, n);
    # of a large system the non-zeros. Nothing, or None, in traced code that leaves it to the host.
    jacobian: Any


def closest(view: HostView, q: np.ndarray, iterations: int = 200) -> Closest:
    """Find the pose that meets the constraints or comes closest to it, lane by lane, by Levenberg and Marquardt.

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
        here = view.select(going)
        new = here.residual(trial)
        size = np.einsum("ml,ml->l", new, new)
        better = size < cost[going]
        damping[going] = np.where(
            better, np.maximum(0.1 * damping[going], least.damping), (10.0 if i else 1.0) * damping[going]
        )
        moved[going] = 1.0
        at, trial = going[better], trial[:, better]
        if len(at):
            here = view.select(at)
            if i:
                change = here.weights * (trial - q[:, at])
                moved[at] = np.sqrt(np.einsum("nl,nl->l", change, change)) / length[at]
            q[:, at], cost[at], gap[at], rows[:, at] = (
                trial,
                size[better],
                largest_of_lanes(new[:, better]),
                new[:, better],
            )
            slope[at] = here.lengths(here.matrices(trial)[0])
        on = (gap[going] > floor[going]) & (damping[going] < 1e8) & (moved[going] > 2.5 * least.floor)
        going = going[on & np.isfinite(cost[going])]
        if not len(going):
            break
        here = view.select(going)
        step = here.damped_step(slope[going], rows[:, going], damping[going]) / here.inner.reshape(
            -1, len(plan.unknown)
        )
        trial = q[:, going]
        trial[plan.unknown] -= np.where(np.isfinite(step).all(axis=1), step.T, 0.0)
    return Closest(q, gap, slope)


def correct_poses(view: HostView, q: np.ndarray, close: Near | None = None) -> np.ndarray:
    """Correct poses by Newton until its steps are rounding; by the inverses of what is `near` as long as these do."""
    if q.shape[1] > view.at_once:
        some = np.array_split(np.arange(q.shape[1]), -(-q.shape[1] // view.at_once))
        return np.concatenate([correct_poses(view.select(which), q[:, which]) for which in some], axis=1)
    if q.shape[1] == 1 and view.program is not None:
        found = view.program.correct(view.eq, q, view.unknown_weights, view.least.fine, ITERATIONS)
        if found is not None:
            return found
    if close is None:
        return _newton(view, q)
    at, before, done, inverse = np.array(q), None, np.zeros(q.shape[1], bool), close.interpolated
    for _ in range(ITERATIONS):
        step = (inverse @ view.residual(at).T[:, :, None])[:, :, 0].T
        at[view.plan.unknown] -= step / view.unknown_weights
        if done.all():  # that was the last one, to rounding
            break
        size = largest_of_lanes(step) / view.eq.length
        if before is not None:  # an error shrinks by one factor in every step
            done |= size * size <= 0.1 * view.least.accept * before
            if not np.any(done | (size <= SLOW * before)):
                break
        before = size
    rest = np.flatnonzero(~done)
    if len(rest):
        at[:, rest] = _newton(view.select(rest), q[:, rest])
    return at


def _newton(view: HostView, q: np.ndarray) -> np.ndarray:
    """Correct poses by their own matrices; short corrections go by the matrices of the one before."""
    unknown, at, going = view.plan.unknown, np.array(q), np.arange(q.shape[1])
    out, solve, before = at, None, np.zeros(0)
    for _ in range(ITERATIONS):
        if view.program is not None:
            step = view.program.run(("step",), view.eq, at)[0]
        else:
            again = solve is not None
            solve = solve or view.solver(at)
            step = solve(view.residual(at))
        step = np.where(np.isfinite(step), step, 0.0)
        at[unknown] -= step
        if at is not out:
            out[:, going] = at
        size = largest_of_lanes(step * view.unknown_weights) / view.eq.length
        # With old matrices an error shrinks by one factor in every step, with its own by ever smaller ones.
        on = size > view.least.fine
        if view.program is None and again:
            on = size * size > 0.1 * view.least.accept * before
        if not on.any():
            break
        before = size
        if solve is None or size.max() > 1e-3:  # after a correction of 1e-3 of the size, its matrices do for the next
            view, going, at, before, solve = view.select(on), going[on], at[:, on], size[on], None
    return out


def pose_rates(view: HostView, q: np.ndarray, known: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Differentiate solved poses once, twice, …: all coordinates, each ``(N, lanes)``; not finite if singular.

    `known` are those of the known coordinates, each ``(known, lanes)``.
    """
    plan, solve = view.plan, view.solver(q)
    found: list[np.ndarray] = []
    for values in known:
        # The highest derivative enters the differentiated rows linearly, with the Jacobian for its factor.
        term = np.zeros_like(q)
        term[plan.known] = values
        for _ in range(1 if view.refines else 2):
            term[plan.unknown] -= solve(view.eq.rates(q, [*found, term])[plan.rows])
        found.append(term)
    return found


def start_changes(
    plan: Plan, eq: HostEquations, drawn: Drawn, q: np.ndarray, still: Sequence[int] = ()
) -> np.ndarray | None:
    """Return an assembled start pose ``(N,)`` with its changes, ``(N, 1 + changes)``; None where they are not finite.

    Nothing is driven in the plan; see `jaxnc.solvers.newton.attach_start`, also for what is `still`.
    """
    at = drawn.home.copy()
    at[:, 0], put, weight = q, np.isin(plan.unknown, still), eq.weights[plan.unknown]
    at[plan.unknown[put], 1:] = 0.0
    slopes = eq.jacobian(q[:, None])[0][np.ix_(plan.rows, plan.unknown)] / weight
    left = eq.changes(at[:, None], (), drawn.constants)[plan.rows, 0]
    if not (np.isfinite(slopes).all() and np.isfinite(left).all()):
        return None
    for some in [np.where(put, 0.0, slopes), slopes] if put.any() else [slopes]:
        # 1e-7 of the largest singular value: rows below are redundant
        step = np.linalg.pinv(some, rcond=1e-7) @ left
        at[plan.unknown, 1:] -= step / weight[:, None]
        left = left - slopes @ step
    return at


def changes(
    view: HostView, drawn: Drawn, q: np.ndarray, rates: Sequence[np.ndarray] = (), known: np.ndarray | None = None
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return poses and derivatives with their changes, ``(N, lanes, 1 + changes)``; not finite at a singular position.

    The known coordinates stay, or have changes ``(known, changes)``; their rates stay. Solved poses and rates are
    ``(N, lanes)``.
    """
    plan, width = view.plan, drawn.home.shape[-1]
    matrix = view.matrices(q)[0]
    found: list[np.ndarray] = []
    for order, values in enumerate((q, *rates)):
        # The highest derivative enters the differentiated rows linearly, with the Jacobian for its factor.
        term = np.concatenate([values[..., None], np.zeros((*values.shape, width - 1), q.dtype)], axis=2)
        if not order:
            term[plan.fixed, :, 1:] = drawn.home[plan.fixed][:, None, 1:]
            if known is not None:
                term[plan.known, :, 1:] = known[:, None]
        terms = [*found, term]
        right = np.moveaxis(view.eq.changes(terms[0], terms[1:], drawn.constants)[plan.rows], 1, 0)
        term[plan.unknown, :, 1:] = -np.moveaxis(view.solve(matrix, right), 0, 1)
        found.append(term)
    return found[0], found[1:]


def unabsorbed_changes(view: HostView, drawn: Drawn, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find how far the rows change with the design, and how far no motion takes that up, ``(lanes, changes)``.

    Arguments are as of `changes`.
    """
    plan = view.plan
    at = np.concatenate([q[..., None], np.zeros((*q.shape, drawn.home.shape[-1] - 1), q.dtype)], axis=2)
    at[plan.fixed, :, 1:] = drawn.home[plan.fixed][:, None, 1:]
    change = np.moveaxis(view.eq.changes(at, (), drawn.constants)[plan.rows], 1, 0)
    basis = np.linalg.qr(view.matrices(q)[0] / view.inner)[0]
    rest = change - basis @ (np.swapaxes(basis, 1, 2) @ change)
    return np.linalg.norm(change, axis=1), np.linalg.norm(rest, axis=1)
