"""Directions in space as operands of a kind: a unit vector, or the segment between two points.

"A unit vector may stand for two points and the other way round" (source text §4). A kind over directions is made for a
string of forms, one letter each: ``"v"`` takes a unit vector of the instance, ``"p"`` two of its points.
"""

from collections.abc import Callable
from typing import Any

from jaxnc.constraints.elementary import ratio, root
from jaxnc.constraints.kind import dot, norm
from jaxnc.types import Array


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
