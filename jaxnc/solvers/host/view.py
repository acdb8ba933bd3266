"""A plan's rows and unknowns in NumPy, on lanes: residuals, Jacobians, steps, orientation.

Inverses are what takes a sweep's time, and from pose to pose they hardly change: those of every few lanes are made,
the others interpolated (cubics through four of them). They are never believed: whoever uses them refines what they
give, and lanes for which they do not do have their own.
"""

import contextlib
import functools
import itertools
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jaxnc.solvers.plan import Plan
from jaxnc.solvers.rows import PlanProgram, plan_program, slope_program
from jaxnc.system.host import HostEquations
from jaxnc.system.precision import limits

_LANES = (4, 24)  # the fewest for which that pays, and the most
_HALF = 10.0  # times the root of the last digit: off by no more, one refinement makes it good
_FOUR = np.arange(4)


@dataclass(frozen=True, eq=False)
class Near:
    """Lanes that stand for those around them."""

    at: np.ndarray  # these lanes, in order
    nearest: np.ndarray  # for every lane, which of them is the nearest by number, (lanes,)
    # `matrix`, `inverse`: of these lanes, (len(at), m, n) and (len(at), n, m)
    matrix: np.ndarray
    inverse: np.ndarray
    first: np.ndarray  # of each so many lanes, the first of the four that these are interpolated between, and
    weights: np.ndarray  # the weights of the four, (len(first), lanes, 4)

    @functools.cached_property
    def interpolated(self) -> np.ndarray:
        """Inverses of all lanes, nearly, ``(lanes, n, m)``."""
        four = self.inverse[self.first[:, None] + _FOUR].reshape(len(self.first), 4, -1)
        return (self.weights @ four).reshape(-1, *self.inverse.shape[1:])[: len(self.nearest)]

    def proper(self, matrix: np.ndarray) -> np.ndarray:
        """Say which lanes' matrices differ from their neighbour's by less than could make that one singular."""
        apart = self.matrix[self.nearest]
        apart -= matrix
        reach = np.sum(self.inverse**2, axis=(1, 2))[self.nearest]
        return np.einsum("lmn,lmn->l", apart, apart) * reach < 1.0


def near(q: np.ndarray, length: float, matrices: Callable[[np.ndarray], np.ndarray]) -> Near | None:
    """Choose lanes that stand for others; None where they are too few for that.

    The poses are in the order of a motion, coordinates as lengths, ``(N, lanes)``; `matrices` gives those of some of
    the lanes, ``(…, m, n)``.
    """
    lanes, step = q.shape[1], np.diff(q, axis=1)
    way = np.concatenate([[0.0], np.cumsum(np.sqrt(np.einsum("nl,nl->l", step, step)))])
    # 0.15 sizes of the mechanism: so far go all coordinates together from one known lane to the next
    apart = min(0.15 * length * lanes / way[-1], _LANES[1], lanes // 4) if way[-1] > 0.0 else 0
    if not apart >= _LANES[0]:
        return None
    apart = int(apart)
    at, groups = np.append(np.arange(0, lanes - 1, apart), lanes - 1), -(-lanes // apart)
    first = np.clip(np.arange(groups) - 1, 0, len(at) - 4)
    x = way[at][first[:, None] + _FOUR]
    t = way[np.minimum(np.arange(groups * apart), lanes - 1)].reshape(groups, apart)
    away, between = t[:, :, None] - x[:, None], x[:, :, None] - x[:, None]
    weights = np.ones_like(away)
    for k, other in itertools.permutations(range(4), 2):
        weights[..., k] *= away[..., other] / between[:, k, other, None]
    nearest = np.minimum((np.arange(lanes) + apart // 2) // apart, len(at) - 1)
    matrix = matrices(at)
    return Near(at, nearest, matrix, inverse_of(matrix), first, weights)


def make_solver(matrix: np.ndarray, close: Near | None) -> Callable[[np.ndarray], np.ndarray]:
    """Make the function that solves with the matrices of poses ``(lanes, m, n)``, refined.

    It gives solutions ``(lanes, n, c)`` for right-hand sides ``(lanes, m, c)``. `close` is what is known of the lanes
    between others, if anything.
    """
    inverse, times = inverse_of(matrix) if close is None else close.interpolated, 1
    if close is not None:
        off, eps = _error_of(matrix, inverse), np.finfo(matrix.dtype).eps
        poor = ~(off <= 1e-3)  # off by more, an interpolated inverse is not refined
        if poor.any():
            inverse = np.array(inverse)
            inverse[poor], off[poor] = inverse_of(matrix[poor]), _HALF * eps**0.5
        # Every refinement leaves one factor of what is off.
        times = max(math.ceil(math.log(eps) / math.log(max(np.max(off), eps))) - 1, 1)

    def solve(right: np.ndarray) -> np.ndarray:
        x = inverse @ right
        for _ in range(times):
            x += inverse @ (right - matrix @ x)
        return x

    return solve


def _error_of(matrix: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Measure how far inverses are off, relative, ``(lanes,)``."""
    probe = np.cos(np.arange(matrix.shape[2], dtype=matrix.dtype))[:, None]  # in no direction that means anything
    return np.max(np.abs(inverse @ (matrix @ probe) - probe), axis=(1, 2), initial=0.0)


def least_squares(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve for ``(lanes, n, c)``, in the least-squares sense if there are more rows; not finite if singular."""
    if matrix.shape[1] > matrix.shape[2]:
        basis, triangle = np.linalg.qr(matrix)
        return solve_exactly(triangle, np.swapaxes(basis, 1, 2) @ right)
    return solve_exactly(matrix, right)


def inverse_of(matrix: np.ndarray) -> np.ndarray:
    """Return inverses ``(lanes, n, m)`` whose products are to be refined once; not finite if singular.

    Of more rows than unknowns it is that of the normal equations, in a third of the time of orthogonal columns, which
    are taken where one refinement would not make it good.
    """
    m, n = matrix.shape[1:]
    unit = np.eye(n, dtype=matrix.dtype)
    if m == n:
        return solve_exactly(matrix, np.broadcast_to(unit, matrix.shape))
    back = np.swapaxes(matrix, 1, 2)
    normal = back @ matrix
    out = solve_exactly(normal, np.broadcast_to(unit, normal.shape)) @ back
    poor = ~(_error_of(matrix, out) <= _HALF * np.finfo(matrix.dtype).eps ** 0.5)
    if poor.any():
        basis, triangle = np.linalg.qr(matrix[poor])
        out[poor] = solve_exactly(triangle, np.swapaxes(basis, 1, 2))
    return out


def solve_exactly(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve for right-hand sides ``(..., n, c)``; not finite if singular."""
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:  # one of them is singular to the last bit
        out = np.full((*matrix.shape[:-1], right.shape[-1]), np.nan, matrix.dtype)
        regular = np.linalg.slogdet(matrix)[0] != 0.0
        out[regular] = np.linalg.solve(matrix[regular], right[regular])
        return out


def pseudoinverse(slope: np.ndarray) -> np.ndarray:
    """Invert derivatives of rows, ``(..., m, n)``, every coordinate a length: rows may be redundant."""
    return np.linalg.pinv(slope, rcond=1e-7)  # of the largest singular value: rows below are redundant


def closest_changes(
    slope: np.ndarray, back: np.ndarray, stiffness: np.ndarray, pull: np.ndarray, rows: np.ndarray
) -> np.ndarray:
    """Find the changes d of the unknowns with ``slope d + rows = 0`` where ``½ d·stiffness d - pull·d`` is stationary.

    Args:
        slope: derivatives of the rows, every coordinate a length, ``(lanes, m, n)``.
        back: their `pseudoinverse`, ``(lanes, n, m)``.
        stiffness: a matrix, ``(lanes, n, n)``, positive on what the rows leave free.
        pull: ``(lanes, n, c)``.
        rows: ``(lanes, m, c)``.
    """
    fixed, down = back @ slope, -back @ rows
    free = np.eye(slope.shape[2]) - fixed  # the projector on motions
    stiffness = 0.5 * (stiffness + np.swapaxes(stiffness, 1, 2))
    return down + solve_exactly(free @ stiffness @ free + fixed, free @ (pull - stiffness @ down))


# -- rows and unknowns of a plan ---------------------------------------------------------------------------------------


class PoseEvaluation(NamedTuple):
    """Poses evaluated; lanes are the last axis."""

    residual: np.ndarray  # rows that are solved for, (m, lanes)
    # how far Newton, or Gauss and Newton, would move the unknowns back, (n, lanes); not finite if singular
    step: np.ndarray
    slopes: np.ndarray  # derivatives of the unknowns by the driven coordinates, (n, driven, lanes)
    # `signs`, `sizes`: signs of the diagonal blocks' determinants, which a branch keeps, and logarithms of their sizes,
    # (blocks, lanes); none where there are more rows than unknowns, but
    signs: np.ndarray
    sizes: np.ndarray
    matrix: np.ndarray | None = None  # derivatives of the rows by the unknowns, lanes last; see `HostView.relative`


class HostView:
    """A view of what is solved for, with the numbers of one design, or of a design for each lane.

    Poses are ``(N, lanes)``, rows ``(m, lanes)``; matrices have their lanes first, as NumPy's linear algebra wants it.

    Args:
        plan: the plan; of a large one see `jaxnc.solvers.host.sparse`.
        eq: the equations.

    Attributes:
        shape: of the derivatives of one pose.
        redundant: whether there are more rows than unknowns.
        refines: whether what `solver` returns is refined already.
        at_once: lanes that are solved together.
        inner: factors that turn the unknowns into lengths, ``(n,)``, or ``(lanes, 1, n)``, as columns of matrices;
        weights, unknown_weights: of all coordinates and of the unknowns, ``(N or n, 1 or lanes)``.
    """

    def __init__(self, plan: Plan, eq: HostEquations):
        self.plan, self.eq, self.program = plan, eq, plan_program(plan)
        self.least, self.shape, self.at_once = limits(eq.home), (len(plan.rows), len(plan.unknown)), sys.maxsize
        weights = eq.weights
        self.weights = weights if weights.ndim == 2 else weights[:, None]
        self.unknown_weights = self.weights[plan.unknown]
        self.inner = self.unknown_weights[:, 0] if weights.ndim == 1 else self.unknown_weights.T[:, None, :]
        self._outer = self.inner[..., None] if weights.ndim == 1 else np.swapaxes(self.inner, 1, 2)
        self.redundant, self.refines = len(plan.rows) > len(plan.unknown), self.program is None
        # Poses surveyed last, their matrices, and what is near: `solver` is often asked for the same.
        self._surveyed: tuple[np.ndarray, np.ndarray, Near] | None = None

    def select(self, which: np.ndarray) -> "HostView":
        """Return the view of other lanes, given by places or a mask; one design that all lanes share stays."""
        return self if self.eq.designs is None else type(self)(self.plan, self.eq.select(which))

    def residual(self, q: np.ndarray) -> np.ndarray:
        """Evaluate the rows that are solved for, ``(m, lanes)``."""
        if self.program is not None:
            return self.program.run(("residual",), self.eq, q)[0]
        return self.eq.residual(q)[self.plan.rows]

    def norm(self, weight: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Measure changes of coordinates ``(c, lanes)`` by their weights, ``(lanes,)``."""
        y = change * weight
        return np.sqrt(np.einsum("nl,nl->l", y, y))

    def extent(self, q: np.ndarray) -> np.ndarray:
        """Return how large coordinates may be, ``(lanes,)``, beside the mechanism's size."""
        return np.zeros(q.shape[1])

    def tolerance(self, q: np.ndarray) -> np.ndarray:
        """Return the largest residual of a pose that counts as a solution, ``(lanes,)``."""
        # Assemblies, of fewer rows than unknowns, are taken as far as 64 bits go.
        least = limits(self.eq.home, self.eq.rounded and self.shape[0] >= self.shape[1])
        return least.accept * self.eq.length + least.rounding * largest_of_lanes(self.weights * q)

    def upright(self, q: np.ndarray) -> np.ndarray:
        """Say whether nothing is met by a mirror image, ``(lanes,)``."""
        program = self.program or self._single(q)
        if program is None:
            return self.eq.guards(q)[0]
        if not program.parts["guards"]:
            return np.ones(q.shape[1], bool)
        return np.logical_and.reduce(program.run(("guards",), self.eq, q)[0] > 0.0)

    def _single(self, q: np.ndarray) -> PlanProgram | None:
        """Return the rows and their slopes as a program, for a single pose: by far the faster."""
        return slope_program(self.plan) if q.shape[1] == 1 and self.eq.designs is None else None

    def check(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the largest residual, and whether nothing is met by a mirror image, and a body is, ``(lanes,)``."""
        if self.program is not None and self.program.whole:
            r, guards = self.program.run(("residual", "guards"), self.eq, q)
            return largest_of_lanes(r), np.logical_and.reduce(guards > 0.0), np.zeros(q.shape[1], bool)
        return largest_of_lanes(self.eq.residual(q)), *self.eq.guards(q)

    def polish(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the rows, the step of Newton, and the conditioning."""
        if self.program is not None:
            r, step, entries = self.program.run(("residual", "step", "entries"), self.eq, q)
            return r, step, self._ratio(self._lengths(entries))
        r, matrix = self.residual(q), self.matrices(q)[0]
        if not matrix.shape[2]:
            return r, np.zeros((0, q.shape[1]), q.dtype), self.conditioning(q)
        scaled, right = matrix / self.inner, r.T[:, :, None]
        normal, conditioning, sound = self._normal(scaled)
        if not self.redundant:
            step = solve_exactly(scaled, right)
        else:
            step = solve_exactly(normal, np.swapaxes(scaled, 1, 2) @ right)
            step[~sound] = least_squares(scaled[~sound], right[~sound])
        return r, (step / self._outer)[:, :, 0].T, conditioning

    def evaluate(self, q: np.ndarray) -> PoseEvaluation:
        """Evaluate poses ``(N, lanes)``."""
        driven, n = len(self.plan.driven), len(self.plan.unknown)
        if self.program is not None:
            found = self.program.run(("residual", "step", "slopes", "determinants"), self.eq, q)
            r, step, slopes, determinants = found
            sizes = np.log(np.maximum(np.abs(determinants), self.least.tiny))
            return PoseEvaluation(r, step, slopes.reshape(n, driven, q.shape[1]), np.sign(determinants), sizes)
        program = self._single(q)
        if program is None:
            r, (matrix, by_known) = self.residual(q), self.matrices(q)
            by_known = by_known[:, :, :driven]
        else:
            r, entries, by_driven = program.run(("residual", "entries", "by_driven"), self.eq, q)
            matrix, by_known = np.zeros((1, len(r), n), q.dtype), np.zeros((1, len(r), driven), q.dtype)
            matrix[0, *program.places], by_known[0, *program.driven] = entries[:, 0], by_driven[:, 0]
        right = np.concatenate([r.T[:, :, None], by_known], axis=2)
        x, signs, sizes = self.factorise(matrix, right)
        kept = np.moveaxis(matrix, 0, -1) if self.redundant else None
        return PoseEvaluation(r, x[:, :, 0].T, -x[:, :, 1:].transpose(1, 2, 0), signs.T, sizes.T, kept)

    def solver(self, q: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Make the function that maps rows ``(m, lanes)`` to changes of the unknowns ``(n, lanes)`` that make them."""
        if self.program is not None:
            inner, eq = self.program, self.eq
            return lambda right: inner.run(("solved",), eq, q, right)[0]
        if self._surveyed is not None and np.array_equal(q, self._surveyed[0]):
            _, matrix, close = self._surveyed
        else:
            matrix = self._scaled(q)
            close = self._near(q, lambda at: matrix[at])
        solve = make_solver(matrix, close)
        return lambda right: (solve(right.T[:, :, None]) / self._outer)[:, :, 0].T

    def near(self, q: np.ndarray) -> Near | None:
        """Find what some poses in the order of a motion say of the others; None where each by itself is quicker."""
        return self._near(q, lambda at: self._scaled(q[:, at]))

    def _near(self, q: np.ndarray, matrices: Callable[[np.ndarray], np.ndarray]) -> Near | None:
        return near(self.weights * q, self.eq.length, matrices) if self.wants_order else None

    @property
    def wants_order(self) -> bool:
        """True if it helps that lanes come in the order of a motion: where matrices have to be inverted."""
        return self.program is None and self.eq.designs is None and len(self.plan.unknown) > 0

    def orientation(self, q: np.ndarray) -> np.ndarray:
        """Return signs of the diagonal blocks' determinants, ``(blocks, lanes)``."""
        if self.program is not None:
            return np.sign(self.program.run(("determinants",), self.eq, q)[0])
        return self._orientation(self.matrices(q)[0])[0].T

    def conditioning(self, q: np.ndarray) -> np.ndarray:
        """Estimate the reciprocal condition number, coordinates as lengths; zero at a singular position."""
        if not len(self.plan.unknown):
            return np.ones(q.shape[1], q.dtype)
        if self.program is not None:
            return self._ratio(self._lengths(self.program.run(("entries",), self.eq, q)[0]))
        return self._normal(self._scaled(q))[1]

    def _normal(self, scaled: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return matrices of the normal equations ``(lanes, n, n)``, the conditioning, and whether these are sound.

        Their triangular factor is that of orthogonal columns, which take five times as long, to half the digits: where
        these would not do, or numbers have 32 bits, columns are made orthogonal.
        """
        normal = np.swapaxes(scaled, 1, 2) @ scaled
        found = np.zeros(len(scaled), scaled.dtype)
        if scaled.dtype == np.float64:
            with contextlib.suppress(np.linalg.LinAlgError):  # one of them is singular
                found = self._ratio(np.diagonal(np.linalg.cholesky(normal), axis1=1, axis2=2))
        sound = found >= 1e-3  # 1e-3 of the largest pivot: above, normal equations lose no digit that anybody is told
        if not sound.all():
            triangle = np.linalg.qr(scaled[~sound], mode="r")
            found[~sound] = self._ratio(np.abs(np.diagonal(triangle, axis1=1, axis2=2)))
        return normal, found, sound

    def _lengths(self, entries: np.ndarray) -> np.ndarray:
        """Measure the columns ``(lanes, n)``, each made orthogonal to those before it (modified Gram-Schmidt).

        The entries are those of the matrix, as `PlanProgram.places` has them, ``(entries, lanes)``.
        """
        n, lanes = len(self.plan.unknown), entries.shape[1]
        rows, columns = self.program.places if self.program else np.zeros((2, 0), int)
        entries = entries / self.unknown_weights[columns]
        if lanes == 1:
            found = _lengths_of_one(n, rows.tolist(), columns.tolist(), entries[:, 0].tolist())
            return np.array([found], entries.dtype)
        out = np.empty((lanes, n), entries.dtype)
        width = 512  # as many matrices as stay in the cache
        for first in range(0, lanes, width):
            part = entries[:, first : first + width]
            a = np.zeros((n, n, part.shape[1]), entries.dtype)
            a[columns, rows] = part
            for j in range(n):
                square = np.sum(a[j] * a[j], axis=0)
                out[first : first + width, j] = np.sqrt(square)
                along = np.sum(a[j + 1 :] * a[j], axis=1) / np.where(square > 0.0, square, 1.0)
                a[j + 1 :] -= along[:, None] * a[j]
        return out

    def _ratio(self, pivots: np.ndarray) -> np.ndarray:
        found = pivots.min(axis=1) / np.maximum(pivots.max(axis=1), self.least.tiny)
        return np.where(np.isfinite(found), found, 0.0)

    def matrices(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Differentiate the rows by unknown ``(lanes, m, n)`` and by known coordinates ``(lanes, m, k)``."""
        p, n, lanes = self.plan.pattern, len(self.plan.unknown), q.shape[1]
        both = np.zeros((*p.shape, lanes), q.dtype)
        both[p.rows, p.columns] = p.collect(self.eq.entries(q))
        both = both.transpose(2, 0, 1)
        return np.ascontiguousarray(both[:, :, :n]), both[:, :, n:]

    def _scaled(self, q: np.ndarray) -> np.ndarray:
        """Differentiate the rows by the unknowns as lengths, ``(lanes, m, n)``."""
        matrix = self.matrices(q)[0]
        matrix /= self.inner
        return matrix

    def solve(self, matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Solve for Newton or Gauss-Newton steps ``(lanes, n, c)``, coordinates as lengths; not finite if singular."""
        if not matrix.shape[2]:
            return np.zeros((len(matrix), 0, right.shape[2]), matrix.dtype)
        return least_squares(matrix / self.inner, right) / self._outer

    def factorise(self, matrix: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return what `solve` does, and signs and logarithms of the blocks' determinants, ``(lanes, blocks)``."""
        return self.solve(matrix, right), *self._orientation(matrix)

    def lengths(self, matrix: np.ndarray) -> np.ndarray:
        """Return Jacobians with respect to coordinates as lengths."""
        return matrix / self.inner

    def damped_step(self, slope: np.ndarray, rows: np.ndarray, damping: np.ndarray) -> np.ndarray:
        """Return steps of Levenberg and Marquardt, coordinates as lengths, ``(lanes, n)``.

        The slope is as `lengths` gives it; damping is relative to the mean square of the columns, ``(lanes,)``.
        """
        n = slope.shape[2]
        back = np.swapaxes(slope, 1, 2)
        normal = back @ slope
        trace = np.trace(normal, axis1=1, axis2=2) / n
        normal[:, range(n), range(n)] += (damping * trace + self.least.tiny)[:, None]
        return least_squares(normal, back @ rows.T[:, :, None])[:, :, 0]

    def approach(self, q: np.ndarray, begin: np.ndarray) -> np.ndarray:
        """Return steps of Newton to the poses that meet the rows closest to where they begin, ``(n, lanes)``.

        Second derivatives of the rows are differences: a step is off by what these are, where it ends is not.
        """
        unknown, (m, n), lanes = self.plan.unknown, self.shape, q.shape[1]
        slope = self.lengths(self.matrices(q)[0])
        apart = (self.unknown_weights * (begin - q)[unknown]).T
        back = pseudoinverse(slope)
        forces = np.einsum("lnm,ln->lm", back, apart)  # of the rows, which hold the pose away from there
        width = 1e-4 * np.broadcast_to(self.eq.length, lanes)
        near = np.repeat(q[:, :, None], n, axis=2)
        near[unknown, :, range(n)] += width / self.unknown_weights
        around = self.select(np.repeat(np.arange(lanes), n))
        slopes = around.lengths(around.matrices(near.reshape(len(q), -1))[0]).reshape(lanes, n, m, n)
        bend = np.einsum("lamn,lm->lan", slopes - slope[:, None], forces) / width[:, None, None]
        given = apart[:, :, None], self.residual(q).T[:, :, None]
        stiff = np.eye(n) + bend, np.eye(n)[None]
        step, down = (closest_changes(slope, back, x, *given)[:, :, 0] for x in stiff)
        nearer = np.einsum("ln,ln->l", step, down) > 0.0  # else second derivatives lead away: straight down then
        return np.where(nearer, step.T, down.T) / self.unknown_weights

    def _orientation(self, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return signs and logarithms of the diagonal blocks' determinants, ``(lanes, blocks)``."""
        signs, sizes = [np.zeros((len(matrix), 0))], [np.zeros((len(matrix), 0))]
        for rows, columns in self.plan.blocks if self.plan.square else ():
            sign, size = np.linalg.slogdet(matrix[:, rows[:, :, None], columns[:, None, :]])
            signs.append(sign)
            sizes.append(np.maximum(size, np.log(self.least.tiny)))
        return np.concatenate(signs, axis=1), np.concatenate(sizes, axis=1)

    def orientation_sign(self, matrix: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Return signs of det(otherᵀ · matrix), ``(lanes,)``: positive on the same branch."""
        return np.linalg.slogdet(np.swapaxes(other, 1, 2) @ matrix)[0]

    def relative(self, matrix: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Return det(otherᵀ · matrix) as a part of det(otherᵀ · other), ``(lanes,)``: positive on the same branch."""
        back = np.swapaxes(other, 1, 2)
        sign, size = np.linalg.slogdet(back @ matrix)
        return sign * np.exp(size - np.linalg.slogdet(back @ other)[1])

    def same_branch(self, q: np.ndarray, ends: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Say whether poses ``(N, lanes)`` and both that they lie between have one orientation.

        Then no singular position lies between. The others are ``(N, ends)``, and for each lane the place of the one and
        of the other; with as many designs as there are lanes, lanes of one design have ends of their own.
        """
        which = np.empty(ends.shape[1], int)
        which[left] = which[right] = np.arange(len(left))
        around = self.select(which)
        if not self.redundant:
            signs, at = self.orientation(q), around.orientation(ends)
            return ((signs == at[:, left]) & (signs == at[:, right])).all(axis=0)
        return self._same_branch(self.matrices(q)[0], around.matrices(ends)[0], left, right)

    def _same_branch(self, matrix: np.ndarray, ends: np.ndarray, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Say `same_branch` by matrices."""
        pairs, which = np.unique(left * len(ends) + right, return_inverse=True)
        before, behind = np.divmod(pairs, len(ends))
        return self._same_orientation(ends[behind], ends[before])[which] & self._same_orientation(matrix, ends[left])

    def _same_orientation(self, matrix: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Say whether matrices have one orientation, ``(lanes,)``."""
        if self.redundant:
            return self.orientation_sign(matrix, other) > 0
        return (self._orientation(matrix)[0] == self._orientation(other)[0]).all(axis=1)

    def survey(
        self, q: np.ndarray, ends: np.ndarray, left: np.ndarray, right: np.ndarray, close: Near
    ) -> tuple[np.ndarray, np.ndarray]:
        """Say `same_branch` of poses in the order of a motion, by what is `near`, and find their conditioning.

        A pose may be an end itself: then both are itself, and nothing is asked of it. What is found on the way
        does for `solver` too.
        """
        matrix, at, which = self._scaled(q), close.at, close.nearest
        self._surveyed = q, matrix, close
        around = self._scaled(ends)
        kept = self._same_branch(close.matrix, around, left[at], right[at])[which] & close.proper(matrix)
        kept &= (left <= right[at][which]) & (left[at][which] <= right)
        rest = np.flatnonzero(~kept)
        if len(rest):
            kept[rest] = self._same_branch(matrix[rest], around, left[rest], right[rest])
        return kept | (left == right), self._normal(matrix)[1]

    def join(self, unknown: np.ndarray, known: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Put other unknown ``(n, lanes)`` and known ``(k, lanes)`` coordinates into poses."""
        out = q.copy() if q.shape[1] == known.shape[1] else np.repeat(q, known.shape[1], axis=1)
        out[self.plan.unknown], out[self.plan.known] = unknown, known
        return out


def _lengths_of_one(n: int, rows: list[int], columns: list[int], entries: list[float]) -> list[float]:
    """Measure the columns of one matrix in plain numbers: to the last bit, which NumPy would sum in another order."""
    a, out = [[0.0] * n for _ in range(n)], []
    for r, c, entry in zip(rows, columns, entries, strict=True):
        a[c][r] = entry
    for j, column in enumerate(a):
        some = [(r, x) for r, x in enumerate(column) if x]
        square = 0.0
        for _, x in some:
            square += x * x
        out.append(math.sqrt(square) if square < math.inf else math.inf)
        for other in a[j + 1 :] if square > 0.0 else ():
            along = 0.0
            for r, x in some:
                along += other[r] * x
            if along:
                along /= square
                for r, x in some:
                    other[r] -= along * x
    return out


def largest_of_lanes(x: np.ndarray) -> np.ndarray:
    """Return the largest size in each lane, ``(lanes,)``."""
    return np.maximum.reduce(np.abs(x), axis=0, initial=0.0)
