"""Rows of a motion, their derivatives and what they accelerate by: read from the kinds as one straight-line program.

What a simulation evaluates in every stage is compiled with it, and differentiated for its gradient, so that it is kept
short: values, slopes and second rates of a kind share what they have in common, or follow from coefficients.
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
from jaxnc.system.structure import arrays, pattern, program, quadratic, size
from jaxnc.types import Array, Coordinates

Read = tuple[Callable[[list[Any]], Any], tuple[tuple[int, int], ...]]


@functools.cache
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


@functools.cache
def _order(view: Plan) -> np.ndarray:
    """Where the plan's rows are among those of all blocks, row by row of each."""
    rows = [np.zeros(0, int), *(layout.rows.T.reshape(-1) for layout in view.topology.layout)]
    back = np.empty(len(view.topology.rows), int)
    back[np.concatenate(rows)] = np.arange(len(back))
    return back[view.rows]


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
    values, slopes, bent = [jnp.zeros(0)], [], [jnp.zeros(0)]
    for b, (block, layout) in enumerate(zip(top.blocks, top.layout, strict=True)):
        count, width = len(block.kind.rows), layout.variables.shape[1]
        if not count:
            continue
        run, places = _read(block.kind, top.dim)
        x, dx, g, h = q[layout.variables], v[layout.variables], eq.linear[b], eq.quadratic[b]
        found = run([*x.T, *eq.constants[b].T, *dx.T])
        found = jnp.stack([jnp.broadcast_to(f, (block.count,)) for f in found])
        scale = eq.scales[b].T
        values.append((found[:count] * scale).reshape(-1))
        if not places and g is not None and h is not None:
            slopes.append((g + jnp.sum(h * x[:, None, None, :], axis=-1)).reshape(-1))
            curved = jnp.sum(h * (dx[:, :, None] * dx[:, None, :])[:, None], axis=(2, 3))
            bent.append(curved.T.reshape(-1))
            continue
        own = np.full((count, width), len(places))  # a zero stands behind the slopes
        own[tuple(np.array(places, int).reshape(-1, 2).T)] = np.arange(len(places))
        local = found[count : count + len(places)] * scale[np.array([r for r, _ in places], int)]
        local = jnp.concatenate([local, jnp.zeros((1, block.count), local.dtype)])
        slopes.append(jnp.moveaxis(local[own], 2, 0).reshape(-1))
        bent.append((found[count + len(places) :] * scale).reshape(-1))
    padded = jnp.concatenate([*slopes, jnp.zeros(1)])
    both = sum((padded[g] for g in view.gathers[1:]), padded[view.gathers[0]])
    n, at = len(view.unknown), _order(view)
    return jnp.concatenate(values)[at], both[:, :n], both[:, n:], jnp.concatenate(bent)[at]
