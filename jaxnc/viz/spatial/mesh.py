"""Small solids that symbols are made of: convex parts with outward faces, and the edges a draughtsman would show."""

import dataclasses
import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

PARTS = 8
"""Of a bar or rod, sorted by depth each on its own."""

Vertex = tuple[float, float, float, float, float, float, float]
"""In a frame: share of its segment's length; lengths along, across and up; units along, across and up."""

Edge = tuple[int, int, int, int, bool]
"""Two vertices, the faces on both sides (-1: none, always shown), and whether it is sharp.

A sharp edge is shown if one of its faces is seen, a smooth one where the outline of the solid runs.
"""


class Polygons:
    """Polygons of a solid: vertices, faces (anticlockwise from outside), edges, and the convex part of each.

    Parts are painted one after the other. A piece counts its vertices, faces and parts from 0.
    """

    def __init__(self, pieces: "tuple[Piece, ...]"):
        self.vertices: list[Vertex] = []
        self.faces: list[tuple[int, ...]] = []
        self.edges: list[Edge] = []
        self.face_parts: list[int] = []
        self.edge_parts: list[int] = []
        for piece in pieces:
            self._first = len(self.vertices), len(self.faces), self.parts
            piece.build(self)

    @property
    def parts(self) -> int:
        """How many parts there are."""
        return 1 + max([-1, *self.face_parts, *self.edge_parts])

    def face(self, part: int, corners: Iterable[int]) -> None:
        """Add a face."""
        vertex, _, first = self._first
        self.faces.append(tuple(i + vertex for i in corners))
        self.face_parts.append(part + first)

    def edge(self, part: int, a: int, b: int, left: int = -1, right: int = -1, sharp: bool = True) -> None:
        """Add an edge between two vertices, with the faces beside it, if any."""
        vertex, face, first = self._first
        left, right = (side + face if side >= 0 else -1 for side in (left, right))
        self.edges.append((a + vertex, b + vertex, left, right, sharp))
        self.edge_parts.append(part + first)


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

    def build(self, to: Polygons) -> None:
        """Add its polygons."""
        sides, prism, last = self.sides, self.prism, len(self.rings) - 2
        # A prism's sides, not its corners, are at the radius.
        spread = 1.0 / math.cos(math.pi / sides) if prism else 1.0
        for ring in self.rings:
            for k in range(sides):
                angle = 2 * math.pi * (k + (0.5 if prism else 0.0)) / sides
                c, s = spread * math.cos(angle), spread * math.sin(angle)
                lengths = (ring.length, ring.radius * c, ring.radius * s)
                to.vertices.append((ring.share, *lengths, ring.units, ring.thick * c, ring.thick * s))
        for part in range(last + 1):
            a, b = part * sides, (part + 1) * sides
            for k in range(sides):
                n = (k + 1) % sides
                to.face(part, (a + k, a + n, b + n, b + k))
        end = (last + 1) * sides
        if self.caps:
            to.face(0, range(sides - 1, -1, -1))
            to.face(last, range(end, end + sides))
        for part in range(last + 1):
            a, b = part * sides, (part + 1) * sides
            for k in range(sides):
                n = (k + 1) % sides
                to.edge(part, a + k, b + k, a + (k - 1) % sides, a + k, prism)
                for ring, cap, ends in ((a, end, part == 0), (b, end + 1, part == last)):
                    if self.caps if ends else self.lined:
                        to.edge(part, ring + k, ring + n, a + k, cap if ends else a + k)


@dataclass(frozen=True)
class Shell:
    """A thin surface of revolution, seen from outside; every face is a part, so that things can be inside."""

    profile: tuple[tuple[float, float], ...]  # places along the frame's axis and radii, lengths
    sides: int  # number of sides

    def build(self, to: Polygons) -> None:
        """Add its polygons."""
        sides, last = self.sides, len(self.profile) - 1
        for j, (along, radius) in enumerate(self.profile):
            for k in range(sides):
                angle, p, n = 2 * math.pi * k / sides, j * sides + k, j * sides + (k + 1) % sides
                to.vertices.append((0.0, along, radius * math.cos(angle), radius * math.sin(angle), 0.0, 0.0, 0.0))
                if j < last:
                    to.face(p, (p, n, n + sides, p + sides))
                    to.edge(p, p, p + sides, j * sides + (k - 1) % sides, p, False)
                inner, outer = (p - sides if j else -1), (p if j < last else -1)
                to.edge(p if j < last else p - sides, p, n, inner, outer, j in (0, last))


@dataclass(frozen=True)
class Coil:
    """A spring around the frame's segment, from so many units after its start to so many before its end."""

    turns: int
    radius: float
    start: float
    end: float
    sides: int = 14

    def build(self, to: Polygons) -> None:
        """Add its strokes."""
        count = self.turns * self.sides
        for k in range(count + 1):
            angle, share = 2 * math.pi * k / self.sides, k / count
            units = self.start * (1.0 - share) - self.end * share
            across = self.radius * math.cos(angle), self.radius * math.sin(angle)
            to.vertices.append((share, 0.0, 0.0, 0.0, units, *across))
        for k in range(count):
            to.edge(k, k, k + 1)


@dataclass(frozen=True)
class Plain:
    """Faces and strokes, vertex by vertex."""

    vertices: tuple[Vertex, ...]  # its vertices
    faces: tuple[tuple[int, ...], ...] = ()  # indices of the vertices of each face
    strokes: tuple[tuple[int, int], ...] = ()  # pairs of vertices, always shown
    apart: bool = False  # whether each stroke is a part; else all is one

    def build(self, to: Polygons) -> None:
        """Add its polygons."""
        to.vertices += self.vertices
        for face in self.faces:
            to.face(0, face)
        for k, (a, b) in enumerate(self.strokes):
            to.edge(k if self.apart else 0, a, b)


Piece = Turned | Shell | Coil | Plain


@dataclass(frozen=True)
class Mesh:
    """A solid as polygons: what its pieces make, their parts kept apart. Pages make them by themselves."""

    pieces: tuple[Piece, ...]

    @cached_property
    def polygons(self) -> Polygons:
        """The polygons of all pieces."""
        return Polygons(self.pieces)

    @cached_property
    def vertices(self) -> np.ndarray:
        """Its vertices, ``(vertices, 7)``."""
        return np.array(self.polygons.vertices)


def revolve(rings: tuple[Ring, ...], sides: int = 14, prism: bool = False, lined: bool = True) -> Mesh:
    """Make a solid of one turned piece."""
    return Mesh((Turned(rings, sides, prism, lined=lined),))


def _divide(start: Ring, end: Ring, parts: int) -> tuple[Ring, ...]:
    """Divide the way from one cross-section to another into parts."""
    a, b = np.array(dataclasses.astuple(start)), np.array(dataclasses.astuple(end))
    return tuple(Ring(*(a + (b - a) * k / parts).tolist()) for k in range(parts + 1))


def rod(start: Ring, end: Ring, parts: int = PARTS, sides: int = 8) -> Mesh:
    """Make a round rod from one cross-section to another, in parts to be sorted by depth."""
    return revolve(_divide(start, end, parts), sides, lined=False)


def tube(thick: float, pieces: int, sides: int = 10) -> Mesh:
    """Make a round bar along the frame's segment, in pieces to be sorted by depth; its ends lie inside a joint."""
    inside = 0.85
    rings = _divide(Ring(units=inside, thick=thick), Ring(share=1.0, units=-inside, thick=thick), pieces)
    return revolve((Ring(thick=thick), *rings, Ring(share=1.0, thick=thick)), sides, lined=False)


def drum(low: float, high: float, thick: float, sides: int = 16, share: float = 0.0, prism: bool = False) -> Mesh:
    """Make a cylinder, or a prism, about a place of the frame's segment, from `low` to `high` units beside it."""
    return revolve(tuple(Ring(share=share, units=u, thick=thick) for u in (low, high)), sides, prism)


def arrow(length: float, shaft: float, head: float, start: float = 0.0, further: float = 0.0, sides: int = 10) -> Mesh:
    """Make an arrow of a length in units along the frame's axis, from `start` units and a length `further` along."""
    neck = Ring(length=further, units=start + length - 2.6 * head, thick=shaft)
    rings = _divide(Ring(length=further, units=start, thick=shaft), neck, 2)
    return _shaft_and_head(rings, head, Ring(length=further, units=start + length, thick=0.02), sides)


def reach(shaft: float, head: float, sides: int = 8) -> Mesh:
    """Make an arrow over the whole of the frame's segment."""
    neck = Ring(share=1.0, units=-2.6 * head, thick=shaft)
    rings = (*_divide(Ring(thick=shaft), Ring(share=1.0, thick=shaft), 4)[:-1], neck)
    return _shaft_and_head(rings, head, Ring(share=1.0, thick=0.02), sides)


def _shaft_and_head(rings: tuple[Ring, ...], head: float, point: Ring, sides: int) -> Mesh:
    """Make a shaft, and a head from where it ends to a point."""
    tip = revolve((dataclasses.replace(rings[-1], thick=head), point), sides, lined=False)
    return join(revolve(rings, sides, lined=False), tip)


def two_sided(corners: tuple[Vertex, ...], lined: bool = True) -> Mesh:
    """Make a flat polygon seen from both sides."""
    around = tuple(range(len(corners)))
    strokes = tuple((k, (k + 1) % len(corners)) for k in around) if lined else ()
    return Mesh((Plain(corners, (around, around[::-1]), strokes),))


def line(pieces: int, start: float = 0.0, end: float = 1.0) -> Mesh:
    """Make a line along the frame's segment, or a share of it, in pieces."""
    ends: list[Vertex] = [(start + (end - start) * k / pieces, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) for k in range(pieces + 1)]
    return lines(list(itertools.pairwise(ends)))


def dashes(count: int) -> Mesh:
    """Make a dashed line along the frame's segment."""
    ends: list[Vertex] = [(k / (3 * count - 1), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) for k in range(3 * count)]
    return lines(list(zip(ends[::3], ends[2::3], strict=True)))


def lines(pairs: list[tuple[Vertex, Vertex]]) -> Mesh:
    """Make strokes, each a part."""
    vertices = tuple(v for pair in pairs for v in pair)
    return Mesh((Plain(vertices, (), tuple((2 * k, 2 * k + 1) for k in range(len(pairs))), True),))


def in_units(along: float, across: float, up: float) -> Vertex:
    """Make a vertex beside the frame's origin."""
    return (0.0, 0.0, 0.0, 0.0, along, across, up)


def join(*meshes: Mesh) -> Mesh:
    """Join several meshes to one, their parts kept apart."""
    return Mesh(tuple(piece for mesh in meshes for piece in mesh.pieces))


def stand(height: float, wide: float) -> Mesh:
    """Make the ground's symbol below the frame's origin, its axis pointing up: a pyramid on a hatched slab."""
    foot = revolve((Ring(units=-height, thick=wide), Ring(units=-0.2, thick=0.12)), 4, prism=True)
    pairs, edge, low = [], 1.45 * wide, -height - 0.45
    slab = drum(low, -height, edge, 4, prism=True)
    for x, y in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        for k in range(5):
            t = edge * (-1.0 + (k + 0.9) * 0.4)
            start = (low, edge * x - t * y, edge * y + t * x)
            end = (low - 0.9, edge * x - (t - 0.7) * y, edge * y + (t - 0.7) * x)
            pairs.append((in_units(*start), in_units(*end)))
    return join(foot, slab, lines(pairs))
