"""Spatial linkages of one loop: RSCR, RSSR, RSSP and RCCC, drawn by their hardpoints."""

import math
from collections.abc import Mapping

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import MechanismError
from jaxnc.library.drawing import FLAT, TURN, drive, travel
from jaxnc.library.space import Vector, apart, hardpoints, off_axis, reach, revolved, skew, swinging, turned
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism.model import Place

_RSCR = {
    "A": (0.0, 0.0, 0.0),
    "vA": (0.0, 0.0, 1.0),
    "1": (0.10, 0.0, 0.03),
    "2": (0.31, 0.11, 0.30),
    "v1": (0.36, 0.48, 0.80),
    "3": (0.31 + 0.11 * 0.36, 0.11 + 0.11 * 0.48, 0.30 + 0.11 * 0.80),
    "B": (0.32, 0.09, 0.13),
    "vB": (0.6, 0.0, 0.8),
}
_RSSR = {
    "A": (0.0, 0.0, 0.0),
    "vA": (0.0, 0.0, 1.0),
    "1": (0.10, 0.0, 0.0),
    "2": (0.30, 0.30, 0.15),
    "B": (0.40, 0.05, 0.10),
    "vB": (0.6, 0.0, 0.8),
}
_RSSP = {
    "A": (0.0, 0.0, 0.0),
    "vA": (0.0, 0.0, 1.0),
    "1": (0.08, 0.0, 0.0),
    "2": (0.35, 0.06, 0.10),
    "v2": (0.8, 0.0, 0.6),
}
_RCCC = {
    "A": (0.0, 0.0, 0.0),
    "vA": (0.0, 0.0, 1.0),
    "B": (0.0, -0.08, 0.02),
    "vB": (0.5, 0.0, 0.75**0.5),
    "C": (0.20, 0.10, 0.15),
    "vC": (0.36, 0.80, 0.48),
    "D": (0.30, -0.05, 0.05),
    "vD": (0.96, -0.20, 0.20),
}


@public
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
    what = "rscr"
    p = hardpoints(what, _RSCR, places)
    off_axis(what, p, "1", "A", "vA")
    apart(what, p, ("1", "2"), ("B", "3"))
    skew(what, "v1", p["v1"], "vB", p["vB"])
    m = Mechanism("RSCR", dim=3, description="Crank and rocker joined by a ball joint and a cylindrical joint.")
    m.ground("A", p["A"])
    m.ground("B", p["B"])
    m.ground_vector("vA", p["vA"])
    m.ground_vector("vB", p["vB"])
    for name in ("1", "2", "3"):
        m.point(name, p[name])
    m.vector("v1", p["v1"])
    m.body("crank", ["A", "1"], vectors=["vA"])
    m.body("coupler", ["1", "2"], vectors=["v1"])
    m.body("rocker", ["B", "3"], vectors=["v1", "vB"])
    m.cylindrical("C", line=("2", "v1"), on="3")
    turns = _rscr_reach(p)
    if turns[1] - turns[0] < 0.02:
        raise MechanismError(f"{what}: it is drawn at a dead point of the crank A-1; move its places")
    if crank_angle:
        m.angle("phi", at="A", to="1", about="vA")
        return drive(m, ["2", "3"], {"phi": turns})
    axis = int(np.argmax(np.abs(np.cross(p["vA"], p["1"] - p["A"]))))
    return drive(m, ["2", "3"], {f"1.{'xyz'[axis]}": _half_circle(p, axis, turns)})


def _half_circle(p: Mapping[str, Vector], axis: int, turns: tuple[float, float]) -> tuple[float, float]:
    """First and last value of one coordinate of the crank pin between its own dead points, as far as the crank goes."""
    arm = p["1"] - p["A"]
    level = (arm @ p["vA"]) * p["vA"]
    peak = math.atan2(np.cross(p["vA"], arm)[axis], (arm - level)[axis])  # where the coordinate is largest
    start, end = sorted((peak, peak - math.copysign(math.pi, peak)))
    cut = math.acos(0.95)
    low, high = start + cut, end - cut
    if turns[1] - turns[0] < TURN:
        low, high = max(low, turns[0]), min(high, turns[1])
    first, last = (float(revolved(p["A"], p["vA"], p["1"], angle)[axis]) for angle in (low, high))
    return first, last


def _rscr_reach(p: Mapping[str, Vector]) -> tuple[float, float]:
    """How far the crank of an RSCR turns: point 1 keeps its distance e from the moving axis (3, v1)."""
    along = p["2"] - p["1"]
    square = float(along @ along - (along @ p["v1"]) ** 2)
    if square <= 0:
        return 0.0, TURN  # a coupler along its own axis: a singular design, which the analysis reports

    arm, axis, v_b = p["3"] - p["B"], p["v1"], p["vB"]

    def follow(phi: float, psi: float) -> float | None:
        # In the rocker's frame the axis rests and point 1 turns back: its moment about it is a + b cos ψ + c sin ψ.
        pin = revolved(p["A"], p["vA"], p["1"], phi) - p["B"]
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


@public
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
    what = "rssr"
    p = hardpoints(what, _RSSR, places)
    off_axis(what, p, "1", "A", "vA")
    off_axis(what, p, "2", "B", "vB")
    apart(what, p, ("1", "2"))
    closes = swinging(what, p["B"], p["vB"], p["2"], math.dist(p["1"], p["2"]), "the bar 1-2")
    closes(p["1"])
    m = Mechanism("RSSR", dim=3, description="Crank and rocker on skew axes, joined by a bar with two ball joints.")
    m.ground("A", p["A"])
    m.ground("B", p["B"])
    m.ground_vector("vA", p["vA"])
    m.ground_vector("vB", p["vB"])
    m.point("1", p["1"])
    m.point("2", p["2"])
    m.body("crank", ["A", "1"], vectors=["vA"])
    m.body("bar", ["1", "2"])
    m.body("rocker", ["B", "2"], vectors=["vB"])
    m.angle("phi", at="A", to="1", about="vA")
    m.angle("psi", at="B", to="2", about="vB")
    turns = travel(lambda phi: closes(revolved(p["A"], p["vA"], p["1"], phi)), 0.0)
    return drive(m, ["psi", "2"], {"phi": turns})


@public
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
    what = "rssp"
    p = hardpoints(what, _RSSP, places)
    off_axis(what, p, "1", "A", "vA")
    apart(what, p, ("1", "2"))
    rod = math.dist(p["1"], p["2"])

    def closes(phi: float) -> None:
        gap = revolved(p["A"], p["vA"], p["1"], phi) - p["2"]
        off = np.linalg.norm(np.cross(gap, p["v2"]))
        if off >= rod * math.sqrt(1.0 - FLAT**2):
            raise MechanismError(f"{what}: the rod 1-2 is across the guide, or too short to reach it; move its places")

    closes(0.0)
    m = Mechanism("RSSP", dim=3, description="Crank that drives a slider in space by a rod with two ball joints.")
    m.ground("A", p["A"])
    m.ground("C", p["2"])
    m.ground_vector("vA", p["vA"])
    m.ground_vector("v2", p["v2"])
    m.point("1", p["1"])
    m.point("2", p["2"])
    m.body("crank", ["A", "1"], vectors=["vA"])
    m.body("rod", ["1", "2"])
    m.slot("guide", "2", ("C", "v2"))
    m.angle("phi", at="A", to="1", about="vA")
    m.distance("s", "C", "2", along="v2")
    return drive(m, ["s", "2"], {"phi": travel(closes, 0.0)})


@public
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
    what = "rccc"
    p = hardpoints(what, _RCCC, places)
    for a, b in ("AB", "BC", "CD", "DA"):
        skew(what, f"v{a}", p[f"v{a}"], f"v{b}", p[f"v{b}"])
        apart(what, p, (a, b))
    # Directions turn like a spherical four-bar: the chord from vB to vC keeps its length.
    o = np.zeros(3)
    closes = swinging(what, o, p["vD"], p["vC"], math.dist(p["vB"], p["vC"]), "the spherical four-bar of its axes")
    closes(p["vB"])
    m = Mechanism("RCCC", dim=3, description="Crank and three cylindrical joints, turning like a spherical four-bar.")
    for name in ("A", "D"):
        m.ground(name, p[name])
        m.ground_vector(f"v{name}", p[f"v{name}"])
    for name in ("B1", "B2", "C2", "C3", "D3"):
        m.point(name, p[name[0]])
    for name in ("vB", "vC"):
        m.vector(name, p[name])
    m.body("crank", ["A", "B1"], vectors=["vA", "vB"])
    m.body("coupler", ["B2", "C2"], vectors=["vB", "vC"])
    m.body("follower", ["C3", "D3"], vectors=["vC", "vD"])
    m.cylindrical("B", line=("B1", "vB"), on="B2")
    m.cylindrical("C", line=("C2", "vC"), on="C3")
    m.cylindrical("D", line=("D", "vD"), on="D3")
    m.angle("phi", to="vB", about="vA")
    m.angle("psi", to="vC", about="vD")
    m.distance("s", "D", "D3", along="vD")
    turns = travel(lambda phi: closes(turned(p["vB"], p["vA"], phi)), 0.0)
    return drive(m, ["psi", "s", "C3"], {"phi": turns})
