"""Whether the size of a drawing fits its length unit: millimetres taken for metres, and the other way round."""

import numpy as np
from jax.core import Tracer

from jaxnc.system.system import System

METRES = {"m": 1.0, "dm": 0.1, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
"""What the usual length units are in metres."""

_MACHINE = (1e-3, 300.0)  # metres: watches to bucket-wheel excavators
_SUSPENSION = (0.04, 8.0)  # metres: model cars to haul trucks


def doubtful_size(system: System, suspension: bool = False) -> str:
    """A sentence on a drawing whose size is absurd in its length unit, with the remedy; empty if nothing is suspect.

    Its numbers are taken in the `length_unit` of its mechanism; a suspension of a vehicle leaves less room.
    """
    points, unit = system.parameters.points, system.topology.length_unit
    if isinstance(points, Tracer) or np.ndim(points) != 2 or unit not in METRES or not len(points):
        return ""
    low, high = _SUSPENSION if suspension else _MACHINE
    size = float(np.max(np.ptp(np.asarray(points), axis=0)))
    metres = size * METRES[unit]
    if size == 0.0 or low <= metres <= high:
        return ""
    noun = "suspension" if suspension else "mechanism"
    fits = [u for u in ("mm", "m", "in", "cm") if u != unit and _SUSPENSION[0] <= size * METRES[u] <= _SUSPENSION[1]]
    text = f"the drawing is {size:.3g} {unit} wide, which is hardly meant for a {noun}"
    if not fits:
        return f"{text}: check its numbers and its length unit, {unit!r}"
    return f"{text}: its numbers look like {fits[0]}; set the length unit to {fits[0]!r} or convert the numbers"
