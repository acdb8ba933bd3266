"""Coulomb friction against closed forms: a block on a slope that sticks and slips, a journal that runs down, energy."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc

G = 9.81


def block(pull: float) -> nc.System:
    """A block of 2 kg on a level guide, pulled by a constant force; μ = 0.3, so that it holds up to 5.886 N."""
    m = nc.Mechanism("block")
    m.point("P", (0, 0), fixed="y")
    m.point_mass("mass at P", "P", 2.0)
    m.gravity = (0, -G)
    m.force("force on P", "P", (pull, 0.0))
    m.friction("rub", coefficient=0.3, joint="P", speed=1e-4)
    return m.compile()


def test_a_block_sticks_below_the_limit_and_slips_above():
    t = np.linspace(0, 1, 6)
    held = nc.simulate(block(5.0), t, method="kvaerno5", rtol=1e-8)
    assert 0 <= held["P"][-1, 0] <= 1.3e-4  # it creeps at a part of the smoothing speed
    slips = nc.simulate(block(10.0), t, method="kvaerno5", rtol=1e-8)
    a = (10.0 - 0.3 * 2.0 * G) / 2.0
    assert float(slips.velocity("P")[-1, 0]) == pytest.approx(a, rel=1e-3)
    assert nc.reactions(slips).support("P")[-1, 1] == pytest.approx(2.0 * G, rel=1e-12)


def test_a_journal_runs_down_by_the_friction_of_its_pin():
    """A balanced wheel on a pin that carries its weight: dω/dt = -μ r m g / I, also where the pin is a ground point."""
    m = nc.Mechanism("wheel")
    m.ground("O", (0, 0))
    m.point("P", (0.2, 0))
    m.body("wheel", ["O", "P"], mass=3.0, com=(0, 0), inertia=0.05)
    m.angle("phi", at="O", to="P")
    m.gravity = (0, -G)
    m.friction("journal", coefficient=0.1, bodies=("wheel", "ground"), at="O", radius=0.02, speed=1e-4)
    run = nc.simulate(m.compile(), np.linspace(0, 0.5, 6), rates={"phi": 20.0}, rtol=1e-9)
    slowing = 0.1 * 0.02 * 3.0 * G / 0.05
    assert np.allclose(run.velocity("phi"), 20.0 - slowing * np.asarray(run.time), rtol=1e-6)
    pin = nc.reactions(run).at("O", on="wheel")
    # The wheel's centre rests: the pin carries the weight, and the friction's moment.
    assert np.asarray(pin.moment) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("coefficient", [0.1, 0.4, 0.8])
def test_a_wide_pin_of_a_short_crank_takes_the_torque_of_its_balance(coefficient):
    """An eccentric of 10 mm on a pin of 40 mm radius, 100 N at the slider; the rod's balance is solved by SciPy.

    A pass of repetition would leave 4 times the coefficient of the error there.
    """
    from scipy.optimize import brentq

    e, radius, length, speed, w, phi = 0.01, 0.04, 0.12, 0.01, 10.0, 1.0
    m = nc.Mechanism("eccentric")
    m.ground("O", (0, 0))
    m.point("B", (e, 0)), m.point("C", (e + length, 0), fixed="y")
    m.body("crank", ["O", "B"]), m.body("rod", ["B", "C"])
    m.angle("phi", at="O", to="B")
    m.force("load", "C", (-100.0, 0))
    m.friction("pin", coefficient=coefficient, bodies=("crank", "rod"), at="B", radius=radius, speed=speed)
    system = m.compile()
    result = nc.inverse_dynamics(system, nc.motion(system, {"phi": lambda t: phi + w * t}, np.array([0.0, 0.01])))
    x, y = e * np.cos(phi), e * np.sin(phi)
    reach = np.sqrt(length**2 - y**2)
    rubs = -coefficient * radius * np.tanh((-w * x / reach - w) * radius / speed)  # for each unit of force
    across = brentq(lambda n: reach * n - 100.0 * y + rubs * np.hypot(100.0, n), -1e4, 1e4)
    torque = rubs * np.hypot(100.0, across) - x * across - 100.0 * y
    assert float(result["phi"][0]) == pytest.approx(torque, rel=1e-9)
    np.testing.assert_allclose(result.reactions.at("B", on="rod").force[0], [100.0, -across], rtol=1e-9)


def test_lost_energy_is_the_work_of_the_friction():
    """Slider-crank with a rubbing slider and a rubbing pin between two moving bodies: power balance at every time."""
    m = nc.Mechanism("slider-crank")
    m.ground("O", (0, 0))
    m.point("A", (0.06, 0.08))
    m.point("B", (0.06 + np.sqrt(0.09 - 0.0064), 0), fixed="y")
    m.body("crank", ["O", "A"], mass=0.5)
    m.body("conrod", ["A", "B"], mass=0.8)
    m.point_mass("mass at B", "B", 1.2)
    m.angle("phi", at="O", to="A")
    m.gravity = (0, -G)
    m.friction("guide", coefficient=0.2, joint="B", speed=1e-3)
    m.friction("pin", coefficient=0.3, bodies=("crank", "conrod"), at="A", radius=0.01)
    system = m.compile()
    run = nc.simulate(system, np.linspace(0, 0.4, 9), rates={"phi": 20.0}, rtol=1e-9)
    from jaxnc.dynamics.model import dynamics, forces

    dyn = dynamics(system)
    r = nc.reactions(run)
    for k in (2, 5, 8):
        q, v, a = run.q[k], run.rates[0][k], run.rates[1][k]
        gained = float(v @ dyn.mass @ a - v @ forces(dyn, jnp.zeros(()), q, v))
        normal = abs(float(r.support("B")[k, 1]))
        slide = float(run.velocity("B")[k, 0])
        w = [float(run.angular_velocity(b)[k]) for b in ("crank", "conrod")]
        lost = 0.2 * normal * slide * np.tanh(slide / 1e-3)
        # The pin's force by Newton's law on the conrod and slider together, without any multiplier.
        point = [np.asarray(run.acceleration(n)[k]) for n in "AB"]
        rubbing = -0.2 * normal * np.tanh(slide / 1e-3)
        pin = 0.8 * (point[0] + point[1]) / 2 + 1.2 * point[1] + np.array([-rubbing, 2.0 * G - normal])
        lost += 0.3 * 0.01 * np.linalg.norm(pin) * (w[0] - w[1]) * np.tanh((w[0] - w[1]) * 0.01 / 1e-3)
        assert gained == pytest.approx(-lost, rel=1e-6)


def test_joints_in_space_rub_as_in_the_plane():
    """A wheel on a hinge and a globe on a ball, a bead and a block on sloping lines.

    dω/dt = -μ r m g / I about the axis that it turns about, and d²s/dt² = g (sin α - μ cos α).
    """
    slope, m = np.deg2rad(40), nc.Mechanism("wheel, globe, bead and block", dim=3)
    along, up = np.array([np.cos(slope), 0, -np.sin(slope)]), (np.sin(slope), 0, np.cos(slope))
    for name, y in (("O", 0), ("G", 1), ("H", 2), ("B", 3)):
        m.ground(name, (0, y, 0))
    m.ground_vector("h", (0, 1, 0))
    m.ground_vector("line", along)
    m.vector("u", (1, 0, 0))
    m.body("wheel", ["O"], vectors=["h", "u"], mass=3.0, com=(0, 0, 0), inertia=(0.03, 0.05, 0.03))
    m.vector("e", (1, 0, 0))
    m.vector("f", (0, 1, 0))
    m.body("globe", ["B"], vectors=["e", "f"], mass=3.0, com=(0, 3, 0), inertia=(0.05, 0.05, 0.05))
    m.point("P", (0.1 * along[0], 1, 0.1 * along[2]))
    m.vector("w", (0, 1, 0))
    m.body("bead", ["P"], vectors=["line", "w"], mass=2.0, shape="sphere", size=0.1)
    m.cylindrical("rail", line=("G", "line"), on="P")
    m.point("Q", (0.1 * along[0], 2, 0.1 * along[2]))
    m.vector("n", up)
    m.body("block", ["Q"], vectors=["line", "n"], mass=1.5, shape="sphere", size=0.1)
    m.prismatic("guide", line=("H", "line"), on="Q", directions=("h", "n"))
    m.gravity = (0, 0, -G)
    m.friction("journal", coefficient=0.1, bodies=("wheel", "ground"), at="O", radius=0.02, speed=1e-4)
    m.friction("socket", coefficient=0.2, bodies=("ground", "globe"), at="B", radius=0.02, speed=1e-4)
    m.friction("rubbing", coefficient=0.3, joint="rail", speed=1e-4)
    m.friction("dragging", coefficient=0.5, joint="guide", speed=1e-4)
    system = m.compile()
    t = np.linspace(0, 0.5, 6)
    spin = 20.0 * np.array([1, 2, 2]) / 3
    start = {"u": (0, 0, -20.0), "P": 0.5 * along, "Q": 0.5 * along}
    start |= {"e": np.cross(spin, [1, 0, 0]), "f": np.cross(spin, [0, 1, 0])}
    run = nc.simulate(system, t, rates=start, method="rk4", step=2e-3)
    slowing = 0.02 * 3.0 * G / 0.05
    assert np.allclose(run.angular_velocity("wheel")[:, 1], 20.0 - 0.1 * slowing * t, rtol=1e-7)  # RK4's error
    assert np.allclose(run.angular_velocity("globe"), np.outer(1 - 0.2 * slowing * t / 20.0, spin), rtol=1e-6)
    for point, ground, friction in (("P", (0, 1, 0), 0.3), ("Q", (0, 2, 0), 0.5)):
        a = G * (np.sin(slope) - friction * np.cos(slope))
        gone = np.linalg.norm(np.asarray(run[point]) - ground, axis=1) - 0.1
        assert np.allclose(gone, 0.5 * t + 0.5 * a * t**2, rtol=1e-9), point
    # What the energy loses: the work of all four.
    turned = [20.0 * t - 0.5 * c * slowing * t**2 for c in (0.1, 0.2)]
    slid = [0.5 * t + 0.5 * G * (np.sin(slope) - c * np.cos(slope)) * t**2 for c in (0.3, 0.5)]
    lost = 0.02 * 3.0 * G * (0.1 * turned[0] + 0.2 * turned[1])
    lost += G * np.cos(slope) * (0.3 * 2.0 * slid[0] + 0.5 * 1.5 * slid[1])
    assert np.allclose(run.energy[0] - run.energy, lost, rtol=2e-6, atol=1e-9)
