"""Mass matrix and forces of one design, on all coordinates: what of its dynamics does not depend on the pose."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.compiling import jit, on_device
from jaxnc.dynamics.extended import is_concrete
from jaxnc.dynamics.mass import inertias, sum_inertias
from jaxnc.errors import InputError, nearest
from jaxnc.forces import CATALOGUE, ForceKind
from jaxnc.kinematics.inputs import check_parameters, check_system
from jaxnc.kinematics.motion import coordinates_of
from jaxnc.reading import OutOfRange, Unreadable, trace
from jaxnc.records import record, static
from jaxnc.remembered import by_identity, with_owner
from jaxnc.solvers.assembly import derive
from jaxnc.system.equations import Equations, equations, rate_constants
from jaxnc.system.loads import ForceBlock
from jaxnc.system.on_lanes import reading
from jaxnc.system.precision import numbers
from jaxnc.system.structure import Formula
from jaxnc.system.system import Parameters, System
from jaxnc.system.topology import INDEX, Topology
from jaxnc.types import Array, ArrayLike, Coordinates, Float, Numbers
from jaxnc.validate import as_real, as_scalars, call_user


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


def check_loads(system: System, what: str) -> None:
    """Refuse what is no system, and numbers that are known and that no machine has."""
    if not isinstance(system, System):
        check_system(system, what)
    check_parameters(system)
    physical = system.parameters.physical
    if isinstance(physical, Tracer) or physical.ndim != 1:
        return
    values = np.asarray(physical)
    for inertia in (i for group in system.topology.loads.inertias for i in group):
        if values[inertia.mass] < 0:
            raise InputError(
                f"{system.name!r}: {inertia.body or system.topology.loads.physical[inertia.mass]!r} has a mass of "
                f"{values[inertia.mass]:g}; a mass cannot be negative"
            )


def check_mass(system: System) -> None:
    """Refuse to move what has no mass at all; forces at rest need none."""
    if not system.topology.loads.any:
        raise InputError(
            f"{system.name!r}: nothing in it has a mass; give bodies mass=, or add point_mass(), before compile()"
        )


def dynamics(system: System) -> Dynamics:
    """Derive mass matrix and constants of the forces from a system's parameters.

    Known numbers are derived by the host, with nothing compiled, and remembered; traced ones are compiled once for the
    topology.
    """
    return _derive_on_host(system) if is_concrete(system) else _derive_traced(system)


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
    top, loads = system.topology, system.topology.loads
    mass, moments, total = sum_inertias(top, inertias(system))
    gravity = par.physical[np.array(loads.gravity)] if loads.gravity else np.zeros(top.dim, home.dtype)
    constants = tuple(force_constants(top, home, block, par.physical) for block in loads.forces)
    friction = tuple(par.physical[np.array(f.numbers)] for f in loads.friction)
    return mass, moments, total, gravity, constants, friction, par.own, rate_constants(System(top, par))


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


def _split(dim: int, kind: ForceKind, x: Array) -> tuple[Array, Array, Array]:
    """Part the variables of one force into points, vectors and scalars."""
    a, b = kind.points * dim, (kind.points + kind.vectors) * dim
    return x[:a].reshape(kind.points, dim), x[a:b].reshape(kind.vectors, dim), x[b:]


@functools.lru_cache(maxsize=256)
def check_indices(kind: ForceKind, dim: int) -> None:
    """Refuse a user's kind that asks for a point, vector, coordinate or parameter beyond those it declares.

    JAX would give it the last one in silence.
    """
    width = (kind.points + kind.vectors) * dim + kind.scalars

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
    drawn, width = kind.drawn, (kind.points + kind.vectors) * dim + kind.scalars
    what = f"kind {kind.name!r}: drawn="

    def call(y: Array) -> tuple[Any, ...]:
        return as_scalars(
            call_user(drawn, what, "p, v, s", *_split(dim, kind, y)), what, len(kind.parameters), drawn=True
        )

    def read(y: Array) -> Array:
        return jnp.stack([jnp.zeros((), y.dtype) if c is None else jnp.asarray(c, y.dtype) for c in call(y)])

    def say(y: Array) -> tuple[Array | None, ...]:
        return tuple(None if c is None else jnp.asarray(c, float) for c in call(y))

    missing = [value is None for value in jax.eval_shape(say, jax.ShapeDtypeStruct((width,), float))]
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
    width = (kind.points + kind.vectors) * dim + kind.scalars
    try:
        return reading(_instance_energy, (kind, dim), ((width,), (len(kind.parameters),)))[0]
    except Unreadable:
        return Formula(None, lambda x: _instance_energy(kind, dim, x[:width], x[width:])[None], kind)


def _instance_energy(kind: ForceKind, dim: int, y: Array, c: Array) -> Array:
    assert kind.potential is not None
    what = f"kind {kind.name!r}: potential="
    return as_real(call_user(kind.potential, what, "p, v, s, c", *_split(dim, kind, y), c), what, "one number", ())


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
        what, at = f"kind {kind.name!r}: dissipation=", _split(dim, kind, x)

        def dissipate(dy: Array) -> Array:
            found = call_user(loss, what, "p, v, s, dp, dv, ds, c", *at, *_split(dim, kind, dy), c)
            return as_real(found, what, "one number", ())

        total = total - jax.grad(dissipate)(dx)
    if kind.force is not None and only in (None, "force"):
        what, returns = f"kind {kind.name!r}: force=", "forces on its points, vectors and scalars, an array of each"
        at = *_split(dim, kind, x), *_split(dim, kind, dx)
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
