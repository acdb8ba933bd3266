"""Front suspensions of passenger cars: MacPherson strut (fig. 42), double wishbone, five links; the left wheel.

Axes of ISO 8855: x forward, y to the left, z up; the origin is on the road below the middle of the front axle. Lengths
are in millimetres. `jaxnc.suspension` turns a motion of any of them into camber, toe, caster and the rest.
"""

import math
from collections.abc import Mapping
from itertools import combinations
from typing import Literal

import numpy as np

from jaxnc.library.drawing import Length, Misfit, Vector, Z, across_axis, as_places, check_apart, drive, lay_out, offer
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism.model import Place
from jaxnc.vehicle.hardpoints import FIGURE_42

_RADIUS = 310.0  # mm, of the loaded tyre
_UNITS = {"length_unit": "mm", "angle_unit": "deg"}
_DERIVED = ("4", "7", "9", "v3")  # hardpoints of figure 42 that follow from others unless they are given
_ROD = {"4": 0.35, "9": 0.62}  # where the strut's inner ends are drawn, as a part of the way from 3 to 8

_DOUBLE_WISHBONE = {
    "lower_front": (130.0, 360.0, 170.0),
    "lower_rear": (-190.0, 370.0, 165.0),
    "lower_ball": (8.0, 720.0, 155.0),
    "upper_front": (90.0, 440.0, 480.0),
    "upper_rear": (-150.0, 450.0, 465.0),
    "upper_ball": (-22.0, 655.0, 500.0),
    "tie_inner": (130.0, 370.0, 205.0),
    "tie_outer": (120.0, 705.0, 200.0),
    "wheel_centre": (0.0, 765.0, 310.0),
    "spindle": (0.2, 865.0, 310.9),
    "damper_lower": (-15.0, 580.0, 165.0),
    "damper_top": (-40.0, 480.0, 640.0),
}
_FIVE_LINK = {
    "lower_front_inner": (20.0, 385.0, 195.0),
    "lower_front_outer": (35.0, 715.0, 170.0),
    "lower_rear_inner": (-330.0, 400.0, 205.0),
    "lower_rear_outer": (-25.0, 700.0, 165.0),
    "upper_front_inner": (150.0, 480.0, 560.0),
    "upper_front_outer": (5.0, 690.0, 590.0),
    "upper_rear_inner": (-200.0, 470.0, 545.0),
    "upper_rear_outer": (-45.0, 685.0, 585.0),
    "tie_inner": (165.0, 390.0, 250.0),
    "tie_outer": (160.0, 705.0, 240.0),
    "wheel_centre": (0.0, 770.0, 310.0),
    "spindle": (0.2, 870.0, 310.9),
    "damper_lower": (0.0, 665.0, 200.0),
    "damper_top": (-30.0, 520.0, 720.0),
}
_MACPHERSON = {
    "lower_front": (15.0, 375.0, 215.0),
    "lower_rear": (-300.0, 385.0, 225.0),
    "lower_ball": (12.0, 715.0, 190.0),
    "strut_lower": (-8.0, 640.0, 420.0),
    "strut_top": (-35.0, 565.0, 860.0),
    "tie_inner": (-133.9, 360.0, 264.2),
    "tie_outer": (-135.0, 690.0, 244.0),
    "wheel_centre": (0.0, 760.0, 310.0),
    "spindle": (0.2, 860.0, 310.9),
}
_NUMBERS = {**FIGURE_42, "v1": "lower_front", "v2": "spindle"}


@offer
def macpherson(
    hardpoints: Mapping[str, Place] | None = None, radius: Length = _RADIUS, form: Literal["text", "exact"] = "text"
) -> Mechanism:
    """MacPherson suspension with its tie rod, figure 42: n = 29, rows = 28, rank 26, g = 3.

    Basic points as the text numbers them: 1 of the lower arm on the body, v1 its axis; 2 the lower ball joint; 3 and 4
    the axis of the strut in the knuckle; 5 and 10 the outer and the inner end of the tie rod, 10 sliding along y only;
    6 the wheel's centre, 7 a point of its rim, v2 its spin axis; 8 the strut's mount on the body, 9 the lower end of
    its rod, v3 across it. ``s`` is the distance from 4 to 9. The marker ``contact`` is where the wheel is drawn to
    touch the road. Inputs: ``6.z`` (bump), ``10.y`` (steer, the rack), and the wheel's spin, which is held by
    ``7.x``; the default drive moves the wheel centre 80 mm down and up.

    Moving point 8 of a compiled system moves the mount and leaves the knuckle as it is; to redesign the strut's axis
    move 3, 4, 8 and 9 together, as this function does.

    Args:
        hardpoints: places of points and directions of vectors by the numbers above, or as designers call them:
            ``lower_front`` (point 1) and ``lower_rear``, whose line is v1, ``lower_ball`` (2), ``strut_lower`` (3),
            ``strut_top`` (8), ``tie_outer`` (5), ``tie_inner`` (10), ``wheel_centre`` (6) and ``spindle``, another
            point of the spin axis v2, outboard. Millimetres. Those not given have their default place; 4 and 9 are on
            the line from 3 to 8, 7 above 6 and v3 across v2 and the strut.
        radius: of the loaded tyre, mm: from the wheel centre to the ground.
        form: ``"text"``: the equations (158)-(185); ``"exact"``: as many that keep their rank in every pose and admit
            no mirror image.

    Raises:
        MechanismError: an unknown hardpoint, one given twice under different names, a place that is not three finite
            numbers, or two joints at the same place.

    Source: source text, §4.4, example 2, (158)-(185).
    """
    given = as_places(hardpoints, dict.fromkeys((*_MACPHERSON, *_NUMBERS, *_DERIVED)), 3, "hardpoints")
    for number, name in _NUMBERS.items():
        if number in given and name in given and number != "v1":
            raise Misfit(f"hardpoints {number!r} and {name!r} are the same; give one of them")
    for name, number in (("lower_rear", "v1"), ("lower_front", "v1"), ("spindle", "v2")):
        if number in given and name in given:
            raise Misfit(f"hardpoint {name!r} is there to draw {number!r}; give one of them")
    at = {name: np.array(place) for name, place in _MACPHERSON.items()} | given
    p = {number: at[name] for number, name in _NUMBERS.items() if number[0] != "v"}
    p |= {"v1": at["lower_front"] - at["lower_rear"], "v2": at["spindle"] - at["wheel_centre"]}
    p |= {name: place for name, place in given.items() if name in p}
    check_apart(p, ("1", "2"), ("2", "3"), ("3", "8"), ("5", "10"), ("2", "5"))
    up = _up(p["v2"])
    p |= {name: p["3"] + part * (p["8"] - p["3"]) for name, part in _ROD.items()}
    p |= {"7": p["6"] + radius * up, "v3": np.cross(p["8"] - p["3"], p["v2"])}
    p |= {name: given[name] for name in _DERIVED if name in given}
    said = "Strut suspension of a front left wheel, with tie rod and rack (figure 42)."
    ground = {name: p[name] for name in ("1", "8", "v1")}
    moving = {name: p[name] for name in ("2", "3", "4", "5", "6", "7", "9", "10", "v2", "v3")}
    m = lay_out("MacPherson suspension", said, ground, moving, {"arm": "1 2 v1"}, {"10": "xz"}, **_UNITS)
    m.body("knuckle", ["3", "2", "4", "6", "5"], vectors=["v2"], form=form)
    m.body("strut", ["8", "9"], vectors=["v3"])
    m.body("tie rod", ["5", "10"])
    m.body("wheel", ["6", "7"], vectors=["v2"])
    m.prismatic("damper", line=("3", "4"), on=("8", "9"), directions=("v2", "v3"), form=form)
    m.distance("s", "4", "9")
    return _drive_bump(m, p["6"], radius * up, "6", ["10.y", "7.x"], "s")


@offer
def double_wishbone(hardpoints: Mapping[str, Place] | None = None, radius: Length = _RADIUS) -> Mechanism:
    """Double wishbone suspension with its tie rod: n = 23, rows = 20, rank 20, g = 3.

    The lower arm turns about lower_front, lower_rear and carries lower_ball and damper_lower; the upper arm turns
    about upper_front, upper_rear and carries upper_ball; the knuckle holds both balls, tie_outer, and the spin axis
    through wheel_centre and spindle, about which the wheel turns with its point ``rim``; tie_inner slides along y only.
    ``damper`` is the distance from damper_lower to damper_top. The marker ``contact`` is where the wheel is drawn to
    touch the road. Inputs: ``wheel_centre.z`` (bump), ``tie_inner.y`` (steer, the rack), and the wheel's spin, which is
    held by ``rim.x``; the default drive moves the wheel centre 80 mm down and up.

    Args:
        hardpoints: places of points by the names above, millimetres; those not given have their default place, rim
            above the wheel's centre.
        radius: of the loaded tyre, mm: from the wheel centre to the ground.

    Raises:
        MechanismError: an unknown hardpoint, a place that is not three finite numbers, or two joints of one body at the
            same place.

    Source: W. F. Milliken and D. L. Milliken, Race Car Vehicle Dynamics, chapter 17.
    """
    bodies = {
        "lower arm": "lower_front lower_rear lower_ball damper_lower",
        "upper arm": "upper_front upper_rear upper_ball",
        "knuckle": "lower_ball upper_ball tie_outer wheel_centre spindle",
        "tie rod": "tie_outer tie_inner",
        "wheel": "wheel_centre spindle rim",
    }
    said = "Two arms, tie rod and rack of a front left wheel."
    ground = ("lower_front", "lower_rear", "upper_front", "upper_rear", "damper_top")
    return _outboard("double wishbone", said, _DOUBLE_WISHBONE, hardpoints, bodies, ground, radius)


@offer
def five_link(hardpoints: Mapping[str, Place] | None = None, radius: Length = _RADIUS) -> Mechanism:
    """Five-link suspension, four links and a tie rod between body and knuckle: n = 29, rows = 26, rank 26, g = 3.

    The links lower_front, lower_rear, upper_front and upper_rear run from their ``_inner`` to their ``_outer`` end. No
    two ball joints are on the steering axis, which is that about which the knuckle turns as the rack moves, and which
    `jaxnc.suspension` finds where ``tie_inner.y`` is driven or held. The knuckle also holds tie_outer, damper_lower and
    the spin axis through wheel_centre and spindle, about which the wheel turns with its point ``rim``; tie_inner slides
    along y only.
    ``damper`` is the distance from damper_lower to damper_top. The marker ``contact`` is where the wheel is drawn to
    touch the road. Inputs: ``wheel_centre.z`` (bump), ``tie_inner.y`` (steer, the rack), and the wheel's spin, which is
    held by ``rim.x``; the default drive moves the wheel centre 80 mm down and up.

    Args:
        hardpoints: places of points by the names above, millimetres; those not given have their default place, rim
            above the wheel's centre.
        radius: of the loaded tyre, mm: from the wheel centre to the ground.

    Raises:
        MechanismError: an unknown hardpoint, a place that is not three finite numbers, or two joints of one body at the
            same place.

    Source: W. Matschinsky, Road Vehicle Suspensions, chapters 2 and 3.
    """
    links = ("lower_front", "lower_rear", "upper_front", "upper_rear")
    bodies = {name.replace("_", " ") + " link": f"{name}_inner {name}_outer" for name in links}
    bodies["knuckle"] = " ".join(f"{name}_outer" for name in links) + " tie_outer wheel_centre spindle damper_lower"
    bodies |= {"tie rod": "tie_outer tie_inner", "wheel": "wheel_centre spindle rim"}
    ground = (*(f"{name}_inner" for name in links), "damper_top")
    said = "Four links, tie rod and rack of a front left wheel that steers about a moving axis."
    return _outboard("five-link", said, _FIVE_LINK, hardpoints, bodies, ground, radius)


def _outboard(
    kind: str,
    said: str,
    drawn: Mapping[str, Place],
    given: Mapping[str, Place] | None,
    bodies: dict[str, str],
    ground: tuple[str, ...],
    radius: float,
) -> Mechanism:
    """Lay out a suspension whose knuckle holds wheel_centre, spindle and tie_outer, with its damper and contact."""
    p = {name: np.array(place) for name, place in drawn.items()} | as_places(
        given, {**drawn, "rim": ()}, 3, "hardpoints"
    )
    for names in bodies.values():
        check_apart(p, *combinations([name for name in names.split() if name in p], 2))
    up = _up(p["spindle"] - p["wheel_centre"])
    p.setdefault("rim", p["wheel_centre"] + radius * up)
    last = ("rim", "damper_lower", "tie_inner")
    moving = {name: p[name] for name in (*(n for n in p if n not in (*last, *ground)), *last)}
    fixed = {"tie_inner": "xz"}
    m = lay_out(f"{kind} suspension", said, {n: p[n] for n in ground}, moving, bodies, fixed, **_UNITS)
    m.distance("damper", "damper_lower", "damper_top")
    return _drive_bump(m, p["wheel_centre"], radius * up, "wheel_centre", ["tie_inner.y", "rim.x"], "damper")


def _drive_bump(m: Mechanism, wheel: Vector, below: Vector, centre: str, hold: list[str], length: str) -> Mechanism:
    """Mark the contact, and store the default drive: the wheel centre down and up, rack and spin of the wheel held."""
    m.marker("contact", on="knuckle", at=wheel - below)
    height = float(wheel[2])
    travel = 80.0  # mm, of the wheel centre up and down
    drive(m, [length, "contact"], {f"{centre}.z": (height - travel, height + travel)})
    m.model.run.hold = hold
    return m


def _up(axis: Vector) -> Vector:
    """Upward unit vector in the plane of a wheel."""
    size = float(np.linalg.norm(axis))
    if size == 0.0 or math.hypot(axis[0], axis[1]) <= 1e-6 * size:
        raise Misfit("the wheel's spin axis is drawn vertical or without length; draw it across the car")
    return across_axis(Z, axis / size)
