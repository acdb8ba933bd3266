"""Numbers that no simulation can be made with, each refused by the name of the argument; statics without a force."""

import functools
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc

T = np.linspace(0.0, 0.1, 3)
NAN, INF = float("nan"), float("inf")
ANSWERS = ("simulate", "equilibrium", "linearise", "inverse_dynamics", "total_mass", "kinetic_energy")


@functools.cache
def pendulum():
    """A rod on a spring: a mass, an inertia, a stiffness and gravity to be changed."""
    m = nc.Mechanism("pendulum")
    m.ground("A", (0, 0))
    m.ground("C", (1, -1))
    m.point("B", (0.6, -0.8))
    m.body("rod", ["A", "B"], mass=1.0)
    m.angle("phi", at="A", to="B")
    m.spring("spring", "B", "C", stiffness=10.0)
    m.gravity = (0, -9.81)
    return m.compile()


def simulate(**more):
    return lambda: nc.simulate(pendulum(), more.pop("t", T), **more)


def changed(name, value):
    system = pendulum().replace({name: value})
    motion = nc.solve_position(pendulum(), {"phi": -0.9}, rates={"phi": 1.0})
    return {
        "simulate": lambda: nc.simulate(system, T),
        "equilibrium": lambda: nc.equilibrium(system),
        "linearise": lambda: nc.linearise(system),
        "inverse_dynamics": lambda: nc.inverse_dynamics(system, motion),
        "total_mass": lambda: nc.dynamics.total_mass(system),
        "kinetic_energy": lambda: nc.dynamics.kinetic_energy(
            nc.solve_position(system, {"phi": -0.9}, rates={"phi": 1.0})
        ),
    }


def lost():
    motion = nc.solve_position(pendulum(), {"phi": -0.9})
    return jax.tree.map(lambda x: x * NAN if x.dtype == float else x, motion)


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        *((simulate(step=x, method="rk4"), f"step= must be a positive number, got {x!r}") for x in (0, NAN, -1, INF)),
        (simulate(step="x", method="rk4"), "step= must be a positive number, got 'x'"),
        *(
            (simulate(step=step, method=method), f"step={step:g}: {said} steps; at most 1000000000 fit in one run")
            for step, said in ((1e-18, f"{T[-1] / 1e-18:.3g}"), (1e-30, f"{T[-1] / 1e-30:.3g}"), (5e-324, "inf"))
            for method in ("rk4", "generalised alpha")
        ),
        (lambda: jax.jit(lambda x: simulate(step=x, method="rk4")().q)(0.1), "step= and its times must be known"),
        (lambda: jax.jit(lambda t: simulate(step=0.1, t=t, method="rk4")().q)(T), "step= and its times must be known"),
        (
            lambda: jax.jit(lambda x: simulate(step=1e-30, rates={"phi": x}, method="rk4")().q)(0.1),
            "step=1e-30:",
        ),
        *((simulate(first=x), f"first= must be a positive number, got {x!r}") for x in (0, NAN)),
        *((simulate(rtol=x), f"rtol= must be a number from 0 on, got {x!r}") for x in (-1, NAN, INF)),
        *((simulate(atol=x), f"atol= must be a number from 0 on, got {x!r}") for x in (-1, NAN)),
        (simulate(rtol=0, atol=0), "rtol= and atol= are both 0"),
        *(
            (simulate(method="rk4", **{x: 1e-3}), f"{x}= is for steps that follow their errors (dopri8, kvaerno5), not")
            for x in ("rtol", "atol", "first")
        ),
        (simulate(step=0.5), "step= is for steps of fixed length (rk4, generalised alpha), not for 'dopri8'"),
        *(
            (simulate(most=x), f"most steps, must be {kind}, got {x!r}")
            for x, kind in ((0, "at least 1"), (-1, "at least 1"), (1.5, "a whole number"), (NAN, "a whole number"))
        ),
        (simulate(t=[]), "two values at least"),
        (simulate(t=[0.0, NAN]), "time t: 1 of 2 values are NaN"),
        (simulate(t=[0.0, 0.2, 0.1]), "time t must grow"),
        (simulate(t=[0.0, 0.0]), "time t must grow"),
        (simulate(event=3), "event= must be a function"),
        (simulate(inputs={"phi": lambda t: t * NAN}), "input 'phi' at t = 0: 1 of 1 values"),
        (simulate(inputs={"phi": lambda t: 1 / (0.1 - t)}), "input 'phi' at t = 0.1: 1 of 1 values"),
        (
            simulate(inputs={"phi": lambda t: jnp.ones(2)}),
            "input 'phi' must return one number",
        ),
        (simulate(state={"phi": NAN}), "state of 'phi': 1 of 1 values are NaN"),
        (simulate(rates={"phi": INF}), "rate of 'phi': 1 of 1 values are NaN"),
        (lambda: nc.simulate(pendulum(), T, lost()), "the pose: 7 of 7 values are NaN"),
        (lambda: nc.linearise(pendulum(), lost()), "the pose: 7 of 7 values are NaN"),
        (lambda: nc.equilibrium(pendulum(), hold={"phi": NAN}), "hold: 'phi': 1 of 1 values are NaN"),
        (lambda: nc.equilibrium(pendulum(), hold={"phi": [1.3, 1.2]}), "hold: 'phi' must be one number"),
        (lambda: nc.equilibrium(pendulum(), hold={"ph1": 0.1}), "no coordinate 'ph1' to hold"),
        (lambda: nc.inverse_dynamics(pendulum(), {"phi": 1.0}), "motion() or sweep(); got dict"),
        *(
            (lambda f=f: f(nc.library.four_bar()), "got Mechanism; call its compile()")
            for f in (nc.equilibrium, nc.linearise, lambda m: nc.simulate(m, T), nc.dynamics.total_mass)
        ),
    ],
)
def test_arguments_are_refused_by_name(ask, said):
    with pytest.raises(nc.InputError, match=re.escape(said)) as caught:
        ask()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("ask", ANSWERS)
@pytest.mark.parametrize(
    ("name", "value"), [("rod.mass", NAN), ("rod.mass", INF), ("gravity.y", NAN), ("spring.stiffness", INF)]
)
def test_design_variables_that_are_no_numbers(ask, name, value):
    with pytest.raises(nc.InputError, match=rf"'pendulum'.*'{name}'.*NaN or infinite"):
        changed(name, value)[ask]()


@pytest.mark.parametrize("ask", ANSWERS)
def test_a_mass_is_not_negative(ask):
    with pytest.raises(nc.InputError, match=r"'rod'.*mass.*-1.*negative"):
        changed("rod.mass", -1.0)[ask]()


@pytest.mark.parametrize("method", ["minimum", "newton"])
def test_without_a_force_every_pose_is_an_equilibrium(method):
    m = nc.Mechanism("free pendulum")
    m.ground("A", (0, 0))
    m.point("B", (0.6, -0.8))
    m.body("rod", ["A", "B"], mass=1.0)
    m.angle("phi", at="A", to="B")
    system = m.compile()
    found = nc.equilibrium(system, method=method)
    assert int(found.motion.status) == 0
    assert np.allclose(found["B"], (0.6, -0.8), rtol=0, atol=1e-14)
    assert float(found.stiffness[0]) == 0.0 and not bool(found.stable) and float(found.unbalanced) == 0.0
    assert np.allclose(nc.equilibrium(system, {"phi": 1.0}, method=method)["B"], (np.cos(1), np.sin(1)), atol=1e-12)
    if method == "newton":
        return  # derivatives are those of the equilibrium, however it was found
    slope = jax.grad(lambda s: nc.equilibrium(s, method=method)["B"][0])(system)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(slope))


def test_what_meets_no_force_is_indifferent():
    """A pendulum under a cart: it hangs, and the cart may stand anywhere."""
    m = nc.Mechanism("cart and pendulum")
    m.ground("O", (0, 0))
    m.point("P", (1.0, 0.0), fixed="y")
    m.point("Q", (1.3, -0.4))
    m.point_mass("mass at P", "P", 2.0)
    m.body("rod", ["P", "Q"], lengths={("P", "Q"): 0.5})
    m.point_mass("mass at Q", "Q", 1.0)
    m.gravity = (0, -9.81)
    found = nc.equilibrium(m.compile())
    assert np.allclose(found["Q"] - found["P"], (0, -0.5), rtol=0, atol=1e-9) and np.isfinite(found["P"]).all()
    assert float(found.stiffness[0]) == 0.0 and not bool(found.stable)
    # With Q a way d to the side of P it is d²/(2 l) higher; d = √2 for a motion of size one, (-1, 1)/√2.
    assert float(found.stiffness[1]) == pytest.approx(2 * 9.81 / 0.5, rel=1e-9)


def test_a_pose_of_another_design_begins_on_the_ground_of_this_one():
    """The spring's end and the pivot are where this design has them, and so are derivatives by both."""
    system = pendulum()
    pose = nc.solve_position(system, {"phi": -0.5}, rates={"phi": 1.0})
    places, step = jnp.array([[0.05, 0.02], [1.2, -0.7]]), 1e-5

    def end(places):
        other = system.replace({"A": places[0], "C": places[1]})
        run = nc.simulate(other, T, state=pose, method="rk4", step=0.05)
        return run["B"][-1, 0], run

    for found in (end(places)[1], nc.simulate(system.replace({"C": places[1]}), T, state=pose)):
        np.testing.assert_array_equal(found["C"], np.tile(places[1], (3, 1)))
    np.testing.assert_array_equal(end(places)[1]["A"], np.tile(places[0], (3, 1)))
    alike = nc.simulate(system.replace({"C": places[1]}), T, state={"phi": -0.5}, rates={"phi": 1.0})
    np.testing.assert_allclose(found.q, alike.q, atol=1e-12)
    slope = jax.grad(end, has_aux=True)(places)[0]
    for k in np.ndindex(2, 2):
        by = np.zeros((2, 2))
        by[k] = step
        difference = (end(places + by)[0] - end(places - by)[0]) / (2 * step)
        assert slope[k] == pytest.approx(float(difference), rel=1e-6)
