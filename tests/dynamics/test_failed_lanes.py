"""Lanes that fail hold finite numbers and pass no derivative on: neither of their own nor to what all lanes share."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc

TIMES = np.linspace(0.0, 0.1, 3)
PLACES = jnp.array([[0.0, 0.1], [0.0, 0.0], [0.01, 0.11]])  # in the second the crank has no length


@pytest.fixture(scope="module")
def four_bar():
    m = nc.Mechanism("four-bar")
    m.ground("A", (0, 0)), m.ground("D", (0.4, 0)), m.point("B", (0, 0.1)), m.point("C", (0.33, 0.29))
    m.body("crank", ["A", "B"], mass=0.5), m.body("coupler", ["B", "C"], mass=1.2), m.body("rocker", ["C", "D"], mass=1)
    m.angle("phi", at="A", to="B")
    m.gravity = (0, -9.81)
    m.spring("return", "B", "D", stiffness=60.0)
    return m.compile()


def effort(system):
    motion = nc.motion(system, {"phi": lambda t: 1.5 + t}, TIMES)
    return jnp.sum(nc.inverse_dynamics(motion.system, motion)["phi"] ** 2), motion.status[-1]


def end(system):
    run = nc.simulate(system, TIMES, method="rk4", step=0.01, rates={"phi": 1.0})
    return jnp.sum(run["C"][-1]), run.status[-1]


def rest(system):
    found = nc.equilibrium(system)
    return jnp.sum(found["C"]), found.motion.status


@pytest.mark.parametrize("measure", [effort, end, rest])
def test_a_lane_without_length_spoils_no_gradient(four_bar, measure):
    def total(mass, places):
        def one(place):
            return measure(four_bar.replace({"B": place, "coupler.mass": mass}))

        value, status = jax.vmap(one)(places)
        return jnp.sum(jnp.where(status == 0, value, 0.0)), (value, status)

    whole = jax.jit(jax.value_and_grad(total, (0, 1), has_aux=True))
    (_, (value, status)), (by_mass, by_place) = whole(1.2, PLACES)
    assert np.isfinite(value).all() and (np.asarray(status) != 0).tolist() == [False, True, False]
    assert not by_place[1].any() and np.isfinite(by_place).all()
    h = 1e-4
    slope = (whole(1.2 + h, PLACES)[0][0] - whole(1.2 - h, PLACES)[0][0]) / (2 * h)
    np.testing.assert_allclose(by_mass, slope, rtol=1e-5)


@pytest.mark.parametrize("ask", [lambda s: nc.simulate(s, TIMES, throw=False), nc.equilibrium])
def test_a_known_body_without_length_is_named(four_bar, ask):
    with pytest.raises(nc.InputError, match="'crank' has no length"):
        ask(four_bar.replace({"B": (0.0, 0.0)}))
