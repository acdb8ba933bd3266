"""Poses of many designs, where every block of the kernel has a closed form: many poses of each at a time.

A closed form needs no guess, only the side that it is on. Poses can therefore be solved side by side, and whether they
are on one branch is diagnose from them afterwards, by the same checks as in continuation (`jaxnc.solvers.fill`).
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.compiling import at_a_time
from jaxnc.solvers.branch import LEADING, SHORT, STEP, TURNING, parts_of_way, steady
from jaxnc.solvers.kernel import Kernel, SolvedLanes, fusion_barrier, on_branch, opaque_true
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.solvers.rows import any_lane
from jaxnc.types import Array, PyTree

if TYPE_CHECKING:
    from jaxnc.system.equations import Equations

_LINE = 32  # steps to the farthest of scattered values, to either side: a tenth of a radian on half a turn


class _Trail(NamedTuple):
    """Where sequences have come to. A mark is the determinant of a block, or a known coordinate: these come last."""

    marks: tuple[Array, ...]  # those of the last step, each (designs,)
    change: tuple[Array, ...]  # how they changed in the last step that went anywhere
    alive: Array  # whether every pose so far is on the branch, (designs,)


def in_sequences(core: Kernel, equations: "Callable[[Array], Equations]", q: Array, values: Array) -> PoseBatch:
    """Poses ``(B, T)`` of sequences of inputs; where one is not right, it and those that follow it are not set.

    All blocks of the core have a closed form; `equations` makes those of some of the sequences, lanes last.
    """
    total, driven = values.shape[1], len(core.plan.driven)
    many = -(-TURNING // total) if total > 1 else 1
    between = np.arange(1, many + 1) / many
    if driven > 1 and total > 1:
        between = parts_of_way(many)
    parts = parts_of_way(LEADING)

    def path(home: Array, goal: Array, span: int | None):
        # Where the way turns a short step shows in which direction determinants change; it is gone to and fro.
        short = goal[:1] + SHORT * (goal[min(1, total - 1)] - goal[:1])
        before = jnp.concatenate([short, goal[:-1]])
        rest = before[:, None] + between[:, None, None] * (goal - before)[:, None]
        lead = _fill_up(home, jnp.concatenate([home + parts[:, None, None] * (goal[0] - home), short]), span)
        return lead, lax.collapse(rest, 0, 2), None

    def judge(b, marks, kept, trail, _):
        if b is None:
            return np.arange(len(kept))[-total * len(between) :, None] < _count_reached(core.plan, marks, kept)
        return _judge_block(core.plan, marks, kept, trail)

    return _in_blocks(core, equations, q, values, len(parts) + 1, len(between), path, lambda trail: trail, judge)


def scattered_around(core: Kernel, equations: "Callable[[Array], Equations]", q: Array, near: Array) -> PoseBatch:
    """Poses ``(D, B)`` of many values of a single input of each design, one by one; not set where they are not right.

    A line of poses is followed from the start pose to the largest value, and one to the smallest. What lies between two
    poses of it that are reached can be reached.

    Known coordinates are counted from the turn nearest to the start pose, ``(D, B, k)``; otherwise as `in_sequences`.
    """
    parts = parts_of_way(_LINE)

    def path(home: Array, goal: Array, span: int | None):
        most = jnp.max(goal[:, None] * np.array([1.0, -1.0])[:, None, None], axis=0)
        ends = jnp.maximum(most[0], home), jnp.minimum(-most[1], home)
        lines = [_fill_up(home, home + parts[:, None, None] * (end - home), span) for end in ends]
        # One after the other; where all are solved at once by turns, so that they lie side by side as they are.
        both = jnp.concatenate(lines) if span else lax.collapse(jnp.stack(lines, axis=1), 0, 2)
        return both, goal, (home[0], ends[0][0], ends[1][0], len(lines[0]))

    def judge(b, marks, kept, state, about):
        (home, high, low, line), place = about, marks[-len(core.plan.known)]
        if b is None:  # both lines and all goals
            on = 2 * line
            lines, right = (a[..., :on, :].reshape(*a.shape[:-2], line, 2 * a.shape[-1]) for a in (marks, kept))
            counts = _count_reached(core.plan, lines, right).reshape(2, -1)
            place, kept = place[on:], kept[on:]
        else:
            trail, begin, counts = state
            blocks = line // len(place)  # of each line
            trail = jax.tree.map(lambda a, c: jnp.where(b % blocks == 0, c, a), trail, begin)
            good, trail = _judge_block(core.plan, marks, kept, trail)
            counts = counts.at[b // blocks].add(jnp.sum(good, axis=0), mode="drop")
        up = place >= home
        way = jnp.where(up, high, low) - home
        needed = jnp.ceil(_LINE * (place - home) / jnp.where(way == 0.0, 1.0, way))
        there = jnp.where(up, counts[0], counts[1]) - (line - _LINE)
        found = kept & (needed <= there)
        return found if b is None else (jnp.where(b < 2 * blocks, good, found), (trail, begin, counts))

    def begin(trail):
        return trail, trail, jnp.zeros((2, *trail.alive.shape), int)

    return _in_blocks(core, equations, q, near, 2 * len(parts), 1, path, begin, judge)


def _fill_up(home: Array, way: Array, span: int | None) -> Array:
    """Put steps of no length in front: up to whole blocks, or two of them (see `_count_reached`)."""
    return jnp.concatenate([jnp.broadcast_to(home, (-len(way) % span if span else 2, *home.shape)), way])


def _in_blocks(
    core: Kernel,
    equations: "Callable[[Array], Equations]",
    q: Array,
    goals: Array,
    first: int,
    steps: int,
    path: Callable,
    begin: Callable,
    judge: Callable,
) -> PoseBatch:
    """Solve poses of all designs, some designs and some of their poses at a time.

    Args:
        core: blocks that all have a closed form.
        equations: makes the equations of some designs, lanes last.
        q: their start poses, ``(B, N)``.
        goals: known coordinates of the poses, ``(B, T, k)``.
        first: steps that are gone before.
        steps: steps to each of the goals.
        path: makes, from known coordinates at home ``(k, designs)``, goals ``(T, k, designs)`` and the number of steps
            in a block (None if there is one for everything): known coordinates of whole blocks that are gone before,
            those of all steps to the goals, and what `judge` needs.
        begin: makes the state of `judge` from the `_Trail` at home.
        judge: says which poses of a block are right, and gives its next state. Instead of the number of the block it is
            given None if there is one for all that is gone before and after; then it only says which of the steps to
            the goals are right.
    """
    count, total, _ = goals.shape
    # 4608 poses are solved at once, in one block: fewer loops, and sooner compiled
    whole = (first + total * steps) * count <= at_a_time(4608)
    lanes = at_a_time(2304)  # poses at a time: they stay in the cache
    designs = min(count, max(128, lanes // (total * steps)))  # 128 designs, or more if each has few poses
    designs = next((k for k in range(designs, designs // 2, -1) if count % k == 0), designs)
    rows = min(total, max(1, lanes // (designs * steps)))
    rows = next((k for k in range(rows, rows // 2, -1) if total % k == 0), rows)
    blocks, span = -(-total // rows), rows * steps
    filled = blocks * rows

    def begin_some(start, designs):
        eq, x = equations(start + jnp.arange(designs)), lax.dynamic_slice_in_dim(q, start, designs).T
        go = opaque_true(eq)
        facing = fusion_barrier(go, lambda x: _to_lanes(core.determinants(eq, list(x)), (designs,)), x)
        home = x[core.plan.known]
        marks = *facing, *home
        signs, none = (jax.tree.map(f, of) for f, of in ((jnp.sign, facing), (jnp.zeros_like, marks)))
        goal = jnp.moveaxis(lax.dynamic_slice_in_dim(goals, start, designs), 0, -1)
        return eq, x, signs, home, goal, _Trail(marks, none, jnp.ones(designs, bool))

    if whole:
        eq, x, signs, home, goal, _ = begin_some(0, count)
        lead, rest, about = path(home, goal, None)
        made, marks, kept = _solve_steps(core, eq, x, signs, jnp.concatenate([lead, rest]), True)
        good = judge(None, marks, kept, None, about)[steps - 1 :: steps].T
        made = made[:, len(lead) + steps - 1 :: steps].swapaxes(1, 2)
        return PoseBatch(tuple(made[:-2]), made[-2], made[-1], good)

    def chunk(j, made):
        # The last chunk overlaps the one before.
        start = jnp.minimum(j * designs, count - designs)
        eq, x, signs, home, goal, trail = begin_some(start, designs)
        goal = jnp.concatenate([goal, jnp.broadcast_to(goal[-1:], (filled - total, *goal.shape[1:]))])
        lead, rest, about = path(home, goal, span)
        before, u = len(lead) // span, jnp.concatenate([lead, rest])

        def block(b, state):
            made, state = state
            new, marks, kept = _solve_steps(core, eq, x, signs, lax.dynamic_slice_in_dim(u, b * span, span), False)
            good, state = judge(b, marks, kept, state, about)
            # What the steps before write is written over.
            place = start, jnp.maximum(b - before, 0) * rows
            new = zip(made, (*new, good), strict=True)
            return tuple(lax.dynamic_update_slice(a, v[steps - 1 :: steps].T, place) for a, v in new), state

        return lax.fori_loop(0, before + blocks, block, (made, begin(trail)))[0]

    blank = (*[jnp.zeros((count, filled))] * (len(core.plan.unknown) + 2), jnp.zeros((count, filled), bool))
    made = lax.fori_loop(0, -(-count // designs), chunk, blank)
    *y, size, pivots, good = (a[:, :total] for a in made) if filled > total else made
    return PoseBatch(tuple(y), size, pivots, good)


def _to_lanes(numbers: Sequence[Array], lanes: tuple[int, ...]) -> tuple[Array, ...]:
    return tuple(jnp.broadcast_to(jnp.asarray(v, float), lanes) for v in numbers)


def _stack(numbers: Sequence[Array], lanes: tuple[int, ...]) -> Array:
    return jnp.stack(_to_lanes(numbers, lanes))


def _solve_steps(core: Kernel, eq: Any, x: Array, signs: Any, u: Array, tabled: bool) -> tuple[Any, Any, Array]:
    """Solve for poses at known coordinates.

    Args:
        core: blocks that all have a closed form.
        eq: the equations, lanes last.
        x: coordinates of a pose, ``(N, designs)``.
        signs: the sides that blocks are on, each ``(designs,)``.
        u: known coordinates, ``(steps, k, designs)``.
        tabled: whether several numbers are one table, which few kernels compute and which is soon compiled, or each is
            an array of its own, which is written and read once, and quicker where poses are many.

    Returns:
        Unknown coordinates, largest residual and conditioning, each ``(steps, designs)``; the marks (see `_Trail`);
        and which poses are right by themselves, ``(steps, designs)``.
    """
    go, lanes, facing = opaque_true(eq), u.shape[2], len(signs)
    known, unknown = ([int(c) for c in which] for which in (core.plan.known, core.plan.unknown))

    def place(x, u, y=()):
        at = list(x)
        for c, v in (*zip(known, u, strict=True), *zip(unknown, y, strict=False)):
            at[c] = v
        return at

    def right(found, told, shape):
        found = found._replace(determinants=tuple(told[:facing]), size=told[facing], pivots=told[facing + 1])
        return jnp.broadcast_to(on_branch(eq, found, signs), shape)

    def each(u):
        found = core.solve(eq, place(x, u), signs)
        told = fusion_barrier(go, lambda: _to_lanes((*found.determinants, found.size, found.pivots), (lanes,)))
        kept = fusion_barrier(go, lambda: right(found, told, (lanes,)))
        return (*_to_lanes([found.x[c] for c in unknown], (lanes,)), *told[facing:]), (*told[:facing], *u), kept

    def positions(x, signs, u):
        at = core.positions(eq, place(x, u), signs)[0]
        return _stack([at[c] for c in unknown], u.shape[1:])

    def diagnose(x, u, y):
        found = core.diagnose(eq, place(x, u, y))
        return _stack((*found.determinants, found.size, found.pivots, found.upright), u.shape[1:])

    if not tabled:
        return jax.vmap(each)(u)
    u = u.swapaxes(0, 1)
    # What goes into several results is made first, of few arrays: each is a kernel of its own.
    y = fusion_barrier(go, positions, x, signs, u)
    told = fusion_barrier(go, diagnose, x, u, y)
    kept = right(SolvedLanes(place(x, u, y), (), None, None, told[-1] > 0.0, False), told, u.shape[1:])
    return jnp.concatenate([y, told[-3:-1]]), jnp.concatenate([told[:facing], u]), kept


def _count_reached(plan: Plan, marks: Array, kept: Array) -> Array:
    """Count the steps that keep to the branch before the first that does not, ``(designs,)``.

    The `marks` after every step (see `_Trail`) are ``(marks, steps, designs)``; the first two are the pose where they
    begin, so that what was before a step is a slice, and no array that a kernel has to put together. `kept` says
    whether every pose is right by itself, ``(steps, designs)``.
    """
    changes = marks[:, 1:] - marks[:, :-1]
    last = _last_change(plan, changes, changes[:, :-1], changes[:, 0])[:, :-1]
    ok = _is_regular(plan, marks[:, 2:], marks[:, 1:-1], changes[:, 1:], last) & kept[2:]
    order = np.arange(2, len(kept), dtype=np.int32)[:, None]
    return jnp.min(jnp.where(ok, np.int32(len(kept)), order), axis=0)


def _judge_block(plan: Plan, marks: tuple[Array, ...], kept: Array, trail: _Trail) -> tuple[Array, _Trail]:
    """Say which steps of a block keep to the branch, none of a sequence after the first that does not.

    The `marks` are those after every step, each ``(steps, designs)``; `kept` says whether every pose is right by
    itself.
    """

    def before(marks, first):
        return jax.tree.map(lambda a, b: jnp.concatenate([b[None], a[:-1]]), marks, first)

    now = before(marks, trail.marks)
    changes = jax.tree.map(jnp.subtract, marks, now)
    last = _last_change(plan, changes, before(changes, trail.change), trail.change)
    ok = kept & _is_regular(plan, marks, now, changes, before(last, trail.change))
    order = np.arange(len(kept), dtype=np.int32)[:, None]
    good = trail.alive & (order < jnp.min(jnp.where(ok, np.int32(len(kept)), order), axis=0))
    marks, last = (jax.tree.map(lambda a: a[-1], of) for of in (marks, last))
    return good, _Trail(marks, last, good[-1])


def _known_product(plan: Plan, a: Array, b: Array) -> Array:
    """Multiply two changes of marks, as far as they are known coordinates."""
    facing = len(a) - len(plan.known)
    return sum((v * w for v, w in zip(a[facing:], b[facing:], strict=True)), jnp.zeros(a[0].shape))


def _last_change(plan: Plan, changes: Array, earlier: Array, first: PyTree) -> Any:
    """Return how marks changed in the last step that went anywhere, up to every step; others tell nothing.

    `changes` are those of the steps, each ``(steps, designs)``; `earlier` those before some or all of the last of them,
    and `first` the last one before all of them.
    """
    square = _known_product(plan, changes, changes)
    # below 1e-10 of the longest step, what changes in one is rounding
    moves = square > 1e-20 * jnp.max(square, axis=0)

    def skipping():
        def step(last, new):
            last = jax.tree.map(lambda a, b: jnp.where(new[1], a, b), new[0], last)
            return last, last

        table = isinstance(changes, jax.Array)  # steps are not its first axis
        steps = jnp.moveaxis(changes, 1, 0) if table else changes
        last = lax.scan(step, first, (steps, moves))[1]
        return jnp.moveaxis(last, 0, 1) if table else last

    count = len(earlier[-1])
    rests = any_lane((_known_product(plan, earlier, earlier) > 0.0) & ~moves[-count:])
    return lax.cond(rests, skipping, lambda: changes)


def _is_regular(plan: Plan, marks: Any, now: Any, changes: Any, earlier: Any) -> Array:
    """Say whether steps from marks `now` by changes are short and meet no crossing, the ones before being known."""
    length = _known_product(plan, earlier, earlier)
    share = _known_product(plan, earlier, changes) / jnp.where(length > 0.0, length, 1.0)
    facing = len(marks) - len(plan.known)
    ok = steady(marks[:facing], now[:facing], earlier[:facing], share)
    for k in plan.angles:
        ok = ok & (jnp.abs(changes[facing + k]) <= STEP)
    return ok
