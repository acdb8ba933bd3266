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


Evaluated = tuple[Array, Array, Array, Array]
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
    of = np if isinstance(conditions, np.ndarray) else jnp
    return of.where(equal, abs(conditions), of.maximum(-conditions, 0.0))


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


def _augmented(errors: Array, conditions: Array, multipliers: Array, penalty: Array, equal: np.ndarray) -> Array:
    """Errors and what is left of the conditions, as one vector whose half square is the merit."""
    share = multipliers / penalty[:, None] - conditions
    share = jnp.where(equal, share, jnp.maximum(share, 0.0))
    return jnp.concatenate([errors, jnp.sqrt(penalty)[:, None] * share], axis=1)


def _iterate(evaluate: Evaluate, now: Lanes, equal: np.ndarray, low: Array, high: Array) -> Lanes:
    x, expected = proposed(now, equal, low, high)
    return decided(now, x, expected, evaluate(x), equal)


def proposed(now: Lanes, equal: np.ndarray, low: Array, high: Array) -> tuple[Array, Array]:
    """The first half of an iteration: where every lane tries next, and the gain that is expected there."""
    m = now.errors.shape[1]
    r = _augmented(now.errors, now.conditions, now.multipliers, now.penalty, equal)
    active = jnp.where(equal | (r[:, m:] > 0.0), -jnp.sqrt(now.penalty)[:, None], 0.0)
    slopes = jnp.concatenate([now.slopes[:, :m], active[:, :, None] * now.slopes[:, m:]], axis=1)
    gradient = jnp.einsum("bmn,bm->bn", slopes, r)
    # Unknowns at a bound that the descent pushes against stay there.
    free = ~(((now.x <= low) & (gradient > 0.0)) | ((now.x >= high) & (gradient < 0.0)) | (low >= high))
    slopes = jnp.where(free[:, None, :], slopes, 0.0)
    gradient = jnp.where(free, gradient, 0.0)
    normal = jnp.einsum("bmi,bmj->bij", slopes, slopes)
    diagonal = jnp.diagonal(normal, axis1=1, axis2=2)
    largest = jnp.maximum(jnp.max(diagonal, axis=1, keepdims=True), 1e-30)
    # Marquardt's scaling alone lets directions run away that hardly matter: a small even part holds them.
    damping = now.damping[:, None] * (diagonal + 1e-3 * largest) + 1e-15 * largest
    matrix = normal + jax.vmap(jnp.diag)(damping)
    step = -jax.vmap(dense.cholesky_solve)(matrix, gradient[:, :, None])[:, :, 0]
    step = jnp.where(jnp.isfinite(step), step, 0.0)
    x = jnp.clip(now.x + step, low, high)
    linear = r + jnp.einsum("bmn,bn->bm", slopes, x - now.x)
    return x, 0.5 * jnp.sum(r * r, axis=1) - 0.5 * jnp.sum(linear * linear, axis=1)


def decided(now: Lanes, x: Array, expected: Array, evaluated: Evaluated, equal: np.ndarray) -> Lanes:
    """The second half: which lanes take the step, and how they go on."""
    m, moved = now.errors.shape[1], x - now.x
    errors, conditions, tried, ok = evaluated
    old = _augmented(now.errors, now.conditions, now.multipliers, now.penalty, equal)
    merit = 0.5 * jnp.sum(old * old, axis=1)
    new = _augmented(errors, conditions, now.multipliers, now.penalty, equal)
    better = 0.5 * jnp.sum(new * new, axis=1)
    finite = jnp.all(jnp.isfinite(tried), axis=(1, 2))
    broken = now.broken + (ok & ~finite)
    ok = ok & jnp.isfinite(better) & finite
    gain = jnp.where(expected > 0.0, (merit - better) / jnp.where(expected > 0.0, expected, 1.0), -1.0)
    take = ok & (better < merit) & ~now.settled
    less = jnp.where(expected > 0.0, jnp.maximum(0.1, 1.0 - (2.0 * gain - 1.0) ** 3), 1.0)
    damping = jnp.where(take, jnp.maximum(now.damping * less, _LEAST), now.damping * now.growth)
    growth = jnp.where(take, 2.0, 2.0 * now.growth)

    def pick(a, b):
        return jnp.where(take.reshape(-1, *[1] * (a.ndim - 1)), a, b)

    x, errors, conditions, tried = (
        pick(a, b) for a, b in ((x, now.x), (errors, now.errors), (conditions, now.conditions), (tried, now.slopes))
    )
    # Multipliers: when no step is left, or every so often.
    small = jnp.max(jnp.abs(moved), axis=1) <= 1e-13 * (1.0 + jnp.max(jnp.abs(now.x), axis=1))
    still = (damping > _STUCK) | (take & (merit - better <= 1e-14 * merit)) | (small & ~take)
    since = now.since + 1
    update = still | (since >= _EVERY)
    share = now.multipliers - now.penalty[:, None] * conditions
    share = jnp.where(equal, share, jnp.maximum(share, 0.0))
    changed = jnp.max(jnp.abs(share - now.multipliers), axis=1, initial=0.0)
    far = jnp.max(violation(conditions, equal), axis=1, initial=0.0)
    multipliers = jnp.where(update[:, None], share, now.multipliers)
    raised = update & (far > 0.25 * now.before) & (far > _SMALL)
    penalty = jnp.where(raised, jnp.minimum(10.0 * now.penalty, 1e10), now.penalty)
    top = jnp.max(jnp.abs(share), axis=1, initial=0.0)
    done = still & (far <= _SMALL) & (changed <= 1e-9 * (top + 1e-12))
    zero = jnp.sum(errors * errors, axis=1) <= 1e-29 * m
    out = Lanes(
        x,
        errors,
        conditions,
        tried,
        multipliers,
        penalty,
        jnp.where(update, jnp.minimum(damping, _GENTLE), damping),
        jnp.where(update, 2.0, growth),
        jnp.where(update, 0, since),
        jnp.where(update, far, now.before),
        now.settled | done | (zero & (far <= _SMALL)),
        broken,
    )
    return jax.tree.map(lambda a, b: jnp.where(now.settled.reshape(-1, *[1] * (a.ndim - 1)), b, a), out, now)
