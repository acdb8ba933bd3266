"""Any optax optimiser, checked, and told apart from others by what it is made of.

Nothing here imports optax: whatever has its ``init`` and ``update`` is taken.
"""

import functools
import hashlib
import inspect
import types
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from jaxnc.errors import InputError

_EXTRA = ("value", "grad", "value_fn")  # what optimisers that search along lines ask for
_THEIRS = ("optax", "jax")  # packages whose functions are what their code and closures are


class Optimiser:
    """An optax transformation: equal to another one that is made of the same functions with the same numbers."""

    def __init__(self, what: str, given: Any):
        """Check what was given; `what` is what messages call the caller."""
        parts = getattr(given, "init", None), getattr(given, "update", None)
        if isinstance(given, type) or not all(map(callable, parts)):
            name = getattr(given, "__name__", type(given).__name__)
            makes = (
                callable(given) and name.isidentifier() and str(getattr(given, "__module__", "")).startswith("optax")
            )
            remedy = f": call it, optax.{name}(1e-2)" if makes else ", such as optax.adam(1e-2)"
            raise InputError(
                f"{what}: the optimiser must be an optax transformation, with init and update, got {name}{remedy}"
            )
        self.init: Callable[..., Any] = given.init  # the memory of an optimiser at some unknowns
        self.update: Callable[..., Any] = given.update
        taken = inspect.signature(self.update).parameters.values()
        every = any(p.kind is p.VAR_KEYWORD for p in taken)
        self.extra = _EXTRA if every else tuple(p.name for p in taken if p.name in _EXTRA)
        self.key = _key(given, [])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Optimiser) and other.key == self.key

    def __hash__(self) -> int:
        return hash(self.key)

    @property
    def digest(self) -> str:
        """The same in every process."""
        return hashlib.sha256(repr(_said(self.key)).encode()).hexdigest()[:16]

    def updates(self, slope: Any, memory: Any, y: Any, value: Any, value_fn: Callable[[Any], Any]) -> tuple[Any, Any]:
        """What it adds to the unknowns, and its memory afterwards."""
        known = {"value": value, "grad": slope, "value_fn": value_fn}
        return self.update(slope, memory, y, **{name: known[name] for name in self.extra})


class _Same:
    """A thing that is equal to itself only."""

    def __init__(self, thing: Any):
        self.thing = thing

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.thing is self.thing

    def __hash__(self) -> int:
        return id(self.thing)


def _key(thing: Any, above: list[Any]) -> Any:
    """What makes two things do the same: numbers, code with what it encloses; of all else, that it is the same."""
    if isinstance(thing, int) and not isinstance(thing, bool) and abs(thing) < 1 << 53:
        return "float", float(thing)  # schedules make one of the other when they are first asked
    if thing is None or isinstance(thing, (bool, int, float, complex, str, bytes, type, np.dtype)):
        return type(thing).__name__, thing
    if any(thing is one for one in above):
        return "above", [thing is one for one in above].index(True)
    inside = functools.partial(_key, above=[*above, thing])
    if isinstance(thing, (np.ndarray, np.generic, jax.Array)) and not jax.dtypes.issubdtype(
        thing.dtype, jax.dtypes.prng_key
    ):
        array = np.asarray(thing)
        return "array", array.shape, array.dtype.str, array.tobytes()
    if isinstance(thing, (tuple, list)):
        return type(thing).__name__, tuple(map(inside, thing))
    if isinstance(thing, dict):
        return "dict", tuple((inside(k), inside(v)) for k, v in thing.items())
    if isinstance(thing, functools.partial):
        return "partial", inside(thing.func), inside(thing.args), inside(thing.keywords)
    if isinstance(thing, types.FunctionType) and (thing.__module__ or "").split(".")[0] in _THEIRS:
        cells = []
        for cell in thing.__closure__ or ():
            try:
                cells.append(inside(cell.cell_contents))
            except ValueError:  # not filled yet
                return "only", _Same(thing)
        held = inside(thing.__defaults__), inside(thing.__kwdefaults__)
        return "function", thing.__module__, thing.__qualname__, thing.__code__, tuple(cells), held
    return "only", _Same(thing)


def _said(key: Any) -> Any:
    """A key without what differs from process to process."""
    if isinstance(key, _Same):
        return getattr(key.thing, "__qualname__", type(key.thing).__name__)
    if isinstance(key, types.CodeType):
        return key.co_name
    return tuple(map(_said, key)) if isinstance(key, tuple) else key
