"""Many inputs of one design: a table of poses where they lie, then all lanes from there, in chunks.

Both are one loop with one body, because the body is what takes time to compile. The first rounds move the points of
the table from the start pose along straight ways to their places; the last one takes the lanes, chunk by chunk, guesses
their poses from the table and solves them. If points are lost on their way, all go it once more in shorter steps.
Of several inputs every lane goes such a way, see `jaxnc.solvers.ways`.
Whatever cannot be answered for is left to the host.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.solvers.branch import EXTRAPOLATED, FIRST, SHORT, STEP, steady
from jaxnc.solvers.continuation import length_of, on_branch
from jaxnc.solvers.kernel import always, apart, jumping, kernel, writes_out
from jaxnc.solvers.plan import Plan, unwound
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.solvers.ways import follow, interpolate
from jaxnc.system.equations import Equations
from jaxnc.system.precision import limits
from jaxnc.types import Array, Coordinates, Float

LEAST = 256  # lanes from which a table pays
_FEW = 16  # lanes from which ways of their own do
_CHUNKS = {40_000: 256, 300_000: 1024}  # lanes in one round, if there are no more than so many of them
_CHUNK = 2048  # of more: they stay in the cache
_POINTS = 129  # of the table
_ROUNDS = 32  # from the start pose to the points of the table, at least
_MORE = 4.0  # times as many if points were lost on their way
_DENSE = 0.1  # radians between two points of the table, at most


class _Table(NamedTuple):
    """Points of the table on their way: poses and determinants now and before, and which are on the branch."""

    now: tuple[Array, ...]
    before: tuple[Array, ...]
    facing: tuple[Array, ...]
    faced: tuple[Array, ...]
    alive: Array


def suits(plan: Plan) -> bool:
    """Say whether very many inputs of a plan are solved here."""
    return len(plan.driven) > 0 and writes_out(plan) and not jumping(plan)


def pays(plan: Plan, lanes: int) -> bool:
    """Say whether so many inputs of one design are solved here, where code is compiled anyway."""
    return lanes >= (LEAST if len(plan.driven) == 1 else _FEW) and suits(plan)


def _at_once(lanes: int, least: int) -> int:
    """Lanes in one round. The fewer they are, the sooner the table is there; the more, the fewer rounds."""
    return max(next((chunk for most, chunk in _CHUNKS.items() if lanes <= most), _CHUNK), least)


def solve(
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
        return follow(plan, eq, q, values)
    driven, unknown = int(plan.known[0]), [int(c) for c in plan.unknown]
    guessed = [unknown.index(c) for c in core.guessed]
    start = [q[c] for c in range(q.shape[0])]
    go = always(eq)
    outset = apart(go, lambda: core.determinants(eq, start))
    signs = [jnp.sign(d) for d in outset]
    origin = q[driven]
    unfolded = in_order and bool(guessed)
    turning = plan.periodic[0] and not unfolded
    column = values.reshape(-1)
    width = _at_once(given, _POINTS)
    points = width if unfolded else _POINTS
    chunks = -(-given // width)
    total = max(given, width)
    if given < total:
        column = jnp.concatenate([column, jnp.broadcast_to(column[-1:], (total - given,))])
    # Otherwise slices that would reach beyond the end are moved back by JAX: the last chunk overlaps the one before.

    def lanes(j):
        u = lax.dynamic_slice_in_dim(column, j * width, width)
        return unwound(u, jnp.round((u - origin) / (2 * jnp.pi))) if turning else u

    low, high = _range(lanes, chunks, origin, width)
    rounds, dense = jnp.asarray(float(_ROUNDS)), True
    if 0 in plan.angles:
        turned = jnp.maximum(high - origin, origin - low)
        rounds = jnp.maximum(jnp.ceil(turned / STEP) + 1.0, rounds)
        dense = (turned <= _DENSE * (points - 1)) if unfolded else True
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
        guess = _expected(table, _ratio(i))
        return u, jnp.stack([guess[g] for g in guessed]) if guessed else rows, table.alive

    def look_up(i, rounds, j, table, rows, all_alive):
        """A chunk of lanes: their inputs, and what the table has for them."""
        u = lanes(j)
        return u, *interpolate([(u - low) * scale], rows, table.alive, all_alive, points)

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
            facing, (size, pivots) = apart(go, lambda: (full(found.determinants), full((found.size, found.pivots))))
            found = found._replace(determinants=facing, size=size, pivots=pivots)
            (good,) = apart(go, lambda: full([may & dense & on_branch(eq, found, signs, i < rounds)]))
            y = full(found.x[c] for c in unknown)
            new = (*y, size, pivots, good)
            made = tuple(
                lax.dynamic_update_slice_in_dim(a, b, j * width, 0) for a, b in zip(state[0], new, strict=True)
            )
            return made, y, facing, good

        count = jnp.where(i < rounds, 1, chunks)
        made, y, facing, good = lax.fori_loop(0, count, chunk, (made, table.now, table.facing, table.alive))
        table = _moved(table, y, facing, good, _ratio(i), i, norm, eq)
        # Before the lanes: whether the points go all their way again.
        again = (i == rounds - 1.0) & (rounds < most) & ~jnp.all(table.alive)
        table = lax.cond(again, lambda: begin, lambda: table)
        return jnp.where(again, 0, i + 1), jnp.where(again, _MORE * rounds, rounds), table, made

    still = full(start[c] for c in unknown)
    facing = full(outset)
    # Of different numbers, as XLA makes one array of equal ones, and then copies it for each to be written to.
    blank = (*(jnp.full(total, float(i)) for i in range(len(unknown) + 2)), jnp.zeros(total, bool))
    # The points of the table go their way round by round; in a last round come the lanes, chunk by chunk.
    begin = _Table(still, still, facing, facing, jnp.ones(width, bool))
    first = jnp.zeros((), int), jnp.asarray(rounds, q.dtype)
    most = _MORE * first[1]
    made = lax.while_loop(lambda state: state[0] <= state[1], round_, (*first, begin, blank))[-1]
    made = [a[:given] for a in made] if total != given else made
    return PoseBatch(tuple(made[:-3]), *made[-3:])


def _ratio(i: Array) -> Array:
    """A round's step over the one before: the first one is a short one."""
    return jnp.asarray([0.0, (1.0 - SHORT) / SHORT, 1.0 / (1.0 - SHORT), 1.0])[jnp.minimum(i, 3).astype(int)]


def _expected(table: _Table, ratio: Array) -> list[Array]:
    """Where the points of a table are to be after a step."""
    return [a + ratio * (a - b) for a, b in zip(table.now, table.before, strict=True)]


def _moved(
    table: _Table,
    y: tuple,
    facing: tuple,
    good: Array,
    ratio: Array,
    i: Array,
    norm: Callable,
    eq: Equations,
) -> _Table:
    """The table after a step: which of its points are where they were going, or at first not far."""
    step = norm([a - b for a, b in zip(y, table.now, strict=True)])
    off = norm([a - b for a, b in zip(y, _expected(table, ratio), strict=True)])
    close = jnp.where(
        i > 0, off <= EXTRAPOLATED * step + limits(eq.length).close * eq.length, step <= FIRST * eq.length
    )
    rise = [a - b for a, b in zip(table.facing, table.faced, strict=True)]
    close = close & steady(facing, table.facing, rise, jnp.broadcast_to(ratio, step.shape))
    return _Table(y, table.now, facing, table.facing, good & close)


def _range(lanes: Callable, chunks: int, origin: Array, chunk: int) -> tuple[Array, Array]:
    """Smallest and largest input, the start pose's among them. Chunk by chunk, which is much quicker."""

    def wider(j, bounds):
        u = lanes(j)
        return jnp.minimum(bounds[0], u), jnp.maximum(bounds[1], u)

    start = jnp.broadcast_to(origin, (chunk,))
    low, high = lax.fori_loop(0, chunks, wider, (start, start))
    return jnp.min(low), jnp.max(high)
