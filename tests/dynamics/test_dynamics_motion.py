"""Simulation under transformations, other formulations, singular positions, statics and vibration."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import jaxnc as nc
from jaxnc.library import benchmarks

G = 9.81


@functools.cache
def slider_crank():
    """n = 3, no angle: small enough to be written out."""
    m = nc.Mechanism("slider-crank")
    m.ground("O", (0, 0))
    m.point("A", (0.06, 0.08))
    m.point("B", (0.34, 0), fixed="y")
    m.body("crank", ["O", "A"], mass=0.5)
    m.body("conrod", ["A", "B"], mass=0.8)
    m.point_mass("slider", "B", 1.2)
    m.spring("spring", "O", "B", stiffness=40.0, free=0.3)
    m.gravity = (0, -G)
    return m.compile()


T = np.linspace(0, 0.3, 4)


def last(system, method="rk4", step=0.01):
    return nc.simulate(system, T, rates={"A.x": 0.5}, method=method, step=step, throw=False)["B"][-1, 0]


def test_a_start_given_by_a_coordinate_is_at_rest():
    """A pose says nothing of the rates."""
    run = nc.simulate(slider_crank(), T, {"B.x": 0.3}, method="rk4", step=0.01)
    assert np.abs(run.rates[0][0]).max() == 0.0
    assert float(run["B"][0, 0]) == pytest.approx(0.3, abs=1e-12)


def test_a_given_rate_is_met_beside_an_input():
    """The end of a driven arm moves; what hangs there turns as it was told all the same."""
    system = benchmarks.double_pendulum().compile()
    how: dict = {"inputs": {"alpha": lambda t: 0.5 * t}, "method": "rk4", "step": 0.01}
    run = nc.simulate(system, T[:2], rates={"beta": 1.0}, **how)
    assert float(run.velocity("alpha")[0]) == pytest.approx(0.5, abs=1e-12)
    assert float(run.velocity("beta")[0]) == pytest.approx(1.0, abs=1e-12)
    assert float(run.correction[1]) <= 1e-12


def central(f, system, name, index=()):
    value = np.asarray(system[name], float)
    ends = []
    for sign in (1, -1):
        other = value.copy()
        other[index] += sign * 1e-5
        ends.append(float(f(system.replace({name: other}))))
    return (ends[0] - ends[1]) / 2e-5


DESIGN = [
    ("spring.stiffness", ()),
    ("crank.mass", ()),
    ("slider.mass", ()),
    ("A", (0,)),
    ("A", (1,)),
    ("gravity.y", ()),
]


_both = jax.jit(jax.value_and_grad(last))  # compiled once for two tests


def value(system):
    return _both(system)[0]


def gradient(system):
    return _both(system)[1]


def test_gradients_of_a_simulation():
    """Reverse against central differences, forward against reverse."""
    f, g = value, gradient(slider_crank())
    for name, index in DESIGN:
        if name == "A":  # moving A moves the start off the constraints of B, which stays where it is drawn
            continue
        assert float(np.asarray(g[name])[index]) == pytest.approx(central(f, slider_crank(), name, index), rel=1e-6)
    for k in (0, 1):
        assert float(g["A"][k]) == pytest.approx(central(f, slider_crank(), "A", k), rel=1e-6)


def test_forward_and_reverse_agree_and_a_batch_is_a_loop():
    system = slider_crank()
    stiffness = jnp.array([30.0, 40.0, 55.0])

    def f(k):
        return last(system.replace({"spring.stiffness": k}))

    # One program for the batch and what changes forward in it.
    many, forward = jax.jit(jax.vmap(lambda k: jax.jvp(f, (k,), (jnp.ones(()),))))(stiffness)
    designs = [system.replace({"spring.stiffness": k}) for k in stiffness]
    assert np.allclose(many, [value(s) for s in designs], rtol=1e-12, atol=1e-13)
    assert np.allclose(forward, [gradient(s)["spring.stiffness"] for s in designs], rtol=1e-9)


def test_formulations_agree():
    """Every formulation goes to the same motion; their errors are those of their order."""
    system = slider_crank()
    exact = nc.simulate(system, T, rates={"A.x": 0.5}, rtol=1e-11, atol=1e-13)
    for method, step, tolerance in (
        ("rk4", 2e-3, 2e-7),
        ("generalised alpha", 1e-3, 2e-4),
    ):
        # `singular` only to share what is compiled with the next test.
        run = nc.simulate(system, T, rates={"A.x": 0.5}, method=method, step=step, singular=True)
        assert np.abs(run.q - exact.q).max() <= tolerance, method
        assert float(run.violation[0]) <= 1e-12, method


@pytest.mark.parametrize(
    ("method", "step", "tolerance"),
    [
        ("rk4", 2e-3, 2e-4),
        ("generalised alpha", 1e-3, 5e-3),
        ("dopri8", 1e-9, 1e-7),
    ],
)
def test_equal_arms_pass_the_bifurcation(method, step, tolerance):
    """Both arms upright, the slider on the crank's centre: the slider goes on, and does not stay to let the arms turn.

    Energy of the motion with one angle, written by hand: the slider at 2 r cos θ, the conrod at -θ. The tolerance, a
    part of it, is each method's error at these steps (relative tolerances, where they are adaptive).
    """
    r, w, theta = 0.1, 20.0, 0.5
    place = r * np.array([np.cos(theta), np.sin(theta)])
    arms = slider_crank().replace({"A": place, "B": (2 * place[0], 0), "spring.stiffness": 0.0})
    how = {"rtol": step, "atol": 1e-2 * step} if method == "dopri8" else {"step": step}
    run = nc.simulate(arms, T, rates={"A.x": -w * place[1]}, method=method, singular=True, **how)
    a, b, va = np.asarray(run["A"]), np.asarray(run["B"]), np.asarray(run.velocity("A"))
    turned = np.unwrap(np.arctan2(a[:, 1], a[:, 0]), period=2 * np.pi)
    assert len(run.status) == 4 and (b[:, 0] * np.cos(turned) >= 0).all() and b[:, 0].min() < 0
    assert np.abs(b[:, 0] - 2 * a[:, 0]).max() <= 1e-6
    speed = np.sum(va * np.column_stack([-a[:, 1], a[:, 0]]), axis=1) / r**2
    c, s = a[:, 0] / r, a[:, 1] / r
    inertia = r**2 * (0.5 / 3 + 0.8 * (2.25 * s**2 + 0.25 * c**2 + 1 / 12) + 1.2 * 4 * s**2)
    energy = 0.5 * inertia * speed**2 + G * r * s * (0.25 + 0.4)
    assert np.abs(energy - energy[0]).max() <= tolerance * energy[0]


def test_n_four_bar_passes_its_singular_position():
    """All bars in one line: the uprights stay parallel, and the energy stays."""
    system = benchmarks.n_four_bar(2).compile()
    t = np.linspace(0, 2, 21)
    run = nc.simulate(system, t, rates={"B0": (1.0, 0.0)}, method="rk4", step=1e-3, singular=True)
    tips = [np.asarray(run[f"B{k}"]) - [k, 0] for k in range(3)]
    assert np.abs(tips[0][:, 1]).min() < 0.3 and tips[0][:, 1].min() < -0.5  # it went through
    assert np.abs(tips[1] - tips[0]).max() <= 1e-6 and np.abs(tips[2] - tips[0]).max() <= 1e-6
    assert float(run.drift) <= 1e-3
    # One freedom: a pendulum of the same inertia, energy 0.5 (3/3 + 2) ω² + (3/2 + 2) g cos θ.
    height = tips[0][:, 1]
    speed = np.linalg.norm(np.asarray(run.velocity("B0")), axis=1)
    assert np.abs(1.5 * speed**2 + 3.5 * G * height - (1.5 + 3.5 * G)).max() <= 1e-3


def test_a_weight_on_a_spring_rests_where_no_constraint_bears_it():
    """All forces vanish there, so that none of them says how small what is left has to be."""
    m = nc.Mechanism("weight")
    m.ground("O", (0, 0))
    m.point("W", (0, -0.3), fixed="x")
    m.point_mass("mass at W", "W", 2.0)
    m.gravity = (0, -G)
    m.spring("spring", "O", "W", stiffness=150.0, free=0.2)
    rest = nc.equilibrium(m.compile())
    assert float(rest["W"][1]) == pytest.approx(-0.2 - 2.0 * G / 150.0, rel=1e-13) and bool(rest.stable)


@pytest.mark.slow
def test_equilibrium_stability_and_frequency_of_a_rod():
    m = nc.Mechanism("rod")
    m.ground("O", (0, 0))
    m.point("P", (0.8, -0.6))
    m.body("rod", ["O", "P"], mass=2.0)
    m.angle("phi", at="O", to="P")
    m.gravity = (0, -G)
    system = m.compile()
    low, high = nc.equilibrium(system), nc.equilibrium(system, {"phi": 1.4}, method="newton")
    assert np.allclose(low["P"], [0, -1], atol=1e-12) and bool(low.stable)
    assert np.allclose(high["P"], [0, 1], atol=1e-12) and not bool(high.stable)
    near = nc.linearise(system, low, coordinates=["phi"], inputs=["phi"])
    assert float(near.frequencies[0]) == pytest.approx(np.sqrt(1.5 * G), rel=1e-12)
    assert near.stable and not nc.linearise(system, high, coordinates=["phi"], inputs=["phi"]).stable
    assert np.allclose(near.input_matrix[:, 0], [0, 1 / (2.0 / 3)], rtol=1e-12)
    with pytest.raises(nc.InputError, match=r"P.y.*singular"):
        nc.linearise(system, low, coordinates=["P.y"])

    def frequency(change):  # of the rod's end and its mass
        s = system.replace({"P": system["P"] + change[:2], "rod.mass": 2.0 + change[2]})
        return nc.linearise(s, nc.equilibrium(s, throw=False), coordinates=["phi"]).frequencies[0]

    # Forward, a smaller program than in reverse, for which see test_dynamics_balance.py.
    g = nc.jit(jax.jacfwd(frequency))(np.zeros(3))
    assert np.allclose(g[:2], -0.5 * np.sqrt(1.5 * G) * np.array([0.8, -0.6]), rtol=1e-9)
    assert float(g[2]) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
def test_an_equilibrium_has_derivatives_of_every_order():
    """By the ground too, and with a torque that has no potential: against differences of values and of slopes."""
    m = nc.Mechanism("double pendulum on a spring")
    for name, at in {"O": (0, 0), "G": (1.5, 0.2)}.items():
        m.ground(name, at)
    for name, at in {"B": (0.5, -0.6), "C": (0.9, -1.3)}.items():
        m.point(name, at)
    m.body("upper", ["O", "B"], mass=1.0)
    m.body("lower", ["B", "C"], mass=0.5)
    m.angle("phi", at="O", to="B")
    m.angle("psi", at="B", to="C")
    m.spring("spring", "G", "C", stiffness=20.0, free=0.8)
    m.torque("drag", "phi", lambda t, state, p: p * jnp.cos(state["psi"]), 3.0)
    m.gravity = (0, -G)
    system = m.compile()
    points = system.parameters.points
    way = jnp.asarray(np.random.default_rng(3).normal(size=points.shape))

    def place(k):
        rest = nc.equilibrium(jax.tree.map(lambda x: x + k * way if x is points else x, system), throw=False)
        return jnp.sum(jnp.sin(rest["C"])) + jnp.sum(jnp.cos(rest.reactions.support("O") / 10.0))

    def slope(k):
        value, first = jax.value_and_grad(place)(k)
        return first, value

    @nc.jit
    def every(k):
        """Value, slope and its slope, in reverse, which asks more of the rules than forward."""
        (first, value), second = jax.value_and_grad(slope, has_aux=True)(k)
        return jnp.stack([value, first, second])

    h = 1e-3
    at = {k: np.asarray(every(k * h)) for k in (-2, -1, 0, 1, 2)}
    change = (8 * (at[1] - at[-1]) - at[2] + at[-2]) / (12 * h)
    assert at[0][1:] == pytest.approx(change[:2], rel=1e-8)


def test_heavy_top_precesses_and_keeps_its_momenta():
    """Energy, the momentum about the vertical, and (for a symmetric top) the spin about its own axis."""
    m = benchmarks.heavy_top()
    run = nc.simulate(m.compile(), np.linspace(0, 0.2, 5), rates=m.model.simulate.rates, rtol=1e-9, atol=1e-10)
    assert float(run.drift) <= 1e-4 * 5435.7
    h = np.asarray(nc.dynamics.angular_momentum(run))
    assert np.abs(h[:, 2] - h[0, 2]).max() <= 1e-6 * np.abs(h).max()
    axis = np.asarray(run["C"])
    own = np.sum(h * axis, axis=1)
    assert np.allclose(own, 0.46875 * 150.0, rtol=1e-6)


def test_a_motion_that_cannot_pass_a_singular_position_says_so():
    """A parallelogram's cranks pass one line at equal speed; where rows are not said to be redundant, it breaks off.

    Without a force its speed stays. Adaptive steps pass the line at their tolerance, or end there; so do equal steps,
    of which 1 of 400 lanes took other speeds, up to five times as much.
    """
    m = nc.Mechanism("parallelogram")
    m.ground("A", (0, 0)), m.ground("D", (2, 0))
    m.point("B", (0.27, 0.42)), m.point("C", (2.27, 0.42))
    for name, ends, mass in (("crank", "AB", 0.5), ("coupler", "BC", 1.2), ("rocker", "CD", 1.0)):
        m.body(name, list(ends), mass=mass)
    m.angle("phi", at="A", to="B")
    system = m.compile()
    t = np.linspace(0, 10, 51)
    ended = 0
    for speed in np.linspace(4.1, 8.9, 9):  # which of them end is a matter of rounding
        try:
            run = nc.simulate(system, t, rates={"phi": speed})
        except nc.AssemblyError as error:
            ended += 1
            assert "singular=True" in str(error)
        else:
            assert np.abs(run.velocity("phi") - speed).max() <= 1e-6
    assert ended
    whole = nc.simulate(system, t, rates={"phi": 7.3}, singular=True)
    assert np.abs(whole.velocity("phi") - 7.3).max() <= 1e-7

    @jax.jit
    @jax.vmap
    def move(speed):
        run = nc.simulate(system, np.arange(0, 10, 0.01), rates={"phi": speed}, method="rk4", throw=False)
        return run.velocity("phi")[-1], run.status[-1]

    speeds = np.random.default_rng(5).uniform(4, 9, (3, 400))[1]
    after, status = map(np.asarray, move(speeds))
    good = status == 0
    assert 0 < np.count_nonzero(~good) <= 10
    assert np.abs(after / speeds - 1)[good].max() <= 1e-3


def test_a_point_between_springs_rests_where_they_balance():
    """Without rows no force is left there to measure by: a bracket finds the place."""
    m = nc.Mechanism("two springs")
    m.ground("A", (-1, 0)), m.ground("B", (1, 0)), m.point("C", (0.0, 0.3)), m.point_mass("p", "C", 1.0)
    m.spring("l", "A", "C", stiffness=500.0), m.spring("r", "C", "B", stiffness=500.0), m.force("F", "C", (0.0, -5.0))
    system, free = m.compile(), np.hypot(1, 0.3)
    for force in np.linspace(-400, -10, 12):
        want = brentq(lambda y: 1000 * (np.hypot(1, y) - free) * y / np.hypot(1, y) - force, -3, -0.3, xtol=1e-14)  # noqa: B023
        found = nc.equilibrium(system.replace({"F.y": force}))
        np.testing.assert_allclose(found["C"], [0.0, want], atol=1e-12)
        assert found.stable


def test_a_point_mass_on_a_bar_between_massless_bodies():
    """Its mass matrix is singular, the mechanism's inertia is not: Lagrange's equation in the crank's angle."""
    r, rod, off, begin, along, across = 0.1, 0.35, 0.02, 0.7, 0.5, 0.07

    def place(phi):
        b = r * np.array([np.cos(phi), np.sin(phi)])
        c = np.array([b[0] + np.sqrt(rod**2 - (b[1] - off) ** 2), off])
        e = (c - b) / rod
        return b, c, b + rod * along * e + across * np.array([-e[1], e[0]])

    m = nc.Mechanism("point mass on a rod")
    b, c, com = place(begin)
    m.ground("A", (0, 0)), m.point("B", b), m.point("C", c, fixed="y")
    m.body("crank", ["A", "B"]), m.body("rod", ["B", "C"], mass=1.2, com=com, inertia=0.0)
    m.angle("phi", at="A", to="B")
    m.gravity = (0, -9.81)
    system = m.compile()
    h = 1e-3
    left, here, right = (place(begin + k * h)[2] for k in (-1, 0, 1))
    slope, bend = (right - left) / (2 * h), (right - 2 * here + left) / h**2
    wanted = (-9.81 * slope[1] - slope @ bend) / (slope @ slope)

    def run(system, method="rk4"):
        step = {"step": 1e-3} if method == "rk4" else {}
        found = nc.simulate(system, [0.0, 0.01], rates={"phi": 1.0}, method=method, throw=False, **step)
        return found.acceleration("phi")[0], found.status

    def changing(mass):
        return jax.jvp(lambda x: run(system.replace({"rod.mass": x}), "dopri8"), (mass,), (1.0,))

    compiled, (change, _) = jax.jit(changing)(1.2)
    for value, status in (run(system), jax.jit(run)(system), run(system, "dopri8"), compiled):
        assert not status.any()
        np.testing.assert_allclose(value, wanted, rtol=1e-4)
    np.testing.assert_allclose(change, 0.0, atol=1e-9)  # gravity moves every mass alike


def test_a_traced_design_that_has_lost_its_inertia_since_it_was_compiled_breaks_off():
    """Where the mass matrix of a motion that is written out has lost its inverse, no wrong number stands."""
    m = nc.Mechanism("bar")
    m.ground("A", (0, 0)), m.point("B", (0.1, 0.0)), m.point("C", (0.4, 0.0), fixed="y")
    m.body("crank", ["A", "B"]), m.body("rod", ["B", "C"], mass=1.0, com=(0.2, 0.05), inertia=0.01)
    m.angle("phi", at="A", to="B")
    m.gravity = (0, -9.81)
    system = m.compile()

    def status(inertia):
        found = nc.simulate(system.replace({"rod.inertia": inertia}), [0.0, 0.01], {"phi": 0.7}, method="rk4")
        return found.status

    found = jax.jit(jax.vmap(status))(np.array([0.01, 0.0]))
    assert not found[0].any() and (found[1] == int(nc.Status.CAME_APART)).all()


def test_the_ground_is_shaken_beside_an_input():
    m = nc.Mechanism("shaken")
    m.ground("A", (0, 0))
    m.point("B", (1, 0))
    m.point("C", (1, -1))
    m.body("arm", ["A", "B"], mass=0.0)
    m.body("bob", ["B", "C"], mass=0.0)
    m.point_mass("p", "C", 2.0)
    m.point_mass("e", "B", 1.0)
    m.angle("q", at="A", to="B")
    m.angle("r", at="B", to="C")
    m.gravity = (0, -G)
    t = np.linspace(0, 1, 6)
    drives = {"A.y": lambda t: 0.05 * jnp.sin(8 * t), "q": lambda t: 0.2 * t**2}
    run = nc.simulate(m.compile(), t, inputs=drives, method="dopri8", rtol=1e-10)
    place = [lambda t: jnp.cos(drives["q"](t)), lambda t: drives["A.y"](t) + jnp.sin(drives["q"](t))]
    x, y = (jax.jit(jax.grad(jax.grad(f))) for f in place)

    def swing(t, state):  # of a point on a bar of length one that hangs on B
        return [state[1], float(x(t)) * np.sin(state[0]) - (float(y(t)) + G) * np.cos(state[0])]

    right = solve_ivp(swing, (0, 1), [-np.pi / 2, 0.0], t_eval=t, rtol=1e-10, atol=1e-11).y[0]
    assert np.abs(np.asarray(run["r"]) - right).max() <= 1e-7


def test_what_the_ground_alone_drives_starts_with_the_least_kinetic_energy():
    """T = m (v² - 2 v ω y) / 2 + (I + m r²) ω² / 2, y the com's height above the pivot: ω = m v y / (I + m r²)."""
    m = nc.Mechanism("shaken bar")
    m.ground("O", (0, 0))
    m.point("B", (1, 0))
    m.body("bar", ["O", "B"], mass=1.0, com=(0.5, 0.1), inertia=0.3)
    run = nc.simulate(m.compile(), np.array([0.0, 0.01]), inputs={"O.x": lambda t: 0.05 * jnp.sin(8 * t)})
    least = 0.4 * 0.1 / (0.3 + 0.5**2 + 0.1**2)
    assert float(run.velocity("B")[0, 1]) == pytest.approx(least, rel=1e-9)
