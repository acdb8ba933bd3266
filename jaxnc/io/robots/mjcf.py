"""Writing a tree of links as MJCF, the format of MuJoCo. Nothing but the standard library is needed for it."""

import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING

import numpy as np

from jaxnc.io.robots.inertia import density
from jaxnc.io.robots.loads import add_loads
from jaxnc.io.robots.tree import Link
from jaxnc.system.frames import quaternions

if TYPE_CHECKING:
    from jaxnc.io.robots.grown import Grown

_THIN = 0.008  # radius of capsules, of the drawing's size
_LEAST = "1e-14"  # mass and principal inertia of a link: MuJoCo refuses files with less than 1e-15, in whatever unit


class Mjcf:
    """An MJCF file that is being written.

    The `driven` coordinates get a motor; `keys` are joint values of poses to be kept as keyframes, ``(K, nq)``.
    """

    def __init__(self, grown: "Grown", driven: tuple[str, ...], keys: np.ndarray):
        self.grown, self.tree = grown, grown.tree
        self.root = ET.Element("mujoco", model=clean(self.tree.name))
        sizes = {"boundmass": _LEAST, "boundinertia": _LEAST}
        ET.SubElement(self.root, "compiler", {"angle": "radian", "autolimits": "true"} | sizes)
        gravity = np.zeros(3)
        if (index := grown.system.topology.loads.gravity) != ():
            gravity[: grown.parts.dim] = np.asarray(grown.system.parameters.physical)[list(index)]
        ET.SubElement(self.root, "option", gravity=numbers(gravity), timestep="0.001")
        default = ET.SubElement(self.root, "default")
        thin = _THIN * grown.size
        geom = ET.SubElement(default, "geom", contype="0", conaffinity="0", size=number(thin), rgba="0.35 0.5 0.7 1")
        if not any(link.inertia for link in self.tree.links):
            geom.set("density", number(density(grown.size)))
        ET.SubElement(default, "site", size=number(1.5 * thin), rgba="0.8 0.4 0.1 1")
        ET.SubElement(default, "equality", solref="0.005 1", solimp="0.99 0.999 0.0001")
        world = ET.SubElement(self.root, "worldbody")
        self.elements = {0: world}
        self.joints: dict[str, ET.Element] = {}
        self.sites: set[str] = set()
        self._ground(world)
        for k, link in enumerate(self.tree.links[1:], start=1):
            self.elements[k] = self._body(link, self.elements[link.parent], self.tree.links[link.parent])
        self.tendons = ET.Element("tendon")
        self.equality = ET.Element("equality")
        self.actuators = ET.Element("actuator")
        self._loops()
        for name in driven:
            self._motor(name)
        add_loads(self)
        for section in (self.tendons, self.equality, self.actuators):
            if len(section):
                self.root.append(section)
        if len(keys):
            section = ET.SubElement(self.root, "keyframe")
            for k, values in enumerate(keys):
                ET.SubElement(section, "key", name=f"pose {k}", qpos=numbers(values))

    def text(self) -> str:
        """The file."""
        ET.indent(self.root)
        return ET.tostring(self.root, encoding="unicode") + "\n"

    # -- bodies -------------------------------------------------------------------------------------------------

    def _ground(self, world: ET.Element) -> None:
        self._add_sites(self.tree.links[0], world)

    def _body(self, link: Link, parent: ET.Element, before: Link) -> ET.Element:
        body = ET.SubElement(parent, "body", name=clean(link.name), pos=numbers(link.origin - before.origin))
        for joint in link.joints:
            element = ET.SubElement(body, "joint", name=clean(joint.name), type=joint.kind)
            if joint.kind in ("hinge", "slide"):
                element.set("axis", numbers(joint.axis))
            self.joints[joint.name] = element
        if link.inertia is not None:
            # By principal axes: MuJoCo before 3.17 finds them to seven digits only.
            values, axes = np.linalg.eigh(link.inertia.tensor)
            axes[:, 2] *= np.sign(np.linalg.det(axes))
            inertial = ET.SubElement(body, "inertial", pos=numbers(link.inertia.com - link.origin))
            inertial.set("quat", numbers(np.asarray(quaternions(axes))))
            inertial.set("mass", number(link.inertia.mass))
            inertial.set("diaginertia", numbers(values))
            least = float(min(values[0], link.inertia.mass))
            if least < float(_LEAST):
                self.tree.notes.append(
                    f"link {link.name!r} has a mass or inertia of {least:.3g}, and MuJoCo takes none below {_LEAST}: "
                    f"it moves as if it had that; draw so small a mechanism in a smaller unit, such as mm in place of m"
                )
        drawn = 0
        for a, b in link.lines:
            if np.linalg.norm(b - a) > 1e-9 * self.grown.size:
                ends = numbers([*(a - link.origin), *(b - link.origin)])
                ET.SubElement(body, "geom", type="capsule", fromto=ends)
                drawn += 1
        if not drawn:
            ET.SubElement(body, "geom", type="sphere")
        self._add_sites(link, body)
        return body

    def _add_sites(self, link: Link, body: ET.Element) -> None:
        for name, place in link.sites.items():
            ET.SubElement(body, "site", name=clean(name), pos=numbers(place - link.origin))
            self.sites.add(name)

    # -- loops --------------------------------------------------------------------------------------------------

    def _loops(self) -> None:
        links = self.tree.links
        for loop in self.tree.loops:
            first, second = (clean(links[k].name) if k else "world" for k in (loop.first, loop.second))
            element = ET.SubElement(self.equality, loop.kind, name=clean(loop.name), body1=first, body2=second)
            if loop.kind == "connect":
                element.set("anchor", numbers(loop.at - links[loop.first].origin))
        for tie in self.tree.ties:
            joints = list(tie.terms)
            if len(joints) == 1:
                ET.SubElement(self.equality, "joint", name=clean(tie.name), joint1=clean(joints[0]))
            elif len(joints) == 2:
                factor = -tie.terms[joints[1]] / tie.terms[joints[0]]
                pair = {"joint1": clean(joints[0]), "joint2": clean(joints[1])}
                coefficients = numbers((0.0, factor, 0.0, 0.0, 0.0))
                ET.SubElement(self.equality, "joint", {"name": clean(tie.name), **pair, "polycoef": coefficients})
            else:
                self.equality.append(ET.Element("tendon", name=clean(tie.name), tendon1=self.sum(tie.name, tie.terms)))
        for name, points in self.tree.cables.items():
            ET.SubElement(self.equality, "tendon", name=clean(name), tendon1=self.string(name, points))

    def sum(self, name: str, terms: dict[str, float]) -> str:
        """A fixed tendon, whose length is a sum of joint values; its name."""
        if self._has(name):
            return clean(name)
        tendon = ET.SubElement(self.tendons, "fixed", name=clean(name))
        for joint, factor in terms.items():
            ET.SubElement(tendon, "joint", joint=clean(joint), coef=number(factor))
        return clean(name)

    def string(self, name: str, points: list[str]) -> str:
        """A spatial tendon through sites; its name."""
        if self._has(name):
            return clean(name)
        tendon = ET.SubElement(self.tendons, "spatial", name=clean(name))
        for point in points:
            ET.SubElement(tendon, "site", site=clean(point))
        return clean(name)

    def _has(self, name: str) -> bool:
        return any(t.get("name") == clean(name) for t in self.tendons)

    # -- motors -------------------------------------------------------------------------------------------------

    def _motor(self, name: str) -> None:
        """A motor for a coordinate: on its joint, or on a tendon whose length it is."""
        reading = self.tree.readings.get(name)
        motor = {"name": clean(name)}
        if reading is None:
            point, _, axis = name.rpartition(".")
            if point not in self.sites or axis not in "xyz":
                self.tree.left_out.append(f"input {name!r}: it is no sum of joints, and has no motor")
                return
            pull = numbers(np.eye(6)["xyz".index(axis)])  # a force on the point along an axis of the ground
            motor |= {"site": clean(point), "refsite": self._reference(), "gear": pull}
        elif reading.ends is not None:
            motor["tendon"] = self.string(name, list(reading.ends))
        elif len(reading.terms) == 1:
            ((joint, factor),) = reading.terms.items()
            motor |= {"joint": clean(joint), "gear": number(factor)}
        else:
            motor["tendon"] = self.sum(name, reading.terms)
        ET.SubElement(self.actuators, "motor", motor)

    def _reference(self) -> str:
        """A site of the ground whose axes are the ground's."""
        name = "ground frame"
        if name not in self.sites:
            ET.SubElement(self.elements[0], "site", name=name, size=number(0.1 * _THIN * self.grown.size))
            self.sites.add(name)
        return name


def number(x: float) -> str:
    """A number so that it is read back as it is; without the sign of zero."""
    return repr(float(x) + 0.0)


def numbers(values) -> str:
    """Several of them."""
    return " ".join(number(x) for x in values)


def clean(name: str) -> str:
    """A name without what no XML may hold."""
    return "".join(c if c.isprintable() else "_" for c in name)
