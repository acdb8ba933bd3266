"""Derivatives that are given to a result by a rule, which JAX keeps through every transformation.

`jax.custom_jvp` loses its rule where JAX splits a `jax.lax.scan` or `jax.lax.map` for reverse mode: the function is
written out in the half that is known, and a second derivative is silently that of the value's own program, for a solved
pose none at all. Here the rule belongs to a primitive whose derivative binds the primitive once more, so that
derivatives of every order are found by the same rule, forward and in reverse, mapped and in loops.
"""

import functools
from collections.abc import Callable, Hashable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import ShapedArray, Tracer
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from jaxnc.promotion import promoted
from jaxnc.types import Array

Arrays = Sequence[Array]
Sizes = tuple[int, int, int, int]
# Change of the value, a pytree as it is, of (what is static, the value, its arguments, the changes of these).
Rule = Callable[[Any, Any, tuple, tuple], Any]


def attach(rule: Rule, static: Hashable, value: Any, *args: Any) -> Any:
    """Give a value, which was found elsewhere, its derivatives by a rule; the value itself passes through unchanged.

    Args:
        rule: the change of the value with its arguments, linear in their changes: a function at module level, of
            `static`, the value, the arguments and their changes (those of arrays that are no real numbers are JAX's
            ``float0``). It sees the value with its derivatives, so that it can be differentiated itself.
        static: what the rule needs beside arrays.
        value: a pytree of arrays, not differentiated itself.
        args: pytrees of arrays by which it is.

    Returns:
        The value.
    """
    found, shape = jax.tree.flatten(value)
    given, structure = jax.tree.flatten(args)
    if not any(isinstance(x, Tracer) for x in given):
        return value
    found = map(lax.stop_gradient, found)
    return jax.tree.unflatten(shape, _ATTACH.bind(
        *found, *given, count=shape.num_leaves, rule=rule, static=static, shape=shape, structure=structure, axes=()
    ))  # fmt: skip


def _attached(*arrays: Any, count: int, **_: Any) -> list:
    return list(arrays[:count])


@promoted
def _attached_change(primals: Sequence, tangents: Sequence, **params: Any) -> tuple[list, list]:
    value = _ATTACH.bind(*primals, **params)
    count, axes = params["count"], params["axes"]
    moving = [k for k, d in enumerate(tangents) if k >= count and not _is_still(d)]

    def change(arrays: Sequence, changes: Sequence) -> list:
        found = {k: jnp.asarray(d) for k, d in zip(moving, changes, strict=True)}
        every = [found[k] if k in found else _zero(x) for k, x in enumerate(arrays)]
        args, args_dot = (jax.tree.unflatten(params["structure"], a[count:]) for a in (arrays, every))
        at = jax.tree.unflatten(params["shape"], arrays[:count])
        return jax.tree.leaves(params["rule"](params["static"], at, args, args_dot))

    for mapped in axes:
        change = jax.vmap(change, in_axes=(list(mapped), [mapped[k] for k in moving]))
    return value, change([*value, *primals[count:]], [tangents[k] for k in moving])


@promoted
def _attached_batch(arrays: Sequence, dims: Sequence, **params: Any) -> tuple[list, list[int]]:
    size = next(a.shape[d] for a, d in zip(arrays, dims, strict=True) if d is not batching.not_mapped)
    every = []
    for k, (a, d) in enumerate(zip(arrays, dims, strict=True)):
        if d is not batching.not_mapped:
            every.append(jnp.moveaxis(a, d, 0) if d else a)
        else:  # of the value too: what is returned is mapped
            every.append(jnp.broadcast_to(a, (size, *jnp.shape(a))) if k < params["count"] else a)
    mapped = tuple(0 if k < params["count"] or d is not batching.not_mapped else None for k, d in enumerate(dims))
    found = _ATTACH.bind(*every, **(params | {"axes": (*params["axes"], mapped)}))
    return found, [0] * len(found)


_ATTACH = Primitive("attach")
_ATTACH.multiple_results = True
_ATTACH.def_impl(_attached)
_ATTACH.def_abstract_eval(_attached)
ad.primitive_jvps[_ATTACH] = _attached_change
batching.primitive_batchers[_ATTACH] = _attached_batch
mlir.register_lowering(_ATTACH, mlir.lower_fun(_attached, multiple_results=True))


def _is_still(change: Any) -> bool:
    return type(change) is ad.Zero or getattr(change, "dtype", None) == jax.dtypes.float0


def _zero(x: Any) -> Any:
    """The tangent of an array that has none, NumPy's: JAX's would be compiled."""
    dtype = jax.dtypes.result_type(x)
    return np.zeros(np.shape(x), dtype if jax.dtypes.issubdtype(dtype, np.inexact) else jax.dtypes.float0)


class Rules(NamedTuple):
    """A function and its two linear ones, pure and hashable; all take and return lists of arrays."""

    # (what, x, rest) to what is differentiated and what is not.
    value: Callable[[Any, Arrays, Arrays], tuple[list, list]]
    # (what, x, rest, smooth, other, change): the change of what is differentiated with that of x; the value there is
    # `smooth`, which is differentiated, and `other`.
    tangent: Callable[[Any, Arrays, Arrays, Arrays, Arrays, Arrays], list]
    # (what, x, rest, smooth, other, change): the transpose, a list as x.
    cotangent: Callable[[Any, Arrays, Arrays, Arrays, Arrays, Arrays], list]


def custom_jvp_vjp(rules: Rules, what: Hashable, x: list, rest: list) -> tuple[list, list]:
    """Evaluate a function that has a program of its own for each direction of differentiation.

    JAX lets a function have a rule for one of them only: `jax.custom_jvp` gives up what is quick in reverse, and
    `jax.custom_vjp` refuses to go forward. Here the change of the result is a primitive, linear in the change of the
    arguments, whose transpose is another one. Each is compiled by itself, with the options of `jaxnc.compiling` where
    nothing else is compiled around it, and is an ordinary function of JAX wherever it is mapped, staged or
    differentiated again.

    Args:
        rules: the function and its derivatives.
        what: what they need beside arrays, hashable.
        x: arrays by which the function is differentiated.
        rest: arrays by which it is not.

    Returns:
        What of the function is differentiated, and what is not, a list of arrays each.
    """
    x_known, rest = lax.stop_gradient((x, rest))
    smooth, other = rules.value(what, x_known, rest)
    return attach(_push, (rules, what), smooth, x, rest, other), other


def _push(static: tuple[Rules, Hashable], smooth: list, args: tuple, changes: tuple) -> list:
    rules, what = static
    x, rest, other = args
    sizes = len(x), len(rest), len(smooth), len(other)
    return _FORWARD.bind(*x, *rest, *smooth, *other, *changes[0], rules=rules, what=what, sizes=sizes)


def _split(sizes: Sizes, args: Arrays) -> list[Arrays]:
    ends = np.cumsum((0, *sizes)).tolist()
    return [args[a:b] for a, b in zip(ends, (*ends[1:], None), strict=True)]


def _forward(rules: Rules, what: Hashable, sizes: Sizes, *args: Array) -> list:
    return list(rules.tangent(what, *_split(sizes, args)))


def _reverse(rules: Rules, what: Hashable, sizes: Sizes, *args: Array) -> list:
    return list(rules.cotangent(what, *_split(sizes, args)))


def _shapes_forward(*avals: Any, sizes: Sizes, **_: Any) -> list:
    return [ShapedArray(a.shape, a.dtype) for a in _split(sizes, avals)[2]]


def _shapes_reverse(*avals: Any, sizes: Sizes, **_: Any) -> list:
    return [ShapedArray(a.shape, a.dtype) for a in _split(sizes, avals)[0]]


def _primitive(name: str, function: Callable, shapes: Callable) -> Primitive:
    found = Primitive(name)
    found.multiple_results = True

    @promoted
    def run(*args: Array, rules: Rules, what: Hashable, sizes: Sizes) -> list:
        return function(rules, what, sizes, *args)

    def change(primals: Arrays, tangents: Arrays, **params: Any) -> tuple[list, list]:
        given = [_zero(x) if type(d) is ad.Zero else d for x, d in zip(primals, tangents, strict=True)]
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
        given = [_zero(c.aval) if type(c) is ad.Zero else c for c in cotangents]
        return [None] * len(known) + other.bind(*known, *given, sizes=sizes, **params)

    return rule


ad.primitive_transposes[_FORWARD] = _transposed(_REVERSE)
ad.primitive_transposes[_REVERSE] = _transposed(_FORWARD)
