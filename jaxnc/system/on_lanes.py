"""Functions of one pose on NumPy lanes: read once from their JAX statement, evaluated with nothing compiled."""

import functools
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import jax
import numpy as np
from jax.core import Tracer

from jaxnc.compiling import outermost
from jaxnc.constraints.trigonometry import by_name
from jaxnc.reading import Program, function, rate, trace
from jaxnc.system.precision import WIDE, numbers


def on_host(*given: Any) -> bool:
    """Whether poses, given first, were found on the host, and nothing is traced: traced code makes arrays of JAX's."""
    traced = not outermost() or any(isinstance(x, Tracer) for x in jax.tree.leaves(given))
    return isinstance(given[0], np.ndarray) and not traced


@functools.lru_cache(maxsize=512)
def reading(f: Callable, fixed: tuple[Hashable, ...], shapes: tuple[tuple[int, ...], ...]) -> tuple[Program, tuple]:
    """The program of a function of arrays, and the shape of what it returns."""
    shape: list[tuple[int, ...]] = []

    def called(*arrays: Any) -> tuple[Any]:
        out = f(*fixed, *arrays)
        shape.append(out.shape)
        return (out,)

    with numbers(WIDE), by_name():
        return trace(called, *shapes), shape[-1]


@functools.lru_cache(maxsize=512)
def _function(f: Callable, fixed: tuple[Hashable, ...], shapes: tuple[tuple[int, ...], ...], order: int) -> Callable:
    program, _ = reading(f, fixed, shapes)
    return function(rate(program, range(int(np.prod(shapes[0], dtype=int))), order))


def on_lanes(
    f: Callable, fixed: tuple[Hashable, ...], q: np.ndarray, rates: Sequence[Any] = (), constants: Sequence[Any] = ()
) -> np.ndarray:
    """The k-th time derivative of a function of one pose, ``(..., *shape)``, along poses with their first k.

    `f` is a pure JAX function ``f(*fixed, pose, *constants)`` that returns one array, and `fixed` all that decides what
    it does. Poses and their rates are ``(..., N)``; constants are the same for all.
    """
    given = [np.asarray(c) for c in constants]
    shapes = (q.shape[-1:], *(c.shape for c in given))
    run, shape = _function(f, fixed, shapes, len(rates)), reading(f, fixed, shapes)[1]
    x = [*np.moveaxis(q, -1, 0), *(n for c in given for n in c.reshape(-1))]
    x += [column for term in rates for column in np.moveaxis(np.asarray(term), -1, 0)]
    with np.errstate(all="ignore"):
        found = [np.broadcast_to(value, q.shape[:-1]) for value in run(x)]
    out = np.stack(found, axis=-1) if found else np.zeros((*q.shape[:-1], 0))
    return out.reshape(*q.shape[:-1], *shape).astype(q.dtype, copy=False)


def carrying(program: Program) -> Callable[[Sequence[np.ndarray]], list[np.ndarray]]:
    """A function on arrays ``(..., 1 + changes)``: along the last axis a number and its derivatives."""
    plain = function(program)

    @functools.cache
    def pushed() -> Callable:
        return function(rate(program, range(program.inputs), 1))

    def run(x: Sequence[np.ndarray]) -> list[np.ndarray]:
        values = [a[..., 0] for a in x]
        lead, width = np.broadcast_shapes(*(v.shape for v in values)), max((a.shape[-1] for a in x), default=1)
        found = [np.broadcast_to(v, lead)[..., None] for v in plain(values)]
        if width == 1:
            return found
        changes = pushed()([*(v[..., None] for v in values), *(a[..., 1:] for a in x)])
        changes = [np.broadcast_to(c, (*lead, width - 1)) for c in changes]
        return [np.concatenate(pair, axis=-1) for pair in zip(found, changes, strict=True)]

    return run
