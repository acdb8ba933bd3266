"""Linkages that draw an exact straight line by inverting a circle: Peaucellier's and Hart's."""

import math

from jaxnc.calls import public
from jaxnc.errors import MechanismError
from jaxnc.library.drawing import Point, drive, meet, number, polar, positive, travel
from jaxnc.mechanism import Mechanism


@public
def peaucellier_lipkin(arm: float = 0.5, side: float = 0.2, crank: float = 0.2, angle: float = 0.4) -> Mechanism:
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
    what = "peaucellier_lipkin"
    arm, side, crank = positive(what, arm=arm, side=side, crank=crank)
    (angle,) = number(what, angle=angle)
    if side >= arm:
        raise MechanismError(f"{what}: side = {side:g} must be shorter than arm = {arm:g}")
    o, g = (0.0, 0.0), (crank, 0.0)
    power = arm**2 - side**2
    outside = math.hypot(*polar(g, crank, angle)) ** 2 > power

    def draw(phi: float) -> tuple[Point, Point, Point, Point]:
        b = polar(g, crank, phi)
        if (math.hypot(*b) ** 2 > power) is not outside:
            raise MechanismError(f"{what}: the rhombus is flat between the drawing and phi = {phi:g}")
        a = meet(what, o, b, 1.0, arm=arm, side=side)
        c = meet(what, o, b, -1.0, arm=arm, side=side)
        return a, b, c, (a[0] + c[0] - b[0], a[1] + c[1] - b[1])

    m = Mechanism("peaucellier-lipkin", description="Peaucellier's inversor: P draws an exact straight line.")
    m.ground("O", o)
    m.ground("G", g)
    for name, at in zip("ABCP", draw(angle), strict=True):
        m.point(name, at)
    m.body("crank", ["G", "B"])
    m.body("arm1", ["O", "A"])
    m.body("arm2", ["O", "C"])
    for k, pair in enumerate((["A", "B"], ["B", "C"], ["C", "P"], ["P", "A"])):
        m.body(f"side{k + 1}", pair)
    m.angle("phi", at="G", to="B")
    return drive(m, ["P"], {"phi": travel(draw, angle)})


@public
def hart(
    long: float = 0.6, short: float = 0.25, fraction: float = 0.5, crank: float = 0.2, angle: float = 0.4
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
    what = "hart"
    long, short, crank = positive(what, long=long, short=short, crank=crank)
    fraction, angle = number(what, fraction=fraction, angle=angle)
    if short >= long:
        raise MechanismError(f"{what}: short = {short:g} must be shorter than long = {long:g}")
    if not 0 < fraction < 1:
        raise MechanismError(f"{what}: fraction = {fraction:g} must lie between 0 and 1")

    def draw(phi: float) -> dict[str, Point]:
        p = polar((crank, 0.0), crank, phi)
        reach = math.hypot(*p)
        wide = reach / fraction  # B-D, the longer or shorter parallel side of the trapezium B-D-A-C
        narrow = (long**2 - short**2) / wide if wide else math.inf
        square = short**2 - 0.25 * (wide - narrow) ** 2
        if square <= 1e-12 * short**2:
            low, high = fraction * (long - short), fraction * (long + short)
            raise MechanismError(
                f"{what}: crank = {crank:g} puts P {reach:g} away from O; with long = {long:g} and short = {short:g} "
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

    m = Mechanism(
        "hart", description="Hart's inversor: Q draws an exact straight line, with only four bars and a crank."
    )
    m.ground("O", (0.0, 0.0))
    m.ground("G", (crank, 0.0))
    for name, at in draw(angle).items():
        m.point(name, at)
    m.body("crank", ["G", "P"])
    m.body("long1", ["A", "B", "O"])
    m.body("long2", ["C", "D"])
    m.body("short1", ["A", "D", "P"])
    m.body("short2", ["C", "B", "Q"])
    m.angle("phi", at="G", to="P")
    return drive(m, ["Q"], {"phi": travel(draw, angle)})
