"""Analyses of few poses in NumPy: what `jaxnc.kinematics.analysis` does by XLA for many, with nothing compiled."""

import functools
from typing import Any

import jax
import numpy as np
from jax.core import Tracer

from jaxnc.solvers import host
from jaxnc.solvers.plan import Plan
from jaxnc.status import Status
from jaxnc.system.equations import Equations
from jaxnc.system.host import from_jax
from jaxnc.system.precision import limits

_SECONDS = 0.25  # of NumPy's time: what would take longer is worth compiling
_LANE = 2e-6  # seconds for a pose of the smallest mechanism
_ELEMENT = 1.5e-7  # and for each element of its Jacobian
_FOLLOWED = 10.0  # times as long takes a pose that is followed to


def suits(view: Plan, method: str, *given: Any) -> bool:
    """Whether poses are found on the host: they are few, nothing is traced, and matrices are dense.

    The one rule for what XLA compiles: NumPy would take longer than a quarter of a second. A pose takes it two
    microseconds and 0.15 for each element of the Jacobian: 57,000 poses of a four-bar, 2,300 of a MacPherson strut; ten
    times as much where each of several inputs is a lane of its own, so that every pose is followed to.

    Args:
        view: what is solved for.
        method: ``"continuation"`` or ``"lanes"``.
        *given: values ``(T, driven)`` of the inputs, and whatever else the poses are found from.
    """
    if view.large or any(isinstance(x, Tracer) for x in jax.tree.leaves(given)):
        return False
    lane = _LANE + _ELEMENT * len(view.rows) * len(view.unknown)
    if method == "lanes" and len(view.driven) > 1:
        lane *= _FOLLOWED
    return len(given[0]) * lane <= _SECONDS


def analyse(
    view: Plan, method: str, eq: Equations, q0: Any, values: Any, orders: tuple[Any, ...]
) -> tuple[np.ndarray, tuple[np.ndarray, ...], np.ndarray, np.ndarray, np.ndarray]:
    """Solve for poses and their rates.

    Args:
        view: what is solved for.
        method: ``"continuation"`` (in order along one branch) or ``"lanes"`` (each from the start pose).
        eq: the equations.
        q0: start pose, all coordinates.
        values: driven coordinates, ``(T, driven)``.
        orders: their time derivatives, each ``(T, driven)``.

    Returns:
        Poses ``(T, N)``, their time derivatives, and of each its status, largest residual and conditioning.
    """
    with np.errstate(all="ignore"):
        inner = host.HostView(view, from_jax(eq))
        dtype = inner.eq.dtype
        start = np.array(q0, dtype)
        start[view.fixed] = inner.eq.home[view.fixed]
        values = np.asarray(values, dtype)
        held = np.broadcast_to(start[view.known[len(view.driven) :]], (len(values), len(view.held)))
        known = np.concatenate([values, held], axis=1)
        assembled = _largest(inner.residual(start[:, None]))[0] <= 1e3 * inner.tolerance(start[:, None])[0]
        if method == "lanes":
            shift = np.concatenate([2 * np.pi * _turns(view, start, values), np.zeros_like(held)], axis=1)
            found = host.scattered(inner, start, known - shift)
            # The shorter way round may be closed and the longer one open: a rocker may travel more than half a turn.
            again = ~found.reached & shift.any(axis=1)
            if again.any():
                other = host.scattered(inner, start, known[again])
                shift[again] = 0.0
                for x, y in zip(found, other, strict=True):
                    x[..., again] = y
            found.q[view.known] += shift.T
            lost = np.where(found.exhausted, int(Status.TOO_FAR), int(Status.DID_NOT_ASSEMBLE))
        else:
            turned = np.array(start)
            turned[view.known[: len(view.driven)]] += 2 * np.pi * _turns(view, start, values[0])
            found = host.sequence(inner, turned, known)
            if not found.reached[0] and (turned != start).any():
                found = host.sequence(inner, start, known)
            lost = _lost_in_order(found, assembled)
        status = _status(inner, start, found, lost, float(eq.misfit))
        rates, q = (), found.q
        if orders:
            good = status == int(Status.CONVERGED)
            still = np.zeros_like(held)
            given = [np.concatenate([np.asarray(o, dtype), still], axis=1).T[:, good] for o in orders]
            rates = tuple(np.zeros((len(values), q.shape[0]), dtype) for _ in orders)
            if good.any():
                for out, term in zip(rates, host.rates(inner, q[:, good], given), strict=True):
                    out[good] = term.T
        return np.ascontiguousarray(q.T), rates, status, found.size, found.conditioning


def _largest(r: np.ndarray) -> np.ndarray:
    return np.max(np.abs(r), axis=0, initial=0.0)


def _lost_in_order(found: host.Poses, assembled: bool) -> np.ndarray:
    """What a pose of a sequence has if it is not on the branch: the first one why it ended, the others nothing."""
    good = found.reached
    lost = np.full(len(good), int(Status.NOT_REACHED) if assembled else int(Status.DID_NOT_ASSEMBLE))
    first = int(np.argmin(good))
    if assembled and not good[first] and not (first and found.limit[first - 1]):
        lost[first] = int(Status.TOO_FAR if found.exhausted[first] else Status.SINGULAR)
    return lost


def _status(view: host.HostView, start: np.ndarray, found: host.Poses, lost: np.ndarray, misfit: float) -> np.ndarray:
    """`jaxnc.Status` of each pose as an integer."""
    status = np.where(found.reached, int(Status.CONVERGED), lost)
    singular = found.reached & (found.limit | found.crossed | (found.conditioning <= view.least.singular))
    status = np.where(singular, int(Status.SINGULAR), status)
    if any(block.kind.mirror for block in view.plan.topology.blocks):
        fits = found.size <= view.tolerance(found.q)
        mirrored = (status != 0) & fits & found.mirrored
        mirrored |= bool(view.eq.guards(start[:, None])[1][0])
        status = np.where(mirrored, int(Status.MIRRORED), status)
    return np.where(misfit > limits(start).misfit, int(Status.LEFT_CLASS), status)


def _turns(view: Plan, q: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Whole turns from a pose to values of the driven coordinates ``(..., k)``; zero where turns are counted."""
    turning = _periodic(view)
    return np.where(turning, np.round((targets - q[view.known[: len(turning)]]) / (2 * np.pi)), 0.0)


@functools.lru_cache(maxsize=256)
def _periodic(view: Plan) -> np.ndarray:
    from jaxnc.solvers.batch import periodic

    return periodic(view)[: len(view.driven)]
