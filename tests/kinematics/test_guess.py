"""Poses from a guess: what it leaves out follows from what it has, and a batch may have one for each lane."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import four_bar_joint

import jaxnc as nc
from jaxnc.errors import AssemblyError, InputError

SIZES = 1.0, 3.0, 2.5, 3.5  # crank, coupler, rocker, ground
TURN = np.linspace(0.3, 5.9, 7)


@functools.cache
def measured_four_bar() -> nc.System:
    """A four-bar with coordinates that nothing drives: the rocker's angle, the coupler's, and a diagonal."""
    joint = crank_pin(0.7)
    m = nc.Mechanism("four-bar with angles")
    m.ground("O", (0, 0))
    m.ground("Q", (SIZES[3], 0))
    m.point("A", joint)
    m.point("B", other_pin(0.7, 1.0))
    m.body("crank", ["O", "A"])
    m.body("coupler", ["A", "B"])
    m.body("rocker", ["Q", "B"])
    m.angle("phi", at="O", to="A")
    m.angle("psi", at="Q", to="B")
    m.angle("chi", to=("A", "B"), start=("O", "A"))
    m.distance("diagonal", "O", "B")
    return m.compile()


def crank_pin(phi):
    return SIZES[0] * np.array([np.cos(phi), np.sin(phi)])


def other_pin(phi, side):
    pivots = jnp.zeros(2), jnp.array([SIZES[3], 0.0])
    return np.asarray(four_bar_joint(*SIZES[:3], *pivots, phi, side))


@pytest.mark.parametrize("phi", [0.3, 3.0, 5.9])
def test_an_exact_assembly_needs_neither_crank_pin_nor_angles(phi):
    want = other_pin(phi, -1.0)
    for guess in ({"B": want}, {"B": want, "A": crank_pin(phi)}, {"B": want + np.array([0.05, -0.05])}):
        found = nc.solve_position(measured_four_bar(), {"phi": phi}, start=guess)
        np.testing.assert_allclose(found["B"], want, atol=1e-12)
        np.testing.assert_allclose(found["A"], crank_pin(phi), atol=1e-12)
        psi = np.arctan2(want[1], want[0] - SIZES[3])
        assert abs(np.sin(0.5 * (float(found["psi"]) - psi))) < 1e-12
        assert float(found["diagonal"]) == pytest.approx(np.hypot(*want), abs=1e-12)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_angles_that_a_guess_leaves_out_are_counted_as_in_the_drawing(side):
    """The rocker is drawn at about two radians; on the other branch it is beyond π, not below zero."""
    system, want = measured_four_bar(), other_pin(0.9, side)
    drawn = float(nc.solve_position(system, {"phi": 0.7})["psi"])
    each = nc.solve_position(system, {"phi": 0.9}, start={"B": want})["psi"]
    traced = jax.jit(lambda B: nc.solve_position(system, {"phi": 0.9}, start={"B": B})["psi"])(jnp.asarray(want))
    psi = np.arctan2(want[1], want[0] - SIZES[3])
    psi += 2 * np.pi * np.round((drawn - psi) / (2 * np.pi))
    np.testing.assert_allclose([each, traced], [psi, psi], atol=1e-12)


def test_a_guess_may_be_values_of_coordinates_alone():
    want = other_pin(2.0, -1.0)
    psi = np.arctan2(want[1], want[0] - SIZES[3])
    found = nc.solve_position(measured_four_bar(), {"phi": 2.0}, start={"psi": psi})
    np.testing.assert_allclose(found["B"], want, atol=1e-12)


def test_a_guess_for_each_lane_or_one_for_all():
    sides = np.where(np.arange(len(TURN)) % 2 == 0, 1.0, -1.0)
    want = np.stack([other_pin(u, side) for u, side in zip(TURN, sides, strict=True)])
    found = nc.solve_position(measured_four_bar(), {"phi": TURN}, start={"B": want + 0.03})
    assert bool(jnp.all(found.converged))
    np.testing.assert_allclose(found["B"], want, atol=1e-12)
    again = nc.solve_position(measured_four_bar(), {"phi": TURN}, start=found)
    np.testing.assert_allclose(again["B"], want, atol=1e-12)
    near = nc.solve_position(measured_four_bar(), {"phi": TURN[:2]}, start={"B": other_pin(0.8, -1.0)})
    np.testing.assert_allclose(near["B"], [other_pin(u, -1.0) for u in TURN[:2]], atol=1e-12)
    traced = jax.jit(lambda u, B: nc.solve_position(measured_four_bar(), {"phi": u}, start={"B": B})["B"])
    np.testing.assert_allclose(traced(TURN, want), want, atol=1e-12)


def test_a_guess_from_which_nothing_is_found_is_not_left_for_nowhere():
    """Least squares that meet nothing once led 2e7 sizes away; the pose that is handed on is the guess."""
    m = nc.Mechanism("six-bar")
    for name, at in {"A": (0, 0), "D": (0.8678, 2.5168), "G": (0.5517, 0.9795)}.items():
        m.ground(name, at)
    for name, at in {"B": (0.7792, 0.6179), "C": (1.4248, 1.0462), "E": (2.7473, 0.0287)}.items():
        m.point(name, at)
    for ends in ("AB", "DC", "BC", "GE", "CE"):
        m.body(ends, [*ends])
    m.angle("phi", at="A", to="B")
    system, guess = m.compile(), np.array([-1.816, 1.1565])
    for pose in (
        nc.solve_position(system, {"phi": 0.387661}, start={"E": guess}, throw=False),
        jax.jit(lambda x: nc.solve_position(system, {"phi": 0.387661}, start={"E": x}, throw=False))(guess),
    ):
        found = pose.status == 0
        assert found or np.abs(np.asarray(pose.q)).max() < 100.0


def test_messages_speak_of_the_guess():
    system = nc.library.four_bar(crank=0.1, coupler=0.12, rocker=0.07, ground=0.1).compile()
    phi = system.topology.scalars[0]
    with pytest.raises(AssemblyError, match=r"start.*off by .*Name more points") as error:
        nc.solve_position(system, {phi: np.pi}, start={"B": (0.0, 0.1)})
    assert "drawing" not in str(error.value)
    with pytest.raises(InputError, match=r"start of 'B'.*\(7, \.\.\.\).*\(3, 2\)"):
        nc.solve_position(measured_four_bar(), {"phi": TURN}, start={"B": np.zeros((3, 2))})
    pair = nc.solve_position(measured_four_bar(), {"phi": TURN[:2]})
    with pytest.raises(InputError, match=r"start.*\(7,\).*\(2,\)"):
        nc.solve_position(measured_four_bar(), {"phi": TURN}, start=pair)


def test_a_guess_that_lies_nearest_to_a_crank_turned_half_round_is_told_so():
    system = four_bar_drawn({"A": (0, 0), "B": (0.1, 0.05), "C": (0.4, 0.15), "D": (0.4, 0)})
    with pytest.raises(AssemblyError, match="an angle is off by half a turn"):
        nc.solve_position(system, {"phi": -2.05}, start={"C": (-0.368, -0.256)})
    assert int(nc.solve_position(system, {"phi": -2.05}, start={"C": (0.3, 0.1)}).status) == 0


def four_bar_drawn(places):
    m = nc.Mechanism("four-bar")
    for name, at in places.items():
        (m.ground if name in "AD" else m.point)(name, at)
    for body in ("AB", "BC", "CD"):
        m.body(body, list(body))
    m.angle("phi", at="A", to="B")
    return m.compile()
