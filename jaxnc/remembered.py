"""What is worked out for a mechanism is remembered with it, and forgotten with it."""

import functools
import weakref
from collections.abc import Callable
from typing import Concatenate, ParamSpec, TypeVar

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
