"""Joints in the plane (source text §3.2 and the examples of §3.4)."""

from jaxnc.constraints.elementary import where
from jaxnc.constraints.kind import Kind, cross, dot, kept_angle, norm
from jaxnc.pickling import factory

COINCIDENT = Kind(
    "coincident",
    lambda p, v, s, c: tuple(p[1][i] - p[0][i] for i in range(2)),
    rows=("x", "y"),
    powers=(1, 1),
    points=2,
    source="§3.2.1, revolute joint between bodies that do not share the point; (3)-(8), (11), (12) over their frames",
)

ALIGNED = Kind(
    "aligned",
    lambda p, v, s, c: (cross(p[1] - p[0], p[2] - p[0]),),
    rows=("alignment",),
    powers=(2,),
    points=3,
    source="(17), (20), (35), (37), (50)-(52), (56), (69), (71)",
)


def _fixed_angle(p, v):
    d, w = p[1] - p[0], p[3] - p[2]
    return dot(d, w), cross(d, w)


FIXED_ANGLE = Kind(
    "fixed angle",
    rows=("angle",),
    powers=(2,),
    points=4,
    **kept_angle(_fixed_angle),
    source="(36) in the form of erratum 9, which keeps its rank at every angle",
)

PERPENDICULAR = Kind(
    "perpendicular",
    lambda p, v, s, c: (dot(p[1] - p[0], p[3] - p[2]),),
    rows=("perpendicularity",),
    powers=(2,),
    points=4,
    source="(57), (72)",
)


def _side(d, w):
    return where(cross(d, w) < 0, -1.0, 1.0)


def _contact(p, v, s, c):
    d, w = p[1] - p[0], p[3] - p[2]
    k = c[1] * c[0] / c[2]
    return (w[0] + k * d[1], w[1] - k * d[0])


def _contact_drawn(p, v, s, c):
    d, w = p[1] - p[0], p[3] - p[2]
    return (norm(w), _side(d, w), norm(d))


CONTACT = Kind(
    "contact",
    _contact,
    rows=("x", "y"),
    powers=(1, 1),
    points=4,
    constants=("radius", "side", "line"),
    drawn=_contact_drawn,
    source="(55) with (57), (67) with (72): centre to contact point is one radius across the line, on the drawn side",
)


def _rolling_drawn(p, v, s, c):
    d, w = p[1] - p[0], p[3] - p[2]
    radius, side = where(c[0] != 0, c[0], norm(w)), _side(d, w)
    return (radius, side, s[0] - side * radius * s[1])


ROLLING = Kind(
    "rolling",
    lambda p, v, s, c: (s[0] - c[1] * c[0] * s[1] - c[2],),
    rows=("no slip",),
    powers=(1,),
    points=4,
    scalars=2,
    constants=("radius", "side", "constant"),
    drawn=_rolling_drawn,
    source="(60), (75); the sign follows from the side of the line on which the disc is drawn",
)


def _gear(sign):
    def drawn(p, v, s, c):
        r1 = where(c[0] != 0, c[0], norm(p[1] - p[0]))
        r2 = where(c[1] != 0, c[1], norm(p[3] - p[2]))
        return (r1, r2, r1 * s[0] + sign * r2 * s[1])

    return Kind(
        "external gear" if sign > 0 else "internal gear",
        lambda p, v, s, c: (c[0] * s[0] + sign * c[1] * s[1] - c[2],),
        rows=("mesh",),
        powers=(1,),
        points=4,
        scalars=2,
        constants=("radius1", "radius2", "constant"),
        drawn=drawn,
        source="(47) with signed angles (erratum 7)",
    )


EXTERNAL_GEAR = _gear(1.0)
INTERNAL_GEAR = _gear(-1.0)


@factory
def cable(count: int) -> Kind:
    """An inextensible cable through `count` points: the sum of its straight segments is constant (§3.3)."""

    def total(p):
        return sum(norm(p[i + 1] - p[i]) for i in range(count - 1))

    return Kind(
        f"cable of {count}",
        lambda p, v, s, c: (total(p) - c[0],),
        rows=("length",),
        powers=(1,),
        points=count,
        constants=("length",),
        drawn=lambda p, v, s, c: (total(p),),
        source="§3.3, inextensible cable",
    )


@factory
def relation(count: int) -> Kind:
    """A linear relation ``k1 s1 + … + kn sn = constant`` between `count` scalars."""

    def total(s, c):
        return sum(c[i] * s[i] for i in range(count))

    return Kind(
        f"relation of {count}",
        lambda p, v, s, c: (total(s, c) - c[count],),
        rows=("relation",),
        powers=(None,),
        scalars=count,
        constants=(*(f"factor{i + 1}" for i in range(count)), "constant"),
        drawn=lambda p, v, s, c: (*(c[i] for i in range(count)), total(s, c)),
        source="(47), (60), (75) in general",
    )
