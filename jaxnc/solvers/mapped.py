"""Functions of lanes: with a program of their own where they are mapped, or applied to some lanes at a time.

As by `jax.custom_batching.custom_vmap`, but the program for what is not mapped is traced only where it is compiled.
Under `jax.vmap` the other one is all that is wanted, and tracing takes as long as a third of compiling.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import batching, mlir

from jaxnc.system.precision import numbers
from jaxnc.types import Array


class Mapped:
    """A function of pytrees of arrays with another program for a batch of them; it is not differentiated.

    Numbers that it makes are as wide as the first that it is given.

    Args:
        function: the program.
        shapes: what it returns for such arguments, arrays by `jax.ShapeDtypeStruct`.
        rule: the program for a batch: of its size, of a pytree for each argument that says which arrays have the batch
            as their first axis, and of the arguments. Returns the result and which of its arrays have it.
    """

    def __init__(self, function: Callable[..., Any], shapes: Callable[..., Any], rule: Callable[..., tuple[Any, Any]]):
        self.function, self.shapes, self.rule = function, shapes, rule

    def __call__(self, *args: Any) -> Any:
        """Call it with pytrees of arrays."""
        arrays, structure = jax.tree.flatten(args)
        result = jax.tree.structure(self.shapes(*args))
        return jax.tree.unflatten(result, _MAPPED.bind(*arrays, of=self, structure=structure))


def _called(arrays: Sequence[Array], of: Mapped, structure: Any) -> list[Array]:
    return jax.tree.leaves(of.function(*jax.tree.unflatten(structure, arrays)))


# JAX remembers what was traced: another program with the same function in it does not trace it once more.
_remembered = jax.jit(_called, static_argnums=(1, 2))


def _run(*arrays: Array, of: Mapped, structure: Any, call: Callable[..., list[Array]] = _called) -> list[Array]:
    like = next(a for a in arrays if jnp.issubdtype(a.dtype, jnp.inexact))
    with numbers(like):  # what was said of them around the call is over where this is compiled
        return call(arrays, of, structure)


def _shapes(*avals: Any, of: Mapped, structure: Any) -> list[ShapedArray]:
    found = jax.tree.leaves(of.shapes(*jax.tree.unflatten(structure, avals)))
    return [ShapedArray(a.shape, a.dtype) for a in found]


def _batched(arrays: Sequence[Array], axes: Sequence, of: Mapped, structure: Any) -> tuple[list, list]:
    has = [axis is not None for axis in axes]  # None: not mapped
    size = next(a.shape[axis] for a, axis, b in zip(arrays, axes, has, strict=True) if b)
    first = [jnp.moveaxis(a, axis, 0) if axis else a for a, axis in zip(arrays, axes, strict=True)]
    found, which = of.rule(size, jax.tree.unflatten(structure, has), *jax.tree.unflatten(structure, first))
    return jax.tree.leaves(found), [0 if b else None for b in jax.tree.leaves(which)]


_MAPPED = Primitive("mapped")
_MAPPED.multiple_results = True
_MAPPED.def_impl(_run)
_MAPPED.def_abstract_eval(_shapes)
batching.primitive_batchers[_MAPPED] = _batched
mlir.register_lowering(_MAPPED, mlir.lower_fun(functools.partial(_run, call=_remembered), multiple_results=True))


def in_lanes(
    size: int, shared: bool, which: Sequence[Any], eq: Any, *lanes: Array
) -> tuple[bool, Any, tuple[Array, ...]]:
    """Put a batch of functions of a design and of lanes ``(L, ...)`` into lanes ``(size L, ...)`` of one function.

    Arguments are those of a `Mapped` rule, `shared` whether the design is one for all lanes. Returned is whether it
    still is, the design, or one for each lane, and the lanes.
    """
    in_eq, *others = which
    of_one = shared and not any(jax.tree.leaves(in_eq))

    def wide(a: Array, has: bool) -> Array:
        return a if has else jnp.broadcast_to(a, (size, *a.shape))

    every = [wide(a, has) for a, has in zip(lanes, others, strict=True)]
    count = every[0].shape[1]

    def full(a: Array, has: bool) -> Array:
        a = wide(a, has)
        a = jnp.broadcast_to(a[:, None], (size, count, *a.shape[1:])) if shared else a
        return a.reshape(size * count, *a.shape[2:])

    eq = eq if of_one else jax.tree.map(full, eq, in_eq)
    return of_one, eq, tuple(a.reshape(size * count, *a.shape[2:]) for a in every)


def in_chunks(f: Callable, chunk: int, *arguments: Any) -> Any:
    """A function whose arguments and results have lanes as their first axis, some of these at a time.

    What they need then stays in the cache, and few wait for the slowest.

    Up to twice as many as a `chunk` go at once.
    """
    count = jax.tree.leaves(arguments)[0].shape[0]
    if count <= 2 * chunk:
        return f(*arguments)
    size = next((k for k in range(chunk, chunk // 2, -1) if count % k == 0), chunk)
    if count % size:
        # The last chunk is filled up with its last lane, so that there is one shape to compile.
        fill = -count % size
        arguments = jax.tree.map(lambda x: jnp.concatenate([x, jnp.repeat(x[-1:], fill, axis=0)]), arguments)
    # No axis is left to be found out: arrays without numbers, such as the inputs of a structure, do not tell.
    pieces = jax.tree.map(lambda x: x.reshape(x.shape[0] // size, size, *x.shape[1:]), arguments)
    out = lax.map(lambda some: f(*some), pieces)
    return jax.tree.map(lambda x: x.reshape(x.shape[0] * size, *x.shape[2:])[:count], out)
