"""How records that hold functions are pickled: by what makes them again, since code itself cannot be.

A kind of the library's own goes by its name in the module that lists it, or as the cached function that made it and the
arguments, and comes back as the very same object: a mechanism that was sent to another process is equal to the one
there, and nothing compiles anew. What a user made goes by its fields, whose functions Python finds again by their names
in their modules; `Remade` says so where it cannot.
"""

import dataclasses
import functools
import importlib
import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, ParamSpec, Self, TypeVar

from jaxnc.calls import public
from jaxnc.errors import JaxncError

_P = ParamSpec("_P")
_R = TypeVar("_R", bound="Remade")
_T = TypeVar("_T")

# Of records that can be made again, by identity: the record itself, and what makes it with which arguments.
_AGAIN: dict[int, tuple["Remade", Callable, tuple]] = {}
_NAMED: dict[tuple[str, type, str], "Remade"] = {}


class Remade:
    """A frozen dataclass that holds functions and is pickled by what makes it again; its copy is itself.

    Attributes:
        noun: what an error calls it, before its name.
    """

    noun = "kind"
    name: Any

    def __reduce_ex__(self, protocol: int) -> Any:
        """Return what makes the record again."""
        if id(self) in _AGAIN:
            return _AGAIN[id(self)][1:]
        for field, function in functions_of(self):
            try:
                pickle.dumps(function)
            except (pickle.PicklingError, AttributeError, TypeError):
                raise JaxncError(
                    f"{self.noun} {self.name!r} cannot be pickled, because its {field} is "
                    f"{_describe_function(function)}: write it with def at the top level of a module that the other "
                    f"process can import"
                ) from None
        return from_fields, (type(self), fields_of(self))

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: dict) -> Self:
        return self


def factory(make: Callable[_P, _R]) -> Callable[_P, _R]:
    """Cache a function of a module that makes records, which are pickled as that function and its arguments."""

    @functools.cache
    @functools.wraps(make)
    def cached(*arguments, **options):
        record = make(*arguments, **options)
        _AGAIN[id(record)] = record, _call, (door, arguments, options)
        return record

    door = public(cached)
    return door  # pyright: ignore[reportReturnType]


def _call(make: Callable, arguments: tuple, options: dict) -> Any:
    return make(*arguments, **options)


def register_by_name(module: str, records: Iterable[Remade]) -> None:
    """Have records that a module makes when it is imported pickled by their names, which differ within a class."""
    for record in records:
        key = module, type(record), record.name
        _NAMED[key], _AGAIN[id(record)] = record, (record, _find_record, key)


def _find_record(module: str, kind: type, name: str) -> Remade:
    importlib.import_module(module)
    return _NAMED[module, kind, name]


def fields_of(record: Any) -> dict[str, Any]:
    """Return the fields of a dataclass, without what was remembered since."""
    return {field.name: getattr(record, field.name) for field in dataclasses.fields(record)}


def from_fields(kind: type[_T], fields: Mapping[str, object]) -> _T:
    """Make a record from its fields.

    Its ``__init__`` is passed over, which takes what a user says and checks it: who calls this puts in what was there,
    and JAX what it likes.
    """
    out = object.__new__(kind)
    vars(out).update(fields)
    return out


def functions_of(record: object) -> Iterator[tuple[str, Callable]]:
    """Yield the functions in the fields of a dataclass, and in tuples there, with the field's name."""
    for name, value in fields_of(record).items():
        waiting = [value]
        while waiting:
            one = waiting.pop()
            if isinstance(one, tuple):
                waiting += one
            elif callable(one):
                yield name, one


def _describe_function(function: Callable) -> str:
    name = getattr(function, "__qualname__", None)
    if name is None:
        return f"a {type(function).__name__} that holds what no other process can find"
    if name.endswith("<lambda>"):
        return "a lambda"
    return f"{name}, which is made inside of another function" if "<locals>" in name else f"no plain function ({name})"
