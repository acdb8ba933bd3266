"""Writing a tree of links as URDF: one joint a link, loops in a table beside the tree."""

import math
import xml.etree.ElementTree as ET
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from jaxnc.io.robots.mjcf import clean, number, numbers
from jaxnc.io.robots.tree import Joint, Link, Vec

if TYPE_CHECKING:
    from jaxnc.io.robots.grown import Grown

_THIN = 0.008  # radius of cylinders, of the drawing's size
_WIDE = 10.0  # limits of sliding joints, which there must be, of the drawing's size
_TYPES = {"hinge": "continuous", "slide": "prismatic", "free": "floating"}
WORLD = "world"


def elementary(joint: Joint) -> list[Joint]:
    """What a joint is in URDF: a ball is three hinges, about x, y and z, one after the other."""
    if joint.kind != "ball":
        return [joint]
    return [Joint(f"{joint.name} {axis}", "hinge", direction) for axis, direction in zip("xyz", np.eye(3), strict=True)]


class Urdf:
    """A URDF file that is being written.

    The `driven` coordinates get a transmission.
    """

    def __init__(self, grown: "Grown", driven: tuple[str, ...]):
        self.grown, self.tree = grown, grown.tree
        self.root = ET.Element("robot", name=clean(self.tree.name))
        self.joints: dict[str, ET.Element] = {}
        self.taken = {WORLD}
        self.names = [WORLD, *(self._new(link.name) for link in self.tree.links[1:])]
        self.values: list[str] = []
        self._link(WORLD, self.tree.links[0])
        for k in range(1, len(self.tree.links)):
            self._body(k)
        self._loops()
        self._ties()
        for name in driven:
            self._transmission(name)
        self._loads()

    def text(self) -> str:
        """The file."""
        ET.indent(self.root)
        return '<?xml version="1.0"?>\n' + ET.tostring(self.root, encoding="unicode") + "\n"

    def _new(self, name: str) -> str:
        k, out = 1, clean(name)
        while out in self.taken:
            k += 1
            out = f"{clean(name)} {k}"
        self.taken.add(out)
        return out

    # -- the tree -----------------------------------------------------------------------------------------------

    def _body(self, k: int) -> None:
        link = self.tree.links[k]
        pieces = [e for joint in link.joints for e in elementary(joint)]
        chain = [self.names[link.parent], *(self._new(f"{link.name} {i + 1}") for i in range(len(pieces) - 1))]
        chain.append(self.names[k])
        place = link.origin - self.tree.links[link.parent].origin
        if link.joints[0].kind == "free":
            place = np.zeros(3)
        for i, (joint, (parent, child)) in enumerate(zip(pieces, pairwise(chain), strict=True)):
            if child != chain[-1]:
                ET.SubElement(self.root, "link", name=child)
            else:
                self._link(child, link)
            self._joint(joint.name, _TYPES[joint.kind], parent, child, np.zeros(3) if i else place, joint.axis)
            self.values.append(joint.name)

    def _joint(self, name: str, kind: str, parent: str, child: str, place: Vec, axis: Vec | None = None) -> None:
        joint = ET.SubElement(self.root, "joint", name=clean(name), type=kind)
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
        ET.SubElement(joint, "origin", xyz=numbers(place), rpy="0 0 0")
        if axis is not None and kind != "floating":
            ET.SubElement(joint, "axis", xyz=numbers(axis))
        if kind == "prismatic":
            far = number(_WIDE * self.grown.size)
            ET.SubElement(joint, "limit", lower=f"-{far}", upper=far, effort="1e6", velocity="1e6")
        self.joints[name] = joint

    def _link(self, name: str, link: Link) -> None:
        element = ET.SubElement(self.root, "link", name=name)
        if link.inertia is not None and not link.auxiliary:
            inertial, i = ET.SubElement(element, "inertial"), link.inertia.tensor
            ET.SubElement(inertial, "origin", xyz=numbers(link.inertia.com - link.origin), rpy="0 0 0")
            ET.SubElement(inertial, "mass", value=number(link.inertia.mass))
            keys = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
            ET.SubElement(inertial, "inertia", {key: number(i[at]) for key, at in keys.items()})
        for a, b in link.lines:
            length = float(np.linalg.norm(b - a))
            if length > 1e-9 * self.grown.size:
                u = (b - a) / length
                rpy = 0.0, math.acos(float(np.clip(u[2], -1.0, 1.0))), math.atan2(float(u[1]), float(u[0]))
                visual = ET.SubElement(element, "visual")
                ET.SubElement(visual, "origin", xyz=numbers(0.5 * (a + b) - link.origin), rpy=numbers(rpy))
                shape = ET.SubElement(visual, "geometry")
                ET.SubElement(shape, "cylinder", radius=number(_THIN * self.grown.size), length=number(length))
        for site, place in link.sites.items():
            own = self._new(site)
            ET.SubElement(self.root, "link", name=own)
            self._joint(f"{own} at {name}", "fixed", name, own, place - link.origin)

    # -- loops --------------------------------------------------------------------------------------------------

    def _loops(self) -> None:
        """The table of loops: as Isaac Sim reads it, and once more as Gazebo does."""
        links = self.tree.links
        for loop in self.tree.loops:
            kind = "spherical" if loop.kind == "connect" else "fixed"
            element = ET.SubElement(self.root, "loop_joint", name=clean(loop.name), type=kind)
            for tag, k in (("link1", loop.first), ("link2", loop.second)):
                ET.SubElement(element, tag, link=self.names[k], xyz=numbers(loop.at - links[k].origin), rpy="0 0 0")
            joint = ET.SubElement(ET.SubElement(self.root, "gazebo"), "joint", name=clean(loop.name))
            joint.set("type", "ball" if loop.kind == "connect" else "fixed")
            ET.SubElement(joint, "parent").text = self.names[loop.first]
            ET.SubElement(joint, "child").text = self.names[loop.second]
            ET.SubElement(joint, "pose").text = numbers([*(loop.at - links[loop.second].origin), 0, 0, 0])

    def _ties(self) -> None:
        left = self.tree.left_out
        for tie in self.tree.ties:
            joints = list(tie.terms)
            element = self.joints[joints[0]]
            if len(joints) > 2 or element.find("mimic") is not None:
                left.append(f"relation {tie.name!r}: URDF ties a joint to one other joint, by mimic")
                continue
            factor = -tie.terms[joints[1]] / tie.terms[joints[0]] if len(joints) > 1 else 0.0
            other = joints[-1] if len(joints) > 1 else next(j for j in self.joints if j != joints[0])
            ET.SubElement(element, "mimic", joint=clean(other), multiplier=number(factor), offset="0.0")
        left += [f"cable {name!r}: URDF has none" for name in self.tree.cables]

    def _transmission(self, name: str) -> None:
        reading = self.tree.readings.get(name)
        if reading is None or reading.ends is not None or len(reading.terms) != 1:
            self.tree.left_out.append(f"input {name!r}: it is not one joint, and has no transmission")
            return
        (joint,) = reading.terms
        element = ET.SubElement(self.root, "transmission", name=clean(name))
        ET.SubElement(element, "type").text = "transmission_interface/SimpleTransmission"
        ET.SubElement(element, "joint", name=clean(joint))
        ET.SubElement(element, "actuator", name=clean(name))

    def _loads(self) -> None:
        loads = self.grown.system.topology.loads
        for block in loads.forces:
            self.tree.left_out += [f"{block.kind.name} {name!r}: URDF has no forces" for name in block.names]
        self.tree.left_out += [f"force {f.name!r}: URDF has no forces" for f in loads.functions]
        if loads.gravity:
            self.tree.left_out.append("gravity: it is the simulator's")


def in_urdf(tree_joints: list[Joint], values: np.ndarray) -> np.ndarray:
    """Joint values of a tree ``(..., nq)`` as those of its URDF file."""
    out, at = [], 0
    for joint in tree_joints:
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
