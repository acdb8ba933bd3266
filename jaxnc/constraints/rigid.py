"""Rigid bodies in the plane (source text §3.1) and the constant distance in any dimension."""

from jaxnc.constraints.elementary import ratio, stacked
from jaxnc.constraints.kind import Kind, cross, dot, norm


def _distance(p, v, s, c):
    d = p[1] - p[0]
    return (dot(d, d) - c[0] * c[0],)


DISTANCE = Kind(
    "distance",
    _distance,
    rows=("length",),
    powers=(2,),
    points=2,
    constants=("length",),
    drawn=lambda p, v, s, c: (norm(p[1] - p[0]),),
    source="(13)-(15), (18), (19), (23)-(27), (30)-(32), (43), (44), (48), (49), (54), (55), (61)-(68) in the plane; "
    "(76), (78), (84), (89), (90), (97)-(100), (104), (110), (116), (117), (151), (153), (158), (160), (161), (172), "
    "(175), (176), (200) in space",
)


def _attached(p, v, s, c):
    d, w = p[1] - p[0], p[2] - p[0]
    return (w[0] - c[0] * d[0] + c[1] * d[1], w[1] - c[0] * d[1] - c[1] * d[0])


def _attached_drawn(p, v, s, c):
    d, w = p[1] - p[0], p[2] - p[0]
    return (ratio(dot(d, w), dot(d, d)), ratio(cross(d, w), dot(d, d)))


ATTACHED = Kind(
    "attached",
    _attached,
    rows=("x", "y"),
    powers=(1, 1),
    points=3,
    constants=("along", "across"),
    drawn=_attached_drawn,
    source="replaces (25)-(26), (28)-(29), (33)-(34): same number of rows, never degenerate, no mirrored twin",
)


def _proportional(p, v, s, c):
    d, w = p[1] - p[0], p[2] - p[0]
    return tuple(w[i] - c[0] * d[i] for i in range(2))


PROPORTIONAL = Kind(
    "proportional",
    _proportional,
    rows=("x", "y"),
    powers=(1, 1),
    points=3,
    constants=("ratio",),
    drawn=lambda p, v, s, c: (ratio(dot(p[1] - p[0], p[2] - p[0]), dot(p[1] - p[0], p[1] - p[0])),),
    misfit=lambda p, v, c: ratio(norm(stacked(_proportional(p, v, None, c))), norm(p[2] - p[0])),
    source="(28)-(29)",
)


def _combination(p, v, s, c):
    a, b, w = p[0] - p[1], p[2] - p[1], p[3] - p[1]
    return tuple(w[i] - c[0] * a[i] - c[1] * b[i] for i in range(2))


def _combination_drawn(p, v, s, c):
    a, b, w = p[0] - p[1], p[2] - p[1], p[3] - p[1]
    area = cross(a, b)
    return (ratio(cross(w, b), area), ratio(cross(a, w), area))


COMBINATION = Kind(
    "combination",
    _combination,
    rows=("x", "y"),
    powers=(1, 1),
    points=4,
    constants=("lambda", "mu"),
    drawn=_combination_drawn,
    source="(33)-(34)",
)
