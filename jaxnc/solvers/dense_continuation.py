"""One sequence of inputs followed by a fixed number of steps, with matrices as they are: where nothing is written out.

The counterpart of `jaxnc.solvers.continuation` for blocks that are too large to be written out element by element.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.solvers.continuation import DROP, STEP
from jaxnc.solvers.host.judge import REBOUND, SHARP
from jaxnc.solvers.newton import largest, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.system.equations import Equations, guards, residual, weights
from jaxnc.system.precision import limits
from jaxnc.types import Array

_ITERATIONS = 6  # of Newton, to each step


class _State(NamedTuple):
    """Where the branch has been followed to."""

    q: Array  # the pose
    good: Array  # whether every step so far was right
    size: Array  # its largest residual
    pivots: Array  # its conditioning
    slopes: Array  # derivatives of the unknown coordinates with respect to the driven ones, (n, driven)
    signs: Array  # of the determinants of the diagonal blocks
    sizes: Array  # logarithms of those of the determinants
    jacobian: Array  # derivatives of the rows with respect to the unknown coordinates
    rise: Array  # relative change of the determinants in the last step that went anywhere, and
    way: Array  # the change of the known coordinates in it


def stepped(plan: Plan, eq: Equations, q: Array, values: Array, parts: np.ndarray, counts: np.ndarray):
    """Follow a branch through inputs: unknowns, each ``(T,)``, largest residuals, conditioning, which poses are right.

    After every step so many `parts` of the way to a value are gone, ``(T, most)``; `counts` are the steps to each,
    ``(T,)``.
    """
    step, home = _stepper(plan, eq), q[plan.known]

    def value(state, way):
        begin, end, part, count = way
        state = lax.fori_loop(0, count, lambda i, st: step(st, begin + part[i] * (end - begin)), state)
        return state, (state.q, state.size, state.pivots, state.good)

    # The first way has no length: a step to where the branch begins, which nothing is compared with.
    begin, end = jnp.concatenate([home[None], home[None], values[:-1]]), jnp.concatenate([home[None], values])
    parts, counts = np.concatenate([parts[:1], parts]), np.concatenate([[1], counts])
    ways = begin, end, jnp.asarray(parts), jnp.asarray(counts)
    _, (poses, size, pivots, good) = lax.scan(value, _blank(plan, eq, q), ways)
    return tuple(poses[1:, int(c)] for c in plan.unknown), size[1:], pivots[1:], good[1:]


class _Seen(NamedTuple):
    """One evaluation of the equations; see `_State`."""

    correction: Array
    slopes: Array
    signs: Array
    sizes: Array
    jacobian: Array


def _evaluated(plan: Plan, eq: Equations, q: Array) -> _Seen:
    r, jacobian, by_known = plan.linearise(eq, q)
    driven = np.eye(len(plan.known), len(plan.driven), dtype=q.dtype)
    x = plan.steps(eq, jacobian, jnp.stack([r, *(by_known @ e for e in driven.T)], axis=1))
    signs, sizes = plan.orientation(jacobian)
    return _Seen(x[:, 0], -x[:, 1:], signs, sizes, jacobian)


def _redundant(plan: Plan) -> bool:
    return len(plan.rows) > len(plan.unknown)


def _blank(plan: Plan, eq: Equations, q: Array) -> _State:
    """Before the first step; signs of zero say so."""
    zero, seen = jnp.zeros(()), jax.eval_shape(functools.partial(_evaluated, plan, eq), q)
    none = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), seen)
    rise = jnp.zeros(1) if _redundant(plan) else none.sizes
    still = jnp.zeros(len(plan.known))
    return _State(q, jnp.ones((), bool), zero, zero, none.slopes, none.signs, none.sizes, none.jacobian, rise, still)


def _stepper(plan: Plan, eq: Equations) -> Callable[[_State, Array], _State]:
    """A step of a branch to other values of the known coordinates."""
    weight, least = weights(eq), limits(eq.length)
    driven = len(plan.driven)

    def norm(change):
        return jnp.sqrt(jnp.sum((weight[plan.unknown] * change) ** 2))

    def step(old: _State, target: Array) -> _State:
        ahead = target - old.q[plan.known]
        predicted = old.slopes @ ahead[:driven]
        guess = plan.join(old.q[plan.unknown] + predicted, target, old.q[plan.fixed])

        def more(state):
            i, _, _, moved = state
            return (i < _ITERATIONS) & (moved > least.fine * eq.length)

        def improve(state):
            i, q, *_ = state
            seen = _evaluated(plan, eq, q)
            change = jnp.where(jnp.all(jnp.isfinite(seen.correction)), -seen.correction, 0.0)
            return i + 1, plan.move(q, change), seen, jnp.max(jnp.abs(weight[plan.unknown] * change), initial=0.0)

        blank = _Seen(predicted, old.slopes, old.signs, old.sizes, old.jacobian)
        _, q, seen, moved = lax.while_loop(more, improve, (jnp.zeros((), int), guess, blank, jnp.full((), jnp.inf)))
        fresh = jnp.all(old.signs == 0.0)
        ratio = seen.signs * old.signs * jnp.exp(seen.sizes - old.sizes)
        if _redundant(plan):
            ratio = jnp.where(fresh, 1.0, plan.relative(seen.jacobian, old.jacobian))[None]
        ratio = jnp.where(fresh, 1.0, ratio)
        square = jnp.sum(old.way * old.way)
        share = jnp.sum(old.way * ahead) / jnp.where(square > 0.0, square, 1.0)
        off = norm((q - guess)[plan.unknown])
        size, pivots = largest(residual(eq, q)), plan.conditioning(eq, seen.jacobian)
        good = (size <= tolerance(eq, q)) & (moved <= least.close * eq.length) & (pivots > least.poor)
        good = good & jnp.all(jnp.concatenate(guards(eq, q)) > 0.0)
        good = good & (off <= SHARP * norm(predicted) + least.close * eq.length) & jnp.all(jnp.isfinite(seen.slopes))
        good = good & jnp.all((ratio >= DROP) & (1.0 + share * old.rise >= REBOUND * ratio))
        if plan.angles:
            good = good & jnp.all(jnp.abs(ahead[np.array(plan.angles)]) <= STEP)
        good, moves = old.good & good, jnp.any(ahead != 0.0)
        rise, way = jnp.where(moves, ratio - 1.0, old.rise), jnp.where(moves, ahead, old.way)
        new = _State(q, good, size, pivots, seen.slopes, seen.signs, seen.sizes, seen.jacobian, rise, way)
        return jax.tree.map(lambda a, b: jnp.where(good, a, b), new, old)._replace(good=good)

    return step
