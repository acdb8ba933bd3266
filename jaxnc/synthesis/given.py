"""Numbers that a problem is stated with, checked: targets, weights, timings, what functions of one's own return."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from jaxnc.asking import ask, real
from jaxnc.errors import InputError
from jaxnc.types import Array

_SAME = 1e-9  # of the target's extent: points that are so near to each other are one


def points(target: Any, dim: int, what: str, least: int = 3, closed: bool = False) -> np.ndarray:
    """Target points ``(M, dim)``, checked."""
    try:
        out = np.asarray(target, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            f"{what}: target must be points ({'x, y' if dim == 2 else 'x, y, z'}), got {target!r}"
        ) from None
    if out.ndim != 2 or out.shape[1] != dim:
        raise InputError(f"{what}: target must have shape (points, {dim}), got {out.shape}")
    bad = np.flatnonzero(~np.isfinite(out).all(axis=1))
    if len(bad):
        raise InputError(f"{what}: target point {bad[0] + 1} is not finite: {out[bad[0]].tolist()}")
    if len(out) < least:
        raise InputError(f"{what}: {len(out)} target points; give at least {least}")
    if closed and np.max(np.abs(out[-1] - out[0])) <= _SAME * np.max(np.ptp(out, axis=0)):
        raise InputError(
            f"{what}: target point {len(out)} repeats the first one, and a closed path goes on from its last point to "
            f"the first by itself; leave it out: target[:-1] (and of timing and weights what belongs to it)"
        )
    return out


def sequence(values: Any, count: int, what: str) -> np.ndarray:
    """Numbers ``(count,)``, checked."""
    try:
        out = np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{what} must be numbers, got {values!r}") from None
    if out.shape != (count,):
        raise InputError(f"{what} must be {count} numbers, one for each target; got shape {out.shape}")
    if not np.isfinite(out).all():
        raise InputError(f"{what}: number {int(np.flatnonzero(~np.isfinite(out))[0]) + 1} is not finite")
    return out


def weights(values: Any, count: int, what: str) -> np.ndarray:
    """Weights ``(count,)``, all of them positive; ones if none are given."""
    if values is None:
        return np.ones(count)
    out = sequence(values, count, f"{what}: weights")
    bad = np.flatnonzero(out <= 0.0)
    if len(bad):
        raise InputError(
            f"{what}: weight {bad[0] + 1} is {out[bad[0]]:g}; weights of squares are positive: leave out what is not "
            f"to count, and give what hardly counts a small one, such as 1e-6"
        )
    return out


def timing(values: Any, count: int, what: str, turn: float) -> np.ndarray:
    """Values of the input at the targets ``(count,)``, in the order in which a mechanism comes through them.

    `turn` is how far the input goes at most: a whole turn of an angle, or the range that was given for it.
    """
    out = sequence(values, count, what)
    way = 1.0 if out[-1] >= out[0] else -1.0
    bad = np.flatnonzero(way * np.diff(out) <= 0.0)
    if len(bad):
        k = bad[0] + 1
        raise InputError(
            f"{what} must rise, or fall, from each target to the next, and number {k + 1} ({out[k]:g}) does not go on "
            f"from number {k} ({out[k - 1]:g}); sort the targets by it, and unwrap angles that pass a whole turn "
            f"(numpy.unwrap)"
        )
    radians(out, what, turn, "give travel=(low, high) if it turns more than once")
    return out


def radians(values: np.ndarray, what: str, turn: float, remedy: str) -> None:
    """Refuse angles that go too far to be radians.

    They may go as far as `turn`, infinite if they are none; `remedy` is what to do if that was meant.
    """
    span = float(np.ptp(values))
    if span > turn * (1 + 1e-9):
        raise InputError(
            f"{what} go{'' if what.endswith('s') else 'es'} over {span:.4g} rad, more than "
            f"{turn / (2 * np.pi):.3g} turn{'s' if turn > 7.0 else ''}: angles are in radians "
            f"(numpy.radians makes them of degrees); {remedy}"
        )


def numbers(function: Callable[[Any], Any], what: str, motion: Any) -> Array:
    """What a function of one's own returns of a motion, as an array of numbers."""
    return real(ask(function, what, "motion", motion), what, "a number or an array of numbers, built by jax.numpy")


def names(values: Any, what: str) -> list[str]:
    """Names, checked to be some."""
    if isinstance(values, str):
        return [values]
    some = list(values) if isinstance(values, Iterable) else []
    if not (isinstance(values, Iterable) and all(isinstance(name, str) for name in some)):
        raise InputError(f"{what} takes names, such as ['A', 'B.x'], got {values!r}")
    return some


def rising(values: np.ndarray) -> bool:
    """Whether numbers rise, or fall, from each to the next."""
    return bool((np.diff(values) > 0).all() or (np.diff(values) < 0).all())
