"""Hidden vectors: what bodies without a full base get for their dynamics, and only for it.

A spatial body of three points, or of two points and a vector, knows its orientation by two segments, but a place on it
is affine in its coordinates only with a third one. Dynamics then works on the same mechanism with a unit vector across
the two; its kinematic counts, rows and coordinates stay as they are, and results come back in them.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.compiling import on_device
from jaxnc.constraints.directions import unit
from jaxnc.records import record
from jaxnc.remembered import by_identity, with_owner
from jaxnc.system.design import design, design_numbers
from jaxnc.system.equations import pure_numbers
from jaxnc.system.frames import spread
from jaxnc.system.system import Parameters, System
from jaxnc.system.topology import Topology
from jaxnc.types import Array


def known(*trees: Any) -> bool:
    """Whether all numbers are known (not traced), so that NumPy can calculate with them; of one design."""
    leaves = jax.tree.leaves(trees)
    single = all(x.parameters.points.ndim == 2 for x in trees if isinstance(x, System))
    return single and not any(isinstance(x, Tracer) for x in leaves)


def extended(system: System) -> System:
    """The system that dynamics works on: with hidden vectors, or the same one if it needs none."""
    if system.topology.extended is None:
        return system
    return _on_host(system) if known(system) else _extended(system, system.parameters)


@by_identity
def _on_host(system: System) -> System:
    with np.errstate(all="ignore"):
        return _extended(system, system.parameters.in_numpy())


def _extended(system: System, par: Parameters) -> System:
    top = system.topology
    assert top.extended is not None
    across = _across(top, par.points, design_numbers(top, par, 1)[design(top).vectors])
    given: Any = par.vectors
    host = isinstance(given, np.ndarray)
    vectors = on_device(np.concatenate([given, across])) if host else jnp.concatenate([given, across])
    return System(top.extended, dataclasses.replace(system.parameters, vectors=vectors), system.degrees_of_freedom)


def look_around(system: System) -> System:
    """The system, knowing what is special about the extended one of its design."""
    from jaxnc.solvers.assembly import derive, evaluate, rank_of, sample_poses
    from jaxnc.solvers.elimination import with_special

    inner = extended(system)
    top = inner.topology
    if top is system.topology or top.large:
        return system
    eq, found = derive(inner), []
    weight = np.where(pure_numbers(top), float(eq.length), 1.0)
    for sample in sample_poses(system):
        found.append(np.asarray(evaluate(eq, lift(system.topology, np.asarray(sample.q)))[1]) / weight)
    found.sort(key=lambda j: rank_of(j[:, top.unknown])[0])
    known = with_special(top, found, rank_of(found[-1][:, top.unknown])[0])
    return dataclasses.replace(system, topology=dataclasses.replace(system.topology, extended=known))


def _across(top: Topology, points: Any, vectors: Any) -> Any:
    """The hidden vectors, unit, in the order of the extended topology ``(hidden, 3)``: NumPy's of NumPy arrays."""
    if isinstance(points, np.ndarray):
        found = [np.cross(a, b) for a, b in spans(top, points, vectors)]
        return np.array([a / np.linalg.norm(a) for a in found], points.dtype)
    return jnp.stack([unit(jnp.cross(a, b)) for a, b in spans(top, points, vectors)])


def spans(top: Topology, points: Any, vectors: Any) -> list[tuple[Any, Any]]:
    """The two segments that each hidden vector is across."""
    assert top.extended is not None
    frames = {f"{b.name} across": b.segments for b in top.bodies}

    def span(segment):
        return vectors[~segment[0]] if len(segment) == 1 else points[segment[1]] - points[segment[0]]

    return [tuple(map(span, frames[name][:2])) for name in top.extended.loads.hidden]  # pyright: ignore


@with_owner
def shown(top: Topology) -> np.ndarray:
    """Where the coordinates of a topology are among those of its extended one."""
    if top.extended is None:
        return np.arange(len(top.coordinates))
    return np.array([top.extended.position[name] for name in top.coordinates])


def lift(top: Topology, q: Any) -> Any:
    """A pose ``(N,)`` with its hidden vectors: NumPy's, if it is."""
    if top.extended is None:
        return q
    points, vectors = spread(top, q)
    split = (len(top.points) + len(top.vectors)) * top.dim
    xp: Any = np if isinstance(q, np.ndarray) else jnp
    return xp.concatenate([q[:split], _across(top, points, vectors).reshape(-1), q[split:]])


def lift_rates(top: Topology, q: Array, v: Array) -> Array:
    """Rates ``(N,)`` with those of the hidden vectors."""
    return v if top.extended is None else jax.jvp(lambda x: lift(top, x), (q,), (v,))[1]


def lifted(top: Topology, q: Any, v: Any, a: Any = None) -> tuple[Any, ...]:
    """Poses, rates and (if given) accelerations ``(poses, N)`` with those of the hidden vectors, on the host."""
    given = (q, v) if a is None else (q, v, a)
    if top.extended is None:
        return given
    parts = [[np.moveaxis(np.asarray(x), 0, -1) for x in spread(top, state)] for state in given]
    split, out = (len(top.points) + len(top.vectors)) * top.dim, [[] for _ in given]
    for both in zip(*(spans(top, *x) for x in parts), strict=True):
        (a0, b0), (a1, b1) = both[:2]
        c, dc = np.cross(a0, b0, axis=0), np.cross(a1, b0, axis=0) + np.cross(a0, b1, axis=0)
        size = np.linalg.norm(c, axis=0)
        n = c / size
        grows = np.sum(n * dc, axis=0)
        dn = (dc - n * grows) / size
        out[0].append(n)
        out[1].append(dn)
        if a is not None:
            a2, b2 = both[2]
            ddc = np.cross(a2, b0, axis=0) + 2 * np.cross(a1, b1, axis=0) + np.cross(a0, b2, axis=0)
            out[2].append((ddc - n * np.sum(dn * dc + n * ddc, axis=0) - 2 * dn * grows) / size)
    return tuple(
        np.concatenate([x[:, :split], np.concatenate(y).T, x[:, split:]], axis=1)
        for x, y in zip(given, out, strict=True)
    )


def lower(top: Topology, x: Array) -> Array:
    """What is shown of coordinates, rates or forces ``(..., extended)``."""
    return x if top.extended is None else x[..., shown(top)]


@record
class Pair:
    """A system and the one that its dynamics works on."""

    system: System
    inner: System

    @classmethod
    def of(cls, system: System) -> "Pair":
        """Both, for a compiled system."""
        return cls(system, extended(system))
