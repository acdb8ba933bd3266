"""Which plates, holes, slots and pins a planar mechanism is made of."""

import itertools
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.io.workshop.shop import Shop
from jaxnc.kinematics.motion import Motion
from jaxnc.viz.bodies import hull

GROUND = 0
"""Number of the ground plate."""

_MADE = ("revolute", "prismatic", "slot", "weld")
_APART = 1.5  # widths: between the two pins that keep a slider from turning
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
        """Its x axis in poses ``(T, points)``, complex, ``(T,)``."""
        if self.line is None:
            return np.full(len(z), self.turn)
        return (z[:, self.line[1]] - z[:, self.line[0]]) / self.span

    def local(self, z: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Places ``(T,)`` seen from the part."""
        origin = 0.0 if self.origin is None else z[:, self.origin]
        return (at - origin) / self.direction(z)

    def row(self, w: complex, points: int) -> tuple[np.ndarray, complex]:
        """A place of the part as a linear function of all points, ``(points,)``, and a constant."""
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
        name: of the point, or of what its pin guides.
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


@dataclass(frozen=True)
class Stock:
    """Parts and pins of a mechanism; the first part is the ground plate."""

    parts: list[Part]
    pins: list[Pin]


def stock(motion: Motion, z: np.ndarray, shop: Shop) -> Stock:
    """Which parts there are in poses ``z``, ``(T, points)``, points as complex numbers in mm: parts and pins."""
    made = _Stock(motion, z, shop)
    made.group()
    made.join()
    made.guide()
    made.drill()
    for part in made.parts:
        made.outline(part)
        made.check(part)
    return Stock(made.parts, made.pins)


class _Stock:
    def __init__(self, motion: Motion, z: np.ndarray, shop: Shop):
        self.top, self.z, self.shop = motion.system.topology, z, shop
        n = len(self.top.points)
        fixed = np.array(self.top.fixed[: 2 * n], dtype=bool).reshape(n, 2)
        self.ground: np.ndarray = np.all(fixed, axis=1)
        self.half: np.ndarray = np.any(fixed, axis=1) & ~self.ground
        self.fixed = fixed
        self.parts = [Part("ground", "plate", Frame())]
        self.pins: list[Pin] = []
        self.holders: dict[int, set[int]] = defaultdict(set)  # parts that hold a point
        self.lines: set[int] = set()  # points that only say where a line is
        self.pin_at: dict[int, int] = {}  # the pin of a point
        self.ways: list[tuple[int, int, complex, complex]] = []  # pin, carrier, place and direction of a line in it
        for joint in self.top.joints:
            if not joint.drawn or joint.type not in _MADE:
                what = joint.type if joint.drawn else f"{joint.owner.thing.name.lower()}"
                raise InputError(
                    f"to_parts(): {what} {joint.name!r} cannot be made of plates and pins; leave it out, or build the "
                    f"rest as a mechanism of its own (shared points, {', '.join(_MADE)} can)"
                )

    # -- parts --------------------------------------------------------------------------------------------------

    def group(self) -> None:
        """One part for each set of bodies that are rigidly one; the ground takes in what is fixed to it."""
        sets = [set(body.points) for body in self.top.bodies]
        names = [[body.name] for body in self.top.bodies]
        number = list(range(len(sets)))
        welds = [{*joint.bodies} for joint in self.top.joints if joint.drawn and joint.type == "weld"]
        for i, j in itertools.combinations(range(len(sets)), 2):
            if len(sets[i] & sets[j]) > 1 or {i, j} in welds:
                first, second = number[i], number[j]
                number = [first if k == second else k for k in number]
        for k in dict.fromkeys(number):
            members = [i for i, group in enumerate(number) if group == k]
            points = sorted(set().union(*(sets[i] for i in members)))
            name = " + ".join(name for i in members for name in names[i])
            if sum(self.ground[points]) > 1 or (len(points) == 1 and self.ground[points[0]]):
                self.hold(GROUND, points)
                continue
            self.hold(len(self.parts), points)
            self.parts.append(
                Part(name, "link", self.framed(points))
                if len(points) > 1
                else Part(name, "slider", Frame(points[0], *self.along(members[0])))
            )
        self.hold(GROUND, np.flatnonzero(self.ground).tolist())

    def hold(self, part: int, points: list[int]) -> None:
        for p in points:
            self.holders[p].add(part)

    def framed(self, points: list[int]) -> Frame:
        home = self.z[0, points]
        i, j = np.unravel_index(int(np.abs(home[:, None] - home).argmax()), (len(points),) * 2)
        a, b = sorted((points[int(i)], points[int(j)]))
        return Frame(a, (a, b), span=abs(self.z[0, b] - self.z[0, a]))

    def along(self, body: int) -> tuple[tuple[int, int] | None, complex, float]:
        """The line that a body of one point keeps its direction to."""
        found = self.top.bodies[body]
        if found.base is None:
            return None, 1.0 if self.fixed[found.points[0], 1] else 1j, 1.0
        a, b = found.base
        span = abs(self.z[0, b] - self.z[0, a])
        if self.ground[[a, b]].all():
            return None, (self.z[0, b] - self.z[0, a]) / span, 1.0
        return (a, b), 1.0, span

    def holding(self, what: str, *points: int) -> int:
        """The part that holds points; the ground first."""
        found = set.intersection(*(self.holders[p] for p in points))
        if not found:
            names = " and ".join(repr(self.top.points[p]) for p in points)
            raise InputError(f"to_parts(): {what}: no body holds {names}; put them on one body, so that it can be made")
        return min(found)

    # -- pins ---------------------------------------------------------------------------------------------------

    def join(self) -> None:
        """A pin wherever parts meet in a point."""
        one = list(range(len(self.top.points)))
        for joint in self.top.joints:
            if joint.type == "revolute":
                p, q = joint.points[:2]
                one = [one[p] if k == one[q] else k for k in one]
        for k in dict.fromkeys(one):
            points = [p for p, other in enumerate(one) if other == k]
            parts = sorted(set().union(*(self.holders[p] for p in points)))
            if parts:
                self.add_pin(self.top.points[points[0]], points, parts)

    def add_pin(self, name: str, points: list[int], parts: list[int]) -> None:
        at = self.parts[parts[0]].frame.local(self.z, self.z[:, points[0]])[0]
        self.pin_at |= dict.fromkeys(points, len(self.pins))
        self.pins.append(Pin(name, parts[0], complex(at), parts))

    def guide(self) -> None:
        """Slots for pins that slide, and a second pin for what slides without turning."""
        turning: set[int] = set()  # sliders that have their second pin
        for joint in self.top.joints:
            what = f"{joint.type} {joint.name!r}"
            if joint.type == "slot":
                a, b, p = joint.points
                carrier = self.line(what, a, b)
                self.way(p, carrier, a, b)
                for k in sorted(self.holders[p]):
                    base = next((x.base for x in self.top.bodies if x.points == (p,)), None)
                    if self.parts[k].kind == "slider" and k not in turning and base == (a, b):
                        turning.add(k)
                        self.second(k, p, carrier, a, b)
            elif joint.type == "prismatic":
                a, b, c, d = joint.points
                slider = self.holding(what, c, d)
                carrier = self.line(what, a, b)
                if c not in (a, b):
                    self.way(c, carrier, a, b)
                    self.second(slider, c, carrier, a, b)
                else:
                    raise InputError(
                        f"to_parts(): {what} begins at {self.top.points[c]!r}, a point of its own line; let it begin "
                        f"at a point of the sliding body alone"
                    )
        for p in np.flatnonzero(self.half).tolist():
            axis = 1.0 if self.fixed[p, 1] else 1j
            for pin in self.pin_for(p):
                self.ways.append((pin, GROUND, complex(self.z[0, p]), axis))
            for k in sorted(self.holders[p]):
                if self.parts[k].kind == "slider" and k not in turning:
                    turning.add(k)
                    self.second_at(k, p, GROUND, complex(self.z[0, p]), axis)
        for k, part in enumerate(self.parts):
            if part.kind == "slider" and k not in turning:
                raise InputError(
                    f"to_parts(): body {part.name!r} has one point and nothing that keeps it from turning; let its "
                    f"point slide in a slot, or leave the body out"
                )

    def line(self, what: str, a: int, b: int) -> int:
        """The part that carries a line; its points are no holes because of it."""
        self.lines.update((a, b))
        return self.holding(what, a, b)

    def pin_for(self, p: int) -> list[int]:
        if p not in self.pin_at:
            raise InputError(
                f"to_parts(): point {self.top.points[p]!r} slides, and is on no body; add a body for it, so that it is "
                f"made"
            )
        return [self.pin_at[p]]

    def way(self, p: int, carrier: int, a: int, b: int) -> None:
        """A pin in a line of a part."""
        (pin,) = self.pin_for(p)
        start, toward = (self.parts[carrier].frame.local(self.z, self.z[:, k])[0] for k in (a, b))
        self.ways.append((pin, carrier, complex(start), complex((toward - start) / abs(toward - start))))

    def second(self, slider: int, p: int, carrier: int, a: int, b: int) -> None:
        frame = self.parts[carrier].frame
        start, toward = (frame.local(self.z, self.z[:, k])[0] for k in (a, b))
        self.second_at(slider, p, carrier, complex(start), complex((toward - start) / abs(toward - start)))

    def second_at(self, slider: int, p: int, carrier: int, start: complex, along: complex) -> None:
        """The pin that keeps a slider from turning, in the same line as its first one."""
        frame = self.parts[slider].frame
        axis = along * self.parts[carrier].frame.direction(self.z)[0] / frame.direction(self.z)[0]
        at = frame.local(self.z, self.z[:, p])[0] + _APART * self.shop.width * axis
        self.ways.append((len(self.pins), carrier, start, along))
        self.pins.append(Pin(f"{self.parts[slider].name} guide", slider, complex(at), [slider]))

    # -- holes --------------------------------------------------------------------------------------------------

    def places(self, pin: Pin) -> np.ndarray:
        """Where a pin is in all poses, ``(T,)``."""
        row, constant = self.parts[pin.part].frame.row(pin.at, self.z.shape[1])
        return self.z @ row + constant

    def drill(self) -> None:
        """Holes and slots, and which parts pins go through."""
        for k, pin in enumerate(self.pins):
            points = [p for p, number in self.pin_at.items() if number == k]
            slides = any(way[0] == k for way in self.ways)
            if len(pin.parts) < 2 and not slides and set(points) <= self.lines:
                continue  # a point that only says where a line is
            for part in pin.parts:
                at = self.parts[part].frame.local(self.z, self.places(pin))[0]
                self.parts[part].holes.append(Hole(pin.name, complex(at), k if len(pin.parts) > 1 or slides else -1))
        reaches: dict[int, list[tuple[complex, complex, float, float, tuple[int, ...]]]] = defaultdict(list)
        for k, carrier, start, along in self.ways:
            where = self.parts[carrier].frame.local(self.z, self.places(self.pins[k]))
            t = ((where - start) * np.conj(along)).real
            # Between poses a smooth t leaves its samples by an eighth of its second differences; twice that is taken.
            more = float(np.abs(np.diff(t, 2)).max(initial=0.0)) / 4 + self.shop.clearance
            reaches[carrier].append((start, along, float(t.min()) - more, float(t.max()) + more, (k,)))
            if carrier not in self.pins[k].parts:
                self.pins[k].parts.append(carrier)
        for carrier, own in reaches.items():
            self.parts[carrier].slots = [
                Slot((a + lo * e, a + hi * e), pins) for a, e, lo, hi, pins in self.merged(own)
            ]

    def merged(self, own: list) -> list:
        """Slots of one part, those that run into each other as one."""
        room, out = self.shop.hole + self.shop.wall, []
        for start, along, lo, hi, pins in own:
            for k, (a, e, low, high, others) in enumerate(out):
                off, turn = (start - a) * np.conj(e), along * np.conj(e)
                if abs(off.imag) < _SAME and abs(turn.imag) < _SAME:
                    ends = sorted((off.real + np.sign(turn.real) * lo, off.real + np.sign(turn.real) * hi))
                    if ends[0] < high + room and ends[1] > low - room:
                        out[k] = (a, e, min(low, ends[0]), max(high, ends[1]), (*others, *pins))
                        break
            else:
                out.append((start, along, lo, hi, pins))
        return out if len(out) == len(own) else self.merged(out)

    def outline(self, part: Part) -> None:
        places = np.array([h.at for h in part.holes] + [e for s in part.slots for e in s.ends], dtype=complex)
        if not len(places):
            raise InputError(f"to_parts(): {part.name!r} has no hole and no slot; pin it to something")
        xy = np.round(np.stack([np.real(places), np.imag(places)], axis=1), 9)
        _, first = np.unique(xy, axis=0, return_index=True)
        kept = np.sort(first)
        part.corners = places[kept][hull(xy[kept])] if len(kept) > 1 else places[kept]

    def check(self, part: Part) -> None:
        """Whether walls are left between holes and slots; holes that nothing is pinned in give way."""
        least = self.shop.hole + self.shop.wall
        cuts = [(h.name, (h.at, h.at), h.pin) for h in part.holes]
        cuts += [(" and ".join(self.pins[k].name for k in s.pins), s.ends, s.pins[0]) for s in part.slots]
        for (one, ends, pin), (other, others, second) in itertools.combinations(cuts, 2):
            gap = _between(ends, others)
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


def _between(one: tuple[complex, complex], other: tuple[complex, complex]) -> float:
    """Distance of two stretches."""
    from jaxnc.io.workshop.gaps import apart

    return float(apart(np.array([one]), np.array([other]))[0])
