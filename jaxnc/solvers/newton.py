"""Newton on the unknowns of a plan, and the implicit derivative of its solutions."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc import autodiff
from jaxnc.solvers import dense
from jaxnc.solvers.kernel import kernel, writes_out
from jaxnc.solvers.mapped import in_chunks
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.rows import Place
from jaxnc.system.equations import Equations, weights
from jaxnc.system.precision import limits, numbers
from jaxnc.types import Array, Coordinates

_DAMPING = 1e-11  # of the matrix of a start pose's derivative, whose rows may be redundant
_BESIDE = 1e-8  # of the same where some coordinates stay, and not every row can be met
_LANES = 2048  # whose derivatives are made together: they stay in the cache


def largest(r: Array) -> Array:
    """Largest magnitude, 0 for none."""
    return jnp.max(jnp.abs(r), initial=0.0)


def tolerance(eq: Equations, q: Coordinates) -> Array:
    """Largest residual of a pose that counts as a solution."""
    least = limits(eq.length)
    return lax.stop_gradient(least.accept * eq.length + least.rounding * largest(weights(eq) * q))


def newton(plan: Plan, eq: Equations, q: Coordinates, iterations: int) -> tuple[Coordinates, Array]:
    """Undamped Newton or Gauss-Newton from q until rounding stops it: the best pose met and its largest residual.

    Known coordinates of the start pose are at their values.
    """
    floor = limits(eq.length).floor * eq.length

    def more(state):
        i, _, _, _, stop = state
        return (i < iterations) & ~stop

    def improve(state):
        i, q, best, least, _ = state
        r, jacobian, _ = plan.linearise(eq, q)
        size = largest(r)
        better = size < least
        best, least = jnp.where(better, q, best), jnp.where(better, size, least)
        stop = (least <= floor) | (~better & (least <= tolerance(eq, q))) | ~jnp.isfinite(size)
        dx = plan.steps(eq, jacobian, r[:, None])[:, 0]
        dx = jnp.where(jnp.all(jnp.isfinite(dx)), dx, 0.0)
        return i + 1, plan.move(q, -dx), best, least, stop

    start = (0, q, q, jnp.full((), jnp.inf), jnp.zeros((), bool))
    _, _, best, least, _ = lax.while_loop(more, improve, start)
    return best, least


def attach(plan: Plan, q: Coordinates, eq: Equations, known: Array, ok: Array | None = None) -> Coordinates:
    """Give a solution its derivatives by the implicit function theorem; the value passes through unchanged.

    Args:
        plan: what was solved for (static).
        q: the pose, solved elsewhere and never differentiated itself.
        eq: the equations; derivatives flow through them (constants, ground points).
        known: values of driven and held coordinates; derivatives flow through them.
        ok: whether the pose is a solution at which derivatives exist, if that has been found out.

    Returns:
        The pose. Where it is no solution, or a singular one, its derivative is zero.
    """
    return autodiff.attach(_pose_change, plan, q, eq, known, ok)


def _pose_change(plan: Plan, q: Coordinates, args: tuple, changes: tuple) -> Coordinates:
    eq, known, ok = args
    eq_dot, known_dot, _ = changes
    with numbers(q):
        return implicit(plan, q, eq, known, eq_dot, known_dot, ok)


def attach_start(plan: Plan, q: Coordinates, eq: Equations, still: tuple[int, ...] = ()) -> Coordinates:
    """Give the start pose its derivatives: it follows the drawing, moved as little as meets the constraints.

    Exact where the drawing meets them, as one does that its dimensions are read off; otherwise to first order in how
    far the pose is from it.

    Derivatives flow through the equations, not through the pose. Of a large system every coordinate follows its own of
    the drawing. Coordinates that are `still` stay where they are as far as rows allow, and the others follow them.
    """
    return autodiff.attach(_start_change, (plan, still), q, eq)


def _start_change(static: tuple[Plan, tuple[int, ...]], q: Coordinates, args: tuple, changes: tuple) -> Coordinates:
    (plan, still), eq, eq_dot = static, *args, *changes
    put = np.isin(plan.unknown, still)
    moved = eq_dot.home.at[plan.unknown[put]].set(0.0) if put.any() else eq_dot.home
    if plan.large or not len(plan.rows):
        return moved
    with numbers(q):
        at = jnp.where(jnp.all(jnp.isfinite(q)), q, eq.home)
        inner = weights(eq)[plan.unknown]
        jacobian = plan.linearise(eq, at)[1] / inner
        _, left = jax.jvp(plan.residual, (eq, at), (eq_dot, moved))
        if put.any():
            step = _least(jnp.where(put, 0.0, jacobian), _BESIDE, 2) @ left
            moved, left = plan.move(moved, -step / inner), left - jacobian @ step
        return plan.move(moved, -(_least(jacobian, _DAMPING, 1) @ left) / inner)


def _least(jacobian: Array, damping: float, times: int) -> Array:
    """The pseudoinverse ``(n, m)`` of a matrix whose rows may be redundant."""
    every = jnp.eye(len(jacobian))
    normal = jacobian @ jacobian.T
    normal = normal + damping * jnp.trace(normal) / len(normal) * every
    back = jacobian.T @ lax.custom_linear_solve(lambda x: normal @ x, every, _factorised(normal), symmetric=True)
    first = back
    for _ in range(times):  # what damping leaves of a change, little as it is, is taken up once more
        back = back + first @ (every - jacobian @ back)
    return back


def _factorised(matrix: Array):
    return lambda _, right: dense.cholesky_solve(lax.stop_gradient(matrix), right)


def attach_lanes(
    plan: Plan, x: tuple[Array, ...], eq: Equations, known: tuple[Array, ...], ok: Array
) -> tuple[Array, ...]:
    """`attach` for very many poses of one design, coordinate by coordinate.

    The plan is square, and written out (see `jaxnc.solvers.kernel.writes_out`). Coordinates are each
    ``(lanes,)``; it is `ok` where derivatives exist.
    """
    return autodiff.attach(_lane_changes, plan, x, eq, known, ok)


def _lane_changes(plan: Plan, x: tuple[Array, ...], args: tuple, changes: tuple) -> tuple[Array, ...]:
    eq, known, ok = args
    eq_dot, known_dot, _ = changes
    with numbers(ok if not x else x[0]):
        change = functools.partial(_changes, plan, eq, eq_dot)
        return in_chunks(jax.checkpoint(change), _LANES, x, known, known_dot, ok)


def _changes(plan: Plan, eq: Equations, eq_dot: Equations, x, known, known_dot, ok: Array) -> tuple[Array, ...]:
    """Changes of the unknown coordinates with equations and known coordinates, in some lanes."""
    home = lax.stop_gradient(eq.home)
    at: list[Any] = [eq.home[c] for c in range(home.shape[0])]
    change: list[Any] = [None] * len(at)
    for columns, values in ((plan.unknown, x), (plan.known, known)):
        for c, v in zip(columns, values, strict=True):
            at[int(c)] = jnp.where(ok, v, home[int(c)])
    for c, d in zip(plan.known, known_dot, strict=True):
        change[int(c)] = jnp.where(ok, d, 0.0)
    ground, constants = _drawing_changes(plan, eq_dot, ok)
    for c, d in ground.items():
        change[c] = d
    found: list[Any] = kernel(plan).tangent(eq, at, change, constants, ok)
    return tuple(
        jnp.zeros(ok.shape) if found[c] is None else jnp.broadcast_to(found[c], ok.shape) for c in plan.unknown
    )


def _drawing_changes(plan: Plan, eq_dot: Equations, ok: Array) -> tuple[dict[int, Array], dict[Place, Array]]:
    """Changes of the ground's coordinates and of constants, as far as there are any; zero where it is not `ok`.

    They are spread over the lanes together, mapped ones too, so that in reverse there is one sum over lanes instead of
    one for each.
    """
    ground = [] if isinstance(eq_dot.home, np.ndarray) else [int(c) for c in plan.fixed]
    parts, places = [eq_dot.home[np.array(ground, int)]] if ground else [], []
    for b, constants in enumerate(eq_dot.constants):
        if not isinstance(constants, np.ndarray):
            parts.append(constants.reshape(-1))
            places += [(b, i, k) for i, k in np.ndindex(*constants.shape)]
    count = len(ground) + len(places)
    if not count:
        return {}, {}
    together = jnp.where(ok, jnp.concatenate(parts).reshape(count, *[1] * ok.ndim), 0.0)
    changes = [part[0] for part in lax.split(together, [1] * count)]
    return dict(zip(ground, changes, strict=False)), dict(zip(places, changes[len(ground) :], strict=True))


def implicit(
    plan: Plan,
    q: Coordinates,
    eq: Equations,
    known: Array,
    eq_dot: Equations,
    known_dot: Array,
    ok: Array | None = None,
) -> Coordinates:
    """Change of a solution ``(N,)`` with the equations and the known coordinates; zero where it is none."""
    ok = solved(plan, eq, q) if ok is None else ok
    at = regular(eq, q, ok)
    if plan.square and writes_out(plan):
        change: list[Any] = [None] * at.shape[0]
        for k, c in enumerate(plan.known):
            change[int(c)] = jnp.where(ok, known_dot[k], 0.0)
        ground, constants = _drawing_changes(plan, eq_dot, ok)
        for c, d in ground.items():
            change[c] = d
        found: list[Any] = kernel(plan).tangent(eq, [at[c] for c in range(at.shape[0])], change, constants, ok)
        return jnp.stack([0.0 if d is None else d for d in found])
    known = jnp.where(ok, known, at[plan.known])

    def rows(eq, known):
        return plan.residual(eq, plan.join(at[plan.unknown], known, eq.home[plan.fixed]))

    _, r_dot = jax.jvp(rows, (eq, known), (eq_dot, known_dot))
    _, jacobian, _ = plan.linearise(eq, at)
    dx = plan.solver(jacobian, ok)(jnp.where(ok, r_dot, 0.0))
    return plan.join(-dx, jnp.where(ok, known_dot, 0.0), jnp.where(ok, eq_dot.home[plan.fixed], 0.0))


def solved(plan: Plan, eq: Equations, q: Coordinates) -> Array:
    """Whether a pose is a solution at which derivatives exist; carries no derivative itself."""
    eq, q = lax.stop_gradient((eq, q))
    if plan.square and writes_out(plan):
        size, pivots, _, _ = kernel(plan).evaluate(eq, [q[c] for c in range(q.shape[0])])
        return (size <= tolerance(eq, q)) & (pivots > limits(q).singular)
    r, jacobian, _ = plan.linearise(eq, q)
    return (largest(r) <= tolerance(eq, q)) & (plan.conditioning(eq, jacobian) > limits(q).singular)


def regular(eq: Equations, q: Coordinates, ok: Array) -> Coordinates:
    """The pose where `ok`, the drawing elsewhere: derivatives of failed poses are masked, and must be finite first."""
    return jnp.where(ok, q, lax.stop_gradient(eq.home))
