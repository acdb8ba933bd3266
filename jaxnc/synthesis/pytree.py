"""Problems as pytrees: their numbers are leaves, everything else is the structure by which programs are compiled.

Leaves are finite numbers, arrays of numbers, and the parameters of a system. Names, counts, functions and flags belong
to the structure. So does an infinite bound, which stands for no bound.
"""

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import numpy as np
from jax.core import Tracer

from jaxnc.pickling import fields_of, from_fields
from jaxnc.system.system import System
from jaxnc.types import PyTree

_T = TypeVar("_T")


class Leaves:
    """A dataclass whose numbers JAX sees, and whose other fields are static."""

    apart: tuple[str, ...] = ()  # fields that no program looks at; they are None where a program sees the record

    def __init_subclass__(cls, **options: object) -> None:
        super().__init_subclass__(**options)
        jax.tree_util.register_pytree_node(cls, _flatten, _unflatten)


class Static:
    """A value that belongs to the structure, and a key by which it is compared."""

    def __init__(self, value: Any, key: object):
        self.value, self.key = value, key

    @classmethod
    def only(cls, value: object) -> "Static":
        """Make one that is equal to itself only."""
        return cls(value, ("only", id(value)))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Static) and other.key == self.key

    def __hash__(self) -> int:
        return hash(self.key)


jax.tree_util.register_pytree_node(Static, lambda kept: ((), kept), lambda kept, _: kept.value)


def _flatten(record: Any) -> tuple[list, tuple]:
    fields = fields_of(record) | dict.fromkeys(record.apart)
    leaves, structure = jax.tree.flatten({name: _keep(value) for name, value in fields.items()})
    return leaves, (type(record), structure)


def _unflatten(structure: tuple, leaves: Sequence) -> PyTree:
    return from_fields(structure[0], jax.tree.unflatten(structure[1], leaves))


def _keep(value: Any) -> Any:
    """Keep what is no number out of JAX's sight."""
    if isinstance(value, float) and math.isfinite(value):
        return float(value)
    if isinstance(value, (jax.Array, Tracer, Leaves, System)):
        return value
    if isinstance(value, np.ndarray):
        key = value.shape, value.dtype.str, value.tobytes()
        return value if value.dtype.kind == "f" else Static(value, key)
    if isinstance(value, tuple):
        parts = [_keep(part) for part in value]
        if all(isinstance(part, Static) for part in parts):
            return Static(value, (type(value), *(part.key for part in parts)))
        return type(value)(*parts) if hasattr(value, "_make") else tuple(parts)
    try:
        hash(value)
    except TypeError:
        return Static.only(value)
    return Static(value, value)


def take(record: _T, at: Any) -> _T:
    """Select some designs of a record whose arrays have one in each row."""
    return jax.tree.map(lambda rows: rows[at], record)


_jitted = functools.cache(jax.jit)


def shapes(f: Callable, *given: object) -> PyTree:
    """Shapes of what a pure function of pytrees returns; it is traced once for their structure."""
    return _jitted(f).eval_shape(*given)
