"""Many designs of one mechanism along their own inputs, all at once in NumPy, and how their poses change with them.

The diagonal blocks of a plan are solved one after the other: what has a closed form for all poses of all designs at
once, the rest from pose to pose. Steps are as they are given; what leaves its branch on one of them is given up, and so
are the poses behind it. Coordinates are ``(N, steps, designs)``.
"""

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxnc.remembered import with_owner
from jaxnc.solvers import branch
from jaxnc.solvers.plan import Plan, square_rows
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.solvers.rows import FEW, Numbers, Rows, guards
from jaxnc.system.design import Drawn
from jaxnc.system.equations import pure_numbers
from jaxnc.system.precision import limits

_ITERATIONS = 12  # the most of Newton
_ASSEMBLY = 60  # and of Levenberg and Marquardt on a drawing that does not fit its dimensions

Scales = Sequence[np.ndarray]


def determinant(a: np.ndarray) -> np.ndarray:
    """Determinants of matrices ``(k, k, *lanes)``."""
    if len(a) == 1:
        return a[0, 0]
    if len(a) == 2:
        return a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    return np.linalg.det(np.moveaxis(a, (0, 1), (-2, -1)))


def _solved(a: np.ndarray, right: list[np.ndarray]) -> list[np.ndarray]:
    """Solutions of ``(k, k, *lanes)`` for right sides that may have an axis more, first; not finite where singular."""
    if len(a) == 1:
        return [right[0] / a[0, 0]]
    if len(a) == 2:
        inverse = 1.0 / determinant(a)
        p, q = right
        return [(a[1, 1] * p - a[0, 1] * q) * inverse, (a[0, 0] * q - a[1, 0] * p) * inverse]
    more = right[0].ndim > a.ndim - 2
    matrix, sides = np.moveaxis(a, (0, 1), (-2, -1)), np.stack(right, axis=-1)
    sides = np.moveaxis(sides, 0, -1) if more else sides[..., None]
    regular = np.isfinite(matrix).all(axis=(-2, -1)) & (np.linalg.slogdet(matrix)[0] != 0.0)
    safe = np.where(regular[..., None, None], matrix, np.eye(len(a)))
    found = np.where(regular[..., None, None], np.linalg.solve(safe, sides), np.nan)
    return [np.moveaxis(found[..., k, :], -1, 0) if more else found[..., k, 0] for k in range(len(a))]


class Lockstep:
    """A plan, ready for many designs. Make it with `lockstep`; all its kinds are readable (`structure.readable`)."""

    def __init__(self, plan: Plan):
        self.plan, top = plan, plan.topology
        self.blocks = [
            Rows(top, [int(plan.rows[r]) for r in rows], [int(c) for c in plan.unknown[columns]])
            for rows, columns in square_rows(plan).sequence
        ]
        self.everything = Rows(top, range(len(top.rows)), np.flatnonzero(~np.array(top.fixed, dtype=bool)).tolist())
        self.guards = [guards(top, bodies) for bodies in (False, True)]
        self.closed = all(block.form != "iterated" for block in self.blocks)

    def follow(
        self, drawn: Drawn, scales: Scales, length: float, start: np.ndarray, track: np.ndarray, sure: bool = False
    ) -> PoseBatch:
        """Poses along values of the known coordinates.

        Args:
            drawn: the designs, an axis of theirs behind each number's own; changes are not looked at.
            scales: factors that make rows lengths, of each block ``(instances, rows)``.
            length: size of the mechanism.
            start: the assembled designs, ``(N, designs)``.
            track: values of the known coordinates ``(known, steps, designs)``, those of the start first.
            sure: that designs stay on their branch, however much determinants change in a step.

        Returns:
            Coordinates ``(N, steps, designs)``, finite everywhere; whether a pose, and every pose before it, is good,
            ``(steps, designs)``; and the steps that are doubted, ``(steps - 1, designs)``, of designs that are not good
            for no other reason.
        """
        plan, least = self.plan, limits(np.zeros(0))
        numbers = Numbers([c[..., 0] for c in drawn.constants], scales)
        q = np.repeat(start[:, None], track.shape[1], axis=1)
        q[plan.known] = track
        good = np.ones(track.shape[1:], bool)
        weights = np.where(pure_numbers(plan.topology), length, 1.0)
        determinants, share = [], shares(track)
        with np.errstate(all="ignore"):
            for block in self.blocks:
                if block.form == "iterated":
                    good &= self._iterated(block, numbers, weights, length, q, share)
                else:
                    _closed(block, numbers, q)
                a = matrix(block, block.given(q, numbers), good.shape)
                size = np.prod(np.sqrt(np.sum((a / weights[list(block.columns), None, None]) ** 2, axis=1)), axis=0)
                value = determinant(a) / np.prod(weights[list(block.columns)])
                determinants.append(value)
                good &= np.abs(value) > least.poor * size
            going = np.ones(share.shape, bool)
            for value in determinants:
                good &= np.sign(value) == np.sign(value[0])
                going &= sure | steady(value, share)
            off = np.zeros(good.shape)
            for row in self.everything.values(numbers, q, np):
                np.maximum(off, np.abs(row), out=off)
            top = plan.topology
            spread = np.max(
                np.ptp(start[: len(top.points) * top.dim].reshape(-1, top.dim, start.shape[1]), axis=0), axis=0
            )
            grown = np.maximum(1.0, spread / length) ** 2  # rows are squared lengths: their rounding grows like these
            good &= off <= least.accept * length * grown + least.rounding * np.max(
                weights[:, None, None] * np.abs(q), axis=0
            )
            for guard in self.guards:
                for value in guard.values(numbers, q, np):
                    good &= value > 0.0
        doubted = ~going & np.logical_and.accumulate(good, axis=0)[1:]
        good[1:] &= going
        good = np.logical_and.accumulate(good, axis=0)
        q = np.where(good, q, start[:, None])
        return PoseBatch(q, good=good, doubted=doubted)

    def intersect(self, numbers: Any, q: np.ndarray) -> None:
        """Put poses ``(N, steps, designs)`` in their places, if `closed`; all are on the sides of the first of them."""
        for block in self.blocks:
            _closed(block, numbers, q)

    def _iterated(
        self, block: Rows, numbers: Any, weights: np.ndarray, length: float, q: np.ndarray, share: np.ndarray
    ) -> np.ndarray:
        """Newton from pose to pose, in all designs; whether each pose was found."""
        columns, least = list(block.columns), limits(np.zeros(0))
        weight, good = weights[columns, None], np.zeros(q.shape[1:], bool)
        good[0], live = True, np.arange(q.shape[2])
        # Only constants of designs have lanes; scales are numbers.
        first = len(block.coordinates)
        rest = [np.broadcast_to(v, live.shape) for v in block.given(q[:, 0], numbers)[first:]]
        for s in range(1, q.shape[1]):
            before = q[columns, s - 1][:, live]
            guess = before
            if s > 1:
                guess = before + share[s - 1, live] * (before - q[columns, s - 2][:, live])
            given = [*guess, *(q[c, s, live] for c in block.coordinates[len(columns) :]), *rest]
            far = np.full(len(live), np.inf)
            for _ in range(_ITERATIONS):
                step = _newton(block, given, live.shape)
                given[: len(columns)] = [x - d for x, d in zip(given, step, strict=False)]
                far = functools.reduce(np.maximum, (np.abs(d) * w for d, w in zip(step, weight, strict=True)))
                if not np.any(far > least.fine * length):  # what is not finite goes on no longer
                    break
            x = np.stack(given[: len(columns)])
            moved, off = (np.sqrt(np.sum((weight * (x - at)) ** 2, axis=0)) for at in (before, guess))
            found = (far <= least.fine * length) & (off <= branch.EXTRAPOLATED * moved + branch.STRAY * length)
            q[np.ix_(columns, [s], live)] = np.where(found, x, before)[:, None]
            good[s, live] = found
            if not found.all():
                live = live[found]
                rest = [c[found] for c in rest]
                if not len(live):
                    break
        for s in range(1, q.shape[1]):
            q[columns, s] = np.where(good[s], q[columns, s], q[columns, s - 1])
        return good

    def assembled(self, drawn: Drawn, scales: Scales, length: float) -> np.ndarray:
        """The pose of each design that is closest to its drawing, ``(N, designs)``; see `host.closest`."""
        q = drawn.home[..., 0].copy()
        part, least = self.everything, limits(np.zeros(0))
        numbers, columns = Numbers([c[..., 0] for c in drawn.constants], scales), list(part.columns)
        inner = np.where(pure_numbers(self.plan.topology), length, 1.0)[columns]
        n, floor = len(columns), 2.5 * least.floor * length
        damping, cost = np.full(q.shape[1], 1e-2), np.full(q.shape[1], np.inf)
        trial, slopes, r = q.copy(), np.zeros((q.shape[1], part.count, n)), np.zeros((q.shape[1], part.count))
        with np.errstate(all="ignore"):
            for turn in range(_ASSEMBLY):
                given = part.given(trial, numbers)
                rows = [np.broadcast_to(row, q.shape[1:]) for row in part.run(np)(given)]
                new = np.stack(rows or [np.zeros(q.shape[1])])
                size = np.sum(new * new, axis=0)
                better = size < cost
                q[:, better] = trial[:, better]
                if turn == 0 and np.all(np.abs(new) <= least.accept * length):
                    break
                at = np.moveaxis(matrix(part, given, q.shape[1:]), 2, 0) / inner
                slopes[better], r[better], cost = at[better], new.T[better], np.where(better, size, cost)
                damping = np.where(
                    better, np.maximum(0.1 * damping, least.damping), 10.0 * damping if turn else damping
                )
                live = (np.max(np.abs(r), axis=1) > floor) & (damping < 1e8)
                if not live.any():
                    break
                normal = np.swapaxes(slopes, 1, 2) @ slopes
                trace = np.trace(normal, axis1=1, axis2=2)
                normal[:, np.arange(n), np.arange(n)] += (damping * trace / n + least.tiny)[:, None]
                right = np.swapaxes(slopes, 1, 2) @ r[:, :, None]
                step = np.linalg.solve(normal, right)[:, :, 0] / inner
                trial = q.copy()
                trial[columns] -= np.where(live & np.isfinite(step).all(axis=1), step.T, 0.0)
        return q

    def changes(self, drawn: Drawn, q: np.ndarray, good: np.ndarray, known: np.ndarray) -> np.ndarray:
        """How poses change with designs and inputs, ``(N, changes, steps, designs)``, by the implicit rule; else zero.

        The poses ``(N, steps, designs)`` are there where they are good, ``(steps, designs)``; changes of the known
        coordinates are ``(known, changes, steps, designs)``.
        """
        plan = self.plan
        out = np.zeros((len(q), *known.shape[1:]))
        out[plan.fixed] = np.moveaxis(drawn.home[plan.fixed, :, 1:], -1, 1)[:, :, None]
        out[plan.known] = known
        scales = [np.ones((block.count, len(block.kind.rows))) for block in plan.topology.blocks]
        numbers = Numbers([c[..., 0] for c in drawn.constants], scales)
        moved = [np.ascontiguousarray(np.moveaxis(c[..., 1:], -1, 2))[:, :, :, None] for c in drawn.constants]
        with np.errstate(all="ignore"):
            for block in self.blocks:
                given = block.given(q, numbers)
                rows = block.run_changes([*given, *block.moving(out, moved)])
                rows = [np.broadcast_to(r, out.shape[1:]) for r in rows]
                a = matrix(block, given, q.shape[1:])
                for c, change in zip(block.columns, _solved(a, rows), strict=True):
                    np.negative(change, out=out[c])
        out[~(good & np.isfinite(out))] = 0.0
        return out


def matrix(rows: Rows, given: list[Any], lanes: tuple[int, ...]) -> np.ndarray:
    """Evaluate the derivatives of rows by their columns, ``(rows, columns, *lanes)``."""
    out = np.zeros((rows.count, len(rows.columns), *lanes))
    for place, value in zip(rows.places, rows.run_slopes(np)(given), strict=True):
        out[place] = value
    return out


def _newton(block: Rows, given: list[Any], lanes: tuple[int, ...]) -> list[np.ndarray]:
    """Find Newton's step of each column; not finite where the block is singular."""
    if len(block.columns) <= FEW:
        return list(block.run_step(given))
    rows = [np.broadcast_to(r, lanes) for r in block.run(np)(given)]
    return _solved(matrix(block, given, lanes), rows)


def shares(track: np.ndarray) -> np.ndarray:
    """How long each step is in terms of the one before, ``(steps - 1, designs)``; of the first one 0."""
    ways = np.diff(track, axis=1)
    ahead, square = np.sum(ways[:, 1:] * ways[:, :-1], axis=0), np.sum(ways[:, :-1] ** 2, axis=0)
    share = ahead / np.where(square > 0.0, square, 1.0)
    return np.concatenate([np.zeros_like(share[:1]) if len(share) else np.zeros((0, *track.shape[2:])), share])[
        : track.shape[1] - 1
    ]


def steady(value: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Say in which steps a determinant goes on as it did, ``(steps - 1, designs)``; see `branch.steady`."""
    rise = np.concatenate([np.zeros_like(value[:1]), np.diff(value, axis=0)])[: len(value) - 1]
    return branch.steady([value[1:]], [value[:-1]], [rise], share)


def _closed(block: Rows, numbers: Any, q: np.ndarray) -> None:
    """Solve a block with a closed form, in all poses, on the side that its first pose has."""
    columns, lanes = list(block.columns), q.shape[1:]
    given = block.given(q, numbers)
    if block.form == "affine":
        q[columns] -= np.stack([np.broadcast_to(d, lanes) for d in _newton(block, given, lanes)])
        return
    first = matrix(block, block.given(q[:, :1], numbers), (1, lanes[1]))
    found = block.run_solution(np)([*given, np.sign(determinant(first))])
    if block.form == "angle":  # its turns are counted along the way
        turns = np.diff(np.concatenate([q[columns[0], :1], np.broadcast_to(found[0], lanes)]), axis=0)
        q[columns[0]] += np.cumsum(turns - 2 * np.pi * np.round(turns / (2 * np.pi)), axis=0)
    else:
        for c, value in zip(columns, found, strict=True):
            q[c] = value


@with_owner
def lockstep(plan: Plan) -> Lockstep:
    """A plan, made ready once."""
    return Lockstep(plan)
