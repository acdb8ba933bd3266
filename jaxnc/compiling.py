"""Compiling in less time, and as many lanes together as suit the device.

XLA's newer code generator for CPUs takes up to twice as long as its older one, for code that is quicker only where very
many lanes stream through one loop, and LLVM's later levels of optimisation a fifth more than its first. Everything else
of this library is compiled by the older one and at the first level. ``XLA_FLAGS`` come before both.
"""

import functools
import os
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.errors import InputError, JaxncError, brief
from jaxnc.internals import evaluate_at_once, has_started, outermost
from jaxnc.types import PyTree

R = TypeVar("R")

_OPTIONS: dict[str, bool | int | str] = {"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 1}


@public
def jit(
    f: Callable[..., R], *, static_argnums: int | Sequence[int] = (), static_argnames: str | Sequence[str] = ()
) -> Callable[..., R]:
    """Compile a function like `jax.jit`, in about half the time on a CPU.

    For functions that are compiled more often than they are run on millions of lanes: analyses, objectives, gradients.
    Inside of other traced code (another ``jit``, ``grad``, ``vmap``) it is `jax.jit`.

    Args:
        f: a function that JAX can trace.
        static_argnums: as of `jax.jit`.
        static_argnames: as of `jax.jit`.

    Returns:
        The compiled function.
    """
    static = {"static_argnums": static_argnums, "static_argnames": static_argnames}
    try:
        return _compile_either(f, functools.partial(jax.jit, **static))
    except (TypeError, ValueError) as error:
        told = ", ".join(f"{name}={brief(value)}" for name, value in static.items())
        raise InputError(f"jit: {told}: {error}") from None


def filter_jit(f: Callable[..., R]) -> Callable[..., R]:
    """Compile a function like `jit`; whatever is no array in the arguments is static, and must be hashable."""

    def compiler(f: Callable, **options: Any) -> Callable:
        def whole(arrays: list, rest: Any) -> Any:
            args, kwargs = _join_arrays(arrays, rest)
            return f(*args, **kwargs)

        compiled = jax.jit(functools.wraps(f)(whole), static_argnums=1, **options)
        return lambda *args, **kwargs: compiled(*_split_arrays((args, kwargs)))

    return _compile_either(f, compiler)


def in_one_program(f: Callable[..., R]) -> Callable[..., R]:
    """Compile a formula as a whole for JAX's arrays, instead of one operation after the other.

    If all arrays are NumPy's they are given to it as they are, and it does its work in NumPy.
    """
    compiled = jit(f)

    @functools.wraps(f)
    def call(*args: Any) -> R:
        return (compiled if any(isinstance(x, jax.Array) for x in jax.tree.leaves(args)) else f)(*args)

    return call


def shapes_of(f: Callable, *args: PyTree) -> PyTree:
    """Return what a function returns, arrays by their shapes and types; nothing is calculated."""
    kept = []

    def arrays_of(arrays: list) -> list:
        found, rest = _split_arrays(f(*_join_arrays(arrays, static)))
        kept.append(rest)
        return found

    arrays, static = _split_arrays(args)
    return _join_arrays(jax.eval_shape(arrays_of, arrays), kept[-1])


def _split_arrays(tree: object) -> tuple[list, tuple]:
    """Return the arrays of a pytree, and all else that it is."""
    leaves, structure = jax.tree.flatten(tree)
    which = tuple(isinstance(x, jax.Array | np.ndarray | np.generic) for x in leaves)
    arrays = [x for x, is_array in zip(leaves, which, strict=True) if is_array]
    return arrays, (structure, tuple(None if is_array else x for x, is_array in zip(leaves, which, strict=True)), which)


def _join_arrays(arrays: Sequence, rest: tuple) -> PyTree:
    structure, others, which = rest
    each = iter(arrays)
    return jax.tree.unflatten(structure, [next(each) if a else x for x, a in zip(others, which, strict=True)])


def _compile_either(f: Callable[..., R], compiler: Callable) -> Callable[..., R]:
    plain = compiler(f)
    outer: list[Callable] = []

    @functools.wraps(f)
    def call(*args, **kwargs):
        refuse_fork()
        if not outermost():
            if not is_outermost(args, kwargs):
                return plain(*args, **kwargs)
            with evaluate_at_once():
                return call(*args, **kwargs)
        if not outer:
            outer.append(compiler(f, compiler_options=options()))
        try:
            return outer[0](*args, **kwargs)
        except (jax.errors.JaxRuntimeError, ValueError) as error:
            blame_callback(error, "compiled code")
            raise

    return call


def blame_callback(error: Exception, caller: str) -> None:
    """Raise what a function said that was called back, if an error of JAX's is that it failed."""
    lines = [line for line in str(error).splitlines() if line.strip()]
    if lines and "callback" in lines[0].lower() and "Traceback" in str(error):
        places = [line.strip() for line in lines if line.startswith("  File ")]
        raise JaxncError(
            f"a function called back from {caller} failed: {lines[-1]} ({', '.join(places[-1:])})"
        ) from None


def is_outermost(*trees: object) -> bool:
    """Say whether all numbers are known, and what is made of them becomes no part of a larger program.

    So it is of what does not depend on the arguments of a ``grad`` or ``vmap`` that nothing is compiled around.
    """
    known = not any(isinstance(x, Tracer) for x in jax.tree.leaves(trees))
    return known and (outermost() or not isinstance(jax.device_put(np.float32(0.0)), Tracer))


# Whether this process was forked after JAX had started its threads, which it has not got. A fact that can be known only
# at the moment of the fork; nobody sets it otherwise.
_forked = False


def _in_child() -> None:
    global _forked
    _forked = _forked or has_started()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_child)


def refuse_fork() -> None:
    """Refuse to calculate in a process that was forked after JAX began: it would wait for ever."""
    if _forked:
        raise JaxncError(
            "this process was forked after JAX had computed something, and would wait for ever for threads that it has "
            "not got: start workers by multiprocessing.get_context('spawn'), or fork before the first computation"
        )


@functools.cache
def options() -> dict[str, bool | int | str]:
    """Compiler options for code that is quick to compile; none where this XLA, or this device, has no such choice."""
    if jax.default_backend() != "cpu":
        return {}
    # What the user has set in the environment stays as it is.
    wanted = {name: value for name, value in _OPTIONS.items() if name not in os.environ.get("XLA_FLAGS", "")}
    try:
        jax.jit(lax.neg, compiler_options=wanted)(np.float32(1.0))
    except jax.errors.JaxRuntimeError:  # no such option
        return {}
    return wanted


def at_a_time(lanes: int) -> int:
    """Give how many lanes go together: on a CPU as many as are said to stay in its cache, elsewhere many more."""
    return lanes if jax.default_backend() == "cpu" else 64 * lanes  # 64 times as many keep a graphics card busy


def in_chunks(f: Callable, chunk: int, *arguments: PyTree) -> PyTree:
    """Apply a function whose arguments and results have lanes as their first axis to a chunk of them at a time.

    What a `chunk` needs stays in a CPU's cache, and few lanes wait for the slowest; other devices take more at a time.
    Up to twice as many go at once.
    """
    count, chunk = jax.tree.leaves(arguments)[0].shape[0], at_a_time(chunk)
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


def on_device(tree: object) -> PyTree:
    """Turn NumPy arrays into JAX arrays, inside of traced code too; ``jnp.asarray`` compiles one program a shape."""
    if outermost():
        return jax.device_put(tree)
    with jax.ensure_compile_time_eval():  # what is remembered of it must not belong to the trace
        return jax.device_put(tree)
