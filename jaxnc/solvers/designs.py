"""Sequences of inputs of many designs at once: what `follow` does for one, as lanes, however often it is mapped.

``jax.vmap`` of a sweep arrives here. Designs are solved side by side or march together; whichever fails a check is
followed again by itself.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import custom_vmap

from jaxnc.solvers.chunks import in_chunks
from jaxnc.solvers.follow import Followed, follow
from jaxnc.solvers.found import Found, put_together, taken_apart
from jaxnc.solvers.kernel import brief, kernel, writes_out
from jaxnc.solvers.look import Look
from jaxnc.solvers.march import FEEL, marcher, setting_out, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.sequences import TURNING, in_sequences
from jaxnc.solvers.walk import Walk, walks
from jaxnc.system.equations import Equations
from jaxnc.system.precision import numbers
from jaxnc.types import Array

_CHUNK = 512  # lanes that march together
_AGAIN = 128  # lanes followed again together
_FIRST = 16  # steps from the start pose to the first value


def followed(plan: Plan, eq: Equations, q: Array, values: Array, other: Array, patient: bool = True) -> Found:
    """A branch followed from a pose through each of several sequences of input values.

    Args:
        plan: what is solved for.
        eq: the equations of one design.
        q: poses that meet them, where the ways begin, ``(B, N)``.
        values: known coordinates, ``(B, T, k)``.
        other: the same poses with angles counted otherwise, see `follow`.
        patient: walk on by itself from where the march fails a check; otherwise that is where the branch is left.

    Returns:
        What was found, ``(B, T)``. Mapped over designs, these march together.
    """
    return _one(plan, patient)(eq, q, values, other)


@functools.lru_cache(maxsize=256)
def _one(plan: Plan, patient: bool):
    @custom_vmap
    def one(eq, q, values, other):
        if not patient:
            return jax.tree.map(lambda a: a[0], marched(plan, True, False, eq, q[None], values[None], other[None]))
        return in_order(eq, q, values, other)

    def in_order(eq, q, values, other):
        return taken_apart(plan, _chunked(lambda *a: follow(plan, eq, *a), (q, values, other)))

    if not (writes_out(plan) if patient else brief(plan)):
        return in_order

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
    count = ways[0].shape[1]
    if shared:  # the ways of one design
        ways = tuple(a.reshape(1, size * count, *a.shape[2:]) for a in ways)
    with numbers(ways[0]):
        out = _many(plan, shared, patient)(eq, *ways)
    if shared:
        out = jax.tree.map(lambda a: a.reshape(size, count, *a.shape[2:]), out)
    return out, jax.tree.map(lambda _: True, out)


@functools.lru_cache(maxsize=256)
def _many(plan: Plan, shared: bool, patient: bool):
    @custom_vmap
    def many(eq, q, values, other):
        return marched(plan, shared, patient, eq, q, values, other)

    @many.def_vmap
    def mapped(size, which, eq, q, values, other):
        still, eq, ways = folded(size, shared, which, eq, (q, values, other))
        with numbers(ways[0]):
            out = _many(plan, still, patient)(eq, *ways)
        out = jax.tree.map(lambda a: a.reshape(size, -1, *a.shape[1:]), out)
        return out, jax.tree.map(lambda _: True, out)

    return many


def folded(size: int, shared: bool, which: Any, eq: Equations, ways: tuple) -> tuple[bool, Equations, tuple]:
    """A mapped axis folded into that of the designs.

    Args:
        size: of the mapped axis.
        shared: whether the equations are those of one design for all.
        which: of equations and ways, those that are mapped.
        eq: equations, designs first unless `shared`.
        ways: arrays with designs first.

    Returns:
        Whether the equations are still shared; equations; ways.
    """
    in_eq, in_ways = which[0], which[1:]
    count = ways[0].shape[1] if in_ways[0] else ways[0].shape[0]
    ways = tuple(
        (a if has else jnp.broadcast_to(a, (size, *a.shape))).reshape(size * count, *a.shape[2 if has else 1 :])
        for a, has in zip(ways, in_ways, strict=True)
    )
    if shared and not any(jax.tree.leaves(in_eq)):
        return True, eq, ways

    def full(a, has):
        a = a if has else jnp.broadcast_to(a, (size, *a.shape))
        a = jnp.broadcast_to(a[:, None], (size, count, *a.shape[1:])) if shared else a
        return a.reshape(size * count, *a.shape[2:])

    return False, jax.tree.map(full, eq, in_eq), ways


def marched(plan: Plan, shared: bool, patient: bool, eq: Equations, q: Array, values: Array, other: Array) -> Found:
    """Designs ``(D, …)`` with B ways each, ``q (D, B, N)``, ``values (D, B, T, k)``."""
    designs, ways = values.shape[:2]
    lanes = designs * ways
    flat = tuple(a.reshape(lanes, *a.shape[2:]) for a in (q, values, other))
    owner = jnp.arange(lanes) // ways

    def design(at):
        return eq if shared else jax.tree.map(lambda a: a[at], eq)

    def last(at):
        """Equations of some lanes, lanes last."""
        those = design(owner[at])
        return those if shared else jax.tree.map(lambda a: jnp.moveaxis(a, 0, -1), those)

    core = kernel(plan)
    if core.closed(eq):
        out = in_sequences(core, last, *flat[:2])
    else:
        out = in_chunks(lambda at: _together(plan, last(at), flat[0][at], flat[1][at]), _CHUNK // 2, jnp.arange(lanes))
    if not patient:
        out = _stopped(plan, out, flat[0])
    else:

        def differs():
            return jnp.any(flat[0] != flat[2], axis=1)

        out = walked_on(plan, out, lambda at: (design(owner[at]), *(a[at] for a in flat)), shared, differs)
    return jax.tree.map(lambda a: a.reshape(designs, ways, *a.shape[1:]), out)


def _stopped(plan: Plan, out: Found, q: Array) -> Found:
    """Sequences that end where they fail a check: the last pose before is repeated."""
    known = jnp.sum(out.reached, axis=1, keepdims=True)

    def held(a, c):
        last = jnp.take_along_axis(a, jnp.maximum(known - 1, 0), axis=1)
        return jnp.where(out.reached, a, jnp.where(known > 0, last, q[:, int(c), None]))

    x, inputs = (
        tuple(held(a, c) for a, c in zip(columns, which, strict=True))
        for columns, which in ((out.x, plan.unknown), (out.known, plan.known))
    )
    return out._replace(x=x, known=inputs, exhausted=~jnp.all(out.reached, axis=1))


def _together(plan: Plan, eq: Equations, q: Array, values: Array) -> Found:
    """March lanes (first axis of q and values; last of eq)."""
    core, (lanes, total) = kernel(plan), values.shape[:2]
    x = [q[:, c] for c in range(q.shape[1])]
    signs = core.signs(eq, x)
    goal = jnp.moveaxis(values, 0, -1)
    before = jnp.concatenate([q[None, :, plan.known].swapaxes(1, 2), goal[:-1]])
    parts, counts = _substeps(total, len(plan.driven))
    step = marcher(core, eq, x, signs)

    def value(now, way):
        begin, end, part, count = way
        now = lax.fori_loop(0, count, lambda i, now: step(now, begin + part[i] * (end - begin)), now)
        return now, (*now.x[: len(plan.unknown)], now.size, now.pivots, now.good)

    start = setting_out(core, eq, x, (lanes,))
    _, out = lax.scan(value, start, (before, goal, jnp.asarray(parts), jnp.asarray(counts)))
    *y, size, pivots, good = (a.T for a in out)
    none, columns = jnp.zeros((lanes, total), bool), tuple(values[..., k] for k in range(values.shape[2]))
    return Found(tuple(y), columns, good, none, size, pivots, none, jnp.zeros(lanes, bool))


def _substeps(total: int, driven: int) -> tuple[np.ndarray, np.ndarray]:
    """Parts of the way to each value after every step, ``(T, most)``, and how many steps there are."""
    between = max(1, -(-TURNING // total))
    even = np.arange(1, between + 1) / between
    felt = np.append(FEEL / between, even)
    first = np.append(FEEL, np.arange(1, _FIRST + 1)) / _FIRST
    # Where the way turns (from the start to the first value; anywhere with several inputs) a short step comes first.
    ways = [first, *(felt if driven > 1 or k == 1 else even for k in range(1, total))]
    parts = np.ones((total, max(len(w) for w in ways)))
    for k, w in enumerate(ways):
        parts[k, : len(w)] = w
    return parts, np.array([len(w) for w in ways])


def walked_on(plan: Plan, out: Found, lane, shared: bool, differs) -> Found:
    """Walk the lanes that failed a check, each by itself, on from the last pose that kept them all.

    A first round walks from there; a second one, for those that did not come to their first value at all, from the same
    start with its angles counted otherwise.

    Args:
        plan: what is solved for.
        out: what is known of all lanes.
        lane: equations and ways of some lanes.
        shared: whether the equations are those of one design.
        differs: makes the mask of lanes whose angles can be counted otherwise.
    """
    lanes = out.reached.shape[0]
    group = min(_AGAIN, lanes)

    def body(state):
        second, open_, _, old = state
        some = jnp.nonzero(open_, size=group, fill_value=lanes)[0]
        at = jnp.minimum(some, lanes - 1)  # what fills the last group up is read as the last lane, and not written
        eq, q, values, other = lane(at)
        q = jnp.where(second, other, q)
        those = put_together(plan, q, jax.tree.map(lambda a: a[at], old))
        new = taken_apart(plan, _onward(plan, eq, q, values, those, shared))
        old = jax.tree.map(lambda a, b: a.at[some].set(b, mode="drop"), old, new)
        open_ = open_.at[some].set(False, mode="drop")
        after = ~second & ~jnp.any(open_)
        open_ = lax.cond(after, lambda: ~old.reached[:, 0] & differs(), lambda: open_)
        return second | after, open_, jnp.any(open_), old

    failed = ~jnp.all(out.reached, axis=1)
    return lax.while_loop(lambda st: st[2], body, (jnp.zeros((), bool), failed, jnp.any(failed), out))[-1]


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
