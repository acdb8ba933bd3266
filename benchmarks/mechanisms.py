"""The mechanisms of the cases, built with the public builder only: four-bars in several guises, and long rows."""

import dataclasses

import jax
import numpy as np

import jaxnc as nc
from benchmarks.circles import FourBars


def four_bar(bars: FourBars) -> nc.Mechanism:
    """One four-bar with its lengths read off the drawing."""
    return nc.library.four_bar(
        crank=float(bars.crank),
        coupler=float(bars.coupler),
        rocker=float(bars.rocker),
        ground=float(bars.ground),
        branch="open" if bars.side > 0 else "crossed",
        angle=float(bars.home),
        explicit=False,
    )


def four_bars(bars: FourBars) -> nc.System:
    """Many designs as one system whose leaves have a leading axis: the argument of ``jax.vmap``."""
    base = four_bar(FourBars.default()).compile()
    b, c = bars.poses(bars.home)
    d = np.stack([bars.ground, np.zeros_like(bars.ground)], axis=-1)
    return jax.vmap(lambda b, c, d: base.replace(B=b, C=c, D=d))(b, c, d)


def _bar(p, v, s, c):
    x, y = p[1][0] - p[0][0], p[1][1] - p[0][1]
    return (x * x + y * y - c[0] * c[0],)


def _bar_drawn(p, v, s, c):
    x, y = p[1][0] - p[0][0], p[1][1] - p[0][1]
    return ((x * x + y * y) ** 0.5,)


BAR = nc.constraints.Kind(
    "a bar of the benchmarks",
    _bar,
    rows=("bar",),
    powers=(2,),
    points=2,
    constants=("long",),
    drawn=_bar_drawn,
    source="defined outside of the package",
)


@dataclasses.dataclass(frozen=True)
class Guise:
    """The same four-bar described differently.

    Args:
        name: what is different.
        system: the compiled mechanism.
        angle: name of its input.
        point: name of the point C.
        turn: angle by which it is turned about the origin.
        shift: how it is then moved, ``(2,)``.
    """

    name: str
    system: nc.System
    angle: str
    point: str
    turn: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)

    def place(self, c: np.ndarray) -> np.ndarray:
        """Where a point of the original is."""
        co, si = np.cos(self.turn), np.sin(self.turn)
        return c @ np.array([[co, si], [-si, co]]) + np.array(self.shift)


def guises(bars: FourBars) -> list[Guise]:
    """The default four-bar, and the same turned, renamed and permuted, and of a kind from outside."""
    b, c = (np.asarray(p) for p in bars.poses(bars.home))
    places = {"A": np.zeros(2), "D": np.array([float(bars.ground), 0.0]), "B": b, "C": c}
    plain = Guise("as in the library", four_bar(bars).compile(), "phi", "C")

    turned = Guise("turned", plain.system, "phi", "C", 0.7, (0.3, -0.2))
    m = nc.Mechanism("turned")
    for name, place in places.items():
        (m.ground if name in "AD" else m.point)(name, tuple(turned.place(place)))
    for name, ends in (("crank", "AB"), ("coupler", "BC"), ("rocker", "CD")):
        m.body(name, list(ends))
    m.angle("phi", at="A", to="B")
    turned = dataclasses.replace(turned, system=m.compile())

    m = nc.Mechanism("renamed and permuted")
    m.point("wrist", tuple(c))
    m.ground("left", tuple(places["D"]))
    m.point("elbow", tuple(b))
    m.ground("right", (0.0, 0.0))
    m.body("third", ["left", "wrist"])
    m.body("second", ["wrist", "elbow"])
    m.body("first", ["elbow", "right"])
    m.angle("turn", at="right", to="elbow")
    renamed = Guise("renamed and permuted", m.compile(), "turn", "wrist")

    m = nc.Mechanism("own kind")
    for name, place in places.items():
        (m.ground if name in "AD" else m.point)(name, tuple(place))
    for ends in ("AB", "BC", "CD"):
        m.constrain(f"bar {ends}", BAR, points=list(ends))
    m.angle("phi", at="A", to="B")
    return [plain, turned, renamed, Guise("of a kind defined outside", m.compile(), "phi", "C")]


def row_of_loops(loops: int) -> nc.Mechanism:
    """N four-bars in a row: cranks from (i, 0) to (i + 0.3, 1) joined by couplers, two coordinates each.

    All loops are parallelograms, so the tip of crank i is its foot plus that of the first crank: a closed form for any
    number of loops.
    """
    m = nc.Mechanism(f"row of {loops} four-bars")
    m.ground("G0", (0.0, 0.0))
    m.point("P0", (0.3, 1.0))
    m.body("r0", ["G0", "P0"])
    for i in range(1, loops + 1):
        m.ground(f"G{i}", (float(i), 0.0))
        m.point(f"P{i}", (i + 0.3, 1.0))
        m.body(f"r{i}", [f"G{i}", f"P{i}"])
        m.body(f"c{i}", [f"P{i - 1}", f"P{i}"])
    m.angle("phi", at="G0", to="P0")
    return m
