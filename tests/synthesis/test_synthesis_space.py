"""Where searches in space begin: mechanisms placed, turned and scaled to what is wanted of them."""

import jax
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.synthesis.evaluate import solve_poses
from jaxnc.synthesis.path import rotation_matrix, rotation_vector
from jaxnc.synthesis.problem import draw_designs
from jaxnc.synthesis.search.screen import choose_fit, screen
from jaxnc.synthesis.search.spatial import Freedom, Sums, begin_fit, fit_sums

S = nc.synthesis
ALL = (True, True, True)
TIMES = np.linspace(0.3, 1.9, 6)
VECTORS = {"vA": (0.1, -0.2, 1.0), "vD": (1.0, 0.1, 0.25), "vB": (0.3, 0.4, 0.85), "vC": (0.6, 0.8, -0.15)}


def spherical(**other):
    """A spherical four-bar about a point away from the origin."""
    v, m = VECTORS | other, nc.Mechanism("spherical", dim=3)
    centre = np.array([2.0, 1.0, -3.0])
    m.ground("O", tuple(centre))
    for name in ("vA", "vD"):
        m.ground_vector(name, v[name])
    for name in ("vB", "vC"):
        m.vector(name, v[name])
    for name, ends in {"crank": ["vA", "vB"], "coupler": ["vB", "vC"], "rocker": ["vC", "vD"]}.items():
        m.body(name, ["O"], vectors=ends)
    m.marker("P", on="coupler", at=tuple(centre + np.array([0.6, 0.9, 0.4])))
    m.angle("phi", to="vB", start="vD", about="vA")
    return m


@pytest.fixture(scope="module")
def poses():
    motion = nc.sweep(spherical().compile(), {"phi": TIMES})
    frame = np.asarray(rotation_matrix(np.array([0.4, -1.1, 0.8])))
    return np.asarray(motion["P"]), np.asarray(motion.orientation("coupler")) @ frame


@pytest.mark.parametrize(("guided", "rides"), [(True, True), (True, False), (False, False)])
@pytest.mark.parametrize("size", [1.7, -0.6])
def test_a_mechanism_that_was_moved_turned_and_scaled_is_found_where_it_is(guided, rides, size):
    rng = np.random.default_rng(3)
    way, turns = rng.normal(size=(1, 7, 3)), np.stack([rotation_matrix(v) for v in rng.normal(size=(7, 3))])[None]
    turn, frame = (np.asarray(rotation_matrix(v)) for v in rng.normal(size=(2, 3)))
    place, arm = rng.normal(size=3), rng.normal(size=3) * rides
    target = place + (size * way[0] + turns[0] @ arm) @ turn.T
    free = Freedom(ALL, True, True, True, rides, guided)
    sums = Sums.of(way, turns, target, np.linspace(0.5, 2.0, 7), turn @ turns[0] @ frame if guided else None, 2.0)
    fit, left = begin_fit(free, sums, np.zeros((1, 3))), np.inf
    for _ in range(5):
        fit, left = fit_sums(free, sums, fit, np.full(1, 1e-3), np.full(1, 1e3))
    assert left[0] <= 1e-12
    for found, known in zip(fit, (place, size, turn, arm, frame if guided else np.eye(3)), strict=True):
        np.testing.assert_allclose(found[0], known, atol=1e-6)


def test_vectors_of_rotations_are_theirs():
    some = np.array([[0.3, -0.2, 2.9], [0.0, 0.0, 0.0], [1e-9, 0.0, 0.0], [-3.0, 0.2, 0.1]])
    np.testing.assert_allclose(rotation_vector(np.stack([rotation_matrix(v) for v in some])), some, atol=1e-12)


def test_what_leads_a_mechanism_is_found_out_by_trying(poses):
    def free(names, **more):
        fit = choose_fit(S.MotionGeneration(spherical(), "coupler", "P", *poses, TIMES, free=names, **more))
        return fit and fit.free

    vectors = [*VECTORS]
    assert free(None) == Freedom(ALL, True, True, True, True, True)
    # About a fixed centre it only turns, and what is drawn at a distance of it grows.
    assert free([*vectors, "P"]) == Freedom((False,) * 3, True, True, True, True, True)
    assert free(["vB", "vC", "P"]) == Freedom((False,) * 3, True, True, False, True, True)
    assert free(["vB", "vC"]) == Freedom((False,) * 3, False, False, False, False, True)
    assert not free([*vectors, "P"], bounds={"vA": (-0.2, 0.3)}).turn


@pytest.mark.parametrize(("timing", "half"), [(TIMES, None), (None, 0.5)], ids=["timed", "free, in a box"])
def test_starts_suit_the_poses_of_a_body_in_space(poses, timing, half):
    idea = spherical(vB=(-0.8, 0.5, 0.3), vC=(0.2, -0.7, 0.6), vD=(0.4, 0.9, 0.1))
    bounds = {} if half is None else {"O": tuple((c - half, c + half) for c in (2.0, 1.0, -3.0))}
    problem = S.MotionGeneration(idea, "coupler", "P", *poses, timing, bounds=bounds)
    x = screen(problem, np.random.default_rng(0), 300, 8).x
    assert len(x) == 8 and (x >= problem.low).all() and (x <= problem.high).all()

    def errors(rows):
        seen, fit = solve_poses(problem, rows, 0), choose_fit(problem)
        drawing = rows[:, : len(problem.variables.names)]
        way, turns = fit.rows(drawing, seen.q)
        arm = drawing[:, -3:] - drawing[:, :3]  # of P from O
        place = fit.centre + way + (turns @ arm[:, None, :, None])[..., 0] - poses[0]
        off = turns @ np.stack([rotation_matrix(v) for v in rows[:, -3:]])[:, None] - poses[1]
        square = np.sum(place**2, axis=(1, 2)) + 0.5 * problem.reach**2 * np.sum(off**2, axis=(1, 2, 3))
        return np.where((seen.status == 0).all(axis=1), np.sqrt(square / len(TIMES)), np.inf)

    # Random designs are beside the poses by several times their extent.
    blind = np.concatenate(
        [draw_designs(problem, np.random.default_rng(0), 300), problem.guesses(np.random.default_rng(0), 300)], axis=1
    )
    best = np.sort(errors(blind))[:8]
    assert np.median(errors(x)) <= 0.5 * problem.reach < 2.0 * np.median(best)


@pytest.mark.parametrize("half", [0.1, 1.0, 30.0])
def test_a_known_linkage_in_boxes_of_any_size_is_found(half):
    """A point of a spherical four-bar, timed, from an idea elsewhere in the box."""
    times = np.linspace(0.3, 1.9, 7)
    known = {**VECTORS, "P": (2.6, 1.9, -2.6)}
    bounds = {name: tuple((c - half, c + half) for c in np.array(known[name])) for name in ("vB", "vC", "P")}
    target = nc.sweep(spherical().compile(), {"phi": times})["P"]
    way = 0.5 * min(half, 0.3) * np.array([1.0, -1.0, 0.5])
    idea = spherical(vB=tuple(VECTORS["vB"] + way), vC=tuple(VECTORS["vC"] - way))
    problem = S.PathGeneration(idea, "P", np.asarray(target), times, free=["vB", "vC", "P"], bounds=bounds)
    found = S.solve(problem, starts=200, refine=16, enough=1e-18, key=jax.random.key(1), progress=False)
    assert found.error <= 1e-18 and not found.designs[0].defects
