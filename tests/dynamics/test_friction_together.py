"""Several frictions at once, and joints whose axes are a neighbour's too: balances solved by hand or by SciPy."""

import functools

import numpy as np
import pytest
from scipy.optimize import fsolve

import jaxnc as nc

CRANK, ROD, TURN, PHI, SLOW, RADIUS = 0.04, 0.12, 10.0, 1.0, 0.01, 0.03


def cross(a, b):
    return a[0] * b[1] - a[1] * b[0]


def torque_of(first: float, middle: float, last: float) -> float:
    """The crank's torque under 100 N at the slider, with friction in its two pins and at its guide."""
    m = nc.Mechanism("slider-crank")
    m.ground("O", (0, 0))
    m.point("A", (CRANK, 0))
    m.point("B", (CRANK + ROD, 0), fixed="y")
    m.body("crank", ["O", "A"])
    m.body("rod", ["A", "B"])
    m.angle("phi", at="O", to="A")
    m.force("load", "B", (-100.0, 0))
    if first:
        m.friction("first", coefficient=first, bodies=("crank", "ground"), at="O", radius=RADIUS, speed=SLOW)
    if middle:
        m.friction("middle", coefficient=middle, bodies=("crank", "rod"), at="A", radius=RADIUS, speed=SLOW)
    if last:
        m.friction("last", coefficient=last, joint="B", speed=SLOW)
    system = m.compile()
    motion = nc.motion(system, {"phi": lambda t: PHI + TURN * t}, np.array([0.0, 0.01]))
    return float(nc.inverse_dynamics(system, motion)["phi"][0])


def balance(first: float, middle: float, last: float) -> float:
    """The same: forces of the rod on its pin and of the guide on the slider, from three equations."""
    a = CRANK * np.array([np.cos(PHI), np.sin(PHI)])
    d = np.array([np.sqrt(ROD**2 - a[1] ** 2), -a[1]])
    rod = -TURN * a[0] / d[0]
    slide = -TURN * a[1] - rod * d[1]

    def couple(mu: float, force: float, turn: float) -> float:
        return -mu * RADIUS * force * np.tanh(turn * RADIUS / SLOW)

    def rest(z):
        push = -100.0 - last * abs(z[2]) * np.tanh(slide / SLOW)
        moment = cross(d, (push, z[2])) + couple(middle, np.hypot(*z[:2]), rod - TURN)
        return [z[0] + push, z[1] + z[2], moment]

    pin = fsolve(rest, [100.0, -20.0, 20.0], xtol=1e-13)[:2]
    force = np.hypot(*pin)
    return -(cross(a, -pin) - couple(middle, force, rod - TURN) + couple(first, force, TURN))


@pytest.mark.parametrize("mu", [(0.3, 0.3, 0.0), (0.0, 0.3, 0.3), (0.3, 0.3, 0.3), (0.1, 0.4, 0.2)])
def test_frictions_on_one_body_do_not_disturb_each_other(mu):
    assert torque_of(*mu) == pytest.approx(balance(*mu), rel=1e-7)


@functools.cache
def arm(to: str) -> nc.System:
    """A link on a hinge about z, its angle counted to a point off the hinge's plane or to a vector in it."""
    m = nc.Mechanism("arm", dim=3)
    m.ground("O", (0, 0, 0))
    m.ground_vector("z", (0, 0, 1))
    m.ground_vector("x", (1, 0, 0))
    m.point("B", (1, 0, 0.5))
    m.vector("e", (1, 0, 0))
    m.body("arm", ["O", "B"], vectors=["z", "e"])
    ends = {"at": "O", "to": "B"} if to == "B" else {"to": "e"}
    m.angle("phi", **ends, start="x", about="z")
    m.force("load", "B", (0, 100.0, 0))
    return m.compile()


@pytest.mark.parametrize("to", ["B", "e"])
def test_a_motor_turns_about_its_axis_and_the_hinge_holds_the_rest(to):
    motion = nc.sweep(arm(to), {"phi": [0.0]}, rates={"phi": 0.0})
    found = nc.inverse_dynamics(arm(to), motion).reactions
    np.testing.assert_allclose(found.on("arm")["coordinate phi"].moment[0], [0, 0, -100], atol=1e-9)
    np.testing.assert_allclose(found.at("O", on="arm").moment[0], [50, 0, 0], atol=1e-9)  # -r x F, across the hinge


def two_links(points: tuple[str, str], axis: str, about: str, to: dict, load: tuple, up: float) -> nc.System:
    """Two links on hinges about one direction, the second by rows, and a load at its end, which stands `up`."""
    m = nc.Mechanism("two links", dim=3)
    m.ground("P", (0, 0, 0))
    m.ground_vector("h", (0, 0, 1))
    m.ground_vector("x", (1, 0, 0))
    for name, at in {"A": (1, 0, 0), "A2": (1, 0, 0), "B": (2, 0, up)}.items():
        m.point(name, at)
    for name, way in {"k": (0, 0, 1), "e": (1, 0, 0), "f": (1, 0, 0), "own": (0, 0, 1)}.items():
        m.vector(name, way)
    m.body("first", ["P", "A"], vectors=["h", "e", "own"])
    m.body("second", ["A2", "B"], vectors=["k", "f"])
    m.revolute("J", *points, axes=(axis, "k"))
    m.angle("a", to="e", start="x", about="h")
    m.angle("b", **to, start="e", about=about)
    m.force("load", "B", load)
    return m.compile()


def reactions_at_rest(system: nc.System):
    motion = nc.sweep(system, {"a": [0.0], "b": [0.0]}, rates={"a": 0.0, "b": 0.0})
    return nc.inverse_dynamics(system, motion).reactions


@pytest.mark.parametrize("points", [("A", "A2"), ("A2", "A")])
@pytest.mark.parametrize("axis", ["h", "own"])
def test_a_revolute_about_a_neighbours_axis_acts_on_both_bodies(axis, points):
    """What the joint passes is what the load needs."""
    found = reactions_at_rest(two_links(points, axis, "k", {"to": "f"}, (0, 0, 100.0), 0.0))
    one, other = (found.on(body, about="A")["joint J"] for body in ("first", "second"))
    np.testing.assert_allclose(np.asarray(one.moment[0]), [0, -100, 0], atol=1e-9)
    np.testing.assert_allclose(np.asarray(other.moment[0]), [0, 100, 0], atol=1e-9)
    np.testing.assert_allclose(np.asarray(one.force[0]), -np.asarray(other.force[0]), atol=1e-9)


@pytest.mark.parametrize("about", ["own", "k", "h"])
def test_bodies_balance_whichever_axis_an_angle_turns_about(about):
    """An angle to a point off the hinge's plane: what is across its axis is on both bodies, or on none."""
    system = two_links(("A", "A2"), "own", about, {"at": "A2", "to": "B"}, (0, 100.0, 7.0), 0.5)
    found = reactions_at_rest(system)
    for body in ("first", "second"):
        wrenches = found.on(body, about="A").values()
        assert np.abs(sum(np.asarray(w.moment[0]) for w in wrenches)).max() < 1e-9
        assert np.abs(sum(np.asarray(w.force[0]) for w in wrenches)).max() < 1e-9


def find_force_that_presses(m, bodies, pin, turn, angle):
    """Let bodies rub in a pin, and read the force that presses there off the effort of a slowly driven angle."""
    m.friction("rub", coefficient=0.1, bodies=bodies, at=pin, radius=0.02, speed=1e-6)
    system = m.compile()
    effort = nc.inverse_dynamics(system, nc.motion(system, turn, np.array([0.0, 1e-3])))[angle]
    return float(effort[0]) / (0.1 * 0.02)


@pytest.mark.parametrize("lengths", [(1.0, 3.0), (3.0, 1.0)])
@pytest.mark.parametrize("bodies", [("one", "two"), ("two", "one")])
def test_the_force_into_the_first_body_presses_in_a_pin_on_the_ground(bodies, lengths):
    """Two levers on one ground pin, pulled along their lines with 50 and 200 N."""
    m = nc.Mechanism("levers")
    m.ground("O", (0, 0))
    m.point("P", (lengths[0], 0))
    m.point("Q", (0, lengths[1]))
    m.body("one", ["O", "P"])
    m.body("two", ["O", "Q"])
    m.angle("a", at="O", to="P")
    m.angle("b", at="O", to="Q")
    m.force("pull", "P", (50.0, 0.0))
    m.force("pull2", "Q", (0.0, 200.0))
    turn = {"a": lambda t: 1e-3 * t, "b": lambda t: np.pi / 2 - 1e-3 * t}
    found = find_force_that_presses(m, bodies, "O", turn, "a")
    assert found == pytest.approx({"one": 50.0, "two": 200.0}[bodies[0]], rel=1e-4)


@pytest.mark.parametrize("lengths", [(1.0, 1.01), (1.01, 1.0)])
@pytest.mark.parametrize("bodies", [("one", "two"), ("two", "one")])
def test_the_force_into_the_first_body_presses_in_a_pin_with_a_load(bodies, lengths):
    """Two bars in line: 7 N at the end, and 100 N on the pin between them, which the first one holds."""
    m = nc.Mechanism("two bars")
    m.ground("A", (-lengths[0], 0))
    m.point("P", (0, 0))
    m.point("Q", (lengths[1], 0))
    m.body("one", ["A", "P"])
    m.body("two", ["P", "Q"])
    m.angle("a", at="A", to="P")
    m.angle("b", at="P", to="Q")
    m.force("on pin", "P", (100.0, 0.0))
    m.force("end", "Q", (7.0, 0.0))
    found = find_force_that_presses(m, bodies, "P", {"a": lambda t: 0.0 * t, "b": lambda t: 1e-3 * t}, "b")
    assert found == pytest.approx({"one": 107.0, "two": 7.0}[bodies[0]], rel=1e-4)
