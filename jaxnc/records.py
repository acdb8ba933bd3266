"""Records of arrays: frozen dataclasses that JAX takes apart and puts together (pytrees), fields by name.

A field is an array, a record, or a pytree of them, unless it is `static`: then it is part of the structure, by which
JAX tells one trace from another, and is hashed and compared. JAX puts in what it likes when it builds a record
(tracers, axes, shapes), so nothing is checked or converted there.

Numbers that are worked out for a mechanism are remembered with it, and forgotten with it.
"""

import dataclasses
import functools
import weakref
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec, TypeVar, dataclass_transform

import jax
import numpy as np

T = TypeVar("T")
R = TypeVar("R")
_P = ParamSpec("_P")
_NOTHING = object()


def with_owner(f: Callable[Concatenate[T, _P], R]) -> Callable[Concatenate[T, _P], R]:
    """Remember what a function returns, in its first argument: a topology, a plan, an object that lives as long.

    The other arguments are hashable and are given in order. As `functools.cache` otherwise, which would keep the owner
    and all that hangs on it for ever.
    """

    @functools.wraps(f)
    def call(owner: T, *more: _P.args, **named: _P.kwargs) -> R:
        known = vars(owner).setdefault("_remembered", {})
        key = (f, more, tuple(named.items()))
        found = known.get(key, _NOTHING)
        return known.setdefault(key, f(owner, *more, **named)) if found is _NOTHING else found

    return call


def by_identity(f: Callable[[T], R]) -> Callable[[T], R]:
    """Remember what a pure function has made of an object for as long as that object is there."""
    known: dict[int, tuple[weakref.ref, R]] = {}

    @functools.wraps(f)
    def call(x: T) -> R:
        found = known.get(id(x))
        if found is None or found[0]() is not x:
            key = id(x)
            found = known[key] = (weakref.ref(x, lambda _: known.pop(key, None)), f(x))
        return found[1]

    return call


_Class = TypeVar("_Class", bound=type)


# -- records of arrays -------------------------------------------------------------------------------------------------


def static(**options: Any) -> Any:
    """Make a field that is no array: hashable, and part of the structure; options as of `dataclasses.field`."""
    return dataclasses.field(metadata={"static": True}, **options)


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(static, dataclasses.field))
def record(cls: _Class) -> _Class:
    """Make a class a record: equal if structure and numbers are, and without a hash; a subclass is decorated again."""
    made = dataclasses.dataclass(frozen=True, eq=False, repr=False)(cls)
    fields = dataclasses.fields(made)
    kept = [f.name for f in fields if f.metadata.get("static")]
    jax.tree_util.register_dataclass(made, [f.name for f in fields if f.name not in kept], kept)
    for name, method in (("__eq__", _equal_records), ("__repr__", _write_record)):
        if getattr(cls, name) is getattr(object, name):
            setattr(made, name, method)
    made.__hash__ = None
    return made


def _equal_records(self: object, other: object) -> bool:
    if type(self) is not type(other):
        return NotImplemented
    (a, one), (b, two) = jax.tree.flatten(self), jax.tree.flatten(other)
    return one == two and all(_same_leaf(x, y) for x, y in zip(a, b, strict=True))


def _same_leaf(x: Any, y: Any) -> bool:
    same = np.shape(x) == np.shape(y) and getattr(x, "dtype", type(x)) == getattr(y, "dtype", type(y))
    return same and bool(np.all(np.asarray(x) == np.asarray(y)))


def _write_record(self: Any) -> str:
    values = ((f.name, getattr(self, f.name)) for f in dataclasses.fields(self))
    return f"{type(self).__name__}({', '.join(f'{name}={_shorten(value)}' for name, value in values)})"


def _shorten(value: Any) -> str:
    """Write a value as text, arrays by their type and shape."""
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return f"{value.dtype}[{','.join(map(str, value.shape))}]"
    if type(value) is tuple:
        return f"({', '.join(map(_shorten, value))}{',' * (len(value) == 1)})"
    return repr(value)
