"""Functions with a program of their own for each direction of differentiation, forward and in reverse.

JAX lets a function have a rule for one of them only: `jax.custom_jvp` gives up what is quick in reverse, and
`jax.custom_vjp` refuses to go forward. Here the change of the result is a primitive, linear in the change of the
arguments, whose transpose is another one. Each is compiled by itself, with the options of `jaxnc.compiling` where
nothing else is compiled around it, and is an ordinary function of JAX wherever it is mapped, staged or differentiated
again.
"""

import functools
from collections.abc import Callable, Hashable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.core import ShapedArray
from jax.custom_derivatives import SymbolicZero
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from jaxnc.types import Array

Arrays = Sequence[Array]
Sizes = tuple[int, int, int, int]


class Ways(NamedTuple):
    """A function and its two linear ones, pure and hashable; all take and return lists of arrays."""

    # (what, x, rest) to what is differentiated and what is not.
    value: Callable[[Any, Arrays, Arrays], tuple[list, list]]
    # (what, x, rest, smooth, other, change): the change of what is differentiated with that of x; the value there is
    # `smooth`, which is differentiated, and `other`.
    tangent: Callable[[Any, Arrays, Arrays, Arrays, Arrays, Arrays], list]
    # (what, x, rest, smooth, other, change): the transpose, a list as x.
    cotangent: Callable[[Any, Arrays, Arrays, Arrays, Arrays, Arrays], list]


@functools.partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def both_ways(ways: Ways, what: Hashable, x: list, rest: list) -> tuple[list, list]:
    """A function's value, differentiable in both directions.

    It is differentiated by `x`, and not by `rest`; so it is of what it returns, first and last.
    """
    return ways.value(what, x, rest)


@functools.partial(both_ways.defjvp, symbolic_zeros=True)
def _both_ways_jvp(ways, what, primals, tangents):
    x, rest = primals
    smooth, other = both_ways(ways, what, x, rest)
    sizes = len(x), len(rest), len(smooth), len(other)
    change = [_none(a) if _nothing(d) else d for a, d in zip(x, tangents[0], strict=True)]
    found = _FORWARD.bind(*x, *rest, *smooth, *other, *change, ways=ways, what=what, sizes=sizes)
    return (smooth, other), (found, [_none(a) for a in other])


def _nothing(change: Any) -> bool:
    return isinstance(change, SymbolicZero) or getattr(change, "dtype", None) == jax.dtypes.float0


def _none(x: Any) -> Any:
    """The tangent of an array that has none, NumPy's: JAX's would be compiled."""
    dtype = jax.dtypes.result_type(x)
    return np.zeros(np.shape(x), dtype if jax.dtypes.issubdtype(dtype, np.inexact) else jax.dtypes.float0)


def _split(sizes: Sizes, args: Arrays) -> list[Arrays]:
    ends = np.cumsum((0, *sizes)).tolist()
    return [args[a:b] for a, b in zip(ends, (*ends[1:], None), strict=True)]


def _forward(ways: Ways, what: Hashable, sizes: Sizes, *args: Array) -> list:
    return list(ways.tangent(what, *_split(sizes, args)))


def _reverse(ways: Ways, what: Hashable, sizes: Sizes, *args: Array) -> list:
    return list(ways.cotangent(what, *_split(sizes, args)))


def _shapes_forward(*avals: Any, sizes: Sizes, **_: Any) -> list:
    return [ShapedArray(a.shape, a.dtype) for a in _split(sizes, avals)[2]]


def _shapes_reverse(*avals: Any, sizes: Sizes, **_: Any) -> list:
    return [ShapedArray(a.shape, a.dtype) for a in _split(sizes, avals)[0]]


def _primitive(name: str, function: Callable, shapes: Callable) -> Primitive:
    found = Primitive(name)
    found.multiple_results = True

    def run(*args: Array, ways: Ways, what: Hashable, sizes: Sizes) -> list:
        return function(ways, what, sizes, *args)

    def change(primals: Arrays, tangents: Arrays, **params: Any) -> tuple[list, list]:
        given = [_none(x) if type(d) is ad.Zero else d for x, d in zip(primals, tangents, strict=True)]
        return jax.jvp(functools.partial(run, **params), tuple(primals), tuple(given))

    def mapped(args: Arrays, axes: Sequence, **params: Any) -> tuple[list, list[int]]:
        out = jax.vmap(functools.partial(run, **params), in_axes=tuple(axes))(*args)
        return out, [0] * len(out)

    found.def_impl(run)
    found.def_abstract_eval(shapes)
    ad.primitive_jvps[found] = change
    batching.primitive_batchers[found] = mapped
    mlir.register_lowering(found, mlir.lower_fun(run, multiple_results=True))
    return found


_FORWARD = _primitive("change", _forward, _shapes_forward)
_REVERSE = _primitive("pulled_back", _reverse, _shapes_reverse)


def _transposed(other: Primitive) -> Callable:
    def rule(cotangents: Arrays, *args: Any, sizes: Sizes, **params: Any) -> list:
        known = args[: sum(sizes)]
        given = [_none(c.aval) if type(c) is ad.Zero else c for c in cotangents]
        return [None] * len(known) + other.bind(*known, *given, sizes=sizes, **params)

    return rule


ad.primitive_transposes[_FORWARD] = _transposed(_REVERSE)
ad.primitive_transposes[_REVERSE] = _transposed(_FORWARD)
