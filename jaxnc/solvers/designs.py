"""Many designs at once: what `follow` does for one, as lanes, however often it is mapped.

``jax.vmap`` of an analysis arrives here. Designs march together; whichever fails a check is followed again by itself.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import custom_vmap

from jaxnc.solvers import batch
from jaxnc.solvers.follow import Followed, follow
from jaxnc.solvers.kernel import brief, kernel, writes_out
from jaxnc.solvers.look import Look
from jaxnc.solvers.march import FEEL, marcher, setting_out, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.walk import Walk, walks
from jaxnc.system.equations import Equations
from jaxnc.system.precision import numbers
from jaxnc.types import Array

_CHUNK = 512  # lanes that march together
_AGAIN = 128  # lanes followed again together
_FIRST = 16  # steps from the start pose to the first value
_TURN = 64  # steps at least for a sequence of values


def followed(plan: Plan, eq: Equations, q: Array, values: Array, other: Array, patient: bool = True) -> Followed:
    """A branch followed from a pose through each of several sequences of input values.

    Args:
        plan: what is solved for.
        eq: the equations of one design.
        q: poses that meet them, where the ways begin, ``(B, N)``.
        values: known coordinates, ``(B, T, k)``.
        other: the same poses with angles counted otherwise, see `follow`.
        patient: walk on by itself from where the march fails a check; otherwise that is where the branch is left.

    Returns:
        As of `follow`, with a leading axis B. Mapped over designs, these march together.
    """
    return _one(plan, patient)(eq, q, values, other)


def scattered(plan: Plan, eq: Equations, q: Array, near: Array, values: Array) -> Followed:
    """Very many inputs, each followed from the same pose; see `jaxnc.solvers.batch`.

    Args:
        plan: what is solved for.
        eq: the equations of one design.
        q: the pose, ``(N,)``.
        near: known coordinates counted from the turn nearest to the pose, ``(B, k)``.
        values: the same as they were asked for.

    Returns:
        As of `follow`, with one pose in each of B sequences.
    """
    return _scattered(plan)(eq, q, near, values)


@functools.lru_cache(maxsize=256)
def _scattered(plan: Plan):
    @custom_vmap
    def lanes(eq, q, near, values):
        count, driven = values.shape[0], len(plan.driven)
        found = batch.solve(plan, eq, q, values[:, :driven])
        columns = dict(zip(plan.unknown.tolist(), found.x, strict=True))
        columns.update(zip(plan.known.tolist(), values.T, strict=True))
        poses = jnp.stack([columns.get(c, jnp.broadcast_to(q[c], (count,))) for c in range(q.shape[0])], axis=1)
        none, good = jnp.zeros((count, 1), bool), found.good[:, None]
        look = Look(found.size[:, None], found.pivots[:, None], jnp.zeros((count, 1, 0)), good, none)
        out = Followed(poses[:, None], good, none, look, jnp.zeros(count), jnp.zeros(count, bool))

        def lane(at):
            begin = jnp.broadcast_to(q, (at.shape[0], q.shape[0]))
            return eq, begin.at[:, plan.known].add(values[at] - near[at]), values[at][:, None], begin

        return _again(plan, out, lane, True, jnp.any(values != near, axis=1))

    @lanes.def_vmap
    def mapped(size, which, eq, q, near, values):
        in_eq, in_q, _, in_values = which
        count = values.shape[1] if in_values else values.shape[0]
        begin = jnp.broadcast_to(q[:, None] if in_q else q, (size, count, q.shape[-1]))
        starts = begin.at[..., plan.known].add(values - near)
        full = jnp.broadcast_to(values, (size, *values.shape[-2:]))[..., None, :]
        return _spread(plan, size, True, (in_eq, True, True, True), eq, (starts, full, begin))

    return lanes


@functools.lru_cache(maxsize=256)
def _one(plan: Plan, patient: bool):
    @custom_vmap
    def one(eq, q, values, other):
        if not patient:
            return jax.tree.map(lambda a: a[0], _march(plan, True, False, eq, q[None], values[None], other[None]))
        return _chunked(lambda *a: follow(plan, eq, *a), (q, values, other))

    if not (writes_out(plan) if patient else brief(plan)):
        return lambda eq, q, values, other: _chunked(lambda *a: follow(plan, eq, *a), (q, values, other))

    @one.def_vmap
    def mapped(size, which, eq, q, values, other):
        return _spread(plan, size, patient, which, eq, (q, values, other))

    return one


def _spread(plan: Plan, size: int, patient: bool, which: Any, eq: Equations, ways: tuple):
    """Hand a mapped axis on to `_many`, which takes designs as a leading axis of everything."""
    in_eq, in_ways = which[0], which[1:]
    shared = not any(jax.tree.leaves(in_eq))
    if not shared:
        eq = jax.tree.map(lambda a, has: a if has else jnp.broadcast_to(a, (size, *a.shape)), eq, in_eq)
    ways = tuple(a if has else jnp.broadcast_to(a, (size, *a.shape)) for a, has in zip(ways, in_ways, strict=True))
    with numbers(ways[0]):
        out = _many(plan, shared, patient)(eq, *ways)
    return out, jax.tree.map(lambda _: True, out)


@functools.lru_cache(maxsize=256)
def _many(plan: Plan, shared: bool, patient: bool):
    @custom_vmap
    def many(eq, q, values, other):
        return _march(plan, shared, patient, eq, q, values, other)

    @many.def_vmap
    def mapped(size, which, eq, q, values, other):
        in_eq, in_ways = which[0], which[1:]
        ways = zip((q, values, other), in_ways, strict=True)
        ways = tuple(a if has else jnp.broadcast_to(a, (size, *a.shape)) for a, has in ways)
        count = q.shape[1] if in_ways[0] else q.shape[0]
        still = shared and not any(jax.tree.leaves(in_eq))
        if not still:

            def full(a, has):
                a = a if has else jnp.broadcast_to(a, (size, *a.shape))
                a = jnp.broadcast_to(a[:, None], (size, count, *a.shape[1:])) if shared else a
                return a.reshape(size * count, *a.shape[2:])

            eq = jax.tree.map(full, eq, in_eq)
        with numbers(ways[0]):
            out = _many(plan, still, patient)(eq, *(a.reshape(size * count, *a.shape[2:]) for a in ways))
        out = jax.tree.map(lambda a: a.reshape(size, count, *a.shape[1:]), out)
        return out, jax.tree.map(lambda _: True, out)

    return many


def _march(plan: Plan, shared: bool, patient: bool, eq: Equations, q: Array, values: Array, other: Array) -> Followed:
    """Designs ``(D, …)`` with B ways each, ``q (D, B, N)``, ``values (D, B, T, k)``."""
    designs, ways = values.shape[:2]
    lanes = designs * ways
    flat = tuple(a.reshape(lanes, *a.shape[2:]) for a in (q, values, other))
    owner = jnp.arange(lanes) // ways

    def design(at):
        return eq if shared else jax.tree.map(lambda a: a[at], eq)

    def some(at):
        those = design(owner[at])
        last = those if shared else jax.tree.map(lambda a: jnp.moveaxis(a, 0, -1), those)
        return _together(plan, last, flat[0][at], flat[1][at])

    chunk = min(_CHUNK, lanes)
    index = np.minimum(np.arange(-(-lanes // chunk) * chunk), lanes - 1).reshape(-1, chunk)
    out = some(index[0]) if len(index) == 1 else lax.map(some, jnp.asarray(index))
    if len(index) > 1:
        out = jax.tree.map(lambda a: a.reshape(index.size, *a.shape[2:]), out)
    out = jax.tree.map(lambda a: a[:lanes], out)
    differs = jnp.any(flat[0] != flat[2], axis=1)
    if not patient:
        out = out._replace(exhausted=~jnp.all(out.reached, axis=1))
    else:
        out = _again(plan, out, lambda at: (design(owner[at]), *(a[at] for a in flat)), shared, differs)
    return jax.tree.map(lambda a: a.reshape(designs, ways, *a.shape[1:]), out)


def _together(plan: Plan, eq: Equations, q: Array, values: Array) -> Followed:
    """March lanes (first axis of q and values; last of eq)."""
    core, (lanes, total) = kernel(plan), values.shape[:2]
    x = [q[:, c] for c in range(q.shape[1])]
    signs = core.signs(eq, x)
    goal = jnp.moveaxis(values, 0, -1)
    before = jnp.concatenate([q[None, :, plan.known].swapaxes(1, 2), goal[:-1]])
    parts, counts = _substeps(total, len(plan.driven))
    step = marcher(core, eq, x, signs)
    order = np.argsort([int(c) for c in (*plan.unknown, *plan.known, *plan.fixed)])
    still = [q[:, c] for c in plan.fixed]

    def value(now, way):
        begin, end, part, count = way
        now = lax.fori_loop(0, count, lambda i, now: step(now, begin + part[i] * (end - begin)), now)
        every = [*now.x, *still]
        return now, (jnp.stack([every[k] for k in order], axis=-1), now.good, now.size, now.pivots)

    start = setting_out(core, eq, x, (lanes,))
    _, out = lax.scan(value, start, (before, goal, jnp.asarray(parts), jnp.asarray(counts)))
    poses, good, size, pivots = (jnp.swapaxes(a, 0, 1) for a in out)
    none = jnp.zeros((lanes, total), bool)
    look = Look(size, pivots, jnp.zeros((lanes, total, 0)), good, none)
    return Followed(poses, good, none, look, jnp.zeros(lanes), jnp.zeros(lanes, bool))


def _substeps(total: int, driven: int) -> tuple[np.ndarray, np.ndarray]:
    """Parts of the way to each value after every step, ``(T, most)``, and how many steps there are."""
    between = max(1, -(-_TURN // total))
    even = np.arange(1, between + 1) / between
    felt = np.append(FEEL / between, even)
    first = np.append(FEEL, np.arange(1, _FIRST + 1)) / _FIRST
    # Where the way turns (from the start to the first value; anywhere with several inputs) a short step comes first.
    ways = [first, *(felt if driven > 1 or k == 1 else even for k in range(1, total))]
    parts = np.ones((total, max(len(w) for w in ways)))
    for k, w in enumerate(ways):
        parts[k, : len(w)] = w
    return parts, np.array([len(w) for w in ways])


def _again(plan: Plan, out: Followed, lane, shared: bool, differs: Array) -> Followed:
    """Walk the lanes that failed a check, each by itself, on from the last pose that kept them all.

    A first round walks from there; a second one, for those that did not come to their first value at all, from the same
    start with its angles counted otherwise.
    """
    lanes = out.reached.shape[0]
    group = min(_AGAIN, lanes)

    def order(failed):
        return jnp.nonzero(failed, size=lanes, fill_value=0)[0], jnp.sum(failed)

    def more(state):
        return state[0] < 2

    def body(state):
        turn, first, at, count, old = state
        # The last group is filled with lanes that are done again: the same comes out of them.
        some = at[jnp.minimum(first + jnp.arange(group), jnp.maximum(count - 1, 0))]
        eq, q, values, other = lane(some)
        q = jnp.where(turn == 0, q, other)
        those = jax.tree.map(lambda a: a[some], old)
        new = _onward(plan, eq, q, values, those, shared)
        new = jax.tree.map(lambda a, b: jnp.where(count > 0, a, b), new, those)
        old = jax.tree.map(lambda a, b: a.at[some].set(b), old, new)
        first = first + group
        after, left = order(~old.reached[:, 0] & differs & (turn == 0))
        done = first >= count
        return (
            jnp.where(done, jnp.where(left > 0, turn + 1, 2), turn),
            jnp.where(done, 0, first),
            jnp.where(done, after, at),
            jnp.where(done, left, count),
            old,
        )

    at, count = order(~jnp.all(out.reached, axis=1))
    zero = jnp.zeros((), count.dtype)
    return lax.while_loop(more, body, (jnp.where(count > 0, zero, 2), zero, at, count, out))[-1]


def _onward(plan: Plan, eq: Equations, q: Array, values: Array, old: Followed, shared: bool) -> Followed:
    """Walk lanes on from their last good poses."""
    total = values.shape[1]
    known = jnp.sum(old.reached, axis=1)
    index = jnp.arange(total)
    last = jax.vmap(lambda poses, k: poses[jnp.maximum(k - 1, 0)])(old.poses, known)
    rest = jax.vmap(lambda u, k: u[jnp.minimum(k + index, total - 1)])(values, known)
    seen = walks(plan, eq, jnp.where((known > 0)[:, None], last, q), rest, total - known, jnp.ones((), int), shared)
    in_axes = (None if shared else 0, 0, 0, 0)
    return jax.vmap(functools.partial(_joined, plan), in_axes=in_axes)(eq, seen, old, known)


def _joined(plan: Plan, eq: Equations, seen: Walk, old: Followed, known: Array) -> Followed:
    """What was known of a lane, and what a walk on from there has found."""
    total = old.reached.shape[0]
    place = jnp.arange(total) - known
    poses = jnp.where((place >= 0)[:, None], seen.poses[jnp.maximum(place, 0)], old.poses)
    limit = (place >= 0) & (place < seen.reached) & seen.touched[jnp.maximum(place, 0)]
    looked = kernel(plan).look(eq, list(poses.T))
    size, pivots, upright, mirrored = (jnp.broadcast_to(a, (total,)) for a in looked)
    fits = (size <= tolerance(eq, list(poses.T))) & upright
    found = (place < 0) | ((place < seen.reached) & fits) | limit
    found = jnp.cumsum(~found) == 0
    poses = jnp.where(found[:, None], poses, seen.last)
    look = Look(size, pivots, old.looks.signs, upright, mirrored)
    return Followed(poses, found, limit & found, look, seen.part, seen.exhausted)


def _chunked(f, arguments: tuple) -> Any:
    """A function over lanes, some at a time: what they need stays in the cache, and few wait for the slowest."""
    count, chunk = arguments[0].shape[0], 64
    if count == 1:
        return jax.tree.map(lambda a: a[None], f(*(a[0] for a in arguments)))
    if count <= 2 * chunk:
        return jax.vmap(f)(*arguments)
    chunks = -(-count // chunk)
    # The last chunk is filled up with its last lane, so that there is one shape to compile.
    lanes = np.minimum(np.arange(chunks * chunk), count - 1).reshape(chunks, chunk)
    out = lax.map(lambda some: jax.vmap(f)(*some), tuple(a[lanes] for a in arguments))
    return jax.tree.map(lambda a: a.reshape(chunks * chunk, *a.shape[2:])[:count], out)
