"""Symbols of joints in space: hinges, balls, sleeves on rods, crosses, wheels, and the arrows of inputs."""

import itertools
from dataclasses import dataclass

import numpy as np

from jaxnc.solvers.assembly import derive
from jaxnc.system.topology import Block, JointIndex
from jaxnc.viz.bodies import Bodies
from jaxnc.viz.poses import Poses
from jaxnc.viz.scene import least_angle
from jaxnc.viz.spatial.mesh import Ring, disc, drum, line, revolve, rod, stand, tube
from jaxnc.viz.spatial.scene import Ball, Solid, SpaceFrame, SpaceItem, Turn, Way, segment
from jaxnc.viz.style import INK, symbol

_HINGE = drum(-1.5, 1.5, 0.95)
_KNUCKLE = drum(-0.85, 0.85, 0.95)  # of a hinge between two points
_SLEEVE = drum(-2.3, 2.3, 1.15)
_NUT = revolve(tuple(Ring(units=-2.3 + 0.92 * k, thick=1.25 if k % 2 else 1.05) for k in range(6)), 16)
_BLOCK = drum(-2.2, 2.2, 1.2, 4, prism=True)
_ARM = drum(-2.1, 2.1, 0.5, 10)
_PAD = drum(-0.3, 0.3, 2.6, 24)
_BEYOND = 3.4  # of a rod, past the ends of a sleeve's travel, units

ROD = 0.36
"""Radius of the rods that things slide on, units."""

_PISTON = tube(ROD, 10)

ONLINE = 1e-6
"""Of the mechanism's size: how near to an axis a point is that lies on it."""


@dataclass(frozen=True)
class RowReading:
    """Points and directions that an instance of a kind acts on."""

    block: Block  # where it is
    instance: int  # which one
    points: tuple[int, ...]  # its own points, without those of its directions
    ways: tuple[Way, ...]  # its directions
    vectors: tuple[int, ...]  # for each direction, the index of its unit vector; -1 for a segment


class Joints:
    """Symbols of joints of a motion; extents of rods follow from its right poses."""

    def __init__(self, poses: Poses):
        self.poses, self.top, self.bodies = poses, poses.topology, Bodies(poses)
        self.x = poses.every_column[poses.extent_poses]  # (T, columns, 3)
        self.first = len(poses.names)  # column of the first direction
        self.items: list[SpaceItem] = []
        self.links: list[tuple[int, int]] = []  # pairs of columns that are joined
        self.marked: set[int] = set()  # points that have a symbol
        self.supported: set[int] = set()  # ground points that stand on the ground's symbol
        self.hanging: set[int] = set()  # points of the ground that are held by the shafts which meet there
        self.shifts: dict[int, float] = {}  # how much lower the ground's symbol is, units
        self.axes: dict[int, int] = {}  # where the vectors that are axes of joints are shown
        self.ends: dict[int, tuple[float, float]] = {}  # where the rods along them end: a length and units along
        self.struts: set[frozenset[int]] = set()  # pairs of points of both parts of a telescope, along its axis
        self.near: dict[int, int] = {}  # where other vectors may be
        self.extents: list[np.ndarray] = []
        blocks = [self.top.blocks[k] for k, _ in self.top.measures]
        holders = [(joint.points, joint.vectors) for joint in self.top.joints]
        holders += [pair for block in blocks for pair in zip(block.points, block.vectors, strict=True)]
        for points, vectors in holders:
            for v in vectors if points else ():
                self.near.setdefault(v, points[0])

    def read_instance(self, block: Block, instance: int) -> RowReading:
        """Read one instance of a block."""
        words = block.kind.name.replace(",", " ").split()
        forms = next((word for word in reversed(words) if set(word) <= {"p", "v"}), "")
        points, vectors = list(block.points[instance]), list(block.vectors[instance])
        leading = len(points) - 2 * forms.count("p")
        rest = points[leading:]
        ways, own = [], []
        for form in forms:
            if form == "v":
                own.append(vectors.pop(0))
                ways.append(self.way(own[-1]))
            else:
                ways.append(Way((rest.pop(0), rest.pop(0))))
                own.append(-1)
        return RowReading(block, instance, tuple(points[:leading]), tuple(ways), tuple(own))

    def way(self, v: int) -> Way:
        """Read a unit vector as a direction."""
        return Way((self.first + v,))

    # -- joints by name -----------------------------------------------------------------------------------------

    def add_listed(self) -> None:
        """Draw joints that the mechanism lists."""
        draw = {
            self.add_revolute: ("revolute",),
            self.add_spherical: ("spherical",),
            self.add_crossed: ("constant velocity", "universal"),
            self.add_sliding: ("cylindrical", "prismatic", "screw", "slot"),
            self.add_planar: ("planar",),
            self.add_wheels: ("gear", "internal gear", "bevel gear", "rack and pinion", "rolling"),
            self.add_cable: ("cable",),
        }
        for joint in self.top.joints:
            for add, types in draw.items():
                if joint.drawn and joint.type in types:
                    add(joint)

    def rows_of(self, joint: JointIndex, *kinds: str) -> RowReading | None:
        """Find the first rows of a joint whose kind is called so."""
        named = [rows for rows in self.top.blocks if rows.kind.name.startswith(kinds)]
        mine = ((rows, i) for rows in named for i, owners in enumerate(rows.owners) if joint.owner in owners)
        return next((self.read_instance(rows, i) for rows, i in mine), None)

    def centre(self, joint: JointIndex, rows: RowReading) -> int | None:
        """Find where a joint about directions is: the point it makes coincide, or the one that its bodies share."""
        both = self.rows_of(joint, "coincident")
        if both is not None:
            self.marked.update(both.points)
            return both.points[0]
        sets = []
        for way, v in zip(rows.ways, rows.vectors, strict=True):
            held = [
                points
                for points, vectors in zip(self.bodies.points, self.bodies.vectors, strict=True)
                if (v in vectors if v >= 0 else set(way.columns) <= points)
            ]
            fixed = bool(self.bodies.still[v]) if v >= 0 else bool(self.bodies.ground[list(way.columns)].all())
            ground = set(np.flatnonzero(self.bodies.ground).tolist()) if fixed else set()
            sets.append(ground.union(*held))
        shared = set.intersection(*sets) if sets else set()
        return min(shared) if shared else None

    def add_revolute(self, joint: JointIndex) -> None:
        """Draw a hinge."""
        rows = self.rows_of(joint, "parallel")
        p = self.centre(joint, rows) if rows else None
        if rows is None or p is None:
            return
        self.hinge(p, rows.ways[0])
        self.axes |= {v: p for v in rows.vectors if v >= 0}
        self.marked.add(p)

    def add_spherical(self, joint: JointIndex) -> None:
        """Draw a ball."""
        self.ball(joint.points[0])
        self.marked.update(joint.points)

    def add_crossed(self, joint: JointIndex) -> None:
        """Draw the cross of a universal joint; a large ball for constant velocity."""
        universal = joint.type == "universal"
        rows = self.rows_of(joint, "scalar product" if universal else "constant velocity")
        p = self.centre(joint, rows) if rows else None
        if rows is None or p is None:
            return
        for way, v in zip(rows.ways, rows.vectors, strict=True) if universal else ():
            colour = self.bodies.colour(vectors=(v,)) if v >= 0 else self.bodies.colour(*way.columns)
            self.items.append(Solid("cross", SpaceFrame(p, way), _ARM, body=colour))
        self.axes |= {v: p for v in rows.vectors if v >= 0}
        self.items.append(Ball("ball", p, 0.85 if universal else 1.4))
        self.hanging.add(p)
        self.marked.add(p)

    def add_sliding(self, joint: JointIndex) -> None:
        """Draw a sleeve, a block, a nut or a ball on a rod along the axis."""
        rows = self.rows_of(joint, "aligned")
        if rows is None or len(rows.points) < 2:
            return
        (start, on), axis, v = rows.points, rows.ways[0], rows.vectors[0]
        holder = self.bodies.holding(on)
        side = None
        if holder is not None:
            others = [p for p in self.top.bodies[holder].points if p != on]
            side = Way((on, others[0])) if others else None
        t = self.along(start, axis, on)
        lo, hi = min(float(t.min()), 0.0), max(float(t.max()), 0.0)
        before = 0.8 if t.min() > 0.05 * self.extent() else _BEYOND
        if v >= 0:
            line, fixed = self.bodies.holding(start, vectors=(v,)), bool(self.bodies.still[v])
            self.axes.setdefault(v, start)
            self.ends.setdefault(v, (hi, _BEYOND))
        else:
            line, fixed = self.bodies.holding(*axis.columns), bool(self.bodies.ground[list(axis.columns)].all())
        fixed = fixed and bool(self.bodies.ground[start])
        colour = INK if line is None else self.bodies.colours[line]
        if line is not None and holder is not None and self.add_strut(start, axis, line, holder):
            return
        self.rod(SpaceFrame(start, axis), lo, hi, "rail" if fixed else "bar", colour, before)
        mesh = {"cylindrical": _SLEEVE, "screw": _NUT, "prismatic": _BLOCK}.get(joint.type)
        if mesh is None:
            self.ball(on)
        else:
            self.items.append(Solid("block", SpaceFrame(on, axis, side), mesh, body=self.bodies.colour(on)))
        if fixed:
            self.supported.add(start)
        self.marked.update((start, on))

    def add_strut(self, start: int, axis: Way, line: int, holder: int) -> bool:
        """Draw a telescope where two bodies have points along the axis: a sleeve, and the rod in it; else false."""
        outer, inner = (self.on_axis(k, start, axis) for k in (line, holder))
        if len(outer) < 2 or len(inner) < 2:
            return False
        rod, block = (np.stack([self.along(start, axis, p) for p in points]) for points in (outer, inner))
        room = ONLINE * self.extent()
        if (rod.min(axis=0) - room <= block).all() and (block <= rod.max(axis=0) + room).all():
            return False  # a block on a rod
        pairs = list(itertools.product(outer, inner))
        gaps = [float(np.abs(self.along(q, axis, p)).mean()) for p, q in pairs]
        enters, end = pairs[int(np.argmin(gaps))]
        self.items.append(segment("bar", end, enters, _PISTON, self.bodies.colours[holder]))
        colour = self.bodies.colours[line]
        inward = self.along(end, axis, enters).mean() > 0
        mesh = drum(*((-0.5, 4.1) if inward else (-4.1, 0.5)), 1.15)
        self.items.append(Solid("block", SpaceFrame(enters, axis), mesh, body=colour))
        self.marked.update((start, enters))
        self.struts.update(map(frozenset, pairs))
        return True

    def direction(self, axis: Way) -> np.ndarray:
        """Find the unit direction of an axis in every pose, ``(T, 3)``."""
        d = axis.vector(self.x)
        return d / np.maximum(np.linalg.norm(d, axis=1, keepdims=True), 1e-300)

    def on_axis(self, k: int, start: int, axis: Way) -> list[int]:
        """Find the points of a body that lie on an axis in every pose."""
        room, d = ONLINE * self.extent(), self.direction(axis)
        aside = {p: np.cross(self.x[:, p] - self.x[:, start], d) for p in sorted(self.bodies.points[k])}
        return [p for p, x in aside.items() if (np.linalg.norm(x, axis=1) <= room).all()]

    def extent(self) -> float:
        """Measure the size of the mechanism, a length."""
        return float(np.linalg.norm(np.ptp(self.x[:, : self.first].reshape(-1, 3), axis=0)))

    def along(self, start: int, axis: Way, on: int) -> np.ndarray:
        """Find how far a point is along an axis from a start, lengths ``(T,)``."""
        return ((self.x[:, on] - self.x[:, start]) * self.direction(axis)).sum(axis=1)

    def rod(self, frame: SpaceFrame, lo: float, hi: float, role: str, body: int, before: float = _BEYOND) -> None:
        """Draw a rod over a range along an axis, and a little beyond: `before` units at its start."""
        ends = Ring(length=lo, units=-before, thick=ROD), Ring(length=hi, units=_BEYOND, thick=ROD)
        self.items.append(Solid(role, frame, rod(*ends, 10), body=body))

    def add_planar(self, joint: JointIndex) -> None:
        """Draw a pad that lies in the plane."""
        vectors = joint.vectors
        if not vectors or len(joint.points) < 2:
            return
        on = joint.points[1]
        self.items.append(Solid("block", SpaceFrame(on, self.way(vectors[0])), _PAD, body=self.bodies.colour(on)))
        self.axes.setdefault(vectors[0], joint.points[0])
        self.marked.add(on)

    def add_cable(self, joint: JointIndex) -> None:
        """Draw straight pieces between its points."""
        self.items += [segment("cable", a, b, line(8)) for a, b in itertools.pairwise(joint.points)]

    def add_wheels(self, joint: JointIndex) -> None:
        """Draw pitch circles of gears, pinions and discs, from the constants of their rows."""
        rows = self.rows_of(joint, "contact in space", "bevel gear", "internal bevel gear", "rack")
        if rows is None:
            return
        constants = derive(self.poses.motion.system).constants[self.top.blocks.index(rows.block)]
        numbers = zip(rows.block.kind.constants, np.asarray(constants)[rows.instance].tolist(), strict=True)
        radii = [abs(value) for name, value in numbers if name.startswith("radius")]
        ways, vectors = list(rows.ways), list(rows.vectors)
        if joint.type == "rolling":  # the line comes first, then the disc's axis
            ways, vectors = ways[::-1], vectors[::-1]
        for p, axis, v, radius in zip(rows.points, ways, vectors, radii, strict=False):
            holder = self.bodies.holding(p, vectors=() if v < 0 else (v,))
            colour = self.bodies.colour(p) if holder is None else self.bodies.colours[holder]
            self.items.append(Solid("wheel", SpaceFrame(p, axis), disc(radius, 0.45), body=colour))

    # -- joints by what bodies share ----------------------------------------------------------------------------

    def add_shared(self) -> None:
        """Draw what holds bodies that meet at a point: a hinge if they share an axis too, else a ball."""
        for p in range(len(self.top.points)):
            found = self.bodies.meeting(p)
            if len({group for *_, group in found}) < 2:
                continue
            if self.bodies.ground[p] and p not in self.hanging:
                self.supported.add(p)
            if p in self.marked:
                continue
            self.marked.add(p)
            pairs = [(a, b) for i, a in enumerate(found) for b in found[i + 1 :] if a[2] != b[2]]
            vector = next((v for a, b in pairs for v in sorted(a[1] & b[1])), None)
            other = next((q for a, b in pairs for q in sorted(a[0] & b[0] - {p}) if self.apart(p, q)), None)
            if vector is not None:
                self.hinge(p, self.way(vector))
                self.axes.setdefault(vector, p)
            elif other is not None:
                self.hinge(p, Way((p, other)), _KNUCKLE)
            else:
                self.ball(p)

    def apart(self, p: int, q: int) -> bool:
        """Tell whether two points are different places."""
        return float(np.linalg.norm(self.x[0, p] - self.x[0, q])) > 0

    def hinge(self, p: int, axis: Way, mesh=_HINGE) -> None:
        """Draw a hinge at a point; on the ground it stands on the ground's symbol."""
        ground = bool(self.bodies.ground[p])
        self.items.append(Solid("ground hinge" if ground else "hinge", SpaceFrame(p, axis), mesh))
        d = axis.vector(self.x[0])
        if ground and abs(d[2]) > 0.7 * float(np.linalg.norm(d)):
            self.shifts[p] = 0.9

    def ball(self, p: int) -> None:
        """Draw a ball joint."""
        self.items.append(Ball("ground ball" if self.bodies.ground[p] else "ball", p, 1.05))

    # -- sliders and inputs -------------------------------------------------------------------------------------

    def add_sliders(self) -> None:
        """Draw rails of points of which one coordinate is free."""
        for p in np.flatnonzero(self.bodies.half).tolist():
            free = np.flatnonzero(~self.bodies.fixed[p])
            if len(free) != 1:
                continue
            e = np.eye(3)[free[0]]
            axis, middle = Way(fixed=_triple(e)), np.where(e > 0, 0.0, self.x[0, p])
            low, high = (float(f(self.x[:, p, free[0]])) for f in (np.min, np.max))
            self.extents.append(np.stack([middle + low * e, self.x[0, p], middle + high * e]))
            self.rod(SpaceFrame(_triple(middle), axis), low, high, "rail", INK)
            upright = free[0] == 2
            mesh = stand(_BEYOND + 2.4, 1.5) if upright else stand(2.4, 1.2)
            for end in (low,) if upright else (low, high):
                self.items.append(Solid("support", SpaceFrame(_triple(middle + end * e), Way()), mesh))
            self.items.append(Solid("block", SpaceFrame(p, axis), _BLOCK, body=self.bodies.colour(p)))
            if len(self.bodies.meeting(p)) > 1:
                self.ball(p)
            self.marked.add(p)

    def add_inputs(self) -> None:
        """Draw the arrow of every driven angle, where its direction starts or its axis is shown."""
        for name, k, angle, owner, instance in self.poses.driven_scalars():
            rows = self.read_instance(owner, instance)
            if angle and len(rows.ways) > 1:
                axis, to = rows.ways[0], rows.ways[-1]
                low = least_angle(self.poses.scalars[self.poses.extent_poses, k])
                self.items.append(Turn("arc", self.vertex(axis, to), axis, to, k, 6.4, symbol(name), low))

    def vertex(self, axis: Way, to: Way) -> int:
        """Find the column at which an angle is shown: where its direction starts, or where its axis is shown."""
        if len(to.columns) == 2:
            return to.columns[0]
        shown = self.axes.get(axis.columns[0] - self.first)
        return self.near.get(axis.columns[0] - self.first, 0) if shown is None else shown


def _triple(x: np.ndarray) -> tuple[float, float, float]:
    """Write three numbers as what a frame or a direction takes."""
    a, b, c = x.tolist()
    return a, b, c
