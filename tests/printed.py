"""The equations of the source text as they are printed, each by its number, in NumPy alone.

A mechanism's places are asked by the text's names: ``"1>2"`` is the vector from point 1 to point 2, ``"v1"`` a unit
vector, ``"phi"`` a variable. Lengths, constants c and coefficients are those of the drawing. Where computing showed an
erratum the equation stands as mended, and the erratum's number with it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from rigs import after, shift, turn

import jaxnc as nc
from jaxnc.io.drives import sweep_arguments

library = nc.library


class Place:
    """What the text's names are at one pose ``q``; complex numbers go through."""

    def __init__(self, index: Mapping[str, int], q: np.ndarray, drawn: "Place | None" = None):
        self.index, self.q, self.drawn = index, q, drawn or self

    def __call__(self, name: str) -> np.ndarray:
        """A vector of three numbers, or a variable."""
        if ">" in name:
            tail, tip = name.split(">")
            return self(tip) - self(tail)
        if name in self.index:
            return self.q[self.index[name]]
        found = [self.q[self.index[f"{name}.{axis}"]] for axis in "xyz" if f"{name}.{axis}" in self.index]
        return np.array([*found, *([0.0] * (3 - len(found)))])

    def size(self, name: str) -> float:
        """Length in the drawing."""
        return float(np.linalg.norm(self.drawn(name)))


@dataclass(frozen=True)
class Row:
    """An equation: what vanishes, and how it reads."""

    value: Callable[[Place], complex]
    reads: str

    def __call__(self, place: Place) -> complex:
        return self.value(place)


X, Y, Z = range(3)


def r(u: str, axis: int | None = None) -> str:
    """How a vector or one of its components reads."""
    tail, _, tip = u.partition(">")
    letter = "r" if axis is None else "xyz"[axis]
    if tip:
        return f"({letter}{tip} - {letter}{tail})"
    return u if axis is None else f"{letter}{u}"


def ends(u: str) -> str:
    return u.replace(">", "")


def length(u: str) -> Row:
    """Constant distance."""
    return Row(lambda p: p(u) @ p(u) - p.size(u) ** 2, f"{r(u)}² - L{ends(u)}² = 0")


def unit(u: str) -> Row:
    return Row(lambda p: p(u) @ p(u) - 1.0, f"{u}² - 1 = 0")


def product(u: str, w: str) -> Row:
    """Constant scalar product."""
    return Row(lambda p: p(u) @ p(w) - p.drawn(u) @ p.drawn(w), f"{r(u)} · {r(w)} - c = 0")


def across(u: str, w: str) -> Row:
    return Row(lambda p: p(u) @ p(w), f"{r(u)} · {r(w)} = 0")


def cross(u: str, w: str, axis: int = Z) -> Row:
    """One component of a vector product that vanishes."""
    return Row(lambda p: np.cross(p(u), p(w))[axis], f"[{r(u)} × {r(w)}]{'xyz'[axis]} = 0")


def share(u: str, w: str, axis: int) -> Row:
    """One vector as a constant part of another."""
    part = f"L{ends(u)}/L{ends(w)}" if ">" in w else f"L{ends(u)}"
    return Row(lambda p: p(u)[axis] - p.size(u) / p.size(w) * p(w)[axis], f"{r(u, axis)} - {part} {r(w, axis)} = 0")


def part(u: str, w: str, s: str, axis: int) -> Row:
    """One vector along another, as long as a variable."""
    by = f"{s}/L{ends(w)}" if ">" in w else s
    return Row(lambda p: p(u)[axis] - p(s) / p.size(w) * p(w)[axis], f"{r(u, axis)} - {by} {r(w, axis)} = 0")


def combined(u: str, base: tuple[str, ...], axis: int) -> Row:
    """A vector in a base, with the coefficients that it is drawn with."""

    def value(p: Place):
        drawn = np.stack([p.drawn(b) for b in base], axis=1).real
        rows = 2 if not drawn[Z].any() else 3
        c = np.linalg.lstsq(drawn[:rows], p.drawn(u)[:rows].real, rcond=None)[0]
        return p(u)[axis] - sum(a * p(b)[axis] for a, b in zip(c, base, strict=True))

    letters = "λμ" if len(base) == 2 else "αβγ"
    return Row(
        value, f"{r(u, axis)} - {' - '.join(f'{c} {r(b, axis)}' for c, b in zip(letters, base, strict=True))} = 0"
    )


def _sizes(*vectors: str) -> str:
    return "".join(f"L{ends(u)} " for u in vectors if ">" in u)


def cosine(u: str, w: str, angle: str) -> Row:
    return Row(
        lambda p: p(u) @ p(w) - p.size(u) * p.size(w) * np.cos(p(angle)),
        f"{r(u)} · {r(w)} - {_sizes(u, w)}cos {angle} = 0",
    )


def sine(u: str, w: str, angle: str, axis: int = Z, about: str = "") -> Row:
    def value(p: Place):
        return np.cross(p(u), p(w))[axis] - (p(about)[axis] if about else 1.0) * p.size(u) * p.size(w) * np.sin(
            p(angle)
        )

    by = f"{r(about, axis)} " if about else ""
    return Row(value, f"[{r(u)} × {r(w)}]{'xyz'[axis]} - {by}{_sizes(u, w)}sin {angle} = 0")


def squared(u: str, s: str) -> Row:
    return Row(lambda p: p(u) @ p(u) - p(s) ** 2, f"{r(u)}² - {s}² = 0")


def linear(a: float, one: str, b: float, other: str, reads: str) -> Row:
    """A linear relation of two variables; its constant is the drawing's."""
    return Row(lambda p: a * (p(one) - p.drawn(one)) + b * (p(other) - p.drawn(other)), f"{reads} - c = 0")


# -- poses ------------------------------------------------------------------------------------------------------------

RNG = np.random.default_rng(5)


def driven(m: nc.Mechanism, system: nc.System) -> list[np.ndarray]:
    """Poses along the mechanism's own drive."""
    motion = nc.sweep(system, **sweep_arguments(m)).check()
    q = np.asarray(motion.poses)
    away = np.array([0.03, 0.19, 0.37, 0.56, 0.71, 0.92])  # from where a cosine is blind: (40)
    return list(q[(away * (len(q) - 1)).astype(int)])


def carried(*bodies: tuple[str, ...], joint: Callable[[float], list] = lambda s: [], **variables: float):
    """Poses of free bodies: all are displaced together, and the later ones first by what the joint allows.

    Args:
        bodies: names of the points and vectors that each body carries.
        joint: for a number the displacements of the second and further bodies, relative to the first.
        variables: factor by which each variable changes with that number.
    """

    def poses(m: nc.Mechanism, system: nc.System) -> list[np.ndarray]:
        top, found = system.topology, []
        drawn = at_rest(system)
        for s in (0.0, 0.3, -0.45):
            axis = RNG.normal(size=3) if top.dim == 3 else np.array([0.0, 0.0, 1.0])
            slide = RNG.normal(size=3) * ([1, 1, 1] if top.dim == 3 else [1, 1, 0])
            common = after(shift(slide), turn(axis, RNG.uniform(-2, 2)))
            q = drawn.q.copy()
            for names, own in zip(bodies, [(np.eye(3), np.zeros(3)), *joint(s)], strict=True):
                r, t = after(common, own)
                for name in names:
                    new = r @ drawn(name) + (0.0 if name in top.vectors else t)
                    for axis_name, value in zip("xyz"[: top.dim], new, strict=False):
                        q[top.position[f"{name}.{axis_name}"]] = value
            for name, factor in variables.items():
                q[top.position[name]] += factor * s
            found.append(q)
        return found

    return poses


def at_rest(system: nc.System) -> Place:
    """The pose of the drawing."""
    from jaxnc.solvers.assembly import derive

    return Place(system.topology.position, np.array(derive(system).home, dtype=float))


@dataclass(frozen=True)
class Group:
    """Equations of one figure.

    Attributes:
        name: what they describe.
        make: the mechanism, or the bodies alone.
        rows: the printed equations by number.
        poses: where they are computed.
        more: equations that the figure needs and that stand elsewhere: its bodies'.
        freedoms: degrees of freedom.
    """

    name: str
    make: Callable[[], nc.Mechanism]
    rows: dict[int | str, Row]
    poses: Callable = field(default=driven)
    more: tuple[Row, ...] = ()
    freedoms: int = 1

    @cached_property
    def mechanism(self) -> nc.Mechanism:
        return self.make()


def numbered(first: int, *rows: Row) -> dict[int | str, Row]:
    return dict(enumerate(rows, first))


def each(make: Callable[..., Row], *given) -> tuple[Row, Row, Row]:
    """The three components of a vector's row."""
    return make(*given, X), make(*given, Y), make(*given, Z)


def bodies(dim: int, places: Mapping[str, tuple], *of: tuple[str, ...], add=lambda m: None):
    """A mechanism of free bodies with the given points and (names in v or u) unit vectors."""

    def make() -> nc.Mechanism:
        m = nc.Mechanism("bodies", dim=dim)
        for name, at in places.items():
            (m.vector if name[0] in "uv" else m.point)(name, at)
        for k, names in enumerate(of):
            points, vectors = ([n for n in names if (n[0] in "uv") == v] for v in (False, True))
            m.body(f"body{k + 1}", points, **({"vectors": vectors} if vectors else {}))
        add(m)
        return m

    return make


# -- in the plane -----------------------------------------------------------------------------------------------------

FLAT = {"1": (0.1, 0.2), "2": (1.3, 0.5), "3": (0.4, 1.1), "4": (1.6, 1.4)}
LINE = {"1": (0.1, 0.2), "2": (1.3, 0.5), "3": (0.1 + 1.2 * 0.6, 0.2 + 0.3 * 0.6)}
SLIDE = {"1": (0.0, 0.1), "2": (2.0, 0.6), "3": (0.8, 0.3), "4": (1.1, 1.2)}
RAIL = np.array([2.0, 0.5, 0.0])
ELBOW = {"1": (1.2, 0.1), "2": (0.2, 0.3), "3": (0.5, 1.4)}


def along_rail(s: float) -> list:
    return [shift(s * RAIL)]


def around(point: tuple) -> Callable[[float], list]:
    return lambda s: [turn((0.0, 0.0, 1.0), s, (*point, 0.0))]


PLANE = [
    Group(
        "crank and slider on a bar",
        library.crank_slider_on_bar,
        numbered(13, length("A>P1"), length("P1>P2"), length("D>P3"), across("P1>P2", "D>P3"), cross("P1>P3", "P1>P2")),
    ),
    Group(
        "slider-crank",
        library.slider_crank,
        numbered(
            18,
            length("A>B"),
            length("B>C"),
            cross("H>C", "G>H"),
            Row(lambda p: p("A>B")[X] - p.size("A>B") * np.cos(p("phi")), "(xB - xA) - LAB cos phi = 0"),
        ),
    ),
    Group(
        "two points", bodies(2, {n: FLAT[n] for n in "12"}, ("1", "2")), {23: length("1>2")}, carried(("1", "2")), (), 3
    ),
    Group(
        "three points",
        bodies(2, {n: FLAT[n] for n in "123"}, ("1", "2", "3")),
        numbered(24, length("1>2"), length("1>3"), length("2>3")),
        carried(("1", "2", "3")),
        (),
        3,
    ),
    Group(
        "three points in line",
        bodies(2, LINE, ("1", "2", "3")),
        numbered(27, length("1>2"), share("1>3", "1>2", X), share("1>3", "1>2", Y)),
        carried(("1", "2", "3")),
        (),
        3,
    ),
    Group(
        "four points",
        bodies(2, FLAT, ("1", "2", "3", "4")),
        numbered(
            30,
            length("1>2"),
            length("2>3"),
            length("1>3"),
            combined("2>4", ("2>1", "2>3"), X),
            combined("2>4", ("2>1", "2>3"), Y),
        ),
        carried(("1", "2", "3", "4")),
        (),
        3,
    ),
    Group(
        "prismatic joint",
        bodies(2, SLIDE, ("1", "2"), ("3", "4"), add=lambda m: m.prismatic("slide", line=("1", "2"), on=("3", "4"))),
        numbered(35, cross("1>2", "1>3"), product("1>2", "3>4")),
        carried(("1", "2"), ("3", "4"), joint=along_rail),
        (length("1>2"), length("3>4")),
        4,
    ),
    Group(
        "pin in a slot",
        bodies(2, SLIDE, ("1", "2"), ("3", "4"), add=lambda m: m.slot("slot", "3", ("1", "2"))),
        {37: cross("1>2", "1>3")},
        carried(
            ("1", "2"), ("3", "4"), joint=lambda s: [after(shift(s * RAIL), turn((0, 0, 1), 2 * s, (0.8, 0.3, 0)))]
        ),
        (length("1>2"), length("3>4")),
        5,
    ),
    Group(
        "angle",
        bodies(2, ELBOW, ("1", "2"), ("2", "3"), add=lambda m: m.angle("phi", at="2", to="3", start="1")),
        {38: cosine("2>1", "2>3", "phi"), 39: sine("2>1", "2>3", "phi")},
        carried(("1", "2"), ("3",), joint=around(ELBOW["2"]), phi=1.0),
        (length("1>2"), length("2>3")),
        4,
    ),
    Group(
        "distance along a line",
        bodies(
            2,
            SLIDE,
            ("1", "2"),
            ("3", "4"),
            add=lambda m: (
                m.prismatic("slide", line=("1", "2"), on=("3", "4")),
                m.distance("s", "1", "3", along=("1", "2")),
            ),
        ),
        {41: part("1>3", "1>2", "s", X), 42: part("1>3", "1>2", "s", Y), "42b": squared("1>3", "s")},
        carried(("1", "2"), ("3", "4"), joint=along_rail, s=float(np.linalg.norm(RAIL))),
        (length("1>2"), length("3>4"), cross("1>2", "1>3"), product("1>2", "3>4")),
        4,
    ),
    Group(
        "gear pair",
        library.gear_pair,
        numbered(
            43,
            length("A>P1"),
            length("B>P2"),
            cosine("A>P1", "A>B", "phi"),
            cosine("B>P2", "B>A", "psi"),
            linear(0.1, "phi", 0.2, "psi", "R1 phi + R2 psi"),  # erratum 7
        ),
    ),
    Group(
        "quick return",
        library.quick_return,
        numbered(
            48,
            length("B>P1"),
            length("A>P2"),
            cross("A>P1", "A>P2"),
            cross("A>P3", "A>P2"),
            cross("C>P3", "C>D"),
            cosine("B>P1", "B>A", "phi"),
        ),
    ),
    Group(
        "rolling disc",
        library.rolling_disc,
        numbered(
            54,
            length("P1>P2"),
            length("P1>P3"),
            cross("A>P3", "A>B"),
            across("P3>P1", "A>B"),
            cosine("P1>P2", "P1>P3", "phi"),
            part("A>P3", "A>B", "s", X),
            linear(1.0, "s", 0.1, "phi", "s + R phi"),  # erratum 7: the disc is above the line
        ),
    ),
    Group(
        "generic mechanism",
        library.generic_mechanism,
        numbered(
            61,
            *(length(u) for u in ("A>P1", "P1>P2", "P2>P3", "P3>P4", "P4>P5", "P3>P5", "P5>P6", "P5>P7")),
            cross("B>P4", "B>C"),
            product("P4>P3", "B>C"),
            cross("P1>P6", "P1>P2"),
            across("P1>P2", "P6>P5"),
            cosine("P5>P6", "P5>P7", "phi"),
            part("P1>P6", "P1>P2", "s", X),
            linear(1.0, "s", 0.05, "phi", "s + R phi"),  # erratum 7
        ),
    ),
]

# -- in space ---------------------------------------------------------------------------------------------------------

U = np.array([0.36, 0.48, 0.8])
V = np.array([-0.8, 0.6, 0.0])
W = np.array([0.6, 0.0, 0.8])
ONE, TWO = np.array([0.1, -0.2, 0.3]), np.array([1.1, 0.4, 0.2])
SOLID = {"1": ONE, "2": TWO, "3": np.array([0.3, 0.9, 0.7]), "4": np.array([0.9, 0.2, 1.4]), "u": U, "v": V}
COPLANAR = 0.4 * (TWO - ONE) + 0.9 * U


def solid(*names: str, **changed) -> Callable[[], nc.Mechanism]:
    return bodies(3, {n: tuple((SOLID | changed)[n]) for n in names}, names)


def free(name: str, first: int, names: tuple[str, ...], *rows: Row, freedoms: int = 6, **changed) -> Group:
    return Group(name, solid(*names, **changed), numbered(first, *rows), carried(names), (), freedoms)


AXIS = {
    "1": ONE,
    "2": ONE + 0.7 * U,
    "v1": U,
    "4": ONE + np.array([0.5, 0.1, 0.2]),
    "3": ONE + 0.7 * U + np.array([-0.2, 0.6, 0.1]),
}
SLEEVE = {"1": ONE, "2": ONE + U, "3": ONE + 0.4 * U, "4": ONE + 1.3 * U, "v1": V, "v2": W}
CROSS = {"1": ONE, "2": TWO, "3": np.array([-0.4, 0.5, 0.9]), "v1": U, "v2": V}
HINGE = {"2": ONE, "1": ONE + 0.8 * V, "3": ONE + 0.5 * np.cross(U, V), "v1": U}
BODY_1, BODY_2 = ("1", "4", "v1"), ("2", "3", "v1")
ON_AXIS = (length("1>4"), unit("v1"), product("1>4", "v1"), length("2>3"), product("2>3", "v1"))


def spin(s: float) -> list:
    """Turn and slide along the axis of `AXIS`."""
    return [after(shift(0.4 * s * U), turn(U, 2.0 * s, ONE))]


def jointed(places: Mapping, one: tuple, two: tuple, add) -> Callable[[], nc.Mechanism]:
    return bodies(3, {n: tuple(x) for n, x in places.items()}, one, two, add=add)


BASE = ("1>2", "1>3", "u")
KNUCKLE = ("3>2", "v2", "3>4")

SPACE = [
    Group(
        "RSCR",
        library.rscr,
        numbered(
            76,
            length("A>1"),
            product("A>1", "vA"),
            length("1>2"),
            product("1>2", "v1"),
            unit("v1"),
            *each(cross, "2>3", "v1"),
            length("B>3"),
            product("B>3", "v1"),
            product("B>3", "vB"),
            product("v1", "vB"),
        ),
    ),
    free("a bar of two points", 89, ("1", "2"), length("1>2"), freedoms=5),
    free("two points and a vector", 90, ("1", "2", "u"), length("1>2"), unit("u"), product("1>2", "u")),
    free(
        "the vector along the points",
        93,
        ("1", "2", "u"),
        unit("u"),
        *each(share, "1>2", "u"),
        freedoms=5,
        **{"2": ONE + 2 * U},
    ),
    free("three points", 97, ("1", "2", "3"), length("1>2"), length("1>3"), length("2>3")),
    free(
        "three points in line",
        100,
        ("1", "2", "3"),
        length("1>2"),
        *each(share, "1>3", "1>2"),
        freedoms=5,
        **{"3": ONE + 0.6 * (TWO - ONE)},
    ),
    free(
        "two points and two vectors",
        104,
        ("1", "2", "u", "v"),
        length("1>2"),
        unit("u"),
        unit("v"),
        product("1>2", "u"),
        product("1>2", "v"),
        product("u", "v"),
    ),
    free(
        "the same in one plane",
        110,
        ("1", "2", "u", "v"),
        length("1>2"),
        unit("u"),
        product("1>2", "u"),
        *each(combined, "v", ("1>2", "u")),
        v=COPLANAR / np.linalg.norm(COPLANAR),
    ),
    free(
        "general body",  # (122)-(127): erratum 4
        116,
        ("1", "2", "3", "4", "u", "v"),
        length("1>2"),
        length("1>3"),
        unit("u"),
        product("1>2", "1>3"),
        product("1>2", "u"),
        product("1>3", "u"),
        *each(combined, "1>4", BASE),
        *each(combined, "v", BASE),
    ),
    Group(
        "cylindrical joint",
        jointed(AXIS, BODY_1, BODY_2, lambda m: m.cylindrical("joint", line=("1", "v1"), on="2")),
        numbered(128, *each(cross, "1>2", "v1")),
        carried(BODY_1, ("2", "3"), joint=spin),
        ON_AXIS,
        8,
    ),
    Group(
        "prismatic joint with a shared vector",
        jointed(
            AXIS,
            BODY_1,
            BODY_2,
            lambda m: m.prismatic("joint", line=("1", "v1"), on="2", directions=(("1", "4"), ("2", "3"))),
        ),
        numbered(131, *each(cross, "1>2", "v1"), product("1>4", "2>3")),
        carried(BODY_1, ("2", "3"), joint=lambda s: [shift(s * U)]),
        ON_AXIS,
        7,
    ),
    Group(
        "prismatic joint that shares nothing",
        jointed(
            SLEEVE,
            ("1", "2", "v1"),
            ("3", "4", "v2"),
            lambda m: m.prismatic("joint", line=("1", "2"), on=("3", "4"), directions=("v1", "v2")),
        ),
        numbered(135, *each(cross, "1>2", "1>3"), *each(cross, "1>2", "1>4"), product("v1", "v2")),
        carried(("1", "2", "v1"), ("3", "4", "v2"), joint=lambda s: [shift(s * U)]),
        (length("1>2"), unit("v1"), product("1>2", "v1"), length("3>4"), unit("v2"), product("3>4", "v2")),
        7,
    ),
    Group(
        "universal joint",
        jointed(CROSS, ("1", "2", "v1"), ("1", "3", "v2"), lambda m: m.universal("joint", axes=("v1", "v2"))),
        {142: product("v1", "v2")},
        carried(("1", "2", "v1"), ("3", "v2"), joint=lambda s: [after(turn(U, s, ONE), turn(V, -2 * s, ONE))]),
        (length("1>2"), unit("v1"), product("1>2", "v1"), length("1>3"), unit("v2"), product("1>3", "v2")),
        8,
    ),
    Group(
        "angle about an axis",
        jointed(
            HINGE,
            ("2", "1", "v1"),
            ("2", "3", "v1"),
            lambda m: m.angle("phi", at="2", to="3", start="1", about="v1"),
        ),
        {
            143: cosine("2>3", "2>1", "phi"),
            **numbered(144, *(sine("2>1", "2>3", "phi", k, "v1") for k in (X, Y, Z))),
        },
        carried(("2", "1", "v1"), ("3",), joint=lambda s: [turn(U, s, ONE)], phi=1.0),
        (length("2>1"), unit("v1"), product("2>1", "v1"), length("2>3"), product("2>3", "v1")),
        7,
    ),
    Group(
        "distance along an axis",
        jointed(
            AXIS,
            BODY_1,
            BODY_2,
            lambda m: (
                m.cylindrical("joint", line=("1", "v1"), on="2"),
                m.distance("s", "1", "2", along="v1"),
            ),
        ),
        {**numbered(147, *(part("1>2", "v1", "s", k) for k in (X, Y, Z))), 150: squared("1>2", "s")},
        carried(BODY_1, ("2", "3"), joint=spin, s=0.4),
        (*ON_AXIS, *each(cross, "1>2", "v1")),
        8,
    ),
    Group(
        "bevel gears",
        library.bevel_gears,
        numbered(
            151,
            length("A>1"),
            across("A>1", "vA"),
            length("B>2"),
            across("B>2", "vB"),
            cosine("A>1", "vB", "phi"),  # at shafts across each other: erratum 3
            cosine("B>2", "vA", "psi"),
            linear(0.03, "phi", 0.06, "psi", "R1 phi + R2 psi"),  # errata 7 and 11
        ),
    ),
    Group(
        "MacPherson suspension",
        library.macpherson,
        numbered(
            158,
            length("1>2"),
            product("1>2", "v1"),
            length("3>2"),
            length("3>4"),
            unit("v2"),
            product("3>2", "v2"),
            product("3>4", "v2"),
            product("3>2", "3>4"),
            *each(combined, "3>6", KNUCKLE),
            *each(combined, "3>5", KNUCKLE),
            length("8>9"),
            across("8>9", "v3"),
            unit("v3"),
            length("5>10"),
            length("6>7"),
            across("6>7", "v2"),
            *each(cross, "3>4", "3>8"),
            *each(cross, "3>4", "3>9"),
            product("v2", "v3"),
            squared("9>4", "s"),
        ),
        freedoms=3,
    ),
    Group(
        "steering column",
        library.steering_column,
        numbered(
            186,
            across("A>B", "v1"),
            unit("v1"),
            across("v1", "v2"),
            unit("v2"),
            unit("v3"),
            across("B>C", "v2"),
            across("B>C", "v3"),
            across("v2", "v3"),
            across("v3", "v4"),
            unit("v4"),
            across("C>D", "v4"),
            Row(lambda p: p("v4")[Y] - np.cos(p("psi")), "yv4 - cos psi = 0"),
            squared("E>1", "s"),
            linear(1.0, "s", -0.007, "psi", "s - R psi"),
            length("1>2"),
            Row(lambda p: p("v1") @ p("vA") - np.cos(p("phi")), "v1 · vA - cos phi = 0"),
        ),
    ),
]
GROUPS = {f"{group.name}, {next(iter(group.rows))}": group for group in (*PLANE, *SPACE)}

# -- the same mechanism in other coordinates (fig. 3 and 4), computed from its points ---------------------------------

CRANK, BAR, ARM = "A>P1", "P1>P2", "D>P3"


def direction(p: Place, u: str) -> float:
    return np.arctan2(p(u)[Y], p(u)[X])


def centre(p: Place, u: str) -> np.ndarray:
    return (p(u.split(">")[0]) + p(u.split(">")[1])) / 2


def closure(p: Place) -> np.ndarray:
    """(3) and (4), of psi1, psi2 = psi1's supplement to the bar, and s."""
    bar, s = direction(p, BAR), np.linalg.norm(p("P1>P3"))
    one = direction(p, CRANK)
    two = bar + np.pi - one
    along, aside = np.array([np.cos(one + two - np.pi), np.sin(one + two - np.pi)]), p.size(ARM)
    first = p.size(CRANK) * np.array([np.cos(one), np.sin(one)])
    return first + s * along + aside * np.array([along[1], -along[0]]) - [p.size("A>D"), 0.0]


def held(u: str, tail: bool, axis: int) -> Callable[[Place], float]:
    """An end of a bar, from its middle and its angle."""

    def value(p: Place) -> float:
        at = centre(p, u)[axis] + (-0.5 if tail else 0.5) * p.size(u) * (np.cos, np.sin)[axis](direction(p, u))
        return at - p(u.split(">")[0 if tail else 1])[axis]

    return value


def meeting(axis: int) -> Callable[[Place], float]:
    one, two = held(CRANK, False, axis), held(BAR, True, axis)
    return lambda p: (one(p) + p("P1")[axis]) - (two(p) + p("P1")[axis])


def quarter(p: Place) -> float:
    return (direction(p, ARM) - direction(p, BAR)) % (2 * np.pi) - np.pi / 2


def offset(p: Place) -> float:
    psi = direction(p, ARM)
    return (centre(p, BAR) - centre(p, ARM)) @ [np.cos(psi), np.sin(psi), 0.0] - p.size(ARM) / 2


COMPARED: dict[int | str, Row] = numbered(
    2,
    Row(lambda p: np.linalg.norm(p(CRANK) + p("P1>P3") + p("P3>D") + p("D>A")), "AB + BC + CD + DA = 0, vectors"),
    Row(lambda p: closure(p)[X], "L1 cos ψ1 + s cos(ψ1 + ψ2 - π) + L3 sin(ψ1 + ψ2 - π) - L4 = 0"),
    Row(lambda p: closure(p)[Y], "L1 sin ψ1 + s sin(ψ1 + ψ2 - π) - L3 cos(ψ1 + ψ2 - π) = 0"),
    Row(held(CRANK, True, X), "x1 - xA - L1/2 cos ψ1 = 0"),
    Row(held(CRANK, True, Y), "y1 - yA - L1/2 sin ψ1 = 0"),
    Row(meeting(X), "x1 + L1/2 cos ψ1 - x2 + L2/2 cos ψ2 = 0"),
    Row(meeting(Y), "y1 + L1/2 sin ψ1 - y2 + L2/2 sin ψ2 = 0"),
    Row(quarter, "ψ3 - ψ2 - π/2 = 0"),
    Row(offset, "(x2 - x3) cos ψ3 + (y2 - y3) sin ψ3 - L3/2 = 0"),
    Row(held(ARM, True, X), "x3 - xD - L3/2 cos ψ3 = 0"),
    Row(held(ARM, True, Y), "y3 - yD - L3/2 sin ψ3 = 0"),
)
COUNTS = {1: "r = n - g", 22: "r = n - 3", 88: "r = n - 6"}
VARIED = {40: "δx1 (x3 - x2) + δy1 (y3 - y2) + L12 L23 δφ sin φ = 0, the variation of (38)"}
FIGURES = {
    13: "fig. 6",
    18: "fig. 8",
    23: "fig. 9",
    24: "fig. 10",
    27: "fig. 11",
    30: "fig. 12",
    35: "fig. 14",
    37: "fig. 15",
    38: "fig. 16",
    41: "fig. 18",
    43: "fig. 19",
    48: "fig. 20",
    54: "fig. 21",
    61: "fig. 22",
    76: "fig. 24",
    89: "fig. 25",
    90: "fig. 26",
    93: "fig. 27",
    97: "fig. 28",
    100: "fig. 29",
    104: "fig. 30",
    110: "§4.1.4",
    116: "fig. 31",
    128: "fig. 35",
    131: "fig. 36",
    135: "fig. 37",
    142: "fig. 38",
    143: "fig. 39",
    147: "fig. 40",
    151: "fig. 41",
    158: "fig. 42",
    186: "fig. 43",
}
