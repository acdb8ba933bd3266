"""One pose in every lane: the diagonal blocks of a plan solved one after the other, in lockstep.

What a block needs is already solved when its turn comes, so a chain of dyads costs as much as its dyads. A block of
two rows, each a circle or a line in its two unknowns, has its solution in closed form, on the side that the branch has;
rows that are affine need one step; everything else takes Newton from a guess, by an elimination that was planned once.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.remembered import with_owner
from jaxnc.solvers.elimination import Eliminated, Factors, Pivots, eliminate_block, plan_elimination
from jaxnc.solvers.plan import Plan, square_rows
from jaxnc.solvers.rows import FEW, TRACED, Lanes, Place, Rows, cramer, entry, guard_functions, replace_constants
from jaxnc.system.equations import Equations, pure_numbers
from jaxnc.system.precision import limits
from jaxnc.system.structure import jumps, steep
from jaxnc.types import Array

_ITERATIONS = 6  # the most of Newton on a block
LARGEST_WRITTEN = 120  # unknowns that are written out
MOST_WRITTEN = 1000  # multiplications of their eliminations: a program of so many takes XLA half a minute
_ROUNDING = 100.0  # times the last digit of the largest number met in an elimination
_FEW = 2  # blocks that may be computed into each other


class SolvedLanes(NamedTuple):
    """Solved lanes and what is known of them."""

    x: list[Any]  # all coordinates, each a number or lanes
    determinants: tuple[Any, ...]  # of every block; its sign is the block's orientation
    size: Any  # largest residual of all rows, a length
    pivots: Any  # smallest over largest pivot, coordinates as lengths
    upright: Any  # whether no row and no body is met by a mirror image
    mirrored: Any  # whether a body is


class _Block:
    """A diagonal block: its rows, its columns, and how it is solved."""

    def __init__(self, plan: Plan, rows: np.ndarray, columns: np.ndarray, sample: np.ndarray):
        top = plan.topology
        self.columns = tuple(int(c) for c in plan.unknown[columns])
        self.rows = Rows(top, [int(plan.rows[r]) for r in rows], self.columns)
        self._pure = pure_numbers(top)[list(self.columns)]
        self.elimination = plan_elimination(sample[np.ix_(rows, columns)])

    @property
    def closed(self) -> bool:
        """True if a formula gives the one solution of each orientation without a guess."""
        return self.rows.form in ("affine", "round") and len(self.columns) <= FEW

    @property
    def guessed(self) -> bool:
        """True if the block needs a guess: the turn of an angle, or where Newton is to begin."""
        return self.rows.form in ("angle", "iterated")

    def factors(self, eq: Equations, x: Lanes) -> Eliminated:
        return self.eliminate_slopes(eq, self.rows.slopes(eq, x))

    def solver(self, eq: Equations, slopes: dict[tuple[int, int], Any]) -> Callable[[Sequence[Array]], Sequence[Any]]:
        """Return solves with the block's derivatives, which are lanes: exact, and differentiable to any order.

        Few columns are solved by determinants. The order of an elimination's pivots is not that of each lane: it is
        refined once, by the same program.
        """
        n = len(self.columns)
        if n <= FEW:
            matrix = [[slopes.get((r, c), 0.0) for c in range(n)] for r in range(n)]
            # Quotients are what XLA computes once, however many use them; so in reverse.
            one = jnp.where(opaque_true(eq), 1.0, 2.0)
            return lambda right: cramer(matrix, [b / one for b in right])
        known = lax.stop_gradient(slopes)

        def product(slopes: dict[tuple[int, int], Any], x: Sequence[Any], turned: bool) -> list[Any]:
            out: list[Any] = [0.0] * n
            for (r, c), slope in slopes.items():
                row, column = (c, r) if turned else (r, c)
                out[row] = out[row] + slope * x[column]
            return out

        def solve(right: Sequence[Array], turned: bool) -> tuple[Array, ...]:
            def improve(_: Any, x: tuple[Array, ...]) -> tuple[Array, ...]:
                rest = [b - d for b, d in zip(right, product(known, x, turned), strict=True)]
                factors = self.eliminate_slopes(eq, known)
                change = factors.solve_transposed(rest) if turned else factors.solve(rest)
                return tuple(v + d for v, d in zip(x, change, strict=True))

            return lax.fori_loop(0, 2, improve, tuple(jnp.zeros_like(b) for b in right))

        def solution(right: Sequence[Array]) -> tuple[Array, ...]:
            # Transposition asks that every part of the right side depends on what is differentiated.
            none = 0.0 * functools.reduce(jnp.add, right)
            return lax.custom_linear_solve(
                lambda x: tuple(product(slopes, x, False)),
                tuple(b + none for b in right),
                lambda _, b: solve(b, False),
                transpose_solve=lambda _, b: solve(b, True),
            )

        return solution

    def eliminate_slopes(self, eq: Equations, slopes: dict[tuple[int, int], Any]) -> Eliminated:
        """Eliminate the block's derivatives. Coordinates that are no lengths count times the size."""
        units = [eq.length if pure else 1.0 for pure in self._pure]
        return eliminate_block(self.elimination, slopes, units, limits(eq.length).fine)


class Kernel:
    """The blocks of a plan, ready to be written out. Make it with `kernel`."""

    def __init__(self, plan: Plan):
        self.plan = plan
        top = plan.topology
        chosen = square_rows(plan)
        self.blocks = [_Block(plan, rows, columns, chosen.sample) for rows, columns in chosen.sequence]
        self.everything = Rows(top, range(len(top.rows)))
        self.guards = [guard_functions(top, bodies) for bodies in (False, True)]
        # What has no finite derivative with respect to an input is met, and yet no pose to go on from.
        pairs = zip(top.blocks, top.layout, strict=True)
        rows = [r for block, layout in pairs if steep(block.kind, top.dim) for r in layout.rows.flat]
        self.steep = Rows(top, rows, [int(c) for c in plan.known])
        self.jumps = jumps_anywhere(plan)  # so that every step is looked at by its tangents

    @property
    def guessed(self) -> list[int]:
        """Coordinates whose block needs a guess."""
        return [c for b in self.blocks if b.guessed for c in b.columns]

    @property
    def closed(self) -> bool:
        """True if every block has a closed form, and no row jumps."""
        return not self.jumps and all(b.closed for b in self.blocks)

    def signs(self, eq: Equations, x: Lanes) -> tuple[Array, ...]:
        """Return the orientation of every block at a pose."""
        return tuple(jnp.sign(d) for d in self.determinants(eq, x))

    def determinants(self, eq: Equations, x: Lanes) -> tuple[Array, ...]:
        """Return the determinant of every block at a pose."""
        return tuple(b.factors(eq, x).determinant for b in self.blocks)

    def solve(self, eq: Equations, x: Lanes, signs: Sequence[Any]) -> SolvedLanes:
        """Solve all lanes.

        Known coordinates are at their values, the others where to begin; signs are the orientation wanted of each
        block.
        """
        x, iterated = self.positions(eq, x, signs)
        return self.diagnose(eq, x, iterated)

    def positions(self, eq: Equations, x: Lanes, signs: Sequence[Any]) -> tuple[list[Any], dict[int, Eliminated]]:
        """Solve for all coordinates; return them, and the last eliminations of the blocks that took Newton."""
        x = list(x)
        iterated: dict[int, Eliminated] = {}
        for k, (block, sign) in enumerate(zip(self.blocks, signs, strict=True)):
            if block.closed or block.rows.form == "angle":
                y = block.rows.run_solution(TRACED)([*block.rows.collect(x, eq), sign])
            else:
                y, iterated[k] = self._iterate(block, eq, x)
            if len(self.blocks) > _FEW and k not in iterated:
                y = fusion_barrier(opaque_true(eq), lambda y: y, y)
            for c, v in zip(block.columns, y, strict=True):
                x[c] = v
        return x, iterated

    def diagnose(self, eq: Equations, x: list[Any], iterated: dict[int, Eliminated] | None = None) -> SolvedLanes:
        """Find what is to be known of poses."""
        factors = [(iterated or {}).get(k) or block.factors(eq, x) for k, block in enumerate(self.blocks)]
        found = tuple(f.determinant for f in factors)
        return SolvedLanes(x, found, *self._diagnose(eq, x, factors))

    def evaluate(self, eq: Equations, x: Lanes) -> tuple[Any, Any, Any, Any]:
        """Return the largest residual, the conditioning, and whether upright and mirrored, of poses found elsewhere."""
        return self._diagnose(eq, x, [block.factors(eq, x) for block in self.blocks])

    def _diagnose(self, eq: Equations, x: Lanes, factors: Sequence[Eliminated]) -> tuple[Any, Any, Any, Any]:
        pivots = [f.pivots for f in factors]
        size = _reduce(jnp.maximum, [jnp.abs(r) for r in self.everything.values(eq, x)] or [jnp.zeros(())])
        rows, bodies = (guard.values(eq, x) for guard in self.guards)
        upright = _reduce(jnp.logical_and, [g > 0.0 for g in (*rows, *bodies)] or [jnp.array(True)])
        for slope in self.steep.slopes(eq, x).values():
            upright = upright & jnp.isfinite(slope)
        mirrored = _reduce(jnp.logical_or, [g <= 0.0 for g in bodies] or [jnp.array(False)])
        return size, smallest(pivots), upright, mirrored

    def _iterate(self, block: _Block, eq: Equations, x: list) -> tuple[Sequence[Any], Factors]:
        """Solve a block by Newton, in all lanes until the last has it."""
        columns, pure = block.columns, pure_numbers(self.plan.topology)
        shape = jnp.broadcast_shapes(*(jnp.shape(x[c]) for c in block.rows.needed), jnp.shape(eq.length))
        one, go = jnp.ones(shape), opaque_true(eq)

        def newton_step(y):
            at = list(x)
            for c, v in zip(columns, y, strict=True):
                at[c] = v
            factors = block.factors(eq, at)
            step = factors.solve(block.rows.values(eq, at))
            return [v * one for v in (*step, *factors.pivots, factors.determinant)]

        def improve(state):
            i, y, *_ = state
            *step, least, largest, grown, determinant = fusion_barrier(go, newton_step, y)
            moved = [jnp.abs(d) / (1.0 if pure[c] else eq.length) for d, c in zip(step, columns, strict=True)]
            y = tuple(v - d for v, d in zip(y, step, strict=True))
            # One maximum over the lanes: XLA makes three kernels of each.
            return i + 1, y, Pivots(least, largest, grown), determinant, jnp.max(_reduce(jnp.maximum, moved))

        start = tuple(jnp.broadcast_to(x[c], shape) for c in columns)
        state = (jnp.zeros((), int), start, Pivots(one, one, one), one, jnp.asarray(jnp.inf))
        most = 1 if block.rows.form == "affine" else _ITERATIONS
        fine = limits(eq.length).fine
        _, y, pivots, determinant, _ = lax.while_loop(lambda st: (st[0] < most) & (st[4] > fine), improve, state)
        return y, Factors((), pivots, determinant)

    def tangent(
        self,
        eq: Equations,
        x: Lanes,
        x_dot: Sequence[Any | None],
        constants_dot: Mapping[Place, Any] | None = None,
        ok: Array | None = None,
    ) -> list[Any | None]:
        """Differentiate all coordinates by the known ones (and by constants), lane by lane.

        Changes are None where there is none; those of unknown coordinates are replaced. Where it is not `ok` the change
        is zero, and so are derivatives of it.
        """
        x_dot, constants_dot = list(x_dot), constants_dot or {}
        for c in self.plan.unknown:
            x_dot[c] = None
        for block in self.blocks:
            moving = [c for c in sorted(block.rows.needed) if x_dot[c] is not None]
            varied = [at for at in block.rows.constant_places if at in constants_dot]
            if not moving and not varied:
                continue

            def rows(*given, block=block, moving=moving, varied=varied):
                at = list(x)
                for c, v in zip(moving, given, strict=False):
                    at[c] = v
                constants = dict(zip(varied, given[len(moving) :], strict=True))
                # Scales multiply what vanishes: their changes change nothing.
                return block.rows.values(replace_constants(eq, constants), at)

            changes: list[Any] = [x_dot[c] for c in moving] + [constants_dot[at] for at in varied]
            values = [x[c] for c in moving] + [entry(eq.constants[b], i, k) for b, i, k in varied]
            at = [jnp.broadcast_to(v, jnp.shape(d)) for v, d in zip(values, changes, strict=True)]
            _, r_dot = jax.jvp(rows, tuple(at), tuple(map(jnp.asarray, changes)))
            slopes = block.rows.slopes(eq, x)
            shape = jnp.broadcast_shapes(*map(jnp.shape, (*r_dot, *slopes.values())))
            if ok is not None:
                unit = set(zip(block.elimination.rows, block.elimination.columns, strict=True))
                slopes = {at: jnp.where(ok, e, 1.0 if at in unit else 0.0) for at, e in slopes.items()}
                r_dot = [jnp.where(ok, r, 0.0) for r in r_dot]
            slopes = {at: jnp.broadcast_to(e, shape) for at, e in slopes.items()}
            change = block.solver(eq, slopes)([jnp.broadcast_to(r, shape) for r in r_dot])
            for c, d in zip(block.columns, change, strict=True):
                x_dot[c] = -d
        return x_dot


def on_branch(eq: Equations, found: SolvedLanes, signs: Sequence[Any] | Array, passing: Any = False) -> Array:
    """Say which lanes are solved, regular, on the branch of the given orientation, and not met by a mirror image.

    Poses that are only passed on the way (`passing`) may be ones at which a planned elimination loses its digits: of
    32-bit numbers these are many.
    """
    ok = (
        found.upright
        & (found.size <= lane_tolerance(eq, found.x))
        & (passing | (found.pivots > limits(eq.length).poor))
    )
    for a, b in zip(found.determinants, signs, strict=True):
        ok = ok & (jnp.sign(a) == b)
    return ok


def lane_tolerance(eq: Equations, x: Sequence[Any]) -> Array:
    """Largest residual of a pose that counts as a solution, lane by lane; as `newton.tolerance`."""
    least, largest = limits(eq.length), jnp.zeros(())
    for v, pure in zip(x, pure_numbers(eq.topology), strict=True):
        largest = jnp.maximum(largest, eq.length * jnp.abs(v) if pure else jnp.abs(v))
    return least.accept * eq.length + least.rounding * largest


def length_of(plan: Plan, eq: Equations) -> Callable[[list[Array]], Array]:
    """Return the function that measures a change of the unknown coordinates."""
    pure = pure_numbers(plan.topology)[plan.unknown]
    return lambda change: jnp.sqrt(sum((d * eq.length if p else d) ** 2 for d, p in zip(change, pure, strict=True)))


def jumps_anywhere(plan: Plan) -> bool:
    """Say whether rows may jump: of a kind of a user's own."""
    return any(jumps(block.kind, plan.topology.dim) for block in plan.topology.blocks if block.kind.rows)


def fusion_barrier(go: Array, f, *arguments):
    """The same as ``f(*arguments)``, its results made before anything that uses them.

    XLA on a CPU would otherwise compute what several others use once for each of them, and so on upwards.
    """
    f = jax.jit(f, inline=True)
    shapes = jax.eval_shape(f, *arguments)
    return lax.cond(go, f, lambda *_: jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes), *arguments)


def opaque_true(eq: Equations) -> Array:
    """Return true, which the compiler cannot know."""
    return jnp.all(eq.length > 0.0)


def smallest(pivots: Sequence[Pivots]) -> Any:
    """Return the smallest over the largest pivot of all blocks, zero where rounding may have made it of zero."""
    if not pivots:
        return jnp.ones(())
    least = _reduce(jnp.minimum, [p.least for p in pivots])
    most, grown = (_reduce(jnp.maximum, parts) for parts in ([p.most for p in pivots], [p.grown for p in pivots]))
    return jnp.maximum(least - _ROUNDING * jnp.finfo(grown.dtype).eps * grown, 0.0) / most


def _reduce(f, parts: Sequence[Any]) -> Any:
    return functools.reduce(f, parts)


def writes_out(plan: Plan) -> bool:
    """Say whether a plan is small enough to be written out element by element: beyond, compiling takes too long."""
    if plan.large or not 0 < len(plan.unknown) <= LARGEST_WRITTEN:
        return False
    return sum(block.elimination.cost for block in kernel(plan).blocks) <= MOST_WRITTEN


@with_owner
def kernel(plan: Plan) -> Kernel:
    """The kernel of a plan, written once."""
    return Kernel(plan)
