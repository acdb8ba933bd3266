"""Travel over several intervals, bodies and points that hold nothing: said by name."""

import numpy as np
import pytest
from mechanisms import four_bar, reference

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
