"""Shafts: Cardan joints, single and in series, the bevel gear pair, and the steering column of figure 43."""

from __future__ import annotations

import numpy as np

from .closure import crank_angle, hardpoints, input_jet, revolved
from .jets import Jet, angle_about, atan2, cos, sin, turned

CARDAN_SHAFTS = {  # m: a gearbox, a propeller shaft of 1.2 m that runs down 6° and aside, and an axle
    "A": np.array([0.0, 0.0, 0.0]),
    "B": np.array([-0.20, 0.0, 0.0]),
    "C": np.array([-1.40, 0.08, -0.15]),
    "D": np.array([-1.60, 0.08, -0.18]),
    "v1": np.array([0.0, 0.0, 1.0]),
}
BEVEL_GEARS = {  # m: 1 : 2, shafts at 60° whose axes meet at the origin; 1 and 2 drawn where the pitch circles touch
    "A": np.array([0.10, 0.0, 0.0]),
    "vA": np.array([1.0, 0.0, 0.0]),
    "B": np.array([0.04, 0.04 * 3**0.5, 0.0]),
    "vB": np.array([0.5, 0.75**0.5, 0.0]),
    "1": np.array([0.10, 0.02 * 3**0.5, 0.0]),
    "2": np.array([0.10, 0.02 * 3**0.5, 0.0]),
}
STEERING_COLUMN = {  # m, ISO 8855 axes, origin under the front axle: left-hand drive, rack behind and over the axle
    "A": np.array([-1.05, 0.37, 0.95]),  # handwheel
    "B": np.array([-0.52, 0.37, 0.64]),  # upper universal joint
    "C": np.array([-0.28, 0.30, 0.37]),  # lower universal joint
    "D": np.array([-0.13, 0.30, 0.27]),  # pinion
    "E": np.array([-0.1339, -0.60, 0.2642]),  # zero of the rack's displacement, on the rack
    "1": np.array([-0.1339, -0.36, 0.2642]),  # ends of the rack, which moves along y
    "2": np.array([-0.1339, 0.36, 0.2642]),
    "v1": np.array([0.0, 1.0, 0.0]),  # pin of the fork of the upper shaft
}
PINION_RADIUS = 0.007  # m: 44 mm of rack a turn


def cardan(theta, beta, rate=1.0, acceleration=0.0) -> Jet:
    """Angle of the output shaft of a Cardan joint: tan θ_out = tan θ / cos β, continuous over any number of turns.

    Args:
        theta: Angle of the input shaft, rad, from where its pin lies in the plane of the shafts, (…); or a jet.
        beta: Angle of the shafts, rad, under π/2.
        rate: dθ/dt, rad/s.
        acceleration: d²θ/dt², rad/s².

    Returns:
        Angle of the output shaft, its rate ω cos β / (1 − sin² β cos² θ) and its acceleration.
    """
    theta = input_jet(theta, rate, acceleration)
    s, c = sin(theta), cos(theta)
    lag = atan2(s * c * (1.0 - np.cos(beta)), c * c * np.cos(beta) + s * s)  # within ±90°: no jump at any turn
    return theta + lag


def cardan_joint(inlet, outlet, pin, angle) -> tuple[Jet, np.ndarray]:
    """Rotation of the outlet of a Cardan joint from the drawn pose, and the drawn pin of its fork.

    Args:
        inlet: Unit direction of the input shaft, (3,).
        outlet: Unit direction of the output shaft, (3,).
        pin: Drawn unit direction of the pin of the inlet's fork, (3,), across `inlet`.
        angle: Rotation of the inlet from the drawn pose, rad, (…).
    """
    beta = angle_about(_unit(np.cross(inlet, outlet)), inlet, outlet).x if _bent(inlet, outlet) else 0.0
    start = angle_about(inlet, _across(outlet, inlet), pin).x if _bent(inlet, outlet) else 0.0
    turn = cardan(angle + start, beta) - cardan(Jet(start), beta).x
    return turn, _unit(np.cross(outlet, pin))


def cardan_shafts(points=None, phi=0.0, rate=1.0, acceleration=0.0, phase=np.pi / 2, zero=None) -> dict:
    """Three shafts A-B, B-C, C-D joined by two Cardan joints at B and C, at any angles and out of one plane.

    The forks of the middle shaft have pins v2 at B and v3 at C, `phase` apart about B→C. With all shafts in one
    plane v3 along v2 (phase 0) gives a constant velocity if the two joints' angles are equal; figure 43 has π/2.

    Args:
        points: Hardpoints other than `CARDAN_SHAFTS`; v1, made perpendicular to A→B, is the first fork's pin.
        phi: Angle of the first shaft about A→B, rad, (…); or a jet.
        rate: dφ/dt.
        acceleration: d²φ/dt².
        phase: Angle from v2 to v3 about B→C, rad.
        zero: Direction of the pin v1 at φ = 0; by default φ is measured from the drawn pose.

    Returns:
        Rotations from the drawn pose `middle` and `outlet`, and pins v1, v2 = d2 × v1, v3, v4 = d3 × v3, made unit.
    """
    p = hardpoints(CARDAN_SHAFTS, points)
    return _chain(p, input_jet(phi, rate, acceleration), phase, zero)


def _chain(p: dict, phi: Jet, phase: float, zero) -> dict:
    d = [_unit(p[end] - p[start]) for start, end in ("AB", "BC", "CD")]
    pin = _unit(_across(p["v1"], d[0]))
    first = crank_angle(phi, d[0], pin, zero)
    middle, v2 = cardan_joint(d[0], d[1], pin, first)
    v3 = turned(v2, d[1], phase).x
    outlet, v4 = cardan_joint(d[1], d[2], v3, middle)
    return {
        "inlet": first,
        "middle": middle,
        "outlet": outlet,
        "v1": turned(pin, d[0], first),
        "v2": turned(v2, d[1], middle),
        "v3": turned(v3, d[1], middle),
        "v4": turned(v4, d[2], outlet),
    }


def bevel_gears(points=None, phi=0.0, rate=1.0, acceleration=0.0, ratio=0.5, sense=-1.0, zero=None) -> dict:
    """Bevel gear pair of figure 41 at any shaft angle: points 1 and 2 of the wheels turned about the wheels' axes.

    Args:
        points: Hardpoints other than `BEVEL_GEARS`.
        phi: Angle of wheel A about vA, rad, (…); or a jet.
        rate: dφ/dt.
        acceleration: d²φ/dt².
        ratio: Teeth of wheel A to teeth of wheel B.
        sense: −1 where vA and vB both point away from the common apex (or both to it), else +1.
        zero: Direction from A of φ = 0; by default φ is measured from the drawn pose.

    Returns:
        Points "1" and "2", and `psi`, the rotation of wheel B about vB from the drawn pose.
    """
    p = hardpoints(BEVEL_GEARS, points)
    turn = crank_angle(input_jet(phi, rate, acceleration), p["vA"], p["1"] - p["A"], zero)
    psi = turn * (sense * ratio)
    return {
        "1": revolved(p["A"], p["vA"], p["1"], turn),
        "2": revolved(p["B"], p["vB"], p["2"], psi),
        "psi": psi,
    }


def pitch_cones(shaft_angle: float, ratio: float) -> tuple[float, float]:
    """Half angles of the pitch cones of a bevel pair, rad: they add up to the shaft angle, sines in the ratio."""
    first = np.arctan2(ratio * np.sin(shaft_angle), 1.0 + ratio * np.cos(shaft_angle))
    return first, shaft_angle - first


def steering_column(points=None, phi=0.0, rate=1.0, acceleration=0.0, radius=PINION_RADIUS, **shafts) -> dict:
    """Steering of figure 43: handwheel, two Cardan joints in series, pinion and rack; equations (186)–(201).

    The rack rolls on the side of the pinion where it is drawn. C–D is to be perpendicular to y for (197) to hold.

    Args:
        points: Hardpoints other than `STEERING_COLUMN`.
        phi: Angle of the handwheel about A→B, rad, (…), from the drawn pose, or from `zero`; or a jet.
        rate: dφ/dt.
        acceleration: d²φ/dt².
        radius: Pitch radius of the pinion, in the unit of the hardpoints.
        shafts: `phase` and `zero` of `cardan_shafts`.

    Returns:
        Pins v1 to v4; rotations `inlet`, `middle`, `outlet` from the drawn pose; `psi`, the angle of v4 about C→D
        from the y axis, (197); rack ends "1" and "2"; `s`, the displacement of 1 from E along y, (198).
    """
    p = hardpoints(STEERING_COLUMN, points)
    phase = shafts.get("phase", np.pi / 2)
    out = _chain(p, input_jet(phi, rate, acceleration), phase, shafts.get("zero"))
    axis, y = _unit(p["D"] - p["C"]), np.array([0.0, 1.0, 0.0])
    sense = np.sign(np.cross(axis, p["1"] - p["D"])[..., 1])  # ω × r at the rack
    shift = out["outlet"] * (sense * radius)
    out["psi"] = out["outlet"] + angle_about(axis, y, _chain(p, Jet(0.0), phase, None)["v4"]).x
    out["s"] = shift + (p["1"] - p["E"])[..., 1]
    for end in "12":
        out[end] = p[end] + shift[..., None] * y
    return out


def _unit(p: np.ndarray) -> np.ndarray:
    return p / np.linalg.norm(p, axis=-1, keepdims=True)


def _across(p: np.ndarray, axis: np.ndarray) -> np.ndarray:
    return p - np.sum(p * axis, -1, keepdims=True) * axis


def _bent(d1: np.ndarray, d2: np.ndarray) -> bool:
    return bool(np.linalg.norm(np.cross(d1, d2)) > 1e-12)
