"""Scene of a planar mechanism: the bar, block, guide, wheel or pin that an engineer would draw for body and joint."""

from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from jaxnc.forces import COUPLE
from jaxnc.solvers.assembly import derive
from jaxnc.system.identity import Owner
from jaxnc.system.topology import Block, BodyIndex, JointIndex
from jaxnc.viz.bodies import FLAT, Bodies, hull, inline
from jaxnc.viz.poses import Poses
from jaxnc.viz.scene import Arc, Casing, Circle, Frame, Hatch, Item, Label, Line, Scene, Span, Stamp, least_angle
from jaxnc.viz.style import INK, symbol

_BLOCK = (2.3, 1.45)  # half length and half height of a slider block, units
_PIVOT = (1.9, 3.0)  # half width and height of a ground pivot's triangle, units


class Sketch:
    """A scene of a motion, in the plane or in space, that is put together part by part."""

    drawn_by: dict[Callable[[JointIndex], None], tuple[str, ...]]
    """The methods that draw joints, and the types that each draws."""

    def __init__(self, poses: Poses):
        self.poses, self.top, self.bodies = poses, poses.topology, Bodies(poses)
        self.x = poses.every_column[poses.extent_poses]  # (T, columns, dim)
        self.items: list[Any] = []

    def add_joints(self) -> None:
        """Draw joints that the mechanism lists."""
        for joint in self.top.joints:
            for add, types in self.drawn_by.items():
                if joint.drawn and joint.type in types:
                    add(joint)

    def forces(self) -> Iterator[tuple[str, object, tuple[int, ...], tuple[Block, int, bool] | None]]:
        """List forces: a word for each, its kind, its points, and what it acts on in their place: see `measure_of`."""
        for block in self.top.loads.forces:
            word = block.kind.name.split()[-1]  # of "coordinate spring", and of a user's "leaf spring", a spring
            for points, scalars in zip(block.points, block.scalars, strict=True):
                measure = self.measure_of(scalars[0]) if scalars else None
                yield word, block.kind, () if scalars else points, measure
        for function in self.top.loads.functions:
            if function.acts == "effort":
                yield "effort", None, (), self.measure_of(function.at)

    def measure_of(self, coordinate: int) -> tuple[Block, int, bool] | None:
        """Find the rows of an angle or distance, by its place among the coordinates, and whether it is an angle."""
        k = coordinate - (len(self.top.coordinates) - len(self.top.scalars))
        if k < 0:
            return None
        block, instance = self.top.measures[k]
        return self.top.blocks[block], instance, self.top.angles[k]

    def radii(self, owner: Owner) -> list[tuple[float, int]]:
        """Find the radii of a gear pair or a disc, each with its place among the numbers of the equations."""
        eq, first = derive(self.poses.motion.system), 0
        for block, constants in zip(self.top.blocks, eq.constants, strict=True):
            names = [c for c in block.kind.constants if c.startswith("radius")]
            mine = [i for i, owners in enumerate(block.owners) if owner in owners]
            size = len(block.kind.constants) + len(block.kind.rows)
            if names and mine:
                row, at = np.asarray(constants)[mine[0]], [block.kind.constants.index(c) for c in names]
                return [(abs(float(row[k])), first + mine[0] * size + k) for k in at]
            first += block.count * size
        return []


def sketch_plane(poses: Poses) -> Scene:
    """Make the scene of a motion, its labels not yet placed.

    Extents of guides and slots follow from its right poses.
    """
    drawing = _PlaneSketch(poses)
    drawing.add_bodies()
    drawing.add_joints()
    drawing.add_sliders()
    drawing.add_inputs()
    drawing.add_forces()
    drawing.add_points()
    return drawing.scene()


class _PlaneSketch(Sketch):
    def __init__(self, poses: Poses):
        super().__init__(poses)
        self.ground, self.holding, self.colour = self.bodies.ground, self.bodies.holding, self.bodies.colour
        self.colours = self.bodies.colour_by_name
        self.meet: dict[int, set] = defaultdict(set)  # what is joined at a point
        self.pins: set[int] = set()  # drawn as a pin in any case
        self.used: set[int] = set()  # points in view for another reason
        self.blocks: dict[int, tuple[Frame, int]] = {}
        self.guides: dict[tuple, list] = {}
        self.lengths: list[Label] = []  # names of driven distances
        self.sliders: dict[int, BodyIndex] = {}  # bodies of one point, by that point
        for body in self.top.bodies:
            if len(body.points) == 1:
                self.sliders.setdefault(body.points[0], body)
        self.drawn_by = {
            self.add_revolute: ("revolute",),
            self.add_prismatic: ("prismatic",),
            self.add_slot: ("slot",),
            self.add_gear: ("gear", "internal gear"),
            self.add_rolling: ("rolling",),
            self.add_cable: ("cable",),
        }

    # -- bodies -------------------------------------------------------------------------------------------------

    def add_bodies(self) -> None:
        for body, group in zip(self.top.bodies, self.bodies.groups, strict=True):
            if body.name not in self.colours:
                continue
            for p in body.points:
                self.meet[p].add(group)
            if len(body.points) > 1:
                self.items.append(self.shape(body, self.colours[body.name]))
        self.keep_apart()

    def keep_apart(self) -> None:
        """Put longer bars under shorter ones, and keep each apart from those that it crosses."""

        def size(item: Line) -> float:
            return float(np.hypot(*(self.x[0, item.points[-1]] - self.x[0, item.points[0]])))

        lines = [item for item in self.items if isinstance(item, Line)]
        plates = [item for item in lines if item.role == "plate"]
        bars = sorted((item for item in lines if item.role == "bar"), key=size, reverse=True)
        under = [pair for item in plates for pair in zip(item.points, np.roll(item.points, -1).tolist(), strict=True)]
        self.items = [*plates]
        for item in bars:
            ends = item.points[0], item.points[-1]
            over = tuple(pair for pair in under if not self.meeting(pair, ends))
            if over:
                self.items.append(Casing("casing", ends, over))
            self.items.append(item)
            under.append(ends)

    def meeting(self, one: tuple[int, ...], other: tuple[int, ...]) -> bool:
        """Tell whether two segments share a joint."""
        pins = [{p, q} for j in self.top.joints if j.drawn and j.type == "revolute" for p, q in [j.points[:2]]]
        return any(a == b or {a, b} in pins for a in one for b in other)

    def shape(self, body: BodyIndex, colour: int) -> Item:
        """Draw a bar, or a plate over the hull of more points; its markers belong to it as its points do."""
        first = len(self.top.points)
        points = np.array([*body.points, *(first + k for k, m in enumerate(self.top.markers) if m.body == body.name)])
        x = self.x[0, points]
        line, order = inline(x), hull(x)
        along = x[line[-1]] - x[line[0]]
        size = float(np.hypot(*along))
        across = np.abs((x - x[line[0]]) @ np.array([-along[1], along[0]])) / max(size, 1e-300)
        if len(order) < 3 or across.max() <= FLAT * size:
            return Line("bar", tuple(points[line].tolist()), body=colour)
        return Line("plate", tuple(points[order].tolist()), closed=True, body=colour)

    # -- joints -------------------------------------------------------------------------------------------------

    def add_revolute(self, joint: JointIndex) -> None:
        a, b = joint.points
        both = self.meet[a] | self.meet[b] | {("revolute", joint.name)}
        self.meet[a], self.meet[b] = both, set(both)
        self.pins.update((a, b))

    def add_slot(self, joint: JointIndex) -> None:
        a, b, pin = joint.points
        frame = Frame(a, (a, b))
        self.pins.add(pin)
        self.meet[pin].add(("slot", joint.name))
        fixed, slider = self.ground[[a, b]].all(), self.sliders.get(pin)
        if fixed or (slider is not None and slider.base == (a, b)):
            self.blocks[pin] = (Frame(pin, (a, b)), self.block_colour(pin))
            if fixed:
                self.guide((a, b), frame, self.along(pin, a, b), pin)
            elif self.holding(a, b) is None:
                self.items.append(Line("centre line", (a, b)))
            return
        t = self.along(pin, a, b)
        lo, hi = float(t.min()), float(t.max())
        if hi - lo <= 1e-9 * max(1.0, abs(hi)) and self.poses.single:  # one pose says nothing of the stroke
            size = float(np.hypot(*(self.x[0, b] - self.x[0, a])))
            lo, hi = min(lo, 0.15 * size), max(hi, 0.85 * size)
        ends, slides = ((lo, -1.3, 0.0), (hi, 1.3, 0.0)), ((pin, 0.0),)
        for role in ("slotted bar", "channel"):
            self.items.append(Stamp(role, frame, ends, closed=False, reach=slides, body=self.colour(a, b)))

    def add_prismatic(self, joint: JointIndex) -> None:
        a, b, c, d = joint.points
        if self.ground[[a, b]].all():
            self.guide((a, b), Frame(a, (a, b)), self.along(c, a, b), c)
        else:
            self.add_free_line(a, b)
        self.blocks[c] = (Frame(c, (a, b)), self.colour(c, d))

    def add_gear(self, joint: JointIndex) -> None:
        points = joint.points
        wheels = [(points[0], points[1]), (points[2], points[3])]
        found = self.radii(joint.owner)
        radii = [radius for radius, _ in found]
        largest = int(np.argmax(radii)) if joint.type == "internal gear" else -1
        for k, ((centre, rim), (radius, number)) in enumerate(zip(wheels, found, strict=True)):
            colour = self.colour(centre, rim)
            self.items.append(Circle("wheel", centre, radius, number=number, body=colour))
            if k == largest:
                self.items.append(Circle("annulus", centre, radius, 1.6, number=number, body=colour))
            self.used.add(centre)

    def add_rolling(self, joint: JointIndex) -> None:
        a, b, centre, contact, rim = joint.points
        radius = float(np.median(np.hypot(*(self.x[:, centre] - self.x[:, contact]).T)))
        self.items.append(Circle("disc", centre, radius, span=(centre, contact), body=self.colour(centre, rim)))
        self.used.update((centre, contact))
        if self.ground[[a, b]].all():
            d, w = self.x[0, b] - self.x[0, a], self.x[0, centre] - self.x[0, a]
            side = -1 if d[0] * w[1] - d[1] * w[0] > 0 else 1
            t = self.along(contact, a, b)
            self.guide((a, b, "rolling"), Frame(a, (a, b)), t, contact, 0.6 * radius, 0.0, side)
        else:
            self.add_free_line(a, b)

    def add_free_line(self, a: int, b: int) -> None:
        """Draw the line of two points that no body holds."""
        if self.holding(a, b) is None:
            self.items.append(Line("centre line", (a, b)))
            self.used.update((a, b))

    def add_cable(self, joint: JointIndex) -> None:
        self.items.append(Line("cable", joint.points))
        for p in joint.points:
            self.meet[p].add(("cable", joint.name))

    # -- sliding ------------------------------------------------------------------------------------------------

    def along(self, p: int, a: int, b: int) -> np.ndarray:
        """Find the distance of a point from a along the line a-b in every pose, ``(T,)``."""
        d = self.x[:, b] - self.x[:, a]
        size = np.maximum(np.hypot(d[:, 0], d[:, 1]), 1e-300)
        return ((self.x[:, p] - self.x[:, a]) * d).sum(axis=1) / size

    def guide(
        self, key: tuple, frame: Frame, t: np.ndarray, p: int, spare: float = 0.0, offset: float | None = None, side=0
    ) -> None:
        """Note a hatched guide along a fixed frame, where a point slides; those of one line are joined."""
        lo, hi, old = float(t.min()) - spare, float(t.max()) + spare, ()
        if key in self.guides:
            _, low, high, _, _, old = self.guides[key]
            lo, hi = min(lo, low), max(hi, high)
        self.guides[key] = [frame, lo, hi, offset, side, (*old, (p, spare))]

    def block_colour(self, p: int) -> int:
        """Find the colour of the block at a point: that of the body of this point alone."""
        return self.colours.get(self.sliders[p].name, INK) if p in self.sliders else INK

    def add_sliders(self) -> None:
        """Draw blocks of points fixed in one coordinate, and of bodies of one point."""
        for p in np.flatnonzero(self.bodies.half).tolist():
            moves = 0 if self.bodies.fixed[p, 1] else 1
            level = float(self.x[0, p, 1 - moves])
            at = (0.0, level) if moves == 0 else (level, 0.0)
            angle = 0.0 if moves == 0 else np.pi / 2
            self.guide((moves, level), Frame(at, angle=angle), self.x[:, p, moves], p)
            self.blocks[p] = (Frame(p, angle=angle), self.block_colour(p))
            if any(p in b.points and not self.bodies.half[list(b.points)].all() for b in self.top.bodies):
                self.meet[p].add("guide")
        for p, body in self.sliders.items():
            if p not in self.blocks and body.name in self.colours:
                self.blocks[p] = (Frame(p, body.base), self.colours[body.name])
        a, b = _BLOCK
        corners = ((0.0, -a, -b), (0.0, a, -b), (0.0, a, b), (0.0, -a, b))
        for frame, colour in self.blocks.values():
            self.items.append(Stamp("block", frame, corners, body=colour))

    def edges(self) -> tuple[list[Item], np.ndarray]:
        """Draw edges and hatching of all guides, and their ends as places in view."""
        items, ends = [], [np.zeros((0, 2))]
        for frame, lo, hi, offset, side, slides in self.guides.values():
            origin, e = frame.stand(self.x[0])
            side = side or self.free_side(origin, e)
            offset = side * _BLOCK[1] if offset is None else offset
            reach = _BLOCK[0] + 1.7 if offset else 0.0
            line = ((lo, -reach, offset), (hi, reach, offset))
            items.append(Hatch("hatch", frame, (lo, -reach), (hi, reach), offset, side, slides))
            items.append(Stamp("guide", frame, line, closed=False, reach=slides))
            ends.append(np.stack([origin + lo * e, origin + hi * e]))
        return items, np.concatenate(ends)

    def free_side(self, origin: np.ndarray, e: np.ndarray) -> int:
        """Choose the side of a line for its hatching: below, unless nearly everything lies there."""
        below = -1 if e[0] > -1e-9 else 1
        d = self.x - origin
        over = e[0] * d[..., 1] - e[1] * d[..., 0]
        total = np.abs(over).sum()
        return -below if total > 0 and below * over.sum() > 0.55 * total else below

    # -- inputs -------------------------------------------------------------------------------------------------

    def add_inputs(self) -> None:
        """Draw the arrow of a driven angle; a hydraulic cylinder for a driven distance."""
        for name, k, angle, block, instance in self.poses.driven_scalars():
            points = block.points[instance]
            if angle:
                self.add_arc(name, points, self.poses.scalars[self.poses.extent_poses, k])
                continue
            if len(points) == 2 and self.holding(*points) is None and not self.ground[list(points)].all():
                a, b = points
                end = 0.78 * float(np.hypot(*(self.x[:, b] - self.x[:, a]).T).min())
                tube = ((0.0, 1.4, -1.25), (end, 0.0, -1.25), (end, 0.0, 1.25), (0.0, 1.4, 1.25))
                self.items += [Line("rod", (a, b)), Stamp("cylinder", Frame(a, (a, b)), tube)]
                for p in points:
                    self.meet[p].add("cylinder")
            if len(points) > 1 and not self.ground[list(points[:2])].all():
                self.lengths.append(Label(points[0], symbol(name), to=points[1]))
                if len(points) > 2 and self.ground[points[0]]:  # along a guide, which need not begin there
                    self.items.append(Line("reference", points[:2]))
                    self.used.add(points[0])

    def add_arc(self, name: str, points: tuple[int, ...], values: np.ndarray) -> None:
        start, to = (points[:2], points[2:]) if len(points) == 4 else (None, points)
        vertex = to[0]
        if start is not None and vertex not in start:
            return
        way = None if start is None else (start[0], start[1])
        first = Frame(vertex, way)
        self.items.append(Stamp("reference", first, ((0.0, 1.2, 0.0), (0.0, 7.0, 0.0)), closed=False))
        self.items.append(Arc("arc", vertex, way, (to[0], to[1]), 5.2, symbol(name), least_angle(values)))

    # -- forces -------------------------------------------------------------------------------------------------

    def add_forces(self) -> None:
        """Draw springs, dampers and stops between points and on coordinates; torques."""
        beside = defaultdict(int)
        for word, kind, ends, measure in self.forces():
            angle = False
            if measure is not None:
                block, instance, angle = measure
                ends = block.points[instance]
            if kind == COUPLE:
                self.add_about("effort", ends[:2], 0.5)
            elif angle and word in _ABOUT:
                self.add_about(word, ends[-2:])
            elif word in _BETWEEN and len(ends) == 2 and ends[0] != ends[1]:
                both = (min(ends), max(ends))
                aside = (0.0, 3.0, -3.0, 6.0)[beside[both] % 4]
                for role, path in _BETWEEN[word]:
                    corners = tuple((s, 0.0, y + (aside if 0.0 < s < 1.0 else 0.0)) for s, y in path)
                    self.items.append(Span(role, both, corners))
                beside[both] += 1
                self.used.update(both)

    def add_about(self, word: str, arm: tuple[int, ...], share: float = 0.0) -> None:
        """Draw what turns about the start of an arm, or about a place that is a share of the way along it."""
        for role, path in _ABOUT[word]:
            corners = tuple((share, x, y) for x, y in path)
            self.items.append(Span(role, (arm[0], arm[1]), corners, closed=role == "torque head"))

    # -- points -------------------------------------------------------------------------------------------------

    def add_points(self) -> None:
        lines = [j for j in self.top.joints if j.drawn and j.type in ("slot", "prismatic", "rolling")]
        guiding = {p for j in lines for p in j.points[:2]}
        for p in range(len(self.top.points)):
            meeting = self.meet.get(p, set())
            if self.ground[p]:
                if meeting:
                    self.add_pivot(p)
                elif p in self.used:
                    self.items.append(Circle("dot", p, 0.0, 0.55))
                elif p not in guiding:
                    self.items.append(Circle("dot", p, 0.0, 0.5))
                    self.used.add(p)
                continue
            self.used.add(p)
            if p in self.pins or len(meeting) > 1:
                self.items.append(Circle("pin", p, 0.0, 1.0))
            elif p not in self.blocks:
                self.items.append(Circle("dot", p, 0.0, 0.72, body=self.colour(p)))
        for k, marker in enumerate(self.top.markers):
            column = len(self.top.points) + k
            frame = Frame(column, marker.base)
            for cross in (((0.0, -1.0, 0.0), (0.0, 1.0, 0.0)), ((0.0, 0.0, -1.0), (0.0, 0.0, 1.0))):
                self.items.append(Stamp("marker", frame, cross, closed=False))
            self.used.add(column)

    def add_pivot(self, p: int) -> None:
        w, h = _PIVOT
        frame = Frame(p)
        self.items.append(Stamp("support", frame, ((0.0, 0.0, 0.0), (0.0, -w, -h), (0.0, w, -h))))
        self.items.append(Stamp("guide", frame, ((0.0, -w - 0.9, -h), (0.0, w + 0.9, -h)), closed=False))
        self.items.append(Hatch("hatch", frame, (0.0, -w - 0.9), (0.0, w + 0.9), -h, -1))
        self.items.append(Circle("ground pin", p, 0.0, 1.0))
        self.used.add(p)

    def scene(self) -> Scene:
        edges, ends = self.edges()
        items = sorted([*edges, *self.items], key=lambda item: item.style.layer)
        visible = tuple(sorted(self.used)) or tuple(range(len(self.poses.names)))
        labels = tuple(Label(p, self.poses.names[p]) for p in visible) + tuple(self.lengths)
        return Scene(tuple(items), labels, visible, ends, self.bodies.column_colours())


# -- symbols of forces -----------------------------------------------------------------------------------------------


def _arc_path(radius: float, first: float, last: float, growth: float = 0.0) -> list[tuple[float, float]]:
    """Lay out an arc about the origin, units; its radius may grow, for a spiral."""
    turn = np.linspace(first, last, 2 + round(9 * (last - first)))
    r = radius + growth * (turn - first)
    return list(zip((r * np.cos(turn)).tolist(), (r * np.sin(turn)).tolist(), strict=True))


def _head_path(radius: float, angle: float) -> list[tuple[float, float]]:
    """Lay out the head of an arrow that turns about the origin, units."""
    out, way = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    corners = [radius * out + t * way + r * out for t, r in ((1.5, 0.0), (-0.3, -0.75), (-0.3, 0.75))]
    return [(float(x), float(y)) for x, y in corners]


_COILS = [(0.2 + 0.05 * (k + 0.5), 1.25 if k % 2 else -1.25) for k in range(12)]
_BETWEEN = {
    "spring": [
        ("spring", [(0.0, 0.0), (0.06, 0.0), (0.2, 0.0), *_COILS, (0.8, 0.0), (0.94, 0.0), (1.0, 0.0)]),
    ],
    "damper": [
        ("dashpot", [(0.0, 0.0), (0.06, 0.0), (0.5, 0.0), (0.5, 0.88), (0.5, -0.88)]),
        ("dashpot", [(0.35, 1.1), (0.66, 1.1), (0.66, -1.1), (0.35, -1.1)]),
        ("dashpot", [(0.66, 0.0), (0.94, 0.0), (1.0, 0.0)]),
    ],
    "stop": [
        ("dashpot", [(0.0, 0.0), (0.06, 0.0), (0.46, 0.0)]),
        ("dashpot", [(0.54, 1.4), (0.54, -1.4), (0.54, 0.0), (0.94, 0.0), (1.0, 0.0)]),
    ],
}
"""What is drawn between two points, by the last word in the name of a kind of force: shares of the way, and units
across."""

_ABOUT = {
    "spring": [("spring", _arc_path(1.5, 0.0, 4.5 * np.pi, 0.13))],
    "damper": [("dashpot", _arc_path(2.4, 0.6, 5.6))],
    "stop": [
        ("dashpot", _arc_path(2.4, 0.6, 2.8)),
        ("dashpot", [*((r * np.cos(3.3), r * np.sin(3.3)) for r in (1.2, 3.6)), *_arc_path(2.4, 3.3, 5.6)]),
    ],
    "effort": [("torque", _arc_path(3.4, 0.8, 5.2)), ("torque head", _head_path(3.4, 5.2))],
}
"""What is drawn about the vertex of an angle, likewise: units along its arm and across."""
