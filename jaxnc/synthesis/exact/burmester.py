"""Burmester's theory: dyads that guide a body through two to five poses, exactly, and nearest to more of them.

Bars that guide a body nearest to any number of poses: all stationary points of a least-squares design.

What a bar misses in a pose is the difference of its squared length from the mean square. With the bar w in one pose,
the place z of its end on the body and their conjugates that is linear in w, w̄, z, z̄, w̄z, wz̄ and zz̄, so the mean
square of it is a quadratic form of these and 1, whatever the number of poses. Where it does not change with w and z are
the solutions of four equations; with the three products they are seven of second degree in seven unknowns, of total
degree 128. 25 of the paths end in solutions, the others at infinity, for all poses that were tried but special ones.

Source: the equations are derived here. Stationary points instead of one local minimum: A. Baskar, M. Plecnik and
J. Hauenstein, Computing saddle graphs via homotopy continuation for the approximate synthesis of mechanisms, Mech.
Mach. Theory 176 (2022) 104932.
"""

import contextlib
import dataclasses
import itertools
import math

import numpy as np

from jaxnc.calls import public
from jaxnc.continuation.certificate import certify
from jaxnc.continuation.monodromy import is_new, solve_by_degree
from jaxnc.errors import InputError, counted
from jaxnc.kinematics.inputs import one_number, whole
from jaxnc.synthesis.exact.linkage import GuidedFourBar, Listed, Point, complex_of, guide_four_bar, point_of
from jaxnc.synthesis.validate import as_floats, check_limit, check_radians
from jaxnc.types import ArrayLike, Float

_TRIES = 3  # ways from a start system to the poses, each about two origins


@public
@dataclasses.dataclass(frozen=True)
class NearestDyads(Listed["Dyad"]):
    """All bars for which the least-squares error is stationary, the best first; ``print()`` lists them.

    Attributes:
        dyads: the bars.
        errors: of each the root mean square of what its length would have to change by in the poses, lengths, ``(k,)``.
        minima: of each whether no small change makes it better; the others are saddles, ``(k,)``.
        proved: of each whether the stationary point is proved to exist and to be real (Krawczyk's test), ``(k,)``.
        complex_points: how many stationary points are complex.
        complete: whether every other path of the total degree went to infinity, so that there are no more with pivots
            nearer than 1,000 sizes of the poses.
    """

    dyads: tuple["Dyad", ...]
    errors: np.ndarray
    minima: np.ndarray
    proved: np.ndarray
    complex_points: int
    complete: bool

    @property
    def statement(self) -> str:
        """What is known of the number of stationary points."""
        total = len(self.dyads) + self.complex_points
        if self.complete:
            known = (
                f"All {counted(total, 'stationary point')} with pivots nearer than 1,000 sizes of the poses, by total "
                f"degree: every other path went further."
            )
        else:
            known = f"{counted(total, 'stationary point')}; there may be more, since some are singular or not alone."
        return f"{known} Proved to exist: {int(self.proved.sum())} of {len(self.dyads)} real ones."

    def __repr__(self) -> str:
        lines = [f"{counted(len(self.dyads), 'stationary bar')}, {int(self.minima.sum())} of them minima"]
        for dyad, error, least in zip(self.dyads, self.errors, self.minima, strict=True):
            lines.append(f"  {'minimum' if least else 'saddle '}  error {error:.3g}  {dyad}")
        return "\n".join([*lines, f"  {self.statement}"])


def find_stationary(
    turn: np.ndarray, shift: np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int, bool]:
    """Find all bars whose least-squares error is stationary.

    Bars are sought about the body's origin, and about the point that moves least: where the body turns little, or its
    origin is far away, the one set of numbers is well conditioned and the other is not.

    Args:
        turn: of the body in each pose, a complex number of unit size.
        shift: its place.
        known: bars ``(k, 2)`` that may be near others, as circle point z and centre a.

    Returns:
        The real bars ``(k, 2)``, which of them are minima and which are proved, how many stationary points are complex,
        and whether these are all.

    Raises:
        InputError: the body turns about one point.
    """
    mean = turn.mean()
    first = mean / abs(mean) if abs(mean) > 0.1 else 1.0  # the pose in which unknowns are counted
    change, about = turn / first - 1.0, shift - shift.mean()
    off = change - change.mean()
    still = -np.vdot(off, about) / np.vdot(off, off).real
    if np.abs(about + off * still).max() < 1e-9 * max(1.0, np.abs(about).max()):
        raise InputError("guidance: the body only turns about one point, so every bar to that point is exact")
    bars, proved, complex_points, agreed = known, np.zeros(0, bool), 0, 0
    for seed, origin in itertools.product(range(_TRIES), (0.0, still)):
        place = about + off * origin
        unit, middle = np.sqrt(np.mean(np.abs(place) ** 2)), shift.mean() + origin * (1.0 + change.mean())
        z = bars[:, 0] * first - origin
        begin = np.stack([z + middle - bars[:, 1], z])
        (w, z), proved, complex_points, complete = _solve_about(change, place, unit, seed, begin)
        bars, agreed = np.stack([(z + origin) / first, z - w + middle], axis=1), agreed + 1 if complete else 0
        if agreed == 2:  # one way alone may not show a pivot that is far away
            break
    about = turn - 1.0, shift - shift[0]
    minima = np.array([_is_minimum(b + shift[0] - a, b, *about) for b, a in bars], bool)
    return bars, minima, proved, complex_points, agreed > 0


def _solve_about(
    change: np.ndarray, place: np.ndarray, unit: float, seed: int, known: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int, bool]:
    """Solve for bars ``w + change z + place``, of poses whose places are about zero and some units large.

    Returns:
        w and z of the real ones, those known among them; which are proved; how many others are complex; and whether
        the paths found all of these, and every other path went to infinity.
    """
    conj = np.conj
    wide = np.sqrt(np.mean(np.abs(change) ** 2))  # by so much the body turns: circle points are so much farther away
    d, s = change / wide, place / unit
    columns = np.stack(
        [abs(s) ** 2, conj(s), s, d * conj(s), conj(d) * s, d, conj(d), abs(d) ** 2], axis=1
    )  # by 1, w, w̄, z, z̄, w̄z, wz̄, zz̄  # fmt: skip
    columns = columns - columns.mean(axis=0)  # the squared length that fits best
    form = columns.T @ columns / len(d)
    t = np.zeros((7, 8, 8), complex)
    # For w, w̄, z and z̄ the column of its own, and the products in which it stands, with their other factor.
    terms = ((1, (6, 4)), (2, (5, 3)), (3, (5, 2), (7, 4)), (4, (6, 1), (7, 3)))
    for row, (own, *products) in enumerate(terms):
        t[row, 0] += form[own]
        for product, factor in products:
            t[row, factor] += form[product]
    for row, (product, *factors) in enumerate(((5, 2, 3), (6, 1, 4), (7, 3, 4)), start=4):
        t[row, 0, product], t[row, factors[0], factors[1]] = 1.0, -1.0
    t = 0.5 * (t + np.swapaxes(t, 1, 2))
    ends, all_else_far = solve_by_degree(t, np.random.default_rng(seed))
    # In real and imaginary parts the equations are real, and so are the solutions that are bars.
    basis = np.eye(8, dtype=complex)
    for k in (1, 3, 5):
        basis[k : k + 2, k : k + 2] = [[1, 1j], [1, -1j]]
    t = np.einsum("rij,ip,jq->rpq", t, basis, basis)
    pairs = [part for k in (0, 2, 4) for part in (t[k] + t[k + 1], (t[k] - t[k + 1]) / 1j)]
    t = np.real([*pairs, t[6]])
    x = np.linalg.solve(basis[1:, 1:], ends)
    starts = known[0] / unit, known[1] * wide / unit
    real, found = np.zeros((4, 0)), []
    for some in (x[:4], np.stack([part for z in starts for part in (np.real(z), np.imag(z))])):
        improved = [end for start in some.T if (end := _improve_real(d, s, start)) is not None]
        x = np.array(improved).reshape(-1, 4).T
        real = np.concatenate([real, x[:, is_new(real, x)]], axis=1)
        found.append(real.shape[1])
    others = ends.shape[1] - found[0]
    complete = all_else_far and others % 2 == 0 and found[0] == found[1]  # complex ones come in pairs
    w, z = real[0] + 1j * real[1], real[2] + 1j * real[3]
    product = conj(w) * z
    proved = certify(t, np.concatenate([real, [np.real(product), np.imag(product), abs(z) ** 2]])).proved
    return np.stack([w, z / wide]) * unit, proved, others, complete


def _improve_real(d: np.ndarray, s: np.ndarray, start: np.ndarray) -> np.ndarray | None:
    """Take Newton's steps from the real part of w and z; None if they lead elsewhere: then it is a complex solution."""
    size = max(1.0, float(np.abs(start).max()))
    if np.abs(np.imag(start)).max() > 1e-3 * size:
        return None
    x = np.real(start).copy()
    for _ in range(8):
        slope, hessian = _expand(x[0] + 1j * x[1], x[2] + 1j * x[3], d, s)
        step = np.linalg.lstsq(hessian, slope, rcond=1e-15)[0]
        x -= step
    near = np.abs(x - np.real(start)).max() < 1e-2 * size
    return x if near and np.abs(step).max() < 1e-6 * size else None


def _expand(w: complex, z: complex, d: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slope and second derivatives of half the mean square, by the real and imaginary parts of w and z."""
    bar = w + d * z + s
    along = np.conj(bar) * d
    slopes = np.stack([np.real(bar), np.imag(bar), np.real(along), -np.imag(along)], axis=1)
    slopes = slopes - slopes.mean(axis=0)
    square = 0.5 * np.abs(bar) ** 2
    miss = square - square.mean()
    mixed, own = complex(np.mean(miss * d)), float(np.mean(miss * np.abs(d) ** 2))
    hessian = slopes.T @ slopes / len(d)
    hessian[:2, 2:] += [[mixed.real, -mixed.imag], [mixed.imag, mixed.real]]
    hessian[2:, :2] = hessian[:2, 2:].T
    hessian[2:, 2:] += own * np.eye(2)
    return slopes.T @ miss / len(d), hessian


def _is_minimum(w: complex, z: complex, d: np.ndarray, s: np.ndarray) -> bool:
    """Tell whether a bar is exact, or second derivatives of its error are positive, in numbers of one size."""
    square = np.abs(w + d * z + s) ** 2
    if np.ptp(square) <= 1e-12 * square.max():  # where several bars meet, second derivatives are zero too
        return True
    hessian = _expand(w, z, d, s)[1]
    scale = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(hessian)), np.finfo(float).tiny))
    return bool(np.linalg.eigvalsh(hessian * scale[:, None] * scale)[0] > 1e-13)


# -- two conics --------------------------------------------------------------------------------------------------------

_SEED = 20  # of the change of coordinates that keeps solutions away from infinity


def common_points(p: Float[np.ndarray, "3 3"], q: Float[np.ndarray, "3 3"]) -> list[np.ndarray]:
    """Intersect two conics x·P·x = 0 and x·Q·x = 0 in the projective plane.

    In general coordinates (1, s, t) Sylvester's resultant with respect to t is a quartic in s.

    There are up to four points ``(3,)``, complex, of unit size; real points have the phase of real ones.

    Source: any text on elimination, e.g. D. Cox, J. Little, D. O'Shea, Ideals, Varieties, and Algorithms, chapter 3.
    """
    turn = np.linalg.qr(np.random.default_rng(_SEED).normal(size=(3, 3)))[0]
    p, q = (m / np.abs(m).max() for m in (turn.T @ p @ turn, turn.T @ q @ turn))

    def in_t(m: np.ndarray, s: complex) -> tuple[complex, complex, complex]:
        return m[2, 2], 2.0 * (m[0, 2] + m[1, 2] * s), m[0, 0] + 2.0 * m[0, 1] * s + m[1, 1] * s * s

    def resultant(s: complex) -> complex:
        (a, b, c), (d, e, f) = in_t(p, s), in_t(q, s)
        return (a * f - c * d) ** 2 - (a * e - b * d) * (b * f - c * e)

    roots_of_unity = np.exp(2j * np.pi * np.arange(5) / 5)
    quartic = np.fft.fft([resultant(s) for s in roots_of_unity]).real / 5  # ascending powers
    found = []
    for s in np.roots(quartic[::-1]):
        (a, b, c), (d, e, f) = in_t(p, s), in_t(q, s)
        t = -(a * f - c * d) / (a * e - b * d)
        x = np.array([1.0, s, t], complex)
        for _ in range(6):  # Newton's steps on the conics themselves
            rest = np.array([x @ p @ x, x @ q @ x])
            slope = 2.0 * np.stack([p @ x, q @ x])[:, 1:]
            step = np.linalg.lstsq(slope, rest, rcond=1e-15)[0]
            if not np.isfinite(step).all() or np.abs(step).max() > 0.1 * np.abs(x).max():
                break
            x[1:] -= step
        found.append(turn @ (x / np.linalg.norm(x)))
    return found


# -- the circle-point curve --------------------------------------------------------------------------------------------


def cubic_value(forms: Float[np.ndarray, "3 3 3"], b: np.ndarray | complex) -> np.ndarray:
    """The cubic at points b, complex: the determinant of the three equations of the centre."""
    place = np.stack([np.real(b), np.imag(b), np.ones(np.shape(b))], axis=-1)
    return np.linalg.det(np.einsum("jkl,...l->...jk", forms, place))


def cubic_slope(forms: np.ndarray, b: complex) -> complex:
    """Gradient of the cubic at a point, as a complex number."""
    h = 1.0  # a cubic: central differences and a third-order correction are exact
    parts = []
    for e in (1.0, 1j):
        f = [complex(cubic_value(forms, b + k * h * e)).real for k in (-2, -1, 1, 2)]
        parts.append((f[0] - 8 * f[1] + 8 * f[2] - f[3]) / (12 * h))
    return complex(*parts)


def nearest_on_cubic(forms: np.ndarray, begin: complex, near: complex) -> complex:
    """The point of the curve that is nearest to a place, from one that is about there.

    Newton's steps on two conditions: it is on the curve, and the way from the place runs across the curve.
    """

    def conditions(z: complex) -> np.ndarray:
        g = cubic_slope(forms, z)
        return np.array([complex(cubic_value(forms, z)).real, (np.conj(g) * (z - near)).imag])

    def onto_curve(b: complex) -> complex:
        for _ in range(10):
            g = cubic_slope(forms, b)
            b -= complex(cubic_value(forms, b)).real * g / max(abs(g) ** 2, 1e-300)
        return b

    b = begin
    for _ in range(60):
        h = 1e-6 * (1.0 + abs(b))
        slope = np.stack([(conditions(b + e * h) - conditions(b - e * h)) / (2.0 * h) for e in (1.0, 1j)], axis=1)
        step = complex(*np.linalg.lstsq(slope, conditions(b), rcond=1e-14)[0])
        b -= step * min(1.0, 0.3 * (1.0 + abs(begin - near)) / max(abs(step), 1e-300))
        if abs(step) < 1e-12 * (1.0 + abs(b)):
            break
    return min(onto_curve(begin), onto_curve(b), key=lambda z: abs(z - near))


def _crossings(forms: np.ndarray, start: complex, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coefficients of the quadratic that gives the other two points of the lines ``start + s e^{iα}``."""
    s = np.array([-2.0, -1.0, 1.0, 2.0])
    f = cubic_value(forms, start + s[:, None] * np.exp(1j * angles))
    odd2, odd1 = 0.5 * (f[3] - f[0]), 0.5 * (f[2] - f[1])  # f = c1 s + c2 s² + c3 s³, since start is on the curve
    even2, even1 = 0.5 * (f[3] + f[0]), 0.5 * (f[2] + f[1])
    c3 = (odd2 - 2.0 * odd1) / 6.0
    return c3, (even2 - even1) / 3.0, odd1 - c3


def trace_cubic(forms: np.ndarray, start: complex, points: int) -> np.ndarray:
    """The real curve of three bilinear equations ``(3, 3, 3)`` as polylines, complex, with NaN between pieces.

    A piece has about so many points, some of them far away.
    """
    angles = np.linspace(0.0, np.pi, 4001)

    def inside(angle: np.ndarray) -> np.ndarray:
        c3, c2, c1 = _crossings(forms, start, angle)
        return c2 * c2 - 4.0 * c3 * c1

    found = inside(angles)
    ends = []
    for k in np.flatnonzero((found[:-1] >= 0) != (found[1:] >= 0)):
        low, high = angles[k], angles[k + 1]
        for _ in range(60):
            middle = 0.5 * (low + high)
            same = (inside(np.array([middle]))[0] >= 0) == (found[k] >= 0)
            low, high = (middle, high) if same else (low, middle)
        ends.append(0.5 * (low + high))
    if not ends:
        spans = [(0.0, np.pi)] if found[0] >= 0 else []
    else:
        first = 0 if found[0] < 0 else 1  # the first end opens or closes a span
        turned = [*ends[first:], *(e + np.pi for e in ends[:first])]
        spans = list(zip(turned[::2], turned[1::2], strict=True))
    pieces = []
    # The cubic is circular, c3 = A cos α + B sin α: where that vanishes, along the asymptote, points are far away.
    cosine, sine = _crossings(forms, start, np.array([0.0, 0.5 * np.pi]))[0]
    off = np.geomspace(1e-9, 1e-2, 100)
    beyond = np.arctan2(-cosine, sine) + np.concatenate([-off, off])
    for low, high in spans:
        # Evenly in the angle of a circle over the span: the two points of a line meet at its ends like a square root.
        around = np.linspace(0.0, np.pi, points // 2)
        angle = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(around)
        if not ends:
            angle = np.linspace(low, high, points // 2)
        lines = (beyond[:, None] + np.pi * np.arange(-1, 3)).ravel()
        angle = np.sort(np.concatenate([angle, lines[(low < lines) & (lines < high)]]))
        c3, c2, c1 = _crossings(forms, start, angle)
        root = np.sqrt(np.maximum(c2 * c2 - 4.0 * c3 * c1, 0.0))
        for sign in (1.0, -1.0):
            # Of s = 2 c1 / (-c2 ∓ root) and (-c2 ± root) / 2 c3 take the one that does not cancel.
            big = -c2 + np.where(c2 > 0, -root, root)
            takes = (c2 > 0) == (sign < 0)
            with np.errstate(divide="ignore", invalid="ignore"):
                s = np.where(takes, big / (2.0 * c3), 2.0 * c1 / big)
                b = start + s * np.exp(1j * angle)
            b = np.where(np.isfinite(b), b, np.nan)
            pieces += [b[:: int(sign)], np.array([np.nan + 0j])]
    return np.concatenate(pieces) if pieces else np.zeros(0, complex)


# -- guidance ----------------------------------------------------------------------------------------------------------

EXACT = 1e-12
"""Residual of a dyad, beside the size of the poses, that counts as exact."""


@public
@dataclasses.dataclass(frozen=True)
class Dyad:
    """A bar that a body can be guided by: a circle point of the body and the centre of its circle.

    Attributes:
        moving: the circle point on the body, where it is in the first pose, lengths.
        fixed: the centre point on the ground.
        places: where the circle point is in every pose, ``(n, 2)``.
        length: length of the bar.
        residual: largest difference of its distance from the centre between the poses, as a part of the poses' size, or
            of the bar's length if that is larger.
    """

    moving: Point
    fixed: Point
    places: np.ndarray
    length: float
    residual: float

    def __repr__(self) -> str:
        (x, y), (u, v) = self.moving, self.fixed
        return (
            f"moving ({x:.6g}, {y:.6g}), fixed ({u:.6g}, {v:.6g}), length {self.length:.6g}, "
            f"residual {self.residual:.1e}"
        )


@public
@dataclasses.dataclass(frozen=True)
class BurmesterPairs(Listed[Dyad]):
    """All dyads through five poses; ``print()`` lists them.

    Attributes:
        pairs: the real ones, 0, 2 or 4 in general.
        complex_pairs: how many solutions are complex.
        at_infinity: how many have a pivot at infinity (a slider instead of a bar).
        residual: largest residual of the five equations over all finite solutions, complex ones included, as a part of
            the poses' size.
    """

    pairs: tuple[Dyad, ...]
    complex_pairs: int
    at_infinity: int
    residual: float

    @property
    def complete(self) -> bool:
        """True if all four solutions that five poses in general have were found, each with an exact residual."""
        return len(self.pairs) + self.complex_pairs + self.at_infinity == 4 and self.residual <= EXACT

    def __repr__(self) -> str:
        head = (
            f"{len(self.pairs)} real Burmester pairs, {self.complex_pairs} complex, {self.at_infinity} at infinity; "
            f"residual {self.residual:.1e}"
        )
        return "\n".join([head, *(f"  {pair}" for pair in self.pairs)])


@public
@dataclasses.dataclass(frozen=True)
class BurmesterCurves:
    """Circle-point and centre-point curve of four poses, point for point.

    Attributes:
        circle: circle points in the body's first pose, ``(n, 2)``; rows of NaN separate the pieces.
        centre: the centres that belong to them, ``(n, 2)``; NaN too where a centre is at infinity.
        poles: poles of the displacements between two poses, which lie on the centre-point curve, ``(6, 2)``; NaN for
            pure translations.
    """

    circle: np.ndarray
    centre: np.ndarray
    poles: np.ndarray

    def plot(self, **options):
        """Draw both curves; see `jaxnc.viz.burmester`."""
        from jaxnc import viz

        return viz.burmester(self, **options)


@public
class Guidance:
    """Planar guidance of a body through two to five poses, or near more of them.

    Args:
        poses: x, y and angle of the body in each pose, ``(n, 3)``, lengths and radians, n ≥ 2, in order.

    Raises:
        InputError: poses of another shape or number, not finite, or two that are the same.

    Source: L. Burmester, Lehrbuch der Kinematik (1888); J. M. McCarthy and G. S. Soh, Geometric Design of Linkages
    (2011), chapters 2, 3 and 5; O. Bottema and B. Roth, Theoretical Kinematics (1979), chapter 8. The elimination for
    five poses (a pencil of two conics in the null space of linear equations) is derived here.
    """

    def __init__(self, poses: ArrayLike):
        given = np.array(as_floats(poses, "guidance: poses must be numbers (x, y, angle)"))
        if given.ndim != 2 or given.shape[1] != 3:
            raise InputError(f"guidance: poses must have shape (n, 3): x, y, angle; got {given.shape}")
        if len(given) < 2:
            raise InputError(f"guidance: {len(given)} poses; give at least 2")
        if not np.isfinite(given).all():
            raise InputError(f"guidance: pose {int(np.argmin(np.isfinite(given).all(axis=1))) + 1} is not finite")
        check_radians(given[:, 2], "guidance: orientations", 2 * np.pi, "leave out whole turns")
        self.poses = given
        place, turn = given[:, 0] + 1j * given[:, 1], np.exp(1j * given[:, 2])
        for i, j in itertools.combinations(range(len(given)), 2):
            if abs(place[i] - place[j]) + abs(turn[i] - turn[j]) < 1e-12 * (1.0 + abs(place[i])):
                raise InputError(f"guidance: poses {i + 1} and {j + 1} are the same; leave one out")
        # Lengths about the middle of the poses, in units of their size, so that one tolerance means something.
        self._origin = complex(place.mean())
        spread = float(np.abs(place - self._origin).max())
        self._size = spread if spread > 0 else 1.0
        p = (place - self._origin) / self._size
        self._turn = turn / turn[0]
        self._shift = p - self._turn * p[0]

    def __repr__(self) -> str:
        return f"Guidance({len(self.poses)} poses)"

    # -- dyads -----------------------------------------------------------------------------------------------------

    def dyad(self, moving: Point | None = None, fixed: Point | None = None, along: float = 0.0) -> Dyad:
        """The dyad of a chosen moving or fixed pivot, for two or three poses.

        Args:
            moving: circle point of the body in its first pose; its centre is found.
            fixed: centre point; its circle point is found.
            along: with two poses, where on the line that is free: distance from the middle of the pivot's two places,
                to the left of the way from the first to the second, a length.

        Raises:
            InputError: both or none of the pivots, more poses than three, or a pivot at infinity.
        """
        if (moving is None) == (fixed is None):
            raise InputError("guidance: give one of moving= and fixed=; the other follows")
        if len(self.poses) > 3:
            raise InputError(
                f"guidance: {len(self.poses)} poses leave no pivot to choose freely; use "
                + {4: "curves()", 5: "pairs()"}.get(len(self.poses), "nearest_dyads()")
            )
        along = one_number(along, "guidance: along=")
        name = "moving" if moving is not None else "fixed"
        z = self._inwards(complex_of("guidance", name, moving if moving is not None else fixed))
        # The places of the chosen pivot, and for a fixed one those seen from the body in its first pose.
        seen = self._turn * z + self._shift if moving is not None else (z - self._shift) / self._turn
        if len(self.poses) == 2:
            way = seen[1] - seen[0]
            if abs(way) < 1e-12:
                raise InputError(f"guidance: the {name} pivot is the pole, which does not move; choose another")
            other = 0.5 * (seen[0] + seen[1]) + 1j * way / abs(way) * along / self._size
        else:
            other = _circumcentre(seen)
            if other is None:
                raise InputError(
                    f"guidance: the three places of the {name} pivot lie in a line, so the other pivot is at infinity; "
                    f"choose another pivot (or guide this one by a slider along that line)"
                )
        return self._dyad(z, other) if moving is not None else self._dyad(other, z)

    def pole(self, first: int, second: int) -> Point:
        """Pole of the displacement from one pose to another, the point that stays: ``(x, y)``, infinite if none does.

        Args:
            first: number of a pose, from 0.
            second: number of another.
        """
        last = len(self._turn) - 1
        first = whole(first, "pole(): first", -1 - last, last)
        second = whole(second, "pole(): second", -1 - last, last)
        turn = self._turn[second] / self._turn[first]
        shift = self._shift[second] - turn * self._shift[first]
        if abs(1.0 - turn) < 1e-14:
            return (math.inf, math.inf)
        return point_of(self._outwards(shift / (1.0 - turn)))

    def curves(self, points: int = 400, extent: float = 20.0) -> BurmesterCurves:
        """Circle-point and centre-point curve of four poses.

        Args:
            points: about how many points each piece of the curve has.
            extent: how far to follow it to infinity, in sizes of the poses.

        Returns:
            Both curves, point for point; every pair of points is a dyad (`curve_dyad`).

        Raises:
            InputError: not four poses, or four that are all translations of one another; no point of the curve is
                within the extent.
        """
        self._check_count(4, "curves()")
        whole(points, "curves(): points", 2)
        check_limit("curves()", "a positive number", extent=extent)
        poles = np.array([self.pole(i, j) for i, j in itertools.combinations(range(4), 2)])
        forms, b = self._trace(points, extent)
        a = _partners(forms, b)
        far = ~(np.abs(a) < extent)
        circle = self._outwards(b)
        centre = np.where(far, np.nan, self._outwards(a))
        pole_points = np.where(np.isfinite(poles), poles, np.nan)
        return BurmesterCurves(_as_columns(circle), _as_columns(centre), pole_points)

    def curve_dyad(self, near: Point) -> Dyad:
        """The dyad of four poses whose circle point lies on the curve nearest to a place.

        Args:
            near: a place, in the body's first pose.

        Returns:
            The dyad, exact: the point of the curve is polished, not interpolated.

        Raises:
            InputError: not four poses, four of which no curve is known, or a place so far off that its dyad's bar has
                no end that is known exactly.
        """
        self._check_count(4, "curve_dyad()")
        place = self._inwards(complex_of("guidance", "near", near))
        forms, curve = self._trace(2000, 20.0 + 4.0 * abs(place))
        curve = curve[np.isfinite(curve)]
        b = nearest_on_cubic(forms, complex(curve[np.argmin(np.abs(curve - place))]), place)
        found = self._dyad(b, complex(_partners(forms, np.array([b]))[0]))
        if not found.residual <= EXACT:
            raise InputError(
                f"guidance: the dyad nearest to {near} misses the poses by {found.residual:.1e} of its size: its bar "
                f"is so long that it is next to a slider; choose a place nearer to the poses"
            )
        return found

    def _trace(self, points: int, extent: float) -> tuple[np.ndarray, np.ndarray]:
        """The forms of four poses, and the circle-point curve as polylines, see `trace_cubic`."""
        # As seen from the body in its first pose, poles lie on the circle-point curve: one of them starts the pencil.
        pairs = itertools.combinations(range(4), 2)
        seen = [(self._inwards(complex(*self.pole(i, j))) - self._shift[i]) / self._turn[i] for i, j in pairs]
        seen = [z for z in seen if np.isfinite(z)]
        if not seen:
            raise InputError(
                "guidance: the poses are translations of one another; every point is a circle point of three"
            )
        forms = self._forms()
        b = trace_cubic(forms, min(seen, key=abs), points)
        if not np.isfinite(b).any():
            raise InputError(
                "guidance: every point of the body goes on a circle through these poses, as where it turns about one "
                "point; leave a pose out and choose a dyad by dyad()"
            )
        b = np.where(np.abs(b) < extent, b, np.nan)
        if not np.isfinite(b).any():
            raise InputError(
                f"guidance: no point of the curve is within extent={extent:g} sizes of the poses from their middle; "
                f"follow it further"
            )
        return forms, b

    def _check_turns(self) -> None:
        if np.abs(self._turn - 1.0).max() < 1e-9:
            raise InputError(
                "guidance: the body does not turn, so any parallelogram whose bars suit one point suits all; use "
                "jaxnc.synthesis.PathGeneration for that point"
            )

    def pairs(self) -> BurmesterPairs:
        """All dyads through five poses: Burmester's pairs, at most four real ones.

        Returns:
            The pairs with a certificate: all solutions of the equations are counted, and the residual of each is known.

        Raises:
            InputError: not five poses, or a body that does not turn.
        """
        self._check_count(5, "pairs()")
        self._check_turns()
        forms = self._forms()
        # Unknowns, homogeneous: s, u = s b, a, v = ā b (complex ones as two), with four linear equations, of the same
        # coefficients, and s v = ā u, two conics in the plane that the linear equations leave.
        rows = forms[:, [2, 2, 2, 0, 1, 0, 0], [2, 0, 1, 2, 2, 0, 1]]
        _, sizes, directions = np.linalg.svd(rows)
        if sizes[3] < 1e-12 * sizes[0]:
            raise InputError(
                "guidance: the poses are so special that infinitely many dyads pass all five, as where the body turns "
                "about one point; leave one out and choose a dyad by curve_dyad()"
            )
        basis = directions[-3:]
        s, u, a, v = basis[:, 0], *(basis[:, 1::2] + 1j * basis[:, 2::2]).T
        product = np.outer(s, v) - np.outer(np.conj(a), u)
        conics = [0.5 * (q + q.T) for q in (np.real(product), np.imag(product))]
        real, others, infinite, worst = [], 0, 0, 0.0
        for w in common_points(*conics):
            scale = w @ s
            # beyond 1e6 times the size of the poses a pivot is at infinity, its bar a slider
            if abs(scale) * 1e6 < np.abs(w @ basis).max():
                infinite += 1
                continue
            x = np.array([w @ np.real(u), w @ np.imag(u), w @ np.real(a), w @ np.imag(a)]) / scale
            x, rest = _polish_pair(forms, x)
            # an imaginary part, beside the root's size, of a root that counts as real
            if np.abs(np.imag(x)).max() <= 1e-7 * max(1.0, np.abs(x).max()):
                x, rest = _polish_pair(forms, np.real(x))
                real.append(self._dyad(complex(x[0], x[1]), complex(x[2], x[3])))
                rest = real[-1].residual
            else:
                others += 1
            worst = max(worst, rest)
        return BurmesterPairs(tuple(real), others, infinite, worst)

    def nearest_dyads(self) -> NearestDyads:
        """All dyads for which the least-squares error is stationary, of five poses or more.

        The error of a pose is the difference of the squared length from the mean square, so the pairs of five poses are
        among them, with an error of zero, and the other ones are minima and saddles between.

        Raises:
            InputError: fewer than five poses, or poses that do not turn, or about one point only.
        """
        if len(self.poses) < 5:
            raise InputError(
                f"guidance: nearest_dyads() needs 5 poses or more; through {len(self.poses)} infinitely many dyads go "
                f"exactly"
            )
        self._check_turns()
        # Bars through five of the poses are near those that come near all of them.
        five = np.linspace(0, len(self.poses) - 1, 5).astype(int)
        some = self if len(self.poses) == 5 else Guidance(self.poses[five])
        pairs = []
        with contextlib.suppress(InputError):  # too special
            pairs = [(complex(*pair.moving), complex(*pair.fixed)) for pair in some.pairs()]
        known = self._inwards(np.array(pairs, complex).reshape(-1, 2))
        bars, minima, proved, others, complete = find_stationary(self._turn, self._shift, known)
        dyads = tuple(self._dyad(complex(b), complex(a)) for b, a in bars)
        errors = np.array([np.hypot(*(dyad.places - dyad.fixed).T).std() for dyad in dyads])
        order = np.argsort(errors, kind="stable")
        best = tuple(dyads[k] for k in order)
        return NearestDyads(best, errors[order], minima[order], proved[order], others, complete)

    # -- four-bars -------------------------------------------------------------------------------------------------

    def four_bar(self, crank: Dyad, rocker: Dyad) -> GuidedFourBar:
        """A four-bar of two dyads, moved through the poses from either bar and checked.

        Args:
            crank: a dyad.
            rocker: another.

        Returns:
            The linkage, driven by whichever bar passes the poses in order, or passes near those of `nearest_dyads`; see
            `GuidedFourBar`.

        Raises:
            InputError: twice the same pivot, or bars that do not reach each other in the first pose.
        """
        for name in ("moving", "fixed"):
            if math.dist(getattr(crank, name), getattr(rocker, name)) < 1e-9 * self._size:
                raise InputError(
                    f"guidance: both dyads have the {name} pivot ({getattr(crank, name)[0]:.6g}, "
                    f"{getattr(crank, name)[1]:.6g}); a four-bar needs two different ones"
                )
        for dyad in (crank, rocker):
            if len(dyad.places) != len(self.poses):
                raise InputError(f"guidance: a dyad of {len(dyad.places)} poses, where there are {len(self.poses)}")
            places = dyad.places @ (1.0, 1.0j)
            if np.abs(self._places_of(places[0]) - places).max() > 1e-6 * (self._size + np.abs(places).max()):
                raise InputError("guidance: a dyad of other poses than these; take one of this guidance's own")
        exact = max(crank.residual, rocker.residual) <= EXACT
        return guide_four_bar(self.poses, crank, rocker, near=not exact)

    def four_bars(self) -> tuple[GuidedFourBar, ...]:
        """All four-bars of two dyads, those without defects first.

        Through five poses there are up to six, from up to four pairs, and none where fewer than two of the pairs are
        real: `pairs` tells. Of more poses any two of the `nearest_dyads` make one, those that pass nearest come first,
        and two that do not reach each other are left out.

        Raises:
            InputError: fewer than five poses.
        """
        if len(self.poses) == 5:
            exact = [self.four_bar(*two) for two in itertools.combinations(self.pairs().pairs, 2)]
            return tuple(sorted(exact, key=lambda f: (len(f.defects), -f.transmission)))
        near = []
        for two in itertools.combinations(self.nearest_dyads(), 2):
            with contextlib.suppress(InputError):  # they do not reach each other
                near.append(guide_four_bar(self.poses, *two, near=True))
        return tuple(sorted(near, key=lambda f: (len(f.defects), f.error)))

    # -- equations -------------------------------------------------------------------------------------------------

    def _check_count(self, count: int, what: str) -> None:
        if len(self.poses) != count:
            more = "; of more than 5 see nearest_dyads()" if len(self.poses) > 5 else ""
            raise InputError(f"guidance: {what} needs {count} poses, this has {len(self.poses)}{more}")

    def _forms(self) -> Float[np.ndarray, "n 3 3"]:
        """For each pose but the first a matrix T: (a, 1) T (b, 1) = 0 where b keeps its distance from a."""
        t, r = self._shift[1:], self._turn[1:]
        g, m = np.conj(t) * r, r - 1.0
        rows = [
            [-m.real, m.imag, -t.real],
            [-m.imag, -m.real, -t.imag],
            [g.real, -g.imag, 0.5 * np.abs(t) ** 2],
        ]
        return np.moveaxis(np.array(rows), 2, 0)

    def _dyad(self, b: complex, a: complex) -> Dyad:
        places = self._turn * b + self._shift
        lengths = np.abs(places - a)
        residual = float(np.ptp(lengths) / max(1.0, lengths.mean()))
        return Dyad(
            point_of(self._outwards(b)),
            point_of(self._outwards(a)),
            _as_columns(self._outwards(places)),
            float(lengths.mean() * self._size),
            residual,
        )

    def _places_of(self, b: complex) -> np.ndarray:
        """Places of a point of the body in all poses."""
        return self._outwards(self._turn * self._inwards(b) + self._shift)

    def _inwards(self, z):
        return (z - self._origin) / self._size

    def _outwards(self, z):
        return z * self._size + self._origin


def _as_columns(z: np.ndarray) -> np.ndarray:
    return np.stack([np.real(z), np.imag(z)], axis=-1)


def _circumcentre(z: np.ndarray) -> complex | None:
    p, q = z[1] - z[0], z[2] - z[0]
    area = (np.conj(p) * q).imag
    if abs(area) < 1e-12 * max(abs(p), abs(q)) ** 2:
        return None
    return complex(z[0] + 0.5j * (abs(q) ** 2 * p - abs(p) ** 2 * q) / area)


def _partners(forms: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The centres of circle points: null vectors of the three linear equations; NaN for NaN."""
    good = np.isfinite(b)
    point = np.stack([np.real(b), np.imag(b), np.ones(b.shape)], axis=-1)
    matrices = np.einsum("jkl,nl->njk", forms, np.where(good[:, None], point, 0.0))
    null = np.linalg.svd(matrices)[2][:, -1]
    with np.errstate(divide="ignore", invalid="ignore"):
        a = (null[:, 0] + 1j * null[:, 1]) / null[:, 2]
    return np.where(good, a, np.nan)


def _polish_pair(forms: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, float]:
    """Newton's steps on the bilinear equations themselves (complex too), and what remains of them."""
    one = np.ones(1, x.dtype)
    for _ in range(4):
        b, a = np.concatenate([x[:2], one]), np.concatenate([x[2:], one])
        rest = np.einsum("k,jkl,l->j", a, forms, b)
        matrix = np.concatenate([np.einsum("k,jkl->jl", a, forms)[:, :2], (forms @ b)[:, :2]], axis=1)
        step = np.linalg.lstsq(matrix, rest, rcond=1e-14)[0]
        if not np.isfinite(step).all() or np.abs(step).max() > 0.1 * max(1.0, np.abs(x).max()):
            break
        x = x - step
    b, a = np.concatenate([x[:2], one]), np.concatenate([x[2:], one])
    size = max(1.0, float(np.abs(b).max() * np.abs(a).max()))
    return x, float(np.abs(np.einsum("k,jkl,l->j", a, forms, b)).max() / size)
