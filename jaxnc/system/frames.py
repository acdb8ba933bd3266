"""Frames of bodies and what rides on them: orientation and markers as functions of the coordinates.

In the plane a body's frame is spanned by one segment and its quarter turn; in space by two segments, made orthonormal
one after the other, and the direction across both. A bar in space has one segment and no frame.
"""

import functools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import in_one_program, jit
from jaxnc.constraints.elementary import Small, ratio, stacked
from jaxnc.constraints.kind import cross3, dot, norm, unit
from jaxnc.reading import Program, trace
from jaxnc.records import with_owner
from jaxnc.system.on_lanes import attach_along, on_host, on_lanes
from jaxnc.system.precision import WIDE, numbers
from jaxnc.system.structure import along_curve
from jaxnc.system.topology import MarkerIndex, Segment, Topology
from jaxnc.types import AnyArray, Array, Float, Numbers

if TYPE_CHECKING:
    from jaxnc.system.equations import Equations
    from jaxnc.system.system import System


def spread(top: Topology, q: Array) -> tuple[Array, Array]:
    """Points ``(..., points, dim)`` and vectors ``(..., vectors, dim)`` of poses ``(..., N)``."""
    points, vectors, lead = len(top.points), len(top.vectors), q.shape[:-1]  # which may be that of no poses
    a, b = points * top.dim, (points + vectors) * top.dim
    return q[..., :a].reshape(*lead, points, top.dim), q[..., a:b].reshape(*lead, vectors, top.dim)


def span(segment: Segment, points: AnyArray, vectors: AnyArray) -> AnyArray:
    """The direction of a segment, of points and vectors."""
    if len(segment) == 1:
        return vectors[~segment[0]]
    return points[segment[1]] - points[segment[0]]


def body_axes(segments: tuple[Segment, ...], points: Array, vectors: Array) -> Array:
    """Orthonormal axes of a body as rows: ``(dim, dim)``, or ``(1, dim)`` for a bar in space."""
    return orthonormal_axes([span(s, points, vectors) for s in segments])


def orthonormal_axes(spans: Sequence[Array] | Array) -> Array:
    """Axes as rows from the spans of a frame: two in the plane, three in space, one for a bar."""
    first = unit(spans[0])
    if first.shape[-1] == 2:
        return stacked([first, stacked([-first[1], first[0]])])
    if len(spans) == 1:
        return stacked([first])
    second = unit(spans[1] - dot(spans[1], first) * first)
    return stacked([first, second, stacked(cross3(first, second))])


def frame(top: Topology, segments: tuple[Segment, ...], q: Array) -> Array:
    """Axes of a body in one pose, as rows; see `body_axes`."""
    return body_axes(segments, *spread(top, q))


def carried(spans: Sequence[Array], w: Array, drawn: Array, direction: bool) -> Array:
    """Components ``(dim,)`` of a marker's arm (or direction) w in the frame that a body's segments span."""
    axes = orthonormal_axes(spans)
    w = unit(w) if direction else w
    if w.shape[0] == 2:
        w = w * ratio(1.0, norm(drawn))
    return stacked([dot(axes[k], w) if k < axes.shape[0] else 0.0 for k in range(w.shape[0])])


def _in_plane(marker: MarkerIndex, coefficients: Array, points: Any, vectors: Any) -> Array:
    """Place (direction) of a marker from points ``(points, 2)``, which may be `Small` and have lanes of numbers."""
    d, origin = span(marker.segments[0], points, vectors), points[marker.origin]
    (a, b), x, y = coefficients, d[0], d[1]
    return jnp.stack([origin[0] + a * x - b * y, origin[1] + a * y + b * x], axis=-1)


def _marker_position(top: Topology, marker: MarkerIndex, coefficients: Array, q: Array) -> Array:
    points, vectors = spread(top, q)
    if top.dim == 2:
        return _in_plane(marker, coefficients, points, vectors)
    axes = body_axes(marker.segments, points, vectors)
    place = coefficients[: axes.shape[0]] @ axes
    return place if marker.direction else points[marker.origin] + place


def marker_along(
    eq: "Equations", number: int, q: Array | np.ndarray, rates: tuple[Array, ...]
) -> Float[Array, "... dim"]:
    """The k-th time derivative of one marker's position (direction); NumPy's of poses that the host has found.

    From the poses and their first k time derivatives, each ``(..., N)``.
    """
    return _along_poses(marker_place, (eq.topology, number), q, rates, eq.markers)


def marker_place(top: Topology, number: int, q: Array, coefficients: Array) -> Float[Array, " dim"]:
    """Position (direction) of one marker in one pose, from the coefficients of all."""
    return _marker_position(top, top.markers[number], coefficients[number], q)


@with_owner
def marker_program(top: Topology, number: int) -> Program:
    """Write `marker_place` as a program of all coordinates and the marker's own coefficients."""

    def place(q: Array, coefficients: Array) -> tuple[Array]:
        return (_marker_position(top, top.markers[number], coefficients, q),)

    with numbers(WIDE):
        return trace(place, (len(top.coordinates),), (top.dim,))


def marker_in_lanes(eq: "Equations", number: int, q: Sequence[Array]) -> Float[Array, "... dim"]:
    """Positions (directions) of one marker, from all coordinates, each with the same leading axes."""
    top, shape, marker, coefficients = eq.topology, q[0].shape, eq.topology.markers[number], eq.markers[number]
    if top.dim == 2:
        a, b = 2 * len(top.points), 2 * (len(top.points) + len(top.vectors))
        points, vectors = (Small(Small(of[k : k + 2]) for k in range(0, len(of), 2)) for of in (q[:a], q[a:b]))
        return _in_plane(marker, coefficients, points, vectors)
    place = functools.partial(_marker_position, top, marker, coefficients)
    flat = jnp.stack([x.reshape(-1) for x in q])
    return jax.vmap(place, in_axes=-1, out_axes=-1)(flat).T.reshape(*shape, top.dim)


def along(f, q: Array, rates: tuple[Array, ...]) -> Array:
    """The k-th time derivative of a function of one pose, along poses with their first k time derivatives."""
    return over(lambda x, *terms: along_curve(f, x, terms), q, *rates)


def _along_poses(f, fixed: tuple, q: Array | np.ndarray, rates: tuple[Array, ...], *constants: Array) -> Any:
    """The k-th time derivative of ``f(*fixed, pose, *constants)``: of NumPy lanes where the poses are such."""
    if on_host(q, rates, constants):
        return on_lanes(f, fixed, np.asarray(q), rates, constants)
    known = attach_along(f, fixed, q, rates, constants)
    if known is not None:
        return known
    return _along_compiled(f, fixed, jnp.asarray(q), rates, constants)


@functools.partial(jit, static_argnums=(0, 1))
def _along_compiled(f, fixed: tuple, q: Array, rates: tuple[Array, ...], constants: tuple[Array, ...]) -> Array:
    return along(lambda x: f(*fixed, x, *constants), q, rates)


def over(f, *arrays: Array) -> Array:
    """A function of single poses over any leading axes."""
    lead = arrays[0].shape[:-1]
    flat = [a.reshape(int(np.prod(lead, dtype=int)), a.shape[-1]) for a in arrays]
    out = jax.vmap(f)(*flat)
    return out.reshape(*lead, *out.shape[1:])


def turns(top: Topology, segments: tuple[Segment, ...], home: Array, q: Array) -> Array:
    """Rotation matrix of a body from its drawing to poses ``(..., N)``: ``(..., dim, dim)``."""
    return _along_poses(_rotation_from_drawing, (top, segments), q, (), home)


def _rotation_from_drawing(top: Topology, segments: tuple[Segment, ...], q: Array, home: Array) -> Array:
    return frame(top, segments, q).T @ frame(top, segments, home)


def spins(top: Topology, segments: tuple[Segment, ...], q: Array, rates: tuple[Array, ...]) -> Array:
    """Angular velocity (one rate) or acceleration (two): ``(...,)`` in the plane, ``(..., 3)`` in space."""
    # With the axes e_i as rows, ω = ½ Σ e_i × ė_i and so ω̇ = ½ Σ e_i × ë_i.
    axes, last = (_along_poses(frame, (top, segments), q, terms) for terms in ((), rates[:2]))
    return _spin_of_axes(axes, last)


@in_one_program
def _spin_of_axes(axes: Numbers, change: Numbers) -> Any:
    if axes.shape[-1] == 2:
        return 0.5 * (axes[..., 0] * change[..., 1] - axes[..., 1] * change[..., 0]).sum(axis=-1)
    numeric: Any = np if isinstance(axes, np.ndarray) else jnp
    return 0.5 * numeric.cross(axes, change).sum(axis=-2)


@in_one_program
def quaternions(rotation: Array | np.ndarray) -> Array:
    """Euler parameters ``(..., 4)``, scalar first, of rotation matrices ``(..., 3, 3)``; continuous along a sweep.

    Of the four ways to divide by one of the parameters that with the largest is taken, so none is badly conditioned.
    """
    r, numeric = rotation, cast(Any, np if isinstance(rotation, np.ndarray) else jnp)
    xx, yy, zz = r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]
    a, b, c = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    d, e, f = r[..., 1, 0] + r[..., 0, 1], r[..., 0, 2] + r[..., 2, 0], r[..., 2, 1] + r[..., 1, 2]
    # Rows of 4 p pᵀ; the one with the largest diagonal, normalised, is ± p.
    table = numeric.stack(
        [
            numeric.stack([1 + xx + yy + zz, a, b, c], axis=-1),
            numeric.stack([a, 1 + xx - yy - zz, d, e], axis=-1),
            numeric.stack([b, d, 1 - xx + yy - zz, f], axis=-1),
            numeric.stack([c, e, f, 1 - xx - yy + zz], axis=-1),
        ],
        axis=-2,
    )
    largest = numeric.argmax(numeric.diagonal(table, axis1=-2, axis2=-1), axis=-1)
    row = numeric.take_along_axis(table, largest[..., None, None], axis=-2)[..., 0, :]
    p = row / numeric.sqrt(numeric.sum(row * row, axis=-1, keepdims=True))
    p = numeric.where(p[..., :1] < 0, -p, p)
    if p.ndim == 1:
        return p
    turned = numeric.sum(p[..., 1:, :] * p[..., :-1, :], axis=-1) < 0
    signs = numeric.cumprod(numeric.where(turned, -1.0, 1.0), axis=-1)
    return p * numeric.concatenate([numeric.ones_like(p[..., :1, 0]), signs], axis=-1)[..., None]


@in_one_program
def angle_along(way: Numbers) -> Array:
    """Angle of vectors of the plane ``(..., 2)`` from the x axis, unwrapped along a sweep."""
    numeric = cast(Any, np if isinstance(way, np.ndarray) else jnp)
    angle = numeric.arctan2(way[..., 1], way[..., 0])
    return numeric.unwrap(angle, axis=-1) if angle.ndim else angle


class GivenCentre(NamedTuple):
    """A centre of mass that is given as a place: its parameters, and where it is in the axes of a segment."""

    body: str
    at: tuple[int, ...]
    foot: int
    segment: tuple[int, int]
    local: np.ndarray


def mass_centres(system: "System") -> Iterator[GivenCentre]:
    """List centres of mass of planar bodies that are given as places of the drawing."""
    if system.topology.dim > 2:
        return
    par = system.parameters
    points, physical = np.asarray(par.points, float), np.asarray(par.physical, float)
    for index in (i for group in system.topology.loads.inertias for i in group if i.com):
        (start, end), foot = index.home[2][0], index.home[0]
        x, y = (points[end] - points[start]) / np.linalg.norm(points[end] - points[start])
        local = np.array([[x, y], [-y, x]]) @ (physical[list(index.com)] - points[foot])
        yield GivenCentre(index.body, tuple(index.com), foot, (start, end), local)
