"""Numbers that are read off points and vectors: shapes of bodies, rotations, and what variables are in a pose.

A recipe is static; its points and vectors are places in those of one instance. The values are pure JAX and have finite
derivatives.

Rotations in space are counted from the drawing. Euler angles (z, x', z'') are singular where the second one is zero;
their axes are laid so that it is π/2 in the drawing. Bryant angles (x, y', z'') are singular where the second is ±π/2,
and are zero in the drawing. Euler parameters and the matrix itself are singular nowhere, and have rows of their own
that normalise them.
"""

import math
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp

from jaxnc.constraints.elementary import angle, cos, ratio, sin
from jaxnc.constraints.kind import about, cross, dot, norm, reader, unit
from jaxnc.system.frames import body_axes, quaternions
from jaxnc.types import AnyArray, Array, Components, Numbers, Scalar

Segments = tuple[tuple[int, ...], ...]
"""Directions of a part in the numbers of an instance: two points each, or a vector (~k,)."""


@dataclass(frozen=True)
class Recipe:
    """One reading."""

    how: str  # which of the functions below
    points: tuple[int, ...]  # the points that it takes
    vectors: tuple[int, ...] = ()  # the vectors that it takes
    extra: tuple = ()  # numbers that it takes besides

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its values."""
        return _HOW[self.how][1]

    @property
    def count(self) -> int:
        """The number of its values."""
        return len(self.names)


def values(recipe: Recipe, p: Components, v: Components) -> tuple[Scalar, ...]:
    """Read a recipe, from points ``(points, dim)`` and vectors ``(vectors, 3)``."""
    return tuple(_HOW[recipe.how][0]([p[i] for i in recipe.points], [v[i] for i in recipe.vectors], recipe.extra))


def _read_direction(p, v, extra):
    d = p[1] - p[0]
    return (angle(d[1], d[0]),)


def _read_between(p, v, extra):
    """Angle from p[0] -> p[1] to p[2] -> p[3]."""
    d, w = p[1] - p[0], p[3] - p[2]
    return (angle(cross(d, w), dot(d, w)),)


def _find_origin(p, v, how):
    """The reference point of a part, see `bodies.Origin`."""
    origin = p[0]
    if not how:
        for place in p[1:]:
            origin = origin + place
        return origin / len(p)
    forms, *factors = how
    axes = reader(forms, 1)(p, v)
    if len(p[0]) == 2:
        axes.append(jnp.stack([-axes[0][1], axes[0][0]]))
    elif len(axes) == 2:
        axes.append(jnp.cross(axes[0], axes[1]))
    for factor, axis in zip(factors, axes, strict=True):
        origin = origin + factor * axis
    return origin


def _read_local(p, v, extra):
    """Point p[0] in the frame whose x axis is p[1] -> p[2], and whose origin is made of the rest."""
    w, d = p[0] - _find_origin(p[3:], v, extra), p[2] - p[1]
    size = norm(d)
    return ratio(dot(d, w), size), ratio(cross(d, w), size)


def _turn_back(d, line, on):
    """A direction d of a body, turned back by the drawn angle from a line to the direction `on`; unit."""
    co, si = dot(line, on), cross(line, on)
    x = co * d + si * jnp.stack([d[1], -d[0]])
    return x * ratio(1.0, norm(d) * norm(line) * norm(on))


def _read_sliding(p, v, extra):
    """Point p[0] from p[1], in axes along a line.

    p[2] -> p[3] is a direction of the body; p[4] -> p[5] is the line and p[6] -> p[7] that direction, both as drawn:
    their angle stays.
    """
    x, w = _turn_back(p[3] - p[2], p[5] - p[4], p[7] - p[6]), p[0] - p[1]
    return dot(x, w), cross(x, w)


def _read_normal(p, v, extra):
    """The normal of a line p[0] -> p[1], from the axis p[2] -> p[3] of its body, and how far the line is along it.

    The angle is in (-π/2, π/2], the distance from the origin that is made of the rest.
    """
    line, axis = p[1] - p[0], p[3] - p[2]
    gamma, side = _fold_normal(angle(cross(axis, line), dot(axis, line)))
    n = side * jnp.stack([-line[1], line[0]]) * ratio(1.0, norm(line))
    return gamma, dot(n, p[0] - _find_origin(p[4:], v, extra))


def _fold_normal(turn):
    """An angle of a normal in (-π/2, π/2] from that of its line, and the side: +1 left of the line, -1 right."""
    full = turn + 0.5 * jnp.pi
    halves = jnp.ceil(full / jnp.pi - 0.5 - 1e-9)
    return full - jnp.pi * halves, 1.0 - 2.0 * jnp.abs(halves % 2)


def _read_prismatic(p, v, extra):
    """The normal of a line of one body, from the axis of the body that slides along it, and their distance along it.

    p[0] -> p[1] is the axis of the sliding body, p[2] -> p[3] its direction, which starts on the line; p[4] -> p[5] is
    the line; p[6] -> p[7] the line and p[8] -> p[9] the direction as drawn. ``extra[0]`` points follow that make the
    sliding body's reference in the way of ``extra[1]``, then those of the other's, ``extra[2]``.
    """
    axis, on, line = p[1] - p[0], p[3] - p[2], p[5] - p[4]
    along = _turn_back(on, p[7] - p[6], p[9] - p[8])
    gamma, side = _fold_normal(angle(cross(axis, along), dot(axis, along)))
    mine, other = p[10 : 10 + extra[0]], p[10 + extra[0] :]
    n = side * jnp.stack([-along[1], along[0]])
    m = side * jnp.stack([-line[1], line[0]]) * ratio(1.0, norm(line))
    return gamma, dot(n, p[2] - _find_origin(mine, v, extra[1])) - dot(m, p[4] - _find_origin(other, v, extra[2]))


def _read_along(p, v, extra):
    """Distance from p[0] to p[1] along p[2] -> p[3], or along the vector."""
    d, w = (p[3] - p[2] if len(p) > 2 else v[0]), p[1] - p[0]
    return (ratio(dot(d, w), norm(d)),)


def _read_signed(p, v, extra):
    """The distance of p[0] along a bar, p[1] -> p[2] or the vector, from the origin made of the points after it."""
    u = unit(p[2] - p[1]) if extra[0] else unit(v[0])
    return (dot(u, p[0] - _find_origin(p[1 + extra[0] :], v if extra[0] else v[1:], extra[1:])),)


def _read_agree(p, v, extra):
    """Cosine of the angle between a vector and p[0] -> p[1], or another vector: ±1 along a bar."""
    return (dot(unit(v[0]), unit(p[1] - p[0] if p else v[1])),)


def _read_about(p, v, extra):
    """Angle about an axis; ``extra[0]`` are the forms of axis, start and end."""
    axis, start, to = reader(extra[0])(p, v)
    co, si = about(unit(axis), start, to)
    return (angle(si, co),)


def _read_from(p, v, extra):
    """Point p[0] from the origin made of the rest, in the axes of the drawing."""
    return p[0] - _find_origin(p[1:], v, extra)


def _read_across(p, v, extra):
    """Two directions across p[0] -> p[1], or across the vector; ``extra[0]`` is an axis that is not along it."""
    d = unit(p[1] - p[0] if p else v[0])
    first = unit(jnp.cross(d, jnp.eye(3)[extra[0]]))
    return (*first, *jnp.cross(d, first))


_PAIR = ("along", "across")
_HOW = {
    "length": (lambda p, v, extra: (norm(p[1] - p[0]),), ("length",)),
    "direction": (_read_direction, ("angle",)),
    "between": (_read_between, ("angle",)),
    "mean": (_find_origin, ("x", "y", "z")),  # z in space only
    "local": (_read_local, _PAIR),
    "sliding": (_read_sliding, _PAIR),
    "normal": (_read_normal, ("normal", "offset")),
    "prismatic": (_read_prismatic, ("normal", "offset")),
    "signed": (_read_signed, ("distance",)),
    "agree": (_read_agree, ("sign",)),
    "about": (_read_about, ("angle",)),
    "along": (_read_along, ("distance",)),
    "from": (_read_from, ("x", "y", "z")),
    "unit": (lambda p, v, extra: unit(p[1] - p[0] if p else v[0]), ("x", "y", "z")),
    "across": (_read_across, ("x1", "y1", "z1", "x2", "y2", "z2")),
}


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


def rotation_rows(how: str, of: list, axis: list) -> tuple[tuple, ...]:
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


def parameters(how: str, r: Array) -> tuple[Array, ...]:
    """The parameters of a rotation matrix ``(3, 3)``; of Euler parameters those with a positive first one."""
    if how == "euler parameters":
        return tuple(quaternions(r))
    if how == "rotation matrix":
        return tuple(r.reshape(-1))
    if how == "bryant angles":
        return angle(-r[1, 2], r[2, 2]), angle(r[0, 2], norm(r[0, :2])), angle(-r[0, 1], r[0, 0])
    return angle(-r[0, 1], r[1, 1]), angle(norm(r[2, ::2]), -r[2, 1]), angle(r[2, 0], r[2, 2])


@dataclass(frozen=True)
class Reading:
    """A variable in a pose of the natural coordinates: one of the values of a recipe."""

    recipe: Recipe
    part: int = 0

    def evaluate(self, p: Components, v: Components, *drawn: Components) -> Scalar:
        """The variable's value in a pose."""
        return values(self.recipe, p, v)[self.part]


@dataclass(frozen=True)
class Between:
    """A variable of a joint between two parts in space, from the frames of both.

    In the drawing it is zero; of orientation parameters, which a body against the ground may have too, no rotation.
    """

    how: str  # "about" an axis, "universal", "slide", or the name of orientation parameters
    part: int  # which of several
    parent: Segments  # the segments of the part before it, in the instance's numbers; none for the ground
    child: Segments  # those of the part
    axes: Segments  # the joint's axis on the first, and on the second: two points, or a vector (~k,)
    at: tuple[int, ...] = ()  # the joint's point on each, if it has one

    @property
    def home(self) -> float:
        """Its value in the drawing."""
        return HOME[self.how][self.part] if self.how in HOME else 0.0

    def evaluate(self, p: Components, v: Components, p_drawn: Components, v_drawn: Components) -> Any:
        """The variable's value in a pose, from the points and vectors of the pose and those of the drawing."""
        parent, child = (_frame(x, p, v).T @ _frame(x, p_drawn, v_drawn) for x in (self.parent, self.child))
        turn = parent.T @ child
        if self.how in PARAMETERS:
            return parameters(self.how, turn)[self.part]
        a, b = (unit(p_drawn[x[1]] - p_drawn[x[0]] if len(x) == 2 else v_drawn[~x[0]]) for x in self.axes)
        if self.how == "slide":
            start, end = self.at
            return jnp.dot(parent.T @ (p[end] - p[start]) - (p_drawn[end] - p_drawn[start]), a)
        if self.how == "about":
            return _angle_about(turn, a)
        co, si = about(a, b, turn @ b)
        first = angle(si, co)
        if self.part == 0:
            return first
        # The rest of the rotation, after the first one is taken back, is about the second arm.
        return _angle_about(rotation(a, -first) @ turn, b)


def _frame(segments: Segments, p: AnyArray, v: AnyArray) -> AnyArray:
    return body_axes(segments, p, v) if segments else jnp.eye(3)


def _angle_about(turn: Array, axis: AnyArray) -> AnyArray:
    """Angle of a rotation about a known axis."""
    axial = 0.5 * jnp.stack([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return angle(jnp.dot(axial, axis), 0.5 * (jnp.trace(turn) - 1.0))


def skew_matrix(a: Numbers) -> Array:
    """The matrix ``(3, 3)`` of the vector product with a vector from the left."""
    return jnp.cross(jnp.asarray(a), jnp.eye(3)).T


def rotation(axis: AnyArray, angle: AnyArray) -> AnyArray:
    """The matrix ``(3, 3)`` of a rotation about a unit axis."""
    skew = skew_matrix(axis)
    return jnp.eye(3) + jnp.sin(angle) * skew + (1.0 - jnp.cos(angle)) * (skew @ skew)
