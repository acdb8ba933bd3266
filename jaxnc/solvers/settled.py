"""The start pose in traced code: the drawing, if it meets the constraints; else the host assembles it.

A drawing that its dimensions are read off meets them as it is, and most do. Whatever `jax.vmap` maps becomes lanes, so
that the host is asked once for all designs, and only if one of them does not fit; thousands XLA assembles no slower.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.remembered import with_owner
from jaxnc.solvers import host
from jaxnc.solvers.answers import PIECE, ask_host, short
from jaxnc.solvers.assembly import closest
from jaxnc.solvers.mapped import Mapped, in_lanes
from jaxnc.solvers.plan import Plan
from jaxnc.system.equations import Equations
from jaxnc.system.host import from_jax
from jaxnc.system.precision import limits
from jaxnc.types import Array


def settled(plan: Plan, eq: Equations, q: Array) -> tuple[Array, Array]:
    """The pose that meets the constraints, or comes closest to it, and its largest residual; differentiated nowhere.

    The host can read the plan.
    """
    eq, q = lax.stop_gradient((eq, q))
    pose, gap = _settler(plan, True)(eq, q[None])
    return pose[0], gap[0]


@with_owner
def _settler(plan: Plan, shared: bool):
    """The function of equations (of one design, if `shared`) and poses ``(L, N)``."""

    # Compiled as one: NumPy arrays that it holds are then no arguments, which a loop of a line search would map.
    @jax.jit
    def inner(eq, q):
        axes = None if shared else 0
        if max(a.size for a in jax.tree.leaves((short(eq), q))) > PIECE:
            found = jax.vmap(functools.partial(closest, plan), in_axes=(axes, 0))(eq, q)
            return found.q, found.gap
        gap = jax.vmap(lambda eq, q: jnp.max(jnp.abs(plan.residual(eq, q)), initial=0.0), in_axes=(axes, 0))(eq, q)
        fits = gap <= 2.5 * limits(q).floor * eq.length
        answer, as_it_is = (functools.partial(f, plan) for f in (_assembled, _as_it_is))
        like = jax.ShapeDtypeStruct((q.shape[0], q.shape[1] + 1), q.dtype)

        def assemble(state):
            found = ask_host("assembled a drawing", like, answer, short(eq), state[1], fits, given_up=as_it_is)
            return jnp.ones((), bool), found[:, :-1], found[:, -1]

        # A loop that is not entered leaves its numbers where they are; a `cond` would copy them.
        return lax.while_loop(lambda state: ~state[0], assemble, (jnp.all(fits), q, gap))[1:]

    def shapes(eq, q):
        return jax.ShapeDtypeStruct(q.shape, q.dtype), jax.ShapeDtypeStruct(q.shape[:1], q.dtype)

    def mapped(size, which, eq, q):
        of_one, eq, (flat,) = in_lanes(size, shared, which, eq, q)
        found = jax.tree.map(lambda a: a.reshape(size, -1, *a.shape[1:]), _settler(plan, of_one)(eq, flat))
        return found, (True, True)

    return Mapped(inner, shapes, mapped)


def _assembled(plan: Plan, eq: Any, q: np.ndarray, fits: np.ndarray) -> np.ndarray:
    open_ = np.flatnonzero(~fits)
    view = host.HostView(plan, from_jax(eq)).taken(open_)
    with np.errstate(all="ignore"):
        found = host.closest(view, q[open_].T)
    out = _as_it_is(plan, eq, q, fits)
    out[open_] = np.concatenate([found.q, found.gap[None]]).T
    return out


def _as_it_is(plan: Plan, eq: Any, q: np.ndarray, fits: np.ndarray) -> np.ndarray:
    return np.concatenate([q, np.zeros((len(q), 1), q.dtype)], axis=1)
