"""Analyses of few poses in NumPy: what `jaxnc.kinematics.traced` does by XLA for many, with nothing compiled.

`solve_sequences` and `solve_lanes` take many designs at once and touch no JAX, so that a callback may call them.
"""

import functools
import weakref
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import numpy as np
from jax.core import Tracer

from jaxnc.records import by_identity
from jaxnc.solvers import host
from jaxnc.solvers.assembly import sample_poses, to_host
from jaxnc.solvers.host.view import largest_of_lanes
from jaxnc.solvers.plan import Plan, by_lu, unwind
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.status import Status
from jaxnc.system.equations import Equations
from jaxnc.system.host import HostEquations, from_jax
from jaxnc.system.precision import farthest, limits
from jaxnc.system.system import System
from jaxnc.types import Numbers

_R = TypeVar("_R")
_asked: weakref.WeakKeyDictionary[Plan, float] = weakref.WeakKeyDictionary()  # what batches were worth so far


def suits_host(view: Plan, method: str, *given: Any) -> bool:
    """Say whether the host finds poses: they are few, or of a large system, and nothing is traced.

    This is the one rule for what XLA compiles. It compiles a batch for which NumPy would take longer than a quarter of
    a second, and batches of hundreds of poses that are asked for again: each is taken to be worth a fifth of a second
    of compiling, or as much as NumPy takes for it. A pose takes NumPy two microseconds and 0.15 for each element of the
    Jacobian: 57,000 poses of a four-bar, 2,300 of a MacPherson strut; ten times as much where each of several inputs is
    a lane of its own, so that every pose is followed to. More unknowns than can be written out, whose sparse matrices
    SciPy factorises, are always the host's: XLA takes longer for a pose.

    `given` are values ``(T, driven)`` of the inputs, and whatever else the poses are found from.
    """
    if any(isinstance(x, Tracer) for x in jax.tree.leaves(given)):
        return False
    count = len(given[0])
    if not is_few(view, method, count):
        return False
    if count < 512 or method == "guess" or is_only_hosts(view, method):  # 512 poses may be worth compiling
        return True
    # each batch is worth 0.2 seconds of compiling at least: who has asked twice will ask again
    _asked[view] = _asked.get(view, 0.0) + max(_seconds(view, method, count), 0.2)
    return _asked[view] <= 0.1 * len(view.unknown)  # seconds of compiling for each unknown


def suits_slopes(view: Plan, method: str, values: Any, variables: int) -> bool:
    """Say whether the host finds poses and their derivatives by so many variables of a design, as `suits_host` does.

    A derivative of a pose takes NumPy 0.16 microseconds for each unknown. Who has asked for as many as compiling takes
    will ask again, and is better off with a gradient that goes back through compiled code.
    """
    # seconds for each unknown of a derivative of a pose
    seconds = 1.6e-7 * len(values) * variables * len(view.unknown)
    if seconds > 0.25 or not suits_host(view, method, values):
        return False
    _asked[view] = _asked.get(view, 0.0) + seconds
    return _asked[view] <= 0.1 * len(view.unknown)  # seconds of compiling for each unknown


def is_few(view: Plan, method: str, count: int) -> bool:
    """Say whether so many poses are few for the host; see `suits_host`."""
    # seconds of NumPy's time: what would take longer is worth compiling
    return is_only_hosts(view, method) or _seconds(view, method, count) <= 0.25


def is_only_hosts(view: Plan, method: str) -> bool:
    """Say whether poses are the host's however many there are."""
    if view.large or method == "guess" or not by_lu(view):
        return view.large
    from jaxnc.solvers.fill import can_fill  # with all that XLA needs, and the host does not

    return not can_fill(view)


def _seconds(view: Plan, method: str, count: int) -> float:
    """Estimate the time that NumPy takes for poses."""
    # seconds for a pose of the smallest mechanism, and for each element of its Jacobian
    lane = 2e-6 + 1.5e-7 * len(view.rows) * len(view.unknown)
    if by_lu(view) and method != "guess":
        # 2e-5 seconds for each unknown of a pose that is followed to by sparse LU
        return count * 2e-5 * len(view.unknown)
    if method == "guess" or (method == "lanes" and len(view.driven) > 1):
        # times as long takes a pose that is assembled from a guess, or followed to
        lane *= 50.0 if method == "guess" else 10.0
    return count * lane


def analyse_on_host(
    view: Plan, method: str, eq: Equations, q0: Numbers, values: Numbers, orders: tuple[Numbers, ...]
) -> PoseBatch:
    """Solve for poses and their rates; arguments and result as of `jaxnc.kinematics.traced.analyse_traced`."""
    known, start, values = to_host(eq), np.asarray(q0), np.asarray(values)
    inner = host.view_of(view, known) if orders else None
    if method == "guess":
        found = solve_nearest(view, known, start, values)
    elif method == "lanes":
        found = solve_lanes(view, known, start[None], values, np.zeros(len(values), int))
    else:
        found = solve_sequences(view, known, start[None], values[None], inner=inner).each(lambda x: x[0])
    rates: tuple[np.ndarray, ...] = ()
    if inner is not None:
        still = np.zeros((len(values), len(view.held)), known.dtype)
        given = [np.concatenate([np.asarray(o, known.dtype), still], axis=1) for o in orders]
        rates = rates_of_poses(inner, found.q, given, found.status == int(Status.CONVERGED))
    return found._replace(rates=rates)


def rates_of_poses(
    inner: host.HostView, q: np.ndarray, orders: Sequence[np.ndarray], good: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Time derivatives of all coordinates at poses ``(T, N)`` by those of the known, ``(T, k)``; zero if not `good`."""
    rates = tuple(np.zeros_like(q) for _ in orders)
    if good.any():
        with np.errstate(all="ignore"):
            terms = host.pose_rates(inner, q[good].T, [o[good].T for o in orders])
        for out, term in zip(rates, terms, strict=True):
            out[good] = term.T
    return rates


def solve_sequences(
    view: Plan,
    eq: HostEquations,
    start: np.ndarray,
    values: np.ndarray,
    first: np.ndarray | None = None,
    inner: host.HostView | None = None,
) -> PoseBatch:
    """Solve for poses of sequences of inputs, each in order along its branch: many designs in lockstep, NumPy alone.

    Args:
        view: what is solved for.
        eq: the equations of one design, or of D designs.
        start: poses to begin from, ``(D, N)`` or one for all: the drawings, or a pose at the value before the first
            that is wanted.
        values: driven coordinates, ``(D, T, k)``.
        first: which pose of each sequence is the first that is wanted, ``(D,)``; where it is zero, the drawing's turn
            of a driven angle is the nearest. Zero if not given.
        inner: what is solved for, on the host, if it is wanted afterwards: it knows the inverses of the last poses.

    Returns:
        The poses ``(D, T, N)``; what they are before the first one says nothing.
    """
    designs, total = values.shape[:2]
    first = np.zeros(designs, int) if first is None else np.minimum(first, total - 1)
    each, place = np.arange(designs)[:, None], np.arange(total)
    values = values[each, np.minimum(place + first[:, None], total - 1)]
    with np.errstate(all="ignore"):
        fresh, begin = _grounded(view, eq, np.broadcast_to(start, (designs, start.shape[-1])))
        inner = inner or fresh
        known = np.concatenate([values.transpose(1, 2, 0), _held_values(view, begin, total)], axis=1)
        assembled, singular = _judge_starts(inner, begin)
        begun, known = _stay_where(view, singular, begin[view.known], known)
        turns = np.where(first[:, None] > 0, 0.0, _count_turns(view, begin, known[0, : values.shape[2]].T))
        turned = np.array(begin)
        turned[view.known[: turns.shape[1]]] += 2 * np.pi * turns.T
        found = host.solve_sequences(inner, turned, known, total - first)
        # The nearest turn may be closed, and the one that the drawing is on open.
        again = np.flatnonzero(~found.good[::total] & turns.any(axis=1))
        if len(again):
            other = host.solve_sequences(inner.select(again), begin[:, again], known[..., again], total - first[again])
            found.put((..., (again[:, None] * total + place).reshape(-1)), other)
        way = inner.weights[view.known] * np.diff(np.concatenate([turned[view.known][None], known]), axis=0)
        longest = np.abs(way).max(axis=1, initial=0.0).T * inner.least.smallest
        # 1e-2 of the size: a longer step is none of the shortest, at which a branch ends
        found.exhausted[(longest > 1e-2 * np.reshape(inner.eq.length, (-1, 1))).reshape(-1)] = True
        lost = _lost_in_order(found, assembled, total)
        status = _status(inner, begin, found, lost, np.repeat(each[:, 0], total), begun.T.reshape(-1))
    back = (each * total + np.maximum(place - first[:, None], 0)).reshape(-1)
    told = PoseBatch(found.q.T, found.size, found.conditioning, status=status)
    return told.each(lambda x: x[back].reshape(designs, total, *x.shape[1:]))


def solve_lanes(view: Plan, eq: HostEquations, start: np.ndarray, values: np.ndarray, which: np.ndarray) -> PoseBatch:
    """Poses ``(L, N)`` of independent inputs, each on the straight way from a start pose: NumPy alone.

    `which` is the start pose (and the design, where they are many) of each value, ``(L,)``; values are ``(L, k)``,
    start poses ``(D, N)``.
    """
    with np.errstate(all="ignore"):
        inner, begin = _grounded(view, eq, start)
        values = np.asarray(values, inner.eq.dtype)
        known = np.concatenate([values, _held_values(view, begin, 1)[0][:, which].T], axis=1)
        singular = _judge_starts(inner, begin)[1][which]
        begun, known = (x.T for x in _stay_where(view, singular, begin[view.known][:, which], known.T))
        turns = np.zeros_like(known)
        turns[:, : values.shape[1]] = _count_turns(view, begin[:, which], known[:, : values.shape[1]])
        found = host.solve_scattered(inner, begin, unwind(known, turns), which)
        # The shorter way round may be closed and the longer one open: a rocker may travel more than half a turn.
        again = np.flatnonzero(~found.good & turns.any(axis=1))
        if len(again):
            other = host.solve_scattered(inner, begin, known[again], which[again])
            turns[again] = 0.0
            found.put((..., again), other)
        found.q[view.known] = np.where(found.good, known.T, found.q[view.known] + 2 * np.pi * turns.T)
        lost = np.where(found.exhausted, int(Status.TOO_FAR), int(Status.DID_NOT_ASSEMBLE))
        status = _status(inner, begin, found, lost, which, begun)
    return PoseBatch(np.ascontiguousarray(found.q.T), found.size, found.conditioning, status=status)


def end_of_way(view: Plan, eq: HostEquations, start: np.ndarray, values: np.ndarray, reached: np.ndarray) -> np.ndarray:
    """Find the last pose ``(N,)`` on the straight way from a start pose to inputs ``(k,)``, of which one was `reached`.

    Steps are parts of a way: of one that leads far beyond its end, a shorter one that does so too tells it better.
    """
    if not len(values):
        return reached
    base = start[view.known[: len(values)]]
    ways = base + (values - base) * 0.5 ** np.arange(48.0)[:, None]
    found = solve_lanes(view, eq, start[None], ways, np.zeros(len(ways), int))
    short = np.flatnonzero(found.status != int(Status.CONVERGED))
    return found.q[short[-1]] if len(short) else reached


def solve_nearest(view: Plan, eq: HostEquations, start: np.ndarray, values: np.ndarray) -> PoseBatch:
    """Poses ``(T, N)``, each the nearest to a guess: Newton, and where that leads far, Levenberg-Marquardt.

    Guesses are ``(T, N)``, inputs ``(T, k)``.
    """
    with np.errstate(all="ignore"):
        inner, begin = _grounded(view, eq, start)
        begin[view.known[: values.shape[1]]] = values.T
        q = host.correct_poses(inner, begin)
        (size, *upright), conditioning = inner.check(q), inner.conditioning(q)
        moved = inner.weights * (q - begin)
        good = (size <= inner.tolerance(q)) & upright[0]
        # 0.1 of the size: a solution so near to a guess is the nearest
        good &= np.sqrt(np.einsum("nl,nl->l", moved, moved)) <= 0.1 * eq.length
        if view.square:
            good &= (inner.orientation(q) == inner.orientation(begin)).all(axis=0)
        if not good.all():
            far = np.flatnonzero(~good)
            q[:, far] = host.correct_poses(inner, host.closest(inner, begin[:, far]).q)
            (size, *upright), conditioning = inner.check(q), inner.conditioning(q)
            good = (size <= inner.tolerance(q)) & upright[0]
            # Steps that lead nowhere may lead far: what is not found is left at its guess, 10 sizes away.
            stray = ~good & ~(np.abs(inner.weights * (q - begin)).max(axis=0) <= 10.0 * eq.length)
            if stray.any():
                q[:, stray] = begin[:, stray]
                (size, *upright), conditioning = inner.check(q), inner.conditioning(q)
        none = np.zeros(len(good), bool)
        found = PoseBatch(q, size, conditioning, good, limit=none, crossed=none, mirrored=upright[1])
        lost = np.full(len(good), int(Status.DID_NOT_ASSEMBLE))
        status = _status(inner, None, found, lost, np.zeros(len(good), int))
    return PoseBatch(np.ascontiguousarray(q.T), size, conditioning, status=status)


def _grounded(view: Plan, eq: HostEquations, start: np.ndarray) -> tuple[host.HostView, np.ndarray]:
    """Put start poses ``(N, D)`` on the ground of their designs; with them what is solved for."""
    begin = np.array(np.asarray(start).T, eq.dtype)
    home = eq.home[view.fixed]
    begin[view.fixed] = home if home.ndim == 2 else home[:, None]
    return host.view_of(view, eq), begin


def _held_values(view: Plan, begin: np.ndarray, total: int) -> np.ndarray:
    """Values of the held coordinates, ``(T, held, D)``."""
    held = begin[view.known[len(view.driven) :]]
    return np.broadcast_to(held, (total, *held.shape))


def _judge_starts(inner: host.HostView, begin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Say which start poses ``(N, D)`` meet their rows, and which of them are singular positions of the inputs."""
    if begin.shape[1] > 1:
        return _look_at_starts(inner, begin)
    return _judge_once(inner.eq, (inner.plan, begin.tobytes()), lambda: _look_at_starts(inner, begin))


def _judge_once(eq: HostEquations, key: tuple, judge: Callable[[], _R]) -> _R:
    """Judge a start pose once: the drawing of a system is asked for often."""
    known = _known_starts(eq)
    found = known.get(key)
    if found is None:
        if len(known) > 16:  # poses of a user's own
            known.clear()
        found = known[key] = judge()
    return found


@by_identity
def _known_starts(_: HostEquations) -> dict[tuple, Any]:
    return {}


def _look_at_starts(inner: host.HostView, begin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    assembled = largest_of_lanes(inner.residual(begin)) <= 1e3 * inner.tolerance(begin)
    return assembled, assembled & (inner.conditioning(begin) <= inner.least.singular)


def _stay_where(
    view: Plan, singular: np.ndarray, start: np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Leave inputs ``(…, known, lanes)`` where a singular start pose has them: of two branches neither is followed.

    Returns:
        Statuses of poses that begin there, ``(…, lanes)``, zero of all others; and the inputs.
    """
    apart = known - start
    apart = apart - np.where(view.periodic[:, None], 2 * np.pi * np.round(apart / (2 * np.pi)), 0.0)
    rounding = 1e3 * np.finfo(known.dtype).eps * (1.0 + np.abs(known))
    there = (np.abs(apart) <= rounding).all(axis=-2)
    status = np.where(there, int(Status.SINGULAR), int(Status.SINGULAR_START))
    return np.where(singular, status, 0), np.where(singular, start, known)


def judge_start(view: Plan, eq: Equations, start: Numbers) -> int:
    """Judge a start pose: zero where branches can be followed from it, else the status of all poses."""
    there, begin = to_host(eq), np.asarray(start)
    return _judge_once(there, ("status", view, begin.tobytes()), lambda: _judge_on_host(view, there, begin))


def _judge_on_host(view: Plan, eq: HostEquations, start: np.ndarray) -> int:
    inner, begin = _grounded(view, eq, start[None])
    with np.errstate(all="ignore"):
        (assembled,), (singular,) = _judge_starts(inner, begin)
    status = int(Status.SINGULAR_START) if singular else 0
    status = status if assembled else int(Status.DID_NOT_ASSEMBLE)
    if any(block.kind.mirror for block in view.topology.blocks) and inner.eq.guards(begin)[1][0]:
        status = int(Status.MIRRORED)
    return int(Status.LEFT_CLASS) if inner.eq.misfit > limits(eq.home, eq.rounded).misfit else status


def never_moves(system: System, view: Plan, eq: Equations) -> bool:
    """Say whether inputs determine a motion in no pose near the drawing: a coordinate among them may never change."""
    samples = sample_poses(system, 4)[1:]  # to either side, twice
    return bool(samples) and all(judge_start(view, eq, s.q) == Status.SINGULAR_START for s in samples)


def repair_lanes(
    view: Plan, method: str, eq: Equations, start: np.ndarray, values: np.ndarray, wanted: np.ndarray
) -> PoseBatch:
    """Poses that were not found elsewhere: those that are wanted of several sequences of inputs.

    Args:
        view: what is solved for.
        method: as of `analyse_on_host`; a guess is a sequence of one value.
        eq: the equations for JAX, of arrays that are known; of one design, or designs first.
        start: poses to begin from ``(S, N)``, or one for all: the drawings; of a sequence in order the last pose that
            was found, if there is one.
        values: driven coordinates ``(S, T, k)``.
        wanted: which poses are asked for, ``(S, T)``; of a sequence in order all from the first one on.

    Returns:
        Poses ``(S, T, N)``, of each its status, largest residual and conditioning; where they are not wanted, zero.
    """
    shape, rows = wanted.shape, np.flatnonzero(wanted.any(axis=1))
    many = len(start) > 1
    of_designs = any(np.ndim(x) > y for x, y in ((eq.home, 1), (eq.length, 0)))
    if of_designs:
        eq = jax.tree.map(lambda a: a[rows if many else 0], eq)
    equations, begin = from_jax(eq), start[rows] if many else start
    none = functools.partial(np.zeros, dtype=start.dtype)
    found = PoseBatch(none((*shape, start.shape[1])), none(shape), none(shape), status=np.zeros(shape, np.int32))
    if method == "lanes":
        row, at = np.nonzero(wanted)
        owner = np.searchsorted(rows, row) if many else np.zeros(len(row), int)
        new = solve_lanes(view, equations, begin, values[row, at], owner)
        found.put((row, at), new)
    elif method == "guess":
        found.put((rows, 0), solve_nearest(view, equations, begin, values[rows, 0]))
    elif len(rows):
        first = np.argmax(wanted[rows], axis=1)
        new = solve_sequences(view, equations, begin, values[rows], first)

        def merge(x: np.ndarray, old: np.ndarray) -> np.ndarray:
            return np.where(wanted[rows].reshape(*x.shape[:2], *[1] * (x.ndim - 2)), x, old[rows])

        found.put(rows, new.each(merge, found))
    return found


def no_poses(eq: Equations, orders: tuple[Any, ...]) -> PoseBatch:
    """Make the result of an analysis of no poses."""
    none = np.zeros((0, len(eq.home)), eq.home.dtype)
    rates = tuple(none for _ in orders)
    return PoseBatch(none, none[:, 0], none[:, 0], status=np.zeros(0, np.int32), rates=rates)


def _lost_in_order(found: PoseBatch, assembled: np.ndarray, total: int) -> np.ndarray:
    """Statuses of a sequence's poses that are not on the branch: of the first why it ended, of the others none."""
    good, limit, exhausted = (x.reshape(-1, total) for x in (found.good, found.limit, found.exhausted))
    lost = np.where(assembled[:, None], int(Status.NOT_REACHED), int(Status.DID_NOT_ASSEMBLE))
    lost = np.repeat(lost, total, axis=1)
    each, first = np.arange(len(good)), np.argmin(good, axis=1)
    ended = assembled & ~good[each, first] & ~((first > 0) & limit[each, first - 1])
    why = np.where(exhausted[each, first], int(Status.TOO_FAR), int(Status.SINGULAR))
    lost[each[ended], first[ended]] = why[ended]
    return lost.reshape(-1)


def _status(
    view: host.HostView,
    start: np.ndarray | None,
    found: PoseBatch,
    lost: np.ndarray,
    which: np.ndarray,
    begun: np.ndarray | int = 0,
) -> np.ndarray:
    """`jaxnc.Status` of each pose as an integer.

    `which` are their start poses, which may be mirrored themselves; `begun` is what a start pose says, if not zero.
    """
    status = np.where(found.good, int(Status.CONVERGED), lost)
    singular = found.good & (found.limit | found.crossed | (found.conditioning <= view.least.singular))
    status = np.where(singular, int(Status.SINGULAR), status)
    status = np.where(np.equal(begun, 0), status, begun)
    if any(block.kind.mirror for block in view.plan.topology.blocks):
        fits = found.size <= view.select(which).tolerance(found.q)
        mirrored = (status != 0) & fits & found.mirrored
        if start is not None:
            mirrored |= view.eq.guards(start)[1][which]
        status = np.where(mirrored, int(Status.MIRRORED), status)
    left = np.asarray(view.eq.misfit > limits(view.eq.home, view.eq.rounded).misfit)
    status = np.where(left[which] if left.ndim else left, int(Status.LEFT_CLASS), status)
    return status.astype(np.int32)


def _count_turns(view: Plan, q: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Count whole turns from poses ``(N, L)`` to driven coordinates ``(L, k)``; zero where turns are counted."""
    at = view.known[: len(view.driven)]
    told = view.periodic[: len(at)] & (np.abs(targets) <= farthest(q))
    return np.where(told, np.round((targets - q[at].T) / (2 * np.pi)), 0.0)
