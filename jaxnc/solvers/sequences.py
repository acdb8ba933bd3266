"""Poses of many designs, where every block of the kernel has a closed form: many poses of each at a time.

A closed form needs no guess, only the side that it is on. Poses can therefore be solved side by side, and whether they
are on one branch is seen from them afterwards, by the same checks as in continuation (`jaxnc.solvers.continuation`).
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.solvers.continuation import SHORT, STEP, on_branch, steady
from jaxnc.solvers.kernel import Kernel, always, apart
from jaxnc.types import Array

_LANES = 2304  # poses at a time: they stay in the cache
_DESIGNS = 128  # of so many designs, or more if each has few poses
_FIRST = 16  # steps from the start pose to the first value
TURNING = 64  # steps at least for a sequence of values, or from the start pose to the farthest of scattered ones


Poses = tuple[tuple[Array, ...], Array, Array, Array]
"""Unknown coordinates of poses, their largest residuals and conditioning, and which are right."""


class _Trail(NamedTuple):
    """Where sequences have come to, each ``(designs,)``.

    Attributes:
        facing: determinants of the blocks.
        at: known coordinates, ``(k, designs)``.
        rise: how the determinants changed in the last step that went anywhere.
        ahead: how the known coordinates did, ``(k, designs)``.
        alive: whether every pose so far is on the branch.
    """

    facing: tuple[Array, ...]
    at: Array
    rise: tuple[Array, ...]
    ahead: Array
    alive: Array


def in_sequences(core: Kernel, equations: Callable[[Array], Any], q: Array, values: Array) -> Poses:
    """Follow sequences of input values.

    Args:
        core: blocks that all have a closed form.
        equations: makes the equations of some of the sequences, lanes last.
        q: poses where they begin, ``(B, N)``.
        values: known coordinates, ``(B, T, k)``.

    Returns:
        Poses ``(B, T)``. Where one is not right, it and those that follow it are not set.
    """
    total, driven = values.shape[1], len(core.plan.driven)
    many = -(-TURNING // total) if total > 1 else 1
    between = np.arange(1, many + 1) / many
    if driven > 1 and total > 1:
        between = np.append(SHORT / many, between)
    parts = np.append(SHORT, np.arange(1, _FIRST + 1)) / _FIRST

    def path(home: Array, goal: Array, span: int):
        # Where the way turns a short step shows in which direction determinants change; it is gone to and fro.
        short = goal[:1] + SHORT * (goal[min(1, total - 1)] - goal[:1])
        before = jnp.concatenate([short, goal[:-1]])
        rest = before[:, None] + between[:, None, None] * (goal - before)[:, None]
        lead = _filled_up(home, jnp.concatenate([home + parts[:, None, None] * (goal[0] - home), short]), span)
        return lead, rest.reshape(-1, *goal.shape[1:]), None

    def judge(b, u, facing, kept, trail, _):
        return _followed(core.plan.angles, u, facing, kept, trail)

    return _in_blocks(core, equations, q, values, len(between), path, lambda trail: trail, judge)


def scattered_around(core: Kernel, equations: Callable[[Array], Any], q: Array, near: Array) -> Poses:
    """Solve for many values of a single input of each design, one by one.

    A line of poses is followed from the start pose to the largest value, and one to the smallest. What lies between two
    poses of it that are reached can be reached.

    Args:
        core: blocks that all have a closed form.
        equations: makes the equations of some designs, lanes last.
        q: their start poses, ``(D, N)``.
        near: known coordinates counted from the turn nearest to the start pose, ``(D, B, k)``.

    Returns:
        Poses ``(D, B)``. Where one is not right, it is not set.
    """
    parts = np.append(SHORT, np.arange(1, TURNING + 1)) / TURNING

    def path(home: Array, goal: Array, span: int):
        ends = jnp.maximum(jnp.max(goal, axis=0), home), jnp.minimum(jnp.min(goal, axis=0), home)
        lines = [_filled_up(home, home + parts[:, None, None] * (end - home), span) for end in ends]
        return jnp.concatenate(lines), goal, (home[0], ends[0][0], ends[1][0], len(lines[0]))

    def judge(b, u, facing, kept, state, about):
        trail, begin, counts = state
        home, high, low, line = about
        blocks = line // len(u)  # of each line
        trail = jax.tree.map(lambda a, c: jnp.where(b % blocks == 0, c, a), trail, begin)
        good, trail = _followed(core.plan.angles, u, facing, kept, trail)
        counts = counts.at[b // blocks].add(jnp.sum(good, axis=0), mode="drop")
        up = u[:, 0] >= home
        way = jnp.where(up, high, low) - home
        needed = jnp.ceil(TURNING * (u[:, 0] - home) / jnp.where(way == 0.0, 1.0, way))
        there = jnp.where(up, counts[0], counts[1]) - (line - TURNING)
        return jnp.where(b < 2 * blocks, good, kept & (needed <= there)), (trail, begin, counts)

    def begin(trail):
        return trail, trail, jnp.zeros((2, *trail.alive.shape), int)

    return _in_blocks(core, equations, q, near, 1, path, begin, judge)


def _filled_up(home: Array, way: Array, span: int) -> Array:
    """Steps that begin at home, so many times that there are whole blocks."""
    return jnp.concatenate([jnp.broadcast_to(home, (-len(way) % span, *home.shape)), way])


def _in_blocks(
    core: Kernel,
    equations: Callable[[Array], Any],
    q: Array,
    goals: Array,
    steps: int,
    path: Callable,
    begin: Callable,
    judge: Callable,
) -> Poses:
    """Solve poses of all designs, some designs and some of their poses at a time.

    Args:
        core: blocks that all have a closed form.
        equations: makes the equations of some designs, lanes last.
        q: their start poses, ``(B, N)``.
        goals: known coordinates of the poses, ``(B, T, k)``.
        steps: steps to each of them.
        path: makes, from known coordinates at home ``(k, designs)``, goals ``(T, k, designs)`` and the number of steps
            in a block: known coordinates of whole blocks that are gone before, those of all steps to the goals, and
            what `judge` needs.
        begin: makes the state of `judge` from the `_Trail` at home.
        judge: says which poses of a block are right, and gives its next state.
    """
    (count, total, _), plan = goals.shape, core.plan
    designs = min(count, max(_DESIGNS, _LANES // (total * steps)))
    designs = next((k for k in range(designs, designs // 2, -1) if count % k == 0), designs)
    rows = min(total, max(1, _LANES // (designs * steps)))
    rows = next((k for k in range(rows, rows // 2, -1) if total % k == 0), rows)
    blocks, span = -(-total // rows), rows * steps
    filled = blocks * rows

    def chunk(j, made):
        # The last chunk overlaps the one before.
        start = jnp.minimum(j * designs, count - designs)
        eq, first = equations(start + jnp.arange(designs)), lax.dynamic_slice_in_dim(q, start, designs)
        go, x = always(eq), [first[:, c] for c in range(q.shape[1])]
        facing = apart(go, lambda: tuple(jnp.broadcast_to(d, (designs,)) for d in core.determinants(eq, x)))
        signs = [jnp.sign(d) for d in facing]
        home = first[:, plan.known].T
        goal = jnp.moveaxis(lax.dynamic_slice_in_dim(goals, start, designs), 0, -1)
        goal = jnp.concatenate([goal, jnp.broadcast_to(goal[-1:], (filled - total, *goal.shape[1:]))])
        lead, rest, about = path(home, goal, span)
        before, u = len(lead) // span, jnp.concatenate([lead, rest])

        def full(these):
            return tuple(jnp.broadcast_to(v, (designs,)) for v in these)

        def pose(u):
            at = list(x)
            for k, c in enumerate(plan.known):
                at[int(c)] = u[k]
            found = core.solve(eq, at, signs)
            new, seen = apart(go, lambda: (full(found.determinants), full((found.size, found.pivots))))
            found = found._replace(determinants=new, size=seen[0], pivots=seen[1])
            (kept,) = apart(go, lambda: full([on_branch(eq, found, signs)]))
            return full(found.x[c] for c in plan.unknown), new, seen, kept

        def block(b, state):
            made, state = state
            here = lax.dynamic_slice_in_dim(u, b * span, span)
            y, new, seen, kept = jax.vmap(pose)(here)
            good, state = judge(b, here, new, kept, state, about)
            # What the steps before write is written over.
            place = start, jnp.maximum(b - before, 0) * rows
            made = tuple(
                lax.dynamic_update_slice(a, v[steps - 1 :: steps].T, place)
                for a, v in zip(made, (*y, *seen, good), strict=True)
            )
            return made, state

        nothing = tuple(jnp.zeros(designs) for _ in facing)
        trail = _Trail(facing, home, nothing, jnp.zeros_like(home), jnp.ones(designs, bool))
        return lax.fori_loop(0, before + blocks, block, (made, begin(trail)))[0]

    blank = (*[jnp.zeros((count, filled))] * (len(plan.unknown) + 2), jnp.zeros((count, filled), bool))
    made = lax.fori_loop(0, -(-count // designs), chunk, blank)
    *y, size, pivots, good = (a[:, :total] for a in made) if filled > total else made
    return tuple(y), size, pivots, good


def _followed(angles: Sequence[int], u: Array, facing: tuple, kept: Array, trail: _Trail) -> tuple[Array, _Trail]:
    """Which steps of a block keep to the branch, none of a sequence after the first that does not.

    Args:
        angles: which of the known coordinates are angles.
        u: known coordinates after every step, ``(steps, k, designs)``.
        facing: determinants after every step, each ``(steps, designs)``.
        kept: whether every pose is right by itself.
        trail: where the sequences have come to before.

    Returns:
        What was asked, and where they have come to.
    """

    def before(a, first):
        return jnp.concatenate([first[None], a[:-1]])

    now = [before(d, f) for d, f in zip(facing, trail.facing, strict=True)]
    steps = tuple(jnp.moveaxis(u - before(u, trail.at), 1, 0))
    changes = (*(a - b for a, b in zip(facing, now, strict=True)), *steps)
    earlier = (*trail.rise, *trail.ahead)
    moves = sum((d * d for d in steps), jnp.zeros(kept.shape)) > 0.0

    def plain():
        return [before(c, e) for c, e in zip(changes, earlier, strict=True)], [c[-1] for c in changes]

    def skipping():
        # A step that goes nowhere tells nothing: the last one that did counts.
        index = lax.cummax(jnp.where(moves, np.arange(1, len(kept) + 1)[:, None], 0), axis=0)
        whole = [jnp.concatenate([e[None], c]) for c, e in zip(changes, earlier, strict=True)]
        last = [jnp.take_along_axis(w, index, axis=0) for w in whole]
        return [before(v, e) for v, e in zip(last, earlier, strict=True)], [v[-1] for v in last]

    earlier, last = lax.cond(jnp.all(moves), plain, skipping)
    rise, ahead = earlier[: len(facing)], earlier[len(facing) :]
    square = sum((w * w for w in ahead), jnp.zeros(kept.shape))
    share = sum((w * d for w, d in zip(ahead, steps, strict=True)), jnp.zeros(kept.shape))
    ok = kept & steady(facing, now, rise, share / jnp.where(square > 0.0, square, 1.0))
    for k in angles:
        ok = ok & (jnp.abs(steps[k]) <= STEP)
    order = np.arange(len(kept), dtype=np.int32)[:, None]
    good = trail.alive & (order < jnp.min(jnp.where(ok, np.int32(len(kept)), order), axis=0))
    rise, ahead = tuple(last[: len(facing)]), last[len(facing) :]
    ahead = jnp.stack(ahead) if ahead else trail.ahead
    return good, _Trail(tuple(d[-1] for d in facing), u[-1], rise, ahead, good[-1])
