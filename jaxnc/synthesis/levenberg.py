"""Constrained nonlinear least squares, many at once: Levenberg-Marquardt inside an augmented Lagrangian.

All lanes go on in lockstep. One body evaluates the trial point and its Jacobian, whether it is then accepted or not, so
that little has to be compiled. A trial that does not assemble is refused like one that is worse: nothing is ever not a
number. Multipliers follow Hestenes, Powell and Rockafellar (inequalities); the damping follows Nielsen.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.solvers import dense
from jaxnc.types import Array

_GENTLE = 1e-3  # damping to begin with, of the largest diagonal element
_LEAST = 1e-17  # damping; below, it is lost in rounding
_STUCK = 1e10  # damping at which no step is possible any more
_EVERY = 12  # iterations between updates of the multipliers
_UNSEEN = 1e6  # an error that is worse than any
_SMALL = 1e-11  # violation of a condition that counts as none


class Lanes(NamedTuple):
    """Problems under way, one in each lane.

    Attributes:
        x: unknowns ``(B, n)``, in their scales.
        errors: ``(B, m)``.
        conditions: ``(B, k)``.
        slopes: derivatives of both, ``(B, m + k, n)``.
        multipliers: of the conditions, ``(B, k)``.
        penalty: ``(B,)``.
        damping: relative, ``(B,)``.
        growth: factor of the damping at the next refusal, ``(B,)``.
        since: iterations since the multipliers were updated.
        before: violation at that update.
        settled: whether the lane has nothing left to do, ``(B,)``.
        broken: trials that assembled and whose derivatives were not finite all the same, ``(B,)``.
    """

    x: Any
    errors: Any
    conditions: Any
    slopes: Any
    multipliers: Any
    penalty: Any
    damping: Any
    growth: Any
    since: Any
    before: Any
    settled: Any
    broken: Any


Evaluated = tuple[Any, Any, Any, Any]
"""Errors ``(B, m)``, conditions ``(B, k)``, slopes of both, and whether they can be trusted, ``(B,)``."""

Evaluate = Callable[[Array], Evaluated]
"""From unknowns ``(B, n)``."""


def waiting(x: Any, errors: int, conditions: int) -> Lanes:
    """Lanes that are to start at some points: the first iteration evaluates them there. Of NumPy, like `x`."""
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


def violation(conditions: Any, equal: np.ndarray) -> Any:
    """How far conditions are from being met, ``(..., k)``; of NumPy's arrays by NumPy."""
    of = _namespace(conditions)
    return of.where(equal, abs(conditions), of.maximum(-conditions, 0.0))


def _namespace(array: Any) -> Any:
    """What an array is worked on by: on the host NumPy, for which nothing is compiled."""
    return np if isinstance(array, np.ndarray) else jnp


def advance(evaluate: Evaluate, lanes: Lanes, equal: np.ndarray, low: Array, high: Array, count: Array) -> Lanes:
    """Take a number of iterations in all lanes.

    Args:
        evaluate: see `Evaluate`.
        lanes: where they are.
        equal: which conditions are equalities, ``(k,)``; the others are to be zero or positive.
        low: lower bounds of the unknowns, in their scales.
        high: upper bounds.
        count: iterations.

    Returns:
        Where they are then.
    """

    def step(_, state: Lanes) -> Lanes:
        return _iterate(evaluate, state, equal, low, high)

    def more(state):
        return (state[0] < count) & ~jnp.all(state[1].settled)

    return lax.while_loop(more, lambda s: (s[0] + 1, step(s[0], s[1])), (jnp.zeros((), int), lanes))[1]


def _augmented(errors: Any, conditions: Any, multipliers: Any, penalty: Any, equal: np.ndarray) -> Any:
    """Errors and what is left of the conditions, as one vector whose half square is the merit."""
    of = _namespace(errors)
    share = multipliers / penalty[:, None] - conditions
    share = of.where(equal, share, of.maximum(share, 0.0))
    return of.concatenate([errors, of.sqrt(penalty)[:, None] * share], axis=1)


def _iterate(evaluate: Evaluate, now: Lanes, equal: np.ndarray, low: Array, high: Array) -> Lanes:
    x, expected = proposed(now, equal, low, high)
    return decided(now, x, expected, evaluate(x), equal)


def proposed(now: Lanes, equal: np.ndarray, low: Any, high: Any) -> tuple[Any, Any]:
    """The first half of an iteration: where every lane tries next, and the gain that is expected there."""
    of, m = _namespace(now.x), now.errors.shape[1]
    r = _augmented(now.errors, now.conditions, now.multipliers, now.penalty, equal)
    active = of.where(equal | (r[:, m:] > 0.0), -of.sqrt(now.penalty)[:, None], 0.0)
    slopes = of.concatenate([now.slopes[:, :m], active[:, :, None] * now.slopes[:, m:]], axis=1)
    gradient = of.einsum("bmn,bm->bn", slopes, r)
    # Unknowns at a bound that the descent pushes against stay there.
    free = ~(((now.x <= low) & (gradient > 0.0)) | ((now.x >= high) & (gradient < 0.0)) | (low >= high))
    slopes = of.where(free[:, None, :], slopes, 0.0)
    gradient = of.where(free, gradient, 0.0)
    normal = of.einsum("bmi,bmj->bij", slopes, slopes)
    diagonal = of.diagonal(normal, axis1=1, axis2=2)
    largest = of.maximum(of.max(diagonal, axis=1, keepdims=True), 1e-30)
    # Marquardt's scaling alone lets directions run away that hardly matter: a small even part holds them.
    damping = now.damping[:, None] * (diagonal + 1e-3 * largest) + 1e-15 * largest
    matrix = normal + damping[:, :, None] * np.eye(damping.shape[1])
    solve = np.linalg.solve if of is np else jax.vmap(dense.cholesky_solve)
    step = -solve(matrix, gradient[:, :, None])[:, :, 0]
    step = of.where(of.isfinite(step), step, 0.0)
    x = of.clip(now.x + step, low, high)
    linear = r + of.einsum("bmn,bn->bm", slopes, x - now.x)
    return x, 0.5 * of.sum(r * r, axis=1) - 0.5 * of.sum(linear * linear, axis=1)


def decided(now: Lanes, x: Any, expected: Any, evaluated: Evaluated, equal: np.ndarray) -> Lanes:
    """The second half: which lanes take the step, and how they go on."""
    of, m, moved = _namespace(x), now.errors.shape[1], x - now.x
    errors, conditions, tried, ok = evaluated
    old = _augmented(now.errors, now.conditions, now.multipliers, now.penalty, equal)
    merit = 0.5 * of.sum(old * old, axis=1)
    new = _augmented(errors, conditions, now.multipliers, now.penalty, equal)
    better = 0.5 * of.sum(new * new, axis=1)
    finite = of.all(of.isfinite(tried), axis=(1, 2))
    broken = now.broken + (ok & ~finite)
    ok = ok & of.isfinite(better) & finite
    gain = of.where(expected > 0.0, (merit - better) / of.where(expected > 0.0, expected, 1.0), -1.0)
    take = ok & (better < merit) & ~now.settled
    less = of.where(expected > 0.0, of.maximum(0.1, 1.0 - (2.0 * gain - 1.0) ** 3), 1.0)
    damping = of.where(take, of.maximum(now.damping * less, _LEAST), now.damping * now.growth)
    growth = of.where(take, 2.0, 2.0 * now.growth)

    def pick(a, b):
        return of.where(take.reshape(-1, *[1] * (a.ndim - 1)), a, b)

    x, errors, conditions, tried = (
        pick(a, b) for a, b in ((x, now.x), (errors, now.errors), (conditions, now.conditions), (tried, now.slopes))
    )
    # Multipliers: when no step is left, or every so often.
    small = of.max(of.abs(moved), axis=1) <= 1e-13 * (1.0 + of.max(of.abs(now.x), axis=1))
    still = (damping > _STUCK) | (take & (merit - better <= 1e-14 * merit)) | (small & ~take)
    since = now.since + 1
    update = still | (since >= _EVERY)
    share = now.multipliers - now.penalty[:, None] * conditions
    share = of.where(equal, share, of.maximum(share, 0.0))
    changed = of.max(of.abs(share - now.multipliers), axis=1, initial=0.0)
    far = of.max(violation(conditions, equal), axis=1, initial=0.0)
    multipliers = of.where(update[:, None], share, now.multipliers)
    raised = update & (far > 0.25 * now.before) & (far > _SMALL)
    penalty = of.where(raised, of.minimum(10.0 * now.penalty, 1e10), now.penalty)
    top = of.max(of.abs(share), axis=1, initial=0.0)
    done = still & (far <= _SMALL) & (changed <= 1e-9 * (top + 1e-12))
    zero = of.sum(errors * errors, axis=1) <= 1e-29 * m
    out = Lanes(
        x,
        errors,
        conditions,
        tried,
        multipliers,
        penalty,
        of.where(update, of.minimum(damping, _GENTLE), damping),
        of.where(update, 2.0, growth),
        of.where(update, 0, since),
        of.where(update, far, now.before),
        now.settled | done | (zero & (far <= _SMALL)),
        broken,
    )
    return jax.tree.map(lambda a, b: of.where(now.settled.reshape(-1, *[1] * (a.ndim - 1)), b, a), out, now)
