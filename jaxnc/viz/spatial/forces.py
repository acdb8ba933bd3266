"""What acts in space: springs, dampers and stops between points and about axes, torques, and centres of mass."""

import itertools
import math

from jaxnc.viz.spatial.distances import Distances
from jaxnc.viz.spatial.joints import Joints
from jaxnc.viz.spatial.mesh import Mesh, Plain, Ring, Vertex, coil, joined, lines, sheet, turned
from jaxnc.viz.spatial.rows import read
from jaxnc.viz.spatial.scene import Frame, Item, Solid, Way

_LIFT = 2.6  # from the middle of a hinge to what turns about its axis, units
_PARTS = 8  # of a rod, sorted by depth each on its own


def _rod(start: float, end: float, thick: float, sides: int = 8) -> Mesh:
    """A round rod over a share of the frame's segment."""
    rings = tuple(Ring(share=start + (end - start) * k / _PARTS, thick=thick) for k in range(_PARTS + 1))
    return turned(rings, sides, lined=False)


def _around(radius: float, first: float, last: float, growth: float = 0.0) -> Mesh:
    """A stroke about the frame's axis, beside its origin; its radius may grow, for a spiral."""
    count = round(9 * (last - first))
    ends: list[Vertex] = []
    for k in range(count + 1):
        angle = first + (last - first) * k / count
        r = radius + growth * (angle - first)
        ends.append((0.0, 0.0, 0.0, 0.0, _LIFT, r * math.cos(angle), r * math.sin(angle)))
    return lines(list(itertools.pairwise(ends)))


def _head(radius: float, angle: float) -> Mesh:
    """The head of an arrow that turns about the frame's axis, seen from both sides."""
    c, s = math.cos(angle), math.sin(angle)
    corners = [(radius + a, b) for a, b in ((0.0, 1.6), (0.85, -0.3), (-0.85, -0.3))]
    vertices: list[Vertex] = [(0.0, 0.0, 0.0, 0.0, _LIFT, r * c - t * s, r * s + t * c) for r, t in corners]
    return sheet(tuple(vertices), lined=False)


def _octants(dark: bool, steps: int = 3) -> Mesh:
    """Every other octant of a ball."""
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
    return joined(*parts)


def _quarter(steps: int) -> list[float]:
    return [0.5 * math.pi * k / steps for k in range(steps + 1)]


_SPRING = joined(coil(14, 1.4, 1.6, 1.6), *(_rod(a, b, 0.16, 6) for a, b in ((0.0, 0.06), (0.94, 1.0))))
_CASE, _PISTON = _rod(0.25, 0.62, 0.85, 12), joined(_rod(0.0, 0.25, 0.3), _rod(0.62, 1.0, 0.3))
_PLATES = joined(
    *(
        turned((Ring(share=0.5, units=u - 0.2, thick=1.6), Ring(share=0.5, units=u + 0.2, thick=1.6)), 16)
        for u in (-0.5, 0.5)
    )
)
_BETWEEN: dict[str, tuple[tuple[str, Mesh], ...]] = {
    "spring": (("spring", _SPRING),),
    "damper": (("rod", _PISTON), ("block", _CASE)),
    "stop": (("rod", _rod(0.0, 1.0, 0.3)), ("block", _PLATES)),
}
_ABOUT: dict[str, tuple[tuple[str, Mesh], ...]] = {
    "spring": (("spring", _around(1.3, 0.0, 4.5 * math.pi, 0.12)),),
    "damper": (("dashpot", _around(2.4, 0.6, 5.6)),),
    "effort": (("torque", _around(3.2, 0.8, 5.0)), ("torque", _head(3.2, 5.0))),
}
CENTRE = (("mass", _octants(False)), ("dark mass", _octants(True)))
"""The symbol of a centre of mass: a ball of light and dark octants."""


class Forces:
    """Symbols of forces.

    Some of the symbols of distances are springs already.
    """

    def __init__(self, joints: Joints, distances: Distances):
        self.joints, self.distances, self.top = joints, distances, joints.top
        self.items: list[Item] = []

    def add(self) -> None:
        """Everything; after the joints and distances."""
        springs = [item for item in self.distances.items if isinstance(item, Solid) and item.role == "spring"]
        sprung = {tuple(sorted(item.frame.along.columns)) for item in springs}
        for block in self.top.loads.forces:
            word = next((word for word in ("spring", "damper", "stop", "effort") if word in block.kind.name), None)
            for points, scalars in zip(block.points, block.scalars, strict=True):
                if scalars:
                    self._on(scalars[0], word)
                elif word in _BETWEEN and len(points) == 2 and tuple(sorted(points)) not in sprung:
                    self._between(points[0], points[1], word)
        for function in self.top.loads.functions:
            if function.acts == "effort":
                self._on(function.at, "effort")

    def _between(self, a: int, b: int, word: str) -> None:
        self.items += [Solid(role, Frame(a, Way((a, b))), mesh) for role, mesh in _BETWEEN[word]]
        for p in (a, b):
            if self.joints.bodies.ground[p]:
                self.joints.supported.add(p)

    def _on(self, coordinate: int, word: str | None) -> None:
        """What acts on an angle, about its axis; distances are drawn as what they are."""
        k = coordinate - (len(self.top.coordinates) - len(self.top.scalars))
        if k < 0 or not self.top.angles[k] or word not in _ABOUT:
            return
        block, instance = self.top.measures[k]
        rows = read(self.top.blocks[block], instance, self.joints.first)
        if len(rows.ways) < 2:
            return
        axis, to = rows.ways[0], rows.ways[-1]
        at = self.joints.vertex(axis, to)
        self.items += [Solid(role, Frame(at, axis, to), mesh) for role, mesh in _ABOUT[word]]
