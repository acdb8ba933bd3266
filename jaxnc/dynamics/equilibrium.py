"""Static equilibrium: where forces do no work on any motion that the constraints admit, and whether it is stable."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.autodiff import attach
from jaxnc.calls import public
from jaxnc.compiling import filter_jit, on_device
from jaxnc.dynamics.extended import extended, lift, lower
from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.model import blame_force, check_loads, dynamics, forces, potential
from jaxnc.dynamics.reactions import Reactions, motion_reactions
from jaxnc.dynamics.start import assemble_pose, check_pose, read_numbers
from jaxnc.errors import AssemblyError, InputError, nearest
from jaxnc.kinematics.inputs import doubt_degrees, in_radians, outside
from jaxnc.kinematics.motion import Motion
from jaxnc.records import record
from jaxnc.solvers import dense
from jaxnc.solvers.dense import solver
from jaxnc.solvers.newton import largest
from jaxnc.solvers.saddle import saddle
from jaxnc.status import Status
from jaxnc.system.equations import guards, refuse_rates, residual, weights
from jaxnc.system.precision import as_its_system, limits, more_digits, numbers
from jaxnc.system.system import System
from jaxnc.types import Array, Inputs

_METHODS = ("minimum", "newton")


@public
@record
class Equilibrium:
    """A pose in which the forces are in equilibrium.

    Attributes:
        motion: the pose, at rest; ``equilibrium["P"]`` is short for ``equilibrium.motion["P"]``.
        multipliers: Lagrange multipliers of all rows, ``(rows,)``.
        stiffness: eigenvalues of the stiffness on the admissible motions, coordinates as lengths, smallest first, N/m.
        unbalanced: largest force that is left on an admissible motion, N.
    """

    motion: Motion
    multipliers: Array
    stiffness: Array
    unbalanced: Array

    def __getitem__(self, name: str) -> Array:
        """A point, vector or coordinate."""
        return self.motion[name]

    def __repr__(self) -> str:
        name, top = self.motion.system.name, self.motion.system.topology
        if isinstance(self.stiffness, Tracer) or self.stiffness.ndim != 1:
            return f"Equilibrium({name!r})"
        at = top.write_values({n: self[n] for n in self.motion.system.independent or top.scalars[:1]})
        if self.motion.status != 0:
            return f"Equilibrium({name!r}: none was found, given up at {at})"
        indifferent = np.size(self.stiffness) and np.asarray(self.stiffness)[0] == 0.0
        said = "stable" if self.stable else "indifferent" if indifferent else "not stable"
        return f"Equilibrium({name!r}: {said}, at {at})"

    @property
    def stable(self) -> Array:
        """True where every admissible motion meets a restoring force: the potential energy is at a minimum.

        False where some motion meets no force at all: there the equilibrium is indifferent, and its stiffness zero;
        and where no equilibrium was found.
        """
        restored = self.stiffness[..., 0] > 1e-9 * jnp.max(jnp.abs(self.stiffness), axis=-1)
        return restored & (self.motion.status == 0)

    @property
    def reactions(self) -> Reactions:
        """Reactions in the joints."""
        return motion_reactions(self.motion, self.multipliers)


@public
@as_its_system
def equilibrium(
    system: System,
    state: Motion | Inputs | None = None,
    method: str = "minimum",
    hold: Mapping[str, Any] | None = None,
    throw: bool | None = None,
    unit: str | None = None,
) -> Equilibrium:
    """Find a static equilibrium.

    Args:
        system: the system.
        state: where to begin, as in `jaxnc.simulate`; the assembled drawing if not given.
        method: ``"minimum"`` follows the forces down to a minimum of the potential energy; ``"newton"`` goes to the
            nearest equilibrium, stable or not.
        hold: coordinates that are held at these values, which are gone to along the branch of the start;
            `Equilibrium.reactions` then say what it takes.
        throw: raise `AssemblyError` if none is found. Default: outside of traced code.
        unit: what angles of `state` and `hold` are given in, ``"rad"`` or ``"deg"``.

    Returns:
        The equilibrium with its stability. Pose and reactions are differentiable, to any order, with respect to the
        system and what is held; the stiffness is not, `jaxnc.linearise` has frequencies that are.

    Raises:
        InputError: unknown names or method.
        AssemblyError: no equilibrium was found, if `throw`.
    """
    check_loads(system, "equilibrium()")
    if method not in _METHODS:
        raise InputError(f"method={method!r}; use one of {', '.join(_METHODS)}")
    refuse_rates(system.topology, "equilibrium", "where it rests depends on its way there: simulate() it with damping")
    if hold is not None and not isinstance(hold, Mapping):
        raise InputError(f"equilibrium: hold= takes values by name such as {{'phi': 1.0}}, got {hold!r}")
    doubt_degrees(system, unit, state, hold)
    state, hold = in_radians(system, unit, state, hold)
    inner = extended(system)
    dyn = dynamics(inner)
    for name in hold or ():
        if name not in system.topology.position:
            raise InputError(f"{system.topology.name!r} has no coordinate {name!r} to hold; "
                             f"{nearest(name, system.topology.coordinates)}")  # fmt: skip
    drives = tuple((name, _hold) for name in hold or ())
    asked = tuple((read_numbers(value, f"hold: {name!r}"),) for name, value in (hold or {}).items())
    flow = dataclasses.replace(Flow.of(dyn, system.degrees_of_freedom, drives), drive_args=asked)
    if hold and state is None and len(hold) == system.degrees_of_freedom:
        state = hold  # nothing else to find: the drawing's branch is followed to there
    # The search has no derivatives, and is the same program with and without them: they follow from where it ends.
    still, given = jax.lax.stop_gradient((system, check_pose(system, state)))
    begin = lift(system.topology, assemble_pose(still, given, throw is not False))
    q, lam, values, left, gap, status = _find(jax.lax.stop_gradient(flow), begin, method == "minimum")
    q, rows, held = _attach(flow, q, lam, status == 0)
    q = lower(system.topology, q)
    zero, least = on_device([np.zeros(q.shape, q.dtype), np.zeros((), q.dtype)])
    motion = Motion(system, tuple(n for n, _ in drives), (), q, (zero, zero), held, status, gap, None, least)
    if throw:
        outside(status, "throw=True")
    if throw is not False and not isinstance(status, Tracer) and int(status):
        if not np.isfinite(left) and (culprit := blame_force(dyn, jnp.zeros(()), begin, jnp.zeros_like(begin))):
            raise InputError(f"{system.name!r}: force {culprit!r} is not finite where the search begins")
        why = {
            Status.NOT_REACHED: "what is held does not come to its values on the branch that the search begins on: a "
            "dead point is in the way, or held coordinates depend on each other",
            Status.TOO_FAR: "and after 2000 steps the search is still on its way: it is very far, or nowhere",
        }.get(Status(int(status)), f"the constraints are met to {float(gap):.3g}")
        raise AssemblyError(
            f"{system.name!r}: no equilibrium was found from here; a force of {float(left):.3g} N is left, {why}. "
            f"Begin elsewhere with state=, or give it springs or gravity that hold it{more_digits(left)}"
        )
    free = max(system.degrees_of_freedom - len(drives), 1)
    return Equilibrium(motion, rows, values[:free], left)


def _hold(t: Array, value: Array) -> Array:
    """Return what a coordinate is held at, as a function of time."""
    return 0.0 * t + value


def _residual_forces(flow: Flow, q: Array, lam: Array) -> Array:
    """Return what the forces and the rows together leave on the unknowns, ``(n,)``: zero in an equilibrium."""
    _, j = flow.view.linearise(flow.dyn.eq, q)
    return -forces(flow.dyn, jnp.zeros(()), q, jnp.zeros_like(q))[flow.view.unknown] + j.T @ lam


def _stiffness(flow: Flow, q: Array, lam: Array) -> Array:
    """Differentiate `_unbalanced` by the unknowns as lengths; symmetric where all forces have a potential."""
    u = flow.view.unknown
    weight = weights(flow.dyn.eq)[u]
    return jax.jacfwd(lambda x: _residual_forces(flow, q.at[u].set(x), lam))(q[u]) / (weight[:, None] * weight[None])


def _admissible_motions(j: Array) -> tuple[Callable[[Array, Array], tuple[Array, Array]], Array]:
    """Return the solver for the nearest motion that rows ``(m, n)`` admit, and the projection on these motions."""
    eye = jnp.eye(j.shape[1])
    solve = saddle(eye, j, True)
    return solve, jax.vmap(lambda e: solve(e, jnp.zeros(j.shape[0]))[0], out_axes=1)(eye)


def _neutral(values: Array) -> Array:
    """Tell of stiffnesses, in parts of the largest, which are none: a motion that meets less is indifferent."""
    return jnp.abs(values) < 10.0 * limits(values).nothing


def _largest_stiffness(k: Array, f: Array, length: Array) -> Array:
    """Return the largest stiffness, 1 where there is none at all.

    Forces that balance have one by their size alone: of that size is what cancels in a stiffness that is none.
    """
    size = jnp.maximum(largest(k), largest(f) / length)
    return jnp.where(size > 0, size, 1.0)


def _admissible_stiffness(k: Array, p: Array) -> tuple[Array, Array]:
    """Return stiffnesses on the admissible motions, smallest first, and these as columns.

    The stiffness `k` ``(n, n)`` is of size one, or zero; `p` is the projection on what is admissible. Other motions are
    made stiffer than any of these, and come last.
    """
    stiff = p @ k @ p + 4.0 * len(k) * (jnp.eye(len(k)) - p)
    return dense.symmetric_eigen(0.5 * (stiff + stiff.T))


def _indifferent(k: Array, p: Array) -> Array:
    """Project on the admissible motions that meet no force: a step along them is not determined, and left out."""
    values, vectors = _admissible_stiffness(k, p)
    return (vectors * _neutral(values)) @ vectors.T


def _balanced_change(_: None, found: tuple[Array, Array], args: tuple, changes: tuple) -> tuple[Array, Array]:
    """Change an equilibrium and its multipliers with the design: forces stay balanced, and rows are met."""
    flow, ok = args
    with numbers(found[0]):
        return _change_equilibrium(found, flow, ok, changes)


def _change_equilibrium(found: tuple[Array, Array], flow: Flow, ok: Array, changes: tuple) -> tuple[Array, Array]:
    view, eq = flow.view, flow.dyn.eq
    q, lam = jnp.where(ok, found[0], eq.home), jnp.where(ok, found[1], 0.0)

    def imbalance(flow: Flow) -> tuple[Array, Array, Array]:
        at = q.at[view.fixed].set(flow.dyn.eq.home[view.fixed])
        at = at.at[view.known].set(flow.drive_values(jnp.zeros(()))[0])
        return at, _residual_forces(flow, at, lam), residual(flow.dyn.eq, at)[view.rows]

    change = jax.tree.map(lambda d: d if d.dtype == jax.dtypes.float0 else jnp.where(ok, d, 0.0), changes[0])
    at, wrong, miss = (jnp.where(ok, x, 0.0) for x in jax.jvp(imbalance, (flow,), (change,))[1])
    weight = weights(eq)[view.unknown]
    j, k = view.linearise(eq, q)[1] / weight, _stiffness(flow, q, lam)
    f = forces(flow.dyn, jnp.zeros(()), q, jnp.zeros_like(q))[view.unknown] / weight
    spread = jax.lax.stop_gradient(_largest_stiffness(k, f, eq.length))
    k, (rows, p) = k / spread, _admissible_motions(j)
    still = _indifferent(*jax.lax.stop_gradient((0.5 * (k + k.T), p)))
    dx = rows(jnp.zeros(len(k)), -miss)[0]
    force = wrong / weight / spread
    # Along a motion that meets no force nothing says where it goes: it stays.
    dx = dx - solver(p @ k @ p + jnp.eye(len(k)) - p + still)((p - still) @ (force + k @ dx))
    return view.move(at, dx / weight), rows(-force - k @ dx, jnp.zeros_like(miss))[1] * spread


@record
class _Place:
    """A place on the way to an equilibrium."""

    f: Array  # forces on the unknowns, coordinates as lengths
    free: Array  # what the rows leave of them
    lam: Array  # multipliers of the rows
    j: Array  # derivatives of the rows, coordinates as lengths
    k: Array  # stiffness that a potential would have
    p: Array  # projection on the motions that the rows admit
    energy: Array  # the potential, where it has to fall
    other: Array  # forces that have none


def _is_upright(flow: Flow, q: Array) -> Array:
    """Say whether a pose is finite, and no row and no body of it is met by a mirror image or half a turn away."""
    return jnp.isfinite(q).all() & jnp.all(jnp.concatenate(guards(flow.dyn.eq, q)) > 0.0)


def _approach_held(flow: Flow, q: Array) -> tuple[Array, Array]:
    """Follow the branch from a pose to what is held, the others moved as little as they can be.

    Returns:
        The pose, the last one on the branch where that does not lead there; whether it does.
    """
    known, eq, asked = flow.view.known, flow.dyn.eq, flow.drive_values(jnp.zeros(()))[0]

    def meets(q: Array) -> Array:
        return largest(residual(eq, q)[flow.view.rows]) <= 10 * limits(q, eq.rounded).accept * eq.length

    # 20 corrections of a start, which may be far off. A pose of another design may hold what this one cannot.
    starts = jnp.stack([q, q.at[known].set(asked)])
    starts = jax.lax.map(lambda q: flow.project_position(q, 20), starts)
    q = jnp.where(meets(starts[0]), *starts)
    begin, change = q[known], asked - q[known]
    most = 0.1 / jnp.maximum(0.1, largest(weights(eq)[known] * change) / eq.length)  # of the way: a tenth of the size

    def more(state):
        way, step, _ = state
        return (way < 1.0) & (step > 1e-4 * most)

    def follow(state):
        way, step, q = state
        now = jnp.minimum(way + step, 1.0)
        new = flow.project_position(q.at[known].set(begin + now * change), 6)
        near = largest(weights(eq) * (new - q)) <= eq.length  # a step that leaps has left the branch
        good = meets(new) & near & _is_upright(flow, new)
        step = jnp.where(good, jnp.minimum(1.5 * step, most), 0.5 * step)
        return jnp.where(good, now, way), step, jnp.where(good, new, q)

    way, _, q = jax.lax.while_loop(more, follow, (jnp.zeros(()), most, q))
    return q, way >= 1.0


@filter_jit
def _find(flow: Flow, q: Array, downhill: bool):
    view, u = flow.view, flow.view.unknown
    weight = weights(flow.dyn.eq)[u]
    # What is nearest is measured in lengths here: there may be no masses.
    flow = dataclasses.replace(flow, ready=(weight, jnp.ones(()), jnp.eye(len(u))))
    home = jnp.asarray(flow.dyn.eq.home)[view.fixed]
    q = q.at[view.fixed].set(home)
    q, reached = _approach_held(flow, q) if flow.drives else (flow.project_position(q, 20), True)
    length, least = flow.dyn.eq.length, limits(q)

    def evaluate(q) -> _Place:
        every = forces(flow.dyn, jnp.zeros(()), q, jnp.zeros_like(q))
        f = every[u] / weight
        _, j = view.linearise(flow.dyn.eq, q)
        j = j / weight
        rows, p = _admissible_motions(j)
        free, lam = rows(f, jnp.zeros(j.shape[0]))
        energy, slope = jax.value_and_grad(lambda x: potential(flow.dyn, x))(q) if downhill else (jnp.zeros(()), q)
        k = _stiffness(flow, q, lam)
        return _Place(f, free, lam, j, 0.5 * (k + k.T), p, energy, every + slope)

    def more(state):
        i, *_, stop = state
        return (i <= 2000) & ~stop

    def step(state):
        """Take a trial or not, and make the next: so everything is asked in one line of the program, the start too."""
        i, q, at, new, far, shift, reach, _ = state
        now, size = evaluate(new), jnp.maximum(largest(at.f), least.tiny)
        # What is gained on the way: of the potential, less the work of the loads that have none.
        gain = now.energy - at.energy - 0.5 * jnp.dot(at.other + now.other, new - q)
        # Differences of energies are known to the rounding of the energies; forces may be none where springs balance.
        better = gain <= least.rounding * (size * length + jnp.abs(at.energy)) if downhill else jnp.ones((), bool)
        good = (i == 0) | ((_is_upright(flow, new) if downhill else jnp.isfinite(new).all()) & better)
        q, at = jax.tree.map(lambda new, old: jnp.where(good, new, old), (new, now), (q, at))
        shift = jnp.where(good, 0.1 * shift, jnp.maximum(10.0 * shift, 1e-4))
        shift = jnp.where(shift < 1e-8, 0.0, shift)
        # A way of more than 40 steps is a long one: they grow to the size, while each of them is good.
        reach = jnp.where(good & (i > 40), jnp.minimum(1.5 * reach, 1.0), 0.2)
        balanced = largest(at.free) <= least.force * jnp.maximum(largest(at.f), least.tiny)
        stop = (i > 0) & (balanced | (far < 2.5 * least.floor * length) | (shift > 1e8))
        k, p = at.k, at.p
        spread = _largest_stiffness(k, at.f, length)
        if downhill:
            # Newton on the admissible motions, every one of them taken as stiff as it is curved: downhill in any case.
            values, vectors = dense.symmetric_eigen(p @ k @ p)
            floor = 1e-6 * jnp.where(_neutral(values / spread), spread, largest(k))  # rounding is no stiffness
            stiff = jnp.maximum(jnp.abs(values), floor) + shift * spread
            dx = vectors @ ((vectors.T @ at.free) / stiff)
            dx = p @ dx
        else:
            rows = saddle(k / spread + _indifferent(k / spread, p), at.j, True)
            dx, _ = rows(at.free / spread, jnp.zeros(at.j.shape[0]))
        # What is balanced stays: where it meets no stiffness, rounding would send it anywhere.
        dx = jnp.where(balanced, 0.0, dx * jnp.minimum(1.0, reach * length / jnp.maximum(largest(dx), least.tiny)))
        new = flow.project_position(view.move(q, dx / weight), 4)
        return i + 1, q, at, new, largest(dx), shift, reach, stop

    none = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(evaluate, q))
    begin = (0, q, none, q, jnp.zeros(()), jnp.zeros(()), jnp.full((), 0.2), jnp.zeros((), bool))
    _, q, at, *_, stopped = jax.lax.while_loop(more, step, begin)
    f, lam, k, p = at.f, at.lam, at.k, at.p
    left = largest(at.free)
    gap = largest(residual(flow.dyn.eq, q)[view.rows])
    spread = _largest_stiffness(k, f, length)
    # Where no row bears them the forces themselves are zero: then what rounding of the places makes of the stiffness.
    rounding = jnp.maximum(least.balance * jnp.maximum(largest(f), least.tiny), least.rounding * largest(k) * length)
    found = (left <= rounding) & (gap <= 10 * limits(gap, flow.dyn.eq.rounded).accept * length) & _is_upright(flow, q)
    lost = jnp.where(stopped, int(Status.DID_NOT_ASSEMBLE), int(Status.TOO_FAR))
    status = jnp.where(reached, jnp.where(found, 0, lost), int(Status.NOT_REACHED))
    values, _ = _admissible_stiffness(k / spread, p)
    values = jnp.where(_neutral(values), 0.0, spread * values)  # rounding is no stiffness
    return jnp.where(jnp.isfinite(q), q, 0.0), lam, values, left, gap, status


@filter_jit
def _attach(flow: Flow, q: Array, lam: Array, ok: Array) -> tuple[Array, Array, Array]:
    """Attach to an equilibrium how it changes with the design; return it, multipliers of all rows, what is held."""
    q, lam = attach(_balanced_change, None, (q, lam), flow, ok)
    rows = jnp.zeros(len(flow.dyn.topology.rows)).at[flow.view.rows].set(lam)
    return q, rows, flow.drive_values(jnp.zeros(()))[0]
