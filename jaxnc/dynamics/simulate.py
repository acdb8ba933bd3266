"""`simulate`: the motion of a mechanism under its forces."""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.extend.core import ClosedJaxpr, jaxpr_as_fun

from jaxnc.asking import ask, real
from jaxnc.calls import public
from jaxnc.compiling import filter_jit, on_device
from jaxnc.dynamics import runs, steppers
from jaxnc.dynamics.asked import Asked, Numbers, flow_of, without_names
from jaxnc.dynamics.derivatives import simulated
from jaxnc.dynamics.extended import known, lift, lift_rates
from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.indeterminate import check_count, check_inertia, check_inputs
from jaxnc.dynamics.initial import Rates, given_rates, pose_of, rates_on_host, start_numbers, start_rates
from jaxnc.dynamics.integrate import Control
from jaxnc.dynamics.model import blame_force, check_loads, check_mass
from jaxnc.dynamics.parts import watched
from jaxnc.dynamics.runs import Run
from jaxnc.dynamics.simulation import Simulation
from jaxnc.dynamics.state import State
from jaxnc.errors import AssemblyError, InputError, brief, nearest
from jaxnc.internals import outermost
from jaxnc.kinematics.inputs import array, doubt_degrees, finite, in_radians, outside, positive, whole
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position
from jaxnc.status import Status
from jaxnc.system.rates import refuse_rates
from jaxnc.system.system import System
from jaxnc.types import Array

ADAPTIVE = ("dopri8", "dopri5", "tsit5", "kvaerno5")
FIXED = ("rk4", "baumgarte", "null space", "augmented lagrangian", "generalised alpha")


@public
def simulate(
    system: System,
    t: Any,
    state: Motion | Mapping[str, Any] | None = None,
    rates: Mapping[str, Any] | None = None,
    method: str = "dopri8",
    inputs: Mapping[str, Callable] | None = None,
    step: float | None = None,
    rtol: float = 1e-9,
    atol: float = 1e-11,
    first: float | None = None,
    event: Callable | None = None,
    event_parameters: Any = (),
    singular: bool = False,
    most: int = 1_000_000,
    throw: bool | None = None,
    unit: str | None = None,
) -> Simulation:
    """Move a mechanism under its forces.

    Args:
        system: the system; its bodies need masses.
        t: times to be kept, ``(T,)``, s; the first is the start.
        state: the start: a pose (with its rates, if it carries any; the ground is where `system` has it); values of as
            many coordinates as there are freedoms; places to start near to. The assembled drawing if not given. A
            simulation's last pose resumes it.
        rates: rates at the start by name, of coordinates, points or vectors; at rest if not given.
        method: adaptive ``"dopri8"``, ``"dopri5"``, ``"tsit5"``, ``"kvaerno5"`` (implicit, stiff); of fixed step
            ``"rk4"``, ``"baumgarte"``, ``"null space"``, ``"augmented lagrangian"``, ``"generalised alpha"``.
        inputs: coordinates that follow functions of time; the forces that this takes are left to the constraints.
        step: longest step of a method of fixed step, s; one step between two times if not given.
        rtol: relative tolerance of an adaptive step.
        atol: absolute tolerance of an adaptive step.
        first: first adaptive step, s.
        event: ``f(t, state)`` (or ``f(t, state, event_parameters)``) whose change of sign ends the motion.
        event_parameters: what the event is given, any pytree.
        singular: whether the motion may pass positions where rows become redundant.
        most: the most steps of an adaptive method.
        throw: raise if the simulation breaks off. Default: outside of traced code.
        unit: what angles of `state`, `rates` and `inputs` are given in, ``"rad"`` or ``"deg"``; what forces and events
            see, and what is returned, is in radians.

    Returns:
        The simulation, a motion with velocities, accelerations and multipliers. Times that were not reached have a
        status and hold the last state.

    Raises:
        InputError: nothing has a mass, a motion without inertia, unknown names, times that do not follow each other.
        AssemblyError: the start does not assemble; if `throw`, the simulation broke off (where, when, and why).

    Source: J. García de Jalón, E. Bayo, Kinematic and Dynamic Simulation of Multibody Systems, ch. 5.
    """
    check_loads(system, "simulate()")
    check_mass(system)
    for value, name in ((step, "step="), (first, "first=")):
        if value is not None:
            positive(value, name)
    for value, name in ((rtol, "rtol="), (atol, "atol=")):
        positive(value, name, zero=True)
    plain = (x if x is None or isinstance(x, Tracer) else float(x) for x in (step, first, rtol, atol))
    step, first, rtol, atol = plain  # pyright: ignore[reportAssignmentType]
    if not isinstance(rtol, Tracer) and not isinstance(atol, Tracer) and float(rtol) == float(atol) == 0.0:
        raise InputError("rtol= and atol= are both 0, which no step can meet; give one of them")
    most = whole(most, "most=, the most steps,")
    singular = bool(singular)
    if event is not None and not callable(event):
        raise InputError(f"event= must be a function f(t, state), got {type(event).__name__}")
    if method not in (*ADAPTIVE, *FIXED):
        raise InputError(f"method={method!r}; {nearest(method, (*ADAPTIVE, *FIXED))}")
    t = array(t, "time t")
    finite(t, "time t")
    if t.ndim != 1 or t.shape[0] < 2:
        raise InputError(f"time t must be a sequence of two values at least, shape (T,); got shape {t.shape}")
    if not isinstance(t, Tracer) and not np.all(np.diff(np.asarray(t, float)) > 0.0):
        raise InputError("time t must grow from value to value")
    for name, f in (inputs or {}).items():
        if not callable(f):
            raise InputError(f"input {name!r} must be a function of time, got {type(f).__name__}")
    doubt_degrees(system, unit, state)
    state, rates, inputs = in_radians(system, unit, state, rates, inputs)
    check_count(system.topology, system.degrees_of_freedom, tuple(inputs or ()))
    fixed = method not in ADAPTIVE
    if fixed:
        _check_fixed(system, method, event, t, step)
    given = start_numbers(system, state)
    wanted = given_rates(system, rates if rates is not None else state if isinstance(state, Motion) else None)
    places, wanted = wanted if isinstance(wanted, tuple) else (None, wanted)
    n = steppers.count(np.asarray(t), step) if fixed else 0
    drives, more = hoist_drives(tuple((inputs or {}).items()))
    event, event_parameters = _hoisted_event(system, _event(event), event_parameters)
    numbers = Numbers(
        system.parameters, given, wanted, t, event_parameters, more,
        Control(rtol, atol, 0.0 if first is None else first, most, n),
    )  # fmt: skip
    asked = Asked(
        system.topology, system.degrees_of_freedom, system.independent, method, drives, singular, n, event, places
    )
    free = known(system, numbers) and outermost()
    if free:
        _check_drives(drives, t)
        flow = flow_of(asked, system)
        begin = pose_of(system, given)
        if given is None and drives and len(drives) == system.degrees_of_freedom:
            # Nothing else to find: the drawing's branch is followed to there, if it leads there.
            ends = {name: np.asarray(f(jnp.asarray(t[0]))) for name, f in drives}
            found = solve_position(system, ends, throw=False)
            begin = begin if int(found.status) else found.q
        numbers = numbers._replace(state=begin)
        check_inputs(flow, lift(system.topology, np.asarray(numbers.state)))
        check_inertia(flow, lift(system.topology, np.asarray(numbers.state)))
        run = watched(functools.partial(_known, flow=flow), asked.nameless(), numbers, system.topology.name)
        found = run.smooth | run.other
    else:
        found = simulated(asked if isinstance(given, dict) else asked.nameless(), numbers, _known)
    made = Simulation(
        system=system, driven=tuple(name for name, _ in drives), held=(), conditioning=None, time=t, **found
    )
    if free if throw is None else throw:
        outside(made.status, "throw=True")
        _raise(flow_of(asked, system), made, method)
    return made


def _known(asked: Asked, numbers: Numbers, flow: Flow | None = None) -> Run:
    """A run of known numbers; with its motion where that is at hand."""
    system = asked.system(numbers.parameters)
    top, method, t = asked.topology, asked.method, np.asarray(numbers.t)
    found = without_names(flow_of(asked, system) if flow is None else flow, asked)
    found = dataclasses.replace(found, more=numbers.more)
    given = np.asarray(pose_of(system, numbers.state, throw=False))
    start = _start(system, found, given, asked.places, numbers.rates)
    motion, count = (found, runs.written_out(found, asked.degrees_of_freedom, method)), len(t)
    control = Control(*map(np.asarray, numbers.control))
    if method in FIXED and method != "rk4":
        run = runs.equal(top, motion, method, t, start, asked.steps)
    else:
        run = runs.controlled(top, motion, method, _padded(t), start, control, asked.event, numbers.event)
    smooth, other = (x | _cut({k: v for k, v in x.items() if k not in _WHOLE}, count) for x in (run.smooth, run.other))
    kept = run.kept if flow is not None or run.kept is None else _cut(run.kept, count)
    return Run(smooth, other, run.start, kept)


def _padded(t: np.ndarray) -> np.ndarray:
    """Times with the last one repeated, so that few numbers of times are compiled for: a power of two, and one."""
    count = 1 + 2 ** int(np.ceil(np.log2(len(t) - 1)))
    return np.concatenate([t, np.full(count - len(t), t[-1])])


_WHOLE = ("violation", "correction", "steps", "end")
"""Fields of a run that are not of each time."""


def _cut(tree: Any, count: int) -> Any:
    """What is of all times, without what was padded."""
    return on_device(jax.tree.map(lambda x: np.asarray(x)[:count], tree))


def _start(system: System, flow: Flow, given: Any, places: tuple[int, ...] | None, rates: Any) -> runs.Start:
    """Where it begins: rates by name are made consistent here, all else by the first steps."""
    top = system.topology
    q = lift(top, given)
    if rates is None:
        return runs.Start(q, None, None, None)
    if places is None:
        return runs.Start(q, lift_rates(top, given, rates), None, None)
    if not flow.drives and not top.rates:
        v = rates_on_host(system, flow, given, (places, rates))
    else:
        v = _named(system, flow, q, (places, rates))
    return runs.Start(q, v, places, rates)


@filter_jit
def _named(system: System, flow: Flow, q: Array, rates: Rates) -> Array:
    q, _ = flow.impose(jnp.zeros(()), q, q)
    return start_rates(system.topology, flow, flow.project_position(q, 3 if flow.drives else 2), rates)[0]


def _check_fixed(system: System, method: str, event: Callable | None, t: Any, step: float | None) -> None:
    """Refuse what methods of fixed step cannot do."""
    if event is not None:
        raise InputError(f"event= works with the adaptive methods, not with {method!r}; {', '.join(ADAPTIVE)}")
    rubbing = ", ".join(repr(f.name) for f in system.topology.loads.friction)
    if rubbing and method not in ("rk4", "baumgarte"):
        raise InputError(
            f"method={method!r} has no friction, and {rubbing} rubs; use 'rk4', 'baumgarte' or an adaptive method"
        )
    if method in steppers.STEPPERS:
        remedy = "use 'rk4', 'null space', 'baumgarte' or an adaptive method"
        refuse_rates(system.topology, f"method={method!r} works with constraints on positions", remedy)
    if isinstance(t, Tracer) and step is not None:
        raise InputError("step= needs times that are known; inside jit give times as a constant")


def _check_drives(drives: tuple[tuple[str, Callable], ...], t: Array) -> None:
    """Refuse inputs that are no finite numbers at the ends of the time."""
    for name, f in drives:
        for at in (t[0], t[-1]):
            what = f"input {name!r}"
            value = ask(f, what, "t", jnp.asarray(at))
            if isinstance(value, Tracer):
                continue
            value = real(value, what, "one number", ())
            finite(value, f"{what} at t = {float(at):g}")
            # As it will be asked, where time is no number yet.
            jax.eval_shape(lambda t, f=f, what=what: ask(f, what, "t", t), value)


def hoist_drives(
    drives: tuple[tuple[str, Callable], ...],
) -> tuple[tuple[tuple[str, Callable], ...], tuple[tuple[Array, ...], ...]]:
    """Functions of time that close over nothing that is traced, and for each what it closed over."""
    found = [_hoisted(f, 0.0) for _, f in drives]
    pure = tuple((name, f) for (name, _), (f, _) in zip(drives, found, strict=True))
    return pure, tuple(more for _, more in found) if any(more for _, more in found) else ()


def _hoisted(f: Callable, *example: Any) -> tuple[Callable, tuple]:
    """A function of a number as one that closes over nothing traced, and what more it is given then.

    `jax.closure_convert` does so for what is differentiated only; what is mapped may not stay behind either.
    """
    if outermost():
        return f, ()
    found = jax.make_jaxpr(f)(*example)
    which = [isinstance(c, Tracer) for c in found.consts]
    if not any(which):
        return f, ()
    kept = [None if traced else c for c, traced in zip(found.consts, which, strict=True)]

    def pure(*args: Any) -> Array:
        given, more = args[: len(example)], iter(args[len(example) :])
        consts = [next(more) if traced else c for c, traced in zip(kept, which, strict=True)]
        return jaxpr_as_fun(ClosedJaxpr(found.jaxpr, consts))(*jax.tree.leaves(given))[0]

    return pure, tuple(c for c, traced in zip(found.consts, which, strict=True) if traced)


def _hoisted_event(system: System, event: Callable | None, parameters: Any) -> tuple[Callable | None, Any]:
    """The same of an event: what it closed over comes with its parameters."""
    if event is None:
        return None, ()
    top = system.topology if system.topology.extended is None else system.topology.extended
    still: Any = np.zeros(len(top.coordinates))
    pure, more = _hoisted(event, 0.0, State(top, 0.0, still, still), parameters)
    return (lambda t, state, p: pure(t, state, p[0], *p[1]), (parameters, more)) if more else (event, parameters)


def _event(event: Callable | None) -> Callable | None:
    if event is None:
        return None
    import inspect

    try:
        wanted = len(inspect.signature(event).parameters)
    except (TypeError, ValueError):  # of what is no function of Python's
        raise InputError(f"event= is a function (t, state) or (t, state, parameters), got {brief(event)}") from None
    return event if wanted >= 3 else _Short(event)


class _Short:
    """An event of two arguments as one of three; equal where its function is, so that nothing is traced anew."""

    def __init__(self, f: Callable):
        self.f = f

    def __call__(self, t, state, parameters):
        return ask(self.f, "event=", "t, state", t, state)

    def __eq__(self, other):
        return isinstance(other, _Short) and self.f == other.f

    def __hash__(self):
        return hash(self.f)


def _last(run: Simulation) -> tuple[Array, Array]:
    """The last state, in the coordinates of the dynamics."""
    top, q, v = run.system.topology, run.q[-1], run.rates[0][-1]
    return lift(top, q), lift_rates(top, q, v)


_STIFF = "for stiff forces method='generalised alpha' with a step="
_HINTS = {
    Status.STEP_UNDERFLOW: f"Near a singular position try singular=True; {_STIFF}, or 'kvaerno5'",
    Status.TOO_MANY_STEPS: f"Allow more with most=, or a larger rtol=; {_STIFF}",
    Status.CAME_APART: "Try a shorter step=, singular=True, and inputs within reach",
}


def _raise(flow: Flow, run: Simulation, method: str) -> None:
    status, time = np.asarray(run.status), np.asarray(run.time)
    bad = np.flatnonzero((status != 0) & (status != int(Status.STOPPED)))
    if not len(bad):
        return
    k, end, top = max(int(bad[0]) - 1, 0), float(run.end), run.system.topology
    blamed = next(filter(None, (blame_force(flow.dyn, jnp.asarray(x), *_last(run)) for x in (end, time[bad[0]]))), None)
    names = (
        top.scalars[:3] or [top.coordinates[c] for c in flow.view.unknown if top.coordinates[c] in top.position][-3:]
    )
    where = ", ".join(f"{n} = {float(run.q[k][top.position[n]]):.6g}" for n in names)
    when = f"at t = {end:.9g} s" if method in ADAPTIVE else f"between t = {time[k]:.9g} and {time[bad[0]]:.9g} s"
    said = f"{run.system.name!r}: the simulation broke off {when}, near {where}"
    if blamed:
        raise AssemblyError(f"{said}: force {blamed!r} is not finite there")
    found = Status(int(status[bad[0]]))
    raise AssemblyError(f"{said}. {found.sentence} {_HINTS.get(found, '')}")
