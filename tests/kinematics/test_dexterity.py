"""Dexterity of arms and platforms, against closed forms."""

import numpy as np
import pytest
from test_modes import planar

import jaxnc as nc

ROUNDING = 1e-12


def arm(upper=1.2, lower=0.8):
    m = planar("arm", dict(O=(0, 0)), dict(A=(upper, 0), P=(upper, lower)), ["OA", "AP"])
    m.angle("a", at="O", to="A")
    m.angle("b", at="A", to="P")
    return m.compile()


def grid(first, second):
    return np.meshgrid(first, second, indexing="ij")


def test_an_arm_of_two_links(tmp_path):
    """Its manipulability is the product of the lengths and the sine of the elbow's angle (Yoshikawa)."""
    a, b = grid(np.linspace(-1.0, 1.0, 7), np.linspace(0.4, 2.0, 6))
    motion = nc.solve_position(arm(), {"a": a, "b": b})
    found = nc.dexterity(motion, "P", length=0.5)
    np.testing.assert_allclose(found.manipulability, 1.2 * 0.8 * np.abs(np.sin(b - a)) / 0.25, atol=ROUNDING)
    np.testing.assert_allclose(found.singular_values.prod(axis=-1), found.manipulability, atol=ROUNDING)
    # By angles from the x axis all directions are alike where equal links are at right angles.
    square = nc.solve_position(arm(1.0, 1.0), {"a": 0.3, "b": 0.3 + 0.5 * np.pi})
    assert float(nc.dexterity(square, "P").dexterity) == pytest.approx(1.0)
    found.draw(tmp_path / "arm.png", measure="manipulability")
    assert (tmp_path / "arm.png").stat().st_size > 1000
    with pytest.raises(nc.InputError, match="no measure 'dext'"):
        found.draw(measure="dext")


def platform():
    ground, points = dict(a=(0, 0), b=(16, 0), c=(0, 10)), dict(A=(3, 4), B=(10, 5), C=(6, 11))
    m = planar("3-RPR", ground, points, ["ABC"], distances=[("La", "a", "A"), ("Lb", "b", "B"), ("Lc", "c", "C")])
    m.angle("tilt", at="A", to="B")
    return m.compile()


def test_a_platform_is_not_held_where_its_legs_meet_in_a_point(tmp_path):
    """The determinant is that of the legs' lines, whose coordinates are written down here."""
    system = platform()
    x, y = grid(np.linspace(0.1, 9.0, 12), np.linspace(0.2, 8.0, 11))
    motion = nc.solve_position(system, {"A.x": x, "A.y": y, "tilt": 0.4})
    found = nc.dexterity(motion, "A", body="body ABC", actuators=["La", "Lb", "Lc"])
    lines = []
    for leg in "abc":
        hand = np.asarray(motion[leg.upper()])
        along = (hand - np.asarray(system[leg])) / np.linalg.norm(hand - np.asarray(system[leg]), axis=-1)[..., None]
        r = hand - np.asarray(motion["A"])
        lines.append([along[..., 0], along[..., 1], r[..., 0] * along[..., 1] - r[..., 1] * along[..., 0]])
    want = np.linalg.det(np.moveaxis(np.array(lines), (0, 1), (-2, -1))) / found.length  # rates of three lengths by two
    np.testing.assert_allclose(found.held, want, rtol=1e-9, atol=1e-9)
    assert (want > 0).any() and (want < 0).any()
    # By its legs the same Jacobian.
    legs = nc.solve_position(system, {n: motion[n][3, 4] for n in ("La", "Lb", "Lc")}, start=motion.pose((3, 4)))
    by_legs = nc.dexterity(legs, "A", "body ABC")
    np.testing.assert_allclose(by_legs.jacobian, found.jacobian[3, 4], rtol=1e-8)
    np.testing.assert_allclose(by_legs.held, 1.0, rtol=1e-12)
    with pytest.raises(nc.InputError, match="named once"):
        nc.dexterity(motion, "A", actuators=["La", "La", "Lb"])
    found.draw(tmp_path / "platform.png")
    assert (tmp_path / "platform.png").stat().st_size > 1000


def test_what_is_refused():
    motion = nc.sweep(nc.library.four_bar().compile(), {"phi": np.array([0.1, 0.2])})
    for options, says in (
        ({"actuators": ["ph"]}, "no actuator 'ph'"),
        ({"actuators": ["phi", "C.x"]}, "must be as many"),
        ({"body": "couplr"}, "no body 'couplr'"),
        ({"length": -1.0}, "length"),
    ):
        with pytest.raises(nc.InputError, match=says):
            nc.dexterity(motion, "C", **options)
    with pytest.raises(nc.InputError, match="a pose or more"):
        nc.dexterity(nc.solve_position(motion.system, {"phi": np.zeros(0)}), "C")
    m = nc.Mechanism("arm")
    m.ground("O", (0, 0))
    m.point("H", (1, 0))
    m.body("arm", ["O", "H"])
    m.body("hand", ["H"], along=("O", "H"))
    m.angle("a", at="O", to="H")
    with pytest.raises(nc.InputError, match=r"no other point than 'H' .* length="):
        nc.dexterity(nc.solve_position(m.compile(), {"a": 0.1}), "H", body="hand")
