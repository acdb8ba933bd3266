"""The idea as a start: the mechanism as it is drawn, with the timings, the offset and the turn that suit it best."""

import numpy as np

from jaxnc.synthesis.guidance import MotionGeneration, vector
from jaxnc.synthesis.path import PathGeneration
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.space import aligned

_POSES = 144  # of the idea's curve
_TURNS = 24  # of the frame of a planar body that are tried
_GUESSES = 40  # of unknowns of which no more is known
_MOST = 7  # that are kept


def idea(problem: Problem, rng: np.random.Generator) -> np.ndarray:
    """Starts with the idea's drawing ``(kept, n)``, the first with the problem's own unknowns as they are."""
    if not len(problem.extras.names):
        return problem.start[None]
    rows: list[np.ndarray] = []
    if isinstance(problem, PathGeneration) and (problem.timing is None or problem.offset) and np.ptp(problem.travel):
        rows = [x for _, x in sorted(_timed(problem), key=lambda pair: pair[0])[: _MOST - 1]]
    elif isinstance(problem, MotionGeneration):
        values = problem.inputs(problem.extras.home)
        motion = problem.swept(problem.system, values)
        if np.asarray(motion.converged).all():
            seen = np.asarray(motion.orientation(problem.body))
            rows = [np.concatenate([problem.extras.home[: -problem.own_turns], _turned(problem, seen)])]
    else:
        rows = [x for x in problem.guesses(rng, _GUESSES) if (x != problem.extras.home).any()]
    extra = np.stack([problem.extras.home, *rows])
    return np.concatenate([np.repeat(problem.variables.home[None], len(extra), axis=0), extra], axis=1)


def _timed(problem: PathGeneration) -> list[tuple[float, np.ndarray]]:
    """Squares of errors and own unknowns: the best timings, in order, of poses of the idea's curve."""
    low, high = problem.travel
    values = np.linspace(low, high, _POSES + 1)
    motion = problem.swept(problem.system, values)
    good, place = np.asarray(motion.converged), np.asarray(motion[problem.point])
    cost = np.sum((place - problem.target[:, None]) ** 2, axis=-1)
    seen, tried = None, [(cost, np.zeros(0))]
    if isinstance(problem, MotionGeneration):
        seen = np.asarray(motion.orientation(problem.body))
        if seen.ndim == 1:
            heavy, tried = problem.reach**2, []
            for turn in np.linspace(0.0, 2 * np.pi, _TURNS, endpoint=False):
                off = 4.0 * np.sin(0.5 * (seen - turn - problem.turns[:, None])) ** 2
                tried.append((cost + heavy * off, np.array([turn])))
    found = []
    for square, turn in tried:
        weighted = np.where(good, square * problem.weights[:, None], 1e300)
        for error, timing, at in _timings(problem, weighted, values):
            own = turn
            if isinstance(problem, MotionGeneration) and seen is not None and seen.ndim > 1:
                own = _turned(problem, seen[at])
            found.append((error, np.concatenate([timing, own])))
    return [pair for pair in found if pair[0] < 1e300]


def _turned(problem: MotionGeneration, seen: np.ndarray) -> np.ndarray:
    """How the frame is turned best against a body with these orientations."""
    if seen.ndim == 1:
        return np.array([-np.angle(np.sum(problem.weights * np.exp(1j * (problem.turns - seen))))])
    return vector(aligned(np.einsum("m,mji,mjk->ik", problem.weights, seen, problem.turns)[None])[0])


def _timings(
    problem: PathGeneration, cost: np.ndarray, values: np.ndarray
) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """The best timings from what each pose costs each target: errors, unknowns, and the poses."""
    turn = _POSES if problem.whole else 0
    if problem.timing is not None:
        found = []
        for way in (1.0, -1.0) if problem.either_sense else (1.0,):
            timing, sense = way * problem.timing, np.full(int(problem.either_sense), way)
            first = values[:: 1 if problem.whole else 4] - timing[0]
            at = np.rint((timing + first[:, None] - values[0]) / (values[1] - values[0])).astype(int)
            inside = np.ones(len(at), bool) if turn else ((at >= 0) & (at <= _POSES)).all(axis=1)
            at = at % turn if turn else np.clip(at, 0, _POSES)
            error = np.where(inside, cost[np.arange(len(cost)), at].sum(axis=1), np.inf)
            best = np.argsort(error, kind="stable")[:_MOST]
            found += [(float(error[k]), np.append(first[k], sense), at[k]) for k in best]
        return found
    out, step = [], values[1] - values[0]
    for way in (1, -1):
        table = cost[:, :_POSES] if turn else cost
        error, at = ordered(table[:, ::way], bool(turn))
        at = at if way > 0 else table.shape[1] - 1 - at
        # Those of one pose are put apart a little: the order is a condition.
        u = values[0] + step * (at + way * 0.5 * np.arange(len(at)) / len(at))
        out.append((error, np.append(u[0], np.diff(u)), at % turn if turn else at))
    return out


def ordered(cost: np.ndarray, around: bool) -> tuple[float, np.ndarray]:
    """The least sum of costs, and the places ``(M,)`` of targets in a table, each not before the one before it.

    The cost is that of each target at each place, ``(M, T)``. If the table closes, places are counted on, less than one
    round from the first.
    """
    targets, count = cost.shape
    first = np.arange(count if around else 1)
    place = (first[:, None] + np.arange(count)) % count
    sums = cost[0][place]
    if around:
        sums = np.where(np.arange(count) == 0, sums, np.inf)
    came = np.zeros((targets, *place.shape), np.int16)
    for k in range(1, targets):
        least = np.minimum.accumulate(sums, axis=1)
        came[k] = np.maximum.accumulate(np.where(sums <= least, np.arange(count), 0), axis=1)
        sums = least + cost[k][place]
    best = int(np.argmin(sums))
    row, at = best // count, [best % count]
    for k in range(targets - 1, 0, -1):
        at.append(int(came[k, row, at[-1]]))
    return float(sums[row, at[0]]), first[row] + np.array(at[::-1])
