"""The start pose: the drawing, moved as little as it takes to meet the constraints."""

from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.compiling import jit, on_device
from jaxnc.errors import MechanismError
from jaxnc.process import one_thread
from jaxnc.records import by_identity
from jaxnc.solvers import host
from jaxnc.solvers.elimination import independent_coordinates, with_special
from jaxnc.solvers.plan import LARGEST_WRITTEN, LargePlan, Plan, plan
from jaxnc.solvers.sparse_matrix import RANK, Nullity, matrix_of, null_directions, null_part
from jaxnc.system.equations import Equations, derived, jacobian, places, residual
from jaxnc.system.host import HostEquations, from_jax
from jaxnc.system.precision import limits
from jaxnc.system.system import System
from jaxnc.system.topology import Topology
from jaxnc.types import Array, Coordinates


def free_plan(topology: Topology) -> Plan:
    """Make the plan with nothing driven: every coordinate that is not fixed may move."""
    return plan(topology, (), ())


def derive(system: System) -> Equations:
    """Derive the equations of a system: on the host where its parameters are numbers, else by compiled code."""
    return derived(system) if _is_traced(system) else _derived(system)


_derived = by_identity(derived)


@by_identity
def to_host(eq: Equations) -> HostEquations:
    """Return the equations of one design on the host, from those for JAX (not traced); made once."""
    return from_jax(eq)


def _is_traced(*trees: object) -> bool:
    return any(isinstance(x, Tracer) for x in jax.tree.leaves(trees))


def settle(eq: Equations, nudge: Array | np.ndarray, repair: bool = True) -> host.Closest:
    """Assemble from the drawing moved by `nudge`, ``(N,)``: the start pose. Differentiated nowhere.

    Traced code asks the host for what does not fit as it is drawn; without `repair` it does so itself.
    """
    if _is_traced(eq, nudge):
        from jaxnc.solvers.newton import traced_start  # with all that XLA needs, and the host does not

        return traced_start(free_plan(eq.topology), eq, nudge, repair)
    if isinstance(nudge, np.ndarray) and not nudge.any():
        return _start_of(eq)
    return _assemble_on_host(eq, np.asarray(nudge))


@by_identity
def _start_of(eq: Equations) -> host.Closest:
    return _assemble_on_host(eq, np.zeros(eq.home.shape, eq.home.dtype))


def _assemble_on_host(eq: Equations, nudge: np.ndarray) -> host.Closest:
    inner, view = to_host(eq), free_plan(eq.topology)
    with np.errstate(all="ignore"):
        begin = (inner.home + nudge).astype(inner.dtype)[:, None]
        q, gap, jacobian = host.assemble_closest(host.view_of(view, inner), begin)
    return host.Closest(*on_device([np.asarray(x, inner.dtype) for x in (q[:, 0], gap[0], jacobian[0])]))


def evaluate(eq: Equations, q: Coordinates | np.ndarray) -> tuple[Array, Array]:
    """Evaluate all rows ``(rows,)`` and their Jacobian ``(rows, N)`` at a pose.

    The Jacobian is empty for a large mechanism, whose matrices are kept sparse.
    """
    if _is_traced(eq, q):
        return _evaluate_traced(eq, q)
    inner, x = to_host(eq), np.asarray(q)[:, None]
    with np.errstate(all="ignore"):
        jacobian = np.zeros((0, 0)) if eq.topology.large else inner.jacobian(x)[0]
        return on_device((inner.residual(x)[:, 0], jacobian))


@jit
def _evaluate_traced(eq: Equations, q: Coordinates) -> tuple[Array, Array]:
    if eq.topology.large:
        return residual(eq, q), jnp.zeros((0, 0))
    return residual(eq, q), jacobian(eq, q)


def meets(eq: Equations, q: Coordinates | np.ndarray, gap: float) -> bool:
    """Say whether a pose of a drawing whose largest residual is `gap` counts as assembled; on the host."""
    inner, least = to_host(eq), limits(eq.length, eq.rounded)
    largest = np.max(inner.weights * np.abs(np.asarray(q)), initial=0.0)
    return gap <= 1e3 * (least.accept * inner.length + least.rounding * float(largest))


class Sample(NamedTuple):
    """An assembled pose and the rank of its constraints."""

    q: Coordinates  # the pose
    gap: float  # its largest residual
    jacobian: Any  # its free Jacobian, every coordinate a length; of a large system a sparse matrix
    rank: int
    null: Nullity | None = None  # of a large system, what the Jacobian misses


def rank_of(matrix: np.ndarray) -> tuple[int, np.ndarray]:
    """Find the numerical rank of a matrix and a basis of its null space, row by row."""
    if not matrix.size:
        return 0, np.eye(matrix.shape[1])
    _, values, right = np.linalg.svd(matrix)
    rank = int(np.sum(values > RANK * max(values[0], 1e-300)))
    return rank, right[rank:]


def sample_poses(system: System, count: int = 2) -> list[Sample]:
    """Assemble the drawing and, unless it cannot move, poses nearby, in case the drawing is a special one."""
    view = free_plan(system.topology)
    eq = derive(system)
    nudge, n = np.zeros(len(system.topology.coordinates)), len(view.unknown)
    weight = to_host(eq).weights[view.unknown]
    out: list[Sample] = []
    for step in range(count):
        q, gap, matrix = settle(eq, nudge)
        matrix = np.asarray(matrix)
        if isinstance(view, LargePlan):
            pattern, null = view.numbers, np.zeros((n, 0))
            matrix = matrix_of(matrix, pattern.rows, pattern.columns, pattern.shape)
            missed = null_directions(matrix)
            out.append(Sample(q, float(gap), matrix, min(pattern.shape) - missed.count, missed))
        else:
            rank, null = rank_of(matrix)
            out.append(Sample(q, float(gap), matrix, rank))
        if out[-1].rank == n:
            break
        mix = np.random.default_rng(7 + step).uniform(0.5, 1.0, len(null))
        # 0.03 of the mechanism's size is how far away the second pose is looked for
        far = (1 - 2 * (step % 2)) * (step + 1) * 0.03 * float(eq.length)
        if view.large:  # a way that the sparse matrix does not stretch, its largest part one
            way = null_part(out[-1].jacobian, mix)
            way = far * (way / max(np.abs(way).max(initial=0.0), 1e-300))
        else:
            way = far * mix @ null
        nudge[view.unknown] = way / weight
    if not view.large and not meets(eq, out[0].q, out[0].gap):
        out += _missing_poses(eq, view, weight, out[0])
    return out


def _missing_poses(eq: Equations, view: Plan, weight: np.ndarray, closest: Sample) -> list[Sample]:
    """Find poses that miss the constraints as the closest one does, by half as much again; none where there is no such.

    Where none comes closer the rows are dependent, or there would be a way to come closer: what their rank is there
    says nothing of the mechanism. Rows that contradict each other leave no pose to be found farther off.
    """
    inner, here = to_host(eq), np.asarray(closest.q, float)
    null, rng = rank_of(closest.jacobian)[1], np.random.default_rng(5)
    target = 1.5 * inner.residual(here[:, None])[view.rows, 0]
    out: list[Sample] = []
    for _ in range(4 if len(null) else 0):
        q, way = here.copy(), rng.standard_normal(len(null)) @ null
        q[view.unknown] += np.sqrt(closest.gap * float(eq.length)) * way / np.linalg.norm(way) / weight
        for _ in range(30):
            left = inner.residual(q[:, None])[view.rows, 0] - target
            matrix = inner.jacobian(q[:, None])[0][np.ix_(view.rows, view.unknown)] / weight
            if not np.isfinite(matrix).all() or np.abs(left).max() <= 1e-9 * closest.gap:
                break
            q[view.unknown] -= np.linalg.lstsq(matrix, left, rcond=1e-6)[0] / weight
        if np.isfinite(matrix).all() and np.abs(left).max() <= 1e-9 * closest.gap:
            out.append(Sample(on_device(q), closest.gap, matrix, rank_of(matrix)[0]))
            break
    return out


def _check_finite(system: System) -> None:
    """Refuse a drawing in which the numbers of a constraint, or its derivatives by what moves, are not finite."""
    top, inner = system.topology, to_host(derive(system))
    q, moving = inner.home[:, None], np.zeros(len(top.coordinates), bool)
    moving[top.unknown] = True
    with np.errstate(all="ignore"):
        rows, columns, _ = places(top)
        residual, slopes = inner.residual(q)[:, 0], inner.entries(q)[:, 0]
    unequal, steep = ~np.isfinite(residual), np.zeros(len(residual), bool)
    steep[rows[moving[columns] & ~np.isfinite(slopes)]] = True
    for block, layout, constants in zip(top.blocks, top.layout, inner.constants, strict=True):
        for what, bad in (
            ("a constant that is no finite number", ~np.isfinite(constants)),
            ("a row that is no finite number", unequal[layout.rows]),
            ("a row with no finite derivative", steep[layout.rows]),
        ):
            if bad.any():
                owner = top.called(*block.owners[np.argwhere(bad)[0, 0]])
                raise MechanismError(
                    f"{top.name!r}: {owner} (kind {block.kind.name!r}) has {what} in the drawing: draw it where its "
                    f"equation has a value, or give it one there by jnp.where, around the argument and the result"
                )


def _freedoms_of_large(system: System, best: Sample) -> int:
    if best.null is not None and not best.null.sure:
        smallest = ", ".join(f"{value:.1e}" for value in best.null.smallest[:4])
        raise MechanismError(
            f"{system.name!r}: its degrees of freedom cannot be told; the smallest singular values of its constraints, "
            f"relative to the largest, are {smallest}, too close to those of a singular position. Draw it in a pose "
            f"further from a change point or dead point, or with proportions that do not magnify along the chain"
        )
    return len(system.topology.unknown) - best.rank


def with_degrees_of_freedom(system: System) -> System:
    """Count a system's degrees of freedom: the same system, carrying them and what else is special about the design."""
    one_thread("numpy")  # every system comes by here
    _check_finite(system)
    samples = sample_poses(system)
    if system.topology.large:
        best = max(samples, key=lambda sample: sample.rank)
        return System(system.topology, system.parameters, _freedoms_of_large(system, best))
    samples = sorted(samples, key=lambda sample: sample.rank)
    view, top = free_plan(system.topology), system.topology
    jacobians = np.zeros((len(samples), len(top.rows), len(top.coordinates)))
    jacobians[:, view.rows[:, None], view.unknown] = [sample.jacobian for sample in samples]
    rank = samples[-1].rank
    freedom = len(view.unknown) - rank
    scalars = view.unknown >= len(top.coordinates) - len(top.scalars)
    liked = np.concatenate([np.flatnonzero(scalars), np.flatnonzero(~scalars)])
    independent = independent_coordinates(samples[-1].jacobian, freedom, liked)
    names = tuple(top.coordinates[view.unknown[k]] for k in independent)
    written = len(view.unknown) - freedom <= LARGEST_WRITTEN  # elsewhere nobody asks
    sufficient = False
    if written and rank < len(view.rows):
        general, assembles = general_sample(system, 1)
        sufficient = assembles and general.rank == rank
    return System(with_special(top, jacobians, rank, sufficient), system.parameters, freedom, names)


def general_sample(system: System, poses: int) -> tuple[Sample, bool]:
    """Take the rows after a general change of the drawing, in that of some poses in which their rank is largest.

    Returns:
        The pose, and whether the changed drawing assembles.
    """
    par, rng = system.parameters, np.random.default_rng(3)
    size = float(np.ptp(np.asarray(par.points), axis=0).max())
    changed = {}
    for name, scale in (("points", size), ("vectors", 1.0), ("markers", size), ("dimensions", None)):
        leaf = np.asarray(getattr(par, name))
        amount = np.abs(leaf) if scale is None else scale
        # 0.02 of the size, a general change of the drawing: which redundancies depend on its dimensions?
        changed[name] = on_device(leaf + 0.02 * amount * rng.standard_normal(leaf.shape))
    samples = sample_poses(replace(system, parameters=replace(par, **changed)), poses)
    # 1e-9 of the size: a drawing with a larger gap does not assemble
    return max(samples, key=lambda sample: sample.rank), samples[0].gap <= 1e-9 * size
