"""Scene of a planar mechanism: the bar, block, guide, wheel or pin that an engineer would draw for body and joint."""

from collections import defaultdict

import numpy as np

from jaxnc.forces import COUPLE, EFFORT
from jaxnc.solvers.assembly import derive
from jaxnc.system.identity import Owner
from jaxnc.system.topology import BodyIndex, JointIndex
from jaxnc.viz.bodies import FLAT, Bodies, hull
from jaxnc.viz.poses import Poses
from jaxnc.viz.scene import (
    Arc,
    Casing,
    Circle,
    Frame,
    Hatch,
    Item,
    Label,
    Line,
    Scene,
    Span,
    Stamp,
    Vertex,
    least_angle,
)
from jaxnc.viz.style import INK, symbol

_BLOCK = (2.3, 1.45)  # half length and half height of a slider block, units
_PIVOT = (1.9, 3.0)  # half width and height of a ground pivot's triangle, units


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


class _PlaneSketch:
    def __init__(self, poses: Poses):
        self.poses, self.top = poses, poses.topology
        self.x = poses.places[poses.extent_poses]
        bodies = Bodies(poses)
        self.fixed, self.ground, self.half = bodies.fixed, bodies.ground, bodies.half
        self.holding, self.colour = bodies.holding, bodies.colour
        self.bodies, self.colours = bodies, bodies.colour_by_name
        self.items: list[Item] = []
        self.meet: dict[int, set] = defaultdict(set)  # what is joined at a point
        self.pins: set[int] = set()  # drawn as a pin in any case
        self.used: set[int] = set()  # points in view for another reason
        self.blocks: dict[int, tuple[Frame, int]] = {}
        self.guides: dict[tuple, list] = {}
        self.lengths: list[Label] = []  # names of driven distances

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
        order = hull(x)
        d = x[:, None] - x[None]
        i, j = np.unravel_index(int((d**2).sum(axis=-1).argmax()), d.shape[:2])
        along = x[j] - x[i]
        size = float(np.hypot(*along))
        across = np.abs((x - x[i]) @ np.array([-along[1], along[0]])) / max(size, 1e-300)
        if len(order) < 3 or across.max() <= FLAT * size:
            rank = np.argsort((x - x[i]) @ along, kind="stable")
            line = tuple(points[rank].tolist())
            return Line("bar", line, body=colour)
        return Line("plate", tuple(points[order].tolist()), closed=True, body=colour)

    # -- joints -------------------------------------------------------------------------------------------------

    def add_joints(self) -> None:
        draw = {
            "revolute": self.add_revolute,
            "prismatic": self.add_prismatic,
            "slot": self.add_slot,
            "gear": self.add_gear,
            "internal gear": self.add_gear,
            "rolling": self.add_rolling,
            "cable": self.add_cable,
        }
        for joint in self.top.joints:
            if joint.drawn and joint.type in draw:
                draw[joint.type](joint)

    def add_revolute(self, joint: JointIndex) -> None:
        a, b = joint.points
        both = self.meet[a] | self.meet[b] | {("revolute", joint.name)}
        self.meet[a], self.meet[b] = both, set(both)
        self.pins.update((a, b))

    def add_slot(self, joint: JointIndex) -> None:
        a, b, pin = joint.points
        frame = Frame(a, (a, b))
        self.pins.add(pin)
        slider = next((body for body in self.top.bodies if body.points == (pin,)), None)
        if self.ground[[a, b]].all():
            self.guide((a, b), frame, self.along(pin, a, b), (pin, 0.0))
            self.blocks[pin] = (Frame(pin, (a, b)), self.colours.get(slider.name, INK) if slider else INK)
            return
        if slider is not None and slider.base == (a, b):
            self.blocks[pin] = (Frame(pin, (a, b)), self.colours.get(slider.name, INK))
            if self.holding(a, b) is None:
                self.items.append(Line("centre line", (a, b)))
            return
        t = self.along(pin, a, b)
        lo, hi = float(t.min()), float(t.max())
        if hi - lo <= 1e-9 * max(1.0, abs(hi)) and self.poses.single:  # one pose says nothing of the stroke
            size = float(np.hypot(*(self.x[0, b] - self.x[0, a])))
            lo, hi = min(lo, 0.15 * size), max(hi, 0.85 * size)
        body = self.colour(a, b)
        ends: tuple[Vertex, ...] = ((lo, -1.3, 0.0), (hi, 1.3, 0.0))
        slides = ((pin, 0.0),)
        self.items.append(Stamp("slotted bar", frame, ends, closed=False, reach=slides, body=body))
        self.items.append(Stamp("channel", frame, ends, closed=False, reach=slides, body=body))

    def add_prismatic(self, joint: JointIndex) -> None:
        a, b, c, d = joint.points
        if self.ground[[a, b]].all():
            self.guide((a, b), Frame(a, (a, b)), self.along(c, a, b), (c, 0.0))
        elif self.holding(a, b) is None:
            self.items.append(Line("centre line", (a, b)))
            self.used.update((a, b))
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

    def add_rolling(self, joint: JointIndex) -> None:
        a, b, centre, contact, rim = joint.points
        radius = float(np.median(np.hypot(*(self.x[:, centre] - self.x[:, contact]).T)))
        self.items.append(Circle("disc", centre, radius, span=(centre, contact), body=self.colour(centre, rim)))
        self.used.update((centre, contact))
        if self.ground[[a, b]].all():
            d, w = self.x[0, b] - self.x[0, a], self.x[0, centre] - self.x[0, a]
            side = -1 if d[0] * w[1] - d[1] * w[0] > 0 else 1
            t = self.along(contact, a, b)
            reach = np.array([t.min() - 0.6 * radius, t.max() + 0.6 * radius])
            self.guide((a, b, "rolling"), Frame(a, (a, b)), reach, (contact, 0.6 * radius), offset=0.0, side=side)
        elif self.holding(a, b) is None:
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
        self,
        key: tuple,
        frame: Frame,
        reach: np.ndarray,
        slides: tuple[int, float],
        offset: float | None = None,
        side: int = 0,
    ) -> None:
        """Note a hatched guide over a range along a frame fixed to the ground; ranges of one line are joined."""
        lo, hi, old = float(reach.min()), float(reach.max()), ()
        if key in self.guides:
            _, low, high, _, _, old = self.guides[key]
            lo, hi = min(lo, low), max(hi, high)
        self.guides[key] = [frame, lo, hi, offset, side, (*old, slides)]

    def add_sliders(self) -> None:
        """Draw blocks of points fixed in one coordinate, and of bodies of one point."""
        for p in np.flatnonzero(self.half).tolist():
            moves = 0 if self.fixed[p, 1] else 1
            level = float(self.x[0, p, 1 - moves])
            at = (0.0, level) if moves == 0 else (level, 0.0)
            angle = 0.0 if moves == 0 else np.pi / 2
            self.guide((moves, level), Frame(at, angle=angle), self.x[:, p, moves], (p, 0.0))
            body = next((b for b in self.top.bodies if b.points == (p,)), None)
            self.blocks[p] = (Frame(p, angle=angle), self.colours.get(body.name, INK) if body else INK)
            if any(p in b.points and not self.half[list(b.points)].all() for b in self.top.bodies):
                self.meet[p].add("guide")
        for body in self.top.bodies:
            p = body.points[0]
            if len(body.points) == 1 and p not in self.blocks and body.name in self.colours:
                frame = Frame(p) if body.base is None else Frame(p, body.base)
                self.blocks[p] = (frame, self.colours[body.name])
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
                self.add_cylinder(*points)
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
        first = Frame(vertex) if start is None else Frame(vertex, (start[0], start[1]))
        self.items.append(Stamp("reference", first, ((0.0, 1.2, 0.0), (0.0, 7.0, 0.0)), closed=False))
        way = None if start is None else (start[0], start[1])
        self.items.append(Arc("arc", vertex, way, (to[0], to[1]), 5.2, symbol(name), least_angle(values)))

    def add_cylinder(self, a: int, b: int) -> None:
        shortest = float(np.hypot(*(self.x[:, b] - self.x[:, a]).T).min())
        frame = Frame(a, (a, b))
        end = 0.78 * shortest
        tube = ((0.0, 1.4, -1.25), (end, 0.0, -1.25), (end, 0.0, 1.25), (0.0, 1.4, 1.25))
        self.items.append(Line("rod", (a, b)))
        self.items.append(Stamp("cylinder", frame, tube))
        for p in (a, b):
            self.meet[p].add("cylinder")

    # -- forces -------------------------------------------------------------------------------------------------

    def add_forces(self) -> None:
        """Draw springs, dampers and stops between points and on coordinates; torques."""
        loads, beside = self.top.loads, defaultdict(int)
        for block in loads.forces:
            word = block.kind.name.split()[-1]  # of "coordinate spring", and of a user's "leaf spring", a spring
            for k in range(len(block.names)):
                ends, scalars = block.points[k], block.scalars[k]
                angle = None
                if scalars:
                    ends, angle = self.measured_points(scalars[0])
                    if block.kind == EFFORT and angle is not None:
                        self.items.extend(_torque_symbol(angle))
                        continue
                if block.kind == COUPLE:
                    self.items.extend(_torque_symbol(ends, 0.5))
                elif angle is not None and word == "spring":
                    self.items.append(_spiral_symbol(angle))
                elif angle is not None and word == "damper":
                    self.items.append(Span("dashpot", angle, _arc_symbol(2.4, 0.6, 5.6)))
                elif len(ends) == 2 and ends[0] != ends[1]:
                    both = (min(ends), max(ends))
                    if word in _BETWEEN:
                        self.items.extend(_BETWEEN[word](both, (0.0, 3.0, -3.0, 6.0)[beside[both] % 4]))
                        beside[both] += 1
                        self.used.update(both)
        for function in loads.functions:
            angle = self.measured_points(function.at)[1] if function.acts == "effort" else None
            if angle is not None:
                self.items.extend(_torque_symbol(angle))

    def measured_points(self, coordinate: int) -> tuple[tuple[int, ...], tuple[int, int] | None]:
        """Find the points of an angle or distance, by its place among the coordinates; the arm of an angle."""
        k = coordinate - 2 * len(self.top.points)
        if k < 0:
            return (), None
        block, instance = self.top.measures[k]
        points = self.top.blocks[block].points[instance]
        return points, (points[-2], points[-1]) if self.top.angles[k] else None

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
        points = len(self.top.points)
        colours = [self.colour(p) for p in range(points)]
        colours += [self.colours.get(m.body, INK) for m in self.top.markers]
        return Scene(tuple(items), labels, visible, ends, tuple(colours))


# -- symbols of forces -----------------------------------------------------------------------------------------------


def _arc_symbol(
    radius: float, first: float, last: float, share: float = 0.0, growth: float = 0.0
) -> tuple[Vertex, ...]:
    """Draw an arc about one end of a span, or about a place between, units; its radius may grow, for a spiral."""
    turn = np.linspace(first, last, 2 + round(9 * (last - first)))
    r = radius + growth * (turn - first)
    return tuple((share, float(x), float(y)) for x, y in zip(r * np.cos(turn), r * np.sin(turn), strict=True))


def _torque_symbol(arm: tuple[int, ...], share: float = 0.0) -> list[Item]:
    """Draw the arrow of a torque, counter-clockwise."""
    ends, r, tip = (arm[0], arm[1]), 3.4, 5.2
    way = np.array([-np.sin(tip), np.cos(tip)])
    at, out = r * np.array([np.cos(tip), np.sin(tip)]), np.array([np.cos(tip), np.sin(tip)])
    head = [at + 1.5 * way, at - 0.75 * out - 0.3 * way, at + 0.75 * out - 0.3 * way]
    corners = tuple((share, float(x), float(y)) for x, y in head)
    return [Span("torque", ends, _arc_symbol(r, 0.8, tip, share)), Span("torque head", ends, corners, closed=True)]


def _spiral_symbol(arm: tuple[int, int]) -> Item:
    """Draw a spring that turns about the start of an arm."""
    return Span("spring", arm, _arc_symbol(1.5, 0.0, 4.5 * np.pi, growth=0.13))


def _coil_symbol(ends: tuple[int, int], beside: float) -> list[Item]:
    """Draw a spring between two points, some units beside their line."""
    coils, height = 6, 1.25
    shares = 0.2 + 0.6 * (np.arange(2 * coils) + 0.5) / (2 * coils)
    zigzag = [(float(s), 0.0, beside + height * (1 if k % 2 else -1)) for k, s in enumerate(shares)]
    lead = [(0.0, 0.0, 0.0), (0.06, 0.0, beside), (0.2, 0.0, beside)]
    back = [(0.8, 0.0, beside), (0.94, 0.0, beside), (1.0, 0.0, 0.0)]
    return [Span("spring", ends, (*lead, *zigzag, *back))]


def _dashpot_symbol(ends: tuple[int, int], beside: float) -> list[Item]:
    """Draw a damper between two points: a piston in a cylinder."""
    h, y = 1.1, beside
    rod = ((0.0, 0.0, 0.0), (0.06, 0.0, y), (0.5, 0.0, y), (0.5, 0.0, y + 0.8 * h), (0.5, 0.0, y - 0.8 * h))
    case = ((0.35, 0.0, y + h), (0.66, 0.0, y + h), (0.66, 0.0, y - h), (0.35, 0.0, y - h))
    tail = ((0.66, 0.0, y), (0.94, 0.0, y), (1.0, 0.0, 0.0))
    return [Span("dashpot", ends, part) for part in (rod, case, tail)]


def _stop_symbol(ends: tuple[int, int], beside: float) -> list[Item]:
    """Draw a stop between two points: a rod and the plate that it meets."""
    y = beside
    rod = ((0.0, 0.0, 0.0), (0.06, 0.0, y), (0.46, 0.0, y))
    plate = ((0.54, 0.0, y + 1.4), (0.54, 0.0, y - 1.4), (0.54, 0.0, y), (0.94, 0.0, y), (1.0, 0.0, 0.0))
    return [Span("dashpot", ends, rod), Span("dashpot", ends, plate)]


_BETWEEN = {"spring": _coil_symbol, "damper": _dashpot_symbol, "stop": _stop_symbol}
"""What is drawn between two points, by the last word in the name of a kind of force."""
