"""Walking legs: Jansen's and Klann's."""

import math
from collections.abc import Mapping

from jaxnc.calls import public
from jaxnc.library.drawing import TURN, Point, drive, hardpoints, meet, number, polar, positive, travel
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism.model import Place


@public
def jansen_leg(
    a: float = 38.0,
    b: float = 41.5,
    c: float = 39.3,
    d: float = 40.1,
    e: float = 55.8,
    f: float = 39.4,
    g: float = 36.7,
    h: float = 65.7,
    i: float = 49.0,
    j: float = 50.0,
    k: float = 61.9,
    l: float = 7.8,  # noqa: E741 (the published letter)
    m: float = 15.0,
    scale: float = 0.01,
    angle: float = 0.5,
) -> Mechanism:
    """Theo Jansen's leg, with his thirteen "holy numbers".

    Crank O-X, bars X-U (j) and X-L (k), triangle Z-U-V (b, e, d), bars Z-L (c) and V-K (f), triangle K-L-F (g, i, h)
    with the foot F. n = 13, rows = 12, rank 12, g = 1. Input ``phi``, the angle of the crank from the x axis; the
    default drive is a full turn where there is one, otherwise the range of the crank.

    Args:
        a: how far Z is to the left of the crank centre O, in units of `scale`, as all letters.
        b: Z-U.
        c: Z-L.
        d: Z-V.
        e: U-V.
        f: V-K.
        g: K-L.
        h: K-F.
        i: L-F.
        j: X-U.
        k: X-L.
        l: how far Z is below O; any sign, or zero.
        m: crank O-X.
        scale: length of one unit; 0.01 makes a leg of about a metre.
        angle: crank angle of the drawing, radians.

    Raises:
        MechanismError: for a length that is not positive, or bars that do not close, by their letters.

    Source: T. Jansen, The Great Pretender (2007), the published proportions of the Strandbeest's leg.
    """
    what = "jansen_leg"
    letters = {"a": a, "b": b, "c": c, "d": d, "e": e, "f": f, "g": g, "h": h, "i": i, "j": j, "k": k, "m": m}
    bars = dict(zip(letters, positive(what, **letters), strict=True))
    (scale,) = positive(what, scale=scale)
    drop, angle = number(what, l=l, angle=angle)
    z = (-bars["a"], -drop)

    def tip(p: Point, q: Point, side: float, first: str, second: str) -> Point:
        return meet(what, p, q, side, **{first: bars[first], second: bars[second]})

    def draw(phi: float) -> dict[str, Point]:
        x = polar((0.0, 0.0), bars["m"], phi)
        upper, lower = tip(x, z, -1.0, "j", "b"), tip(x, z, 1.0, "k", "c")
        v = tip(upper, z, -1.0, "e", "d")
        knee = tip(v, lower, -1.0, "f", "g")
        return {"X": x, "U": upper, "L": lower, "V": v, "K": knee, "F": tip(knee, lower, -1.0, "h", "i")}

    leg = Mechanism(
        "jansen leg", description="Theo Jansen's leg: the foot F goes flat on the ground and high above it."
    )
    leg.ground("O", (0.0, 0.0))
    leg.ground("Z", (scale * z[0], scale * z[1]))
    for name, at in draw(angle).items():
        leg.point(name, (scale * at[0], scale * at[1]))
    leg.body("crank", ["O", "X"])
    leg.body("upper_rod", ["X", "U"])
    leg.body("lower_rod", ["X", "L"])
    leg.body("upper_triangle", ["Z", "U", "V"])
    leg.body("lower_rocker", ["Z", "L"])
    leg.body("tie", ["V", "K"])
    leg.body("foot", ["K", "L", "F"])
    leg.angle("phi", at="O", to="X")
    return drive(leg, ["F"], {"phi": travel(draw, angle)})


_KLANN = {
    "A": (1.599, 0.750),
    "D": (1.009, 0.574),
    "G": (1.366, 1.366),
    "B": (1.331, 0.750),
    "C": (0.741, 0.750),
    "E": (0.232, 0.866),
    "F": (0.866, 1.500),
    "P": (0.0, 0.0),
}
_KLANN_BODIES = {
    "crank": ["A", "B"],
    "rod": ["B", "C", "E"],
    "lower_rocker": ["D", "C"],
    "upper_rocker": ["G", "F"],
    "leg": ["E", "F", "P"],
}


@public
def klann_leg(places: Mapping[str, Place] | None = None, scale: float = 1.0) -> Mechanism:
    """Joe Klann's leg: a six-bar of Stephenson's third kind whose last coupler is extended to a foot P.

    Crank A-B, connecting rod B-C-E with elbow C and knee E, lower rocker D-C, upper rocker G-F with hip F, leg E-F-P.
    n = 11, rows = 10, rank 10, g = 1. Drawn fully extended, as in the patent's table. Input ``phi``, the angle of the
    crank from the x axis, π in the drawing; the default drive is a full turn, which the default places allow.

    Args:
        places: where joints are drawn, ``{"P": (x, y)}``, in units of `scale`, instead of their places in the patent.
        scale: length of one unit.

    Raises:
        MechanismError: for an unknown joint, two joints of one body at the same place, or a scale that is not
            positive.

    Source: J. C. Klann, US patent 6 260 862 (2001), table of an example leg: its points 15, 11, 9, 29, 27, 35, 37, 33
    are A, D, G, B, C, E, F, P here.
    """
    what = "klann_leg"
    (scale,) = positive(what, scale=scale)
    at = hardpoints(what, _KLANN, _KLANN_BODIES, places)
    m = Mechanism("klann leg", description="Klann's leg: half a turn of the crank draws the foot P over the ground.")
    for name, (x, y) in at.items():
        (m.ground if name in "ADG" else m.point)(name, (scale * x, scale * y))
    for name, points in _KLANN_BODIES.items():
        m.body(name, points)
    m.angle("phi", at="A", to="B")
    home = math.atan2(at["B"][1] - at["A"][1], at["B"][0] - at["A"][0])
    return drive(m, ["P"], {"phi": (home, home + TURN)})
