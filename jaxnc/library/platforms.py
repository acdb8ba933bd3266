"""Parallel robots: the Stewart-Gough platform and the delta robot."""

import math

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import MechanismError
from jaxnc.library.drawing import TURN, drive, number, positive
from jaxnc.library.space import Vector, Z, turned
from jaxnc.mechanism import Mechanism


def _pairs(radius: float, spread: float, turn: float, height: float) -> list[Vector]:
    """Six joints on a circle, in three pairs a third of a turn apart."""
    angles = [k * TURN / 3.0 + turn + side * 0.5 * spread for k in range(3) for side in (-1.0, 1.0)]
    return [np.array((radius * math.cos(a), radius * math.sin(a), height)) for a in angles]


@public
def stewart_platform(
    base_radius: float = 0.5,
    platform_radius: float = 0.3,
    height: float = 0.5,
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
    what = "stewart_platform"
    base_radius, platform_radius, height = positive(
        what, base_radius=base_radius, platform_radius=platform_radius, height=height
    )
    base_spread, platform_spread = number(what, base_spread=base_spread, platform_spread=platform_spread)
    for name, value in (("base_spread", base_spread), ("platform_spread", platform_spread)):
        if not 0.0 < value < TURN / 3.0:
            raise MechanismError(f"{what}: {name} = {value:g} must be between 0 and 2π/3")
    if abs(base_spread + platform_spread - TURN / 3.0) < 1e-3:
        raise MechanismError(
            f"{what}: base_spread = {base_spread:g} and platform_spread = {platform_spread:g} add up to 2π/3: the two "
            f"hexagons are similar, and the platform moves with all legs locked; change one"
        )
    # A pair of platform joints is between two pairs of the base, so that neighbouring legs form triangles.
    base = _pairs(base_radius, base_spread, 0.0, 0.0)
    circle = _pairs(platform_radius, platform_spread, TURN / 6.0, height)
    platform = [circle[-1], *circle[:-1]]
    m = Mechanism("Stewart platform", dim=3, description="A platform on six legs whose lengths are driven.")
    for k in range(6):
        m.ground(f"A{k + 1}", base[k])
    for k in range(6):
        m.point(f"B{k + 1}", platform[k])
    m.body("platform", [f"B{k + 1}" for k in range(6)])
    m.marker("P", on="platform", at=(0.0, 0.0, height))
    for k in range(6):
        m.distance(f"s{k + 1}", f"A{k + 1}", f"B{k + 1}")

    def legs(lift: float, turn: float) -> list[float]:
        return [math.dist(a, turned(b + lift * Z, Z, turn)) for a, b in zip(base, platform, strict=True)]

    ends = zip(legs(-0.1 * height, -0.2), legs(0.2 * height, 0.4), strict=True)
    return drive(m, ["P", "B1"], {f"s{k + 1}": pair for k, pair in enumerate(ends)})


@public
def delta_robot(
    base_radius: float = 0.15,
    platform_radius: float = 0.05,
    arm: float = 0.20,
    forearm: float = 0.45,
    width: float = 0.08,
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
    what = "delta_robot"
    base_radius, platform_radius, arm, forearm, width = positive(
        what, base_radius=base_radius, platform_radius=platform_radius, arm=arm, forearm=forearm, width=width
    )
    (angle,) = number(what, angle=angle)
    out = base_radius + arm * math.cos(angle) - platform_radius
    if abs(out) >= 0.999 * forearm:
        raise MechanismError(
            f"{what}: forearm = {forearm:g} does not reach from the platform to the elbows, {abs(out):g} outside of "
            f"it; lengthen it"
        )
    depth = -arm * math.sin(angle) - math.sqrt(forearm**2 - out**2)
    m = Mechanism("delta robot", dim=3, description="Three arms with parallelograms carry a platform that never turns.")
    bodies: list[str] = []
    for k in (1, 2, 3):
        radial = turned(np.array((1.0, 0.0, 0.0)), Z, (k - 1) * TURN / 3.0)
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
        bodies += [f"R{k}", f"S{k}"]
    m.body("platform", bodies)
    m.marker("T", on="platform", at=(0.0, 0.0, depth))
    ends = ((-0.1, 0.7), (0.6, 0.1), (0.0, 0.4))
    return drive(m, ["T"], {f"phi{k + 1}": (angle - 0.3 + a, angle - 0.3 + b) for k, (a, b) in enumerate(ends)})
