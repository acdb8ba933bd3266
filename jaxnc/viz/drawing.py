"""Drawing of a mechanism in one pose, as engineers draw it."""

import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.path import Path as MarkerPath
from matplotlib.quiver import Quiver
from matplotlib.ticker import MaxNLocator

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.system.system import System
from jaxnc.types import ArrayLike
from jaxnc.validate import as_array
from jaxnc.viz.annotations import Arrows, label_boxes, place_labels, shafts, track_labels
from jaxnc.viz.instant_overlay import PlaneOverlay, SpaceOverlay, Wish
from jaxnc.viz.pen import Pen
from jaxnc.viz.picture import Picture, Size, finish, inches, unit_on
from jaxnc.viz.poses import Poses, caption, evenly, poses
from jaxnc.viz.sketch import sketch_plane
from jaxnc.viz.spatial.camera import read_view
from jaxnc.viz.spatial.drawing import SpaceView
from jaxnc.viz.style import LIGHT, axis_name, colour_of, furnish, wide, wrap
from jaxnc.viz.view import Legend, Names, View

_MARGIN = 6.2  # around the mechanism, units
_EDGE = 4.0  # of the paper, points
_LEAST = np.array([160.0, 90.0])  # width and height of a drawing, points
_BODIES = ("bar", "plate", "disc", "rod", "slotted bar", "channel")


@public
def draw(
    motion: Motion | System | Mechanism,
    pose: int = 0,
    trace: str | Iterable[str] = (),
    velocities: str | Iterable[str] = (),
    accelerations: str | Iterable[str] = (),
    ghosts: Iterable[int] = (),
    ax: Axes | None = None,
    path: str | Path | None = None,
    labels: bool = True,
    title: str | None = None,
    frame: bool | Literal["scale"] = True,
    size: Size = (6.4, 5.0),
    dpi: float = 200.0,
    view: tuple[float, float] | None = None,
    forces: bool | str | Iterable[str] = (),
    room: ArrayLike | None = None,
    show: Wish | Iterable[Wish] = (),
) -> Figure:
    """Draw a mechanism in one pose, or as it was typed.

    Args:
        motion: one pose, or a sequence of them; of a system, or of a mechanism that need not be complete, its drawing,
            with its freedoms or what is missing in the heading.
        pose: which one, counted from the end if negative.
        trace: points and markers whose path over the whole motion is drawn.
        velocities: points and markers whose velocity is drawn as an arrow; the motion must carry rates.
        accelerations: the same for accelerations.
        ghosts: further poses, drawn faintly.
        ax: axes to draw into; a figure of its own if not given. A spatial mechanism needs ``projection="3d"``.
        path: file to write as well: PNG, SVG, PDF or JPG.
        labels: whether points and unit vectors are named.
        title: heading; the mechanism's name if not given, none if ``""``.
        frame: whether axes with coordinates are drawn, or a bar of a round length instead: ``"scale"``.
        size: largest width and height of a figure of its own, inches; or its width.
        dpi: dots per inch of a file.
        view: from where a spatial mechanism is seen: elevation and azimuth, degrees; chosen to suit it if not given.
        forces: whether forces on points are drawn, as in `jaxnc.viz.animate`.
        room: further places that have to be in the picture, ``(n, dim)``.
        show: what is to be seen of the instant, of a motion with rates: ``"centres"`` (instant centres of all pairs of
            bodies, or of one: ``"centres coupler"``), ``"centrodes coupler"``, ``"inflection circle coupler"``,
            ``"Bresse circles coupler"``, ``"curvature P"``; in space ``"screw axis coupler"``, ``"axodes coupler"``.
            ``"centrodes coupler / rocker"`` is the coupler seen from the rocker, as
            ``("centrodes", "coupler", "rocker")`` is.

    Returns:
        The figure. A pose that is not right is drawn as a ghost, with what became of it.

    Raises:
        InputError: unknown names, no such pose, a batch of several axes, no rates for arrows, no such view.
        OutputError: a file that cannot be written.
    """
    data = poses(motion)
    k = data.pose(pose)
    if not isinstance(ghosts, Iterable):
        raise InputError(f"ghosts= takes numbers of poses such as (0, 10, 20), got {ghosts!r}")
    others = [data.pose(i) for i in ghosts]
    drawing = make_view(data, [k, *others], trace, labels, view)
    if room is not None:
        places = as_array(room, "room=")
        if places.ndim != 2 or places.shape[1] != data.dim:
            raise InputError(f"room= takes places, (n, {data.dim}); got shape {places.shape}")
        drawing.include(places)
    drawing.aim(velocities, accelerations, k, forces)
    overlay = (SpaceOverlay if data.dim == 3 else PlaneOverlay)(drawing, k) if show else None
    if overlay:
        overlay.collect(show)
    name = data.topology.name if isinstance(motion, Motion) else f"{data.topology.name}: {caption(motion)}"
    drawing.open(ax, inches(size), frame, name if title is None else title)
    drawing.ghosts(others)
    drawing.draw(k)
    if overlay:
        overlay.paint()
    return finish(drawing.figure, path, dpi)


def make_view(
    data: Poses, shown: Sequence[int], trace, labels: bool, view: Sequence[float] | None
) -> "PlaneView | SpaceView":
    """Make a view of the plane or of space, to be put in axes."""
    return (SpaceView if data.dim == 3 else PlaneView)(data, shown, trace, labels, read_view(data, view))


class PlaneView(View):
    """A planar scene in axes."""

    letters = 1.8

    def __init__(self, data: Poses, shown: Sequence[int], trace: Names, labels: bool, camera: object = None):
        super().__init__(data, shown, trace, labels, sketch_plane(data))
        self.marks: list[tuple[Quiver | PathCollection, Arrows]] = []  # arrows, and symbols of centres of mass
        self.paths: list[tuple[Line2D, int]] = []
        self.tails: list[tuple[Line2D, np.ndarray, np.ndarray]] = []
        self.offsets: np.ndarray | None = None  # of names in each pose, units
        self.legend = Legend()

    def open(self, ax: Axes | None, size: tuple[float, float], frame: bool | str, title: str) -> None:
        """Make or take axes, set their limits, and choose the size of a unit."""
        self.below = np.array([0.0, 3.0 if frame == "scale" else 0.0])  # units that a scale bar takes under all
        if ax is None:
            self._make_figure(np.array(size) * 72.0, frame, title)
        else:
            self.ax, self.figure = ax, ax.figure.canvas.figure  # of a subfigure: the whole
            paper = np.array([ax.bbox.width, ax.bbox.height]) * 72.0 / self.figure.dpi
            self.points = unit_on(paper)
            self._fit(paper)
            self._make_room_for_names()
            self._fit(paper)
            self._furnish(frame)
            self._crown(title, float(paper[0]))
        self._add_quivers()
        if frame == "scale":
            length = self.round_length(self.paper[0] / self.points * self.unit)
            left, low = self.ax.get_xlim()[0] + 1.2 * self.unit, self.ax.get_ylim()[0] + 0.8 * self.unit
            self.add_scale_bar(left, low, self.unit, length, length)

    def _make_figure(self, most: np.ndarray, frame: bool | str, title: str) -> None:
        """Make a figure that fits what is drawn, at most of a width and height, points."""
        self.figure = Picture(figsize=tuple(most / 72.0))
        renderer = FigureCanvasAgg(self.figure).get_renderer()
        self.ax = self.figure.add_axes((0.1, 0.1, 0.8, 0.8))
        low, high, above = np.full(2, _EDGE), np.full(2, _EDGE), 20.0
        if frame is True:
            low = np.array([40.0, 30.0])
        low[1] += self.legend.height(most[0] - 60.0)
        for _ in range(3):  # what is around the axes, and what names need, is known once they are there
            room = most - low - high - np.array([0.0, above])
            self.points = unit_on(room)
            border = (2 * _MARGIN + self.below) * self.points
            span = np.maximum(self.upper - self.lower, 1e-9 * self.size)
            scale = float(np.min((room - border) / span))
            least = np.maximum(_LEAST, (wide(title, self.heading_size), 0.0))
            paper = np.clip(span * scale + border, np.minimum(least, room), room)
            self._fit(paper)
            self._make_room_for_names()
            self._furnish(frame)
            above = self._crown(title, float(paper[0]))
            self._lay(paper, low, high + np.array([0.0, above]))
            if frame is True:
                low, high = self._around(renderer)
            else:
                low[1] = _EDGE + self.legend.height(paper[0])
        self._lay(paper, low, high + np.array([0.0, above]))

    def _lay(self, paper: np.ndarray, low: np.ndarray, high: np.ndarray) -> None:
        """Give the axes a size with edges around them, points."""
        whole = paper + low + high
        self.figure.set_size_inches(*(whole / 72.0))
        self.ax.set_position((*(low / whole), *(paper / whole)))

    def _around(self, renderer) -> tuple[np.ndarray, np.ndarray]:
        """Measure what numbers and names of the axes take: left and below, right and above, points."""
        box = self.ax.bbox
        boxes = [axis.get_tightbbox(renderer) for axis in (self.ax.xaxis, self.ax.yaxis)]
        low = [max([0.0, *(box.min[k] - b.min[k] for b in boxes if b)]) for k in (0, 1)]
        high = max([0.0, *(b.max[0] - box.max[0] for b in boxes if b)])
        per = 72.0 / self.figure.dpi
        below = (0.0, self.legend.height(self.paper[0]))
        return np.array(low) * per + _EDGE + below, np.array([high * per + _EDGE, _EDGE])

    def _fit(self, paper: np.ndarray) -> None:
        """Set the limits for a piece of paper, points."""
        span = self.upper - self.lower
        room = np.maximum(paper - (2 * _MARGIN + self.below) * self.points, 0.3 * paper)
        scale = float(np.min(room / np.maximum(span, 1e-9 * self.size)))  # points per length
        if not span.any():
            scale = float(room.min())
        self.unit, self.paper = self.points / scale, paper
        middle, half = 0.5 * (self.lower + self.upper - self.below * self.unit), 0.5 * paper / scale
        laid = self.ax.figure.get_layout_engine() is not None  # it moves the axes later: they give way, not the limits
        self.ax.set_aspect("equal", adjustable="box" if laid else "datalim")
        self.ax.set_xlim(middle[0] - half[0], middle[0] + half[0])
        self.ax.set_ylim(middle[1] - half[1], middle[1] + half[1])

    def _make_room_for_names(self) -> None:
        """Take names that would reach over the edge into the extents, once the size of a unit is known."""
        x = self.columns[evenly(np.array(self.shown))]
        middle, half = label_boxes(place_labels(self.scene, x, self.unit), x, self.unit)
        over = half + (0.8 - _MARGIN) * self.unit
        if len(middle):
            self.lower = np.minimum(self.lower, (middle - over).min(axis=0))
            self.upper = np.maximum(self.upper, (middle + over).max(axis=0))

    def _furnish(self, frame: bool | str) -> None:
        ax, unit, text = self.ax, self.data.topology.length_unit, self.text_size
        if frame is not True:
            ax.set_axis_off()
            return
        furnish(ax, grid="")
        ax.tick_params(labelsize=text)
        for axis, name, length in ((ax.xaxis, "x", 5.5 * text), (ax.yaxis, "y", 3.4 * text)):
            paper = self.paper[0 if name == "x" else 1]
            axis.set_major_locator(MaxNLocator(int(np.clip(paper / length, 2, 7)), steps=[1, 2, 2.5, 5, 10]))
            axis.label.set(text=axis_name(name, unit), fontsize=text)

    def _crown(self, title: str, room: float) -> float:
        """Put the title above the axes, and choose where the keys of arrows go; returns the height, points."""
        text, rows = self.text_size, [0.0]
        self.keys: list[tuple[float, float]] = []  # of each: from the right, from below, points
        for item in self.arrow_sets:
            takes = item.key / self.unit * self.points + wide(item.text, text) + 2.0 * text
            if rows[-1] > 0 and rows[-1] + takes > room:
                rows.append(0.0)
            self.keys.append((rows[-1], (1.0 + 1.7 * (len(rows) - 1)) * text))
            rows[-1] += takes if item.key else 0.0
        below = 1.7 * text * len(rows) if rows[0] else 0.0
        if not title:
            self.ax.set_title("", loc="left")
            return below
        size = self.heading_size
        lines = wrap(title, size, room)
        if len(rows) == 1 and len(lines) == 1 and wide(title, size) + rows[0] <= room:
            below = 0.0
        self.ax.set_title(
            "\n".join(lines), loc="left", fontsize=size, color=LIGHT["ink"], parse_math=False, pad=below + 0.5 * size
        )
        return below + (0.5 + 1.3 * len(lines)) * size

    def _add_quivers(self) -> None:
        """Draw arrows and their keys, and the symbols of centres of mass."""
        for item, (aside, above) in zip(self.arrow_sets, self.keys, strict=True):
            colour = LIGHT[item.noun]
            start = item.places[self.shown[0]]
            zero = np.zeros(len(start))
            quiver = self.ax.quiver(
                start[:, 0], start[:, 1], zero, zero, color=colour, angles="xy", scale_units="xy", scale=1.0,
                units="inches", width=0.34 * self.points / 72.0, headwidth=4.2, headlength=5.4, headaxislength=4.9,
                minlength=0.0, minshaft=1.6, zorder=3.9,
            )  # fmt: skip
            quiver.set_clip_on(False)
            quiver.set_gid(item.noun)
            if item.key:
                key = item.key / self.unit * self.points
                legend = self.ax.quiverkey(
                    quiver, 1.0 - (aside + key) / self.paper[0], 1.0 + above / self.paper[1], item.key, item.text,
                    labelpos="W", color=colour, labelcolor=colour, coordinates="axes",
                    fontproperties={"size": self.text_size}, labelsep=0.8 * self.points / 72.0,
                )  # fmt: skip
                legend.text.set_parse_math(False)
            self.marks.append((quiver, item))
            if item.noun == "weight":
                self.marks += [(symbol, item) for symbol in self._add_mass_symbols(start, item.discs)]

    def _add_mass_symbols(self, start: np.ndarray, radii: tuple[float, ...]) -> list[PathCollection]:
        """Draw the symbols of centres of mass under joints: a circle, two of its quarters full."""
        area = (2.0 * np.array(radii) * self.points) ** 2
        turn = np.linspace(0.0, 0.5 * np.pi, 9)
        quarter = np.concatenate([[[0.0, 0.0]], np.stack([np.cos(turn), np.sin(turn)], axis=1), [[0.0, 0.0]]])
        both = MarkerPath.make_compound_path(MarkerPath(quarter, closed=True), MarkerPath(-quarter, closed=True))
        look = {"linewidths": 0.2 * self.points, "edgecolors": LIGHT["ink"], "zorder": 2.95}
        disc = self.ax.scatter(*start.T, s=area, marker="o", facecolors=LIGHT["paper"], **look)
        full = self.ax.scatter(*start.T, s=area, marker=both, facecolors=LIGHT["ink"], **{**look, "linewidths": 0.0})
        for marks in (disc, full):
            marks.set_gid("centre of mass")
        return [disc, full]

    def ghosts(self, others: Sequence[int]) -> None:
        """Draw the bodies of other poses faintly."""
        bare = dataclasses.replace(self.scene, labels=())
        for k in others:
            if self.data.good[k]:
                Pen(self.ax, bare, self.columns[k], self.unit, self.points, ghost=_BODIES)

    @property
    def moving(self) -> list[Artist]:
        """Artists that move, and those that lie over them, from the ground up."""
        lowest = min((a.get_zorder() for a in self.pen.moving), default=0.0)
        over = [a for a in self.pen.fixed if a.get_zorder() >= lowest]
        marks = [artist for artist, *_ in (*self.marks, *self.tails)]
        return [*self.pen.moving, *over, *marks, self.banner]

    def film(self, k: int, sampled: Iterable[int]) -> None:
        """Make all artists for an animation: traces are faint, and their parts that have been run are drawn over."""
        self.draw(k, sampled, opacity=0.3)
        keys = evenly(self.data.extent_poses, 96)  # names give way to what comes near at 96 poses along a motion
        if len(keys) > 1 and self.scene.labels and self.data.good.any():
            near, places = shafts(self.arrow_sets, keys), self.columns[keys]
            ways = track_labels(self.scene, places, self.unit, self.data.closed, near)
            every = [np.interp(np.arange(self.data.count), keys, way) for way in ways.reshape(len(keys), -1).T]
            self.offsets = np.stack(every, axis=1).reshape(self.data.count, -1, 2)
        self.show(k)
        for line, column in self.paths:
            tail = Line2D([], [], color=line.get_color(), linewidth=1.4 * line.get_linewidth())
            tail.set_zorder(line.get_zorder())
            self.ax.add_artist(tail)
            self.tails.append((tail, *self.data.path(column)))

    def draw(self, k: int, sampled: Iterable[int] | None = None, opacity: float = 1.0) -> None:
        """Make all artists, in pose `k`; names are placed to suit the sampled poses, traces have an opacity."""
        some = [k] if sampled is None else list(sampled)
        paper = tuple(np.array([self.ax.get_xlim(), self.ax.get_ylim()]).T)
        self.scene = place_labels(self.scene, self.columns[some], self.unit, shafts(self.arrow_sets, some), paper)
        for column, body, turn in self.styled_traces():
            (line,) = self.ax.plot(
                *self.data.path(column)[0].T, color=colour_of("body", body), linewidth=0.24 * self.points,
                linestyle=("-", (0, (4, 1.5)), (0, (1.5, 1)))[turn % 3], alpha=opacity, zorder=2.46, scalex=False,
                scaley=False, gid=f"trace {self.data.names[column]}",
            )  # fmt: skip
            self.paths.append((line, column))
        self.pen = Pen(self.ax, self.scene, self.columns[k], self.unit, self.points)
        self.add_banner(0.985, self.ax.transAxes)
        self.show(k)

    def move(self, k: int, right: bool) -> None:
        """Bring all artists but the banner to pose `k`, as a ghost if it is not right."""
        self.pen.move(self.columns[k], None if self.offsets is None else self.offsets[k])
        for tail, path, places in self.tails:
            tail.set_data(path[: places[k] + 1].T)
        self.pen.fade(not right)
        for mark, item in self.marks:
            mark.set_offsets(item.places[k])
            mark.set_visible(right)
            if isinstance(mark, Quiver):
                mark.set_UVC(*np.nan_to_num(item.vectors[k]).T)
