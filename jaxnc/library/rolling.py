"""Mechanisms with a disc that rolls without slip, on the ground and on a moving bar."""

import math

from jaxnc.calls import public
from jaxnc.errors import MechanismError
from jaxnc.library.drawing import TURN, carried, drive, number, place, polar, positive
from jaxnc.mechanism import Mechanism


@public
def rolling_disc(radius: float = 0.1, length: float = 2.0, distance: float = 0.2, angle: float = 0.5) -> Mechanism:
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
    what = "rolling_disc"
    radius, length, distance = positive(what, radius=radius, length=length, distance=distance)
    (angle,) = number(what, angle=angle)
    if 2.0 * distance >= length:
        raise MechanismError(f"{what}: distance = {distance:g} must be below half of length = {length:g}")
    centre = (distance, radius)
    m = Mechanism("rolling disc", description="A disc rolls along a line without slip.")
    m.ground("A", (0.0, 0.0))
    m.ground("B", (length, 0.0))
    m.point("P1", centre)
    m.point("P2", polar(centre, radius, angle - 0.5 * math.pi))
    m.point("P3", (distance, 0.0))
    m.body("disc", ["P1", "P2"])
    m.rolling("rolling", centre="P1", rim="P2", contact="P3", line=("A", "B"), angle="phi", distance="s")
    return drive(m, ["s", "P2"], {"phi": (angle, angle - (length - 2.0 * distance) / radius)})


@public
def generic_mechanism(
    crank: float = 0.1,
    bar: float = 0.6,
    radius: float = 0.05,
    disc_height: float = 0.05,
    pivot: tuple[float, float] = (0.10, 0.10),
    shoe: tuple[float, float] = (0.05, 0.20),
    contact: float = 0.4,
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
    what = "generic_mechanism"
    crank, bar, radius, contact = positive(what, crank=crank, bar=bar, radius=radius, contact=contact)
    height, angle, rim_angle = number(what, disc_height=disc_height, angle=angle, rim_angle=rim_angle)
    to_pivot, to_shoe = place(what, "pivot", pivot), place(what, "shoe", shoe)
    if to_pivot == to_shoe or (0.0, 0.0) in (to_pivot, to_shoe):
        raise MechanismError(f"{what}: pivot = {to_pivot}, shoe = {to_shoe} and the disc's centre must be three points")
    if contact >= bar:
        raise MechanismError(f"{what}: contact = {contact:g} is beyond the end of bar = {bar:g}")
    p1 = polar((0.0, 0.0), crank, angle)
    reach = math.hypot(contact, radius)
    rise = height - p1[1]
    if abs(rise) >= reach:
        raise MechanismError(
            f"{what}: disc_height = {height:g} is out of reach of the bar: it is {abs(rise):g} from the crank pin in "
            f"height, and contact = {contact:g} with radius = {radius:g} allow {reach:g}"
        )
    slope = math.asin(rise / reach) - math.atan2(radius, contact)
    p2, p6 = polar(p1, bar, slope), polar(p1, contact, slope)
    p5 = carried(p6, p2, 0.0, radius)
    p3 = (p5[0] + to_pivot[0], p5[1] + to_pivot[1])
    p4 = (p5[0] + to_shoe[0], p5[1] + to_shoe[1])
    if math.dist(p2, p3) == 0:
        raise MechanismError(f"{what}: pivot = {to_pivot} puts P3 on P2, so the link has no length; move it")
    m = Mechanism(
        "generic mechanism", description="A slider, a disc rolling on a moving bar, and a body of three points."
    )
    m.ground("A", (0.0, 0.0))
    m.ground("B", (p4[0] - 2.0 * crank, p4[1]))
    m.ground("C", (p4[0] + 2.0 * crank, p4[1]))
    for name, at in zip(("P1", "P2", "P3", "P4", "P5", "P6"), (p1, p2, p3, p4, p5, p6), strict=True):
        m.point(name, at)
    m.point("P7", polar(p5, radius, slope - 0.5 * math.pi + rim_angle))
    m.body("crank", ["A", "P1"])
    m.body("bar", ["P1", "P2"])
    m.body("link", ["P2", "P3"])
    m.body("slider", ["P3", "P4", "P5"])
    m.body("disc", ["P5", "P7"])
    m.prismatic("guide", line=("B", "C"), on=("P4", "P3"))
    m.rolling("rolling", centre="P5", rim="P7", contact="P6", line=("P1", "P2"), angle="phi", distance="s")
    if crank_angle:
        m.angle("theta", at="A", to="P1")
        return drive(m, ["s", "P4.x"], {"theta": (0.0, TURN)})
    return drive(m, ["s", "P4.x"], {"P1.y": (-0.95 * crank, 0.95 * crank)})
