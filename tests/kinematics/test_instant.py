"""Instant centres, centrodes, inflection circles, curvature and screws, against closed forms and published numbers."""

import itertools
import math

import jax
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.kinematics import axodes, centrodes, instant_centres, instant_motion, path_curvature
from jaxnc.kinematics.instant import curvature_of, instant_of, seen_from, state_of

RATES = ("velocity", "spin", "acceleration", "turning", "speed", "pull")
EXACT = 1e-9  # of the size, times how far away a centre lies: rates are exact to about 1e-13


def moved(mechanism, name, values, rate=1.0, **options):
    system = mechanism.compile() if isinstance(mechanism, nc.Mechanism) else mechanism
    return nc.sweep(system, {name: values}, rates={name: rate}, accelerations={name: 0.0}, **options).check()


def cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def turned(x):
    return np.stack([-x[..., 1], x[..., 0]], axis=-1)


@pytest.fixture(scope="module")
def four_bar():
    m = nc.Mechanism("four-bar")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    m.point("B", (0, 1))
    m.point("C", (3.3, 2.9))
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C"])
    m.body("rocker", ["C", "D"])
    m.marker("P", on="coupler", at=(1.8, 3.6))
    m.angle("phi", at="A", to="B")
    return moved(m, "phi", np.linspace(0.3, 2.1, 19), rate=3.0)


def trammel(angles):
    """Cardan's motion: the ends of a rod of length 2 slide on the axes."""
    m = nc.Mechanism("trammel")
    m.point("X", (2 * math.cos(0.7), 0), fixed="y")
    m.point("Y", (0, 2 * math.sin(0.7)), fixed="x")
    m.body("rod", ["X", "Y"])
    m.marker("M", on="rod", at=(math.cos(0.7), math.sin(0.7)))
    m.angle("phi", at="X", to="Y")
    return moved(m, "phi", angles)


def test_centres_of_three_bodies_lie_on_one_line(four_bar):
    every = instant_centres(four_bar)
    for a, b in every:  # turns against the other way round, about the same place
        np.testing.assert_allclose(every[a, b].centre, every[b, a].centre, atol=EXACT)
        np.testing.assert_allclose(every[a, b].rate, -every[b, a].rate, atol=EXACT)
    np.testing.assert_allclose(nc.instant_centre(four_bar, "ground", "crank"), four_bar["A"], atol=EXACT)
    found = {frozenset(pair): np.asarray(c.centre) for pair, c in every.items()}
    assert len(every) == 12 and len(found) == 6
    for three in itertools.combinations(("ground", "crank", "coupler", "rocker"), 3):
        a, b, c = (found[frozenset(pair)] for pair in itertools.combinations(three, 2))
        far = 1.0 + np.linalg.norm(b - a, axis=-1) * np.linalg.norm(c - a, axis=-1)
        np.testing.assert_array_less(np.abs(cross(b - a, c - a)) / far, EXACT)
    np.testing.assert_allclose(found[frozenset(("crank", "coupler"))], four_bar["B"], atol=EXACT)


def test_a_slider_crank_as_published():
    """Crank 10 in, connecting rod 20 in, 45 degrees, 1 rad/s: 159.295 degrees, 0.378 rad/s and 9.744 in/s.

    Source: R. L. Norton, Design of Machinery, as worked in a course's Mathcad sheet (slider-crank analysis).
    """
    m = nc.library.slider_crank(crank=10.0, conrod=20.0, offset=0.0)
    found = nc.solve_position(m.compile(), {"phi": math.pi / 4}, rates={"phi": 1.0}, accelerations={"phi": 0.0})
    assert math.degrees(found.orientation("conrod")) == pytest.approx(159.295 - 180.0, abs=6e-4)
    assert abs(found.velocity("C")[0]) == pytest.approx(9.744, abs=6e-4)
    rod, block = instant_motion(found, "conrod"), instant_motion(found, "slider")
    assert abs(rod.rate) == pytest.approx(0.378, abs=6e-4)
    x = float(found["C"][0])  # where the crank's line meets the slider's normal
    np.testing.assert_allclose(rod.centre, (x, x), rtol=1e-12)
    assert bool(block.moving) and not bool(block.finite)
    np.testing.assert_allclose(np.abs(block.direction), (0.0, 1.0), atol=1e-14)
    np.testing.assert_allclose(block.centre, found["C"])  # finite numbers always
    assert np.all(np.isinf(nc.instant_centre(found, "slider")))


def test_cardan_circles():
    found = trammel(np.linspace(2.0, 2.9, 7))
    rod, both = instant_motion(found, "rod"), centrodes(found, "rod", pose=3)
    np.testing.assert_allclose(np.linalg.norm(both.fixed, axis=-1), 2.0, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(both.moving - found["M"][3], axis=-1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(both.fixed[3], both.moving[3], atol=1e-14)
    # All points of the moving circle run straight: it is the inflection circle, whose pole is the origin.
    np.testing.assert_allclose(rod.centre + rod.inflection, 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(rod.pole_velocity, axis=-1), 2.0, rtol=1e-12)
    # At a steady rate the centre of the fixed circle is without acceleration.
    np.testing.assert_allclose(rod.acceleration_pole, 0.0, atol=1e-12)
    ends = path_curvature(found, "X")
    assert not bool(np.any(ends.bent)) and bool(np.all(ends.moving)) and not np.any(np.asarray(ends.curvature))
    middle = path_curvature(found, "M")
    np.testing.assert_allclose(middle.centre, 0.0, atol=1e-12)
    assert bool(np.all(np.asarray(middle.curvature) * np.asarray(found.velocity("phi")) < 0))  # it runs back


def test_a_wheel_on_a_line_draws_cycloids():
    m = nc.library.rolling_disc(radius=0.1)
    found = nc.sweep(m.compile(), {"phi": np.linspace(0.4, -3.0, 9)}, rates={"phi": -2.0}, accelerations={"phi": 0.0})
    disc, rim = instant_motion(found, "disc"), path_curvature(found, "P2")
    contact = np.asarray(found["P1"]) - np.array([0.0, 0.1])
    np.testing.assert_allclose(disc.centre, contact, atol=1e-12)
    np.testing.assert_allclose(disc.inflection, np.broadcast_to([0.0, 0.1], (9, 2)), atol=1e-12)
    np.testing.assert_allclose(disc.acceleration_pole, found["P1"], atol=1e-12)
    np.testing.assert_allclose(rim.centre, 2 * contact - np.asarray(found["P2"]), atol=1e-11)


def test_curvature_is_that_of_the_curve_and_of_euler_and_savary(four_bar):
    P, coupler, path = np.asarray(four_bar["P"]), instant_motion(four_bar, "coupler"), path_curvature(four_bar, "P")
    rho = P - np.asarray(coupler.centre)
    square = (rho * rho).sum(axis=-1)
    bend = square - (rho * np.asarray(coupler.inflection)).sum(axis=-1)
    np.testing.assert_allclose(path.centre, P - rho * (square / bend)[:, None], rtol=1e-8)
    # The curve itself, by differences over a parameter that is not time.
    phi, step = float(four_bar["phi"][7]), 1e-3
    near = np.asarray(nc.sweep(four_bar.system, {"phi": phi + step * np.arange(-3, 4)})["P"])
    first = np.array([-1, 9, -45, 0, 45, -9, 1]) / (60 * step) @ near
    second = np.array([2, -27, 270, -490, 270, -27, 2]) / (180 * step * step) @ near
    assert path.curvature[7] == pytest.approx(cross(first, second) / np.linalg.norm(first) ** 3, rel=1e-6)


def test_a_body_seen_from_another_is_that_body_in_its_frame(four_bar):
    """The path of P as the rocker sees it, curvature and centre: by differences of coordinates in its frame."""
    seen = path_curvature(four_bar, "P", relative_to="rocker")
    phi, step, k = float(four_bar["phi"][7]), 1e-3, 7
    near = nc.sweep(four_bar.system, {"phi": phi + step * np.arange(-3, 4)})
    axis = (np.asarray(near["C"]) - np.asarray(near["D"])) / np.linalg.norm(near["C"][0] - near["D"][0])
    arm = np.asarray(near["P"]) - np.asarray(near["D"])
    own = np.stack([(arm * axis).sum(axis=-1), (arm * turned(axis)).sum(axis=-1)], axis=-1)
    first = np.array([-1, 9, -45, 0, 45, -9, 1]) / (60 * step) @ own
    second = np.array([2, -27, 270, -490, 270, -27, 2]) / (180 * step * step) @ own
    bend = cross(first, second) / np.linalg.norm(first) ** 3
    assert seen.curvature[k] == pytest.approx(bend, rel=1e-6)
    centre = own[3] + turned(first) / np.linalg.norm(first) / bend
    np.testing.assert_allclose(
        seen.centre[k], np.asarray(four_bar["D"][k]) + centre[0] * axis[3] + centre[1] * turned(axis[3]), rtol=1e-6
    )
    pair = instant_motion(four_bar, "coupler", "rocker")
    np.testing.assert_allclose(pair.centre, four_bar["C"], atol=1e-10)
    np.testing.assert_allclose(pair.inflection, 0.0, atol=1e-9)  # a pin does not wander
    conjugate = centrodes(four_bar, "crank", "rocker", pose=4)
    np.testing.assert_allclose(conjugate.fixed[4], conjugate.moving[4], atol=1e-12)


def test_a_block_on_a_turning_guide_turns_about_where_the_normals_meet():
    """A block of one point slides on the rocker: its own point counts, not those of the guide that gives its angle."""
    m = nc.Mechanism("quick return")
    m.ground("O", (0, 0))
    m.ground("Q", (0, -2))
    m.point("A", (1, 0.5))
    m.point("C", (1.2, 1.0))
    m.body("crank", ["O", "A"])
    m.body("rocker", ["Q", "C"])
    m.slot("guide", "A", ("Q", "C"))
    m.body("block", ["A"])
    m.angle("phi", at="O", to="A")
    found = moved(m, "phi", np.linspace(0.2, 0.9, 5), rate=2.0)
    block, A = instant_motion(found, "block"), np.asarray(found["A"])
    assert bool(np.all(block.finite))
    np.testing.assert_allclose(block.rate, found.angular_velocity("rocker"))
    np.testing.assert_allclose(cross(np.asarray(block.centre), A), 0.0, atol=1e-12)  # Kennedy: on the crank
    slide = instant_motion(found, "block", "rocker")
    assert not bool(np.any(slide.finite)) and bool(np.all(slide.moving))
    along = A - np.asarray(found["Q"])
    np.testing.assert_allclose((np.asarray(slide.direction) * along).sum(axis=-1), 0.0, atol=1e-12)
    np.testing.assert_allclose(instant_motion(found, "block", "crank").centre, A, atol=1e-12)


def test_nothing_is_nan_where_nothing_moves_and_derivatives_pass(four_bar):
    states = [state_of(four_bar, name) for name in ("coupler", "rocker")]
    at_rest = [s._replace(**{k: 0.0 * getattr(s, k) for k in RATES}) for s in states]

    def numbers(state, other):
        pair = instant_of(seen_from(state, other))
        return [x.astype(float) for x in jax.tree.leaves((instant_of(state), pair, curvature_of(state)))]

    for given in (states, at_rest):
        plain = numbers(*given)
        traced, change = jax.jit(lambda *x: jax.jvp(numbers, x, x))(*given)
        for one, two, three in zip(plain, traced, change, strict=True):
            assert isinstance(one, np.ndarray) and np.all(np.isfinite(one)) and np.all(np.isfinite(three))
            np.testing.assert_allclose(one, two, rtol=1e-9, atol=1e-9)


def test_screws_of_a_spatial_mechanism():
    found = moved(nc.library.rccc(), "phi", np.linspace(0.2, 1.4, 5))
    screw = found.screw_axis("coupler")
    rate = np.asarray(screw.rate)[:, None]
    for point in ("B2", "C2"):  # Mozzi, Chasles: every point turns about the axis and advances along it
        arm = np.asarray(found[point]) - np.asarray(screw.point)
        speed = rate * np.cross(screw.direction, arm) + np.asarray(screw.advance)[:, None] * np.asarray(screw.direction)
        np.testing.assert_allclose(speed, found.velocity(point), atol=1e-10)
    pair = found.screw_axis("coupler", "crank")  # a cylindrical pair: its own axis
    axis, at = np.asarray(found["vB"]), np.asarray(found["B1"])
    np.testing.assert_allclose(np.abs((np.asarray(pair.direction) * axis).sum(axis=-1)), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.cross(np.asarray(pair.point) - at, axis), 0.0, atol=1e-10)
    slide = np.gradient(((np.asarray(found["B2"]) - at) * axis).sum(axis=-1))
    assert np.all(
        np.sign(np.asarray(pair.advance) * (np.asarray(pair.direction) * axis).sum(axis=-1)) == np.sign(slide)
    )
    both = axodes(found, "coupler", pose=2)
    for name in ("point", "direction"):
        np.testing.assert_allclose(getattr(both.fixed, name)[2], getattr(both.moving, name)[2], atol=1e-12)


def test_bevel_gears_roll_on_cones():
    found = moved(nc.library.bevel_gears(radius1=0.03, radius2=0.06), "phi", np.linspace(0.0, 2.0, 5))
    both = axodes(found, "wheel1", "wheel2")
    first, second = np.asarray(found["vA"]), np.asarray(found["vB"])
    np.testing.assert_allclose(both.fixed.pitch, 0.0, atol=1e-12)
    rate1, rate2 = (np.asarray(found.angular_velocity(w)) for w in ("wheel1", "wheel2"))
    line = (rate1 - rate2) / np.linalg.norm(rate1 - rate2, axis=-1, keepdims=True)
    shafts = math.acos(abs(float(first[0] @ second[0])))
    half = math.atan2(math.sin(shafts), 2.0 + math.cos(shafts))  # tan δ1 = sin Σ / (r2 / r1 + cos Σ)
    own = np.abs((np.asarray(both.moving.direction) * first[0]).sum(axis=-1))
    other = np.abs((np.asarray(both.fixed.direction) * second[0]).sum(axis=-1))
    np.testing.assert_allclose(
        np.sort([math.acos(own[0]), math.acos(other[0])]), np.sort([half, shafts - half]), atol=1e-9
    )
    np.testing.assert_allclose(own, own[0], atol=1e-12)
    np.testing.assert_allclose(other, other[0], atol=1e-12)
    np.testing.assert_allclose(np.abs((line * np.asarray(found.screw_axis("wheel1", "wheel2").direction)).sum(-1)), 1.0)


@pytest.mark.parametrize(
    "ask, said",
    [
        (lambda m: instant_motion(m, "conrod"), "no body 'conrod'; "),
        (lambda m: instant_motion(m, "coupler", "conrod"), "no body 'conrod'; "),
        (lambda m: centrodes(m.pose(0), "coupler"), r"one sequence of poses, \(T,\)"),
        (lambda m: axodes(m, "coupler"), "for spatial mechanisms; in the plane see"),
        (lambda m: path_curvature(nc.sweep(m.system, {"phi": [0.3, 0.4]}), "P"), "no rates, .* pass rates="),
        (lambda m: centrodes(m, "coupler", pose=999), r"pose\(999\): this motion .* has \d+ poses"),
        (lambda m: path_curvature(m, "phi"), "of points and markers, and 'phi' is a single number"),
        (lambda m: nc.transmission_angle(m, "B", "C", "phi"), "of points and markers, and 'phi'"),
    ],
)
def test_mistakes_are_named(four_bar, ask, said):
    with pytest.raises(nc.InputError, match=said):
        ask(four_bar)
