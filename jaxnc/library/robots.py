"""Mechanisms that place a point or a platform: open chains, pantograph, walking legs, parallel robots."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from jaxnc.library.drawing import (
    TURN,
    Length,
    Misfit,
    Point,
    Vector,
    X,
    Z,
    as_numbers,
    crank_travel,
    drive,
    hardpoints,
    lay_out,
    lay_out_joints,
    meet,
    offer,
    place_along,
    polar,
    rotate,
)
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism.model import Place


@offer
def planar_3r(
    lengths: Sequence[float] = (0.5, 0.4, 0.2),
    angles: Sequence[float] = (0.6, 0.5, 0.4),
    relative: bool = True,
) -> Mechanism:
    """Planar robot of three links A-B-C-P with three revolute joints, an open chain.

    n = 9, rows = 6, rank 6, g = 3. Inputs ``phi1``, ``phi2``, ``phi3``, the angles of its joints; or, by way of the
    inverse problem, coordinates of the tip such as ``P.x``, ``P.y`` with one angle.

    Args:
        lengths: lengths A-B, B-C and C-P, A the origin.
        angles: the three angles of the drawing, radians.
        relative: measure each angle from the link before (the first from the x axis); otherwise all from the x axis.

    Returns:
        The mechanism. The default drive folds the arm by a radian at every joint.

    Raises:
        MechanismError: for a length that is not positive, or not three of them.

    Source: source text, fig. 1.
    """
    lengths, angles = as_numbers("lengths", lengths, 3), as_numbers("angles", angles, 3)
    for i, length in enumerate(lengths):
        if length <= 0:
            raise Misfit(f"lengths[{i}] must be positive, got {length:g}; give a length above zero")
    at, direction, moving = (0.0, 0.0), 0.0, {}
    names = ("A", "B", "C", "P")
    for i, name in enumerate(names[1:]):
        direction = direction + angles[i] if relative else angles[i]
        at = moving[name] = polar(at, lengths[i], direction)
    bodies = {"link1": "A B", "link2": "B C", "link3": "C P"}
    m = lay_out("planar 3R", "Planar robot with three revolute joints.", {"A": (0.0, 0.0)}, moving, bodies)
    for i in range(3):
        before = (names[i - 1], names[i]) if relative and i else None
        m.angle(f"phi{i + 1}", to=(names[i], names[i + 1]), start=before)
    return drive(m, ["P"], {f"phi{i + 1}": (angle, angle + 1.0) for i, angle in enumerate(angles)})


@offer
def pantograph(
    arm1: Length = 0.3,
    arm2: Length = 0.25,
    ratio: Length = 2.0,
    tracer: tuple[float, float] = (0.3, 0.2),
) -> Mechanism:
    """Pantograph: Q copies the motion of the tracer P, enlarged about the pivot O.

    Arm O-A-B, arm B-C-Q, parallelogram A-P-C-B; O, P and Q stay on one line and OQ = ratio · OP. n = 10, rows = 8, rank
    8, g = 2. Inputs ``P.x`` and ``P.y``; the default drive moves the tracer along a short slanting line.

    Args:
        arm1: length O-A, O the origin; O-B is `ratio` times as long.
        arm2: length A-P; B-Q is `ratio` times as long.
        ratio: enlargement, greater than one.
        tracer: place (x, y) of P in the drawing, lengths.

    Raises:
        MechanismError: for a length that is not positive, a ratio of one or less, or a tracer out of reach.

    Source: C. Scheiner (1603); I. I. Artobolevsky, Mechanisms in Modern Engineering Design, volume 1.
    """
    if ratio <= 1:
        raise Misfit(f"ratio = {ratio:g} must be greater than 1 for A to lie between O and B")
    o, p = (0.0, 0.0), tracer
    a = meet(o, p, 1.0, arm1=arm1, arm2=arm2)
    b = place_along(o, a, ratio * arm1, 0.0)
    c = (b[0] + p[0] - a[0], b[1] + p[1] - a[1])
    m = lay_out(
        "pantograph",
        "Pantograph: Q draws what P traces, enlarged.",
        {"O": o},
        {"A": a, "B": b, "C": c, "P": p, "Q": (ratio * p[0], ratio * p[1])},
        {"arm1": "O B A", "arm2": "B Q C", "side1": "A P", "side2": "C P"},
    )
    reach = math.hypot(*p)
    away = 0.35 * min(arm1 + arm2 - reach, reach - abs(arm1 - arm2))
    return drive(m, ["P", "Q"], {"P.x": (p[0] - away, p[0] + away), "P.y": (p[1] - away, p[1] + away)})


@offer
def jansen_leg(
    a: Length = 38.0,
    b: Length = 41.5,
    c: Length = 39.3,
    d: Length = 40.1,
    e: Length = 55.8,
    f: Length = 39.4,
    g: Length = 36.7,
    h: Length = 65.7,
    i: Length = 49.0,
    j: Length = 50.0,
    k: Length = 61.9,
    l: float = 7.8,  # noqa: E741 (the published letter)
    m: Length = 15.0,
    scale: Length = 0.01,
    angle: float = 0.5,
) -> Mechanism:
    """Theo Jansen's leg, with his thirteen "holy numbers".

    Crank O-X, bars X-U (j) and X-L (k), triangle Z-U-V (b, e, d), bars Z-L (c) and V-K (f), triangle K-L-F (g, i, h)
    with the foot F. n = 13, rows = 12, rank 12, g = 1. Input ``phi``, the angle of the crank from the x axis; the
    default drive is a full turn where there is one, otherwise the range of the crank.

    Args:
        a: how far Z is to the left of the crank centre O, in units of `scale`, as all letters.
        b: Z-U.
        c: Z-L.
        d: Z-V.
        e: U-V.
        f: V-K.
        g: K-L.
        h: K-F.
        i: L-F.
        j: X-U.
        k: X-L.
        l: how far Z is below O; any sign, or zero.
        m: crank O-X.
        scale: length of one unit; 0.01 makes a leg of about a metre.
        angle: crank angle of the drawing, radians.

    Raises:
        MechanismError: for a length that is not positive, or bars that do not close, by their letters.

    Source: T. Jansen, The Great Pretender (2007), the published proportions of the Strandbeest's leg.
    """
    z = (-a, -l)

    def draw(phi: float) -> dict[str, Point]:
        x = polar((0.0, 0.0), m, phi)
        upper, lower = meet(x, z, -1.0, j=j, b=b), meet(x, z, 1.0, k=k, c=c)
        v = meet(upper, z, -1.0, e=e, d=d)
        knee = meet(v, lower, -1.0, f=f, g=g)
        return {"X": x, "U": upper, "L": lower, "V": v, "K": knee, "F": meet(knee, lower, -1.0, h=h, i=i)}

    leg = lay_out(
        "jansen leg",
        "Theo Jansen's leg: the foot F goes flat on the ground and high above it.",
        {"O": (0.0, 0.0), "Z": (scale * z[0], scale * z[1])},
        {name: (scale * at[0], scale * at[1]) for name, at in draw(angle).items()},
        {"crank": "O X", "upper_rod": "X U", "lower_rod": "X L", "upper_triangle": "Z U V"}
        | {"lower_rocker": "Z L", "tie": "V K", "foot": "K L F"},
    )
    leg.angle("phi", at="O", to="X")
    return drive(leg, ["F"], {"phi": crank_travel(draw, angle)})


_KLANN = {
    "A": (1.599, 0.750),
    "D": (1.009, 0.574),
    "G": (1.366, 1.366),
    "B": (1.331, 0.750),
    "C": (0.741, 0.750),
    "E": (0.232, 0.866),
    "F": (0.866, 1.500),
    "P": (0.0, 0.0),
}


@offer
def klann_leg(places: Mapping[str, Place] | None = None, scale: Length = 1.0) -> Mechanism:
    """Joe Klann's leg: a six-bar of Stephenson's third kind whose last coupler is extended to a foot P.

    Crank A-B, connecting rod B-C-E with elbow C and knee E, lower rocker D-C, upper rocker G-F with hip F, leg E-F-P.
    n = 11, rows = 10, rank 10, g = 1. Drawn fully extended, as in the patent's table. Input ``phi``, the angle of the
    crank from the x axis, π in the drawing; the default drive is a full turn, which the default places allow.

    Args:
        places: where joints are drawn, ``{"P": (x, y)}``, in units of `scale`, instead of their places in the patent.
        scale: length of one unit.

    Raises:
        MechanismError: for an unknown joint, two joints of one body at the same place, or a scale that is not
            positive.

    Source: J. C. Klann, US patent 6 260 862 (2001), table of an example leg: its points 15, 11, 9, 29, 27, 35, 37, 33
    are A, D, G, B, C, E, F, P here.
    """
    at = hardpoints(_KLANN, places)
    said = "Klann's leg: half a turn of the crank draws the foot P over the ground."
    bodies = {"crank": "A B", "rod": "B C E", "lower_rocker": "D C", "upper_rocker": "G F", "leg": "E F P"}
    m = lay_out_joints("klann leg", said, {n: scale * place for n, place in at.items()}, "ADG", bodies)
    m.angle("phi", at="A", to="B")
    home = math.atan2(at["B"][1] - at["A"][1], at["B"][0] - at["A"][0])
    return drive(m, ["P"], {"phi": (home, home + TURN)})


@offer
def stewart_platform(
    base_radius: Length = 0.5,
    platform_radius: Length = 0.3,
    height: Length = 0.5,
    base_spread: float = 0.4,
    platform_spread: float = 0.5,
) -> Mechanism:
    """Stewart-Gough platform: six legs of driven lengths between a base and a platform.

    Ball joints A1 to A6 on the base and B1 to B6 on the platform, in pairs; leg k is the distance ``sk`` from Ak to Bk.
    n = 24, rows = 18, rank 18, g = 6; inputs ``s1`` to ``s6``. The marker P is the platform's centre. The default
    drive takes all legs from their lengths in one place of the platform to those in another, higher and turned about
    the vertical.

    Args:
        base_radius: radius of the circle of the base joints, a length.
        platform_radius: radius of the circle of the platform joints, a length.
        height: height of the platform above the base in the drawing, a length.
        base_spread: angle between the two base joints of a pair, radians, between 0 and 2π/3.
        platform_spread: angle between the two platform joints of a pair, radians, between 0 and 2π/3.

    Raises:
        MechanismError: for a length that is not positive, a spread outside its range, or two similar hexagons, which
            leave the platform movable with all legs locked.

    Source: D. Stewart, A platform with six degrees of freedom, Proc. IMechE 180 (1965); source text, (116)-(127),
    (150).
    """
    for name, value in (("base_spread", base_spread), ("platform_spread", platform_spread)):
        if not 0.0 < value < TURN / 3.0:
            raise Misfit(f"{name} = {value:g} must be between 0 and 2π/3")
    if abs(base_spread + platform_spread - TURN / 3.0) < 1e-3:
        raise Misfit(
            f"base_spread = {base_spread:g} and platform_spread = {platform_spread:g} add up to 2π/3: the two "
            f"hexagons are similar, and the platform moves with all legs locked; change one"
        )

    def place_joints(radius: float, spread: float, turn: float, height: float) -> list[Vector]:
        """Six joints on a circle, in three pairs a third of a turn apart."""
        angles = [k * TURN / 3.0 + turn + side * 0.5 * spread for k in range(3) for side in (-1.0, 1.0)]
        return [np.array((radius * math.cos(a), radius * math.sin(a), height)) for a in angles]

    # A pair of platform joints is between two pairs of the base, so that neighbouring legs form triangles.
    base = place_joints(base_radius, base_spread, 0.0, 0.0)
    circle = place_joints(platform_radius, platform_spread, TURN / 6.0, height)
    platform = [circle[-1], *circle[:-1]]
    m = lay_out(
        "Stewart platform",
        "A platform on six legs whose lengths are driven.",
        {f"A{k}": at for k, at in enumerate(base, start=1)},
        {f"B{k}": at for k, at in enumerate(platform, start=1)},
        {"platform": "B1 B2 B3 B4 B5 B6"},
    )
    m.marker("P", on="platform", at=(0.0, 0.0, height))
    for k in range(1, 7):
        m.distance(f"s{k}", f"A{k}", f"B{k}")

    def legs(lift: float, turn: float) -> list[float]:
        return [math.dist(a, rotate(b + lift * Z, Z, turn)) for a, b in zip(base, platform, strict=True)]

    ends = zip(legs(-0.1 * height, -0.2), legs(0.2 * height, 0.4), strict=True)
    return drive(m, ["P", "B1"], {f"s{k}": pair for k, pair in enumerate(ends, start=1)})


@offer
def delta_robot(
    base_radius: Length = 0.15,
    platform_radius: Length = 0.05,
    arm: Length = 0.20,
    forearm: Length = 0.45,
    width: Length = 0.08,
    angle: float = 0.3,
) -> Mechanism:
    """Delta robot: three driven arms, each with a parallelogram of two ball-jointed bars, carry a platform.

    Arm k turns about the tangent uk of the base at Ak, with ball joints Pk and Qk at its end; the bars are Pk-Rk and
    Qk-Sk. n = 39, rows = 36, rank 36, g = 3; the platform keeps its orientation because the bars of every pair are
    parallel. Inputs ``phi1`` to ``phi3``, the angles of the arms below the plane of the base. The marker T is the
    platform's centre. The default drive moves the three arms between different angles.

    Args:
        base_radius: from the base's centre to the axes of the arms, a length.
        platform_radius: from the platform's centre to the middle of a pair of ball joints, a length.
        arm: length of the arms.
        forearm: length of the bars.
        width: distance of the two bars of a pair, a length.
        angle: angle of all arms in the drawing, radians.

    Raises:
        MechanismError: for a length that is not positive, or bars that do not reach the platform.

    Source: R. Clavel, Delta, a fast robot with parallel geometry, Proc. 18th Int. Symp. on Industrial Robots (1988).
    """
    out = base_radius + arm * math.cos(angle) - platform_radius
    if abs(out) >= 0.999 * forearm:
        raise Misfit(
            f"forearm = {forearm:g} does not reach from the platform to the elbows, {abs(out):g} outside of "
            f"it; lengthen it"
        )
    depth = -arm * math.sin(angle) - math.sqrt(forearm**2 - out**2)
    m = Mechanism("delta robot", dim=3, description="Three arms with parallelograms carry a platform that never turns.")
    for k in (1, 2, 3):
        radial = rotate(X, Z, (k - 1) * TURN / 3.0)
        tangent = np.cross(Z, radial)  # by the right hand about it an arm swings down
        pivot = base_radius * radial
        elbow = pivot + arm * (math.cos(angle) * radial - math.sin(angle) * Z)
        wrist = platform_radius * radial + depth * Z
        m.ground(f"A{k}", pivot)
        m.ground_vector(f"u{k}", tangent)
        m.ground_vector(f"e{k}", radial)
        for names, middle in (("PQ", elbow), ("RS", wrist)):
            for name, side in zip(names, (0.5, -0.5), strict=True):
                m.point(f"{name}{k}", middle + side * width * tangent)
        m.body(f"arm{k}", [f"A{k}", f"P{k}", f"Q{k}"], vectors=[f"u{k}"])
        m.body(f"bar{2 * k - 1}", [f"P{k}", f"R{k}"])
        m.body(f"bar{2 * k}", [f"Q{k}", f"S{k}"])
        m.angle(f"phi{k}", start=f"e{k}", at=f"A{k}", to=f"P{k}", about=f"u{k}")
    m.body("platform", ["R1", "S1", "R2", "S2", "R3", "S3"])
    m.marker("T", on="platform", at=(0.0, 0.0, depth))
    ends = ((-0.1, 0.7), (0.6, 0.1), (0.0, 0.4))
    return drive(m, ["T"], {f"phi{k + 1}": (angle - 0.3 + a, angle - 0.3 + b) for k, (a, b) in enumerate(ends)})
