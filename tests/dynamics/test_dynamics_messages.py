"""What bad input is told: the name at fault and the remedy."""

import functools
import time

import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc


def rod(dim=2, **mass):
    m = nc.Mechanism("rod", dim=dim)
    m.ground("O", (0,) * dim)
    m.point("P", (1,) + (0,) * (dim - 1))
    if dim == 3:
        m.vector("u", (0, 1, 0))
    m.body("arm", ["O", "P"], vectors=["u"] if dim == 3 else (), **mass)
    return m


TIMES = np.linspace(0, 1, 11)


@functools.cache
def swing():
    """The rod in the plane, with a mass."""
    return rod(mass=1.0).compile()


SAID = [
    (lambda: rod(mass=-1.0), ["'arm'", "mass cannot be negative"]),
    (lambda: rod(inertia=1.0), ["'arm'", "inertia= without a mass"]),
    (lambda: rod(mass=1.0, shape="brick"), ["'arm'", "shape='brick'", "box"]),
    (lambda: rod(mass=1.0, shape="box", size=(1.0,)), ["'arm'", "size=(a, b)"]),
    (lambda: rod(3, mass=1.0), ["'arm'", "mass but no inertia", "shape="]),
    (lambda: rod(3, mass=1.0, inertia=(1.0, 1.0, 3.0)), ["'arm'", "no body has this inertia tensor", "1, 1, 3"]),
    (lambda: rod(3, mass=1.0, inertia=np.array([[1, 2, 0], [0, 1, 0], [0, 0, 1.0]])), ["'arm'", "not symmetric"]),
    (lambda: rod().spring("s", "O", "Q", stiffness=1.0), ["'s'", "unknown point 'Q'"]),
    (lambda: rod().spring("s", "O", "P", stiffness=-1.0), ["'s'", "stiffness cannot be negative"]),
    (lambda: rod().torque("effort on phi", "phi", 1.0), ["phi", "unknown coordinate"]),
    (lambda: rod().point_mass("mass at Q", "Q", 1.0), ["unknown point 'Q'"]),
    (lambda: rod().stop("s", "O", "P", stiffness=1.0), ["'s'", "lower=, upper="]),
    (lambda: rod().stop("s", "O", "P", stiffness=1.0, lower=0.5, restitution=0.5), ["'s'", "speed="]),
    (lambda: rod().stop("s", "O", "P", stiffness=1.0, lower=0.5, restitution=1.5, speed=1.0), ["'s'", "at most 1"]),
    (lambda: rod().friction("f", coefficient=0.1), ["'f'", "bodies=, at= and radius="]),
    (lambda: setattr(rod(), "gravity", (0, 0, 1)), ["gravity", "2 numbers"]),
    (lambda: nc.simulate(rod().compile(), np.linspace(0, 1, 3)), ["'rod'", "nothing in it has a mass", "mass="]),
    (lambda: nc.simulate(rod(mass=1.0).compile(), np.array([1.0, 0.0])), ["time t must grow"]),
    (lambda: nc.simulate(rod(mass=1.0).compile(), np.linspace(0, 1, 3), method="euler"), ["method='euler'"]),
    (
        lambda: nc.simulate(rod(mass=1.0).compile(), np.linspace(0, 1, 3), rates={"Q": 1.0}),
        ["rates", "no point or coordinate 'Q'"],
    ),
    (lambda: nc.simulate(swing(), TIMES, {"Q": (1, 0)}), ["state: no point or coordinate 'Q'", "O, P"]),
    (lambda: nc.simulate(swing(), TIMES, {"P.y": "up"}), ["state of 'P.y' must be a number"]),
    (lambda: nc.simulate(swing(), TIMES, {"P.x": 3.0}), ["'rod'", "no start with P.x = 3", "state="]),
    (lambda: nc.simulate(swing(), TIMES, rates=[1.0]), ["rates are numbers by name"]),
    (
        lambda: nc.simulate(swing(), TIMES, inputs={"P.x": lambda t: 1.0 - t, "P.y": lambda t: t}),
        ["too many inputs", "'rod' has 1 degree of freedom", "P.x, P.y", "Leave 1 of them out"],
    ),
    (
        lambda: nc.simulate(swing(), TIMES, inputs={"P.x": lambda t: 1.0 - t}, method="rk4", step=0.05),
        ["inputs P.x cannot be prescribed where the motion begins", "dead point"],
    ),
    (lambda: nc.simulate(swing().replace({"arm.mass": -1.0}), TIMES), ["'arm' has a mass of -1"]),
    (lambda: nc.simulate(swing().replace({"arm.mass": 0.0}), TIMES), ["has no inertia", "P.y", "'arm' has no mass"]),
]


@pytest.mark.parametrize(("make", "words"), SAID)
def test_message(make, words):
    with pytest.raises(nc.JaxncError) as caught:
        make()
    for word in words:
        assert word in str(caught.value), str(caught.value)


def test_a_bar_in_space_refuses_axial_inertia():
    m = nc.Mechanism("bar", dim=3)
    m.point("P", (0, 0, 0))
    m.point("Q", (1, 0, 0))
    m.body("bar", ["P", "Q"], mass=1.0, com=(0.5, 0, 0), inertia=(0.1, 0.2, 0.2))
    with pytest.raises(nc.MechanismError, match=r"'bar'.*five freedoms.*0\.1"):
        m.compile()


def test_a_motion_without_inertia_is_named():
    """Seen on the null space: P and Q have no mass of their own, yet only the second bar's motion has no inertia."""
    m = rod(mass=1.0)
    m.point("Q", (2, 0.5))
    m.body("loose", ["P", "Q"])
    system = m.compile()
    for ask in (
        lambda: nc.simulate(system, np.linspace(0, 1, 3)),
        lambda: nc.linearise(system),
        lambda: nc.linearise(system, coordinates=["P.y", "Q.x"]),
    ):
        with pytest.raises(nc.InputError, match=r"no inertia.*Q\.[xy].*'loose'.*mass"):
            ask()


def test_inconsistent_velocities_are_corrected_and_said():
    m = rod(mass=1.0)
    run = nc.simulate(m.compile(), np.linspace(0, 0.1, 3), rates={"P": (0.3, 2.0)}, method="rk4", step=0.01)
    assert np.allclose(run.velocity("P")[0], [0.0, 2.0], atol=1e-12)
    assert float(run.correction[1]) == pytest.approx(0.3, rel=1e-6)
    assert "start corrected by    0 (pose), 0.3 (rates)" in run.report()


def gust(t, state, p):
    """A force that grows without bounds at one time and is no number from another on."""
    return jnp.array([0.0, 1.0]) * (p["size"] / (t - 0.47) ** 2 + jnp.where(t < p["end"], 0.0, jnp.nan))


@pytest.mark.parametrize(
    ("size", "end", "said"),
    [
        (0.0, 0.5, r"'rod'.* t = 0\.[45]\d*.*'gust'.*finite"),
        (1.0, 2.0, r"t = 0\.4[67].*P\.x = .*'generalised alpha'"),
    ],
)
def test_where_and_why_a_simulation_broke_off(size, end, said):
    m = rod(mass=1.0)
    m.force("gust", "P", gust, {"size": size, "end": end})
    with pytest.raises(nc.AssemblyError, match=said):
        nc.simulate(m.compile(), TIMES)


def test_a_simulation_that_came_apart_says_so():
    """The rod's end is taken further than the rod is long."""
    with pytest.raises(nc.AssemblyError, match=r"broke off.*constraints.*reach"):
        nc.simulate(swing(), TIMES, inputs={"P.y": lambda t: 0.5 + t}, method="rk4", step=0.05)


def test_a_force_that_is_no_number_from_the_start_is_said_at_once():
    """A state that is no number has no step that could be made shorter: once a million were tried, for 90 s."""
    m = rod(mass=1.0)
    m.force("gust", "P", gust, {"size": 0.0, "end": -1.0})
    begin = time.process_time()
    with pytest.raises(nc.AssemblyError, match=r"t = 0 s.*'gust'.*not finite"):
        nc.simulate(m.compile(), TIMES)
    assert time.process_time() - begin < 30.0


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda s: nc.simulate(s, TIMES, state=1.0), r"state is an earlier pose.*got 1\.0"),
        (lambda s: nc.simulate(s, TIMES, state=np.zeros(3)), "state is an earlier pose"),
        (lambda s: nc.simulate(s, TIMES, method="rk4", step="1e-3"), "step= .*positive.*'1e-3'"),
        (lambda s: nc.linearise(s, "rest"), "state is an earlier pose.*'rest'"),
        (lambda s: nc.equilibrium(s, hold="P.x"), "hold= takes values by name.*'P.x'"),
        (lambda s: nc.reactions(s), r"reactions.*motion with rates.*System"),
        (lambda s: nc.dynamics.kinetic_energy(s), "those of a motion, got System"),
        (
            lambda s: nc.inverse_dynamics(s, nc.sweep(nc.library.four_bar().compile(), {"phi": TIMES}, {"phi": 1.0})),
            "'four-bar'.*'rod'.*other coordinates",
        ),
    ],
)
def test_slips_with_forces(ask, said):
    with pytest.raises(nc.InputError, match=said):
        ask(swing())


def test_an_equilibrium_says_where_and_whether_it_is_stable():
    m = rod(mass=1.0)
    m.angle("phi", at="O", to="P")
    m.gravity = (0, -9.81)
    rest = nc.equilibrium(m.compile(), state={"phi": -1.0})
    assert repr(rest) == "Equilibrium('rod': stable, at phi = -1.5708)"


def test_what_is_no_equilibrium_is_not_called_stable():
    m = nc.Mechanism("four-bar")
    a, d, b, c = m.ground("A", (0, 0)), m.ground("D", (0.4, 0)), m.point("B", (0, 0.1)), m.point("C", (0.33, 0.29))
    m.body("crank", [a, b], mass=0.5)
    m.body("coupler", [b, c], lengths={(b, c): 2.0})  # far too long
    m.body("rocker", [c, d])
    m.angle("phi", at=a, to=b)
    m.gravity = (0, -9.81)
    found = nc.equilibrium(m.compile(), throw=False)
    assert found.motion.status != 0 and not found.stable
    assert "none was found" in repr(found)


def test_a_motion_without_inertia_has_no_frequencies():
    m = nc.Mechanism("springs in series")
    m.ground("A", (0, 0)), m.point("B", (0, -0.3)), m.point("C", (0, -0.7))
    m.spring("upper", "A", "B", stiffness=100.0, free=0.3), m.spring("lower", "B", "C", stiffness=200.0, free=0.3)
    m.point_mass("bob", "C", 2.0)
    m.gravity = (0, -9.81)
    system = m.compile()
    for ask in (nc.linearise, lambda s, q: nc.simulate(s, TIMES, q.motion)):
        with pytest.raises(nc.InputError, match=r"no inertia.*it moves B\.x"):
            ask(system, nc.equilibrium(system))
