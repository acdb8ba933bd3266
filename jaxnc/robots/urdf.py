"""URDF: the tree, and the tables of loops beside it (``<loop_joint>``, or ``<joint>`` in ``<gazebo>``)."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from jaxnc.errors import InputError, ModelFileError, nearest
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
    Vec,
    free_name,
    perpendicular,
    rotate_about,
)
from jaxnc.robots.mjcf import add_element, xml_text

_KINDS = {
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "slide",
    "spherical": "ball",
    "ball": "ball",
    "floating": "free",
    "fixed": "",
    "planar": "",
}
_READ = {"link", "joint", "loop_joint", "gazebo", "transmission", "material"}
_TYPES = {"hinge": "continuous", "slide": "prismatic", "free": "floating"}
_WORLD = "world"


class UrdfFile:
    """A URDF file, parsed.

    Attributes:
        root: its top element.
        links: its links by name.
        joints: its joints by name.
        description: what was read last.
    """

    description: Description

    def __init__(self, path: Path):
        self.path = path
        if not path.is_file():
            raise self.fault("there is no such file")
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
        """Make an error that names the file."""
        return ModelFileError(f"{self.path}: {what}")

    def __reduce__(self) -> tuple:
        """Return what reads the file again."""
        return UrdfFile, (self.path.resolve(),)

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

    def _numbers(self, element: ET.Element | None, key: str, default: Sequence[float], what: str) -> np.ndarray:
        """Read the numbers of an attribute."""
        return self._parse_numbers(None if element is None else element.get(key), default, f"{what}: {key}")

    def _parse_numbers(self, text: str | None, default: Sequence[float], what: str) -> np.ndarray:
        """Read the numbers of a text, as many as there are by default."""
        if text is None:
            return np.array(default, dtype=float)
        try:
            values = np.array([float(x) for x in text.split()])
        except ValueError:
            values = np.zeros(0)
        if len(values) != len(default) or not np.all(np.isfinite(values)):
            raise self.fault(f"{what}={text!r} should be {len(default)} finite numbers")
        return values

    def _number(self, element: ET.Element | None, key: str, default: float, what: str) -> float:
        return float(self._numbers(element, key, (default,), what)[0])

    def _pose(self, element: ET.Element | None, what: str) -> tuple[Vec, np.ndarray]:
        """Read place and axes of an ``<origin>`` (or anything with xyz and rpy)."""
        place, rpy = (self._numbers(element, key, (0, 0, 0), what) for key in ("xyz", "rpy"))
        return place, _rotation_of_rpy(rpy)

    def _end(self, joint: ET.Element, tag: str, what: str) -> str:
        """Find the link at one end of a joint, which must be there."""
        element = joint.find(tag)
        name = None if element is None else element.get("link") or (element.text or "").strip()
        if not name or name not in self.links:
            raise self.fault(f"{what}: its {tag} is {name!r}, which is no link; {nearest(name or '', self.links)}")
        return name

    # -- reading ------------------------------------------------------------------------------------------------

    def read(self, without: Sequence[str] = (), hold: Sequence[str] = ()) -> Description:
        """Describe the robot with all joints at zero, `without` some loop joints, with joints of some links held."""
        self.description = d = Description(self.root.get("name") or self.path.stem)
        self._number_of: dict[str, int] = {}
        if unknown := set(hold) - set(self.links):
            raise self.fault(f"hold={sorted(unknown)}: there is no such link")
        self._tree(hold)
        if all(j.held for j in d.joints.values()):
            raise self.fault("it has no joints that could move")
        self._loops(without)
        self._mimics()
        self._motors()
        self._leave_out()
        return d

    def _tree(self, hold: Sequence[str]) -> None:
        above: dict[str, tuple[str, str]] = {}
        for name, joint in self.joints.items():
            what = f"joint {name!r}"
            parent, child = self._end(joint, "parent", what), self._end(joint, "child", what)
            if child in above:
                raise self.fault(f"link {child!r} is the child of two joints, {above[child][0]!r} and {name!r}: URDF "
                                 f"is a tree; write one of them as <loop_joint>")  # fmt: skip
            above[child] = (name, parent)
        roots = [name for name in self.links if name not in above]
        if len(roots) != 1:
            raise self.fault(f"there must be one link that is no joint's child, and there are {roots or 'none'}")
        below: dict[str, list[str]] = {}
        for child, (_, parent) in above.items():
            below.setdefault(parent, []).append(child)
        self._add(Link(roots[0], -1, np.zeros(3)))
        waiting = below.get(roots[0], [])[::-1]
        while waiting:
            child = waiting.pop()
            name, parent = above[child]
            self._add(self._link(child, name, self._number_of[parent], child in hold))
            waiting += below.get(child, [])[::-1]
        if lost := sorted(set(self.links) - set(self._number_of)):
            raise self.fault(f"links {', '.join(lost)} hang on each other in a circle, and on nothing else")

    def _add(self, link: Link) -> None:
        self._number_of[link.name] = len(self.description.links)
        self.description.links.append(link)

    def _link(self, child: str, name: str, parent: int, held: bool) -> Link:
        before, what = self.description.links[parent], f"joint {name!r}"
        joint = self.joints[name]
        place, turn = self._pose(joint.find("origin"), what)
        link = Link(child, parent, before.origin + before.turn @ place, before.turn @ turn)
        kind = joint.get("type", "")
        if kind not in _KINDS:
            raise self.fault(f"{what}: type={kind!r}; {nearest(kind, _KINDS)}")
        axis = link.turn @ self._numbers(joint.find("axis"), "xyz", (1, 0, 0), what)
        if kind in ("revolute", "continuous", "prismatic", "planar") and not np.linalg.norm(axis) > 0:
            raise self.fault(f"{what}: its axis is zero")
        kinds = [(_KINDS[kind], axis)] if _KINDS[kind] else []
        if kind == "planar":
            u = axis / np.linalg.norm(axis)
            one = perpendicular(u)
            kinds = [("slide", one), ("slide", np.cross(u, one)), ("hinge", u)]
        names = [name] if len(kinds) == 1 else [free_name(f"{name} {i + 1}", self.joints) for i in range(len(kinds))]
        for i, (k, direction) in enumerate(kinds):
            own = ElementaryJoint(names[i], k, direction, link.origin)
            own.damping = self._number(joint.find("dynamics"), "damping", 0, what)
            if k == "free" or held:
                own.held = {"free": (*link.origin, 1.0, 0.0, 0.0, 0.0), "ball": (1.0, 0.0, 0.0, 0.0)}.get(k, (0.0,))
                self.description.notes.append(f"joint of link {child!r}: it is held where the file has it")
            link.joints.append(own)
        link.inertia = self._inertia(link)
        return link

    def _inertia(self, link: Link) -> Inertia | None:
        what = f"link {link.name!r}: inertial"
        element = self.links[link.name].find("inertial")
        if element is None:
            return None
        mass = self._number(element.find("mass"), "value", 0, what)
        if mass < 0:
            raise self.fault(f"{what}: mass value='{mass:g}' should not be negative")
        if mass == 0:
            return None
        place, turn = self._pose(element.find("origin"), what)
        keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        xx, yy, zz, xy, xz, yz = (self._number(element.find("inertia"), k, 0, what) for k in keys)
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        axes = link.turn @ turn
        return Inertia(mass, link.origin + link.turn @ place, axes @ tensor @ axes.T)

    # -- loops --------------------------------------------------------------------------------------------------

    def _loops(self, without: Sequence[str]) -> None:
        seen: list[str] = []
        for element in (*self.root.findall("loop_joint"), *self.root.findall("gazebo/joint")):
            name = element.get("name") or f"loop {len(seen) + 1}"
            if element.tag == "loop_joint":
                ends, axis = self._loop_joint(element, f"loop joint {name!r}")
            elif name in seen:
                continue
            else:
                ends, axis = self._gazebo_joint(element, f"gazebo joint {name!r}")
            seen.append(name)
            if name in without:
                self.description.left_out.append(f"loop joint {name!r}: as asked")
            else:
                self._loop(name, element.get("type", ""), ends, axis)
        if unknown := set(without) - set(seen):
            there = ", ".join(dict.fromkeys(seen)) or "none"
            raise self.fault(f"without={sorted(unknown)}: no such loop joint; there are {there}")

    def _loop_joint(self, element: ET.Element, what: str) -> "tuple[list[_End], Vec]":
        ends = _link_elements(element)
        if len(ends) != 2:
            raise self.fault(f"{what}: it needs two ends, <link1> and <link2>")
        places = []
        for end in ends:
            link = end.get("link") or ""
            if link not in self._number_of:
                raise self.fault(f"{what}: {end.get('link')!r} is no link; {nearest(link, self.links)}")
            places.append((self._number_of[link], *self._pose(end, what)))
        return places, self._numbers(element.find("axis"), "xyz", (1, 0, 0), what)

    def _gazebo_joint(self, element: ET.Element, what: str) -> "tuple[list[_End], Vec]":
        one, other = (self._number_of[self._end(element, tag, what)] for tag in ("parent", "child"))
        values = self._parse_numbers(element.findtext("pose") or None, (0, 0, 0, 0, 0, 0), f"{what}: pose")
        place, turn = values[:3], _rotation_of_rpy(values[3:])
        a, b = self.description.links[one], self.description.links[other]
        at = b.origin + b.turn @ place  # the pose is that on the child; the parent has it there at home
        local = (one, a.turn.T @ (at - a.origin), a.turn.T @ b.turn @ turn)
        axis = self._parse_numbers(element.findtext("axis/xyz") or None, (1, 0, 0), f"{what}: axis/xyz")
        return [local, (other, place, turn)], axis

    def _loop(self, name: str, kind: str, ends: "list[_End]", axis: Vec) -> None:
        d = self.description
        (one, p, turn), (other, q, turn2) = ends
        a, b = d.links[one], d.links[other]
        at = a.origin + a.turn @ p, b.origin + b.turn @ q
        if kind in ("spherical", "ball"):
            d.loops.append(LoopClosure(name, "connect", one, other, at))
        elif kind in ("revolute", "continuous"):
            size = 0.1 * (float(np.linalg.norm(np.ptp([x.origin for x in d.links], axis=0))) or 1.0)
            if not np.linalg.norm(axis) > 0:
                raise self.fault(f"loop joint {name!r}: its axis is zero")
            u = axis / np.linalg.norm(axis)
            d.loops.append(LoopClosure(name, "connect", one, other, at))
            far = at[0] + size * a.turn @ turn @ u, at[1] + size * b.turn @ turn2 @ u
            d.loops.append(LoopClosure(f"{name} axis", "connect", one, other, far))
        elif kind == "fixed":
            apart = np.linalg.norm(at[0] - at[1]) + np.linalg.norm(a.turn @ turn - b.turn @ turn2)
            if apart > 1e-6:  # so far may a fixed loop joint be from closed at home
                raise self.fault(f"loop joint {name!r}: it fixes two links other than they are at home; "
                                 f"without={[name]!r} leaves it out")  # fmt: skip
            d.loops.append(LoopClosure(name, "weld", one, other, at))
        else:
            known = ("spherical", "revolute", "fixed")
            raise self.fault(f"loop joint {name!r}: type={kind!r}; {nearest(kind, known)}")

    # -- the rest -----------------------------------------------------------------------------------------------

    def _mimics(self) -> None:
        joints, given = self.description.joints, {}
        for name, joint in self.joints.items():
            if (mimic := joint.find("mimic")) is not None:
                factor, offset = (
                    self._number(mimic, key, usual, f"mimic of joint {name!r}")
                    for key, usual in (("multiplier", 1), ("offset", 0))
                )
                given[name] = mimic.get("joint") or "", factor, offset
        leader = {name: other for name, (other, factor, _) in given.items() if factor}
        for name, (other, factor, offset) in given.items():
            what, leaders = f"mimic of joint {name!r}", [other]
            for n in (name, other):
                if n not in joints or joints[n].kind not in ("hinge", "slide"):
                    raise self.fault(f"{what}: {n!r} is no hinge or slide; {nearest(n, joints)}")
            while leaders[-1] in leader and name not in leaders and len(leaders) < len(leader):
                leaders.append(leader[leaders[-1]])
            if name in leader and name in leaders:
                by = f", by {', '.join(map(repr, leaders[:-1]))}" if leaders[1:] else ""
                raise self.fault(f"{what}: it follows itself{by}; name another joint")
            second = other if factor else None
            self.description.followers.append(Follower(f"mimic {name}", name, second, (offset, factor)))
            if offset:
                self.description.notes.append(f"{what}: its offset moves the joint away from home")

    def _motors(self) -> None:
        d = self.description
        for element in self.root.findall("transmission/joint"):
            name = element.get("name") or ""
            if name not in d.joints:
                raise self.fault(f"transmission of {name!r}: there is no such joint; {nearest(name, d.joints)}")
            d.drive(name)

    def _leave_out(self) -> None:
        d, joints, links = self.description, self.joints.items(), self.links.items()
        bounded = ("revolute", "prismatic")
        limited = [n for n, j in joints if j.get("type") in bounded or j.find("safety_controller") is not None]
        d.leave_out("limits of joints", limited)
        rubbing = [n for n, j in joints if self._number(j.find("dynamics"), "friction", 0, f"joint {n!r}")]
        d.leave_out("dry friction of joints", rubbing)
        d.leave_out("pictures of links", [n for n, x in links if x.find("visual") is not None])
        d.leave_out("contacts of links", [n for n, x in links if x.find("collision") is not None])
        unknown = dict.fromkeys(x.tag for x in self.root if isinstance(x.tag, str) and x.tag not in _READ)
        unknown |= {f"gazebo/{x.tag}": None for g in self.root.findall("gazebo") for x in g if x.tag != "joint"}
        d.leave_out("elements", [f"<{tag}>" for tag in unknown])

    # -- writing ------------------------------------------------------------------------------------------------

    def save(self, path: Path, tree: ImportTree, design: MovedPlaces) -> Path:
        """Put the places of a design where the file has them: frames of links are where their joints are."""
        if path.suffix.lower() != ".urdf":
            raise InputError(f"{path}: a URDF file ends in .urdf")
        root, links = ET.fromstring(ET.tostring(self.root)), self.description.links
        places, changed = design.places, design.changed
        origins = [self._origin(k, tree, design) for k in range(len(links))]
        by_name = {link.name: (link, at) for link, at in zip(links, origins, strict=True)}
        for joint in root.findall("joint"):
            (before, start), (link, at) = (by_name[self._end(joint, tag, "")] for tag in ("parent", "child"))
            if not np.array_equal(start, before.origin) or not np.array_equal(at, link.origin):
                _child(joint, "origin").set("xyz", xml_text(before.turn.T @ (at - start)))
            for own in (j for j in link.joints if not j.held and tree.anchors[j.name].axis in changed):
                name = tree.anchors[own.name].axis
                if joint.get("type") == "planar":
                    raise InputError(f"save(): {name!r} points elsewhere in this design, and URDF has one axis for all "
                                     f"three of planar joint {joint.get('name')!r}: keep it as it is")  # fmt: skip
                _child(joint, "axis").set("xyz", xml_text(link.turn.T @ (tree.sense(own) * places[name])))
        for element in root.findall("link"):
            link, at = by_name[str(element.get("name"))]
            shift = link.turn.T @ (link.origin - at)
            for part in (*element.findall("inertial"), *element.findall("visual"), *element.findall("collision")):
                if np.any(shift):
                    origin = _child(part, "origin", first=True)
                    origin.set("xyz", xml_text(self._numbers(origin, "xyz", (0, 0, 0), "origin") + shift))
        for loop in self.description.loops:
            pins = tree.pins.get(loop.name)
            now = loop.at if pins is None else [places[p] for p in pins]
            self._keep_axis(loop, tree, design)
            local = [links[k].turn.T @ (at - origins[k]) for k, at in zip((loop.first, loop.second), now, strict=True)]
            for element in root.findall("loop_joint"):
                if element.get("name") == loop.name:
                    for end, at in zip(_link_elements(element), local, strict=True):
                        end.set("xyz", xml_text(at))
            for element in root.findall("gazebo/joint"):
                if element.get("name") == loop.name:
                    pose = _child(element, "pose")
                    pose.text = " ".join([xml_text(local[1]), *((pose.text or "") + " 0 0 0 0 0 0").split()[3:6]])
        return write(path, b'<?xml version="1.0"?>\n' + ET.tostring(root) + b"\n")

    def _origin(self, k: int, tree: ImportTree, design: MovedPlaces) -> Vec:
        """Return the place of the frame of a link in a design."""
        link = self.description.links[k]
        moving = [j for j in link.joints if not j.held]
        if moving:
            name = tree.sliders.get(moving[-1].name, tree.anchors[moving[0].name].point)
        else:
            name = tree.marks.get((k, ""), "")
        return design.places[name] if name in design.changed else link.origin

    def _keep_axis(self, loop: LoopClosure, tree: ImportTree, design: MovedPlaces) -> None:
        """Refuse a design whose axis of a loop joint points elsewhere."""
        pins, far = tree.pins.get(loop.name), tree.pins.get(f"{loop.name} axis")
        if pins is None or far is None:
            return
        shift, other = (
            np.subtract([design.places[p] for p in ends], [tree.places[p] for p in ends]) for ends in (pins, far)
        )
        if not np.allclose(other, shift, rtol=0.0, atol=1e-12 * tree.size):
            raise InputError(
                f"save(): the axis of loop joint {loop.name!r} points elsewhere in this design, and save() keeps it as "
                f"the file has it: move {far[0]!r} as {pins[0]!r}"
            )


_End = tuple[int, Vec, np.ndarray]  # number of a link, a place and axes on it


def _link_elements(loop: ET.Element) -> list[ET.Element]:
    return [e for e in loop if e.tag in ("link1", "link2")]


def _rotation_of_rpy(rpy: Sequence[float] | np.ndarray) -> np.ndarray:
    roll, pitch, yaw = rpy
    x, y, z = np.eye(3)
    return rotate_about(z, yaw) @ rotate_about(y, pitch) @ rotate_about(x, roll)


def _child(element: ET.Element, tag: str, first: bool = False) -> ET.Element:
    """Find an element in another, or make one."""
    found = element.find(tag)
    if found is None:
        found = ET.Element(tag)
        element.insert(0 if first else len(element), found)
    return found


class UrdfWriter:
    """Writes a tree of links as URDF: one joint a link, loops in a table beside the tree.

    The `driven` coordinates get a transmission.
    """

    def __init__(self, tree: ExportTree, driven: tuple[str, ...]):
        self.tree, self.description = tree, tree.description
        self.root = ET.Element("robot", name=xml_text(self.description.name))
        self.joints: dict[str, ET.Element] = {}
        self.taken = {_WORLD}
        self.names = [_WORLD, *(self._new_name(link.name) for link in tree.links[1:])]
        self._add_link(_WORLD, tree.links[0])
        for name, link in zip(self.names[1:], tree.links[1:], strict=True):
            self._add_body(name, link)
        self._add_loops()
        self._add_mimics()
        for name in driven:
            self._add_transmission(name)
        loads = tree.system.topology.loads
        left = self.description.left_out
        for block in loads.forces:
            left += [f"{block.kind.name} {name!r}: URDF has no forces" for name in block.names]
        left += [f"force {f.name!r}: URDF has no forces" for f in loads.functions]
        if loads.gravity:
            left.append("gravity: it is the simulator's")

    def text(self) -> str:
        """Return the file."""
        ET.indent(self.root)
        return '<?xml version="1.0"?>\n' + ET.tostring(self.root, encoding="unicode") + "\n"

    def _new_name(self, name: str) -> str:
        out = free_name(xml_text(name), self.taken)
        self.taken.add(out)
        return out

    def _add_body(self, name: str, link: Link) -> None:
        pieces = [piece for joint in link.joints for piece in pieces_of(joint)]
        chain = [
            self.names[link.parent],
            *(self._new_name(f"{link.name} {i + 1}") for i in range(len(pieces) - 1)),
            name,
        ]
        place = link.origin - self.tree.links[link.parent].origin
        if link.joints[0].kind == "free":
            place = np.zeros(3)
        for i, (joint, (parent, child)) in enumerate(zip(pieces, pairwise(chain), strict=True)):
            if child != name:
                add_element(self.root, "link", name=child)
            else:
                self._add_link(child, link)
            self._add_joint(joint.name, _TYPES[joint.kind], parent, child, np.zeros(3) if i else place, joint.axis)

    def _add_joint(self, name: str, kind: str, parent: str, child: str, place: Vec, axis: Vec | None = None) -> None:
        joint = add_element(self.root, "joint", name=name, type=kind)
        add_element(joint, "parent", link=parent)
        add_element(joint, "child", link=child)
        add_element(joint, "origin", xyz=place, rpy="0 0 0")
        if axis is not None and kind != "floating":
            add_element(joint, "axis", xyz=axis)
        if kind == "prismatic":
            far = xml_text(10.0 * self.tree.size)  # 10 times the drawing's size: sliding joints must have limits
            add_element(joint, "limit", lower=f"-{far}", upper=far, effort="1e6", velocity="1e6")
        self.joints[name] = joint

    def _add_link(self, name: str, link: Link) -> None:
        element = add_element(self.root, "link", name=name)
        if link.inertia is not None and not link.auxiliary:
            inertial, i = add_element(element, "inertial"), link.inertia.tensor
            add_element(inertial, "origin", xyz=link.inertia.com - link.origin, rpy="0 0 0")
            add_element(inertial, "mass", value=link.inertia.mass)
            keys = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
            add_element(inertial, "inertia", **{key: i[at] for key, at in keys.items()})
        for a, b in link.lines:
            length = float(np.linalg.norm(b - a))
            if length > 1e-9 * self.tree.size:
                u = (b - a) / length
                rpy = 0.0, math.acos(float(np.clip(u[2], -1.0, 1.0))), math.atan2(float(u[1]), float(u[0]))
                visual = add_element(element, "visual")
                add_element(visual, "origin", xyz=0.5 * (a + b) - link.origin, rpy=rpy)
                shape = add_element(visual, "geometry")
                # 0.008 of the drawing's size
                add_element(shape, "cylinder", radius=0.008 * self.tree.size, length=length)
        for site, place in link.sites.items():
            own = self._new_name(site)
            add_element(self.root, "link", name=own)
            self._add_joint(f"{own} at {name}", "fixed", name, own, place - link.origin)

    def _add_loops(self) -> None:
        """Write the table of loops: as Isaac Sim reads it, and once more as Gazebo does."""
        links = self.tree.links
        for loop in self.description.loops:
            ball = loop.kind == "connect"
            name, ends = xml_text(loop.name), (loop.first, loop.second)
            element = add_element(self.root, "loop_joint", name=name, type="spherical" if ball else "fixed")
            for tag, k, at in zip(("link1", "link2"), ends, loop.at, strict=True):
                add_element(element, tag, link=self.names[k], xyz=at - links[k].origin, rpy="0 0 0")
            joint = add_element(add_element(self.root, "gazebo"), "joint", name=name, type="ball" if ball else "fixed")
            add_element(joint, "parent").text = self.names[loop.first]
            add_element(joint, "child").text = self.names[loop.second]
            add_element(joint, "pose").text = xml_text([*(loop.at[1] - links[loop.second].origin), 0, 0, 0])

    def _add_mimics(self) -> None:
        left = self.description.left_out
        for tie in self.description.ties:
            joints = list(tie.terms)
            element = self.joints[joints[0]]
            if len(joints) > 2 or element.find("mimic") is not None:
                left.append(f"relation {tie.name!r}: URDF ties a joint to one other joint, by mimic")
                continue
            factor = -tie.terms[joints[1]] / tie.terms[joints[0]] if len(joints) > 1 else 0.0
            other = joints[-1] if len(joints) > 1 else next(j for j in self.joints if j != joints[0])
            add_element(element, "mimic", joint=other, multiplier=factor, offset="0.0")
        left += [f"cable {name!r}: URDF has none" for name in self.tree.cables]

    def _add_transmission(self, name: str) -> None:
        coordinate = self.tree.coordinates.get(name)
        if coordinate is None or coordinate.joint is None:
            self.description.left_out.append(f"input {name!r}: it is not one joint, and has no transmission")
            return
        element = add_element(self.root, "transmission", name=name)
        add_element(element, "type").text = "transmission_interface/SimpleTransmission"
        add_element(element, "joint", name=coordinate.joint[0])
        add_element(element, "actuator", name=name)


def pieces_of(joint: ElementaryJoint) -> list[ElementaryJoint]:
    """Return what a joint is in URDF: a ball is three hinges, about x, y and z, one after the other."""
    if joint.kind != "ball":
        return [joint]
    return [ElementaryJoint(f"{joint.name} {axis}", "hinge", u) for axis, u in zip("xyz", np.eye(3), strict=True)]


def values_of_pieces(joints: Iterable[ElementaryJoint], values: np.ndarray) -> np.ndarray:
    """Return joint values of a tree ``(..., nq)`` as those of its URDF file."""
    out, at = [], 0
    for joint in joints:
        part = values[..., at : at + joint.width]
        at += joint.width
        if joint.kind == "ball":
            w, x, y, z = np.moveaxis(part, -1, 0)
            a = np.arctan2(2 * (w * x - y * z), w * w - x * x - y * y + z * z)
            b = np.arcsin(np.clip(2 * (x * z + w * y), -1.0, 1.0))
            c = np.arctan2(2 * (w * z - x * y), w * w + x * x - y * y - z * z)
            part = np.stack([a, b, c], axis=-1)
        out.append(part)
    return np.concatenate(out, axis=-1) if out else values
