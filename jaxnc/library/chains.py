"""Chains of any number of loops."""

import math

from jaxnc.calls import public
from jaxnc.errors import MechanismError
from jaxnc.library.drawing import Point, drive, meet, number, polar, positive
from jaxnc.mechanism import Mechanism


@public
def four_bar_chain(
    loops: int = 3,
    crank: float = 1.0,
    coupler: float = 1.0,
    ground: float = 1.0,
    last: float | None = None,
    angle: float = 1.0,
) -> Mechanism:
    """Four-bar linkages in a row, each rocker being the next one's crank: the N-four-bar of the benchmarks.

    Cranks Ai-Bi, i = 0 … loops, on ground pivots in line, couplers Bi-B(i+1). n = 2 loops + 3, rows = rank = n - 1,
    g = 1. Input ``phi``, the angle of the first crank from the x axis. With the default lengths every loop is a
    rhombus, and all of them pass a change point together at phi = 0 and π; the default drive stays between.

    Args:
        loops: how many four-bars, at least one.
        crank: length of the first crank.
        coupler: length of every coupler.
        ground: distance from one ground pivot to the next.
        last: length of the last crank; those between change evenly from the first to it. As the first if not given.
        angle: angle of the first crank in the drawing, radians.

    Raises:
        MechanismError: for a number of loops that is not a positive integer, a length that is not positive, lengths
            that do not close, or a drawing at a change point.

    Source: M. González, D. Dopico, U. Lugrís, J. Cuadrado, A benchmarking system for MBS simulation software, Multibody
    System Dynamics 16 (2006), problem A02, N four-bar mechanism.
    """
    what = "four_bar_chain"
    if not isinstance(loops, int) or isinstance(loops, bool) or loops < 1:
        raise MechanismError(f"{what}: loops must be a positive integer, got {loops!r}; 1 is a single four-bar")
    crank, coupler, ground = positive(what, crank=crank, coupler=coupler, ground=ground)
    (last,) = positive(what, last=crank if last is None else last)
    (angle,) = number(what, angle=angle)
    if abs(math.sin(angle)) < 1e-6:
        raise MechanismError(f"{what}: angle = {angle:g} is a change point; draw the cranks off the ground line")
    cranks = [crank + (last - crank) * i / loops for i in range(loops + 1)]
    tips: list[Point] = [polar((0.0, 0.0), crank, angle)]
    for i in range(1, loops + 1):
        pivot = (i * ground, 0.0)
        # The branch on which cranks stay on one side of the ground line.
        side = math.copysign(1.0, math.sin(angle))
        tips.append(meet(what, tips[-1], pivot, side, coupler=coupler, crank=cranks[i]))

    m = Mechanism("four-bar chain", description=f"{loops} four-bar linkages in a row, driven at the first crank.")
    for i in range(loops + 1):
        m.ground(f"A{i}", (i * ground, 0.0))
    for i, tip in enumerate(tips):
        m.point(f"B{i}", tip)
    for i in range(loops + 1):
        m.body(f"crank{i}", [f"A{i}", f"B{i}"])
    for i in range(loops):
        m.body(f"coupler{i + 1}", [f"B{i}", f"B{i + 1}"])
    m.angle("phi", at="A0", to="B0")
    half = math.copysign(math.pi, math.sin(angle))
    ends = (0.02 * half, 0.98 * half) if last == crank and coupler == ground else (angle - 0.2, angle + 0.2)
    return drive(m, ["B0", f"B{loops}"], {"phi": ends})
