"""What a drawing in space shows of an instant: screw axes, axodes, curvature of paths."""

import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np

from jaxnc.kinematics.instant import GROUND, path_curvature
from jaxnc.kinematics.screw import ScrewAxis, axodes
from jaxnc.viz.marks import SPATIAL, Wish, wishes
from jaxnc.viz.poses import Poses
from jaxnc.viz.spatial.bodies import Bodies
from jaxnc.viz.spatial.scene import Ball, Label
from jaxnc.viz.style import INK, LIGHT, colour_of

_REACH = 0.62  # diagonals of the mechanism from its middle: how far lines are drawn
_RULINGS = 72  # lines of a ruled surface at most
_HALF = 0.24  # of the diagonal: half a line of a ruled surface
_ARC = 0.5  # radians on either side of a point, of its circle of curvature


class Marks:
    """What is added to a drawing, collected.

    The view is one of space, not yet opened.
    """

    def __init__(self, view: Any, pose: int):
        self.view, self.pose = view, pose
        self.data: Poses = view.data
        lower, upper = view.inner
        self.middle, self.size = 0.5 * (lower + upper), float(np.linalg.norm(upper - lower)) or 1.0
        self.notes: list[tuple[str, str]] = []
        self.inside: list[np.ndarray] = []

    def one(self, found: Any) -> Any:
        """A result as NumPy's, of the pose that is shown."""
        k = ... if self.data.single else self.pose
        return type(found)(*(np.asarray(x)[k] for x in found))

    def colour(self, body: str) -> int:
        """Index of a body's colour."""
        names = [b.name for b in self.data.topology.bodies]
        return Bodies(self.data).colours[names.index(body)] if body in names else INK

    def note(self, text: str, body: int | None = None) -> None:
        """A line of text, in a body's colour."""
        self.notes.append((text, LIGHT["ink"] if body is None else colour_of("body", body)))

    def point(self, place: np.ndarray, text: str, role: str) -> None:
        """A place with a dot and a name."""
        view = self.view
        at = view.columns.shape[1]
        further = np.broadcast_to(place, (view.columns.shape[0], 1, 3))
        view.columns = np.concatenate([view.columns, further], axis=1)
        balls = (Ball(role, at, 0.5),) if role else ()
        view.scene = dataclasses.replace(
            view.scene, items=(*view.scene.items, *balls), labels=(*view.scene.labels, Label(at, text))
        )
        self.inside.append(place)

    def chord(self, point: Any, direction: Any) -> np.ndarray:
        """The part of a line within reach, ``(2, 3)``; NaN if it passes far away."""
        foot = point + (self.middle - point) @ direction * direction
        half = (_REACH * self.size) ** 2 - float(((foot - self.middle) ** 2).sum())
        if half <= 0 or not direction.any():
            return np.full((2, 3), np.nan)
        return foot + np.sqrt(half) * np.array([[-1.0], [1.0]]) * direction

    # -- what may be asked for -----------------------------------------------------------------------------------

    def add(self, noun: str, names: tuple[str, ...]) -> None:
        """Add what one wish asks for."""
        {"screw axis": self._axis, "axodes": self._axodes, "curvature": self._curvature}[noun](*names)

    def _axis(self, body: str, other: str = GROUND) -> None:
        x: ScrewAxis = self.one(self.data.motion.screw_axis(body, other))
        over = "" if other == GROUND else f" over {other}"
        colour, unit = self.colour(body), self.data.topology.length_unit
        if not x.direction.any():
            self.note(f"{body}{over}: no screw axis, it stands still")
            return
        if np.isinf(x.pitch):
            self.note(f"{body}{over}: translation, {x.advance:.4g} {unit}/s", colour)
        else:
            pitch = 0.0 if abs(x.pitch) < 1e-9 * self.size else x.pitch  # less is rounding
            said = f"rate {x.rate:.4g} rad/s, pitch {pitch:.4g} {unit}/rad"
            self.note(f"screw axis of {body}{over}: {said}", colour)
        line = self.chord(x.point, x.direction)
        if not np.isfinite(line).all():
            away = float(np.linalg.norm(np.cross(self.middle - x.point, x.direction)))
            self.note(f"    it passes {away:.4g} {unit} away from the middle of the mechanism")
            return
        self.view.lines.append((line, colour, 0, "screw"))
        self.point(line[1], "ISA", "")
        self.inside.append(line[0])

    def _axodes(self, body: str, other: str = GROUND) -> None:
        found = axodes(self.data.motion, body, other, self.pose)
        good = np.flatnonzero(self.data.good)
        good = good[np.unique(np.linspace(0, len(good) - 1, _RULINGS).astype(int))]
        on = "the ground" if other == GROUND else other
        for surface, colour, text in (
            (found.fixed, self.colour(other), f"fixed axode, on {on}"),
            (found.moving, self.colour(body), f"moving axode, on {body}"),
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
        """Stretches of a surface's lines about where each is closest to the next, ``(lines, 2, 3)``; NaN far away."""
        turned = np.where((way[1:] * way[:-1]).sum(axis=1) < 0, -1.0, 1.0)  # the sense of a line does not count
        way = way * np.concatenate([[1.0], np.cumprod(turned)])[:, None]
        out = np.full((len(point), 2, 3), np.nan)
        for k, (p, d) in enumerate(zip(point, way, strict=True)):
            other = k + 1 if k + 1 < len(point) else k - 1
            chord = self.chord(p, d)
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

    def _curvature(self, point: str, other: str = GROUND) -> None:
        place = self.data.places[self.pose, self.data.column(point, "show")]
        x = self.one(path_curvature(self.data.motion, point, other))
        unit = self.data.topology.length_unit
        if not x.bent:
            said = "runs straight" if x.moving else "stands still"
            self.note(f"{point} {said}: its path has no centre of curvature here")
            return
        radius = 1.0 / float(x.curvature)
        self.note(f"radius of curvature at {point}: {radius:.4g} {unit}".rstrip())
        out = (place - x.centre) / radius
        turn = (np.linspace(-1, 1, 61) * min(_ARC, 0.25 * self.size / radius))[:, None]
        arc = x.centre + radius * (np.cos(turn) * out + np.sin(turn) * x.tangent)
        self.view.lines.append((arc, INK, 3, "trace"))
        if np.linalg.norm(x.centre - self.middle) <= self.size:
            self.view.lines.append((np.stack([place, x.centre]), INK, 0, "ruling"))
            self.point(x.centre, f"{point}₀", "dot")

    def paint(self, view: Any) -> None:
        """Write what there is to be said, into a view that is open."""
        size = max(6.0, 1.7 * view.points)
        box = view.ax.get_position(original=True)
        wide, high = view.figure.get_size_inches()
        alone = len(view.figure.axes) == 1
        left = (5.0 / 72.0 / wide - box.x0) / box.width if alone else 0.0
        for k, (text, colour) in enumerate(self.notes):
            view.ax.text2D(
                left, view.corner[1] - 1.45 * k * size / 72.0 / (box.height * high), text, transform=view.paper,
                ha="left", va="top", fontsize=size, color=colour, gid="note", zorder=16.0,
            ).set_parse_math(False)  # fmt: skip


def marked(view: Any, show: Wish | Iterable[Wish], pose: int) -> Marks:
    """Collect what a drawing is to show, and take it into the view's scene and extents; see `jaxnc.viz.marks`."""
    marks = Marks(view, pose)
    wished = wishes(show, SPATIAL, view.data)
    if view.data.good[pose]:
        for noun, names in wished:
            marks.add(noun, names)
        if marks.inside:
            view.include(np.array(marks.inside))
    return marks
