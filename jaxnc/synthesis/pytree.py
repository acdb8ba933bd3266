"""Problems as pytrees: their numbers are leaves, everything else is the structure by which programs are compiled.

Leaves are finite numbers, arrays of numbers, and the parameters of a system. Names, counts, functions and flags belong
to the structure. So does an infinite bound, which stands for no bound.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import numpy as np
from jax.core import Tracer

from jaxnc.pickling import from_fields
from jaxnc.system.system import System
from jaxnc.types import Numbers, PyTree

_LEAF = object()


class Leaves:
    """A dataclass whose numbers JAX sees, and whose other fields are static."""

    apart: tuple[str, ...] = ()  # fields that no program looks at; they are None where a program sees the record

    def __init_subclass__(cls, **options: object) -> None:
        super().__init_subclass__(**options)
        jax.tree_util.register_pytree_node(cls, _flatten, _unflatten)


class _Same:
    """A value that is equal to itself only, for what cannot be compared."""

    def __init__(self, value: object):
        self.value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.value is self.value

    def __hash__(self) -> int:
        return id(self.value)


def _flatten(record: object) -> tuple[list, tuple]:
    leaves: list = []
    return leaves, _flatten_record(record, leaves)


def _unflatten(structure: tuple, leaves: Sequence) -> PyTree:
    return structure[0](structure, iter(leaves))


def _flatten_record(record: Any, leaves: list[Numbers]) -> tuple:
    fields = tuple(field.name for field in dataclasses.fields(record))
    parts = (None if name in record.apart else getattr(record, name) for name in fields)
    return _rebuild_record, type(record), fields, tuple(_take_leaves(part, leaves) for part in parts)


def _rebuild_record(structure: tuple, leaves: Iterator) -> PyTree:
    _, kind, names, parts = structure
    return from_fields(kind, {name: _place_leaves(part, leaves) for name, part in zip(names, parts, strict=True)})


def _take_leaves(value: object, leaves: list) -> Any:
    """Take the structure of a value, and add its leaves to the others."""
    if isinstance(value, float) and math.isfinite(value):
        leaves.append(float(value))
        return _LEAF
    if isinstance(value, (jax.Array, Tracer)) or (isinstance(value, np.ndarray) and value.dtype.kind == "f"):
        leaves.append(value)
        return _LEAF
    if isinstance(value, np.ndarray):
        return _rebuild_array, value.shape, value.dtype.str, value.tobytes()
    if isinstance(value, Leaves):
        return _flatten_record(value, leaves)
    if isinstance(value, System):
        some, structure = jax.tree.flatten(value)
        leaves.extend(some)
        return _rebuild_tree, structure, len(some)
    if isinstance(value, tuple):
        return _rebuild_tuple, type(value), tuple(_take_leaves(part, leaves) for part in value)
    try:
        hash(value)
    except TypeError:
        return _rebuild_plain, _Same(value)
    return _rebuild_plain, value


def _place_leaves(structure: tuple, leaves: Iterator) -> PyTree:
    return next(leaves) if structure is _LEAF else structure[0](structure, leaves)


def _rebuild_array(structure: tuple, leaves: Iterator) -> np.ndarray:
    _, shape, dtype, data = structure
    return np.frombuffer(data, dtype).reshape(shape)


def _rebuild_tree(structure: tuple, leaves: Iterator) -> System:
    return jax.tree.unflatten(structure[1], [next(leaves) for _ in range(structure[2])])


def _rebuild_tuple(structure: tuple, leaves: Iterator) -> PyTree:
    parts = [_place_leaves(part, leaves) for part in structure[2]]
    make: Callable = structure[1]._make if hasattr(structure[1], "_make") else structure[1]
    return make(parts)


def _rebuild_plain(structure: tuple, leaves: Iterator) -> PyTree:
    value = structure[1]
    return value.value if isinstance(value, _Same) else value


def shapes(f: Callable, *given: object) -> PyTree:
    """Shapes of what a pure function of pytrees returns; it is traced once for their structure."""
    leaves, structure = jax.tree.flatten(given)
    return _cached_shapes(f, structure, tuple((np.shape(x), getattr(x, "dtype", np.dtype(float))) for x in leaves))


@functools.lru_cache(maxsize=1024)
def _cached_shapes(f: Callable, structure: object, kinds: tuple[tuple[tuple[int, ...], np.dtype], ...]) -> PyTree:
    leaves = [jax.ShapeDtypeStruct(*kind) for kind in kinds]
    return jax.eval_shape(lambda *x: f(*jax.tree.unflatten(structure, x)), *leaves)
