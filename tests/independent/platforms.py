"""Parallel robots: the Stewart-Gough platform and the delta robot, both ways."""

from __future__ import annotations

import numpy as np

from .closure import drawn_side, hardpoints, implicit, revolved, solved_angle, swing
from .jets import Jet, across, cross, dot, jet, norm, scaled, sqrt, stack, turned, unit


def _ring(radius: float, height: float, degrees: list[float]) -> list[np.ndarray]:
    angles = np.deg2rad(degrees)
    return [np.array([radius * np.cos(t), radius * np.sin(t), height]) for t in angles]


STEWART_PLATFORM = {  # m: six legs Bk–Pk, joints in pairs 24° apart on circles of 0.9 and 0.6 m; P the centre
    **{f"B{k}": p for k, p in enumerate(_ring(0.9, 0.0, [-12, 12, 108, 132, 228, 252]), start=1)},
    **{f"P{k}": p for k, p in enumerate(_ring(0.6, 1.0, [-48, 48, 72, 168, 192, 288]), start=1)},
    "P": np.array([0.0, 0.0, 1.0]),
}
_ELBOW = 0.20 + 0.30 * 0.8  # shoulders on a circle of 0.20 m, upper arms of 0.30 m
DELTA_ROBOT = {  # m: shoulder Ak with axis vk, elbow Bk, platform joint Ck; forearms of 0.80 m, platform of 0.06 m
    **{f"A{k}": p for k, p in enumerate(_ring(0.20, 0.0, [0, 120, 240]), start=1)},
    **{f"v{k}": p for k, p in enumerate(_ring(1.0, 0.0, [90, 210, 330]), start=1)},
    **{f"B{k}": p for k, p in enumerate(_ring(_ELBOW, -0.18, [0, 120, 240]), start=1)},
    **{f"C{k}": p for k, p in enumerate(_ring(0.06, -0.18 - (0.64 - (_ELBOW - 0.06) ** 2) ** 0.5, [0, 120, 240]), 1)},
    "P": np.array([0.0, 0.0, -0.18 - (0.64 - (_ELBOW - 0.06) ** 2) ** 0.5]),
}
X, Y, Z = np.eye(3)


def stewart_platform(points=None, shift=(0.0, 0.0, 0.0), angles=(0.0, 0.0, 0.0)) -> dict:
    """Leg lengths of a Stewart-Gough platform from its pose, in closed form.

    Args:
        points: Hardpoints other than `STEWART_PLATFORM`: base joints B1 to B6, platform joints P1 to P6, centre P.
        shift: Displacement of P from the drawn pose, (…, 3); an array is held still, a jet moves.
        angles: Roll, pitch and yaw, rad, (…, 3): the platform turns about x, then y, then z, all fixed axes.

    Returns:
        Points "P", "P1" to "P6", (…, 3); `legs`, the lengths, (…, 6).
    """
    p = hardpoints(STEWART_PLATFORM, points)
    shift, angles = jet(shift), jet(angles)

    def placed(point):
        arm = jet(point - p["P"])
        for k, axis in enumerate((X, Y, Z)):
            arm = turned(arm, axis, angles[..., k])
        return p["P"] + shift + arm

    out = {name: placed(p[name]) for name in ("P", *(f"P{k}" for k in range(1, 7)))}
    return out | {"legs": stack([norm(out[f"P{k}"] - p[f"B{k}"]) for k in range(1, 7)])}


def stewart_pose(points=None, legs=None) -> dict:
    """Pose of a Stewart-Gough platform from its leg lengths, continuous with the drawn pose, by Newton's method.

    Args:
        points: Hardpoints other than `STEWART_PLATFORM`.
        legs: Lengths of the legs, (…, 6); an array is held still, a jet moves.

    Returns:
        What `stewart_platform` returns, and `shift` and `angles`, (…, 3).
    """
    drawn = stewart_platform(points)["legs"].x
    legs = jet(drawn if legs is None else legs)

    def residual(x, u):
        return (stewart_platform(points, x[..., :3], x[..., 3:])["legs"] - u) / drawn

    x = implicit(residual, np.zeros(6), legs, drawn)
    return stewart_platform(points, x[..., :3], x[..., 3:]) | {"shift": x[..., :3], "angles": x[..., 3:]}


def delta_angles(points=None, shift=(0.0, 0.0, 0.0)) -> dict:
    """Shoulder angles of a delta robot from the displacement of its platform, in closed form, arm by arm.

    The platform keeps its orientation: each forearm is a parallelogram, of which Bk–Ck is the middle line.

    Args:
        points: Hardpoints other than `DELTA_ROBOT`: shoulders Ak with axes vk, elbows Bk, joints Ck, centre P.
        shift: Displacement of the platform from the drawn pose, (…, 3); an array is held still, a jet moves.

    Returns:
        Points "P", "B1" to "B3", "C1" to "C3", (…, 3); `theta1` to `theta3`, rotations of the upper arms about v1 to
        v3 from the drawn pose.
    """
    p = hardpoints(DELTA_ROBOT, points)
    shift = jet(shift)
    out = {"P": p["P"] + shift}
    for k in "123":
        arm = p["A" + k], p["v" + k], p["B" + k]
        length = norm(p["C" + k] - p["B" + k]).x
        out["C" + k] = p["C" + k] + shift
        side = drawn_side(swing(*arm, p["C" + k], length))
        out["theta" + k] = solved_angle(*swing(*arm, out["C" + k], length), side)
        out["B" + k] = revolved(*arm, out["theta" + k])
    return out


def delta_robot(points=None, theta1=0.0, theta2=0.0, theta3=0.0) -> dict:
    """Position of a delta robot's platform from its shoulder angles: where three spheres meet, in closed form.

    Args:
        points: Hardpoints other than `DELTA_ROBOT`.
        theta1: Rotation of the first upper arm about v1 from the drawn pose, rad, (…); an array is held still, a jet
            moves.
        theta2: Of the second.
        theta3: Of the third.

    Returns:
        Points "P", "B1" to "B3", "C1" to "C3", (…, 3).
    """
    p = hardpoints(DELTA_ROBOT, points)
    still = 0.0 * (jet(theta1) + theta2 + theta3)  # one shape for all three
    angles = dict(zip("123", (still + theta1, still + theta2, still + theta3), strict=True))
    out = {"B" + k: revolved(p["A" + k], p["v" + k], p["B" + k], angles[k]) for k in "123"}
    centres = [out["B" + k] - (p["C" + k] - p["P"]) for k in "123"]
    drawn = [p["B" + k] - (p["C" + k] - p["P"]) for k in "123"]
    radii = [norm(p["C" + k] - p["B" + k]).x for k in "123"]
    normal = np.cross(drawn[1] - drawn[0], drawn[2] - drawn[0])
    out["P"] = _trilateration(centres, radii, np.sign(dot(p["P"] - drawn[0], normal).x))
    return out | {"C" + k: out["P"] + (p["C" + k] - p["P"]) for k in "123"}


def _trilateration(centres: list[Jet], radii: list[float], side: float) -> Jet:
    """Point at three distances from three centres, on the side of their plane that `side` tells."""
    ex = unit(centres[1] - centres[0])
    ey = unit(across(centres[2] - centres[0], ex))
    d, i, j = norm(centres[1] - centres[0]), dot(centres[2] - centres[0], ex), dot(centres[2] - centres[0], ey)
    x = (radii[0] ** 2 - radii[1] ** 2 + d * d) / (2.0 * d)
    y = (radii[0] ** 2 - radii[2] ** 2 + i * i + j * j - 2.0 * i * x) / (2.0 * j)
    z = side * sqrt(radii[0] ** 2 - x * x - y * y)
    return centres[0] + scaled(x, ex) + scaled(y, ey) + scaled(z, cross(ex, ey))
