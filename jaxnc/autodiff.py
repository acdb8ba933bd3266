"""Derivatives that are given to a result by a rule, which JAX keeps through every transformation.

`jax.custom_jvp` loses its rule where JAX splits a `jax.lax.scan` or `jax.lax.map` for reverse mode: the function is
written out in the half that is known, and a second derivative is silently that of the value's own program, for a solved
pose none at all. Here the rule belongs to a primitive whose derivative binds the primitive once more, so that
derivatives of every order are found by the same rule, forward and in reverse, mapped and in loops.
"""

import functools
import itertools
from collections.abc import Callable, Hashable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import ShapedArray, Tracer
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from jaxnc.calls import promoted
from jaxnc.compiling import in_chunks, jit
from jaxnc.types import AnyArray, Array, PyTree

Arrays = Sequence[Array]
# Change of the value, a pytree as it is, of (what is static, the value, its arguments, the changes of these).
Rule = Callable[[PyTree, PyTree, tuple, tuple], PyTree]


class TwoRules(NamedTuple):
    """Two rules for one derivative: one is soon compiled, the other is quick where there are many lanes."""

    few: Rule
    many: Rule
    least: int  # numbers that the first array of the value has where there are many, all that it is mapped over too


def attach(rule: Rule | TwoRules, static: Hashable, value: object, *args: object) -> PyTree:
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


def attach_matrix(value: PyTree, by: tuple[Array, ...], slopes: np.ndarray) -> PyTree:
    """Give known arrays their derivatives by some others: a matrix of numbers, which has no derivatives itself.

    Args:
        value: a pytree of arrays.
        by: arrays by which it is differentiated once.
        slopes: derivatives of all numbers of the value by all of these, ``(numbers, numbers)``.
    """
    return attach(_change_by_matrix, None, value, by, slopes)


def _change_by_matrix(_: None, value: PyTree, args: tuple, changes: tuple) -> PyTree:
    return _multiply_matrix(value, changes[0], args[1])


@jit
def _multiply_matrix(value: PyTree, changes: tuple[Array, ...], slopes: Array) -> PyTree:
    leaves, structure = jax.tree.flatten(value)
    flat = slopes @ jnp.concatenate([jnp.ravel(x) for x in changes])
    parts = jnp.split(flat, np.cumsum([leaf.size for leaf in leaves])[:-1])
    return jax.tree.unflatten(structure, [x.reshape(leaf.shape) for x, leaf in zip(parts, leaves, strict=True)])


def solve_linear(
    product: Callable[[tuple], tuple],
    right: tuple,
    solve: Callable[[tuple], tuple],
    transposed: Callable[[tuple], tuple] | None = None,
) -> tuple:
    """Solve a linear system whose unknowns and rows are several arrays, with derivatives of every order.

    It is `jax.lax.custom_linear_solve`, which is transposed only if every part depends on what is differentiated. So
    each part has all others added to it, times zero: a part may be constant, or not used.

    Args:
        product: the linear function, of as many arrays as it returns.
        right: what it shall give: arrays of one shape, each element a system of its own, or of several shapes, all of
            one system.
        solve: solve for a right-hand side; it is not differentiated.
        transposed: likewise of the transposed function; the function is symmetric if not given.
    """

    def tie_parts(parts: tuple) -> tuple:
        alike = len({jnp.shape(part) for part in parts}) == 1
        none = 0.0 * functools.reduce(jnp.add, parts if alike else [jnp.sum(part) for part in parts])
        return tuple(part + none for part in parts)

    back = None if transposed is None else lambda _, given: transposed(given)
    return tie_parts(
        lax.custom_linear_solve(
            lambda x: tie_parts(product(tie_parts(x))),
            tie_parts(right),
            lambda _, given: solve(given),
            back,
            symmetric=back is None,
        )
    )


def _pass_value(*arrays: object, count: int, **_: object) -> list:
    return list(arrays[:count])


@promoted
def _attached_change(primals: Sequence, tangents: Sequence, **params: Any) -> tuple[list, list]:
    value = _ATTACH.bind(*primals, **params)
    count, axes = params["count"], params["axes"]
    moving = [k for k, d in enumerate(tangents) if k >= count and not _is_still(d)]
    rule = params["rule"]
    if isinstance(rule, TwoRules):
        rule = rule.many if primals[0].size >= rule.least else rule.few

    def change(arrays: Sequence, changes: Sequence) -> list:
        found = {k: jnp.asarray(d) for k, d in zip(moving, changes, strict=True)}
        every = [found[k] if k in found else _zero(x) for k, x in enumerate(arrays)]
        args, args_dot = (jax.tree.unflatten(params["structure"], a[count:]) for a in (arrays, every))
        at = jax.tree.unflatten(params["shape"], arrays[:count])
        return jax.tree.leaves(rule(params["static"], at, args, args_dot))

    for mapped in axes:
        change = jax.vmap(change, in_axes=(list(mapped), [mapped[k] for k in moving]))
    arrays, changes = [*value, *primals[count:]], [tangents[k] for k in moving]
    if not axes:
        return value, change(arrays, changes)
    return value, _in_turns(change, axes[-1], [axes[-1][k] for k in moving], arrays, changes)


def _in_turns(change: Callable, mapped: Sequence, moving: Sequence, arrays: Sequence, changes: Sequence) -> list:
    """Map a change over its outermost axis chunk by chunk: what a chunk needs stays in a CPU's cache."""
    every, flags = [*arrays, *changes], [*mapped, *moving]
    along = [x for x, axis in zip(every, flags, strict=True) if axis == 0]

    def some(*parts: Array) -> list:
        rest = iter(parts)
        full = [next(rest) if axis == 0 else x for x, axis in zip(every, flags, strict=True)]
        return change(full[: len(arrays)], full[len(arrays) :])

    return in_chunks(some, 2048, *along)


@promoted
def _attached_batch(arrays: Sequence, dims: Sequence, **params: Any) -> tuple[list, list[int]]:
    every, mapped = _lanes_first(arrays, dims, [k >= params["count"] for k in range(len(arrays))])
    found = _ATTACH.bind(*every, **(params | {"axes": (*params["axes"], mapped)}))
    return found, [0] * len(found)


def _lanes_first(arrays: Sequence, dims: Sequence, shared: Sequence[bool]) -> tuple[list, tuple]:
    """Arrays with their mapped axes first, and these; such as are not mapped get one, unless they may be shared."""
    size = next(a.shape[d] for a, d in zip(arrays, dims, strict=True) if d is not None)
    every, mapped = [], []
    for a, d, may in zip(arrays, dims, shared, strict=True):
        one = d is None  # not mapped
        mapped.append(None if one and may else 0)
        if not one:
            every.append(jnp.moveaxis(a, d, 0) if d else a)
        else:
            every.append(a if may else jnp.broadcast_to(a, (size, *jnp.shape(a))))
    return every, tuple(mapped)


_ATTACH = Primitive("attach")
_ATTACH.multiple_results = True
_ATTACH.def_impl(_pass_value)
_ATTACH.def_abstract_eval(_pass_value)
ad.primitive_jvps[_ATTACH] = _attached_change
batching.primitive_batchers[_ATTACH] = _attached_batch
mlir.register_lowering(_ATTACH, mlir.lower_fun(_pass_value, multiple_results=True))


def _is_still(change: object) -> bool:
    return type(change) is ad.Zero or getattr(change, "dtype", None) == jax.dtypes.float0


def _zero(x: AnyArray) -> np.ndarray:
    """The tangent of an array that has none, NumPy's: JAX's would be compiled."""
    dtype = jax.dtypes.result_type(x)
    return np.zeros(np.shape(x), dtype if jax.dtypes.issubdtype(dtype, np.inexact) else jax.dtypes.float0)


class Rules(NamedTuple):
    """A function and its two linear ones, pure and hashable; all take and return lists of arrays."""

    # (what, x, rest) to what is differentiated and what is not.
    value: Callable[..., tuple[list, list]]
    # (what, x, rest, smooth, other, change): the change of what is differentiated with that of x; the value there is
    # `smooth`, which is differentiated, and `other`.
    tangent: Callable[..., list]
    # (what, x, rest, smooth, other, change): the transpose, a list as x.
    cotangent: Callable


def custom_jvp_vjp(rules: Rules, what: Hashable, x: list, rest: list) -> tuple[list, list]:
    """Evaluate a function that has a program of its own for each direction of differentiation.

    JAX lets a function have a rule for one of them only: `jax.custom_jvp` gives up what is quick in reverse, and
    `jax.custom_vjp` refuses to go forward. Here a derivative of order k, ``Dᵏf(x)[d₁ … dₖ]`` or, pulled back,
    ``cᵀ Dᵏf(x)[d₁ … dₖ₋₁, ·]``, is a primitive, linear in every d and in c. By x it is differentiated to the next
    order; Dᵏf is symmetric, so that its transpose by any d or c is one of the two again. The programs are only ever
    differentiated forward, and may have loops that JAX cannot go back through. Each is compiled by itself, with the
    options of `jaxnc.compiling` where nothing else is compiled around it.

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
    x, rest, other = args
    rules, what = static
    return _bind([x, rest, smooth, other, changes[0]], rules=rules, what=what, back=False, axes=())


_X, _REST, _SMOOTH, _OTHER, _LINEAR = range(5)  # the groups of arrays of a derivative; from the last on, c and all d


def _bind(groups: Sequence[Arrays], **params: object) -> list:
    return _DERIVATIVE.bind(*itertools.chain(*groups), **(params | {"sizes": tuple(map(len, groups))}))


def _groups_of(sizes: tuple[int, ...], args: Sequence) -> list[Sequence]:
    ends = list(itertools.accumulate(sizes, initial=0))
    return [args[a:b] for a, b in itertools.pairwise(ends)]


@promoted
def _run_rule(*args: Array, rules: Rules, what: Hashable, back: bool, sizes: tuple[int, ...], axes: tuple) -> list:
    program = rules.cotangent if back else rules.tangent

    def one(args: Arrays) -> list:
        x, rest, smooth, other, first, *ways = _groups_of(sizes, args)

        def along(x: Arrays) -> list:
            value = attach(_push, (rules, what), smooth, x, rest, other)
            return list(program(what, x, rest, value, other, first))

        for way in ways:
            along = functools.partial(_along_changes, along, way)
        return along(x)

    for mapped in axes:
        one = jax.vmap(one, in_axes=([*mapped, *[0] * (len(args) - len(mapped))],))
    return one(list(args))


def _along_changes(f: Callable, way: Arrays, x: Arrays) -> list:
    return jax.jvp(f, (x,), (way,))[1]


def _derived_shapes(*avals: object, back: bool, sizes: tuple[int, ...], **_: object) -> list:
    return [ShapedArray(a.shape, a.dtype) for a in _groups_of(sizes, avals)[_X if back else _SMOOTH]]


@promoted
def _derived_change(primals: Sequence, tangents: Sequence, **params: Any) -> tuple[list, list]:
    groups, changes = (_groups_of(params["sizes"], x) for x in (primals, tangents))
    terms = []
    for k in (_X, *range(_LINEAR, len(groups))):
        if all(map(_is_still, changes[k])):
            continue
        change = [_zero(x) if _is_still(d) else d for x, d in zip(groups[k], changes[k], strict=True)]
        terms.append(_bind([*groups, change] if k == _X else [*groups[:k], change, *groups[k + 1 :]], **params))
    return _DERIVATIVE.bind(*primals, **params), [functools.reduce(jnp.add, x) for x in zip(*terms, strict=True)]


@promoted
def _derived_batch(arrays: Sequence, dims: Sequence, **params: Any) -> tuple[list, list[int]]:
    sizes = params["sizes"]
    shared = [k in (_REST, _OTHER) for k, size in enumerate(sizes) for _ in range(size)]
    every, mapped = _lanes_first(arrays, dims, shared)
    found = _DERIVATIVE.bind(*every, **(params | {"axes": (*params["axes"], mapped[: sum(sizes[:_LINEAR])])}))
    return found, [0] * len(found)


def _derived_transpose(cotangents: Sequence, *args: Any, back: bool, sizes: tuple[int, ...], **params: Any) -> list:
    groups = _groups_of(sizes, args)
    by = next(k for k, group in enumerate(groups) if any(map(ad.is_undefined_primal, group)))
    given = [_zero(c.aval) if type(c) is ad.Zero else c for c in cotangents]
    others = [*groups[_LINEAR:by], *groups[by + 1 :]]
    kept = others[:1] if back and by > _LINEAR else []  # the change of the result that is pulled back still
    again = bool(kept) or not back
    found = iter(_bind([*groups[:_LINEAR], *kept, given, *others[len(kept) :]], back=again, **params))
    return [next(found) if k == by else None for k, size in enumerate(sizes) for _ in range(size)]


_DERIVATIVE = Primitive("derivative")
_DERIVATIVE.multiple_results = True
_DERIVATIVE.def_impl(_run_rule)
_DERIVATIVE.def_abstract_eval(_derived_shapes)
ad.primitive_jvps[_DERIVATIVE] = _derived_change
ad.primitive_transposes[_DERIVATIVE] = _derived_transpose
batching.primitive_batchers[_DERIVATIVE] = _derived_batch
mlir.register_lowering(_DERIVATIVE, mlir.lower_fun(_run_rule, multiple_results=True))
