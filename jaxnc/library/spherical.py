"""Mechanisms whose links turn about one point: the spherical four-bar and the wobble plate."""

import math

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import MechanismError
from jaxnc.library.drawing import FLAT, TURN, choice, drive, number, positive, travel
from jaxnc.library.space import Vector, X, Y, Z, turned
from jaxnc.mechanism import Mechanism


@public
def spherical_four_bar(
    crank: float = 0.5,
    coupler: float = 1.2,
    rocker: float = 1.0,
    ground: float = 1.3,
    branch: str = "open",
    angle: float = 1.0,
    radius: float = 0.1,
) -> Mechanism:
    """Spherical four-bar: four revolute joints whose axes meet at the point O.

    Axes vA and vD on the ground, vB and vC between crank, coupler and rocker. n = 8, rows = 7, rank 7, g = 1.
    Coordinates ``phi``, the angle of the crank about vA from the direction of vD to that of vB, and ``psi``, that of
    the rocker about vD from the drawing. Markers B and C on crank and rocker show the axes on a sphere. The default
    drive of ``phi`` covers a full turn where the crank has one, otherwise its range.

    Args:
        crank: angle between vA and vB, radians, between 0 and π.
        coupler: angle between vB and vC, radians.
        rocker: angle between vC and vD, radians.
        ground: angle between vD and vA, radians.
        branch: ``"open"`` draws vC to the left of the way from vB to vD as seen from outside, ``"crossed"`` to the
            right.
        angle: crank angle of the drawing, radians.
        radius: of the sphere on which the markers are, a length.

    Raises:
        MechanismError: for an angle outside its range, an unknown branch, or links that do not close.

    Source: C. H. Chiang, Kinematics of Spherical Mechanisms; source text, §4.1 (vectors) and §4.2.2.
    """
    what = "spherical_four_bar"
    crank, coupler, rocker, ground = positive(what, crank=crank, coupler=coupler, rocker=rocker, ground=ground)
    (radius,) = positive(what, radius=radius)
    (angle,) = number(what, angle=angle)
    side = 1.0 if choice(what, "branch", branch, ("open", "crossed")) == "open" else -1.0
    for name, value in (("crank", crank), ("coupler", coupler), ("rocker", rocker), ("ground", ground)):
        if value >= math.pi:
            raise MechanismError(f"{what}: {name} = {value:g} must be between 0 and π")
    v_d = turned(Z, Y, ground)

    def draw(phi: float) -> tuple[Vector, Vector]:
        v_b = turned(turned(Z, Y, crank), Z, phi)
        cosine, p, q = float(v_b @ v_d), math.cos(coupler), math.cos(rocker)
        area = 1.0 - cosine**2
        a, b = (p - q * cosine, q - p * cosine) if area > 0 else (math.inf, math.inf)
        square = area - p * p - q * q + 2.0 * p * q * cosine
        if square <= 0 or math.sqrt(square) <= FLAT * math.sin(coupler) * math.sin(rocker):
            raise MechanismError(
                f"{what}: coupler = {coupler:g} and rocker = {rocker:g} do not close over {math.acos(cosine):g}; "
                f"change one of them, or start from another angle"
            )
        return v_b, (a * v_b + b * v_d + side * math.sqrt(square) * np.cross(v_b, v_d)) / area

    v_b, v_c = draw(angle)
    m = Mechanism("spherical four-bar", dim=3, description="Four hinges whose axes meet at one point.")
    m.ground("O", (0.0, 0.0, 0.0))
    m.ground_vector("vA", Z)
    m.ground_vector("vD", v_d)
    m.vector("vB", v_b)
    m.vector("vC", v_c)
    m.body("crank", ["O"], vectors=["vA", "vB"])
    m.body("coupler", ["O"], vectors=["vB", "vC"])
    m.body("rocker", ["O"], vectors=["vC", "vD"])
    m.marker("B", on="crank", at=radius * v_b)
    m.marker("C", on="rocker", at=radius * v_c)
    m.angle("phi", start="vD", to="vB", about="vA")
    m.angle("psi", to="vC", about="vD")
    return drive(m, ["psi", "C"], {"phi": travel(draw, angle)})


@public
def wobble_plate(
    radius: float = 0.04, tilt: float = 0.35, rod: float = 0.08, guide: float = 0.05, pistons: int = 5
) -> Mechanism:
    """Wobble plate: a shaft with an inclined journal makes a plate nutate, which moves pistons along the shaft.

    The shaft turns about vk, the z axis, and carries the journal vn, inclined by the tilt, on which the plate turns
    freely; the ball G of the plate slides in a groove in the plane xz, which keeps the plate from turning along. Rods
    with ball joints lead from the places P1, P2, … of the plate to the pistons Q1, Q2, …, which move along z. With five
    pistons n = 26, rows = 25, rank 25, g = 1; every piston more or less is four of each. Coordinate and input ``phi``,
    the rotation of the shaft from the drawing; the default drive is a full turn. Dimensions are of no machine in
    particular.

    Args:
        radius: of the circle of the rods' joints on the plate and of the pistons, a length.
        tilt: angle of the journal to the shaft, radians, between 0 and π/2.
        rod: length of the rods.
        guide: distance of the ball G from the centre O, a length.
        pistons: how many pistons.

    Raises:
        MechanismError: for a length that is not positive, a tilt outside its range, a rod that is too short, no piston.
    """
    what = "wobble_plate"
    radius, rod, guide = positive(what, radius=radius, rod=rod, guide=guide)
    (tilt,) = number(what, tilt=tilt)
    if not 0.0 < tilt < 0.5 * math.pi:
        raise MechanismError(f"{what}: tilt = {tilt:g} must be between 0 and π/2")
    if not isinstance(pistons, int) or pistons < 1:
        raise MechanismError(f"{what}: pistons must be a whole number of at least 1, got {pistons!r}")
    normal = math.sin(tilt) * X + math.cos(tilt) * Z
    level = math.cos(tilt) * X - math.sin(tilt) * Z
    m = Mechanism("wobble plate", dim=3, description="An inclined journal makes a plate nutate and pistons move.")
    m.ground("O", (0.0, 0.0, 0.0))
    m.ground_vector("vk", Z)
    m.vector("vn", normal)
    m.point("G", guide * level, fixed="y")
    joints: list[str] = []
    for k in range(pistons):
        around = (k + 0.5) * TURN / pistons
        on_plate = radius * (math.cos(around) * level + math.sin(around) * Y)
        piston = radius * (math.cos(around) * X + math.sin(around) * Y)
        off = math.dist(on_plate[:2], piston[:2])
        if rod <= 1.2 * radius * (1.0 - math.cos(tilt)):
            raise MechanismError(f"{what}: rod = {rod:g} is too short for radius = {radius:g} and tilt = {tilt:g}")
        piston[2] = on_plate[2] - math.sqrt(rod**2 - off**2)
        joints.append(m.point(f"P{k + 1}", on_plate))
        m.point(f"Q{k + 1}", piston, fixed="xy")
    m.body("shaft", ["O"], vectors=["vk", "vn"])
    m.body("plate", ["O", "G", *joints], vectors=["vn"])
    for k in range(pistons):
        m.body(f"rod{k + 1}", [f"P{k + 1}", f"Q{k + 1}"])
    m.angle("phi", to="vn", about="vk")
    return drive(m, ["Q1.z", "P1"], {"phi": (0.0, TURN)})
