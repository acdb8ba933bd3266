"""A kind's functions in NumPy: its programs on lanes, read once a process; through JAX where they cannot be read."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from jaxnc.compiling import blame_callback
from jaxnc.constraints import Kind
from jaxnc.reading import function, partials, rate
from jaxnc.system.on_lanes import carrying
from jaxnc.system.precision import numbers
from jaxnc.system.structure import arrays, pattern, program, size
from jaxnc.system.topology import Topology

Function = Callable[[Sequence[Any]], tuple[Any, ...]]
Carrying = Callable[[Sequence[np.ndarray]], list[np.ndarray]]


@dataclass(frozen=True, eq=False)
class HostKind:
    """The functions of a kind on lanes; each takes its variables and constants (`rates` their derivatives too)."""

    rows: Function  # the residual, unscaled
    slopes: Function  # its derivatives that can differ from zero
    places: tuple[tuple[int, int], ...]  # row and variable of each of them
    guard: Function | None  # what must stay positive; None if nothing
    rates: Callable[[int], Function]  # its time derivatives of first, second and third order, made when asked for


@functools.lru_cache(maxsize=1024)
def host_kind(kind: Kind, dim: int) -> HostKind:
    """The functions of a kind, read once a process; through JAX where they cannot be read."""
    found = program(kind, "residual", dim)
    count = size(kind, dim)
    if found is None or (kind.guard is not None and program(kind, "guard", dim) is None):
        return _through_jax(kind, dim)
    slopes, places = partials(found, range(count))

    @functools.cache
    def rates(order: int) -> Function:
        return function(rate(found, range(count), order))

    return HostKind(function(found), function(slopes), places, function_of(kind, "guard", dim), rates)


@functools.lru_cache(maxsize=1024)
def function_of(kind: Kind, which: str, dim: int) -> Function | None:
    """One of a kind's functions on lanes; None if it has none."""
    if getattr(kind, which) is None:
        return None
    found = program(kind, which, dim)
    return _mapped(kind, which, dim) if found is None else function(found)


def _mapped(kind: Kind, which: str, dim: int, order: int = 0) -> Function:
    """A function of a kind, or its rate, that is evaluated by JAX because it cannot be read."""
    f, single = getattr(kind, which), which in ("measure", "misfit")
    count = size(kind, dim)

    def one(x: Any) -> Any:
        p, v, s, c = arrays(kind, dim, x)
        return jax.numpy.stack([jax.numpy.asarray(r) for r in ((f(p, v, c),) if single else f(p, v, s, c))])

    def along(x: Any) -> Any:
        whole, parts = x[: count + len(kind.constants)], x[count + len(kind.constants) :].reshape(order, count)

        def curve(t: Any) -> Any:
            factor, y = 1.0, whole
            for k in range(order):
                factor = factor * t / (k + 1)
                y = y.at[:count].add(factor * parts[k])
            return one(y)

        for _ in range(order):
            curve = functools.partial(lambda t, g: jax.jvp(g, (t,), (jax.numpy.ones_like(t),))[1], g=curve)
        return curve(jax.numpy.zeros((), x.dtype))

    return by_jax(along if order else one, kind)


def by_jax(f: Callable[[Any], Any], kind: Kind) -> Function:
    """A function of a kind, from an array to an array, on lanes: evaluated by JAX because it cannot be read."""
    mapped = jax.jit(jax.vmap(f))

    def run(x: Sequence[Any]) -> tuple[Any, ...]:
        x = np.broadcast_arrays(*x)
        with numbers(x[0].dtype), jax.ensure_compile_time_eval():
            try:
                out = np.asarray(mapped(np.stack(x, axis=-1).reshape(-1, len(x))))
            except (jax.errors.JaxRuntimeError, ValueError) as error:
                blame_callback(error, f"constraint kind {kind.name!r}")
                raise
        return tuple(out[:, k].reshape(x[0].shape) for k in range(out.shape[1]))

    return run


def unread_rows(kind: Kind, dim: int) -> Callable[[Any], Any]:
    """A kind's rows as a JAX function of its variables and constants."""
    return lambda x: jax.numpy.stack([jax.numpy.asarray(r) for r in kind.residual(*arrays(kind, dim, x))])


def _through_jax(kind: Kind, dim: int) -> HostKind:
    places = tuple((int(r), int(v)) for r, v in np.argwhere(pattern(kind, dim)))

    rows = unread_rows(kind, dim)

    def wanted(x: Any) -> Any:
        found = jax.jacfwd(rows)(x)
        return jax.numpy.stack([found[r, v] for r, v in places])

    slopes = by_jax(wanted, kind)
    rates = functools.cache(lambda order: _mapped(kind, "residual", dim, order))
    return HostKind(_mapped(kind, "residual", dim), slopes, places, function_of(kind, "guard", dim), rates)


@functools.lru_cache(maxsize=1024)
def carried_rows(kind: Kind, dim: int, order: int) -> Carrying:
    """The rows of a kind that can be read, or their time derivative of some order."""
    found = program(kind, "residual", dim)
    assert found is not None
    return carrying(rate(found, range(size(kind, dim)), order))


def readable(top: Topology, functions: Sequence[str] = ("residual", "drawn", "measure")) -> bool:
    """Whether such functions of all of a mechanism's kinds can be read, so that nothing goes through JAX."""
    return all(
        getattr(block.kind, which) is None or program(block.kind, which, top.dim) is not None
        for block in top.blocks
        for which in functions
    )


@functools.lru_cache(maxsize=1024)
def carrying_kind(kind: Kind, which: str, dim: int) -> Carrying:
    """One of a kind's functions; what cannot be read carries no changes."""
    found = program(kind, which, dim)
    if found is not None:
        return carrying(found)
    plain = _mapped(kind, which, dim)
    return lambda x: [np.asarray(y)[..., None] for y in plain([a[..., 0] for a in x])]
