"""Ready planar mechanisms: counts, default drives, and closed forms that know nothing of natural coordinates.

Plane points are complex numbers in the closed forms, so that nothing is shared with the drawing code of the library.
"""

import functools
import inspect
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import jaxnc as nc
from jaxnc import library
from jaxnc.solvers.assembly import derive, sample_poses

POSES = 73
EXACT = 1e-12  # of the mechanism's size: agreement with a closed form
RESIDUAL = 1e-13  # of the size: what a solved pose may leave

# name: (what makes it, n, rows, rank, g)
CASES = {
    "four-bar": (library.four_bar, 5, 4, 4, 1),
    "four-bar, crossed": (lambda: library.four_bar(branch="crossed", angle=-0.7, explicit=False), 5, 4, 4, 1),
    "four-bar, coupler point": (lambda: library.four_bar(coupler_point=(0.07, 0.05)), 7, 6, 6, 1),
    "parallelogram": (library.parallelogram, 7, 7, 6, 1),
    "parallelogram, two cranks": (lambda: library.parallelogram(third=None), 5, 4, 4, 1),
    "four-bar-chain": (library.four_bar_chain, 9, 8, 8, 1),
    "four-bar-chain, uneven": (lambda: library.four_bar_chain(5, last=1.2), 13, 12, 12, 1),
    "slider-crank": (library.slider_crank, 5, 4, 4, 1),
    "slider-crank, fixed guide": (lambda: library.slider_crank(fixed_guide=True), 4, 3, 3, 1),
    "crank-slider-on-bar": (library.crank_slider_on_bar, 6, 5, 5, 1),
    "crank-slider-on-bar, angle": (lambda: library.crank_slider_on_bar(crank_angle=True), 7, 6, 6, 1),
    "scotch-yoke": (library.scotch_yoke, 7, 6, 6, 1),
    "quick-return": (library.quick_return, 7, 6, 6, 1),
    "shaper": (library.shaper, 6, 5, 5, 1),
    "whitworth": (library.whitworth, 6, 5, 5, 1),
    "gear-pair": (library.gear_pair, 6, 5, 5, 1),
    "gear-pair, internal": (lambda: library.gear_pair(internal=True), 6, 5, 5, 1),
    "rolling-disc": (library.rolling_disc, 8, 7, 7, 1),
    "generic-mechanism": (library.generic_mechanism, 16, 15, 15, 1),
    "generic-mechanism, angle": (lambda: library.generic_mechanism(crank_angle=True), 17, 16, 16, 1),
    "five-bar": (library.five_bar, 8, 6, 6, 2),
    "geared-five-bar": (library.geared_five_bar, 8, 7, 7, 1),
    "watt-six-bar, I": (lambda: library.watt_six_bar("I"), 11, 10, 10, 1),
    "watt-six-bar": (library.watt_six_bar, 9, 8, 8, 1),
    "stephenson-six-bar, I": (lambda: library.stephenson_six_bar("I"), 11, 10, 10, 1),
    "stephenson-six-bar, II": (lambda: library.stephenson_six_bar("II"), 11, 10, 10, 1),
    "stephenson-six-bar": (library.stephenson_six_bar, 9, 8, 8, 1),
    "chebyshev": (library.chebyshev, 5, 4, 4, 1),
    "hoeken": (library.hoeken, 5, 4, 4, 1),
    "roberts": (library.roberts, 5, 4, 4, 1),
    "watt-straight-line": (library.watt_straight_line, 5, 4, 4, 1),
    "peaucellier-lipkin": (library.peaucellier_lipkin, 9, 8, 8, 1),
    "hart": (library.hart, 13, 12, 12, 1),
    "pantograph": (library.pantograph, 10, 8, 8, 2),
    "planar-3r": (library.planar_3r, 9, 6, 6, 3),
    "planar-3r, absolute": (lambda: library.planar_3r(relative=False), 9, 6, 6, 3),
    "jansen-leg": (library.jansen_leg, 13, 12, 12, 1),
    "klann-leg": (library.klann_leg, 11, 10, 10, 1),
}
RATED = {"slider-crank", "scotch-yoke", "gear-pair", "generic-mechanism, angle"}


@functools.cache
def built(name):
    mechanism = CASES[name][0]()
    return mechanism, mechanism.compile()


def swept(mechanism, system, rated=False):
    """The default drive of a mechanism, in fewer poses; rates only where they are looked at (they compile longer)."""
    drives = mechanism.model.run.inputs
    inputs = {k: np.linspace(d.start, d.end, POSES) for k, d in drives.items()}
    return nc.sweep(system, inputs, rates={k: d.rate for k, d in drives.items()} if rated else None)


@functools.cache
def moved(name):
    return swept(*built(name), rated=name in RATED)


def at(motion, name):
    """Places of a point as complex numbers, values of a coordinate as they are."""
    value = np.asarray(motion[name])
    return value[..., 0] + 1j * value[..., 1] if value.ndim == 2 else value


def drawn(mechanism):
    """Every point as drawn, as a complex number."""
    model = mechanism.model
    places = {**model.ground, **{k: getattr(p, "at", p) for k, p in model.points.items()}}
    return {k: complex(*p) for k, p in places.items()}


def polar(length, angle):
    return length * np.exp(1j * np.asarray(angle))


def dyad(p, rp, q, rq, side):
    """The joint of two bars by the law of cosines; side = 1 to the left of the way from p to q."""
    d = q - p
    opening = np.arccos((rp**2 + abs(d) ** 2 - rq**2) / (2 * rp * abs(d)))
    return p + polar(rp, np.angle(d) + side * opening)


def assert_same(got, want, size):
    assert np.max(np.abs(np.asarray(got) - np.asarray(want))) <= EXACT * size


# ---------------------------------------------------------------------------------------------------------------
# every mechanism


@pytest.mark.parametrize("name", CASES)
def test_counts(name):
    mechanism, system = built(name)
    _, n, rows, rank, g = CASES[name]
    eq, sample = derive(system), sample_poses(system)[0]
    values = np.linalg.svd(sample.jacobian, compute_uv=False)
    assert (len(system.topology.unknown), len(system.topology.rows)) == (n, rows)
    assert np.sum(values > 1e-9 * values[0]) == rank == n - g
    assert system.degrees_of_freedom == g
    assert sample.gap <= RESIDUAL * eq.length
    assert np.max(np.abs(sample.q - eq.home)) <= EXACT * eq.length, "it does not assemble as drawn"
    assert mechanism.model.description


@pytest.mark.parametrize("name", CASES)
def test_default_drive_runs(name):
    mechanism, system = built(name)
    motion = moved(name).check()
    assert len(mechanism.model.run.inputs) == system.degrees_of_freedom
    assert np.max(motion.residual) <= RESIDUAL * derive(system).length
    assert np.min(motion.conditioning) > 1e-4
    for output in mechanism.model.run.outputs:
        assert np.all(np.isfinite(motion[output])) and np.ptp(motion[output]) > 0.1 * derive(system).length


def test_overconstrained_parallelogram_names_its_redundant_row():
    assert len(nc.mobility(built("parallelogram")[1]).redundant) == 1
    assert not nc.mobility(built("parallelogram, two cranks")[1]).redundant


def test_catalogue_has_every_function():
    functions = set(library.__all__) - {"CATALOGUE", "benchmarks"}  # benchmarks are problems to simulate
    assert {f.__name__ for f in library.CATALOGUE.values()} == functions
    assert set(library.CATALOGUE) == {name.replace("_", "-") for name in functions}
    planar = {name for name, make in library.CATALOGUE.items() if make().model.dim == 2}
    assert planar <= set(CASES) and all(library.CATALOGUE[name] is CASES[name][0] for name in planar)


# ---------------------------------------------------------------------------------------------------------------
# four-bars


def freudenstein(a, b, c, d, phi, crossed):
    """Rocker angle of a four-bar from the half-angle form of Freudenstein's equation."""
    k1, k2, k3 = d / a, d / c, (a**2 - b**2 + c**2 + d**2) / (2 * a * c)
    p, q, r = np.cos(phi) * (1 - k2) - k1 + k3, -2 * np.sin(phi), k1 - (k2 + 1) * np.cos(phi) + k3
    root = np.sqrt(q**2 - 4 * p * r)
    return 2 * np.arctan2(-q + (root if crossed else -root), 2 * p)


@pytest.mark.parametrize("name", ["four-bar", "four-bar, crossed", "four-bar, coupler point"])
def test_four_bar(name):
    motion = moved(name)
    a, b, c, d = 0.04, 0.12, 0.08, 0.10
    phi, crossed = at(motion, "phi"), "crossed" in name
    pin, joint = polar(a, phi), d + polar(c, freudenstein(a, b, c, d, phi, crossed))
    assert_same(at(motion, "B"), pin, d)
    assert_same(at(motion, "C"), joint, d)
    assert_same(at(motion, "C"), dyad(pin, b, d, c, -1 if crossed else 1), d)
    if "point" in name:
        assert_same(at(motion, "P"), pin + (joint - pin) / b * (0.07 + 0.05j), d)


@pytest.mark.parametrize(("branch", "coupler", "rocker"), [("open", 20.298, 57.325), ("crossed", -60.98, -98.01)])
def test_four_bar_is_nortons_example(branch, coupler, rocker):
    p = drawn(library.four_bar(angle=np.deg2rad(40.0), branch=branch))
    assert np.rad2deg(np.angle(p["C"] - p["B"])) == pytest.approx(coupler, abs=0.01)
    assert np.rad2deg(np.angle(p["C"] - p["D"])) == pytest.approx(rocker, abs=0.01)


def test_explicit_lengths_are_design_variables():
    assert {"crank.A-B", "coupler.B-C", "rocker.C-D"} <= set(built("four-bar")[1].design_variables)
    assert {"coupler.P.along", "coupler.P.across"} <= set(built("four-bar, coupler point")[1].design_variables)
    assert {"crank.A-B", "conrod.B-C"} <= set(built("slider-crank")[1].design_variables)
    assert not any("." in v for v in built("four-bar, crossed")[1].design_variables)


@pytest.mark.parametrize(
    ("lengths", "angle", "folds"),
    [
        ((0.1, 0.08, 0.07, 0.12), 0.5, False),
        ((0.1, 0.16, 0.05, 0.12), 1.5, True),
        ((0.1, 0.2, 0.1, 0.2), 1.0, True),  # change points at 0 and π
    ],
)
def test_a_crank_that_does_not_turn_is_driven_within_its_range(lengths, angle, folds):
    a, b, c, d = lengths

    def limit(reach):
        return math.acos(max(-1.0, (a**2 + d**2 - reach**2) / (2 * a * d)))

    mechanism = library.four_bar(*lengths, angle=angle)
    drive = mechanism.model.run.inputs["phi"]
    end = limit(b + c)
    start = limit(abs(b - c)) if folds else -end
    cut = 0.02 * (end - start)
    assert (drive.start, drive.end) == pytest.approx((start + cut, end - cut), abs=0.01)
    swept(mechanism, mechanism.compile()).check()


@pytest.mark.parametrize("name", ["parallelogram", "parallelogram, two cranks"])
def test_parallelogram_carries_its_coupler_without_turning_it(name):
    motion, places = moved(name), drawn(built(name)[0])
    shift = polar(0.1, at(motion, "phi"))
    for tip, pivot in zip("BCE", "ADF", strict=True):
        if tip in places:
            assert_same(at(motion, tip), places[pivot] + shift, 0.3)


# ---------------------------------------------------------------------------------------------------------------
# sliders and quick returns


@pytest.mark.parametrize("name", ["slider-crank", "slider-crank, fixed guide"])
def test_slider_crank(name):
    motion = moved(name)
    phi, w = at(motion, "phi"), 2 * np.pi
    rise = 0.02 - 0.1 * np.sin(phi)
    along = np.sqrt(0.3**2 - rise**2)
    assert_same(at(motion, "C"), 0.1 * np.cos(phi) + along + 0.02j, 0.4)
    if name in RATED:
        speed = w * (-0.1 * np.sin(phi) + rise * 0.1 * np.cos(phi) / along)
        assert_same(motion.velocity("C.x"), speed, 0.4 * w)


def test_slider_crank_whose_crank_does_not_turn_stays_in_reach():
    mechanism = library.slider_crank(crank=0.3, conrod=0.2, offset=0.0, angle=0.2)
    drive = mechanism.model.run.inputs["phi"]
    end = math.asin(0.2 / 0.3)
    assert (drive.start, drive.end) == pytest.approx((-0.96 * end, 0.96 * end), abs=1e-4)
    left = drawn(library.slider_crank(branch="left"))
    assert left["C"].real < left["B"].real < 0.1


@pytest.mark.parametrize("name", ["crank-slider-on-bar", "crank-slider-on-bar, angle"])
def test_crank_slider_on_bar(name):
    motion = moved(name)
    pin = at(motion, "P1")
    if "angle" in name:
        assert_same(pin, polar(0.1, at(motion, "phi")), 0.4)
    to_pivot = 0.25 - pin
    s = np.sqrt(abs(to_pivot) ** 2 - 0.08**2)
    direction = to_pivot / (s - 0.08j)  # the pivot is s along the bar and L3 to its right
    assert_same(at(motion, "P3"), pin + s * direction, 0.4)
    assert_same(at(motion, "P2"), pin + 0.4 * direction, 0.4)
    # (3) and (4), the loop in relative coordinates
    beta = np.angle(direction)
    assert_same(pin.real + s * np.cos(beta) + 0.08 * np.sin(beta), 0.25, 0.4)
    assert_same(pin.imag + s * np.sin(beta) - 0.08 * np.cos(beta), 0.0, 0.4)


def test_scotch_yoke_is_exactly_harmonic():
    motion = moved("scotch-yoke")
    phi, w = at(motion, "phi"), 2 * np.pi
    assert_same(at(motion, "Y"), 0.1 * np.cos(phi), 0.25)
    assert_same(at(motion, "T"), 0.1 * np.cos(phi) + 0.15j, 0.25)
    assert_same(motion.velocity("Y.x"), -0.1 * w * np.sin(phi), 0.25 * w)
    assert_same(motion.acceleration("Y.x"), -0.1 * w**2 * np.cos(phi), 0.25 * w**2)


def test_quick_return():
    motion = moved("quick-return")
    phi = at(motion, "phi")
    pin = 0.25j + polar(0.1, phi - np.pi / 2)
    assert_same(at(motion, "P1"), pin, 0.5)
    assert_same(at(motion, "P2"), 0.5 * pin / abs(pin), 0.5)
    assert_same(at(motion, "P3"), 0.42 * pin / pin.imag, 0.5)


@pytest.mark.parametrize(
    ("name", "crank", "pivot", "lever", "link", "height", "side"),
    [("shaper", 0.1, -0.25j, 0.5, 0.2, 0.22, -1), ("whitworth", 0.25, -0.1j, 0.12, 0.5, -0.1, 1)],
)
def test_quick_returns_with_a_link(name, crank, pivot, lever, link, height, side):
    motion = moved(name)
    pin = polar(crank, at(motion, "phi"))
    tip = pivot + lever * (pin - pivot) / abs(pin - pivot)
    ram = tip.real + side * np.sqrt(link**2 - (height - tip.imag) ** 2) + 1j * height
    assert_same(at(motion, "A"), pin, 0.5)
    assert_same(at(motion, "C"), tip, 0.5)
    assert_same(at(motion, "R"), ram, 0.5)
    turned = np.unwrap(np.angle(at(motion, "C") - pivot))
    if name == "whitworth":
        assert turned[-1] - turned[0] == pytest.approx(2 * np.pi)
    else:
        assert np.ptp(turned) < 2 * math.asin(crank / abs(pivot)) + 1e-12


# ---------------------------------------------------------------------------------------------------------------
# gears and rolling


@pytest.mark.parametrize(("name", "ratio"), [("gear-pair", -0.5), ("gear-pair, internal", 0.5)])
def test_gear_ratio_over_several_turns(name, ratio):
    motion = moved(name)
    phi, psi = at(motion, "phi"), at(motion, "psi")
    centre = 0.1 if "internal" in name else 0.3
    assert np.ptp(phi) == pytest.approx(4 * np.pi)
    assert_same(psi, ratio * phi, 1.0)
    if name in RATED:
        assert_same(motion.velocity("psi"), ratio * 4 * np.pi, 4 * np.pi)
    assert_same(at(motion, "P1"), polar(0.1, phi), 0.4)
    assert_same(at(motion, "P2"), centre - polar(0.2, psi), 0.4)


def test_rolling_disc_follows_the_cycloid():
    motion = moved("rolling-disc")
    phi, s = at(motion, "phi"), at(motion, "s")
    assert_same(s, 0.2 + 0.1 * (0.5 - phi), 2.0)
    assert s[-1] == pytest.approx(1.8) and np.ptp(phi) > 4 * np.pi
    assert_same(at(motion, "P1"), s + 0.1j, 2.0)
    assert_same(at(motion, "P2"), s + 0.1j + polar(0.1, phi - np.pi / 2), 2.0)
    assert_same(at(motion, "P3"), s, 2.0)


def generic_contact(y1, link, near):
    """Distance s and slope of the bar for a height of the crank pin, by one scalar equation in the slider's frame."""
    bar, radius, height, pivot = 0.6, 0.05, 0.05, 0.10 + 0.10j

    def slope(s):
        return math.asin((height - y1) / math.hypot(s, radius)) - math.atan2(radius, s)

    def gap(s):
        e = complex(polar(1.0, slope(s)))
        return abs((bar - s) * e - radius * 1j * e - pivot) - link  # P2 and P3 as seen from the disc's centre

    s = brentq(gap, near - 0.02, near + 0.02, xtol=1e-15, rtol=1e-14)
    return s, slope(s)


@pytest.mark.parametrize("name", ["generic-mechanism", "generic-mechanism, angle"])
def test_generic_mechanism(name):
    motion, places = moved(name), drawn(built(name)[0])
    s, phi, p = at(motion, "s"), at(motion, "phi"), {f"P{k}": at(motion, f"P{k}") for k in range(1, 8)}
    link = abs(places["P3"] - places["P2"])
    order = np.argsort(abs(p["P1"].imag), kind="stable")
    for side in (1, -1):  # away from the drawn height both ways, so that a bracket around the last root holds the next
        near = 0.4
        for k in order[side * p["P1"].imag[order] >= 0]:
            near, slope = generic_contact(p["P1"].imag[k], link, near)
            e = complex(polar(1.0, slope))
            centre = p["P1"][k] + near * e + 0.05j * e
            assert_same(s[k], near, 0.8)
            assert_same([p["P6"][k], p["P2"][k]], p["P1"][k] + np.array([near, 0.6]) * e, 0.8)
            assert_same([p["P5"][k], p["P3"][k], p["P4"][k]], centre + np.array([0, 0.1 + 0.1j, 0.05 + 0.2j]), 0.8)
            assert_same(p["P7"][k], centre + polar(0.05, slope - np.pi / 2 + phi[k]), 0.8)
    assert_same(s + 0.05 * phi, 0.4 + 0.05 * 0.5, 0.8)  # no slip on the upper side
    if "angle" in name:
        assert_same(p["P1"], polar(0.1, at(motion, "theta")), 0.8)
        assert 0 < np.argmax(s) < POSES - 1 and 0 < np.argmin(s) < POSES - 1
        reversals = np.flatnonzero(np.diff(np.sign(motion.velocity("s"))))
        assert len(reversals) == 2, "the contact point goes out and back once in a turn"


# ---------------------------------------------------------------------------------------------------------------
# six-bars, five-bars and legs: circle by circle

DYADS = {
    "watt-six-bar, I": ["C B D", "E on B C", "F on D C", "G E F"],
    "watt-six-bar": ["C B D", "E on D C", "F E G"],
    "stephenson-six-bar, I": ["E on A B", "C B D", "F on D C", "G E F"],
    "stephenson-six-bar": ["C B D", "E on B C", "F E G"],
    "klann-leg": ["C B D", "E on B C", "F E G", "P on E F"],
}


@pytest.mark.parametrize("name", DYADS)
def test_six_bars_circle_by_circle(name):
    motion, home = moved(name), drawn(built(name)[0])
    size = max(abs(p - q) for p in home.values() for q in home.values())
    places = {k: v for k, v in home.items() if k in built(name)[0].model.ground}
    turn = at(motion, "phi") - np.angle(home["B"] - home["A"])
    places["B"] = home["A"] + (home["B"] - home["A"]) * polar(1.0, turn)
    for step in DYADS[name]:
        if " on " in step:
            point, _, p, q = step.split()
            places[point] = places[p] + (places[q] - places[p]) * (home[point] - home[p]) / (home[q] - home[p])
        else:
            point, p, q = step.split()
            rp, rq = abs(home[point] - home[p]), abs(home[point] - home[q])
            side = np.sign(((home[q] - home[p]).conjugate() * (home[point] - home[p])).imag)
            places[point] = dyad(places[p], rp, places[q], rq, side)
        assert_same(at(motion, point), places[point], size)


def test_klann_leg_is_the_patents():
    """Lengths between the points of the patent's table, computed by hand from it to four digits."""
    home = drawn(library.klann_leg(scale=2.0))
    for pair, length in {"AB": 0.268, "BC": 0.590, "CD": 0.3206, "EF": 0.8966, "EP": 0.8966, "FG": 0.5176}.items():
        assert abs(home[pair[0]] - home[pair[1]]) == pytest.approx(2.0 * length, abs=2e-4)
    motion = moved("klann-leg")
    foot, phi = at(motion, "P"), at(motion, "phi")
    stance = foot[phi >= 2 * np.pi]
    # What the inventor publishes of these dimensions: step height 52.3 % and deviation 5.5 % of the stride.
    stride = np.ptp(foot.real)
    assert np.ptp(foot.imag) / stride == pytest.approx(0.523, abs=2e-3)
    assert np.ptp(stance.imag) / stride == pytest.approx(0.055, abs=2e-3)


@pytest.mark.parametrize("name", ["five-bar", "geared-five-bar"])
def test_five_bars(name):
    motion = moved(name)
    phi, psi = at(motion, "phi"), at(motion, "psi")
    ground, crank2 = (0.25, 0.1) if name == "five-bar" else (0.24, 0.06)
    if name == "geared-five-bar":
        assert_same(psi, 2.0 - 2.0 * (phi - 1.0), 10.0)
    else:
        assert np.ptp(psi) == pytest.approx(4 * np.pi)
    b, d = polar(0.1, phi), ground + polar(crank2, psi)
    assert_same(at(motion, "D"), d, 0.5)
    assert_same(at(motion, "C"), dyad(b, 0.3, d, 0.3, 1), 0.5)


def test_jansen_leg_from_the_holy_numbers():
    motion = moved("jansen-leg")
    a, b, c, d, e, f, g, h, i, j, k, low, m = (
        0.01 * x for x in (38.0, 41.5, 39.3, 40.1, 55.8, 39.4, 36.7, 65.7, 49.0, 50.0, 61.9, 7.8, 15.0)
    )
    z, x = complex(-a, -low), polar(m, at(motion, "phi"))
    upper, lower = dyad(z, b, x, j, 1), dyad(z, c, x, k, -1)
    v = dyad(z, d, upper, e, 1)
    knee = dyad(lower, g, v, f, 1)
    foot = dyad(lower, i, knee, h, 1)
    for name, want in {"U": upper, "L": lower, "V": v, "K": knee, "F": foot}.items():
        assert_same(at(motion, name), want, 1.2)
    assert np.min(foot.imag) < -0.8 and np.ptp(foot.real) > 0.4, "it steps"


def test_a_leg_that_cannot_turn_is_driven_within_its_range():
    mechanism = library.jansen_leg(m=18.0)
    drive = mechanism.model.run.inputs["phi"]
    assert 0.5 < drive.end - drive.start < 2 * np.pi
    swept(mechanism, mechanism.compile()).check()


# ---------------------------------------------------------------------------------------------------------------
# straight lines


def test_peaucellier_lipkin_is_straight():
    p = at(moved("peaucellier-lipkin"), "P")
    assert_same(p.real, (0.5**2 - 0.2**2) / (2 * 0.2), 0.7)
    assert np.ptp(p.imag) > 0.8
    phi = at(moved("peaucellier-lipkin"), "phi")
    assert_same(p.imag, p.real * np.tan(phi / 2), 0.7)  # on the line O-B


def test_hart_is_straight():
    motion = moved("hart")
    q, p = at(motion, "Q"), at(motion, "P")
    power = 0.25 * (0.6**2 - 0.25**2)
    assert_same(q.real, -power / (2 * 0.2), 0.9)
    assert np.ptp(q.imag) > 0.65
    assert_same(abs(p) * abs(q), power, 0.9)
    assert_same((p * q.conjugate()).imag, 0.0, 0.9**2)


def test_chebyshev_is_nearly_straight():
    motion = moved("chebyshev")
    p, phi = at(motion, "P"), at(motion, "phi")
    bar = polar(0.2, phi)
    assert_same(p, dyad(0.0, 0.5, 0.4 + bar, 0.5, 1) - bar / 2, 0.6)
    on = p[np.cos(phi) >= -1e-9]
    assert 0 < np.max(abs(on.imag - 0.4)) < 0.0025 * 0.4 and np.ptp(on.real) == pytest.approx(0.4)
    for exact in (0.0, np.pi / 2, 3 * np.pi / 2):  # on the line in the middle and at both ends
        k = np.argmin(abs(phi - exact))
        assert phi[k] == pytest.approx(exact) and abs(p[k].imag - 0.4) < EXACT


def test_hoeken_is_nearly_straight():
    motion = moved("hoeken")
    p, phi = at(motion, "P"), at(motion, "phi")
    pin = polar(0.1, phi)
    assert_same(p, 2 * dyad(pin, 0.25, 0.2, 0.25, 1) - pin, 0.6)
    on = p[(phi >= np.pi / 2 - 1e-9) & (phi <= 3 * np.pi / 2 + 1e-9)]
    assert 0 < np.max(abs(on.imag - 0.4)) < 0.0025 * 0.4 and np.ptp(on.real) == pytest.approx(0.4)


def test_roberts_is_nearly_straight():
    motion = moved("roberts")
    p, phi = at(motion, "P"), at(motion, "phi")
    bar = polar(0.2, phi)
    b = dyad(0.0, 0.3, 0.4 - bar, 0.3, 1)
    assert_same(p, b + bar / 2 - 1j * bar / 0.2 * math.sqrt(0.3**2 - 0.1**2), 0.6)
    assert_same(p[[0, POSES // 2, -1]], [0.0, 0.2, 0.4], 0.6)
    assert 0 < np.max(abs(p.imag)) < 0.003 * 0.4


def test_watt_is_nearly_straight():
    motion = moved("watt-straight-line")
    p, phi = at(motion, "P"), at(motion, "phi")
    b = -0.5 + 0.2j + polar(0.5, phi)
    c = dyad(b, 0.4, 0.5 - 0.2j, 0.5, -1)
    assert_same(p, (b + c) / 2, 1.1)
    on = p[abs(phi) <= 0.3]
    assert 0 < np.max(abs(on.real)) < 0.0014 * np.ptp(on.imag) and np.ptp(on.imag) > 0.25


# ---------------------------------------------------------------------------------------------------------------
# several inputs


def test_pantograph_enlarges():
    motion = moved("pantograph")
    p = at(motion, "P")
    assert_same(at(motion, "Q"), 2.0 * p, 0.7)
    assert_same(at(motion, "A"), dyad(0.0, 0.3, p, 0.25, 1), 0.7)
    assert np.ptp(p.real) > 0.1 and np.ptp(p.imag) > 0.1


@pytest.mark.parametrize("name", ["planar-3r", "planar-3r, absolute"])
def test_planar_3r(name):
    motion = moved(name)
    angles = np.stack([at(motion, f"phi{k}") for k in (1, 2, 3)])
    if "absolute" not in name:
        angles = np.cumsum(angles, axis=0)
    tips = np.cumsum([polar(r, a) for r, a in zip((0.5, 0.4, 0.2), angles, strict=True)], axis=0)
    for point, want in zip("BCP", tips, strict=True):
        assert_same(at(motion, point), want, 1.1)


# ---------------------------------------------------------------------------------------------------------------
# mistakes

MISTAKES = [
    (library.four_bar, {"crank": -1.0}, ["four_bar", "crank", "positive"]),
    (library.four_bar, {"ground": 1.0}, ["coupler = 0.12", "rocker = 0.08", "change one"]),
    (library.four_bar, {"branch": "upper"}, ["branch='upper'", "'open', 'crossed'"]),
    (library.four_bar, {"coupler_point": (0.1,)}, ["coupler_point", "two numbers"]),
    (library.parallelogram, {"third": (0.3, 0.0)}, ["third", "move it"]),
    (library.parallelogram, {"third": None, "angle": 0.0}, ["angle = 0", "change point"]),
    (library.four_bar_chain, {"loops": 0}, ["loops", "positive integer"]),
    (library.four_bar_chain, {"coupler": 0.2}, ["coupler = 0.2", "crank = 1", "change one"]),
    (library.four_bar_chain, {"angle": 0.0}, ["angle = 0", "change point"]),
    (library.slider_crank, {"conrod": 0.05}, ["conrod = 0.05", "longer conrod"]),
    (library.slider_crank, {"branch": "up"}, ["branch='up'", "'right', 'left'"]),
    (library.crank_slider_on_bar, {"arm": 0.2}, ["arm = 0.2", "shorter than"]),
    (library.crank_slider_on_bar, {"bar": 0.2}, ["bar = 0.2", "longer than"]),
    (library.scotch_yoke, {"slot": 0.05}, ["slot = 0.05", "crank = 0.1"]),
    (library.quick_return, {"crank": 0.3}, ["crank = 0.3", "use whitworth"]),
    (library.quick_return, {"rocker": 0.3}, ["rocker = 0.3", "at least"]),
    (library.quick_return, {"guide": 0.49}, ["guide = 0.49", "lower it"]),
    (library.shaper, {"ram_height": 0.5}, ["link = 0.2", "ram_height = 0.5", "longer link"]),
    (library.whitworth, {"offset": 0.3}, ["offset = 0.3", "use quick_return or shaper"]),
    (library.gear_pair, {"radius2": 0.1, "internal": True}, ["radius1 and radius2", "different"]),
    (library.rolling_disc, {"distance": 1.5}, ["distance = 1.5", "below half"]),
    (library.generic_mechanism, {"contact": 0.7}, ["contact = 0.7", "bar = 0.6"]),
    (library.generic_mechanism, {"disc_height": 0.6}, ["disc_height = 0.6", "reach"]),
    (library.generic_mechanism, {"pivot": (0.05, 0.20)}, ["pivot", "shoe", "three points"]),
    (library.five_bar, {"coupler1": 0.01}, ["coupler1 = 0.01", "coupler2 = 0.3"]),
    (library.watt_six_bar, {"inversion": "III"}, ["inversion='III'", "'I', 'II'"]),
    (library.stephenson_six_bar, {"places": {"Z": (0.0, 0.0)}}, ["no 'Z' to move", "known names: A"]),
    (library.stephenson_six_bar, {"places": {"E": (0.36, 0.30)}}, ["'C' and 'E' of the coupler", "move one"]),
    (library.klann_leg, {"places": {"P": "foot"}}, ["places['P']", "two numbers"]),
    (library.roberts, {"rocker": 0.1}, ["rocker = 0.1", "half of ground"]),
    (library.chebyshev, {"rocker": 0.1}, ["rocker A-B = 0.1", "rocker D-C = 0.1"]),
    (library.peaucellier_lipkin, {"side": 0.6}, ["side = 0.6", "shorter than arm"]),
    (library.peaucellier_lipkin, {"crank": 0.1}, ["arm = 0.5", "side = 0.2"]),
    (library.hart, {"short": 0.7}, ["short = 0.7", "shorter than long"]),
    (library.hart, {"fraction": 1.5}, ["fraction = 1.5", "between 0 and 1"]),
    (library.hart, {"crank": 0.5}, ["crank = 0.5", "between 0.175 and 0.425"]),
    (library.pantograph, {"ratio": 0.5}, ["ratio = 0.5", "greater than 1"]),
    (library.pantograph, {"tracer": (1.0, 0.0)}, ["arm1 = 0.3", "arm2 = 0.25"]),
    (library.planar_3r, {"lengths": (1.0, 1.0)}, ["lengths", "three numbers"]),
    (library.planar_3r, {"lengths": (1.0, 0.0, 1.0)}, ["lengths[1]", "positive"]),
    (library.jansen_leg, {"k": 5.0}, ["k = 5", "c = 39.3"]),
]


@pytest.mark.parametrize(("make", "dimensions", "says"), MISTAKES)
def test_impossible_dimensions_are_named(make, dimensions, says):
    with pytest.raises(nc.MechanismError) as caught:
        make(**dimensions)
    for text in (make.__name__, *says):
        assert text in str(caught.value), str(caught.value)


@pytest.mark.parametrize("make", library.CATALOGUE.values(), ids=library.CATALOGUE)
def test_every_number_is_checked_by_name(make):
    numbers = [p.name for p in inspect.signature(make).parameters.values() if isinstance(p.default, float)]
    for name in numbers:
        for value in (math.nan, "long", None):
            with pytest.raises(nc.MechanismError, match=rf"{make.__name__}: {name} must be"):
                make(**{name: value})


def test_traced_lengths_are_refused_with_the_way_that_takes_them():
    """Everywhere; and that way's derivatives are those of mechanisms drawn anew."""
    said = r"{}.* is traced .*system\.replace\({{'crank\.A-B'"
    asked = {}
    for name, build in library.catalogue.CATALOGUE.items():
        for p in inspect.signature(build).parameters.values():
            if isinstance(p.default, float):
                asked[name] = build, p.name, p.default
    assert len(asked) > 20
    for build, name, value in asked.values():
        with pytest.raises(nc.MechanismError, match=said.format(name)):
            jax.eval_shape(lambda x, build=build, name=name: build(**{name: x}) and x, value)

    def placed(x):
        m = nc.Mechanism("m")
        m.point("B", (x, 1.0))
        return x

    with pytest.raises(nc.MechanismError, match=r"'B'.*2 numbers.*traced"):
        jax.jit(placed)(1.0)

    lengths = {"crank.A-B": 0.04, "coupler.B-C": 0.12, "rocker.C-D": 0.08}
    system = nc.library.four_bar(coupler_point=(0.06, 0.05)).compile()

    def height(lengths, ground):
        other = system.replace({**lengths, "D": jnp.stack([ground, 0.0])})
        return nc.solve_position(other, {"phi": 2.0})["P"][1]

    slopes = jax.jit(jax.grad(height, argnums=(0, 1)))(lengths, 0.1)
    own = {"crank.A-B": "crank", "coupler.B-C": "coupler", "rocker.C-D": "rocker"}
    for name, slope in (*((own[n], s) for n, s in slopes[0].items()), ("ground", slopes[1])):
        step, drawn = 1e-6, {**dict(zip(own.values(), lengths.values(), strict=True)), "ground": 0.1}
        ends = []
        for sign in (1, -1):
            anew = nc.library.four_bar(**{**drawn, name: drawn[name] + sign * step}, coupler_point=(0.06, 0.05))
            ends.append(float(nc.solve_position(anew.compile(), {"phi": 2.0})["P"][1]))
        assert float(slope) == pytest.approx((ends[0] - ends[1]) / (2 * step), abs=1e-7), name
