"""Back through an integration: what changes of its states mean for the motion, the start and the times."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxnc.dynamics.integrate import (
    ALL,
    Advance,
    Control,
    Course,
    Kept,
    Told,
    course_of,
    interval,
    intervals,
    order_of,
)
from jaxnc.dynamics.runge_kutta import State
from jaxnc.types import Array

_KEPT = 512  # steps that are kept at a time


def pulled_back(
    advance: Advance,
    again: Callable,
    method: str,
    moving: Any,
    control: Control,
    t: Array,
    start: State,
    kept: Kept,
    change: State,
) -> tuple[Any, State, Array]:
    """What changes of the states mean for the motion, the start and the times: `integrate` in reverse.

    Every interval is gone through again from what was kept at its start, and its steps are kept, some at a time.

    `again` is the same step once more, with what `advance` has said of it; `kept` is what `integrate` has given.
    """
    order, first = order_of(method), course_of(start, t)
    before = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b[:-1]]), start, kept.state)
    wanted = jnp.concatenate([jnp.zeros(1), kept.h[:-1]])
    going = jnp.concatenate([jnp.zeros(1, kept.status.dtype), kept.status[:-1]])
    number = lambda x: jnp.zeros((_KEPT, *jnp.shape(x)), jnp.result_type(x))  # noqa: E731
    more_said = jax.eval_shape(advance, moving, t[0], t[0], start)[2:]
    blank = jax.tree.map(number, (t[0], t[0], start, *(jax.tree.map(lambda x: jnp.zeros(x.shape), more_said))))

    def note(memory, count, *said):
        return jax.tree.map(lambda m, x: m.at[count % _KEPT].set(x), memory, said)

    def between(carry, xs):
        state_bar, moving_bar = carry
        state, h, status, reached, (t0, t1, warm), more = xs
        state_bar = jax.tree.map(jnp.add, state_bar, more)
        course = first._replace(state=state, t=t0, h=h, status=status)
        wide = jnp.where(reached > t0, reached - t0, 1.0)

        def replayed(until):
            if not order:
                return _evenly_noted(advance, (moving, (), control), course, (t0, t1), warm, note, blank, until)
            ends, whole, asked = (t0, reached), (t[0], reached), (moving, (), control)
            return interval(advance, order, None, asked, course, ends, warm, whole, note, blank, until)[1:]

        def back(carry):
            count, low, memory, state_bar, moving_bar, (t0_bar, t1_bar) = carry
            count = count - 1
            at, h, state, *said = jax.tree.map(lambda m: m[count % _KEPT], memory)
            _, pull = jax.vjp(lambda *x: again(*x, *said), moving, at, h, state)
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
            count, memory = replayed(high)
            low = jnp.maximum(count - _KEPT, 0)
            _, _, _, state_bar, moving_bar, ends_bar = lax.while_loop(
                lambda c: c[0] > c[1], back, (count, low, memory, state_bar, moving_bar, ends_bar)
            )
            return low, state_bar, moving_bar, ends_bar

        begin = (jnp.asarray(ALL, jnp.int32), state_bar, moving_bar, (jnp.zeros(()), jnp.zeros(())))
        _, state_bar, moving_bar, ends_bar = lax.while_loop(lambda c: c[0] > 0, some, begin)
        return (state_bar, moving_bar), ends_bar

    nothing = jax.tree.map(jnp.zeros_like, (start, moving))
    xs = before, wanted, going, kept.t, intervals(t), change
    (start_bar, moving_bar), (t0_bar, t1_bar) = lax.scan(between, nothing, xs, reverse=True)
    t_bar = t1_bar.at[:-1].add(t0_bar[1:]).at[0].add(t0_bar[0])
    return moving_bar, start_bar, t_bar


def _evenly_noted(
    advance: Advance, arguments: tuple[Any, Any, Control], course: Course, ends: tuple[Array, Array], warm: Array,
    note: Told, memory: Any, until: Array,
) -> tuple[Array, Any]:  # fmt: skip
    """As `_evenly`, telling of each step until so many are made; how many, and the memory."""
    moving, _, control = arguments
    t0, t1 = ends
    steps = jnp.minimum(jnp.where(warm > 0, warm, jnp.where(t1 > t0, control.equal, 0)), until).astype(jnp.int32)
    h = (t1 - t0) / control.equal

    def once(k, carry):
        state, memory = carry
        at = t0 + k * h
        new, _, *more = advance(moving, at, h, state)
        return new, note(memory, k, at, h, state, *more)

    return steps, lax.fori_loop(0, steps, once, (course.state, memory))[1]
