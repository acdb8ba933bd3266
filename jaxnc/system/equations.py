"""Residual and Jacobian of a system on all of its coordinates, ground included.

Constants of the constraints are functions of the parameters. Quadratic kinds are turned into coefficients once per
parameter set, so that their Jacobian is affine in the coordinates; other kinds are differentiated where they stand.
The residual itself is always evaluated by the kinds, in differences of coordinates: the expanded polynomial would
cancel far from the origin.
"""

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.compiling import jit, on_device, refuse_fork
from jaxnc.constraints import Kind
from jaxnc.errors import InputError, nearest
from jaxnc.internals import evaluate_at_once, values_behind
from jaxnc.reading import Builder, partials
from jaxnc.records import record, static
from jaxnc.system.design import GEOMETRY, carry_design, design, design_numbers, find_traced, with_unit_changes
from jaxnc.system.precision import numbers
from jaxnc.system.structure import Formula, operands, pattern, program, quadratic, size
from jaxnc.system.system import Parameters, System, characteristic_length
from jaxnc.system.topology import Block, BlockLayout, Topology
from jaxnc.types import AnyArray, Array, Coordinates, Float, Inputs, Numbers
from jaxnc.validate import as_scalars, as_shape, call_user


@record
class Equations:
    """The constraint equations of one design: everything that does not depend on the pose.

    Attributes:
        topology: the static part, a structure without names.
        home: all coordinates as drawn (angles and distances measured), ``(N,)``. Not assembled.
        length: characteristic length of the drawing.
        constants: per block, ``(instances, constants)``.
        scales: per block, factor that turns a row into a length, ``(instances, rows)``.
        linear: per block, Jacobian of the quadratic rows at the origin, ``(instances, rows, variables)``, or None.
        quadratic: per block, their second derivatives ``(instances, rows, variables, variables)``, or None.
        markers: per marker, its coefficients on its body's segments, ``(markers, dim)``.
        misfit: how far the drawing has left the class that its kinds were chosen for (points in line, segments in one
            plane), relative; zero where it fits.
        rounded: as of `Parameters`.
    """

    topology: Topology = static()
    home: Coordinates
    length: Array
    constants: tuple[Array, ...]
    scales: tuple[Array, ...]
    linear: tuple[Array | None, ...]
    quadratic: tuple[Array | None, ...]
    markers: Array
    misfit: Array
    rounded: bool = static(default=False)


def equations(system: System, differentiate_scales: bool = False) -> Equations:
    """Derive the constants and coefficients of a system's constraints from its parameters: NumPy's of NumPy arrays.

    What is solved does not depend on the scales of its rows: they are differentiated only where rows are looked at off
    the solution.
    """
    refuse_fork()
    top, par = system.topology.structure, system.parameters
    host = isinstance(par.points, np.ndarray)
    stop: Any = (lambda x: x) if host else jax.lax.stop_gradient
    still: Any = (lambda x: x) if differentiate_scales else stop
    found, x = design(top), design_numbers(top, par)
    length: AnyArray
    length = _bar_length(top, still(x[found.drawing])) if top.large else characteristic_length(still(par.points))
    length = np.asarray(length, x.dtype) if host else length
    constants = tuple(x[places] for places in found.constants)
    scales, scaled = [], []
    for block, layout, c in zip(top.blocks, top.layout, constants, strict=True):
        slopes = _coefficients(block, top.dim, c)
        scales.append(_scales(top, block, layout, still(slopes[0]), length, c))
        scaled.append([_times_rows(one, scales[-1]) for one in slopes])
    linear, second = (tuple(both[order] for both in scaled) for order in range(2))
    home, markers = x[found.home], x[found.markers]
    misfit = stop((np if host else jnp).nanmax(x[found.misfit]))
    return Equations(top, home, length, constants, tuple(scales), linear, second, markers, misfit, par.rounded)


def renumbered(eq: Equations, constants: Sequence[Numbers], scales: Sequence[Numbers]) -> Equations:
    """Give equations other constants and scales of their rows, per block ``(instances, …)``.

    NumPy's constants may carry changes along a last axis; then the coefficients do too.
    """
    top, blocks = eq.topology, zip(eq.topology.blocks, constants, scales, strict=True)
    found = [[_times_rows(x, scale) for x in _coefficients(block, top.dim, c)] for block, c, scale in blocks]
    linear, second = (tuple(x[order] for x in found) for order in range(2))
    return dataclasses.replace(eq, constants=tuple(constants), scales=tuple(scales), linear=linear, quadratic=second)


def _coefficients(block: Block, dim: int, constants: AnyArray) -> Sequence[AnyArray]:
    """First and second derivatives of a block's rows, see `row_coefficients`; none where it is not quadratic."""
    known = quadratic(block.kind, dim)
    return [row_coefficients(block, dim, constants, order) if known else None for order in (1, 2)]


def _times_rows(coefficients: AnyArray, scale: AnyArray) -> AnyArray:
    """Multiply coefficients ``(instances, rows, …)`` by the scales of the rows ``(instances, rows)``."""
    return None if coefficients is None else coefficients * scale[(..., *[None] * (coefficients.ndim - scale.ndim))]


def derived(system: System, differentiate_scales: bool = False) -> Equations:
    """Make `equations` on the host where the parameters are numbers, else compiled once for the structure."""
    with numbers(system.parameters.points):
        if any(isinstance(x, Tracer) for x in jax.tree.leaves(system)):
            known = None if differentiate_scales or system.topology.large else values_behind(system)
            if known is not None:
                return _attach_slopes(known, system.parameters)
            return _derive_compiled(system.topology.structure, system.parameters, differentiate_scales)
        with np.errstate(all="ignore"):
            return on_device(equations(System(system.topology, system.parameters.in_numpy())))


@functools.partial(jit, static_argnums=(0, 2))
def _derive_compiled(topology: Topology, parameters: Parameters, differentiate_scales: bool) -> Equations:
    return equations(System(topology, parameters), differentiate_scales)


def _attach_slopes(known: System, parameters: Parameters) -> Equations:
    """Derive the equations of a design that JAX differentiates once on the host, their derivatives as a matrix."""
    from jaxnc.autodiff import attach_matrix  # with all that derivatives need, and values do not

    with evaluate_at_once():
        eq = derived(known)
    changed, at = find_traced(parameters)
    if not len(at):
        return eq
    own = known.parameters.in_numpy()
    geometry = np.concatenate([np.ravel(getattr(own, name)) for name in GEOMETRY])
    with np.errstate(all="ignore"):
        drawn = carry_design(eq.topology, with_unit_changes(geometry, at), own.near)
        moved = renumbered(eq, drawn.constants, [np.asarray(x) for x in eq.scales])
    moves = drawn.home, drawn.constants, moved.linear, moved.quadratic, drawn.markers
    slopes = np.concatenate([x[..., 1:].reshape(-1, len(at)) for x in jax.tree.leaves(moves)])
    found = eq.home, eq.constants, eq.linear, eq.quadratic, eq.markers
    home, constants, linear, second, markers = attach_matrix(found, changed, slopes)
    return dataclasses.replace(eq, home=home, constants=constants, linear=linear, quadratic=second, markers=markers)


@functools.lru_cache(maxsize=1024)
def _at_origin(kind: Kind, dim: int, order: int) -> tuple[Formula, np.ndarray, np.ndarray]:
    """Derivatives of a quadratic kind's rows at the origin, as far as they are not the same of all instances.

    Returns:
        A function from the constants to those; all of one instance ``(rows, variables, …)``; and where they stand.
    """
    found, count = program(kind, "residual", dim), size(kind, dim)
    assert found is not None
    found, places = partials(found, range(count))
    if order == 2:
        found, pairs = partials(found, range(count))
        places = tuple((*places[k], v) for k, v in pairs)
    b = Builder(len(kind.constants))
    at = b.append(found, [b.number(0.0)] * count + b.first)
    same, open_ = np.zeros((len(kind.rows), *[count] * order)), {}
    for place, k in zip(places, found.outputs, strict=True):
        if b.known(at[k]) is None:
            open_[place] = at[k]
        else:
            same[place] = b.known(at[k])
    where = np.array([np.ravel_multi_index(place, same.shape) for place in open_], int)
    return Formula(b.program([*open_.values()])), same, where


def row_coefficients(block: Block, dim: int, constants: AnyArray, order: int) -> AnyArray:
    """First or second derivatives of a quadratic block's rows at the origin, ``(instances, rows, variables, …)``.

    Constants are ``(instances, constants)``. NumPy's may carry changes along a last axis; then the derivatives do too.
    """
    found, same, where = _at_origin(block.kind, dim, order)
    host, tail = isinstance(constants, np.ndarray), constants.shape[2:]
    wide: AnyArray = np.zeros((same.size, *tail))
    wide[..., *(0,) * len(tail)] = same.reshape(-1)
    xp: Any = np if host else jnp
    wide = xp.broadcast_to(xp.asarray(wide, constants.dtype), (block.count, *wide.shape))
    if len(where):
        place = np.arange(same.size)
        place[where] = same.size + np.arange(len(where))
        columns = found.reading(constants, bool(tail))([constants[:, k] for k in range(constants.shape[1])])
        columns = [xp.broadcast_to(xp.asarray(v, constants.dtype), (block.count, *tail)) for v in columns]
        wide = xp.concatenate([wide, xp.stack(columns, axis=1)], axis=1)[:, place]
    return wide.reshape(block.count, *same.shape, *tail)


def measured(top: Topology, constants: Sequence[Array], q: Coordinates) -> Float[Array, " scalars"]:
    """Angles and distances as the points and vectors of a pose have them."""
    scalars = jnp.zeros(len(top.scalars))
    for b in sorted({block for block, _ in top.measures}):
        at = [(k, i) for k, (block, i) in enumerate(top.measures) if block == b]
        which, instances = np.array([k for k, _ in at]), np.array([i for _, i in at])
        p, v, _ = operands(top.blocks[b].kind, top.dim, q[top.layout[b].variables[instances]])
        measure = top.blocks[b].kind.measure
        assert measure is not None
        scalars = scalars.at[which].set(jax.vmap(measure)(p, v, constants[b][instances]))
    return scalars


def _scales(
    top: Topology, block: Block, layout: BlockLayout, linear: Numbers | None, length: Numbers, constants: Numbers
) -> Numbers:
    """Factors that turn rows into lengths, ``(instances, rows)``."""
    xp: Any = np if isinstance(constants, np.ndarray) else jnp
    if not block.kind.rows:
        return xp.zeros((block.count, 0), constants.dtype)
    columns = []
    for r, power in enumerate(block.kind.powers):
        if power is not None:
            columns.append(xp.broadcast_to(length ** (1 - power), (block.count,)))
            continue
        assert linear is not None, "a row scaled by its own terms must belong to a quadratic kind"
        sizes = xp.where(pure_numbers(top)[layout.variables], 1.0, length)
        largest = xp.max(xp.abs(linear[:, r]) * sizes, axis=-1)
        columns.append(length / xp.where(largest > 0, largest, 1.0))
    return xp.stack(columns, axis=-1).astype(constants.dtype)


def _bar_length(top: Topology, drawing: Numbers) -> Numbers:
    """Median extent of the constraints that tie points together: what a large mechanism is measured by.

    A tolerance relative to the whole drawing would let every bar of a chain of thousands be wrong by thousands of
    times as much. It is 1 where no constraint ties two points at different places.
    """
    xp: Any = np if isinstance(drawing, np.ndarray) else jnp
    extents: list[AnyArray] = [np.zeros(0)]
    for layout in top.layout:
        if layout.drawn.shape[1] > 1:
            spread = drawing[layout.drawn[:, 1:]] - drawing[layout.drawn[:, :1]]
            square = xp.max(xp.sum(spread * spread, axis=2), axis=1)
            extents.append(xp.where(square > 0, xp.sqrt(xp.where(square > 0, square, 1.0)), 0.0))
    found = xp.concatenate(extents)
    if not found.shape[0]:
        return xp.ones(())
    middle = xp.median(found)
    return xp.where(middle > 0, middle, 1.0)


def _instance_rows(top: Topology, block: Block, x: Array, c: Array) -> Array:
    """Unscaled rows of one instance from its local variables."""
    p, v, s = operands(block.kind, top.dim, x)
    rows = block.kind.residual(p, v, s, c)
    return jnp.stack([jnp.asarray(r) for r in rows]) if len(rows) else jnp.zeros(0)


@public
def residual(system: System | Equations, q: Coordinates, inputs: Inputs | None = None) -> Float[Array, " rows"]:
    """All constraint rows, as lengths, at one pose.

    Args:
        system: the system, or its equations if they are at hand.
        q: all coordinates, in the order of ``system.topology.coordinates``, ``(N,)``.
        inputs: values that replace coordinates of q, by name.

    Returns:
        One number per row, in the order of ``system.topology.rows``; zero where the constraint is met. A row's scale
        follows the drawing, and is differentiated with it.
    """
    with numbers(_like(system)):
        return _residual(*_equations_at(system, q, inputs))


@jax.jit
def _residual(eq: Equations, q: Coordinates) -> Array:
    top, parts = eq.topology, []
    for b, block in enumerate(top.blocks):
        x = q[top.layout[b].variables]
        r = jax.vmap(lambda x, c, block=block: _instance_rows(top, block, x, c))(x, eq.constants[b])
        parts.append((r * eq.scales[b]).reshape(-1))
    return jnp.concatenate(parts) if parts else jnp.zeros(0)


def _like(system: System | Equations) -> Array:
    return system.length if isinstance(system, Equations) else system.parameters.points


def _equations_at(system: System | Equations, q: Coordinates, inputs: Inputs | None) -> tuple[Equations, Coordinates]:
    refuse_fork()
    if isinstance(system, Equations):
        if inputs:
            raise InputError("equations know no names: give inputs together with the system itself")
        return system, q
    top = system.topology
    q = jnp.asarray(as_shape(q, "the coordinates q", len(top.coordinates), dtype=system.dtype))
    for name, value in (inputs or {}).items():
        if name not in top.position:
            raise InputError(f"{top.name!r} has no coordinate {name!r}; {nearest(name, top.coordinates)}")
        q = q.at[top.position[name]].set(as_shape(value, f"input {name!r}"))
    return derived(system, differentiate_scales=True), q


@jax.jit
def entries(eq: Equations, q: Coordinates) -> Float[Array, " entries"]:
    """Derivatives of every row with respect to its own instance's variables, block after block."""
    top, parts = eq.topology, []
    for b, block in enumerate(top.blocks):
        x = q[top.layout[b].variables]
        g, h = eq.linear[b], eq.quadratic[b]
        if g is not None and h is not None:
            j = g + jnp.sum(h * x[:, None, None, :], axis=-1)
        else:
            local = jax.jacfwd(lambda x, c, block=block: _instance_rows(top, block, x, c))
            j = jax.vmap(local)(x, eq.constants[b]) * eq.scales[b][..., None]
        parts.append(j.reshape(-1))
    return jnp.concatenate(parts) if parts else jnp.zeros(0)


def places(top: Topology) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row and column of every number that `entries` returns, and whether it can differ from zero."""
    rows, columns, nonzero = [], [], []
    for block, layout in zip(top.blocks, top.layout, strict=True):
        shape = (*layout.rows.shape, layout.variables.shape[1])
        rows.append(np.broadcast_to(layout.rows[:, :, None], shape).reshape(-1))
        columns.append(np.broadcast_to(layout.variables[:, None, :], shape).reshape(-1))
        nonzero.append(np.broadcast_to(pattern(block.kind, top.dim), shape).reshape(-1))
    if not rows:
        return np.zeros(0, int), np.zeros(0, int), np.zeros(0, bool)
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(nonzero)


@public
def jacobian(system: System | Equations, q: Coordinates, inputs: Inputs | None = None) -> Float[Array, "rows N"]:
    """Dense Jacobian of all rows with respect to all coordinates; arguments as for `residual`."""
    with numbers(_like(system)):
        return _dense_jacobian(*_equations_at(system, q, inputs))


@jax.jit
def _dense_jacobian(eq: Equations, q: Coordinates) -> Array:
    r, c, _ = places(eq.topology)
    return jnp.zeros((len(eq.topology.rows), len(eq.topology.coordinates))).at[r, c].add(entries(eq, q))


@jax.jit
def guards(eq: Equations, q: Coordinates) -> tuple[Float[Array, " guards"], Float[Array, " bodies"]]:
    """Quantities of rows, and of whole bodies, that are positive unless a row is met by a mirror image."""
    top = eq.topology
    parts: dict[bool, list[Array]] = {False: [jnp.ones(1)], True: [jnp.ones(1)]}
    for b, block in enumerate(top.blocks):
        guard = block.kind.guard
        if guard is not None:

            def values(x, c, block=block, guard=guard):
                p, v, s = operands(block.kind, top.dim, x)
                return jnp.stack([jnp.asarray(g) for g in guard(p, v, s, c)])

            found = jax.vmap(values)(q[top.layout[b].variables], eq.constants[b])
            parts[block.kind.mirror].append(found.reshape(-1))
    return jnp.concatenate(parts[False]), jnp.concatenate(parts[True])


def weights(eq: Equations) -> Array:
    """Factors that turn coordinates into lengths: angles and unit vectors are multiplied by the mechanism's size.

    A curve of poses then has a length, and nothing that is solved or estimated depends on the unit.
    """
    return jnp.where(pure_numbers(eq.topology), eq.length, 1.0)


def pure_numbers(top: Topology) -> np.ndarray:
    """Which coordinates are no lengths: angles and components of unit vectors, ``(N,)``."""
    pure = np.zeros(len(top.coordinates), dtype=bool)
    pure[len(top.points) * top.dim :] = (*(True for _ in range(len(top.vectors) * top.dim)), *top.angles)
    return pure


# -- rows that are linear in velocities (nonholonomic constraints), on all coordinates ------------------------------


def refuse_rates(top: Topology, what: str, remedy: str) -> None:
    """Refuse a mechanism with rows on velocities where they have no meaning."""
    if top.rates:
        rows = "; ".join(dict.fromkeys(top.rate_rows))
        raise InputError(f"{what}: {top.name!r} has rows on velocities that positions do not see ({rows}); {remedy}")


def rate_constants(system: System) -> tuple[Array, ...]:
    """Constants of the rows on velocities, per block ``(instances, constants)``: NumPy's of NumPy parameters."""
    top = system.topology
    if not top.rates:
        return ()
    x = design_numbers(top, system.parameters)
    return tuple(x[places] for places in design(top).constants[len(top.blocks) :])


def slips(top: Topology, constants: tuple[Array, ...], q: Coordinates, v: Coordinates) -> Float[Array, " rates"]:
    """Residual of the rows on velocities, ``B q̇ - b``, m/s."""
    out = [jnp.zeros(0)]
    for block, layout, c in zip(top.rates, top.rate_layout, constants, strict=True):
        out.append(_velocity_rows(top, block, q[layout.variables], v[layout.variables], c).reshape(-1))
    return jnp.concatenate(out)


def coefficients(top: Topology, constants: tuple[Array, ...], q: Coordinates) -> Float[Array, "rates N"]:
    """Coefficients B of the rows on velocities, on all coordinates."""
    out = jnp.zeros((len(top.rate_rows), len(top.coordinates)))
    for block, layout, c in zip(top.rates, top.rate_layout, constants, strict=True):
        x = q[layout.variables]

        def row(y, dy, c, block=block):
            return _velocity_rows(top, block, y[None], dy[None], c[None])[0]

        local = jax.vmap(jax.jacfwd(row, argnums=1))(x, jnp.zeros_like(x), c)
        out = out.at[layout.rows[:, :, None], layout.variables[:, None, :]].add(local)
    return out


def _velocity_rows(top: Topology, block: Block, x: Array, dx: Array, c: Array) -> Array:
    """Rows of all instances of a block, ``(instances, rows)``."""
    kind: Any = block.kind
    what = f"kind {kind.name!r}: rate="

    def one(x, dx, c):
        parts = (*operands(kind, top.dim, x), *operands(kind, top.dim, dx))
        rows = call_user(kind.rate, what, "p, v, s, dp, dv, ds, c", *parts, c)
        found = as_scalars(rows, what, len(kind.rows))
        return jnp.stack([jnp.asarray(r, float) for r in found])

    return jax.vmap(one)(x, dx, c)
