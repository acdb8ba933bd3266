"""Linkages that draw a straight line: nearly, with a coupler point of a four-bar; exactly, by inverting a circle."""

import math

from jaxnc.library.drawing import (
    Length,
    Misfit,
    Point,
    crank_travel,
    drive,
    lay_out,
    meet,
    offer,
    place_along,
    polar,
    turn_crank,
)
from jaxnc.mechanism import Mechanism


@offer
def chebyshev(ground: Length = 0.4, rocker: Length = 0.5, coupler: Length = 0.2, angle: float = 0.0) -> Mechanism:
    """Chebyshev's linkage: crossed rockers A-B and D-C, the midpoint P of the coupler C-B on a nearly straight line.

    n = 5, rows = 4, rank 4, g = 1; P is a marker. Input ``phi``, the angle of the coupler C-B from the x axis, which
    turns right round; the straight stretch lies between -π/2 and π/2. With the default proportions 4 : 5 : 2 it is as
    long as the ground and deviates by at most 0.25 % of that. The default drive is a full turn where there is one,
    otherwise the range of the coupler.

    Args:
        ground: length A-D, A at the origin and D on the x axis.
        rocker: length A-B and D-C.
        coupler: length C-B.
        angle: coupler angle of the drawing, radians.

    Raises:
        MechanismError: for a length that is not positive, or lengths that do not close.

    Source: P. L. Chebyshev; I. I. Artobolevsky, Mechanisms in Modern Engineering Design, volume 1.
    """

    def draw(phi: float) -> tuple[Point, Point]:
        ahead = polar((ground, 0.0), coupler, phi)
        b = meet((0.0, 0.0), ahead, 1.0, **{"rocker A-B": rocker, "rocker D-C": rocker})
        return b, polar(b, -coupler, phi)

    b, c = draw(angle)
    said = "Chebyshev's linkage: the midpoint of the coupler goes nearly straight."
    m = _four_bar("chebyshev", said, (ground, 0.0), b, c, (0.5 * (b[0] + c[0]), 0.5 * (b[1] + c[1])))
    m.angle("phi", to=("C", "B"))
    return drive(m, ["P"], {"phi": crank_travel(draw, angle)})


@offer
def hoeken(
    crank: Length = 0.1,
    ground: Length = 0.2,
    coupler: Length = 0.25,
    rocker: Length = 0.25,
    extension: Length = 0.25,
    angle: float = math.pi,
) -> Mechanism:
    """Hoeken's linkage: a crank-rocker whose coupler, extended beyond C, ends in a point P on a nearly straight line.

    n = 5, rows = 4, rank 4, g = 1; P is a marker. Input ``phi``, the angle of the crank AB from the x axis. With the
    default proportions 1 : 2 : 2.5 the straight stretch lies between π/2 and 3π/2, is four cranks long and deviates by
    at most 0.25 % of that. The default drive is a full turn where there is one, otherwise the range of the crank.

    Args:
        crank: length A-B.
        ground: length A-D, A at the origin and D on the x axis.
        coupler: length B-C.
        rocker: length D-C.
        extension: length C-P, on the line B-C beyond C.
        angle: crank angle of the drawing, radians.

    Raises:
        MechanismError: for a length that is not positive, or lengths that do not close.

    Source: K. Hoecken; R. L. Norton, Design of Machinery, straight-line mechanisms.
    """
    draw = turn_crank((0.0, 0.0), crank, (ground, 0.0), 1.0, coupler=coupler, rocker=rocker)
    b, c = draw(angle)
    said = "Hoeken's linkage: half a turn of the crank moves P nearly straight and evenly."
    p = place_along(b, c, coupler + extension, 0.0)
    m = _four_bar("hoeken", said, (ground, 0.0), b, c, p, ("crank", "rocker"))
    m.angle("phi", at="A", to="B")
    return drive(m, ["P"], {"phi": crank_travel(draw, angle)})


@offer
def roberts(ground: Length = 0.4, rocker: Length = 0.3, angle: float = 0.1) -> Mechanism:
    """Roberts's linkage: the apex P of a coupler triangle B-C-P nearly follows the line of the ground pivots A-D.

    The coupler is half as long as the ground, and P is one rocker's length from B and C. n = 5, rows = 4, rank 4,
    g = 1; P is a marker. Input ``phi``, the angle of the coupler B-C from the x axis; the default drive moves P from A
    to D. P is on the line at A, in the middle and at D; with the default lengths it deviates by at most 0.3 % of A-D.

    Args:
        ground: length A-D, A at the origin and D on the x axis.
        rocker: length A-B, D-C, B-P and C-P, more than half of the ground.
        angle: coupler angle of the drawing, radians.

    Raises:
        MechanismError: for a length that is not positive, a rocker too short for P to get to A and D, or an angle at
            which the linkage does not close.

    Source: R. Roberts; I. I. Artobolevsky, Mechanisms in Modern Engineering Design, volume 1.
    """
    coupler = 0.5 * ground
    if rocker <= coupler:
        raise Misfit(f"rocker = {rocker:g} must be longer than half of ground = {ground:g}")
    behind = polar((ground, 0.0), -coupler, angle)
    b = meet((0.0, 0.0), behind, 1.0, **{"rocker A-B": rocker, "rocker D-C": rocker})
    c = polar(b, coupler, angle)
    p = place_along(b, c, 0.5 * coupler, -math.sqrt(rocker**2 - 0.25 * coupler**2))
    m = _four_bar("roberts", "Roberts's linkage: P goes nearly straight from A to D.", (ground, 0.0), b, c, p)
    m.angle("phi", to=("B", "C"))
    # P is at A when the triangle stands on A: the direction A-C plus half its apex angle is that of its axis.
    end = math.acos(coupler / rocker) + math.asin(0.5 * coupler / rocker) - 0.5 * math.pi
    return drive(m, ["P"], {"phi": (-abs(end), abs(end))})


@offer
def watt_straight_line(arm1: Length = 0.5, arm2: Length = 0.5, coupler: Length = 0.4, angle: float = 0.0) -> Mechanism:
    """Watt's linkage: a point P of the coupler between two opposite arms nearly follows a straight line.

    Drawn in its middle position with level arms A-B and D-C, the coupler B-C upright and P at the origin, the coupler
    divided in the inverse ratio of the arms. n = 5, rows = 4, rank 4, g = 1; P is a marker. Input ``phi``, the angle of
    the arm AB from the x axis. With the default lengths and φ between -0.3 and 0.3 the path is 0.3 m long and deviates
    by at most 0.14 % of that. The default drive covers the whole range of the arm.

    Args:
        arm1: length A-B, A to the left.
        arm2: length D-C, D to the right.
        coupler: length B-C.
        angle: angle phi of the drawing, radians; zero is the middle position.

    Raises:
        MechanismError: for a length that is not positive, or an angle that the arm cannot reach.

    Source: J. Watt, patent of 1784; I. I. Artobolevsky, Mechanisms in Modern Engineering Design, volume 1.
    """
    share = arm2 / (arm1 + arm2)
    a, d = (-arm1, share * coupler), (arm2, (share - 1.0) * coupler)
    draw = turn_crank(a, arm1, d, -1.0, coupler=coupler, arm2=arm2)
    b, c = draw(angle)
    said = "Watt's linkage: P goes nearly straight between two opposite arms."
    m = _four_bar("watt straight line", said, d, b, c, place_along(b, c, share * coupler, 0.0), ("arm1", "arm2"), a)
    m.angle("phi", at="A", to="B")
    return drive(m, ["P"], {"phi": crank_travel(draw, angle)})


def _four_bar(
    name: str,
    said: str,
    d: Point,
    b: Point,
    c: Point,
    p: Point,
    levers: tuple[str, str] = ("rocker1", "rocker2"),
    a: Point = (0.0, 0.0),
) -> Mechanism:
    """Lay out the linkage A-B-C-D with the marker P on its coupler."""
    bodies = {levers[0]: "A B", "coupler": "B C", levers[1]: "D C"}
    m = lay_out(name, said, {"A": a, "D": d}, {"B": b, "C": c}, bodies)
    m.marker("P", on="coupler", at=p)
    return m


@offer
def peaucellier_lipkin(arm: Length = 0.5, side: Length = 0.2, crank: Length = 0.2, angle: float = 0.4) -> Mechanism:
    """Peaucellier-Lipkin linkage: P follows the line x = (arm² - side²) / (2 crank), exactly.

    Arms O-A and O-C, rhombus A-B-C-P, crank G-B whose circle goes through O. n = 9, rows = 8, rank 8, g = 1. Input
    ``phi``, the angle of the crank from the x axis; the default drive covers its range, within which B stays on its own
    side of the line A-C.

    Args:
        arm: length O-A and O-C, O the origin.
        side: length of the rhombus's sides, shorter than the arm.
        crank: length G-B and O-G, G on the x axis.
        angle: crank angle of the drawing, radians.

    Raises:
        MechanismError: for a length that is not positive, a side not shorter than the arm, or an angle at which the
            rhombus does not close.

    Source: C. N. Peaucellier (1864), L. Lipkin; I. I. Artobolevsky, Mechanisms in Modern Engineering Design,
    volume 1.
    """
    if side >= arm:
        raise Misfit(f"side = {side:g} must be shorter than arm = {arm:g}")
    o, g = (0.0, 0.0), (crank, 0.0)
    power = arm**2 - side**2
    outside = math.hypot(*polar(g, crank, angle)) ** 2 > power

    def draw(phi: float) -> dict[str, Point]:
        b = polar(g, crank, phi)
        if (math.hypot(*b) ** 2 > power) is not outside:
            raise Misfit(f"the rhombus is flat between the drawing and phi = {phi:g}")
        a, c = (meet(o, b, turn, arm=arm, side=side) for turn in (1.0, -1.0))
        return {"A": a, "B": b, "C": c, "P": (a[0] + c[0] - b[0], a[1] + c[1] - b[1])}

    bodies = {"crank": "G B", "arm1": "O A", "arm2": "O C"}
    bodies |= {"side1": "A B", "side2": "B C", "side3": "C P", "side4": "P A"}
    said = "Peaucellier's inversor: P draws an exact straight line."
    m = lay_out("peaucellier-lipkin", said, {"O": o, "G": g}, draw(angle), bodies)
    m.angle("phi", at="G", to="B")
    return drive(m, ["P"], {"phi": crank_travel(draw, angle)})


@offer
def hart(
    long: Length = 0.6, short: Length = 0.25, fraction: float = 0.5, crank: Length = 0.2, angle: float = 0.4
) -> Mechanism:
    """Hart's inversor: Q follows the line x = -f (1 - f) (long² - short²) / (2 crank), exactly.

    Crossed bars A-B and C-D, short bars B-C and D-A; O on AB, P on AD and Q on CB divide their bars in the same
    fraction f. O is on the ground, and the crank G-P moves P on a circle through O. n = 13, rows = 12, rank 12, g = 1.
    Input ``phi``, the angle of the crank from the x axis; the default drive covers its range.

    Args:
        long: length A-B and C-D.
        short: length B-C and D-A, shorter than the long bars.
        fraction: A-O by A-B, A-P by A-D and C-Q by C-B, between 0 and 1.
        crank: length G-P and O-G, O the origin and G on the x axis.
        angle: crank angle of the drawing, radians.

    Raises:
        MechanismError: for a length that is not positive, bars or a fraction out of order, or an angle at which the
            crossed parallelogram does not close.

    Source: H. Hart (1874); I. I. Artobolevsky, Mechanisms in Modern Engineering Design, volume 1.
    """
    if short >= long:
        raise Misfit(f"short = {short:g} must be shorter than long = {long:g}")
    if not 0 < fraction < 1:
        raise Misfit(f"fraction = {fraction:g} must lie between 0 and 1")

    def draw(phi: float) -> dict[str, Point]:
        p = polar((crank, 0.0), crank, phi)
        reach = math.hypot(*p)
        wide = reach / fraction  # B-D, the longer or shorter parallel side of the trapezium B-D-A-C
        narrow = (long**2 - short**2) / wide if wide else math.inf
        square = short**2 - 0.25 * (wide - narrow) ** 2
        if square <= 1e-12 * short**2:
            low, high = fraction * (long - short), fraction * (long + short)
            raise Misfit(
                f"crank = {crank:g} puts P {reach:g} away from O; with long = {long:g} and short = {short:g} "
                f"that must lie between {low:g} and {high:g}; change one of them, or start from another angle"
            )
        x, y = p[0] / reach, p[1] / reach
        height = math.sqrt(square)

        def at(along: float, across: float) -> Point:
            return along * x - across * y, along * y + across * x

        # In a frame along O-P whose origin is O: A at height (1 - f) h … B at -f h, so that O divides A-B.
        middle = fraction * 0.5 * wide - (1.0 - fraction) * 0.5 * narrow
        a, b = at(middle + 0.5 * narrow, fraction * height), at(middle - 0.5 * wide, (fraction - 1.0) * height)
        c, d = at(middle - 0.5 * narrow, fraction * height), at(middle + 0.5 * wide, (fraction - 1.0) * height)
        q = (c[0] + fraction * (b[0] - c[0]), c[1] + fraction * (b[1] - c[1]))
        return {"A": a, "B": b, "C": c, "D": d, "P": p, "Q": q}

    m = lay_out(
        "hart",
        "Hart's inversor: Q draws an exact straight line, with only four bars and a crank.",
        {"O": (0.0, 0.0), "G": (crank, 0.0)},
        draw(angle),
        {"crank": "G P", "long1": "A B O", "long2": "C D", "short1": "A D P", "short2": "C B Q"},
    )
    m.angle("phi", at="G", to="P")
    return drive(m, ["Q"], {"phi": crank_travel(draw, angle)})
