"""Frames of planar parts by reference points, and what joints say about them (source text §2.2)."""

import math

import numpy as np

from jaxnc.constraints.elementary import cos, sin
from jaxnc.constraints.kind import Kind
from jaxnc.families.bodies import Part
from jaxnc.families.program import Arm, Frame, Linear, Place, Turn, scaled
from jaxnc.families.scribe import Scribe, fixed
from jaxnc.pickling import listed

PROJECTION = Kind(
    "projection",
    lambda p, v, s, c: ((p[0][0] - p[1][0]) * cos(s[0]) + (p[0][1] - p[1][1]) * sin(s[0]) - s[1],),
    rows=("distance",),
    points=2,
    scalars=2,
    source="(10): the projection of a vector on a direction of a body is constant",
)

EQUAL = Kind(
    "equal",
    lambda p, v, s, c: (s[0] - s[1],),
    rows=("angle",),
    powers=(0,),
    scalars=2,
    source="(9)",
)
listed(__name__, (PROJECTION, EQUAL))


def drawn_angle(home: np.ndarray, ends: tuple[int, ...]) -> float:
    """The drawn angle of a segment from the x axis, or from another segment, as the recipes read it."""
    spans = [home[b] - home[a] for a, b in zip(ends[::2], ends[1::2], strict=True)]
    d, w = (np.array([1.0, 0.0]), spans[0]) if len(spans) == 1 else spans
    return float(np.arctan2(d[0] * w[1] - d[1] * w[0], d @ w))


def segment(scribe: Scribe, part: Part, ends: tuple[int, int], axis: tuple[int, int], angle: Linear) -> Linear:
    """The angle of a segment of a part whose axis has an angle."""
    if ends == axis:
        return angle
    if ends == axis[::-1]:
        return angle + fixed(-math.pi)
    (turn,) = scribe.c("between", scribe.at((*axis, *ends), part))
    return angle + turn


def local(
    scribe: Scribe, part: Part, point: int, axis: tuple[int, int], origin: tuple[int, ...], how: tuple = ()
) -> tuple[Linear, ...]:
    """Components of a point in a frame with an axis, whose origin is the mean of some points, or made of them."""
    if how:
        along, across = scribe.c("local", scribe.at((point, *axis, *origin), part), (), how)
        return along, across
    if origin == (point,):
        return (), ()
    if set(origin) == set(axis) and point in axis:
        (length,) = scribe.c("length", scribe.at(axis, part))
        return scaled(length, -0.5 if point == axis[0] else 0.5), ()
    if origin == (axis[0],) and point == axis[1]:
        return scribe.c("length", scribe.at(axis, part))[0], ()
    if origin == (axis[1],) and point == axis[0]:
        return scaled(scribe.c("length", scribe.at(axis, part))[0], -1.0), ()
    along, across = scribe.c("local", scribe.at((point, *axis, *origin), part))
    return along, across


def names(part: Part) -> tuple[str, ...]:
    """Names of the variables of a part by its reference point."""
    if part.turns == "no":
        return f"{part.name}.x", f"{part.name}.y"
    return f"{part.name}.x", f"{part.name}.y", part.angle or f"{part.name}.psi"


def frame(scribe: Scribe, part: Part) -> Frame:
    """The frame of a part by its reference point and its angle."""
    x, y, *angle = names(part)
    origin: Place = (Arm(None, (scribe.s(x), scribe.s(y))),)
    return Frame(origin, Turn("angle", (scribe.s(angle[0]),)) if angle else None)


def readings(part: Part) -> list[tuple[str, str, tuple[int, ...], int]]:
    """Variables of a part: name, recipe, points, and which of the recipe's values; a mean is made as its origin is."""
    x, y, *angle = names(part)
    out = [(x, "mean", part.origin.points, 0), (y, "mean", part.origin.points, 1)]
    return out + [(name, "direction", part.axis, 0) for name in angle]
