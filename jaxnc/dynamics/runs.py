"""The programs of a simulation: from a start to the states at all times, what became of each, and their derivatives.

A simulation is a function of all its numbers, with a program for each direction of differentiation. Forward, a run is
differentiated as it stands. In reverse its steps are gone through: equal steps were kept, if they are not too many,
others are made again, interval by interval. What does not depend on its states (the equations of the design, the start)
is differentiated once, at the states that the run has found. A stage of a step is pulled back by the implicit function
theorem, see `ReplayedFlow`.

How the numbers of a motion change with its design the host knows, also where compiled code asks for it. Every number of
a motion follows from few parameters by functions that the host can read, so that the derivative of a simulation by the
design needs nothing compiled but what goes through the simulation itself. In NumPy, numbers carry their changes along
the last axis.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import custom_vmap

from jaxnc import progress
from jaxnc.autodiff import Rules, custom_jvp_vjp
from jaxnc.autodiff import attach as attach_derivative
from jaxnc.compiling import filter_jit, is_outermost, jit, on_device
from jaxnc.dynamics.extended import across_vectors, extended, is_concrete, lift, lift_rates, lower, shown_places
from jaxnc.dynamics.flow import ACCELERATION, Flow, StageSolution, WrittenFlow
from jaxnc.dynamics.integrate import START, Control, Event, History, Integration, equal_steps, integrate, pull_back
from jaxnc.dynamics.model import State, drawn_parameters, dynamics, group_inertias, sum_parts
from jaxnc.dynamics.simulation import join_fields
from jaxnc.dynamics.start import (
    Rates,
    attach_drawing,
    begin_pose,
    determines_pose,
    rates_on_host,
    start_rates,
    still_coordinates,
)
from jaxnc.dynamics.steps import METHODS, MotionState, Moving, Phase, alpha_step, phases_of, settle, start_alpha, step
from jaxnc.dynamics.wrenches import has_friction
from jaxnc.internals import evaluate_at_once
from jaxnc.records import record, with_owner
from jaxnc.solvers.assembly import free_plan, to_host
from jaxnc.solvers.host import HostView, start_changes
from jaxnc.solvers.newton import attach_pose, largest
from jaxnc.solvers.plan import Plan, plan
from jaxnc.solvers.saddle import saddle
from jaxnc.solvers.traced import PIECE, ask_host, shorten_equations
from jaxnc.status import Status
from jaxnc.system.design import GEOMETRY, Drawn, carry_design, unit_formula, with_unit_changes
from jaxnc.system.equations import Equations, equations, renumbered
from jaxnc.system.host import from_jax
from jaxnc.system.precision import numbers as numbers_as
from jaxnc.system.structure import readable
from jaxnc.system.system import Parameters, System
from jaxnc.system.topology import Topology, interned
from jaxnc.types import Array, Float, Numbers, PyTree
from jaxnc.validate import as_real, call_user

_KEPT = 2**21  # numbers of all steps of a run that are kept for its derivatives; beyond, steps are made again
_DELAY = 2.0  # seconds before a bar is shown


# -- the question -----------------------------------------------------------------------------------------------------


class SimulationSpec(NamedTuple):
    """Specification of a simulation, which its program is traced for: all that is asked but numbers."""

    topology: Topology  # the system's
    degrees_of_freedom: int  # and its count
    independent: tuple[str, ...]  # coordinates that the others follow from
    method: str  # the integrator
    drives: tuple[tuple[str, Callable], ...]  # driven coordinates, functions of time
    singular: bool  # whether rows may become redundant
    steps: int  # between two times, of a method of fixed step
    event: Callable | None  # what ends the motion
    places: tuple[int, ...] | None  # of rates that were given by name

    def system(self, parameters: Parameters) -> System:
        """Return the system with some parameters."""
        return System(self.topology, parameters, self.degrees_of_freedom, self.independent)

    def flow(self, system: System) -> Flow:
        """Return the motion of a system."""
        return Flow.of(dynamics(extended(system)), self.degrees_of_freedom, self.drives, self.singular)

    def without_names(self) -> "SimulationSpec":
        """Take the mechanism's names away, unless functions of the user's ask by name."""
        bare = strip_names(self.topology)
        if self.event is not None or bare is self.topology:
            return self

        def rename(names: Iterable[str]) -> tuple[str, ...]:
            return bare.named(self.topology.position[name] for name in names)

        functions = [f for _, f in self.drives]
        drives = tuple(zip(rename(name for name, _ in self.drives), functions, strict=True))
        return self._replace(topology=bare, independent=rename(self.independent), drives=drives)

    def strip(self, flow: Flow) -> Flow:
        """Return a motion of the same design as one without names, which this specification has none of."""
        inner = self.topology.extended or self.topology
        system = dataclasses.replace(flow.dyn.system, topology=inner, independent=())
        return dataclasses.replace(flow, dyn=dataclasses.replace(flow.dyn, system=system), drives=self.drives)


class RunNumbers(NamedTuple):
    """All numbers that a simulation depends on."""

    parameters: Parameters  # of the system
    state: Any  # a pose (N,), values by name, or None for the drawing
    rates: Any  # of all coordinates of the system (N,), of those in `places`, or None
    t: Array  # times
    event: Any  # parameters of the event
    drive_args: tuple[tuple[Array, ...], ...]  # further arguments of the drives' functions
    control: Any  # how long steps are, a `Control`; not differentiated


@with_owner
def strip_names(top: Topology) -> Topology:
    """Return a mechanism's structure with its loads, without names: its motion is traced for this.

    A mechanism is returned itself where forces are functions, which ask by name, or where reactions are needed for
    friction.
    """
    loads = top.loads
    if loads.functions or loads.friction:
        return top
    numbers = {f"{body.name} across": f"b{k} across" for k, body in enumerate(top.bodies)}
    bare = top.structure
    return interned(
        dataclasses.replace(
            bare,
            bodies=tuple(dataclasses.replace(body, name=f"b{k}") for k, body in enumerate(bare.bodies)),
            loads=dataclasses.replace(
                loads,
                physical=tuple(f"n{k}" for k in range(len(loads.physical))),
                inertias=tuple(tuple(dataclasses.replace(i, body="") for i in group) for group in loads.inertias),
                forces=tuple(dataclasses.replace(f, names=("",) * len(f.names)) for f in loads.forces),
                hidden=tuple(numbers[name] for name in loads.hidden),
            ),
            rates=tuple(dataclasses.replace(b, owners=((),) * b.count) for b in top.rates),
            extended=None if top.extended is None else strip_names(top.extended),
        )
    )


class Start(NamedTuple):
    """Where a simulation begins, in the coordinates of the dynamics ``(N,)``."""

    q: Any  # the pose as given
    v: Any  # rates as given, consistent with it; None at rest
    places: tuple[int, ...] | None  # of rates that were given by name, where they are among the coordinates
    wanted: Any  # their values

    def state(self, flow: Flow) -> MotionState:
        """Return the state at the start, not yet on the constraints."""
        v = jnp.zeros_like(self.q) if self.v is None else self.v
        zero = jnp.zeros(())
        return MotionState(self.q, v, jnp.zeros_like(self.q), flow.zero_multipliers(), zero, zero)


class Run(NamedTuple):
    """A run, in the coordinates of the system."""

    smooth: dict[str, PyTree]  # fields of a `Simulation` that are differentiated
    other: dict[str, Any]  # those that are not
    start: Array  # the pose as given, in the coordinates of the dynamics
    history: History | None  # what going back through it needs; None if it is differentiated as it stands


# -- programs ---------------------------------------------------------------------------------------------------------


def choose_form(flow: Flow, spec: SimulationSpec) -> Flow | WrittenFlow:
    """Write a motion out, for the methods that are quicker with it."""
    # 7 unknowns and rows that are written out for a method of many stages
    small = len(flow.view.unknown) + len(flow.view.rows) <= 7
    wanted = spec.method == "rk4" or (spec.method == "dopri8" and small)
    return (WrittenFlow.of(flow, spec.degrees_of_freedom) if wanted else None) or flow


def prepare_form(form: Flow | WrittenFlow) -> tuple[Flow, Moving]:
    """Return the motion of a form, and what a method of Runge and Kutta integrates of it."""
    if isinstance(form, WrittenFlow):
        return form.flow.prepare(), form
    flow = form.prepare()
    return flow, flow


def keeps_trail(form: Flow | WrittenFlow, spec: SimulationSpec, times: int) -> bool:
    """Tell whether all steps of a run are kept for its derivatives: equal ones, with all that their stages solve for.

    A motion that is written out does not solve for multipliers where it only corrects.
    """
    if isinstance(form, WrittenFlow) or not spec.steps or spec.method not in METHODS or has_friction(form.dyn):
        return False
    n, m = len(form.dyn.mass), len(form.zero_multipliers())
    phases = len(phases_of(spec.method, True)["stage"])
    return (START + spec.steps * (times - 1)) * (3 * n + phases * (n + m)) <= _KEPT


def _remember(state: MotionState, phases: Phase) -> Array:
    """Return what is kept of a step in one array, which is quicker than several: its start, and all solutions."""
    return jnp.concatenate([x.reshape(-1) for x in (*state[:3], *phases.solution[:2])])


def recall(flow: Flow, method: str, trail: Array) -> tuple[MotionState, StageSolution]:
    """Return the start of a step and the solutions of its phases."""
    n, m, zero = len(flow.dyn.mass), len(flow.zero_multipliers()), jnp.zeros(())
    phases = len(phases_of(method, True)["stage"])
    q, v, a, change, multipliers = jnp.split(trail, np.cumsum([n, n, n, phases * n]))
    state = MotionState(q, v, a, jnp.zeros(m), zero, zero)
    return state, StageSolution(change.reshape(-1, n), multipliers.reshape(phases, m), *jnp.zeros((2, phases)))


@filter_jit
def run_marched(
    top: Topology,
    form: Flow | WrittenFlow,
    method: str,
    t: Array,
    start: Start,
    control: Control,
    event: Callable | None,
    parameters: PyTree,
    steps: int = 0,
) -> Run:
    """Make a run whose steps follow its errors, or of equal steps.

    The sign change of ``event(t, state, parameters)`` ends the motion. All of so many `steps` between two times are
    kept, unless it is 0.
    """
    flow, moving = prepare_form(form)
    leaves, structure = jax.tree.flatten(moving)

    def advance(leaves, t, h, state):
        return step(jax.tree.unflatten(structure, leaves), method, True, t, h, state)

    happens = None if event is None else event_function(flow, event)
    job = Integration(advance, method, leaves, control, t, happens, parameters)
    history, course = integrate(job, start.state(flow), _remember if steps else None, steps)
    if isinstance(form, WrittenFlow):
        history = history._replace(state=form.break_off(history.state))
    smooth, status = summarise(top, flow, t, start, history, event, parameters)
    return Run(smooth, {"status": status, "steps": course.made}, start.q, history)


@filter_jit
def run_equal(
    top: Topology, form: Flow | WrittenFlow, method: str, t: Array, start: Start, steps: int, keep: bool = False
) -> Run:
    """Make a run of so many equal steps between two times, differentiable both ways; arguments as of `run_marched`.

    Elements of a motion that is written out are carried one by one: mapped, every one of them is one long array.
    All steps are kept if wanted.
    """
    flow, moving = prepare_form(form)
    state, kept = start.state(flow), jnp.zeros(0)
    written = isinstance(moving, WrittenFlow)
    if written:
        state = state._replace(q=tuple(state.q), v=tuple(state.v), a=tuple(state.a))

    def advance(at: Array, h: Array, state: MotionState) -> tuple[MotionState, Any]:
        new, _, phases = step(moving, method, True, at, h, state)
        return new, _remember(state, phases) if keep else ()

    if keep:
        first, kept = lax.scan(lambda state, _: advance(t[0], jnp.zeros(()), state), state, None, length=START)
    else:
        first = settle(moving, t[0], state)
    if method in METHODS:
        states, more = equal_steps(advance, lambda at, state: state, t, first, steps)
    else:
        states, more = equal_steps(
            lambda at, h, carry: (alpha_step(flow, at, h, carry), ()),
            lambda at, carry: MotionState(carry.q, carry.v, *flow.solve_stage(ACCELERATION, at, carry.q, carry.v)),
            t, start_alpha(flow, t[0], first.q, first.v), steps,
        )  # fmt: skip
    if keep:
        kept = jnp.concatenate([kept, more.reshape(-1, *kept.shape[1:])])
    if written:
        first, states = (
            x._replace(**{name: jnp.stack(getattr(x, name), axis=-1) for name in ("q", "v", "a")})
            for x in (first, states)
        )
        first = moving.break_off(first)
    states = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, states)
    history = History(states, t, jnp.zeros(len(t)), jnp.zeros(len(t), jnp.int32), kept if keep else None)
    smooth, status = summarise(top, flow, t, start, history, None, ())
    made = jnp.asarray(steps * (len(t) - 1), jnp.int32), jnp.zeros((), jnp.int32)
    return Run(smooth, {"status": status, "steps": made}, start.q, history if method in METHODS else None)


def event_function(flow: Flow, event: Callable) -> Event:
    """Return an event as a function of its parameters, time and state."""
    top = flow.dyn.topology

    def happens(parameters, t, state):
        found = call_user(event, "event=", "t, state, parameters", t, State(top, t, state.q, state.v), parameters)
        return as_real(found, "event=", "one number, which changes its sign", ())

    return happens


def _follow_event(happens: Callable, parameters: object, history: History, end: Array) -> tuple[MotionState, Array]:
    """Return states and end of a motion that an event has ended, with the derivatives of when it did."""
    states, state = history.state, jax.tree.map(lambda x: x[-1], history.state)
    t = lax.stop_gradient(history.t[-1])
    value = happens(parameters, t, state)
    _, rate = jax.jvp(
        lambda t, q, v: happens(parameters, t, state._replace(q=q, v=v)), (t, state.q, state.v),
        (jnp.ones(()), state.v, state.a),
    )  # fmt: skip
    stopped = history.status[-1] == int(Status.STOPPED)
    slopes = stopped & (rate != 0.0)  # what changes its sign by a jump has no derivative
    late = -jnp.where(slopes, value, 0.0) / lax.stop_gradient(jnp.where(slopes, rate, 1.0))
    late = late - lax.stop_gradient(late)
    over = jnp.where(history.status == int(Status.STOPPED), late, 0.0)[:, None]
    moved = states._replace(q=states.q + over * states.v, v=states.v + over * states.a)
    return moved, jnp.where(stopped, t + late, end)


def summarise(
    top: Topology, flow: Flow, t: Array, start: Start, history: History, event: Callable | None, parameters: object
) -> tuple[dict[str, PyTree], Array]:
    """Return the differentiated fields of a `Simulation`, in the coordinates of the system, and its status."""
    states, status = history.state, history.status
    end = jnp.where(history.t[-1] == t[-1], t[-1], lax.stop_gradient(history.t[-1]))
    if event is not None:
        states, end = _follow_event(event_function(flow, event), parameters, history, end)
    whole = jnp.isfinite(states.q).all(axis=1) & jnp.isfinite(states.v).all(axis=1) & jnp.isfinite(states.gap)
    whole = jnp.cumprod(whole.astype(int)) > 0
    last = jnp.maximum(jnp.sum(whole) - 1, 0)

    def hold(x: Array, begin: Array) -> Array:
        begin = jnp.where(jnp.isfinite(begin), begin, 0.0)
        return jnp.where(whole[:, None], x, jnp.where(whole[0], x[last], begin))

    qs, vs = hold(states.q, start.q), hold(states.v, jnp.zeros_like(start.q))
    # 1e-3 of the mechanism's size: a simulation that meets its constraints worse has come apart
    apart = jnp.cumsum(~(whole & (states.gap <= 1e-3 * flow.dyn.eq.length))) > 0
    status = jnp.where((status == 0) & apart, int(Status.CAME_APART), status)
    ok = status == 0
    reached = jnp.max(jnp.where(apart, t[0], t))
    rows = jax.vmap(flow.place_multipliers)(states.multipliers)
    if start.places is not None:
        miss = largest(vs[0][np.array(start.places, int)] - start.wanted)
    else:
        miss = jnp.zeros(()) if start.v is None else largest(lower(top, vs[0] - start.v))
    smooth = {
        "poses": lower(top, qs),
        "rates": (lower(top, vs), lower(top, jnp.where(ok[:, None], states.a, 0.0))),
        "asked": jax.vmap(lambda t: flow.drive_values(t)[0])(t),
        "residual": jnp.where(whole, states.gap, jnp.nan),
        "end": jnp.where(apart.any(), jnp.minimum(end, reached), end),
        "multipliers": jnp.where(ok[:, None], rows, 0.0),
        "violation": (jnp.max(jnp.where(ok, states.gap, 0.0)), jnp.max(jnp.where(ok, states.slip, 0.0))),
        "correction": (largest(lower(top, qs[0] - start.q)), miss),
    }
    return smooth, status


# -- in parts ---------------------------------------------------------------------------------------------------------


def run_in_parts(
    run: Callable[[SimulationSpec, RunNumbers], Run], spec: SimulationSpec, numbers: RunNumbers, name: str
) -> dict[str, PyTree]:
    """Make a run of known numbers, with a bar if it takes more than a few seconds and someone is watching.

    Returns:
        The fields of the `Simulation`; times that were not reached hold the last state.
    """
    count = len(numbers.t) - 1
    if count < 2 or not progress.is_watched() or progress.showing():
        found = run(spec, numbers)
        return found.smooth | found.other
    # 20 parts of a simulation that someone watches, or a few more
    width = 2 ** max(0, int(np.ceil(np.log2(count / 20))))
    parts, lengths = [], []
    with progress.bar(count, name, "times", delay=_DELAY, leave=False) as shown:
        for first in range(0, count, width):
            at = np.asarray(numbers.t)[first : first + width + 1]
            whole = np.concatenate([at, np.full(width + 1 - len(at), at[-1])])  # one program for all parts
            found = run(spec, numbers._replace(t=whole))
            parts.append(found.smooth | found.other)
            lengths.append(len(at))
            shown.update(len(at) - 1)
            if np.asarray(found.other["status"])[len(at) - 1]:
                break
            spec, numbers = spec._replace(places=None), _resume(numbers, found)
    return join_fields(parts, lengths, count + 1)


def _resume(numbers: RunNumbers, found: Run) -> RunNumbers:
    """Begin the next part where the last one has ended, with the step that it wanted next."""
    made = sum(int(x) for x in found.other["steps"])
    control = numbers.control._replace(most=max(int(numbers.control.most) - made, 1))
    if found.history is not None:
        control = control._replace(first=float(np.asarray(found.history.h)[-1]))
    last = np.asarray(found.smooth["poses"])[-1], np.asarray(found.smooth["rates"][0])[-1]
    return numbers._replace(state=last[0], rates=last[1], control=control)


# -- how the numbers of a motion change with its design ---------------------------------------------------------------

Derived = tuple[PyTree, ...]
"""Numbers of a motion that follow from the design, see `collect_derived`; or changes of them."""

Origin = Plan | tuple[int, ...] | None
"""What a start follows from: the known coordinates of a plan, the drawing but for some coordinates, or nothing."""

_PARAMETERS = *GEOMETRY, "physical"


def collect_derived(flow: Flow) -> Derived:
    """Take the numbers out of a motion that the host differentiates: coefficients, inertia, parameters of forces."""
    eq, dyn = flow.dyn.eq, flow.dyn
    return eq.constants, eq.linear, eq.quadratic, dyn.mass, dyn.moments, dyn.gravity, dyn.constants


def host_differentiates(top: Topology) -> bool:
    """Tell whether the host can differentiate all that a mechanism's motion is made of."""
    inner = top.extended or top
    kinds = all(f.kind.drawn is None or drawn_parameters(f.kind, inner.dim)[0].program for f in inner.loads.forces)
    return not inner.rates and not inner.large and not inner.loads.friction and readable(inner) and kinds


class DesignChanges:
    """The numbers of a motion with their changes by all parameters of the design.

    `eq` are the equations that its dynamics works on.
    """

    def __init__(self, system: System, eq: Equations):
        top, self.eq, self.system = system.topology, eq, system
        self.top = inner = top.extended or top
        par = {name: np.asarray(getattr(system.parameters, name)) for name in _PARAMETERS}
        values = np.concatenate([x.reshape(-1) for x in par.values()]).astype(float)
        self.count = len(values)
        parts = np.split(with_unit_changes(values, np.arange(self.count)), np.cumsum([x.size for x in par.values()]))
        wide = 1 + self.count
        self.given = x = {n: part.reshape(*a.shape, wide) for (n, a), part in zip(par.items(), parts, strict=False)}
        with np.errstate(all="ignore"):
            vectors = x["vectors"]
            if inner is not top:
                units = np.stack(unit_formula(top.dim).carrying(list(np.moveaxis(vectors, 1, 0))), axis=1)
                vectors = np.concatenate([vectors, across_vectors(top, x["points"], units)])
            self.drawn = self._carry(inner, vectors)

    def _carry(self, top: Topology, vectors: np.ndarray) -> Drawn:
        parts = (self.given["points"], vectors, self.given["markers"], self.given["dimensions"])
        near = self.system.parameters.near
        return carry_design(top, np.concatenate([part.reshape(-1, 1 + self.count) for part in parts]), near)

    def derived(self) -> Derived:
        """Return all numbers of `collect_derived`."""
        x, drawn = self.given, self.drawn
        eq = renumbered(self.eq, drawn.constants, [np.asarray(scale) for scale in self.eq.scales])
        found = group_inertias(self.top, x["points"], drawn.drawing, drawn.vectors, x["physical"])
        mass, moments, _, gravity, forces, _ = sum_parts(self.top, found, drawn.home, x["physical"])
        return drawn.constants, eq.linear, eq.quadratic, mass, moments, gravity, forces

    def pose(self, view: Plan, q: np.ndarray) -> np.ndarray:
        """Return changes of a pose ``(N, changes + known)``, by the parameters, then by a plan's known coordinates."""
        host, home = HostView(view, to_host(self.eq)), self.drawn.home
        count, more = self.count, len(view.known)
        at = np.zeros((len(q), 1, 1 + count + more))
        at[:, 0, 0] = q
        at[view.fixed, 0, 1 : 1 + count] = home[view.fixed, 1:]
        at[view.known, 0, 1 + count + np.arange(more)] = 1.0
        wide = tuple(np.concatenate([c, np.zeros((*c.shape[:-1], more))], axis=-1) for c in self.drawn.constants)
        right = np.moveaxis(host.eq.changes(at, (), wide)[view.rows], 1, 0)
        at[view.unknown, 0, 1:] = -host.solve(host.matrices(q[:, None])[0], right)[0]
        return np.where(np.isfinite(at).all(), at[:, 0, 1:], 0.0)

    def start(self, q: np.ndarray, still: tuple[int, ...]) -> np.ndarray:
        """Return changes of an assembled start ``(N, changes)``: see `jaxnc.solvers.newton.attach_start`."""
        top, x = self.system.topology, q
        drawn, eq, view = self.drawn, self.eq, free_plan(top)
        if self.top is not top:  # hidden vectors follow from what is moved
            drawn, x = self._carry(top, self.given["vectors"]), q[shown_places(top)]
            eq = equations(System(top, self.system.parameters.in_numpy()))
        found = start_changes(view, to_host(eq) if eq is self.eq else from_jax(eq), drawn, x, still)
        return np.zeros((len(q), self.count)) if found is None else lift(top, found)[:, 1:]


def pull_back_design(
    spec: SimulationSpec,
    origin: Origin,
    parameters: Parameters,
    eq: Equations,
    at: np.ndarray,
    pose_bar: np.ndarray,
    derived_bar: Derived,
) -> np.ndarray:
    """Pull changes of a start and of the numbers of a motion back to the design, in NumPy.

    Args:
        spec: the simulation.
        origin: what the start follows from.
        parameters: of the design.
        eq: the equations that its dynamics works on.
        at: the start.
        pose_bar: the changes of the start.
        derived_bar: the changes of the numbers.

    Returns:
        Changes of all parameters, then of the known coordinates of an assembled start, one after the other.
    """
    with np.errstate(all="ignore"):
        changes = DesignChanges(spec.system(parameters), eq)
        found = np.zeros(changes.count)
        for bar, value in zip(*map(jax.tree.leaves, (derived_bar, changes.derived())), strict=True):
            found = found + np.tensordot(bar, value[..., 1:], bar.ndim)
        if origin is None:
            return found
        if not isinstance(origin, Plan):
            return found + pose_bar @ changes.start(at, origin)
        through = pose_bar @ changes.pose(origin, at)
    return np.concatenate([found + through[: changes.count], through[changes.count :]])


def request_pull_back(
    spec: SimulationSpec,
    origin: Origin,
    parameters: Parameters,
    eq: Equations,
    at: Array,
    pose_bar: Array,
    derived_bar: Derived,
) -> Float[Array, " changes"] | None:
    """Ask the host for `pull_back_design` in traced code; None where its arguments are too large for that."""
    count = len(origin.known) if isinstance(origin, Plan) else 0
    par = tuple(getattr(parameters, name) for name in _PARAMETERS)
    given = (par, shorten_equations(eq), at, jnp.zeros(0) if origin is None else pose_bar, derived_bar)
    if max(x.size for x in jax.tree.leaves(given)) > PIECE:
        return None
    leaves, structure = jax.tree.flatten(given)
    _read_programs(spec, origin, tuple((x.shape, x.dtype.name) for x in leaves), structure)
    like = jax.ShapeDtypeStruct((sum(x.size for x in par) + count,), at.dtype)
    answer = functools.partial(_answer, spec, origin)
    return ask_host(
        "differentiated a design", like, answer, *given, given_up=lambda *_: np.zeros(like.shape, like.dtype)
    )


def _answer(
    spec: SimulationSpec, origin: Origin, par: PyTree, eq: Equations, at: np.ndarray, pose: np.ndarray, derived: Derived
) -> np.ndarray:
    return pull_back_design(spec, origin, Parameters(*par), eq, at, pose, derived).astype(at.dtype)


@functools.lru_cache(maxsize=256)
def _read_programs(spec: SimulationSpec, origin: Origin, shapes: tuple, structure: object) -> None:
    """Have the host read all programs that it needs, on any numbers: inside of compiled code it may not trace."""
    rng = np.random.default_rng(0)
    numbers = [rng.uniform(0.5, 1.5, shape).astype(dtype) for shape, dtype in shapes]
    _answer(spec, origin, *jax.tree.unflatten(structure, numbers))


def join_parameters(parameters: Parameters, found: Numbers, own: PyTree) -> tuple[Parameters, Numbers]:
    """Put changes of all parameters ``(changes,)``, and of the functions' own, together as parameters.

    Returns:
        The changes as parameters, and changes behind them.
    """
    parts, start = [], 0
    for name in _PARAMETERS:
        shape = np.shape(getattr(parameters, name))
        end = start + int(np.prod(shape, dtype=int))
        parts.append(found[start:end].reshape(shape))
        start = end
    return Parameters(*parts, own=own, rounded=parameters.rounded), found[start:]


_WHOLE = ("violation", "correction", "steps", "end")
"""Fields of a run that are not of each time."""


# -- stages -----------------------------------------------------------------------------------------------------------


@record
class ReplayedFlow:
    """A motion whose stages are solved already, and only get their derivatives: the implicit function theorem.

    A solution (accelerations, or what brings a pose or its rates back onto the constraints) solves
    ``M c + Jᵀ λ = f, J c = g``. What it changes by is found by the same matrix, from changes of what the equations are
    off by where the solution stands as a constant.
    """

    flow: Flow  # the motion, with its matrices prepared
    moved: Flow  # the same motion, by whose numbers it is differentiated

    @property
    def redundant(self) -> bool:
        """True if rows are redundant, or may become so."""
        return self.flow.redundant

    def impose(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Put the state where the drives have it, as `Flow.impose`."""
        return self.moved.impose(t, q, v)

    def solve_stage(self, stage: Array, t: Array, q: Array, v: Array, known: StageSolution) -> StageSolution:
        """Return a solution of `Flow.solve_stage` that was found before, with its derivatives."""
        return _replay(self.flow, self.moved, stage, t, q, v, known)


@jax.custom_vjp
def _replay(flow: Flow, moved: Flow, stage: Array, t: Array, q: Array, v: Array, known: StageSolution) -> StageSolution:
    return known


def _replay_forward(*args: PyTree) -> tuple[StageSolution, tuple]:
    return args[-1], args


def _replay_back(args: tuple, change: StageSolution) -> tuple:
    flow, moved, stage, t, q, v, known = args
    u, driven, (weight, size, inner) = flow.view.unknown, flow.view.known, flow.scale()
    # One refinement does: after a thousand steps a gradient is as good as with three, to 1e-13.
    solve = saddle(inner, flow.stage_equations(stage, t, q, v)[0], flow.redundant, 1)
    a, b = solve(change.change[u] / weight, change.multipliers * size)
    _, pull = jax.vjp(lambda *x: _miss(flow, stage, known, *x), moved, t, q, v)
    of_motion, *of_state = pull((a, b, change.gap, change.slip, change.change[driven]))
    return None, of_motion, None, *of_state, None


def _miss(flow: Flow, stage: Array, known: StageSolution, moved: Flow, t: Array, q: Array, v: Array) -> tuple:
    """Return what the scaled equations of a stage, ``M c + Jᵀ λ = f, J c = g``, miss where their solution is `known`.

    Returns:
        Misses of the unknown coordinates ``(n,)`` and of the rows ``(m,)``; the rows' largest residual, and that of
        their rates; and what the driven coordinates change by ``(driven,)``.
    """
    u, driven, (weight, size, _) = flow.view.unknown, flow.view.known, flow.scale()
    j, f, g, base, rows = dataclasses.replace(moved, ready=flow.ready).stage_equations(stage, t, q, v)
    # What is driven stands in the right-hand sides.
    pushed = (moved.dyn.mass @ known.change.at[driven].set(0.0))[u] / (weight * size) + j.T @ (known.multipliers / size)
    off = g - j @ (weight * known.change[u])
    return f - pushed, off, _peak(rows.values), _peak(rows.slip), base[driven]


def _peak(r: Array) -> Array:
    """Return the largest magnitude; JAX's derivative is no number where it calculates a maximum twice."""
    if not r.shape[0]:
        return jnp.zeros(())
    return jnp.where(jnp.arange(r.shape[0]) == jnp.argmax(jnp.abs(r)), jnp.sign(r), 0.0) @ r


_replay.defvjp(_replay_forward, _replay_back)


# -- values -----------------------------------------------------------------------------------------------------------


class _Question(NamedTuple):
    """The static part of a simulation's arguments, and how its numbers are put together from arrays."""

    spec: SimulationSpec
    structure: Any  # of the numbers
    smooth: tuple[bool, ...]  # which of them are differentiated

    def numbers(self, x: PyTree, rest: PyTree) -> RunNumbers:
        """Return all numbers, from those that are differentiated and those that are not."""
        each, others = iter(x), iter(rest)
        return jax.tree.unflatten(self.structure, [next(each) if real else next(others) for real in self.smooth])


def differentiable_run(spec: SimulationSpec, numbers: RunNumbers) -> dict[str, PyTree]:
    """Return the fields of a `Simulation`, differentiable in both directions."""
    leaves, structure = jax.tree.flatten(numbers)
    count = len(Control._fields)  # which come last
    smooth = (*map(_is_real, leaves[:-count]), *(False,) * count)
    each = list(zip(leaves, smooth, strict=True))
    x = [a if isinstance(a, jax.Array) else on_device(np.asarray(a)) for a, real in each if real]
    rest = [a for a, real in each if not real]
    found, other = custom_jvp_vjp(_RULES, _Question(spec, structure, smooth), x, rest)
    fields = jax.tree.unflatten(_SMOOTH, found[: _SMOOTH.num_leaves])
    return fields | jax.tree.unflatten(_OTHER, other[: _OTHER.num_leaves])


_PAIR = (0, 0)
_SMOOTH = jax.tree.structure(
    {"poses": 0, "rates": _PAIR, "asked": 0, "residual": 0, "end": 0, "multipliers": 0, "violation": _PAIR,
     "correction": _PAIR}
)  # fmt: skip
_OTHER = jax.tree.structure({"status": 0, "steps": _PAIR})


def _leaves(run: Run) -> tuple[list, list]:
    """Part a run into arrays that are differentiated and arrays that are not."""
    states, rest = (None, None) if run.history is None else (run.history.state, run.history._replace(state=None))
    # The trail is not differentiated: beyond the first order steps are made again.
    return jax.tree.leaves((run.smooth, run.start, states)), jax.tree.leaves((run.other, rest))


def _start_and_history(smooth: PyTree, other: PyTree) -> tuple[Array, History | None]:
    """Put start and history of a run together from its arrays; it may have kept no history."""
    start, *states = smooth[_SMOOTH.num_leaves :]
    return start, History(MotionState(*states), *other[_OTHER.num_leaves :]) if states else None


def _value(question: _Question, x: PyTree, rest: PyTree) -> tuple[list, list]:
    if is_outermost(x, rest):
        with evaluate_at_once():
            return _leaves(run_known(question.spec, question.numbers(x, rest)))
    return _value_traced(question, x, rest)


@functools.partial(jit, static_argnums=0)
def _value_traced(question: _Question, x: list, rest: list) -> tuple[list, list]:
    return _leaves(_run_traced(question.spec, question.numbers(x, rest)))


def run_known(spec: SimulationSpec, numbers: RunNumbers, flow: Flow | None = None) -> Run:
    """Make a run of known numbers, with its motion where that is at hand.

    Few programs are compiled: times are padded to a power of two, and one. A run whose motion is given is not
    differentiated, and keeps its padded history.
    """
    top, method, t = spec.topology, spec.method, np.asarray(numbers.t)
    count = len(t)
    found = spec.strip(_flow(spec, numbers) if flow is None else flow)
    found = dataclasses.replace(found, drive_args=numbers.drive_args)
    pose = np.asarray(
        begin_pose(
            spec.system(numbers.parameters), numbers.state, _evaluate_drives(found, jnp.asarray(t[0])), throw=False
        )
    )
    rates = jax.tree.map(np.asarray, numbers.rates)
    start = _start(spec, found, lift(top, pose), rates, t, _compiled_rates)
    form = choose_form(found, spec)
    steps = spec.steps if flow is None and keeps_trail(form, spec, count) else 0
    if spec.steps and method != "rk4":
        run = run_equal(top, form, method, t, start, spec.steps)
    else:
        padded = np.concatenate([t, np.full(1 + 2 ** int(np.ceil(np.log2(count - 1))) - count, t[-1])])
        control = Control(*map(np.asarray, numbers.control))
        run = run_marched(top, form, method, padded, start, control, spec.event, numbers.event, steps)

    def unpad(tree: object, count: int = count) -> Any:
        return on_device(jax.tree.map(lambda x: np.asarray(x)[:count], tree))

    smooth, other = (x | unpad({k: v for k, v in x.items() if k not in _WHOLE}) for x in (run.smooth, run.other))
    history = run.history
    if flow is None and history is not None:
        trail = unpad(history.trail, START + steps * (count - 1))
        history = unpad(history._replace(trail=None))._replace(trail=trail)
    return Run(smooth, other, run.start, history)


def _run_traced(spec: SimulationSpec, numbers: RunNumbers) -> Run:
    """Make a run of numbers that are not known."""
    flow, top = _flow(spec, numbers), spec.topology
    system, pose = spec.system(numbers.parameters), numbers.state
    if _is_drawn(pose):
        pose = begin_pose(system, pose, _evaluate_drives(flow, numbers.t[0]))
    start = _start(spec, flow, lift(top, pose), numbers.rates, numbers.t, _named_rates)
    form = choose_form(flow, spec)
    if spec.steps:
        keep = keeps_trail(form, spec, len(numbers.t))
        return run_equal(top, form, spec.method, numbers.t, start, spec.steps, keep)
    return run_marched(top, form, spec.method, numbers.t, start, numbers.control, spec.event, numbers.event)


def _flow(spec: SimulationSpec, numbers: RunNumbers) -> Flow:
    return dataclasses.replace(spec.flow(spec.system(numbers.parameters)), drive_args=numbers.drive_args)


def _evaluate_drives(flow: Flow, t: Array) -> dict[str, Array]:
    """Return the values of the driven coordinates at a time."""
    return {name: value for (name, _), value in zip(flow.drives, flow.drive_values(t)[0], strict=True)}


def _is_drawn(state: object) -> bool:
    """Tell whether a start is assembled, from the drawing or from values by name."""
    return state is None or isinstance(state, dict)


def _start(spec: SimulationSpec, flow: Flow, q: Array, rates: Any, t: Any, find_rates: Callable) -> Start:
    """Return the start at a pose with its hidden vectors.

    Rates by name are made consistent by `find_rates`, or on the host where it can; all else by the first steps.
    """
    top = spec.topology
    if rates is None:
        return Start(q, None, None, None)
    if spec.places is None:
        return Start(q, lift_rates(top, lower(top, q), rates), None, None)
    if isinstance(q, np.ndarray) and not flow.drives and not top.rates:
        return Start(q, rates_on_host(flow, q, (spec.places, rates)), spec.places, rates)
    return Start(q, find_rates(flow, q, (spec.places, rates), t[0]), spec.places, rates)


def _named_rates(flow: Flow, q: Array, rates: Rates, t: Array, settled: bool = True) -> Array:
    """Find consistent rates at a time from rates by name; `settled` as of `start_rates`, and the pose too."""
    q, driven = flow.impose(t, q, jnp.zeros_like(q))
    if settled:
        q = flow.project_position(q, 3 if flow.drives else 2)
    return start_rates(flow.dyn.topology, flow, q, rates, settled, driven)


_compiled_rates = filter_jit(_named_rates)


# -- derivatives ------------------------------------------------------------------------------------------------------


@functools.partial(jit, static_argnums=0)
def _tangent(question: _Question, x: PyTree, rest: PyTree, smooth: PyTree, other: PyTree, change: PyTree) -> list:
    def value(x: list) -> list:
        return _leaves(_run_traced(question.spec, question.numbers(x, rest)))[0]

    return jax.jvp(value, (list(x),), (list(change),))[1]


def _cotangent(question: _Question, x: PyTree, rest: PyTree, smooth: PyTree, other: PyTree, change: PyTree) -> list:
    spec, numbers = question.spec, question.numbers(x, rest)
    known = is_outermost(x, rest, smooth, other, change) and is_concrete(numbers)
    if known and host_differentiates(spec.topology):
        return _pull_back_known(question, numbers, smooth, other, change)
    return _pull_back_traced(question, *map(list, (x, rest, smooth, other, change)))


@functools.partial(jit, static_argnums=0)
def _pull_back_traced(question: _Question, x: list, rest: list, smooth: list, other: list, change: list) -> list:
    """Pull back a run of traced numbers; to differentiate that, steps are made again, as the trail is a constant."""
    bare = list(other[: _OTHER.num_leaves + 3])  # without the trail
    if len(bare) == len(other):
        return _pull_back_all(question, x, rest, smooth, other, change)
    found = _pull_back_all(question, *lax.stop_gradient((x, rest, smooth, other, change)))
    return attach_derivative(_change, (_pull_back_all, question, (0, 2, 4)), found, x, rest, smooth, bare, change)


def _change(static: tuple[Callable, _Question, tuple[int, ...]], value: list, args: tuple, changes: tuple) -> list:
    """Differentiate a pull back that was made elsewhere by some of its arguments, which are real numbers."""
    f, question, moving = static

    def pull(*moved: PyTree) -> list:
        now = dict(zip(moving, moved, strict=True))
        return f(question, *(now.get(k, x) for k, x in enumerate(args)))

    with numbers_as(jax.tree.leaves(args[2])[0]):
        at, along = (tuple(x[k] for k in moving) for x in (args, changes))
        return jax.jvp(pull, at, along)[1]


def _pull_back_all(question: _Question, x: list, rest: list, smooth: list, other: list, change: list) -> list:
    spec, numbers = question.spec, question.numbers(x, rest)
    flow, at = _flow(spec, numbers), _start_and_history(smooth, other)[0]
    bars = _pull_back_run(spec, flow, numbers, smooth, other, change)
    if not host_differentiates(spec.topology):
        return _pull_back_beginning(question, x, rest, at, bars)
    return _requested_pull_back(question)(x, rest, flow.dyn.eq, at, bars)


def _pull_back_known(question: _Question, numbers: RunNumbers, smooth: PyTree, other: PyTree, change: PyTree) -> list:
    """Pull back a run of known numbers: the host knows how the numbers of a motion change with the design."""
    spec, at = question.spec, np.asarray(_start_and_history(smooth, other)[0])
    flow = _flow(spec, numbers)
    bars = jax.tree.map(np.asarray, _pull_back_run(spec, flow, numbers, list(smooth), list(other), list(change)))
    origin = _origin(spec, numbers.state)
    found = pull_back_design(spec, origin, numbers.parameters, flow.dyn.eq, at, bars[1], collect_derived(bars[0]))
    numbers = jax.tree.map(np.asarray, numbers._replace(control=None))
    return on_device(_collect_bars(question, numbers, found, bars, isinstance(origin, Plan)))


def _pull_back_beginning(question: _Question, x: list, rest: list, at: Array, bars: tuple) -> list:
    """Pull changes of a motion, its start, rates, times and event back to the numbers that these are made of."""
    spec = question.spec

    def beginning(x: list) -> tuple:
        numbers = question.numbers(x, rest)
        flow, state, pose = _flow(spec, numbers), numbers.state, lax.stop_gradient(at)
        origin = _origin(spec, state)
        if origin is None:
            pose = state
        elif isinstance(origin, Plan):
            pose = attach_pose(origin, pose, flow.dyn.eq, jnp.stack([jnp.asarray(x, float) for x in state.values()]))
        else:
            system, top = spec.system(numbers.parameters), spec.topology
            pose = lift(top, attach_drawing(system, lower(top, pose), state))
        return flow, pose, numbers.rates, numbers.t, _real(numbers.event)

    return jax.vjp(beginning, x)[1](bars)[0]


@functools.lru_cache(maxsize=64)
def _requested_pull_back(question: _Question) -> Callable[[list, list, Equations, Array, tuple], list]:
    """Return `_pull_back_beginning` with the host's share; XLA's where it is map_request or differentiated."""

    @custom_vmap
    def request(x, rest, eq, at, bars):
        numbers = question.numbers(x, rest)
        origin = _origin(question.spec, numbers.state)
        derived = collect_derived(bars[0])
        found = request_pull_back(question.spec, origin, numbers.parameters, eq, at, bars[1], derived)
        if found is None:
            return _pull_back_beginning(question, x, rest, at, bars)
        return _collect_bars(question, numbers, found, bars, isinstance(origin, Plan))

    @request.def_vmap
    def map_request(size, which, x, rest, eq, at, bars):
        axes = jax.tree.map(lambda has: 0 if has else None, (which[0], which[1], which[3], which[4]))
        each = functools.partial(_pull_back_beginning, question)
        with numbers_as(at):
            found = jax.vmap(each, in_axes=axes, axis_size=size)(x, rest, at, bars)
        return found, [True] * len(found)

    def back(x: list, rest: list, eq: Equations, at: Array, bars: tuple) -> list:
        value = request(*lax.stop_gradient((x, rest, eq, at, bars)))
        return attach_derivative(_change, (_pull_back_beginning, question, (0, 2, 3)), value, x, rest, at, bars)

    return back


def _collect_bars(question: _Question, numbers: RunNumbers, found: Numbers, bars: tuple, by_known: bool) -> list:
    """Return the changes of all real numbers: of the design and a start's known coordinates, and what needs neither.

    `found` are those of the design and, `by_known`, of known coordinates; `bars` as of `_pull_back_run`.
    """
    flow_bar, pose_bar, rates_bar, t_bar, event_bar = bars
    state = numbers.state
    of_design, of_known = join_parameters(numbers.parameters, found, flow_bar.dyn.own)
    if _is_drawn(state):
        pose_bar = jax.tree.map(lambda a: 0.0 * a, state)
        if by_known:
            pose_bar = dict(zip(state, of_known, strict=True))
    event = _with_real(numbers.event, event_bar)
    made = RunNumbers(of_design, pose_bar, rates_bar, t_bar, event, flow_bar.drive_args, None)
    whole = jax.tree.leaves(made), jax.tree.leaves(numbers._replace(control=None)), question.smooth
    return [a.astype(jnp.result_type(b)) for a, b, real in zip(*whole, strict=False) if real]


def _origin(spec: SimulationSpec, state: Any) -> Origin:
    """Say what a start follows from: some coordinates, the drawing but for some, or, given as a pose, nothing."""
    top = spec.topology
    if not _is_drawn(state):
        return None
    if state and determines_pose(top, spec.degrees_of_freedom, state):
        return plan(top.extended or top, tuple(state), (), spec.degrees_of_freedom)
    return still_coordinates(top, state)


@functools.partial(jit, static_argnums=0)
def _pull_back_run(
    spec: SimulationSpec, flow: Flow, numbers: RunNumbers, smooth: PyTree, other: Any, change: Any
) -> tuple[Flow, Array, Array | None, Array, list]:
    """Pull a change of a run back to its motion, start, rates, times, and the event's real numbers.

    `smooth` are the arrays of the run that are differentiated, `other` the rest. The change of the start is that of the
    pose with its hidden vectors, if it was assembled.
    """
    (at, history), (at_bar, history_bar) = _start_and_history(smooth, other), _start_and_history(change, other)
    drawn, rates, t, parameters = _is_drawn(numbers.state), numbers.rates, numbers.t, numbers.event
    pose = at if drawn else numbers.state
    fields_bar, top = jax.tree.unflatten(_SMOOTH, change[: _SMOOTH.num_leaves]), spec.topology
    moved = flow, pose, rates, t, _real(parameters)

    def begin(now, pose, rates, t):
        find_rates = functools.partial(_named_rates, settled=not drawn or bool(spec.drives))
        return _start(spec, now, pose if drawn else lift(top, pose), rates, t, find_rates)

    def whole(now, pose, rates, t, event):
        start = begin(now, pose, rates, t)
        return _leaves(run_equal(top, choose_form(now, spec), spec.method, t, start, spec.steps))[0]

    if history is None or history_bar is None:
        return jax.vjp(whole, *moved)[1](change)

    def beginning(now, pose, rates, t, event):
        start = begin(now, pose, rates, t)
        return start._replace(places=None), start.state(now)

    def ending(now, start, t, event, states):
        start, event = start._replace(places=spec.places), _with_real(parameters, event)
        return summarise(top, now, t, start, history._replace(state=states), spec.event, event)[0]

    (start, first), back = jax.vjp(beginning, *moved)
    event = moved[4]
    _, finish = jax.vjp(ending, flow, start, t, event, history.state)
    flow_bar, start_bar, t_bar, event_bar, states_bar = finish(fields_bar)
    states_bar = jax.tree.map(jnp.add, states_bar, history_bar.state)
    advance, again = _replayed_steps(flow, spec.method)
    job = Integration(advance, spec.method, flow, numbers.control, t)
    known = None if history.trail is None else functools.partial(recall, flow, spec.method)
    more, first_bar, t_more = pull_back(job, again, first, history, states_bar, known)
    found = back((start_bar._replace(q=start_bar.q + at_bar), first_bar))
    still = jax.tree.map(jnp.zeros_like, moved[1:3])
    return jax.tree.map(lambda *x: sum(x[1:], x[0]), found, (flow_bar, *still, t_bar, event_bar), (
        more, *still, t_more, jax.tree.map(jnp.zeros_like, event)))  # fmt: skip


def _replayed_steps(flow: Flow, method: str) -> tuple[Callable, Callable]:
    """Return the functions by which `pull_back` makes steps of a motion again and differentiates them."""
    ready = flow.prepare()
    if has_friction(flow.dyn) or METHODS[method].implicit:

        def advance(moved, t, h, state):
            return step(moved.prepare(), method, True, t, h, state)[:2]

        return advance, lambda *x: advance(*x)[0]

    def first(moved, t, h, state):
        end, errors, phases = step(ready, method, True, t, h, state)
        return end, errors, phases.solution

    def again(moved, t, h, state, solutions):
        replayed: Any = ReplayedFlow(ready, moved)
        return step(replayed, method, True, t, h, state, (solutions,))[0]

    return first, again


def _is_real(x: Numbers) -> bool:
    return bool(jnp.issubdtype(jnp.result_type(x), jnp.floating))


def _real(tree: PyTree) -> list:
    """List the leaves that are real numbers."""
    return [x for x in jax.tree.leaves(tree) if _is_real(x)]


def _with_real(tree: PyTree, real: list) -> PyTree:
    each = iter(real)
    return jax.tree.map(lambda x: next(each) if _is_real(x) else x, tree)


def _in_its_numbers(rule: Callable) -> Callable:
    """Return a rule, which JAX may call where the width of the system's numbers is no longer in force."""

    def inner(question: _Question, x: list, *more: PyTree) -> PyTree:
        with numbers_as(x[0]):  # points of the design
            found = rule(question, x, *more)
            if rule is _value:
                return found
            # A lane that broke off passes on no derivative that is no number.
            status = more[2][0]
            failed = jnp.any((status != 0) & (status != int(Status.STOPPED)))
            return [jnp.where(failed & ~jnp.isfinite(d), 0.0, d) for d in found]

    return inner


_RULES = Rules(*map(_in_its_numbers, (_value, _tangent, _cotangent)))
