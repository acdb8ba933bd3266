"""Reading MJCF through MuJoCo's own reader, which knows its defaults, includes, frames, units and orientations."""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxnc.errors import JaxncError, ModelFileError
from jaxnc.io.robots.described import Described, FileJoint, FileLink, FileLoop, FileTie
from jaxnc.io.robots.tree import Inertia, Tie

_CLOSED = 1e-6  # of the robot's size: how far a weld may be from closed at home
_KINDS = ("free", "ball", "slide", "hinge")


def engine() -> Any:
    """MuJoCo, or an error that says where it comes from."""
    try:
        import mujoco
    except ImportError:
        raise JaxncError('reading MJCF needs MuJoCo\'s own reader: pip install "jaxnc[mujoco]"') from None
    return mujoco


class MjcfFile:
    """An MJCF file, parsed and compiled."""

    def __init__(self, path: Path):
        self.path, self.mujoco = path, engine()
        if not path.is_file():
            raise ModelFileError(f"{path}: there is no such file")
        try:
            # MuJoCo's description of it, which can be changed and written.
            self.spec = self.mujoco.MjSpec.from_file(str(path))
        except (ValueError, OSError) as error:
            raise ModelFileError(f"{path}: MuJoCo does not read it: {_line(error)}") from None
        self.missing: list[str] = []
        self.model = self._compiled()
        self.data = self.mujoco.MjData(self.model)  # its home pose, as the file has its joints
        self.put(self.model.qpos0)

    def put(self, qpos: Any) -> None:
        """Make a pose the home pose."""
        self.data.qpos[:] = qpos
        self.mujoco.mj_kinematics(self.model, self.data)

    def _compiled(self) -> Any:
        """The compiled model; pictures and meshes that are not there are replaced, since only their names are kept."""
        self._replace()
        try:
            return self.spec.compile()
        except ValueError as error:
            raise ModelFileError(f"{self.path}: MuJoCo does not compile it: {_line(error)}") from None

    def _replace(self) -> None:
        folder, assets = self.path.parent, dict(self.spec.assets)
        for items, where in (
            (self.spec.meshes, self.spec.meshdir),
            (self.spec.textures, self.spec.texturedir),
            (self.spec.hfields, self.spec.meshdir),
        ):
            for item in items:
                if item.file and not (folder / where / item.file).is_file() and item.file not in assets:
                    self.missing.append(item.name or item.file)
                    key = f"{where.rstrip('/')}/{item.file}" if where else item.file
                    assets[key] = _stand_in(item.file)
        if self.missing:
            self.spec.assets = assets

    def name(self, kind: str, number: int) -> str:
        """A name, or one made of a number where there is none."""
        return self.mujoco.mj_id2name(self.model, getattr(self.mujoco.mjtObj, f"mjOBJ_{kind}"), number) or (
            f"{kind.lower()} {number}"
        )

    def elements(self, kind: str) -> dict[int, Any]:
        """Elements of the description by their number in the model."""
        return {e.id: e for e in getattr(self.spec, kind)}


def _line(error: Exception) -> str:
    return " ".join(str(error).split())


def _stand_in(name: str) -> bytes:
    """A small solid, or picture, in place of a file that is not there."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], dtype="<f4")
    faces = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    match Path(name).suffix.lower():
        case ".stl":
            solid = b"".join(struct.pack("<3f", 0, 0, 0) + corners[list(f)].tobytes() + b"\0\0" for f in faces)
            return b"\0" * 80 + struct.pack("<I", len(faces)) + solid
        case ".obj":
            lines = [f"v {x} {y} {z}" for x, y, z in corners] + ["f " + " ".join(str(i + 1) for i in f) for f in faces]
            return "\n".join(lines).encode()
    import io

    from PIL import Image

    out = io.BytesIO()
    Image.new("RGB", (6, 6)).save(out, "PNG")
    return out.getvalue()


def read_mjcf(file: MjcfFile, without: Sequence[str] = (), hold: Sequence[str] = ()) -> Described:
    """What an MJCF file describes, in the pose that it was put in."""
    return Reader(file, tuple(without), tuple(hold)).described


class Reader:
    """Reads a compiled model."""

    def __init__(self, file: MjcfFile, without: tuple[str, ...], hold: tuple[str, ...]):
        self.file, self.model, self.data, self.mujoco = file, file.model, file.data, file.mujoco
        self.without, self.hold = set(without), set(hold)
        gravity = tuple(float(g) for g in self.model.opt.gravity)
        self.described = Described(file.spec.modelname or file.path.stem, [], gravity=gravity if any(gravity) else None)
        for k in range(self.model.nbody):
            self.described.links.append(self._link(k))
        if unknown := self.hold - {link.name for link in self.described.links}:
            raise ModelFileError(f"{file.path}: hold={sorted(unknown)}: there is no such body")
        if not any(not j.held for j in self.described.joints.values()):
            raise ModelFileError(f"{file.path}: it has no joints that could move, only what stands still or floats")
        self.size = max(float(np.linalg.norm(np.ptp(self.data.xpos, axis=0))), 1e-9)
        known = {file.name("EQUALITY", i) for i in range(self.model.neq)}
        if self.without - known:
            raise ModelFileError(
                f"{file.path}: without={sorted(self.without - known)}: there is no such equality constraint; there are "
                f"{', '.join(sorted(known)) or 'none'}"
            )
        for i in range(self.model.neq):
            self._equality(i)
        self._motors()
        self._rest()

    def _link(self, k: int) -> FileLink:
        m, d = self.model, self.data
        link = FileLink(self.file.name("BODY", k), int(m.body_parentid[k]) if k else -1, np.array(d.xpos[k]),
                        np.array(d.xmat[k]).reshape(3, 3))  # fmt: skip
        for j in range(m.body_jntadr[k], m.body_jntadr[k] + m.body_jntnum[k]):
            dof, q = m.jnt_dofadr[j], m.jnt_qposadr[j]
            kind = _KINDS[m.jnt_type[j]]
            joint = FileJoint(self.file.name("JOINT", j), kind, np.array(d.xanchor[j]), np.array(d.xaxis[j]))
            stiffness = np.ravel(m.jnt_stiffness[j])
            joint.stiffness, joint.damping = float(stiffness[0]), float(np.ravel(m.dof_damping[dof])[0])
            if kind in ("hinge", "slide"):
                joint.reference, joint.rest = float(d.qpos[q]), float(m.qpos_spring[q])
            elif kind == "ball":
                joint.turned = tuple(map(float, d.qpos[q : q + 4]))
            if kind == "free" or link.name in self.hold:
                joint.held = tuple(map(float, d.qpos[q : q + joint.width]))
                said = "floating body" if kind == "free" else "joint of body"
                self.described.notes.append(f"{said} {link.name!r}: it is held where the file has it")
            link.joints.append(joint)
        for s in np.flatnonzero(m.site_bodyid == k):
            link.sites[self.file.name("SITE", int(s))] = np.array(d.site_xpos[s])
        if m.body_mass[k] > 0 and not (self.file.missing and self._guessed(k)):
            axes = np.array(d.ximat[k]).reshape(3, 3)
            tensor = axes @ np.diag(m.body_inertia[k]) @ axes.T
            link.inertia = Inertia(float(m.body_mass[k]), np.array(d.xipos[k]), tensor)
        return link

    def _guessed(self, k: int) -> bool:
        """Whether a body's mass comes from geoms, of which some are not there."""
        body = self.file.elements("bodies").get(k)
        return body is not None and not body.explicitinertial

    # -- loops --------------------------------------------------------------------------------------------------

    def _equality(self, i: int) -> None:
        m, d, eq = self.model, self.data, self.mujoco.mjtEq
        name, kind, data = self.file.name("EQUALITY", i), eq(int(m.eq_type[i])), np.array(m.eq_data[i])
        if name in self.without or not m.eq_active0[i]:
            self.described.left_out.append(f"equality {name!r}: {'as asked' if name in self.without else 'not active'}")
            return
        one, other = int(m.eq_obj1id[i]), int(m.eq_obj2id[i])
        if kind in (eq.mjEQ_CONNECT, eq.mjEQ_WELD):
            if int(m.eq_objtype[i]) == int(self.mujoco.mjtObj.mjOBJ_SITE):
                first, second = int(m.site_bodyid[one]), int(m.site_bodyid[other])
                at = np.array(d.site_xpos[one]), np.array(d.site_xpos[other])
                turns = (np.array(d.site_xmat[s]).reshape(3, 3) for s in (one, other))
                twist = np.linalg.norm(np.subtract(*turns))
            else:
                first, second = one, max(other, 0)
                a, b = (np.array(d.xmat[k]).reshape(3, 3) for k in (first, second))
                if kind == eq.mjEQ_CONNECT:
                    at, twist = (d.xpos[first] + a @ data[0:3], d.xpos[second] + b @ data[3:6]), 0.0
                else:
                    turn = np.zeros(9)
                    self.mujoco.mju_quat2Mat(turn, data[6:10])
                    at = d.xpos[first] + a @ data[3:6], d.xpos[second] + b @ data[0:3]
                    twist = np.linalg.norm(a @ turn.reshape(3, 3) - b)
            if kind == eq.mjEQ_CONNECT:
                self.described.loops.append(FileLoop(name, "connect", first, second, at))
                return
            if max(np.linalg.norm(at[0] - at[1]), twist * self.size) <= _CLOSED * self.size:
                self.described.loops.append(FileLoop(name, "weld", first, second, at))
                return
            raise self._cannot(name, "it welds two bodies other than they are at home")
        if kind == eq.mjEQ_JOINT:
            names = [self.file.name("JOINT", j) for j in (one, other) if j >= 0]
            joints = [self.described.joints[n] for n in names]
            if any(j.kind not in ("hinge", "slide") or j.held for j in joints):
                raise self._cannot(name, "it ties joints that are no hinges or slides, or are held")
            away = [float(j.reference - m.qpos0[m.jnt_qposadr[k]]) for j, k in zip(joints, (one, other), strict=False)]
            factors = np.poly1d(data[4::-1])
            if len(names) > 1:  # counted from home, which need not be where the file counts from
                factors = factors(np.poly1d([1.0, away[1]]))
            factors = np.pad(factors.c[::-1], (0, 5))[:5] - [away[0], 0, 0, 0, 0]
            factors[0] *= abs(factors[0]) > _CLOSED
            second = names[1] if len(names) > 1 else None
            self.described.ties.append(FileTie(name, names[0], second, tuple(map(float, factors))))
            return
        if kind == eq.mjEQ_TENDON and other < 0 and not data[0] and (terms := self._sum(one)):
            self.described.sums.append(Tie(name, terms))
            return
        raise self._cannot(name, f"it is of a kind ({kind.name}) that has no equation here")

    def _cannot(self, name: str, why: str) -> ModelFileError:
        return ModelFileError(
            f"{self.file.path}: equality {name!r}: {why}; without={[name]!r} reads another robot, without it"
        )

    def _sum(self, tendon: int) -> dict[str, float]:
        """A fixed tendon as factors of joints; empty for one through sites."""
        m, out = self.model, {}
        first = int(m.tendon_adr[tendon])
        for w in range(first, first + int(m.tendon_num[tendon])):
            if int(m.wrap_type[w]) != int(self.mujoco.mjtWrap.mjWRAP_JOINT):
                return {}
            out[self.file.name("JOINT", int(m.wrap_objid[w]))] = float(m.wrap_prm[w])
        return out

    # -- the rest -----------------------------------------------------------------------------------------------

    def _motors(self) -> None:
        m, kinds, d = self.model, self.mujoco.mjtTrn, self.described
        other = []
        for i in range(m.nu):
            target, kind = int(m.actuator_trnid[i][0]), kinds(int(m.actuator_trntype[i]))
            if kind in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT):
                found = [self.file.name("JOINT", target)]
            else:
                found = list(self._sum(target)) if kind == kinds.mjTRN_TENDON else []
            found = [j for j in found if d.joints[j].kind in ("hinge", "slide") and not d.joints[j].held]
            d.actuated += [j for j in found if j not in d.actuated]
            if not found:
                other.append(self.file.name("ACTUATOR", i))
        self._lost("actuators that drive no hinge or slide", other)
        if m.nu:
            d.notes.append("of actuators only which joints they drive is read, no gains and ranges")

    def _rest(self) -> None:
        m, name = self.model, self.file.name
        touching = [name("GEOM", i) for i in range(m.ngeom) if m.geom_contype[i] or m.geom_conaffinity[i]]
        self._lost("contacts of geoms", touching)
        self._lost("contact pairs", [name("PAIR", i) for i in range(m.npair)])
        self._lost("meshes", [name("MESH", i) for i in range(m.nmesh)])
        self._lost("meshes and pictures that are not there", self.file.missing)
        used = {int(m.eq_obj1id[i]) for i in range(m.neq) if int(m.eq_type[i]) == int(self.mujoco.mjtEq.mjEQ_TENDON)}
        self._lost("tendons", [name("TENDON", i) for i in range(m.ntendon) if i not in used])
        joints = range(m.njnt)
        self._lost("limits of joints", [name("JOINT", j) for j in joints if m.jnt_limited[j]])
        dofs = [name("JOINT", int(m.dof_jntid[i])) for i in range(m.nv) if m.dof_frictionloss[i]]
        self._lost("dry friction of joints", list(dict.fromkeys(dofs)))
        dofs = [name("JOINT", int(m.dof_jntid[i])) for i in range(m.nv) if m.dof_armature[i]]
        self._lost("armature of joints", list(dict.fromkeys(dofs)))
        self._lost("sensors", [name("SENSOR", i) for i in range(m.nsensor)])
        self._lost("keyframes", [name("KEY", i) for i in range(m.nkey)])
        self._lost("flexible bodies", [name("FLEX", i) for i in range(m.nflex)])
        if self.file.missing:
            without = [link.name for k, link in enumerate(self.described.links) if k and link.inertia is None]
            self._lost("masses, which come from meshes that are not there, of bodies", without)

    def _lost(self, what: str, names: Sequence[str]) -> None:
        if names:
            shown = ", ".join(names[:8]) + (f", … ({len(names)} in all)" if len(names) > 8 else "")
            self.described.left_out.append(f"{what}: {shown}")
