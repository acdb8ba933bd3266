"""JAX's promotion of shapes and number types: the library is written for JAX's own settings.

A user may tell JAX to refuse what it would promote (``jax_numpy_rank_promotion="raise"``,
``jax_numpy_dtype_promotion="strict"``). That holds for the user's code. What the library calculates is traced with
JAX's own settings, and so are the rules of its transformations, which JAX calls later.
"""

import contextlib
import functools
import sys
from collections.abc import Callable, Iterator
from typing import Any, ParamSpec, TypeVar

_P = ParamSpec("_P")
_R = TypeVar("_R")
_AS_IT_IS = contextlib.nullcontext()


def promoting(inner: contextlib.AbstractContextManager = _AS_IT_IS) -> contextlib.AbstractContextManager:
    """Promote shapes and number types inside of a ``with`` statement, and be inside of another context too."""
    jax = sys.modules.get("jax")
    config = getattr(jax, "config", None)  # none as long as JAX is being imported, or never is
    if config is None or (config.jax_numpy_rank_promotion, config.jax_numpy_dtype_promotion) == ("allow", "standard"):
        return inner
    return _promoting(jax, inner)


@contextlib.contextmanager
def _promoting(jax: Any, inner: contextlib.AbstractContextManager) -> Iterator[None]:
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"), inner:
        yield


def promoted(f: Callable[_P, _R]) -> Callable[_P, _R]:
    """Have a function promote shapes and number types, whatever the user's settings are."""

    @functools.wraps(f)
    def inner(*args: _P.args, **options: _P.kwargs) -> _R:
        with promoting():
            return f(*args, **options)

    return inner
