"""Mixed coordinates in the plane (source text §3.3): angles and distances as variables of the problem.

An angle runs from the direction ``p[0] -> p[1]`` to the direction ``p[2] -> p[3]``, anticlockwise; in the ``…from x``
kinds it runs from the x axis to ``p[0] -> p[1]``.
"""

from jaxnc.constraints.elementary import angle, where
from jaxnc.constraints.kind import Kind, cross, dot, norm
from jaxnc.constraints.trigonometry import cos, sin

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

    def guard(p, v, s, c):
        co, si = parts(p)
        return (co * cos(s[0]) + si * sin(s[0]),)

    def measure(p, v, c):
        co, si = parts(p)
        return angle(si, co)

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
        measure=measure,
        guard=guard,
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
def _along(form: str) -> Kind:
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


DISTANCE_ALONG = {form: _along(form) for form in ("exact", *_ALONG_FORMS)}

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


def _squared(p, v, s, c):
    d = p[1] - p[0]
    return (dot(d, d) - s[0] * s[0],)


DISTANCE_BETWEEN = Kind(
    "distance between",
    _squared,
    rows=("distance",),
    powers=(2,),
    points=2,
    scalars=1,
    measure=lambda p, v, c: norm(p[1] - p[0]),
    guard=lambda p, v, s, c: (s[0],),
    source="(42b) in the plane, (150), (185), (198) in space: the positive root",
)
