"""Linearisation about an equilibrium or a steady motion: natural frequencies, modes, state-space matrices."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.compiling import filter_jit, jit, on_device
from jaxnc.dynamics.equilibrium import Equilibrium
from jaxnc.dynamics.extended import extended, lift, lower
from jaxnc.dynamics.flow import Flow, evaluate_rows
from jaxnc.dynamics.model import check_loads, dynamics, forces
from jaxnc.dynamics.start import Rates, assemble_pose, check_begin, check_start, start_rates
from jaxnc.errors import InputError, brief, nearest
from jaxnc.internals import values_behind
from jaxnc.kinematics.inputs import array, finite, outside
from jaxnc.kinematics.motion import Motion
from jaxnc.records import record, static
from jaxnc.solvers import dense
from jaxnc.solvers.plan import plan
from jaxnc.solvers.saddle import saddle
from jaxnc.system.equations import refuse_rates, weights
from jaxnc.system.precision import as_its_system, limits
from jaxnc.system.system import System
from jaxnc.types import Array, Inputs


@public
@record
class Linearisation:
    """The motion near a state, in independent coordinates z: ``M δz̈ + C δż + K δz = Rᵀ f``.

    Mapped by `jax.vmap`, all that follows but `mode` is of each state, by the same leading axes.

    Attributes:
        motion: the state.
        coordinates: names of the independent coordinates. In traced code that was given none they are
            `System.independent`; of a state at which these say little of the motion, z are as many orthonormal
            directions of it, lengths. In an equilibrium their frequencies, eigenvalues and modes are the same.
        mass: M, ``(g, g)``.
        damping: C (with what gyroscopic forces add), ``(g, g)``.
        stiffness: K, ``(g, g)``.
        basis: R, how all coordinates change with z, ``(N, g)``.
        state_matrix: A of ``d(δz, δż)/dt = A (δz, δż) + B u``, ``(2g, 2g)``.
        input_matrix: B, for efforts u on the inputs that were asked for, ``(2g, inputs)``.
        residual: second rates of z at the state itself: zero in an equilibrium or a steady motion, ``(g,)``.
        steady: whether they are, and the matrices stay what they are along the motion: otherwise these are those of an
            instant, and `eigenvalues` say nothing of later. In traced code only the residual is looked at.
        rounding: the largest frequency that rounding of the forces may leave of one that is zero, rad/s, ``()``.
    """

    motion: Motion
    coordinates: tuple[str, ...] = static()
    mass: Array
    damping: Array
    stiffness: Array
    basis: Array
    state_matrix: Array
    input_matrix: Array
    residual: Array
    steady: Array
    rounding: Array

    @property
    def eigenvalues(self) -> np.ndarray:
        """Eigenvalues of the state matrix, rad/s, complex, in order of their size, ``(2g,)``."""
        outside(self, "eigenvalues (and what follows from them)")
        values = np.linalg.eigvals(np.asarray(self.state_matrix, float)).astype(complex)
        return np.take_along_axis(values, np.argsort(np.abs(values), kind="stable"), axis=-1)

    @property
    def _modes(self) -> tuple[Array, Array]:
        """Undamped modes as columns, of unit modal mass, and their frequencies; first derivatives are exact."""
        if self.mass.ndim > 2:
            return jax.vmap(lambda each: each._modes)(self)
        if isinstance(self.stiffness, Tracer):
            return _modes_either_way(self.mass, self.stiffness)
        return (_own_modes if _is_symmetric(self.stiffness) else _twisted_modes)(self.mass, self.stiffness)

    @property
    def frequencies(self) -> Array:
        """Natural frequencies of M and K alone, rad/s, lowest first, ``(g,)``; negative where a motion grows.

        Damping and gyroscopic forces are left out: `eigenvalues` have all of them. Where forces turn with the
        mechanism two modes may flutter; both then have minus the size of their eigenvalues.
        """
        return self._modes[1]

    @property
    def modes(self) -> Array:
        """Shapes of the undamped modes in all coordinates, ``(g, N)``, in the order of `frequencies`."""
        return jnp.swapaxes(self.basis @ self._modes[0], -1, -2)

    @property
    def stable(self) -> bool | np.ndarray:
        """True if no eigenvalue has a positive real part; of a state that is `steady`."""
        good = np.max(np.real(self._rounded), axis=-1, initial=-np.inf) <= 0.0
        return good if good.ndim else bool(good)

    @property
    def _rounded(self) -> np.ndarray:
        """The eigenvalues, zero where they are rounding: of two that are zero together, rounding leaves the root."""
        values, size = self.eigenvalues, np.abs(self.eigenvalues)
        most = np.max(size, axis=-1, keepdims=True, initial=1e-300)
        # rounding leaves 45 times the last digit of the largest square
        least = np.maximum(np.sqrt(45.0 * np.finfo(self.mass.dtype).eps) * most, np.asarray(self.rounding)[..., None])
        values = np.where(size <= least, 0.0, values)
        rounding = np.abs(np.real(values)) <= 0.1 * limits(self.mass).balance * most
        return np.where(rounding, 1j * np.imag(values), values)

    @as_its_system
    def mode(self, number: int, amplitude: float = 0.1, poses: int = 41) -> Motion:
        """One period of a mode as a motion, to be drawn or animated.

        Args:
            number: which mode, 0 for the lowest.
            amplitude: largest displacement of a point, in parts of the mechanism's size.
            poses: how many poses.

        Returns:
            The motion; to first order, so its bars change their length a little where the amplitude is large.
        """
        outside(self, "mode()")
        if self.mass.ndim > 2:
            raise InputError(
                f"mode() shows one state, and this is a batch {self.mass.shape[:-2]}: index it by jax.tree.map"
            )
        top = self.motion.system.topology
        if not 0 <= number < len(self.coordinates):
            raise InputError(f"mode {number} of {len(self.coordinates)}; they are counted from 0")
        finite(array(amplitude, "amplitude="), "amplitude=")
        if not isinstance(poses, (int, np.integer)) or poses < 2:
            raise InputError(f"poses={poses!r}: a mode is shown by two poses at least")
        shape = np.asarray(self.modes)[number]
        spread = shape[: len(top.points) * top.dim].reshape(-1, top.dim)
        size = np.ptp(np.asarray(self.motion.q)[: len(top.points) * top.dim].reshape(-1, top.dim), axis=0)
        scale = amplitude * np.linalg.norm(size) / max(np.linalg.norm(spread, axis=1).max(), 1e-300)
        turn = np.linspace(0, 2 * np.pi, poses)
        q = np.asarray(self.motion.q) + scale * np.sin(turn)[:, None] * shape
        asked, good = jnp.zeros((poses, 0)), jnp.zeros(poses, int)
        return Motion(self.motion.system, (), (), jnp.asarray(q), (), asked, good, None, None, jnp.asarray(turn))

    def __str__(self) -> str:
        rows = [f"linearised about a state of {self.motion.system.name!r} in {', '.join(self.coordinates)}"]
        if isinstance(self.stiffness, Tracer):
            return f"{rows[0]}, traced"
        if self.mass.ndim > 2:
            return f"{rows[0]}, a batch {self.mass.shape[:-2]}"
        if not np.all(self.steady):
            rows.append(
                "  of an instant: this is no equilibrium, and no steady motion in these coordinates; of a motion give "
                "coordinates= that stay or change steadily, such as a measured angle"
            )
        c, scale = self.damping, np.sqrt(np.abs(self.stiffness).max(initial=0.0) * np.abs(self.mass).max(initial=0.0))
        if not _is_symmetric(c, scale):  # with gyroscopic forces M and K alone do not say how it moves
            values = self._rounded
            for value in values[np.imag(values) >= 0]:
                turns = f" ± {value.imag:.6g}i rad/s, {value.imag / (2 * np.pi):.6g} Hz" if value.imag else " rad/s"
                rows.append(f"  eigenvalue {value.real:.6g}{turns}{', grows' if value.real > 0.0 else ''}")
            return "\n".join(rows)
        frequencies = np.asarray(self.frequencies)
        for k, w in enumerate(np.where(np.abs(frequencies) <= self.rounding, 0.0, frequencies)):
            said = f"{w / (2 * np.pi):.6g} Hz" if w > 0 else "grows" if w < 0 else "neutral"
            rows.append(f"  mode {k}: {abs(w):.6g} rad/s, {said}")
        return "\n".join(rows)


def _root_of_inverse(mass: Array) -> Array:
    """Return a root R of the inverse of M, as ``R Rᵀ``, without a derivative."""
    values, vectors = dense.symmetric_eigen(jax.lax.stop_gradient(0.5 * (mass + mass.T)))
    return vectors / jnp.sqrt(values)


@jit
def _own_modes(mass: Array, stiffness: Array) -> tuple[Array, Array]:
    k, root = 0.5 * (stiffness + stiffness.T), _root_of_inverse(mass)
    modes = root @ dense.symmetric_eigen(root.T @ jax.lax.stop_gradient(k) @ root)[1]
    # Rayleigh's quotient of a mode that is kept has the derivative of the eigenvalue.
    square = jnp.sum(modes * (k @ modes), axis=0) / jnp.sum(modes * (mass @ modes), axis=0)
    return modes, jnp.sign(square) * _safe_root(square)


@jit
def _twisted_modes(mass: Array, stiffness: Array, twisted: Array | bool = True) -> tuple[Array, Array]:
    """Modes where a force turns with the mechanism: K is not symmetric, and left and right modes differ."""
    root = _root_of_inverse(mass)
    # Where K is symmetric, whose modes may be of one frequency, other numbers take its place.
    still = jnp.diag(jnp.arange(1.0, len(root) + 1.0, dtype=root.dtype))
    whole = jnp.where(twisted, root.T @ jax.lax.stop_gradient(stiffness) @ root, still)
    left, right = (root @ v for v in dense.eigen(whole)[1:])
    square, weight = (jnp.sum(left.conj() * (x @ right), axis=0) for x in (stiffness, mass))
    square = square / weight
    flutter = jnp.abs(square.imag) > limits(mass).balance * jnp.abs(square)
    found = jnp.where(flutter, -1.0, jnp.sign(square.real)) * _safe_root(square)
    order = jnp.argsort(found)
    return right.real[:, order], found[order]


@jit
def _modes_either_way(mass: Array, stiffness: Array) -> tuple[Array, Array]:
    twisted = ~_is_symmetric(stiffness)
    pairs = zip(_twisted_modes(mass, stiffness, twisted), _own_modes(mass, stiffness), strict=True)
    modes, frequencies = (jnp.where(twisted, a, b) for a, b in pairs)
    return modes, frequencies


def _safe_root(square: Array) -> Array:
    """Root of a size, with a finite derivative where it is zero."""
    return jnp.where(square != 0, jnp.sqrt(jnp.abs(jnp.where(square != 0, square, 1.0))), 0.0)


def _is_symmetric(matrix: Array, scale: Array | float = 0.0) -> Array:
    """Say whether a matrix is symmetric but for rounding, of its own size or of a larger one."""
    most = jnp.maximum(jnp.max(jnp.abs(matrix), initial=0.0), scale)
    return jnp.max(jnp.abs(matrix - matrix.T), initial=0.0) <= limits(matrix).balance * most


@public
@as_its_system
def linearise(
    system: System,
    state: Motion | Equilibrium | Inputs | None = None,
    rates: Inputs | None = None,
    coordinates: Sequence[str] | None = None,
    inputs: Sequence[str] = (),
    unit: str | None = None,
) -> Linearisation:
    """Linearise the motion about a state; friction is left out.

    Args:
        system: the system.
        state: an equilibrium, a pose (with its rates: a steady motion), or as in `jaxnc.simulate`.
        rates: rates by name, for a steady motion.
        coordinates: the independent coordinates, as many as there are freedoms; chosen if not given. Where the rest
            does not follow from them, mapped or compiled code returns NaN, whose derivatives are zero.
        inputs: coordinates that efforts act on, for the input matrix.
        unit: what angles of `state` and `rates` are given in, ``"rad"`` or ``"deg"``.

    Returns:
        The linearisation: frequencies, modes, matrices. Differentiable (first derivatives).

    Raises:
        InputError: unknown names, not as many coordinates as there are freedoms, or a motion that has no inertia.
    """
    check_loads(system, "linearise()", moves=True)
    top = system.topology
    state, known_rates = check_start(system, state.motion if isinstance(state, Equilibrium) else state, rates, unit)
    begin = assemble_pose(system, state)
    flow, q, v = _steady(system, begin, known_rates)
    _refuse_no_inertia(flow, lift(top, begin), q)
    names, known = _name_coordinates(system, flow, q, v, coordinates)
    for name in inputs:
        if name not in top.position:
            raise InputError(
                f"linearise: inputs= are coordinates, and {top.name!r} has none called {brief(name)}; "
                f"{nearest(name, top.coordinates)}"
            )
    at = np.array([flow.dyn.topology.position[name] for name in inputs], dtype=int)
    free = coordinates is None
    least = None if free and values_behind(q) is not None else 1e-2 if free else 10.0 * limits(q).singular
    own = _choose_directions(flow, q, known, least)
    own = own._replace(good=own.good | free)
    mass, c, k, basis, a, b, rest, acceleration = _linearise(flow, own, q, v, at.tolist())
    if not isinstance(own.good, Tracer) and not own.good:
        raise InputError(
            f"{top.name!r}: the rest does not follow from {', '.join(names)} at this state, which is singular "
            f"for them; give other coordinates="
        )
    _refuse_no_inertia(flow, q, a)
    asked, good, time = on_device([np.zeros(0, q.dtype), np.zeros((), int), np.zeros((), q.dtype)])
    moves = lower(top, v), lower(top, acceleration)
    pose = Motion(system, (), (), lower(top, q), moves, asked, good, None, None, time)
    shown_places = basis if top.extended is None else lower(top, basis.T).T
    steady, rate = _is_steady(flow, own, q, v, at.tolist(), a, acceleration)
    rounding = np.sqrt(45.0 * np.finfo(mass.dtype).eps) * jax.lax.stop_gradient(rate)
    return Linearisation(pose, names, mass, c, k, shown_places, a, b, rest, steady, rounding)


@filter_jit
def _steady(system: System, given: Array, rates: Rates) -> tuple[Flow, Array, Array]:
    refuse_rates(system.topology, "linearise", "their independent coordinates are not independent rates: simulate() it")
    flow = Flow.of(dynamics(extended(system)), system.degrees_of_freedom)
    q = flow.project_position(lift(system.topology, given), 2)
    return flow, q, start_rates(system.topology, flow, q, rates)


def _refuse_no_inertia(flow: Flow, q: Array, found: Array) -> None:
    """Refuse a motion that has no inertia at a pose, where numbers found from it are not finite."""
    known = values_behind((flow, q, found))
    if known is not None and not np.isfinite(known[2]).all():
        check_begin(*known[:2])


class _Directions(NamedTuple):
    """Independent coordinates z as sums of the unknown coordinates ``(n,)``, all as lengths."""

    sums: Array  # (g, n): of a coordinate that is one of z, a one
    length: Array  # what a unit of each z is as a length, (g,)
    good: Array  # whether z are the coordinates that were asked for: the others follow from these


def _name_coordinates(
    system: System, flow: Flow, q: Array, v: Array, names: Sequence[str] | None
) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Name independent coordinates, chosen at a pose and its rates if not given, with their places among the unknown.

    The pose, in the coordinates of the dynamics, meets the constraints.
    """
    top, freedom, inner = system.topology, system.degrees_of_freedom, flow.dyn.topology
    chosen = tuple(names) if names is not None else _choose_independent(system, flow, q, v)
    for name in chosen:
        if name not in top.position:
            raise InputError(f"{top.name!r} has no coordinate {name!r}; {nearest(name, top.coordinates)}")
    if len(chosen) != freedom:
        raise InputError(f"{top.name!r} has {freedom} degrees of freedom; {len(chosen)} coordinates were given")
    driven = plan(inner, chosen, (), freedom).driven  # which refuses what does not move
    return inner.named(driven), tuple(np.searchsorted(flow.view.unknown, driven).tolist())


@filter_jit
def _choose_directions(flow: Flow, q: Array, known: tuple[int, ...], least: float | None) -> _Directions:
    """Take the unknown coordinates in some places for z, or directions of the motion where they say less of it.

    Args:
        flow: the motion.
        q: the pose.
        known: places among the unknown coordinates.
        least: how much of every motion these have to see; None where they were chosen at this pose.
    """
    weight, n, at = weights(flow.dyn.eq)[flow.view.unknown], len(flow.view.unknown), np.array(known, int)
    own = _Directions(jnp.eye(n, dtype=q.dtype)[at], jax.lax.stop_gradient(weight[at]), jnp.ones((), bool))
    if least is None or not known:
        return own
    rows = jax.lax.stop_gradient(flow.view.linearise(flow.dyn.eq, q)[1] / weight)
    motions = dense.symmetric_eigen(rows.T @ rows)[1][:, : len(at)].T
    inverse = dense.eliminate(motions[:, at], jnp.eye(len(at), dtype=q.dtype))[0]
    good = jnp.max(jnp.abs(inverse)) * least < 1.0
    return _Directions(jnp.where(good, own.sums, motions), jnp.where(good, own.length, 1.0), good)


def _choose_independent(system: System, flow: Flow, q: Array, v: Array) -> tuple[str, ...]:
    """Choose coordinates that the others follow from, well conditioned at a pose (as drawn, if that is not known)."""
    if (known := values_behind((flow, q, v))) is None:
        return system.independent
    flow, q, v = known
    inner, top, view = flow.dyn.topology, system.topology, flow.view
    rows, sizes = (np.asarray(x) for x in _look_at_state(flow, q, v, bool(np.any(v))))
    shown_places = [k for k, c in enumerate(view.unknown) if inner.coordinates[c] in top.position]
    free = np.linalg.svd(rows)[2][rows.shape[1] - system.degrees_of_freedom :][:, shown_places]
    from scipy.linalg import qr

    # An angle or a distance is easier to read than a component of a point: preferred where it serves nearly as well.
    names = [inner.coordinates[view.unknown[k]] for k in shown_places]
    # Components of what moves are as a steady motion has them at an instant only, most of all those that change.
    changing = np.any(sizes > 1e-9 * np.max(sizes, axis=1, keepdims=True, initial=0.0), axis=0)
    moving = {inner.coordinates[k] for k in np.flatnonzero(changing)} - {*top.scalars}
    owners = {name.partition(".")[0] for name in moving}
    liked = np.array([2.0 if n in top.scalars else 0.02 if n in moving else 1.0 for n in names])
    liked = np.where([n.partition(".")[0] in owners for n in names], 0.05 * liked, liked)
    order: np.ndarray = qr(free * liked, pivoting=True, mode="r")[-1]
    return tuple(names[k] for k in order[: system.degrees_of_freedom])


@filter_jit
def _look_at_state(flow: Flow, q: Array, v: Array, moves: bool) -> tuple[Array, Array]:
    """Return the derivatives of the rows by the unknowns as lengths, and the sizes of the rates, of all orders."""
    weight = weights(flow.dyn.eq)
    changes = [v, flow.accelerate(jnp.zeros(()), q, v)[0]] if moves else [v]
    return flow.view.linearise(flow.dyn.eq, q)[1] / weight[flow.view.unknown], jnp.abs(weight * jnp.stack(changes))


def _is_steady(
    flow: Flow, own: _Directions, q: Array, v: Array, at: list[int], matrix: Array, acceleration: Array
) -> tuple[Array, Array]:
    """Say whether independent coordinates have no second rates, and a state matrix that is the same a little later.

    Also returned is the rate, rad/s, of the quickest swing that forces of such a size could make.
    """
    still, rate, speed, length = _compare_with_swings(flow, own, q, v, matrix, acceleration)
    # 1e-6 of what is gone in the time of a swing is no motion
    if any(isinstance(x, Tracer) for x in (still, speed)) or not (still and speed > 1e-6 * length * rate):
        return still, rate
    # after a thousandth of the time in which something moves by the size, by which it is known to 1e-9
    ahead = 1e-3 * np.asarray(length / speed)
    new = [np.asarray(x) for x in (q, v, acceleration)]
    q, v = (jnp.asarray(x) for x in (new[0] + ahead * new[1] + 0.5 * ahead**2 * new[2], new[1] + ahead * new[2]))
    return _is_alike(flow, own, matrix, _linearise(flow, own, q, v, at)[4], speed), rate


def _as_lengths(flow: Flow, own: _Directions, matrix: Array) -> tuple[Array, Array]:
    """Return how second rates change with the coordinates, and with their rates, all of them as lengths."""
    g = len(own.length)
    by_state = matrix[g:] * own.length[:, None] / jnp.tile(own.length, 2)
    return by_state[:, :g], by_state[:, g:]


@filter_jit
def _compare_with_swings(
    flow: Flow, own: _Directions, q: Array, v: Array, matrix: Array, acceleration: Array
) -> tuple[Array, Array, Array, Array]:
    """Say whether second rates are none beside what the forces could make; return their rate, the speed and size."""
    weight, length = weights(flow.dyn.eq), flow.dyn.eq.length
    speed = jnp.max(jnp.abs(weight * v), initial=0.0)
    size = [jnp.max(jnp.abs(part), initial=0.0) for part in _as_lengths(flow, own, matrix)]
    rest = jnp.max(jnp.abs(own.sums @ (weight * acceleration)[flow.view.unknown]), initial=0.0)
    # What the forces that balance would give, each by itself.
    push = jnp.max(jnp.abs(forces(flow.dyn, jnp.zeros(()), q, v) / weight), initial=0.0)
    pull = push / jnp.maximum(jnp.max(jnp.diagonal(flow.dyn.mass) / weight**2), limits(q).tiny)
    still = rest <= limits(q).balance * (pull + size[0] * length + size[1] * speed + speed**2 / length)
    return still, jnp.sqrt(size[0] + pull / length) + size[1], speed, length


@filter_jit
def _is_alike(flow: Flow, own: _Directions, matrix: Array, later: Array, speed: Array) -> Array:
    """Say whether a state matrix is the same a thousandth of a passage by the mechanism's size later."""
    now, then = (_as_lengths(flow, own, m) for m in (matrix, later))
    rate = speed / flow.dyn.eq.length
    most = [jnp.max(jnp.abs(part), initial=0.0) + slow for part, slow in zip(now, (rate**2, rate), strict=True)]
    # 1e-5 of its size in so short a time: a hundredth on the way
    pairs = zip(now, then, most, strict=True)
    return jnp.all(jnp.array([jnp.max(jnp.abs(b - a), initial=0.0) <= 1e-5 * whole for a, b, whole in pairs]))


def _state_changes(flow: Flow, own: _Directions, q: Array, v: Array) -> tuple[Array, Array]:
    """Find how a state changes with its independent coordinates z and their rates, by derivatives of the rows alone.

    Where all rates are v, rows ``Φ(q) = 0`` go on being met if ``Φ_q δq = 0`` and ``Φ_q δv = -Φ_qq v δq``.

    Returns:
        R, how all coordinates change with z (and their rates with those of z), ``(N, g)``; how their rates change
        with z, ``(N, g)``.
    """
    eq, view, g = flow.dyn.eq, flow.view, len(own.length)
    n, weight = len(view.unknown), weights(eq)[view.unknown]
    rows = jnp.concatenate([evaluate_rows(view, eq, q, v)[1] / weight, own.sums])
    solve, count = saddle(jnp.eye(n), rows, rows.shape[0] > n), rows.shape[0] - g

    def follow(right: Array) -> Array:
        some = jax.vmap(lambda x: solve(jnp.zeros(n), x)[0] / weight, in_axes=1, out_axes=1)(right)
        return jnp.zeros((len(q), g)).at[view.unknown].set(some)

    def bend(way: Array) -> Array:
        return 0.5 * jax.jvp(lambda v: evaluate_rows(view, eq, q, v)[3], (v,), (way,))[1]

    basis = follow(jnp.concatenate([jnp.zeros((count, g)), jnp.diag(own.length)]))
    bent = jax.vmap(bend, in_axes=1, out_axes=1)(basis)
    return basis, follow(jnp.concatenate([-bent, jnp.zeros((g, g))]))


@filter_jit
def _linearise(flow: Flow, own: _Directions, q: Array, v: Array, at: list[int]):
    """Return mass, damping, stiffness and the rest from one derivative of the accelerations along `_state_changes`."""
    g, count = len(own.length), len(at)
    basis, turned = _state_changes(flow, own, q, v)
    mass = basis.T @ flow.dyn.mass @ basis

    def accelerate(q, v, efforts):
        extra = jnp.zeros_like(v).at[np.array(at)].add(efforts) if at else None
        return flow.accelerate(jnp.zeros(()), q, v, extra)[0]

    zero, state = jnp.zeros_like(basis), (q, v, jnp.zeros(count))
    none = jnp.zeros((len(v), count))
    ways = jnp.block([basis, zero, none]), jnp.block([turned, basis, none]), jnp.eye(count, 2 * g + count, 2 * g)
    whole, slopes = jax.vmap(lambda *way: jax.jvp(accelerate, state, way), in_axes=1, out_axes=(None, 1))(*ways)

    def measure(x: Array) -> Array:  # z of all coordinates
        return own.sums @ (weights(flow.dyn.eq)[:, None] * x)[flow.view.unknown] / own.length[:, None]

    by_z, by_dz, by_efforts = jnp.split(measure(slopes), (g, 2 * g), axis=1)
    a = jnp.block([[jnp.zeros((g, g)), jnp.eye(g)], [by_z, by_dz]])
    b = jnp.concatenate([jnp.zeros((g, count)), by_efforts])
    found = mass, -mass @ by_dz, -mass @ by_z, basis, a, b, measure(whole[:, None])[:, 0]
    return *(jnp.where(own.good, x, jnp.nan) for x in found), whole
