"""A scene in axes, as pictures of the plane and of space share it: extents, traces, arrows and the pose shown."""

import dataclasses
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

from jaxnc.viz.annotations import Arrows, arrows, nice
from jaxnc.viz.poses import Poses
from jaxnc.viz.style import HEADING, LIGHT, NUMBERS, wide, wrap

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
        if np.array_equal(lower, upper):  # one place, as of unit vectors about a point: any extent will do
            lower, upper = lower - 0.5, upper + 0.5
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
