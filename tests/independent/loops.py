"""Loops of revolute joints that move by their special dimensions: spherical four-bar, Bennett, threefold Bricard.

The last two follow Denavit and Hartenberg: T = Rz(θ) Tx(a) Rx(α) from each joint to the next, the loop's product being
the identity. Point k and axis vk are the origin and the z axis of the frame that joint k turns.
"""

from __future__ import annotations

import numpy as np

from .closure import crank_angle, hardpoints, input_jet, solved_angle
from .jets import Jet, atan2, carried, cos, cross, jet, scaled, sin, triad, turned
from .linkages import spherical_angle

SPHERICAL_FOUR_BAR = {  # m and directions; arcs of about 27°, 53°, 55° and 70°: the crank turns fully
    "O": np.array([0.0, 0.0, 0.0]),
    "vA": np.array([0.0, 0.0, 1.0]),
    "vB": np.array([0.45, 0.0, 0.90]),
    "vC": np.array([0.55, 0.75, 0.40]),
    "vD": np.array([0.94, -0.10, 0.34]),
    "P": np.array([0.08, 0.04, 0.06]),  # a point of the coupler
}
BENNETT = {"length": 0.20, "alpha": np.deg2rad(35.0), "beta": np.deg2rad(110.0), "theta": np.deg2rad(60.0)}
BRICARD = {"length": 0.15, "alpha": np.pi / 2, "theta": np.pi / 2}  # orthogonal: in the drawing, six edges of a cube


def spherical_four_bar(points=None, phi=0.0, rate=1.0, acceleration=0.0, zero=None) -> dict:
    """Spherical four-bar: axes vA and vD fixed, vB in the crank, vC in the follower, all through O.

    Args:
        points: Hardpoints other than `SPHERICAL_FOUR_BAR`: O, vA, vB, vC, vD, and P, a point of the coupler.
        phi: Angle of the crank about vA, rad, (…); or a jet.
        rate: dφ/dt.
        acceleration: d²φ/dt².
        zero: Direction of φ = 0, to which vB is compared across vA; by default the drawn one.

    Returns:
        Axes "vB" and "vC" and point "P", (…, 3); `psi`, rotation of the follower about vD from the drawn pose.
    """
    p = hardpoints(SPHERICAL_FOUR_BAR, points)
    turn = crank_angle(input_jet(phi, rate, acceleration), p["vA"], p["vB"], zero)
    vB = turned(p["vB"], p["vA"], turn)
    psi, vC = spherical_angle(p["vD"], p["vC"], p["vB"], vB)
    coupler = carried(p["P"] - p["O"], triad(p["vB"], p["vC"]), triad(vB, vC))
    return {"vB": vB, "vC": vC, "P": p["O"] + coupler, "psi": psi}


def bennett(theta=None, rate=1.0, acceleration=0.0, length=None, alpha=None, beta=None) -> dict:
    """Bennett linkage: links of length and twist a, α and b, β in turn, a / sin α = b / sin β, no offsets.

    Closed form: θ3 = −θ1, θ4 = −θ2, tan(θ1/2) tan(θ2/2) = sin((β + α)/2) / sin((β − α)/2). The frame is the link 4–1.

    Args:
        theta: θ1, rad, (…); or a jet; by default the drawn one.
        rate: dθ1/dt.
        acceleration: d²θ1/dt².
        length: a, of links 1–2 and 3–4, other than in `BENNETT`.
        alpha: α, rad.
        beta: β, of links 2–3 and 4–1, rad; not α.

    Returns:
        Points "1" to "4", axes "v1" to "v4", (…, 3), 1, v1, 4 and v4 fixed; `theta2`, in (−π, π)
        for θ1 in (0, 2π).
    """
    a, alpha, beta = _dimensions(BENNETT, length=length, alpha=alpha, beta=beta)
    first = input_jet(BENNETT["theta"] if theta is None else theta, rate, acceleration)
    ratio = np.sin((beta + alpha) / 2) / np.sin((beta - alpha) / 2)
    second = 2.0 * atan2(ratio * cos(first * 0.5), sin(first * 0.5))
    b = a * np.sin(beta) / np.sin(alpha)
    return _chain([first, second, -first, -second], [a, b, a, b], [alpha, beta, alpha, beta]) | {"theta2": second}


def bricard(theta=None, rate=1.0, acceleration=0.0, length=None, alpha=None, side=1.0) -> dict:
    """Threefold-symmetric Bricard linkage: six links of one length, twists α and −α in turn, no offsets.

    Closed form (Chen, You and Tarnai, Int. J. Solids Struct. 42, 2005): joints turn by φ and θ in turn,
    cos²α + sin²α (cos φ + cos θ) + (1 + cos²α) cos φ cos θ − 2 cos α sin φ sin θ = 0. The frame is the link 6–1.

    Args:
        theta: φ, at joints 1, 3 and 5, rad, (…), or a jet; by default the drawn one; for α = 90°, under 120°.
        rate: dφ/dt.
        acceleration: d²φ/dt².
        length: Of the links, other than in `BRICARD`.
        alpha: α, rad.
        side: ±1, the branch of θ; +1 has θ = −90° in the drawing.

    Returns:
        Points "1" to "6", axes "v1" to "v6", (…, 3), 1, v1, 6 and v6 fixed; `theta2`, the angle θ.
    """
    a, alpha = _dimensions(BRICARD, length=length, alpha=alpha)
    first = input_jet(BRICARD["theta"] if theta is None else theta, rate, acceleration)
    c, s = np.cos(alpha), np.sin(alpha)
    second = solved_angle(
        s**2 + (1 + c**2) * cos(first), -2 * c * sin(first), -(c**2) - s**2 * cos(first), -np.asarray(side, float)
    )
    return _chain([first, second] * 3, [a] * 6, [alpha, -alpha] * 3) | {"theta2": second}


def drawing(linkage: dict) -> dict:
    """Hardpoints, (3,) by name, of a linkage of one pose: what its points and axes are there."""
    return {name: q.x for name, q in linkage.items() if q.shape[-1:] == (3,)}


def _dimensions(default: dict, **given) -> list[float]:
    return [default[name] if value is None else value for name, value in given.items()]


def _chain(angles: list, lengths: list, twists: list) -> dict:
    """Origins and z axes of the frames of a chain, starting at the origin with z up; the last closes on the first."""
    shape = jet(angles[0]).shape
    origin, x, z = (Jet(np.broadcast_to(v, (*shape, 3))) for v in (np.zeros(3), np.eye(3)[0], np.eye(3)[2]))
    out = {}
    for k, (angle, length, twist) in enumerate(zip(angles, lengths, twists, strict=True), start=1):
        out[f"{k}"], out[f"v{k}"] = origin, z
        x = scaled(cos(angle), x) + scaled(sin(angle), cross(z, x))
        origin, z = origin + length * x, np.cos(twist) * z + np.sin(twist) * cross(x, z)
    out["closing_point"], out["closing_axis"], out["closing_normal"] = origin, z, x
    return out
