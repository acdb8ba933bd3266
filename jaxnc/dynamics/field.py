"""The motion of a mechanism as a vector field: state, time and arguments to rates, for integrators of others."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import filter_jit, on_device
from jaxnc.dynamics.extended import extended, is_concrete, lift, lift_rates, lower
from jaxnc.dynamics.flow import ACCELERATION, POSITION, VELOCITY, Flow
from jaxnc.dynamics.integrate import History
from jaxnc.dynamics.model import State, check_loads, dynamics
from jaxnc.dynamics.runs import Start, summarise
from jaxnc.dynamics.simulate import read_drives
from jaxnc.dynamics.simulation import Simulation
from jaxnc.dynamics.start import Rates, begin_pose, check_begin, check_start, start_rates
from jaxnc.dynamics.steps import MotionState
from jaxnc.errors import InputError, brief, nearest
from jaxnc.kinematics.inputs import positive, worst_rows
from jaxnc.kinematics.motion import Motion
from jaxnc.records import record, static
from jaxnc.solvers.newton import largest
from jaxnc.system.equations import weights
from jaxnc.system.precision import as_its_system
from jaxnc.system.system import System
from jaxnc.types import Array, ArrayLike, Inputs, PyTree
from jaxnc.validate import as_shape

_APART = 1e-3  # of the mechanism's size, and of its largest speed: a state that is farther off is none of it

Phase = tuple[Array, Array]
"""A state: all coordinates ``(N,)``, in the order of ``system.topology.coordinates``, and their rates ``(N,)``."""


@public
@record
class VectorField:
    """The motion of a mechanism under its forces as a function ``f(t, y, args)``; a pytree.

    The state ``y`` is a pair ``(q, v)`` of all coordinates ``(N,)``, ground included, in the order of
    ``system.topology.coordinates``, and their rates ``(N,)``; lengths, radians and seconds. `start` makes one.

    The equations of motion are of index one: accelerations and multipliers follow from one linear system. The field is
    stabilised: what a state is off the constraints by dies away with ``exp(-stabilise t)``, positions along the
    shortest way by the masses, rates by the least change of kinetic energy. On the constraints that changes nothing.

    A field is made of a design once. Derivatives by the design are those by the system that it is made of, inside of
    what is differentiated, or by a system in `args`.

    """

    # Arrays alone, of system, rate and flow: diffrax's BacksolveAdjoint takes no tree with an empty tuple in it.
    _arrays: tuple[Array, ...]
    _structure: Any = static()

    @classmethod
    def of(cls, system: System, stabilise: ArrayLike, flow: Flow) -> "VectorField":
        """Put a field together from a system, how fast states return to the constraints (1/s), and its flow."""
        arrays, structure = jax.tree.flatten((system, stabilise, flow))
        return cls(tuple(arrays), structure)

    @property
    def system(self) -> System:
        """The system."""
        return jax.tree.unflatten(self._structure, self._arrays)[0]

    @property
    def stabilise(self) -> Array:
        """How fast a state returns to the constraints, 1/s."""
        return jax.tree.unflatten(self._structure, self._arrays)[1]

    @property
    def _flow(self) -> Flow:
        return jax.tree.unflatten(self._structure, self._arrays)[2]

    @as_its_system
    def __call__(self, t: ArrayLike, y: Phase, args: System | None = None) -> Phase:
        """Give the rates of a state.

        Args:
            t: the time, s.
            y: the state ``(q, v)``, each ``(N,)``.
            args: a system of the same topology to take in place of the field's own, such as a design that an adjoint
                is to differentiate by; its equations are then put together in every call. Anything else is left to the
                user's other terms and events.

        Returns:
            The rates ``(q̇, q̈)``, each ``(N,)``.

        Raises:
            InputError: a state of another form; one that does not meet the constraints, outside of traced code. In
                traced code, as within an integrator, nothing is checked: the state is drawn to the constraints, and
                `motion` marks it.
        """
        field = self._of(args) if isinstance(args, System) else self
        q, v = field._pair(y)
        field._refuse(t, q, v)
        return _rates(field, jnp.asarray(t, float), q, v)

    @as_its_system
    def start(
        self,
        state: Motion | Inputs | None = None,
        rates: Mapping[str, Any] | None = None,
        t: ArrayLike = 0.0,
        unit: str | None = None,
    ) -> Phase:
        """Make a state that meets the constraints, as `jaxnc.simulate` begins with.

        Args:
            state: a pose (with its rates, if it carries any); values of as many coordinates as there are freedoms;
                places to start near to. The assembled drawing if not given.
            rates: rates by name, of coordinates, points or vectors; at rest if not given.
            t: the time at which the inputs are taken, s.
            unit: what angles of `state` and `rates` are given in, ``"rad"`` or ``"deg"``.

        Returns:
            The state ``(q, v)``, each ``(N,)``. Differentiable.

        Raises:
            InputError: unknown names, numbers that are not finite, a motion that has no inertia.
            AssemblyError: the start does not assemble.
        """
        system, flow = self.system, self._flow
        given, wanted = check_start(system, state, rates, unit)
        values = flow.drive_values(jnp.asarray(t, float))[0]
        q = begin_pose(system, given, {name: value for (name, _), value in zip(flow.drives, values, strict=True)})
        if is_concrete(system, q, t, flow.drive_args):
            check_begin(flow, lift(system.topology, np.asarray(q)))
        return _consistent(system, flow, jnp.asarray(t, float), jnp.asarray(q), wanted)

    def state(self, t: ArrayLike, y: Phase) -> State:
        """Look at a state by name: ``state["C"]``, ``state.velocity("phi")``, for events, outputs and controls."""
        return State(self.system.topology, t, *self._pair(y))

    @as_its_system
    def response(self, t: ArrayLike, y: Phase, efforts: Mapping[str, ArrayLike]) -> Phase:
        """Give the rates that efforts add to those of the field: what noise and controls multiply.

        Args:
            t: the time, s.
            y: the state ``(q, v)``, each ``(N,)``.
            efforts: by name, a torque or force on each coordinate (N m on angles, N), or a force ``(dim,)`` at a point.

        Returns:
            The rates ``(0, q̈)``, each ``(N,)``, linear in the efforts. They meet the constraints. Friction that the
            efforts cause is left out.

        Raises:
            InputError: an unknown name, or numbers of another shape.
        """
        q, v = self._pair(y)
        top, flow, t = self.system.topology, self._flow, jnp.asarray(t, float)
        x, w = flow.impose(t, lift(top, q), lift_rates(top, q, v))
        still = jnp.zeros_like(x)
        push, inner = still, flow.dyn.topology
        for name, value in efforts.items():
            if name in top.points:
                at = top.points.index(name) * top.dim + np.arange(top.dim)
            elif name in top.position:
                at = inner.position[name]
            else:
                hint = nearest(name, (*top.scalars, *top.points))
                raise InputError(f"efforts: {top.name!r} has no point or coordinate {name!r}; {hint}")
            push = push.at[at].add(jnp.asarray(as_shape(value, f"effort on {name!r}", *np.shape(at))))
        _, added = jax.jvp(lambda extra: flow.accelerate(t, x, w, extra)[0], (still,), (push,))
        return jnp.zeros_like(q), lower(top, added)

    @as_its_system
    def motion(self, t: ArrayLike, y: Phase) -> Simulation:
        """Make a motion of states: by name, to be plotted, drawn, saved, with its energy and its reactions.

        Args:
            t: times, ``(T,)``, s.
            y: the states at these times, each ``(T, N)``, such as the ``ys`` of diffrax.

        Returns:
            The motion, with velocities, accelerations and multipliers. From a state on that is not finite, or is off
            its constraints by a thousandth of the mechanism's size, the status is `Status.CAME_APART`.

        Raises:
            InputError: states of another form.
        """
        t = jnp.asarray(as_shape(t, "times t", None))
        q, v = self._pair(y, len(t))
        return _motion(self, t, q, v)

    def _of(self, system: System) -> "VectorField":
        if system.topology != self.system.topology:
            raise InputError(
                f"args is a system of another topology, {system.name!r}, and the vector field is that of "
                f"{self.system.name!r}: change its numbers by replace(), or make another vector field"
            )
        flow = Flow.of(dynamics(extended(system)), system.degrees_of_freedom, self._flow.drives)
        flow = dataclasses.replace(flow, redundant=self._flow.redundant, drive_args=self._flow.drive_args)
        return VectorField.of(system, self.stabilise, flow)

    def _pair(self, y: PyTree, *lead: int) -> Phase:
        """A state in two arrays; anything else is refused."""
        top = self.system.topology
        if not isinstance(y, tuple | list) or len(y) != 2:
            raise InputError(
                f"a state of {top.name!r} is a pair (q, v) of all coordinates and their rates, got {brief(y)}; "
                f"start() makes one"
            )
        q, v = (
            as_shape(x, f"{which} of a state", *lead, len(top.coordinates)) for x, which in zip(y, "qv", strict=True)
        )
        return jnp.asarray(q), jnp.asarray(v)

    def _refuse(self, t: ArrayLike, q: Array, v: Array) -> None:
        """Refuse a state that is known and does not meet the constraints."""
        if not is_concrete(self, t, q, v):
            return
        top, flow = self.system.topology, self._flow
        for x, which in ((q, "q"), (v, "v")):
            if not np.all(np.isfinite(np.asarray(x))):
                raise InputError(f"{which} of a state of {top.name!r} is NaN or infinite")
        gap, slip, speed = (float(x) for x in _off(self, jnp.asarray(t, float), q, v))
        if gap > _APART * float(flow.dyn.eq.length):
            worst = worst_rows(flow.dyn.system, flow.dyn.eq, lift(top, np.asarray(q)))
            raise InputError(
                f"{top.name!r}: the state does not meet its constraints, {worst}; start(state, rates) makes one that "
                f"does"
            )
        if slip > _APART * speed:
            raise InputError(
                f"{top.name!r}: the rates of the state do not meet the constraints, which they break by {slip:.3g} per "
                f"second; start(state, rates) makes rates that do"
            )


@filter_jit
def _rates(field: VectorField, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
    top, flow = field.system.topology, field._flow
    x, w = flow.impose(t, lift(top, q), lift_rates(top, q, v))
    back, slower = flow.solve_stage(POSITION, t, x, w), flow.solve_stage(VELOCITY, t, x, w)
    met = w + slower.change
    bent = flow.solve_stage(ACCELERATION, t, x, met)
    # JAX cannot go back through a linear solve of which a part is not looked at: diffrax's BacksolveAdjoint asks it to.
    nothing = sum(0.0 * jnp.sum(found.multipliers) for found in (back, slower, bent))
    speed, change = met + field.stabilise * back.change, bent.change + field.stabilise * slower.change
    return lower(top, speed + nothing), lower(top, change + nothing)


@filter_jit
def _off(field: VectorField, t: Array, q: Array, v: Array) -> tuple[Array, Array, Array]:
    """What the rows of a state are off by, and their rates; and its largest speed."""
    top, flow = field.system.topology, field._flow
    x, w = flow.impose(t, lift(top, q), lift_rates(top, q, v))
    rows = flow.rows(x, w)
    return largest(rows.values), largest(rows.slip), largest(w * weights(flow.dyn.eq))


@filter_jit
def _consistent(system: System, flow: Flow, t: Array, q: Array, rates: Rates) -> tuple[Array, Array]:
    """A pose and rates on the constraints."""
    top = system.topology
    x = lift(top, q)
    x, w = flow.impose(t, x, jnp.zeros_like(x))
    x = flow.project_position(x, 3)
    if rates is not None or flow.drives:
        _, w = flow.impose(t, x, start_rates(top, flow, x, rates, driven=w))
    return lower(top, x), lower(top, flow.project_velocity(x, w))


@filter_jit
def _motion(field: VectorField, t: Array, q: Array, v: Array) -> Simulation:
    top, flow = field.system.topology, field._flow
    whole = jnp.isfinite(q).all(axis=1) & jnp.isfinite(v).all(axis=1)
    q, v = (jnp.where(whole[:, None], x, 0.0) for x in (q, v))

    def one(t, q, v):
        x, w = flow.impose(t, lift(top, q), lift_rates(top, q, v))
        return MotionState(x, w, *flow.solve_stage(ACCELERATION, t, x, w))

    states = jax.vmap(one)(t, q, v)
    states = states._replace(gap=jnp.where(whole, states.gap, jnp.nan))
    history, start = History(states, t, jnp.zeros(len(t)), jnp.zeros(len(t), int)), Start(states.q[0], None, None, None)
    fields, status = summarise(top, flow, t, start, history, None, ())
    fields |= {"system": field.system, "driven": tuple(name for name, _ in flow.drives), "poses": q, "status": status}
    return Simulation(**fields, held=(), conditioning=None, time=t)


@public
@as_its_system
def vector_field(
    system: System,
    inputs: Mapping[str, Callable] | None = None,
    stabilise: float = 1.0,
    singular: bool = False,
    unit: str | None = None,
) -> VectorField:
    """Make the motion of a mechanism under its forces a vector field, as ``diffrax.ODETerm`` takes it.

    Args:
        system: the system; its bodies need masses.
        inputs: coordinates that follow functions of time, by name.
        stabilise: how fast a state that an integrator's errors have taken off the constraints returns to them, 1/s;
            0 leaves it where it is. Much less than one over a step.
        singular: whether the motion may pass positions where rows become redundant.
        unit: what the inputs give angles in, ``"rad"`` or ``"deg"``; the state is in radians.

    Returns:
        The field: a function ``f(t, y, args)``, with `VectorField.start` for the state to begin with.

    Raises:
        InputError: nothing has a mass, unknown or too many inputs, a large system.

    Source: J. García de Jalón, E. Bayo, Kinematic and Dynamic Simulation of Multibody Systems, ch. 5.
    """
    check_loads(system, "vector_field()", moves=True)
    positive(stabilise, "stabilise=", zero=True)
    drives, more = read_drives(system, inputs, unit)
    flow = Flow.of(dynamics(extended(system)), system.degrees_of_freedom, drives, bool(singular))
    flow = dataclasses.replace(flow, drive_args=more)
    rate = stabilise if isinstance(stabilise, jax.Array) else on_device(np.asarray(stabilise, float))
    return VectorField.of(system, rate, flow.prepare())
