"""Where a simulation begins: poses and velocities made consistent, with the size of what had to be corrected."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.compiling import on_device
from jaxnc.dynamics.extended import known, lift, lift_rates, lower
from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.saddle import saddle
from jaxnc.errors import AssemblyError, InputError, nearest
from jaxnc.kinematics.inputs import array, finite
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position, start_of
from jaxnc.solvers.assembly import derive, free_plan
from jaxnc.solvers.newton import attach_start, largest
from jaxnc.status import Status
from jaxnc.system.equations import weights
from jaxnc.system.host import from_jax
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import Array


def start_numbers(system: System, state: Motion | Mapping[str, Any] | None) -> Any:
    """What a user says of the start, checked: a pose ``(N,)``, values by name, or None."""
    top = system.topology
    if isinstance(state, Motion):
        if state.q.ndim != 1:
            raise InputError(f"a start must be a single pose; this motion has shape {state.status.shape}: use pose(k)")
        if state.q.shape != (len(top.coordinates),):
            raise InputError(f"state: the pose is one of {state.system.name!r}; {top.name!r} has other coordinates")
        finite(state.q, "state: the coordinates of the pose")
        return _on_ground(system, state.q)
    if state is None:
        return None
    if not isinstance(state, Mapping):
        raise InputError(f"state is an earlier pose, or values by name such as {{'phi': 0.3}}; got {state!r}")
    if not state:
        return None
    values = {name: array(value, f"state of {name!r}") for name, value in state.items()}
    if not all(n in top.position for n in state):
        return values
    for name, value in values.items():
        finite(value, f"state of {name!r}")
        if value.shape != ():
            raise InputError(f"state of {name!r} must be one number, got shape {value.shape}")
    return values


def _on_ground(system: System, q: Array) -> Array:
    """A pose, which may be one of another design, with what is fixed where this design has it."""
    fixed, home = np.flatnonzero(system.topology.fixed), derive(system).home
    if isinstance(q, Tracer) or isinstance(home, Tracer):
        return jnp.asarray(q).at[fixed].set(jnp.asarray(home)[fixed].astype(q.dtype))
    places, out = np.asarray(home)[fixed], np.array(q)
    if np.array_equal(out[fixed], places):
        return q
    out[fixed] = places
    return on_device(out)


def start_pose(system: System, state: Motion | Mapping[str, Any] | None) -> Array:
    """The pose ``(N,)`` that a simulation starts from.

    `state` is a pose, with the ground where this design has it; or values of as many coordinates as there are freedoms,
    which are met exactly; or places to start near to; or None for the assembled drawing.
    """
    return pose_of(system, start_numbers(system, state))


def pose_of(system: System, state: Any, throw: bool = True) -> Array:
    """The same of what `start_numbers` gives; nothing is raised if not `throw`, and in traced code."""
    if state is not None and not isinstance(state, Mapping):
        return state
    if state and exact(system, state):
        found = solve_position(system, state, throw=False)
        if throw and not isinstance(found.status, Tracer) and int(found.status):
            wanted = ", ".join(f"{name} = {float(value):g}" for name, value in state.items())
            raise AssemblyError(
                f"{system.name!r}: no start with {wanted} was found. {Status(int(found.status)).sentence} Begin "
                f"elsewhere, or give places to start near to, state={{'P': (x, y)}}"
            )
        return found.q
    q = start_of(system, derive(system), state, "state")
    return q if known(system, q) else as_drawn(system, q, state)


def exact(system: Any, state: Mapping[str, Any]) -> bool:
    """Whether values by name determine the pose of a system, or of what has its topology and count of freedoms."""
    return len(state) == system.degrees_of_freedom and all(n in system.topology.position for n in state)


def as_drawn(system: System, q: Array, state: Mapping[str, Any] | None) -> Array:
    """Give an assembled start its derivatives: it follows the drawing, but for what `state` says, as it was put."""
    return attach_start(free_plan(system.topology), q, derive(system), still(system.topology, state))


def still(top: Topology, state: Mapping[str, Any] | None) -> tuple[int, ...]:
    """Coordinates that a start has by a place or value near to them, not by the drawing."""
    names = [c for name in state or () for c in (name, *(f"{name}.{axis}" for axis in "xyz"[: top.dim]))]
    return tuple(top.position[c] for c in names if c in top.position)


def independent_names(system: System, flow: Flow, q: Array) -> tuple[str, ...]:
    """Coordinates that the others follow from, well conditioned at a pose (where it was compiled, in traced code)."""
    inner, top, view = flow.dyn.topology, system.topology, flow.view
    if isinstance(q, Tracer) or isinstance(flow.dyn.mass, Tracer):
        return system.independent
    _, j, _ = view.linearise(flow.dyn.eq, q)
    rows = np.asarray(j) / np.asarray(weights(flow.dyn.eq))[view.unknown]
    shown = [k for k, c in enumerate(view.unknown) if inner.coordinates[c] in top.position]
    free = np.linalg.svd(rows)[2][rows.shape[1] - system.degrees_of_freedom :][:, shown]
    from scipy.linalg import qr

    # An angle or a distance is easier to read than a component of a point: preferred where it serves nearly as well.
    names = [inner.coordinates[view.unknown[k]] for k in shown]
    liked = np.array([2.0 if n in top.scalars else 1.0 for n in names])
    order: np.ndarray = qr(free * liked, pivoting=True, mode="r")[-1]
    return tuple(names[k] for k in order[: system.degrees_of_freedom])


Rates = Array | tuple[tuple[int, ...], Any] | None
"""Rates to start with: of all coordinates of a pose, of some coordinates by place, or of none."""


def given_rates(system: System, rates: Motion | Mapping[str, Any] | None) -> Rates:
    """What a user says of the rates at the start, checked.

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
        value = array(value, f"rate of {name!r}")
        finite(value, f"rate of {name!r}")
        if name in (*top.points, *top.vectors):
            if value.shape != (top.dim,):
                raise InputError(f"rate of {name!r} must be {top.dim} numbers, got shape {value.shape}")
            places += [f"{name}.{axis}" for axis in "xyz"[: top.dim]]
            values += [value[k] for k in range(top.dim)]
        elif name in top.position:
            if value.shape != ():
                raise InputError(f"rate of {name!r} must be one number, got shape {value.shape}")
            places.append(name)
            values.append(value)
        else:
            names = (*top.points, *top.vectors, *top.scalars)
            raise InputError(f"rates: no point or coordinate {name!r}; {nearest(name, names)}")
    inner = top if top.extended is None else top.extended
    traced = any(isinstance(v, Tracer) for v in values)
    numbers = jnp.stack([jnp.asarray(v, float) for v in values]) if traced else np.array(values, float)
    return tuple(inner.position[name] for name in places), numbers


def start_rates(top: Topology, flow: Flow, q: Array, rates: Rates, settled: bool = True) -> tuple[Array, Array]:
    """Consistent rates ``(N,)`` in the coordinates of the dynamics, and the largest correction of what was given.

    Freedoms of which nothing is said move so that the kinetic energy is least.

    Rates given by name may be `settled`: brought onto the constraints once more, as they are solved for.
    """
    if rates is None:
        _, v = flow.impose(flow.dyn.total * 0.0, q, jnp.zeros_like(q))
        return flow.project_velocity(q, v), jnp.zeros(())
    if not isinstance(rates, tuple):
        return lift_rates(top, lower(top, q), rates), jnp.zeros(())
    at, wanted = np.array(rates[0]), rates[1]
    u = flow.view.unknown
    weight = weights(flow.dyn.eq)
    _, j, _, slip, _ = flow.rows(q, jnp.zeros_like(q))
    chosen = np.zeros((len(at), len(u)))
    for row, c in enumerate(at):
        chosen[row, u == c] = 1.0
    mass = flow.dyn.mass[u[:, None], u[None]] / (weight[u, None] * weight[None, u])
    rows = jnp.concatenate([j / weight[u], jnp.asarray(chosen)])
    right = jnp.concatenate([-slip, wanted * weight[at]])
    x, _ = saddle(mass / jnp.max(jnp.diagonal(mass)), rows, True)(jnp.zeros(len(u)), right)
    v = jnp.zeros_like(q).at[u].set(x / weight[u])
    v = flow.project_velocity(q, v) if settled else v
    return v, largest(v[at] - wanted)


_SMALL = 1e-9  # on the diagonal of rows, as in `jaxnc.dynamics.saddle`, with as many refinements


def _balance(h: np.ndarray, j: np.ndarray, f: np.ndarray, g: np.ndarray) -> np.ndarray:
    """The x of ``H x + Jᵀ λ = f, J x = g``, whatever rows are redundant."""
    m, n = j.shape
    true = np.block([[h, j.T], [j, np.zeros((m, m))]])
    right, z = np.concatenate([f, g]), np.zeros(n + m)
    inverse = np.linalg.inv(true - _SMALL * np.diag(np.repeat([0.0, 1.0], [n, m])))
    for _ in range(4):
        z = z + inverse @ (right - true @ z)
    return z[:n]


def rates_on_host(system: System, flow: Flow, q: np.ndarray, rates: tuple[tuple[int, ...], Any]) -> np.ndarray:
    """As `start_rates`, of rates by name, in NumPy; nothing is driven, and no rows are on velocities alone."""
    eq, view = from_jax(flow.dyn.eq), flow.view
    u, weight = view.unknown, eq.weights
    rows = np.ix_(view.rows, u)
    x = lift(system.topology, q).astype(float)
    for _ in range(2):
        j = eq.jacobian(x[:, None])[0][rows] / weight[u]
        r = eq.residual(x[:, None])[view.rows, 0]
        x[u] += _balance(np.eye(len(u)), j, np.zeros(len(u)), -r) / weight[u]
    j = eq.jacobian(x[:, None])[0][rows] / weight[u]
    mass = np.asarray(flow.dyn.mass)[np.ix_(u, u)] / np.outer(weight[u], weight[u])
    mass = mass / np.max(np.diagonal(mass))
    at, wanted = np.array(rates[0]), np.asarray(rates[1])
    both = np.concatenate([j, (at[:, None] == u[None]).astype(float)])
    v = _balance(mass, both, np.zeros(len(u)), np.concatenate([np.zeros(len(j)), wanted * weight[at]]))
    v = v + _balance(mass, j, np.zeros(len(u)), -j @ v)
    out = np.zeros(len(x))
    out[u] = v / weight[u]
    return out
