"""Four-bars whose coupler point P nearly follows a straight line: Chebyshev's, Hoeken's, Roberts's, Watt's."""

import math

from jaxnc.calls import public
from jaxnc.errors import MechanismError
from jaxnc.library.drawing import Point, carried, drive, meet, number, polar, positive, travel
from jaxnc.mechanism import Mechanism


@public
def chebyshev(ground: float = 0.4, rocker: float = 0.5, coupler: float = 0.2, angle: float = 0.0) -> Mechanism:
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
    what = "chebyshev"
    ground, rocker, coupler = positive(what, ground=ground, rocker=rocker, coupler=coupler)
    (angle,) = number(what, angle=angle)

    def draw(phi: float) -> tuple[Point, Point]:
        ahead = polar((ground, 0.0), coupler, phi)
        b = meet(what, (0.0, 0.0), ahead, 1.0, **{"rocker A-B": rocker, "rocker D-C": rocker})
        return b, polar(b, -coupler, phi)

    b, c = draw(angle)
    m = Mechanism("chebyshev", description="Chebyshev's linkage: the midpoint of the coupler goes nearly straight.")
    _four_bar(m, (ground, 0.0), b, c, "rocker1", "rocker2", (0.5 * (b[0] + c[0]), 0.5 * (b[1] + c[1])))
    m.angle("phi", to=("C", "B"))
    return drive(m, ["P"], {"phi": travel(draw, angle)})


@public
def hoeken(
    crank: float = 0.1,
    ground: float = 0.2,
    coupler: float = 0.25,
    rocker: float = 0.25,
    extension: float = 0.25,
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
    what = "hoeken"
    crank, ground, coupler, rocker, extension = positive(
        what, crank=crank, ground=ground, coupler=coupler, rocker=rocker, extension=extension
    )
    (angle,) = number(what, angle=angle)

    def draw(phi: float) -> tuple[Point, Point]:
        b = polar((0.0, 0.0), crank, phi)
        return b, meet(what, b, (ground, 0.0), 1.0, coupler=coupler, rocker=rocker)

    b, c = draw(angle)
    m = Mechanism(
        "hoeken", description="Hoeken's linkage: half a turn of the crank moves P nearly straight and evenly."
    )
    _four_bar(m, (ground, 0.0), b, c, "crank", "rocker", carried(b, c, coupler + extension, 0.0))
    m.angle("phi", at="A", to="B")
    return drive(m, ["P"], {"phi": travel(draw, angle)})


@public
def roberts(ground: float = 0.4, rocker: float = 0.3, angle: float = 0.1) -> Mechanism:
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
    what = "roberts"
    ground, rocker = positive(what, ground=ground, rocker=rocker)
    (angle,) = number(what, angle=angle)
    coupler = 0.5 * ground
    if rocker <= coupler:
        raise MechanismError(f"{what}: rocker = {rocker:g} must be longer than half of ground = {ground:g}")
    behind = polar((ground, 0.0), -coupler, angle)
    b = meet(what, (0.0, 0.0), behind, 1.0, **{"rocker A-B": rocker, "rocker D-C": rocker})
    c = polar(b, coupler, angle)
    depth = math.sqrt(rocker**2 - 0.25 * coupler**2)
    m = Mechanism("roberts", description="Roberts's linkage: P goes nearly straight from A to D.")
    _four_bar(m, (ground, 0.0), b, c, "rocker1", "rocker2", carried(b, c, 0.5 * coupler, -depth))
    m.angle("phi", to=("B", "C"))
    # P is at A when the triangle stands on A: the direction A-C plus half its apex angle is that of its axis.
    end = math.acos(coupler / rocker) + math.asin(0.5 * coupler / rocker) - 0.5 * math.pi
    return drive(m, ["P"], {"phi": (-abs(end), abs(end))})


@public
def watt_straight_line(arm1: float = 0.5, arm2: float = 0.5, coupler: float = 0.4, angle: float = 0.0) -> Mechanism:
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
    what = "watt_straight_line"
    arm1, arm2, coupler = positive(what, arm1=arm1, arm2=arm2, coupler=coupler)
    (angle,) = number(what, angle=angle)
    share = arm2 / (arm1 + arm2)
    a, d = (-arm1, share * coupler), (arm2, (share - 1.0) * coupler)

    def draw(phi: float) -> tuple[Point, Point]:
        b = polar(a, arm1, phi)
        return b, meet(what, b, d, -1.0, coupler=coupler, arm2=arm2)

    b, c = draw(angle)
    m = Mechanism("watt straight line", description="Watt's linkage: P goes nearly straight between two opposite arms.")
    _four_bar(m, d, b, c, "arm1", "arm2", carried(b, c, share * coupler, 0.0), a)
    m.angle("phi", at="A", to="B")
    return drive(m, ["P"], {"phi": travel(draw, angle)})


def _four_bar(
    m: Mechanism, d: Point, b: Point, c: Point, first: str, second: str, p: Point, a: Point = (0.0, 0.0)
) -> None:
    """Build the linkage A-B-C-D with the marker P on its coupler."""
    m.ground("A", a)
    m.ground("D", d)
    m.point("B", b)
    m.point("C", c)
    m.body(first, ["A", "B"])
    m.body("coupler", ["B", "C"])
    m.body(second, ["D", "C"])
    m.marker("P", on="coupler", at=p)
