"""`dexterity`: how well a mechanism of several inputs moves its hand: manipulability and conditioning."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxnc.calls import public
from jaxnc.doors import door
from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.design import tangents
from jaxnc.kinematics.inputs import outside, positive
from jaxnc.kinematics.instant import body_of
from jaxnc.kinematics.motion import Motion
from jaxnc.notebooks import Reported
from jaxnc.system.system import characteristic_length


@public
@dataclasses.dataclass(frozen=True, repr=False)
class Dexterity(Reported):
    """How a hand moves with its actuators, pose by pose.

    All of it is dimensionless: velocities are divided by the characteristic length, and so are the rates of actuators
    and inputs that are lengths.

    Attributes:
        motion: the poses.
        actuators: names of the actuators.
        length: the characteristic length.
        jacobian: rates of the hand by those of the actuators: of its place, then its turn, ``(..., rows, actuators)``.
            Not finite where the actuators do not hold the hand.
        singular_values: of it, largest first, ``(..., k)``: the hand's speed in its easiest and hardest direction.
        manipulability: their product, ``(...,)`` (Yoshikawa); 0 where the hand loses a direction, infinite where it is
            not held.
        dexterity: the smallest over the largest, 0 … 1, ``(...,)``: 1 where all directions are alike, 0 at a singular
            position of either kind.
        held: determinant of the actuators' rates by those of the motion's inputs, ``(...,)``: it changes its sign where
            the actuators do not hold the hand. 1 where the inputs are the actuators.
    """

    motion: Motion
    actuators: tuple[str, ...]
    length: float
    jacobian: np.ndarray
    singular_values: np.ndarray
    manipulability: np.ndarray
    dexterity: np.ndarray
    held: np.ndarray

    def __str__(self) -> str:
        good = np.asarray(self.motion.converged)
        name, some = self.motion.system.topology.name, self.dexterity[good]
        if not some.size:
            return f"{name}: no pose was found"
        least, most = float(some.min()), float(some.max())
        return f"{name}: {some.size} of {good.size} poses, dexterity {least:.3g} … {most:.3g}, length {self.length:.4g}"

    def draw(self, path: object = None, **options: Any):
        """Draw a measure over two inputs, with the singularity loci; see `jaxnc.viz.draw_dexterity`."""
        return door("Dexterity.draw")(self, path, **options)


@public
def dexterity(
    motion: Motion,
    point: str,
    body: str | None = None,
    actuators: Sequence[str] | None = None,
    length: float | None = None,
) -> Dexterity:
    """Measure how well a mechanism moves a point, or a body, in each pose of a motion.

    Args:
        motion: poses of one design, such as a sweep over a grid. What is driven there may be the actuators, or the
            place of the hand.
        point: the point whose velocity counts: the hand's.
        body: the body whose angular velocity counts as well; none of an arm that only places a point.
        actuators: names of the coordinates that are actuated, as many as inputs; the inputs if not given.
        length: the characteristic length that makes velocities and angular velocities comparable; the root of the mean
            square of the distances of the body's points from `point` in the drawing if not given, or, without a body,
            the mechanism's size.

    Returns:
        The measures. Of poses that were not found they are NaN.

    Raises:
        InputError: an unknown name, as many actuators as there are not inputs, a motion of several designs, or a
            body of one point without a length.

    Source: T. Yoshikawa, Manipulability of robotic mechanisms, Int. J. Robotics Research 4(2) (1985) 3-9; C. Gosselin
    and J. Angeles, Singularity analysis of closed-loop kinematic chains, IEEE Trans. Robotics Automation 6(3) (1990)
    281-290, for both kinds of singular positions.
    """
    outside(motion, "dexterity()")
    top = motion.system.topology
    names = tuple(motion.driven if actuators is None else actuators)
    if motion._designs or not motion.driven or not motion.status.size:
        raise InputError(
            "dexterity() is of a pose or more of one design whose inputs are driven, as sweep() gives them"
        )
    for name in names:
        if name not in top.position:
            raise InputError(f"dexterity(): {top.name!r} has no actuator {name!r}; {nearest(name, top.coordinates)}")
    if len(names) != len(motion.driven):
        raise InputError(
            f"dexterity(): {len(names)} actuators ({', '.join(names)}) for {len(motion.driven)} inputs "
            f"({', '.join(motion.driven)}); there must be as many"
        )
    if len({*names}) < len(names):
        raise InputError(f"dexterity(): each actuator is named once; got {', '.join(names)}")
    shape, good = motion.status.shape, np.asarray(motion.converged).reshape(-1)
    parts: list[tuple[np.ndarray, np.ndarray]] = []
    if length is None:
        length = _length(motion, point, body)
    positive(length, "dexterity(): length")
    for name in motion.driven:
        unit = 1.0 if top.is_angle(name) else length
        one = dataclasses.replace(motion, rates=(tangents(motion, {name: unit})[0],))
        place = np.asarray(one.velocity(point)).reshape(good.size, -1) / length
        turn = [] if body is None else [np.asarray(one.angular_velocity(body)).reshape(good.size, -1)]
        acts = [np.asarray(one.velocity(n)).reshape(-1) / (1.0 if top.is_angle(n) else length) for n in names]
        parts.append((np.concatenate([place, *turn], axis=1), np.stack(acts, axis=1)))
    hand, acts = (np.stack(p, axis=2) for p in zip(*parts, strict=True))
    with np.errstate(all="ignore"):
        held = np.where(good, np.linalg.det(acts), np.nan)
        regular = good & (np.abs(held) > 0.0)
        inverse = np.linalg.inv(np.where(regular[:, None, None], acts, np.eye(len(names))))
        jacobian = np.where(regular[:, None, None], hand @ inverse, np.where(good, np.inf, np.nan)[:, None, None])
        values = np.linalg.svd(np.where(regular[:, None, None], jacobian, 0.0), compute_uv=False)
        values = np.where(regular[:, None], values, np.where(good, np.inf, np.nan)[:, None])
        even = np.where(regular, values[:, -1] / values[:, 0], np.where(good, 0.0, np.nan))
    return Dexterity(
        motion,
        names,
        float(length),
        jacobian.reshape(*shape, *jacobian.shape[1:]),
        values.reshape(*shape, -1),
        values.prod(axis=1).reshape(shape),
        even.reshape(shape),
        held.reshape(shape),
    )


def _length(motion: Motion, point: str, body: str | None) -> float:
    top, drawn = motion.system.topology, motion.system.parameters.points
    if body is None:
        return float(characteristic_length(drawn))
    places = np.asarray(drawn)[list(body_of(top, body).points)]
    away = places - np.asarray(motion.system[point])
    if not away.any():
        raise InputError(f"dexterity(): body {body!r} has no other point than {point!r} to take a length from: length=")
    return math.sqrt(float((away**2).sum(axis=1).mean()))
