"""Margins from flipping, against the assemblies of `modes`, dead points of `travel`, and central differences."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq
from test_modes import stephenson

import jaxnc as nc

STEP = 1e-6  # of a central difference; its error, of second order, and rounding are below the tolerance
SLOPE = 1e-6


@pytest.fixture(autouse=True)
def cached(tmp_path, monkeypatch):
    """Start sets in a folder of the test's own."""
    monkeypatch.setenv("JAXNC_CACHE", str(tmp_path))


def rocker() -> nc.System:
    """A four-bar whose crank is stopped by dead points at 139.86° and below the line of its pivots."""
    m = nc.Mechanism("rocker")
    m.ground("A", (0, 0)), m.ground("D", (4, 0)), m.point("B", (0, 1)), m.point("C", (3.3, 2.9))
    m.body("crank", ["A", "B"]), m.body("coupler", ["B", "C"])
    m.body("rocker", ["C", "D"], lengths={("C", "D"): 1.0})
    m.angle("phi", at="A", to="B")
    return m.compile()


def nearest(system: nc.System, pose: nc.Motion, phi: float) -> float:
    """How far points move to the nearest other assembly of `modes`."""
    count = system.topology.dim * len(system.topology.points)
    places = np.asarray(nc.modes(system, {"phi": phi}).poses.q)[:, :count] - np.asarray(pose.q)[:count]
    return np.sort(np.linalg.norm(places.reshape(len(places), -1, 2), axis=2).max(axis=1))[1]


def test_a_dyad_flips_into_its_mirror_image():
    system, phi = rocker(), np.radians(np.linspace(0.0, 139.0, 6))
    motion, end = nc.sweep(system, {"phi": phi}), nc.travel(system, "phi").upper
    found = nc.flip_margin(motion)
    for k in range(len(phi)):
        assert float(found.distance[k]) == pytest.approx(nearest(system, motion.pose(k), phi[k]), rel=1e-9)
        rows = nc.system.residual(system, found.other[k])
        assert float(jnp.abs(rows).max()) < 1e-11
    # A dead point is continued to with an error of third order.
    near = nc.flip_margin(nc.sweep(system, {"phi": end - np.array([0.2, 0.1, 0.05, 1e-3])}))
    error = np.abs(np.asarray(near.dead_point) - end)
    assert error[0] < 6e-3 and error[1] < error[0] / 6 and error[2] < error[1] / 6 and error[3] < 1e-8
    np.testing.assert_allclose(near.input, [0.2, 0.1, 0.05, 1e-3], atol=6e-3)
    assert np.isinf(found.input[0]), "nothing says that there is one"


def test_two_dyads_that_flip_together():
    """A six-bar of Watt's kind whose nearest assembly has both of its dyads the other way round."""
    m = nc.Mechanism("Watt II")
    m.ground("A", (0.0, 0.0)), m.ground("D", (3.0, 0.2)), m.ground("G", (5.5, 0.3))
    for name, at in {"B": (0.388, 0.014), "C": (3.399, 0.412), "E": (4.838, 1.89), "F": (8.447, 2.457)}.items():
        m.point(name, at)
    for body in ("AB", "BC", "DCE", "EF", "GF"):
        m.body(body, list(body))
    m.angle("phi", at="A", to="B")
    system = m.compile()
    pose = nc.solve_position(system, {"phi": 0.05})
    found = nc.flip_margin(pose)
    assert float(found.distance) == pytest.approx(nearest(system, pose, 0.05), rel=1e-9)
    q, other = (np.asarray(x)[:14].reshape(7, 2) for x in (pose.q, found.other))
    points = system.topology.points
    for dyad in ("BDC", "EGF"):
        corners = [at[[points.index(p) for p in dyad]] for at in (q, other)]
        one, two = (np.linalg.det(at[1:] - at[0]) for at in corners)
        assert one * two < 0.0, "its triangle is turned over"


def test_a_planar_four_bar_with_hinges_in_space():
    """It has redundant rows, and axes that follow a dyad."""
    system = nc.library.four_bar_in_space().compile()
    name = system.independent[0]
    found, other = nc.flip_margin(nc.solve_position(system, {name: 0.5})), nc.modes(system, {name: 0.5}).poses
    count = 3 * len(system.topology.points)
    apart = np.linalg.norm(np.diff(np.asarray(other.q)[:, :count].reshape(2, -1, 3), axis=0)[0], axis=1).max()
    assert float(found.distance) == pytest.approx(apart, rel=1e-9)


def test_a_crank_that_turns_has_a_distance_and_no_dead_point():
    found = nc.flip_margin(nc.sweep(nc.library.four_bar().compile(), {"phi": np.linspace(0.0, 6.0, 25)}))
    assert np.isfinite(found.distance).all() and float(found.distance.min()) > 0.1
    assert float(jnp.min(found.input)) > 0.7


def test_six_bars_near_their_dead_points():
    """Its block of six unknowns has no closed form: Newton's steps begin where second derivatives say."""
    system = stephenson().compile()
    ends = nc.travel(system, "phi")
    phi = np.array([ends.lower + 0.003, ends.lower + 0.05, ends.upper - 0.05, ends.upper - 0.003])
    motion = nc.sweep(system, {"phi": phi})
    found = nc.flip_margin(motion)
    want = [nearest(system, motion.pose(k), p) for k, p in enumerate(phi)]
    np.testing.assert_allclose(found.distance, want, rtol=1e-8)
    np.testing.assert_allclose(found.input, [0.003, 0.05, 0.05, 0.003], rtol=0.02)


def test_the_way_of_two_inputs_is_right_to_third_order():
    """Of a five-bar, whose joints meet where |BD| is the length of both middle bars."""
    crank, bar = 1.2, 2.6

    def gap(turn):
        return abs(4 + crank * np.exp(1j * turn[1]) - crank * np.exp(1j * turn[0])) - 2 * bar

    at = np.array([brentq(lambda p: gap((p, 1.0)), 1.5, 3.0), 1.0])
    normal = np.array([gap(at + h) - gap(at - h) for h in 1e-6 * np.eye(2)])
    normal /= np.linalg.norm(normal)
    for margin in (0.1, 0.05):
        p, q = at - margin * normal
        b, d = crank * np.exp(1j * p), 4 + crank * np.exp(1j * q)
        c = (b + d) / 2 + 1j * (d - b) / abs(d - b) * np.sqrt(bar**2 - abs(d - b) ** 2 / 4)
        m = nc.Mechanism("five-bar")
        m.ground("A", (0, 0)), m.ground("E", (4, 0))
        for name, z in {"B": b, "C": c, "D": d}.items():
            m.point(name, (z.real, z.imag))
        for body in ("AB", "BC", "CD", "DE"):
            m.body(body, list(body))
        m.angle("p", at="A", to="B"), m.angle("q", at="E", to="D")
        found = nc.flip_margin(nc.sweep(m.compile(), {"p": [p], "q": [q]})).input[0]
        assert abs(float(found) - margin) < 0.3 * margin**3


def test_derivatives_are_exact_and_batches_are_what_each_is():
    system, phi = rocker(), jnp.array([1.2, 1.8, 2.2, 2.6])  # it does not get to the last one

    def margins(c):
        found = nc.flip_margin(nc.sweep(system.replace({"C": c, "D": jnp.array([4.0, 0.1])}), {"phi": phi}))
        way = jnp.where(jnp.isfinite(found.input), found.input, 1.0)
        return jnp.concatenate([found.distance, way])

    def twice(c):
        found = margins(c)
        return found, found

    c, steps = jnp.array([3.3, 2.9]), STEP * jnp.eye(2)
    slopes, value = jax.jit(jax.jacrev(twice, has_aux=True))(c)
    several = jax.jit(jax.vmap(margins))(jnp.concatenate([c[None], c + steps, c - steps]))
    np.testing.assert_allclose(several[0], value, rtol=1e-12)
    for axis in range(2):
        near = (several[1 + axis] - several[3 + axis]) / (2 * STEP)
        np.testing.assert_allclose(slopes[:, axis], near, rtol=SLOPE, atol=SLOPE)
    assert np.isfinite(slopes).all() and value[3] == 0 and (slopes[3] == 0).all()


def test_what_has_no_margin():
    moved = nc.sweep(nc.library.four_bar().compile(), {"phi": np.array([0.1, 0.2])})
    free = dataclasses.replace(moved, driven=(), asked=moved.asked[:, :0])
    with pytest.raises(nc.InputError, match=r"nothing is driven.*sweep"):
        nc.flip_margin(free)
