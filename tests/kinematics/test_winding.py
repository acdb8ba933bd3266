"""Inputs many turns away: whole turns that change nothing are not followed, and what is too far is told at once."""

import time

import jax
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.solvers.host import follow
from jaxnc.system.precision import farthest

TURN = 2 * np.pi
AT_ONCE = 1.0  # seconds, of which far less is needed on the host; to follow such a way takes more than five

pytestmark = pytest.mark.filterwarnings("ignore:.*angles are in radians here")  # the numbers look like degrees


def crank(watched: bool = False) -> nc.System:
    m = nc.library.four_bar(coupler_point=(0.06, 0.03))
    if watched:
        m.angle("psi", at="D", to="C")
    return m.compile()


def geared() -> nc.System:
    m = nc.Mechanism("geared")
    A, D = m.ground("A", (0, 0)), m.ground("D", (3, 0))
    B, C = m.point("B", (1, 0)), m.point("C", (3, 2))
    m.body("wheel", [A, B])
    m.body("other", [D, C])
    m.angle("phi", at=A, to=B)
    m.angle("psi", at=D, to=C)
    m.gear("mesh", "phi", "psi", radii=(1.0, 2.0))
    return m.compile()


def double_crank() -> nc.System:
    """A drag link: the other crank turns as often as the input does."""
    m = nc.Mechanism("drag link")
    A, D = m.ground("A", (0, 0)), m.ground("D", (1, 0))
    B, C = m.point("B", (0.3, 3.0)), m.point("C", (3.6, 2.0))
    m.body("crank", [A, B])
    m.body("coupler", [B, C])
    m.body("follower", [D, C])
    m.angle("phi", at=A, to=B)
    m.angle("psi", at=D, to=C)
    return m.compile()


@pytest.fixture
def evaluations(monkeypatch):
    seen = []
    step = follow._evaluate_step
    monkeypatch.setattr(follow, "_evaluate_step", lambda *args: seen.append(1) or step(*args))
    return seen


@pytest.mark.parametrize("turns", [50, 100_000])
@pytest.mark.parametrize("system", [crank, double_crank])
def test_whole_turns_change_nothing(system, turns, evaluations):
    """Poses are those of the last turn, and an angle that turns with the input has turned as often."""
    system = system()
    phi = np.array([1.0, 1.4, 1.0 + TURN * turns, 1.7 + TURN * turns, -2.0])
    far, near = (nc.sweep(system, {"phi": x}) for x in (phi, np.array([1.0, 1.4, 1.0, 1.7, -2.0])))
    assert len(evaluations) < 3000
    assert np.all(far.status == 0)
    rounding = 4 * np.spacing(TURN * turns)
    np.testing.assert_allclose(far["C"], near["C"], atol=rounding + 1e-12)
    np.testing.assert_allclose(far["phi"], phi, rtol=1e-15)
    if "psi" in system.topology.scalars:
        wound = np.asarray(far["psi"] - near["psi"])
        np.testing.assert_allclose(wound, TURN * np.array([0, 0, turns, turns, 0]), atol=10 * rounding + 1e-11)


def test_turns_left_out_are_those_followed():
    """In steps of less than a turn everything is followed."""
    system = double_crank()
    whole = nc.sweep(system, {"phi": np.array([1.0, 1.0 + 12.3 * TURN])})
    every = nc.sweep(system, {"phi": np.linspace(1.0, 1.0 + 12.3 * TURN, 124)})
    np.testing.assert_allclose(whole.q[-1], every.q[-1], atol=1e-11)


@pytest.mark.parametrize(("system", "far"), [(crank, 1e9), (geared, 1e30), (crank, -1e30)])
def test_turns_that_are_not_told_apart(system, far, evaluations):
    system = system()
    assert abs(far) > farthest(np.zeros(1))
    begun = time.process_time()
    one = nc.solve_position(system, {"phi": far}, throw=False).status
    several = nc.sweep(system, {"phi": np.array([1.0, far, 1.0])}).status
    assert time.process_time() - begun < AT_ONCE
    assert nc.Status(int(one)) is nc.Status.TOO_FAR
    assert [nc.Status(int(s)).name for s in several] == ["CONVERGED", "TOO_FAR", "NOT_REACHED"]
    np.testing.assert_array_equal(jax.jit(lambda u: nc.solve_position(system, {"phi": u}).status)(far), one)
    compiled = jax.jit(lambda u: nc.sweep(system, {"phi": u}).status)(np.array([1.0, far, 1.0]))
    np.testing.assert_array_equal(compiled, several)


def test_more_turns_than_can_be_followed():
    """Where turns are counted they are followed, and too many of them are refused before the first."""
    system = geared()
    begun = time.process_time()
    assert list(nc.sweep(system, {"phi": np.array([1.0, 1e6])}).status) == [0, nc.Status.TOO_FAR]
    assert time.process_time() - begun < AT_ONCE
    assert list(nc.sweep(system, {"phi": np.array([1.0, 40.0])}).status) == [0, 0]


def test_branch_that_ends_is_said_all_the_same():
    """A rocker that is asked for a million radians stops at the limit of its travel."""
    m = nc.library.four_bar()
    m.angle("psi", at="D", to="C")
    system = m.compile()
    begun = time.process_time()
    motion = nc.sweep(system, {"psi": np.array([float(nc.solve_position(system, {"phi": 1.0})["psi"]), 1e6])})
    assert time.process_time() - begun < AT_ONCE
    limit = nc.travel(system, "psi")
    assert motion.status[1] != 0
    assert abs(float(motion["psi"][1])) < 10.0, limit
