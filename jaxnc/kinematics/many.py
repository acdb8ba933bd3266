"""Many poses outside of traced code: solved side by side by XLA, and what that cannot answer for by the host."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc import memory
from jaxnc.compiling import jit
from jaxnc.kinematics import on_host
from jaxnc.kinematics.analysis import columns_of
from jaxnc.kinematics.columns import Columns
from jaxnc.kinematics.rates import rates_of_batch, with_held
from jaxnc.kinematics.solved import VERY_MANY, Solved, given_up, quick
from jaxnc.solvers.plan import Plan
from jaxnc.status import Status
from jaxnc.system.equations import Equations
from jaxnc.types import Array


def analyse(
    view: Plan, method: str, eq: Equations, q0: Array, values: Any, orders: tuple[Array, ...], repair: bool = True
) -> tuple[Columns, tuple[Array, ...], Array, Array, Array]:
    """Solve for poses and their rates: arguments and result as of `analysis.in_columns`."""
    values = values if isinstance(values, jax.Array) else jnp.array(values)  # a copy that nobody else has
    begun = np.int32(on_host.begun(view, eq, q0))
    very_many = len(values) >= VERY_MANY  # a faster kernel pays for a longer compilation
    if very_many:
        memory.keep()
    found, known, all_good = (_compiled_well if very_many else _compiled_soon)(view, method, eq, q0, begun, values)
    if repair and not bool(all_good):
        found = _repaired(view, method, eq, q0, known, found)
    driven = values if bool(all_good) else jnp.stack(found.known[: len(view.driven)], axis=-1)
    poses = columns_of(view, eq, q0, found.x, driven)
    good = found.status == int(Status.CONVERGED)
    rates = rates_of_batch(view, eq, poses.whole(), with_held(view, orders), good) if orders else ()
    return poses, rates, found.status, found.size, found.pivots


def _quick(
    view: Plan, method: str, eq: Equations, q0: Array, begun: Array, values: Array
) -> tuple[Solved, Array, Array]:
    begin = q0.at[view.fixed].set(eq.home[view.fixed])
    held = begin[view.known[len(view.driven) :]]
    known = jnp.concatenate([values, jnp.broadcast_to(held, (len(values), len(view.held)))], axis=1)
    filled = quick(view, method, True, eq, begin[None], begun[None], known[None])
    found = given_up(view, method, begin[None], begun[None], known[None], filled)
    return jax.tree.map(lambda a: a[0], found), known, jnp.all(filled.good)


_compiled_well = jax.jit(_quick, static_argnums=(0, 1))
_compiled_soon = jit(_quick, static_argnums=(0, 1))


def _repaired(view: Plan, method: str, eq: Equations, q0: Array, known: Array, found: Solved) -> Solved:
    """What was found, and from the host what was not."""
    made = jax.tree.map(np.array, found)  # which may be written to
    columns = list(zip((*view.unknown, *view.known), (*made.x, *made.known), strict=True))
    wanted = made.status != int(Status.CONVERGED)
    begin, first = np.array(q0), int(np.argmax(wanted))
    begin[view.fixed] = np.asarray(eq.home)[view.fixed]
    if method != "lanes" and first:
        for c, a in columns:
            begin[c] = a[first - 1]
    asked = np.asarray(known)[None, :, : len(view.driven)]
    new = on_host.repair_lanes(view, method, eq, begin[None], asked, wanted[None])
    for c, a in columns:
        a[wanted] = new[0][0, wanted, c]
    for a, b in zip(made[2:], new[1:], strict=True):
        a[wanted] = b[0, wanted]
    return jax.tree.map(jnp.asarray, made)
