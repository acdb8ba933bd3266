"""Rows of a motion, their derivatives and what they accelerate by: read from the kinds as one straight-line program.

What a simulation evaluates in every stage is compiled with it, and differentiated for its gradient, so that it is kept
short: values, slopes and second rates of a kind share what they have in common.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.constraints import Kind
from jaxnc.reading import Builder, function, partials, rate
from jaxnc.solvers.plan import Plan
from jaxnc.system.equations import Equations
from jaxnc.system.structure import arrays, pattern, program, size
from jaxnc.types import Array, Coordinates

Read = tuple[Callable[[list[Any]], Any], tuple[tuple[int, int], ...]]


@functools.cache
def _read(kind: Kind, dim: int) -> Read:
    """A kind's rows, their slopes, and their second rates at constant speed, one after the other; where slopes belong.

    The function takes variables, constants and the variables' rates, each with an instance in each place.
    """
    found, count = program(kind, "residual", dim), size(kind, dim)
    if found is None:
        return _by_jax(kind, dim)
    slopes, places = partials(found, range(count))
    b = Builder(found.inputs + count)
    at = [b.append(part, b.first)[k] for part in (found, slopes) for k in part.outputs]
    still = b.number(0.0)
    bent = rate(found, range(count), 2)
    at += [k for k in [b.append(bent, [*b.first, *(still,) * count])[k] for k in bent.outputs]]
    return function(b.program(at), jnp), places


def _by_jax(kind: Kind, dim: int) -> Read:
    """The same of a kind that cannot be read."""
    count, both = size(kind, dim), size(kind, dim) + len(kind.constants)
    places = tuple((int(r), int(v)) for r, v in np.argwhere(pattern(kind, dim)))

    def rows(x: Array) -> Array:
        return jnp.stack([jnp.asarray(r) for r in kind.residual(*arrays(kind, dim, x))])

    def one(x: Array) -> Array:
        x, way = x[:both], jnp.zeros(both, x.dtype).at[:count].set(x[both:])
        slopes = jax.jacfwd(rows)(x)
        bent = jax.jvp(lambda y: jax.jvp(rows, (y,), (way,))[1], (x,), (way,))[1]
        return jnp.concatenate([rows(x), jnp.stack([slopes[r, v] for r, v in places]), bent])

    return lambda x: tuple(jax.vmap(one, out_axes=1)(jnp.stack(jnp.broadcast_arrays(*x), axis=1))), places


@functools.lru_cache(maxsize=256)
def _places(view: Plan) -> tuple[np.ndarray, list[np.ndarray]]:
    """Where the plan's rows are among all values, and its gathers of slopes among all slopes that are not zero."""
    top = view.topology
    rows, order, first, start = [np.zeros(0, int)], [np.zeros(0, int)], 0, 0
    for block, layout in zip(top.blocks, top.layout, strict=True):
        rows.append(layout.rows.T.reshape(-1))
        _, places = _read(block.kind, top.dim)
        width, count = layout.variables.shape[1], len(block.kind.rows)
        there = np.full((block.count, count, width), -1)
        for k, (r, v) in enumerate(places):
            there[:, r, v] = first + k * block.count + np.arange(block.count)
        order.append(there.reshape(-1))
        first += len(places) * block.count
        start += there.size
    whole = np.concatenate([*order, [-1]])
    whole = np.where(whole < 0, first, whole)  # a zero stands behind the slopes
    back = np.empty(len(top.rows), int)
    back[np.concatenate(rows)] = np.arange(len(top.rows))
    return back[view.rows], [whole[g] for g in view.gathers]


def evaluate(view: Plan, eq: Equations, q: Coordinates, v: Coordinates) -> tuple[Array, Array, Array, Array]:
    """Rows of a plan, as lengths.

    Args:
        view: the plan.
        eq: the equations.
        q: pose.
        v: rates.

    Returns:
        Their values ``(m,)``, derivatives with respect to unknown ``(m, n)`` and known ``(m, k)`` coordinates, and
        second rates without accelerations ``(m,)``.
    """
    top = view.topology
    parts: tuple[list, list, list] = ([jnp.zeros(0)], [jnp.zeros(0)], [jnp.zeros(0)])
    for b, (block, layout) in enumerate(zip(top.blocks, top.layout, strict=True)):
        run, places = _read(block.kind, top.dim)
        count = len(block.kind.rows)
        if not count:
            continue
        x, dx = q[layout.variables.T], v[layout.variables.T]
        found = run([*x, *eq.constants[b].T, *dx])
        which = [*range(count), *(r for r, _ in places), *range(count)]
        found = jnp.stack([jnp.broadcast_to(f, (block.count,)) for f in found]) * eq.scales[b].T[np.array(which)]
        ends = (0, count, count + len(places), len(which))
        for k, part in enumerate(parts):
            part.append(found[ends[k] : ends[k + 1]].reshape(-1))
    values, slopes, bent = (jnp.concatenate(part) for part in parts)
    at, gathers = _places(view)
    padded = jnp.concatenate([slopes, jnp.zeros(1, slopes.dtype)])
    both = sum((padded[g] for g in gathers[1:]), padded[gathers[0]])
    n = len(view.unknown)
    return values[at], both[:, :n], both[:, n:], bent[at]
