"""Lanes on their straight ways from the start pose to their inputs, each in steps as long as its checks allow.

A step is tried from an extrapolation of the last one, solved, and checked as everywhere. What is left of a branch that
ends on the way is told by the determinants, which fall to zero as the root of it.
"""

import functools
import itertools
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.compiling import at_a_time
from jaxnc.solvers.branch import FIRST, SHARP, SHORT, STEP, steady
from jaxnc.solvers.kernel import fusion_barrier, kernel, length_of, on_branch, opaque_true
from jaxnc.solvers.plan import Plan, unwind
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.system.equations import Equations
from jaxnc.system.precision import limits
from jaxnc.types import Array, ArrayLike, Coordinates, Float, PyTree

_SHORTEST = 1e-6  # of the way from the start pose to a lane: what is left of a branch that has ended
_FAR = 1e6  # times the way: no fold is foretold
_KEPT = 8192  # numbers of their poses: they stay in the cache
_FEW = 4096  # lanes: of so many, the last of which take a good part of the time, three times fewer go together
_POINTS = {2: 17, 3: 9}  # of a table of poses, along each input


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
        """Lanes that stand before a fold, clearly before their goal.

        Of narrow numbers it is not told: rounding alone makes determinants fall.
        """
        told = jnp.finfo(self.at.dtype).eps < _SHORTEST**2
        # lanes with a fold so near to a point of the table rather go from the start pose
        short = jnp.where(self.aside > 0.0, 0.02, _SHORTEST)
        return told & (self.at > 0.0) & (self.left < short) & (self.at + 4.0 * self.left < 1.0)

    @property
    def ended(self) -> Array:
        """Lanes that stand where their branch ends on the way from the start pose."""
        return self.before_fold & (self.aside == 0.0)

    @property
    def open(self) -> Array:
        """Lanes that go on along their ways."""
        return (self.at < 1.0) & (self.step >= 0.1 * _SHORTEST) & ~self.before_fold

    @property
    def undecided(self) -> Array:
        """Lanes that go on, or must go the way from the start pose instead."""
        return self.open | ((self.at < 1.0) & (self.aside > 0.0))

    @property
    def point(self) -> tuple[Array, ...]:
        """The part of a table's points that is kept."""
        return self.now, self.facing, self.at

    @property
    def result(self) -> tuple[Array, ...]:
        """The part of lanes that is kept when they go no farther."""
        return self.now, self.told, self.at, self.ended.astype(self.at.dtype)


def follow_ways(plan: Plan, eq: Equations, q: Coordinates, values: Float[Array, "lanes k"]) -> PoseBatch:
    """Follow every lane along the straight way from the start pose, in steps as long as its checks allow.

    Lanes that are not there yet are put together again and again, so that no others go along with them. If there are
    many, the points of a table of poses go first. Lanes among points that were reached then try all their way at once,
    and if that fails go from the nearest one, if it was reached; the way from the start pose has the last word.
    """
    routes = _Routes(plan, eq, q, values)
    made = routes.walk_all()
    *now, residuals, pivots, at, ended = made
    good = at == 1.0
    known, ended = routes.origin[:, None] + at * (routes.goals - routes.origin[:, None]), ended > 0.0
    if routes.turns is not None:
        known = known + (2 * jnp.pi) * routes.turns.T
        ended = ended & jnp.all(routes.turns == 0.0, axis=1)
    return PoseBatch(tuple(now), residuals, pivots, good, ended, tuple(jnp.where(good, values.T, known)))


class _Routes:
    """The ways of all lanes of one design, and what is done to lanes on them; `width` of them go together.

    Attributes:
        plan, eq, core: what is solved for, of which design, and the kernel that does it.
        start, origin: coordinates of the start pose, and its known coordinates.
        outset, signs: determinants there, and their signs.
        goals, turns: known coordinates at the end ``(k, lanes)``, and whole turns that were taken off them.
        low, high: the smallest and the largest of them, between which the table has `points` along each input.
        given, block, width: how many lanes there are, are in a block, and go together.
        tabled: whether there is a table.
    """

    def __init__(self, plan: Plan, eq: Equations, q: Coordinates, values: Array):
        self.plan, self.eq, self.core, (self.given, k) = plan, eq, kernel(plan), values.shape
        self.driven, self.unknown = [int(c) for c in plan.known[:k]], [int(c) for c in plan.unknown]
        self.start, self.go = [q[c] for c in range(q.shape[0])], opaque_true(eq)
        self.outset = fusion_barrier(self.go, lambda: self.core.determinants(eq, self.start))
        self.signs, self.origin = [jnp.sign(d) for d in self.outset], q[np.array(self.driven)]
        turning = plan.periodic[:k]
        near = jnp.where(turning, jnp.round((values - self.origin) / (2 * jnp.pi)), 0.0) if turning.any() else None
        self.turns, self.goals = near, (values if near is None else unwind(values, near)).T
        self.block = min(self.given, at_a_time(8192))  # 8192 lanes stay in the cache
        width = max(128, at_a_time(_KEPT if self.given > _FEW else _KEPT // 3) // len(self.unknown))
        even = 64  # code without remainders is sooner compiled, and quicker
        self.width = min(self.block, even * -(-self.block // -(-self.block // width) // even))
        self.norm, self.least = length_of(plan, eq), limits(eq.length)
        self.points = _POINTS.get(k, self.given)
        self.tabled = self.given >= 4 * self.points**k  # a table pays from 4 times as many lanes as it has points
        self.low, self.high = jnp.min(self.goals, axis=1), jnp.max(self.goals, axis=1)
        n, blocks = len(self.unknown), len(self.outset)
        self.size = self.points**k if self.tabled else 0
        # Rows that each field of `_Ways` has in a packed array; None for a field that is one row.
        self.counts = (*(None,) * 4, n, n, blocks, blocks, None, 2, k, k, None)

    def walk_all(self) -> Array:
        """Walk block by block, before all of them the table, by the same program: what became of the lanes."""
        n, given, block = len(self.unknown), self.given, self.block

        def walk(j, state):
            first = jnp.clip((j - self.tabled) * block, 0, given - block)  # the last block overlaps the one before
            made, rows, store = state
            return _Walk(self, j, first, rows).run(made, rows, store)

        store = jnp.zeros((sum(count or 1 for count in self.counts), block))
        state = jnp.zeros((n + 4, given)), jnp.zeros((n + len(self.outset) + 1, block if self.tabled else 0)), store
        return lax.fori_loop(0, -(-given // block) + self.tabled, walk, state)[0]

    def full(self, these: Iterable[Array]) -> tuple[Array, ...]:
        """Make lanes of numbers."""
        return tuple(jnp.broadcast_to(v, (self.width,)) for v in these)

    # -- where lanes set out -------------------------------------------------------------------------------------

    def begin(self, goal: Array) -> _Ways:
        """Put lanes at the start pose."""
        at_start = self.origin, jnp.stack([self.start[c] for c in self.unknown]), jnp.stack(self.outset)
        base, now, facing = (jnp.broadcast_to(x[:, None], (len(x), self.width)) for x in at_start)
        return self.set_off(goal, base, now, facing, jnp.zeros(self.width))

    def set_off(self, goal: Array, base: Array, now: Array, facing: Array, aside: Array) -> _Ways:
        """Put lanes at poses; arguments are as fields of `_Ways`."""
        zero = jnp.zeros(self.width)
        turned = [jnp.abs(goal[a] - base[a]) for a in self.plan.angles if a < len(self.driven)]
        longest = STEP / functools.reduce(jnp.maximum, turned, jnp.full(self.width, STEP))
        step, told, left = jnp.minimum(longest, 1.0), jnp.stack([zero, zero + 1.0]), zero + _FAR
        return _Ways(zero, zero, step, longest, now, now, facing, facing, left, told, goal, base, aside)

    def begin_table(self, goal: Array, first: Array, rows: Array) -> _Ways:
        """Put points of a table in place of lanes; those beyond the last point rest."""
        k, points = len(self.driven), self.points
        place = first + np.arange(self.width)
        steps = jnp.stack([place // points ** (k - 1 - i) % points for i in range(k)]) / (points - 1)
        ways = self.begin(self.low[:, None] + (self.high - self.low)[:, None] * steps)
        return ways._replace(at=jnp.where(place < points**k, ways.at, 1.0))

    def try_at_once(self, goal: Array, first: Array, rows: Array) -> _Ways:
        """Have those lanes that lie among reached points of the table go all their way at once."""
        n, points, low, high = len(self.unknown), self.points, self.low, self.high
        reached = rows[-1, : self.size] == 1.0
        span = jnp.where(high > low, high - low, 1.0)[:, None]
        place = (points - 1) * jnp.where(high > low, 1.0, 0.0)[:, None] * (goal - low[:, None]) / span
        guess, inside = interpolate(list(place), rows[:n], reached, jnp.all(reached), points)
        point = self._nearest_reached(place, reached)
        found = rows[:, functools.reduce(lambda index, own: index * points + own, point)]
        aside = found[-1] == 1.0
        ways, base = self.begin(goal), low[:, None] + span * point / (points - 1)
        ways = self.set_off(
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

    def _nearest_reached(self, place: Array, reached: Array) -> Array:
        """Choose of the points around each lane the nearest one that was reached, if any was: places ``(k, lanes)``."""
        points = self.points
        cell = jnp.clip(place.astype(np.int32), 0, points - 2)
        best = jnp.clip(jnp.round(place).astype(np.int32), 0, points - 1)

        def choose():
            chosen, least = best, jnp.full(self.width, jnp.inf)
            for corner in itertools.product(range(2), repeat=len(self.driven)):
                point = cell + np.array(corner, np.int32)[:, None]
                good = reached[functools.reduce(lambda index, own: index * points + own, point)]
                far = jnp.where(good, jnp.sum((place - point) ** 2, axis=0), jnp.inf)
                chosen, least = jnp.where(far < least, point, chosen), jnp.minimum(far, least)
            return chosen

        return lax.cond(jnp.all(reached), lambda: best, choose)

    # -- a step --------------------------------------------------------------------------------------------------

    def advance(self, state: Any) -> Any:
        """Try the next step of some lanes: where it passes the checks it is made, elsewhere a shorter one is next."""
        i, ways = state
        trial = _Trial.of(ways)
        guess = ways.now + trial.change * (ways.now - ways.then)
        # Lanes that rest, in which may stand anything, are at the start pose: they hold no other up.
        x = list(self.start)
        for c, v in zip(self.unknown, guess, strict=True):
            x[c] = jnp.where(ways.open, v, x[c])
        for c, o, u in zip(self.driven, ways.base, ways.goal, strict=True):
            x[c] = jnp.where(ways.open, o + trial.at * (u - o), x[c])
        found = self.core.solve(self.eq, x, self.signs)
        facing, told = fusion_barrier(
            self.go, lambda: (self.full(found.determinants), self.full((found.size, found.pivots)))
        )
        found = found._replace(determinants=facing, size=told[0], pivots=told[1])
        (kept,) = fusion_barrier(self.go, lambda: self.full([on_branch(self.eq, found, self.signs, trial.at < 1.0)]))
        y = self.full(found.x[c] for c in self.unknown)
        judged = fusion_barrier(self.go, lambda: self._judge(ways, trial, guess, y, facing, kept))
        good, longer, shorter, left = judged
        facing, told = jnp.stack(facing), jnp.stack(told)
        new = ways._replace(at=trial.at, before=ways.at, step=longer, left=left, told=told)
        new = new._replace(now=jnp.stack(y), then=ways.now, facing=facing, faced=ways.facing)
        old = ways._replace(step=shorter, before=ways.at, then=ways.now, faced=ways.facing)
        old = jax.tree.map(lambda a, b: jnp.where(ways.open, a, b), old, ways)
        return i + 1, jax.tree.map(lambda a, b: jnp.where(good, a, b), new, old)

    def _judge(
        self, ways: _Ways, trial: "_Trial", guess: Array, y: Sequence[Array], facing: Array, kept: Array
    ) -> tuple[Array, ...]:
        """Say whether the step is made, how long the next one is after it and elsewhere, and what is left."""
        fresh, ahead = trial.fresh, trial.ahead
        step = self.norm([a - b for a, b in zip(y, ways.now, strict=True)])
        off = self.norm([a - b for a, b in zip(y, guess, strict=True)])
        sharp = off / (SHARP * step + self.least.close * self.eq.length)
        if not self.core.guessed:  # there is one solution of each orientation, however far it is
            step, sharp = jnp.zeros_like(step), jnp.zeros_like(sharp)
        close = jnp.where(fresh, step <= FIRST * self.eq.length, sharp <= 1.0)
        rise = [a - b for a, b in zip(ways.facing, ways.faced, strict=True)]
        good = ways.open & kept & close & steady(facing, ways.facing, rise, trial.ratio)
        fall = (ways.facing**2 - jnp.stack(facing) ** 2) / (trial.at - ways.at)
        towards = jnp.stack(facing) ** 2 / jnp.where(fall > 0.0, fall, 1.0)
        left = jnp.min(jnp.where(fall > 0.0, towards, _FAR), axis=0)
        aim = 0.5  # of what a step may bend
        bend = aim / jnp.maximum(sharp, 0.1 * aim)  # times as long a step would bend as much as it may
        again = bend * (ahead + jnp.where(fresh, 0.0, trial.behind)) - ahead
        longer = jnp.where(fresh, ways.step, jnp.clip(again, 0.4 * ahead, 2.0 * ahead))
        # 0.75 of what is left before a fold is a step
        longer = jnp.minimum(jnp.minimum(longer, ways.longest), jnp.maximum(0.75 * left, _SHORTEST))
        # 0.25 of a step that was refused is the next one, at least
        shorter = jnp.clip(jnp.where(kept & ~fresh, bend, 0.0), 0.25, 0.5) * ways.step
        return self.full((good, longer, shorter, left))


class _Trial(NamedTuple):
    """The step that lanes try; all ``(lanes,)``."""

    fresh: (
        Array  # whether it is a first one, or one after a step that was refused: a short one shows where the way goes
    )
    ahead: Array  # the part of the way that is tried
    at: Array  # the part of the way where it ends
    behind: Array  # the part that the step before made
    ratio: Array  # its length in terms of that one
    change: Array  # how much of the last change of the pose is expected again

    @staticmethod
    def of(ways: _Ways) -> "_Trial":
        """Return the next step of lanes."""
        fresh = ways.at == ways.before
        ahead = jnp.where(fresh, SHORT, 1.0) * ways.step
        at = jnp.where(ways.at + ahead >= 1.0 - SHORT * ahead, 1.0, ways.at + ahead)
        behind = jnp.where(fresh, 1.0, ways.at - ways.before)
        ratio = jnp.where(fresh, 0.0, (at - ways.at) / behind)
        # Towards a fold poses change as the root of what is left.
        roots = [jnp.sqrt(jnp.maximum(ways.left + part, 0.0)) for part in (behind, 0.0, ways.at - at)]
        bent = ways.left < 8.0 * behind  # 8 steps before a fold the way is bent
        change = jnp.where(bent, (roots[1] - roots[2]) / (roots[0] - roots[1]), ratio)
        return _Trial(fresh, ahead, at, behind, ratio, change)


class _Walk:
    """Lanes of a block that go as far as they come, or the points of the table in their stead.

    Most lanes are there in the first turn, chunk by chunk. The others are kept in a store, and go on together.
    """

    def __init__(self, routes: _Routes, j: Array, first: Array, table: Array):
        self.routes, self.first, self.table = routes, first, table
        self.at_table = (j == 0) & routes.tabled
        chunks = -(-routes.size // routes.width), -(-routes.block // routes.width)
        self.count = jnp.where(self.at_table, *chunks)

    def run(self, made: Array, rows: Array, store: Array) -> tuple[Array, Array, Array]:
        """Walk, and put what became of the lanes into their place; likewise of the points of the table, in `rows`."""
        routes, at_table, first = self.routes, self.at_table, self.first
        # Lanes go together 18 times, those of a table's points 6 times: lanes can do without the last of them.
        turns = jnp.where(at_table, 6, 18)
        none = jnp.zeros(routes.block, bool)
        turn, _, order, went, made, rows, _, store = lax.while_loop(
            lambda st: (st[0] < turns) & ((st[0] == 0) | jnp.any(st[-2])),
            self._turn,
            (jnp.zeros((), int), self.count, jnp.arange(routes.block), none, made, rows, none, store),
        )

        def put_back(old: Array, new: Callable[[_Ways], Iterable[Array]], at: Array) -> Array:
            part = lax.dynamic_slice_in_dim(old, at, routes.block, 1)
            ways = _unpack(store[:, jnp.argsort(order)], routes.counts)
            return lax.dynamic_update_slice_in_dim(old, jnp.where(went, _put(part, new(ways), 0), part), at, 1)

        made = _once((turn > 1) & ~at_table, lambda made: put_back(made, lambda ways: ways.result, first), made)
        if routes.tabled:
            rows = _once((turn > 1) & at_table, lambda rows: put_back(rows, lambda ways: ways.point, first), rows)
        return made, rows, store

    def _turn(self, state):
        """Take the lanes that go on some steps further, chunk by chunk."""
        turn, some, order, went, made, rows, going, store = state
        left = jnp.where(turn == 0, self.count, -(-jnp.sum(going) // self.routes.width))
        order, going, store = _once((turn == 1) | (left < some), self._put_together, (order, going, store))
        _, made, rows, going, store = lax.fori_loop(0, left, self._chunk, (turn, made, rows, going, store))
        return turn + 1, left, order, jnp.where(turn == 0, going, went), made, rows, going, store

    @staticmethod
    def _put_together(state):
        """Put the lanes that go on in front of the others."""
        order, going, store = state
        place = jnp.argsort(~going)
        return order[place], going[place], store[:, place]

    def _chunk(self, c, state):
        turn, made, rows, going, store = state
        routes, at_table = self.routes, self.at_table
        at = jnp.minimum(c * routes.width, routes.block - routes.width)  # the last chunk overlaps the one before

        def set_out(at: Array, *_: Array) -> _Ways:
            goal = lax.dynamic_slice_in_dim(routes.goals, self.first + at, routes.width, 1)
            if not routes.tabled:
                return routes.begin(goal)
            return lax.cond(at_table, routes.begin_table, routes.try_at_once, goal, at, self.table)

        ways = lax.cond(turn == 0, set_out, self._go_on, at, going, store)
        most = jnp.where(turn == 0, 2, 8)  # 8 steps are tried before lanes that are not there yet are put together
        _, ways = lax.while_loop(lambda st: (st[0] < most) & jnp.any(st[1].open), routes.advance, (0, ways))
        goes = ways.undecided & ((turn == 0) | lax.dynamic_slice_in_dim(going, at, routes.width))
        going = lax.dynamic_update_slice_in_dim(going, goes, at, 0)
        made = _once((turn == 0) & ~at_table, lambda made: _put(made, ways.result, self.first + at), made)
        if routes.tabled:
            rows = _once((turn == 0) & at_table, lambda rows: _put(rows, ways.point, at), rows)
        keeps = (turn > 0) | jnp.any(goes)
        store = _once(keeps, lambda store: _put(store, ways, at), store)
        return turn, made, rows, going, store

    def _go_on(self, at: Array, going: Array, store: Array) -> _Ways:
        """Take lanes out of the store; those that are lost on the way from a table's point go from the start pose."""
        routes = self.routes
        ways = _unpack(lax.dynamic_slice_in_dim(store, at, routes.width, 1), routes.counts)
        lost = ways.undecided & ~ways.open
        ways = jax.tree.map(lambda a, b: jnp.where(lost, a, b), routes.begin(ways.goal), ways)
        # In the columns of lanes that do not go on stands anything.
        return ways._replace(step=jnp.where(lax.dynamic_slice_in_dim(going, at, routes.width), ways.step, 0.0))


def _put(store: Array, arrays: Iterable[Array], at: ArrayLike) -> Array:
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


def _once(go: Array, f: Callable, x: PyTree) -> PyTree:
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
