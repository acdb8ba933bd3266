"""Numbers that are read off drawn points and vectors: shapes of bodies, and what variables are in a pose.

A recipe is static; its points and vectors are places in those of one instance. The values are pure JAX and have finite
derivatives.
"""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp

from jaxnc.constraints.directions import about, unit
from jaxnc.constraints.elementary import ratio
from jaxnc.constraints.kind import cross, dot, norm


@dataclass(frozen=True)
class Recipe:
    """One reading."""

    how: str  # which of the functions below
    points: tuple[int, ...]  # the points that it takes
    vectors: tuple[int, ...] = ()  # the vectors that it takes
    extra: tuple = ()  # numbers that it takes besides

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what it gives."""
        return _HOW[self.how][1]

    @property
    def count(self) -> int:
        """How many numbers it gives."""
        return len(self.names)


def values(recipe: Recipe, p: Any, v: Any) -> tuple[Any, ...]:
    """What a recipe reads, from points ``(points, dim)`` and vectors ``(vectors, 3)``."""
    return _HOW[recipe.how][0]([p[i] for i in recipe.points], [v[i] for i in recipe.vectors], recipe.extra)


def angle(x: Any, y: Any) -> Any:
    """Angle of a plane vector from the x axis, with a finite derivative where it has none."""
    safe = (x != 0) | (y != 0)
    return jnp.arctan2(jnp.where(safe, y, 0.0), jnp.where(safe, x, 1.0))


def _length(p, v, extra):
    return (norm(p[1] - p[0]),)


def _direction(p, v, extra):
    d = p[1] - p[0]
    return (angle(d[0], d[1]),)


def _between(p, v, extra):
    """Angle from p[0] -> p[1] to p[2] -> p[3]."""
    d, w = p[1] - p[0], p[3] - p[2]
    return (angle(dot(d, w), cross(d, w)),)


def _origin(p, v, how):
    """The reference point of a part, see `bodies.Origin`."""
    if not how:
        return sum(p[1:], p[0]) / len(p)
    forms, *factors = how
    points, vectors = iter(p[1:]), iter(v)
    axes = []
    for form in forms:
        axes.append(next(vectors) if form == "v" else -next(points) + next(points))
    if len(p[0]) == 2:
        axes.append(jnp.stack([-axes[0][1], axes[0][0]]))
    elif len(axes) == 2:
        axes.append(jnp.cross(axes[0], axes[1]))
    return p[0] + sum(f * axis for f, axis in zip(factors, axes, strict=True))


def _mean(p, v, extra):
    return tuple(_origin(p, v, extra))  # pyright: ignore[reportArgumentType]


def _local(p, v, extra):
    """Point p[0] in the frame whose x axis is p[1] -> p[2], and whose origin is made of the rest."""
    w, d = p[0] - _origin(p[3:], v, extra), p[2] - p[1]
    size = norm(d)
    return ratio(dot(d, w), size), ratio(cross(d, w), size)


def _back(d, line, on):
    """A direction d of a body, turned back by the drawn angle from a line to the direction `on`; unit."""
    co, si = dot(line, on), cross(line, on)
    x = co * d + si * jnp.stack([d[1], -d[0]])
    return x * ratio(1.0, norm(d) * norm(line) * norm(on))


def _sliding(p, v, extra):
    """Point p[0] from p[1], in axes along a line.

    p[2] -> p[3] is a direction of the body; p[4] -> p[5] is the line and p[6] -> p[7] that direction, both as drawn:
    their angle stays.
    """
    x, w = _back(p[3] - p[2], p[5] - p[4], p[7] - p[6]), p[0] - p[1]
    return dot(x, w), cross(x, w)


def _normal(p, v, extra):
    """The normal of a line p[0] -> p[1], from the axis p[2] -> p[3] of its body, and how far the line is along it.

    The angle is in (-π/2, π/2], the distance from the origin that is made of the rest.
    """
    line, axis = p[1] - p[0], p[3] - p[2]
    gamma, side = _folded(angle(dot(axis, line), cross(axis, line)))
    n = side * jnp.stack([-line[1], line[0]]) * ratio(1.0, norm(line))
    return gamma, dot(n, p[0] - _origin(p[4:], v, extra))


def _folded(turn):
    """An angle of a normal in (-π/2, π/2] from that of its line, and the side: +1 left of the line, -1 right."""
    full = turn + 0.5 * jnp.pi
    halves = jnp.ceil(full / jnp.pi - 0.5 - 1e-9)
    return full - jnp.pi * halves, 1.0 - 2.0 * jnp.abs(halves % 2)


def _prismatic(p, v, extra):
    """The normal of a line of one body, from the axis of the body that slides along it, and their distance along it.

    p[0] -> p[1] is the axis of the sliding body, p[2] -> p[3] its direction, which starts on the line; p[4] -> p[5] is
    the line; p[6] -> p[7] the line and p[8] -> p[9] the direction as drawn. ``extra[0]`` points follow that make the
    sliding body's reference in the way of ``extra[1]``, then those of the other's, ``extra[2]``.
    """
    axis, on, line = p[1] - p[0], p[3] - p[2], p[5] - p[4]
    along = _back(on, p[7] - p[6], p[9] - p[8])
    gamma, side = _folded(angle(dot(axis, along), cross(axis, along)))
    mine, other = p[10 : 10 + extra[0]], p[10 + extra[0] :]
    n = side * jnp.stack([-along[1], along[0]])
    m = side * jnp.stack([-line[1], line[0]]) * ratio(1.0, norm(line))
    return gamma, dot(n, p[2] - _origin(mine, v, extra[1])) - dot(m, p[4] - _origin(other, v, extra[2]))


def _along(p, v, extra):
    """Distance from p[0] to p[1] along p[2] -> p[3], or along the vector."""
    d, w = (p[3] - p[2] if len(p) > 2 else v[0]), p[1] - p[0]
    return (ratio(dot(d, w), norm(d)),)


def _signed(p, v, extra):
    """How far p[0] is along a bar, p[1] -> p[2] or the vector, from the origin made of the points after it."""
    u = unit(p[2] - p[1]) if extra[0] else unit(v[0])
    return (dot(u, p[0] - _origin(p[1 + extra[0] :], v if extra[0] else v[1:], extra[1:])),)


def _agree(p, v, extra):
    """Cosine of the angle between a vector and p[0] -> p[1], or another vector: ±1 along a bar."""
    return (dot(unit(v[0]), unit(p[1] - p[0] if p else v[1])),)


def _about(p, v, extra):
    """Angle about an axis, of which `extra` says for axis, start and end whether they are vectors."""
    points, vectors = iter(p), iter(v)

    def read(vector):
        if vector:
            return next(vectors)
        start = next(points)
        return next(points) - start

    axis, start, to = (read(x) for x in extra)
    co, si = about(unit(axis), start, to)
    return (angle(co, si),)


def _from(p, v, extra):
    """Point p[0] from the origin made of the rest, in the axes of the drawing."""
    return tuple(p[0] - _origin(p[1:], v, extra))


def _unit(p, v, extra):
    return tuple(unit(p[1] - p[0] if p else v[0]))


def _across(p, v, extra):
    """Two directions across p[0] -> p[1], or across the vector; ``extra[0]`` is an axis that is not along it."""
    d = unit(p[1] - p[0] if p else v[0])
    first = unit(jnp.cross(d, jnp.eye(3)[extra[0]]))
    return (*first, *jnp.cross(d, first))


_PAIR = ("along", "across")
_HOW = {
    "length": (_length, ("length",)),
    "direction": (_direction, ("angle",)),
    "between": (_between, ("angle",)),
    "mean": (_mean, ("x", "y")),
    "mean in space": (_mean, ("x", "y", "z")),
    "local": (_local, _PAIR),
    "sliding": (_sliding, _PAIR),
    "normal": (_normal, ("normal", "offset")),
    "prismatic": (_prismatic, ("normal", "offset")),
    "signed": (_signed, ("distance",)),
    "agree": (_agree, ("sign",)),
    "about": (_about, ("angle",)),
    "along": (_along, ("distance",)),
    "from": (_from, ("x", "y", "z")),
    "unit": (_unit, ("x", "y", "z")),
    "across": (_across, ("x1", "y1", "z1", "x2", "y2", "z2")),
}
