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
from jaxnc.reading import Program, function, rate, trace
from jaxnc.system.precision import WIDE, numbers
from jaxnc.types import Array, Numbers


def on_host(*given: object) -> bool:
    """Tell whether poses, given first, were found on the host, and nothing is traced, which makes arrays of JAX's."""
    traced = not outermost() or any(isinstance(x, Tracer) for x in jax.tree.leaves(given))
    return isinstance(given[0], np.ndarray) and not traced


@functools.lru_cache(maxsize=512)
def reading(f: Callable, fixed: tuple[Hashable, ...], shapes: tuple[tuple[int, ...], ...]) -> tuple[Program, tuple]:
    """The program of a function of arrays, and the shape of what it returns."""
    shape: list[tuple[int, ...]] = []

    def called(*arrays: object) -> tuple[Array]:
        out = f(*fixed, *arrays)
        shape.append(out.shape)
        return (out,)

    with numbers(WIDE):
        return trace(called, *shapes), shape[-1]


def needed_inputs(f: Callable, fixed: tuple[Hashable, ...], shapes: tuple[tuple[int, ...], ...]) -> frozenset[int]:
    """Places of the numbers that a function of arrays needs, among all that it is given, array after array."""
    program, _ = reading(f, fixed, shapes)
    return frozenset(node.value for node in program.nodes if node.op == "input")


@functools.lru_cache(maxsize=512)
def _function(f: Callable, fixed: tuple[Hashable, ...], shapes: tuple, order: int, traced: bool = False) -> Callable:
    program, _ = reading(f, fixed, shapes)
    return function(rate(program, range(int(np.prod(shapes[0], dtype=int))), order), jnp if traced else np)


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
    run = _function(f, fixed, shapes, len(rates), traced)
    if traced:
        return _columns_in_jax(run, tuple(q), tuple(map(tuple, rates)), tuple(given))
    x = [column for part in q for column in np.moveaxis(part, -1, 0)]
    x += [number for c in given for number in c.reshape(-1)]
    x += [column for term in rates for part in term for column in np.moveaxis(np.asarray(part), -1, 0)]
    with np.errstate(all="ignore"):
        return [np.broadcast_to(value, lead).astype(q[0].dtype, copy=False) for value in run(x)]


@functools.partial(jit, static_argnums=0)
def _columns_in_jax(run: Callable, q: tuple, rates: tuple, constants: tuple) -> list[Numbers]:
    def columns(part: Array) -> list[Array]:
        return [part[..., k] for k in range(part.shape[-1])]

    x = [column for part in q for column in columns(part)]
    x += [number for c in constants for number in columns(c.reshape(-1))]
    x += [column for term in rates for part in term for column in columns(part)]
    return [jnp.broadcast_to(jnp.asarray(value, q[0].dtype), q[0].shape[:-1]) for value in run(x)]


def carrying(program: Program) -> Callable[[Sequence[np.ndarray]], list[np.ndarray]]:
    """A function on arrays ``(..., 1 + changes)``: along the last axis a number and its derivatives."""
    plain = function(program)

    @functools.cache
    def push() -> Callable:
        return function(rate(program, range(program.inputs), 1))

    def run(x: Sequence[np.ndarray]) -> list[np.ndarray]:
        values = [a[..., 0] for a in x]
        lead, width = np.broadcast_shapes(*(v.shape for v in values)), max((a.shape[-1] for a in x), default=1)
        found = [np.broadcast_to(v, lead)[..., None] for v in plain(values)]
        if width == 1:
            return found
        changes = push()([*(v[..., None] for v in values), *(a[..., 1:] for a in x)])
        changes = [np.broadcast_to(c, (*lead, width - 1)) for c in changes]
        return [np.concatenate(pair, axis=-1) for pair in zip(found, changes, strict=True)]

    return run
