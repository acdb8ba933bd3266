"""Velocities, accelerations and forces as arrows, with a scale that a reader can measure by."""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from jaxnc.errors import InputError, nearest
from jaxnc.viz.poses import Poses

LONGEST = 0.2
"""Length of the longest arrow, of the drawing's size."""

_USUAL, _BEYOND = 90.0, 1.6  # percentile of the poses, and how much more than in these is still drawn to scale
_DISC, _RING = 1.05, 1.6  # radius of the symbol of a centre of mass, and of one that is seen around a joint, units
_NOUNS = ("velocity", "acceleration")


@dataclass(frozen=True)
class Arrows:
    """Arrows of one quantity."""

    noun: str  # "velocity", "acceleration", or a kind of force
    columns: tuple[int, ...]  # the points they stand at; none for forces, which may act elsewhere
    places: np.ndarray  # where they stand, (T, arrows, dim)
    vectors: np.ndarray  # as lengths in the drawing, (T, arrows, dim), NaN where a pose is not right
    key: float  # length of the key's arrow in the drawing
    text: str  # what the key's arrow stands for
    longest: str  # what the longest arrow stands for
    scale: float  # what a vector is multiplied by to be a length in the drawing; those longer than `LONGEST` are cut
    chosen: tuple[int, ...] = ()  # of forces, which of their kind are shown
    discs: tuple[float, ...] = ()  # of weights, radii of the symbols of the centres of mass, units

    def point(self, poses: Poses, k: int) -> int | None:
        """Find the column of the point in the plane that an arrow stands at; None where it has its own place."""
        if poses.dim == 3:
            return None
        same = np.abs(poses.places - self.places[:, k, None])[poses.good].max(axis=(0, 2), initial=0.0) < 1e-9
        return int(np.argmax(same)) if same.any() else None


def arrows(
    poses: Poses,
    velocities,
    accelerations,
    size: float,
    pose: int | None = None,
    forces: bool | str | Iterable[str] = (),
) -> list[Arrows]:
    """Scale the arrows that were asked for.

    One pose decides the scale, or all of them. Kinds of forces that are shown share one scale, except those that are
    much smaller than the others.
    """
    out = []
    for order, names in ((1, velocities), (2, accelerations)):
        noun = _NOUNS[order - 1]
        columns = poses.columns(names, {1: "velocities", 2: "accelerations"}[order])
        if not columns:
            continue
        x = poses.rates(order)[:, list(columns)]
        shown, most = _reach(np.linalg.norm(x if pose is None else x[pose : pose + 1], axis=-1))
        unit = f"{poses.topology.length_unit}/s" + ("" if order == 1 else "²")
        out.append(_scale(noun, columns, poses.places[:, list(columns)], x, (shown, shown, most), unit, size))
    return out + _forces(poses, forces, size, pose)


def _reach(length: np.ndarray) -> tuple[float, float]:
    """Choose the value that the longest arrow stands for, and find the largest, of lengths ``(T, arrows)``.

    A few poses that exceed the others by far do not decide: they would leave dots of the rest.
    """
    peaks = np.max(np.nan_to_num(length), axis=1, initial=0.0)
    most = float(peaks.max(initial=0.0))
    usual = peaks[peaks > 1e-3 * most]
    return (min(most, _BEYOND * float(np.percentile(usual, _USUAL))) if len(usual) else 0.0), most


def _scale(noun, columns, places, x, reach: tuple[float, float, float], unit: str, size: float) -> Arrows:
    """Make arrows of vectors ``(T, arrows, dim)``, to scale up to a value; with the largest of their own and of all."""
    shown, own, most = reach
    scale = LONGEST * size / shown if shown > 0 else 1.0
    length = np.linalg.norm(np.nan_to_num(x), axis=-1, keepdims=True)
    vectors = scale * x * np.minimum(1.0, shown / np.maximum(length, 1e-300))
    key = nice(0.6 * shown) if own > 0 else 1.0  # arrows of one scale have keys of one length
    cut = f", cut at {_three_digits(shown)}" if most > shown * (1 + 1e-9) else ""
    words = (
        f"{noun} {key:g} {unit}{cut}",
        f"{noun} {_three_digits(own)} {unit}{f' of {_three_digits(most)}' if cut else ''}",
    )
    return Arrows(noun, columns, places, vectors, key * scale if own > 0 else 0.0, *words, scale)


def _three_digits(value: float) -> str:
    """Write three digits, and 2320 rather than 2.32e+03."""
    return f"{float(f'{value:.3g}'):g}"


def _forces(poses: Poses, wanted: bool | str | Iterable[str], size: float, pose: int | None) -> list[Arrows]:
    """Make arrows of forces where they act, all on one scale; kinds and places where nothing acts are left out."""
    if not wanted:
        return []
    from jaxnc.dynamics.reactions import KINDS, nodal_forces

    kinds = KINDS if wanted is True else (wanted,) if isinstance(wanted, str) else tuple(wanted)
    for kind in kinds:
        if kind not in KINDS:
            raise InputError(f"forces={kind!r}; {nearest(str(kind), KINDS)}, or True for all of them")
    if len(poses.motion.rates) < 2:
        raise InputError("forces= needs a motion with velocities and accelerations: of simulate(), or of motion()")
    found = nodal_forces(poses.reactions)
    dim = poses.places.shape[-1]
    right = poses.good[:, None, None]
    every = {k: np.where(right, np.asarray(found[k][1]).reshape(poses.count, -1, dim), np.nan) for k in kinds}
    sizes = {k: np.linalg.norm(x if pose is None else x[pose : pose + 1], axis=-1) for k, x in every.items()}
    reach = {k: _reach(n) for k, n in sizes.items()}
    shared, out = max(shown for shown, _ in reach.values()), []
    longest = max(most for _, most in reach.values())
    for kind in kinds:
        chosen = np.flatnonzero(np.nanmax(sizes[kind], axis=0, initial=0.0) > 1e-9 * longest)
        if len(chosen):
            own, most = reach[kind]
            places = np.asarray(found[kind][0]).reshape(poses.count, -1, dim)[:, chosen]
            # A kind that is much smaller than the largest force has a scale of its own.
            shown = shared if own > 0.2 * shared else own  # a weight beside large reactions
            made = _scale(kind, (), places, every[kind][:, chosen], (shown, own, most), "N", size)
            made = dataclasses.replace(made, chosen=tuple(chosen.tolist()))
            if kind == "weight":
                joints = range(len(poses.topology.points))  # and markers, which are crosses
                discs = tuple(_RING if made.point(poses, k) in joints else _DISC for k in range(len(chosen)))
                made = dataclasses.replace(made, discs=discs)
            out.append(made)
    return out


Segments = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Starts and ends of segments in a pose, each ``(n, dim)``, and half of their widths, units, ``(n,)``."""


def shafts(drawn: list[Arrows], sampled: Sequence[int] | np.ndarray) -> list[Segments]:
    """Collect all arrows in some poses, and the symbols of centres of mass, as what names keep clear of; lengths."""
    parts = [(a.places, a.places + a.vectors, 0.2) for a in drawn]  # half width of an arrow, units
    parts += [(a.places, a.places, np.array(a.discs)) for a in drawn if a.discs]
    if not parts:
        return []
    starts, ends = (np.concatenate([part[k] for part in parts], axis=1)[sampled] for k in (0, 1))
    widths = np.concatenate([np.broadcast_to(width, places.shape[1]) for places, _, width in parts])
    known: np.ndarray = np.all(np.isfinite(starts + ends), axis=2)
    return [(a[k], b[k], widths[k]) for a, b, k in zip(starts, ends, known, strict=True)]


def nice(value: float) -> float:
    """Round a positive value down to 1, 2 or 5 times a power of ten."""
    if not value > 0 or not math.isfinite(value):
        raise InputError(f"no scale for {value!r}")
    power = 10.0 ** math.floor(math.log10(value))
    step = max(k for k in (1, 2, 5) if k * power <= value * (1 + 1e-12))
    return float(f"{step * power:.12g}")
