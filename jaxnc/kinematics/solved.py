"""Poses in traced code: solved side by side by XLA, and repaired on the host where that cannot answer for them.

Whatever `jax.vmap` maps becomes lanes here, so that the host is asked once for all lanes, and only if one needs it.
None of this is differentiated: derivatives are given to its results (see `jaxnc.solvers.newton.attach_pose`).
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from jaxnc import process
from jaxnc.kinematics import on_host
from jaxnc.remembered import with_owner
from jaxnc.solvers import fill, host
from jaxnc.solvers.fill import in_order, one_by_one
from jaxnc.solvers.kernel import kernel, writes_out
from jaxnc.solvers.newton import largest, tolerance
from jaxnc.solvers.plan import Plan, by_lu
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.solvers.rows import any_lane
from jaxnc.solvers.traced import Mapped, ask_host, ask_of_equations, in_lanes, shorten_equations
from jaxnc.status import Status
from jaxnc.system.equations import Equations, guards
from jaxnc.system.host import HostEquations
from jaxnc.system.precision import farthest, limits
from jaxnc.types import Array, Float

VERY_MANY = 20_000  # poses of a large batch
_AT_ONCE = 1_000_000  # numbers that are handed to the host together
_TABLE = 48_000  # numbers of poses that are kept in one table
_SMALL = 6  # unknowns of a block that is soon compiled
_DOING = "followed poses that compiled code had not found"


def apiece(plan: Plan) -> bool:
    """Whether coordinates are arrays of their own in what follows: where derivatives are written out."""
    return plan.square and writes_out(plan)


def solved(plan: Plan, method: str, repair: bool, eq: Equations, q: Array, values: Float[Array, "T k"]) -> PoseBatch:
    """Solve for poses of one design, in code that may be mapped.

    Coordinates that are not known are an array each, where they are `apiece`; elsewhere one array ``(T, n)``, and of a
    large system one of all coordinates, ``(T, N)``.

    The method is ``"continuation"`` (in order along one branch) or ``"lanes"`` (each from the start pose). What is not
    found is asked of the host, or without `repair` given up with `Status.TOO_FAR`.
    """
    begun = _begun(plan, eq, q)
    return jax.tree.map(lambda a: a[0], _solver(plan, method, repair, True)(eq, q[None], begun[None], values[None]))


@with_owner
def _solver(plan: Plan, method: str, repair: bool, shared: bool):
    """The function of equations (of one design, if `shared`), start poses ``(S, N)`` and values ``(S, T, k)``."""
    hosted = not writes_out(plan)
    repair = hosted or (repair and host.read_kinds(plan))

    def solve(eq, q, begun, values):
        if plan.large:  # all the host's
            return _followed_large(plan, method, eq, q, values[..., : len(plan.driven)])
        if values.shape[0] * values.shape[1] >= VERY_MANY:
            process.keep_memory()
        one = shared and len(values) == 1
        if repair and one and _sooner_on_host(plan, method, values.shape[1]):
            return _by_host(plan, method, eq, q, values)
        # Of other designs' poses by sparse LU each takes the host less time than a step takes XLA.
        if hosted or (repair and by_lu(plan) and not (one and _side_by_side(plan, method, values.shape[1]))):
            none = jnp.zeros(values.shape[:2], values.dtype)
            filled = PoseBatch((none,) * len(plan.unknown), none, none, none > 0.0, status=none.astype(np.int32))
        else:
            filled = quick(plan, method, shared, eq, q, begun, values)
        if not repair:
            return _in_one(plan, given_up(plan, method, q, begun, values, filled))
        found = filled._replace(known=filled.known_of(values), good=None, ended=None)
        # A loop that is not entered leaves its numbers where they are; a `cond` would copy them.
        found = _in_one(plan, found)
        answered, table = filled.answered, _tabled(found, q.dtype)
        mend = functools.partial(_mended, plan, method, shared, eq, q, values, answered)
        everything = ~any_lane(~answered)
        if table.size <= _TABLE:  # kept as it is: few operations compile soon
            return _answer(plan, lax.while_loop(lambda st: ~st[0], lambda st: mend(st[1]), (everything, table))[1])

        def mended(state):
            done, table = mend(_tabled(state[1], q.dtype))
            return done, _answer(plan, table)

        return lax.while_loop(lambda state: ~state[0], mended, (everything, found))[1]

    def shapes(eq, q, begun, values):
        def like(*more, dtype=values.dtype) -> Any:
            return jax.ShapeDtypeStruct((*values.shape[:2], *more), dtype)

        n = len(plan.unknown)
        x = (like(),) * n if apiece(plan) or not n else like(n)
        if plan.large:
            x, known = like(q.shape[-1]), ()
        else:
            known = (like(),) * values.shape[-1]
        return PoseBatch(x, like(), like(), known=known, status=like(dtype=np.int32))

    def mapped(size, which, eq, q, begun, values):
        of_one, eq, lanes = in_lanes(size, shared, which, eq, q, begun, values)
        if of_one and method == "lanes" and not any(which[1:3]) and len(q) == 1:  # more inputs of the same design
            lanes = q, begun, lanes[-1].reshape(1, -1, values.shape[-1])
        out = _solver(plan, method, repair, of_one)(eq, *lanes)
        out = jax.tree.map(lambda a: a.reshape(size, *values.shape[-3:-1], *a.shape[2:]), out)
        return out, jax.tree.map(lambda _: True, out)

    return Mapped(solve, shapes, mapped)


def _sooner_on_host(plan: Plan, method: str, count: int) -> bool:
    """Whether the host finds all poses of one design: few, of blocks that XLA takes long to compile."""
    blocks = kernel(plan).blocks if writes_out(plan) else []
    small = blocks and max(len(block.columns) for block in blocks) <= _SMALL
    return not small and not _side_by_side(plan, method, count) and on_host.few(plan, method, count)


def _side_by_side(plan: Plan, method: str, count: int) -> bool:
    """Say whether poses of one design are solved side by side, see `jaxnc.solvers.fill`."""
    return fill.pays(plan, count) and (method == "lanes" or len(plan.driven) == 1)


def _by_host(plan: Plan, method: str, eq: Equations, q: Array, values: Array) -> PoseBatch:
    """All poses of one design, ``(1, T)``, from the host."""
    asked, good = values[..., : len(plan.driven)], jnp.zeros(values.shape[:2], bool)
    return _answer(plan, _ask(plan, method, shorten_equations(eq), q, None, asked, good))


def quick(plan: Plan, method: str, shared: bool, eq: Equations, q: Array, begun: Array, values: Array) -> PoseBatch:
    """Poses as far as they are found side by side; `begun` are the statuses of the start poses."""
    turns = _turns(plan, q, values)
    if method == "lanes":
        filled = one_by_one(plan, eq, shared, q, values, turns)
    else:
        home = q
        for k in np.flatnonzero(_turning(plan)):  # by masks: what is put in its place is a kernel by itself
            home = jnp.where(np.arange(q.shape[1]) == plan.known[k], q + 2 * jnp.pi * turns[:, 0, k, None], home)
        filled = in_order(plan, eq, shared, home, values)
    far = jnp.any(jnp.abs(values[..., plan.angles]) > farthest(q), axis=-1)  # its turns are not told apart
    far = far if method == "lanes" else lax.cummax(far.astype(np.int32), axis=1) > 0
    fit = (begun == 0)[:, None] & ~far
    good, status = filled.good & fit, jnp.zeros(fit.shape, np.int32)
    if filled.ended is None:
        return filled._replace(good=good, status=status)
    ended = filled.ended & fit
    return filled._replace(good=good, ended=ended, status=jnp.where(ended, np.int32(Status.DID_NOT_ASSEMBLE), status))


def given_up(plan: Plan, method: str, q: Array, begun: Array, values: Array, filled: PoseBatch) -> PoseBatch:
    """What was found side by side, and instead of the rest the last pose on the branch."""
    good, columns = filled.answered, (*filled.q, *filled.known_of(values))
    count = jnp.zeros((len(q), 1), int) if method == "lanes" else jnp.sum(good, axis=1, keepdims=True)

    def held(a, c):
        last = jnp.take_along_axis(a, jnp.maximum(count - 1, 0), axis=1)
        return jnp.where(good, a, jnp.where(count > 0, last, q[:, int(c), None]))

    x = [held(a, c) for a, c in zip(columns, (*plan.unknown, *plan.known), strict=True)]
    later = (jnp.arange(good.shape[1]) > count) & (method != "lanes")
    lost = jnp.where(later, int(Status.NOT_REACHED), int(Status.TOO_FAR))
    status = jnp.where(good, filled.status, jnp.where((begun == 0)[:, None], lost, begun[:, None])).astype(np.int32)
    n = len(plan.unknown)
    return PoseBatch(tuple(x[:n]), filled.size, filled.conditioning, known=tuple(x[n:]), status=status)


def _begun(plan: Plan, eq: Equations, q: Array) -> Array:
    """What the start pose of a design is: zero where branches can be followed from it, else the status of all poses."""
    if not any(isinstance(x, Tracer) for x in jax.tree.leaves((eq, q))):
        return jnp.asarray(on_host.begun(plan, eq, q), np.int32)
    if plan.large:
        return jnp.zeros((), np.int32)  # which the host finds by itself
    assembled = largest(plan.residual(eq, q)) <= 1e3 * tolerance(eq, q)
    status = jnp.where(assembled, 0, int(Status.DID_NOT_ASSEMBLE))
    if any(block.kind.mirror for block in plan.topology.blocks):
        status = jnp.where(jnp.all(guards(eq, q)[1] > 0.0), status, int(Status.MIRRORED))
    return jnp.where(eq.misfit <= limits(q).misfit, status, int(Status.LEFT_CLASS)).astype(np.int32)


def _turns(plan: Plan, q: Array, values: Array) -> Array:
    """Whole turns from start poses ``(S, N)`` to known coordinates ``(S, T, k)``; zero where turns are counted."""
    turning = _turning(plan)
    if not turning.any():
        return jnp.zeros_like(values)
    told = turning & (jnp.abs(values) <= farthest(q))
    return jnp.where(told, jnp.round((values - q[:, None, plan.known]) / (2 * jnp.pi)), 0.0)


def _turning(plan: Plan) -> np.ndarray:
    """Which of the known coordinates are driven angles that nothing else depends on."""
    turning = plan.periodic
    return turning & (np.arange(len(turning)) < len(plan.driven))


def _mended(
    plan: Plan, method: str, shared: bool, eq: Equations, q: Array, values: Array, good: Array, table: Array
) -> tuple[Array, Array]:
    """A table of poses with those that were not found from the host, and that there is no more to be done.

    Of many sequences those that are wanted are handed over, some at a time, each as a row of numbers: few operations
    compile soon.
    """
    asked, eq, last = values[..., : len(plan.driven)], shorten_equations(eq), None
    if method != "lanes":  # the last pose of each sequence before the first that was not found
        place = jnp.maximum(jnp.sum(good, axis=1) - 1, 0)[:, None, None]
        last = jnp.take_along_axis(table[:, : len(plan.unknown) + len(plan.known)], place, axis=2)[:, :, 0]
    across = method == "lanes" and len(values) == 1 and table.size > _AT_ONCE
    if across:  # inputs of one design: each of them is a row
        asked, good, table = asked[0][:, None], good.T, table[0].T[:, :, None]
    own = None if shared else eq, None if across else q, last, asked, good  # the others are those of all rows

    def ask(eq_of, q_of, *rest):
        return _ask(plan, method, eq if eq_of is None else eq_of, q if q_of is None else q_of, *rest)

    leaves, structure = jax.tree.flatten(own)
    group = max(_AT_ONCE // (sum(a[0].size for a in leaves) + table[0].size), 1)
    if len(table) <= group:
        return jnp.ones((), bool), jnp.where(good[:, None], table, ask(*own))
    rows = jnp.concatenate([a.reshape(len(a), -1).astype(q.dtype) for a in leaves], axis=1)
    ends = np.cumsum([a[0].size for a in leaves])

    def body(state):
        open_, old = state
        these = jnp.nonzero(open_, size=group, fill_value=len(open_))[0]
        at = jnp.minimum(these, len(open_) - 1)
        parts = zip(jnp.split(rows[at], ends[:-1], axis=1), leaves, strict=True)
        *mine, right = [x.reshape(len(x), *a.shape[1:]) for x, a in parts]
        right = jnp.where((these < len(open_))[:, None], right > 0.0, True)  # what fills the last group up
        new = ask(*jax.tree.unflatten(structure, [*mine, right]))
        old = old.at[these].set(jnp.where(right[:, None], old[at], new), mode="drop")
        return open_.at[these].set(False, mode="drop"), old

    table = lax.while_loop(lambda state: jnp.any(state[0]), body, (jnp.any(~good, axis=1), table))[1]
    return jnp.ones((), bool), table[:, :, 0].T[None] if across else table


def _tabled(found: PoseBatch, dtype: Any) -> Array:
    """Poses and what became of them in one array, ``(S, columns, T)``."""
    rest = [*found.known, found.size, found.conditioning, found.status.astype(dtype)]
    if not isinstance(found.q, tuple):
        return jnp.concatenate([found.q.swapaxes(1, 2), jnp.stack(rest, axis=1)], axis=1)
    rows = [*found.q, *rest]
    if len(rows) * rows[0].size > _TABLE:
        return jnp.stack(rows, axis=1)
    *rows, table = [a[:, None] for a in rows]
    for k, row in enumerate(rows):  # chosen, not put together: that takes XLA three times as long to compile
        table = jnp.where(np.arange(len(rows) + 1)[:, None] == k, row, table)
    return table


def _in_one(plan: Plan, found: PoseBatch) -> PoseBatch:
    """The same; of a stack of columns that come from one array each would be a kernel of its own."""
    return found if apiece(plan) or not found.q else found._replace(q=jnp.stack(found.q, axis=-1))


def _answer(plan: Plan, table: Array) -> PoseBatch:
    """What a table says, ``(S, columns, T)``."""
    n = len(plan.unknown)
    q = tuple(jnp.moveaxis(table[:, :n], 1, 0)) if apiece(plan) or not n else table[:, :n].swapaxes(1, 2)
    *known, size, conditioning, status = jnp.moveaxis(table[:, n:], 1, 0)
    return PoseBatch(q, size, conditioning, known=tuple(known), status=status.astype(np.int32))


def _ask(plan: Plan, method: str, eq: Equations, q: Array, last: Array | None, asked: Array, good: Array) -> Array:
    """Have the host follow to the poses of sequences that are not good: a table as of `_tabled`.

    Start poses are ``(S, N)``, or one for all; `last` are unknown and known coordinates where it goes on, ``(S, n)``.
    """
    like = jax.ShapeDtypeStruct((len(asked), len(plan.unknown) + len(plan.known) + 3, asked.shape[1]), q.dtype)
    answer, nothing = functools.partial(_followed, plan, method), functools.partial(_unasked, like)
    return ask_host(_DOING, like, answer, eq, q, last, asked, good, given_up=nothing)


def _unasked(like: Any, *_: Any) -> np.ndarray:
    """What is returned where the user has interrupted it."""
    found = np.zeros(like.shape, like.dtype)
    found[:, -1] = int(Status.TOO_FAR)
    return found


def _followed(plan: Plan, method: str, eq: Any, start: Any, last: Any, asked: Any, good: Any) -> np.ndarray:
    """Runs on the host, inside of compiled code: nothing here may call JAX."""
    places = [*plan.unknown, *plan.known]
    if last is not None:
        begun, start = good.any(axis=1)[:, None], start.copy()
        start[:, places] = np.where(begun, last, start[:, places])
    found = on_host.repair_lanes(plan, method, eq, start, asked, ~good)
    rest = np.stack([found.size, found.conditioning, found.status], axis=-1)
    return np.moveaxis(np.concatenate([found.q[..., places], rest], axis=-1).astype(start.dtype), 2, 1)


def _followed_large(
    view: Plan, method: str, eq: Equations, q: Float[Array, "S N"], values: Float[Array, "S T k"]
) -> PoseBatch:
    """Poses ``(S, T, N)`` of sequences of inputs, or of each input on its own, by the host, and what became of each.

    The equations are those of one design, or of one for each sequence (first axis of every leaf).
    """
    ask = functools.partial(_follow_large, view, method)
    shape = (*values.shape[:2], q.shape[1] + 3)
    return _taken_apart(ask_of_equations("followed poses of a large system", ask, shape, eq, q, values))


def nearest_large(view: Plan, eq: Equations, q: Float[Array, "T N"], values: Float[Array, "T k"]) -> PoseBatch:
    """Poses of one design each near a guess, from the host; the result as of `followed`, without its first axis."""
    ask = functools.partial(_near_large, view)
    shape = (len(values), q.shape[1] + 3)
    return _taken_apart(ask_of_equations("solved for poses near a guess", ask, shape, eq, q, values))


def _taken_apart(table: Array) -> PoseBatch:
    status = jnp.where(jnp.isnan(table[..., -1]), int(Status.TOO_FAR), table[..., -1])  # interrupted by the user
    return PoseBatch(table[..., :-3], table[..., -3], table[..., -2], status=status.astype(np.int32))


def _one_table(found: PoseBatch) -> np.ndarray:
    return np.concatenate([found.q, np.stack([found.size, found.conditioning, found.status], axis=-1)], axis=-1)


def _near_large(view: Plan, eq: HostEquations, q: np.ndarray, values: np.ndarray) -> np.ndarray:
    return _one_table(on_host.nearest(view, eq, q, values))


def _follow_large(view: Plan, method: str, eq: HostEquations, q: np.ndarray, values: np.ndarray) -> np.ndarray:
    if method != "lanes":
        return _one_table(on_host.sequences(view, eq, q, values))
    which = np.repeat(np.arange(len(q)), values.shape[1])
    found = _one_table(on_host.scattered(view, eq, q, values.reshape(-1, values.shape[2]), which))
    return found.reshape(*values.shape[:2], -1)
