"""Plates, holes, slots and pins that a planar mechanism is made of.

A `Shop` is what a workshop says of the plates that a mechanism is to be made of.
"""

import itertools
import math
from collections import defaultdict
from dataclasses import dataclass, field, fields
from numbers import Integral, Real
from typing import Any, NamedTuple

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.viz.bodies import hull
from jaxnc.workshop.clearances import distance, follow_between

MILLIMETRES = {"m": 1e3, "dm": 1e2, "cm": 10.0, "mm": 1.0, "um": 1e-3, "µm": 1e-3, "in": 25.4, "ft": 304.8}
"""Of one unit of length, by its label."""

_MAY_BE_ZERO = ("clearance", "play", "washer")


@public
@dataclass(frozen=True, kw_only=True)
class Shop:
    """Sizes in a workshop, all in mm.

    Attributes:
        width: of links, which are rounded by half of it.
        pin: diameter of pins.
        thickness: of all plates.
        clearance: what stays between parts that pass each other in one layer, at least.
        play: what holes and slots are wider than pins.
        washer: thickness of the washers between layers; may be 0.
        spacer: outer diameter of washers and spacers; twice the pin's if not given to `of`.
        unit: how long a unit of length of the mechanism is, 1000 for metres; by its label if not given to `of`.
        layers: how many layers there may be above the ground plate; as many as there are parts if None.
        density: of the plates, kg/m³: 7850 for steel, 2700 for aluminium, 1190 for acrylic glass; None if no masses are
            asked for.
    """

    width: float
    pin: float
    thickness: float
    clearance: float = 1.0
    play: float = 0.1
    washer: float = 0.5
    spacer: float
    unit: float
    layers: int | None = None
    density: float | None = None

    @classmethod
    def of(cls, length_unit: str, **sizes: Any) -> "Shop":
        """Check the sizes, and put in those that follow from others.

        Args:
            length_unit: label of the mechanism's unit of length.
            **sizes: the attributes above by name: `width`, `pin`, `thickness`, and any others.

        Raises:
            InputError: a size that is none, or sizes that do not go together.
        """
        if sizes.get("unit") is None:
            if length_unit not in MILLIMETRES:
                raise InputError(
                    f"to_parts(): how long is a {length_unit or 'unit of length'!r} in mm? Give unit=, or use one of "
                    f"{', '.join(MILLIMETRES)} in Mechanism(length_unit=)"
                )
            sizes["unit"] = MILLIMETRES[length_unit]
        if sizes.get("spacer") is None:
            sizes["spacer"] = 2.0 * sizes["pin"] if _is_finite(sizes["pin"]) else sizes["pin"]
        found = cls(**sizes)
        layers, density = found.layers, found.density
        if layers is not None and (not isinstance(layers, Integral) or isinstance(layers, bool) or layers < 1):
            raise InputError(f"to_parts(): layers={layers!r}; give how many there may be, a whole number from 1")
        for item in fields(found)[:-2]:
            value, may_be_zero = getattr(found, item.name), item.name in _MAY_BE_ZERO
            if not _is_finite(value) or value < 0 or (value == 0 and not may_be_zero):
                what = "a number, 0 or more" if may_be_zero else "a positive number"
                raise InputError(f"to_parts(): {item.name}={value!r} must be {what}, in mm")
        # 20 kg/m³ is foam; what is less was meant in g/cm³
        if density is not None and not (_is_finite(density) and density >= 20.0):
            raise InputError(f"to_parts(): density={density!r}; give it in kg/m³: 7850 for steel, 2700 for aluminium")
        least = found.hole + 2 * found.wall
        if found.width < least:
            raise InputError(
                f"to_parts(): width={found.width:g} leaves no wall around holes of {found.hole:g} mm; make links at "
                f"least {least:g} wide, or the pins thinner"
            )
        if not found.hole < found.spacer <= found.width:
            raise InputError(
                f"to_parts(): spacer={found.spacer:g}; washers are wider than holes ({found.hole:g}) and not "
                f"wider than links ({found.width:g})"
            )
        return found

    @property
    def hole(self) -> float:
        """Diameter of holes, and width of slots."""
        return self.pin + self.play

    @property
    def wall(self) -> float:
        """The least that is left beside a hole."""
        return 0.25 * self.pin  # 0.25 of the pin's diameter is left between two holes, and around them, at least

    @property
    def pitch(self) -> float:
        """From one layer to the next."""
        return self.thickness + self.washer


SIZES = tuple(item.name for item in fields(Shop))
"""Names of what may be given of a workshop."""


def _is_finite(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)


# -- plates, holes, slots and pins -------------------------------------------------------------------------------------


GROUND = 0
"""Number of the ground plate."""

_MADE = ("revolute", "prismatic", "slot", "weld")
_SAME = 1e-6  # mm


@public
@dataclass(frozen=True)
class Frame:
    """How a part moves: its origin is a point, its x axis turns with a line of two points; or both are constant.

    Attributes:
        origin: number of a point; None of the ground.
        line: numbers of two points of one body, which give its direction; None where that is constant.
        turn: the direction, or what it is turned by, a complex number of size 1.
        span: distance of the two points, mm.
    """

    origin: int | None = None
    line: tuple[int, int] | None = None
    turn: complex = 1.0
    span: float = 1.0

    def direction(self, z: np.ndarray) -> np.ndarray:
        """Return the x axis in poses ``(T, points)``, complex, ``(T,)``."""
        if self.line is None:
            return np.full(len(z), self.turn)
        return (z[:, self.line[1]] - z[:, self.line[0]]) / self.span

    def local(self, z: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Return places ``(T,)`` as seen from the part."""
        origin = 0.0 if self.origin is None else z[:, self.origin]
        return (at - origin) / self.direction(z)

    def row(self, w: complex, points: int) -> tuple[np.ndarray, complex]:
        """Return a place of the part as a linear function of all points, ``(points,)``, and a constant."""
        out = np.zeros(points, dtype=complex)
        if self.origin is not None:
            out[self.origin] += 1.0
        if self.line is None:
            return out, w * self.turn
        out[self.line[1]] += w / self.span
        out[self.line[0]] -= w / self.span
        return out, 0.0


@public
@dataclass(frozen=True)
class Hole:
    """A round hole.

    Attributes:
        name: of the point, of the points there, ``"E + F"``, or of what its pin guides.
        at: its place in the part, complex, mm.
        pin: number of its pin, -1 if there is none.
    """

    name: str
    at: complex
    pin: int


@public
@dataclass(frozen=True)
class Slot:
    """A slot with round ends.

    Attributes:
        ends: middles of its ends in the part, complex, mm.
        pins: numbers of the pins in it.
    """

    ends: tuple[complex, complex]
    pins: tuple[int, ...]

    @property
    def length(self) -> float:
        """From middle to middle of its ends, mm."""
        return abs(self.ends[1] - self.ends[0])


@public
@dataclass(frozen=True)
class Contour:
    """All that lies within a radius of a convex shape; of one corner a circle.

    Attributes:
        kind: ``"outline"``, ``"hole"`` or ``"slot"``.
        corners: of the shape, anticlockwise, complex, mm.
        radius: mm.
    """

    kind: str
    corners: np.ndarray
    radius: float

    @property
    def area(self) -> float:
        """Area inside, mm²."""
        after = np.roll(self.corners, -1)
        shape = 0.5 * float(np.imag(np.conj(self.corners) * after).sum())
        return shape + self.radius * float(np.abs(after - self.corners).sum()) + np.pi * self.radius**2

    def place(self, origin: complex, direction: complex) -> "Contour":
        """Return the contour turned by a complex number of size 1, and then shifted."""
        # One by one: a product of arrays is rounded otherwise, and what lies on an axis would leave it.
        return Contour(self.kind, np.array([origin + complex(w) * direction for w in self.corners]), self.radius)

    def bulges(self) -> list[tuple[complex, float]]:
        """Return ends of lines and arcs, anticlockwise, each with the bulge of the way to the next.

        A bulge is the tangent of a quarter of an arc, 0 of a straight line. A circle has none.
        """
        edges = np.roll(self.corners, -1) - self.corners
        edges = edges / np.abs(edges)
        out: list[tuple[complex, float]] = []
        for k, corner in enumerate(self.corners):
            before, after = edges[k - 1], edges[k]
            turn = math.atan2((after * np.conj(before)).imag, (after * np.conj(before)).real)
            turn = turn if turn > -1e-9 else turn + 2 * math.pi  # half a turn may come out as minus half
            out.append((complex(corner - 1j * self.radius * before), math.tan(0.25 * max(turn, 0.0))))
            out.append((complex(corner - 1j * self.radius * after), 0.0))
        return out


@dataclass
class Part:
    """A plate.

    Attributes:
        name: of its body, or bodies.
        kind: ``"plate"`` (the ground), ``"link"`` or ``"slider"``.
        frame: how it moves.
        holes: its holes.
        slots: its slots.
        corners: those of its outline before it is rounded, anticlockwise in the part, complex, mm.
    """

    name: str
    kind: str
    frame: Frame
    holes: list[Hole] = field(default_factory=list)
    slots: list[Slot] = field(default_factory=list)
    corners: np.ndarray = field(default_factory=lambda: np.zeros(0, complex))

    def contours(self, shop: Shop) -> list[Contour]:
        """Return the outline, holes and slots."""
        cuts = [Contour("hole", np.array([h.at]), 0.5 * shop.hole) for h in self.holes]
        cuts += [Contour("slot", np.array(s.ends), 0.5 * shop.hole) for s in self.slots]
        return [Contour("outline", self.corners, 0.5 * shop.width), *cuts]

    @property
    def lying(self) -> complex:
        """What the part is turned by in a drawing of its own: a bar lies along x, as bars are cut."""
        if len(self.corners) != 2:
            return 1 + 0j
        along = self.corners[1] - self.corners[0]
        return complex(np.conj(along) / abs(along)) * (1 if along.real > -1e-9 * abs(along) else -1)


@dataclass
class Pin:
    """A pin.

    Attributes:
        name: of the point where it is.
        part: number of a part that has a round hole for it.
        at: its place in that part, complex, mm.
        parts: numbers of all parts that it goes through.
    """

    name: str
    part: int
    at: complex
    parts: list[int] = field(default_factory=list)


class Guide(NamedTuple):
    """A line of a part, along which pins slide."""

    carrier: int  # number of the part
    start: complex  # a place of the line in the part, mm
    along: complex  # its direction there


class _Reach(NamedTuple):
    """A stretch of a guide that pins run over."""

    start: complex
    along: complex
    low: float
    high: float
    pins: tuple[int, ...]


class PartStock:
    """Parts and pins of a mechanism in poses ``z``, ``(T, points)``, points as complex numbers in mm.

    Attributes:
        parts: plates, the ground first.
        pins: pins that go through more than one part; holes and slots say their numbers here.
        unsure: whether poses are too far apart to tell how far pins slide.
    """

    def __init__(self, motion: Motion, z: np.ndarray, shop: Shop):
        self.top, self.z, self.shop, self.unsure = motion.system.topology, z, shop, False
        n = len(self.top.points)
        self.fixed = np.array(self.top.fixed[: 2 * n], dtype=bool).reshape(n, 2)
        self.ground: np.ndarray = np.all(self.fixed, axis=1)
        self.parts = [Part("ground", "plate", Frame())]
        self.pins: list[Pin] = []
        self.holders: dict[int, set[int]] = defaultdict(set)  # parts that hold a point
        self.lines: set[int] = set()  # points that only say where a line is
        self.pin_at: dict[int, int] = {}  # the pin of a point
        self.ways: list[tuple[int, Guide]] = []  # pins and the lines that they slide along
        for joint in self.top.joints:
            if not joint.drawn or joint.type not in _MADE:
                what = joint.type if joint.drawn else f"{joint.owner.thing.name.lower()}"
                raise InputError(
                    f"to_parts(): {what} {joint.name!r} cannot be made of plates and pins; leave it out, or build the "
                    f"rest as a mechanism of its own (shared points, {', '.join(_MADE)} can)"
                )
        self._group()
        self._join()
        self._guide()
        self._drill(follow_between(motion, shop.unit) if self.ways else None)
        for part in self.parts:
            self._outline(part)
            self._check_walls(part)

    # -- parts --------------------------------------------------------------------------------------------------

    def _group(self) -> None:
        """Make a part of each set of bodies that are rigidly one; the ground takes in what is fixed to it."""
        sets = [set(body.points) for body in self.top.bodies]
        number = list(range(len(sets)))
        welds = [{*joint.bodies} for joint in self.top.joints if joint.drawn and joint.type == "weld"]
        for i, j in itertools.combinations(range(len(sets)), 2):
            if len(sets[i] & sets[j]) > 1 or {i, j} in welds:
                first, second = number[i], number[j]
                number = [first if k == second else k for k in number]
        for k in dict.fromkeys(number):
            members = [i for i, group in enumerate(number) if group == k]
            points = sorted(set().union(*(sets[i] for i in members)))
            name = " + ".join(self.top.bodies[i].name for i in members)
            if sum(self.ground[points]) > 1 or (len(points) == 1 and self.ground[points[0]]):
                self._hold(GROUND, points)
                continue
            self._hold(len(self.parts), points)
            if len(points) > 1:
                self.parts.append(Part(name, "link", self._frame_of(points)))
            else:
                self.parts.append(Part(name, "slider", Frame(points[0], *self._direction_of(members[0]))))
        self._hold(GROUND, np.flatnonzero(self.ground).tolist())

    def _hold(self, part: int, points: list[int]) -> None:
        for p in points:
            self.holders[p].add(part)

    def _frame_of(self, points: list[int]) -> Frame:
        """Span the frame of a link by its two points that are farthest apart."""
        home = self.z[0, points]
        i, j = np.unravel_index(int(np.abs(home[:, None] - home).argmax()), (len(points),) * 2)
        a, b = sorted((points[int(i)], points[int(j)]))
        return Frame(a, (a, b), span=abs(self.z[0, b] - self.z[0, a]))

    def _direction_of(self, body: int) -> tuple[tuple[int, int] | None, complex, float]:
        """Find the line that a body of one point keeps its direction to, its direction if constant, and its span."""
        found = self.top.bodies[body]
        if found.base is None:
            return None, 1.0 if self.fixed[found.points[0], 1] else 1j, 1.0
        a, b = found.base
        span = abs(self.z[0, b] - self.z[0, a])
        if self.ground[[a, b]].all():
            return None, (self.z[0, b] - self.z[0, a]) / span, 1.0
        return (a, b), 1.0, span

    def _holder(self, what: str, *points: int) -> int:
        """Find the part that holds points; the ground first."""
        found = set.intersection(*(self.holders[p] for p in points))
        if not found:
            names = " and ".join(repr(self.top.points[p]) for p in points)
            raise InputError(f"to_parts(): {what}: no body holds {names}; put them on one body, so that it can be made")
        return min(found)

    # -- pins ---------------------------------------------------------------------------------------------------

    def _join(self) -> None:
        """Put a pin wherever parts meet in a point."""
        one = list(range(len(self.top.points)))
        for joint in self.top.joints:
            if joint.type == "revolute":
                p, q = joint.points[:2]
                one = [one[p] if k == one[q] else k for k in one]
        for k in dict.fromkeys(one):
            points = [p for p, other in enumerate(one) if other == k]
            parts = sorted(set().union(*(self.holders[p] for p in points)))
            if parts:
                at = self.parts[parts[0]].frame.local(self.z, self.z[:, points[0]])[0]
                self.pin_at |= dict.fromkeys(points, len(self.pins))
                self.pins.append(Pin(self.top.points[points[0]], parts[0], complex(at), parts))

    def _guide(self) -> None:
        """Let pins slide in lines, with a second pin for what slides without turning."""
        sliders = {k for k, part in enumerate(self.parts) if part.kind == "slider"}  # that have no second pin yet
        for joint in self.top.joints:
            what = f"{joint.type} {joint.name!r}"
            if joint.type == "slot":
                a, b, p = joint.points
                guide = self._line(what, a, b)
                self._slide(p, guide)
                base = next((x.base for x in self.top.bodies if x.points == (p,)), None)
                for k in sorted(self.holders[p] & sliders) if base == (a, b) else ():
                    sliders.remove(k)
                    self._second_pin(k, p, guide)
            elif joint.type == "prismatic":
                a, b, c, d = joint.points
                slider, guide = self._holder(what, c, d), self._line(what, a, b)
                if c in (a, b):
                    raise InputError(
                        f"to_parts(): {what} begins at {self.top.points[c]!r}, a point of its own line; let it begin "
                        f"at a point of the sliding body alone"
                    )
                self._slide(c, guide)
                self._second_pin(slider, c, guide)
        for p in np.flatnonzero(np.any(self.fixed, axis=1) & ~self.ground).tolist():
            guide = Guide(GROUND, complex(self.z[0, p]), 1.0 if self.fixed[p, 1] else 1j)
            self._slide(p, guide)
            for k in sorted(self.holders[p] & sliders):
                sliders.remove(k)
                self._second_pin(k, p, guide)
        if sliders:
            raise InputError(
                f"to_parts(): body {self.parts[min(sliders)].name!r} has one point and nothing that keeps it from "
                f"turning; let its point slide in a slot, or leave the body out"
            )

    def _line(self, what: str, a: int, b: int) -> Guide:
        """Find a line of two points in the part that carries it; these points are no holes because of it."""
        self.lines.update((a, b))
        carrier = self._holder(what, a, b)
        start, toward = (self.parts[carrier].frame.local(self.z, self.z[:, k])[0] for k in (a, b))
        return Guide(carrier, complex(start), complex((toward - start) / abs(toward - start)))

    def _slide(self, p: int, guide: Guide) -> None:
        """Let the pin of a point slide in a line."""
        if p not in self.pin_at:
            raise InputError(
                f"to_parts(): point {self.top.points[p]!r} slides, and is on no body; add a body for it, so that it is "
                f"made"
            )
        self.ways.append((self.pin_at[p], guide))

    def _second_pin(self, slider: int, p: int, guide: Guide) -> None:
        """Keep a slider from turning by a pin in the same line as that of its point."""
        frame = self.parts[slider].frame
        axis = guide.along * self.parts[guide.carrier].frame.direction(self.z)[0] / frame.direction(self.z)[0]
        # 1.5 widths between the two pins that keep a slider from turning
        at = frame.local(self.z, self.z[:, p])[0] + 1.5 * self.shop.width * axis
        self.ways.append((len(self.pins), guide))
        self.pins.append(Pin(f"{self.parts[slider].name} guide", slider, complex(at), [slider]))

    # -- holes --------------------------------------------------------------------------------------------------

    def _places(self, pin: Pin, z: np.ndarray) -> np.ndarray:
        """Find where a pin is in poses ``(T, points)``, ``(T,)``."""
        row, constant = self.parts[pin.part].frame.row(pin.at, z.shape[1])
        return z @ row + constant

    def _drill(self, fine: np.ndarray | None) -> None:
        """Make holes and slots, and note which parts pins go through; with poses between, if they are known."""
        sliding = {k for k, _ in self.ways}
        shared = [k for k, pin in enumerate(self.pins) if len(pin.parts) > 1 or k in sliding]
        number = {k: new for new, k in enumerate(shared)}  # of pins that are made
        for k, pin in enumerate(self.pins):
            if k not in number and {p for p, own in self.pin_at.items() if own == k} <= self.lines:
                continue  # a point that only says where a line is
            for part in pin.parts:
                at = complex(self.parts[part].frame.local(self.z, self._places(pin, self.z))[0])
                name, holes = pin.name, self.parts[part].holes
                # Points at one place share a hole where at most one of them is pinned.
                twin = next((h for h in holes if abs(h.at - at) < _SAME and (h.pin < 0 or k not in number)), None)
                if twin:
                    holes.remove(twin)
                    name = f"{twin.name} + {name}"
                holes.append(Hole(name, at, max(number.get(k, -1), twin.pin if twin else -1)))
        reaches: dict[int, list[_Reach]] = defaultdict(list)
        z = self.z if fine is None else fine
        for k, (carrier, start, along) in self.ways:
            where = self.parts[carrier].frame.local(z, self._places(self.pins[k], z))
            t = ((where - start) * np.conj(along)).real
            # Between poses a smooth t leaves its samples by an eighth of its second differences; twice that is taken.
            sag = float(np.abs(np.diff(t, 2)).max(initial=0.0)) / 4
            self.unsure |= fine is None and sag > 0.1 * self.shop.pin
            more = sag + self.shop.clearance
            reaches[carrier].append(_Reach(start, along, float(t.min()) - more, float(t.max()) + more, (number[k],)))
            if carrier not in self.pins[k].parts:
                self.pins[k].parts.append(carrier)
        for carrier, own in reaches.items():
            self.parts[carrier].slots = [
                Slot((r.start + r.low * r.along, r.start + r.high * r.along), r.pins) for r in self._merge(own)
            ]
        self.pins = [self.pins[k] for k in shared]

    def _merge(self, own: list[_Reach]) -> list[_Reach]:
        """Make one slot of those of a part that run into each other."""
        room, out = self.shop.hole + self.shop.wall, []
        for reach in own:
            for k, r in enumerate(out):
                off, turn = (reach.start - r.start) * np.conj(r.along), reach.along * np.conj(r.along)
                if abs(off.imag) < _SAME and abs(turn.imag) < _SAME:
                    ends = sorted(off.real + np.sign(turn.real) * x for x in (reach.low, reach.high))
                    if ends[0] < r.high + room and ends[1] > r.low - room:
                        low, high = min(r.low, ends[0]), max(r.high, ends[1])
                        out[k] = _Reach(r.start, r.along, low, high, (*r.pins, *reach.pins))
                        break
            else:
                out.append(reach)
        return out if len(out) == len(own) else self._merge(out)

    def _outline(self, part: Part) -> None:
        places = np.array([h.at for h in part.holes] + [e for s in part.slots for e in s.ends], dtype=complex)
        if not len(places):
            raise InputError(f"to_parts(): {part.name!r} has no hole and no slot; pin it to something")
        xy = np.round(np.stack([np.real(places), np.imag(places)], axis=1), 9)
        _, first = np.unique(xy, axis=0, return_index=True)
        kept = np.sort(first)
        part.corners = places[kept][hull(xy[kept])] if len(kept) > 1 else places[kept]

    def _check_walls(self, part: Part) -> None:
        """Check that walls are left between holes and slots; holes that nothing is pinned in give way."""
        least = self.shop.hole + self.shop.wall
        cuts = [(h.name, (h.at, h.at), h.pin) for h in part.holes]
        cuts += [(" and ".join(self.pins[k].name for k in s.pins), s.ends, s.pins[0]) for s in part.slots]
        for (one, ends, pin), (other, others, second) in itertools.combinations(cuts, 2):
            gap = float(distance(np.array([ends]), np.array([others]))[0][0])
            if gap >= least:
                continue
            loose = [name for name, number in ((one, pin), (other, second)) if number < 0]
            if loose:
                part.holes = [h for h in part.holes if h.name != loose[0] or h.pin >= 0]
                continue
            slotted = "hole" if ends[0] == ends[1] and others[0] == others[1] else "hole or slot"
            both = f"to_parts(): {part.name!r}: the {slotted} of {one} and that of {other}"
            if gap < _SAME and slotted != "hole":
                raise InputError(
                    f"{both} run through each other, however thin the pins are: draw the guide where it does not pass "
                    f"the bearing, such as a Scotch yoke's beside the crank"
                )
            raise InputError(
                f"{both} are {gap:.3g} mm apart, and need {least:.3g}; use thinner pins, or a larger unit= (mm)"
            )
