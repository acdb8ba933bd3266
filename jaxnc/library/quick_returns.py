"""Quick-return mechanisms: the slotted rocker of a shaper, its ram driven by a pin or by a link, and Whitworth's."""

import math

from jaxnc.calls import public
from jaxnc.errors import MechanismError
from jaxnc.library.drawing import FLAT, TURN, Point, drive, number, polar, positive, travel
from jaxnc.mechanism import Mechanism


@public
def quick_return(
    crank: float = 0.1,
    centre_distance: float = 0.25,
    rocker: float = 0.5,
    guide: float = 0.42,
    angle: float = 2.0,
) -> Mechanism:
    """Quick-return mechanism: a crank pin P1 swings a slotted rocker A-P2, in which the pin P3 of the ram slides.

    n = 7, rows = 6, rank 6, g = 1 as in (48)-(53). Input ``phi``, the angle of the crank B-P1 from the direction B-A;
    the default drive is a full turn.

    Args:
        crank: length B-P1.
        centre_distance: length A-B from the rocker pivot A up to the crank pivot B, longer than the crank.
        rocker: length A-P2, long enough for the pin to stay in the slot.
        guide: height of the ram's guide C-D above A, a length, between the crank circle and the rocker's tip.
        angle: crank angle of the drawing, from the direction B-A, radians.

    Raises:
        MechanismError: for a length that is not positive, a crank that does not leave the rocker pivot outside its
            circle, or a rocker or guide that a pin would leave.

    Source: source text, fig. 20, (48)-(53), with its names.
    """
    what = "quick_return"
    crank, centre, rocker, guide = positive(
        what, crank=crank, centre_distance=centre_distance, rocker=rocker, guide=guide
    )
    (angle,) = number(what, angle=angle)
    swing = _swing(what, crank, centre, rocker)
    if guide > rocker * math.cos(swing):
        raise MechanismError(
            f"{what}: guide = {guide:g} is higher than the rocker's tip at the end of its swing, "
            f"{rocker * math.cos(swing):g}; lower it or make rocker = {rocker:g} longer"
        )
    p1 = polar((0.0, centre), crank, angle - 0.5 * math.pi)
    tilt = math.atan2(p1[1], p1[0])
    half = max(1.2 * guide * math.tan(swing), crank)
    m = Mechanism(
        "quick return", description="A crank swings a slotted rocker that drives a ram, slowly there and fast back."
    )
    m.ground("A", (0.0, 0.0))
    m.ground("B", (0.0, centre))
    m.ground("C", (-half, guide))
    m.ground("D", (half, guide))
    m.point("P1", p1)
    m.point("P2", polar((0.0, 0.0), rocker, tilt))
    m.point("P3", (guide / math.tan(tilt), guide))
    m.body("crank", ["B", "P1"])
    m.body("rocker", ["A", "P2"])
    m.slot("pin in rocker", "P1", ("A", "P2"))
    m.slot("ram in rocker", "P3", ("A", "P2"))
    m.slot("ram in guide", "P3", ("C", "D"))
    m.body("ram", ["P3"], along=("C", "D"))
    m.angle("phi", at="B", to="P1", start="A")
    return drive(m, ["P3.x"], {"phi": (0.0, TURN)})


@public
def shaper(
    crank: float = 0.1,
    centre_distance: float = 0.25,
    rocker: float = 0.5,
    link: float = 0.2,
    ram_height: float = 0.22,
    angle: float = 0.5,
) -> Mechanism:
    """Crank shaper: a slotted rocker O4-C, swung by the crank O2-A, pulls a ram R by the link C-R.

    n = 6, rows = 5, rank 5, g = 1; the ram's height is constant and eliminated. Input ``phi``, the angle of the crank
    O2-A from the x axis, O2 the origin; the default drive is a full turn.

    Args:
        crank: length O2-A.
        centre_distance: length O4-O2, the rocker pivot O4 below the crank pivot, longer than the crank.
        rocker: length O4-C, long enough for the pin to stay in the slot.
        link: length C-R; the ram is drawn to the left of C.
        ram_height: height of the ram's path above O2, a length, any sign.
        angle: crank angle of the drawing, radians.

    Raises:
        MechanismError: for a length that is not positive, a crank that does not leave the rocker pivot outside its
            circle, a rocker that the pin would leave, or a link that does not reach the ram.

    Source: R. L. Norton, Design of Machinery, crank-shaper quick return; extends fig. 20 of the source text.
    """
    what = "shaper"
    crank, centre, rocker, link = positive(what, crank=crank, centre_distance=centre_distance, rocker=rocker, link=link)
    height, angle = number(what, ram_height=ram_height, angle=angle)
    _swing(what, crank, centre, rocker)
    pivot = (0.0, -centre)

    def draw(phi: float) -> tuple[Point, Point, Point]:
        pin = polar((0.0, 0.0), crank, phi)
        tip = polar(pivot, rocker, math.atan2(pin[1] - pivot[1], pin[0] - pivot[0]))
        return pin, tip, _ram(what, tip, link, height, -1.0)

    m = Mechanism(
        "shaper", description="Crank shaper: slotted rocker and link, slow cut and quick return of the ram R."
    )
    return _with_ram(m, pivot, draw(angle), "rocker", travel(draw, angle))


@public
def whitworth(
    crank: float = 0.25,
    offset: float = 0.1,
    arm: float = 0.12,
    link: float = 0.5,
    ram_height: float = -0.1,
    angle: float = 0.5,
) -> Mechanism:
    """Whitworth quick return: the slotted arm turns right round, because its pivot lies inside the crank circle.

    n = 6, rows = 5, rank 5, g = 1; the ram's height is constant and eliminated. Input ``phi``, the angle of the crank
    O2-A from the x axis, O2 the origin; the default drive is a full turn.

    Args:
        crank: length O2-A.
        offset: length O4-O2, the arm's pivot O4 below the crank pivot, shorter than the crank.
        arm: length O4-C, from the arm's pivot to the pin of the link.
        link: length C-R; the ram is drawn to the right of C.
        ram_height: height of the ram's path above O2, a length, any sign; ``-offset`` puts it through O4.
        angle: crank angle of the drawing, radians.

    Raises:
        MechanismError: for a length that is not positive, an offset that puts the arm's pivot outside the crank
            circle, or a link that does not reach the ram.

    Source: R. L. Norton, Design of Machinery, Whitworth quick return.
    """
    what = "whitworth"
    crank, offset, arm, link = positive(what, crank=crank, offset=offset, arm=arm, link=link)
    height, angle = number(what, ram_height=ram_height, angle=angle)
    if offset >= crank:
        raise MechanismError(
            f"{what}: offset = {offset:g} must be shorter than crank = {crank:g} for the arm to turn round; "
            f"with a longer one the arm oscillates: use quick_return or shaper"
        )
    pivot = (0.0, -offset)

    def draw(phi: float) -> tuple[Point, Point, Point]:
        pin = polar((0.0, 0.0), crank, phi)
        tip = polar(pivot, arm, math.atan2(pin[1] - pivot[1], pin[0] - pivot[0]))
        return pin, tip, _ram(what, tip, link, height, 1.0)

    m = Mechanism(
        "whitworth", description="Whitworth quick return: a slotted arm that turns unevenly drives the ram R."
    )
    return _with_ram(m, pivot, draw(angle), "arm", travel(draw, angle))


def _swing(what: str, crank: float, centre: float, rocker: float) -> float:
    """Largest angle of a slotted rocker from its middle position, radians, after checking that it has one."""
    if crank >= centre:
        raise MechanismError(
            f"{what}: crank = {crank:g} must be shorter than centre_distance = {centre:g} for the rocker to "
            f"oscillate; with a longer one it turns round: use whitworth"
        )
    if rocker < centre + crank:
        raise MechanismError(
            f"{what}: rocker = {rocker:g} lets the pin leave its slot; make it at least centre_distance + crank = "
            f"{centre + crank:g}"
        )
    return math.asin(crank / centre)


def _ram(what: str, tip: Point, link: float, height: float, side: float) -> Point:
    rise = height - tip[1]
    if abs(rise) >= link * math.sqrt(1.0 - FLAT**2):
        raise MechanismError(
            f"{what}: link = {link:g} does not reach the ram at ram_height = {height:g}, which is {abs(rise):g} away; "
            f"give a longer link or another ram_height"
        )
    return tip[0] + side * math.sqrt(link**2 - rise**2), height


def _with_ram(
    m: Mechanism, pivot: Point, places: tuple[Point, Point, Point], lever: str, phi: tuple[float, float]
) -> Mechanism:
    """Build the crank, the slotted lever, the link and the ram from the places of A, C and R."""
    m.ground("O2", (0.0, 0.0))
    m.ground("O4", pivot)
    m.point("A", places[0])
    m.point("C", places[1])
    m.point("R", places[2], fixed="y")
    m.body("crank", ["O2", "A"])
    m.body(lever, ["O4", "C"])
    m.slot("slot", "A", ("O4", "C"))
    m.body("link", ["C", "R"])
    m.body("ram", ["R"])
    m.angle("phi", at="O2", to="A")
    return drive(m, ["R.x"], {"phi": phi})
