"""A kind's functions on lanes: each is read once a process, and goes through JAX where it cannot be read."""

import functools
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import blame_callback
from jaxnc.constraints import Kind
from jaxnc.reading import Builder, Program, Unreadable, function, partials, rate
from jaxnc.system.on_lanes import carrying
from jaxnc.system.precision import numbers
from jaxnc.system.structure import arrays, program, size
from jaxnc.system.topology import Topology

Function = Callable[[Sequence[Any]], tuple[Any, ...]]
Indices = tuple[tuple[int, ...], ...]
Carrying = Callable[[Sequence[np.ndarray]], list[np.ndarray]]


@dataclass(frozen=True, eq=False)
class Formula:
    """A function of a few numbers, with its readings; each is made when somebody asks for it."""

    program: Program | None  # None where it cannot be read
    call: Callable[[Any], Any] | None = None  # then the function itself, from an array to an array
    kind: Any = None  # whose function that is: a `Kind`, or a kind of force

    @functools.cached_property
    def on_lanes(self) -> Function:
        """Values of NumPy lanes."""
        if self.program is not None:
            return function(self.program)
        assert self.call is not None and self.kind is not None
        return by_jax(self.call, self.kind)

    @functools.cached_property
    def traced(self) -> Function:
        """Values of JAX's lanes, in traced code too."""
        if self.program is not None:
            return function(self.program, jnp)
        assert self.call is not None
        mapped = jax.vmap(self.call)
        return lambda x: tuple(mapped(jnp.stack(jnp.broadcast_arrays(*x), axis=-1)).T)

    @functools.cached_property
    def carrying(self) -> Carrying:
        """Values and changes of NumPy lanes ``(..., 1 + changes)``; see `jaxnc.system.on_lanes.carrying`."""
        if self.program is not None:
            return carrying(self.program)
        assert self.call is not None and self.kind is not None
        call, plain = self.call, self.on_lanes
        slopes = by_jax(lambda x: jax.jacfwd(call)(x).reshape(-1), self.kind)

        def run(x: Sequence[np.ndarray]) -> list[np.ndarray]:
            given = [a[..., 0] for a in x]
            values, found = plain(given), slopes(given)
            width = max(a.shape[-1] for a in x) - 1
            out = []
            for k, value in enumerate(values):
                change = np.zeros((*value.shape, width), value.dtype)
                for slope, a in zip(found[k * len(x) : (k + 1) * len(x)], x, strict=True):
                    change = change + slope[..., None] * a[..., 1:]
                out.append(np.concatenate([value[..., None], change], axis=-1))
            return out

        return run

    def write(self, b: Builder, inputs: Sequence[int]) -> list[int]:
        """Write the operations into a program; where the results are."""
        if self.program is None:
            raise Unreadable(self.kind.name if self.kind else "a function")
        at = b.append(self.program, inputs)
        return [at[k] for k in self.program.outputs]


@functools.lru_cache(maxsize=1024)
def formula(kind: Kind, which: str, dim: int, order: int = 0) -> Formula:
    """One of a kind's functions, or the time derivative of some order of its rows."""
    found = program(kind, which, dim)
    if found is None:
        return Formula(None, jax_function(kind, which, dim, order), kind)
    return Formula(rate(found, range(size(kind, dim)), order) if order else found)


def jax_function(kind: Kind, which: str, dim: int, order: int = 0) -> Callable[[Any], Any]:
    """One of a kind's functions, or the time derivative of some order of its rows, from an array to an array."""
    f, single = getattr(kind, which), which in ("measure", "misfit")
    count = size(kind, dim)

    def one(x: Any) -> Any:
        p, v, s, c = arrays(kind, dim, x)
        return jnp.stack([jnp.asarray(r, x.dtype) for r in ((f(p, v, c),) if single else f(p, v, s, c))])

    def along(x: Any) -> Any:
        whole, parts = x[: count + len(kind.constants)], x[count + len(kind.constants) :].reshape(order, count)

        def curve(t: Any) -> Any:
            factor, y = 1.0, whole
            for k in range(order):
                factor = factor * t / (k + 1)
                y = y.at[:count].add(factor * parts[k])
            return one(y)

        for _ in range(order):
            curve = functools.partial(lambda t, g: jax.jvp(g, (t,), (jnp.ones_like(t),))[1], g=curve)
        return curve(jnp.zeros((), x.dtype))

    return along if order else one


def by_jax(f: Callable[[Any], Any], kind: Any) -> Function:
    """A function of a kind, from an array to an array, on lanes: evaluated by JAX because it cannot be read."""
    mapped = jax.jit(jax.vmap(f))

    def run(x: Sequence[Any]) -> tuple[Any, ...]:
        x = np.broadcast_arrays(*x)
        with numbers(x[0].dtype), jax.ensure_compile_time_eval():
            try:
                out = np.asarray(mapped(np.stack(x, axis=-1).reshape(-1, len(x))))
            except (jax.errors.JaxRuntimeError, ValueError) as error:
                blame_callback(error, f"{'constraint kind' if isinstance(kind, Kind) else 'kind'} {kind.name!r}")
                raise
        return tuple(out[:, k].reshape(x[0].shape) for k in range(out.shape[1]))

    return run


@dataclass(frozen=True, eq=False)
class HostKind:
    """The functions of a kind on lanes; each takes its variables and constants (`rates` their derivatives too)."""

    rows: Function  # the residual, unscaled
    slopes: Function  # its derivatives that can differ from zero
    places: Indices  # row and variable of each of them
    guard: Function | None  # what must stay positive; None if nothing
    rates: Callable[[int], Function]  # its time derivatives of first, second and third order, made when asked for


@functools.lru_cache(maxsize=1024)
def host_kind(kind: Kind, dim: int) -> HostKind:
    """The functions of a kind, read once a process; through JAX where they cannot be read."""
    guard = None if kind.guard is None else formula(kind, "guard", dim).on_lanes
    slopes, places = row_derivatives(kind, dim, tuple(range(size(kind, dim))), 1)
    return HostKind(
        formula(kind, "residual", dim).on_lanes,
        slopes,
        places,
        guard,
        lambda order: formula(kind, "residual", dim, order).on_lanes,
    )


@functools.lru_cache(maxsize=1024)
def row_derivatives(kind: Kind, dim: int, asked: tuple[int, ...], order: int) -> tuple[Function, Indices]:
    """Derivatives of a kind's rows by some variables and constants, those that can differ from zero.

    Returns:
        A function of variables and constants; and of each of its results the row, then the places.
    """
    found = program(kind, "residual", dim)
    if found is None:
        f, at = jax_function(kind, "residual", dim), np.array(asked, int)
        for _ in range(order):
            f = jax.jacfwd(f)

        def pick(x: Any) -> Any:
            every = f(x)
            for axis in range(1, order + 1):
                every = jnp.take(every, at, axis=axis)
            return every.reshape(-1)

        return by_jax(pick, kind), tuple(itertools.product(range(len(kind.rows)), *[asked] * order))
    places: list[tuple[int, ...]] = [(r,) for r in range(len(kind.rows))]
    for _ in range(order):
        found, pairs = partials(found, asked)
        places = [(*places[k], asked[v]) for k, v in pairs]
    return function(found), tuple(places)


def readable(top: Topology, functions: Sequence[str] = ("residual", "drawn", "measure")) -> bool:
    """Whether such functions of all of a mechanism's kinds can be read, so that nothing goes through JAX."""
    return all(
        getattr(block.kind, which) is None or program(block.kind, which, top.dim) is not None
        for block in top.blocks
        for which in functions
    )
