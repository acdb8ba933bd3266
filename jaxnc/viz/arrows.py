"""Velocities and accelerations as arrows, with a scale that a reader can measure by."""

import math
from dataclasses import dataclass

import numpy as np

from jaxnc.errors import InputError
from jaxnc.viz.poses import Poses

_LONGEST = 0.2  # of the drawing's size
_NOUNS = ("velocity", "acceleration")


@dataclass(frozen=True)
class Arrows:
    """Arrows of one quantity.

    Args:
        noun: ``"velocity"`` or ``"acceleration"``.
        columns: the points they stand at.
        vectors: as lengths in the drawing, ``(T, arrows, dim)``, NaN where a pose is not right.
        key: length of the key's arrow in the drawing.
        text: what the key's arrow stands for.
        longest: what the longest arrow stands for.
    """

    noun: str
    columns: tuple[int, ...]
    vectors: np.ndarray
    key: float
    text: str
    longest: str


def arrows(poses: Poses, velocities, accelerations, size: float, pose: int | None = None) -> list[Arrows]:
    """Scale the arrows that were asked for.

    Args:
        poses: the motion.
        velocities: names of points whose velocity is shown.
        accelerations: names of points whose acceleration is shown.
        size: diagonal of the drawing, a length.
        pose: the pose that decides the scale; all of them if not given.

    Returns:
        Arrows of each quantity that was asked for.

    Raises:
        InputError: unknown point, or a motion without rates.
    """
    out = []
    for order, names in ((1, velocities), (2, accelerations)):
        noun = _NOUNS[order - 1]
        columns = poses.columns(names, {1: "velocities", 2: "accelerations"}[order])
        if not columns:
            continue
        x = poses.rates(order)[:, list(columns)]
        seen = x if pose is None else x[pose : pose + 1]
        length = np.linalg.norm(seen, axis=-1)
        longest = float(np.nanmax(length)) if np.isfinite(length).any() else 0.0
        scale = _LONGEST * size / longest if longest > 0 else 1.0
        key = nice(0.6 * longest) if longest > 0 else 1.0
        unit = f"{poses.topology.length_unit}/s" + ("" if order == 1 else "²")
        words = f"{noun} {key:g} {unit}", f"{noun} {longest:.3g} {unit}"
        out.append(Arrows(noun, columns, x * scale, key * scale if longest > 0 else 0.0, *words))
    return out


def nice(value: float) -> float:
    """The number 1, 2 or 5 times a power of ten nearest below a positive value."""
    if not value > 0 or not math.isfinite(value):
        raise InputError(f"no scale for {value!r}")
    power = 10.0 ** math.floor(math.log10(value))
    step = max(k for k in (1, 2, 5) if k * power <= value * (1 + 1e-12))
    return float(f"{step * power:.12g}")
