"""Write a design of a chain of dyads as an ordinary mechanism, drawn where its crank begins."""

from typing import Any, NamedTuple

import numpy as np

from jaxnc.calls import public
from jaxnc.mechanism import Mechanism
from jaxnc.synthesis.tracing.chains import CRANK, GROUND, KINDS, Chain
from jaxnc.synthesis.tracing.curves import EACH, begin, close

TRACER = "P"
INPUT = "phi"
_NAMES = [c for c in "ABCDEFGHIJKLMNOQRSTUVW"]
_SAME = 1e-9  # of the drawing's size: places that are one


@public
class ChainDesign(NamedTuple):
    """A design of a chain as numbers, its place among them."""

    chain: Chain
    sign: np.ndarray  # (dyads,)
    design: np.ndarray  # (6 dyads + 2,), in units of the crank
    place: complex  # of the crank's pivot
    factor: complex  # size and turn
    begin: float  # angle of the crank, before the turn
    span: float  # how far it goes

    def frames(self, theta: Any) -> list[tuple[Any, Any]]:
        """Origins and directions of all bodies where the crank has an angle or some, complex, in units of the crank."""
        frames = begin(np.asarray(theta, float))
        for d, (kind, a, b) in enumerate(self.chain.dyads):
            row = self.design[EACH * d : EACH * (d + 1)]
            on, other = frames[a], frames[b]
            p, q = on.at((row[0], row[1])), other.at((row[2], row[3]))
            lines = ((np.cos(angle), np.sin(angle)) for angle in row[4:])
            frames += close(KINDS.index(kind), self.sign[d], p, q, on.along, other.along, *row[4:], *lines)[2]
        return [(x + 1j * y, c + 1j * s) for (x, y), (c, s) in frames]

    def trace(self, theta: Any) -> np.ndarray:
        """Place of the tracing point at some angles of the crank, complex ``(T,)``."""
        origin, along = self.frames(np.atleast_1d(theta))[self.chain.tracer]
        return self.place + self.factor * (origin + along * complex(*self.design[-2:]))


class _Sheet:
    """Names and places of a mechanism's points, and who carries them."""

    def __init__(self, drawn: ChainDesign):
        self.drawn, self.frames = drawn, drawn.frames(drawn.begin)
        self.places: dict[str, complex] = {}
        self.on: dict[int, list[str]] = {body: [] for body in range(drawn.chain.bars)}
        self.fresh = iter([*_NAMES, *(f"{c}{k}" for k in (1, 2, 3) for c in _NAMES)])
        self.size = 1.0

    @property
    def pin(self) -> str:
        """The point of the crank that is farthest from its pivot."""
        return max(self.on[CRANK][1:], key=lambda point: abs(self.places[point]))

    def add(self, at: complex, *bodies: int) -> str:
        """Take a point that bodies share; if one of them has a point there, that one."""
        for body in bodies:
            for name in self.on[body]:
                if abs(self.places[name] - at) <= _SAME * self.size:
                    for other in bodies:
                        if name not in self.on[other]:
                            self.on[other].append(name)
                    return name
        name = next(self.fresh)
        self.places[name] = at
        for body in bodies:
            self.on[body].append(name)
        return name


def to_mechanism(drawn: ChainDesign, name: str = "") -> tuple[Mechanism, float]:
    """Write a design as a mechanism; the angle of its crank as it is drawn, radians, comes with it.

    The crank turns by the angle ``phi``, and the point ``P`` traces. Joints that turn are points that bodies share; a
    sliding link has a prismatic joint with the line on which it slides.
    """
    sheet = _Sheet(drawn)
    long = float(np.median([max(abs(complex(*row[:2])), 0.1) for row in drawn.design[:-2].reshape(-1, EACH)]))
    slides, m = _hang(sheet, long), Mechanism(name or drawn.chain.name)

    def put(at: complex) -> tuple[float, float]:
        z = drawn.place + drawn.factor * at
        return float(z.real), float(z.imag)

    ends: dict[int, tuple[str, complex]] = {}
    for _, body, at, along in slides:  # a sliding body's direction is that of two of its points
        first = sheet.add(at, body)
        ends[body] = first, at + long * along
    on: dict[int, tuple[str, str]] = {}
    for body, (first, far) in ends.items():
        on[body] = first, sheet.add(far, body)
    for point, at in sheet.places.items():
        (m.ground if point in sheet.on[GROUND] else m.point)(point, put(at))
    for body in range(CRANK, drawn.chain.bars):
        m.body("crank" if body == CRANK else f"link {body}", _farthest_first(sheet, body))
    for k, (line, body, _, _) in enumerate(slides):
        m.prismatic(f"slide {k + 1}", line, on[body])
    m.angle(INPUT, at=sheet.on[CRANK][0], to=sheet.pin)
    return m, float(np.angle(drawn.factor * sheet.places[sheet.pin]))


def _hang(sheet: _Sheet, long: float) -> list[tuple[tuple[str, str], int, complex, complex]]:
    """Hang up all dyads: points go on the sheet, and of what slides the line, the body, its place and its direction.

    A line has its second point so far from the first as `long` says. The tracing point comes last.
    """
    drawn, chain, frames = sheet.drawn, sheet.drawn.chain, sheet.frames
    sheet.add(0j, GROUND, CRANK)
    slides: list[tuple[tuple[str, str], int, complex, complex]] = []
    for d, (kind, a, b) in enumerate(chain.dyads):
        row = drawn.design[EACH * d : EACH * (d + 1)]
        one, two = 2 + 2 * d, 3 + 2 * d
        (o, u), (oo, w) = frames[a], frames[b]
        p, q = o + u * complex(row[0], row[1]), oo + w * complex(row[2], row[3])
        if kind[0] == "R":
            sheet.add(p, a, one)
        if kind == "RPR":
            sheet.add(q, b, two)
            slides.append((_line(sheet, one, q, frames[one][1], long), two, q, frames[one][1]))
            continue
        inner = frames[two][0] if kind != "RRR" else frames[one][0] + frames[one][1] * row[4]
        sheet.add(inner, one, two)
        if kind == "RRR":
            sheet.add(q, b, two)
        if kind[0] == "P":
            slides.append((_line(sheet, a, p, frames[one][1], long), one, inner, frames[one][1]))
        if kind[2] == "P":
            slides.append((_line(sheet, b, q, frames[two][1], long), two, inner, frames[two][1]))
    origin, along = frames[chain.tracer]
    sheet.places[TRACER] = origin + along * complex(*drawn.design[-2:])
    sheet.on[chain.tracer].append(TRACER)
    return slides


def to_joints(drawn: ChainDesign) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Write a design of turning joints as points and bars between them.

    Returns:
        Places ``(n, 2)``, the crank's pivot first, its pin second, the tracing point last; which pairs are bars,
        ``(n, n)`` of 0 and 1; and which points stay where they are, ``(n,)`` of 0 and 1.
    """
    sheet = _Sheet(drawn)
    _hang(sheet, 1.0)
    first = [sheet.on[CRANK][0], sheet.pin]
    order = [*first, *(point for point in sheet.places if point not in first)]
    at = {point: k for k, point in enumerate(order)}
    bars = np.zeros((len(order), len(order)), np.int8)
    for body in range(CRANK, drawn.chain.bars):
        base = first if body == CRANK else sheet.on[body][:2]
        pairs = [tuple(base), *((end, point) for point in sheet.on[body] if point not in base for end in base)]
        for a, b in pairs:
            bars[at[a], at[b]] = bars[at[b], at[a]] = 1
    z = drawn.place + drawn.factor * np.array([sheet.places[point] for point in order])
    fixed = np.array([point in sheet.on[GROUND] for point in order], np.int8)
    return np.stack([z.real, z.imag], axis=1), bars, fixed


def _line(sheet: _Sheet, body: int, at: complex, along: complex, long: float) -> tuple[str, str]:
    """Two points of a body on a line of it."""
    return sheet.add(at, body), sheet.add(at + long * along, body)


def _farthest_first(sheet: _Sheet, body: int) -> list[str]:
    """Points of a body, its base of two far ones first: what rides on them is known best then."""
    names = list(sheet.on[body])
    places = np.array([sheet.places[n] for n in names])
    apart = np.abs(places[:, None] - places)
    first, second = np.unravel_index(apart.argmax(), apart.shape)
    base = [names[i] for i in sorted((int(first), int(second)))]
    return [*base, *(n for n in names if n not in base)]
