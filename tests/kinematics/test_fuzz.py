"""Random four-bars, also next to change points and through dead points, against circle intersections."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc

POSES = 17


def intersection(a, ra, b, rb, side):
    d = b - a
    span = np.hypot(*d)
    along = (ra**2 - rb**2 + span**2) / (2 * span)
    e = d / span
    return a + along * e + side * np.sqrt(max(ra**2 - along**2, 0.0)) * np.array([-e[1], e[0]])


def drawing(a, b, c, d, phi, side):
    B = a * np.array([np.cos(phi), np.sin(phi)])
    D = np.array([d, 0.0])
    return {"A": np.zeros(2), "D": D, "B": B, "C": intersection(B, b, D, c, side)}


@pytest.fixture(scope="module")
def base():
    m = nc.Mechanism("random four-bar")
    for name, at in {"A": (0, 0), "D": (4, 0)}.items():
        m.ground(name, at)
    for name, at in {"B": (0, 1), "C": (3.3, 2.9)}.items():
        m.point(name, at)
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C"])
    m.body("rocker", ["C", "D"])
    m.angle("phi", at="A", to="B")
    return m.compile()


def reach(a, b, c, d, phi):
    span = np.sqrt(a * a + d * d - 2 * a * d * np.cos(phi))
    return (span < b + c) & (span > abs(b - c))


def cases(count):
    rng = np.random.default_rng(8)
    while count:
        kind = rng.integers(5)
        a, b, c, d = rng.uniform(0.3, 3, 4)
        if kind >= 3:  # a Grashof crank whose dead points are just missed, by a gap of 1e-1 … 1e-8
            gap = 10.0 ** -rng.uniform(1, 8)
            a, d = rng.uniform(0.3, 1), rng.uniform(1.2, 3)
            share = rng.uniform(0.3, 0.7)
            b, c = (a + d + gap) * share, (a + d + gap) * (1 - share)
            if kind == 4:
                c = rng.uniform(0.5, 3)
                b = c + (d - a - gap)
        phi, side = rng.uniform(-3, 3), rng.choice([-1.0, 1.0])
        if not reach(a, b, c, d, phi):
            continue
        way = rng.choice([-1, 1]) * rng.uniform(1, 40)
        values = (
            np.linspace(phi, phi + way, POSES),
            phi + np.cumsum(rng.uniform(-2, 2, POSES)),
            phi + 2 * np.pi * np.arange(POSES) / 3,
        )[rng.integers(3)]
        count -= 1
        yield (a, b, c, d), phi, side, values


def test_no_wrong_branch_and_no_early_stop(base):
    """Coarse, far and zig-zag sweeps: exact on the drawn branch up to the first dead point, and no further."""
    run = jax.jit(lambda s, u: (lambda mo: (mo["B"], mo["C"], mo.status))(nc.sweep(s, {"phi": u})))
    turned = 0
    for (a, b, c, d), phi, side, values in cases(125):
        B, C, status = (np.asarray(x) for x in run(base.replace(drawing(a, b, c, d, phi, side)), values))
        found = int(np.argmax(status != 0)) if (status != 0).any() else POSES
        path, last = np.concatenate([[phi], values]), POSES
        for i in range(POSES):
            if not reach(a, b, c, d, np.linspace(path[i], path[i + 1], 2001)).all():
                last = i
                break
        assert found == last, (a, b, c, d, phi, side, values)
        for i in range(found):
            want = intersection(B[i], b, np.array([d, 0.0]), c, side)
            assert np.abs(want - C[i]).max() < 1e-7, (a, b, c, d, phi, side, values, i)
        turned += last == POSES
    assert 30 < turned < 120, "both kinds of sweeps are tried"


def test_lanes_and_single_poses_next_to_a_change_point(base):
    system = base.replace(drawing(1, 2.5, 2.52, 4, 1.0, 1.0))
    u = np.linspace(1.0, 1.0 + 2 * np.pi, 73)
    mo = nc.solve_position(system, {"phi": u})
    assert bool(jnp.all(mo.converged))
    want = [intersection(B, 2.5, np.array([4.0, 0.0]), 2.52, 1.0) for B in np.asarray(mo["B"])]
    np.testing.assert_allclose(mo["C"], want, atol=1e-11)


def test_first_value_on_the_far_side_of_half_a_turn(base):
    """A rocker drawn at -2, swept from 2.17: the nearest count of turns leads through its limit, the other not."""
    system = base.replace(drawing(1, 1.2, 1.5, 2, -2.0, 1.0))
    limits = nc.travel(system, "phi")
    u = np.linspace(2.17, -2.17, 30)
    for analysis in (nc.sweep, nc.solve_position):
        assert bool(jnp.all(analysis(system, {"phi": u}).converged)), analysis
    assert int(nc.solve_position(system, {"phi": 2.17}).status) == 0
    # From limit to limit: every pose in between is found; at the limits themselves the input is singular.
    whole = nc.sweep(system, {"phi": np.linspace(limits.lower, limits.upper, 101)})
    assert bool(jnp.all(whole.converged[1:-1])), np.asarray(whole.status)


def test_diagnosis_of_a_pose_that_exists_but_is_not_reached(base):
    system = base.replace(drawing(1, 0.9, 1.0, 2.0, 0.9, 1.0))
    end = nc.travel(system, "phi")
    other = -0.5 * (end.upper + abs(end.lower)) if end.lower > 0 else None
    if other is None:
        other = end.upper + 0.3
    found = nc.diagnose(system, {"phi": other})
    if found.assembles:
        assert not found.reachable and not found.remedies and "not reached from the drawing" in str(found)
    else:
        assert found.remedies


def geared():
    m = nc.Mechanism("geared shaft")
    m.ground("O", (0, 0))
    m.ground("Q", (3, 0))
    m.point("A", (1, 0))
    m.point("B", (5, 0))
    m.body("a", ["O", "A"])
    m.body("b", ["Q", "B"])
    m.angle("al", at="O", to="A")
    m.angle("be", at="Q", to="B")
    m.gear("g", "al", "be", radii=(1, 2))
    m.angle("shaft", at="O", to="A")
    return m.compile()


def test_turns_count_where_a_gear_counts_them():
    system = geared()
    for name in ("shaft", "al"):
        assert float(nc.solve_position(system, {name: 6.0})["be"]) == pytest.approx(-3.0, abs=1e-12)
        down = nc.sweep(system, {name: np.linspace(20.0, 0.0, 30)})
        np.testing.assert_allclose(down["be"], -np.linspace(20.0, 0.0, 30) / 2, atol=1e-11)


@pytest.mark.parametrize("name", ["gear_pair", "peaucellier_lipkin"])
def test_reverse_gradients_of_library_mechanisms(name):
    """Forward and reverse agree; of redundant rows see test_closed.py."""
    system = getattr(nc.library, name)().compile()
    value = 0.3 if name != "peaucellier_lipkin" else 0.45

    def cost(s):
        return jnp.sum(jnp.sin(3 * nc.solve_position(s, {"phi": value}, rates={"phi": 1.0}).q))

    tangent = jax.tree.map(lambda x: jnp.cos(jnp.arange(x.size, dtype=float)).reshape(x.shape), system)

    def both(s, t):
        return jax.grad(cost)(s), jax.jvp(cost, (s,), (t,))[1]

    gradient, forward = nc.jit(both)(system, tangent)
    backward = sum(jnp.vdot(x, y) for x, y in zip(jax.tree.leaves(gradient), jax.tree.leaves(tangent), strict=True))
    assert float(backward) == pytest.approx(float(forward), rel=1e-10, abs=1e-13)
    assert all(bool(jnp.all(jnp.isfinite(x))) for x in jax.tree.leaves(gradient))


def _cam(p, v, s, c):
    x, y = p[0][0], p[0][1]
    return (y - jnp.where(x > 0, jnp.sqrt(jnp.abs(x)), -jnp.sqrt(jnp.abs(x))),)


CAM = nc.constraints.Kind("root cam", _cam, rows=("profile",), powers=(1,), points=1)


def test_a_pose_without_derivatives_leaves_the_gradient_finite():
    """At x = 0 the profile is vertical: that pose has no derivative, and its neighbours keep theirs."""
    m = nc.Mechanism("cam")
    m.point("F", (1.0, 1.0))
    m.constrain("cam", CAM, points=["F"])
    system = m.compile()
    x = jnp.linspace(1, -1, 21)
    mo = nc.sweep(system, {"F.x": x})
    gradient = jax.grad(lambda x: jnp.sum(nc.sweep(system, {"F.x": x})["F"][:, 1]))(x)
    assert bool(jnp.all(jnp.isfinite(gradient)))
    good = np.asarray(mo.converged)
    want = 0.5 / np.sqrt(np.abs(np.asarray(x)) + 1e-300)
    np.testing.assert_allclose(np.asarray(gradient)[good], want[good], rtol=1e-9)
    assert good[:10].all()
