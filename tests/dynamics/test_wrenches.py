"""Wrenches on bodies: each body's own balance, write_out without the library's rows, and joints that do no work."""

import functools

import jax
import numpy as np
import pytest
from rigs import CASES, STAY, Rig
from wrench_bench import BALANCED, IDLE, Bench, G, merged

import jaxnc as nc
from jaxnc import library
from jaxnc.dynamics.reactions import nodal_forces


def library_of(dim):
    found = {f"{name} ": make() for name, make in library.CATALOGUE.items()}
    return merged({name: m for name, m in found.items() if m.model.dim == dim})


@pytest.mark.slow
@pytest.mark.parametrize("dim", [2, 3])
def test_library(dim):
    """Every mechanism of the library, with masses on all bodies: each body in balance, each joint without power."""
    bench = Bench(library_of(dim))
    bench.check_balance()
    bench.check_idle()
    bench.check_agreement()


def at_rest(system, **inputs):
    """What acts where inputs are held: in a third of the time that an equilibrium's search takes to compile."""
    motion = nc.sweep(system, {name: [value] for name, value in inputs.items()}, rates=dict.fromkeys(inputs, 0.0))
    return nc.inverse_dynamics(system, motion).reactions


RIGS = tuple(CASES)  # every joint in space in all of its forms


@functools.cache
def rigged():
    """Free bodies, two or three to a joint, tumbling as they fall."""
    m, rigs, free = nc.Mechanism("rigs", dim=3), {}, {}
    for k, name in enumerate(RIGS):
        rig = Rig(m, f"r{k}_", False)
        free[name] = CASES[name][0](rig)
        rigs[name] = rig
    return Bench(m), rigs, free


@pytest.mark.slow
def test_joints_in_space_balance():
    bench, _, _ = rigged()
    bench.check_balance()
    bench.check_agreement()


@pytest.mark.slow
@pytest.mark.parametrize("name", RIGS)
def test_joint_in_space_is_one_wrench_without_power(name):
    """What joins two bodies is one wrench, opposite on both, and does no work on any of their relative freedoms."""
    bench, rigs, free = rigged()
    allowed, bodies = free[name], [rigs[name].of(f"body{b + 1}") for b in range(rigs[name].count)]
    twists = allowed.twists([STAY] * (len(bodies) - 1)).reshape(-1, len(bodies) - 1, 6)
    found = []
    for body in bodies:
        largest = max(np.abs(x).max() for w in bench.wrenches[body].values() for x in w)
        exerted = {
            key: w
            for key, w in bench.wrenches[body].items()
            if key != "weight" and max(np.abs(x).max() for x in w) > BALANCED * largest
        }
        if len(bodies) == 2:
            assert len(exerted) == 1, exerted.keys()
        centre = np.array([law[0] for law in bench.laws[body]])
        total = [sum(w[n] for w in exerted.values()) for n in (0, 1)]
        found.append((total[0], total[1] + np.cross(centre, total[0])))
    size = np.abs(found[0][0]).max() + np.abs(found[0][1]).max()
    assert size > 1e-3
    for n in (0, 1):
        assert np.abs(sum(w[n] for w in found)).max() <= BALANCED * size
    for twist in twists:  # of bodies 2, 3, … relative to body 1: rotation, and velocity at the origin
        power = sum(w[1] @ t[:3] + w[0] @ t[3:] for w, t in zip(found[1:], twist, strict=True))
        assert np.abs(power).max() <= IDLE * size


def test_a_rolling_disc_is_held_by_one_force_at_the_contact():
    """Accelerated along a line by a torque on its centre: friction m a, and no moment about the contact."""
    m, radius, mass, inertia = nc.Mechanism("disc"), 0.3, 1.88, 0.05
    for name, at in {"A": (0, 0), "B": (2, 0)}.items():
        m.ground(name, at)
    for name, at in {"C": (0.5, radius), "R": (0.5, 2 * radius), "K": (0.5, 0)}.items():
        m.point(name, at)
    m.body("disc", ["C", "R"], mass=mass, com=(0.5, radius), inertia=inertia)
    m.rolling("rolling", centre="C", rim="R", contact="K", line=("A", "B"), angle="phi", distance="s")
    m.gravity = (0, -G)
    motion = nc.motion(m.compile(), {"s": lambda t: 0.5 + 0.6 * t * t}, [0.0, 0.3])
    found = nc.inverse_dynamics(motion.system, motion).reactions
    held = found.joint("rolling", on="disc", about="C")
    # The input pushes at the centre, along the line: m a + I a / R², of which friction takes I a / R².
    a = 1.2
    friction = -inertia * a / radius**2
    assert np.allclose(held.force, [friction, mass * G], rtol=1e-12)
    assert np.allclose(held.moment, radius * friction, rtol=1e-12)
    assert np.allclose(found.on("disc")["coordinate s"].force, [mass * a - friction, 0.0], rtol=1e-12, atol=1e-12)
    assert np.allclose(found.joint("rolling", on="disc", about="C").moment + 0.0, -inertia * a / radius, rtol=1e-12)


def pair(internal=False, **more):
    """Two wheels on the ground, the second one loaded with 2 N m."""
    m = nc.Mechanism("pair")
    for k, (x, r, mass) in enumerate(((0.0, 0.1, 1.0), (-0.1 if internal else 0.3, 0.2, 2.0)), start=1):
        m.ground(f"O{k}", (x, 0))
        m.point(f"P{k}", (x + r, 0))
        m.body(f"w{k}", [f"O{k}", f"P{k}"], mass=mass, com=(x, 0), inertia=0.01)
        m.angle(f"phi{k}", at=f"O{k}", to=f"P{k}")
    m.gear("mesh", "phi1", "phi2", internal=internal, **more)
    m.torque("load", "phi2", 2.0)
    m.gravity = (0, -G)
    return m


@pytest.mark.parametrize("internal", [False, True])
def test_gears_press_on_their_bearings(internal):
    """2 N m on 0.2 m: 10 N across the line of centres, and 10 tan 20° along it where a pressure angle is given."""
    alpha = np.radians(20)
    for more, along in (({}, 0.0), ({"pressure_angle": alpha}, 10 * np.tan(alpha))):
        system = pair(internal, **more).compile()
        motion = nc.motion(system, {"phi1": lambda t: 0.3 + 2.0 * t}, [0.0, 0.1])
        found = nc.inverse_dynamics(system, motion)
        r = found.reactions
        on = np.array(r.joint("mesh", on="w1").force)
        # External: the driver is held back at (0.1, 0) downwards, pressed towards its own centre; the same in a ring.
        across = -10.0 if not internal else 10.0
        assert np.allclose(on, [-along, across], rtol=1e-12, atol=1e-12)
        assert np.allclose(r.joint("mesh", on="w1").moment, across * 0.1, rtol=1e-12)
        assert np.allclose(r.joint("mesh", on="w2").force, -on, rtol=1e-12, atol=1e-12)
        assert np.allclose(r.joint("mesh", on="w2").moment, -2.0, rtol=1e-12)
        for k, sign in ((1, 1.0), (2, -1.0)):
            bearing = np.array([0.0, k * G]) - sign * on
            assert np.allclose(r.at(f"O{k}", on=f"w{k}").force, bearing, rtol=1e-12, atol=1e-12)
            assert np.allclose(r.support(f"O{k}"), bearing, rtol=1e-12, atol=1e-12)
        assert np.allclose(found["phi1"], 1.0 if not internal else -1.0, rtol=1e-12)


def test_friction_in_the_bearing_of_a_gear_feels_the_tooth_force():
    """A weightless pair without inertia: the driver carries 1 N m and μ r F in its own pin."""
    m = pair()
    m.gravity = (0, 0)
    m.friction("rub", coefficient=0.1, bodies=("w1", "ground"), at="O1", radius=0.02, speed=1e-6)
    system = m.compile()
    motion = nc.motion(system, {"phi1": lambda t: 0.3 - 2.0 * t}, [0.0, 0.1])
    found = nc.inverse_dynamics(system, motion)
    assert np.allclose(found["phi1"], 1.0 - 0.1 * 0.02 * 10.0, rtol=1e-9)
    assert np.allclose(found.reactions.on("w1")["load rub"].moment, 0.1 * 0.02 * 10.0, rtol=1e-9)


def test_the_pivot_of_a_slotted_arm_does_not_carry_the_slot():
    """A pin at 0.3 m from the pivot presses with 5 N across the arm: what holds the arm there is the support."""
    m = nc.Mechanism("arm")
    m.ground("A", (0, 0))
    m.ground("G", (0.3, -0.4))
    m.point("C", (0.5, 0))
    m.point("B", (0.3, 0))
    m.body("arm", ["A", "C"], mass=1.0, com=(0, 0), inertia=0.0)
    m.body("crank", ["G", "B"], mass=1.0, com=(0.3, -0.4), inertia=0.0)
    m.slot("slot", "B", line=("A", "C"))
    m.angle("phi", at="G", to="B")
    m.angle("psi", at="A", to="C")
    m.torque("load", "psi", 1.5)
    m.gravity = (0, -G)
    system = m.compile()
    found = nc.inverse_dynamics(system, nc.motion(system, {"phi": lambda t: np.pi / 2 + 0.0 * t}, [0.0, 0.1])).reactions
    assert np.allclose(found.joint("slot", on="arm").force, [0.0, -5.0], atol=1e-12)
    assert np.allclose(found.at("A", on="arm").force, [0.0, 5.0 + G], atol=1e-12)
    assert np.allclose(found.support("A"), [0.0, 5.0 + G], atol=1e-12)


def test_weights_are_drawn_at_the_centre_of_mass():
    m = nc.Mechanism("plate")
    m.ground("O", (0, 0))
    m.point("P", (1.0, 0))
    m.body("plate", ["O", "P"], mass=2.0, com=(0.4, 0.3), inertia=0.1)
    m.angle("phi", at="O", to="P")
    m.gravity = (0, -G)
    system = m.compile()
    motion = nc.motion(system, {"phi": lambda t: np.pi / 2 * t}, [0.0, 1.0])
    places, weights = nodal_forces(nc.reactions(motion))["weight"]
    assert np.allclose(places[:, 0], [(0.4, 0.3), (-0.3, 0.4)], atol=1e-12)
    assert np.array_equal(weights[:, 0], [(0.0, -2.0 * G)] * 2)


def test_a_pressure_angle_is_in_radians():
    m = pair()
    with pytest.raises(nc.MechanismError, match=r"pressure_angle=20.*radians.*0\.349"):
        m.gear("other", "phi1", "phi2", pressure_angle=20)


def test_reactions_are_those_of_the_masses_that_were_asked_for():
    """A crank at a steady speed: the ground holds m (a - g) with the mass of the system, not that of the motion's."""
    m = nc.Mechanism("crank")
    m.ground("O", (0, 0))
    m.point("P", (2, 0))
    m.body("bar", ["O", "P"], mass=1.0)
    m.angle("phi", at="O", to="P")
    m.gravity = (0, -10.0)
    light = m.compile()
    motion = nc.sweep(light, {"phi": np.array([0.0, 0.5])}, rates={"phi": 3.0})
    heavy = nc.inverse_dynamics(light.replace({"bar.mass": 7.0}), motion)
    away = np.stack([np.cos([0.0, 0.5]), np.sin([0.0, 0.5])], axis=1)
    wanted = 7.0 * (np.array([0.0, 10.0]) - 9.0 * away)  # the centre, at a radius of 1, is pulled inwards
    np.testing.assert_allclose(heavy.reactions.support("O"), wanted, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(heavy["phi"], 70.0 * away[:, 0], rtol=1e-9)


def truss(*forces):
    """Two bars without mass on two supports, which meet at C."""
    m = nc.Mechanism("truss")
    m.ground("A", (0, 0))
    m.ground("B", (2, 0))
    m.point("C", (1, 1))
    m.body("left", ["A", "C"])
    m.body("right", ["B", "C"])
    for k, force in enumerate(forces):
        m.force(f"load {k}", "C", force)
    return m


def test_bars_of_a_truss_without_mass_carry_what_the_method_of_joints_gives():
    found = nc.equilibrium(truss((3.0, -10.0)).compile()).reactions
    left, right = np.linalg.solve(np.array([[-1.0, 1.0], [-1.0, -1.0]]) / np.sqrt(2.0), [-3.0, 10.0])
    np.testing.assert_allclose(found.at("A", on="left").force, -left * np.array([1.0, 1.0]) / np.sqrt(2.0), atol=1e-12)
    np.testing.assert_allclose(
        found.at("B", on="right").force, right * np.array([1.0, -1.0]) / np.sqrt(2.0), atol=1e-12
    )
    with pytest.raises(nc.errors.InputError, match=r"(?s)truss.*mass="):
        nc.simulate(truss((3.0, -10.0)).compile(), np.linspace(0.0, 1.0, 3))


def test_an_input_holds_a_load_on_bars_without_mass():
    """A lever of length 2 at 30 degrees under a weight of 5: the input's torque is its moment."""
    m = nc.Mechanism("lever")
    m.ground("A", (0, 0))
    m.point("B", (2 * np.cos(np.pi / 6), 1.0))
    m.body("lever", ["A", "B"])
    m.angle("phi", at="A", to="B")
    m.force("weight", "B", (0.0, -5.0))
    moment = 5.0 * 2.0 * np.cos(np.pi / 6)
    held = nc.equilibrium(m.compile(), hold={"phi": np.pi / 6}).reactions
    np.testing.assert_allclose(held.effort("phi"), moment, rtol=1e-12)
    motion = nc.sweep(m.compile(), {"phi": np.array([np.pi / 6, np.pi / 3])}, rates={"phi": 0.0})
    efforts = nc.inverse_dynamics(m.compile(), motion).reactions.effort("phi")
    np.testing.assert_allclose(efforts, [moment, 5.0], rtol=1e-12)


def test_poses_that_were_not_found_have_no_forces_and_change_nobody_elses():
    """A rocker that cannot pass its dead point: what is beyond has zeros, and what is before what it has alone."""
    m = nc.Mechanism("double rocker")
    for name, at in {"A": (0, 0), "D": (3, 0)}.items():
        m.ground(name, at)
    for name, at in {"B": (0, 2), "C": (2, 2.2)}.items():
        m.point(name, at)
    for name, ends in {"left": "AB", "middle": "BC", "right": "CD"}.items():
        m.body(name, [*ends], mass=2.0)
    m.angle("phi", at="A", to="B")
    m.gravity = (0, -9.81)
    system, angles = m.compile(), np.array([1.4, 2.8, 1.6, 3.1])

    def found(angles):
        motion = nc.solve_position(system, {"phi": angles}, rates={"phi": 1.0}, throw=False)
        return motion.status != 0, nc.inverse_dynamics(system, motion).reactions

    lost, forces = found(angles)
    assert lost.tolist() == [False, True, False, True]
    alone = found(angles[[0, 2]])[1]
    pairs = [(forces.support("D"), alone.support("D")), (forces.effort("phi"), alone.effort("phi"))]
    pairs += [(a.force, alone.on("middle")[name].force) for name, a in forces.on("middle").items()]
    for every, some in pairs:
        assert not np.asarray(every)[[1, 3]].any()
        np.testing.assert_allclose(np.asarray(every)[[0, 2]], some, rtol=1e-9, atol=1e-9)


def test_a_lever_without_mass_rests_where_its_spring_carries_the_load():
    """A spring without free length pulls with k (D - B): the lever of length 2 points along k D + W."""
    m = nc.Mechanism("lever")
    m.ground("A", (0, 0))
    m.ground("D", (0, 2))
    m.point("B", (2, 0))
    m.body("lever", ["A", "B"])
    m.spring("spring", "B", "D", stiffness=100.0, free=0.0)
    m.force("load", "B", (90.0, -80.0))
    system = m.compile()
    along = np.array([0.6, 0.8])

    @nc.jit
    @functools.partial(jax.grad, has_aux=True)
    def by_design(s):
        found = nc.equilibrium(s, throw=False)
        return found["B"][0], found

    slope, found = by_design(system)
    np.testing.assert_allclose(found["B"], 2.0 * along, rtol=1e-12)
    np.testing.assert_allclose(found.reactions.at("A", on="lever").force, 50.0 * along, rtol=1e-12)
    assert found.stable
    np.testing.assert_allclose(slope["D"], 200.0 / 150.0 * np.array([0.64, -0.48]), rtol=1e-9)


def test_names_of_two_things_are_told_apart():
    m = nc.Mechanism("slider")
    m.ground("A", (0, 0))
    m.ground("G", (4, 0))
    m.point("B", (1, 1))
    m.point("S", (3, 0))
    m.body("crank", ["A", "B"], mass=1.0)
    m.body("slide", ["B", "S"], mass=1.0)
    m.slot("slide", "S", ("A", "G"))
    m.angle("phi", at="A", to="B")
    found = at_rest(m.compile(), phi=0.7)
    with pytest.raises(nc.errors.InputError, match=r"(?s)'slide'.*body.*joint.*'joint slide'"):
        found.rows("slide")
    assert len(found.rows("joint slide")) == 1 and len(found.rows("body slide")) == 1
    with pytest.raises(nc.errors.InputError, match="'psi'"):
        found.effort("psi")


def test_the_effort_of_a_torque_is_that_of_its_load():
    m = nc.Mechanism("crank")
    m.ground("A", (0, 0))
    m.point("B", (1, 0))
    m.body("crank", ["A", "B"], mass=1.0)
    m.angle("phi", at="A", to="B")
    m.torque("motor", "phi", 3.0)
    run = nc.simulate(m.compile(), np.linspace(0.0, 0.1, 3))
    reactions = nc.reactions(run)
    with pytest.raises(nc.errors.InputError, match=r"(?s)'phi'.*load\('motor'\)"):
        reactions.effort("phi")
    np.testing.assert_allclose(reactions.load("motor").value, 3.0)


def test_a_cylinder_pushes_on_the_ground_that_it_ends_at():
    """With the load it is in balance. The mechanism weighs nothing, and its forces are drawn."""
    m = nc.Mechanism("crane")
    m.ground("A", (0, 0)), m.ground("K", (1, -1))
    m.point("L", (2, 1)), m.point("T", (4, 1.5))
    m.body("boom", ["A", "L", "T"])
    m.force("load", "T", (0, -100.0))
    m.distance("c", "K", "L")
    m.angle("phi", at="A", to="T")
    motion = nc.sweep(m.compile(), {"c": [np.sqrt(5.0)]}, rates={"c": 0.0})
    found = nc.inverse_dynamics(motion.system, motion).reactions
    along = np.array([1.0, 2.0]) / np.sqrt(5.0)
    np.testing.assert_allclose(found.support("K")[0], found.effort("c")[0] * along, rtol=1e-12)
    np.testing.assert_allclose(found.support("A") + found.support("K"), [[0.0, 100.0]], atol=1e-10)
    pushed = np.asarray(found.support("K")[0])
    np.testing.assert_allclose(pushed[1] + pushed[0], 400.0, atol=1e-10)  # the moment about A
    assert nodal_forces(found)["weight"][0].shape == (1, 0, 2)


@pytest.mark.parametrize("last", [False, True])
def test_a_fixed_ring_presses_like_one_that_is_held(last):
    """Of a planetary gear: no pin carries a couple, in whatever order bodies are added."""

    def loaded(ring):
        m = nc.Mechanism("planetary")
        m.ground("O", (0, 0))
        (m.point if ring else m.ground)("R", (50, 0))
        m.point("P", (35, 0)), m.point("S", (20, 0)), m.point("Q", (50, 0))
        bodies = {"sun": "OS", "carrier": "OP", "planet": "PQ"} | ({"ring": "OR"} if ring else {})
        for name in sorted(bodies, reverse=last):
            m.body(name, list(bodies[name]))
        m.angle("phi", at="O", to="S"), m.angle("c", at="O", to="P")
        m.angle("s", at="O", to="S", start="P"), m.angle("p", at="P", to="Q", start="O")
        m.angle("r", at="O", to="R", start="P")
        if ring:
            m.angle("a", at="O", to="R")
        m.gear("inner", "s", "p", radii=(20, 15)), m.gear("outer", "r", "p", radii=(50, 15), internal=True)
        m.torque("load", "c", -1000.0)
        system = m.compile()
        motion = nc.sweep(system, {"phi": [0.3]}, rates={"phi": 0.0}, hold=["a"] if ring else [])
        return nc.inverse_dynamics(system, motion).reactions

    fixed, held = loaded(False), loaded(True)
    for name in ("sun", "carrier", "planet"):
        for key, wrench in fixed.on(name).items():
            np.testing.assert_allclose(wrench.force, held.on(name)[key].force, atol=1e-9)
            np.testing.assert_allclose(wrench.moment, held.on(name)[key].moment, atol=1e-9)
    pins = fixed.at("O", on="carrier").force + fixed.at("O", on="sun").force
    np.testing.assert_allclose(fixed.support("O"), pins, atol=1e-9)


def test_a_joint_tells_all_its_force_where_a_third_body_shares_its_point():
    m = nc.Mechanism("wheel", dim=3)
    m.ground("O", (0, 0, 0)), m.ground_vector("n", (0, 0, 1))
    m.point("C", (0, 0, 0.5)), m.vector("axis", (0, 1, 0)), m.vector("mark", (1, 0, 0)), m.point("E", (0, 0.1, 0.2))
    m.body("wheel", ["C"], vectors=["axis", "mark"], mass=2.0, com=(0, 0, 0.5), inertia=(0.1, 0.2, 0.1))
    m.body("frame", ["C", "E"], vectors=["axis"], mass=3.0, com=(0, 0, 0.4), inertia=(0.1, 0.1, 0.1))
    m.rolling_disc("roll", "C", "axis", "mark", ("O", "n"))
    m.gravity = (0, 0, -10)
    found = nc.reactions(nc.simulate(m.compile(), [0.0, 0.01]))
    np.testing.assert_allclose(found.joint("roll", on="wheel").force[0], [0.0, 0.0, 50.0], atol=1e-9)

    m = nc.Mechanism("car and trailer, hitched where the car's skate is")
    for name, at in {"P": (0, 0), "Q": (1, 0), "E": (-1, 0)}.items():
        m.point(name, at)
    m.body("car", ["P", "Q"], mass=2.0, com=(0.4, 0), inertia=0.3)
    m.body("trailer", ["P", "E"], mass=1.0)
    m.skate("skate", "P", ("P", "Q"))
    m.force("push", "Q", (0.0, 2.0))
    run = nc.simulate(m.compile(), [0.0, 0.01])
    p, q, e = (run.acceleration(name)[0] for name in "PQE")
    want = 2.0 * (p + 0.4 * (q - p)) + 0.5 * (p + e) - np.array([0.0, 2.0])
    np.testing.assert_allclose(nc.reactions(run).joint("skate", on="car").force[0], want, atol=1e-9)


@pytest.mark.parametrize("name", ["steering_column", "rolling_disc", "stewart_platform", "scotch_yoke", "gear_pair"])
def test_the_ground_carries_what_is_loaded(name):
    """Whatever joints, meshes and distances end on it: a load on every point, at rest."""
    m, rng = getattr(library, name)(), np.random.default_rng(3)
    loads = [rng.normal(size=m.model.dim) for p in m.model.points if p not in m.model.ground]
    for k, (point, load) in enumerate(zip((p for p in m.model.points if p not in m.model.ground), loads, strict=True)):
        m.force(f"load {k}", point, tuple(load))
    system = m.compile()
    drawn = nc.solve_position(system, {}, hold=list(system.independent))
    found = at_rest(system, **{n: float(drawn[n]) for n in system.independent})
    total = sum(loads) + sum(np.asarray(found.support(p))[0] for p in system.topology.points)
    np.testing.assert_allclose(total, 0.0, atol=1e-10)


@pytest.mark.parametrize("shape", [(0,), (3, 0)])
def test_no_poses_have_no_forces(shape):
    m = nc.Mechanism("pendulum")
    m.ground("A", (0, 0)), m.point("B", (1, 0)), m.body("rod", ["A", "B"], mass=1.0)
    m.angle("phi", at="A", to="B")
    none = nc.solve_position(m.compile(), {"phi": np.zeros(shape)}, rates={"phi": 1.0})
    found = nc.reactions(none)
    assert found.at("A", on="rod").force.shape == found.support("A").shape == (*shape, 2)
    assert nc.dynamics.angular_momentum(none).shape == nc.instant_centre(none, "rod").shape[:-1] == shape
    with pytest.raises(nc.InputError, match=r"first pose.*none"):
        found.unique()


@pytest.mark.parametrize("first", ["arm", "tool"])
def test_a_weld_does_not_act_on_other_points(first):
    """A bracket of two welded bodies, hinged at A, with a load at E: nothing acts at B and D, all of it passes in C."""
    m = nc.Mechanism("bracket")
    m.ground("A", (0, 0))
    for name, place in {"B": (1, 0), "C": (1, 1), "D": (2, 1), "E": (2, 2)}.items():
        m.point(name, place)
    m.body("arm", ["A", "B", "C"]), m.body("tool", ["C", "D", "E"])
    m.weld("w", first, "tool" if first == "arm" else "arm")
    m.angle("phi", at="A", to="B")
    m.force("F", "E", (0, -10.0))
    found = at_rest(m.compile(), phi=0.0)
    for point, body, force, moment in (
        ("B", "arm", (0, 0), 0),
        ("D", "tool", (0, 0), 0),
        ("E", "tool", (0, -10), 0),
        ("C", "tool", (0, 10), 10),
    ):
        wrench = found.at(point, on=body)
        np.testing.assert_allclose((*wrench.force[0], wrench.moment[0]), (*force, moment), atol=1e-9)


def test_a_weld_leaves_a_guide_alone():
    """A body on a vertical guide, and a loaded one welded to it: the guide's wrench at B balances the load."""
    m = nc.Mechanism("guide", dim=3)
    m.ground("A", (0, 0, 0)), m.ground_vector("z", (0, 0, 1)), m.ground_vector("x", (1, 0, 0))
    for name, place in {"B": (0, 0, 0.5), "C": (1, 0.5, 0.7), "D": (0.2, 1, 0.9), "E": (1.5, 1, 1)}.items():
        m.point(name, place)
    m.vector("u", (1, 0, 0))
    m.body("slider", ["B", "C"], vectors=["z", "u"]), m.body("tool", ["C", "D", "E"])
    m.prismatic("guide", line=("A", "z"), on="B", directions=("x", "u"))
    m.weld("w", "slider", "tool"), m.force("F", "E", (0, 0, -10.0)), m.distance("h", "A", "B", along="z")
    found = at_rest(m.compile(), h=0.5).at("B", on="slider")
    np.testing.assert_allclose(found.force[0], (0, 0, 10), atol=1e-9)
    np.testing.assert_allclose(found.moment[0], -np.cross((1.5, 1, 0.5), (0, 0, -10)), atol=1e-9)
