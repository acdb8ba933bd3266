"""The account of a motion's energy: against closed forms, and with an error put in on purpose."""

import dataclasses
import json

import jax.numpy as jnp
import numpy as np
import pytest
from pages import unpacked
from PIL import Image, ImageSequence

import jaxnc as nc
from jaxnc.dynamics import energy_balance
from jaxnc.viz.poses import poses

MASS, RATE, PUSH, SPEED, RUB, G = 2.0, 3.0, 0.7, 1.5, 0.25, 9.81  # kg, N s/m, N, m/s


def block(rubs: bool) -> nc.System:
    """A mass on a level guide, pushed and slowed down."""
    m = nc.Mechanism("block")
    m.point("P", (0, 0), fixed="y")
    m.point_mass("mass at P", "P", MASS)
    m.gravity = (0, -G)
    m.force("force on P", "P", (PUSH, 0.0))
    m.damper("slow", "P.x", damping=RATE)
    if rubs:
        m.friction("rub", coefficient=RUB, joint="P", speed=1e-6)
    return m.compile()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e7])
def test_an_account_in_any_unit_of_time_and_with_32_bits(unit):
    """A link whose damped angle rises as ``2 t + t²``: the damper takes ``∫ c φ'² dt``."""
    m = nc.Mechanism("link")
    m.ground("A", (0, 0))
    m.point("B", (0.1, 0))
    m.body("link", ["A", "B"], mass=0.5)
    m.angle("phi", at="A", to="B")
    m.damper("d", "phi", damping=0.1 / unit)
    t = np.linspace(0, 1, 33) * unit
    run = nc.motion(m.compile(dtype="float32"), {"phi": lambda t: 2 * t / unit + (t / unit) ** 2}, t)
    found = energy_balance(run)
    assert found.dissipated[-1] * unit**2 == pytest.approx(0.1 * 4 * (1 + 1 + 1 / 3), rel=1e-4)
    assert found.relative < 1e-4


def test_a_free_motion_against_its_closed_form():
    """v = v∞ + (v₀ - v∞) exp(-c t / m), with v∞ = F / c: what the force gave and the damper took follow by hand."""
    t = np.linspace(0, 1, 21)
    run = nc.simulate(block(False), t, rates={"P.x": SPEED})
    found = run.balance
    end, decay = PUSH / RATE, np.exp(-RATE * t / MASS)
    more = SPEED - end
    place = end * t + more * MASS / RATE * (1 - decay)
    speed = end + more * decay
    taken = RATE * (
        end**2 * t + 2 * end * more * MASS / RATE * (1 - decay) + more**2 * MASS / (2 * RATE) * (1 - decay**2)
    )
    assert np.abs(found.loads - PUSH * place).max() <= 1e-9
    assert np.abs(found.dissipated - taken).max() <= 1e-9
    assert np.abs(found.kinetic - 0.5 * MASS * speed**2).max() <= 1e-8
    assert not found.inputs.any() and not found.friction.any() and not found.potential.any()
    assert found.largest <= 1e-9 and found.relative == found.largest / found.exchanged
    assert found.exchanged == pytest.approx(max(taken[-1], 0.5 * MASS * (SPEED**2 - speed[-1] ** 2)))
    lines = run.report().splitlines()
    assert lines[3] == f"  work                  {PUSH * place[-1]:.6g} J by loads, {-taken[-1]:.6g} J by dampers"
    assert lines[4].startswith("  energy balance        off by at most ") and "J exchanged" in lines[4]
    # An error is seen as what it is: two states whose speed is a tenth too high.
    v = np.asarray(run.rates[0])
    faulty = dataclasses.replace(run, rates=(np.where(np.arange(21)[:, None] >= 19, 1.1 * v, v), run.rates[1]))
    jump = faulty.balance.error
    assert np.abs(jump[:18]).max() <= 1e-9
    assert jump[-1] == pytest.approx(-0.5 * MASS * 0.21 * speed[-1] ** 2, rel=0.1)


def test_an_error_is_a_part_of_the_energy_that_is_there():
    """A balanced rotor goes on turning, and exchanges nothing: what is left over is no part of that."""
    m = nc.Mechanism("rotor")
    m.ground("O", (0, 0)), m.point("P", (1, 0)), m.angle("phi", at="O", to="P")
    m.body("wheel", ["O", "P"], mass=1.0, com=(0, 0), inertia=0.5)
    found = nc.simulate(m.compile(), np.linspace(0, 1, 11), rates={"phi": 3.0}).balance
    assert found.largest < 1e-9 and found.relative == pytest.approx(found.largest / (0.5 * 0.5 * 3.0**2))
    assert found.sentence.endswith("of the 2.25 J of kinetic energy")


def test_a_driven_motion_against_its_closed_form():
    """P.x = t² + t: the input pays for the mass, the damper and the friction, and the force helps."""
    t = np.linspace(0, 1, 21)
    found = energy_balance(nc.motion(block(True), {"P.x": lambda t: t * t + t}, t))
    x, v = t * t + t, 2 * t + 1
    damped = RATE * (v**3 - 1) / 6
    assert np.abs(found.friction - RUB * MASS * G * x).max() <= 1e-9
    assert np.abs(found.dissipated - damped).max() <= 1e-9
    wanted = 0.5 * MASS * (v**2 - 1) + damped + RUB * MASS * G * x - PUSH * x
    assert np.abs(found.inputs - wanted).max() <= 1e-9
    assert found.largest <= 1e-9


def test_times_too_few_to_sum_over_are_said():
    m = nc.Mechanism("pendulum")
    m.ground("O", (0, 0))
    m.point("P", (1, 0))
    m.body("bar", ["O", "P"], mass=1.0)
    m.angle("phi", at="O", to="P")
    m.gravity = (0, -G)
    m.torque("buzz", "phi", lambda t, state, p: jnp.sin(40.0 * t))
    t = np.linspace(0, 1, 5)
    run = nc.simulate(m.compile(), t)
    assert "keep more than 5 times to sum work over" in run.report()
    with pytest.raises(nc.InputError, match=r"one motion in time: of simulate\(\)"):
        energy_balance(nc.sweep(run.system, {"phi": t}, rates={"phi": 1.0}))


def test_an_impact_between_two_times_is_no_error_of_the_motion():
    """A ball falls on a stiff stop for 4 ms: 24 times see nothing of it, 47 some; what is missing is the sum's."""
    m = nc.Mechanism("ball")
    m.point("P", (0, 1), fixed="x")
    m.point_mass("mass at P", "P", 1.3)
    m.gravity = (0, -G)
    m.stop("floor", "P.y", stiffness=1e6, lower=0.0, restitution=0.8, speed=np.sqrt(2 * G))
    system = m.compile()
    for count in (24, 47):
        found = energy_balance(nc.simulate(system, np.linspace(0, 0.46, count)))
        assert found.largest > 1.0 and "only" in found.sentence and f"more than {count} times" in found.sentence
    assert np.isfinite(energy_balance(nc.simulate(system, np.linspace(0, 0.44, 12))).doubt)  # which ends before it


def content(page) -> dict:
    return json.loads(page.read_text().split('id="data">')[1].split("</script>")[0])


def test_friction_feels_a_load_at_its_own_time(tmp_path):
    """A block is drawn evenly while it is pressed on ever harder: its input meets μ (m g + F(t))."""
    m = nc.Mechanism("block")
    m.point("P", (0, 0), fixed="y")
    m.point_mass("mass at P", "P", MASS)
    m.gravity = (0, -G)
    m.force("press", "P", lambda t, state, p: jnp.array([0.0, -10.0 * t]))
    m.friction("rub", coefficient=RUB, joint="P", speed=1e-6)
    t = np.linspace(0, 1, 11)
    run = nc.simulate(m.compile(), t, inputs={"P.x": lambda t: 2.0 * t})
    found = nc.reactions(run)
    assert np.abs(found.effort("P.x") - RUB * (MASS * G + 10.0 * t)).max() <= 1e-9
    data = content(run.to_html(tmp_path / "a.html", forces=found))  # what was found is plotted in the page
    usual = [row["symbol"] for row in data["series"]]
    assert usual[:3] == ["energy", "kinetic energy", "potential energy"]
    more = content(
        run.to_html(tmp_path / "b.html", plots="velocity P.x", forces=found)
    )  # what is asked for comes first
    assert [row["symbol"] for row in more["series"]] == ["velocity of P.x", *usual]
    assert more["first"] == len(more["scalars"])
    shown = next(row for row in data["series"] if row["symbol"] == "effort P.x")
    assert shown["unit"] == "N"
    np.testing.assert_allclose(unpacked(shown["values"], 11), RUB * (MASS * G + 10.0 * t), rtol=1e-6)
    drawn = {a["noun"]: a for a in data["arrows"]}  # and drawn to scale, where it acts
    for noun, force in (("weight", -MASS * G + 0.0 * t), ("applied", -10.0 * t)):
        ((foot, tip),) = drawn[noun]["shafts"]
        columns = [*data["points"], *data["tips"]]
        assert columns[foot]["name"] == "P"
        arrow = unpacked(columns[tip]["y"], 11) - unpacked(columns[foot]["y"], 11)
        np.testing.assert_allclose(arrow / drawn[noun]["scale"], force, atol=2e-4 * MASS * G)
    with pytest.raises(nc.InputError, match="expected True, or what inverse_dynamics"):
        run.to_html(tmp_path / "b.html", forces="weight")
    other = nc.sweep(nc.library.four_bar().compile(), {"phi": np.array([1.0, 1.1])})
    with pytest.raises(nc.InputError, match="another motion"):
        other.to_html(tmp_path / "b.html", forces=found)
    assert np.abs(run.balance.friction - RUB * (MASS * G * 2.0 * t + 10.0 * t * t)).max() <= 1e-9
    assert run.balance.largest <= 1e-9


def test_forces_and_energies_are_plotted_by_name(tmp_path):
    """The block of the free motion: its names, their units, and what the curves hold."""
    t = np.linspace(0, 1, 21)
    run = nc.simulate(block(False), t, rates={"P.x": SPEED})
    figure = run.plot("kinetic energy", "load slow", "load force on P", "velocity P.x")
    assert figure.axes[0].get_ylabel() == "kinetic energy [J]"
    speed = np.asarray(run.velocity("P"))[:, 0]
    curves = {line.get_gid(): np.asarray(line.get_ydata()) for ax in figure.axes for line in ax.lines}
    np.testing.assert_allclose(curves["kinetic energy"], 0.5 * MASS * speed**2, rtol=1e-12)
    np.testing.assert_allclose(curves["load slow"], -RATE * speed, rtol=1e-12)
    with pytest.raises(nc.InputError, match="such as 'reaction B on coupler'"):
        run.plot("reaction P")
    slow, quick = (poses(dataclasses.replace(run, time=factor * t)).pace for factor in (1.0, 0.05))
    assert (slow, quick) == (1.0, 0.01)
    film = run.animate(tmp_path / "a.gif", size=(2.0, 1.5), dpi=40)
    with Image.open(film) as image:
        shown = [frame.info["duration"] for frame in ImageSequence.Iterator(image)]
    assert sum(shown) == 1040  # one second and its last frame's, whatever frames are alike
