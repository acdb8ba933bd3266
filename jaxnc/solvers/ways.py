"""Lanes on their straight ways from the start pose to their inputs, each in steps as long as its checks allow.

A step is tried from an extrapolation of the last one, solved, and checked as everywhere. What is left of a branch that
ends on the way is told by the determinants, which fall to zero as the root of it.
"""

import functools
import itertools
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.solvers.branch import FIRST, SHARP, SHORT, STEP, steady
from jaxnc.solvers.continuation import length_of, on_branch
from jaxnc.solvers.kernel import always, apart, kernel
from jaxnc.solvers.plan import Plan, unwound
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.system.equations import Equations
from jaxnc.system.precision import limits
from jaxnc.types import Array, Coordinates, Float

_SHORTEST = 1e-6  # of the way from the start pose to a lane: what is left of a branch that has ended
_UNLIKELY = 0.02  # of the way from a point of a table: lanes with a fold so near rather go from the start pose
_SHORTER = 0.25  # of a step that was refused is the next one, at least
_EASY = 0.5  # of what a step may bend is aimed at
_TOWARDS = 0.75  # of what is left before a fold is a step
_BENT = 8.0  # steps before a fold the way is bent
_FAR = 1e6  # times the way: no fold is foretold
_NARROW = 128  # lanes at least that go together
_KEPT = 8192  # numbers of their poses: they stay in the cache
_FEW = 4096  # lanes: of so many, the last of which take a good part of the time, three times fewer go together
_EVEN = 64  # lanes go together by multiples of so many: code without remainders is sooner compiled, and quicker
_MOST = 8  # steps that lanes try before those that are not there yet are put together
_TURNS = 18  # times that they are
_SOON = 6  # of those of a table's points: lanes can do without the last of them
_BLOCK = 8192  # lanes of a block: they stay in the cache
_POINTS = {2: 17, 3: 9}  # of a table of poses, along each input
_WORTH = 4  # times as many lanes as it has points, from which it pays


class _Ways(NamedTuple):
    """Where lanes are on their straight ways, which have the length 1, from the start pose or from a table's point."""

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
    base: Array  # known coordinates at the beginning ``(k, lanes)``
    aside: Array  # one where the way begins at a point of the table, zero where at the start pose

    @property
    def before_fold(self) -> Array:
        """Which lanes stand before a fold, clearly before their goal.

        Of narrow numbers it is not told: rounding alone makes determinants fall.
        """
        told = jnp.finfo(self.at.dtype).eps < _SHORTEST**2
        short = jnp.where(self.aside > 0.0, _UNLIKELY, _SHORTEST)
        return told & (self.at > 0.0) & (self.left < short) & (self.at + 4.0 * self.left < 1.0)

    @property
    def ended(self) -> Array:
        """Which lanes stand where their branch ends on the way from the start pose."""
        return self.before_fold & (self.aside == 0.0)

    @property
    def open(self) -> Array:
        """Which lanes go on along their ways."""
        return (self.at < 1.0) & (self.step >= 0.1 * _SHORTEST) & ~self.before_fold

    @property
    def undecided(self) -> Array:
        """Which lanes go on, or must go the way from the start pose instead."""
        return self.open | ((self.at < 1.0) & (self.aside > 0.0))

    @property
    def point(self) -> tuple[Array, ...]:
        """What a table keeps of its points."""
        return self.now, self.facing, self.at

    @property
    def result(self) -> tuple[Array, ...]:
        """What is kept of lanes that go no farther."""
        return self.now, self.told, self.at, self.ended.astype(self.at.dtype)


def follow(plan: Plan, eq: Equations, q: Coordinates, values: Float[Array, "lanes k"]) -> PoseBatch:
    """Follow every lane along the straight way from the start pose, in steps as long as its checks allow.

    Lanes that are not there yet are put together again and again, so that no others go along with them. If there are
    many, the points of a table of poses go first. Lanes among points that were reached then try all their way at once,
    and if that fails go from the nearest one, if it was reached; the way from the start pose has the last word.
    """
    core, (given, k) = kernel(plan), values.shape
    driven, unknown = [int(c) for c in plan.known[:k]], [int(c) for c in plan.unknown]
    start, go = [q[c] for c in range(q.shape[0])], always(eq)
    outset = apart(go, lambda: core.determinants(eq, start))
    signs, origin, turning = [jnp.sign(d) for d in outset], q[np.array(driven)], plan.periodic[:k]
    near = jnp.where(turning, jnp.round((values - origin) / (2 * jnp.pi)), 0.0) if turning.any() else None
    goals = (values if near is None else unwound(values, near)).T
    block = min(given, _BLOCK)
    width = max(_NARROW, (_KEPT if given > _FEW else _KEPT // 3) // len(unknown))
    width = min(block, _EVEN * -(-block // -(-block // width) // _EVEN))
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
        for c, o, u in zip(driven, ways.base, ways.goal, strict=True):
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

    def begin(goal: Array) -> _Ways:
        """Put lanes at the start pose."""
        at_start = origin, jnp.stack([start[c] for c in unknown]), jnp.stack(outset)
        base, now, facing = (jnp.broadcast_to(x[:, None], (len(x), width)) for x in at_start)
        return set_off(goal, base, now, facing, jnp.zeros(width))

    def set_off(goal: Array, base: Array, now: Array, facing: Array, aside: Array) -> _Ways:
        zero = jnp.zeros(width)
        turned = [jnp.abs(goal[a] - base[a]) for a in plan.angles if a < k]
        longest = STEP / functools.reduce(jnp.maximum, turned, jnp.full(width, STEP))
        step, told, left = jnp.minimum(longest, 1.0), jnp.stack([zero, zero + 1.0]), zero + _FAR
        return _Ways(zero, zero, step, longest, now, now, facing, facing, left, told, goal, base, aside)

    def table(goal: Array, first: Array, rows: Array) -> _Ways:
        """Put points of a table in place of lanes; those beyond the last point rest."""
        place = first + np.arange(width)
        steps = jnp.stack([place // points ** (k - 1 - i) % points for i in range(k)]) / (points - 1)
        ways = begin(low[:, None] + (high - low)[:, None] * steps)
        return ways._replace(at=jnp.where(place < points**k, ways.at, 1.0))

    def nearest_reached(place: Array, reached: Array) -> Array:
        """Choose of the points around each lane the nearest one that was reached, if any was: places ``(k, lanes)``."""
        cell = jnp.clip(place.astype(np.int32), 0, points - 2)
        best = jnp.clip(jnp.round(place).astype(np.int32), 0, points - 1)

        def choose():
            chosen, least = best, jnp.full(width, jnp.inf)
            for corner in itertools.product(range(2), repeat=k):
                point = cell + np.array(corner, np.int32)[:, None]
                good = reached[functools.reduce(lambda index, own: index * points + own, point)]
                far = jnp.where(good, jnp.sum((place - point) ** 2, axis=0), jnp.inf)
                chosen, least = jnp.where(far < least, point, chosen), jnp.minimum(far, least)
            return chosen

        return lax.cond(jnp.all(reached), lambda: best, choose)

    def try_at_once(goal: Array, first: Array, rows: Array) -> _Ways:
        """Have those lanes that lie among reached points go all their way at once."""
        reached = rows[-1, :size] == 1.0
        span = jnp.where(high > low, high - low, 1.0)[:, None]
        place = (points - 1) * jnp.where(high > low, 1.0, 0.0)[:, None] * (goal - low[:, None]) / span
        guess, inside = interpolate(list(place), rows[:n], reached, jnp.all(reached), points)
        point = nearest_reached(place, reached)
        found = rows[:, functools.reduce(lambda index, own: index * points + own, point)]
        aside = found[-1] == 1.0
        ways, base = begin(goal), low[:, None] + span * point / (points - 1)
        ways = set_off(
            goal,
            jnp.where(aside, base, ways.base),
            jnp.where(aside, found[:n], ways.now),
            jnp.where(aside, found[n:-1], ways.facing),
            aside.astype(base.dtype),
        )
        # As if a step as long lay behind, after which the next one is expected to end at the guess.
        return ways._replace(
            before=jnp.where(inside, -1.0, 0.0),
            then=jnp.where(inside, 2.0 * ways.now - guess, ways.now),
            step=jnp.where(inside, 1.0, ways.step),
        )

    def walk(j: Array, first: Array, made: Array, rows: Array, store: Array) -> tuple[Array, Array, Array]:
        """Have the lanes of a block go as far as they come; what became of them is put into its place.

        Most lanes are there in the first turn, chunk by chunk. The others are kept, and go on together.
        """
        at_table = (j == 0) & tabled
        count = jnp.where(at_table, -(-size // width), -(-block // width))

        def set_out(at: Array, *_: Array) -> _Ways:
            goal = lax.dynamic_slice_in_dim(goals, first + at, width, 1)
            return lax.cond(at_table, table, try_at_once, goal, at, rows) if tabled else begin(goal)

        def go_on(at: Array, going: Array, store: Array) -> _Ways:
            ways = _unpack(lax.dynamic_slice_in_dim(store, at, width, 1), counts)
            lost = ways.undecided & ~ways.open
            ways = jax.tree.map(lambda a, b: jnp.where(lost, a, b), begin(ways.goal), ways)
            # In the columns of lanes that do not go on stands anything.
            return ways._replace(step=jnp.where(lax.dynamic_slice_in_dim(going, at, width), ways.step, 0.0))

        def chunk(c, state):
            turn, made, rows, going, store = state
            at = jnp.minimum(c * width, block - width)  # the last chunk overlaps the one before
            ways = lax.cond(turn == 0, set_out, go_on, at, going, store)
            most = jnp.where(turn == 0, 2, _MOST)
            _, ways = lax.while_loop(lambda st: (st[0] < most) & jnp.any(st[1].open), advance, (0, ways))
            goes = ways.undecided & ((turn == 0) | lax.dynamic_slice_in_dim(going, at, width))
            going = lax.dynamic_update_slice_in_dim(going, goes, at, 0)
            made = _once((turn == 0) & ~at_table, lambda made: _put(made, ways.result, first + at), made)
            if tabled:
                rows = _once((turn == 0) & at_table, lambda rows: _put(rows, ways.point, at), rows)
            keeps = (turn > 0) | jnp.any(goes)
            store = _once(keeps, lambda store: _put(store, ways, at), store)
            return turn, made, rows, going, store

        def together(state):
            """Put the lanes that go on in front of the others."""
            order, going, store = state
            place = jnp.argsort(~going)
            return order[place], going[place], store[:, place]

        def again(state):
            turn, some, order, went, made, rows, going, store = state
            left = jnp.where(turn == 0, count, -(-jnp.sum(going) // width))
            order, going, store = _once((turn == 1) | (left < some), together, (order, going, store))
            _, made, rows, going, store = lax.fori_loop(0, left, chunk, (turn, made, rows, going, store))
            return turn + 1, left, order, jnp.where(turn == 0, going, went), made, rows, going, store

        turns = jnp.where(at_table, _SOON, _TURNS)
        none = jnp.zeros(block, bool)
        turn, _, order, went, made, rows, _, store = lax.while_loop(
            lambda st: (st[0] < turns) & ((st[0] == 0) | jnp.any(st[-2])),
            again,
            (jnp.zeros((), int), count, jnp.arange(block), none, made, rows, none, store),
        )

        def put_back(old: Array, new: Callable[[_Ways], Iterable[Array]], at: Array) -> Array:
            part = lax.dynamic_slice_in_dim(old, at, block, 1)
            ways = _unpack(store[:, jnp.argsort(order)], counts)
            return lax.dynamic_update_slice_in_dim(old, jnp.where(went, _put(part, new(ways), 0), part), at, 1)

        made = _once((turn > 1) & ~at_table, lambda made: put_back(made, lambda ways: ways.result, first), made)
        if tabled:
            rows = _once((turn > 1) & at_table, lambda rows: put_back(rows, lambda ways: ways.point, first), rows)
        return made, rows, store

    def blocks(j, state):
        """Solve a block of lanes; before all of them the table, by the same program."""
        first = jnp.clip((j - tabled) * block, 0, given - block)  # the last block overlaps the one before
        return walk(j, first, *state)

    n, size = len(unknown), points**k if tabled else 0
    counts = (*(None,) * 4, n, n, len(outset), len(outset), None, 2, k, k, None)  # rows of each field, if it has any
    store = jnp.zeros((sum(count or 1 for count in counts), block))
    state = jnp.zeros((n + 4, given)), jnp.zeros((n + len(outset) + 1, block if tabled else 0)), store
    made, *_ = lax.fori_loop(0, -(-given // block) + tabled, blocks, state)
    *now, residuals, pivots, at, ended = made
    good = at == 1.0
    known, ended = origin[:, None] + at * (goals - origin[:, None]), ended > 0.0
    if near is not None:
        known, ended = known + (2 * jnp.pi) * near.T, ended & jnp.all(near == 0.0, axis=1)
    return PoseBatch(tuple(now), residuals, pivots, good, ended, tuple(jnp.where(good, values.T, known)))


def _put(store: Array, arrays: Iterable[Array], at: Any) -> Array:
    """Put arrays of lanes below each other, beginning in a column."""
    row = 0
    for a in arrays:
        a = a if a.ndim > 1 else a[None]
        store = lax.dynamic_update_slice(store, a, (row, at))
        row += len(a)
    return store


def _unpack(packed: Array, counts: tuple[int | None, ...]) -> _Ways:
    parts = lax.split(packed, [count or 1 for count in counts])
    return _Ways(*(part[0] if count is None else part for part, count in zip(parts, counts, strict=True)))


def _once(go: Array, f: Callable[[Any], Any], x: Any) -> Any:
    """Apply a function, or do nothing: a loop that is not entered leaves arrays in place, and a `cond` copies them."""
    return lax.while_loop(lambda state: state[0], lambda state: (jnp.zeros((), bool), f(state[1])), (go, x))[1]


def interpolate(
    place: list[Array], table: Array, reached: Array, all_reached: Array, points: int
) -> tuple[Array, Array]:
    """Interpolate multilinearly in each row of a table, and say whether all its points around are on the branch.

    Places are along each input, in steps of the table.
    """

    def around():
        index, parts = jnp.zeros(place[0].shape, np.int32), []
        for own in place:
            cell = jnp.clip(own.astype(np.int32), 0, points - 2)
            parts.append(own - cell)
            index = index * points + cell
        k = len(place)
        return [
            (index + sum(b * points ** (k - 1 - i) for i, b in enumerate(corner)), corner, parts)
            for corner in itertools.product(range(2), repeat=k)
        ]

    inside = lax.cond(
        all_reached,
        lambda: jnp.ones(place[0].shape, bool),
        lambda: functools.reduce(jnp.logical_and, [reached[at] for at, _, _ in around()]),
    )
    guess = jnp.zeros((table.shape[0], *place[0].shape))
    for at, corner, parts in around() if table.shape[0] else ():
        share = functools.reduce(jnp.multiply, [p if b else 1.0 - p for b, p in zip(corner, parts, strict=True)])
        guess = guess + share * table[:, at]
    return guess, inside
