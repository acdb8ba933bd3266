"""Simulations as functions of all their numbers, with a program for each direction of differentiation.

Forward, a run is differentiated as it stands. In reverse its steps are gone through: equal steps were kept, if they are
not too many, others are made again, interval by interval. What does not depend on its states (the equations of the
design, the start) is differentiated once, at the states that the run has found. A stage of a step is pulled back by the
implicit function theorem, see `ReplayedFlow`.
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
from jaxnc.compiling import filter_jit, is_outermost, jit, on_device
from jaxnc.dynamics.design import Origin, host_differentiates, join_parameters, pull_back_design, request_pull_back
from jaxnc.dynamics.extended import is_concrete, lift, lift_rates, lower
from jaxnc.dynamics.flow import Flow, Law, StageSolution
from jaxnc.dynamics.friction import has_friction
from jaxnc.dynamics.integrate import START, Control, History, Integration, pull_back
from jaxnc.dynamics.runs import (
    Run,
    RunNumbers,
    SimulationSpec,
    Start,
    choose_form,
    keeps_trail,
    prepare_form,
    recall,
    run_equal,
    run_marched,
    summarise,
)
from jaxnc.dynamics.saddle import saddle
from jaxnc.dynamics.start import (
    Rates,
    attach_drawing,
    begin_pose,
    determines_pose,
    rates_on_host,
    start_rates,
    still_coordinates,
)
from jaxnc.dynamics.steps import METHODS, MotionState, step
from jaxnc.internals import evaluate_at_once
from jaxnc.records import record
from jaxnc.solvers.newton import attach_pose
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.equations import Equations
from jaxnc.system.precision import numbers as numbers_as
from jaxnc.types import Array, Numbers, PyTree

_WHOLE = ("violation", "correction", "steps", "end")
"""Fields of a run that are not of each time."""


# -- stages -----------------------------------------------------------------------------------------------------------


class StageMiss(NamedTuple):
    """Misses of the scaled equations of a stage, ``M c + Jᵀ λ = f, J c = g``; or changes of them, the adjoint."""

    forces: Array  # of the unknown coordinates (n,)
    rows: Array  # (m,)
    gap: Array  # the largest residual of the rows
    slip: Array  # the largest of their rates
    driven: Array  # changes of the driven coordinates (driven,)


@record
class ReplayedFlow:
    """A motion whose stages are solved already, and only get their derivatives: the implicit function theorem.

    A solution (accelerations, or what brings a pose or its rates back onto the constraints) solves
    ``M c + Jᵀ λ = f, J c = g``. What it changes by is found by the same matrix, from changes of what the equations are
    off by where the solution stands as a constant.
    """

    flow: Flow  # the motion, with its matrices prepared
    law: Law  # its numbers, by which it is differentiated

    def impose(self, t: Array, q: Array, v: Array) -> tuple[Array, Array]:
        """Put the state where the drives have it, as `Flow.impose`."""
        return dataclasses.replace(self.flow, drive_args=self.law.drive_args).impose(t, q, v)

    def solve_stage(self, stage: Array, t: Array, q: Array, v: Array, known: StageSolution) -> StageSolution:
        """Return a solution of `Flow.solve_stage` that was found before, with its derivatives."""
        return _replay(self.flow, self.law, stage, t, q, v, known)


@jax.custom_vjp
def _replay(flow: Flow, law: Law, stage: Array, t: Array, q: Array, v: Array, known: StageSolution) -> StageSolution:
    return known


def _replay_forward(*args: PyTree) -> tuple[StageSolution, tuple]:
    return args[-1], args


def _replay_back(args: tuple, change: StageSolution) -> tuple:
    flow, law, stage, t, q, v, known = args
    u, driven, (weight, size, inner) = flow.view.unknown, flow.view.known, flow.scale()
    # One refinement does: after a thousand steps a gradient is as good as with three, to 1e-13.
    solve = saddle(inner, flow.stage_equations(stage, t, q, v)[0], flow.redundant, 1)
    a, b = solve(change.change[u] / weight, change.multipliers * size)
    _, pull = jax.vjp(lambda *x: _miss(flow, stage, known, *x), law, t, q, v)
    of_law, *of_state = pull(StageMiss(a, b, change.gap, change.slip, change.change[driven]))
    return None, of_law, None, *of_state, None


def _miss(flow: Flow, stage: Array, known: StageSolution, law: Law, t: Array, q: Array, v: Array) -> StageMiss:
    """Return what the equations of a stage are off by where its solution is `known`."""
    u, driven, (weight, size, _) = flow.view.unknown, flow.view.known, flow.scale()
    j, f, g, base, rows = law.put(flow).stage_equations(stage, t, q, v)
    # What is driven stands in the right-hand sides.
    pushed = (law.mass @ known.change.at[driven].set(0.0))[u] / (weight * size) + j.T @ (known.multipliers / size)
    off = g - j @ (weight * known.change[u])
    return StageMiss(f - pushed, off, _peak(rows.values), _peak(rows.slip), base[driven])


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


def _start_and_history(smooth: PyTree, other: PyTree) -> tuple[Array, History]:
    """Put start and history of a run together from its arrays."""
    start, *states = smooth[_SMOOTH.num_leaves :]
    return start, History(MotionState(*states), *other[_OTHER.num_leaves :])


def _without_trail(other: PyTree) -> list:
    """Return the arrays of a run that are not differentiated, without those of its trail."""
    return list(other[: _OTHER.num_leaves + 3])


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
    if known and spec.method in METHODS and host_differentiates(spec.topology):
        return _pull_back_known(question, numbers, smooth, other, change)
    return _pull_back_traced(question, *map(list, (x, rest, smooth, other, change)))


@functools.partial(jit, static_argnums=0)
def _pull_back_traced(question: _Question, x: list, rest: list, smooth: list, other: list, change: list) -> list:
    """Pull back a run of traced numbers; to differentiate that, steps are made again, as the trail is a constant."""
    bare = _without_trail(other)
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
    if spec.method not in METHODS:
        _, pull = jax.vjp(lambda x: _leaves(_run_traced(spec, question.numbers(x, rest)))[0], x)
        return pull(change)[0]
    flow, at = _flow(spec, numbers), _start_and_history(smooth, other)[0]
    bars = _pull_back_run(spec, flow, numbers, smooth, other, change)
    if not host_differentiates(spec.topology):
        return _pull_back_beginning(question, x, rest, at, bars)
    bars = jax.tree.unflatten(jax.tree.structure(Law.of(flow)), bars[0]), *bars[1:]
    return _requested_pull_back(question)(x, rest, flow.dyn.eq, at, bars)


def _pull_back_known(question: _Question, numbers: RunNumbers, smooth: PyTree, other: PyTree, change: PyTree) -> list:
    """Pull back a run of known numbers: the host knows how the numbers of a motion change with the design."""
    spec, at = question.spec, np.asarray(_start_and_history(smooth, other)[0])
    flow = _flow(spec, numbers)
    bars = jax.tree.map(np.asarray, _pull_back_run(spec, flow, numbers, list(smooth), list(other), list(change)))
    bars = jax.tree.unflatten(jax.tree.structure(Law.of(flow)), bars[0]), *bars[1:]
    origin = _origin(spec, numbers.state)
    found = pull_back_design(spec, origin, numbers.parameters, flow.dyn.eq, at, bars[1], bars[0])
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
        return _parts(flow), pose, numbers.rates, numbers.t, _real(numbers.event)

    return jax.vjp(beginning, x)[1]((jax.tree.leaves(bars[0]), *bars[1:]))[0]


@functools.lru_cache(maxsize=64)
def _requested_pull_back(question: _Question) -> Callable[[list, list, Equations, Array, tuple], list]:
    """Return `_pull_back_beginning` with the host's share; XLA's where it is map_request or differentiated."""

    @custom_vmap
    def request(x, rest, eq, at, bars):
        numbers = question.numbers(x, rest)
        origin = _origin(question.spec, numbers.state)
        found = request_pull_back(question.spec, origin, numbers.parameters, eq, at, bars[1], bars[0])
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
    law_bar, pose_bar, rates_bar, t_bar, event_bar = bars
    state = numbers.state
    of_design, of_known = join_parameters(numbers.parameters, found, law_bar.own)
    if _is_drawn(state):
        pose_bar = jax.tree.map(lambda a: 0.0 * a, state)
        if by_known:
            pose_bar = dict(zip(state, of_known, strict=True))
    event = _with_real(numbers.event, event_bar)
    made = RunNumbers(of_design, pose_bar, rates_bar, t_bar, event, law_bar.drive_args, None)
    whole = jax.tree.leaves(made), jax.tree.leaves(numbers._replace(control=None)), question.smooth
    return [a.astype(jnp.result_type(b)) for a, b, real in zip(*whole, strict=False) if real]


def _origin(spec: SimulationSpec, state: Any) -> Origin:
    """Say what a start follows from: some coordinates, the drawing but for some, or, given as a pose, nothing."""
    top = spec.topology
    if not _is_drawn(state):
        return None
    if state and determines_pose(spec, state):
        return plan(top.extended or top, tuple(state), (), spec.degrees_of_freedom)
    return still_coordinates(top, state)


@functools.partial(jit, static_argnums=0)
def _pull_back_run(
    spec: SimulationSpec, flow: Flow, numbers: RunNumbers, smooth: PyTree, other: Any, change: Any
) -> tuple[list, Array, Array | None, Array, list]:
    """Pull a change of a run back to its motion, start, rates, times, and the event's real numbers.

    `smooth` are the arrays of the run that are differentiated, `other` the rest. The change of the start is that of the
    pose with its hidden vectors, if it was assembled.
    """
    (at, history), (at_bar, history_bar) = _start_and_history(smooth, other), _start_and_history(change, other)
    drawn, rates, t, parameters = _is_drawn(numbers.state), numbers.rates, numbers.t, numbers.event
    pose = at if drawn else numbers.state
    fields_bar, top = jax.tree.unflatten(_SMOOTH, change[: _SMOOTH.num_leaves]), spec.topology
    moved = _parts(flow), pose, rates, t, _real(parameters)

    def beginning(parts, pose, rates, t, event):
        now = _with_parts(flow, parts)
        find_rates = functools.partial(_named_rates, settled=not drawn or bool(spec.drives))
        start = _start(spec, now, pose if drawn else lift(top, pose), rates, t, find_rates)
        return start._replace(places=None), start.state(now)

    def ending(parts, start, t, event, states):
        start, event = start._replace(places=spec.places), _with_real(parameters, event)
        return summarise(top, _with_parts(flow, parts), t, start, history._replace(state=states), spec.event, event)[0]

    (start, first), back = jax.vjp(beginning, *moved)
    parts, event = moved[0], moved[4]
    _, finish = jax.vjp(ending, parts, start, t, event, history.state)
    parts_bar, start_bar, t_bar, event_bar, states_bar = finish(fields_bar)
    states_bar = jax.tree.map(jnp.add, states_bar, history_bar.state)
    advance, again = _replayed_steps(flow, spec.method)
    job = Integration(advance, spec.method, parts, numbers.control, t)
    known = None if history.trail is None else functools.partial(recall, flow, spec.method)
    more, first_bar, t_more = pull_back(job, again, first, history, states_bar, known)
    found = back((start_bar._replace(q=start_bar.q + at_bar), first_bar))
    still = jax.tree.map(jnp.zeros_like, moved[1:3])
    return jax.tree.map(lambda *x: sum(x[1:], x[0]), found, (parts_bar, *still, t_bar, event_bar), (
        more, *still, t_more, jax.tree.map(jnp.zeros_like, event)))  # fmt: skip


def _parts(flow: Flow) -> list:
    """List the numbers that a motion is differentiated by."""
    return jax.tree.leaves(flow if has_friction(flow.dyn) else Law.of(flow))


def _with_parts(flow: Flow, parts: list) -> Flow:
    """Return a motion with these numbers."""
    if has_friction(flow.dyn):
        return jax.tree.unflatten(jax.tree.structure(flow), parts)
    return jax.tree.unflatten(jax.tree.structure(Law.of(flow)), parts).put(flow)


def _replayed_steps(flow: Flow, method: str) -> tuple[Callable, Callable]:
    """Return the functions by which `pull_back` makes steps of a motion again and differentiates them."""
    ready = flow.prepare()
    if has_friction(flow.dyn) or METHODS[method].implicit:

        def advance(parts, t, h, state):
            return step(prepare_form(_with_parts(flow, parts))[1], method, True, t, h, state)[:2]

        return advance, lambda *x: advance(*x)[0]

    def first(parts, t, h, state):
        end, errors, phases = step(ready, method, True, t, h, state)
        return end, errors, phases.solution

    def again(parts, t, h, state, solutions):
        replayed: Any = ReplayedFlow(ready, Law.of(_with_parts(flow, parts)))
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
            return rule(question, x, *more)

    return inner


_RULES = Rules(*map(_in_its_numbers, (_value, _tangent, _cotangent)))
