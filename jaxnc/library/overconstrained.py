"""Mechanisms that move although the count of joints forbids it: Bennett, Bricard, parallel axes, hinges in line."""

import math

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import MechanismError
from jaxnc.library.drawing import TURN, Point, drive, meet, number, polar, positive, travel
from jaxnc.library.space import X, Y, Z, turned
from jaxnc.mechanism import Mechanism


@public
def bennett(length: float = 0.2, twist: float = 0.7, opposite_twist: float = 1.2, angle: float = 1.0) -> Mechanism:
    """Bennett's linkage: four revolute joints on skew axes, with one degree of freedom.

    Links A-B and C-D of one length and twist, B-C and the ground D-A of the others, lengths as the sines of the twists;
    every axis is across both of its links. n = 14, rows = 16, rank 13, g = 1 where Grübler's count is -2: three rows
    are redundant for these dimensions only. Coordinates ``phi``, the angle of A-B about vA from the direction D-A, and
    ``psi``, that of D-C about vD from the direction A-D: ``tan(φ/2) tan(ψ/2) = sin((β+α)/2) / sin((β-α)/2)``. Input
    ``phi``; the default drive is a full turn.

    Args:
        length: length of A-B and C-D.
        twist: angle α from the axis at A to that at B about A-B, radians, between 0 and π.
        opposite_twist: angle β of the links B-C and D-A, radians, between 0 and π, different from `twist`.
        angle: angle phi of the drawing, radians.

    Raises:
        MechanismError: for a length that is not positive, twists outside their range, equal or adding up to π.

    Source: G. T. Bennett, A new mechanism, Engineering 76 (1903).
    """
    what = "bennett"
    (length,) = positive(what, length=length)
    alpha, beta, angle = number(what, twist=twist, opposite_twist=opposite_twist, angle=angle)
    for name, value in (("twist", alpha), ("opposite_twist", beta)):
        if not 0.0 < value < math.pi:
            raise MechanismError(f"{what}: {name} = {value:g} must be between 0 and π")
    if abs(math.sin(0.5 * (beta - alpha))) < 1e-3 or abs(math.cos(0.5 * (alpha + beta))) < 1e-3:
        raise MechanismError(
            f"{what}: twist = {alpha:g} and opposite_twist = {beta:g} give links of equal lengths, which fold; make "
            f"them different, and not add up to π"
        )
    other = length * math.sin(beta) / math.sin(alpha)
    ratio = math.sin(0.5 * (beta + alpha)) / math.sin(0.5 * (beta - alpha))
    next_angle = 2.0 * math.atan2(ratio * math.cos(0.5 * angle), math.sin(0.5 * angle))
    along_ab = turned(-X, Z, angle)
    b = length * along_ab
    v_b = turned(Z, along_ab, alpha)
    along_bc = turned(along_ab, v_b, next_angle)
    m = Mechanism("Bennett linkage", dim=3, description="Four hinges on skew axes that move, against the count.")
    m.ground("A", (0.0, 0.0, 0.0))
    m.ground("D", (other, 0.0, 0.0))
    m.ground_vector("vA", Z)
    m.ground_vector("vD", turned(Z, X, beta))
    m.point("B", b)
    m.point("C", b + other * along_bc)
    m.vector("vB", v_b)
    m.vector("vC", turned(v_b, along_bc, beta))
    m.body("crank", ["A", "B"], vectors=["vA", "vB"])
    m.body("coupler", ["B", "C"], vectors=["vB", "vC"])
    m.body("rocker", ["C", "D"], vectors=["vC", "vD"])
    m.angle("phi", at="A", to="B", start=("D", "A"), about="vA")
    m.angle("psi", at="D", to="C", start=("A", "D"), about="vD")
    return drive(m, ["psi", "C"], {"phi": (0.0, TURN)})


@public
def bricard(length: float = 1.0) -> Mechanism:
    """Bricard's rectangular linkage: six revolute joints, neighbouring axes at right angles, six equal links.

    Drawn along the edges of a cube from P0 to P5; the link P5-P0 is the ground, and the axis v0, v1, … of every joint
    is across both of its links. n = 26, rows = 26, rank 25, g = 1 where Grübler's count is 0: one row is redundant for
    these dimensions only. Coordinates ``phi``, the angle at P0 from the direction P5-P0 to P0-P1 about v0, and
    ``psi``, that at P5 from P4-P5 to P5-P0 about v5, both π/2 in the drawing:
    ``cos φ + cos ψ + cos φ cos ψ = 0``. Input ``phi``; the default drive covers what lies between its dead points at
    ±2π/3, less a little.

    Args:
        length: length of every link.

    Raises:
        MechanismError: for a length that is not positive.

    Source: R. Bricard, Leçons de cinématique, vol. 2 (1927); Y. Chen, Z. You and T. Tarnai, Threefold-symmetric Bricard
    linkages for deployable structures, Int. J. Solids Struct. 42 (2005); the drawing is that of the IFToMM library of
    computational benchmark problems.
    """
    what = "bricard"
    (length,) = positive(what, length=length)
    edges = [X, -Y, Z, -X, Y, -Z]
    corners = [length * sum(edges[:k], start=np.zeros(3)) for k in range(6)]
    m = Mechanism("Bricard linkage", dim=3, description="Six hinges at right angles that move, against the count.")
    for k in (0, 5):
        m.ground(f"P{k}", corners[k])
        m.ground_vector(f"v{k}", np.cross(edges[k - 1], edges[k]))
    for k in range(1, 5):
        m.point(f"P{k}", corners[k])
        m.vector(f"v{k}", np.cross(edges[k - 1], edges[k]))
    for k in range(5):
        m.body(f"link{k + 1}", [f"P{k}", f"P{k + 1}"], vectors=[f"v{k}", f"v{k + 1}"])
    m.angle("phi", start=("P5", "P0"), to=("P0", "P1"), about="v0")
    m.angle("psi", start=("P4", "P5"), to=("P5", "P0"), about="v5")
    limit = TURN / 3.0
    return drive(m, ["psi", "P3"], {"phi": (-0.96 * limit, 0.96 * limit)})


@public
def four_bar_in_space(
    crank: float = 0.04, coupler: float = 0.12, rocker: float = 0.08, ground: float = 0.10, angle: float = 1.0
) -> Mechanism:
    """Planar four-bar with complete hinges in space: four parallel axes, three redundant constraints.

    Linkage A-B-C-D in the plane xy with A at the origin and D on the x axis; every joint is a revolute one with a
    vector of its own along z. n = 13, rows = 16, rank 12, g = 1 where Grübler's count is -2. Input ``phi``, the angle
    of the crank A-B about z from the x axis; the default drive covers a full turn where the crank has one, otherwise
    its range.

    Args:
        crank: length A-B.
        coupler: length B-C.
        rocker: length C-D.
        ground: length A-D.
        angle: crank angle of the drawing, radians.

    Raises:
        MechanismError: for a length that is not positive, or lengths that do not close.

    Source: source text, §4.2.2, (104)-(109); R. L. Norton, Design of Machinery (the default lengths, in metres).
    """
    what = "four_bar_in_space"
    crank, coupler, rocker, ground = positive(what, crank=crank, coupler=coupler, rocker=rocker, ground=ground)
    (angle,) = number(what, angle=angle)

    def draw(phi: float) -> tuple[Point, Point]:
        b = polar((0.0, 0.0), crank, phi)
        return b, meet(what, b, (ground, 0.0), 1.0, coupler=coupler, rocker=rocker)

    b, c = draw(angle)
    m = Mechanism("four-bar in space", dim=3, description="Four-bar with parallel axes and complete hinges in space.")
    m.ground("A", (0.0, 0.0, 0.0))
    m.ground("D", (ground, 0.0, 0.0))
    m.ground_vector("vA", Z)
    m.ground_vector("vD", Z)
    m.point("B", (*b, 0.0))
    m.point("C", (*c, 0.0))
    m.vector("vB", Z)
    m.vector("vC", Z)
    m.body("crank", ["A", "B"], vectors=["vA", "vB"])
    m.body("coupler", ["B", "C"], vectors=["vB", "vC"])
    m.body("rocker", ["C", "D"], vectors=["vC", "vD"])
    m.angle("phi", at="A", to="B", start=("A", "D"), about="vA")
    return drive(m, ["C"], {"phi": travel(draw, angle)})


@public
def double_hinged_door(
    width: float = 0.9, height: float = 2.0, lower: float = 0.25, upper: float = 1.75, offset: float = 0.05
) -> Mechanism:
    """A door on two complete hinges in line: ten constraints on six freedoms, and it swings.

    The frame has the hinge points F1 and F2 and their axes v1 and v2, the door its own points D1 and D2 at the same
    places, its own axes w1 and w2, and the handle H. n = 16, rows = 22, rank 15, g = 1 where Grübler's count is -4:
    five constraints are redundant as long as the hinges are in line, and two more rows are those by which three
    equations of parallel vectors exceed two. Input ``phi``, the rotation of the door about F1-F2 from the drawing; the
    default drive opens it by 180°.

    Args:
        width: from the hinges' axis to the handle, a length.
        height: height of the door, a length.
        lower: height of the lower hinge above the floor, a length.
        upper: height of the upper hinge above the floor, a length.
        offset: distance of the door's leaf from the hinges' axis, a length.

    Raises:
        MechanismError: for a length that is not positive, or hinges that are not one above the other within the height.

    Source: source text, §4.2.2, on revolute joints that share nothing.
    """
    what = "double_hinged_door"
    width, height, lower, upper = positive(what, width=width, height=height, lower=lower, upper=upper)
    (offset,) = number(what, offset=offset)
    if not lower < upper < height:
        raise MechanismError(f"{what}: lower = {lower:g}, upper = {upper:g} and height = {height:g} must ascend")
    m = Mechanism("double-hinged door", dim=3, description="A door on two hinges: overconstrained, and it swings.")
    for k, level in ((1, lower), (2, upper)):
        m.ground(f"F{k}", (0.0, 0.0, level))
        m.ground_vector(f"v{k}", Z)
        m.point(f"D{k}", (0.0, 0.0, level))
        m.vector(f"w{k}", Z)
    m.point("H", (width, offset, 0.5 * height))
    m.body("door", ["D1", "D2", "H"], vectors=["w1", "w2"])
    for k, name in ((1, "lower hinge"), (2, "upper hinge")):
        m.revolute(name, f"F{k}", f"D{k}", axes=(f"v{k}", f"w{k}"))
    m.angle("phi", at="D1", to="H", about="v1")
    return drive(m, ["H"], {"phi": (0.0, math.pi)})
