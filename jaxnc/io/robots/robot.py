"""A robot that was read from a file: its mechanism, and all of its joints from those that are actuated."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.errors import InputError, MechanismError, ModelFileError, nearest
from jaxnc.io.robots.built import Builder
from jaxnc.io.robots.described import Described
from jaxnc.io.robots.read_mjcf import MjcfFile, read_mjcf
from jaxnc.io.target import write
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position
from jaxnc.mechanism import Mechanism
from jaxnc.solvers.assembly import derive, rank_of, sample_poses
from jaxnc.system.frames import quaternions
from jaxnc.system.system import System
from jaxnc.types import Array, Float

_WRITTEN_OUT = 20  # unknowns; more are solved for on the host, by sparse matrices: compiling them takes minutes
_RISES = 1e-6  # of a null space: what a coordinate must still move to be taken for an input


class Robot:
    """A robot that was read from a file, as a mechanism.

    Points are where joints and loop constraints are (``<joint>_at``), unit vectors are axes (``<joint>_axis``); the
    angle or distance of a joint is a coordinate of its name; frames of links (``<link>_frame``) and sites are markers.
    In names dots, commas, dashes and spaces are underscores.

    Attributes:
        mechanism: the mechanism.
        system: it compiled, as the file has it.
        joints: names of all joints in the order of the file.
        actuated: coordinates that `positions` takes: of the joints that motors drive, as far as they are independent.
        held: coordinates that keep the value of the drawing: what else is free (joints with springs first).
        left_out: what of the file is not in the mechanism, each in a phrase.
        notes: what was chosen.
    """

    def __init__(self, described: Described, file: Any, save: "Callable[[Robot, Path, System], Path]"):
        self._described, self._file, self._save = described, file, save
        self._built = Builder(described)
        self.mechanism: Mechanism = self._built.mechanism
        model = self.mechanism.model
        many = 3 * (len(model.points) + len(model.vectors)) + len(self.coordinates) > _WRITTEN_OUT
        self.system: System = self.mechanism.compile(sparse=many or None)
        self.joints = tuple(described.joints)
        self.actuated, self.held = self._inputs()
        self.left_out, self.notes = tuple(described.left_out), tuple(described.notes)

    @property
    def coordinates(self) -> dict[str, str]:
        """The coordinate of every hinge and slide, by the joint's name in the file."""
        return dict(self._built.coordinates)

    def _inputs(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Independent coordinates: those of motors, then of springs, then any joint, then anything that moves."""
        top, joints = self.system.topology, self._described.joints
        own = self._built.coordinates
        driven = [own[j] for j in self._described.actuated]
        sprung = [c for j, c in own.items() if joints[j].stiffness and c not in driven]
        others = [c for c in own.values() if c not in driven and c not in sprung]
        dense = self.mechanism.compile(sparse=False)
        sample = max(sample_poses(dense, 3)[::-1], key=lambda s: s.rank)  # not at home, which may be a dead point
        _, null = rank_of(sample.jacobian)
        moves = np.zeros((len(null), len(top.coordinates)))
        moves[:, top.unknown] = null
        chosen: list[str] = []
        for name in (*driven, *sprung, *others, *top.named(top.unknown)):
            if len(chosen) == len(null):
                break
            at = [top.position[c] for c in (*chosen, name)]
            if np.linalg.svd(moves[:, at], compute_uv=False)[-1] > _RISES:
                chosen.append(name)
        motors = set(driven) or set(own.values())
        return tuple(c for c in chosen if c in motors), tuple(c for c in chosen if c not in motors)

    # -- all joints from some -------------------------------------------------------------------------------------

    def positions(self, values: Any, system: System | None = None, **options: Any) -> Float[Array, "... nq"]:
        """Values of all joints from those of the actuated ones, the loops closed.

        Args:
            values: of the joints in `actuated`, ``(..., actuated)``, counted as the file does, radians and lengths.
            system: a design, other than the file's: `robot.system.replace(...)`.
            options: those of `jaxnc.solve_position`.

        Returns:
            Values of all joints in the order of the file, MuJoCo's ``qpos``: one number for a hinge or slide, a
            quaternion, scalar first, for a ball. May be jitted, mapped and differentiated with respect to both.

        Raises:
            InputError: another number of values.
            AssemblyError: a single pose is not found.
        """
        return self.joint_values(self.pose(values, system, **options))

    def pose(self, values: Any, system: System | None = None, **options: Any) -> Motion:
        """The same as poses of the mechanism: points, vectors, angles, frames of links (see `positions`)."""
        system = self.system if system is None else system
        values = values if isinstance(values, Tracer) else np.asarray(values, dtype=float)
        if values.ndim == 0 or values.shape[-1] != len(self.actuated):
            raise InputError(
                f"{self.mechanism.name!r} is driven by {len(self.actuated)} joints ({', '.join(self.actuated)}); got "
                f"values of shape {values.shape}"
            )
        away = self._away(system)
        inputs = {c: values[..., k] + away[c] for k, c in enumerate(self.actuated)}
        return solve_position(system, inputs, hold=self.held, **options)

    def _away(self, system: System) -> dict[str, Any]:
        """What to add to a joint's value to have its coordinate, as drawn."""
        home, top = derive(system).home, system.topology
        if not isinstance(home, Tracer):  # nothing to compile
            home = np.asarray(home)
        joints = self._described.joints
        return {c: home[top.position[c]] - joints[j].reference for j, c in self._built.coordinates.items()}

    def joint_values(self, motion: Motion) -> Float[Array, "... nq"]:
        """Values of all joints of poses of the mechanism, in the order of the file."""
        away, out = self._away(motion.system), []
        lead = motion.status.shape
        for name, joint in self._described.joints.items():
            if joint.held:
                out.append(jnp.broadcast_to(jnp.array(joint.held), (*lead, joint.width)))
            elif joint.kind in ("hinge", "slide"):
                coordinate = self._built.coordinates[name]
                out.append((motion[coordinate] - away[coordinate])[..., None])
            else:
                out.append(self._quaternion(motion, name))
        return jnp.concatenate(out, axis=-1)

    def _quaternion(self, motion: Motion, name: str) -> Array:
        """A ball's rotation, in the frame of its link."""
        anchor = self._built.anchors[name]
        link = next(x for x in self._described.links if any(j.name == name for j in x.joints))
        w, x, y, z = self._described.joints[name].turned
        home = np.array([[w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
                         [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
                         [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z]])  # fmt: skip
        before, after = self._turn(motion, anchor.before), self._turn(motion, anchor.after)
        own = jnp.swapaxes(before, -1, -2) @ after
        return quaternions(home @ link.turn.T @ own @ link.turn)

    def _turn(self, motion: Motion, number: int) -> Array:
        """Rotation of a rigid from the drawing ``(..., 3, 3)``; of a rod the one without spin."""
        rigid = self._built.rigids[number]
        if not number:
            return jnp.broadcast_to(jnp.eye(3), (*motion.status.shape, 3, 3))
        if not self._built.flat(rigid):
            return motion.orientation(self._built.bodies[number])
        p, q = rigid.points
        home, top = derive(motion.system).home, motion.system.topology
        drawn = [home[3 * k : 3 * k + 3] for k in (top.points.index(p), top.points.index(q))]
        a, b = drawn[1] - drawn[0], motion[q] - motion[p]
        a, b = a / jnp.linalg.norm(a), b / jnp.linalg.norm(b, axis=-1, keepdims=True)
        v, c = jnp.cross(a, b), b @ a
        zero = jnp.zeros_like(c)
        x = jnp.stack([zero, -v[..., 2], v[..., 1], v[..., 2], zero, -v[..., 0], -v[..., 1], v[..., 0], zero], axis=-1)
        x = x.reshape(*c.shape, 3, 3)
        return jnp.eye(3) + x + x @ x / (1.0 + c)[..., None, None]

    def frames(self, motion: Motion) -> dict[str, tuple[Array, Array]]:
        """Places ``(..., 3)`` and axes, as columns ``(..., 3, 3)``, of the frames of all links."""
        out = {}
        for k, link in enumerate(self._described.links[1:], start=1):
            number = self._built.rigid_of[k]
            turn = self._turn(motion, number) @ link.turn
            if not number:
                out[link.name] = (jnp.broadcast_to(link.origin, (*motion.status.shape, 3)), turn)
            elif (k, "") in self._built.marks:
                out[link.name] = (motion[self._built.marks[k, ""]], turn)
        return out

    # -- back -----------------------------------------------------------------------------------------------------

    def save(self, path: str | Path, system: System | None = None) -> Path:
        """Write the file again, with the dimensions of a design.

        Places of joints, axes, sites and loop constraints are those of the design's drawing; links keep their frames,
        and everything else in the file stays as it is. Meshes are named as they were: keep the file in the same folder.
        MuJoCo writes numbers to about seven digits.

        Args:
            path: where to; a file name of the same ending.
            system: the design; the file's own if not given.

        Returns:
            The path.

        Raises:
            InputError: a system of another robot, or one with other masses or springs, which are not written.
            OutputError: the file cannot be written.
        """
        system = self.system if system is None else system
        if system.topology != self.system.topology:
            raise InputError(f"{system!r} is not a design of this robot; change robot.system by replace()")
        for name in ("physical", "dimensions"):
            if not np.array_equal(getattr(system.parameters, name), getattr(self.system.parameters, name)):
                raise InputError(
                    "save() writes places and directions; masses, springs or constants of relations of this design are "
                    "not the file's, so change those in the file"
                )
        return self._save(self, Path(path), system)

    def __repr__(self) -> str:
        return (
            f"Robot({self.mechanism.name!r}: {len(self._described.links) - 1} links, {len(self.joints)} joints, "
            f"{len(self._described.loops)} loops, driven by {', '.join(self.actuated) or 'nothing'})"
        )

    def __str__(self) -> str:
        lines = [repr(self)]
        if self.held:
            lines.append(f"  held: {', '.join(self.held)}")
        lines += [f"  left out: {said}" for said in self.left_out] + [f"  note: {said}" for said in self.notes]
        return "\n".join(lines)


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
