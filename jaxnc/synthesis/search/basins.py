"""Designs at their ends: which of them are one, how many starts came to each, and which belong to one continuum.

Where a problem asks for fewer numbers than its mechanism has, exact designs are not alone. At an exact design the
directions in which all unknowns may go without an error of first order are the null space of the errors' derivatives;
directions that only redraw the same mechanism do not count. Two designs belong to one continuum if one can be changed
into the other with all targets met on the way. That is tried step by step, each step projected onto the exact designs.
Inequalities and bounds are not looked at on the way; they cut pieces out of a continuum.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxnc.synthesis.design import Design
from jaxnc.synthesis.evaluate import Evaluator, MovedDesign, move_designs, solve_changes
from jaxnc.synthesis.problem import Problem, with_fields
from jaxnc.synthesis.pytree import take
from jaxnc.synthesis.search.goal import Goal
from jaxnc.synthesis.search.sqp import LANES, MEETS, End, Sqp
from jaxnc.system.identity import Thing

# -- ends --------------------------------------------------------------------------------------------------------------

_LOOK = 192  # of the designs that were refined, the best that are looked at
_LIKE = 1e-4  # of the size: designs whose points are so near to each other are one
_STAGES = ((4, 1.0, 1), (10, 1.0, 1), (40, 0.5, 3), (120, 0.0, 3), (0, 0.0, 1))
"""Until which iteration (0: as many as asked for) which part of the designs goes on, and at least how many of them."""


class Basin(NamedTuple):
    """A design at its end, and how many starts ended there."""

    one: MovedDesign
    end: End
    starts: int


def bring_to_ends(
    problem: Problem,
    goal: Goal,
    rows: Sequence[np.ndarray],
    most: int,
    iterations: int,
    width: int,
    until: float = np.inf,
) -> list[Basin]:
    """Bring the best designs to their ends, or as far as they come until a time."""
    some = list(rows[:_LOOK])
    groups = _group_designs(problem, move_designs(problem, [x[: problem.count] for x in some]))[:most]
    ending = Sqp(goal, width, until)
    now = [(lane, len(g)) for lane, g in zip(ending.begin([some[g[0]] for g in groups]), groups, strict=True)]
    out: list[Basin] = []
    levels, rates, done = {}, {}, 0
    for until, share, few in _STAGES:
        until = min(until or iterations, iterations)
        some = [lane for lane, _ in now[: max(few, round(share * len(now)))]]
        if some and not share:  # one that would stay behind if it went on winning as it did lately is left there
            ahead = levels[id(some[0])]
            some = [k for k in some if levels[id(k)] - (until - done) * rates[id(k)] <= ahead]
        ending.go(some, until)
        ends = [ending.end_of(lane) for lane, _ in now]
        new = {id(lane): ending.level(lane) for lane, _ in now}
        rates = {k: max(levels.get(k, level) - level, 0.0) / max(until - done, 1) for k, level in new.items()}
        levels, done = new, until
        found = distinct_basins(problem, [(end, n) for end, (_, n) in zip(ends, now, strict=True)])
        out, now = [basin for basin, _ in found], [(now[k][0], basin.starts) for basin, k in found]
    return [_behind(basin, iterations) for basin in out]


def _behind(basin: Basin, most: int) -> Basin:
    """Say of a design that was given up early that others are ahead of it."""
    end = basin.end
    if end.converged or end.iterations >= most or not end.reason.endswith("iterations"):
        return basin
    return basin._replace(end=dataclasses.replace(end, reason=f"{end.reason}, behind"))


def as_they_are(problem: Problem, rows: Sequence[np.ndarray], most: int) -> list[Basin]:
    """Select the best different designs of an interrupted search, not brought to their ends."""
    some = list(rows[:_LOOK])
    moves = move_designs(problem, [x[: problem.count] for x in some])
    groups = _group_designs(problem, moves)[:most]
    return [Basin(moves[g[0]], End.unknown(some[g[0]], np.nan, "interrupted"), len(g)) for g in groups]


def distinct_basins(problem: Problem, ends: Sequence[tuple[End, int]]) -> list[tuple[Basin, int]]:
    """Select the best end of each basin, best first, with its place among those given."""
    order = sorted(range(len(ends)), key=lambda k: (ends[k][0].feasibility > MEETS, ends[k][0].square))
    moves = move_designs(problem, [ends[k][0].row[: problem.count] for k in order])
    found = [ends[k][0] for k in order]
    out = []
    for first, *others in _group_designs(problem, moves, found):
        starts = sum(ends[order[k]][1] for k in (first, *others))
        out.append((Basin(moves[first], found[first], starts), order[first]))
    return out


def _group_designs(
    problem: Problem, moves: Sequence[MovedDesign], ends: Sequence[End] | None = None
) -> list[list[int]]:
    """Group designs that are alike, or whose ends are in one basin; each joins the first group that it suits."""
    groups: list[list[int]] = []
    marks = [mark_of(problem, np.asarray(one.motion.q)) for one in moves]
    for k, mark in enumerate(marks):
        for group in groups:
            first = group[0]
            apart, extent = float(np.max(np.abs(mark - marks[first]))), float(np.max(marks[first]))
            alike = apart <= _LIKE * problem.length
            if alike or (ends is not None and _in_one_basin(ends[first], ends[k], apart, extent)):
                group.append(k)
                break
        else:
            groups.append([k])
    return groups


def _in_one_basin(better: End, end: End, apart: float, extent: float) -> bool:
    """Tell whether a design ended, or is about to end, where a better one did, from how far apart their points are."""
    if max(end.square, better.square) <= 1e-20:  # a square that is none
        return apart <= _LIKE * extent  # exact ones farther apart: see `jaxnc.synthesis.search.basins`
    if apart > 1e-2 * extent:  # 1e-2 of the size: a basin may be flat
        return False
    # ends whose errors differ by 1e-6 are one, and what has not ended, 1e-2 above, is on the way there
    return end.square - better.square <= (1e-6 if end.converged else 1e-2) * better.square


def mark_of(problem: Problem, q: np.ndarray) -> np.ndarray:
    """Distances of a design's points in its poses at the targets ``(targets, coordinates)``, however it is drawn.

    From each other, and from the middle of each other's way. Fixed points do not count: pivots follow from the points
    that turn about them, and where on a line a guide is drawn is of no interest. Functions of angles do not know how
    large a mechanism is either, nor where points are that only ride on a body.
    """
    top = problem.system.topology
    q = q[:, : len(top.points) * top.dim].reshape(-1, len(top.points), top.dim)
    moving = ~np.array(top.fixed, bool)[: len(top.points) * top.dim].reshape(-1, top.dim).all(axis=1)
    if problem.unit == "rad":
        rows = [pair for block in top.blocks for pair in zip(block.points, block.owners, strict=True)]
        asked = {p for points, owners in rows for p in points if any(one.thing is not Thing.BODY for one in owners)}
        bodies = np.bincount([p for body in top.bodies for p in body.points], minlength=len(top.points))
        counts = [p for p in range(len(top.points)) if bodies[p] != 1 or p in asked]
        q, moving = q[:, counts], np.asarray(moving)[counts]
    if len(q) >= 4 and moving.any():  # of 4 targets and more the points that move tell of those that do not
        q = q[:, moving]
        q = np.concatenate([q, np.broadcast_to(q.mean(axis=0), q.shape)], axis=1)
    apart = np.linalg.norm(q[:, :, None] - q[:, None], axis=-1).reshape(-1)
    return apart if problem.unit != "rad" else apart / max(float(apart.mean()), 1e-300) * problem.length


# -- continua of exact designs -----------------------------------------------------------------------------------------

_NULL = 1e-9  # of the largest singular value: a direction that changes the errors by less does not change them
_THERE = 1e-6  # of the distance at the beginning: so near, the other design is reached


class _Look(NamedTuple):
    """Designs, their errors and equalities, the poses at the targets, and the derivatives of both."""

    x: np.ndarray  # (lanes, n)
    errors: np.ndarray  # (lanes, m), in parts of the size
    slopes: np.ndarray  # (lanes, m, n), by unknowns in parts of their scales
    q: np.ndarray  # (lanes, coordinates), in parts of the size
    changes: np.ndarray  # (lanes, coordinates, n)
    good: np.ndarray  # (lanes,)


def list_once(problem: Problem, designs: Sequence[Design]) -> list[Design]:
    """Keep of each continuum of exact designs only the best, in the order of ranks."""
    exact = [design for design in designs if design.exact]
    if not exact:
        return list(designs)
    eye = _Continua(problem)
    looks = eye.look(np.stack([design.x for design in exact]))
    freedom = {id(d): eye.freedom(take(looks, [k])) if looks.good[k] else 0 for k, d in enumerate(exact)}
    free, best = [design for design in exact if freedom[id(design)]], {}
    for group in eye.group([design.x for design in free]):
        first, starts = free[group[0]], sum(free[k].starts for k in group)
        best[id(first)] = dataclasses.replace(first, starts=starts, freedom=freedom[id(first)])
    return [best.get(id(d), d) for d in designs if id(d) in best or not freedom.get(id(d), 0)]


class _Continua:
    """A problem whose exact designs are compared."""

    def __init__(self, problem: Problem):
        if problem.poses:  # over the range: nobody asks for inequalities here
            problem = with_fields(problem, conditions=tuple(c for c in problem.conditions if c.equality))
        self.problem, self.evaluate, self.scale = problem, Evaluator(Goal(problem)), problem.scale
        self.rows = np.concatenate([np.ones(problem.shape[0], bool), problem.equalities])

    def look(self, x: np.ndarray) -> _Look:
        """Look at designs ``(lanes, n)``."""
        problem, n = self.problem, x.shape[1]
        errors, conditions, slopes, ok = self.evaluate(x, np.zeros((len(x), 0)), way="close")
        values = np.concatenate([errors, conditions], axis=1)[:, self.rows]
        q, changes, top = [], [], problem.system.topology
        points = len(top.points) * top.dim  # coordinates of points come first
        for part in solve_changes(problem, x, 0, "close", LANES):
            count = len(part.q)
            moved = np.zeros((count, n, *part.q.shape[1:]))
            if part.changes is not None:
                moved[:] = part.changes * self.scale[:, None, None]
            q.append(part.q[..., :points].reshape(count, -1))
            changes.append(moved[..., :points].reshape(count, n, -1).transpose(0, 2, 1))
        size = problem.length
        poses, moves = np.concatenate(q) / size, np.concatenate(changes) / size
        good = (
            ok & np.isfinite(values).all(axis=1) & np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(poses).all(axis=1)
        )
        return _Look(x, values, slopes[:, self.rows], poses, moves, good & np.isfinite(moves).all(axis=(1, 2)))

    def freedom(self, look: _Look) -> int:
        """Count the directions in which a design can change, without those that only redraw it."""
        top = self.problem.system.topology
        free = _null_space(look.slopes[0])
        moves = look.changes[0] @ free
        # 1e-6 of the largest change of the points by an unknown: what moves them by less redraws the mechanism
        largest, least = np.max(np.abs(moves), initial=0.0), 1e-6 * np.max(np.abs(look.changes[0]))
        if not largest > least:
            return 0
        size = self.problem.length
        shape = (-1, len(top.points) * top.dim)
        q, h = look.q[0] * size, 1e-6 * size / largest  # a difference is taken over 1e-6 of the points' coordinates
        steps = [h * size * move for move in moves.T]
        marks = [mark_of(self.problem, (q + way * s).reshape(shape)) for s in steps for way in (1, -1)]
        slopes = np.stack(
            [(a - b) / (2 * h * size * size) for a, b in zip(marks[::2], marks[1::2], strict=True)], axis=1
        )
        values = np.linalg.svd(slopes, compute_uv=False)
        return int(np.sum(values > least))

    def group(self, xs: Sequence[np.ndarray]) -> list[list[int]]:
        """Group exact designs by continuum, as numbers; the first of each group comes first."""
        groups = [[k] for k in range(len(xs))]
        if len(xs) < 2:
            return groups
        rows, idle = np.stack(xs), 0
        q = self.look(rows).q
        far = np.linalg.norm(q[:, None] - q, axis=2)
        # 2 rounds of looking for ways between groups of designs, without one being found
        while len(groups) > 1 and idle < 2:
            # Each group looks for ways to the nearest design of another one, and to those of the largest other one.
            for group in groups:
                far[np.ix_(group, group)] = np.inf
            pairs = set()
            for group in groups:
                most = max((other for other in groups if other is not group), key=len)
                for others, count in ((list(range(len(xs))), 1), (most, 2)):  # 1 and 2 ways in each round
                    part = far[np.ix_(group, others)]
                    nearest = np.argsort(part, axis=None, kind="stable")[:count]
                    ways = zip(*np.unravel_index(nearest, part.shape), strict=True)
                    pairs |= {(group[a], others[b]) for a, b in ways if part[a, b] < np.inf}
            if not pairs:
                break
            begin, end = np.array(sorted(pairs)).T
            found, far[begin, end] = self.find_connected(rows[begin], rows[end]), np.inf
            idle = 0 if found.any() else idle + 1
            for a, b in zip(begin[found], end[found], strict=True):
                one, other = (next(group for group in groups if k in group) for k in (a, b))
                if one is not other:
                    groups = sorted([*(group for group in groups if group not in (one, other)), sorted(one + other)])
        return groups

    def find_connected(self, x: np.ndarray, goals: np.ndarray) -> np.ndarray:
        """Find out for each of many exact designs whether it can be changed into its goal with all targets met."""
        goal, now = self.look(goals), self.look(x)
        far = np.linalg.norm(goal.q - now.q, axis=1)
        # 0.3 of the size is the longest way of a point in the first step
        begun, reach = far.copy(), np.full(len(x), 0.3)
        there = now.good & goal.good & (far <= _THERE)
        live, history = now.good & goal.good & ~there, [far.copy()]
        for step in range(100):  # steps at most, from one design to another
            lanes = np.flatnonzero(live)
            if not len(lanes):
                break
            moves = np.stack([_continuum_step(take(now, k), goal.q[k], reach[k]) for k in lanes])
            new = self.look(now.x[lanes] + moves * self.scale)
            left = np.linalg.norm(goal.q[lanes] - new.q, axis=1)
            off, was = (np.sqrt(np.mean(part**2, axis=1)) for part in (new.errors, now.errors[lanes]))
            # 1e-3 of the size are errors that are allowed on the way
            fine = new.good & (off <= np.maximum(1e-3, 0.5 * was)) & ((left < far[lanes]) | (off < 0.5 * was))
            took = lanes[fine]
            for part, fresh in zip(now, new, strict=True):
                part[took] = fresh[fine]
            far[took] = left[fine]
            reach[lanes] = np.where(fine, np.minimum(1.6 * reach[lanes], 4.0), 0.3 * reach[lanes])
            there[took] = far[took] <= _THERE * np.maximum(begun[took], 1.0)
            history.append(far.copy())
            live &= ~there & (reach > 1e-9)
            patience = 10  # steps: what has not come nearer by a tenth in so many does not arrive
            if step >= patience:
                live &= far <= 0.9 * history[-1 - patience]
        return there


def _continuum_step(look: _Look, goal: np.ndarray, reach: float) -> np.ndarray:
    """Step back to the exact designs, and among them towards the goal: changes of the unknowns."""
    back = -np.linalg.lstsq(look.slopes, look.errors, rcond=_NULL)[0]
    free = _null_space(look.slopes)
    along = look.changes @ free
    part = np.linalg.lstsq(along, goal - look.q - look.changes @ back, rcond=1e-8)[0]
    move = free @ part
    longest = np.max(np.abs(look.changes @ move), initial=0.0)
    return back + move * min(1.0, reach / max(longest, 1e-300))


def _null_space(slopes: np.ndarray) -> np.ndarray:
    """Directions ``(n, k)`` in which the errors do not change, of unknowns that count alike."""
    sizes = np.linalg.norm(slopes, axis=0)
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    _, values, rows = np.linalg.svd(slopes / sizes)
    rank = int(np.sum(values > _NULL * np.max(values, initial=0.0)))
    free = rows[rank:].T / sizes[:, None]
    return np.linalg.qr(free)[0] if free.size else free
