"""One sequence of inputs followed by a fixed number of steps, with matrices as they are: where nothing is written out.

The counterpart of `jaxnc.solvers.march` for blocks that are too large to be written out element by element.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.solvers.host.judge import SHARP, THROWN
from jaxnc.solvers.look import inspect
from jaxnc.solvers.march import FELL, STEP
from jaxnc.solvers.newton import largest, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.system.equations import Equations, weights
from jaxnc.system.precision import limits
from jaxnc.types import Array

_ITERATIONS = 6  # of Newton, to each step


class _State(NamedTuple):
    """Where the branch has been followed to.

    Attributes:
        q: the pose.
        good: whether every step so far was right.
        slopes: derivatives of the unknown coordinates with respect to the known ones, ``(n, k)``.
        signs, sizes: of the determinants of the diagonal blocks; or
        reference: the matrix, where there are more rows than unknowns.
        rise: relative change of the determinants in the last step that went anywhere, and
        way: the change of the known coordinates in it.
    """

    q: Array
    good: Array
    slopes: Array
    signs: Array
    sizes: Array
    reference: Array
    rise: Array
    way: Array


def stepped(plan: Plan, eq: Equations, q: Array, values: Array, parts: np.ndarray, counts: np.ndarray):
    """Follow a branch through a sequence of inputs.

    Args:
        plan: what is solved for.
        eq: the equations of one design.
        q: the pose that it begins from, ``(N,)``.
        values: known coordinates, ``(T, k)``.
        parts: of the way to each value that is gone after every step, ``(T, most)``.
        counts: how many steps there are to each, ``(T,)``.

    Returns:
        Unknown coordinates, each ``(T,)``; largest residuals, conditioning, and which poses are right.
    """
    step = _stepper(plan, eq)

    def value(state, way):
        begin, end, part, count = way
        state = lax.fori_loop(0, count, lambda i, st: step(st, begin + part[i] * (end - begin)), state)
        return state, (state.q, state.good)

    before = jnp.concatenate([q[plan.known][None], values[:-1]])
    ways = before, values, jnp.asarray(parts), jnp.asarray(counts)
    _, (poses, good) = lax.scan(value, _begin(plan, eq, q), ways)
    look = (lax.map if plan.large else lambda f, x: jax.vmap(f)(x))(lambda x: inspect(plan, eq, x), poses)
    good = good & look.upright & (look.pivots > limits(q).poor)
    return tuple(poses[:, int(c)] for c in plan.unknown), look.size, look.pivots, good


class _Seen(NamedTuple):
    """One evaluation of the equations; see `_State`."""

    correction: Array
    slopes: Array
    signs: Array
    sizes: Array
    reference: Array


def _evaluated(plan: Plan, eq: Equations, q: Array) -> _Seen:
    r, jacobian, by_known = plan.linearise(eq, q)
    driven = np.eye(len(plan.known), len(plan.driven), dtype=q.dtype)
    x = plan.steps(eq, jacobian, jnp.stack([r, *(by_known @ e for e in driven.T)], axis=1))
    signs, sizes = plan.orientation(jacobian)
    return _Seen(x[:, 0], -x[:, 1:], signs, sizes, jacobian if _redundant(plan) else jnp.zeros(0))


def _redundant(plan: Plan) -> bool:
    return len(plan.rows) > len(plan.unknown)


def _begin(plan: Plan, eq: Equations, q: Array) -> _State:
    seen = _evaluated(plan, eq, q)
    still = jnp.zeros(len(plan.known))
    rise = jnp.zeros(1) if _redundant(plan) else jnp.zeros_like(seen.sizes)
    return _State(q, jnp.ones((), bool), *seen[1:], rise, still)


def _stepper(plan: Plan, eq: Equations):
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

        blank = _Seen(predicted, old.slopes, old.signs, old.sizes, old.reference)
        _, q, seen, moved = lax.while_loop(more, improve, (jnp.zeros((), int), guess, blank, jnp.full((), jnp.inf)))
        if _redundant(plan):
            ratio = plan.relative(seen.reference, old.reference)[None]
        else:
            ratio = seen.signs * old.signs * jnp.exp(seen.sizes - old.sizes)
        square = jnp.sum(old.way * old.way)
        share = jnp.sum(old.way * ahead) / jnp.where(square > 0.0, square, 1.0)
        off = norm((q - guess)[plan.unknown])
        good = (largest(plan.residual(eq, q)) <= tolerance(eq, q)) & (moved <= least.close * eq.length)
        good = good & (off <= SHARP * norm(predicted) + least.close * eq.length)
        good = good & jnp.all(jnp.isfinite(seen.slopes))
        good = good & jnp.all((ratio >= FELL) & (1.0 + share * old.rise >= THROWN * ratio))
        if plan.angles:
            good = good & jnp.all(jnp.abs(ahead[np.array(plan.angles)]) <= STEP)
        good = old.good & good
        moves = jnp.any(ahead != 0.0)
        new = _State(q, good, *seen[1:], ratio - 1.0, ahead)
        new = new._replace(rise=jnp.where(moves, new.rise, old.rise), way=jnp.where(moves, new.way, old.way))
        kept = jax.tree.map(lambda a, b: jnp.where(good, a, b), new, old)
        return kept._replace(good=good)

    return step
