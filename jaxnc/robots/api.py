"""Robots read from MJCF and URDF, and mechanisms written to them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import AssemblyError, InputError
from jaxnc.io.target import file_name, write
from jaxnc.kinematics.inputs import check_system
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.robots.export_tree import ExportTree
from jaxnc.robots.mjcf import MjcfFile, MjcfWriter
from jaxnc.robots.robot import Robot
from jaxnc.robots.urdf import UrdfFile, UrdfWriter, pieces_of, values_of_pieces
from jaxnc.solvers.assembly import derive, meets, settle
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
    robot = Robot(file, without, hold)
    if home is None:
        return robot
    file.set_home(file.qpos_near(home, robot.coordinates))
    joints = {coordinate: joint for joint, coordinate in robot.coordinates.items()}
    values = np.array([file.value(joints[coordinate]) for coordinate in robot.actuated])
    # The links need not close the loops with these values: the nearest pose in which they do is taken.
    near = robot.pose(values, start=robot._tree.carry(file.frames()), throw=False)
    if near.converged:
        file.set_home(np.asarray(robot.joint_values(near)))
        return Robot(file, without, hold)
    # Coordinates that are held with a ball joint may not suit this pose: then it has to close the loops as it is.
    there = Robot(file, without, hold)
    there.pose(values)
    return there


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
    return Robot(UrdfFile(Path(path)), without, hold)


@public
@dataclass(frozen=True)
class Exported:
    """A file that was written for a robot simulator.

    Attributes:
        path: the file.
        links: names of its bodies.
        joints: names of its joints, in the order of `joint_values`.
        loops: names of what closes its loops.
        coordinates: what each coordinate of the mechanism is there, in words.
        left_out: what of the mechanism is not in the file, each in a phrase.
        notes: what was chosen where the mechanism does not say.
    """

    path: Path
    links: tuple[str, ...]
    joints: tuple[str, ...]
    loops: tuple[str, ...]
    coordinates: dict[str, str]
    left_out: tuple[str, ...]
    notes: tuple[str, ...]
    _tree: ExportTree = field(repr=False, compare=False)
    _urdf: bool = field(default=False, repr=False)

    def joint_values(self, motion: Motion) -> np.ndarray:
        """Joint values that put the robot where the mechanism is: MuJoCo's ``qpos``.

        Args:
            motion: poses ``(...)`` of the mechanism, of the design that was written.

        Returns:
            One number for a hinge (radians, from the home pose) or a slide (length), four of a ball (a quaternion,
            scalar first; in URDF three angles, about x, y, z), seven of a free joint; ``(..., nq)``. Hinges are counted
            on through whole turns.
        """
        values = self._tree.joint_values(np.asarray(motion.q))
        return values_of_pieces(self._tree.joints.values(), values) if self._urdf else values

    def __str__(self) -> str:
        many = f"{self.path}: {len(self.links)} links, {len(self.joints)} joints, {len(self.loops)} loop constraints"
        lines = [many, *(f"  {name}: {said}" for name, said in self.coordinates.items())]
        lines += [f"  left out: {said}" for said in self.left_out] + [f"  note: {said}" for said in self.notes]
        return "\n".join(lines)

    __repr__ = __str__


def to_mjcf(mechanism: Mechanism, path: str | Path, at: System | Motion | None = None) -> Exported:
    """Write a mechanism as MJCF, the format of MuJoCo.

    Every rigid part becomes a body, joints make a tree of them, and `equality` constraints close the loops. All joints
    are zero in the home pose.

    Args:
        mechanism: the description.
        path: a file name ending in ``.xml``.
        at: a design of it (a system compiled from it, with other numbers); or a motion, whose design it is, whose
            first pose is the home pose, whose poses are kept as keyframes, and whose inputs get motors. If not given,
            the mechanism as it is drawn, with motors for the inputs of its run, or for all angles and distances.

    Returns:
        What was written, and by name what was not.

    Raises:
        InputError: `at` is of another mechanism, or another kind of file name.
        AssemblyError: the design does not assemble, or poses of the motion have failed.
        OutputError: the file cannot be written.
    """
    path = _check_suffix(path, ".xml")
    tree, driven, q = _make_tree(mechanism, at)
    file = MjcfWriter(tree, driven, tree.joint_values(q))
    write(path, file.text().encode())
    return _report(path, tree)


def to_urdf(mechanism: Mechanism, path: str | Path, at: System | Motion | None = None) -> Exported:
    """Write a mechanism as URDF: a tree of links, and a table of what closes its loops.

    Loops are ``<loop_joint>`` elements, a name and a type (``spherical``, ``fixed``) with a place on each of two links,
    which Isaac Sim reads and `from_urdf` does; and the same as ``<joint>`` in ``<gazebo>``. A joint with more than one
    freedom is several, with links between them that have no mass; points and markers are links on fixed joints.

    Args:
        mechanism: the description.
        path: a file name ending in ``.urdf``.
        at: as of `to_mjcf`; poses are not kept.

    Returns:
        What was written, and by name what was not.

    Raises:
        InputError: `at` is of another mechanism, or another kind of file name.
        AssemblyError: the design does not assemble, or poses of the motion have failed.
        OutputError: the file cannot be written.

    Source: Isaac Sim, URDF importer extension, custom tags; Gazebo, Model a 4-bar linkage in SDFormat and URDF.
    """
    path = _check_suffix(path, ".urdf")
    tree, driven, _ = _make_tree(mechanism, at)
    notes = tree.description.notes
    if not any(link.inertia for link in tree.links):
        notes[:] = [n for n in notes if not n.startswith("no body has a mass")] + ["no body has a mass, and no link"]
    if any(joint.kind == "ball" for joint in tree.joints.values()):
        notes.append("balls are three hinges, about x, y, z, which lose a freedom a quarter turn from home about y")
    write(path, UrdfWriter(tree, driven).text().encode())
    return _report(path, tree, urdf=True)


def _report(path: Path, tree: ExportTree, urdf: bool = False) -> Exported:
    """Tell what was written."""
    d = tree.description
    return Exported(
        path,
        tuple(link.name for link in tree.links[1:]),
        tuple(piece.name for joint in tree.joints.values() for piece in (pieces_of(joint) if urdf else [joint])),
        (*(x.name for x in d.loops), *(x.name for x in d.ties), *tree.cables),
        {name: str(tree.coordinates.get(name, "no sum of joints")) for name in tree.system.topology.scalars},
        tuple(d.left_out),
        tuple(d.notes),
        tree,
        urdf,
    )


def _check_suffix(path: str | Path, suffix: str) -> Path:
    """Refuse a file name of another suffix."""
    path = file_name(path)
    if path.suffix.lower() != suffix:
        raise InputError(
            f"{path}: this file ends in {suffix}, and the name in {path.suffix!r}; call it {path.stem}{suffix}"
        )
    return path


def _make_tree(mechanism: Mechanism, at: System | Motion | None) -> tuple[ExportTree, tuple[str, ...], np.ndarray]:
    """Make the tree of a mechanism; return it, the inputs that get motors, and the poses to be kept ``(K, N)``."""
    if not isinstance(mechanism, Mechanism):
        raise InputError(f"expected the Mechanism, got {type(mechanism).__name__}; a System is given as at=")
    if isinstance(at, Motion):
        at.check()
        q = np.asarray(at.q)
        q = q.reshape(-1, q.shape[-1])
        system, driven, home = at.system, at.driven, q[0]
    else:
        if not isinstance(at, System | None):
            raise InputError(f"at= is a System or a Motion, got {type(at).__name__}")
        system = mechanism.compile() if at is None else at
        check_system(system, "at=")
        driven = tuple(mechanism.model.run.inputs) or system.topology.scalars
        eq = derive(system)
        found = settle(eq, np.zeros(len(system.topology.coordinates)))
        if not meets(eq, found.q, float(found.gap)):
            raise AssemblyError(f"{system.name!r} does not assemble as it is drawn; nc.diagnose(system) says why")
        home, q = np.asarray(found.q), np.zeros((0, len(system.topology.coordinates)))
    own = (*mechanism.all_points, *mechanism.all_vectors, *mechanism.scalar_names)
    top = system.topology
    if (*top.points, *top.vectors, *top.scalars) != own:
        raise InputError(f"at=: {system!r} was not compiled from {mechanism!r}")
    if np.asarray(system.parameters.points).ndim > 2:
        raise InputError("at=: it holds several designs; give one of them")
    return ExportTree(mechanism, system, home), driven, q
