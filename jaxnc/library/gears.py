"""Gears, rolling discs and shafts: gear pairs, discs that roll on a line, Cardan joints, the steering of a car."""

import math
from collections.abc import Mapping

import numpy as np

from jaxnc.library.drawing import (
    TURN,
    Length,
    Misfit,
    Vector,
    X,
    Y,
    Z,
    across_axis,
    check_apart,
    check_skew,
    drive,
    hardpoints,
    lay_out,
    offer,
    place_along,
    polar,
    rotate,
    unit_vector,
)
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


@offer
def gear_pair(radius1: Length = 0.1, radius2: Length = 0.2, internal: bool = False, angle: float = 0.5) -> Mechanism:
    """Two gear wheels in mesh, with centres A at the origin and B on the x axis.

    n = 6, rows = 5, rank 5, g = 1 as in (43)-(47). Coordinates ``phi``, the angle of the first wheel's mark P1 from the
    direction A-B, and ``psi``, that of the second wheel's mark P2 from the direction B-A; both anticlockwise, so that
    ``R1 φ + R2 ψ = 0`` for wheels outside each other and ``R1 φ - R2 ψ = 0`` for one inside the other. Input ``phi``;
    the default drive is two turns of the first wheel.

    Args:
        radius1: pitch radius of the first wheel, a length.
        radius2: pitch radius of the second wheel, a length.
        internal: mesh inside the larger wheel.
        angle: angle phi of the drawing, radians.

    Raises:
        MechanismError: for a radius that is not positive, or equal radii of an internal pair.

    Source: source text, fig. 19, (43)-(47); signs after erratum 7 of its catalogue (signed angles).
    """
    if internal and radius1 == radius2:
        raise Misfit(f"radius1 and radius2 are both {radius1:g}; an internal pair needs different radii")
    distance = abs(radius2 - radius1) if internal else radius1 + radius2
    other = (1.0 if internal else -1.0) * angle * radius1 / radius2
    m = lay_out(
        "gear pair",
        "Two wheels in mesh: the angles they turn by are inverse to their radii.",
        {"A": (0.0, 0.0), "B": (distance, 0.0)},
        {"P1": polar((0.0, 0.0), radius1, angle), "P2": polar((distance, 0.0), -radius2, other)},
        {"wheel1": "A P1", "wheel2": "B P2"},
    )
    m.angle("phi", at="A", to="P1", start="B")
    m.angle("psi", at="B", to="P2", start="A")
    m.gear("mesh", "phi", "psi", internal=internal)
    return drive(m, ["psi"], {"phi": (0.0, 2.0 * TURN)})


@offer
def bevel_gears(radius1: Length = 0.03, radius2: Length = 0.06, shaft_angle: float = math.pi / 2) -> Mechanism:
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
    sine, cosine = math.sin(shaft_angle), math.cos(shaft_angle)
    first = math.atan2(radius1 * sine, radius2 + radius1 * cosine)  # half angles of the pitch cones
    second = shaft_angle - first
    if not (0.0 < shaft_angle < math.pi and 0.0 < first < 0.5 * math.pi and 0.0 < second < 0.5 * math.pi):
        limit = math.acos(-min(radius1, radius2) / max(radius1, radius2))
        raise Misfit(
            f"shaft_angle = {shaft_angle:g} with radius1 = {radius1:g} and radius2 = {radius2:g} has no pair of "
            f"outer pitch cones; it must be above 0 and below {limit:g}"
        )
    cone = radius1 / math.sin(first)  # from the apex to the point of contact
    v_b = cosine * X + sine * Y
    contact = cone * (math.cos(first) * X + math.sin(first) * Y)
    m = lay_out(
        "bevel gears",
        "Two conical wheels in mesh on axes that meet at an angle.",
        {"A": cone * math.cos(first) * X, "B": cone * math.cos(second) * v_b, "vA": X, "vB": v_b},
        {"1": contact, "2": contact},
        {"wheel1": "A 1 vA", "wheel2": "B 2 vB"},
    )
    m.angle("phi", at="A", to="1", start="vB", about="vA")
    m.angle("psi", at="B", to="2", start="vA", about="vB")
    m.bevel_gear("mesh", "phi", "psi")
    return drive(m, ["psi"], {"phi": (0.0, 2.0 * TURN)})


@offer
def rolling_disc(radius: Length = 0.1, length: Length = 2.0, distance: Length = 0.2, angle: float = 0.5) -> Mechanism:
    """A disc that rolls on the ground line A-B, on its upper side.

    Centre P1, a mark P2 on the rim, contact point P3. n = 8, rows = 7, rank 7, g = 1 as in (54)-(60). Coordinates
    ``phi``, the angle of the mark from the direction P1-P3, anticlockwise, and ``s``, the distance A-P3 along the line;
    on this side ``s = c - R φ``. Input ``phi`` (or ``s``); the default drive rolls from the drawing towards B, as far
    from B at last as it was from A at first.

    Args:
        radius: radius of the disc, a length.
        length: length A-B of the line, along the x axis from the origin.
        distance: distance ``s`` of the drawing, a length below half of `length`.
        angle: angle phi of the drawing, radians.

    Raises:
        MechanismError: for a length that is not positive, or a distance that leaves no way to roll.

    Source: source text, fig. 21, (54)-(60).
    """
    if 2.0 * distance >= length:
        raise Misfit(f"distance = {distance:g} must be below half of length = {length:g}")
    centre = (distance, radius)
    m = lay_out(
        "rolling disc",
        "A disc rolls along a line without slip.",
        {"A": (0.0, 0.0), "B": (length, 0.0)},
        {"P1": centre, "P2": polar(centre, radius, angle - 0.5 * math.pi), "P3": (distance, 0.0)},
        {"disc": "P1 P2"},
    )
    m.rolling("rolling", centre="P1", rim="P2", contact="P3", line=("A", "B"), angle="phi", distance="s")
    return drive(m, ["s", "P2"], {"phi": (angle, angle - (length - 2.0 * distance) / radius)})


@offer
def generic_mechanism(
    crank: Length = 0.1,
    bar: Length = 0.6,
    radius: Length = 0.05,
    disc_height: float = 0.05,
    pivot: tuple[float, float] = (0.10, 0.10),
    shoe: tuple[float, float] = (0.05, 0.20),
    contact: Length = 0.4,
    angle: float = 0.0,
    rim_angle: float = 0.5,
    crank_angle: bool = False,
) -> Mechanism:
    """The generic mechanism of the source text: a slider of three points, and a disc that rolls on a moving bar.

    Crank A-P1, bar P1-P2, link P2-P3, slider P3-P4-P5 whose point P4 follows the guide B-C without turning, disc with
    centre P5 and mark P7 that rolls on the bar at P6. n = 16, rows = 15, rank 15, g = 1 as in (61)-(75), with the
    coordinates ``phi``, the angle of the disc's mark from the direction P5-P6, and ``s``, the distance P1-P6. The text
    has no crank angle: the default drive moves ``P1.y``, the height of the crank pin, on the right half of the crank
    circle. With `crank_angle` the coordinate ``theta`` is added, the angle of the crank from the x axis: n = 17, rows
    = 16, rank 16, g = 1, and the drive is a full turn of the crank, in which the contact point goes out and back along
    the bar (with the default dimensions the crank turns right round).

    Args:
        crank: length A-P1, A the origin.
        bar: length P1-P2.
        radius: radius of the disc, a length; the disc is above the bar.
        disc_height: height of the disc's centre P5 above A, a length, any sign.
        pivot: place (x, y) of P3 relative to P5, lengths.
        shoe: place (x, y) of P4 relative to P5, lengths.
        contact: distance ``s`` of the drawing, a length shorter than the bar.
        angle: crank angle of the drawing, radians, between -π/2 and π/2 for the default drive.
        rim_angle: angle phi of the drawing, radians.
        crank_angle: add the crank angle as a coordinate.

    Returns:
        The mechanism. The link P2-P3 is read off the drawing.

    Raises:
        MechanismError: for a length that is not positive, points of the slider that coincide, or a disc that does not
            touch the bar.

    Source: source text, fig. 22, (61)-(75), with its names.
    """
    if pivot == shoe or (0.0, 0.0) in (pivot, shoe):
        raise Misfit(f"pivot = {pivot}, shoe = {shoe} and the disc's centre must be three points")
    if contact >= bar:
        raise Misfit(f"contact = {contact:g} is beyond the end of bar = {bar:g}")
    p1 = polar((0.0, 0.0), crank, angle)
    reach = math.hypot(contact, radius)
    rise = disc_height - p1[1]
    if abs(rise) >= reach:
        raise Misfit(
            f"disc_height = {disc_height:g} is out of reach of the bar: it is {abs(rise):g} from the crank pin in "
            f"height, and contact = {contact:g} with radius = {radius:g} allow {reach:g}"
        )
    slope = math.asin(rise / reach) - math.atan2(radius, contact)
    p2, p6 = polar(p1, bar, slope), polar(p1, contact, slope)
    p5 = place_along(p6, p2, 0.0, radius)
    p3, p4 = ((p5[0] + x, p5[1] + y) for x, y in (pivot, shoe))
    if math.dist(p2, p3) == 0:
        raise Misfit(f"pivot = {pivot} puts P3 on P2, so the link has no length; move it")
    p7 = polar(p5, radius, slope - 0.5 * math.pi + rim_angle)
    m = lay_out(
        "generic mechanism",
        "A slider, a disc rolling on a moving bar, and a body of three points.",
        {"A": (0.0, 0.0), "B": (p4[0] - 2.0 * crank, p4[1]), "C": (p4[0] + 2.0 * crank, p4[1])},
        {"P1": p1, "P2": p2, "P3": p3, "P4": p4, "P5": p5, "P6": p6, "P7": p7},
        {"crank": "A P1", "bar": "P1 P2", "link": "P2 P3", "slider": "P3 P4 P5", "disc": "P5 P7"},
    )
    m.prismatic("guide", line=("B", "C"), on=("P4", "P3"))
    m.rolling("rolling", centre="P5", rim="P7", contact="P6", line=("P1", "P2"), angle="phi", distance="s")
    if crank_angle:
        m.angle("theta", at="A", to="P1")
        return drive(m, ["s", "P4.x"], {"theta": (0.0, TURN)})
    return drive(m, ["s", "P4.x"], {"P1.y": (-0.95 * crank, 0.95 * crank)})


@offer
def cardan_joint(shaft_angle: float = math.pi / 6, inlet: Length = 0.2, outlet: Length = 0.2) -> Mechanism:
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
    if math.cos(shaft_angle) <= 1e-6:
        raise Misfit(f"shaft_angle = {shaft_angle:g}; a Cardan joint turns below π/2 only")
    c = outlet * np.array((math.cos(shaft_angle), 0.0, math.sin(shaft_angle)))
    m = lay_out(
        "Cardan joint",
        "Two shafts at an angle, joined by a cross in two forks.",
        {"A": (-inlet, 0.0, 0.0), "B": (0.0, 0.0, 0.0), "C": c},
        {"v1": -Z, "v2": Y},
        {"inlet": "A B v1", "outlet": "B C v2"},
    )
    m.universal("cross", ("v1", "v2"))
    m.angle("phi", to="v1", about=("A", "B"))
    m.angle("psi", to="v2", about=("B", "C"))
    return drive(m, ["psi"], {"phi": (0.0, 2.0 * TURN)})


@offer
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
    said = "Three shafts joined by two Cardan joints."
    m = _shafts("Cardan shafts", said, hardpoints(_CARDAN, places), phase, ("inlet", "middle", "outlet"))
    m.angle("phi", to="v1", about=("A", "B"))
    m.angle("chi", to="v2", about=("B", "C"))
    m.angle("psi", to="v4", about=("C", "D"))
    return drive(m, ["chi", "psi"], {"phi": (0.0, 2.0 * TURN)})


@offer
def steering_column(
    places: Mapping[str, Place] | None = None, pinion_radius: Length = 0.007, phase: float = math.pi / 2
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
    p = hardpoints(_STEERING, places)
    check_apart(p, ("1", "2"))
    said = "Handwheel, two Cardan joints, pinion and rack of a car."
    m = _shafts("steering column", said, p, phase, ("column", "intermediate", "pinion"))
    m.ground("E", p["E"])
    m.ground_vector("vA", across_axis(p["v1"], unit_vector(p["B"] - p["A"])))
    m.ground_vector("vy", Y)
    for name in ("1", "2"):
        m.point(name, p[name], fixed="xz")
    m.body("rack", ["1", "2"])
    m.angle("phi", to="v1", start="vA", about=("A", "B"))
    m.angle("psi", at="D", to="v4", start="vy", about=("C", "D"))
    m.distance("s", "E", "1", along="vy")
    m.rack_and_pinion("mesh", "psi", "s", radius=pinion_radius)
    return drive(m, ["s", "psi"], {"phi": (-1.5 * TURN, 1.5 * TURN)})


def _shafts(name: str, said: str, p: Mapping[str, Vector], phase: float, shafts: tuple[str, str, str]) -> Mechanism:
    """Lay out three shafts A-B, B-C, C-D on the ground and the two crosses between them, (186)-(196)."""
    check_apart(p, ("A", "B"), ("B", "C"), ("C", "D"))
    first, middle, last = (unit_vector(p[end] - p[start]) for start, end in ("AB", "BC", "CD"))
    for names, a, b in (("A-B and B-C", first, middle), ("B-C and C-D", middle, last)):
        if a @ b <= 1e-6:
            raise Misfit(f"shafts {names} bend by 90° or more; a Cardan joint turns below that only")
    check_skew("v1", p["v1"], "the shaft A-B", first)
    v1 = across_axis(p["v1"], first)
    if np.linalg.norm(np.cross(middle, v1)) < 1e-6:
        raise Misfit("v1 points along the shaft B-C; turn it about A-B")
    v2 = unit_vector(np.cross(middle, v1))
    v3 = rotate(v2, middle, phase)
    pins = {"v1": v1, "v2": v2, "v3": v3, "v4": unit_vector(np.cross(last, v3))}
    bodies = dict(zip(shafts, ("A B v1", "B C v2 v3", "C D v4"), strict=True))
    m = lay_out(name, said, {n: p[n] for n in "ABCD"}, pins, bodies)
    m.universal("cross1", ("v1", "v2"))
    m.universal("cross2", ("v3", "v4"))
    return m
