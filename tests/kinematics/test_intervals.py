"""Travel over several intervals, bodies and points that hold nothing: said by name."""

import numpy as np
import pytest
from mechanisms import four_bar, four_bar_joint, reference

import jaxnc as nc
from jaxnc.kinematics.arc import _intervals

MAXIMUM, MINIMUM = "maximum", "minimum"


def test_each_interval_of_a_circuit_has_its_own_limits():
    """The height of a rocker's end: greatest where the rocker stands upright, least at its two dead points."""
    d = reference("fourbar_planar")["definition"]
    a, b, c, g = d["crank"], d["coupler"], d["rocker"], d["ground"]
    # There crank and coupler lie in one line, b ± a long, and make a triangle with the rocker and the ground.
    low = [np.sqrt(c**2 - ((g**2 + c**2 - r**2) / (2 * g)) ** 2) for r in (b - a, b + a)]
    found = nc.travel(four_bar(), "B.y")
    assert found.closed and len(found.intervals) == len(found.dead_points) == 4
    got = sorted((i.lower, i.upper) for i in found.intervals)
    assert np.allclose(got, sorted([(low[0], c)] * 2 + [(low[1], c)] * 2), rtol=0, atol=1e-12)
    assert [i.drawn for i in found.intervals] == [True, False, False, False]
    assert (found.intervals[0].lower, found.intervals[0].upper) == (found.lower, found.upper)
    # One goes on where the one before ends: neighbours share a dead point.
    for one, other in zip(found.intervals, (*found.intervals[1:], found.intervals[0]), strict=True):
        assert one.lower == other.lower or one.upper == other.upper
    text = str(found).splitlines()
    assert f"    1: B.y from {found.lower:.12g} to {found.upper:.12g}, the drawing's" in text
    assert sum(line.startswith("    ") for line in text) == 4


def test_intervals_of_a_circuit_that_was_not_followed_to_its_end():
    """Ahead a maximum at 2, then a minimum at 0; behind a minimum at -1."""
    found = _intervals([(-1.0, MINIMUM), (2.0, MAXIMUM), (0.0, MINIMUM)], 1, False, -np.inf)
    assert [(i.lower, i.upper, i.drawn) for i in found] == [
        (-1.0, np.inf, False),
        (-1.0, 2.0, True),
        (0.0, 2.0, False),
        (0.0, np.inf, False),
    ]
    assert _intervals([], 0, False, 0.0) == ()


def crank():
    m = nc.Mechanism("crank")
    m.ground("A", (0, 0))
    m.point("B", (1, 1))
    m.body("rod", ["A", "B"])
    return m


def test_a_body_of_a_single_ground_point_is_refused():
    m = crank()
    m.body("base", ["A"])
    with pytest.raises(nc.MechanismError, match=r"'base'.*'A'.*second point"):
        m.compile()


def test_points_that_nothing_holds_are_named():
    m = crank()
    m.point("C", (2, 1))
    m.point("D", (3, 1))
    m.point("F", (3, 2), fixed="xy")
    m.point_mass("mass at D", "D", 1.0)  # a particle is meant
    system = m.compile()
    said = "point 'C' belongs to no body and nothing holds it: remove it, or add it to a body"
    assert str(system).count("nothing holds it") == 1 and said in str(system)
    assert nc.mobility(system).loose == (said,) and said in str(nc.mobility(system))
    assert "nothing holds" not in str(crank().compile())


@pytest.mark.parametrize("far", [-9.0, -20.0, -500.0])
def test_a_small_crank_turns_fully_in_a_drawing_of_any_extent(far):
    """Of the guide's line the second point gives a direction only; how far it is away changes no motion."""
    m = nc.Mechanism("slider-crank")
    m.ground("A", (-3, -2)), m.ground("g1", (-2, -2.2)), m.ground("g2", (far, -2.2))
    m.point("B", (-3.4, -2.5)), m.point("C", (-6, -2.2)), m.point("E", (-9, -2.9))
    m.body("crank", ["A", "B"]), m.body("rod", ["B", "C"]), m.body("slider", ["C", "E"])
    m.prismatic("guide", line=("g1", "g2"), on=("C", "E"))
    m.angle("phi", at="A", to="B")
    system = m.compile()
    assert nc.travel(system, "phi").turns
    assert np.ptp(np.asarray(nc.circuit(system, "phi")["phi"])) == pytest.approx(2 * np.pi)


def slider(phi: float, offset: float = 0.0) -> nc.System:
    m = nc.Mechanism("slider-crank")
    b = np.array([np.cos(phi), np.sin(phi)])
    m.ground("A", (0, 0)), m.point("B", b)
    m.point("C", (b[0] + np.sqrt(9 - (b[1] - offset) ** 2), offset), fixed="y")
    m.body("crank", ["A", "B"]), m.body("rod", ["B", "C"]), m.angle("phi", at="A", to="B")
    return m.compile()


@pytest.mark.parametrize("offset", [0.0, 0.3, -0.7, 0.55])
@pytest.mark.parametrize("reach", [4.0, 2.0])
def test_a_dead_point_at_the_drawing_is_one(offset, reach):
    """Crank and rod in line: the stroke of a slider-crank 1, 3 is between there and the other such pose."""
    phi = np.arctan2(offset, np.sqrt(reach**2 - offset**2)) + (np.pi if reach == 2.0 else 0.0)
    found = nc.travel(slider(phi, offset), "C.x")
    ends = np.sqrt(np.array([4.0, 16.0]) - offset**2)
    np.testing.assert_allclose([found.lower, found.upper], ends, rtol=0, atol=1e-13)
    assert len(found.dead_points) == 2 and found.closed


def test_dead_points_where_the_motion_is_singular_are_kept():
    """Peaucellier's rhombus folds flat at both ends of its crank's travel: its pole is then arm - side away."""
    system = nc.library.peaucellier_lipkin(crank=0.2, arm=0.5, side=0.2).compile()
    found = nc.travel(system, "phi")
    end = 2 * np.arccos((0.5 - 0.2) / (2 * 0.2))
    np.testing.assert_allclose([found.lower, found.upper], [-end, end], atol=1e-12)
    line = nc.travel(system, "P.y")
    assert line.upper == pytest.approx(-line.lower, abs=1e-9) and np.isfinite(line.upper) and not line.turns


def looped_bars(a: float, b: float, c: float, d: float) -> nc.System:
    m = nc.Mechanism("four-bar")
    pin = a * np.array([np.cos(1.0), np.sin(1.0)])
    m.ground("A", (0, 0)), m.ground("D", (d, 0)), m.point("B", pin)
    m.point("C", four_bar_joint(a, b, c, np.zeros(2), np.array([d, 0.0]), 1.0, 1.0))
    m.body("crank", ["A", "B"]), m.body("coupler", ["B", "C"]), m.body("rocker", ["C", "D"])
    m.angle("phi", at="A", to="B"), m.angle("psi", at="D", to="C")
    return m.compile()


@pytest.mark.parametrize("bars", [(1, 2, 3, 4.00001), (1, 3, 1, 3.00001), (1, 2, 3, 4.001), (1, 2, 3, 4.00000001)])
def test_a_gap_beside_a_change_point_is_not_stepped_over(bars):
    a, b, c, d = bars
    end = np.arccos((a * a + d * d - (b + c) ** 2) / (2 * a * d))  # coupler and rocker in line
    system = looped_bars(*bars)
    found, poses = nc.travel(system, "phi"), nc.circuit(system, "phi")
    np.testing.assert_allclose([found.lower, found.upper], [-end, end], rtol=0, atol=1e-9)
    assert found.closed and not np.any(poses.status) and np.ptp(np.asarray(poses["phi"])) <= 2 * end + 1e-9


@pytest.mark.parametrize("bars", [(1, 3), (1.5059366220404455, 3.1731993049733456), (0.7, 0.8), (1.9, 2.2)])
def test_kites_pass_the_pose_in_which_their_other_half_turns_freely(bars):
    """Crank and ground alike, coupler and rocker too: the crank turns, and crosses a motion with B on D."""
    short, long = bars
    found = nc.travel(looped_bars(short, long, long, short), "phi")
    assert found.turns and found.closed and not found.dead_points


@pytest.mark.parametrize("beyond", [-7.038e-11, -6e-11, -8.5e-11])
def test_gaps_as_wide_as_the_tolerance_end_the_search_for_them(beyond):
    assert not np.any(nc.circuit(looped_bars(1, 2, 3, 4 + beyond), "phi").status)


def test_circuits_that_pass_each_other_are_not_mixed():
    """Grashof's sum is short of a change point by 1e-5: on one circuit C stays on its side of the line B-D."""
    poses = nc.circuit(looped_bars(1, 3, 1.00001, 3), "phi")
    (x, y), (u, v) = ((np.asarray(poses[n]) - np.asarray(poses["B"])).T for n in ("C", "D"))
    assert len(set(np.sign(x * v - y * u))) == 1


def test_folds_close_to_each_other_are_told_apart():
    """Two dead points of a six-bar 0.0004 apart; from SciPy's roots of lengths and their bordered derivatives."""
    rng = np.random.default_rng(173)
    m = nc.Mechanism("six-bar")
    for n, at in {"A": (0, 0), "D": (3, 0.2), "G": (4.8, 1.5)}.items():
        m.ground(n, at)
    for n, at in {"B": (0.5, 1.1), "C": (2.9, 1.9), "E": (1.9, 2.9), "F": (4.1, 2.8)}.items():
        m.point(n, at)
    for n, points in {"left": "AB", "plate": "BCE", "right": "DC", "link": "EF", "crank": "GF"}.items():
        m.body(n, list(points))
    m.angle("phi", at="G", to="F")
    drawn = m.compile()
    system = drawn.replace({v: np.asarray(drawn[v]) + 0.7 * rng.normal(size=2) for v in drawn.design_variables})
    found = nc.travel(system, "phi").dead_points
    values = 1.77071654825, 1.77032137522, 3.72332828808, 1.16787528117
    np.testing.assert_allclose([d.value for d in found], values, atol=1e-9)
    assert [d.kind for d in found] == [MAXIMUM, MINIMUM] * 2
