"""Velocity and acceleration polygons: vectors from a pole, images of bodies, and what vectors are put together from."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.viz.annotations import place_labels
from jaxnc.viz.bodies import Bodies, hull
from jaxnc.viz.drawing import PlaneView
from jaxnc.viz.pen import Pen
from jaxnc.viz.picture import Size, finish, inches
from jaxnc.viz.poses import Poses, poses
from jaxnc.viz.scene import Circle, Item, Label, Line, Scene
from jaxnc.viz.style import INK, LIGHT, colour_of, symbol
from jaxnc.viz.view import Legend

_SHORT = 1e-3  # of it: parts shorter than this are not drawn
KINDS = ("velocity", "acceleration")


class _Polygon:
    """A polygon: places in the plane of velocities (order 1) or accelerations (order 2) of a motion in one pose."""

    def __init__(self, data: Poses, pose: int, order: int):
        self.data, self.pose, self.order = data, pose, order
        self.places = [np.zeros(2)]  # ends of vectors
        self.names = [["o"]]  # what they are the image of
        self.sides: list[tuple[tuple[int, ...], int]] = []  # images of bodies: numbers of places, colour
        # arrows that a vector is put together from: start, end, colour, kind
        self.parts: list[tuple[np.ndarray, np.ndarray, int, str]] = []
        x = data.rates(order)[pose]
        self.longest = float(np.linalg.norm(x, axis=1).max(initial=0.0))
        self.found = Bodies(data).colour_by_name
        self.numbers = [self.image(v, name) for v, name in zip(x, data.names, strict=True)]
        for body in data.topology.bodies:
            if body.name in self.found and len(body.points) > 1:
                self._body(body)
        for joint in data.topology.joints:
            if joint.type == "slot":
                self._guide(*joint.points)

    def image(self, vector: np.ndarray, name: str) -> int:
        """Number of the place that is the image of a point."""
        for k, other in enumerate(self.places):
            if np.linalg.norm(vector - other) <= 1e-6 * self.longest:  # images that are closer are one
                self.names[k].append(name)
                return k
        self.places.append(np.asarray(vector, float))
        self.names.append([name])
        return len(self.places) - 1

    def spin(self, body: str) -> tuple[float, float]:
        """Find the angular velocity and acceleration."""
        motion, k = self.data.motion, ... if self.data.single else self.pose
        rise = np.asarray(motion.angular_acceleration(body))[k] if self.order == 2 else 0.0
        return float(np.asarray(motion.angular_velocity(body))[k]), float(rise)

    def part(self, start: np.ndarray, way: np.ndarray, body: int, kind: str) -> np.ndarray:
        """Add an arrow that is a part of a vector; returns where it ends."""
        if np.linalg.norm(way) > _SHORT * self.longest:
            self.parts.append((start, start + way, body, kind))
        return start + way

    def _body(self, body) -> None:
        top, places = self.data.topology, self.data.places[self.pose]
        points = [*body.points]
        riding = {m.name for m in top.markers if m.body == body.name}
        every = points + [k for k, name in enumerate(self.data.names) if name in riding]
        order = [every[k] for k in hull(places[every])] if len(every) > 2 else every
        order = order if len(order) > 1 else every
        ends = tuple(dict.fromkeys(self.numbers[k] for k in order))
        if len(ends) > 2 or (len(ends) == 2 and 0 not in ends):  # otherwise the vector itself is the image
            self.sides.append((ends, self.found[body.name]))
        if self.order == 1:
            return
        rate, rise = self.spin(body.name)
        still = [k for k in points if self.numbers[k] == 0]
        base = (still or points)[0]
        for k in points:
            arm = places[k] - places[base]
            # the vector is the normal part, which is not drawn again
            whole = base in still and abs(rise) * np.hypot(*arm) <= _SHORT * self.longest
            if k != base and not whole:
                start = self.places[self.numbers[base]]
                middle = self.part(start, -rate * rate * arm, self.found[body.name], "normal")
                self.part(middle, rise * np.array([-arm[1], arm[0]]), self.found[body.name], "tangential")

    def _guide(self, p: int, q: int, at: int) -> None:
        """Add a point that slides on a moving line: that of the line below it, Coriolis's part and the sliding."""
        top = self.data.topology
        guide = next((b for b in top.bodies if {p, q} <= set(b.points) and b.name in self.found), None)
        if guide is None:
            return
        x = self.data.places[self.pose]
        rate, rise = self.spin(guide.name)
        arm = x[at] - x[p]
        turned = np.array([-arm[1], arm[0]])
        velocity = self.data.rates(1)[self.pose]
        under = velocity[p] + rate * turned
        name = f"{self.data.names[at]} of {guide.name}"
        if self.order == 1:
            self.image(under, name)
            self.part(under, velocity[at] - under, INK, "sliding")
            return
        rates = self.data.rates(2)[self.pose]
        below = rates[p] + rise * turned - rate * rate * arm
        slide = velocity[at] - under
        self.image(below, name)
        end = self.part(below, 2 * rate * np.array([-slide[1], slide[0]]), INK, "Coriolis")
        self.part(end, rates[at] - end, INK, "sliding")

    def notes(self) -> list[str]:
        """List what is written under the polygon."""
        still, parts = self.names[0][1:], list(dict.fromkeys(kind for *_, kind in self.parts))
        texts = [f"in the pole o: {', '.join(still)}"] if still else []
        return texts + ([f"dashed: {', '.join(parts)} part{'s' * (len(parts) > 1)}"] if parts else [])

    def scene(self) -> tuple[Scene, np.ndarray]:
        """Make a scene of images and names, and the places of its columns."""
        where, labels = list(self.places), []
        first = len(where)
        for a, b, *_ in self.parts:  # names keep clear of them
            where += [a, b]
        items: list[Item] = [Line("image", ends, closed=len(ends) > 2, body=body) for ends, body in self.sides]
        items += [Line("vector", (first + 2 * k, first + 2 * k + 1)) for k in range(len(self.parts))]
        items += [Line("vector", (0, k)) for k in range(1, len(self.places))]
        items += [Circle("pole", k, units=0.5) for k in range(len(self.places))]
        mark = "′" if self.order == 2 else ""
        for k, names in enumerate(self.names):
            small = [name[:1].lower() + name[1:] if len(name) < 4 else name for name in (names if k else names[:1])]
            labels.append(Label(k, ", ".join(name + mark for name in small)))
        n = len(where)
        return Scene(tuple(items), tuple(labels), tuple(range(n)), np.zeros((0, 2)), (INK,) * n), np.array(where)


class _PolygonView(PlaneView):
    """Axes of a polygon, as a drawing has them, with one pose."""

    def __init__(self, data: Poses, scene: Scene, where: np.ndarray, notes: list[str]):
        self.data, self.scene, self.shown, self.columns = data, scene, [0], where[None]
        room = 0.07 * float(np.ptp(where, axis=0).max()) * np.array([1.0, 0.4])  # 0.07 of its extents, for names
        self.lower, self.upper = where.min(axis=0) - room, where.max(axis=0) + room
        self.arrow_sets, self.legend = [], Legend(tuple(((text, LIGHT["ink"]),) for text in notes))


@public
def polygon(
    motion: Motion,
    kind: str = "velocity",
    pose: int = 0,
    ax: Axes | None = None,
    path: str | Path | None = None,
    title: str | None = None,
    frame: bool = True,
    size: Size = (6.4, 5.0),
    dpi: float = 200.0,
) -> Figure:
    """Draw the velocity or the acceleration polygon of a planar mechanism in one pose.

    From the pole o a vector goes to the image of every point (in small letters), that is its velocity, or acceleration
    (primed); images of points of the ground lie in the pole. The image of a body is similar to the body. Accelerations
    are put together from normal and tangential parts, of a point that slides on a turning guide from that of the guide
    below it, Coriolis's and the sliding: dashed arrows. The axes have the scale.

    Args:
        motion: a motion with rates, of a planar mechanism.
        kind: ``"velocity"`` or ``"acceleration"``.
        pose: which pose, counted from the end if negative.
        ax: axes to draw into; a figure of its own if not given.
        path: file to write as well: PNG, SVG, PDF or JPG.
        title: heading; the mechanism's name and pose if not given, none if ``""``.
        frame: whether axes with numbers are drawn.
        size: largest width and height of a figure of its own, inches; or its width.
        dpi: dots per inch of a file.

    Raises:
        InputError: a spatial mechanism, no such pose or one that is not right, no rates, everything at rest.
        OutputError: a file that cannot be written.
    """
    if kind not in KINDS:
        raise InputError(f"polygon({kind!r}): a polygon is one of {' or '.join(map(repr, KINDS))}")
    data = poses(motion)
    if data.dim != 2:
        raise InputError(
            f"{data.topology.name!r} is spatial: polygons are of planar mechanisms; draw(velocities=…) in space"
        )
    k = data.pose(pose)
    if not data.good[k]:
        raise InputError(f"pose {k} of {data.topology.name!r} is not right, so it has no {kind}: {data.sentence(k)}")
    order = 1 + KINDS.index(kind)
    plan = _Polygon(data, k, order)
    if not plan.longest > 0:
        raise InputError(f"in pose {k} of {data.topology.name!r} every {kind} is zero: there is no polygon to draw")
    scene, where = plan.scene()
    view = _PolygonView(data, scene, where, plan.notes())
    view.open(ax, inches(size), frame, _default_title(data, k, kind) if title is None else title)
    scene = place_labels(scene, where[None], view.unit)
    Pen(view.ax, scene, where, view.unit, view.points)
    points = view.points
    for end in plan.places[1:]:
        _arrow(view.ax, np.zeros(2), end, LIGHT[kind], 0.4 * points, "-", points, f"{kind} vector")
    for a, b, body, what in plan.parts:
        _arrow(view.ax, a, b, colour_of("body", body), 0.24 * points, (0, (4, 2)), points, what)
    view.legend.paint(view.ax, float(view.paper[0]))
    unit = f"{data.topology.length_unit}/s" + ("²" if order == 2 else "")
    if frame:
        for axis, name in ((view.ax.xaxis, "x"), (view.ax.yaxis, "y")):
            axis.set_label_text(f"{kind} {name} [{unit}]", parse_math=False)
    return finish(view.figure, path, dpi)


def _default_title(data: Poses, pose: int, kind: str) -> str:
    texts = []
    for name, values in data.motion.inputs.items():
        value, top = float(np.asarray(values).reshape(-1)[pose]), data.topology
        if top.is_angle(name):
            texts.append(f"{symbol(name)} = {np.degrees(value):.4g}°")
        else:
            texts.append(f"{symbol(name)} = {value:.4g} {top.length_unit}")
    return f"{data.topology.name}: {'velocities' if kind == 'velocity' else 'accelerations'}, {', '.join(texts)}"


def _arrow(
    ax: Axes, a: np.ndarray, b: np.ndarray, colour: str, width: float, dash: object, points: float, name: str
) -> None:
    look = {"arrowstyle": "-|>", "color": colour, "lw": width, "linestyle": dash, "mutation_scale": 2.4 * points}
    note = ax.annotate(
        "", tuple(b), tuple(a), arrowprops={**look, "shrinkA": 0, "shrinkB": 0, "joinstyle": "miter"}, zorder=3.0
    )
    note.set_gid(name)
