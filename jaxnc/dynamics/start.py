"""Where a simulation begins: poses and velocities made consistent, and motions refused that nothing determines."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.compiling import filter_jit, on_device
from jaxnc.dynamics.extended import is_concrete, lift_rates, lower
from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.model import body_inertia
from jaxnc.errors import AssemblyError, InputError, counted, nearest
from jaxnc.kinematics.inputs import array, doubt_degrees, finite, finite_array, in_radians, worst_rows
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position, start_of
from jaxnc.solvers.assembly import derive, evaluate, free_plan, meets, rank_of, to_host
from jaxnc.solvers.newton import attach_start
from jaxnc.solvers.saddle import saddle
from jaxnc.status import Status
from jaxnc.system.equations import coefficients, weights
from jaxnc.system.precision import limits
from jaxnc.system.system import System, characteristic_length
from jaxnc.system.topology import Topology
from jaxnc.types import Array, Inputs, Numbers, PyTree

Rates = Array | tuple[tuple[int, ...], Any] | None
"""Rates to start with: of all coordinates of a pose, of some coordinates by place, or of none."""


# -- poses ------------------------------------------------------------------------------------------------------------


def check_start(
    system: System, state: Motion | Inputs | None, rates: Motion | Inputs | None, unit: str | None
) -> tuple[Any, Rates]:
    """Check what a user says of the start and of the rates there, angles in `unit`; both then are in radians.

    A pose that carries rates has them unless others are given.
    """
    doubt_degrees(system, unit, state)
    state, rates = in_radians(system, unit, state, rates)
    pose = check_pose(system, state)
    return pose, check_rates(system, rates if rates is not None else state if isinstance(state, Motion) else None)


def check_pose(system: System, state: Motion | Inputs | None) -> Any:
    """Check what a user says of a pose to start from, and return a pose ``(N,)``, values by name, or None."""
    top = system.topology
    if isinstance(state, Motion):
        if state.q.ndim != 1:
            raise InputError(f"a start must be a single pose; this motion has shape {state.status.shape}: use pose(k)")
        if state.q.shape != (len(top.coordinates),):
            raise InputError(f"state: the pose is one of {state.system.name!r}; {top.name!r} has other coordinates")
        finite(state.q, "state: the coordinates of the pose")
        return _put_on_ground(system, state.q)
    if state is None:
        return None
    if not isinstance(state, Mapping):
        raise InputError(f"state is an earlier pose, or values by name such as {{'phi': 0.3}}; got {state!r}")
    if not state:
        return None
    if not all(n in top.position for n in state):
        return {name: array(value, f"state of {name!r}") for name, value in state.items()}
    if len(state) > system.degrees_of_freedom and not {*top.scalars}.isdisjoint(state):
        raise InputError(
            f"state: {', '.join(state)} are {len(state)} values, and {top.name!r} has "
            f"{counted(system.degrees_of_freedom, 'freedom')}: give as many, or places to start near to, "
            f"state={{'P': (x, y)}}"
        )
    return {name: read_numbers(value, f"state of {name!r}") for name, value in state.items()}


def read_numbers(value: object, what: str, *shape: int) -> Array:
    """Read one finite number, or as many as a shape says."""
    found = finite_array(value, what)
    if found.shape != shape:
        raise InputError(f"{what} must be {f'{shape[0]} numbers' if shape else 'one number'}, got shape {found.shape}")
    return found


def _put_on_ground(system: System, q: Array) -> Array:
    """Put what is fixed of a pose, which may be one of another design, where this design has it."""
    fixed, home = np.flatnonzero(system.topology.fixed), derive(system).home
    if isinstance(q, Tracer) or isinstance(home, Tracer):
        return jnp.asarray(q).at[fixed].set(jnp.asarray(home)[fixed].astype(q.dtype))
    places, out = np.asarray(home)[fixed], np.array(q)
    if np.array_equal(out[fixed], places):
        return q
    out[fixed] = places
    return on_device(out)


def assemble_pose(system: System, state: PyTree, throw: bool = True) -> Array:
    """Find the pose ``(N,)`` that a simulation starts from; nothing is raised if not `throw`, and in traced code.

    `state` is what `check_pose` returns: a pose, with the ground where this design has it; or values of as many
    coordinates as there are freedoms, which are met exactly; or places to start near to; or None for the assembled
    drawing.
    """
    if state is not None and not isinstance(state, Mapping):
        return state
    if state and determines_pose(system.topology, system.degrees_of_freedom, state):
        found = solve_position(system, state, throw=False)
        if throw and not isinstance(found.status, Tracer) and int(found.status):
            wanted = ", ".join(f"{name} = {float(value):g}" for name, value in state.items())
            raise AssemblyError(
                f"{system.name!r}: no start with {wanted} was found. {Status(int(found.status)).sentence} Begin "
                f"elsewhere, or give places to start near to, state={{'P': (x, y)}}"
            )
        return found.q
    q = start_of(system, derive(system), state, what="state")
    if not is_concrete(system, q):
        return attach_drawing(system, q, state)
    if throw:
        _check_assembled(system, q, state)
    return q


def _check_assembled(system: System, q: Array, state: PyTree) -> None:
    """Refuse a start at which the mechanism does not assemble."""
    eq = derive(system)
    gap = float(np.abs(evaluate(eq, jnp.asarray(q))[0]).max(initial=0.0))
    if not meets(eq, q, gap):
        what = "the drawing" if state is None else "the start"
        raise AssemblyError(f"{system.name!r}: {what} does not assemble: {worst_rows(system, eq, np.asarray(q))}.")


def begin_pose(system: System, state: PyTree, driven: Mapping[str, Numbers], throw: bool = True) -> Array:
    """Find the start of a motion from what `check_pose` returns and values of what is `driven`.

    Where all freedoms are, the drawing's branch is followed to these values, if it leads there.
    """
    begin = assemble_pose(system, state, throw)
    free = [name for name in driven if not system.topology.fixed[system.topology.position[name]]]  # not the ground's
    if state is not None or not driven or len(free) != system.degrees_of_freedom:
        return begin
    found = solve_position(system, driven, throw=False)
    return jnp.where(found.converged, found.q, begin)


def determines_pose(top: Topology, freedom: int, state: Mapping[str, Numbers]) -> bool:
    """Tell whether values by name determine the pose of a mechanism with so many freedoms."""
    return len(state) == freedom and all(n in top.position for n in state)


def attach_drawing(system: System, q: Array, state: Mapping[str, Array] | None) -> Array:
    """Give an assembled start its derivatives: it follows the drawing, but for what `state` says, as it was put."""
    still, size = still_coordinates(system.topology, state), characteristic_length(system.parameters.points)
    return attach_start(free_plan(system.topology), q, derive(system), size, still)


def still_coordinates(top: Topology, state: Mapping[str, Array] | None) -> tuple[int, ...]:
    """List coordinates that a start has by a place or value near to them, not by the drawing."""
    names = [c for name in state or () for c in (name, *(f"{name}.{axis}" for axis in "xyz"[: top.dim]))]
    return tuple(top.position[c] for c in names if c in top.position)


# -- rates ------------------------------------------------------------------------------------------------------------


def check_rates(system: System, rates: Motion | Inputs | None) -> Rates:
    """Check what a user says of the rates at the start.

    `rates` are a motion that carries them; or rates of coordinates, points and vectors by name; or None for rest.
    """
    top = system.topology
    if isinstance(rates, Motion):
        return rates.rates[0] if rates.rates else None
    if rates is None:
        return None
    if not isinstance(rates, Mapping):
        raise InputError(f"rates are numbers by name such as {{'phi': 1.0}}; got {rates!r}")
    if not rates:
        return None
    places, values = [], []
    for name, value in rates.items():
        what = f"rate of {name!r}"
        if name in (*top.points, *top.vectors):
            places += [f"{name}.{axis}" for axis in "xyz"[: top.dim]]
            values += [*read_numbers(value, what, top.dim)]
        elif name in top.position:
            places.append(name)
            values.append(read_numbers(value, what))
        else:
            names = (*top.points, *top.vectors, *top.scalars)
            raise InputError(f"rates: no point or coordinate {name!r}; {nearest(name, names)}")
    inner = top if top.extended is None else top.extended
    traced = any(isinstance(v, Tracer) for v in values)
    numbers = jnp.stack([jnp.asarray(v, float) for v in values]) if traced else np.array(values, float)
    return tuple(inner.position[name] for name in places), numbers


def start_rates(
    top: Topology, flow: Flow, q: Array, rates: Rates, settled: bool = True, driven: Array | None = None
) -> Array:
    """Find consistent rates ``(N,)`` in the coordinates of the dynamics.

    Freedoms of which nothing is said move so that the kinetic energy is least. Rates given by name may be `settled`:
    brought onto the constraints once more, as they are solved for. The rates of driven coordinates, zero elsewhere, are
    `driven`.
    """
    driven = jnp.zeros_like(q) if driven is None else driven
    if rates is None and not flow.drives:
        return flow.project_velocity(q, driven)
    if rates is not None and not isinstance(rates, tuple):
        return lift_rates(top, lower(top, q), rates)
    at, wanted = np.array(rates[0] if rates else (), int), rates[1] if rates else jnp.zeros(0)
    u = flow.view.unknown
    weight = weights(flow.dyn.eq)
    _, j, _, slip, _ = flow.rows(q, driven)
    chosen = (at[:, None] == u[None]).astype(float)
    mass = flow.dyn.mass[u[:, None], u[None]] / (weight[u, None] * weight[None, u])
    pull = -(flow.dyn.mass[u] @ driven) / weight[u]  # of what is driven on the others
    rows = jnp.concatenate([j / weight[u], jnp.asarray(chosen)])
    right = jnp.concatenate([-slip, wanted * weight[at]])
    most = jnp.max(jnp.diagonal(mass))
    x, _ = saddle(mass / most, rows, True)(pull / most, right)
    v = driven.at[u].set(x / weight[u])
    return flow.project_velocity(q, v) if settled else v


def rates_on_host(flow: Flow, q: np.ndarray, rates: tuple[tuple[int, ...], Numbers]) -> np.ndarray:
    """Find the rates of `start_rates`, given by name, in NumPy; nothing is driven, and no rows are on velocities."""
    eq, view = to_host(flow.dyn.eq), flow.view
    u, weight = view.unknown, eq.weights
    x, still = q.astype(float), np.zeros(len(u))
    for _ in range(2):
        r = eq.residual(x[:, None])[view.rows, 0]
        x[u] += _solve_rows(np.eye(len(u)), _host_slopes(flow, x)[0], still, -r) / weight[u]
    j = _host_slopes(flow, x)[0]
    mass = np.asarray(flow.dyn.mass)[np.ix_(u, u)] / np.outer(weight[u], weight[u])
    mass = mass / np.max(np.diagonal(mass))
    at, wanted = np.array(rates[0]), np.asarray(rates[1])
    both = np.concatenate([j, (at[:, None] == u[None]).astype(float)])
    v = _solve_rows(mass, both, still, np.concatenate([np.zeros(len(j)), wanted * weight[at]]))
    v = v + _solve_rows(mass, j, still, -j @ v)
    out = np.zeros(len(x))
    out[u] = v / weight[u]
    return out


def _solve_rows(h: np.ndarray, j: np.ndarray, f: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Solve ``H x + Jᵀ λ = f, J x = g`` for x, whatever rows are redundant."""
    m, n = j.shape
    true = np.block([[h, j.T], [j, np.zeros((m, m))]])
    right, z = np.concatenate([f, g]), np.zeros(n + m)
    # As in `jaxnc.solvers.saddle`, with as many refinements; always of 64 bits.
    inverse = np.linalg.inv(true - 1e-9 * np.diag(np.repeat([0.0, 1.0], [n, m])))
    for _ in range(4):
        z = z + inverse @ (right - true @ z)
    return z[:n]


def _host_slopes(flow: Flow, q: Numbers) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows' derivatives by the unknown and by the driven coordinates, every coordinate a length."""
    top, view, eq, at = flow.dyn.topology, flow.view, to_host(flow.dyn.eq), np.asarray(q)
    j = eq.jacobian(at[:, None])[0][view.rows]
    if top.rates:
        j = np.concatenate([j, np.asarray(_slip_coefficients(top, flow.dyn.rates, at))])
    j = j / eq.weights
    return j[:, view.unknown], j[:, view.known]


_slip_coefficients = filter_jit(coefficients)


# -- what nothing determines ------------------------------------------------------------------------------------------


def check_begin(flow: Flow, q: Array) -> None:
    """Refuse inputs that cannot all be prescribed at the start, and a motion without inertia."""
    j, known = _host_slopes(flow, q)
    if flow.drives and rank_of(np.concatenate([j, known], axis=1))[0] > rank_of(j)[0]:
        raise InputError(
            f"{flow.dyn.topology.name!r}: the inputs {', '.join(name for name, _ in flow.drives)} cannot be prescribed "
            f"where the motion begins: they depend on each other there, or it is a dead point of them. Leave one out, "
            f"or begin elsewhere with state="
        )

    _check_inertia(flow, j)


def _check_inertia(flow: Flow, slopes: np.ndarray) -> None:
    """Refuse a mechanism of which a motion that the rows admit has no inertia: its acceleration is not determined."""
    none = limits(flow.dyn.mass).nothing  # of the largest inertia: a motion has none below
    top, view = flow.dyn.topology, flow.view
    whole = np.asarray(flow.dyn.mass)
    if np.linalg.eigvalsh(whole)[0] < -none * np.abs(whole).max():
        for body in top.bodies:
            own = np.asarray(body_inertia(flow.dyn.system, body.name)[1])
            if own.size and np.linalg.eigvalsh(own)[0] < -none * np.abs(own).max():
                raise InputError(
                    f"{top.name!r}: no body has the inertia of {body.name!r}: it could move with negative energy"
                )
    u, weight = view.unknown, to_host(flow.dyn.eq).weights
    mass = whole[np.ix_(u, u)] / np.outer(weight[u], weight[u])
    _, null = rank_of(slopes)
    if not len(null):
        return
    reduced = null @ mass @ null.T
    values, vectors = np.linalg.eigh(0.5 * (reduced + reduced.T))
    if values[0] > none * max(float(np.abs(mass).max()), 1e-300):
        return
    motion = np.abs(vectors[:, 0] @ null)
    names = [top.coordinates[view.unknown[k]] for k in np.argsort(-motion)[:4] if motion[k] > 0.05 * motion.max()]
    points = {n.partition(".")[0] for n in names}
    physical = np.asarray(flow.dyn.system.parameters.physical)
    masses = {i.body: float(physical[i.mass]) for group in top.loads.inertias for i in group}
    massless = [b.name for b in top.bodies if {top.points[p] for p in b.points} & points and not masses.get(b.name)]
    have = "has" if len(massless) == 1 else "have"
    bodies = f"; of what moves there, {', '.join(map(repr, massless))} {have} no mass" if massless else ""
    raise InputError(
        f"{top.name!r}: a motion that the constraints admit has no inertia, so forces do not determine it: it moves "
        f"{', '.join(names)}{bodies}. Give it mass, or drive it with inputs="
    )
