"""Every public function that takes a system, with the system passed and closed over, in every transformation."""

import dataclasses
import functools
import inspect

import jax
import jax.numpy as jnp
import mechanisms
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.system.equations import equations

X = -0.9  # the pendulum's angle
T = np.linspace(0.0, 0.1, 3)
CLOSE = 1e-9  # of numbers of size one: the same operations in another order


@functools.cache
def pendulum():
    return mechanisms.pendulum().compile()


def posed(s, x):
    return nc.solve_position(s, {"phi": x}, rates={"phi": 1.0}, throw=False)


@functools.cache
def hanging():
    return posed(pendulum(), X)


def moving(s, x):
    """A motion that nobody has to solve for: the pendulum where its angle is x, turning."""
    size = jnp.sqrt(jnp.sum(s.parameters.points[1] ** 2))
    place, ahead = size * jnp.array([jnp.cos(x), jnp.sin(x)]), size * jnp.array([-jnp.sin(x), jnp.cos(x)])
    q, v = (jnp.concatenate([jnp.zeros(2), p, jnp.reshape(a, 1)]) for p, a in ((place, x), (ahead, jnp.ones(()))))
    return dataclasses.replace(hanging(), system=s, poses=q, rates=(v,), asked=jnp.reshape(x, 1))


def test_a_pose_that_is_written_down_is_the_solved_one():
    written, solved = moving(pendulum(), X), hanging()
    np.testing.assert_allclose(written.q, solved.q, atol=1e-12)
    np.testing.assert_allclose(written.rates[0], solved.rates[0], atol=1e-12)


def closing(s, x):
    """The closed residual of a pose that is off."""
    equations = nc.system.closed(s, {"phi": x})
    return equations.residual(whole(s)[2:4] * (1.0 + 0.1 * x))


def swinging(s, x):
    """Accelerations of the pendulum where its angle is x."""
    field = nc.dynamics.vector_field(s)
    return field(0.0, field.start({"phi": x}, {"phi": 1.0}))[1]


derived = jax.jit(equations)  # as the package has it: operation by operation they are 50 programs in each cell


def whole(s):
    """All coordinates at some pose, in plain arithmetic."""
    return jnp.array([0.0, 0.0, 0.6, -0.8, 0.1]) * s.parameters.points[1, 0] / 0.6


# What a function says of a system and an angle, as an array; and the cells of the matrix that its compile time allows:
# each has both ways of holding the system, every transformation is met by several.
EVERY = tuple(
    f"{way} {name}" for way in ("closed", "passed") for name in ("jit", "nc.jit", "vmap", "map", "grad", "jvp")
)
FEW = ("closed jit", "passed vmap", "closed map", "passed grad")
FEWEST = ("closed jit", "passed vmap")
# Of what takes longest to compile, passed and mapped where more is asked of it: in dynamics/test_dynamics_balance.py
# (batches of linearisations, and of equilibria with derivatives), test_dynamics_motion.py (a batch is a loop) and
# test_vector_field.py (vmap over designs).
ONE = ("closed jit",)
FUNCTIONS = {
    "residual": (lambda s, x: nc.system.residual(s, whole(s), {"phi": x}), EVERY),
    "jacobian": (lambda s, x: nc.system.jacobian(s, whole(s) * x), EVERY),
    "closed": (lambda s, x: closing(s, x), EVERY),
    "equations": (lambda s, x: derived(s).constants[0] * x, EVERY),
    "total_mass": (lambda s, x: nc.dynamics.total_mass(s) * x, EVERY),
    "mass_matrix": (lambda s, x: nc.dynamics.mass_matrix(s)[0] * x, FEW),
    "solve_position": (lambda s, x: posed(s, x).q, FEW),
    "sweep": (lambda s, x: nc.sweep(s, {"phi": jnp.array([-1.0, -0.95]) + x}).q, FEWEST),
    "motion": (lambda s, x: nc.motion(s, {"phi": lambda t: x + t}, T).q, FEWEST),
    "kinetic_energy": (lambda s, x: nc.dynamics.kinetic_energy(moving(s, x)), FEWEST),
    "potential_energy": (lambda s, x: nc.dynamics.potential_energy(moving(s, x)), FEWEST),
    "centre_of_mass": (lambda s, x: nc.dynamics.centre_of_mass(moving(s, x)), FEWEST),
    "momentum": (lambda s, x: nc.dynamics.momentum(moving(s, x)), FEWEST),
    "angular_momentum": (lambda s, x: nc.dynamics.angular_momentum(moving(s, x)), FEWEST),
    "inverse_dynamics": (lambda s, x: nc.inverse_dynamics(s, at_rest(s, x)).efforts, FEWEST),
    "linearise": (lambda s, x: nc.linearise(s, moving(s, x)).stiffness, ONE),
    "simulate": (lambda s, x: nc.simulate(s, T, {"phi": x}, method="rk4").q, ONE),
    "vector_field": (lambda s, x: swinging(s, x), ONE),
    "equilibrium": (lambda s, x: nc.equilibrium(s, {"phi": x}).motion.q, ONE),
}
QUICK = ("residual", "closed", "jacobian", "equations", "total_mass", "kinetic_energy")
# Answered on the host: an iteration whose length is not known, a text, a file. With numbers that are not known they
# refuse; closed over they are answered while something else is traced.
HOST = {
    "mobility": lambda s: nc.mobility(s).dof,
    "travel": lambda s: nc.travel(s, "phi").closed,
    "circuit": lambda s: nc.circuit(s, "phi").failures,
    "circuits": lambda s: len(nc.circuits(s, {"phi": np.linspace(0.0, 1.0, 3)})),
    "diagnose": lambda s: nc.diagnose(s, {"phi": 0.3}).assembles,
    "modes": lambda s: len(nc.modes(s, {"phi": 0.3})),
    "sensitivity": lambda s: nc.sensitivity(s, "B", {"phi": 0.3}),
    "grashof": lambda s: nc.grashof(s, "crank", "coupler", "rocker").margin,
    "tolerance": lambda s: nc.tolerance(s, {"phi": 0.3}, "B", {"A": 0.1}),
    "calibrate": lambda s: nc.synthesis.calibrate(s, {"phi": 0.3}, {"B": 0.1}, ["A"]),
    "report": lambda s: len(nc.report(s).verdict.errors),
    "stream": lambda s: nc.stream(s, {"phi": np.zeros(3)}, "never.npz"),
}
OTHERS = (  # of a motion, a mechanism, a file, a function
    "axodes cache centrodes dexterity energy_balance flip_margin formulate from_mjcf from_urdf "
    "grashof_type instant_centre instant_centres instant_motion jit load load_csv load_npz outline "
    "path_curvature reactions robust shard suspension suspension_report transmission_angle widget"
)


def at_rest(s, x):
    return nc.solve_position(s, {"phi": x}, rates={"phi": 1.0}, accelerations={"phi": 0.0}, throw=False)


def vars_of(package):
    found = ((name, getattr(package, name)) for name in package.__all__)
    return [(name, thing) for name, thing in found if inspect.isfunction(thing)]


def test_every_public_function_stands_in_a_list():
    homes = (nc, nc.dynamics, nc.io, nc.kinematics, nc.system, nc.vehicle)
    found = {name: getattr(home, name) for home in homes for name in home.__all__}
    found |= {name: thing for name, thing in vars_of(nc.synthesis) if "system" in inspect.signature(thing).parameters}
    functions = {name for name, thing in found.items() if inspect.isfunction(thing)}
    assert functions | {"equations"} == set(FUNCTIONS) | set(HOST) | set(OTHERS.split())


@functools.cache
def plain(name):
    f, s = FUNCTIONS[name][0], pendulum()
    return np.stack([np.asarray(f(s, x)) for x in (X, X - 0.1)])


def close(got, wanted):
    assert np.allclose(got, wanted, rtol=0, atol=CLOSE * max(1.0, np.abs(wanted).max()))


def along(f, s, x):
    """The derivative in one direction by central differences."""
    return (np.asarray(f(s, x + 1e-5)) - np.asarray(f(s, x - 1e-5))) / 2e-5


CELLS = [
    pytest.param(name, cell, id=f"{name} {cell}", marks=[] if name in QUICK else [pytest.mark.slow])
    for name, (_, cells) in FUNCTIONS.items()
    for cell in cells
]


@pytest.mark.parametrize(("name", "cell"), CELLS)
def test_with_the_system_closed_over_and_passed(name, cell):
    f, s, wanted = FUNCTIONS[name][0], pendulum(), plain(name)
    way, transformation = cell.split()
    two = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), s)
    closed = way == "closed"
    if transformation in ("jit", "nc.jit"):
        jit = jax.jit if transformation == "jit" else nc.jit
        close(jit(lambda x: f(s, x))(X) if closed else jit(f)(s, X), wanted[0])
    elif transformation == "vmap":
        xs = jnp.array([X, X - 0.1])
        close(jax.vmap(lambda x: f(s, x))(xs) if closed else jax.vmap(f)(two, xs), wanted)
    elif transformation == "map":
        xs = jnp.array([X, X - 0.1])
        close(jax.lax.map(lambda x: f(s, x), xs) if closed else jax.lax.map(lambda a: f(*a), (two, xs)), wanted)
    else:
        # With respect to the angle where the system is closed over; to both where it is passed, and no less then.
        if transformation == "grad":
            slopes = jax.grad(lambda s, x: jnp.sum(f(s, x)), argnums=(1,) if closed else (0, 1))(s, X)
            slope = slopes[-1]
            if not closed:
                assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(slopes[0]))
        elif closed:
            slope = jnp.sum(jax.jvp(lambda x: f(s, x), (X,), (1.0,))[1])
        else:
            slope = jnp.sum(jax.jvp(f, (s, X), (jax.tree.map(jnp.zeros_like, s), 1.0))[1])
        assert float(slope) == pytest.approx(float(np.sum(along(f, s, X))), rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("name", HOST)
def test_what_is_answered_on_the_host_says_so(name):
    for transform in (jax.jit, nc.jit, lambda f: lambda s: jax.vmap(f)(jax.tree.map(lambda leaf: leaf[None], s))):
        with pytest.raises(nc.InputError, match=rf"^{name}.*traced.*call it before.*close over"):
            transform(lambda s: jnp.asarray(HOST[name](s)))(pendulum())


@pytest.mark.parametrize("name", ["mobility", "travel"])
def test_what_is_answered_on_the_host_is_answered_closed_over(name):
    s = pendulum()
    assert bool(jax.jit(lambda x: x * HOST[name](s))(1)) == bool(HOST[name](s))


def test_angles_are_taken_in_degrees_and_degrees_by_mistake_are_doubted():
    system = nc.library.four_bar().compile()
    turn = np.linspace(0.0, 360.0, 37)
    motion = nc.sweep(system, {"phi": turn}, rates={"phi": 90.0}, accelerations={"phi": -180.0}, unit="deg")
    other = nc.sweep(system, {"phi": np.radians(turn)}, rates={"phi": np.pi / 2}, accelerations={"phi": -np.pi})
    np.testing.assert_allclose(motion.q, other.q, rtol=0, atol=1e-14)
    for order in (0, 1):
        np.testing.assert_allclose(motion.rates[order], other.rates[order], rtol=0, atol=1e-12)
    pose = nc.solve_position(system, {"phi": 90}, unit="deg")
    np.testing.assert_allclose(pose["B"], [0.0, 0.04], atol=1e-14)
    slope = jax.jacfwd(lambda a: nc.solve_position(system, {"phi": a}, unit="deg")["B"])(90.0)
    np.testing.assert_allclose(slope, [-0.04 * np.pi / 180.0, 0.0], atol=1e-14)
    crank = nc.library.slider_crank().compile()
    c = nc.solve_position(crank, {"phi": 40.0}, unit="deg")
    again = nc.solve_position(crank, {"C.x": float(c["C"][0])}, unit="deg", start=c)  # lengths stay lengths
    np.testing.assert_allclose(again.q, c.q, atol=1e-12)
    begun = {"phi": 100.0}  # a start counts without a range, too
    round_from = nc.circuit(system, "phi", poses=5, start=begun, unit="deg")
    np.testing.assert_allclose(round_from["phi"][0], np.radians(100.0), atol=1e-12)
    for ask in (lambda u: nc.sweep(system, {"phi": turn}, unit=u), lambda u: nc.circuit(system, "phi", unit=u)):
        with pytest.raises(nc.InputError, match=r"unit='grad'.*'rad'.*'deg'"):
            ask("grad")
    with pytest.warns(UserWarning, match=r"'phi'.*whole numbers.*unit='deg'"):
        nc.sweep(system, {"phi": np.linspace(0.0, 360.0, 361)})
    many = 40 * np.pi * np.linspace(0.0, 1.0, 2001)  # twenty turns that are meant
    assert int(nc.sweep(system, {"phi": many}).failures) == 0


DEGREE = np.pi / 180.0


def test_motions_in_time_take_degrees_too():
    system = nc.library.four_bar().compile()
    t, steps = np.linspace(0.0, 1.0, 5), 90.0 + 5.0 * np.arange(5.0)
    other = nc.motion(system, {"phi": lambda t: np.pi / 2 + 20 * DEGREE * t}, t)
    for given in (lambda t: 90.0 + 20.0 * t, (steps, 20.0, 0.0)):
        motion = nc.motion(system, {"phi": given}, t, unit="deg")
        for a, b in ((motion.q, other.q), *zip(motion.rates, other.rates, strict=True)):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)
    ends = nc.circuit(system, "phi", (90.0, 120.0), poses=3, unit="deg")["phi"]
    np.testing.assert_allclose(np.degrees(ends[np.array([0, -1])]), [90.0, 120.0], atol=1e-9)
    assert str(nc.diagnose(system, {"phi": 90.0}, unit="deg")) == str(nc.diagnose(system, {"phi": np.pi / 2}))
    start = {"phi": 80.0}  # a guess by name is in degrees as well
    by_name = nc.solve_position(system, {"phi": 90.0}, start=start, unit="deg")
    np.testing.assert_allclose(by_name.q, other.q[0], atol=1e-12)
    with pytest.warns(UserWarning, match="whole numbers from 0 to 360.*unit='deg'"):
        nc.motion(system, {"phi": (np.arange(361.0), 1.0, 0.0)}, np.arange(361.0))
    with pytest.warns(UserWarning, match="whole numbers from 0 to 360.*unit='deg'"):
        nc.solve_position(system, {"phi": np.arange(361.0)})


def test_dynamics_takes_degrees_by_name():
    system, t = pendulum(), T  # as above, where their programs are compiled
    run = nc.simulate(system, t, {"phi": 30.0}, {"phi": 90.0}, method="rk4", unit="deg")
    other = nc.simulate(system, t, {"phi": 30.0 * DEGREE}, {"phi": 90.0 * DEGREE}, method="rk4")
    np.testing.assert_allclose(run.q, other.q, rtol=0, atol=1e-12)
    driven = nc.simulate(system, t, inputs={"phi": lambda t: 200.0 + 100.0 * t}, method="rk4", unit="deg")
    np.testing.assert_allclose(driven["phi"], (200.0 + 100.0 * t) * DEGREE, atol=1e-12)
    held = nc.equilibrium(system, hold={"phi": 60.0}, unit="deg")
    assert float(held.reactions.effort("phi")) == pytest.approx(9.81 * 0.5 * 0.5)
    steady = nc.linearise(system, {"phi": -90.0}, unit="deg")
    assert float(steady.frequencies[0]) == pytest.approx(np.sqrt(1.5 * 9.81))


def test_degrees_are_shown_where_one_asks_for_them(tmp_path):
    motion = nc.sweep(nc.library.four_bar().compile(), {"phi": np.linspace(0.5, 1.0, 5)}, rates={"phi": 1.0})
    own = motion.system.topology.angle_unit
    for unit, sign in (("deg", "°"), ("rad", "rad")):
        axes = motion.plot("phi", "velocity phi", against="phi", unit=unit).axes
        assert [ax.get_ylabel().rpartition(" ")[2] for ax in axes] == [f"[{sign}]", f"[{sign}/s]"]
        assert axes[-1].get_xlabel() == f"φ [{sign}]"
        factor = 180.0 / np.pi if unit == "deg" else 1.0
        np.testing.assert_allclose(axes[0].lines[0].get_ydata(), factor * np.asarray(motion["phi"]))
        header, first = (
            line.split(",") for line in motion.to_csv(tmp_path / "a.csv", unit=unit).read_text().splitlines()[:2]
        )
        at = header.index(f"v(phi) [{unit}/s]")
        assert float(first[at]) == pytest.approx(factor * float(motion.velocity("phi")[0]))
        assert f'"degrees":{str(unit == "deg").lower()}' in motion.to_html(tmp_path / "a.html", unit=unit).read_text()
    assert motion.plot("phi").axes[0].get_ylabel() == f"φ [{'°' if own == 'deg' else own}]"
    with pytest.raises(nc.InputError, match="unit='turns'"):
        motion.plot("phi", unit="turns")
