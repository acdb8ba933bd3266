"""Mechanisms as MJCF files: MuJoCo has them where we have them, with its own constraints met and as many freedoms."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import jax
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.library.catalogue import CATALOGUE
from jaxnc.robots.export_tree import note_lost
from jaxnc.solvers.assembly import sample_poses

mujoco = pytest.importorskip("mujoco")

PLACE = 1e-12  # of the drawing's size: sites and rows of MuJoCo's constraints, rounding
FREE = 1e-7  # of the largest singular value of MuJoCo's constraint matrix: a freedom
POSES = 21


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("mjcf")


def moved(m: nc.Mechanism, poses: int = POSES) -> nc.Motion:
    """The default drive of a mechanism of the library."""
    inputs, options = arguments(m, poses)
    motion = nc.sweep(m.compile(), inputs, **options)
    good = np.flatnonzero(np.asarray(motion.status))
    return motion.pose(slice(0, int(good[0]))) if len(good) else motion


def arguments(m: nc.Mechanism, poses: int):
    run = m.model.run
    degrees = {n for n in run.inputs if m.model.units.angle == "deg" and n in m.model.angles}
    inputs = {n: np.linspace(d.start, d.end, poses) for n, d in run.inputs.items()}
    return {n: np.radians(x) if n in degrees else x for n, x in inputs.items()}, {"hold": run.hold}


def size_of(motion: nc.Motion) -> float:
    return float(np.linalg.norm(np.ptp(np.asarray(motion.system.parameters.points), axis=0))) or 1.0


def in_mujoco(text: str, values: np.ndarray, watched):
    """Largest distance of a site from its place, largest row of an equality constraint, freedoms left, motors."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    data = mujoco.MjData(model)
    off, rows, lengths = 0.0, 0.0, []
    for k, qpos in enumerate(values):
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        at = {mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_SITE, i): data.site_xpos[i] for i in range(model.nsite)}
        for name, place in watched:
            found = [x for n, x in at.items() if n == name or n.startswith(f"{name} on ")]
            assert found, name
            off = max(off, *(float(np.abs(x - place[k]).max()) for x in found))
        own = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        rows = max(rows, float(np.abs(data.efc_pos[own]).max(initial=0.0)))
        lengths.append(np.array(data.actuator_length))
    matrix = data.efc_J.reshape(-1, model.nv)[own]
    values = np.linalg.svd(matrix, compute_uv=False) if len(matrix) else np.zeros(0)
    rank = int(np.sum(values > FREE * values.max(initial=1e-300)))
    motors = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, i) for i in range(model.nu)]
    return off, rows, model.nv - rank, dict(zip(motors, np.array(lengths).T, strict=True))


def watched_of(motion: nc.Motion):
    """Every point and marker of a mechanism in space."""
    top = motion.system.topology
    for name in (*top.points, *(x.name for x in top.markers if not x.direction)):
        place = np.zeros((len(motion.status), 3))
        place[:, : top.dim] = np.asarray(motion[name])
        yield name, place


def spins(m: nc.Mechanism, tree) -> int:
    """Bars with a ball joint turn about their own line in MuJoCo; here they do not know it."""
    parts = tree.parts
    return sum(p.turns == "bar" and not tree.links[tree.link_of[k]].spinless for k, p in enumerate(parts.parts) if k)


@pytest.mark.parametrize("name", CATALOGUE)
def test_of_the_library(name, folder):
    m = CATALOGUE[name]()
    motion = moved(m)
    done = m.to_mjcf(folder / f"{name}.xml", at=motion)
    text, watched = done.path.read_text(), list(watched_of(motion))
    size, values = size_of(motion), done.joint_values(motion)
    off, rows, free, motors = in_mujoco(text, values, watched)
    assert off <= PLACE * size and rows <= PLACE * max(size, 10.0)
    assert free == motion.system.degrees_of_freedom + spins(m, done._tree)
    assert not done.left_out
    assert len(motion.status) >= 20
    assert set(motors) == set(motion.driven)
    for drive, length in motors.items():  # a motor's length is the input, but for where it is counted from
        assert np.ptp(length - np.asarray(motion[drive])) <= PLACE * max(size, 10.0)
    # The same file without its loops is another mechanism, and this test says so; the door's second hinge is idle.
    if done.loops and name != "double-hinged-door":
        root = ET.fromstring(text)
        root.remove(root.find("equality"))
        assert in_mujoco(ET.tostring(root, encoding="unicode"), values[:1], [])[2] > free


# Joints of a description, each in the tree (a body on the ground) and closing a loop (at the end of six hinges).

E, F, G = np.linalg.qr(np.array([[0.48, 0.6, 0.1], [0.6, -0.48, 0.3], [0.64, 0.1, -0.9]]))[0].T
C = np.array([0.3, -0.2, 0.5])
JOINTS = {
    "revolute": (1, lambda m: m.revolute("J", "P", "Q", axes=("a", "b"))),
    "spherical": (3, lambda m: m.spherical("J", "P", "Q")),
    "cylindrical": (2, lambda m: m.cylindrical("J", line=("P", "a"), on=("Q", "b"))),
    "prismatic": (1, lambda m: m.prismatic("J", line=("P", "a"), on=("Q", "b"), directions=("e", "f"))),
    "universal": (2, lambda m: m.universal("J", axes=("e", "b"), point="P", other="Q")),
    "slot": (4, lambda m: m.slot("J", "Q", ("P", "a"))),
    "planar": (3, lambda m: m.planar("J", plane=("P", "a"), on=("Q", "b"))),
    "screw": (1, lambda m: m.screw("J", ("P", "a"), ("Q", "b"), ("e", "f"), "turn", "rise", pitch=0.1)),
    "constant velocity": (2, lambda m: m.constant_velocity("J", ("a", "b"), ("e", "f"), "P", "Q")),
}


def rig(joint: str, hinges: int) -> nc.Mechanism:
    m = nc.Mechanism(joint, dim=3)
    m.ground("P", C), m.ground_vector("a", E), m.ground_vector("e", F)
    m.point("Q", C), m.vector("b", E), m.vector("f", F)
    rng = np.random.default_rng(3)
    places = [C + rng.uniform(-0.5, 0.5, 3) for _ in range(hinges)]
    for k, place in enumerate(places):
        (m.point if k else m.ground)(f"P{k}", place)
        (m.vector if k else m.ground_vector)(f"u{k}", rng.normal(size=3))
    for k in range(hinges - 1):
        m.body(f"link{k}", [f"P{k}", f"P{k + 1}"], vectors=[f"u{k}", f"u{k + 1}"])
    own = ([f"P{hinges - 1}"], [f"u{hinges - 1}"]) if hinges else ([], [])
    m.body("last", ["Q", *own[0]], vectors=["b", "f", *own[1]])
    JOINTS[joint][1](m)
    return m


@pytest.mark.parametrize("hinges", [0, 6], ids=["tree", "loop"])
@pytest.mark.parametrize("joint", JOINTS)
def test_a_joint(joint, hinges, folder):
    m = rig(joint, hinges)
    system = m.compile()
    done = m.to_mjcf(folder / "joint.xml", at=system)
    q = np.array([sample.q for sample in sample_poses(system, 3)])
    home = [done._tree.joint_values(q)]
    watched = [(n, q[:, 3 * k : 3 * k + 3]) for k, n in enumerate(system.topology.points)]
    off, rows, free, _ = in_mujoco(done.path.read_text(), home[0], watched)
    assert off < 1e-12 and rows < 1e-12
    if joint == "constant velocity":
        assert done.left_out == ("joint 'J' (constant velocity): its freedoms are not kept",)
    else:
        assert not done.left_out
        assert free == system.degrees_of_freedom == JOINTS[joint][0]


def test_joints_in_the_plane(folder):
    """A pin of two points, a weld, a cable, a slider between moving bodies; by freedoms and in three poses."""
    m = nc.Mechanism("plane")
    for name, at in {"A": (0, 0), "D": (2, 0), "H": (-1, 0.3)}.items():
        m.ground(name, at)
    for name, at in {
        "B": (0.2, 1),
        "b": (0.2, 1),
        "C": (2.1, 1.2),
        "S": (0.9, 1.07),
        "T": (1.2, 1.7),
        "W": (2.6, 1.5),
    }.items():
        m.point(name, at)
    m.body("crank", ["A", "B"]), m.body("coupler", ["b", "C"]), m.body("rocker", ["C", "D"])
    m.body("block", ["S", "T"]), m.body("arm", ["C", "W"])
    m.revolute("pin", "B", "b"), m.weld("stiff", "rocker", "arm")
    m.prismatic("slide", line=("b", "C"), on=("S", "T")), m.cable("rope", ["H", "B", "W"])
    system = m.compile()
    done = m.to_mjcf(folder / "plane.xml", at=system)
    q = np.array([sample.q for sample in sample_poses(system, 3)])
    watched = [(n, np.pad(q[:, 2 * k : 2 * k + 2], ((0, 0), (0, 1)))) for k, n in enumerate(system.topology.points)]
    off, rows, free, _ = in_mujoco(done.path.read_text(), done._tree.joint_values(q), watched)
    assert off < 1e-12 and rows < 1e-12 and not done.left_out
    assert free == system.degrees_of_freedom


# Masses and loads: MuJoCo's energies and passive power at the velocities of a motion, against those by hand.

STEP = 1e-3  # s: differences of fourth order, in joint values of some radians
ENERGY = 1e-9  # of the largest energy: what such differences are worth
TIMES = (np.arange(5)[:, None] * 0.07 + 0.1 + STEP * np.arange(-2, 3)).reshape(-1)


def energies(done, motion: nc.Motion) -> np.ndarray:
    """Kinetic and potential energy and the power of passive forces, for every fifth pose ``(K, 3)``."""
    model = mujoco.MjModel.from_xml_path(str(done.path))
    data, found = mujoco.MjData(model), []
    for qpos in done.joint_values(motion).reshape(-1, 5, model.nq):
        outer, inner, momentum = np.zeros((3, model.nv))
        mujoco.mj_differentiatePos(model, outer, 1.0, qpos[0], qpos[4])
        mujoco.mj_differentiatePos(model, inner, 1.0, qpos[1], qpos[3])
        data.qpos[:], data.qvel[:] = qpos[2], (8.0 * inner - outer) / (12.0 * STEP)
        mujoco.mj_forward(model, data)
        mujoco.mj_mulM(model, data, momentum, data.qvel)
        mujoco.mj_energyPos(model, data)
        found.append((0.5 * momentum @ data.qvel, data.energy[0], data.qfrc_damper @ data.qvel))
    return np.array(found)


def middle(motion: nc.Motion, name: str, rate: bool = False) -> np.ndarray:
    """A quantity of every fifth pose."""
    return np.asarray(motion.velocity(name) if rate else motion[name])[2::5]


def test_masses_springs_and_dampers_of_a_chain(folder):
    m = nc.library.planar_3r(lengths=(0.5, 0.4, 0.2), angles=(0.6, 0.5, 0.4))
    m.gravity = (0.3, -9.81)
    m.mass("link1", 1.2), m.mass("link2", 0.7, com=(0.6, 0.5), inertia=0.02), m.mass("link3", 0.4, shape="rod")
    m.point_mass("mass at P", "P", 0.25)
    m.marker("c1", on="link1", at=0.25 * np.array([np.cos(0.6), np.sin(0.6)]))
    m.marker("c2", on="link2", at=(0.6, 0.5))
    m.marker("c3", on="link3", at=tuple((np.array(m.model.points["C"]) + m.model.points["P"]) / 2))
    m.spring("s1", "phi1", stiffness=3.0, free=0.2, preload=0.4), m.damper("d1", "phi1", damping=0.3)
    m.spring("s2", "A", "C", stiffness=40.0, free=0.5), m.damper("d2", "A", "C", damping=2.0)
    m.spring("s3", "phi3", stiffness=2.0)
    start, rates = {"phi1": 0.4, "phi2": 0.5, "phi3": 0.3}, {"phi1": 2.0, "phi2": -1.0, "phi3": 1.5}
    motion = nc.sweep(m.compile(), {n: x + rates[n] * TIMES for n, x in start.items()}, rates=rates)
    done = m.to_mjcf(folder / "heavy.xml", at=motion)
    kinetic, potential, damped = energies(done, motion).T
    turning = np.cumsum([middle(motion, f"phi{k}", rate=True) for k in (1, 2, 3)], axis=0)
    masses, inertias = (1.2, 0.7, 0.4, 0.25), (1.2 * 0.5**2 / 12, 0.02, 0.4 * 0.2**2 / 12)
    speeds = [middle(motion, name, rate=True) for name in ("c1", "c2", "c3", "P")]
    by_hand = sum(0.5 * w * (v**2).sum(-1) for w, v in zip(masses, speeds, strict=True))
    by_hand = by_hand + sum(0.5 * i * w**2 for i, w in zip(inertias, turning, strict=True))
    assert np.abs(kinetic - by_hand).max() < ENERGY * by_hand.max()
    x1, reach = middle(motion, "phi1") - 0.2, np.linalg.norm(middle(motion, "C"), axis=-1)
    stored = 0.4 * x1 + 1.5 * x1**2 + 20.0 * (reach - 0.5) ** 2 + (middle(motion, "phi3") - 0.4) ** 2
    for w, name in zip(masses, ("c1", "c2", "c3", "P"), strict=True):
        stored = stored - w * middle(motion, name) @ np.array([0.3, -9.81])
    assert np.ptp(potential - stored) < ENERGY * np.ptp(stored)
    opening = (middle(motion, "C") * middle(motion, "C", rate=True)).sum(-1) / reach
    lost = -0.3 * middle(motion, "phi1", rate=True) ** 2 - 2.0 * opening**2
    assert np.abs(damped - lost).max() < ENERGY * np.abs(lost).max()
    assert not done.left_out


def test_masses_of_a_loop_in_space(folder):
    """Bodies with general inertias, one of them on a ball joint."""
    m = nc.library.rscr(crank_angle=True)
    m.gravity = (0.0, 1.0, -9.81)
    tensor = np.diag([0.02, 0.03, 0.025]) + 0.003 * (1 - np.eye(3))
    bodies = ("crank", "coupler", "rocker")
    for k, body in enumerate(bodies):
        m.mass(body, 1.0 + k, com=(0.1 * k, 0.05, 0.1), inertia=(1 + k) * tensor)
        m.marker(f"c{k}", on=body, at=(0.1 * k, 0.05, 0.1))
    motion = nc.sweep(m.compile(), {"phi": 0.5 * TIMES}, rates={"phi": 0.5})
    done = m.to_mjcf(folder / "rscr.xml", at=motion)
    kinetic, potential, _ = energies(done, motion).T
    by_hand = weight = 0.0
    for k, body in enumerate(bodies):
        turn, w = np.asarray(motion.orientation(body))[2::5], np.asarray(motion.angular_velocity(body))[2::5]
        own = np.einsum("nji,nj->ni", turn, w)
        by_hand = by_hand + 0.5 * (1 + k) * ((middle(motion, f"c{k}", rate=True) ** 2).sum(-1)
                                             + np.einsum("ni,ij,nj->n", own, tensor, own))  # fmt: skip
        weight = weight - (1 + k) * middle(motion, f"c{k}") @ np.array([0.0, 1.0, -9.81])
    assert np.abs(kinetic - by_hand).max() < ENERGY * by_hand.max()
    assert np.ptp(potential - weight) < ENERGY * np.ptp(weight)


def test_a_body_of_one_point_weighs_what_it_weighs(folder):
    """A piston, which no link of its own stands for: its mass goes with its point."""
    m = nc.library.slider_crank()
    m.gravity = (0.0, -9.81)
    for body, mass in (("crank", 1.0), ("conrod", 2.0), ("slider", 5.0)):
        m.mass(body, mass)
    motion = nc.sweep(m.compile(), {"phi": 0.5 + TIMES}, rates={"phi": 1.0})
    done = m.to_mjcf(folder / "piston.xml", at=motion)
    speeds = {name: (middle(motion, name, rate=True) ** 2).sum(-1) for name in "BC"}
    together = (middle(motion, "B", rate=True) * middle(motion, "C", rate=True)).sum(-1)
    # Uniform bars: m/6 (u² + u·v + v²) of the speeds u and v of their ends.
    by_hand = speeds["B"] / 6 + 2.0 / 6 * (speeds["B"] + together + speeds["C"]) + 2.5 * speeds["C"]
    kinetic = energies(done, motion)[:, 0]
    assert np.abs(kinetic - by_hand).max() < 1e-6 * by_hand.max()  # a piece of the guide weighs so much
    m = nc.Mechanism("cart")
    m.ground("A", (0, 0)), m.ground("G", (1, 0)), m.point("B", (1, 0.4)), m.point("S", (2.5, 0), fixed="y")
    m.body("crank", ["A", "B"]), m.body("rod", ["B", "S"]), m.body("cart", ["S"], along=("A", "G"), mass=5.0)
    m.marker("M", on="cart", at=(2.6, 0.3)), m.angle("phi", at="A", to="B")
    done = m.to_mjcf(folder / "cart.xml")
    assert abs(mujoco.MjModel.from_xml_path(str(done.path)).body_mass.sum() - 5.0) < 1e-4
    assert any("marker 'M'" in said for said in done.left_out)


# What cannot be written.


def test_what_is_left_out_is_named(folder):
    m = nc.library.four_bar()
    m.mass("crank", 1.0)
    m.spring("soft", "phi", stiffness=2.0, cubic=3.0)
    m.torque("drive", "phi", lambda t, state, p: 0.0)
    m.force("push", "B", (0.0, -1.0))
    m.friction("rub", coefficient=0.1, bodies=("crank", "coupler"), at="B", radius=0.01)
    done = m.to_mjcf(folder / 'a <b> & "c".xml')
    for name in ("'soft'", "'drive'", "'push'", "'rub'"):
        assert sum(name in said for said in done.left_out) == 1, done.left_out
    assert any("coupler" in said and "no mass" in said for said in done.notes)
    assert "left out: friction 'rub'" in str(done) and "phi: 1 + 'A crank'" in str(done)
    mujoco.MjModel.from_xml_path(str(done.path))


def test_stops_are_limits(folder):
    m = nc.library.planar_3r()
    m.stop("end", "phi2", stiffness=100.0, lower=-0.2, upper=1.3)
    done = m.to_mjcf(folder / "stop.xml")
    model = mujoco.MjModel.from_xml_path(str(done.path))
    home = 0.5  # of phi2, in the drawing
    assert np.allclose(model.jnt_range[done.joints.index("B link2")], (-0.2 - home, 1.3 - home))
    assert any("limit" in said for said in done.notes)


def test_wrong_questions(tmp_path):
    m, other = nc.library.four_bar(), nc.library.slider_crank()
    with pytest.raises(nc.InputError, match=r"ends in \.xml.*call it robot\.xml"):
        m.to_mjcf(tmp_path / "robot.mjb")
    with pytest.raises(nc.InputError, match="was not compiled from"):
        m.to_mjcf(tmp_path / "robot.xml", at=other.compile())
    failed = nc.sweep(m.compile(), {"B.x": [0.0, 10.0]}, throw=False)
    with pytest.raises(nc.AssemblyError):
        m.to_mjcf(tmp_path / "robot.xml", at=failed)
    assert not list(tmp_path.iterdir())


def test_a_small_mechanism_without_ground_is_opened(folder):
    """An elliptic trammel of two millimetres, in metres: its capsules weigh less than MuJoCo takes."""
    m = nc.Mechanism("trammel")
    m.point("X", (8e-4, 0), fixed="y"), m.point("Y", (0, 6e-4), fixed="x"), m.point("P", (1.6e-3, -6e-4))
    m.body("bar", ["X", "Y", "P"]), m.angle("t", at="Y", to="X")
    t = np.linspace(0.1, 6.2, 5)
    done = m.to_mjcf(folder / "trammel.xml", at=nc.sweep(m.compile(), {"t": t}))
    assert not done.left_out
    place = 1e-3 * np.stack([2 * np.cos(t), np.sin(t), 0 * t], axis=-1)
    off, rows, free, _ = in_mujoco(
        done.path.read_text(), done.joint_values(nc.sweep(m.compile(), {"t": t})), [("P", place)]
    )
    assert off < 1e-14 and rows < 1e-14 and free == 1
    # MuJoCo before 4.0 finds no principal axes below 1e-14, and bounds change what it has found.
    model = mujoco.MjModel.from_xml_path(str(done.path))
    assert model.body_inertia[1:].min() > 1e-13 and "6.25e+10 kg a cubic unit" in str(done)


def test_inertias_that_mujoco_does_not_take_are_named(tmp_path):
    m = nc.Mechanism("tiny")
    m.ground("O", (0, 0)), m.point("P", (2e-4, 0)), m.body("bar", ["O", "P"], mass=1e-8), m.angle("t", at="O", to="P")
    said = r"'bar' has a mass or inertia of \S+e-17, and MuJoCo takes none below 1e-14.*mm in place of m"
    assert re.search(said, str(m.to_mjcf(tmp_path / "tiny.xml")))
    assert "takes none" not in str(m.to_urdf(tmp_path / "tiny.urdf"))


ARM = """<mujoco><compiler angle="radian"/><worldbody><body name="a"><joint name="ja" axis="0 0 1"/><geom size=".05"/>
<body name="b" pos=".5 0 0"><joint name="jb" axis="0 .2 1"/><joint name="jc" type="slide" axis="1 .3 0" pos=".1 0 0"/>
<joint name="jd" axis="1 0 .4" pos=".1 .2 0"/><geom size=".05"/><site name="tip" pos=".3 0 .1"/></body></body>
</worldbody>
<keyframe><key name="there" qpos=".4 1 .1 -.3"/></keyframe></mujoco>"""


@pytest.mark.parametrize(
    ("points", "vectors", "joint", "freedoms"),
    [
        ("Q", "uv", lambda m: m.slot("g", "Q", ("P", "u")), 1),
        ("QR", "u", lambda m: m.slot("g", "Q", ("P", "u")), 2),
        ("Q", "uv", lambda m: m.planar("g", plane=("P", "u"), on="Q"), 2),
        ("Q", "uv", lambda m: m.planar("g", plane=("P", "u"), on=("Q", "u")), 2),
        ("Q", "uv", lambda m: None, 3),
        ("QR", "u", lambda m: None, 4),
        ("QR", "u", lambda m: m.spherical("g", "P", "Q"), 1),
        ("QR", "uv", lambda m: m.cylindrical("g", line=("P", "u"), on="Q"), 1),
        ("QR", "uv", lambda m: (m.slot("g", "Q", ("P", "u")), m.slot("h", "R", ("P2", "u"))), 1),
    ],
)
def test_bodies_that_share_unit_vectors_have_no_more_freedoms_in_a_file(points, vectors, joint, freedoms, tmp_path):
    """Freedoms by hand: two shared vectors leave no turn, one leaves that about it."""
    m = nc.Mechanism("shared", dim=3)
    for name, at in (("P", (0, 0, 0)), ("P2", (0.1, 0.2, 0))):
        m.ground(name, at)
    m.ground_vector("u", (0, 0, 1))
    m.ground_vector("v", (1, 0, 0))
    where = {"Q": (0, 0, 0), "R": (0.1, 0.2, 0.3)}
    for name in points:
        m.point(name, where[name])
    m.body("s", list(points), vectors=list(vectors), mass=1.0, com=(0.3, 0, 0.2), inertia=np.diag([0.01, 0.02, 0.02]))
    joint(m)
    done = m.to_mjcf(tmp_path / "shared.xml")
    model = mujoco.MjModel.from_xml_path(str(done.path))
    model.opt.jacobian, data = mujoco.mjtJacobian.mjJAC_DENSE, mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rank = np.linalg.matrix_rank(data.efc_J.reshape(-1, model.nv), tol=FREE) if data.nefc else 0
    assert (model.nv - rank, done.left_out) == (freedoms, ())
    urdf = nc.from_urdf(m.to_urdf(tmp_path / "shared.urdf").path)
    assert urdf.system.degrees_of_freedom == freedoms


def test_a_slide_that_was_read_is_written_as_a_slide(tmp_path):
    (tmp_path / "one.xml").write_text(
        '<mujoco><worldbody><body><joint name="d" type="slide" axis="0 .6 .8"/><geom size=".1" pos=".3 0 .2"/></body>'
        "</worldbody></mujoco>"
    )
    done = nc.from_mjcf(tmp_path / "one.xml").mechanism.to_mjcf(tmp_path / "two.xml")
    model = mujoco.MjModel.from_xml_path(str(done.path))
    assert (model.nv, int(model.jnt_type[0])) == (1, int(mujoco.mjtJoint.mjJNT_SLIDE))
    np.testing.assert_allclose(np.abs(model.jnt_axis[0]), (0, 0.6, 0.8), atol=1e-12)


def test_what_a_tree_does_not_keep_is_named(tmp_path):
    """A tree whose loop is opened, and one that turns where the mechanism slides."""
    tree = nc.library.four_bar().to_mjcf(tmp_path / "open.xml")._tree
    tree.description.loops.clear()
    note_lost(tree)
    assert any("point 'C'" in said for said in tree.description.left_out), tree.description.left_out
    tree = nc.library.slider_crank().to_mjcf(tmp_path / "turned.xml")._tree
    slide = next(joint for joint in tree.joints.values() if joint.kind == "slide")
    slide.axis = np.array([0.0, 1.0, 0.0])
    note_lost(tree)
    assert tree.description.left_out


@pytest.mark.parametrize("home", [None, "there"])
def test_a_design_of_a_robot_is_saved_as_it_is_whatever_pose_it_was_drawn_in(home, tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    robot = nc.from_mjcf(tmp_path / "arm.xml", home=home)
    design = robot.system.replace({n: robot.system[n] + np.array([0.02, 0.05, -0.01]) for n in ("jb_at", "jd_at")})
    robot.save(tmp_path / "out.xml", design)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    data = mujoco.MjData(model)
    for values in np.random.default_rng(3).uniform(-0.5, 0.5, (3, 4)):
        data.qpos[:] = robot.positions(values, design)
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(data.site("tip").xpos, robot.pose(values, design)["tip"], atol=1e-5)


@pytest.mark.parametrize("closed", ['weld body1="k" body2="k2"', 'connect body1="k2" body2="k" anchor="-.15 0 -.1"'])
@pytest.mark.parametrize("home", [None, {"a": 0.15}])
def test_a_loop_that_was_not_moved_stays_closed_whatever_pose_it_was_drawn_in(home, closed, tmp_path):
    """MuJoCo reads one of its ends off qpos0, where a design that is drawn in another pose is not closed."""
    link = '<geom type="capsule" size=".02" fromto="0 0 0 {}" contype="0" conaffinity="0"/>'.format
    fourth = '<joint name="e" axis="0 1 0"/>' if "weld" in closed else ""
    (tmp_path / "loop.xml").write_text(f'''<mujoco><worldbody><body><joint name="a" axis="0 1 0"/>{link(".1 0 0")}
        <body name="k" pos=".1 0 0"><joint name="b" axis="0 1 0"/>{link(".15 0 .1")}</body></body>
        <body pos=".4 0 0"><joint name="d" axis="0 1 0"/>{link("0 0 .2")}<body name="k2" pos="0 0 .2">{fourth}
        {link("-.15 0 -.1")}</body></body></worldbody><equality><{closed}/></equality></mujoco>''')  # fmt: skip
    robot = nc.from_mjcf(tmp_path / "loop.xml", home=home)
    design = robot.system.replace({"b_at": robot.system["b_at"] + np.array([0.01, 0.0, 0.005])})
    model = mujoco.MjModel.from_xml_path(str(robot.save(tmp_path / "out.xml", design)))
    data = mujoco.MjData(model)
    for a in (-0.2, 0.1, 0.3):
        data.qpos[:] = robot.positions([a], design)
        mujoco.mj_forward(model, data)
        assert data.ne
        np.testing.assert_allclose(data.efc_pos[: data.ne], 0.0, atol=2e-6)  # a file has six digits
    again = nc.from_mjcf(tmp_path / "out.xml")
    for a in (-0.2, 0.1, 0.3):
        data.qpos[:] = again.positions([a])
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.efc_pos[: data.ne], 0.0, atol=2e-6)
        np.testing.assert_allclose(data.qpos, robot.positions([a], design), atol=2e-5)


def test_the_frame_of_a_rod_is_where_the_saved_file_has_it(tmp_path):
    """The design's ball is beside the line on which the frame was drawn."""
    link = '<geom type="capsule" size=".02" fromto="0 0 0 {}" contype="0" conaffinity="0"/>'.format
    (tmp_path / "rod.xml").write_text(f'''<mujoco><worldbody><body><joint name="a" axis="0 0 1"/>{link(".1 0 0")}
        <body name="rod" pos=".1 0 0"><joint name="b" type="ball"/>{link(".2 .1 .2")}</body></body>
        <body name="r" pos=".3 .1 0"><joint name="d" axis="1 0 0"/>{link("0 0 .2")}</body></worldbody>
        <equality><connect body1="rod" body2="r" anchor=".2 .1 .2"/></equality></mujoco>''')  # fmt: skip
    robot = nc.from_mjcf(tmp_path / "rod.xml")
    shifts = np.array([[0.0, 0.02, 0.0], [0.0, 0.005, 0.0], [0.0, 0.01, 0.0]])
    designs = [robot.system.replace({"b_at": robot.system["b_at"] + shift}) for shift in shifts]
    batch = jax.tree.map(lambda *x: np.stack(x), *designs)
    poses = jax.vmap(lambda design: robot.pose([[-0.2], [0.2]], design))(batch)  # those of all designs in one
    (places, axes), values = robot.frames(poses)["rod"], np.asarray(robot.joint_values(poses))
    for n, design in enumerate(designs):
        model = mujoco.MjModel.from_xml_path(str(robot.save(tmp_path / "out.xml", design)))
        data, alone = mujoco.MjData(model), robot.frames(robot.pose([[-0.2], [0.2]], design))["rod"]
        for k, data.qpos[:] in enumerate(values[n]):
            mujoco.mj_forward(model, data)
            np.testing.assert_allclose(data.efc_pos[: data.ne], 0.0, atol=1e-6)
            for place, turn in ((places[n], axes[n]), alone):
                np.testing.assert_allclose(place[k], data.body("rod").xpos, atol=1e-6)
                np.testing.assert_allclose(turn[k].ravel(), data.body("rod").xmat, atol=1e-5)


@pytest.mark.parametrize("turn", [(0.5, 0.5, 0.5, 0.5), (0.7071, 0, 0, 0.7071), (0.7071, 0.7071, 0, 0)])
def test_a_keyframe_may_turn_a_ball_by_a_quarter(turn, tmp_path):
    """Coordinates that say where the ball is at first say nothing there."""
    numbers = " ".join(map(str, turn))
    (tmp_path / "ball.xml").write_text(
        f'''<mujoco><worldbody><body name="a"><joint name="ba" type="ball"/><geom size=".1" pos=".2 0 0"/>
        <body name="b" pos=".5 0 0"><joint name="jb" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/></body></body>
        </worldbody><keyframe><key name="k" qpos="{numbers} .3"/></keyframe></mujoco>'''
    )
    robot = nc.from_mjcf(tmp_path / "ball.xml", home="k")
    found, want = np.asarray(robot.positions([0.3]))[:4], np.array(turn) / np.linalg.norm(turn)
    assert min(np.abs(found - want).max(), np.abs(found + want).max()) < 1e-12


def test_the_first_of_two_hinges_stays_where_it_is_when_the_second_moves(tmp_path):
    """It hangs on the ground: MuJoCo has its place and axis there in every pose."""
    (tmp_path / "two.xml").write_text(
        '<mujoco><worldbody><body name="b" pos="0 0 .5"><joint name="a" axis="0 0 1" pos=".1 0 0"/>'
        '<joint name="s" type="slide" axis="1 0 1" pos="0 .1 0"/><joint name="c" axis="0 1 0" pos="0 0 .2"/>'
        '<geom size=".1" pos="0 0 .3"/></body></worldbody></mujoco>'
    )
    robot = nc.from_mjcf(tmp_path / "two.xml", home={"c": 1.0, "a": 0.2, "s": 0.1})
    design = robot.system.replace({"c_axis": np.array([0.3, 1.0, 0.0])})
    path = robot.save(tmp_path / "out.xml", design)
    data = mujoco.MjData(model := mujoco.MjModel.from_xml_path(str(path)))
    for data.qpos[:] in ([0.2, 0.1, 1.0], [0.7, -0.2, 0.2]):
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(data.joint("a").xanchor[:2], (0.1, 0.0), atol=1e-5)
        np.testing.assert_allclose(data.joint("a").xaxis, (0, 0, 1), atol=1e-5)
    again = nc.from_mjcf(path, home={"c": 1.0, "a": 0.2, "s": 0.1}).system
    np.testing.assert_allclose(again["s_at"], robot.system["s_at"], atol=1e-6)
