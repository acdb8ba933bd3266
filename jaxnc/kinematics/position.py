"""Solving poses: one input, many inputs as lanes, or a sequence followed along its branch; and where it begins."""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.compiling import blame_callback, jit
from jaxnc.errors import AssemblyError, InputError, nearest
from jaxnc.internals import evaluate_at_once, outermost, values_behind
from jaxnc.kinematics import host_solve
from jaxnc.kinematics.inputs import (
    NEVER_MOVES,
    REDUNDANCY,
    check_inputs,
    check_parameters,
    doubt_degrees,
    finite,
    finite_array,
    in_radians,
    make_plan,
    meeting_ends,
    outside,
    rate_values,
    worst_rows,
)
from jaxnc.kinematics.motion import Columns, Motion, coordinates_of, motion_of
from jaxnc.kinematics.spread import Devices, choose, solve_on
from jaxnc.records import with_owner
from jaxnc.solvers import host
from jaxnc.solvers.assembly import derive, evaluate, free_plan, meets, settle, to_host
from jaxnc.solvers.host import view_of
from jaxnc.solvers.plan import Plan, plan
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.status import Status
from jaxnc.system.design import find_traced
from jaxnc.system.equations import Equations, guards, measured, rate_constants, slips, weights
from jaxnc.system.host import HostEquations, from_jax
from jaxnc.system.precision import as_its_system, limits
from jaxnc.system.system import System, characteristic_length
from jaxnc.system.topology import Topology
from jaxnc.types import AnyArray, Array, ArrayLike, Float, Inputs, Numbers
from jaxnc.validate import as_real, call_user

_ITERATIONS = 60
_FROM_DRAWING = 1e-4  # of assemblies equally near to what was given, the one nearest to the drawing counts


class _Question(NamedTuple):
    """A call, checked and brought into one form."""

    system: System
    view: Plan
    values: Array  # of the driven coordinates, (*shape, driven)
    orders: tuple[Array, ...]  # their time derivatives
    time: Array | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        """Leading axes of the poses."""
        return self.values.shape[:-1]

    def answer(self, found: PoseBatch) -> Motion:
        """Make a motion of what was found."""
        shape = self.shape
        return motion_of(
            self.system,
            self.view,
            found.q.with_axes(shape) if isinstance(found.q, Columns) else _with_lead(found.q, shape),
            _with_lead(self.values, shape),
            *(_with_lead(x, shape, 0) for x in (found.status, found.size, found.conditioning)),
            rates=tuple(_with_lead(r, shape) for r in found.rates),
            time=self.time,
        )


def _with_lead(x: Numbers, shape: tuple[int, ...], own: int = 1) -> AnyArray:
    """Put an array's last axes, its own, behind other leading axes."""
    wanted = (*shape, *x.shape[x.ndim - own :])
    return x if x.shape == wanted else x.reshape(wanted)


@public
@as_its_system
def solve_position(
    system: System,
    inputs: Inputs,
    start: Motion | Inputs | None = None,
    branch: Motion | None = None,
    hold: Sequence[str] = (),
    rates: Inputs | None = None,
    accelerations: Inputs | None = None,
    throw: bool | None = None,
    repair: bool = True,
    devices: Devices = None,
    unit: str | None = None,
) -> Motion:
    """Find the pose at given inputs: one pose, or any batch of them as independent lanes.

    Without a start every lane is followed from the assembled drawing along the straight change of the inputs, so that
    it stays on the drawing's branch.

    Args:
        system: the system.
        inputs: value or array of values of each driven coordinate, by name; radians and lengths.
        start: where to begin instead: places of points and values of coordinates by name, or an earlier pose; the
            solution nearest to it is taken. One for all lanes, or one for each (leading axes as those of the inputs).
            What is not given follows from what is: angles and distances from the points, missing points by assembly.
        branch: an earlier pose whose orientation signs the solution must have.
        hold: free coordinates that keep the value they have in the start pose.
        rates: time derivatives of the inputs; the motion then carries velocities and accelerations.
        accelerations: second time derivatives of the inputs.
        throw: raise `AssemblyError` where a pose is not found. Default: only for a single pose outside of traced code.
        repair: have the host follow what the fixed steps of compiled code do not find. False: that is given up with
            `Status.TOO_FAR`, and traced code calls nothing back, so that it can be exported or kept by JAX's cache,
            and is quick about thousands of designs of which most will not do.
        devices: spread the lanes over devices: ``"all"`` of this process, ``"global"`` (those of all processes, see
            `jaxnc.shard`), a number, or a sequence of jax devices. None: one device.
        unit: what angles and their rates (of a `start` by name, too) are given in, ``"rad"`` or ``"deg"``; what is
            returned is in radians.

    Returns:
        The pose or poses, with a status for each. Differentiable with respect to system and inputs.

    Raises:
        InputError: unknown, too many or too few inputs, values that are not finite, devices that are not there.
        AssemblyError: no pose found, if `throw`.
    """
    question, start = _check_call(system, inputs, hold, rates, accelerations, start, unit)
    chosen = None if devices is None else choose(devices)
    solve = functools.partial(_solve_lanes, repair, chosen, branch, throw)
    if chosen is not None or branch is not None:
        return solve(question, start)
    return _solve_question(question, "lanes" if start is None else "guess", start, solve)


def _solve_lanes(
    repair: bool, devices: tuple | None, branch: Motion | None, throw: bool | None, question: _Question, start: Any
) -> Motion:
    """Solve for poses each on its own."""
    system, view, shape = question.system, question.view, question.shape
    eq = derive(system)
    q0: AnyArray = None  # an earlier pose needs no drawing
    if not isinstance(start, Motion):
        q0 = settle(eq, np.zeros(len(system.topology.coordinates)), repair).q
    count, driven = math.prod(shape), len(view.driven)
    flat = question.values.reshape(count, driven)
    orders = tuple(o.reshape(count, driven) for o in question.orders)
    begin = begin_at(system, view, eq, q0, start, question.values)
    if start is not None:
        begin = begin.reshape(count, -1)
    found = _find_poses(view, "lanes" if start is None else "guess", eq, begin, flat, orders, repair, devices)
    motion = question.answer(found)
    if branch is not None:
        motion = _same_branch(view, eq, motion, branch)
    if throw is None:
        throw = shape == () and not isinstance(motion.status, Tracer)
    if throw:
        outside(motion.status, "throw=True")
        _raise_failure(view, eq, motion, start is not None)
    return motion


@public
@as_its_system
def sweep(
    system: System,
    inputs: Inputs,
    rates: Inputs | None = None,
    accelerations: Inputs | None = None,
    hold: Sequence[str] = (),
    start: Motion | Inputs | None = None,
    jerk: bool = False,
    throw: bool = False,
    redundancy: str = REDUNDANCY[0],
    repair: bool = True,
    unit: str | None = None,
) -> Motion:
    """Move a mechanism through a sequence of input values, in order along one branch.

    Steps that are too coarse are subdivided rather than jumped, and the motion stops at a dead point. Values each on
    its own are `solve_position`'s, a way through dead points is `circuit`'s.

    Args:
        system: the system.
        inputs: array of values ``(T,)`` of each driven coordinate; several move together. Radians and lengths.
        rates: time derivatives of the inputs, numbers or arrays ``(T,)``; the motion then carries velocities and
            accelerations.
        accelerations: second time derivatives of the inputs; zero if not given.
        hold: free coordinates that keep the value they have in the start pose.
        start: an earlier pose, or places and values by name, to start from instead of the drawing.
        jerk: also carry third derivatives.
        throw: raise `AssemblyError` if any pose was not found; outside of traced code.
        redundancy: what to do with more constraint rows than unknowns: ``"least squares"`` solves them all together,
            ``"independent rows"`` chooses the best-conditioned independent ones anew in every step.
        repair: have the host follow what the fixed steps of compiled code do not find. False: that is given up with
            `Status.TOO_FAR`, and traced code calls nothing back, so that it can be exported or kept by JAX's cache,
            and is quick about thousands of designs of which most will not do.
        unit: what angles and their rates (of a `start` by name, too) are given in, ``"rad"`` or ``"deg"``; what is
            returned is in radians.

    Returns:
        The motion, with a status for each pose. Differentiable with respect to system, inputs and rates.

    Raises:
        InputError: unknown, too many or too few inputs, no sequence, values that are not finite.
        AssemblyError: a pose failed, if `throw`.
    """
    question, start = _check_call(system, inputs, hold, rates, accelerations, start, unit, redundancy, jerk)
    if len(question.shape) != 1 or question.shape[0] == 0:
        raise InputError(
            f"a sweep needs a sequence of values for its inputs, shape (T,); got shape {question.shape}. "
            f"For one pose or other batches use solve_position"
        )
    return _solve_question(question, "continuation", start, functools.partial(_follow_inputs, repair, throw))


@public
@as_its_system
def motion(
    system: System,
    inputs: Mapping[str, Callable | tuple | ArrayLike],
    t: AnyArray,
    hold: Sequence[str] = (),
    start: Motion | Mapping[str, Any] | None = None,
    jerk: bool = False,
    throw: bool = False,
    repair: bool = True,
    unit: str | None = None,
) -> Motion:
    """Move a mechanism in time.

    Args:
        system: the system.
        inputs: per driven coordinate, a function of time (differentiated exactly), or arrays ``(u, u̇, ü)`` (and ``u⃛``
            for jerk), each a number or ``(T,)``.
        t: times, ``(T,)``, seconds.
        hold: as in `sweep`.
        start: as in `sweep`.
        jerk: also carry third derivatives.
        throw: as in `sweep`.
        repair: as in `sweep`.
        unit: as in `sweep`; a function of time then gives degrees.

    Returns:
        The motion with velocities and accelerations, and ``motion.time``.

    Raises:
        InputError: as in `sweep`; also for an input that is neither a function nor a tuple of arrays.
    """
    t = finite_array(t, "time t")
    if t.ndim != 1 or t.shape[0] == 0:
        raise InputError(f"time t must be a sequence of values, shape (T,); got shape {t.shape}")
    if not isinstance(inputs, Mapping):
        raise InputError(f"inputs are given by name, such as {{'phi': lambda t: 2 * t}}; got {inputs!r}")
    count = 4 if jerk else 3
    doubt_degrees(system, unit, start)
    inputs, start = in_radians(system, unit, inputs, start)
    columns = [_in_time(name, data, t, count) for name, data in inputs.items()]
    names = tuple(inputs)
    doubt_degrees(system, unit, {name: u for name, (u, *_) in zip(names, columns, strict=True)})
    view = make_plan(system, names, hold)
    check_parameters(system)
    orders = [
        jnp.stack([c[k] for c in columns], axis=-1) if columns else jnp.zeros((*t.shape, 0)) for k in range(count)
    ]
    question = _Question(system, view, orders[0], tuple(orders[1:]), t)
    return _solve_question(question, "continuation", start, functools.partial(_follow_inputs, repair, throw))


def _check_call(
    system: System,
    inputs: Inputs,
    hold: Sequence[str],
    rates: Inputs | None,
    accelerations: Inputs | None,
    start: object,
    unit: str | None,
    redundancy: str = REDUNDANCY[0],
    jerk: bool = False,
) -> tuple[_Question, Any]:
    """Check a call and bring it into one form; the start comes back in radians."""
    view, values, start = check_inputs(system, inputs, hold, unit, start, redundancy)
    rates, accelerations = in_radians(system, unit, rates, accelerations)
    if rates is None:
        if accelerations is not None or jerk:
            raise InputError("accelerations and jerk follow from rates: give rates={...} as well")
        return _Question(system, view, values, ()), start
    first, second = (
        rate_values(given, tuple(inputs), values.shape[:-1], what)
        for given, what in ((rates, "rates"), (accelerations or {}, "accelerations"))
    )
    return _Question(system, view, values, (first, second, 0.0 * first) if jerk else (first, second)), start


def _in_time(name: str, data: "Callable | tuple | ArrayLike", t: np.ndarray, count: int) -> list[Array]:
    if callable(data):
        what = f"input {name!r}"
        out: list[Array] = []

        def f(x: Array) -> Array:
            return as_real(call_user(data, what, "t", x), f"{what}: its function of time", "one number", ())

        for k in range(count):
            try:
                out.append(jax.vmap(f)(jnp.asarray(t)))
            except InputError:
                raise
            except (TypeError, ValueError, jax.errors.JAXTypeError, jax.errors.JaxRuntimeError) as error:
                blame_callback(error, f"the function of {what}")
                raise InputError(
                    f"{what}: its function of time must take the time and return one number, in JAX ({error})"
                ) from None
            finite(out[-1], f"{what}: " + ("value", "first rate", "second rate", "third rate")[k])
            f = functools.partial(lambda x, f: jax.jvp(f, (x,), (jnp.ones_like(x),))[1], f=f)
        return out
    if not isinstance(data, (tuple, list)) or len(data) < count:
        kinds = "(u, u̇, ü, u⃛)" if count == 4 else "(u, u̇, ü)"
        raise InputError(
            f"input {name!r} must be a function of time or {count} arrays {kinds}, got {type(data).__name__}"
        )
    out = []
    for k, value in enumerate(data[:count]):
        value = finite_array(value, f"input {name!r}, part {k}")
        if value.shape not in ((), t.shape):
            raise InputError(f"input {name!r}, part {k}, has shape {value.shape}, the times have {t.shape}")
        out.append(jnp.broadcast_to(value, t.shape))
    return out


def _solve_question(question: _Question, method: str, start: Any, solve: Callable[[_Question, Any], Motion]) -> Motion:
    """Solve; poses that are differentiated once, outside of compiled code, on the host, with derivatives as numbers."""
    system, view, values, orders, _ = question
    by_inputs = any(isinstance(x, Tracer) for x in (values, *orders))
    if not by_inputs and not any(isinstance(x, Tracer) for x in jax.tree.leaves(system)):
        return solve(question, start)
    known = values_behind((question._replace(view=None), start))
    if known is None or view.large:
        return solve(question, start)
    if view.held and start is not None:  # which may give what is held
        return solve(question, start)
    asked, begin = known
    flat = np.asarray(asked.values).reshape(math.prod(question.shape), len(view.driven))
    variables = len(find_traced(system.parameters)[1]) + by_inputs * len(view.driven)
    if not host_solve.suits_slopes(view, method, flat, variables):
        return solve(question, start)
    from jaxnc.kinematics.design import attach_slopes  # with all that XLA needs, and the host does not

    with evaluate_at_once():
        found = solve(asked._replace(view=view, values=np.asarray(asked.values)), begin)
    return dataclasses.replace(attach_slopes(found, system, values, orders), time=question.time)


def _follow_inputs(repair: bool, throw: bool, question: _Question, start: Motion | Inputs | None) -> Motion:
    """Follow a sequence of inputs along one branch."""
    view, eq = question.view, derive(question.system)
    held = question.system.topology.named(view.held)
    drawn = start_of(question.system, eq, jax.tree.map(_without_slope, start), held, repair=repair)
    home = drawn
    if held and isinstance(start, Mapping):  # what the start does not name is held where it is drawn
        home = settle(eq, np.zeros(len(question.system.topology.coordinates)), repair).q
    q0 = _with_slopes_of_held(question.system, view, eq, drawn, home, start, ())
    found = _find_poses(view, "continuation", eq, q0, question.values, question.orders, repair)
    motion = _check_rolling(question.answer(found))
    if throw:
        outside(motion.status, "throw=True")
        motion.check()
    return motion


def _check_rolling(motion: Motion) -> Motion:
    """Refuse a motion whose velocities break a row on velocities; traced code is not checked."""
    top = motion.system.topology
    if not top.rates or not motion.rates or isinstance(motion.q, Tracer) or isinstance(motion.rates[0], Tracer):
        return motion
    constants = rate_constants(motion.system)
    off = np.abs(np.asarray(jax.vmap(lambda q, v: slips(top, constants, q, v))(motion.q, motion.rates[0])))
    off = np.where(np.asarray(motion.status == 0)[:, None], off, 0.0)
    pose, row = np.unravel_index(int(off.argmax()), off.shape)
    # below 1e-6 of the largest rate a motion rolls
    if off[pose, row] > 1e-6 * float(jnp.max(jnp.abs(motion.rates[0]))):
        raise InputError(
            f"{top.name!r}: the prescribed velocities break {top.rate_rows[row]!r} by {off[pose, row]:.3g} in pose "
            f"{pose}. Positions do not see rows on velocities, so a sweep without rates goes anywhere; prescribe a "
            f"motion that rolls, or fewer coordinates in simulate(inputs=), where the rows decide the others"
        )
    return motion


def _find_poses(
    view: Plan,
    method: str,
    eq: Equations,
    q0: Array,
    values: AnyArray,
    orders: tuple[Array, ...],
    repair: bool = True,
    devices: tuple | None = None,
) -> PoseBatch:
    """Solve for poses and their rates where they are found soonest; arguments and result as of `traced.analyse_traced`.

    Few on the host, many by XLA; in traced code, and on `devices`, all by XLA, which asks the host for what it does not
    find.
    """
    if not len(values):
        return host_solve.no_poses(eq, orders)
    if devices is not None:
        return solve_on(devices, view, method, eq, q0, values, orders, repair)
    guess = method == "guess"
    if (repair or view.large or guess) and host_solve.suits_host(view, method, values, orders, eq, q0):
        return host_solve.analyse_on_host(view, method, eq, q0, values, orders)
    from jaxnc.kinematics import traced  # with all that XLA needs, and the host does not

    if view.large or guess or any(isinstance(x, Tracer) for x in jax.tree.leaves((eq, q0, values, orders))):
        return traced.analyse_traced(view, method, eq, q0, values, orders, repair)
    return traced.analyse_many(view, method, eq, q0, values, orders, repair)


@functools.partial(jit, static_argnums=0)
def _is_on_branch(view: Plan, eq: Equations, q: Array, branch: Array) -> Array:
    wanted = view.linearise(eq, branch)[1]
    return jax.vmap(lambda x: view.same_branch(view.linearise(eq, x)[1], wanted))(q)


def _same_branch(view: Plan, eq: Equations, motion: Motion, branch: Motion) -> Motion:
    if not isinstance(branch, Motion) or branch.q.ndim != 1:
        shape = f"a motion of shape {branch.status.shape}" if isinstance(branch, Motion) else repr(branch)
        raise InputError(f"branch= is one earlier pose, such as solve_position returns; got {shape}")
    same = _is_on_branch(view, eq, motion.q.reshape(-1, motion.q.shape[-1]), branch.q).reshape(motion.status.shape)
    status = jnp.where((motion.status == 0) & ~same, int(Status.BRANCH_JUMP), motion.status)
    if isinstance(motion.q, Tracer):  # what was not found does not change with the design, as in any other motion
        unknown = np.array(view.unknown, int)
        still = motion.q.at[..., unknown].set(jax.lax.stop_gradient(motion.q[..., unknown]))
        motion = dataclasses.replace(motion, poses=jnp.where(same[..., None], motion.q, still))
    rates = tuple(jnp.where(same[..., None], rate, 0.0) for rate in motion.rates)
    return dataclasses.replace(motion, status=status, rates=rates)


def _raise_failure(view: Plan, eq: Equations, motion: Motion, start: bool) -> None:
    """Raise for a single failed pose, saying how far the motion got and what is in the way."""
    status = np.asarray(motion.status)
    if status.shape:
        motion.check()
        return
    if not status:
        return
    eq, motion = jax.lax.stop_gradient((eq, motion))  # it is differentiated where a gradient is asked for
    text = f"{motion.system.name!r}: {Status(int(status)).sentence}"
    if int(status) == Status.DID_NOT_ASSEMBLE and start:
        worst = worst_rows(motion.system, eq, np.asarray(motion.q))
        text += f" At the pose nearest to the start {worst}. Name more points of the wanted assembly in start=."
    elif int(status) == Status.DID_NOT_ASSEMBLE:
        q = np.asarray(motion.q)
        if not view.large:
            asked = np.array([float(np.asarray(motion.inputs[name])) for name in motion.driven])
            q = host_solve.end_of_way(view, to_host(eq), np.asarray(settle(eq, np.zeros(len(q))).q), asked, q)
        # The last pose on the branch: its inputs say how far the mechanism could be moved.
        ends = {name: q[i] for name, i in zip(motion.driven, view.known, strict=False)}
        got = motion.system.topology.write_values(ends)
        gap = float(np.abs(evaluate(eq, jnp.asarray(q))[0]).max(initial=0.0))
        if meets(eq, q, gap):
            text += f" Along the branch of the drawing it can be moved as far as {got}.{meeting_ends(motion.system, q)}"
        else:
            worst = worst_rows(motion.system, eq, q)
            text += f" Even the drawing does not assemble: {worst}."
    if int(status) == Status.SINGULAR_START:
        if not start and host_solve.never_moves(motion.system, view, eq):
            text = f"{motion.system.name!r}: {NEVER_MOVES.format(', '.join(motion.driven))}"
        raise AssemblyError(text + meeting_ends(motion.system, np.asarray(motion.q)))
    raise AssemblyError(
        text + " jaxnc.diagnose(system, inputs) names the constraints in the way and what would mend it."
    )


# -- where it begins ---------------------------------------------------------------------------------------------------


def start_of(
    system: System,
    eq: Equations,
    start: Motion | Mapping[str, Any] | None,
    held: Sequence[str] = (),
    what: str = "start",
    repair: bool = True,
) -> Array:
    """Find the pose an analysis begins with: the assembled drawing, an earlier pose, or the one closest to a guess.

    What is `held` has the value that a guess names, or else that of the drawing. `what` is what messages call it;
    without `repair` traced code does not ask the host.
    """
    q = settle(eq, np.zeros(len(system.topology.coordinates)), repair).q
    if start is None:
        return q
    q = start_poses(system.topology, eq, q, start, held=held, what=what)
    if isinstance(start, Motion):
        return q
    return settle(eq, q - (np.asarray(eq.home) if isinstance(q, np.ndarray) else eq.home), repair).q


def begin_at(
    system: System, view: Plan, eq: Equations, q0: AnyArray, start: Motion | Mapping[str, Any] | None, values: AnyArray
) -> AnyArray:
    """Find where poses for inputs ``(*shape, k)`` begin: at the drawing `q0`, ``(N,)``, or each nearest to a start.

    What is held changes in traced code with what gives it.
    """
    top, begin, shape = system.topology, q0, values.shape[:-1]
    if start is not None:
        known = {name: values[..., k] for k, name in enumerate(top.named(view.driven))}
        still, guess, given = (jax.tree.map(_without_slope, x) for x in (eq, start, known))
        begin = start_poses(top, still, q0, guess, given, top.named(view.held), shape)
    return _with_slopes_of_held(system, view, eq, begin, q0, start, shape)


def _without_slope(x: AnyArray) -> AnyArray:
    return jax.lax.stop_gradient(x) if isinstance(x, Tracer) else x


def _with_slopes_of_held(
    system: System,
    view: Plan,
    eq: Equations,
    begin: AnyArray,
    q0: AnyArray,
    start: Motion | Mapping[str, Any] | None,
    shape: tuple[int, ...],
) -> AnyArray:
    """Let what is held change with an earlier pose, with what a start names, or else with the drawing."""
    held = np.array(view.held, int)
    if not len(held) or not any(isinstance(x, Tracer) for x in jax.tree.leaves((eq, start))):
        return begin
    if isinstance(start, Motion):
        given = start.q
    else:
        from jaxnc.solvers.newton import attach_start  # with all that XLA needs, and the host does not

        size = characteristic_length(system.parameters.points)
        given = attach_start(free_plan(view.topology), jax.lax.stop_gradient(q0), eq, size)
        for name, value in (start or {}).items():
            columns, value = _guess_entry(system.topology, name, value, shape, "start")
            given = jnp.broadcast_to(given, (*shape, given.shape[-1])).at[..., np.array(columns)].set(value)
    change = given[..., held] - jax.lax.stop_gradient(given[..., held])
    return jnp.asarray(begin).at[..., held].add(change)


def start_poses(
    top: Topology,
    eq: Equations,
    q: AnyArray,
    guess: Mapping[str, Any] | Motion,
    known: Mapping[str, Array] | None = None,
    held: Sequence[str] = (),
    shape: tuple[int, ...] = (),
    what: str = "start",
) -> Any:
    """Complete the poses to begin with, ``(*shape, N)``: NumPy's where they are few and nothing is traced.

    What is not given follows from what is: angles and distances are measured at the points, and missing points are
    begun from many places, of which the one counts that leads to the assembly nearest to what was given.

    The guess is an earlier pose, or places and values by name; one for all, or one for each of a batch. `known` are
    values of coordinates that are given otherwise, such as inputs; what is held keeps its value in the drawing unless
    the guess has another.
    """
    given = guess.poses if isinstance(guess, Motion) else None
    if isinstance(given, np.ndarray) and given.shape == (*shape, len(top.coordinates)):  # as it is asked often
        return given
    few = _few_known(top, (guess, eq, q, known), math.prod(shape))
    if isinstance(guess, Motion):
        if guess.status.shape not in ((), shape):
            expected = f"a single pose, or {shape} of them" if shape else "a single pose"
            raise InputError(f"{what} must be {expected}; this motion has shape {guess.status.shape}")
        numeric: Any = np if few else jnp
        found = guess.poses if isinstance(guess.poses, np.ndarray) else numeric.asarray(guess.q)
        wanted = (*shape, found.shape[-1])
        return found if found.shape == wanted else numeric.broadcast_to(found, wanted)
    if not isinstance(guess, Mapping):
        raise InputError(f"{what} is an earlier pose, or places by name such as {{'B': (0, 1)}}; got {guess!r}")
    if few:
        q = np.array(np.broadcast_to(np.asarray(q), (*shape, len(top.coordinates))))
    else:
        q = jnp.broadcast_to(jnp.asarray(q), (*shape, len(top.coordinates)))

    def assign(q: AnyArray, columns: AnyArray, value: AnyArray) -> AnyArray:
        if not few:
            return q.at[..., columns].set(value)
        q[..., columns] = value
        return q

    sure = {top.position[name] for name in (*held, *(known or {}))}
    for name, value in (known or {}).items():
        q = assign(q, top.position[name], value)
    given = set(sure)
    for name, value in guess.items():
        columns, value = _guess_entry(top, name, value, shape, what)
        q = assign(q, np.array(columns), value)
        given.update(columns)
    flat, which = q.reshape(math.prod(shape), q.shape[-1]), (tuple(sorted(sure)), tuple(sorted(given)))
    if few:
        return _complete_on_host(top.structure, *which, to_host(eq), flat).reshape(q.shape)
    return _complete_by_xla(top.structure, *which, eq, flat).reshape(q.shape)


def _guess_entry(top: Topology, name: str, value: Any, shape: tuple[int, ...], what: str) -> tuple[list[int], Array]:
    """Find the coordinates that a name of a guess stands for, and their values, ``(..., coordinates)``."""
    value = finite_array(value, f"{what} of {name!r}")
    at, batch = coordinates_of(top, name), f", or {(*shape, '...')} of them".replace("'", "") if shape else ""
    if isinstance(at, slice):
        if value.shape not in ((top.dim,), (*shape, top.dim)):
            raise InputError(f"{what} of {name!r} must be {top.dim} numbers{batch}, got shape {value.shape}")
        return list(range(at.start, at.stop)), value
    if at is not None:
        if value.shape not in ((), shape):
            raise InputError(f"{what} of {name!r} must be one number{batch}, got shape {value.shape}")
        return [at], value[..., None]
    raise InputError(
        f"{what}: no point or coordinate {name!r}; {nearest(name, (*top.points, *top.vectors, *top.scalars))}"
    )


def _few_known(top: Topology, given: object, count: int) -> bool:
    traced = any(isinstance(x, Tracer) for x in jax.tree.leaves(given))
    return outermost() and not traced and (top.large or count <= 64)  # 64 guesses are completed on the host


class _Missing(NamedTuple):
    """Places of what a guess does not give, and plans that find it."""

    scalars: np.ndarray
    points: np.ndarray  # components of points and vectors
    nearly: np.ndarray  # what is given, but only nearly
    moved: np.ndarray  # where the missing points are begun from, of the size, (tries, points)
    beside: Plan  # holds what is given
    whole: Plan  # holds what is sure


@with_owner
def _missing(top: Topology, sure: tuple[int, ...], given: tuple[int, ...]) -> _Missing:
    first = len(top.coordinates) - len(top.scalars)
    scalars = np.array([c for c in range(first, len(top.coordinates)) if c not in given], int)
    points = np.array([c for c in range(first) if not top.fixed[c] and c not in given], int)
    nearly = np.array([c for c in given if c not in sure], int)
    # 24 places of the missing points are begun from, the drawing's among them
    moved = np.random.default_rng(11).uniform(-1.0, 1.0, (1 if top.large else 24, len(points)))
    moved[0] = 0.0
    beside, whole = (plan(top, (), tuple(top.coordinates[c] for c in w if not top.fixed[c])) for w in (given, sure))
    return _Missing(scalars, points, nearly, moved, beside, whole)


def _complete_on_host(
    top: Topology, sure: tuple[int, ...], given: tuple[int, ...], inner: HostEquations, q: np.ndarray
) -> np.ndarray:
    """Complete poses as `_complete_by_xla` does, in NumPy: the assemblies from all beginnings side by side."""
    missing = _missing(top, sure, given)
    first = len(top.coordinates) - len(top.scalars)
    scalars, points, moved = missing.scalars, missing.points, missing.moved
    angles, weight = np.array(top.angles, bool)[scalars - first], inner.weights[:, None]

    def with_measures(x: np.ndarray) -> np.ndarray:
        if len(scalars):
            new = inner.measured(x)[scalars - first]
            turns = np.where(angles[:, None], np.round((x[scalars] - new) / (2 * np.pi)), 0.0)
            x[scalars] = new + 2 * np.pi * turns
        return x

    with np.errstate(all="ignore"):
        flat = np.array(q.T, inner.dtype)
        if not len(points):
            return with_measures(flat).T
        beside, whole = view_of(missing.beside, inner), view_of(missing.whole, inner)
        x = np.repeat(flat, len(moved), axis=1)
        start = np.array(x)
        start[points] += np.tile(moved.T, len(q)) * inner.length / weight[points]
        local = with_measures(host.closest(beside, with_measures(start), _ITERATIONS).q)
        found = host.closest(whole, np.where(inner.guards(local)[0], local, start), _ITERATIONS)
        good = inner.guards(found.q)[0] & (found.gap <= limits(flat, inner.rounded).close * inner.length)
        away = (weight * (found.q - x) / inner.length) ** 2
        score = np.sum(away[missing.nearly], axis=0) + _FROM_DRAWING * np.sum(away[points], axis=0)
        score = np.where(good & np.isfinite(score), score, np.inf).reshape(len(q), len(moved))
        at = np.arange(len(q)) * len(moved)
        best = np.where(np.isfinite(score.min(axis=1)), at + np.argmin(score, axis=1), -1)
        # What does not assemble may have gone nowhere: farther than 10 sizes it stays as it was.
        far = np.abs(weight * (local[:, at] - x[:, at])).max(axis=0) > 10.0 * inner.length
        return np.where(best >= 0, found.q[:, best], np.where(far, x[:, at], local[:, at])).T


@functools.partial(jit, static_argnums=(0, 1, 2))
def _complete_by_xla(
    top: Topology, sure: tuple[int, ...], given: tuple[int, ...], eq: Equations, q: Float[Array, "B N"]
) -> Array:
    """Complete poses of which only some coordinates are given, the sure ones exactly and the others nearly."""
    # with all that XLA needs, and the host does not
    from jaxnc.solvers.newton import closest_pose
    from jaxnc.solvers.traced import ask_host, refuse_unreadable, shorten_equations

    eq, first = jax.lax.stop_gradient(eq), len(top.coordinates) - len(top.scalars)
    scalars, points, nearly, moved, beside, whole = _missing(top, sure, given)
    angles = np.array(top.angles, bool)[scalars - first]
    weight = weights(eq)

    def with_measures(x):
        if not len(scalars):
            return x
        new = measured(top, eq.constants, x)[scalars - first]
        turns = jnp.where(angles, jnp.round((x[scalars] - new) / (2 * jnp.pi)), 0.0)  # counted as in the drawing
        return x.at[scalars].set(new + 2 * jnp.pi * turns)

    if not len(points):
        return jax.vmap(with_measures)(q)
    if top.large:
        refuse_unreadable(top)

        def answer(eq: Equations, q: np.ndarray) -> np.ndarray:
            return _complete_on_host(top, sure, given, from_jax(eq), q).astype(q.dtype)

        like, question = jax.ShapeDtypeStruct(q.shape, q.dtype), (shorten_equations(eq), q)
        return ask_host("completed a start", like, answer, *question, given_up=lambda _, q: np.nan * q, large=True)

    def upright(x):
        return jnp.all(jnp.concatenate(guards(eq, x)) > 0.0)

    def assemble(x, off):
        """An assembly: first what is missing beside what was given, then all of it."""
        start = with_measures(x.at[points].add(off * eq.length / weight[points]))
        local = with_measures(closest_pose(beside, eq, start, _ITERATIONS).q)
        found = closest_pose(whole, eq, jnp.where(upright(local), local, start), _ITERATIONS)
        good = upright(found.q) & (found.gap <= limits(x, eq.rounded).close * eq.length)
        away = (weight * (found.q - x) / eq.length) ** 2
        score = jnp.sum(away[nearly]) + _FROM_DRAWING * jnp.sum(away[points])
        return found.q, jnp.where(good & jnp.isfinite(score), score, jnp.inf), local

    def one(x):
        found, score, local = jax.lax.map(functools.partial(assemble, x), jnp.asarray(moved))
        # farther than 10 sizes it stays as it was
        far = jnp.max(jnp.abs(weight * (local[0] - x))) > 10.0 * eq.length
        return jnp.where(jnp.isfinite(jnp.min(score)), found[jnp.argmin(score)], jnp.where(far, x, local[0]))

    return jax.vmap(one)(q)
