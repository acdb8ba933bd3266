"""The instantaneous screw axis of a body in space (Mozzi, Chasles), and the axodes that it makes."""

from typing import TYPE_CHECKING, Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.constraints.elementary import ratio
from jaxnc.errors import InputError
from jaxnc.system.on_lanes import on_host, on_lanes
from jaxnc.types import Array

if TYPE_CHECKING:
    from jaxnc.kinematics.motion import Motion


@public
class ScrewAxis(NamedTuple):
    """A body's velocity as a rotation about a line and a translation along it.

    Attributes:
        point: the point of the axis closest to the body's reference point, ``(..., 3)``; the reference point itself
            where the body does not rotate.
        direction: unit vector of the axis, along the angular velocity, ``(..., 3)``; along the velocity where the body
            does not rotate, zero where it stands still.
        rate: rotation about the axis, rad/s, ``(...,)``.
        advance: velocity along the axis, length/s, ``(...,)``.
        pitch: ``advance / rate``, a length per radian, ``(...,)``; infinite for a pure translation, 0 at rest.
    """

    point: Array
    direction: Array
    rate: Array
    advance: Array
    pitch: Array


@public
class Axodes(NamedTuple):
    """The ruled surfaces that the instantaneous screw axis makes: the moving one rolls on the fixed one, and slides.

    Attributes:
        fixed: the axes on the ground or on the other body, as it lies in one pose, each ``(T, ...)``.
        moving: the axes on the body, as it lies in that pose; there the two touch along a line.
    """

    fixed: ScrewAxis
    moving: ScrewAxis


def screw_axis(place: Array, velocity: Array, spin: Array) -> ScrewAxis:
    """The screw of a rigid velocity field: of a point of the body, its velocity and spin, all ``(..., 3)``."""
    if on_host(place, velocity, spin):
        given: Any = place, velocity, spin
        found: Any = on_lanes(_flat, (), np.concatenate(given, axis=-1))
        return ScrewAxis(found[..., :3], found[..., 3:6], *np.moveaxis(found[..., 6:], -1, 0))
    square = jnp.sum(spin * spin, axis=-1)
    turning = square > 0
    rate = jnp.where(turning, jnp.sqrt(jnp.where(turning, square, 1.0)), 0.0)
    speed2 = jnp.sum(velocity * velocity, axis=-1)
    moving = speed2 > 0
    speed = jnp.where(moving, jnp.sqrt(jnp.where(moving, speed2, 1.0)), 0.0)
    along = jnp.where(turning[..., None], spin, velocity)
    direction = along * ratio(jnp.ones_like(rate), jnp.where(turning, rate, speed))[..., None]
    advance = jnp.sum(velocity * direction, axis=-1)
    offset = jnp.cross(spin, velocity) * ratio(jnp.ones_like(square), square)[..., None]
    pitch = jnp.where(turning, ratio(advance, rate), jnp.where(moving, jnp.inf, 0.0))
    return ScrewAxis(place + offset, direction, rate, advance, pitch)


def _flat(motion: Array) -> Array:
    """The axis as one row of numbers, from those of a point, its velocity and the angular velocity."""
    return jnp.concatenate([jnp.atleast_1d(part) for part in screw_axis(*jnp.split(motion, 3))])


def relative_screw(motion: "Motion", body: str, relative_to: str) -> ScrewAxis:
    """The screw of a body over the ground or over another body; see `jaxnc.kinematics.Motion.screw_axis`."""
    from jaxnc.kinematics.instant import finished, relative_state, settled

    if motion.system.topology.dim != 3:
        raise InputError("screw_axis() is for spatial mechanisms; in the plane see jaxnc.instant_centre")
    return finished(screw_axis(*settled(relative_state(motion, body, relative_to))))


@public
def axodes(motion: "Motion", body: str, relative_to: str = "ground", pose: int = 0) -> Axodes:
    """Fixed and moving axode of a body over a motion in space.

    Args:
        motion: a sequence of poses with rates, of a spatial mechanism.
        body: name of a body that knows its orientation.
        relative_to: name of the body that it is seen from, or ``"ground"``.
        pose: the pose in which the surfaces are shown; there they touch.

    Returns:
        See `Axodes`; where the body does not turn, the direction is that of its velocity, and its rate is zero.

    Raises:
        InputError: unknown body, one without an orientation, a planar mechanism, a motion without rates, or not one
            sequence of poses.

    Source:
        Bottema & Roth, Theoretical Kinematics, ch. VI.
    """
    from jaxnc.kinematics.instant import finished, sequence

    sequence(motion, "axodes()")
    found = motion.screw_axis(body, relative_to)
    fixed = found if relative_to == "ground" else _lying(motion, relative_to, found, pose)
    return finished(Axodes(fixed, _lying(motion, body, found, pose)))


def _lying(motion: "Motion", body: str, axes: ScrewAxis, pose: int) -> ScrewAxis:
    """Axes that ride on a body, each in its own pose, as they lie in one pose."""
    given: list[Any] = [motion.position(body), motion.orientation(body), axes.point, axes.direction]
    if on_host(np.zeros(()), given):
        given = [np.asarray(x) for x in given]
    place, turn, point, direction = given
    back = turn[pose] @ turn.swapaxes(-1, -2)

    def carried(x: Any) -> Any:
        return (back @ x[..., None])[..., 0]

    return axes._replace(point=place[pose] + carried(point - place), direction=carried(direction))
