"""Mixed coordinates in space (source text §4.3): signed angles about an axis, distances along one."""

from jaxnc.constraints.directions import about, counts, cross3, power, radius, reader, unit_of
from jaxnc.constraints.elementary import angle, where
from jaxnc.constraints.kind import Kind, dot
from jaxnc.constraints.trigonometry import cos, sin
from jaxnc.pickling import factory

_SOURCES = {
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
ANGLE_ABOUT_FORMS = tuple(_SOURCES)


@factory
def angle_about(form: str, forms: str) -> Kind:
    """The signed angle about an axis from one direction to another (forms of axis, start, to), (143)-(146)."""
    read = reader(forms)

    def parts(p, v):
        axis, a, b = read(p, v)
        return about(unit_of(axis, forms[0]), a, b)

    def sizes(p, v, s, c):
        axis, a, b = read(p, v)
        axis = unit_of(axis, forms[0])
        return (radius(axis, a), radius(axis, b))

    def residual(p, v, s, c):
        axis, a, b = read(p, v)
        axis, f = unit_of(axis, forms[0]), s[0]
        co, si = about(axis, a, b)
        if form == "exact":
            return (co * sin(f) - si * cos(f),)
        size = c[0] * c[1]
        cosine, sine = co - size * cos(f), si - size * sin(f)
        if form in ("cosine", "sine"):
            return (cosine if form == "cosine" else sine,)
        if form == "switched":
            return (where(abs(sin(f)) >= abs(cos(f)), cosine, sine),)
        across_a, across_b = a - dot(a, axis) * axis, b - dot(b, axis) * axis
        n = cross3(across_a, across_b)
        sines = tuple(n[i] - size * sin(f) * axis[i] for i in range(3))
        if form == "redundant":
            return (cosine, *sines)
        return sines if form == "sines" else (sines["xyz".index(form[-1])],)

    def guard(p, v, s, c):
        co, si = parts(p, v)
        return (co * cos(s[0]) + si * sin(s[0]),)

    def measure(p, v, c):
        co, si = parts(p, v)
        return angle(si, co)

    labels = {"sines": ("sine x", "sine y", "sine z"), "redundant": ("cosine", "sine x", "sine y", "sine z")}
    rows = labels.get(form, (form if form.startswith("sine ") else "angle",))
    return Kind(
        f"angle about an axis {forms}" + ("" if form == "exact" else f", {form}"),
        residual,
        rows=rows,
        powers=(power(forms[1:]),) * len(rows),
        **counts(forms),
        scalars=1,
        constants=() if form == "exact" else ("radius1", "radius2"),
        drawn=None if form == "exact" else sizes,
        measure=measure,
        guard=guard,
        source=_SOURCES[form],
    )


@factory
def angle_from_drawing(forms: str) -> Kind:
    """The signed angle about an axis of the ground by which a direction has turned since it was drawn."""
    read = reader(forms)

    def parts(p, v, c):
        axis, b = read(p, v)
        return about(unit_of(axis, forms[0]), c, b)

    def residual(p, v, s, c):
        co, si = parts(p, v, c)
        return (co * sin(s[0]) - si * cos(s[0]),)

    def guard(p, v, s, c):
        co, si = parts(p, v, c)
        return (co * cos(s[0]) + si * sin(s[0]),)

    def measure(p, v, c):
        co, si = parts(p, v, c)
        return angle(si, co)

    return Kind(
        f"angle from the drawing {forms}",
        residual,
        rows=("angle",),
        powers=(2 * power(forms[1]),),
        **counts(forms),
        scalars=1,
        constants=("x", "y", "z"),
        drawn=lambda p, v, s, c: tuple(read(p, v)[1]),
        measure=measure,
        guard=guard,
        source="(143)-(146), counted from the drawing",
    )


def from_drawing(kind: Kind) -> bool:
    """Whether a kind is an `angle_from_drawing`, whose constants are the direction of its zero."""
    return kind.name.startswith("angle from the drawing ")


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
