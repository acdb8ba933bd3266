"""Poses by XLA: whole analyses, of many poses or in traced code, and what the host repairs of them.

Poses are solved side by side, in a fixed number of steps. What is not found is asked of the host, once for all lanes,
and only if one needs it: whatever `jax.vmap` maps becomes lanes here. The solve itself is not differentiated; its
results are given their derivatives (see `jaxnc.solvers.newton.attach_pose`), and then their rates.
"""

import functools
import math
import weakref
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from jaxnc import process
from jaxnc.compiling import in_chunks, jit
from jaxnc.kinematics import host_solve
from jaxnc.kinematics.motion import Columns
from jaxnc.records import with_owner
from jaxnc.solvers import fill, host
from jaxnc.solvers.fill import in_order, one_by_one
from jaxnc.solvers.kernel import fusion_barrier, kernel, opaque_true, writes_out
from jaxnc.solvers.newton import attach_lanes, attach_pose, closest_pose, largest, masked_pose, newton, tolerance
from jaxnc.solvers.plan import Plan, by_lu
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.solvers.rows import any_lane
from jaxnc.solvers.traced import Mapped, ask_host, in_lanes, refuse_unreadable, shorten_equations
from jaxnc.status import Status
from jaxnc.system.equations import Equations, guards, residual, weights
from jaxnc.system.frames import along
from jaxnc.system.precision import farthest, limits
from jaxnc.types import Array, Coordinates, Float, PyTree

_VERY_MANY = 20_000  # poses of a large batch: a faster kernel pays for a longer compilation
_CHUNK = 64  # lanes at a time: of poses near guesses, and of rates by matrices
_TABLE = 48_000  # numbers of poses that are kept in one table
_LADDER = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # times a power of ten: sizes of programs

_sizes: weakref.WeakKeyDictionary[Plan, dict[str, set[int]]] = weakref.WeakKeyDictionary()  # of compiled programs


# -- analyses ---------------------------------------------------------------------------------------------------------


@functools.partial(jit, static_argnums=(0, 1, 6))
def analyse_traced(
    view: Plan, method: str, eq: Equations, q0: Array, values: Array, orders: tuple[Array, ...], repair: bool = True
) -> PoseBatch:
    """Solve for poses and their rates; compiled once per plan, method and number of poses.

    Args:
        view: what is solved for (static).
        method: ``"continuation"``, ``"lanes"`` or ``"guess"`` (static).
        eq: the equations.
        q0: start pose, all coordinates; for ``"guess"`` one for each pose, ``(T, N)``.
        values: driven coordinates, ``(T, driven)``.
        orders: their time derivatives, each ``(T, driven)``.
        repair: ask the host for what is not found (static).

    Returns:
        Poses ``(T, N)``, or `Columns` where they are followed and derivatives are written out: what is not looked at,
        as most coordinates in traced code are, is then not put together either. With them their time derivatives, and
        of each pose its status, largest residual and conditioning.
    """
    known = known_values(view, q0, values)
    frozen, targets, begin = lax.stop_gradient((eq, known, q0))
    if view.large:
        begin = begin.at[..., view.fixed].set(frozen.home[view.fixed])
    elif method != "guess":
        begin = jnp.where(np.isin(np.arange(len(frozen.home)), view.fixed), frozen.home, begin)
    finite = jnp.all(jnp.isfinite(targets), axis=1)
    reached = lax.cummin(finite.astype(np.int32)) > 0 if method == "continuation" else finite
    # What is no number is solved for nowhere, and nothing is differentiated by it.
    rest = jnp.where(jnp.isfinite(begin), begin, frozen.home)[..., view.known]
    known, targets = (jnp.where(reached[:, None], x, rest) for x in (known, targets))
    if method != "guess":
        found = solve_traced(view, method, repair, frozen, begin, targets)
    elif view.large:
        found = jax.tree.map(lambda a: a[:, 0], _solve_on_host(view, method, frozen, begin, targets[:, None]))
    else:
        found = in_chunks(jax.vmap(functools.partial(_near_guess, view, frozen)), _CHUNK, begin, targets)
    lost = jnp.where(finite, np.int32(Status.NOT_REACHED), np.int32(Status.DID_NOT_ASSEMBLE))
    found = found._replace(status=jnp.where(reached, found.status, lost))
    good = found.status == int(Status.CONVERGED)

    def attached(lane: tuple[Array, Array, Array]) -> Array:
        q, known, ok = lane
        return attach_pose(view, q, eq, known, ok)

    # A pose that was not asked for has no derivative: it is handed on as a constant.
    if method == "guess" and not view.large:
        poses = jnp.where(good[:, None], jax.vmap(lambda x, u: attach_pose(view, x, eq, u))(found.q, known), found.q)
    else:
        inputs = jnp.stack(found.known, axis=1) if len(view.known) else values
        if writes_out(view):
            x = attach_lanes(view, found.q, eq, tuple(known[:, k] for k in range(known.shape[1])), good)
            poses = columns_of(view, eq, q0, x, jnp.where(good[:, None], values, inputs[:, : values.shape[1]]))
        else:
            q = jnp.broadcast_to(begin, (len(values), begin.shape[-1]))
            for columns, numbers in ((view.unknown, found.q), (view.known, inputs)):
                q = q.at[:, columns].set(numbers) if len(columns) else q
            lanes = q, known, good
            new = lax.map(attached, lanes) if view.large else jax.vmap(attached)(lanes)
            poses = jnp.where(good[:, None], new, q)
    rates = ()
    if orders:
        whole = poses.whole() if isinstance(poses, Columns) else poses
        rates = lane_rates(view, eq, whole, with_held(view, orders), good)
    return PoseBatch(poses, found.size, found.conditioning, status=found.status, rates=rates)


def _near_guess(view: Plan, eq: Equations, start: Array, known: Array) -> PoseBatch:
    """Find the pose nearest to a guess, all coordinates ``(N,)``."""
    begin = view.join(start[view.unknown], known, eq.home[view.fixed])
    q = newton(view, eq, closest_pose(view, eq, begin).q, 8)
    # Steps that lead nowhere may lead far: what is not found is left at its guess, 10 sizes away.
    stray = ~(largest(weights(eq) * (q - begin)) <= 10.0 * eq.length) & (largest(residual(eq, q)) > tolerance(eq, q))
    q = jnp.where(stray, begin, q)
    rows, bodies = guards(eq, q)
    size, pivots = largest(residual(eq, q)), view.conditioning(eq, view.linearise(eq, q)[1])
    fits, mirrored = size <= tolerance(eq, q), jnp.any(bodies <= 0.0)
    status = jnp.where(pivots > limits(q).singular, int(Status.CONVERGED), int(Status.SINGULAR))
    status = jnp.where(fits & jnp.all(rows > 0.0) & ~mirrored, status, int(Status.DID_NOT_ASSEMBLE))
    if any(block.kind.mirror for block in view.topology.blocks):
        status = jnp.where((status != 0) & fits & mirrored, int(Status.MIRRORED), status)
    status = jnp.where(eq.misfit > limits(q, eq.rounded).misfit, int(Status.LEFT_CLASS), status)
    return PoseBatch(q, size, pivots, status=status)


def known_values(view: Plan, q0: Array, values: Array) -> Array:
    """Driven and held coordinates of every pose, ``(T, k)``."""
    held = q0[..., view.known[len(view.driven) :]]
    return jnp.concatenate([values, jnp.broadcast_to(held, (values.shape[0], len(view.held)))], axis=1)


def columns_of(view: Plan, eq: Equations, q0: Array, x: tuple[Array, ...], driven: Array) -> Columns:
    """Make poses from their unknown and driven coordinates; the held ones are those of the start pose."""
    held = view.known[driven.shape[-1] :]
    rest = lax.stop_gradient(q0).at[view.fixed].set(eq.home[view.fixed]).at[held].set(q0[held])
    return Columns(rest, x, driven, _column_places(view))


@with_owner
def _column_places(view: Plan) -> tuple[int, ...]:
    """Places of the coordinates that are columns: the unknown ones and the driven ones."""
    return tuple(int(c) for c in (*view.unknown, *view.known[: len(view.driven)]))


# -- many poses outside of traced code --------------------------------------------------------------------------------


def analyse_many(
    view: Plan, method: str, eq: Equations, q0: Array, values: Any, orders: tuple[Array, ...], repair: bool = True
) -> PoseBatch:
    """Solve for many poses outside of traced code, and for their rates: arguments and result as of `analyse_traced`."""
    count, size = len(values), _padded_size(view, method, len(values))
    if size > count:
        values = np.asarray(values)
        values = np.concatenate([values, np.broadcast_to(values[-1:], (size - count, values.shape[1]))])
    begun, begin = np.int32(host_solve.judge_start(view, eq, q0)), np.array(q0)
    begin[view.fixed] = np.asarray(eq.home)[view.fixed]
    very_many = size >= _VERY_MANY  # a faster kernel pays for a longer compilation
    if very_many:
        process.keep_memory()
    solve = _solve_fast_run if very_many else _solve_fast_compile
    found, all_good, rest, driven = solve(view, method, eq, begin, begun, values)
    if size > count:
        found, values, driven = jax.tree.map(lambda a: a[:count], (found, values, driven))
    if not all_good:
        if repair:
            found = _repair_on_host(view, method, eq, begin, values, found)
        else:
            found = _mark_rest(view, method, begin, begun, values, found)
        driven = jnp.stack(found.known[: len(view.driven)], axis=-1)
    poses, rates = Columns(rest, found.q, driven, _column_places(view)), ()
    if orders:
        good = found.status == int(Status.CONVERGED)
        rates = batch_rates(view, eq, poses.whole(), with_held(view, orders), good)
    return PoseBatch(poses, found.size, found.conditioning, status=found.status, rates=rates)


def _padded_size(view: Plan, method: str, count: int) -> int:
    """Choose how many poses the program solves for: the last one is repeated.

    A program that is compiled already serves batches that are a third smaller, so that sweeps of any lengths need few
    programs.
    """
    sizes = _sizes.setdefault(view, {}).setdefault(method, set())
    # a program may solve for 1.5 times as many poses as are wanted
    made = min((s for s in sizes if count <= s <= 1.5 * count), default=0)
    if made:
        return made
    digits = 10 ** (len(str(count)) - 1)
    size = count
    if count & (count - 1):  # a power of two is what it is
        size = next(int(s * digits) for s in _LADDER if count <= s * digits)
    sizes.add(size)
    return size


def _solve_one_design(
    view: Plan, method: str, eq: Equations, begin: Array, begun: Array, values: Array
) -> tuple[PoseBatch, Array, Array, Array]:
    """Solve for poses of one design; say whether all are answered, and where they began and are driven to."""
    filled = solve_fixed_steps(
        view, method, True, eq, begin[None], begun[None], known_values(view, begin, values)[None]
    )
    filled = jax.tree.map(lambda a: a[0], filled)
    driven = jnp.stack(filled.known, axis=-1) if filled.known else values
    return filled, jnp.all(filled.answered), begin, driven  # brought to the device with all the rest


_solve_fast_run = jax.jit(_solve_one_design, static_argnums=(0, 1))
_solve_fast_compile = jit(_solve_one_design, static_argnums=(0, 1))


@functools.partial(jit, static_argnums=(0, 1))
def _mark_rest(view: Plan, method: str, begin: Array, begun: Array, values: Array, filled: PoseBatch) -> PoseBatch:
    filled = jax.tree.map(lambda a: a[None], filled)
    found = mark_unsolved(view, method, begin[None], begun[None], known_values(view, begin, values)[None], filled)
    return jax.tree.map(lambda a: a[0], found)


def _repair_on_host(
    view: Plan, method: str, eq: Equations, begin: np.ndarray, values: Array, filled: PoseBatch
) -> PoseBatch:
    """Have the host solve for the poses that were not found."""
    asked, good = np.asarray(values), np.asarray(filled.answered)
    held = begin[view.known[len(view.driven) :]]
    known = (*(filled.known or asked.T), *(np.full(len(asked), h) for h in held))
    old = np.stack([np.asarray(x) for x in (*filled.q, *known, filled.size, filled.conditioning, filled.status)])
    last = None if method == "lanes" else old[None, :-3, max(int(good.sum()) - 1, 0)]
    new = _follow_lanes(view, method, eq, begin[None], last, asked[None], good[None])[0]
    *x, size, conditioning, status = np.where(good, old, new)
    n = len(view.unknown)
    found = PoseBatch(tuple(x[:n]), size, conditioning, known=tuple(x[n:]), status=status.astype(np.int32))
    return jax.tree.map(jnp.asarray, found)


# -- traced code ------------------------------------------------------------------------------------------------------


def solve_traced(
    plan: Plan, method: str, repair: bool, eq: Equations, q: Array, values: Float[Array, "T k"]
) -> PoseBatch:
    """Solve for poses of one design, in code that may be mapped.

    Coordinates that are not known are an array each where derivatives are written out; elsewhere one array ``(T, n)``.

    The method is ``"continuation"`` (in order along one branch) or ``"lanes"`` (each from the start pose). What is not
    found is asked of the host, or without `repair` given up with `Status.TOO_FAR`.
    """
    begun = _judge_start(plan, eq, q)
    return jax.tree.map(lambda a: a[0], _solver(plan, method, repair, True)(eq, q[None], begun[None], values[None]))


@with_owner
def _solver(plan: Plan, method: str, repair: bool, shared: bool):
    """Make the function of equations (of one design, if `shared`), start poses ``(S, N)`` and values ``(S, T, k)``."""
    hosted = not writes_out(plan)
    repair = hosted or (repair and host.read_kinds(plan))

    def solve(eq, q, begun, values):
        if plan.large:  # all the host's
            return _solve_on_host(plan, method, eq, q, values)
        if values.shape[0] * values.shape[1] >= _VERY_MANY:
            process.keep_memory()
        one = shared and len(values) == 1
        if repair and one and _sooner_on_host(plan, method, values.shape[1]):
            return _solve_on_host(plan, method, eq, q, values)
        # Of other designs' poses by sparse LU each takes the host less time than a step takes XLA.
        if hosted or (repair and by_lu(plan) and not (one and _side_by_side(plan, method, values.shape[1]))):
            none = jnp.zeros(values.shape[:2], values.dtype)
            filled = PoseBatch((none,) * len(plan.unknown), none, none, none > 0.0, status=none.astype(np.int32))
        else:
            filled = solve_fixed_steps(plan, method, shared, eq, q, begun, values)
        if not repair:
            return _stack_columns(plan, mark_unsolved(plan, method, q, begun, values, filled))
        found = filled._replace(known=filled.known_of(values), good=None, ended=None)
        # A loop that is not entered leaves its numbers where they are; a `cond` would copy them.
        found = _stack_columns(plan, found)
        answered, table = filled.answered, _to_table(found, q.dtype)
        mend = functools.partial(_repair, plan, method, shared, eq, q, values, answered)
        everything = ~any_lane(~answered)
        if table.size <= _TABLE:  # kept as it is: few operations compile soon
            return _from_table(plan, lax.while_loop(lambda st: ~st[0], lambda st: mend(st[1]), (everything, table))[1])

        def repair_all(state):
            done, table = mend(_to_table(state[1], q.dtype))
            return done, _from_table(plan, table)

        return lax.while_loop(lambda state: ~state[0], repair_all, (everything, found))[1]

    def shapes(eq, q, begun, values):
        def like(*more, dtype=values.dtype) -> jax.ShapeDtypeStruct:
            return jax.ShapeDtypeStruct((*values.shape[:2], *more), dtype)

        n = len(plan.unknown)
        x, known = (like(),) * n if writes_out(plan) or not n else like(n), (like(),) * values.shape[-1]
        return PoseBatch(x, like(), like(), known=known, status=like(dtype=np.int32))

    def map_lanes(size, which, eq, q, begun, values):
        of_one, eq, lanes = in_lanes(size, shared, which, eq, q, begun, values)
        if of_one and method == "lanes" and not any(which[1:3]) and len(q) == 1:  # more inputs of the same design
            lanes = q, begun, lanes[-1].reshape(1, math.prod(lanes[-1].shape[:-1]), values.shape[-1])
        out = _solver(plan, method, repair, of_one)(eq, *lanes)
        out = jax.tree.map(lambda a: a.reshape(size, *values.shape[-3:-1], *a.shape[2:]), out)
        return out, jax.tree.map(lambda _: True, out)

    return Mapped(solve, shapes, map_lanes)


def _sooner_on_host(plan: Plan, method: str, count: int) -> bool:
    """Say whether the host finds all poses of one design: few, of blocks that XLA takes long to compile."""
    blocks = kernel(plan).blocks if writes_out(plan) else []
    small = blocks and max(len(block.columns) for block in blocks) <= 6  # a block of 6 unknowns is soon compiled
    return not small and not _side_by_side(plan, method, count) and host_solve.is_few(plan, method, count)


def _side_by_side(plan: Plan, method: str, count: int) -> bool:
    """Say whether poses of one design are solved side by side, see `jaxnc.solvers.fill`."""
    return fill.pays(plan, count) and (method == "lanes" or len(plan.driven) == 1)


def _solve_on_host(plan: Plan, method: str, eq: Equations, q: Array, values: Array) -> PoseBatch:
    """Have the host solve for all poses, ``(S, T)``."""
    asked, good = values[..., : len(plan.driven)], jnp.zeros(values.shape[:2], bool)
    if plan.large:
        refuse_unreadable(plan.topology)
    return _from_table(plan, _ask(plan, method, shorten_equations(eq), q, None, asked, good))


def solve_fixed_steps(
    plan: Plan, method: str, shared: bool, eq: Equations, q: Array, begun: Array, values: Array
) -> PoseBatch:
    """Solve for poses side by side, as far as they are found; `begun` are the statuses of the start poses."""
    far = jnp.any(jnp.abs(values[..., plan.angles]) > farthest(q), axis=-1)  # its turns are not told apart
    far = far if method == "lanes" else lax.cummax(far.astype(np.int32), axis=1) > 0
    values = jnp.where(far[..., None], q[:, None, plan.known], values)  # or the way to it would be that of others
    turns = _whole_turns(plan, q, values)
    if method == "lanes":
        filled = one_by_one(plan, eq, shared, q, values, turns)
    else:
        home = q
        for k in np.flatnonzero(_driven_angles(plan)):  # by masks: what is put in its place is a kernel by itself
            home = jnp.where(np.arange(q.shape[1]) == plan.known[k], q + 2 * jnp.pi * turns[:, 0, k, None], home)
        filled = in_order(plan, eq, shared, home, values)
    fit = (begun == 0)[:, None] & ~far
    good, status = filled.good & fit, jnp.zeros(fit.shape, np.int32)
    if filled.ended is None:
        return filled._replace(good=good, status=status)
    ended = filled.ended & fit
    return filled._replace(good=good, ended=ended, status=jnp.where(ended, np.int32(Status.DID_NOT_ASSEMBLE), status))


def mark_unsolved(plan: Plan, method: str, q: Array, begun: Array, values: Array, filled: PoseBatch) -> PoseBatch:
    """Put the last pose on the branch in the place of poses that were not found side by side."""
    good, columns = filled.answered, (*filled.q, *filled.known_of(values))
    count = jnp.zeros((len(q), 1), int) if method == "lanes" else jnp.sum(good, axis=1, keepdims=True)

    def keep_last(a, c):
        last = jnp.take_along_axis(a, jnp.maximum(count - 1, 0), axis=1)
        return jnp.where(good, a, jnp.where(count > 0, last, q[:, int(c), None]))

    x = [keep_last(a, c) for a, c in zip(columns, (*plan.unknown, *plan.known), strict=True)]
    later = (jnp.arange(good.shape[1]) > count) & (method != "lanes")
    lost = jnp.where(later, int(Status.NOT_REACHED), int(Status.TOO_FAR))
    status = jnp.where(good, filled.status, jnp.where((begun == 0)[:, None], lost, begun[:, None])).astype(np.int32)
    n = len(plan.unknown)
    return PoseBatch(tuple(x[:n]), filled.size, filled.conditioning, known=tuple(x[n:]), status=status)


def _judge_start(plan: Plan, eq: Equations, q: Array) -> Array:
    """Judge the start pose of a design: zero where branches can be followed from it, else the status of all poses."""
    if not any(isinstance(x, Tracer) for x in jax.tree.leaves((eq, q))):
        return jnp.asarray(host_solve.judge_start(plan, eq, q), np.int32)
    if plan.large:
        return jnp.zeros((), np.int32)  # which the host finds by itself
    assembled = largest(plan.residual(eq, q)) <= 1e3 * tolerance(eq, q)
    status = jnp.where(assembled, 0, int(Status.DID_NOT_ASSEMBLE))
    if any(block.kind.mirror for block in plan.topology.blocks):
        status = jnp.where(jnp.all(guards(eq, q)[1] > 0.0), status, int(Status.MIRRORED))
    return jnp.where(eq.misfit <= limits(q, eq.rounded).misfit, status, int(Status.LEFT_CLASS)).astype(np.int32)


def _whole_turns(plan: Plan, q: Array, values: Array) -> Array:
    """Count whole turns from start poses ``(S, N)`` to known coordinates ``(S, T, k)``; zero where turns count."""
    turning = _driven_angles(plan)
    if not turning.any():
        return jnp.zeros_like(values)
    told = turning & (jnp.abs(values) <= farthest(q))
    return jnp.where(told, jnp.round((values - q[:, None, plan.known]) / (2 * jnp.pi)), 0.0)


def _driven_angles(plan: Plan) -> np.ndarray:
    """Mark the known coordinates that are driven angles on whose turns nothing else depends."""
    turning = plan.periodic
    return turning & (np.arange(len(turning)) < len(plan.driven))


def _repair(
    plan: Plan, method: str, shared: bool, eq: Equations, q: Array, values: Array, good: Array, table: Array
) -> tuple[Array, Array]:
    """Have the host solve for the poses of a table that were not found; true: there is no more to be done.

    Of many sequences those that are wanted are handed over, some at a time, each as a row of numbers: few operations
    compile soon.
    """
    asked, eq, last = values[..., : len(plan.driven)], shorten_equations(eq), None
    if method != "lanes":  # the last pose of each sequence before the first that was not found
        place = jnp.maximum(jnp.sum(good, axis=1) - 1, 0)[:, None, None]
        last = jnp.take_along_axis(table[:, : len(plan.unknown) + len(plan.known)], place, axis=2)[:, :, 0]
    most = 1_000_000  # numbers that are handed to the host together
    across = method == "lanes" and len(values) == 1 and table.size > most
    if across:  # inputs of one design: each of them is a row
        asked, good, table = asked[0][:, None], good.T, table[0].T[:, :, None]
    own = None if shared else eq, None if across else q, last, asked, good  # the others are those of all rows

    def ask(eq_of, q_of, *rest):
        return _ask(plan, method, eq if eq_of is None else eq_of, q if q_of is None else q_of, *rest)

    leaves, structure = jax.tree.flatten(own)
    group = max(most // (sum(a[0].size for a in leaves) + table[0].size), 1)
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


def _to_table(found: PoseBatch, dtype: np.dtype) -> Array:
    """Put poses and what became of them into one array, ``(S, columns, T)``."""
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


def _stack_columns(plan: Plan, found: PoseBatch) -> PoseBatch:
    """Stack the columns into one array; separately stored, each would be a kernel of its own."""
    return found if writes_out(plan) or not found.q else found._replace(q=jnp.stack(found.q, axis=-1))


def _from_table(plan: Plan, table: Array) -> PoseBatch:
    """Read a table of poses, ``(S, columns, T)``."""
    n = len(plan.unknown)
    q = tuple(jnp.moveaxis(table[:, :n], 1, 0)) if writes_out(plan) or not n else table[:, :n].swapaxes(1, 2)
    *known, size, conditioning, status = jnp.moveaxis(table[:, n:], 1, 0)
    return PoseBatch(q, size, conditioning, known=tuple(known), status=status.astype(np.int32))


def _ask(plan: Plan, method: str, eq: Equations, q: Array, last: Array | None, asked: Array, good: Array) -> Array:
    """Have the host follow to the poses of sequences that are not good: a table as of `_to_table`.

    Start poses are ``(S, N)``, or one for all; `last` are unknown and known coordinates where it goes on, ``(S, n)``.
    """
    like = jax.ShapeDtypeStruct((len(asked), len(plan.unknown) + len(plan.known) + 3, asked.shape[1]), q.dtype)
    answer, nothing = functools.partial(_follow_lanes, plan, method), functools.partial(_give_up, like)
    which = "of a large system" if plan.large else "that compiled code had not found"
    given = eq, q, last, asked, good
    return ask_host(f"followed poses {which}", like, answer, *given, given_up=nothing, large=plan.large)


def _give_up(like: PyTree, *_: object) -> np.ndarray:
    """Answer `_ask` where the user has interrupted the host."""
    found = np.zeros(like.shape, like.dtype)
    found[:, -1] = int(Status.TOO_FAR)
    return found


def _follow_lanes(plan: Plan, method: str, eq: Equations, start: Any, last: Any, asked: Any, good: Any) -> np.ndarray:
    """Answer `_ask` on the host, inside of compiled code: nothing here may call JAX."""
    places = [*plan.unknown, *plan.known]
    if last is not None:
        begun, start = good.any(axis=1)[:, None], start.copy()
        start[:, places] = np.where(begun, last, start[:, places])
    found = host_solve.repair_lanes(plan, method, eq, start, asked, ~good)
    rest = np.stack([found.size, found.conditioning, found.status], axis=-1)
    return np.moveaxis(np.concatenate([found.q[..., places], rest], axis=-1).astype(start.dtype), 2, 1)


# -- rates -------------------------------------------------------------------------------------------------------------


def pose_rates(plan: Plan, eq: Equations, q: Coordinates, known: Sequence[Array], ok: Array) -> list[Coordinates]:
    """Time derivatives of all coordinates at one pose; zero where it is not `ok`.

    The k-th derivative of Φ(q(t)) vanishes; what it contains besides Φ_q times the k-th derivative of q is formed by
    differentiating along the curve that the lower derivatives give.

    `known` are first, second, … time derivatives of the known coordinates, each ``(k,)``.
    """
    q = masked_pose(eq, q, ok)
    _, jacobian = plan.linearise(eq, q)
    solve = plan.solver(jacobian, ok)
    still, nothing = jnp.zeros(len(plan.fixed)), jnp.zeros(len(plan.unknown))
    found: list[Coordinates] = []
    for known_rate in known:
        left = along(lambda x: plan.residual(eq, x), q, (*found, plan.join(nothing, known_rate, still)))
        b = jnp.where(ok, left, 0.0)
        found.append(plan.join(-solve(b), jnp.where(ok, known_rate, 0.0), still))
    return found


def with_held(plan: Plan, orders: Sequence[Float[Array, "T driven"]]) -> tuple[Float[Array, "T k"], ...]:
    """Complete the rates of the driven coordinates by those of the held ones, which stand still."""
    return tuple(jnp.concatenate([o, jnp.zeros((o.shape[0], len(plan.held)))], axis=1) for o in orders)


def lane_rates(
    plan: Plan, eq: Equations, q: Float[Array, "T N"], known: Sequence[Array], ok: Array
) -> tuple[Float[Array, "T N"], ...]:
    """Time derivatives of all coordinates at many poses, as `pose_rates` gives them at one.

    Of a few poses by linear solves refined to the residual. Of many, where the kernel is written out, by its
    elimination: it gives the velocity as a function of the pose and of the velocities of the inputs, and the higher
    rates are this function differentiated along the motion.
    """
    if plan.chosen_rows_suffice and writes_out(plan) and q.shape[0] >= fill.LEAST:
        # 2048 lanes of rates at a time, by elements that are written out
        return in_chunks(functools.partial(_written_out, plan, eq), 2048, q, tuple(known), ok)
    if plan.large:
        return lax.map(lambda lane: tuple(pose_rates(plan, eq, *lane)), (q, tuple(known), ok))
    one = jax.vmap(lambda *lane: tuple(pose_rates(plan, eq, *lane)))
    return in_chunks(one, _CHUNK, q, tuple(known), ok)


batch_rates = jit(lane_rates, static_argnums=0)


def _written_out(plan: Plan, eq: Equations, q: Array, known: Sequence[Array], ok: Array) -> tuple[Array, ...]:
    core, lanes = kernel(plan), ok.shape
    go = opaque_true(eq)
    q = jax.vmap(functools.partial(masked_pose, eq))(q, ok)
    x = tuple(q[:, c] for c in range(q.shape[1]))
    inputs = [tuple(jnp.where(ok, o[:, k], 0.0) for k in range(len(plan.known))) for o in known]

    def velocity(x, change):
        x_dot: list[Any] = [None] * len(x)
        for c, d in zip(plan.known, change, strict=True):
            x_dot[int(c)] = d
        found = core.tangent(eq, x, x_dot, ok=ok)
        return tuple(jnp.zeros(lanes) if d is None else jnp.broadcast_to(d, lanes) for d in found)

    found, rate = [], velocity
    for order in range(1, len(known) + 1):
        found.append(fusion_barrier(go, rate, x, *inputs[:order]))
        rate = functools.partial(_along_motion, velocity, rate)
    return tuple(jnp.stack(d, axis=1) for d in found)


def _along_motion(velocity: Callable, rate: Callable, x, *inputs):
    """Differentiate a function of pose and rates of the inputs by time."""
    return jax.jvp(rate, (x, *inputs[:-1]), (velocity(x, inputs[0]), *inputs[1:]))[1]
