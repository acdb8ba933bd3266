"""From time to time: steps of adapted or equal length between the times that are kept, forward and in reverse.

Every kept time is the end of a step, so that its state lies on the constraints and has its accelerations. Steps of no
length take the start there, so that a program contains one step only. An event ends the motion where it happens.

In reverse every interval is gone through again from what was kept at its start, and its steps are kept, some at a time.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.dynamics.steps import METHODS, MotionState
from jaxnc.status import Status
from jaxnc.system.precision import limits
from jaxnc.types import Array, ArrayLike, PyTree

SAFE, LEAST, MOST = 0.9, 0.2, 10.0
"""Of a step that would just do; how much shorter or longer the next one may be."""

START = 3
"""Steps of no length that take the start onto the constraints."""

ALL = np.iinfo(np.int32).max

_KEPT = 512  # steps that are kept at a time, in reverse

Advance = Callable[..., Any]
"""A step of a motion, ``(moving, t, h, state)``: its end, its errors, and what is needed to go back through it."""

Event = Callable[[Any, Array, MotionState], Array]
"""A number ``(parameters, t, state)`` whose change of sign ends the motion."""

Note = Callable[..., Any]
"""A memory of steps ``(memory, number, t, h, state, *more)`` with one step more."""


class Control(NamedTuple):
    """How long steps are."""

    rtol: ArrayLike  # relative tolerance of a step
    atol: ArrayLike  # absolute tolerance, a length (an angle, a rate)
    first: Any  # the first step; chosen if not positive
    most: Any  # the most steps
    equal: Any  # so many equal steps between two times, by a method that estimates no errors


class Integration(NamedTuple):
    """A motion to be integrated, and the way to do it."""

    advance: Advance
    method: str  # its steps are adapted if it estimates errors, else equal
    moving: Any  # the motion, as `advance` takes it
    control: Control
    t: Array  # the times that are kept, (T,)
    event: Event | None = None  # of steps that are adapted
    parameters: PyTree = ()  # of the event

    @property
    def order(self) -> int:
        """Order of the method's estimate of errors; 0 if it has none."""
        return METHODS[self.method].order * bool(METHODS[self.method].error.any())

    @property
    def intervals(self) -> tuple[Array, Array, Array]:
        """Begins and ends of all intervals, the first of no length, and counts of the steps of no length in each."""
        t = self.t
        return jnp.concatenate([t[:1], t[:-1]]), t, jnp.where(jnp.arange(len(t)) == 0, START, 0)

    def begin(self, state: MotionState) -> "Course":
        """Begin at the first time."""
        zero = jnp.zeros((), jnp.int32)
        return Course(state, self.t[0], jnp.zeros(()), (zero, zero), zero, jnp.zeros(()))


class Course(NamedTuple):
    """An integration on its way."""

    state: MotionState  # where it is
    t: Array  # the time there
    h: Array  # the step that is wanted next
    made: tuple[Array, Array]  # steps made, and steps made in vain
    status: Array  # `jaxnc.Status`, zero while it goes on
    value: Array  # the event's function there


class History(NamedTuple):
    """An integration at all kept times ``(T, …)``: what going back through it needs."""

    state: MotionState
    t: Array
    h: Array
    status: Array
    trail: Array | None = None  # of all equal steps (steps, …), those of no length first: what they were solved to


class _Bracket(NamedTuple):
    """Steps between which an event happens, and its function there; `high` is 0 while there is none."""

    low: Array
    high: Array
    at_low: Array
    at_high: Array
    last: Array

    def guess(self) -> Array:
        """Return the next step to be tried."""
        found = (self.low * self.at_high - self.high * self.at_low) / (self.at_high - self.at_low)
        return jnp.where((found > self.low) & (found < self.high), found, 0.5 * (self.low + self.high))

    def after(self, h: Array, value: Array, at_start: Array) -> "_Bracket":
        """Return the bracket with what a step of length h has found (Illinois' rule)."""
        beyond = value * at_start <= 0.0
        first = self.high <= 0.0
        again_low, again_high = (self.last == self.low) & ~first, (self.last == self.high) & ~first
        low, high = jnp.where(beyond, self.low, h), jnp.where(beyond | first, h, self.high)
        at_low = jnp.where(first, at_start, self.at_low)
        at_low = jnp.where(beyond, jnp.where(again_high, 0.5 * at_low, at_low), value)
        at_high = jnp.where(beyond, value, jnp.where(again_low, 0.5 * self.at_high, self.at_high))
        return _Bracket(low, high, at_low, at_high, h)


def _norm(errors: Sequence[Array], old: Sequence[Array], new: Sequence[Array], control: Control) -> Array:
    """Measure errors of poses and rates in parts of what is allowed; return the larger one."""

    def part(e, a, b):
        size, least = jnp.maximum(jnp.abs(a), jnp.abs(b)), limits(a).step
        allowed = control.atol + (control.rtol + least) * size
        if least:  # what is small takes its rounding from what is large
            allowed = allowed + 0.1 * least * jnp.max(size)
        parts = jnp.abs(e / allowed)
        # Against the largest, where that is beyond the limits; squares of large numbers of 32 bits would be infinite.
        most = jnp.maximum(jnp.max(parts, initial=0.0), 1.0)
        return most * jnp.sqrt(jnp.mean((parts / most) ** 2))

    return jnp.maximum(*(part(*x) for x in zip(errors, old, new, strict=True)))


def _first_step(state: MotionState, control: Control) -> Array:
    """Choose a hundredth of the time in which the state changes by its own size.

    Source: E. Hairer, S. P. Nørsett, G. Wanner, Solving Ordinary Differential Equations I, II.4.
    """
    old, slope = (state.q, state.v), (state.v, state.a)
    size, rate = _norm(old, old, old, control), _norm(slope, old, old, control)
    chosen = jnp.where((size < 1e-5) | (rate < 1e-5), 1e-6, 0.01 * size / jnp.maximum(rate, limits(rate).tiny))
    return jnp.where(control.first > 0.0, control.first, chosen)


def _march(
    job: Integration, course: Course, ends: tuple[Array, Array], warm: Array, whole: tuple[Array, Array],
    note: Note | None = None, memory: PyTree = (), until: ArrayLike = ALL,
) -> tuple[Course, Array, PyTree]:  # fmt: skip
    """Step from one kept time to the next; return the course there, the count of steps, and the memory of them.

    `warm` steps of no length are made instead, where it is not 0. `whole` are first and last time of the whole motion,
    `note` remembers each step in a memory, and `until` is the most that are made.
    """
    if not job.order:
        return _march_evenly(job, course, ends, warm, note, memory, until)
    control, event, (t0, t1) = job.control, job.event, ends
    instant = limits(job.t).instant * jnp.abs(whole[1] - whole[0])

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
        new, errors, *more = job.advance(job.moving, t, h, state)
        size = _norm(errors, (state.q, state.v), (new.q, new.v), control)
        size = lax.stop_gradient(jnp.where(jnp.isfinite(size), size, 1e30))
        good = (size < 1.0) | (warm > 0)
        factor = jnp.clip(SAFE * jnp.maximum(size, 1e-30) ** (-1.0 / job.order), LEAST, MOST)
        # A step that was shortened to meet a time says little against the one that was wanted.
        wanted = jnp.where(
            good,
            jnp.maximum(factor * h, jnp.where(h < course.h, jnp.minimum(factor, 1.0) * course.h, 0.0)),
            jnp.minimum(factor, SAFE) * h,
        )
        wanted = jnp.where(warm > 0, course.h, lax.stop_gradient(wanted))
        status, value, there, taken = course.status, course.value, jnp.where(last, t1, t + h), good
        if event is not None:
            value = event(job.parameters, there, new)
            crossed = (value * course.value < 0.0) | ((value == 0.0) & (course.value != 0.0))
            looking = good & (warm == 0) & (crossed | (bracket.high > 0.0))
            met = looking & ((jnp.abs(h - bracket.last) <= instant) | (value == 0.0))
            bracket = jax.tree.map(
                lambda a, b: jnp.where(looking & ~met, a, b), bracket.after(h, value, course.value), bracket
            )
            status = jnp.where(met, int(Status.STOPPED), status)
            wanted = jnp.where(looking, course.h, wanted)
            taken = taken & (~looking | met)
        some = jnp.where(warm > 0, 0, 1)
        made, vain = made + jnp.where(taken, some, 0), vain + jnp.where(good, 0, 1)
        ended = jnp.where(taken, there, t) >= whole[1]
        long = wanted >= 10.0 * instant  # no step is, of a state that is no number
        status = jnp.where((status == 0) & ~taken & ~long, int(Status.STEP_UNDERFLOW), status)
        status = jnp.where((status == 0) & (made + vain >= control.most) & ~ended, int(Status.TOO_MANY_STEPS), status)
        if note is not None:
            memory = note(memory, count, t, h, state, *more)
        state, value, t = jax.tree.map(
            lambda a, b: jnp.where(taken, a, b), (new, value, jnp.where(warm > 0, t, there)), (state, course.value, t)
        )
        return Course(state, t, wanted, (made, vain), status, value), count + taken, bracket, memory

    unseen = _Bracket(*(jnp.zeros(()) for _ in range(5)))
    course, count, _, memory = lax.while_loop(more, once, (course, jnp.zeros((), jnp.int32), unseen, memory))
    return course, count, memory


def _march_evenly(
    job: Integration,
    course: Course,
    ends: tuple[Array, Array],
    warm: Array,
    note: Note | None,
    memory: PyTree,
    until: ArrayLike,
) -> tuple[Course, Array, PyTree]:
    """Step as `_march`, by equal steps."""
    t0, t1 = ends
    made, vain = course.made
    h, wanted = (t1 - t0) / job.control.equal, jnp.where(t1 > t0, job.control.equal, 0)
    count = jnp.minimum(jnp.where(warm > 0, warm, wanted), until).astype(made.dtype)

    def once(k, carry):
        state, memory = carry
        at = t0 + k * h
        new, _, *more = job.advance(job.moving, at, h, state)
        return new, memory if note is None else note(memory, k, at, h, state, *more)

    state, memory = lax.fori_loop(0, count, once, (course.state, memory))
    return course._replace(state=state, t=t1, made=(made + wanted.astype(made.dtype), vain)), count, memory


def integrate(
    job: Integration, state: MotionState, remember: Callable[[MotionState, PyTree], Array] | None = None, steps: int = 0
) -> tuple[History, Course]:
    """Move from a start, which need not lie on the constraints; return the motion at all times and its last course.

    `remember` says what is kept of each step, of its start and of what more `job.advance` has returned, where so many
    equal `steps` are made between two times.
    """
    whole, count = (job.t[0], job.t[-1]), START + steps * (len(job.t) - 1)
    memory: Any = ()
    if remember is not None:
        one = jax.eval_shape(lambda: remember(state, *job.advance(job.moving, job.t[0], job.t[0], state)[2:]))
        memory = jnp.zeros((count, *one.shape), one.dtype)

    def between(carry, xs):
        course, memory = carry
        number, *ends, warm = xs
        first = jnp.where(warm > 0, 0, START + (number - 1) * steps)

        def note(memory, k, t, h, state, *more):
            return memory if remember is None else memory.at[first + k].set(remember(state, *more))

        noted = None if remember is None else note
        course, _, memory = _march(job, course, tuple(ends), warm, whole, noted, memory)
        if job.order:
            begun = lax.stop_gradient(_first_step(course.state, job.control))
            course = course._replace(h=jnp.where(course.h > 0.0, course.h, begun))
        if job.event is not None:
            first_value = job.event(job.parameters, course.t, course.state)
            course = course._replace(value=jnp.where(warm > 0, first_value, course.value))
        return (course, memory), (course.state, course.t, course.h, course.status)

    xs = jnp.arange(len(job.t)), *job.intervals
    (course, memory), history = lax.scan(between, (job.begin(state), memory), xs)
    return History(*history, None if remember is None else memory), course


def pull_back(
    job: Integration,
    again: Callable,
    start: MotionState,
    history: History,
    change: MotionState,
    recall: Callable[[Array], tuple] | None = None,
) -> tuple[PyTree, MotionState, Array]:
    """Go back through `integrate`: pull changes of the states back to the motion, the start and the times.

    `again` is a step once more, ``(moving, t, h, state, *more)`` with what more `job.advance` has returned. Equal steps
    that were kept are not made again: `recall` says of what was kept which state and what more that was.
    """
    moving, t, first, equal = job.moving, job.t, job.begin(start), job.control.equal
    before = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b[:-1]]), start, history.state)
    wanted = jnp.concatenate([jnp.zeros(1), history.h[:-1]])
    going = jnp.concatenate([jnp.zeros(1, history.status.dtype), history.status[:-1]])
    each = lambda x: jnp.zeros((_KEPT, *jnp.shape(x)), jnp.result_type(x))  # noqa: E731
    returned = jax.eval_shape(job.advance, moving, t[0], t[0], start)[2:]
    blank = jax.tree.map(each, (t[0], t[0], start, *(jax.tree.map(lambda x: jnp.zeros(x.shape), returned))))

    def note(memory, count, *step):
        return jax.tree.map(lambda m, x: m.at[count % _KEPT].set(x), memory, step)

    def between(carry, xs):
        state_bar, moving_bar = carry
        number, state, h, status, reached, (t0, t1, warm), more = xs
        state_bar = jax.tree.map(jnp.add, state_bar, more)
        course = first._replace(state=state, t=t0, h=h, status=status)
        wide = jnp.where(reached > t0, reached - t0, 1.0)
        ends, whole = (t0, reached if job.order else t1), (t[0], reached)
        made, before = jnp.where(warm > 0, warm, equal), jnp.where(warm > 0, 0, START + (number - 1) * equal)

        def remember(high):
            if recall is None:
                return _march(job, course, ends, warm, whole, note, blank, high)[1:]
            return jnp.minimum(made, high), ()

        def step(memory, k):
            if recall is None or history.trail is None:
                return jax.tree.map(lambda m: m[k % _KEPT], memory)
            h = (t1 - t0) / equal
            return t0 + k * h, h, *recall(history.trail[before + k])

        def back(carry):
            count, low, memory, state_bar, moving_bar, (t0_bar, t1_bar) = carry
            count = count - 1
            at, h, state, *more = step(memory, count)
            _, pull = jax.vjp(lambda *x: again(*x, *more), moving, at, h, state)
            # Behind where a motion failed nothing is asked for: it passes nothing on, however steep it was.
            asked = jnp.any(jnp.stack([jnp.any(x != 0.0) for x in jax.tree.leaves(state_bar)]))
            pulled = pull(state_bar)
            more, t_bar, h_bar, state_bar = jax.tree.map(lambda x: jnp.where(asked, x, 0.0), pulled)
            part, share = (at - t0) / wide, h / wide
            t0_bar = t0_bar + (1.0 - part) * t_bar - share * h_bar
            t1_bar = t1_bar + part * t_bar + share * h_bar
            moving_bar = jax.tree.map(jnp.add, moving_bar, more)
            return count, low, memory, state_bar, moving_bar, (t0_bar, t1_bar)

        def some(carry):
            high, state_bar, moving_bar, ends_bar = carry
            count, memory = remember(high)
            low = jnp.maximum(count - _KEPT, 0)
            _, _, _, state_bar, moving_bar, ends_bar = lax.while_loop(
                lambda c: c[0] > c[1], back, (count, low, memory, state_bar, moving_bar, ends_bar)
            )
            return low, state_bar, moving_bar, ends_bar

        begin = (jnp.asarray(ALL, jnp.int32), state_bar, moving_bar, (jnp.zeros(()), jnp.zeros(())))
        _, state_bar, moving_bar, ends_bar = lax.while_loop(lambda c: c[0] > 0, some, begin)
        return (state_bar, moving_bar), ends_bar

    nothing = jax.tree.map(jnp.zeros_like, (start, moving))
    xs = jnp.arange(len(t)), before, wanted, going, history.t, job.intervals, change
    (start_bar, moving_bar), (t0_bar, t1_bar) = lax.scan(between, nothing, xs, reverse=True)
    t_bar = t1_bar.at[:-1].add(t0_bar[1:]).at[0].add(t0_bar[0])
    return moving_bar, start_bar, t_bar


def equal_steps(
    advance: Callable[[Array, Array, PyTree], PyTree],
    seen: Callable[[Array, PyTree], PyTree],
    t: Array,
    carry: PyTree,
    steps: int,
) -> tuple[MotionState, PyTree]:
    """Make as many equal steps between two times, differentiable both ways; return states at all times after the first.

    `advance` is a step ``(t, h, carry)``, which returns what is carried on and what is kept of it: all that is kept,
    ``(T - 1, steps, …)``, is returned, too. `seen` is what is kept of a time, ``(t, carry)``.
    """

    def interval(carry, ends):
        t0, t1 = ends
        h = (t1 - t0) / steps
        carry, kept = lax.scan(lambda c, k: advance(t0 + k * h, h, c), carry, jnp.arange(steps, dtype=t.dtype))
        return carry, (seen(t1, carry), kept)

    return lax.scan(jax.checkpoint(interval), carry, (t[:-1], t[1:]))[1]
