"""Rows of a motion, their derivatives and what they accelerate by: read from the kinds as one straight-line program.

What a simulation evaluates in every stage is compiled with it, and differentiated for its gradient, so that it is kept
short: values, slopes and second rates of a kind share what they have in common, or follow from coefficients.
"""

import functools
import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.constraints import Kind
from jaxnc.reading import Builder, function, partials, rate
from jaxnc.remembered import with_owner
from jaxnc.solvers.plan import Plan
from jaxnc.system.equations import Equations
from jaxnc.system.structure import jax_function, program, quadratic, size
from jaxnc.system.topology import Topology
from jaxnc.types import Array, Coordinates

Read = tuple[Callable[[list[Any]], Any], tuple[tuple[int, int], ...]]


@functools.lru_cache(maxsize=1024)
def _read(kind: Kind, dim: int) -> Read:
    """A kind's rows, their slopes, and their second rates at constant speed, one after the other; where slopes belong.

    Of a quadratic kind the rows only: the rest follows from its coefficients. The function takes variables, constants
    and the variables' rates, each with an instance in each place.
    """
    found, count = program(kind, "residual", dim), size(kind, dim)
    if found is None:
        return _by_jax(kind, dim)
    if quadratic(kind, dim):
        return function(found, jnp), ()
    slopes, places = partials(found, range(count))
    b = Builder(found.inputs + count)
    at = [where[k] for part in (found, slopes) for where in (b.append(part, b.first),) for k in part.outputs]
    still, bent = b.number(0.0), rate(found, range(count), 2)
    where = b.append(bent, [*b.first, *(still,) * count])
    return function(b.program([*at, *(where[k] for k in bent.outputs)]), jnp), places


def _by_jax(kind: Kind, dim: int) -> Read:
    """Read a kind through JAX that has no program."""
    count, both = size(kind, dim), size(kind, dim) + len(kind.constants)
    places = tuple(itertools.product(range(len(kind.rows)), range(count)))
    rows = jax_function(kind, "residual", dim)

    def one(x: Array) -> Array:
        x, way = x[:both], jnp.zeros(both, x.dtype).at[:count].set(x[both:])
        slopes = jax.jacfwd(rows)(x)
        bent = jax.jvp(lambda y: jax.jvp(rows, (y,), (way,))[1], (x,), (way,))[1]
        return jnp.concatenate([rows(x), jnp.stack([slopes[r, v] for r, v in places]), bent])

    return lambda x: tuple(jax.vmap(one, out_axes=1)(jnp.stack(jnp.broadcast_arrays(*x), axis=1))), places


@with_owner
def _order(view: Plan) -> np.ndarray:
    """Where the plan's rows are among those of all blocks, row by row of each."""
    rows = [np.zeros(0, int), *(layout.rows.T.reshape(-1) for layout in view.topology.layout)]
    back = np.empty(len(view.topology.rows), int)
    back[np.concatenate(rows)] = np.arange(len(back))
    return back[view.rows]


def evaluate(view: Plan, eq: Equations, q: Coordinates, v: Coordinates) -> tuple[Array, Array, Array, Array]:
    """Rows of a plan as lengths, their derivatives by unknown and known coordinates, second rates unaccelerated."""
    top = view.topology
    values, slopes, bent = [jnp.zeros(0)], [], [jnp.zeros(0)]
    for b, (block, layout) in enumerate(zip(top.blocks, top.layout, strict=True)):
        if block.kind.rows:
            found = _block(top, b, eq, q[layout.variables], v[layout.variables])
            values.append(found[0].reshape(-1))
            slopes.append(found[1].reshape(-1))
            bent.append(found[2].reshape(-1))
    padded = jnp.concatenate([*slopes, jnp.zeros(1)])
    both = sum((padded[g] for g in view.gathers[1:]), padded[view.gathers[0]])
    n, at = len(view.unknown), _order(view)
    return jnp.concatenate(values)[at], both[:, :n], both[:, n:], jnp.concatenate(bent)[at]


def _block(top: Topology, b: int, eq: Equations, x: Array, dx: Array) -> tuple[Array, Array, Array]:
    """Rows of a block ``(rows, instances)``, slopes ``(instances, rows, variables)``, second rates as the rows."""
    block, g, h = top.blocks[b], eq.linear[b], eq.quadratic[b]
    count, width = len(block.kind.rows), x.shape[1]
    run, places = _read(block.kind, top.dim)
    found = run([*x.T, *eq.constants[b].T, *dx.T])
    found = jnp.stack([jnp.broadcast_to(f, (block.count,)) for f in found])
    scale = eq.scales[b].T
    values = found[:count] * scale
    if not places and g is not None and h is not None:
        curved = jnp.sum(h * (dx[:, :, None] * dx[:, None, :])[:, None], axis=(2, 3))
        return values, g + jnp.sum(h * x[:, None, None, :], axis=-1), curved.T
    own = np.full((count, width), len(places))  # a zero stands behind the slopes
    own[tuple(np.array(places, int).reshape(-1, 2).T)] = np.arange(len(places))
    local = found[count : count + len(places)] * scale[np.array([r for r, _ in places], int)]
    local = jnp.concatenate([local, jnp.zeros((1, block.count), local.dtype)])
    return values, jnp.moveaxis(local[own], 2, 0), found[count + len(places) :] * scale


class Weights(NamedTuple):
    """What is added up of a plan's rows."""

    values: Array  # of their values (m,)
    speeds: Array  # of their rates (m,)
    bent: Array  # of their second rates without accelerations (m,)
    rows: Array  # of their derivatives along `way` (m,)
    way: Array  # a way of all coordinates (N,)
    columns: Array  # of their derivatives by all coordinates (N,), the rows weighed by `by`
    by: Array  # those weights (m,)


def weighed(view: Plan, eq: Equations, q: Coordinates, v: Coordinates, weights: Weights) -> Array:
    """A sum of a plan's rows and their derivatives: one number, to be differentiated; no matrix is put together."""
    top, total = view.topology, jnp.zeros(())
    used = [b for b, block in enumerate(top.blocks) if block.kind.rows]
    if not used:
        return total
    full = [jnp.zeros(len(top.rows)).at[view.rows].set(x) for x in weights[:4] + weights[6:]]
    shapes = [top.layout[b].variables.shape for b in used]
    # One gather for all: in reverse it is a loop over what it took.
    local = jnp.stack([q, v], axis=1)[np.concatenate([top.layout[b].variables.reshape(-1) for b in used])]
    ends = np.cumsum([0, *(n * k for n, k in shapes)])
    for b, start, end, shape in zip(used, ends[:-1], ends[1:], shapes, strict=True):
        x, dx = local[start:end, 0].reshape(shape), local[start:end, 1].reshape(shape)
        layout = top.layout[b]
        values, slopes, bent = _block(top, b, eq, x, dx)
        of_values, of_speeds, of_bent, of_rows, by = (w[layout.rows] for w in full)
        way, columns = weights.way[layout.variables], weights.columns[layout.variables]
        of_slopes = of_speeds[:, :, None] * dx[:, None] + of_rows[:, :, None] * way[:, None]
        of_slopes = of_slopes + by[:, :, None] * columns[:, None]
        total = total + jnp.sum(of_values.T * values + of_bent.T * bent) + jnp.sum(of_slopes * slopes)
    return total
