"""The programs of a simulation: from a start to the states at all times, and what became of each."""

import dataclasses
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc import progress
from jaxnc.compiling import filter_jit
from jaxnc.dynamics.extended import extended, lower
from jaxnc.dynamics.flow import ACCELERATION, Flow, StageSolution
from jaxnc.dynamics.friction import has_friction
from jaxnc.dynamics.integrate import START, Control, Event, History, Integration, equal_steps, integrate
from jaxnc.dynamics.model import State, dynamics
from jaxnc.dynamics.simulation import join_fields
from jaxnc.dynamics.steps import METHODS, MotionState, Moving, Phase, alpha_step, phases_of, settle, start_alpha, step
from jaxnc.dynamics.written import WrittenFlow
from jaxnc.remembered import with_owner
from jaxnc.solvers.newton import largest
from jaxnc.status import Status
from jaxnc.system.system import Parameters, System
from jaxnc.system.topology import Topology, interned
from jaxnc.types import Array, PyTree
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
    return state, StageSolution(change.reshape(-1, n), multipliers.reshape(-1, m), *jnp.zeros((2, phases)))


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
    late = -jnp.where(stopped, value, 0.0) / lax.stop_gradient(jnp.where(stopped, rate, 1.0))
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
    first = states.q[0], states.v[0]
    whole = jnp.isfinite(states.q).all(axis=1) & jnp.isfinite(states.v).all(axis=1)
    whole = jnp.cumprod(whole.astype(int)) > 0
    qs, vs = (jnp.where(whole[:, None], x, x0) for x, x0 in ((states.q, first[0]), (states.v, first[1])))
    # 1e-3 of the mechanism's size: a simulation that meets its constraints worse has come apart
    apart = jnp.cumsum(~(whole & (states.gap <= 1e-3 * flow.dyn.eq.length))) > 0
    status = jnp.where((status == 0) & apart, int(Status.CAME_APART), status)
    ok = status == 0
    reached = jnp.max(jnp.where(apart, t[0], t))
    rows = jax.vmap(flow.place_multipliers)(states.multipliers)
    if start.places is not None:
        miss = largest(first[1][np.array(start.places)] - start.wanted)
    else:
        miss = jnp.zeros(()) if start.v is None else largest(lower(top, first[1] - start.v))
    smooth = {
        "poses": lower(top, qs),
        "rates": (lower(top, vs), lower(top, jnp.where(ok[:, None], states.a, 0.0))),
        "asked": jax.vmap(lambda t: flow.drive_values(t)[0])(t),
        "residual": jnp.where(whole, states.gap, jnp.nan),
        "end": jnp.where(apart.any(), jnp.minimum(end, reached), end),
        "multipliers": jnp.where(ok[:, None], rows, 0.0),
        "violation": (jnp.max(jnp.where(ok, states.gap, 0.0)), jnp.max(jnp.where(ok, states.slip, 0.0))),
        "correction": (largest(lower(top, first[0] - start.q)), miss),
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
