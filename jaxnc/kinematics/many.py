"""Large batches of one design outside of traced code: the batched kernel first, the robust walk for what it leaves.

The two are compiled apart, so that whoever does not need the second does not wait for it.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.compiling import jit
from jaxnc.kinematics.analysis import analyse, turns_to
from jaxnc.kinematics.columns import Columns
from jaxnc.solvers import batch
from jaxnc.solvers.newton import largest, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.walk import walks
from jaxnc.status import Status
from jaxnc.system.equations import Equations, guards
from jaxnc.system.precision import limits
from jaxnc.types import Array

_OPEN = -1  # status of a lane that is not decided yet
_CLOSER = 8  # times that a table is laid anew: closer to where the branch ends, or beyond a change point
_MARGIN = 1e-4  # of the way to its end: lanes that are closer to it are walked to
_VERY_MANY = 20_000  # lanes from which a faster kernel pays for a longer compilation
_GROUP = 64  # lanes that are walked to together


class Lanes(NamedTuple):
    """Solved lanes: their poses, and what became of each."""

    poses: Columns
    status: Any
    size: Any
    pivots: Any


def suits(view: Plan, given: Any, values: Any) -> bool:
    """Whether a batch is large enough, outside of traced code, and of a kind that there is a table for."""
    leaves = jax.tree.leaves((given, values))
    return values.shape[0] >= batch.LEAST and batch.suits(view) and not any(isinstance(x, Tracer) for x in leaves)


def solve(view: Plan, eq: Equations, q0: Array, values: Array, whole: bool = False) -> Lanes | None:
    """Solve all lanes.

    Args:
        view: what is solved for.
        eq: the equations.
        q0: the start pose.
        values: driven coordinates ``(lanes, k)``.
        whole: give None unless all lanes are reached (what then becomes of a sequence depends on its order).

    Returns:
        The lanes.
    """
    found, status, all_good = _first(view, eq, q0, values)
    places = tuple(int(c) for c in (*view.unknown, *view.known[: values.shape[1]]))
    lanes = Lanes(Columns(q0, found.x, values, places), status, found.size, found.pivots)
    if bool(all_good):
        return lanes
    if whole:
        return None
    lanes = jax.tree.map(np.array, lanes)  # which may be written to
    if values.shape[1] == 1:
        asked = np.asarray(values)[:, 0]
        near = asked - 2 * np.pi * np.asarray(turns_to(view, q0, values))[:, 0]
        for side in (-1, 1):
            _to_the_end(view, eq, q0, near, side, lanes)
        # The shorter way round may be closed and the longer one open: a rocker may travel more than half a turn.
        again = (lanes.status == int(Status.DID_NOT_ASSEMBLE)) & (asked != near)
        if again.any():
            lanes.status[again], lanes.poses.driven[again] = _OPEN, asked[again, None]
            near = np.where(again, asked, near)
            for side in (-1, 1):
                _to_the_end(view, eq, q0, near, side, lanes)
    rest = np.flatnonzero(lanes.status == _OPEN)
    for first in range(0, len(rest), _GROUP):
        at = rest[np.minimum(np.arange(first, first + _GROUP), len(rest) - 1)]
        q, _, state, size, pivots = analyse(view, "lanes", eq, q0, values[at], ())
        _write(lanes, at, np.asarray(q), np.asarray(state), np.asarray(size), np.asarray(pivots))
    return jax.tree.map(jnp.asarray, lanes)


def _write(lanes: Lanes, at: np.ndarray, q: np.ndarray, state: Any, size: Any, pivots: Any) -> None:
    poses, solved = lanes.poses, len(lanes.poses.lanes)
    for column, c in zip(poses.lanes, poses.places, strict=False):
        column[at] = q[..., c]
    poses.driven[at] = q[..., list(poses.places[solved:])]
    lanes.status[at], lanes.size[at], lanes.pivots[at] = state, size, pivots


def _first(view: Plan, eq: Equations, q0: Array, values: Array) -> tuple[batch.Batch, Array, Array]:
    """`_all_lanes`, compiled to run fast where they are very many, in less time where they are not."""
    return (_fast if values.shape[0] >= _VERY_MANY else _brief)(view, eq, q0, values)


def _all_lanes(view: Plan, eq: Equations, q0: Array, values: Array) -> tuple[batch.Batch, Array, Array]:
    """All lanes by the batched kernel: lanes, status, and whether none is still open."""
    begin = q0.at[view.fixed].set(eq.home[view.fixed])
    found = batch.solve(view, eq, begin, values)
    sound = (largest(view.residual(eq, begin)) <= 1e3 * tolerance(eq, begin)) & (eq.misfit <= limits(q0).misfit)
    sound = sound & jnp.all(guards(eq, begin)[1] > 0.0)
    status = jnp.where(found.good & sound, np.int32(Status.CONVERGED), np.int32(_OPEN))
    return found, status, sound & jnp.all(found.good)


_fast = jax.jit(_all_lanes, static_argnums=0)
_brief = jit(_all_lanes, static_argnums=0)


@functools.partial(jit, static_argnums=0)
def _end(view: Plan, eq: Equations, q: Array, goal: Array) -> tuple[Array, Array, Array]:
    """How far a branch goes towards a value of a single input: part of the way, last pose, whether it ends there."""
    at = q[view.known]
    way = at.at[0].set(goal)
    seen = walks(view, eq, q[None], way[None, None], jnp.ones(1, int), jnp.ones((), int), shared=True)
    return jnp.where(seen.reached[0] > 0, 1.0, seen.part[0]), seen.last[0], ~seen.exhausted[0]


def _to_the_end(view: Plan, eq: Equations, q0: Array, near: np.ndarray, side: int, lanes: Lanes) -> None:
    """Decide the open lanes of a single input on one side of the start pose, in place."""
    c = int(view.known[0])
    origin = float(q0[c])

    def left():
        return np.flatnonzero((lanes.status == _OPEN) & (side * (near - origin) > 0))

    open_ = left()
    if not len(open_):
        return
    far = float(side * np.max(side * near[open_]))
    part, last, sure = _end(view, eq, q0, jnp.asarray(far))
    end = origin + float(part) * (far - origin)
    if float(part) < 1.0 and bool(sure):
        # What lies clearly beyond the end of the branch is not reached; its pose is the last one there is.
        beyond = open_[side * (near[open_] - end) > _MARGIN * abs(end - origin)]
        size, pivots = lanes.size[beyond], lanes.pivots[beyond]
        _write(lanes, beyond, np.asarray(last), int(Status.DID_NOT_ASSEMBLE), size, pivots)
    for _ in range(_CLOSER):
        open_ = left()
        if len(open_) <= _GROUP:
            return
        # Where the branch ends the table is too coarse: a finer one, from the last pose that was right.
        good = np.flatnonzero((lanes.status == 0) & (side * (near - origin) >= 0))
        found = 0
        if len(good):
            best = good[np.argmax(side * near[good])]
            start = np.array(q0)
            start[view.unknown] = [column[best] for column in lanes.poses.lanes]
            start[c] = near[best]
            found = _from(view, eq, start, near, open_[side * (near[open_] - near[best]) > 0], lanes)
        if not found:
            # From there nothing is reached directly, but a walk may get on: over a change point, or the long way round.
            middle = float(np.sort(near[open_])[len(open_) // 2])
            part, last, _ = _end(view, eq, q0, jnp.asarray(middle))
            if float(part) < 1.0:
                return
            found = _from(view, eq, np.array(last), near, open_[np.abs(near[open_] - middle) < np.pi], lanes)
        if not found:
            return


def _from(view: Plan, eq: Equations, start: np.ndarray, near: np.ndarray, some: np.ndarray, lanes: Lanes) -> int:
    """Solve some lanes of a single input by a table that begins at another pose, in place; how many were right."""
    if not len(some):
        return 0
    size = batch.LEAST if len(some) <= batch.LEAST else len(near)
    padded = near[some[np.minimum(np.arange(size), len(some) - 1)]]
    found = _again(view, eq, jnp.asarray(start), jnp.asarray(padded)[:, None], jnp.asarray(len(some)))
    right = np.asarray(found.good)[: len(some)]
    at = some[right]
    for column, new in zip(lanes.poses.lanes, found.x, strict=True):
        column[at] = np.asarray(new)[: len(some)][right]
    lanes.status[at] = 0
    lanes.size[at] = np.asarray(found.size)[: len(some)][right]
    lanes.pivots[at] = np.asarray(found.pivots)[: len(some)][right]
    return int(right.sum())


@functools.partial(jit, static_argnums=0)
def _again(view: Plan, eq: Equations, q: Array, near: Array, count: Array) -> batch.Batch:
    return batch.solve(view, eq, q, near, count)
