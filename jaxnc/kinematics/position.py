"""Solving poses: one input, many inputs as lanes, or a sequence followed along its branch."""

import dataclasses
import functools
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.asking import ask, real
from jaxnc.calls import public
from jaxnc.compiling import blame_callback, jit
from jaxnc.errors import AssemblyError, InputError
from jaxnc.kinematics import on_host
from jaxnc.kinematics.columns import Columns
from jaxnc.kinematics.devices import Devices
from jaxnc.kinematics.guess import guessed
from jaxnc.kinematics.inputs import (
    REDUNDANCY,
    array,
    check_parameters,
    doubt_degrees,
    finite,
    in_radians,
    make_plan,
    named,
    outside,
    rate_values,
    stack,
    worst_rows,
)
from jaxnc.kinematics.motion import Motion
from jaxnc.solvers.assembly import derive, evaluate, free_plan, settle
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.status import Status
from jaxnc.system.equations import Equations
from jaxnc.system.precision import as_its_system, limits
from jaxnc.system.rates import rate_constants, slips
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import Array, Inputs

_SLIPS = 1e-6  # of the largest rate: below, a motion rolls


@public
@as_its_system
def solve_position(
    system: System,
    inputs: Inputs,
    start: Mapping[str, Any] | Motion | None = None,
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
    solve = poses if devices is None else _spread(devices)
    doubt_degrees(system, unit, inputs, start)
    inputs, rates, accelerations, start = in_radians(system, unit, inputs, rates, accelerations, start)
    view = make_plan(system, named(inputs), hold)
    names, values, shape = stack(inputs)
    check_parameters(system)
    orders = _orders(names, shape, rates, accelerations)
    eq = derive(system)
    q0: Any = None  # an earlier pose needs no drawing
    if not isinstance(start, Motion):
        q0 = settle(eq, np.zeros(len(system.topology.coordinates)), repair).q
    count = math.prod(shape)
    flat = values.reshape(count, len(names))
    flat_orders = tuple(o.reshape(count, len(names)) for o in orders)
    if start is None:
        q0 = held_as_drawn(system.topology, view, eq, q0, q0)
        out = solve(view, "lanes", eq, q0, flat, flat_orders, repair)
    else:
        inputs = {name: values[..., k] for k, name in enumerate(names)}
        held = system.topology.named(view.held)
        begin = guessed(system, eq, q0, start, inputs, held, shape).reshape(count, -1)
        if isinstance(start, Mapping):
            begin = held_as_drawn(system.topology, view, eq, q0, begin, start)
        near = devices is None and on_host.suits(view, "guess", flat, flat_orders, eq, begin)
        out = (on_host.analyse if near else _spread(devices))(view, "guess", eq, begin, flat, flat_orders)
    motion = _motion(system, view, values, out, shape)
    if branch is not None:
        motion = _same_branch(view, eq, motion, branch)
    if throw is None:
        throw = shape == () and not isinstance(motion.status, Tracer)
    if throw:
        outside(motion.status, "throw=True")
        _raise(view, eq, motion, start is not None)
    return motion


@public
@as_its_system
def sweep(
    system: System,
    inputs: Inputs,
    rates: Inputs | None = None,
    accelerations: Inputs | None = None,
    hold: Sequence[str] = (),
    start: Motion | Mapping[str, Any] | None = None,
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
    doubt_degrees(system, unit, inputs, start)
    inputs, rates, accelerations, start = in_radians(system, unit, inputs, rates, accelerations, start)
    view = make_plan(system, named(inputs), hold, redundancy)
    names, values, shape = stack(inputs)
    if len(shape) != 1 or shape[0] == 0:
        raise InputError(
            f"a sweep needs a sequence of values for its inputs, shape (T,); got shape {shape}. "
            f"For one pose or other batches use solve_position"
        )
    check_parameters(system)
    orders = _orders(names, shape, rates, accelerations, jerk)
    return _checked(_moved(system, view, values, orders, start, repair), throw)


@public
@as_its_system
def motion(
    system: System,
    inputs: Mapping[str, Callable | tuple | Any],
    t: Any,
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
    t = array(t, "time t")
    finite(t, "time t")
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
    return _checked(_moved(system, view, orders[0], tuple(orders[1:]), start, repair, t), throw)


def _in_time(name: str, data: Any, t: Any, count: int) -> list[Array]:
    if callable(data):
        what = f"input {name!r}"
        out: list[Array] = []

        def f(x: Array) -> Array:
            return real(ask(data, what, "t", x), f"{what}: its function of time", "one number", ())

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
        value = array(value, f"input {name!r}, part {k}")
        finite(value, f"input {name!r}, part {k}")
        if value.shape not in ((), t.shape):
            raise InputError(f"input {name!r}, part {k}, has shape {value.shape}, the times have {t.shape}")
        out.append(jnp.broadcast_to(value, t.shape))
    return out


def _orders(names, shape, rates, accelerations, jerk=False) -> tuple[Array, ...]:
    if rates is None:
        if accelerations is not None or jerk:
            raise InputError("accelerations and jerk follow from rates: give rates={...} as well")
        return ()
    first = rate_values(rates, names, shape, "rates")
    second = rate_values(accelerations or {}, names, shape, "accelerations")
    return (first, second, 0.0 * first) if jerk else (first, second)


def start_of(
    system: System,
    eq: Equations,
    start: Motion | Mapping[str, Any] | None,
    what: str = "start",
    repair: bool = True,
) -> Array:
    """The pose an analysis begins with: the assembled drawing, an earlier pose, or the pose closest to a guess.

    `what` is what messages call it; without `repair` traced code does not ask the host.
    """
    q = settle(eq, np.zeros(len(system.topology.coordinates)), repair).q
    if start is None:
        return q
    q = guessed(system, eq, q, start, what=what)
    if isinstance(start, Motion):
        return q
    return settle(eq, q - (np.asarray(eq.home) if isinstance(q, np.ndarray) else eq.home), repair).q


def held_as_drawn(
    top: Topology, view: Plan, eq: Equations, q0: Array, begin: Array, given: Collection[str] = ()
) -> Array:
    """Poses `begin`, whose held coordinates change in traced code with the drawing, as the start pose `q0` does.

    But for those that are `given`, by their name or that of their point or vector; `top` has the names.
    """
    names = [(c, top.coordinates[c]) for c in view.held]
    held = np.array([c for c, name in names if not {name, name.rpartition(".")[0]} & {*given}], int)
    if not len(held) or not any(isinstance(x, Tracer) for x in jax.tree.leaves(eq)):
        return begin
    from jaxnc.solvers.newton import attach_start  # with all that XLA needs, and the host does not

    drawn = attach_start(free_plan(view.topology), jax.lax.stop_gradient(q0), eq)
    return jnp.asarray(begin).at[..., held].set(drawn[held])


def _moved(system, view, values, orders, start, repair, t=None) -> Motion:
    eq = derive(system)
    q0 = start_of(system, eq, start, repair=repair)
    if start is None:
        q0 = held_as_drawn(system.topology, view, eq, q0, q0)
    out = poses(view, "continuation", eq, q0, values, orders, repair)
    return _rolls(_motion(system, view, values, out, (values.shape[0],), t))


def _rolls(motion: Motion) -> Motion:
    """A motion in time, refused where its velocities break a row on velocities; unchecked in traced code."""
    top = motion.system.topology
    if not top.rates or not motion.rates or isinstance(motion.q, Tracer) or isinstance(motion.rates[0], Tracer):
        return motion
    constants = rate_constants(motion.system)
    off = np.abs(np.asarray(jax.vmap(lambda q, v: slips(top, constants, q, v))(motion.q, motion.rates[0])))
    off = np.where(np.asarray(motion.status == 0)[:, None], off, 0.0)
    pose, row = np.unravel_index(int(off.argmax()), off.shape)
    if off[pose, row] > _SLIPS * float(jnp.max(jnp.abs(motion.rates[0]))):
        raise InputError(
            f"{top.name!r}: the prescribed velocities break {top.rate_rows[row]!r} by {off[pose, row]:.3g} in pose "
            f"{pose}. Positions do not see rows on velocities, so a sweep without rates goes anywhere; prescribe a "
            f"motion that rolls, or fewer coordinates in simulate(inputs=), where the rows decide the others"
        )
    return motion


def _checked(motion: Motion, throw: bool) -> Motion:
    if throw:
        outside(motion.status, "throw=True")
        motion.check()
    return motion


def _spread(devices: Devices | None) -> Callable[..., PoseBatch]:
    from jaxnc.kinematics.spread import on

    return on(devices)


def poses(
    view: Plan, method: str, eq: Equations, q0: Array, values: Any, orders: tuple[Array, ...], repair: bool = True
) -> PoseBatch:
    """Solve for poses and their rates where they are found soonest; arguments and result as of `analysis.analyse`.

    Few on the host, many by XLA; in traced code all by XLA, which asks the host for what it does not find.
    """
    if not len(values):
        return on_host.nothing(eq, orders)
    if (repair or view.large) and on_host.suits(view, method, values, orders, eq, q0):
        return on_host.analyse(view, method, eq, q0, values, orders)
    from jaxnc.kinematics import many  # imported where few poses do not wait for it
    from jaxnc.kinematics.analysis import analyse, in_columns

    if view.large:
        return analyse(view, method, eq, q0, values, orders, repair)
    traced = any(isinstance(x, Tracer) for x in jax.tree.leaves((eq, q0, values, orders)))
    return (in_columns if traced else many.analyse)(view, method, eq, q0, values, orders, repair)


def _motion(system: System, view: Plan, values: Array, out: PoseBatch, shape: tuple[int, ...], t=None) -> Motion:
    return Motion(
        system=system,
        driven=system.topology.named(view.driven),
        held=system.topology.named(view.held),
        poses=out.q.reshaped(shape) if isinstance(out.q, Columns) else _led(out.q, shape),
        rates=tuple(_led(r, shape) for r in out.rates),
        asked=_led(values, shape),
        status=_led(out.status, shape, 0),
        residual=_led(out.size, shape, 0),
        conditioning=_led(out.conditioning, shape, 0),
        time=t,
    )


def _led(x: Any, shape: tuple[int, ...], own: int = 1) -> Any:
    """An array with other leading axes in front of its own."""
    wanted = (*shape, *x.shape[x.ndim - own :])
    return x if x.shape == wanted else x.reshape(wanted)


@functools.partial(jit, static_argnums=0)
def _alike(view: Plan, eq: Equations, q: Array, branch: Array) -> Array:
    wanted = view.linearise(eq, branch)[1]
    return jax.vmap(lambda x: view.alike(view.linearise(eq, x)[1], wanted))(q)


def _same_branch(view: Plan, eq: Equations, motion: Motion, branch: Motion) -> Motion:
    if not isinstance(branch, Motion) or branch.q.ndim != 1:
        shape = f"a motion of shape {branch.status.shape}" if isinstance(branch, Motion) else repr(branch)
        raise InputError(f"branch= is one earlier pose, such as solve_position returns; got {shape}")
    same = _alike(view, eq, motion.q.reshape(-1, motion.q.shape[-1]), branch.q).reshape(motion.status.shape)
    status = jnp.where((motion.status == 0) & ~same, int(Status.BRANCH_JUMP), motion.status)
    return dataclasses.replace(motion, status=status)


def _raise(view: Plan, eq: Equations, motion: Motion, start: bool) -> None:
    """Raise for a single failed pose, saying how far the motion got and what is in the way."""
    status = np.asarray(motion.status)
    if status.shape:
        motion.check()
        return
    if not status:
        return
    text = f"{motion.system.name!r}: {Status(int(status)).sentence}"
    if int(status) == Status.DID_NOT_ASSEMBLE and start:
        worst = worst_rows(motion.system, eq, np.asarray(motion.q))
        text += f" At the pose nearest to the start {worst}. Name more points of the wanted assembly in start=."
    elif int(status) == Status.DID_NOT_ASSEMBLE:
        # The pose returned is the last one on the branch: its inputs say how far the mechanism could be moved.
        got = ", ".join(
            f"{name} = {float(motion.q[..., i]):.6g}" for name, i in zip(motion.driven, view.known, strict=False)
        )
        q = np.asarray(motion.q)
        gap = float(np.abs(evaluate(eq, jnp.asarray(q))[0]).max(initial=0.0))
        assembled = gap <= limits(eq.length).close * float(eq.length)
        if assembled:
            text += f" Along the branch of the drawing it can be moved as far as {got}."
        else:
            worst = worst_rows(motion.system, eq, q)
            text += f" Even the drawing does not assemble: {worst}."
    raise AssemblyError(
        text + " jaxnc.diagnose(system, inputs) names the constraints in the way and what would mend it."
    )
