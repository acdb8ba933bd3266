"""All assemblies of a mechanism, against a published platform that has forty real ones."""

import numpy as np
import pytest
from mechanisms import reference
from scipy.spatial.transform import Rotation

import jaxnc as nc
from jaxnc import compiling

ROUNDING = 1e-12  # poses of size one


@pytest.fixture(autouse=True)
def quick_to_run(monkeypatch):
    """Compiled as users have it: thousands of starts take three times as long in code that is quick to compile."""
    monkeypatch.setattr(compiling, "options", lambda: {"xla_backend_optimization_level": 1})


@pytest.mark.slow
def test_all_forty_assemblies_of_dietmaiers_platform():
    """Each of the published platform's 40 real modes is found once, from 500 rigid starts, and nothing else is."""
    data = reference("stewart_dietmaier40")
    base, hand, legs = (np.array(data["definition"][k]) for k in ("base_points", "platform_points", "leg_lengths"))
    poses = np.array(data["reference"]["poses"])
    want = hand @ np.swapaxes(Rotation.from_quat(poses[:, [1, 2, 3, 0]]).as_matrix(), 1, 2) + poses[:, None, 4:]
    m = nc.Mechanism("platform with 40 modes", dim=3)
    for k in range(6):
        m.ground(f"A{k}", base[k])
        m.point(f"B{k}", want[7, k])
    m.body("platform", [f"B{k}" for k in range(6)])
    for k in range(6):
        m.distance(f"L{k}", f"A{k}", f"B{k}")
    f = nc.formulate(m, "independent")
    found = f.assemblies({f"L{k}": legs[k] for k in range(6)}, starts=500)
    got = np.stack([np.asarray(found[f"B{k}"]) for k in range(6)], axis=1)
    apart = np.abs(got[:, None] - want).max(axis=(2, 3))
    assert len(got) == 40 and bool(found.converged.all())
    assert sorted(apart.argmin(axis=1)) == list(range(40))
    assert apart.min(axis=1).max() < 1e-10  # the least conditioned mode, 1e-4, magnifies rounding
    assert apart[0].argmin() == 7, "the one that was drawn comes first"
    reach = np.linalg.norm(got - base, axis=-1)
    np.testing.assert_allclose(reach, np.broadcast_to(legs, reach.shape), atol=ROUNDING)


def triad(**places):
    """A crank A-B whose pin, and the ground at D and H, carry a ternary link E-F-G by three bars."""
    m = nc.Mechanism("crank-driven triad")
    for name in "ADH":
        m.ground(name, places[name])
    for name in "BEFG":
        m.point(name, places[name])
    m.body("crank", ["A", "B"])
    m.body("plate", ["E", "F", "G"])
    for name, ends in (("first", "BE"), ("second", "DF"), ("third", "HG")):
        m.body(name, list(ends))
    m.angle("phi", at="A", to="B", start="D")
    return nc.formulate(m, "independent")


def turns_of_the_plate(phi, A, B, D, E, F, G, H):
    """How many places the ternary link has, by counting: with its turn given, two bars less the third are lines for E.

    Their intersection, put into the third bar's circle, is a function of the turn alone, whose changes of sign count.
    """
    A, B, D, E, F, G, H = (complex(*p) for p in (A, B, D, E, F, G, H))
    pin = A + abs(B - A) * np.exp(1j * phi)
    turn = np.exp(1j * np.linspace(0.0, 2 * np.pi, 100_001))
    one, two = turn * (F - E) - D + pin, turn * (G - E) - H + pin  # E is sought from the pin
    far = [(abs(e - c) ** 2 - abs(E - B) ** 2 - abs(w) ** 2) / 2 for e, c, w in ((F, D, one), (G, H, two))]
    across = (one.conj() * two).imag
    place = 1j * (far[1] * one - far[0] * two)
    circle = abs(place) ** 2 - (abs(E - B) * across) ** 2
    return int(np.sum(np.sign(circle[1:]) != np.sign(circle[:-1])))


SMALL = {  # a platform that is small beside its crank; one pose in 500 starts
    "A": (0, 0), "B": (-18.43, -3.47), "D": (0.27, -0.16), "H": (-1.3, -2.06),
    "E": (0.31, -0.36), "F": (-0.3, -0.15), "G": (-0.08, 0.15),
}  # fmt: skip
USUAL = {
    "A": (0, 0), "B": (1, 0), "D": (4, 0), "H": (2, 5), "E": (1.2, 2), "F": (3.2, 1.8), "G": (2, 3.2)
}  # fmt: skip


@pytest.mark.parametrize("places", [SMALL, USUAL], ids=["small", "usual"])
def test_every_pose_of_a_crank_driven_triad(places):
    one, counts = triad(**places), []
    for phi in (2.0, np.pi):
        counts.append(turns_of_the_plate(phi + np.arctan2(*places["D"][::-1]), **places))
        assert len(one.assemblies({"phi": phi}).q) == counts[-1]
    assert max(counts) == (4 if places is SMALL else 2)


def test_a_structure_has_assemblies_too():
    """Without a freedom there are no inputs; more starts than are solved at a time did not go through."""
    m = nc.Mechanism("two bars")
    m.ground("A", (0, 0))
    m.ground("B", (4, 0))
    m.point("C", (1, 2))
    m.body("left", ["A", "C"])
    m.body("right", ["B", "C"])
    f = nc.formulate(m, "independent")
    for starts in (129, None):
        found = f.assemblies({}, starts=starts)
        np.testing.assert_allclose(found["C"][0], (1, 2), atol=ROUNDING)
    np.testing.assert_allclose(found["C"][1], (1, -2), atol=1e-11)
