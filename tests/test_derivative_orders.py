"""Derivatives of every order through every transformation: those that JAX might lose where it splits a loop.

A rule of `jax.custom_jvp` is lost in reverse over reverse through `jax.lax.scan` and `jax.lax.map`, without a word.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from mechanisms import four_bar, pendulum
from test_derivatives import drawn_point, weigh

import jaxnc as nc

U = jnp.linspace(0.3, 1.1, 3)
NAMES = ("O2", "O4", "A", "B", "P")
RELATIVE = 1e-9


def reverse(f):
    return jax.grad(f)


def forward(f):
    return lambda x: jax.jvp(f, (x,), (jnp.ones_like(x),))[1]


SECOND = {
    "reverse over reverse": (reverse, reverse),
    "forward over reverse": (reverse, forward),
    "reverse over forward": (forward, reverse),
}
THIRD = {"reverse, three times": (reverse, reverse, reverse)}


def by_scan(f, xs):
    return lax.scan(lambda total, x: (total + f(x), None), jnp.zeros(()), xs)[0]


LOOPS = {
    "vmap": (lambda f, xs: jnp.sum(jax.vmap(f)(xs)), {}),
    "map": (lambda f, xs: jnp.sum(lax.map(f, xs)), SECOND | THIRD),
    "scan": (by_scan, {}),
    "map in vmap": (lambda f, xs: jnp.sum(jax.vmap(lambda x: jnp.sum(lax.map(f, x[None])))(xs)), {}),
}
TWICE = {"reverse over reverse": SECOND["reverse over reverse"]}


def all_orders(f, orders):
    """Derivatives of a function of one number at 1, by name."""
    found = {}
    for name, each in (orders or TWICE).items():
        found[name] = f
        for differentiate in each:
            found[name] = differentiate(found[name])
    return nc.jit(lambda x: {name: g(x) for name, g in found.items()})(jnp.ones(()))


def redesigned(system, k):
    """The design with one joint moved: both the drawing and, in what follows, the inputs depend on the number."""
    points = system.parameters.points
    move = jnp.zeros_like(points).at[3].set(jnp.array([0.3, -0.2]))
    return jax.tree.map(lambda x: x + (k - 1.0) * move if x is points else x, system)


def position(system):
    return lambda k, u: weigh(nc.solve_position(redesigned(system, k), {"phi": k * u})["P"])


def closed_position(system):
    points = [system[n] for n in NAMES]

    def at(k, u):
        return drawn_point([*points[:3], points[3] + (k - 1.0) * jnp.array([0.3, -0.2]), points[4]], u)

    return at


@pytest.fixture(scope="module")
def system():
    found = four_bar(explicit=False)
    assert found.topology.points == NAMES
    return found


def agree(found, wanted):
    for name, value in found.items():
        np.testing.assert_allclose(value, wanted[name], rtol=RELATIVE, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("loop", LOOPS)
def test_positions(system, loop):
    closed, (through, orders) = closed_position(system), LOOPS[loop]
    found = all_orders(lambda k: through(lambda u: position(system)(k, u), U), orders)
    agree(found, all_orders(lambda k: sum(weigh(closed(k, k * u)) for u in U), SECOND | THIRD))


@pytest.mark.slow
def test_rates(system):
    closed = closed_position(system)

    def speed(k, u):
        motion = nc.sweep(redesigned(system, k), {"phi": (k * u)[None]}, rates={"phi": 2.0})
        return weigh(motion.velocity("P")[0]) + weigh(motion.acceleration("P")[0])

    def closed_speed(k, u):
        first = lambda t: jax.jvp(lambda t: closed(k, t), (t,), (2.0,))[1]  # noqa: E731
        return weigh(first(k * u)) + weigh(jax.jvp(first, (k * u,), (2.0,))[1])

    found = all_orders(lambda k: jnp.sum(lax.map(lambda u: speed(k, u), U)), TWICE)
    agree(found, all_orders(lambda k: sum(closed_speed(k, u) for u in U), TWICE))


@pytest.mark.slow
def test_simulations():
    """A pendulum's fall, by its mass's place: through a loop as one by one, and that against differences."""
    system = pendulum().compile()
    times = jnp.linspace(0.0, 0.2, 3)

    def fall(k, x):
        points = system.parameters.points
        moved = jax.tree.map(lambda a: a * (1.0 + (k - 1.0) * x) if a is points else a, system)
        return weigh(nc.simulate(moved, times, method="rk4", step=0.05)["B"][-1])

    orders = {"forward over reverse": SECOND["forward over reverse"]}
    through = all_orders(lambda k: jnp.sum(lax.map(lambda x: fall(k, x), U)), orders)
    of_one, h = nc.jit(jax.grad(fall)), 1e-4

    def slope(k):
        return sum(of_one(k, x) for x in U)

    difference = (8 * (slope(1 + h) - slope(1 - h)) - slope(1 + 2 * h) + slope(1 - 2 * h)) / (12 * h)
    np.testing.assert_allclose(through["forward over reverse"], difference, rtol=1e-6)
