"""Shafts: Cardan joints, single and in series, bevel gears, and the steering column of the source text."""

import math
from collections.abc import Mapping

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import MechanismError
from jaxnc.library.drawing import TURN, drive, number, positive
from jaxnc.library.space import Vector, X, Y, Z, across, apart, hardpoints, skew, turned, unit
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism.model import Place

_CARDAN = {  # a gearbox, a propeller shaft that runs down and aside, and an axle
    "A": (0.0, 0.0, 0.0),
    "B": (-0.20, 0.0, 0.0),
    "C": (-1.40, 0.08, -0.15),
    "D": (-1.60, 0.08, -0.18),
    "v1": (0.0, 0.0, 1.0),
}
_STEERING = {  # ISO 8855 axes, origin under the front axle: left-hand drive, rack behind and above the axle
    "A": (-1.05, 0.37, 0.95),
    "B": (-0.52, 0.37, 0.64),
    "C": (-0.28, 0.30, 0.37),
    "D": (-0.13, 0.30, 0.27),
    "E": (-0.1339, -0.60, 0.2642),
    "1": (-0.1339, -0.36, 0.2642),
    "2": (-0.1339, 0.36, 0.2642),
    "v1": (0.0, 1.0, 0.0),
}


@public
def cardan_joint(shaft_angle: float = math.pi / 6, inlet: float = 0.2, outlet: float = 0.2) -> Mechanism:
    """Two shafts that meet at an angle, joined by one Cardan (universal) joint.

    Inlet A-B along the x axis with the pin v1 of its fork, outlet B-C in the plane xz with the pin v2, cross at B.
    n = 8, rows = 7, rank 7, g = 1. Coordinates ``phi``, the rotation of the inlet about A-B from the drawing, where
    its pin lies in the plane of the shafts, and ``psi``, that of the outlet about B-C: ``tan ψ = tan φ / cos β``.
    Input ``phi``; the default drive is two turns.

    Args:
        shaft_angle: angle β of the shafts, radians, below π/2.
        inlet: length A-B.
        outlet: length B-C.

    Raises:
        MechanismError: for a length that is not positive, a shaft angle that is not between -π/2 and π/2.

    Source: source text, fig. 38, (142); H. C. Seherr-Thoss, F. Schmelz and E. Aucktor, Universal Joints and
    Driveshafts, on the ratio of Cardan's joint.
    """
    what = "cardan_joint"
    inlet, outlet = positive(what, inlet=inlet, outlet=outlet)
    (beta,) = number(what, shaft_angle=shaft_angle)
    if math.cos(beta) <= 1e-6:
        raise MechanismError(f"{what}: shaft_angle = {beta:g}; a Cardan joint turns below π/2 only")
    m = Mechanism("Cardan joint", dim=3, description="Two shafts at an angle, joined by a cross in two forks.")
    m.ground("A", (-inlet, 0.0, 0.0))
    m.ground("B", (0.0, 0.0, 0.0))
    m.ground("C", outlet * np.array((math.cos(beta), 0.0, math.sin(beta))))
    m.vector("v1", -Z)
    m.vector("v2", Y)
    m.body("inlet", ["A", "B"], vectors=["v1"])
    m.body("outlet", ["B", "C"], vectors=["v2"])
    m.universal("cross", ("v1", "v2"))
    m.angle("phi", to="v1", about=("A", "B"))
    m.angle("psi", to="v2", about=("B", "C"))
    return drive(m, ["psi"], {"phi": (0.0, 2.0 * TURN)})


def _pins(what: str, p: Mapping[str, Vector], phase: float) -> dict[str, Vector]:
    """Pins of the forks of three shafts A-B, B-C, C-D in the drawing, unit vectors."""
    apart(what, p, ("A", "B"), ("B", "C"), ("C", "D"))
    first, middle, last = (unit(p[end] - p[start]) for start, end in ("AB", "BC", "CD"))
    for names, a, b in (("A-B and B-C", first, middle), ("B-C and C-D", middle, last)):
        if a @ b <= 1e-6:
            raise MechanismError(f"{what}: shafts {names} bend by 90° or more; a Cardan joint turns below that only")
    skew(what, "v1", p["v1"], "the shaft A-B", first)
    v1 = across(p["v1"], first)
    if np.linalg.norm(np.cross(middle, v1)) < 1e-6:
        raise MechanismError(f"{what}: v1 points along the shaft B-C; turn it about A-B")
    v2 = unit(np.cross(middle, v1))
    v3 = turned(v2, middle, phase)
    return {"v1": v1, "v2": v2, "v3": v3, "v4": unit(np.cross(last, v3))}


def _shafts(m: Mechanism, p: Mapping[str, Vector], pins: Mapping[str, Vector], names: tuple[str, str, str]) -> None:
    """Three shafts on the ground and the two crosses between them, (186)-(196)."""
    for name in "ABCD":
        m.ground(name, p[name])
    for name, pin in pins.items():
        m.vector(name, pin)
    first, middle, last = names
    m.body(first, ["A", "B"], vectors=["v1"])
    m.body(middle, ["B", "C"], vectors=["v2", "v3"])
    m.body(last, ["C", "D"], vectors=["v4"])
    m.universal("cross1", ("v1", "v2"))
    m.universal("cross2", ("v3", "v4"))


@public
def cardan_shafts(places: Mapping[str, Place] | None = None, phase: float = math.pi / 2) -> Mechanism:
    """Three shafts joined by two Cardan joints in series, at any angles and out of one plane.

    Inlet A-B with the pin v1 of its fork, middle shaft B-C with the pins v2 and v3, outlet C-D with the pin v4.
    n = 15, rows = 14, rank 14, g = 1. Coordinates ``phi``, ``chi`` and ``psi``, the rotations of the inlet about A-B,
    of the middle shaft about B-C and of the outlet about C-D from the drawing. Input ``phi``; the default drive is two
    turns.

    Args:
        places: hardpoints other than the default ones: points A, B, C and D (lengths), and v1, the drawn pin of the
            first fork, which is made perpendicular to A-B.
        phase: angle from v2 to v3 about B-C, radians. With all shafts in one plane and two equal angles, 0 gives a
            constant velocity.

    Raises:
        MechanismError: for an unknown name, a place that is not three numbers, two points at the same place, shafts
            that bend by 90° or more.

    Source: source text, fig. 43, (186)-(196), without the rack.
    """
    what = "cardan_shafts"
    p = hardpoints(what, _CARDAN, places)
    (phase,) = number(what, phase=phase)
    m = Mechanism("Cardan shafts", dim=3, description="Three shafts joined by two Cardan joints.")
    _shafts(m, p, _pins(what, p, phase), ("inlet", "middle", "outlet"))
    m.angle("phi", to="v1", about=("A", "B"))
    m.angle("chi", to="v2", about=("B", "C"))
    m.angle("psi", to="v4", about=("C", "D"))
    return drive(m, ["chi", "psi"], {"phi": (0.0, 2.0 * TURN)})


@public
def steering_column(
    places: Mapping[str, Place] | None = None, pinion_radius: float = 0.007, phase: float = math.pi / 2
) -> Mechanism:
    """Steering of the source text: handwheel, two Cardan joints in series, pinion and rack.

    Column A-B, intermediate shaft B-C, pinion shaft C-D, and the rack 1-2 along y, whose points have their x and z
    fixed. n = 17, rows = 16, rank 16, g = 1 as in (186)-(201): vectors v1 to v4, coordinates ``phi``, the angle of the
    handwheel about A-B from vA, the drawn direction of v1; ``psi``, the angle of v4 about C-D from the y axis; ``s``,
    the distance E-1 along y. The angles are signed and valid at every value, where (197) and (201), cosines, are not.
    Input ``phi``; the default drive is three turns of the handwheel, from lock to lock.

    Args:
        places: hardpoints other than the default ones: points A, B, C, D, E, 1 and 2 (lengths; C-D perpendicular to
            y), and v1, the drawn pin of the first fork, which is made perpendicular to A-B.
        pinion_radius: pitch radius of the pinion, a length; the rack is on the side where it is drawn.
        phase: angle from v2 to v3 about B-C, radians; (193) has π/2.

    Raises:
        MechanismError: for an unknown name, a place that is not three numbers, two points at the same place, shafts
            that bend by 90° or more, a radius that is not positive.

    Source: source text, fig. 43, (186)-(201), with its names; errata 7 and 8 on (197)-(201). In car coordinates
    (ISO 8855: x forward, y left, z up).
    """
    what = "steering_column"
    p = hardpoints(what, _STEERING, places)
    (radius,) = positive(what, pinion_radius=pinion_radius)
    (phase,) = number(what, phase=phase)
    apart(what, p, ("1", "2"))
    pins = _pins(what, p, phase)
    m = Mechanism("steering column", dim=3, description="Handwheel, two Cardan joints, pinion and rack of a car.")
    _shafts(m, p, pins, ("column", "intermediate", "pinion"))
    m.ground("E", p["E"])
    m.ground_vector("vA", pins["v1"])
    m.ground_vector("vy", Y)
    m.point("1", p["1"], fixed="xz")
    m.point("2", p["2"], fixed="xz")
    m.body("rack", ["1", "2"])
    m.angle("phi", to="v1", start="vA", about=("A", "B"))
    m.angle("psi", at="D", to="v4", start="vy", about=("C", "D"))
    m.distance("s", "E", "1", along="vy")
    m.rack_and_pinion("mesh", "psi", "s", radius=radius)
    return drive(m, ["s", "psi"], {"phi": (-1.5 * TURN, 1.5 * TURN)})


@public
def bevel_gears(radius1: float = 0.03, radius2: float = 0.06, shaft_angle: float = math.pi / 2) -> Mechanism:
    """Bevel gear pair at any shaft angle, with the axes meeting at the origin.

    Wheel 1 with centre A on the axis vA along x, wheel 2 with centre B on the axis vB in the plane xy, both axes away
    from the origin; points 1 and 2 of the pitch circles are drawn where these touch. n = 8, rows = 7, rank 7, g = 1 as
    in (151)-(157). Coordinates ``phi``, the angle of point 1 about vA from the direction of vB, and ``psi``, that of
    point 2 about vB from the direction of vA, both signed: ``R1 φ + R2 ψ = 0``. Input ``phi``; the default drive is
    two turns of the first wheel.

    Args:
        radius1: pitch radius of the first wheel, a length.
        radius2: pitch radius of the second wheel, a length.
        shaft_angle: angle σ of the axes, radians, between 0 and π.

    Raises:
        MechanismError: for a radius that is not positive, or a shaft angle at which one wheel would have its teeth
            inside or on a plane.

    Source: source text, fig. 41, (151)-(157), with its names; errata 3 (shaft angle) and 7 (signs).
    """
    what = "bevel_gears"
    radius1, radius2 = positive(what, radius1=radius1, radius2=radius2)
    (sigma,) = number(what, shaft_angle=shaft_angle)
    sine, cosine = math.sin(sigma), math.cos(sigma)
    first = math.atan2(radius1 * sine, radius2 + radius1 * cosine)  # half angles of the pitch cones
    second = sigma - first
    if not (0.0 < sigma < math.pi and 0.0 < first < 0.5 * math.pi and 0.0 < second < 0.5 * math.pi):
        limit = math.acos(-min(radius1, radius2) / max(radius1, radius2))
        raise MechanismError(
            f"{what}: shaft_angle = {sigma:g} with radius1 = {radius1:g} and radius2 = {radius2:g} has no pair of "
            f"outer pitch cones; it must be above 0 and below {limit:g}"
        )
    cone = radius1 / math.sin(first)  # from the apex to the point of contact
    v_b = cosine * X + sine * Y
    contact = cone * (math.cos(first) * X + math.sin(first) * Y)
    m = Mechanism("bevel gears", dim=3, description="Two conical wheels in mesh on axes that meet at an angle.")
    m.ground("A", cone * math.cos(first) * X)
    m.ground("B", cone * math.cos(second) * v_b)
    m.ground_vector("vA", X)
    m.ground_vector("vB", v_b)
    m.point("1", contact)
    m.point("2", contact)
    m.body("wheel1", ["A", "1"], vectors=["vA"])
    m.body("wheel2", ["B", "2"], vectors=["vB"])
    m.angle("phi", at="A", to="1", start="vB", about="vA")
    m.angle("psi", at="B", to="2", start="vA", about="vB")
    m.bevel_gear("mesh", "phi", "psi")
    return drive(m, ["psi"], {"phi": (0.0, 2.0 * TURN)})
