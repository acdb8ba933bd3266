"""Many slider-cranks under gravity at once, with steps of the classical Runge-Kutta method."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

import jaxnc as nc
from benchmarks.clock import Way
from benchmarks.record import OURS
from benchmarks.suite import Suite

CASE = "slider-cranks under gravity, steps of RK4"
STEPS, _H = 100, 1e-3
_CRANK, _ROD = 0.1, 0.3
_DRIFT = 1e-6  # of the energy: a lane that loses more is not right


@functools.cache
def _system() -> nc.System:
    m = nc.Mechanism("slider-crank")
    m.ground("O", (0, 0))
    m.point("A", (0.06, 0.08))
    m.point("B", (0.06 + np.sqrt(_ROD**2 - 0.08**2), 0), fixed="y")
    m.body("crank", ["O", "A"], mass=0.5)
    m.body("conrod", ["A", "B"], mass=0.8)
    m.point_mass("mass at B", "B", 1.2)
    m.gravity = (0, -9.81)
    return m.compile()


def _natural(speeds):
    t = np.array([0.0, STEPS * _H])

    def one(speed):
        run = nc.simulate(_system(), t, rates={"A.x": speed}, method="rk4", step=_H, throw=False)
        return run.energy

    return jax.vmap(one)(speeds)


def _by_hand(speeds):
    """The crank's angle alone: ½ I(θ) ω² + V(θ), with I and V written out."""

    def slider(theta):
        return _CRANK * jnp.cos(theta) + jnp.sqrt(_ROD**2 - (_CRANK * jnp.sin(theta)) ** 2)

    def inertia(theta):
        a = jnp.stack([-jnp.sin(theta), jnp.cos(theta)]) * _CRANK
        b = jnp.stack([jax.grad(slider)(theta), jnp.zeros(())])
        return 0.5 / 3 * _CRANK**2 + 0.8 / 3 * (a @ a + a @ b + b @ b) + 1.2 * b @ b

    def potential(theta):
        return 9.81 * (0.25 + 0.4) * _CRANK * jnp.sin(theta)

    def acceleration(theta, omega):
        return -(0.5 * jax.grad(inertia)(theta) * omega**2 + jax.grad(potential)(theta)) / inertia(theta)

    def energy(theta, omega):
        return 0.5 * inertia(theta) * omega**2 + potential(theta)

    def one(speed):
        theta, omega = jnp.arctan2(0.08, 0.06), -speed / 0.08

        def step(state, _):
            x, w = state
            a1 = acceleration(x, w)
            w2 = w + 0.5 * _H * a1
            a2 = acceleration(x + 0.5 * _H * w, w2)
            w3 = w + 0.5 * _H * a2
            a3 = acceleration(x + 0.5 * _H * w2, w3)
            w4 = w + _H * a3
            a4 = acceleration(x + _H * w3, w4)
            return (x + _H / 6 * (w + 2 * (w2 + w3) + w4), w + _H / 6 * (a1 + 2 * (a2 + a3) + a4)), None

        end, _ = jax.lax.scan(step, (theta, omega), None, length=STEPS)
        return jnp.stack([energy(theta, omega), energy(*end)])

    return jax.vmap(one)(speeds)


def slider_cranks(suite: Suite) -> None:
    """A thousand slider-cranks, each at a speed of its own; a lane is a hundred steps."""

    _system()  # before it is traced

    def right(energies, _):
        e = np.asarray(energies)
        return float(np.mean(np.abs(e[:, 1] - e[:, 0]) <= _DRIFT * np.abs(e).max()))

    def way(name, f, note):
        jitted = jax.jit(f)
        return Way(name, lambda x: jax.block_until_ready(jitted(x)), right, jnp.asarray, True, note)

    ways = [
        way(OURS, _natural, f"natural coordinates, projected; a lane is {STEPS} steps of {_H:g} s"),
        *suite.peer("by hand", lambda: [way("by hand", _by_hand, "the crank's angle alone, inertia written out")]),
    ]

    def draw(seed: int, size: int) -> np.ndarray:
        return np.random.default_rng(seed).uniform(0.2, 0.6, size)

    suite.compare(CASE, ways, draw, suite.size(1000, 200))
