"""Four-bar linkages and the parallelogram that is one with too many cranks."""

import math

from jaxnc.calls import public
from jaxnc.errors import MechanismError
from jaxnc.library.drawing import TURN, Point, carried, choice, drive, meet, number, place, polar, positive, travel
from jaxnc.mechanism import Mechanism


@public
def four_bar(
    crank: float = 0.04,
    coupler: float = 0.12,
    rocker: float = 0.08,
    ground: float = 0.10,
    coupler_point: tuple[float, float] | None = None,
    branch: str = "open",
    angle: float = 1.0,
    explicit: bool = True,
) -> Mechanism:
    """Four-bar linkage A-B-C-D with the ground pivots A at the origin and D on the x axis.

    n = 5, rows = 4, rank 4, g = 1; with a coupler point n = 7, rows = 6, rank 6, g = 1. Input ``phi``, the angle of the
    crank AB from the x axis. The default drive covers a full turn where the crank has one, otherwise its range.

    Args:
        crank: length A-B.
        coupler: length B-C.
        rocker: length C-D.
        ground: length A-D.
        coupler_point: place of the coupler point P as (along, across), lengths along B-C from B and to its left; no
            coupler point if not given.
        branch: ``"open"`` draws C to the left of the way from B to D, ``"crossed"`` to the right.
        angle: crank angle of the drawing, radians.
        explicit: give the lengths to the bodies as design variables of their own (``crank.A-B``, …); otherwise they
            are read off the drawing.

    Raises:
        MechanismError: for a length that is not positive, an unknown branch, or lengths that do not close.

    Source: source text, fig. 1 and 2; R. L. Norton, Design of Machinery, position analysis of the four-bar: the
    lengths of its example, in metres, whose crank at 40° has the coupler at 20.298° and the rocker at 57.325°.
    """
    what = "four_bar"
    crank, coupler, rocker, ground = positive(what, crank=crank, coupler=coupler, rocker=rocker, ground=ground)
    (angle,) = number(what, angle=angle)
    side = 1.0 if choice(what, "branch", branch, ("open", "crossed")) == "open" else -1.0
    a, d = (0.0, 0.0), (ground, 0.0)

    def draw(phi: float) -> tuple[Point, Point]:
        b = polar(a, crank, phi)
        return b, meet(what, b, d, side, coupler=coupler, rocker=rocker)

    b, c = draw(angle)
    m = Mechanism("four-bar", description="Four-bar linkage A-B-C-D, driven at its crank AB.")
    m.ground("A", a)
    m.ground("D", d)
    m.point("B", b)
    m.point("C", c)
    m.body("crank", ["A", "B"], lengths={("A", "B"): crank} if explicit else None)
    points, local = ["B", "C"], {}
    if coupler_point is not None:
        along, across = place(what, "coupler_point", coupler_point)
        points.append(m.point("P", carried(b, c, along, across)))
        local["P"] = (along, across)
    m.body(
        "coupler",
        points,
        lengths={("B", "C"): coupler} if explicit else None,
        local=local if explicit else None,
    )
    m.body("rocker", ["C", "D"], lengths={("C", "D"): rocker} if explicit else None)
    m.angle("phi", at="A", to="B")
    return drive(m, ["P"] if local else ["C"], {"phi": travel(draw, angle)})


@public
def parallelogram(
    crank: float = 0.1,
    base: float = 0.3,
    third: tuple[float, float] | None = (0.12, 0.15),
    angle: float = 1.0,
) -> Mechanism:
    """Parallelogram linkage, by default with a third parallel crank: overconstrained, and still movable.

    With the third crank n = 7, rows = 7, rank 6, g = 1: one length is redundant. Without it n = 5, rows = 4, rank 4,
    g = 1. Input ``phi``, the angle of the crank AB from the x axis. The third crank, its pivot off the line AD, takes
    away the change points at 0 and π, and the drive is a full turn; without it (or with its pivot on the line) the
    drive stays between them.

    Args:
        crank: length of all cranks A-B, D-C and F-E.
        base: length A-D of the ground and B-C of the coupler.
        third: place (x, y) of the third ground pivot F, lengths; None for two cranks.
        angle: crank angle of the drawing, radians, not a multiple of π with two cranks.

    Raises:
        MechanismError: for a length that is not positive, a third pivot on another one, or two cranks drawn at a
            change point.

    Source: source text §3.3.1 and §4.2.3 on redundant equations; R. L. Norton, Design of Machinery, on the paradoxes of
    Gruebler's criterion.
    """
    what = "parallelogram"
    crank, base = positive(what, crank=crank, base=base)
    (angle,) = number(what, angle=angle)
    pivots: dict[str, Point] = {"A": (0.0, 0.0), "D": (base, 0.0)}
    if third is not None:
        pivots["F"] = place(what, "third", third)
        if pivots["F"] in (pivots["A"], pivots["D"]):
            raise MechanismError(f"{what}: third = {pivots['F']} is where another pivot is; move it")

    braced = third is not None and abs(pivots["F"][1]) > 1e-6 * base
    if not braced and abs(math.sin(angle)) < 1e-6:
        raise MechanismError(f"{what}: angle = {angle:g} is a change point of two cranks; draw it off the line AD")
    m = Mechanism("parallelogram", description="Parallel cranks that carry a coupler without turning it.")
    for name, at in pivots.items():
        m.ground(name, at)
    tips = {"A": "B", "D": "C", "F": "E"}
    for name, at in pivots.items():
        m.point(tips[name], polar(at, crank, angle))
    for k, name in enumerate(pivots):
        m.body(f"crank{k + 1}", [name, tips[name]])
    m.body("coupler", [tips[name] for name in pivots])
    m.angle("phi", at="A", to="B")
    half = math.copysign(math.pi, math.sin(angle))
    return drive(m, ["B"], {"phi": (0.0, TURN) if braced else (0.02 * half, 0.98 * half)})
