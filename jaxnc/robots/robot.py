"""A robot that was read from a file: its mechanism, and all of its joints from those that are actuated."""

import functools
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.compiling import in_one_program
from jaxnc.errors import AssemblyError, InputError, MechanismError, ModelFileError, counted
from jaxnc.families.shapes import rotation_rows
from jaxnc.kinematics.inputs import check_system, in_radians
from jaxnc.kinematics.instant import as_jax, body_of
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position
from jaxnc.mechanism import Mechanism
from jaxnc.robots.import_tree import ElementaryJoint, ImportTree, Link, MovedPlaces
from jaxnc.robots.mjcf import MjcfFile
from jaxnc.robots.urdf import UrdfFile
from jaxnc.solvers.assembly import derive, rank_of, sample_poses, to_host
from jaxnc.solvers.sparse_matrix import dependencies
from jaxnc.system.frames import quaternions, turns
from jaxnc.system.on_lanes import on_host
from jaxnc.system.system import System
from jaxnc.types import Array, ArrayLike, Float, Numbers
from jaxnc.validate import as_traceable


@public
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

    def __init__(self, file: MjcfFile | UrdfFile, without: Sequence[str] = (), hold: Sequence[str] = ()):
        self._chosen = tuple((x,) if isinstance(x, str) else tuple(x) for x in (without, hold))
        try:
            self._description = file.read(*self._chosen)
            self._tree = ImportTree(self._description)
        except MechanismError as error:
            raise ModelFileError(f"{file.path}: {error}") from None
        self._file: Any = file
        self.mechanism: Mechanism = self._tree.mechanism
        self.system: System = self.mechanism.compile()
        self.joints = tuple(self._description.joints)
        self.actuated, self.held = self._inputs()
        self.left_out, self.notes = tuple(self._description.left_out), tuple(self._description.notes)

    def __reduce__(self) -> tuple:
        """Return what reads the file again, drawn in the same pose."""
        return Robot, (self._file, *self._chosen)

    @property
    def coordinates(self) -> dict[str, str]:
        """The coordinate of every hinge and slide, by the joint's name in the file."""
        return dict(self._tree.coordinates)

    def _inputs(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Choose independent coordinates: of motors, then of springs, then of any joint, then anything that moves."""
        top, joints = self.system.topology, self._description.joints
        own = self._tree.coordinates
        driven = [own[j] for j in self._description.actuated]
        sprung = [c for j, c in own.items() if joints[j].stiffness and c not in driven]
        others = [c for c in own.values() if c not in driven and c not in sprung]
        samples = sample_poses(self.system, 3)
        most = max(s.rank for s in samples)  # home may be a dead point, of another rank
        poses = []
        for sample in samples[::-1]:
            if sample.rank == most:
                matrix = sample.jacobian  # of a large system a sparse one
                null = rank_of(matrix)[1] if sample.null is None else dependencies(matrix.T).T
                poses.append(np.zeros((len(null), len(top.coordinates))))
                poses[-1][:, top.unknown] = null
        chosen: list[str] = []
        for name in (*driven, *sprung, *others):
            if len(chosen) == len(poses[0]):
                break
            at = [top.position[c] for c in (*chosen, name)]
            # 1e-6 of a null space must a coordinate still move to be taken for an input
            if np.linalg.svd(poses[0][:, at], compute_uv=False)[-1] > 1e-6:
                chosen.append(name)
        while len(chosen) < len(poses[0]):  # no joint tells what is left, such as a spin between two balls
            at = [top.position[c] for c in chosen]
            left = [np.linalg.norm(rank_of(null[:, at].T)[1] @ null, axis=0) for null in poses]
            rates = np.min(left, axis=0)  # where they are least: a coordinate at its extreme can be held nowhere else
            chosen.append(top.coordinates[int(np.argmax(rates > 0.999 * rates.max()))])  # the first of equal ones
        motors = set(driven) or set(own.values())
        return tuple(c for c in chosen if c in motors), tuple(c for c in chosen if c not in motors)

    # -- all joints from some -----------------------------------------------------------------------------------

    def positions(self, values: ArrayLike, system: System | None = None, **options: object) -> Float[Array, "... nq"]:
        """Values of all joints from those of the actuated ones, the loops closed.

        Args:
            values: of the joints in `actuated`, ``(..., actuated)``, counted as the file does, radians (or as `unit`
                says) and lengths.
            system: a design, other than the file's: `robot.system.replace(...)`.
            options: those of `jaxnc.solve_position`, but `hold`; `rates` by the names in `actuated`.

        Returns:
            Values of all joints in the order of the file, MuJoCo's ``qpos``: one number for a hinge or slide, a
            quaternion, scalar first, for a ball. May be jitted, mapped and differentiated with respect to both.

        Raises:
            InputError: another number of values, or `hold`.
            AssemblyError: a single pose is not found.
        """
        found = self.joint_values(self.pose(values, system, **options))
        if not self.actuated:  # one pose, however many are asked for
            found = jnp.broadcast_to(found, (*np.shape(values)[:-1], found.shape[-1]))
        return found

    def pose(self, values: Any, system: System | None = None, **options: Any) -> Motion:
        """Poses of the mechanism: points, vectors, angles, frames of links, from what `positions` takes."""
        system = self._own(self.system if system is None else system)
        values = as_traceable(values, "values of joints")
        if values.ndim == 0 or values.shape[-1] != len(self.actuated):
            raise InputError(
                f"{self.mechanism.name!r} is driven by {counted(len(self.actuated), 'joint')} "
                f"({', '.join(self.actuated)}); got values of shape {values.shape}"
            )
        if "hold" in options:
            kept = ", ".join(self.held) or "none"
            raise InputError(f"hold=: a robot chooses what it holds, here {kept} (robot.held); when it is read, hold= "
                             "holds the joints of a link")  # fmt: skip
        away = self._away(derive(system).home)
        (one,) = in_radians(system, options.get("unit"), dict.fromkeys(self.actuated, 1.0))  # what is given is in these
        inputs = {c: values[..., k] + away[c] / one[c] for k, c in enumerate(self.actuated)}
        try:
            return solve_position(system, inputs, hold=self.held, **options)
        except AssemblyError as error:
            less = ", ".join(f"{c} {float(away[c]):.6g}" for c in self.actuated if float(away[c]))
            told = f" These are coordinates of the mechanism; values of joints are less by {less}." if less else ""
            raise AssemblyError(f"{error}{told}") from None

    def _own(self, system: System) -> System:
        """Return a design of this robot; refuse any other system."""
        if not isinstance(system, System) or system.topology != self.system.topology:
            raise InputError(f"{system!r} is not a design of this robot; change robot.system by replace()")
        return system

    def _away(self, home: Numbers) -> dict[str, Any]:
        """Return what to add to a joint's value to have its coordinate, from the coordinates as drawn."""
        home = home if isinstance(home, Tracer) else np.asarray(home)  # nothing to compile
        joints, top = self._description.joints, self.system.topology
        return {c: home[top.position[c]] - joints[j].reference for j, c in self._tree.coordinates.items()}

    def joint_values(self, motion: Motion) -> Float[Array, "... nq"]:
        """Values of all joints of poses of the mechanism, in the order of the file."""
        q, home = self._coordinates_of(motion)
        if motion._designs:  # each pose is counted from its own drawing
            return jax.vmap(self.joint_values)(motion)
        balls = []
        for joint, link in self._moving("ball"):
            anchor = self._tree.anchors[joint.name]
            drawn = np.array(rotation_rows("euler parameters", [*joint.quaternion], []))
            ends = self._turn(q, home, anchor.before), self._turn(q, home, anchor.after)
            balls.append(_ball_values(*ends, drawn.astype(q.dtype), np.asarray(link.turn, q.dtype)))
        return as_jax(_line_up(q, home, balls, *self._order))

    @functools.cached_property
    def _order(self) -> tuple[np.ndarray, ...]:
        """Coordinates and references of hinges and slides, what is held, and where the file has each number of all."""
        every, top = [joint for link in self._description.links for joint in link.joints], self.system.topology
        lone, held = [joint for joint, _ in self._moving("hinge", "slide")], [joint for joint in every if joint.held]
        places = [top.position[self._tree.coordinates[joint.name]] for joint in lone]
        first = [*lone, *(joint for joint, _ in self._moving("ball")), *held]
        starts = dict(zip([j.name for j in first], np.cumsum([0, *(j.width for j in first)]).tolist(), strict=False))
        order = [starts[joint.name] + k for joint in every for k in range(joint.width)]
        still = [x for joint in held for x in joint.held]
        return np.array(places, int), np.array([j.reference for j in lone]), np.array(still), np.array(order, int)

    def _coordinates_of(self, motion: Motion) -> tuple[Any, Any]:
        """All coordinates of poses and of the drawing, NumPy's where nothing has to be compiled for them."""
        if not isinstance(motion, Motion):
            raise InputError(f"expected poses of this robot, as of robot.pose(values), got {type(motion).__name__}")
        q, home = motion.q, derive(self._own(motion.system)).home
        return (np.asarray(q), np.asarray(home)) if on_host(motion.poses, motion) else (q, home)

    def _moving(self, *kinds: str) -> list[tuple[ElementaryJoint, Link]]:
        links = self._description.links
        return [(joint, link) for link in links for joint in link.joints if joint.kind in kinds and not joint.held]

    def _turn(self, q: Any, home: Any, number: int) -> Any:
        """Rotation of a rigid from the drawing ``(..., 3, 3)``; of a rod the one without spin."""
        rigid, numeric, top = self._tree.rigids[number], _array_library(q), self.system.topology
        if not number:
            return numeric.broadcast_to(numeric.eye(3, dtype=q.dtype), (*q.shape[:-1], 3, 3))
        if not self._tree.flat(rigid):
            return turns(top, body_of(top, self._tree.bodies[number]).segments, home, q)
        drawn, place = (x[..., : 3 * len(top.points)].reshape(*x.shape[:-1], len(top.points), 3) for x in (home, q))
        a, b = (top.points.index(p) for p in rigid.points)
        return _shortest_turn(drawn[b] - drawn[a], place[..., b, :] - place[..., a, :])

    def frames(self, motion: Motion) -> dict[str, tuple[Array, Array]]:
        """Places ``(..., 3)`` and axes, as columns ``(..., 3, 3)``, of the frames of all links."""
        out, (q, home), top = {}, self._coordinates_of(motion), self.system.topology
        if motion._designs:
            return jax.vmap(self.frames)(motion)
        for k, link in enumerate(self._description.links[1:], start=1):
            number = self._tree.rigid_of[k]
            turned = self._turn(q, home, number)
            turn = as_jax(turned @ np.asarray(link.turn, q.dtype))
            if not number:
                place = _array_library(q).broadcast_to(np.asarray(link.origin, q.dtype), (*motion.status.shape, 3))
                out[link.name] = (as_jax(place), turn)
            elif (k, "") in self._tree.marks:
                name, rigid = self._tree.marks[k, ""], self._tree.rigids[number]
                place = motion[name]
                if self._tree.flat(rigid):  # a marker of a rod is on its line, which a design may have moved away
                    at = 3 * top.points.index(rigid.points[0]) + np.arange(3)
                    drawn = motion.system.parameters.markers[[m.name for m in top.markers].index(name)]
                    place = as_jax(q[..., at] + turned @ (_array_library(q).asarray(drawn) - home[at]))
                out[link.name] = (place, turn)
        return out

    # -- back ---------------------------------------------------------------------------------------------------

    def save(self, path: str | Path, system: System | None = None) -> Path:
        """Write the file again, with the dimensions of a design.

        Places of joints, axes, sites and loop constraints are those of the design's drawing; links keep their frames,
        and everything else in the file stays as it is. Meshes are named as they were: keep the file in the same folder.
        MuJoCo writes numbers to six digits.

        Args:
            path: where to; a file name of the same ending.
            system: the design; the file's own if not given.

        Raises:
            InputError: a system of another robot, one with other masses or springs, which are not written, or one that
                assembles elsewhere than it is drawn, as where a slide's line was moved off what slides on it.
            OutputError: the file cannot be written.
        """
        system = self._own(self.system if system is None else system)
        check_system(system, "save()")
        for name in ("physical", "dimensions"):
            if not np.array_equal(getattr(system.parameters, name), getattr(self.system.parameters, name)):
                raise InputError(
                    "save() writes places and directions; masses, springs or constants of relations of this design are "
                    "not the file's, so change those in the file"
                )
        (misfit, scale), (own, _) = _misfits(system), _misfits(self.system)  # a file's own loops may be open a little
        apart, top = scale * np.abs(misfit - own), system.topology
        if apart.max(initial=0.0) > 1e-7 * float(derive(system).length):  # of the size: the file has no more digits
            farthest = int(np.argmax(apart))
            (owner, *_) = top.row_owners[farthest]
            first, second = self._tree.pins.get(top.called(owner), ("", ""))
            told = (
                "what slides on a line that was moved along" if first == second else f"{first!r} and {second!r} alike"
            )
            raise InputError(
                f"{self.mechanism.name!r}: this design assembles elsewhere than it is drawn, off {owner.thing.noun} "
                f"{top.called(owner)!r} by {apart[farthest]:.3g}, and a file has the drawing: move {told}"
            )
        places, before = _named_places(system), _named_places(self.system)
        changed = {name for name, at in places.items() if not np.array_equal(at, before[name])}
        return self._file.save(Path(path), self._tree, MovedPlaces(places, changed))

    def __repr__(self) -> str:
        return (
            f"Robot({self.mechanism.name!r}: {counted(len(self._description.links) - 1, 'link')}, "
            f"{counted(len(self.joints), 'joint')}, {counted(len(self._description.loops), 'loop constraint')}, "
            f"driven by {', '.join(self.actuated) or 'nothing'})"
        )

    def __str__(self) -> str:
        lines = [repr(self)]
        if self.held:
            lines.append(f"  held: {', '.join(self.held)}")
        lines += [f"  left out: {said}" for said in self.left_out] + [f"  note: {said}" for said in self.notes]
        return "\n".join(lines)


def _misfits(system: System) -> tuple[np.ndarray, np.ndarray]:
    """Return by how much the drawing misses each row, and what makes a length of that."""
    eq = to_host(derive(system))
    residual = eq.residual(eq.home[:, None])[:, 0]
    scale = np.ones_like(residual)
    for block, of in zip(eq.topology.layout, eq.scales, strict=True):
        scale[block.rows] = of
    return residual / scale, scale


@in_one_program
def _ball_values(before: Numbers, after: Numbers, drawn: Numbers, turn: Numbers) -> Any:
    """Quaternions of a ball: how the one link turns in the frame of the other, as the file has both at home."""
    return quaternions(drawn @ turn.T @ before.swapaxes(-1, -2) @ after @ turn)


@in_one_program
def _line_up(
    q: Numbers,
    home: Numbers,
    balls: list[Numbers],
    places: np.ndarray,
    references: np.ndarray,
    held: np.ndarray,
    order: np.ndarray,
) -> Any:
    """Numbers of all joints in the order of the file: of hinges and slides, of balls, and of what is held."""
    numeric = _array_library(q)
    references, held = references.astype(q.dtype), held.astype(q.dtype)
    still = numeric.broadcast_to(held, (*q.shape[:-1], len(held)))
    return numeric.concatenate([q[..., places] - (home[places] - references), *balls, still], axis=-1)[..., order]


def _named_places(system: System) -> dict[str, np.ndarray]:
    """Return places of points and markers and unit vectors of a design, by name."""
    top, par = system.topology, system.parameters
    out = dict(zip(top.points, np.asarray(par.points), strict=True))
    out |= {n: v / np.linalg.norm(v) for n, v in zip(top.vectors, np.asarray(par.vectors), strict=True)}
    return out | {m.name: at for m, at in zip(top.markers, np.asarray(par.markers), strict=True)}


def _array_library(x: Numbers) -> ModuleType:
    """Choose NumPy for poses that are known, which then need nothing compiled; else JAX's arrays."""
    return np if isinstance(x, np.ndarray) else jnp


@in_one_program
def _shortest_turn(a: Numbers, b: Numbers) -> Any:
    """Return the smallest rotations ``(..., 3, 3)`` that take one direction ``(3,)`` to others ``(..., 3)``."""
    numeric: Any = np if isinstance(b, np.ndarray) else jnp
    a, b = a / numeric.linalg.norm(a), b / numeric.linalg.norm(b, axis=-1, keepdims=True)
    v, c = numeric.cross(a, b), b @ a
    zero = numeric.zeros_like(c)
    rows = [zero, -v[..., 2], v[..., 1], v[..., 2], zero, -v[..., 0], -v[..., 1], v[..., 0], zero]
    x = numeric.stack(rows, axis=-1).reshape(*c.shape, 3, 3)
    return numeric.eye(3, dtype=x.dtype) + x + x @ x / (1.0 + c)[..., None, None]
