"""What is read off poses that the host has found: the same numbers as by JAX, and nothing is compiled for them."""

import jax
import jax.monitoring
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc

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
    same(found, [look(by_jax(bump)) for look in looks])
    assert SEEN  # what is compiled is seen


def test_a_planar_body_and_its_marker():
    s = nc.library.four_bar().compile()
    motion = nc.sweep(s, {"phi": np.linspace(0.3, 6.0, 11)}, rates={"phi": 2.0})
    assert isinstance(motion.poses, np.ndarray)
    body = next(b.name for b in s.topology.bodies if len(b.points) > 1)
    SEEN.clear()
    found = [motion.orientation(body), motion.angular_velocity(body), motion.angular_acceleration(body)]
    assert not SEEN
    m = by_jax(motion)
    same(found, [m.orientation(body), m.angular_velocity(body), m.angular_acceleration(body)])
