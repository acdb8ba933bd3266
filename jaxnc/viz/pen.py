"""Drawing a scene with matplotlib: artists are made once, and moved from pose to pose."""

import math
from collections.abc import Callable

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Circle as CirclePatch
from matplotlib.patches import Patch, Polygon
from matplotlib.patheffects import withStroke

from jaxnc.viz.labels import TEXT
from jaxnc.viz.scene import Arc, Casing, Circle, Hatch, Item, Label, Line, Scene, Span, Stamp
from jaxnc.viz.style import colour_of

Move = Callable[[np.ndarray], None]


class Pen:
    """A scene as artists in axes.

    `places` is the first pose, ``(columns, 2)``; a unit is so many `points` (1/72 inch) on paper. All roles are drawn,
    or `only` some.
    """

    def __init__(
        self,
        axes: Axes,
        scene: Scene,
        places: np.ndarray,
        unit: float,
        points: float,
        only: tuple[str, ...] | None = None,
        opacity: float = 1.0,
    ):
        self.axes, self.unit, self.points = axes, unit, points
        self.fixed: list[Artist] = []
        self.moving: list[Artist] = []
        self.moves: list[Move] = []
        self.opacity = opacity
        self.names = -1  # the last label that was added
        self.offsets: np.ndarray | None = None
        for item in scene.items:
            if only is None or item.role in only:
                self._add(item, places)
        for label in scene.labels:
            self._add_label(label, places)
        self.fade(False)

    def move(self, places: np.ndarray, offsets: np.ndarray | None = None) -> None:
        """Bring every artist to another pose, ``(columns, 2)``; names to offsets ``(labels, 2)`` if given, units."""
        self.offsets = offsets
        for move in self.moves:
            move(places)

    def fade(self, faded: bool) -> None:
        """Show a pose that is not right as a ghost, or one that is right in full."""
        for artist in self.moving:
            artist.set_alpha(0.13 if faded else (None if self.opacity == 1.0 else self.opacity))

    def _add(self, item: Item, places: np.ndarray) -> None:
        before = len(self.moves)
        if isinstance(item, (Line, Stamp, Span)):
            self._add_outline(item, places)
        elif isinstance(item, Circle):
            self._add_circle(item, places)
        elif isinstance(item, (Hatch, Casing)):
            self._add_strokes(item, places)
        elif isinstance(item, Arc):
            self._add_arc(item, places)
        if item.style.fixed:
            del self.moves[before:]

    def _keep(self, item: Item, *artists: Artist) -> None:
        for artist in artists:
            self.axes.add_artist(artist)
            artist.set_zorder(2.0 + 0.1 * item.style.layer)
            artist.set_clip_on(True)
            artist.set_gid(item.role)
        (self.fixed if item.style.fixed else self.moving).extend(artists)

    def _dashes(self, item: Item) -> tuple:
        style = item.style
        return (0, [max(d, 0.05) / style.width for d in style.dash]) if style.dash else (0, None)

    def _line(self, item: Item, x: np.ndarray) -> Line2D:
        style = item.style
        cap = "round" if style.width > 0.4 else "butt"
        return Line2D(
            x[:, 0],
            x[:, 1],
            color=colour_of(style.stroke, item.body),
            linewidth=style.width * self.points,
            linestyle=self._dashes(item) if style.dash else "-",
            solid_capstyle=cap,
            solid_joinstyle="round",
            dash_capstyle="butt",
        )

    def _finish(self, patch: Patch, item: Item) -> None:
        style = item.style
        face = (colour_of(style.fill, item.body), style.opacity) if style.fill else "none"
        patch.set_facecolor(face)
        patch.set_edgecolor(colour_of(style.stroke, item.body) if style.stroke else "none")
        patch.set_linewidth(style.width * self.points)
        patch.set_joinstyle("round")
        if style.dash:
            patch.set_linestyle(self._dashes(item))

    def _add_outline(self, item: Line | Stamp | Span, places: np.ndarray) -> None:
        x = item.outline(places, self.unit)
        if not item.closed:
            line = self._line(item, x)
            self._keep(item, line)
            self.moves.append(lambda p: line.set_data(item.outline(p, self.unit).T))
            return
        patch = Polygon(x, closed=True)
        self._finish(patch, item)
        self._keep(item, patch)
        self.moves.append(lambda p: patch.set_xy(item.outline(p, self.unit)))

    def _add_circle(self, item: Circle, places: np.ndarray) -> None:
        patch = CirclePatch(tuple(places[item.at]), item.radius + item.units * self.unit)
        self._finish(patch, item)
        self._keep(item, patch)
        self.moves.append(lambda p: patch.set_center(tuple(p[item.at])))

    def _add_strokes(self, item: Hatch | Casing, places: np.ndarray) -> None:
        strokes = LineCollection(
            list(item.strokes(places, self.unit)),
            colors=[colour_of(item.style.stroke, item.body)],
            linewidths=[item.style.width * self.points],
        )
        self._keep(item, strokes)
        self.moves.append(lambda p: strokes.set_segments(list(item.strokes(p, self.unit))))

    def _add_arc(self, item: Arc, places: np.ndarray) -> None:
        colour = colour_of(item.style.stroke, item.body)
        line = self._line(item, np.zeros((1, 2)))
        head = Polygon(np.zeros((3, 2)), closed=True, facecolor=colour, edgecolor="none")
        text = self.axes.text(0, 0, item.text, color=colour, fontsize=TEXT * self.points, ha="center", va="center")
        self._keep(item, line, head)
        text.set_zorder(4.0)
        text.set_gid("input")
        text.set_path_effects([self._halo()])
        text.set_clip_on(True)
        self.moving.append(text)
        radius = item.units * self.unit

        def move(p: np.ndarray) -> None:
            first, extent = item.angles(p)
            length = math.copysign(1.5 / item.units, extent)  # of the arrow's head, as an angle
            long = abs(extent) > abs(length)
            turn = first + np.linspace(0.0, extent - 0.8 * length if long else extent, 48)
            line.set_data(p[item.at, 0] + radius * np.cos(turn), p[item.at, 1] + radius * np.sin(turn))
            last = first + extent
            rim = np.array([[item.units, last], [item.units - 0.5, last - length], [item.units + 0.5, last - length]])
            head.set_xy(p[item.at] + self.unit * rim[:, :1] * np.stack([np.cos(rim[:, 1]), np.sin(rim[:, 1])], axis=1))
            head.set_visible(long)
            text.set_position(tuple(item.spot(p, self.unit)))

        move(places)
        self.moves.append(move)

    def _halo(self) -> withStroke:
        return withStroke(linewidth=0.5 * self.points, foreground=(1.0, 1.0, 1.0, 0.8))

    def _add_label(self, item: Label, places: np.ndarray) -> None:
        k = self.names = self.names + 1

        def spot(p: np.ndarray) -> tuple[float, float]:
            offset = np.array([item.dx, item.dy]) if self.offsets is None else self.offsets[k]
            x, y = item.foot(p) + offset * self.unit
            return x, y

        text = self.axes.text(*spot(places), item.text, color=colour_of("ink", -1), fontsize=TEXT * self.points)
        text.set(ha="center", va="center", fontstyle="italic", zorder=4.0, clip_on=True, gid="label", parse_math=False)
        text.set_path_effects([self._halo()])
        self.moving.append(text)
        self.moves.append(lambda p: text.set_position(spot(p)))
