"""Functions of one pose on lanes: read once from their JAX statement, evaluated by NumPy with nothing compiled."""

import functools
import itertools
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.autodiff import attach
from jaxnc.compiling import jit
from jaxnc.internals import outermost, values_behind
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


def attach_along(
    f: Callable, fixed: tuple[Hashable, ...], q: Numbers, rates: Sequence[Numbers], constants: Sequence[Numbers]
) -> Array | None:
    """Find what `on_lanes` does of arrays that JAX differentiates once; nothing is compiled but a product with slopes.

    Returns:
        None for arrays that are not known, and for so many lanes that compiling is worth its time.
    """
    given = [q, *constants, *rates]
    known = values_behind(given)
    if known is None or not all(isinstance(x, np.ndarray) or _is_in_memory(x) for x in known):
        return None
    pose, *rest = (np.asarray(x) for x in known)
    const, terms = rest[: len(constants)], rest[len(constants) :]
    shapes, lead = (pose.shape[-1:], *(c.shape for c in const)), pose.shape[:-1]
    derivative = _time_derivative(f, fixed, shapes, len(rates))
    assert derivative.program is not None
    shared = [0 < k <= len(constants) for k in range(len(given))]
    counts = [np.size(x) if one else np.shape(x)[-1] for x, one in zip(given, shared, strict=True)]
    changing = np.concatenate([np.full(n, isinstance(x, Tracer)) for x, n in zip(given, counts, strict=True)])
    needed = sorted({node.value for node in derivative.program.nodes if node.op == "input" and changing[node.value]})
    most = 2e7  # numbers: a quarter of a second of NumPy's
    if np.prod(lead) * len(needed) * len(derivative.program.nodes) > most:
        return None
    changes = np.zeros((sum(counts), 1, len(needed)))
    changes[needed, 0] = np.eye(len(needed))
    columns = _list_numbers([pose], const, [[term] for term in terms])
    wide = [
        np.concatenate([np.reshape(x, (-1, 1)), np.broadcast_to(change, (np.size(x), len(needed)))], axis=1)
        for x, change in zip(columns, changes, strict=True)
    ]
    with np.errstate(all="ignore"):
        found = derivative.carrying(wide)
    width = (int(np.prod(lead)), 1 + len(needed))
    every = np.stack([np.broadcast_to(x, width) for x in found], axis=1) if found else np.zeros((width[0], 0, width[1]))
    value, slopes = np.split(every.astype(pose.dtype, copy=False), [1], axis=2)
    slopes = np.where(np.isfinite(slopes), slopes, 0.0)  # no pose, no derivative
    array, first = np.repeat(np.arange(len(given)), counts)[needed], np.cumsum([0, *counts])
    by = tuple(sorted(set(array.tolist())))
    value = value.reshape(*lead, *reading(f, fixed, shapes)[1])
    return attach(
        _change_by_lanes,
        tuple(shared[k] for k in by),
        value,
        [given[k] for k in by],
        [np.array(needed, int)[array == k] - first[k] for k in by],
        [slopes[..., array == k] for k in by],
    )


def _change_by_lanes(shared: tuple[bool, ...], value: Array, args: tuple, changes: tuple) -> Array:
    return _multiply_along(shared, value, changes[0], *args[1:])


@functools.partial(jit, static_argnums=0)
def _multiply_along(shared: tuple[bool, ...], value: Array, changes: list, places: list, slopes: list) -> Array:
    out: Any = 0.0
    for one, change, at, slope in zip(shared, changes, places, slopes, strict=True):
        wide = change.reshape(1, -1) if one else change.reshape(-1, change.shape[-1])
        out += (slope * wide[:, None, at]).sum(axis=-1)
    return jnp.reshape(out, value.shape)


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
    array: Any = jnp.asarray if traced else np.asarray
    given = list(map(array, constants))
    shapes = ((sum(part.shape[-1] for part in q),), *(c.shape for c in given))
    found = _time_derivative(f, fixed, shapes, len(rates))
    if traced:
        return _columns_in_jax(found.traced, tuple(q), tuple(map(tuple, rates)), tuple(given))
    x = _list_numbers(q, given, [list(map(array, term)) for term in rates])
    with np.errstate(all="ignore"):
        return [np.broadcast_to(value, lead).astype(q[0].dtype, copy=False) for value in found.on_lanes(x)]


def _list_numbers(q: Sequence[Any], constants: Sequence[Any], rates: Sequence[Sequence[Any]]) -> list[Any]:
    parts = [*q, *(c.reshape(-1) for c in constants), *itertools.chain(*rates)]
    return [part[..., k] for part in parts for k in range(part.shape[-1])]


@functools.partial(jit, static_argnums=0)
def _columns_in_jax(run: Callable, q: tuple, rates: tuple, constants: tuple) -> list[Numbers]:
    values = run(_list_numbers(q, constants, rates))
    return [jnp.broadcast_to(jnp.asarray(value, q[0].dtype), q[0].shape[:-1]) for value in values]
