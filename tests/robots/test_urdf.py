"""Mechanisms as URDF and back: the tree as MuJoCo and Pinocchio read it, the table of loops as we do."""

import re
import xml.etree.ElementTree as ET
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import jaxnc as nc
from jaxnc.cli import main
from jaxnc.library.catalogue import CATALOGUE
from jaxnc.reporting.verdict import Verdict
from jaxnc.robots import Exported

mujoco = pytest.importorskip("mujoco")

PLACE = 1e-11  # places, of the drawing's size: rounding, and that of a quaternion
POSES = 21
KINDS = [
    "four-bar", "slider-crank", "stephenson-six-bar", "five-bar", "quick-return", "gear-pair",
    "rscr", "rssr", "bennett", "spherical-four-bar", "cardan-joint", "delta-robot",
    "double-wishbone", "stewart-platform",
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("urdf")


def moved(m: nc.Mechanism, part: float = 1.0) -> nc.Motion:
    run = m.model.run
    ends = {n: (d.start, d.start + part * (d.end - d.start)) for n, d in run.inputs.items()}
    return nc.sweep(m.compile(), {n: np.linspace(*x, POSES) for n, x in ends.items()}, hold=run.hold)


def places_of(motion: nc.Motion):
    top = motion.system.topology
    for name in (*top.points, *(x.name for x in top.markers if not x.direction)):
        at = np.zeros((len(motion.status), 3))
        at[:, : top.dim] = np.asarray(motion[name])
        yield name, at


def in_mujoco(done: Exported, values: np.ndarray):
    """Frames of all links as MuJoCo's reader of URDF has them, by name: ``(P, 3)`` and ``(P, 3, 3)``."""
    spec = mujoco.MjSpec.from_file(str(done.path))
    spec.compiler.fusestatic, spec.compiler.boundmass, spec.compiler.boundinertia = False, 1e-6, 1e-6
    model = spec.compile()
    data, out = mujoco.MjData(model), {}
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, i) for i in range(model.nbody)]
    for row in values:
        at = 0
        for joint in done.joints:
            own = model.joint(joint)
            width = 7 if own.type[0] == mujoco.mjtJoint.mjJNT_FREE else 1
            data.qpos[own.qposadr[0] : own.qposadr[0] + width] = row[at : at + width]
            at += width
        mujoco.mj_kinematics(model, data)
        for i, name in enumerate(names):
            out.setdefault(name, []).append((data.xpos[i].copy(), data.xmat[i].reshape(3, 3).copy()))
    return {n: tuple(np.array(x) for x in zip(*pairs, strict=True)) for n, pairs in out.items()}


def gaps(path: Path, frames) -> float:
    """How far the ends of a file's loop joints are apart, and turned where the type is fixed."""
    worst = 0.0
    for loop in ET.parse(path).getroot().findall("loop_joint"):
        ends = []
        for tag in ("link1", "link2"):
            place, turn = frames[loop.find(tag).get("link")]
            ends.append(place + turn @ np.array([float(x) for x in loop.find(tag).get("xyz").split()]))
        worst = max(worst, float(np.abs(ends[0] - ends[1]).max()))
        if loop.get("type") == "fixed":
            one, other = (frames[loop.find(tag).get("link")][1] for tag in ("link1", "link2"))
            worst = max(worst, float(np.abs(one - other).max()))
    return worst


@pytest.mark.parametrize("name", KINDS)
def test_out(name, folder):
    """Every point where it should be, every loop closed; a tree whose loops do not close would show here."""
    m = CATALOGUE[name]()
    motion = moved(m)
    done = m.to_urdf(folder / f"{name}.urdf", at=motion)
    values = done.joint_values(motion)
    frames = in_mujoco(done, values)
    size = float(np.linalg.norm(np.ptp(np.asarray(motion.system.parameters.points), axis=0)))
    for point, at in places_of(motion):
        assert np.abs(frames[point][0] - at).max() < PLACE * max(size, 0.1), point
    assert gaps(done.path, frames) < PLACE * max(size, 0.1)
    if done.loops and name not in ("gear-pair", "stewart-platform"):
        assert gaps(done.path, in_mujoco(done, values + 0.01)) > 1e-4 * size  # other joint values do not close them


@pytest.mark.skipif(not find_spec("pinocchio"), reason="no Pinocchio")
def test_pinocchio_reads_the_tree(folder):
    import pinocchio as pin  # pyright: ignore[reportMissingImports]

    m = nc.library.delta_robot()
    motion = moved(m)
    done = m.to_urdf(folder / "delta.urdf", at=motion)
    model = pin.buildModelFromUrdf(str(done.path))
    data = model.createData()
    for k, row in enumerate(done.joint_values(motion)):
        q = pin.neutral(model)
        for joint, value in zip(done.joints, row, strict=True):
            at = model.joints[model.getJointId(joint)].idx_q
            q[at : at + 2] = np.cos(value), np.sin(value)
        pin.framesForwardKinematics(model, data, q)
        for point, at in places_of(motion):
            assert np.abs(data.oMf[model.getFrameId(point, pin.BODY)].translation - at[k]).max() < PLACE


@pytest.mark.parametrize(
    "name", ["four-bar", "slider-crank", "quick-return", "gear-pair", "bennett", "cardan-joint", "delta-robot"]
)
def test_out_and_back(name, folder):
    m = CATALOGUE[name]()
    motion = moved(m, 0.1)
    done = m.to_urdf(folder / "again.urdf", at=motion)
    robot = nc.from_urdf(done.path)
    values, index = done.joint_values(motion), list(done.joints)
    driven = [j for c in robot.actuated for j, own in robot.coordinates.items() if own == c]
    assert len(driven) == motion.system.degrees_of_freedom
    found = robot.pose(values[:, [index.index(j) for j in driven]]).check()
    frames = robot.frames(found)
    for point, at in places_of(motion):
        assert np.abs(np.asarray(frames[point][0]) - at).max() < 1e-9, point
    if not robot.held:
        assert np.abs(np.asarray(robot.joint_values(found)) - values).max() < 1e-9


ROBOT = """<?xml version="1.0"?>
<robot name="arm"><material name="grey"/>
<link name="base"/>
<link name="one"><inertial><origin xyz="0.1 0 0" rpy="0 0 0.3"/><mass value="2"/>
  <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.25"/></inertial>
  <visual><origin xyz="0.2 0 0"/><geometry><mesh filename="package://arm/one.stl"/></geometry></visual></link>
<link name="two"/><link name="three"/><link name="tool"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="one"/><origin xyz="0 0 0.2" rpy="0.3 0 0"/>
  <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
  <dynamics damping="0.4" friction="0.1"/></joint>
<joint name="j2" type="continuous"><parent link="one"/><child link="two"/><origin xyz="0.4 0 0"/>
  <axis xyz="0 1 0"/></joint>
<joint name="j3" type="continuous"><parent link="base"/><child link="three"/><origin xyz="0.3 0 0.1" rpy="0.3 0 0"/>
  <axis xyz="0 1 0"/></joint>
<joint name="hand" type="fixed"><parent link="two"/><child link="tool"/><origin xyz="0.1 0 0.05" rpy="0 0 1"/></joint>
{loop}
<transmission name="t"><joint name="j1"/><actuator name="m"/></transmission>
<sensor name="eye"/></robot>
"""
LOOP = '<loop_joint name="close" type="{kind}"><link1 link="two" xyz="0.1 0 -0.2"/>{second}</loop_joint>'


def arm(folder: Path, kind: str = "spherical", name: str = "arm.urdf") -> Path:
    """An arm whose third link meets the second; the place on the third is computed from the file's home."""
    (folder / name).write_text(ROBOT.format(loop=""))
    home = nc.from_urdf(folder / name)._description.links
    two, three = (next(x for x in home if x.name == n) for n in ("two", "three"))
    local = three.turn.T @ (two.origin + two.turn @ np.array([0.1, 0.0, -0.2]) - three.origin)
    second = f'<link2 link="three" xyz="{" ".join(map(repr, map(float, local)))}"/><axis xyz="0 1 0"/>'
    (folder / name).write_text(ROBOT.format(loop=LOOP.format(kind=kind, second=second)))
    return folder / name


def test_a_file_by_hand(folder):
    """Four hinges in a plane that leans: a four-bar, against its closing by hand."""
    robot = nc.from_urdf(arm(folder))
    assert robot.actuated == ("j1",) and not robot.held
    for said in ("limits of joints: j1", "dry friction of joints: j1", "pictures of links: one", "elements: <sensor>"):
        assert said in robot.left_out
    full = np.asarray(robot.positions(np.linspace(-0.3, 0.3, 20)[:, None]))
    home = {link.name: link for link in robot._description.links}

    def in_plane(v):  # all axes are y of the leaning frame
        x, _, z = home["one"].turn.T @ v
        return x + 1j * z

    a, b, d = (in_plane(home[n].origin) for n in ("one", "two", "three"))
    c = in_plane(home["two"].origin + home["two"].turn @ np.array([0.1, 0.0, -0.2]))
    q1, q2, q3 = full.T  # a positive turn about y takes z to x: clockwise here
    reached = a + (b - a) * np.exp(-1j * q1) + (c - b) * np.exp(-1j * (q1 + q2))
    assert np.abs(reached - (d + (c - d) * np.exp(-1j * q3))).max() < 1e-12
    assert np.abs(full[:, 0] - np.linspace(-0.3, 0.3, 20)).max() < 1e-12
    hinge = nc.from_urdf(arm(folder, "revolute", "hinge.urdf"))
    assert np.abs(np.asarray(hinge.positions([0.2])) - np.asarray(robot.positions([0.2]))).max() < 1e-10
    turned = hinge.system.replace({"close_axis_at": hinge.system["close_axis_at"] + 0.1})
    with pytest.raises(nc.InputError, match=r"axis.*'close'.*elsewhere"):
        hinge.save(folder / "never.urdf", turned)
    assert not (folder / "never.urdf").exists()


def test_a_mimic_of_none_or_a_held_joint_stands_at_its_offset(folder):
    still = changed('<parent link="one"/>', '<parent link="one"/><mimic joint="j1" multiplier="0" offset="0.3"/>')
    (folder / "still.urdf").write_text(re.sub("<loop_joint.*</loop_joint>|<transmission.*</transmission>", "", still))
    robot = nc.from_urdf(folder / "still.urdf")
    assert robot.joints == ("j1", "j2", "j3") and robot.actuated == ("j1", "j3")
    assert np.abs(np.asarray(robot.positions([0.2, 0.1])) - [0.2, 0.3, 0.1]).max() < 1e-12
    led = (folder / "still.urdf").read_text()  # by a joint that follows nobody: no ring
    (folder / "led.urdf").write_text(
        led.replace('<child link="three"/>', '<child link="three"/><mimic joint="j2"/>').replace(
            'joint="j1" multiplier="0"', 'joint="j3" multiplier="0"'
        )
    )
    assert np.abs(np.asarray(nc.from_urdf(folder / "led.urdf").positions([0.2])) - [0.2, 0.3, 0.3]).max() < 1e-12
    (folder / "still.urdf").write_text((folder / "still.urdf").read_text().replace('multiplier="0"', 'multiplier="2"'))
    for hold, wanted in {"one": [0.0, 0.3, 0.1], "two": [-0.15, 0.0, 0.1]}.items():
        held = nc.from_urdf(folder / "still.urdf", hold=[hold])
        assert held.actuated == ("j3",) and np.abs(np.asarray(held.positions([0.1])) - wanted).max() < 1e-12


def test_pieces_of_a_joint_get_names_of_their_own(folder):
    text = ROBOT.format(loop="").replace('name="j2" type="continuous"', 'name="j2" type="planar"')
    (folder / "planar.urdf").write_text(text.replace('name="j3"', 'name="j2 1"'))
    robot = nc.from_urdf(folder / "planar.urdf")
    assert robot.joints == ("j1", "j2 1 2", "j2 2", "j2 3", "j2 1") and len(robot.held) == 4
    tilted = robot.system.replace({"j2_1_2_axis": (1.0, 0.0, 0.3)})
    with pytest.raises(nc.InputError, match=r"'j2_1_2_axis' points elsewhere.*planar joint 'j2'"):
        robot.save(folder / "tilted.urdf", tilted)


def test_limits_of_slides_are_named(folder):
    text = ROBOT.format(loop="").replace('name="j2" type="continuous"', 'name="j2" type="prismatic"')
    (folder / "slide.urdf").write_text(text)
    assert "limits of joints: j1, j2" in nc.from_urdf(folder / "slide.urdf").left_out


def test_loops_as_gazebo_has_them(folder):
    """The same file with a joint in <gazebo> alone: the same robot."""
    robot = nc.from_urdf(arm(folder))
    root = ET.parse(arm(folder)).getroot()
    loop = root.find("loop_joint")
    joint = ET.SubElement(ET.SubElement(root, "gazebo"), "joint", name="close", type="ball")
    ET.SubElement(joint, "parent").text, ET.SubElement(joint, "child").text = "two", "three"
    ET.SubElement(joint, "pose").text = f"{loop.find('link2').get('xyz')} 0 0 0"
    root.remove(loop)
    (folder / "gazebo.urdf").write_text(ET.tostring(root, encoding="unicode"))
    again = nc.from_urdf(folder / "gazebo.urdf")
    assert np.abs(np.asarray(again.positions([0.2])) - np.asarray(robot.positions([0.2]))).max() < 1e-12
    longer = again.system.replace({"close_at": again.system["close_at"] * 1.02})
    back = nc.from_urdf(again.save(folder / "gazebo2.urdf", longer))
    assert np.abs(np.asarray(back.positions([0.2])) - np.asarray(again.positions([0.2], longer))).max() < 1e-10


def test_designs_are_written_back(folder):
    robot = nc.from_urdf(arm(folder))
    moved = {"j2_at": robot.system["j2_at"] + np.array([0.05, 0.0, 0.02]), "close_at": robot.system["close_at"] * 1.02}
    system = robot.system.replace(moved)
    again = nc.from_urdf(robot.save(folder / "other.urdf", system))
    values = np.linspace(-0.2, 0.2, 5)[:, None]
    ours = robot.frames(robot.pose(values, system).check())
    theirs = again.frames(again.pose(values).check())
    assert np.abs(np.asarray(again.positions(values)) - np.asarray(robot.positions(values, system))).max() < 1e-10
    assert np.abs(np.asarray(ours["tool"][0]) - np.asarray(theirs["tool"][0])).max() < 1e-10
    assert np.abs(np.asarray(again.positions(values)) - np.asarray(robot.positions(values))).max() > 1e-3
    text = (folder / "other.urdf").read_text()
    assert "package://arm/one.stl" in text and "<sensor" in text


def changed(old: str, new: str) -> str:
    text = ROBOT.format(loop=LOOP.format(kind="spherical", second='<link2 link="three"/>'))
    assert old in text
    return text.replace(old, new)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<robot><link", ["no XML"]),
        ("<sdf/>", ["<sdf>", "<robot>"]),
        ('<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:macro name="a"/></robot>', ["xacro", "expand"]),
        ('<robot><link name="a"/></robot>', ["no joints that could move"]),
        (changed('<parent link="one"/>', '<parent link="won"/>'), ["joint 'j2'", "'won'", "did you mean"]),
        (
            changed('<child link="three"/>', '<child link="two"/>'),
            ["'two'", "two joints", "'j2'", "'j3'", "<loop_joint>"],
        ),
        (changed('<link name="two"/>', '<link name="two"/><link name="two"/>'), ["two links 'two'"]),
        (changed('<link name="tool"/>', '<link name="tool"/><link name="x"/>'), ["one link that is no joint's child"]),
        (changed('type="revolute"', 'type="screw"'), ["joint 'j1'", "'screw'"]),
        (changed('xyz="0.4 0 0"', 'xyz="0.4 0"'), ["joint 'j2'", "3 finite numbers"]),
        (changed('<axis xyz="0 1 0"/></joint>', '<axis xyz="0 0 0"/></joint>'), ["its axis is zero"]),
        (changed('link2 link="three"', 'link2 link="tree"'), ["loop joint 'close'", "'tree'", "did you mean"]),
        (changed('<link2 link="three"/>', ""), ["loop joint 'close'", "two ends"]),
        (changed('type="spherical"', 'type="rubber"'), ["loop joint 'close'", "'rubber'"]),
        (
            changed('type="spherical">', 'type="revolute"><axis xyz="0 0 0"/>'),
            ["loop joint 'close': its axis is zero"],
        ),
        (changed('type="spherical"', 'type="fixed"'), ["loop joint 'close'", "other than they are at home"]),
        (changed('transmission name="t"><joint name="j1"', 'transmission name="t"><joint name="jj"'), ["'jj'"]),
        (changed('<parent link="one"/>', '<parent link="one"/><mimic joint="j2"/>'), ["mimic of joint 'j2'", "itself"]),
        (
            changed('<child link="two"/>', '<child link="two"/><mimic joint="j3" multiplier="3"/>').replace(
                '<child link="three"/>', '<child link="three"/><mimic joint="j2" offset="1"/>'
            ),
            ["mimic of joint 'j2'", "it follows itself, by 'j3'"],
        ),
        (
            changed('<link name="two"/>', '<link name="two"><inertial><mass value="-1"/></inertial></link>'),
            ["link 'two'", "value='-1'", "not be negative"],
        ),
    ],
)
def test_bad_files(text, words, folder):
    (folder / "bad.urdf").write_text(text)
    with pytest.raises(nc.ModelFileError) as error:
        nc.from_urdf(folder / "bad.urdf")
    assert all(word in str(error.value) for word in ["bad.urdf", *words]), str(error.value)


def test_what_is_left_out_is_named(folder):
    m = nc.library.five_bar()
    m.gravity = (0.0, -9.81)
    m.mass(next(iter(m.model.bodies)), 1.0)
    m.spring("soft", next(iter(m.model.ground)), next(iter(m.model.points)), stiffness=1.0)
    done = m.to_urdf(folder / "five.urdf")
    assert any("'soft'" in said for said in done.left_out) and any("gravity" in said for said in done.left_out)
    with pytest.raises(nc.InputError, match="at= is a System or a Motion, got str"):
        m.to_urdf(folder / "five.urdf", at="home")
    with pytest.raises(nc.InputError, match=r"\.urdf"):
        m.to_urdf(folder / "five.xml")


@pytest.mark.parametrize(("to", "suffix"), [("mjcf", ".xml"), ("urdf", ".urdf")])
def test_the_command(to, suffix, tmp_path, capsys):
    """A name that is no file name stays in the folder that was given; what has no place is told."""
    m = nc.library.four_bar()
    m.model.name = "../../up & away"
    m.mass("crank", 1.0)
    m.friction("rub", coefficient=0.1, bodies=("crank", "coupler"), at="B", radius=0.01)
    m.save(tmp_path / "m.toml")
    assert (
        main(["export", str(tmp_path / "m.toml"), "--to", to, "--out", str(tmp_path / "out" / "deep"), "--json"]) == 0
    )
    verdict = Verdict.from_json(capsys.readouterr().out)
    assert verdict.assembles and any("'rub'" in f.text for f in verdict.warnings)
    (written,) = (tmp_path / "out" / "deep").iterdir()
    assert written.suffix == suffix and verdict.files[0].path == str(written)
    assert {p.name for p in tmp_path.iterdir()} == {"m.toml", "out"}
    assert main(["export", str(tmp_path / "m.toml"), "--to", "dxf"]) == 2


def test_a_design_of_a_robot_whose_mimic_has_an_offset_is_saved(tmp_path):
    """Where the last hinge is in the plane of three, by hand: the file is drawn where the mimic does not hold."""
    joints = "".join(
        f'<joint name="j{k}" type="continuous"><parent link="l{k - 1}"/><child link="l{k}"/><axis xyz="0 0 1"/>'
        f'<origin xyz="{x} 0 0"/>{more}</joint>'
        for k, x, more in ((1, 0, ""), (2, 0.3, '<mimic joint="j1" multiplier="-1" offset="0.4"/>'), (3, 0.2, ""))
    )
    links = "".join(f'<link name="l{k}"/>' for k in range(4))
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm">{links}{joints}</robot>')
    robot = nc.from_urdf(tmp_path / "arm.urdf")
    design = robot.system.replace({"j3_at": np.asarray(robot.system["j3_at"]) * 1.1})
    again = nc.from_urdf(robot.save(tmp_path / "longer.urdf", design))
    place = 0.3 * np.exp(0.1j) + 0.25 * np.exp(0.4j)
    np.testing.assert_allclose(again.pose([0.1, 0.2])["j3_at"], (place.real, place.imag, 0.0), atol=1e-9)
