"""Joints in space as the tests build them: bodies, the displacements that each joint allows, and its twists by hand.

Every case is drawn around the point `C0` and the right-handed axes `E`, `F`, `G`. A displacement ``(R, t)`` takes
drawn places of a body to where it is relative to body 1; a twist is ``(ω, v)``, v at the origin.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

import jaxnc as nc

C0 = np.array([0.3, -0.2, 0.5])
E = np.array([0.48, 0.6, 0.64])
F = np.array([0.6, -0.48, 0.0]) / np.hypot(0.6, 0.48)
G = np.cross(E, F)
FRAME = np.stack([F, G, E])
STAY = (np.eye(3), np.zeros(3))
ANGLES = (0.0, np.pi / 2, np.pi, -np.pi / 2, 0.9, -2.2, 3.0, 0.2)
SLIDES = (0.0, 0.7, -1.3, 0.25, -0.4)


def turn(axis, angle, at=(0.0, 0.0, 0.0)):
    """Rotation about a line (Rodrigues)."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    r = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    return r, np.asarray(at) - r @ np.asarray(at)


def shift(d):
    """Translation."""
    return np.eye(3), np.asarray(d, float)


def after(second, first):
    """One displacement after another."""
    return second[0] @ first[0], second[0] @ first[1] + second[1]


def moved(displacement, place):
    return displacement[0] @ place + displacement[1]


def swing(a, b):
    """The shortest rotation from one direction to another."""
    w = np.cross(a, b)
    size = np.linalg.norm(w)
    return np.eye(3) if size < 1e-14 else turn(w, np.arctan2(size, a @ b))[0]


def about(line, at=C0):
    """Twist of a rotation about a line."""
    return np.concatenate([line, np.cross(at, line)])


def along(d):
    """Twist of a translation."""
    return np.concatenate([np.zeros(3), d])


@dataclass
class Rig:
    """The bodies of one case in a mechanism that holds many: names carry a prefix.

    Args:
        m: the mechanism.
        prefix: put before every name.
        grounded: whether all that body 1 has is fixed to the ground.
    """

    m: nc.Mechanism
    prefix: str
    grounded: bool
    items: dict = field(default_factory=dict)
    count: int = 0

    def of(self, name):
        """A name with its prefix; also a pair of them."""
        return self.prefix + name if isinstance(name, str) else tuple(map(self.of, name))

    def point(self, name, at, *bodies):
        """Add a point to bodies, counted from 1."""
        self.items[name] = (False, np.asarray(at, float), bodies)
        (self.m.ground if self.grounded and 1 in bodies else self.m.point)(self.of(name), at)

    def vector(self, name, direction, *bodies):
        """Add a unit vector to bodies."""
        d = np.asarray(direction, float) / np.linalg.norm(direction)
        self.items[name] = (True, d, bodies)
        (self.m.ground_vector if self.grounded and 1 in bodies else self.m.vector)(self.of(name), direction)

    def bodies(self, **forms):
        """Add the bodies, each with a point and a vector of its own so that it is a full one."""
        self.count = max(b for _, _, bodies in self.items.values() for b in bodies)
        for b in range(1, self.count + 1):
            self.point(f"A{b}", C0 + 0.5 * E * (-1) ** b + 0.7 * F - 0.4 * G * b, b)
            self.vector(f"a{b}", 0.3 * E + 0.5 * F * b - G, b)
            mine = [(self.of(n), v) for n, (v, _, bodies) in self.items.items() if b in bodies]
            points, vectors = [n for n, v in mine if not v], [n for n, v in mine if v]
            self.m.body(self.of(f"body{b}"), points, vectors=vectors, **forms)

    def call(self, joint, *args, **more):
        """Add a joint called by the prefix: names in its arguments get it too, except keyword values that are data."""
        plain = {k: v if k in ("form", "lead", "pitch", "radius", "radii") else self.of(v) for k, v in more.items()}
        getattr(self.m, joint)(self.of("joint"), *map(self.of, args), **plain)


@dataclass(frozen=True)
class Allowed:
    """What a joint lets bodies 2, 3, … do relative to body 1.

    Args:
        place: from the number of a pose to displacements of bodies 2, 3, …, values of scalars, places of loose points.
        twists: from those displacements to a basis of twists, ``(freedoms, 6 (bodies - 1))``.
    """

    place: Callable
    twists: Callable


def simple(place, *twists):
    """Two bodies; each twist is a function of the displacement."""
    return Allowed(
        lambda k: ([place(k)], {}, {}), lambda d: np.array([t(d[0]) for t in twists]).reshape(len(twists), 6)
    )


def angle(k):
    return ANGLES[k % len(ANGLES)]


def slide(k):
    return SLIDES[k % len(SLIDES)]


def hinge(k):
    return turn(E, angle(k), C0)


def ball(k):
    return turn(np.cos(k) * E + np.sin(2 * k) * F + np.sin(k) * G, angle(k), C0)


def tube(k):
    return after(shift(slide(k) * E), hinge(k))


HINGE = simple(hinge, lambda d: about(E))
BALL = simple(ball, *(lambda d, e=e: about(e) for e in np.eye(3)))
TUBE = simple(tube, lambda d: about(E), lambda d: along(E))
RAIL = simple(lambda k: shift(slide(k) * E), lambda d: along(E))
FIXED = simple(lambda k: STAY)
PIN = simple(  # a point on a line: free rotation about it
    lambda k: after(shift(slide(k) * E), ball(k)),
    lambda d: along(E),
    *(lambda d, e=e: about(e, moved(d, C0)) for e in np.eye(3)),
)
PLATE = simple(
    lambda k: after(shift(slide(k) * F + 0.3 * angle(k) * G), hinge(k)),
    lambda d: about(E),
    lambda d: along(F),
    lambda d: along(G),
)


# ---------------------------------------------------------------------------------------------------------------
# the cases


def spherical_shared(r):
    r.point("P", C0, 1, 2)
    r.bodies()
    return BALL


def spherical(r):
    r.point("P1", C0, 1)
    r.point("P2", C0, 2)
    r.bodies()
    r.call("spherical", "P1", "P2")
    return BALL


def revolute_point_and_vector(r):
    r.point("P", C0, 1, 2)
    r.vector("e", E, 1, 2)
    r.bodies()
    return HINGE


def revolute_two_points(r):
    r.point("P", C0, 1, 2)
    r.point("Q", C0 + 0.8 * E, 1, 2)
    r.bodies()
    return HINGE


def revolute(axis1, axis2, shared=False, back=False):
    """Axes as vectors "v" or pairs of points "p", the second one pointing back or not."""

    def build(r):
        if shared:
            r.point("P1", C0, 1, 2)
        else:
            r.point("P1", C0, 1)
            r.point("P2", C0, 2)
        axes, second = [], "P1" if shared else "P2"
        for b, form, start, s in ((1, axis1, "P1", 1.0), (2, axis2, second, -1.0 if back else 1.0)):
            if form == "v":
                r.vector(f"e{b}", s * E, b)
                axes.append(f"e{b}")
            else:
                r.point(f"Q{b}", C0 + s * (0.5 + 0.3 * b) * E, b)
                axes.append((start, f"Q{b}"))
        r.bodies()
        r.call("revolute", *(() if shared else ("P1", "P2")), axes=tuple(axes))
        return HINGE

    return build


def _lines(r, forms, drawn):
    """Lines of bodies 1 and 2 along E: "s" shares the vector, "v" has its own, "p" is two points."""
    r.point("P1", C0, 1)
    r.point("P2", C0 + drawn * E, 2)
    if forms == "s":
        r.vector("e", E, 1, 2)
        return ("P1", "e"), "P2"
    lines = []
    for b, form in zip((1, 2), forms, strict=True):
        if form == "v":
            r.vector(f"e{b}", E, b)
            lines.append((f"P{b}", f"e{b}"))
        else:
            r.point(f"Q{b}", C0 + (0.9 * b + 0.4) * E, b)
            lines.append((f"P{b}", f"Q{b}"))
    return tuple(lines)


def cylindrical(forms):
    def build(r):
        line, on = _lines(r, forms, 0.6)
        r.bodies()
        r.call("cylindrical", line=line, on=on)
        return TUBE

    return build


def prismatic(forms, form="exact", between=0.9, points=False):
    """The directions drawn at an angle `between` about the line."""

    def build(r):
        line, on = _lines(r, forms, 0.6)
        d1, d2 = F + 0.2 * E, np.cos(between) * F + np.sin(between) * G - 0.3 * E
        if points:
            r.point("D1", C0 + d1, 1)
            r.point("D2", C0 + 0.6 * E + d2, 2)
            directions = (("P1", "D1"), ("P2", "D2"))
        else:
            r.vector("d1", d1 if form == "exact" else F, 1)
            r.vector("d2", d2 if form == "exact" else np.cos(between) * F + np.sin(between) * G, 2)
            directions = ("d1", "d2")
        r.bodies()
        r.call("prismatic", line=line, on=on, directions=directions, form=form)
        return RAIL

    return build


def universal(shared, arms="vv", between=np.pi / 2):
    def build(r):
        d1, d2 = E, np.cos(between) * E + np.sin(between) * F
        second = "P1"
        if shared:
            r.point("P1", C0, 1, 2)
        else:
            r.point("P1", C0, 1)
            r.point("P2", C0, 2)
            second = "P2"
        axes = []
        for b, form, d, start in ((1, arms[0], d1, "P1"), (2, arms[1], d2, second)):
            if form == "v":
                r.vector(f"e{b}", d, b)
                axes.append(f"e{b}")
            else:
                r.point(f"Q{b}", C0 + 0.7 * d, b)
                axes.append((start, f"Q{b}"))
        r.bodies()
        r.call("universal", axes=tuple(axes), **({} if shared else {"point": "P1", "other": "P2"}))
        return simple(
            lambda k: after(turn(d1, angle(k), C0), turn(d2, angle(k + 3), C0)),
            lambda d: about(d1),
            lambda d: about(d[0] @ d2),
        )

    return build


def screw(forms, pitch, as_lead=False):
    def build(r):
        line, on = _lines(r, forms, 0.6)
        r.vector("d1", F + 0.2 * E, 1)
        r.vector("d2", np.cos(0.4) * F + np.sin(0.4) * G, 2)
        r.bodies()
        size = {"lead": 2 * np.pi * pitch} if as_lead else {"pitch": pitch}
        r.call("screw", line=line, on=on, directions=("d1", "d2"), angle="turn", distance="way", **size)

        def place(k):
            a = angle(k) + 2 * np.pi * (k % 3)
            values = {"turn": 0.4 + a, "way": 0.6 + pitch * a}
            return [after(shift(pitch * a * E), turn(E, a, C0))], values, {}

        return Allowed(place, lambda d: np.array([about(E) + pitch * along(E)]))

    return build


def planar(forms):
    def build(r):
        r.point("P1", C0, 1)
        r.point("P2", C0 + 0.6 * E + 0.3 * F, 2)
        if forms == "s":
            r.vector("e", E, 1, 2)
            plane, on = ("P1", "e"), "P2"
        else:
            r.vector("e1", E, 1)
            r.vector("e2", -E if forms == "back" else E, 2)
            plane, on = ("P1", "e1"), ("P2", "e2")
        r.bodies()
        r.call("planar", plane=plane, on=on)
        return PLATE

    return build


def slot(form):
    def build(r):
        r.point("P1", C0 - 0.5 * E, 1)
        r.point("P2", C0, 2)
        if form == "v":
            r.vector("e", E, 1)
        else:
            r.point("Q1", C0 + 1.1 * E, 1)
        r.bodies()
        r.call("slot", "P2", line=("P1", "e" if form == "v" else "Q1"))
        return PIN

    return build


def constant_velocity(shared, axes="vv"):
    def build(r):
        a1, a2 = E, np.cos(0.5) * E + np.sin(0.5) * F
        m1, m2 = F + 0.3 * E, G + 0.1 * F
        second = "P1"
        if shared:
            r.point("P1", C0, 1, 2)
        else:
            r.point("P1", C0, 1)
            r.point("P2", C0, 2)
            second = "P2"
        names = []
        for b, form, d, start in ((1, axes[0], a1, "P1"), (2, axes[1], a2, second)):
            if form == "v":
                r.vector(f"e{b}", d, b)
                names.append(f"e{b}")
            else:
                r.point(f"Q{b}", C0 + 0.7 * d, b)
                names.append((start, f"Q{b}"))
        r.vector("m1", m1, 1)
        r.vector("m2", m2, 2)
        r.bodies()
        points = {} if shared else {"point": "P1", "other": "P2"}
        r.call("constant_velocity", axes=tuple(names), marks=("m1", "m2"), **points)

        def place(k):
            bend = (0.0, 0.5, 1.2, -0.8, 1.5)[k % 5]
            towards = np.cos(bend) * a1 + np.sin(bend) * (np.cos(k) * F + np.sin(k) * G)
            rotation = swing(a1, towards) @ swing(a1, a2).T
            return rotation, C0 - rotation @ C0

        def plane(d):
            """Two directions of the bisecting plane: across the sum of both axes."""
            n = a1 + d[0] @ a2
            return np.linalg.svd(n[None])[2][1:]

        return simple(place, lambda d: about(plane(d)[0]), lambda d: about(plane(d)[1]))

    return build


def weld(*shared):
    """Bodies that share none or some of the points P, Q and the vectors e, f."""

    def build(r):
        r.point("P", C0, *((1, 2) if "P" in shared else (1,)))
        r.point("Q", C0 + 0.8 * F, *((1, 2) if "Q" in shared else (2,)))
        r.vector("e", E, *((1, 2) if "e" in shared else (2,)))
        r.vector("f", E + 0.4 * G, *((1, 2) if "f" in shared else (1,)))
        r.bodies()
        r.m.weld(r.of("joint"), r.of("body1"), r.of("body2"))
        return FIXED

    return build


def bevel(sigma, internal=False, towards=False, forms="vv"):
    """Wheels 2 and 3 on a frame, touching at a point where both rims are drawn."""

    def build(r):
        axis1 = E
        axis2 = np.cos(sigma) * E + np.sin(sigma) * F
        if sigma == 0.0:  # parallel: R1 = 0.5, R2 = 0.8
            c1, touch = C0, C0 + 0.5 * F
            c2 = C0 + (1.3 if not internal else -0.3) * F
        else:
            line = np.cos(0.4 * sigma) * E + np.sin(0.4 * sigma) * F
            touch = C0 + 1.2 * line
            c1, c2 = C0 + (1.2 * line @ axis1) * axis1, C0 + (1.2 * line @ axis2) * axis2
        if towards:
            axis2 = -axis2
        r.point("C1", c1, 1, 2)
        r.point("C2", c2, 1, 3)
        r.point("R1", touch, 2)
        r.point("R2", touch, 3)
        for name, c, d, form, wheel in (("1", c1, axis1, forms[0], 2), ("2", c2, axis2, forms[1], 3)):
            if form == "v":
                r.vector(f"e{name}", d, 1, wheel)
            else:
                r.point(f"Q{name}", c + 0.9 * d, 1, wheel)
        r.vector("g", G, 1)
        r.bodies()
        for name, form in zip("12", forms, strict=True):
            axis = f"e{name}" if form == "v" else (f"C{name}", f"Q{name}")
            r.m.angle(r.of(f"phi{name}"), at=r.of(f"C{name}"), to=r.of(f"R{name}"), start=r.of("g"), about=r.of(axis))
        r.m.bevel_gear(r.of("joint"), r.of("phi1"), r.of("phi2"), internal=internal)
        # Both rims have one velocity where they touch.
        one, other = np.cross(axis1, touch - c1), np.cross(axis2, touch - c2)
        ratio = one @ other / (other @ other)
        assert np.allclose(one, ratio * other)
        starts = [
            np.arctan2(np.cross(G, touch - c) @ a, (G - (G @ a) * a) @ (touch - c))
            for c, a in ((c1, axis1), (c2, axis2))
        ]

        def place(k):
            a = angle(k) + 2 * np.pi * (k % 3)
            values = {"phi1": starts[0] + a, "phi2": starts[1] + ratio * a}
            return [turn(axis1, a, c1), turn(axis2, ratio * a, c2)], values, {}

        return Allowed(place, lambda d: np.concatenate([about(axis1, c1), ratio * about(axis2, c2)])[None])

    return build


def rack(side=1.0, forms="vv", back=False):
    """Pinion 2 in a frame, rack 3 that shares two vectors with it."""

    def build(r):
        line = -F if back else F
        start = C0 + side * 0.5 * G - 0.8 * F
        r.point("C", C0, 1, 2)
        r.vector("e", E, 1, 2)
        r.point("R", C0 + 0.4 * F + 0.2 * G, 2)
        r.point("S", start, 1)
        r.point("T", start + 0.3 * line, 3)
        r.vector("d", line, 1, 3)
        r.vector("n", E + 0.5 * G, 1, 3)
        if "p" in forms:
            r.point("C2", C0 + 0.7 * E, 1, 2)
            r.point("S2", start + 1.1 * line, 1)
        r.bodies()
        r.m.slot(r.of("guide"), r.of("T"), (r.of("S"), r.of("d")))
        axis = "e" if forms[0] == "v" else ("C", "C2")
        r.m.angle(r.of("phi"), at=r.of("C"), to=r.of("R"), start=r.of("d"), about=r.of(axis))
        r.m.distance(r.of("s"), r.of("S"), r.of("T"), along=r.of("d") if forms[1] == "v" else r.of("S2"))
        r.m.rack_and_pinion(r.of("joint"), r.of("phi"), r.of("s"))
        speed = np.cross(E, side * 0.5 * G) @ line  # of the pinion's rim at the rack
        first = np.arctan2(0.2, 0.4) - (np.pi if back else 0.0)

        def place(k):
            a = angle(k) + 2 * np.pi * (k % 3)
            return [turn(E, a, C0), shift(speed * a * line)], {"phi": first + a, "s": 0.3 + speed * a}, {}

        return Allowed(place, lambda d: np.concatenate([about(E), speed * along(line)])[None])

    return build


def rolling(side=1.0, form="v"):
    """A disc on a line of body 1, whose axis it shares."""

    def build(r):
        r.point("S", C0 - 0.8 * F, 1)
        centre = C0 + side * 0.5 * G
        r.point("C", centre, 2)
        r.point("R", centre + 0.3 * F, 2)
        r.vector("e", E, 1, 2)
        if form == "v":
            r.vector("d", F, 1)
        else:
            r.point("S2", C0 + 0.9 * F, 1)
        r.point("K", C0)
        r.bodies()
        r.call(
            "rolling",
            centre="C",
            rim="R",
            contact="K",
            line=("S", "d" if form == "v" else "S2"),
            angle="turn",
            distance="way",
            axis="e",
        )
        first = side * np.pi / 2  # from the contact to the rim

        def place(k):
            a = angle(k) + 2 * np.pi * (k % 3)
            way = np.cross(E, centre - C0) @ F * a  # the contact stands still: ω × (centre - contact)
            body = after(shift(way * F), turn(E, a, centre))
            return [body], {"turn": first + a, "way": 0.8 + way}, {"K": C0 + way * F}

        return Allowed(place, lambda d: about(E, moved(d[0], centre) - side * 0.5 * G)[None])

    return build


# name: (builder, written rows of the joint, independent ones, coordinates that it adds, relative freedoms)
CASES = {
    "spherical, shared point": (spherical_shared, 0, 0, 0, 3),
    "spherical": (spherical, 3, 3, 0, 3),
    "revolute, shared point and vector": (revolute_point_and_vector, 0, 0, 0, 1),
    "revolute, two shared points": (revolute_two_points, 0, 0, 0, 1),
    "revolute": (revolute("v", "v"), 6, 5, 0, 1),
    "revolute, vectors back to back": (revolute("v", "v", back=True), 6, 5, 0, 1),
    "revolute, axes by points": (revolute("p", "p"), 6, 5, 0, 1),
    "revolute, axes by points back to back": (revolute("p", "p", back=True), 6, 5, 0, 1),
    "revolute, vector and points": (revolute("v", "p"), 6, 5, 0, 1),
    "revolute, shared point, points and vector": (revolute("p", "v", shared=True), 3, 2, 0, 1),
    "cylindrical, shared vector": (cylindrical("s"), 3, 2, 0, 2),
    "cylindrical": (cylindrical("vv"), 6, 4, 0, 2),
    "cylindrical by points": (cylindrical("pp"), 6, 4, 0, 2),
    "cylindrical, vector and points": (cylindrical("vp"), 6, 4, 0, 2),
    "cylindrical, points and vector": (cylindrical("pv"), 6, 4, 0, 2),
    "prismatic, shared vector": (prismatic("s", points=True), 4, 3, 0, 1),
    "prismatic, shared vector, text": (prismatic("s", "text"), 4, 3, 0, 1),
    "prismatic": (prismatic("vv"), 7, 5, 0, 1),
    "prismatic, text": (prismatic("vv", "text"), 7, 5, 0, 1),
    "prismatic by points": (prismatic("pp"), 7, 5, 0, 1),
    "prismatic by points, text": (prismatic("pp", "text"), 7, 5, 0, 1),
    "prismatic, parallel directions": (prismatic("vv", between=0.0), 7, 5, 0, 1),
    "prismatic, opposite directions": (prismatic("pp", between=np.pi), 7, 5, 0, 1),
    "prismatic, perpendicular directions": (prismatic("s", between=np.pi / 2), 4, 3, 0, 1),
    "prismatic, perpendicular directions, text": (prismatic("s", "text", np.pi / 2), 4, 3, 0, 1),
    "universal, shared point": (universal(True), 1, 1, 0, 2),
    "universal": (universal(False), 4, 4, 0, 2),
    "universal, arms by points": (universal(True, "pp"), 1, 1, 0, 2),
    "universal, arms at 50°": (universal(False, "vp", np.radians(50)), 4, 4, 0, 2),
    "screw, shared vector": (screw("s", 0.2), 6, 5, 2, 1),
    "screw, left-handed": (screw("vv", -0.35, True), 9, 7, 2, 1),
    "screw by points": (screw("pp", 0.1, True), 9, 7, 2, 1),
    "planar, shared normal": (planar("s"), 1, 1, 0, 3),
    "planar": (planar("vv"), 4, 3, 0, 3),
    "planar, normals back to back": (planar("back"), 4, 3, 0, 3),
    "slot": (slot("v"), 3, 2, 0, 4),
    "slot by points": (slot("p"), 3, 2, 0, 4),
    "constant velocity, shared point": (constant_velocity(True), 1, 1, 0, 2),
    "constant velocity": (constant_velocity(False), 4, 4, 0, 2),
    "constant velocity, axes by points": (constant_velocity(False, "pv"), 4, 4, 0, 2),
    "weld": (weld(), 9, 6, 0, 0),
    "weld, shared point": (weld("P"), 6, 3, 0, 0),
    "weld, shared vector": (weld("e"), 6, 4, 0, 0),
    "weld, shared point and vector": (weld("P", "e"), 3, 1, 0, 0),
    "weld, two shared points": (weld("P", "Q"), 3, 1, 0, 0),
    "weld, two shared vectors": (weld("e", "f"), 3, 3, 0, 0),
    "bevel gear, 90°": (bevel(np.pi / 2), 1, 1, 0, 1),
    "bevel gear, 60°": (bevel(np.pi / 3), 1, 1, 0, 1),
    "bevel gear, 110°, axes by points": (bevel(np.radians(110), forms="pp"), 1, 1, 0, 1),
    "bevel gear, one axis towards the other": (bevel(np.pi / 3, towards=True, forms="vp"), 1, 1, 0, 1),
    "bevel gear, parallel axes": (bevel(0.0), 1, 1, 0, 1),
    "bevel gear, parallel axes back to back": (bevel(0.0, towards=True), 1, 1, 0, 1),
    "bevel gear, internal": (bevel(0.0, internal=True), 1, 1, 0, 1),
    "rack and pinion": (rack(), 1, 1, 0, 1),
    "rack and pinion on the other side": (rack(-1.0), 1, 1, 0, 1),
    "rack and pinion, line back": (rack(back=True), 1, 1, 0, 1),
    "rack and pinion by points": (rack(forms="pp"), 1, 1, 0, 1),
    "rolling": (rolling(), 9, 8, 5, 1),
    "rolling on the other side, by points": (rolling(-1.0, "p"), 9, 8, 5, 1),
}
