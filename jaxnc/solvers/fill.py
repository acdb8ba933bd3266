"""Poses of many inputs solved in lockstep under XLA, by a fixed amount of work: what it cannot answer for says so.

This is all that traced code compiles. Sequential work with decisions in it is left to the host (`jaxnc.solvers.host`),
which is asked for the lanes that are not `good`. Here are the choice of a way, and two of the ways:

- Many values of one input of one design: a table of poses where they lie, then all lanes from there, in chunks.
- Other designs: continuation in a fixed number of steps, each checked; a lane that fails a check stays where it was.

Lanes of several inputs go by `jaxnc.solvers.ways`, designs whose blocks all have closed forms by
`jaxnc.solvers.sequences`.
"""

import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.compiling import at_a_time, in_chunks
from jaxnc.solvers.branch import EXTRAPOLATED, FIRST, LEADING, SHARP, SHORT, STEP, TURNING, parts_of_way, smooth, steady
from jaxnc.solvers.kernel import (
    Kernel,
    fusion_barrier,
    jumps_anywhere,
    kernel,
    length_of,
    on_branch,
    opaque_true,
    writes_out,
)
from jaxnc.solvers.plan import Plan, unwind
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.solvers.sequences import in_sequences, scattered_around
from jaxnc.solvers.ways import follow_ways, interpolate
from jaxnc.system.equations import Equations, pure_numbers
from jaxnc.system.precision import limits
from jaxnc.types import Array, Coordinates, Float

LEAST = 256  # lanes of one input from which a table pays
_CHUNKS = {40_000: 256, 300_000: 1024}  # lanes in one round, if there are no more than so many of them


def can_fill(plan: Plan) -> bool:
    """Say whether very many inputs of a plan are solved here."""
    return len(plan.driven) > 0 and writes_out(plan) and not jumps_anywhere(plan)


def pays(plan: Plan, lanes: int) -> bool:
    """Say whether so many inputs of one design are solved here, where code is compiled anyway."""
    # from 16 lanes of several inputs ways of their own pay
    return lanes >= (LEAST if len(plan.driven) == 1 else 16) and can_fill(plan)


def in_order(
    plan: Plan, eq: Equations, shared: bool, q: Float[Array, "S N"], values: Float[Array, "S T k"]
) -> PoseBatch:
    """Follow sequences of inputs along their branches; after the first pose that is not good none of a sequence is.

    The equations are of one design (`shared`), or of one for each sequence (first axis of every leaf). Angles of the
    poses that they begin from are counted so that they do.
    """
    count, total = values.shape[:2]
    if kernel(plan).closed:
        return in_sequences(kernel(plan), _equations_of(eq, shared), q, values)
    if shared and count == 1 and len(plan.driven) == 1 and pays(plan, total):
        # A sequence of one input goes to and fro on one branch, as far as all of it is reached.
        out = jax.tree.map(lambda a: a[None], from_table(plan, eq, q[0], values[0, :, :1], in_order=True))
    else:
        those = _equations_of(eq, shared)
        # 256 lanes of other designs go on together
        out = in_chunks(lambda at: _together(plan, those(at), q[at], values[at]), 256, jnp.arange(count))
    order = np.arange(total, dtype=np.int32)
    first = jnp.min(jnp.where(out.good, np.int32(total), order), axis=1, keepdims=True)
    return out._replace(good=order < first)


def one_by_one(
    plan: Plan, eq: Equations, shared: bool, q: Float[Array, "D N"], values: Float[Array, "D B k"], turns: Array
) -> PoseBatch:
    """Poses ``(D, B)`` at inputs of designs, each on the straight way from the design's start pose.

    The equations are of one design (`shared`), or of one for each row of q (first axis of every leaf). `turns` are
    whole turns in the values, of angles that nothing else depends on, from that nearest to the pose.
    """
    designs, each, known = values.shape
    near = unwind(values, turns)
    # from 16 inputs of a design it pays to follow a line of poses first
    if each >= 16 and len(plan.driven) == 1 and kernel(plan).closed:
        return scattered_around(kernel(plan), _equations_of(eq, shared), q, near)
    if shared and designs == 1 and pays(plan, each):  # which counts turns by itself
        return jax.tree.map(lambda a: a[None], from_table(plan, eq, q[0], values[0, :, : len(plan.driven)]))
    if each > 1:
        owner = np.arange(designs * each) // each
        mine = eq if shared else jax.tree.map(lambda a: a[owner], eq)
        out = in_order(plan, mine, shared, q[owner], near.reshape(-1, 1, known))
        return jax.tree.map(lambda a: a.reshape(designs, each), out)
    return in_order(plan, eq, shared, q, near)


def _equations_of(eq: Equations, shared: bool) -> Callable[[Array], Equations]:
    """A function that gives the equations of some sequences, lanes last."""
    if shared:
        return lambda at: eq
    leaves, structure = jax.tree.flatten(eq)
    # Taken out of one array: out of each by itself, that is what compiles longest.
    rows = jnp.concatenate([a.reshape(a.shape[0], -1) for a in leaves], axis=1).T
    ends = np.cumsum([0, *(int(np.prod(a.shape[1:])) for a in leaves)])

    def those(at):
        some = rows[:, at]
        parts = [some[i:j] for i, j in itertools.pairwise(ends)]
        shaped = [p.reshape(*a.shape[1:], p.shape[-1]) for p, a in zip(parts, leaves, strict=True)]
        return jax.tree.unflatten(structure, shaped)

    return those


# -- one input of one design, from a table of poses ------------------------------------------------------------------


class _PoseTable(NamedTuple):
    """Points of the table on their way: poses and determinants now and before, and which are on the branch."""

    now: tuple[Array, ...]
    before: tuple[Array, ...]
    facing: tuple[Array, ...]
    faced: tuple[Array, ...]
    alive: Array


def _at_once(lanes: int, least: int) -> int:
    """Lanes in one round. The fewer they are, the sooner the table is there; the more, the fewer rounds."""
    # 2048 of more lanes: they stay in the cache
    wanted = at_a_time(next((chunk for most, chunk in _CHUNKS.items() if lanes <= most), 2048))
    return max(min(wanted, lanes), least)


def from_table(
    plan: Plan, eq: Equations, q: Coordinates, values: Float[Array, "lanes k"], in_order: bool = False
) -> PoseBatch:
    """Solve a batch of inputs of one design on the branch of a pose.

    Angles that nothing else depends on count from the turn nearest to the pose. If they are a sequence of a single
    input, `in_order`, a turn counts as one where poses need a guess, because a branch may come to another pose after
    it.

    Returns:
        The lanes, ``(lanes,)``. Those that are not `good` are not reached, or cannot be answered for.
    """
    core, (given, k) = kernel(plan), values.shape
    if k > 1:
        return follow_ways(plan, eq, q, values)
    driven, unknown = int(plan.known[0]), [int(c) for c in plan.unknown]
    guessed = [unknown.index(c) for c in core.guessed]
    start = [q[c] for c in range(q.shape[0])]
    go = opaque_true(eq)
    outset = fusion_barrier(go, lambda: core.determinants(eq, start))
    signs = [jnp.sign(d) for d in outset]
    origin = q[driven]
    unfolded = in_order and bool(guessed)
    turning = plan.periodic[0] and not unfolded
    column = values.reshape(-1)
    even = 129  # points of a table
    width = _at_once(given, even)
    points = width if unfolded else even
    chunks = -(-given // width)
    total = max(given, width)
    if given < total:
        column = jnp.concatenate([column, jnp.broadcast_to(column[-1:], (total - given,))])
    # Otherwise slices that would reach beyond the end are moved back by JAX: the last chunk overlaps the one before.

    def lanes(j):
        u = lax.dynamic_slice_in_dim(column, j * width, width)
        return unwind(u, jnp.round((u - origin) / (2 * jnp.pi))) if turning else u

    low, high = _input_range(lanes, chunks, origin, width)
    rounds, dense = jnp.asarray(8.0), True  # from the start pose to the points of the table, at least
    if 0 in plan.angles:
        turned = jnp.maximum(high - origin, origin - low)
        rounds = jnp.maximum(jnp.ceil(turned / STEP) + 1.0, rounds)
        # 0.1 radians between two points of the table, at most
        dense = (turned <= 0.1 * (points - 1)) if unfolded else True
    scale = jnp.where(high > low, (points - 1) / jnp.where(high > low, high - low, 1.0), 0.0)
    goals = low + (high - low) * np.minimum(np.arange(width), points - 1) / (points - 1)

    def part(i, rounds):
        """Of the way to the table, after a round; the first step is a short one."""
        return jnp.where(i == 0, SHORT, i) / (rounds - 1.0)

    norm = length_of(plan, eq)

    def full(these):
        return tuple(jnp.broadcast_to(v, (width,)) for v in these)

    def along(i, rounds, j, table, rows, all_alive):
        """The points of the table: where they are to be next, and where they were going."""
        u = origin + part(i, rounds) * (goals - origin)
        guess = _extrapolate(table, _ratio(i))
        return u, jnp.stack([guess[g] for g in guessed]) if guessed else rows, table.alive

    def look_up(i, rounds, j, table, rows, all_alive):
        """A chunk of lanes: their inputs, and what the table has for them."""
        u = lanes(j)
        return u, *interpolate([(u - low) * scale], rows, table.alive, all_alive, points)

    more = 4.0  # times as many rounds to the table if points were lost on their way, twice at most

    def round_(state):
        i, rounds, table, made = state
        all_alive = jnp.all(table.alive)
        rows = jnp.stack([table.now[g] for g in guessed]) if guessed else jnp.zeros((0, width))

        def chunk(j, state):
            u, guess, may = lax.cond(i < rounds, along, look_up, i, rounds, j, table, rows, all_alive)
            x = list(start)
            for c, v in zip((*(unknown[g] for g in guessed), driven), (*guess, u), strict=True):
                x[c] = v
            found = core.solve(eq, x, signs)
            # These go into several results.
            told = fusion_barrier(go, lambda: (full(found.determinants), full((found.size, found.pivots))))
            facing, (size, pivots) = told
            found = found._replace(determinants=facing, size=size, pivots=pivots)
            (good,) = fusion_barrier(go, lambda: full([may & dense & on_branch(eq, found, signs, i < rounds)]))
            y = full(found.x[c] for c in unknown)
            new = (*y, size, pivots, good)
            made = tuple(
                lax.dynamic_update_slice_in_dim(a, b, j * width, 0) for a, b in zip(state[0], new, strict=True)
            )
            return made, y, facing, good

        count = jnp.where(i < rounds, 1, chunks)
        made, y, facing, good = lax.fori_loop(0, count, chunk, (made, table.now, table.facing, table.alive))
        table = _move_table(table, y, facing, good, _ratio(i), i, norm, eq)
        # Before the lanes: whether the points go all their way again.
        again = (i == rounds - 1.0) & (rounds < most) & ~jnp.all(table.alive)
        table = lax.cond(again, lambda: begin, lambda: table)
        return jnp.where(again, 0, i + 1), jnp.where(again, more * rounds, rounds), table, made

    still = full(start[c] for c in unknown)
    facing = full(outset)
    # Of different numbers, as XLA makes one array of equal ones, and then copies it for each to be written to.
    blank = (*(jnp.full(total, float(i)) for i in range(len(unknown) + 2)), jnp.zeros(total, bool))
    # The points of the table go their way round by round; in a last round come the lanes, chunk by chunk.
    begin = _PoseTable(still, still, facing, facing, jnp.ones(width, bool))
    first = jnp.zeros((), int), jnp.asarray(rounds, q.dtype)
    most = more**2 * first[1]
    made = lax.while_loop(lambda state: state[0] <= state[1], round_, (*first, begin, blank))[-1]
    made = [a[:given] for a in made] if total != given else made
    return PoseBatch(tuple(made[:-3]), *made[-3:])


def _ratio(i: Array) -> Array:
    """Return a round's step over the one before: the first one is a short one."""
    return jnp.asarray([0.0, (1.0 - SHORT) / SHORT, 1.0 / (1.0 - SHORT), 1.0])[jnp.minimum(i, 3).astype(int)]


def _extrapolate(table: _PoseTable, ratio: Array) -> list[Array]:
    """Extrapolate where the points of a table are to be after a step."""
    return [a + ratio * (a - b) for a, b in zip(table.now, table.before, strict=True)]


def _move_table(
    table: _PoseTable,
    y: tuple,
    facing: tuple,
    good: Array,
    ratio: Array,
    i: Array,
    norm: Callable,
    eq: Equations,
) -> _PoseTable:
    """Return the table after a step, with the points that are where they were going, or at first not far, alive."""
    step = norm([a - b for a, b in zip(y, table.now, strict=True)])
    off = norm([a - b for a, b in zip(y, _extrapolate(table, ratio), strict=True)])
    close = jnp.where(
        i > 0, off <= EXTRAPOLATED * step + limits(eq.length).close * eq.length, step <= FIRST * eq.length
    )
    rise = [a - b for a, b in zip(table.facing, table.faced, strict=True)]
    close = close & steady(facing, table.facing, rise, jnp.broadcast_to(ratio, step.shape))
    return _PoseTable(y, table.now, facing, table.facing, good & close)


def _input_range(lanes: Callable, chunks: int, origin: Array, chunk: int) -> tuple[Array, Array]:
    """Smallest and largest input, the start pose's among them. Chunk by chunk, which is much quicker."""

    def wider(j, bounds):
        u = lanes(j)
        return jnp.minimum(bounds[0], u), jnp.maximum(bounds[1], u)

    start = jnp.broadcast_to(origin, (chunk,))
    low, high = lax.fori_loop(0, chunks, wider, (start, start))
    return jnp.min(low), jnp.max(high)


# -- other designs, in a fixed number of steps -----------------------------------------------------------------------


class LaneState(NamedTuple):
    """Where the lanes are."""

    x: tuple[Array, ...]  # coordinates that are not fixed, unknown ones first, each (lanes,)
    good: Array  # whether the lane is on its branch, and was in all steps before
    size: Array  # largest residual
    pivots: Array  # smallest over largest pivot
    determinants: tuple[Array, ...]  # of every block
    rise: tuple[Array, ...]  # how much they changed in the last step that went anywhere
    way: tuple[Array, ...]  # how the known coordinates changed in it


def _together(plan: Plan, eq: Equations, q: Array, values: Array) -> PoseBatch:
    """Take lanes (first axis of q and values; last of eq) by a fixed number of steps."""
    core, (lanes, total) = kernel(plan), values.shape[:2]
    x = [q[:, c] for c in range(q.shape[1])]
    signs = core.signs(eq, x)
    goal = jnp.moveaxis(values, 0, -1)
    before = jnp.concatenate([q[None, :, plan.known].swapaxes(1, 2), goal[:-1]])
    parts, counts = _parts_of_ways(total, len(plan.driven))
    step = stepper(core, eq, x, signs)

    def value(now, way):
        begin, end, part, count = way
        now = lax.fori_loop(0, count, lambda i, now: step(now, begin + part[i] * (end - begin)), now)
        return now, (*now.x[: len(plan.unknown)], now.size, now.pivots, now.good)

    start = beginning(core, eq, x, (lanes,))
    _, out = lax.scan(value, start, (before, goal, jnp.asarray(parts), jnp.asarray(counts)))
    *y, size, pivots, good = (a.T for a in out)
    return PoseBatch(tuple(y), size, pivots, good)


def _parts_of_ways(total: int, driven: int) -> tuple[np.ndarray, np.ndarray]:
    """Parts of the way to each value after every step, ``(T, most)``, and how many steps there are."""
    between = max(1, -(-TURNING // total))
    even = np.arange(1, between + 1) / between
    shortened, first = parts_of_way(between), parts_of_way(LEADING)
    # Where the way turns (from the start to the first value; anywhere with several inputs) a short step comes first.
    ways = [first, *(shortened if driven > 1 or k == 1 else even for k in range(1, total))]
    parts = np.ones((total, max(len(w) for w in ways)))
    for k, w in enumerate(ways):
        parts[k, : len(w)] = w
    return parts, np.array([len(w) for w in ways])


def beginning(kernel: Kernel, eq: Equations, x: Sequence[Array], lanes: tuple[int, ...]) -> LaneState:
    """Put lanes at a pose, all coordinates each a number or lanes."""
    none, moving = jnp.zeros(lanes), [int(c) for c in (*kernel.plan.unknown, *kernel.plan.known)]
    determinants = tuple(jnp.broadcast_to(d, lanes) for d in kernel.determinants(eq, x))
    at = tuple(jnp.broadcast_to(x[c], lanes) for c in moving)
    still = (none,) * len(determinants), (none,) * len(kernel.plan.known)
    return LaneState(at, jnp.ones(lanes, bool), none, none, determinants, *still)


def stepper(
    kernel: Kernel, eq: Equations, x: Sequence[Array], signs: Sequence[Array]
) -> Callable[[LaneState, Array], LaneState]:
    """Make the function that takes lanes a step, to the next values of the known coordinates ``(k, lanes)``."""
    plan = kernel.plan
    pure = pure_numbers(plan.topology)
    moving = [int(c) for c in (*plan.unknown, *plan.known)]
    fixed = {int(c): x[int(c)] for c in plan.fixed}
    # What has a closed form needs no guess: there is one solution of each orientation.
    guessing = kernel.jumps or bool(kernel.guessed)
    go = opaque_true(eq)

    def whole(y):
        return [fixed[c] if c in fixed else y[moving.index(c)] for c in range(len(x))]

    def norm(y):
        total = jnp.zeros(y[0].shape)
        for v, c in zip(y, moving, strict=True):
            v = v * eq.length if pure[c] else v
            total = total + v * v
        return jnp.sqrt(total)

    def step(old, target):
        y, good, lanes = old.x, old.good, old.good.shape
        at = whole(y)
        change: list[Any] = [None] * len(x)
        for k, c in enumerate(plan.known):
            change[int(c)] = target[k] - at[int(c)]
        ahead = [change[int(c)] for c in plan.known]
        square = sum(w * w for w in old.way)
        share = sum(w * d for w, d in zip(old.way, ahead, strict=True)) / jnp.where(square > 0.0, square, 1.0)

        def lanewise(x):
            return tuple(jnp.zeros(lanes) if x[c] is None else jnp.broadcast_to(x[c], lanes) for c in moving)

        guess, slope = at, None
        if guessing:
            slope = fusion_barrier(go, lambda: lanewise(kernel.tangent(eq, at, change)))
            guess = whole([v + jnp.where(jnp.isfinite(d), d, 0.0) for v, d in zip(y, slope, strict=True)])
        for k, c in enumerate(plan.known):
            guess[int(c)] = target[k]
        found = kernel.solve(eq, guess, signs)
        new = fusion_barrier(go, lambda: lanewise(found.x))
        kept = on_branch(eq, found._replace(x=whole(new)), signs)
        determinants = tuple(jnp.broadcast_to(d, lanes) for d in found.determinants)
        good = good & kept & steady(determinants, old.determinants, old.rise, share)
        for k in plan.angles:
            good = good & (jnp.abs(ahead[k]) <= STEP)
        if slope is not None:
            off = norm([a - guess[c] for a, c in zip(new, moving, strict=True)])
            slack = limits(eq.length).close * eq.length
            good = good & (off <= SHARP * norm(slope) + slack)
            if kernel.jumps:
                after = fusion_barrier(go, lambda: lanewise(kernel.tangent(eq, whole(new), change)))
                both = list(zip(slope, after, strict=True))
                kink = norm([a - b - 0.5 * (d + e) for a, b, (d, e) in zip(new, y, both, strict=True)])
                good = good & smooth(norm([e - d for d, e in both]), kink, norm(slope) + norm(after), slack)
        y = fusion_barrier(go, lambda: tuple(jnp.where(good, a, b) for a, b in zip(new, y, strict=True)))
        moves = sum(d * d for d in ahead) > 0.0
        rise = [a - b for a, b in zip(determinants, old.determinants, strict=True)]
        rise = tuple(jnp.where(moves, a, b) for a, b in zip(rise, old.rise, strict=True))
        way = tuple(jnp.where(moves, d, w) for d, w in zip(ahead, old.way, strict=True))
        size, pivots = (jnp.broadcast_to(v, lanes) for v in (found.size, found.pivots))
        return LaneState(y, good, size, pivots, determinants, rise, way)

    return step
