"""The instantaneous screw axis of a body in space (Mozzi, Chasles)."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxnc.constraints.elementary import ratio
from jaxnc.system.on_lanes import on_host, on_lanes
from jaxnc.types import Array


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


def screw_axis(place: Array, velocity: Array, spin: Array) -> ScrewAxis:
    """The screw of a rigid velocity field.

    Args:
        place: a point of the body, ``(..., 3)``.
        velocity: its velocity, ``(..., 3)``.
        spin: the body's angular velocity, ``(..., 3)``.

    Returns:
        The axis; see `ScrewAxis`.
    """
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
