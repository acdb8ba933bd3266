"""Inputs that are solved for one by one, of one design or of many, however often they are mapped.

Each is followed from the same pose along the straight change of the inputs. ``jax.vmap`` of an analysis arrives here.
"""

import functools

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap

from jaxnc.solvers import batch
from jaxnc.solvers.designs import folded, followed, marched, walked_on
from jaxnc.solvers.found import Found
from jaxnc.solvers.kernel import kernel, writes_out
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.sequences import scattered_around
from jaxnc.system.equations import Equations
from jaxnc.system.precision import numbers
from jaxnc.types import Array

_LINE = 16  # inputs of a design from which it pays to follow a line of poses first


def scattered(plan: Plan, eq: Equations, q: Array, near: Array, values: Array) -> Found:
    """Solve for inputs one by one.

    Args:
        plan: what is solved for.
        eq: the equations of one design.
        q: the pose that all are followed from, ``(N,)``.
        near: known coordinates counted from the turn nearest to the pose, ``(B, k)``.
        values: the same as they were asked for.

    Returns:
        What was found, ``(B,)``.
    """
    return (_of_one_design if writes_out(plan) else _by_themselves)(plan)(eq, q, near, values)


def _by_themselves(plan: Plan):
    def lanes(eq, q, near, values):
        begin = jnp.broadcast_to(q, (values.shape[0], q.shape[0]))
        starts = begin.at[:, plan.known].add(values - near)
        return _first(followed(plan, eq, starts, values[:, None], begin))

    return lanes


@functools.lru_cache(maxsize=256)
def _of_one_design(plan: Plan):
    @custom_vmap
    def lanes(eq, q, near, values):
        count, driven = values.shape[0], len(plan.driven)
        if count < batch.LEAST or not batch.suits(plan):
            if not _in_lines(plan, eq, count):
                return _by_themselves(plan)(eq, q, near, values)
            return jax.tree.map(lambda a: a[0], _around(plan, True, eq, q[None], near[None], values[None]))
        found = batch.solve(plan, eq, q, values[:, :driven])
        none = jnp.zeros(count, bool)
        known = tuple(values[:, k] for k in range(values.shape[1]))
        out = Found(found.x, known, found.good, none, found.size, found.pivots, none, none)
        return _completed(plan, True, eq, q[None], near[None], values[None], out)

    @lanes.def_vmap
    def mapped(size, which, eq, q, near, values):
        in_eq, in_q, in_near, in_values = which
        shared = not any(jax.tree.leaves(in_eq))
        near = near if in_near else jnp.broadcast_to(near, (size, *near.shape))
        values = values if in_values else jnp.broadcast_to(values, (size, *values.shape))
        if shared and not in_q:  # more of the same design
            with numbers(values):
                out = lanes(eq, q, near.reshape(-1, near.shape[-1]), values.reshape(-1, values.shape[-1]))
            out = jax.tree.map(lambda a: a.reshape(size, -1), out)
            return out, jax.tree.map(lambda _: True, out)
        if not shared:
            eq = jax.tree.map(lambda a, has: a if has else jnp.broadcast_to(a, (size, *a.shape)), eq, in_eq)
        q = q if in_q else jnp.broadcast_to(q, (size, *q.shape))
        with numbers(values):
            out = _of_many(plan, shared)(eq, q, near, values)
        return out, jax.tree.map(lambda _: True, out)

    return lanes


@functools.lru_cache(maxsize=256)
def _of_many(plan: Plan, shared: bool):
    """The same for designs, as a leading axis of everything."""

    @custom_vmap
    def many(eq, q, near, values):
        if _in_lines(plan, eq, values.shape[1]):
            return _around(plan, shared, eq, q, near, values)
        begin = jnp.broadcast_to(q[:, None], (*values.shape[:2], q.shape[-1]))
        starts = begin.at[..., plan.known].add(values - near)
        return _first(marched(plan, shared, True, eq, starts, values[:, :, None], begin))

    @many.def_vmap
    def mapped(size, which, eq, q, near, values):
        still, eq, ways = folded(size, shared, which, eq, (q, near, values))
        with numbers(values):
            out = _of_many(plan, still)(eq, *ways)
        out = jax.tree.map(lambda a: a.reshape(size, -1, *a.shape[1:]), out)
        return out, jax.tree.map(lambda _: True, out)

    return many


def _in_lines(plan: Plan, eq: Equations, count: int) -> bool:
    """Whether so many inputs of a design are solved for between poses of lines that are followed first."""
    return count >= _LINE and len(plan.driven) == 1 and kernel(plan).closed(eq)


def _around(plan: Plan, shared: bool, eq: Equations, q: Array, near: Array, values: Array) -> Found:
    """Designs ``(D, …)`` with B inputs each: those between poses that are on the branch, then the others."""

    def equations(at):
        return eq if shared else jax.tree.map(lambda a: jnp.moveaxis(a[at], 0, -1), eq)

    out = scattered_around(kernel(plan), equations, q, near, values)
    alone = jax.tree.map(lambda a: a.reshape(-1), out._replace(exhausted=jnp.zeros(values.shape[:2], bool)))
    alone = _completed(plan, shared, eq, q, near, values, alone)
    return jax.tree.map(lambda a: a.reshape(values.shape[:2]), alone)


def _completed(plan: Plan, shared: bool, eq: Equations, q: Array, near: Array, values: Array, out: Found) -> Found:
    """Lanes ``(D · B,)`` of which those that are not right are walked to, one by one."""
    count = values.shape[1]
    values, near = (a.reshape(-1, a.shape[-1]) for a in (values, near))

    def lane(at):
        begin = q[at // count]
        start = begin.at[:, plan.known].add(values[at] - near[at])
        return eq if shared else jax.tree.map(lambda a: a[at // count], eq), start, values[at][:, None], begin

    alone = jax.tree.map(lambda a: a[:, None], out)._replace(exhausted=out.exhausted)
    return _first(walked_on(plan, alone, lane, shared, lambda: jnp.any(values != near, axis=1)))


def _first(out: Found) -> Found:
    """Sequences of one pose each as that pose."""
    return jax.tree.map(lambda a: a[..., 0], out._replace(exhausted=out.exhausted[..., None]))
