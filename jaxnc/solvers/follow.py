"""Following a branch through a sequence of input values: a walk to a few of them, and the others from in between."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxnc.solvers.look import Look, looked
from jaxnc.solvers.newton import newton, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.walk import walk
from jaxnc.system.equations import Equations, weights
from jaxnc.system.precision import limits
from jaxnc.types import Array, Coordinates, Float

_ANCHORS = 96  # the most poses that are walked to one by one before the rest is filled in


class Followed(NamedTuple):
    """A branch followed through a sequence of input values.

    Attributes:
        poses: ``(T, N)``; those past the end repeat the last pose on the branch.
        reached: ``(T,)``, whether the pose is on the branch.
        limit: ``(T,)``, whether the branch ends there (a limit of travel that the input just touches).
        looks: what each pose looks like, see `inspect`.
        part: how far the walk got beyond the last pose it reached, as a part of the way to the next.
        exhausted: whether it gave up on the way, which may go on.
    """

    poses: Array
    reached: Array
    limit: Array
    looks: Look
    part: Array
    exhausted: Array


def follow(
    plan: Plan, eq: Equations, q: Coordinates, values: Float[Array, "T k"], other: Coordinates | None = None
) -> Followed:
    """Follow a branch from a pose through a sequence of input values.

    A few of the poses are walked to one after the other; the others are solved as independent lanes from in between
    them. Then every pose is checked against its neighbours and against the orientation signs of the walked ones; if one
    fails, the whole sequence is walked pose by pose, and that decides.

    Args:
        plan: what is solved for.
        eq: the equations.
        q: a pose that meets them, where the walk begins.
        values: known coordinates, pose by pose.
        other: where to begin if the first value is not reached from q (the same pose, an angle counted otherwise).

    Returns:
        The poses and which of them are on the branch.
    """
    total = values.shape[0]
    coarse = max(1, -(-total // min(_ANCHORS, max(total // 8, 2))))
    if total <= 8:
        coarse = 1
    weight, least = weights(eq), limits(eq.length)
    index = jnp.arange(total)

    def lanes(stride, begin):
        seen = walk(plan, eq, begin, values, stride)
        # `seen.reached` is the target that was not reached: the walk ended `part` of the way to it.
        before = jnp.maximum(seen.reached - 1, 0) // stride * stride
        ended = seen.reached < total
        lower = index // stride * stride
        upper = jnp.minimum(lower + stride, total - 1)
        in_last = ended & (lower >= before) & (index > lower)
        left = seen.poses[jnp.minimum(lower, before)]
        right = jnp.where(in_last[:, None], seen.last, seen.poses[upper])
        way = values[upper] - values[lower]
        span = jnp.sum(way * way, axis=1)
        ratio = jnp.sum((values - values[lower]) * way, axis=1) / jnp.where(span > 0, span, 1.0)
        place = jnp.where(span > 0, ratio, (index - lower) / jnp.maximum(upper - lower, 1))
        inside = jnp.where(in_last, place / jnp.where(seen.part > 0, seen.part, 1.0), place)
        guess = left + inside[:, None] * (right - left)
        visited = (index % stride == 0) | (index == total - 1)
        guess = jnp.where((visited & (index < seen.reached))[:, None], seen.poses, guess)
        guess = jax.vmap(lambda g, u: plan.join(g[plan.unknown], u, q[plan.fixed]))(guess, values)
        poses, _ = jax.vmap(lambda g: newton(plan, eq, g, 12))(guess)
        between = seen.between & (index < seen.reached)
        poses = jnp.where(between[:, None], seen.poses, poses)
        looks, jacobians = jax.vmap(lambda x: looked(plan, eq, x))(poses)

        past = ended & ((index >= seen.reached) | (in_last & (place > seen.part)))
        past = past | (ended & (seen.reached == 0))
        fits = (looks.size <= jax.vmap(lambda x: tolerance(eq, x))(poses)) & looks.upright
        signs = looks.signs
        # Signs differ between walked poses only across a change point; what lies in between is then walked as well.
        passed = seen.passed[upper] != seen.passed[lower]
        alike = jnp.all((signs[lower] == signs[upper]) | in_last[:, None], axis=1) & (in_last | ~passed)
        same = alike & jnp.all(signs == signs[lower], axis=1)
        if len(plan.rows) > len(plan.unknown):
            both = jnp.concatenate([jacobians, jacobians[upper]]), jnp.concatenate([jacobians[lower]] * 2)
            alike = jax.vmap(plan.alike)(*both)
            same = alike[:total] & (alike[total:] | in_last)

        def norm(x):
            return jnp.sqrt(jnp.sum((weight * x) ** 2, axis=1))

        span_q = norm(right - left)
        near = norm(poses - guess) <= 0.25 * span_q + least.close * eq.length
        gap = norm(jnp.diff(poses, axis=0, append=poses[-1:]))
        share = jnp.abs(jnp.diff(inside, append=inside[-1:]))
        share = jnp.where(lower == jnp.append(lower[1:], lower[-1]), share, 1.0)
        even = (gap <= 3.0 * share * span_q + least.close * eq.length) | jnp.append(past[1:], True)
        right_branch = past | seen.touched | between | (fits & same & near & even)
        # At a limit of travel Newton is slow and the input blind: the pose is the one that the walk came to.
        at_limit = seen.touched & (index < seen.reached)
        poses = jnp.where((at_limit & ~fits)[:, None], seen.poses, poses)
        return (
            poses,
            (~past & fits) | at_limit,
            at_limit,
            looks,
            seen.last,
            seen.part,
            seen.exhausted,
            jnp.all(right_branch),
        )

    other = q if other is None else other
    differs = jnp.any(other != q)

    def again(state):
        _, stride, use_other, *_ = state
        found = lanes(stride, jnp.where(use_other, other, q))
        good, verified = found[1], found[-1]
        elsewhere = ~good[0] & ~use_other & differs
        finer = ~elsewhere & ~verified & (stride > 1)
        return ~elsewhere & ~finer, jnp.where(finer, 1, stride), use_other | elsewhere, *found

    none, zero = jnp.zeros(total, bool), jnp.zeros(())
    signs = jnp.zeros((total, 1 + sum(len(rows) for rows, _ in plan.blocks)))
    blank = (
        jnp.zeros((total, q.shape[0])),
        none,
        none,
        Look(jnp.zeros(total), jnp.zeros(total), signs, none, none),
        q,
        zero,
        jnp.zeros((), bool),
    )
    no = jnp.zeros((), bool)
    first = (no, jnp.full((), coarse), no, *blank, no)
    state = lax.while_loop(lambda st: ~st[0], again, first)
    _, _, _, poses, good, at_limit, looks, last, part, exhausted, _ = state
    # A branch is followed in order: nothing after the first gap is on it.
    good = jnp.cumsum(~good) == 0
    looks = looks._replace(signs=looks.signs[:, :0])  # which nobody needs any more
    return Followed(jnp.where(good[:, None], poses, last), good, at_limit, looks, part, exhausted)
