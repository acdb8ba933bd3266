"""A four-bar linkage by the places of its pivots: what exact synthesis returns and cognates are made of."""

import cmath
import dataclasses
import functools
import math

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.inputs import check_system
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.planar import Grashof, grashof_type
from jaxnc.kinematics.position import sweep
from jaxnc.mechanism import Mechanism
from jaxnc.solvers.assembly import derive, settle
from jaxnc.system.frames import marker_rates
from jaxnc.system.system import System
from jaxnc.types import Any, Inputs

Point = tuple[float, float]


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


@public
@dataclasses.dataclass(frozen=True)
class FourBar:
    """A four-bar linkage A-B-C-D as drawn in one pose; the crank is A-B, the ground A-D.

    Args:
        A: fixed pivot of the crank, lengths.
        B: moving pivot of the crank.
        C: moving pivot of the rocker.
        D: fixed pivot of the rocker.
        P: the coupler point; B if not given.
    """

    A: Point
    B: Point
    C: Point
    D: Point
    P: Point | None = None

    def __post_init__(self):
        for name in "ABCDP":
            value = getattr(self, name)
            value = self.B if name == "P" and value is None else value
            object.__setattr__(self, name, point_of(complex_of("four-bar", name, value)))
        for one, other in ("AB", "BC", "CD", "AD"):
            if getattr(self, one) == getattr(self, other):
                raise InputError(f"four-bar: {one} and {other} are drawn at the same place; its bars need a length")

    @property
    def z(self) -> tuple[complex, complex, complex, complex, complex]:
        """A, B, C, D and P as complex numbers."""
        return tuple(complex(*getattr(self, name)) for name in "ABCDP")  # type: ignore[return-value]

    @property
    def lengths(self) -> dict[str, float]:
        """Lengths of ground A-D, crank A-B, coupler B-C and rocker C-D."""
        a, b, c, d, _ = self.z
        return {"ground": abs(d - a), "crank": abs(b - a), "coupler": abs(c - b), "rocker": abs(d - c)}

    @property
    def grashof(self) -> Grashof:
        """Type and margin, see `jaxnc.kinematics.grashof_type`."""
        return grashof_type(**self.lengths)

    @property
    def ratio(self) -> complex:
        """Shape of the coupler: (P - B) / (C - B) as a complex number."""
        _, b, c, _, p = self.z
        return (p - b) / (c - b)

    def reversed(self) -> "FourBar":
        """The same linkage with the rocker as its crank: A and D, B and C exchanged."""
        return FourBar(self.D, self.C, self.B, self.A, self.P)

    def mechanism(self, name: str = "four-bar") -> Mechanism:
        """The linkage as a description that can be changed, compiled and saved; see `system` for its coordinates."""
        m = Mechanism(name)
        m.ground("A", self.A)
        m.ground("D", self.D)
        m.point("B", self.B)
        m.point("C", self.C)
        assert self.P is not None
        m.point("P", self.P)
        m.body("crank", ["A", "B"])
        m.body("coupler", ["B", "C", "P"])
        m.body("rocker", ["C", "D"])
        m.angle("phi", at="A", to="B")
        m.angle("psi", at="D", to="C")
        m.angle("theta", at="B", to="C")
        return m

    @property
    def system(self) -> System:
        """The compiled linkage: angles of crank ``phi``, rocker ``psi`` and coupler ``theta``, all from the x axis."""
        return _template().replace({name: np.array(getattr(self, name)) for name in "ABCDP"})

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
        if point not in (*top.points, *markers):
            raise InputError(f"{top.name!r} has no coupler point {point!r}; {nearest(point, (*top.points, *markers))}")
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
        place |= dict(zip(markers, np.asarray(marker_rates(eq, q, ())), strict=True)) if markers else {}
        pivots = [top.points[(set(b.points) & fixed).pop()] for b in bars]
        joints = [top.points[e.pop()] for e in ends]
        return cls(place[pivots[0]], place[joints[0]], place[joints[1]], place[pivots[1]], place[point])  # type: ignore[arg-type]


@functools.cache
def _template() -> System:
    """One compiled four-bar, so that all of them share what is compiled for one."""
    return FourBar((0.0, 0.0), (0.3, 0.8), (2.1, 1.9), (2.5, 0.0), (1.0, 2.0)).mechanism().compile()


def wrapped(angle: Any) -> Any:
    """An angle between -π and π, radians."""
    return np.angle(np.exp(1j * np.asarray(angle)))


def turned(z: complex, angle: float) -> complex:
    """A vector turned anticlockwise by an angle, radians."""
    return z * cmath.rect(1.0, angle)
