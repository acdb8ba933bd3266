"""All four-bars through precision points of a path, against published numbers and by ways of their own."""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest

import jaxnc as nc
from jaxnc import synthesis as syn
from jaxnc.continuation.certificate import Twofold
from jaxnc.continuation.tracker import PathEnds, inverses
from jaxnc.synthesis.exact import precision_points
from jaxnc.synthesis.exact.precision_points import Task, follow_paths, polish, stored_starts

MET = 1e-9  # of the size: places after moving there; bars may be a thousand times the size of the points
ROUNDING = 1e-7  # of sums over hundreds of solutions, the largest of them a hundred times the others

# Problem 7 of Morgan and Wampler (1990): five points on a line, pivots at (0, 0) and (1, 0).
LINE = [(0.50, 1.06), (-0.83, -0.27), (-0.34, 0.22), (-0.13, 0.43), (0.22, 0.78)]
# Problem 3 of Wampler, Morgan and Sommese (1992).
NINE = [(0.25, 0), (0.52, 0.1), (0.8, 0.7), (1.2, 1), (1.4, 1.3), (1.1, 1.48), (0.7, 1.4), (0.2, 1), (0.02, 0.4)]

TRUE = syn.FourBar((0, 0), (0.5, 0.8), (3.1, 2.3), (3.6, -0.2), (1.9, 3.0))


def on_curve(count):
    """Points that a crank-rocker passes, by its loop in complex numbers."""
    a, b, c, d, p = TRUE.z
    crank = b - a
    moving = a + crank * np.exp(1j * np.linspace(0.0, 5.5, count))
    far = d - moving
    cosine = (abs(far) ** 2 + abs(c - b) ** 2 - abs(d - c) ** 2) / (2 * abs(far) * abs(c - b))
    side = np.sign(((c - b) * np.conj(d - b)).imag)
    joint = moving + abs(c - b) * far / abs(far) * np.exp(1j * side * np.arccos(cosine))
    traced = moving + (p - b) / (c - b) * (joint - moving)
    return np.column_stack([traced.real, traced.imag])


def met(found, points):
    """The designs without defects are moved to the points; of all, both bars keep their lengths there."""
    size = np.ptp(np.asarray(points), axis=0).max()
    assert found.residual < MET
    for design in found:
        if not design.defects:
            motion = design.linkage.move({"phi": design.inputs})
            np.testing.assert_allclose(np.asarray(motion["P"]), points, atol=MET * size)
        else:
            assert set(design.defects) <= {"branch", "circuit", "order"}


def poses(linkage, to):
    """Places of B at which a linkage reaches a point, by two circles, and there how far off its rocker's length is."""
    a, b, c, d, p = linkage
    far, crank, arm = to - a, abs(b - a), abs(p - b)
    along = (abs(far) ** 2 + crank**2 - arm**2) / (2 * abs(far))
    both = [a + far / abs(far) * complex(along, sign * np.sqrt(crank**2 - along**2)) for sign in (1, -1)]
    return [(at, abs(abs(to + (c - p) * (to - at) / (p - b) - d) - abs(c - d))) for at in both]


@pytest.mark.parametrize(
    ("way", "linkages", "count"),
    [
        # On an arc: the parallelogram whose cranks are the radius, of which the coupler only translates.
        (0.2 + 0.9j + np.exp(1j * np.linspace(0.3, 1.8, 5)), [(np.exp(0.3j), np.exp(0.3j) + 1)], 1),
        # On a line: two linkages, each of which passes one of the points twice.
        (1j + np.linspace(0.0, 1.0, 5), [(-0.375 - 0.0625j, 0.625 + 0.0625j), (-0.125 - 0.1875j, 0.875 + 0.1875j)], 2),
    ],
)
def test_couplers_that_translate_and_points_that_are_met_twice(way, linkages, count):
    found = syn.path_four_bars(np.column_stack([way.real, way.imag]), A=(0, 0), D=(1, 0))
    assert found.routes == 1 and not found.missing and found.disjoint and all(found.proved)
    pins = [{round(z[0].real): z[1], round(z[3].real): z[2]} for z in (design.linkage.z for design in found)]
    for b, c in linkages:
        meets = [[gap < MET for _, gap in poses((0, b, c, 1, way[0]), to)] for to in way]
        assert all(map(any, meets)) and sum(map(sum, meets)) == len(way) + count - 1
        same = [k for k, at in zip(found.curves, pins, strict=True) if max(abs(at[0] - b), abs(at[1] - c)) < MET]
        assert len(same) == count and len(set(same)) == 1


def test_a_linkage_has_one_number_from_whichever_of_its_poses_it_is_seen():
    way = 1j + np.array([0.5, 0.0, 1.0, 0.25, 0.75])
    found = syn.path_four_bars(np.column_stack([way.real, way.imag]), A=(0, 0), D=(1, 0))
    z = np.array([design.linkage.z[:4] for design in found]).T
    shapes = np.array([*np.abs(np.diff(z, axis=0)), *np.abs(way[0] - z[1:3]), ((way[0] - z[1]) / (z[2] - z[1])).real])
    kinds = {*map(tuple, np.round(shapes.T, 6).tolist())}
    assert len({*zip(map(tuple, np.round(shapes.T, 6).tolist()), found.curves, strict=True)}) == len(kinds)
    assert len({*found.curves}) == len(kinds) == len(found) - 2


def test_five_points_of_morgan_and_wampler():
    """PHCpack's guide counts 33 finite solutions of this problem, where 36 are usual, and 15 real ones."""
    found = syn.path_four_bars(LINE, A=(0, 0), D=(1, 0))
    assert (found.expected, found.found, len(found)) == (36, 33, 15)
    assert not found.complete and (found.missing, found.routes) == (0, 1)
    assert "33 of 36 solutions" in str(found) and "at infinity" in found.statement
    assert found.disjoint and all(found.proved)
    met(found, LINE)


def test_nine_points_of_wampler_morgan_and_sommese():
    """1442 solutions, of which 64 are real: proved for these points by alphaCertified (Hauenstein and Sottile 2012)."""
    found = syn.path_four_bars(NINE)
    assert (found.expected, found.found, found.complete) == (1442, 1442, True)
    assert (len(found), len(set(found.curves))) == (3 * 64, 64)
    met(found, NINE)
    assert sum(not design.defects for design in found) == 2
    assert found.disjoint and all(found.proved)
    for curve in (0, 17, 40):
        one, *others = (design.linkage for design, k in zip(found, found.curves, strict=True) if k == curve)
        assert len(others) == 2 and all(syn.same_curve(one, other, tolerance=1e-6) for other in others)


@pytest.mark.parametrize(
    ("count", "base", "expected"),
    [
        (5, {"A": TRUE.A, "D": TRUE.D}, 36),
        (6, {"A": (None, TRUE.A[1]), "D": TRUE.D}, 258),
        (7, {"D": TRUE.D}, 486),
    ],
)
def test_points_of_a_known_linkage(count, base, expected):
    points = on_curve(count)
    found = syn.path_four_bars(points, **base)
    assert found.complete and found.found == expected
    met(found, points)
    good = [design.linkage for design in found if not design.defects]
    assert any(np.abs(np.subtract([f.A, f.B, f.C, f.D], [TRUE.A, TRUE.B, TRUE.C, TRUE.D])).max() < 1e-7 for f in good)
    for design in found:
        for name, given in base.items():
            place = {getattr(design.linkage, name) for name in "AD"}
            assert any(all(w is None or abs(v - w) < 1e-7 for v, w in zip(at, given, strict=True)) for at in place), (
                name,
                place,
            )


def test_keys_of_cognates_are_the_same_and_know_turns():
    """Of nine points: the turns of coupler, crank and rocker are those of the links of either cognate."""
    z, task = stored_starts("9-00")
    z = z[:, :20]
    keys = precision_points.solution_keys(z, task)
    for which in (1, 2):
        other = polish(precision_points._cognate(z, which), task)[0]
        assert not np.allclose(other[8:], z[8:], rtol=0.1)
        np.testing.assert_allclose(precision_points.solution_keys(other, task), keys, rtol=1e-6)
    z[11] += 0.1  # another turn of the coupler at the fifth point
    assert (np.abs(precision_points.solution_keys(z, task) - keys).max(axis=0) > 1e-3).all()


def test_nine_points_on_a_quarter_turn_lose_none():
    """Points close together: conditions are 1e9, and doubles alone lose paths (here five); the linkage is found."""
    a, d, crank, coupler, rocker, shape = 0.0, 1.0, 0.6, 1.1, 1.3, 0.7 + 0.5j
    moving = crank * np.exp(1j * (0.9 + np.linspace(0.0, np.pi / 2, 9)))
    far = d - moving
    cosine = (coupler**2 + abs(far) ** 2 - rocker**2) / (2 * coupler * abs(far))
    bar = coupler * far / abs(far) * np.exp(1j * np.arccos(cosine))
    traced = moving + shape * bar
    found = syn.path_four_bars(np.column_stack([traced.real, traced.imag]))
    assert found.complete and (found.found, found.missing, found.routes) == (1442, 0, 1)
    assert found.disjoint and np.mean(found.proved) > 0.8
    true = np.array([a, moving[0], moving[0] + bar[0], d])
    drawn = [np.array([complex(*getattr(f.linkage, name)) for name in "ABCD"]) for f in found]
    gap, proved = min((min(abs(z - true).max(), abs(z[::-1] - true).max()), p)
                      for z, p in zip(drawn, found.proved, strict=True))  # fmt: skip
    assert gap < 1e-6 and proved


def test_paths_that_are_lost_are_counted_or_found_on_another_way(monkeypatch):
    points = np.cumsum(np.random.default_rng(3).normal(size=(5, 2)), axis=0)
    follow, route = precision_points._follow_block, precision_points._route

    def lose_two(z, start, end, attempt, lanes):
        lost = np.isin(lanes, [3, 20])
        if lost.all():  # all attempts after the first, which take long
            nothing = np.zeros(len(lanes))
            return PathEnds(z[:, lanes], lost & False, nothing + 0.5, nothing, nothing)
        out = follow(z, start, end, attempt, lanes)
        return dataclasses.replace(out, arrived=out.arrived & ~lost, at=np.where(lost, 0.5, out.at))

    monkeypatch.setattr(precision_points, "_follow_block", lose_two)
    found = syn.path_four_bars(points, A=(0, 0), D=(2, 0))
    assert (found.found, found.missing, found.routes, found.complete) == (36, 0, 2, True)
    monkeypatch.setattr(precision_points, "_route", lambda *given: route(*given[:-1], 1.0))
    found = syn.path_four_bars(points, A=(0, 0), D=(2, 0))
    assert (found.found, found.missing, found.routes, found.complete) == (34, 2, 3, False)
    assert "at most 2 more" in found.statement


def test_twofold_numbers_against_fractions():
    """What is left of x y z - fl(x y z) is right to the last digit of a double, where doubles leave nothing."""
    x, y, z = np.random.default_rng(1).normal(size=(3, 50, 2)) @ [1, 1j]
    rounded = x * y * z
    left = (Twofold(x) * y * z - rounded).rounded()
    for i in range(len(x)):
        (a, b), (c, d), (e, f), (p, q) = ((Fraction(v[i].real), Fraction(v[i].imag)) for v in (x, y, z, rounded))
        g, h = a * c - b * d, a * d + b * c
        exact = complex(float(g * e - h * f - p), float(g * f + h * e - q))
        assert abs(left[i] - exact) < 1e-12 * abs(exact)


def test_six_points_with_both_pivots_on_one_level():
    """Of 258 paths 88 end where A is D and B is C; the 170 are all that monodromy among such bases reaches."""
    points = np.cumsum(np.random.default_rng(3).normal(size=(6, 2)), axis=0)
    found = syn.path_four_bars(points, A=(0.0, 0.2), D=(None, 0.2))
    assert (found.expected, found.found, found.routes) == (170, 170, 1)
    met(found, points)


def test_matrices_that_are_singular_to_the_last_bit_stop_no_other_lane():
    lanes = np.stack([2.0 * np.eye(8), np.zeros((8, 8)), np.ones((8, 8))]).astype(complex)
    np.testing.assert_array_equal(inverses(lanes)[0], 0.5 * np.eye(8))
    assert np.isnan(inverses(lanes)[1]).all()


def test_a_point_on_a_fixed_pivot():
    """Seen from that point no equation loses its turn: all six linkages that another search found are there."""
    points = [(0.5, 1.06), (-0.83, -0.27), (-0.34, 0.22), (-0.13, 0.43), (0.0, 0.0)]
    orders = [points, [points[4], *points[:4]], [*points[:2], points[4], *points[2:4]]]
    found = [syn.path_four_bars(some, A=(0, 0), D=(1, 0.3)) for some in orders]
    lengths = [sorted(round(d.linkage.lengths["crank"], 9) for d in designs) for designs in found]
    assert lengths[0] == lengths[1] == lengths[2] and len(lengths[0])
    assert all(designs.residual < 1e-12 and not designs.missing for designs in found)
    with pytest.raises(nc.InputError, match="fixed pivots"):
        syn.path_four_bars([*points[:4], (1, 0.3)], A=(0.5, 1.06), D=(1, 0.3))


def test_no_other_real_linkage_is_found_by_newton():
    """Five points: 4000 real random starts of Newton end in the linkages that are known, and in each."""
    rng = np.random.default_rng(8)
    points = rng.normal(size=(5, 2))
    found = syn.path_four_bars(points, A=(0, 0), D=(2, 0))
    known = np.array([(*d.linkage.B, *d.linkage.C) for d in found])
    swapped = known[:, [2, 3, 0, 1]]
    z = points @ [1, 1j]
    size = np.abs(z - z.mean()).max() / 1.5
    rows = np.array([[1, 0, 1, 0], [-1j, 0, 1j, 0], [0, 1, 0, 1], [0, -1j, 0, 1j]])
    right = 2 * np.array([-z[0].real, -z[0].imag, 2 - z[0].real, -z[0].imag]) / size
    d = (z[1:] - z[0]) / size
    task = Task(d, d.conj(), rows, right + 0j)
    x = rng.normal(size=(2, 4000)) + 1j * rng.normal(size=(2, 4000))
    a = np.array([[0.0 - z[0]], [2.0 - z[0]]]) / size + np.zeros((2, 4000))
    ends, last = polish(np.concatenate([x, x.conj(), a, a.conj()]), task, steps=40)
    real = np.abs(ends[2:4].conj() - ends[:2]).max(axis=0) < 1e-8  # steps that go astray end in complex ones too
    near = real & (last < 1e-10) & (np.abs(ends).max(axis=0) < 30) & (np.abs(ends[:2]).min(axis=0) > 1e-6)
    pins = z[0] - size * ends[:2, near]
    reached = np.array([pins[0].real, pins[0].imag, pins[1].real, pins[1].imag]).T
    gap = np.minimum(*(np.abs(reached[:, None] - one[None]).max(axis=2) for one in (known, swapped)))
    assert len(reached) > 100
    assert (gap.min(axis=1) < 1e-6).all()
    assert len(set(gap.argmin(axis=1))) == len(known)


def test_trace_of_six_points():
    """The stored set of six points is whole: its pivots' sum moves straight on with the line that holds the pivot.

    Without one of the solutions it does not.
    """
    z, task = stored_starts("6-21")
    sums = [z[5]]
    for sign in (-1.0, 1.0):
        right = task.right.copy()
        right[-1] += sign * (0.01 - 0.02j)
        moved = dataclasses.replace(task, right=right)
        out = follow_paths(z, task, moved)
        assert out.arrived.all()
        sums.append(polish(out.w, moved)[0][5])
    bend, way = sums[1] + sums[2] - 2 * sums[0], sums[2] - sums[1]
    assert abs(bend.sum()) < ROUNDING * abs(way.sum())
    assert abs(bend).min() > ROUNDING * abs(way.sum())


@pytest.mark.parametrize(
    ("points", "base", "says"),
    [
        (NINE[:8], {}, "8 points and 0 coordinates.*nine"),
        (NINE, {"A": (0, None)}, "9 points and 1 coordinates"),
        ([*NINE[:8], NINE[2]], {}, r"points\[2\] and points\[8\] are the same"),
        ([*NINE[:8], (np.nan, 0)], {}, r"points\[8\] is not finite"),
        (NINE[:5], {"A": (1, 0), "D": (1, 0)}, "a four-bar has two fixed pivots"),
        (NINE[:7], {"A": 3.0}, "A must be two numbers"),
        ([(1, 2, 3)] * 9, {}, r"shape \(n, 2\), got \(9, 3\)"),
    ],
)
def test_messages(points, base, says):
    with pytest.raises(nc.InputError, match=says):
        syn.path_four_bars(points, **base)
