"""Marks of an instant in a drawing: centres, centrodes, circles; in space screw axes and axodes; curvature of paths."""

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.instant import (
    GROUND,
    InstantMotion,
    ScrewAxis,
    axodes,
    centrodes,
    instant_centres,
    instant_motion,
    path_curvature,
)
from jaxnc.types import Numbers
from jaxnc.viz.bodies import Bodies
from jaxnc.viz.poses import Poses, evenly
from jaxnc.viz.scene import Circle, Label, Line
from jaxnc.viz.spatial.scene import Ball
from jaxnc.viz.style import INK, LIGHT, colour_of
from jaxnc.viz.view import Legend

Wish = str | tuple[str, ...]

_CURVE = 0.55  # the same for how far curves decide the extents
_SUB = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


class Overlay:
    """Marks of an instant, collected for a view that is not opened yet.

    What stands in the picture joins the view's columns and scene; curves and texts are painted when it is open.
    """

    where: ClassVar[str]
    adders: dict[str, Callable[..., None]]  # by noun

    def __init__(self, view: Any, pose: int):
        self.view, self.pose = view, pose
        self.data: Poses = view.data
        self.motion, self.length_unit = view.data.motion, view.data.topology.length_unit
        lower, upper = view.inner
        self.middle, self.size = 0.5 * (lower + upper), float(np.linalg.norm(upper - lower)) or 1.0
        self.inside: list[np.ndarray] = []  # what has to be in the picture
        self.notes: list[tuple[str, str]] = []  # what is not in the picture, in words, and the colour of each

    def collect(self, show: Wish | Iterable[Wish]) -> None:
        """Collect what is asked for; see `jaxnc.viz.draw` for what there is to show."""
        wishes = self._wishes(show)
        if not self.data.good[self.pose]:
            return
        for noun, names in wishes:
            self.adders[noun](*names)
        if self.inside:
            self.view.include(np.array(self.inside))

    def _wishes(self, show: Wish | Iterable[Wish]) -> list[tuple[str, tuple[str, ...]]]:
        """Read what is asked for: nouns with names after them."""
        known = tuple(self.adders)
        given = (
            (show,) if isinstance(show, str) or (isinstance(show, tuple) and show[:1] and show[0] in known) else show
        )
        bodies, out = [b.name for b in self.data.topology.bodies], []
        for wish in given:
            first = wish if isinstance(wish, str) else str(wish[0])
            noun = next((n for n in known if first == n or first.startswith(n + " ")), None)
            if noun is None:
                raise InputError(f"show={wish!r}: what can be shown in {self.where} is {', '.join(known)}")
            rest = first.removeprefix(noun).strip()
            words = () if not rest else (rest,) if rest in bodies else tuple(rest.split(" / "))
            names = words if isinstance(wish, str) else tuple(wish[1:])
            if noun != "centres" and not names:
                what = "a point or marker" if noun == "curvature" else "a body"
                raise InputError(f"show={wish!r}: {noun!r} needs the name of {what} after it, show='{noun} …'")
            if len(names) > 2:
                raise InputError(f"show={wish!r}: {noun!r} takes one name, or one and that of the body it is seen from")
            out.append((noun, names))
        return out

    def colour(self, body: str) -> int:
        """Find the colour of a body."""
        return Bodies(self.data).colour_by_name.get(body, INK)

    def pick(self, found: Any) -> Any:
        """Pick the pose that is shown from a result, as NumPy's numbers."""
        k = ... if self.data.single else self.pose
        return type(found)(*(None if x is None else np.asarray(x)[k] for x in found))

    def add_items(self, *items: object) -> None:
        """Add items to the view's scene."""
        self.view.scene = dataclasses.replace(self.view.scene, items=(*self.view.scene.items, *items))

    def add_label(self, column: int, text: str) -> None:
        """Add a name to the view's scene."""
        self.view.scene = dataclasses.replace(self.view.scene, labels=(*self.view.scene.labels, Label(column, text)))

    def add_place(self, x: np.ndarray) -> int:
        """Add a place to the view; returns its column."""
        return self.view.add_columns(np.asarray(x, float)[None])

    def note(self, text: str, body: int | None = None) -> None:
        """Add a line of text, in a body's colour if it is about one."""
        self.notes.append((text, LIGHT["ink"] if body is None else colour_of("body", body)))

    def curvature(self, point: str, other: str) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Find where a point is, its centre of curvature, and an arc about that; None where there is none."""
        place = self.data.places[self.pose, self.data.column(point, "show")]
        x = self.pick(path_curvature(self.motion, point, other))
        if not x.bent:
            does = "runs straight" if x.moving else "stands still"
            self.note(f"{point} {does}: its path has no centre of curvature here")
            return None
        radius = 1.0 / abs(float(x.curvature))
        self.note(f"radius of curvature at {point}: {radius:.4g} {self.length_unit}".rstrip())
        out = (place - x.centre) / radius
        side = x.tangent if self.data.dim == 3 else np.array([-out[1], out[0]])
        # 0.5 radians on either side of a point, of its circle of curvature
        turn = np.linspace(-1, 1, 61)[:, None] * min(0.5, 0.25 * self.size / radius)
        return place, x.centre, x.centre + radius * (np.cos(turn) * out + np.sin(turn) * side)

    def sides(self, noun: str, body: str, other: str) -> Iterator[tuple[str, int, str]]:
        """List the fixed and the moving one of two curves or surfaces: which, its colour, and what it is called."""
        yield "fixed", self.colour(other), f"fixed {noun}, on {'the ground' if other == GROUND else other}"
        yield "moving", self.colour(body), f"moving {noun}, on {body}"


@dataclass(frozen=True)
class _Curve:
    """A curve beside a mechanism."""

    x: np.ndarray  # its places, (n, 2), with gaps (NaN)
    body: int  # index of the colour
    width: float  # of the line, units
    dash: tuple[float, ...] = ()  # lengths of dashes and gaps, units
    name: str = ""  # of the artist
    head: bool = False  # whether it ends in an arrowhead


class PlaneOverlay(Overlay):
    """Marks of an instant of a planar motion."""

    where = "the plane"

    def __init__(self, view: Any, pose: int):
        super().__init__(view, pose)
        self.adders = {
            "centres": self._add_centres,
            "centrodes": self._add_centrodes,
            "inflection circle": self._add_inflection,
            "Bresse circles": self._add_bresse,
            "curvature": self._add_curvature,
        }
        self.curves: list[_Curve] = []
        self.points: list[tuple[np.ndarray, str]] = []
        self.keys: list[tuple[tuple[str, str], ...]] = []  # entries of the legend

    def collect(self, show: Wish | Iterable[Wish]) -> None:
        """Collect what is asked for; see `jaxnc.viz.draw` for what there is to show."""
        super().collect(show)
        self.view.legend = Legend((*self.keys, *((note,) for note in self.notes)))

    def near(self, x: np.ndarray, share: float = 1.2) -> bool:
        """Tell whether a place is close enough to be drawn."""
        return bool(np.hypot(*(x - self.middle)) <= share * self.size)

    def _key(self, dash: str, colour: str, text: str) -> None:
        self.keys.append(((f"{dash} ", colour), (text, LIGHT["ink"])))

    def _point(self, x: np.ndarray, text: str, role: str = "pole") -> None:
        """Mark a place with a dot and a name."""
        while text in self.data.names:
            text += "′"
        if any(name == text and np.allclose(place, x, 0.0, 1e-9 * self.size) for place, name in self.points):
            return
        self.points.append((np.asarray(x, float), text))
        column = self.add_place(x)
        self.add_items(Circle(role, column, units=0.62))
        self.add_label(column, text)

    def _mark(self, x: np.ndarray, text: str, role: str = "pole") -> bool:
        """Mark a place that has to be in the picture; False if it is too far away for that."""
        if not self.near(x):
            return False
        self._point(x, text, role)
        self.inside.append(x)
        return True

    def _line(self, a: np.ndarray, b: np.ndarray, role: str) -> None:
        self.add_items(Line(role, (self.add_place(a), self.add_place(b))))

    def _arrow_away(self, start: np.ndarray, way: np.ndarray, text: str) -> None:
        """Point towards what is not in the picture, with its name."""
        run = 0.16  # of the diagonal: arrow to what is not in the picture
        first = start + 0.25 * run * self.size * way
        last = start + (0.25 + 1.0) * run * self.size * way
        self.curves.append(_Curve(np.stack([first, last]), INK, 0.2, (1.0, 0.7), f"towards {text}", head=True))
        self.points.append((last, text))
        self.add_label(self.add_place(last), text)
        self.inside.append(last)

    # -- what may be asked for -----------------------------------------------------------------------------------------

    def _add_centres(self, *names: str) -> None:
        bodies = [GROUND, *(b.name for b in self.data.topology.bodies)]
        for name in names:
            if name not in bodies:
                raise InputError(f"show: {self.data.topology.name!r} has no body {name!r}; {nearest(name, bodies)}")
        every = instant_centres(self.motion)
        found = {(a, b): self.pick(every[a, b]) for b, a in itertools.combinations(bodies, 2)}
        found = {pair: x for pair, x in found.items() if x.moving}
        moving = [b for b in bodies if b == GROUND or (b, GROUND) in found]
        number = {name: k + 1 for k, name in enumerate(moving)}
        for name, k in number.items():
            self.note(f"{k} {name}")
        spots: dict[tuple, tuple[np.ndarray, list[str]]] = {}
        for pair, x in found.items():
            if not set(names) <= set(pair) <= set(number):
                continue
            a, b = sorted(number[name] for name in pair)
            text = f"P{a}{',' if b > 9 else ''}{b}".translate(_SUB)
            if x.finite and self.near(x.centre):
                at = tuple(np.round(x.centre / self.size, 6).tolist())
                spots.setdefault(at, (x.centre, []))[1].append(text)
                self.inside.append(x.centre)
            else:
                self._note_far_centre(text, pair, x)
        for centre, texts in spots.values():
            self._point(centre, ", ".join(texts))
        if len(moving) <= 4 and not names:  # lines are drawn between the centres of 4 bodies, the ground among them
            self._add_kennedy_lines(moving, found)

    def _note_far_centre(self, text: str, pair: tuple[str, str], x: InstantMotion) -> None:
        way: Any = x.direction if x.direction.any() else np.array([1.0, 0.0])
        start = np.asarray(self.motion.position(pair[0])).reshape(-1, 2)[self.pose]
        if x.finite:
            self._arrow_away(start, way, text)
            self.note(f"{text} at ({x.centre[0]:.4g}, {x.centre[1]:.4g}) {self.length_unit}")
        else:
            way = way if way[1] > 0 or (way[1] == 0 and way[0] > 0) else -way
            self._arrow_away(start, way, f"{text} ∞")
            self.note(f"{text} at infinity, {np.degrees(np.arctan2(way[1], way[0])):.4g}°")

    def _add_kennedy_lines(self, bodies: list[str], found: dict) -> None:
        """Draw the lines on which the centres of three bodies lie."""
        for three in itertools.combinations(bodies, 3):
            pairs = [x for pair, x in found.items() if set(pair) <= set(three)]
            finite = [x.centre for x in pairs if x.finite and self.near(x.centre)]
            if len(finite) < 2:
                continue
            gaps = [(float(np.hypot(*(b - a))), a, b) for a, b in itertools.combinations(finite, 2)]
            _, a, b = max(gaps, key=lambda gap: gap[0])
            self._line(a, b, "centre line")

    def _add_centrodes(self, body: str, other: str = GROUND) -> None:
        found = centrodes(self.motion, body, other, self.pose)
        rate = np.asarray(instant_motion(self.motion, body, other).rate)
        finite = np.asarray(found.finite) & self.data.good
        for name, colour, text in self.sides("centrode", body, other):
            path = np.where(finite[:, None], np.asarray(getattr(found, name)), np.nan)
            through = np.flatnonzero(np.diff(np.sign(rate)) != 0) + 1  # infinity
            path = np.insert(path, through, np.nan, axis=0)
            self.curves.append(_Curve(path, colour, 0.42, name=f"{name} centrode"))
            path = path[np.isfinite(path).all(axis=1)]
            self.inside.extend(path[np.hypot(*(path - self.middle).T) <= _CURVE * self.size])
            self._key("──", colour_of("body", colour), text)
        here = self.pick(instant_motion(self.motion, body, other))
        if here.finite:
            self._mark(here.centre, "P")

    def _add_inflection(self, body: str, other: str = GROUND, noun: str = "inflection circle") -> Any:
        """Draw the inflection circle; returns the motion of the body, None where it has no such circle."""
        x = self.pick(instant_motion(self.motion, body, other))
        if x.inflection is None:
            self.motion.acceleration(self.data.topology.points[0])  # raises an error that tells what is missing
            return None
        colour = self.colour(body)
        if not x.finite:
            self.note(f"{body}: no {noun}, it does not turn")
            return None
        self._circle("inflection", x.centre, x.inflection, colour)
        size = float(np.hypot(*x.inflection))
        text = f"inflection circle of {body}, diameter {size:.4g} {self.length_unit}".rstrip()
        self._key("– –", colour_of("body", colour), text)
        self._mark(x.centre, "P")
        pole = x.centre + x.inflection
        if self.near(pole) and size > 0:
            self._point(pole, "W")
            self._line(x.centre, pole, "radius")
        return x

    def _add_bresse(self, body: str, other: str = GROUND) -> None:
        x = self._add_inflection(body, other, "Bresse circles")
        if x is None:
            return
        if abs(x.angular_acceleration) * float(np.hypot(*x.inflection)) < 1e-9 * x.rate**2 * self.size:
            self.note("no angular acceleration: no tangential acceleration on the pole normal")
        else:
            across = np.array([-x.inflection[1], x.inflection[0]]) * x.rate**2 / x.angular_acceleration
            self._circle("tangential", x.centre, across, self.colour(body))
            self._key("· · ·", colour_of("soft", INK), "points without tangential acceleration")
        if x.accelerating:
            self._mark(x.acceleration_pole, "Q")

    def _circle(self, role: str, start: np.ndarray, diameter: np.ndarray, body: int) -> None:
        centre, radius = start + 0.5 * diameter, 0.5 * float(np.hypot(*diameter))
        self.add_items(Circle(role, self.add_place(centre), radius, body=body))
        if self.near(centre, _CURVE) and radius < _CURVE * self.size:
            self.inside.extend((centre - radius, centre + radius))

    def _add_curvature(self, point: str, other: str = GROUND) -> None:
        if (found := self.curvature(point, other)) is None:
            return
        place, centre, arc = found
        name = f"circle of curvature at {point}"
        self.curves.append(_Curve(arc, self.colour(other), 0.24, (1.0, 0.6), name))
        if self._mark(centre, f"{point}₀", "ring"):
            self._line(place, centre, "radius")
        else:
            self._arrow_away(place, (centre - place) / np.hypot(*(centre - place)), f"{point}₀")

    def paint(self) -> None:
        """Draw curves and the legend, once the view is open."""
        ax, points = self.view.ax, self.view.points
        for curve in self.curves:
            colour = colour_of("body", curve.body)
            (line,) = ax.plot(
                *curve.x.T, color=colour, linewidth=curve.width * points, scalex=False, scaley=False, gid=curve.name,
                linestyle=(0, [d / curve.width for d in curve.dash]) if curve.dash else "-",
                zorder=3.4 if curve.head else 2.45,
            )  # fmt: skip
            line.set_solid_capstyle("round")
            if curve.head:
                head = {"arrowstyle": "-|>", "color": colour, "lw": 0, "mutation_scale": 2.2 * points}
                back = curve.x[-1] - 1e-3 * (curve.x[-1] - curve.x[0])
                ax.annotate("", curve.x[-1], back, arrowprops={**head, "shrinkA": 0, "shrinkB": 0})
        self.view.legend.paint(ax, float(self.view.paper[0]))


class SpaceOverlay(Overlay):
    """Marks of an instant of a spatial motion."""

    where = "space"

    def __init__(self, view: Any, pose: int):
        super().__init__(view, pose)
        self.adders = {"screw axis": self._add_axis, "axodes": self._add_axodes, "curvature": self._add_curvature}

    def _point(self, place: np.ndarray, text: str, role: str) -> None:
        """Mark a place with a name, and a dot of a role if there is one."""
        column = self.add_place(place)
        if role:
            self.add_items(Ball(role, column, 0.5))
        self.add_label(column, text)
        self.inside.append(place)

    def _chord(self, point: Numbers, direction: Numbers) -> np.ndarray:
        """Cut a line to what is within reach, ``(2, 3)``; NaN if it passes far away."""
        foot = point + (self.middle - point) @ direction * direction
        # lines are drawn so many diagonals of the mechanism from its middle
        half = (0.62 * self.size) ** 2 - float(((foot - self.middle) ** 2).sum())
        if half <= 0 or not direction.any():
            return np.full((2, 3), np.nan)
        return foot + np.sqrt(half) * np.array([[-1.0], [1.0]]) * direction

    def _add_axis(self, body: str, other: str = GROUND) -> None:
        x: ScrewAxis = self.pick(self.motion.screw_axis(body, other))
        over = "" if other == GROUND else f" over {other}"
        colour, unit = self.colour(body), self.length_unit
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
        good = evenly(np.flatnonzero(self.data.good), 72)  # 72 lines of a ruled surface at most
        for name, colour, text in self.sides("axode", body, other):
            surface = getattr(found, name)
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
            half = 0.24 * self.size  # half of a ruled surface's line, of the diagonal
            out[k] = p + np.clip([[middle - half], [middle + half]], low, high) * d
        return out

    def _add_curvature(self, point: str, other: str = GROUND) -> None:
        if (found := self.curvature(point, other)) is None:
            return
        place, centre, arc = found
        self.view.lines.append((arc, INK, 3, "trace"))
        if np.linalg.norm(centre - self.middle) <= self.size:
            self.view.lines.append((np.stack([place, centre]), INK, 0, "ruling"))
            self._point(centre, f"{point}₀", "dot")

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
