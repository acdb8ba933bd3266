"""Cranks that move a slider or a slotted lever: slider-crank, Scotch yoke, oscillating bar, quick returns."""

import math
from typing import Literal

from jaxnc.library.drawing import TURN, Length, Misfit, Point, crank_travel, drive, lay_out, offer, polar, reach_guide
from jaxnc.mechanism import Mechanism


@offer
def slider_crank(
    crank: Length = 0.1,
    conrod: Length = 0.3,
    offset: float = 0.02,
    fixed_guide: bool = False,
    branch: Literal["right", "left"] = "right",
    angle: float = 1.0,
    explicit: bool = True,
) -> Mechanism:
    """Slider-crank A-B-C: crank pivot A at the origin, crank pin B, slider C on a guide parallel to the x axis.

    n = 5, rows = 4, rank 4, g = 1 as in (18)-(21), the guide given by two ground points G and H; with `fixed_guide`
    the slider's y is constant and eliminated: n = 4, rows = 3, rank 3, g = 1. Input ``phi``, the crank angle from the
    x axis. The default drive covers a full turn where the crank has one, otherwise its range.

    Args:
        crank: length A-B.
        conrod: length B-C.
        offset: height of the guide above the crank pivot, a length, may be negative or zero.
        fixed_guide: eliminate the slider's y instead of writing that it stays on the line G-H.
        branch: ``"right"`` draws the slider to the right of the crank pin, ``"left"`` to the left.
        angle: crank angle of the drawing, radians.
        explicit: give the lengths to the bodies as design variables of their own (``crank.A-B``, ``conrod.B-C``);
            otherwise they are read off the drawing.

    Raises:
        MechanismError: for a length that is not positive, an unknown branch, or a connecting rod that does not reach
            the guide.

    Source: source text, fig. 7 and 8, (18)-(21); its points 1, 2, B, C are B, C, G, H here.
    """
    side = 1.0 if branch == "right" else -1.0

    def draw(phi: float) -> tuple[Point, Point]:
        b = polar((0.0, 0.0), crank, phi)
        return b, reach_guide(b, "conrod", conrod, "offset", offset, side)

    b, c = draw(angle)
    guide = {"G": (side * max(conrod - crank, 0.1 * conrod), offset), "H": (side * (conrod + crank), offset)}
    m = lay_out(
        "slider-crank",
        "Crank AB, connecting rod BC, slider C on a straight guide.",
        {"A": (0.0, 0.0), **({} if fixed_guide else guide)},
        {"B": b, "C": c},
        {},
        {"C": "y"} if fixed_guide else None,
    )
    m.body("crank", ["A", "B"], lengths={("A", "B"): crank} if explicit else None)
    m.body("conrod", ["B", "C"], lengths={("B", "C"): conrod} if explicit else None)
    if not fixed_guide:
        m.slot("guide", "C", ("G", "H"))
    m.body("slider", ["C"])
    m.angle("phi", at="A", to="B")
    return drive(m, ["C.x"], {"phi": crank_travel(draw, angle)})


@offer
def crank_slider_on_bar(
    crank: Length = 0.1,
    bar: Length = 0.4,
    arm: Length = 0.08,
    ground: Length = 0.25,
    angle: float = 0.3,
    crank_angle: bool = False,
) -> Mechanism:
    """Crank whose bar slides through a block on an oscillating arm: the mechanism of the coordinate comparison.

    Crank A-P1, bar P1-P2, arm D-P3 perpendicular to the bar, P3 on the bar. n = 6, rows = 5, rank 5, g = 1 as in
    (13)-(17), without any angle: the default drive moves ``P1.y``, the height of the crank pin, on the right half of
    the crank circle. With `crank_angle` the coordinate ``phi`` is added, the angle of the crank from the x axis: n =
    7, rows = 6, rank 6, g = 1, and the drive is a full turn.

    Args:
        crank: length L1 of A-P1.
        bar: length L2 of P1-P2.
        arm: length L3 of D-P3, to the left of the bar's direction.
        ground: length L4 of A-D, along the x axis.
        angle: crank angle of the drawing, radians, between -π/2 and π/2 for the default drive.
        crank_angle: add the crank angle as a coordinate.

    Raises:
        MechanismError: for a length that is not positive, an arm that does not let the crank turn, or a bar too short
            to stay in its block.

    Source: source text, fig. 3 to 6, (13)-(17).
    """
    if ground - crank <= arm:
        raise Misfit(f"arm = {arm:g} must be shorter than ground - crank = {ground - crank:g} for the crank to turn")
    if bar <= math.sqrt((ground + crank) ** 2 - arm**2):
        raise Misfit(
            f"bar = {bar:g} leaves its block; make it longer than "
            f"sqrt((ground + crank)² - arm²) = {math.sqrt((ground + crank) ** 2 - arm**2):g}"
        )
    p1, d = polar((0.0, 0.0), crank, angle), (ground, 0.0)
    reach = math.dist(p1, d)
    along = math.sqrt(reach**2 - arm**2)
    direction = math.atan2(d[1] - p1[1], d[0] - p1[0]) + math.atan2(arm, along)
    m = lay_out(
        "crank and slider on a bar",
        "The bar P1-P2 slides through a block on the arm D-P3.",
        {"A": (0.0, 0.0), "D": d},
        {"P1": p1, "P2": polar(p1, bar, direction), "P3": polar(p1, along, direction)},
        {"crank": "A P1", "bar": "P1 P2", "arm": "D P3"},
    )
    m.prismatic("block", line=("P1", "P2"), on=("P3", "D"))
    if crank_angle:
        m.angle("phi", at="A", to="P1")
        return drive(m, ["P2", "P3"], {"phi": (0.0, TURN)})
    return drive(m, ["P2", "P3"], {"P1.y": (-0.95 * crank, 0.95 * crank)})


@offer
def scotch_yoke(crank: Length = 0.1, slot: Length = 0.15, angle: float = 0.8) -> Mechanism:
    """Scotch yoke: a crank pin in the cross slot of a yoke that slides along the x axis.

    The yoke's point Y moves as ``crank cos φ``, exactly. n = 7, rows = 6, rank 6, g = 1. Input ``phi``, the crank angle
    from the x axis; the default drive is a full turn.

    Args:
        crank: length O-P from the crank pivot O to the pin P.
        slot: half length Y-T of the slot, at least the crank.
        angle: crank angle of the drawing, radians.

    Raises:
        MechanismError: for a length that is not positive, or a slot shorter than the crank.

    Source: R. L. Norton, Design of Machinery, inversions of the slider-crank; prismatic joints (35)-(37).
    """
    if slot < crank:
        raise Misfit(f"slot = {slot:g} is shorter than crank = {crank:g}; the pin would leave it")
    p = polar((0.0, 0.0), crank, angle)
    m = lay_out(
        "scotch yoke",
        "A pin in a cross slot turns rotation into exact harmonic motion.",
        {"O": (0.0, 0.0), "G": (2.0 * crank, 0.0)},
        {"P": p, "Y": (p[0], 0.0), "T": (p[0], slot)},
        {"crank": "O P", "yoke": "Y T"},
    )
    m.prismatic("guide", line=("O", "G"), on=("Y", "T"))
    m.slot("slot", "P", ("Y", "T"))
    m.angle("phi", at="O", to="P")
    return drive(m, ["Y.x"], {"phi": (0.0, TURN)})


@offer
def quick_return(
    crank: Length = 0.1,
    centre_distance: Length = 0.25,
    rocker: Length = 0.5,
    guide: Length = 0.42,
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
    swing = _swing(crank, centre_distance, rocker)
    if guide > rocker * math.cos(swing):
        raise Misfit(
            f"guide = {guide:g} is higher than the rocker's tip at the end of its swing, "
            f"{rocker * math.cos(swing):g}; lower it or make rocker = {rocker:g} longer"
        )
    p1 = polar((0.0, centre_distance), crank, angle - 0.5 * math.pi)
    tilt = math.atan2(p1[1], p1[0])
    half = max(1.2 * guide * math.tan(swing), crank)
    m = lay_out(
        "quick return",
        "A crank swings a slotted rocker that drives a ram, slowly there and fast back.",
        {"A": (0.0, 0.0), "B": (0.0, centre_distance), "C": (-half, guide), "D": (half, guide)},
        {"P1": p1, "P2": polar((0.0, 0.0), rocker, tilt), "P3": (guide / math.tan(tilt), guide)},
        {"crank": "B P1", "rocker": "A P2"},
    )
    m.slot("pin in rocker", "P1", ("A", "P2"))
    m.slot("ram in rocker", "P3", ("A", "P2"))
    m.slot("ram in guide", "P3", ("C", "D"))
    m.body("ram", ["P3"], along=("C", "D"))
    m.angle("phi", at="B", to="P1", start="A")
    return drive(m, ["P3.x"], {"phi": (0.0, TURN)})


@offer
def shaper(
    crank: Length = 0.1,
    centre_distance: Length = 0.25,
    rocker: Length = 0.5,
    link: Length = 0.2,
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
    _swing(crank, centre_distance, rocker)
    m, phi = _ram((crank, -centre_distance, rocker, link, ram_height), -1.0, angle, "shaper", "rocker")
    m.model.description = "Crank shaper: slotted rocker and link, slow cut and quick return of the ram R."
    return drive(m, ["R.x"], {"phi": phi})


@offer
def whitworth(
    crank: Length = 0.25,
    offset: Length = 0.1,
    arm: Length = 0.12,
    link: Length = 0.5,
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
    if offset >= crank:
        raise Misfit(
            f"offset = {offset:g} must be shorter than crank = {crank:g} for the arm to turn round; "
            f"with a longer one the arm oscillates: use quick_return or shaper"
        )
    m, phi = _ram((crank, -offset, arm, link, ram_height), 1.0, angle, "whitworth", "arm")
    m.model.description = "Whitworth quick return: a slotted arm that turns unevenly drives the ram R."
    return drive(m, ["R.x"], {"phi": phi})


def _swing(crank: float, centre: float, rocker: float) -> float:
    """Largest angle of a slotted rocker from its middle position, radians, after checking that it has one."""
    if crank >= centre:
        raise Misfit(
            f"crank = {crank:g} must be shorter than centre_distance = {centre:g} for the rocker to "
            f"oscillate; with a longer one it turns round: use whitworth"
        )
    if rocker < centre + crank:
        raise Misfit(
            f"rocker = {rocker:g} lets the pin leave its slot; make it at least centre_distance + crank = "
            f"{centre + crank:g}"
        )
    return math.asin(crank / centre)


def _ram(
    sizes: tuple[float, ...], side: float, angle: float, name: str, lever: str
) -> tuple[Mechanism, tuple[float, float]]:
    """Lay out a crank, a slotted lever that it turns, a link and a ram; and how far the crank goes.

    `sizes` are the crank, the height of the lever's pivot, lever, link, and the ram's height.
    """
    crank, pivot, arm, link, height = sizes

    def draw(phi: float) -> dict[str, Point]:
        pin = polar((0.0, 0.0), crank, phi)
        tip = polar((0.0, pivot), arm, math.atan2(pin[1] - pivot, pin[0]))
        return {"A": pin, "C": tip, "R": reach_guide(tip, "link", link, "ram_height", height, side)}

    ground, bodies = {"O2": (0.0, 0.0), "O4": (0.0, pivot)}, {"crank": "O2 A", lever: "O4 C", "link": "C R", "ram": "R"}
    m = lay_out(name, "", ground, draw(angle), bodies, {"R": "y"})
    m.slot("slot", "A", ("O4", "C"))
    m.angle("phi", at="O2", to="A")
    return m, crank_travel(draw, angle)
