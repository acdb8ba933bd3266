"""Numbers that a problem is stated and searched with, checked; an error names what is at fault and what to try."""

from collections.abc import Callable, Collection, Iterable
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from jaxnc.errors import InputError, nearest
from jaxnc.internals import outermost
from jaxnc.kinematics.inputs import whole
from jaxnc.types import Array
from jaxnc.validate import as_real, call_user

if TYPE_CHECKING:
    from jaxnc.kinematics.motion import Motion


def as_floats(value: object, otherwise: str = "") -> np.ndarray:
    """Numbers as an array; of what are none an error that says `otherwise`, or NaN if that says nothing."""
    try:
        given = np.asarray(value)
        if np.iscomplexobj(given):
            raise TypeError
        return np.asarray(given, dtype=float)
    except (TypeError, ValueError, OverflowError):
        if not otherwise:
            return np.asarray(np.nan)
        raise InputError(otherwise) from None


def as_points(target: object, dim: int, what: str, least: int = 3, closed: bool = False) -> np.ndarray:
    """Check target points, ``(M, dim)``."""
    out = as_floats(target, f"{what}: target must be points ({'x, y' if dim == 2 else 'x, y, z'}), got {target!r}")
    if out.ndim != 2 or out.shape[1] != dim:
        raise InputError(f"{what}: target must have shape (points, {dim}), got {out.shape}")
    bad = np.flatnonzero(~np.isfinite(out).all(axis=1))
    if len(bad):
        raise InputError(f"{what}: target point {bad[0] + 1} is not finite: {out[bad[0]].tolist()}")
    if len(out) < least:
        raise InputError(f"{what}: {len(out)} target points; give at least {least}")
    # 1e-9 of the target's extent: points that are so near to each other are one
    if closed and np.max(np.abs(out[-1] - out[0])) <= 1e-9 * np.max(np.ptp(out, axis=0)):
        raise InputError(
            f"{what}: target point {len(out)} repeats the first one, and a closed path goes on from its last point to "
            f"the first by itself; leave it out: target[:-1] (and of timing and weights what belongs to it)"
        )
    return out


def as_sequence(values: object, count: int, what: str) -> np.ndarray:
    """Check numbers, one for each target, ``(count,)``."""
    out = as_floats(values, f"{what} must be numbers, got {values!r}")
    if out.shape != (count,):
        raise InputError(f"{what} must be {count} numbers, one for each target; got shape {out.shape}")
    if not np.isfinite(out).all():
        raise InputError(f"{what}: number {int(np.flatnonzero(~np.isfinite(out))[0]) + 1} is not finite")
    return out


def as_weights(values: object, count: int, what: str) -> np.ndarray:
    """Check weights, all of them positive, ``(count,)``; ones if none are given."""
    if values is None:
        return np.ones(count)
    out = as_sequence(values, count, f"{what}: weights")
    bad = np.flatnonzero(out <= 0.0)
    if len(bad):
        raise InputError(
            f"{what}: weight {bad[0] + 1} is {out[bad[0]]:g}; weights of squares are positive: leave out what is not "
            f"to count, and give what hardly counts a small one, such as 1e-6"
        )
    return out


def as_timing(
    values: object, count: int, what: str, turn: float, ordered: bool = True,
    remedy: str = "give travel=(low, high) if it turns more than once",
) -> np.ndarray:  # fmt: skip
    """Check values of the input at the targets, in the order in which a mechanism comes through them, ``(count,)``.

    The input goes as far as `turn` at most: a whole turn of an angle, or the range that was given for it; twice as far
    where the targets are not `ordered`; `remedy` is what to do if that was meant.
    """
    out = as_sequence(values, count, what)
    way = 1.0 if out[-1] >= out[0] else -1.0
    bad = np.flatnonzero(way * np.diff(out) <= 0.0)
    if ordered and len(bad):
        k = bad[0] + 1
        raise InputError(
            f"{what} must rise, or fall, from each target to the next, and number {k + 1} ({out[k]:g}) does not go on "
            f"from number {k} ({out[k - 1]:g}); sort the targets by it, and unwrap angles that pass a whole turn "
            f"(numpy.unwrap)"
        )
    most = turn if ordered else 2 * turn
    check_radians(out, what, most, remedy)
    return out


def check_radians(values: np.ndarray, what: str, turn: float, remedy: str) -> None:
    """Refuse angles that go too far to be radians.

    They may go as far as `turn`, infinite if they are none; `remedy` is what to do if that was meant.
    """
    span = float(np.ptp(values))
    if span > turn * (1 + 1e-9):
        raise InputError(
            f"{what} go{'' if what.endswith('s') else 'es'} over {span:.4g} rad ({np.degrees(span):.4g} degrees), "
            f"more than {turn / (2 * np.pi):.3g} turn{'s' if turn > 7.0 else ''}: angles are in radians "
            f"(numpy.radians makes them of degrees); {remedy}"
        )


def call_on_motion(function: Callable, what: str, motion: "Motion | None") -> Array:
    """Call a user's function with a motion; the numbers that it returns, as an array."""
    return as_real(
        call_user(function, what, "motion", motion), what, "a number or an array of numbers, built by jax.numpy"
    )


def check_name(name: object, known: Collection[str], says: str) -> None:
    """Refuse a name that is not known, by an error that begins with what `says`."""
    if name not in known:
        raise InputError(f"{says}; {nearest(str(name), known)}")


def as_names(values: object, what: str) -> list[str]:
    """Check that names are some."""
    if isinstance(values, str):
        return [values]
    some = list(values) if isinstance(values, Iterable) else []
    if not (isinstance(values, Iterable) and all(isinstance(name, str) for name in some)):
        raise InputError(f"{what} takes names, such as ['A', 'B.x'], got {values!r}")
    return some


def as_interval(pair: Any, what: str) -> tuple[float, float]:
    """Check a pair (low, high), None for no bound."""
    try:
        low, high = pair
        low, high = (-np.inf if low is None else float(low)), (np.inf if high is None else float(high))
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{what} must be (low, high), either of them None for no bound; got {pair!r}") from None
    if np.isnan(low) or np.isnan(high):
        raise InputError(f"{what} must be numbers, or None for no bound; got {pair!r}")
    if low == high and "bounds" in what:
        raise InputError(
            f"{what} leave {low:g} alone: leave a variable that stays out of free=, and state a length that is given "
            f"as S.equal((…, …), {low:g})"
        )
    if not low < high:
        raise InputError(
            f"{what} exclude{'' if 'bounds' in what else 's'} everything: low = {low:g} is not below high = {high:g}"
        )
    return low, high


def check_counts(what: str, **counts: Any) -> None:
    """Check that counts are whole numbers of 1 and more."""
    for name, value in counts.items():
        whole(value, f"{what}: {name}")


def as_time_limit(what: str, seconds: float | None) -> float:
    """Check seconds to stop after; infinite for None."""
    if seconds is None:
        return np.inf
    least = float(np.nextafter(0.0, 1.0))
    return check_limit(what, "a positive number, or None for no end", least, seconds=seconds)


def check_limit(what: str, wanted: str, least: float = 0.0, **given: Any) -> float:
    """Check a number at which something stops, of a name; `wanted` says what it must be."""
    ((name, value),) = given.items()
    if isinstance(value, bool) or not isinstance(value, (int, float, np.number)) or not value >= least:
        raise InputError(f"{what}: {name}={value!r}; it must be {wanted}")
    return float(value)


def as_seed(what: str, key: Any) -> list[int]:
    """The numbers of a key of random numbers, those of ``jax.random.key(0)`` for None."""
    if not outermost():
        raise InputError(f"{what}() needs numbers, and in traced code there are none: call it outside")
    if key is None:
        key = jax.random.key(0)
    try:
        found = np.asarray(jax.random.key_data(key))
    except (TypeError, ValueError, OverflowError):
        found = np.zeros(0)
    if found.ndim != 1 or not found.size:
        number = int(key) if isinstance(key, (int, np.integer)) and not isinstance(key, bool) else 0
        raise InputError(f"{what}: key={key!r} is no key of random numbers; write key=jax.random.key({number})")
    return found.astype(np.uint32).tolist()
