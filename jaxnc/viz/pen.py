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
from matplotlib.text import Text

from jaxnc.viz.annotations import TEXT
from jaxnc.viz.scene import Arc, Casing, Circle, Hatch, Item, Label, Line, Scene, Span, Stamp
from jaxnc.viz.style import Style, colour_of

Move = Callable[[np.ndarray], None]


class Pen:
    """A scene as artists in axes.

    `places` is the first pose, ``(columns, 2)``; a unit is so many `points` (1/72 inch) on paper. All roles are drawn,
    or of a `ghost` some, faintly.
    """

    def __init__(
        self, axes: Axes, scene: Scene, places: np.ndarray, unit: float, points: float, ghost: tuple[str, ...] = ()
    ):
        self.axes, self.unit, self.points = axes, unit, points
        self.fixed: list[Artist] = []
        self.moving: list[Artist] = []
        self.moves: list[Move] = []
        self.opacity = 0.16 if ghost else None
        self.offsets: np.ndarray | None = None
        for item in scene.items:
            if not ghost or item.role in ghost:
                self._add(item, places)
        for k, label in enumerate(scene.labels):
            self._add_label(k, label, places)
        self.fade(False)

    def move(self, places: np.ndarray, offsets: np.ndarray | None = None) -> None:
        """Bring every artist to another pose, ``(columns, 2)``; names to offsets ``(labels, 2)`` if given, units."""
        self.offsets = offsets
        for move in self.moves:
            move(places)

    def fade(self, faded: bool) -> None:
        """Show a pose that is not right as a ghost, or one that is right in full."""
        for artist in self.moving:
            artist.set_alpha(0.13 if faded else self.opacity)

    def _add(self, item: Item, places: np.ndarray) -> None:
        """Make the artists of an item."""
        if isinstance(item, Circle):
            disc = CirclePatch((0.0, 0.0), item.radius + item.units * self.unit)
            self._finish(disc, item)
            self._keep(item, places, lambda p: disc.set_center(tuple(p[item.at])), disc)
        elif isinstance(item, (Hatch, Casing)):
            colour, width = colour_of(item.style.stroke, item.body), item.style.width * self.points
            strokes = LineCollection([], colors=[colour], linewidths=[width])
            self._keep(item, places, lambda p: strokes.set_segments(list(item.strokes(p, self.unit))), strokes)
        elif isinstance(item, Arc):
            self._add_arc(item, places)
        elif isinstance(item, (Line, Stamp, Span)) and item.closed:
            area = Polygon(np.zeros((1, 2)), closed=True)
            self._finish(area, item)
            self._keep(item, places, lambda p: area.set_xy(item.outline(p, self.unit)), area)
        elif isinstance(item, (Line, Stamp, Span)):
            line = self._line(item)
            self._keep(item, places, lambda p: line.set_data(item.outline(p, self.unit).T), line)

    def _keep(self, item: Item, places: np.ndarray, move: Move, *artists: Artist) -> None:
        """Add artists to the axes, in a pose, with what moves them."""
        for artist in artists:
            self.axes.add_artist(artist)
            artist.set_zorder(2.0 + 0.1 * item.style.layer)
            artist.set_clip_on(True)
            artist.set_gid(item.role)
        move(places)
        if item.style.fixed:
            self.fixed.extend(artists)
        else:
            self.moving.extend(artists)
            self.moves.append(move)

    def _dashes(self, style: Style) -> tuple:
        return (0, [max(d, 0.05) / style.width for d in style.dash])

    def _line(self, item: Item) -> Line2D:
        style = item.style
        line = Line2D([], [], color=colour_of(style.stroke, item.body), linewidth=style.width * self.points)
        line.set(solid_capstyle="round" if style.width > 0.4 else "butt", solid_joinstyle="round", dash_capstyle="butt")
        if style.dash:
            line.set_linestyle(self._dashes(style))
        return line

    def _finish(self, patch: Patch, item: Item) -> None:
        style = item.style
        patch.set_facecolor((colour_of(style.fill, item.body), style.opacity) if style.fill else "none")
        patch.set_edgecolor(colour_of(style.stroke, item.body) if style.stroke else "none")
        patch.set(linewidth=style.width * self.points, joinstyle="round")
        if style.dash:
            patch.set_linestyle(self._dashes(style))

    def _add_arc(self, item: Arc, places: np.ndarray) -> None:
        colour = colour_of(item.style.stroke, item.body)
        line = self._line(item)
        head = Polygon(np.zeros((3, 2)), closed=True, facecolor=colour, edgecolor="none")
        text = self._write(item.text, colour, gid="input")
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

        self._keep(item, places, move, line, head)

    def _write(self, text: str, colour: str, **look: object) -> Text:
        """Write a name on a halo; it is put in its place later."""
        name = self.axes.text(0.0, 0.0, text, color=colour, fontsize=TEXT * self.points)
        name.set(ha="center", va="center", zorder=4.0, clip_on=True, **look)
        name.set_path_effects([withStroke(linewidth=0.5 * self.points, foreground=(1.0, 1.0, 1.0, 0.8))])
        self.moving.append(name)
        return name

    def _add_label(self, k: int, item: Label, places: np.ndarray) -> None:
        text = self._write(item.text, colour_of("ink", -1), fontstyle="italic", gid="label", parse_math=False)

        def move(p: np.ndarray) -> None:
            offset = np.array([item.dx, item.dy]) if self.offsets is None else self.offsets[k]
            text.set_position(tuple(item.foot(p) + offset * self.unit))

        move(places)
        self.moves.append(move)
