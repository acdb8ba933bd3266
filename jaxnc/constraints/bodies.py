"""Rigid bodies in the plane (source text §3.1) and in space (§4.1), and the constant distance in both.

In space a segment is a unit vector or the line between two points. A body is fixed by a base: one segment (all others
along it; the body then has five freedoms), two segments, or three of them in the text's own form.
"""

from typing import Any

from jaxnc.constraints.elementary import ratio, stacked, where
from jaxnc.constraints.kind import Kind, counts, cross, cross3, dot, norm, power, reader, triple
from jaxnc.pickling import factory


def _length_row(p, v, s, c):
    d = p[1] - p[0]
    return (dot(d, d) - c[0] * c[0],)


DISTANCE = Kind(
    "distance",
    _length_row,
    rows=("length",),
    powers=(2,),
    points=2,
    constants=("length",),
    drawn=lambda p, v, s, c: (norm(p[1] - p[0]),),
    source="(13)-(15), (18), (19), (23)-(27), (30)-(32), (43), (44), (48), (49), (54), (55), (61)-(68) in the plane; "
    "(76), (78), (84), (89), (90), (97)-(100), (104), (110), (116), (117), (151), (153), (158), (160), (161), (172), "
    "(175), (176), (200) in space",
)


def _attached_rows(p, v, s, c):
    d, w = p[1] - p[0], p[2] - p[0]
    return (w[0] - c[0] * d[0] + c[1] * d[1], w[1] - c[0] * d[1] - c[1] * d[0])


def _attached_drawn(p, v, s, c):
    d, w = p[1] - p[0], p[2] - p[0]
    return (ratio(dot(d, w), dot(d, d)), ratio(cross(d, w), dot(d, d)))


ATTACHED = Kind(
    "attached",
    _attached_rows,
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

# -- space ----------------------------------------------------------------------------------------------------------

UNIT = Kind(
    "unit vector",
    lambda p, v, s, c: (dot(v[0], v[0]) - 1.0,),
    rows=("unit length",),
    powers=(0,),
    vectors=1,
    source="(80), (91), (93), (105), (106), (111), (118), (162), (174), (187), (189), (190), (195)",
)


@factory
def product(forms: str) -> Kind:
    """Constant scalar product of two directions: keeps their angle (77), (92), (107)-(109), (119)-(121), (142)."""
    read = reader(forms)

    def value(p, v):
        a, b = read(p, v)
        return dot(a, b)

    return Kind(
        "scalar product" if forms == "pp" else f"scalar product {forms}",
        lambda p, v, s, c: (value(p, v) - c[0],),
        rows=("scalar product",),
        powers=(power(forms),),
        **counts(forms),
        constants=("product",),
        drawn=lambda p, v, s, c: (value(p, v),),
        source="(16), (36), (57), (70), (72) in the plane; (77), (79), (85)-(87), (92), (107)-(109), (112), "
        "(119)-(121), (134), (141), (142), (152), (154), (159), (163)-(165), (173), (177), (184), (186), (188), "
        "(191)-(194), (196) in space",
    )


SCALAR_PRODUCT = product("pp")


def _express_segment(name: str, forms: str, axes, coefficients, misfit: bool = False, **fields: Any) -> Kind:
    """A kind of three rows that expresses a segment, the last of its directions, in axes made of those before it.

    `axes` and `coefficients` are functions of the base's directions, the latter also of the segment as drawn. With
    `misfit` the axes may leave a rest, which then says how far the drawing is from the kind's class.
    """
    read = reader(forms)

    def rest(p, v, c):
        *base, w = read(p, v)
        return tuple(w[i] - sum(c[k] * axis[i] for k, axis in enumerate(axes(*base))) for i in range(3))

    def off(p, v, c):
        return ratio(norm(stacked(rest(p, v, c))), norm(read(p, v)[-1]))

    return Kind(
        name,
        lambda p, v, s, c: rest(p, v, c),
        rows=("x", "y", "z"),
        powers=(power(forms[-1]),) * 3,
        **counts(forms),
        drawn=lambda p, v, s, c: coefficients(*read(p, v)),
        misfit=off if misfit else None,
        **fields,
    )


def _in_two(a, b, w) -> tuple:
    """Coefficients of the part of w in the plane of a and b."""
    aa, bb, ab, wa, wb = dot(a, a), dot(b, b), dot(a, b), dot(w, a), dot(w, b)
    area = aa * bb - ab * ab
    return ratio(wa * bb - wb * ab, area), ratio(wb * aa - wa * ab, area)


def _in_three(a, b, c, w) -> tuple:
    volume = triple(a, b, c)
    return ratio(triple(w, b, c), volume), ratio(triple(a, w, c), volume), ratio(triple(a, b, w), volume)


@factory
def carried(forms: str) -> Kind:
    """A segment w fixed to a base of two segments a, b: ``w = α a + β b + γ a × b`` (forms of a, b, w).

    Replaces (104)-(109), (110)-(115) and (122)-(127): as many rows, no coplanar class, no mirrored twin.
    """
    return _express_segment(
        f"carried {forms}",
        forms,
        lambda a, b: (a, b, cross3(a, b)),
        lambda a, b, w: (*_in_two(a, b, w), ratio(triple(w, a, b), dot(a, a) * dot(b, b) - dot(a, b) * dot(a, b))),
        constants=("alpha", "beta", "gamma"),
        source="instead of (104)-(115) and (122)-(127): same number of rows, never degenerate, no mirrored twin",
    )


@factory
def combined(forms: str) -> Kind:
    """A segment w as a linear combination of a base of three segments (forms of a, b, c, w), (122)-(127)."""
    return _express_segment(
        f"combination of {forms}",
        forms,
        lambda a, b, c: (a, b, c),
        _in_three,
        constants=("alpha", "beta", "gamma"),
        source="(122)-(127) with erratum 4, (166)-(171)",
    )


@factory
def coplanar(forms: str) -> Kind:
    """A segment w in the plane of a base of two segments (forms of a, b, w), (113)-(115)."""
    return _express_segment(
        f"coplanar {forms}",
        forms,
        lambda a, b: (a, b),
        _in_two,
        misfit=True,
        constants=("lambda", "mu"),
        source="(113)-(115)",
    )


@factory
def collinear(forms: str) -> Kind:
    """A segment w along a base of one segment (forms of a, w), (94)-(96), (101)-(103) with erratum 1."""
    return _express_segment(
        f"collinear {forms}",
        forms,
        lambda a: (a,),
        lambda a, w: (ratio(dot(a, w), dot(a, a)),),
        misfit=True,
        constants=("ratio",),
        source="(94)-(96), (101)-(103), all three of them (erratum 1)",
    )


@factory
def handed(forms: str) -> Kind:
    """No equation: three segments of a body keep their handedness, which its rows (116)-(121) do not tell."""
    read = reader(forms)

    def volume(p, v):
        return triple(*read(p, v))

    return Kind(
        f"handed {forms}",
        lambda p, v, s, c: (),
        rows=(),
        powers=(),
        **counts(forms),
        constants=("side",),
        drawn=lambda p, v, s, c: (where(volume(p, v) < 0, -1.0, 1.0),),
        guard=lambda p, v, s, c: (c[0] * volume(p, v),),
        mirror=True,
        source="erratum 10",
    )
