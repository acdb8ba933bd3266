"""The records that describe one kind of constraint, and the small vector algebra kinds are written in.

A kind is data: a pure function of *one* instance's own points, vectors, scalars and constants. Everything else
(gathering, vectorising over instances, derivatives, sparsity, names of rows) is done once for all kinds elsewhere.

Directions in space as operands of a kind: a unit vector, or the segment between two points.

"A unit vector may stand for two points and the other way round" (source text §4). A kind over directions is made for a
string of forms, one letter each: ``"v"`` takes a unit vector of the instance, ``"p"`` two of its points.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from jaxnc.calls import public
from jaxnc.constraints.elementary import ratio, root, sqrt, where
from jaxnc.pickling import Remade
from jaxnc.types import Array

Rows = Sequence[Any]
RowFunction = Callable[[Any, Any, Any, Any], Rows]  # numbers of every sort, see `elementary`


@public
@dataclass(frozen=True)
class Kind(Remade):
    """A kind of constraint.

    The functions all take ``(p, v, s, c)``: points ``(points, dim)``, unit vectors ``(vectors, dim)``, scalars
    ``(scalars,)`` and constants ``(len(constants),)`` of one instance.

    Args:
        name: unique name, used in reports and messages.
        residual: ``(p, v, s, c) -> rows``, a sequence of scalars that vanish when the constraint is met.
        rows: a short label for each row.
        powers: the length dimension of each row (2 for squared lengths, 1 for lengths, 0 for pure numbers); rows are
            scaled by the mechanism's characteristic length to the power ``1 - powers`` so that all are lengths. None
            marks a row that is linear in its scalars and is scaled by its own largest term instead.
        points: how many points an instance takes.
        vectors: how many unit vectors.
        scalars: how many scalar coordinates (angles, distances, single coordinates of points).
        constants: names of its constants. One called ``length`` or ``radius``, also with a number, is a length:
            positive, and shown with a unit.
        drawn: ``(p, v, s, c) -> constants`` as read off the drawing; ``c`` carries the values the user gave
            explicitly (zero elsewhere), and those win over what is returned. Called only when there are constants.
        measure: ``(p, v, c) -> value`` of the last scalar: makes the kind usable as a mixed coordinate.
        guard: ``(p, v, s, c) -> values`` that must stay positive; excludes mirror images that the rows admit.
        mirror: whether the guard tells a body from its mirror image (its failure then has a status of its own).
        misfit: ``(p, v, c) -> part`` of the drawing: how far it is from the class that the kind is for (segments in
            one plane, points in one line), relative; zero where it fits.
        source: equation numbers of the source text.
    """

    name: str
    residual: RowFunction
    rows: tuple[str, ...] = ("",)
    powers: tuple[int | None, ...] = (1,)
    points: int = 0
    vectors: int = 0
    scalars: int = 0
    constants: tuple[str, ...] = ()
    drawn: RowFunction | None = None
    measure: Callable | None = None
    guard: RowFunction | None = None
    mirror: bool = False
    misfit: Callable | None = None
    source: str = ""

    def __post_init__(self):
        if len(self.rows) != len(self.powers):
            raise ValueError(f"kind {self.name!r}: {len(self.rows)} row labels but {len(self.powers)} powers")
        if self.constants and self.drawn is None:
            raise ValueError(f"kind {self.name!r} has constants {self.constants} but no `drawn` to read them off")


@public
@dataclass(frozen=True)
class RateKind(Remade):
    """A kind of constraint that is linear in velocities, ``B(q) q̇ = b(q)``.

    Skates, wheels and rolling discs are nonholonomic: no constraint on positions stands for them. They take away
    freedoms of the motion from moment to moment, and none of the places that the mechanism can be brought to.

    Points, vectors, scalars and constants are those of one instance, as in `Kind`; ``dp, dv, ds`` are their rates. B is
    derived from `rate`, which is to be linear in the rates (a part without rates is b).

    Args:
        name: unique name, used in reports and messages.
        rate: ``(p, v, s, dp, dv, ds, c) -> rows``, scalars that vanish when the constraint is met, m/s.
        rows: a short label for each row.
        points: how many points an instance takes.
        vectors: how many unit vectors.
        scalars: how many scalar coordinates.
        constants: names of its constants.
        drawn: ``(p, v, s, c) -> constants`` as read off the drawing, as in `Kind`.
        source: where the equation comes from.
    """

    name: str
    rate: Callable[..., Any]
    rows: tuple[str, ...] = ("",)
    points: int = 0
    vectors: int = 0
    scalars: int = 0
    constants: tuple[str, ...] = ()
    drawn: RowFunction | None = None
    source: str = ""

    def __post_init__(self):
        if self.constants and self.drawn is None:
            raise ValueError(f"kind {self.name!r} has constants {self.constants} but no `drawn` to read them off")


def kept_angle(parts: Callable[[Array, Array], tuple]) -> dict:
    """The fields of a kind of one row that keeps an angle as drawn, from its cosine and sine parts at ``(p, v)``.

    ``cos α · sine part - sin α · cosine part = 0`` keeps its rank at every angle (erratum 9); the angle α + π, which it
    admits too, is excluded by the guard.
    """

    def drawn(p, v, s, c):
        co, si = parts(p, v)
        square = co * co + si * si
        size = sqrt(where(square > 0, square, 1.0))
        return (ratio(co, size), ratio(si, size))

    def residual(p, v, s, c):
        co, si = parts(p, v)
        return (c[0] * si - c[1] * co,)

    def guard(p, v, s, c):
        co, si = parts(p, v)
        return (c[0] * co + c[1] * si,)

    return {"residual": residual, "drawn": drawn, "guard": guard, "constants": ("cosine", "sine")}


def dot(a, b):
    """Scalar product of two small vectors, written out (a batched `dot` would leave the fused loop)."""
    left = [a[i] for i in range(a.shape[0])]
    right = left if b is a else [b[i] for i in range(a.shape[0])]  # each is taken out once, see `directions.cross3`
    return sum(x * y for x, y in zip(left[1:], right[1:], strict=True)) + left[0] * right[0]


def cross(a, b):
    """The z component of the vector product of two plane vectors."""
    return a[0] * b[1] - a[1] * b[0]


def norm(a) -> Any:
    """Length of a small vector, with a zero (not NaN) derivative at zero length."""
    return root(dot(a, a))


# -- directions as operands --------------------------------------------------------------------------------------------


def counts(forms: str, first: int = 0) -> dict[str, Any]:
    """The numbers of points (`first` of them its own) and vectors of a kind over directions, as fields of `Kind`."""
    return {"points": first + 2 * forms.count("p"), "vectors": forms.count("v")}


def reader(forms: str, first: int = 0) -> Callable[[Array, Array], list[Array]]:
    """A function from an instance's points and vectors to its directions; the pairs of points start at `first`."""
    places, points, vectors = [], first, 0
    for form in forms:
        if form == "p":
            places.append((points, points + 1))
            points += 2
        else:
            places.append((vectors, None))
            vectors += 1

    def read(p, v):
        return [v[i] if j is None else p[j] - p[i] for i, j in places]

    return read


def power(forms: str) -> int:
    """Length dimension of a product of the directions."""
    return forms.count("p")


def cross3(a, b) -> tuple:
    """Vector product, component by component, each taken out once: in reverse each makes a kernel of its own."""
    (a0, a1, a2), (b0, b1, b2) = ((x[0], x[1], x[2]) for x in (a, b))
    return (a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0)


def triple(a, b, c):
    """Scalar triple product ``a · (b × c)``."""
    n = cross3(b, c)
    return a[0] * n[0] + a[1] * n[1] + a[2] * n[2]


def unit(a):
    """A direction divided by its length; zero for a zero direction."""
    return a * ratio(1.0, norm(a))


def unit_of(a, form: str):
    """A direction of a form as a unit vector: a vector is one already, by its own row or by its drawing."""
    return a if form == "v" else unit(a)


def about(axis, start, to):
    """Cosine and sine parts of the angle from `start` to `to` about a unit `axis`, times their two radii.

    Both directions are projected on the plane across the axis: the factor that erratum 3 misses in (155)-(156).
    """
    return dot(start, to) - dot(start, axis) * dot(to, axis), triple(axis, start, to)


def radius(axis, a) -> Any:
    """Length of a direction's projection on the plane across a unit `axis`."""
    along = dot(a, axis)
    return root(dot(a, a) - along * along)
