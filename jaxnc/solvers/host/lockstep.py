"""Designs of one mechanism along given values of their inputs, all at once in NumPy, and how their poses change.

The diagonal blocks of a plan are solved one after the other: what has a closed form for all poses of all designs at
once, the rest from pose to pose. Steps are as they are given; what leaves its branch on one of them is given up, and so
are the poses behind it. Coordinates are ``(N, steps, designs)``.
"""

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jaxnc.records import with_owner
from jaxnc.solvers import branch
from jaxnc.solvers.host.view import HostView, largest_of_lanes, solve_exactly
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.solvers.rows import FEW, RowNumbers, Rows, guard_functions
from jaxnc.system.design import Drawn
from jaxnc.system.equations import pure_numbers
from jaxnc.system.precision import limits
from jaxnc.types import ArrayLike

if TYPE_CHECKING:
    from jaxnc.system.host import HostEquations


Scales = Sequence[np.ndarray]


def lane_determinant(a: np.ndarray) -> np.ndarray:
    """Return determinants of matrices ``(k, k, *lanes)``."""
    if len(a) == 1:
        return a[0, 0]
    if len(a) == 2:
        return a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    return np.linalg.det(np.moveaxis(a, (0, 1), (-2, -1)))


def _solve_small(a: np.ndarray, right: list[np.ndarray]) -> list[np.ndarray]:
    """Solve ``(k, k, *lanes)`` for right sides that may have an axis more, first; not finite where singular."""
    if len(a) == 1:
        return [right[0] / a[0, 0]]
    if len(a) == 2:
        inverse = 1.0 / lane_determinant(a)
        p, q = right
        return [(a[1, 1] * p - a[0, 1] * q) * inverse, (a[0, 0] * q - a[1, 0] * p) * inverse]
    more = right[0].ndim > a.ndim - 2
    matrix, sides = np.moveaxis(a, (0, 1), (-2, -1)), np.stack(right, axis=-1)
    sides = np.moveaxis(sides, 0, -1) if more else sides[..., None]
    finite = np.isfinite(matrix).all(axis=(-2, -1), keepdims=True)  # LAPACK finds numbers for others too
    found = np.where(finite, solve_exactly(matrix, sides), np.nan)
    return [np.moveaxis(found[..., k, :], -1, 0) if more else found[..., k, 0] for k in range(len(a))]


class Lockstep:
    """A plan, ready for many designs. Make it with `lockstep`; all its kinds are readable (`structure.readable`)."""

    def __init__(self, plan: Plan):
        self.plan, top = plan, plan.topology
        self.blocks = [
            Rows(top, [int(plan.rows[r]) for r in rows], [int(c) for c in plan.unknown[columns]])
            for rows, columns in plan.choice
        ]
        self.everything = Rows(top, range(len(top.rows)), np.flatnonzero(~np.array(top.fixed, dtype=bool)).tolist())
        self.guards = guard_functions(top)
        self.closed = all(block.form != "iterated" for block in self.blocks)

    def follow(
        self, drawn: Drawn, scales: Scales, length: float, start: np.ndarray, track: np.ndarray, sure: bool = False
    ) -> PoseBatch:
        """Solve for poses along values of the known coordinates.

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
        numbers = RowNumbers([c[..., 0] for c in drawn.constants], scales)
        q = np.repeat(start[:, None], track.shape[1], axis=1)
        q[plan.known] = track
        good = np.ones(track.shape[1:], bool)
        weights = np.where(pure_numbers(plan.topology), length, 1.0)
        determinants, shares = [], _measure_shares(track)
        with np.errstate(all="ignore"):
            for block in self.blocks:
                if block.form == "iterated":
                    good &= self._iterate(block, numbers, weights, length, q, shares.share)
                else:
                    _solve_closed(block, numbers, q)
                a = matrix(block, block.collect(q, numbers), good.shape)
                size = np.prod(np.sqrt(np.sum((a / weights[list(block.columns), None, None]) ** 2, axis=1)), axis=0)
                value = lane_determinant(a) / np.prod(weights[list(block.columns)])
                determinants.append(value)
                good &= np.abs(value) > least.poor * size
            going = np.ones(shares.share.shape, bool)
            for value in determinants:
                good &= np.sign(value) == np.sign(value[0])
                going &= sure | _steady_steps(value, shares)
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
            for value in self.guards.values(numbers, q, np):
                good &= value > 0.0
        doubted = ~going & np.logical_and.accumulate(good, axis=0)[1:]
        good[1:] &= going
        good = np.logical_and.accumulate(good, axis=0)
        q = np.where(good, q, start[:, None])
        return PoseBatch(q, good=good, doubted=doubted)

    def _iterate(
        self, block: Rows, numbers: RowNumbers, weights: np.ndarray, length: float, q: np.ndarray, share: np.ndarray
    ) -> np.ndarray:
        """Solve a block by Newton from pose to pose, in all designs; say whether each pose was found."""
        columns, least = list(block.columns), limits(np.zeros(0))
        weight, good = weights[columns, None], np.zeros(q.shape[1:], bool)
        good[0], live = True, np.arange(q.shape[2])
        # Only constants of designs have lanes; scales are numbers.
        first = len(block.coordinates)
        rest = [np.broadcast_to(v, live.shape) for v in block.collect(q[:, 0], numbers)[first:]]
        for s in range(1, q.shape[1]):
            before = q[columns, s - 1][:, live]
            guess = before
            if s > 1:
                guess = before + share[s - 1, live] * (before - q[columns, s - 2][:, live])
            given = [*guess, *(q[c, s, live] for c in block.coordinates[len(columns) :]), *rest]
            far = np.full(len(live), np.inf)
            for _ in range(12):  # of Newton, at most
                step = _block_step(block, given, live.shape)
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

    def assemble(self, drawn: Drawn, scales: Scales, length: float) -> np.ndarray:
        """Find the pose of each design that is closest to its drawing, ``(N, designs)``; see `host.closest`."""
        q = drawn.home[..., 0].copy()
        part, least = self.everything, limits(np.zeros(0))
        numbers, columns = RowNumbers([c[..., 0] for c in drawn.constants], scales), list(part.columns)
        inner = np.where(pure_numbers(self.plan.topology), length, 1.0)[columns]
        n, floor = len(columns), 2.5 * least.floor * length
        damping, cost = np.full(q.shape[1], 1e-2), np.full(q.shape[1], np.inf)
        trial, slopes, r = q.copy(), np.zeros((q.shape[1], part.count, n)), np.zeros((q.shape[1], part.count))
        with np.errstate(all="ignore"):
            for turn in range(60):  # of Levenberg and Marquardt, on a drawing that does not fit its dimensions
                given = part.collect(trial, numbers)
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
        """Differentiate poses by designs and inputs, ``(N, changes, steps, designs)``, by the implicit rule; else zero.

        The poses ``(N, steps, designs)`` are there where they are good, ``(steps, designs)``; changes of the known
        coordinates are ``(known, changes, steps, designs)``.
        """
        plan = self.plan
        out = np.zeros((len(q), *known.shape[1:]))
        out[plan.fixed] = np.moveaxis(drawn.home[plan.fixed, :, 1:], -1, 1)[:, :, None]
        out[plan.known] = known
        scales = [np.ones((block.count, len(block.kind.rows))) for block in plan.topology.blocks]
        numbers = RowNumbers([c[..., 0] for c in drawn.constants], scales)
        moved = [np.ascontiguousarray(np.moveaxis(c[..., 1:], -1, 2))[:, :, :, None] for c in drawn.constants]
        with np.errstate(all="ignore"):
            for block in self.blocks:
                given = block.collect(q, numbers)
                rows = block.run_changes([*given, *block.moving(out, moved)])
                rows = [np.broadcast_to(r, out.shape[1:]) for r in rows]
                a = matrix(block, given, q.shape[1:])
                for c, change in zip(block.columns, _solve_small(a, rows), strict=True):
                    np.negative(change, out=out[c])
        out[~(good & np.isfinite(out))] = 0.0
        return out


def matrix(rows: Rows, given: list[ArrayLike], lanes: tuple[int, ...]) -> np.ndarray:
    """Evaluate the derivatives of rows by their columns, ``(rows, columns, *lanes)``."""
    out = np.zeros((rows.count, len(rows.columns), *lanes))
    for place, value in zip(rows.partials[1], rows.run_slopes(np)(given), strict=True):
        out[place] = value
    return out


def _block_step(block: Rows, given: list[ArrayLike], lanes: tuple[int, ...]) -> list[np.ndarray]:
    """Find Newton's step of each column; not finite where the block is singular."""
    if len(block.columns) <= FEW:
        return list(block.run_step(given))
    rows = [np.broadcast_to(r, lanes) for r in block.run(np)(given)]
    return _solve_small(matrix(block, given, lanes), rows)


class _Shares(NamedTuple):
    """Steps in terms of the one before each that went anywhere: values may be given twice, or differ by rounding."""

    share: np.ndarray  # (steps - 1, designs), of the first one 0
    before: np.ndarray  # which step that was, -1 for none


def _measure_shares(track: np.ndarray) -> _Shares:
    ways = np.diff(track, axis=1)
    square = np.sum(ways**2, axis=0)
    # below 1e-10 of the longest step, what changes in one is rounding
    moves = square > 1e-20 * np.max(square, axis=0, initial=0.0)
    last = np.maximum.accumulate(np.where(moves, np.arange(len(moves))[:, None], -1), axis=0)
    before = np.concatenate([np.full_like(last[:1], -1), last])[: len(last)]
    at = np.maximum(before, 0)
    ahead = np.sum(ways * np.take_along_axis(ways, at[None], axis=1), axis=0) if len(moves) else square
    share = np.where(before < 0, 0.0, ahead / np.take_along_axis(np.where(moves, square, 1.0), at, axis=0))
    return _Shares(share, before)


def _steady_steps(value: np.ndarray, shares: _Shares) -> np.ndarray:
    """Say in which steps a determinant goes on as it did, ``(steps - 1, designs)``; see `branch.steady`."""
    change = np.diff(value, axis=0)
    rise = np.where(shares.before < 0, 0.0, np.take_along_axis(change, np.maximum(shares.before, 0), axis=0))
    return branch.steady([value[1:]], [value[:-1]], [rise], shares.share)


def _solve_closed(block: Rows, numbers: "RowNumbers | HostEquations", q: np.ndarray) -> None:
    """Solve a block with a closed form, in all poses, on the side that its first pose has."""
    columns, lanes = list(block.columns), q.shape[1:]
    given = block.collect(q, numbers)
    if block.form == "affine":
        q[columns] -= np.stack([np.broadcast_to(d, lanes) for d in _block_step(block, given, lanes)])
        return
    first = matrix(block, block.collect(q[:, :1], numbers), (1, lanes[1]))
    found = block.run_solution(np)([*given, np.sign(lane_determinant(first))])
    if block.form == "angle":  # its turns are counted along the way
        turns = np.diff(np.concatenate([q[columns[0], :1], np.broadcast_to(found[0], lanes)]), axis=0)
        q[columns[0]] += np.cumsum(turns - 2 * np.pi * np.round(turns / (2 * np.pi)), axis=0)
    else:
        for c, value in zip(columns, found, strict=True):
            q[c] = value


@with_owner
def lockstep(plan: Plan) -> Lockstep:
    """Make a plan ready once."""
    return Lockstep(plan)


def solve_at_once(
    view: HostView, start: np.ndarray, values: np.ndarray, counts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Solve sequences whose blocks all have closed forms, with all poses of a way at once.

    As in traced code (`jaxnc.solvers.sequences`) a closed form needs no guess, only the side that it is on, and whether
    poses are on one branch is seen from them afterwards. What cannot be told so is to be followed.

    Args:
        view: what is solved for.
        start: poses to begin from, ``(N, D)``.
        values: values of the known coordinates, ``(T, known, D)``.
        counts: how many values each sequence has, ``(D,)``.

    Returns:
        Poses ``(N, T, D)``, and which sequences have all theirs on their branch, ``(D,)``.
    """
    total, _, many = values.shape
    none = np.zeros((0, 0, many)), np.zeros(many, bool)
    if view.program is None or start.dtype != np.float64 or not values.shape[1]:  # of a structure nothing moves
        return none
    core = lockstep(view.plan)
    track, every = _track(start[view.plan.known], values)
    # 20_000 poses on the ways of sequences; of more, following costs little
    if not core.closed or track.shape[1] * many > 20_000:
        return none
    q = np.repeat(start[:, None], track.shape[1], axis=1)
    q[view.plan.known] = track
    with np.errstate(all="ignore"):
        for block in core.blocks:
            _solve_closed(block, view.eq, q)
        good = _on_branch(view, start, q, track)
    last = track.shape[1] - 1 - every * (total - counts)
    return q[:, -1 - every * (total - 1) :: every], (good | (np.arange(track.shape[1])[:, None] > last)).all(axis=0)


def _track(home: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, int]:
    """Return known coordinates on the way to all values ``(known, steps, D)``, and how many steps lead to each."""
    total, first = len(values), values[0]
    every = -(-branch.TURNING // total) if total > 1 else 1
    parts = branch.parts_of_way(branch.LEADING if total > 1 else branch.TURNING)[:, None, None]
    lead = [home[None], home + parts * (first - home)]
    before = values[:-1]
    if total > 1:
        # Where the way turns a short step shows how determinants change; it is gone to and fro.
        short = first + branch.SHORT * (values[1] - first)
        lead += [short[None], first[None]]
    between = np.arange(1, every + 1)[:, None, None] / every
    rest = before[:, None] + between * (values[1:] - before)[:, None]
    return np.moveaxis(np.concatenate([*lead, rest.reshape(len(before) * every, *home.shape)]), 0, 1), every


def _on_branch(view: HostView, start: np.ndarray, q: np.ndarray, track: np.ndarray) -> np.ndarray:
    """Say which poses ``(N, steps, D)`` are regular solutions and on one branch with those before, ``(steps, D)``."""
    shape, plan = q.shape[1:], view.plan
    lanes, each = q.reshape(len(q), -1), view.select(np.tile(np.arange(shape[1]), shape[0]))
    assert each.program is not None
    rows, determinants, slopes = each.program.run(("residual", "determinants", "slopes"), each.eq, lanes)
    # Where a slope is none, as of a cam that is upright, there is no derivative either: steps stop there.
    good = (largest_of_lanes(rows) <= each.tolerance(lanes)) & each.upright(lanes) & np.isfinite(slopes).all(axis=0)
    good = good.reshape(shape) & (largest_of_lanes(view.residual(start)) <= view.tolerance(start))
    determinants = determinants.reshape(-1, *shape)
    sizes = np.abs(determinants)
    clear = sizes > branch.CLEAR * sizes.max(axis=1, keepdims=True)
    clear &= np.sign(determinants) == np.sign(determinants[:, :1])
    good &= clear.all(axis=0)
    shares = _measure_shares(track)
    for value in determinants:
        good[1:] &= _steady_steps(value, shares)
    good[1:] &= np.all(np.abs(np.diff(track[plan.angles], axis=1)) <= branch.STEP, axis=0)
    good[1:] &= _follows_slopes(view, q, track, slopes.reshape(len(plan.unknown), -1, *shape))
    return good


def _follows_slopes(view: HostView, q: np.ndarray, track: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Say in which steps poses change as their slopes do, ``(steps - 1, D)``: a kind may jump, or have an edge."""
    plan, way = view.plan, np.diff(track, axis=1)
    unknown, known = (view.weights[at][:, None] for at in (plan.unknown, plan.known))
    slopes = slopes * unknown[:, None]
    before, after = (np.sum(x * way[: slopes.shape[1]], axis=1) for x in (slopes[:, :, :-1], slopes[:, :, 1:]))
    still = np.sum((known * way) ** 2, axis=0)
    lengths = sum(np.sqrt(np.sum(x * x, axis=0) + still) for x in (before, after))
    kink = np.diff(q[plan.unknown], axis=1) * unknown - 0.5 * (before + after)
    bend, kink = (np.sqrt(np.sum(x * x, axis=0)) for x in (after - before, kink))
    return branch.smooth(bend, kink, lengths, view.least.close * view.eq.length)
