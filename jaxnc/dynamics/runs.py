"""The programs of a simulation: from a start to the states at all times, and what became of each."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.compiling import filter_jit
from jaxnc.dynamics import state as seen
from jaxnc.dynamics.extended import lift, lift_rates, lower
from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.friction import settled
from jaxnc.dynamics.integrate import Control, Course, equal_steps, integrate
from jaxnc.dynamics.runge_kutta import METHODS, State, on_constraints, step
from jaxnc.dynamics.steppers import STEPPERS
from jaxnc.dynamics.ways import Other, moving
from jaxnc.dynamics.written import Fast
from jaxnc.solvers.newton import largest
from jaxnc.status import Status
from jaxnc.system.topology import Topology
from jaxnc.types import Array

_APART = 1e-3  # of the mechanism's size: a simulation that meets its constraints worse has come apart


class Start(NamedTuple):
    """Where a simulation begins.

    Attributes:
        q: the pose as given, in the coordinates of the system, ``(N,)``.
        v: rates, consistent with it, in the coordinates of the dynamics; or those of a pose, ``(N,)``; or None at rest.
        places: of rates that were given by name, where they are among the coordinates of the dynamics.
        wanted: their values.
    """

    q: Any
    v: Any
    places: tuple[int, ...] | None
    wanted: Any


def _state(top: Topology, flow: Flow, start: Start) -> State:
    q = lift(top, start.q)
    v = jnp.zeros_like(q) if start.v is None else start.v
    if v.shape != q.shape:
        v = lift_rates(top, start.q, v)
    return State(q, v, jnp.zeros_like(q), flow.no_multipliers(), jnp.zeros(()), jnp.zeros(()))


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
    derivative: str | None,
) -> dict[str, Any]:
    """A run whose steps follow its errors; or of equal steps, if it is not differentiated.

    Args:
        top: the system's topology.
        motion: the motion, in written-out form too where that is wanted.
        method: a key of `METHODS`.
        t: times, ``(T,)``.
        start: the start.
        control: how long steps are.
        event: ``(t, state, parameters) -> number`` whose sign change ends the motion, or None.
        parameters: what the event is given.
        derivative: ``"reverse"`` or ``"forward"``; None if there is none.

    Returns:
        Fields of a `Simulation`.
    """
    flow, fast = motion[0].prepared(), motion[1]
    way, begin = moving(flow, fast, method), _state(top, flow, start)
    leaves, structure = jax.tree.flatten(way)

    def advance(leaves, t, h, state):
        return step(jax.tree.unflatten(structure, leaves), method, True, t, h, state)

    def happens(parameters, t, state):
        return jnp.asarray(event(t, seen.State(flow.dyn.topology, t, state.q, state.v), parameters), float)  # pyright: ignore

    arguments: Any = (leaves, parameters, control)
    made, happening = advance, None if event is None else happens
    if derivative == "reverse":  # a rule of its own may not close over what is traced
        pure, more = jax.closure_convert(advance, leaves, t[0], t[0], begin)
        asked, much = jax.closure_convert(happens, parameters, t[0], begin) if event else (None, [])
        arguments = ((leaves, more), (parameters, much), control)
        made = lambda m, t, h, s: pure(m[0], t, h, s, *m[1])  # noqa: E731
        happening = None if asked is None else lambda p, t, s: asked(p[0], t, s, *p[1])
    states, status, course = integrate(made, method, happening, arguments, t, begin, derivative == "reverse")
    end = course.t
    if event is not None and derivative is not None:
        states, end = _at_event(happens, parameters, states, status, course)
    return _told(top, flow, t, start, states, status, end, (*course.made,))


def _at_event(happens: Callable, parameters: Any, states: State, status: Array, course: Course) -> tuple[State, Array]:
    """States and end of a motion that an event has ended, with the derivatives of when it did."""
    t, state = lax.stop_gradient(course.t), course.state
    value = happens(parameters, t, state)
    _, rate = jax.jvp(
        lambda t, q, v: happens(parameters, t, state._replace(q=q, v=v)), (t, state.q, state.v),
        (jnp.ones(()), state.v, state.a),
    )  # fmt: skip
    stopped = course.status == int(Status.STOPPED)
    late = -jnp.where(stopped, value, 0.0) / lax.stop_gradient(jnp.where(stopped, rate, 1.0))
    late = late - lax.stop_gradient(late)
    over = jnp.where(status == int(Status.STOPPED), late, 0.0)[:, None]
    end = jnp.where(stopped, t + late, course.t)
    return states._replace(q=states.q + over * states.v, v=states.v + over * states.a), end


@filter_jit
def equal(
    top: Topology, motion: tuple[Flow, Fast | None], method: str, t: Array, start: Start, steps: int, apart: bool
) -> dict[str, Any]:
    """A run of so many equal steps between two times; arguments and result as of `controlled`.

    Elements of what is written out are carried one by one if `apart`: quicker in batches, slower to differentiate.
    """
    flow, fast = motion[0].prepared(), motion[1]
    way, begin = moving(flow, fast, method), _state(top, flow, start)

    plain = moving(flow, fast, "rk4")
    elements = isinstance(plain, Fast) and apart
    first = on_constraints(plain, t[0], _taken_apart(begin) if elements else begin)

    def whole(at, q, v) -> State:
        return State(q, v, *settled(flow, at, q, v))

    if method in STEPPERS:
        starting, stepping = STEPPERS[method]
        states = equal_steps(
            lambda at, h, carry: stepping(flow, at, h, carry),
            lambda at, carry: whole(at, carry.q, carry.v),
            t, starting(flow, t[0], first.q, first.v), steps,
        )  # fmt: skip
    elif method in METHODS:
        states = equal_steps(
            lambda at, h, state: step(way, method, True, at, h, state)[0], lambda at, state: state, t, first, steps
        )
        if elements:
            first, states = _put_together(first), _put_together(states)
    else:

        def advance(at, h, state):
            found = Other(flow, method, 0.5 / h)
            return step(found, "rk4", method == "null space", at, h, state)[0]

        states = equal_steps(advance, lambda at, state: whole(at, state.q, state.v), t, first, steps)
    states = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, states)
    status, made = jnp.zeros(len(t), int), jnp.asarray(steps * (len(t) - 1))
    return _told(top, flow, t, start, states, status, t[-1], (made, jnp.zeros((), int)))


def _told(
    top: Topology, flow: Flow, t: Array, start: Start, states: State, status: Array, end: Array, steps: tuple
) -> dict[str, Any]:
    """What a simulation says of its states, in the coordinates of the system; whether they meet the constraints."""
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
        miss = jnp.zeros(()) if start.v is None else largest(lower(top, first[1]) - _shown(top, start.v))
    return {
        "poses": lower(top, qs),
        "rates": (lower(top, vs), lower(top, jnp.where(ok[:, None], states.a, 0.0))),
        "asked": jax.vmap(lambda t: flow.prescribed(t)[0])(t),
        "residual": jnp.where(whole, states.gap, jnp.nan),
        "status": status,
        "end": jnp.where(apart.any(), jnp.minimum(end, reached), end),
        "multipliers": jnp.where(ok[:, None], rows, 0.0),
        "violation": (jnp.max(jnp.where(ok, states.gap, 0.0)), jnp.max(jnp.where(ok, states.slip, 0.0))),
        "correction": (largest(lower(top, first[0]) - start.q), miss),
        "steps": steps,
    }


def _shown(top: Topology, v: Array) -> Array:
    """Rates in the coordinates of the system."""
    return v if v.shape[-1] == len(top.coordinates) else lower(top, v)
