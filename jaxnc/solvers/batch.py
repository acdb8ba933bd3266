"""Very many inputs of one design: a table of poses where they lie, then all lanes from there, in chunks.

Both are one loop with one body, because the body is what takes time to compile. The first rounds move the points of
the table from the start pose along straight ways to their places; every later round takes one chunk of lanes, guesses
their poses from the table and solves them. Whatever cannot be answered for is left to the robust walk.
"""

import functools
import itertools
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.solvers.kernel import kernel, writes_out
from jaxnc.solvers.march import FEEL, right, steady
from jaxnc.solvers.plan import Plan
from jaxnc.system.equations import Equations, pure_numbers
from jaxnc.system.precision import limits
from jaxnc.types import Array, Coordinates, Float

LEAST = 512  # lanes from which the table pays
_CHUNK = 2048  # lanes in one round: they stay in the cache
_POINTS = {1: 129, 2: 17, 3: 9}  # of the table, along each input
_ROUNDS = {1: 32, 2: 16, 3: 16}  # from the start pose to the points of the table
_SHARP = 0.5  # a solution may be off its extrapolation by this part of the step
_FIRST = 0.25  # of the size: the first step from the start pose is shorter


class Batch(NamedTuple):
    """Solved lanes.

    Attributes:
        x: unknown coordinates, each ``(lanes,)``.
        size: largest residual, a length, ``(lanes,)``.
        pivots: smallest over largest pivot, ``(lanes,)``.
        good: whether the pose is right, ``(lanes,)``.
    """

    x: tuple[Array, ...]
    size: Array
    pivots: Array
    good: Array


def suits(plan: Plan) -> bool:
    """Whether there is a table for a plan's inputs."""
    return len(plan.driven) in _POINTS and writes_out(plan)


def solve(
    plan: Plan, eq: Equations, q: Coordinates, values: Float[Array, "lanes k"], count: Array | None = None
) -> Batch:
    """Solve a batch of inputs of one design on the branch of a pose.

    Args:
        plan: what is solved for.
        eq: the equations.
        q: the pose that every lane is followed from.
        values: driven coordinates; angles that nothing else depends on count from the turn nearest to the pose.
        count: solve only so many of them, the others are left at zero.

    Returns:
        The lanes. Those that are not `good` are not reached, or not solved yet.
    """
    core, (given, k) = kernel(plan), values.shape
    driven, unknown = [int(c) for c in plan.known[:k]], [int(c) for c in plan.unknown]
    guessed = [unknown.index(c) for c in core.guessed(eq)]
    start = [q[c] for c in range(q.shape[0])]
    signs = core.signs(eq, start)
    origin = q[np.array(driven)]
    turning = periodic(plan)[:k]

    def near(u, j):
        return u - 2 * jnp.pi * jnp.round((u - origin[j]) / (2 * jnp.pi)) if turning[j] else u

    columns = [values.reshape(-1) if k == 1 else values[:, j] for j in range(k)]
    low = jnp.stack([jnp.minimum(origin[j], jnp.min(near(u, j))) for j, u in enumerate(columns)])
    high = jnp.stack([jnp.maximum(origin[j], jnp.max(near(u, j))) for j, u in enumerate(columns)])
    points, rounds = _POINTS[k], _ROUNDS[k]
    scale = jnp.where(high > low, (points - 1) / jnp.where(high > low, high - low, 1.0), 0.0)
    index = np.minimum(np.arange(_CHUNK), points**k - 1)
    goals = [low[i] + (high - low)[i] * (index // points ** (k - 1 - i) % points) / (points - 1) for i in range(k)]

    way = np.concatenate([[FEEL], np.arange(1, rounds)]) / (rounds - 1)
    steps = np.diff(way, prepend=0.0)
    parts, ratios = jnp.asarray(way), jnp.asarray(np.append(0.0, steps[1:] / steps[:-1]))

    chunks = -(-given // _CHUNK)
    total = max(given, _CHUNK)
    if given < total:
        columns = [jnp.concatenate([u, jnp.broadcast_to(u[-1:], (total - given,))]) for u in columns]
    # Otherwise slices that would reach beyond the end are moved back by JAX: the last chunk overlaps the one before.
    pure = pure_numbers(plan.topology)[plan.unknown]

    def along(i, now, before, alive):
        """A round of the table: where the points are next, and where they were going."""
        u = [origin[j] + parts[i] * (goals[j] - origin[j]) for j in range(k)]
        return u, [a + ratios[i] * (a - b) for a, b in zip(now, before, strict=True)], alive

    def look_up(i, now, before, alive):
        """A chunk of lanes: their inputs, and what the table has for them."""
        u = [near(lax.dynamic_slice_in_dim(u, (i - rounds) * _CHUNK, _CHUNK), j) for j, u in enumerate(columns)]
        guess, inside = _interpolated(u, low, scale, [now[g] for g in guessed], alive, points)
        at = dict(zip(guessed, guess, strict=True))
        return u, [at.get(j, start[c] + jnp.zeros(_CHUNK)) for j, c in enumerate(unknown)], inside

    def norm(change):
        return jnp.sqrt(sum((d * eq.length if p else d) ** 2 for d, p in zip(change, pure, strict=True)))

    def arrived(i, y, now, guess, facing, faced):
        """Whether the points of the table are where they were going, or at first not far."""
        step = norm([a - b for a, b in zip(y, now, strict=True)])
        off = norm([a - b for a, b in zip(y, guess, strict=True)])
        close = jnp.where(i > 0, off <= _SHARP * step + limits(eq.length).close * eq.length, step <= _FIRST * eq.length)
        rise = [a - b for a, b in zip(*faced, strict=True)]
        return close & steady(facing, faced[0], rise, jnp.broadcast_to(ratios[i], (_CHUNK,)))

    def body(i, state):
        now, before, faced, alive, made = state
        moving = i < rounds
        u, guess, may = lax.cond(moving, along, look_up, i, now, before, alive)
        x = list(start)
        for c, v in zip((*unknown, *driven), (*guess, *u), strict=True):
            x[c] = v
        found = core.solve(eq, x, signs)
        y = tuple(jnp.broadcast_to(found.x[c], (_CHUNK,)) for c in unknown)
        good = may & right(eq, found, signs)
        facing = tuple(jnp.broadcast_to(d, (_CHUNK,)) for d in found.determinants)
        close = lax.cond(moving, arrived, lambda *_: jnp.ones(_CHUNK, bool), i, y, now, guess, facing, faced)
        new = (*y, found.size, found.pivots, good)
        at = jnp.maximum(i - rounds, 0) * _CHUNK
        made = tuple(
            lax.dynamic_update_slice_in_dim(a, jnp.broadcast_to(b, (_CHUNK,)), at, 0)
            for a, b in zip(made, new, strict=True)
        )
        before = tuple(jnp.where(moving, a, b) for a, b in zip(now, before, strict=True))
        now = tuple(jnp.where(moving, a, b) for a, b in zip(y, now, strict=True))
        faced = lax.cond(moving, lambda: (facing, faced[0]), lambda: faced)
        return now, before, faced, jnp.where(moving, good & close, alive), made

    still = tuple(start[c] + jnp.zeros(_CHUNK) for c in unknown)
    blank = (*[jnp.zeros(total)] * (len(unknown) + 2), jnp.zeros(total, bool))
    faced = tuple(jnp.broadcast_to(d, (_CHUNK,)) for d in core.determinants(eq, start))
    state = (still, still, (faced, faced), jnp.ones(_CHUNK, bool), blank)
    last = chunks if count is None else -(-count // _CHUNK)
    made = lax.fori_loop(0, rounds + last, body, state)[-1]
    made = [a[:given] for a in made] if total != given else made
    return Batch(tuple(made[:-3]), *made[-3:])


def periodic(plan: Plan) -> np.ndarray:
    """Which of the known coordinates are angles that nothing else depends on."""
    top = plan.topology
    found = np.zeros(len(top.coordinates), dtype=bool)
    found[len(top.coordinates) - len(top.scalars) :] = top.periodic
    return found[plan.known]


def _interpolated(
    u: list[Array], low: Array, scale: Array, table: list[Array], reached: Array, points: int
) -> tuple[list[Any], Array]:
    """Multilinear interpolation in the table, and whether all its points around are on the branch."""
    k = len(u)
    index, parts = jnp.zeros(u[0].shape, np.int32), []
    for i in range(k):
        place = (u[i] - low[i]) * scale[i]
        cell = jnp.clip(place.astype(np.int32), 0, points - 2)
        parts.append(place - cell)
        index = index * points + cell
    guess: list[Any] = [jnp.zeros(u[0].shape)] * len(table)
    corners = [
        (corner, index + sum(b * points ** (k - 1 - i) for i, b in enumerate(corner)))
        for corner in itertools.product(range(2), repeat=k)
    ]
    inside = lax.cond(
        jnp.all(reached),
        lambda *_: jnp.ones(u[0].shape, bool),
        lambda *at: functools.reduce(jnp.logical_and, [reached[a] for a in at]),
        *(at for _, at in corners),
    )
    for corner, at in corners:
        share = functools.reduce(jnp.multiply, [p if b else 1.0 - p for b, p in zip(corner, parts, strict=True)])
        guess = [g + share * row[at] for g, row in zip(guess, table, strict=True)]
    return guess, inside
