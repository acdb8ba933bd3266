"""Rows of a plan written out for many lanes at once: one array for every coordinate, row and derivative.

A lane is one pose of one design. Lanes are the last axis of everything, so that what is done to all of them is plain
arithmetic on long vectors. Nothing is gathered or scattered: which numbers meet is known from the topology.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.constraints import Kind
from jaxnc.constraints.small import Small
from jaxnc.system.equations import Equations
from jaxnc.system.structure import Pairs, curvature, pattern, quadratic, round_in
from jaxnc.system.topology import Topology
from jaxnc.types import Array

Lanes = Sequence[Any]
"""All coordinates of a mechanism, each a number or an array of lanes."""


@dataclass(frozen=True, eq=False)
class _Instance:
    """One instance of a kind."""

    block: int  # its block in the topology
    number: int  # its number there
    variables: tuple[int, ...]  # the coordinates it takes
    rows: tuple[int, ...]  # for each of its rows its place among the rows wanted, -1 where it is not
    moving: tuple[int, ...]  # places of those of its variables that are solved for
    pattern: np.ndarray  # structural non-zeros, (rows, variables)
    # Pairs of variables with constant second derivatives, per row; None for a kind that is not quadratic.
    curved: tuple[Pairs | None, ...] | None


class Rows:
    """Some rows of a topology as functions of all coordinates, and their derivatives with respect to some of these."""

    def __init__(self, top: Topology, rows: Sequence[int], columns: Sequence[int] = ()):
        """Args: topology; indices of the rows; indices of the coordinates that are solved for."""
        self.top, self.columns = top, tuple(int(c) for c in columns)
        self.count = len(rows)
        self._column = {c: k for k, c in enumerate(self.columns)}
        place = {int(r): k for k, r in enumerate(rows)}
        self.instances: list[_Instance] = []
        for b, (block, layout) in enumerate(zip(top.blocks, top.layout, strict=True)):
            for i in range(block.count):
                at = tuple(place.get(int(r), -1) for r in layout.rows[i])
                if all(r < 0 for r in at):
                    continue
                variables = tuple(int(v) for v in layout.variables[i])
                moving = tuple(k for k, v in enumerate(variables) if v in self._column)
                bent = quadratic(block.kind, top.dim)
                curved = curvature(block.kind, top.dim, tuple(range(len(variables)))) if bent else None
                self.instances.append(_Instance(b, i, variables, at, moving, pattern(block.kind, top.dim), curved))

    def values(self, eq: Equations, x: Lanes) -> list[Any]:
        """The rows, scaled to lengths."""
        out: list[Any] = [None] * self.count
        for one in self.instances:
            for r, value in zip(one.rows, self._rows(one, eq, [x[v] for v in one.variables]), strict=True):
                if r >= 0:
                    out[r] = value
        return out

    def slopes(self, eq: Equations, x: Lanes) -> dict[tuple[int, int], Any]:
        """Their derivatives, by row and by place of the column; structural non-zeros only."""
        out: dict[tuple[int, int], Any] = {}
        for one in self.instances:
            local = [x[v] for v in one.variables]
            for v in one.moving:
                wanted = [k for k, r in enumerate(one.rows) if r >= 0 and one.pattern[k, v]]
                if not wanted:
                    continue
                if one.curved is not None:
                    found = {k: self._slope(one, eq, local, k, v) for k in wanted}
                else:
                    along = functools.partial(self._along, one, eq, local, v)
                    found = jax.jvp(along, (local[v],), (jnp.ones_like(local[v]),))[1]
                for k in wanted:
                    key = (one.rows[k], self._column[one.variables[v]])
                    out[key] = out[key] + found[k] if key in out else found[k]
        return out

    def _slope(self, one: _Instance, eq: Equations, local: list, k: int, v: int) -> Any:
        """From the coefficients that are computed once for a design."""
        g, h = eq.linear[one.block], eq.quadratic[one.block]
        assert g is not None and h is not None and one.curved is not None
        slope = g[one.number, k, v]
        for a, w in one.curved[k] or ():
            if a == v:
                slope = slope + h[one.number, k, v, w] * local[w]
        return slope

    def _along(self, one: _Instance, eq: Equations, local: list, v: int, value: Any) -> tuple[Any, ...]:
        return self._rows(one, eq, [*local[:v], value, *local[v + 1 :]])

    def _rows(self, one: _Instance, eq: Equations, local: Sequence[Any]) -> tuple[Any, ...]:
        kind = self.top.blocks[one.block].kind
        constants, scales = eq.constants[one.block][one.number], eq.scales[one.block][one.number]
        rows = _called(kind, kind.residual, self.top.dim, local, constants)
        return tuple(r * scales[k] for k, r in enumerate(rows))

    def bend(self, eq: Equations, row: int) -> Any:
        """Second derivative of a row if it is the same in all columns and there is no mixed one; None otherwise.

        Zero (a plain number) where the row is affine in the columns.
        """
        found = [(one, k) for one in self.instances for k, r in enumerate(one.rows) if r == row]
        (one, k) = found[0]
        kind, number = self.top.blocks[one.block].kind, len(one.moving)
        if len({one.variables[v] for v in one.moving}) < number:
            return None
        pairs = curvature(kind, self.top.dim, one.moving)[k]
        if pairs is None:
            return None
        if not pairs:
            return 0.0
        h = eq.quadratic[one.block]
        if h is None or number < len(self.columns) or not round_in(kind, self.top.dim, k, one.moving):
            return None
        return h[one.number, k, one.moving[0], one.moving[0]]


def guards(top: Topology, eq: Equations, x: Lanes) -> tuple[list[Any], list[Any]]:
    """Quantities that are positive unless a row, or a body, is met by a mirror image; see `equations.guards`."""
    rows, bodies = [], []
    for b, (block, layout) in enumerate(zip(top.blocks, top.layout, strict=True)):
        if block.kind.guard is None:
            continue
        for i in range(block.count):
            local = [x[v] for v in layout.variables[i]]
            found = _called(block.kind, block.kind.guard, top.dim, local, eq.constants[b][i])
            (bodies if block.kind.mirror else rows).extend(found)
    return rows, bodies


def _called(kind: Kind, f: Callable, dim: int, local: Sequence[Any], constants: Any) -> tuple[Array, ...]:
    """A function of an instance's own points, vectors, scalars and constants, of lanes of them."""
    numbers = [jnp.asarray(v) for v in (*local, *(constants[k] for k in range(len(kind.constants))))]
    return _evaluated(kind, f, dim, *numbers)


@functools.partial(jax.jit, static_argnums=(0, 1, 2), inline=True)
def _evaluated(kind: Kind, f: Callable, dim: int, *numbers: Array) -> tuple[Array, ...]:
    one = _small if _calculates_small(kind, f, dim) else _arrays
    if not any(x.ndim for x in numbers):
        return one(kind, f, dim, *numbers)
    mapped = functools.partial(one, kind, f, dim)
    for axes in range(1, 1 + max(x.ndim for x in numbers)):  # the last one first
        mapped = jax.vmap(mapped, in_axes=tuple(0 if x.ndim >= axes else None for x in numbers))
    return mapped(*numbers)


def _small(kind: Kind, f: Callable, dim: int, *x: Array) -> tuple[Array, ...]:
    points, vectors = kind.points, kind.points + kind.vectors
    spread = [Small(x[k * dim : (k + 1) * dim]) for k in range(vectors)]
    s, c = x[vectors * dim : vectors * dim + kind.scalars], x[vectors * dim + kind.scalars :]
    rows = f(Small(spread[:points]), Small(spread[points:]), Small(s), Small(c))
    return tuple(jnp.asarray(r, x[0].dtype) for r in rows)


def _arrays(kind: Kind, f: Callable, dim: int, *x: Array) -> tuple[Array, ...]:
    a, b = kind.points * dim, (kind.points + kind.vectors) * dim
    y = jnp.stack(x)
    p, v = y[:a].reshape(kind.points, dim), y[a:b].reshape(kind.vectors, dim)
    return tuple(jnp.asarray(r, y.dtype) for r in f(p, v, y[b : b + kind.scalars], y[b + kind.scalars :]))


@functools.lru_cache(maxsize=1024)
def _calculates_small(kind: Kind, f: Callable, dim: int) -> bool:
    """Whether a function of a kind gets by with `Small`: it may want arrays, for a function of jax.numpy."""
    count = (kind.points + kind.vectors) * dim + kind.scalars + len(kind.constants)
    number = jax.ShapeDtypeStruct((), jnp.result_type(float))
    try:
        rows = jax.eval_shape(functools.partial(_small, kind, f, dim), *[number] * count)
    except (TypeError, AttributeError, ValueError, IndexError):
        return False
    return all(r.shape == () for r in rows)


def some(lanes: Array) -> Array:
    """Whether any of the lanes is true: as a product of vectors, which is a call and no kernel, and soon compiled."""
    flat = lanes.reshape(-1).astype(np.float32)
    return jnp.dot(flat, np.ones(len(flat), np.float32)) > 0.0
