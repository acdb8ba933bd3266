"""A scene in axes, as pictures of the plane and of space share it: extents, traces, arrows and the pose shown.

Arrows of velocities, accelerations and forces have a scale that a reader can measure by.
"""

import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.offsetbox import AnnotationBbox, HPacker, TextArea, VPacker
from matplotlib.text import Text
from matplotlib.transforms import Transform

from jaxnc.errors import InputError, nearest
from jaxnc.viz.poses import Poses
from jaxnc.viz.style import HEADING, LIGHT, NUMBERS, wide, wrap

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


# -- a scene in axes ---------------------------------------------------------------------------------------------------


Names = str | Iterable[str]

_GAP = "    "  # between entries of a legend


class View:
    """A scene to be put in axes.

    The poses `shown` decide the extents; `trace` names points. `columns` are places (and in space directions) in all
    poses, ``(T, columns, dim)``; what is drawn beside the mechanism adds further ones.
    """

    ax: Any
    figure: Figure
    banner: Text
    points: float  # of a unit on paper
    unit: float  # length of a unit
    letters: float  # size of numbers and keys, units

    def __init__(self, data: Poses, shown: Sequence[int], trace: Names, labels: bool, scene: Any):
        self.data, self.shown = data, list(shown)
        self.traces = data.columns(trace, "trace")
        self.scene = scene if labels else dataclasses.replace(scene, labels=())
        self.columns = data.every_column
        self.arrow_sets: list[Arrows] = []
        lower, upper = self.scene.box(self.columns[self.shown])
        self.lower, self.upper = lower, upper
        self.inner = lower, upper  # extents without what is sized in units
        for column in self.traces:
            self.include(data.path(column)[0])

    def include(self, places: np.ndarray) -> None:
        """Take further places ``(n, dim)`` into the extents, where they are finite."""
        x = np.concatenate([np.stack(self.inner), places[np.isfinite(places).all(axis=1)]])
        self.inner = self.lower, self.upper = x.min(axis=0), x.max(axis=0)

    def add_columns(self, places: np.ndarray) -> int:
        """Add columns that stand still ``(n, dim)``, or move ``(T, n, dim)``; returns the first."""
        first = self.columns.shape[1]
        further = np.broadcast_to(places, (len(self.columns), *places.shape[-2:]))
        self.columns = np.concatenate([self.columns, further], axis=1)
        return first

    @property
    def size(self) -> float:
        """Diagonal of the extents, a length."""
        return float(np.linalg.norm(self.upper - self.lower)) or 1.0

    def aim(self, velocities, accelerations, pose: int | None, forces=()) -> None:
        """Choose arrows, scaled to one pose or to the whole motion, and take them into the extents."""
        self.add_arrows(arrows(self.data, velocities, accelerations, self.size, pose, forces))
        for item in self.arrow_sets:
            self.include((item.places + item.vectors)[self.shown].reshape(-1, self.data.dim))

    def add_arrows(self, found: list[Arrows]) -> None:
        """Add arrows to what is drawn."""
        self.arrow_sets = found

    @property
    def text_size(self) -> float:
        """Size of numbers and keys, points."""
        return float(np.clip(self.letters * self.points, NUMBERS - 1.0, NUMBERS))

    @property
    def heading_size(self) -> float:
        """Size of the title, points."""
        return float(np.clip(2.2 * self.points, NUMBERS, HEADING))

    def styled_traces(self) -> Iterator[tuple[int, int, int]]:
        """List the column of each trace, its body, and which of the body's traces it is, for the dashes."""
        count: dict[int, int] = {}
        for column in self.traces:
            body = self.scene.bodies[column]
            count[body] = count.get(body, -1) + 1
            yield column, body, count[body]

    def round_length(self, width: float) -> float:
        """Choose the length of a bar that shows the scale, for paper of a width, lengths."""
        return nice(0.28 * min(width, 2.0 * self.size))  # 0.28 of the width for a bar that shows the scale

    def add_scale_bar(self, left: float, low: float, unit: float, length: float, wide: float, **look: Any) -> None:
        """Draw a bar with its length in place of axes; `wide` is that length in the coordinates of the transform."""
        x = left + wide * np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
        y = low + 0.5 * unit * np.array([1.0, -1.0, 0.0, 0.0, -1.0, 1.0])
        self.ax.add_artist(Line2D(x, y, color=LIGHT["soft"], linewidth=0.8, gid="scale", **look))
        self.write(
            left + 0.5 * wide, low + 0.9 * unit, f"{length:g} {self.data.topology.length_unit}".strip(),
            fontsize=self.text_size - 0.5, color=LIGHT["soft"], ha="center", va="bottom", gid="scale", **look,
        )  # fmt: skip

    def write(self, x: float, y: float, text: str, **look: object) -> Text:
        """Write a text in the plane of the picture."""
        return Axes.text(self.ax, x, y, text, **{"parse_math": False, **look})

    def add_banner(self, height: float, transform: Transform) -> None:
        """Make room for what became of a pose that is not right."""
        self.banner = self.write(
            0.5, height, "", transform=transform, color=LIGHT["failure"], fontsize=self.text_size, ha="center",
            va="top", wrap=True, zorder=15.0, gid="failure",
            bbox={"facecolor": "white", "edgecolor": LIGHT["failure"], "linewidth": 0.6, "boxstyle": "round,pad=0.35"},
        )  # fmt: skip

    def show(self, k: int) -> None:
        """Move everything to pose `k`."""
        right = bool(self.data.good[k])
        self.move(k, right)
        self.banner.set_visible(not right)
        if not right:
            self.banner.set_text(f"Pose {k} failed. {self.data.sentence(k)}")

    def move(self, k: int, right: bool) -> None:
        """Bring all artists but the banner to pose `k`, as a ghost if it is not right."""
        raise NotImplementedError


@dataclass(frozen=True)
class Legend:
    """Legend under a drawing, with what is not in the picture, in as many rows as it needs."""

    entries: tuple[tuple[tuple[str, str], ...], ...] = ()  # each of one or several texts, (text, colour)

    def rows(self, room: float) -> list[list[tuple[str, str]]]:
        """Arrange the texts in rows of a width, points; an entry of one text that is longer than a row is cut."""
        parts: list[tuple[tuple[str, str], ...]] = []
        for entry in self.entries:
            text, colour = entry[0]
            parts += [entry] if len(entry) > 1 else [((part, colour),) for part in wrap(text, NUMBERS, room)]
        out: list[list[tuple[str, str]]] = []
        left = 0.0
        for entry in parts:
            takes = wide("".join(text for text, _ in entry) + _GAP, NUMBERS)
            if not out or takes > left:
                out.append([])
                left = room
            out[-1].extend((*entry, (_GAP, LIGHT["ink"])))
            left -= takes
        return out

    def height(self, room: float) -> float:
        """Measure the height of the rows in a width, points."""
        return 1.5 * NUMBERS * len(self.rows(room))  # a row is 1.5 letters high

    def paint(self, ax: Axes, room: float) -> None:
        """Write the legend under axes of a width, points."""
        look = {"fontsize": NUMBERS, "parse_math": False}
        rows: list[Any] = [
            HPacker(children=[TextArea(text, textprops={**look, "color": c}) for text, c in row], pad=0, sep=0)
            for row in self.rows(room)
        ]
        if rows:
            box = VPacker(children=rows, pad=0, sep=0.3 * NUMBERS)
            # 3.4 letters for numbers and name of the axis above them
            below = -(3.4 * NUMBERS + 6.0) if ax.axison else -2.0
            ax.add_artist(
                AnnotationBbox(
                    box, (0.0, 0.0), (0.0, below), xycoords="axes fraction", boxcoords="offset points",
                    box_alignment=(0.0, 1.0), frameon=False, pad=0.0, annotation_clip=False,
                )
            )  # fmt: skip
