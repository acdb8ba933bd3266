"""Spatial linkages of one loop, by their joint angles: RSCR (figures 23 and 24), RSSR, RSSP and RCCC.

Each is drawn in its hardpoints: the drawn pose fixes the dimensions, and the branch is the one that holds it. The
input φ is the rotation of the crank about vA from the drawn pose, or, where `zero` is given, the angle of the crank
from that direction.
"""

from __future__ import annotations

import numpy as np

from .closure import (
    crank_angle,
    drawn_side,
    hardpoints,
    implicit,
    input_jet,
    revolved,
    solved_angle,
    swing,
)
from .jets import Jet, carried, cross, dot, norm, scaled, sqrt, triad, turned

RSCR = {  # m
    "A": np.array([0.0, 0.0, 0.0]),
    "vA": np.array([0.0, 0.0, 1.0]),
    "1": np.array([0.10, 0.0, 0.03]),
    "2": np.array([0.31, 0.11, 0.30]),
    "v1": np.array([0.36, 0.48, 0.80]),
    "3": np.array([0.31 + 0.11 * 0.36, 0.11 + 0.11 * 0.48, 0.30 + 0.11 * 0.80]),  # 0.11 m from 2 along v1
    "B": np.array([0.32, 0.09, 0.13]),
    "vB": np.array([0.6, 0.0, 0.8]),
}
RSSR = {  # m
    "A": np.array([0.0, 0.0, 0.0]),
    "vA": np.array([0.0, 0.0, 1.0]),
    "1": np.array([0.10, 0.0, 0.0]),
    "2": np.array([0.30, 0.30, 0.15]),
    "B": np.array([0.40, 0.05, 0.10]),
    "vB": np.array([0.6, 0.0, 0.8]),
}
RSSP = {  # m
    "A": np.array([0.0, 0.0, 0.0]),
    "vA": np.array([0.0, 0.0, 1.0]),
    "1": np.array([0.08, 0.0, 0.0]),
    "2": np.array([0.35, 0.06, 0.10]),
    "v2": np.array([0.8, 0.0, 0.6]),
}
RCCC = {  # m; twists of about 30° (crank), 53° (coupler), 74° (follower) and 78° (frame)
    "A": np.array([0.0, 0.0, 0.0]),
    "vA": np.array([0.0, 0.0, 1.0]),
    "B": np.array([0.0, -0.08, 0.02]),
    "vB": np.array([0.5, 0.0, 0.75**0.5]),
    "C": np.array([0.20, 0.10, 0.15]),
    "vC": np.array([0.36, 0.80, 0.48]),
    "D": np.array([0.30, -0.05, 0.05]),
    "vD": np.array([0.96, -0.20, 0.20]),
}


def rscr(points=None, phi=0.0, rate=1.0, acceleration=0.0, zero=None) -> dict:
    """RSCR of figures 23 and 24: one equation in the rocker's angle ψ, the distance of point 1 to the moving axis.

    Body SC keeps (p2 − p1)·v1 and |p2 − p1|, so the distance of 1 to the axis is the constant e, e² = L² − c²; the
    axis (3, v1) turns with the rocker about vB. |(p1 − p3(ψ)) × v1(ψ)|² = e² is solved by Newton's method.

    Args:
        points: Hardpoints other than `RSCR`: A, vA, 1, 2, v1, 3, B, vB.
        phi: Angle of the crank A–1 about vA, rad, (…); or a jet.
        rate: dφ/dt.
        acceleration: d²φ/dt².
        zero: Direction of the crank at φ = 0; by default the drawn one.

    Returns:
        Points "1", "2", "3" and axis "v1", (…, 3); `psi`, rotation of the rocker about vB from the drawn pose; `slide`,
        (p2 − p3)·v1.
    """
    p = hardpoints(RSCR, points)
    turn = crank_angle(input_jet(phi, rate, acceleration), p["vA"], p["1"] - p["A"], zero)
    along = dot(p["2"] - p["1"], p["v1"]).x
    square = dot(p["2"] - p["1"], p["2"] - p["1"]).x - along**2

    def axis(psi):
        return revolved(p["B"], p["vB"], p["3"], psi), turned(p["v1"], p["vB"], psi)

    def residual(x, u):
        point, direction = axis(x[..., 0])
        moment = cross(revolved(p["A"], p["vA"], p["1"], u[..., 0]) - point, direction)
        return (dot(moment, moment) / square - 1.0)[..., None]

    psi = implicit(residual, np.zeros(1), turn[..., None], np.zeros(1))[..., 0]
    pin, (point, direction) = revolved(p["A"], p["vA"], p["1"], turn), axis(psi)
    slide = along + dot(pin - point, direction)
    return {
        "1": pin,
        "2": point + scaled(slide, direction),
        "3": point,
        "v1": direction,
        "psi": psi,
        "slide": slide,
    }


def rssr(points=None, phi=0.0, rate=1.0, acceleration=0.0, zero=None) -> dict:
    """RSSR in closed form: a cos ψ + b sin ψ = c, the coupler 1–2 of constant length.

    Args:
        points: Hardpoints other than `RSSR`: A, vA, 1 (crank), 2, B, vB (rocker).
        phi: Angle of the crank A–1 about vA, rad, (…); or a jet.
        rate: dφ/dt.
        acceleration: d²φ/dt².
        zero: Direction of the crank at φ = 0; by default the drawn one.

    Returns:
        Points "1" and "2", (…, 3); `psi`, rotation of the rocker about vB from the drawn pose, in (−2π, 2π).
    """
    p = hardpoints(RSSR, points)
    turn = crank_angle(input_jet(phi, rate, acceleration), p["vA"], p["1"] - p["A"], zero)
    length = norm(p["2"] - p["1"]).x
    pin = revolved(p["A"], p["vA"], p["1"], turn)
    side = drawn_side(swing(p["B"], p["vB"], p["2"], p["1"], length))
    psi = solved_angle(*swing(p["B"], p["vB"], p["2"], pin, length), side)
    return {"1": pin, "2": revolved(p["B"], p["vB"], p["2"], psi), "psi": psi}


def rssp(points=None, phi=0.0, rate=1.0, acceleration=0.0, zero=None) -> dict:
    """RSSP in closed form: the rod 1–2 of constant length, point 2 sliding along v2.

    Args:
        points: Hardpoints other than `RSSP`: A, vA, 1 (crank), 2 (slider), v2 (its direction).
        phi: Angle of the crank A–1 about vA, rad, (…); or a jet.
        rate: dφ/dt.
        acceleration: d²φ/dt².
        zero: Direction of the crank at φ = 0; by default the drawn one.

    Returns:
        Points "1" and "2", (…, 3); `slide`, displacement of 2 along v2 from the drawn pose.
    """
    p = hardpoints(RSSP, points)
    turn = crank_angle(input_jet(phi, rate, acceleration), p["vA"], p["1"] - p["A"], zero)
    rod = p["2"] - p["1"]
    pin = revolved(p["A"], p["vA"], p["1"], turn)
    gap = pin - p["2"]
    ahead = dot(gap, p["v2"])  # slide² − 2 ahead slide + gap² = rod²
    root = sqrt(ahead * ahead - dot(gap, gap) + dot(rod, rod).x)
    slide = ahead + np.sign(dot(rod, p["v2"]).x) * root
    return {"1": pin, "2": p["2"] + scaled(slide, p["v2"]), "slide": slide}


def rccc(points=None, phi=0.0, rate=1.0, acceleration=0.0, zero=None) -> dict:
    """RCCC: the spherical four-bar of its axes gives the angles in closed form, then three linear equations the slides.

    The crank turns about the fixed axis (A, vA), without sliding; cylindrical joints join crank and coupler on (B, vB),
    coupler and follower on (C, vC), follower and frame on the fixed axis (D, vD).

    Args:
        points: Hardpoints other than `RCCC`: A, vA, B, vB, C, vC, D, vD, each point on its axis.
        phi: Angle of the crank about vA, rad, (…); or a jet.
        rate: dφ/dt.
        acceleration: d²φ/dt².
        zero: Direction from A of point B at φ = 0; by default the drawn one.

    Returns:
        Axes "vB", "vC"; "B", fixed in the crank; "B_coupler" and "C_coupler", fixed in the coupler; "C" and "D",
        fixed in the follower, all (…, 3); `psi`, rotation of the follower about vD; slides from the drawn pose:
        `slide_B`, (B_coupler − B)·vB; `slide_C`, (C_coupler − C)·vC; `slide_D`, (D − drawn D)·vD.
    """
    p = hardpoints(RCCC, points)
    turn = crank_angle(input_jet(phi, rate, acceleration), p["vA"], p["B"] - p["A"], zero)
    crank, vB = revolved(p["A"], p["vA"], p["B"], turn), turned(p["vB"], p["vA"], turn)
    psi, vC = spherical_angle(p["vD"], p["vC"], p["vB"], vB)
    coupler = carried(p["C"] - p["B"], triad(p["vB"], p["vC"]), triad(vB, vC))
    follower = revolved(p["D"], p["vD"], p["C"], psi)
    # crank + sB vB + coupler = follower + sD vD + sC vC, by Cramer's rule
    gap = follower - crank - coupler
    volume = dot(vB, cross(vC, p["vD"]))
    slide_B = dot(gap, cross(vC, p["vD"])) / volume
    slide_C = -dot(gap, cross(p["vD"], vB)) / volume
    slide_D = -dot(gap, cross(vB, vC)) / volume
    return {
        "B": crank,
        "vB": vB,
        "B_coupler": crank + scaled(slide_B, vB),
        "C_coupler": crank + scaled(slide_B, vB) + coupler,
        "C": follower + scaled(slide_D, p["vD"]),
        "vC": vC,
        "D": p["D"] + scaled(slide_D, p["vD"]),
        "psi": psi,
        "slide_B": slide_B,
        "slide_C": slide_C,
        "slide_D": slide_D,
    }


def spherical_angle(axis, drawn, drawn_target, target) -> tuple[Jet, Jet]:
    """Rotation about an axis that keeps a direction at its drawn angle to a target: the spherical dyad.

    Args:
        axis: Unit axis, (3,).
        drawn: Drawn unit direction, (3,).
        drawn_target: Drawn unit direction of the target, (3,).
        target: Where the target points, (…, 3).

    Returns:
        The angle, (…), and the direction, (…, 3).
    """
    length = norm(drawn - drawn_target).x  # the chord: distances of unit vectors stand for their angles
    side = drawn_side(swing(np.zeros(3), axis, drawn, drawn_target, length))
    angle = solved_angle(*swing(np.zeros(3), axis, drawn, target, length), side)
    return angle, turned(drawn, axis, angle)
