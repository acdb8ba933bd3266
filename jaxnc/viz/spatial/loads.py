"""Symbols between points that no body joins, and of forces: springs, dampers, cylinders, stops, torques, masses."""

import itertools
import math

import numpy as np

from jaxnc.viz.scene import Label
from jaxnc.viz.spatial.joints import ROD, Joints, RowReading, read_rows
from jaxnc.viz.spatial.mesh import PARTS, Mesh, Plain, Ring, Vertex, coil, dashes, join, lines, revolve, two_sided
from jaxnc.viz.spatial.scene import Solid, SpaceFrame, SpaceItem, Way
from jaxnc.viz.style import symbol

_HALF = 0.55  # of a telescope, covered by its barrel
_FINE = 12  # the same of a barrel or a rod with a spring around it
_LIFT = 2.6  # from the middle of a hinge to what turns about its axis, units
_SEAT = 1.9  # radius of the plate that a spring rests on, units


# -- solids -----------------------------------------------------------------------------------------------------------


def _rod(start: float, end: float, thick: float, sides: int = 8, parts: int = PARTS) -> Mesh:
    """Make a round rod over a share of the frame's segment."""
    rings = tuple(Ring(share=start + (end - start) * k / parts, thick=thick) for k in range(parts + 1))
    return revolve(rings, sides, lined=False)


def _barrel(thick: float, seat: float = 0.0) -> Mesh:
    """Make the outer part of a telescope, from its ball to its middle; with the plate that a spring rests on."""
    count = _FINE if seat else 3
    parts = [k / count for k in range(count + 1)]
    rings = tuple(Ring(share=_HALF * t, units=0.9 * (1.0 - t), thick=thick) for t in parts)
    tube = revolve(rings, 14, lined=False)
    if not seat:
        return tube
    return join(tube, revolve((Ring(units=2.2, thick=seat), Ring(units=2.6, thick=seat)), 16))


def _piston(thick: float, seat: float = 0.0) -> Mesh:
    """Make the inner part of a telescope, from its middle to its ball."""
    rod = _rod(_HALF, 1.0, thick, parts=_FINE if seat else 5)
    if not seat:
        return rod
    plate = tuple(Ring(share=1.0, units=u, thick=seat) for u in (-2.6, -2.2))
    return join(rod, revolve(plate, 16))


def _stroke_about(radius: float, first: float, last: float, growth: float = 0.0) -> Mesh:
    """Make a stroke about the frame's axis, beside its origin; its radius may grow, for a spiral."""
    count = round(9 * (last - first))
    ends: list[Vertex] = []
    for k in range(count + 1):
        angle = first + (last - first) * k / count
        r = radius + growth * (angle - first)
        ends.append((0.0, 0.0, 0.0, 0.0, _LIFT, r * math.cos(angle), r * math.sin(angle)))
    return lines(list(itertools.pairwise(ends)))


def _head(radius: float, angle: float) -> Mesh:
    """Make the head of an arrow that turns about the frame's axis, seen from both sides."""
    c, s = math.cos(angle), math.sin(angle)
    corners = [(radius + a, b) for a, b in ((0.0, 1.6), (0.85, -0.3), (-0.85, -0.3))]
    vertices: list[Vertex] = [(0.0, 0.0, 0.0, 0.0, _LIFT, r * c - t * s, r * s + t * c) for r, t in corners]
    return two_sided(tuple(vertices), lined=False)


def _octants(dark: bool) -> Mesh:
    """Make every other octant of a ball."""
    steps = 3
    parts = []
    for x, y, z in itertools.product((1, -1), repeat=3):
        if (x * y * z > 0) != dark:
            continue
        grid = [
            [(math.cos(a) * math.cos(b), math.sin(a) * math.cos(b), math.sin(b)) for a in _quarter(steps)]
            for b in _quarter(steps)
        ]
        vertices = tuple(
            (0.0, 0.0, 0.0, 0.0, 1.15 * x * p, 1.15 * y * q, 1.15 * z * r) for row in grid for p, q, r in row
        )
        wide, faces = steps + 1, []
        for i, j in itertools.product(range(steps), repeat=2):
            face = (i * wide + j, i * wide + j + 1, (i + 1) * wide + j + 1, (i + 1) * wide + j)
            faces.append(face if x * y * z > 0 else face[::-1])
        parts.append(Mesh((Plain(vertices, tuple(faces)),)))
    return join(*parts)


def _quarter(steps: int) -> list[float]:
    return [0.5 * math.pi * k / steps for k in range(steps + 1)]


_LONG_SPRING = join(coil(14, 1.4, 1.6, 1.6), *(_rod(a, b, 0.16, 6) for a, b in ((0.0, 0.06), (0.94, 1.0))))
_CASE, _CASE_ROD = _rod(0.25, 0.62, 0.85, 12), join(_rod(0.0, 0.25, 0.3), _rod(0.62, 1.0, 0.3))
_PLATES = join(
    *(
        revolve((Ring(share=0.5, units=u - 0.2, thick=1.6), Ring(share=0.5, units=u + 0.2, thick=1.6)), 16)
        for u in (-0.5, 0.5)
    )
)
_BETWEEN: dict[str, tuple[tuple[str, Mesh], ...]] = {
    "spring": (("spring", _LONG_SPRING),),
    "damper": (("rod", _CASE_ROD), ("block", _CASE)),
    "stop": (("rod", _rod(0.0, 1.0, 0.3)), ("block", _PLATES)),
}
_ABOUT: dict[str, tuple[tuple[str, Mesh], ...]] = {
    "spring": (("spring", _stroke_about(1.3, 0.0, 4.5 * math.pi, 0.12)),),
    "damper": (("dashpot", _stroke_about(2.4, 0.6, 5.6)),),
    "effort": (("torque", _stroke_about(3.2, 0.8, 5.0)), ("torque", _head(3.2, 5.0))),
}
CENTRE = (("mass", _octants(False)), ("dark mass", _octants(True)))
"""The symbol of a centre of mass: a ball of light and dark octants."""


_CYLINDER, _ROD = _barrel(1.0), _piston(0.4)
_DAMPER, _DAMPER_ROD = _barrel(0.8, _SEAT), _piston(ROD, _SEAT)
_STRUT_SPRING = coil(8, 1.6, 2.6, 2.6)
_ON_STRUT = coil(4, 1.7, 0.7, 0.9)
_LINE = dashes(14)


class Loads:
    """Symbols of distances between points that no body joins, and of forces.

    `joints` are symbols of joints, which mark the points that have one; `driven` names the inputs.
    """

    def __init__(self, joints: Joints, driven: tuple[str, ...]):
        self.joints, self.driven = joints, driven
        self.bodies, self.top = joints.bodies, joints.top
        self.items: list[SpaceItem] = []
        self.labels: list[Label] = []
        self.links: list[tuple[int, int]] = []
        """Pairs of columns that are joined."""

    # -- distances ----------------------------------------------------------------------------------------------------

    def add_distances(self) -> None:
        """Draw distances that are coordinates: a spring around a damper, a hydraulic cylinder, or a dashed line."""
        found = [(name, rows) for name, rows in self._distances() if self._apart(rows)]
        free = {p for _, rows in found for p in rows.points if self._own(p)}
        for name, rows in found:
            a, b = rows.points
            if rows.ways:
                if not self._along(rows):
                    continue
                self._line(a, b)
            elif self._on_strut(a, b):
                if name not in self.driven:
                    self.items.append(Solid("spring", SpaceFrame(a, Way((a, b))), _ON_STRUT))
            elif name in self.driven:
                self._telescope(a, b, _CYLINDER, _ROD)
            elif a in free and b in free:
                self._telescope(a, b, _DAMPER, _DAMPER_ROD)
                self.items.append(Solid("spring", SpaceFrame(a, Way((a, b))), _STRUT_SPRING))
            else:
                self._line(a, b)
            self.labels.append(Label(a, symbol(name), to=b))

    def _distances(self) -> list[tuple[str, RowReading]]:
        """List the distances with their rows."""
        out = []
        for name, angle, (block, instance) in zip(self.top.scalars, self.top.angles, self.top.measures, strict=True):
            if not angle and block >= 0:
                out.append((name, read_rows(self.top.blocks[block], instance, self.joints.first)))
        return out

    def _apart(self, rows: RowReading) -> bool:
        """Tell whether a distance is between two points that move against each other."""
        if len(rows.points) != 2 or self.bodies.ground[list(rows.points)].all():
            return False
        return self.bodies.holding(*rows.points) is None

    def _own(self, p: int) -> bool:
        """Tell whether there is nothing at a point but what it belongs to."""
        return len({group for *_, group in self.bodies.meeting(p)}) < 2 and p not in self.joints.marked

    def _along(self, rows: RowReading) -> bool:
        """Tell whether a line along the direction of a distance joins its points, and no rod does."""
        if any(set(rows.points) <= set(joint.points) for joint in self.top.joints):
            return False
        a, b = rows.points
        d = self.joints.x[:, b] - self.joints.x[:, a]
        e = np.stack([rows.ways[0].vector(x) for x in self.joints.x])
        size = np.linalg.norm(d, axis=1) * np.linalg.norm(e, axis=1)
        # so near to its direction, of a distance, lie two points that a line along it joins
        return bool((np.linalg.norm(np.cross(d, e), axis=1) <= 1e-6 * size).all())

    def _on_strut(self, a: int, b: int) -> bool:
        """Tell whether a distance is the length of a telescope that a joint has drawn."""
        return any((a in one and b in two) or (b in one and a in two) for one, two in self.joints.struts)

    def _line(self, a: int, b: int) -> None:
        self.items.append(Solid("distance", SpaceFrame(a, Way((a, b))), _LINE))

    def _telescope(self, a: int, b: int, barrel: Mesh, rod: Mesh) -> None:
        self.items.append(Solid("rod", SpaceFrame(a, Way((a, b))), rod))
        self.items.append(Solid("block", SpaceFrame(a, Way((a, b))), barrel))
        self.links.append((a, b))
        for p in (a, b):
            if p not in self.joints.marked:
                self.joints.ball(p)
                self.joints.marked.add(p)
            if self.bodies.ground[p]:
                self.joints.supported.add(p)

    # -- forces -------------------------------------------------------------------------------------------------------

    def add_forces(self) -> None:
        """Draw forces, after the distances: some of these are springs already."""
        springs = [item for item in self.items if isinstance(item, Solid) and item.role == "spring"]
        sprung = {tuple(sorted(item.frame.along.columns)) for item in springs}
        for block in self.top.loads.forces:
            word = block.kind.name.split()[-1]  # of "coordinate spring", and of a user's "leaf spring", a spring
            for points, scalars in zip(block.points, block.scalars, strict=True):
                if scalars:
                    self._on(scalars[0], word)
                elif word in _BETWEEN and len(points) == 2 and tuple(sorted(points)) not in sprung:
                    self._between(points[0], points[1], word)
        for function in self.top.loads.functions:
            if function.acts == "effort":
                self._on(function.at, "effort")

    def _between(self, a: int, b: int, word: str) -> None:
        self.items += [Solid(role, SpaceFrame(a, Way((a, b))), mesh) for role, mesh in _BETWEEN[word]]
        for p in (a, b):
            if self.bodies.ground[p]:
                self.joints.supported.add(p)

    def _on(self, coordinate: int, word: str) -> None:
        """Draw what acts on an angle, about its axis; distances are drawn already."""
        k = coordinate - (len(self.top.coordinates) - len(self.top.scalars))
        if k < 0 or not self.top.angles[k] or word not in _ABOUT:
            return
        block, instance = self.top.measures[k]
        rows = read_rows(self.top.blocks[block], instance, self.joints.first)
        if len(rows.ways) < 2:
            return
        axis, to = rows.ways[0], rows.ways[-1]
        at = self.joints.vertex(axis, to)
        self.items += [Solid(role, SpaceFrame(at, axis, to), mesh) for role, mesh in _ABOUT[word]]
