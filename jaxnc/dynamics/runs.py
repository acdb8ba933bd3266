"""The programs of a simulation: from a start to the states at all times, and what became of each."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.asking import ask, real
from jaxnc.compiling import filter_jit
from jaxnc.dynamics import state as seen
from jaxnc.dynamics.extended import lower
from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.friction import FrictionFlow, has_friction, settled
from jaxnc.dynamics.integrate import Control, Kept, equal_steps, integrate
from jaxnc.dynamics.runge_kutta import METHODS, Moving, State, on_constraints, step
from jaxnc.dynamics.steppers import alpha_step, start_alpha
from jaxnc.dynamics.written import Fast
from jaxnc.solvers.newton import largest
from jaxnc.status import Status
from jaxnc.system.topology import Topology
from jaxnc.types import Array

_SMALL = 7  # unknowns and rows that are written out for a method of many stages
_APART = 1e-3  # of the mechanism's size: a simulation that meets its constraints worse has come apart


class Start(NamedTuple):
    """Where a simulation begins, in the coordinates of the dynamics ``(N,)``."""

    q: Any  # the pose as given
    v: Any  # rates as given, consistent with it; None at rest
    places: tuple[int, ...] | None  # of rates that were given by name, where they are among the coordinates
    wanted: Any  # their values


class Run(NamedTuple):
    """A run, in the coordinates of the system."""

    smooth: dict[str, Any]  # fields of a `Simulation` that are differentiated
    other: dict[str, Any]  # those that are not
    start: Array  # the pose as given, in the coordinates of the dynamics
    kept: Kept | None  # what going back through it needs; None if it is differentiated as it stands


def begin(flow: Flow, start: Start) -> State:
    """The state at the start, not yet on the constraints."""
    q = start.q
    v = jnp.zeros_like(q) if start.v is None else start.v
    return State(q, v, jnp.zeros_like(q), flow.no_multipliers(), jnp.zeros(()), jnp.zeros(()))


def written_out(flow: Flow, freedom: int, method: str) -> Fast | None:
    """The written-out form of a motion, for the methods that are quicker with it."""
    small = len(flow.view.unknown) + len(flow.view.rows) <= _SMALL
    return Fast.of(flow, freedom) if method == "rk4" or (method == "dopri8" and small) else None


def moving(flow: Flow, fast: Fast | None) -> Moving:
    """The motion that a method of Runge and Kutta integrates."""
    if has_friction(flow.dyn):
        return FrictionFlow(flow)
    return flow if fast is None else fast


def _taken_apart(state: State) -> State:
    """A state with a number for each coordinate: mapped, every one of them is one long array."""
    return state._replace(q=tuple(state.q), v=tuple(state.v), a=tuple(state.a))


def _put_together(state: State) -> State:
    q, v, a = (jnp.stack(x, axis=-1) for x in (state.q, state.v, state.a))
    return state._replace(q=q, v=v, a=a)


@filter_jit
def controlled(
    top: Topology,
    motion: tuple[Flow, Fast | None],
    method: str,
    t: Array,
    start: Start,
    control: Control,
    event: Callable | None,
    parameters: Any,
) -> Run:
    """A run whose steps follow its errors; or of equal steps.

    The sign change of ``event(t, state, parameters)`` ends the motion.
    """
    flow = motion[0].prepared()
    leaves, advance = stepping(moving(flow, motion[1]), method)
    happens = None if event is None else happening(flow, event)
    kept, course = integrate(advance, method, happens, (leaves, parameters, control), t, begin(flow, start))
    smooth, status = told(top, flow, t, start, kept, event, parameters)
    return Run(smooth, {"status": status, "steps": course.made}, start.q, kept)


def stepping(way: Moving, method: str) -> tuple[list, Callable]:
    """The arrays of a motion, and a step of it as a function of them."""
    leaves, structure = jax.tree.flatten(way)

    def advance(leaves, t, h, state):
        return step(jax.tree.unflatten(structure, leaves), method, True, t, h, state)

    return leaves, advance


def happening(flow: Flow, event: Callable) -> Callable:
    """An event as a function of its parameters, time and state."""
    top = flow.dyn.topology

    def happens(parameters, t, state):
        found = ask(event, "event=", "t, state, parameters", t, seen.State(top, t, state.q, state.v), parameters)
        return real(found, "event=", "one number, which changes its sign", ())

    return happens


def _at_event(happens: Callable, parameters: Any, kept: Kept, end: Array) -> tuple[State, Array]:
    """States and end of a motion that an event has ended, with the derivatives of when it did."""
    states, state, t = kept.state, jax.tree.map(lambda x: x[-1], kept.state), lax.stop_gradient(kept.t[-1])
    value = happens(parameters, t, state)
    _, rate = jax.jvp(
        lambda t, q, v: happens(parameters, t, state._replace(q=q, v=v)), (t, state.q, state.v),
        (jnp.ones(()), state.v, state.a),
    )  # fmt: skip
    stopped = kept.status[-1] == int(Status.STOPPED)
    late = -jnp.where(stopped, value, 0.0) / lax.stop_gradient(jnp.where(stopped, rate, 1.0))
    late = late - lax.stop_gradient(late)
    over = jnp.where(kept.status == int(Status.STOPPED), late, 0.0)[:, None]
    moved = states._replace(q=states.q + over * states.v, v=states.v + over * states.a)
    return moved, jnp.where(stopped, t + late, end)


@filter_jit
def equal(top: Topology, motion: tuple[Flow, Fast | None], method: str, t: Array, start: Start, steps: int) -> Run:
    """A run of so many equal steps between two times, differentiable both ways; arguments as of `controlled`.

    Elements of what is written out are carried one by one: quicker in batches.
    """
    flow = motion[0].prepared()
    way = moving(flow, motion[1])
    elements = isinstance(way, Fast)
    state = begin(flow, start)
    first = on_constraints(way, t[0], _taken_apart(state) if elements else state)

    if method in METHODS:
        states = equal_steps(
            lambda at, h, state: step(way, method, True, at, h, state)[0], lambda at, state: state, t, first, steps
        )
        if elements:
            first, states = _put_together(first), _put_together(states)
    else:
        states = equal_steps(
            lambda at, h, carry: alpha_step(flow, at, h, carry),
            lambda at, carry: State(carry.q, carry.v, *settled(flow, at, carry.q, carry.v)),
            t, start_alpha(flow, t[0], first.q, first.v), steps,
        )  # fmt: skip
    states = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, states)
    zero = jnp.zeros((), jnp.int32)
    kept = Kept(states, t, jnp.zeros(len(t)), jnp.zeros(len(t), jnp.int32))
    smooth, status = told(top, flow, t, start, kept, None, ())
    steps_made = jnp.asarray(steps * (len(t) - 1), jnp.int32)
    return Run(smooth, {"status": status, "steps": (steps_made, zero)}, start.q, kept if method in METHODS else None)


def told(
    top: Topology, flow: Flow, t: Array, start: Start, kept: Kept, event: Callable | None, parameters: Any
) -> tuple[dict[str, Any], Array]:
    """What a simulation says of its states, in the coordinates of the system; whether they meet the constraints."""
    states, status = kept.state, kept.status
    end = jnp.where(kept.t[-1] == t[-1], t[-1], lax.stop_gradient(kept.t[-1]))
    if event is not None:
        states, end = _at_event(happening(flow, event), parameters, kept, end)
    first = states.q[0], states.v[0]
    whole = jnp.isfinite(states.q).all(axis=1) & jnp.isfinite(states.v).all(axis=1)
    whole = jnp.cumprod(whole.astype(int)) > 0
    qs, vs = (jnp.where(whole[:, None], x, x0) for x, x0 in ((states.q, first[0]), (states.v, first[1])))
    apart = jnp.cumsum(~(whole & (states.gap <= _APART * flow.dyn.eq.length))) > 0
    status = jnp.where((status == 0) & apart, int(Status.CAME_APART), status)
    ok = status == 0
    reached = jnp.max(jnp.where(apart, t[0], t))
    rows = jax.vmap(flow.all_rows)(states.multipliers)
    if start.places is not None:
        miss = largest(first[1][np.array(start.places)] - start.wanted)
    else:
        miss = jnp.zeros(()) if start.v is None else largest(lower(top, first[1] - start.v))
    smooth = {
        "poses": lower(top, qs),
        "rates": (lower(top, vs), lower(top, jnp.where(ok[:, None], states.a, 0.0))),
        "asked": jax.vmap(lambda t: flow.prescribed(t)[0])(t),
        "residual": jnp.where(whole, states.gap, jnp.nan),
        "end": jnp.where(apart.any(), jnp.minimum(end, reached), end),
        "multipliers": jnp.where(ok[:, None], rows, 0.0),
        "violation": (jnp.max(jnp.where(ok, states.gap, 0.0)), jnp.max(jnp.where(ok, states.slip, 0.0))),
        "correction": (largest(lower(top, first[0] - start.q)), miss),
    }
    return smooth, status
