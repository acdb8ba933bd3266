"""Sequential quadratic programming: a design goes to a point that no step of second order improves.

Each design goes by itself; what is asked of poses is evaluated for all designs at once. An iteration tries two steps.
The first solves a quadratic program of the squared Jacobian, with all conditions and bounds, which also finds the
active ones. The second is Newton's on the active set, with the exact second derivatives of the Lagrangian from
differences of its exact gradients. Where both fail, the trust region shrinks.

Source: J. Nocedal and S. J. Wright, Numerical Optimization, 2nd ed., 2006, chapter 18 (18.5: steps on the active set);
C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974, chapter 23 (least distance programming).
"""

import dataclasses
import math
import time
from collections.abc import Sequence

import numpy as np

from jaxnc.synthesis.evaluate import LANES, MEETS, Evaluator, violation
from jaxnc.synthesis.search.goal import Goal

# -- quadratic programs by nonnegative least squares -------------------------------------------------------------------


def nonnegative(matrix: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    """Find the x ≥ 0 with the least ``‖matrix x − right‖``; None where it was not found.

    The matrix is ``(m, n)``.
    """
    from scipy.optimize import nnls

    if not matrix.shape[1]:
        return np.zeros(0)
    try:
        return nnls(matrix, right, maxiter=20 * (matrix.shape[1] + 10))[0]
    except (RuntimeError, ValueError):  # it goes round in circles, or something is not finite
        return None


def least(
    factor: np.ndarray, errors: np.ndarray, rows: np.ndarray, right: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Find the d with the least ``½ ‖factor d + errors‖²`` and ``rows d ≥ right``, and multipliers; or None.

    The factor is upper triangular, ``(n, n)``; the rows are ``(k, n)``.
    """
    try:
        across = np.linalg.solve(factor.T, rows.T).T
    except np.linalg.LinAlgError:
        return None
    sizes = np.linalg.norm(across, axis=1)
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    across, level = across / sizes[:, None], (right + across @ errors) / sizes
    far = float(np.max(level, initial=0.0))
    if not np.isfinite(far):
        return None
    if far <= 0.0:
        return np.linalg.solve(factor, -errors), np.zeros(len(right))
    u = nonnegative(np.concatenate([across.T, level[None] / far]), np.append(np.zeros(len(errors)), 1.0))
    if u is None:
        return None
    left = 1.0 - float(level @ u) / far
    if left <= 1e-13:  # 1e-13 of the right side is left of a program that no point is feasible for
        return None
    u = u * (far / left)
    return np.linalg.solve(factor, across.T @ u - errors), u / sizes


# -- a problem near a design -------------------------------------------------------------------------------------------

_EVEN = (1e-10, 1e-6, 1e-3)
"""Of the largest column of the Jacobian: rows added to it, so that no direction is free. The larger ones are for where
too few digits are left of the conditions, as where the only error depends on one unknown (the least largest error)."""


@dataclasses.dataclass
class LocalModel:
    """A problem near a design, to second order."""

    room: tuple[np.ndarray, np.ndarray]  # how far unknowns may go down and up until their bounds
    jacobian: np.ndarray  # derivatives of the errors, (m, n)
    errors: np.ndarray  # (m,)
    rows: np.ndarray  # derivatives of the conditions, (k, n)
    conditions: np.ndarray  # (k,)
    equal: np.ndarray  # which of them are equalities
    curved: np.ndarray  # the second derivatives of the Lagrangian but for the squared Jacobian

    def __post_init__(self):
        # The gradient of half the square of the errors, and the squared Jacobian.
        self.gradient, self.normal = self.errors @ self.jacobian, self.jacobian.T @ self.jacobian

    def quadratic_step(self, reach: float) -> tuple[np.ndarray, np.ndarray] | None:
        """Solve a quadratic program with the squared Jacobian: step and multipliers; None if none was found."""
        found = (self._quadratic_step(reach, even) for even in _EVEN)
        return next((pair for pair in found if pair is not None), None)

    def _quadratic_step(self, reach: float, even: float) -> tuple[np.ndarray, np.ndarray] | None:
        n, rows, c, equal = len(self.gradient), self.rows, self.conditions, self.equal
        top, own = max(float(np.sqrt(np.max(np.diagonal(self.normal)))), 1e-150), np.eye(n)
        # The Jacobian itself: its square would lose the basins that are much flatter than they are steep.
        left, factor = np.linalg.qr(np.concatenate([self.jacobian, even * top * own]))
        errors = self.errors @ left[: len(self.errors)]
        low, high = np.maximum(self.room[0], -reach), np.minimum(self.room[1], reach)
        every = np.concatenate([rows, -rows[equal], own, -own])
        right = np.concatenate([-c, c[equal], low, -high])
        found = least(factor, errors, every, right)
        if found is None:  # in the trust region not all conditions can be met: each is to miss as little as the worst
            k = len(c) + int(equal.sum())
            wide = np.zeros((n + 1, n + 1))
            # 1e3 times as heavy as errors is what conditions miss that cannot be met in the trust region
            wide[:n, :n], wide[n, n] = factor, 1e3 * top
            every = np.concatenate([every, (np.arange(len(every)) < k)[:, None].astype(float)], axis=1)
            every = np.concatenate([every, np.eye(n + 1)[n:]])
            found = least(wide, np.append(errors, 0.0), every, np.append(right, 0.0))
            if found is None:
                return None
        step, u = found
        return np.clip(step[:n], low, high), np.abs(u[: len(c)])

    def newton_step(
        self, active: np.ndarray, down: np.ndarray, up: np.ndarray, reach: float
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Take Newton's step on active conditions and bounds and those in its way: step and conditions, or None.

        Active conditions are ``(k,)``; unknowns that stay at a bound are `down` or `up`.
        """
        active, down, up = active.copy(), down.copy(), up.copy()
        step, part = None, 1.0
        for _ in range(8):  # what stands in the way of a step is joined to what is active
            step = self.newton_on(active, down, up, reach)
            if step is None:
                return None
            ways = (
                _until(np.maximum(self.conditions, 0.0), self.rows @ step, active),
                _until(-self.room[0], step, down),
                _until(self.room[1], -step, up),
            )
            part = min(1.0, *(float(w.min(initial=np.inf)) for w in ways))
            if part >= 1.0:
                break
            for mask, way in zip((active, down, up), ways, strict=True):
                mask |= way <= part * (1 + 1e-9) + 1e-12
        return None if step is None else (part * step, active)

    def newton_on(self, active: np.ndarray, down: np.ndarray, up: np.ndarray, reach: float) -> np.ndarray | None:
        """Take Newton's step on given conditions and bounds alone; None if it is not finite."""
        free = ~(down | up)
        step = np.where(down, self.room[0], np.where(up, self.room[1], 0.0))
        rows, c = self.rows[active], self.conditions[active]
        if not free.any():
            return step
        right = -c - rows @ step
        left, sizes, across = np.linalg.svd(rows[:, free], full_matrices=True)
        # 1e-10 of the largest singular value: conditions that follow from others
        rank = int(np.sum(sizes > 1e-10 * max(float(sizes.max(initial=0.0)), 1e-300)))
        toward = across[:rank].T @ ((left.T @ right)[:rank] / sizes[:rank]) if rank else np.zeros(int(free.sum()))
        far = float(np.max(np.abs(toward), initial=0.0))
        if far > 0.8 * reach:
            toward *= 0.8 * reach / far
        step[free] = toward
        along = across[rank:].T
        if along.shape[1]:
            matrix = self.normal + self.curved
            gradient = along.T @ (self.gradient + matrix @ step)[free]
            step[free] += along @ _trust_step(along.T @ matrix[np.ix_(free, free)] @ along, gradient, reach)
        return step if np.isfinite(step).all() else None

    def gain(self, step: np.ndarray) -> float:
        """Decrease of half the square of the errors in a step, to second order."""
        return -float(self.gradient @ step + 0.5 * step @ (self.normal + self.curved) @ step)


def _until(room: np.ndarray, change: np.ndarray, active: np.ndarray) -> np.ndarray:
    """Parts of a step after which no room is left; infinite for what is active already."""
    return np.where((change < 0.0) & ~active, room / np.where(change < 0.0, -change, 1.0), np.inf)


def _trust_step(matrix: np.ndarray, gradient: np.ndarray, reach: float) -> np.ndarray:
    """Minimise a quadratic within a ball; directions that nothing depends on stay as they are."""
    values, vectors = np.linalg.eigh(matrix)
    along, top = vectors.T @ gradient, max(float(np.max(np.abs(values))), 1e-300)
    least = 1e-12  # of the largest second derivative: nothing depends on directions that have less
    flat = np.abs(values) <= least * top
    values = np.where(flat, least * top, values)
    along = np.where(flat & (np.abs(along) <= 1e-9 * max(float(np.max(np.abs(along))), 1e-300)), 0.0, along)
    if values[0] > 0.0:
        step = -along / values
        if np.linalg.norm(step) <= reach:
            return vectors @ step
    if not np.isfinite(reach):
        return vectors @ np.where(values > 0.0, -along / np.abs(values), 0.0)
    square = along * along
    low = max(0.0, -float(values[0])) + 1e-14 * top
    high = low + math.sqrt(float(square.sum())) / reach + top
    more = low
    for _ in range(100):  # Newton's on the reciprocal of the length, within a bracket
        shifted = values + more
        terms = square / (shifted * shifted)
        long = math.sqrt(float(terms.sum()))
        if abs(long - reach) <= 1e-10 * reach:
            break
        low, high = (more, high) if long > reach else (low, more)
        more += (long - reach) / reach * long * long / max(float((terms / shifted).sum()), 1e-300)
        if not low < more < high:
            more = math.sqrt(low * high)
            if high - low <= 1e-15 * high:
                break
    step = -along / (values + more)
    rest = reach**2 - float(step @ step)
    if values[0] < 0.0 and rest > 1e-6 * reach**2:  # the hard case: along the direction that curves down
        step[0] += np.sqrt(rest)
    return vectors @ step


# -- designs under way -------------------------------------------------------------------------------------------------

_FEEL = 1e-7  # of the unknowns' scales: the step of differences of gradients
_NEAR = 1e-7  # a condition that is met by less is active
_PROMISE = 1e-10  # of the square: a point is an end if a step of second order promises no more
_EXACT = 1e-26  # mean square of the errors that is none
_SLOW = 20  # iterations in a row without a gain of 1e-4: a corner of a condition, along which steps get ever shorter
_STALE = 3  # steps after which second derivatives are formed anew; between them they are updated


@dataclasses.dataclass(frozen=True)
class End:
    """Where a design ended, and whether that is an end."""

    row: np.ndarray  # its unknowns, and the problem's arguments
    square: float  # the sum of the squares of its divided errors
    # The gradient of the error along all directions that conditions and bounds leave, as the largest cosine between the
    # errors and a column of their derivatives; 0 where all errors are zero.
    optimality: float
    promised: float  # the part of the square that a step of second order promises to take away
    feasibility: float  # the largest violation of a condition, in parts of the problem's size
    iterations: int  # of second order that it took
    reason: str  # why it is no end, in words; "" where it is one

    @classmethod
    def unknown(cls, row: np.ndarray, square: float, reason: str) -> "End":
        """Where a design was left that was not followed to its end."""
        return cls(row, square, np.nan, np.nan, np.nan, 0, reason)

    @property
    def converged(self) -> bool:
        """True if it is an end."""
        return not self.reason


@dataclasses.dataclass
class SqpLane:
    """A design under way."""

    y: np.ndarray
    given: np.ndarray
    errors: np.ndarray
    conditions: np.ndarray
    slopes: np.ndarray
    wide: float = 0.1
    reach: float = 0.1
    penalty: float = 0.0
    merit: float = np.inf
    iterations: int = 0
    over: bool = False
    fresh: bool = True
    stale: int = 10**9
    curved: np.ndarray | None = None
    multipliers: np.ndarray | None = None
    optimality: float = np.inf
    promised: float = np.inf
    lost: bool = False
    slow: int = 0  # iterations in a row that brought next to nothing
    kept: tuple[float, np.ndarray, float] | None = None  # the best place that meets the conditions

    @property
    def square(self) -> float:
        """The sum of the squares of its errors."""
        return float(self.errors @ self.errors)


@dataclasses.dataclass
class _Try:
    """A trial step: the conditions along it, whether it is Newton's, the gain hoped for, and what it brings."""

    step: np.ndarray
    active: np.ndarray
    newton: bool = False
    hoped: float = 0.0
    wanted: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    y: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    errors: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    conditions: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    slopes: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))
    merit: float = np.inf


class Sqp:
    """Designs of a problem brought to their ends."""

    def __init__(self, goal: Goal, width: int = LANES, until: float = math.inf):
        """Evaluate `width` designs at once, as the search before did, so that what is compiled is the same.

        No iteration begins after the time `until`, as of `time.perf_counter`.
        """
        self.until = until
        self.width = min(width, LANES)
        self.evaluate, self.scale = Evaluator(goal), goal.scale
        self.low, self.high = goal.low / self.scale, goal.high / self.scale
        self.equal, self.count = goal.equalities, goal.count
        self.room = np.zeros(len(self.equal))
        turning = np.repeat([c.turning for c in goal.problem.conditions], goal.problem.counts)
        # room for conditions that make sure that the input turns: at their limit nothing moves any more
        self.room[: len(turning)] = 1e-10 * turning
        self.evaluations, self.errors = 0, goal.shape[0]

    def run(self, rows: Sequence[np.ndarray], most: int) -> list[End]:
        """Bring designs, rows of the goal, to their ends, with `most` iterations each at most."""
        lanes = self.begin(rows)
        self.go(lanes, most)
        return [self.end_of(lane) for lane in lanes]

    def begin(self, rows: Sequence[np.ndarray]) -> list[SqpLane]:
        """Evaluate rows of the goal, from which designs are to go on."""
        if not len(rows):
            return []
        every, out = np.stack(rows), []
        y, given = np.clip(every[:, : self.count] / self.scale, self.low, self.high), every[:, self.count :]
        for k, (errors, conditions, slopes, ok) in enumerate(self._evaluate(y, given)):
            lost = not (ok and np.isfinite(slopes).all())
            out.append(SqpLane(y[k], given[k], errors, conditions, slopes, over=lost))
        return out

    def go(self, lanes: Sequence[SqpLane], most: int) -> None:
        """Take iterations until each design has had `most`, or comes to its end."""
        with np.errstate(all="ignore"):
            while some := [lane for lane in lanes if not lane.over and lane.iterations < most]:
                if time.perf_counter() > self.until:
                    break
                self._iterate(some)
            # Those that were given up say how far they are.
            for lane in lanes:
                if not lane.over:
                    self._weigh([lane])
                    self._is_over(lane)

    def end_of(self, lane: SqpLane) -> End:
        """End of a design, as far as it has come."""
        far, square, y = self._far(lane), lane.square, lane.y
        if far > MEETS and lane.kept is not None:
            square, y, far = lane.kept
        exact = square <= _EXACT * len(lane.errors)
        least = self._least(square) if lane.over else _PROMISE
        good = y is lane.y and far <= MEETS and (exact or lane.promised <= least)
        reason = f"{lane.iterations} iterations"
        if lane.over:
            reason = "no step is possible" if lane.iterations else "does not reach its targets"
        return End(
            np.concatenate([y * self.scale, lane.given]),
            square,
            0.0 if exact else lane.optimality,
            0.0 if exact else lane.promised,
            far,
            lane.iterations,
            "" if good else reason,
        )

    def level(self, lane: SqpLane) -> float:
        """Level of a design: its square, and the price of the conditions that it misses on its way."""
        return 2.0 * self._merit(lane, lane.errors, lane.conditions)

    def _evaluate(
        self, y: np.ndarray, given: np.ndarray, way: str = "close"
    ) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, bool]]:
        """Evaluate many designs: errors, conditions, derivatives of both, and whether they can be trusted."""
        out = []
        self.evaluations += len(y)
        for first in range(0, len(y), self.width):
            at = np.arange(first, first + self.width)
            live, at = at < len(y), np.minimum(at, len(y) - 1)
            errors, conditions, *rest = self.evaluate(y[at] * self.scale, given[at], live, way)
            some = int(live.sum())
            out += zip(errors[:some], (conditions - self.room)[:some], *(part[:some] for part in rest), strict=True)
        return out

    # -- an iteration ----------------------------------------------------------------------------------------------

    def _iterate(self, lanes: list[SqpLane]) -> None:
        self._weigh(lanes)
        lanes = [lane for lane in lanes if not self._is_over(lane)]
        tries = [(lane, one) for lane in lanes for one in self._steps(lane)]
        if not tries:
            return
        self._try_steps(tries)
        last = tries
        for _ in range(2):  # a step is corrected twice
            last = [(lane, new) for lane, one in last if (new := self._correct(lane, one)) is not None]
            if not last:
                break
            self._try_steps(last)
            tries += last
        for lane in lanes:
            self._decide(lane, [one for other, one in tries if other is lane])

    def _weigh(self, lanes: list[SqpLane]) -> None:
        for lane in lanes:
            if lane.fresh:
                self._weigh_lane(lane)
        self._form_second_derivatives([lane for lane in lanes if lane.fresh and lane.stale >= _STALE])

    def _try_steps(self, tries: list[tuple[SqpLane, _Try]]) -> None:
        y = np.stack([np.clip(lane.y + one.step, self.low, self.high) for lane, one in tries])
        looks = self._evaluate(y, np.stack([lane.given for lane, _ in tries]))
        for (lane, one), at, (errors, conditions, slopes, ok) in zip(tries, y, looks, strict=True):
            one.y, one.errors, one.conditions, one.slopes = at, errors, conditions, slopes
            one.merit = self._merit(lane, errors, conditions) if ok and np.isfinite(slopes).all() else np.inf
            one.merit = one.merit if np.isfinite(one.merit) else np.inf

    def _correct(self, lane: SqpLane, one: _Try) -> _Try | None:
        """Correct a step that brought less than expected: meet the conditions that it has curved away from."""
        if lane.merit - one.merit >= 0.5 * one.hoped or not np.isfinite(one.conditions).all():
            return None
        m = len(lane.errors)
        missed = np.where(self.equal, np.abs(one.conditions) > 0.0, one.conditions < 0.0) | one.active
        # Where poses are found, by the derivatives there: that leads back however far the step has gone.
        slopes = one.slopes if np.isfinite(one.merit) else lane.slopes
        rows, right = [slopes[m:][missed]], [-one.conditions[missed]]
        if np.isfinite(one.merit):
            light = 1e-2  # weight of errors beside conditions in a correction
            rows.append(light * slopes[:m])
            right.append(light * (one.wanted - one.errors))
        matrix, right = np.concatenate(rows), np.concatenate(right)
        if not len(matrix):
            return None
        matrix = matrix * ~((one.y <= self.low) | (one.y >= self.high))
        # a correction goes along singular values of 1e-6 of the largest and more
        change = np.linalg.lstsq(matrix, right, rcond=1e-6)[0]
        if not 0.0 < np.linalg.norm(change) <= 0.75 * np.linalg.norm(one.step):
            return None
        return dataclasses.replace(one, step=one.step + change)

    def _weigh_lane(self, lane: SqpLane) -> None:
        """Find multipliers of the conditions, and the gradient that they and the bounds leave."""
        m = len(lane.errors)
        gradient, rows = lane.errors @ lane.slopes[:m], lane.slopes[m:]
        sizes = self._sizes(lane)
        near = self.equal | (lane.conditions <= _NEAR)
        down, up = lane.y <= self.low + _NEAR * _FEEL, lane.y >= self.high - _NEAR * _FEEL
        own = np.eye(self.count)
        active = [rows[near], -rows[near & self.equal], own[down], -own[up]]
        columns = (np.concatenate(active) / sizes).T
        lengths = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        u = nonnegative(columns / lengths, gradient / sizes)
        lane.multipliers = np.zeros(len(rows))
        if u is None:
            left = gradient / sizes
        else:
            left = gradient / sizes - (columns / lengths) @ u
            u = u / lengths
            count = int(near.sum())
            lane.multipliers[near] = u[:count]
            lane.multipliers[near & self.equal] -= u[count : count + int((near & self.equal).sum())]
        lane.optimality = float(np.max(np.abs(left), initial=0.0)) / max(np.sqrt(lane.square), 1e-300)
        # 1.5 times the largest multiplier
        lane.penalty = max(lane.penalty, 1.5 * float(np.max(np.abs(lane.multipliers), initial=0.0)))

    def _sizes(self, lane: SqpLane) -> np.ndarray:
        """Sizes of the errors' derivatives by each unknown; of the conditions' where no error depends on it."""
        m = len(lane.errors)
        sizes, others = (np.linalg.norm(part, axis=0) for part in (lane.slopes[:m], lane.slopes[m:]))
        sizes = np.where(sizes > 1e-9 * sizes.max(), sizes, others)
        return np.maximum(sizes, 1e-12 * max(sizes.max(), 1e-300))

    def _form_second_derivatives(self, lanes: list[SqpLane]) -> None:
        """Form second derivatives of the Lagrangian, without the squared Jacobian, from differences of gradients."""
        if not lanes:
            return
        n, steps = self.count, []
        for lane in lanes:
            h = _FEEL * (1.0 + np.abs(lane.y))
            steps.append(np.where(lane.y + h > self.high, -h, h))
        y = np.concatenate([lane.y + np.diag(h) for lane, h in zip(lanes, steps, strict=True)])
        given = np.concatenate([np.repeat(lane.given[None], n, axis=0) for lane in lanes])
        looks = self._evaluate(y, given, "sure")
        for k, (lane, h) in enumerate(zip(lanes, steps, strict=True)):
            assert lane.multipliers is not None
            weights = np.concatenate([lane.errors, -lane.multipliers])
            curved = np.zeros((n, n))
            for j in range(n):
                _, _, slopes, ok = looks[k * n + j]
                if ok and np.isfinite(slopes).all():
                    curved[j] = weights @ (slopes - lane.slopes) / h[j]
            lane.curved, lane.stale = 0.5 * (curved + curved.T), 0

    def _is_over(self, lane: SqpLane) -> bool:
        """Find out whether a design is at its end, or can go no further."""
        exact = lane.square <= _EXACT * len(lane.errors)
        far = self._far(lane)
        if lane.fresh:
            lane.promised = self._promise(lane)
            if far <= MEETS and (lane.kept is None or lane.square <= lane.kept[0]):
                lane.kept = lane.square, lane.y, far
        end = far <= MEETS and (exact or lane.promised <= _PROMISE)
        # At an end it goes on to rounding as long as that is quick.
        done = exact or lane.promised <= 1e-3 * _PROMISE or lane.lost
        stuck = max(lane.reach, lane.wide) < 1e-13 or lane.slow >= _SLOW  # smaller steps are none
        lane.over = (end and done) or stuck
        return lane.over

    def _least(self, square: float) -> float:
        """Part of a square that can be told from rounding; where no step is possible, less is none."""
        # errors change by 1e-14 of the size from one evaluation to the next
        return max(_PROMISE, 1e-14 * np.sqrt(self.errors / max(square, 1e-300)))

    def _far(self, lane: SqpLane) -> float:
        return float(np.max(violation(lane.conditions, self.equal), initial=0.0))

    def _model(self, lane: SqpLane) -> LocalModel:
        assert lane.curved is not None
        m, room = len(lane.errors), (self.low - lane.y, self.high - lane.y)
        return LocalModel(room, lane.slopes[:m], lane.errors, lane.slopes[m:], lane.conditions, self.equal, lane.curved)

    def _promise(self, lane: SqpLane) -> float:
        """Part of the square that a step of second order would take away."""
        assert lane.multipliers is not None
        slack = float(np.sum(np.abs(lane.multipliers * lane.conditions)))
        model = self._model(lane)
        step = model.newton_on(self.equal | (lane.multipliers > 0.0), *self._held_at_bounds(lane), np.inf)
        return np.inf if step is None else 2.0 * (abs(model.gain(step)) + slack) / max(lane.square, 1e-300)

    def _held_at_bounds(self, lane: SqpLane) -> tuple[np.ndarray, np.ndarray]:
        """Mark unknowns at their bounds that the descent presses against them."""
        assert lane.multipliers is not None
        m, tiny = len(lane.errors), _NEAR * _FEEL
        left = lane.errors @ lane.slopes[:m] - lane.multipliers @ lane.slopes[m:]
        return (lane.y <= self.low + tiny) & (left > 0.0), (lane.y >= self.high - tiny) & (left < 0.0)

    # -- steps -----------------------------------------------------------------------------------------------------

    def _steps(self, lane: SqpLane) -> list[_Try]:
        """Steps that are worth trying."""
        assert lane.multipliers is not None
        m, none, model, ways = len(lane.errors), np.zeros(len(lane.conditions), bool), self._model(lane), []
        out, found = [], model.quadratic_step(lane.wide)
        if found is not None:
            step, u = found
            out.append(_Try(step, none))
            active = self.equal | (u > 1e-10 * max(float(np.max(u, initial=0.0)), 1e-300))
            ways.append((active, lane.y + step <= self.low, lane.y + step >= self.high))
        ways.append((self.equal | ((lane.multipliers > 0.0) & (lane.conditions <= _NEAR)), *self._held_at_bounds(lane)))
        steps = [model.newton_step(active, down, up, lane.reach) for active, down, up in ways]
        out += [_Try(*step, newton=True) for step in steps if step is not None]
        if len(out) == 3 and np.allclose(out[1].step, out[2].step, rtol=1e-3, atol=0.0):
            out.pop()
        if not out:
            gradient = lane.errors @ lane.slopes[:m] - lane.multipliers @ lane.slopes[m:]
            out.append(_Try(-gradient * lane.wide / max(float(np.max(np.abs(gradient))), 1e-300), none))
        lane.merit = self._merit(lane, lane.errors, lane.conditions)
        for one in out:
            one.hoped = lane.merit - self._expected_merit(lane, one.step, one.newton)
            one.wanted = lane.errors + lane.slopes[:m] @ one.step
        return out

    # -- what comes of them ----------------------------------------------------------------------------------------

    def _merit(self, lane: SqpLane, errors: np.ndarray, conditions: np.ndarray) -> float:
        return 0.5 * float(errors @ errors) + lane.penalty * float(np.sum(violation(conditions, self.equal)))

    def _decide(self, lane: SqpLane, tries: list[_Try]) -> None:
        """Take the best of the steps, if one is better, and adapt the trust regions."""
        lane.iterations += 1
        for newton in (False, True):
            own = [one for one in tries if one.newton == newton]
            if own:
                one = min(own, key=lambda one: one.merit)
                moved, ratio = float(np.linalg.norm(one.step)), (lane.merit - one.merit) / max(one.hoped, 1e-300)
                if newton:
                    lane.reach = _adapt_reach(lane.reach, ratio, moved)
                else:
                    lane.wide = _adapt_reach(lane.wide, ratio, float(np.max(np.abs(one.step))))
        best = min(tries, key=lambda one: one.merit)
        lane.fresh = best.merit < lane.merit
        lane.lost = not lane.fresh
        lane.slow = lane.slow + 1 if best.merit > (1.0 - 1e-4) * lane.merit else 0
        if lane.fresh:
            self._update_curvature(lane, best)
            lane.y, lane.errors, lane.conditions, lane.slopes = best.y, best.errors, best.conditions, best.slopes

    def _update_curvature(self, lane: SqpLane, best: _Try) -> None:
        """Update second derivatives to agree with the change of gradients over a step, by rank one."""
        assert lane.curved is not None and lane.multipliers is not None
        lane.stale += 1
        if best.merit < lane.merit - 2.0 * best.hoped or best.merit > lane.merit - 0.5 * best.hoped:
            lane.stale = _STALE  # it has gone too far for that
        step = best.y - lane.y
        left = np.concatenate([best.errors, -lane.multipliers]) @ (best.slopes - lane.slopes) - lane.curved @ step
        along = float(left @ step)
        if abs(along) > 1e-8 * np.linalg.norm(left) * np.linalg.norm(step):
            lane.curved = lane.curved + np.outer(left, left) / along

    def _expected_merit(self, lane: SqpLane, step: np.ndarray, newton: bool) -> float:
        """The merit that the model expects after a step."""
        assert lane.curved is not None
        m = len(lane.errors)
        errors = lane.errors + lane.slopes[:m] @ step
        conditions = lane.conditions + lane.slopes[m:] @ step
        bent = 0.5 * float(step @ lane.curved @ step) if newton else 0.0
        return self._merit(lane, errors, conditions) + bent


def _adapt_reach(reach: float, ratio: float, moved: float) -> float:
    """Adapt a trust region to the part of the expected gain that a step brought."""
    if ratio > 0.7 and moved > 0.7 * reach:
        return min(2.5 * reach, 1e4)
    return min(reach, max(0.5 * moved if ratio > 0.0 else 0.2 * moved, 0.1 * reach)) if ratio < 0.2 else reach
