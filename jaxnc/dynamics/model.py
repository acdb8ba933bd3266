"""Mass matrix and forces of one design, on all coordinates: what of its dynamics does not depend on the pose.

Mass matrices follow by virtual power: constant for every body, assembled on all coordinates, ground included. A place
that rides on a body is affine in the body's natural coordinates, ``r = r_o + Σ c_k e_k`` with its segments e_k (in the
plane one segment and its quarter turn). Its velocity is the same combination of the rates, so that the virtual power
``∫ ṙ* · r̈ dm`` is a constant matrix: in space ``J ⊗ I`` with the body's zeroth, first and second moments in the
(oblique) base of its segments. Source: J. Unda, J. García de Jalón, Rev. Int. Mét. Num. Cálc. Dis. Ing. 1 (4), 1985,
inertia by the theorem of virtual power.
"""

import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.autodiff import attach_matrix
from jaxnc.calls import public
from jaxnc.compiling import jit, on_device
from jaxnc.constraints.kind import unit
from jaxnc.dynamics.extended import extended, is_concrete
from jaxnc.errors import InputError, nearest
from jaxnc.forces import CATALOGUE, ForceKind
from jaxnc.internals import evaluate_at_once, values_behind
from jaxnc.kinematics.inputs import check_parameters, check_system
from jaxnc.kinematics.motion import coordinates_of
from jaxnc.reading import OutOfRange, Unreadable, trace
from jaxnc.records import by_identity, record, static, with_owner
from jaxnc.solvers.assembly import derive
from jaxnc.system.design import GEOMETRY, carry_design, design, design_numbers, find_traced, with_unit_changes
from jaxnc.system.equations import Equations, equations, rate_constants
from jaxnc.system.frames import orthonormal_axes
from jaxnc.system.loads import ForceBlock, InertiaIndex
from jaxnc.system.on_lanes import reading
from jaxnc.system.precision import numbers
from jaxnc.system.structure import Formula, operands, size
from jaxnc.system.system import Parameters, System
from jaxnc.system.topology import INDEX, Topology
from jaxnc.types import Array, ArrayLike, Coordinates, Float, Numbers
from jaxnc.validate import as_real, as_scalars, call_user

_PARAMETERS = *GEOMETRY, "physical"


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


def sum_inertias(
    top: Topology, found: Sequence[tuple[np.ndarray, Numbers, Numbers, Numbers]], tail: tuple[int, ...] = ()
) -> tuple[Any, Any, Any]:
    """Sum the `inertias` of all bodies to the matrices of `mass_matrix`; axes behind their own, of changes, stay.

    Where nothing has a mass, `tail` are the sizes of those axes.
    """
    size, dim = len(top.coordinates), top.dim
    host = not found or isinstance(found[0][1], np.ndarray)
    xp: Any = np if host else jnp
    dtype = found[0][1].dtype if found else jax.dtypes.canonicalize_dtype(float)
    tail = found[0][1].shape[3:] if found else tail

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
    body, (height, width) = reading(_flat, (dim, one.shape, made, tuple(numbers)), shapes)
    lanes = [column for x in numbers.values() for column in np.moveaxis(x.reshape(*lead, -1, *tail), 1, 0)]
    values = (body.carrying if tail else body.on_lanes)(lanes)
    out = np.stack([np.broadcast_to(y, (*lead, *tail)) for y in values], axis=1).astype(numbers["mass"].dtype)
    out, split = out.reshape(*lead, height, width, *tail), height - dim
    return out[:, :split], out[:, split:]


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
        square = jnp.sum(x["spans"][0] ** 2)
        # A body of no length is no body: its numbers stay finite, and so do their derivatives.
        length = jnp.sqrt(jnp.where(square > 0.0, square, 1.0))
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


@public
@record
class State:
    """Position and velocity of a mechanism at one time, by name: the state that is handed to a user's force.

    Args:
        topology: the mechanism.
        t: the time, s.
        q: all coordinates, ``(N,)``.
        v: their rates, ``(N,)``.
    """

    topology: Topology = static()
    t: ArrayLike
    q: Array
    v: Array

    def __getitem__(self, name: str) -> Array:
        """A point ``(dim,)``, a vector ``(3,)``, a coordinate, or a single component such as ``"P.x"``."""
        return self._pick(self.q, name)

    def velocity(self, name: str) -> Array:
        """The rate of a point, vector or coordinate."""
        return self._pick(self.v, name)

    def _pick(self, x: Array, name: str) -> Array:
        top, at = self.topology, coordinates_of(self.topology, name)
        if at is None:
            names = (*top.points, *top.vectors, *top.scalars)
            raise InputError(f"{top.name!r} has no point or coordinate {name!r}; {nearest(name, names)}")
        return x[at]


@record
class Dynamics:
    """The equations of motion of one design."""

    eq: Equations  # its constraint equations
    mass: Array  # mass matrix, (N, N)
    moments: Array  # first moments, (dim, N): moments @ q is total mass times centre of mass
    total: Array  # total mass
    gravity: Array  # acceleration of free fall, (dim,)
    constants: tuple[Array, ...]  # parameters of the forces, per block (forces, parameters)
    friction: tuple[Array, ...]  # numbers of each friction
    own: tuple  # parameters of the forces that are functions
    rates: tuple[Array, ...]  # constants of the rows on velocities, per block
    system: System  # the design that it was derived from

    @property
    def topology(self) -> Topology:
        """The static part."""
        return self.system.topology


def check_loads(system: System, what: str, moves: bool = False) -> None:
    """Refuse what is no system, and numbers that are known and that no machine has.

    If it `moves` it is refused without any mass, too; forces at rest need none.
    """
    if not isinstance(system, System):
        check_system(system, what)
    check_parameters(system)
    physical, loads = system.parameters.physical, system.topology.loads
    known = not isinstance(physical, Tracer) and physical.ndim == 1
    for inertia in (i for group in loads.inertias for i in group if known):
        mass = float(np.asarray(physical)[inertia.mass])
        if mass < 0:
            raise InputError(
                f"{system.name!r}: {inertia.body or loads.physical[inertia.mass]!r} has a mass of {mass:g}; a mass "
                f"cannot be negative"
            )
    if not isinstance(points := system.parameters.points, Tracer) and points.ndim == 2:
        for inertia in (i for group in loads.inertias for i in group if i.home == i.drawn):
            if any(np.array_equal(*np.asarray(points)[list(s)]) for s in inertia.segments if len(s) == 2):
                raise InputError(f"{system.name!r}: {inertia.body!r} has no length: its points are in one place")
    if moves and not loads.any:
        raise InputError(
            f"{system.name!r}: nothing in it has a mass; give bodies mass=, or add point_mass(), before compile()"
        )


def dynamics(system: System) -> Dynamics:
    """Derive mass matrix and constants of the forces from a system's parameters.

    Known numbers are derived by the host, with nothing compiled, and remembered; traced ones are compiled once for the
    topology.
    """
    if is_concrete(system):
        return _derive_on_host(system)
    known, inner = values_behind(system), system.topology
    kinds = (f.kind for f in inner.loads.forces)
    if known is None or inner.rates or inner.large or any(not _is_read(kind, inner.dim) for kind in kinds):
        return _derive_traced(system)
    return _derive_with_changes(known, system)


def _is_read(kind: ForceKind, dim: int) -> bool:
    """Tell whether the host differentiates what a kind's parameters are where they are drawn."""
    return kind.drawn is None or drawn_parameters(kind, dim)[0].program is not None


def _derive_with_changes(known: System, system: System) -> Dynamics:
    """Derive on the host what JAX differentiates once, its derivatives as a matrix."""
    with evaluate_at_once():
        found = _derive_on_host(known)
    changed, at = find_traced(system.parameters, _PARAMETERS)
    value = found.mass, found.moments, found.total, found.gravity, found.constants, found.friction
    if len(at):
        top, par = known.topology, known.parameters.in_numpy()
        flat = with_unit_changes(np.concatenate([np.ravel(getattr(par, name)) for name in _PARAMETERS]), at)
        points, physical = flat[: par.points.size].reshape(*par.points.shape, -1), flat[-par.physical.size :]
        with np.errstate(all="ignore"):
            drawn = carry_design(top, flat[: len(flat) - par.physical.size], par.near)
            carried = group_inertias(top, points, drawn.drawing, drawn.vectors, physical)
            moves = sum_parts(top, carried, drawn.home, physical)
        slopes = np.concatenate([x[..., 1:].reshape(-1, len(at)) for x in jax.tree.leaves(moves)])
        value = attach_matrix(value, changed, slopes)
    rest: Any = *value, system.parameters.own, found.rates
    return Dynamics(derive(system), *rest, system=system)


@by_identity
def _derive_on_host(system: System) -> Dynamics:
    with numbers(system.parameters.points):
        eq = derive(system)
        parts: Any = on_device(_parts(system, np.asarray(eq.home), system.parameters.in_numpy()))
        return Dynamics(eq, *parts, system=system)


@jit
def _derive_traced(system: System) -> Dynamics:
    eq = equations(system)
    return Dynamics(eq, *_parts(system, eq.home, system.parameters), system=system)


def _parts(system: System, home: Numbers, par: Parameters) -> Any:
    """Return the fields of `Dynamics` between equations and system: NumPy's of NumPy parameters."""
    sums = sum_parts(system.topology, inertias(system), home, par.physical)
    return *sums, par.own, rate_constants(System(system.topology, par))


def sum_parts(
    top: Topology, found: Sequence[tuple[np.ndarray, Numbers, Numbers, Numbers]], home: Any, physical: Any
) -> Any:
    """Return masses, gravity and what forces and frictions are given, from `inertias`, coordinates and parameters.

    NumPy's may carry changes along a last axis; then all of it does.
    """
    loads, tail = top.loads, home.shape[1:]
    gravity = physical[np.array(loads.gravity)] if loads.gravity else np.zeros((top.dim, *tail), home.dtype)
    constants = tuple(force_constants(top, home, block, physical) for block in loads.forces)
    return (
        *sum_inertias(top, found, tail),
        gravity,
        constants,
        tuple(physical[np.array(f.numbers)] for f in loads.friction),
    )


@with_owner
def force_variables(top: Topology, number: int) -> np.ndarray:
    """Return the coordinates of every force of a block, ``(forces, variables)``."""
    block, dim = top.loads.forces[number], top.dim
    count, axes = len(block.names), np.arange(dim, dtype=INDEX)

    def spread(which, offset):
        at = np.array(which, dtype=INDEX).reshape(count, -1)
        return ((offset + at)[:, :, None] * dim + axes).reshape(count, -1)

    scalars = np.array(block.scalars, dtype=INDEX).reshape(count, -1)
    return np.concatenate([spread(block.points, 0), spread(block.vectors, len(top.points)), scalars], axis=1)


@functools.lru_cache(maxsize=256)
def check_indices(kind: ForceKind, dim: int) -> None:
    """Refuse a user's kind that asks for a point, vector, coordinate or parameter beyond those it declares.

    JAX would give it the last one in silence.
    """
    width = size(kind, dim)

    def evaluate(x: Array, dx: Array, c: Array, t: Array) -> tuple[Array]:
        return (instance_force(dim, kind, t, x, dx, c),)

    try:
        trace(evaluate, (width,), (width,), (len(kind.parameters),), (), values_only=True)
    except Unreadable:  # an operation that the host does not know
        return
    except OutOfRange as error:
        raise InputError(
            f"kind {kind.name!r} asks for {error}: it declares points={kind.points}, vectors={kind.vectors}, "
            f"scalars={kind.scalars} and {len(kind.parameters)} parameters; declare as many as it uses"
        ) from None


def force_constants(top: Topology, home: Any, block: ForceBlock, physical: Any) -> Any:
    """Return the parameters of a block's forces, given or drawn ``(forces, parameters)``: NumPy's of NumPy arrays.

    NumPy's coordinates and physical parameters may carry changes along a last axis; then these do too.
    """
    kind, (count, tail) = block.kind, (len(block.names), home.shape[1:])
    if CATALOGUE.get(kind.name) is not kind:
        check_indices(kind, top.dim)
    host = isinstance(home, np.ndarray)
    xp: Any = np if host else jnp
    out: Any = np.zeros((count, len(kind.parameters), *tail), home.dtype)
    if kind.drawn is not None:
        formula, missing = drawn_parameters(kind, top.dim)
        open_places = {(i, int(k)) for i in range(count) for k in np.flatnonzero(missing)}
        if lacking := open_places - {(i, k) for i, k, _ in block.given}:
            i, k = min(lacking)
            raise InputError(f"{kind.name} {block.names[i]!r}: {kind.parameters[k]} must be given")
        x = home[force_variables(top, top.loads.forces.index(block))]
        values = formula.reading(home, bool(tail))([x[:, k] for k in range(x.shape[1])])
        out = xp.stack([xp.broadcast_to(y, (count, *tail)) for y in values], axis=1).astype(home.dtype)
    if block.given:
        i, k, at = (np.array(z) for z in zip(*block.given, strict=True))
        if not host:
            return jnp.asarray(out).at[i, k].set(physical[at])
        out[i, k] = physical[at]
    return out


@functools.lru_cache(maxsize=1024)
def drawn_parameters(kind: ForceKind, dim: int) -> tuple[Formula, list[bool]]:
    """Read off a kind what a drawing says of a force's parameters, and which parameters it says nothing of."""
    assert kind.drawn is not None
    drawn, width = kind.drawn, size(kind, dim)
    what = f"kind {kind.name!r}: drawn="

    def call(y: Array) -> tuple[Any, ...]:
        return as_scalars(
            call_user(drawn, what, "p, v, s", *operands(kind, dim, y)), what, len(kind.parameters), drawn=True
        )

    def read(y: Array) -> Array:
        return jnp.stack([jnp.zeros((), y.dtype) if c is None else jnp.asarray(c, y.dtype) for c in call(y)])

    def say(y: Array) -> tuple[Array | None, ...]:
        return tuple(None if c is None else jnp.asarray(c, float) for c in call(y))

    missing = [value is None for value in jax.eval_shape(say, jax.ShapeDtypeStruct((width,), jnp.result_type(float)))]
    try:
        return reading(read, (), ((width,),))[0], missing
    except Unreadable:  # a user's kind, with an operation that the host does not know
        return Formula(None, read, kind), missing


def potential(dyn: Dynamics, q: Coordinates) -> Array:
    """Potential energy of gravity, springs and stops, J."""
    top = dyn.topology
    total = -jnp.dot(dyn.gravity, dyn.moments @ q)
    for number, block in enumerate(top.loads.forces):
        if block.kind.potential is not None:
            each = jax.vmap(functools.partial(_instance_energy, block.kind, top.dim))
            total = total + jnp.sum(each(q[force_variables(top, number)], dyn.constants[number]))
    return total


@functools.lru_cache(maxsize=256)
def energy_formula(kind: ForceKind, dim: int) -> Formula:
    """Read a kind's energy as a function of its variables and parameters."""
    width = size(kind, dim)
    try:
        return reading(_instance_energy, (kind, dim), ((width,), (len(kind.parameters),)))[0]
    except Unreadable:
        return Formula(None, lambda x: _instance_energy(kind, dim, x[:width], x[width:])[None], kind)


def _instance_energy(kind: ForceKind, dim: int, y: Array, c: Array) -> Array:
    assert kind.potential is not None
    what = f"kind {kind.name!r}: potential="
    return as_real(call_user(kind.potential, what, "p, v, s, c", *operands(kind, dim, y), c), what, "one number", ())


def forces(dyn: Dynamics, t: Array, q: Coordinates, v: Coordinates) -> Float[Array, " N"]:
    """Generalised forces on all coordinates, ground included: gravity, forces of all kinds, functions. No friction."""
    top = dyn.topology
    out = dyn.gravity @ dyn.moments
    local, functions = force_values(dyn, t, q, v)
    for number, values in enumerate(local):
        out = out.at[force_variables(top, number).reshape(-1)].add(values.reshape(-1))
    return sum(functions, out)


def force_values(
    dyn: Dynamics, t: Array, q: Array, v: Array, only: str | None = None
) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """Evaluate the forces one by one, or that part of them alone which kinds state as `only`; functions are a force.

    Returns:
        Forces of each block on their own variables, ``(forces, variables)``; forces that are functions, on all
        coordinates ``(N,)``.
    """
    top, local = dyn.topology, []
    for number, block in enumerate(top.loads.forces):
        at = force_variables(top, number)
        each = functools.partial(instance_force, top.dim, block.kind, t, only=only)
        local.append(jax.vmap(each)(q[at], v[at], dyn.constants[number]))
    return tuple(local), tuple(function_forces(dyn, t, q, v)) if only in (None, "force") else ()


def instance_force(
    dim: int, kind: ForceKind, t: ArrayLike, x: Array, dx: Array, c: Array, only: str | None = None
) -> Array:
    """Evaluate one force of a kind on its own variables: of these, their rates and its parameters.

    Of potential, dissipation and force `only` one counts, or all.
    """
    total = jnp.zeros_like(x)
    if kind.potential is not None and only in (None, "potential"):
        total = total - jax.grad(lambda y: _instance_energy(kind, dim, y, c))(x)
    if (loss := kind.dissipation) and only in (None, "dissipation"):
        what, at = f"kind {kind.name!r}: dissipation=", operands(kind, dim, x)

        def dissipate(dy: Array) -> Array:
            found = call_user(loss, what, "p, v, s, dp, dv, ds, c", *at, *operands(kind, dim, dy), c)
            return as_real(found, what, "one number", ())

        total = total - jax.grad(dissipate)(dx)
    if kind.force is not None and only in (None, "force"):
        what, returns = f"kind {kind.name!r}: force=", "forces on its points, vectors and scalars, an array of each"
        at = *operands(kind, dim, x), *operands(kind, dim, dx)
        found = call_user(kind.force, what, "t, p, v, s, dp, dv, ds, c", t, *at, c)
        parts = found if isinstance(found, tuple | list) else (found,)
        whole = jnp.concatenate([as_real(part, what, returns).reshape(-1) for part in (*parts, jnp.zeros(0))])
        total = total + as_real(whole, f"{what} these together", f"{returns}, {len(x)} numbers", x.shape)
    return total


def function_forces(dyn: Dynamics, t: Array, q: Array, v: Array) -> list[Array]:
    """Evaluate the forces that are functions, each on all coordinates ``(N,)``."""
    top, found = dyn.topology, []
    state = State(top, t, q, v)
    plain = np.array([i for i, name in enumerate(top.coordinates) if name.rpartition(".")[0] not in top.loads.hidden])
    for f, parameters in zip(top.loads.functions, dyn.own, strict=True):
        out = jnp.zeros_like(q)
        if f.acts == "load":
            at, takes, given = plain, "t, q, v, parameters", (t, q[plain], v[plain])
        else:
            at = f.at if f.acts == "effort" else slice(f.at * top.dim, (f.at + 1) * top.dim)
            takes, given = "t, state, parameters", (t, state)
        what, shape = f"force {f.name!r}", out[at].shape
        returns = f"{shape[0]} numbers in JAX" if shape else "one number in JAX"
        found.append(
            out.at[at].add(as_real(call_user(f.function, what, takes, *given, parameters), what, returns, shape))
        )
    return found


def blame_force(dyn: Dynamics, t: Array, q: Array, v: Array) -> str | None:
    """Name the first force that is not finite in a state, on the host."""
    local, functions = force_values(dyn, t, q, v)
    named = [(f.name, value) for f, value in zip(dyn.topology.loads.functions, functions, strict=True)]
    for block, values in zip(dyn.topology.loads.forces, local, strict=True):
        named += zip(block.names, values, strict=True)
    return next((name for name, value in named if not np.isfinite(np.asarray(value)).all()), None)
