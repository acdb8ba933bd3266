"""Numbers of 64 and of 32 bits: which of them a system is calculated with, and what is small among them.

The numbers of a system decide, whatever JAX's setting is: what is calculated for it is traced with that setting in
force, and so are rules of JAX's transformations, which may be called later.
"""

import contextlib
import dataclasses
import functools
import inspect
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax
import numpy as np
from jax.core import Tracer

from jaxnc.calls import promoting
from jaxnc.compiling import on_device, refuse_fork
from jaxnc.errors import InputError, JaxncError
from jaxnc.internals import outermost
from jaxnc.types import Array, Numbers, PyTree


class Limits(NamedTuple):
    """Limits of what counts as nothing among numbers of one width."""

    accept: float  # of the mechanism's size: a pose with a larger residual is not a solution
    rounding: float  # of the largest coordinate as a length: what rounding leaves far from the origin, after many turns
    floor: float  # of the size: nothing is gained below
    fine: float  # of the size: after a step that is shorter, the next residual is rounding
    close: float  # of the size: places that are no farther apart are the same
    singular: float  # ratio of pivots below which no derivative is formed
    poor: float  # of the largest pivot: where a pivot is smaller, a planned elimination is not trusted
    damping: float  # the least of Levenberg and Marquardt
    smallest: float  # of the way between two input values: a smaller step means that the branch ends here
    touch: float  # of the way: a branch that ends so close to an input value touches it (a limit of travel)
    crossing: float  # of the size: so short a step may change an orientation sign
    isolated: float  # reciprocal condition number below which rounding splits solutions that are one, or not isolated
    told: float  # radians: where neighbouring numbers are farther apart, turns are not told
    whole: float  # of the way: what is left of it when it is done
    # On the diagonal of redundant rows of a motion: rounding of a pivot that ought to be zero is less.
    redundant: float
    nothing: float  # of the largest inertia or stiffness: what is smaller is none
    force: float  # of the largest: less is not gained by another step to an equilibrium
    balance: float  # of the largest: what may be left of forces that balance
    step: float  # relative: what a step that follows its errors errs by at least
    instant: float  # of the time: instants that are no farther apart are the same
    misfit: float  # of a segment: farther off, a drawing has left the class that its bodies were compiled for
    tiny: float  # keeps a divisor from being zero


# Of 64 and of 32 bits. Rounding is 5e8 times larger, its square root 2e4 times: where a branch ends is blurred by the
# latter.
_BOTH = {
    "accept": (1e-12, 3e-6),
    "rounding": (1e-14, 1e-6),
    "floor": (4e-16, 1e-7),
    "fine": (1e-8, 3e-4),
    "close": (1e-9, 1e-3),  # the short first step of a way magnifies rounding a thousand times
    "singular": (1e-7, 3e-6),
    "poor": (2e-7, 1e-5),
    "damping": (1e-13, 1e-6),
    "smallest": (1e-7, 1e-4),
    "touch": (1e-5, 3e-3),
    "crossing": (1e-6, 1e-4),
    "isolated": (1e-12, 1e-6),
    "told": (1e-7, 1e-3),
    "whole": (1e-9, 1e-6),
    "redundant": (1e-9, 1e-4),
    "nothing": (1e-13, 1e-6),
    "force": (1e-13, 1e-7),
    "balance": (1e-8, 1e-5),  # 1e-11 and 1e-7 are left of it by rounding
    "step": (0.0, 1e-6),
    "instant": (1e-14, 1e-7),
    "misfit": (1e-7, 1e-4),
    "tiny": (1e-300, 1e-37),
}
_DOUBLE, _SINGLE = (Limits(*numbers) for numbers in zip(*_BOTH.values(), strict=True))
WIDE, NARROW = np.dtype(np.float64), np.dtype(np.float32)
_AS_IT_IS = contextlib.nullcontext()


def limits(like: Numbers, rounded: bool = False) -> Limits:
    """Limits of what counts as nothing among numbers like those of an array.

    A design that was `rounded` is judged by the limits of 32 bits, whatever numbers it is calculated with: by so much
    its redundant rows contradict each other.
    """
    return _SINGLE if rounded or like.dtype == NARROW else _DOUBLE


def more_digits(like: Numbers) -> str:
    """Hint at 64 bits for messages, where numbers have 32."""
    return "" if like.dtype != NARROW else ". Its numbers have 32 bits: more digits has system.astype('float64')"


def farthest(like: Numbers) -> float:
    """Return the angle beyond which turns are not told apart: neighbouring numbers are farther apart than `told`."""
    return 2.0 ** (math.floor(math.log2(limits(like).told / np.finfo(like.dtype).eps)) + 1)


def numbers(like: object) -> contextlib.AbstractContextManager:
    """Make new numbers as wide as those of an array (or as a type of numbers) inside of a ``with`` statement.

    There the library's own promotion holds too: see `jaxnc.calls`.
    """
    refuse_fork()
    wide = getattr(like, "dtype", like) != NARROW
    return promoting(_AS_IT_IS if wide == _is_wide() else jax.enable_x64(wide))


def active() -> np.dtype:
    """The type of new numbers."""
    return WIDE if _is_wide() else NARROW


def _is_wide() -> bool:
    return bool(jax.config.read("jax_enable_x64"))


def chosen(dtype: str | type | np.dtype | None) -> np.dtype:
    """The type of numbers that a user asks for, 64 bits wide unless said otherwise."""
    try:
        found = WIDE if dtype is None else np.dtype(dtype)
    except (TypeError, ValueError):
        found = None
    if found is None or found not in (WIDE, NARROW):
        raise InputError(f"dtype={dtype!r}; numbers are 'float64' or 'float32'")
    if found == WIDE and not _is_wide():
        raise JaxncError(
            "jaxnc needs 64-bit numbers, and JAX has them switched off: write "
            'jax.config.update("jax_enable_x64", True) before the first computation, or set JAX_ENABLE_X64=1; or ask '
            'for 32-bit numbers and fewer digits with compile(dtype="float32")'
        )
    return found


def on_host(f: Callable) -> Callable:
    """An analysis on the host, of numbers that are known.

    Called where something is traced, with a system that is closed over, it is answered at once, as outside.
    """

    @functools.wraps(f)
    def inner(*arguments, **options):
        refuse_fork()
        leaves = jax.tree.leaves((arguments, options), is_leaf=lambda x: isinstance(x, Iterator))
        if any(isinstance(leaf, Tracer) for leaf in leaves):
            raise InputError(
                f"{f.__name__} works outside of traced code only (not inside jit, vmap or grad): call it before, with "
                f"numbers that are known, and close over what it says"
            )
        with at_once():
            return f(*arguments, **options)

    return inner


def at_once() -> contextlib.AbstractContextManager:
    """Calculate inside of a ``with`` statement what is known, also while something else is traced."""
    return _AS_IT_IS if outermost() else jax.ensure_compile_time_eval()


def converted(leaf: Array, wanted: np.dtype) -> Array:
    """An array of another type of numbers: what is known is converted in NumPy, which compiles nothing."""
    if isinstance(leaf, np.ndarray):
        return leaf.astype(wanted)
    if isinstance(leaf, Tracer):
        return jax.lax.convert_element_type(leaf, wanted)
    return on_device(np.asarray(leaf).astype(wanted))


def to_width(tree: PyTree, wanted: np.dtype) -> PyTree:
    """Convert the numbers of a tree; the designs in it remember whether they were rounded."""

    def is_design(node: object) -> bool:
        return hasattr(node, "rounded")

    def convert(node: PyTree) -> PyTree:
        other = NARROW if wanted == WIDE else WIDE
        found = jax.tree.map(lambda x: converted(x, wanted) if getattr(x, "dtype", None) == other else x, node)
        return dataclasses.replace(found, rounded=wanted == WIDE) if is_design(node) else found

    return jax.tree.map(convert, tree, is_leaf=is_design)


def widened(f: Callable) -> Callable:
    """An analysis on the host: calculated with 64-bit numbers, whatever those of its first argument are."""

    def narrow(leaf: Numbers) -> bool:
        return getattr(leaf, "dtype", None) == NARROW

    first = inspect.unwrap(f).__code__.co_varnames[0]

    @functools.wraps(f)
    def inner(*arguments, **options):
        with numbers(WIDE):
            # What is wide stays itself: what was found out about it is remembered by its identity.
            if any(map(narrow, jax.tree.leaves(arguments[:1] or options.get(first)))):
                if arguments:
                    arguments = (to_width(arguments[0], WIDE), *arguments[1:])
                else:
                    options[first] = to_width(options[first], WIDE)
            return f(*arguments, **options)

    return on_host(inner)


def as_its_system(f: Callable) -> Callable:
    """An analysis, whose first argument is a system or has one: calculated with numbers such as the system's."""
    first = next(iter(inspect.signature(f).parameters))

    @functools.wraps(f)
    def inner(*arguments, **options):
        given = arguments[0] if arguments else options.get(first)
        own = getattr(given, "__dict__", {})  # asking for what is not there costs a search for the name that was meant
        found = given if "parameters" in own else own.get("system")
        if found is None:
            found = getattr(given, "system", getattr(getattr(given, "motion", None), "system", given))
        points = getattr(getattr(found, "parameters", None), "points", None)
        if points is None or not hasattr(points, "dtype"):  # refused by the analysis itself
            return f(*arguments, **options)
        with numbers(points):
            return f(*arguments, **options)

    return inner
