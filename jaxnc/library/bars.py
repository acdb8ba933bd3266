"""Linkages of bars: four-bars, the parallelogram, five- and six-bars, and chains of any number of loops."""

import math
from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple

from jaxnc.library.drawing import (
    TURN,
    Length,
    Misfit,
    Point,
    crank_travel,
    drive,
    hardpoints,
    lay_out,
    lay_out_joints,
    meet,
    offer,
    place_along,
    polar,
    turn_crank,
)
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism.model import Place


@offer
def four_bar(
    crank: Length = 0.04,
    coupler: Length = 0.12,
    rocker: Length = 0.08,
    ground: Length = 0.10,
    coupler_point: tuple[float, float] | None = None,
    branch: Literal["open", "crossed"] = "open",
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
    a, d = (0.0, 0.0), (ground, 0.0)
    draw = turn_crank(a, crank, d, 1.0 if branch == "open" else -1.0, coupler=coupler, rocker=rocker)
    b, c = draw(angle)
    points, local = ["B", "C"], {}
    m = lay_out("four-bar", "Four-bar linkage A-B-C-D, driven at its crank AB.", {"A": a, "D": d}, {"B": b, "C": c}, {})
    if coupler_point is not None:
        points.append(m.point("P", place_along(b, c, *coupler_point)))
        local["P"] = coupler_point
    m.body("crank", ["A", "B"], lengths={("A", "B"): crank} if explicit else None)
    lengths = {("B", "C"): coupler} if explicit else None
    m.body("coupler", points, lengths=lengths, local=local if explicit else None)
    m.body("rocker", ["C", "D"], lengths={("C", "D"): rocker} if explicit else None)
    m.angle("phi", at="A", to="B")
    return drive(m, ["P"] if local else ["C"], {"phi": crank_travel(draw, angle)})


@offer
def parallelogram(
    crank: Length = 0.1,
    base: Length = 0.3,
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
    pivots: dict[str, Point] = {"A": (0.0, 0.0), "D": (base, 0.0)}
    if third is not None:
        pivots["F"] = third
        if third in (pivots["A"], pivots["D"]):
            raise Misfit(f"third = {third} is where another pivot is; move it")

    braced = third is not None and abs(third[1]) > 1e-6 * base
    if not braced and abs(math.sin(angle)) < 1e-6:
        raise Misfit(f"angle = {angle:g} is a change point of two cranks; draw it off the line AD")
    tips = {"A": "B", "D": "C", "F": "E"}
    bodies = {f"crank{k + 1}": f"{name} {tips[name]}" for k, name in enumerate(pivots)}
    m = lay_out(
        "parallelogram",
        "Parallel cranks that carry a coupler without turning it.",
        pivots,
        {tips[name]: polar(at, crank, angle) for name, at in pivots.items()},
        bodies | {"coupler": " ".join(tips[name] for name in pivots)},
    )
    m.angle("phi", at="A", to="B")
    half = math.copysign(math.pi, math.sin(angle))
    return drive(m, ["B"], {"phi": (0.0, TURN) if braced else (0.02 * half, 0.98 * half)})


@offer
def four_bar_chain(
    loops: int = 3,
    crank: Length = 1.0,
    coupler: Length = 1.0,
    ground: Length = 1.0,
    last: Length | None = None,
    angle: float = 1.0,
) -> Mechanism:
    """Four-bar linkages in a row, each rocker being the next one's crank: the N-four-bar of the benchmarks.

    Cranks Ai-Bi, i = 0 … loops, on ground pivots in line, couplers Bi-B(i+1). n = 2 loops + 3, rows = rank = n - 1,
    g = 1. Input ``phi``, the angle of the first crank from the x axis. With the default lengths every loop is a
    rhombus, and all of them pass a change point together at phi = 0 and π; the default drive stays between.

    Args:
        loops: how many four-bars, at least one.
        crank: length of the first crank.
        coupler: length of every coupler.
        ground: distance from one ground pivot to the next.
        last: length of the last crank; those between change evenly from the first to it. As the first if not given.
        angle: angle of the first crank in the drawing, radians.

    Raises:
        MechanismError: for a number of loops that is not a positive integer, a length that is not positive, lengths
            that do not close, or a drawing at a change point.

    Source: M. González, D. Dopico, U. Lugrís, J. Cuadrado, A benchmarking system for MBS simulation software, Multibody
    System Dynamics 16 (2006), problem A02, N four-bar mechanism.
    """
    if not isinstance(loops, int) or isinstance(loops, bool) or loops < 1:
        raise Misfit(f"loops must be a positive integer, got {loops!r}; 1 is a single four-bar")
    last = crank if last is None else last
    if abs(math.sin(angle)) < 1e-6:
        raise Misfit(f"angle = {angle:g} is a change point; draw the cranks off the ground line")
    pivots: list[Point] = [(i * ground, 0.0) for i in range(loops + 1)]
    tips: list[Point] = [polar((0.0, 0.0), crank, angle)]
    # The branch on which cranks stay on one side of the ground line.
    side = math.copysign(1.0, math.sin(angle))
    for i in range(1, loops + 1):
        tips.append(meet(tips[-1], pivots[i], side, coupler=coupler, crank=crank + (last - crank) * i / loops))
    m = lay_out(
        "four-bar chain",
        f"{loops} four-bar linkages in a row, driven at the first crank.",
        {f"A{i}": pivot for i, pivot in enumerate(pivots)},
        {f"B{i}": tip for i, tip in enumerate(tips)},
        {f"crank{i}": f"A{i} B{i}" for i in range(loops + 1)}
        | {f"coupler{i + 1}": f"B{i} B{i + 1}" for i in range(loops)},
    )
    m.angle("phi", at="A0", to="B0")
    half = math.copysign(math.pi, side)
    ends = (0.02 * half, 0.98 * half) if last == crank and coupler == ground else (angle - 0.2, angle + 0.2)
    return drive(m, ["B0", f"B{loops}"], {"phi": ends})


@offer
def five_bar(
    crank1: Length = 0.1,
    coupler1: Length = 0.3,
    coupler2: Length = 0.3,
    crank2: Length = 0.1,
    ground: Length = 0.25,
    angle1: float = 1.0,
    angle2: float = 2.0,
    branch: Literal["open", "crossed"] = "open",
) -> Mechanism:
    """Five-bar linkage A-B-C-D-E with ground pivots A at the origin and E on the x axis, and two inputs.

    n = 8, rows = 6, rank 6, g = 2. Inputs ``phi``, the angle of the crank AB, and ``psi``, that of the crank ED, both
    from the x axis. The default drive turns the second crank twice as fast as the first, once round if it can.

    Args:
        crank1: length A-B.
        coupler1: length B-C.
        coupler2: length C-D.
        crank2: length D-E.
        ground: length A-E.
        angle1: angle phi of the drawing, radians.
        angle2: angle psi of the drawing, radians.
        branch: ``"open"`` draws C to the left of the way from B to D, ``"crossed"`` to the right.

    Raises:
        MechanismError: for a length that is not positive, an unknown branch, or couplers that do not reach each other.

    Source: R. L. Norton, Design of Machinery, five-bar mechanisms.
    """
    m, draw = _five_bar("five bar", (crank1, coupler1, coupler2, crank2, ground), (angle1, angle2), branch)
    m.model.description = "Five-bar linkage: two cranks place the joint C of the two couplers."
    start, end = crank_travel(lambda t: draw(angle1 + t, angle2 + 2.0 * t))
    return drive(m, ["C"], {"phi": (angle1 + start, angle1 + end), "psi": (angle2 + 2.0 * start, angle2 + 2.0 * end)})


@offer
def geared_five_bar(
    radius1: Length = 0.16,
    radius2: Length = 0.08,
    crank1: Length = 0.1,
    coupler1: Length = 0.3,
    coupler2: Length = 0.3,
    crank2: Length = 0.06,
    angle1: float = 1.0,
    angle2: float = 2.0,
    branch: Literal["open", "crossed"] = "open",
) -> Mechanism:
    """Geared five-bar A-B-C-D-E: the cranks AB and ED are fixed to two gear wheels in mesh.

    n = 8, rows = 7, rank 7, g = 1. Input ``phi``, the angle of the crank AB from the x axis; ``psi``, that of the crank
    ED, follows by ``R1 φ + R2 ψ = c``. The default drive is a turn of the first crank if it has one, otherwise its
    range.

    Args:
        radius1: pitch radius of the wheel at A, a length.
        radius2: pitch radius of the wheel at E, a length; A-E is the sum of both.
        crank1: length A-B.
        coupler1: length B-C.
        coupler2: length C-D.
        crank2: length D-E.
        angle1: angle phi of the drawing, radians.
        angle2: angle psi of the drawing, radians; the phase of the gears follows from both.
        branch: ``"open"`` draws C to the left of the way from B to D, ``"crossed"`` to the right.

    Raises:
        MechanismError: for a length that is not positive, an unknown branch, or couplers that do not reach each other.

    Source: R. L. Norton, Design of Machinery, geared five-bar mechanisms; gear relation (47).
    """
    lengths = crank1, coupler1, coupler2, crank2, radius1 + radius2
    m, draw = _five_bar("geared five bar", lengths, (angle1, angle2), branch)
    m.model.description = "Five-bar linkage whose two cranks are geared together."
    m.gear("mesh", "phi", "psi", radii=(radius1, radius2))
    ratio = radius1 / radius2
    start, end = crank_travel(lambda t: draw(angle1 + t, angle2 - ratio * t))
    return drive(m, ["C"], {"phi": (angle1 + start, angle1 + end)})


def _five_bar(
    name: str, lengths: tuple[float, ...], angles: tuple[float, float], branch: str
) -> tuple[Mechanism, Callable[[float, float], tuple[Point, Point, Point]]]:
    """Lay out the linkage from crank to crank and the ground; and the closed form that draws it at two angles."""
    crank1, coupler1, coupler2, crank2, ground = lengths
    a, e = (0.0, 0.0), (ground, 0.0)

    def draw(phi: float, psi: float) -> tuple[Point, Point, Point]:
        b, d = polar(a, crank1, phi), polar(e, crank2, psi)
        return b, meet(b, d, 1.0 if branch == "open" else -1.0, coupler1=coupler1, coupler2=coupler2), d

    bodies = {"crank1": "A B", "coupler1": "B C", "coupler2": "C D", "crank2": "D E"}
    m = lay_out(name, "", {"A": a, "E": e}, dict(zip("BCD", draw(*angles), strict=True)), bodies)
    m.angle("phi", at="A", to="B")
    m.angle("psi", at="E", to="D")
    return m, draw


class _SixBar(NamedTuple):
    """One inversion of a chain of six bars."""

    ground: str  # which of its joints are on the ground
    places: Mapping[str, Point]  # its joints as drawn
    bodies: Mapping[str, str]
    output: str


_CRANK = {"A": (0.0, 0.0), "D": (0.40, 0.0), "B": (0.05, 0.09)}
_WATT = {
    "I": _SixBar(
        "AD",
        {**_CRANK, "C": (0.36, 0.30), "E": (0.12, 0.40), "F": (0.55, 0.36), "G": (0.38, 0.60)},
        {"crank": "A B", "coupler": "B C E", "rocker": "D C F", "link1": "E G", "link2": "F G"},
        "G",
    ),
    "II": _SixBar(
        "ADG",
        {**_CRANK, "G": (0.90, 0.05), "C": (0.36, 0.30), "E": (0.50, 0.28), "F": (0.84, 0.36)},
        {"crank": "A B", "coupler": "B C", "rocker": "D C E", "link": "E F", "output": "G F"},
        "F",
    ),
}
_STEPHENSON = {
    "I": _SixBar(
        "AD",
        {**_CRANK, "E": (-0.08, 0.06), "C": (0.36, 0.30), "F": (0.28, 0.36), "G": (0.05, 0.55)},
        {"crank": "A B E", "coupler": "B C", "rocker": "D C F", "link1": "E G", "link2": "F G"},
        "G",
    ),
    "II": _SixBar(
        "AD",
        {**_CRANK, "C": (0.37, 0.33), "E": (0.24, 0.50), "F": (0.44, 0.18), "G": (0.16, 0.25)},
        {"crank": "A B", "coupler": "B C E", "link1": "C F", "link2": "E G", "rocker": "D F G"},
        "E",
    ),
    "III": _SixBar(
        "ADG",
        {**_CRANK, "G": (0.75, 0.10), "C": (0.36, 0.30), "E": (0.30, 0.50), "F": (0.70, 0.45)},
        {"crank": "A B", "coupler": "B C E", "rocker": "D C", "link": "E F", "output": "G F"},
        "F",
    ),
}


@offer
def watt_six_bar(inversion: Literal["I", "II"] = "II", places: Mapping[str, Place] | None = None) -> Mechanism:
    """Six-bar linkage of Watt's chain, in which the two bodies with three joints are neighbours.

    Inversion I: crank A-B, coupler B-C-E, rocker D-C-F, links E-G and F-G; n = 11, rows = 10, rank 10, g = 1.
    Inversion II: two four-bars in a row, crank A-B, coupler B-C, rocker D-C-E, link E-F, output G-F; n = 9, rows = 8,
    rank 8, g = 1. Input ``phi``, the angle of the crank AB from the x axis; the default drive is a full turn, which the
    default places allow.

    Args:
        inversion: ``"I"`` or ``"II"``: which body of the chain is the ground.
        places: where joints are drawn, ``{"E": (x, y)}``, lengths, instead of their default places; lengths of bars
            and the home value of phi follow.

    Raises:
        MechanismError: for an unknown inversion or joint, or two joints of one body at the same place.

    Source: R. L. Norton, Design of Machinery, Watt's chain and its inversions.
    """
    return _six_bar("Watt", _WATT[inversion], inversion, places)


@offer
def stephenson_six_bar(
    inversion: Literal["I", "II", "III"] = "III", places: Mapping[str, Place] | None = None
) -> Mechanism:
    """Six-bar linkage of Stephenson's chain, in which the two bodies with three joints are not neighbours.

    Inversion I: crank A-B-E, coupler B-C, rocker D-C-F, links E-G and F-G; n = 11, rows = 10, rank 10, g = 1.
    Inversion II: crank A-B, coupler B-C-E, links C-F and E-G, rocker D-F-G; n = 11, rows = 10, rank 10, g = 1; no part
    of it closes by itself, so its poses are not found by drawing circles.
    Inversion III: a four-bar A-B-C-D with coupler point E, link E-F, output G-F; n = 9, rows = 8, rank 8, g = 1.
    Input ``phi``, the angle of the crank AB from the x axis; the default drive is a full turn, which the default places
    allow.

    Args:
        inversion: ``"I"``, ``"II"`` or ``"III"``: which body of the chain is the ground.
        places: where joints are drawn, ``{"E": (x, y)}``, lengths, instead of their default places; lengths of bars
            and the home value of phi follow.

    Raises:
        MechanismError: for an unknown inversion or joint, or two joints of one body at the same place.

    Source: R. L. Norton, Design of Machinery, Stephenson's chain and its inversions.
    """
    return _six_bar("Stephenson", _STEPHENSON[inversion], inversion, places)


def _six_bar(chain: str, data: _SixBar, inversion: str, places: Mapping[str, Place] | None) -> Mechanism:
    said = f"Six-bar linkage of {chain}'s chain, inversion {inversion}."
    m = lay_out_joints(f"{chain} six-bar {inversion}", said, hardpoints(data.places, places), data.ground, data.bodies)
    m.angle("phi", at="A", to="B")
    return drive(m, [data.output], {"phi": (0.0, TURN)})
