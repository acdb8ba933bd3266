"""Distances that are coordinates: a spring around a damper, a hydraulic cylinder, or a dashed line."""

import numpy as np

from jaxnc.system.topology import Topology
from jaxnc.viz.spatial.bodies import Bodies
from jaxnc.viz.spatial.joints import ROD, Joints
from jaxnc.viz.spatial.mesh import Mesh, Ring, coil, dashes, joined, turned
from jaxnc.viz.spatial.rows import Reading, read
from jaxnc.viz.spatial.scene import Frame, Item, Label, Solid, Way
from jaxnc.viz.style import symbol

STRAIGHT = 1e-6
"""Of the distance: how near to its direction two points lie that a line along it joins."""

_HALF = 0.55  # of a telescope, covered by its barrel
_PARTS = 12  # of a barrel or a rod with a spring around it, sorted by depth each on its own


def _barrel(thick: float, seat: float = 0.0) -> Mesh:
    """The outer part of a telescope, from its ball to its middle; with the plate that a spring rests on."""
    count = _PARTS if seat else 3
    parts = [k / count for k in range(count + 1)]
    rings = tuple(Ring(share=_HALF * t, units=0.9 * (1.0 - t), thick=thick) for t in parts)
    tube = turned(rings, 14, lined=False)
    if not seat:
        return tube
    return joined(tube, turned((Ring(units=2.2, thick=seat), Ring(units=2.6, thick=seat)), 16))


def _piston(thick: float, seat: float = 0.0) -> Mesh:
    """The inner part of a telescope, from its middle to its ball."""
    count = _PARTS if seat else 5
    rings = tuple(Ring(share=_HALF + (1.0 - _HALF) * k / count, thick=thick) for k in range(count + 1))
    rod = turned(rings, 8, lined=False)
    if not seat:
        return rod
    plate = tuple(Ring(share=1.0, units=u, thick=seat) for u in (-2.6, -2.2))
    return joined(rod, turned(plate, 16))


_SEAT = 1.9
_CYLINDER, _ROD = _barrel(1.0), _piston(0.4)
_DAMPER, _DAMPER_ROD = _barrel(0.8, _SEAT), _piston(ROD, _SEAT)
_SPRING = coil(8, 1.6, 2.6, 2.6)
_ON_STRUT = coil(4, 1.7, 0.7, 0.9)
_LINE = dashes(14)


class Distances:
    """Symbols of distances between points that no body joins.

    `joints` are symbols of joints, which mark the points that have one.
    """

    def __init__(self, joints: Joints, driven: tuple[str, ...]):
        self.joints, self.driven = joints, driven
        self.bodies: Bodies = joints.bodies
        self.top: Topology = joints.top
        self.items: list[Item] = []
        self.labels: list[Label] = []
        self.links: list[tuple[int, int]] = []
        """Pairs of columns that are joined."""

    def add(self) -> None:
        """Everything; after the joints."""
        found = [(name, rows) for name, rows in self._rows() if self._apart(rows)]
        free = {p for _, rows in found for p in rows.points if self._own(p)}
        for name, rows in found:
            a, b = rows.points
            if rows.ways:
                if not self._along(rows):
                    continue
                self._line(a, b)
            elif self._on_strut(a, b):
                if name not in self.driven:
                    self.items.append(Solid("spring", Frame(a, Way((a, b))), _ON_STRUT))
            elif name in self.driven:
                self._telescope(a, b, _CYLINDER, _ROD)
            elif a in free and b in free:
                self._telescope(a, b, _DAMPER, _DAMPER_ROD)
                self.items.append(Solid("spring", Frame(a, Way((a, b))), _SPRING))
            else:
                self._line(a, b)
            self.labels.append(Label(a, symbol(name), to=b))

    def _rows(self) -> list[tuple[str, Reading]]:
        """Every distance and its rows."""
        out = []
        for name, angle, (block, instance) in zip(self.top.scalars, self.top.angles, self.top.measures, strict=True):
            if not angle and block >= 0:
                out.append((name, read(self.top.blocks[block], instance, self.joints.first)))
        return out

    def _apart(self, rows: Reading) -> bool:
        """Whether it is between two points that move against each other."""
        if len(rows.points) != 2 or self.bodies.ground[list(rows.points)].all():
            return False
        return self.bodies.holding(*rows.points) is None

    def _own(self, p: int) -> bool:
        """Whether there is nothing at a point but what it belongs to."""
        return len({group for *_, group in self.bodies.meeting(p)}) < 2 and p not in self.joints.marked

    def _along(self, rows: Reading) -> bool:
        """Whether a line along the direction of a distance joins its points, and no rod does."""
        if any(set(rows.points) <= set(joint.points) for joint in self.top.joints):
            return False
        a, b = rows.points
        d = self.joints.x[:, b] - self.joints.x[:, a]
        e = np.stack([rows.ways[0].read(x) for x in self.joints.x])
        size = np.linalg.norm(d, axis=1) * np.linalg.norm(e, axis=1)
        return bool((np.linalg.norm(np.cross(d, e), axis=1) <= STRAIGHT * size).all())

    def _on_strut(self, a: int, b: int) -> bool:
        """Whether it is the length of a telescope that a joint has drawn."""
        return any((a in one and b in two) or (b in one and a in two) for one, two in self.joints.struts)

    def _line(self, a: int, b: int) -> None:
        self.items.append(Solid("distance", Frame(a, Way((a, b))), _LINE))

    def _telescope(self, a: int, b: int, barrel: Mesh, rod: Mesh) -> None:
        self.items.append(Solid("rod", Frame(a, Way((a, b))), rod))
        self.items.append(Solid("block", Frame(a, Way((a, b))), barrel))
        self.links.append((a, b))
        for p in (a, b):
            if p not in self.joints.marked:
                self.joints.ball(p)
                self.joints.marked.add(p)
            if self.bodies.ground[p]:
                self.joints.supported.add(p)
