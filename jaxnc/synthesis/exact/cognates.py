"""Roberts' cognates: the three four-bars of one coupler curve, and whether two four-bars have the same curve."""

import cmath
import itertools
from collections.abc import Sequence

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.synthesis.exact.linkage import FourBar, SliderCrank, point_of
from jaxnc.system.system import System
from jaxnc.types import Float

SAME = 1e-9
"""Curves whose parameters differ by less than this part of their size are the same."""

_FLAT = 1e-9  # of the size: a coupler point this close to a joint has no cognates


@public
def roberts_cognates(linkage: FourBar | System, point: str = "P") -> tuple[FourBar, FourBar]:
    """The two other four-bars whose coupler point draws the same curve (Roberts-Chebyshev theorem).

    All three are drawn with the coupler point in the same place. With the fixed pivots A, D of the given linkage and
    E, the third vertex of the triangle A-D-E similar to its coupler B-C-P:

    - the first stands on A and E, and its *coupler* turns with the given crank;
    - the second stands on E and D, and its *crank* at E turns with the given crank, so that it draws the curve with the
      same timing.

    Args:
        linkage: a four-bar; or a system, from which one is read (`FourBar.of`).
        point: the coupler point of a system.

    Returns:
        The two cognates; `FourBar.system` compiles them.

    Raises:
        InputError: a system that is no four-bar, or a coupler point on a moving pivot, which draws a circle.

    Source: S. Roberts, On three-bar motion in plane space, Proc. London Math. Soc. 7 (1875) 14-23; R. S. Hartenberg and
    J. Denavit, Kinematic Synthesis of Linkages (1964), chapter 6.
    """
    given = linkage if isinstance(linkage, FourBar) else FourBar.of(linkage, point)
    first = _left_cognate(given)
    second = _left_cognate(given.reversed()).reversed()  # on D and E; its crank is the one at E
    return first, second


def _left_cognate(linkage: FourBar) -> FourBar:
    """The cognate on A and E: the parallelogram A-B-P-B' and a coupler similar to the given one."""
    a, b, _, d, p = linkage.z
    k = _coupler_shape(linkage)
    moved = a + p - b
    return FourBar(
        point_of(a), point_of(moved), point_of(moved + k * (b - a)), point_of(a + k * (d - a)), point_of(p)
    )  # fmt: skip


def _coupler_shape(linkage: FourBar) -> complex:
    k = linkage.ratio
    for name, distance in (("B", abs(k)), ("C", abs(1.0 - k))):
        if distance < _FLAT:
            raise InputError(
                f"cognates: the coupler point lies on the moving pivot {name} and draws a circle, so there are no "
                f"cognates; choose a point of the coupler off its pivots"
            )
    return k


@public
def coupler_curve(linkage: FourBar | System, point: str = "P") -> Float[np.ndarray, "3 3"]:
    """The nine numbers that a coupler curve has, the same for all three cognates.

    A coupler curve has three foci, the fixed pivots of its cognates, and at each focus stands one number: a bar's
    length over the distance of the linkage's fixed pivots. In the linkage on A and D with third focus E, that of the
    crank A-B belongs to D, that of the rocker C-D to A, that of the coupler B-C to E; the same rule read off either
    cognate gives the same three pairs.

    Args:
        linkage: a four-bar, or a system from which one is read.
        point: the coupler point of a system.

    Returns:
        A row for each focus: x, y, number. Rows are in order of x, then y.

    Raises:
        InputError: as in `roberts_cognates`.

    Source: own derivation from Roberts' construction; the foci are those of S. Roberts (1875).
    """
    given = linkage if isinstance(linkage, FourBar) else FourBar.of(linkage, point)
    a, _, _, d, _ = given.z
    k = _coupler_shape(given)
    size = given.lengths
    foci = [(a, size["rocker"]), (d, size["crank"]), (a + k * (d - a), size["coupler"])]
    rows = np.array([(z.real, z.imag, length / size["ground"]) for z, length in foci])
    return rows[np.lexsort((rows[:, 1], rows[:, 0]))]


@public
def same_curve(one: FourBar | System, other: FourBar | System, point: str = "P", tolerance: float = SAME) -> bool:
    """Tell whether two four-bars draw the same coupler curve: the same linkage, or cognates.

    Place, size and orientation count: a linkage moved elsewhere draws another curve. A curve may have two parts, drawn
    by the two assemblies of one linkage; they belong together here.

    Args:
        one: a four-bar, or a system from which one is read.
        other: another.
        point: the coupler point of systems.
        tolerance: difference of foci and numbers, as a part of the curve's size.

    Returns:
        True if all nine parameters of the curves agree.

    Raises:
        InputError: as in `roberts_cognates`.
    """
    return _curve_gap(coupler_curve(one, point), coupler_curve(other, point)) <= tolerance


def _curve_gap(x: np.ndarray, y: np.ndarray) -> float:
    """Largest difference of two curves' parameters, matching foci whichever their order (they may nearly coincide)."""
    size = max(float(np.ptp(x[:, :2], axis=0).max()), 1e-300)
    scale = np.array([size, size, max(1.0, float(np.abs(x[:, 2]).max()))])
    return min(float(np.abs((x - y[list(order)]) / scale).max()) for order in itertools.permutations(range(3)))


@public
def distinct(
    linkages: Sequence[FourBar | System], point: str = "P", tolerance: float = SAME
) -> list[list[int]]:  # fmt: skip
    """Group four-bars by their coupler curves.

    Args:
        linkages: four-bars or systems, the best first.
        point: the coupler point of systems.
        tolerance: as in `same_curve`.

    Returns:
        For each different curve the places of its linkages in the sequence, in order of first appearance; the first of
        each group is the one to keep.

    Raises:
        InputError: as in `roberts_cognates`.
    """
    curves = [coupler_curve(linkage, point) for linkage in linkages]
    groups: list[list[int]] = []
    for i, curve in enumerate(curves):
        like = next((group for group in groups if _curve_gap(curves[group[0]], curve) <= tolerance), None)
        if like is None:
            groups.append(like := [])
        like.append(i)
    return groups


@public
def slider_crank_cognate(linkage: SliderCrank) -> SliderCrank:
    """The other slider-crank whose rod point draws the same curve; its connecting rod turns with the given crank.

    Args:
        linkage: a slider-crank with a point P off its crank pin.

    Returns:
        The cognate, on the same crank pivot, its line turned and scaled by the rod's shape about that pivot.

    Raises:
        InputError: a point P on the crank pin, which draws a circle.

    Source: limit of Roberts' theorem with one fixed pivot at infinity; Hartenberg and Denavit (1964), chapter 6.
    """
    k = linkage.ratio
    if abs(k) < _FLAT:
        raise InputError(
            "cognates: the point P lies on the crank pin B and draws a circle, so there is no cognate; choose another"
        )
    a, b = complex(*linkage.A), complex(*linkage.B)
    p = complex(*(linkage.P or linkage.B))
    pin = a + p - b
    line = complex(*linkage.direction) * cmath.rect(1.0, float(np.angle(k)))
    return SliderCrank(linkage.A, point_of(pin), point_of(pin + k * (b - a)), point_of(line), point_of(p))
