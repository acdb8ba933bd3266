"""Validation of what a user gives: functions, what they return, and numbers. Errors name what each is for."""

import os
import traceback
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.errors import InputError, brief
from jaxnc.types import Array

if TYPE_CHECKING:
    from jax.typing import DTypeLike

_LIBRARIES = tuple(os.path.dirname(str(package.__file__)) + os.sep for package in (jax, np))
_NO_NUMBERS = "cSTUMm"  # kinds of arrays that NumPy would make numbers of: complex ones, texts, dates
_NO_NUMBER_YET = (
    jax.errors.TracerArrayConversionError,
    jax.errors.TracerIntegerConversionError,
    jax.errors.ConcretizationTypeError,
)


def call_user(f: Callable, what: str, takes: str, *args: object) -> Any:
    """Call a user's function with some arguments; its own errors pass through.

    `what` is its use, named as the user did, and `takes` its arguments, for messages.
    """
    try:
        return f(*args)
    except _NO_NUMBER_YET as error:
        places = traceback.extract_tb(error.__traceback__)
        own = [place for place in places if not place.filename.startswith(_LIBRARIES)][-1]
        where = f"{os.path.basename(own.filename)}, line {own.lineno}"
        raise InputError(
            f"{what}: {function_name(f)} ({where}) needs a number where JAX has none yet, by numpy, math, float() or "
            f"an if: write it with jax.numpy (jnp.sin, and jnp.where in place of if)"
        ) from None
    except TypeError as error:
        if error.__traceback__ is not None and error.__traceback__.tb_next is not None:
            raise
        raise InputError(f"{what}: {function_name(f)} must take ({takes}); {error}") from None


def as_real(found: object, what: str, returns: str, shape: Sequence[int] | None = None) -> Array:
    """Return what a user's function has returned as an array of real numbers.

    `what` is its use, named as the user did, and `returns` what it should, for messages.
    """
    try:
        array = None if found is None else jnp.asarray(found)
    except (TypeError, ValueError, OverflowError):
        array = None
    if array is not None and array.dtype == bool:
        raise InputError(
            f"{what} returned true or false, of which nothing is known but that: return a number instead that says by "
            f"how much, such as b - a in place of a <= b"
        )
    if array is None or not jnp.issubdtype(array.dtype, np.number):
        raise InputError(f"{what} must return {returns}; it returned {_describe_result(found)}")
    if jnp.iscomplexobj(array):
        raise InputError(f"{what} must return {returns}; it returned complex ones: take jnp.real, jnp.abs or jnp.angle")
    if shape is not None and array.shape != tuple(shape):
        wanted = f"{returns}, shape {tuple(shape)}" if shape else returns
        raise InputError(f"{what} must return {wanted}; it returned an array of shape {array.shape}")
    return jnp.asarray(array, float)


def as_scalars(found: Any, what: str, count: int | None = None, drawn: bool = False) -> tuple[Any, ...]:
    """Return what a user's function has returned as a tuple of single numbers.

    `what` is its use, named as the user did; `drawn` says whether None may be one of the numbers.
    """
    wanted = f"a list of {'numbers' if count is None else count}" if count != 1 else "a list of one number, such as [x]"
    sequence = hasattr(found, "__getitem__") and hasattr(found, "__len__") and getattr(found, "shape", None) != ()
    if not sequence or isinstance(found, str | Mapping):  # a generator is empty when it is asked again
        raise InputError(f"{what} must return {wanted}; it returned {_describe_result(found)}")
    parts = tuple(found)
    for i, part in enumerate(parts):
        if isinstance(part, str) or (part is None and not drawn) or getattr(part, "shape", ()) != ():
            raise InputError(f"{what} must return {wanted}; number {i} of what it returned is {_describe_result(part)}")
        if isinstance(part, complex) or getattr(getattr(part, "dtype", None), "kind", "") == "c":
            raise InputError(
                f"{what} must return real numbers; number {i} is complex: take jnp.real, jnp.abs or jnp.angle"
            )
    if count is not None and len(parts) != count:
        raise InputError(f"{what} must return {wanted}; it returned {len(parts)}")
    return parts


def as_array(value: object, what: str, dtype: "DTypeLike" = float) -> np.ndarray:
    """Return a number, list or array that a user has given as an array; refuse what NumPy would only make numbers of.

    Args:
        value: what was given.
        what: what it is for, named as the user did.
        dtype: of the array.

    Raises:
        InputError: it is None, a text, a date, complex, masked, or no number at all; or it is traced.
    """
    found = as_traceable(value, what, dtype)
    if isinstance(found, Tracer):
        raise InputError(f"{what} must be known, and JAX traces it here (by jit, grad or vmap): give it as a constant")
    return found


def as_traceable(value: object, what: str, dtype: "DTypeLike" = float) -> Any:
    """Return what `as_array` takes, or an array of JAX where it is traced or a list or tuple holds something traced."""
    try:
        try:
            given: Any = jnp.asarray(value) if isinstance(value, Tracer) else np.asarray(value)
        except jax.errors.TracerArrayConversionError:
            given = jnp.asarray(value)
        if getattr(given.dtype, "kind", "V") in _NO_NUMBERS or np.ma.is_masked(value):  # a key of JAX's has none
            raise TypeError
        if given.dtype == object and any(x is None or isinstance(x, str | bytes) for x in given.flat):
            raise TypeError
        return given.astype(dtype, copy=False)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{what} must be a number or an array of numbers, got {_repeat(value)}") from None


def _repeat(value: object) -> str:
    """Write what is no number, as far as an error repeats it."""
    try:
        told = repr(value)
    except Exception:  # a number of too many digits, or an object of the user's that cannot say what it is
        return brief(value)
    most = 200  # characters that an error repeats
    return told if len(told) <= most else told[:most] + "…"


def as_shape(value: object, what: str, *shape: object, dtype: "DTypeLike" = float) -> Any:
    """Return numbers of a shape that a user has given as an array; traced ones as they are.

    Args:
        value: what was given.
        what: what it is for, named as the user did.
        *shape: how long each axis is, None for any; an Ellipsis in front stands for any axes.
        dtype: of the array.

    Raises:
        InputError: it is no array of numbers, or of another shape.
    """
    ready = isinstance(value, jax.Array) and value.dtype == dtype
    found: Any = value if ready else as_traceable(value, what, dtype)
    free = bool(shape) and shape[0] is Ellipsis
    wanted = shape[1:] if free else shape
    last = found.shape[len(found.shape) - len(wanted) :] if free else found.shape
    if len(last) != len(wanted) or any(n not in (None, m) for n, m in zip(wanted, last, strict=True)):
        told = ", ".join("…" if n is Ellipsis else "any" if n is None else str(n) for n in shape)
        raise InputError(f"{what} must have the shape ({told}{',' * (len(shape) == 1)}), got {found.shape}")
    return found


def _describe_result(found: object) -> str:
    """Describe what a function has returned, as messages show it."""
    if isinstance(found, jax.Array | np.ndarray):
        return f"an array of shape {found.shape}"
    text = repr(found)
    kind = "" if found is None else f"{type(found).__name__} "
    return kind + (text if len(text) <= 60 else text[:57] + "...")


def function_name(f: Callable) -> str:
    """Name a function as messages call it."""
    inner = getattr(f, "func", f)  # of a functools.partial
    name = getattr(inner, "__name__", type(inner).__name__)
    return "the lambda" if name == "<lambda>" else f"{name}()"
