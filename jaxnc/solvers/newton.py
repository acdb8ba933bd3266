"""Newton on the unknowns of a plan in traced code, start poses, and the implicit derivative of solutions.

A drawing that its dimensions are read off meets the constraints as it is, and most do. Others are assembled on the
host, which is asked once for all designs that `jax.vmap` maps; thousands XLA assembles no slower.
"""

import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from jaxnc import autodiff
from jaxnc.compiling import in_chunks, jit
from jaxnc.records import with_owner
from jaxnc.solvers import dense, host
from jaxnc.solvers.kernel import kernel, writes_out
from jaxnc.solvers.plan import LargePlan, Plan
from jaxnc.solvers.saddle import saddle
from jaxnc.solvers.traced import PIECE, Mapped, ask_host, in_lanes, refuse_unreadable, shorten_equations
from jaxnc.system.equations import Equations, pure_numbers, weights
from jaxnc.system.host import from_jax
from jaxnc.system.precision import limits, numbers
from jaxnc.types import Array, Coordinates, Numbers, PyTree


def largest(r: Array) -> Array:
    """Largest magnitude, 0 for none."""
    return jnp.max(jnp.abs(r), initial=0.0)


def tolerance(eq: Equations, q: Coordinates) -> Array:
    """Largest residual of a pose that counts as a solution."""
    least = limits(eq.length, eq.rounded)
    return lax.stop_gradient(least.accept * eq.length + least.rounding * largest(weights(eq) * q))


def newton(plan: Plan, eq: Equations, q: Coordinates, iterations: int) -> Coordinates:
    """Undamped Newton or Gauss-Newton from q until rounding stops it: the best pose met.

    Known coordinates of the start pose are at their values.
    """
    floor = limits(eq.length).floor * eq.length

    def more(state):
        i, _, _, _, stop = state
        return (i < iterations) & ~stop

    def improve(state):
        i, q, best, least, _ = state
        r, jacobian = plan.linearise(eq, q)
        size = largest(r)
        better = size < least
        best, least = jnp.where(better, q, best), jnp.where(better, size, least)
        stop = (least <= floor) | (~better & (least <= tolerance(eq, q))) | ~jnp.isfinite(size)
        return i + 1, step_of_newton(plan, eq, q, r, jacobian), best, least, stop

    start = (0, q, q, jnp.full((), jnp.inf), jnp.zeros((), bool))
    return lax.while_loop(more, improve, start)[2]


def step_of_newton(plan: Plan, eq: Equations, q: Coordinates, r: Array, jacobian: Array) -> Coordinates:
    """Return the pose after a step of Newton, or of Gauss and Newton; the pose itself where there is none."""
    weight = weights(eq)[plan.unknown]
    dx = (dense.newton_steps(jacobian / weight, r[:, None], plan.independent) / weight[:, None])[:, 0]
    return plan.move(q, -jnp.where(jnp.all(jnp.isfinite(dx)), dx, 0.0))


def closest_pose(plan: Plan, eq: Equations, q: Coordinates, iterations: int = 200) -> host.Closest:
    """Find a pose that meets the constraints, or comes closest to it, by Levenberg and Marquardt on a plan's unknowns.

    Freedoms may be left: then the pose moves as little as possible. Known coordinates are at their values.
    """
    least = limits(q)
    floor = 2.5 * least.floor * eq.length
    weight = weights(eq)
    inner = weight[plan.unknown]

    def cost(r):
        return jnp.sum(r * r)

    def more(state):
        i, _, r, _, damping, moved, _ = state
        return (i < iterations) & (largest(r) > floor) & (damping < 1e8) & (moved > 2.5 * least.floor)

    def improve(state):
        # One evaluation per iteration: of the trial, kept if it is better.
        i, q, r, slope, damping, _, trial = state
        new, new_slope = plan.linearise(eq, trial)
        better = cost(new) < cost(r)
        moved = jnp.sqrt(jnp.sum((weight * (trial - q)) ** 2)) / eq.length
        q, r = jnp.where(better, trial, q), jnp.where(better, new, r)
        slope = jnp.where(better, new_slope, slope)
        weaker, stronger = jnp.maximum(0.1 * damping, least.damping), jnp.where(i == 0, damping, 10.0 * damping)
        damping = jnp.where(better, weaker, stronger)
        dx = dense.damped_step(slope / inner, r, damping) / inner
        dx = jnp.where(jnp.all(jnp.isfinite(dx)), dx, 0.0)
        return i + 1, q, r, slope, damping, jnp.where(better & (i > 0), moved, 1.0), plan.move(q, -dx)

    m, n = len(plan.rows), len(plan.unknown)
    start = (0, q, jnp.full(m, jnp.inf), jnp.zeros((m, n)), jnp.asarray(1e-2), jnp.ones(()), q)
    _, q, r, slope, *_ = lax.while_loop(more, improve, start)
    return host.Closest(q, largest(r), slope / inner)


def traced_start(plan: Plan, eq: Equations, nudge: Array | np.ndarray, repair: bool) -> host.Closest:
    """Assemble from the drawing moved by `nudge`, ``(N,)``, in traced code; differentiated nowhere.

    The host is asked for what does not fit as it is drawn, without `repair` only for large systems. Nothing is driven
    in the plan.
    """
    if plan.large:
        refuse_unreadable(plan.topology)
    elif not repair or not host.read_kinds(plan):
        return _assemble(plan, eq, nudge)
    eq, q = lax.stop_gradient((eq, eq.home + nudge))
    pose, gap = _assembler(plan, True)(eq, q[None])
    return host.Closest(pose[0], gap[0], None)


@functools.partial(jit, static_argnums=0)
def _assemble(plan: Plan, eq: Equations, nudge: Array) -> host.Closest:
    eq, nudge = lax.stop_gradient((eq, nudge))
    if not len(plan.rows):
        return host.Closest(eq.home + nudge, jnp.zeros(()), jnp.zeros((0, len(plan.unknown))))
    return closest_pose(plan, eq, eq.home + nudge)


@with_owner
def _assembler(plan: Plan, shared: bool):
    """Return the function of equations (of one design, if `shared`) and poses ``(L, N)`` that assembles these."""

    # Compiled as one: NumPy arrays that it holds are then no arguments, which a loop of a line search would map.
    @jax.jit
    def inner(eq, q):
        axes = None if shared else 0
        if not plan.large and max(a.size for a in jax.tree.leaves((shorten_equations(eq), q))) > PIECE:
            found = jax.vmap(functools.partial(closest_pose, plan), in_axes=(axes, 0))(eq, q)
            return found.q, found.gap
        gap = jax.vmap(lambda eq, q: jnp.max(jnp.abs(plan.residual(eq, q)), initial=0.0), in_axes=(axes, 0))(eq, q)
        fits = gap <= 2.5 * limits(q).floor * eq.length
        like = jax.ShapeDtypeStruct((q.shape[0], q.shape[1] + 1), q.dtype)

        def assemble(state):
            given = shorten_equations(eq), state[1], fits
            answer = functools.partial(_assemble_lanes, plan)
            found = ask_host("assembled a drawing", like, answer, *given, given_up=_as_drawn, large=plan.large)
            return jnp.ones((), bool), found[:, :-1], found[:, -1]

        # A loop that is not entered leaves its numbers where they are; a `cond` would copy them.
        return lax.while_loop(lambda state: ~state[0], assemble, (jnp.all(fits), q, gap))[1:]

    def shapes(eq, q):
        return jax.ShapeDtypeStruct(q.shape, q.dtype), jax.ShapeDtypeStruct(q.shape[:1], q.dtype)

    def mapped(size, which, eq, q):
        of_one, eq, (flat,) = in_lanes(size, shared, which, eq, q)
        found = jax.tree.map(lambda a: a.reshape(size, -1, *a.shape[1:]), _assembler(plan, of_one)(eq, flat))
        return found, (True, True)

    return Mapped(inner, shapes, mapped)


def _assemble_lanes(plan: Plan, eq: Equations, q: np.ndarray, fits: np.ndarray) -> np.ndarray:
    """Assemble the poses that do not fit: each with its largest residual behind it, ``(L, N + 1)``."""
    open_ = np.flatnonzero(~fits)
    view = host.view_of(plan, from_jax(eq)).select(open_)
    with np.errstate(all="ignore"):
        found = host.assemble_closest(view, q[open_].T)
    out = _as_drawn(eq, q, fits)
    out[open_] = np.concatenate([found.q, found.gap[None]]).T
    return out


def _as_drawn(eq: Equations, q: np.ndarray, fits: np.ndarray) -> np.ndarray:
    return np.concatenate([q, np.zeros((len(q), 1), q.dtype)], axis=1)


def attach_pose(plan: Plan, q: Coordinates, eq: Equations, known: Array, ok: Array | None = None) -> Coordinates:
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


def attach_start(plan: Plan, q: Coordinates, eq: Equations, size: Numbers, still: tuple[int, ...] = ()) -> Coordinates:
    """Give the start pose its derivatives: it follows the drawing, moved as little as meets the constraints.

    Of a large system, or where some coordinates are `still`, that is exact where the drawing meets the constraints, as
    one does that its dimensions are read off, and otherwise to first order in how far the pose is from it. Coordinates
    that are `still` stay where they are as far as rows allow, and the others follow them.

    Derivatives flow through the equations and the mechanism's size, which these have as a number, not through the pose.
    """
    return autodiff.attach(_start_change, (plan, still), q, eq, size)


def _start_change(static: tuple[Plan, tuple[int, ...]], q: Coordinates, args: tuple, changes: tuple) -> Coordinates:
    (plan, still), (eq, size), (eq_dot, growth) = static, args, changes
    put = np.isin(plan.unknown, still)
    moved = eq_dot.home.at[plan.unknown[put]].set(0.0) if put.any() else eq_dot.home
    if not len(plan.rows):
        return moved
    with numbers(q):
        at = jnp.where(jnp.all(jnp.isfinite(q)), q, eq.home)
        pure, none = pure_numbers(plan.topology)[plan.unknown], jnp.zeros(len(plan.unknown))
        inner = jnp.where(pure, size, 1.0)
        _, left = jax.jvp(plan.residual, (eq, at), (eq_dot, moved))
        if isinstance(plan, LargePlan):
            return plan.move(moved, -plan.least_norm(eq, at)(left))
        jacobian = plan.linearise(eq, at)[1] / inner
        if put.any():  # not every row can be met as some coordinates stay
            for some in (jnp.where(put, 0.0, jacobian), jacobian):
                step = saddle(jnp.eye(len(inner)), some, True)(none, left)[0]
                moved, left = plan.move(moved, -step / inner), left - jacobian @ step
            return moved
        # The rows hold the pose where it is closest to the drawing, by forces that turn as it moves.
        apart = inner * (eq.home - at)[plan.unknown]
        forces = saddle(jnp.eye(len(inner)), jacobian, True)(apart, jnp.zeros(len(left)))[1]

        def hold(eq, x):
            q = plan.join(x / inner, at[plan.known], eq.home[plan.fixed])
            return jax.grad(lambda q: jnp.sum(forces * plan.residual(eq, q)))(q)[plan.unknown] / inner

        x, x_dot = inner * at[plan.unknown], inner * moved[plan.unknown]
        bend = jax.jacfwd(hold, 1)(eq, x)
        _, turn = jax.jvp(hold, (eq, x), (eq_dot, x_dot))
        # Pure numbers count by the size, which grows with the drawing.
        pull = 2.0 * growth / size * pure * apart - turn
        return plan.move(moved, saddle(jnp.eye(len(inner)) + bend, jacobian, True)(pull, -left)[0] / inner)


def attach_lanes(
    plan: Plan, x: tuple[Array, ...], eq: Equations, known: tuple[Array, ...], ok: Array
) -> tuple[Array, ...]:
    """`attach` for very many poses of one design, coordinate by coordinate.

    The plan is written out (see `jaxnc.solvers.kernel.writes_out`). Coordinates are each ``(lanes,)``; it is `ok` where
    derivatives exist.
    """
    return autodiff.attach(_lane_changes if plan.chosen_rows_suffice else _CHANGES, plan, x, eq, known, ok)


def _few_changes(plan: Plan, x: tuple[Array, ...], args: tuple, changes: tuple) -> tuple[Array, ...]:
    """As `_lane_changes`, pose by pose: some ten seconds less to compile where rows are redundant."""
    eq, known, ok = args
    eq_dot, known_dot, _ = changes
    with numbers(x[0]):
        at = plan.join(
            jnp.stack(x),
            jnp.stack([*known, ok])[:-1],
            jnp.broadcast_to(eq.home[plan.fixed, None], (len(plan.fixed), len(ok))),
        )
        rates = jnp.stack([*(jnp.where(ok, d, 0.0) for d in known_dot), jnp.zeros(ok.shape)])[:-1]
        one = jax.vmap(lambda q, u, d, ok: implicit(plan, q, eq, u, eq_dot, d, ok), (1, 1, 1, 0))
        return tuple(one(at, at[plan.known], rates, ok)[:, plan.unknown].T)


def _lane_changes(plan: Plan, x: tuple[Array, ...], args: tuple, changes: tuple) -> tuple[Array, ...]:
    eq, known, ok = args
    eq_dot, known_dot, _ = changes
    with numbers(ok if not x else x[0]):
        change = functools.partial(_changes, plan, eq, eq_dot)
        return in_chunks(jax.checkpoint(change), 2048, x, known, known_dot, ok)  # 2048 lanes, which stay in the cache


def _changes(plan: Plan, eq: Equations, eq_dot: Equations, x, known, known_dot, ok: Array) -> tuple[Array, ...]:
    """Changes of the unknown coordinates with equations and known coordinates, in some lanes."""
    home = lax.stop_gradient(eq.home)
    at: list[Any] = [eq.home[c] for c in range(home.shape[0])]
    for columns, values in ((plan.unknown, x), (plan.known, known)):
        for c, v in zip(columns, values, strict=True):
            at[int(c)] = jnp.where(ok, v, home[int(c)])
    found = _tangent(plan, eq, at, eq_dot, known_dot, ok)
    return tuple(
        jnp.zeros(ok.shape) if found[c] is None else jnp.broadcast_to(found[c], ok.shape) for c in plan.unknown
    )


# From a thousand lanes of redundant rows on, it pays to compile a program of their own.
_CHANGES = autodiff.TwoRules(_few_changes, _lane_changes, 1000)


def _tangent(
    plan: Plan,
    eq: Equations,
    at: Sequence[Array] | Array,
    eq_dot: Equations,
    known_dot: Sequence[Array] | Array,
    ok: Array,
) -> list[Any]:
    """Changes of all coordinates with the equations and the known coordinates; None where there is none.

    Those of the ground and of constants are spread over the lanes together, mapped ones too, so that in reverse there
    is one sum over lanes instead of one for each.
    """
    change: list[Any] = [None] * len(at)
    for k, c in enumerate(plan.known):
        change[int(c)] = jnp.where(ok, known_dot[k], 0.0)
    ground = [] if isinstance(eq_dot.home, np.ndarray) else [int(c) for c in plan.fixed]
    parts, places = [eq_dot.home[np.array(ground, int)]] if ground else [], []
    for b, constants in enumerate(eq_dot.constants):
        if not isinstance(constants, np.ndarray):
            parts.append(constants.reshape(-1))
            places += [(b, i, k) for i, k in np.ndindex(*constants.shape)]
    changes: list[Array] = []
    if count := len(ground) + len(places):
        together = jnp.where(ok, jnp.concatenate(parts).reshape(count, *[1] * ok.ndim), 0.0)
        changes = [part[0] for part in lax.split(together, [1] * count)]
    for c, d in zip(ground, changes, strict=False):
        change[c] = d
    constants_dot = dict(zip(places, changes[len(ground) :], strict=True))
    return kernel(plan).tangent(eq, [at[c] for c in range(len(change))], change, constants_dot, ok)


def implicit(
    plan: Plan,
    q: Coordinates,
    eq: Equations,
    known: Array,
    eq_dot: Equations,
    known_dot: Array,
    ok: Array | None = None,
) -> Coordinates:
    """Differentiate a solution ``(N,)`` by the equations and the known coordinates; zero where it is none."""
    ok = is_regular_solution(plan, eq, q) if ok is None else ok
    at = masked_pose(eq, q, ok)
    if plan.square and writes_out(plan):
        found = _tangent(plan, eq, at, eq_dot, known_dot, ok)
        return jnp.stack([0.0 if d is None else d for d in found])
    known = jnp.where(ok, known, at[plan.known])

    def rows(eq, known):
        return plan.residual(eq, plan.join(at[plan.unknown], known, eq.home[plan.fixed]))

    _, r_dot = jax.jvp(rows, (eq, known), (eq_dot, known_dot))
    _, jacobian = plan.linearise(eq, at)
    dx = plan.solver(jacobian, ok)(jnp.where(ok, r_dot, 0.0))
    return plan.join(-dx, jnp.where(ok, known_dot, 0.0), jnp.where(ok, eq_dot.home[plan.fixed], 0.0))


def is_regular_solution(plan: Plan, eq: Equations, q: Coordinates) -> Array:
    """Say whether a pose is a solution at which derivatives exist; carries no derivative itself."""
    eq, q = lax.stop_gradient((eq, q))
    if plan.square and writes_out(plan):
        found = kernel(plan).diagnose(eq, [q[c] for c in range(q.shape[0])])
        return (found.size <= tolerance(eq, q)) & (found.pivots > limits(q).singular)
    r, jacobian = plan.linearise(eq, q)
    return (largest(r) <= tolerance(eq, q)) & (plan.conditioning(eq, jacobian) > limits(q).singular)


def hold_still(ok: Array, tree: PyTree) -> PyTree:
    """Return a tree whose numbers have no derivatives unless `ok`, also where those behind them are no numbers."""
    if not isinstance(ok, Tracer) and bool(ok):
        return tree
    return jax.tree.map(lambda x: jnp.where(ok, x, lax.stop_gradient(x)) if isinstance(x, Tracer) else x, tree)


def masked_pose(eq: Equations, q: Coordinates, ok: Array) -> Coordinates:
    """Return the pose where `ok`, the drawing elsewhere: what is masked in derivatives must be finite first."""
    return jnp.where(ok, q, lax.stop_gradient(eq.home))
