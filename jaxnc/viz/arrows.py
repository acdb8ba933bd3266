"""Velocities, accelerations and forces as arrows, with a scale that a reader can measure by."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from jaxnc.errors import InputError, nearest
from jaxnc.viz.poses import Poses

_LONGEST = 0.2  # of the drawing's size
_NOUNS = ("velocity", "acceleration")


@dataclass(frozen=True)
class Arrows:
    """Arrows of one quantity.

    Args:
        noun: ``"velocity"``, ``"acceleration"``, or a kind of force.
        columns: the points they stand at; none for forces, which may act elsewhere.
        places: where they stand, ``(T, arrows, dim)``.
        vectors: as lengths in the drawing, ``(T, arrows, dim)``, NaN where a pose is not right.
        key: length of the key's arrow in the drawing.
        text: what the key's arrow stands for.
        longest: what the longest arrow stands for.
        scale: what a vector is multiplied by to be a length in the drawing.
    """

    noun: str
    columns: tuple[int, ...]
    places: np.ndarray
    vectors: np.ndarray
    key: float
    text: str
    longest: str
    scale: float


def arrows(
    poses: Poses,
    velocities,
    accelerations,
    size: float,
    pose: int | None = None,
    forces: bool | str | Iterable[str] = (),
) -> list[Arrows]:
    """Scale the arrows that were asked for.

    Args:
        poses: the motion.
        velocities: names of points whose velocity is shown.
        accelerations: names of points whose acceleration is shown.
        size: diagonal of the drawing, a length.
        pose: the pose that decides the scale; all of them if not given.
        forces: kinds of forces that are shown, or True for all of them; they share one scale.

    Returns:
        Arrows of each quantity that was asked for.

    Raises:
        InputError: unknown point or kind of force, or a motion without rates.
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
        places = poses.places[:, list(columns)]
        out.append(Arrows(noun, columns, places, x * scale, key * scale if longest > 0 else 0.0, *words, scale))
    return out + _forces(poses, forces, size, pose)


def _forces(poses: Poses, wanted: bool | str | Iterable[str], size: float, pose: int | None) -> list[Arrows]:
    """Forces where they act, all on one scale; kinds and places where nothing acts are left out."""
    from jaxnc.dynamics.nodal import KINDS, nodal_forces

    kinds = KINDS if wanted is True else (wanted,) if isinstance(wanted, str) else tuple(wanted or ())
    for kind in kinds:
        if kind not in KINDS:
            raise InputError(f"forces={kind!r}; {nearest(str(kind), KINDS)}, or True for all of them")
    if not kinds:
        return []
    if len(poses.motion.rates) < 2:
        raise InputError("forces= needs a motion with velocities and accelerations: of simulate(), or of motion()")
    found = nodal_forces(poses.motion)
    dim = poses.places.shape[-1]
    right = poses.good[:, None, None]
    every = {k: np.where(right, np.asarray(found[k][1]).reshape(poses.count, -1, dim), np.nan) for k in kinds}
    sizes = {k: np.linalg.norm(x if pose is None else x[pose : pose + 1], axis=-1) for k, x in every.items()}
    longest = max((float(np.nanmax(n)) for n in sizes.values() if np.isfinite(n).any()), default=0.0)
    if not longest > 0:
        return []
    scale, out = _LONGEST * size / longest, []
    for kind in kinds:
        chosen = np.flatnonzero(np.nanmax(sizes[kind], axis=0, initial=0.0) > 1e-9 * longest)
        if len(chosen):
            own = float(np.nanmax(sizes[kind][:, chosen]))
            key = nice(0.6 * own)
            places = np.asarray(found[kind][0]).reshape(poses.count, -1, dim)[:, chosen]
            vectors = every[kind][:, chosen] * scale
            out.append(
                Arrows(kind, (), places, vectors, key * scale, f"{kind} {key:g} N", f"{kind} {own:.3g} N", scale)
            )
    return out


def nice(value: float) -> float:
    """The number 1, 2 or 5 times a power of ten nearest below a positive value."""
    if not value > 0 or not math.isfinite(value):
        raise InputError(f"no scale for {value!r}")
    power = 10.0 ** math.floor(math.log10(value))
    step = max(k for k in (1, 2, 5) if k * power <= value * (1 + 1e-12))
    return float(f"{step * power:.12g}")
