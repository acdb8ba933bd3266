"""Mass matrices by virtual power: constant for every body, assembled on all coordinates, ground included.

A place that rides on a body is affine in the body's natural coordinates, ``r = r_o + Σ c_k e_k`` with its segments e_k
(in the plane one segment and its quarter turn). Its velocity is the same combination of the rates, so that the virtual
power ``∫ ṙ* · r̈ dm`` is a constant matrix: in space ``J ⊗ I`` with the body's zeroth, first and second moments in the
(oblique) base of its segments. Source: J. Unda, J. García de Jalón, Rev. Int. Mét. Num. Cálc. Dis. Ing. 1 (4), 1985,
inertia by the theorem of virtual power.
"""

import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import jit, on_device
from jaxnc.constraints.directions import unit
from jaxnc.dynamics.extended import extended, is_concrete
from jaxnc.remembered import by_identity
from jaxnc.system.design import design, design_numbers
from jaxnc.system.frames import orthonormal_axes
from jaxnc.system.loads import InertiaIndex
from jaxnc.system.on_lanes import reading
from jaxnc.system.structure import Formula
from jaxnc.system.system import Parameters, System
from jaxnc.system.topology import Topology
from jaxnc.types import Array, Float, Numbers


@public
def mass_matrix(system: System) -> tuple[Float[Array, "N N"], Float[Array, "dim N"], Array]:
    """The mass matrix of a system.

    Args:
        system: the system; masses and inertias are physical parameters, shapes follow the drawing.

    Returns:
        The mass matrix on all coordinates ``(N, N)``, kg (kg m² where coordinates are pure numbers); the first moments
        ``(dim, N)``, so that ``moments @ q`` is total mass times centre of mass; the total mass. Where spatial bodies
        have hidden vectors these are coordinates, too: see `jaxnc.dynamics.extended`.
    """
    system = extended(system)
    if is_concrete(system):
        return on_device(sum_inertias(system.topology, inertias(system)))
    return _mass_matrix(system)


@jit
def _mass_matrix(system: System) -> tuple[Array, Array, Array]:
    return sum_inertias(system.topology, inertias(system))


def sum_inertias(top: Topology, found: Sequence[tuple[np.ndarray, Numbers, Numbers, Numbers]]) -> tuple[Any, Any, Any]:
    """Sum the `inertias` of all bodies to the matrices of `mass_matrix`; axes behind their own, of changes, stay."""
    size, dim = len(top.coordinates), top.dim
    host = not found or isinstance(found[0][1], np.ndarray)
    xp: Any = np if host else jnp
    dtype = found[0][1].dtype if found else jax.dtypes.canonicalize_dtype(float)
    tail = found[0][1].shape[3:] if found else ()

    def add(to: Any, at: Any, values: Any) -> Any:
        if not host:
            return to.at[at].add(values)
        np.add.at(to, at, values)
        return to

    mass, moments = xp.zeros((size, size, *tail), dtype), xp.zeros((dim, size, *tail), dtype)
    total = xp.zeros(tail, dtype)
    for at, local, first, m in found:
        mass = add(mass, (at[:, :, None], at[:, None]), local)
        moments = add(moments, (np.arange(dim)[:, None], at[:, None]), first)
        total = total + xp.sum(m, axis=0)
    return mass, moments, xp.asarray(total, dtype)


def inertias(system: System) -> list[tuple[np.ndarray, Numbers, Numbers, Numbers]]:
    """Return per group of bodies of one form coordinates ``(bodies, k)``, mass matrices, first moments and masses."""
    if is_concrete(system):
        return _inertias_on_host(system)
    return _inertias(system.topology, system.parameters)


@by_identity
def _inertias_on_host(system: System) -> list[tuple[np.ndarray, Numbers, Numbers, Numbers]]:
    with np.errstate(all="ignore"):
        return _inertias(system.topology, system.parameters.in_numpy())


def _inertias(top: Topology, par: Parameters) -> list[tuple[np.ndarray, Numbers, Numbers, Numbers]]:
    x, found = design_numbers(top, par, 1), design(top)
    return group_inertias(top, par.points, x[found.drawing], x[found.vectors], par.physical)


def group_inertias(
    top: Topology, points: Numbers, drawing: Numbers, vectors: Numbers, physical: Numbers
) -> list[tuple[np.ndarray, Numbers, Numbers, Numbers]]:
    """Find `inertias` from the numbers of a design: in NumPy, if they are NumPy's, a body in each lane.

    NumPy's numbers may carry changes along a last axis; then masses and moments do too.
    """
    out = []
    for group in top.loads.inertias:
        numbers = _gather_numbers(top.dim, group, points, drawing, vectors, physical)
        host = all(isinstance(x, np.ndarray) for x in numbers.values())
        evaluate = _evaluate_lanes if host else _trace_inertias
        out.append((inertia_coordinates(top, group), *evaluate(top.dim, group[0], numbers), numbers["mass"]))
    return out


def body_inertia(system: System, body: str) -> tuple[np.ndarray, Array, Array, Array]:
    """Return a body's coordinates ``(k,)``, its mass matrix ``(k, k)``, first moments ``(dim, k)`` and mass."""
    for group, (at, local, first, m) in zip(system.topology.loads.inertias, inertias(system), strict=True):
        for i, index in enumerate(group):
            if index.body == body:
                return at[i], local[i], first[i], m[i]
    k = np.zeros(0, dtype=int)
    return k, jnp.zeros((0, 0)), jnp.zeros((system.topology.dim, 0)), jnp.zeros(())


def inertia_nodes(index: InertiaIndex) -> list[int]:
    """List points p and vectors ~k that carry a body's inertia: its origin, then the ends of its segments."""
    return [index.origin, *(i for s in index.segments for i in s)]


def _trace_inertias(dim: int, one: InertiaIndex, numbers: dict) -> tuple[Array, Array]:
    """Return mass matrices and first moments of bodies of the form of `one`, in one mapped call."""
    made = _combinations(one)
    return jax.vmap(lambda x: _body_inertia(dim, one.shape, made, x))(numbers)


def _evaluate_lanes(dim: int, one: InertiaIndex, numbers: dict) -> tuple[np.ndarray, np.ndarray]:
    """Return mass matrices and first moments of bodies of the form of `one`, a body in each of NumPy's lanes."""
    count, *tail = numbers["mass"].shape
    lead, made = (count,), tuple(map(tuple, _combinations(one)))
    shapes = tuple(x.shape[1 : x.ndim - len(tail)] for x in numbers.values())
    body, (height, width) = _body_formula(dim, one.shape, made, tuple(numbers), shapes)
    lanes = [column for x in numbers.values() for column in np.moveaxis(x.reshape(*lead, -1, *tail), 1, 0)]
    values = (body.carrying if tail else body.on_lanes)(lanes)
    out = np.stack([np.broadcast_to(y, (*lead, *tail)) for y in values], axis=1).astype(numbers["mass"].dtype)
    out, split = out.reshape(*lead, height, width, *tail), height - dim
    return out[:, :split], out[:, split:]


@functools.lru_cache(maxsize=256)
def _body_formula(
    dim: int, shape: str, made: tuple, names: tuple[str, ...], shapes: tuple
) -> tuple[Formula, tuple[int, int]]:
    return reading(_flat, (dim, shape, made, names), shapes)


def _flat(dim: int, shape: str, made: tuple, names: tuple[str, ...], *values: Array) -> Array:
    """Stack mass matrix and first moments of one body, one below the other."""
    return jnp.concatenate(_body_inertia(dim, shape, np.array(made), dict(zip(names, values, strict=True))))


def inertia_coordinates(top: Topology, group: tuple[InertiaIndex, ...]) -> np.ndarray:
    """Return the coordinates of all nodes of a group, ``(bodies, k)``."""
    where = np.array([inertia_nodes(index) for index in group])
    where = np.where(where < 0, len(top.points) + ~where, where)
    return (where[:, :, None] * top.dim + np.arange(top.dim)).reshape(len(group), -1)


def _gather_numbers(
    dim: int, group: tuple[InertiaIndex, ...], points: Numbers, drawing: Numbers, vectors: Numbers, physical: Numbers
) -> dict:
    """Gather the numbers of the inertia of each body of a group, ``(bodies, ...)``: NumPy's of NumPy arrays."""
    xp: Any = np if isinstance(points, np.ndarray) else jnp

    def spans(places: Numbers, which: list[tuple]) -> Numbers:
        """Segments of all bodies, ``(bodies, segments, dim)``."""
        columns = []
        for k in range(len(which[0])):
            segment = [w[k] for w in which]
            if len(segment[0]) == 1:
                columns.append(vectors[np.array([~s[0] for s in segment])])
            else:
                columns.append(places[np.array([s[1] for s in segment])] - places[np.array([s[0] for s in segment])])
        return xp.stack(columns, axis=1) if columns else xp.zeros((len(group), 0, dim))

    return {
        "home": points[np.array([i.home[0] for i in group])],
        "home_frame": spans(points, [i.home[2] for i in group]),
        "drawn": drawing[np.array([i.drawn[0] for i in group])],
        "spans": spans(drawing, [i.drawn[1] for i in group]),
        "frame": spans(drawing, [i.drawn[2] for i in group]),
        "corners": drawing[np.array([i.corners for i in group])],
        "mass": physical[np.array([i.mass for i in group])],
        **{k: physical[np.array([getattr(i, k) for i in group], dtype=int)] for k in ("com", "inertia", "size")},
    }


def _combinations(one: InertiaIndex) -> np.ndarray:
    """Return a body's generators (origin, segments) as combinations of its nodes, ``(generators, nodes)``."""
    made = np.zeros((1 + len(one.segments), len(inertia_nodes(one))))
    made[0, 0] = 1.0
    place = 1
    for k, segment in enumerate(one.segments, start=1):
        if len(segment) == 1:
            made[k, place] = 1.0
        else:
            made[k, place], made[k, place + 1] = -1.0, 1.0
        place += len(segment)
    return made


def _body_inertia(dim: int, shape: str, made: np.ndarray, x: dict[str, Array]) -> tuple[Array, Array]:
    """Return mass matrix and first moments of one body on its nodes."""
    m, count = x["mass"], made.shape[0] - 1
    eye = jnp.eye(dim)
    if count == 0:
        return m * eye, m * eye
    com, second = _moments(dim, shape, x)
    if dim == 2:
        length = jnp.sqrt(jnp.sum(x["spans"][0] ** 2))
        quarter = jnp.array([[0.0, -1.0], [1.0, 0.0]])
        c = com / length
        cross = m * (c[0] * eye + c[1] * quarter)
        polar = (jnp.trace(second) + m * jnp.sum(com * com)) / length**2
        blocks = jnp.stack([jnp.stack([m * eye, cross]), jnp.stack([cross.T, polar * eye])])
        moments = jnp.stack([m * eye, cross])
    else:
        axes = orthonormal_axes(x["frame"])
        base = axes @ x["spans"].T
        inverse = _invert(base)
        c = inverse @ com
        about = inverse @ (second + m * com[:, None] * com[None]) @ inverse.T
        j = jnp.concatenate(
            [jnp.concatenate([m[None, None], m * c[None]], 1), jnp.concatenate([m * c[:, None], about], 1)]
        )
        blocks = j[:, :, None, None] * eye
        moments = j[0][:, None, None] * eye
    width = made.shape[1] * dim
    local = jnp.einsum("ka,klij,lb->aibj", made, blocks, made).reshape(width, width)
    first = jnp.einsum("kij,ka->iaj", moments, made).reshape(dim, width)
    return local, first


def _invert(a: Array) -> Array:
    """Invert a matrix of three rows, or of one, by its cofactors."""
    if a.shape[0] == 1:
        return 1.0 / a
    rows = jnp.stack([jnp.cross(a[:, 1], a[:, 2]), jnp.cross(a[:, 2], a[:, 0]), jnp.cross(a[:, 0], a[:, 1])])
    return rows / jnp.dot(a[:, 0], rows[0])


def _moments(dim: int, shape: str, x: dict[str, Array]) -> tuple[Array, Array]:
    """Return the centre of mass from the origin, and second moments ``∫ r rᵀ dm`` about it, in the body's axes."""
    m, axes = x["mass"], orthonormal_axes(x["frame"])
    corners = (x["corners"] - x["drawn"]) @ axes.T
    com, second = jnp.mean(corners, axis=0), jnp.zeros((axes.shape[0], axes.shape[0]))
    if shape == "rod":
        d = corners[1] - corners[0]
        com, second = 0.5 * (corners[0] + corners[1]), m / 12.0 * d[:, None] * d[None]
    elif shape == "plate":
        com, second = _plate(corners, m)
    elif shape == "box":
        second = m / 12.0 * jnp.diag(x["size"] ** 2)
    elif shape == "cylinder":
        radius = x["size"][0] ** 2 / 4.0
        second = m * (
            radius * jnp.eye(2) if dim == 2 else jnp.diag(jnp.stack([x["size"][1] ** 2 / 12.0, radius, radius]))
        )
    elif shape == "sphere":
        second = m * x["size"][0] ** 2 / 5.0 * jnp.eye(dim)
    elif shape == "given" and dim == 2:
        second = 0.5 * x["inertia"][0] * jnp.eye(2)  # only its trace counts
    elif shape == "given":
        xx, yy, zz, xy, xz, yz = x["inertia"]
        tensor = jnp.stack([jnp.stack([xx, xy, xz]), jnp.stack([xy, yy, yz]), jnp.stack([xz, yz, zz])])
        second = 0.5 * jnp.trace(tensor) * jnp.eye(3) - tensor
        home = orthonormal_axes(x["home_frame"])
        second = home @ second @ home.T
    if x["com"].shape[0]:
        com = orthonormal_axes(x["home_frame"]) @ (x["com"] - x["home"])
    return com, second


def _plate(corners: Array, m: Array) -> tuple[Array, Array]:
    """Sum a uniform plate with these corners in order: triangles from the first corner, with signed areas."""
    a, b = corners[1:-1] - corners[0], corners[2:] - corners[0]
    if corners.shape[1] == 2:
        areas = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    else:
        normals = 0.5 * jnp.cross(a, b)
        areas = normals @ unit(jnp.sum(normals, axis=0))
    weights = areas / jnp.sum(areas)
    sums = a + b
    com = jnp.sum(weights[:, None] * sums, axis=0) / 3.0

    def outer(u, v):
        return u[:, :, None] * v[:, None, :]

    second = jnp.sum(weights[:, None, None] * (outer(a, a) + outer(b, b) + outer(sums, sums)), axis=0) / 12.0
    return corners[0] + com, m * (second - com[:, None] * com[None])
