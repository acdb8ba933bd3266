"""Path generation at precision points: all four-bars whose coupler point passes through five to nine points.

Seen from the first point a dyad stands at a, and x leads from its moving pivot to the point. At another point, at δ,
the coupler has turned by 1 + γ, and the bar has its length if

    x (a' - δ') γ + x' (a - δ) γ' + δ (δ' - a' - x') - δ' (a + x) = 0,    γ γ' + γ + γ' = 0,

which are the equations of `jaxnc.synthesis.exact.bar_paths` for a coupler whose point stays, and pivots that move back.

Source: C. W. Wampler, A. P. Morgan and A. J. Sommese, Complete solution of the nine-point path synthesis problem for
four-bar linkages, J. Mech. Des. 114 (1992) 153-159.

For certificates, products such as q r' and q' r as unknowns of their own make the bars' equations quadratic in them, q
and γ; the real and imaginary parts of a number and of its primed one are what stands for the two. See
`jaxnc.synthesis.exact.bar_paths` for the letters.
"""

import collections
import dataclasses
import functools
import importlib.resources
import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from jaxnc.calls import public
from jaxnc.continuation.certificate import Twofold, are_disjoint, certify
from jaxnc.continuation.monodromy import SAME
from jaxnc.continuation.tracker import FAR, USUAL, Pace, PathEnds
from jaxnc.errors import InputError, counted
from jaxnc.synthesis.exact.bar_paths import Attempt, BarPaths, Places, follow_all, follow_routes
from jaxnc.synthesis.exact.burmester import Dyad
from jaxnc.synthesis.exact.linkage import GuidedFourBar, Listed, guide_four_bar, point_of
from jaxnc.synthesis.validate import as_floats
from jaxnc.types import Any, ArrayLike

if TYPE_CHECKING:
    from jaxnc.synthesis.exact.six_bars import SixBarDesign


def certify_designs(here: BarPaths, w: np.ndarray, others: Sequence[np.ndarray]) -> tuple[np.ndarray, bool]:
    """Find which real solutions are proved to exist and to be alone, and whether those are all proved different.

    Args:
        here: the equations of bars and turns, those at the end.
        w: solutions and their turns.
        others: the other equations, as quadratic forms of 1, q, q', r and r', ``(9, 9)``.

    The proof is of equations with these very numbers, where places are sums of several but for one rounding of each
    coefficient: conditions of 1e9 leave none for others beside them.
    """
    (known,), pairs = here.places(np.ones(1), 0), here.pairs
    count = known.c[0].shape[1]
    z, turns = w[:8].reshape(4, 2, -1), w[8:].reshape(2, count, -1)
    made = [np.stack([z[side][bar] * z[3 - side][k] for bar, k in pairs]) for side in (0, 1)]  # q r' and q' r
    one, primed = (np.concatenate([z[side], z[2 + side], made[side], turns[side]]) for side in (0, 1))
    unknowns = np.real(np.concatenate([(one + primed) / 2, (one - primed) / 2j]))
    half, first = len(one), 1 + 4 + len(pairs)  # where γ begins
    units = np.eye(1 + 2 * half, dtype=complex)
    q, r, n = units[1:3], units[3:5], units[5:first]

    def other(v: np.ndarray) -> np.ndarray:
        return np.concatenate([v[..., :1], v[..., 1 + half :], v[..., 1 : 1 + half]], axis=-1)

    def times(v: np.ndarray, u: np.ndarray) -> np.ndarray:
        return (np.outer(v, u) + np.outer(u, v)) / 2

    rows, low = [], []
    for at, (bar, k) in enumerate(pairs):
        product = times(units[0], n[at]) - times(q[bar], other(r[k]))
        mirrored = times(units[0], other(n[at])) - times(other(q[bar]), r[k])
        rows += [product + mirrored, (product - mirrored) / 1j]
    for j in range(count):
        g = units[first + j]
        for bar in (0, 1):
            b, bb = (side[bar, 0, 0] for side in known.b)
            c, cc = (side[bar, j, 0] for side in known.c)
            p, pp, move, back = (value * units[0] for value in (b, bb, c, cc))
            there, barred = (b + c) * other(q[bar]), (bb + cc) * q[bar]  # q' (p + Δ) and q (p' + Δ')
            for at, k in ((at, k) for at, (of, k) in enumerate(pairs) if of == bar):
                s, ss = (0.0, 0.0) if known.s is None else (side[k, j, 0] for side in known.s)
                p, pp = p + r[k], pp + other(r[k])
                move, back = move + s * r[k], back + ss * other(r[k])
                there, barred = there + (1.0 + s) * other(n[at]), barred + (1.0 + ss) * n[at]
            bars = times(barred, g) + times(there, other(g))
            rows.append(bars + times(q[bar] + p, back) + times(other(q[bar]) + pp + back, move))
            # What rounding took from the constant, of which the other terms may leave little.
            low.append((Twofold(b) * cc + (Twofold(bb) + cc) * c - rows[-1][0, 0]).rounded())
        rows.append(times(g, other(g)) + times(units[0], g + other(g)))
        low.append(0.0)
    numbers = np.concatenate([units[:1], q, other(q), r, other(r)])
    rows += [numbers.T @ form @ numbers for form in others]
    forms = _as_real(np.array(rows))
    lost = np.real(np.concatenate([np.zeros(2 * len(pairs)), low, np.zeros(len(others))]))
    balls = certify(forms, unknowns, _residuals(forms, lost, unknowns))
    return balls.real, are_disjoint(unknowns, balls)


def _residuals(equations: np.ndarray, low: np.ndarray, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values of the equations with twice the digits, and a bound of their error, ``(solutions, n)`` both."""
    y = np.concatenate([np.ones((1, unknowns.shape[1])), unknowns])
    upper = np.triu(equations) + np.triu(equations, 1)
    most = int((upper != 0.0).sum(axis=(1, 2)).max())
    first, second, factor = np.zeros((3, most, len(equations)))
    for r, form in enumerate(upper):
        i, j = np.nonzero(form)
        first[: len(i), r], second[: len(i), r], factor[: len(i), r] = i, j, form[i, j]
    total, large = Twofold(np.broadcast_to(low[:, None], (len(low), y.shape[1]))), 0.0
    for i, j, c in zip(first.astype(int), second.astype(int), factor[:, :, None], strict=True):
        total = total + Twofold(y[i]) * y[j] * c
        large = large + np.abs(y[i] * y[j] * c)
    value = np.real(total.rounded())
    # Rounding of one product and sum with twice the digits is below 2^-100.
    return value.T, (2.0**-98 * (most + 4) * large + 2.0**-52 * np.abs(value)).T


def _as_real(forms: np.ndarray) -> np.ndarray:
    """Quadratic forms of numbers and then their primed ones as forms of their real and imaginary parts."""
    half = (forms.shape[1] - 1) // 2
    turn = np.zeros((1 + 2 * half, 1 + 2 * half), complex)
    turn[0, 0] = 1.0
    k = np.arange(half)
    turn[1 + k, 1 + k] = turn[1 + half + k, 1 + k] = 1.0
    turn[1 + k, 1 + half + k], turn[1 + half + k, 1 + half + k] = 1j, -1j
    return np.real(turn.T @ forms @ turn)


D = TypeVar("D", bound="GuidedFourBar | SixBarDesign")


@dataclasses.dataclass(frozen=True)
class FollowedDesigns(Listed[D]):
    """All real solutions of a task whose complex ones were followed there; see its kinds."""

    designs: tuple[D, ...]
    expected: int
    found: int
    routes: int
    missing: int
    proved: tuple[bool, ...]
    disjoint: bool

    @property
    def complete(self) -> bool:
        """True if every path ended in a solution of its own: as many as a general task has."""
        return self.found == self.expected

    @property
    def statement(self) -> str:
        """What is proved and what was observed, in sentences."""
        if self.complete:
            ends = "none is missing"
        elif not self.missing:
            ends = "the other paths ended at infinity, in singular solutions or where a bar has no length"
        else:
            ends = f"at most {self.missing} more are regular and were missed, in {counted(self.routes, 'route')}"
        told = f"all {len(self.proved)}" if all(self.proved) else f"{sum(self.proved)} of {len(self.proved)}"
        return (
            f"Observed: {self.found} of {self.expected} solutions, real and complex; {ends}. "
            f"Proved: {told} real ones exist and are alone{', no two of them one' * self.disjoint}."
        )

    def describe(self, counts: str) -> str:
        """Say how many designs have which defects, what is proved, and which designs work."""
        works = [design for design in self if not design.defects]
        kinds = collections.Counter(", ".join(design.defects) for design in self if design.defects)
        defects = "".join(f", {count} with {kind} defect" for kind, count in sorted(kinds.items()))
        lines = [f"{counts}: {len(works)} without defects{defects}", self.statement, *map(str, works)]
        return "\n  ".join(lines)


# -- equations and paths of solutions ----------------------------------------------------------------------------------

_NONE = np.zeros((2, 1, 1)), np.zeros((2, 1, 1))  # of the pivots is known


@dataclasses.dataclass(frozen=True)
class Task:
    """Precision points and what is known of the base, with conjugates as numbers of their own."""

    d: np.ndarray  # δ, (points - 1,)
    e: np.ndarray  # δ'
    matrix: np.ndarray  # conditions on the fixed pivots (a, b, a', b'), (9 - points, 4)
    right: np.ndarray  # their right-hand sides

    def parts(self) -> tuple[np.ndarray, ...]:
        """The four arrays, with an axis for lanes."""
        return tuple(part[..., None] for part in (self.d, self.e, self.matrix, self.right))


class _PointPaths(BarPaths):
    """Paths from one task to another in a straight line: on the coupler the point stays, and the pivots move by -δ."""

    pairs = ((0, 0), (1, 1))

    def __init__(self, start: Task, end: Task, wide: bool):
        super().__init__(len(start.d), wide)
        self.start, self.end = start.parts(), end.parts()
        self.rates = tuple(b - a for a, b in zip(self.start, self.end, strict=True))

    def _part(self, k: int, at: np.ndarray) -> np.ndarray:
        return self.start[k] * (1.0 - at) + self.end[k] * at

    def places(self, at: np.ndarray, order: int) -> list[Places]:
        """Power series of places."""
        d, e, (dd, de, *_) = self._part(0, at), self._part(1, at), self.rates
        terms = ((d, e), (dd, de))[: order + 1]
        return [Places(_NONE, (np.stack([-one, -one]), np.stack([-two, -two]))) for one, two in terms]

    def base(self, z: list[np.ndarray], at: np.ndarray) -> np.ndarray:
        """What the conditions on the fixed pivots leave, or its series."""
        matrix = self._part(2, at)
        if len(z) == 1:
            right = self._part(3, at)
            of: Any = Twofold if self.wide else np.asarray
            left: Any = sum((of(matrix[:, k]) * z[0][4 + k] for k in range(4)), start=-of(right))
            return left.rounded() if isinstance(left, Twofold) else left
        _, _, dm, dr = self.rates
        moved = (matrix * z[-1][4:]).sum(axis=1) + (dm * z[-2][4:]).sum(axis=1)
        return moved - dr if len(z) == 2 else moved

    def base_slopes(self, z: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Derivatives of the conditions on the fixed pivots."""
        matrix = self._part(2, at)
        return np.concatenate([np.zeros((len(matrix), 4, matrix.shape[2])), matrix], axis=1)


def polish(z: np.ndarray, task: Task, steps: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Solutions of a task with their turns after Newton's steps, and the last step's size beside them, ``(lanes,)``."""
    return _PointPaths(task, task, wide=True).polish(z, steps)


def follow_paths(z: np.ndarray, start: Task, end: Task, pace: Pace = USUAL, wide: bool = False) -> PathEnds:
    """Follow solutions of one task to those of another, with their turns, in a straight line between the two.

    Where wide, residuals have twice the digits: ends whose condition number is 1e9 and more are reached too.
    """
    return _PointPaths(start, end, wide).follow(z, pace)


# -- linkages through points -------------------------------------------------------------------------------------------

_OTHER = [1, 0, 3, 2, 5, 4, 7, 6]  # the solution with its dyads exchanged

_LEVEL = {"6-21": 170, "7-11": 988}  # solutions of bases with A and D on one level, or one above the other

Coordinates = tuple[float | None, float | None]


@public
@dataclasses.dataclass(frozen=True)
class PathDesigns(FollowedDesigns[GuidedFourBar]):
    """All four-bars through precision points of a path, those without defects first; ``print()`` lists them.

    Attributes:
        designs: the real ones; the crank angles at the points are their `inputs`. A linkage that meets a point at two
            angles of its coupler is listed with each.
        curves: for each design the number of its coupler curve, from 0: cognates have the same.
        expected: how many solutions points in general position have for such a base, complex ones included; of nine
            points cognates count once.
        found: how many finite, regular ones of them were found.
        routes: how often all were followed, each time another way.
        missing: how many paths ended neither in a regular solution of their own, nor at infinity, nor in a singular one
            or a linkage in which a bar has no length: at most so many regular solutions are missing.
        residual: the largest difference of a bar's length between the points, as a part of the points' size.
        proved: for each design whether its solution is proved to exist, to be real and to be alone near it, with
            rounding counted.
        disjoint: whether no two of the proved ones are one solution, cognates apart.
    """

    curves: tuple[int, ...]
    residual: float

    def __repr__(self) -> str:
        curves = counted(len(set(self.curves)), "coupler curve")
        return self.describe(f"{counted(len(self), 'four-bar')} with {curves}")


@public
def path_four_bars(points: ArrayLike, A: Coordinates | None = None, D: Coordinates | None = None) -> PathDesigns:
    """All four-bars whose coupler point passes through five to nine precision points.

    Nine points determine a four-bar; each coordinate of the fixed pivots that is given takes the place of a point. All
    complex solutions are followed from a stored task to this one (parameter homotopy), and the real ones among them
    are moved through the points. Nine points in general position have 1442 solutions with three cognates each, five
    with both fixed pivots given 36. Where A and D are given on one level, or one above the other, six have 170 in place
    of 258 and seven 988 in place of 1661: in the rest A is D and B is C. What is lost on the way is followed again,
    with residuals of twice the digits, from cognates, about the end and at last, all of it, on other ways.

    Args:
        points: the points in the order in which they are to be passed, ``(5 … 9, 2)``, lengths.
        A: a fixed pivot, ``(x, y)``; None for a coordinate to be found, or for both.
        D: the other one. Points and given coordinates are nine together.

    Returns:
        The designs: drawn at the first point, driven by whichever bar passes the points in order. Defects are named as
        by `GuidedFourBar`. Of nine points each solution gives its two cognates too.

    Raises:
        InputError: points that are not numbers, repeat or are too few or too many for what is given of the base; fixed
            pivots that coincide.

    Source: C. W. Wampler, A. P. Morgan and A. J. Sommese, J. Mech. Des. 114 (1992) 153-159 (nine points: 1442);
    A. P. Morgan and C. W. Wampler, J. Mech. Des. 112 (1990) 544-550 (five: 36). The numbers for six, seven and eight
    points are our own count, by monodromy and trace tests; those on one level without the latter.
    """
    places, given = _check_task(points, A, D)
    size = float(np.abs(places - places.mean()).max()) / 1.5
    exchanged = len(given[1]) > len(given[0])
    order = _reference_first(places, given)
    task = _make_task(places[order], given[::-1] if exchanged else given, size)
    name = f"{len(places)}-{max(map(len, given))}{min(map(len, given))}"
    expected, keys = _expected_count(name, given), functools.partial(solution_keys, task=task)
    ends, routes, missing = follow_routes(lambda k: _route(name, task, expected, 1.0 + 2.4 * k), 3, expected, keys)
    here = _PointPaths(task, task, wide=True)
    real = here.find_real(ends)
    if given[0] == given[1]:  # each linkage is met again with its bars exchanged
        real = real[:, ~np.triu(_match_solutions(real, real[[*_OTHER, *range(8, len(real))]])).any(axis=0)]
    exact, disjoint = certify_designs(here, real, list(_base_forms(task)))
    turned = np.vstack([np.ones(real.shape[1]), 1.0 + real[8 : 7 + len(places)]])
    z = size * (real[_OTHER] if exchanged else real[:8])
    designs, curves, residual = _linkages(places, order, z, turned, size)
    proved = tuple(bool(exact[curve]) for curve in curves)
    known = keys(real)[:4] if len(places) == 9 else _measure_linkages(real)
    curves = tuple(np.unique(_match_solutions(known, known).argmax(axis=1), return_inverse=True)[1][[*curves]].tolist())
    return PathDesigns(designs, expected, ends.shape[1], routes, missing, proved, disjoint, curves, residual)


def _base_forms(task: Task) -> np.ndarray:
    """Conditions on the fixed pivots as quadratic forms of 1 and z."""
    forms = np.zeros((len(task.right), 9, 9), complex)
    forms[:, 0, 0] = -task.right
    forms[:, 0, 5:] = forms[:, 5:, 0] = task.matrix / 2
    return forms


def _expected_count(name: str, base: list[dict[str, float]]) -> int:
    """How many solutions points in general position have for a base."""
    same = [axis for axis in base[0] if base[0][axis] == base[1].get(axis)]
    # On one level A may be D, and both dyads one: there the other paths end, and no loop of such bases leads there.
    return _LEVEL[name] if name in _LEVEL and same else stored_starts(name)[0].shape[1]


@functools.cache
def stored_starts(name: str) -> tuple[np.ndarray, Task]:
    """All solutions of a stored task with their turns, and the task: "7-20" has seven points and A.

    They were found from one random linkage by monodromy, see ``benchmarks/synthesis/starts.py``.
    """
    with importlib.resources.files("jaxnc.synthesis.exact").joinpath("path_starts.npz").open("rb") as file:
        stored = np.load(file)
        task = Task(*(stored[f"{part} {name}"] for part in ("d", "e", "matrix", "right")))
        z = stored[f"z {name}"].astype(complex)
    return polish(z, task)[0], task


# -- statement ---------------------------------------------------------------------------------------------------------


def _check_task(points: ArrayLike, A: Any, D: Any) -> tuple[np.ndarray, list[dict[str, float]]]:
    given = as_floats(points, "path_four_bars: points must be numbers (x, y)")
    if given.ndim != 2 or given.shape[1] != 2:
        raise InputError(f"path_four_bars: points must have shape (n, 2), got {given.shape}")
    if not np.isfinite(given).all():
        raise InputError(f"path_four_bars: points[{int(np.argmin(np.isfinite(given).all(axis=1)))}] is not finite")
    base = []
    for name, value in (("A", A), ("D", D)):
        try:
            x, y = (None, None) if value is None else (None if v is None else float(v) for v in value)
        except (TypeError, ValueError, OverflowError):
            raise InputError(f"path_four_bars: {name} must be two numbers (x, y), None for one to be found, got "
                             f"{value!r}") from None  # fmt: skip
        base.append({axis: v for axis, v in (("x", x), ("y", y)) if v is not None})
        if not np.isfinite(list(base[-1].values())).all():
            raise InputError(f"path_four_bars: {name} must be finite, got {value!r}")
    known = sum(map(len, base))
    if len(given) + known != 9:
        raise InputError(
            f"path_four_bars: {len(given)} points and {known} coordinates of A and D; together they must be nine: nine "
            f"points alone, seven with A=(x, y), five with A and D. For fewer, or for more that are to be met nearly, "
            f"see jaxnc.synthesis.PathGeneration"
        )
    places = given[:, 0] + 1j * given[:, 1]
    scale = float(np.abs(places - places.mean()).max())
    for i, j in itertools.combinations(range(len(places)), 2):
        if abs(places[i] - places[j]) < 1e-9 * scale or scale == 0.0:
            raise InputError(f"path_four_bars: points[{i}] and points[{j}] are the same; leave one out")
    if len(base[0]) == 2 and base[0] == base[1]:
        raise InputError(f"path_four_bars: A and D are both {A}; a four-bar has two fixed pivots")
    return places, base


def _reference_first(places: np.ndarray, base: list[dict[str, float]]) -> np.ndarray:
    """Order the points: one that lies on a given fixed pivot comes first, as what linkages are seen from.

    From another one, at a = δ, the coupler's turn there would drop out of the dyad's equation.
    """
    pivots = [complex(pair["x"], pair["y"]) for pair in base if len(pair) == 2]
    apart = np.array([np.abs(places - pivot) for pivot in pivots]).reshape(-1, len(places))
    on = np.flatnonzero((apart < 1e-9 * np.abs(places - places.mean()).max()).any(axis=0))
    if len(on) > 1:
        raise InputError(
            f"path_four_bars: points[{on[0]}] and points[{on[1]}] lie on the fixed pivots; move one of them, or a pivot"
        )
    return np.array([*on, *(k for k in range(len(places)) if k not in on)])


def _make_task(places: np.ndarray, base: list[dict[str, float]], size: float) -> Task:
    """The task of real points, seen from the first and in parts of their size."""
    rows, right = [], []
    for side, pair in enumerate(base):
        for axis, value in pair.items():
            row = np.zeros(4, complex)
            row[side::2] = (1.0, 1.0) if axis == "x" else (-1j, 1j)  # a + a' = 2 x, -i (a - a') = 2 y
            rows.append(row)
            right.append(2.0 * (value - (places[0].real if axis == "x" else places[0].imag)) / size)
    d = (places[1:] - places[0]) / size
    return Task(d, np.conj(d), np.array(rows, complex).reshape(-1, 4), np.array(right, complex))


# -- solutions ---------------------------------------------------------------------------------------------------------


_ATTEMPTS = (
    Attempt(Pace(1e-4, 0.01, 1e-6), wide=False),
    Attempt(Pace(2e-5, 0.01, 1e-6)),
    Attempt(Pace(1e-5, 0.01, 1e-6), cognate=1),
    Attempt(Pace(1e-5, 0.01, 1e-6), cognate=2, bend=0.0005 + 0.001j),
    Attempt(Pace(1e-5, 0.01, 1e-6), cognate=1, bend=0.0005 - 0.001j),
    Attempt(Pace(1e-5, 0.01, 1e-6), bend=1e-5j),
    Attempt(Pace(1e-5, 0.01, 1e-6), bend=1e-8j),
    Attempt(Pace(1e-5, 0.01, 1e-6), bend=-1e-8j),
)


def _route(name: str, task: Task, expected: int, angle: float) -> tuple[np.ndarray, int]:
    """Follow all paths from the stored task to this one, turned by an angle: another way for each.

    See `follow_all` for what it returns; a class of nine points is lost if all three of its cognates are.
    """
    count = int(name[0])
    z, start = stored_starts(name)
    turn = np.exp(1j * angle)
    spun = Task(task.d * turn, task.e / turn, task.matrix * [1 / turn, 1 / turn, turn, turn], task.right)

    def follow(attempt: Attempt, lanes: np.ndarray) -> PathEnds:
        return _follow_block(_cognate(z, attempt.cognate if count == 9 else 0), start, spun, attempt, lanes)

    def are_none(z: np.ndarray) -> np.ndarray:
        return _degenerate(z) | (np.abs(z).max(axis=0) >= 10 * FAR)

    here, keys = _PointPaths(spun, spun, wide=True), functools.partial(solution_keys, task=spun)
    ends, lost = follow_all(z, _ATTEMPTS, follow, here, are_none, expected, keys)
    ends[:8] *= np.array([1 / turn, 1 / turn, turn, turn] * 2)[:, None]
    return ends, lost


def _follow_block(z: np.ndarray, start: Task, end: Task, attempt: Attempt, lanes: np.ndarray) -> PathEnds:
    z = z[:, lanes]
    if not attempt.bend:
        return follow_paths(z, start, end, attempt.pace, attempt.wide)
    by = attempt.bend
    parts = zip(start.parts(), end.parts(), strict=True)
    bend = Task(*((by * a + (1.0 - by) * b)[..., 0] for a, b in parts))  # an end may be that of another path
    there = follow_paths(z, start, bend, attempt.pace, attempt.wide)
    out = follow_paths(there.w, bend, end, attempt.pace, attempt.wide)
    return dataclasses.replace(out, arrived=there.arrived & out.arrived, at=np.where(there.arrived, out.at, 0.0))


def _cognate(z: np.ndarray, which: int) -> np.ndarray:
    """The solutions themselves, or one of their two cognates, which pass through the same nine points."""
    if not which:
        return z
    x, y, a, b = z[[0, 2]], z[[1, 3]], z[[4, 6]], z[[5, 7]]
    k = x / (x - y)
    focus = a + k * (b - a)
    if which == 1:
        x, y, b = -(a + x), -(a + x) * (1.0 - k), focus
    else:
        x, y, a = -(b + y) * k, -(b + y), focus
    return np.concatenate([np.stack([p, q], axis=1).reshape(4, -1) for p, q in ((x, y), (a, b))])


def _degenerate(z: np.ndarray) -> np.ndarray:
    """Where a bar has no length, the point lies on a joint of the coupler, or both dyads are one."""
    x, y, xx, yy, a, b, aa, bb = z
    pairs = np.abs([(x, xx), (y, yy), (x - y, xx - yy), (x + a, xx + aa), (y + b, yy + bb), (a - b, aa - bb)])
    # 1e-8 of the size is no length. Or both dyads are one, of complex solutions on one side of the conjugates alone.
    return (pairs.max(axis=1).min(axis=0) < 1e-8) | (pairs[[2, 5]].max(axis=0).min(axis=0) < 1e-8)


def solution_keys(w: np.ndarray, task: Task) -> np.ndarray:
    """Numbers that tell solutions of a task, with their turns, apart; for nine points those that cognates share."""
    if len(task.d) < 8:
        return w
    x, y, xx, yy, a, b, aa, bb = w[:8]
    c, cc = (x * b - y * a) / (x - y), (xx * bb - yy * aa) / (xx - yy)
    # A curve that meets itself at a point gives two solutions. The links of a cognate turn as those of the linkage do.
    turn = 1.0 + w[8:16]
    turns = turn + sum((p + q * turn - task.d[:, None]) / (p + q) for p, q in ((a, x), (b, y)))
    curve = a + b + c, aa + bb + cc, a * b + b * c + c * a, aa * bb + bb * cc + cc * aa
    return np.concatenate([np.stack(curve), turns])


def _measure_linkages(w: np.ndarray) -> np.ndarray:
    """Measure what of linkages is the same in each pose with the point of the coupler at the reference."""
    x, y, _, _, a, b, _, _ = w[:8]
    apart = x * np.conj(y) / np.maximum(np.abs(x), np.abs(y))
    return np.stack([a, b, np.abs(x), np.abs(y), apart, np.abs(x + a), np.abs(y + b)])


def _match_solutions(z: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Which of some solutions are which of others, ``(lanes, lanes)``."""
    return np.abs(z[:, :, None] - other[:, None, :]).max(axis=0) < SAME * np.abs(z).max(axis=0)[:, None]


# -- linkages ----------------------------------------------------------------------------------------------------------


def _linkages(
    places: np.ndarray, order: np.ndarray, z: np.ndarray, theta: np.ndarray, size: float
) -> tuple[tuple[GuidedFourBar, ...], tuple[int, ...], float]:
    """Real solutions as linkages that were moved through the points, with their cognates if the base is free.

    Solutions are seen from the first point of the order, and the coupler's turns are in it.
    """
    x, y, _, _, a, b, _, _ = z
    p, theta = places[:, None], theta[np.argsort(order)]
    A, D, B, C = places[order[0]] + a, places[order[0]] + b, p - theta * x, p - theta * y
    linkages = [(A, B, D, C)]
    if len(places) == 9:
        k = x / (x - y)  # the coupler's shape, (P - B) / (C - B)
        E = A + k * (D - A)
        linkages.append((A, A + p - B, E, A + p - B + k * (B - A)))
        linkages.append((E, D + p - C + (1 - k) * (C - D), D, D + p - C))
    designs: list[tuple[GuidedFourBar, int]] = []
    worst = 0.0
    for curve in range(z.shape[1]):
        for fixed, moving, other, joint in linkages:
            crank = _dyad(fixed[curve], moving[:, curve], size)
            rocker = _dyad(other[curve], joint[:, curve], size)
            worst = max(worst, crank.residual, rocker.residual)
            turn = np.angle(joint[:, curve] - moving[:, curve])
            poses = np.column_stack([np.real(places), np.imag(places), turn])
            designs.append((guide_four_bar(poses, crank, rocker), curve))
    designs.sort(key=lambda found: (len(found[0].defects), -found[0].transmission))
    return tuple(design for design, _ in designs), tuple(curve for _, curve in designs), worst


def _dyad(fixed: complex, places: np.ndarray, size: float) -> Dyad:
    lengths = np.abs(places - fixed)
    columns = np.column_stack([np.real(places), np.imag(places)])
    return Dyad(point_of(places[0]), point_of(fixed), columns, float(lengths[0]), float(np.ptp(lengths)) / size)
