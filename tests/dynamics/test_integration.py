"""The integrators by themselves: their order, their derivatives against closed forms, and what they compile."""

import functools

import jax
import jax.monitoring
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.dynamics import integrate
from jaxnc.dynamics.flow import StageSolution
from jaxnc.dynamics.steps import METHODS, MotionState, step

G = 9.81
COMPILED = []


def _heard(event, *_, **__):
    if event.endswith("backend_compile_duration"):
        COMPILED.append(event)


jax.monitoring.register_event_duration_secs_listener(_heard)


class Oscillator:
    """q'' = -q, without constraints."""

    redundant = False

    def impose(self, t, q, v):
        return q, v

    def solve_stage(self, stage, t, q, v):
        return StageSolution(jnp.where(stage == 0, -q, 0.0), jnp.zeros(0), jnp.zeros(()), jnp.zeros(()))


@pytest.mark.parametrize("method", METHODS)
def test_every_method_is_of_its_order(method):
    """A step of half the length leaves 2 ** (order + 1) times less, and the estimate belongs to the order below."""
    start = MotionState(jnp.ones(1), jnp.zeros(1), -jnp.ones(1), jnp.zeros(0), jnp.zeros(()), jnp.zeros(()))
    one = jax.jit(lambda h: step(Oscillator(), method, True, 0.0, h, start)[:2])
    long = 0.8 if method == "dopri8" else 0.2
    errors, estimates = [], []
    for h in (long, long / 2):
        state, error = one(h)
        errors.append(np.hypot(float(state.q[0]) - np.cos(h), float(state.v[0]) + np.sin(h)))
        estimates.append(np.hypot(*(float(np.sum(e)) for e in error)))
        assert float(state.a[0]) == pytest.approx(-float(state.q[0]), abs=1e-14)
    order = METHODS[method].order
    assert np.log2(errors[0] / errors[1]) >= order + 0.6
    if method != "rk4":
        assert np.log2(estimates[0] / estimates[1]) >= order - 0.3 and estimates[1] > errors[1]


@functools.cache
def spring():
    m = nc.Mechanism("mass and spring")
    m.ground("O", (0, 0))
    m.point("P", (1.0, 0), fixed="y")
    m.point_mass("mass at P", "P", 1.5)
    m.spring("spring", "O", "P", stiffness=6.0, free=0.8)
    return m.compile()


@pytest.mark.parametrize("how", [jax.jacrev, jax.jacfwd])
def test_derivatives_of_a_controlled_run(how, monkeypatch):
    """x = l + (1 - l) cos ωt; also where fewer steps are kept than an interval takes, and by the times."""
    monkeypatch.setattr(integrate, "_KEPT", 4)
    system, t = spring(), np.array([0.0, 0.9, 2.0])

    def place(k, free, t):
        run = nc.simulate(
            system.replace({"spring.stiffness": k, "spring.free": free}),
            t,
            rtol=1e-10,
            atol=1e-12,
        )
        return jnp.stack([run["P"][-1, 0], run.velocity("P")[1, 0]])

    def exact(k, free, t):
        w = jnp.sqrt(k / 1.5)
        return jnp.stack([free + (1 - free) * jnp.cos(w * t[2]), -(1 - free) * w * jnp.sin(w * t[1])])

    found, wanted = (jax.jit(how(f, argnums=(0, 1, 2)))(6.0, 0.8, jnp.asarray(t)) for f in (place, exact))
    assert np.allclose(found[0], wanted[0], rtol=1e-7) and np.allclose(found[1], wanted[1], rtol=1e-7)
    assert np.allclose(found[2][:, 1:], wanted[2][:, 1:], rtol=1e-7, atol=1e-7)


def down(t, state, height):
    return state["P"][1] - height


def test_when_an_event_happens_has_a_derivative():
    """A ball falls from 1 m to h: t = √(2 (1 - h) / g), v = -g t."""
    m = nc.Mechanism("ball")
    m.point("P", (0, 1.0))
    m.point_mass("mass at P", "P", 0.3)
    m.gravity = (0, -G)
    system = m.compile()

    def landing(g, h):
        run = nc.simulate(
            system.replace({"gravity.y": -g}), np.array([0.0, 0.2, 1.0]), event=down, event_parameters=h, throw=False
        )
        return jnp.stack([run.end, run.velocity("P")[-1, 1]])

    t = np.sqrt(2 * 0.75 / G)
    by_g, by_h = jax.jacrev(landing, argnums=(0, 1))(G, 0.25)
    assert np.allclose(by_g, [-0.5 * t / G, -0.5 * t], rtol=1e-9)
    assert np.allclose(by_h, [-1 / (G * t), 1 / t], rtol=1e-9)


def test_another_number_of_times_or_another_step_compiles_nothing():
    first = nc.simulate(spring(), np.linspace(0, 1, 12), rates={"P.x": 0.5})
    before = len(COMPILED)
    assert before and (np.asarray(first.steps) > 0).any()
    other = nc.simulate(spring(), np.linspace(0, 1, 15), rates={"P.x": 0.5})
    assert len(COMPILED) == before
    assert np.allclose(other.q[-1], first.q[-1], atol=1e-8) and other.q.shape[0] == 15
    nc.simulate(spring(), np.linspace(0, 1, 12), method="rk4", step=0.05)
    before = len(COMPILED)
    nc.simulate(spring(), np.linspace(0, 1, 12), method="rk4", step=0.02)
    assert len(COMPILED) == before
