"""Continuation along a branch to input values one after the other: predict, correct, and subdivide rather than jump.

The whole way is one flat loop whose body evaluates the equations once, either for a Newton correction or, when that
has converged, to accept the step and predict the next, so that little has to be compiled. For large systems; others are
followed on the host (`jaxnc.solvers.host`).
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.solvers.evaluation import upright
from jaxnc.solvers.kernel import always, apart
from jaxnc.solvers.newton import largest, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.system.equations import Equations, weights
from jaxnc.system.precision import limits
from jaxnc.types import Array, Coordinates, Float

_SHARP = 0.2  # a correction may be this part of the predicted step
REBOUND = 0.3  # of a determinant: less was expected of it, so that it has been thrown back behind a gap
_SHORT = 1e-3  # of the way to the first value
_TURN = 1.0  # radians that a driven angle turns in a step: in a longer one, all signs may agree behind a gap by chance
_NEARER = 0.4  # of the way to where a determinant would vanish: the longest step towards it
_BESIDE = 0.1  # of that way: a value that lies so close to such a position is passed, not stopped at
_CORRECTIONS = 6
_PER_POSE = 250  # iterations, per pose of the sequence
_MOST = 50_000  # and for the way between them: about 25 for each radian that something turns


class Continued(NamedTuple):
    """How far continuation came.

    Attributes:
        poses: ``(T, N)``; only those visited are set.
        reached: index of the first target that was not reached, T if all were.
        touched: ``(T,)``, whether the branch ends at the pose (a limit of travel), so that it was not passed.
        last: the last pose on the branch.
        exhausted: whether it gave up for its number of iterations, not because the branch ends.
        between: ``(T,)``, whether the pose was interpolated where a change point was passed: Newton would spoil it.
    """

    poses: Array
    reached: Array
    touched: Array
    last: Array
    exhausted: Array
    between: Array


class _State(NamedTuple):
    target: Array  # index of the pose that is gone to
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
    between: Array
    over: Array
    done: Array


def continued(
    plan: Plan,
    eq: Equations,
    q: Coordinates,
    values: Float[Array, "T k"],
) -> Continued:
    """Walk along a branch from a pose to a sequence of input values.

    A step is accepted when Newton converges, its correction is small beside the predicted step and so is the change of
    the slope, no orientation sign changes, no determinant that fell towards zero is thrown back, and no angle jumped by
    π. The other branch, which lies across a fold, is so never taken for this one, nor its mirror image behind a narrow
    gap. At a change point, where branches cross, one short step leads from before it to behind it, straight on; what
    lies in between is interpolated, and is a pose of the mechanism only if branches do cross there.

    Args:
        plan: what is solved for.
        eq: the equations.
        q: a pose that meets them, where the walk begins.
        values: known coordinates to walk to, pose by pose.

    Returns:
        The poses and where the walk ended.
    """
    total, go = values.shape[0], always(eq)
    end = lax.while_loop(
        lambda st: ~st.over & (st.count < _PER_POSE * total + _MOST),
        lambda st: _step(plan, eq, values, go, st),
        _begin(plan, q, values),
    )
    reached = jnp.where(end.done, total, end.target)
    return Continued(end.poses, reached, end.touched, end.base, ~end.over, end.between)


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
        between=jnp.zeros(total, bool),
        over=jnp.zeros((), bool),
        done=jnp.zeros((), bool),
        signs=blank,
        sizes=blank,
        rise=blank,
        reference=plan.blank() if redundant else jnp.zeros(0),
    )


def _longest(plan: Plan, way: Array) -> Array:
    """The part of a way that may be gone in one step."""
    turned = jnp.max(jnp.abs(way[np.array(plan.angles, dtype=int)]), initial=0.0)
    return _TURN / jnp.maximum(turned, _TURN)


def _step(plan: Plan, eq: Equations, values: Array, go: Array, st: "_State") -> "_State":
    """One evaluation of a walk.

    What is decided is decided apart (see `kernel.apart`): the compiler would otherwise write it out anew for every
    number that depends on it, and compile three times as long.
    """
    total, final = values.shape[0], values.shape[0] - 1
    weight = weights(eq)
    least, redundant = limits(eq.length), len(plan.rows) > len(plan.unknown)

    def size(x):
        # Among thousands of loops one that jumps does not show in a sum.
        return largest(weight * x) if plan.large else jnp.sqrt(jnp.sum((weight * x) ** 2))

    way = values[st.target] - st.origin
    following = jnp.minimum(st.target + 1, final)
    # A value that is close to a change point is passed: then the next way does not begin there.
    next_way = values[following] - jnp.where(st.reach > 1.0, st.q[plan.known], values[st.target])
    r, jacobian, by_known = plan.linearise(eq, st.q)
    right = jnp.stack([r, by_known @ way, by_known @ next_way], axis=1)
    x = plan.steps(eq, jacobian, right)
    still = jnp.zeros(len(plan.fixed))
    slope = plan.join(-x[:, 1], way, still)
    signs, sizes = plan.orientation(jacobian)
    length = st.reach - st.s
    fresh = length == 0.0

    moved = plan.move(st.q, jnp.where(jnp.all(jnp.isfinite(x)), -x[:, 0], 0.0))

    def on_the_step(part):
        """The cubic through both ends of the step, with their slopes."""
        a, b = part * part * (3.0 - 2.0 * part), part * (1.0 - part) * length
        return st.base + a * (moved - st.base) + b * ((1.0 - part) * st.slope - part * slope)

    def crossed(ratio):
        """Whether branches cross where determinants vanish on the way: the cubic there meets all rows."""
        part = 1.0 / (1.0 - jnp.min(jnp.where(ratio < 0.0, ratio, 0.0)))
        return largest(plan.residual(eq, on_the_step(part))) <= tolerance(eq, st.q)

    def judged():
        finite = jnp.all(jnp.isfinite(x))
        expected = length * size(st.slope)
        converged = finite & (largest(r) <= tolerance(eq, st.q))
        close = size(st.q - st.guess) <= _SHARP * expected + least.close * eq.length
        bend = length * size(slope - st.slope)
        smooth = fresh | (bend <= _SHARP * (expected + length * size(slope)) + least.close * eq.length)
        ratio = signs * st.signs * jnp.exp(sizes - st.sizes)
        if redundant:
            ratio = plan.relative(jacobian, st.reference)[None]
        kept = jnp.all((ratio >= 0.0) & (1.0 + length * st.rise >= REBOUND * ratio))
        kept = kept | (expected <= least.crossing * eq.length)
        crosses = ~kept & (expected <= least.leap * eq.length) & crossed(ratio)
        good = converged & close & smooth & (kept | crosses) & upright(eq, st.q)
        bad = ~good & (converged | ~finite | (st.corrections >= _CORRECTIONS))
        turned = (ratio - 1.0) / jnp.where(ratio == 0.0, 1.0, ratio) / jnp.where(fresh, 1.0, length)
        # On another way only the part of it counts that goes on in the same direction.
        square, along = jnp.sum(way * way), jnp.sum(way * next_way)
        aside = along * along < 0.99 * square * jnp.sum(next_way * next_way)
        onward = along / jnp.where(square > 0.0, square, 1.0)
        rise = jnp.where(fresh | (ratio == 0.0), 0.0, turned)
        return good, bad, rise, onward, aside

    good, bad, turned, onward, aside = apart(go, judged)

    def decided():
        s = jnp.where(good, st.reach, st.s)
        # The first step is a short one: it shows in which direction determinants change.
        shortened = (st.s == 0.0) & (length == _SHORT)
        longer = jnp.where(fresh, _SHORT, jnp.where(shortened, 1.0, 2.0 * st.h))
        h = jnp.where(good, longer, jnp.where(bad, 0.25 * length, st.h))
        arrived = good & (s >= 1.0)
        ended = bad & (fresh | (h < least.smallest))
        touched = ended & ~fresh & (1.0 - s < least.touch)
        return s, h, arrived, ended, touched

    s, h, arrived, ended, touched = apart(go, decided)
    at_end = st.target >= final
    # A limit may be touched, not passed: the walk goes on, afresh from the base, only if the way turns back.
    restart = touched & ~at_end & (onward < 0.0)
    blocked = touched & ~at_end & ~restart
    predict = (good | bad) & ~restart
    base = jnp.where(good, moved, st.base)
    passing = arrived & (st.reach > 1.0)
    here = jnp.where(passing, on_the_step((1.0 - st.s) / jnp.where(fresh, 1.0, length)), base)

    def onwards():
        target = jnp.where(arrived | restart, following, st.target + blocked)
        begun = jnp.where((arrived & ~at_end) | touched & ~at_end, 0.0, s)
        longest = _longest(plan, jnp.where(arrived | restart, next_way, way))
        step = jnp.where(restart, 1.0, jnp.where(arrived, jnp.where(aside, _SHORT, jnp.minimum(h, 1.0)), h))
        room = 1.0 - begun
        step = jnp.minimum(jnp.minimum(step, longest), room)
        origin = jnp.where(restart | arrived, base[plan.known], st.origin)
        next_slope = plan.join(-x[:, 2], next_way, still)
        ahead = jnp.where(arrived, next_slope, jnp.where(good, slope, st.slope))
        # Where a determinant would vanish, if it went on as it did, and the step over it.
        fall = jnp.max(-jnp.where(arrived, turned * onward, turned))
        far = jnp.where(good & (fall > 0.0), 1.0 / jnp.where(fall > 0.0, fall, 1.0), jnp.inf)
        towards = step > _NEARER * far
        leaps = towards & (2.0 * far * size(ahead) <= least.leap * eq.length)
        stops = (room <= (1.0 - _BESIDE) * far) | ((room >= (1.0 + _BESIDE) * far) & (room <= 2.0 * far))
        step = jnp.where(leaps, jnp.where(stops, room, 2.0 * far), jnp.where(towards, _NEARER * far, step))
        whole = (begun + step >= 1.0 - least.whole) & ~(leaps & ~stops)
        reach = jnp.where(whole, 1.0, begun + step)
        reach = jnp.where(restart, 0.0, jnp.where(predict, reach, st.reach))
        return target, begun, step, reach, origin, ahead

    target, s, h, reach, origin, slope = apart(go, onwards)
    # Predict where the step was accepted or rejected, correct otherwise.
    known = jnp.where(predict, (1 - reach) * origin + reach * values[target], values[target])
    ahead = plan.join((base + (reach - s) * slope)[plan.unknown], known, base[plan.fixed])
    rise = jnp.where(good, turned, st.rise)
    written = jnp.where(arrived | touched, st.target, total)
    return _State(
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
        rise=jnp.where(arrived, rise * onward, rise),
        reference=jnp.where(good, jacobian, st.reference) if redundant else st.reference,
        done=st.done | ((arrived | touched) & at_end),
        corrections=jnp.where(good | bad, 0, st.corrections + 1),
        count=st.count + 1,
        poses=st.poses.at[written].set(here, mode="drop"),
        between=st.between.at[written].set(passing, mode="drop"),
        touched=st.touched.at[jnp.where(touched, st.target, total)].set(True, mode="drop"),
        over=((arrived | touched) & at_end) | (ended & ~restart),
    )
