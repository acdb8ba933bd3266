"""What is worked out for a mechanism is remembered with it, and forgotten with it."""

import functools
from collections.abc import Callable
from typing import Any, TypeVar

_F = TypeVar("_F", bound=Callable)
_NOTHING = object()


def with_owner(f: _F) -> _F:
    """Remember what a function returns, in its first argument: a topology, a plan, an object that lives as long.

    The other arguments are hashable and are given in order. As `functools.cache` otherwise, which would keep the owner
    and all that hangs on it for ever.
    """

    @functools.wraps(f)
    def call(owner: Any, *more: Any, **named: Any) -> Any:
        known = vars(owner).setdefault("_remembered", {})
        key = (f, more, tuple(named.items()))
        found = known.get(key, _NOTHING)
        return known.setdefault(key, f(owner, *more, **named)) if found is _NOTHING else found

    return call  # pyright: ignore[reportReturnType]
