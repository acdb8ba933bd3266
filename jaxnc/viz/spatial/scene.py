"""Items of a drawing in space, the same for figures and pages: solids in frames, plates, balls, arrows of angles.

A *column* is a place or a direction in a pose: points and markers first, then unit vectors, then the tips of arrows.
Lengths are those of the mechanism; symbols are sized in units (one unit is the radius of a joint).

A scene in a pose becomes flat polygons, far to near: outlines, shading and order, with no library of pictures.
"""

import math
from dataclasses import dataclass

import numpy as np

from jaxnc.viz.poses import evenly
from jaxnc.viz.scene import Item, Scene, shown_angle
from jaxnc.viz.spatial.mesh import Mesh, Plain, Polygons, Shell
from jaxnc.viz.style import INK, Style, colour_of


@dataclass(frozen=True)
class Way:
    """A direction: of the segment between two columns, of one column that is a direction, or a fixed one."""

    columns: tuple[int, ...] = ()
    fixed: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def vector(self, pose: np.ndarray) -> np.ndarray:
        """Find the direction in poses ``(..., columns, 3)``, not normalised, ``(..., 3)``."""
        if not self.columns:
            return np.broadcast_to(np.array(self.fixed), (*pose.shape[:-2], 3))
        if len(self.columns) == 1:
            return pose[..., self.columns[0], :]
        return pose[..., self.columns[1], :] - pose[..., self.columns[0], :]


@dataclass(frozen=True)
class SpaceFrame:
    """Where a solid stands."""

    at: int | tuple[float, float, float]  # a column, or a fixed place
    along: Way  # its axis; of a segment, vertices may be given as shares of it
    side: Way | None = None  # the direction that its second axis leans to; any, if not given

    def stand(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Find origin ``(3,)``, axes as rows ``(3, 3)`` and length of the segment, in a pose ``(columns, 3)``."""
        origin = pose[self.at] if isinstance(self.at, int) else np.array(self.at)
        d = self.along.vector(pose)
        span = float(np.linalg.norm(d))
        e = d / span if span > 0 else np.array([1.0, 0.0, 0.0])
        n = np.zeros(3)
        if self.side is not None:
            n = self.side.vector(pose)
            n = n - (n @ e) * e
        size = float(np.linalg.norm(n))
        if not size > 1e-6:
            n = np.eye(3)[int(np.argmin(np.abs(e)))]
            n = n - (n @ e) * e
            size = float(np.linalg.norm(n))
        n = n / size
        return origin, np.stack([e, n, np.cross(e, n)]), span


@dataclass(frozen=True)
class SpaceItem(Item):
    """A thing in a drawing: its role gives the style, `body` the colour."""

    @property
    def style(self) -> Style:
        """Look of its role."""
        return SOLIDS[self.role]


@dataclass(frozen=True)
class Solid(SpaceItem):
    """A mesh in a frame."""

    frame: SpaceFrame
    mesh: Mesh

    def vertices(self, pose: np.ndarray, unit: float) -> np.ndarray:
        """Find the vertices in a pose, ``(vertices, 3)``; NaN for a segment that has no length."""
        origin, axes, span = self.frame.stand(pose)
        v = self.mesh.vertices
        if span <= 0 and v[:, 0].any():
            return np.full((len(v), 3), np.nan)
        local = v[:, 1:4] + unit * v[:, 4:7]
        local[:, 0] += span * v[:, 0]
        return origin + local @ axes


def segment(role: str, a: int, b: int, mesh: Mesh, body: int = INK) -> Solid:
    """Put a mesh along the segment between two columns."""
    return Solid(role, SpaceFrame(a, Way((a, b))), mesh, body=body)


@dataclass(frozen=True)
class Plate(SpaceItem):
    """Translucent faces between columns."""

    faces: tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class Ball(SpaceItem):
    """A sphere at a column, its radius in units."""

    at: int
    units: float


@dataclass(frozen=True)
class Turn(SpaceItem):
    """The arrow of a driven angle about an axis."""

    at: int  # column of the vertex
    axis: Way  # the axis
    to: Way  # the direction it goes to
    scalar: int  # index of the angle
    units: float  # radius, units
    text: str  # its name
    low: float = 0.0  # the least angle that is drawn, radians, see `least_angle`
    dx: float = 0.0  # from where its name belongs to the right, units
    dy: float = 0.0  # and upwards

    def _around(self, pose: np.ndarray, turn: np.ndarray, radius: float) -> np.ndarray:
        _, axes, _ = SpaceFrame(self.at, self.axis, self.to).stand(pose)
        return pose[self.at] + radius * (np.cos(turn)[:, None] * axes[1] + np.sin(turn)[:, None] * axes[2])

    def curve(self, pose: np.ndarray, value: float, unit: float, count: int = 33) -> np.ndarray:
        """Find the places along the arrow, ``(count, 3)``: it ends at the direction, and begins the angle before it."""
        return self._around(pose, np.linspace(-shown_angle(value, self.low), 0.0, count), self.units * unit)

    def spot(self, pose: np.ndarray, value: float, unit: float) -> np.ndarray:
        """Find where its name belongs, ``(3,)``: in the middle of the angle, beside it if that is small."""
        shown = shown_angle(value, self.low)
        aside = math.copysign(0.5 * max(0.0, 1.0 - abs(shown) / 0.9), shown)
        return self._around(pose, np.array([-0.5 * shown - aside]), (self.units + 1.9) * unit)[0]


@dataclass(frozen=True)
class SpaceScene(Scene):
    """A whole drawing, for any pose; its items are sorted by depth."""

    links: tuple[tuple[int, int], ...]  # pairs of columns between which there is something, for choosing a view
    arrows: tuple[tuple[int, ...], ...]  # the point and the direction of every unit vector that is shown, likewise

    def outlines(self, places: np.ndarray) -> list[np.ndarray]:
        """Find places of what has a size of its own, a length, in some of the poses: the columns are there in all."""
        solids = [item for item in self.items if isinstance(item, Solid) and item.mesh.vertices[:, 1:4].any()]
        some = evenly(places, 32)
        return [
            item.vertices(x, 0.0)[:: 5 if isinstance(item.mesh.pieces[0], Shell) else 1]
            for item in solids
            for x in some
        ]


SOLIDS = {
    "hatch": Style("soft", 0.16, fixed=True),
    "support": Style("ink", 0.2, "paper", fixed=True),
    "guide": Style("ink", 0.3, fixed=True),
    "rail": Style("ink", 0.18, "soft", fixed=True),
    "centre line": Style("soft", 0.2),
    "reference": Style("soft", 0.16),
    "distance": Style("soft", 0.2),
    "spring": Style("ink", 0.42, layer=1),
    "dashpot": Style("ink", 0.36, layer=1),
    "torque": Style("applied", 0.4, "applied", layer=1),
    "mass": Style("", 0.0, "paper", layer=3),
    "dark mass": Style("", 0.0, "ink", layer=3),
    "arc": Style("soft", 0.24, "soft"),
    "cable": Style("ink", 0.24),
    "trace": Style("body", 0.26, layer=-2),  # behind what it touches
    "screw": Style("body", 0.4),
    "ruling": Style("tint", 0.16),
    "rim": Style("body", 0.2),
    "wheel": Style("shade", 0.2, "body", 0.5),
    "tyre": Style("soft", 0.14, "soft", 0.18),
    "road": Style("soft", 0.12, "soft", 0.12),
    "plate": Style("", 0.0, "body", 0.26),
    "web": Style("shade", 0.1, "body", 0.26),
    "edge": Style("shade", 0.1, "body"),
    "bar": Style("shade", 0.14, "body"),
    "rod": Style("ink", 0.16, "soft"),
    "block": Style("ink", 0.22, "tint", layer=1),
    "hinge": Style("ink", 0.22, "paper", layer=1),
    "ground hinge": Style("ink", 0.22, "paper", layer=1, fixed=True),
    "cross": Style("ink", 0.2, "tint", layer=1),
    "ball": Style("ink", 0.24, "paper", layer=1),
    "ground ball": Style("ink", 0.24, "paper", layer=1, fixed=True),
    "dot": Style("shade", 0.16, "body", layer=1),
    "axis": Style("shade", 0.1, "body"),
    "ground axis": Style("", 0.1, "ink", fixed=True),
    "marker": Style("ink", 0.24, layer=1),
    **{noun: Style("", 0.0, noun) for noun in ("velocity", "acceleration", "weight", "applied", "reaction")},
}
"""Style of every role. The layer brings it nearer to the viewer when things are sorted, units; the stroke ``"shade"``
is the fill, darker."""


# -- flat polygons, far to near ----------------------------------------------------------------------------------------


LIGHT_FROM = np.array([-0.38, 0.62, 0.69])
"""Where the light comes from: right, up, towards the viewer."""

_BALL = 32  # corners of a ball's outline
_TURN = 33  # places along the arrow of an angle


class Painter:
    """A scene, prepared: which vertices make which face and line, with their colours.

    All roles are painted, or `only` some. Of each path there are the places it runs through ``(T, 3)``, its colour,
    dashes or not, and its role.
    """

    def __init__(self, scene: SpaceScene, only: tuple[str, ...] | None = None, traces: tuple = ()):
        items = [item for item in scene.items if only is None or item.role in only]
        self.solids = [item for item in items if isinstance(item, Solid)]
        self.plates = [item for item in items if isinstance(item, Plate)]
        self.balls = [item for item in items if isinstance(item, Ball)]
        self.turns = [item for item in items if isinstance(item, Turn)]
        self.traces = traces
        self.columns = max([len(scene.bodies), *(1 + p for plate in self.plates for face in plate.faces for p in face)])
        self._prepare()

    def _prepare(self) -> None:
        """Lay all faces and lines out as arrays of indices into one array of vertices, with their colours."""
        faces: list[tuple[int, ...]] = []
        face_rows: list[tuple[int, int, bool]] = []  # part, look, whether it is seen from both sides
        edges: list[tuple[int, int, int, int, bool]] = []
        edge_rows: list[tuple[int, int]] = []
        looks: dict[tuple[str, int], int] = {}  # roles of bodies, numbered
        self.parts, first = 0, self.columns

        def look_of(role: str, body: int = INK) -> int:
            return looks.setdefault((role, body), len(looks))

        def add(mesh: Polygons, look: int, both: bool, first: int) -> None:
            base = len(faces)
            faces.extend(tuple(i + first for i in face) for face in mesh.faces)
            face_rows.extend((self.parts + k, look, both) for k in mesh.face_parts)
            for a, b, f, g, sharp in mesh.edges:
                sides = (base + f if f >= 0 else -1, base + g if g >= 0 else -1)
                edges.append((a + first, b + first, *sides, sharp))
            edge_rows.extend((self.parts + k, look) for k in mesh.edge_parts)
            self.parts += mesh.parts

        def add_lines(pairs: list[tuple[int, int]], look: int, first: int) -> None:
            edges.extend((a + first, b + first, -1, -1, True) for a, b in pairs)
            edge_rows.extend((self.parts + k, look) for k in range(len(pairs)))
            self.parts += len(pairs)

        for plate in self.plates:
            add(Polygons(tuple(Plain((), (face,)) for face in plate.faces)), look_of(plate.role, plate.body), True, 0)
        for solid in self.solids:
            add(solid.mesh.polygons, look_of(solid.role, solid.body), False, first)
            first += len(solid.mesh.vertices)
        for turn in self.turns:
            look, head = look_of(turn.role, turn.body), first + _TURN
            add_lines([(k, k + 1) for k in range(_TURN - 3)], look, first)
            add_lines([(3, 4)], look_of("reference"), head)
            add(Polygons((Plain((), ((0, 1, 2),)),)), look, True, head)
            first = head + 5
        for x, body, dashes, role in self.traces:
            drawn = [(k, k + 1) for k in range(len(x) - 1) if not dashes or k % dashes < dashes - dashes // 3]
            add_lines(drawn, look_of(role, body), first)
            first += len(x)
        self.ball_look = [look_of(ball.role, ball.body) for ball in self.balls]

        styles = [(SOLIDS[role], body) for role, body in looks]
        fills = [rgba(style.fill, body, style.opacity) for style, body in styles]
        strokes = [
            (*(0.62 * c for c in fill[:3]), 1.0) if style.stroke == "shade" else rgba(style.stroke, body)
            for (style, body), fill in zip(styles, fills, strict=True)
        ]
        self.fills, self.strokes = (np.array(colours, dtype=float).reshape(-1, 4) for colours in (fills, strokes))
        self.line_widths = np.array([style.width for style, _ in styles])
        self.layers = np.array([style.layer for style, _ in styles], dtype=float)
        self.fixed = np.array([style.fixed for style, _ in styles], dtype=bool)
        self.width = max([3, *(len(f) for f in faces)])
        self.faces = np.array([f + (f[-1],) * (self.width - len(f)) for f in faces], dtype=int).reshape(-1, self.width)
        self.face_part = np.array([part for part, *_ in face_rows], dtype=int)
        self.both = np.array([both for *_, both in face_rows], dtype=bool)
        self.edges = np.array([edge[:4] for edge in edges], dtype=int).reshape(-1, 4)
        self.sharp = np.array([edge[4] for edge in edges], dtype=bool)
        self.edge_part = np.array([part for part, _ in edge_rows], dtype=int)
        self.face_look = np.array([look for _, look, _ in face_rows], dtype=int)
        self.edge_look = np.array([look for _, look in edge_rows], dtype=int)
        self.layer = np.zeros(self.parts)
        self.layer[self.face_part] = self.layers[self.face_look]
        self.layer[self.edge_part] = self.layers[self.edge_look]

    def vertices(self, pose: np.ndarray, scalars: np.ndarray, unit: float) -> np.ndarray:
        """Find all vertices of a pose, ``(vertices, 3)``."""
        parts = [pose[: self.columns], *(solid.vertices(pose, unit) for solid in self.solids)]
        for turn in self.turns:
            curve = turn.curve(pose, float(scalars[turn.scalar]), unit, _TURN)
            tip, back = curve[-1], curve[-4]
            out = (back - pose[turn.at]) / turn.units * 0.55
            zero = 1.35 * (curve[0] - pose[turn.at])  # from where it is counted
            parts += [curve, np.stack([tip, back + out, back - out, pose[turn.at] + 0.2 * zero, pose[turn.at] + zero])]
        parts += [x for x, *_ in self.traces]
        return np.concatenate(parts)

    def paint(
        self, vertices: np.ndarray, pose: np.ndarray, project, unit: float, faded: float = 1.0
    ) -> tuple[np.ndarray, ...]:
        """Lay out the polygons of one pose in the order in which they are painted.

        Args:
            vertices: of the pose, from `vertices`.
            pose: ``(columns, 3)``.
            project: from places ``(n, 3)`` to the picture ``(n, 2)``, nearness ``(n,)`` as a length, and the axes of
                the picture as rows ``(3, 3)``; lengths per unit of the picture last.
            unit: length of a unit.
            faded: opacity of what moves.

        Returns:
            Corners ``(polygons, corners, 2)``, where shorter polygons repeat their last one and a line has two; red,
            green, blue and opacity of the areas, and of the lines around them, each ``(polygons, 4)``; the widths of
            these lines, units.
        """
        flat, near, axes, scale = project(vertices)
        corners = flat[self.faces]
        count = len(self.faces)
        nxt = np.roll(corners, -1, axis=1)
        area = (corners[..., 0] * nxt[..., 1] - corners[..., 1] * nxt[..., 0]).sum(axis=1)
        front = area > 0
        solid = vertices[self.faces]
        normal = np.cross(solid, np.roll(solid, -1, axis=1)).sum(axis=1) if count else np.zeros((0, 3))
        normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        light = normal @ (axes.T @ LIGHT_FROM)
        light = np.where(self.both, np.abs(light), light)
        face_colour = shade(self.fills[self.face_look], light)
        # Parts are sorted by the depth of their middle; a ball is a part of its own.
        total, number = np.zeros(self.parts), np.zeros(self.parts)
        mean = near[self.faces].mean(axis=1)
        np.add.at(total, self.face_part, mean)
        np.add.at(number, self.face_part, 1.0)
        bare = number == 0
        lines = near[self.edges[:, :2]].mean(axis=1)
        chosen = bare[self.edge_part]
        np.add.at(total, self.edge_part[chosen], lines[chosen])
        np.add.at(number, self.edge_part[chosen], 1.0)
        depth = total / np.maximum(number, 1.0) + 0.9 * unit * self.layer
        seen = (front | self.both) & np.isfinite(area)
        sides = np.concatenate([front, [True]])[self.edges[:, 2:]]
        shown = np.where(self.sharp, sides.any(axis=1), sides[:, 0] != sides[:, 1])
        shown &= np.isfinite(flat[self.edges[:, :2]]).all(axis=(1, 2))
        strokes = np.repeat(flat[self.edges[shown, 1]][:, None], self.width, axis=1)
        strokes[:, 0] = flat[self.edges[shown, 0]]
        rounds, round_faces, round_edges, round_widths, round_depth = self._balls(pose, project, unit, scale, faded)
        dim = np.where(self.fixed, 1.0, faded)
        face_look, edge_look = self.face_look[seen], self.edge_look[shown]
        face_colour, rim = face_colour[seen], self.strokes[edge_look]
        face_colour[:, 3] *= dim[face_look]
        rim[:, 3] *= dim[edge_look]
        own = face_colour.copy()  # a hairline of its own colour closes the seam between two faces
        own[face_colour[:, 3] < 1.0] = 0.0
        width = max(self.width, _BALL if len(rounds) else 0)
        every = (corners[seen], strokes, rounds)
        everything = [np.pad(x, ((0, 0), (0, width - x.shape[1]), (0, 0)), mode="edge") for x in every]
        order_depth = np.concatenate([depth[self.face_part[seen]], depth[self.edge_part[shown]], round_depth])
        kind = np.concatenate([np.zeros(seen.sum()), np.ones(shown.sum()), np.tile([0.0, 1.0], len(rounds) // 2)])
        order = np.lexsort([kind, order_depth])
        return (
            np.concatenate(everything)[order],
            np.concatenate([face_colour, np.zeros((shown.sum(), 4)), round_faces])[order],
            np.concatenate([own, rim, round_edges])[order],
            np.concatenate([np.full(seen.sum(), 0.06), self.line_widths[edge_look], round_widths])[order],
        )

    def _balls(self, pose: np.ndarray, project, unit: float, scale: float, faded: float) -> tuple[np.ndarray, ...]:
        """Make two discs for each ball: itself, and a light on it."""
        if not self.balls:
            return np.zeros((0, 1, 2)), np.zeros((0, 4)), np.zeros((0, 4)), np.zeros(0), np.zeros(0)
        centre, near, _, _ = project(pose[[ball.at for ball in self.balls]])
        radius = np.array([ball.units for ball in self.balls]) * unit / scale
        turn = 2 * np.pi * np.arange(_BALL) / _BALL
        rim = np.stack([np.cos(turn), np.sin(turn)], axis=1)
        body = centre[:, None] + radius[:, None, None] * rim
        spot = centre[:, None] + radius[:, None, None] * (0.42 * rim + 0.36 * LIGHT_FROM[:2])
        fill, stroke = self.fills[self.ball_look], self.strokes[self.ball_look]
        widths, dim = self.line_widths[self.ball_look], np.where(self.fixed[self.ball_look], 1.0, faded)
        base, glow = shade(fill, np.full(len(fill), 0.25)), shade(fill, np.full(len(fill), 1.0))
        for colour in (base, glow, stroke):
            colour[:, 3] *= dim
        depth = near + unit * 0.9 * self.layers[self.ball_look]

        def both(x: np.ndarray, y: np.ndarray) -> np.ndarray:
            return np.stack([x, y], axis=1).reshape(-1, *x.shape[1:])

        twice = both(base, glow), both(stroke, 0.0 * stroke), both(widths, 0.0 * widths)
        return both(body, spot), *twice, np.repeat(depth, 2)


def rgba(name: str, body: int, opacity: float = 1.0) -> tuple[float, ...]:
    """Read a colour by name as red, green, blue and opacity from 0 to 1; nothing for no name."""
    if not name:
        return (0.0, 0.0, 0.0, 0.0)
    text = colour_of(name, body)
    return (*(int(text[i : i + 2], 16) / 255.0 for i in (1, 3, 5)), opacity)


def shade(colour: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Colours ``(n, 4)`` in a light from -1 to 1: darker or lighter than themselves."""
    out = colour.copy()
    dark = np.clip((0.55 - light) * 0.30, 0.0, 0.40)[:, None]
    bright = np.clip((light - 0.55) * 0.55, 0.0, 0.28)[:, None]
    out[:, :3] = out[:, :3] * (1.0 - dark)
    out[:, :3] += (1.0 - out[:, :3]) * bright
    return out
