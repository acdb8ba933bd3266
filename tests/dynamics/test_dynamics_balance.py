"""Reactions in space by each body's own balance, which of them are unique, and steady motions."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from independent import lagrange

import jaxnc as nc
from jaxnc.library import benchmarks

G = 9.81
BALANCED = 1e-10  # of the largest force: linear systems solved to rounding


@functools.cache
def falling():
    """Haug's slider-crank let go: a hinge on the ground, shared points B and C, a point fixed in part."""
    t = np.linspace(0, 1, 6)
    return nc.simulate(benchmarks.spatial_slider_crank().compile(), t, rates={"phi": 6.0}, method="rk4", step=2e-3)


@pytest.mark.slow
def test_spatial_slider_crank():
    """Against Lagrange's equations in the crank's angle, integrated by SciPy."""
    lagrangian, slider = lagrange.spatial_slider_crank()
    run = falling()
    phi, rate = lagrange.motion(lagrangian, [0.0], [6.0], np.asarray(run.time))
    place = np.asarray(jax.vmap(slider)(phi[:, 0]))[:, 0]
    assert np.abs(run["s"] - place).max() <= 1e-6  # RK4's error; 1e-11 by dopri8
    assert np.abs(run.velocity("phi") - rate[:, 0]).max() <= 1e-4
    assert float(run.drift) <= 1e-6


@pytest.mark.slow
def test_every_body_in_space_is_in_balance():
    """Newton's and Euler's laws with the bodies' own masses, written without coordinates of the library."""
    run = falling()
    r, a, v = nc.reactions(run), run.acceleration, run.velocity
    weight = np.array([0, 0, -G])
    crank, rod_b, rod_c = r.at("A", on="crank"), r.at("B", on="conrod").force, r.at("C", on="conrod").force
    size = np.abs(rod_b).max() + np.abs(crank.force).max()
    # The rod: its mass centre, and its spin, d/dt (0.004 u × u̇ + 0.0004 (k̇ · u × k) u), the cross's moment included.
    rod, k = np.asarray(run["C"] - run["B"]), np.asarray(run["k"])
    assert np.abs(rod_b + rod_c + 0.5 * weight - 0.25 * (a("B") + a("C"))).max() <= BALANCED * size
    u, du, ddu = rod / 0.3, np.asarray(v("C") - v("B")) / 0.3, np.asarray(a("C") - a("B")) / 0.3
    dk, ddk, w = np.asarray(v("k")), np.asarray(a("k")), np.cross(u, k)
    dw = np.cross(du, k) + np.cross(u, dk)
    roll, droll = (np.sum(p, axis=1, keepdims=True) for p in (dk * w, ddk * w + dk * dw))
    spin = 0.004 * np.cross(u, ddu) + 0.0004 * (droll * u + roll * du)
    cross = np.asarray(r.joint("cross", on="conrod").moment)
    assert np.abs(np.cross(rod / 2, rod_c - rod_b) + cross - spin).max() <= BALANCED * size
    # A cross holds one moment, across its arms.
    assert np.abs(np.sum(cross * k, axis=1)).max() <= BALANCED * size and np.abs(cross[:, 0]).max() <= BALANCED * size
    # The slider, a point that rests in part on the ground.
    slider = -rod_c + r.support("C") + 2.0 * weight - 2.0 * a("C")
    assert np.abs(slider).max() <= BALANCED * size and np.abs(r.support("C")[:, 0]).max() == 0.0
    # The crank turns about x: a hinge holds no moment about its line.
    arm = np.asarray(run["B"] - run["A"])
    assert np.abs(crank.force - rod_b + 0.12 * weight - 0.06 * a("B")).max() <= BALANCED * size
    turn = np.cross(arm, -rod_b) + np.cross(arm / 2, 0.12 * weight)
    turn[:, 0] -= (1e-4 + 0.12 * 0.04**2) * run.acceleration("phi")
    assert np.abs(crank.moment + turn).max() <= BALANCED * size
    assert np.abs(crank.moment[:, 0]).max() <= BALANCED * size
    # All that comes from outside: the rate of the whole momentum.
    whole = 0.06 * a("B") + 0.25 * (a("B") + a("C")) + 2.0 * a("C")
    assert np.abs(crank.force + r.support("C") + 2.62 * weight - whole).max() <= BALANCED * size


def test_which_reactions_are_unique():
    """Three parallel cranks are under a self-stress along them; what hangs from their beam does not feel it."""
    m = nc.Mechanism("three cranks")
    for k in range(3):
        m.ground(f"A{k}", (k, 0))
        m.point(f"B{k}", (k + 0.6, 0.8))
        m.body(f"crank{k}", [f"A{k}", f"B{k}"], mass=1.0)
    m.body("beam", ["B0", "B1", "B2"], mass=2.0, shape="rod")
    m.point("E", (1.6, -0.2))
    m.body("plumb", ["B1", "E"], mass=0.5)
    m.angle("phi", at="A0", to="B0")
    m.angle("swing", at="B1", to="E")
    m.gravity = (0, -G)
    system = m.compile()
    motion = nc.motion(system, {"phi": lambda t: 0.9 + t, "swing": lambda t: -np.pi / 2 + 0.0 * t}, [0.0, 0.1])
    result = nc.inverse_dynamics(system, motion)
    unique = result.reactions.unique()
    shaken = {name for name, sure in unique.items() if not sure}
    assert shaken == {f"{p}{k} on crank{k}" for p in "AB" for k in range(3)} | {f"B{k} on beam" for k in range(3)} | {
        f"A{k}" for k in range(3)
    }
    assert unique["phi"] and unique["swing"] and unique["B1 on plumb"]


@pytest.mark.parametrize("dim", [2, 3])
def test_two_pivots_of_a_body_share_what_pulls_along_their_line(dim):
    """Any two forces along a beam that add up to its load balance it; what hangs from it does not feel them."""
    m, none = nc.Mechanism("beam", dim=dim), (0.0,) * (dim - 2)
    m.ground("A", (0, 0, *none)), m.ground("B", (2, 0, *none))
    m.point("P", (0.5, 0, *none)), m.point("W", (0.5, -1, *none)), m.point("R", (0, -1, *none))
    m.body("beam", ["A", "B", "P"]), m.body("rope", ["P", "W"]), m.body("other rope", ["A", "R"])
    m.force("pull", "P", (10.0, 0.0, *none)), m.force("weight", "W", (0.0, -4.0, *none))
    m.force("other weight", "R", (0.0, -1.0, *none))
    sure = nc.equilibrium(m.compile()).reactions.unique()
    assert {name for name, unique in sure.items() if unique} == {"P on beam", "P on rope", "A on other rope"}
    assert {name for name, unique in sure.items() if not unique} == {"A on beam", "A", "B on beam", "B"}


def crane(second: str) -> nc.Mechanism:
    """A base that turns, a boom and a stick: the stick's hinge has the boom's own axis, or the vector `second`."""
    m = nc.Mechanism("crane", dim=3)
    m.ground("O", (0, 0, 0)), m.ground_vector("z", (0, 0, 1)), m.vector("h", (0, 1, 0))
    m.point("A", (0, 0, 1)), m.point("B", (2, 0, 2)), m.point("T", (4, 0, 1))
    if second != "h":
        m.vector(second, (0, 1, 0))
    how = {"mass": 2.0, "com": (0.1, 0.2, 0.5), "inertia": (0.1, 0.2, 0.3)}
    m.body("base", ["O", "A"], vectors=["z", "h"], **how)
    m.body("boom", ["A", "B"], vectors=list(dict.fromkeys(["h", second])), **how)
    m.body("stick", ["B", "T"], vectors=[second], **how)
    m.angle("s", to="h", about="z"), m.angle("a", at="A", to="B", start="z", about="h")
    m.angle("b", at="B", to="T", start=("A", "B"), about=second)
    m.force("side", "T", (0, 100.0, 0))
    return m


def test_an_axis_that_three_bodies_share_passes_couples_from_one_to_the_next():
    """Held still, by the arms of the load; moving, as where each hinge has an axis of its own."""
    sites = [("O", "base"), ("A", "base"), ("A", "boom"), ("B", "boom"), ("B", "stick")]

    def reactions(m, **inputs):
        system = m.compile()
        return nc.inverse_dynamics(system, nc.motion(system, inputs, np.array([0.0, 0.2]))).reactions

    # At first still: without gravity its masses are not felt.
    starts = {"s": (0.0, 9.0), "a": (np.arctan2(2, 1), -4.0), "b": (0.9273, 7.0)}
    moving = {name: lambda t, x=x, way=way: x + way * t**3 for name, (x, way) in starts.items()}
    one, two = reactions(crane("h"), **moving), reactions(crane("h2"), **moving)
    place, load = {name: np.asarray(one.motion[name])[0] for name in "ABT"}, np.array([0.0, 100.0, 0.0])
    for name, body, sign in (("A", "base", 1), ("A", "boom", -1), ("B", "boom", 1), ("B", "stick", -1)):
        held = np.cross(place["T"] - place[name], load)
        axis = np.array([0.0, 1.0, 0.0])
        np.testing.assert_allclose(one.at(name, on=body).moment[0], sign * (held - (held @ axis) * axis), atol=1e-8)
    for name, body in sites:
        for a, b in zip(one.at(name, on=body), two.at(name, on=body), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-9 * 400)
    assert all(one.unique().values())


def test_stages_of_a_telescope_share_their_line():
    """Each joint puts on its two bodies what is opposite; the last stage obeys Newton's and Euler's laws."""
    m = nc.Mechanism("telescope", dim=3)
    m.ground("B", (0, 0, 0)), m.ground_vector("a", (0, 1, 0)), m.vector("u", (1, 0, 1))
    m.point("P", (1, 0, 1)), m.point("Q", (2, 0, 2)), m.vector("v", (0, 1, 0)), m.vector("y", (0, 1, 0))
    how, com = {"mass": 1.0, "inertia": (0.01, 0.02, 0.015)}, np.array([1.9, 0.2, 1.8])
    m.body("cylinder", ["B"], vectors=["a", "u"], com=(0.2, 0.1, 0.2), **how)
    m.body("rod", ["P"], vectors=["u", "v"], com=(0.8, 0.3, 0.8), **how)
    m.body("tip", ["Q"], vectors=["u", "y"], com=tuple(com), **how)
    m.cylindrical("t1", line=("B", "u"), on="P"), m.cylindrical("t2", line=("P", "u"), on="Q")
    m.gravity = (0, 0, -G)
    run = nc.simulate(m.compile(), [0.0, 0.1])
    r, line = nc.reactions(run), np.array([1.0, 0.0, 1.0]) / np.sqrt(2)
    for joint, one, other in (("t1", "cylinder", "rod"), ("t2", "rod", "tip")):
        a, b = r.joint(joint, on=one, about="B"), r.joint(joint, on=other, about="B")
        np.testing.assert_allclose(a.force, -b.force, atol=1e-12)
        np.testing.assert_allclose(a.moment, -b.moment, atol=1e-12)
        assert np.abs(np.asarray(a.moment)[0] @ line).max() < 1e-12  # it may turn about its line
    tip = r.joint("t2", on="tip", about="Q")
    arm, spin = com - [2, 0, 2], np.asarray(run.angular_acceleration("tip"))[0]
    centre = np.asarray(run.acceleration("Q"))[0] + np.cross(spin, arm)  # from rest
    force = centre + np.array([0, 0, G])
    np.testing.assert_allclose(tip.force[0], force, atol=1e-12)
    about = np.diag([0.01, 0.02, 0.015]) @ spin + np.cross(arm, force)
    np.testing.assert_allclose(tip.moment[0], about, atol=1e-12)
    assert all(r.unique().values())


def test_couples_in_a_flat_loop_are_open_and_opposite():
    m = nc.Mechanism("flat loop", dim=3)
    m.ground("A", (0, 0, 0)), m.ground("D", (4, 0, 0)), m.ground_vector("z", (0, 0, 1))
    m.point("B", (0.5, 1, 0)), m.point("C", (3.3, 2.9, 0))
    for name, ends in (("crank", "AB"), ("coupler", "BC"), ("rocker", "CD")):
        m.body(name, list(ends), vectors=["z"], mass=1.0, com=(1, 1, 0.3), inertia=(0.1, 0.1, 0.1))
    m.angle("phi", at="A", to="B", start=("A", "D"), about="z")
    m.gravity = (0, -G, -1)
    system = m.compile()
    r = nc.inverse_dynamics(system, nc.motion(system, {"phi": lambda t: 1.1 + t}, np.array([0.0, 0.1]))).reactions
    for point, one, other in (("B", "crank", "coupler"), ("C", "coupler", "rocker")):
        for a, b in zip(r.at(point, on=one), r.at(point, on=other), strict=True):
            np.testing.assert_allclose(a, -b, atol=1e-10)
    sure = r.unique()
    assert sure["phi"] and not any(sure[f"{p} on {b}"] for p, b in (("A", "crank"), ("B", "coupler"), ("C", "rocker")))


@pytest.mark.parametrize("shares", [True, False], ids=["shares the arm's direction", "has its own"])
def test_a_rack_on_an_arm_presses_on_the_pinions_bearing(shares):
    """The rack's mass times its acceleration is the force of the teeth, and the pinion's bearing holds it."""
    m = nc.Mechanism("rack on an arm", dim=3)
    m.ground("O", (0, 0, 0)), m.ground_vector("z", (0, 0, 1)), m.ground_vector("x", (1, 0, 0))
    m.vector("h", (1, 0, 0)), m.vector("mark", (0, 1, 0))
    m.point("C", (0.5, 0, 0)), m.point("E", (0, 0.1, 0)), m.point("K", (0.2, 0.1, 0))
    m.body("arm", ["O", "C", "E"], vectors=["z", "h"], mass=2.0, com=(0.25, 0, 0), inertia=(0.01, 0.04, 0.04))
    m.body("pinion", ["C"], vectors=["z", "mark"], mass=0.5, com=(0.5, 0, 0), inertia=(0.002, 0.002, 0.003))
    how = {"mass": 0.8, "com": (0.3, 0.1, 0), "inertia": (0.001, 0.01, 0.01)}
    if shares:
        m.body("rack", ["K"], vectors=["z", "h"], **how)
        m.cylindrical("guide", line=("E", "h"), on="K")
    else:
        m.point("L", (0.4, 0.1, 0)), m.vector("w", (0, 0, 1))
        m.body("rack", ["K", "L"], vectors=["w"], **how)
        m.prismatic("guide", line=("E", "h"), on=("K", "L"), directions=("z", "w"))
    m.angle("a", to="h", start="x", about="z"), m.angle("psi", at="C", to="mark", start="h", about="z")
    m.distance("s", "E", "K", along="h"), m.rack_and_pinion("mesh", "psi", "s", radius=0.1)
    system = m.compile()
    inputs = {"psi": lambda t: np.pi / 2 + 3 * t + 4 * t * t, "a": lambda t: 0 * t}
    r = nc.inverse_dynamics(system, nc.motion(system, inputs, np.array([0.0, 0.1]))).reactions
    push = np.array([-0.8 * 0.1 * 8.0, 0.0, 0.0])
    np.testing.assert_allclose(r.joint("mesh", on="rack").force[0], push, atol=1e-12)
    np.testing.assert_allclose(r.joint("mesh", on="pinion").force[0], -push, atol=1e-12)
    np.testing.assert_allclose(r.at("C", on="pinion").force[0], push, atol=1e-12)


@pytest.mark.parametrize("start", [("H", "K"), "x"])
def test_a_mesh_pushes_on_its_wheels_from_whatever_their_angle_is_counted(start):
    """The arm is hinged to the ground about the vector x, which is as good a mark of it as its own line."""
    m = nc.Mechanism("rack on an arm", dim=3)
    m.ground("O", (0, 0, 0)), m.ground_vector("x", (1, 0, 0)), m.ground_vector("y", (0, 1, 0))
    m.point("H", (0, 0.3, 0)), m.point("K", (0.1, 0.3, 0)), m.point("T", (0.06, 0.36, 0)), m.point("R", (0.1, 0.35, 0))
    m.vector("k", (0, 0, 1)), m.vector("j", (0, 1, 0)), m.vector("d", (1, 0, 0))
    m.body("arm", ["O", "H", "K"], vectors=["x", "k", "j"])
    m.body("pinion", ["H", "T"], vectors=["k"])
    m.body("rack", ["R"], vectors=["j", "d"], mass=0.7, com=(0.1, 0.35, 0), inertia=np.diag([3e-3, 1e-3, 2e-3]))
    m.prismatic("guide", line=("K", "j"), on="R", directions=("k", "d"))
    m.angle("a", to="j", start="y", about="x"), m.angle("phi", at="H", to="T", start=start, about="k")
    m.distance("s", "K", "R", along="j"), m.rack_and_pinion("mesh", "phi", "s", pressure_angle=0.35)
    system = m.compile()
    inputs = {"phi": lambda t: np.pi / 4 + 10.0 * t * t, "a": lambda t: 0.0 * t}  # the rack by 20 / s^2 * 0.1
    r = nc.inverse_dynamics(system, nc.motion(system, inputs, np.array([0.0, 0.1]))).reactions
    push = 0.7 * 2.0 * np.array([np.tan(0.35), 1.0, 0.0])
    np.testing.assert_allclose(r.joint("mesh", on="rack").force[0], push, atol=1e-12)
    np.testing.assert_allclose(r.at("H", on="pinion").force[0], push, atol=1e-12)


def test_a_conical_pendulum_swings_about_its_steady_motion():
    """Ω² = ω² (sin² θ + 4 m l² sin² θ cos² θ / (I + m l² sin² θ)), where cos θ = g / (l ω²); the shaft is free."""
    length, mass, shaft, speed = 0.5, 2.0, 0.3, 6.0
    c = G / (length * speed**2)
    s = np.sqrt(1 - c * c)
    m = nc.Mechanism("conical pendulum", dim=3)
    m.ground("O", (0, 0, 0))
    m.ground_vector("z", (0, 0, 1))
    m.vector("h", (0, 1, 0))
    m.point("P", (length * s, 0, -length * c))
    m.body("shaft", ["O"], vectors=["z", "h"], mass=1.0, com=(0, 0, 0), inertia=(shaft, shaft, shaft))
    m.body("arm", ["O", "P"], vectors=["h"])
    m.point_mass("mass at P", "P", mass)
    m.angle("spin", to="h", about="z")
    m.angle("swing", to=("O", "P"), start="z", about="h")
    m.gravity = (0, 0, -G)
    near = nc.linearise(m.compile(), rates={"spin": speed, "swing": 0.0}, coordinates=["spin", "swing"])
    assert np.abs(near.residual).max() <= 1e-9 * speed**2
    inertia = mass * length**2 * s * s
    frequency = speed * np.sqrt(s * s + 4 * inertia * c * c / (shaft + inertia))
    values = near.eigenvalues
    assert np.abs(values[:2]).max() <= 1e-5 * speed  # turning on at another speed: a double zero
    assert np.allclose(np.sort(values[2:].imag), [-frequency, frequency], rtol=1e-9)
    assert np.abs(values[2:].real).max() <= 1e-8 * speed


@pytest.mark.slow
def test_forces_are_drawn_in_space():
    figure = falling().draw(pose=2, forces=True)
    seen = {text.get_gid() for text in figure.findobj() if hasattr(text, "get_text")}
    assert {"weight key", "reaction key"} <= seen


@functools.cache
def column():
    """Ziegler's column: two massless bars with springs, and a load of some size that turns with the upper one."""
    m = nc.Mechanism("column")
    m.ground("A", (0, 0))
    m.point("B", (0, 1.0))
    m.point("C", (0, 2.0))
    m.body("lower", ["A", "B"])
    m.body("upper", ["B", "C"])
    m.point_mass("at B", "B", 2.0)
    m.point_mass("at C", "C", 1.0)
    m.angle("t1", at="A", to="B")
    m.angle("t2", at="B", to="C")
    m.angle("between", at="B", to="C", start=("A", "B"))
    m.spring("first", "t1", stiffness=1.0)
    m.spring("second", "between", stiffness=1.0)

    def along(t, at, size):
        way = at["B"] - at["C"]
        return size * way / jnp.linalg.norm(way)

    m.force("load", "C", along, jnp.array(1.5))
    return m.compile()


def square(load, first=1.0):
    """Squares of its frequencies, by the matrices in closed form."""
    mass, stiffness = np.array([[3.0, 1.0], [1.0, 1.0]]), np.array([[first + 1.0 - load, load - 1.0], [-1.0, 1.0]])
    return np.sort_complex(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).astype(complex))


@pytest.mark.parametrize("load", [0.0, 1.5, 2.5])
def test_frequencies_under_a_load_that_turns_along(load):
    """Its stiffness is not symmetric."""
    near = nc.linearise(column().replace({"load": jnp.array(load)}), coordinates=["t1", "t2"])
    exact = square(load)
    flutter = np.abs(exact.imag).max() > 0
    wanted = -np.sqrt(np.abs(exact)) if flutter else np.sqrt(exact.real)
    np.testing.assert_allclose(near.frequencies, np.sort(wanted), rtol=1e-9)
    assert near.stable == (not flutter) and ("grows" in str(near)) == flutter


def test_derivatives_of_such_frequencies():
    """Forward, half of the program in reverse, which `test_traced_frequencies…` goes through."""

    system = column()

    def both(k):
        return nc.linearise(system.replace({"first.stiffness": k}), coordinates=["t1", "t2"]).frequencies

    found, slopes = nc.jit(lambda k: jax.jvp(both, (k,), (1.0,)))(1.0)
    ends = [np.sqrt(square(1.5, 1.0 + h).real) for h in (-1e-4, 1e-4)]
    np.testing.assert_allclose(found, np.sqrt(square(1.5).real), rtol=1e-9)
    np.testing.assert_allclose(slopes, (ends[1] - ends[0]) / 2e-4, rtol=1e-6)


def test_a_spinning_top_prints_how_it_moves():
    """It stands by its spin: the roots of I w² - C n w + m g l, and nothing grows."""
    across, along, mass, height, spin = 0.05, 0.03, 1.3, 0.25, 60.0
    m = nc.Mechanism("top", dim=3)
    m.ground("O", (0, 0, 0))
    m.point("P", (0, 0, height))
    m.vector("u", (1, 0, 0))
    m.body("top", ["O", "P"], vectors=["u"], mass=mass, com=(0, 0, height), inertia=(across, across, along))
    m.gravity = (0, 0, -9.81)
    near = nc.linearise(m.compile(), rates={"P.x": 0.0, "P.y": 0.0, "u.y": spin})
    wanted = np.roots([across + mass * height**2, -along * spin, mass * 9.81 * height])
    assert near.stable and "grows" not in str(near)
    for root in wanted:
        assert f"± {root:.6g}i rad/s" in str(near)


# Each direction and each speed; what spins unseen is told where it is drawn along an axis, and where it is slow.
@pytest.mark.parametrize(
    ("measured", "turn", "spin"),
    [(True, 0.0, 40.0), (True, 0.5, 1.0), (True, 1.3, 3000.0), (False, 0.0, 40.0), (False, 0.5, 1.0)],
)
def test_a_spinning_rotor_is_linearised_in_what_stays_or_turns_steadily(measured, turn, spin):
    """On four springs it whirls by ``I w'' = -k w ± i G w'``; components of what spins are of an instant only."""
    across, along, mass, height, stiffness = 0.05, 0.08, 2.0, 0.4, 300.0
    m = nc.Mechanism("rotor", dim=3)
    m.ground("O", (0, 0, 0))
    m.ground_vector("z", (0, 0, 1))
    m.point("C", (0, 0, height))
    m.vector("u", (np.cos(turn), np.sin(turn), 0))
    m.body("rotor", ["O", "C"], vectors=["u"], mass=mass, com=(0, 0, height), inertia=(across, across, along))
    for k, (x, y) in enumerate([(1, 0), (0, 1), (-1, 0), (0, -1)]):
        m.ground(f"G{k}", (x, y, height))
        m.spring(f"spring {k}", "C", f"G{k}", stiffness=stiffness, free=1.0)
    if measured:
        m.angle("phi", to="u", about="z")
    rates = {"u": (-spin * np.sin(turn), spin * np.cos(turn), 0.0)}
    near = nc.linearise(m.compile(), rates=rates)
    assert bool(near.steady) is measured and ("of an instant" in str(near)) is not measured
    if measured:
        assert {"phi", "C.x", "C.y"} == {*near.coordinates} and near.stable and "grows" not in str(near)
        inertia = across + mass * height**2
        whirl = np.abs(np.roots([inertia, along * spin, -2.0 * stiffness * height**2]))
        found = np.sort(np.abs(near.eigenvalues))[2:]
        np.testing.assert_allclose(found, np.sort([*whirl, *whirl]), rtol=1e-7)


@pytest.mark.parametrize("phi", [0.0, 0.7, 2.0])
def test_a_balanced_seesaw_is_in_equilibrium_anywhere(phi):
    """Its stiffness is rounding, and so is what is left of its weights; a slow turn is a steady motion."""
    m = nc.Mechanism("seesaw")
    m.ground("O", (0, 0))
    m.point("A", (-0.1 * np.cos(phi), -0.1 * np.sin(phi))), m.point("B", (0.3 * np.cos(phi), 0.3 * np.sin(phi)))
    m.body("beam", ["O", "A", "B"], mass=0.0), m.point_mass("a", "A", 3.0), m.point_mass("b", "B", 1.0)
    m.angle("phi", at="O", to="B"), setattr(m, "gravity", (0, -9.81))
    for rates in (None, {"phi": 1e-15}, {"phi": 1e-3}, {"phi": 5.0}):
        assert nc.linearise(m.compile(), rates=rates).steady, rates


def test_a_slow_instability_beside_a_stiff_mode_is_told():
    m = nc.Mechanism("two")
    m.ground("O", (0, 0)), m.ground("Q", (3, 0)), m.point("P", (0, 1)), m.point("R", (3, 1))
    m.body("slow", ["O", "P"], mass=1.0), m.body("stiff", ["Q", "R"], mass=1.0)
    m.angle("phi", at="O", to="P"), m.angle("psi", at="Q", to="R"), setattr(m, "gravity", (0, -9.81))
    m.spring("spring", "psi", stiffness=5e12, free=np.pi / 2)
    near = nc.linearise(m.compile())
    assert near.steady and not near.stable


def test_units_of_forces_go_with_the_unit_of_length():
    """In mm, tonnes and seconds forces are newtons, and moments and energies N mm."""
    m = nc.Mechanism("pendulum", length_unit="mm")
    m.ground("A", (0, 0))
    m.point("B", (1000.0, 0))
    m.body("rod", ["A", "B"])
    m.point_mass("bob", "B", 1e-3)
    m.angle("phi", at="A", to="B")
    m.gravity = (0, -9810.0)
    run = nc.simulate(m.compile(), np.linspace(0, 0.1, 3), rates={"phi": 1.0})
    assert "500 N mm at the start" in run.report()  # half a joule
    assert run.to_frame().attrs["units"]["kinetic energy"] == "N mm"
    top = run.system.topology
    assert [top.load_unit(what) for what in ("force", "moment", "power")] == ["N", "N mm", "N mm/s"]
    metres = nc.library.four_bar().compile().topology
    assert [metres.load_unit(what) for what in ("moment", "energy", "power")] == ["N m", "J", "W"]


def test_an_arm_that_a_spring_balances_anywhere_stays_and_is_neutral():
    """The spring of a lamp, with no free length, holds the arm at any angle if ``k h a = m g l``."""
    h, a, length, mass = 0.3, 0.2, 0.4, 2.0
    for angle in (0.3, 0.7, -0.5):
        way = np.array([np.cos(angle), np.sin(angle)])
        m = nc.Mechanism("lamp")
        m.gravity = (0, -G)
        for name, place in (("O", (0, 0)), ("H", (0, h))):
            m.ground(name, place)
        m.point("Q", a * way)
        m.point("P", length * way)
        m.body("arm", ["O", "Q", "P"], mass=mass, com=length * way, inertia=0.01)
        m.angle("phi", "O", "P")
        m.spring("spring", "H", "Q", stiffness=mass * G * length / (h * a), free=0.0)
        system = m.compile()
        found = nc.equilibrium(system)
        assert float(found["phi"]) == pytest.approx(angle, abs=1e-12)
        assert not found.stable and float(found.stiffness[0]) == 0.0 and "indifferent" in str(found)
        slope = jax.grad(lambda k: nc.equilibrium(system.replace({"spring.stiffness": k}))["phi"])  # noqa: B023
        assert np.abs(slope(system["spring.stiffness"])) < 1e-6  # nothing says where it goes: it stays
        about = nc.linearise(system)
        assert about.stable and "neutral" in str(about)


def test_a_weak_spring_between_forces_that_balance_is_followed():
    """A beam that carries a weight at either end turns to where its spring is free, however weak that is."""
    m = nc.Mechanism("beam")
    m.ground("O", (0, 0))
    m.point("P", (0.5, 0.0))
    m.point("Q", (-0.5, 0.0))
    m.body("beam", ["O", "P", "Q"], mass=0.001, com=(0, 0), inertia=0.001)
    m.angle("phi", "O", "P")
    for end in "PQ":
        m.force(f"at_{end}", end, (0, -G))
    m.spring("spring", "phi", stiffness=1.0, free=0.3)
    system = m.compile()
    for stiffness, off in ((1.0, 1e-12), (1e-5, 1e-9), (1e-7, 1e-6)):
        found = nc.equilibrium(system.replace({"spring.stiffness": stiffness}))
        assert float(found["phi"]) == pytest.approx(0.3, abs=off) and found.stable


def test_a_batch_of_linearisations_has_the_numbers_of_each():
    m = nc.Mechanism("arm")
    m.gravity = (0, -G)
    m.ground("O", (0, 0))
    m.point("P", (0.0, 0.4))
    m.body("arm", ["O", "P"], mass=2.0, com=(0.0, 0.4), inertia=0.01)
    m.angle("phi", "O", "P")
    m.spring("spring", "phi", stiffness=5.0)
    system = m.compile()
    stiffness = jnp.array([5.0, 7.0, 9.0, 20.0])
    many = jax.vmap(lambda k: nc.linearise(system.replace({"spring.stiffness": k})))(stiffness)
    square = (np.asarray(stiffness) - 2.0 * G * 0.4) / (2.0 * 0.4**2 + 0.01)  # of an inverted pendulum
    exact = np.sign(square) * np.sqrt(np.abs(square))
    assert np.abs(many.frequencies[:, 0] - exact).max() < 1e-12
    assert many.stable.tolist() == (square > 0).tolist()
    assert np.abs(np.abs(many.eigenvalues) - np.abs(exact)[:, None]).max() < 1e-12
    assert many.modes.shape == (4, 1, len(system.topology.coordinates)) and "(4,)" in str(many)
    with pytest.raises(nc.InputError, match="batch"):
        many.mode(0)


def test_traced_frequencies_where_the_drawings_coordinate_stands_still():
    m = nc.Mechanism("drawn level, hangs")
    m.ground("A", (0, 0))
    m.ground("W", (0, -3))
    m.point("B", (1, 0))
    m.body("bar", ["A", "B"], mass=0.0)
    m.point_mass("p", "B", 2.0)
    m.spring("k", "W", "B", stiffness=30.0, free=1.0)
    m.gravity = (0, -G)
    system = m.compile()
    assert system.independent == ("B.y",)

    def frequency(k, names=None):
        design = system.replace({"k.stiffness": k})
        return nc.linearise(design, nc.equilibrium(design), coordinates=names).frequencies[0]

    # About the lowest place 2 L^2 w^2 = m g L + k (l - l0) L W / l, with l = 2 from B to W, l0 = 1 and W = 3 below A.
    right, slope = np.sqrt((2 * G + 30.0 * 3 / 2) / 2), (3 / 2) / 4 / np.sqrt((2 * G + 30.0 * 3 / 2) / 2)
    found = jax.vmap(jax.value_and_grad(frequency))(jnp.array([30.0]))
    assert np.allclose(found, [[right], [slope]], rtol=1e-8)
    assert jax.grad(frequency)(30.0) == pytest.approx(slope, rel=1e-8)
    asked = jax.vmap(jax.value_and_grad(functools.partial(frequency, names=["B.y"])))(jnp.array([30.0]))
    assert np.isnan(asked[0]).all() and np.isfinite(asked[1]).all()


@pytest.mark.parametrize("twist, tilt, turn", [(1e-5, 0, 1), (0, 2e-6, 1), (1e-8, 1e-5, 1), (1e-5, 0, -1)])
def test_wheels_on_shafts_that_are_parallel_to_a_drawings_digits(twist, tilt, turn):
    """3 N m on a wheel of 80 mm are 37.5 N at its teeth, which point across the line of centres."""
    m = nc.Mechanism("wheels", dim=3)
    m.ground("A", (0, 0, 0)), m.ground("B", (0.1, 0, 0))
    m.ground_vector("a", (0, 0, 1)), m.ground_vector("b", (turn * tilt, turn * twist, turn))
    m.point("P", (0, 0.02, 0)), m.point("Q", (0.1, 0.08, 0))
    m.body("one", ["A", "P"], vectors=["a"]), m.body("two", ["B", "Q"], vectors=["b"])
    m.angle("phi", at="A", to="P", about="a"), m.angle("psi", at="B", to="Q", about="b")
    m.bevel_gear("mesh", "phi", "psi", radii=(0.02, 0.08))
    m.torque("load", "psi", 3.0 * turn)
    system = m.compile()

    def tooth(system):
        motion = nc.motion(system, {"phi": lambda t: 2 * t}, np.linspace(0, 1, 2))
        return nc.inverse_dynamics(system, motion).reactions.joint("mesh", on="two")

    found = tooth(system)
    np.testing.assert_allclose(found.force[0], [0, 37.5, 0], atol=1e-2)
    np.testing.assert_allclose(found.moment[0], [0, 0, -3], atol=1e-3)
    slope = jax.grad(lambda s: tooth(s).force[0, 1])(system)
    assert float(slope["load.value"]) == pytest.approx(12.5 * turn) and np.isfinite(slope["B"]).all()


@pytest.mark.parametrize("line", [(1, 0), (1, -7), (3, 1)])
@pytest.mark.parametrize("level, radius, way", [(1e-8, None, -1), (0.0, 0.05, 1)])
def test_a_rack_that_is_level_with_its_pinion_but_for_rounding(line, level, radius, way):
    """Its other end tells radius and side; without one, the given radius and the documented side."""
    x = np.append(line, 0) / np.hypot(*line)
    y = np.cross((0, 0, 1), x)
    m = nc.Mechanism("rack", dim=3)
    m.ground("C", (0, 0, 0)), m.ground("O", tuple(-0.5 * x + (0.0 if radius else 0.05) * y))
    m.ground("G", tuple(level * y - x))
    m.ground_vector("x", tuple(x)), m.ground_vector("y", tuple(y)), m.ground_vector("z", (0, 0, 1))
    m.point("P", tuple(0.05 * x)), m.point("R", tuple(0.1 * x + level * y))
    m.body("pinion", ["C", "P"], vectors=["z"]), m.body("rack", ["R"], vectors=["x", "y"])
    m.angle("phi", at="C", to="P", about="z")
    m.cylindrical("guide", line=("G", "x"), on="R")
    m.distance("s", "O", "R", along="x"), m.rack_and_pinion("mesh", "phi", "s", radius=radius)
    motion = nc.motion(m.compile(), {"phi": lambda t: t}, np.array([0.0, 0.1]))
    assert float(motion.velocity("s")[0]) == pytest.approx(0.05 * way)


@pytest.mark.parametrize("start, radius", [((0, 0, 0), 0.05), ((0, 0, 0.03), None), ((-0.5, 0.2, 0), None)])
def test_racks_on_both_sides_of_a_pinion_go_opposite_ways(start, radius):
    """Whatever their distances are counted from; 10 N on the upper rack push on the pinion's rim."""
    m = nc.Mechanism("two racks", dim=3)
    m.ground("C", (0, 0, 0)), m.ground("O", start), m.ground("G", (-1, 0.05, 0)), m.ground("H", (-1, -0.05, 0))
    m.ground_vector("ex", (1, 0, 0)), m.ground_vector("ey", (0, 1, 0)), m.ground_vector("ez", (0, 0, 1))
    m.point("P", (0.05, 0, 0)), m.point("up", (0.1, 0.05, 0)), m.point("low", (0.1, -0.05, 0))
    m.body("pinion", ["C", "P"], vectors=["ez"])
    m.angle("phi", at="C", to="P", about="ez")
    for name, guide in (("up", "G"), ("low", "H")):
        m.body(f"rack {name}", [name], vectors=["ex", "ey"])
        m.cylindrical(f"guide {name}", line=(guide, "ex"), on=name)
        m.distance(f"s_{name}", "O", name, along="ex")
        m.rack_and_pinion(f"mesh {name}", "phi", f"s_{name}", radius=radius)
    m.torque("load", "s_up", 10.0)
    system = m.compile()
    motion = nc.motion(system, {"phi": lambda t: t}, np.array([0.0, 0.1]))
    assert float(motion.velocity("s_up")[0]) == pytest.approx(-0.05)
    assert float(motion.velocity("s_low")[0]) == pytest.approx(0.05)
    tooth = nc.inverse_dynamics(system, motion).reactions.joint("mesh up", on="pinion")
    np.testing.assert_allclose(tooth.force[0], [10, 0, 0], atol=1e-9)
    np.testing.assert_allclose(tooth.moment[0], [0, 0, -0.5], atol=1e-9)


def test_of_wheels_on_axes_that_pass_each_other_only_couples_are_known():
    """A worm's couple on its wheel is the load; nothing says which forces go with it."""
    m = nc.Mechanism("worm", dim=3)
    m.ground("A", (0, 0, 0)), m.ground("B", (0, 0, 0.1))
    m.ground_vector("a", (1, 0, 0)), m.ground_vector("b", (0, 1, 0))
    m.point("P", (0, 0.02, 0)), m.point("Q", (0.08, 0, 0.1))
    m.body("worm", ["A", "P"], vectors=["a"]), m.body("wheel", ["B", "Q"], vectors=["b"])
    m.angle("phi", at="A", to="P", about="a"), m.angle("psi", at="B", to="Q", about="b")
    m.bevel_gear("mesh", "phi", "psi", radii=(0.02, 0.08))
    m.torque("load", "psi", 3.0)
    system = m.compile()
    motion = nc.motion(system, {"phi": lambda t: 2 * t}, np.linspace(0, 1, 2))
    found = nc.inverse_dynamics(system, motion).reactions
    for body, couple in (("worm", [-0.75, 0, 0]), ("wheel", [0, -3, 0])):
        np.testing.assert_allclose(found.joint("mesh", on=body).force, 0.0, atol=1e-12)
        np.testing.assert_allclose(found.joint("mesh", on=body).moment[0], couple, atol=1e-9)


def hung_bob():
    m = nc.Mechanism("bob on a crank")
    m.ground("A", (0, 0)), m.point("B", (1, 0)), m.point("W", (1.01, -1))
    m.body("crank", ["A", "B"], mass=1.0), m.body("bob", ["B", "W"], mass=1.0)
    m.angle("phi", at="A", to="B")
    m.gravity = (0, -G)
    return m.compile()


def test_what_is_held_is_reached_along_the_branch():
    """The bob hangs under the crank wherever that is held, also after turns, and its torque is 3/2 m g r cos φ."""
    system, values = hung_bob(), np.array([2.0, -2.5, 3.0 + 4.0 * np.pi])

    def effort(phi):
        return nc.equilibrium(system, hold={"phi": phi}).reactions.effort("phi")

    for phi in values:
        found = nc.equilibrium(system, hold={"phi": phi})
        crank = np.array([np.cos(phi), np.sin(phi)])
        assert float(found["phi"]) == float(found.motion.inputs["phi"]) == phi and found.stable
        np.testing.assert_allclose(found["B"], crank, atol=1e-12)
        np.testing.assert_allclose(found["W"], crank - [0, np.hypot(0.01, 1.0)], atol=1e-9)
        assert float(effort(phi)) == pytest.approx(1.5 * G * np.cos(phi), abs=1e-9)
    slopes = jax.vmap(jax.grad(effort))(jnp.array(values))
    np.testing.assert_allclose(slopes, -1.5 * G * np.sin(values), rtol=1e-7)


def test_a_pose_of_a_larger_design_is_a_start_where_what_it_holds_is_out_of_reach():
    large = hung_bob()
    small = large.replace(B=(0.4, 0.0), W=(0.404, -0.4))
    pose = nc.solve_position(large, {"phi": -0.5, "W.y": -1.3})
    found = nc.equilibrium(small, state=pose, hold={"W.y": -0.7})
    B, W = np.asarray(found["B"]), np.asarray(found["W"])
    assert W[1] == -0.7 and found.stable
    np.testing.assert_allclose([np.hypot(*B), np.hypot(*(W - B))], [0.4, np.hypot(0.004, 0.4)], rtol=1e-9)


def test_masses_that_are_far_apart_have_frequencies_in_32_bits():
    """A bob on two springs with a grain between them, against the stiffness of a taut string in SciPy."""
    m = nc.Mechanism("grain")
    m.ground("A", (0, 0)), m.point("B", (0, -0.4)), m.point("C", (0, -0.9))
    m.spring("upper", "A", "B", stiffness=100.0, free=0.3), m.spring("lower", "B", "C", stiffness=200.0, free=0.3)
    m.point_mass("grain", "B", 1e-6), m.point_mass("bob", "C", 2.0)
    m.gravity = (0, -G)
    found = nc.linearise(system := m.compile(dtype="float32"), nc.equilibrium(system))
    masses, stiffness, wanted = np.diag([1e-6, 2.0]), np.array([100.0, 200.0]), []
    pull = np.array([2.0 + 1e-6, 2.0]) * G
    for upper, lower in (stiffness, pull / (0.3 + pull / stiffness)):
        k = np.array([[upper + lower, -lower], [-lower, lower]])
        wanted += [*np.sqrt(scipy.linalg.eigvalsh(k, masses))]
    np.testing.assert_allclose(np.sort(found.frequencies), np.sort(wanted), rtol=1e-5)


def test_other_held_values_compile_nothing():
    system, compiled = hung_bob(), []
    jax.monitoring.register_event_duration_secs_listener(lambda name, *_, **__: compiled.append(name))
    nc.equilibrium(system, hold={"phi": 0.3})
    before = sum("backend_compile" in name for name in compiled)
    nc.equilibrium(system, hold={"phi": 0.4})
    assert sum("backend_compile" in name for name in compiled) == before


def test_what_is_held_may_be_out_of_reach():
    with pytest.raises(nc.AssemblyError, match="what is held does not come to its values"):
        nc.equilibrium(hung_bob(), hold={"W.x": 5.0})


@pytest.mark.parametrize("turns", [3, 10])
def test_a_nut_rests_some_turns_away(turns):
    """On a screw of lead 2 mm, between its weight and a spring: its energy is a parabola of the turns."""
    m = nc.Mechanism("jack", dim=3)
    m.ground("O", (0, 0, 0)), m.ground_vector("z", (0, 0, 1)), m.ground_vector("x", (1, 0, 0))
    m.point("N", (0, 0, 0.2)), m.vector("u", (0, 1, 0))
    m.body("nut", ["N"], vectors=["z", "u"], mass=3.0, com=(0, 0, 0.2), inertia=(0.01, 0.01, 0.01))
    m.screw("thread", line=("O", "z"), on="N", directions=("x", "u"), angle="th", distance="s", lead=0.002)
    m.gravity = (0, 0, -G)
    m.spring("k", "s", stiffness=3 * G / 0.01, free=0.21 - 0.002 * turns)
    assert float(nc.equilibrium(m.compile())["s"]) == pytest.approx(0.2 - 0.002 * turns, abs=1e-9)


@pytest.mark.parametrize("free", [50.0, 1e5])
def test_a_soft_torsion_spring_far_away(free):
    m = nc.Mechanism("wheel")
    m.ground("A", (0, 0)), m.point("B", (0.1, 0))
    m.body("wheel", ["A", "B"])
    m.angle("p", at="A", to="B")
    m.spring("k", "p", stiffness=1.0, free=free)
    if free == 50.0:
        assert float(nc.equilibrium(m.compile())["p"]) == pytest.approx(free, abs=1e-9)
    else:
        with pytest.raises(nc.AssemblyError, match="after 2000 steps the search is still on its way"):
            nc.equilibrium(m.compile())
