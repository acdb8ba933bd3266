"""Simulations as functions of all their numbers, with a program for each direction of differentiation.

In reverse a run is gone through again, interval by interval; what does not depend on its states (the equations of the
design, the start) is differentiated once, at the states that the run has found.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import custom_vmap

from jaxnc.autodiff import Rules, custom_jvp_vjp
from jaxnc.autodiff import attach as attach_derivative
from jaxnc.compiling import alone, jit, on_device
from jaxnc.dynamics import design, redesign, runs
from jaxnc.dynamics.adjoint import Law, Recalled
from jaxnc.dynamics.asked import Asked, Numbers, flow_of
from jaxnc.dynamics.backward import pulled_back
from jaxnc.dynamics.extended import known, lift, lift_rates
from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.friction import has_friction
from jaxnc.dynamics.initial import as_drawn, exact, pose_of, start_rates, still
from jaxnc.dynamics.integrate import Control, Kept
from jaxnc.dynamics.runge_kutta import METHODS, State, noted
from jaxnc.dynamics.runs import Run, Start
from jaxnc.dynamics.ways import moving
from jaxnc.internals import evaluate_at_once
from jaxnc.solvers.newton import attach
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.equations import Equations
from jaxnc.system.precision import numbers as numbers_as
from jaxnc.system.system import System
from jaxnc.types import Array


def simulated(asked: Asked, numbers: Numbers, known: Callable[[Asked, Numbers], Run]) -> dict[str, Any]:
    """Fields of a `Simulation`, differentiable in both directions."""
    leaves, structure = jax.tree.flatten(numbers._replace(control=None))
    smooth = tuple(map(_is_real, leaves))
    x = [
        a if isinstance(a, jax.Array) else on_device(np.asarray(a))
        for a, real in zip(leaves, smooth, strict=True)
        if real
    ]
    rest = [a for a, real in zip(leaves, smooth, strict=True) if not real]
    what = _What(asked, structure, smooth, known)
    found, other = custom_jvp_vjp(_RULES, what, x, [*rest, *numbers.control])
    fields = jax.tree.unflatten(_SMOOTH, found[: _SMOOTH.num_leaves])
    return fields | jax.tree.unflatten(_OTHER, other[: _OTHER.num_leaves])


class _What(NamedTuple):
    """The static part of the arguments, how the arrays are put together, and how a run is made of known ones."""

    asked: Asked
    structure: Any
    smooth: tuple[bool, ...]
    known: Callable[[Asked, Numbers], Run]

    def numbers(self, x: Any, rest: Any) -> Numbers:
        """All numbers, from those that are differentiated and those that are not."""
        count = len(Control._fields)
        each, others = iter(x), iter(rest[: len(rest) - count])
        leaves = [next(each) if real else next(others) for real in self.smooth]
        return jax.tree.unflatten(self.structure, leaves)._replace(control=Control(*rest[len(rest) - count :]))


_TWO = (0, 0)
_SMOOTH = jax.tree.structure(
    {"poses": 0, "rates": _TWO, "asked": 0, "residual": 0, "end": 0, "multipliers": 0, "violation": _TWO,
     "correction": _TWO}
)  # fmt: skip
_OTHER = jax.tree.structure({"status": 0, "steps": _TWO})


def _leaves(run: Run) -> tuple[list, list]:
    """What of a run is differentiated, and what is not."""
    states, rest = (None, None) if run.kept is None else (run.kept.state, run.kept._replace(state=None))
    return jax.tree.leaves((run.smooth, run.start, states)), jax.tree.leaves((run.other, rest))


def _put_together(smooth: Any, other: Any) -> tuple[Array, Kept]:
    """The start and what is kept, of a run's leaves."""
    start, *states = smooth[_SMOOTH.num_leaves :]
    return start, Kept(State(*states), *other[_OTHER.num_leaves :])


def _value(what: _What, x: Any, rest: Any) -> tuple[list, list]:
    if alone(x, rest):
        with evaluate_at_once():
            return _leaves(what.known(what.asked, what.numbers(x, rest)))
    return _traced(what, x, rest)


@functools.partial(jit, static_argnums=0)
def _traced(what: _What, x: list, rest: list) -> tuple[list, list]:
    return _leaves(_run(what.asked, what.numbers(x, rest)))


def _run(asked: Asked, numbers: Numbers) -> Run:
    """A run of numbers that are not known."""
    flow, start = _begun(asked, numbers)
    motion = flow, runs.written_out(flow, asked.degrees_of_freedom, asked.method)
    top, method, t = asked.topology, asked.method, numbers.t
    if asked.steps:
        return runs.equal(top, motion, method, t, start, asked.steps)
    return runs.controlled(top, motion, method, t, start, numbers.control, asked.event, numbers.event)


def _begun(asked: Asked, numbers: Numbers) -> tuple[Flow, Start]:
    """The motion and its start."""
    system = asked.system(numbers.parameters)
    flow = dataclasses.replace(flow_of(asked, system), more=numbers.more)
    pose = pose_of(system, numbers.state) if _is_drawn(numbers.state) else numbers.state
    return flow, _start(asked, flow, lift(asked.topology, pose), numbers.rates, numbers.t, True)


def _is_drawn(state: Any) -> bool:
    """Whether a start is assembled, from the drawing or from values by name."""
    return state is None or isinstance(state, dict)


def _start(asked: Asked, flow: Flow, q: Array, rates: Any, t: Array, settled: bool) -> Start:
    """The start at a pose with its hidden vectors; `settled` as of `start_rates`, and the pose too."""
    top = asked.topology
    if rates is None:
        return Start(q, None, None, None)
    if asked.places is None:
        return Start(q, lift_rates(top, runs.lower(top, q), rates), None, None)
    imposed, _ = flow.impose(t[0] * 0.0, q, q)
    if settled:
        imposed = flow.project_position(imposed, 3 if flow.drives else 2)
    return Start(q, start_rates(top, flow, imposed, (asked.places, rates), settled)[0], asked.places, rates)


def _origin(asked: Asked, state: Any) -> design.Origin:
    """Say what a start follows from: some coordinates, the drawing but for some, or, given as a pose, nothing."""
    top = asked.topology
    if not _is_drawn(state):
        return None
    if state and exact(asked, state):
        return plan(top.extended or top, tuple(state), (), asked.degrees_of_freedom)
    return still(top, state)


def _attached(asked: Asked, flow: Flow, system: System, state: Any, at: Array) -> Array:
    """The start with its hidden vectors, and the derivatives that an assembled one has."""
    origin = _origin(asked, state)
    if origin is None:
        return state
    eq, at = flow.dyn.eq, jax.lax.stop_gradient(at)
    if isinstance(origin, Plan):
        return attach(origin, at, eq, jnp.stack([jnp.asarray(x, float) for x in state.values()]))
    return lift(asked.topology, as_drawn(system, runs.lower(asked.topology, at), state))


def _tangent(what: _What, x: Any, rest: Any, smooth: Any, other: Any, change: Any) -> list:
    return _pushed(what, list(x), list(rest), list(change))


@functools.partial(jit, static_argnums=0)
def _pushed(what: _What, x: list, rest: list, change: list) -> list:
    return jax.jvp(lambda x: _leaves(_run(what.asked, what.numbers(x, rest)))[0], (x,), (change,))[1]


def _cotangent(what: _What, x: Any, rest: Any, smooth: Any, other: Any, change: Any) -> list:
    top, numbers = what.asked.topology, what.numbers(x, rest)
    here = alone(x, rest, smooth, other, change) and known(numbers)
    if here and what.asked.method in METHODS and not top.loads.friction and redesign.suits(top):
        return _pulled_back_on_host(what, numbers, smooth, other, change)
    return _pulled_back(what, list(x), list(rest), list(smooth), list(other), list(change))


@functools.partial(jit, static_argnums=0)
def _pulled_back(what: _What, x: list, rest: list, smooth: list, other: list, change: list) -> list:
    """`Rules.cotangent` of a simulation."""
    asked = what.asked
    if asked.method not in METHODS:
        _, pull = jax.vjp(lambda x: _leaves(_run(asked, what.numbers(x, rest)))[0], x)
        return pull(change)[0]
    at, _ = _put_together(smooth, other)

    numbers = what.numbers(x, rest)
    flow = dataclasses.replace(flow_of(asked, asked.system(numbers.parameters)), more=numbers.more)
    drawn = _is_drawn(numbers.state)
    moved = _parts(flow), at if drawn else numbers.state, numbers.rates, numbers.t, _real(numbers.event)
    found = _through(asked, drawn, flow, moved, (numbers.event, numbers.control), smooth, other, change)
    if has_friction(flow.dyn) or not redesign.suits(asked.topology):
        return _by_xla(what, x, rest, at, found)
    law_bar = jax.tree.unflatten(jax.tree.structure(Law.of(flow)), found[0])
    return _by_host(what)(x, rest, flow.dyn.eq, at, (law_bar, *found[1:]))


def _by_xla(what: _What, x: list, rest: list, at: Array, bars: tuple) -> list:
    """What changes of a motion, its start, rates, times and event mean for the numbers that these are made of."""

    def beginning(x: list) -> tuple:
        numbers = what.numbers(x, rest)
        system = what.asked.system(numbers.parameters)
        flow = dataclasses.replace(flow_of(what.asked, system), more=numbers.more)
        pose = _attached(what.asked, flow, system, numbers.state, at)
        return _parts(flow), pose, numbers.rates, numbers.t, _real(numbers.event)

    return jax.vjp(beginning, x)[1]((jax.tree.leaves(bars[0]), *bars[1:]))[0]


@functools.lru_cache(maxsize=64)
def _by_host(what: _What) -> Callable[[list, list, Equations, Array, tuple], list]:
    """`_by_xla` with the design's share from the host; XLA's where it is mapped or differentiated once more."""

    @custom_vmap
    def asked(x, rest, eq, at, bars):
        numbers = what.numbers(x, rest)
        origin = _origin(what.asked, numbers.state)
        found = design.asked_back(what.asked, origin, numbers.parameters, eq, at, bars[1], bars[0])
        if found is None:
            return _by_xla(what, x, rest, at, bars)
        return _bars(what, numbers, found, bars, isinstance(origin, Plan))

    @asked.def_vmap
    def mapped(size, which, x, rest, eq, at, bars):
        axes = jax.tree.map(lambda has: 0 if has else None, (which[0], which[1], which[3], which[4]))
        with numbers_as(at):
            found = jax.vmap(functools.partial(_by_xla, what), in_axes=axes, axis_size=size)(x, rest, at, bars)
        return found, [True] * len(found)

    def back(x: list, rest: list, eq: Equations, at: Array, bars: tuple) -> list:
        value = asked(*lax.stop_gradient((x, rest, eq, at, bars)))
        return attach_derivative(_back_change, what, value, x, rest, at, bars)

    return back


def _back_change(what: _What, value: list, args: tuple, changes: tuple) -> list:
    x, rest, at, bars = args
    with numbers_as(at):
        by = (x, at, bars), (changes[0], changes[2], changes[3])
        return jax.jvp(lambda x, at, bars: _by_xla(what, x, rest, at, bars), *by)[1]


def _bars(what: _What, numbers: Numbers, found: Any, bars: tuple, by_known: bool) -> list:
    """What was found of the design and of a start's known coordinates, and what needs none, as the real numbers."""
    law_bar, pose_bar, rates_bar, t_bar, event_bar = bars
    par, state = numbers.parameters, numbers.state
    count = sum(np.size(getattr(par, name)) for name in ("points", "vectors", "markers", "dimensions", "physical"))
    if _is_drawn(state):
        pose_bar = jax.tree.map(lambda a: 0.0 * a, state)
        if by_known:
            pose_bar = dict(zip(state, found[count:], strict=True))
    of_design = design.taken_apart(par, found, law_bar.own)
    event = _with_real(numbers.event, event_bar)
    made = Numbers(of_design, pose_bar, rates_bar, t_bar, event, law_bar.more, None)
    leaves = [x for x, real in zip(jax.tree.leaves(made), what.smooth, strict=True) if real]
    wanted = [x for x, real in zip(jax.tree.leaves(numbers._replace(control=None)), what.smooth, strict=True) if real]
    return [a.astype(jnp.result_type(b)) for a, b in zip(leaves, wanted, strict=True)]


@functools.partial(jit, static_argnums=(0, 1))
def _through(
    asked: Asked, drawn: bool, flow: Flow, moved: tuple, fixed: tuple, smooth: Any, other: Any, change: Any
) -> tuple:
    """What a change of a run means for what it is made of: its motion, start, rates, times, and the event's numbers.

    `drawn` says whether the start was assembled, and comes with its hidden vectors. `moved` are `_parts` of the motion,
    the start, its rates, times, and real numbers of the event; `smooth` is what is differentiated of the run, `other`
    what is not.
    """
    (_, kept), (at_bar, kept_bar) = _put_together(smooth, other), _put_together(change, other)
    fields_bar = jax.tree.unflatten(_SMOOTH, change[: _SMOOTH.num_leaves])
    given, control = fixed
    top = asked.topology

    def beginning(parts, pose, rates, t, event):
        now = _with_parts(flow, parts)
        q = pose if drawn else lift(top, pose)
        start = _start(asked, now, q, rates, t, not drawn or bool(asked.drives))
        return start._replace(places=None), runs.begin(now, start)

    def ending(parts, start, t, event, states):
        start, event = start._replace(places=asked.places), _with_real(given, event)
        now, found = _with_parts(flow, parts), kept._replace(state=states)
        return runs.told(top, now, t, start, found, asked.event, event)[0]

    (start, first), back = jax.vjp(beginning, *moved)
    parts, _, _, t, event = moved
    _, finish = jax.vjp(ending, parts, start, t, event, kept.state)
    parts_bar, start_bar, t_bar, event_bar, states_bar = finish(fields_bar)
    states_bar = jax.tree.map(jnp.add, states_bar, kept_bar.state)
    advance, again = _stepping(flow, asked.method)
    more, first_bar, t_more = pulled_back(advance, again, asked.method, parts, control, t, first, kept, states_bar)
    found = back((start_bar._replace(q=start_bar.q + at_bar), first_bar))
    return jax.tree.map(lambda *x: sum(x[1:], x[0]), found, (parts_bar, *_zeros(moved[1:3]), t_bar, event_bar), (
        more, *_zeros(moved[1:3]), t_more, _zeros(event)))  # fmt: skip


def _zeros(tree: Any) -> Any:
    return jax.tree.map(jnp.zeros_like, tree)


def _pulled_back_on_host(what: _What, numbers: Numbers, smooth: Any, other: Any, change: Any) -> list:
    """The same of known numbers: the host knows how those of a motion change with the design."""
    asked, state, at = what.asked, numbers.state, np.asarray(_put_together(smooth, other)[0])
    drawn = _is_drawn(state)
    flow = dataclasses.replace(flow_of(asked, asked.system(numbers.parameters)), more=numbers.more)
    moved = _parts(flow), at if drawn else state, numbers.rates, numbers.t, _real(numbers.event)
    fixed = numbers.event, numbers.control
    bars = jax.tree.map(np.asarray, _through(asked, drawn, flow, moved, fixed, list(smooth), list(other), list(change)))
    law_bar = jax.tree.unflatten(jax.tree.structure(Law.of(flow)), bars[0])
    origin = _origin(asked, state)
    found = design.of_design(asked, origin, numbers.parameters, flow.dyn.eq, at, bars[1], law_bar)
    numbers = jax.tree.map(np.asarray, numbers._replace(control=None))
    return on_device(_bars(what, numbers, found, (law_bar, *bars[1:]), isinstance(origin, Plan)))


def _parts(flow: Flow) -> list:
    """The numbers that a motion is differentiated by."""
    return jax.tree.leaves(flow if has_friction(flow.dyn) else Law.of(flow))


def _with_parts(flow: Flow, parts: list) -> Flow:
    """The motion with these."""
    if has_friction(flow.dyn):
        return jax.tree.unflatten(jax.tree.structure(flow), parts)
    return jax.tree.unflatten(jax.tree.structure(Law.of(flow)), parts).put(flow)


def _stepping(flow: Flow, method: str) -> tuple[Callable, Callable]:
    """How steps of a motion are made again and differentiated.

    Returns:
        A step ``(parts, t, h, state)`` that says what is needed to go back through it, and the same step once more
        with what it has said.
    """
    ready = flow.prepared()
    if has_friction(flow.dyn) or METHODS[method].implicit:

        def advance(parts, t, h, state):
            return noted(moving(_with_parts(flow, parts).prepared(), None, method), method, True, t, h, state)[:2]

        return advance, lambda *x: advance(*x)[0]

    def first(parts, t, h, state):
        return noted(ready, method, True, t, h, state)

    def again(parts, t, h, state, answers):
        law = Law.of(_with_parts(flow, parts))
        return noted(Recalled(ready, law), method, True, t, h, state, answers)[0]

    return first, again


def _is_real(x: Any) -> bool:
    return bool(jnp.issubdtype(jnp.result_type(x), jnp.floating))


def _real(tree: Any) -> list:
    """Leaves that are real numbers."""
    return [x for x in jax.tree.leaves(tree) if _is_real(x)]


def _with_real(tree: Any, real: list) -> Any:
    each = iter(real)
    return jax.tree.map(lambda x: next(each) if _is_real(x) else x, tree)


_RULES = Rules(_value, _tangent, _cotangent)
