"""Mass matrix and forces of one design, on all coordinates: what of its dynamics does not depend on the pose."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.asking import ask, listed, real
from jaxnc.compiling import jit, on_device
from jaxnc.dynamics.extended import known
from jaxnc.dynamics.inertia import inertias, summed
from jaxnc.dynamics.state import State
from jaxnc.errors import InputError
from jaxnc.forces import ForceKind
from jaxnc.kinematics.inputs import check_parameters, check_system
from jaxnc.reading import Unreadable, function
from jaxnc.records import record
from jaxnc.remembered import with_owner
from jaxnc.solvers.assembly import by_identity, derive
from jaxnc.system.equations import Equations, equations, rate_constants
from jaxnc.system.loads import ForceBlock
from jaxnc.system.on_lanes import reading
from jaxnc.system.precision import numbers
from jaxnc.system.structure import Formula
from jaxnc.system.system import Parameters, System
from jaxnc.system.topology import Topology
from jaxnc.types import Array, Coordinates, Float


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
    """Derive mass matrix and constants of the forces from a system's parameters; compiled once for its topology."""
    return _on_host(system) if known(system) else _dynamics(system)


@by_identity
def _on_host(system: System) -> Dynamics:
    """Derive the same of numbers that are known, with nothing compiled, and remember it."""
    with numbers(system.parameters.points):
        eq = derive(system)
        parts: Any = on_device(_parts(system, np.asarray(eq.home), system.parameters.in_numpy()))
        return Dynamics(eq, *parts, system=system)


@jit
def _dynamics(system: System) -> Dynamics:
    eq = equations(system)
    return Dynamics(eq, *_parts(system, eq.home, system.parameters), system=system)


def _parts(system: System, home: Any, par: Parameters) -> Any:
    """The fields of `Dynamics` between equations and system: NumPy's of NumPy parameters."""
    top, loads = system.topology, system.topology.loads
    mass, moments, total = summed(top, inertias(system))
    gravity = par.physical[np.array(loads.gravity)] if loads.gravity else np.zeros(top.dim, home.dtype)
    constants = tuple(force_constants(top, home, block, par.physical) for block in loads.forces)
    friction = tuple(par.physical[np.array(f.numbers)] for f in loads.friction)
    return mass, moments, total, gravity, constants, friction, par.own, rate_constants(System(top, par))


@with_owner
def variables(top: Topology, number: int) -> np.ndarray:
    """Coordinates of every force of a block, ``(forces, variables)``."""
    block, dim = top.loads.forces[number], top.dim
    count, axes = len(block.names), np.arange(dim)

    def spread(which, offset):
        at = np.array(which, dtype=np.int64).reshape(count, -1)
        return ((offset + at)[:, :, None] * dim + axes).reshape(count, -1)

    scalars = np.array(block.scalars, dtype=np.int64).reshape(count, -1)
    return np.concatenate([spread(block.points, 0), spread(block.vectors, len(top.points)), scalars], axis=1)


def _split(dim: int, kind: ForceKind, x: Array) -> tuple[Array, Array, Array]:
    """Points, vectors and scalars of one force."""
    a, b = kind.points * dim, (kind.points + kind.vectors) * dim
    return x[:a].reshape(kind.points, dim), x[a:b].reshape(kind.vectors, dim), x[b:]


def force_constants(top: Topology, home: Any, block: ForceBlock, physical: Any) -> Any:
    """Parameters of a block's forces, as given and as drawn ``(forces, parameters)``: NumPy's of NumPy arrays.

    NumPy's coordinates and physical parameters may carry changes along a last axis; then these do too.
    """
    kind, count, tail = block.kind, len(block.names), home.shape[1:]
    out: Any = np.zeros((count, len(kind.parameters), *tail), home.dtype)
    if kind.drawn is not None:
        empty = read_off(kind, top.dim)[1]
        missing = {(i, k) for i in range(count) for k in np.flatnonzero(empty)}
        missing -= {(i, k) for i, k, _ in block.given}
        if missing:
            i, k = min(missing)
            raise InputError(f"{kind.name} {block.names[i]!r}: {kind.parameters[k]} must be given")
        x, read = home[variables(top, top.loads.forces.index(block))], force_formula(kind, top.dim)
        if isinstance(home, np.ndarray):
            values = (read.carrying if tail else read.on_lanes)(list(np.moveaxis(x, 1, 0)))
            out = np.stack([np.broadcast_to(y, (count, *tail)) for y in values], axis=1).astype(home.dtype)
        else:
            out = jax.vmap(read_off(kind, top.dim)[0])(x)
    if block.given:
        i, k, at = (np.array(z) for z in zip(*block.given, strict=True))
        if not isinstance(home, np.ndarray):
            return jnp.asarray(out).at[i, k].set(physical[at])
        out[i, k] = physical[at]
    return out


@functools.lru_cache(maxsize=256)
def force_formula(kind: ForceKind, dim: int) -> Formula:
    """Read off a drawing what it says of a force's parameters."""
    drawn, width = read_off(kind, dim)[0], (kind.points + kind.vectors) * dim + kind.scalars
    try:
        return Formula(reading(drawn, (), ((width,),))[0])
    except Unreadable:  # a user's kind, with an operation that the host does not know
        return Formula(None, drawn, kind)


@functools.lru_cache(maxsize=1024)
def read_off(kind: ForceKind, dim: int) -> tuple[Callable[[Array], Array], list[bool]]:
    """What a drawing says of a force's parameters, as a function of its variables, and which it says nothing of."""
    assert kind.drawn is not None
    drawn, width = kind.drawn, (kind.points + kind.vectors) * dim + kind.scalars
    what = f"kind {kind.name!r}: drawn="

    def called(y: Array) -> tuple[Any, ...]:
        return listed(ask(drawn, what, "p, v, s", *_split(dim, kind, y)), what, len(kind.parameters), drawn=True)

    values = jax.eval_shape(lambda y: _plain(called(y)), jax.ShapeDtypeStruct((width,), float))

    def read(y: Array) -> Array:
        found = called(y)
        return jnp.stack([jnp.zeros((), y.dtype) if c is None else jnp.asarray(c, y.dtype) for c in found])

    return read, [value is None for value in values]


def _plain(values):
    return tuple(None if v is None else jnp.asarray(v, float) for v in values)


def potential(dyn: Dynamics, q: Coordinates) -> Array:
    """Potential energy of gravity, springs and stops, J."""
    top = dyn.topology
    total = -jnp.dot(dyn.gravity, dyn.moments @ q)
    for number, block in enumerate(top.loads.forces):
        if block.kind.potential is not None:
            x = q[variables(top, number)]
            total = total + jnp.sum(jax.vmap(functools.partial(_stored, block.kind, top.dim))(x, dyn.constants[number]))
    return total


@functools.lru_cache(maxsize=256)
def stored(kind: ForceKind, dim: int) -> Callable:
    """The energy of a kind of force on NumPy's lanes: a function of its variables and parameters."""
    width = (kind.points + kind.vectors) * dim + kind.scalars
    return function(reading(_stored, (kind, dim), ((width,), (len(kind.parameters),)))[0])


def _stored(kind: ForceKind, dim: int, y: Array, c: Array) -> Array:
    assert kind.potential is not None
    what = f"kind {kind.name!r}: potential="
    return real(ask(kind.potential, what, "p, v, s, c", *_split(dim, kind, y), c), what, "one number", ())


@with_owner
def can_store(top: Topology) -> bool:
    """Whether the host knows the energies of all forces."""
    try:
        for block in top.loads.forces:
            if block.kind.potential is not None:
                stored(block.kind, top.dim)
    except Unreadable:
        return False
    return True


def kinetic(dyn: Dynamics, v: Coordinates) -> Array:
    """Kinetic energy, J."""
    return 0.5 * jnp.dot(v, dyn.mass @ v)


def forces(dyn: Dynamics, t: Array, q: Coordinates, v: Coordinates) -> Float[Array, " N"]:
    """Generalised forces on all coordinates, ground included: gravity, forces of all kinds, functions. No friction."""
    top = dyn.topology
    out = dyn.gravity @ dyn.moments
    local, functions = force_values(dyn, t, q, v)
    for number, values in enumerate(local):
        out = out.at[variables(top, number).reshape(-1)].add(values.reshape(-1))
    return sum(functions, out)


def force_values(dyn: Dynamics, t: Array, q: Array, v: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    """The forces one by one.

    Returns:
        Those of each block on their own variables, ``(forces, variables)``; those that are functions, on all
        coordinates ``(N,)``.
    """
    top, local = dyn.topology, []
    for number, block in enumerate(top.loads.forces):
        at = variables(top, number)
        local.append(
            jax.vmap(lambda y, dy, c, b=block: _force(top, b, t, y, dy, c))(q[at], v[at], dyn.constants[number])
        )
    return tuple(local), tuple(_functions(dyn, t, q, v))


def _force(top: Topology, block: ForceBlock, t: Array, x: Array, dx: Array, c: Array) -> Array:
    kind, total = block.kind, jnp.zeros_like(x)
    if kind.potential is not None:
        total = total - jax.grad(lambda y: _stored(kind, top.dim, y, c))(x)
    if loss := kind.dissipation:
        what, at = f"kind {kind.name!r}: dissipation=", _split(top.dim, kind, x)

        def lost(dy: Array) -> Array:
            found = ask(loss, what, "p, v, s, dp, dv, ds, c", *at, *_split(top.dim, kind, dy), c)
            return real(found, what, "one number", ())

        total = total - jax.grad(lost)(dx)
    if kind.force is not None:
        what, returns = f"kind {kind.name!r}: force=", "forces on its points, vectors and scalars, an array of each"
        at = *_split(top.dim, kind, x), *_split(top.dim, kind, dx)
        found = ask(kind.force, what, "t, p, v, s, dp, dv, ds, c", t, *at, c)
        parts = found if isinstance(found, tuple | list) else (found,)
        whole = jnp.concatenate([real(part, what, returns).reshape(-1) for part in (*parts, jnp.zeros(0))])
        total = total + real(whole, f"{what} these together", f"{returns}, {len(x)} numbers", x.shape)
    return total


def _functions(dyn: Dynamics, t: Array, q: Array, v: Array) -> list[Array]:
    top, found = dyn.topology, []
    state = State(top, t, q, v)
    plain = np.array([i for i, name in enumerate(top.coordinates) if name.rpartition(".")[0] not in top.loads.hidden])
    for f, parameters in zip(top.loads.functions, dyn.own, strict=True):
        out = jnp.zeros_like(q)
        if f.acts == "load":
            out = out.at[plain].add(_value(f, (len(plain),), "t, q, v, parameters", t, q[plain], v[plain], parameters))
        else:
            at = f.at if f.acts == "effort" else slice(f.at * top.dim, (f.at + 1) * top.dim)
            out = out.at[at].add(_value(f, out[at].shape, "t, state, parameters", t, state, parameters))
        found.append(out)
    return found


def _value(f: Any, shape: tuple[int, ...], takes: str, *args: Any) -> Array:
    """What a force that is a function returns."""
    what = f"force {f.name!r}"
    returns = f"{shape[0]} numbers in JAX" if shape else "one number in JAX"
    return real(ask(f.function, what, takes, *args), what, returns, shape)


def blame_force(dyn: Dynamics, t: Array, q: Array, v: Array) -> str | None:
    """Name of the first force that is not finite in a state, on the host."""
    top = dyn.topology
    for f, parameters in zip(top.loads.functions, dyn.own, strict=True):
        state = State(top, t, q, v)
        value = f.function(t, q, v, parameters) if f.acts == "load" else f.function(t, state, parameters)
        if not bool(jnp.all(jnp.isfinite(jnp.asarray(value)))):
            return f.name
    for number, block in enumerate(top.loads.forces):
        at = variables(top, number)
        local = jax.vmap(lambda y, dy, c, b=block: _force(top, b, t, y, dy, c))(q[at], v[at], dyn.constants[number])
        bad = np.flatnonzero(~np.isfinite(np.asarray(local)).all(axis=1))
        if len(bad):
            return block.names[bad[0]]
    return None
