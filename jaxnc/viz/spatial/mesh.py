"""Small solids that symbols are made of: convex parts with outward faces, and the edges a draughtsman would show."""

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

Vertex = tuple[float, float, float, float, float, float, float]
"""In a frame: share of its segment's length; lengths along, across and up; units along, across and up."""

Edge = tuple[int, int, int, int, bool]
"""Two vertices, the faces on both sides (-1: none, always shown), and whether it is sharp.

A sharp edge is shown if one of its faces is seen, a smooth one where the outline of the solid runs.
"""


@dataclass(frozen=True)
class Made:
    """Polygons of one piece: vertices, faces (anticlockwise from outside), edges, and the convex part of each.

    Parts are painted one after the other.
    """

    vertices: tuple[Vertex, ...]
    faces: tuple[tuple[int, ...], ...] = ()
    edges: tuple[Edge, ...] = ()
    face_parts: tuple[int, ...] = ()
    edge_parts: tuple[int, ...] = ()


@dataclass(frozen=True)
class Ring:
    """A cross-section of a turned solid."""

    share: float = 0.0  # where, as a share of the frame's segment
    length: float = 0.0  # further along, a length
    units: float = 0.0  # further along, units
    radius: float = 0.0  # a length
    thick: float = 0.0  # added to the radius, units


@dataclass(frozen=True)
class Turned:
    """A solid of revolution about the frame's axis, or a prism; each piece between two rings is a part."""

    rings: tuple[Ring, ...]  # cross-sections in order along the axis
    sides: int = 14  # number of sides
    prism: bool = False  # whether the edges along it are sharp
    caps: bool = True  # whether its ends are closed
    lined: bool = True  # whether the rims of inner rings are drawn

    def made(self) -> Made:
        """Its polygons."""
        sides, prism, caps, rings = self.sides, self.prism, self.caps, self.rings
        vertices: list[Vertex] = []
        turn = [2 * math.pi * (k + (0.5 if prism else 0.0)) / sides for k in range(sides)]
        spread = (
            1.0 / math.cos(math.pi / sides) if prism else 1.0
        )  # a prism's sides, not its corners, are at the radius
        for ring in rings:
            for angle in turn:
                c, s = spread * math.cos(angle), spread * math.sin(angle)
                lengths = (ring.length, ring.radius * c, ring.radius * s)
                vertices.append((ring.share, *lengths, ring.units, ring.thick * c, ring.thick * s))
        faces, parts = [], []
        for part in range(len(rings) - 1):
            a, b = part * sides, (part + 1) * sides
            for k in range(sides):
                n = (k + 1) % sides
                faces.append((a + k, a + n, b + n, b + k))
                parts.append(part)
        edges: list[Edge] = []
        edge_parts = []
        last = len(rings) - 2
        first_cap, last_cap = -1, -1
        if caps:
            first_cap, last_cap = len(faces), len(faces) + 1
            end = (len(rings) - 1) * sides
            faces += [tuple(range(sides - 1, -1, -1)), tuple(range(end, end + sides))]
            parts += [0, last]
        for part in range(last + 1):
            a, b, side = part * sides, (part + 1) * sides, part * sides
            for k in range(sides):
                edges.append((a + k, b + k, side + (k - 1) % sides, side + k, prism))
                edge_parts.append(part)
                n = (k + 1) % sides
                for ring, cap, at in ((a, first_cap, part == 0), (b, last_cap, part == last)):
                    if (at and caps) or (not at and self.lined):
                        edges.append((ring + k, ring + n, side + k, cap if at else side + k, True))
                        edge_parts.append(part)
        return Made(tuple(vertices), tuple(faces), tuple(edges), tuple(parts), tuple(edge_parts))


@dataclass(frozen=True)
class Shell:
    """A thin surface of revolution, seen from outside; every face is a part, so that things can be inside."""

    profile: tuple[tuple[float, float], ...]  # places along the frame's axis and radii, lengths
    sides: int  # number of sides

    def made(self) -> Made:
        """Its polygons."""
        vertices: list[Vertex] = []
        faces, edges, parts = [], [], []
        sides, last = self.sides, len(self.profile) - 1
        for j, (along, radius) in enumerate(self.profile):
            for k in range(sides):
                angle, p, n, face = 2 * math.pi * k / sides, j * sides + k, j * sides + (k + 1) % sides, j * sides + k
                vertices.append((0.0, along, radius * math.cos(angle), radius * math.sin(angle), 0.0, 0.0, 0.0))
                if j < last:
                    faces.append((p, n, n + sides, p + sides))
                    edges.append((p, p + sides, j * sides + (k - 1) % sides, face, False))
                    parts.append(face)
                edges.append((p, n, face - sides if j else -1, face if j < last else -1, j in (0, last)))
                parts.append(face if j < last else face - sides)
        return Made(tuple(vertices), tuple(faces), tuple(edges), tuple(range(len(faces))), tuple(parts))


@dataclass(frozen=True)
class Coil:
    """A spring around the frame's segment, from so many units after its start to so many before its end."""

    turns: int
    radius: float
    start: float
    end: float
    sides: int = 14

    def made(self) -> Made:
        """Its strokes."""
        count, vertices = self.turns * self.sides, []
        for k in range(count + 1):
            angle, share = 2 * math.pi * k / self.sides, k / count
            units = self.start * (1.0 - share) - self.end * share
            vertices.append((share, 0.0, 0.0, 0.0, units, self.radius * math.cos(angle), self.radius * math.sin(angle)))
        edges = tuple((k, k + 1, -1, -1, True) for k in range(count))
        return Made(tuple(vertices), edges=edges, edge_parts=tuple(range(count)))


@dataclass(frozen=True)
class Plain:
    """Faces and strokes, vertex by vertex."""

    vertices: tuple[Vertex, ...]  # its vertices
    faces: tuple[tuple[int, ...], ...] = ()  # indices of the vertices of each face
    strokes: tuple[tuple[int, int], ...] = ()  # pairs of vertices, always shown
    apart: bool = False  # whether each stroke is a part; else all is one

    def made(self) -> Made:
        """Its polygons."""
        edges = tuple((a, b, -1, -1, True) for a, b in self.strokes)
        parts = tuple(range(len(edges))) if self.apart else (0,) * len(edges)
        return Made(self.vertices, self.faces, edges, (0,) * len(self.faces), parts)


Piece = Turned | Shell | Coil | Plain


@dataclass(frozen=True)
class Mesh:
    """A solid as polygons: what its pieces make, their parts kept apart. Pages make them by themselves."""

    pieces: tuple[Piece, ...]

    @cached_property
    def made(self) -> Made:
        """The polygons of all pieces."""
        vertices, faces, edges, face_parts, edge_parts = [], [], [], [], []
        for piece in self.pieces:
            one, v, f = piece.made(), len(vertices), len(faces)
            p = 1 + max([-1, *face_parts, *edge_parts])
            vertices.extend(one.vertices)
            faces.extend(tuple(i + v for i in face) for face in one.faces)
            edges.extend(
                (a + v, b + v, s + f if s >= 0 else -1, t + f if t >= 0 else -1, sharp)
                for a, b, s, t, sharp in one.edges
            )
            face_parts.extend(k + p for k in one.face_parts)
            edge_parts.extend(k + p for k in one.edge_parts)
        return Made(tuple(vertices), tuple(faces), tuple(edges), tuple(face_parts), tuple(edge_parts))

    @cached_property
    def vertices(self) -> np.ndarray:
        """Its vertices, ``(vertices, 7)``."""
        return np.array(self.made.vertices)

    @cached_property
    def parts(self) -> int:
        """How many parts it has."""
        return 1 + max([-1, *self.made.face_parts, *self.made.edge_parts])


def turned(
    rings: tuple[Ring, ...], sides: int = 14, prism: bool = False, caps: bool = True, lined: bool = True
) -> Mesh:
    """A solid of one turned piece."""
    return Mesh((Turned(rings, sides, prism, caps, lined),))


def shell(profile: tuple[tuple[float, float], ...], sides: int) -> Mesh:
    """A thin surface of revolution."""
    return Mesh((Shell(profile, sides),))


def tube(thick: float, pieces: int, sides: int = 10) -> Mesh:
    """A round bar along the frame's segment, in pieces that can be sorted by depth; its ends lie inside a joint."""
    inside = 0.85
    rings = tuple(Ring(share=k / pieces, units=inside * (1 - 2 * k / pieces), thick=thick) for k in range(pieces + 1))
    return turned((Ring(thick=thick), *rings, Ring(share=1.0, thick=thick)), sides, lined=False)


def cylinder(half: float, thick: float, sides: int = 16) -> Mesh:
    """A cylinder about the frame's origin: half length and radius in units."""
    return turned((Ring(units=-half, thick=thick), Ring(units=half, thick=thick)), sides)


def block(half: float, thick: float) -> Mesh:
    """A square block about the frame's origin: half length and half width in units."""
    return turned((Ring(units=-half, thick=thick), Ring(units=half, thick=thick)), 4, prism=True)


def disc(radius: float, half: float, sides: int = 40) -> Mesh:
    """A wheel about the frame's origin: its radius is a length, its half width in units."""
    return turned((Ring(units=-half, radius=radius), Ring(units=half, radius=radius)), sides)


def arrow(length: float, shaft: float, head: float, start: float = 0.0, further: float = 0.0, sides: int = 10) -> Mesh:
    """An arrow of a length in units along the frame's axis, from `start` units and a length `further` along."""
    neck = start + length - 2.6 * head
    rings = tuple(Ring(length=further, units=u, thick=shaft) for u in (start, 0.5 * (start + neck), neck))
    point = Ring(length=further, units=start + length, thick=0.02)
    tip = turned((Ring(length=further, units=neck, thick=head), point), sides, lined=False)
    return joined(turned(rings, sides, lined=False), tip)


def reach(shaft: float, head: float, sides: int = 8) -> Mesh:
    """An arrow over the whole of the frame's segment."""
    back = -2.6 * head
    rings = tuple(Ring(share=s, units=back if s == 1.0 else 0.0, thick=shaft) for s in (0.0, 0.25, 0.5, 0.75, 1.0))
    tip = turned((Ring(share=1.0, units=back, thick=head), Ring(share=1.0, thick=0.02)), sides, lined=False)
    return joined(turned(rings, sides, lined=False), tip)


def web(corners: tuple[tuple[float, float, float], ...]) -> Mesh:
    """A flat polygon seen from both sides: corners in units along, across and up."""
    return sheet(tuple((0.0, 0.0, 0.0, 0.0, *c) for c in corners))


def sheet(corners: tuple[Vertex, ...], lined: bool = True) -> Mesh:
    """A flat polygon seen from both sides."""
    around = tuple(range(len(corners)))
    strokes = tuple((k, (k + 1) % len(corners)) for k in around) if lined else ()
    return Mesh((Plain(corners, (around, around[::-1]), strokes),))


def line(pieces: int) -> Mesh:
    """A line along the frame's segment, in pieces."""
    ends: list[Vertex] = [(k / pieces, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) for k in range(pieces + 1)]
    return lines(list(itertools.pairwise(ends)))


def dashes(count: int) -> Mesh:
    """A dashed line along the frame's segment."""
    ends: list[Vertex] = [(k / (3 * count - 1), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) for k in range(3 * count)]
    return lines(list(zip(ends[::3], ends[2::3], strict=True)))


def coil(turns: int, radius: float, start: float, end: float) -> Mesh:
    """A spring around the frame's segment."""
    return Mesh((Coil(turns, radius, start, end),))


def lines(pairs: list[tuple[Vertex, Vertex]]) -> Mesh:
    """Strokes, each a part."""
    vertices = tuple(v for pair in pairs for v in pair)
    return Mesh((Plain(vertices, (), tuple((2 * k, 2 * k + 1) for k in range(len(pairs))), True),))


def in_units(start: tuple[float, float, float], end: tuple[float, float, float]) -> tuple[Vertex, Vertex]:
    """The ends of a stroke, given in units along, across and up."""
    return (0.0, 0.0, 0.0, 0.0, *start), (0.0, 0.0, 0.0, 0.0, *end)


def joined(*meshes: Mesh) -> Mesh:
    """Several meshes as one, their parts kept apart."""
    return Mesh(tuple(piece for mesh in meshes for piece in mesh.pieces))


def stand(height: float, wide: float) -> Mesh:
    """The ground's symbol below the frame's origin, its axis pointing up: a pyramid on a hatched slab."""
    foot = turned((Ring(units=-height, thick=wide), Ring(units=-0.2, thick=0.12)), 4, prism=True)
    slab = turned(
        (Ring(units=-height - 0.45, thick=1.45 * wide), Ring(units=-height, thick=1.45 * wide)), 4, prism=True
    )
    pairs, edge, low = [], 1.45 * wide, -height - 0.45
    for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        for k in range(5):
            t = edge * (-1.0 + (k + 0.9) * 0.4)
            start = (low, edge * x - t * y, edge * y + t * x)
            end = (low - 0.9, edge * x - (t - 0.7) * y, edge * y + (t - 0.7) * x)
            pairs.append(in_units(start, end))
    return joined(foot, slab, lines(pairs))
