"""Rotations in space: matrices from orientation parameters, and the parameters of a rotation.

All rotations are counted from the drawing. Euler angles (z, x', z'') are singular where the second one is zero; their
axes are laid so that it is π/2 in the drawing. Bryant angles (x, y', z'') are singular where the second is ±π/2, and
are zero in the drawing. Euler parameters and the matrix itself are singular nowhere, and have rows of their own that
normalise them.
"""

import math
from typing import Any

import jax.numpy as jnp

from jaxnc.constraints.elementary import cos, sin
from jaxnc.constraints.kind import Kind, dot
from jaxnc.pickling import listed
from jaxnc.system.frames import quaternions

PARAMETERS = {
    "euler parameters": ("e0", "e1", "e2", "e3"),
    "euler angles": ("precession", "nutation", "spin"),
    "bryant angles": ("roll", "pitch", "yaw"),
    "rotation matrix": ("xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"),
}
"""Orientation parameters by their family's name, with the names of the variables."""

HOME = {
    "euler parameters": (1.0, 0.0, 0.0, 0.0),
    "euler angles": (0.0, 0.5 * math.pi, 0.0),
    "bryant angles": (0.0, 0.0, 0.0),
    "rotation matrix": (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
}
"""Their values in the drawing."""

ANGLES = ("euler angles", "bryant angles")


def turned(how: str, of: list, axis: list) -> tuple[tuple, ...]:
    """Rows of a rotation matrix.

    `how` is ``"about"`` an axis, by an angle; one of `PARAMETERS`; or ``"times"``, no rotation but a stretch. The axis
    is a unit vector.
    """
    if how == "about":
        co, si = cos(of[0]), sin(of[0])
        x, y, z = axis
        t = 1.0 - co
        return (
            (co + t * x * x, t * x * y - si * z, t * x * z + si * y),
            (t * x * y + si * z, co + t * y * y, t * y * z - si * x),
            (t * x * z - si * y, t * y * z + si * x, co + t * z * z),
        )
    if how == "times":
        (d,) = of
        return (d, 0.0, 0.0), (0.0, d, 0.0), (0.0, 0.0, d)
    if how == "euler parameters":
        a, b, c, d = of
        return (
            (a * a + b * b - c * c - d * d, 2.0 * (b * c - a * d), 2.0 * (b * d + a * c)),
            (2.0 * (b * c + a * d), a * a - b * b + c * c - d * d, 2.0 * (c * d - a * b)),
            (2.0 * (b * d - a * c), 2.0 * (c * d + a * b), a * a - b * b - c * c + d * d),
        )
    if how == "rotation matrix":
        return tuple(tuple(of[3 * i : 3 * i + 3]) for i in range(3))
    (a, b, c), (f, g, h) = (cos(x) for x in of), (sin(x) for x in of)
    if how == "bryant angles":
        return (
            (b * c, -(b * h), g),
            (a * h + f * g * c, a * c - f * g * h, -(f * b)),
            (f * h - a * g * c, f * c + a * g * h, a * b),
        )
    # z, x', z'', and then a quarter turn back about x: the drawing is at (0, π/2, 0).
    return (
        (a * c - f * b * h, -(f * g), -(a * h) - f * b * c),
        (f * c + a * b * h, a * g, a * b * c - f * h),
        (g * h, -b, g * c),
    )


def parameters(how: str, r: Any) -> tuple[Any, ...]:
    """The parameters of a rotation matrix ``(3, 3)``; of Euler parameters those with a positive first one."""
    if how == "euler parameters":
        return tuple(quaternions(r))
    if how == "rotation matrix":
        return tuple(r.reshape(-1))
    if how == "bryant angles":
        return _atan2(-r[1, 2], r[2, 2]), _atan2(r[0, 2], _hypot(r[0, 0], r[0, 1])), _atan2(-r[0, 1], r[0, 0])
    return _atan2(-r[0, 1], r[1, 1]), _atan2(_hypot(r[2, 0], r[2, 2]), -r[2, 1]), _atan2(r[2, 0], r[2, 2])


def _atan2(y, x):
    safe = (x != 0) | (y != 0)
    return jnp.arctan2(jnp.where(safe, y, 0.0), jnp.where(safe, x, 1.0))


def _hypot(x, y):
    square = x * x + y * y
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)


NORM = Kind(
    "Euler parameters",
    lambda p, v, s, c: (s[0] * s[0] + s[1] * s[1] + s[2] * s[2] + s[3] * s[3] - 1.0,),
    rows=("unit length",),
    powers=(0,),
    scalars=4,
    source="normalisation of Euler parameters",
)

DIRECTION = Kind(
    "direction of a bar",
    lambda p, v, s, c: (s[0] * s[0] + s[1] * s[1] + s[2] * s[2] - 1.0,),
    rows=("unit length",),
    powers=(0,),
    scalars=3,
    source="§4: a unit vector",
)


def _orthonormal(p, v, s, c):
    rows = [s[0:3], s[3:6], s[6:9]]
    return tuple(dot(rows[i], rows[j]) - (1.0 if i == j else 0.0) for i in range(3) for j in range(i + 1))


ORTHONORMAL = Kind(
    "rotation matrix",
    _orthonormal,
    rows=("xx", "yx", "yy", "zx", "zy", "zz"),
    powers=(0,) * 6,
    scalars=9,
    source="the rows of a rotation matrix are unit vectors at right angles",
)

listed(__name__, (NORM, DIRECTION, ORTHONORMAL))

NORMALISED = {"euler parameters": NORM, "rotation matrix": ORTHONORMAL}
