"""Open chains and the pantograph: mechanisms with more than one input that place a point."""

import math
from collections.abc import Sequence

from jaxnc.calls import public
from jaxnc.errors import MechanismError, brief
from jaxnc.library.drawing import carried, drive, meet, number, place, polar, positive
from jaxnc.mechanism import Mechanism


@public
def planar_3r(
    lengths: Sequence[float] = (0.5, 0.4, 0.2),
    angles: Sequence[float] = (0.6, 0.5, 0.4),
    relative: bool = True,
) -> Mechanism:
    """Planar robot of three links A-B-C-P with three revolute joints, an open chain.

    n = 9, rows = 6, rank 6, g = 3. Inputs ``phi1``, ``phi2``, ``phi3``, the angles of its joints; or, by way of the
    inverse problem, coordinates of the tip such as ``P.x``, ``P.y`` with one angle.

    Args:
        lengths: lengths A-B, B-C and C-P, A the origin.
        angles: the three angles of the drawing, radians.
        relative: measure each angle from the link before (the first from the x axis); otherwise all from the x axis.

    Returns:
        The mechanism. The default drive folds the arm by a radian at every joint.

    Raises:
        MechanismError: for a length that is not positive, or not three of them.

    Source: source text, fig. 1.
    """
    what = "planar_3r"
    for name, value in (("lengths", lengths), ("angles", angles)):
        if not hasattr(value, "__len__") or len(value) != 3:
            raise MechanismError(f"{what}: {name} must be three numbers, got {brief(value)}")
    lengths = positive(what, **{f"lengths[{i}]": value for i, value in enumerate(lengths)})
    angles = number(what, **{f"angles[{i}]": value for i, value in enumerate(angles)})
    m = Mechanism("planar 3R", description="Planar robot with three revolute joints.")
    at, direction = (0.0, 0.0), 0.0
    names = ("A", "B", "C", "P")
    m.ground("A", at)
    for i, name in enumerate(names[1:]):
        direction = direction + angles[i] if relative else angles[i]
        at = polar(at, lengths[i], direction)
        m.point(name, at)
    for i in range(3):
        m.body(f"link{i + 1}", [names[i], names[i + 1]])
        before = (names[i - 1], names[i]) if relative and i else None
        m.angle(f"phi{i + 1}", to=(names[i], names[i + 1]), start=before)
    ranges = {f"phi{i + 1}": (angle, angle + 1.0) for i, angle in enumerate(angles)}
    return drive(m, ["P"], ranges)


@public
def pantograph(
    arm1: float = 0.3,
    arm2: float = 0.25,
    ratio: float = 2.0,
    tracer: tuple[float, float] = (0.3, 0.2),
) -> Mechanism:
    """Pantograph: Q copies the motion of the tracer P, enlarged about the pivot O.

    Arm O-A-B, arm B-C-Q, parallelogram A-P-C-B; O, P and Q stay on one line and OQ = ratio · OP. n = 10, rows = 8, rank
    8, g = 2. Inputs ``P.x`` and ``P.y``; the default drive moves the tracer along a short slanting line.

    Args:
        arm1: length O-A, O the origin; O-B is `ratio` times as long.
        arm2: length A-P; B-Q is `ratio` times as long.
        ratio: enlargement, greater than one.
        tracer: place (x, y) of P in the drawing, lengths.

    Raises:
        MechanismError: for a length that is not positive, a ratio of one or less, or a tracer out of reach.

    Source: C. Scheiner (1603); I. I. Artobolevsky, Mechanisms in Modern Engineering Design, volume 1.
    """
    what = "pantograph"
    arm1, arm2, ratio = positive(what, arm1=arm1, arm2=arm2, ratio=ratio)
    p = place(what, "tracer", tracer)
    if ratio <= 1:
        raise MechanismError(f"{what}: ratio = {ratio:g} must be greater than 1 for A to lie between O and B")
    o = (0.0, 0.0)
    a = meet(what, o, p, 1.0, arm1=arm1, arm2=arm2)
    b = carried(o, a, ratio * arm1, 0.0)
    m = Mechanism("pantograph", description="Pantograph: Q draws what P traces, enlarged.")
    m.ground("O", o)
    m.point("A", a)
    m.point("B", b)
    m.point("C", (b[0] + p[0] - a[0], b[1] + p[1] - a[1]))
    m.point("P", p)
    m.point("Q", (ratio * p[0], ratio * p[1]))
    m.body("arm1", ["O", "B", "A"])
    m.body("arm2", ["B", "Q", "C"])
    m.body("side1", ["A", "P"])
    m.body("side2", ["C", "P"])
    reach = math.hypot(*p)
    away = 0.35 * min(arm1 + arm2 - reach, reach - abs(arm1 - arm2))
    return drive(m, ["P", "Q"], {"P.x": (p[0] - away, p[0] + away), "P.y": (p[1] - away, p[1] + away)})
