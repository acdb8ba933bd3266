"""Robots with closed loops, as MuJoCo files: own models, with sizes as public papers print them."""

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import jaxnc as nc
from jaxnc.robots import Robot

Place = Sequence[float]

_GEOM = '<geom size=".005"/>'
_X, _Y, _Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)


class Part:
    """A body whose frame is parallel to the world's in the drawing, and everything that hangs on it.

    Args:
        name: the body.
        at: its origin in the world, metres.
        joints: each a name with the axis of a hinge, with ``("slide", axis)`` or ``("spring", axis)``, or ``"ball"``.
        parts: the bodies that hang on it.
        sites: places in the world, by name.
    """

    def __init__(self, name: str, at: Place, joints: dict, parts: Sequence["Part"] = (), sites: dict | None = None):
        self.name, self.at, self.joints, self.parts = name, np.asarray(at, float), joints, parts
        self.sites = sites or {}

    def text(self, parent: Place = (0.0, 0.0, 0.0)) -> str:
        """Write the body as an element."""
        inside = [_joint(name, kind) for name, kind in self.joints.items()] + [_GEOM]
        inside += [f'<site name="{name}" pos="{_numbers(np.subtract(p, self.at))}"/>' for name, p in self.sites.items()]
        inside += [part.text(self.at) for part in self.parts]
        return f'<body name="{self.name}" pos="{_numbers(np.subtract(self.at, parent))}">{"".join(inside)}</body>'


def _numbers(values: Place) -> str:
    return " ".join(repr(float(v)) for v in values)


def _joint(name: str, kind: object) -> str:
    if kind == "ball":
        return f'<joint name="{name}" type="ball"/>'
    if isinstance(kind, tuple) and isinstance(kind[0], str):
        more = 'type="slide"' if kind[0] == "slide" else 'stiffness="1500"'
        return f'<joint name="{name}" {more} axis="{_numbers(kind[1])}"/>'
    return f'<joint name="{name}" axis="{_numbers(kind)}"/>'  # pyright: ignore[reportArgumentType]


def _robot(
    name: str,
    parts: Sequence[Part],
    closed: Sequence[tuple[str, str]],
    motors: Sequence[str],
    tied: Sequence[tuple[str, str]] = (),
    sites: dict | None = None,
) -> str:
    """Write a robot: pairs of sites that coincide, joints with motors, joints that turn as others do."""
    ground = "".join(f'<site name="{site}" pos="{_numbers(p)}"/>' for site, p in (sites or {}).items())
    equalities = "".join(f'<connect site1="{a}" site2="{b}"/>' for a, b in closed)
    equalities += "".join(f'<joint joint1="{a}" joint2="{b}" polycoef="0 1 0 0 0"/>' for a, b in tied)
    driven = "".join(f'<position joint="{joint}"/>' for joint in motors)
    return (
        f'<mujoco model="{name}"><compiler angle="radian"/><worldbody>{ground}{"".join(p.text() for p in parts)}'
        f"</worldbody><equality>{equalities}</equality><actuator>{driven}</actuator></mujoco>"
    )


def _rod(name: str, start: Place, end: Place, site: str) -> Part:
    """A rod on a ball, with a site at its other end."""
    return Part(name, start, {f"{name} ball": "ball"}, sites={site: end})


def ankle() -> str:
    """Two motors pitch and roll a humanoid's foot through cranks and rods, 0.25 m above it."""
    heels = {side: (-0.05, y, 0.0) for side, y in (("left", 0.04), ("right", -0.04))}
    foot = Part("foot", (0, 0, 0), {"roll": _X}, sites={f"heel {side}": p for side, p in heels.items()})
    cranks = []
    for side, (x, y, _) in heels.items():
        rod = _rod(f"rod {side}", (x, y, 0.25), heels[side], f"end {side}")
        cranks.append(Part(f"crank {side}", (0, y, 0.25), {f"motor {side}": _Y}, [rod]))
    shank = Part("cross", (0, 0, 0), {"pitch": _Y}, [foot])
    pairs = [(f"end {side}", f"heel {side}") for side in heels]
    return _robot("ankle", [shank, *cranks], pairs, [f"motor {side}" for side in heels])


def delta() -> str:
    """A delta robot: three arms of 0.3 m, forearms of two rods each, 0.8 m (the sizes of the first industrial ones)."""
    base, tip, arm, forearm, half = 0.2, 0.045, 0.3, 0.8, 0.05
    out = base + arm - tip
    height = math.sqrt(forearm**2 - out**2)
    arms, pairs, hung = [], [], {}
    for k in range(3):
        angle = 2 * math.pi * k / 3
        away, side = np.array([math.cos(angle), math.sin(angle), 0.0]), np.array([-math.sin(angle), math.cos(angle), 0])
        rods = []
        for sign in (1, -1):
            name = f"rod {k}{'+' if sign > 0 else '-'}"
            start, end = (base + arm) * away + sign * half * side, tip * away + sign * half * side
            end = end - [0, 0, height]
            rods.append(_rod(name, start, end, f"end of {name}"))
            hung[f"held by {name}"] = end
            pairs.append((f"end of {name}", f"held by {name}"))
        arms.append(Part(f"arm {k}", base * away, {f"motor {k}": tuple(side)}, rods))
    # The platform hangs on the first rod; the other five close loops.
    first = arms[0].parts[0]
    at = hung.pop("held by rod 0+")
    first.parts = [Part("platform", at, {"platform ball": "ball"}, sites=hung)]
    first.sites = {}
    return _robot("delta", arms, pairs[1:], [f"motor {k}" for k in range(3)])


def stewart() -> str:
    """A Stewart platform: legs on universal joints, a platform on balls, 0.5 and 0.3 m of radius, 0.6 m high."""
    lower, upper, height = 0.5, 0.3, 0.6
    legs, pairs, held = [], [], {}
    for k in range(6):
        below, above = ((k + 1) // 2 * 2 * math.pi / 3 + s * d for s, d in ((1 if k % 2 else -1, 0.15),) * 2)
        below += math.pi / 3 * (1 if k % 2 == 0 else -1) * 0.2
        foot = np.array([lower * math.cos(below), lower * math.sin(below), 0.0])
        head = np.array([upper * math.cos(above), upper * math.sin(above), height])
        way = (head - foot) / np.linalg.norm(head - foot)
        rod = Part(f"rod {k}", (foot + head) / 2, {f"leg {k}": ("slide", tuple(way))}, sites={f"head {k}": head})
        legs.append(Part(f"cylinder {k}", foot, {f"tilt {k}": _X, f"swing {k}": _Y}, [rod]))
        held[f"ball {k}"] = head
        pairs.append((f"head {k}", f"ball {k}"))
    last = legs[0].parts[0]
    last.parts = [Part("platform", held.pop("ball 0"), {"platform ball": "ball"}, sites=held)]
    return _robot("stewart", legs, pairs[1:], [f"leg {k}" for k in range(6)])


def leg() -> str:
    """A leg like Cassie's: three hinges in the hip, knee, tarsus and foot; an Achilles rod and a rod to the toe."""
    hip, knee, shin = (0.0, 0.0, 0.9), (0.12, 0.0, 0.75), (0.18, 0.0, 0.71)
    heel, foot, crank = (-0.35, 0.0, 0.50), (-0.05, 0.0, 0.06), (-0.27, 0.02, 0.40)
    tarsus = (-0.25, 0.0, 0.46)
    horn, tail = (-0.224, 0.02, 0.43), (-0.004, 0.02, 0.09)
    toe = Part("foot", foot, {"toe": _Y}, sites={"foot end": tail})
    plantar = _rod("plantar rod", horn, tail, "plantar end")
    lever = Part("foot crank", crank, {"foot motor": _Y}, [plantar])
    spring = Part("heel spring", tarsus, {"heel": ("spring", _Y)}, sites={"heel end": heel})
    lower = Part("tarsus", tarsus, {"ankle": _Y}, [toe, lever, spring])
    shank = Part("shin", shin, {"shin spring": ("spring", _Y)}, [lower])
    achilles = _rod("achilles rod", (0.0, 0.045, 0.88), heel, "achilles end")
    thigh = Part("thigh", hip, {"hip pitch": _Y}, [achilles, Part("knee", knee, {"knee": _Y}, [shank])])
    yaw = Part("hip yaw", hip, {"hip yaw": _Z}, [thigh])
    motors = ["hip roll", "hip yaw", "hip pitch", "knee", "foot motor"]
    closed = [("achilles end", "heel end"), ("plantar end", "foot end")]
    return _robot("leg", [Part("hip roll", hip, {"hip roll": _X}, [yaw])], closed, motors)


def gripper() -> str:
    """A gripper like the 2F-85: two fingers, each a loop, that one motor drives."""
    fingers, pairs = [], []
    for name, s in (("left", 1.0), ("right", -1.0)):

        def at(y: float, z: float, s: float = s) -> Place:
            return 0.0, s * y, z

        tied = {f"a {name}": at(0.07, 0.09)}
        coupler = Part(f"coupler {name}", at(0.0615, 0.0496), {f"coupler {name}": _X}, sites=tied)
        driver = Part(f"driver {name}", at(0.0306, 0.0549), {f"driver {name}": _X}, [coupler])
        tip = Part(f"tip {name}", at(0.053, 0.0972), {f"tip {name}": _X}, sites={f"b {name}": at(0.07, 0.09)})
        spring = Part(f"spring link {name}", at(0.0132, 0.0609), {f"spring {name}": _X}, [tip])
        fingers += [driver, spring]
        pairs.append((f"a {name}", f"b {name}"))
    return _robot("gripper", fingers, pairs, ["driver left"], tied=[("driver right", "driver left")])


def nested(loops: int = 6) -> str:
    """Four-bars, each on the coupler of the one before, whose cranks turn as the first one does."""
    inner: list[Part] = []
    pairs, x = [], 0.08 * loops
    for k in range(loops - 1, -1, -1):
        z = 0.1 * (k + 1)
        left, right, up = (-x, 0.0, z - 0.1), (x, 0.0, z - 0.1), (x + 0.03, 0.0, z + 0.02)
        coupler = Part(f"coupler {k}", (-x + 0.02, 0, z), {f"coupler {k}": _Y}, inner, sites={f"a {k}": up})
        crank = Part(f"crank {k}", left, {f"crank {k}": _Y}, [coupler])
        rocker = Part(f"rocker {k}", right, {f"rocker {k}": _Y}, sites={f"b {k}": up})
        pairs.append((f"a {k}", f"b {k}"))
        inner, x = [crank, rocker], x + 0.02
    return _robot("nested", inner, pairs, ["crank 0"], tied=[(f"crank {k}", "crank 0") for k in range(1, loops)])


ROBOTS = {f.__name__: f for f in (ankle, delta, stewart, leg, gripper, nested)}


def read(name: str) -> Robot:
    """Read one of the robots as a user reads a file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.xml"
        path.write_text(ROBOTS[name]())
        return nc.from_mjcf(path)
