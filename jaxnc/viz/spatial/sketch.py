"""Scene of a spatial mechanism: the bar, plate, hinge, ball, sleeve, spring or axis that is drawn for each part."""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from jaxnc.system.topology import Block, JointIndex
from jaxnc.vehicle.hardpoints import number_names, usual
from jaxnc.viz.bodies import inline, outline, rank
from jaxnc.viz.poses import Poses
from jaxnc.viz.scene import Label, least_angle
from jaxnc.viz.sketch import Sketch
from jaxnc.viz.spatial.mesh import (
    PARTS,
    Coil,
    Mesh,
    Plain,
    Ring,
    Shell,
    arrow,
    dashes,
    drum,
    in_units,
    join,
    line,
    lines,
    revolve,
    rod,
    stand,
    tube,
    two_sided,
)
from jaxnc.viz.spatial.scene import Ball, Plate, Solid, SpaceFrame, SpaceItem, SpaceScene, Turn, Way, segment
from jaxnc.viz.style import INK, symbol

_BAR = tube(0.52, PARTS)
_EDGE = tube(0.3, PARTS, 8)
_HINGE = drum(-1.5, 1.5, 0.95)
_KNUCKLE = drum(-0.85, 0.85, 0.95)  # of a hinge between two points
_SLEEVE = drum(-2.3, 2.3, 1.15)
_NUT = revolve(tuple(Ring(units=-2.3 + 0.92 * k, thick=1.25 if k % 2 else 1.05) for k in range(6)), 16)
_BLOCK = drum(-2.2, 2.2, 1.2, 4, prism=True)
_ARM = drum(-2.1, 2.1, 0.5, 10)
_PAD = drum(-0.3, 0.3, 2.6, 24)
_BEYOND = 3.4  # of a rod, past the ends of a sleeve's travel, units
_RODS = 0.36  # radius of the rods that things slide on, units
_PISTON = tube(_RODS, 10)
_SHAFT, _HEAD, _REACH = 0.17, 0.62, 8.0  # of a unit vector, units
_AXIS = arrow(_REACH, _SHAFT, _HEAD)
_STAND = stand(2.9, 1.5)
_CROSS = lines([(in_units(*-way), in_units(*way)) for way in np.eye(3)])
_THREAD = line(6)
_ALONG, _ACROSS = Way(fixed=(1.0, 0.0, 0.0)), Way(fixed=(0.0, 1.0, 0.0))
_UP, _DOWN = Way(), Way(fixed=(0.0, 0.0, -1.0))
_TYRE_PROFILE = ((0.84, 0.63), (0.98, 0.74), (1.0, 0.85), (0.86, 0.97), (0.5, 1.0))  # shares of half width and radius
_ROAD, _PRINT = (0.75, 0.55), (0.2, 0.24)  # half lengths and widths of the road and of the tyre's print, in radii
_ONLINE = 1e-6  # of the mechanism's size: how near to an axis a point is that lies on it
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
    steps, parts = 3, []
    turns = [0.5 * math.pi * k / steps for k in range(steps + 1)]
    grid = [(math.cos(a) * math.cos(b), math.sin(a) * math.cos(b), math.sin(b)) for b in turns for a in turns]
    for x, y, z in itertools.product((1, -1), repeat=3):
        if (x * y * z > 0) != dark:
            continue
        vertices = tuple(in_units(1.15 * x * p, 1.15 * y * q, 1.15 * z * r) for p, q, r in grid)
        wide, faces = steps + 1, []
        for i, j in itertools.product(range(steps), repeat=2):
            face = (i * wide + j, i * wide + j + 1, (i + 1) * wide + j + 1, (i + 1) * wide + j)
            faces.append(face if x * y * z > 0 else face[::-1])
        parts.append(Mesh((Plain(vertices, tuple(faces)),)))
    return join(*parts)


_LONG_SPRING = join(Mesh((Coil(14, 1.4, 1.6, 1.6),)), line(1, 0.0, 0.06), line(1, 0.94, 1.0))  # strokes: it has no fill
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
    "stop": (("dashpot", join(_stroke_about(2.4, 0.6, 2.8), _stroke_about(2.4, 3.3, 5.6))),),
    "effort": (("torque", _stroke_about(3.2, 0.8, 5.0)), ("torque", _head(3.2, 5.0))),
}
CENTRE = (("mass", _octants(False)), ("dark mass", _octants(True)))
"""The symbol of a centre of mass: a ball of light and dark octants."""

_CYLINDER, _ROD = _barrel(1.0), _piston(0.4)
_DAMPER, _DAMPER_ROD = _barrel(0.8, _SEAT), _piston(_RODS, _SEAT)
_STRUT_SPRING = Mesh((Coil(8, 1.6, 2.6, 2.6),))
_ON_STRUT = Mesh((Coil(4, 1.7, 0.7, 0.9),))
_LINE = dashes(14)


@dataclass(frozen=True)
class RowReading:
    """Points and directions that an instance of a kind acts on."""

    points: tuple[int, ...]  # its own points, without those of its directions
    ways: tuple[Way, ...]  # its directions
    vectors: tuple[int, ...]  # for each direction, the index of its unit vector; -1 for a segment


def sketch_space(poses: Poses) -> SpaceScene:
    """Make the scene of a motion in space, its labels not yet placed.

    Extents of rails follow from its right poses.
    """
    drawing = _SpaceSketch(poses)
    drawing.add_bodies()
    drawing.add_joints()
    drawing.add_sliders()
    drawing.add_shared()
    drawing.add_inputs()
    drawing.add_distances()
    drawing.add_forces()
    drawing.add_points()
    drawing.add_vectors()
    drawing.add_tyre()
    return drawing.scene()


class _SpaceSketch(Sketch):
    def __init__(self, poses: Poses):
        super().__init__(poses)
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
        self.names = {name: k for k, name in enumerate(poses.names)}
        self.arrows: list[Label] = []
        self.drawn_by = {
            self.add_revolute: ("revolute",),
            self.add_spherical: ("spherical",),
            self.add_crossed: ("constant velocity", "universal"),
            self.add_sliding: ("cylindrical", "prismatic", "screw", "slot"),
            self.add_planar: ("planar",),
            self.add_wheels: ("gear", "internal gear", "bevel gear", "rack and pinion", "rolling"),
            self.add_cable: ("cable",),
        }
        self.labels: list[Label] = []
        blocks = [self.top.blocks[k] for k, _ in self.top.measures]
        holders = [(joint.points, joint.vectors) for joint in self.top.joints]
        holders += [pair for block in blocks for pair in zip(block.points, block.vectors, strict=True)]
        for points, vectors in holders:
            for v in vectors if points else ():
                self.near.setdefault(v, points[0])

    # -- bodies -------------------------------------------------------------------------------------------------

    def add_bodies(self) -> None:
        for k, body in enumerate(self.top.bodies):
            points = list(dict.fromkeys(body.points))
            if self.bodies.moving[k] and len(points) == 1:
                self.add_webs(points[0], sorted(self.bodies.vectors[k]), self.bodies.colours[k])
            if not self.bodies.moving[k] or len(points) < 2:
                continue
            colour, x = self.bodies.colours[k], self.x[0, points]
            if rank(x) < 2:
                order = [points[i] for i in inline(x)]
                edges, role, mesh = list(itertools.pairwise(order)), "bar", _BAR
            else:
                faces, pairs = outline(x)
                columns = tuple(tuple(points[i] for i in face) for face in faces)
                self.items.append(Plate("plate", columns, body=colour))
                edges, role, mesh = [(points[a], points[b]) for a, b in pairs], "edge", _EDGE
            self.links.extend(edges)
            self.items += [segment(role, a, b, mesh, colour) for a, b in edges]

    def add_webs(self, p: int, vectors: list[int], colour: int) -> None:
        """Draw the plate that the unit vectors of a body of one point span, as far as its markers."""
        names = {b.name for b in self.top.bodies if set(b.points) == {p}}
        columns = [self.names[m.name] for m in self.top.markers if m.body in names and m.name in self.names]
        size = float(np.linalg.norm(self.x[0, columns] - self.x[0, p], axis=-1).max(initial=0.0))
        for a, b in itertools.combinations((self.first + v for v in vectors), 2):
            frame = SpaceFrame(p, Way((a,)), Way((b,)))
            _, axes, _ = frame.stand(self.x[0])
            tip = axes @ self.x[0, b]
            turn = np.arctan2(tip[1], tip[0]) * np.linspace(0.0, 1.0, 13 if size else 2)
            rim = [(float(np.cos(t)), float(np.sin(t))) for t in turn]
            around = [(0.0, 0.0), *(((size or _REACH) * x, (size or _REACH) * y) for x, y in rim)]
            corners = tuple((0.0, x, y, 0.0, 0.0, 0.0, 0.0) if size else in_units(x, y, 0.0) for x, y in around)
            self.items.append(Solid("web", frame, two_sided(corners), body=colour))

    def hangs(self, p: int) -> bool:
        """Tell whether everything at a point of the ground hangs down from it, in every pose."""
        others = {b if a == p else a for a, b in self.links if p in (a, b)}
        d = self.x[:, sorted(others)] - self.x[:, p, None]
        # cosine from the vertical, of what hangs from the ground
        return bool(others) and bool((d[..., 2] < -0.5 * np.linalg.norm(d, axis=-1)).all())

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
        return RowReading(tuple(points[:leading]), tuple(ways), tuple(own))

    def way(self, v: int) -> Way:
        """Read a unit vector as a direction."""
        return Way((self.first + v,))

    # -- joints by name -----------------------------------------------------------------------------------------

    def rows_of(self, joint: JointIndex, *kinds: str) -> RowReading | None:
        """Find the first rows of a joint whose kind is called so."""
        named = [rows for rows in self.top.blocks if rows.kind.name.startswith(kinds)]
        mine = ((rows, i) for rows in named for i, owners in enumerate(rows.owners) if joint.owner in owners)
        return next((self.read_instance(rows, i) for rows, i in mine), None)

    def mark_centre(self, joint: JointIndex, kind: str) -> tuple[int, RowReading] | None:
        """Find where a joint about directions is, and its rows; None where that is not known."""
        rows = self.rows_of(joint, kind)
        p = None if rows is None else self.centre(joint, rows)
        if rows is None or p is None:
            return None
        self.axes |= {v: p for v in rows.vectors if v >= 0}
        self.marked.add(p)
        return p, rows

    def centre(self, joint: JointIndex, rows: RowReading) -> int | None:
        """Find the point that a joint makes coincide, or the one that its bodies share."""
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
        return min(set.intersection(*sets), default=None) if sets else None

    def add_revolute(self, joint: JointIndex) -> None:
        """Draw a hinge."""
        if found := self.mark_centre(joint, "parallel"):
            p, rows = found
            self.hinge(p, rows.ways[0])

    def add_spherical(self, joint: JointIndex) -> None:
        """Draw a ball."""
        self.ball(joint.points[0])
        self.marked.update(joint.points)

    def add_crossed(self, joint: JointIndex) -> None:
        """Draw the cross of a universal joint; a large ball for constant velocity."""
        universal = joint.type == "universal"
        found = self.mark_centre(joint, "scalar product" if universal else "constant velocity")
        if found is None:
            return
        p, rows = found
        for way, v in zip(rows.ways, rows.vectors, strict=True) if universal else ():
            colour = self.bodies.colour(vectors=(v,)) if v >= 0 else self.bodies.colour(*way.columns)
            self.items.append(Solid("cross", SpaceFrame(p, way), _ARM, body=colour))
        self.items.append(Ball("ball", p, 0.85 if universal else 1.4))
        self.hanging.add(p)

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
        room = _ONLINE * self.extent()
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
        room, d = _ONLINE * self.extent(), self.direction(axis)
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
        ends = Ring(length=lo, units=-before, thick=_RODS), Ring(length=hi, units=_BEYOND, thick=_RODS)
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
        ways, vectors = list(rows.ways), list(rows.vectors)
        if joint.type == "rolling":  # the line comes first, then the disc's axis
            ways, vectors = ways[::-1], vectors[::-1]
        for p, axis, v, (radius, _) in zip(rows.points, ways, vectors, self.radii(joint.owner), strict=False):
            holder = self.bodies.holding(p, vectors=() if v < 0 else (v,))
            colour = self.bodies.colour(p) if holder is None else self.bodies.colours[holder]
            wheel = revolve(tuple(Ring(units=side, radius=radius) for side in (-0.45, 0.45)), 40)
            self.items.append(Solid("wheel", SpaceFrame(p, axis), wheel, body=colour))

    # -- joints by what bodies share ----------------------------------------------------------------------------

    def add_shared(self) -> None:
        """Draw what holds bodies that meet at a point: a hinge if they share an axis too, else a ball."""
        x = self.x[0]
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
            shared = (q for a, b in pairs for q in sorted(a[0] & b[0] - {p}))
            other = next((q for q in shared if np.abs(x[q] - x[p]).max() > 0), None)
            if vector is not None:
                self.hinge(p, self.way(vector))
                self.axes.setdefault(vector, p)
            elif other is not None:
                self.hinge(p, Way((p, other)), _KNUCKLE)
            else:
                self.ball(p)

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
        ends = {p for _, rows in found for p in rows.points} - self.marked
        free = {p for p in ends if len({group for *_, group in self.bodies.meeting(p)}) < 2}  # nothing else is there
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
        for word, _, points, measure in self.forces():
            if measure is not None:
                block, instance, angle = measure
                ways = self.read_instance(block, instance).ways
                if angle and word in _ABOUT and len(ways) > 1:  # distances are drawn already
                    frame = SpaceFrame(self.vertex(ways[0], ways[-1]), ways[0], ways[-1])
                    self.items += [Solid(role, frame, mesh) for role, mesh in _ABOUT[word]]
            elif word in _BETWEEN and len(points) == 2 and tuple(sorted(points)) not in sprung:
                a, b = points
                self.items += [segment(role, a, b, mesh) for role, mesh in _BETWEEN[word]]
                self._support(a, b)

    # -- points and vectors -------------------------------------------------------------------------------------

    def add_points(self) -> None:
        for p in range(len(self.top.points)):
            if self.bodies.ground[p]:
                if p in self.supported:
                    shift = self.shifts.get(p, 0.0)
                    mesh = stand(2.9 + shift, 1.5) if shift else _STAND
                    self.items.append(Solid("support", SpaceFrame(p, _DOWN if self.hangs(p) else _UP), mesh))
                elif p not in self.marked:
                    self.items.append(Ball("ground ball", p, 0.5))
            elif p not in self.marked:
                self.items.append(Ball("dot", p, 0.78, body=self.bodies.colour(p)))
        for k in range(len(self.top.points), len(self.poses.names)):
            self.items.append(Solid("marker", SpaceFrame(k, _ALONG, _ACROSS), _CROSS))
            origin = next(m.origin for m in self.top.markers if m.name == self.poses.names[k])
            self.items.append(segment("reference", origin, k, _THREAD))

    def add_vectors(self) -> None:
        for v, name in enumerate(self.poses.directions):
            column = self.first + v
            fixed = v < len(self.top.vectors) and bool(self.bodies.still[v])
            at, body = self._carrier(v)
            role = "ground axis" if fixed else "axis"
            further, start = self.ends.get(v, (0.0, 0.0)) if at == self.axes.get(v) else (0.0, 0.0)
            if not further and self._along_a_bar(at, column):
                start = -_REACH - 2.2
            mesh = arrow(_REACH, _SHAFT, _HEAD, start, further) if further or start else _AXIS
            self.items.append(Solid(role, SpaceFrame(at, Way((column,))), mesh, body=INK if fixed else body))
            reach = start + _REACH if start >= 0 else start
            self.arrows.append(Label(at, symbol(name), way=Way((column,)), reach=reach, further=further))

    def _along_a_bar(self, at: int, column: int) -> bool:
        """Tell whether an arrow at a point would lie inside a bar; then it stands on the other side."""
        d = self.x[0, column]
        ways = [self.x[0, b if a == at else a] - self.x[0, at] for a, b in self.links if at in (a, b)]
        cosines = [float(w @ d) / max(float(np.linalg.norm(w) * np.linalg.norm(d)), 1e-300) for w in ways]
        return any(c > 0.96 for c in cosines) and not any(c < -0.96 for c in cosines)

    def _carrier(self, v: int) -> tuple[int, int]:
        """Find the point at which a direction is shown, and the colour of the body that carries it."""
        if v >= len(self.top.vectors):
            marker = next(m for m in self.top.markers if m.name == self.poses.directions[v])
            k = [b.name for b in self.top.bodies].index(marker.body)
            return self.top.bodies[k].points[0], self.bodies.colours[k]
        owners = [k for k, held in enumerate(self.bodies.vectors) if v in held]
        moving = [k for k in owners if self.bodies.moving[k]]
        colour = self.bodies.colours[moving[0]] if moving else INK
        if v in self.axes:
            return self.axes[v], colour
        for k in moving or owners:
            free = [p for p in self.top.bodies[k].points if p not in self.marked]
            return (free or list(self.top.bodies[k].points))[0], colour
        ground = np.flatnonzero(self.bodies.ground).tolist()
        return self.near.get(v, ground[0] if ground else 0), colour

    # -- the tyre -----------------------------------------------------------------------------------------------------

    def add_tyre(self) -> None:
        """Draw the wheel of a suspension with the usual names, and its road.

        The tyre is a shell about the spin axis, as wide as a car's tyre of its radius, which is the distance from the
        wheel's centre to where the road is drawn to be touched. The road is a level plate there, which rises with the
        wheel as that of a test rig does.
        """
        columns = {name: k for k, name in enumerate((*self.poses.names, *self.poses.directions))}
        names = usual(columns)
        if names is None or names.contact not in columns:
            return
        centre, contact = columns[names.wheel_centre], columns[names.contact]
        radius = float(np.linalg.norm(self.x[0, contact] - self.x[0, centre]))
        if not radius > 0:
            return
        line = (names.spin_axis,) if isinstance(names.spin_axis, str) else names.spin_axis
        half = 0.5 * 0.62 * radius  # 0.62 of the loaded radius: 195/65 R 15 has 195 mm on 310 mm
        side = [(-half * along, radius * out) for along, out in _TYRE_PROFILE]
        profile = (*side, *((-along, out) for along, out in reversed(side)))
        around = ((1, 1), (-1, 1), (-1, -1), (1, -1))
        plates = (
            two_sided(tuple((0.0, 0.0, radius * length * x, radius * width * y, 0.0, 0.0, 0.0) for x, y in around))
            for length, width in (_ROAD, _PRINT)
        )
        spin = Way(tuple(columns[name] for name in line))
        self.items.append(Solid("tyre", SpaceFrame(centre, spin), Mesh((Shell(profile, 40),))))
        self.items.append(Solid("road", SpaceFrame(contact, _UP, _ALONG), join(*plates)))

    def scene(self) -> SpaceScene:
        trade = number_names((*self.poses.names, *self.poses.directions))
        names = tuple(
            Label(p, f"{name} {trade[name]}" if name in trade else name) for p, name in enumerate(self.poses.names)
        )
        places, colours = tuple(range(len(self.poses.names))), self.bodies.column_colours()
        extents = np.concatenate([np.zeros((0, 3)), *self.extents])
        labels = (*names, *self.arrows, *self.labels)
        shown = tuple((arrow.at, *arrow.way.columns) for arrow in self.arrows if arrow.way)
        return SpaceScene(tuple(self.items), labels, places, extents, colours, tuple(self.links), shown)


def _triple(x: np.ndarray) -> tuple[float, float, float]:
    """Write three numbers as what a frame or a direction takes."""
    a, b, c = x.tolist()
    return a, b, c
