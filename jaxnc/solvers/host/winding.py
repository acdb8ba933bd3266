"""Whole turns of a driven angle on which nothing else depends: they are not followed one by one."""

from typing import NamedTuple

import numpy as np

from jaxnc.solvers.host.follow import follow
from jaxnc.solvers.host.view import HostView
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.system.precision import farthest

_TURN = 2.0 * np.pi
_SKIPPED = 2.0  # turns in one step: of more, whole ones are left out


class Winding(NamedTuple):
    """Whole turns of the input that need not be followed, and what a turn changes."""

    turns: np.ndarray  # whole turns that are left out up to each value, (T, lanes)
    change: np.ndarray  # of all coordinates in one turn: whole turns of angles, (N, lanes)


def whole_turns(view: HostView, start: np.ndarray, values: np.ndarray) -> Winding | None:
    """Find whole turns of the one input that can be left out of sequences of its values ``(T, known, lanes)``.

    They are those of an angle that nothing else depends on, where a turn leads back to the pose that it began from. A
    branch of one input is closed everywhere if it is closed at the start. None if there are no such turns.
    """
    top, plan = view.plan.topology, view.plan
    if len(plan.driven) != 1:
        return None
    first = len(top.coordinates) - len(top.scalars)
    if plan.driven[0] < first or not top.periodic[plan.driven[0] - first]:
        return None
    angle = values[:, 0]
    steps = np.diff(angle, axis=0, prepend=start[[plan.driven[0]]]) / _TURN
    many = (np.abs(steps) > _SKIPPED) & (np.abs(angle) <= farthest(start))
    lanes = np.flatnonzero(many.any(axis=0))
    if not len(lanes):
        return None
    begin = start[:, lanes]
    target = begin[plan.known]
    target[0] += _TURN
    inner = view.taken(lanes)
    seen = follow(inner, begin, target[None])
    moved = seen.poses[0] - begin
    angles = np.append(np.zeros(first, bool), top.angles)
    change = np.where(angles[:, None], np.round(moved / _TURN), 0.0) * _TURN
    closed = (seen.reached == 1) & ~seen.limit[0] & ~seen.crossed[0]
    closed &= inner.norm(inner.weights, moved - change) <= inner.least.close * inner.eq.length
    if not closed.any():
        return None
    turns, whole = np.zeros_like(angle), np.zeros_like(start)
    turns[:, lanes] = np.cumsum(np.where(many[:, lanes] & closed, np.trunc(steps[:, lanes]), 0.0), axis=0)
    whole[:, lanes] = change
    return Winding(turns, whole)


def rewound(found: PoseBatch, winding: Winding, values: np.ndarray, driven: int) -> PoseBatch:
    """Put the turns that were left out into poses again, ``(N, D T)``; `values` are what was asked for, ``(T, D)``."""
    total, many = values.shape
    reached = found.good.reshape(many, total).T
    last = np.maximum(np.sum(reached, axis=0) - 1, 0)
    at_end = np.where(reached.any(axis=0), winding.turns[last, np.arange(many)], 0.0)
    turns = np.where(reached, winding.turns, at_end).T.reshape(-1)
    q = found.q + np.repeat(winding.change, total, axis=1) * turns
    q[driven] = np.where(found.good & (turns != 0.0), values.T.reshape(-1), q[driven])
    return found._replace(q=q)
