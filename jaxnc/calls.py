"""Calls of public functions: one that a function does not take is refused in the user's words, not in Python's.

They are calculated with JAX's own settings of what is promoted. A user may tell JAX to refuse what it would promote
(``jax_numpy_rank_promotion="raise"``, ``jax_numpy_dtype_promotion="strict"``). That holds for the user's code. What the
library calculates is traced with JAX's own settings, and so are the rules of its transformations, which JAX calls
later.
"""

import builtins
import collections.abc
import contextlib
import functools
import importlib
import inspect
import os
import re
import sys
import types
import typing
from collections.abc import Callable, Iterable, Iterator
from numbers import Real
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np

from jaxnc.errors import CallError, JaxncError, UnknownName, brief, nearest, not_installed

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


_Thing = TypeVar("_Thing", bound=Callable)

_RAW = (TypeError, ValueError, AttributeError, LookupError, OverflowError)
_OPERATORS = ("__init__", "__call__", "__getitem__")
_PACKAGES = "", ".kinematics", ".vehicle", ".dynamics", ".synthesis", ".families", ".constraints", ".forces"
_MANY = 1000  # entries of a collection that are looked at
# By argument, what else it is called, in other libraries and in formulas, where spelling does not lead to it.
_ALIASES = {
    "stiffness": "k rate",
    "damping": "c d b",
    "coefficient": "c mu",
    "free": "length rest rest_length l0 natural_length unstretched_length",
    "lengths": "length",
    "start": "points between",
    "mass": "m density",
    "com": "cg cog",
    "centre": "center",
    "wheel_centre": "center centre",
    "at": "center centre position pos xy x",
    "to": "end",
    "inputs": "q",
    "hold": "inputs",
    "t": "time times ts duration",
    "unit": "degrees deg",
    "rates": "speed velocities",
    "key": "seed",
    "path": "file filename",
}
# By method or value, the same.
_CALLED = {
    "revolute": "pin hinge joint",
    "prismatic": "slider slide",
    "spherical": "ball",
    "torque": "moment couple motor",
    "body": "bar link rod",
    "ground": "fix anchor",
    "velocity": "vel speed",
    "acceleration": "acc",
    "q": "positions",
    "t": "time",
}
# By argument, or by function and argument.
_ELSEWHERE = {
    "redundancy": "an argument of sweep(system, …, redundancy='independent rows') alone",
    "simulate hold": "an input that does not change in time: inputs={'phi': lambda t: 0.7}",
    "linearise hold": "of poses and equilibria: what a vibration locks is welded, mechanism.weld(name, body, other)",
}


def public(thing: _Thing) -> _Thing:
    """Open a function, or the methods of a class, to users.

    Its calculations promote shapes and number types, see `jaxnc.calls`. Whatever it raises on purpose passes. A
    call that does not bind, and one that fails because an argument is not of the kind that the signature says, raises a
    `CallError` instead; arguments are looked at only then.
    """
    opened: Any = thing
    if not isinstance(thing, type):
        return _check_calls(opened, getattr(thing, "__name__", "the function"))
    for owner in opened.__mro__:
        if not owner.__module__.startswith("jaxnc."):
            continue
        for name, member in list(vars(owner).items()):
            if name.startswith("_") and (name not in _OPERATORS or (name == "__init__" and owner.__hash__ is None)):
                continue  # records are put together by JAX, which may put in what it likes
            called = {"__init__": owner.__name__, "__getitem__": "[]", "__call__": owner.__name__}.get(name, name)
            if isinstance(member, types.FunctionType) and not hasattr(member, "_public"):
                setattr(owner, name, _check_calls(member, called, 1))
            elif isinstance(member, classmethod | staticmethod) and not hasattr(member.__func__, "_public"):
                bound = isinstance(member, classmethod)
                setattr(owner, name, type(member)(_check_calls(member.__func__, called, int(bound))))
            elif isinstance(member, property) and member.fget is not None:
                setattr(owner, name, member.getter(promoted(member.fget)))
            elif isinstance(member, functools.cached_property):
                member.func = promoted(member.func)
    if not hasattr(opened, "__getattr__"):
        opened.__getattr__ = _raise_unknown
    return opened


def _raise_unknown(self: object, name: str) -> object:
    """Raise an error for a name that an object has not, with the nearest that it has; Python asks for it last."""
    if name.startswith("_") or hasattr(type(self), name):  # protocols look about; a property has failed by itself
        return object.__getattribute__(self, name)
    names = [x for x in {*dir(type(self)), *getattr(self, "__dict__", ())} if not x.startswith("_")]
    meant = next((own for own, others in _CALLED.items() if name.lower() in others.split()), None)
    hint = f"did you mean {meant!r}?" if meant in names else nearest(name, names)
    raise UnknownName(f"{type(self).__name__} has nothing called {name!r}; {hint}")


def _check_calls(f: Callable, called: str, bound: int = 0) -> Any:
    """Wrap a function so that wrong calls are told; the first `bound` arguments are not given by the user."""

    @functools.wraps(f)
    def call(*args: object, **options: object) -> Any:
        try:
            with promoting():
                return f(*args, **options)
        except _RAW as error:
            if isinstance(error, JaxncError) and not isinstance(error, CallError | UnknownName):
                raise
            said = _wrong_call(f, called, bound, args, options)
            if said is None:
                raise
        except ModuleNotFoundError as error:
            missing = not_installed(error)
            if missing is None:
                raise
            raise missing from None
        raise CallError(said)

    vars(call)["_public"] = True
    return call


def _wrong_call(f: Callable, called: str, bound: int, args: tuple, options: dict) -> str | None:
    """Say what is wrong with the arguments of a call; None if they are such as the signature says."""
    signature = inspect.signature(f)
    parameters = list(signature.parameters.values())[bound:]
    name = "[]" if called == "[]" else f"{called}()"
    try:
        given = signature.bind(*args, **options).arguments
    except TypeError:
        why = _unbound(parameters, bound, args, options, f)
        return f"{name} {why}{' ' if why.endswith('?') else '. '}{_in_words(parameters)}"
    told = _argument_notes(f)
    hints = _hints(f)
    for p in parameters:
        if p.name not in given:
            continue
        kind, each = hints.get(p.name, Any), "each of " if p.kind is p.VAR_POSITIONAL else ""
        if p.kind is p.VAR_KEYWORD:
            continue
        for value in given[p.name] if each else (given[p.name],):
            if not _fits(value, kind) and not (value is None and p.default is None):
                about = f" ({told[p.name]})" if p.name in told else ""
                return f"{name}: {each}{p.name} must be {_read_annotation(kind)[0]}{about}; got {brief(value)}"
    return None


def _unbound(parameters, bound: int, args: tuple, options: dict, f: Callable) -> str:
    """Why arguments do not bind."""
    names = [p.name for p in parameters if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)]
    for name in options:
        if name not in names:
            return f"takes no {name}=; {_guess_argument(f.__name__, name, names, args[bound:])}"
    placed = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    for p, value in zip(placed, args[bound:], strict=False):
        if p.name in options:
            return f"is given {p.name} twice: as {brief(value)} in its place, and as {p.name}={brief(options[p.name])}"
    if len(args) - bound > len(placed):
        rest = [p.name for p in parameters if p.kind is p.KEYWORD_ONLY]
        by_name = f"; the others by name, such as {rest[0]}=" if rest else ""
        return f"is given {len(args) - bound} arguments in order, and takes {len(placed)}{by_name}"
    told = _argument_notes(f)
    have = {p.name for p in placed[: len(args) - bound]} | set(options)
    lacking = [p for p in parameters if p.name in names and p.default is p.empty and p.name not in have]
    return "lacks " + ", ".join(f"{p.name} ({told[p.name]})" if p.name in told else p.name for p in lacking)


def _guess_argument(function: str, name: str, names: list[str], args: tuple) -> str:
    """Guess which argument of a function is meant by a name that is none."""
    by_name = [x for x in ("inputs", "state") if x in names]
    if by_name and any(name in getattr(getattr(x, "topology", None), "scalars", ()) for x in args):
        return f"values go by name in one mapping, {by_name[0]}={{{name!r}: …}}"
    for key in (f"{function} {name}", name):
        if key in _ELSEWHERE:
            return f"{name}= is {_ELSEWHERE[key]}"
    meant = [own for own, others in _ALIASES.items() if name.lower() in others.split() and own in names]
    return f"did you mean {meant[0]!r}?" if meant else nearest(name, names)


def _in_words(parameters: Iterable[inspect.Parameter]) -> str:
    """Say what a function takes: what it needs in order, what by name, what it may be given."""
    parameters = [p for p in parameters if p.kind is not p.VAR_KEYWORD]

    def called(p: inspect.Parameter) -> str:
        return p.name + {p.KEYWORD_ONLY: "=", p.VAR_POSITIONAL: ", …"}.get(p.kind, "")

    needed = [called(p) for p in parameters if p.default is p.empty and p.kind is not p.VAR_POSITIONAL]
    free = [called(p) for p in parameters if p.default is not p.empty or p.kind is p.VAR_POSITIONAL]
    needs = f"needs {', '.join(needed)}" if needed else ""
    may = f"may be given {', '.join(free)}" if free else ""
    return f"It {' and '.join(filter(None, (needs, may))) or 'takes nothing'}"


def _argument_notes(f: Callable) -> dict[str, str]:
    """Read the first sentence about each argument in a docstring."""
    text = inspect.getdoc(f) or ""
    section = re.search(r"^Args:\n(.*?)(?=^\S|\Z)", text, re.M | re.S)
    out = {}
    for name, said in re.findall(r"^ {4}\**(\w+): (.*?)(?=^ {4}\S|\Z)", section[1] if section else "", re.M | re.S):
        out[name] = re.split(r"[.;:] |[.;]$", " ".join(said.split()).replace("`", ""))[0]
    return out


def _hints(f: Callable) -> dict[str, object]:
    """The kinds of a function's arguments; what is known to type checkers only is left out."""
    f = inspect.unwrap(f)
    out = {}
    for name, kind in getattr(f, "__annotations__", {}).items():
        if isinstance(kind, str):
            try:
                kind = eval(kind, {}, _Names(getattr(f, "__globals__", {})))
            except Exception:  # an annotation that only a type checker understands
                continue
        out[name] = kind
    return out


class _Names(dict):
    """The names that an annotation may use; of what is imported for type checkers alone, those that jaxnc offers."""

    def __missing__(self, name: str) -> object:
        if name == "Path":
            return Path
        for home in (builtins, *(importlib.import_module(f"jaxnc{package}") for package in _PACKAGES)):
            if name in dir(home):
                return getattr(home, name)
        return Any


# -- values and kinds ------------------------------------------------------------------------------------------


def _fits(value: object, kind: object) -> bool:
    """Say whether a value may be of the kind that an annotation says; doubts are in its favour."""
    return _read_annotation(kind)[1](value)


def _read_annotation(kind: Any) -> tuple[str, Callable[[Any], bool]]:
    """Read an annotation: what messages call this kind of argument, and which values may be of it."""
    origin, args = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Annotated:
        return _read_annotation(args[0])
    if origin in (typing.Union, types.UnionType):
        words = dict.fromkeys(_read_annotation(x)[0] for x in args)
        return " or ".join(words), lambda value: any(_fits(value, x) for x in args)
    if origin is typing.Literal:
        return " or ".join(map(repr, args)), lambda value: any(type(value) is type(x) for x in args)
    kind = origin or kind
    if kind in _PLAIN:
        return _PLAIN[kind]
    if not isinstance(kind, type):
        return "a value of its kind", lambda value: True
    if kind.__module__.partition(".")[0] in ("jax", "jaxlib", "numpy", "jaxtyping"):
        return "numbers", _is_array
    if issubclass(kind, collections.abc.Mapping):
        words = f"a mapping from {_many(args[0])} to {_many(args[1])}" if len(args) == 2 else "a mapping"
        return words, lambda value: _is_mapping(value, args)
    if issubclass(kind, collections.abc.Iterable) and kind.__module__ in ("builtins", "collections.abc"):
        fixed = kind is tuple and bool(args) and args[-1] is not Ellipsis
        words = f"{len(args)} {_many(args[0])}" if fixed else "a list" + (f" of {_many(args[0])}" if args else "")
        return words, lambda value: _is_list(value, args, fixed)
    return f"a {kind.__name__}", lambda value: kind is Any or isinstance(value, kind)


def _is_number(value: Any) -> bool:
    if isinstance(value, str | bytes | type) or getattr(value, "shape", ()) != ():
        return False
    if isinstance(value, np.generic | np.ndarray) or (hasattr(value, "dtype") and hasattr(value, "shape")):
        return _kind(value) in "biufV"
    if not isinstance(value, Real):
        return False
    try:
        float(value)
    except OverflowError:
        return False
    except Exception:  # numbers that JAX traces
        return True
    return True


def _kind(value: Any) -> str:
    return getattr(value.dtype, "kind", "V")  # a random key's type has none


def _is_array(value: object) -> bool:
    if isinstance(value, list | tuple):
        return all(_is_array(x) for x in value[:_MANY])
    return (hasattr(value, "dtype") and _kind(value) in "biufV") or _is_number(value)


def _is_mapping(value: object, args: tuple) -> bool:
    if not isinstance(value, collections.abc.Mapping):
        return False
    entries = list(value.items())[:_MANY] if len(args) == 2 else []
    return all(all(map(_fits, entry, args)) for entry in entries)


def _is_list(value: Any, args: tuple, fixed: bool) -> bool:
    if isinstance(value, str):
        return bool(args) and args[0] is str
    if isinstance(value, bytes | collections.abc.Mapping) or getattr(value, "shape", None) == ():
        return False
    if getattr(value, "__iter__", None) is None:
        return False
    if not hasattr(value, "__len__") or not args:
        return True
    entries = list(value)[:_MANY]
    if fixed:
        return len(entries) == len(args) and all(map(_fits, entries, args))
    return all(_fits(x, args[0]) for x in entries)


_PLAIN: dict[Any, tuple[str, Callable[[Any], bool]]] = {
    **dict.fromkeys((None, type(None)), ("None", lambda x: x is None)),
    **dict.fromkeys((float, complex), ("a number", _is_number)),
    int: ("a whole number", lambda x: isinstance(x, int | np.integer) and abs(int(x)) < 2**63),
    bool: ("True or False", lambda x: (isinstance(x, int) and x in (0, 1)) or getattr(x, "shape", None) == ()),
    str: ("a text", lambda x: isinstance(x, str)),
    Path: ("a path", lambda x: isinstance(x, str | os.PathLike)),
    collections.abc.Callable: ("a function", callable),
}
"""Plain kinds of arguments: as messages call them, and which values are of them."""


def _many(kind: object) -> str:
    """Several of a kind."""
    return {str: "names", float: "numbers", int: "whole numbers"}.get(kind) or _read_annotation(kind)[0].removeprefix(
        "a "
    )
