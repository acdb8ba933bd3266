"""Following a branch through a sequence of input values: predict, correct, and subdivide rather than jump.

The whole walk is one flat loop whose body evaluates the equations once, either for a Newton correction or, when that
has converged, to accept the step and predict the next. Lanes of a batch therefore never wait for each other's
corrections, and little has to be compiled.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxnc.solvers.newton import largest, newton, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.system.equations import Equations, guards, residual, weights
from jaxnc.system.precision import limits
from jaxnc.types import Array, Coordinates, Float

_SHARP = 0.2  # a correction may be this part of the predicted step
THROWN = 0.3  # of a determinant: less was expected of it, so that it has been thrown back behind a gap
_FEEL = 1e-3  # of the way to the first value
_CORRECTIONS = 6
_PER_POSE = 250  # iterations of the walk, per pose of the sequence
_MOST = 50_000  # and for the way between them: about 25 for each radian that something turns
_ANCHORS = 96  # the most poses that are walked to one by one before the rest is filled in


class Walk(NamedTuple):
    """Where a walk got.

    Attributes:
        poses: ``(T, N)``; only those visited are set.
        reached: index of the first target that was not reached, T if all were.
        touched: ``(T,)``, whether the branch ends at the pose (a limit of travel), so that it was not passed.
        last: the last pose on the branch.
        part: how far it got from the last reached target to the next, 0 … 1.
        exhausted: whether it gave up for its number of iterations, not because the branch ends.
    """

    poses: Array
    reached: Array
    touched: Array
    last: Array
    part: Array
    exhausted: Array


class _State(NamedTuple):
    target: Array  # index of the pose that is walked to
    s: Array  # part of the way done
    h: Array  # next step
    reach: Array  # where the current trial is on the way
    q: Array  # current iterate
    guess: Array  # what it was predicted to be
    base: Array  # last accepted pose
    slope: Array  # change of all coordinates along the way, at the base
    signs: Array  # orientation signs at the base
    sizes: Array  # logarithms of the determinants' sizes at the base
    rise: Array  # relative change of the determinants per part of the way, as it was in the last step
    reference: Array  # the Jacobian at the base, where there are more rows than unknowns
    origin: Array  # known coordinates where the way begins
    corrections: Array
    count: Array
    poses: Array
    touched: Array
    over: Array
    done: Array


def walk(
    plan: Plan,
    eq: Equations,
    q: Coordinates,
    values: Float[Array, "T k"],
    stride: Array,
    count: Array | None = None,
) -> Walk:
    """Walk along a branch from a pose to every `stride`-th of a sequence of input values, and to the last one.

    A step is accepted when Newton converges, its correction is small beside the predicted step and so is the change of
    the slope, no orientation sign changes, no determinant that fell towards zero is thrown back, and no angle jumped by
    π. The other branch, which lies across a fold, is so never taken for this one, nor its mirror image behind a narrow
    gap; at a change point, where branches cross, a very short step goes straight on.

    Args:
        plan: what is solved for.
        eq: the equations.
        q: a pose that meets them, where the walk begins.
        values: known coordinates to walk to, pose by pose.
        stride: visit only every so many.
        count: how many of the values there are; all if not given.

    Returns:
        The poses and where the walk ended.
    """
    total = values.shape[0]
    number = jnp.asarray(total if count is None else count)
    end = lax.while_loop(
        lambda st: ~st.over & (st.count < _PER_POSE * total + _MOST),
        lambda st: _step(plan, eq, values, number, stride, st),
        _begin(plan, q, values),
    )
    return _ended(end, number)


def walks(
    plan: Plan,
    eq: Equations,
    q: Float[Array, "B N"],
    values: Float[Array, "B T k"],
    count: Array,
    stride: Array,
    shared: bool,
) -> Walk:
    """Several walks in lockstep, each as `walk`, until all have ended.

    Args:
        plan: what is solved for.
        eq: the equations, of one design (`shared`) or one for each walk.
        q: where they begin.
        values: known coordinates to walk to.
        count: how many of the values there are for each, ``(B,)``.
        stride: visit only every so many.
        shared: whether the equations are those of one design.

    Returns:
        The walks, with a leading axis.
    """
    start = jax.vmap(functools.partial(_begin, plan))(q, values)
    one = jax.vmap(functools.partial(_step, plan), in_axes=(None if shared else 0, 0, 0, None, 0))
    most = _PER_POSE * values.shape[1] + _MOST

    def more(st):
        return jnp.any(~st.over & (st.count < most))

    end = lax.while_loop(more, lambda st: one(eq, values, count, stride, st), start)
    return _ended(end, count)


def _ended(end: "_State", count: Array) -> Walk:
    return Walk(end.poses, jnp.where(end.done, count, end.target), end.touched, end.base, end.s, ~end.over)


def _begin(plan: Plan, q: Array, values: Array) -> "_State":
    zero, total = jnp.zeros(()), values.shape[0]
    blank = jnp.zeros(1 + sum(len(rows) for rows, _ in plan.blocks))
    redundant = len(plan.rows) > len(plan.unknown)
    return _State(
        target=jnp.zeros((), int),
        s=zero,
        h=jnp.ones(()),
        reach=zero,
        q=q,
        guess=q,
        base=q,
        slope=jnp.zeros_like(q),
        origin=q[plan.known],
        corrections=jnp.zeros((), int),
        count=jnp.zeros((), int),
        poses=jnp.zeros((total, q.shape[0])),
        touched=jnp.zeros(total, bool),
        over=jnp.zeros((), bool),
        done=jnp.zeros((), bool),
        signs=blank,
        sizes=blank,
        rise=blank,
        reference=plan.blank() if redundant else jnp.zeros(0),
    )


def _step(plan: Plan, eq: Equations, values: Array, count: Array, stride: Array, before: "_State") -> "_State":
    """One evaluation of a walk; of one that has ended, nothing."""
    total, final = values.shape[0], count - 1
    weight = weights(eq)
    least, redundant = limits(eq.length), len(plan.rows) > len(plan.unknown)

    def size(x):
        # Among thousands of loops one that jumps does not show in a sum.
        return largest(weight * x) if plan.large else jnp.sqrt(jnp.sum((weight * x) ** 2))

    # Of a walk that has ended everything stays as it is. Its poses are many, and are only kept from being written to.
    asleep = before.over | (before.count >= _PER_POSE * total + _MOST)
    st = before
    way = values[st.target] - st.origin
    following = jnp.minimum(st.target + stride, final)
    next_way = values[following] - values[st.target]
    r, jacobian, by_known = plan.linearise(eq, st.q)
    right = jnp.stack([r, by_known @ way, by_known @ next_way], axis=1)
    x = plan.steps(eq, jacobian, right)
    finite = jnp.all(jnp.isfinite(x))
    still = jnp.zeros(len(plan.fixed))
    slope = plan.join(-x[:, 1], way, still)
    next_slope = plan.join(-x[:, 2], next_way, still)

    length = st.reach - st.s
    fresh = length == 0.0
    expected = length * size(st.slope)
    converged = finite & (largest(r) <= tolerance(eq, st.q))
    close = size(st.q - st.guess) <= _SHARP * expected + least.close * eq.length
    bend = length * size(slope - st.slope)
    smooth = fresh | (bend <= _SHARP * (expected + length * size(slope)) + least.close * eq.length)
    signs, sizes = plan.orientation(jacobian)
    ratio = signs * st.signs * jnp.exp(sizes - st.sizes)
    if redundant:
        ratio = plan.relative(jacobian, st.reference)[None]
    kept = jnp.all((ratio >= 0.0) & (1.0 + length * st.rise >= THROWN * ratio))
    kept = kept | (expected <= least.crossing * eq.length)
    good = converged & close & smooth & kept & upright(eq, st.q)
    bad = ~good & (converged | ~finite | (st.corrections >= _CORRECTIONS))

    s = jnp.where(good, st.reach, st.s)
    # The first step is a short one: it shows in which direction determinants change.
    felt = (st.s == 0.0) & (length == _FEEL)
    longer = jnp.where(fresh, _FEEL, jnp.where(felt, 1.0, 2.0 * st.h))
    h = jnp.where(good, longer, jnp.where(bad, 0.25 * length, st.h))
    arrived = good & (s >= 1.0)
    at_end = st.target >= final
    base = jnp.where(good, st.q, st.base)
    slope = jnp.where(arrived, next_slope, jnp.where(good, slope, st.slope))
    turned = (ratio - 1.0) / jnp.where(ratio == 0.0, 1.0, ratio) / jnp.where(fresh, 1.0, length)
    rise = jnp.where(good, jnp.where(fresh | (ratio == 0.0), 0.0, turned), st.rise)
    # On another way only the part of it counts that goes on in the same direction.
    square, along = jnp.sum(way * way), jnp.sum(way * next_way)
    aside = along * along < 0.99 * square * jnp.sum(next_way * next_way)
    rise = jnp.where(arrived, rise * along / jnp.where(square > 0.0, square, 1.0), rise)
    origin = jnp.where(arrived, values[st.target], st.origin)
    target = jnp.where(arrived, following, st.target)
    ended = bad & (fresh | (h < least.smallest))
    touched = ended & ~fresh & (1.0 - s < least.touch)
    written = jnp.where((arrived | touched) & ~asleep, st.target, total)
    poses = st.poses.at[written].set(base, mode="drop")
    # A limit may be touched, not passed: the walk goes on, afresh from the base, only if the way turns back.
    back = along < 0.0
    restart = touched & ~at_end & back
    over = ((arrived | touched) & at_end) | (ended & ~restart)
    done = st.done | ((arrived | touched) & at_end)
    blocked = touched & ~at_end & ~back
    target = jnp.where(blocked, target + 1, target)
    s = jnp.where(blocked, 0.0, s)
    origin = jnp.where(restart, base[plan.known], origin)
    target = jnp.where(restart, following, target)
    s = jnp.where((arrived & ~at_end) | restart, 0.0, s)
    h = jnp.where(restart, 1.0, jnp.where(arrived, jnp.where(aside, _FEEL, jnp.minimum(h, 1.0)), h))

    # Predict where the step was accepted or rejected, correct otherwise.
    predict = (good | bad) & ~restart
    reach = jnp.where(predict, jnp.where(s + h >= 1.0 - least.whole, 1.0, s + h), st.reach)
    known = jnp.where(predict, (1 - reach) * origin + reach * values[target], values[target])
    ahead = plan.join((base + (reach - s) * slope)[plan.unknown], known, base[plan.fixed])
    moved = plan.move(st.q, jnp.where(finite, -x[:, 0], 0.0))
    reach = jnp.where(restart, 0.0, reach)
    new = _State(
        target=target,
        s=s,
        h=h,
        reach=reach,
        q=jnp.where(restart, base, jnp.where(predict, ahead, moved)),
        guess=jnp.where(restart, base, jnp.where(predict, ahead, st.guess)),
        base=base,
        slope=slope,
        origin=origin,
        signs=jnp.where(good, signs, st.signs),
        sizes=jnp.where(good, sizes, st.sizes),
        rise=rise,
        reference=jnp.where(good, jacobian, st.reference) if redundant else st.reference,
        done=done,
        corrections=jnp.where(predict | restart, 0, st.corrections + 1),
        count=st.count + 1,
        poses=poses,
        touched=st.touched.at[jnp.where(touched & ~asleep, st.target, total)].set(True, mode="drop"),
        over=over,
    )
    small = [f for f in _State._fields if f not in ("poses", "touched")]
    return new._replace(**{f: jnp.where(asleep, getattr(before, f), getattr(new, f)) for f in small})


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
    looks: "Look"
    part: Array
    exhausted: Array


class Look(NamedTuple):
    """What a pose looks like.

    Attributes:
        size: largest residual of all rows, a length.
        pivots: estimate of the reciprocal condition number.
        signs: orientation signs of the diagonal blocks.
        upright: whether no row is met by a mirror image.
        mirrored: whether a body has turned into its mirror image.
    """

    size: Array
    pivots: Array
    signs: Array
    upright: Array
    mirrored: Array


def upright(eq: Equations, q: Coordinates) -> Array:
    """Whether no row and no body is met by a mirror image."""
    rows, bodies = guards(eq, q)
    return jnp.all(rows > 0.0) & jnp.all(bodies > 0.0)


def inspect(plan: Plan, eq: Equations, q: Coordinates) -> Look:
    """Look at one pose: residual, conditioning, orientation and guards, from one evaluation."""
    return _look(plan, eq, q)[0]


def _look(plan: Plan, eq: Equations, q: Coordinates) -> tuple[Look, Array]:
    _, jacobian, _ = plan.linearise(eq, q)
    rows, bodies = guards(eq, q)
    look = Look(
        largest(residual(eq, q)),
        plan.conditioning(eq, jacobian),
        plan.orientation(jacobian)[0],
        jnp.all(rows > 0.0) & jnp.all(bodies > 0.0),
        jnp.any(bodies <= 0.0),
    )
    return look, jacobian


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
        looks, jacobians = jax.vmap(lambda x: _look(plan, eq, x))(poses)

        past = ended & ((index >= seen.reached) | (in_last & (place > seen.part)))
        past = past | (ended & (seen.reached == 0))
        fits = (looks.size <= jax.vmap(lambda x: tolerance(eq, x))(poses)) & looks.upright
        signs = looks.signs
        # Signs differ between walked poses only across a change point; what lies in between is then walked as well.
        alike = jnp.all((signs[lower] == signs[upper]) | in_last[:, None], axis=1)
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
        right_branch = past | seen.touched | (fits & same & near & even)
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
