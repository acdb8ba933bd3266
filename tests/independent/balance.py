"""Newton's and Euler's laws of one rigid body, from where its points are and how they move.

Everything is NumPy; a body is known by directions on it, drawn and in one pose, with their first two derivatives.
"""

import numpy as np


def turned(drawn, now, rates, seconds):
    """Rotation, angular velocity and angular acceleration of a body.

    Args:
        drawn: directions on the body as drawn, ``(n, dim)``.
        now: the same in a pose.
        rates: their rates.
        seconds: their accelerations.

    Returns:
        Rotation matrix ``(dim, dim)`` from the drawing; rate and acceleration, numbers in the plane, ``(3,)`` in space,
        of least size where the directions are all on one line.
    """
    dim = np.shape(drawn)[1]
    if not len(drawn):  # a body of one point
        return np.eye(dim), *(np.zeros(3 if dim == 3 else ()) for _ in range(2))
    if dim == 2:
        square = np.sum(now * now)
        rate = np.sum(now[:, 0] * rates[:, 1] - now[:, 1] * rates[:, 0]) / square
        second = np.sum(now[:, 0] * seconds[:, 1] - now[:, 1] * seconds[:, 0]) / square
    else:
        rate = _fit(now, rates)
        second = _fit(now, seconds - np.cross(rate, np.cross(rate, now)))
    u, _, v = np.linalg.svd(now.T @ drawn)
    flip = np.eye(len(u))
    flip[-1, -1] = np.linalg.det(u @ v)
    return u @ flip @ v, rate, second


def _fit(arms, speeds):
    """The ω of least size with ω × arms = speeds."""
    rows = [np.stack([np.cross(e, arm) for e in np.eye(3)], axis=1) for arm in arms]
    return np.linalg.lstsq(np.concatenate(rows), np.concatenate(speeds), rcond=1e-9)[0]


def momentum_rates(mass, inertia, com, drawn, now, rates, seconds):
    """What the wrenches on a body have to add up to.

    Args:
        mass: its mass.
        inertia: about its centre of mass as drawn: a number in the plane, ``(3, 3)`` in space.
        com: centre of mass as drawn, ``(dim,)``.
        drawn: points of the body as drawn, ``(n, dim)``, the first one for reference; then directions.
        now: the same in a pose.
        rates: their rates.
        seconds: their accelerations.

    Returns:
        Centre of mass, ``m a`` of it, rate of the angular momentum about it, rotation rate.
    """
    spans = [np.concatenate([x[0][1:] - x[0][0], x[1]]) for x in (drawn, now, rates, seconds)]
    turn, rate, second = turned(*spans)
    arm = turn @ (com - drawn[0][0])
    if len(com) == 2:
        quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
        fall = seconds[0][0] + second * (quarter @ arm) - rate**2 * arm
        return now[0][0] + arm, mass * fall, inertia * second, rate
    fall = seconds[0][0] + np.cross(second, arm) + np.cross(rate, np.cross(rate, arm))
    about = turn @ inertia @ turn.T
    return now[0][0] + arm, mass * fall, about @ second + np.cross(rate, about @ rate), rate


def moment(arm, force):
    """Moment of a force, in the plane or in space."""
    return arm[0] * force[1] - arm[1] * force[0] if len(arm) == 2 else np.cross(arm, force)


def turning(rate, arm):
    """Velocity that a rotation gives to the end of an arm."""
    return rate * np.array([-arm[1], arm[0]]) if len(arm) == 2 else np.cross(rate, arm)
