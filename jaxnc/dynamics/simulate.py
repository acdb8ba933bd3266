"""`simulate`: the motion of a mechanism under its forces."""

import dataclasses
import functools
import inspect
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.extend.core import ClosedJaxpr, jaxpr_as_fun

from jaxnc.calls import public
from jaxnc.dynamics.extended import is_concrete, lift, lift_rates
from jaxnc.dynamics.flow import Drive, Flow
from jaxnc.dynamics.integrate import Control
from jaxnc.dynamics.model import State, blame_force, check_loads
from jaxnc.dynamics.runs import RunNumbers, SimulationSpec, differentiable_run, run_in_parts, run_known
from jaxnc.dynamics.simulation import Simulation
from jaxnc.dynamics.start import begin_pose, check_begin, check_start
from jaxnc.dynamics.steps import count_steps
from jaxnc.errors import AssemblyError, InputError, brief, counted, nearest
from jaxnc.internals import outermost
from jaxnc.kinematics.inputs import array, finite, in_radians, outside, positive, whole
from jaxnc.kinematics.motion import Motion
from jaxnc.status import Status
from jaxnc.system.equations import refuse_rates
from jaxnc.system.precision import as_its_system, more_digits
from jaxnc.system.system import System
from jaxnc.types import Array, Numbers, PyTree
from jaxnc.validate import as_real, call_user

ADAPTIVE = ("dopri8", "kvaerno5")
FIXED = ("rk4", "generalised alpha")


@public
@as_its_system
def simulate(
    system: System,
    t: Any,
    state: Motion | Mapping[str, Any] | None = None,
    rates: Mapping[str, Any] | None = None,
    method: str = "dopri8",
    inputs: Mapping[str, Callable] | None = None,
    step: float | None = None,
    rtol: float | None = None,
    atol: float | None = None,
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
            many coordinates as there are freedoms; places to start near to (derivatives by the design are then to first
            order in how far those are from the pose). The assembled drawing if not given. A
            simulation's last pose resumes it.
        rates: rates at the start by name, of coordinates, points or vectors; at rest if not given.
        method: adaptive ``"dopri8"``, ``"kvaerno5"`` (implicit, for stiff forces); of fixed step ``"rk4"``,
            ``"generalised alpha"`` (implicit, for stiff mechanisms).
        inputs: coordinates that follow functions of time; the forces that this takes are left to the constraints.
        step: longest step of a method of fixed step, s; one step between two times if not given.
        rtol: relative tolerance of an adaptive step; 1e-9 if not given.
        atol: absolute tolerance of an adaptive step; 1e-11 if not given.
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
    check_loads(system, "simulate()", moves=True)
    if method not in (*ADAPTIVE, *FIXED):
        raise InputError(f"method={method!r}; {nearest(method, (*ADAPTIVE, *FIXED))}")
    check_steps(method, {"step=": step}, {"rtol=": rtol, "atol=": atol, "first=": first})
    rtol, atol = 1e-9 if rtol is None else rtol, 1e-11 if atol is None else atol
    for value, name in ((step, "step="), (first, "first=")):
        if value is not None:
            positive(value, name)
    for value, name in ((rtol, "rtol="), (atol, "atol=")):
        positive(value, name, zero=True)
    step, first = (None if x is None else _plain_float(x) for x in (step, first))
    rtol, atol = _plain_float(rtol), _plain_float(atol)
    if not isinstance(rtol, Tracer) and not isinstance(atol, Tracer) and float(rtol) == float(atol) == 0.0:
        raise InputError("rtol= and atol= are both 0, which no step can meet; give one of them")
    most = whole(most, "most=, the most steps,")
    singular = bool(singular)
    t = array(t, "time t")
    finite(t, "time t")
    if t.ndim != 1 or t.shape[0] < 2:
        raise InputError(f"time t must be a sequence of two values at least, shape (T,); got shape {t.shape}")
    if not isinstance(t, Tracer) and not np.all(np.diff(np.asarray(t, float)) > 0.0):
        raise InputError("time t must grow from value to value")
    drives, drive_args = read_drives(system, inputs, unit)
    fixed = method not in ADAPTIVE
    if fixed:
        _check_fixed(system, method, event, t, step)
    given, wanted = check_start(system, state, rates, unit)
    free = [name for name, _ in drives if not system.topology.fixed[system.topology.position[name]]]
    if wanted is None and drives and len(free) < system.degrees_of_freedom:
        wanted = (), np.zeros(0)  # the freedoms that are left move with what is driven
    places, wanted = wanted if isinstance(wanted, tuple) else (None, wanted)
    event, event_parameters = _read_event(system, event, event_parameters)
    equal = 0 if not fixed else 1 if step is None else count_steps(np.asarray(t), step)
    control = Control(rtol, atol, 0.0 if first is None else first, most, equal)
    numbers = RunNumbers(system.parameters, given, wanted, t, event_parameters, drive_args, control)
    spec = SimulationSpec(
        system.topology, system.degrees_of_freedom, system.independent, method, drives, singular, control.equal, event,
        places,
    )  # fmt: skip
    known = is_concrete(system, numbers) and outermost()
    if known:
        _check_drives(drives, t)
        flow = spec.flow(system)
        driven = {name: np.asarray(f(jnp.asarray(t[0]))) for name, f in drives}
        numbers = numbers._replace(state=begin_pose(system, given, driven))
        check_begin(flow, lift(system.topology, np.asarray(numbers.state)))
        run = functools.partial(run_known, flow=flow)
        fields = run_in_parts(run, spec.without_names(), numbers, system.topology.name)
    else:
        fields = differentiable_run(spec if isinstance(given, dict) else spec.without_names(), numbers)
    made = Simulation(
        system=system, driven=tuple(name for name, _ in drives), held=(), conditioning=None, time=t, **fields
    )
    if known if throw is None else throw:
        outside(made.status, "throw=True")
        _check_reached(spec.flow(system), made, method)
    return made


def check_steps(method: str, fixed: Mapping[str, object], adaptive: Mapping[str, object]) -> None:
    """Refuse what is given, under these names, for the steps of methods of the other sort."""
    wrong, steps, methods = adaptive, "that follow their errors", ADAPTIVE
    if method in ADAPTIVE:
        wrong, steps, methods = fixed, "of fixed length", FIXED
    for name, value in wrong.items():
        if value is not None:
            raise InputError(f"{name} is for steps {steps} ({', '.join(methods)}), not for {method!r}; leave it out")


def _plain_float(x: float) -> float:
    """Make a number a float of Python's, unless it is traced."""
    return x if isinstance(x, Tracer) else float(x)


def _check_fixed(system: System, method: str, event: Callable | None, t: Numbers, step: float | None) -> None:
    """Refuse what methods of fixed step cannot do."""
    if event is not None:
        raise InputError(f"event= works with the adaptive methods, not with {method!r}; {', '.join(ADAPTIVE)}")
    if method == "generalised alpha":
        remedy = "use 'rk4' or an adaptive method"
        if rubbing := ", ".join(repr(f.name) for f in system.topology.loads.friction):
            raise InputError(f"method={method!r} has no friction, and {rubbing} rubs; {remedy}")
        refuse_rates(system.topology, f"method={method!r} works with constraints on positions", remedy)
    if step is not None and (isinstance(t, Tracer) or isinstance(step, Tracer)):
        raise InputError("step= and its times must be known; inside jit give them as constants")


def _check_drives(drives: tuple[tuple[str, Callable], ...], t: Array) -> None:
    """Refuse inputs that are no finite numbers at the ends of the time."""
    for name, f in drives:
        for at in (t[0], t[-1]):
            what = f"input {name!r}"
            value = call_user(f, what, "t", jnp.asarray(at))
            if isinstance(value, Tracer):
                continue
            value = as_real(value, what, "one number", ())
            finite(value, f"{what} at t = {float(at):g}")
            # As it will be asked, where time is no number yet.
            jax.eval_shape(lambda t, f=f, what=what: call_user(f, what, "t", t), value)


def read_drives(
    system: System, inputs: Mapping[str, Callable] | None, unit: str | None
) -> tuple[tuple[Drive, ...], tuple[tuple[Array, ...], ...]]:
    """Check functions of time by name, of angles in `unit`; return them as functions that close over nothing traced.

    Angles are then in radians. Behind the functions come for each the numbers that it closed over, if any does.
    """
    for name, f in (inputs or {}).items():
        if not callable(f):
            raise InputError(f"input {name!r} must be a function of time, got {type(f).__name__}")
    (driven,) = in_radians(system, unit, inputs or {})
    top, freedom = system.topology, system.degrees_of_freedom
    extra = sum(name not in top.position or not top.fixed[top.position[name]] for name in driven) - freedom
    if extra > 0:
        raise InputError(
            f"too many inputs: {system.name!r} has {counted(freedom, 'degree')} of freedom, {len(driven)} inputs were "
            f"given ({', '.join(driven)}). Leave {extra} of them out"
        )
    found = {name: _hoist(f, 0.0) for name, f in driven.items()}
    pure, more = tuple((name, f) for name, (f, _) in found.items()), tuple(more for _, more in found.values())
    return pure, more if any(more) else ()


def _hoist(f: Callable, *example: PyTree) -> tuple[Callable, tuple]:
    """Return a function of a number as one that closes over nothing traced, and what more it is given then.

    `jax.closure_convert` does so for what is differentiated only; what is mapped may not stay behind either.
    """
    if outermost():
        return f, ()
    found = jax.make_jaxpr(f)(*example)
    which = [isinstance(c, Tracer) for c in found.consts]
    if not any(which):
        return f, ()
    kept = [None if traced else c for c, traced in zip(found.consts, which, strict=True)]

    def pure(*args: object) -> Array:
        given, more = args[: len(example)], iter(args[len(example) :])
        consts = [next(more) if traced else c for c, traced in zip(kept, which, strict=True)]
        return jaxpr_as_fun(ClosedJaxpr(found.jaxpr, consts))(*jax.tree.leaves(given))[0]

    return pure, tuple(c for c, traced in zip(found.consts, which, strict=True) if traced)


def _read_event(system: System, event: Callable | None, parameters: PyTree) -> tuple[Callable | None, PyTree]:
    """Return an event of three arguments that closes over nothing traced; that comes with its parameters."""
    if event is None:
        return None, ()
    if not callable(event):
        raise InputError(f"event= must be a function f(t, state), got {type(event).__name__}")
    try:
        wanted = len(inspect.signature(event).parameters)
    except (TypeError, ValueError):  # of what is no function of Python's
        raise InputError(f"event= is a function (t, state) or (t, state, parameters), got {brief(event)}") from None
    event = event if wanted >= 3 else _TwoArguments(event)
    top = system.topology if system.topology.extended is None else system.topology.extended
    still: Any = np.zeros(len(top.coordinates))
    pure, more = _hoist(event, 0.0, State(top, 0.0, still, still), parameters)
    return (lambda t, state, p: pure(t, state, p[0], *p[1]), (parameters, more)) if more else (event, parameters)


@dataclasses.dataclass(frozen=True)
class _TwoArguments:
    """An event of two arguments as one of three; equal where its function is, so that nothing is traced anew."""

    f: Callable

    def __call__(self, t: Array, state: State, parameters: object) -> Array | None:
        return call_user(self.f, "event=", "t, state", t, state)


_STIFF = "for stiff forces method='generalised alpha' with a step="
_HINTS = {
    Status.STEP_UNDERFLOW: f"Near a singular position try singular=True; {_STIFF}, or 'kvaerno5'",
    Status.TOO_MANY_STEPS: f"Allow more with most=, or a larger rtol=; {_STIFF}",
    Status.CAME_APART: "Try a shorter step=, singular=True, and inputs within reach",
}


def _check_reached(flow: Flow, run: Simulation, method: str) -> None:
    """Raise an error of a simulation that broke off: when, where, and why."""
    status, time = np.asarray(run.status), np.asarray(run.time)
    bad = np.flatnonzero((status != 0) & (status != int(Status.STOPPED)))
    if not len(bad):
        return
    k, end, top = max(int(bad[0]) - 1, 0), float(run.end), run.system.topology
    q, v = run.q[-1], run.rates[0][-1]
    last = lift(top, q), lift_rates(top, q, v)
    blamed = next(filter(None, (blame_force(flow.dyn, jnp.asarray(x), *last) for x in (end, time[bad[0]]))), None)
    names = (
        top.scalars[:3] or [top.coordinates[c] for c in flow.view.unknown if top.coordinates[c] in top.position][-3:]
    )
    where = top.write_values({n: run.q[k][top.position[n]] for n in names})
    when = f"at t = {end:.9g} s" if method in ADAPTIVE else f"between t = {time[k]:.9g} and {time[bad[0]]:.9g} s"
    said = f"{run.system.name!r}: the simulation broke off {when}, near {where}"
    if blamed:
        raise AssemblyError(f"{said}: force {blamed!r} is not finite there")
    found = Status(int(status[bad[0]]))
    if found == Status.CAME_APART and (rubbing := ", ".join(repr(f.name) for f in top.loads.friction)):
        said += f" (where the friction of {rubbing} may lock it)"
    raise AssemblyError(f"{said}. {found.sentence} {_HINTS.get(found, '')}{more_digits(q)}")
