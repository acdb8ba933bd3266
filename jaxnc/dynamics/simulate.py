"""`simulate`: the motion of a mechanism under its forces."""

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.compiling import filter_jit
from jaxnc.dynamics.extended import extended, lift, lower
from jaxnc.dynamics.flow import Drive, Flow
from jaxnc.dynamics.friction import has_friction, settled_forces
from jaxnc.dynamics.indeterminate import check_count, check_inertia, check_inputs
from jaxnc.dynamics.initial import Rates, given_rates, start_pose, start_rates
from jaxnc.dynamics.model import blame_force, check_loads, dynamics
from jaxnc.dynamics.simulation import Simulation
from jaxnc.dynamics.written import Fast, Way, each
from jaxnc.errors import AssemblyError, InputError, nearest
from jaxnc.kinematics.inputs import array, finite, positive
from jaxnc.kinematics.motion import Motion
from jaxnc.solvers.newton import largest
from jaxnc.status import Status
from jaxnc.system.rates import refuse_rates
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import Array

_APART = 1e-3  # of the mechanism's size: a simulation that meets its constraints worse has come apart
ADAPTIVE = ("dopri8", "dopri5", "tsit5", "kvaerno5")
FIXED = ("rk4", "baumgarte", "null space", "augmented lagrangian", "generalised alpha")


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
    derivative: str = "reverse",
    singular: bool = False,
    most: int = 1_000_000,
    throw: bool | None = None,
) -> Simulation:
    """Move a mechanism under its forces.

    Args:
        system: the system; its bodies need masses.
        t: times to be kept, ``(T,)``, s; the first is the start.
        state: the start: a pose (with its rates, if it carries any); values of as many coordinates as there are
            freedoms; places to start near to. The assembled drawing if not given. A simulation's last pose resumes it.
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
        derivative: how an adaptive simulation is differentiated, ``"reverse"`` or ``"forward"``. Others take both.
        singular: whether the motion may pass positions where rows become redundant.
        most: the most steps of an adaptive method.
        throw: raise if the simulation breaks off. Default: outside of traced code.

    Returns:
        The simulation, a motion with velocities, accelerations and multipliers. Times that were not reached have a
        status and hold the last state.

    Raises:
        InputError: nothing has a mass, a motion without inertia, unknown names, times that do not follow each other.
        AssemblyError: the start does not assemble; if `throw`, the simulation broke off (where, when, and why).

    Source: J. García de Jalón, E. Bayo, Kinematic and Dynamic Simulation of Multibody Systems, ch. 5.
    """
    check_loads(system, "simulate()")
    for value, name in ((step, "step="), (first, "first=")):
        if value is not None:
            positive(value, name)
    for value, name in ((rtol, "rtol="), (atol, "atol=")):
        positive(value, name, zero=True)
    if not isinstance(rtol, Tracer) and not isinstance(atol, Tracer) and float(rtol) == float(atol) == 0.0:
        raise InputError("rtol= and atol= are both 0, which no step can meet; give one of them")
    if not isinstance(most, (int, np.integer)) or isinstance(most, bool) or most < 1:
        raise InputError(f"most={most!r}: the most steps must be a positive integer")
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
    check_count(system.topology, system.degrees_of_freedom, tuple(inputs or ()))
    if derivative not in ("reverse", "forward"):
        raise InputError(f"derivative={derivative!r}; {nearest(derivative, ('reverse', 'forward'))}")
    given = start_pose(system, state)
    known_rates = given_rates(system, rates if rates is not None else state if isinstance(state, Motion) else None)
    concrete = not any(isinstance(x, Tracer) for x in jax.tree.leaves((system, given, known_rates, t)))
    drives = tuple((inputs or {}).items())
    if concrete:
        _check_drives(drives, t)
    way, q, v, correction = _begun(system, drives, singular, t[0], given, known_rates)
    if concrete:
        check_inputs(way[0], q)
        check_inertia(way[0], q)
    if method in ADAPTIVE:
        from jaxnc.dynamics import adaptive

        found = adaptive.adapt(
            adaptive.short(way), method, t, q, v, jnp.asarray(rtol), jnp.asarray(atol),
            None if first is None else jnp.asarray(first),
            _event(event), event_parameters, derivative == "forward", most,
        )  # fmt: skip
        qs, vs, status, steps, end = found.q, found.v, found.status, (found.steps, found.rejected), found.end
    else:
        from jaxnc.dynamics import steppers

        if event is not None:
            raise InputError(f"event= works with the adaptive methods, not with {method!r}; {', '.join(ADAPTIVE)}")
        if has_friction(way[0].dyn) and method not in ("rk4", "baumgarte"):
            rubbing = ", ".join(repr(f.name) for f in way[0].dyn.topology.loads.friction)
            raise InputError(
                f"method={method!r} has no friction, and {rubbing} rubs; use 'rk4', 'baumgarte' or an adaptive method"
            )
        if method in ("augmented lagrangian", "generalised alpha"):
            remedy = "use 'rk4', 'null space', 'baumgarte' or an adaptive method"
            refuse_rates(system.topology, f"method={method!r} works with constraints on positions", remedy)
        if isinstance(t, Tracer) and step is not None:
            raise InputError("step= needs times that are known; inside jit give times as a constant")
        n = 1 if step is None else steppers.count(np.asarray(t), step)
        qs, vs, status, end = steppers.march(way, method, t, q, v, n)
        steps = (jnp.asarray(n * (t.shape[0] - 1)), jnp.asarray(0))
    run = Simulation(
        system=system,
        driven=tuple(name for name, _ in drives),
        held=(),
        conditioning=None,
        time=t,
        correction=correction,
        steps=steps,
        **_completed(system.topology, way, t, qs, vs, status, end),
    )
    if throw is None:
        throw = concrete
    if throw:
        _raise(way[0], run, qs, vs, method)
    return run


def _check_drives(drives: tuple[tuple[str, Callable], ...], t: Array) -> None:
    """Refuse inputs that are no finite numbers at the ends of the time."""
    for name, f in drives:
        for at in (t[0], t[-1]):
            value = f(jnp.asarray(at))
            if isinstance(value, Tracer):
                continue
            value = array(value, f"input {name!r} at t = {float(at):g}")
            finite(value, f"input {name!r} at t = {float(at):g}")
            if np.shape(value) != ():
                raise InputError(f"input {name!r} must be one number at a time, got shape {np.shape(value)}")


def _event(event: Callable | None) -> Callable | None:
    if event is None:
        return None
    import inspect

    wanted = len(inspect.signature(event).parameters)
    return event if wanted >= 3 else _Short(event)


class _Short:
    """An event of two arguments as one of three; equal where its function is, so that nothing is traced anew."""

    def __init__(self, f: Callable):
        self.f = f

    def __call__(self, t, state, parameters):
        return self.f(t, state)

    def __eq__(self, other):
        return isinstance(other, _Short) and self.f == other.f

    def __hash__(self):
        return hash(self.f)


@filter_jit
def _begun(
    system: System,
    drives: tuple[Drive, ...],
    singular: bool,
    t: Array,
    given: Array,
    rates: Rates,
) -> tuple[Way, Array, Array, tuple[Array, Array]]:
    """The motion, in written-out form too where it is small, and a consistent start with what had to be corrected."""
    flow = Flow.of(dynamics(extended(system)), system.degrees_of_freedom, drives, singular)
    fast = Fast.of(flow, system.degrees_of_freedom)
    lifted = lift(system.topology, given)
    q, _ = flow.impose(t, lifted, lifted)
    q = flow.project_position(q, 3 if flow.drives else 2)
    v, miss = start_rates(system, flow, q, rates)
    _, v = flow.impose(t, q, v)
    v2 = flow.project_velocity(q, v)
    # Of rates given by name: by how much they are not what was asked for.
    miss = largest(v2[np.array(rates[0])] - rates[1]) if isinstance(rates, tuple) else largest(v2 - v) + miss
    return (flow, fast), q, v2, (largest(q - lifted), miss)


@filter_jit
def _completed(top: Topology, way: Way, t: Array, qs: Array, vs: Array, status: Array, end: Array) -> dict[str, Any]:
    """What a simulation says of its states, in the coordinates of the system; whether they meet the constraints."""
    flow, fast = way

    def one(t, q, v):
        if fast is not None:
            a, lam = (jnp.stack(x) if x else jnp.zeros(0) for x in fast.both(t, list(q), list(v)))
        else:
            a, lam = settled_forces(flow, t, q, v)
        return a, lam, *flow.violation(q, v), flow.prescribed(t)[0]

    a, lam, size, rate, asked = each(way, one, t, qs, vs)
    apart = jnp.cumsum(~(size <= _APART * flow.dyn.eq.length)) > 0
    status = jnp.where((status == 0) & apart, int(Status.CAME_APART), status)
    ok = status == 0
    rows = jax.vmap(flow.all_rows)(lam)
    return {
        "poses": lower(top, qs),
        "rates": (lower(top, vs), lower(top, jnp.where(ok[:, None], a, 0.0))),
        "asked": asked,
        "residual": size,
        "status": status,
        "end": jnp.where(apart.any(), jnp.minimum(end, jnp.max(jnp.where(apart, t[0], t))), end),
        "multipliers": jnp.where(ok[:, None], rows, 0.0),
        "violation": (jnp.max(jnp.where(ok, size, 0.0)), jnp.max(jnp.where(ok, rate, 0.0))),
    }


_STIFF = "for stiff forces method='generalised alpha' with a step="
_HINTS = {
    Status.STEP_UNDERFLOW: f"Near a singular position try singular=True; {_STIFF}, or 'kvaerno5'",
    Status.TOO_MANY_STEPS: f"Allow more with most=, or a larger rtol=; {_STIFF}",
    Status.CAME_APART: "Try a shorter step=, singular=True, and inputs within reach",
}


def _raise(flow: Flow, run: Simulation, qs: Array, vs: Array, method: str) -> None:
    status, time = np.asarray(run.status), np.asarray(run.time)
    bad = np.flatnonzero((status != 0) & (status != int(Status.STOPPED)))
    if not len(bad):
        return
    k, end, top = max(int(bad[0]) - 1, 0), float(run.end), run.system.topology
    blamed = next(
        filter(None, (blame_force(flow.dyn, jnp.asarray(x), qs[-1], vs[-1]) for x in (end, time[bad[0]]))), None
    )
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
