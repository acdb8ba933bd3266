"""Tolerances, robust objectives and calibration."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc
from jaxnc import synthesis as syn

POSES = np.linspace(0.0, 2 * np.pi, 13)
SAMPLES = 4000
WIDTHS = {"crank.A-B": 1e-4, "coupler.B-C": 2e-4, "rocker.C-D": 1e-4, "D.x": 1e-4}
FITTED = ["crank.A-B", "coupler.B-C", "rocker.C-D", "D", "coupler.P.along", "coupler.P.across"]


@pytest.fixture(scope="module")
def system():
    return nc.library.four_bar(coupler_point=(0.06, 0.05)).compile()


@pytest.fixture(scope="module")
def found(system):
    return nc.tolerance(system, {"phi": POSES}, ["P", "C"], WIDTHS, samples=SAMPLES, key=jax.random.key(1))


@pytest.fixture(scope="module")
def real(system):
    changed = {"crank.A-B": 0.0405, "coupler.B-C": 0.121, "rocker.C-D": 0.0795, "coupler.P.along": 0.0611}
    return system.replace(changed | {"D": np.array([0.101, 0.0007])})


@pytest.fixture(scope="module")
def measured(real):
    return np.asarray(nc.sweep(real, {"phi": POSES})["P"])


def coupler_point(crank, coupler, rocker, ground, phi):
    """Closed form of the library's four-bar, vectorised over samples."""
    B = crank * np.exp(1j * phi)
    span = ground - B
    along = (coupler**2 - rocker**2 + abs(span) ** 2) / (2 * abs(span) ** 2)
    joint = span * (along + 1j * np.sqrt(coupler**2 / abs(span) ** 2 - along**2))
    return B + joint / abs(joint) * (0.06 + 0.05j)


class TestTolerance:
    def test_first_order_by_central_differences_of_the_closed_form(self, found):
        nominal = np.array([0.04, 0.12, 0.08, 0.10])
        slopes = []
        for k in range(4):
            h = np.zeros(4)
            h[k] = 1e-6
            ends = [coupler_point(*(nominal + s * h)[:, None], POSES) for s in (-1, 1)]
            slopes.append((ends[1] - ends[0]) / 2e-6)
        slopes, half = np.array(slopes), np.array(list(WIDTHS.values()))[:, None]
        for axis, part in (("x", slopes.real), ("y", slopes.imag)):
            s = found[f"P.{axis}"]
            np.testing.assert_allclose(s.first_order, np.sqrt(((part * half / 3) ** 2).sum(axis=0)), rtol=1e-6)
            np.testing.assert_allclose(s.worst_case, np.abs(part * half).sum(axis=0), rtol=1e-6)
            shares = ((part * half) ** 2).sum(axis=1)
            np.testing.assert_allclose(s.shares, shares / shares.sum(), rtol=1e-6)
            assert found.worst[f"P.{axis}"] == list(WIDTHS)[int(np.argmax(shares))]

    def test_monte_carlo_agrees_within_its_statistical_error(self, found):
        assert found.failed == 0 and found.variables == tuple(WIDTHS)
        for label, s in found.outputs.items():
            # Five standard errors, and the curvature of the mechanism: (t / length)² beside 1.
            assert np.abs(found.ratio(label) - 1.0).max() < 5 * found.statistical_error + 1e-3
            assert np.abs(s.mean - s.nominal).max() < 5 * s.std.max() / np.sqrt(SAMPLES) + 1e-6
            # Percentiles of a normal output: ± 2.5758 σ, with their own statistical error.
            np.testing.assert_allclose(s.percentiles[0] - s.nominal, -2.5758 * s.first_order, rtol=0.12)
            np.testing.assert_allclose(s.percentiles[1], s.mean, atol=0.1 * s.std.max())

    def test_samples_are_those_of_the_closed_form(self, system, found):
        """The batch is exact lane by lane: the same deviations through the closed form give the same statistics."""
        from jaxnc.synthesis.tolerance.spread import read_variation

        vary = read_variation("test", system, WIDTHS)
        changed = np.array([0.04, 0.12, 0.08, 0.1]) + np.asarray(vary.draw(jax.random.key(1), SAMPLES))
        exact = coupler_point(*changed.T[:, :, None], POSES)
        np.testing.assert_allclose(found["P.x"].std, exact.real.std(axis=0, ddof=1), rtol=1e-9)
        np.testing.assert_allclose(found["P.y"].mean, exact.imag.mean(axis=0), rtol=1e-12)

    def test_correlation_and_distribution(self, system):
        """Deviations in step add up, not their squares; a uniform one has σ = t/√3."""
        sigma, which = 1e-4, np.array([1.0, 0.0, 1.0, 0.0])
        ask = {"inputs": {"phi": POSES}, "outputs": ["P", "C"], "samples": SAMPLES}
        both = nc.tolerance(system, tolerances=WIDTHS, covariance=sigma**2 * np.outer(which, which), **ask)
        slopes = nc.sensitivity(system, "P", {"phi": POSES}, variables=["crank.A-B", "rocker.C-D"])["P"]
        expected = sigma * np.abs(slopes.sum(axis=-1))
        np.testing.assert_allclose(both["P.x"].first_order, expected[:, 0], rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(both["P.x"].std, expected[:, 0], rtol=6 * both.statistical_error, atol=5e-7)
        assert "correlated" in str(both)
        widths = dict(zip(WIDTHS, sigma * which, strict=True))
        flat = nc.tolerance(system, tolerances=widths, distribution="uniform", **ask)
        np.testing.assert_allclose(
            flat["P.y"].first_order, sigma / np.sqrt(3) * np.sqrt((slopes[:, 1] ** 2).sum(axis=-1)), rtol=1e-9
        )
        np.testing.assert_allclose(flat.ratio("P.y"), 1.0, atol=5 * flat.statistical_error)
        worst = np.abs(flat["P.y"].percentiles - flat["P.y"].nominal).max(axis=0)
        assert (worst <= flat["P.y"].worst_case * 1.01).all()

    def test_table_and_picture(self, found, tmp_path):
        text = str(found)
        for piece in ("σ first order", "σ Monte Carlo", "0.5 % … 99.5 %", "worst case", "variance from", "P.x ="):
            assert piece in text
        path = tmp_path / "band.png"
        found.plot("P.y", path=path)
        assert path.stat().st_size > 10_000
        with pytest.raises(nc.InputError, match=r"no output 'P.z'; did you mean"):
            found["P.z"]

    def test_designs_that_do_not_assemble_are_counted(self, system):
        """A crank near its Grashof limit: about half of the samples lose their full turn, and the table says so."""
        edge = system.replace({"crank.A-B": 0.0599})
        risky = {**WIDTHS, "crank.A-B": 6e-4}
        result = nc.tolerance(edge, {"phi": POSES}, ["P", "C"], risky, samples=SAMPLES, key=jax.random.key(1))
        assert 0.2 * SAMPLES < result.failed < 0.5 * SAMPLES
        assert f"{result.failed} of {SAMPLES} samples did not assemble" in str(result)
        assert np.isfinite(result["P.x"].std).all()

    def test_messages(self, system):
        good = {"system": system, "inputs": {"phi": POSES}, "outputs": "P", "tolerances": WIDTHS}
        for change, says in (
            ({"tolerances": {"crank.A-C": 1.0}}, "tolerance: 'four-bar' has no design variable 'crank.A-C'; did you"),
            ({"tolerances": {"crank.A-C": 1.0}}, "read off the drawing unless the body gives it with lengths="),
            ({"tolerances": {"D": 1e-4, "D.x": 1e-4}}, "'D.x' has two tolerances"),
            ({"tolerances": {"D": -1.0}}, "tolerance of 'D' must be finite and not negative"),
            ({"distribution": "gauss"}, "distribution='gauss'; use 'normal' or 'uniform'"),
            ({"samples": 1}, "samples.*at least 2, got 1"),
            ({"covariance": np.eye(3)}, r"covariance has shape \(3, 3\); the 4 components"),
            ({"covariance": -np.eye(4)}, "negative eigenvalue"),
            ({"covariance": np.eye(4), "distribution": "uniform"}, "covariance= is for distribution='normal'"),
            ({"percentiles": (50, 5)}, "must increase"),
            ({"outputs": []}, "no outputs"),
        ):
            with pytest.raises(nc.InputError, match=says):
                nc.tolerance(**(good | change))


def highest(motion):
    return jnp.max(motion["P"][:, 1])


class TestRobust:
    def test_statistics_and_gradient(self, system):
        ask = {"inputs": {"phi": POSES}, "output": highest, "tolerances": WIDTHS, "samples": 16}
        measures = {
            s: nc.synthesis.robust(system, statistic=s, **ask)
            for s in ("std", "percentile", "mean", "worst", "variance")
        }
        values, good = (np.asarray(v) for v in measures["std"].samples(system))
        assert good.all() and int(measures["std"].failures(system)) == 0
        expected = {
            "std": values.std(ddof=1),
            "variance": values.var(ddof=1),
            "percentile": np.percentile(values, 95),
            "mean": values.mean(),
            "worst": values.max(),
        }
        for name, measure in measures.items():
            assert float(measure(system)) == pytest.approx(expected[name], rel=1e-12), name
        assert float(jax.jit(measures["std"])(system)) == pytest.approx(expected["std"], rel=1e-12)
        slope = float(jax.grad(measures["std"])(system)["crank.A-B"])
        ends = [float(measures["std"](system.replace({"crank.A-B": 0.04 + h}))) for h in (-1e-6, 1e-6)]
        assert slope == pytest.approx((ends[1] - ends[0]) / 2e-6, rel=1e-6)

    def test_failing_never_pays(self, system):
        ask = {"inputs": {"phi": POSES}, "output": highest, "tolerances": WIDTHS, "samples": 16}
        measure = nc.synthesis.robust(system, statistic="mean", **ask)
        edge, beyond = (system.replace({"crank.A-B": a}) for a in (0.0597, 0.0605))
        assert int(measure.failures(beyond)) > int(measure.failures(edge))
        assert float(measure(beyond)) > float(measure(edge)) + 0.1
        gradient = jax.grad(measure)(beyond)
        assert all(np.isfinite(np.asarray(leaf)).all() for leaf in jax.tree.leaves(gradient))

    @pytest.mark.parametrize("statistic", ["mean", "std", "percentile", "worst"])
    @pytest.mark.parametrize("penalty", [None, 0.0])
    def test_gradients_are_those_of_the_value_where_some_fail(self, statistic, penalty):
        lengths = {"crank": 0.04, "coupler": 0.07, "rocker": 0.06, "ground": 0.085}
        system = nc.library.four_bar(**lengths, coupler_point=(0.06, 0.05)).compile()
        wide = {"crank.A-B": 8e-3, "coupler.B-C": 8e-3}
        inputs = {"phi": np.linspace(0.0, 2.0 * np.pi, 37)}
        ask = {"inputs": inputs, "output": highest, "tolerances": wide, "samples": 16}
        measure = nc.synthesis.robust(system, statistic=statistic, penalty=penalty, **ask)
        at = float(system["rocker.C-D"])
        near = [system.replace({"rocker.C-D": at + h}) for h in (-1e-6, 1e-6)]
        assert {int(measure.failures(s)) for s in (*near, system)} == {2}
        slope = (float(measure(near[1])) - float(measure(near[0]))) / 2e-6
        assert float(jax.grad(measure)(system)["rocker.C-D"]) == pytest.approx(slope, rel=1e-5)

    def test_messages(self, system):
        ask = {"inputs": {"phi": POSES}, "output": highest, "tolerances": WIDTHS, "samples": 16}
        with pytest.raises(nc.InputError, match="statistic='median'"):
            nc.synthesis.robust(system, **ask, statistic="median")
        with pytest.raises(nc.InputError, match=r"samples.*at least 2, got 1"):
            nc.synthesis.robust(system, **(ask | {"samples": 1}))
        with pytest.raises(nc.InputError, match="must be one number for a design"):
            nc.synthesis.robust(system, **(ask | {"output": "P"}))


class TestCalibration:
    def test_recovers_a_known_design(self, system, real, measured):
        fit = nc.synthesis.calibrate(system, {"phi": POSES}, {"P": measured}, FITTED)
        assert jax.tree.structure(fit.system) == jax.tree.structure(system)  # what is compiled for one serves the other
        assert fit.converged and fit.iterations < 15 and not fit.undetermined
        for name in ("crank.A-B", "coupler.B-C", "rocker.C-D", "coupler.P.along", "coupler.P.across"):
            assert fit[name][0] == pytest.approx(float(real[name]), abs=1e-12)
        np.testing.assert_allclose(fit.system["D"], real["D"], atol=1e-12)
        assert fit.degrees_of_freedom == 2 * len(POSES) - 7 and fit.rms["P"] < 1e-14

    def test_covariance_against_repeated_fits(self, system, measured):
        """Two hundred seeded fits: their scatter is what each of them predicts."""
        rng = np.random.default_rng(4)
        sigma, values, chi = 1e-5, [], []
        for _ in range(200):
            fit = nc.synthesis.calibrate(
                system, {"phi": POSES}, {"P": measured + sigma * rng.normal(size=measured.shape)}, FITTED, sigma=sigma
            )
            values.append(fit.values)
            chi.append(fit.chi_square)
        scatter = np.cov(np.array(values).T)
        spread = np.sqrt(np.diag(scatter))
        np.testing.assert_allclose(spread, fit.standard_errors, rtol=5 / np.sqrt(2 * 199))
        np.testing.assert_allclose(np.corrcoef(np.array(values).T), fit.correlation, atol=0.25)
        freedom = fit.degrees_of_freedom
        assert abs(np.mean(chi) - freedom) < 5 * np.sqrt(2 * freedom / 200)
        # Without sigmas the noise is estimated from the residuals.
        fit = nc.synthesis.calibrate(
            system, {"phi": POSES}, {"P": measured + sigma * rng.normal(size=measured.shape)}, FITTED
        )
        assert fit.scaled and fit.noise == pytest.approx(sigma, rel=5 / np.sqrt(2 * freedom))

    def test_what_is_not_determined_is_named(self, system, measured):
        """The drawn place of P means nothing where its local coordinates are dimensions."""
        fit = nc.synthesis.calibrate(system, {"phi": POSES}, {"P": measured}, [*FITTED[:4], "P"])
        assert fit.undetermined == ("P.x", "P.y") and len(fit.combinations) == 2
        np.testing.assert_array_equal(fit.system["P"], system["P"])
        assert np.isinf(fit["P.x"][1]) and np.isfinite(fit["crank.A-B"][1])
        assert "not determined by these measurements, in 2 combinations: P.x, P.y" in str(fit)

    def test_missing_measurements(self, system, real, measured):
        holes = measured.copy()
        holes[3] = np.nan
        holes[5, 1] = np.nan
        fit = nc.synthesis.calibrate(system, {"phi": POSES}, {"P": holes}, FITTED)
        assert fit["crank.A-B"][0] == pytest.approx(float(real["crank.A-B"]), abs=1e-12)
        assert fit.degrees_of_freedom == 2 * len(POSES) - 3 - 7
        assert np.isnan(fit.residuals["P"][3]).all() and np.isnan(fit.residuals["P"][5, 1])

    def test_a_sigma_for_each_pose(self, system, real, measured):
        """A pose that is measured badly, and is known to be, spoils nothing."""
        sigma = np.where(np.arange(len(POSES)) == 3, 1e3, 1e-6)
        bad = {"P": measured + 0.01 * (sigma > 1.0)[:, None]}
        fit = nc.synthesis.calibrate(system, {"phi": POSES}, bad, FITTED, sigma={"P": sigma})
        assert fit["crank.A-B"][0] == pytest.approx(float(real["crank.A-B"]), abs=1e-12)

    def test_messages(self, system, measured):
        good = {"system": system, "inputs": {"phi": POSES}, "measurements": {"P": measured}, "variables": FITTED}
        for change, says in (
            ({"measurements": {"Q": measured}}, "calibration: no output 'Q'"),
            (
                {"measurements": {"P": measured[:5]}},
                r"measurement of 'P' has shape \(5, 2\); with these inputs \(13, 2\)",
            ),
            ({"measurements": {"P": measured * np.nan}}, "every measurement is NaN"),
            ({"variables": ["crank"]}, "calibration: 'four-bar' has no design variable 'crank'"),
            ({"variables": []}, "no variables"),
            ({"sigma": 0.0}, "sigma of 'P' must be positive"),
            ({"sigma": {"C": 1.0}}, "sigma has nothing for 'P'"),
            ({"sigma": np.ones(5)}, r"has shape \(5,\); give one number, .* \(13,\) or \(2,\) or \(13, 2\)"),
        ):
            with pytest.raises(nc.InputError, match=says):
                nc.synthesis.calibrate(**(good | change))


def test_what_is_held_stays_there_in_all_samples_as_in_derivatives():
    """A bar held at its angle, which the drawing of its end changes too: of C = B + L (cos ψ, sin ψ) only L varies."""
    m = nc.Mechanism("arm")
    m.ground("A", (0, 0))
    m.point("B", (1, 0.3))
    m.point("C", (1.8, 0.9))
    m.body("upper", ["A", "B"])
    m.body("lower", ["B", "C"])
    m.angle("phi", at="A", to="B")
    m.angle("psi", at="B", to="C")
    found = nc.tolerance(m.compile(), {"phi": 0.7}, "C", {"C": 3e-3}, hold=["psi"], samples=2000)
    assert list(found.inputs) == ["phi"]
    for name, part in (("C.x", 0.8), ("C.y", 0.6)):
        assert float(found[name].first_order) == pytest.approx(1e-3 * part, rel=1e-9)
        assert float(found[name].std) == pytest.approx(1e-3 * part, rel=5 / np.sqrt(2 * 2000))  # five deviations


def test_angles_drawn_near_half_a_turn_keep_their_turn():
    """A rocker that points to the left: its samples lie about π, not on both sides of ±π."""
    m = nc.Mechanism("four-bar")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    m.point("B", (0.2, 0.98))
    m.point("C", (1.5, 0))
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C"])
    m.body("rocker", ["C", "D"])
    m.angle("phi", at="A", to="B")
    m.angle("psi", at="D", to="C")
    system, at = m.compile(), {"phi": float(np.arctan2(0.98, 0.2))}
    widths = {"B": 1e-2, "C": 1e-2, "D": 1e-2}
    spread = nc.tolerance(system, at, "psi", widths, samples=500)["psi"]
    assert spread.std == pytest.approx(float(spread.first_order), rel=0.1)
    assert np.abs(spread.percentiles - np.pi).max() < 0.02
    worst = nc.synthesis.robust(system, at, "psi", widths, samples=64, statistic="worst")(system)
    assert abs(float(worst) - np.pi) < 0.02


def geared_wheels(constant=None):
    """Two wheels that mesh, or are tied by a relation; the mark of the first is drawn at half a turn."""
    m = nc.Mechanism("wheels")
    m.ground("A", (0, 0))
    m.ground("B", (3, 0))
    m.point("P", (-1, 0))
    m.point("Q", (3, 2))
    m.body("one", ["A", "P"])
    m.body("other", ["B", "Q"])
    m.angle("phi", at="A", to="P")
    m.angle("psi", at="B", to="Q")
    if constant is None:
        m.gear("mesh", "phi", "psi", radii=(1.0, 2.0))
    else:
        m.relation("tie", {"phi": 0.5, "psi": 1.0}, constant=constant)
    return m.compile()


def mark(p, q, phi):
    """Where the mark Q goes, drawn at (3, 2) + q, with the mark P drawn at (-1, 0) + p."""
    drawn = np.pi - np.arctan2(p[1], 1.0 - p[0])
    psi = np.arctan2(2.0 + q[1], q[0]) - (phi - drawn) / 2.0
    return np.array([3.0, 0.0]) + np.hypot(q[0], 2.0 + q[1]) * np.stack([np.cos(psi), np.sin(psi)], axis=-1)


def test_samples_count_turns_as_the_design_does_where_an_angle_is_drawn_at_half_a_turn():
    system, phi = geared_wheels(), np.pi + np.linspace(0.0, 2.0, 5)
    found = nc.tolerance(system, {"phi": phi}, "Q", {"P": 1e-3, "Q": 1e-3}, samples=400)
    slopes = [
        (mark(*(e * k), phi) - mark(*(-e * k), phi))[:, 1] / 2e-6 for k in np.eye(4).reshape(4, 2, 2) for e in [1e-6]
    ]
    sigma = 1e-3 / 3.0 * np.sqrt(np.square(slopes).sum(axis=0))
    np.testing.assert_allclose(found["Q.y"].first_order, sigma, rtol=1e-6)
    np.testing.assert_allclose(found["Q.y"].std, sigma, rtol=0.15)
    last = syn.robust(system, {"phi": phi}, lambda m: m["psi"][-1], {"P": 1e-3}, samples=64, statistic="std")
    assert last(system) == pytest.approx(1e-3 / 6.0, rel=0.3)
    # The relation says that psi does not depend on where P is drawn, on either side of half a turn.
    tied = nc.tolerance(geared_wheels(np.pi), {"phi": phi}, "psi", {"P": 1e-3}, samples=100)
    assert tied["psi"].std == pytest.approx(np.zeros(5), abs=1e-12)


@pytest.mark.parametrize("up", [1e-3, -1e-3])
def test_a_calibration_goes_on_past_half_a_turn(up):
    system, phi = geared_wheels(), np.pi + np.linspace(0.0, 2.0, 9)
    seen = mark(np.array([0.0, up]), np.array([0.01, 0.0]), phi)
    fit = syn.calibrate(system, {"phi": phi}, {"Q": seen}, ["P.y", "Q.x"])
    np.testing.assert_allclose(fit.values, [up, 3.01], atol=1e-9)
    np.testing.assert_allclose(nc.sweep(fit.system, {"phi": phi})["Q"], seen, atol=1e-9)
