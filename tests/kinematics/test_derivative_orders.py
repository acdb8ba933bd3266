"""Derivatives of the first three orders, forward, in reverse and mixed, through every transformation of JAX.

A rule that JAX loses where it splits a loop gives a derivative of too low an order, without a word.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxnc as nc
from jaxnc.autodiff import Rules, custom_jvp_vjp

U = jnp.array([0.3, 0.5])
T = jnp.linspace(0.0, 0.1, 2)
RELATIVE = 1e-11
STEPPED = 1e-6  # of fourth order in steps of 5 ms, where the second derivative is a thousandth of the first
SPEED, PUSH = 2.0, 1.0


# -- what is differentiated, by a design k and an input u, and its closed form -----------------------------------------


@functools.cache
def bar() -> nc.System:
    """A rod of one kilogram on a pin: the smallest mechanism whose pose has to be solved for."""
    m = nc.Mechanism("bar")
    m.ground("O", (0, 0))
    m.point("A", (0.6, -0.8))
    m.body("bar", ["O", "A"], mass=1.0)
    m.gravity = (0, -9.81)
    return m.compile()


def longer(k):
    """The design with its drawing scaled."""
    drawn = bar().parameters.points
    return jax.tree.map(lambda x: x * k if x is drawn else x, bar())


def solved(k, u):
    return nc.solve_position(longer(k), {"A.x": u * jnp.sin(k)}, rates={"A.x": SPEED}, accelerations={"A.x": PUSH})


def position(k, u):
    return nc.solve_position(longer(k), {"A.x": u * jnp.sin(k)})["A.y"]


def rates(k, u):
    """Of a design for each input."""
    pose = solved(k + 0.1 * u, u)
    return pose.velocity("A")[1] + 0.1 * pose.acceleration("A")[1]


def effort(k, u):
    return nc.inverse_dynamics(longer(k), solved(k, u)).efforts[0]


def fall(k, u):
    return nc.simulate(longer(k), T, rates={"A.x": u * k}, method="rk4", step=0.005)["A"][-1, 1]


def moving(f):
    """A function of time with its first two derivatives at zero."""
    rate = lambda t: jax.jvp(f, (t,), (1.0,))[1]  # noqa: E731
    return f(0.0), rate(0.0), jax.jvp(rate, (0.0,), (1.0,))[1]


def abscissa(k, u):
    return lambda t: u * jnp.sin(k) + SPEED * t + 0.5 * PUSH * t * t


def closed_position(k, u):
    return -jnp.sqrt(k**2 - abscissa(k, u)(0.0) ** 2)


def closed_rates(k, u):
    k, x = k + 0.1 * u, abscissa(k + 0.1 * u, u)
    _, v, a = moving(lambda t: -jnp.sqrt(k**2 - x(t) ** 2))
    return v + 0.1 * a


def closed_effort(k, u):
    x = abscissa(k, u)
    angle, _, a = moving(lambda t: -jnp.arccos(x(t) / k))
    return (k**2 / 3.0 * a + 9.81 * k / 2.0 * jnp.cos(angle)) / (-k * jnp.sin(angle))


def closed_fall(k, u):
    """The angle by the same method, which it needs no constraint for."""

    def slope(s):
        return jnp.stack([s[1], -1.5 * 9.81 / k * jnp.cos(s[0])])

    def step(s, _):
        a = slope(s)
        b = slope(s + 0.0025 * a)
        c = slope(s + 0.0025 * b)
        return s + 0.005 / 6.0 * (a + 2.0 * b + 2.0 * c + slope(s + 0.005 * c)), None

    begin = jnp.array([np.arctan2(-0.8, 0.6), 0.0]).at[1].set(u / 0.8)
    return k * jnp.sin(lax.scan(step, begin, None, length=20)[0][0])


ASKED: list[str] = []


def _powers(what, x, rest):
    return [lax.while_loop(lambda s: s[0] < what, lambda s: (s[0] + 1, s[1] * x[0]), (0, 1.0))[1]], [rest[0] + 1]


def _change(what, x, rest, smooth, other, change):
    ASKED.append("tangent")
    return jax.jvp(lambda *x: _powers(what, x, rest)[0], tuple(x), tuple(change))[1]


def _pull(what, x, rest, smooth, other, change):
    ASKED.append("cotangent")
    return [what * _powers(what - 1, x, rest)[0][0] * (change[0] + other[0] - rest[0] - 1)]


def rule(k, u):
    """A function whose programs have loops that JAX cannot go back through."""
    return u * custom_jvp_vjp(Rules(_powers, _change, _pull), 5, [k * u], [jnp.asarray(4)])[0][0]


def closed_rule(k, u):
    return u * (k * u) ** 5


# -- how it is differentiated ------------------------------------------------------------------------------------------


def forward(f):
    """The derivative of what comes with its own lower derivatives, and with these."""

    def derivative(x):
        value, change, lower = jax.jvp(f, (x,), (1.0,), has_aux=True)
        return change, [*lower, value]

    return derivative


def reverse(f):
    def derivative(x):
        (value, lower), change = jax.value_and_grad(f, has_aux=True)(x)
        return change, [*lower, value]

    return derivative


def orders(f, way):
    """Derivatives of a function of one number up to the last letter of a way, the first letter the innermost."""
    found = lambda x: (f(x), [])  # noqa: E731
    for letter in way:
        found = {"f": forward, "r": reverse}[letter](found)

    def every(x):
        last, lower = found(x)
        return jnp.stack([*lower[1:], last])

    return every


def single(f):
    return lambda k: f(k, U[0])


def total(f):
    return lambda k: sum(f(k, u) for u in U)


def mapped(f):
    return lambda k: jnp.sum(jax.vmap(f, (None, 0))(k, U))


def by_map(f):
    return lambda k: jnp.sum(lax.map(lambda u: f(k, u), U))


def by_scan(f):
    return lambda k: lax.scan(lambda sum_, u: (sum_ + f(k, u), None), 0.0, U)[0]


def nested(f):
    inner = jax.checkpoint(jax.jit(f))
    return lambda k: jnp.sum(jax.vmap(lambda u: lax.map(lambda v: inner(k, v), u[None]))(U))


def beside(derivative):
    """Of several designs at once, of which one is looked at."""
    return lambda k: [x[1] for x in jax.vmap(derivative)(jnp.stack([0.9 * k, k]))]


# What becomes of the function, and of its derivative.
THROUGH = {
    "nothing": (single, lambda g: g),
    "jit": (single, nc.jit),
    "vmap": (mapped, nc.jit),
    "map": (by_map, nc.jit),
    "scan": (by_scan, nc.jit),
    "jit in checkpoint in map in vmap": (nested, nc.jit),
    "derivatives in vmap": (single, lambda g: nc.jit(beside(g))),
}
CLOSED = {position: closed_position, rates: closed_rates, effort: closed_effort, fall: closed_fall, rule: closed_rule}
EVERY = dict.fromkeys(THROUGH, "rrr fff rfr frf")
# Whatever the rule is of, JAX treats it alike: what takes long to compile goes every way and through everything, but
# not every way through everything (`lax.map` is a scan).
ASK = {
    rule: EVERY,
    position: {
        "nothing": "rrr",
        "jit": "fff",
        "vmap": "frf",
        "scan": "rrr",
        "jit in checkpoint in map in vmap": "fff rfr",
        "derivatives in vmap": "rrr",
    },
    rates: {"scan": "rf", "derivatives in vmap": "fff"},
    effort: {"vmap": "rfr"},  # of poses with their rates
    fall: {"jit": "rf"},
}


@functools.cache
def wanted(quantity, way, of=total):
    return np.asarray(jax.jit(orders(of(CLOSED[quantity]), way))(1.0))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("quantity", "through"),
    [pytest.param(q, through, id=f"{q.__name__}, {through}") for q, ways in ASK.items() for through in ways],
)
def test_orders(quantity, through):
    inside, outside = THROUGH[through]
    ways = ASK[quantity][through].split()
    each = [orders(inside(quantity), way) for way in ways]
    relative = STEPPED if quantity is fall else RELATIVE
    of = single if inside is single else total
    for way, found in zip(ways, outside(lambda k: [f(k) for f in each])(1.0), strict=True):  # all in one program
        np.testing.assert_allclose(found, wanted(quantity, way, of), rtol=relative, err_msg=way)


@pytest.mark.parametrize("compiled", [False, True])
def test_each_direction_has_its_program(compiled):
    jit = jax.jit if compiled else lambda f: f
    for way, program in (("f", "tangent"), ("r", "cotangent")):
        ASKED.clear()
        jit(orders(total(rule), way))(1.0)
        assert set(ASKED) == {program}


def test_a_closure_that_is_made_inside_of_compiled_code_can_be_pulled_back_later():
    _, pull = jax.vjp(total(rule), jnp.asarray(1.0))
    np.testing.assert_allclose(jax.jit(lambda c: pull(c))(2.0)[0], 2.0 * wanted(rule, "rrr")[0], rtol=RELATIVE)
