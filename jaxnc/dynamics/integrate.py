"""From time to time: steps of adapted or equal length between the times that are kept, and where an event ends them.

Every kept time is the end of a step, so that its state lies on the constraints and has its accelerations. Steps of no
length take the start there, so that a program contains one step only.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.dynamics.runge_kutta import METHODS, State
from jaxnc.status import Status
from jaxnc.types import Array

SAFE, LEAST, MOST = 0.9, 0.2, 10.0
"""Of a step that would just do; how much shorter or longer the next one may be."""

START = 3
"""Steps of no length that take the start onto the constraints."""

ALL = np.iinfo(np.int32).max

Advance = Callable[[Any, Array, Array, State], tuple[State, tuple[Any, Any]]]
"""A step of a motion, ``(moving, t, h, state)``; where it ends, and its errors."""

Event = Callable[[Any, Array, State], Array]
"""A number ``(parameters, t, state)`` whose change of sign ends the motion."""


class Control(NamedTuple):
    """How long steps are."""

    rtol: Any  # relative tolerance of a step
    atol: Any  # absolute tolerance, a length (an angle, a rate)
    first: Any  # the first step; chosen if not positive
    most: Any  # the most steps
    equal: Any  # so many equal steps between two times, by a method that estimates no errors


class Course(NamedTuple):
    """An integration on its way."""

    state: State  # where it is
    t: Array  # the time there
    h: Array  # the step that is wanted next
    made: tuple[Array, Array]  # steps made, and steps made in vain
    status: Array  # `jaxnc.Status`, zero while it goes on
    value: Array  # the event's function there


class _Bracket(NamedTuple):
    """Steps between which an event happens, and its function there; `high` is 0 while there is none."""

    low: Array
    high: Array
    at_low: Array
    at_high: Array
    last: Array

    @classmethod
    def none(cls) -> "_Bracket":
        """No event in sight."""
        return cls(*(jnp.zeros(()) for _ in range(5)))

    def guess(self) -> Array:
        """The next step to be tried."""
        found = (self.low * self.at_high - self.high * self.at_low) / (self.at_high - self.at_low)
        return jnp.where((found > self.low) & (found < self.high), found, 0.5 * (self.low + self.high))

    def after(self, h: Array, value: Array, at_start: Array) -> "_Bracket":
        """With what a step of length h has found (Illinois' rule)."""
        beyond = value * at_start <= 0.0
        first = self.high <= 0.0
        again_low, again_high = (self.last == self.low) & ~first, (self.last == self.high) & ~first
        low, high = jnp.where(beyond, self.low, h), jnp.where(beyond | first, h, self.high)
        at_low = jnp.where(first, at_start, self.at_low)
        at_low = jnp.where(beyond, jnp.where(again_high, 0.5 * at_low, at_low), value)
        at_high = jnp.where(beyond, value, jnp.where(again_low, 0.5 * self.at_high, self.at_high))
        return _Bracket(low, high, at_low, at_high, h)


def _norm(errors: Any, old: Any, new: Any, control: Control) -> Array:
    """Errors of poses and rates in parts of what is allowed, the larger one."""

    def part(e, a, b):
        return jnp.sqrt(jnp.mean((e / (control.atol + control.rtol * jnp.maximum(jnp.abs(a), jnp.abs(b)))) ** 2))

    return jnp.maximum(*(part(*x) for x in zip(errors, old, new, strict=True)))


def first_step(state: State, control: Control) -> Array:
    """A hundredth of the time in which the state changes by its own size.

    Source: E. Hairer, S. P. Nørsett, G. Wanner, Solving Ordinary Differential Equations I, II.4.
    """
    old, slope = (state.q, state.v), (state.v, state.a)
    size, rate = _norm(old, old, old, control), _norm(slope, old, old, control)
    chosen = jnp.where((size < 1e-5) | (rate < 1e-5), 1e-6, 0.01 * size / jnp.maximum(rate, 1e-300))
    return jnp.where(control.first > 0.0, control.first, chosen)


Told = Callable[..., Any]


def interval(
    advance: Advance,
    order: int,
    event: Event | None,
    arguments: tuple[Any, Any, Control],
    course: Course,
    ends: tuple[Array, Array],
    warm: Array,
    whole: tuple[Array, Array],
    note: Told | None = None,
    memory: Any = (),
    until: Any = ALL,
) -> tuple[Course, Array, Any]:
    """Steps from one kept time to the next.

    Args:
        advance: a step.
        order: of its estimate of errors.
        event: what ends the motion.
        arguments: the motion, the event's parameters, and how long steps are.
        course: where it begins.
        ends: the two times.
        warm: so many steps of no length are made instead.
        whole: first and last time of the whole motion.
        note: is told the number of each step, its start, length and state, and what more `advance` says of it,
            ``(memory, …)``; returns memory anew.
        memory: what that keeps.
        until: so many steps are made at most.
    """
    moving, parameters, control = arguments
    t0, t1 = ends
    span = jnp.abs(whole[1] - whole[0])

    def more(carry):
        course, count, _, _ = carry
        return (course.status == 0) & jnp.where(warm > 0, count < warm, course.t < t1) & (count < until)

    def once(carry):
        course, count, bracket, memory = carry
        state, t, (made, vain) = course.state, course.t, course.made
        parts = jnp.ceil((t1 - t) / course.h * (1.0 - 1e-9))
        last = parts <= 1.0
        h = (t1 - t) / jnp.where(last, 1.0, parts)
        if event is not None:
            h, last = jnp.where(bracket.high > 0.0, bracket.guess(), h), last & (bracket.high <= 0.0)
        # Steps keep their share of the interval where its ends are changed.
        wide = jnp.where(t1 > t0, t1 - t0, 1.0)
        h = jnp.where(warm > 0, 0.0, lax.stop_gradient(h / wide) * wide)
        new, errors, *more = advance(moving, t, h, state)
        size = _norm(errors, (state.q, state.v), (new.q, new.v), control)
        size = lax.stop_gradient(jnp.where(jnp.isfinite(size), size, 1e30))
        good = (size < 1.0) | (warm > 0)
        factor = jnp.clip(SAFE * jnp.maximum(size, 1e-30) ** (-1.0 / order), LEAST, MOST)
        # A step that was shortened to meet a time says little against the one that was wanted.
        wanted = jnp.where(
            good,
            jnp.maximum(factor * h, jnp.where(h < course.h, jnp.minimum(factor, 1.0) * course.h, 0.0)),
            jnp.minimum(factor, SAFE) * h,
        )
        wanted = jnp.where(warm > 0, course.h, lax.stop_gradient(wanted))
        status, value, there, taken = course.status, course.value, jnp.where(last, t1, t + h), good
        if event is not None:
            value = event(parameters, there, new)
            crossed = (value * course.value < 0.0) | ((value == 0.0) & (course.value != 0.0))
            looking = good & (warm == 0) & (crossed | (bracket.high > 0.0))
            met = looking & ((jnp.abs(h - bracket.last) <= 1e-14 * span) | (value == 0.0))
            bracket = jax.tree.map(
                lambda a, b: jnp.where(looking & ~met, a, b), bracket.after(h, value, course.value), bracket
            )
            status = jnp.where(met, int(Status.STOPPED), status)
            wanted = jnp.where(looking, course.h, wanted)
            taken = taken & (~looking | met)
        some = jnp.where(warm > 0, 0, 1)
        made, vain = made + jnp.where(taken, some, 0), vain + jnp.where(good, 0, 1)
        ended = jnp.where(taken, there, t) >= whole[1]
        long = wanted >= 1e-13 * span  # no step is, of a state that is no number
        status = jnp.where((status == 0) & ~taken & ~long, int(Status.STEP_UNDERFLOW), status)
        status = jnp.where((status == 0) & (made + vain >= control.most) & ~ended, int(Status.TOO_MANY_STEPS), status)
        if note is not None:
            memory = note(memory, count, t, h, state, *more)
        state, value, t = jax.tree.map(
            lambda a, b: jnp.where(taken, a, b), (new, value, jnp.where(warm > 0, t, there)), (state, course.value, t)
        )
        return Course(state, t, wanted, (made, vain), status, value), count + taken, bracket, memory

    course, count, _, memory = lax.while_loop(more, once, (course, jnp.zeros((), jnp.int32), _Bracket.none(), memory))
    return course, count, memory


def _evenly(
    advance: Advance, arguments: tuple[Any, Any, Control], course: Course, ends: tuple[Array, Array], warm: Array
) -> Course:
    """As `interval`, by equal steps."""
    moving, _, control = arguments
    t0, t1 = ends
    steps = jnp.where(t1 > t0, control.equal, 0).astype(course.made[0].dtype)
    h = (t1 - t0) / control.equal

    def once(k, state):
        return advance(moving, t0 + k * h, h, state)[0]

    state = lax.fori_loop(0, jnp.where(warm > 0, warm, steps), once, course.state)
    return course._replace(state=state, t=t1, made=(course.made[0] + steps, course.made[1]))


class Kept(NamedTuple):
    """What is kept of an integration at all times ``(T, …)``: all that going back through it needs."""

    state: State
    t: Array
    h: Array
    status: Array


def integrate(
    advance: Advance,
    method: str,
    event: Event | None,
    arguments: tuple[Any, Any, Control],
    t: Array,
    state: State,
) -> tuple[Kept, Course]:
    """What had become of a motion at all times ``(T, …)``, and the course at its end."""
    order, whole = order_of(method), (t[0], t[-1])

    def between(course, xs):
        *ends, warm = xs
        if order:
            course, _, _ = interval(advance, order, event, arguments, course, tuple(ends), warm, whole)
            begun = lax.stop_gradient(first_step(course.state, arguments[2]))
            course = course._replace(h=jnp.where(course.h > 0.0, course.h, begun))
        else:
            course = _evenly(advance, arguments, course, tuple(ends), warm)
        if event is not None:
            first = event(arguments[1], course.t, course.state)
            course = course._replace(value=jnp.where(warm > 0, first, course.value))
        return course, Kept(course.state, course.t, course.h, course.status)

    course, kept = lax.scan(between, course_of(state, t), intervals(t))
    return kept, course


def order_of(method: str) -> int:
    """Of a method's estimate of errors; 0 if it has none."""
    return METHODS[method].order * bool(METHODS[method].error.any())


def course_of(state: State, t: Array) -> Course:
    """An integration that is about to begin."""
    zero = jnp.zeros((), jnp.int32)
    return Course(state, t[0], jnp.zeros(()), (zero, zero), zero, jnp.zeros(()))


def intervals(t: Array) -> tuple[Array, Array, Array]:
    """Where they begin and end, the first of no length, and how many steps of no length are made in each."""
    return jnp.concatenate([t[:1], t[:-1]]), t, jnp.where(jnp.arange(len(t)) == 0, START, 0)


def equal_steps(
    advance: Callable[[Array, Array, Any], Any], seen: Callable[[Array, Any], Any], t: Array, carry: Any, steps: int
) -> Any:
    """States at all times after the first by as many equal steps between two times, differentiable both ways.

    `advance` is a step ``(t, h, carry)``; `seen` what is kept of it, ``(t, carry)``.
    """

    def interval(carry, ends):
        t0, t1 = ends
        h = (t1 - t0) / steps
        carry, _ = lax.scan(lambda c, k: (advance(t0 + k * h, h, c), None), carry, jnp.arange(steps, dtype=t.dtype))
        return carry, seen(t1, carry)

    return lax.scan(jax.checkpoint(interval), carry, (t[:-1], t[1:]))[1]
