"""Symbols between points that no body joins, and of forces: springs, dampers, cylinders, stops, torques, masses."""

import itertools
import math

import numpy as np

from jaxnc.viz.poses import Poses
from jaxnc.viz.scene import Label
from jaxnc.viz.spatial.joints import ROD, Joints, RowReading
from jaxnc.viz.spatial.mesh import Mesh, Plain, Ring, coil, dashes, drum, in_units, join, lines, rod, two_sided
from jaxnc.viz.spatial.scene import Solid, SpaceFrame, segment
from jaxnc.viz.style import symbol

_HALF = 0.55  # of a telescope, covered by its barrel
_FINE = 12  # the same of a barrel or a rod with a spring around it
_LIFT = 2.6  # from the middle of a hinge to what turns about its axis, units
_SEAT = 1.9  # radius of the plate that a spring rests on, units


# -- solids -----------------------------------------------------------------------------------------------------------


def _rod(start: float, end: float, thick: float, sides: int = 8) -> Mesh:
    """Make a round rod over a share of the frame's segment."""
    return rod(Ring(share=start, thick=thick), Ring(share=end, thick=thick), sides=sides)


def _barrel(thick: float, seat: float = 0.0) -> Mesh:
    """Make the outer part of a telescope, from its ball to its middle; with the plate that a spring rests on."""
    tube = rod(Ring(units=0.9, thick=thick), Ring(share=_HALF, thick=thick), _FINE if seat else 3, 14)
    return join(tube, drum(2.2, 2.6, seat)) if seat else tube


def _piston(thick: float, seat: float = 0.0) -> Mesh:
    """Make the inner part of a telescope, from its middle to its ball."""
    inner = rod(Ring(share=_HALF, thick=thick), Ring(share=1.0, thick=thick), _FINE if seat else 5)
    return join(inner, drum(-2.6, -2.2, seat, share=1.0)) if seat else inner


def _stroke_about(radius: float, first: float, last: float, growth: float = 0.0) -> Mesh:
    """Make a stroke about the frame's axis, beside its origin; its radius may grow, for a spiral."""
    count = round(9 * (last - first))
    turn = first + (last - first) * np.arange(count + 1) / count
    r = radius + growth * (turn - first)
    places = np.stack([np.full(len(turn), _LIFT), r * np.cos(turn), r * np.sin(turn)], axis=1).tolist()
    return lines(list(itertools.pairwise(in_units(*place) for place in places)))


def _head(radius: float, angle: float) -> Mesh:
    """Make the head of an arrow that turns about the frame's axis, seen from both sides."""
    c, s = math.cos(angle), math.sin(angle)
    corners = [(radius + a, b) for a, b in ((0.0, 1.6), (0.85, -0.3), (-0.85, -0.3))]
    return two_sided(tuple(in_units(_LIFT, r * c - t * s, r * s + t * c) for r, t in corners), lined=False)


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
        vertices = tuple(in_units(1.15 * x * p, 1.15 * y * q, 1.15 * z * r) for row in grid for p, q, r in row)
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
_PLATES = join(drum(-0.7, -0.3, 1.6, share=0.5), drum(0.3, 0.7, 1.6, share=0.5))
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


class Loads(Joints):
    """Symbols of distances between points that no body joins, and of forces, beside those of joints."""

    def __init__(self, poses: Poses):
        super().__init__(poses)
        self.labels: list[Label] = []

    # -- distances ----------------------------------------------------------------------------------------------------

    def add_distances(self) -> None:
        """Draw distances that are coordinates: a spring around a damper, a hydraulic cylinder, or a dashed line."""
        every = zip(self.top.scalars, self.top.angles, self.top.measures, strict=True)
        lengths = [
            (name, self.read_instance(self.top.blocks[k], i)) for name, angle, (k, i) in every if not angle and k >= 0
        ]
        found = [  # those between points that move against each other
            (name, rows)
            for name, rows in lengths
            if len(rows.points) == 2
            and not self.bodies.ground[list(rows.points)].all()
            and self.bodies.holding(*rows.points) is None
        ]
        free = {p for _, rows in found for p in rows.points if self._own(p)}
        for name, rows in found:
            a, b = rows.points
            driven = name in self.poses.motion.driven
            if rows.ways and not self._along(rows):
                continue
            if not rows.ways and frozenset((a, b)) in self.struts:
                if not driven:
                    self.items.append(segment("spring", a, b, _ON_STRUT))
            elif not rows.ways and driven:
                self._telescope(a, b, _CYLINDER, _ROD)
            elif not rows.ways and a in free and b in free:
                self._telescope(a, b, _DAMPER, _DAMPER_ROD)
                self.items.append(segment("spring", a, b, _STRUT_SPRING))
            else:
                self.items.append(segment("distance", a, b, _LINE))
            self.labels.append(Label(a, symbol(name), to=b))

    def _own(self, p: int) -> bool:
        """Tell whether there is nothing at a point but what it belongs to."""
        return len({group for *_, group in self.bodies.meeting(p)}) < 2 and p not in self.marked

    def _along(self, rows: RowReading) -> bool:
        """Tell whether a line along the direction of a distance joins its points, and no rod does."""
        if any(set(rows.points) <= set(joint.points) for joint in self.top.joints):
            return False
        a, b = rows.points
        d, e = self.x[:, b] - self.x[:, a], rows.ways[0].vector(self.x)
        size = np.linalg.norm(d, axis=1) * np.linalg.norm(e, axis=1)
        # so near to its direction, of a distance, lie two points that a line along it joins
        return bool((np.linalg.norm(np.cross(d, e), axis=1) <= 1e-6 * size).all())

    def _telescope(self, a: int, b: int, barrel: Mesh, rod: Mesh) -> None:
        self.items += [segment("rod", a, b, rod), segment("block", a, b, barrel)]
        self.links.append((a, b))
        for p in (a, b):
            if p not in self.marked:
                self.ball(p)
                self.marked.add(p)
        self._support(a, b)

    def _support(self, *points: int) -> None:
        self.supported.update(p for p in points if self.bodies.ground[p])

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
                    a, b = points
                    self.items += [segment(role, a, b, mesh) for role, mesh in _BETWEEN[word]]
                    self._support(a, b)
        for function in self.top.loads.functions:
            if function.acts == "effort":
                self._on(function.at, "effort")

    def _on(self, coordinate: int, word: str) -> None:
        """Draw what acts on an angle, about its axis; distances are drawn already."""
        k = coordinate - (len(self.top.coordinates) - len(self.top.scalars))
        if k < 0 or not self.top.angles[k] or word not in _ABOUT:
            return
        block, instance = self.top.measures[k]
        rows = self.read_instance(self.top.blocks[block], instance)
        if len(rows.ways) < 2:
            return
        axis, to = rows.ways[0], rows.ways[-1]
        at = self.vertex(axis, to)
        self.items += [Solid(role, SpaceFrame(at, axis, to), mesh) for role, mesh in _ABOUT[word]]
