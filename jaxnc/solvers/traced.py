"""What traced code does that JAX has no words for: mapped axes as lanes, questions to the host.

A function that is `Mapped` has a program of its own where it is mapped. Compiled code asks the host by `ask_host`: a
question is made of arrays, and so is its answer, of shapes that are known beforehand.
"""

import _thread
import dataclasses
import functools
import threading
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import batching, mlir

from jaxnc.errors import InputError, JaxncError
from jaxnc.system.equations import Equations
from jaxnc.system.precision import numbers
from jaxnc.system.structure import program
from jaxnc.system.topology import Topology
from jaxnc.types import Array, PyTree

PIECE = 12_000
"""Numbers that are handed over in one array, 96 KB.

What is larger than 100 KB JAX copies in a thread of the pool that the call itself waits in: on a machine with one core
it would wait for ever.
"""


class Mapped:
    """A function of pytrees of arrays with another program for a batch of them; it is not differentiated.

    As by `jax.custom_batching.custom_vmap`, but the program for what is not mapped is traced only where it is compiled:
    under `jax.vmap` the other one is all that is wanted, and tracing takes as long as a third of compiling. The numbers
    that it makes are as wide as the first that it is given.

    Args:
        function: the program.
        shapes: what it returns for such arguments, arrays by `jax.ShapeDtypeStruct`.
        rule: the program for a batch: of its size, of a pytree for each argument that says which arrays have the batch
            as their first axis, and of the arguments. Returns the result and which of its arrays have it.
    """

    def __init__(self, function: Callable, shapes: Callable, rule: Callable[..., tuple[Any, Any]]):
        self.function, self.shapes, self.rule = function, shapes, rule

    def __call__(self, *args: object) -> Any:
        """Call it with pytrees of arrays."""
        arrays, structure = jax.tree.flatten(args)
        result = jax.tree.structure(self.shapes(*args))
        return jax.tree.unflatten(result, _MAPPED.bind(*arrays, of=self, structure=structure))


def _call_leaves(arrays: Sequence[Array], of: Mapped, structure: object) -> list[Array]:
    return jax.tree.leaves(of.function(*jax.tree.unflatten(structure, arrays)))


# JAX remembers what was traced: another program with the same function in it does not trace it once more.
_call_once = jax.jit(_call_leaves, static_argnums=(1, 2))


def _run_mapped(
    *arrays: Array, of: Mapped, structure: object, call: Callable[..., list[Array]] = _call_leaves
) -> list[Array]:
    like = next(a for a in arrays if jnp.issubdtype(a.dtype, jnp.inexact))
    with numbers(like):  # what was said of them around the call is over where this is compiled
        return call(arrays, of, structure)


def _shapes(*avals: Any, of: Mapped, structure: object) -> list[ShapedArray]:
    found = jax.tree.leaves(of.shapes(*jax.tree.unflatten(structure, avals)))
    return [ShapedArray(a.shape, a.dtype) for a in found]


def _batched(arrays: Sequence[Array], axes: Sequence, of: Mapped, structure: object) -> tuple[list, list]:
    has = [axis is not None for axis in axes]  # None: not mapped
    size = next(a.shape[axis] for a, axis, b in zip(arrays, axes, has, strict=True) if b)
    first = [jnp.moveaxis(a, axis, 0) if axis else a for a, axis in zip(arrays, axes, strict=True)]

    def rule(size: int, *arrays: Array) -> tuple[PyTree, PyTree]:
        return of.rule(size, jax.tree.unflatten(structure, has), *jax.tree.unflatten(structure, arrays))

    if size:
        found, which = rule(size, *first)
        return jax.tree.leaves(found), [0 if b else None for b in jax.tree.leaves(which)]
    # Of none the shapes are all there is to know, and one has them too.
    one = [jnp.zeros((1, *a.shape[1:]), a.dtype) if b else a for a, b in zip(first, has, strict=True)]
    like = jax.tree.leaves(jax.eval_shape(lambda *arrays: rule(1, *arrays)[0], *one))
    return [jnp.zeros((0, *x.shape[1:]), x.dtype) for x in like], [0] * len(like)


_MAPPED = Primitive("mapped")
_MAPPED.multiple_results = True
_MAPPED.def_impl(_run_mapped)
_MAPPED.def_abstract_eval(_shapes)
batching.primitive_batchers[_MAPPED] = _batched
mlir.register_lowering(_MAPPED, mlir.lower_fun(functools.partial(_run_mapped, call=_call_once), multiple_results=True))


def in_lanes(
    size: int, shared: bool, which: Sequence, eq: Equations, *lanes: Array
) -> tuple[bool, Equations, tuple[Array, ...]]:
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


def ask_host(
    doing: str,
    like: PyTree,
    f: Callable,
    *given: PyTree,
    given_up: Callable,
    large: bool = False,
) -> PyTree:
    """Put a question to the host from traced code; mapped, questions go one by one.

    Args:
        doing: what the host does, for messages.
        like: what it answers, arrays by `jax.ShapeDtypeStruct`.
        f: the answer, a function of what is given as NumPy arrays. It runs inside of compiled code and may not call
            JAX; nor may `given_up`.
        given: pytrees of arrays; equations are made `short` before.
        given_up: the answer where the user has interrupted it, a function of the same.
        large: whether it is of a large system, which only the host solves; otherwise messages name what else may be
            done.
    """
    remedy = "" if large else "; repair=False does without it"
    try:
        jax.local_devices(backend="cpu")
    except RuntimeError:
        raise JaxncError(
            f"compiled code asks the host, for which JAX needs its CPU backend: write JAX_PLATFORMS=cuda,cpu{remedy}"
        ) from None
    leaves, structure = jax.tree.flatten(given)
    # 32 pieces of one array, at most: each takes its time to compile
    shapes, counts = [jnp.shape(a) for a in leaves], [min(-(-jnp.size(a) // PIECE), 32) for a in leaves]
    pieces = []
    for leaf, count in zip(leaves, counts, strict=True):
        pieces += jnp.array_split(jnp.reshape(leaf, -1), count) if count > 1 else [leaf]

    def answer(*pieces: PyTree) -> np.ndarray:
        rest, arrays = iter(pieces), []
        for shape, count in zip(shapes, counts, strict=True):
            parts = [np.asarray(next(rest)) for _ in range(max(count, 1))]
            arrays.append(parts[0] if len(parts) == 1 else np.concatenate(parts).reshape(shape))
        question = jax.tree.unflatten(structure, arrays)
        try:
            return f(*question)
        except KeyboardInterrupt:
            # Compiled code would make an error of its own of it. It is raised again when that has returned.
            # after so many seconds an interrupted program has returned
            later = threading.Timer(0.05, _thread.interrupt_main)
            later.daemon = True
            later.start()
            return given_up(*question)
        except Exception as error:
            raise JaxncError(f"the host failed while it {doing} ({type(error).__name__}: {error}){remedy}") from error

    return jax.pure_callback(answer, like, *pieces, vmap_method="sequential")


def shorten_equations(eq: Equations) -> Equations:
    """Return the equations without the coefficients that the host makes itself."""
    none = (None,) * len(eq.linear)
    return dataclasses.replace(eq, linear=none, quadratic=none)


def refuse_unreadable(top: Topology) -> None:
    """Refuse a large system with a kind that NumPy cannot evaluate."""
    for kind in dict.fromkeys(block.kind for block in top.blocks):
        for which in ("residual", "guard"):
            if getattr(kind, which) is not None and program(kind, which, top.dim) is None:
                raise InputError(
                    f"constraint kind {kind.name!r} cannot be read as a straight line of NumPy's operations, and large "
                    f"systems are solved by NumPy: outside of jit, vmap and grad that works; in them compile the "
                    f"mechanism with compile(sparse=False), or write the kind without loops and jax.numpy.linalg"
                )
