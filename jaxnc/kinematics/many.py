"""Many poses outside of traced code: solved side by side by XLA, and what that cannot answer for by the host."""

import functools
import weakref
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc import process
from jaxnc.compiling import jit
from jaxnc.kinematics import on_host
from jaxnc.kinematics.analysis import places
from jaxnc.kinematics.columns import Columns
from jaxnc.kinematics.rates import rates_of_batch, with_held
from jaxnc.kinematics.solved import VERY_MANY, given_up, quick
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.status import Status
from jaxnc.system.equations import Equations
from jaxnc.types import Array

_LADDER = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # times a power of ten: sizes of programs
_SERVES = 1.5  # times as many poses as are wanted a program may solve for

_sizes: weakref.WeakKeyDictionary[Plan, dict[str, set[int]]] = weakref.WeakKeyDictionary()  # of compiled programs


def analyse(
    view: Plan, method: str, eq: Equations, q0: Array, values: Any, orders: tuple[Array, ...], repair: bool = True
) -> PoseBatch:
    """Solve for poses and their rates: arguments and result as of `analysis.in_columns`."""
    count, size = len(values), _padded(view, method, len(values))
    if size > count:
        values = np.asarray(values)
        values = np.concatenate([values, np.broadcast_to(values[-1:], (size - count, values.shape[1]))])
    values = values if isinstance(values, jax.Array) else jnp.array(values)  # a copy that nobody else has
    begun, begin = np.int32(on_host.begun(view, eq, q0)), np.array(q0)
    begin[view.fixed] = np.asarray(eq.home)[view.fixed]
    very_many = size >= VERY_MANY  # a faster kernel pays for a longer compilation
    if very_many:
        process.keep_memory()
    solve = _compiled_well if very_many else _compiled_soon
    found, all_good, rest = solve(view, method, eq, begin, begun, values)
    if size > count:
        found, values = jax.tree.map(lambda a: a[:count], (found, values))
    if bool(all_good):
        driven = jnp.stack(found.known, axis=-1) if found.known else values
    else:
        if repair:
            found = _repaired(view, method, eq, begin, values, found)
        else:
            found = _given_up(view, method, eq, begin, begun, values, found)
        driven = jnp.stack(found.known[: len(view.driven)], axis=-1)
    poses, rates = Columns(rest, found.q, driven, places(view)), ()
    if orders:
        good = found.status == int(Status.CONVERGED)
        rates = rates_of_batch(view, eq, poses.whole(), with_held(view, orders), good)
    return PoseBatch(poses, found.size, found.conditioning, status=found.status, rates=rates)


def _padded(view: Plan, method: str, count: int) -> int:
    """Choose how many poses the program solves for: the last one is repeated.

    A program that is compiled already serves batches that are a third smaller, so that sweeps of any lengths need few
    programs.
    """
    sizes = _sizes.setdefault(view, {}).setdefault(method, set())
    made = min((s for s in sizes if count <= s <= _SERVES * count), default=0)
    if made:
        return made
    digits = 10 ** (len(str(count)) - 1)
    size = count
    if count & (count - 1):  # a power of two is what it is
        size = next(int(s * digits) for s in _LADDER if count <= s * digits)
    sizes.add(size)
    return size


def _quick(
    view: Plan, method: str, eq: Equations, begin: Array, begun: Array, values: Array
) -> tuple[PoseBatch, Array, Array]:
    """Solve for poses of one design; whether all are answered, and where they began."""
    filled = quick(view, method, True, eq, begin[None], begun[None], _known(view, begin, values)[None])
    filled = jax.tree.map(lambda a: a[0], filled)
    return filled, jnp.all(filled.answered), begin  # brought to the device with all the rest


_compiled_well = jax.jit(_quick, static_argnums=(0, 1))
_compiled_soon = jit(_quick, static_argnums=(0, 1))


@functools.partial(jit, static_argnums=(0, 1))
def _given_up(
    view: Plan, method: str, eq: Equations, begin: Array, begun: Array, values: Array, filled: PoseBatch
) -> PoseBatch:
    filled = jax.tree.map(lambda a: a[None], filled)
    found = given_up(view, method, begin[None], begun[None], _known(view, begin, values)[None], filled)
    return jax.tree.map(lambda a: a[0], found)


def _known(view: Plan, begin: Array, values: Array) -> Array:
    """Known coordinates of all poses."""
    held = begin[view.known[len(view.driven) :]]
    return jnp.concatenate([values, jnp.broadcast_to(held, (len(values), len(held)))], axis=1)


def _repaired(view: Plan, method: str, eq: Equations, begin: np.ndarray, values: Array, filled: PoseBatch) -> PoseBatch:
    """What was found, and from the host what was not."""
    begin, asked, wanted = begin.copy(), np.asarray(values), ~np.asarray(filled.answered)
    held = begin[view.known[len(view.driven) :]]
    known: Any = (*(filled.known or asked.T), *(np.full(len(asked), h) for h in held))
    made = jax.tree.map(np.array, filled._replace(known=known, good=None, ended=None))  # which may be written to
    columns = list(zip((*view.unknown, *view.known), (*made.q, *made.known), strict=True))
    first = int(np.argmax(wanted))
    if method != "lanes" and first:
        for c, a in columns:
            begin[c] = a[first - 1]
    new = on_host.repair_lanes(view, method, eq, begin[None], asked[None], wanted[None])
    for c, a in columns:
        a[wanted] = new.q[0, wanted, c]
    for mine, other in ((made.size, new.size), (made.conditioning, new.conditioning), (made.status, new.status)):
        mine[wanted] = other[0, wanted]
    return jax.tree.map(jnp.asarray, made)
