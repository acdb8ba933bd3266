"""Every kind of constraint in space against formulas written by hand from the text, for every choice of forms.

The planar kinds are in test_catalogue.py. Here a family of kinds has one formula, in NumPy: of its rows, of the
constants that it reads off a drawing, and of its guard, each a function of ``(forms, p, v, s, c)``.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product as every

import numpy as np
import pytest
from test_catalogue import HAND

import jaxnc as nc
from jaxnc.constraints import CATALOGUE, Kind
from jaxnc.system.structure import pattern, quadratic

ROUNDING = 1e-11  # sums of a dozen products of numbers up to ten
TURN = 2 * np.pi


def taken(forms, p, v, first=0):
    """Directions of an instance: unit vectors in order, segments between consecutive points from the `first` on."""
    points, vectors = iter(p[first:]), iter(v)
    return [next(vectors) if form == "v" else -next(points) + next(points) for form in forms]


def normal(a):
    return a / np.linalg.norm(a)


def across(a, n):
    """The part of a across n."""
    return a - np.dot(a, normal(n)) * normal(n)


def seen(axis, a, b):
    """The angle from a to b as seen along an axis, and the product of their lengths as seen."""
    a, b = across(a, axis), across(b, axis)
    size = np.linalg.norm(a) * np.linalg.norm(b)
    return np.arctan2(np.dot(normal(axis), np.cross(a, b)), np.dot(a, b)), size


def twist(axis1, mark1, axis2, mark2):
    """The spin from mark 2 to mark 1 that the shortest rotation of one axis to the other leaves (Rodrigues)."""
    a, b, e = normal(axis1), normal(axis2), across(mark1, axis1)
    w, cosine = np.cross(a, b), np.dot(a, b)
    swung = e * cosine + np.cross(w, e) + w * np.dot(w, e) / (1 + cosine)
    return seen(b, mark2, swung)[0], 1 + cosine


def mesh(a, b, first, second, internal):
    """The sign in R1 φ1 ± R2 φ2 = c: both wheels have the same velocity at a point where they touch."""
    ha, hb = np.linalg.lstsq(np.column_stack([a, -b]), second - first, rcond=None)[0]  # from the centres to the apex
    line = -np.sign(ha) * normal(a) - np.sign(hb) * normal(b)
    return -np.sign(np.dot(np.cross(a, line), np.cross(b, line))) * (-1 if internal else 1)


def off_line(a, d):
    return np.linalg.norm(across(a, d))


@dataclass(frozen=True)
class Family:
    """Formulas of a family of kinds; `fit` changes a random drawing into one that the kind is for."""

    rows: Callable
    constants: Callable | None = None
    guard: Callable | None = None
    fit: Callable | None = None


def segments(rows, constants, fit=None, guard=None):
    """A family whose formulas are functions of its directions ``(*directions, c)``."""
    return Family(
        lambda f, p, v, s, c: rows(*taken(f, p, v), c),
        lambda f, p, v, s, c: constants(*taken(f, p, v)),
        None if guard is None else lambda f, p, v, s, c: guard(*taken(f, p, v), c),
        fit,
    )


def solved(*columns):
    """Components of the last column along the others, by least squares."""
    return np.linalg.lstsq(np.column_stack(columns[:-1]), columns[-1], rcond=None)[0]


def last_along(combine):
    """Change a drawing so that its last direction is a combination of the others."""

    def fit(forms, p, v):
        *base, old = taken(forms, p, v)
        new = combine(*base)
        if forms[-1] == "v":
            v[-1] = new
        else:
            p[-1] += new - old

    return fit


def angle(form):
    def rows(axis, a, b, s, c):
        f, (alpha, size) = s[0], seen(axis, a, b)
        if form == "exact":
            return [size * np.sin(f - alpha)]
        given = c[0] * c[1]
        cosine, sine = size * np.cos(alpha) - given * np.cos(f), size * np.sin(alpha) - given * np.sin(f)
        sines = np.cross(across(a, axis), across(b, axis)) - given * np.sin(f) * normal(axis)
        return {
            "cosine": [cosine],
            "sine": [sine],
            "switched": [cosine if abs(np.sin(f)) >= abs(np.cos(f)) else sine],
            "sines": list(sines),
            **{f"sine {x}": [sines[i]] for i, x in enumerate("xyz")},
            "redundant": [cosine, *sines],
        }[form]

    def guard(f, p, v, s, c):
        alpha, size = seen(*taken(f, p, v))
        return [size * np.cos(s[0] - alpha)]

    return Family(
        lambda f, p, v, s, c: rows(*taken(f, p, v), s, c),
        None if form == "exact" else lambda f, p, v, s, c: [off_line(x, taken(f, p, v)[0]) for x in taken(f, p, v)[1:]],
        guard,
    )


def distance(form):
    def rows(f, p, v, s, c):
        w, d = p[1] - p[0], taken(f, p, v, 2)[0]
        d = d if f == "v" else normal(d)
        rest = w - s[0] * d
        one = {"x": 0, "y": 1, "z": 2, "switched": int(np.argmax(np.abs(d)))}
        return [w @ d - s[0]] if form == "exact" else list(rest) if form == "redundant" else [rest[one[form]]]

    def fit(f, p, v):
        p[1] = p[0] + 0.8 * taken(f, p, v, 2)[0]

    return Family(rows, fit=None if form == "exact" else fit)


def wheels(internal):
    def constants(f, p, v, s, c):
        a, b = taken(f, p, v, 6)
        radii = off_line(p[3] - p[2], a), off_line(p[5] - p[4], b)
        sign = mesh(a, b, p[0], p[1], internal)
        return [*radii, sign, radii[0] * s[0] + sign * radii[1] * s[1]]

    def fit(f, p, v):  # axes that meet
        a, b = taken(f, p, v, 6)
        p[1] = p[0] + 0.7 * a - 1.3 * b

    return Family(lambda f, p, v, s, c: [c[0] * s[0] + c[2] * c[1] * s[1] - c[3]], constants, fit=fit)


def pinion(rolls):
    def constants(f, p, v, s, c):
        axis, line = taken(f, p, v, 2)
        r = off_line(p[1] - p[0], line)
        # The pinion's point on the rack, with one radian per second.
        sign = np.sign(np.dot(np.cross(axis, across(p[1] - p[0], line)), line)) * (-1 if rolls else 1)
        return [r, sign, s[0] - sign * r * s[1]]

    return Family(lambda f, p, v, s, c: [s[0] - c[1] * c[0] * s[1] - c[2]], constants)


def screw(radians):
    return Family(
        lambda f, p, v, s, c: [s[0] - c[0] * s[1] / radians - c[1]],
        lambda f, p, v, s, c: [c[0], s[0] - c[0] * s[1] / radians],
    )


def touching(f, p, v, s, c):
    line, axis = taken(f, p, v, 2)
    return list(p[1] - p[0] - c[1] * c[0] * normal(np.cross(axis, line)))


def touch(f, p, v):
    line, axis = taken(f, p, v, 2)
    new = across(axis, line)
    if f[1] == "v":
        v[-1] = normal(new)
    else:
        p[-1] += new - axis
    p[1] = p[0] - 0.7 * normal(np.cross(new, line))


def from_drawing(f, p, v, c):
    axis, b = taken(f, p, v)
    return seen(axis, c, b)


FAMILIES = {
    "unit vector": Family(lambda f, p, v, s, c: [v[0] @ v[0] - 1]),
    "coincident in space": Family(lambda f, p, v, s, c: list(p[1] - p[0])),
    "scalar product": segments(lambda a, b, c: [a @ b - c[0]], lambda a, b: [a @ b]),
    "carried": segments(
        lambda a, b, w, c: list(w - c[0] * a - c[1] * b - c[2] * np.cross(a, b)),
        lambda a, b, w: solved(a, b, np.cross(a, b), w),
    ),
    "combination of": segments(
        lambda a, b, d, w, c: list(w - c[0] * a - c[1] * b - c[2] * d), lambda a, b, d, w: solved(a, b, d, w)
    ),
    "coplanar": segments(
        lambda a, b, w, c: list(w - c[0] * a - c[1] * b),
        lambda a, b, w: solved(a, b, w),
        last_along(lambda a, b: 0.3 * a - 1.7 * b),
    ),
    "collinear": segments(
        lambda a, w, c: list(w - c[0] * a), lambda a, w: solved(a, w), last_along(lambda a: -1.4 * a)
    ),
    "handed": segments(
        lambda a, b, d, c: [],
        lambda a, b, d: [np.sign(np.linalg.det([a, b, d]))],
        guard=lambda a, b, d, c: [c[0] * np.linalg.det([a, b, d])],
    ),
    "aligned with": Family(lambda f, p, v, s, c: list(np.cross(p[1] - p[0], taken(f, p, v, 2)[0]))),
    "parallel": segments(
        lambda a, b, c: list(a - c[0] * b),
        lambda a, b: [np.sign(a @ b) * np.linalg.norm(a) / np.linalg.norm(b)],
        last_along(lambda a: -0.6 * a),
    ),
    "no turn": segments(
        lambda n, a, b, c: [(c[0] * np.sin(seen(n, a, b)[0]) - c[1] * np.cos(seen(n, a, b)[0])) * seen(n, a, b)[1]],
        lambda n, a, b: [np.cos(seen(n, a, b)[0]), np.sin(seen(n, a, b)[0])],
        guard=lambda n, a, b, c: [seen(n, a, b)[1] * np.dot(c, [np.cos(seen(n, a, b)[0]), np.sin(seen(n, a, b)[0])])],
    ),
    "constant velocity": segments(
        lambda *d: [twist(*d[:4])[1] * (d[4][0] * np.sin(twist(*d[:4])[0]) - d[4][1] * np.cos(twist(*d[:4])[0]))],
        lambda *d: [np.cos(twist(*d)[0]), np.sin(twist(*d)[0])],
        guard=lambda *d: [twist(*d[:4])[1] * (d[4][0] * np.cos(twist(*d[:4])[0]) + d[4][1] * np.sin(twist(*d[:4])[0]))],
    ),
    "bevel gear": wheels(False),
    "internal bevel gear": wheels(True),
    "rack and pinion": pinion(False),
    "rolling in space": pinion(True),
    "screw by lead": screw(TURN),
    "screw by pitch": screw(1.0),
    "touching": Family(
        lambda f, p, v, s, c: [np.dot(p[0] - p[1], v[1]) ** 2 - c[0] ** 2 * (1 - np.dot(v[0], v[1]) ** 2)],
        lambda f, p, v, s, c: [np.dot(p[0] - p[1], v[1]) / np.sqrt(1 - np.dot(v[0], v[1]) ** 2)],
        lambda f, p, v, s, c: [c[0] * np.dot(p[0] - p[1], v[1])],
    ),
    "contact in space": Family(
        touching,
        lambda f, p, v, s, c: [
            np.linalg.norm(p[1] - p[0]),
            np.sign(np.dot(p[1] - p[0], np.cross(*taken(f, p, v, 2)[::-1]))),
        ],
        fit=touch,
    ),
    "angle from the drawing": Family(
        lambda f, p, v, s, c: [from_drawing(f, p, v, c)[1] * np.sin(s[0] - from_drawing(f, p, v, c)[0])],
        lambda f, p, v, s, c: list(taken(f, p, v)[1]),
        lambda f, p, v, s, c: [from_drawing(f, p, v, c)[1] * np.cos(s[0] - from_drawing(f, p, v, c)[0])],
    ),
}
DIRECTIONS = {
    "unit vector": None,
    "coincident in space": None,
    "screw by lead": None,
    "screw by pitch": None,
    "touching": None,
    "aligned with": 1,
    "carried": 3,
    "coplanar": 3,
    "handed": 3,
    "no turn": 3,
    "combination of": 4,
    "constant velocity": 4,
}


def named():
    """Every kind in space by its name: family and forms."""
    for name, family in FAMILIES.items():
        count = DIRECTIONS.get(name, 2)
        for forms in every("vp", repeat=count) if count else [()]:
            plain = name == "scalar product" and forms == ("p", "p")
            yield name if count is None or plain else f"{name} {''.join(forms)}", (family, "".join(forms))
    for form in ("exact", "cosine", "sine", "sine x", "sine y", "sine z", "sines", "redundant", "switched"):
        for forms in map("".join, every("vp", repeat=3)):
            yield f"angle about an axis {forms}" + ("" if form == "exact" else f", {form}"), (angle(form), forms)
    for form in ("exact", "x", "y", "z", "switched", "redundant"):
        for forms in "vp":
            yield f"distance along {forms}, {form}", (distance(form), forms)


SPATIAL = dict(named())
# What the plane and space have in common, by the formulas of the plane.
BOTH = {
    name: (Family(lambda f, p, v, s, c, rows=HAND[name]: rows(p, s, c)), "")
    for name in ("distance", "distance between", "cable of 3", "relation of 2")
}


def test_every_kind_has_a_formula():
    assert {*HAND, *SPATIAL} == set(CATALOGUE)
    assert set(HAND) & set(SPATIAL) == {"scalar product"}


def draw(rng, kind: Kind):
    """A random instance; its vectors are unit vectors."""
    v = rng.normal(size=(kind.vectors, 3))
    return (
        rng.uniform(-2, 2, (kind.points, 3)),
        v / np.linalg.norm(v, axis=1, keepdims=True),
        rng.uniform(-2, 2, kind.scalars),
        rng.uniform(0.5, 2, len(kind.constants)),
    )


def numbers(values):
    return np.array([float(x) for x in values])


@pytest.mark.parametrize("name", sorted({**SPATIAL, **BOTH}))
def test_rows_and_guard_agree_with_the_formulas(name):
    kind, (family, forms), rng = CATALOGUE[name], {**SPATIAL, **BOTH}[name], np.random.default_rng(12)
    assert len(kind.rows) == len(kind.powers)
    for _ in range(4):
        p, v, s, c = draw(rng, kind)
        got = numbers(kind.residual(p, v, s, c))
        want = np.array(family.rows(forms, p, v, s, c), dtype=float)
        assert got.shape == want.shape == (len(kind.rows),)
        np.testing.assert_allclose(got, want, atol=ROUNDING)
        if kind.guard and family.guard:
            np.testing.assert_allclose(numbers(kind.guard(p, v, s, c)), family.guard(forms, p, v, s, c), atol=ROUNDING)
    if name in SPATIAL:
        assert (kind.guard is None) == (family.guard is None)


@pytest.mark.parametrize("name", [n for n, k in sorted(CATALOGUE.items()) if n in SPATIAL and k.constants])
def test_constants_are_read_off_the_drawing(name):
    """Constants agree with the formulas, and make the drawing a solution that the guard accepts."""
    kind, (family, forms), rng = CATALOGUE[name], SPATIAL[name], np.random.default_rng(13)
    for _ in range(4):
        p, v, s, given = draw(rng, kind)
        if not name.startswith("screw"):
            given = np.zeros_like(given)
        if family.fit:
            family.fit(forms, p, v)
        c = numbers(kind.drawn(p, v, s, given))
        assert c.shape == (len(kind.constants),)
        np.testing.assert_allclose(c, family.constants(forms, p, v, s, given), atol=ROUNDING)
        if kind.measure:
            s = numbers([kind.measure(p, v, c)])
        np.testing.assert_allclose(numbers(kind.residual(p, v, s, c)), 0.0, atol=ROUNDING)
        assert kind.guard is None or (numbers(kind.guard(p, v, s, c)) > 0).all()


@pytest.mark.parametrize("name", [n for n, k in sorted(CATALOGUE.items()) if n in SPATIAL and k.measure])
def test_measured_coordinates_satisfy_their_rows(name):
    kind, (family, forms), rng = CATALOGUE[name], SPATIAL[name], np.random.default_rng(14)
    for _ in range(4):
        p, v, s, c = draw(rng, kind)
        if family.fit:
            family.fit(forms, p, v)
        if kind.constants and "angle from" not in name:
            c = numbers(kind.drawn(p, v, s, np.zeros_like(c)))
        s = numbers([kind.measure(p, v, c)])
        np.testing.assert_allclose(numbers(kind.residual(p, v, s, c)), 0.0, atol=ROUNDING)
        if kind.guard:
            assert (numbers(kind.guard(p, v, s, c)) > 0).all()
            over = numbers(kind.guard(p, v, s + np.pi, c))
            assert (over < 0).all(), "half a turn too much is not the same angle"


@pytest.mark.parametrize("name", sorted({**SPATIAL, **BOTH}))
def test_structure_and_degree(name):
    """The structure read is where the formula's derivatives are, and a quadratic kind has no third difference."""
    kind, (family, forms), rng = CATALOGUE[name], {**SPATIAL, **BOTH}[name], np.random.default_rng(15)
    cut = np.cumsum([3 * kind.points, 3 * kind.vectors])
    count = cut[1] + kind.scalars
    found = np.zeros((len(kind.rows), count), dtype=bool)

    def rows(function, x, c):
        p, v, s = np.split(x, cut)
        return np.array(function(p.reshape(-1, 3), v.reshape(-1, 3), s, c), dtype=float)

    for _ in range(24 if "switched" in name else 3):
        p, v, s, c = draw(rng, kind)
        x = np.concatenate([p.reshape(-1), v.reshape(-1), s])
        for k, step in enumerate(1e-4 * np.eye(count)):
            change = rows(lambda *a: family.rows(forms, *a), x + step, c) - rows(
                lambda *a: family.rows(forms, *a), x - step, c
            )
            found[:, k] |= np.abs(change) > 1e-9
        if quadratic(kind, 3):
            d, at = rng.uniform(-1, 1, count), lambda k, x=x, c=c: rows(kind.residual, x + k * d, c)  # noqa: B023
            np.testing.assert_allclose(at(3) - 3 * at(2) + 3 * at(1) - at(0), 0.0, atol=ROUNDING)
    np.testing.assert_array_equal(pattern(kind, 3), found)


def test_misfit_is_what_leaves_the_class():
    """The part of a segment that sticks out of the line, or out of the plane, that its kind is for."""
    rng = np.random.default_rng(16)
    for name, base in (("collinear", 1), ("coplanar", 2)):
        for forms in map("".join, every("vp", repeat=base + 1)):
            kind = CATALOGUE[f"{name} {forms}"]
            p, v, s, c = draw(rng, kind)
            *others, w = taken(forms, p, v)
            c = numbers(kind.drawn(p, v, s, np.zeros_like(c)))
            rest = w - np.column_stack(others) @ solved(*others, w)
            assert float(kind.misfit(p, v, c)) == pytest.approx(np.linalg.norm(rest) / np.linalg.norm(w), abs=1e-12)
            FAMILIES[name].fit(forms, p, v)
            c = numbers(kind.drawn(p, v, s, np.zeros_like(c)))
            assert float(kind.misfit(p, v, c)) < 1e-14


def test_radii_given_win_and_gears_that_do_not_meet_have_a_sign():
    """Explicit radii; parallel axes: plus if they point the same way; a centre in the apex: plus."""
    for internal, name in ((False, "bevel gear vv"), (True, "internal bevel gear vv")):
        kind = CATALOGUE[name]
        z, x = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
        p = np.array([[0.0, 0, 0], [3.0, 0, 0], [0.0, 0, 0], [1.0, 0, 0], [3.0, 0, 0], [1.0, 0, 0]])
        for b, sign in ((z, 1.0), (-z, -1.0), (x, 1.0)):
            c = numbers(kind.drawn(p, np.array([z, b]), np.array([0.3, 0.2]), np.array([5.0, 7.0, 0.0, 0.0])))
            sign *= -1.0 if internal else 1.0
            np.testing.assert_allclose(c, [5.0, 7.0, sign, 1.5 + sign * 1.4])
    assert nc.constraints.bevel("vv", True) is CATALOGUE["internal bevel gear vv"]
