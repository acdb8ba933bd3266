"""Mechanisms with a slider and a crank: slider-crank, Scotch yoke, crank with a slider on an oscillating bar."""

import math

from jaxnc.calls import public
from jaxnc.errors import MechanismError
from jaxnc.library.drawing import FLAT, TURN, Point, choice, drive, number, polar, positive, travel
from jaxnc.mechanism import Mechanism


@public
def slider_crank(
    crank: float = 0.1,
    conrod: float = 0.3,
    offset: float = 0.02,
    fixed_guide: bool = False,
    branch: str = "right",
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
    what = "slider_crank"
    crank, conrod = positive(what, crank=crank, conrod=conrod)
    offset, angle = number(what, offset=offset, angle=angle)
    side = 1.0 if choice(what, "branch", branch, ("right", "left")) == "right" else -1.0

    def draw(phi: float) -> tuple[Point, Point]:
        b = polar((0.0, 0.0), crank, phi)
        rise = offset - b[1]
        if abs(rise) >= conrod * math.sqrt(1.0 - FLAT**2):
            raise MechanismError(
                f"{what}: conrod = {conrod:g} does not reach from crank = {crank:g} to offset = {offset:g}, which "
                f"is {abs(rise):g} away; give a longer conrod, a smaller offset, or start from another angle"
            )
        return b, (b[0] + side * math.sqrt(conrod**2 - rise**2), offset)

    b, c = draw(angle)
    m = Mechanism("slider-crank", description="Crank AB, connecting rod BC, slider C on a straight guide.")
    m.ground("A", (0.0, 0.0))
    if not fixed_guide:
        m.ground("G", (side * max(conrod - crank, 0.1 * conrod), offset))
        m.ground("H", (side * (conrod + crank), offset))
    m.point("B", b)
    m.point("C", c, fixed="y" if fixed_guide else "")
    m.body("crank", ["A", "B"], lengths={("A", "B"): crank} if explicit else None)
    m.body("conrod", ["B", "C"], lengths={("B", "C"): conrod} if explicit else None)
    if not fixed_guide:
        m.slot("guide", "C", ("G", "H"))
    m.body("slider", ["C"])
    m.angle("phi", at="A", to="B")
    return drive(m, ["C.x"], {"phi": travel(draw, angle)})


@public
def crank_slider_on_bar(
    crank: float = 0.1,
    bar: float = 0.4,
    arm: float = 0.08,
    ground: float = 0.25,
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
    what = "crank_slider_on_bar"
    crank, bar, arm, ground = positive(what, crank=crank, bar=bar, arm=arm, ground=ground)
    (angle,) = number(what, angle=angle)
    if ground - crank <= arm:
        raise MechanismError(
            f"{what}: arm = {arm:g} must be shorter than ground - crank = {ground - crank:g} for the crank to turn"
        )
    if bar <= math.sqrt((ground + crank) ** 2 - arm**2):
        raise MechanismError(
            f"{what}: bar = {bar:g} leaves its block; make it longer than "
            f"sqrt((ground + crank)² - arm²) = {math.sqrt((ground + crank) ** 2 - arm**2):g}"
        )
    p1, d = polar((0.0, 0.0), crank, angle), (ground, 0.0)
    reach = math.dist(p1, d)
    along = math.sqrt(reach**2 - arm**2)
    direction = math.atan2(d[1] - p1[1], d[0] - p1[0]) + math.atan2(arm, along)
    m = Mechanism("crank and slider on a bar", description="The bar P1-P2 slides through a block on the arm D-P3.")
    m.ground("A", (0.0, 0.0))
    m.ground("D", d)
    m.point("P1", p1)
    m.point("P2", polar(p1, bar, direction))
    m.point("P3", polar(p1, along, direction))
    m.body("crank", ["A", "P1"])
    m.body("bar", ["P1", "P2"])
    m.body("arm", ["D", "P3"])
    m.prismatic("block", line=("P1", "P2"), on=("P3", "D"))
    if crank_angle:
        m.angle("phi", at="A", to="P1")
        return drive(m, ["P2", "P3"], {"phi": (0.0, TURN)})
    return drive(m, ["P2", "P3"], {"P1.y": (-0.95 * crank, 0.95 * crank)})


@public
def scotch_yoke(crank: float = 0.1, slot: float = 0.15, angle: float = 0.8) -> Mechanism:
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
    what = "scotch_yoke"
    crank, slot = positive(what, crank=crank, slot=slot)
    (angle,) = number(what, angle=angle)
    if slot < crank:
        raise MechanismError(f"{what}: slot = {slot:g} is shorter than crank = {crank:g}; the pin would leave it")
    p = polar((0.0, 0.0), crank, angle)
    m = Mechanism("scotch yoke", description="A pin in a cross slot turns rotation into exact harmonic motion.")
    m.ground("O", (0.0, 0.0))
    m.ground("G", (2.0 * crank, 0.0))
    m.point("P", p)
    m.point("Y", (p[0], 0.0))
    m.point("T", (p[0], slot))
    m.body("crank", ["O", "P"])
    m.body("yoke", ["Y", "T"])
    m.prismatic("guide", line=("O", "G"), on=("Y", "T"))
    m.slot("slot", "P", ("Y", "T"))
    m.angle("phi", at="O", to="P")
    return drive(m, ["Y.x"], {"phi": (0.0, TURN)})
