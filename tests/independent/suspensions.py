"""Front suspensions with a tie rod, left wheel: double wishbone and MacPherson (figure 42), all in closed form.

Two inputs: the lower arm's angle (or the rise of the wheel centre, by Newton's method in that angle) and the
displacement of the rack. Angles, offsets and their signs are described in `wheel.attitude`.
"""

from __future__ import annotations

import numpy as np

from .closure import drawn_side, hardpoints, revolved, solved_angle, swing
from .jets import Jet, dot, jet, norm, scaled, sqrt, triad, unit
from .wheel import X, Y, knuckle, rim_point, suspension

TYRE_RADIUS = 0.31  # m
DOUBLE_WISHBONE = {  # m, ISO 8855 axes, origin on the road below the middle of the front axle; rack ahead of the axle
    "lower_front": np.array([0.130, 0.360, 0.170]),
    "lower_rear": np.array([-0.190, 0.370, 0.165]),
    "lower_ball": np.array([0.008, 0.720, 0.155]),
    "upper_front": np.array([0.090, 0.440, 0.480]),
    "upper_rear": np.array([-0.150, 0.450, 0.465]),
    "upper_ball": np.array([-0.022, 0.655, 0.500]),
    "tie_inner": np.array([0.130, 0.370, 0.205]),
    "tie_outer": np.array([0.120, 0.705, 0.200]),
    "wheel_centre": np.array([0.0, 0.765, 0.310]),
    "spindle": np.array([0.0002, 0.865, 0.3109]),  # another point of the spin axis, outboard
    "damper_lower": np.array([-0.015, 0.580, 0.165]),  # on the lower arm
    "damper_top": np.array([-0.040, 0.480, 0.640]),
}
MACPHERSON = {  # m, the same axes; rack behind the axle
    "lower_front": np.array([0.015, 0.375, 0.215]),
    "lower_rear": np.array([-0.300, 0.385, 0.225]),
    "lower_ball": np.array([0.012, 0.715, 0.190]),
    "strut_lower": np.array([-0.008, 0.640, 0.420]),  # on the knuckle, on the axis of the strut
    "strut_top": np.array([-0.035, 0.565, 0.860]),
    "tie_inner": np.array([-0.1339, 0.360, 0.2642]),
    "tie_outer": np.array([-0.1350, 0.690, 0.2440]),
    "wheel_centre": np.array([0.0, 0.760, 0.310]),
    "spindle": np.array([0.0002, 0.860, 0.3109]),
}


def double_wishbone(points=None, arm=None, travel=None, rack=0.0, spin=0.0, tyre_radius=TYRE_RADIUS) -> dict:
    """Double wishbone: the arm's angle places one ball joint, and two equations a cos ψ + b sin ψ = c the rest.

    Args:
        points: Hardpoints other than `DOUBLE_WISHBONE`.
        arm: Rotation of the lower arm from the drawn pose about lower_rear→lower_front, rad: positive lifts a left
            wheel. An array is held still, a jet moves.
        travel: Instead of `arm`: rise of the wheel centre from the drawn pose.
        rack: Displacement of tie_inner along +y.
        spin: Rotation of the wheel about the outward spin axis from the drawn pose, rad.
        tyre_radius: From the wheel centre to the contact centre.

    Returns:
        Points lower_ball, upper_ball, tie_inner, tie_outer, wheel_centre, spindle, damper_lower, damper_top;
        `upper_arm`, the upper arm's rotation about upper_rear→upper_front; `damper`, its length; `arm`, `travel`,
        `rack`; and everything that `wheel.attitude` and `wheel.rates_over_travel` describe.
    """
    p = hardpoints(DOUBLE_WISHBONE, points)
    lower, upper = unit(p["lower_front"] - p["lower_rear"]).x, unit(p["upper_front"] - p["upper_rear"]).x
    height = norm(p["upper_ball"] - p["lower_ball"]).x
    side = drawn_side(swing(p["upper_rear"], upper, p["upper_ball"], p["lower_ball"], height))

    def pose(arm, rack):
        ball = revolved(p["lower_rear"], lower, p["lower_ball"], arm)
        angle = solved_angle(*swing(p["upper_rear"], upper, p["upper_ball"], ball, height), side)
        top = revolved(p["upper_rear"], upper, p["upper_ball"], angle)
        inner = p["tie_inner"] + scaled(rack, Y)
        frames = triad(p["upper_ball"] - p["lower_ball"], X), triad(top - ball, X)
        carry = knuckle(p, p["upper_ball"], ball, *frames, inner)
        return {
            "lower_ball": ball,
            "upper_ball": top,
            "tie_inner": inner,
            **{name: carry(p[name]) for name in ("tie_outer", "wheel_centre", "spindle")},
            "rim": carry(rim_point(p, tyre_radius)),
            "damper_lower": revolved(p["lower_rear"], lower, p["damper_lower"], arm),
            "damper_top": jet(p["damper_top"]),
            "upper_arm": angle,
        }

    return suspension(pose, p, arm, travel, rack, spin, tyre_radius)


def macpherson(points=None, arm=None, travel=None, rack=0.0, spin=0.0, tyre_radius=TYRE_RADIUS) -> dict:
    """MacPherson strut of figure 42: the strut's axis is fixed in the knuckle and slides through the ball at its top.

    The axis passes through strut_lower and, in the drawn pose, strut_top; it may miss the lower ball joint. The
    distance from the lower ball to the top gives the length of the strut by a quadratic equation, and with it the
    steering axis in the knuckle; the tie rod gives the turn about it.

    Args:
        points: Hardpoints other than `MACPHERSON`.
        arm: Rotation of the lower arm from the drawn pose about lower_rear→lower_front, rad: positive lifts a left
            wheel. An array is held still, a jet moves.
        travel: Instead of `arm`: rise of the wheel centre from the drawn pose.
        rack: Displacement of tie_inner along +y.
        spin: Rotation of the wheel about the outward spin axis from the drawn pose, rad.
        tyre_radius: From the wheel centre to the contact centre.

    Returns:
        Points lower_ball, strut_lower (also damper_lower), strut_top (also damper_top, and upper_ball: it is the upper
        end of the steering axis), tie_inner, tie_outer, wheel_centre, spindle; `strut_axis`, the unit vector of the
        strut, upward; `damper`, the distance from strut_lower to strut_top; `arm`, `travel`, `rack`; and everything
        that `wheel.attitude` and `wheel.rates_over_travel` describe.
    """
    p = hardpoints(MACPHERSON, points)
    lower = unit(p["lower_front"] - p["lower_rear"]).x
    strut = unit(p["strut_top"] - p["strut_lower"]).x
    foot = p["strut_lower"] - p["lower_ball"]
    ahead = dot(foot, strut).x
    side = np.sign(dot(p["strut_top"] - p["lower_ball"], strut).x)

    def pose(arm, rack):
        ball = revolved(p["lower_rear"], lower, p["lower_ball"], arm)
        inner = p["tie_inner"] + scaled(rack, Y)
        axis = p["strut_top"] - ball
        length = side * sqrt(dot(axis, axis) - dot(foot, foot) + ahead**2) - ahead  # |foot + length strut| = |axis|
        frames = triad(foot + scaled(length, strut), X), triad(axis, X)
        carry = knuckle(p, p["strut_top"], ball, *frames, inner)
        low, top = carry(p["strut_lower"]), Jet(0.0) * ball + p["strut_top"]
        return {
            "lower_ball": ball,
            "upper_ball": top,
            "strut_lower": low,
            "strut_top": top,
            "damper_lower": low,
            "damper_top": top,
            "tie_inner": inner,
            **{name: carry(p[name]) for name in ("tie_outer", "wheel_centre", "spindle")},
            "rim": carry(rim_point(p, tyre_radius)),
            "strut_axis": (carry(p["strut_lower"] + strut) - low),
        }

    return suspension(pose, p, arm, travel, rack, spin, tyre_radius)
