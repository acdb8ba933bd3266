"""What a change of the design does to poses that are already solved: derivatives, and whether there are any."""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.compiling import jit, on_device
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.rates import rates as rates_of
from jaxnc.solvers import dense
from jaxnc.solvers.assembly import derive
from jaxnc.solvers.newton import attach, regular
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.system import Parameters, System
from jaxnc.types import Array

FITS = 1e-8  # part of a change of the rows that no motion takes up: above, the changed mechanism does not assemble
SMALL = 1e-6  # of the largest change of the rows: below, there is nothing to take up


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
    q = jax.lax.map(lambda a: attach(view, a[0], eq, a[1]), (motion.q, known))
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


def differentiate(view: Plan, output: Callable[[Motion], Any], motion: Motion, at: np.ndarray):
    """Outputs and their Jacobian ``(..., variables)``, forward or in reverse, whichever has fewer passes.

    Compiled once for each `output` that is equal to another one.
    """
    try:
        hash(output)
    except TypeError:  # a callable object that cannot be compared is compiled each time
        output = functools.partial(output)
    shapes = jax.eval_shape(functools.partial(_outputs, view, output), motion, jnp.asarray(at), jnp.zeros(len(at)))
    count = sum(int(np.prod(s.shape, dtype=int)) for s in jax.tree.leaves(shapes))
    derivatives, values = _jacobian(view, output, count < len(at), motion, jnp.asarray(at))
    return values, derivatives


@functools.partial(jit, static_argnums=(0, 1, 2))
def _jacobian(view: Plan, output: Callable[[Motion], Any], back: bool, motion: Motion, at: Array):
    def outputs(changes):
        found = _outputs(view, output, motion, at, changes)
        return found, found

    return (jax.jacrev if back else jax.jacfwd)(outputs, has_aux=True)(jnp.zeros(at.shape))


def _outputs(
    view: Plan, output: Callable[[Motion], Any], motion: Motion, at: Array, changes: Array
) -> dict[str, Array]:
    """Outputs of a changed design."""
    flat, ok = motion.q.reshape(-1, motion.q.shape[-1]), motion.converged.reshape(-1)
    changed = redrawn(motion.system, at, changes)
    eq = derive(changed)
    # The poses are known: only the theorem of implicit functions is differentiated, not the way they were found.
    q = jax.vmap(lambda x: attach(view, x, eq, x[view.known]))(jax.lax.stop_gradient(flat))
    q = jnp.where(ok[:, None], q, flat)
    rates = ()
    if motion.rates:
        orders = tuple(r.reshape(flat.shape)[:, view.known] for r in motion.rates)
        rates = jax.vmap(lambda x, o, good: tuple(rates_of(view, eq, x, o, good)))(q, orders, ok)
    rates = tuple(r.reshape(motion.q.shape) for r in rates)
    return parts_of(output(dataclasses.replace(motion, system=changed, poses=q.reshape(motion.q.shape), rates=rates)))


@functools.partial(jit, static_argnums=0)
def assemblable(view: Plan, system: System, at: Array, q: Array, ok: Array) -> Array:
    """Whether some motion of the unknowns takes up a change of each variable, in every pose, ``(variables,)``.

    With r = Φ_p dp that is: r lies in the range of Φ_q.
    """
    eq = derive(system)

    def rows(changes: Array, q: Array) -> Array:
        changed = derive(redrawn(system, at, changes))
        return view.residual(changed, view.join(q[view.unknown], q[view.known], changed.home[view.fixed]))

    def one(q, ok):
        x = regular(eq, q, ok)
        change = jax.jacfwd(rows)(jnp.zeros(at.shape), x)
        basis = dense.orthonormal(view.linearise(eq, x)[1])[0]
        rest = change - basis @ (basis.T @ change)
        size = jnp.linalg.norm(change, axis=0)
        least = SMALL * jnp.max(size, initial=0.0)
        return ~ok | (jnp.linalg.norm(rest, axis=0) <= FITS * jnp.maximum(size, least))

    return jnp.all(jax.vmap(one)(q, ok), axis=0)


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
