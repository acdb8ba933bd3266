"""Dimensions of ready mechanisms: what users may give, as annotations say it, and how it is refused."""

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any, Literal, TypeAlias, TypeVar, get_args, get_origin

from jaxnc.calls import public
from jaxnc.errors import MechanismError, brief
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism.checks import Checks

Length: TypeAlias = Annotated[float, "positive"]
"""A dimension that is above zero; a plain float may have any sign."""

_Draws = TypeVar("_Draws", bound=Callable[..., Mechanism])


class Misfit(MechanismError):
    """Dimensions that make no mechanism; `offer` puts the mechanism's name in front."""


def offer(draw: _Draws) -> _Draws:
    """Open a function that draws a mechanism to users, with checks of what they give.

    Annotations say what its dimensions may be: `Length` a positive number, float any finite one, a tuple of floats a
    place, a literal one of its words. The function gets floats, and what it refuses is said with its name.
    """
    signature = inspect.signature(draw)

    @functools.wraps(draw)
    def draw_checked(*args: object, **options: object) -> Mechanism:
        given = signature.bind(*args, **options)
        given.apply_defaults()
        try:
            for name, value in given.arguments.items():
                given.arguments[name] = check_dimension(name, value, signature.parameters[name].annotation)
            return draw(*given.args, **given.kwargs)
        except Misfit as error:
            raise MechanismError(f"{draw.__name__}: {error}") from None

    offered: Any = public(draw_checked)
    return offered


def check_dimension(name: str, value: object, kind: object) -> object:
    """Convert a dimension to what its annotation says; None is left where the annotation has it."""
    if type(None) in get_args(kind):
        (kind,) = (k for k in get_args(kind) if k is not type(None))
        if value is None:
            return None
    if get_origin(kind) is Literal:
        if value not in get_args(kind):
            raise Misfit(f"{name}={value!r}; use one of {', '.join(map(repr, get_args(kind)))}")
    elif kind in (float, Length):
        value = Checks.finite(value, name, Misfit)
        if kind is Length and value <= 0:
            raise Misfit(f"{name} must be positive, got {value:g}; give a length above zero")
    elif get_origin(kind) is tuple:
        value = as_numbers(name, value, len(get_args(kind)))
    return value


def as_numbers(name: str, value: Any, count: int) -> tuple[float, ...]:
    """Convert two or three finite numbers that the user gave."""
    try:
        found = tuple(value)
    except (TypeError, ValueError, OverflowError):
        found = ()
    if len(found) != count:
        raise Misfit(f"{name} must be {'two' if count == 2 else 'three'} numbers, got {brief(value)}")
    return tuple(Checks.finite(x, f"{name}[{i}]", Misfit) for i, x in enumerate(found))
