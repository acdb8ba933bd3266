"""What is known of a problem near a design, to second order, and the steps that follow from it."""

import dataclasses
import math

import numpy as np

from jaxnc.synthesis.quadratic import least

_EVEN = (1e-10, 1e-6, 1e-3)
"""Of the largest column of the Jacobian: rows added to it, so that no direction is free. The larger ones are for where
too few digits are left of the conditions, as where the only error depends on one unknown (the least largest error)."""
_MISSED = 1e3  # times as heavy as errors is what conditions miss that cannot be met in the trust region
_DEPENDENT = 1e-10  # of the largest singular value: conditions that follow from others
_FLAT = 1e-12  # of the largest second derivative: directions that nothing depends on
_BLOCKED = 8  # times that what stands in the way of a step is joined to what is active


@dataclasses.dataclass
class Model:
    """A problem near a design."""

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

    def programmed(self, reach: float) -> tuple[np.ndarray, np.ndarray] | None:
        """The step of a quadratic program with the squared Jacobian, and its multipliers; None if none was found."""
        found = (self._programmed(reach, even) for even in _EVEN)
        return next((pair for pair in found if pair is not None), None)

    def _programmed(self, reach: float, even: float) -> tuple[np.ndarray, np.ndarray] | None:
        n, rows, c, equal = len(self.gradient), self.rows, self.conditions, self.equal
        top, own = max(float(np.sqrt(np.max(np.diagonal(self.normal)))), 1e-150), np.eye(n)
        # The Jacobian itself: its square would lose the valleys that are much flatter than they are steep.
        left, factor = np.linalg.qr(np.concatenate([self.jacobian, even * top * own]))
        errors = self.errors @ left[: len(self.errors)]
        low, high = np.maximum(self.room[0], -reach), np.minimum(self.room[1], reach)
        every = np.concatenate([rows, -rows[equal], own, -own])
        right = np.concatenate([-c, c[equal], low, -high])
        found = least(factor, errors, every, right)
        if found is None:  # in the trust region not all conditions can be met: each is to miss as little as the worst
            k = len(c) + int(equal.sum())
            wide = np.zeros((n + 1, n + 1))
            wide[:n, :n], wide[n, n] = factor, _MISSED * top
            every = np.concatenate([every, (np.arange(len(every)) < k)[:, None].astype(float)], axis=1)
            every = np.concatenate([every, np.eye(n + 1)[n:]])
            found = least(wide, np.append(errors, 0.0), every, np.append(right, 0.0))
            if found is None:
                return None
        step, u = found
        return np.clip(step[:n], low, high), np.abs(u[: len(c)])

    def whole(
        self, active: np.ndarray, down: np.ndarray, up: np.ndarray, reach: float
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Newton's step on active conditions and bounds and on those in its way, and the conditions along it, or None.

        Active conditions are ``(k,)``; unknowns that stay at a bound are `down` or `up`.
        """
        active, down, up = active.copy(), down.copy(), up.copy()
        step, part = None, 1.0
        for _ in range(_BLOCKED):
            step = self.on(active, down, up, reach)
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

    def on(self, active: np.ndarray, down: np.ndarray, up: np.ndarray, reach: float) -> np.ndarray | None:
        """Newton's step on conditions and bounds, whatever else there is; None if it is not finite."""
        free = ~(down | up)
        step = np.where(down, self.room[0], np.where(up, self.room[1], 0.0))
        rows, c = self.rows[active], self.conditions[active]
        if not free.any():
            return step
        right = -c - rows @ step
        left, sizes, across = np.linalg.svd(rows[:, free], full_matrices=True)
        rank = int(np.sum(sizes > _DEPENDENT * max(float(sizes.max(initial=0.0)), 1e-300)))
        toward = across[:rank].T @ ((left.T @ right)[:rank] / sizes[:rank]) if rank else np.zeros(int(free.sum()))
        far = float(np.max(np.abs(toward), initial=0.0))
        if far > 0.8 * reach:
            toward *= 0.8 * reach / far
        step[free] = toward
        along = across[rank:].T
        if along.shape[1]:
            matrix = self.normal + self.curved
            gradient = along.T @ (self.gradient + matrix @ step)[free]
            step[free] += along @ _trusted(along.T @ matrix[np.ix_(free, free)] @ along, gradient, reach)
        return step if np.isfinite(step).all() else None

    def gain(self, step: np.ndarray) -> float:
        """By how much half the square of the errors falls in a step, to second order."""
        return -float(self.gradient @ step + 0.5 * step @ (self.normal + self.curved) @ step)


def _until(room: np.ndarray, change: np.ndarray, active: np.ndarray) -> np.ndarray:
    """Parts of a step after which there is no room left; infinite for what is active already."""
    return np.where((change < 0.0) & ~active, room / np.where(change < 0.0, -change, 1.0), np.inf)


def _trusted(matrix: np.ndarray, gradient: np.ndarray, reach: float) -> np.ndarray:
    """The least of a quadratic within a ball; directions that nothing depends on stay as they are."""
    values, vectors = np.linalg.eigh(matrix)
    along, top = vectors.T @ gradient, max(float(np.max(np.abs(values))), 1e-300)
    flat = np.abs(values) <= _FLAT * top
    values = np.where(flat, _FLAT * top, values)
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
