"""Linkages of exact synthesis by the places of their pivots, and whether they really pass given poses.

Roberts' cognates are here too: the three four-bars of one coupler curve, and whether two four-bars have the same curve.
"""

import cmath
import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar, Generic, TypeVar, overload

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.kinematics.inputs import check_system
from jaxnc.kinematics.mobility import Grashof, grashof_type
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import sweep
from jaxnc.mechanism import Mechanism
from jaxnc.pickling import fields_of
from jaxnc.solvers.assembly import derive, settle
from jaxnc.synthesis.validate import check_name
from jaxnc.system.frames import marker_along
from jaxnc.system.system import System
from jaxnc.types import Any, ArrayLike, Float, Inputs

if TYPE_CHECKING:
    from jaxnc.synthesis.exact.burmester import Dyad


Point = tuple[float, float]


T = TypeVar("T")


class Listed(Sequence[T], Generic[T]):
    """A dataclass that is the sequence of what its first field holds."""

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[T, ...]: ...
    def __getitem__(self, index: int | slice) -> T | tuple[T, ...]:
        return self._items[index]

    def __len__(self) -> int:
        return len(self._items)

    @property
    def _items(self) -> tuple[T, ...]:
        return next(iter(fields_of(self).values()))


def complex_of(what: str, name: str, value: Any) -> complex:
    """Two finite numbers as one complex number."""
    try:
        x, y = (float(v) for v in value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{what}: {name} must be two numbers (x, y), got {value!r}") from None
    if not (math.isfinite(x) and math.isfinite(y)):
        raise InputError(f"{what}: {name} must be finite, got {value!r}")
    return complex(x, y)


def point_of(z: complex) -> Point:
    """A complex number as a point."""
    return (float(z.real), float(z.imag))


def describe_linkage(
    name: str, places: Mapping[str, Point], fixed: str, bodies: Mapping[str, str], angles: Mapping[str, str]
) -> Mechanism:
    """Describe a linkage whose joints have a letter each; those that are `fixed` are on the ground."""
    m = Mechanism(name)
    for joint, at in places.items():
        (m.ground if joint in fixed else m.point)(joint, at)
    for body, joints in bodies.items():
        m.body(body, list(joints))
    for angle, (at, to) in angles.items():
        m.angle(angle, at=at, to=to)
    return m


class DrawnLinkage:
    """A linkage given by the places of its joints in one pose."""

    noun: ClassVar[str]
    bars: ClassVar[tuple[str, ...]]  # those that need a length, by the joints at their ends
    example: ClassVar[tuple[Point, ...]]  # one that can be compiled
    B: Point
    C: Point
    P: Point | None

    def __post_init__(self):
        # Pairs of floats of whatever a user gave as points; B is the coupler point where none is given.
        for name, given in fields_of(self).items():
            given = self.B if name == "P" and given is None else given
            # The linkage is frozen, and an own __init__ would do the same: Python's documentation of dataclasses.
            object.__setattr__(self, name, point_of(complex_of(self.noun, name, given)))
        for one, other in self.bars:
            if getattr(self, one) == getattr(self, other):
                raise InputError(f"{self.noun}: {one} and {other} are drawn at the same place; its bars need a length")

    @property
    def ratio(self) -> complex:
        """Shape of the coupler, or connecting rod: (P - B) / (C - B) as a complex number."""
        b, c, p = (complex(*v) for v in (self.B, self.C, self.P or self.B))
        return (p - b) / (c - b)

    @property
    def places(self) -> dict[str, Point]:
        """Places of the joints of its mechanism."""
        raise NotImplementedError

    def mechanism(self) -> Mechanism:
        """The linkage as a description that can be changed, compiled and saved."""
        raise NotImplementedError

    @property
    def system(self) -> System:
        """The compiled linkage, with the coordinates of `mechanism`."""
        return _shared_system(type(self)).replace({name: np.array(at) for name, at in self.places.items()})


@functools.cache
def _shared_system(kind: type[DrawnLinkage]) -> System:
    """A compiled linkage that all of a kind share."""
    make: Callable[..., DrawnLinkage] = kind
    return make(*kind.example).mechanism().compile()


@public
@dataclasses.dataclass(frozen=True)
class FourBar(DrawnLinkage):
    """A four-bar linkage A-B-C-D as drawn in one pose; the crank is A-B, the ground A-D.

    Args:
        A: fixed pivot of the crank, lengths.
        B: moving pivot of the crank.
        C: moving pivot of the rocker.
        D: fixed pivot of the rocker.
        P: the coupler point; B if not given.
    """

    noun = "four-bar"
    bars = "AB", "BC", "CD", "AD"
    example = (0.0, 0.0), (0.3, 0.8), (2.1, 1.9), (2.5, 0.0), (1.0, 2.0)
    A: Point
    B: Point
    C: Point
    D: Point
    P: Point | None = None

    @property
    def z(self) -> tuple[complex, complex, complex, complex, complex]:
        """A, B, C, D and P as complex numbers."""
        a, b, c, d, p = (complex(*getattr(self, name)) for name in "ABCDP")
        return a, b, c, d, p

    @property
    def lengths(self) -> dict[str, float]:
        """Lengths of ground A-D, crank A-B, coupler B-C and rocker C-D."""
        a, b, c, d, _ = self.z
        return {"ground": abs(d - a), "crank": abs(b - a), "coupler": abs(c - b), "rocker": abs(d - c)}

    @property
    def grashof(self) -> Grashof:
        """Type and margin, see `jaxnc.kinematics.grashof_type`."""
        return grashof_type(**self.lengths)

    def reversed(self) -> "FourBar":
        """Exchange A and D, B and C: the linkage with the rocker as its crank."""
        return FourBar(self.D, self.C, self.B, self.A, self.P)

    @property
    def places(self) -> dict[str, Point]:
        """Places of the joints."""
        return {name: getattr(self, name) for name in "ADBCP"}

    def mechanism(self, name: str = "four-bar") -> Mechanism:
        """The linkage as a description that can be changed, compiled and saved.

        It has the angles ``phi`` of the crank, ``psi`` of the rocker and ``theta`` of the coupler, from the x axis.
        """
        bodies = {"crank": "AB", "coupler": "BCP", "rocker": "CD"}
        return describe_linkage(name, self.places, "AD", bodies, {"phi": "AB", "psi": "DC", "theta": "BC"})

    def move(self, inputs: Inputs) -> Motion:
        """Sweep the linkage from its drawing; inputs as in `jaxnc.sweep`, one of phi, psi and theta."""
        return sweep(self.system, inputs)

    @classmethod
    def of(cls, system: System, point: str = "P") -> "FourBar":
        """Read a four-bar off a system.

        Args:
            system: a system with two fixed pivots, two bars and a coupler; markers and more points do not matter.
            point: the coupler point, a point or marker of the coupler.

        Returns:
            The linkage, drawn as the assembled system; its crank is the first of the two bars.

        Raises:
            InputError: unknown point, or a system that is no four-bar with this coupler point.
        """
        check_system(system, "a four-bar read off a system")
        top = system.topology
        if top.dim != 2:
            raise InputError(f"{top.name!r} is spatial; a four-bar with a coupler curve is planar")
        markers = {m.name: m for m in top.markers}
        check_name(point, (*top.points, *markers), f"{top.name!r} has no coupler point {point!r}")
        fixed = {i for i in range(len(top.points)) if all(top.fixed[2 * i : 2 * i + 2])}
        bars = [b for b in top.bodies if len(set(b.points) & fixed) == 1]
        others = [b for b in top.bodies if not set(b.points) & fixed]
        if len(bars) != 2 or len(others) != 1 or len(top.bodies) != 3:
            raise InputError(
                f"{top.name!r} is no four-bar: it has {len(bars)} bodies on a fixed pivot and {len(others)} other "
                f"bodies; a four-bar has 2 and 1"
            )
        coupler = set(others[0].points)
        ends = [set(b.points) & coupler for b in bars]
        if any(len(e) != 1 for e in ends) or ends[0] == ends[1]:
            raise InputError(f"{top.name!r} is no four-bar: its bars must each share one point with {others[0].name!r}")
        if point in top.points and top.points.index(point) not in coupler:
            raise InputError(f"point {point!r} is not on the coupler {others[0].name!r}; its points are "
                             f"{', '.join(top.points[i] for i in sorted(coupler))}")  # fmt: skip
        eq = derive(system)
        q = settle(eq, np.zeros(len(top.coordinates))).q
        place = dict(zip(top.points, np.asarray(q)[: 2 * len(top.points)].reshape(-1, 2), strict=True))
        place |= {name: np.asarray(marker_along(eq, k, q, ())) for k, name in enumerate(markers)}
        pivots = [top.points[(set(b.points) & fixed).pop()] for b in bars]
        joints = [top.points[e.pop()] for e in ends]
        names = pivots[0], joints[0], joints[1], pivots[1], point
        return cls(*(point_of(complex(*place[name])) for name in names))


def wrap_angle(angle: ArrayLike) -> Any:
    """An angle between -π and π, radians."""
    return np.angle(np.exp(1j * np.asarray(angle)))


def sweep_through(system: System, inputs: np.ndarray, parts: int, least: int = 0) -> tuple[Motion, np.ndarray]:
    """Sweep from each value of ``phi`` to the next in equal parts: the motion, and the numbers of these values' poses.

    The last pose is there more than once, until there are at least so many steps.
    """
    at = np.arange(len(inputs)) * parts
    return sweep(system, {"phi": np.interp(np.arange(max(least, at[-1]) + 1), at, inputs)}), at


@public
@dataclasses.dataclass(frozen=True)
class SliderCrank(DrawnLinkage):
    """A slider-crank A-B-C as drawn in one pose; C slides along a fixed line.

    Args:
        A: fixed pivot of the crank, lengths.
        B: crank pin.
        C: slider.
        direction: direction of the line through C, any length.
        P: point of the connecting rod; B if not given.
    """

    noun = "slider-crank"
    bars = "AB", "BC"
    example = (0.0, 0.0), (0.3, 0.8), (2.1, 0.1), (1.0, 0.0), (1.0, 1.0)
    A: Point
    B: Point
    C: Point
    direction: Point = (1.0, 0.0)
    P: Point | None = None

    def __post_init__(self):
        super().__post_init__()
        if self.direction == (0.0, 0.0):
            raise InputError("slider-crank: direction = (0, 0) has no direction; give the line's, such as (1, 0)")

    @property
    def places(self) -> dict[str, Point]:
        """Places of the joints, and of two points G and H of the line, as far apart as the connecting rod is long."""
        b, c, way = (complex(*v) for v in (self.B, self.C, self.direction))
        line = point_of(c + way / abs(way) * abs(c - b))
        return {"A": self.A, "G": self.C, "H": line, "B": self.B, "C": self.C, "P": self.P or self.B}

    def mechanism(self, name: str = "slider-crank") -> Mechanism:
        """A description with the angles ``phi`` of the crank and ``theta`` of the connecting rod, from the x axis."""
        angles = {"phi": "AB", "theta": "BC"}
        m = describe_linkage(name, self.places, "AGH", {"crank": "AB", "conrod": "BCP"}, angles)
        m.slot("guide", "C", ("G", "H"))
        m.body("slider", ["C"])
        return m


_STEPS = 48  # between first and last of 2 to 5 poses: one shape, so that it is compiled once


@public
@dataclasses.dataclass(frozen=True)
class GuidedFourBar:
    """A four-bar through given poses; ``print()`` says how well.

    Attributes:
        linkage: the four-bar, drawn in the first pose; P is the body's origin, and the crank A-B drives it.
        inputs: crank angle ``phi`` in every pose, in the order of the poses, radians, ``(n,)``.
        error: largest distance from a pose after really moving there: lengths, and angles, counted from the first pose,
            times the poses' size, or the coupler's length where they are at one place; NaN if it does not get there.
        transmission: smallest transmission angle on the way, radians; 0 if it does not get there.
        defects: ``"circuit"``: some poses belong to the other assembly of the linkage; ``"branch"``: a dead point of
            either bar lies between, or a position in which all bars are in line, so that the linkage may leave it the
            other way; ``"order"``: the poses are passed in another order. Empty: the design works.
    """

    linkage: FourBar
    inputs: np.ndarray
    error: float
    transmission: float
    defects: tuple[str, ...]

    @property
    def system(self) -> System:
        """The compiled linkage: drive ``phi`` through `inputs`."""
        return self.linkage.system

    def __repr__(self) -> str:
        sizes = ", ".join(f"{name} {value:.6g}" for name, value in self.linkage.lengths.items())
        state = f"{', '.join(self.defects)} defect" if self.defects else f"works, error {self.error:.1e}"
        angle = f"; transmission angle ≥ {math.degrees(self.transmission):.1f}°" if not self.defects else ""
        return f"four-bar: {sizes}; {self.linkage.grashof.type}; {state}{angle}"


def _draw_exact(pose: np.ndarray, crank: "Dyad", rocker: "Dyad") -> FourBar:
    """Draw two dyads that go through a pose."""
    return FourBar(crank.fixed, crank.moving, rocker.moving, rocker.fixed, (pose[0], pose[1]))


def _draw_near(pose: np.ndarray, crank: "Dyad", rocker: "Dyad") -> FourBar:
    """Draw two dyads that come near a pose: the crank in its direction there, the body where the rocker holds it.

    Raises:
        InputError: the bars do not reach each other.
    """
    a, d, body = complex(*crank.fixed), complex(*rocker.fixed), complex(*pose[:2])
    near_b, near_c = complex(*crank.places[0]), complex(*rocker.places[0])
    b = a + crank.length * (near_b - a) / abs(near_b - a)
    to_d, coupler = d - b, abs(near_c - near_b)
    along = (abs(to_d) ** 2 + coupler**2 - rocker.length**2) / (2.0 * abs(to_d))
    if abs(along) > coupler:
        raise InputError("guidance: the bars of the two dyads do not reach each other in the first pose")
    side = 1.0 if (np.conj(to_d) * (near_c - near_b)).imag >= 0 else -1.0
    c = b + (along + 1j * side * math.sqrt(coupler**2 - along**2)) * to_d / abs(to_d)
    p = b + (body - near_b) * (c - b) / (near_c - near_b)
    return FourBar(point_of(a), point_of(b), point_of(c), point_of(d), point_of(p))


_BACK = 0.1  # radians that a bar may go back between poses that are only met nearly


def guide_four_bar(poses: np.ndarray, crank: "Dyad", rocker: "Dyad", near: bool = False) -> GuidedFourBar:
    """Assemble two dyads and move them through the poses, from either bar and in either direction.

    Of dyads that go exactly through the poses the linkage has to reach them. Of those that only come `near`, it has to
    stay in the assembly that is nearer.

    Returns:
        The linkage driven by the bar and in the direction that pass all poses in order; the given crank if none does.
    """
    draw, slack = (_draw_near, _BACK) if near else (_draw_exact, 0.0)
    best: GuidedFourBar | None = None
    in_line = False  # whether the poses are passed in order, but for a position in which two bars are in line
    least = 1e-6  # radians of transmission: they are
    for first, second in ((crank, rocker), (rocker, crank)):
        linkage = draw(poses[0], first, second)
        way = first.places - np.array(first.fixed)
        angles = np.arctan2(way[:, 1], way[:, 0])
        for direction in (1.0, -1.0):
            steps = direction * (np.mod(direction * np.diff(angles) + slack, 2.0 * np.pi) - slack)
            if abs(steps.sum()) > 2.0 * np.pi + slack:
                continue  # more than one turn: the poses are passed in another order
            inputs = angles[0] + np.concatenate([[0.0], np.cumsum(steps)])
            transmission = _least_transmission(linkage, inputs)
            if transmission <= least:
                in_line = in_line or abs(linkage.grashof.margin) <= least * max(linkage.lengths.values())
                continue
            error, same = _move_through(linkage, inputs, poses, second.places)
            in_line = in_line or math.isinf(error)  # it closes everywhere, but bars of great length are too nearly so
            # An exact pose that is further off, after really moving there, is not reached.
            if error <= 1e-8 * _span_of_poses(poses, linkage) or (near and same):
                found = GuidedFourBar(linkage, inputs, error, transmission, ())
                if best is None or found.transmission > best.transmission:
                    best = found
    if best is not None:
        return best
    linkage = draw(poses[0], crank, rocker)
    way = crank.places - np.array(crank.fixed)
    inputs = np.unwrap(np.arctan2(way[:, 1], way[:, 0]))
    return GuidedFourBar(linkage, inputs, math.nan, 0.0, ("branch" if in_line else _defect(linkage, crank, rocker),))


def _span_of_poses(poses: np.ndarray, linkage: FourBar) -> float:
    """Size of the poses, or length of the coupler where all of them are at one place."""
    spread, coupler = float(np.ptp(poses[:, :2], axis=0).max()), linkage.lengths["coupler"]
    return spread if spread > 1e-6 * coupler else coupler


def _least_transmission(linkage: FourBar, inputs: np.ndarray) -> float:
    """Smallest transmission angle from the first crank angle to the last; 0 if the linkage does not close everywhere.

    It is at an end, or where the crank is in line with the ground.
    """
    a, _, _, d, _ = linkage.z
    ground, crank, coupler, rocker = (linkage.lengths[name] for name in ("ground", "crank", "coupler", "rocker"))
    low, high = min(inputs), max(inputs)
    along = np.angle(d - a) + np.pi * np.arange(-8, 9)
    turns = np.concatenate([inputs, along[(along > low) & (along < high)]]) - np.angle(d - a)
    square = ground**2 + crank**2 - 2.0 * ground * crank * np.cos(turns)
    cosine = (coupler**2 + rocker**2 - square) / (2.0 * coupler * rocker)
    return float(np.arccos(np.minimum(np.abs(cosine), 1.0)).min())


def _move_through(linkage: FourBar, inputs: np.ndarray, poses: np.ndarray, rocker: np.ndarray) -> tuple[float, bool]:
    """Sweep a linkage through poses in which the end of its rocker has given places, ``(n, 2)``.

    Returns:
        The error in the poses, and whether the assembly that it moves in is the one that is nearer; infinite and false
        if it stops.
    """
    motion, at = sweep_through(linkage.system, inputs, max(1, _STEPS // (len(poses) - 1)), _STEPS)
    if not np.asarray(motion.converged).all():
        return math.inf, False
    place = np.asarray(motion["P"])[at]
    turn = np.asarray(motion["theta"])[at]
    off = np.hypot(*(place - poses[:, :2]).T)
    tilt = np.abs(wrap_angle(turn - turn[0] - poses[:, 2] + poses[0, 2])) * _span_of_poses(poses, linkage)
    b, c, d = (np.asarray(motion[name])[at] @ [1.0, 1j] for name in "BCD")
    # On the same side of the line from B to D as the place where it should be.
    sides = [np.imag(np.conj(d - b) * (z - b)) > 0 for z in (c, rocker @ [1.0, 1j])]
    return float(max(off.max(), tilt.max())), bool((sides[0] == sides[1]).all())


def _defect(linkage: FourBar, crank: "Dyad", rocker: "Dyad") -> str:
    """Why the poses are not passed in order.

    A Grashof linkage never passes the pose in which the two bars not next to its shortest one are in line: the side of
    that triangle tells its two circuits apart. A bar cannot drive past the pose in which the other two are in line.

    Source: T. R. Chase and J. A. Mirth, Circuits and branches of single-degree-of-freedom planar linkages, J. Mech.
    Des. 115 (1993) 223-230.
    """
    a, d = complex(*crank.fixed), complex(*rocker.fixed)
    b, c = (x.places[:, 0] + 1j * x.places[:, 1] for x in (crank, rocker))

    def sides(p, q, r) -> bool:
        cross = (np.conj(p - q) * (r - q)).imag
        return bool(np.all(cross > 0) or np.all(cross < 0))

    joints = {"B": sides(a, b, c), "C": sides(b, c, d), "A": sides(b, a, d), "D": sides(a, d, c)}
    if linkage.grashof.margin > 0:
        lengths = linkage.lengths
        shortest = min(lengths, key=lambda name: lengths[name])
        opposite = {"ground": "BC", "crank": "CD", "coupler": "AD", "rocker": "AB"}[shortest]
        if not all(joints[name] for name in opposite):
            return "circuit"
    # Crank-driven the side of B-C-D is kept, rocker-driven that of A-B-C.
    return "order" if joints["C"] or joints["B"] else "branch"


# -- cognates ----------------------------------------------------------------------------------------------------------


SAME = 1e-9
"""Curves whose parameters differ by less than this part of their size are the same."""

_FLAT = 1e-9  # of the size: a coupler point this close to a joint has no cognates


@public
def roberts_cognates(linkage: FourBar | System, point: str = "P") -> tuple[FourBar, FourBar]:
    """The two other four-bars whose coupler point draws the same curve (Roberts-Chebyshev theorem).

    All three are drawn with the coupler point in the same place. With the fixed pivots A, D of the given linkage and
    E, the third vertex of the triangle A-D-E similar to its coupler B-C-P:

    - the first stands on A and E, and its *coupler* turns with the given crank;
    - the second stands on E and D, and its *crank* at E turns with the given crank, so that it draws the curve with the
      same timing.

    Args:
        linkage: a four-bar; or a system, from which one is read (`FourBar.of`).
        point: the coupler point of a system.

    Returns:
        The two cognates; `FourBar.system` compiles them.

    Raises:
        InputError: a system that is no four-bar, or a coupler point on a moving pivot, which draws a circle.

    Source: S. Roberts, On three-bar motion in plane space, Proc. London Math. Soc. 7 (1875) 14-23; R. S. Hartenberg and
    J. Denavit, Kinematic Synthesis of Linkages (1964), chapter 6.
    """
    given = linkage if isinstance(linkage, FourBar) else FourBar.of(linkage, point)
    first = _left_cognate(given)
    second = _left_cognate(given.reversed()).reversed()  # on D and E; its crank is the one at E
    return first, second


def _left_cognate(linkage: FourBar) -> FourBar:
    """The cognate on A and E: the parallelogram A-B-P-B' and a coupler similar to the given one."""
    a, b, _, d, p = linkage.z
    k = _coupler_shape(linkage)
    moved = a + p - b
    return FourBar(
        point_of(a), point_of(moved), point_of(moved + k * (b - a)), point_of(a + k * (d - a)), point_of(p)
    )  # fmt: skip


def _coupler_shape(linkage: FourBar) -> complex:
    k = linkage.ratio
    for name, distance in (("B", abs(k)), ("C", abs(1.0 - k))):
        if distance < _FLAT:
            raise InputError(
                f"cognates: the coupler point lies on the moving pivot {name} and draws a circle, so there are no "
                f"cognates; choose a point of the coupler off its pivots"
            )
    return k


@public
def coupler_curve(linkage: FourBar | System, point: str = "P") -> Float[np.ndarray, "3 3"]:
    """The nine numbers that a coupler curve has, the same for all three cognates.

    A coupler curve has three foci, the fixed pivots of its cognates, and at each focus stands one number: a bar's
    length over the distance of the linkage's fixed pivots. In the linkage on A and D with third focus E, that of the
    crank A-B belongs to D, that of the rocker C-D to A, that of the coupler B-C to E; the same rule read off either
    cognate gives the same three pairs.

    Args:
        linkage: a four-bar, or a system from which one is read.
        point: the coupler point of a system.

    Returns:
        A row for each focus: x, y, number. Rows are in order of x, then y.

    Raises:
        InputError: as in `roberts_cognates`.

    Source: own derivation from Roberts' construction; the foci are those of S. Roberts (1875).
    """
    given = linkage if isinstance(linkage, FourBar) else FourBar.of(linkage, point)
    a, _, _, d, _ = given.z
    k = _coupler_shape(given)
    size = given.lengths
    foci = [(a, size["rocker"]), (d, size["crank"]), (a + k * (d - a), size["coupler"])]
    rows = np.array([(z.real, z.imag, length / size["ground"]) for z, length in foci])
    return rows[np.lexsort((rows[:, 1], rows[:, 0]))]


@public
def same_curve(one: FourBar | System, other: FourBar | System, point: str = "P", tolerance: float = SAME) -> bool:
    """Tell whether two four-bars draw the same coupler curve: the same linkage, or cognates.

    Place, size and orientation count: a linkage moved elsewhere draws another curve. A curve may have two parts, drawn
    by the two assemblies of one linkage; they belong together here.

    Args:
        one: a four-bar, or a system from which one is read.
        other: another.
        point: the coupler point of systems.
        tolerance: difference of foci and numbers, as a part of the curve's size.

    Returns:
        True if all nine parameters of the curves agree.

    Raises:
        InputError: as in `roberts_cognates`.
    """
    return _curve_gap(coupler_curve(one, point), coupler_curve(other, point)) <= tolerance


def _curve_gap(x: np.ndarray, y: np.ndarray) -> float:
    """Largest difference of two curves' parameters, matching foci whichever their order (they may nearly coincide)."""
    size = max(float(np.ptp(x[:, :2], axis=0).max()), 1e-300)
    scale = np.array([size, size, max(1.0, float(np.abs(x[:, 2]).max()))])
    return min(float(np.abs((x - y[list(order)]) / scale).max()) for order in itertools.permutations(range(3)))


@public
def distinct(
    linkages: Sequence[FourBar | System], point: str = "P", tolerance: float = SAME
) -> list[list[int]]:  # fmt: skip
    """Group four-bars by their coupler curves.

    Args:
        linkages: four-bars or systems, the best first.
        point: the coupler point of systems.
        tolerance: as in `same_curve`.

    Returns:
        For each different curve the places of its linkages in the sequence, in order of first appearance; the first of
        each group is the one to keep.

    Raises:
        InputError: as in `roberts_cognates`.
    """
    curves = [coupler_curve(linkage, point) for linkage in linkages]
    groups: list[list[int]] = []
    for i, curve in enumerate(curves):
        like = next((group for group in groups if _curve_gap(curves[group[0]], curve) <= tolerance), None)
        if like is None:
            groups.append(like := [])
        like.append(i)
    return groups


@public
def slider_crank_cognate(linkage: SliderCrank) -> SliderCrank:
    """The other slider-crank whose rod point draws the same curve; its connecting rod turns with the given crank.

    Args:
        linkage: a slider-crank with a point P off its crank pin.

    Returns:
        The cognate, on the same crank pivot, its line turned and scaled by the rod's shape about that pivot.

    Raises:
        InputError: a point P on the crank pin, which draws a circle.

    Source: limit of Roberts' theorem with one fixed pivot at infinity; Hartenberg and Denavit (1964), chapter 6.
    """
    k = linkage.ratio
    if abs(k) < _FLAT:
        raise InputError(
            "cognates: the point P lies on the crank pin B and draws a circle, so there is no cognate; choose another"
        )
    a, b = complex(*linkage.A), complex(*linkage.B)
    p = complex(*(linkage.P or linkage.B))
    pin = a + p - b
    line = complex(*linkage.direction) * cmath.rect(1.0, float(np.angle(k)))
    return SliderCrank(linkage.A, point_of(pin), point_of(pin + k * (b - a)), point_of(line), point_of(p))
