"""Poses of many designs of a problem, and errors, conditions and derivatives that follow from them.

Poses come from the host, where nothing is compiled. What a problem asks of them is compiled once for the problem's
structure and a few designs at a time: as many as fit into the processor's memory, and not many more than often remain.
While it runs, the host goes on with the next few.
"""

import dataclasses
import functools
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import jit, on_device
from jaxnc.kinematics.design import attach_poses, geometry_vector
from jaxnc.kinematics.motion import Motion
from jaxnc.solvers.assembly import derive
from jaxnc.solvers.host import HostView
from jaxnc.solvers.host.lockstep import Lockstep, lane_determinant, lockstep, matrix
from jaxnc.solvers.plan import plan
from jaxnc.solvers.rows import RowNumbers
from jaxnc.status import Status
from jaxnc.synthesis import loops
from jaxnc.synthesis.problem import POSES, Problem, home_value, make_motion
from jaxnc.synthesis.pytree import take
from jaxnc.system.design import Drawn, carry_design
from jaxnc.system.host import from_jax
from jaxnc.system.structure import readable
from jaxnc.system.system import System
from jaxnc.types import Array, Numbers

if TYPE_CHECKING:
    from jaxnc.solvers.plan import Plan
    from jaxnc.synthesis.search.goal import Goal

_Item = TypeVar("_Item")
_Out = TypeVar("_Out")


def map_threads(work: Callable[[_Item], _Out], items: Sequence[_Item], prepared: bool = False) -> list[_Out]:
    """Apply a function to items in threads; unless all is `prepared` the first by itself, for what the others share."""
    alone = 0 if prepared else 1
    out, rest = [work(item) for item in items[:alone]], items[alone:]
    count = min(_processors(), 8, len(rest))  # 8 threads
    if count < 2:
        return out + [work(item) for item in rest]
    pool = ThreadPoolExecutor(count)
    try:
        return out + list(pool.map(work, rest))
    finally:
        pool.shutdown(cancel_futures=True)


def _processors() -> int:
    """Number of processors that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # where a process cannot be held to some of them
        return os.cpu_count() or 1


# -- poses on the host -------------------------------------------------------------------------------------------------

_compiled_sines = jit(loops.loop_sines)

_PARTS = 8  # into which a step is divided across which determinants change too much


class DesignPoses(NamedTuple):
    """Poses of designs through their targets, and over the range of the input."""

    q: np.ndarray  # coordinates at the targets (designs, targets, N)
    status: np.ndarray  # `jaxnc.Status` there
    values: np.ndarray  # of the input there, (designs, targets)
    by: np.ndarray | None = None  # how the input changes with the unknowns, (designs, targets, n)
    changes: np.ndarray | None = None  # of `q` with the unknowns, (designs, n, targets, N); None if they are not known
    # The same over the range; None where that at the targets goes through it, or there is no range.
    turn: "DesignPoses | None" = None


def solve_poses(problem: Problem, x: np.ndarray, poses: int, way: str = "quick") -> DesignPoses:
    """Move designs through their targets and over the range of the input.

    Args:
        problem: the problem.
        x: unknowns of designs, ``(designs, n)``.
        poses: at least so many over the range; 0 for none.
        way: how it is seen that designs stay on their branch: ``"quick"``, in steps of a given length, which takes some
            that pass near a dead point for lost; ``"close"``, there in shorter steps; ``"sure"`` if they are beside
            designs that do.

    Returns:
        The poses, without their changes; see `changing`.
    """
    with np.errstate(all="ignore"):
        if _go_together(problem):
            return _Designs(problem, x, False, way).solve(poses)
        return _sweep_designs(problem, x, poses)


def solve_changes(problem: Problem, x: np.ndarray, poses: int, way: str, most: int) -> Iterator[DesignPoses]:
    """Yield poses of `most` designs at a time with their changes with the unknowns; see `solve_poses`.

    Without their changes where a kind of the mechanism's constraints can be read by JAX alone, or where its matrices
    are sparse.
    """
    with np.errstate(all="ignore"):
        designs = _Designs(problem, x, True, way) if _go_together(problem) else None
        found = _sweep_designs(problem, x, poses) if designs is None else designs.solve(poses)
    for first in range(0, len(x), most):
        some = slice(first, first + most)
        yield take(found, some) if designs is None else designs.changing(found, some)


def reach_targets(problem: Problem, x: np.ndarray) -> np.ndarray:
    """Mark designs ``(designs, n)`` that reach all targets; all of them where they can only be moved one by one."""
    if not _go_together(problem):
        return np.ones(len(x), bool)
    width = 512  # designs at once, where only those are sought that go on

    def part(first: int) -> np.ndarray:
        return np.all(solve_poses(problem, x[first : first + width], 0).status == int(Status.CONVERGED), axis=1)

    return np.concatenate(map_threads(part, range(0, len(x), width)))


def solve_curves(
    problem: Problem, z: np.ndarray, count: int, way: str = "quick"
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Solve poses over the whole range of the input, ``(designs, count, N)``; which were reached; the first inputs.

    Designs are ``(designs, variables)``; for the way see `solve_poses`. Where a way forwards ends at a dead point, what
    is behind it is looked for backwards.
    """
    with np.errstate(all="ignore"):
        x, together = _with_own(problem, z), _go_together(problem)
        found = _Designs(problem, x, False, way).curve(count) if together else _sweep_designs(problem, x, count)
        found = found.turn or found
        q, good = found.q, found.status == int(Status.CONVERGED)
        open_ = np.flatnonzero(~good.all(axis=1))
        if len(open_) and together:
            again = _Designs(problem, x[open_], False, way)
            turn = 2 * np.pi if problem.whole else 0.0
            back = again.along(found.values[open_, ::-1] - turn)
            more = (back.status == int(Status.CONVERGED))[:, ::-1] & ~good[open_]
            q[open_] = np.where(more[:, :, None], back.q[:, ::-1], q[open_])
            good[open_] |= more
        return q, good, found.values[:, 0]


def assemble_drawings(problem: Problem, z: np.ndarray) -> np.ndarray | None:
    """Assemble drawings: coordinates ``(designs, N)``; None where that is not done on the host."""
    if not _go_together(problem):
        return None
    with np.errstate(all="ignore"):
        return _Designs(problem, _with_own(problem, z), False).start.T


def _with_own(problem: Problem, z: np.ndarray) -> np.ndarray:
    """Append the problem's own unknowns as they are in the idea to designs ``(designs, variables)``."""
    return np.concatenate([z, np.broadcast_to(problem.extras.home, (len(z), len(problem.extras.names)))], axis=1)


def _go_together(problem: Problem) -> bool:
    """Tell whether designs are moved all at once: not where matrices are sparse or JAX alone can read a kind."""
    return readable(problem.system.topology) and not problem.system.topology.large


def marker_places(problem: Problem, z: np.ndarray, q: np.ndarray, number: int) -> np.ndarray:
    """Places of a marker of planar designs in poses ``(designs, T, N)``, as complex numbers."""
    index = problem.system.topology.markers[number]
    a, b = _derive_designs(problem, z, False).markers[number, :, :, 0]
    place = (
        q[..., 0::2][..., [index.origin, *index.segments[0]]]
        + 1j * q[..., 1::2][..., [index.origin, *index.segments[0]]]
    )
    return place[..., 0] + (a + 1j * b)[:, None] * (place[..., 2] - place[..., 1])


def meeting_sines(problem: Problem, x: np.ndarray, motion: Motion) -> np.ndarray:
    """Sines of a planar design's loops as by `jaxnc.synthesis.loops.loop_sines`, on the host, ``(T, blocks)``."""
    if not readable(problem.system.topology):
        return np.asarray(_compiled_sines(motion))
    designs = _derive_designs(problem, x[None, : len(problem.variables.names)], False)
    numbers = RowNumbers([c[..., 0] for c in designs.constants], _row_scales(problem))
    q, out = np.asarray(motion.poses).T[:, :, None], []
    with np.errstate(all="ignore"):
        for block in lockstep(_view(problem)).blocks:
            if block.form != "affine":
                wide = loops.wide_rows(block)
                a = matrix(wide, wide.collect(q, numbers), q.shape[1:])
                size = np.prod(np.sqrt(np.sum(a * a, axis=1)), axis=0)
                out.append((np.abs(lane_determinant(a[:, : len(block.columns)])) / size)[:, 0])
    return np.stack(out, axis=1) if out else np.ones((q.shape[1], 1))


class _Designs:
    """Designs of a problem, assembled."""

    def __init__(self, problem: Problem, x: np.ndarray, changes: bool, way: str = "quick"):
        self.problem, self.view = problem, _view(problem)
        self.way = way
        z, self.extra = x[:, : len(problem.variables.names)], x[:, len(problem.variables.names) :]
        self.drawn, eq = _derive_designs(problem, z, changes), derive(problem.system)
        self.length, self.scales = float(eq.length), _row_scales(problem)
        self.steps: Lockstep = lockstep(self.view)
        self.start = self.steps.assemble(self.drawn, self.scales, self.length)
        # Of all inputs only the first is driven, the others are held.
        self.home = self.start[self.view.known[0]]

    def solve(self, poses: int) -> DesignPoses:
        problem = self.problem
        through, own = _input_table(problem, self.extra)
        if problem.at_rest:
            through = self.home[:, None]
        by = np.concatenate([np.zeros((len(own), len(problem.variables.names))), own], axis=1)
        found = self.along(through)._replace(by=np.broadcast_to(by, (len(through), *by.shape)))
        if not poses or problem.through(through.shape[1], poses):
            return found
        return found._replace(turn=self.curve(poses))

    def curve(self, count: int) -> DesignPoses:
        """Poses over the whole range, which may change with the drawing and with the problem's own unknowns."""
        span, part = self.problem.span, np.linspace(0.0, 1.0, count)
        low, high = (np.broadcast_to(end, self.home.shape)[:, None] for end in span(self.home, self.extra))
        _, (low_by, high_by) = _expand_affine(lambda x: span(x[0], x[1:]), 1 + self.extra.shape[1])
        by = low_by * (1.0 - part[:, None]) + high_by * part[:, None]
        drawn = by[:, :1] * self.drawn.home[self.view.known[0], :, None, 1:-1]
        own = np.broadcast_to(by[:, 1:], (len(drawn), count, self.extra.shape[1]))
        return self.along(low * (1.0 - part) + high * part)._replace(by=np.concatenate([drawn, own], axis=2))

    def along(self, values: np.ndarray) -> DesignPoses:
        """Poses at values of the input ``(designs, T)``."""
        home = self.home
        if self.problem.periodic:
            home = home + 2 * np.pi * np.round((values[:, 0] - home) / (2 * np.pi))
        turning = bool(self.view.angles) and self.view.angles[0] == 0
        # Radians, or parts of the size, between poses that are looked at. Where poses are followed to one after the
        # other, longer steps than a tenth are lost in space.
        step = 0.25 if self.steps.closed else 0.1
        track, at = _make_track(home, values, step * (1.0 if turning else self.length))
        start = self.start.copy()
        start[self.view.known[0]] = home
        known = np.repeat(start[self.view.known][:, None], len(track), axis=1)
        known[0] = track
        found = self.steps.follow(self.drawn, self.scales, self.length, start, known, self.way == "sure")
        lanes = np.arange(len(home))
        q, good = found.q[:, at, lanes], found.good[at, lanes]
        if self.way == "close":
            self._closer(found.doubted, start, known, at, q, good)
        status = np.where(good, int(Status.CONVERGED), int(Status.NOT_REACHED))
        return DesignPoses(np.ascontiguousarray(q.transpose(2, 1, 0)), status.T, values)

    def _closer(
        self, doubted: np.ndarray, start: np.ndarray, known: np.ndarray, at: np.ndarray, q: np.ndarray, good: np.ndarray
    ) -> None:
        """Look closer, in shorter steps, at designs that pass near a dead point; their poses are put into `q`."""
        lanes = np.arange(known.shape[2])
        for _ in range(12):  # beside a dead point that is just missed steps become as short as it is near
            some = np.flatnonzero(doubted.any(axis=0))
            if not len(some):
                return
            track, at = _refine_track(known[0][:, some], at[:, some], doubted[:, some])
            known = np.repeat(known[:, :1, some], len(track), axis=1)
            known[0], lanes, start = track, lanes[some], start[:, some]
            found = self.steps.follow(_some_designs(self.drawn, lanes), self.scales, self.length, start, known)
            own = np.arange(len(lanes))
            q[:, :, lanes], good[:, lanes] = found.q[:, at, own], found.good[at, own]
            doubted = found.doubted

    def changing(self, found: DesignPoses, some: slice) -> DesignPoses:
        """Poses of some of the designs, with their changes."""
        part, lanes = take(found, some), np.arange(len(self.home))[some]
        q, good = np.ascontiguousarray(part.q.transpose(2, 1, 0)), np.equal(part.status.T, int(Status.CONVERGED))
        own = _some_designs(self.drawn, lanes)
        known = np.zeros((len(self.view.known), own.home.shape[-1] - 1, *good.shape))
        known[0, -1] = 1.0
        known[1:] = np.moveaxis(own.home[self.view.known[1:], :, 1:], -1, 1)[:, :, None]
        slopes = self.steps.changes(own, q, good, known).transpose(3, 1, 2, 0)  # by the variables and by the input
        assert part.by is not None
        changes = part.by.transpose(0, 2, 1)[..., None] * slopes[:, -1:]
        changes[:, : slopes.shape[1] - 1] += slopes[:, :-1]
        return part._replace(by=None, changes=changes, turn=found.turn and self.changing(found.turn, some))


def _view(problem: Problem) -> "Plan":
    system = problem.system
    return plan(system.topology, (problem.driven,), problem.hold, system.degrees_of_freedom)


def _row_scales(problem: Problem) -> list[np.ndarray]:
    return [np.asarray(scales) for scales in derive(problem.system).scales]


def _derive_designs(problem: Problem, z: np.ndarray, changes: bool) -> Drawn:
    """Derive constants and start of designs ``(designs, variables)``, with their changes with these and the input."""
    system, n = problem.system, z.shape[1]
    flat, at = np.asarray(geometry_vector(system), float), problem.variables.at
    every = np.zeros((len(flat), len(z), n + 2 if changes else 1))
    every[:, :, 0] = flat[:, None]
    every[at, :, 0] = z.T
    if changes:
        every[at, :, 1 + np.arange(n)] = 1.0
    return carry_design(system.topology, every, system.parameters.near)


def _input_table(problem: Problem, extra: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values of the input at the targets ``(designs, T)``, and their derivatives by the own unknowns ``(T, own)``.

    The inputs of a problem are affine in its own unknowns.
    """
    own = extra.shape[1]
    base, by = _expand_affine(problem.inputs, own)
    if not problem.affine:
        return np.stack([np.asarray(problem.inputs(row), float) for row in extra]), by
    return base + extra @ by.T if own else np.repeat(base[None], len(extra), axis=0), by


def _expand_affine(f: Callable[[np.ndarray], Any], own: int) -> tuple[np.ndarray, np.ndarray]:
    """Value of an affine function at zero, and its derivatives by so many unknowns, in an axis behind."""
    base, *rows = (np.asarray(f(row), float) for row in (np.zeros(own), *np.eye(own)))
    return base, np.stack([row - base for row in rows], axis=-1) if own else np.zeros((*base.shape, 0))


def _make_track(home: np.ndarray, values: np.ndarray, most: float) -> tuple[np.ndarray, np.ndarray]:
    """Lay short steps from home through the values asked for: ``(steps, designs)``, and where these values are."""
    stops = np.concatenate([home[:, None], values], axis=1)
    apart = np.abs(np.diff(stops, axis=1))
    # 64 poses between two targets, at most
    counts = np.clip(np.ceil(np.where(np.isfinite(apart), apart, 0.0) / most), 1, 64).astype(int)
    counts[:, :2] += 1  # the way begins at the drawing, or, where that is the first target, there
    ends = np.cumsum(counts, axis=1)
    steps = np.arange(ends.max() + 1)
    begun = np.zeros((len(home), len(steps) + 1), int)
    np.put_along_axis(begun, ends + 1, 1, axis=1)
    way = np.minimum(np.cumsum(begun[:, :-1], axis=1), values.shape[1] - 1)  # on which way each step is
    along = np.minimum(steps - np.take_along_axis(ends - counts, way, axis=1), np.take_along_axis(counts, way, axis=1))
    first = way < 2
    part = (along - first) / (np.take_along_axis(counts, way, axis=1) - first)
    # 1e-3 of a step, to show where poses and determinants are going
    part = np.where(first & (along <= 1), along * 1e-3 / np.take_along_axis(counts, way, axis=1), part)
    track = np.take_along_axis(stops, way, axis=1) * (1.0 - part) + np.take_along_axis(stops, way + 1, axis=1) * part
    return track.T, ends.T


def _refine_track(track: np.ndarray, at: np.ndarray, doubted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Divide the doubted steps of a track; where the values asked for are afterwards."""
    parts = np.where(doubted, _PARTS, 1)
    ends = np.concatenate([np.zeros((1, track.shape[1]), int), np.cumsum(parts, axis=0)])
    steps = np.arange(ends.max() + 1)
    way = np.stack([np.searchsorted(own, steps, side="right") for own in ends[1:].T], axis=1)
    way = np.minimum(way, len(track) - 2)  # (steps, designs)
    first, count = np.take_along_axis(ends, way, axis=0), np.take_along_axis(parts, way, axis=0)
    part = np.minimum((steps[:, None] - first) / count, 1.0)
    begin, end = np.take_along_axis(track, way, axis=0), np.take_along_axis(track, way + 1, axis=0)
    return np.where(part == 1.0, end, begin + part * (end - begin)), np.take_along_axis(ends, at, axis=0)


def _some_designs(drawn: Drawn, lanes: np.ndarray) -> Drawn:
    """Select designs."""
    return drawn._replace(constants=tuple(c[:, :, lanes] for c in drawn.constants), home=drawn.home[:, lanes])


def _sweep_designs(problem: Problem, x: np.ndarray, poses: int) -> DesignPoses:
    """Move designs by sweeps, one after the other."""
    ways = []
    for one in x:
        system, extra = problem.design(one), one[len(problem.variables.names) :]
        values = [np.asarray(problem.inputs(extra), float)]
        if problem.at_rest:
            values = [np.asarray(home_value(system, problem.driven), float).reshape(1)]
        if poses and not problem.through(len(values[0]), poses):
            low, high = problem.span(home_value(system, problem.driven), extra)
            values.append(low + (high - low) * np.linspace(0.0, 1.0, poses))
        motions = [problem.sweep(system, v) for v in values]
        ways.append([(np.asarray(m.q), np.asarray(m.status), v) for m, v in zip(motions, values, strict=True)])
    found, *turn = (
        DesignPoses(q, status, values)
        for way in zip(*ways, strict=True)
        for q, status, values in [map(np.stack, zip(*way, strict=True))]
    )
    return found._replace(turn=turn[0]) if turn else found


# -- errors, conditions, derivatives -----------------------------------------------------------------------------------

LANES = 48  # the most designs evaluated at once
MEETS = 1e-8  # violation of a condition that a design may have


def violation(conditions: Numbers, equal: np.ndarray | bool) -> np.ndarray:
    """Distance of conditions from being met, ``(..., k)``."""
    return np.where(equal, np.abs(conditions), np.maximum(-conditions, 0.0))


class Evaluator:
    """Evaluates designs of a goal; designs of goals of one structure share what is compiled."""

    def __init__(self, goal: "Goal"):
        leaves, self.structure = jax.tree.flatten(goal)
        self.goal, self.leaves, self.scale = goal, on_device(leaves), goal.scale

    def __call__(
        self, x: np.ndarray, given: np.ndarray, live: np.ndarray | None = None, way: str = "quick"
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Evaluate designs.

        Args:
            x: unknowns, ``(B, n)``.
            given: arguments of the goal, ``(B, g)``.
            live: which designs are looked at, ``(B,)``; all if not given.
            way: how designs are followed, see `jaxnc.synthesis.evaluate.solve_poses`.

        Returns:
            Errors ``(B, m)``, conditions ``(B, k)``, derivatives of both by the unknowns in their scales
            ``(B, m + k, n)``, and which designs reach all of their targets.
        """
        at, problem, parts = np.flatnonzero(np.ones(len(x)) if live is None else live), self.goal.problem, []
        width = 16  # designs for which it is compiled
        for found in solve_changes(problem, x[at, : problem.count], problem.poses, way, width):
            first, count = len(parts) * width, len(found.q)
            fill = np.minimum(np.arange(width), count - 1)
            some = at[first + fill]
            found = found if count == width else take(found, fill)
            parts.append(_compiled_evaluate(self.structure, self.leaves, x[some], given[some], self.scale, found))
        whole = []
        for each in zip(*parts, strict=True):
            whole.append(np.zeros((len(x), *each[0].shape[1:]), each[0].dtype))
            whole[-1][at] = np.concatenate(each)[: len(at)]
        errors, conditions, slopes, ok = whole
        return errors, conditions, slopes, ok


@functools.partial(jit, static_argnums=0)
def _compiled_evaluate(
    structure: object, leaves: list[Array], x: Array, given: Array, scale: Array, found: DesignPoses
) -> tuple[Array, Array, Array, Array]:
    goal: Goal = jax.tree.unflatten(structure, leaves)

    def one(x: Array, given: Array, found: DesignPoses) -> tuple[Array, Array, Array, Array]:
        turn = found.turn
        poses = [found.q] if turn is None else [found.q, turn.q]
        ways = [found] if turn is None else [found, turn]

        def numbers(x: Array, *poses: Array) -> tuple[Array, Any]:
            seen = goal.evaluate(x, _motions_of(goal.problem, x, found, poses), given)
            return jnp.concatenate([seen.errors, seen.conditions]), seen

        def along(way: Array, *changes: Array) -> tuple[Array, Any]:
            _, slope, seen = jax.jvp(numbers, (x, *poses), (way, *changes), has_aux=True)
            return slope, seen

        changes = []
        for q, way in zip(poses, ways, strict=True):
            moved = jnp.zeros((len(x), *q.shape))
            if way.changes is not None:
                count = len(way.changes)
                moved = moved.at[:count].set(way.changes * scale[:count, None, None])
            changes.append(moved)
        rows, seen = jax.vmap(along, out_axes=(0, None))(jnp.diag(scale), *changes)
        return seen.errors, seen.conditions, rows.T, seen.ok

    return jax.vmap(one)(x, given, found)


def _motions_of(problem: Problem, x: Array, found: DesignPoses, poses: Any) -> tuple[Motion, Motion | None]:
    """Make motions of a design from poses; poses without known changes get their derivatives here."""
    z, extra = problem.split(x[: problem.count])
    system = problem.designed(z)

    def motion(way: DesignPoses, q: Array, values: Callable) -> Motion:
        out = make_motion(problem, system, q, way.status, way.values, jnp.zeros(way.values.shape))
        return attach_poses(out, system, values()[:, None]) if way.changes is None else out

    def over(way: DesignPoses) -> Array:
        low, high = problem.span(derive(system).home[system.topology.position[problem.driven]], extra)
        moved = jnp.linspace(0.0, 1.0, len(way.values)) * (high - low) + low
        return way.values + moved - jax.lax.stop_gradient(moved)

    through, turn = motion(found, poses[0], lambda: problem.inputs(extra)), found.turn
    if not problem.poses:
        return through, None
    return through, through if turn is None else motion(turn, poses[1], lambda: over(turn))


# -- motions -----------------------------------------------------------------------------------------------------------


class MovedDesign(NamedTuple):
    """A design and its motions."""

    x: np.ndarray  # the unknowns
    motion: Motion  # through the targets
    turn: Motion  # over the range of the input; the same where it has none


def move_designs(problem: Problem, xs: Sequence[np.ndarray]) -> list[MovedDesign]:
    """Move designs, all at once; see `follow_again` for one that fails one of its checks."""
    if not len(xs):
        return []
    x, poses = np.stack(xs), POSES if problem.travel[1] > problem.travel[0] else 0
    found, out = solve_poses(problem, x, poses, way="close"), []
    for k, one in enumerate(x):
        system = problem.design(one)

        def motion(way: DesignPoses, k: int = k, system: System = system) -> Motion:
            unknown = np.full(way.values[k].shape, np.nan)
            return make_motion(problem, system, way.q[k], way.status[k], way.values[k], unknown)

        through = motion(found)
        out.append(MovedDesign(one, through, through if found.turn is None else motion(found.turn)))
    return out


def follow_again(problem: Problem, one: MovedDesign) -> MovedDesign:
    """Follow motions of a design again that were lost on the way, and say how good their poses are."""
    motion = _follow_motion(problem, one.motion)
    return MovedDesign(one.x, motion, motion if one.turn is one.motion else _follow_motion(problem, one.turn))


def _follow_motion(problem: Problem, motion: Motion) -> Motion:
    system = motion.system
    view = plan(system.topology, motion.driven, motion.held, system.degrees_of_freedom)
    if view.large or not np.asarray(motion.converged).all():
        return problem.sweep(system, np.asarray(motion.asked)[:, 0])
    inner, q = HostView(view, from_jax(derive(system))), np.asarray(motion.poses).T
    with np.errstate(all="ignore"):
        residual = np.max(np.abs(inner.residual(q)), axis=0, initial=0.0)
        return dataclasses.replace(motion, residual=residual, conditioning=inner.conditioning(q))
