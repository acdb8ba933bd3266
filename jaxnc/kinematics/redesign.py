"""The geometry of a design as one vector, and designs made of changed vectors."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.compiling import on_device
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.solvers.assembly import derive
from jaxnc.solvers.newton import attach_pose
from jaxnc.solvers.plan import plan
from jaxnc.system.system import Parameters, System
from jaxnc.types import Array


def flattened(system: System) -> Any:
    """The geometry of a design as one vector: points, vectors, markers, dimensions; NumPy's, unless it is traced."""
    par = system.parameters
    leaves = (par.points, par.vectors, par.markers, par.dimensions)
    if any(isinstance(leaf, Tracer) for leaf in leaves):
        return jnp.concatenate([jnp.ravel(leaf) for leaf in leaves])
    return np.concatenate([np.ravel(leaf) for leaf in leaves])  # nothing to compile


def rebuilt(system: System, flat: np.ndarray | Array) -> System:
    """A system of the same topology with this geometry."""
    par = system.parameters
    leaves = [par.points, par.vectors, par.markers, par.dimensions]
    ends = np.cumsum([leaf.size for leaf in leaves])[:-1]
    known = not isinstance(flat, Tracer)
    split: Any = np.split(np.asarray(flat), ends) if known else jnp.split(flat, ends)
    parts = [part.reshape(leaf.shape) for part, leaf in zip(split, leaves, strict=True)]
    points, vectors, markers, dimensions = on_device(parts) if known else parts
    parameters = Parameters(points, vectors, markers, dimensions, par.physical, par.own)
    return dataclasses.replace(system, parameters=parameters)


def redrawn(system: System, at: np.ndarray | Array, changes: Array) -> System:
    """The system with changes of the chosen components added to its design."""
    return rebuilt(system, jnp.asarray(flattened(system)).at[at].add(changes))


def attached(motion: Motion, system: System, asked: Array) -> Motion:
    """A sequence of poses found already, with derivatives by design and inputs ``(T, driven)`` where found."""
    motion = jax.lax.stop_gradient(motion)
    view = plan(system.topology, motion.driven, motion.held, system.degrees_of_freedom)
    eq, known = derive(system), jnp.concatenate([asked, motion.q[:, view.known[len(view.driven) :]]], axis=1)
    q = jax.lax.map(lambda a: attach_pose(view, a[0], eq, a[1]), (motion.q, known))
    q = jnp.where((motion.status == 0)[:, None], q, motion.q)
    return dataclasses.replace(motion, system=system, poses=q, asked=asked)


def components(system: System) -> list[tuple[str, str, str]]:
    """Of the numbers of a design's geometry, in the order of `flattened`: variable, component, unit."""
    top = system.topology
    markers = {m.name: m for m in top.markers}
    names = []
    for points, unit in ((top.points, top.length_unit), (top.vectors, "rad"), (markers, "")):
        for name in points:
            directed = name in markers and markers[name].direction
            for axis in "xyz"[: top.dim]:
                names.append((name, f"{name}.{axis}", "rad" if directed else unit or top.length_unit))
    for name, dimension in zip(top.dimensions, top.given, strict=True):
        names.append((name, name, top.length_unit if dimension.quantity.long else ""))
    return names


def parts_of(found: Any) -> dict[str, Array]:
    """What a function returned, as arrays by name."""
    if isinstance(found, Mapping):
        parts = dict(found)
    elif hasattr(found, "units") and hasattr(found, "converged"):
        parts = {name: getattr(found, name) for name in found.units}
    elif hasattr(found, "_asdict"):
        parts = found._asdict()
    else:
        parts = {"output": found}
    out = {}
    for name, value in parts.items():
        inner = parts_of(value) if isinstance(value, Mapping) or hasattr(value, "units") else {"": value}
        for sub, array in inner.items():
            if array is None:
                continue
            label = f"{name}.{sub}" if sub else str(name)
            try:
                array = jnp.asarray(array)
            except (TypeError, ValueError, OverflowError):
                raise InputError(f"sensitivity: output {label!r} must be numbers, got {type(array).__name__}") from None
            if not jnp.issubdtype(array.dtype, jnp.floating):
                raise InputError(f"sensitivity: output {label!r} has no derivative, its numbers are {array.dtype}")
            out[label] = array
    return out
