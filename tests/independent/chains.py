"""Any single loop of revolute, prismatic, cylindrical and spherical joints, by Newton's method in its joint variables.

A second formulation for the closed forms to be compared with: a joint moves every link after it by the rotation or
translation about its drawn axis, so the loop closes when the product of these motions is the identity.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .closure import implicit, input_jet
from .jets import Jet, stack, turned

FREEDOMS = {"R": ("turn",), "P": ("slide",), "C": ("turn", "slide"), "S": ("turn", "turn", "turn")}


def loop(joints: Sequence[tuple], phi, rate=1.0, acceleration=0.0):
    """Joint variables of a loop whose first joint is driven, on the branch of the drawn pose.

    Args:
        joints: From the frame round to the frame, each (kind, point, axis) as drawn; kind R, P, C or S, a spherical
            joint turning about its axis and two across it.
        phi: Variable of the first joint, R or P, from the drawn pose, (…); or a jet.
        rate: dφ/dt.
        acceleration: d²φ/dt².

    Returns:
        Joint variables, (…, n), and a function that moves a drawn point of link k (1 after the first joint) to
        where it is.
    """
    steps, links = [], []
    for kind, point, axis in joints:
        axis = np.asarray(axis, float) / np.linalg.norm(axis)
        least = np.eye(3)[np.argmin(np.abs(axis))]
        second = np.cross(axis, least) / np.linalg.norm(np.cross(axis, least))
        for n, motion in enumerate(FREEDOMS[kind]):
            ways = (axis, second, np.cross(axis, second)) if kind == "S" else (axis, axis)
            steps.append((motion, np.asarray(point, float), ways[n]))
        links.append(len(steps))
    phi = input_jet(phi, rate, acceleration)
    size = np.max(np.ptp([point for _, point, _ in steps], axis=0))
    corners = size * np.concatenate([np.zeros((1, 3)), np.eye(3)])

    def moved(q: list, point):
        for value, (motion, centre, way) in reversed(list(zip(q, steps, strict=False))):
            arm = point - centre
            point = centre + (turned(arm, way, value) if motion == "turn" else arm + value[..., None] * way)
        return point

    def variables(x: Jet, u: Jet) -> list:
        return [u[..., 0], *(x[..., k] * (1.0 if steps[k + 1][0] == "turn" else size) for k in range(len(steps) - 1))]

    def residual(x, u):
        q = [v[..., None] for v in variables(x, u)]  # the four corners follow the poses
        gap = (moved(q, corners) - corners) / size
        return Jet(*(part.reshape(*part.shape[:-2], 12) for part in gap))

    x = implicit(residual, np.zeros(len(steps) - 1), phi[..., None], np.zeros(1))
    q = variables(x, phi[..., None])
    return stack(q), lambda link, point: moved(q[: links[link - 1]], np.asarray(point, float))
