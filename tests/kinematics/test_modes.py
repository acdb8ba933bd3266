"""Every assembly of a mechanism, against published sets, counts made otherwise, and the arc-length tracer."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import reference
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from test_assemblies import SMALL, USUAL, turns_of_the_plate

import jaxnc as nc
from benchmarks import modes as peer
from jaxnc.continuation import monodromy
from jaxnc.continuation.certificate import certify
from jaxnc.continuation.monodromy import run_loops, solve_by_degree, trace_solutions
from jaxnc.continuation.tracker import PathEnds, QuadraticPaths
from jaxnc.kinematics import modes as module
from jaxnc.kinematics import starts
from jaxnc.kinematics.polynomial import read_polynomials

ROUNDING = 1e-11  # poses of size one
CIRCLES = np.array([0.3, 1.9, 4.4])  # angles of a crank, anywhere


@pytest.fixture(autouse=True)
def cached(tmp_path, monkeypatch):
    """Start sets in a folder of the test's own."""
    monkeypatch.setenv("JAXNC_CACHE", str(tmp_path))
    return tmp_path / "modes"


@pytest.fixture
def sooner(monkeypatch):
    """A search that gives up after fewer loops without a new solution takes a third of the time, if it finds all."""
    monkeypatch.setattr(monodromy, "_QUIET", 6)  # four that follow all solutions, and two that follow a few


def planar(name, ground, points, bodies, angle=None, distances=()):
    m = nc.Mechanism(name)
    for p, at in ground.items():
        m.ground(p, at)
    for p, at in points.items():
        m.point(p, at)
    for body in bodies:
        m.body(f"body {body}", list(body))
    if angle:
        m.angle("phi", at=angle[0], to=angle[1])
    for name, a, b in distances:
        m.distance(name, a, b)
    return m


def stephenson(turn=0.0, names=str) -> nc.Mechanism:
    """Stephenson III, driven at its outer dyad; turned, and called otherwise if asked for."""
    c, s = np.cos(turn), np.sin(turn)

    def places(**given):
        return {names(p): (c * x - s * y, s * x + c * y) for p, (x, y) in given.items()}

    bodies = ["".join(map(names, b)) for b in ("AB", "BCE", "DC", "EF", "GF")]
    ground = places(A=(0, 0), D=(3, 0.2), G=(4.8, 1.5))
    points = places(B=(0.5, 1.1), C=(2.9, 1.9), E=(1.9, 2.9), F=(4.1, 2.8))
    return planar("six-bar", ground, points, bodies, (names("G"), names("F")))


def triad(places) -> nc.System:
    m = nc.Mechanism("crank-driven triad")
    for name in "ADH":
        m.ground(name, places[name])
    for name in "BEFG":
        m.point(name, places[name])
    for body in ("AB", "EFG", "BE", "DF", "HG"):
        m.body(body, list(body))
    m.angle("phi", at="A", to="B", start="D")
    return m.compile()


def arm() -> nc.System:
    """Manseur and Doty's arm with 16 real solutions, its hand held; drawn in one of them, found otherwise.

    Source: R. Manseur and K. L. Doty, A robot manipulator with 16 real inverse kinematic solution sets, Int. J.
    Robotics Research 8(5) (1989) 75-79.
    """
    a, d, alpha = [0.3, 1.0, 0.0, 1.5, 0.0, 0.0], [0.0, 0.0, 0.2, 0.0, 0.0, 0.0], np.radians([90, 1, 90, 1, 90, 0])
    turn = np.array([[-0.760117, -0.641689, 0.102262], [0.133333, 0.0, 0.991071], [-0.635959, 0.766965, 0.085558]])
    hand = np.eye(4)
    hand[:3, :3] = Rotation.from_matrix(turn).as_matrix()
    hand[:3, 3] = -1.140175, 0.0, 0.0

    def frames(theta):
        return denavit_hartenberg(theta, a, d, alpha)

    rng = np.random.default_rng(0)
    found = None
    while found is None or np.abs(found.fun).max() > 1e-13:
        start = rng.uniform(-3, 3, 6)
        found = least_squares(lambda x: (frames(x)[-1] - hand)[:3].ravel(), start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return hinged(frames(found.x), (0.0, 0.35, -0.4, 0.3, 0.45, 0.2))  # apart where axes meet


def denavit_hartenberg(theta, a, d, alpha) -> list[np.ndarray]:
    """Frames of an arm, one behind each hinge."""
    out = [np.eye(4)]
    for t, x, z, tilt in zip(theta, a, d, alpha, strict=True):
        c, s, ca, sa = np.cos(t), np.sin(t), np.cos(tilt), np.sin(tilt)
        link = [[c, -s * ca, s * sa, x * c], [s, c * ca, -c * sa, x * s], [0, sa, ca, z], [0, 0, 0, 1]]
        out.append(out[-1] @ np.array(link))
    return out


def hinged(frames, along) -> nc.System:
    """Six hinges about the z axes of frames, their points so far along these, base and hand held."""
    m = nc.Mechanism("arm", dim=3)
    for k, (frame, x) in enumerate(zip(frames, along, strict=False)):
        held = k in (0, 5)
        (m.ground if held else m.point)(f"O{k}", frame[:3, 3] + x * frame[:3, 2])
        (m.ground_vector if held else m.vector)(f"u{k}", frame[:3, 2])
    for k in range(5):
        m.body(f"link {k}", [f"O{k}", f"O{k + 1}"], vectors=[f"u{k}", f"u{k + 1}"])
    return m.compile()


def platform(sparse=None):
    """Dietmaier's platform with 40 real modes: system, leg lengths, published places of the six points."""
    data = reference("stewart_dietmaier40")
    base, hand, legs = (np.array(data["definition"][k]) for k in ("base_points", "platform_points", "leg_lengths"))
    poses = np.array(data["reference"]["poses"])
    want = hand @ np.swapaxes(Rotation.from_quat(poses[:, [1, 2, 3, 0]]).as_matrix(), 1, 2) + poses[:, None, 4:]
    m = nc.Mechanism("platform", dim=3)
    for k in range(6):
        m.ground(f"A{k}", base[k])
        m.point(f"B{k}", want[7, k])
    m.body("platform", [f"B{k}" for k in range(6)])
    for k in range(6):
        m.distance(f"L{k}", f"A{k}", f"B{k}")
    return m.compile(sparse=sparse), {f"L{k}": legs[k] for k in range(6)}, want


def check(found: nc.kinematics.Modes, expected: int, real: int | None = None) -> None:
    """A complete result whose poses meet all rows."""
    assert found.expected == expected and found.complete, found.statement
    assert real is None or len(found) == real, found.statement
    ends = len(found) + len(found.complex) + found.mirrored.status.shape[0] + found.at_infinity
    assert ends == expected, "every path is accounted for"
    for k in range(len(found)):
        rows = nc.system.residual(found.poses.system, found.poses.q[k])
        assert np.abs(np.asarray(rows)).max() < ROUNDING
        assert found.certificates[k].radius < 1e-6 < found.certificates[k].alone


def test_counts_in_the_plane():
    rpr = planar("3-RPR", dict(a=(0, 0), b=(4, 0.3), c=(1.7, 3.9)), dict(A=(1, 1), B=(2.4, 1.2), C=(1.6, 2.2)), ["ABC"],
                 distances=[("La", "a", "A"), ("Lb", "b", "B"), ("Lc", "c", "C")]).compile()  # fmt: skip
    structure = planar("two bars", dict(A=(0, 0), B=(4, 0)), dict(C=(1, 2)), ["AC", "BC"]).compile()
    for seed in range(2):
        check(nc.modes(nc.library.four_bar().compile(), {"phi": 1.0}, seed=seed), 2, 2)
        check(nc.modes(rpr, {"La": 1.5, "Lb": 1.9, "Lc": 1.8}, seed=seed), 6)
        check(nc.modes(stephenson().compile(), {"phi": 156.0}, unit="deg", seed=seed), 6, 6)
        check(nc.modes(nc.library.stephenson_six_bar().compile(), {"phi": 1.0}, seed=seed), 4, 4)
        found = nc.modes(structure, {}, seed=seed)
        check(found, 2, 2)
    np.testing.assert_allclose(found.poses["C"], [(1, 2), (1, -2)], atol=ROUNDING)
    assert found.proved and "proved by total degree" in found.statement


@pytest.mark.skipif(peer.PHC is None, reason="no PHCpack to compare with: apt-get install phcpack")
@pytest.mark.parametrize("name", peer.CASES)
def test_the_same_sets_as_another_solver(name):
    for seed in range(100, 103):
        case = peer.CASES[name](np.random.default_rng(seed))
        theirs, ours = peer.solve_by_phc(case), peer.solve_by_modes(case, case.mechanism.compile())
        assert len(theirs) == len(ours) == peer.count_same(ours, theirs) >= 2


@pytest.mark.parametrize("places", [SMALL, USUAL], ids=["small", "usual"])
def test_the_triads_counts_are_those_of_a_scan(places):
    """Of the ternary link's turn alone the same is counted by changes of sign; all round, and up to six at once."""
    system, start = triad(places), np.arctan2(*places["D"][::-1])
    for phi in np.arange(0.1, 2 * np.pi, 0.4):
        found = nc.modes(system, {"phi": phi})
        check(found, 6, turns_of_the_plate(phi + start, **places))


def test_counts_in_space(sooner):
    rscr = nc.library.rscr().compile()
    check(nc.modes(rscr, {"1.x": 0.09}), 8, 4)
    check(nc.modes(nc.library.rssr().compile(), {"phi": 0.2}), 2, 2)
    found = nc.modes(arm(), {})
    check(found, 16, 16)
    assert "observed" in found.statement and not found.proved
    # No two of the hand's solutions are one: told by all axes.
    axes = np.concatenate([np.asarray(found.poses[f"u{k}"]) for k in range(1, 5)], axis=1)
    assert np.abs(axes[:, None] - axes).max(axis=2)[~np.eye(16, dtype=bool)].min() > 1e-3


def test_an_arm_with_parallel_axes(sooner):
    """Universal Robots' UR5: vectors of their own for axes that are parallel.

    Source: K. P. Hawkins, Analytic inverse kinematics for the Universal Robots UR-5/UR-10 arms, Georgia Tech (2013).
    """
    a, d = [0, -0.425, -0.39225, 0, 0, 0], [0.089159, 0, 0, 0.10915, 0.09465, 0.0823]
    alpha = np.radians([90, 0, 0, 90, -90, 0])
    frames = denavit_hartenberg([0.4, -1.2, 1.5, -0.7, 1.1, 0.3], a, d, alpha)
    check(nc.modes(hinged(frames, (0.05, 0.12, -0.2, 0.15, 0.1, 0.2)), {}), 8, 8)


def test_all_forty_of_dietmaiers_platform(cached, sooner):
    """Each of the published platform's modes once, and nothing else; also with sparse matrices, from the same set."""
    for sparse in (None, True):
        system, legs, want = platform(sparse)
        found = nc.modes(system, legs)
        check(found, 40, 40)
        got = np.stack([np.asarray(found.poses[f"B{k}"]) for k in range(6)], axis=1)
        apart = np.abs(got[:, None] - want).max(axis=(2, 3))
        assert sorted(apart.argmin(axis=1)) == list(range(40))
        assert apart.min(axis=1).max() < 1e-10
        assert apart[0].argmin() == 7, "the one that was drawn comes first"
    driven = tuple(system.topology.position[n] for n in legs)
    (family,) = read_polynomials(system.topology.structure, driven).families.values()
    assert [made.n for made, _ in family.reductions] == [12], "three points, and the product of what lies between them"
    assert len(list(cached.iterdir())) == 1
    # A platform of other dimensions, from the same start set: all forty solutions.
    rng = np.random.default_rng(3)
    moved = {n: np.asarray(system[n]) + 0.2 * rng.normal(size=3) for n in system.topology.points}
    check(nc.modes(system.replace(moved), {n: x * (1 + 0.1 * rng.normal()) for n, x in legs.items()}), 40)


def test_a_design_without_any_elimination_keeps_all_unknowns():
    system, legs, _ = platform()
    driven = tuple(system.topology.position[n] for n in legs)
    reading = read_polynomials(system.topology.structure, driven)
    design = module.describe(system, reading)
    member = design.drawn(driven)
    made = module.Reduction(reading, member, member, None)
    assert made.n == len(reading.unknown) == 18 and made.place(member).sound.all()


def test_platforms_share_a_start_set_whatever_segments_describe_their_bodies(cached, sooner, monkeypatch):
    """Which segments a body's rows take depends on its shape: of these five, drawn at random, they are all others."""

    def drawn(seed):
        rng = np.random.default_rng(seed)
        base, hand = rng.uniform(-1, 1, (6, 3)) * [2, 2, 0.4], rng.uniform(-1, 1, (6, 3)) * [1, 1, 0.3] + [0, 0, 2]
        m = nc.Mechanism("platform", dim=3)
        for k in range(6):
            m.ground(f"A{k}", base[k])
            m.point(f"B{k}", hand[k])
        m.body("platform", [f"B{k}" for k in range(6)])
        for k in range(6):
            m.distance(f"L{k}", f"A{k}", f"B{k}")
        legs = np.linalg.norm(hand - base, axis=1) * (1 + 0.05 * rng.uniform(-1, 1, 6))
        return m.compile(), {f"L{k}": legs[k] for k in range(6)}

    check(nc.modes(*drawn(0)), 40)
    monkeypatch.setattr(starts, "run_loops", None)  # nothing is searched for again
    described = set()
    for seed in (1, 2, 4, 5, 6):
        system, legs = drawn(seed)
        described.add(repr([block.points for block in system.topology.blocks]))
        check(nc.modes(system, legs), 40)
    assert len(described) == 5


def test_neither_names_nor_place_nor_order_matter():
    angles = np.array([2.72, 2.8, 4.0])
    renamed = stephenson(turn=0.7, names=lambda p: dict(zip("ABCDEFG", "GFEDCBA", strict=True))[p]).compile()
    for phi in angles:
        one, two = nc.modes(stephenson().compile(), {"phi": phi}), nc.modes(renamed, {"phi": phi + 0.7})
        assert len(one) == len(two)
        reach = [np.linalg.norm(np.asarray(f.poses[e]), axis=1) for f, e in ((one, "E"), (two, "C"))]
        np.testing.assert_allclose(np.sort(reach[0]), np.sort(reach[1]), atol=1e-9)


def test_a_start_set_is_found_once(cached, monkeypatch):
    m = nc.library.four_bar()

    def fresh():
        system = m.compile()
        reading = read_polynomials(system.topology.structure, (system.topology.position["phi"],))
        reading.families.clear()
        return system

    first = nc.modes(fresh(), {"phi": 0.4})
    (file,) = cached.iterdir()
    with monkeypatch.context() as patch:
        patch.setattr(module, "find_starts", None)
        again = nc.modes(fresh(), {"phi": 0.4})
        np.testing.assert_allclose(again.poses.q, first.poses.q, atol=ROUNDING)
    file.write_bytes(b"damaged")
    check(nc.modes(fresh(), {"phi": 0.4}), 2, 2)
    assert file.stat().st_size > 100
    monkeypatch.setenv("JAXNC_CACHE", "off")
    file.unlink()
    check(nc.modes(fresh(), {"phi": 0.4}), 2, 2)
    assert not list(cached.iterdir())


class Swaps:
    """A leg that permutes numbered solutions: among those of each half, and every other time both halves."""

    def __init__(self, count: int, rng: np.random.Generator):
        half = [rng.permutation(count // 2), count // 2 + rng.permutation(count // 2)]
        self.ends = np.concatenate(half[:: rng.choice([-1, 1])])

    def follow(self, w, pace):
        there, lanes = np.ones(w.shape[1], bool), np.zeros(w.shape[1])
        return PathEnds(1.0 * self.ends[w.real.astype(int)], there, lanes, lanes, lanes)


@pytest.mark.parametrize("count", [8, 40])
def test_loops_find_a_half_that_only_every_other_loop_reaches(count):
    """With 2^-16 they do not: half of a suspension's 320 solutions once stayed away for four loops."""
    for seed in range(100):
        rng = np.random.default_rng(seed)
        found = run_loops(np.zeros((1, 1), complex), lambda rng=rng: [Swaps(count, rng)])
        assert found.w.shape[1] == count and found.quiet == 16


def test_a_search_goes_on_where_it_was_stopped(cached, sooner, monkeypatch):
    """By Ctrl-C, or because there are more solutions than were asked for; what is known is kept."""
    system = nc.library.stewart_platform().compile()
    legs = {f"s{k}": float(np.linalg.norm(system[f"A{k}"] - system[f"B{k}"])) for k in range(1, 7)}
    reading = read_polynomials(system.topology.structure, tuple(system.topology.position[n] for n in legs))
    reading.families.clear()
    with pytest.raises(nc.InputError, match=r"more than 10 solutions: \d+ are known and kept, about \d+.*most=\d+"):
        nc.modes(system, legs, most=10)
    (part,) = cached.iterdir()
    assert part.stem.endswith("-part")
    known, loops, make = np.load(part)["x"].shape[1], [], starts._make_loop

    def interrupted(*args):
        loops.append(None)
        if len(loops) == 2:
            raise KeyboardInterrupt
        return make(*args)

    with monkeypatch.context() as patch:
        patch.setattr(starts, "_make_loop", interrupted)
        with pytest.raises(KeyboardInterrupt, match=r"after \d+ loops are kept; the same call goes on"):
            nc.modes(system, legs)
    more = np.load(part)
    assert more["x"].shape[1] >= known > 10
    found = nc.modes(system, legs)
    check(found, 40)
    assert found.loops > more["history"][0] and [file.stem for file in cached.iterdir()] == [
        part.stem.removesuffix("-part")
    ]
    # Without a cache nothing can be kept, and nothing is said of it.
    monkeypatch.setenv("JAXNC_CACHE", "off")
    reading.families.clear()
    with pytest.raises(nc.InputError, match=r"solutions: \d+ are known, about"):
        nc.modes(system, legs, most=10)


def line_of(*powers: float) -> QuadraticPaths:
    """The curve on which x² is a polynomial in s, by the coefficients of its powers."""
    rows = np.zeros((1, len(powers), 1, 2, 2), complex)
    rows[0, 0, 0, 1, 1] = 1.0
    rows[0, :, 0, 0, 0] = -np.array(powers)
    return QuadraticPaths(rows)


def test_the_trace_test_finds_what_hangs_together_and_nothing_else():
    one, rng = np.array([[1.0 + 0j]]), np.random.default_rng(2)
    every, shown = trace_solutions(line_of(1.0, 1.0), one, rng)  # x² = 1 + s
    assert shown and np.sort(every.real).tolist() == [[pytest.approx(-1.0), pytest.approx(1.0)]]
    every, shown = trace_solutions(line_of(1.0, 2.0, 1.0), one, rng)  # x = ±(1 + s): two curves
    assert shown and every.shape == (1, 1)


def test_a_number_that_was_observed_is_proved_by_trace(cached, sooner, monkeypatch):
    """Of Klann's leg, whose total degree has singular ends; a solution that is missing is found on the way."""
    system, phi = nc.library.klann_leg().compile(), {"phi": 1.0}
    read_polynomials(system.topology.structure, (system.topology.position["phi"],)).families.clear()
    seen = nc.modes(system, phi)
    check(seen, 4)
    assert not seen.proved and "observed" in seen.statement
    (file,) = cached.iterdir()
    arrays = dict(np.load(file))
    np.savez(file, **(arrays | {"x": arrays["x"][:, :3]}))
    read_polynomials(system.topology.structure, (system.topology.position["phi"],)).families.clear()
    with monkeypatch.context() as patch:
        patch.setattr(monodromy, "_TRIES", 1)
        assert not nc.modes(system, phi, prove=True).proved
    found = nc.modes(system, phi, prove=True)
    check(found, 4)
    assert found.proof == "trace test" and "by the trace test" in found.statement
    assert str(np.load(file)["proof"]) == "trace test"


def test_a_kind_of_ones_own():
    """A point on a parabola, at a given distance: four places, two of them real."""
    kind = nc.constraints.Kind("parabola", lambda p, v, s, c: (p[0][1] - p[0][0] * p[0][0],), points=1, source="own")
    m = nc.Mechanism("on a parabola")
    m.ground("A", (0.0, 1.0))
    m.constrain("parabola", kind, points=[m.point("P", (1.0, 1.0))])
    m.distance("s", "A", "P")
    found = nc.modes(m.compile(), {"s": 2.0})
    check(found, 4)
    y = np.roots([1.0, -1.0, -3.0])  # y + (y - 1)² = 4
    want = sorted(x for z in y if z > 0 for x in (np.sqrt(z), -np.sqrt(z)))
    np.testing.assert_allclose(np.sort(found.poses["P"][:, 0]), want, atol=ROUNDING)


def test_certificates_prove_what_is_so_only():
    """Of x² + y² = 1, x y = 1 / 2 - e: proofs near the solutions, none elsewhere, nor where two become one."""

    def system(e):
        t = np.zeros((2, 3, 3))
        t[0, 1, 1] = t[0, 2, 2] = 1.0
        t[0, 0, 0] = -1.0
        t[1, 1, 2] = t[1, 2, 1] = 0.5
        t[1, 0, 0] = e - 0.5
        return t

    rng = np.random.default_rng(0)
    for e, count in ((0.3, 4), (-0.3, 0)):
        w, whole = solve_by_degree(system(e), rng)
        balls = certify(system(e), w)
        assert whole and w.shape[1] == 4 and balls.proved.all()
        assert balls.real.sum() == count and balls.complex.sum() == 4 - count
    exact = np.array([[np.cos(0.5 * np.arcsin(0.4))], [np.sin(0.5 * np.arcsin(0.4))]])
    balls = certify(system(0.3), exact + 1e-7)
    assert 1e-7 < balls.radius[0] < 1e-6, "the solution is within"
    assert not certify(system(0.3), exact + 0.3).proved.any()
    assert not certify(system(0.0), np.full((2, 1), np.sqrt(0.5))).proved.any(), "a double solution"
    assert not certify(system(1e-13), np.full((2, 1), np.sqrt(0.5))).proved.any(), "two that rounding hides"


def test_singular_ends_and_infinity_are_told():
    """At a dead point two assemblies are one; a parallelogram's second family meets the first at its change point."""
    bar = nc.library.four_bar().compile()
    system = stephenson().compile()
    travel = nc.travel(system, "phi")
    at = nc.modes(system, {"phi": travel.lower})
    assert not at.complete and at.singular == 2 and "multiple solutions" in at.statement
    assert len(nc.modes(system, {"phi": travel.lower - 1e-3})) + 2 == len(
        nc.modes(system, {"phi": travel.lower + 1e-3})
    )
    assert nc.modes(bar, {"phi": 1.0}).at_infinity == 0


def test_circuits_meet_where_the_tracer_turns():
    system = stephenson().compile()
    found = nc.circuits(system, {"phi": np.linspace(0, 2 * np.pi, 181)})
    travel = nc.travel(system, "phi")
    assert len(found) == 2 and found.drawn == 0
    for branch in found.circuit(0):
        np.testing.assert_allclose((branch.lower, branch.upper), (travel.lower, travel.upper), atol=1e-9)
    other = nc.travel(system, "phi", start=found.circuit(1)[1].poses.pose(2))
    want = sorted(d.value for d in other.dead_points)
    ends = {round(e, 7) for b in found.circuit(1) for e in (b.lower, b.upper)}
    np.testing.assert_allclose(sorted(ends), want, atol=1e-6)
    assert len(found.circuit(1)) == 4 == len(other.intervals)
    assert "2 circuits; the drawing's has 2 branches, which meet at phi = 111.04°, 202.481°" in str(found)
    np.testing.assert_array_equal(found.count[[0, 60, 78, 100]], [0, 2, 6, 4 - 2 * (100 * 2 > 202.48)])
    for branch in found.branches:
        assert bool(branch.poses.converged.all()) and np.abs(np.diff(np.asarray(branch.poses["F"]), axis=0)).max() < 0.1
    assert nc.circuits(system, {"phi": np.linspace(2.0, 3.0, 31)}).circuit(0)[0].dead == (False, False)
    # A range that begins a whole turn away from the drawing has it too.
    assert nc.circuits(system, {"phi": np.linspace(-2 * np.pi, 0, 31)}).drawn == 0


def test_a_crank_turns_on_both_circuits_of_a_four_bar():
    found = nc.circuits(nc.library.four_bar().compile(), {"phi": np.linspace(0, 2 * np.pi, 73)})
    assert len(found) == 2 and all(b.turns for b in found.branches) and not found.dead_points
    turn = np.linspace(0, 2 * np.pi, 73)
    want = nc.sweep(nc.library.four_bar().compile(), {"phi": turn})["C"]
    np.testing.assert_allclose(found.branches[0].poses["C"], want, atol=1e-10)
    assert str(found).startswith("2 circuits; the drawing's has 1 branch, phi turns fully")


def platforms() -> nc.System:
    """A planar platform on three legs that has up to six assemblies."""
    ground, points = dict(a=(0, 0), b=(15.9, 0), c=(0, 10)), dict(A=(3, 4), B=(16, 5), C=(6, 20))
    return planar("3-RPR", ground, points, ["ABC"], distances=[("La", "a", "A"), ("Lb", "b", "B"), ("Lc", "c", "C")]
                  ).compile()  # fmt: skip


def test_grids_have_at_each_place_what_it_has_alone(tmp_path):
    system, lengths = platforms(), np.linspace(9.0, 23.0, 8)
    first, second = np.meshgrid(lengths, lengths, indexing="ij")
    found = nc.modes(system, {"La": first, "Lb": second, "Lc": 14.0})
    assert found.complete and {*np.unique(found.count)} >= {2, 4, 6} and "Of 64 places" in found.statement
    for i, j in ((0, 0), (1, 3), (6, 6), (7, 0), (3, 7)):
        one = nc.modes(system, {"La": first[i, j], "Lb": second[i, j], "Lc": 14.0})
        assert len(one) == found.count[i, j] == found.poses.converged[i, j].sum()
        np.testing.assert_allclose(found.poses.q[i, j, : len(one)], one.poses.q, atol=1e-9)
    assert np.isfinite(found.poses.q).all()
    found.draw(tmp_path / "map.png")
    assert (tmp_path / "map.png").stat().st_size > 1000
    with pytest.raises(nc.InputError, match="two inputs on a grid"):
        nc.modes(system, {"La": lengths, "Lb": 12.0, "Lc": 14.0}).draw()


def test_stacks_of_designs_have_each_what_it_has_alone():
    """Designs that are not finite, the first among them, count as not known and keep nothing from the others."""
    system, rng = stephenson().compile(), np.random.default_rng(5)
    places = np.asarray(system["C"]) + 0.3 * rng.normal(size=(12, 2))
    places[0, 1], places[5] = np.nan, np.inf
    several = jax.vmap(lambda c: system.replace({"C": c}))(jnp.asarray(places))
    found = nc.modes(several, {"phi": 2.72})
    assert np.flatnonzero(found.doubtful).tolist() == [0, 5] and found.count[[0, 5]].tolist() == [0, 0]
    assert found.poses.status[::5][:2].all() and not found.complete and len({*found.count.tolist()}) > 2
    with pytest.raises(nc.InputError, match="of 2 designs none is finite"):
        nc.modes(jax.tree.map(lambda leaf: leaf[:6:5], several), {"phi": 2.72})
    four_bar = nc.library.four_bar().compile()
    lengths = jnp.asarray([float(four_bar["rocker.C-D"]), jnp.nan])
    found_of_lengths = nc.modes(jax.vmap(lambda c: four_bar.replace({"rocker.C-D": c}))(lengths), {"phi": 1.0})
    assert found_of_lengths.doubtful.tolist() == [False, True] and found_of_lengths.count.tolist() == [2, 0]
    for k in (1, 4, 11):
        one = nc.modes(system.replace({"C": places[k]}), {"phi": 2.72})
        assert len(one) == found.count[k]
        np.testing.assert_allclose(found.poses["E"][k, : len(one)], one.poses["E"], atol=1e-9)


def test_a_crank_alone_has_one_assembly_everywhere():
    """Nothing is left to be solved when linear rows are."""
    crank = planar("crank", dict(A=(0, 0)), dict(B=(0, 2)), ["AB"], "AB").compile()
    found = nc.modes(crank, {"phi": CIRCLES})
    np.testing.assert_allclose(
        found.poses["B"][:, 0], 2.0 * np.stack([np.cos(CIRCLES), np.sin(CIRCLES)], 1), atol=ROUNDING
    )
    assert found.count.tolist() == [1, 1, 1]
    assert nc.circuits(crank, {"phi": np.linspace(0.0, 2 * np.pi, 9)}).branches[0].turns


def test_pictures(tmp_path):
    found = nc.modes(stephenson().compile(), {"phi": 2.72})
    assert len(found.draw(tmp_path / "modes.png").axes) == len(found)
    assert (tmp_path / "modes.png").stat().st_size > 1000
    range_ = nc.circuits(stephenson().compile(), {"phi": np.linspace(2.5, 3.0, 21)})
    range_.draw(tmp_path / "circuits.svg", over="C.x")
    assert "C.x" in (tmp_path / "circuits.svg").read_text() or (tmp_path / "circuits.svg").stat().st_size > 1000
    none = dataclasses.replace(found, certificates=())
    with pytest.raises(nc.InputError, match="no assembly"):
        none.draw()


JOINTED = (
    "cardan_joint crank_slider_on_bar five_bar hart jansen_leg klann_leg rccc peaucellier_lipkin rolling_disc rssp"
    " scotch_yoke spherical_four_bar watt_six_bar wobble_plate"
)


@pytest.mark.parametrize("name", JOINTED.split())
def test_the_pose_that_is_followed_is_among_them(name):
    """What the solver of poses finds from the drawing is one of the assemblies, in mechanisms of many joints."""
    m = getattr(nc.library, name)()
    system, run = m.compile(), m.model.run
    inputs = {n: drive.start + 0.1 * (drive.end - drive.start) for n, drive in run.inputs.items()}
    pose = nc.solve_position(system, inputs, hold=run.hold)
    found = nc.modes(system, inputs, hold=run.hold)
    assert not found.lost
    spread = system.topology.dim * len(system.topology.points)
    apart = np.abs(np.asarray(found.poses.q)[:, :spread] - np.asarray(pose.q)[:spread]).max(axis=1)
    assert apart.min() < ROUNDING
    check_scalars = np.asarray(found.poses.q)[apart.argmin(), spread:]
    np.testing.assert_allclose(np.cos(check_scalars), np.cos(np.asarray(pose.q)[spread:]), atol=1e-9)


def test_what_is_refused():
    with pytest.raises(nc.InputError, match=r"parallelogram.*overconstrained.*mobility"):
        nc.modes(nc.library.parallelogram().compile(), {"phi": 0.4})
    with pytest.raises(nc.InputError, match=r"geared five bar.*angle that is neither.*formulate"):
        nc.modes(nc.library.geared_five_bar().compile(), {"phi": 0.4})
    with pytest.raises(nc.InputError, match="hold no value"):
        nc.modes(nc.library.four_bar().compile(), {"phi": CIRCLES[:0]})
    with pytest.raises(nc.InputError, match="too few inputs"):
        nc.modes(nc.library.four_bar().compile(), {})
    with pytest.raises(nc.InputError, match="one input over its values"):
        nc.circuits(nc.library.four_bar().compile(), {"phi": 0.3})
    with pytest.raises(nc.InputError, match="must ascend"):
        nc.circuits(nc.library.four_bar().compile(), {"phi": [0.3, 0.2]})
    for wrong in ({"most": 0}, {"most": "few"}, {"seed": -1}, {"prove": 3}):
        (name,) = wrong
        with pytest.raises(nc.InputError, match=rf"{name} must be"):
            nc.modes(nc.library.four_bar().compile(), {"phi": 0.3}, **wrong)


# -- ways that would leave the family --------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_an_angle_between_two_moving_bars_is_driven(seed):
    """A second row of it would contradict the lengths on the way from a generic mechanism."""
    m = planar("four-bar", dict(A=(0, 0), D=(4, 0)), dict(B=(0.6, 0.8), C=(3.6, 2)), ["AB", "BC", "DC"])
    m.angle("mu", at="C", to="B", start="D")
    found = nc.modes(m.compile(), {"mu": -1.2}, seed=seed)
    across, down = np.hypot(3.0, 1.2), np.hypot(0.4, 2.0)
    x = (1.0 + 16.0 - (across**2 + down**2 - 2.0 * across * down * np.cos(1.2))) / 8.0
    assert found.complete and found.mirrored.status.shape == (2,)  # the angle's half turns
    places = np.asarray(found.poses["B"])
    np.testing.assert_allclose(places[np.argsort(places[:, 1])], [[x, -np.sqrt(1 - x * x)], [x, np.sqrt(1 - x * x)]])


def test_ends_at_infinity_are_those_of_paths_in_the_family():
    """Of an RCCC, ways that are straight in what linear rows give end at infinity for every other angle."""
    system = nc.library.rccc().compile()
    for phi in (1.445, 4.461, 0.3, 2.9):
        found = nc.modes(system, {"phi": phi})
        assert len(found) == 2 and found.complete and not found.at_infinity
    assert nc.modes(system, {"phi": np.array([1.445, 4.461])}).count.tolist() == [2, 2]


def test_relations_of_lengths():
    """A string over two pins, by the length of one part and by the distance of a third point."""
    m = planar("ellipse", dict(F1=(-1, 0), F2=(1, 0), A=(0.3, 0.2)), dict(P=(0.9, 1.2)), [], None, [
        ("r1", "F1", "P"), ("r2", "F2", "P"), ("R", "A", "P"),
    ])  # fmt: skip
    m.relation("string", {"r1": 1, "r2": 1})
    system, string = m.compile(), np.hypot(1.9, 1.2) + np.hypot(0.1, 1.2)
    x = (1.5**2 - (string - 1.5) ** 2) / 4.0
    found = nc.modes(system, {"r1": 1.5})
    assert found.complete
    np.testing.assert_allclose(np.sort(found.poses["P"][:, 1]), np.sqrt(1.5**2 - (x + 1.0) ** 2) * np.array([-1, 1]))
    by_distance = nc.modes(system, {"R": 1.2})
    places = np.asarray(by_distance.poses["P"])
    assert by_distance.complete and len(places) == 2
    lengths = sum(np.linalg.norm(places - pin, axis=1) for pin in ((-1, 0), (1, 0)))
    np.testing.assert_allclose(lengths, string)


def test_a_coordinate_of_the_ground_is_driven():
    m = planar("rocker", dict(A=(0, 0), D=(4, 0)), dict(B=(0, 1), C=(3.3, 2.9)), ["AB", "BC", "CD"], "AB")
    system, inputs = m.compile(), {"phi": 1.2, "A.x": 0.3}
    found = nc.modes(system, inputs)
    assert found.complete and len(found) == 2
    np.testing.assert_allclose(found.poses["C"][0], nc.solve_position(system, inputs)["C"], atol=ROUNDING)


def test_values_at_which_linear_rows_divide_by_zero():
    five = planar("five-bar", dict(A=(0, 0), E=(2, 0)), dict(B=(-0.8, 1.2), D=(2.9, 1.1), P=(1, 2.5)),
                  ["AB", "BP", "DP", "ED"]).compile()  # fmt: skip
    x, y = np.meshgrid([0.5, 2.0, 3.0], [1.0, 1.5], indexing="ij")  # 2 is where a pivot is
    found = nc.modes(five, {"P.x": x, "P.y": y})
    assert found.complete and (found.count == 4).all()
    slider = planar("slider-crank", dict(A=(0, 0)), dict(B=(0.4, 0.9)), ["AB"], "AB")
    slider.point("C", (2.8, 0.2), fixed="y")
    slider.body("rod", ["B", "C"])
    counts = nc.circuits(slider.compile(), {"C.x": np.linspace(-5, 5, 41)}).count
    assert counts.tolist() == counts[::-1].tolist() and counts.max() == 2


@pytest.mark.parametrize("away", [100.0, 1e6])
def test_a_mechanism_far_from_the_origin(away):
    def range_of(away):
        places = [{p: (x + away, y - 2.0 * away) for p, (x, y) in some.items()} for some in (
            dict(A=(0, 0), D=(3, 0.2), G=(4.8, 1.5)),
            dict(B=(0.5, 1.1), C=(2.9, 1.9), E=(1.9, 2.9), F=(4.1, 2.8)),
        )]  # fmt: skip
        system = planar("six-bar", *places, ["AB", "BCE", "DC", "EF", "GF"], "GF").compile()
        return nc.circuits(system, {"phi": np.linspace(2.4, 3.0, 25)})

    near, far = range_of(0.0), range_of(away)
    assert far.count.tolist() == near.count.tolist() and far.doubtful == near.doubtful == 0
    np.testing.assert_allclose(far.dead_points, near.dead_points, atol=1e-7)


def test_a_circuit_comes_back_after_each_turn():
    """A crank with dead points at 85.2 and 274.8 degrees, over one turn and over two."""
    m = planar("rocker", dict(A=(0, 0), D=(4, 0)), dict(B=(1.5, 0.9), C=(3.3, 2.0)), ["AB", "BC", "CD"], "AB")
    system = m.compile()
    found = [nc.circuits(system, {"phi": np.linspace(0.0, turns * 2 * np.pi, 90 * turns + 1)}) for turns in (1, 2)]
    assert len(found[0]) == len(found[1]) == 1 and not found[0].doubtful + found[1].doubtful
    assert len(found[0].dead_points) == 2 and len(found[1].dead_points) == 4


def test_dead_points_are_within_their_step():
    """A kite whose coupler folds onto its rocker turns freely there: no dead point is made up."""
    c, s = np.cos(0.5), np.sin(0.5)
    middle, half = np.array([2 * c + 2, 2 * s]), np.hypot(4 * c - 4, 4 * s) / 2
    out = np.array([4 * s, 4 - 4 * c]) / (2 * half)
    points = dict(B=(4 * c, 4 * s), C=tuple(middle + np.sqrt(4 - half**2) * out))
    kite = planar("kite", dict(A=(0, 0), D=(4, 0)), points, ["AB", "BC", "DC"], "AB").compile()
    found = nc.circuits(kite, {"phi": np.linspace(-np.pi, np.pi, 90)})
    np.testing.assert_allclose(found.dead_points, np.radians([-60.0, 60.0]), atol=1e-9)
    assert len(found) == 1 and len(found.branches) == 2 and not found.doubtful


@pytest.mark.parametrize("pin", [(2.0, 0.1), (2.0, 0.7), (1.5, 0.9)])
@pytest.mark.parametrize("values", [181, 361])
def test_circuits_of_cranks_that_fold_onto_the_ground(pin, values):
    """The law of cosines has the dead points; the solution of linear rows is 60 times the size next to them."""
    ends = ((3, 1), (2, 0)) if pin[0] == 2.0 else ((3.4, 1.6), (3, 0))
    linkage = nc.synthesis.FourBar((0, 0), pin, *ends)
    turn = np.linspace(0.013, 2 * np.pi, values)
    found, long = nc.circuits(linkage.system, {"phi": turn}), linkage.lengths
    ground, crank = long["ground"], long["crank"]
    reach = abs(long["coupler"] - long["rocker"]), long["coupler"] + long["rocker"]
    cosine = [(ground**2 + crank**2 - d**2) / (2 * ground * crank) for d in reach]
    dead = [angle for c in cosine if abs(c) < 1 for angle in (np.arccos(c), 2 * np.pi - np.arccos(c))]
    np.testing.assert_allclose(found.dead_points, sorted(dead), atol=1e-7)
    apart = abs(ground - crank * np.exp(1j * turn))
    np.testing.assert_array_equal(found.count, 2 * ((apart > reach[0]) & (apart < reach[1])))
    assert len(found) == 2 and len(found.branches) == 4 and not found.doubtful
    assert str(nc.circuits(linkage.system, {"phi": np.linspace(2.8, 3.4, 5)})).startswith("no assembly")


@pytest.mark.parametrize("steps", [180, 90, 179])
def test_assemblies_that_meet_at_a_value(steps):
    """A crank as long as its rod: C.x is 2 cos(phi) or 0, which meet at 90 and 270 degrees, and no dead point."""
    b = np.cos(0.5), np.sin(0.5)
    m = planar("equal", dict(A=(0, 0)), dict(B=b), ["AB"], "AB")
    m.point("C", (2 * b[0], 0.0), fixed="y"), m.body("rod", ["B", "C"])
    found = nc.circuits(m.compile(), {"phi": np.linspace(0, 2 * np.pi, steps + 1)})
    assert len(found) == len(found.branches) == 2 and not found.dead_points and not found.doubtful
    for branch, wanted in zip(found.branches, (2.0, 0.0), strict=True):
        np.testing.assert_allclose(branch.poses["C.x"], wanted * np.cos(branch.poses["phi"]), atol=1e-9)
    cranks = planar("cranks", dict(A=(0, 0), D=(3, 0)), dict(B=b, C=(3 + b[0], b[1])), ["AB", "BC", "CD"], "AB")
    found = nc.circuits(cranks.compile(), {"phi": np.linspace(0, 2 * np.pi, steps + 1)})  # which meet at its ends
    assert len(found) == len(found.branches) == 2 and not found.dead_points and not found.doubtful


@pytest.mark.parametrize("values", [73, 181])
def test_the_drawing_beside_a_dead_point(values):
    """The nearest value is behind it; the drawing is on the circuit for all that."""
    end, at = 0.5, np.radians(28.0)
    rocker = abs(4 - np.exp(1j * end)) - 1.2
    linkage = nc.synthesis.FourBar((0, 0), (np.cos(at), np.sin(at)), (2.0803657103, 0.39079595013), (4, 0))
    assert linkage.lengths["rocker"] == pytest.approx(rocker, rel=1e-9)
    found = nc.circuits(linkage.system, {"phi": np.linspace(0, 2 * np.pi, values)})
    assert len(found) == 1 and found.drawn == 0
    np.testing.assert_allclose(found.dead_points, [end, 2 * np.pi - end], atol=1e-7)


def open_four_bar() -> nc.System:
    """A four-bar 1.5, 1.2, 1, 3 with dead points at ±44.584 degrees."""
    end = np.array([1.5 * np.cos(0.3), 1.5 * np.sin(0.3)])
    way = np.array([3.0, 0.0]) - end
    along = (1.2**2 - 1.0 + way @ way) / (2 * np.hypot(*way))
    across = np.sqrt(1.2**2 - along**2) * np.array([-way[1], way[0]]) / np.hypot(*way)
    c = end + along * way / np.hypot(*way) + across
    return planar("open", dict(A=(0, 0), D=(3, 0)), dict(B=end, C=c), ["AB", "BC", "CD"], "AB").compile()


def test_where_the_input_cannot_stand_everywhere_no_branch_turns():
    rng, drawn = np.random.default_rng(0), stephenson().compile()
    system = drawn.replace({v: np.asarray(drawn[v]) + 0.7 * rng.normal(size=2) for v in drawn.design_variables})
    found = nc.circuits(system, {"phi": np.linspace(-3.0, 2 * np.pi - 3.0, 181)})
    assert found.count.min() == 0 and not any(b.turns for b in found.branches)


@pytest.mark.parametrize("turns", [(-1.0, 1.0), (0.5, 3.5), (-0.1591, 3.1591)])
def test_ranges_of_several_turns_have_each_assembly_once(turns):
    found = nc.circuits(open_four_bar(), {"phi": 2 * np.pi * np.linspace(*turns, 541)})
    assert len(found) == 1 and found.drawn == 0 and not found.doubtful
    folded = np.abs((np.asarray(found.dead_points) + np.pi) % (2 * np.pi) - np.pi)
    np.testing.assert_allclose(folded, np.arccos((1.5**2 + 9 - 2.2**2) / 9), atol=1e-9)


def test_ranges_between_dead_points():
    """As `travel` gives them: the ends are dead points, and are said to be."""
    system = open_four_bar()
    end = nc.travel(system, "phi").upper
    found = nc.circuits(system, {"phi": np.linspace(-end, end, 61)})
    assert len(found) == 1 and len(found.branches) == 2 and not found.doubtful
    np.testing.assert_allclose(found.dead_points, [-end, end], atol=1e-9)
    # Where branches cross at an end nothing is met there.
    b = np.cos(0.5), np.sin(0.5)
    m = planar("equal", dict(A=(0, 0)), dict(B=b), ["AB"], "AB")
    m.point("C", (2 * b[0], 0.0), fixed="y"), m.body("rod", ["B", "C"])
    found = nc.circuits(m.compile(), {"phi": np.radians(np.linspace(0, 90, 46))})
    assert len(found) == 2 and not found.dead_points and not found.doubtful


def test_dead_points_next_to_each_other():
    """Two of a Stephenson six-bar, 1.75 degrees apart: each branch ends at its own."""
    places = {
        "A": (0.062735, 0.0548711), "B": (0.2625125, 0.1542756), "C": (0.3693093, 0.1523808),
        "D": (0.39116, -0.0880661), "E": (0.215259, 0.4142913), "F": (0.6946424, 0.4104347),
        "G": (0.8545333, -0.0591418),
    }  # fmt: skip
    system = nc.library.stephenson_six_bar("III", places=places).compile()
    coarse, fine = (nc.circuits(system, {"phi": np.linspace(0, 2 * np.pi, n)}) for n in (241, 721))
    assert len(coarse) == len(fine) == 1 and not coarse.doubtful
    np.testing.assert_allclose(coarse.dead_points, fine.dead_points, atol=1e-8)
    for branch in coarse.branches:
        phi = np.asarray(branch.poses["phi"])
        assert branch.lower - 1e-9 <= phi.min() and phi.max() <= branch.upper + 1e-9
    said = [part for part in str(coarse).split("meet at phi = ")[1].split(". phi from")[0].split(", ")]
    assert len(said) == len(coarse.dead_points)


@pytest.mark.parametrize("seed", range(3))
def test_rows_that_divide_by_a_length(cached, seed):
    """The disc of the generic mechanism touches its bar: of 16 solutions two are assemblies, on either crank side."""
    system = nc.library.generic_mechanism().compile()
    found = nc.modes(system, {"phi": 0.5}, seed=seed)
    own = nc.solve_position(system, {"phi": 0.5})
    assert found.complete and len(found) == 2 and len(found.mirrored.status) == 2 and len(found.complex) == 12
    np.testing.assert_allclose(found.poses["P1"], [own["P1"], -own["P1"]], atol=1e-9)


def test_loops_from_which_nothing_comes_back_do_not_count():
    class Lost:
        def follow(self, w, pace):
            count = w.shape[1]
            return PathEnds(w, np.zeros(count, bool), *np.zeros((3, count)))

    found = monodromy.run_loops(np.ones((1, 1), complex), lambda: [Lost()], patience=1)
    assert not found.quiet and found.loops < 40


def test_a_pose_that_is_missing_is_told(monkeypatch):
    system = nc.library.four_bar().compile()
    read_polynomials(system.topology.structure, (system.topology.position["phi"],)).families.clear()
    kept = module.select_real
    monkeypatch.setattr(module, "select_real", lambda w, balls: kept(w, balls) & (np.arange(w.shape[1]) > 0))
    found = [nc.modes(system, {"phi": value}) for value in (0.4, 1.1)]
    assert any(not one.complete and one.lost for one in found)


@pytest.mark.parametrize("size", [1.0, 1e-3, 700.0])
@pytest.mark.parametrize("given", [True, False])
def test_numbers_of_an_own_kind_are_lengths_as_they_stand(given, size):
    """A slot ``y = k x²``, its k a constant that is given or a number in the kind: four places at a distance of 3."""

    def rows(p, v, s, c):
        return (p[0][1] - (c[0] if given else 1.0 / size) * p[0][0] * p[0][0],)

    more = {"constants": ("k",), "drawn": lambda p, v, s, c: (c[0],)} if given else {}
    m = nc.Mechanism("slot")
    m.ground("A", (0.0, 5.0 * size))
    m.point("P", (1.6 * size, 2.56 * size))
    m.distance("L", "A", "P")
    slot = nc.constraints.Kind("parabola", rows, points=1, source="a parabola", **more)
    m.constrain("slot", slot, points=["P"], **({"constants": {"k": 1.0 / size}} if given else {}))
    system = m.compile()
    found = nc.modes(system, {"L": 3.0 * size})
    assert found.complete
    right = np.sort(np.roots([1.0, 0.0, -9.0, 0.0, 16.0]).real)
    np.testing.assert_allclose(np.sort(np.asarray(found.poses["P"])[:, 0] / size), right, rtol=1e-9)
    lengths = size * np.array([2.5, 3.0, 5.5, 6.0])
    np.testing.assert_array_equal(nc.modes(system, {"L": lengths}).count, [4, 4, 2, 2])


def test_a_case_that_another_design_chooses_is_refused_for_each():
    """The rows of one design are polynomials, those of the next are others: a start set of the first is none of it."""

    def rows(p, v, s, c):
        return (p[0][1] - jnp.where(c[0] > 0.0, c[0] * p[0][0] * p[0][0], -p[0][0]),)

    choice = nc.constraints.Kind("choice", rows, points=1, constants=("k",), drawn=lambda p, v, s, c: (c[0],))

    def slot(k, place):
        m = nc.Mechanism("slot")
        m.ground("A", (0.0, 5.0)), m.point("P", place), m.distance("L", "A", "P")
        m.constrain("slot", choice, points=["P"], constants={"k": k})
        return m.compile()

    assert len(nc.modes(slot(1.0, (1.6, 2.56)), {"L": 3.0})) == 4
    with pytest.raises(nc.InputError, match="change with a case"):
        nc.modes(slot(-1.0, (1.0, -1.0)), {"L": 6.0})


@pytest.mark.parametrize(("angle", "side"), [(0.8, 1), (0.8, -1), (1.3, 1), (2.0, 1)])
def test_a_kite_that_turns_freely_is_not_called_complete(angle, side):
    """Where B is on D the coupler turns about both; rounding of the drawing leaves no, or two, solutions of that."""
    crank, half = np.array([np.cos(angle), np.sin(angle)]), np.sin(0.5 * angle)
    way = (np.array([1.0, 0.0]) - crank) / (2.0 * half)
    c = crank + half * way + side * np.sqrt(9.0 - half**2) * np.array([-way[1], way[0]])
    m = planar("kite", dict(A=(0, 0), D=(1, 0)), dict(B=tuple(crank), C=tuple(c)), ["AB", "BC", "CD"], "AB")
    m.angle("psi", at="D", to="C")
    found = nc.modes(m.compile(), {"phi": 0.0})
    assert not found.complete and found.singular and "held" in found.statement
