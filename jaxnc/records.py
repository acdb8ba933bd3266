"""Records of arrays: frozen dataclasses that JAX takes apart and puts together (pytrees), fields by name.

A field is an array, a record, or a pytree of them, unless it is `static`: then it is part of the structure, by which
JAX tells one trace from another, and is hashed and compared. JAX puts in what it likes when it builds a record
(tracers, axes, shapes), so nothing is checked or converted there.
"""

import dataclasses
from typing import Any, TypeVar, dataclass_transform

import jax
import numpy as np

_R = TypeVar("_R", bound=type)


def static(**options: Any) -> Any:
    """Make a field that is no array: hashable, and part of the structure; options as of `dataclasses.field`."""
    return dataclasses.field(metadata={"static": True}, **options)


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(static, dataclasses.field))
def record(cls: _R) -> _R:
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
