"""Kinds read from their functions: programs, sparsity and degree, and the functions on lanes.

Nothing is sampled and nothing declared. Each function is read once a process, and goes through JAX where it cannot be
read.
"""

import functools
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import blame_callback
from jaxnc.constraints import Kind, RateKind
from jaxnc.constraints.elementary import Small
from jaxnc.errors import InputError
from jaxnc.forces import ForceKind
from jaxnc.reading import (
    Builder,
    Node,
    Number,
    OutOfRange,
    Polynomial,
    Program,
    Unreadable,
    function,
    partials,
    polynomials,
    rate,
    trace,
    write,
)
from jaxnc.system.precision import WIDE, numbers
from jaxnc.system.topology import Topology
from jaxnc.types import Array, Components, Numbers, Scalar
from jaxnc.validate import as_scalars, call_user

Pairs = tuple[tuple[int, int], ...]
Function = Callable[[Sequence[Any]], tuple[Any, ...]]
Indices = tuple[tuple[int, ...], ...]

_NOT_PLAIN = (TypeError, AttributeError, ValueError, IndexError, NotImplementedError)


def size(kind: Kind | RateKind | ForceKind, dim: int) -> int:
    """Number of variables of one instance: components of points and vectors, then scalars."""
    return (kind.points + kind.vectors) * dim + kind.scalars


@functools.lru_cache(maxsize=1024)
def program(kind: Kind, which: str, dim: int) -> Program | None:
    """The program of one of a kind's functions.

    Args:
        kind: the kind.
        which: ``"residual"``, ``"drawn"``, ``"guard"`` (of variables and constants), ``"measure"`` or ``"misfit"`` (the
            same inputs; scalars are not looked at).
        dim: 2 in the plane, 3 in space.

    Returns:
        A program of the variables followed by the constants; None if the function cannot be read.

    Raises:
        InputError: it returns something else than real numbers, or asks for a point, vector, scalar or constant that
            the kind does not have.
    """
    if getattr(kind, which) is None:
        return None
    try:
        return _read_program(kind, which, dim)
    except OutOfRange as error:
        raise InputError(
            f"kind {kind.name!r}: {which}= asks for {error}: the kind declares points={kind.points}, "
            f"vectors={kind.vectors}, scalars={kind.scalars}, constants={kind.constants}, and a point or vector has "
            f"{dim} components; declare as many as it uses"
        ) from None


def _read_program(kind: Kind, which: str, dim: int) -> Program | None:
    f = getattr(kind, which)
    single, what = which in ("measure", "misfit"), f"kind {kind.name!r}: {which}="
    many = {"residual": len(kind.rows), "drawn": len(kind.constants)}.get(which)

    def called(p: Components, v: Components, s: Components, c: Components) -> Sequence[Scalar]:
        if single:
            return as_scalars((call_user(f, what, "p, v, c", p, v, c),), what)
        rows = as_scalars(call_user(f, what, "p, v, s, c", p, v, s, c), what, many)
        if which == "residual" and any(map(_true_or_false, rows)):
            raise InputError(
                f"{what} returned true or false, of which nothing is known but that: return a number instead that "
                f"says by how much, such as b - a in place of a <= b"
            )
        return rows

    count = size(kind, dim) + len(kind.constants)
    try:
        return write(lambda *x: called(*_as_small(kind, dim, x)), count)
    except OutOfRange:
        raise
    except _NOT_PLAIN:
        pass  # it wants numbers of JAX's
    with numbers(WIDE):
        try:
            return trace(lambda *x: called(*_as_small(kind, dim, x)), *[()] * count)
        except Unreadable:
            return None
        except OutOfRange:
            raise
        except _NOT_PLAIN:
            pass  # it wants arrays; a mistake in it is raised here again
        try:
            return trace(lambda x: called(*arrays(kind, dim, x)), (count,))
        except Unreadable:
            return None


def _true_or_false(row: Scalar) -> bool:
    return (
        isinstance(row, bool)
        or (isinstance(row, Number) and row.truth)
        or getattr(getattr(row, "dtype", None), "kind", "") == "b"
    )


def _as_small(kind: Kind, dim: int, x: Sequence[Scalar]) -> tuple[Small, Small, Small, Small]:
    ends = kind.points, kind.points + kind.vectors
    spread = [Small(x[k * dim : (k + 1) * dim]) for k in range(ends[1])]
    first = ends[1] * dim
    scalars, constants = x[first : first + kind.scalars], x[first + kind.scalars :]
    return Small(spread[: ends[0]]), Small(spread[ends[0] :]), Small(scalars), Small(constants)


def arrays(kind: Kind, dim: int, x: Array) -> tuple[Numbers, Numbers, Numbers, Numbers]:
    """Points, vectors, scalars and constants from an array of variables and constants."""
    p, v, rest = operands(kind, dim, x)
    return p, v, rest[: kind.scalars], rest[kind.scalars :]


def operands(kind: Kind | RateKind | ForceKind, dim: int, x: Array) -> tuple[Array, Array, Array]:
    """Points, vectors and scalars of instances of a kind from their variables ``(..., variables)``."""
    a, b, lead = kind.points * dim, (kind.points + kind.vectors) * dim, x.shape[:-1]
    return x[..., :a].reshape(*lead, kind.points, dim), x[..., a:b].reshape(*lead, kind.vectors, dim), x[..., b:]


@functools.lru_cache(maxsize=1024)
def rows_in(kind: Kind, dim: int, moving: tuple[int, ...] | None = None) -> tuple[Polynomial, ...]:
    """The rows of a kind as polynomials in some of its variables (in all if not given), by their places there."""
    found = program(kind, "residual", dim)
    every = tuple(range(size(kind, dim))) if moving is None else moving
    if found is None:  # all that can be said of what cannot be read
        return (Polynomial(frozenset(range(len(every))), None),) * len(kind.rows)
    return polynomials(found, every)


@functools.lru_cache(maxsize=1024)
def pattern(kind: Kind, dim: int) -> np.ndarray:
    """Structural non-zeros of one instance's Jacobian, ``(rows, variables)`` of booleans."""
    found = np.zeros((len(kind.rows), size(kind, dim)), dtype=bool)
    for r, row in enumerate(rows_in(kind, dim)):
        found[r, list(row.depends)] = True
    return found


@functools.lru_cache(maxsize=1024)
def quadratic(kind: Kind, dim: int) -> bool:
    """Tell whether a kind has rows, each a polynomial of degree two at most, so that its Jacobian is affine."""
    return bool(kind.rows) and all(_row_degree(row) <= 2 for row in rows_in(kind, dim))


_STEEP = {"sqrt", "tan", "asin", "acos", "atan2", "log", "log1p", "pow", "power"}
_JUMPS = {"tan", "atan2", "log", "log1p", "pow", "power", "select", "sign", "floor", "ceil", "round", "rem", "float"}


@functools.lru_cache(maxsize=1024)
def steep(kind: Kind, dim: int) -> bool:
    """Tell whether rows of a kind may have values where their derivatives are not finite."""
    return _uses(kind, dim, _STEEP)


@functools.lru_cache(maxsize=1024)
def jumps(kind: Kind, dim: int) -> bool:
    """Tell whether rows of a user's own kind may jump, or have poles; the library's own do neither."""
    return is_own(kind) and _uses(kind, dim, _JUMPS)


def is_own(kind: Kind) -> bool:
    """Tell whether a kind is a user's own."""
    return not getattr(kind.residual, "__module__", "").startswith("jaxnc.")


def _uses(kind: Kind, dim: int, operations: set[str]) -> bool:
    """Tell whether rows use some operations of the variables, or divide by them; yes of rows that cannot be read."""
    found = program(kind, "residual", dim)
    if found is None:
        return True
    moving: set[int] = set()
    for k, node in enumerate(found.nodes):
        if any(i in moving for i in node.of) or (node.op == "input" and node.value < size(kind, dim)):
            moving.add(k)

    def is_one(k: int, node: Node) -> bool:
        if node.op == "div":
            return node.of[1] in moving
        return k in moving and node.op in operations and not (node.op == "power" and node.value > 0)

    return any(is_one(k, node) for k, node in enumerate(found.nodes))


def _row_degree(row: Polynomial) -> float:
    return np.inf if row.terms is None else max(map(len, row.terms), default=0)


@functools.lru_cache(maxsize=1024)
def curvature(kind: Kind, dim: int, moving: tuple[int, ...]) -> tuple[Pairs | None, ...]:
    """How the rows of an instance curve in some of its variables, whatever the others are.

    Returns:
        Per row the ordered pairs of them whose second derivative can differ from zero, where all second derivatives are
        constant; None for a row of higher degree.
    """
    out: list[Pairs | None] = []
    for row in rows_in(kind, dim, moving):
        if _row_degree(row) > 2:
            out.append(None)
            continue
        squares = [m for m in row.terms or () if len(m) == 2]
        pairs = {(moving[i], moving[j]) for a, b in squares for i, j in ((a, b), (b, a))}
        out.append(tuple(sorted(pairs)))
    return tuple(out)


# -- functions on lanes ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Formula:
    """A function of a few numbers, with its readings; each is made when somebody asks for it."""

    program: Program | None  # None where it cannot be read
    call: Callable | None = None  # then the function itself, from an array to an array
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

    def carrying(self, x: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Values and changes of NumPy lanes ``(..., 1 + changes)``: derivatives stand behind their number."""
        values = [a[..., 0] for a in x]
        lead, width = np.broadcast_shapes(*(v.shape for v in values)), max((a.shape[-1] for a in x), default=1)
        found = [np.broadcast_to(v, lead)[..., None] for v in self.on_lanes(values)]
        if width == 1:
            return found
        changes = self._push([*(v[..., None] for v in values), *(a[..., 1:] for a in x)])
        changes = [np.broadcast_to(c, (*lead, width - 1)) for c in changes]
        return [np.concatenate(pair, axis=-1) for pair in zip(found, changes, strict=True)]

    @functools.cached_property
    def _push(self) -> Function:
        """How the values change, of numbers and their changes."""
        if self.program is not None:
            return self.rate(self.program.inputs, 1).on_lanes
        assert self.call is not None and self.kind is not None
        call = self.call
        slopes = by_jax(lambda x: jax.jacfwd(call)(x).reshape(-1), self.kind)

        def along(x: Sequence[np.ndarray]) -> tuple[Any, ...]:
            count = len(x) // 2
            found, changes = slopes(x[:count]), x[count:]
            rows = (found[k : k + count] for k in range(0, len(found), count))
            return tuple(sum(slope * d for slope, d in zip(row, changes, strict=True)) for row in rows)

        return along

    def rate(self, count: int, order: int) -> "Formula":
        """Read the time derivative of some order, while the first numbers that it takes change."""
        assert self.program is not None
        return Formula(rate(self.program, range(count), order))

    def reading(self, like: Numbers, carries: bool = False) -> Callable[[Sequence[Any]], Sequence[Any]]:
        """Return the reading for arrays such as one; NumPy's may carry changes."""
        return self.traced if not isinstance(like, np.ndarray) else self.carrying if carries else self.on_lanes

    def write(self, b: Builder, inputs: Sequence[int]) -> list[int]:
        """Write the operations into a program; where the results are."""
        if self.program is None:
            raise Unreadable(self.kind.name if self.kind else "a function")
        at = b.append(self.program, inputs)
        return [at[k] for k in self.program.outputs]


@functools.lru_cache(maxsize=1024)
def formula(kind: Kind, which: str, dim: int, order: int = 0) -> Formula:
    """Read one of a kind's functions, or the time derivative of some order of its rows."""
    found = program(kind, which, dim)
    if found is None:
        return Formula(None, jax_function(kind, which, dim, order), kind)
    return Formula(found).rate(size(kind, dim), order)


def jax_function(kind: Kind, which: str, dim: int, order: int = 0) -> Callable:
    """Make a function of arrays of one of a kind's functions, or of the time derivative of some order of its rows."""
    f, single = getattr(kind, which), which in ("measure", "misfit")
    count = size(kind, dim)

    def one(x: Array) -> Any:
        p, v, s, c = arrays(kind, dim, x)
        return jnp.stack([jnp.asarray(r, x.dtype) for r in ((f(p, v, c),) if single else f(p, v, s, c))])

    def along(x: Array) -> Array:
        whole, parts = x[: count + len(kind.constants)], x[count + len(kind.constants) :].reshape(order, count)
        return along_curve(one, whole, [jnp.zeros_like(whole).at[:count].set(part) for part in parts])

    return along if order else one


def along_curve(f: Callable, x: Array, terms: Sequence[Array]) -> Array:
    """The k-th time derivative of a function along a curve through x, whose first k time derivatives are `terms`."""

    def curve(t: Array) -> Array:
        return f(x + sum(t**k / math.factorial(k) * term for k, term in enumerate(terms, start=1)))

    for _ in terms:
        curve = functools.partial(time_rate, curve)
    return curve(jnp.zeros((), x.dtype))


def time_rate(f: Callable, t: Array) -> Array:
    """The derivative of a function of one number."""
    return jax.jvp(f, (t,), (jnp.ones_like(t),))[1]


def by_jax(f: Callable, kind: Kind) -> Function:
    """A function of a kind, from an array to an array, on lanes: evaluated by JAX because it cannot be read."""
    mapped = jax.jit(jax.vmap(f))

    def run(x: Sequence[np.ndarray]) -> tuple[Any, ...]:
        x = np.broadcast_arrays(*x)
        with numbers(x[0].dtype), jax.ensure_compile_time_eval():
            try:
                out = np.asarray(mapped(np.stack(x, axis=-1).reshape(-1, len(x))))
            except (jax.errors.JaxRuntimeError, ValueError) as error:
                blame_callback(error, f"{'constraint kind' if isinstance(kind, Kind) else 'kind'} {kind.name!r}")
                raise
        return tuple(out[:, k].reshape(x[0].shape) for k in range(out.shape[1]))

    return run


class HostKind:
    """The functions of a kind on lanes, through JAX where they cannot be read; each takes its variables and constants.

    Make it with `host_kind`, once a process.
    """

    def __init__(self, kind: Kind, dim: int):
        self._kind, self._dim = kind, dim
        self.rows = formula(kind, "residual", dim).on_lanes  # the residual, unscaled
        # Its derivatives that can differ from zero, and row and variable of each of them.
        self.slopes, self.places = row_derivatives(kind, dim, tuple(range(size(kind, dim))), 1)
        # What must stay positive; None if nothing.
        self.guard = None if kind.guard is None else formula(kind, "guard", dim).on_lanes

    def rates(self, order: int) -> Function:
        """Read a time derivative of the residual, of first, second or third order; it takes derivatives too."""
        return formula(self._kind, "residual", self._dim, order).on_lanes


host_kind = functools.lru_cache(maxsize=1024)(HostKind)


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

        def pick(x: Array) -> Array:
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
    """Tell whether such functions of all of a mechanism's kinds can be read, so that nothing goes through JAX."""
    return all(
        getattr(block.kind, which) is None or program(block.kind, which, top.dim) is not None
        for block in top.blocks
        for which in functions
    )
