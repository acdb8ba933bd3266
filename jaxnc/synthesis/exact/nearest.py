"""Bars that guide a body nearest to any number of poses: all stationary points of a least-squares design.

What a bar misses in a pose is the difference of the squared distance of its two pivots from the mean square. With the
circle point z, the centre a and their conjugates that is linear in z, z̄, a, ā, āz and az̄, so the mean square of it is
a quadratic form of these seven numbers, 1 included, whatever the number of poses. Where it does not change with z and
a are the solutions of four equations; with u = āz and w = az̄ they and two more are of second degree in six unknowns, of
total degree 64. 25 of the paths end in solutions, the others at infinity, for all poses that were tried but special
ones.

Source: the equations are derived here. Stationary points instead of one local minimum: A. Baskar, M. Plecnik and
J. Hauenstein, Computing saddle graphs via homotopy continuation for the approximate synthesis of mechanisms, Mech.
Mach. Theory 176 (2022) 104932.
"""

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from jaxnc.calls import public
from jaxnc.continuation.certificate import certify
from jaxnc.continuation.monodromy import solve_by_degree
from jaxnc.errors import counted

if TYPE_CHECKING:
    from jaxnc.synthesis.exact.burmester import Dyad

_SEED = 25  # of the start system, so that the same poses have the same answer


@public
@dataclasses.dataclass(frozen=True)
class NearestDyads(Sequence["Dyad"]):
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

    def __len__(self) -> int:
        return len(self.dyads)

    def __getitem__(self, index):
        return self.dyads[index]

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

    def __str__(self) -> str:
        lines = [f"{counted(len(self.dyads), 'stationary bar')}, {int(self.minima.sum())} of them minima"]
        for dyad, error, least in zip(self.dyads, self.errors, self.minima, strict=True):
            lines.append(f"  {'minimum' if least else 'saddle '}  error {error:.3g}  {dyad}")
        return "\n".join([*lines, f"  {self.statement}"])

    __repr__ = __str__


@dataclasses.dataclass(frozen=True)
class StationaryPoints:
    """Stationary bars of poses ``turn z + shift``."""

    z: np.ndarray  # circle points of the real ones, by their errors
    a: np.ndarray  # their centres
    minima: np.ndarray
    proved: np.ndarray
    complex_points: int
    complete: bool


def find_stationary(turn: np.ndarray, shift: np.ndarray) -> StationaryPoints:
    """Find all bars whose least-squares error is stationary.

    Args:
        turn: of the body in each pose, a complex number of unit size.
        shift: its place, in units and about an origin that suit the poses.
    """
    # Columns by 1, z, z̄, a, ā, u = āz, w = az̄.
    conj = np.conj
    columns = np.stack(
        [abs(shift) ** 2, turn * conj(shift), conj(turn) * shift, -conj(shift), -shift, -turn, -conj(turn)], axis=1
    )
    columns = columns - columns.mean(axis=0)  # the squared length that fits best
    form = columns.T @ columns / len(turn)
    t = np.zeros((6, 7, 7), complex)
    for row, (own, product, factor) in enumerate(((1, 5, 4), (2, 6, 3), (3, 6, 2), (4, 5, 1))):
        t[row, 0] += form[own]
        t[row, factor] += form[product]
    t[4, 0, 5], t[4, 4, 1] = 1.0, -1.0
    t[5, 0, 6], t[5, 3, 2] = 1.0, -1.0
    t = 0.5 * (t + np.swapaxes(t, 1, 2))
    w, complete = solve_by_degree(t, np.random.default_rng(_SEED))
    # In real and imaginary parts the equations are real, and so are the solutions that are bars.
    parts = np.array([[1, 1j], [1, -1j]])
    basis = np.zeros((7, 7), complex)
    basis[0, 0] = 1.0
    for k in range(3):
        basis[1 + 2 * k : 3 + 2 * k, 1 + 2 * k : 3 + 2 * k] = parts
    real_t = np.einsum("rij,ip,jq->rpq", t, basis, basis)
    pairs = [(real_t[k] + real_t[k + 1], (real_t[k] - real_t[k + 1]) / 1j) for k in (0, 2, 4)]
    real_t = np.array([part.real for pair in pairs for part in pair])
    x = np.linalg.solve(basis[1:, 1:], w)
    balls = certify(real_t, x)
    size = np.maximum(1.0, np.abs(x).max(axis=0, initial=0.0))
    is_real = balls.real | ~balls.proved & (np.abs(x.imag).max(axis=0, initial=0.0) < 1e-8 * size)
    x, proved = x[:, is_real].real, balls.proved[is_real]
    v = np.concatenate([np.ones((1, x.shape[1])), x])
    real_form = (basis.T @ form @ basis).real
    cost = np.einsum("in,ij,jn->n", v, real_form, v)
    order = np.argsort(cost, kind="stable")
    minima = np.array([_is_minimum(real_form, v[:, k]) for k in order], bool)
    return StationaryPoints(
        x[0, order] + 1j * x[1, order],
        x[2, order] + 1j * x[3, order],
        minima,
        proved[order],
        int(np.sum(~is_real)),
        complete,
    )


def _is_minimum(form: np.ndarray, v: np.ndarray) -> bool:
    """Tell whether the second derivatives by z and a, two real numbers each, are positive."""
    zx, zy, ax, ay = v[1:5]
    # u = āz = (ax zx + ay zy) + i (ax zy - ay zx)
    slopes = np.zeros((7, 4))
    slopes[1:5] = np.eye(4)
    slopes[5], slopes[6] = (ax, ay, zx, zy), (-ay, ax, zy, -zx)
    bend = np.zeros((2, 4, 4))
    bend[0, 0, 2] = bend[0, 1, 3] = bend[1, 1, 2] = 1.0
    bend[1, 0, 3] = -1.0
    own = form @ v
    hessian = slopes.T @ form @ slopes + np.einsum("k,kij->ij", own[5:], bend + np.swapaxes(bend, 1, 2))
    values = np.linalg.eigvalsh(hessian)
    return bool(values[0] > 1e-12 * values[-1])
