"""What is read off poses that the host has found: the same numbers as by JAX, and nothing is compiled for them."""

import functools

import jax
import jax.monitoring
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.constraints import Kind
from jaxnc.constraints.kind import dot, norm
from jaxnc.kinematics.design import Pose, PoseReading
from jaxnc.library import bennett

SEEN = []  # programs that were compiled


def _heard(event, *_, **__):
    if event.endswith("backend_compile_duration"):
        SEEN.append(event)


jax.monitoring.register_event_duration_secs_listener(_heard)


def by_jax(motion):
    """The same motion, its poses JAX's."""
    return jax.tree.map(jnp.asarray, motion)


def same(found, expected, rel=1e-9):
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        a, b = np.asarray(a), np.asarray(b)
        assert a.dtype == b.dtype
        a, b = a.astype(float), b.astype(float)
        assert np.abs(a - b).max() <= rel * max(np.abs(b).max(), 1e-3)


@pytest.fixture(scope="module")
def wishbone():
    return nc.library.double_wishbone().compile()


@pytest.fixture(scope="module")
def bump(wishbone):
    z = np.linspace(-40.0, 40.0, 5) + float(wishbone["wheel_centre"][2])
    return nc.sweep(wishbone, {"wheel_centre.z": z}, hold=["tie_inner.y", "rim.x"], rates={"wheel_centre.z": 30.0})


ASKED = [{}, {"carrier": "knuckle", "steer": "tie_inner.y", "radius": 300.0}, {"axle": "rear", "bump": "tie_inner.y"}]


@pytest.mark.parametrize("options", ASKED, ids=["plain", "screw", "rear"])
def test_a_suspension(bump, options):
    assert isinstance(bump.poses, np.ndarray)
    SEEN.clear()
    found = nc.suspension(bump, **options)
    assert not SEEN
    same(found, nc.suspension(by_jax(bump), **options))


def test_bodies_and_markers(bump):
    looks = [
        lambda m: m["contact"],
        lambda m: m.velocity("contact"),
        lambda m: m.acceleration("contact.z"),
        lambda m: m.orientation("knuckle"),
        lambda m: m.quaternion("knuckle"),
        lambda m: m.angular_velocity("knuckle"),
        lambda m: m.angular_acceleration("knuckle"),
        lambda m: m.screw_axis("knuckle"),
        lambda m: m.failures,
    ]
    SEEN.clear()
    found = [look(bump) for look in looks]
    assert not SEEN
    same(found, jax.jit(lambda motion: [look(motion) for look in looks])(by_jax(bump)))
    assert SEEN  # what is compiled is seen


def test_poses_closed_over_by_traced_code(bump):
    pose = bump.pose(1)
    looks = [lambda: nc.suspension(pose).toe, lambda: pose["contact"], lambda: pose.quaternion("knuckle")]
    found = jax.jit(lambda x: [x * look() for look in looks])(2.0)
    same(found, [2.0 * np.asarray(look()) for look in looks])


def test_a_planar_body_and_its_marker():
    s = nc.library.four_bar().compile()
    motion = nc.sweep(s, {"phi": np.linspace(0.3, 6.0, 11)}, rates={"phi": 2.0})
    assert isinstance(motion.poses, np.ndarray)
    body = next(b.name for b in s.topology.bodies if len(b.points) > 1)
    SEEN.clear()
    found = [motion.orientation(body), motion.angular_velocity(body), motion.angular_acceleration(body)]
    assert not SEEN
    read = jax.jit(lambda m: [m.orientation(body), m.angular_velocity(body), m.angular_acceleration(body)])
    same(found, read(by_jax(motion)))


# -- sensitivities --------------------------------------------------------------------------------------------------


def _named(name, motion):
    return motion[name]


def agrees(motion, outputs, some=None, read=None, **options):
    """Sensitivities by the host and by JAX, which are the same; the former. Of `some` only where JAX's are by `read`.

    JAX differentiates a function that reads the names. `read` returns numbers side by side: what they share is traced
    and compiled once.
    """
    assert isinstance(motion.poses, np.ndarray)
    SEEN.clear()
    found = nc.sensitivity(motion, outputs, **options)
    assert not SEEN
    named = {outputs: outputs} if isinstance(outputs, str) else outputs
    functions = {label: functools.partial(_named, name) for label, name in named.items()} if read is None else {}
    expected = nc.sensitivity(by_jax(motion), functions or {"some": read}, **options)
    assert list(found.derivatives) == list(found.values)
    assert (found.exists == expected.exists).all()
    if read is None:
        assert set(found.values) == set(expected.values)
        same(dict(found.derivatives), dict(expected.derivatives))
        same(dict(found.values), dict(expected.values))
    for k, name in enumerate(some or ()):
        same(found.derivatives[name], expected["some"][..., k, :])
        same(found.values[name], expected.values["some"][..., k])
    return found


def test_sensitivity_of_a_four_bar_with_given_lengths_and_a_marker():
    m = nc.Mechanism("four-bar", length_unit="mm")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    for name, place in {"B": (0.6, 0.8), "C": (3.3, 2.9), "P": (1.8, 3.0)}.items():
        m.point(name, place)
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C", "P"], lengths={("B", "P"): 2.4})
    m.body("rocker", ["C", "D"], lengths={("C", "D"): 3.0})
    m.marker("T", on="coupler", at=(2.0, 3.5))
    m.angle("phi", at="A", to="B")
    m.angle("psi", at="D", to="C")
    s = m.compile()
    motion = nc.solve_position(s, {"phi": np.array([[0.9, 1.4], [2.0, 3.0]])})
    found = agrees(motion, {"point": "P", "angle": "psi", "rider": "T.y", "whole": "T"})
    whole = sum(found["whole", point] for point in (*"ABCDP", "T"))  # the whole drawing is shifted
    assert np.abs(whole - np.eye(2)).max() < 1e-12
    assert found["rider", "T"].shape == (2, 2, 2)
    same(nc.sensitivity(motion.pose((0, 1)), "T")["T"], found["whole"][0, 1])


def _read_reach(top, scale, state, home, markers, offset):
    return scale * norm(Pose(top, markers, state)["C"] - Pose(top, markers, home)["A"]) + offset


def reach(motion, scale=1.0):
    return {"reach": scale * np.linalg.norm(np.asarray(motion["C"]) - np.asarray(motion["A"]), axis=-1) + 3.0}


def test_a_function_that_says_itself_how_it_is_read(monkeypatch):
    """Sensitivities know no function: one with a reading of its own is differentiated by NumPy, with its options."""

    def reading(motion, scale=1.0):
        return PoseReading(_read_reach, (scale,), numbers=(3.0,), names=(("reach", 0),), labels={"D": "pivot"})

    monkeypatch.setattr(reach, "pose_reading", reading, raising=False)
    s = nc.library.four_bar().compile()
    motion = nc.sweep(s, {"phi": np.linspace(0.3, 2.0, 4)})
    SEEN.clear()
    found = nc.sensitivity(motion, functools.partial(reach, scale=2.0))
    assert not SEEN
    ground = s["A"]  # stays where it is
    expected = nc.sensitivity(motion, lambda mo: 2.0 * jnp.linalg.norm(mo["C"] - ground, axis=-1))
    free = [k for k, name in enumerate(found.variables) if name[0] != "A"]
    same(found["reach"][:, free], expected["output"][:, free])
    assert "  pivot  " in found.table()


def _apart(p, v, s, c):
    d = p[1] - p[0]
    return (dot(d, d) - c[0] * c[0],)


def _apart_in_a_loop(p, v, s, c):
    d = p[1] - p[0]
    return (jax.lax.fori_loop(0, 2, lambda i, x: x + d[i] * d[i], 0.0) - c[0] * c[0],)


def _drawn(p, v, s, c):
    return (norm(p[1] - p[0]),)


def _drawn_in_a_loop(p, v, s, c):
    d = p[1] - p[0]
    return (jnp.sqrt(jax.lax.fori_loop(0, 2, lambda i, x: x + d[i] * d[i], 0.0)),)


READ = Kind("apart", _apart, powers=(2,), points=2, constants=("length",), drawn=_drawn)
UNREAD = Kind("apart in a loop", _apart_in_a_loop, powers=(2,), points=2, constants=("length",), drawn=_drawn_in_a_loop)


def test_sensitivity_of_kinds_that_cannot_be_read():
    """Through JAX it is what it is read as, of names and of functions."""
    found = []
    for kind in (READ, UNREAD):
        m = nc.Mechanism("four-bar")
        m.ground("A", (0, 0)), m.ground("D", (4, 0))
        m.point("B", (0.6, 0.8)), m.point("C", (3.3, 2.9))
        m.body("crank", ["A", "B"]), m.body("coupler", ["B", "C"])
        m.constrain("rod", kind, points=["C", "D"])
        m.angle("phi", at="A", to="B")
        motion = nc.sweep(m.compile(), {"phi": np.array([0.9, 1.4])}, rates={"phi": 2.0})
        one = nc.sensitivity(motion, "C"), nc.sensitivity(motion, lambda mo: mo.velocity("C"))
        found.append([dict(x.derivatives) for x in one])
    assert np.abs(found[0][0]["C"][..., -2:]).max() > 0.1
    same(*found)


def test_sensitivity_where_a_changed_design_does_not_assemble():
    s = bennett().compile()
    motion = nc.solve_position(s, {s.topology.scalars[0]: 1.1})
    assert not agrees(motion, s.topology.points[-1], throw=False).exists.all()


def parts(screw, names):
    """Some numbers of a suspension; of the others nothing is compiled."""

    def read(motion):
        found = screw(motion)
        return jnp.stack([getattr(found, name) for name in names], axis=-1)

    return read


@pytest.mark.slow
def test_sensitivity_of_suspensions(bump):
    """Against JAX, with the instantaneous axis of steering, and of a mechanism with more rows than unknowns."""
    screw = functools.partial(nc.suspension, carrier="knuckle", steer="tie_inner.y", radius=300.0)
    some = "toe", "motion_ratio", "instant_centre_height", "drive_support_angle"
    asked = {"wheel": screw, "centre": "wheel_centre"}
    found = agrees(bump, asked, [f"wheel.{k}" for k in some], parts(screw, some))
    assert {"wheel.caster", "centre"} < set(found.derivatives)
    s = nc.library.macpherson().compile()
    motion = nc.sweep(s, {"6.z": np.linspace(250.0, 370.0, 3)}, hold=["10.y", "7.x"])
    found = agrees(motion, {"wheel": nc.suspension, "centre": "6"}, ["wheel.toe"], parts(nc.suspension, ["toe"]))
    assert found.exists.all() and np.abs(found["centre"]).max() > 0.5
