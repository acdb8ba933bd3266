"""Drawing of a spatial mechanism in one pose, in axes of three dimensions."""

import dataclasses
import itertools
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist, allow_rasterization
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation
from matplotlib.ticker import FixedLocator, MaxNLocator
from matplotlib.transforms import Affine2D, BboxTransformTo, TransformedBbox
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from jaxnc.errors import InputError
from jaxnc.viz.annotations import TEXT as LETTERS
from jaxnc.viz.annotations import Arrows, label_corners, place_names
from jaxnc.viz.picture import Picture, unit_on
from jaxnc.viz.poses import Poses, evenly
from jaxnc.viz.scene import UNITS_ACROSS, Label
from jaxnc.viz.spatial.camera import Camera, choose_camera
from jaxnc.viz.spatial.mesh import reach
from jaxnc.viz.spatial.scene import Painter, Solid, SpaceFrame, Turn, Way, segment
from jaxnc.viz.spatial.sketch import CENTRE, sketch_space
from jaxnc.viz.style import GRID, HEADING, LIGHT, NUMBERS, TEXT, axis_name, colour_of, wide, wrap
from jaxnc.viz.view import Names, View

_MARGIN = 4.2  # around the mechanism, units
_BORDER = 33.0  # for numbers and names of the axes, points
_EDGE = 5.0  # of the paper, points
_SPARE = 3.4  # of a name, beyond the extents, units
_BODIES = ("bar", "plate", "edge", "wheel", "block")
_ARROW = reach(0.2, 0.62)
_ACROSS_X, _ACROSS_Y = Way(fixed=(1.0, 0.0, 0.0)), Way(fixed=(0.0, 1.0, 0.0))


# -- artists in axes of three dimensions ------------------------------------------------------------------------------


class Projection:
    """The projection of axes, for a painter.

    The axes' matrix is that of the last drawing, or of now.
    """

    def __init__(self, axes: Axes3D):
        m = axes.get_proj()
        middle = [sum(axis.get_view_interval()) / 2 for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
        self.m = m / (m[3] @ [*middle, 1.0])
        rows = self.m[:3, :3]
        self.size = np.linalg.norm(rows, axis=1)
        self.axes = rows / self.size[:, None]
        self.axes[2] = np.cross(self.axes[0], self.axes[1])  # towards the viewer, whatever the sign of the depth
        self.scale = 1.0 / self.size[0]

    def __call__(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """Find the places in the picture, nearness as a length, axes of the picture, and lengths per its unit."""
        h = np.concatenate([x, np.ones((len(x), 1))], axis=1) @ self.m.T
        return h[:, :2] / h[:, 3:4], -h[:, 2] / h[:, 3] / self.size[2], self.axes, self.scale


class Solids(PolyCollection):
    """A painted scene as an artist.

    A unit is so many `points` on paper.
    """

    def __init__(self, painter: Painter, unit: float, points: float, opacity: float = 1.0):
        super().__init__([], closed=True, capstyle="round", joinstyle="round")
        self.painter, self.unit, self.points, self.opacity = painter, unit, points, opacity
        self.faded = 1.0
        self.pose = self.places = np.zeros((0, 3))
        self.set_clip_on(False)

    def move(self, pose: np.ndarray, scalars: np.ndarray, faded: bool) -> None:
        """Bring it to a pose ``(columns, 3)``, as a ghost if that is not right."""
        self.pose, self.faded = pose, 0.14 if faded else 1.0
        self.places = self.painter.vertices(pose, scalars, self.unit)
        self.stale = True

    def do_3d_projection(self) -> float:
        """Paint the pose as it is seen now; matplotlib calls this before it draws."""
        assert isinstance(self.axes, Axes3D)
        seen = Projection(self.axes)
        corners, faces, edges, widths = self.painter.paint(self.places, self.pose, seen, self.unit, self.faded)
        faces[:, 3] *= self.opacity
        edges[:, 3] *= self.opacity
        self.set(verts=corners, facecolor=faces, edgecolor=edges, linewidth=widths * self.points)
        return 0.0

    @allow_rasterization
    def draw(self, renderer) -> None:
        """Draw it; frames of an animation ask for this alone."""
        if self.get_visible() and self.get_animated():
            self.do_3d_projection()
        super().draw(renderer)


class Name(Annotation):
    """The name of a place or an angle, which keeps beside it while the view turns; a unit is so many `points`."""

    def __init__(self, of: Label | Turn, points: float):
        self.of, self.place = of, np.zeros(3)
        look: dict[str, Any] = {"ha": "center", "va": "center", "parse_math": False, "clip_on": False, "zorder": 12.0}
        if isinstance(of, Label):
            look |= {"gid": "label", "fontstyle": "italic", "fontweight": "bold" if of.way else "normal"}
        else:
            look |= {"gid": "input"}
        colour = colour_of("ink" if isinstance(of, Label) and of.to is None else "soft", -1)
        super().__init__(
            of.text, (0.0, 0.0), (of.dx * points, of.dy * points), xycoords=self._at_place, textcoords="offset points",
            annotation_clip=False, color=colour, fontsize=LETTERS * points, **look,
        )  # fmt: skip
        halo = withStroke(linewidth=0.25 * float(self.get_fontsize()), foreground=(1.0, 1.0, 1.0, 0.8))
        self.set_path_effects([halo])

    def move(self, pose: np.ndarray, scalars: np.ndarray, unit: float, faded: bool) -> None:
        """Bring it to a pose ``(columns, 3)``, fainter if that is not right."""
        if isinstance(self.of, Label):
            self.place = self.of.foot(pose, unit)
        else:
            self.place = self.of.spot(pose, float(scalars[self.of.scalar]), unit)
        self.set_visible(bool(np.isfinite(self.place).all()))
        self.set_alpha(0.25 if faded else 1.0)

    def _at_place(self, renderer: object) -> Affine2D:
        """Bring the origin to where its place is now, pixels."""
        axes = self.axes
        assert isinstance(axes, Axes3D)
        flat, *_ = Projection(axes)(self.place[None])
        return Affine2D().translate(*axes.transData.transform(flat[0]))


# -- the view ---------------------------------------------------------------------------------------------------------


class SpaceView(View):
    """A spatial scene in axes. A camera is chosen to suit the mechanism if not given."""

    letters = 1.9

    def __init__(self, data: Poses, shown: Sequence[int], trace: Names, labels: bool, camera: Camera | None):
        scene = sketch_space(data)
        self.axes = tuple(label for label in scene.labels if label.way)
        self.tips = self.others = np.zeros((0, 3))  # of unit vectors and names; further places to be in the picture
        super().__init__(data, shown, trace, labels, scene)
        sampled = evenly(self.columns[data.extent_poses])
        self.camera = camera or choose_camera(sampled, scene.links, scene.visible, tuple(a[1] for a in scene.arrows))
        self._take_tips(self._coarse_unit)
        self.tight = False  # whether the picture is fitted to what is drawn, not to the box around it
        self.corner = (1.0, 1.0)  # upper right one of the sheet, in shares of the `paper`
        self.top = (1.0, 1.0)  # the same below the title
        self.suited: set[int] = set()  # poses that the names suit
        self.lines: list[tuple] = []  # further ones, as the painter takes traces

    @property
    def _coarse_unit(self) -> float:
        """The size of a unit, roughly, before there is any paper."""
        return float(np.linalg.norm(self.inner[1] - self.inner[0])) / UNITS_ACROSS

    def include(self, places: np.ndarray) -> None:
        """Take further places ``(n, 3)`` into the extents, where they are finite."""
        super().include(places)
        if hasattr(self, "camera"):
            self.others = np.concatenate([self.others, places[np.isfinite(places).all(axis=1)]])
            self._take_tips(self._coarse_unit)

    def _take_tips(self, unit: float) -> None:
        """Take the tips of unit vectors and placed names into the box, once the size of a unit is known."""
        some = evenly(np.array(self.shown))
        poses = self.columns[some]
        tips = [arrow.foot(poses, unit) for arrow in self.axes]
        for turn in (item for item in self.scene.items if isinstance(item, Turn)):
            inner = dataclasses.replace(turn, units=turn.units - _SPARE)
            tips += [inner.curve(self.columns[k], float(self.data.scalars[k, turn.scalar]), unit, 9) for k in some]
        tips += [
            label_corners(name, poses, self.camera, unit, _SPARE) for name in self.scene.labels if name.dx or name.dy
        ]
        found = np.concatenate([np.zeros((0, 3)), *tips])
        self.tips = found[np.isfinite(found).all(axis=1)]
        both = np.concatenate([np.stack(self.inner), self.tips])
        self.lower, self.upper = both.min(axis=0), both.max(axis=0)

    def place(self, poses: Iterable[int], unit: float) -> None:
        """Place names to suit some poses."""
        k = list(poses)
        self.suited = set(k)
        self.scene = place_names(self.scene, self.columns[k], self.data.scalars[k], self.camera, unit)
        self._take_tips(unit)

    def _spans(self, pad: float) -> np.ndarray:
        """Measure what is drawn with `pad` around it, and the floor unless `tight`: width and height, lengths."""
        lower, upper = self._visible_box()
        x = np.stack([lower - pad, upper + pad])
        if not self.tight:
            half = 0.5 * (self.upper - self.lower) + pad
            floor = np.array([(a, b, -1.0) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]) * half
            x = np.concatenate([x, floor @ self.camera.axes[:2].T])
        return np.ptp(x, axis=0)

    def _visible_box(self) -> tuple[np.ndarray, np.ndarray]:
        """Find the corners of what is drawn, lower left and upper right, lengths from the middle of the box."""
        parts = [self.scene.reach(self.columns[self.shown]), self.tips, self.others]
        parts += [self.data.path(column)[0] for column in self.traces]
        x = (np.concatenate(parts) - 0.5 * (self.lower + self.upper)) @ self.camera.axes[:2].T
        x = x[np.isfinite(x).all(axis=1)]
        return (x.min(axis=0), x.max(axis=0)) if len(x) else (np.zeros(2), np.zeros(2))

    def open(self, ax: Axes | None, size: tuple[float, float], frame: bool | str, title: str) -> None:
        """Make or take axes, set their limits, and choose the size of a unit."""
        self.tight = frame is not True
        if ax is None:
            most = np.array(size) * 72.0
            room = most
            for _ in range(3):  # what is around the axes needs more room than planned for, or less
                spare = self._make_figure(most, room, title)
                if self.tight or 0.0 <= spare.min() < _EDGE:
                    break
                room = room + np.minimum(spare, 2 * _BORDER)
            self._explain(frame)
            return
        if not isinstance(ax, Axes3D):
            raise InputError(
                f"{self.data.topology.name!r} is spatial: draw it into axes made with projection='3d', or leave ax out"
            )
        self.ax, self.figure = ax, ax.figure.canvas.figure
        if title:
            ax.set_title(title, loc="left", fontsize=TEXT, color=LIGHT["ink"], parse_math=False)
        self._arrange(self.paper_size)
        self._look()
        self._furnish(frame is True)
        self._explain(frame)

    @property
    def paper(self) -> BboxTransformTo:
        """The transform of shares of the axes' width and height; `transAxes` in space is that of a square in them."""
        return BboxTransformTo(TransformedBbox(self.ax.get_position(original=True), self.ax.figure.transSubfigure))

    @property
    def paper_size(self) -> np.ndarray:
        """Width and height of the axes on paper, points."""
        box = self.ax.get_position(original=True)
        return np.array([box.width, box.height]) * self.figure.get_size_inches() * 72.0

    def _explain(self, frame: bool | str) -> None:
        """Say what arrows stand for, and how long things are: a floor between axes, a bar in their place."""
        line = 1.5 * NUMBERS / self.paper_size[1]
        for k, item in enumerate(self.arrow_sets):
            self.write(
                self.top[0], self.top[1] - k * line, f"longest {item.longest}", transform=self.paper, ha="right",
                va="top", fontsize=self.text_size, color=LIGHT[item.noun], gid=f"{item.noun} key",
            )  # fmt: skip
        if frame is True:
            self._floor()
        elif frame == "scale":
            paper = self.paper_size
            unit, length = self.points / paper, self.round_length(paper[0] / self.scale)
            share = length * self.scale / paper[0]
            look: Any = {"transform": self.paper, "clip_on": False}
            self.add_scale_bar(1.2 * unit[0], 0.8 * unit[1], unit[1], length, share, **look)

    def _make_figure(self, most: np.ndarray, room: np.ndarray, title: str) -> np.ndarray:
        """Make a figure that fits what is drawn; returns what is left of the room, points.

        `most` is width and height that it may have, `room` those that it is planned for, points.
        """
        size = self.heading_size if hasattr(self, "points") else HEADING
        lines = wrap(title, size, most[0] - 2 * _EDGE) if title else []
        above = np.array(
            [0.0, 1.3 * size * len(lines) + (0.5 * size if lines else 0.0) + 1.5 * NUMBERS * len(self.arrow_sets)]
        )
        room = room - 2 * _EDGE - above
        self._arrange(room)
        border = 0.0 if self.tight else _BORDER
        paper = np.clip(self._spans(self._pad * self.unit) * self.scale + 2 * border, 120.0, room)
        self._measure(paper)
        whole = paper + 2 * _EDGE + above
        place = (*(_EDGE / whole), *(paper / whole))
        if hasattr(self, "ax"):
            self.figure.set_size_inches(*(whole / 72.0))
            self.ax.set_position(place)
        else:
            self.figure = Picture(figsize=tuple(whole / 72.0))
            self.canvas = FigureCanvasAgg(self.figure)
            axes = self.figure.add_axes(place, projection="3d")
            assert isinstance(axes, Axes3D)
            self.ax = axes
            self.heading = self.figure.text(0.0, 1.0, "", ha="left", va="top", parse_math=False, gid="title")
        self.heading.set(text="\n".join(lines), fontsize=size, color=LIGHT["ink"], visible=bool(lines))
        self._look()
        self._furnish(not self.tight)
        low, high = (np.full(2, _EDGE), paper + _EDGE) if self.tight else self._outermost()
        head = self.heading.get_window_extent().width * 72.0 / self.figure.dpi if title else 0.0
        now = np.minimum(np.maximum(high - low, (head, 0.0)) + 2 * _EDGE + above, most)
        start = 0.5 * (now - above - low - high) + _EDGE
        self.figure.set_size_inches(*(now / 72.0))
        self.ax.set_position((*(start / now), *(paper / now)))
        self.heading.set_position((_EDGE / now[0], 1.0 - _EDGE / now[1]))
        self.top = tuple((now - _EDGE - (0.0, above[1] - 1.5 * NUMBERS * len(self.arrow_sets)) - start) / paper)
        self.corner = tuple((now - _EDGE - above - start) / paper)
        return most - (high - low) - 2 * _EDGE - above

    def _outermost(self) -> tuple[np.ndarray, np.ndarray]:
        """Find the corners of what is drawn, of the floor and of its numbers, points on the paper."""
        ax = self.ax
        ax.M = ax.get_proj()  # the axes place their numbers with that of the last drawing
        renderer = self.canvas.get_renderer()
        axes: Any = (ax.xaxis, ax.yaxis, ax.zaxis)  # matplotlib says that x and y are axes of the plane
        views = [axis.get_view_interval() for axis in axes]
        floor = np.array([(x, y, views[2][0]) for x in views[0] for y in views[1]])
        top = np.stack([*floor.T[:2], np.full(4, views[2][1])], axis=1)
        flat, *_ = Projection(ax)(np.concatenate([floor, top, np.mean(views, axis=1)[None]]))
        pixels = ax.transData.transform(flat)
        drawn = pixels[-1] + np.array(self._visible_box()) * self.scale * self.figure.dpi / 72.0
        drawn += np.array([[-1.0], [1.0]]) * _MARGIN * self.points * self.figure.dpi / 72.0
        texts = [axis.get_tightbbox(renderer) for axis in axes]
        edge = pixels[4:8][[np.argmin(pixels[4:8, 0]), np.argmax(pixels[4:8, 0])]]  # where the line of z may stand
        x = np.concatenate([pixels[:4], edge, drawn, *(text.corners() for text in texts if text is not None)])
        return x.min(axis=0) * 72.0 / self.figure.dpi, x.max(axis=0) * 72.0 / self.figure.dpi

    @property
    def _pad(self) -> float:
        """Room around the extents, units."""
        return 5.2 if self.tight else _MARGIN

    def _arrange(self, paper: np.ndarray) -> None:
        """Place names on a piece of paper, points, and choose the scale so that they are on it."""
        self._measure(paper)
        for _ in range(1 if self.suited else 2):  # the size of a unit follows from the room that names need
            self.place(evenly(np.array(self.shown)), self.unit)
            self._measure(paper)

    def _measure(self, paper: np.ndarray) -> None:
        """Choose the scale, points per length, and the size of a unit for a piece of paper, points."""
        most = 0.84 * unit_on(paper)  # units are smaller than in the plane: there is more to see
        # 2.7 points of a unit, unless there is hardly any paper
        self.points = min(most, max(2.7, most * float(paper.min()) / 300.0))
        room = paper if self.tight else np.maximum(paper - 2 * _BORDER, 0.3 * paper)
        sides = np.abs(self.camera.axes[:2]).sum(axis=1)  # of the floor, which is wider by as much on each
        pad = 2 * self.points * self._pad * (1.0 if self.tight else np.maximum(sides * (1.0, 0.75), 1.0))
        bare = np.abs(self.camera.axes[:2]) @ (self.inner[1] - self.inner[0])
        for _ in range(3):  # unit vectors are so many units long, and have to be in the picture
            span = self._spans(0.0)
            scale = np.maximum(room - pad, 0.3 * room) / np.maximum(span, 1e-9 * self.size)
            self.scale = float(scale.min()) if span.any() else float(room.min())
            if bare.any():  # names do not take more of the room than the mechanism
                # 0.52 of the room is the mechanism's at least
                self.scale = max(self.scale, 0.52 * float((room / np.maximum(bare, 1e-9 * self.size)).min()))
            self.unit = self.points / self.scale
            self._take_tips(self.unit)

    def _look(self) -> None:
        """Set limits, view and zoom so that a length on paper is what `_measure` has chosen."""
        pad = _MARGIN * self.unit
        low, high = self.lower - pad, self.upper + pad
        if self.tight:
            off = sum(self._visible_box()) / 2 @ self.camera.axes[:2]
            low, high = low + off, high + off
        ax = self.ax
        ax.set_proj_type("ortho")
        ax.view_init(self.camera.elevation, self.camera.azimuth)
        for k, axis in enumerate("xyz"):
            getattr(ax, f"set_{axis}lim")(low[k], high[k], view_margin=0.0)
        span = high - low
        ax.set_box_aspect(tuple(span))  # equal lengths
        ax.apply_aspect()
        pixels = ax.transData.transform([(0.0, 0.0), (1.0 / Projection(ax).scale, 0.0)])  # of one length
        now = float(pixels[1, 0] - pixels[0, 0]) * 72.0 / self.figure.dpi
        ax.set_box_aspect(tuple(span), zoom=self.scale / now)  # type: ignore[arg-type]

    def _furnish(self, frame: bool) -> None:
        ax, unit = self.ax, self.data.topology.length_unit
        ax.patch.set_alpha(0.0)
        if not frame:
            ax.set_axis_off()
            return
        text = self.text_size
        axis: Any  # matplotlib says that x and y are axes of the plane
        for name, axis in (("x", ax.xaxis), ("y", ax.yaxis), ("z", ax.zaxis)):
            axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
            axis.pane.set_visible(False)
            axis.line.set_color(LIGHT["soft"])
            axis.line.set_linewidth(0.6)
            axis._axinfo["tick"].update(inward_factor=0.0, outward_factor=0.12)
            axis.set_rotate_label(False)
            way = self.camera.axes[:2, "xyz".index(name)]
            axis.set_major_locator(_ticks(axis.get_view_interval(), self.scale * way, text))
            numbers = axis.get_major_formatter().format_ticks(axis.get_majorticklocs())
            steep = abs(float(way[1])) / max(float(np.hypot(*way)), 1e-9)  # numbers stand beside, not below
            more = steep * max(wide(n, text) - 1.7 * text for n in ("00", *numbers))
            axis.set_tick_params(
                labelsize=text, color=LIGHT["soft"], labelcolor=LIGHT["ink"], width=0.6, pad=-2.0 + 0.5 * max(0.0, more)
            )
            axis.labelpad = -0.4 * text + more
            axis.label.set(text=axis_name(name, unit), fontsize=text, color=LIGHT["ink"], rotation=0.0)
            axis.label.set_parse_math(False)
        ax.grid(False)

    def _floor(self) -> None:
        """Draw a grid on the floor of the box."""
        ax = self.ax
        (x0, x1), (y0, y1) = (axis.get_view_interval() for axis in (ax.xaxis, ax.yaxis))
        z = ax.zaxis.get_view_interval()[0]
        xs = [x for x in ax.xaxis.get_majorticklocs() if x0 < x < x1]
        ys = [y for y in ax.yaxis.get_majorticklocs() if y0 < y < y1]
        rim = np.array([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z), (x0, y0, z)])
        lines = [np.array([(x, y0, z), (x, y1, z)]) for x in xs] + [np.array([(x0, y, z), (x1, y, z)]) for y in ys]
        floor = Line3DCollection([rim, *lines], colors=[LIGHT["soft"], *[GRID] * len(lines)], linewidths=0.6)
        floor.set(zorder=1.0, gid="floor", clip_on=False)
        ax.add_collection(floor, autolim=False)

    def add_arrows(self, found: list[Arrows]) -> None:
        """Add arrows to the scene; their tips, and feet that are no points, are further columns."""
        self.arrow_sets, items = found, list(self.scene.items)
        for item in found:
            feet = item.columns
            if not feet:
                first = self.add_columns(item.places)
                feet = tuple(range(first, first + item.places.shape[1]))
            first = self.add_columns(item.places + np.nan_to_num(item.vectors))
            for tip, foot in enumerate(feet, first):
                items.append(segment(item.noun, foot, tip, _ARROW))
                if item.noun == "weight":
                    items += [Solid(role, SpaceFrame(foot, _ACROSS_X, _ACROSS_Y), mesh) for role, mesh in CENTRE]
        self.scene = dataclasses.replace(self.scene, items=tuple(items))

    def ghosts(self, others: Sequence[int]) -> None:
        """Draw the bodies of other poses faintly."""
        for k in others:
            if self.data.good[k]:
                ghost = self._add_solids(Painter(self.scene, _BODIES), "ghost", 9.0, 0.2)
                ghost.move(self.columns[k], self.data.scalars[k], False)

    def _add_solids(self, painter: Painter, name: str, zorder: float, opacity: float = 1.0) -> Solids:
        solids = Solids(painter, self.unit, self.points, opacity)
        solids.set(gid=name, zorder=zorder)
        self.ax.add_collection(solids, autolim=False)
        return solids

    def draw(self, k: int, sampled: Iterable[int] | None = None) -> None:
        """Make all artists, in pose `k`; names are placed to suit the sampled poses."""
        some = [k] if sampled is None else list(sampled)
        if set(some) != self.suited:
            self.place(some, self.unit)
        self.ax.computed_zorder = False
        traces = []
        for column, body, turn in self.styled_traces():
            x, dashes = self.data.path(column)[0], (0, 6, 3)[turn % 3]
            traces.append((_even_steps(x, 0.6 * self.unit) if dashes else x, body, dashes, "trace"))
        painter = Painter(self.scene, traces=(*traces, *self.lines))
        self.solids = self._add_solids(painter, "mechanism", 10.0)
        self.names = [Name(of, self.points) for of in (*self.scene.labels, *painter.turns)]
        for name in self.names:
            self.ax.add_artist(name)
        self.add_banner(self.corner[1] - 0.015, self.paper)
        self.show(k)

    film = draw  # of an animation

    def move(self, k: int, right: bool) -> None:
        """Bring all artists but the banner to pose `k`, as a ghost if it is not right."""
        pose, scalars = self.columns[k], self.data.scalars[k]
        self.solids.move(pose, scalars, not right)
        for name in self.names:
            name.move(pose, scalars, self.unit, not right)

    @property
    def moving(self) -> list[Artist]:
        """Artists that move, from the ground up."""
        return [self.solids, *self.names, self.banner]


def _even_steps(x: np.ndarray, step: float) -> np.ndarray:
    """Divide a path into steps of one length, for dashes; gaps stay gaps."""
    pieces = [x[:1]]
    for a, b in itertools.pairwise(x):
        d = float(np.linalg.norm(b - a))
        count = max(1, round(d / step)) if np.isfinite(d) else 1
        pieces.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None] if np.isfinite(d) else b[None])
    return np.concatenate(pieces)


def _ticks(interval: np.ndarray, way: np.ndarray, text: float) -> FixedLocator:
    """Choose marks of an axis, two at least where their numbers fit, none whose number meets those of the next axis.

    `way` is what a unit of length along it is in the picture, ``(2,)`` points; the numbers are `text` points high.
    """
    low, high = (float(x) for x in interval)
    scale = float(np.hypot(*way))
    edge = min(1.4 * text / max(scale, 1e-300), 0.2 * (high - low))
    count = int(np.clip(scale * (high - low) / (6.0 * text), 1, 6))
    best: list[float] = []
    for more in range(count, count + 8):
        found = MaxNLocator(more, steps=[1, 2, 5, 10]).tick_values(low, high)
        marks = [x for x in found if low + edge < x < high - edge]
        apart = float(found[1] - found[0]) * np.abs(way)
        room = apart[0] >= 3.5 * text or apart[1] >= 1.3 * text
        if not best or room:
            best = marks
        if len(best) > 1:
            break
    return FixedLocator(best)
