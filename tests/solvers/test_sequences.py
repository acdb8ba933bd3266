"""Many designs side by side: which of their poses can be reached, against the closed form of the four-bar."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import four_bar_joint

import jaxnc as nc
from jaxnc.library import five_bar

DESIGNS = 24
RNG = np.random.default_rng(3)


@functools.cache
def four_bars():
    """Random four-bars of all kinds: lengths ``(4, D)``, angle of the drawing, side, system."""
    lengths, angle, side = RNG.uniform(0.3, 1.5, (4, 400)), RNG.uniform(-3, 3, 400), RNG.choice([-1, 1], 400)
    far = np.abs(reach(lengths, angle[:, None])[0][:, 0])
    a, b, c, d = lengths
    well = (far < 0.97 * (b + c)) & (far > 1.03 * np.abs(b - c))
    lengths, angle, side = lengths[:, well][:, :DESIGNS], angle[well][:DESIGNS], side[well][:DESIGNS]
    a, b, c, d = lengths
    zero = np.zeros((DESIGNS, 2))
    pivot = np.stack([d, 0 * d], axis=1)
    pin = a[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    joint = np.array([four_bar_joint(*lengths[:3, k], zero[k], pivot[k], angle[k], side[k]) for k in range(DESIGNS)])
    base = nc.library.four_bar(explicit=False).compile()
    system = jax.vmap(lambda b, c, d: base.replace(A=(0.0, 0.0), B=b, C=c, D=d))(pin, joint, pivot)
    return lengths, angle, side, system


def reach(lengths, phi):
    """Distance from the crank pin to the rocker's pivot, ``(D, ...)``, and whether the dyad closes."""
    a, b, c, d = (x[:, None] for x in lengths)
    far = np.sqrt(a * a + d * d - 2 * a * d * np.cos(phi))
    return far, (far < b + c) & (far > np.abs(b - c))


def closed_all_the_way(lengths, start, end):
    """Whether the dyad closes from one angle to another, ``(D,)`` each."""
    return reach(lengths, start[:, None] + np.linspace(0, 1, 3001) * (end - start)[:, None])[1].all(axis=1)


def compare(motion, lengths, side, phi, reached):
    found = np.asarray(motion.converged)
    np.testing.assert_array_equal(found, reached)
    assert 0.2 < reached.mean() < 1.0  # both kinds were there
    pivot = np.stack([lengths[3], 0 * lengths[3]], axis=1)
    at = np.asarray(motion["C"])
    for k, t in np.argwhere(found):
        wanted = four_bar_joint(*lengths[:3, k], np.zeros(2), pivot[k], phi[k, t], side[k])
        np.testing.assert_allclose(at[k, t], wanted, atol=1e-8)  # close to a dead point digits go
    assert np.all(np.isfinite(at))


@jax.jit  # of one number of poses: compiled once
@jax.vmap
def follow(s, u):
    return nc.sweep(s, {"phi": u})


@pytest.mark.parametrize("twice", [False, True])
def test_designs_are_followed_as_far_as_they_close(twice):
    lengths, home, side, system = four_bars()
    total = 37
    way = RNG.uniform(-0.25, 0.5, (DESIGNS, total))
    phi = home[:, None] + np.cumsum(way, axis=1)
    if twice:  # poses that are asked for several times in a row
        phi = np.repeat(phi, 3, axis=1)[:, :total]
        phi[:, 0] = home
    before = np.concatenate([home[:, None], phi[:, :-1]], axis=1)
    closed = np.stack([closed_all_the_way(lengths, before[:, t], phi[:, t]) for t in range(total)], axis=1)
    reached = np.cumprod(closed, axis=1).astype(bool)
    motion = follow(system, phi)
    compare(motion, lengths, side, phi, reached)
    # What is given up early is a part of it, and ends with the last pose that was right.
    if not twice:
        hasty = jax.jit(jax.vmap(lambda s, u: nc.sweep(s, {"phi": u}, repair=False)))(system, phi)
        early = np.asarray(hasty.converged)
        assert not np.any(early & ~reached)
        assert early.sum() >= 0.97 * reached.sum()
        last = np.maximum(early.sum(axis=1) - 1, 0)
        k = np.flatnonzero(early[:, 0] & ~early[:, -1])
        np.testing.assert_array_equal(np.asarray(hasty.q)[k, -1], np.asarray(hasty.q)[k, last[k]])
        np.testing.assert_array_equal(hasty.pose((slice(2, 4), 7)).q, hasty.q[2:4, 7])


def test_scattered_inputs_of_designs_are_reached_from_the_drawing():
    lengths, home, side, system = four_bars()
    phi = home[:, None] + RNG.uniform(-3.1, 3.1, (DESIGNS, 21))
    phi[:, 3] = home

    def one(s, u):
        return nc.solve_position(s, {"phi": u}, throw=False)

    motion = jax.jit(jax.vmap(jax.vmap(one, in_axes=(None, 0))))(system, phi)
    reached = np.stack([closed_all_the_way(lengths, home, phi[:, t]) for t in range(21)], axis=1)
    compare(motion, lengths, side, phi, reached)


def test_without_repair_nothing_is_called_back():
    """So that a program can be exported, or kept by JAX's cache; what the host would have found is TOO_FAR."""
    _, home, _, system = four_bars()
    one, u = jax.tree.map(lambda x: x[0], system), home[0] + np.linspace(0.0, 0.4, 4)

    def lowered(analysis, repair):
        return jax.jit(lambda u: analysis(one, {"phi": u}, repair=repair).q).lower(u).as_text()

    for analysis in (nc.sweep, nc.solve_position):
        assert "callback" in lowered(analysis, True) and "callback" not in lowered(analysis, False)
    far = home[0] + np.linspace(-3.0, 3.0, 21)
    ways = [nc.solve_position(one, {"phi": far}, repair=False)]
    ways.append(jax.jit(lambda u: nc.solve_position(one, {"phi": u}, repair=False))(far))
    known = nc.solve_position(one, {"phi": far})
    for motion in ways:
        status = np.asarray(motion.status)
        assert set(status) <= {0, int(nc.Status.TOO_FAR)} and np.all(np.asarray(known.status)[status == 0] == 0)
        np.testing.assert_allclose(
            np.asarray(motion["C"])[status == 0], np.asarray(known["C"])[status == 0], atol=1e-12
        )
    assert np.any(status == 0) and np.array_equal(*(np.asarray(motion.status) for motion in ways))


def test_sequences_of_two_inputs():
    system = five_bar().compile()
    t = np.linspace(0.0, 1.0, 9)
    ways = RNG.uniform(-0.6, 0.6, (5, 2))
    phi, psi = 1.0 + t * ways[:, :1], 2.0 + t**2 * ways[:, 1:]
    motion = jax.jit(jax.vmap(lambda phi, psi: nc.sweep(system, {"phi": phi, "psi": psi})))(phi, psi)
    assert motion.converged.all()
    b, d = (np.stack([x + 0.1 * np.cos(u), 0.1 * np.sin(u)], axis=-1) for x, u in ((0.0, phi), (0.25, psi)))
    joint = np.vectorize(lambda b, d: four_bar_joint(0.0, 0.3, 0.3, b, d, 0.0, 1.0), signature="(2),(2)->(2)")
    np.testing.assert_allclose(motion["C"], joint(b, d), atol=1e-12)


def test_derivatives_of_very_many_lanes():
    """Of lanes that do not fill their chunks, some of which are not reached, against those of the closed form."""
    lengths, home, side, system = four_bars()
    closes = reach(lengths, home[:, None] + np.linspace(-3.0, 3.0, 99))[1].mean(axis=1)
    k = int(np.argmin(np.abs(closes - 0.6)))
    one = jax.tree.map(lambda x: x[k], system)
    phi = home[k] + np.linspace(-3.0, 3.0, 4201)
    goal = jnp.array([0.3, 0.2])

    def cost(place, ok):
        way = jnp.where(ok[:, None], place - goal, 0.0)
        return jnp.sum(jnp.sin(way) * way)

    def ours(s, u):
        motion = nc.solve_position(s, {"phi": u}, throw=False)
        return cost(motion["C"], motion.converged), motion.converged

    (_, ok), found = jax.jit(jax.value_and_grad(ours, argnums=(0, 1), has_aux=True))(one, phi)
    assert 0.1 < np.mean(ok) < 1.0
    names = one.topology.points
    u = np.where(ok, phi, home[k])

    def closed(points, u):
        at = {n: points[i] for i, n in enumerate(names)}
        a, b, c = (jnp.linalg.norm(at[q] - at[p]) for p, q in ("AB", "BC", "CD"))
        place = jax.vmap(lambda u: four_bar_joint(a, b, c, at["A"], at["D"], u, side[k]))(u)
        return cost(place, ok)

    wanted = jax.jit(jax.grad(closed, argnums=(0, 1)))(one.parameters.points, u)
    largest = np.max(np.abs(wanted[0]))  # near a dead point: single ones are differences of such
    np.testing.assert_allclose(found[0].parameters.points, wanted[0], atol=1e-9 * largest)
    np.testing.assert_allclose(found[1], np.where(ok, wanted[1], 0.0), rtol=1e-6, atol=1e-9)


def test_markers_and_single_poses_of_several_designs():
    mechanism = nc.library.four_bar(explicit=False)
    mechanism.marker("E", on="coupler", at=(0.05, 0.12))
    one = mechanism.compile()
    other = one.replace(E=(0.02, 0.15))
    motions = [nc.sweep(s, {"phi": 1.0 + 0.1 * np.arange(3)}, rates={"phi": 2.0}) for s in (one, other)]
    both = jax.tree.map(lambda *x: jnp.stack(x), *motions)
    for k, motion in enumerate(motions):
        for found, wanted in (
            (both["E"][k], motion["E"]),
            (both["E.y"][k], motion["E.y"]),
            (both.velocity("E")[k], motion.velocity("E")),
            (both.pose(k)["E"], motion["E"]),
            (both.pose((k, 1))["E"], motion["E"][1]),
        ):
            np.testing.assert_allclose(found, wanted, rtol=1e-14)
