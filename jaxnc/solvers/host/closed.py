"""Sequences whose blocks all have closed forms: all poses of a way at once, instead of one step after the other.

As in traced code (`jaxnc.solvers.sequences`) a closed form needs no guess, only the side that it is on, and whether
poses are on one branch is seen from them afterwards. What cannot be told so is followed.
"""

import numpy as np

from jaxnc.solvers.branch import CLEAR, LEADING, SHORT, STEP, TURNING, smooth
from jaxnc.solvers.host.lockstep import lockstep, shares, steady
from jaxnc.solvers.host.view import HostView, largest

_MOST = 20_000  # poses on the way; of more, following costs little


def sure(view: HostView, start: np.ndarray, values: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses ``(N, T, D)`` that are on their branch from first to last value, and of which sequences, ``(D,)``.

    Poses to begin from are ``(N, D)``, values ``(T, known, D)``; `counts` are of each sequence.
    """
    total, _, many = values.shape
    none = np.zeros((0, 0, many)), np.zeros(many, bool)
    if view.written is None or start.dtype != np.float64 or not values.shape[1]:  # of a structure nothing moves
        return none
    core = lockstep(view.plan)
    track, every = _track(start[view.plan.known], values)
    if not core.closed or track.shape[1] * many > _MOST:
        return none
    q = np.repeat(start[:, None], track.shape[1], axis=1)
    q[view.plan.known] = track
    with np.errstate(all="ignore"):
        core.intersect(view.eq, q)
        good = _on_branch(view, start, q, track)
    last = track.shape[1] - 1 - every * (total - counts)
    return q[:, -1 - every * (total - 1) :: every], (good | (np.arange(track.shape[1])[:, None] > last)).all(axis=0)


def _track(home: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, int]:
    """Known coordinates on the way to all values ``(known, steps, D)``, and how many steps there are to each."""
    total, first = len(values), values[0]
    every = -(-TURNING // total) if total > 1 else 1
    parts = LEADING if total > 1 else TURNING
    parts = np.append(SHORT, np.arange(1, parts + 1))[:, None, None] / parts
    lead = [home[None], home + parts * (first - home)]
    before = values[:-1]
    if total > 1:
        # Where the way turns a short step shows how determinants change; it is gone to and fro.
        short = first + SHORT * (values[1] - first)
        lead += [short[None], first[None]]
    between = np.arange(1, every + 1)[:, None, None] / every
    rest = before[:, None] + between * (values[1:] - before)[:, None]
    return np.moveaxis(np.concatenate([*lead, rest.reshape(len(before) * every, *home.shape)]), 0, 1), every


def _on_branch(view: HostView, start: np.ndarray, q: np.ndarray, track: np.ndarray) -> np.ndarray:
    """Which poses ``(N, steps, D)`` are solutions, clear of singular ones, and as those before them, ``(steps, D)``."""
    shape, plan = q.shape[1:], view.plan
    lanes, each = q.reshape(len(q), -1), view.taken(np.tile(np.arange(shape[1]), shape[0]))
    assert each.written is not None
    rows, determinants, slopes = each.written.run(("residual", "determinants", "slopes"), each.eq, lanes)
    # Where a slope is none, as of a cam that is upright, there is no derivative either: steps stop there.
    good = (largest(rows) <= each.tolerance(lanes)) & each.upright(lanes) & np.isfinite(slopes).all(axis=0)
    good = good.reshape(shape) & (largest(view.residual(start)) <= view.tolerance(start))
    determinants = determinants.reshape(-1, *shape)
    sizes = np.abs(determinants)
    clear = (np.sign(determinants) == np.sign(determinants[:, :1])) & (sizes > CLEAR * sizes.max(axis=1, keepdims=True))
    good &= clear.all(axis=0)
    share = shares(track)
    for value in determinants:
        good[1:] &= steady(value, share)
    good[1:] &= np.all(np.abs(np.diff(track[plan.angles], axis=1)) <= STEP, axis=0)
    good[1:] &= _smooth(view, q, track, slopes.reshape(len(plan.unknown), -1, *shape))
    return good


def _smooth(view: HostView, q: np.ndarray, track: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """In which steps poses change as their slopes say, ``(steps - 1, D)``: a kind may jump, or have an edge."""
    plan, way = view.plan, np.diff(track, axis=1)
    unknown, known = (view.weights[at][:, None] for at in (plan.unknown, plan.known))
    slopes = slopes * unknown[:, None]
    before, after = (np.sum(x * way[: slopes.shape[1]], axis=1) for x in (slopes[:, :, :-1], slopes[:, :, 1:]))
    still = np.sum((known * way) ** 2, axis=0)
    lengths = sum(np.sqrt(np.sum(x * x, axis=0) + still) for x in (before, after))
    kink = np.diff(q[plan.unknown], axis=1) * unknown - 0.5 * (before + after)
    bend, kink = (np.sqrt(np.sum(x * x, axis=0)) for x in (after - before, kink))
    return smooth(bend, kink, lengths, view.least.close * view.eq.length)
