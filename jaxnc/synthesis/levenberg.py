"""Constrained nonlinear least squares, many at once: Levenberg-Marquardt inside an augmented Lagrangian.

All lanes go on in lockstep, in NumPy. One evaluation serves the trial point and its Jacobian, whether it is then
accepted or not. A trial that does not assemble is refused like one that is worse: nothing is ever not a number.
Multipliers follow Hestenes, Powell and Rockafellar (inequalities); the damping follows Nielsen.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

_GENTLE = 1e-3  # damping to begin with, of the largest diagonal element
_LEAST = 1e-17  # damping; below, it is lost in rounding
_STUCK = 1e10  # damping at which no step is possible any more
_EVERY = 12  # iterations between updates of the multipliers
_UNSEEN = 1e6  # an error that is worse than any
_SMALL = 1e-11  # violation of a condition that counts as none


class Lanes(NamedTuple):
    """Problems under way, one in each lane."""

    x: np.ndarray  # unknowns (B, n), in their scales
    errors: np.ndarray  # (B, m)
    conditions: np.ndarray  # (B, k)
    slopes: np.ndarray  # derivatives of both, (B, m + k, n)
    multipliers: np.ndarray  # of the conditions, (B, k)
    penalty: np.ndarray  # (B,)
    damping: np.ndarray  # relative, (B,)
    growth: np.ndarray  # factor of the damping at the next refusal, (B,)
    since: np.ndarray  # iterations since the multipliers were updated
    before: np.ndarray  # violation at that update
    settled: np.ndarray  # whether the lane has nothing left to do, (B,)
    broken: np.ndarray  # trials that assembled and of which numbers or derivatives were not finite all the same, (B,)


Evaluated = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Errors ``(B, m)``, conditions ``(B, k)``, slopes of both, and whether they can be trusted, ``(B,)``."""

Evaluate = Callable[[np.ndarray, np.ndarray], Evaluated]
"""From unknowns ``(B, n)``, and which lanes' results are looked at, ``(B,)``."""


def waiting(x: np.ndarray, errors: int, conditions: int) -> Lanes:
    """Lanes that are to start at some points: the first iteration evaluates them there."""
    count, n = x.shape
    one = np.ones(count)
    return Lanes(
        x,
        np.full((count, errors), _UNSEEN),
        np.zeros((count, conditions)),
        np.zeros((count, errors + conditions, n)),
        np.zeros((count, conditions)),
        one,
        _GENTLE * one,
        2.0 * one,
        np.zeros(count, np.int32),
        np.inf * one,
        np.zeros(count, bool),
        np.zeros(count, np.int32),
    )


def violation(conditions: np.ndarray, equal: np.ndarray) -> np.ndarray:
    """How far conditions are from being met, ``(..., k)``."""
    return np.where(equal, np.abs(conditions), np.maximum(-conditions, 0.0))


def advance(
    evaluate: Evaluate, lanes: Lanes, equal: np.ndarray, low: np.ndarray, high: np.ndarray, count: int
) -> Lanes:
    """Take a number of iterations in all lanes.

    Which conditions are equalities is `equal`, ``(k,)``; the others are to be zero or positive. Bounds are in the
    scales of the unknowns, ``(n,)`` or ``(B, n)``.
    """
    with np.errstate(all="ignore"):
        for _ in range(count):
            if lanes.settled.all():
                break
            x, expected = _proposed(lanes, equal, low, high)
            lanes = _decided(lanes, x, expected, evaluate(x, ~lanes.settled), equal)
    return lanes


def _augmented(
    errors: np.ndarray, conditions: np.ndarray, multipliers: np.ndarray, penalty: np.ndarray, equal: np.ndarray
) -> np.ndarray:
    """Errors and what is left of the conditions, as one vector whose half square is the merit."""
    share = multipliers / penalty[:, None] - conditions
    share = np.where(equal, share, np.maximum(share, 0.0))
    return np.concatenate([errors, np.sqrt(penalty)[:, None] * share], axis=1)


def _proposed(now: Lanes, equal: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first half of an iteration: where every lane tries next, and the gain that is expected there."""
    m = now.errors.shape[1]
    r = _augmented(now.errors, now.conditions, now.multipliers, now.penalty, equal)
    active = np.where(equal | (r[:, m:] > 0.0), -np.sqrt(now.penalty)[:, None], 0.0)
    slopes = np.concatenate([now.slopes[:, :m], active[:, :, None] * now.slopes[:, m:]], axis=1)
    gradient = np.einsum("bmn,bm->bn", slopes, r)
    # Unknowns at a bound that the descent pushes against stay there.
    free = ~(((now.x <= low) & (gradient > 0.0)) | ((now.x >= high) & (gradient < 0.0)) | (low >= high))
    slopes = np.where(free[:, None, :], slopes, 0.0)
    gradient = np.where(free, gradient, 0.0)
    normal = np.swapaxes(slopes, 1, 2) @ slopes
    diagonal = np.diagonal(normal, axis1=1, axis2=2)
    largest = np.maximum(np.max(diagonal, axis=1, keepdims=True), 1e-30)
    # Marquardt's scaling alone lets directions run away that hardly matter: a small even part holds them.
    damping = now.damping[:, None] * (diagonal + 1e-3 * largest) + 1e-15 * largest
    matrix = normal + damping[:, :, None] * np.eye(damping.shape[1])
    step = -_solved(matrix, gradient)
    step = np.where(np.isfinite(step), step, 0.0)
    x = np.clip(now.x + step, low, high)
    linear = r + np.einsum("bmn,bn->bm", slopes, x - now.x)
    return x, 0.5 * np.sum(r * r, axis=1) - 0.5 * np.sum(linear * linear, axis=1)


def _decided(now: Lanes, x: np.ndarray, expected: np.ndarray, evaluated: Evaluated, equal: np.ndarray) -> Lanes:
    """The second half: which lanes take the step, and how they go on."""
    m, moved = now.errors.shape[1], x - now.x
    errors, conditions, tried, ok = evaluated
    old = _augmented(now.errors, now.conditions, now.multipliers, now.penalty, equal)
    merit = 0.5 * np.sum(old * old, axis=1)
    new = _augmented(errors, conditions, now.multipliers, now.penalty, equal)
    better = 0.5 * np.sum(new * new, axis=1)
    finite = np.all(np.isfinite(tried), axis=(1, 2)) & np.isfinite(better)
    broken = now.broken + (ok & ~finite)
    ok = ok & finite
    gain = np.where(expected > 0.0, (merit - better) / np.where(expected > 0.0, expected, 1.0), -1.0)
    take = ok & (better < merit) & ~now.settled
    less = np.where(expected > 0.0, np.maximum(0.1, 1.0 - (2.0 * gain - 1.0) ** 3), 1.0)
    damping = np.where(take, np.maximum(now.damping * less, _LEAST), now.damping * now.growth)
    growth = np.where(take, 2.0, 2.0 * now.growth)

    def pick(a, b):
        return np.where(take.reshape(-1, *[1] * (a.ndim - 1)), a, b)

    x, errors, conditions, tried = (
        pick(a, b) for a, b in ((x, now.x), (errors, now.errors), (conditions, now.conditions), (tried, now.slopes))
    )
    # Multipliers: when no step is left, or every so often.
    small = np.max(np.abs(moved), axis=1) <= 1e-13 * (1.0 + np.max(np.abs(now.x), axis=1))
    still = (damping > _STUCK) | (take & (merit - better <= 1e-14 * merit)) | (small & ~take)
    since = now.since + 1
    update = still | (since >= _EVERY)
    share = now.multipliers - now.penalty[:, None] * conditions
    share = np.where(equal, share, np.maximum(share, 0.0))
    changed = np.max(np.abs(share - now.multipliers), axis=1, initial=0.0)
    far = np.max(violation(conditions, equal), axis=1, initial=0.0)
    multipliers = np.where(update[:, None], share, now.multipliers)
    raised = update & (far > 0.25 * now.before) & (far > _SMALL)
    penalty = np.where(raised, np.minimum(10.0 * now.penalty, 1e10), now.penalty)
    top = np.max(np.abs(share), axis=1, initial=0.0)
    done = still & (far <= _SMALL) & (changed <= 1e-9 * (top + 1e-12))
    zero = np.sum(errors * errors, axis=1) <= 1e-29 * m
    out = Lanes(
        x,
        errors,
        conditions,
        tried,
        multipliers,
        penalty,
        np.where(update, np.minimum(damping, _GENTLE), damping),
        np.where(update, 2.0, growth),
        np.where(update, 0, since),
        np.where(update, far, now.before),
        now.settled | done | (zero & (far <= _SMALL)),
        broken,
    )
    return Lanes(*(np.where(now.settled.reshape(-1, *[1] * (a.ndim - 1)), b, a) for a, b in zip(out, now, strict=True)))


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions ``(B, n)``; not finite where a matrix is singular."""
    good = np.asarray(np.isfinite(matrix).all(axis=(1, 2)))
    good[good] = np.linalg.slogdet(matrix[good])[0] != 0.0
    out = np.full(right.shape, np.nan)
    out[good] = np.linalg.solve(matrix[good], right[good, :, None])[:, :, 0]
    return out
