"""The source text's equations as printed, against the library: both admit the same poses and the same motions."""

import numpy as np
import pytest
from printed import COMPARED, COUNTS, GROUPS, VARIED, Group, Place, at_rest

import jaxnc as nc
from jaxnc.solvers.assembly import derive, to_host


def derivatives(rows, place: Place, columns: np.ndarray) -> np.ndarray:
    """By complex steps: exact to rounding."""
    out = np.empty((len(rows), len(columns)))
    for j, column in enumerate(columns):
        q = place.q.astype(complex)
        q[column] += 1e-30j
        out[:, j] = [np.imag(row(Place(place.index, q, place.drawn))) / 1e-30 for row in rows]
    return out


def rank(*rows: np.ndarray) -> int:
    """Rank of rows of length 1."""
    a = np.concatenate(rows)
    size = np.linalg.norm(a, axis=1, keepdims=True)
    values = np.linalg.svd(a / np.where(size > 0, size, 1.0), compute_uv=False)
    found = int(np.sum(values > 1e-7))
    assert values[found - 1] > 1e-6 and (found == len(values) or values[found] < 1e-12), values
    return found


@pytest.mark.parametrize("name", GROUPS)
def test_the_printed_equations_and_ours_admit_the_same_motions(name):
    group: Group = GROUPS[name]
    system = group.mechanism.compile()
    top, drawn = system.topology, at_rest(system)
    rows = [*group.rows.values(), *group.more]
    here = to_host(derive(system))
    size = float(here.length)
    for q in group.poses(group.mechanism, system):
        place = Place(top.position, q, drawn)
        scale = np.array([max(1.0, size) ** 2] * len(rows))
        assert np.max(np.abs([row(place) for row in rows]) / scale) < 1e-9
        assert np.max(np.abs(here.residual(q[:, None]))) < 1e-9 * max(1.0, size)
        text = derivatives(rows, place, top.unknown)
        ours = here.jacobian(q[:, None])[0][:, top.unknown]
        assert rank(text) == rank(ours) == rank(text, ours) == len(top.unknown) - group.freedoms
    assert system.degrees_of_freedom == group.freedoms


def test_the_same_mechanism_in_relative_coordinates_and_in_those_of_reference_points():
    group = GROUPS["crank and slider on a bar, 13"]
    system = group.mechanism.compile()
    for q in group.poses(group.mechanism, system):
        place = Place(system.topology.position, q, at_rest(system))
        assert {n: row(place) for n, row in COMPARED.items() if abs(row(place)) > 1e-14} == {}
    for family, n, r in (("relative", 3, 2), ("reference", 9, 8)):
        found = nc.formulate(group.mechanism, family)
        assert (found.n, found.r, found.g) == (n, r, 1)


def test_the_variation_of_the_cosine():
    group = GROUPS["angle, 38"]
    system = group.mechanism.compile()
    top = system.topology
    for q in group.poses(group.mechanism, system):
        place = Place(top.position, q, at_rest(system))
        columns = [top.position[name] for name in ("1.x", "1.y", "phi")]
        want = [*place("2>3")[:2], place.size("2>1") * place.size("2>3") * np.sin(place("phi"))]
        np.testing.assert_allclose(derivatives([group.rows[38]], place, np.array(columns))[0], want, atol=1e-14)


def test_no_equation_is_missing():
    numbers = [*COUNTS, *VARIED, *COMPARED, *(n for group in GROUPS.values() for n in group.rows)]
    assert sorted(numbers, key=str) == sorted([*range(1, 202), "42b"], key=str)
