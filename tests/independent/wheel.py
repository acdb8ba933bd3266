"""The steered wheel of a suspension: its knuckle held by the tie rod, and the angles and offsets that describe it.

Axes of ISO 8855: x forward, y to the left, z up. Everything here is for a left wheel (y > 0); the right wheel is the
mirror image. The road is a plane z = constant through the contact centre; the wheel is a thin disc.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .closure import drawn_side, implicit, solved_angle, swing
from .jets import Jet, across, asin, atan2, carried, cross, dot, jet, norm, scaled, stack, turned, unit

X, Y, Z = np.eye(3)


def knuckle(p: dict, top: np.ndarray, ball: Jet, drawn_frame: tuple, frame: tuple, inner: Jet) -> Callable:
    """Motion of the knuckle: its steering axis known in knuckle and space, the tie rod gives the turn about it.

    Args:
        p: Hardpoints; of them lower_ball, tie_inner and tie_outer are used.
        top: Upper end of the drawn steering axis, (3,).
        ball: Lower ball joint, on the steering axis, (…, 3).
        drawn_frame: Triad whose first vector is the steering axis, fixed in the drawn knuckle but for that vector.
        frame: The triad that it coincides with in space when the knuckle is not yet turned about the axis.
        inner: Inner joint of the tie rod, (…, 3).

    Returns:
        A function from a drawn point of the knuckle, (3,), to where it is, (…, 3).
    """
    length = norm(p["tie_outer"] - p["tie_inner"]).x
    axis = unit(top - p["lower_ball"])
    side = drawn_side(swing(p["lower_ball"], axis, p["tie_outer"], p["tie_inner"], length))

    def unsteered(point):
        return carried(point - p["lower_ball"], drawn_frame, frame)

    rod = swing(ball, frame[0], ball + unsteered(p["tie_outer"]), inner, length)
    angle = solved_angle(*rod, side)
    return lambda point: ball + turned(unsteered(point), frame[0], angle)


def driven(pose: Callable, p: dict, arm, travel, rack) -> tuple[Jet, Jet]:
    """Inputs as jets: the lower arm's angle as given, or the one at which the wheel centre has risen by `travel`.

    Args:
        pose: From the arm's angle and the rack's displacement to points by name, `wheel_centre` among them.
        p: Hardpoints.
        arm: Rotation of the lower arm from the drawn pose, rad, (…), or None.
        travel: Rise of the wheel centre from the drawn pose, or None; with `arm` None too, 0.
        rack: Displacement of the tie rod's inner joint along +y.

    Returns:
        The arm's angle and the rack's displacement.
    """
    rack = jet(rack)
    if arm is not None:
        return jet(arm) + 0.0 * rack, rack + 0.0 * jet(arm)
    travel = jet(0.0 if travel is None else travel)
    reach = norm(p["lower_ball"] - p["lower_rear"]).x

    def residual(x, u):
        height = pose(x[..., 0], u[..., 1])["wheel_centre"][..., 2]
        return ((height - p["wheel_centre"][..., 2] - u[..., 0]) / reach)[..., None]

    inputs = stack([travel, rack])
    return implicit(residual, np.zeros(1), inputs, np.zeros(2))[..., 0], inputs[..., 1]


def attitude(p: dict, points: dict, tyre_radius: float, spin) -> dict:
    """Wheel angles and offsets of a left wheel, with the signs of ISO 8855.

    Args:
        p: Hardpoints; of them wheel_centre and spindle are used.
        points: Where the points are: wheel_centre, spindle, rim, lower_ball and upper_ball (any upper point of the
            steering axis), (…, 3). Spindle is on the spin axis, outboard of the wheel centre.
        tyre_radius: From the wheel centre to the contact centre.
        spin: Rotation of the wheel about the outward spin axis, rad.

    Returns:
        spin_axis: Unit vector, outward, (…, 3).
        contact: Contact centre, the lowest point of the wheel's disc, (…, 3).
        rim: Point of the wheel, drawn foremost, turned by `spin`, (…, 3).
        camber: Angle from the vertical to the wheel plane, positive with the top of the wheel outward, rad.
        steer: Steer angle, from the x axis to the wheel's trace on the road, positive to the left, rad.
        toe: Toe-in, positive with the front of the wheel inward: −steer for a left wheel, rad.
        caster: From the z axis to the steering axis seen along y, positive with its top to the rear, rad.
        kingpin_inclination: The same seen along x, positive with its top inward, rad.
        caster_trail: How far ahead of the contact centre, along the wheel's trace, the steering axis meets the road.
        scrub_radius: How far inboard of the contact centre, across the trace, it meets the road.
        half_track_change: Displacement of the contact centre along +y, outward, from the drawn pose.
        recession: Displacement of the wheel centre along −x, to the rear, from the drawn pose.
    """
    centre = points["wheel_centre"]
    axis = unit(points["spindle"] - centre)
    contact = centre - tyre_radius * unit(across(Z, axis))
    heading = unit(cross(axis, Z))
    kingpin = points["upper_ball"] - points["lower_ball"]
    drop = (contact - points["lower_ball"])[..., 2] / kingpin[..., 2]
    offset = points["lower_ball"] + scaled(drop, kingpin) - contact
    steer = atan2(-axis[..., 0], axis[..., 1])
    drawn = unit(p["spindle"] - p["wheel_centre"])
    drawn_contact = p["wheel_centre"] - tyre_radius * unit(across(Z, drawn))
    return {
        "spin_axis": axis,
        "contact": contact,
        "rim": centre + turned(points["rim"] - centre, axis, spin),
        "camber": -asin(axis[..., 2]),
        "steer": steer,
        "toe": -steer,
        "caster": atan2(-kingpin[..., 0], kingpin[..., 2]),
        "kingpin_inclination": atan2(-kingpin[..., 1], kingpin[..., 2]),
        "caster_trail": dot(offset, heading),
        "scrub_radius": -dot(offset, cross(Z, heading)),
        "half_track_change": (contact - drawn_contact)[..., 1],
        "recession": (p["wheel_centre"] - centre)[..., 0],
    }


def rim_point(p: dict, tyre_radius: float) -> np.ndarray:
    """Foremost point of the drawn wheel, (3,)."""
    axis = unit(p["spindle"] - p["wheel_centre"])
    return (p["wheel_centre"] + tyre_radius * unit(cross(axis, Z))).x


def rates_over_travel(pose: Callable, p: dict, arm: Jet, rack: Jet, tyre_radius: float) -> dict:
    """What a suspension does per unit of wheel travel, the rack held.

    Args:
        pose: As in `driven`; of its points also damper_top and damper_lower, and those of `attitude`.
        p: Hardpoints.
        arm: Angle of the lower arm.
        rack: Displacement of the rack.
        tyre_radius: From the wheel centre to the contact centre.

    Returns:
        motion_ratio: Shortening of the damper per unit rise of the wheel centre, (…).
        roll_centre_height: Height over the road, (…), of the point of the vehicle's centre plane that lies in the
            transverse plane of the contact centre, on the normal to the contact centre's path there:
            y dy/dz of the contact centre, positive where the contact centre moves outward as the wheel rises.
    """
    points = pose(Jet(arm.x, 1.0), Jet(rack.x))
    contact = attitude(p, points, tyre_radius, 0.0)["contact"]
    damper = norm(points["damper_top"] - points["damper_lower"])
    return {
        "motion_ratio": -damper.v / points["wheel_centre"].v[..., 2],
        "roll_centre_height": contact.x[..., 1] * contact.v[..., 1] / contact.v[..., 2],
    }


def suspension(pose: Callable, p: dict, arm, travel, rack, spin, tyre_radius: float) -> dict:
    """Points, angles and ratios of a suspension: all that `attitude` and `rates_over_travel` give, and the inputs."""
    arm, rack = driven(pose, p, arm, travel, rack)
    points = pose(arm, rack)
    described = attitude(p, points, tyre_radius, spin)
    return (
        points
        | described
        | rates_over_travel(pose, p, arm, rack, tyre_radius)
        | {
            "arm": arm,
            "rack": rack,
            "travel": (points["wheel_centre"] - p["wheel_centre"])[..., 2],
            "damper": norm(points["damper_top"] - points["damper_lower"]),
        }
    )
