"""Whatever is calculated works where the user has JAX refuse to promote shapes or types of numbers."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from mechanisms import four_bar, pendulum

import jaxnc as nc

PHI = np.linspace(0.9, 1.3, 5)
TIMES = np.linspace(0.0, 0.02, 3)


@pytest.fixture
def strict():
    with jax.numpy_rank_promotion("raise"), jax.numpy_dtype_promotion("strict"):
        yield


def loaded() -> nc.System:
    m = nc.library.four_bar(coupler_point=(0.06, 0.03))
    for body in ("crank", "coupler", "rocker"):
        m.mass(body, 0.2, com=(0.02, 0.01), inertia=1e-4)
    m.spring("return", "A", "C", stiffness=10.0)
    m.gravity = (0.0, -9.81)
    return m.compile()


LOADED, SWINGING = loaded(), pendulum().compile()


def position(system, x):
    return jnp.sum(nc.solve_position(system, {"phi": x})["P"])


def rates(system, x):
    motion = nc.sweep(system, {"phi": PHI + x}, rates={"phi": 2.0})
    return jnp.sum(motion.velocity("P")) + jnp.sum(motion.acceleration("P"))


def fixed_step(system, x):
    return jnp.sum(nc.simulate(system, TIMES, {"phi": x}, method="rk4", step=0.01)["B"])


def adaptive(system, x):
    return jnp.sum(nc.simulate(system, TIMES, {"phi": x})["B"])


def forces(system, x):
    return jnp.sum(nc.reactions(nc.sweep(system, {"phi": PHI + x}, rates={"phi": 2.0})).at("A", on="rod").force)


@pytest.mark.parametrize("door", [position, rates, fixed_step, adaptive, forces])
def test_gradients(door, strict):
    """By design and input, as they come or compiled; the numbers are those without the setting."""
    system = LOADED if door in (position, rates) else SWINGING
    gradient = jax.grad(door, (0, 1))
    if door is forces:  # which are hundreds of small programs outside of compiled code
        gradient = nc.jit(gradient)
    found = gradient(system, 1.0)
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        wanted = gradient(system, 1.0)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-7, atol=1e-9), found, wanted)


def test_other_transformations(strict):
    """Second derivatives, forward and in reverse, and lanes of designs: rules run when no function of ours does."""
    assert np.isfinite(jax.hessian(position, 1)(LOADED, 1.0))
    assert np.all(np.isfinite(jax.jacfwd(lambda x: nc.sweep(LOADED, {"phi": PHI + x})["P"])(0.0)))
    assert np.all(np.isfinite(jax.vmap(jax.grad(position, 1), (None, 0))(LOADED, PHI)))


def test_descent(strict):
    target = np.array([[0.03, 0.05], [0.02, 0.06], [0.0, 0.05]])
    problem = nc.synthesis.PathGeneration(nc.library.four_bar(coupler_point=(0.06, 0.03)), "P", target)
    found = nc.synthesis.solve(problem, starts=4, refine=2, iterations=2, progress=False)
    assert np.isfinite(found.designs[0].error)
    stepped = nc.synthesis.descend(problem, optax.adam(1e-2), steps=2, starts=2, progress=False)
    assert stepped.broken == 0 and np.isfinite(stepped.designs[0].error)


def test_statics_and_vibrations(strict):
    rest = nc.equilibrium(LOADED)
    assert rest.stable
    linear = nc.linearise(LOADED, rest)
    assert np.all(np.isfinite(linear.frequencies))


def test_wheels(strict):
    """Properties, which are asked for like arrays, calculate too."""
    model = nc.library.double_wishbone()
    run = model.model.run
    ride = {name: np.linspace(d.start, d.end, 5)[1:4] for name, d in run.inputs.items()}
    wheel = nc.suspension(nc.sweep(model.compile(), ride, hold=run.hold))
    assert wheel.caster is not None
    assert all(np.all(np.isfinite(x)) for x in (wheel.camber, wheel.toe, wheel.caster))


def test_setting_of_the_user_holds_outside(strict):
    """The user's own code around ours is refused as before."""

    def mixed(x):
        return jnp.sum(nc.solve_position(LOADED, {"phi": x})["P"] + jnp.ones((3, 2), np.float32))

    with pytest.raises((ValueError, TypeError)):
        jax.grad(mixed)(1.0)
    assert jnp.sum(nc.solve_position(four_bar(), {"phi": 1.0}).q) != 0.0
