"""Bars that guide a body nearest to any number of poses: all stationary points of a least-squares design.

What a bar misses in a pose is the difference of its squared length from the mean square. With the bar w in one pose,
the place z of its end on the body and their conjugates that is linear in w, w̄, z, z̄, w̄z, wz̄ and zz̄, so the mean
square of it is a quadratic form of these and 1, whatever the number of poses. Where it does not change with w and z are
the solutions of four equations; with the three products they are seven of second degree in seven unknowns, of total
degree 128. 25 of the paths end in solutions, the others at infinity, for all poses that were tried but special ones.

Source: the equations are derived here. Stationary points instead of one local minimum: A. Baskar, M. Plecnik and
J. Hauenstein, Computing saddle graphs via homotopy continuation for the approximate synthesis of mechanisms, Mech.
Mach. Theory 176 (2022) 104932.
"""

import dataclasses
import itertools
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jaxnc.calls import public
from jaxnc.continuation.certificate import certify
from jaxnc.continuation.monodromy import is_new, solve_by_degree
from jaxnc.errors import InputError, counted
from jaxnc.synthesis.exact.linkage import Listed

if TYPE_CHECKING:
    from jaxnc.synthesis.exact.burmester import Dyad

_TRIES = 3  # ways from a start system to the poses, each about two origins


@public
@dataclasses.dataclass(frozen=True)
class NearestDyads(Listed["Dyad"]):
    """All bars for which the least-squares error is stationary, the best first; ``print()`` lists them.

    Attributes:
        dyads: the bars.
        errors: of each the root mean square of what its length would have to change by in the poses, lengths, ``(k,)``.
        minima: of each whether every small change makes it worse; the others are saddles, ``(k,)``.
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
        found = _solve_about(change, place, unit, seed, np.stack([z + middle - bars[:, 1], z]))
        w, z = found.real
        bars, proved = np.stack([(z + origin) / first, z - w + middle], axis=1), found.proved
        complex_points, agreed = found.others, agreed + 1 if found.complete else 0
        if agreed == 2:  # one way alone may not show a pivot that is far away
            break
    minima = np.array(
        [_is_minimum(_expand(b + shift[0] - a, b, turn - 1.0, shift - shift[0])[1]) for b, a in bars], bool
    )
    return bars, minima, proved, complex_points, agreed > 0


class _Ends(NamedTuple):
    """Where paths have ended."""

    real: np.ndarray  # w and z of the real ones, and of those that were known
    proved: np.ndarray
    others: int  # how many are complex
    complete: bool  # whether the paths found all of these, and every other path went to infinity


def _solve_about(change: np.ndarray, place: np.ndarray, unit: float, seed: int, known: np.ndarray) -> _Ends:
    """Solve for bars ``w + change z + place``, of poses whose places are about zero and some units large."""
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
    return _Ends(np.stack([w, z / wide]) * unit, proved, others, complete)


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


def _is_minimum(hessian: np.ndarray) -> bool:
    """Tell whether second derivatives are positive, in numbers of one size."""
    scale = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(hessian)), np.finfo(float).tiny))
    return bool(np.linalg.eigvalsh(hessian * scale[:, None] * scale)[0] > 1e-13)
