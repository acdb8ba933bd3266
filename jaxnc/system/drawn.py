"""What follows from a drawing, in NumPy: constants, coordinates, markers, with or without their changes.

Of one design, or of many at once: whatever axes the parameters have behind their own, everything else has too.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numpy as np

from jaxnc.constraints.directions import unit
from jaxnc.constraints.kind import norm
from jaxnc.constraints.small import Small
from jaxnc.reading import Program, write
from jaxnc.system.frames import carried
from jaxnc.system.host_kinds import Carrying, carrying_kind
from jaxnc.system.on_lanes import carrying
from jaxnc.system.shape import redraw
from jaxnc.system.topology import Topology


class Drawn(NamedTuple):
    """What follows from a drawing; every number carries its changes along the last axis (see `carrying`).

    Of many designs there are axes of theirs before the last.
    """

    drawing: np.ndarray  # points, those of redrawn bodies behind them, (points, dim, 1 + changes)
    vectors: np.ndarray  # unit vectors, (vectors, dim, 1 + changes)
    home: np.ndarray  # all coordinates, (N, 1 + changes)
    constants: tuple[np.ndarray, ...]  # per block, (instances, constants, 1 + changes)
    markers: np.ndarray  # their coefficients, (markers, dim, 1 + changes)


def drawn(top: Topology, points: np.ndarray, vectors: np.ndarray, markers: np.ndarray, dimensions: np.ndarray) -> Drawn:
    """Derive constants and coordinates from the parameters of a design, which carry changes or none.

    All are as drawn: ``(points, dim, 1 + changes)``, and so on.
    """
    tail = points.shape[2:]
    drawing = _redrawn(top, points, dimensions)
    if len(vectors):
        vectors = np.stack(vector(unit, top.dim)(list(np.moveaxis(vectors, 1, 0))), axis=1)
    spread = np.concatenate([points.reshape(-1, *tail), vectors.reshape(-1, *tail)])
    constants: list[np.ndarray] = [np.zeros((0, 0, *tail))] * len(top.blocks)
    measuring = sorted({block for block, _ in top.measures})
    scalars = np.zeros((len(top.scalars), *tail), points.dtype)
    home = np.concatenate([spread, scalars])
    for b in measuring:
        constants[b] = _constants(top, b, drawing, vectors, None, dimensions)
        at = [(k, i) for k, (block, i) in enumerate(top.measures) if block == b]
        which, instances = [k for k, _ in at], [i for _, i in at]
        measure = carrying_kind(top.blocks[b].kind, "measure", top.dim)
        x = home[top.layout[b].variables[instances].T]
        scalars[which] = measure([*x, *np.moveaxis(constants[b][instances], 1, 0)])[0]
    home = np.concatenate([spread, scalars])
    for b in range(len(top.blocks)):
        if b not in measuring:
            constants[b] = _constants(top, b, drawing, vectors, home, dimensions)
    return Drawn(drawing, vectors, home, tuple(constants), _markers(top, points, vectors, markers, drawing))


@functools.lru_cache(maxsize=1024)
def vector(f: Callable, dim: int) -> Carrying:
    """A function of a small vector."""
    return carrying(write(lambda *x: f(Small(x)), dim))


@functools.lru_cache(maxsize=1024)
def recipe_program(recipe: tuple, count: int, dim: int, values: int) -> Program:
    """A body's points as its recipe places them, from those drawn ``(count, dim)`` and its explicit dimensions."""

    def called(*x: Any) -> Any:
        home: Any = Small(Small(x[k * dim : (k + 1) * dim]) for k in range(count))
        return redraw(recipe, home, cast(Any, Small(x[count * dim :])))

    return write(called, count * dim + values)


@functools.lru_cache(maxsize=1024)
def _recipe(recipe: tuple, count: int, dim: int, values: int) -> Carrying:
    return carrying(recipe_program(recipe, count, dim, values))


def _redrawn(top: Topology, points: np.ndarray, dimensions: np.ndarray) -> np.ndarray:
    """The drawing followed by the redrawn points of every body with explicit dimensions."""
    parts = [points]
    for shape in top.shapes:
        members = np.array(shape.members)
        wanted = np.array(shape.dimensions, dtype=int).reshape(len(members), -1)
        run = _recipe(shape.recipe, members.shape[1], top.dim, wanted.shape[1])
        home = points[members].reshape(len(members), -1, *points.shape[2:])
        out = run([*np.moveaxis(home, 1, 0), *np.moveaxis(dimensions[wanted], 1, 0)])
        parts.append(np.stack(out, axis=1).reshape(-1, top.dim, *points.shape[2:]).astype(points.dtype))
    return np.concatenate(parts)


def _constants(
    top: Topology, b: int, drawing: np.ndarray, vectors: np.ndarray, home: np.ndarray | None, dimensions: np.ndarray
) -> np.ndarray:
    """Constants of a block's instances ``(instances, constants, 1 + changes)``, read off the drawing or given."""
    block, layout = top.blocks[b], top.layout[b]
    kind, count, tail = block.kind, block.count, drawing.shape[2:]
    explicit = np.zeros((count, len(kind.constants), *tail), drawing.dtype)
    if not kind.constants:
        return explicit
    fixed = np.zeros((*explicit.shape[:2], *[1] * len(tail)), bool)
    for i, k, p, q in block.lengths:
        explicit[i, k] = vector(norm, top.dim)(list(drawing[q] - drawing[p]))[0]
        fixed[i, k] = True
    for i, k, d in block.given:
        explicit[i, k] = dimensions[d]
        fixed[i, k] = True
    scalars = np.zeros((count, kind.scalars, *tail), drawing.dtype) if home is None else home[layout.scalars]
    parts = (drawing[layout.drawn], vectors[layout.vectors], scalars, explicit)
    x = [column for part in parts for column in np.moveaxis(part.reshape(count, -1, *tail), 1, 0)]
    read = np.stack([np.broadcast_to(y, (count, *tail)) for y in carrying_kind(kind, "drawn", top.dim)(x)], axis=1)
    return np.where(fixed, explicit, read).astype(drawing.dtype)


@functools.lru_cache(maxsize=1024)
def carrier_program(dim: int, segments: int, direction: bool) -> Program:
    """A marker's coefficients from its body's segments, its arm, and the first segment where lengths are read."""

    def called(*x: Any) -> Any:
        parts = [cast(Any, Small(x[k * dim : (k + 1) * dim])) for k in range(segments + 2)]
        return carried(parts[:segments], *parts[segments:], direction=direction)

    return write(called, (segments + 2) * dim)


@functools.lru_cache(maxsize=1024)
def _carrier(dim: int, segments: int, direction: bool) -> Carrying:
    return carrying(carrier_program(dim, segments, direction))


def _markers(
    top: Topology, points: np.ndarray, vectors: np.ndarray, markers: np.ndarray, drawing: np.ndarray
) -> np.ndarray:
    out = np.zeros((len(top.markers), top.dim, *points.shape[2:]), points.dtype)

    def span(segment: tuple[int, ...], at: np.ndarray) -> np.ndarray:
        return vectors[~segment[0]] if len(segment) == 1 else at[segment[1]] - at[segment[0]]

    for k, marker in enumerate(top.markers):
        spans = [span(s, points) for s in marker.segments]
        w = markers[k] if marker.direction else markers[k] - points[marker.origin]
        run = _carrier(top.dim, len(spans), marker.direction)
        out[k] = run([*np.concatenate(spans), *w, *span(marker.drawn[0], drawing)])
    return out
