"""A motion of one freedom as a curve, on the host: steps of arc length, and where a coordinate turns back.

Nothing is driven here, so that dead points of an input are ordinary points of the curve. Along the curve the tangent t
solves ``[Φ_q; tᵀ] t = (0, 1)``, and the bordered determinant keeps its sign: where two curves pass close by each other,
it tells them apart. A coordinate turns back where its component of t vanishes. That point is found between two nodes
where its signs differ, or, from poses nearby, by Newton on Φ = 0 together with this component.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from jaxnc.solvers.host.view import HostView, least_squares
from jaxnc.solvers.rows import slope_program

LONGEST = 60.0  # sizes of the mechanism: a longer curve is taken for unbounded


class Corrected(NamedTuple):
    """Poses a step further along; lanes are the last axis."""

    q: np.ndarray  # the poses, (N, lanes)
    t: np.ndarray  # their unit tangents in weighted unknowns, (n, lanes)
    size: np.ndarray  # largest residual, a length, (lanes,)
    moved: np.ndarray  # size of the correction, a length, (lanes,)
    matrix: np.ndarray  # bordered matrices there, (lanes, m + 1, n)

    def fits(self, t: np.ndarray, h: np.ndarray | float, limit: float) -> np.ndarray:
        """Say which steps from tangents ``(n, lanes)`` are short enough for the curve to be followed, ``(lanes,)``."""
        return (self.size <= limit) & (self.moved <= 0.2 * h) & (np.sum(t * self.t, axis=0) > 0.97)


@dataclass
class TracedCurve:
    """Nodes of a traced curve: poses, tangents and arc length; whether it closed, or cannot be followed at its ends."""

    q: list[np.ndarray] = field(default_factory=list)
    t: list[np.ndarray] = field(default_factory=list)
    s: list[float] = field(default_factory=list)
    closed: bool = False
    stuck: tuple[bool, bool] = (False, False)

    def add(self, q: np.ndarray, t: np.ndarray, step: float) -> None:
        """Append a node `step` further along."""
        self.q.append(q)
        self.t.append(t)
        self.s.append(self.s[-1] + step)


def first_tangent(view: HostView, q: np.ndarray) -> np.ndarray:
    """A unit tangent ``(n,)`` at a pose ``(N,)``: the right singular vector of the smallest singular value."""
    return np.linalg.svd(view.matrices(q[:, None])[0][0] / view.inner, full_matrices=True)[2][-1]


def _bordered_matrix(view: HostView, q: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rows ``(m, lanes)``, and weighted Jacobians with a direction as last row, ``(lanes, m + 1, n)``."""
    program = slope_program(view.plan)
    if program is None:
        r, inner = view.residual(q), view.matrices(q)[0]
    else:  # at a single pose by far the faster: a curve is thousands of them, one after the other
        r, entries = program.run(("residual", "entries"), view.eq, q)
        inner = np.zeros((q.shape[1], *view.shape), q.dtype)
        inner[:, program.places[0], program.places[1]] = entries.T
    return r, np.concatenate([inner / view.inner, along.T[:, None]], axis=1)


def _tangent_of(matrix: np.ndarray) -> np.ndarray:
    """Return the tangent ``(lanes, n)``, not of unit length: a bordered matrix maps it to its border alone."""
    right = np.zeros((len(matrix), matrix.shape[1], 1))
    right[:, -1] = 1.0
    x = least_squares(matrix, right)
    return (x + least_squares(matrix, right - matrix @ x))[:, :, 0]


def step_along(view: HostView, q: np.ndarray, t: np.ndarray, h: np.ndarray) -> Corrected:
    """Go one step of arc length in every lane: predict along the tangent, correct across it.

    Nothing is driven (one freedom is left). Poses are on the curve, ``(N, lanes)``, tangents in weighted unknowns,
    ``(n, lanes)``, steps ``(lanes,)``.
    """
    at, w = view.plan.unknown, view.inner[:, None]
    x = q.copy()
    x[at] += h * t / w
    guess, best, size = x[at], x, np.full(len(h), np.inf)
    floor = 0.5 * view.least.floor * view.eq.length
    most = 8  # corrections of a step
    for i in range(most + 1):
        r, matrix = _bordered_matrix(view, x, t)
        new = np.max(np.abs(r), axis=0, initial=0.0)
        better = new < size
        gained = new < 0.5 * size  # less is rounding, once the pose is a solution
        best, size = np.where(better, x, best), np.where(better, new, size)
        there = np.where(better[:, None, None], matrix, there) if i else matrix
        if i == most or np.all((size <= floor) | (~gained & (size <= view.tolerance(best)))):
            break
        right = np.concatenate([r, np.zeros((1, r.shape[1]))])
        dx = least_squares(matrix, right.T[:, :, None])[:, :, 0].T
        x = x.copy()
        x[at] -= np.where(np.isfinite(dx).all(axis=0), dx, 0.0) / w
    tangent = _tangent_of(there).T
    moved = np.sqrt(np.sum((w * (best[at] - guess)) ** 2, axis=0))
    return Corrected(best, tangent / np.sqrt(np.sum(tangent * tangent, axis=0)), size, moved, there)


def _try_steps(view: HostView, q: np.ndarray, t: np.ndarray, *h: float) -> Corrected:
    """Try steps of so many lengths from one pose ``(N,)``, each a lane."""
    return step_along(view, np.repeat(q[:, None], len(h), 1), np.repeat(t[:, None], len(h), 1), np.array(h))


def turning_point(view: HostView, place: int, q: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, float]:
    """Where a coordinate turns back, from a pose nearby: Newton on Φ = 0 and tangent component = 0.

    Nothing is driven. The tangent is ``(n,)``, the place that of the unknown. With the pose comes what is left of the
    equations (residual, a length; tangent component).
    """
    at, length, x = view.plan.unknown, view.eq.length, q.copy()
    most = 10  # iterations towards a turning point
    for i in range(most + 1):
        r, matrix = _bordered_matrix(view, x[:, None], t[:, None])
        y = _tangent_of(matrix)[0]
        size = float(np.sqrt(y @ y))
        right = np.append(r[:, 0], length * y[place] / size)
        left = float(np.max(np.abs(right)))
        if i == most or not np.isfinite(left):
            break
        # M y = e, so M dy = -dM y: with it the change of the unit tangent y / |y|.
        bent = _bilinear_form(view, x, y)
        dy = -least_squares(matrix, np.concatenate([bent, np.zeros((1, len(at)))])[None])[0]
        change = (dy[place] - y[place] / size**2 * (y @ dy)) / size
        system = np.concatenate([matrix[0, :-1], length * change[None]])
        dx = least_squares(system[None], right[None, :, None])[0, :, 0]
        if not np.isfinite(dx).all():
            break
        x[at] -= dx / view.inner
        if np.max(np.abs(dx)) <= view.least.floor * length:
            break
    return x, left


def _bilinear_form(view: HostView, q: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Derivatives of the rows along a direction y and each of the weighted unknowns, ``(m, n)``.

    A second time derivative at rest is the quadratic form whose bilinear form this is.
    """
    at, n = view.plan.unknown, len(y)
    velocity = np.zeros((len(q), 2 * n))
    velocity[at] = (y / view.inner)[:, None]
    velocity[at, range(n)] += 1.0 / view.inner
    velocity[at, range(n, 2 * n)] -= 1.0 / view.inner
    poses = np.repeat(q[:, None], 2 * n, axis=1)
    rows = view.eq.rates(poses, [velocity, np.zeros_like(velocity)])[view.plan.rows]
    return 0.25 * (rows[:, :n] - rows[:, n:])


def trace_curve(
    view: HostView, q: np.ndarray, t: np.ndarray, within: tuple[int, float, float] | None = None
) -> TracedCurve:
    """Follow a curve until it closes, leaves a range of one coordinate, or grows too long.

    Nothing is driven. The range is `within` an index, lower and upper limit.
    """
    size = view.eq.length
    h, shortest = 0.02 * size, 1e-9 * size
    limit = float(view.tolerance(q[:, None])[0]) * 10
    begin = _try_steps(view, q, t, 0.0)  # a drawing need not be exact
    q, matrix = begin.q[:, 0], begin.matrix
    curve = TracedCurve([q], [t], [0.0])
    leaving = False
    for _ in range(20000):  # steps
        found = _try_steps(view, q, t, h)
        reach = h if found.fits(t[:, None], h, limit)[0] else 0.5 * h
        if reach == h and _determinant_signs(found.matrix, matrix)[0] < 0.0:
            reach = _reach_of_curve(view, q, t, h, matrix, limit)
        if reach < h:
            h = reach
            if h < shortest:
                curve.stuck = (False, True)
                break
            continue
        x, new, matrix = found.q[:, 0], found.t[:, 0], found.matrix
        if within is not None:
            u, v, low, high = q[within[0]], x[within[0]], *within[1:]
            if ((v > high + 1e-12 or v < low - 1e-12) and len(curve.s) > 1) or (v < low - 1e-9 or v > high + 1e-9):
                _land(view, curve, within[0], high if v > high else low, (u, v), h)
                break
        # A small crank in a large mechanism turns fully within one step's length: what its places move is what counts.
        gap, moved = _pose_distance(view, x, curve.q[0]), _pose_distance(view, x, q)
        if leaving and gap < 2.0 * moved and _close_curve(view, curve, h):
            return curve
        leaving = leaving or gap > 3.0 * moved
        q, t = x, new
        curve.add(x, new, h)
        if curve.s[-1] > LONGEST * size:
            break
        h = min(1.4 * h, 0.05 * size)
    return curve


def _determinant_signs(matrix: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return signs of bordered determinants against that of one other, ``(lanes,)``: negative on another curve."""
    if matrix.shape[1] > matrix.shape[2]:
        return np.linalg.slogdet(np.swapaxes(other, 1, 2) @ matrix)[0]
    return np.linalg.slogdet(matrix)[0] * np.linalg.slogdet(other)[0]


def _reach_of_curve(view: HostView, q: np.ndarray, t: np.ndarray, h: float, matrix: np.ndarray, limit: float) -> float:
    """How far to go of a step that ends with the other orientation.

    All of it where the curve crosses another one: the nearer to the crossing a step begins, the nearer to it, on both
    sides, steps fit. Where two curves only pass each other there is a gap between them, in which no step fits.
    """
    least = (10.0 * limit * view.eq.length) ** 0.5  # poses within the tolerance lead over a smaller gap
    gone, ahead = 0.0, h
    while ahead > least:
        parts = np.linspace(0.0, ahead, 17)
        found = _try_steps(view, q, t, *parts[1:])
        fits, same = found.fits(t[:, None], parts[1:], limit), _determinant_signs(found.matrix, matrix) > 0.0
        on = int(np.argmin(np.append(fits & same, False)))  # so many lie on the curve, one after the other
        other = np.flatnonzero((fits & ~same)[on:])
        left = float(parts[on + other[0] + 1] - parts[on]) if len(other) else np.inf
        if left > 0.9 * ahead:
            return gone or h / 16.0
        if on:
            q, t, gone = found.q[:, on - 1], found.t[:, on - 1], gone + float(parts[on])
        ahead = left
    return h


def _pose_distance(view: HostView, q: np.ndarray, other: np.ndarray) -> float:
    """How far the places and directions of two poses are from each other, a length; angles count turns, and do not."""
    places = len(q) - len(view.plan.topology.scalars)
    return float(np.linalg.norm((view.weights[:, 0] * (q - other))[:places]))


def _land(view: HostView, curve: TracedCurve, index: int, edge: float, values: tuple[float, float], h: float) -> None:
    """End a curve on the edge of a coordinate's range; its values at the last node and after a step are given."""
    (u, v), (q, t), shortest = values, (curve.q[-1], curve.t[-1]), 1e-9 * view.eq.length
    reach = (edge - u) / (v - u) * h if v != u else 0.0
    for _ in range(6):  # secant steps
        at = _try_steps(view, q, t, reach).q[index, 0]
        slope = (at - u) / reach if reach > shortest else 0.0
        reach = reach + (edge - at) / slope if slope else reach
    if reach > shortest:
        found = _try_steps(view, q, t, reach)
        curve.add(found.q[:, 0], found.t[:, 0], reach)


def _close_curve(view: HostView, curve: TracedCurve, h: float) -> bool:
    """Land on the beginning of a curve exactly, if it goes through it; whether it does."""
    size = view.eq.length
    q, t = curve.q[-1], curve.t[-1]
    back = (curve.q[0] - q)[view.plan.unknown] * view.inner
    top = view.plan.topology
    turns = top.mark(top.angles)[view.plan.unknown]
    back[turns] -= 2 * np.pi * size * np.round(back[turns] / (2 * np.pi * size))
    reach = float(back @ t)
    if not 0 <= reach <= 1.2 * h:
        return False
    found = _try_steps(view, q, t, reach)
    if _pose_distance(view, found.q[:, 0], curve.q[0]) >= 1e-6 * size or found.t[:, 0] @ curve.t[0] <= 0.9:
        return False
    curve.add(found.q[:, 0], curve.t[0], reach)  # to the last digit: at a dead point signs of rounding would differ
    curve.closed = True
    return True


class Turns(NamedTuple):
    """Where a coordinate turns back along a curve, in order."""

    q: np.ndarray  # the poses, (N, turns)
    rising: np.ndarray  # whether it grows before, (turns,)
    s: np.ndarray  # arc length from the curve's first pose, (turns,)


def turns_along(view: HostView, curve: TracedCurve, place: int) -> Turns:
    """Find every pose of a curve in which an unknown, given by its place, turns back."""
    q, t, s = np.array(curve.q).T, np.array(curve.t).T, np.array(curve.s)
    limit = float(np.max(view.tolerance(q))) * 10
    at, most = view.plan.unknown, q.shape[1]
    for _ in range(12):  # nodes are added where the coordinate may turn more than once from one to the next
        along = np.sum(t[:, :-1] * np.diff(q[at] * view.inner[:, None]), axis=0)
        a, b = t[place, :-1], t[place, 1:]
        mean = np.diff(q[at[place]] * view.inner[place]) / along
        # Rates by the length along a node's tangent, less a straight line: a parabola of the same mean.
        bump = 1.5 * np.abs(mean - 0.5 * (a + b / np.sum(t[:, :-1] * t[:, 1:], axis=0)))
        bump = np.maximum(bump, np.maximum(np.append(bump[1:], 0.0), np.append(0.0, bump[:-1])))
        smaller = np.minimum(np.abs(a), np.abs(b))
        doubtful = np.where(a * b > 0.0, smaller < 2.0 * bump + 0.25 * np.abs(b - a), np.abs(b - a) < 8.0 * bump)
        doubtful &= (along > 1e-6 * view.eq.length) & (np.maximum(np.abs(a), np.abs(b)) > 1e-9)
        which = np.flatnonzero(doubtful)
        if not 0 < len(which) <= most:
            break
        found = step_along(view, q[:, which], t[:, which], 0.5 * along[which])
        fine = found.fits(t[:, which], 0.5 * along[which], limit)
        which, middle = which[fine] + 1, 0.5 * (s[which] + s[which + 1])[fine]
        q, t = (np.insert(old, which, new[:, fine], axis=1) for old, new in ((q, found.q), (t, found.t)))
        s = np.insert(s, which, middle)
    signs = np.where(np.abs(t[place]) > 1e-9, np.sign(t[place]), 0.0)  # less is rounding
    for k in np.flatnonzero(signs == 0.0):  # exactly at a dead point: as the coordinate came there
        before = signs[:k] if not curve.closed else np.roll(signs[:-1], -k)
        signs[k] = next(iter(before[before != 0.0][::-1]), 0.0)
    which = np.flatnonzero(signs[:-1] * signs[1:] < 0.0)
    return Turns(_turns_between(view, place, q, t, which, limit), signs[which] > 0.0, s[which])


def _turns_between(
    view: HostView, place: int, q: np.ndarray, t: np.ndarray, which: np.ndarray, limit: float
) -> np.ndarray:
    """Find the poses ``(N, turns)`` where a component of the tangent vanishes, each from a node to the next.

    By false position: steps go from the earlier end, which moves on.
    """
    (qa, ta), (qb, tb) = ((q[:, k], t[:, k]) for k in (which, which + 1))
    fa, fb = ta[place].copy(), tb[place].copy()
    part, last = fa / (fa - fb), np.zeros(len(which))
    for _ in range(60):  # at most: some eight do
        whole = np.sum(ta * (qb - qa)[view.plan.unknown] * view.inner[:, None], axis=0)
        found = step_along(view, qa, ta, part * whole)
        rate = found.t[place]
        fine = (found.size <= limit) & (np.sum(ta * found.t, axis=0) > 0.9)
        side = np.where(fine, np.where(rate * fb <= 0.0, 1.0, -1.0), 0.0)  # on which side of the turn
        on, back = side > 0.0, side < 0.0
        # An end that stays for the second time counts for half, so that it moves too.
        fa = np.where(on, rate, np.where(back & (last < 0.0), 0.5 * fa, fa))
        fb = np.where(back, rate, np.where(on & (last > 0.0), 0.5 * fb, fb))
        qa, ta = np.where(on, found.q, qa), np.where(on, found.t, ta)
        qb, tb = np.where(back, found.q, qb), np.where(back, found.t, tb)
        if np.all((whole <= 1e-13 * view.eq.length) | (np.minimum(np.abs(ta[place]), np.abs(tb[place])) <= 1e-15)):
            break
        part, last = np.where(fine, fa / (fa - fb), 0.5 * part), np.where(fine, side, last)
    return np.where(np.abs(ta[place]) < np.abs(tb[place]), qa, qb)
