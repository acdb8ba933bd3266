"""Puts in jaxtyping's import hook: arrays are as annotations say they are, and nothing else is asked."""

import functools
import inspect
import types
import typing
from collections.abc import Sequence

import jax
import jaxtyping
import numpy as np

seen: set[str] = set()
"""Functions that were called with an array whose shape was checked."""


def checked(function):
    """A function that refuses arrays, or results, of other shapes than it says."""
    if isinstance(function, type) or function.__name__ == "__init__":
        return function  # JAX puts tracers of any rank into records
    signature = inspect.signature(function)
    hints = {n: p.annotation for n, p in signature.parameters.items() if p.annotation is not p.empty}
    back = signature.return_annotation
    if not any(_shaped(h) for h in (*hints.values(), back)):
        return function

    @functools.wraps(function)
    def call(*args, **kwargs):
        for name, value in signature.bind(*args, **kwargs).arguments.items():
            if name in hints and not _fits(value, hints[name]):
                raise TypeError(f"{name} of {function.__qualname__} is {_told(value)}, not {hints[name]}")
        found = function(*args, **kwargs)
        if back is not signature.empty and not _fits(found, back):
            raise TypeError(f"{function.__qualname__} returns {_told(found)}, not {back}")
        seen.add(f"{function.__module__}.{function.__qualname__}")
        return found

    return call


def _array(hint) -> bool:
    return isinstance(hint, type) and issubclass(hint, jaxtyping.AbstractArray)


def _shaped(hint) -> bool:
    return _array(hint) or any(_shaped(part) for part in typing.get_args(hint))


def _fits(value, hint) -> bool:
    if _array(hint):
        if not isinstance(value, jax.Array | np.ndarray):
            return True
        kind = np.ndarray if isinstance(value, np.ndarray) else jax.Array
        return isinstance(value, hint.dtype[kind, hint.dim_str])
    parts, origin = typing.get_args(hint), typing.get_origin(hint)
    if origin in (typing.Union, types.UnionType):
        return not _shaped(hint) or any(_fits(value, p) for p in parts if _array(p) or not isinstance(value, jax.Array))
    if origin is tuple and isinstance(value, tuple):
        each = parts[:1] * len(value) if parts[1:] == (...,) else parts
        return len(each) == len(value) and all(map(_fits, value, each))
    if origin in (list, Sequence) and isinstance(value, list | tuple):
        return all(_fits(v, parts[0]) for v in value)
    return True


def _told(value) -> str:
    return str(jax.tree.map(lambda x: f"{x.dtype}{x.shape}" if hasattr(x, "shape") else type(x).__name__, value))


jaxtyping.install_import_hook("jaxnc", "shape_check.checked")
