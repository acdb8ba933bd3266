"""Lanes on their straight ways from the start pose to their inputs, each in steps as long as its checks allow.

A step is tried from an extrapolation of the last one, solved, and checked as everywhere. What is left of a branch that
ends on the way is told by the determinants, which fall to zero as the root of it.
"""

import functools
import itertools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.solvers.continuation import FIRST, SHORT, STEP, Filled, length_of, on_branch, steady
from jaxnc.solvers.host.judge import SHARP
from jaxnc.solvers.kernel import always, apart, kernel
from jaxnc.solvers.plan import Plan, unwound
from jaxnc.system.equations import Equations
from jaxnc.system.precision import limits
from jaxnc.types import Array, Coordinates, Float

_SHORTEST = 1e-6  # of the way from the start pose to a lane: what is left of a branch that has ended
_SHORTER = 0.25  # of a step that was refused is the next one, at least
_EASY = 0.5  # of what a step may bend is aimed at
_TOWARDS = 0.75  # of what is left before a fold is a step
_BENT = 8.0  # steps before a fold the way is bent
_FAR = 1e6  # times the way: no fold is foretold
_NARROW = 256  # lanes at least that go together
_KEPT = 8192  # numbers of their poses: they stay in the cache
_MOST = 8  # steps that lanes try before those that are not there yet are put together
_TURNS = 18  # times that they are
_SOON = 3  # of those of a table's points: lanes can do without the last of them
_BLOCK = 8192  # lanes of a block: they stay in the cache
_POINTS = {2: 17, 3: 9}  # of a table of poses, along each input
_WORTH = 4  # times as many lanes as it has points, from which it pays


class _Ways(NamedTuple):
    """Where lanes are on their straight ways from the start pose, which have the length 1."""

    at: Array  # the part that is behind them
    before: Array  # what it was a step ago
    step: Array  # the part that is tried next
    longest: Array  # the longest that may be: a driven angle turns no farther
    now: Array  # unknown coordinates there ``(n, lanes)``
    then: Array  # what they were a step ago
    facing: Array  # determinants there ``(blocks, lanes)``
    faced: Array  # what they were a step ago
    left: Array  # the part after which a determinant will have fallen to zero, going by the last step
    told: Array  # largest residual and conditioning ``(2, lanes)``
    goal: Array  # known coordinates at the end ``(k, lanes)``

    @property
    def ended(self) -> Array:
        """Which lanes stand before the fold at which their branch ends, clearly before their goal.

        Of narrow numbers it is not told: rounding alone makes determinants fall.
        """
        told = jnp.finfo(self.at.dtype).eps < _SHORTEST**2
        return told & (self.at > 0.0) & (self.left < _SHORTEST) & (self.at + 4.0 * self.left < 1.0)

    @property
    def open(self) -> Array:
        """Which lanes go on."""
        return (self.at < 1.0) & (self.step >= 0.1 * _SHORTEST) & ~self.ended


def follow(plan: Plan, eq: Equations, q: Coordinates, values: Float[Array, "lanes k"]) -> Filled:
    """Follow every lane along the straight way from the start pose, in steps as long as its checks allow.

    Lanes that are not there yet are put together again and again, so that no others go along with them. If there are
    many, the points of a table of poses go first; lanes among points that were reached then try all their way at once.
    """
    core, (given, k) = kernel(plan), values.shape
    driven, unknown = [int(c) for c in plan.known[:k]], [int(c) for c in plan.unknown]
    start, go = [q[c] for c in range(q.shape[0])], always(eq)
    outset = apart(go, lambda: core.determinants(eq, start))
    signs, origin, turning = [jnp.sign(d) for d in outset], q[np.array(driven)], plan.periodic[:k]
    near = jnp.where(turning, jnp.round((values - origin) / (2 * jnp.pi)), 0.0)
    goals = unwound(values, near).T
    block = min(given, _BLOCK)
    width = min(block, max(_NARROW, _KEPT // len(unknown)))
    norm, least = length_of(plan, eq), limits(eq.length)
    points = _POINTS.get(k, given)
    tabled = given >= _WORTH * points**k
    low, high = jnp.min(goals, axis=1), jnp.max(goals, axis=1)

    def full(these):
        return tuple(jnp.broadcast_to(v, (width,)) for v in these)

    def advance(state):
        """Try the next step of some lanes: where it passes the checks it is made, elsewhere a shorter one is next."""
        i, ways = state
        # A first step, and one after a step that was refused, is a short one: it shows where the way goes.
        fresh = ways.at == ways.before
        ahead = jnp.where(fresh, SHORT, 1.0) * ways.step
        at = jnp.where(ways.at + ahead >= 1.0 - SHORT * ahead, 1.0, ways.at + ahead)
        behind = jnp.where(fresh, 1.0, ways.at - ways.before)
        ratio = jnp.where(fresh, 0.0, (at - ways.at) / behind)
        # Towards a fold poses change as the root of what is left.
        roots = [jnp.sqrt(jnp.maximum(ways.left + part, 0.0)) for part in (behind, 0.0, ways.at - at)]
        bent = ways.left < _BENT * behind
        change = jnp.where(bent, (roots[1] - roots[2]) / (roots[0] - roots[1]), ratio)
        guess = ways.now + change * (ways.now - ways.then)
        x = list(start)
        for c, v in zip(unknown, guess, strict=True):
            x[c] = v
        for c, o, u in zip(driven, origin, ways.goal, strict=True):
            x[c] = o + at * (u - o)
        found = core.solve(eq, x, signs)
        facing, told = apart(go, lambda: (full(found.determinants), full((found.size, found.pivots))))
        found = found._replace(determinants=facing, size=told[0], pivots=told[1])
        (kept,) = apart(go, lambda: full([on_branch(eq, found, signs, at < 1.0)]))
        y = full(found.x[c] for c in unknown)

        def judge() -> tuple[Array, ...]:
            """Say whether the step is made, how long the next one is after it and elsewhere, and what is left."""
            step = norm([a - b for a, b in zip(y, ways.now, strict=True)])
            off = norm([a - b for a, b in zip(y, guess, strict=True)])
            sharp = off / (SHARP * step + least.close * eq.length)
            if not core.guessed:  # there is one solution of each orientation, however far it is
                step, sharp = jnp.zeros_like(step), jnp.zeros_like(sharp)
            close = jnp.where(fresh, step <= FIRST * eq.length, sharp <= 1.0)
            rise = [a - b for a, b in zip(ways.facing, ways.faced, strict=True)]
            good = ways.open & kept & close & steady(facing, ways.facing, rise, ratio)
            fall = (ways.facing**2 - jnp.stack(facing) ** 2) / (at - ways.at)
            towards = jnp.stack(facing) ** 2 / jnp.where(fall > 0.0, fall, 1.0)
            left = jnp.min(jnp.where(fall > 0.0, towards, _FAR), axis=0)
            bend = _EASY / jnp.maximum(sharp, 0.1 * _EASY)  # times as long a step would bend as much as it may
            again = bend * (ahead + jnp.where(fresh, 0.0, behind)) - ahead
            longer = jnp.where(fresh, ways.step, jnp.clip(again, 0.4 * ahead, 2.0 * ahead))
            longer = jnp.minimum(jnp.minimum(longer, ways.longest), jnp.maximum(_TOWARDS * left, _SHORTEST))
            shorter = jnp.clip(jnp.where(kept & ~fresh, bend, 0.0), _SHORTER, 0.5) * ways.step
            return full((good, longer, shorter, left))

        good, longer, shorter, left = apart(go, judge)
        facing, told = jnp.stack(facing), jnp.stack(told)
        new = ways._replace(at=at, before=ways.at, step=longer, left=left, told=told)
        new = new._replace(now=jnp.stack(y), then=ways.now, facing=facing, faced=ways.facing)
        old = ways._replace(step=shorter, before=ways.at, then=ways.now, faced=ways.facing)
        old = jax.tree.map(lambda a, b: jnp.where(ways.open, a, b), old, ways)
        return i + 1, jax.tree.map(lambda a, b: jnp.where(good, a, b), new, old)

    def chunk(j, state):
        most, ways = state
        at = jnp.minimum(j * width, block - width)  # the last chunk overlaps the one before
        some = jax.tree.map(lambda a: lax.dynamic_slice_in_dim(a, at, width, a.ndim - 1), ways)
        _, some = lax.while_loop(lambda st: (st[0] < most) & jnp.any(st[1].open), advance, (0, some))
        return most, jax.tree.map(lambda a, b: lax.dynamic_update_slice_in_dim(a, b, at, a.ndim - 1), ways, some)

    def sorted_by(place, state):
        return jax.tree.map(lambda a: jnp.take(a, place, axis=a.ndim - 1), state)

    def again(state):
        turn, *lanes = state
        # Those that go on come first.
        order, ways = lax.cond(
            turn > 0, lambda of: sorted_by(jnp.argsort(~of[1].open), of), lambda of: of, tuple(lanes)
        )
        some = -(-jnp.sum(ways.open) // width)
        return turn + 1, order, lax.fori_loop(0, some, chunk, (jnp.where(turn > 0, _MOST, 2), ways))[1]

    def begin(goal: Array) -> _Ways:
        """Put the lanes of a block at the start pose."""
        still, sides = (
            jnp.broadcast_to(jnp.stack(x)[:, None], (len(x), block)) for x in ([start[c] for c in unknown], outset)
        )
        zero = jnp.zeros(block)
        turned = [jnp.abs(goal[a] - origin[a]) for a in plan.angles if a < k]
        longest = STEP / functools.reduce(jnp.maximum, turned, jnp.full(block, STEP))
        step, told, left = jnp.minimum(longest, 1.0), jnp.stack([zero, zero + 1.0]), zero + _FAR
        return _Ways(zero, zero, step, longest, still, still, sides, sides, left, told, goal)

    def walk(ways: _Ways, most: Any) -> _Ways:
        """Have the lanes go as far as they come."""
        first = jnp.zeros((), int), jnp.arange(block), ways
        turn, order, ways = lax.while_loop(lambda st: (st[0] < most) & jnp.any(st[2].open), again, first)
        return lax.cond(turn > 1, lambda of: sorted_by(jnp.argsort(order), of), lambda of: of, ways)

    def table(goal: Array, rows: Array, reached: Array) -> _Ways:
        """Put the points of a table in place of the first lanes; the others rest."""
        place = np.arange(block)
        steps = np.stack([place // points ** (k - 1 - i) % points for i in range(k)]) / (points - 1)
        ways = begin(low[:, None] + (high - low)[:, None] * steps)
        return ways._replace(at=jnp.where(place < points**k, ways.at, 1.0))

    def try_at_once(goal: Array, rows: Array, reached: Array) -> _Ways:
        """Have those lanes that lie among reached points go all their way at once."""
        scale = jnp.where(high > low, (points - 1) / jnp.where(high > low, high - low, 1.0), 0.0)
        guess, inside = interpolate(list(goal), low, scale, rows, reached, jnp.all(reached), points)
        ways = begin(goal)
        # As if a step as long lay behind, after which the next one is expected to end at the guess.
        return ways._replace(
            before=jnp.where(inside, -1.0, 0.0),
            then=jnp.where(inside, 2.0 * ways.now - guess, ways.now),
            step=jnp.where(inside, 1.0, ways.step),
        )

    def blocks(j, state):
        """Solve a block of lanes; before all of them the table, by the same program."""
        made, rows, reached = state
        first = jnp.clip((j - tabled) * block, 0, given - block)  # the last block overlaps the one before
        goal = lax.dynamic_slice_in_dim(goals, first, block, 1)
        if tabled:
            ways = walk(lax.cond(j == 0, table, try_at_once, goal, rows, reached), jnp.where(j == 0, _SOON, _TURNS))
            size = points**k
            rows = jnp.where(j == 0, ways.now[:, :size], rows)
            reached = jnp.where(j == 0, ways.at[:size] == 1.0, reached)
        else:
            ways = walk(begin(goal), _TURNS)
        new = ways.now, ways.told, ways.at, ways.ended
        made = tuple(lax.dynamic_update_slice_in_dim(a, b, first, a.ndim - 1) for a, b in zip(made, new, strict=True))
        return made, rows, reached

    n, size = len(unknown), points**k if tabled else 0
    # Of different numbers, as XLA makes one array of equal ones, and then copies it for each to be written to.
    blank = jnp.zeros((n, given)), jnp.ones((2, given)), jnp.full(given, 2.0), jnp.zeros(given, bool)
    state = blank, jnp.zeros((n, size)), jnp.zeros(size, bool)
    (now, told, at, ended), *_ = lax.fori_loop(0, -(-given // block) + tabled, blocks, state)
    good = at == 1.0
    known = origin[:, None] + at * (goals - origin[:, None]) + (2 * jnp.pi) * near.T
    ended = ended & jnp.all(near == 0.0, axis=1)
    return Filled(tuple(now), told[0], told[1], good, ended, tuple(jnp.where(good, values.T, known)))


def interpolate(
    u: list[Array], low: Array, scale: Array, table: Array, reached: Array, all_reached: Array, points: int
) -> tuple[Array, Array]:
    """Interpolate multilinearly in each row of a table, and say whether all its points around are on the branch."""
    k = len(u)

    def around():
        index, parts = jnp.zeros(u[0].shape, np.int32), []
        for i in range(k):
            place = (u[i] - low[i]) * scale[i]
            cell = jnp.clip(place.astype(np.int32), 0, points - 2)
            parts.append(place - cell)
            index = index * points + cell
        return [
            (index + sum(b * points ** (k - 1 - i) for i, b in enumerate(corner)), corner, parts)
            for corner in itertools.product(range(2), repeat=k)
        ]

    inside = lax.cond(
        all_reached,
        lambda: jnp.ones(u[0].shape, bool),
        lambda: functools.reduce(jnp.logical_and, [reached[at] for at, _, _ in around()]),
    )
    guess = jnp.zeros((table.shape[0], *u[0].shape))
    for at, corner, parts in around() if table.shape[0] else ():
        share = functools.reduce(jnp.multiply, [p if b else 1.0 - p for b, p in zip(corner, parts, strict=True)])
        guess = guess + share * table[:, at]
    return guess, inside
