"""Analyses of large systems in traced code, which the host does; and what is not offered for them."""

import functools

import jax.numpy as jnp
import numpy as np

from jaxnc.errors import InputError
from jaxnc.kinematics import on_host
from jaxnc.solvers.answers import ask_of_equations
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.status import Status
from jaxnc.system.equations import Equations
from jaxnc.system.host import HostEquations
from jaxnc.system.topology import LARGE, Topology
from jaxnc.types import Array, Float


def followed(
    view: Plan, method: str, eq: Equations, q: Float[Array, "S N"], values: Float[Array, "S T k"]
) -> PoseBatch:
    """Poses ``(S, T, N)`` of sequences of inputs, or of each input on its own, by the host, and what became of each.

    The equations are those of one design, or of one for each sequence (first axis of every leaf).
    """
    ask = functools.partial(_follow, view, method)
    shape = (*values.shape[:2], q.shape[1] + 3)
    return _taken_apart(ask_of_equations("followed poses of a large system", ask, shape, eq, q, values))


def nearest(view: Plan, eq: Equations, q: Float[Array, "T N"], values: Float[Array, "T k"]) -> PoseBatch:
    """Poses of one design each near a guess, from the host; the result as of `followed`, without its first axis."""
    ask = functools.partial(_near, view)
    shape = (len(values), q.shape[1] + 3)
    return _taken_apart(ask_of_equations("solved for poses near a guess", ask, shape, eq, q, values))


def _taken_apart(table: Array) -> PoseBatch:
    status = jnp.where(jnp.isnan(table[..., -1]), int(Status.TOO_FAR), table[..., -1])  # interrupted by the user
    return PoseBatch(table[..., :-3], table[..., -3], table[..., -2], status=status.astype(np.int32))


def _table(found: PoseBatch) -> np.ndarray:
    return np.concatenate([found.q, np.stack([found.size, found.conditioning, found.status], axis=-1)], axis=-1)


def _near(view: Plan, eq: HostEquations, q: np.ndarray, values: np.ndarray) -> np.ndarray:
    return _table(on_host.nearest(view, eq, q, values))


def _follow(view: Plan, method: str, eq: HostEquations, q: np.ndarray, values: np.ndarray) -> np.ndarray:
    if method != "lanes":
        return _table(on_host.sequences(view, eq, q, values))
    which = np.repeat(np.arange(len(q)), values.shape[1])
    found = _table(on_host.scattered(view, eq, q, values.reshape(-1, values.shape[2]), which))
    return found.reshape(*values.shape[:2], -1)


def dense_only(topology: Topology, what: str) -> None:
    """Refuse an analysis that forms dense matrices, for a system whose matrices are kept sparse."""
    if topology.large:
        raise InputError(
            f"{what} forms dense matrices, and those of {topology.name!r} with its {len(topology.unknown)} unknowns "
            f"are kept sparse; solve_position, sweep, motion, their rates and gradients, and mobility work. "
            f"compile(sparse=False) makes them dense whatever the size, sensible up to a few times {LARGE} unknowns"
        )
