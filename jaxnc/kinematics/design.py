"""The design of a system as one vector, what is read off its poses, and the derivatives of both by the design.

The poses are known, so that only the theorem of implicit functions is differentiated, in NumPy: numbers carry their
changes along. Readings of poses are pure functions that NumPy evaluates too. JAX differentiates what a user's own
function makes of the poses, and nothing else.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.autodiff import attach
from jaxnc.compiling import jit, on_device
from jaxnc.errors import InputError
from jaxnc.internals import evaluate_at_once
from jaxnc.kinematics.host_solve import rates_of_poses
from jaxnc.kinematics.instant import ScrewAxis, as_jax, body_of, screw_axis
from jaxnc.kinematics.motion import Motion, coordinates_of
from jaxnc.kinematics.traced import batch_rates
from jaxnc.solvers import host
from jaxnc.solvers.assembly import derive, free_plan, settle, to_host
from jaxnc.solvers.newton import attach_pose
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.design import GEOMETRY, carry_design, find_traced, with_unit_changes
from jaxnc.system.frames import along, marker_place, spins
from jaxnc.system.on_lanes import columns_on_lanes, needed_inputs, on_host, reading
from jaxnc.system.precision import limits
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import AnyArray, Array, ArrayLike, Numbers, PyTree
from jaxnc.validate import call_user, function_name

# -- the design as one vector -----------------------------------------------------------------------------------------


def geometry_vector(system: System) -> Numbers:
    """Put the geometry of a design into one vector: points, vectors, markers, dimensions.

    It is NumPy's, unless it is traced.
    """
    leaves = [getattr(system.parameters, name) for name in GEOMETRY]
    if any(isinstance(leaf, Tracer) for leaf in leaves):
        return jnp.concatenate([jnp.ravel(leaf) for leaf in leaves])
    return np.concatenate([np.ravel(leaf) for leaf in leaves])  # nothing to compile


def with_geometry(system: System, flat: np.ndarray | Array) -> System:
    """Make a system of the same topology with this geometry."""
    leaves = [getattr(system.parameters, name) for name in GEOMETRY]
    ends = np.cumsum([leaf.size for leaf in leaves])[:-1]
    known = not isinstance(flat, Tracer)
    split: Any = np.split(np.asarray(flat), ends) if known else jnp.split(flat, ends)
    parts = [part.reshape(leaf.shape) for part, leaf in zip(split, leaves, strict=True)]
    changed = dict(zip(GEOMETRY, on_device(parts) if known else parts, strict=True))
    parameters = dataclasses.replace(system.parameters, **changed)
    return dataclasses.replace(system, parameters=parameters)


def shift_geometry(system: System, at: np.ndarray | Array, changes: Array) -> System:
    """Add changes to the chosen components of a system's design."""
    flat = jnp.asarray(geometry_vector(system))
    return with_geometry(system, flat.at[at].add(changes.astype(flat.dtype)))


def samples_of(system: System) -> System:
    """Make a design whose samples measure their angles in the turns in which it has its own; see `Parameters.near`."""
    top = system.topology
    near = jax.lax.stop_gradient(derive(system).home[len(top.coordinates) - len(top.scalars) :])
    return dataclasses.replace(system, parameters=dataclasses.replace(system.parameters, near=near))


def without_needless_turns(system: System) -> System:
    """Make a design like all others again, of which no angle is in another turn than its drawing has it."""
    plain = dataclasses.replace(system, parameters=dataclasses.replace(system.parameters, near=None))
    return plain if np.allclose(derive(plain).home, derive(system).home, rtol=0.0, atol=1.0) else system


def geometry_components(system: System) -> list[tuple[str, str, str]]:
    """List variable, component and unit of each number of a design, in the order of `geometry_vector`."""
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


def attach_poses(motion: Motion, system: System, asked: Array) -> Motion:
    """Give a sequence of poses found already its derivatives by design and inputs ``(T, driven)``, where found."""
    motion = jax.lax.stop_gradient(motion)
    view = plan_of(motion, system)
    eq, known = derive(system), jnp.concatenate([asked, motion.q[:, view.known[len(view.driven) :]]], axis=1)
    q = jax.lax.map(lambda a: attach_pose(view, a[0], eq, a[1]), (motion.q, known))
    q = jnp.where((motion.status == 0)[:, None], q, motion.q)
    return dataclasses.replace(motion, system=system, poses=q, asked=asked)


def attach_slopes(motion: Motion, system: System, asked: Array, orders: tuple[Array, ...]) -> Motion:
    """Give poses that the host has found their derivatives by a design and by inputs, which JAX differentiates once.

    These are numbers: nothing is compiled but their product with a change. They have no derivatives themselves.
    `orders` are the time derivatives of the inputs.
    """
    changed, at = find_traced(system.parameters)
    inputs = len(motion.driven) if any(isinstance(x, Tracer) for x in (asked, *orders)) else 0
    with evaluate_at_once():
        view = plan_of(motion)
        derivatives = DesignDerivatives(view, motion, at, follows=True, inputs=inputs)
        slopes = derivatives.slopes()
        # The ground, and what is held, are where they are in poses that were not found, too.
        for places, change in ((view.fixed, derivatives.drawn.home[view.fixed, 1:]), (view.held, derivatives.held)):
            wide = change.T.reshape(derivatives.count, *[1] * motion.status.ndim, len(places))
            slopes[0][..., np.array(places, int)] = wide
    poses = np.asarray(motion.q), tuple(map(np.asarray, motion.rates))
    parts = [[x[: len(at)] for x in slopes] if len(at) else None, [x[len(at) :] for x in slopes] if inputs else None]
    poses, rates = attach(_change_by_slopes, None, poses, changed, asked, orders, *parts)
    return dataclasses.replace(motion, system=system, poses=poses, rates=rates, asked=asked)


def _change_by_slopes(_: None, value: PyTree, args: tuple, changes: tuple) -> PyTree:
    return _multiply_slopes(value, changes[:3], args[3:])


@jit
def _multiply_slopes(value: PyTree, changes: tuple, slopes: tuple) -> PyTree:
    (q, rates), (changed, asked, orders), (by_design, by_inputs) = value, changes, slopes
    found = [jnp.zeros_like(x) for x in (q, *rates)]
    if by_design is not None:
        flat = jnp.concatenate([jnp.ravel(x) for x in changed])
        found = [jnp.tensordot(flat, slope, 1) for slope in by_design]
    if by_inputs is not None:
        # A change e of the m-th derivative of the inputs is one of e tᵐ / m! in time, and moves the pose by its product
        # with the slopes, which change in time themselves; the n-th derivative of that is taken at t = 0.
        for n in range(len(found)):
            for m, change in enumerate((asked, *orders)[: n + 1]):
                found[n] += math.comb(n, m) * jnp.einsum("...k,k...n->...n", change, by_inputs[n - m])
    return found[0], tuple(found[1:])


# -- what is read off poses -------------------------------------------------------------------------------------------


class Pose(NamedTuple):
    """A pose, with what is read off it; like a `Motion`, but of equations that may be traced."""

    topology: Topology  # the mechanism's
    markers: Array  # coefficients of its markers
    q: Array  # all coordinates, (N,)
    rates: tuple[Array, ...] = ()  # their time derivatives

    def __getitem__(self, name: str) -> Array:
        return self._pick(name, ())

    def velocity(self, name: str) -> Array:
        """Velocity of a point, vector or marker, or rate of a coordinate."""
        return self._pick(name, self.rates)

    def _pick(self, name: str, rates: tuple[Array, ...]) -> Array:
        top, at = self.topology, coordinates_of(self.topology, name)
        if at is not None:
            return (rates[-1] if rates else self.q)[at]
        name, _, axis = name.partition(".")
        number = [m.name for m in top.markers].index(name)
        place = along(lambda q: marker_place(top, number, q, self.markers), self.q, rates)
        return place["xyz".index(axis)] if axis else place

    def angular_velocity(self, body: str) -> Array:
        """Angular velocity of a body in space."""
        return spins(self.topology, body_of(self.topology, body).segments, self.q, self.rates)

    def screw_axis(self, body: str) -> ScrewAxis:
        """Screw axis of a body's motion."""
        base = self.topology.points[body_of(self.topology, body).points[0]]
        return screw_axis(self[base], self.velocity(base), self.angular_velocity(body))


class PoseReading(NamedTuple):
    """Numbers that are read off each pose by one pure function, so that nothing is compiled for them.

    A function of a motion that has the attribute ``pose_reading``, a function of the motion and the same options that
    returns this record, is differentiated by NumPy in `jaxnc.sensitivity`.
    """

    # f(topology, *fixed, state, home, markers, *numbers) -> (...): `state` is the pose, then its derivatives by each of
    # the inputs; `home` are all coordinates as drawn, `markers` the coefficients of all markers.
    function: Callable[..., Array]
    fixed: tuple[Hashable, ...]  # all that decides what the function does
    inputs: tuple[str, ...] = ()
    numbers: tuple[AnyArray, ...] = ()  # of its own, which the design does not change
    # Names of what it returns, and how many numbers each has: 0 for a single one. None: one array.
    names: tuple[tuple[str, int], ...] | None = None
    labels: Mapping[str, str] = {}  # what else points and vectors of the mechanism are called

    def by_name(self, columns: Sequence[Numbers] | np.ndarray, stack: Callable) -> dict[str, AnyArray]:
        """Sort the numbers by name; `stack` puts those of one name into an array."""
        out, first = {}, 0
        for name, width in self.names or ():
            out[name] = stack(columns[first : first + width]) if width else columns[first]
            first += width or 1
        return out


def _pick_name(top: Topology, name: str, state: Array, home: Array, markers: Array) -> Array:
    return Pose(top, markers, state)[name]


def read_poses(motion: Motion, asked: PoseReading, by: str | None = None) -> dict[str, Array]:
    """Read numbers by name ``(...,)``, or several of one name ``(..., k)``, in all poses of a motion.

    With an input in `by` their derivatives by it are read instead, the other inputs held. NumPy reads them, unless
    something is traced; then nothing is calculated that they do not need.
    """
    hosted_poses = on_host(np.zeros(()), motion, asked.numbers)
    q: AnyArray = np.asarray(motion.q) if hosted_poses else motion.q
    top, width, count = motion.system.topology, q.shape[-1], 1 + len(asked.inputs)
    fixed = (top, *asked.fixed)
    shapes = ((count * width,), (width,), motion.system.parameters.markers.shape, *map(np.shape, asked.numbers))
    needs = np.zeros(sum(map(math.prod, shapes)), bool)
    needs[list(needed_inputs(asked.function, fixed, shapes))] = True
    moves = needs[width : count * width].any() or by is not None
    drawn = needs[count * width : sum(map(math.prod, shapes[:3]))].any()
    slopes = [tangents(motion, {name: 1.0})[0] if moves else 0.0 * q for name in asked.inputs]
    change = []
    if by is not None:
        first, second = tangents(motion, {by: 1.0}, 2)
        change = [first, *(_mixed_slopes(motion, by, second, name) for name in asked.inputs)]
    eq: Any = derive(motion.system) if drawn else None
    home, markers = (eq.home, eq.markers) if drawn else (np.zeros(shapes[1]), np.zeros(shapes[2]))
    given = (home, markers, *asked.numbers)
    columns = columns_on_lanes(asked.function, fixed, [q, *slopes], [change] if change else [], given)
    return asked.by_name(columns, functools.partial((np if hosted_poses else jnp).stack, axis=-1))


def _mixed_slopes(motion: Motion, by: str, second: np.ndarray, name: str) -> np.ndarray:
    """Second derivatives of all coordinates by two inputs, from those along the inputs and along their sum."""
    if name == by:
        return second
    return 0.5 * (tangents(motion, {by: 1.0, name: 1.0}, 2)[1] - second - tangents(motion, {name: 1.0}, 2)[1])


def plan_of(motion: Motion, system: System | None = None) -> Plan:
    """Make the plan that solves for the poses of a motion, or of the same motion of another design."""
    system = system or motion.system
    return plan(system.topology, motion.driven, motion.held, system.degrees_of_freedom)


def tangents(motion: Motion, paces: Mapping[str, float], order: int = 1) -> AnyArray:
    """Derivatives of all coordinates as inputs change at some paces, the others held; zero where a pose was not found.

    Returns:
        First to so many-th derivatives, ``(order, ..., N)``: NumPy's, unless something is traced.
    """
    view = plan_of(motion)
    q, good = motion.q.reshape(-1, motion.q.shape[-1]), motion.converged.reshape(-1)
    pace = np.array([paces.get(name, 0.0) for name in (*motion.driven, *motion.held)], q.dtype)
    orders = tuple(np.broadcast_to(x, (len(q), len(x))) for x in (pace, *[np.zeros_like(pace)] * (order - 1)))
    if not on_host(np.zeros(()), motion):
        return jnp.stack(batch_rates(view, derive(motion.system), q, orders, good)).reshape(order, *motion.q.shape)
    inner = host.view_of(view, to_host(derive(motion.system)))
    return np.stack(rates_of_poses(inner, np.asarray(q), orders, np.asarray(good))).reshape(order, *motion.q.shape)


# -- outputs ----------------------------------------------------------------------------------------------------------


def name_outputs(found: Any) -> dict[str, Array]:
    """Sort what a function returned into arrays by name."""
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
        inner = name_outputs(value) if isinstance(value, Mapping) or hasattr(value, "units") else {"": value}
        for sub, array in inner.items():
            if array is None:
                continue
            label = f"{name}.{sub}" if sub else str(name)
            try:
                array = jnp.asarray(as_jax(array))
            except (TypeError, ValueError, OverflowError):
                raise InputError(f"sensitivity: output {label!r} must be numbers, got {type(array).__name__}") from None
            if not jnp.issubdtype(array.dtype, jnp.floating):
                raise InputError(f"sensitivity: output {label!r} has no derivative, its numbers are {array.dtype}")
            out[label] = array
    return out


@dataclasses.dataclass(frozen=True)
class OutputSet:
    """Outputs that are asked of a motion, as one function of it; equal ones are compiled once."""

    # Names of points, markers and coordinates, or functions of a motion, by label. A function without a label stands
    # alone, and what it returns is what the outputs are.
    wanted: tuple[tuple[str, str | Callable[[Motion], ArrayLike]], ...]

    @staticmethod
    def of(what: str, given: "str | Callable | Sequence[str] | Mapping[str, str | Callable]") -> "OutputSet":
        """Sort out what a user asks for: a name, a function, or several; `what` is the caller, for messages."""
        if callable(given):
            return OutputSet((("", given),))
        given = [given] if isinstance(given, str) else given
        wanted = given if isinstance(given, Mapping) else {name: name for name in given}
        if not wanted:
            raise InputError(f"{what}: no outputs; name points or coordinates, or give a function of a motion")
        for name, output in wanted.items():
            if not (callable(output) or isinstance(output, str)):
                raise InputError(f"{what}: output {name!r} must be a name or a function of a motion, got {output!r}")
        return OutputSet(tuple(wanted.items()))

    def __call__(self, motion: Motion) -> Any:
        """Read the outputs off a motion: by label, or what the one function returns."""
        found = {label: self._call(label, output, motion) for label, output in self.wanted}
        return found.get("", found)

    @staticmethod
    def _call(label: str, output: str | Callable[[Motion], ArrayLike], motion: Motion) -> Array:
        if isinstance(output, str):
            return motion[output]
        what = f"output {label!r}" if label else "outputs="
        found = call_user(output, what, "motion", motion)
        if not jax.tree.leaves(found):
            raise InputError(
                f"{what}: {function_name(output)} must return an array, a mapping of arrays, or a record such as "
                f"suspension() makes; it returned {found!r}"
            )
        return found

    def readers(self) -> dict[str, Callable[[Motion], PoseReading]] | None:
        """Find by label how NumPy reads the outputs; None if one is a function that only JAX differentiates."""
        out: dict[str, Callable[[Motion], PoseReading]] = {}
        for label, output in self.wanted:
            if isinstance(output, str):
                out[label] = lambda motion, name=output: PoseReading(_pick_name, (name,))
                continue
            partial = isinstance(output, functools.partial) and not output.args
            read = getattr(output.func if partial else output, "pose_reading", None)
            if read is None:
                return None
            out[label] = functools.partial(read, **output.keywords) if partial else read
        return out


# -- derivatives ------------------------------------------------------------------------------------------------------


class DesignDerivatives:
    """The derivatives of solved poses by chosen components of the design.

    `at` are places of the components among those of `geometry_components`. What is held stays, or follows the drawing.
    So many `inputs`, the first or none, are variables behind them.
    """

    def __init__(self, view: Plan, motion: Motion, at: np.ndarray, follows: bool = False, inputs: int = 0):
        self.motion, self.at, self.count, self.inputs = motion, at, len(at) + inputs, inputs
        self.view = host.HostView(view, to_host(derive(motion.system)))
        flat = np.asarray(geometry_vector(motion.system))
        with np.errstate(all="ignore"):
            changes = np.pad(with_unit_changes(flat, at), ((0, 0), (0, inputs)))
            self.drawn = carry_design(motion.system.topology, changes, motion.system.parameters.near)
        poses = np.asarray(motion.q)
        self.good = np.flatnonzero(np.asarray(motion.converged).reshape(-1))
        self.q = poses.reshape(-1, poses.shape[-1])[self.good].T
        self.held = self._held_changes(view) if follows and view.held else np.zeros((len(view.held), self.count))

    def _held_changes(self, view: Plan) -> np.ndarray:
        """Changes of what is held, which has the values of the assembled drawing, ``(held, changes)``."""
        eq = derive(self.motion.system)
        drawing = np.asarray(settle(eq, np.zeros(len(self.q))).q, float)
        with np.errstate(all="ignore"):
            found = host.start_changes(free_plan(view.topology), to_host(eq), self.drawn, drawing)
        return np.zeros((len(view.held), self.count)) if found is None else found[list(view.held), 1:]

    def _chunks(self) -> Iterator[np.ndarray]:
        size = max(1, 8192 // (1 + self.count))  # 8192 numbers at a time: poses times changes
        for first in range(0, len(self.good), size):
            yield np.arange(first, min(first + size, len(self.good)))

    def assemblable(self) -> np.ndarray:
        """Find the variables whose change some motion of the unknowns takes up in every pose, ``(variables,)``.

        With r = Φ_p dp that is: r lies in the range of Φ_q.
        """
        exists = np.ones(self.count, bool)
        for lanes in self._chunks():
            size, rest = host.unabsorbed_changes(self.view, self.drawn, self.q[:, lanes])
            # 1e-6 of the largest change of the rows: below, there is nothing to take up
            least = 1e-6 * np.max(size, axis=1, initial=0.0, keepdims=True)
            # 1e-8 of a change of the rows that no motion takes up: above, the changed mechanism does not assemble
            exists &= (rest <= 1e-8 * np.maximum(size, least)).all(axis=0)
        return exists

    def of_readings(self, readings: Mapping[str, PoseReading]) -> dict[str, np.ndarray]:
        """Derivatives of what is read by label, ``(*poses, ..., variables)``; zero where a pose was not found."""
        out: dict[str, np.ndarray] = {}
        for label, asked in readings.items():
            found = self._of_reading(asked)
            if asked.names is None:
                out[label] = found
                continue
            columns = np.moveaxis(found.reshape(*self.motion.status.shape, -1, self.count), -2, 0)
            parts = asked.by_name(columns, functools.partial(np.stack, axis=-2))
            out |= {f"{label}.{name}" if label else name: x for name, x in parts.items()}
        return out

    def _of_reading(self, asked: PoseReading) -> np.ndarray:
        """Derivatives of a reading's function by the design, ``(*poses, *shape, variables)``."""
        own = np.zeros((len(asked.numbers), 1 + self.count))
        own[:, 0] = asked.numbers
        constants = self.drawn.home, self.drawn.markers, *own
        shapes = ((len(self.q) * (1 + len(asked.inputs)),), *(c.shape[:-1] for c in constants))
        fixed, lead = (self.motion.system.topology, *asked.fixed), self.motion.status.shape
        found, shape = reading(asked.function, fixed, shapes)
        size = int(np.prod(shape, dtype=int))
        slopes = [np.asarray(tangents(self.motion, {name: 1.0})[0]) for name in asked.inputs]
        slopes = [x.reshape(-1, len(self.q))[self.good].T for x in slopes]
        out = np.zeros((int(np.prod(lead, dtype=int)), size, self.count))
        given = [x[None] for c in constants for x in c.reshape(-1, 1 + self.count)]
        for lanes in self._chunks():
            q = self.q[:, lanes]
            parts = [host.changes(self.view, self.drawn, q)[0]]
            parts += [host.changes(self.view, self.drawn, q, (rate[:, lanes],))[1][0] for rate in slopes]
            for k, value in enumerate(found.carrying([*(x for part in parts for x in part), *given])):
                out[self.good[lanes], k] = value[..., 1:]
        return out.reshape(*lead, *shape, self.count)

    def of_function(self, output: Callable[[Motion], ArrayLike]) -> tuple[dict[str, Array], dict[str, Array]]:
        """Outputs and their Jacobian ``(..., variables)``, forward or in reverse, whichever has fewer passes.

        Compiled once for each `output` that is equal to another one.
        """
        try:
            hash(output)
        except TypeError:  # a callable object that cannot be compared is compiled each time
            output = functools.partial(output)
        shapes = jax.eval_shape(functools.partial(_outputs, output), self.motion)
        count = sum(int(np.prod(s.shape, dtype=int)) for s in jax.tree.leaves(shapes))
        given = self.motion, jnp.asarray(self.at), self.slopes()
        derivatives, values = _output_jacobian(output, count < self.count, *given)
        return values, derivatives

    def slopes(self) -> tuple[np.ndarray, ...]:
        """Changes of poses and of their rates, ``(variables, *poses, N)`` each; zero where they do not exist."""
        lead, width = self.motion.q.shape[:-1], len(self.q)
        rates = [np.asarray(x).reshape(-1, width)[self.good].T for x in self.motion.rates]
        driven = np.eye(len(self.motion.driven), self.count, self.count - self.inputs)
        known = np.concatenate([driven, self.held])
        out = [np.zeros((self.count, int(np.prod(lead, dtype=int)), width), self.q.dtype) for _ in (0, *rates)]
        for lanes in self._chunks():
            moved = [x[:, lanes] for x in rates]
            first, others = host.changes(self.view, self.drawn, self.q[:, lanes], moved, known)
            for whole, part in zip(out, (first, *others), strict=True):
                whole[:, self.good[lanes]] = np.where(np.isfinite(part), part, 0.0)[..., 1:].T
        if self.motion.conditioning is not None:
            singular = np.asarray(self.motion.conditioning).reshape(-1) <= limits(self.q).singular
            for whole in out:
                whole[:, singular] = 0.0
        return tuple(x.reshape(self.count, *lead, width) for x in out)


def _outputs(output: Callable[[Motion], ArrayLike], motion: Motion) -> dict[str, Array]:
    return name_outputs(output(motion))


@functools.partial(jit, static_argnums=(0, 1))
def _output_jacobian(
    output: Callable[[Motion], ArrayLike], back: bool, motion: Motion, at: Array, slopes: tuple[Array, ...]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Outputs of a changed design, with poses and rates that change with it: their Jacobian, and they themselves."""

    def outputs(changes: Array) -> tuple[dict[str, Array], dict[str, Array]]:
        given = zip((motion.q, *motion.rates), slopes, strict=True)
        q, *rates = (x + jnp.tensordot(changes, slope, 1) for x, slope in given)
        changed = shift_geometry(motion.system, at, changes)
        found = _outputs(output, dataclasses.replace(motion, system=changed, poses=q, rates=tuple(rates)))
        return found, found

    return (jax.jacrev if back else jax.jacfwd)(outputs, has_aux=True)(jnp.zeros(at.shape))
