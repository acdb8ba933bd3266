"""`flip_margin`: how far poses are from flipping into another assembly, in lengths and in the unit of the input.

Two assemblies meet at a singular position, and a mechanism flips from the one into the other. Across it the determinant
of a block of the constraints changes its sign, which tells the pair apart. What is solved here are these blocks, each
with the other sign, and those that hang on it after it.
"""

import functools
import itertools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.calls import public
from jaxnc.compiling import jit
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.records import record
from jaxnc.solvers.assembly import derive
from jaxnc.solvers.kernel import Kernel, kernel, on_branch, writes_out
from jaxnc.solvers.newton import attach_lanes
from jaxnc.solvers.plan import Plan, plan
from jaxnc.solvers.rows import TRACED, Lanes
from jaxnc.system.equations import Equations
from jaxnc.system.precision import limits
from jaxnc.types import Array

_STARTS = ((1.0, 0.0), (0.3, 1.0), (-0.3, 1.0))  # parts of the way across, and whether Newton is kept from the pose


@public
@record
class FlipMargin:
    """How far poses are from flipping; infinite where there is nothing to flip into.

    Attributes:
        distance: how far the farthest of all points, markers not among them, moves from the pose to the nearest
            assembly into which it flips with its inputs held, ``(...,)``, a length.
        input: how far the input can go until the nearest dead point, forwards or backwards, ``(...,)``, in radians or
            lengths; right to third order near a dead point; where several folds of one block coincide, as in a Sarrus
            linkage that is drawn out, with an error of the root of what is left. Of several inputs, all angles or all
            lengths, the root of the sum of squares of their changes on the shortest way to a singular position.
            Infinite where it would be farther than half a turn, or the mechanism's size, where the continuation has no
            zero (which proves nothing: see `jaxnc.travel`), and for inputs of both kinds.
        dead_point: value of the only input there, ``(...,)``; infinite for several.
        other: all coordinates of the assembly into which it flips, ``(..., N)``; those of the pose if there is none.
    """

    distance: Array
    input: Array
    dead_point: Array
    other: Array


@public
def flip_margin(motion: Motion) -> FlipMargin:
    """Measure how far the poses of a motion are from flipping into another assembly.

    Both measures are exact functions of pose and design, with exact derivatives, in `jax.jit`, `jax.vmap` and
    `jax.grad`. Where a block of the constraints has a closed form (a dyad), the other assembly is found in any case,
    with either orientation of up to three dyads that hang on it. Elsewhere it is sought by Newton's steps from where
    second derivatives say that it is: near a singular position it is found; far from any, one that is farther away may
    be found, or none. `jaxnc.modes` lists all.

    Args:
        motion: any poses of one design, or of a batch of designs.

    Returns:
        The margins. Of poses that were not found they are zero.

    Raises:
        InputError: nothing is driven or held in the motion (a simulation, a circuit), or the mechanism is so large that
            its constraints are not written out.

    Source: J. M. McCarthy and G. S. Soh, Geometric Design of Linkages, 2nd ed. (2011), on branches and the sign of the
    Jacobian's determinant.
    """
    system = motion.system
    if not motion.driven and system.degrees_of_freedom:
        raise InputError(
            f"flip_margin(): nothing is driven in this motion of {system.topology.name!r}; give one of sweep() or "
            f"solve_position(), whose inputs are held while it flips"
        )
    view = plan(system.topology, motion.driven, motion.held, system.degrees_of_freedom)
    if not writes_out(view):
        raise InputError(
            f"flip_margin(): {system.topology.name!r} has {len(view.unknown)} unknowns, too many to be written out; "
            f"jaxnc.modes lists its assemblies"
        )
    inner = functools.partial(_measure_margins, view)
    for _ in range(motion._designs):
        inner = jax.vmap(inner)
    return inner(motion)


@functools.partial(jit, static_argnums=0)
def _measure_margins(view: Plan, motion: Motion) -> FlipMargin:
    core, eq = kernel(view), derive(motion.system)
    shape = motion.status.shape
    good = motion.converged.reshape(-1)
    q = jnp.where(good[:, None], motion.q.reshape(-1, motion.q.shape[-1]), lax.stop_gradient(eq.home))
    x = [q[:, c] for c in range(q.shape[1])]
    known = tuple(x[int(c)] for c in view.known)
    fixed_eq, fixed_x = lax.stop_gradient((eq, x))
    found, there = _flip(core, view, fixed_eq, fixed_x)
    there = there & good
    unknown = tuple(jnp.where(there, found[int(c)], fixed_x[int(c)]) for c in view.unknown)
    unknown = attach_lanes(view, unknown, eq, known, there)
    other = list(x)
    for c, v in zip(view.unknown, unknown, strict=True):
        other[int(c)] = jnp.where(there, v, x[int(c)])
    far = _square_of_movement(view, eq, x, other)
    distance = jnp.where(there, jnp.sqrt(jnp.where(there, far, 1.0)), jnp.where(good, jnp.inf, 0.0))
    unlimited = jnp.full(good.shape, jnp.inf)
    reach, dead_point = unlimited, unlimited
    squares = _determinant_squares(view, core, eq, x, known, good)
    most = jnp.pi if view.angles else eq.length
    if len(view.driven) == 1:
        ahead = _way_to_dead_point(squares, good, most)
        reach, dead_point = jnp.abs(ahead), known[0] + ahead
    elif len({k in view.angles for k in range(len(view.driven))}) == 1:
        reach = _way_to_singularity(squares, len(view.driven), good, most)
    reach = jnp.where(good, reach, 0.0)
    several = jnp.stack(other, axis=-1).reshape(*shape, len(other))
    return FlipMargin(distance.reshape(shape), reach.reshape(shape), dead_point.reshape(shape), several)


def _square_of_movement(view: Plan, eq: Equations, x: Lanes, other: Lanes) -> Any:
    """Square of the largest movement of a point; of unit vectors, times the size, where no point moves."""
    top = view.topology
    squares = [
        sum((other[k * top.dim + a] - x[k * top.dim + a]) ** 2 for a in range(top.dim))
        for k in range(len(top.points) + len(top.vectors))
    ]
    points, vectors = squares[: len(top.points)], squares[len(top.points) :]
    far = functools.reduce(jnp.maximum, points)
    if not vectors:
        return far
    turned = functools.reduce(jnp.maximum, vectors) * eq.length**2
    return jnp.where(far > (limits(eq.length).close * eq.length) ** 2, far, turned)


# -- the other assembly ------------------------------------------------------------------------------------------------


def _flip(core: Kernel, view: Plan, eq: Equations, x: Lanes) -> tuple[Lanes, Array]:
    """The nearest of the assemblies that differ in a block and what hangs on it, and whether there is one.

    All of them are sought side by side, which compiles the solution of a pose once.
    """
    signs, lanes = core.signs(eq, x), x[0].shape
    bent = [block.rows.form not in ("affine", "angle") for block in core.blocks]
    starts, turned, loose = [], [], []  # of each attempt: all coordinates, blocks that turn, and those that may
    for k, block in enumerate(core.blocks):
        if not bent[k]:
            continue
        behind = _blocks_behind(core, k)
        # Both orientations of three dyads that hang on it: more of them are ways that are many, and far.
        dyads = [j for j in behind if bent[j] and core.blocks[j].closed][:3]
        several = [x] if block.closed else _seek(block, eq, x)
        for chosen in itertools.product((False, True), repeat=len(dyads)):
            starts += several
            turned += [{k, *itertools.compress(dyads, chosen)}] * len(several)
            loose += [{k, *behind}] * len(several)
    if not starts:
        return x, jnp.zeros(lanes, bool)
    begin = [jnp.stack([jnp.broadcast_to(start[c], lanes) for start in starts]) for c in range(len(x))]
    wanted: list[Array] = []
    for k, sign in enumerate(signs):
        turns = np.array([k in blocks for blocks in turned])
        wanted.append(jnp.where(turns[:, None], -sign, jnp.broadcast_to(sign, (len(turns), *lanes))))
    found = core.solve(eq, begin, wanted)
    for k, block in enumerate(core.blocks):
        if not (block.closed and bent[k]):  # with one solution, or told by its place: it has either orientation
            free = np.array([k in blocks for blocks in loose])
            wanted[k] = jnp.where(free[:, None], jnp.sign(found.determinants[k]), wanted[k])
    far = _square_of_movement(view, eq, x, found.x)
    # What is as near as 1e-7 of the mechanism's size is the same assembly.
    far = jnp.where(on_branch(eq, found, wanted) & (far > (1e-7 * eq.length) ** 2), far, jnp.inf)
    best = jnp.argmin(far, axis=0)[None]

    def nearest(values: Array) -> Array:
        return jnp.take_along_axis(jnp.broadcast_to(values, far.shape), best, axis=0)[0]

    return [nearest(v) for v in found.x], jnp.isfinite(nearest(far))


def _blocks_behind(core: Kernel, first: int) -> list[int]:
    """Count up the blocks that hang on one, directly or through others."""
    moved, out = {*core.blocks[first].columns}, []
    for k in range(first + 1, len(core.blocks)):
        if moved & {*core.blocks[k].rows.coordinates}:
            moved |= {*core.blocks[k].columns}
            out.append(k)
    return out


def _seek(block: Any, eq: Equations, x: Lanes) -> list[Lanes]:
    """Places near other solutions of a block, from parts of the way across its nearest singular position.

    Source: P. E. Farrell, A. Birkisson and S. W. Funke, Deflation techniques for finding distinct solutions of
    nonlinear partial differential equations, SIAM J. Sci. Comput. 37 (2015) A2026-A2045.
    """
    part, kept = jnp.array(_STARTS).T[:, :, None]
    across, unit = _aim_across(block, eq, x), eq.length**2
    long = jnp.sqrt(sum(d * d for d in across) / unit)
    longest = 0.5  # of the mechanism's size: a step
    short = jnp.where(kept > 0.0, jnp.minimum(1.0, longest / jnp.maximum(long, limits(eq.length).tiny)), 1.0)

    def place(change: tuple[Array, ...]) -> Lanes:
        at = list(x)
        for c, d in zip(block.columns, change, strict=True):
            at[c] = x[c] + d
        return at

    def improve(_: Array, change: tuple[Array, ...]) -> tuple[Array, ...]:
        at = place(change)
        step = block.factors(eq, at).solve(block.rows.values(eq, at))
        square = sum(d * d for d in change) / unit
        # Rows times 1 + 1 / square have the same solutions but the known one: that turns and stretches the step.
        pull = 2.0 * sum(d * e for d, e in zip(change, step, strict=True)) / (unit * square * (1.0 + square))
        scale = 1.0 / (1.0 - kept * pull)
        size = jnp.sqrt(sum(e * e for e in step) / unit) * jnp.abs(scale)
        scale = scale / jnp.maximum(1.0, size / longest)
        return tuple(d - scale * e for d, e in zip(change, step, strict=True))

    # Steps of Newton, before those that a block takes by itself.
    at = place(lax.fori_loop(0, 8, improve, tuple(d * (part * short) for d in across)))
    return [[v[k] if v.ndim > 1 else v for v in at] for k in range(len(_STARTS))]


def _aim_across(block: Any, eq: Equations, x: Lanes) -> list[Array]:
    """Changes of a block's coordinates that lead across its nearest singular position.

    Of rows F of second degree the change d has ``J d + H d d / 2 = 0``. Along the direction r in which J is weakest it
    is ``d = s r`` with ``s = -2 r·r / (r·w)``, where ``J w = H r r``.
    """
    factors = block.factors(eq, x)
    r: list[Any] = [jnp.ones(x[0].shape)] * len(block.columns)
    for _ in range(3):  # enough beside a singular position, where one direction is far ahead
        r = factors.solve(factors.solve_transposed(r))
        size = jnp.sqrt(sum(v * v for v in r))
        r = [v / size for v in r]

    def rows(along: Array) -> list[Array]:
        at = list(x)
        for c, d in zip(block.columns, r, strict=True):
            at[c] = x[c] + along * d
        return list(block.rows.values(eq, at))

    def slope(along: Array) -> list[Array]:
        return jax.jvp(rows, (along,), (jnp.ones_like(along),))[1]

    zero = jnp.zeros(x[0].shape)
    bend = jax.jvp(slope, (zero,), (jnp.ones_like(zero),))[1]
    w = factors.solve([jnp.broadcast_to(b, zero.shape) for b in bend])
    along = sum(a * b for a, b in zip(r, w, strict=True))
    tiny = limits(eq.length).tiny
    s = -2.0 / jnp.where(jnp.abs(along) > tiny, along, jnp.inf)
    return [s * v for v in r]


# -- the dead point ----------------------------------------------------------------------------------------------------


def _determinant_squares(
    view: Plan, core: Kernel, eq: Equations, x: Lanes, known: tuple[Array, ...], good: Array
) -> Callable[..., tuple[Array, ...]]:
    """The squares of the determinants of blocks that can flip, but for factors, by steps of the driven coordinates."""
    unknown = tuple(lax.stop_gradient(x[int(c)]) for c in view.unknown)
    bent = [block.rows.form not in ("affine", "angle") for block in core.blocks]
    signs = lax.stop_gradient(core.signs(eq, x)) if core.by_formulas else ()

    def evaluate(*steps: Array) -> tuple[Array, ...]:
        moved = (*(k + step for k, step in zip(known, steps, strict=False)), *known[len(steps) :])
        at, found = list(x), []
        for c, v in zip((*view.unknown, *view.known), (*unknown, *moved), strict=True):
            at[int(c)] = v
        if core.by_formulas:  # they are differentiated as they stand
            for block, bends, sign in zip(core.blocks, bent, signs, strict=True):
                given = block.rows.collect(at, eq)
                if bends:
                    found += block.rows.run_square(TRACED)(given)
                for c, v in zip(block.columns, block.rows.run_solution(TRACED)([*given, sign]), strict=True):
                    at[c] = v
        else:
            for c, v in zip(view.unknown, attach_lanes(view, unknown, eq, moved, good), strict=True):
                at[int(c)] = v
            found = [d * d for d, bends in zip(core.determinants(eq, at), bent, strict=True) if bends]
        return tuple(jnp.broadcast_to(d, good.shape) for d in found)

    return evaluate


def _way_to_singularity(squares: Callable[..., tuple[Array, ...]], inputs: int, good: Array, most: Any) -> Array:
    """How far several inputs are from a singular position, along the gradient of each determinant."""
    steps = tuple(jnp.zeros(good.shape) for _ in range(inputs))
    every = [tuple(jnp.ones_like(s) if j == k else s for j, s in enumerate(steps)) for k in range(inputs)]
    slopes = [jax.jvp(squares, steps, one)[1] for one in every]
    nearest = jnp.full(good.shape, jnp.inf)
    for k in range(len(squares(*steps))):
        square = sum(slope[k] ** 2 for slope in slopes)
        size = jnp.sqrt(jnp.where(square > 0.0, square, 1.0))
        # The gradient here is the normal there but for the margin times a curvature: an error of third order.
        way = jnp.abs(_ways_to_zero(squares, tuple(slope[k] / size for slope in slopes), good)[k])
        nearest = jnp.where(way < jnp.minimum(nearest, most), way, nearest)
    return nearest


def _way_to_dead_point(squares: Callable[..., tuple[Array, ...]], good: Array, most: Any) -> Array:
    """How far the only driven input is from the nearest dead point, forwards positive; infinite where there is none."""
    nearest = jnp.full(good.shape, jnp.inf)
    for way in _ways_to_zero(squares, (jnp.ones(good.shape),), good):
        nearest = jnp.where(jnp.abs(way) < jnp.minimum(jnp.abs(nearest), most), way, nearest)
    return nearest


def _ways_to_zero(squares: Callable[..., tuple[Array, ...]], direction: tuple[Array, ...], good: Array) -> list[Array]:
    """How far each determinant is from zero in a direction of the inputs, forwards positive; infinite if it has none.

    At a fold the square of a block's determinant is smooth in the inputs and vanishes: it is continued by its first and
    second derivative along the motion.
    """

    def rates(*steps: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        return jax.jvp(squares, steps, direction)

    (values, first), (_, second) = jax.jvp(rates, tuple(jnp.zeros_like(s) for s in direction), direction)
    ways = []
    for square, rise, bend in zip(values, first, second, strict=True):
        # D² / D(0)² = 1 + 2 a s + b s², whose nearer root is wanted.
        regular = jnp.where(square > 0.0, square, 1.0)
        a, b = 0.5 * rise / regular, 0.5 * bend / regular
        real = good & (a * a > b)
        down = a + jnp.where(a >= 0.0, 1.0, -1.0) * jnp.sqrt(jnp.where(real, a * a - b, 1.0))
        ways.append(jnp.where(square > 0.0, jnp.where(real, -1.0 / down, jnp.inf), 0.0))
    return ways
