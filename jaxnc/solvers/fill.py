"""Poses of many inputs solved in lockstep, by a fixed amount of work: what it cannot answer for says so.

This is all that traced code compiles. Sequential work with decisions in it is left to the host (`jaxnc.solvers.host`),
which is asked for the lanes that are not `good`.
"""

import itertools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.solvers import batch, continuation
from jaxnc.solvers.branch import LEADING, SHORT, TURNING
from jaxnc.solvers.kernel import kernel
from jaxnc.solvers.mapped import in_chunks
from jaxnc.solvers.plan import Plan, unwound
from jaxnc.solvers.pose_batch import PoseBatch
from jaxnc.solvers.sequences import in_sequences, scattered_around
from jaxnc.system.equations import Equations
from jaxnc.types import Array, Float

_CHUNK = 256  # lanes that go on together
_LINE = 16  # inputs of a design from which it pays to follow a line of poses first


def in_order(
    plan: Plan, eq: Equations, shared: bool, q: Float[Array, "S N"], values: Float[Array, "S T k"]
) -> PoseBatch:
    """Follow sequences of inputs along their branches; after the first pose that is not good none of a sequence is.

    The equations are of one design (`shared`), or of one for each sequence (first axis of every leaf). Angles of the
    poses that they begin from are counted so that they do.
    """
    count, total = values.shape[:2]
    if kernel(plan).closed:
        return in_sequences(kernel(plan), _lanes(eq, shared), q, values)
    if shared and count == 1 and len(plan.driven) == 1 and batch.pays(plan, total):
        # A sequence of one input goes to and fro on one branch, as far as all of it is reached.
        out = jax.tree.map(lambda a: a[None], batch.solve(plan, eq, q[0], values[0, :, :1], in_order=True))
    else:
        those = _lanes(eq, shared)
        out = in_chunks(lambda at: _together(plan, those(at), q[at], values[at]), _CHUNK, jnp.arange(count))
    order = np.arange(total, dtype=np.int32)
    first = jnp.min(jnp.where(out.good, np.int32(total), order), axis=1, keepdims=True)
    return out._replace(good=order < first)


def one_by_one(
    plan: Plan, eq: Equations, shared: bool, q: Float[Array, "D N"], values: Float[Array, "D B k"], turns: Array
) -> PoseBatch:
    """Poses ``(D, B)`` at inputs of designs, each on the straight way from the design's start pose.

    The equations are of one design (`shared`), or of one for each row of q (first axis of every leaf). `turns` are
    whole turns in the values, of angles that nothing else depends on, from that nearest to the pose.
    """
    designs, each, known = values.shape
    near = unwound(values, turns)
    if each >= _LINE and len(plan.driven) == 1 and kernel(plan).closed:
        return scattered_around(kernel(plan), _lanes(eq, shared), q, near)
    if shared and designs == 1 and batch.pays(plan, each):  # which counts turns by itself
        return jax.tree.map(lambda a: a[None], batch.solve(plan, eq, q[0], values[0, :, : len(plan.driven)]))
    if each > 1:
        owner = np.arange(designs * each) // each
        mine = eq if shared else jax.tree.map(lambda a: a[owner], eq)
        out = in_order(plan, mine, shared, q[owner], near.reshape(-1, 1, known))
        return jax.tree.map(lambda a: a.reshape(designs, each), out)
    return in_order(plan, eq, shared, q, near)


def _lanes(eq: Equations, shared: bool) -> Callable[[Array], Equations]:
    """A function that gives the equations of some sequences, lanes last."""
    if shared:
        return lambda at: eq
    leaves, structure = jax.tree.flatten(eq)
    # Taken out of one array: out of each by itself, that is what compiles longest.
    rows = jnp.concatenate([a.reshape(a.shape[0], -1) for a in leaves], axis=1).T
    ends = np.cumsum([0, *(int(np.prod(a.shape[1:])) for a in leaves)])

    def those(at):
        some = rows[:, at]
        parts = [some[i:j] for i, j in itertools.pairwise(ends)]
        shaped = [p.reshape(*a.shape[1:], p.shape[-1]) for p, a in zip(parts, leaves, strict=True)]
        return jax.tree.unflatten(structure, shaped)

    return those


def _together(plan: Plan, eq: Equations, q: Array, values: Array) -> PoseBatch:
    """Take lanes (first axis of q and values; last of eq) by a fixed number of steps."""
    core, (lanes, total) = kernel(plan), values.shape[:2]
    x = [q[:, c] for c in range(q.shape[1])]
    signs = core.signs(eq, x)
    goal = jnp.moveaxis(values, 0, -1)
    before = jnp.concatenate([q[None, :, plan.known].swapaxes(1, 2), goal[:-1]])
    parts, counts = _substeps(total, len(plan.driven))
    step = continuation.stepper(core, eq, x, signs)

    def value(now, way):
        begin, end, part, count = way
        now = lax.fori_loop(0, count, lambda i, now: step(now, begin + part[i] * (end - begin)), now)
        return now, (*now.x[: len(plan.unknown)], now.size, now.pivots, now.good)

    start = continuation.beginning(core, eq, x, (lanes,))
    _, out = lax.scan(value, start, (before, goal, jnp.asarray(parts), jnp.asarray(counts)))
    *y, size, pivots, good = (a.T for a in out)
    return PoseBatch(tuple(y), size, pivots, good)


def _substeps(total: int, driven: int) -> tuple[np.ndarray, np.ndarray]:
    """Parts of the way to each value after every step, ``(T, most)``, and how many steps there are."""
    between = max(1, -(-TURNING // total))
    even = np.arange(1, between + 1) / between
    shortened = np.append(SHORT / between, even)
    first = np.append(SHORT, np.arange(1, LEADING + 1)) / LEADING
    # Where the way turns (from the start to the first value; anywhere with several inputs) a short step comes first.
    ways = [first, *(shortened if driven > 1 or k == 1 else even for k in range(1, total))]
    parts = np.ones((total, max(len(w) for w in ways)))
    for k, w in enumerate(ways):
        parts[k, : len(w)] = w
    return parts, np.array([len(w) for w in ways])
