"""Rows on velocities that positions do not see, against closed forms: Chaplygin's sleigh, a disc in steady rolling."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc

ROLLED = 1e-9  # what RK4 leaves at the steps that are used here
LEVER, MASS, INERTIA = 0.3, 2.0, 0.5  # of the sleigh: blade to centre of mass, kg, kg m²
AHEAD, SPIN = 0.7, 1.2  # its speed along the blade and its rate of turning at the start


def sleigh_of(**skate):
    m = nc.Mechanism("sleigh")
    m.point("P", (0, 0))
    m.point("Q", (1, 0))
    m.body("sled", ["P", "Q"], mass=MASS, com=(LEVER, 0), inertia=INERTIA)
    m.skate("blade", "P", ("P", "Q"))
    m.angle("phi", at="P", to="Q")
    return m


@functools.cache
def sleigh():
    return sleigh_of().compile()


def chaplygin(t):
    """Speed along the blade, rate of turning and heading: u̇ = a ω², ω̇ = -k u ω, by hyperbolic functions."""
    k = MASS * LEVER / (INERTIA + MASS * LEVER**2)
    c = np.sqrt(AHEAD**2 + LEVER / k * SPIN**2)
    s = c * k * t + np.arctanh(AHEAD / c)
    heading = 2 / np.sqrt(k * LEVER) * (np.arctan(np.tanh(s / 2)) - np.arctan(np.tanh(s[0] / 2)))
    return c * np.tanh(s), c * np.sqrt(k / LEVER) / np.cosh(s), heading


@functools.cache
def gliding():
    rates = {"P": (AHEAD, 0.0), "phi": SPIN}
    return nc.simulate(sleigh(), np.linspace(0, 4, 21), rates=rates, method="rk4", step=4e-3)


def test_chaplygins_sleigh():
    run = gliding()
    ahead, spin, heading = chaplygin(np.asarray(run.time))
    d = np.asarray(run["Q"] - run["P"])
    assert np.abs(np.sum(run.velocity("P") * d, axis=1) - ahead).max() <= ROLLED
    assert np.abs(run.velocity("phi") - spin).max() <= ROLLED
    assert np.abs(np.unwrap(np.arctan2(d[:, 1], d[:, 0])) - heading).max() <= ROLLED
    assert float(run.drift) <= ROLLED
    slip = d[:, 0] * run.velocity("P")[:, 1] - d[:, 1] * run.velocity("P")[:, 0]
    assert np.abs(slip).max() <= 1e-14
    assert not run.balance.inputs.any()  # the blade drives nothing


def test_the_blade_holds_what_the_centre_of_mass_takes():
    run = gliding()
    ahead, spin, _ = chaplygin(np.asarray(run.time))
    k = MASS * LEVER / (INERTIA + MASS * LEVER**2)
    side = MASS * (ahead * spin - LEVER * k * ahead * spin)  # m (u ω + a ω̇)
    d = np.asarray(run["Q"] - run["P"])
    across = np.column_stack([-d[:, 1], d[:, 0]])
    for found in (nc.reactions(run), nc.inverse_dynamics(sleigh(), run).reactions):
        wrench = found.joint("blade", on="sled", about="P")
        assert np.abs(wrench.force - side[:, None] * across).max() <= 1e-8
        assert np.abs(wrench.moment).max() <= 1e-8


def test_a_driven_heading_makes_the_sleigh_run_on():
    """Turned at a constant rate ω the sleigh obeys u̇ = a ω²: what its heading is driven by takes m a (u ω) more."""
    t = np.linspace(0, 1, 6)
    run = nc.simulate(
        sleigh(), t, rates={"P": (AHEAD, 0.0)}, inputs={"phi": steadily}, method="rk4", step=4e-3
    )  # fmt: skip
    ahead = AHEAD + LEVER * SPIN**2 * t
    d = np.asarray(run["Q"] - run["P"])
    assert np.abs(np.sum(run.velocity("P") * d, axis=1) - ahead).max() <= ROLLED
    torque = nc.inverse_dynamics(sleigh(), run)["phi"]
    assert np.abs(torque - MASS * LEVER * ahead * SPIN).max() <= 1e-8


def steadily(t):
    return SPIN * t


R, H, M, G = 0.3, 0.02, 2.0, 9.81  # radius, thickness and mass of the disc
LEAN, TURNING = 1.1, 1.5  # angle of its axis to the vertical, and rate at which it goes round


def rolling_disc_of():
    """A disc in steady rolling: mechanism, radius of the circle, rates at the start.

    With the axis u at an angle θ to the vertical and the precession Ω, the spin ω about u follows from
    ``(C + m r²) Ω ω sin θ - A Ω² sin θ cos θ + m g r cos θ = 0`` (angular momentum about the centre, no slip).
    """
    axial, across = M * R**2 / 2, M * (3 * R**2 + H**2) / 12
    s, c = np.sin(LEAN), np.cos(LEAN)
    spin = (across * TURNING**2 * s * c - M * G * R * c) / ((axial + M * R**2) * TURNING * s)
    circle = -R * spin / TURNING
    n, x = np.array([0.0, 0, 1]), np.array([1.0, 0, 0])
    u, up = s * x + c * n, s * n - c * x
    centre, turning = circle * x + R * s * n, TURNING * n + (spin - TURNING * c) * u
    m = nc.Mechanism("coin", dim=3)
    m.ground("O", (0, 0, 0))
    m.ground_vector("n", n)
    m.point("C", centre)
    m.vector("u", u)
    m.vector("w", up + 0.4 * u)
    m.body("coin", ["C"], vectors=["u", "w"], mass=M, shape="cylinder", size=(R, H))
    m.rolling_disc("rim", "C", axis="u", mark="w", plane=("O", "n"))
    m.gravity = (0, 0, -G)
    w = (up + 0.4 * u) / np.linalg.norm(up + 0.4 * u)
    rates = {"C": TURNING * np.cross(n, centre), "u": np.cross(turning, u), "w": np.cross(turning, w)}
    return m, circle, rates


@pytest.mark.slow
def test_a_disc_rolls_round_a_circle():
    m, circle, rates = rolling_disc_of()
    system = m.compile()
    t = np.linspace(0, 2, 11)
    run = nc.simulate(system, t, rates=rates, method="rk4", step=1e-3)
    x = np.column_stack([np.cos(TURNING * t), np.sin(TURNING * t), 0 * t])
    assert np.abs(run["C"] - circle * x - np.array([0, 0, R * np.sin(LEAN)])).max() <= ROLLED
    assert np.abs(run["u"] - np.sin(LEAN) * x - np.array([0, 0, np.cos(LEAN)])).max() <= ROLLED
    assert float(run.correction[1]) <= 1e-12 and float(run.drift) <= ROLLED
    # The ground at the point of contact, m a + m g, and its moment about the centre.
    push = -M * TURNING**2 * circle * x + np.array([0, 0, M * G])
    wrench = nc.reactions(run).joint("rim", on="coin")
    assert np.abs(wrench.force - push).max() <= 1e-7
    arm = R * (np.cos(LEAN) * x - np.array([0, 0, np.sin(LEAN)]))
    assert np.abs(wrench.moment - np.cross(arm, push)).max() <= 1e-7


def test_counts():
    m, _, _ = rolling_disc_of()
    found = nc.mobility(m.compile())
    assert (found.dof, found.velocities, len(found.slips)) == (5, 3, 2)
    assert "3 freedoms of velocity" in str(found) and "rim: slip across" in str(found)
    found = nc.mobility(sleigh())
    assert (found.dof, found.velocities) == (3, 2)
    assert sleigh().degrees_of_freedom == 3


def belt(p, v, s, dp, dv, ds, c):
    return (dp[0][0] - c[0],)


BELT = nc.constraints.RateKind(
    "belt", belt, ("speed of the belt",), points=1, constants=("speed",), drawn=lambda *_: (0.0,)
)


def test_a_kind_of_ones_own_with_a_given_speed(tmp_path):
    m = nc.Mechanism("parcel")
    m.point("P", (0, 1))
    m.point_mass("mass at P", "P", 3.0)
    m.constrain("belt", BELT, points=["P"], constants={"speed": 0.4})
    m.gravity = (0.2, -G)
    system = m.compile()
    t = np.linspace(0, 1, 5)
    run = nc.simulate(system, t, method="rk4", step=0.1)
    assert np.abs(run["P"] - np.column_stack([0.4 * t, 1 - G * t**2 / 2])).max() <= 1e-12
    faster = nc.simulate(system.replace({"belt.speed": 0.9}), t, method="rk4", step=0.1)
    assert float(faster["P"][-1, 0]) == pytest.approx(0.9, abs=1e-12)
    m.save(tmp_path / "parcel.toml", kinds={"belt": BELT})
    again = nc.load(tmp_path / "parcel.toml", kinds={"belt": BELT}).compile()
    assert again.topology.rate_rows == system.topology.rate_rows


def test_files_keep_skates_and_discs(tmp_path):
    for m in (sleigh_of(), rolling_disc_of()[0]):
        m.save(tmp_path / "m.toml")
        again = nc.load(tmp_path / "m.toml")
        assert again.model.joints == m.model.joints
        assert again.compile().topology.rates == m.compile().topology.rates


def test_a_sweep_goes_where_rolling_allows_it_and_velocities_are_checked():
    system = sleigh()
    poses = {"P.x": np.linspace(0, 1, 3), "P.y": np.zeros(3), "phi": np.zeros(3)}
    ahead = nc.sweep(system, poses, rates={"P.x": 1.0, "P.y": 0.0, "phi": 0.0})
    assert (np.asarray(ahead.status) == 0).all()
    assert (np.asarray(nc.sweep(system, poses | {"phi": np.ones(3)}).status) == 0).all()  # positions do not see it
    with pytest.raises(nc.InputError, match=r"side slip P-Q.*pose 0.*simulate"):
        nc.sweep(system, poses, rates={"P.x": 0.0, "P.y": 1.0, "phi": 0.0})
    with pytest.raises(nc.InputError, match=r"inverse_dynamics.*side slip.*fewer"):
        nc.inverse_dynamics(system, ahead)


@pytest.mark.parametrize(
    ("ask", "says"),
    [
        (
            lambda: nc.simulate(sleigh(), [0, 1], method="generalised alpha", step=0.1),
            ["generalised alpha", "'rk4'", "blade"],
        ),
        (lambda: nc.equilibrium(sleigh()), ["equilibrium", "blade", "simulate"]),
        (lambda: nc.linearise(sleigh()), ["linearise", "blade", "simulate"]),
        (lambda: nc.formulate(sleigh_of(), "relative"), ["formulate", "blade"]),
    ],
)
def test_what_rolling_has_no_meaning_for_says_so(ask, says):
    with pytest.raises(nc.InputError) as error:
        ask()
    assert all(word in str(error.value) for word in says), error.value


def disc(centre=(0, 0, 0.3), u=(0, 1, 0), vectors=("u", "w"), **more):
    m = nc.Mechanism("coin", dim=3)
    m.ground("O", (0, 0, 0))
    m.ground_vector("n", (0, 0, 1))
    m.point("C", centre)
    m.vector("u", u)
    m.vector("w", (1, 0, 0))
    m.body("coin", ["C"], vectors=list(vectors))
    m.rolling_disc("rim", **({"centre": "C", "axis": "u", "mark": "w", "plane": ("O", "n")} | more))
    m.compile()


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: disc(centre=(0, 0, -0.3)), ["'rim'", "below the plane", "'n'"]),
        (lambda: disc(u=(0, 0, 1)), ["'rim'", "flat", "upright"]),
        (lambda: disc(mark="u"), ["axis and mark", "'u'"]),
        (lambda: disc(plane=("C", "n")), ["plane", "ground"]),
        (lambda: disc(vectors=("u",)), ["no body has", "'w'"]),
    ],
)
def test_impossible_discs_are_named(make, says):
    with pytest.raises(nc.MechanismError) as error:
        make()
    assert all(word in str(error.value) for word in says), error.value


@pytest.mark.slow
def test_derivatives_pass_through_rolling():
    rates, t = {"P": (AHEAD, 0.0), "phi": SPIN}, np.array([0.0, 0.5])

    def end(inertia):
        run = nc.simulate(sleigh().replace({"sled.inertia": inertia}), t, rates=rates, rtol=1e-9)
        return run.velocity("phi")[-1]

    step = 1e-4
    central = (end(INERTIA + step) - end(INERTIA - step)) / (2 * step)
    _, slope = jax.jvp(end, (jnp.array(INERTIA),), (jnp.ones(()),))
    assert float(slope) == pytest.approx(float(central), rel=1e-6)
