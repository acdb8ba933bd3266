"""Loops in space: RSCR, RSSR, RSSP and RCCC, axes through one point, linkages that the count forbids, one body."""

import math
from collections.abc import Mapping
from typing import Literal

import numpy as np

from jaxnc.library.drawing import (
    FLAT,
    TURN,
    Length,
    Misfit,
    Vector,
    X,
    Y,
    Z,
    check_apart,
    check_off_axis,
    check_skew,
    check_swing,
    crank_travel,
    drive,
    hardpoints,
    lay_out,
    offer,
    reach,
    revolve_point,
    rotate,
    turn_crank,
    unit_vector,
)
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism.model import Place

_CRANK = {"A": (0.0, 0.0, 0.0), "vA": (0.0, 0.0, 1.0)}
_RSCR = {
    **_CRANK,
    "1": (0.10, 0.0, 0.03),
    "2": (0.31, 0.11, 0.30),
    "v1": (0.36, 0.48, 0.80),
    "3": (0.31 + 0.11 * 0.36, 0.11 + 0.11 * 0.48, 0.30 + 0.11 * 0.80),
    "B": (0.32, 0.09, 0.13),
    "vB": (0.6, 0.0, 0.8),
}
_RSSR = {**_CRANK, "1": (0.10, 0.0, 0.0), "2": (0.30, 0.30, 0.15), "B": (0.40, 0.05, 0.10), "vB": (0.6, 0.0, 0.8)}
_RSSP = {**_CRANK, "1": (0.08, 0.0, 0.0), "2": (0.35, 0.06, 0.10), "v2": (0.8, 0.0, 0.6)}
_RCCC = {
    **_CRANK,
    "B": (0.0, -0.08, 0.02),
    "vB": (0.5, 0.0, 0.75**0.5),
    "C": (0.20, 0.10, 0.15),
    "vC": (0.36, 0.80, 0.48),
    "D": (0.30, -0.05, 0.05),
    "vD": (0.96, -0.20, 0.20),
}
_BODY = {  # a housing
    "P1": (0.0, 0.0, 0.0),
    "P2": (0.0, 0.0, 0.30),
    "P3": (0.20, 0.02, 0.05),
    "P4": (0.22, 0.12, 0.25),
    "P5": (-0.05, 0.18, 0.10),
    "P6": (0.10, 0.20, 0.32),
    "P7": (0.12, -0.06, 0.18),
    "v1": (1.0, 0.2, 0.1),
    "v2": (0.0, 1.0, 0.4),
    "v3": (0.3, -0.5, 0.8),
}


@offer
def rscr(places: Mapping[str, Place] | None = None, crank_angle: bool = False) -> Mechanism:
    """RSCR mechanism of the source text: crank, ball joint, coupler, cylindrical joint, rocker.

    Crank A-1 on the axis vA, coupler 1-2 with the vector v1 of the cylindrical joint, rocker B-3 on the axis vB, which
    shares v1 and slides along it. n = 12, rows = 12, rank 11, g = 1 as in (76)-(87): of the three rows of the
    alignment (81)-(83) two are independent. The text has no crank angle: the default drive moves the coordinate of
    point 1 that changes fastest in the drawing, on half of the crank circle. With `crank_angle` the coordinate ``phi``
    is added, the rotation of the crank about vA from the drawing: n = 13, rows = 13, rank 12, g = 1, and the default
    drive covers a full turn where the crank has one, otherwise its range.

    Args:
        places: hardpoints other than the default ones: points A, 1, 2, 3 and B (lengths; 2 and 3 on a line along v1)
            and directions vA, v1 and vB.
        crank_angle: add the crank angle as a coordinate.

    Raises:
        MechanismError: for an unknown name, a place that is not three numbers, a zero direction, a pin on the axis it
            turns about, a drawing at a dead point.

    Source: source text, fig. 23 and 24, (76)-(87), with its names; erratum 2 on (81)-(83).
    """
    p = hardpoints(_RSCR, places)
    check_off_axis(p, "1", "A", "vA")
    check_apart(p, ("1", "2"), ("B", "3"))
    check_skew("v1", p["v1"], "vB", p["vB"])
    m = lay_out(
        "RSCR",
        "Crank and rocker joined by a ball joint and a cylindrical joint.",
        {name: p[name] for name in ("A", "B", "vA", "vB")},
        {name: p[name] for name in ("1", "2", "3", "v1")},
        {"crank": "A 1 vA", "coupler": "1 2 v1", "rocker": "B 3 v1 vB"},
    )
    m.cylindrical("C", line=("2", "v1"), on="3")
    turns = _rscr_reach(p)
    if turns[1] - turns[0] < 0.02:
        raise Misfit("it is drawn at a dead point of the crank A-1; move its places")
    if crank_angle:
        m.angle("phi", at="A", to="1", about="vA")
        return drive(m, ["2", "3"], {"phi": turns})
    # The coordinate that changes fastest, between its own dead points as far as the crank goes.
    arm = p["1"] - p["A"]
    rate = np.cross(p["vA"], arm)
    axis = int(np.argmax(np.abs(rate)))
    level = (arm @ p["vA"]) * p["vA"]
    peak = math.atan2(rate[axis], (arm - level)[axis])  # where the coordinate is largest
    start, end = sorted((peak, peak - math.copysign(math.pi, peak)))
    cut = math.acos(0.95)
    low, high = start + cut, end - cut
    if turns[1] - turns[0] < TURN:
        low, high = max(low, turns[0]), min(high, turns[1])
    first, last = (float(revolve_point(p["A"], p["vA"], p["1"], angle)[axis]) for angle in (low, high))
    return drive(m, ["2", "3"], {f"1.{'xyz'[axis]}": (first, last)})


def _rscr_reach(p: Mapping[str, Vector]) -> tuple[float, float]:
    """Find how far the crank of an RSCR turns: point 1 keeps its distance e from the moving axis (3, v1)."""
    along = p["2"] - p["1"]
    square = float(along @ along - (along @ p["v1"]) ** 2)
    if square <= 0:
        return 0.0, TURN  # a coupler along its own axis: a singular design, which the analysis reports

    arm, axis, v_b = p["3"] - p["B"], p["v1"], p["vB"]

    def follow(phi: float, psi: float) -> float | None:
        # In the rocker's frame the axis rests and point 1 turns back: its moment about it is a + b cos ψ + c sin ψ.
        pin = revolve_point(p["A"], p["vA"], p["1"], phi) - p["B"]
        along = (pin @ v_b) * v_b
        a, b, c = np.cross((along - arm, pin - along, np.cross(pin, v_b)), axis)
        aa, bb, cc, ab, ac, bc = (float(x @ y) for x, y in ((a, a), (b, b), (c, c), (a, b), (a, c), (b, c)))
        for _ in range(20):
            x, y = math.cos(psi), math.sin(psi)
            value = aa + bb * x * x + cc * y * y + 2.0 * (ab * x + ac * y + bc * x * y)
            slope = 2.0 * ((cc - bb) * x * y - ab * y + ac * x + bc * (x * x - y * y))
            rate = bb * y * y + cc * x * x - 2.0 * bc * x * y  # of the moment, squared
            if abs(slope) <= 2.0 * FLAT * math.sqrt(value * rate):
                return None
            step = (square - value) / slope
            if abs(step) > 0.2:
                return None
            psi += step
            if abs(step) < 1e-9:
                return psi
        return None

    return reach(follow)


@offer
def rssr(places: Mapping[str, Place] | None = None) -> Mechanism:
    """RSSR linkage, the spatial four-bar: crank, bar with a ball joint at either end, rocker.

    Crank A-1 on the axis vA, bar 1-2, rocker B-2 on the axis vB. n = 8, rows = 7, rank 7, g = 1; the rotation of the
    bar about its own line is no coordinate. Coordinates ``phi``, the rotation of the crank about vA from the drawing,
    and ``psi``, that of the rocker about vB. The default drive of ``phi`` covers a full turn where the crank has one,
    otherwise its range.

    Args:
        places: hardpoints other than the default ones: points A, 1, 2 and B (lengths), directions vA and vB.

    Raises:
        MechanismError: for an unknown name, a place that is not three numbers, a zero direction, a pin on the axis it
            turns about, a drawing at a dead point.

    Source: R. S. Hartenberg and J. Denavit, Kinematic Synthesis of Linkages (1964); source text, (77), (89).
    """
    p = hardpoints(_RSSR, places)
    check_off_axis(p, "1", "A", "vA")
    check_off_axis(p, "2", "B", "vB")
    check_apart(p, ("1", "2"))
    closes = check_swing(p["B"], p["vB"], p["2"], math.dist(p["1"], p["2"]), "the bar 1-2")
    closes(p["1"])
    m = lay_out(
        "RSSR",
        "Crank and rocker on skew axes, joined by a bar with two ball joints.",
        {name: p[name] for name in ("A", "B", "vA", "vB")},
        {name: p[name] for name in ("1", "2")},
        {"crank": "A 1 vA", "bar": "1 2", "rocker": "B 2 vB"},
    )
    m.angle("phi", at="A", to="1", about="vA")
    m.angle("psi", at="B", to="2", about="vB")
    turns = crank_travel(lambda phi: closes(revolve_point(p["A"], p["vA"], p["1"], phi)))
    return drive(m, ["psi", "2"], {"phi": turns})


@offer
def rssp(places: Mapping[str, Place] | None = None) -> Mechanism:
    """RSSP mechanism, the spatial slider-crank: crank, rod with a ball joint at either end, slider.

    Crank A-1 on the axis vA, rod 1-2, point 2 on the line through its drawn place C along v2. n = 8, rows = 8,
    rank 7, g = 1: of the three rows of the guide two are independent. Coordinates ``phi``, the rotation of the crank
    about vA from the drawing, and ``s``, the way of point 2 along v2. The default drive of ``phi`` covers a full turn
    where the crank has one, otherwise its range.

    Args:
        places: hardpoints other than the default ones: points A, 1 and 2 (lengths), directions vA and v2.

    Raises:
        MechanismError: for an unknown name, a place that is not three numbers, a zero direction, a pin on the axis it
            turns about, a drawing at a dead point.

    Source: R. S. Hartenberg and J. Denavit, Kinematic Synthesis of Linkages (1964); source text, (89), (128)-(130),
    (147)-(149).
    """
    p = hardpoints(_RSSP, places)
    check_off_axis(p, "1", "A", "vA")
    check_apart(p, ("1", "2"))
    rod = math.dist(p["1"], p["2"])

    def closes(phi: float) -> None:
        gap = revolve_point(p["A"], p["vA"], p["1"], phi) - p["2"]
        off = np.linalg.norm(np.cross(gap, p["v2"]))
        if off >= rod * math.sqrt(1.0 - FLAT**2):
            raise Misfit("the rod 1-2 is across the guide, or too short to reach it; move its places")

    closes(0.0)
    m = lay_out(
        "RSSP",
        "Crank that drives a slider in space by a rod with two ball joints.",
        {"A": p["A"], "C": p["2"], "vA": p["vA"], "v2": p["v2"]},
        {"1": p["1"], "2": p["2"]},
        {"crank": "A 1 vA", "rod": "1 2"},
    )
    m.slot("guide", "2", ("C", "v2"))
    m.angle("phi", at="A", to="1", about="vA")
    m.distance("s", "C", "2", along="v2")
    return drive(m, ["s", "2"], {"phi": crank_travel(closes)})


@offer
def rccc(places: Mapping[str, Place] | None = None) -> Mechanism:
    """RCCC linkage: a crank and three cylindrical joints, which turn like a spherical four-bar and slide besides.

    Crank 1 on the axis (A, vA), coupler 2 on the axis (B, vB) of the crank, follower 3 on the axis (C, vC) of the
    coupler and on the axis (D, vD) of the ground. Each link has points of its own on its axes: B1 in the crank, B2 and
    C2 in the coupler, C3 and D3 in the follower. n = 24, rows = 26, rank 23, g = 1: of the three rows of each of the
    three alignments two are independent. Coordinates ``phi``, the rotation of the crank about vA from the drawing,
    ``psi``, that of the follower about vD, and ``s``, its way along vD. The default drive of ``phi`` covers a full
    turn where the crank has one, otherwise its range.

    Args:
        places: hardpoints other than the default ones: points A, B, C and D (lengths), each on its axis, and the
            axes vA, vB, vC and vD.

    Raises:
        MechanismError: for an unknown name, a place that is not three numbers, a zero direction, parallel neighbouring
            axes, a drawing at a dead point.

    Source: A. T. Yang and F. Freudenstein, Application of dual-number quaternion algebra to the analysis of spatial
    mechanisms, J. Appl. Mech. 31 (1964); source text, (128)-(130).
    """
    p = hardpoints(_RCCC, places)
    for a, b in ("AB", "BC", "CD", "DA"):
        check_skew(f"v{a}", p[f"v{a}"], f"v{b}", p[f"v{b}"])
        check_apart(p, (a, b))
    # Directions turn like a spherical four-bar: the chord from vB to vC keeps its length.
    chord, names = math.dist(p["vB"], p["vC"]), "the spherical four-bar of its axes"
    closes = check_swing(np.zeros(3), p["vD"], p["vC"], chord, names)
    closes(p["vB"])
    m = lay_out(
        "RCCC",
        "Crank and three cylindrical joints, turning like a spherical four-bar.",
        {name: p[name] for name in ("A", "vA", "D", "vD")},
        {name: p[name[0]] for name in ("B1", "B2", "C2", "C3", "D3")} | {name: p[name] for name in ("vB", "vC")},
        {"crank": "A B1 vA vB", "coupler": "B2 C2 vB vC", "follower": "C3 D3 vC vD"},
    )
    m.cylindrical("B", line=("B1", "vB"), on="B2")
    m.cylindrical("C", line=("C2", "vC"), on="C3")
    m.cylindrical("D", line=("D", "vD"), on="D3")
    m.angle("phi", to="vB", about="vA")
    m.angle("psi", to="vC", about="vD")
    m.distance("s", "D", "D3", along="vD")
    turns = crank_travel(lambda phi: closes(rotate(p["vB"], p["vA"], phi)))
    return drive(m, ["psi", "s", "C3"], {"phi": turns})


@offer
def spherical_four_bar(
    crank: Length = 0.5,
    coupler: Length = 1.2,
    rocker: Length = 1.0,
    ground: Length = 1.3,
    branch: Literal["open", "crossed"] = "open",
    angle: float = 1.0,
    radius: Length = 0.1,
) -> Mechanism:
    """Spherical four-bar: four revolute joints whose axes meet at the point O.

    Axes vA and vD on the ground, vB and vC between crank, coupler and rocker. n = 8, rows = 7, rank 7, g = 1.
    Coordinates ``phi``, the angle of the crank about vA from the direction of vD to that of vB, and ``psi``, that of
    the rocker about vD from the drawing. Markers B and C on crank and rocker show the axes on a sphere. The default
    drive of ``phi`` covers a full turn where the crank has one, otherwise its range.

    Args:
        crank: angle between vA and vB, radians, between 0 and π.
        coupler: angle between vB and vC, radians.
        rocker: angle between vC and vD, radians.
        ground: angle between vD and vA, radians.
        branch: ``"open"`` draws vC to the left of the way from vB to vD as seen from outside, ``"crossed"`` to the
            right.
        angle: crank angle of the drawing, radians.
        radius: of the sphere on which the markers are, a length.

    Raises:
        MechanismError: for an angle outside its range, an unknown branch, or links that do not close.

    Source: C. H. Chiang, Kinematics of Spherical Mechanisms; source text, §4.1 (vectors) and §4.2.2.
    """
    for name, value in (("crank", crank), ("coupler", coupler), ("rocker", rocker), ("ground", ground)):
        if value >= math.pi:
            raise Misfit(f"{name} = {value:g} must be between 0 and π")
    v_d, side = rotate(Z, Y, ground), 1.0 if branch == "open" else -1.0

    def draw(phi: float) -> tuple[Vector, Vector]:
        v_b = rotate(rotate(Z, Y, crank), Z, phi)
        cosine, p, q = float(v_b @ v_d), math.cos(coupler), math.cos(rocker)
        area = 1.0 - cosine**2
        a, b = (p - q * cosine, q - p * cosine) if area > 0 else (math.inf, math.inf)
        square = area - p * p - q * q + 2.0 * p * q * cosine
        if square <= 0 or math.sqrt(square) <= FLAT * math.sin(coupler) * math.sin(rocker):
            raise Misfit(
                f"coupler = {coupler:g} and rocker = {rocker:g} do not close over {math.acos(cosine):g}; "
                f"change one of them, or start from another angle"
            )
        return v_b, (a * v_b + b * v_d + side * math.sqrt(square) * np.cross(v_b, v_d)) / area

    v_b, v_c = draw(angle)
    m = lay_out(
        "spherical four-bar",
        "Four hinges whose axes meet at one point.",
        {"O": (0.0, 0.0, 0.0), "vA": Z, "vD": v_d},
        {"vB": v_b, "vC": v_c},
        {"crank": "O vA vB", "coupler": "O vB vC", "rocker": "O vC vD"},
    )
    m.marker("B", on="crank", at=radius * v_b)
    m.marker("C", on="rocker", at=radius * v_c)
    m.angle("phi", start="vD", to="vB", about="vA")
    m.angle("psi", to="vC", about="vD")
    return drive(m, ["psi", "C"], {"phi": crank_travel(draw, angle)})


@offer
def wobble_plate(
    radius: Length = 0.04, tilt: float = 0.35, rod: Length = 0.08, guide: Length = 0.05, pistons: int = 5
) -> Mechanism:
    """Wobble plate: a shaft with an inclined journal makes a plate nutate, which moves pistons along the shaft.

    The shaft turns about vk, the z axis, and carries the journal vn, inclined by the tilt, on which the plate turns
    freely; the ball G of the plate slides in a groove in the plane xz, which keeps the plate from turning along. Rods
    with ball joints lead from the places P1, P2, … of the plate to the pistons Q1, Q2, …, which move along z. With five
    pistons n = 26, rows = 25, rank 25, g = 1; every piston more or less is four of each. Coordinate and input ``phi``,
    the rotation of the shaft from the drawing; the default drive is a full turn. Dimensions are of no machine in
    particular.

    Args:
        radius: of the circle of the rods' joints on the plate and of the pistons, a length.
        tilt: angle of the journal to the shaft, radians, between 0 and π/2.
        rod: length of the rods.
        guide: distance of the ball G from the centre O, a length.
        pistons: how many pistons.

    Raises:
        MechanismError: for a length that is not positive, a tilt outside its range, a rod that is too short, no piston.
    """
    if not 0.0 < tilt < 0.5 * math.pi:
        raise Misfit(f"tilt = {tilt:g} must be between 0 and π/2")
    if not isinstance(pistons, int) or pistons < 1:
        raise Misfit(f"pistons must be a whole number of at least 1, got {pistons!r}")
    if rod <= 1.2 * radius * (1.0 - math.cos(tilt)):
        raise Misfit(f"rod = {rod:g} is too short for radius = {radius:g} and tilt = {tilt:g}")
    level = math.cos(tilt) * X - math.sin(tilt) * Z
    moving = {"vn": math.sin(tilt) * X + math.cos(tilt) * Z, "G": guide * level}
    for k in range(pistons):
        around = (k + 0.5) * TURN / pistons
        on_plate = radius * (math.cos(around) * level + math.sin(around) * Y)
        piston = radius * (math.cos(around) * X + math.sin(around) * Y)
        piston[2] = on_plate[2] - math.sqrt(rod**2 - math.dist(on_plate[:2], piston[:2]) ** 2)
        moving |= {f"P{k + 1}": on_plate, f"Q{k + 1}": piston}
    rods = range(1, pistons + 1)
    m = lay_out(
        "wobble plate",
        "An inclined journal makes a plate nutate and pistons move.",
        {"O": (0.0, 0.0, 0.0), "vk": Z},
        moving,
        {"shaft": "O vk vn", "plate": " ".join(["O G vn", *(f"P{k}" for k in rods)])}
        | {f"rod{k}": f"P{k} Q{k}" for k in rods},
        {"G": "y", **{f"Q{k}": "xy" for k in rods}},
    )
    m.angle("phi", to="vn", about="vk")
    return drive(m, ["Q1.z", "P1"], {"phi": (0.0, TURN)})


@offer
def bennett(length: Length = 0.2, twist: float = 0.7, opposite_twist: float = 1.2, angle: float = 1.0) -> Mechanism:
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
    for name, value in (("twist", twist), ("opposite_twist", opposite_twist)):
        if not 0.0 < value < math.pi:
            raise Misfit(f"{name} = {value:g} must be between 0 and π")
    total, difference = 0.5 * (opposite_twist + twist), 0.5 * (opposite_twist - twist)
    if abs(math.sin(difference)) < 1e-3 or abs(math.cos(total)) < 1e-3:
        raise Misfit(
            f"twist = {twist:g} and opposite_twist = {opposite_twist:g} give links of equal lengths, which fold; make "
            f"them different, and not add up to π"
        )
    other = length * math.sin(opposite_twist) / math.sin(twist)
    ratio = math.sin(total) / math.sin(difference)
    next_angle = 2.0 * math.atan2(ratio * math.cos(0.5 * angle), math.sin(0.5 * angle))
    along_ab = rotate(-X, Z, angle)
    b = length * along_ab
    v_b = rotate(Z, along_ab, twist)
    along_bc = rotate(along_ab, v_b, next_angle)
    m = lay_out(
        "Bennett linkage",
        "Four hinges on skew axes that move, against the count.",
        {"A": (0.0, 0.0, 0.0), "D": (other, 0.0, 0.0), "vA": Z, "vD": rotate(Z, X, opposite_twist)},
        {"B": b, "C": b + other * along_bc, "vB": v_b, "vC": rotate(v_b, along_bc, opposite_twist)},
        _FOUR_BAR,
    )
    m.angle("phi", at="A", to="B", start=("D", "A"), about="vA")
    m.angle("psi", at="D", to="C", start=("A", "D"), about="vD")
    return drive(m, ["psi", "C"], {"phi": (0.0, TURN)})


@offer
def bricard(length: Length = 1.0) -> Mechanism:
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
    edges = [X, -Y, Z, -X, Y, -Z]
    corners = [length * sum(edges[:k], start=np.zeros(3)) for k in range(6)]
    places = {f"P{k}": corners[k] for k in range(6)}
    places |= {f"v{k}": np.cross(edges[k - 1], edges[k]) for k in range(6)}
    ground = {name: at for name, at in places.items() if name[1] in "05"}
    m = lay_out(
        "Bricard linkage",
        "Six hinges at right angles that move, against the count.",
        ground,
        {name: at for name, at in places.items() if name not in ground},
        {f"link{k + 1}": f"P{k} P{k + 1} v{k} v{k + 1}" for k in range(5)},
    )
    m.angle("phi", start=("P5", "P0"), to=("P0", "P1"), about="v0")
    m.angle("psi", start=("P4", "P5"), to=("P5", "P0"), about="v5")
    limit = TURN / 3.0
    return drive(m, ["psi", "P3"], {"phi": (-0.96 * limit, 0.96 * limit)})


@offer
def four_bar_in_space(
    crank: Length = 0.04, coupler: Length = 0.12, rocker: Length = 0.08, ground: Length = 0.10, angle: float = 1.0
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
    draw = turn_crank((0.0, 0.0), crank, (ground, 0.0), 1.0, coupler=coupler, rocker=rocker)
    b, c = draw(angle)
    m = lay_out(
        "four-bar in space",
        "Four-bar with parallel axes and complete hinges in space.",
        {"A": (0.0, 0.0, 0.0), "D": (ground, 0.0, 0.0), "vA": Z, "vD": Z},
        {"B": (*b, 0.0), "C": (*c, 0.0), "vB": Z, "vC": Z},
        _FOUR_BAR,
    )
    m.angle("phi", at="A", to="B", start=("A", "D"), about="vA")
    return drive(m, ["C"], {"phi": crank_travel(draw, angle)})


_FOUR_BAR = {"crank": "A B vA vB", "coupler": "B C vB vC", "rocker": "C D vC vD"}


@offer
def double_hinged_door(
    width: Length = 0.9, height: Length = 2.0, lower: Length = 0.25, upper: Length = 1.75, offset: float = 0.05
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
    if not lower < upper < height:
        raise Misfit(f"lower = {lower:g}, upper = {upper:g} and height = {height:g} must ascend")
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


@offer
def general_body(
    places: Mapping[str, Place] | None = None, form: Literal["exact", "text"] = "exact", hinged: bool = True
) -> Mechanism:
    """A rigid body of seven points and three vectors, on a hinge or free.

    On the hinge through its points P1 and P2: n = 25, rows = 24, rank 24, g = 1; input ``phi``, its rotation about
    P1-P2 from the drawing, and a full turn as the default drive. Free: n = 30, rows = 24, rank 24, g = 6; the default
    drive moves six single coordinates of P1, P2 and P3.

    Args:
        places: hardpoints other than the default ones: points P1 to P7 (lengths) and directions v1 to v3.
        form: ``"exact"``: a base of two segments and the direction across them; ``"text"``: a base of three segments,
            (116)-(127).
        hinged: hold P1 and P2.

    Raises:
        MechanismError: for an unknown name or form, a place that is not three numbers, a zero direction, P3 on the line
            P1-P2.

    Source: source text, §4.1.5, (116)-(127) with erratum 4.
    """
    p = hardpoints(_BODY, places)
    check_apart(p, ("P1", "P2"))
    axis = unit_vector(p["P2"] - p["P1"])
    check_off_axis({**p, "P1-P2": axis}, "P3", "P1", "P1-P2")
    if not isinstance(hinged, bool):
        raise Misfit(f"hinged must be True or False, got {hinged!r}")
    ground = {name: p[name] for name in ("P1", "P2")} if hinged else {}
    moving = {name: at for name, at in p.items() if name not in ground}
    said = "A rigid body of seven points and three vectors."
    m = lay_out("general body", said, ground, moving, {})
    m.body("body", [n for n in p if n.startswith("P")], vectors=["v1", "v2", "v3"], form=form)
    if hinged:
        m.angle("phi", at="P1", to="P3", about=("P1", "P2"))
        return drive(m, ["P4", "P6"], {"phi": (0.0, TURN)})
    # P1 moves straight; the two coordinates of P2 that change least along P1-P2, and one of P3, turn the body.
    size = 0.3 * float(max(abs(p["P2"] - p["P1"])))
    first, second, along = sorted(range(3), key=lambda i: abs(axis[i]))
    swing = [abs(x) for x in np.cross(axis, p["P3"] - p["P1"])]
    last = max((first, second, along), key=lambda i: swing[i])
    moves = [*(("P1", i, 1.0) for i in range(3)), ("P2", first, 1.5), ("P2", second, 1.5), ("P3", last, 1.2)]
    inputs = {f"{n}.{'xyz'[i]}": (float(p[n][i]), float(p[n][i]) + far * size) for n, i, far in moves}
    return drive(m, ["P4", "P6"], inputs)
