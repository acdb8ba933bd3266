"""Gear pairs."""

from jaxnc.calls import public
from jaxnc.errors import MechanismError
from jaxnc.library.drawing import TURN, drive, number, polar, positive
from jaxnc.mechanism import Mechanism


@public
def gear_pair(radius1: float = 0.1, radius2: float = 0.2, internal: bool = False, angle: float = 0.5) -> Mechanism:
    """Two gear wheels in mesh, with centres A at the origin and B on the x axis.

    n = 6, rows = 5, rank 5, g = 1 as in (43)-(47). Coordinates ``phi``, the angle of the first wheel's mark P1 from the
    direction A-B, and ``psi``, that of the second wheel's mark P2 from the direction B-A; both anticlockwise, so that
    ``R1 φ + R2 ψ = 0`` for wheels outside each other and ``R1 φ - R2 ψ = 0`` for one inside the other. Input ``phi``;
    the default drive is two turns of the first wheel.

    Args:
        radius1: pitch radius of the first wheel, a length.
        radius2: pitch radius of the second wheel, a length.
        internal: mesh inside the larger wheel.
        angle: angle phi of the drawing, radians.

    Raises:
        MechanismError: for a radius that is not positive, or equal radii of an internal pair.

    Source: source text, fig. 19, (43)-(47); signs after erratum 7 of its catalogue (signed angles).
    """
    what = "gear_pair"
    radius1, radius2 = positive(what, radius1=radius1, radius2=radius2)
    (angle,) = number(what, angle=angle)
    if internal and radius1 == radius2:
        raise MechanismError(
            f"{what}: radius1 and radius2 are both {radius1:g}; an internal pair needs different radii"
        )
    distance = abs(radius2 - radius1) if internal else radius1 + radius2
    other = (1.0 if internal else -1.0) * angle * radius1 / radius2
    m = Mechanism("gear pair", description="Two wheels in mesh: the angles they turn by are inverse to their radii.")
    m.ground("A", (0.0, 0.0))
    m.ground("B", (distance, 0.0))
    m.point("P1", polar((0.0, 0.0), radius1, angle))
    m.point("P2", polar((distance, 0.0), -radius2, other))
    m.body("wheel1", ["A", "P1"])
    m.body("wheel2", ["B", "P2"])
    m.angle("phi", at="A", to="P1", start="B")
    m.angle("psi", at="B", to="P2", start="A")
    m.gear("mesh", "phi", "psi", internal=internal)
    return drive(m, ["psi"], {"phi": (0.0, 2.0 * TURN)})
