"""Mixed coordinates (source text §3.3 and §4.3): angles and distances as variables of the problem.

In the plane an angle runs from the direction ``p[0] -> p[1]`` to the direction ``p[2] -> p[3]``, anticlockwise; in the
``…from x`` kinds it runs from the x axis to ``p[0] -> p[1]``. In space it is signed, about an axis.
"""

from collections.abc import Callable
from typing import Any

from jaxnc.constraints.elementary import angle, cos, sin, where
from jaxnc.constraints.kind import Kind, about, counts, cross, cross3, dot, norm, power, radius, reader, unit_of
from jaxnc.pickling import factory
from jaxnc.types import Array


def _measured_angle(parts: Callable[[Array, Array, Array], tuple]) -> dict[str, Any]:
    """The fields of a kind that measures an angle, from its cosine and sine parts at ``(p, v, c)``."""

    def guard(p, v, s, c):
        co, si = parts(p, v, c)
        return (co * cos(s[0]) + si * sin(s[0]),)

    def measure(p, v, c):
        co, si = parts(p, v, c)
        return angle(si, co)

    return {"guard": guard, "measure": measure}


# An angle row is built from dot = |d||w| cos φ and cross = |d||w| sin φ; `size` = |d||w| is the text's L12 L23.
_ANGLE_FORMS = {
    "exact": lambda co, si, size, f: (co * sin(f) - si * cos(f),),
    "cosine": lambda co, si, size, f: (co - size * cos(f),),
    "sine": lambda co, si, size, f: (si - size * sin(f),),
    "switched": lambda co, si, size, f: (where(abs(sin(f)) >= abs(cos(f)), co - size * cos(f), si - size * sin(f)),),
    "redundant": lambda co, si, size, f: (co - size * cos(f), si - size * sin(f)),
    "sum": lambda co, si, size, f: (co - size * cos(f) + (si - size * sin(f)),),
    "difference": lambda co, si, size, f: (co - size * cos(f) - (si - size * sin(f)),),
}
_ANGLE_SOURCES = {
    "exact": "(38) and (39) in one row, valid at every angle",
    "cosine": "(38), (45), (46), (53), (58), (73)",
    "sine": "(39)",
    "switched": "(38) or (39) by the rule of fig. 17",
    "redundant": "(38) and (39)",
    "sum": "(38) + (39)",
    "difference": "(38) - (39)",
}


def _angle(form: str, from_x: bool) -> Kind:
    rows = _ANGLE_FORMS[form]

    def parts(p):
        if from_x:
            d = p[1] - p[0]
            return d[0], d[1]
        d, w = p[1] - p[0], p[3] - p[2]
        return dot(d, w), cross(d, w)

    def lengths(p):
        return (norm(p[1] - p[0]),) if from_x else (norm(p[1] - p[0]), norm(p[3] - p[2]))

    def residual(p, v, s, c):
        co, si = parts(p)
        size = None if form == "exact" else c[0] if from_x else c[0] * c[1]
        return rows(co, si, size, s[0])

    labels = ("cosine", "sine") if form == "redundant" else ("angle",)
    return Kind(
        f"angle{' from x' if from_x else ''}{'' if form == 'exact' else ', ' + form}",
        residual,
        rows=labels,
        powers=(1 if from_x else 2,) * len(labels),
        points=2 if from_x else 4,
        scalars=1,
        constants=() if form == "exact" else ("length1",) if from_x else ("length1", "length2"),
        drawn=None if form == "exact" else (lambda p, v, s, c: lengths(p)),
        **_measured_angle(lambda p, v, c: parts(p)),
        source="(21)" if from_x and form == "cosine" else _ANGLE_SOURCES[form],
    )


ANGLE = {form: _angle(form, False) for form in _ANGLE_FORMS}
ANGLE_FROM_X = {form: _angle(form, True) for form in _ANGLE_FORMS}


# Rows of a distance along a line of direction d, from what the text's (41) and (42) leave along x and y.
_ALONG_FORMS = {
    "x": (lambda d, x, y: (x,), ("x",), "(41), (59), (74)"),
    "y": (lambda d, x, y: (y,), ("y",), "(42)"),
    "switched": (
        lambda d, x, y: (where(abs(d[0]) >= abs(d[1]), x, y),),
        ("distance",),
        "(41) or (42), changing at 45°",
    ),
    "redundant": (lambda d, x, y: (x, y), ("x", "y"), "(41) and (42)"),
    "sum": (lambda d, x, y: (x + y,), ("distance",), "(41) + (42)"),
    "difference": (lambda d, x, y: (x - y,), ("distance",), "(41) - (42)"),
}


# A distance along a line: points start, end, and the two points that give the line its direction; constant: the
# line's length L12, which the text takes from the body that carries the line.
def _distance_along_line(form: str) -> Kind:
    projected = (None, ("distance",), "(41) and (42) in one row, the projection on the line")
    rows, labels, source = _ALONG_FORMS.get(form, projected)

    def residual(p, v, s, c):
        w, d = p[1] - p[0], p[3] - p[2]
        if rows is None:
            return (dot(w, d) - s[0] * c[0],)
        return rows(d, w[0] - s[0] / c[0] * d[0], w[1] - s[0] / c[0] * d[1])

    return Kind(
        f"distance along, {form}",
        residual,
        rows=labels,
        powers=(1 if rows else 2,) * len(labels),
        points=4,
        scalars=1,
        constants=("line",),
        drawn=lambda p, v, s, c: (norm(p[3] - p[2]),),
        measure=lambda p, v, c: dot(p[1] - p[0], p[3] - p[2]) / c[0],
        source=source,
    )


DISTANCE_ALONG = {form: _distance_along_line(form) for form in ("exact", *_ALONG_FORMS)}

# The same projection where the line's own length is not constant (its two points belong to different bodies).
DISTANCE_ALONG_FREE = Kind(
    "distance along a free line",
    lambda p, v, s, c: (dot(p[1] - p[0], p[3] - p[2]) - s[0] * norm(p[3] - p[2]),),
    rows=("distance",),
    powers=(2,),
    points=4,
    scalars=1,
    measure=lambda p, v, c: dot(p[1] - p[0], p[3] - p[2]) / norm(p[3] - p[2]),
    source="(41) and (42) in one row, line of variable length",
)


def _squared_distance(p, v, s, c):
    d = p[1] - p[0]
    return (dot(d, d) - s[0] * s[0],)


DISTANCE_BETWEEN = Kind(
    "distance between",
    _squared_distance,
    rows=("distance",),
    powers=(2,),
    points=2,
    scalars=1,
    measure=lambda p, v, c: norm(p[1] - p[0]),
    guard=lambda p, v, s, c: (s[0],),
    source="(42b) in the plane, (150), (185), (198) in space: the positive root",
)

# -- space ----------------------------------------------------------------------------------------------------------

_ANGLE_ABOUT_SOURCES = {
    "exact": "(143) and (144)-(146) in one row, valid at every angle, with the projection of erratum 3",
    "cosine": "(143), (155), (156), (197), (201)",
    "sine": "(144)-(146) projected on the axis",
    "sine x": "(144)",
    "sine y": "(145)",
    "sine z": "(146)",
    "sines": "(144)-(146), all three",
    "redundant": "(143) and (144)-(146), all four",
    "switched": "(143), or (144)-(146) projected on the axis, by the rule of fig. 17",
}
ANGLE_ABOUT_FORMS = tuple(_ANGLE_ABOUT_SOURCES)


_ABOUT, _DRAWN = "angle about an axis ", "angle from the drawing "


@factory
def angle_about(form: str, forms: str) -> Kind:
    """The signed angle about an axis from one direction to another (forms of axis, start, to), (143)-(146)."""
    directions = reader(forms)

    def axis_and_ends(p, v):
        axis, a, b = directions(p, v)
        return unit_of(axis, forms[0]), a, b

    def sizes(p, v, s, c):
        axis, a, b = axis_and_ends(p, v)
        return (radius(axis, a), radius(axis, b))

    def residual(p, v, s, c):
        axis, a, b = axis_and_ends(p, v)
        size, (co, si), f = None if form == "exact" else c[0] * c[1], about(axis, a, b), s[0]
        if form in ("exact", "cosine", "sine", "switched"):
            return _ANGLE_FORMS[form](co, si, size, f)
        n = cross3(a - dot(a, axis) * axis, b - dot(b, axis) * axis)
        sines = tuple(n[i] - size * sin(f) * axis[i] for i in range(3))
        if form == "redundant":
            return (co - size * cos(f), *sines)
        return sines if form == "sines" else (sines["xyz".index(form[-1])],)

    labels = {"sines": ("sine x", "sine y", "sine z"), "redundant": ("cosine", "sine x", "sine y", "sine z")}
    rows = labels.get(form, (form if form.startswith("sine ") else "angle",))
    return Kind(
        f"{_ABOUT}{forms}" + ("" if form == "exact" else f", {form}"),
        residual,
        rows=rows,
        powers=(power(forms[1:]),) * len(rows),
        **counts(forms),
        scalars=1,
        constants=() if form == "exact" else ("radius1", "radius2"),
        drawn=None if form == "exact" else sizes,
        **_measured_angle(lambda p, v, c: about(*axis_and_ends(p, v))),
        source=_ANGLE_ABOUT_SOURCES[form],
    )


def axis_items(kind: Kind) -> tuple[int, ...]:
    """List which of an instance's points and then vectors are the axis of an angle in space; none of other kinds."""
    forms = kind.name.removeprefix(_ABOUT).removeprefix(_DRAWN)
    return () if forms == kind.name else (0, 1) if forms.startswith("p") else (kind.points,)


@factory
def angle_from_drawing(forms: str) -> Kind:
    """The signed angle about an axis of the ground by which a direction has turned since it was drawn."""
    read = reader(forms)

    def parts(p, v, c):
        axis, b = read(p, v)
        return about(unit_of(axis, forms[0]), c, b)

    return Kind(
        f"{_DRAWN}{forms}",
        lambda p, v, s, c: _ANGLE_FORMS["exact"](*parts(p, v, c), None, s[0]),
        rows=("angle",),
        powers=(2 * power(forms[1]),),
        **counts(forms),
        scalars=1,
        constants=("x", "y", "z"),
        drawn=lambda p, v, s, c: tuple(read(p, v)[1]),
        **_measured_angle(parts),
        source="(143)-(146), counted from the drawing",
    )


def from_drawing(kind: Kind) -> bool:
    """Tell whether a kind is an `angle_from_drawing`, whose constants are the direction of its zero."""
    return kind.name.startswith(_DRAWN)


_DISTANCE_SOURCES = {
    "exact": "(147)-(149) in one row, the projection on the axis",
    "x": "(147)",
    "y": "(148)",
    "z": "(149)",
    "switched": "(147), (148) or (149)",
    "redundant": "(147)-(149)",
}
DISTANCE_ALONG_FORMS = tuple(_DISTANCE_SOURCES)


@factory
def distance_along(form: str, direction: str) -> Kind:
    """The signed distance between two points along a direction, (147)-(149).

    ``exact`` is the projection on the direction, one row that is valid at every inclination; the text's own rows
    ``x``, ``y``, ``z`` hold where the points lie on a line along the direction.
    """
    read = reader("p" + direction)

    def residual(p, v, s, c):
        w, d = read(p, v)
        d = unit_of(d, direction)
        if form == "exact":
            return (dot(w, d) - s[0],)
        rows = tuple(w[i] - s[0] * d[i] for i in range(3))
        if form == "redundant":
            return rows
        if form != "switched":
            return (rows["xyz".index(form)],)
        x, y, z = (abs(d[i]) for i in range(3))
        return (where((x >= y) & (x >= z), rows[0], where(y >= z, rows[1], rows[2])),)

    def measure(p, v, c):
        w, d = read(p, v)
        return dot(w, unit_of(d, direction))

    rows = ("x", "y", "z") if form == "redundant" else (form if form in "xyz" else "distance",)
    return Kind(
        f"distance along {direction}, {form}",
        residual,
        rows=rows,
        powers=(1,) * len(rows),
        **counts("p" + direction),
        scalars=1,
        measure=measure,
        source=_DISTANCE_SOURCES[form],
    )
