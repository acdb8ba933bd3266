"""What a user is promised beside the motion itself: events, stops, driven inputs with their reactions."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc

G = 9.81


@functools.cache
def rod():
    """A rod of 2 kg and 1 m that hangs from O, with a stop at 20° to the right."""
    m = nc.Mechanism("rod")
    m.ground("O", (0, 0))
    m.point("P", (0, -1))
    m.body("rod", ["O", "P"], mass=2.0)
    m.angle("phi", at="O", to="P")
    m.gravity = (0, -G)
    m.stop("wall", "phi", stiffness=1e5, upper=-np.pi / 2 + np.deg2rad(20))
    return m.compile()


def test_an_event_ends_the_motion_where_it_changes_sign():
    """The rod falls from the level: when it comes to the bottom is an elliptic integral."""
    from scipy.special import ellipk

    start = {"phi": -np.pi}
    run = nc.simulate(rod(), np.linspace(0, 1, 11), state=start, event=lambda t, state: state["P"][0], rtol=1e-10)
    quarter = ellipk(0.5) / np.sqrt(1.5 * G)
    assert float(run.end) == pytest.approx(quarter, rel=1e-8)
    after = np.asarray(run.time) > quarter
    assert (np.asarray(run.status)[after] == int(nc.Status.STOPPED)).all() and not np.asarray(run.status)[~after].any()
    assert np.allclose(np.asarray(run["P"])[after], [0, -1], atol=1e-7)
    assert "times not reached" in run.report()


def test_a_stop_turns_the_rod_back_and_keeps_its_energy():
    """Pressed in by x: I ω²/2 = k x²/2, less what the weight takes."""
    run = nc.simulate(rod(), np.linspace(0, 0.6, 121), state={"phi": -np.pi / 2}, rates={"phi": 3.0}, rtol=1e-9)
    phi = np.asarray(run["phi"])
    wall = -np.pi / 2 + np.deg2rad(20)
    deep = np.sqrt((2 / 3 * 9.0 - 2 * G * (1 - np.cos(np.deg2rad(20)))) / 1e5)
    assert deep * 0.3 <= phi.max() - wall <= deep * 1.01
    assert run.velocity("phi")[-1] < 0 and float(run.drift) <= 1e-6 * 3.0


BLOCK, SPEED, LEFT = 1.7, 2.0, 0.6  # a block against a stop: mass, speed, and the part of it that is to be left


@functools.cache
def block():
    m = nc.Mechanism("block")
    m.ground("O", (0, 0))
    m.point("P", (1, 0), fixed="y")
    m.point_mass("mass at P", "P", BLOCK)
    m.distance("s", "O", "P")
    m.stop("wall", "s", stiffness=4e4, lower=0.5, restitution=LEFT, speed=SPEED)
    return m.compile()


def test_a_stop_gives_back_the_part_of_the_speed_that_was_asked_for():
    """At the speed it was asked for exactly; at others by Hunt and Crossley's m v dv = -(k + c v) x dx."""
    from scipy.optimize import brentq

    damping = float(block()["wall.damping"])

    def leaving(v):
        def left(u):  # ∫ v dv / (k + c v) between the two crossings of x = 0
            a, b = damping * v / 4e4, damping * u / 4e4
            return a - np.log1p(a) + b + np.log1p(-b)

        return brentq(left, 1e-6 * v, min(v, 4e4 / damping * (1 - 1e-12)))

    assert leaving(SPEED) == pytest.approx(LEFT * SPEED, rel=1e-9)
    for v in (SPEED, 0.5):
        run = nc.simulate(block(), np.array([0.0, 1.5]), rates={"s": -v}, rtol=1e-9, first=1e-3)
        assert float(run.velocity("s")[-1]) == pytest.approx(leaving(v), rel=1e-6)


def test_a_hard_stop_is_an_event_and_a_new_start():
    """A ball dropped from h: it is down after √(2h/g), and with 0.8 of its speed rises to 0.64 h."""
    m = nc.Mechanism("ball")
    m.point("P", (0, 1.0))
    m.point_mass("mass at P", "P", 0.3)
    m.gravity = (0, -G)
    system = m.compile()
    fall = np.sqrt(2 / G)
    t = np.array([0.0, 0.2, 1.0])
    down = nc.simulate(system, t, event=on_the_ground)
    assert float(down.end) == pytest.approx(fall, rel=1e-9)
    hit = down.pose(-1)
    assert float(hit.velocity("P")[1]) == pytest.approx(-G * fall, rel=1e-9)
    again = nc.simulate(
        system, t, state=hit, rates={"P": (0.0, -0.8 * float(hit.velocity("P")[1]))}, event=on_the_ground
    )
    assert float(again["P"][1, 1]) == pytest.approx(0.8 * G * fall * 0.2 - G * 0.02, rel=1e-8)
    assert float(again.end) == pytest.approx(2 * 0.8 * fall, rel=1e-8)  # not where it starts, though it touches there


def on_the_ground(t, state):
    """The height of a ball that falls; one that rises cannot hit."""
    return jnp.where(state.velocity("P")[1] < 0, state["P"][1], 1.0)


def test_a_driven_input_takes_the_effort_that_inverse_dynamics_gives():
    """The angle follows a function of time; what is left over is the same motion that kinematics gives."""

    def law(t):
        return -np.pi / 2 + 0.2 * t**2

    t = np.linspace(0, 0.5, 6)
    run = nc.simulate(rod(), t, inputs={"phi": law}, method="rk4", step=0.05)
    assert np.allclose(run["phi"], law(t), atol=1e-12)
    assert np.allclose(run.acceleration("phi"), 0.4, atol=1e-12)
    assert np.allclose(run["P"], np.column_stack([np.cos(law(t)), np.sin(law(t))]), atol=1e-12)
    # The ground's force on the rod by Newton's law for its centre, without any multiplier.
    up, w = np.column_stack([np.cos(law(t)), np.sin(law(t))]), 0.4 * t
    across = np.column_stack([-up[:, 1], up[:, 0]])
    force = 2.0 * (0.5 * 0.4 * across - 0.5 * (w**2)[:, None] * up) + [0, 2.0 * G]
    effort = nc.inverse_dynamics(rod(), nc.motion(rod(), {"phi": law}, t))["phi"]
    assert np.allclose(effort, 2.0 / 3 * 0.4 + 2.0 * G * 0.5 * np.cos(law(t)), atol=1e-10)
    assert np.allclose(nc.reactions(run).support("O"), force, atol=1e-9)


def test_freedoms_beside_a_driven_one_start_with_the_least_kinetic_energy():
    """A trolley that is driven takes its rope along: ``θ' = -L·∂T/∂ẋθ̇ / ∂T/∂θ̇²`` by hand, with its derivative."""
    speed, rope, load = 0.8, 0.5, 2.0
    m = nc.Mechanism("crane")
    m.point("T", (5.0, 0.0), fixed="y"), m.point("W", (5.3, -2.0))
    m.body("rope", ["T", "W"], mass=rope), m.point_mass("load", "W", load)
    m.angle("th", at="T", to="W")
    system, length = m.compile(), np.hypot(0.3, 2.0)

    def turning(mass):
        design = system.replace({"load.mass": mass})
        run = nc.simulate(design, np.array([0.0, 1e-3]), inputs={"T.x": lambda t: 5.0 + speed * t})
        return run.velocity("th")[0]

    def by_hand(mass):
        return 2.0 / length * (rope / 2 + mass) * length * speed / ((rope / 3 + mass) * length**2) * -1.0

    found, change = jax.jvp(turning, (load,), (1.0,))
    assert float(found) == pytest.approx(by_hand(load), rel=1e-12)
    slope = (by_hand(load + 1e-6) - by_hand(load - 1e-6)) / 2e-6
    assert float(change) == pytest.approx(slope, rel=1e-6)


@pytest.mark.parametrize("crank", [2.0, None])
def test_a_start_that_does_not_assemble_or_is_told_twice_is_refused(crank):
    m = nc.Mechanism("four-bar")
    m.ground("A", (0, 0)), m.ground("D", (0.4, 0)), m.point("B", (0, 0.1)), m.point("C", (0.33, 0.29))
    m.body("crank", ["A", "B"], mass=0.5, lengths=None if crank is None else {("A", "B"): crank})
    m.body("coupler", ["B", "C"], mass=1.2), m.body("rocker", ["C", "D"], mass=1.0)
    m.angle("phi", at="A", to="B"), m.angle("psi", at="D", to="C")
    system, times = m.compile(), np.linspace(0.0, 0.1, 3)
    if crank is None:
        with pytest.raises(nc.InputError, match=r"phi, psi are 2 values.*1 freedom"):
            nc.simulate(system, times, state={"phi": 1.0, "psi": 0.2})
        return
    for ask in (nc.linearise, nc.equilibrium, lambda s: nc.simulate(s, times, throw=False)):
        with pytest.raises(nc.AssemblyError, match=r"drawing does not assemble.*C-D is off by"):
            ask(system)
