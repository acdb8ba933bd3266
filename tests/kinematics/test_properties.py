"""Properties that hold for any dimensions: drawn by hypothesis on fixed topologies, so that nothing recompiles."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from mechanisms import four_bar, shaper, turn

import jaxnc as nc

FAST = settings(
    max_examples=12,
    deadline=None,
    derandomize=True,
    phases=[Phase.explicit, Phase.generate],  # shrinking costs minutes here and teaches little
    suppress_health_check=list(HealthCheck),
)
numbers = st.floats(-1.0, 1.0, allow_nan=False)
U = turn(25)


residual = jax.jit(nc.system.residual)  # compiled once for each mechanism


@functools.cache
def swept(make):
    """As it is drawn: the same in every example."""
    return nc.sweep(make(), {"phi": U})


def moved(system, angle, shift, scale):
    """The same mechanism turned, shifted and scaled as a whole; every explicit dimension of these is a length."""
    c, s = np.cos(angle), np.sin(angle)
    turn_matrix = np.array([[c, -s], [s, c]])

    def place(x):
        return scale * (np.asarray(x) @ turn_matrix.T) + shift

    par = system.parameters
    return nc.System(
        system.topology,
        nc.system.Parameters(
            jnp.asarray(place(par.points)), par.vectors, jnp.asarray(place(par.markers)), par.dimensions * scale
        ),
        system.degrees_of_freedom,
    ), place


def random_four_bar(a, b, c, d):
    """Crank-rockers of all proportions: Grashof's condition written out, crank the shortest."""
    s, u, v, w = 0.02 + 0.02 * abs(a), 0.01 + 0.1 * abs(b), 0.01 + 0.1 * abs(c), 0.01 + 0.1 * abs(d)
    crank, coupler, rocker, ground = s, s + v + w, s + u + w, s + u + v
    phi = 0.7
    A = np.array([crank * np.cos(phi), crank * np.sin(phi)])
    span = np.linalg.norm(np.array([ground, 0]) - A)
    along = (coupler**2 - rocker**2 + span**2) / (2 * span**2)
    across = np.sqrt(coupler**2 / span**2 - along**2)
    e = np.array([ground, 0]) - A
    B = A + along * e + across * np.array([-e[1], e[0]])
    values = {
        "crank.O2-A": crank,
        "coupler.A-B": coupler,
        "rocker.O4-B": rocker,
        "O4": (ground, 0.0),
        "A": A,
        "B": B,
    }
    return four_bar().replace(values), (crank, coupler, rocker, ground)


@FAST
@given(numbers, numbers, numbers, numbers)
def test_rigid_motions_and_scaling(angle, x, y, log_scale):
    scale = 10.0**log_scale
    for make in (four_bar, shaper):
        system = make()
        if make is shaper:
            angle = 0.0  # its ram slides along the x axis
        other, place = moved(system, 3 * angle, np.array([x, y]), scale)
        shift = 3 * angle
        a = swept(make)
        b = nc.sweep(other, {"phi": U + shift})
        assert bool(jnp.all(a.converged & b.converged))
        for name in system.topology.points:
            np.testing.assert_allclose(b[name], place(a[name]), atol=1e-12 * (scale + 1))
        # Off the solution: rigid motions turn the rows of vector equations but leave their size, scaling scales it.
        q = np.asarray(a.q)[3] + 0.01 * np.cos(np.arange(a.q.shape[1]))
        points = len(system.topology.points)
        new = np.concatenate([place(q[: 2 * points].reshape(-1, 2)).reshape(-1), q[2 * points :]])
        for k, name in enumerate(system.topology.scalars):
            value = q[2 * points + k]
            new[2 * points + k] = value * scale if name == "slide" else value + shift
        r, s = (np.asarray(residual(*x)) for x in ((system, q), (other, new)))
        np.testing.assert_allclose(np.sum(s**2), np.sum(r**2) * scale**2, rtol=1e-9)


@FAST
@given(numbers, numbers, numbers, numbers)
def test_crank_rockers_come_round_to_the_same_branch(a, b, c, d):
    system, (crank, coupler, rocker, ground) = random_four_bar(a, b, c, d)
    mo = nc.sweep(system, {"phi": U}, rates={"phi": 1.0})
    assert bool(jnp.all(mo.converged))
    np.testing.assert_allclose(mo["B"][0], mo["B"][-1], atol=1e-12)
    A = crank * np.stack([np.cos(U), np.sin(U)], -1)
    B, O4 = np.asarray(mo["B"]), np.array([ground, 0.0])
    side = (O4 - A)[:, 0] * (B - A)[:, 1] - (O4 - A)[:, 1] * (B - A)[:, 0]
    assert np.all(side > 0), "left of the diagonal all the way round"
    np.testing.assert_allclose(np.linalg.norm(B - A, axis=1), coupler, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(B - O4, axis=1), rocker, rtol=1e-12)
    assert nc.kinematics.grashof_type(ground, crank, coupler, rocker).type in ("crank-rocker", "change-point")


@FAST
@given(numbers, numbers, numbers, numbers)
def test_velocity_is_the_difference_of_positions(a, b, c, d):
    system, (_, coupler, _, _) = random_four_bar(a, b, c, d)
    h = 1e-4
    u = np.repeat(np.linspace(0.1, 6.0, 5), 5) + np.tile([-2 * h, -h, 0.0, h, 2 * h], 5)
    mo = nc.sweep(system, {"phi": u}, rates={"phi": 1.0})
    B = np.asarray(mo["B"]).reshape(5, 5, 2)
    first = (B[:, 0] - 8 * B[:, 1] + 8 * B[:, 3] - B[:, 4]) / (12 * h)
    V = np.asarray(mo.velocity("B")).reshape(5, 5, 2)
    second = (V[:, 0] - 8 * V[:, 1] + 8 * V[:, 3] - V[:, 4]) / (12 * h)
    size = np.abs(V).max() + coupler
    np.testing.assert_allclose(V[:, 2], first, atol=1e-8 * size)
    np.testing.assert_allclose(
        np.asarray(mo.acceleration("B")).reshape(5, 5, 2)[:, 2], second, atol=1e-6 * (np.abs(second).max() + size)
    )


def test_names_and_order_do_not_matter():
    """The same mechanism renamed, its points permuted and its bodies listed backwards, moves the same."""
    base = {"O2": (0, 0), "O4": (4, 0), "A": (0.6, 0.8), "B": (3.3, 2.9), "P": (1.8, 2.6)}

    def build(names, order, flip):
        m = nc.Mechanism("permuted")
        for key in order:
            (m.ground if key.startswith("O") else m.point)(names[key], base[key])
        bodies = [["O2", "A"], ["A", "B", "P"], ["O4", "B"]]
        for k, body in enumerate(bodies[::-1] if flip else bodies):
            m.body(f"b{k}", [names[p] for p in (body[::-1] if flip else body)])
        m.angle("phi", at=names["O2"], to=names["A"])
        return m.compile()

    plain = build({k: k for k in base}, list(base), False)
    renamed = {"O2": "zero", "O4": "far", "A": "k1", "B": "k2", "P": "trace"}
    other = build(renamed, ["P", "B", "O4", "A", "O2"], True)
    a, b = nc.sweep(plain, {"phi": U}), nc.sweep(other, {"phi": U})
    for key, name in renamed.items():
        np.testing.assert_allclose(a[key], b[name], atol=1e-12)


@pytest.mark.slow
def test_thousand_random_crank_rockers_on_the_right_branch():
    """Screening as synthesis does it: every lane of every design converged and on the branch it was drawn on."""
    rng = np.random.default_rng(5)
    base = four_bar()
    systems = [random_four_bar(*rng.uniform(-1, 1, 4))[0] for _ in range(300)]
    batch = jax.tree.map(lambda *x: jnp.stack(x), *systems)
    u = turn(73)
    mo = jax.jit(jax.vmap(lambda s: nc.sweep(s, {"phi": u})))(batch)
    assert bool(jnp.all(mo.converged))
    k = {n: 2 * i for i, n in enumerate(base.topology.points)}
    A, B, D = (np.asarray(mo.q[..., k[n] : k[n] + 2]) for n in ("A", "B", "O4"))
    side = (D - A)[..., 0] * (B - A)[..., 1] - (D - A)[..., 1] * (B - A)[..., 0]
    assert np.all(side > 0)
