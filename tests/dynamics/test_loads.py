"""Forces of springs, dampers, actuators and inputs by name, and multipliers by row, against closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.forces import DAMPER, SPRING

G = 9.81
TIMES = np.linspace(0.0, 0.6, 4)


@pytest.fixture(scope="module")
def pendulum():
    """A rod of 1 kg with a bob of 2 kg, and everything that can act on it; one friction is called as a spring."""
    m = nc.Mechanism("loaded pendulum")
    m.ground("O", (0, 0))
    m.ground("S", (0, 1))
    m.point("P", (0.3, -0.8))
    m.body("rod", ["O", "P"], mass=1.0)
    m.point_mass("mass at P", "P", 2.0)
    m.gravity = (0, -G)
    m.angle("phi", at="O", to="P")
    m.spring("rope", "S", "P", stiffness=30.0, free=1.0, cubic=4.0, preload=2.0)
    m.damper("oil", "P", "S", damping=3.0, quadratic=0.5)
    m.spring("coil", "phi", stiffness=2.0, free=0.1)
    m.force("pull", "P", (1.0, 2.0))
    m.force("wind", "P", lambda t, state, p: jnp.stack([p * t, 0.0 * t]), 3.0)
    m.torque("motor", "phi", lambda t, state, p: -p * state.velocity("phi"), 0.3)
    m.load("air", lambda t, q, v, p: -p * v, 0.1)
    m.apply("twist", nc.forces.COUPLE, points=["O", "P"], parameters={"value": 0.7})
    m.friction("rope", coefficient=0.2, bodies=("rod", "ground"), at="O", radius=0.02)
    return m.compile()


@pytest.fixture(scope="module")
def run(pendulum):
    return nc.motion(pendulum, {"phi": lambda t: -1.2 + 2.0 * t + 3.0 * t**2}, TIMES)


def test_every_load_is_asked_for_by_name(run):
    found = nc.reactions(run)
    place, speed = np.asarray(run["P"]), np.asarray(run.velocity("P"))
    phi, spin, t = np.asarray(run["phi"]), np.asarray(run.velocity("phi")), TIMES
    apart = place - [0, 1]
    length = np.linalg.norm(apart, axis=1)
    u, x = (apart * speed).sum(1) / length, length - 1.0
    rope, oil = 2 + 30 * x + 4 * x**3, 3 * u + 0.5 * u * abs(u)
    coil, ones = -2 * (phi - 0.1), np.ones(len(t))
    expected = {
        "force rope": (rope, -rope * u),
        "oil": (oil, -oil * u),
        "coil": (coil, coil * spin),
        "pull": (np.outer(ones, [1.0, 2.0]), speed @ [1.0, 2.0]),
        "wind": (np.outer(3 * t, [1.0, 0.0]), 3 * t * speed[:, 0]),
        "motor": (-0.3 * spin, -0.3 * spin**2),
        "twist": (0.7 * ones, 0.7 * spin),
    }
    for name, (value, power) in expected.items():
        load = found.load(name)
        np.testing.assert_allclose(load.value, value, rtol=0, atol=1e-12, err_msg=name)
        np.testing.assert_allclose(load.power, power, rtol=0, atol=1e-12, err_msg=name)
    rates = np.asarray(run.rates[0])
    np.testing.assert_allclose(found.load("air").value, -0.1 * rates, atol=1e-14)
    np.testing.assert_allclose(found.load("air").power, -0.1 * (rates**2).sum(1), atol=1e-14)
    pin = np.linalg.norm(np.asarray(found.at("O", on="rod").force), axis=1)
    rubbed = -0.2 * 0.02 * pin * np.abs(spin * np.tanh(spin * 0.02 / 1e-3))
    np.testing.assert_allclose(found.load("friction rope").power, rubbed, rtol=1e-9)


def test_powers_of_all_loads_are_the_rate_of_kinetic_energy(run):
    found = nc.reactions(run)
    names = ("force rope", "oil", "coil", "pull", "wind", "motor", "twist", "air", "friction rope")
    given = sum(np.asarray(found.load(name).power) for name in names)
    given = given + np.asarray(found.effort("phi")) * np.asarray(run.velocity("phi"))
    (x, y), (_, fall), (ax, ay) = _states(run)
    squared, spin = x**2 + y**2, np.asarray(run.velocity("phi"))
    turn = (x * ay - y * ax) / squared  # a rod of 1 kg has a third of its length squared about its end, a bob the whole
    gravity = -G * (2.0 + 0.5) * fall
    np.testing.assert_allclose(given + gravity, (2.0 + 1.0 / 3.0) * squared * turn * spin, rtol=1e-9, atol=1e-9)


def _states(run):
    at = [run.system.topology.position[f"P.{axis}"] for axis in "xy"]
    return [np.asarray(part)[:, at].T for part in (run.q, run.rates[0], run.rates[1])]


@pytest.mark.slow
def test_an_input_of_a_simulation_or_an_equilibrium_has_its_effort():
    m = nc.Mechanism("driven rod")
    m.ground("O", (0, 0))
    m.point("P", (0.5, 0))
    m.body("rod", ["O", "P"], mass=3.0)
    m.angle("phi", at="O", to="P")
    m.spring("coil", "phi", stiffness=2.0, free=0.1)
    m.gravity = (0, -G)
    system = m.compile()

    def needed(phi, turn):
        return 3.0 * 0.25 / 3 * turn + 3.0 * G * 0.25 * np.cos(phi) + 2.0 * (phi - 0.1)

    rest = nc.equilibrium(system, hold={"phi": -1.0}).reactions
    assert float(rest.effort("phi")) == pytest.approx(needed(-1.0, 0.0), rel=1e-12)
    assert float(rest.efforts[0]) == pytest.approx(needed(-1.0, 0.0), rel=1e-12)
    driven = nc.reactions(nc.simulate(system, TIMES, inputs={"phi": lambda t: 2 * t**2}, method="rk4", step=1e-2))
    np.testing.assert_allclose(driven.effort("phi"), needed(2 * TIMES**2, 4.0), rtol=1e-9)
    np.testing.assert_allclose(driven.efforts[:, 0], needed(2 * TIMES**2, 4.0), rtol=1e-9)


def test_multipliers_by_row_are_the_forces_in_bars():
    m = nc.Mechanism("hanging chain")
    m.ground("O", (0, 0))
    m.point("P", (0, -0.5))
    m.point("Q", (0, -0.8))
    m.body("upper", ["O", "P"], mass=1.0)
    m.body("lower", ["P", "Q"], mass=2.0)
    m.gravity = (0, -G)
    system = m.compile()
    found = nc.equilibrium(system).reactions
    rows = found.rows()
    assert list(rows) == list(system.topology.rows)
    assert list(found.rows("lower")) == [name for name in rows if name.startswith("lower: ")]
    jacobian = np.asarray(nc.system.jacobian(system, found.motion.q))
    at = [system.topology.position[f"{point}.y"] for point in "PQ"]
    upper, lower = (-jacobian[k, at] * float(value) for k, value in enumerate(rows.values()))
    # A uniform rod hands half of its weight to each end: the lower row lifts Q by that, the upper one P by the rest.
    np.testing.assert_allclose(lower, [-G, G], atol=1e-9)
    np.testing.assert_allclose(upper[0], G * (0.5 + 1.0 + 1.0), atol=1e-9)


def test_legs_of_a_platform_carry_its_weight():
    m = nc.library.stewart_platform()
    drawn = {**m.model.ground, **m.model.points}
    ends = [[np.array(getattr(drawn[f"{side}{k}"], "at", drawn[f"{side}{k}"])) for side in "AB"] for k in range(1, 7)]
    centre = np.mean([b for _, b in ends], axis=0) + np.array([0.02, 0.01, 0.0])
    m.mass("platform", mass=6.0, com=tuple(centre), inertia=(1.0, 1.0, 1.0, 0, 0, 0))
    m.gravity = (0, 0, -G)
    lengths = [float(np.linalg.norm(b - a)) for a, b in ends]
    inputs = {f"s{k}": (lambda t, s=s: s + 0.0 * t) for k, s in enumerate(lengths, 1)}
    motion = nc.motion(m.compile(), inputs, np.array([0.0, 1.0]))
    found = nc.reactions(motion)
    along = [(b - a) / s for (a, b), s in zip(ends, lengths, strict=True)]
    balance = [np.concatenate([e, np.cross(b - centre, e)]) for (_, b), e in zip(ends, along, strict=True)]
    thrust = np.linalg.solve(np.transpose(balance), [0, 0, 6.0 * G, 0, 0, 0])
    np.testing.assert_allclose([found.effort(f"s{k}")[0] for k in range(1, 7)], thrust, rtol=1e-9)


@pytest.mark.slow
def test_a_tension_has_its_derivative():
    m = nc.Mechanism("sprung rod")
    m.ground("O", (0, 0))
    m.ground("S", (1, 1))
    m.point("P", (1, 0))
    m.body("rod", ["O", "P"], mass=1.0)
    m.angle("phi", at="O", to="P")
    m.spring("rope", "S", "P", stiffness=30.0, free=0.4)
    times = np.array([0.0, 0.1])

    @nc.jit
    @jax.value_and_grad
    def tension(s):
        return nc.reactions(nc.motion(s, {"phi": lambda t: 0.2 + t}, times)).load("rope").value[1]

    value, slope = tension(m.compile())
    length = np.sqrt(2.0 + 1.0 - 2 * np.sqrt(2.0) * np.cos(np.pi / 4 - 0.3))  # law of cosines
    assert float(value) == pytest.approx(30.0 * (length - 0.4), rel=1e-10)
    assert float(slope["rope.stiffness"]) == pytest.approx(length - 0.4, rel=1e-10)


def test_a_load_on_all_coordinates_shows_the_coordinates_of_the_system():
    m = nc.Mechanism("plate", dim=3)
    m.ground("O", (0, 0, 0))
    m.ground_vector("k", (0, 0, 1))
    m.ground("S", (1, 1, 0))
    m.point("P", (1, 0, 0))
    m.body("plate", ["O", "P"], vectors=["k"], mass=1.0, shape="box", size=(1.0, 0.1, 0.1))  # has a hidden vector
    m.angle("phi", at="O", to="P", start="S", about="k")
    m.load("air", lambda t, q, v, p: -p * v, 0.1)
    motion = nc.motion(m.compile(), {"phi": lambda t: -0.5 + t}, np.array([0.0, 0.1]))
    rates = np.asarray(motion.rates[0])
    assert rates.any()
    np.testing.assert_allclose(nc.reactions(motion).load("air").value, -0.1 * rates, atol=1e-14)


def test_what_is_not_there_is_refused_by_name(run):
    found = nc.reactions(run)
    with pytest.raises(nc.InputError, match="has no load 'rop'; did you mean 'rope'"):
        found.load("rop")
    with pytest.raises(nc.InputError, match=r"'rods'.*did you mean 'rod'"):
        found.rows("rods")
    with pytest.raises(nc.InputError, match=r"'psi'.*did you mean 'phi'"):
        found.effort("psi")


def test_a_pose_that_is_held_far_from_the_drawing_is_found_on_its_branch():
    m = nc.library.four_bar()
    m.mass("crank", mass=1.0)
    m.gravity = (0, -G)
    system = m.compile()
    phi = 4.0
    rest = nc.equilibrium(system, hold={"phi": phi})
    there = nc.solve_position(system, {"phi": phi})
    assert int(there.status) == 0
    np.testing.assert_allclose(rest.motion.q, there.q, atol=1e-12)
    half = 0.5 * float(np.asarray(rest["B"])[0] - np.asarray(rest["A"])[0])
    assert float(rest.reactions.effort("phi")) == pytest.approx(G * half, rel=1e-9)


def bushing(free: float = 0.0) -> nc.Mechanism:
    """A mass of 2 kg at the foot of a spring of 200 N/m with a damper beside it."""
    m = nc.Mechanism("bushing")
    m.ground("O", (0, 0))
    m.point("P", (0, 0))
    m.point_mass("block", "P", 2.0)
    m.spring("k", "O", "P", stiffness=200.0, free=free)
    return m


def test_a_spring_without_length_is_stiff_all_around():
    """A mass on it swings with sqrt(k / m) any way; the spring's foot and its free length carry it along."""
    m = bushing()
    system = m.compile()
    rest = nc.equilibrium(system)
    assert rest.stable
    np.testing.assert_allclose(nc.linearise(system, rest).frequencies, [10, 10], rtol=1e-9)
    foot = jax.grad(lambda s: nc.equilibrium(s)["P"][1])(system)
    np.testing.assert_allclose(foot["O"], [0, 1], atol=1e-9)
    for pull in (9.81, 1e-6):
        m.gravity = (0, -pull)
        system = m.compile()
        hung = nc.equilibrium(system, method="minimum")
        np.testing.assert_allclose(hung["P"], [0, -pull / 100], atol=1e-12)
        lower = jax.grad(lambda s: nc.equilibrium(s)["P"][1])(system)
        assert float(lower["k.free"]) == pytest.approx(-1.0, abs=1e-6)


def test_a_damper_without_length_slows_what_leaves_it():
    """A damped swing in a straight line through the foot of both."""
    m = bushing()
    m.damper("c", "O", "P", damping=1.0)
    system = m.compile()
    found = nc.linearise(system, nc.equilibrium(system)).eigenvalues
    np.testing.assert_allclose(np.real(found), [-0.25] * 4, atol=1e-9)
    t, fast = np.linspace(0, 1, 5), np.sqrt(100 - 1 / 16)
    run = nc.simulate(system, t, rates={"P.x": 1.0})
    np.testing.assert_allclose(run["P"][:, 0], np.exp(-t / 4) * np.sin(fast * t) / fast, atol=1e-8)


@pytest.mark.parametrize("place", [(0.3, -0.4), (1e-9, 0.0), (0.0, 0.0)])
@pytest.mark.parametrize("free", [0.0, 0.2])
def test_forces_and_their_slopes_by_hand(place, free):
    """Along the segment, or where it has no length along the rate, ``c v + q v |v|`` and ``k x + h x³``."""
    p, rate, zero = np.array([(0, 0), place]), np.array([0.5, 2.0]), np.zeros((0,))
    length, c = np.hypot(*place), jnp.array([3.0, 0.7])
    along = p[1] / length if length else rate / np.hypot(*rate)

    def damps(r):
        rates = jnp.stack([0 * r, r])
        return DAMPER.dissipation(jnp.array(p), zero, zero, rates, zero, zero, c)

    v = along @ rate
    np.testing.assert_allclose(jax.grad(damps)(jnp.array(rate)), (3 * v + 0.7 * v * abs(v)) * along, rtol=1e-12)
    still = 3.0 * (np.outer(along, along) if length else np.eye(2))
    np.testing.assert_allclose(jax.hessian(damps)(jnp.zeros(2)), still, atol=1e-12)
    x = length - free
    pull = jax.grad(lambda at: SPRING.potential(jnp.stack([0 * at, at]), zero, zero, jnp.array([5.0, free, 0.0, 2.0])))
    expected = (5 * x + 2 * x**3) * along if length else np.zeros(2)
    np.testing.assert_allclose(pull(jnp.array(place)), expected, rtol=1e-9, atol=1e-12)
