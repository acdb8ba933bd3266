"""Five-bar linkages: with two inputs, and with the two cranks geared together."""

from collections.abc import Callable

from jaxnc.calls import public
from jaxnc.library.drawing import Point, choice, drive, meet, number, polar, positive, travel
from jaxnc.mechanism import Mechanism


@public
def five_bar(
    crank1: float = 0.1,
    coupler1: float = 0.3,
    coupler2: float = 0.3,
    crank2: float = 0.1,
    ground: float = 0.25,
    angle1: float = 1.0,
    angle2: float = 2.0,
    branch: str = "open",
) -> Mechanism:
    """Five-bar linkage A-B-C-D-E with ground pivots A at the origin and E on the x axis, and two inputs.

    n = 8, rows = 6, rank 6, g = 2. Inputs ``phi``, the angle of the crank AB, and ``psi``, that of the crank ED, both
    from the x axis. The default drive turns the second crank twice as fast as the first, once round if it can.

    Args:
        crank1: length A-B.
        coupler1: length B-C.
        coupler2: length C-D.
        crank2: length D-E.
        ground: length A-E.
        angle1: angle phi of the drawing, radians.
        angle2: angle psi of the drawing, radians.
        branch: ``"open"`` draws C to the left of the way from B to D, ``"crossed"`` to the right.

    Raises:
        MechanismError: for a length that is not positive, an unknown branch, or couplers that do not reach each other.

    Source: R. L. Norton, Design of Machinery, five-bar mechanisms.
    """
    m, draw = _five_bar("five_bar", crank1, coupler1, coupler2, crank2, ground, angle1, angle2, branch)
    m.model.description = "Five-bar linkage: two cranks place the joint C of the two couplers."
    start, end = travel(lambda t: draw(angle1 + t, angle2 + 2.0 * t), 0.0)
    return drive(m, ["C"], {"phi": (angle1 + start, angle1 + end), "psi": (angle2 + 2.0 * start, angle2 + 2.0 * end)})


@public
def geared_five_bar(
    radius1: float = 0.16,
    radius2: float = 0.08,
    crank1: float = 0.1,
    coupler1: float = 0.3,
    coupler2: float = 0.3,
    crank2: float = 0.06,
    angle1: float = 1.0,
    angle2: float = 2.0,
    branch: str = "open",
) -> Mechanism:
    """Geared five-bar A-B-C-D-E: the cranks AB and ED are fixed to two gear wheels in mesh.

    n = 8, rows = 7, rank 7, g = 1. Input ``phi``, the angle of the crank AB from the x axis; ``psi``, that of the crank
    ED, follows by ``R1 φ + R2 ψ = c``. The default drive is a turn of the first crank if it has one, otherwise its
    range.

    Args:
        radius1: pitch radius of the wheel at A, a length.
        radius2: pitch radius of the wheel at E, a length; A-E is the sum of both.
        crank1: length A-B.
        coupler1: length B-C.
        coupler2: length C-D.
        crank2: length D-E.
        angle1: angle phi of the drawing, radians.
        angle2: angle psi of the drawing, radians; the phase of the gears follows from both.
        branch: ``"open"`` draws C to the left of the way from B to D, ``"crossed"`` to the right.

    Raises:
        MechanismError: for a length that is not positive, an unknown branch, or couplers that do not reach each other.

    Source: R. L. Norton, Design of Machinery, geared five-bar mechanisms; gear relation (47).
    """
    what = "geared_five_bar"
    radius1, radius2 = positive(what, radius1=radius1, radius2=radius2)
    m, draw = _five_bar(what, crank1, coupler1, coupler2, crank2, radius1 + radius2, angle1, angle2, branch)
    m.model.description = "Five-bar linkage whose two cranks are geared together."
    m.gear("mesh", "phi", "psi", radii=(radius1, radius2))
    ratio = radius1 / radius2
    start, end = travel(lambda t: draw(angle1 + t, angle2 - ratio * t), 0.0)
    return drive(m, ["C"], {"phi": (angle1 + start, angle1 + end)})


def _five_bar(
    what: str,
    crank1: float,
    coupler1: float,
    coupler2: float,
    crank2: float,
    ground: float,
    angle1: float,
    angle2: float,
    branch: str,
) -> tuple[Mechanism, Callable[[float, float], tuple[Point, Point, Point]]]:
    """The linkage, named `what` with spaces, and the closed form that draws it at two angles."""
    crank1, coupler1, coupler2, crank2, ground = positive(
        what, crank1=crank1, coupler1=coupler1, coupler2=coupler2, crank2=crank2, ground=ground
    )
    angle1, angle2 = number(what, angle1=angle1, angle2=angle2)
    side = 1.0 if choice(what, "branch", branch, ("open", "crossed")) == "open" else -1.0
    a, e = (0.0, 0.0), (ground, 0.0)

    def draw(phi: float, psi: float) -> tuple[Point, Point, Point]:
        b, d = polar(a, crank1, phi), polar(e, crank2, psi)
        return b, meet(what, b, d, side, coupler1=coupler1, coupler2=coupler2), d

    m = Mechanism(what.replace("_", " "))
    m.ground("A", a)
    m.ground("E", e)
    for name, at in zip("BCD", draw(angle1, angle2), strict=True):
        m.point(name, at)
    m.body("crank1", ["A", "B"])
    m.body("coupler1", ["B", "C"])
    m.body("coupler2", ["C", "D"])
    m.body("crank2", ["D", "E"])
    m.angle("phi", at="A", to="B")
    m.angle("psi", at="E", to="D")
    return m, draw
