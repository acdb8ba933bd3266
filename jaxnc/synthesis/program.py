"""How the programs of a search are compiled: for few seconds of compiling, as few are what they run for.

On a processor LLVM's first level of optimisation and XLA's older loops halve the time of compiling, and the written-out
solvers run as fast as before (double wishbone, 4 lanes of 9 poses: 4.1 s instead of 8.8 s; 9.4 ms instead of 9.3 ms).
"""

import functools
import os
from collections.abc import Callable
from typing import Any

import jax

_WANTED = {"xla_backend_optimization_level": 1, "xla_cpu_use_fusion_emitters": False}


def program(static: int | tuple[int, ...] = ()) -> Callable[[Callable], Callable]:
    """``jax.jit`` for functions that the search calls by itself, never inside of others.

    Args:
        static: places of static arguments.
    """

    def wrap(f: Callable) -> Callable:
        @functools.cache
        def compiled() -> Any:
            return jax.jit(f, static_argnums=static, compiler_options=_options(jax.default_backend()))

        @functools.wraps(f)
        def call(*args: Any) -> Any:
            return compiled()(*args)

        return call

    return wrap


@functools.cache
def _options(backend: str) -> dict[str, Any]:
    """The wanted options that this XLA knows and XLA_FLAGS does not set."""
    if backend != "cpu":
        return {}
    chosen = os.environ.get("XLA_FLAGS", "")
    return {name: value for name, value in _WANTED.items() if name not in chosen and _known(name, value)}


def _known(name: str, value: Any) -> bool:
    try:
        jax.jit(lambda: 0.0, compiler_options={name: value}).lower().compile()
    except RuntimeError:
        return False
    return True
