"""docs/sources.md: every counterexample to the source text computed anew; docs/equations.md: every equation."""

import math
import re
from pathlib import Path

import equation_table
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import DOCS, ROOT

import jaxnc as nc
from jaxnc.constraints import CATALOGUE
from jaxnc.io.drives import sweep_arguments

PAGE = (DOCS / "sources.md").read_text()


def said(erratum: int, *values: float | int) -> None:
    """The counterexample that the page gives for an erratum, or what is there instead, has these numbers."""
    row = next(line for line in PAGE.splitlines() if line.startswith(f"| {erratum} |"))
    row = "|".join(row.split("|")[4:])
    written = [float(x) for x in re.findall(r"(?<![\w.(])-?\d+(?:\.\d+)?(?!\w|\.\d|\))", row)]
    for value in values:
        assert any(abs(x - value) < 6e-4 for x in written), f"erratum {erratum}: {value} is not in {row}"


def rank(rows, *at) -> tuple[int, np.ndarray]:
    """Rank of a function's Jacobian, and its null space."""
    x = np.concatenate([np.ravel(a) for a in at]).astype(float)
    _, s, v = np.linalg.svd(np.asarray(jax.jacfwd(rows)(jnp.asarray(x))))
    found = int((s > 1e-9).sum())
    return found, v[found:]


def turned(axis, angle: float, w) -> np.ndarray:
    """Rodrigues' formula."""
    k = np.asarray(axis) / np.linalg.norm(axis)
    return w * math.cos(angle) + np.cross(k, w) * math.sin(angle) + k * (k @ w) * (1 - math.cos(angle))


# -- errata -----------------------------------------------------------------------------------------------------------


def test_1_all_three_rows_of_a_vector_along_two_points_are_needed():
    u, length = np.array([0.36, 0.48, 0.8]), 2.0

    def rows(x, kept=(0, 1, 2)):
        p1, p2, v = x[:3], x[3:6], x[6:]
        return jnp.array([v @ v - 1.0, *((p2 - p1 - length * v)[jnp.array(kept)])])

    full, _ = rank(rows, np.zeros(3), length * u, u)
    for dropped in range(3):
        kept = [k for k in range(3) if k != dropped]
        fewer, _ = rank(lambda x, kept=kept: rows(x, kept), np.zeros(3), length * u, u)
        assert (full, fewer) == (4, 3)
    moved = length * u + [0.0, 0.0, 1.0]  # without (96), that of the largest component, nothing forbids this
    assert np.abs(rows(jnp.concatenate([jnp.zeros(3), moved, u]), (0, 1))).max() < 1e-14
    said(1, 4, 3, np.linalg.norm(moved))
    m = nc.Mechanism("bar", dim=3)
    m.point("1", (0, 0, 0))
    m.point("2", length * u)
    m.vector("u", u)
    m.body("bar", ["1", "2"], vectors=["u"])
    found = nc.mobility(m.compile())
    assert (found.n, found.rows, found.rank) == (9, 4, 4)


def test_2_the_row_of_the_largest_component_is_the_one_to_drop():
    axis = np.array([0.06, 0.08, math.sqrt(1 - 0.01)])
    product = np.array([[0, axis[2], -axis[1]], [-axis[2], 0, axis[0]], [axis[1], -axis[0], 0]])  # (128)-(130)
    order = np.argsort(np.abs(axis))
    largest, smallest = (np.linalg.svd(product[k])[1].min() for k in (order[1:], order[:2]))
    said(2, largest, smallest)
    assert largest == pytest.approx(0.06) and smallest == pytest.approx(axis[2])
    assert np.linalg.matrix_rank(product) == 2


def test_3_the_projection_of_a_bevel_gear():
    sigma, phi, length = math.pi / 3, 0.61, 1.7
    axis, other = np.array([1.0, 0, 0]), np.array([math.cos(sigma), math.sin(sigma), 0])
    start = other - (other @ axis) * axis
    arm = length * turned(axis, phi, start / np.linalg.norm(start))
    assert arm @ other == pytest.approx(length * math.sin(sigma) * math.cos(phi), abs=1e-14)
    printed = math.acos(arm @ other / length)  # the angle that (155) makes of this position
    said(3, printed - phi)
    assert printed - phi == pytest.approx(0.1715, abs=5e-5)
    m = nc.library.bevel_gears(shaft_angle=sigma)
    mo = nc.solve_position(m.compile(), {"phi": phi})
    a = np.asarray(mo["1"]) - np.asarray(mo["A"])
    expected = np.linalg.norm(a) * math.sin(sigma) * math.cos(phi)
    assert a @ np.asarray(mo["vB"]) == pytest.approx(expected, abs=1e-14)


def test_4_the_coefficients_of_a_point_multiply_the_vector():
    base = {"2": [1.0, 0, 0], "3": [0.0, 1, 0], "u": [0.0, 0, 1], "4": [0.5, 0.5, 0.5]}
    p = {k: turned([1, 0, 0], math.pi / 2, np.array(x)) for k, x in base.items()}
    printed = p["4"] - 0.5 * p["2"] - 0.5 * p["3"] - 0.5 * np.array(base["u"])
    assert np.abs(p["4"] - 0.5 * p["2"] - 0.5 * p["3"] - 0.5 * p["u"]).max() < 1e-14
    said(4, np.linalg.norm(printed))
    assert np.linalg.norm(printed) > 0.7


def test_5_the_count_of_the_natural_coordinates():
    f = nc.formulate(nc.library.crank_slider_on_bar(), "natural")
    assert (f.n, f.r, f.g) == (6, 5, 1)
    said(5, 6 - 1, 6 - 1 - 1)


def test_6_what_does_not_move_has_no_variation():
    two, three, one = np.array([1.0, 0]), np.array([3.0, 0]), np.array([1.0, 1])
    step = 1e-3  # δφ about the fixed point 2, at φ = π/2, where L12 = 1 and L23 = 2
    moved = np.array([-step, 0.0])
    rest = 2.0 * step * math.sin(math.pi / 2)
    printed, right = (moved - two) @ (three - two) + rest, moved @ (three - two) + rest
    assert right == 0.0 and one @ one > 0
    said(6, printed)


def test_7_signed_angles_of_a_gear_pair():
    m = nc.Mechanism("gears")
    m.ground("A", (0, 0))
    m.ground("B", (3, 0))
    m.point("P", (2 * math.cos(0.4), 2 * math.sin(0.4)))
    m.point("Q", (3 + math.cos(1.1), math.sin(1.1)))
    m.body("wheel", ["A", "P"])
    m.body("pinion", ["B", "Q"])
    m.angle("phi", at="A", to="P")
    m.angle("psi", at="B", to="Q")
    m.gear("mesh", "phi", "psi")
    mo = nc.sweep(m.compile(), {"phi": [0.4, 0.55, 0.7]}, rates={"phi": 1.0})
    change = float(mo["psi"][-1]) - 1.1
    # The teeth in contact have one velocity: 2 φ' up on the wheel's side, -1 ψ' up on the pinion's.
    np.testing.assert_allclose(2.0 * mo.velocity("phi"), -1.0 * mo.velocity("psi"), atol=1e-12)
    said(7, change, -change)
    assert change == pytest.approx(-0.6, abs=1e-12)


def test_8_the_pinion_angle_of_the_steering():
    lean, psi = math.radians(70), 0.8  # the shaft makes 70° with the y axis
    shaft = np.array([math.sin(lean), math.cos(lean), 0])
    start = np.array([0.0, 1, 0]) - shaft[1] * shaft
    y = turned(shaft, psi, start / np.linalg.norm(start))[1]
    assert y == pytest.approx(math.sin(lean) * math.cos(psi), abs=1e-14)
    said(8, math.acos(y) - psi)
    m = nc.library.steering_column()
    exact = nc.mobility(m.compile())
    for angle in m.model.angles.values():
        angle.form = "cosine"
    cosine = nc.mobility(m.compile())
    assert (exact.rank, exact.momentary, cosine.rank, cosine.momentary) == (16, 0, 16, 1)
    said(8, 16, cosine.rank - cosine.momentary)


def test_9_a_scalar_product_of_parallel_directions():
    m = nc.Mechanism("telescope")
    m.ground("A", (0, 0))
    for name, at in {"B": (2, 1), "C": (3, 1.5), "D": (4, 2)}.items():
        m.point(name, at)
    m.body("tube", ["A", "B"])
    m.body("rod", ["C", "D"])
    m.prismatic("slide", line=("A", "B"), on=("C", "D"), form="text")
    text = nc.mobility(m.compile())
    m.model.joints["slide"].form = "exact"
    exact = nc.mobility(m.compile())
    assert (text.rows, text.rank, exact.rank) == (4, 3, 4)
    said(9, text.rank, exact.rank)
    line = np.array([1.0, 0.0])
    both = [np.array([math.cos(a), math.sin(a)]) for a in (math.pi / 3, -math.pi / 3)]
    assert line @ both[0] == pytest.approx(line @ both[1])
    kind = CATALOGUE["fixed angle"]
    ends = [np.array([np.zeros(2), line, np.zeros(2), w]) for w in both]
    c = kind.drawn(ends[0], None, None, ())
    assert abs(kind.residual(ends[0], None, None, c)[0]) < 1e-14
    said(9, 60, -60, kind.residual(ends[1], None, None, c)[0])


def test_10_three_distances_admit_the_mirrored_body():
    drawn, mirrored = (np.array([[0.0, 0], [2, 0], [0.5, y]]) for y in (1.0, -1.0))
    for i, j in ((0, 1), (0, 2), (1, 2)):
        assert np.linalg.norm(drawn[i] - drawn[j]) == np.linalg.norm(mirrored[i] - mirrored[j])
    kind = CATALOGUE["attached"]
    c = kind.drawn(drawn, None, None, ())
    left = np.abs(kind.residual(mirrored, None, None, c)).max()
    assert np.abs(kind.residual(drawn, None, None, c)).max() == 0.0
    said(10, left)


def test_11_the_distance_of_the_rocker():
    m = nc.library.rscr()
    mo = nc.sweep(m.compile(), **sweep_arguments(m))
    to_2, to_3 = (np.linalg.norm(mo[p] - mo["B"], axis=-1) for p in "23")
    assert mo.converged.all() and np.ptp(to_3) < 1e-14
    said(11, to_2.min(), to_2.max())


def test_every_erratum_that_is_cited_is_listed_and_tested():
    listed = {int(n) for n in re.findall(r"^\| (\d+) \| [^|]+\| [^|]+\| [^|]+\| [^|]+\|$", PAGE, re.M)}
    assert listed == set(range(1, 12))
    tested = {int(n) for n in re.findall(r"^def test_(\d+)_", Path(__file__).read_text(), re.M)}
    assert tested == listed
    cited = set()
    for path in [*(ROOT / "jaxnc").rglob("*.py"), *(DOCS).glob("*.md")]:
        for numbers in re.findall(r"[Ee]rrat(?:um|a)\s+(\d+(?:(?:,| and)\s\d+)*)", path.read_text()):
            cited |= {int(n) for n in re.findall(r"\d+", numbers)}
    assert len(cited) > 6 and cited <= listed


# -- the equations ----------------------------------------------------------------------------------------------------


def test_the_page_of_equations_is_what_the_library_says():
    """If this fails the page is out of date: ``python tests/equation_table.py`` writes it."""
    assert (DOCS / "equations.md").read_text(encoding="utf-8") == equation_table.page()


def test_every_equation_has_its_place():
    assert [n for n, (kinds, functions) in equation_table.index().items() if not kinds and not functions] == []
