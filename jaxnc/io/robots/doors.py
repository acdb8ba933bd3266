"""Doors for robots: read from MJCF and URDF, and written back with other dimensions."""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError, MechanismError, ModelFileError, nearest
from jaxnc.io.robots.read_mjcf import MjcfFile, read_mjcf
from jaxnc.io.robots.read_urdf import UrdfFile, read_urdf, redrawn
from jaxnc.io.robots.robot import Robot
from jaxnc.io.target import write
from jaxnc.kinematics.motion import Motion
from jaxnc.system.system import System


@public
def from_mjcf(
    path: str | Path,
    home: str | Mapping[str, float] | None = None,
    hold: Sequence[str] = (),
    without: Sequence[str] = (),
) -> Robot:
    """Read a robot from an MJCF file of MuJoCo, loops included, as a mechanism in natural coordinates.

    Args:
        path: the file.
        home: another pose to draw it in than the file's own, in which a robot may be at a dead point: the name of a
            keyframe, or values of some joints by name; loops are closed from there.
        hold: names of bodies whose joints are held as they are; floating ones always are.
        without: names of `equality` constraints to be left out.

    Returns:
        The robot, with what was not taken over by name.

    Raises:
        ModelFileError: the file cannot be read, nothing in it moves, or links are held together in a way that cannot be
            said here. Nothing is read by half.
        JaxncError: MuJoCo is not installed.
    """
    file = MjcfFile(Path(path))
    try:
        robot = Robot(read_mjcf(file, without, hold), file, _save_mjcf)
        if home is None:
            return robot
        file.put(np.asarray(robot.joint_values(_near(robot, file, home))))
        return Robot(read_mjcf(file, without, hold), file, _save_mjcf)
    except MechanismError as error:
        raise ModelFileError(f"{path}: {error}") from None


def _near(robot: Robot, file: MjcfFile, home: str | Mapping[str, float]) -> Motion:
    """The pose nearest to values of joints that need not close the loops."""
    qpos, at = np.array(file.model.qpos0), file.model.jnt_qposadr
    numbers = {file.name("JOINT", j): j for j in range(file.model.njnt)}
    if isinstance(home, str):
        keys = [file.name("KEY", k) for k in range(file.model.nkey)]
        if home not in keys:
            raise InputError(f"home={home!r}: {file.path} has no such keyframe; {nearest(home, keys)}")
        qpos = np.array(file.model.key_qpos[keys.index(home)])
    else:
        for name, value in home.items():
            if name not in numbers or name not in robot.coordinates:
                raise InputError(f"home: no hinge or slide {name!r}; {nearest(name, robot.coordinates)}")
            qpos[at[numbers[name]]] = value
    file.put(qpos)
    links = {link.name: link for link in robot._described.links}
    guess: dict[str, Any] = {}
    for k, link in enumerate(robot._described.links):
        rigid = robot._built.rigids[robot._built.rigid_of[k]]
        if not robot._built.rigid_of[k] or rigid.links[0] != k:
            continue
        turn = np.array(file.data.xmat[k]).reshape(3, 3) @ links[link.name].turn.T
        for p in rigid.points:
            guess.setdefault(p, file.data.xpos[k] + turn @ (robot._built.places[p] - link.origin))
        for v in rigid.vectors:
            guess.setdefault(v, turn @ robot._built.directions[v])
    ground = robot._built.rigids[0]
    guess = {n: x for n, x in guess.items() if n not in (*ground.points, *ground.vectors)}
    values = np.array(
        [qpos[at[numbers[j]]] for c in robot.actuated for j, own in robot.coordinates.items() if own == c]
    )
    return robot.pose(values, start=guess)


def _save_mjcf(robot: Robot, path: Path, system: System) -> Path:
    """Put the places of a design into the description that MuJoCo has read, and write that."""
    if path.suffix.lower() != ".xml":
        raise InputError(f"{path}: an MJCF file ends in .xml")
    file: MjcfFile = robot._file
    built, links = robot._built, robot._described.links
    spec = file.spec.copy()
    spec.assets = file.spec.assets
    top, par = system.topology, system.parameters
    points = dict(zip(top.points, np.asarray(par.points), strict=True))
    vectors = {n: v / np.linalg.norm(v) for n, v in zip(top.vectors, np.asarray(par.vectors), strict=True)}
    markers = {m.name: at for m, at in zip(top.markers, np.asarray(par.markers), strict=True)}
    old = dict(zip(top.points, np.asarray(robot.system.parameters.points), strict=True)) | built.directions
    old |= {m.name: at for m, at in zip(top.markers, np.asarray(robot.system.parameters.markers), strict=True)}

    def changed(name: str, now: np.ndarray) -> bool:
        return not np.array_equal(old[name], now)

    numbers = {file.name("JOINT", j): j for j in range(file.model.njnt)}
    joints = {e.id: e for e in spec.joints}
    sites = {e.id: e for e in spec.sites}
    for link in links[1:]:
        for joint in link.joints:
            if joint.held:
                continue
            anchor, element = built.anchors[joint.name], joints[numbers[joint.name]]
            at = built.sliders.get(joint.name, anchor.point)
            if changed(anchor.point, points[anchor.point]):
                element.pos = link.turn.T @ (points[at] - link.origin)
            if anchor.axis and changed(anchor.axis, vectors[anchor.axis]):
                sign = 1.0 if built.directions[anchor.axis] @ joint.axis > 0 else -1.0
                element.axis = sign * (link.turn.T @ vectors[anchor.axis])
    _close(robot, file, spec, points, changed)
    at_site = {file.name("SITE", s): s for s in range(file.model.nsite)}
    for (k, name), mark in built.marks.items():
        if name and changed(mark, markers[mark]):
            sites[at_site[name]].pos = links[k].turn.T @ (markers[mark] - links[k].origin)
    try:
        spec.compile()
    except ValueError as error:
        raise ModelFileError(f"{file.path}: MuJoCo refuses this design: {' '.join(str(error).split())}") from None
    return write(path, spec.to_xml().encode())


def _close(robot: Robot, file: MjcfFile, spec: Any, points: dict[str, np.ndarray], changed: Callable) -> None:
    """Move the places where loops are closed."""
    links, pins = robot._described.links, robot._built.pins
    equalities, bodies, sites = ({e.id: e for e in of} for of in (spec.equalities, spec.bodies, spec.sites))
    model, site = file.model, file.mujoco.mjtObj.mjOBJ_SITE
    at_home = np.array_equal(file.data.qpos, model.qpos0)
    for i in range(model.neq):
        name = file.name("EQUALITY", i)
        if name not in pins or not any(changed(p, points[p]) for p in pins[name]):
            continue
        loop = next(x for x in robot._described.loops if x.name == name)
        pair = [(k, links[k].turn.T @ (points[p] - links[k].origin))
                for k, p in zip((loop.first, loop.second), pins[name], strict=True)]  # fmt: skip
        element = equalities[i]
        if int(model.eq_objtype[i]) == int(site):
            for number, (_, local) in zip((model.eq_obj1id[i], model.eq_obj2id[i]), pair, strict=True):
                sites[int(number)].pos = local
        elif at_home:
            element.data = np.concatenate([pair[0][1], np.asarray(element.data)[3:]])
        else:  # MuJoCo would find the other body's anchor at qpos0, where this design is not drawn
            names = [f"{name} {side}" for side in ("first", "second")]
            for word, (k, local) in zip(names, pair, strict=True):
                bodies[k].add_site(name=word, pos=local)
            element.objtype, (element.name1, element.name2) = site, names


@public
def from_urdf(path: str | Path, hold: Sequence[str] = (), without: Sequence[str] = ()) -> Robot:
    """Read a robot from a URDF file, loops included, as a mechanism in natural coordinates.

    Loops are ``<loop_joint>`` elements (``spherical``, ``revolute``, ``fixed``), or ``<joint>`` in ``<gazebo>``. It is
    drawn with all joints at zero.

    Args:
        path: the file.
        hold: names of links whose joints are held as they are; floating ones always are.
        without: names of loop joints to be left out.

    Returns:
        The robot, with what was not taken over by name; driven by the joints of its transmissions, if it has any.

    Raises:
        ModelFileError: the file cannot be read, is no tree with loop joints, or nothing in it moves.

    Source: Isaac Sim, URDF importer extension, custom tags; Gazebo, Model a 4-bar linkage in SDFormat and URDF.
    """
    file = UrdfFile(Path(path))
    try:
        return Robot(read_urdf(file, without, hold), file, _save_urdf)
    except MechanismError as error:
        raise ModelFileError(f"{path}: {error}") from None


def _save_urdf(robot: Robot, path: Path, system: System) -> Path:
    """Put the places of a design where the file has them: frames of links are where their joints are."""
    if path.suffix.lower() != ".urdf":
        raise InputError(f"{path}: a URDF file ends in .urdf")
    built, described, top, par = robot._built, robot._described, system.topology, system.parameters
    points = dict(zip(top.points, np.asarray(par.points), strict=True))
    vectors = {n: v / np.linalg.norm(v) for n, v in zip(top.vectors, np.asarray(par.vectors), strict=True)}
    markers = {m.name: at for m, at in zip(top.markers, np.asarray(par.markers), strict=True)}
    places: dict[tuple[str, str], Any] = {}
    for k, link in enumerate(described.links):
        moving = [j for j in link.joints if not j.held]
        if moving:
            anchor = built.anchors[moving[0].name]
            at = points[built.sliders.get(moving[-1].name, anchor.point)]
            if not np.array_equal(at, built.places[anchor.point]):
                places["link", link.name] = at
            if anchor.axis and not np.array_equal(vectors[anchor.axis], built.directions[anchor.axis]):
                sign = 1.0 if built.directions[anchor.axis] @ moving[0].axis > 0 else -1.0
                places["axis", moving[0].name] = sign * vectors[anchor.axis]
        elif (k, "") in built.marks and not np.array_equal(markers[built.marks[k, ""]], link.origin):
            places["link", link.name] = markers[built.marks[k, ""]]
    shifts: dict[str, np.ndarray] = {}
    for loop in described.loops:
        if loop.name in built.pins:
            now = tuple(points[p] for p in built.pins[loop.name])
            places["loop", loop.name] = now
            shifts[loop.name] = np.subtract(now, [built.places[p] for p in built.pins[loop.name]])
    for name, shift in shifts.items():
        far = shifts.get(f"{name} axis", shift)
        if not np.allclose(far, shift, rtol=0.0, atol=1e-12 * built.size):
            raise InputError(
                f"save(): the axis of loop joint {name!r} points elsewhere in this design, and save() keeps it as the "
                f"file has it: move {built.pins[f'{name} axis'][0]!r} as {built.pins[name][0]!r}"
            )
    root = redrawn(robot._file, described, places)
    return write(path, b'<?xml version="1.0"?>\n' + ET.tostring(root) + b"\n")
