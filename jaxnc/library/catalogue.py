"""Ready mechanisms by the names they have on the command line, and what is asked of their dimensions."""

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any, Literal, TypeAlias, TypeVar, get_args, get_origin

from jaxnc.calls import public
from jaxnc.errors import MechanismError
from jaxnc.library.drawing import Misfit, as_number, as_numbers
from jaxnc.mechanism import Mechanism

Length: TypeAlias = Annotated[float, "positive"]
"""A dimension that is above zero; a plain float may have any sign."""

_Draws = TypeVar("_Draws", bound=Callable[..., Mechanism])

CATALOGUE: dict[str, Callable[..., Mechanism]] = {}
"""Every function of the library by its name with dashes. Called without arguments, each returns a mechanism whose
``model.run`` holds a default drive."""


def offer(draw: _Draws) -> _Draws:
    """Enter a function that draws a mechanism into the catalogue, and open it to users.

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
    CATALOGUE[draw.__name__.replace("_", "-")] = offered
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
        value = as_number(name, value)
        if kind is Length and value <= 0:
            raise Misfit(f"{name} must be positive, got {value:g}; give a length above zero")
    elif get_origin(kind) is tuple:
        value = as_numbers(name, value, len(get_args(kind)))
    return value
