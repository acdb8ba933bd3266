"""Poses found with 32-bit numbers and finished with 64-bit ones.

What takes many steps is done with narrow numbers, of which a processor calculates twice as many at a time, and many a
graphics processor far more. What is then wanted of a pose (its digits, its status, its derivatives) is made with wide
ones. A pose that is not beyond doubt is found again with wide numbers from the beginning.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from jaxnc.kinematics import many
from jaxnc.kinematics.analysis import finished
from jaxnc.kinematics.columns import Columns
from jaxnc.solvers.chunks import in_chunks
from jaxnc.solvers.kernel import kernel, writes_out
from jaxnc.solvers.look import inspect
from jaxnc.solvers.march import right
from jaxnc.solvers.newton import newton, tolerance
from jaxnc.solvers.plan import Plan
from jaxnc.status import Status
from jaxnc.system.equations import Equations, weights
from jaxnc.system.precision import NARROW, numbers
from jaxnc.types import Array

_NEAR = 1e-2  # of the size: a pose that moves farther has not been polished but lost
_DOUBT = 1e-2  # of the conditioning in the start pose: where it is poorer a dead point is near, and poses part there
_CHUNK = 2048  # lanes at a time
_GROUP = 64  # lanes found again are so many, or a power of two times that


def polished(solve: Callable) -> Callable:
    """`jaxnc.kinematics.analysis.analyse`, or that spread over devices, its poses found with 32-bit numbers first."""

    def whole(*arguments):
        poses, *rest = solve(*arguments)
        return poses.whole() if isinstance(poses, Columns) else poses, *rest

    def analyse(view: Plan, method: str, eq: Equations, q0: Array, values: Array, orders: tuple[Array, ...]):
        found, status = _rough(whole, view, method, *lax.stop_gradient((eq, q0, values)))
        out, sure = _finish(view, eq, q0, jnp.asarray(values), orders, found, status)
        if isinstance(sure, Tracer):
            anew = functools.partial(whole, view, method)
            return lax.cond(jnp.all(sure), lambda *_: out, anew, eq, q0, values, orders)
        left = np.flatnonzero(~np.asarray(sure))
        if not len(left):
            return out
        if method == "continuation":  # a sequence is followed in order
            return whole(view, method, eq, q0, values, orders)
        size = min(len(sure), _GROUP * 2 ** int(np.ceil(np.log2(max(len(left) / _GROUP, 1.0)))))
        left = left[np.minimum(np.arange(size), len(left) - 1)]
        again = whole(view, method, eq, q0, values[left], tuple(o[left] for o in orders))
        return jax.tree.map(lambda a, b: a.at[left].set(b), out, again)

    return analyse


def _rough(solve: Callable, view: Plan, method: str, *arguments: Any) -> tuple[Array, Array]:
    """Poses with 32-bit numbers, and their status."""
    eq, q0, values = jax.tree.map(lambda x: lax.convert_element_type(x, NARROW), arguments)
    with numbers(NARROW):
        if method == "lanes" and many.suits(view, eq, values):
            found = many.solve(view, eq, q0, values)
            assert found is not None
            return found.poses.whole(), found.status
        found = solve(view, method, eq, q0, values, ())
        return found[0], found[2]


@functools.partial(jax.jit, static_argnums=0)
def _finish(view: Plan, eq: Equations, q0: Array, values: Array, orders: tuple, found: Array, status: Array):
    """What an analysis returns, from rough poses; and of which it is sure."""
    frozen, start, inputs = lax.stop_gradient((eq, q0, values))
    held = jnp.broadcast_to(start[view.known[len(view.driven) :]], (inputs.shape[0], len(view.held)))
    known = jnp.concatenate([inputs, held], axis=1)
    rough = lax.convert_element_type(found, start.dtype)
    rough = jax.vmap(lambda q, u: view.join(q[view.unknown], u, frozen.home[view.fixed]))(rough, known)
    poses, good, sizes, pivots = _in_lanes(view, frozen, rough)
    moved = jnp.max(jnp.abs(poses - rough) * weights(frozen), axis=1, initial=0.0)
    usual = _in_lanes(view, frozen, start[None])[-1]
    sure = good & (moved <= _NEAR * frozen.length) & (pivots > _DOUBT * usual) & (status == int(Status.CONVERGED))
    status = jnp.where(sure, int(Status.CONVERGED), int(Status.DID_NOT_ASSEMBLE))
    return finished(view, eq, q0, values, orders, jnp.where(sure[:, None], poses, start), status, sizes, pivots), sure


def _in_lanes(view: Plan, eq: Equations, q: Array) -> tuple[Array, Array, Array, Array]:
    """The last steps of Newton's method: poses, whether they are right, residuals and conditioning."""
    return in_chunks(functools.partial(_written if writes_out(view) else _one_by_one, view, eq), _CHUNK, q)


def _written(view: Plan, eq: Equations, q: Array) -> tuple[Array, Array, Array, Array]:
    core, lanes = kernel(view), q.shape[:1]
    x = [q[:, c] for c in range(q.shape[1])]
    signs = core.signs(eq, x)
    found = core.solve(eq, x, signs)
    poses = jnp.stack([jnp.broadcast_to(c, lanes) for c in found.x], axis=1)
    good, size, pivots = (jnp.broadcast_to(a, lanes) for a in (right(eq, found, signs), found.size, found.pivots))
    return poses, good, size, pivots


def _one_by_one(view: Plan, eq: Equations, q: Array) -> tuple[Array, Array, Array, Array]:
    def one(q):
        pose, _ = newton(view, eq, q, 4)
        look, before = inspect(view, eq, pose), view.linearise(eq, q)[1]
        same = view.alike(view.linearise(eq, pose)[1], before)
        return pose, look.upright & same & (look.size <= tolerance(eq, pose)), look.size, look.pivots

    return jax.vmap(one)(q)
