"""Reading URDF: the tree, and the tables of loops beside it (``<loop_joint>``, or ``<joint>`` in ``<gazebo>``)."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxnc.errors import ModelFileError, nearest
from jaxnc.io.robots.described import Described, FileJoint, FileLink, FileLoop, FileTie
from jaxnc.io.robots.pose import about
from jaxnc.io.robots.tree import Inertia, Vec

_KINDS = {
    "revolute": ("hinge",),
    "continuous": ("hinge",),
    "prismatic": ("slide",),
    "spherical": ("ball",),
    "ball": ("ball",),
    "floating": ("free",),
    "fixed": (),
}
_READ = {"link", "joint", "loop_joint", "gazebo", "transmission", "material"}


class UrdfFile:
    """A URDF file, parsed.

    Attributes:
        root: its top element.
        links: its links by name.
        joints: its joints by name.
    """

    def __init__(self, path: Path):
        self.path = path
        if not path.is_file():
            raise ModelFileError(f"{path}: there is no such file")
        try:
            self.root = ET.fromstring(path.read_bytes())
        except ET.ParseError as error:
            raise self.fault(f"it is no XML: {error}") from None
        if self.root.tag != "robot":
            raise self.fault(f"its top element is <{self.root.tag}>, and that of URDF is <robot>")
        if any("xacro" in element.tag for element in self.root.iter()):
            raise self.fault("it has xacro macros; expand them first (xacro robot.urdf.xacro > robot.urdf)")
        self.links, self.joints = self._by_name("link"), self._by_name("joint")
        if not self.links:
            raise self.fault("it has no links")

    def fault(self, what: str) -> ModelFileError:
        """An error that names the file."""
        return ModelFileError(f"{self.path}: {what}")

    def _by_name(self, tag: str) -> dict[str, ET.Element]:
        out: dict[str, ET.Element] = {}
        for element in self.root.findall(tag):
            name = element.get("name")
            if not name:
                raise self.fault(f"a <{tag}> has no name")
            if name in out:
                raise self.fault(f"there are two {tag}s {name!r}")
            out[name] = element
        return out

    def numbers(self, element: ET.Element | None, key: str, default: Sequence[float], what: str) -> np.ndarray:
        """Numbers of an attribute."""
        text = None if element is None else element.get(key)
        if text is None:
            return np.array(default, dtype=float)
        try:
            values = np.array([float(x) for x in text.split()])
        except ValueError:
            values = np.zeros(0)
        if len(values) != len(default) or not np.all(np.isfinite(values)):
            raise self.fault(f"{what}: {key}={text!r} should be {len(default)} finite numbers")
        return values

    def pose(self, element: ET.Element | None, what: str) -> tuple[Vec, np.ndarray]:
        """Place and axes of an ``<origin>`` (or anything with xyz and rpy)."""
        roll, pitch, yaw = self.numbers(element, "rpy", (0, 0, 0), what)
        turn = about(np.eye(3)[2], yaw) @ about(np.eye(3)[1], pitch) @ about(np.eye(3)[0], roll)
        return self.numbers(element, "xyz", (0, 0, 0), what), turn

    def end(self, joint: ET.Element, tag: str, what: str) -> str:
        """The link at one end of a joint, which must be there."""
        element = joint.find(tag)
        name = None if element is None else element.get("link") or (element.text or "").strip()
        if not name or name not in self.links:
            raise self.fault(f"{what}: its {tag} is {name!r}, which is no link; {nearest(name or '', self.links)}")
        return name


def read_urdf(file: UrdfFile, without: Sequence[str] = (), hold: Sequence[str] = ()) -> Described:
    """What a URDF file describes; its home pose is that of all joints at zero."""
    return UrdfReader(file, set(without), set(hold)).described


class UrdfReader:
    """Reads a parsed file."""

    def __init__(self, file: UrdfFile, without: set[str], hold: set[str]):
        self.file, self.without, self.hold = file, without, hold
        self.described = Described(file.root.get("name") or file.path.stem, [])
        self.number: dict[str, int] = {}
        if unknown := hold - set(file.links):
            raise file.fault(f"hold={sorted(unknown)}: there is no such link")
        self._tree()
        if not any(not j.held for j in self.described.joints.values()):
            raise file.fault("it has no joints that could move")
        self._loops()
        self._ties()
        self._rest()

    def _tree(self) -> None:
        f, above = self.file, {}
        for name, joint in f.joints.items():
            what = f"joint {name!r}"
            parent, child = f.end(joint, "parent", what), f.end(joint, "child", what)
            if child in above:
                raise f.fault(f"link {child!r} is the child of two joints, {above[child][0]!r} and {name!r}: URDF is a "
                              f"tree; write one of them as <loop_joint>")  # fmt: skip
            above[child] = (name, parent)
        roots = [name for name in f.links if name not in above]
        if len(roots) != 1:
            raise f.fault(f"there must be one link that is no joint's child, and there are {roots or 'none'}")
        below: dict[str, list[str]] = {}
        for child, (_, parent) in above.items():
            below.setdefault(parent, []).append(child)
        ground = FileLink(roots[0], -1, np.zeros(3), np.eye(3))
        self.described.links.append(ground)
        self.number[roots[0]] = 0
        waiting = below.get(roots[0], [])[::-1]
        while waiting:
            child = waiting.pop()
            name, parent = above[child]
            self._link(child, name, self.number[parent])
            waiting += below.get(child, [])[::-1]
        if len(self.number) < len(f.links):
            lost = sorted(set(f.links) - set(self.number))
            raise f.fault(f"links {', '.join(lost)} hang on each other in a circle, and on nothing else")

    def _link(self, child: str, name: str, parent: int) -> None:
        f, before, what = self.file, self.described.links[parent], f"joint {name!r}"
        joint = f.joints[name]
        place, turn = f.pose(joint.find("origin"), what)
        link = FileLink(child, parent, before.origin + before.turn @ place, before.turn @ turn)
        kind = joint.get("type", "")
        axis = link.turn @ f.numbers(joint.find("axis"), "xyz", (1, 0, 0), what)
        if kind == "planar":
            u = axis / np.linalg.norm(axis)
            one = np.cross(u, np.eye(3)[np.argmin(np.abs(u))])
            kinds = [("slide", one), ("slide", np.cross(u, one)), ("hinge", u)]
        elif kind in _KINDS:
            kinds = [(k, axis) for k in _KINDS[kind]]
        else:
            raise f.fault(f"{what}: type={kind!r}; {nearest(kind, [*_KINDS, 'planar'])}")
        if any(k in ("hinge", "slide") for k, _ in kinds) and not np.linalg.norm(axis) > 0:
            raise f.fault(f"{what}: its axis is zero")
        for i, (k, direction) in enumerate(kinds):
            own = FileJoint(name if len(kinds) == 1 else f"{name} {i + 1}", k, link.origin, direction)
            own.damping = float(f.numbers(joint.find("dynamics"), "damping", (0,), what)[0])
            if k == "free" or child in self.hold:
                own.held = {"free": (*link.origin, 1.0, 0.0, 0.0, 0.0), "ball": (1.0, 0.0, 0.0, 0.0)}.get(k, (0.0,))
                self.described.notes.append(f"joint of link {child!r}: it is held where the file has it")
            link.joints.append(own)
        link.inertia = self._inertia(child, link)
        self.number[child] = len(self.described.links)
        self.described.links.append(link)

    def _inertia(self, name: str, link: FileLink) -> Inertia | None:
        f, what = self.file, f"link {name!r}: inertial"
        element = f.links[name].find("inertial")
        if element is None:
            return None
        mass = float(f.numbers(element.find("mass"), "value", (0,), what)[0])
        if mass < 0:
            raise f.fault(f"{what}: mass value='{mass:g}' should not be negative")
        if mass == 0:
            return None
        place, turn = f.pose(element.find("origin"), what)
        keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        xx, yy, zz, xy, xz, yz = (float(f.numbers(element.find("inertia"), k, (0,), what)[0]) for k in keys)
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        axes = link.turn @ turn
        return Inertia(mass, link.origin + link.turn @ place, axes @ tensor @ axes.T)

    # -- loops --------------------------------------------------------------------------------------------------

    def _loops(self) -> None:
        f, seen = self.file, set()
        for element in f.root.findall("loop_joint"):
            name = element.get("name") or f"loop {len(seen) + 1}"
            what = f"loop joint {name!r}"
            ends = [e for e in element if e.tag in ("link1", "link2")]
            if len(ends) != 2:
                raise f.fault(f"{what}: it needs two ends, <link1> and <link2>")
            places = []
            for end in ends:
                if end.get("link") not in self.number:
                    raise f.fault(f"{what}: {end.get('link')!r} is no link; {nearest(end.get('link') or '', f.links)}")
                place, turn = f.pose(end, what)
                places.append((self.number[str(end.get("link"))], place, turn))
            axis = f.numbers(element.find("axis"), "xyz", (1, 0, 0), what)
            self._loop(name, element.get("type", ""), places, axis)
            seen.add(name)
        for element in f.root.findall("gazebo/joint"):
            name = element.get("name") or f"loop {len(seen) + 1}"
            if name in seen:
                continue
            what = f"gazebo joint {name!r}"
            one, other = (self.number[f.end(element, tag, what)] for tag in ("parent", "child"))
            pose = element.find("pose")
            try:
                text = (pose.text if pose is not None else None) or "0 0 0 0 0 0"
                values = [float(x) for x in text.split()]
            except ValueError:
                values = []
            if len(values) != 6 or not np.all(np.isfinite(values)):
                raise f.fault(f"{what}: its pose should be six finite numbers")
            words = [str(x) for x in values]
            place, turn = f.pose(ET.Element("origin", xyz=" ".join(words[:3]), rpy=" ".join(words[3:])), what)
            a, b = self.described.links[one], self.described.links[other]
            at = b.origin + b.turn @ place  # its pose is that on the child; the parent has it there at home
            local = (one, a.turn.T @ (at - a.origin), a.turn.T @ b.turn @ turn)
            axis = f.numbers(None, "", (1, 0, 0), what)
            if (found := element.find("axis/xyz")) is not None:
                axis = np.array([float(x) for x in (found.text or "").split()])
            self._loop(name, element.get("type", ""), [local, (other, place, turn)], axis)
            seen.add(name)
        if unknown := self.without - seen:
            raise f.fault(f"without={sorted(unknown)}: no such loop joint; there are {', '.join(seen) or 'none'}")

    def _loop(self, name: str, kind: str, ends: list[tuple[int, Vec, np.ndarray]], axis: Vec) -> None:
        d = self.described
        if name in self.without:
            d.left_out.append(f"loop joint {name!r}: as asked")
            return
        (one, p, turn), (other, q, turn2) = ends
        a, b = d.links[one], d.links[other]
        at = a.origin + a.turn @ p, b.origin + b.turn @ q
        if kind in ("spherical", "ball"):
            d.loops.append(FileLoop(name, "connect", one, other, at))
        elif kind in ("revolute", "continuous"):
            size = 0.1 * (float(np.linalg.norm(np.ptp([x.origin for x in d.links], axis=0))) or 1.0)
            u = axis / np.linalg.norm(axis)
            d.loops.append(FileLoop(name, "connect", one, other, at))
            far = at[0] + size * a.turn @ turn @ u, at[1] + size * b.turn @ turn2 @ u
            d.loops.append(FileLoop(f"{name} axis", "connect", one, other, far))
        elif kind == "fixed":
            apart = np.linalg.norm(at[0] - at[1]) + np.linalg.norm(a.turn @ turn - b.turn @ turn2)
            if apart > 1e-6:
                raise self.file.fault(f"loop joint {name!r}: it fixes two links other than they are at home; "
                                      f"without={[name]!r} leaves it out")  # fmt: skip
            d.loops.append(FileLoop(name, "weld", one, other, at))
        else:
            known = ("spherical", "revolute", "fixed")
            raise self.file.fault(f"loop joint {name!r}: type={kind!r}; {nearest(kind, known)}")

    # -- the rest -----------------------------------------------------------------------------------------------

    def _ties(self) -> None:
        f, joints = self.file, self.described.joints
        for name, joint in f.joints.items():
            mimic = joint.find("mimic")
            if mimic is None:
                continue
            what, other = f"mimic of joint {name!r}", mimic.get("joint") or ""
            for n in (name, other):
                if n not in joints or joints[n].kind not in ("hinge", "slide"):
                    raise f.fault(f"{what}: {n!r} is no hinge or slide; {nearest(n, joints)}")
            if other == name:
                raise f.fault(f"{what}: it follows itself; name another joint")
            factor = float(f.numbers(mimic, "multiplier", (1,), what)[0])
            offset = float(f.numbers(mimic, "offset", (0,), what)[0])
            second = other if factor else None
            self.described.ties.append(FileTie(f"mimic {name}", name, second, (offset, factor)))
            if offset:
                self.described.notes.append(f"{what}: its offset moves the joint away from home")

    def _rest(self) -> None:
        f, d = self.file, self.described
        for element in f.root.findall("transmission/joint"):
            name = element.get("name") or ""
            if name not in d.joints:
                raise f.fault(f"transmission of {name!r}: there is no such joint; {nearest(name, d.joints)}")
            if d.joints[name].kind in ("hinge", "slide") and not d.joints[name].held and name not in d.actuated:
                d.actuated.append(name)

        def has(joint: ET.Element, tag: str, key: str = "") -> bool:
            element = joint.find(tag)
            what = f"joint {joint.get('name')!r}"
            return element is not None and (not key or bool(f.numbers(element, key, (0,), what)[0]))

        limited = [n for n, j in f.joints.items() if j.get("type") == "revolute" or has(j, "safety_controller")]
        self._lost("limits of joints", limited)
        self._lost("dry friction of joints", [n for n, j in f.joints.items() if has(j, "dynamics", "friction")])
        self._lost("pictures of links", [n for n, x in f.links.items() if x.find("visual") is not None])
        self._lost("contacts of links", [n for n, x in f.links.items() if x.find("collision") is not None])
        unknown = dict.fromkeys(x.tag for x in f.root if isinstance(x.tag, str) and x.tag not in _READ)
        unknown |= {f"gazebo/{x.tag}": None for g in f.root.findall("gazebo") for x in g if x.tag != "joint"}
        self._lost("elements", [f"<{tag}>" for tag in unknown])

    def _lost(self, what: str, names: Sequence[str]) -> None:
        if names:
            shown = ", ".join(names[:8]) + (f", … ({len(names)} in all)" if len(names) > 8 else "")
            self.described.left_out.append(f"{what}: {shown}")


def redrawn(file: UrdfFile, described: Described, places: Mapping[tuple[str, str], Any]) -> ET.Element:
    """The file's elements with other dimensions."""
    root = ET.fromstring(ET.tostring(file.root))
    number = {link.name: k for k, link in enumerate(described.links)}
    moved = {link.name: places.get(("link", link.name), link.origin) for link in described.links}

    def write(element: ET.Element, key: str, values: Any) -> None:
        element.set(key, " ".join(repr(float(x) + 0.0) for x in values))

    for joint in root.findall("joint"):
        parent, child = (str(joint.find(tag).get("link")) for tag in ("parent", "child"))  # pyright: ignore[reportOptionalMemberAccess]
        before, link = described.links[number[parent]], described.links[number[child]]
        if not np.array_equal(moved[parent], before.origin) or not np.array_equal(moved[child], link.origin):
            origin = joint.find("origin")
            origin = ET.SubElement(joint, "origin") if origin is None else origin
            write(origin, "xyz", before.turn.T @ (moved[child] - moved[parent]))
        if (axis := places.get(("axis", str(joint.get("name"))))) is not None:
            element = joint.find("axis")
            write(ET.SubElement(joint, "axis") if element is None else element, "xyz", link.turn.T @ axis)
    for element in root.findall("link"):
        link = described.links[number[str(element.get("name"))]]
        shift = link.turn.T @ (link.origin - moved[link.name])
        for part in (*element.findall("inertial"), *element.findall("visual"), *element.findall("collision")):
            if np.any(shift):
                origin = part.find("origin")
                if origin is None:
                    origin = ET.Element("origin")
                    part.insert(0, origin)
                write(origin, "xyz", file.numbers(origin, "xyz", (0, 0, 0), "origin") + shift)
    for loop in described.loops:
        for element in root.findall("loop_joint"):
            if element.get("name") != loop.name:
                continue
            ends = [e for e in element if e.tag in ("link1", "link2")]
            now = places.get(("loop", loop.name), loop.at)
            for end, at, k in zip(ends, now, (loop.first, loop.second), strict=True):
                link = described.links[k]
                write(end, "xyz", link.turn.T @ (at - moved[link.name]))
        for element in root.findall("gazebo/joint"):
            pose = element.find("pose")
            if element.get("name") == loop.name:
                pose = ET.SubElement(element, "pose") if pose is None else pose
                link, old = described.links[loop.second], ((pose.text or "") + " 0 0 0 0 0 0").split()[3:6]
                at = places.get(("loop", loop.name), loop.at)[1]
                local = link.turn.T @ (at - moved[link.name])
                pose.text = " ".join([*(repr(float(x) + 0.0) for x in local), *old])
    return root
