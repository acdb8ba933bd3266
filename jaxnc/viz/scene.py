"""Items of a planar drawing, which refer to points by column, the same for figures and pages; names, for space too.

Lengths are those of the mechanism. Symbols (joints, blocks, hatching) are sized in *units*: one unit is the radius of
a joint, and each picture decides how large that is.
"""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from jaxnc.viz.style import INK, ROLES, Style

if TYPE_CHECKING:
    from jaxnc.viz.spatial.scene import Way

UNITS_ACROSS = 95.0  # of a drawing, roughly, while there is no paper that decides
SHALLOW = 0.12  # sine of the angle between bars that lie rather than cross
JOINT = 2.0  # units from a joint, within which nothing is kept apart
CROSSING = 1.1  # units, half of what a bar that is crossed at a right angle takes

Vertex = tuple[float, float, float]
"""A vertex in a frame: a length along, and units along and across."""


@dataclass(frozen=True)
class Frame:
    """Where a symbol stands."""

    at: int | tuple[float, float]  # a column, or a fixed place
    # two columns that give the direction of its first axis; otherwise `angle` does
    toward: tuple[int, int] | None = None
    angle: float = 0.0  # radians

    def stand(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Find origin ``(2,)`` and unit direction ``(2,)`` of the frame in a pose ``(columns, 2)``."""
        origin = places[self.at] if isinstance(self.at, int) else np.array(self.at)
        if self.toward is None:
            return origin, np.array([math.cos(self.angle), math.sin(self.angle)])
        d = places[self.toward[1]] - places[self.toward[0]]
        size = float(np.hypot(*d))
        return origin, d / size if size > 0 else np.array([1.0, 0.0])

    def place(self, places: np.ndarray, along: np.ndarray, across: np.ndarray | float) -> np.ndarray:
        """Find what lies so far along and across in a pose, lengths ``(n,)``: places ``(n, 2)``."""
        origin, e = self.stand(places)
        return origin + along[:, None] * e + np.multiply.outer(np.broadcast_to(across, along.shape), (-e[1], e[0]))


@dataclass(frozen=True)
class Item:
    """A thing in a drawing: its role gives the style, `body` the colour."""

    role: str
    body: int = field(default=INK, kw_only=True)

    @property
    def style(self) -> Style:
        """Look of its role."""
        return ROLES[self.role]


@dataclass(frozen=True)
class Line(Item):
    """A line through columns; an area if closed."""

    points: tuple[int, ...]
    closed: bool = False

    def outline(self, places: np.ndarray, unit: float) -> np.ndarray:
        """Find the vertices in a pose, ``(vertices, 2)``."""
        return places[list(self.points)]


@dataclass(frozen=True)
class Circle(Item):
    """A circle of a radius that is a length plus units."""

    at: int  # column of its centre
    radius: float = 0.0  # the length
    units: float = 0.0  # the units
    span: tuple[int, int] | None = None  # two columns that are as far apart, if there are such
    number: int = -1  # place of the length among the numbers of the constraints, if it is one; otherwise -1


@dataclass(frozen=True)
class Stamp(Item):
    """A symbol drawn in a frame."""

    frame: Frame  # where
    vertices: tuple[Vertex, ...]  # its corners, or the ends of a line
    closed: bool = True  # whether it is an area
    # what slides between the ends of a line: a column, and how much longer than its way the line is
    reach: tuple[tuple[int, float], ...] = ()

    def outline(self, places: np.ndarray, unit: float) -> np.ndarray:
        """Find the vertices in a pose, ``(vertices, 2)``."""
        v = np.array(self.vertices)
        return self.frame.place(places, v[:, 0] + v[:, 1] * unit, v[:, 2] * unit)


@dataclass(frozen=True)
class Span(Item):
    """A symbol stretched between two columns."""

    ends: tuple[int, int]  # the columns
    vertices: tuple[Vertex, ...]  # its corners, each a share of the way between the ends, and units along and across
    closed: bool = False  # whether it is an area

    def outline(self, places: np.ndarray, unit: float) -> np.ndarray:
        """Find the vertices in a pose, ``(vertices, 2)``."""
        (a, b), v = self.ends, np.array(self.vertices)
        size = np.hypot(*(places[b] - places[a]))
        return Frame(a, self.ends).place(places, v[:, 0] * size + v[:, 1] * unit, v[:, 2] * unit)


@dataclass(frozen=True)
class Casing(Item):
    """Gap that keeps a bar apart from those under it: a stretch of paper where it crosses one, away from the joints."""

    points: tuple[int, int]  # columns of the bar's ends
    over: tuple[tuple[int, int], ...]  # columns of the ends of those under it, which share no joint with it

    def strokes(self, places: np.ndarray, unit: float) -> np.ndarray:
        """Find the stretches in a pose, ``(stretches, 2, 2)``."""
        a, d = places[self.points[0]], places[self.points[1]] - places[self.points[0]]
        size, out = float(np.hypot(*d)), []
        for p, q in self.over:
            w, f = places[p] - a, places[q] - places[p]
            cross = d[0] * f[1] - d[1] * f[0]
            other = float(np.hypot(*f))
            sine = abs(cross) / max(size * other, 1e-300)
            if not sine > SHALLOW:
                continue
            s, t = (w[0] * f[1] - w[1] * f[0]) / cross, (w[0] * d[1] - w[1] * d[0]) / cross
            clear = JOINT * unit
            if min(s, 1 - s) * size > clear and min(t, 1 - t) * other > clear:
                half = min(CROSSING * unit / sine, min(s, 1 - s) * size - 0.5 * clear)
                out.append([a + (s - half / size) * d, a + (s + half / size) * d])
        return np.array(out).reshape(-1, 2, 2)


@dataclass(frozen=True)
class Hatch(Item):
    """Hatching on one side of a straight edge in a frame; the edge itself is a `Stamp`."""

    frame: Frame  # where
    start: tuple[float, float]  # where it begins, a length and units along
    end: tuple[float, float]  # where it ends, likewise
    offset: float  # units across
    side: int  # +1 for the left of the direction, -1 for the right
    reach: tuple[tuple[int, float], ...] = ()  # what slides along it, as a `Stamp` has it

    def strokes(self, places: np.ndarray, unit: float) -> np.ndarray:
        """Find the strokes in a pose, ``(strokes, 2, 2)``."""
        lo, hi = (length + units * unit for length, units in (self.start, self.end))
        count = max(2, round((hi - lo) / (0.85 * unit)))
        at = lo + (hi - lo) * (np.arange(count) + 0.75) / count
        foot = self.frame.place(places, at, self.offset * unit)
        end = self.frame.place(places, at - 0.75 * unit, (self.offset + 0.95 * self.side) * unit)
        return np.stack([foot, end], axis=1)


@dataclass(frozen=True)
class Arc(Item):
    """The arrow of a driven angle."""

    at: int  # column of the vertex
    start: tuple[int, int] | None  # two columns that give the direction it starts from; the x axis if none
    to: tuple[int, int]  # two columns that give the direction it goes to
    units: float  # radius in units
    text: str  # its name
    low: float = 0.0  # the least angle that is drawn, radians, see `least_angle`
    share: float = 0.5  # where the name stands, as a share of the angle
    lead: float = 0.0  # further angle to where the name stands, radians
    beside: float = 6.9  # distance of the name from the vertex, units

    def angles(self, places: np.ndarray) -> tuple[float, float]:
        """Find the start and signed extent, radians."""
        _, e = Frame(self.at, self.start).stand(places)
        _, f = Frame(self.at, self.to).stand(places)
        first = math.atan2(e[1], e[0])
        return first, shown_angle(math.atan2(f[1], f[0]) - first, self.low)

    def rim(self, places: np.ndarray, unit: float, count: int) -> np.ndarray:
        """Find the places along the arc in a pose, ``(count, 2)``."""
        first, extent = self.angles(places)
        turn = first + extent * np.linspace(0.0, 1.0, count)
        return places[self.at] + self.units * unit * np.stack([np.cos(turn), np.sin(turn)], axis=1)

    def spot(self, places: np.ndarray, unit: float) -> np.ndarray:
        """Find where its name stands, ``(2,)``."""
        first, extent = self.angles(places)
        turn = first + self.share * extent + self.lead
        return places[self.at] + self.beside * unit * np.array([math.cos(turn), math.sin(turn)])


def least_angle(values: np.ndarray) -> float:
    """Choose the least angle that the arrow of an input shows, so that it shows the values themselves where it can."""
    if np.abs(values).max() <= np.pi:
        return -np.pi
    return -2 * np.pi if values.max() <= 1e-9 else 0.0


def shown_angle(value: float, low: float) -> float:
    """Bring an angle into the turn above the least that is drawn, radians; a whole turn is none."""
    shown = (value - low) % (2 * math.pi) + low
    return math.remainder(shown, 2 * math.pi) if abs(shown) > 2 * math.pi - 1e-6 else shown


@dataclass(frozen=True)
class Label:
    """A name beside a column, beside the middle between two, or in space beside the tip of an arrow."""

    at: int  # the column
    text: str  # the name
    dx: float = 0.0  # from there to the middle of the name, to the right, units
    dy: float = 0.0  # and upwards
    to: int | None = None  # the other column, of a name in the middle
    way: "Way | None" = None  # direction of the arrow
    reach: float = 0.0  # where along the arrow, units
    further: float = 0.0  # and a length

    def foot(self, places: np.ndarray, unit: float = 0.0) -> np.ndarray:
        """Find what it stands beside in poses ``(..., columns, dim)``, ``(..., dim)``."""
        x = places[..., self.at, :]
        if self.to is not None:
            return 0.5 * (x + places[..., self.to, :])
        if self.way is None:
            return x
        d = self.way.vector(places)
        size = np.maximum(np.linalg.norm(d, axis=-1, keepdims=True), 1e-300)
        return x + (self.further + self.reach * unit) * d / size


@dataclass(frozen=True)
class Scene:
    """A whole drawing, for any pose."""

    items: tuple[Item, ...]  # from the ground up
    labels: tuple[Label, ...]  # names
    visible: tuple[int, ...]  # columns that decide the extents
    guides: np.ndarray  # fixed places that must be in view as well, (places, dim)
    bodies: tuple[int, ...]  # colour index by column, for traces

    def box(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Find the lower and upper corner, ``(dim,)`` each, of everything in poses ``(T, columns, dim)``."""
        x = self.reach(places)
        return x.min(axis=0), x.max(axis=0)

    def reach(self, places: np.ndarray) -> np.ndarray:
        """Find all places that have to be in view in poses, without symbols, ``(places, dim)``; the origin if none."""
        dim = places.shape[-1]
        x = np.concatenate([places[:, list(self.visible)].reshape(-1, dim), self.guides, *self.outlines(places)])
        x = x[np.isfinite(x).all(axis=1)]
        return x if len(x) else np.zeros((1, dim))

    def outlines(self, places: np.ndarray) -> list[np.ndarray]:
        """Find places of what has a size of its own, a length."""
        parts: list[np.ndarray] = []
        for item in self.items:
            if isinstance(item, Circle) and item.radius:
                parts += [places[:, item.at] - item.radius, places[:, item.at] + item.radius]
            elif isinstance(item, Stamp) and any(v[0] for v in item.vertices) and isinstance(item.frame.at, int):
                parts += [item.outline(x, 0.0) for x in places]
        return parts
