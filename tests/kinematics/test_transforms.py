"""Every order of JAX's transformations gives the same numbers, and nothing is traced twice without need."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import four_bar, four_bar_mechanism, slider_crank, trace_counter

import jaxnc as nc

U = np.linspace(0.2, 5.9, 17)


def designs(system, count=3):
    """A batch of designs: every leaf with a leading axis."""
    return jax.tree.map(lambda x: jax.device_put(np.stack([x * (1 + 0.01 * k) for k in range(count)])), on_host(system))


def on_host(tree):
    """Of NumPy arrays: JAX would compile a program for every operation and shape."""
    return jax.tree.map(np.asarray, tree)


def one(batch, k):
    return jax.tree.map(lambda x: jax.device_put(x[k]), on_host(batch))


def path(s, u):
    return nc.sweep(s, {"phi": u})["P"]


def same(x, y, tolerance=1e-13):
    for a, b in zip(jax.tree.leaves(x), jax.tree.leaves(y), strict=True):
        scale = 1.0 + np.max(np.abs(b), initial=0.0)
        np.testing.assert_allclose(a, b, atol=tolerance * scale, rtol=0)


def test_jit_and_vmap_are_the_loop():
    system = four_bar()
    batch = designs(system)
    loop = jnp.stack([path(one(batch, k), U) for k in range(3)])
    same(jax.jit(path)(system, U), path(system, U))
    same(jax.jit(jax.vmap(path, in_axes=(0, None)))(batch, U), loop)
    inputs = jnp.stack([U, U + 0.1])
    both = jax.vmap(jax.vmap(path, in_axes=(None, 0)), in_axes=(0, None))(batch, inputs)
    other = jax.vmap(jax.vmap(path, in_axes=(0, None)), in_axes=(None, 0))(batch, inputs)
    same(both, jnp.swapaxes(other, 0, 1))
    same(both[:, 0], loop)


def test_nothing_is_traced_twice_without_need(monkeypatch):
    seen = trace_counter(monkeypatch)
    system = four_bar_mechanism().compile()
    for value in (1, np.float32(1.0), np.float64(1.0), jnp.float32(1.0), jnp.asarray(1.0), 2.0, True):
        nc.solve_position(system, {"phi": value})
    nc.solve_position(system.replace({"rocker.O4-B": 0.081}), {"phi": np.zeros(4)})
    assert not seen, "few poses are found on the host"
    swept = jax.jit(lambda s, u: nc.sweep(s, {"phi": u})["P"])
    u = jnp.linspace(0.5, 1.0, 5)
    swept(system, u)
    first = len(seen)
    assert first > 0, "the counter counts"
    swept(system.replace({"rocker.O4-B": 0.081}), u + 0.1)
    swept(four_bar_mechanism().compile(), u)
    assert len(seen) == first, "changing values or an equal rebuild retraced"
    jax.jit(lambda s, u: nc.sweep(s, {"phi": u})["B"])(system, u)
    assert len(seen) == first, "another program traced again what it has in common with the first"


def test_what_is_remembered_of_a_system_inside_a_trace_outlives_it():
    """The first to derive its equations is traced code that closes over it."""
    system = four_bar_mechanism().compile()
    inside = jax.jit(lambda u: nc.solve_position(system, {"phi": u})["P"])(0.5)
    np.testing.assert_allclose(nc.solve_position(system, {"phi": 0.5})["P"], inside, rtol=0, atol=1e-14)


def test_failed_lane_in_a_batch_of_designs_is_data():
    system = four_bar()
    batch = designs(system)
    dims = np.array(batch.parameters.dimensions)
    k = system.topology.dimensions.index("rocker.O4-B")
    dims[1, k] = 0.001  # does not assemble at any input
    batch = nc.System(
        batch.topology,
        dataclasses.replace(batch.parameters, dimensions=jnp.asarray(dims)),
        batch.degrees_of_freedom,
    )

    def cost(s):
        mo = nc.sweep(s, {"phi": U})
        return jnp.sum(mo["P"] ** 2), mo.failures

    (_, failures), gradient = jax.vmap(jax.value_and_grad(cost, has_aux=True))(batch)
    assert failures.tolist()[0] == 0 and failures.tolist()[1] > 0
    for leaf in jax.tree.leaves(gradient):
        assert np.all(np.isfinite(leaf))
    alone = jax.grad(lambda s: cost(s)[0])(one(batch, 0))
    same(one(gradient, 0), alone)


def test_traced_calls_return_statuses_and_eager_ones_raise():
    system = slider_crank()
    with pytest.raises(nc.AssemblyError, match="slider-crank"):
        nc.solve_position(system, {"S.x": 5.0})
    assert int(jax.jit(lambda x: nc.solve_position(system, {"S.x": x}).status)(5.0)) == nc.Status.DID_NOT_ASSEMBLE
    quiet = nc.solve_position(system, {"S.x": 5.0}, throw=False)
    with pytest.raises(nc.AssemblyError, match="1 of 1 poses failed"):
        quiet.check()


def test_derivatives_of_many_mapped_poses_are_those_of_a_batch():
    """More lanes than go together: the derivative is taken chunk by chunk."""
    system, u = nc.library.four_bar().compile(), np.linspace(0.0, 6.0, 4999)

    def one(s, u):
        return jnp.sum(nc.solve_position(s, {"phi": u})["C"] ** 2)

    def mapped(s, u):
        return jnp.mean(jax.vmap(one, (None, 0))(s, u))

    def batch(s, u):
        return jnp.mean(jnp.sum(nc.solve_position(s, {"phi": u})["C"] ** 2, axis=-1))

    points = system.parameters.points
    way = jax.tree.map(lambda x: jnp.ones_like(x) if x is points else jnp.zeros_like(x), system)
    found = []
    for f in (mapped, batch):
        gradient = jax.grad(f, (0, 1))
        every = jax.jit(lambda s, u, g=gradient: jax.jvp(lambda s: g(s, u), (s,), (way,)))  # both in one program
        first, second = every(system, jnp.asarray(u))
        found.append([first[0].parameters.points, first[1], second[0].parameters.points, second[1]])
    for a, b in zip(*found, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12 * float(np.abs(b).max()))
        assert np.abs(a).max() > 0.0


# -- several designs in one -------------------------------------------------------------------------------------------


def test_singular_values_of_several_designs_are_those_of_each():
    system = nc.library.four_bar().compile()
    designs = jax.tree.map(lambda x: jnp.stack([x, 1.1 * x, 0.9 * x]), system)
    values = np.linspace(0.3, 1.5, 4)
    motions = jax.vmap(lambda design: nc.sweep(design, {"phi": values}))(designs)
    own = [motions.pose(k).singular_values() for k in range(3)]
    np.testing.assert_allclose(motions.singular_values(), own, rtol=1e-12)
    assert nc.solve_position(system, {"phi": values[:0]}).singular_values().shape[0] == 0


def test_several_designs_are_refused_where_one_is_meant():
    m = nc.Mechanism("pendulum")
    m.ground("A", (0, 0))
    m.point("B", (1, 0))
    m.body("rod", ["A", "B"], mass=2.0)
    m.angle("phi", at="A", to="B")
    system = m.compile()
    designs = jax.tree.map(lambda x: jnp.stack([x, 1.1 * x]), system)
    motions = jax.vmap(lambda design: nc.sweep(design, {"phi": [0.1, 0.2]}, rates={"phi": 1.0}))(designs)
    run = jax.vmap(lambda design: nc.simulate(design, np.linspace(0, 0.1, 3), method="rk4", step=0.01))(designs)
    for ask in (
        lambda: nc.solve_position(designs, {"phi": 0.1}),
        lambda: nc.sweep(designs, {"phi": [0.1, 0.2]}),
        lambda: nc.travel(designs, "B.x"),
        lambda: nc.equilibrium(designs),
        lambda: nc.dynamics.kinetic_energy(motions),
        lambda: nc.reactions(motions),
        lambda: nc.reactions(run),
        lambda: run.report(),
    ):
        with pytest.raises(nc.InputError, match=r"2 designs in one.*jax.vmap"):
            ask()


def crank_rocker(turn):
    m = nc.Mechanism("crank-rocker")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    m.point("B", (np.cos(turn), np.sin(turn)))
    m.point("C", (3.3, 2.9))
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C"])
    m.body("rocker", ["C", "D"])
    return m.compile()


def test_what_failed_has_no_derivative_anywhere():
    """Of a pose that the crank does not reach."""
    system = crank_rocker(0.5)

    def numbers(design):
        motion = nc.sweep(design, {"B.x": np.array([0.8, 2.0])}, throw=False)
        own = motion.singular_values()[:, -1] + nc.transmission_angle(motion, "B", "C", "D")
        return jnp.where(motion.status != 0, own, 0.0).sum()

    assert (np.asarray(nc.sweep(system, {"B.x": np.array([0.8, 2.0])}, throw=False).status) != 0).tolist() == [
        False,
        True,
    ]
    assert np.all(np.asarray(jax.grad(numbers)(system).parameters.points) == 0.0)


def test_a_drawing_at_a_dead_point_has_limits():
    found = nc.travel(crank_rocker(0.0), "B.x")
    assert (found.lower, found.upper) == pytest.approx((-1.0, 1.0))
    assert {point.kind for point in found.dead_points} == {"minimum", "maximum"}
