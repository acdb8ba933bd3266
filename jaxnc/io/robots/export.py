"""A mechanism as a file of a robot simulator, and what came of it."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import AssemblyError, InputError
from jaxnc.io.robots.grown import Grown
from jaxnc.io.robots.mjcf import Mjcf
from jaxnc.io.robots.pose import Posed, joint_values
from jaxnc.io.robots.tree import Tree
from jaxnc.io.robots.urdf import Urdf, in_urdf
from jaxnc.io.target import file_name, write
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.solvers.assembly import derive, meets, settle
from jaxnc.system.system import System


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
    _grown: Grown = field(repr=False, compare=False)
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
        values = poses(self._grown, np.asarray(motion.q))
        return in_urdf([j for _, j in self._grown.tree.joints.values()], values) if self._urdf else values

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
    path = named(path, ".xml")
    grown, driven, q = grow(mechanism, at)
    file = Mjcf(grown, driven, poses(grown, q))
    write(path, file.text().encode())
    return exported(path, grown)


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
    path = named(path, ".urdf")
    grown, driven, _ = grow(mechanism, at)
    notes = grown.tree.notes
    if not any(link.inertia for link in grown.tree.links):
        notes[:] = [n for n in notes if not n.startswith("no body has a mass")] + ["no body has a mass, and no link"]
    if any(joint.kind == "ball" for _, joint in grown.tree.joints.values()):
        notes.append("balls are three hinges, about x, y, z, which lose a freedom a quarter turn from home about y")
    file = Urdf(grown, driven)
    write(path, file.text().encode())
    return exported(path, grown, tuple(file.values))


def exported(path: Path, grown: Grown, joints: tuple[str, ...] = ()) -> Exported:
    """What is told of a file that was written."""
    tree = grown.tree
    return Exported(
        path,
        tuple(link.name for link in tree.links[1:]),
        joints or tuple(tree.joints),
        (*(x.name for x in tree.loops), *(x.name for x in tree.ties), *tree.cables),
        {n: said(tree, n) for n in grown.system.topology.scalars},
        tuple(tree.left_out),
        tuple(tree.notes),
        grown,
        bool(joints),
    )


def named(path: str | Path, suffix: str) -> Path:
    """A file name of the suffix that there must be."""
    path = file_name(path)
    if path.suffix.lower() != suffix:
        raise InputError(
            f"{path}: this file ends in {suffix}, and the name in {path.suffix!r}; call it {path.stem}{suffix}"
        )
    return path


def said(tree: Tree, name: str) -> str:
    """A coordinate in words."""
    reading = tree.readings.get(name)
    if reading is None:
        return "no sum of joints"
    if reading.ends:
        return f"the distance of the sites {reading.ends[0]!r} and {reading.ends[1]!r}"
    terms = " ".join(
        f"{'-' if f < 0 else '+'} {'' if abs(f) == 1 else f'{abs(f):g} '}{j!r}" for j, f in reading.terms.items()
    )
    return f"{reading.home:.6g} {terms}"


def grow(mechanism: Mechanism, at: System | Motion | None) -> tuple[Grown, tuple[str, ...], np.ndarray]:
    """The tree of a mechanism, the inputs that get motors, and the poses to be kept ``(K, N)``."""
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
    return Grown(mechanism, system, home), driven, q


def poses(grown: Grown, q: np.ndarray) -> np.ndarray:
    """Joint values ``(..., nq)`` of poses ``(..., N)``."""
    flat, out, before = q.reshape(-1, q.shape[-1]), [], None
    for x in flat:
        before = joint_values(grown.tree, Posed(grown.parts, x, grown.home), before)
        out.append(before)
    width = sum(j.width for link in grown.tree.links for j in link.joints)
    return np.reshape(out, (*q.shape[:-1], width))
