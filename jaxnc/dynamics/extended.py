"""Hidden vectors: what bodies without a full base get for their dynamics, and only for it.

A spatial body of three points, or of two points and a vector, knows its orientation by two segments, but a place on it
is affine in its coordinates only with a third one. Dynamics then works on the same mechanism with a unit vector across
the two; its kinematic counts, rows and coordinates stay as they are, and results come back in them.
"""

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.compiling import on_device
from jaxnc.constraints.kind import unit
from jaxnc.records import by_identity, with_owner
from jaxnc.solvers.assembly import derive, evaluate, rank_of, sample_poses
from jaxnc.solvers.elimination import with_special
from jaxnc.system.design import design, design_numbers
from jaxnc.system.equations import pure_numbers
from jaxnc.system.frames import span, spread
from jaxnc.system.on_lanes import reading
from jaxnc.system.structure import Formula
from jaxnc.system.system import Parameters, System
from jaxnc.system.topology import INDEX, Topology
from jaxnc.types import AnyArray, Array, Numbers


def is_concrete(*trees: object) -> bool:
    """Tell whether all numbers are known (not traced) and of one design, so that NumPy can calculate with them."""
    leaves = jax.tree.leaves(trees)
    single = all(x.parameters.points.ndim == 2 for x in trees if isinstance(x, System))
    return single and not any(isinstance(x, Tracer) for x in leaves)


def extended(system: System) -> System:
    """Give a system its hidden vectors for dynamics; a system that needs none is returned itself."""
    if system.topology.extended is None:
        return system
    return _extend_on_host(system) if is_concrete(system) else _extend(system, system.parameters)


@by_identity
def _extend_on_host(system: System) -> System:
    with np.errstate(all="ignore"):
        return _extend(system, system.parameters.in_numpy())


def _extend(system: System, par: Parameters) -> System:
    top = system.topology
    assert top.extended is not None
    across = across_vectors(top, par.points, design_numbers(top, par, 1)[design(top).vectors])
    given: Any = par.vectors
    host = isinstance(given, np.ndarray)
    vectors = on_device(np.concatenate([given, across])) if host else jnp.concatenate([given, across])
    return System(top.extended, dataclasses.replace(system.parameters, vectors=vectors), system.degrees_of_freedom)


def look_around(system: System) -> System:
    """Note in a system what is special about the extended one of its design."""
    inner = extended(system)
    top = inner.topology
    if top is system.topology or top.large:
        return system
    eq, found = derive(inner), []
    weight = np.where(pure_numbers(top), float(eq.length), 1.0)
    for sample in sample_poses(system):
        found.append(np.asarray(evaluate(eq, lift(system.topology, np.asarray(sample.q)))[1]) / weight)
    found.sort(key=lambda j: rank_of(j[:, top.unknown])[0])
    special = with_special(top, found, rank_of(found[-1][:, top.unknown])[0])
    return dataclasses.replace(system, topology=dataclasses.replace(system.topology, extended=special))


# -- vectors across two segments --------------------------------------------------------------------------------------


@functools.cache
def _normal_formula(order: int) -> Formula:
    """Read the unit vector across two segments, given as six numbers; or a time derivative, from their rates too."""
    if order:
        return _normal_formula(0).rate(6, order)
    return reading(lambda x: unit(jnp.cross(x[:3], x[3:])), (), ((6,),))[0]


def _spans(top: Topology, points: Numbers, vectors: Numbers) -> list[tuple[Numbers, Numbers]]:
    """Return the two segments that each hidden vector is across."""
    assert top.extended is not None
    frames = {f"{b.name} across": b.segments for b in top.bodies}
    pairs = (frames[name][:2] for name in top.extended.loads.hidden)
    return [(span(first, points, vectors), span(second, points, vectors)) for first, second in pairs]


def across_vectors(top: Topology, points: Numbers, vectors: Numbers) -> Numbers:
    """Return the hidden vectors in the order of the extended topology, ``(hidden, 3)``: NumPy's of NumPy arrays.

    NumPy's points and vectors may carry changes along a last axis; then the hidden vectors do too.
    """
    pairs = _spans(top, points, vectors)
    if not isinstance(points, np.ndarray):
        return jnp.stack([unit(jnp.cross(a, b)) for a, b in pairs])
    lanes = np.stack([np.concatenate(pair) for pair in pairs], axis=1)
    run = _normal_formula(0).reading(points, points.ndim == 3)
    return np.stack(run(list(lanes)), axis=1).astype(points.dtype)


# -- coordinates ------------------------------------------------------------------------------------------------------


@with_owner
def shown_places(top: Topology) -> np.ndarray:
    """Return where the coordinates of a topology are among those of its extended one."""
    if top.extended is None:
        return np.arange(len(top.coordinates), dtype=INDEX)
    return np.array([top.extended.position[name] for name in top.coordinates], INDEX)


def lower(top: Topology, x: Array) -> Array:
    """Drop the hidden vectors' part of coordinates, rates or forces ``(..., extended)``."""
    return x if top.extended is None else x[..., shown_places(top)]


def lift(top: Topology, q: Any) -> Any:
    """Give a pose ``(N,)`` its hidden vectors: in NumPy, if it is NumPy's.

    NumPy's coordinates ``(N, 1 + changes)`` may carry changes.
    """
    if top.extended is None:
        return q
    split, tail = (len(top.points) + len(top.vectors)) * top.dim, q.shape[1:]
    points, vectors = spread(top, q.T)
    if tail:
        points, vectors = (np.moveaxis(np.asarray(x), 0, -1) for x in (points, vectors))
    xp: Any = np if isinstance(q, np.ndarray) else jnp
    return xp.concatenate([q[:split], across_vectors(top, points, vectors).reshape(-1, *tail), q[split:]])


def lift_rates(top: Topology, q: Numbers, v: Numbers) -> AnyArray:
    """Give rates ``(N,)`` those of the hidden vectors."""
    return v if top.extended is None else lift_states(top, q[None], v[None])[1][0]


def lift_states(top: Topology, *states: AnyArray) -> tuple[AnyArray, ...]:
    """Give poses, rates and (if given) accelerations ``(P, N)`` those of the hidden vectors: in NumPy, if they are."""
    if top.extended is None:
        return states
    host = all(isinstance(x, np.ndarray) for x in states)
    xp: Any = np if host else jnp
    split, lanes, out = (len(top.points) + len(top.vectors)) * top.dim, [], []
    for order, x in enumerate(states):
        pairs = _spans(top, *(xp.moveaxis(xp.asarray(part), 0, -1) for part in spread(top, x)))
        lanes += list(xp.stack([xp.concatenate(pair) for pair in pairs], axis=1))
        formula = _normal_formula(order)
        hidden = xp.stack((formula.on_lanes if host else formula.traced)(lanes), axis=1)
        out.append(xp.concatenate([x[:, :split], hidden.reshape(-1, len(x)).T, x[:, split:]], axis=1))
    return tuple(out)
