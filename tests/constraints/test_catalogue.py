"""Every kind of constraint in the plane against a formula written by hand; structure and degree against jacfwd.

Those in space, and the check that no kind is without a formula, are in test_spatial_catalogue.py.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import four_bar, shaper, slider_crank

import jaxnc as nc
from jaxnc.constraints import CATALOGUE, Kind, cable, relation
from jaxnc.system.structure import pattern, quadratic

RNG = np.random.default_rng(11)


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def turned(d):
    return np.array([-d[1], d[0]])


def _angle(form, from_x):
    def rows(p, s, c):
        if from_x:
            co, si, size = p[1][0] - p[0][0], p[1][1] - p[0][1], c[0] if len(c) else None
        else:
            d, w = p[1] - p[0], p[3] - p[2]
            co, si, size = np.dot(d, w), cross(d, w), c[0] * c[1] if len(c) else None
        f = s[0]
        if form == "exact":
            return [co * np.sin(f) - si * np.cos(f)]
        c_row, s_row = co - size * np.cos(f), si - size * np.sin(f)
        use_cosine = abs(np.sin(f)) >= abs(np.cos(f))
        return {
            "cosine": [c_row],
            "sine": [s_row],
            "switched": [c_row if use_cosine else s_row],
            "redundant": [c_row, s_row],
            "sum": [c_row + s_row],
            "difference": [c_row - s_row],
        }[form]

    return rows


def _along(form):
    def rows(p, s, c):
        w, d = p[1] - p[0], p[3] - p[2]
        x, y = w[0] - s[0] / c[0] * d[0], w[1] - s[0] / c[0] * d[1]
        return {
            "exact": [np.dot(w, d) - s[0] * c[0]],
            "x": [x],
            "y": [y],
            "switched": [x if abs(d[0]) >= abs(d[1]) else y],
            "redundant": [x, y],
            "sum": [x + y],
            "difference": [x - y],
        }[form]

    return rows


FORMS = ("exact", "cosine", "sine", "switched", "redundant", "sum", "difference")
LINES = ("exact", "x", "y", "switched", "redundant", "sum", "difference")


def label(base, form):
    return base if form == "exact" else f"{base}, {form}"


HAND = {
    "distance": lambda p, s, c: [np.dot(p[1] - p[0], p[1] - p[0]) - c[0] ** 2],
    "attached": lambda p, s, c: list(p[2] - p[0] - c[0] * (p[1] - p[0]) - c[1] * turned(p[1] - p[0])),
    "proportional": lambda p, s, c: list(p[2] - p[0] - c[0] * (p[1] - p[0])),
    "combination": lambda p, s, c: list(p[3] - p[1] - c[0] * (p[0] - p[1]) - c[1] * (p[2] - p[1])),
    "coincident": lambda p, s, c: list(p[1] - p[0]),
    "aligned": lambda p, s, c: [cross(p[1] - p[0], p[2] - p[0])],
    "fixed angle": lambda p, s, c: [c[0] * cross(p[1] - p[0], p[3] - p[2]) - c[1] * np.dot(p[1] - p[0], p[3] - p[2])],
    "scalar product": lambda p, s, c: [np.dot(p[1] - p[0], p[3] - p[2]) - c[0]],
    "perpendicular": lambda p, s, c: [np.dot(p[1] - p[0], p[3] - p[2])],
    "contact": lambda p, s, c: list(p[3] - p[2] - c[1] * c[0] / c[2] * turned(p[1] - p[0])),
    "rolling": lambda p, s, c: [s[0] - c[1] * c[0] * s[1] - c[2]],
    "external gear": lambda p, s, c: [c[0] * s[0] + c[1] * s[1] - c[2]],
    "internal gear": lambda p, s, c: [c[0] * s[0] - c[1] * s[1] - c[2]],
    "distance along a free line": lambda p, s, c: [
        np.dot(p[1] - p[0], p[3] - p[2]) - s[0] * np.linalg.norm(p[3] - p[2])
    ],
    "distance between": lambda p, s, c: [np.dot(p[1] - p[0], p[1] - p[0]) - s[0] ** 2],
    "cable of 3": lambda p, s, c: [np.linalg.norm(p[1] - p[0]) + np.linalg.norm(p[2] - p[1]) - c[0]],
    "relation of 2": lambda p, s, c: [c[0] * s[0] + c[1] * s[1] - c[2]],
    "joint that follows another": lambda p, s, c: [s[0] - c[0] - np.polyval(c[6:1:-1], s[1] - c[1])],
    **{label("angle", f): _angle(f, False) for f in FORMS},
    **{label("angle from x", f): _angle(f, True) for f in FORMS},
    **{f"distance along, {f}": _along(f) for f in LINES},
}


def draw(kind: Kind):
    return (
        RNG.uniform(-2, 2, (kind.points, 2)),
        np.zeros((0, 2)),
        RNG.uniform(-2, 2, kind.scalars),
        RNG.uniform(0.5, 2, len(kind.constants)),
    )


@pytest.mark.parametrize("name", sorted(HAND))
def test_rows_agree_with_the_formula(name):
    kind = CATALOGUE[name]
    for _ in range(5):
        p, v, s, c = draw(kind)
        got = np.array([float(r) for r in kind.residual(p, v, s, c)])
        want = np.array(HAND[name](p, s, c), dtype=float)
        assert got.shape == want.shape == (len(kind.rows),) == (len(kind.powers),)
        np.testing.assert_allclose(got, want, atol=1e-14)


@pytest.mark.parametrize("name", sorted(HAND))
def test_structure_and_degree(name):
    """The structure read covers every derivative, and a quadratic kind has no third difference."""
    kind = CATALOGUE[name]
    shape = pattern(kind, 2)
    count = kind.points * 2 + kind.scalars

    def rows(x, c):
        p = x[: kind.points * 2].reshape(kind.points, 2)
        return jnp.stack([jnp.asarray(r) for r in kind.residual(p, jnp.zeros((0, 2)), x[kind.points * 2 :], c)])

    assert shape.shape == (len(kind.rows), count)
    rows, slopes = jax.jit(rows), jax.jit(jax.jacfwd(rows))
    for _ in range(3):
        p, _, s, c = draw(kind)
        x = np.concatenate([p.reshape(-1), s])
        jacobian = np.asarray(slopes(x, c))
        assert not np.any(np.abs(jacobian[~shape]) > 1e-12)
        if quadratic(kind, 2):
            d = RNG.uniform(-1, 1, count)
            last, third, second, first = (np.asarray(rows(x + k * d, c)) for k in (3, 2, 1, 0))
            third = last - 3 * third + 3 * second - first
            np.testing.assert_allclose(third, 0.0, atol=1e-11)


# The constants of angles and distances are lengths of bodies; there the scalar adapts instead (next test).
@pytest.mark.parametrize("name", [n for n in sorted(HAND) if CATALOGUE[n].constants and not CATALOGUE[n].measure])
def test_drawn_constants_satisfy_the_rows(name):
    """Constants read off any drawing make the drawing a solution, where the kind has constants to adapt."""
    kind = CATALOGUE[name]
    p, v, s, c = draw(kind)
    if name == "contact":  # the contact point lies across the line from the centre
        p[3] = p[2] - 0.7 * turned(p[1] - p[0])
    given = c.copy() if name.startswith("relation") else np.zeros_like(c)
    constants = np.array([float(x) for x in kind.drawn(p, v, s, given)])
    rows = np.array([float(r) for r in kind.residual(p, v, s, constants)])
    aligned = name == "proportional"
    if aligned:
        p[2] = p[0] + 1.3 * (p[1] - p[0])
        constants = np.array([float(x) for x in kind.drawn(p, v, s, given)])
        rows = np.array([float(r) for r in kind.residual(p, v, s, constants)])
    np.testing.assert_allclose(rows, 0.0, atol=1e-12)


@pytest.mark.parametrize(("name", "sign"), [("external gear", 1.0), ("internal gear", -1.0)])
def test_radii_of_gears_are_read_off_the_drawing_unless_given(name, sign):
    """Rows are met by wheels of any radius, as their constant adapts; the radii are from centre to pitch point."""
    kind = CATALOGUE[name]
    p, v, s, c = draw(kind)
    first, second = np.hypot(*(p[1] - p[0])), np.hypot(*(p[3] - p[2]))
    for given, radii in (([0.0, 0.0], (first, second)), ([c[0], 0.0], (c[0], second)), ([0.0, c[1]], (first, c[1]))):
        found = np.array([float(x) for x in kind.drawn(p, v, s, np.array([*given, 0.0]))])
        np.testing.assert_allclose(found, [*radii, radii[0] * s[0] + sign * radii[1] * s[1]], rtol=1e-12)


@pytest.mark.parametrize("name", [n for n in sorted(HAND) if CATALOGUE[n].measure])
def test_measured_coordinates_satisfy_their_rows(name):
    kind = CATALOGUE[name]
    p, v, s, _ = draw(kind)
    if name.startswith("distance along,"):
        p[1] = p[0] + 0.8 * (p[3] - p[2])  # the point is on the line
    c = (
        np.array([float(x) for x in kind.drawn(p, v, s, np.zeros(len(kind.constants)))])
        if kind.constants
        else np.zeros(0)
    )
    s = np.array([float(kind.measure(p, v, c))])
    rows = np.array([float(r) for r in kind.residual(p, v, s, c)])
    np.testing.assert_allclose(rows, 0.0, atol=1e-12)
    if kind.guard:
        assert all(float(g) > 0 for g in kind.guard(p, v, s, c))


def test_kinds_of_any_count():
    p = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 5.0], [0.0, 1.0]])
    assert float(cable(4).residual(p, None, None, np.array([10.0]))[0]) == pytest.approx(1.0)
    row = relation(3).residual(None, None, np.array([1.0, 2.0, 3.0]), np.array([1.0, -1.0, 2.0, 4.0]))
    assert float(row[0]) == pytest.approx(1.0)
    assert cable(4) is cable(4) and relation(3) is relation(3)


def test_a_kind_checks_its_own_record():
    with pytest.raises(ValueError, match="2 row labels but 1 powers"):
        Kind("bad", lambda p, v, s, c: (0, 0), rows=("a", "b"), powers=(1,))
    with pytest.raises(ValueError, match="no `drawn`"):
        Kind("bad", lambda p, v, s, c: (0,), constants=("k",))


@pytest.mark.parametrize("make", [four_bar, slider_crank, shaper])
def test_jacobian_of_a_system_against_jacfwd(make):
    """The assembled Jacobian, from coefficients and index maps, against automatic differentiation of the residual."""
    system = make()
    q = nc.solve_position(system, {"phi": 0.7}).q + 0.02 * RNG.uniform(-1, 1, len(system.topology.coordinates))
    want = jax.jit(jax.jacfwd(lambda x: nc.system.residual(system, x)))(q)
    np.testing.assert_allclose(nc.system.jacobian(system, q), want, atol=1e-14)
    moved = nc.system.residual(system, q, {"phi": 1.9})
    np.testing.assert_allclose(
        moved, nc.system.residual(system, q.at[system.topology.position["phi"]].set(1.9)), atol=0
    )
    with pytest.raises(nc.InputError, match="did you mean 'phi'"):
        nc.system.residual(system, q, {"phy": 1.9})
