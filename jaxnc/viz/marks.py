"""What a drawing shows of an instant: instant centres, centrodes, circles of inflection and curvature, in the plane."""

import dataclasses
import itertools
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.instant import GROUND, InstantMotion, centrodes, instant_centres, instant_motion, path_curvature
from jaxnc.kinematics.motion import Motion
from jaxnc.viz.poses import Poses
from jaxnc.viz.scene import Circle, Item, Label, Line
from jaxnc.viz.sketch import colours
from jaxnc.viz.style import INK, colour_of
from jaxnc.viz.under import Under

PLANAR = ("centres", "centrodes", "inflection circle", "Bresse circles", "curvature")
SPATIAL = ("screw axis", "axodes", "curvature")
Wish = str | tuple[str, ...]

_FAR = 1.2  # diagonals of the mechanism from its middle: what lies farther is told, not drawn
_CURVE = 0.55  # the same for how far curves decide the extents
_FEW = 4  # bodies, the ground among them, between whose centres lines are drawn
_RUN = 0.16  # of the diagonal: arrow to what is not in the picture
_ARC = 0.5  # radians on either side of a point, of its circle of curvature
_SUB = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


@dataclass(frozen=True)
class Curve:
    """A curve beside a mechanism."""

    x: np.ndarray  # its places, (n, 2), with gaps (NaN)
    body: int  # index of the colour
    width: float  # of the line, units
    dash: tuple[float, ...] = ()  # lengths of dashes and gaps, units
    name: str = ""  # of the artist
    head: bool = False  # whether it ends in an arrowhead
    soft: bool = False  # whether it is lighter

    @property
    def colour(self) -> str:
        """Of its line."""
        return colour_of("soft" if self.soft else "body", self.body)


@dataclass
class Marks:
    """What is added to a drawing, collected."""

    data: Poses  # the motion
    pose: int  # the pose that is shown
    lower: np.ndarray  # lower left corner of the mechanism
    upper: np.ndarray  # its upper right corner
    places: list[np.ndarray] = field(default_factory=list)  # further places, lengths
    names: list[tuple[int, str]] = field(default_factory=list)  # what they are called
    items: list[Item] = field(default_factory=list)  # what stands there, by number among the places
    curves: list[Curve] = field(default_factory=list)  # lines beside the mechanism
    # entries of the legend: a stretch of line, its colour, a text
    keys: list[tuple[str, str, str]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)  # what is not in the picture, in words
    inside: list[np.ndarray] = field(default_factory=list)  # what has to be in the picture

    @property
    def motion(self) -> Motion:
        """What is shown."""
        return self.data.motion

    @property
    def size(self) -> float:
        """Diagonal of the mechanism."""
        return float(np.hypot(*(self.upper - self.lower))) or 1.0

    def near(self, x: np.ndarray, share: float = _FAR) -> bool:
        """Whether a place is close enough to be drawn."""
        return bool(np.hypot(*(x - 0.5 * (self.lower + self.upper))) <= share * self.size)

    def place(self, x: Any) -> int:
        """Number of a further place."""
        self.places.append(np.asarray(x, float))
        return len(self.places) - 1

    def point(self, x: Any, text: str, role: str = "pole", body: int = INK) -> None:
        """A place with a dot and a name."""
        while text in self.data.names:
            text += "′"
        if any(known == text and np.allclose(self.places[k], x, 0.0, 1e-9 * self.size) for k, known in self.names):
            return
        k = self.place(x)
        self.items.append(Circle(role, k, units=0.62, body=body))
        self.names.append((k, text))

    def line(self, a: Any, b: Any, role: str) -> None:
        """A straight line between two places."""
        self.items.append(Line(role, (self.place(a), self.place(b))))

    def one(self, found: Any) -> Any:
        """A result as NumPy's, of the pose that is shown."""
        k = ... if self.data.single else self.pose
        return type(found)(*(None if x is None else np.asarray(x)[k] for x in found))

    def colour(self, body: str) -> int:
        """Index of a body's colour."""
        return INK if body == GROUND else colours(self.data).get(body, INK)

    # -- what may be asked for -----------------------------------------------------------------------------------

    def add(self, noun: str, names: tuple[str, ...]) -> None:
        """Add what one wish asks for."""
        if noun == "centres":
            self._centres(names)
        elif noun == "curvature":
            self._curvature(*names)
        elif noun == "centrodes":
            self._centrodes(*names)
        else:
            self._circles(noun, *names)

    def _away(self, start: np.ndarray, way: np.ndarray, text: str) -> None:
        """An arrow towards what is not in the picture, with its name."""
        first = start + 0.25 * _RUN * self.size * way
        last = start + (0.25 + 1.0) * _RUN * self.size * way
        self.curves.append(Curve(np.stack([first, last]), INK, 0.2, (1.0, 0.7), f"towards {text}", head=True))
        self.names.append((self.place(last), text))
        self.inside.append(last)

    def _centres(self, names: tuple[str, ...]) -> None:
        bodies = [GROUND, *(b.name for b in self.data.topology.bodies)]
        for name in names:
            if name not in bodies:
                raise InputError(f"show: {self.data.topology.name!r} has no body {name!r}; {nearest(name, bodies)}")
        found = {pair: self.one(x) for pair, x in instant_centres(self.motion).items()}
        found = {pair: x for pair, x in found.items() if x.moving}
        moving = [b for b in bodies if b == GROUND or (b, GROUND) in found]
        number = {name: k + 1 for k, name in enumerate(moving)}
        self.notes += [f"{k} {name}" for name, k in number.items()]
        spots: dict[tuple, tuple[np.ndarray, list[str]]] = {}
        for pair, x in found.items():
            wanted = set(names) <= set(pair)
            if not (wanted and set(pair) <= set(number)):
                continue
            text = centre_name(*(number[name] for name in pair))
            if x.finite and self.near(x.centre):
                at = tuple(np.round(x.centre / self.size, 6).tolist())
                spots.setdefault(at, (x.centre, []))[1].append(text)
                self.inside.append(x.centre)
            else:
                self._tell(text, pair, x)
        for centre, texts in spots.values():
            self.point(centre, ", ".join(texts))
        if len(moving) <= _FEW and not names:
            self._kennedy(moving, found)

    def _tell(self, text: str, pair: tuple[str, str], x: InstantMotion) -> None:
        unit = self.data.topology.length_unit
        way: Any = x.direction if x.direction.any() else np.array([1.0, 0.0])
        start = np.asarray(self.motion.position(pair[0])).reshape(-1, 2)[self.pose]
        if x.finite:
            self._away(start, way, text)
            self.notes.append(f"{text} at ({x.centre[0]:.4g}, {x.centre[1]:.4g}) {unit}")
        else:
            way = way if way[1] > 0 or (way[1] == 0 and way[0] > 0) else -way
            self._away(start, way, f"{text} ∞")
            self.notes.append(f"{text} at infinity, {np.degrees(np.arctan2(way[1], way[0])):.4g}°")

    def _kennedy(self, bodies: list[str], found: dict) -> None:
        """Lines on which the centres of three bodies lie."""
        for three in itertools.combinations(bodies, 3):
            pairs = [x for pair, x in found.items() if set(pair) <= set(three)]
            finite = [x.centre for x in pairs if x.finite and self.near(x.centre)]
            if len(finite) < 2:
                continue
            gaps = [(float(np.hypot(*(b - a))), a, b) for a, b in itertools.combinations(finite, 2)]
            _, a, b = max(gaps, key=lambda gap: gap[0])
            self.line(a, b, "centre line")

    def _centrodes(self, body: str, other: str = GROUND) -> None:
        found = centrodes(self.motion, body, other, self.pose)
        rate = np.asarray(instant_motion(self.motion, body, other).rate)
        finite = np.asarray(found.finite) & self.data.good
        first, second = self.colour(other), self.colour(body)
        for name, x, colour in (("fixed", found.fixed, first), ("moving", found.moving, second)):
            path = np.where(finite[:, None], np.asarray(x), np.nan)
            through = np.flatnonzero(np.diff(np.sign(rate)) != 0) + 1  # infinity
            path = np.insert(path, through, np.nan, axis=0)
            self._curve(Curve(path, colour, 0.42, name=f"{name} centrode"))
            on = "the ground" if other == GROUND else other
            text = f"fixed centrode, on {on}" if name == "fixed" else f"moving centrode, on {body}"
            self.keys.append(("──", colour_of("body", colour), text))
        here = self.one(instant_motion(self.motion, body, other))
        if here.finite and self.near(here.centre):
            self.point(here.centre, "P")
            self.inside.append(here.centre)

    def _curve(self, curve: Curve) -> None:
        self.curves.append(curve)
        middle = 0.5 * (self.lower + self.upper)
        x = curve.x[np.isfinite(curve.x).all(axis=1)]
        self.inside.extend(x[np.hypot(*(x - middle).T) <= _CURVE * self.size])

    def _circles(self, noun: str, body: str, other: str = GROUND) -> None:
        x = self.one(instant_motion(self.motion, body, other))
        self._second(x.inflection)
        colour, unit = self.colour(body), self.data.topology.length_unit
        if not x.finite:
            self.notes.append(f"{body}: no {noun}, it does not turn")
            return
        self._circle("inflection", x.centre, x.inflection, colour)
        size = float(np.hypot(*x.inflection))
        text = f"inflection circle of {body}, diameter {size:.4g} {unit}".rstrip()
        self.keys.append(("– –", colour_of("body", colour), text))
        if self.near(x.centre):
            self.point(x.centre, "P")
            self.inside.append(x.centre)
        pole = x.centre + x.inflection
        if self.near(pole) and size > 0:
            self.point(pole, "W")
            self.line(x.centre, pole, "radius")
        if noun == "inflection circle":
            return
        if abs(x.angular_acceleration) * size < 1e-9 * x.rate**2 * self.size:
            self.notes.append("no angular acceleration: no tangential acceleration on the pole normal")
        else:
            across = np.array([-x.inflection[1], x.inflection[0]]) * x.rate**2 / x.angular_acceleration
            self._circle("tangential", x.centre, across, colour)
            self.keys.append(("· · ·", colour_of("soft", INK), "points without tangential acceleration"))
        if x.accelerating and self.near(x.acceleration_pole):
            self.point(x.acceleration_pole, "Q")
            self.inside.append(x.acceleration_pole)

    def _second(self, found: Any) -> None:
        if found is None:
            self.motion.acceleration(self.data.topology.points[0])  # says what is missing

    def _circle(self, role: str, start: np.ndarray, diameter: np.ndarray, body: int) -> None:
        centre, radius = start + 0.5 * diameter, 0.5 * float(np.hypot(*diameter))
        self.items.append(Circle(role, self.place(centre), radius, body=body))
        if self.near(centre, _CURVE) and radius < _CURVE * self.size:
            self.inside.extend((centre - radius, centre + radius))

    def _curvature(self, point: str, other: str = GROUND) -> None:
        self.data.column(point, "show")
        x = self.one(path_curvature(self.motion, point, other))
        place = self.data.places[self.pose, self.data.column(point, "show")]
        unit = self.data.topology.length_unit
        colour = self.colour(other)
        if not x.bent:
            said = "runs straight" if x.moving else "stands still"
            self.notes.append(f"{point} {said}: its path has no centre of curvature here")
            return
        radius = 1.0 / abs(float(x.curvature))
        self.notes.append(f"radius of curvature at {point}: {radius:.4g} {unit}".rstrip())
        arm = place - x.centre
        turn = np.arctan2(arm[1], arm[0]) + np.linspace(-1, 1, 61) * min(_ARC, 0.25 * self.size / radius)
        arc = x.centre + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        self.curves.append(Curve(arc, colour, 0.24, (1.0, 0.6), f"circle of curvature at {point}"))
        if self.near(x.centre):
            self.point(x.centre, f"{point}₀", "ring")
            self.inside.append(x.centre)
            self.line(place, x.centre, "radius")
        else:
            self._away(place, -arm / radius, f"{point}₀")

    def paint(self, view: Any) -> None:
        """Draw the curves, circles and texts of what was collected, into a view that is open."""
        for curve in self.curves:
            look: dict[str, Any] = {
                "color": curve.colour,
                "linewidth": curve.width * view.points,
                "zorder": 3.4 if curve.head else 2.45,
            }
            if curve.dash:
                look["linestyle"] = (0, [d / curve.width for d in curve.dash])
            (line,) = view.ax.plot(*curve.x.T, scalex=False, scaley=False, gid=curve.name, **look)
            line.set_solid_capstyle("round")
            if curve.head:
                head = {"arrowstyle": "-|>", "color": curve.colour, "lw": 0, "mutation_scale": 2.2 * view.points}
                back = curve.x[-1] - 1e-3 * (curve.x[-1] - curve.x[0])
                view.ax.annotate("", curve.x[-1], back, arrowprops={**head, "shrinkA": 0, "shrinkB": 0})
        view.under.paint(view.ax, float(view.paper[0]))

    def under(self) -> Under:
        """Legend and notes, to be written under the drawing."""
        ink = colour_of("ink", INK)
        keys = [((f"{dash} ", colour), (text, ink)) for dash, colour, text in self.keys]
        return Under((*keys, *(((note, ink),) for note in self.notes)))


def centre_name(first: int, second: int) -> str:
    """The name of the centre of two bodies by number: P₁₂."""
    a, b = sorted((first, second))
    return f"P{a},{b}".translate(_SUB) if b > 9 else f"P{a}{b}".translate(_SUB)


def wishes(show: Wish | Iterable[Wish], known: tuple[str, ...], data: Poses) -> list[tuple[str, tuple[str, ...]]]:
    """What is asked for: nouns with names after them."""
    given = (show,) if isinstance(show, str) or (isinstance(show, tuple) and show[:1] and show[0] in known) else show
    bodies, out = [b.name for b in data.topology.bodies], []
    for wish in given:
        first = wish if isinstance(wish, str) else str(wish[0])
        noun = next((n for n in known if first == n or first.startswith(n + " ")), None)
        if noun is None:
            where = "the plane" if known == PLANAR else "space"
            raise InputError(f"show={wish!r}: what can be shown in {where} is {', '.join(known)}")
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


def marked(view: Any, show: Wish | Iterable[Wish], pose: int) -> Marks:
    """Collect what a drawing is to show, and take it into the view's scene and extents.

    The view is one of the plane, not yet opened; see `wishes` for what there is to `show`.
    """
    data: Poses = view.data
    marks = Marks(data, pose, view.lower.copy(), view.upper.copy())
    wished = wishes(show, PLANAR, data)
    if not data.good[pose]:
        return marks
    for noun, names in wished:
        marks.add(noun, names)
    first = data.places.shape[1]
    if marks.places:
        further = np.broadcast_to(np.array(marks.places), (data.count, len(marks.places), 2))
        view.data = dataclasses.replace(data, places=np.concatenate([data.places, further], axis=1))
    items = [_shifted(item, first) for item in marks.items]
    labels = [Label("label", first + k, text) for k, text in marks.names]
    view.scene = dataclasses.replace(
        view.scene, items=(*view.scene.items, *items), labels=(*view.scene.labels, *labels)
    )
    if marks.inside:
        view.include(np.array(marks.inside))
    view.under = marks.under()
    return marks


def _shifted(item: Item, first: int) -> Item:
    """An item whose columns count from another one."""
    if isinstance(item, Circle):
        return dataclasses.replace(item, at=first + item.at)
    assert isinstance(item, Line)
    return dataclasses.replace(item, points=tuple(first + k for k in item.points))
