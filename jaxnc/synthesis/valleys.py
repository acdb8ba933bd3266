"""Designs brought to their ends, those that end in one valley told to be one, and how many starts ended in each."""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from jaxnc.kinematics.motion import Motion
from jaxnc.synthesis.ending import MEETS, Ended, Ending
from jaxnc.synthesis.moved import Moved, moved
from jaxnc.synthesis.problem import Problem

_LOOK = 192  # of the designs that were refined, the best that are looked at
_LIKE = 1e-4  # of the size: designs whose points are so near to each other are one
_LEVEL = 1e-6  # of the error: so are ends whose errors are, and whose points are within
_FLAT = 1e-2  # of the size of each other, since a valley may be flat
_SLOPE = 1e-2  # of the error: so much above an end, and as near, a design that has not ended is on the way there
_ENOUGH = 4  # targets from which on the points that move tell of those that do not
_NOUGHT = 1e-20  # a square that is none
_STAGES = ((4, 1.0, 1), (10, 1.0, 1), (40, 0.5, 3), (120, 0.0, 3), (0, 0.0, 1))
"""Until which iteration (0: as many as asked for) which part of the designs goes on, and at least how many of them."""


class Valley(NamedTuple):
    """A design at its end, and how many starts ended there."""

    one: Moved
    end: Ended
    starts: int


def ended(
    problem: Problem, goal: Problem, rows: Sequence[np.ndarray], most: int, iterations: int, width: int
) -> list[Valley]:
    """Bring the best designs to their ends."""
    some = list(rows[:_LOOK])
    first = _grouped(problem, moved(problem, [x[: problem.count] for x in some]), most)
    ending = Ending(goal, width)
    now = [(lane, n) for lane, (_, n) in zip(ending.begun([some[k] for k, _ in first]), first, strict=True)]
    out: list[Valley] = []
    levels, rates, done = {}, {}, 0
    for until, share, few in _STAGES:
        until = min(until or iterations, iterations)
        some = [lane for lane, _ in now[: max(few, round(share * len(now)))]]
        if some and not share:  # one that would stay behind if it went on winning as it did lately is left there
            ahead = levels[id(some[0])]
            some = [k for k in some if levels[id(k)] - (until - done) * rates[id(k)] <= ahead]
        ending.go(some, until)
        ends = [ending.ended(lane) for lane, _ in now]
        new = {id(lane): ending.level(lane) for lane, _ in now}
        rates = {k: max(levels.get(k, level) - level, 0.0) / max(until - done, 1) for k, level in new.items()}
        levels, done = new, until
        found = different(problem, [(end, n) for end, (_, n) in zip(ends, now, strict=True)])
        out, now = [valley for valley, _ in found], [(now[k][0], valley.starts) for valley, k in found]
    return [_told(valley, iterations) for valley in out]


def _told(valley: Valley, most: int) -> Valley:
    """A design that was given up before it had all its iterations says that it was since others are ahead."""
    end = valley.end
    if end.converged or end.iterations >= most or not end.reason.endswith("iterations"):
        return valley
    return valley._replace(end=dataclasses.replace(end, reason=f"{end.reason}, behind"))


def as_they_are(problem: Problem, rows: Sequence[np.ndarray], most: int) -> list[Valley]:
    """The best of different designs of a search that was interrupted, not brought to their ends."""
    some = list(rows[:_LOOK])
    moves = moved(problem, [x[: problem.count] for x in some])
    first = _grouped(problem, moves, most)
    nan = np.nan
    return [Valley(moves[k], Ended(some[k], nan, nan, nan, nan, 0, "interrupted"), n) for k, n in first]


def different(problem: Problem, ends: Sequence[tuple[Ended, int]]) -> list[tuple[Valley, int]]:
    """One of each valley, best first, and its place among those given with how many starts came there."""
    order = sorted(range(len(ends)), key=lambda k: (ends[k][0].feasibility > MEETS, ends[k][0].square))
    moves = moved(problem, [ends[k][0].row[: problem.count] for k in order])
    out: list[tuple[Valley, int]] = []
    marks: list[np.ndarray] = []
    for k, one in zip(order, moves, strict=True):
        mark, (end, starts) = _mark(problem, one.motion), ends[k]
        for n, ((valley, at), other) in enumerate(zip(out, marks, strict=True)):
            if _same(problem, valley.end, end, float(np.max(np.abs(mark - other))), float(np.max(other))):
                out[n] = valley._replace(starts=valley.starts + starts), at
                break
        else:
            out.append((Valley(one, end, starts), k))
            marks.append(mark)
    return out


def _same(problem: Problem, better: Ended, end: Ended, apart: float, extent: float) -> bool:
    """Whether a design ended, or is about to end, where a better one did, from how far apart their points are."""
    above = end.square - better.square
    if apart <= _LIKE * problem.length:
        return True
    if max(end.square, better.square) <= _NOUGHT:
        return apart <= _LIKE * extent  # exact ones farther apart: see `jaxnc.synthesis.continua`
    if apart > _FLAT * extent:
        return False
    return above <= (_LEVEL if end.converged else _SLOPE) * better.square


def _grouped(problem: Problem, moves: Iterable[Moved], most: int) -> list[tuple[int, int]]:
    """The first of each group of like designs, and how many there are in each."""
    out: list[tuple[int, int]] = []
    marks: list[np.ndarray] = []
    for k, one in enumerate(moves):
        mark = _mark(problem, one.motion)
        like = [n for n, other in enumerate(marks) if np.max(np.abs(mark - other)) <= _LIKE * problem.length]
        if like:
            out[like[0]] = out[like[0]][0], out[like[0]][1] + 1
        elif len(out) < most:
            out.append((k, 1))
            marks.append(mark)
    return out


def _mark(problem: Problem, motion: Motion) -> np.ndarray:
    """What does not change when a design is drawn in another pose, at the targets: the distances of its points.

    From each other, and from the middle of each other's way. Fixed points do not count: pivots follow from the points
    that turn about them, and where on a line a guide is drawn is of no interest. Functions of angles do not know how
    large a mechanism is either.
    """
    return mark_of(problem, np.asarray(motion.q))


def mark_of(problem: Problem, q: np.ndarray) -> np.ndarray:
    """Return the same of poses ``(targets, coordinates)``."""
    top = problem.system.topology
    q = q[:, : len(top.points) * top.dim].reshape(-1, len(top.points), top.dim)
    moving = ~np.array(top.fixed, bool)[: len(top.points) * top.dim].reshape(-1, top.dim).all(axis=1)
    if len(q) >= _ENOUGH and moving.any():
        q = q[:, moving]
        q = np.concatenate([q, np.broadcast_to(q.mean(axis=0), q.shape)], axis=1)
    apart = np.linalg.norm(q[:, :, None] - q[:, None], axis=-1).reshape(-1)
    return apart if problem.unit != "rad" else apart / max(float(apart.mean()), 1e-300) * problem.length
