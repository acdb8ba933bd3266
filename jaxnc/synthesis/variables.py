"""Design variables of a problem: which numbers of a drawing may change, their bounds, and random starts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.redesign import components, flattened
from jaxnc.synthesis.given import names as names_given
from jaxnc.synthesis.pytree import Leaves
from jaxnc.system.system import System, characteristic_length


@dataclass(frozen=True, eq=False)
class Variables(Leaves):
    """The free components of a system's design."""

    names: tuple[str, ...]  # of the components: "B.x", "coupler.B-C"
    at: np.ndarray  # their places in the flat parameters (points, vectors, markers, dimensions)
    home: np.ndarray  # their values in the starting idea
    scale: np.ndarray  # how much each changes typically: the size of the drawing, of a unit vector, or of the number
    low: np.ndarray  # lower bounds, -inf where there is none
    high: np.ndarray  # upper bounds
    chosen: bool  # whether they were named, rather than all taken


def variables(
    system: System, free: Sequence[str] | None = None, bounds: Mapping[str, Any] | None = None, what: str = "problem"
) -> Variables:
    """Choose design variables.

    Names are of points, vectors, markers, explicit dimensions or single components such as ``"D.x"``, all if none are
    given. Bounds ``(low, high)`` are None for none; of a point one pair for each axis, or one pair for all.
    """
    every = components(system)
    known = [*dict.fromkeys(n for n, _, _ in every), *(c for n, c, _ in every if c != n)]
    chosen = range(len(every))
    if free is not None:
        free = names_given(free, f"{what}: free=")
        if not free:
            raise InputError(f"{what}: free=() leaves nothing to design; name variables, or leave it out for all")
        for name in free:
            if name not in known:
                raise InputError(f"{what}: {system.name!r} has no design variable {name!r}; {nearest(name, known)}")
        chosen = [k for k, (name, part, _) in enumerate(every) if name in free or part in free]
    at = np.array(list(chosen), dtype=int)
    names = tuple(every[k][1] for k in at)
    home = np.asarray(flattened(system), dtype=float)[at]
    size = float(characteristic_length(system.parameters.points))
    drawn = len(every) - len(system.topology.dimensions)
    scale = np.where(at < drawn, size, np.maximum(np.abs(home), 1e-3 * size))
    scale = np.where([k < drawn and every[k][2] == "rad" for k in at], 1.0, scale)  # unit vectors have no size
    low, high = np.full(len(at), -np.inf), np.full(len(at), np.inf)
    for name, pair in (bounds or {}).items():
        places = [i for i, k in enumerate(at) if name in every[k][:2]]
        if not places:
            if name in known:
                raise InputError(f"{what}: bounds for {name!r}, which is not free; add it to free=")
            raise InputError(f"{what}: bounds for {name!r}, which is no design variable; {nearest(name, known)}")
        each = [pair] * len(places)
        if len(places) > 1 and np.ndim(pair) and any(np.ndim(p) == 1 for p in pair):
            if len(pair) != len(places):
                raise InputError(
                    f"{what}: bounds of {name!r} are {len(pair)} pairs for {len(places)} components that are free, "
                    f"{', '.join(every[at[i]][1] for i in places)}; give one pair for each, or one for all"
                )
            each = list(pair)
        for i, one in zip(places, each, strict=True):
            low[i], high[i] = interval(one, f"{what}: bounds of {names[i]!r}")
    return Variables(names, at, home, scale, low, high, free is not None)


def interval(pair: Any, what: str) -> tuple[float, float]:
    """A pair (low, high), None for no bound."""
    try:
        low, high = pair
        low, high = (-np.inf if low is None else float(low)), (np.inf if high is None else float(high))
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{what} must be (low, high), either of them None for no bound; got {pair!r}") from None
    if np.isnan(low) or np.isnan(high):
        raise InputError(f"{what} must be numbers, or None for no bound; got {pair!r}")
    if not low < high:
        raise InputError(
            f"{what} exclude{'' if 'bounds' in what else 's'} everything: low = {low:g} is not below high = {high:g}"
        )
    return low, high
