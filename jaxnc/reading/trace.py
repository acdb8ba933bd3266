"""From a JAX function to a program: its jaxpr, read number by number.

Arrays fall apart into their numbers: to move numbers is to move places of nodes, and arithmetic becomes operations on
single numbers. One table (`jaxnc.reading.operations`) says for every operation how it is read, and for which types of
numbers. What depends on an operation that the table does not have, or not for these types, is `Unreadable`, unless
the operation depends on no input: then JAX evaluates it, with types of its own.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from jaxnc.internals import name_of_jax
from jaxnc.reading.operations import CALLED, PLAIN, READINGS, RULED, WRITTEN_OUT, Nodes, Unreadable, evaluate_equation
from jaxnc.reading.program import Builder, Program

if TYPE_CHECKING:
    from jax.extend.core import JaxprEqn

_UNREAD = "unread"
_EXACT = 2**53  # larger integers are no floats


def trace(f: Callable, *shapes: tuple[int, ...], values_only: bool = False) -> Program:
    """Read a function of arrays of floats as a program, one number after the other.

    Args:
        f: the function.
        shapes: of its arguments.
        values_only: whether nobody asks for derivatives, so that functions with a rule of their own for them are read.

    Raises:
        Unreadable: some operation cannot be read.
        OutOfRange: an index that is known lies beyond its array.
    """
    dtype = jax.dtypes.canonicalize_dtype(np.float64)
    closed = jax.make_jaxpr(lambda *x: tuple(f(*x)))(*(jax.ShapeDtypeStruct(s, dtype) for s in shapes))
    sizes = [math.prod(s) for s in shapes]
    reader = Reader(Builder(sum(sizes)), dtype, values_only)
    ends = np.cumsum([0, *sizes])
    places = np.array(reader.b.first, dtype=int)
    arguments = [places[ends[k] : ends[k + 1]].reshape(s) for k, s in enumerate(shapes)]
    out = reader.read(closed.jaxpr, closed.consts, arguments)
    program = reader.b.program([int(i) for x in out for i in x.reshape(-1)])
    for node in program.nodes:
        if node.op == _UNREAD:
            raise Unreadable(node.value[0])
    return program


class Reader:
    """A program that is being read from jaxprs.

    Attributes:
        b: the program.
        dtype: type of the floats that it calculates with; floats of other types round elsewhere, and are not read.
    """

    def __init__(self, b: Builder, dtype: np.dtype, values_only: bool):
        self.b, self.dtype, self._values_only = b, dtype, values_only
        self._bounds: dict[int, tuple[float, float]] = {}

    def read(self, jaxpr: Any, consts: Sequence[Any], arguments: Sequence[Nodes]) -> list[Nodes]:
        """Write the equations of a jaxpr; return where its results are."""
        space: dict[Any, Nodes] = {}
        for v, c in zip(jaxpr.constvars, consts, strict=True):
            space[v] = self.numbers(c) if isinstance(v.aval.dtype, np.dtype) else self._unread("random keys", v)
        space.update(zip(jaxpr.invars, arguments, strict=True))

        def at(v: Any) -> Nodes:
            return self.numbers(v.val) if hasattr(v, "val") else space[v]  # jax.extend.core.Literal, without its import

        for eqn in jaxpr.eqns:
            x = [at(v) for v in eqn.invars]
            try:
                out = self._equation(eqn, x)
            except Unreadable as reason:
                out = self._otherwise(eqn, x, reason.primitive)
            space.update(zip(eqn.outvars, out, strict=True))
        return [at(v) for v in jaxpr.outvars]

    def _equation(self, eqn: Any, x: list[Nodes]) -> list[Nodes]:
        name = eqn.primitive.name
        if operation := _written_out(eqn):
            return [self.each(operation, *x)]
        if name in CALLED:
            return self.read(*_open_jaxpr(eqn.params[CALLED[name]]), x)
        if name in RULED:
            inner = _open_jaxpr(eqn.params[RULED[name]])
            plain = self._values_only or name_of_jax(inner[0]) in PLAIN
            if plain or self._known_inputs(eqn, x) is not None:
                return self.read(*inner, x)
        if name == "stop_gradient" and self._values_only:
            return x
        types, read = READINGS.get(name, ("", ""))
        if any(self.type_of(v) not in types for v in eqn.invars) or not read:
            raise Unreadable(f"{name} of {' and '.join(dict.fromkeys(str(v.aval.dtype) for v in eqn.invars))}")
        out = self.each(read, *x) if isinstance(read, str) else read(self, eqn, *x)
        out = [out] if isinstance(out, np.ndarray) else list(out)
        for y, v in zip(out, eqn.outvars, strict=True):
            if self.type_of(v) == "?" or (self.type_of(v) == "i" and not self._fits(y, v.aval.dtype)):
                raise Unreadable(f"{name} as {v.aval.dtype}")
        return out

    def _otherwise(self, eqn: Any, x: list[Nodes], why: str) -> list[Nodes]:
        """Return results of an equation that is not read: known if it depends on no input."""
        known = self._known_inputs(eqn, x)
        if known is not None and all(isinstance(v.aval.dtype, np.dtype) for v in eqn.outvars):  # not random keys
            return [self.numbers(y) for y in evaluate_equation(eqn, known)]
        for inner in _inner_jaxprs(eqn.params.values()):  # whose indices are looked at all the same
            self.read(*_open_jaxpr(inner), [self._unread(why, v) for v in _open_jaxpr(inner)[0].invars])
        return [self._unread(why, v) for v in eqn.outvars]

    def _known_inputs(self, eqn: "JaxprEqn", x: list[Nodes]) -> list[np.ndarray] | None:
        known: Any = [self.known(a, v) for a, v in zip(x, eqn.invars, strict=True)]
        return None if any(k is None for k in known) else known

    def _unread(self, why: str, v: Any) -> Nodes:
        size = math.prod(v.aval.shape)
        return np.array([self.b.opaque(_UNREAD, why) for _ in range(size)], dtype=int).reshape(v.aval.shape)

    def numbers(self, value: object) -> Nodes:
        """Write an array that is known."""
        value = np.asarray(value)
        return np.array([self.b.number(x) for x in value.reshape(-1)], dtype=int).reshape(value.shape)

    def known(self, x: Nodes, v: Any) -> np.ndarray | None:
        """Return the array that these nodes are, of a variable of the jaxpr; None if it depends on an input."""
        found = [self.b.known(i) for i in x.reshape(-1).tolist()]
        return None if any(n is None for n in found) else np.array(found, v.aval.dtype).reshape(x.shape)

    def each(self, op: str, *x: Nodes, value: int | None = None) -> Nodes:
        """Write an operation on arrays, number by number."""
        parts = np.broadcast_arrays(*x)
        flat = zip(*(a.reshape(-1).tolist() for a in parts), strict=True)
        return np.array([self.b.op(op, *i, value=value) for i in flat], dtype=int).reshape(parts[0].shape)

    def type_of(self, v: Any) -> str:
        """Return the type of a variable's numbers: f for floats, i for integers, b for truth values, ? for others."""
        if v.aval.dtype == self.dtype:
            return "f"
        return {"b": "b", "i": "i", "u": "i"}.get(getattr(v.aval.dtype, "kind", ""), "?")

    def _fits(self, x: Nodes, dtype: np.dtype) -> bool:
        """Say whether integers are sure not to overflow, and exact as floats."""
        least, most = max(np.iinfo(dtype).min, -_EXACT), min(np.iinfo(dtype).max, _EXACT)
        bounds = [self._range(i) for i in x.reshape(-1).tolist()]
        return all(least <= low and high <= most for low, high in bounds)

    def _range(self, at: int) -> tuple[float, float]:
        """Return bounds of an integer."""
        found = self._bounds.get(at)
        if found is None:
            op, of, value = self.b.nodes[at]
            ends = [self._range(i) for i in (of[1:] if op == "select" else of)] if op in _BOUNDS else []
            found = self._bounds[at] = (
                (value[1], value[1]) if op == "number" else _BOUNDS.get(op, lambda *_: (-math.inf, math.inf))(*ends)
            )
        return found


def _bounds_at_corners(f: Callable) -> Callable[..., tuple[float, float]]:
    def bounds(x: tuple[float, float], y: tuple[float, float]) -> tuple[float, float]:
        ends = [f(a, b) for a in x for b in y]
        return min(ends), max(ends)

    return bounds


_BOUNDS: dict[str, Callable[..., tuple[float, float]]] = {
    "float": lambda _: (0, 1),
    "sign": lambda _: (-1, 1),
    "neg": lambda x: (-x[1], -x[0]),
    "abs": lambda x: (0, max(-x[0], x[1])),
    "select": lambda x, y: (min(x[0], y[0]), max(x[1], y[1])),
    "add": _bounds_at_corners(lambda x, y: x + y),
    "sub": _bounds_at_corners(lambda x, y: x - y),
    "mul": _bounds_at_corners(lambda x, y: x * y),
    "max": _bounds_at_corners(max),
    "min": _bounds_at_corners(min),
}
"""Bounds of an operation's result from those of what it takes."""


def _inner_jaxprs(values: Iterable) -> Iterator:
    """Yield the jaxprs that an equation has among its parameters."""
    for value in values:
        if isinstance(value, tuple | list):
            yield from _inner_jaxprs(value)
        elif hasattr(value, "eqns"):
            yield value


def _written_out(eqn: "JaxprEqn") -> str | None:
    """Return the operation that an equation writes out for XLA, within its rule for derivatives or without."""
    name = eqn.primitive.name
    if name in RULED:
        inner, _ = _open_jaxpr(eqn.params[RULED[name]])
        return _written_out(inner.eqns[0]) if len(inner.eqns) == 1 else None
    return WRITTEN_OUT.get(eqn.params["name"]) if name in CALLED and "name" in eqn.params else None


def _open_jaxpr(inner: object) -> tuple[Any, Sequence[Any]]:
    """Return a jaxpr and its constants."""
    return getattr(inner, "jaxpr", inner), getattr(inner, "consts", ())
