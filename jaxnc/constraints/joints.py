"""Joints in the plane (source text §3.2 and the examples of §3.4) and in space (§4.2 and the examples of §4.4).

In space they are written over directions that are unit vectors or segments. Rows on velocities stand at the end.
"""

import math

from jaxnc.constraints.elementary import ratio, stacked, where
from jaxnc.constraints.kind import (
    Kind,
    RateKind,
    about,
    counts,
    cross,
    cross3,
    dot,
    kept_angle,
    norm,
    power,
    radius,
    reader,
    triple,
    unit,
    unit_of,
)
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


def _sign(x):
    return where(x < 0, -1.0, 1.0)


def _contact(p, v, s, c):
    d, w = p[1] - p[0], p[3] - p[2]
    k = c[1] * c[0] / c[2]
    return (w[0] + k * d[1], w[1] - k * d[0])


def _contact_drawn(p, v, s, c):
    d, w = p[1] - p[0], p[3] - p[2]
    return (norm(w), _sign(cross(d, w)), norm(d))


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
    radius, side = where(c[0] != 0, c[0], norm(w)), _sign(cross(d, w))
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


def _following(p, v, s, c):
    """Let the change of a coordinate from the drawing be a polynomial of that of another."""
    x = s[1] - c[1]
    return (s[0] - c[0] - (c[2] + x * (c[3] + x * (c[4] + x * (c[5] + x * c[6])))),)


FOLLOWING = Kind(
    "joint that follows another",
    _following,
    rows=("polynomial",),
    powers=(0,),
    scalars=2,
    constants=("home", "of", "a0", "a1", "a2", "a3", "a4"),
    drawn=lambda p, v, s, c: (s[0], s[1], c[2], c[3], c[4], c[5], c[6]),
    source="MuJoCo, XML reference, equality/joint",
)


# -- space ----------------------------------------------------------------------------------------------------------

COINCIDENT_IN_SPACE = Kind(
    "coincident in space",
    lambda p, v, s, c: tuple(p[1][i] - p[0][i] for i in range(3)),
    rows=("x", "y", "z"),
    powers=(1, 1, 1),
    points=2,
    source="§4.2.1: spherical joint between two bodies that do not share the point",
)


@factory
def aligned(form: str) -> Kind:
    """The segment between two points lies along a direction, (128)-(130): three rows, two independent."""
    read = reader("p" + form)

    def residual(p, v, s, c):
        w, d = read(p, v)
        return cross3(w, d)

    return Kind(
        f"aligned with {form}",
        residual,
        rows=("alignment yz", "alignment zx", "alignment xy"),
        powers=(1 + power(form),) * 3,
        **counts("p" + form),
        source="(81)-(83), (128)-(130), (131)-(133), (135)-(140), (178)-(183)",
    )


@factory
def parallel(forms: str) -> Kind:
    """Two directions stay parallel, the way they are drawn: equality of the vectors, three rows, two independent."""
    read = reader(forms)

    def residual(p, v, s, c):
        a, b = read(p, v)
        return tuple(a[i] - c[0] * b[i] for i in range(3))

    def drawn(p, v, s, c):
        a, b = read(p, v)
        return (_sign(dot(a, b)) * ratio(norm(a), norm(b)),)

    return Kind(
        f"parallel {forms}",
        residual,
        rows=("axis x", "axis y", "axis z"),
        powers=(power(forms[0]),) * 3,
        **counts(forms),
        constants=("ratio",),
        drawn=drawn,
        source="§4.2.2: equality of the axes of two bodies that do not share them",
    )


@factory
def no_turn(forms: str) -> Kind:
    """No relative rotation about an axis: the angle about it between two directions stays (forms of axis, a, b).

    ``cos α · sine part - sin α · cosine part = 0`` instead of the scalar product (134), (141), (184), which loses its
    rank where the directions are parallel and admits ± the angle (erratum 9).
    """
    read = reader(forms)

    def parts(p, v):
        axis, a, b = read(p, v)
        return about(unit_of(axis, forms[0]), a, b)

    return Kind(
        f"no turn {forms}",
        rows=("angle",),
        powers=(power(forms[1:]),),
        **counts(forms),
        **kept_angle(parts),
        source="(134), (141), (184) in the form of erratum 9",
    )


@factory
def constant_velocity(forms: str) -> Kind:
    """Constant-velocity joint between two shafts (forms of axis 1, mark 1, axis 2, mark 2).

    With e, f the mark and its quarter turn about each shaft's axis, ``e1 · f2 - f1 · e2 = 0``: one shaft's frame is the
    other's, turned without spin about the line across both axes. Marks are counted from their drawn phase.
    """
    read = reader(forms)

    def parts(p, v):
        axis1, mark1, axis2, mark2 = read(p, v)
        axis1, axis2 = unit(axis1), unit(axis2)
        e1, e2 = (unit(m - dot(m, a) * a) for m, a in ((mark1, axis1), (mark2, axis2)))
        f1, f2 = (stacked(cross3(a, e)) for a, e in ((axis1, e1), (axis2, e2)))
        return dot(e1, e2) + dot(f1, f2), dot(e1, f2) - dot(f1, e2)

    return Kind(
        f"constant velocity {forms}",
        rows=("no spin",),
        powers=(0,),
        **counts(forms),
        **kept_angle(parts),
        source="§4.2.5, last paragraph; the bisecting-plane condition in terms of the two shafts",
    )


@factory
def bevel(forms: str, internal: bool) -> Kind:
    """Two wheels on axes at any shaft angle (forms of axis 1, axis 2): ``R1 φ1 ± R2 φ2 = c`` (157) with erratum 7.

    Points: the two centres, then for each wheel its centre and a rim point (read for the radii). The sign follows from
    the drawing: for axes that meet, from the side of the meeting point on which each centre lies along its axis; for
    parallel ones from whether they point the same way.
    """
    read = reader(forms, 6)

    def sign(p, v):
        a, b = (unit(x) for x in read(p, v))
        w = p[1] - p[0]
        # Distances from the centres back to the common perpendicular (the apex, where the axes meet).
        ab = dot(a, b)
        t1, t2 = dot(w, a) - ab * dot(w, b), ab * dot(w, a) - dot(w, b)
        crossed = 1.0 - ab * ab > 1e-8  # parallel ones are so to a drawing's rounding
        sides = _sign(-t1) * _sign(-t2)
        known = (abs(t1) > 1e-9 * norm(w)) & (abs(t2) > 1e-9 * norm(w))
        met = where(known, sides, 1.0)
        return where(crossed, met, _sign(ab)) * (-1.0 if internal else 1.0)

    def drawn(p, v, s, c):
        a, b = (unit(x) for x in read(p, v))
        r1 = where(c[0] != 0, c[0], radius(a, p[3] - p[2]))
        r2 = where(c[1] != 0, c[1], radius(b, p[5] - p[4]))
        side = sign(p, v)
        return (r1, r2, side, r1 * s[0] + side * r2 * s[1])

    return Kind(
        f"{'internal ' if internal else ''}bevel gear {forms}",
        lambda p, v, s, c: (c[0] * s[0] + c[2] * c[1] * s[1] - c[3],),
        rows=("mesh",),
        powers=(1,),
        **counts(forms, 6),
        scalars=2,
        constants=("radius1", "radius2", "side", "constant"),
        drawn=drawn,
        source="(157) with signed angles (errata 3 and 7), any shaft angle",
    )


@factory
def rack(forms: str, rolls: bool) -> Kind:
    """A pinion on a rack (forms of the pinion's axis, the rack's line), (199): ``s - k R ψ = c``, k = ±1 as drawn.

    Points: the pinion's centre and a point of the rack's line. Where the pinion is drawn on the rack's line itself
    the side is not known, and k = 1. With `rolls` the line stands still and the disc rolls along it: k is reversed.
    """
    read = reader(forms, 2)

    def drawn(p, v, s, c):
        axis, line = read(p, v)
        line = unit(line)
        w = p[1] - p[0]
        across = w - dot(w, line) * line
        side = triple(axis, across, line)
        r = where(c[0] != 0, c[0], norm(across))
        k = where(abs(side) > 1e-6 * (norm(w) + r) * norm(axis), _sign(side), 1.0) * (-1.0 if rolls else 1.0)
        return (r, k, s[0] - k * r * s[1])

    return Kind(
        f"{'rolling in space' if rolls else 'rack and pinion'} {forms}",
        lambda p, v, s, c: (s[0] - c[1] * c[0] * s[1] - c[2],),
        rows=("no slip",),
        powers=(1,),
        **counts(forms, 2),
        scalars=2,
        constants=("radius", "side", "constant"),
        drawn=drawn,
        source="(199); the sign follows from the side of the rack on which the pinion is drawn",
    )


def _screw(per: str, radians: float) -> Kind:
    return Kind(
        f"screw by {per}",
        lambda p, v, s, c: (s[0] - c[0] * s[1] / radians - c[1],),
        rows=("advance",),
        powers=(1,),
        scalars=2,
        constants=(per, "constant"),
        drawn=lambda p, v, s, c: (c[0], s[0] - c[0] * s[1] / radians),
        source="cylindrical joint (128)-(130) whose advance is proportional to its turn",
    )


SCREW = {"lead": _screw("lead", 2.0 * math.pi), "pitch": _screw("pitch", 1.0)}


@factory
def contact(forms: str) -> Kind:
    """A disc's point of contact with a line (forms of the line, the disc's axis), as (55) with (57), in space.

    Points: centre, contact. From centre to contact it is one radius across the line and the disc's axis, on the drawn
    side.
    """
    read = reader(forms, 2)

    def across(p, v):
        line, axis = read(p, v)
        return unit(stacked(cross3(axis, line)))

    def residual(p, v, s, c):
        n, w = across(p, v), p[1] - p[0]
        return tuple(w[i] - c[1] * c[0] * n[i] for i in range(3))

    def drawn(p, v, s, c):
        w = p[1] - p[0]
        return (norm(w), _sign(dot(w, across(p, v))))

    return Kind(
        f"contact in space {forms}",
        residual,
        rows=("x", "y", "z"),
        powers=(1, 1, 1),
        **counts(forms, 2),
        constants=("radius", "side"),
        drawn=drawn,
        source="(55) with (57), (67) with (72), for a disc that rolls along a line in space",
    )


# -- rows on velocities ---------------------------------------------------------------------------------------------


def _side_slip(p, v, s, dp, dv, ds, c):
    d = p[2] - p[1]
    return (ratio(cross(d, dp[0]), norm(d)),)


SKATE = RateKind(
    "skate",
    _side_slip,
    rows=("side slip",),
    points=3,
    source="S. A. Chaplygin, on the motion of nonholonomic systems (1911): a knife edge moves along its heading only",
)
"""A point that moves along the direction from a second point to a third one, and never across it."""


def _height(p, v):
    return dot(p[0] - p[1], v[-1])


def _disc_radius(p, v, s, c):
    return (ratio(_height(p, v), norm(stacked(cross3(v[0], v[-1])))),)


def _touching(p, v, s, c):
    across = stacked(cross3(v[0], v[1]))
    height = _height(p, v)
    return (height * height - c[0] * c[0] * dot(across, across),)


TOUCHING = Kind(
    "touching",
    _touching,
    rows=("contact",),
    powers=(2,),
    points=2,
    vectors=2,
    constants=("radius",),
    drawn=_disc_radius,
    guard=lambda p, v, s, c: (c[0] * _height(p, v),),  # stays on its side
    source="the rim of a disc touches a plane: its centre is r sin(lean) above it",
)
"""A disc (centre; a point of the plane; its axis, the plane's normal) whose rim touches a plane."""


def _disc_slip(p, v, s, dp, dv, ds, c):
    u, w, n = v
    du, dw = dv[0], dv[1]
    lean = dot(n, u)
    sine = norm(stacked(cross3(u, n)))
    up = stacked([ratio(n[k] - lean * u[k], sine) for k in range(3)])  # from the contact to the centre
    # ω × up, from the rates of two directions of the disc: up = α u + β w + γ u × w.
    h = stacked(cross3(u, w))
    square = dot(h, h)
    beta, gamma = ratio(dot(up, w), square), ratio(dot(up, h), square)
    alpha = -beta * dot(u, w)
    dh = [a + b for a, b in zip(cross3(du, w), cross3(u, dw), strict=True)]
    slip = stacked([dp[0][k] - c[0] * (alpha * du[k] + beta * dw[k] + gamma * dh[k]) for k in range(3)])
    along = stacked([ratio(x, sine) for x in cross3(u, n)])
    return dot(slip, along), triple(slip, n, along)


ROLLING_DISC = RateKind(
    "rolling disc",
    _disc_slip,
    rows=("slip along", "slip across"),
    points=2,
    vectors=3,
    constants=("radius",),
    drawn=_disc_radius,
    source="E. J. Routh, Advanced Rigid Dynamics, on the rolling of a disc",
)
"""A disc (centre; a point of the plane; its axis, another of its directions, the plane's normal) that does not slip."""
