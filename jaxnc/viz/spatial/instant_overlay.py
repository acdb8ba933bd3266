"""Marks of an instant in a drawing in space: screw axes, axodes, curvature of paths."""

from typing import Any

import numpy as np

from jaxnc.kinematics.instant import GROUND
from jaxnc.kinematics.screw import ScrewAxis, axodes
from jaxnc.viz.instant_overlay import Overlay
from jaxnc.viz.poses import evenly
from jaxnc.viz.spatial.bodies import Bodies
from jaxnc.viz.spatial.scene import Ball
from jaxnc.viz.style import INK, LIGHT, colour_of

_REACH = 0.62  # diagonals of the mechanism from its middle: how far lines are drawn
_RULINGS = 72  # lines of a ruled surface at most
_HALF = 0.24  # of the diagonal: half a line of a ruled surface


class SpaceOverlay(Overlay):
    """Marks of an instant of a spatial motion."""

    where = "space"

    def __init__(self, view: Any, pose: int):
        super().__init__(view, pose)
        self.adders = {"screw axis": self._add_axis, "axodes": self._add_axodes, "curvature": self._add_curvature}
        self.notes: list[tuple[str, str]] = []

    def _colour(self, body: str) -> int:
        names = [b.name for b in self.data.topology.bodies]
        return Bodies(self.data).colours[names.index(body)] if body in names else INK

    def note(self, text: str, body: int | None = None) -> None:
        """Add a line of text beside the drawing, in a body's colour if it is about one."""
        self.notes.append((text, LIGHT["ink"] if body is None else colour_of("body", body)))

    def _point(self, place: np.ndarray, text: str, role: str) -> None:
        """Mark a place with a name, and a dot of a role if there is one."""
        column = self.add_place(place)
        if role:
            self.add_items(Ball(role, column, 0.5))
        self.add_label(column, text)
        self.inside.append(place)

    def _chord(self, point: Any, direction: Any) -> np.ndarray:
        """Cut a line to what is within reach, ``(2, 3)``; NaN if it passes far away."""
        foot = point + (self.middle - point) @ direction * direction
        half = (_REACH * self.size) ** 2 - float(((foot - self.middle) ** 2).sum())
        if half <= 0 or not direction.any():
            return np.full((2, 3), np.nan)
        return foot + np.sqrt(half) * np.array([[-1.0], [1.0]]) * direction

    def _add_axis(self, body: str, other: str = GROUND) -> None:
        x: ScrewAxis = self.pick(self.motion.screw_axis(body, other))
        over = "" if other == GROUND else f" over {other}"
        colour, unit = self._colour(body), self.length_unit
        if not x.direction.any():
            self.note(f"{body}{over}: no screw axis, it stands still")
            return
        if np.isinf(x.pitch):
            self.note(f"{body}{over}: translation, {x.advance:.4g} {unit}/s", colour)
        else:
            pitch = 0.0 if abs(x.pitch) < 1e-9 * self.size else x.pitch  # less is rounding
            rates = f"rate {x.rate:.4g} rad/s, pitch {pitch:.4g} {unit}/rad"
            self.note(f"screw axis of {body}{over}: {rates}", colour)
        line = self._chord(x.point, x.direction)
        if not np.isfinite(line).all():
            away = float(np.linalg.norm(np.cross(self.middle - x.point, x.direction)))
            self.note(f"    it passes {away:.4g} {unit} away from the middle of the mechanism")
            return
        self.view.lines.append((line, colour, 0, "screw"))
        self._point(line[1], "ISA", "")
        self.inside.append(line[0])

    def _add_axodes(self, body: str, other: str = GROUND) -> None:
        found = axodes(self.motion, body, other, self.pose)
        good = evenly(np.flatnonzero(self.data.good), _RULINGS)
        on = "the ground" if other == GROUND else other
        for surface, colour, text in (
            (found.fixed, self._colour(other), f"fixed axode, on {on}"),
            (found.moving, self._colour(body), f"moving axode, on {body}"),
        ):
            rate, point, way = (np.asarray(getattr(surface, k))[good] for k in ("rate", "point", "direction"))
            x = self._rulings(point, way)
            x[~(rate > 0)] = np.nan
            gaps = np.full((len(x), 1, 3), np.nan)
            lines = [(np.concatenate([x, gaps], axis=1).reshape(-1, 3), "ruling"), (x[:, 0], "rim"), (x[:, 1], "rim")]
            self.view.lines += [(line, colour, 0, role) for line, role in lines]
            self.inside.extend(x[np.isfinite(x).all(axis=(1, 2))].reshape(-1, 3))
            self.note(f"── {text}", colour)

    def _rulings(self, point: np.ndarray, way: np.ndarray) -> np.ndarray:
        """Cut a surface's lines about where each is closest to the next, ``(lines, 2, 3)``; NaN far away."""
        turned = np.where((way[1:] * way[:-1]).sum(axis=1) < 0, -1.0, 1.0)  # the sense of a line does not count
        way = way * np.concatenate([[1.0], np.cumprod(turned)])[:, None]
        out = np.full((len(point), 2, 3), np.nan)
        for k, (p, d) in enumerate(zip(point, way, strict=True)):
            other = k + 1 if k + 1 < len(point) else k - 1
            chord = self._chord(p, d)
            if not np.isfinite(chord).all() or not 0 <= other < len(point):
                continue
            e = way[other]
            cosine = float(d @ e)
            between = (point[other] - p) @ (d - cosine * e) / max(1.0 - cosine * cosine, 1e-12)
            low, high = ((end - p) @ d for end in chord)
            middle = np.clip(between, low, high)
            half = _HALF * self.size
            out[k] = p + np.clip([[middle - half], [middle + half]], low, high) * d
        return out

    def _add_curvature(self, point: str, other: str = GROUND) -> None:
        found = self.curvature(point, other)
        if found is None:
            return
        place, x, radius = found
        out, turn = (place - x.centre) / radius, self.arc_angles(radius)[:, None]
        arc = x.centre + radius * (np.cos(turn) * out + np.sin(turn) * x.tangent)
        self.view.lines.append((arc, INK, 3, "trace"))
        if np.linalg.norm(x.centre - self.middle) <= self.size:
            self.view.lines.append((np.stack([place, x.centre]), INK, 0, "ruling"))
            self._point(x.centre, f"{point}₀", "dot")

    def paint(self) -> None:
        """Write the notes beside the drawing, once the view is open."""
        view, size = self.view, max(6.0, 1.7 * self.view.points)
        box, wide = view.ax.get_position(original=True), view.figure.get_figwidth()
        alone = len(view.figure.axes) == 1
        left = (5.0 / 72.0 / wide - box.x0) / box.width if alone else 0.0
        for k, (text, colour) in enumerate(self.notes):
            view.write(
                left, view.corner[1] - 1.45 * k * size / view.paper_size[1], text, transform=view.paper, ha="left",
                va="top", fontsize=size, color=colour, gid="note", zorder=16.0,
            )  # fmt: skip
