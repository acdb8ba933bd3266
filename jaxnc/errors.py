"""Errors a user can meet. Each message names what is wrong and what to do about it."""

import difflib
from collections.abc import Iterable, Sequence
from typing import Any


class JaxncError(Exception):
    """Base class of every error that jaxnc raises on purpose."""


class MechanismError(JaxncError, ValueError):
    """A description that cannot be built: names, dimensions, bodies, joints."""


class ModelFileError(JaxncError, ValueError):
    """A model file that cannot be read or does not follow the schema."""


class InputError(JaxncError, ValueError):
    """An analysis asked for with the wrong inputs, names or shapes."""


class WrongCount(InputError):
    """More or fewer inputs than freedoms; whoever knows the mechanism's numbers may say more of it."""


class CallError(JaxncError, TypeError):
    """A call that a function does not take: an argument is missing, unknown, given twice, or not of its kind."""


class UnknownName(JaxncError, AttributeError):
    """Something asked of an object that has nothing of that name."""


class AssemblyError(JaxncError, RuntimeError):
    """A pose that could not be found: the mechanism does not assemble there."""


class OutputError(JaxncError, OSError):
    """A file that could not be written."""


_EXTRAS = {
    "matplotlib": ("pictures", "Matplotlib", "plot"),
    "PIL": ("films and the images of meshes", "Pillow", "plot"),
}
"""Packages that a minimal installation has not got: what needs them, what they are called, the extra that has them."""


def not_installed(error: ModuleNotFoundError) -> JaxncError | None:
    """What to say where a package is wanted that a minimal installation has not got; None of any other package."""
    package = (error.name or "").partition(".")[0]
    if package not in _EXTRAS:
        return None
    what, name, extra = _EXTRAS[package]
    return JaxncError(f'{what} need {name}, which is not installed: pip install "jaxnc[{extra}]"')


def writable(text: str) -> bool:
    """Say whether a text can be written to files and screens: it holds no half of a character (a lone surrogate)."""
    return not any("\ud800" <= letter <= "\udfff" for letter in text)


def is_traced(value: object) -> bool:
    """Say whether a number, or one of some, is traced by JAX and so none yet; JAX is not imported for it."""
    each = (value, *value) if isinstance(value, (tuple, list)) else (value,)
    return any(kind.__name__ == "Tracer" for one in each for kind in type(one).__mro__)


def drawn_with_numbers(value: object) -> str:
    """Say what to do where a drawing was given numbers that JAX traces; "" if they are not."""
    if not is_traced(value):
        return ""
    return (
        ": it is traced (by jax.jit, grad or vmap), and a drawing is made of numbers. Build and compile it once, "
        "outside, and change that: system.replace({'crank.A-B': length, 'D': (x, y)}) takes traced values of all names "
        "in system.design_variables"
    )


def counted(number: int, noun: str, plural: str = "") -> str:
    """Write a number with its noun, such as "1 row" or "2 rows"."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def list_first(names: Sequence[str], most: int, between: str = ", ") -> str:
    """Join the first of some names, and say how many there are."""
    return between.join(names[:most]) + (f"{between}… ({len(names)} in all)" if len(names) > most else "")


def brief(value: Any) -> str:
    """Write a value that was given as messages repeat it: arrays by their shape, the rest as far as it is short."""
    if hasattr(value, "shape") and hasattr(value, "dtype") and not isinstance(value, type):
        return f"an array of shape {tuple(value.shape)}" if value.shape else repr(value)
    if isinstance(value, int) and value.bit_length() > 200:
        return f"a whole number of {round(value.bit_length() * 0.30103)} digits"
    try:
        text = repr(value)
    except Exception:  # of what holds such a number, or of a class of the user's own
        return f"a {type(value).__name__}"
    most = 80  # characters that a message repeats
    return text if len(text) <= most else text[: most - 1] + "…"


def nearest(name: str, names: Iterable[str], cutoff: float = 0.51) -> str:
    """Offer the known names closest to an unknown one, such as ``did you mean 'phi'?``, or list them.

    `cutoff` is how like it they are, from 0 to 1.
    """
    known = sorted(set(map(str, names)))
    name = str(name)
    close = [k for k in known if len(name) > 2 and name in k][:3]
    close = close or difflib.get_close_matches(name, known, n=3, cutoff=cutoff)
    if close:
        return "did you mean " + " or ".join(repr(c) for c in close) + "?"
    if not known:
        return "there are none yet"
    shown = ", ".join(known[:12]) + (", …" if len(known) > 12 else "")
    return f"known names: {shown}"
