"""Robots read from MJCF, loops included: all joints from the actuated ones, as MuJoCo's own constraints want them."""

import copy
import pickle
import re
import time
from pathlib import Path

import jax
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.library.catalogue import CATALOGUE
from jaxnc.robots import Robot
from jaxnc.status import Status

mujoco = pytest.importorskip("mujoco")

PLACE = 1e-12  # places of bodies and rows of MuJoCo's constraints, of robots of about one metre: rounding
WRITTEN = 1e-6  # what MuJoCo writes has six digits
POSES = 24


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("robots")


# A gripper of two fingers, each a loop with a spring, that one motor drives through a tendon; degrees, classes, frames.
GRIPPER = """
<mujoco model="gripper"><compiler angle="degree" eulerseq="xyz"/><option gravity="0 0 -9.81"/>
<default><default class="finger"><joint axis="1 0 0"/>
  <default class="soft"><joint stiffness="0.05" springref="40" damping="0.002"/></default></default></default>
<asset><mesh name="shell" file="shell.stl"/></asset>
<worldbody><body name="palm" pos="0 0 0.1" euler="0 0 30" childclass="finger">
  <geom type="mesh" mesh="shell"/><geom name="pad" size="0.01"/>
  <body name="driver" pos="0 0.03 0.05"><joint name="driver joint" ref="10" range="-60 60"/><geom size="0.01"/>
    <body name="coupler" pos="0 0.03 -0.004"><joint name="coupler-joint"/><geom size="0.01"/></body></body>
  <body name="spring link" pos="0 0.013 0.06"><joint name="spring.joint" class="soft"/><geom size="0.01"/>
    <body name="tip" pos="0 0.055 0.04" euler="15 0 0"><joint name="tip joint" pos="0 -0.018 0.0065"/>
      <geom size="0.01"/><site name="touch" pos="0 0 0.05"/></body></body>
  <frame euler="0 0 180">
    <body name="driver2" pos="0 0.03 0.05"><joint name="driver2 joint"/><geom size="0.01"/>
      <body name="coupler2" pos="0 0.03 -0.004"><joint name="coupler2"/><geom size="0.01"/></body></body>
    <body name="link2" pos="0 0.013 0.06"><joint name="link2" class="soft"/><geom size="0.01"/>
      <body name="tip2" pos="0 0.055 0.04"><joint name="tip2 joint" pos="0 -0.018 0.0065"/>
        <geom size="0.01"/></body></body>
  </frame></body></worldbody>
<tendon><fixed name="both"><joint joint="driver joint" coef="0.5"/><joint joint="driver2 joint" coef="0.5"/></fixed>
</tendon>
<equality><connect name="close" body1="tip" body2="coupler" anchor="0 -0.03 0.01"/>
  <connect name="close2" body1="tip2" body2="coupler2" anchor="0 -0.03 0.01"/>
  <joint name="same" joint1="driver2 joint" joint2="driver joint" polycoef="0 1 0.1 0 0"/></equality>
<actuator><position name="grip" tendon="both"/></actuator></mujoco>
"""

# A leg: hinges in three directions, a rod on a ball joint that closes by a connect between sites, a slide, a weld.
LEG = """
<mujoco model="leg"><worldbody>
  <body name="hip" pos="0 0 1"><freejoint/><geom size="0.05"/>
    <body name="thigh" pos="0.1 0 0" quat="1 0.1 0.2 0"><joint name="roll" axis="1 0 0"/>
      <joint name="pitch" axis="0 1 0"/>
      <geom size="0.05"/><site name="a" pos="0 0.05 0"/>
      <body name="rod" pos="0 0.05 0.03" euler="10 20 0"><joint name="ball" type="ball"/>
        <inertial pos="0.2 0 0" mass="0.1" diaginertia="1e-4 2e-3 2e-3"/><site name="b" pos="0.4 0 0"/></body>
      <body name="shin" pos="0.4 0 0"><joint name="knee" axis="0 1 0"/><geom size="0.05"/>
        <body name="lever" pos="0 0 -0.1"><joint name="lever" axis="0.6 0 0.8" stiffness="3"/><geom size="0.05"/>
          <site name="c" pos="0.02 0.1 0.1"/></body>
        <body name="toe" pos="0.3 0 0"><joint name="toe" type="slide" axis="1 0 0"/><geom size="0.05"/></body>
      </body></body></body></worldbody>
<equality><connect name="tie" site1="b" site2="c"/></equality>
<actuator><motor joint="roll"/><motor joint="pitch"/><motor joint="knee"/><motor joint="toe"/></actuator></mujoco>
"""


def read(folder: Path, text: str, name: str = "robot.xml", **options) -> Robot:
    (folder / name).write_text(text)
    return nc.from_mjcf(folder / name, **options)


def check(path: Path, robot: Robot, values, system=None) -> np.ndarray:
    """MuJoCo has all bodies where the robot has them, and its constraints are met; the robot's joint values."""
    exact = PLACE if system is None else WRITTEN
    motion = robot.pose(values, system).check()
    qpos, frames = np.asarray(robot.joint_values(motion)), robot.frames(motion)
    model = (robot if system is None else nc.from_mjcf(path))._file.model
    data = mujoco.MjData(model)
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, i) for i in range(1, model.nbody)]
    assert set(names) == set(frames)
    for k in range(len(qpos)):
        data.qpos[:] = qpos[k]
        mujoco.mj_forward(model, data)
        own = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        assert own.sum() and np.abs(data.efc_pos[own]).max() < exact
        for i, name in enumerate(names, start=1):
            place, axes = frames[name]
            assert np.abs(data.xpos[i] - place[k]).max() < exact, name
            assert np.abs(data.xmat[i].reshape(3, 3) - axes[k]).max() < 10 * exact, name
    return qpos


def values_of(robot: Robot, width: float = 0.3) -> np.ndarray:
    """Values of the actuated joints around home."""
    home = np.array([robot._description.joints[j].reference for c in robot.actuated
                     for j, own in robot.coordinates.items() if own == c])  # fmt: skip
    return home + width * np.random.default_rng(5).uniform(-1, 1, (POSES, len(home)))


@pytest.mark.parametrize(
    "name", ["four-bar", "slider-crank", "quick-return", "five-bar", "rssr", "bennett", "delta-robot", "cardan-joint"]
)
def test_what_was_written_is_read(name, folder):
    """The way out and back: the same motion from the same inputs, joint for joint."""
    m = CATALOGUE[name]()
    run = m.model.run
    ends = {n: (d.start, d.start + 0.15 * (d.end - d.start)) for n, d in run.inputs.items()}
    motion = nc.sweep(m.compile(), {n: np.linspace(*x, POSES) for n, x in ends.items()})
    done = m.to_mjcf(folder / "again.xml", at=motion)
    robot = nc.from_mjcf(done.path)
    qpos = done.joint_values(motion)
    assert robot.joints == done.joints and len(robot.actuated) == len(run.inputs) and not robot.held
    at = {j: robot._file.model.joint(j).qposadr[0] for j in robot.joints}
    driven = [j for c in robot.actuated for j, own in robot.coordinates.items() if own == c]
    got = check(done.path, robot, qpos[:, [at[j] for j in driven]])
    assert np.abs(got - qpos)[:, [at[j] for j in robot.coordinates]].max() < 1e-10


@pytest.fixture(scope="module")
def gripper(folder) -> Robot:
    return read(folder, GRIPPER, "gripper.xml")


def test_a_gripper(gripper, folder):
    assert gripper.actuated == ("driver_joint",) and gripper.held == ("spring_joint", "link2")
    qpos = check(folder / "gripper.xml", gripper, values_of(gripper, 0.1))
    assert np.ptp(qpos[:, list(gripper.joints).index("tip2 joint")]) > 0.05
    said = "\n".join(gripper.left_out)
    for part in ("contacts of geoms: geom 0, pad", "meshes that are not there".replace("meshes", "meshes and pictures"),
                 "limits of joints: driver joint", "tendons: both"):  # fmt: skip
        assert part in said, said
    assert "masses, which come from meshes that are not there, of bodies: palm" in said


def test_a_leg_on_a_rod(folder):
    robot = read(folder, LEG, "leg.xml")
    assert robot.actuated == ("roll", "pitch", "knee", "toe") and not robot.held
    assert "floating body 'hip'" in "\n".join(robot.notes)
    # The sites of the rod and the lever are apart at home: the loop is closed from the start pose that is nearest.
    robot = read(folder, LEG, "leg.xml", home={"knee": 0.3})
    check(folder / "leg.xml", robot, values_of(robot, 0.15))


# The ankle of a humanoid: two motors turn cranks, whose rods on balls pitch and roll the foot through a cross.
ANKLE = """
<mujoco model="ankle"><worldbody><body name="shank"><geom size=".01"/>
  <body name="cross"><joint name="pitch" axis="0 1 0"/><inertial pos="0 0 0" mass=".01" diaginertia="1e-5 1e-5 1e-5"/>
    <body name="foot"><joint name="roll" axis="1 0 0"/><geom type="box" size=".1 .05 .01"/>
      <site name="heel left" pos="-.05 .04 0"/><site name="heel right" pos="-.05 -.04 0"/></body></body>
  <body name="crank left" pos="0 .04 .25"><joint name="left" axis="0 1 0"/><geom size=".005"/>
    <body name="rod left" pos="-.05 0 0"><joint name="ball left" type="ball"/><geom size=".004"/>
      <site name="end left" pos="0 0 -.25"/></body></body>
  <body name="crank right" pos="0 -.04 .25"><joint name="right" axis="0 1 0"/><geom size=".005"/>
    <body name="rod right" pos="-.05 0 0"><joint name="ball right" type="ball"/><geom size=".004"/>
      <site name="end right" pos="0 0 -.25"/></body></body></body></worldbody>
<equality><connect site1="end left" site2="heel left"/><connect site1="end right" site2="heel right"/></equality>
<actuator><position joint="left"/><position joint="right"/></actuator></mujoco>
"""


@pytest.fixture(scope="module")
def ankle(folder) -> Robot:
    return read(folder, ANKLE, "ankle.xml")


def test_an_ankle_of_two_motors(ankle, folder):
    assert ankle.actuated == ("left", "right") and not ankle.held
    check(folder / "ankle.xml", ankle, values_of(ankle, 0.3))


def test_every_assembly_of_an_ankle(ankle):
    """Of eight solutions four are real; Newton's steps from 400 random poses ended in no other upright one."""
    values = {"left": 0.1, "right": -0.2}
    found = nc.modes(ankle.system, values)
    assert (len(found), found.expected, found.complete) == (4, 8, True)
    pose = np.asarray(nc.solve_position(ankle.system, values)["heel_left"])
    assert np.abs(np.asarray(found.poses["heel_left"]) - pose).max(axis=1).min() < 1e-10


@pytest.mark.parametrize("shape", [(1,), (2, 1), (0,)])
@pytest.mark.parametrize("text", ["ankle", "leg"])
def test_all_that_is_told_has_the_leading_shape_of_the_motors(text, shape, ankle, folder):
    """Of hinges, balls and rods without spin; of slides, and of a floating body that is held."""
    robot = ankle if text == "ankle" else read(folder, LEG, "leg.xml")

    def told(values):
        pose = robot.pose(values)
        return robot.positions(values), robot.joint_values(pose), robot.frames(pose), pose.status

    one = np.full(len(robot.actuated), 0.1)
    ways = [(told, shape)]
    if (text, shape) == ("ankle", (1,)):
        ways += [(jax.jit(told), shape), (jax.jit(jax.vmap(told)), (2, *shape))]
    for way, lead in ways:
        found = way(np.broadcast_to(one, (*lead, len(one))))
        for mine, wanted in zip(*map(jax.tree.leaves, (found, told(one))), strict=True):
            np.testing.assert_allclose(mine, np.broadcast_to(wanted, (*lead, *np.shape(wanted))), atol=1e-12)


@pytest.mark.slow
def test_many_lanes_of_an_ankle_are_those_of_few(ankle):
    """Hundreds are followed side by side, thousands begin from a table; each is what it is alone."""
    values = np.random.default_rng(2).uniform(-0.3, 0.3, (1500, 2))
    found = {count: ankle.pose(values[:count], repair=False) for count in (300, 1500)}
    for motion in found.values():
        assert not np.asarray(motion.status).any()
    np.testing.assert_allclose(found[300].q, found[1500].q[:300], atol=1e-11)
    for k in range(3):
        np.testing.assert_allclose(ankle.pose(values[k]).q, found[300].q[k], atol=1e-11)


@pytest.mark.slow
def test_lanes_beyond_reach_end_where_a_single_one_does(ankle):
    """Far motors, tried from a table first: what the cranks cannot reach is said as the host says it of each."""
    values = np.random.default_rng(3).uniform(-1.6, 1.6, (1500, 2))  # as many as above: the same program
    motion = ankle.pose(values, repair=False)
    status = np.asarray(motion.status)
    assert set(status.tolist()) == {int(Status.CONVERGED), int(Status.DID_NOT_ASSEMBLE)}
    assert np.sum(status != 0) > 100
    for k in [*np.flatnonzero(status)[:12], *np.flatnonzero(status == 0)[:12]]:
        alone = ankle.pose(values[k], throw=False)
        assert int(alone.status) == status[k]
        # A branch ends at a fold, where poses change as the root of what is left of the way.
        np.testing.assert_allclose(alone.q, motion.q[k], atol=1e-11 if status[k] == 0 else 3e-3)


def test_designs(gripper, folder):
    """Other lengths: differentiated, and written back into the file, in which MuJoCo then meets them."""
    values, tip = np.array([0.05 + np.radians(10)]), list(gripper.joints).index("tip joint")
    longer = gripper.system["coupler_joint_at"] + np.array([0.0, 0.002, 0.003])
    system = gripper.system.replace({"coupler_joint_at": longer, "close_at": gripper.system["close_at"] + 0.001})
    path = gripper.save(folder / "longer.xml", system)
    ours = check(path, gripper, np.repeat(values[None], 3, axis=0), system)
    again = nc.from_mjcf(path)
    assert np.abs(np.asarray(again.positions(values)) - ours[0]).max() < WRITTEN
    assert abs(ours[0, tip] - np.asarray(gripper.positions(values))[tip]) > 1e-3
    assert "shell.stl" in path.read_text() and gripper.save(folder / "same.xml").exists()


def test_a_narrow_design_has_narrow_answers(ankle):
    system = ankle.system.astype("float32")
    pose = ankle.pose(np.zeros(2, np.float32), system)
    frames = jax.tree.leaves(ankle.frames(pose))
    assert {x.dtype.name for x in (ankle.joint_values(pose), *frames)} == {"float32"}


def test_a_robot_is_pickled_as_its_file(ankle):
    again = pickle.loads(pickle.dumps(ankle))
    assert again.system.topology == ankle.system.topology and again.actuated == ankle.actuated
    np.testing.assert_array_equal(again.positions([0.1, 0.2]), ankle.positions([0.1, 0.2]))


@pytest.mark.parametrize("kept", [copy.deepcopy, lambda robot: pickle.loads(pickle.dumps(robot))])
def test_a_robot_is_kept_in_the_pose_that_it_is_drawn_in(kept, folder):
    """Two arms that meet: drawn in either assembly, which the file's own flat pose does not tell."""
    (folder / "kite.xml").write_text(
        """<mujoco><worldbody><body name="a"><joint name="a" axis="0 0 1"/><geom size=".1"/>
        <body name="b" pos="1 0 0"><joint name="b" axis="0 0 1"/><geom size=".1"/></body></body>
        <body name="c" pos="1.5 0 0"><joint name="c" axis="0 0 1"/><geom size=".1"/></body></worldbody>
        <equality><connect body1="b" body2="c" anchor="2 0 0"/></equality><actuator><motor joint="a"/></actuator>
        </mujoco>"""
    )
    for b, c in ((-0.5, 0.5), (-1.586, -1.806)):
        robot = nc.from_mjcf(folder / "kite.xml", home={"a": 0.5, "b": b, "c": c})
        assert kept(robot).system == robot.system
        np.testing.assert_array_equal(kept(robot).positions([0.6]), robot.positions([0.6]))


def test_slopes_of_designs(folder):
    """Of one finger alone, against differences."""
    one = re.sub(r'(?s)<frame.*</frame>|<tendon>.*</tendon>|<connect name="close2"[^>]*/>|<joint name="same"[^>]*/>',
                 "", GRIPPER).replace('tendon="both"', 'joint="driver joint"')  # fmt: skip
    gripper, values = read(folder, one, "finger.xml"), np.array([0.05 + np.radians(10)])
    points = ("coupler_joint_at", "tip_joint_at", "spring_joint_at", "close_at")  # also such as turn what is held

    def moved(y):
        return gripper.system.replace({n: gripper.system[n] + y[k] * np.eye(3)[1] for k, n in enumerate(points)})

    def all_joints(y):
        return gripper.positions(values, moved(y))

    # In reverse: what goes back through a linearisation goes forward too.
    slopes, h = np.asarray(jax.jacrev(all_joints)(np.zeros(4))), 1e-5
    for k in range(4):
        y = h * np.eye(4)[k]
        differences = (np.asarray(all_joints(y)) - np.asarray(all_joints(-y))) / (2 * h)
        assert np.abs(slopes[:, k] - differences).max() < 1e-5 * max(np.abs(slopes).max(), 1.0), points[k]
    assert all(np.abs(slopes[list(gripper.joints).index(j)]).max() < 1e-12 for j in ("driver joint", "spring.joint"))


def test_a_design_drawn_elsewhere(folder):
    """Drawn in another pose than the file's, where its anchors are computed."""
    robot = read(folder, GRIPPER, "turned.xml", home={"driver joint": np.radians(10) + 0.1})
    assert robot._description.joints["driver joint"].reference == pytest.approx(np.radians(10) + 0.1, abs=1e-12)
    check(folder / "turned.xml", robot, values_of(robot, 0.1))
    system = robot.system.replace({"close_at": robot.system["close_at"] + np.array([0.0, 0.001, 0.002])})
    check(robot.save(folder / "turned2.xml", system), robot, values_of(robot, 0.05)[:3], system)


# A body that spins between a ball and a loop closed at a place: its mass is beside that line, so that it has an axis
# across, of which only z tells the spin at home.
SPUN = """<mujoco><worldbody>
<body name="crank"><joint name="crank" axis="0 0 1"/><geom size=".02" pos=".1 0 0"/>
  <body name="rod" pos=".1 0 0"><joint name="ball" type="ball"/><geom size=".02" pos=".1 0 .02"/></body></body>
<body name="rocker" pos=".3 .1 0"><joint name="rocker" axis="0 0 1"/><geom size=".02" pos=".05 0 0"/></body></worldbody>
<equality><connect body1="rod" body2="rocker" anchor=".18 .02 0"/></equality>
<actuator><motor joint="crank"/></actuator></mujoco>"""


def test_what_is_held_of_a_spin_lets_the_rest_move(folder):
    robot = read(folder, SPUN, "spun.xml")
    assert robot.actuated == ("crank",) and robot.held == ("rod_mark.z",)
    check(folder / "spun.xml", robot, np.linspace(-0.2, 0.2, 9)[:, None])


STILL = """<mujoco><worldbody><body name="a"><joint name="still" ref="5"/><geom size=".1"/>
<body name="b" pos="1 0 0"><joint name="moves"/><geom size=".1"/></body></body></worldbody>
<equality><joint joint1="still" polycoef="{factors}"/></equality></mujoco>"""


def test_a_mechanism_with_a_joint_that_follows_by_a_polynomial_is_saved(folder):
    (folder / "tied.xml").write_text(TIED.format(tie='<joint joint1="one" joint2="two" polycoef="0 2 1 0 0"/>'))
    robot = nc.from_mjcf(folder / "tied.xml")
    again = nc.load(robot.mechanism.save(folder / "tied.toml")).compile()
    home = robot.pose(np.zeros(2))
    found = nc.solve_position(again, {"two": home["two"] + 0.3, "three": home["three"]})
    assert float(found["one"] - home["one"]) == pytest.approx(2 * 0.3 + 0.3**2, abs=1e-12)


@pytest.mark.parametrize("factors", [".3", "0", "-.2 1 3 0 0"])
def test_a_joint_tied_to_none_stands_where_its_constant_says(factors, folder):
    robot = read(folder, STILL.format(factors=factors), "still.xml")
    qpos = check(folder / "still.xml", robot, np.array([[-0.4], [0.5]]))
    assert robot.actuated == ("moves",)
    assert np.abs(qpos[:, 0] - np.radians(5) - float(factors.split()[0])).max() < PLACE


TIED = """<mujoco><worldbody><body name="a"><joint name="one"/><geom size=".1"/></body>
<body name="b"><joint name="two" axis="0 1 0"/><geom size=".1"/>
<body name="c" pos="1 0 0"><joint name="three"/><geom size=".1"/></body></body></worldbody>
<tendon><fixed name="t"><joint joint="one" coef="2"/><joint joint="two" coef="-1"/></fixed></tendon>
<equality>{tie}</equality></mujoco>"""


@pytest.mark.parametrize(
    "tie", ['<tendon tendon1="t"/>', '<joint joint1="one" joint2="two" polycoef="0 2 1 0 0"/>',
            '<joint joint1="one" joint2="two" polycoef=".2 2 0 0 0"/>'])  # fmt: skip
@pytest.mark.parametrize("hold", ["a", "b", ["a", "b"]])
def test_a_joint_tied_to_a_held_one_stands_still(hold, tie, folder):
    """At home of the held one MuJoCo's equation has the other's place; where both are held it has no say."""
    robot = read(folder, TIED.format(tie=tie), "tied.xml", hold=hold)
    assert robot.actuated == ("three",)
    values = np.array([[0.1], [-0.3]])
    if len(hold) == 1:
        check(folder / "tied.xml", robot, values)
    else:
        assert np.abs(np.asarray(robot.positions(values)) - np.pad(values, ((0, 0), (2, 0)))).max() < PLACE


TWO = """<mujoco>{more}<worldbody><body name="a"><joint name="j"/><geom size="0.1"/>
<body name="b" pos="1 0 0"><joint name="k"/><geom size="0.1"/></body></body></worldbody>{after}</mujoco>"""


@pytest.mark.parametrize("ending", ["stl", "obj", "msh"])
def test_a_mesh_that_is_not_there_is_named(ending, folder):
    mesh = f'<asset><mesh name="m" file="gone.{ending}"/></asset>'
    text = TWO.replace('<geom size="0.1"/></body></body>', '<geom type="mesh" mesh="m"/></body></body>')
    robot = read(folder, text.format(more=mesh, after=""), "meshes.xml")
    assert [bool(link.inertia) for link in robot._description.links] == [False, True, False]
    assert "meshes and pictures that are not there: m" in robot.left_out


@pytest.mark.parametrize(
    "asset",
    [
        '<texture name="pad" type="2d" file="gone.png"/>',
        '<texture type="skybox" file="gone.png"/>',
        '<hfield name="hill" file="gone.png" size="1 1 1 1"/>',
        '<mesh name="unused" file="gone.stl"/>',
    ],
)
def test_only_bodies_of_missing_meshes_lose_their_mass(asset, folder):
    """As MuJoCo has it where nothing is missing; no texture's name is taken for that of a mesh."""
    pad = '<mesh name="pad" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/>'
    text = TWO.replace('<geom size="0.1"/></body></body>', '<geom type="mesh" mesh="pad"/></body></body>')
    robot = read(folder, text.format(more=f"<asset>{pad}{asset}</asset>", after=""), "missing.xml")
    whole = mujoco.MjModel.from_xml_string(text.format(more=f"<asset>{pad}</asset>", after=""))
    masses = [link.inertia.mass for link in robot._description.links[1:] if link.inertia]
    np.testing.assert_allclose(masses, whole.body_mass[1:], rtol=1e-12)
    assert not any("masses" in said for said in robot.left_out) and "not there" in "\n".join(robot.left_out)


# A chain of a hinge, a ball, a slide and three hinges whose last body bears one that is welded to a base that stands.
WELDED = """<mujoco><worldbody><body name="base"><geom size=".01"/></body>
<body name="a"><joint name="a" axis="0 0 1"/><geom size=".01" pos="0 .1 0"/>
 <body name="b" pos="0 .1 0"><joint name="ball" type="ball"/><geom size=".01"/>
  <body name="c" pos=".3 .1 .05"><joint name="slide" type="slide" axis="1 .2 0"/><joint name="c" axis="0 .3 1"/>
   <geom size=".01" pos="0 .1 0"/>
   <body name="d" pos=".1 -.2 0"><joint name="d" axis="1 0 1"/><joint name="d2" axis="0 1 0"/><geom size=".01"/>
    <body name="end" pos="0 0 .1" euler="20 10 0"><geom size=".01"/>
     <body name="tool" pos=".1 0 0"><joint name="tool"/><geom size=".01" pos="0 .1 0"/></body></body></body></body>
</body></body></worldbody><equality>{welds}</equality></mujoco>"""


@pytest.mark.parametrize("welds", [(("end", "base"),), (("tool", "d"), ("base", "end"))])
def test_a_body_welded_to_the_ground_is_part_of_it(welds, folder):
    rows = [f'<weld body1="{one}" body2="{other}"/>' for one, other in welds]
    robot = read(folder, WELDED.format(welds="".join(rows)), "welded.xml")
    model = robot._file.model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rank = np.linalg.matrix_rank(data.efc_J[: data.ne * model.nv].reshape(data.ne, model.nv), tol=1e-9)
    assert len(robot.actuated) == model.nv - rank and not robot.held
    check(folder / "welded.xml", robot, values_of(robot, 0.05))
    system = robot.system.replace({"d_at": robot.system["d_at"] + 0.01, "ball_at": robot.system["ball_at"] - 0.01})
    check(robot.save(folder / "welded2.xml", system), robot, values_of(robot, 0.03)[:3], system)


def test_what_is_welded_fast_does_not_move(folder):
    robot = read(folder, TWO.format(more="", after='<equality><weld body1="b"/></equality>'), "fast.xml")
    assert not robot.actuated
    for lead in [(), (3,), (2, 3), (0,)]:
        np.testing.assert_array_equal(robot.positions(np.zeros((*lead, 0))), np.zeros((*lead, 2)))


UNNAMED = """<mujoco><worldbody><body name="body 2"><joint name="joint 1"/><geom size=".1"/><site name="site 1"/>
<body pos="1 0 0"><joint/><geom size=".1"/><site/></body></body>
<body name="other" pos="0 1 0"><joint name="j"/><geom size=".1"/></body></worldbody>
<equality><joint name="equality 1" joint1="j" joint2="joint 1"/><connect body1="other" body2="world" anchor="1 0 0"/>
</equality></mujoco>"""


def test_what_has_no_name_gets_none_that_another_has(folder):
    """Beside a body, joint, site and equation that are called as those without a name would be."""
    robot = read(folder, UNNAMED, "unnamed.xml")
    assert robot.joints == ("joint 1", "joint 1_", "j") and len(robot._tree.marks) == 5
    assert [link.name for link in robot._description.links[1:]] == ["body 2", "body 2_", "other"]
    assert robot._file.names("EQUALITY", range(2)) == ["equality 1", "equality 1_"]
    assert robot.actuated == ("joint_1_",) and np.abs(robot.positions([0.4]) - np.array([0, 0.4, 0])).max() < PLACE


PENDULUM = """<mujoco><compiler angle="radian"/><option {option}>{flag}</option><worldbody><body name="a" {body}>
<joint name="j" axis="0 1 0" stiffness="{stiffness}" springref=".2" damping="{damping}"/>
<geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/></body></worldbody></mujoco>"""
POLYNOMIALS = pytest.mark.skipif(not hasattr(mujoco.MjModel, "jnt_stiffnesspoly"), reason="a MuJoCo without them")
PLAIN = {"option": "", "flag": "", "body": "", "stiffness": "3", "damping": ".4"}


@pytest.mark.parametrize("off", ["", "gravity", "spring", "damper"])
def test_what_a_file_switches_off_does_not_act(off, folder):
    text = PENDULUM.format(**PLAIN | {"flag": f'<flag {off}="disable"/>' if off else ""})
    robot = read(folder, text, "pendulum.xml")
    model = robot._file.model
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = 0.4, 0.7
    mujoco.mj_forward(model, data)
    start = robot.pose([0.4])
    run = nc.simulate(robot.system, [0.0, 1e-3], state={"j": start["j"]}, rates={"j": 0.7})
    assert run.acceleration("j")[0] == pytest.approx(data.qacc[0], rel=1e-10)


def test_loops_that_a_file_switches_off_are_open(folder):
    closed = '<equality><joint joint1="j"/></equality>'
    flag = '<option><flag equality="disable"/></option>'
    robot = read(folder, TWO.format(more=flag, after=closed), "open.xml")
    assert robot.actuated == ("j", "k") and "equality 'equality 0': not active" in robot.left_out


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"body": 'gravcomp="1"'}, "gravity compensation of bodies: a"),
        ({"option": 'density="1000" wind="1 0 0"'}, "drag in a medium: density"),
        ({"option": 'viscosity=".1"'}, "drag in a medium: viscosity"),
        pytest.param({"stiffness": "1 2 3"}, "not linear in springs and dampers of joints: j", marks=POLYNOMIALS),
        pytest.param({"damping": "1 .5"}, "not linear in springs and dampers of joints: j", marks=POLYNOMIALS),
    ],
)
def test_what_else_acts_is_named(changed, said, folder):
    assert said in str(read(folder, PENDULUM.format(**PLAIN | changed), "acts.xml"))
    assert said.split(":")[0] not in str(read(folder, PENDULUM.format(**PLAIN), "acts.xml"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<mujoco><worldbody><body><wheel/></body></worldbody></mujoco>", ["does not read it", "wheel"]),
        ("<mujoco><worldbody>", ["does not read it"]),
        ('<mujoco><include file="gone.xml"/></mujoco>', ["does not read it", "gone.xml"]),
        ("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>", ["no joints that could move"]),
        (
            '<mujoco><asset><mesh name="m" file="m.stl"/></asset><worldbody><body><freejoint/>'
            '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>',
            ["no joints that could move"],
        ),
        (
            TWO.format(more="", after='<equality><connect name="c" body1="a" body2="z" anchor="0 0 0"/></equality>'),
            ["does not compile it", "z"],
        ),
        (
            TWO.format(
                more="", after='<equality><weld name="w" body1="a" body2="b" relpose="0 1 0 1 0 0 0"/></equality>'
            ),
            ["equality 'w'", "other than they are at home", "without=['w']"],
        ),
    ],
)
def test_bad_files(text, words, folder):
    with pytest.raises(nc.ModelFileError) as error:
        read(folder, text, "bad.xml")
    assert all(word in str(error.value) for word in ["bad.xml", *words]), str(error.value)


def test_values_and_rates_may_be_degrees(folder):
    """Those of hinges; a slide's are lengths."""
    geom = '<geom type="capsule" size=".02" fromto="0 0 0 .1 0 .1"/>'
    text = f"""<mujoco><compiler angle="radian"/><worldbody><body><joint name="a" axis="0 1 0" ref=".2"/>{geom}
        <body pos=".1 0 0"><joint name="b" axis="0 1 0" ref="-.4"/>{geom}<body><joint name="s" type="slide" ref=".3"/>
        {geom}</body></body></body></worldbody></mujoco>"""
    robot = read(folder, text, "hinges.xml")
    pose = robot.pose([[10.0, -5.0, 0.4]], unit="deg", rates={"a": 90.0, "b": 0.0, "s": 0.1})
    np.testing.assert_allclose(robot.joint_values(pose), [[np.pi / 18, -np.pi / 36, 0.4]], atol=1e-12)
    rates = [pose.rates[0][0, robot.system.topology.position[c]] for c in robot.actuated]
    np.testing.assert_allclose(rates, [np.pi / 2, 0.0, 0.1], atol=1e-12)


def test_wrong_questions(gripper, folder):
    with pytest.raises(nc.ModelFileError, match="there is no such file"):
        nc.from_mjcf(folder / "nowhere.xml")
    with pytest.raises(nc.ModelFileError, match=r"equality.*close, close2, same"):
        nc.from_mjcf(folder / "gripper.xml", without=["open"])
    with pytest.raises(nc.ModelFileError, match=r"hold=\['arm'\]: there is no such body"):
        nc.from_mjcf(folder / "gripper.xml", hold=["arm"])
    with pytest.raises(nc.InputError, match="no such keyframe"):
        nc.from_mjcf(folder / "gripper.xml", home="zero")
    with pytest.raises(nc.InputError, match=r"driven by 1 joint \(driver_joint\)"):
        gripper.positions(np.zeros(2))
    with pytest.raises(nc.InputError, match=r"hold=: a robot chooses what it holds.*robot\.held"):
        gripper.positions(np.zeros(1), hold=["driver_joint"])
    zero = float(gripper.pose(np.zeros(1))["driver_joint"])
    with pytest.raises(nc.AssemblyError, match=f"values of joints are less by driver_joint {zero:.6g}"):
        gripper.positions(np.array([30.0]))
    with pytest.raises(nc.InputError, match="not a design of this robot"):
        gripper.save(folder / "x.xml", nc.library.four_bar().compile())
    with pytest.raises(nc.InputError, match="change those in the file"):
        gripper.save(folder / "x.xml", gripper.system.replace({"spring.joint spring.stiffness": 1.0}))
    assert not (folder / "x.xml").exists()
    (folder / "tied.xml").write_text(TIED.format(tie='<joint joint1="one" joint2="two" polycoef=".2 2 1 0 0"/>'))
    with pytest.raises(nc.ModelFileError, match=r"'equality 0' ties 'two' to 'one', which is held.*hold both"):
        nc.from_mjcf(folder / "tied.xml", hold=["a"])
    open_one = nc.from_mjcf(folder / "gripper.xml", without="same")
    assert len(open_one.actuated) == 2 and "equality 'same': as asked" in open_one.left_out


def test_a_design_that_assembles_elsewhere_than_it_is_drawn_is_not_saved(tmp_path):
    """A hinge and a slide at one place: the slide's line goes with the hinge, what slides on it has to be moved too."""
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><worldbody><body><joint name="x" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 .4"/>'
        '<body name="b" pos="0 0 .4"><joint name="h" axis="0 1 0"/><joint name="s" type="slide" axis="0 0 1"/>'
        '<geom type="capsule" size=".02" fromto="0 0 0 0 0 .4"/></body></body></worldbody></mujoco>'
    )
    robot = nc.from_mjcf(path)
    by = np.array([0.02, 0.0, 0.01])
    moved = robot.system.replace({"h_at": np.asarray(robot.system["h_at"]) + by})
    with pytest.raises(nc.InputError, match=r"assembles elsewhere.*joint 's slot' by.*move"):
        robot.save(tmp_path / "moved.xml", moved)
    both = moved.replace({"s_on": np.asarray(robot.system["s_on"]) + by})
    again = nc.from_mjcf(robot.save(tmp_path / "moved.xml", both))
    for values in ([0.0, 0.0, 0.0], [0.2, 0.5, 0.03]):
        one, two = robot.frames(robot.pose(values, both))["b"], again.frames(again.pose(values))["b"]
        np.testing.assert_allclose(one[0], two[0], atol=1e-6)


def test_poses_and_designs_of_something_else_are_refused(gripper):
    other = nc.library.four_bar().compile()
    motion = nc.solve_position(other, {"phi": 1.0})
    wrong = (
        lambda: gripper.pose([0.1] * len(gripper.actuated), other),
        lambda: gripper.joint_values(motion),
        lambda: gripper.frames(motion),
        lambda: gripper.save("x.xml", other),
    )
    for call in wrong:
        with pytest.raises(nc.InputError, match=r"'four-bar'.* is not a design of this robot; change robot.system by"):
            call()
    with pytest.raises(nc.InputError, match=r"values of joints must be .* numbers, got \[\[1, 2\], \[3\]\]"):
        gripper.positions([[1, 2], [3]])
    with pytest.raises(nc.InputError, match=r"poses of this robot, as of robot.pose\(values\), got list"):
        gripper.frames([0.1])


def test_a_robot_whose_loop_is_open_a_little_is_saved(tmp_path):
    path = tmp_path / "loop.xml"
    path.write_text(
        '<mujoco><worldbody><body name="a"><joint name="p" axis="0 1 0"/><geom type="capsule" size=".01" '
        'fromto="0 0 0 0 0 .1"/><body name="b" pos="0 0 .1"><joint name="q" axis="0 1 0"/><geom type="capsule" '
        'size=".01" fromto="0 0 0 .3 0 .1"/><site name="t" pos=".3 0 .1"/></body></body><body name="c" pos=".25 0 0">'
        '<joint name="r" axis="0 1 0"/><geom type="capsule" size=".01" fromto="0 0 0 .05 0 .2"/>'
        '<site name="u" pos=".0501 0 .2"/></body></worldbody><equality><connect site1="t" site2="u"/></equality>'
        "</mujoco>"
    )
    robot = nc.from_mjcf(path)
    again = nc.from_mjcf(robot.save(tmp_path / "again.xml"))
    np.testing.assert_allclose(again.positions([0.1]), robot.positions([0.1]), atol=1e-6)


OPEN = """<mujoco><worldbody><body name="a"><joint name="p" axis="0 0 1"/><geom type="capsule" size=".01"
fromto="0 0 0 0 .1 0"/><frame pos="0 0 .1"><site name="framed"/></frame><body name="b" pos="0 .1 0"><joint name="q"
axis="0 0 1"/><geom type="capsule" size=".01" fromto="0 0 0 .3 .1 0"/><site name="t" pos=".3 .1 0"/></body></body>
<body name="c" pos=".35 0 0"><joint name="r" axis="0 0 1"/><geom type="capsule" size=".01" fromto="0 0 0 -.05 .2 0"/>
<site name="u" pos="{} .2 0"/></body></worldbody><equality><connect name="loop" site1="t" site2="u"/></equality>
<actuator><motor joint="p"/></actuator></mujoco>"""


def test_a_site_moves_with_the_loop_that_it_closes(tmp_path):
    (tmp_path / "loop.xml").write_text(OPEN.format("-.05"))
    robot = nc.from_mjcf(tmp_path / "loop.xml")
    shift = np.array([0.02, 0.01, 0.0])
    for names in (("loop_at",), ("loop_at", "t", "u")):
        design = robot.system.replace({n: robot.system[n] + shift for n in names})
        data = mujoco.MjData(model := mujoco.MjModel.from_xml_path(str(robot.save(tmp_path / "again.xml", design))))
        data.qpos[:] = robot.positions([0.2], design)
        mujoco.mj_forward(model, data)
        assert np.abs(data.efc_pos[: data.ne]).max() < WRITTEN
    for name in "tu":  # the pose of such a design has the loop where it was, and a file cannot say so
        with pytest.raises(nc.InputError, match=f"site '{name}' closes 'loop' at 'loop_at'.*move what is at one place"):
            robot.save(tmp_path / "again.xml", robot.system.replace({name: robot.system[name] + shift}))
    with pytest.raises(nc.InputError, match="site 'framed' stands in a <frame>"):
        robot.save(tmp_path / "again.xml", robot.system.replace({"framed": robot.system["framed"] + shift}))


def test_what_a_file_cannot_have_is_named(tmp_path):
    (tmp_path / "open.xml").write_text(OPEN.format("-.047"))
    robot = nc.from_mjcf(tmp_path / "open.xml")
    with pytest.raises(nc.InputError, match=r"off joint 'loop' by 0\.001.* move 'loop_at' and 'loop_on' alike"):
        robot.save(
            tmp_path / "no.xml", robot.system.replace({"loop_at": robot.system["loop_at"] + np.array([0.001, 0, 0])})
        )
    m = nc.library.four_bar()
    urdf = nc.from_urdf(m.to_urdf(tmp_path / "bar.urdf").path)
    lost, drawn = {"q_at": (np.nan, 0, 0)}, m.compile().replace({"B": (np.nan, 0.1)})
    for call, name in (
        (lambda: robot.save(tmp_path / "no.xml", robot.system.replace(lost)), "q_at"),
        (
            lambda: urdf.save(tmp_path / "no.urdf", urdf.system.replace({"B_coupler_at": (0, np.inf, 0)})),
            "B_coupler_at",
        ),
        (lambda: m.to_mjcf(tmp_path / "no.xml", at=drawn), "B"),
        (lambda: m.to_urdf(tmp_path / "no.urdf", at=drawn), "B"),
        (lambda: nc.mobility(drawn), "B"),
    ):
        with pytest.raises(nc.InputError, match=f"design variable '{name}' is NaN or infinite"):
            call()
    assert not (tmp_path / "no.xml").exists() and not (tmp_path / "no.urdf").exists()


def test_a_long_robot_is_read_without_a_dense_matrix(tmp_path):
    """301 links, 150 loops: MuJoCo has them closed. Dense matrices and loops over pairs of points took minutes."""
    nc.library.four_bar_chain(150, last=1.05).to_mjcf(tmp_path / "chain.xml")
    start = time.perf_counter()
    robot = nc.from_mjcf(tmp_path / "chain.xml")
    assert time.perf_counter() - start < 30.0
    data = mujoco.MjData(model := mujoco.MjModel.from_xml_path(str(tmp_path / "chain.xml")))
    assert (robot.system.topology.large, len(robot.actuated), robot.held) == (True, 1, ())
    data.qpos[:] = robot.positions([0.05])
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos).max() < 1e-7
