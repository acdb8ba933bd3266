"""Functions of one pose on lanes: read once from their JAX statement, evaluated by NumPy with nothing compiled."""

import functools
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.compiling import jit
from jaxnc.internals import outermost
from jaxnc.reading import trace
from jaxnc.system.precision import WIDE, numbers
from jaxnc.system.structure import Formula
from jaxnc.types import Array, Numbers


def on_host(*given: object) -> bool:
    """Tell whether poses, given first, are in the host's memory, and nothing is traced, which makes arrays of JAX's."""
    if not outermost() or any(isinstance(x, Tracer) for x in jax.tree.leaves(given)):
        return False
    return all(isinstance(x, np.ndarray) or _is_in_memory(x) for x in jax.tree.leaves(given[0]))


def _is_in_memory(x: object) -> bool:
    """Tell an array of JAX's that NumPy reads without a copy: whole, on one CPU."""
    return isinstance(x, jax.Array) and [d.platform for d in x.devices()] == ["cpu"]


@functools.lru_cache(maxsize=512)
def reading(f: Callable, fixed: tuple[Hashable, ...], shapes: tuple[tuple[int, ...], ...]) -> tuple[Formula, tuple]:
    """Read a function of arrays; with it comes the shape of what it returns."""
    shape: list[tuple[int, ...]] = []

    def called(*arrays: object) -> tuple[Array]:
        out = f(*fixed, *arrays)
        shape.append(out.shape)
        return (out,)

    with numbers(WIDE):
        return Formula(trace(called, *shapes)), shape[-1]


def needed_inputs(f: Callable, fixed: tuple[Hashable, ...], shapes: tuple[tuple[int, ...], ...]) -> frozenset[int]:
    """Places of the numbers that a function of arrays needs, among all that it is given, array after array."""
    program = reading(f, fixed, shapes)[0].program
    return frozenset(node.value for node in program.nodes if node.op == "input") if program else frozenset()


@functools.lru_cache(maxsize=512)
def _time_derivative(f: Callable, fixed: tuple[Hashable, ...], shapes: tuple, order: int) -> Formula:
    found, count = reading(f, fixed, shapes)[0], int(np.prod(shapes[0], dtype=int))
    return found.rate(count, order)


def on_lanes(
    f: Callable,
    fixed: tuple[Hashable, ...],
    q: np.ndarray,
    rates: Sequence[Numbers] = (),
    constants: Sequence[Array] = (),
) -> np.ndarray:
    """The k-th time derivative of a function of one pose, ``(..., *shape)``, along poses with their first k.

    `f` is a pure JAX function ``f(*fixed, pose, *constants)`` that returns one array, and `fixed` all that decides what
    it does. Poses and their rates are ``(..., N)``; constants are the same for all.
    """
    found = columns_on_lanes(f, fixed, [q], [[term] for term in rates], constants)
    out = np.stack(found, axis=-1) if found else np.zeros((*q.shape[:-1], 0))
    shape = reading(f, fixed, (q.shape[-1:], *(np.shape(c) for c in constants)))[1]
    return out.reshape(*q.shape[:-1], *shape).astype(q.dtype, copy=False)


def columns_on_lanes(
    f: Callable,
    fixed: tuple[Hashable, ...],
    q: Sequence[Any],
    rates: Sequence[Sequence[Any]] = (),
    constants: Sequence[Any] = (),
) -> list[Any]:
    """Evaluate the same number by number, ``(...,)`` each: in NumPy, or in JAX where poses are no NumPy arrays.

    Poses are in parts ``(..., k)``, one behind the other, and so are their rates.
    """
    lead, traced = q[0].shape[:-1], not isinstance(q[0], np.ndarray)
    given: list[Any] = [jnp.asarray(c) if traced else np.asarray(c) for c in constants]
    shapes = ((sum(part.shape[-1] for part in q),), *(c.shape for c in given))
    found = _time_derivative(f, fixed, shapes, len(rates))
    if traced:
        return _columns_in_jax(found.traced, tuple(q), tuple(map(tuple, rates)), tuple(given))
    x = [column for part in q for column in np.moveaxis(part, -1, 0)]
    x += [number for c in given for number in c.reshape(-1)]
    x += [column for term in rates for part in term for column in np.moveaxis(np.asarray(part), -1, 0)]
    with np.errstate(all="ignore"):
        return [np.broadcast_to(value, lead).astype(q[0].dtype, copy=False) for value in found.on_lanes(x)]


@functools.partial(jit, static_argnums=0)
def _columns_in_jax(run: Callable, q: tuple, rates: tuple, constants: tuple) -> list[Numbers]:
    def columns(part: Array) -> list[Array]:
        return [part[..., k] for k in range(part.shape[-1])]

    x = [column for part in q for column in columns(part)]
    x += [number for c in constants for number in columns(c.reshape(-1))]
    x += [column for term in rates for part in term for column in columns(part)]
    return [jnp.broadcast_to(jnp.asarray(value, q[0].dtype), q[0].shape[:-1]) for value in run(x)]
