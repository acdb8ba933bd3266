"""Branches are kept, dead points located, and what cannot be reached is said, not invented."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import four_bar, four_bar_joint, slider_crank, turn

import jaxnc as nc


def rocker_bar(crank=2.5):
    """A four-bar whose crank cannot turn fully: its limits have a closed form."""
    m = nc.Mechanism("double rocker")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    m.point("B", (0, crank))
    m.point("C", (3.3, 2.9))
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C"])
    m.body("rocker", ["C", "D"])
    m.angle("phi", at="A", to="B")
    return m.compile()


def limit(crank, coupler, rocker, ground=4.0):
    """Crank angle at which coupler and rocker are in line."""
    return np.arccos((crank**2 + ground**2 - (coupler + rocker) ** 2) / (2 * crank * ground))


@pytest.mark.parametrize("count", [4, 5, 7, 13])
@pytest.mark.parametrize("crossed", [False, True])
def test_coarse_steps_keep_the_branch(count, crossed):
    """Steps of up to 120° are subdivided; the closed form of the same branch is met."""
    u = np.linspace(0.0, 2 * np.pi, count)
    mo = nc.sweep(four_bar(crossed=crossed), {"phi": u})
    assert bool(jnp.all(mo.converged))
    side = -1.0 if crossed else 1.0
    for k, x in enumerate(u):
        want = four_bar_joint(0.04, 0.12, 0.08, jnp.zeros(2), jnp.array([0.1, 0.0]), x, side)
        np.testing.assert_allclose(mo["B"][k], want, atol=1e-13)


def test_unordered_inputs_as_lanes():
    rng = np.random.default_rng(3)
    u = rng.uniform(-20.0, 20.0, 200)
    mo = nc.solve_position(four_bar(), {"phi": u})
    assert bool(jnp.all(mo.converged))
    want = np.stack([four_bar_joint(0.04, 0.12, 0.08, jnp.zeros(2), jnp.array([0.1, 0.0]), x, 1.0) for x in u])
    np.testing.assert_allclose(mo["B"], want, atol=1e-13)
    np.testing.assert_allclose(mo["phi"], u, atol=1e-13)


def test_guess_and_branch_choose_the_assembly():
    system = four_bar()
    open_pose = nc.solve_position(system, {"phi": 0.7})
    other = nc.solve_position(system, {"phi": 0.7}, start={"B": (0.09, -0.07), "P": (0.1, 0.02)})
    want = four_bar_joint(0.04, 0.12, 0.08, jnp.zeros(2), jnp.array([0.1, 0.0]), 0.7, -1.0)
    np.testing.assert_allclose(other["B"], want, atol=1e-13)
    wrong = nc.solve_position(system, {"phi": 0.7}, start=other, branch=open_pose, throw=False)
    assert int(wrong.status) == nc.Status.BRANCH_JUMP
    with pytest.raises(nc.AssemblyError, match="another branch"):
        nc.solve_position(system, {"phi": 0.7}, start=other, branch=open_pose)
    assert float(wrong.inputs["phi"]) == 0.7 and nc.sweep(system, {"phi": turn(5)}).pose(2).status.shape == ()
    # A sweep can start on the other branch and stays there.
    mo = nc.sweep(system, {"phi": turn(61)}, start=other)
    again = nc.sweep(four_bar(crossed=True), {"phi": turn(61)})
    np.testing.assert_allclose(mo["B"], again["B"], atol=1e-13)


def test_sweep_stops_at_a_dead_point_with_a_status():
    system = rocker_bar()
    b, c = float(np.hypot(3.3, 0.4)), float(np.hypot(0.7, 2.9))
    end = limit(2.5, b, c)
    u = np.linspace(1.5, 4.0, 101)
    mo = nc.sweep(system, {"phi": u}, rates={"phi": 1.0})
    good = np.asarray(mo.converged)
    np.testing.assert_array_equal(good, u < end)
    status = np.asarray(mo.status)
    first = int(np.flatnonzero(~good)[0])
    assert status[first] == nc.Status.SINGULAR and set(status[first + 1 :]) == {int(nc.Status.NOT_REACHED)}
    assert np.all(np.isfinite(mo.q)) and np.all(np.asarray(mo.rates)[:, ~good] == 0)
    with pytest.raises(nc.AssemblyError, match="dead point"):
        mo.check()
    assert float(mo["phi"][first]) == pytest.approx(end, abs=1e-4), "the last pose on the branch is handed back"


@pytest.mark.parametrize("crank", [2.5, 3.0, 5.0])
def test_limits_of_travel_to_rounding(crank):
    system = rocker_bar(crank)
    b, c = float(np.hypot(3.3, 2.9 - crank)), float(np.hypot(0.7, 2.9))
    found = nc.travel(system, "phi")
    end = limit(crank, b, c) if abs(crank - 4) < b + c < crank + 4 else None
    if end is None:
        assert found.turns or not np.isfinite(found.upper)
        return
    inner = abs(crank**2 + 16 - (b - c) ** 2) < 8 * crank
    low = np.arccos((crank**2 + 16 - (b - c) ** 2) / (8 * crank)) if inner else -end
    assert abs(found.upper - end) <= 1e-12 * (found.upper - found.lower)
    assert abs(found.lower - low) <= 1e-12 * (found.upper - found.lower)
    for dead in found.dead_points:
        assert float(dead.pose.residual) <= 1e-13 * 4
        assert float(dead.pose.conditioning) < 1e-6, "an input is singular at its dead point"
    assert "dead point" in str(found)


def test_a_motion_that_ends_without_turning_back_has_limits():
    """A rope over a peg through which its load slides: it is used up when the arm's end is 1.5 away."""
    m = nc.Mechanism("hoist")
    m.ground("A", (0, 0)), m.ground("H", (2, 0))
    m.point("B", (1, 0)), m.point("W", (2, -0.5), fixed="x")
    m.body("arm", ["A", "B"]), m.cable("rope", ["B", "H", "W"])
    m.angle("phi", at="A", to="B")
    found = nc.travel(m.compile(), "phi")
    end = np.arccos((5 - 2.25) / 4)
    assert found.upper == pytest.approx(end, abs=1e-7) and found.lower == pytest.approx(-end, abs=1e-7)
    assert found.ends == (found.lower, found.upper) and str(found).count("ends at phi = ") == 2


def test_a_slider_has_its_stroke_and_a_crank_turns():
    found = nc.travel(slider_crank(), "S.x")
    r, length, e = 0.1, 0.3, 0.02
    assert found.upper == pytest.approx(np.sqrt((length + r) ** 2 - e**2), abs=1e-14)
    assert found.lower == pytest.approx(np.sqrt((length - r) ** 2 - e**2), abs=1e-14)
    turning = nc.travel(slider_crank(), "phi")
    assert turning.turns and not turning.dead_points and "turns fully" in str(turning)


@pytest.mark.parametrize("name", ["cardan_joint", "cardan_shafts", "spherical_four_bar"])
def test_shafts_whose_points_stand_still_turn_fully(name):
    """Only their directions move: one turn of the input closes the circuit, though no point has left its place."""
    system = getattr(nc.library, name)().compile()
    assert nc.travel(system, "phi").turns
    q, phi = (np.asarray(x) for x in (nc.circuit(system, "phi", poses=73).q, system.topology.position["phi"]))
    assert abs(q[-1, phi] - q[0, phi]) == pytest.approx(2 * np.pi, abs=1e-12)
    directions = q.shape[1] - len(system.topology.scalars)
    assert np.ptp(q[:, : 3 * len(system.topology.points)], axis=0).max() < 1e-12
    np.testing.assert_allclose(q[0, :directions], q[-1, :directions], rtol=0, atol=1e-12)


def test_poses_right_before_a_dead_point_are_reached_and_none_behind():
    """A rocker as far as ten millionths of a degree from where coupler and rocker are in line."""
    a, b, c, g, home = 0.8996260671548708, 0.9822589564395148, 0.9790415228123337, 1.444240731427372, -0.06
    dead = -np.arccos((a * a + g * g - (b + c) ** 2) / (2 * a * g))

    def pins(phi):
        A = a * np.array([np.cos(phi), np.sin(phi)])
        d = np.array([np.broadcast_to(g, np.shape(phi)), 0.0 * phi]) - A
        r = np.hypot(*d)
        along = (b * b - c * c + r * r) / (2 * r)
        return A, A + (along * d + np.sqrt(b * b - along * along) * np.array([-d[1], d[0]])) / r

    m = nc.Mechanism("rocker")
    m.ground("O", (0, 0))
    m.ground("C", (g, 0))
    m.point("A", pins(home)[0])
    m.point("B", pins(home)[1])
    for name, ends in (("crank", "OA"), ("coupler", "AB"), ("rocker", "CB")):
        m.body(name, list(ends))
    m.angle("phi", at="O", to="A")
    system, off = m.compile(), 10.0 ** -np.arange(2.0, 8.5, 0.5)
    for phi, there in ((dead + off, True), (dead - off, False)):
        alone = [nc.solve_position(system, {"phi": u}, throw=False) for u in phi]
        ends = [nc.sweep(system, {"phi": np.linspace(home, u, 9)}).pose(-1) for u in phi]
        for poses in (alone, ends):
            assert [bool(pose.converged) for pose in poses] == [there] * len(off)
            if there:  # a pose is known to rounding over its distance from the dead point
                far = np.abs(np.stack([pose["B"] for pose in poses]) - pins(phi)[1].T).max(axis=1)
                np.testing.assert_array_less(far * np.sqrt(off), 1e-14)


def test_a_circuit_goes_through_dead_points():
    system = rocker_bar()
    b, c = float(np.hypot(3.3, 0.4)), float(np.hypot(0.7, 2.9))
    end = limit(2.5, b, c)
    mo = nc.circuit(system, "phi", between=(1.5, 4.0), poses=400)
    assert bool(jnp.all(mo.converged)) and float(jnp.max(mo.residual)) < 1e-13 * 4
    phi = np.asarray(mo["phi"])
    assert end - 1e-3 < phi.max() <= end + 1e-12
    top = int(np.argmax(phi))
    assert phi[-1] == pytest.approx(1.5, abs=1e-6) and top < 399, "it went through and came back"
    C = np.asarray(mo["C"])
    B, D = np.asarray(mo["B"]), np.array([4.0, 0.0])
    side = (D - B)[:, 0] * (C - B)[:, 1] - (D - B)[:, 1] * (C - B)[:, 0]
    assert side[0] > 0 > side[-1], "on the other branch after the dead point"


def test_a_whole_circuit_comes_round_or_is_followed_both_ways():
    """A rocker's circuit from its drawing; and a block on a rail, which goes on for ever either way."""
    system = rocker_bar()
    mo = nc.circuit(system, "phi", poses=200)
    end = limit(2.5, float(np.hypot(3.3, 0.4)), float(np.hypot(0.7, 2.9)))
    phi, points = np.asarray(mo["phi"]), np.asarray(mo.q)[:, :8]
    assert bool(mo.converged.all()) and end - 1e-2 < phi.max() <= end + 1e-12
    np.testing.assert_allclose(points[[0, -1]], [nc.circuit(system, "phi", poses=2).q[0, :8]] * 2, atol=1e-9)
    np.testing.assert_allclose(mo["C"][0], (3.3, 2.9), atol=1e-12)
    m = nc.Mechanism("block on a rail")
    m.ground("O", (0, 0))
    m.ground("D", (2, 0))
    m.point("S", (1, 0), fixed="y")
    m.distance("s", "O", "S", along="D")
    block = nc.circuit(m.compile(), "s", poses=9)
    x = np.asarray(block["S.x"])
    assert bool(block.converged.all()) and x.min() < -50 and x.max() > 50
    np.testing.assert_allclose(np.abs(np.diff(x)), abs(x[1] - x[0]), rtol=1e-9)
    with pytest.raises(nc.InputError, match="at least 2"):
        nc.circuit(system, "phi", poses=1)
    with pytest.raises(nc.InputError, match="first and last value"):
        nc.circuit(system, "phi", between=(1.0,))


def test_parallelogram_passes_its_change_points():
    """A parallelogram swept through its flattened poses stays a parallelogram (velocity continuous)."""
    m = nc.Mechanism("parallelogram")
    m.ground("A", (0, 0))
    m.ground("D", (3, 0))
    m.point("B", (np.cos(1.0), np.sin(1.0)))
    m.point("C", (3 + np.cos(1.0), np.sin(1.0)))
    m.body("one", ["A", "B"])
    m.body("two", ["D", "C"])
    m.body("coupler", ["B", "C"])
    m.angle("phi", at="A", to="B")
    u = np.linspace(1.0, 1.0 + 2 * np.pi, 90)
    mo = nc.sweep(m.compile(), {"phi": u})
    assert bool(jnp.all(mo.converged))
    np.testing.assert_allclose(mo["C"], 3 * np.array([1.0, 0.0]) + np.stack([np.cos(u), np.sin(u)], -1), atol=1e-10)


def test_redundant_third_crank_changes_nothing():
    m = nc.Mechanism("three cranks")
    for k, (g, p) in enumerate((("A", "B"), ("D", "C"), ("E", "F"))):
        m.ground(g, (2.0 * k, 0.3 * k))
        m.point(p, (2.0 * k + np.cos(1.0), 0.3 * k + np.sin(1.0)))
        m.body(f"crank{k}", [g, p])
    m.body("coupler", ["B", "C", "F"])
    m.angle("phi", at="A", to="B")
    system = m.compile()
    report = nc.mobility(system)
    assert (report.n, report.rows, report.rank, report.dof, report.grubler) == (7, 7, 6, 1, 0)
    assert len(report.redundant) == 1 and len(report.involved) > 1
    u = turn(73)
    mo = nc.sweep(system, {"phi": u}, rates={"phi": 2.0})
    assert bool(jnp.all(mo.converged))
    e = np.stack([np.cos(u), np.sin(u)], -1)
    np.testing.assert_allclose(mo["F"], np.array([4.0, 0.6]) + e, atol=1e-12)
    np.testing.assert_allclose(mo.velocity("F"), 2 * np.stack([-e[:, 1], e[:, 0]], -1), atol=1e-12)
    np.testing.assert_allclose(mo.acceleration("F"), -4 * e, atol=1e-11)


def test_held_coordinate_keeps_its_value():
    m = nc.Mechanism("two links")
    m.ground("A", (0, 0))
    m.point("B", (1, 0))
    m.point("C", (1, 1))
    m.body("one", ["A", "B"])
    m.body("two", ["B", "C"])
    m.angle("phi", at="A", to="B")
    m.angle("psi", at="B", to="C")
    mo = nc.sweep(m.compile(), {"phi": np.linspace(0, 1, 5)}, hold=["psi"], rates={"phi": 1.0})
    np.testing.assert_allclose(mo["psi"], np.pi / 2, atol=1e-14)
    np.testing.assert_allclose(mo["C"] - mo["B"], np.broadcast_to([0.0, 1.0], (5, 2)), atol=1e-14)


def test_far_from_the_origin_nothing_is_lost():
    """The same mechanism a thousand sizes away: rounding of the coordinates is all that is lost."""
    near, far = four_bar(explicit=True), four_bar(explicit=True)
    shift = np.array([123.0, -77.0])
    far = far.replace({name: np.asarray(far[name]) + shift for name in (*far.topology.points, "G")})
    u = turn(61)
    a, b = nc.sweep(near, {"phi": u}, rates={"phi": 1.0}), nc.sweep(far, {"phi": u}, rates={"phi": 1.0})
    assert bool(jnp.all(b.converged))
    np.testing.assert_allclose(b["P"] - shift, a["P"], atol=123 * 1e-14)
    np.testing.assert_allclose(b.acceleration("G"), a.acceleration("G"), atol=1e-11)


def wide_rocker(start=2.6, crank=1.0, coupler=2.4, rocker=2.5, ground=4.0):
    """A rocker that travels more than a half turn to either side of the ground line, drawn near one end of it."""
    joint = np.asarray(four_bar_joint(crank, coupler, rocker, jnp.zeros(2), jnp.array([ground, 0.0]), start, 1.0))
    m = nc.Mechanism("wide rocker")
    m.ground("A", (0, 0))
    m.ground("D", (ground, 0))
    m.point("B", crank * np.array([np.cos(start), np.sin(start)]))
    m.point("C", joint)
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C"])
    m.body("rocker", ["C", "D"])
    m.angle("phi", at="A", to="B")
    return m.compile(), np.arccos((crank**2 + ground**2 - (coupler + rocker) ** 2) / (2 * crank * ground))


def test_whole_travel_of_a_rocker_at_every_number_of_lanes():
    """Poses more than half a turn from the drawing are reached the long way round, by many lanes as by few."""
    system, end = wide_rocker()
    rng = np.random.default_rng(5)
    for count in (40, 512, 3000):
        u = rng.permutation(np.linspace(-end + 1e-3, end - 1e-3, count))
        assert np.sum(2.6 - u > np.pi) > count // 4  # the nearest turn to these lies beyond the end of travel
        want = jax.vmap(lambda x: four_bar_joint(1.0, 2.4, 2.5, jnp.zeros(2), jnp.array([4.0, 0.0]), x, 1.0))(u)
        mo = nc.solve_position(system, {"phi": u})
        assert bool(jnp.all(mo.converged))
        np.testing.assert_allclose(mo["C"], want, atol=1e-8)  # 1e-3 from a dead point roots are doubled
        np.testing.assert_allclose(mo["phi"], u, atol=1e-13)
    beyond = nc.solve_position(system, {"phi": np.linspace(end + 0.01, 2 * np.pi - end - 0.01, 600)})
    assert bool(jnp.all(beyond.status == int(nc.Status.DID_NOT_ASSEMBLE)))


def test_turns_are_taken_off_without_rounding():
    """Poses after up to sixteen million turns are those of the angle as it was given, and hold it."""
    u = np.array([-1e4, 1e3, 1e6, 1e8])
    pin = 0.04 * np.stack([np.cos(u), np.sin(u)], axis=1)
    for asked in (u, np.repeat(u, 3)):
        poses = nc.solve_position(four_bar(), {"phi": asked}, unit="rad")
        np.testing.assert_allclose(np.asarray(poses["A"])[:: len(poses.status) // 4], pin, rtol=0, atol=1e-15)
        assert np.array_equal(np.asarray(poses["phi"])[:: len(poses.status) // 4], u)


def test_an_input_that_is_far_too_far_is_no_dead_point():
    """Its turns cannot be told, which says nothing of the branch; a million turns lead back to where they began."""
    assert nc.sweep(four_bar(), {"phi": [0.0, -1e300, -1e300]}, unit="rad").status.tolist() == [0, 7, 4]
    assert nc.sweep(four_bar(), {"phi": [0.0, 1e7, 1e7]}, unit="rad").status.tolist() == [0, 0, 0]
    assert nc.sweep(rocker_bar(), {"phi": [1.6, 100.0]}, unit="rad").status.tolist() == [0, 2]


def test_a_distance_that_folds_to_nothing_has_no_dead_point_below():
    m = nc.Mechanism("folding rule")
    m.ground("A", (0, 0))
    m.point("B", (0.5, 0.6))
    m.point("C", (1, 0), fixed="y")
    m.body("one", ["A", "B"])
    m.body("two", ["B", "C"])
    m.distance("s", "A", "C")
    found, long = nc.travel(m.compile(), "s"), 2 * np.hypot(0.5, 0.6)
    assert found.lower == 0.0 and found.upper == pytest.approx(long, abs=1e-13)
    assert [(d.kind, d.value) for d in found.dead_points] == [("maximum", pytest.approx(long, abs=1e-13))]
    assert all(one.lower == 0.0 for one in found.intervals)
