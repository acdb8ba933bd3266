"""MJCF, the format of MuJoCo: read through MuJoCo's own reader, written without anything.

That reader knows defaults, includes, frames, units and orientations.
"""

import copy
import struct
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxnc.dynamics.model import force_constants
from jaxnc.errors import InputError, JaxncError, ModelFileError, nearest
from jaxnc.forces.kind import CATALOGUE
from jaxnc.io.target import write
from jaxnc.robots.export_tree import ExportTree
from jaxnc.robots.import_tree import (
    Description,
    ElementaryJoint,
    Follower,
    ImportTree,
    Inertia,
    Link,
    LoopClosure,
    MovedPlaces,
    Tie,
)
from jaxnc.solvers.assembly import derive
from jaxnc.system.frames import quaternions

_CLOSED = 1e-6  # of the robot's size: how far a weld may be from closed at home
_KINDS = ("free", "ball", "slide", "hinge")
_THIN = 0.008  # radius of capsules, of the drawing's size
_LEAST = "1e-14"  # mass and principal inertia of a link: MuJoCo refuses files with less than 1e-15, in whatever unit
_LOADS = {CATALOGUE[way + kind]: kind for kind in ("spring", "damper", "stop") for way in ("", "coordinate ")}


class MjcfFile:
    """An MJCF file, parsed and compiled.

    Attributes:
        description: what was read last.
    """

    description: Description

    def __init__(self, path: Path):
        try:
            import mujoco
        except ImportError:
            raise JaxncError('reading MJCF needs MuJoCo\'s own reader: pip install "jaxnc[mujoco]"') from None
        self.path = path
        self.mujoco: Any = mujoco
        if not path.is_file():
            raise self.fault("there is no such file")
        try:
            # MuJoCo's description of the file, which can be changed and written.
            self.spec: Any = self.mujoco.MjSpec.from_file(str(path))
        except (ValueError, OSError) as error:
            raise self.fault(f"MuJoCo does not read it: {_one_line(error)}") from None
        self.missing_meshes: list[str] = []
        self.missing_pictures: list[str] = []
        self._replace_missing_assets()
        try:
            self.model: Any = self.spec.compile()
        except ValueError as error:
            raise self.fault(f"MuJoCo does not compile it: {_one_line(error)}") from None
        self.data: Any = self.mujoco.MjData(self.model)  # the home pose
        self.set_home(self.model.qpos0)

    def __reduce__(self) -> tuple:
        """Return what reads the file again, in the same pose: MuJoCo's own records of it cannot be pickled."""
        return _read_in_pose, (self.path.resolve(), np.array(self.data.qpos))

    def fault(self, what: str) -> ModelFileError:
        """Make an error that names the file."""
        return ModelFileError(f"{self.path}: {what}")

    def set_home(self, qpos: np.ndarray) -> None:
        """Make a pose the home pose."""
        self.data.qpos[:] = qpos
        self.mujoco.mj_kinematics(self.model, self.data)

    def name(self, kind: str, number: int) -> str:
        """Return a name, or one made of a number, that nothing else has, where there is none."""
        sort, name = getattr(self.mujoco.mjtObj, f"mjOBJ_{kind}"), f"{kind.lower()} {number}"
        if given := self.mujoco.mj_id2name(self.model, sort, number):
            return given
        while self.mujoco.mj_name2id(self.model, sort, name) >= 0:
            name += "_"
        return name

    def names(self, kind: str, numbers: Iterable[Any]) -> list[str]:
        """Return the names of several things of a kind."""
        return [self.name(kind, int(i)) for i in numbers]

    def _replace_missing_assets(self) -> None:
        """Put something in place of pictures and meshes that are not there: only their names are kept."""
        folder, assets = self.path.parent, dict(self.spec.assets)
        for items, where, missing in (
            (self.spec.meshes, self.spec.meshdir, self.missing_meshes),
            (self.spec.textures, self.spec.texturedir, self.missing_pictures),
            (self.spec.hfields, self.spec.meshdir, self.missing_pictures),
        ):
            for item in items:
                if item.file and not (folder / where / item.file).is_file() and item.file not in assets:
                    missing.append(item.name or item.file)
                    key = f"{where.rstrip('/')}/{item.file}" if where else item.file
                    assets[key] = _stand_in(item.file)
        if self.missing_meshes or self.missing_pictures:
            self.spec.assets = assets

    def qpos_near(self, home: str | Mapping[str, float], joints: Collection[str]) -> np.ndarray:
        """Return ``qpos`` of a keyframe by name, or with values of some hinges and slides, which are among `joints`.

        Raises:
            InputError: no such keyframe or joint.
        """
        qpos, m = np.array(self.model.qpos0), self.model
        if isinstance(home, str):
            keys = self.names("KEY", range(m.nkey))
            if home not in keys:
                raise InputError(f"home={home!r}: {self.path} has no such keyframe; {nearest(home, keys)}")
            return np.array(m.key_qpos[keys.index(home)])
        for name, value in home.items():
            if name not in joints:
                raise InputError(f"home: no hinge or slide {name!r}; {nearest(name, joints)}")
            qpos[self._place(name)] = value
        return qpos

    def _place(self, joint: str) -> int:
        """Return where the value of a joint stands in ``qpos``."""
        return int(self.model.jnt_qposadr[self.names("JOINT", range(self.model.njnt)).index(joint)])

    def value(self, joint: str) -> float:
        """Return the value of a hinge or slide at home."""
        return float(self.data.qpos[self._place(joint)])

    def frames(self) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        """Return place and axes of every link at home, by its number."""
        d = self.data
        return {k: (np.array(d.xpos[k]), _matrix(d.xmat[k])) for k in range(self.model.nbody)}

    # -- reading ------------------------------------------------------------------------------------------------

    def read(self, without: Sequence[str] = (), hold: Sequence[str] = ()) -> Description:
        """Describe the robot in the home pose, `without` some equality constraints, with joints of some bodies held."""
        m = self.model
        gravity = tuple(float(g) for g in m.opt.gravity)
        self.description = d = Description(self.spec.modelname or self.path.stem)
        d.gravity = gravity if any(gravity) and not self._is_off("GRAVITY") else None
        self._close_welds(without, hold)
        for k in range(m.nbody):
            d.links.append(self._link(k, hold))
        if unknown := set(hold) - {link.name for link in d.links}:
            raise self.fault(f"hold={sorted(unknown)}: there is no such body")
        if all(j.held for j in d.joints.values()):
            raise self.fault("it has no joints that could move, only what stands still or floats")
        known = set(self.names("EQUALITY", range(m.neq)))
        if unknown := set(without) - known:
            raise self.fault(
                f"without={sorted(unknown)}: there is no such equality constraint; there are "
                f"{', '.join(sorted(known)) or 'none'}"
            )
        for i in range(m.neq):
            self._equality(i, without)
        self._motors()
        self._leave_out()
        return d

    def _is_off(self, *flags: str) -> bool:
        """Tell whether the file switches one of some parts of the simulation off."""
        bits = self.mujoco.mjtDisableBit
        return any(self.model.opt.disableflags & int(getattr(bits, f"mjDSBL_{flag}")) for flag in flags)

    def _link(self, k: int, hold: Sequence[str]) -> Link:
        m, d = self.model, self.data
        link = Link(self.name("BODY", k), int(m.body_parentid[k]) if k else -1, np.array(d.xpos[k]), _matrix(d.xmat[k]))
        for j in range(m.body_jntadr[k], m.body_jntadr[k] + m.body_jntnum[k]):
            dof, q = m.jnt_dofadr[j], m.jnt_qposadr[j]
            kind = _KINDS[m.jnt_type[j]]
            joint = ElementaryJoint(self.name("JOINT", j), kind, np.array(d.xaxis[j]), np.array(d.xanchor[j]))
            joint.stiffness = 0.0 if self._is_off("SPRING") else float(np.ravel(m.jnt_stiffness[j])[0])
            joint.damping = 0.0 if self._is_off("DAMPER") else float(np.ravel(m.dof_damping[dof])[0])
            if kind in ("hinge", "slide"):
                joint.reference, joint.rest = float(d.qpos[q]), float(m.qpos_spring[q])
            elif kind == "ball":
                joint.quaternion = tuple(map(float, d.qpos[q : q + 4]))
            if kind == "free" or link.name in hold:
                joint.held = tuple(map(float, d.qpos[q : q + joint.width]))
                what = "floating body" if kind == "free" else "joint of body"
                self.description.notes.append(f"{what} {link.name!r}: it is held where the file has it")
            link.joints.append(joint)
        for s in np.flatnonzero(m.site_bodyid == k):
            link.sites[self.name("SITE", int(s))] = np.array(d.site_xpos[s])
        if m.body_mass[k] > 0 and not self._mass_is_missing(k):
            axes = _matrix(d.ximat[k])
            tensor = axes @ np.diag(m.body_inertia[k]) @ axes.T
            link.inertia = Inertia(float(m.body_mass[k]), np.array(d.xipos[k]), tensor)
        return link

    def _mass_is_missing(self, k: int) -> bool:
        """Tell whether a body's mass comes from geoms of which some have meshes that are not there."""
        body = {b.id: b for b in self.spec.bodies}.get(k) if self.missing_meshes else None
        return bool(body and not body.explicitinertial and any(g.meshname in self.missing_meshes for g in body.geoms))

    def _equality(self, i: int, without: Sequence[str]) -> None:
        m, d, eq = self.model, self.description, self.mujoco.mjtEq
        name, kind, data = self.name("EQUALITY", i), eq(int(m.eq_type[i])), np.array(m.eq_data[i])
        if name in without or not m.eq_active0[i] or self._is_off("EQUALITY", "CONSTRAINT"):
            d.left_out.append(f"equality {name!r}: {'as asked' if name in without else 'not active'}")
            return
        one, other = int(m.eq_obj1id[i]), int(m.eq_obj2id[i])
        if kind in (eq.mjEQ_CONNECT, eq.mjEQ_WELD):
            weld = kind == eq.mjEQ_WELD
            if weld and self._is_open(i):
                raise self._refuse(name, "it welds two bodies other than they are at home")
            d.loops.append(LoopClosure(name, "weld" if weld else "connect", *self._ends(i, weld)[:3]))
        elif kind == eq.mjEQ_JOINT:
            d.followers.append(self._follower(name, [j for j in (one, other) if j >= 0], data))
        elif kind == eq.mjEQ_TENDON and other < 0 and not data[0] and (terms := self._joints_of_tendon(one)):
            d.ties.append(Tie(name, terms))
        else:
            raise self._refuse(name, f"it is of a kind ({kind.name}) that has no equation here")

    def _is_open(self, weld: int) -> bool:
        """Tell whether a weld is not closed at home."""
        at, twist = self._ends(weld, True)[2:]
        size = max(float(np.linalg.norm(np.ptp(self.data.xpos, axis=0))), 1e-9)
        return max(float(np.linalg.norm(at[0] - at[1])), twist * size) > _CLOSED * size

    def _close_welds(self, without: Sequence[str], hold: Sequence[str]) -> None:
        """Take as home the pose near it that closes all welds, if some are open and there is one.

        A weld says how its bodies stand, which is not as at ``qpos0`` in a design that was drawn in another pose.
        """
        mujoco, model, still = self.mujoco, copy.copy(self.model), np.array(self.data.qpos)
        kept = [name not in without for name in self.names("EQUALITY", range(model.neq))]
        active = model.eq_active0.astype(bool) & np.array(kept, bool) & (not self._is_off("EQUALITY", "CONSTRAINT"))
        welds = np.flatnonzero(active & (model.eq_type == int(mujoco.mjtEq.mjEQ_WELD))).tolist()
        if not any(map(self._is_open, welds)):
            return
        model.opt.jacobian, data = mujoco.mjtJacobian.mjJAC_DENSE, mujoco.MjData(model)
        data.eq_active[:], data.qpos[:] = active, still
        of = model.dof_jntid
        held = np.isin(self.names("BODY", model.dof_bodyid), list(hold)) | (model.jnt_type[of] == _KINDS.index("free"))
        for _ in range(50):  # Newton's method; mostly it takes five
            mujoco.mj_fwdPosition(model, data)
            rows = np.reshape(data.efc_J, (data.nefc, model.nv))[: data.ne] * ~held
            step = np.linalg.lstsq(rows, -data.efc_pos[: data.ne], rcond=1e-9)[0]
            mujoco.mj_integratePos(model, data.qpos, step, 1.0)
        self.set_home(data.qpos)
        if any(map(self._is_open, welds)):
            self.set_home(still)

    def _ends(self, i: int, weld: bool) -> tuple[int, int, tuple[np.ndarray, np.ndarray], float]:
        """Return two bodies held together, the place on each of them, and how far they are turned apart."""
        m, d, data = self.model, self.data, np.array(self.model.eq_data[i])
        one, other = int(m.eq_obj1id[i]), int(m.eq_obj2id[i])
        if int(m.eq_objtype[i]) == int(self.mujoco.mjtObj.mjOBJ_SITE):
            at = np.array(d.site_xpos[one]), np.array(d.site_xpos[other])
            twist = np.linalg.norm(_matrix(d.site_xmat[one]) - _matrix(d.site_xmat[other]))
            return int(m.site_bodyid[one]), int(m.site_bodyid[other]), at, float(twist)
        first, second = one, max(other, 0)
        a, b = _matrix(d.xmat[first]), _matrix(d.xmat[second])
        if not weld:
            return first, second, (d.xpos[first] + a @ data[0:3], d.xpos[second] + b @ data[3:6]), 0.0
        turn = np.zeros(9)
        self.mujoco.mju_quat2Mat(turn, data[6:10])
        at = d.xpos[first] + a @ data[3:6], d.xpos[second] + b @ data[0:3]
        return first, second, at, float(np.linalg.norm(a @ _matrix(turn) - b))

    def _follower(self, name: str, numbers: list[int], data: np.ndarray) -> Follower:
        m, names = self.model, self.names("JOINT", numbers)
        joints = [self.description.joints[n] for n in names]
        if any(j.kind not in ("hinge", "slide") for j in joints):
            raise self._refuse(name, "it ties joints that are no hinges or slides")
        away = [float(j.reference - m.qpos0[m.jnt_qposadr[k]]) for j, k in zip(joints, numbers, strict=True)]
        factors = np.poly1d(data[4::-1])
        if len(names) > 1:  # counted from home, which need not be where the file counts from
            factors = factors(np.poly1d([1.0, away[1]]))
        factors = np.pad(factors.c[::-1], (0, 5))[:5] - [away[0], 0, 0, 0, 0]
        factors[0] *= abs(factors[0]) > _CLOSED
        return Follower(name, names[0], names[1] if len(names) > 1 else None, tuple(map(float, factors)))

    def _refuse(self, name: str, why: str) -> ModelFileError:
        return self.fault(f"equality {name!r}: {why}; without={[name]!r} reads another robot, without it")

    def _joints_of_tendon(self, tendon: int) -> dict[str, float]:
        """Return a fixed tendon as factors of joints; empty for one through sites."""
        m, out = self.model, {}
        first = int(m.tendon_adr[tendon])
        for w in range(first, first + int(m.tendon_num[tendon])):
            if int(m.wrap_type[w]) != int(self.mujoco.mjtWrap.mjWRAP_JOINT):
                return {}
            out[self.name("JOINT", int(m.wrap_objid[w]))] = float(m.wrap_prm[w])
        return out

    def _motors(self) -> None:
        m, kinds, d = self.model, self.mujoco.mjtTrn, self.description
        other = []
        for i in range(m.nu):
            target, kind = int(m.actuator_trnid[i][0]), kinds(int(m.actuator_trntype[i]))
            if kind in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT):
                found = [self.name("JOINT", target)]
            else:
                found = list(self._joints_of_tendon(target)) if kind == kinds.mjTRN_TENDON else []
            if not any([d.drive(name) for name in found]):
                other.append(self.name("ACTUATOR", i))
        d.leave_out("actuators that drive no hinge or slide", other)
        if m.nu:
            d.notes.append("of actuators only which joints they drive is read, no gains and ranges")

    def _leave_out(self) -> None:
        m, names, d = self.model, self.names, self.description
        tied = {int(m.eq_obj1id[i]) for i in range(m.neq) if int(m.eq_type[i]) == int(self.mujoco.mjtEq.mjEQ_TENDON)}

        def joints_with(values: np.ndarray) -> list[str]:
            return list(dict.fromkeys(names("JOINT", m.dof_jntid[np.flatnonzero(values)])))

        d.leave_out("contacts of geoms", names("GEOM", np.flatnonzero(m.geom_contype | m.geom_conaffinity)))
        d.leave_out("contact pairs", names("PAIR", range(m.npair)))
        d.leave_out("meshes", names("MESH", range(m.nmesh)))
        d.leave_out("meshes and pictures that are not there", [*self.missing_meshes, *self.missing_pictures])
        d.leave_out("tendons", names("TENDON", [i for i in range(m.ntendon) if i not in tied]))
        d.leave_out("limits of joints", names("JOINT", np.flatnonzero(m.jnt_limited)))
        d.leave_out("dry friction of joints", joints_with(m.dof_frictionloss))
        d.leave_out("armature of joints", joints_with(m.dof_armature))
        steep = [] if self._is_off("SPRING") else names("JOINT", np.flatnonzero(self._higher("jnt_stiffness")))
        bent = [] if self._is_off("DAMPER") else joints_with(self._higher("dof_damping"))
        d.leave_out("what is not linear in springs and dampers of joints", list(dict.fromkeys([*steep, *bent])))
        d.leave_out("drag in a medium", [of for of in ("density", "viscosity") if getattr(m.opt, of)])
        if d.gravity:
            d.leave_out("gravity compensation of bodies", names("BODY", np.flatnonzero(m.body_gravcomp)))
        d.leave_out("sensors", names("SENSOR", range(m.nsensor)))
        d.leave_out("keyframes", names("KEY", range(m.nkey)))
        d.leave_out("flexible bodies", names("FLEX", range(m.nflex)))
        massless = [link.name for k, link in enumerate(d.links) if m.body_mass[k] > 0 and link.inertia is None]
        d.leave_out("masses, which come from meshes that are not there, of bodies", massless)

    def _higher(self, what: str) -> np.ndarray:
        """Tell of each spring or damper whether it has terms above the linear one."""
        values = np.asarray(getattr(self.model, what))
        values = getattr(self.model, f"{what}poly", values.reshape(len(values), -1)[:, 1:])  # or in one array
        return np.any(values, axis=1)

    # -- writing ------------------------------------------------------------------------------------------------

    def save(self, path: Path, tree: ImportTree, design: MovedPlaces) -> Path:
        """Put the places of a design into the description that MuJoCo has read, and write that."""
        if path.suffix.lower() != ".xml":
            raise InputError(f"{path}: an MJCF file ends in .xml")
        spec = self.spec.copy()
        spec.assets = self.spec.assets
        sites = {self.name("SITE", e.id): e for e in spec.sites}
        for k in range(1, len(tree.description.links)):
            self._join(spec, tree, design, k)
        self._close(spec, tree, design)
        for (k, name), mark in tree.marks.items():
            if name and mark in design.changed:
                sites[name].pos = _place_in(tree, design, k, mark)
        try:
            made = spec.compile()
        except ValueError as error:
            raise self.fault(f"MuJoCo refuses this design: {_one_line(error)}") from None
        for name, place, why in self._sites_wanted(tree, design):
            # of the size: the file has no more digits
            if np.linalg.norm(made.site_pos[sites[name].id] - place) > 1e-7 * tree.size:
                raise InputError(f"save(): site {name!r} {why}")
        return write(path, spec.to_xml().encode())

    def _join(self, spec: Any, tree: ImportTree, design: MovedPlaces, k: int) -> None:
        """Move the joints of a link; it stays where it is in the home pose, the file places it at ``qpos0``."""
        elements, link = {self.name("JOINT", e.id): e for e in spec.joints}, tree.description.links[k]
        anchors = {joint.name: tree.anchors[joint.name] for joint in link.joints if not joint.held}
        if not design.changed.intersection(name for a in anchors.values() for name in (a.point, a.axis)):
            return
        still = np.array_equal(self.data.qpos, self.model.qpos0)  # or the frame moves, and every joint in it
        turn, origin = link.turn, link.origin  # after the joint that is looked at, the last one first
        for joint in link.joints[::-1]:
            element, anchor = elements[joint.name], anchors.get(joint.name)
            if element.frame is not None:
                raise self.fault(f"joint {joint.name!r} stands in a <frame>; write it without, to save designs of it")
            if anchor is not None and anchor.axis and (anchor.axis in design.changed or not still):
                element.axis = turn.T @ (tree.sense(joint) * design.places[anchor.axis])
            if joint.kind == "slide":  # its place is that before it slides
                origin = origin + turn @ self._step_back(joint, element)[1]
            if anchor is not None and (anchor.point in design.changed or not still):
                at = tree.sliders.get(joint.name, anchor.point)
                element.pos = turn.T @ (design.places[at] - origin)
            if joint.kind in ("hinge", "ball"):
                back, shift = self._step_back(joint, element)
                origin, turn = origin + turn @ shift, turn @ back
        body = next(b for b in spec.bodies if b.id == k)
        if still:
            return
        if body.frame is not None:
            raise self.fault(f"body {link.name!r} stands in a <frame>; write it without, to save designs with home=")
        parent = tree.description.links[link.parent]
        quaternion = np.empty(4)
        self.mujoco.mju_mat2Quat(quaternion, np.ravel(parent.turn.T @ turn))
        body.pos, body.quat = parent.turn.T @ (origin - parent.origin), quaternion
        body.alt.type = self.mujoco.mjtOrientation.mjORIENTATION_QUAT

    def _step_back(self, joint: ElementaryJoint, element: Any) -> tuple[np.ndarray, np.ndarray]:
        """Return the turn and shift of a link, in its own frame, from after a joint at home to before it."""
        at, mujoco = int(self.model.jnt_qposadr[element.id]), self.mujoco
        quaternion, numbers = np.array(self.data.qpos[at : at + 4]), np.empty(9)
        if joint.kind != "ball":
            by, axis = self.data.qpos[at] - self.model.qpos0[at], element.axis / np.linalg.norm(element.axis)
            if joint.kind == "slide":
                return np.eye(3), -by * axis
            quaternion = np.empty(4)
            mujoco.mju_axisAngle2Quat(quaternion, axis, by)
        mujoco.mju_quat2Mat(numbers, quaternion)
        back = _matrix(numbers).T
        return back, element.pos - back @ element.pos

    def _close(self, spec: Any, tree: ImportTree, design: MovedPlaces) -> None:
        """Move the places where loops are closed, and write what MuJoCo would read off ``qpos0``.

        There the bodies of a design that is drawn in another pose are elsewhere.
        """
        model, site, eq = self.model, self.mujoco.mjtObj.mjOBJ_SITE, self.mujoco.mjtEq
        still = not design.changed or np.array_equal(self.data.qpos, model.qpos0)
        equalities, bodies, sites = ({e.id: e for e in of} for of in (spec.equalities, spec.bodies, spec.sites))
        for i, name in enumerate(self.names("EQUALITY", range(model.neq))):
            element, data = equalities[i], np.array(model.eq_data[i])
            ends = int(model.eq_obj1id[i]), max(int(model.eq_obj2id[i]), 0)
            by_sites, pins = int(model.eq_objtype[i]) == int(site), tree.pins.get(name, ())
            moved, connects = bool(design.changed.intersection(pins)), int(model.eq_type[i]) == int(eq.mjEQ_CONNECT)
            links = [int(model.site_bodyid[k]) for k in ends] if by_sites else ends
            places = [_place_in(tree, design, k, p) for k, p in zip(links, pins, strict=True)] if moved else []
            if by_sites and moved:
                for number, place in zip(ends, places, strict=True):
                    sites[number].pos = place
            elif connects and not by_sites and not still:
                names = [f"{name} {side}" for side in ("first", "second")]
                for word, k, place in zip(names, ends, places if moved else (data[0:3], data[3:6]), strict=True):
                    bodies[k].add_site(name=word, pos=place)
                element.objtype, (element.name1, element.name2) = site, names
            elif moved:
                element.data = np.concatenate([places[0], np.asarray(element.data)[3:]])
            elif int(model.eq_type[i]) == int(eq.mjEQ_WELD) and not by_sites and not still:
                element.data = data

    def _sites_wanted(self, tree: ImportTree, design: MovedPlaces) -> Iterator[tuple[str, np.ndarray, str]]:
        """List where the file must have sites, in their links, each with what is wrong where it has one elsewhere."""
        model, equalities = self.model, self.names("EQUALITY", range(self.model.neq))
        for loop in tree.description.loops:
            i, pins = equalities.index(loop.name), tree.pins.get(loop.name, ())
            by_sites = int(model.eq_objtype[i]) == int(self.mujoco.mjtObj.mjOBJ_SITE)
            for end, number in enumerate((int(model.eq_obj1id[i]), int(model.eq_obj2id[i])) if by_sites else ()):
                place = model.site_pos[number]
                if design.changed.intersection(pins):
                    place = _place_in(tree, design, (loop.first, loop.second)[end], pins[end])
                where = f"at {pins[end]!r}" if pins else "where the file has it"
                why = f"closes {loop.name!r} {where}, and this design has it elsewhere: move what is at one place alike"
                yield self.name("SITE", number), place, why
        for (k, name), mark in tree.marks.items():
            if name and mark in design.changed:
                why = "stands in a <frame>, or has fromto=: give it pos= alone, to save designs of it"
                yield name, _place_in(tree, design, k, mark), why


def _place_in(tree: ImportTree, design: MovedPlaces, k: int, name: str) -> np.ndarray:
    """Return a place of a design in the frame of a link."""
    link = tree.description.links[k]
    return link.turn.T @ (design.places[name] - link.origin)


def _read_in_pose(path: Path, qpos: np.ndarray) -> MjcfFile:
    file = MjcfFile(path)
    if file.data.qpos.shape != qpos.shape:
        raise file.fault("it has other joints than the robot that was kept; read it anew")
    file.set_home(qpos)
    return file


def _matrix(numbers: np.ndarray) -> np.ndarray:
    return np.array(numbers).reshape(3, 3)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _stand_in(name: str) -> bytes:
    """Make a small solid, or picture, in place of a file that is not there."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], dtype="<f4")
    faces = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    match Path(name).suffix.lower():
        case ".stl":
            solid = b"".join(struct.pack("<3f", 0, 0, 0) + corners[list(f)].tobytes() + b"\0\0" for f in faces)
            return b"\0" * 80 + struct.pack("<I", len(faces)) + solid
        case ".obj":
            lines = [f"v {x} {y} {z}" for x, y, z in corners] + ["f " + " ".join(str(i + 1) for i in f) for f in faces]
            return "\n".join(lines).encode()
        case ".msh":
            counts = struct.pack("<4i", len(corners), 0, 0, len(faces))
            return counts + corners.tobytes() + np.array(faces, dtype="<i4").tobytes()
    import io

    from PIL import Image

    out = io.BytesIO()
    Image.new("RGB", (6, 6)).save(out, "PNG")
    return out.getvalue()


class MjcfWriter:
    """Writes a tree of links as MJCF.

    The `driven` coordinates get a motor; `keys` are joint values of poses to be kept as keyframes, ``(K, nq)``.
    """

    def __init__(self, tree: ExportTree, driven: tuple[str, ...], keys: np.ndarray):
        self.tree, self.description = tree, tree.description
        links = tree.links
        self.root = ET.Element("mujoco", model=xml_text(self.description.name))
        sizes = {"boundmass": _LEAST, "boundinertia": _LEAST}
        add_element(self.root, "compiler", angle="radian", autolimits="true", **sizes)
        gravity = np.zeros(3)
        if (index := tree.system.topology.loads.gravity) != ():
            gravity[: tree.parts.dim] = np.asarray(tree.system.parameters.physical)[list(index)]
        add_element(self.root, "option", gravity=gravity, timestep="0.001")
        default = add_element(self.root, "default")
        thin = _THIN * tree.size
        geom = add_element(default, "geom", contype="0", conaffinity="0", size=thin, rgba="0.35 0.5 0.7 1")
        if not any(link.inertia for link in links):
            geom.set("density", xml_text(tree.density))
        add_element(default, "site", size=1.5 * thin, rgba="0.8 0.4 0.1 1")
        add_element(default, "equality", solref="0.005 1", solimp="0.99 0.999 0.0001")
        self.elements = [add_element(self.root, "worldbody")]
        self.joints: dict[str, ET.Element] = {}
        self.sites: set[str] = set()
        self._add_sites(links[0], self.elements[0])
        for link in links[1:]:
            self._add_body(link)
        self.tendons, self.equality, self.actuators = map(ET.Element, ("tendon", "equality", "actuator"))
        self._add_equalities()
        for name in driven:
            self._add_motor(name)
        self._add_loads()
        self.root.extend(section for section in (self.tendons, self.equality, self.actuators) if len(section))
        if len(keys):
            section = add_element(self.root, "keyframe")
            for k, values in enumerate(keys):
                add_element(section, "key", name=f"pose {k}", qpos=values)

    def text(self) -> str:
        """Return the file."""
        ET.indent(self.root)
        return ET.tostring(self.root, encoding="unicode") + "\n"

    def _add_body(self, link: Link) -> None:
        before = self.tree.links[link.parent]
        body = add_element(self.elements[link.parent], "body", name=link.name, pos=link.origin - before.origin)
        self.elements.append(body)
        for joint in link.joints:
            element = add_element(body, "joint", name=joint.name, type=joint.kind)
            if joint.kind in ("hinge", "slide"):
                element.set("axis", xml_text(joint.axis))
            self.joints[joint.name] = element
        if link.inertia is not None:
            self._add_inertial(link, link.inertia, body)
        lines = [(a, b) for a, b in link.lines if np.linalg.norm(b - a) > 1e-9 * self.tree.size]
        for a, b in lines:
            add_element(body, "geom", type="capsule", fromto=[*(a - link.origin), *(b - link.origin)])
        if not lines:
            add_element(body, "geom", type="sphere")
        self._add_sites(link, body)

    def _add_inertial(self, link: Link, inertia: Inertia, body: ET.Element) -> None:
        # By principal axes: MuJoCo before 3.17 finds them to seven digits only.
        values, axes = np.linalg.eigh(inertia.tensor)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        turn = {"pos": inertia.com - link.origin, "quat": quaternions(axes)}
        add_element(body, "inertial", **turn, mass=inertia.mass, diaginertia=values)
        least = float(min(values[0], inertia.mass))
        if least < float(_LEAST):
            self.description.notes.append(
                f"link {link.name!r} has a mass or inertia of {least:.3g}, and MuJoCo takes none below {_LEAST}: "
                f"it moves as if it had that; draw so small a mechanism in a smaller unit, such as mm in place of m"
            )

    def _add_sites(self, link: Link, body: ET.Element) -> None:
        for name, place in link.sites.items():
            add_element(body, "site", name=name, pos=place - link.origin)
            self.sites.add(name)

    # -- loops --------------------------------------------------------------------------------------------------

    def _add_equalities(self) -> None:
        links = self.tree.links
        for loop in self.description.loops:
            first, second = (links[k].name if k else "world" for k in (loop.first, loop.second))
            element = add_element(self.equality, loop.kind, name=loop.name, body1=first, body2=second)
            if loop.kind == "connect":
                element.set("anchor", xml_text(loop.at[0] - links[loop.first].origin))
        for tie in self.description.ties:
            joints = list(tie.terms)
            if len(joints) > 2:
                add_element(self.equality, "tendon", name=tie.name, tendon1=self._sum(tie.name, tie.terms).get("name"))
                continue
            other: dict[str, object] = {}
            if len(joints) == 2:
                factor = -tie.terms[joints[1]] / tie.terms[joints[0]]
                other = {"joint2": joints[1], "polycoef": (0.0, factor, 0.0, 0.0, 0.0)}
            add_element(self.equality, "joint", name=tie.name, joint1=joints[0], **other)
        for name, points in self.tree.cables.items():
            add_element(self.equality, "tendon", name=name, tendon1=self._string(name, points).get("name"))

    def _sum(self, name: str, terms: dict[str, float]) -> ET.Element:
        """Make a fixed tendon, whose length is a sum of joint values, if it is not there."""
        return self._tendon(
            "fixed", name, "joint", [{"joint": joint, "coef": factor} for joint, factor in terms.items()]
        )

    def _string(self, name: str, points: Iterable[str]) -> ET.Element:
        """Make a spatial tendon through sites, if it is not there."""
        return self._tendon("spatial", name, "site", [{"site": point} for point in points])

    def _tendon(self, kind: str, name: str, tag: str, pieces: list[dict]) -> ET.Element:
        tendon = next((t for t in self.tendons if t.get("name") == xml_text(name)), None)
        if tendon is None:
            tendon = add_element(self.tendons, kind, name=name)
            for piece in pieces:
                add_element(tendon, tag, **piece)
        return tendon

    # -- motors and loads ---------------------------------------------------------------------------------------

    def _add_motor(self, name: str) -> None:
        """Add a motor for a coordinate: on its joint, or on a tendon whose length it is."""
        coordinate = self.tree.coordinates.get(name)
        motor: dict[str, object] = {"name": name}
        if coordinate is None:
            point, _, axis = name.rpartition(".")
            if point not in self.sites or axis not in "xyz":
                self.description.left_out.append(f"input {name!r}: it is no sum of joints, and has no motor")
                return
            # A force on the point along an axis of the ground.
            motor |= {"site": point, "refsite": self._ground_frame(), "gear": np.eye(6)["xyz".index(axis)]}
        elif coordinate.joint:
            motor |= dict(zip(("joint", "gear"), coordinate.joint, strict=True))
        elif coordinate.ends:
            motor["tendon"] = self._string(name, coordinate.ends).get("name")
        else:
            motor["tendon"] = self._sum(name, coordinate.terms).get("name")
        add_element(self.actuators, "motor", **motor)

    def _ground_frame(self) -> str:
        """Return the name of a site of the ground whose axes are the ground's."""
        name = "ground frame"
        if name not in self.sites:
            add_element(self.elements[0], "site", name=name, size=0.1 * _THIN * self.tree.size)
            self.sites.add(name)
        return name

    def _add_loads(self) -> None:
        """Write springs, dampers and stops, for which MJCF has a place, and name the other forces."""
        left, top = self.description.left_out, self.tree.system.topology
        home, physical = np.asarray(derive(self.tree.system).home), np.asarray(self.tree.system.parameters.physical)
        for block in top.loads.forces:
            kind = _LOADS.get(block.kind)
            if kind is None:
                what = "MJCF has no forces that act by themselves; give it in ctrl or qfrc_applied"
                left += [f"{block.kind.name} {name!r}: {what}" for name in block.names]
                continue
            parameters = force_constants(top, home, block, physical)
            for k, name in enumerate(block.names):
                what = f"{block.kind.name} {name!r}"
                values = dict(zip(block.kind.parameters, map(float, parameters[k]), strict=True))
                scalar = top.coordinates[block.scalars[k][0]] if block.scalars[k] else ""
                coordinate = self.tree.coordinates.get(scalar)
                if scalar and coordinate is None:
                    left.append(f"{what}: {scalar!r} is no sum of joints")
                elif values.get("cubic") or values.get("quadratic"):
                    left.append(f"{what}: it is not linear")
                elif coordinate and coordinate.joint:
                    joint, factor = coordinate.joint
                    self._load(self.joints[joint], kind, values, coordinate.home, factor)
                elif coordinate and not coordinate.ends:
                    self._load(self._sum(f"{kind} {name}", coordinate.terms), kind, values, coordinate.home)
                else:
                    ends = coordinate.ends if coordinate else None
                    string = self._string(f"{kind} {name}", ends or [top.points[p] for p in block.points[k]])
                    self._load(string, kind, values)
        for function in top.loads.functions:
            left.append(f"force {function.name!r}: a function of time and state; give it in ctrl or qfrc_applied")

    def _load(
        self, element: ET.Element, kind: str, values: dict[str, float], home: float = 0.0, factor: float = 1.0
    ) -> None:
        """Write a load on a joint or tendon, from whose value its coordinate follows by a factor and from `home`."""
        if kind == "damper":
            before = float(element.get("damping", 0.0))
            element.set("damping", xml_text(before + values["damping"] * factor**2))
        elif kind == "stop":  # a limit says where it is; how it yields is MuJoCo's
            low, high = sorted((values[k] - home) / factor for k in ("lower", "upper"))
            far = 1e3 * max(self.tree.size, 10.0)
            element.set("range", xml_text((max(low, -far), min(high, far))))
            what = f"it is a limit of MuJoCo, with its own softness, not {values['stiffness']:g}"
            self.description.notes.append(f"stop on {element.get('name')!r}: {what}")
        elif element.get("stiffness"):
            self.description.left_out.append(f"spring on joint {element.get('name')!r}: it has one already")
        else:
            free = values["free"] - (values["preload"] / values["stiffness"] if values.get("preload") else 0.0)
            element.set("stiffness", xml_text(values["stiffness"] * factor**2))
            key = "springref" if element.tag == "joint" else "springlength"
            element.set(key, xml_text((free - home) / factor))


def add_element(parent: ET.Element, tag: str, **attributes: object) -> ET.Element:
    """Add an element to another, its attributes texts or numbers."""
    return ET.SubElement(parent, tag, {key: xml_text(value) for key, value in attributes.items()})


def xml_text(value: Any) -> str:
    """Write a text without what no XML may hold, or numbers as they are to be read back, zero without its sign."""
    if isinstance(value, str):
        return "".join(c if c.isprintable() else "_" for c in value)
    return " ".join(repr(float(x) + 0.0) for x in np.ravel(value))
