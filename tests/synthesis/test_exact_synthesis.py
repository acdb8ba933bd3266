"""Exact synthesis: Freudenstein's equation, Burmester's theory, cognates; every linkage is moved and compared."""

import itertools
import math

import jax
import numpy as np
import pytest
import scipy.optimize

import jaxnc as nc
from jaxnc import synthesis as syn

MET = 1e-12  # precision points after really moving there: rounding of a handful of operations
GUIDED = 1e-10  # poses of five-pose linkages, whose bars may be fifty times the size of the poses
R = np.radians


def brute_force_five(x, y, trials=400):
    """All solutions of five precision points by Newton from many starts: (K1, K2, K3, φ0, ψ0) with φ0 and ψ0 mod π."""
    rng = np.random.default_rng(5)
    found = []
    for _ in range(trials):
        k = np.concatenate([rng.normal(size=3), rng.uniform(-np.pi, np.pi, 2)])
        for _ in range(60):
            a, b = x + k[3], y + k[4]
            rest = k[0] * np.cos(b) - k[1] * np.cos(a) + k[2] - np.cos(a - b)
            slope = np.stack(
                [
                    np.cos(b),
                    -np.cos(a),
                    np.ones(5),
                    k[1] * np.sin(a) + np.sin(a - b),
                    -k[0] * np.sin(b) - np.sin(a - b),
                ],
                axis=1,
            )
            try:
                step = np.linalg.solve(slope, rest)
            except np.linalg.LinAlgError:
                break
            k = k - step / max(1.0, 0.5 * np.abs(step).max())
        if np.abs(rest).max() < 1e-12 and np.abs(k[:3]).max() < 1e3 and np.abs(k[:2]).min() > 1e-6:
            lengths = (1 / abs(k[0]), 1 / abs(k[1]))
            if not any(np.allclose(lengths, other, rtol=1e-6) for other in found):
                found.append(lengths)
    return found


class TestFreudenstein:
    def test_three_points_by_hand(self):
        """Norton, Design of Machinery: function generation at three points is linear; K's of a chosen linkage."""
        a, b, c, d = 1.0, 2.5, 1.8, 2.2
        phi = R([40.0, 65.0, 95.0])
        psi = rocker_angle(a, b, c, d, phi)
        designs = syn.precision_four_bars(phi, psi, ground=d)
        assert len(designs) == 1 and not designs.best.defects
        lengths = designs.best.linkage.lengths
        np.testing.assert_allclose([lengths[n] for n in ("crank", "coupler", "rocker")], [a, b, c], rtol=1e-12)
        assert designs.best.error <= MET

    def test_four_points_find_the_linkage_they_come_from(self):
        a, b, c, d, phi0 = 1.0, 2.5, 1.8, 2.2, 0.35
        x = R([0.0, 20.0, 45.0, 80.0])
        psi = rocker_angle(a, b, c, d, phi0 + x)
        designs = syn.precision_four_bars(x, psi, input_offset=None, ground=d)
        assert 1 <= len(designs) <= 2
        assert min(abs(g.linkage.lengths["coupler"] - b) for g in designs) < 1e-11
        psi0 = 0.2
        designs = syn.precision_four_bars(phi0 + x, psi - psi0, output_offset=None, ground=d)
        assert min(abs(g.linkage.lengths["coupler"] - b) + abs(g.output_offset - psi0) for g in designs) < 1e-11

    @pytest.mark.parametrize("seed", range(6))
    def test_five_points_find_every_solution(self, seed):
        """The cubic's real roots are all there are: Newton from four hundred starts finds no other."""
        rng = np.random.default_rng(seed)
        x = np.cumsum(rng.uniform(0.15, 0.4, 5))
        y = np.cumsum(rng.uniform(0.1, 0.5, 5))
        designs = syn.precision_four_bars(x, y, None, None)
        mine = [(g.linkage.lengths["crank"], g.linkage.lengths["rocker"]) for g in designs]
        for crank, rocker in brute_force_five(x, y):
            assert any(np.allclose((crank, rocker), m, rtol=1e-6) for m in mine), (crank, rocker, mine)
        for g in designs:
            assert "branch" in g.defects or "dead point" in g.defects or g.error <= MET

    def test_logarithm_at_five_points(self):
        """log10 x on [1, 2], 60° to 90°: five precision points are met to rounding by moving the linkage there."""
        designs = syn.function_four_bars(np.log10, (1.0, 2.0), R(60), R(90))
        best = designs.best
        assert not best.defects and best.error <= MET
        assert best.worst < R(0.05) and len(best.structural_error) == 121
        # By a closed form of its own: the structural error is that of the rocker's angle, and zero at the points.
        at = syn.chebyshev_points(5, (1.0, 2.0))
        scale = (at - 1.0) * R(60)
        np.testing.assert_allclose(best.inputs, scale, atol=1e-14)
        np.testing.assert_allclose(best.outputs, np.log10(at) / np.log10(2) * R(90), atol=1e-14)
        assert np.sum(np.diff(np.sign(best.structural_error)) != 0) >= 5
        assert "works" in str(designs)

    def test_chebyshev_spacing(self):
        """Hartenberg and Denavit: three points on [1, 2] lie at 1.067, 1.5 and 1.933."""
        np.testing.assert_allclose(syn.chebyshev_points(3, (1, 2)), [1.0669873, 1.5, 1.9330127], atol=1e-7)

    def test_a_straight_line_of_slope_one_is_every_parallelogram(self):
        x = np.array([0.1, 0.4, 0.8, 1.1, 1.5])
        for points, offset in ((5, None), (4, 0.2)):
            found = syn.precision_four_bars(x[:points], x[:points] + 0.3, offset, None)
            assert not len(found) and "parallelogram" in str(found)

    @pytest.mark.parametrize(("step", "out"), [(0.3, 1.0), (0.5, -1.0)])
    def test_a_step_is_met_by_no_crank_that_vanishes(self, step, out):
        """A rocker that stands still has a crank of no length, in a double root; no other bar is below a hundredth."""
        found = syn.function_four_bars(lambda x: np.sign(x - step), (0.0, 1.0), 1.0, out)
        assert len(found) == 1 and min(found.best.linkage.lengths.values()) > 0.01
        assert len(found.rejected) == 2 and all("a bar that vanishes" in why for why in found.rejected)

    def test_the_unit_of_length_does_not_decide(self):
        phi, s = R([20.0, 60.0, 110.0]), np.array([3.2, 2.7, 1.9])
        small, large = syn.slider_crank_function(phi, s), syn.slider_crank_function(phi, 1e12 * s)
        np.testing.assert_allclose(large[0].B, 1e12 * np.array(small[0].B), rtol=1e-9)

    def test_a_branch_defect_is_seen(self):
        """Points of both assemblies of one linkage: the equations hold, the motion does not."""
        a, b, c, d = 1.0, 2.5, 1.8, 2.2
        phi = R([40.0, 65.0, 95.0])
        psi = np.array([*rocker_angle(a, b, c, d, phi[:2]), rocker_angle(a, b, c, d, phi[2:], -1.0)[0]])
        (design,) = syn.precision_four_bars(phi, psi, ground=d)
        assert design.defects == ("branch",) and design.error > 0.1

    def test_messages(self):
        for points, says in (
            (([0, 1], [0, 1]), "2 precision points; with 0 offsets to be found there must be 3"),
            (([0, 1, 0.5], [0, 1, 2]), "inputs must increase"),
            (([0, 1, 2], [0, np.nan, 2]), r"outputs\[1\] is not finite"),
        ):
            with pytest.raises(nc.InputError, match=says):
                syn.precision_four_bars(*points)
        with pytest.raises(nc.InputError, match=r"5 unknowns.*input_start"):
            syn.function_four_bars(np.sin, (0, 1), 1.0, 1.0, points=3)
        with pytest.raises(nc.InputError, match="two different numbers"):
            syn.function_four_bars(np.cos, (-1, 1), 1.0, 1.0)
        for of_one in (lambda x: float(x) ** 2, math.exp, lambda x: x if x > 0 else -x):
            with pytest.raises(nc.InputError, match=r"function_four_bars: function: .* takes one number.*numpy\."):
                syn.function_four_bars(of_one, (1, 2), 1.0, 1.0)
            syn.function_four_bars(np.vectorize(of_one), (1, 2), 1.0, 1.0)


def rocker_angle(a, b, c, d, phi, side=1.0):
    """Closed form of the four-bar with A at the origin and D = (d, 0), C left of the way from B to D (side 1)."""
    B = a * np.exp(1j * np.asarray(phi))
    span = d - B
    along = (b * b - c * c + abs(span) ** 2) / (2 * abs(span) ** 2)
    across = side * np.sqrt(b * b / abs(span) ** 2 - along**2)
    return np.angle(B + span * (along + 1j * across) - d)


def test_slider_crank_at_three_points():
    """s² = 2 a s cos φ + 2 a e sin φ + b² - a² - e²: the linkage the points come from is found again."""
    a, b, e = 1.0, 3.0, 0.4
    phi = np.array([0.3, 0.9, 1.6])
    s = a * np.cos(phi) + np.sqrt(b * b - (e - a * np.sin(phi)) ** 2)
    found, error = syn.slider_crank_function(phi, s)
    assert error <= MET
    np.testing.assert_allclose(np.hypot(*found.B), a, rtol=1e-12)
    np.testing.assert_allclose(found.C[1], e, rtol=1e-11)
    with pytest.raises(nc.InputError, match="the crank would have no length"):
        syn.slider_crank_function([0.0, 0.5, 1.0], [2.0, 2.0, 2.0])


GIVEN = syn.FourBar((0, 0), (0, 1), (3.3, 2.9), (4, 0), (1.8, 2.6))
TURN = np.linspace(0.0, 2 * np.pi, 49)


def angle(p, q):
    return np.arctan2(q[1] - p[1], q[0] - p[0])


class TestCognates:
    def test_three_linkages_one_curve(self):
        curve = np.asarray(GIVEN.move({"phi": angle(GIVEN.A, GIVEN.B) + TURN})["P"])
        first, second = syn.roberts_cognates(GIVEN)
        # The first turns its coupler like the given crank, the second its crank at the third pivot.
        by_coupler = first.move({"theta": angle(first.B, first.C) + TURN})
        by_crank = second.move({"phi": angle(second.A, second.B) + TURN})
        for motion in (by_coupler, by_crank):
            assert bool(motion.converged.all())
            np.testing.assert_allclose(motion["P"], curve, atol=MET)
        assert first.A == GIVEN.A and second.D == GIVEN.D
        np.testing.assert_allclose(first.D, second.A, atol=1e-14)  # the third pivot

    def test_recognition(self):
        first, second = syn.roberts_cognates(GIVEN)
        nudged = syn.FourBar(GIVEN.A, GIVEN.B, GIVEN.C, GIVEN.D, (1.8, 2.6 + 1e-6))
        moved = syn.FourBar(*((x + 1.0, y) for x, y in (GIVEN.A, GIVEN.B, GIVEN.C, GIVEN.D, GIVEN.P)))
        later = GIVEN.move({"phi": angle(GIVEN.A, GIVEN.B) + TURN}).pose(7)
        other_pose = syn.FourBar(*(tuple(map(float, later[n])) for n in "ABCDP"))
        family = [GIVEN, first, second, GIVEN.reversed(), second.reversed(), other_pose, GIVEN.system, nudged, moved]
        assert syn.distinct(family) == [[0, 1, 2, 3, 4, 5, 6], [7], [8]]
        assert syn.same_curve(GIVEN, nudged, tolerance=1e-5)
        # The cognates of a cognate are the other two.
        for cognate in (first, second):
            again = syn.roberts_cognates(cognate)
            sizes = sorted(tuple(sorted(linkage.lengths.values())) for linkage in again)
            rest = [GIVEN, second if cognate is first else first]
            np.testing.assert_allclose(sizes, sorted(tuple(sorted(x.lengths.values())) for x in rest), rtol=1e-12)

    def test_a_library_four_bar_has_cognates(self):
        system = nc.library.four_bar(coupler_point=(0.06, 0.05)).compile()
        linkage = syn.FourBar.of(system)
        assert linkage.grashof.type == "crank-rocker"
        np.testing.assert_allclose(linkage.lengths["coupler"], 0.12, rtol=1e-12)
        assert syn.same_curve(system, syn.roberts_cognates(system)[0])

    def test_slider_crank(self):
        given = syn.SliderCrank((0, 0), (0.5, 0.8), (3, 0.2), (1, 0.1), (1.5, 1.1))
        other = syn.slider_crank_cognate(given)
        curve = nc.sweep(given.system, {"phi": angle(given.A, given.B) + TURN})["P"]
        again = nc.sweep(other.system, {"theta": angle(other.B, other.C) + TURN})["P"]
        np.testing.assert_allclose(again, curve, atol=MET)

    def test_messages(self):
        with pytest.raises(nc.InputError, match="on the moving pivot C and draws a circle"):
            syn.roberts_cognates(syn.FourBar((0, 0), (0, 1), (3, 3), (4, 0), (3, 3)))
        with pytest.raises(nc.InputError, match="no coupler point 'Q'"):
            syn.roberts_cognates(GIVEN.system, "Q")
        with pytest.raises(nc.InputError, match="is not on the coupler"):
            syn.roberts_cognates(GIVEN.system, "A")
        with pytest.raises(nc.InputError, match="is no four-bar"):
            syn.roberts_cognates(nc.library.jansen_leg().compile(), "F")
        with pytest.raises(nc.InputError, match="C and D are drawn at the same place"):
            syn.FourBar((0, 0), (0, 1), (3, 3), (3, 3))


def poses_of(linkage, angles):
    motion = linkage.move(
        {
            "phi": angle(linkage.A, linkage.B)
            + np.interp(np.arange(49), np.arange(len(angles)) * (48 // (len(angles) - 1)), angles)
        }
    )
    at = np.arange(len(angles)) * (48 // (len(angles) - 1))
    return np.column_stack([np.asarray(motion["P"])[at], np.asarray(motion["theta"])[at]])


@pytest.fixture(scope="module")
def five():
    return poses_of(GIVEN, [0.0, 0.35, 0.7, 1.1, 1.5])


class TestBurmester:
    def test_five_poses_of_a_known_linkage(self, five):
        """The linkage the poses come from is among the solutions, every four-bar really guides the body."""
        guide = syn.Guidance(five)
        pairs = guide.pairs()
        assert pairs.complete and pairs.residual < 1e-12
        for moving, fixed in ((GIVEN.B, GIVEN.A), (GIVEN.C, GIVEN.D)):
            assert min(np.hypot(*np.subtract(p.moving, moving)) for p in pairs) < 1e-10
            assert min(np.hypot(*np.subtract(p.fixed, fixed)) for p in pairs) < 1e-10
        bars = guide.four_bars()
        assert len(bars) == len(pairs) * (len(pairs) - 1) // 2
        assert any(not b.defects for b in bars)
        for b in bars:
            assert b.defects or b.error < GUIDED
        # Independently: sweep the best and look where the body is.
        best = bars[0]
        motion = nc.sweep(best.system, {"phi": np.interp(np.arange(49), np.arange(5) * 12, best.inputs)})
        np.testing.assert_allclose(np.asarray(motion["P"])[::12], five[:, :2], atol=GUIDED)
        turn = np.asarray(motion["theta"])[::12]
        np.testing.assert_allclose(turn - turn[0], five[:, 2] - five[0, 2], atol=GUIDED)

    def test_every_random_case_is_complete(self):
        """Five general poses have four pairs (Burmester 1888), 0, 2 or 4 of them real; no solution is lost."""
        rng = np.random.default_rng(1)
        counts = set()
        for _ in range(200):
            poses = np.column_stack([rng.normal(size=(5, 2)) * 10 ** rng.uniform(-3, 3), rng.uniform(-3, 3, 5)])
            pairs = syn.Guidance(poses).pairs()
            assert pairs.complete, pairs
            counts.add(len(pairs))
        assert counts == {0, 2, 4}

    def test_curves_of_four_poses(self, five, tmp_path):
        guide = syn.Guidance(five[:4])
        curves = guide.curves()
        good = np.isfinite(curves.circle).all(axis=1) & np.isfinite(curves.centre).all(axis=1)
        assert good.sum() > 50
        turn = np.exp(1j * (five[:4, 2] - five[0, 2]))
        place = five[:4, 0] + 1j * five[:4, 1]
        b, a = (c[good] @ [1, 1j] for c in (curves.circle, curves.centre))
        radii = np.abs(turn[:, None] * (b - place[0]) + place[:, None] - a)
        np.testing.assert_allclose(np.ptp(radii / radii.mean(axis=0), axis=0), 0.0, atol=1e-9)
        # Poles are centre points; both pivots of the linkage are on the curves.
        for near, centre in ((GIVEN.B, GIVEN.A), (GIVEN.C, GIVEN.D)):
            dyad = guide.curve_dyad(near)
            np.testing.assert_allclose([dyad.moving, dyad.fixed], [near, centre], atol=1e-9)
            assert dyad.residual < 1e-12
        one, two = guide.curve_dyad((0.2, 1.2)), guide.curve_dyad((3.0, 3.0))
        design = guide.four_bar(one, two)
        assert design.defects or design.error < GUIDED
        # The five-pose pairs lie where the curves of two choices of four poses meet.
        for pair in syn.Guidance(five).pairs():
            for four in itertools.combinations(range(5), 4):
                if 0 in four:
                    dyad = syn.Guidance(five[list(four)]).curve_dyad(pair.moving)
                    np.testing.assert_allclose(dyad.moving, pair.moving, atol=1e-7)
        path = tmp_path / "curves.png"
        curves.plot(poses=five[:4], path=path)
        assert path.stat().st_size > 10_000

    def test_three_and_two_poses(self, five):
        three = syn.Guidance(five[:3])
        there = three.dyad(moving=GIVEN.B)
        np.testing.assert_allclose(there.fixed, GIVEN.A, atol=1e-11)
        back = three.dyad(fixed=GIVEN.D)
        np.testing.assert_allclose(back.moving, GIVEN.C, atol=1e-11)
        design = three.four_bar(there, back)
        assert not design.defects and design.error < MET
        two = syn.Guidance(five[:2])
        for along in (-1.0, 2.0):
            for dyad in (two.dyad(moving=(0.3, 1.0), along=along), two.dyad(fixed=(4.0, 0.0), along=along)):
                assert dyad.residual < 1e-14
        with pytest.raises(nc.InputError, match="along= must be one finite number"):
            two.dyad(moving=(0.3, 1.0), along=np.nan)
        # The pole stays: two poses turn about it.
        pole = complex(*two.pole(0, 1))
        turn = np.exp(1j * (five[1, 2] - five[0, 2]))
        start, end = (complex(*p) for p in five[:2, :2])
        assert abs(turn * (pole - start) + end - pole) < 1e-13

    @pytest.mark.parametrize("near", [(-40, 30), (1000, 0), (-3, -3), (5, 5), (0, 0), (100, 50)])
    def test_a_curve_dyad_is_exact_and_the_nearest(self, near):
        guide = syn.Guidance([[0, 0, 0], [1.0, 0.6, 0.5], [2.0, 0.9, 1.1], [2.6, 0.4, 1.9]])
        dyad = guide.curve_dyad(near)
        assert dyad.residual < 1e-14
        circle = guide.curves(points=4000, extent=200.0).circle
        nearest = np.nanmin(np.hypot(*(circle - near).T))
        assert np.hypot(*np.subtract(dyad.moving, near)) <= nearest * (1 + 1e-9)

    def test_far_away_a_curve_is_its_asymptote(self):
        """A straight line that passes the poses: places in one direction are as far from it as they are away."""
        guide = syn.Guidance([[0, 0, 0], [1.0, 0.6, 0.5], [2.0, 0.9, 1.1], [2.6, 0.4, 1.9]])
        away = np.array([1e3, 1e4, 1e5])
        for way in (1.0, -1.0):
            off = [np.hypot(*np.subtract(guide.curve_dyad((way * x, 0.0)).moving, (way * x, 0.0))) / x for x in away]
            np.testing.assert_allclose(off, off[-1], rtol=1e-2)

    def test_poses_of_which_no_curve_is_known(self):
        turns, ways = [[0, 0, t] for t in (0, 0.5, 1.0, 1.5)], [[0, 0, 0], [1, 0.5, 0], [1.5, 2, 0], [3, 1, 0]]
        for poses in (turns, ways):
            for ask in (lambda guide: guide.curves(), lambda guide: guide.curve_dyad((1, 1))):
                with pytest.raises(nc.InputError, match="every point"):
                    ask(syn.Guidance(poses))

    @pytest.mark.parametrize(
        ("given", "says"), [({"points": 1}, "points"), ({"extent": -1.0}, "extent"), ({"extent": 1e-3}, "within")]
    )
    def test_how_a_curve_is_asked_for(self, five, given, says):
        with pytest.raises(nc.InputError, match=says):
            syn.Guidance(five[:4]).curves(**given)

    def test_poses_at_one_place(self):
        """A body that turns about its origin: the poses have no size, the coupler has."""
        guide = syn.Guidance([[0, 0, 0], [0, 0, 0.5]])
        design = guide.four_bar(guide.dyad(moving=(1, 0), along=-0.7), guide.dyad(moving=(0.3, 1), along=1.2))
        assert not design.defects and design.error < 1e-12

    def test_a_parallelogram_may_leave_at_its_change_point(self):
        turns = np.array([0.0, 0.5, 1.1])
        guide, found = syn.Guidance(np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)), []
        for along in np.linspace(0.2, 2 * np.pi, 12):  # direction of the coupler; in line where the cranks have it too
            design = guide.four_bar(guide.dyad((1, 0)), guide.dyad((1 + 3 * np.cos(along), 3 * np.sin(along))))
            np.testing.assert_allclose(sorted(design.linkage.lengths.values()), [1, 1, 3, 3], atol=1e-9)
            found.append((along % np.pi < 1.1, design.defects))
        assert {*found} == {(True, ("branch",)), (False, ())}

    def test_an_order_defect_is_seen(self, five):
        guide = syn.Guidance(five[[0, 2, 1, 3]])
        design = guide.four_bar(guide.curve_dyad(GIVEN.B), guide.curve_dyad(GIVEN.C))
        assert design.defects == ("order",)

    def test_a_circuit_defect_is_seen(self):
        """One pose from the other assembly of a crank-rocker."""
        mirrored = _mirrored(GIVEN, 1.1)
        poses = poses_of(GIVEN, [0.0, 0.7, 1.1])
        poses[2] = mirrored
        guide = syn.Guidance(poses)
        design = guide.four_bar(guide.dyad(moving=GIVEN.B), guide.dyad(fixed=GIVEN.D))
        assert design.defects == ("circuit",)

    def test_all_stationary_bars_near_many_poses(self):
        """None of the minima that SciPy finds from random starts is missing, and every one is stationary."""
        rng = np.random.default_rng(7)
        poses = poses_of(GIVEN, np.linspace(0.0, 1.5, 9)) + 0.02 * rng.normal(size=(9, 3))
        place, turn = poses[:, 0] + 1j * poses[:, 1], np.exp(1j * (poses[:, 2] - poses[0, 2]))

        def cost(x: np.ndarray) -> float:
            square = np.abs(turn * (x[0] + 1j * x[1] - place[0]) + place - x[2] - 1j * x[3]) ** 2
            return float(np.var(square))

        found = syn.Guidance(poses).nearest_dyads()
        at = np.array([[*dyad.moving, *dyad.fixed] for dyad in found])
        assert found.complete and found.proved.all() and len(found) > 3
        step = 1e-3 * np.eye(4)
        for x, least in zip(at, found.minima, strict=True):
            slope = np.array([(cost(x + h) - cost(x - h)) / 2e-3 for h in step])
            bend = [
                [(cost(x + h + k) - cost(x + h - k) - cost(x - h + k) + cost(x - h - k)) / 4e-6 for k in step]
                for h in step
            ]
            assert np.abs(np.linalg.solve(bend, slope)).max() < 1e-4
            assert (np.linalg.eigvalsh(bend)[0] > 0) == least
        ends = [scipy.optimize.minimize(cost, 5.0 * rng.normal(size=4), method="BFGS", tol=1e-12) for _ in range(30)]
        ends = [end.x for end in ends if np.abs(end.x).max() < 50.0 and np.abs(end.jac).max() < 1e-6]
        assert len(ends) > 10
        minima = at[found.minima]
        for x in ends:
            assert np.abs(minima - x).max(axis=1).min() < 1e-3 * np.abs(x).max()

    def test_general_poses_have_twenty_five_stationary_bars(self):
        rng = np.random.default_rng(1)
        for n in (6, 7, 12, 30):
            poses = np.column_stack([rng.normal(size=(n, 2)), rng.uniform(-3, 3, n)])
            found = syn.Guidance(poses).nearest_dyads()
            assert found.complete and found.proved.all() and len(found) + found.complex_points == 25
            assert found.minima.any()

    def test_pairs_of_five_poses_are_among_the_stationary_bars(self, five):
        guide = syn.Guidance(five)
        near = guide.nearest_dyads()
        for pair in guide.pairs():
            k = int(np.argmin([np.hypot(*np.subtract(dyad.moving, pair.moving)) for dyad in near]))
            np.testing.assert_allclose(
                [*near[k].moving, *near[k].fixed], [*pair.moving, *pair.fixed], rtol=1e-6, atol=1e-8
            )
            assert near.minima[k] and near.errors[k] < 1e-9
        assert "Proved to exist" in near.statement and "minimum" in str(near)

    def test_an_exact_bar_is_a_minimum_where_several_meet(self):
        """Where the origin goes round with half the turn its bar is exact, and second derivatives vanish."""
        t = np.array([0.0, 0.3, 0.5, 0.9, 1.3, 1.4, 1.6])
        near = syn.Guidance(np.stack([np.cos(t), np.sin(t), 2 * t], axis=1)).nearest_dyads()
        exact = near.errors < 1e-12
        np.testing.assert_allclose([*near[0].moving, *near[0].fixed], [1, 0, 0, 0], atol=1e-6)
        assert exact[0] and near.minima[exact].all()

    def test_stationary_bars_of_small_turns_and_of_far_points(self):
        """A wishbone moved a little comes back; which point of the body tells the poses does not matter."""
        wishbone = syn.FourBar((0.35, 0.2), (0.72, 0.19), (0.68, 0.48), (0.40, 0.45), (0.78, 0.31))
        start = float(np.angle(wishbone.z[1] - wishbone.z[0]))
        motion = wishbone.move({"phi": start + np.linspace(-0.2, 0.2, 9)})
        poses = np.column_stack([motion["P"], motion["theta"]])
        best = syn.Guidance(poses).four_bars()[0]
        assert not best.defects and best.error < 1e-10
        np.testing.assert_allclose(sorted(best.linkage.lengths.values()), sorted(wishbone.lengths.values()), rtol=1e-8)
        poses = poses_of(GIVEN, np.linspace(0.0, 1.5, 8)) + 0.02 * np.random.default_rng(3).normal(size=(8, 3))
        near = syn.Guidance(poses).nearest_dyads()
        far = np.column_stack(
            [poses[:, :2] + 1e3 * np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], 1), poses[:, 2]]
        )
        again = syn.Guidance(far).nearest_dyads()
        assert near.complete and len(near) == len(again)
        np.testing.assert_allclose(near.errors, again.errors, rtol=1e-5)

    def test_a_bar_may_go_a_little_back_near_many_poses(self):
        """Of a whole turn in small steps, noise turns some of them round."""
        linkage = syn.FourBar((0, 0), (1, 0.2), (3, 2.5), (4, 0), (2, 2.5))
        motion = linkage.move({"phi": np.linspace(0.2, 6.35, 200)})
        poses = np.column_stack([motion["P"], motion["theta"]])
        poses = poses + 0.01 * np.random.default_rng(5).normal(size=poses.shape)
        best = syn.Guidance(poses).four_bars()[0]
        assert not best.defects and best.error < 0.1 and (np.diff(best.inputs) < 0).any()

    def test_four_bars_near_many_poses(self):
        """Of exact poses the linkage itself comes back; of others one that is moved and told how near it comes."""
        poses = poses_of(GIVEN, np.linspace(0.0, 1.5, 9))
        best = syn.Guidance(poses).four_bars()[0]
        assert not best.defects and best.error < 1e-8
        np.testing.assert_allclose(sorted(best.linkage.lengths.values()), sorted(GIVEN.lengths.values()), atol=1e-8)
        poses = poses + 0.01 * np.random.default_rng(7).normal(size=poses.shape)
        best = syn.Guidance(poses).four_bars()[0]
        motion = nc.sweep(best.system, {"phi": best.inputs})
        off = np.hypot(*(np.asarray(motion["P"]) - poses[:, :2]).T).max()
        assert 1e-4 < off <= best.error * 1.000001 and best.error < 0.15

    def test_messages(self, five):
        for poses, says in (
            (five[:1], "1 poses; give at least 2"),
            (five[:, :2], r"shape \(n, 3\)"),
            (five[[0, 1, 1]], "poses 2 and 3 are the same"),
            (np.where(np.arange(15).reshape(5, 3) == 7, np.nan, five), "pose 3 is not finite"),
        ):
            with pytest.raises(nc.InputError, match=says):
                syn.Guidance(poses)
        with pytest.raises(nc.InputError, match=r"use pairs\(\)"):
            syn.Guidance(five).dyad(moving=(0, 1))
        with pytest.raises(nc.InputError, match="needs 5 poses, this has 4"):
            syn.Guidance(five[:4]).pairs()
        six = poses_of(GIVEN, np.linspace(0.0, 1.5, 6))
        with pytest.raises(nc.InputError, match=r"needs 5 poses, this has 6; .*nearest_dyads"):
            syn.Guidance(six).pairs()
        with pytest.raises(nc.InputError, match="needs 5 poses or more"):
            syn.Guidance(five[:4]).nearest_dyads()
        with pytest.raises(nc.InputError, match="does not turn"):
            syn.Guidance(np.column_stack([six[:, :2], np.full(6, 0.2)])).nearest_dyads()
        with pytest.raises(nc.InputError, match="does not turn"):
            syn.Guidance(np.column_stack([six[:5, :2], np.full(5, 0.2)])).pairs()
        dyads = syn.Guidance(six).nearest_dyads()
        with pytest.raises(nc.InputError, match="a dyad of 6 poses, where there are 5"):
            syn.Guidance(five).four_bar(dyads[0], dyads[1])
        with pytest.raises(nc.InputError, match="a dyad of other poses"):
            syn.Guidance(five).four_bar(*syn.Guidance(np.add(five, (0.0, 0.3, 0.0))).pairs().pairs[:2])
        about_one = np.column_stack([np.full(6, 0.1), np.full(6, 0.2), np.linspace(0, 2, 6)])
        with pytest.raises(nc.InputError, match="infinitely many dyads"):
            syn.Guidance(about_one[:5]).pairs()
        with pytest.raises(nc.InputError, match="about one point"):
            syn.Guidance(about_one).nearest_dyads()
        shifted = np.array([[0, 0, 0.2], [1, 0, 0.2], [2, 0, 0.2]])
        with pytest.raises(nc.InputError, match="moving pivot lie in a line"):
            syn.Guidance(shifted).dyad(moving=(0, 1))


def _mirrored(linkage, turn):
    """Pose of the coupler in the other assembly, crank turned by an angle."""
    a, b, c, d, _ = linkage.z
    pin = a + (b - a) * np.exp(1j * turn)
    span = d - pin
    along = (abs(c - b) ** 2 - abs(d - c) ** 2 + abs(span) ** 2) / (2 * abs(span) ** 2)
    across = np.sqrt(abs(c - b) ** 2 / abs(span) ** 2 - along**2)
    joints = [pin + span * (along + side * 1j * across) for side in (1, -1)]
    drawn = np.sign(((c - b).conjugate() * (d - b)).imag)
    joint = next(j for j in joints if np.sign(((j - pin).conjugate() * (d - pin)).imag) != drawn)
    place = pin + linkage.ratio * (joint - pin)
    return place.real, place.imag, np.angle(joint - pin)


@pytest.mark.parametrize("over", [(-140.0, 140.0), (140.0, -140.0), (-90.0, 140.0)])
def test_a_range_may_begin_more_than_half_a_turn_from_the_drawing(over):
    """A triple-rocker that closes for cranks within 151 degrees, by the law of cosines."""
    crank, coupler, rocker = 0.7, 0.93, 0.72

    def output(x):
        b = crank * np.exp(1j * np.asarray(x))
        span = 1.0 - b
        along = (coupler**2 - rocker**2 + abs(span) ** 2) / (2.0 * abs(span))
        joint = b + (along + 1j * np.sqrt(coupler**2 - along**2)) * span / abs(span)
        return np.unwrap(np.angle(joint - 1.0))

    x, grid = R([80.0, 110.0, 135.0]), R(np.linspace(-140.0, 140.0, 561))
    every = output(grid)
    design = syn.precision_four_bars(x, np.interp(x, grid, every), 0.0, 0.0, over=R(over))[0]
    assert design.defects == () and design.error < 1e-9
    np.testing.assert_allclose(list(design.linkage.lengths.values()), (1.0, crank, coupler, rocker), rtol=1e-3)


def test_linkages_are_differentiable_systems():
    """What exact synthesis returns is a design like any other."""
    grad = jax.grad(lambda s: nc.sweep(s, {"phi": angle(GIVEN.A, GIVEN.B) + TURN})["P"][:, 1].max())(GIVEN.system)
    assert np.isfinite(np.asarray(grad["C"])).all() and np.abs(np.asarray(grad["C"])).max() > 0


@pytest.mark.parametrize(("function", "over"), [(np.log10, (1.0, 2.0)), (np.square, (0.0, 1.0)), (np.sin, (0.0, 1.5))])
def test_offsets_are_those_of_the_bars(function, over):
    """By the drawing: where a length comes out negative, a bar stands half a turn from the equations' offset."""
    for design in syn.function_four_bars(function, over, R(60), R(80)):
        one = design.linkage
        a, b, c, d = (complex(*getattr(one, name)) for name in "ABCD")
        crank, rocker = np.angle(b - a) - design.inputs[0], np.angle(c - d) - design.outputs[0]
        for off in (crank - design.input_offset, rocker - design.output_offset):
            assert abs(np.angle(np.exp(1j * off))) < 1e-9


def test_a_crank_of_negative_length_is_told():
    with pytest.warns(UserWarning, match="negative length"):
        found, error = syn.slider_crank_function(R([20.0, 60.0, 100.0]), [1.0, 1.5, 1.8])
    assert error <= MET and np.angle(complex(*found.B)) == pytest.approx(R(-160.0))
