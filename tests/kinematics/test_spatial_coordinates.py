"""Angles about an axis and distances along one, frames of bodies and what rides on them, through several turns.

A rotor turns about and slides along a fixed axis; beside it two shafts are joined by a universal joint. Everything is
compared with rotations written out (Rodrigues) and closed forms.
"""

import jax
import numpy as np
import pytest
from rigs import turn

import jaxnc as nc
from jaxnc.solvers.assembly import derive, to_host
from jaxnc.system.assemble import assemble
from jaxnc.system.equations import guards

pytestmark = pytest.mark.slow

QUICK = {"xla_backend_optimization_level": 0, "xla_llvm_disable_expensive_passes": True}  # compiled once, run little
POSE, SPEED, ACCELERATION = 1e-12, 1e-11, 1e-10  # of sizes about 2
E = np.array([0.48, 0.6, 0.64])
ORIGIN, K, P0 = np.array([0.2, -0.1, 0.3]), np.array([0.9, 0.8, -0.5]), 0.7
GROUND, VECTOR = np.array([1.0, -0.4, 0.6]), np.array([0.3, -0.8, 0.2])
MARK, WAY = np.array([0.1, 0.9, 1.2]), np.array([0.6, 0.0, -0.8])
TURNS, RATE, SLIDE = 3, 2.0, -0.5
BEND = np.radians(35)
COUNT = 97
PHI = np.linspace(0.0, 2 * np.pi * TURNS, COUNT)  # from the drawing
S = np.linspace(0.9, -1.1, COUNT)


def seen(a, b):
    """The angle from one direction to another as seen along the axis."""
    return np.arctan2(E @ np.cross(a, b), a @ b - (a @ E) * (b @ E))


def bearing():
    """The fixed axis, and the rotor's point on it."""
    m = nc.Mechanism("rotor and shafts", dim=3)
    m.ground("O", ORIGIN)
    m.ground_vector("e", E)
    m.point("P", ORIGIN + P0 * E)
    m.distance("s", "O", "P", along="e")
    return m


def shafts(m):
    """Shafts whose axes meet at an angle, by a universal joint with arms across them."""
    m.ground_vector("a", (1, 0, 0))
    m.ground_vector("b", (np.cos(BEND), np.sin(BEND), 0))
    m.vector("u", (0, 0, 1))
    m.vector("v", (-np.sin(BEND), np.cos(BEND), 0))
    m.body("input shaft", ["O"], vectors=["a", "u"])
    m.body("output shaft", ["O"], vectors=["b", "v"])
    m.universal("cross", axes=("u", "v"))
    m.angle("theta", to="u", about="a")
    m.angle("psi", to="v", about="b")


ROTATIONS = np.array([turn(E, a)[0] for a in PHI])


@pytest.fixture(scope="module")
def motion():
    m = bearing()
    m.vector("k", VECTOR)
    m.body("rotor", ["P"], vectors=["e", "k"])
    m.cylindrical("bearing", line=("O", "e"), on="P")
    m.angle("phi", to="k", about="e")
    shafts(m)
    m.marker("K", on="rotor", at=K)
    m.marker("mark", on="rotor", at=MARK)
    m.marker("way", on="rotor", direction=WAY)
    m.marker("still", on="rotor", direction=E)
    inputs = {"phi": PHI, "s": S, "theta": PHI}
    return nc.sweep(m.compile(), inputs, rates={"phi": RATE, "s": SLIDE, "theta": RATE}, throw=True)


def carried(place):
    """Place, velocity and acceleration of a point of the rotor, by its rotation and its slide."""
    arm = ROTATIONS @ (place - ORIGIN - P0 * E)
    spin = np.cross(RATE * E, arm)
    return ORIGIN + S[:, None] * E + arm, spin + SLIDE * E, np.cross(RATE * E, spin)


SINES = ("sine", "sine x", "sine y", "sine z", "sines")


def expected():
    """Every form of the angle and the distance: how it is declared, its values and its rate."""
    arm = K - ORIGIN - P0 * E
    first, ground = seen(VECTOR, arm), seen(GROUND - ORIGIN, arm)
    angles = {
        "vector": ({"to": ("P", "K"), "start": "f", "about": "e"}, first + PHI, RATE),
        "point": ({"at": "P", "to": "K", "start": "G", "about": ("O", "O2")}, ground + PHI, RATE),
        "pair": ({"to": ("P", "K"), "start": ("O", "G"), "about": ("O", "O2")}, ground + PHI, RATE),
        "ahead": ({"to": ("P", "K"), "about": ("O", "O2")}, PHI, RATE),
        "back": ({"to": "f", "start": ("P", "K"), "about": "e"}, -first - PHI, -RATE),
        "other": ({"to": ("P", "K"), "start": "f", "about": ("O2", "O")}, -first - PHI, -RATE),
    }
    for form in ("cosine", *SINES, "redundant", "switched"):
        name = form.replace(" ", "_")
        angles[name] = ({"to": ("P", "K"), "start": "f", "about": "e", "form": form}, first + PHI, RATE)
        angles[name + "_pair"] = (
            {"to": ("P", "K"), "start": ("O", "G"), "about": ("O", "O2"), "form": form},
            ground + PHI,
            RATE,
        )
    w = ORIGIN + S[:, None] * E - GROUND
    size = np.linalg.norm(w, axis=1)
    distances = {
        "s_pair": (("O", "P", ("O", "O2")), S, SLIDE),
        "s_point": (("O", "P", "O2"), S, SLIDE),
        "s_back": (("P", "O", "e"), -S, -SLIDE),
        "s_K": (("O", "K", "e"), S + (K - ORIGIN) @ E - P0, SLIDE),
        "between": (("G", "P"), size, SLIDE * w @ E / size),
    }
    for form in ("x", "y", "z", "redundant", "switched"):
        distances["s_" + form] = (("O", "P", "e", form), S, SLIDE)
        distances[f"s_{form}_pair"] = (("O", "P", ("O", "O2"), form), S, SLIDE)
    return angles, distances


BLIND = {form.replace(" ", "_") + pair for form in ("cosine", *SINES) for pair in ("", "_pair")}  # somewhere in a turn


def test_every_form_holds_through_turns_and_zero():
    """Rows vanish at the right values, turn after turn, and at the right rates; each sees its coordinate."""
    m = bearing()
    m.ground("O2", ORIGIN + 0.5 * E)
    m.ground("G", GROUND)
    m.ground_vector("f", VECTOR)
    m.point("K", K)
    m.body("rotor", ["P", "K"], vectors=["e"])
    m.cylindrical("bearing", line=("O", "e"), on="P")
    m.angle("phi", to=("P", "K"), about="e")
    angles, distances = expected()
    for name, (declared, *_) in angles.items():
        m.angle(name, **declared)
    for name, (declared, *_) in distances.items():
        m.distance(name, *declared)
    system = assemble(m)
    top, eq, inner = system.topology, derive(system), to_host(derive(system))
    look = jax.jit(lambda q: guards(eq, q)[0], compiler_options=QUICK)
    values = {**angles, **distances, "phi": (None, PHI, RATE), "s": (None, S, SLIDE)}
    place, speed, _ = carried(K)
    rows = {name: [i for i, row in enumerate(top.rows) if row.startswith(name + ":")] for name in values}
    assert all(rows.values())
    assert E.all(), "the text's rows of a distance need every component"
    for k in range(0, COUNT, 5):
        q, rate = np.array(eq.home), np.zeros(len(eq.home))
        for name, (_, value, slope) in values.items():
            q[top.position[name]], rate[top.position[name]] = value[k], np.broadcast_to(slope, COUNT)[k]
        for name, at, v in (("P", ORIGIN + S[k] * E, SLIDE * E), ("K", place[k], speed[k])):
            i = top.position[name + ".x"]
            q[i : i + 3], rate[i : i + 3] = at, v
        j = inner.jacobian(q[:, None])[0]
        assert np.abs(inner.residual(q[:, None])).max() < POSE and np.abs(j @ rate).max() < SPEED
        assert (np.asarray(look(q)) > 0).all()
        for name in {*values} - BLIND:
            assert np.linalg.norm(j[rows[name], top.position[name]]) > 0.2, name
        for name in angles:
            q[top.position[name]] += np.pi
        assert (np.asarray(look(q))[1:] < 0).sum() == len(angles), "half a turn too much is not the same angle"


def test_driven_coordinates(motion):
    for name, value, rate in (("phi", PHI, RATE), ("s", S, SLIDE)):
        np.testing.assert_allclose(motion[name], value, atol=POSE, err_msg=name)
        np.testing.assert_allclose(motion.velocity(name), rate, atol=SPEED, err_msg=name)


def test_markers_ride_on_the_body(motion):
    for name, place in (("K", K), ("mark", MARK)):
        for got, want, tolerance in zip(
            (motion[name], motion.velocity(name), motion.acceleration(name)),
            carried(place),
            (POSE, SPEED, ACCELERATION),
            strict=True,
        ):
            np.testing.assert_allclose(got, want, atol=tolerance)
    way = ROTATIONS @ WAY
    np.testing.assert_allclose(motion["way"], way, atol=POSE)
    np.testing.assert_allclose(motion.velocity("way"), np.cross(RATE * E, way), atol=SPEED)
    np.testing.assert_allclose(
        motion.acceleration("way"), np.cross(RATE * E, np.cross(RATE * E, way)), atol=ACCELERATION
    )
    np.testing.assert_allclose(motion["still"], np.broadcast_to(E, way.shape), atol=POSE)
    np.testing.assert_allclose(motion["way.z"], way[:, 2], atol=POSE)


def test_orientation_and_quaternion(motion):
    np.testing.assert_allclose(motion.orientation("rotor"), ROTATIONS, atol=POSE)
    p = np.asarray(motion.quaternion("rotor"))
    want = np.concatenate([np.cos(PHI / 2)[:, None], np.sin(PHI / 2)[:, None] * E], axis=1)
    np.testing.assert_allclose(p, want, atol=POSE)  # continuous over the turns, not only up to its sign
    one = motion.pose(COUNT // 2)
    np.testing.assert_allclose(one.orientation("rotor"), ROTATIONS[COUNT // 2], atol=POSE)
    assert one.quaternion("rotor").shape == (4,) and float(one.quaternion("rotor")[0]) >= 0
    np.testing.assert_allclose(motion.position("rotor"), ORIGIN + S[:, None] * E, atol=POSE)


def test_the_screw_axis_of_a_turn_with_a_slide(motion):
    axis = motion.screw_axis("rotor")
    np.testing.assert_allclose(axis.direction, np.broadcast_to(E, (COUNT, 3)), atol=SPEED)
    np.testing.assert_allclose(axis.rate, RATE, atol=SPEED)
    np.testing.assert_allclose(axis.advance, SLIDE, atol=SPEED)
    np.testing.assert_allclose(axis.pitch, SLIDE / RATE, atol=SPEED)
    np.testing.assert_allclose(np.cross(axis.point - ORIGIN, E), 0.0, atol=SPEED)


def test_the_universal_joint(motion):
    """tan ψ = tan θ / cos β with the arm in the plane of the shafts, and the shafts' frames."""
    psi = np.arctan2(np.sin(PHI), np.cos(PHI) * np.cos(BEND))
    other = np.arctan2(np.sin(PHI) * np.cos(BEND), np.cos(PHI))
    got = np.asarray(motion["psi"])
    wanted = min((np.unwrap(psi), np.unwrap(other)), key=lambda x: np.abs(got - x).max())
    np.testing.assert_allclose(got, wanted, atol=POSE)
    # ω ratio cos β / (1 - sin²β cos²γ), γ counted from where the driving arm is in the plane of the shafts (π/2 on).
    gamma = PHI - np.pi / 2
    down = 1 - np.sin(BEND) ** 2 * np.cos(gamma) ** 2
    ratio = np.cos(BEND) / down
    slope = -np.cos(BEND) * np.sin(BEND) ** 2 * np.sin(2 * gamma) / down**2
    b = np.array([np.cos(BEND), np.sin(BEND), 0])
    np.testing.assert_allclose(motion.velocity("psi"), RATE * ratio, atol=SPEED)
    np.testing.assert_allclose(motion.acceleration("psi"), RATE**2 * slope, atol=ACCELERATION)
    np.testing.assert_allclose(motion.angular_velocity("output shaft"), (RATE * ratio)[:, None] * b, atol=SPEED)
    np.testing.assert_allclose(
        motion.angular_acceleration("output shaft"), (RATE**2 * slope)[:, None] * b, atol=ACCELERATION
    )
    np.testing.assert_allclose(
        motion.angular_velocity("input shaft"), np.broadcast_to([RATE, 0, 0], (COUNT, 3)), atol=SPEED
    )
    turned = np.array([turn(b, x)[0] for x in wanted])
    np.testing.assert_allclose(motion.orientation("output shaft"), turned, atol=POSE)


def test_what_a_motion_refuses(motion):
    with pytest.raises(nc.InputError, match=r"no body 'rotr'.*did you mean 'rotor'"):
        motion.orientation("rotr")
    with pytest.raises(nc.InputError, match="no point, marker or coordinate 'marc'"):
        motion["marc"]
