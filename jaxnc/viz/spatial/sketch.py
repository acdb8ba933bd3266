"""Scene of a spatial mechanism: the bar, plate, hinge, ball, sleeve or axis that is drawn for each part."""

import itertools

import numpy as np

from jaxnc.vehicle.hardpoints import number_names, usual
from jaxnc.viz.bodies import inline, outline, rank
from jaxnc.viz.poses import Poses
from jaxnc.viz.scene import Label
from jaxnc.viz.spatial.loads import Loads
from jaxnc.viz.spatial.mesh import PARTS, arrow, in_units, join, line, lines, shell, stand, tube, two_sided
from jaxnc.viz.spatial.scene import Ball, Plate, Solid, SpaceFrame, SpaceScene, Way, segment
from jaxnc.viz.style import INK, symbol

_BAR = tube(0.52, PARTS)
_EDGE = tube(0.3, PARTS, 8)
_SHAFT, _HEAD, _REACH = 0.17, 0.62, 8.0  # of a unit vector, units
_AXIS = arrow(_REACH, _SHAFT, _HEAD)
_STAND = stand(2.9, 1.5)
_CROSS = lines([(in_units(*-way), in_units(*way)) for way in np.eye(3)])
_THREAD = line(6)
_ALONG, _ACROSS = Way(fixed=(1.0, 0.0, 0.0)), Way(fixed=(0.0, 1.0, 0.0))
_UP, _DOWN = Way(), Way(fixed=(0.0, 0.0, -1.0))
_TYRE_PROFILE = ((0.84, 0.63), (0.98, 0.74), (1.0, 0.85), (0.86, 0.97), (0.5, 1.0))  # shares of half width and radius
_PAD, _PATCH = (0.75, 0.55), (0.2, 0.24)  # half lengths and widths of the road and of the tyre's print, in radii


def sketch_space(poses: Poses) -> SpaceScene:
    """Make the scene of a motion in space, its labels not yet placed.

    Extents of rails follow from its right poses.
    """
    drawing = _SpaceSketch(poses)
    drawing.add_bodies()
    drawing.add_listed()
    drawing.add_sliders()
    drawing.add_shared()
    drawing.add_inputs()
    drawing.add_distances()
    drawing.add_forces()
    drawing.add_points()
    drawing.add_vectors()
    drawing.add_tyre()
    return drawing.scene()


class _SpaceSketch(Loads):
    def __init__(self, poses: Poses):
        super().__init__(poses)
        self.names = {name: k for k, name in enumerate(poses.names)}
        self.arrows: list[Label] = []

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
            for length, width in (_PAD, _PATCH)
        )
        spin = Way(tuple(columns[name] for name in line))
        self.items.append(Solid("tyre", SpaceFrame(centre, spin), shell(profile, 40)))
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
