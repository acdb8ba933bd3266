"""One pose in every lane: the diagonal blocks of a plan solved one after the other, in lockstep.

What a block needs is already solved when its turn comes, so a chain of dyads costs as much as its dyads. A block of
two rows, each a circle or a line in its two unknowns, has its solution in closed form, on the side that the branch has;
rows that are affine need one step; everything else takes Newton from a guess, by an elimination that was planned once.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.autodiff import solve_linear
from jaxnc.records import with_owner
from jaxnc.solvers import dense
from jaxnc.solvers.elimination import Eliminated, Factors, Pivots, eliminate_block, plan_elimination
from jaxnc.solvers.plan import LARGEST_WRITTEN, Plan
from jaxnc.solvers.rows import FEW, TRACED, Lanes, Place, Rows, cramer, entry, guard_functions, replace_constants
from jaxnc.system.equations import Equations, pure_numbers
from jaxnc.system.precision import limits
from jaxnc.system.structure import jumps, steep
from jaxnc.types import AnyArray, Array, ArrayLike, Numbers


class SolvedLanes(NamedTuple):
    """Solved lanes and what is known of them."""

    x: list[AnyArray]  # all coordinates, each a number or lanes
    determinants: tuple[AnyArray, ...]  # of every block; its sign is the block's orientation
    size: AnyArray  # largest residual of all rows, a length
    pivots: AnyArray  # smallest over largest pivot, coordinates as lengths
    upright: AnyArray  # whether no row and no body is met by a mirror image
    mirrored: Numbers | bool  # whether a body is


class _Block:
    """A diagonal block: its rows, its columns, and how it is solved."""

    def __init__(self, plan: Plan, rows: np.ndarray, columns: np.ndarray):
        top = plan.topology
        self.columns = tuple(int(c) for c in plan.unknown[columns])
        self.rows = Rows(top, [int(plan.rows[r]) for r in rows], self.columns)
        self._pure = pure_numbers(top)[list(self.columns)]
        self.elimination = plan_elimination(plan.sample[np.ix_(rows, columns)])
        # rows and columns of the pivots
        self.pivots = set(zip(self.elimination.rows, self.elimination.columns, strict=True))

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

    def solve(self, eq: Equations, slopes: dict[tuple[int, int], Array], right: Sequence[Array]) -> Sequence[AnyArray]:
        """Solve with the block's derivatives, which are lanes: exactly, and differentiable to any order.

        Few columns are solved by determinants. The order of an elimination's pivots is not that of each lane: it is
        refined once, by the same program. Rows beyond the block's own follow from it: they are needed in those lanes
        only in which its own are weak.
        """
        n, rows = len(self.columns), len(right)
        if n == rows <= FEW:
            matrix = [[slopes.get((r, c), 0.0) for c in range(n)] for r in range(n)]
            # Quotients are what XLA computes once, however many use them; so in reverse.
            one = jnp.where(opaque_true(eq), 1.0, 2.0)
            return cramer(matrix, [b / one for b in right])
        known = lax.stop_gradient(slopes)
        own = {(r, c): slope for (r, c), slope in known.items() if r < n}

        def product(slopes: dict[tuple[int, int], Array], x: Sequence[Array], turned: bool) -> list[Array]:
            out: list[AnyArray] = [jnp.zeros_like(v) for v in x]
            for (r, c), slope in slopes.items():
                row, column = (c, r) if turned else (r, c)
                out[row] = out[row] + slope * x[column]
            return out

        def refined(right: Sequence[Array], turned: bool) -> tuple[Array, ...]:
            zero, one = jnp.zeros_like(right[0]), jnp.ones_like(right[0])

            def improve(_: Array, state: tuple) -> tuple:
                x = state[0]
                rest = [b - d for b, d in zip(right, product(known, x, turned), strict=True)]
                factors = self.eliminate_slopes(eq, own)
                change = factors.solve_transposed(rest[:n]) if turned else factors.solve(rest[:n])
                x = tuple(v + d for v, d in zip(x, change, strict=False)) + (zero,) * (rows - n)
                return (x, Pivots(*(p * one for p in factors.pivots))) if rows > n else (x,)

            begin = (zero,) * rows, Pivots(one, one, one)
            x, *pivots = lax.fori_loop(0, 2, improve, begin if rows > n else begin[:1])
            if rows == n:
                return x
            # A pivot that vanished was moved: what it did not solve is left.
            left = [b - d for b, d in zip(right, product(known, x, turned), strict=True)]
            size, missed = (reduce(jnp.maximum, [jnp.abs(v) for v in those]) for those in (right, left))
            weak = ~_is_strong(pivots) | ~(missed <= 1e-9 * size)  # of the right-hand side
            given = ((zero,) * rows, tuple(right[:n])) if turned else (tuple(right), (zero,) * n)
            found = _orthogonalise(known, *given, weak, (x, x[:n]))
            return found[0] if turned else (*found[1], *x[n:])

        # Rows beyond the block's own have a column of zeros each.
        return solve_linear(
            lambda x: tuple(product(slopes, x, False)),
            tuple(right),
            lambda b: refined(b, False),
            lambda b: refined(b, True),
        )[:n]

    def eliminate_slopes(self, eq: Equations, slopes: dict[tuple[int, int], Array]) -> Eliminated:
        """Eliminate the block's derivatives. Coordinates that are no lengths count times the size."""
        units = [eq.length if pure else 1.0 for pure in self._pure]
        return eliminate_block(self.elimination, slopes, units, limits(eq.length).fine)


class _AllRows:
    """All rows of a plan that has more of them than unknowns, solved in the least-squares sense.

    The rows that the kernel solves with are eliminated block by block. With these, A, and the spare ones, B, least
    squares take ``W = B A⁻¹`` and one small matrix, ``I + W Wᵀ``, which has as many rows as are spare.
    """

    def __init__(self, plan: Plan):
        self.rows = Rows(plan.topology, plan.rows.tolist(), plan.unknown.tolist())
        self.blocks = [
            (rows.tolist(), columns.tolist(), plan_elimination(plan.sample[np.ix_(rows, columns)]))
            for rows, columns in plan.choice
        ]
        self.kept = [r for rows, _, _ in self.blocks for r in rows]
        self.spare = sorted({*range(len(plan.rows))} - {*self.kept})
        self._pure = pure_numbers(plan.topology)[plan.unknown]
        pairs = ((rows, columns, zip(e.rows, e.columns, strict=True)) for rows, columns, e in self.blocks)
        self.pivots = {(rows[i], columns[j]) for rows, columns, places in pairs for i, j in places}

    def solve(self, eq: Equations, slopes: dict[tuple[int, int], Array], right: Sequence[Array]) -> tuple[Array, ...]:
        """Return the least-squares solution for one right-hand side, differentiable to any order."""
        known, count = lax.stop_gradient(slopes), len(right)

        def rows_and_columns(parts: tuple) -> tuple[tuple, tuple]:
            return parts[:count], parts[count:]

        return solve_linear(
            lambda x: sum(_augmented(slopes, *rows_and_columns(x)), ()),
            (*right, *(jnp.zeros_like(right[0]) for _ in self._pure)),
            lambda b: sum(self._solve_augmented(eq, known, *rows_and_columns(b)), ()),
        )[count:]

    def _solve_augmented(self, eq: Equations, slopes: dict, b: tuple, c: tuple) -> tuple[tuple, tuple]:
        """Solve ``y + J x = b, Jᵀ y = c``; nothing here is differentiated."""
        units, smallest_pivot, factors = [eq.length if p else 1.0 for p in self._pure], limits(eq.length).fine, []
        for rows, columns, elimination in self.blocks:
            inside = {
                (i, j): slopes[r, k] for i, r in enumerate(rows) for j, k in enumerate(columns) if (r, k) in slopes
            }
            factors.append(eliminate_block(elimination, inside, [units[k] for k in columns], smallest_pivot))
        before: list[list[tuple[int, int]]] = []  # per block: slopes by the unknowns of the blocks in front of it
        solved: set[int] = set()
        for rows, columns, _ in self.blocks:
            before.append([(r, k) for r in rows for k in sorted(solved) if (r, k) in slopes])
            solved |= set(columns)

        def solve_kept(right: Mapping[int, Array]) -> list[Array]:
            rest, x = dict(right), [zero] * len(c)
            for (rows, columns, _), found, earlier in zip(self.blocks, factors, before, strict=True):
                for r, k in earlier:
                    rest[r] = rest[r] - slopes[r, k] * x[k]
                for k, v in zip(columns, found.solve([rest[r] for r in rows]), strict=True):
                    x[k] = v
            return x

        def solve_transposed(right: Sequence[Array]) -> list[Array]:
            rest, y = list(right), {}
            for (rows, columns, _), found, earlier in zip(self.blocks[::-1], factors[::-1], before[::-1], strict=True):
                y |= dict(zip(rows, found.solve_transposed([rest[k] for k in columns]), strict=True))
                for r, k in earlier:
                    rest[k] = rest[k] - slopes[r, k] * y[r]
            return [y[r] for r in self.kept]

        zero = jnp.zeros_like(b[0])
        spare = [jnp.stack([slopes.get((r, k), zero) for r in self.spare]) for k in range(len(c))]
        w = jnp.stack([jnp.broadcast_to(v, spare[0].shape) for v in solve_transposed(spare)])
        gram = jnp.sum(w[:, :, None] * w[:, None], axis=0)
        count, lanes = len(self.spare), zero.shape

        def small(e: Array) -> Array:
            if count == 1:
                return e / (1.0 + gram[0])
            square = jnp.moveaxis(gram.reshape(count, count, -1), 2, 0) + jnp.eye(count)
            return jax.vmap(dense.cholesky_solve)(square, e.reshape(count, -1).T[..., None])[..., 0].T.reshape(e.shape)

        def once(b: Sequence[Array], c: Sequence[Array]) -> tuple[tuple, tuple]:
            rest = jnp.stack([b[r] for r in self.spare])
            back = jnp.stack([jnp.broadcast_to(v, lanes) for v in solve_transposed(c)])
            z = jnp.stack([b[r] for r in self.kept]) + jnp.sum(w * rest, axis=1) - back
            z = z - jnp.sum(w * small(jnp.sum(w * z[:, None], axis=0)), axis=1)
            x = tuple(jnp.broadcast_to(v, lanes) for v in solve_kept(dict(zip(self.kept, z, strict=True))))
            y = _augmented(slopes, tuple(jnp.zeros_like(v) for v in b), x)[0]
            return tuple(v - d for v, d in zip(b, y, strict=True)), x

        def improve(state: tuple[Array, Array, tuple[tuple, tuple]]) -> tuple[Array, Array, tuple[tuple, tuple]]:
            k, _, pair = state
            left = jax.tree.map(jnp.subtract, (b, c), _augmented(slopes, *pair))
            change = once(*left)
            pair = jax.tree.map(jnp.add, pair, change)
            size, moved = (jnp.max(jnp.abs(jnp.stack([*t[0], *t[1]])), axis=0) for t in (pair, change))
            return k + 1, jnp.max(jnp.where(size > 0.0, moved / size, 0.0)), pair

        # Where the rows of A are weak, each pass leaves more: it is gone on until nothing changes any more.
        start = jnp.zeros((), int), jnp.asarray(jnp.inf, zero.dtype), jax.tree.map(jnp.zeros_like, (b, c))
        fine = 100.0 * jnp.finfo(zero.dtype).eps
        # 6 passes of a refinement, at most
        pair = lax.while_loop(lambda st: (st[0] < 2) | ((st[1] > fine) & (st[0] < 6)), improve, start)[2]
        return _orthogonalise(slopes, b, c, ~_is_strong([f.pivots for f in factors]), pair)


def _is_strong(pivots: Sequence[Pivots]) -> Array:
    """Say in which lanes chosen rows are far from depending on each other."""
    return smallest(pivots) > 1e-4  # of the largest pivot


def _orthogonalise(
    slopes: dict[tuple[int, int], Array], b: tuple, c: tuple, weak: Array, pair: tuple[tuple, tuple]
) -> tuple[tuple, tuple]:
    """Return the pair that solves ``y + J x = b, Jᵀ y = c``, by all rows in lanes in which the chosen ones are weak."""
    zero = jnp.zeros_like(b[0])

    def by_all(state: tuple[Array, tuple[tuple, tuple]]) -> tuple[Array, tuple[tuple, tuple]]:
        # They depend on the state, or XLA would do all this before the loop, whether it is entered or not.
        at = {place: jnp.where(state[0], slope, 0.0) for place, slope in slopes.items()}
        whole = [[at.get((r, k), zero) for k in range(len(c))] for r in range(len(b))]
        jacobian = jnp.stack([jnp.stack(row, axis=-1) for row in whole], axis=-2).reshape(-1, len(b), len(c))
        given = (jnp.stack(v, axis=-1).reshape(-1, len(v)) for v in (b, c))
        y, x = jax.vmap(lambda j, b, c: dense.least_squares(j)(b, c))(jacobian, *given)
        found = tuple(tuple(v.T.reshape(len(v.T), *zero.shape)) for v in (y, x))
        return jnp.zeros((), bool), jax.tree.map(lambda new, old: jnp.where(weak, new, old), found, state[1])

    return lax.while_loop(lambda state: state[0], by_all, (jnp.any(weak), pair))[1]


class _RedundantBlock:
    """A block and rows that follow from it and the blocks before, whatever the dimensions.

    The block's own rows give all derivatives, but for lanes in which they are weak: of the three rows that align two
    vectors any two lose their rank in some direction.
    """

    def __init__(self, plan: Plan, block: _Block, spare: Sequence[int]):
        self.pivots, self.solve = block.pivots, block.solve
        self.rows = Rows(plan.topology, [*block.rows.rows, *(int(plan.rows[r]) for r in spare)], block.columns)


def _augmented(slopes: dict[tuple[int, int], Array], y: Sequence[Array], x: Sequence[Array]) -> tuple[tuple, tuple]:
    """Multiply ``(y, x)`` by ``[I J; Jᵀ 0]``."""
    rows, columns = list(y), [jnp.zeros_like(v) for v in x]
    for (r, k), slope in slopes.items():
        rows[r] = rows[r] + slope * x[k]
        columns[k] = columns[k] + slope * y[r]
    return tuple(rows), tuple(columns)


class Kernel:
    """The blocks of a plan, ready to be written out. Make it with `kernel`."""

    def __init__(self, plan: Plan):
        self.plan = plan
        top = plan.topology
        self.blocks = [_Block(plan, rows, columns) for rows, columns in plan.choice]
        self.differentiated = self._choose_rows()
        self.everything = Rows(top, range(len(top.rows)))
        self.guards = [guard_functions(top, bodies) for bodies in (False, True)]
        # What has no finite derivative with respect to an input is met, and yet no pose to go on from.
        pairs = zip(top.blocks, top.layout, strict=True)
        rows = [r for block, layout in pairs if steep(block.kind, top.dim) for r in layout.rows.flat]
        self.steep = Rows(top, rows, [int(c) for c in plan.known])
        self.jumps = jumps_anywhere(plan)  # so that every step is looked at by its tangents

    def _choose_rows(self) -> Sequence[_Block | _RedundantBlock | _AllRows]:
        """Choose the rows that are differentiated, and in which parts."""
        if not self.plan.chosen_rows_suffice:
            return [_AllRows(self.plan)]
        spare: list[list[int]] = [[] for _ in self.blocks]
        for r in sorted({*range(len(self.plan.rows))} - {int(r) for rows, _ in self.plan.choice for r in rows}):
            meets = [bool(self.plan.sample[r, columns].any()) for _, columns in self.plan.choice]
            spare[max(np.flatnonzero(meets), default=0)].append(r)
        pairs = zip(self.blocks, spare, strict=True)
        return [_RedundantBlock(self.plan, block, rows) if rows else block for block, rows in pairs]

    @property
    def guessed(self) -> list[int]:
        """Coordinates whose block needs a guess."""
        return [c for b in self.blocks if b.guessed for c in b.columns]

    @property
    def closed(self) -> bool:
        """True if every block has a closed form, and no row jumps."""
        return not self.jumps and all(b.closed for b in self.blocks)

    @property
    def by_formulas(self) -> bool:
        """True if every block is solved by a formula: those of `closed`, and angles, which turn beyond half a turn."""
        return all(b.closed or b.rows.form == "angle" for b in self.blocks)

    def signs(self, eq: Equations, x: Lanes) -> tuple[Array, ...]:
        """Return the orientation of every block at a pose."""
        return tuple(jnp.sign(d) for d in self.determinants(eq, x))

    def determinants(self, eq: Equations, x: Lanes) -> tuple[Array, ...]:
        """Return the determinant of every block at a pose."""
        return tuple(b.factors(eq, x).determinant for b in self.blocks)

    def solve(self, eq: Equations, x: Lanes, signs: Sequence[Array]) -> SolvedLanes:
        """Solve all lanes.

        Known coordinates are at their values, the others where to begin; signs are the orientation wanted of each
        block.
        """
        x, iterated = self.positions(eq, x, signs)
        return self.diagnose(eq, x, iterated)

    def positions(self, eq: Equations, x: Lanes, signs: Sequence[Array]) -> tuple[list[Array], dict[int, Eliminated]]:
        """Solve for all coordinates; return them, and the last eliminations of the blocks that took Newton."""
        x = list(x)
        iterated: dict[int, Eliminated] = {}
        for k, (block, sign) in enumerate(zip(self.blocks, signs, strict=True)):
            if block.closed or block.rows.form == "angle":
                y = block.rows.run_solution(TRACED)([*block.rows.collect(x, eq), sign])
            else:
                y, iterated[k] = self._iterate(block, eq, x)
            if len(self.blocks) > 2 and k not in iterated:  # 2 blocks may be computed into each other
                y = fusion_barrier(opaque_true(eq), lambda y: y, y)
            for c, v in zip(block.columns, y, strict=True):
                x[c] = v
        return x, iterated

    def diagnose(self, eq: Equations, x: list[Array], iterated: dict[int, Eliminated] | None = None) -> SolvedLanes:
        """Find what is to be known of poses."""
        factors = [(iterated or {}).get(k) or block.factors(eq, x) for k, block in enumerate(self.blocks)]
        size = reduce(jnp.maximum, [jnp.abs(r) for r in self.everything.values(eq, x)] or [jnp.zeros(())])
        rows, bodies = (guard.values(eq, x) for guard in self.guards)
        upright = reduce(jnp.logical_and, [g > 0.0 for g in (*rows, *bodies)] or [jnp.array(True)])
        for slope in self.steep.slopes(eq, x).values():
            upright = upright & jnp.isfinite(slope)
        mirrored = reduce(jnp.logical_or, [g <= 0.0 for g in bodies] or [jnp.array(False)])
        determinants, pivots = tuple(f.determinant for f in factors), smallest([f.pivots for f in factors])
        return SolvedLanes(x, determinants, size, pivots, upright, mirrored)

    def _iterate(self, block: _Block, eq: Equations, x: list) -> tuple[Sequence[Array], Factors]:
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
            # A lane that diverged to what is no number must not end the iteration of the others.
            farthest = reduce(jnp.maximum, moved)
            farthest = jnp.where(jnp.isfinite(farthest), farthest, 0.0)
            # One maximum over the lanes: XLA makes three kernels of each.
            return i + 1, y, Pivots(least, largest, grown), determinant, jnp.max(farthest)

        start = tuple(jnp.broadcast_to(x[c], shape) for c in columns)
        state = (jnp.zeros((), int), start, Pivots(one, one, one), one, jnp.asarray(jnp.inf))
        most = 1 if block.rows.form == "affine" else 6  # 6 of Newton, at most
        fine = limits(eq.length).fine
        _, y, pivots, determinant, _ = lax.while_loop(lambda st: (st[0] < most) & (st[4] > fine), improve, state)
        return y, Factors((), pivots, determinant)

    def tangent(
        self,
        eq: Equations,
        x: Lanes,
        x_dot: Sequence[Array | None],
        constants_dot: Mapping[Place, Array] | None = None,
        ok: Array | None = None,
    ) -> list[Array | None]:
        """Differentiate all coordinates by the known ones (and by constants), lane by lane.

        Changes are None where there is none; those of unknown coordinates are replaced. Where it is not `ok` the change
        is zero, and so are derivatives of it.
        """
        x_dot, constants_dot = list(x_dot), constants_dot or {}
        for c in self.plan.unknown:
            x_dot[c] = None
        for part in self.differentiated:
            moving = [c for c in sorted(part.rows.needed) if x_dot[c] is not None]
            varied = [at for at in part.rows.needed_constants if at in constants_dot]
            if not moving and not varied:
                continue

            def rows(*given, part=part, moving=moving, varied=varied):
                at = list(x)
                for c, v in zip(moving, given, strict=False):
                    at[c] = v
                constants = dict(zip(varied, given[len(moving) :], strict=True))
                # Scales multiply what vanishes: their changes change nothing.
                return part.rows.values(replace_constants(eq, constants), at)

            changes: list[AnyArray] = [x_dot[c] for c in moving] + [constants_dot[at] for at in varied]
            values = [x[c] for c in moving] + [entry(eq.constants[b], i, k) for b, i, k in varied]
            at = [jnp.broadcast_to(v, jnp.shape(d)) for v, d in zip(values, changes, strict=True)]
            _, r_dot = jax.jvp(rows, tuple(at), tuple(map(jnp.asarray, changes)))
            slopes = part.rows.slopes(eq, x)
            shape = jnp.broadcast_shapes(*map(jnp.shape, (*r_dot, *slopes.values())))
            if ok is not None:
                # A pivot may stand where elimination has to write first.
                slopes = {at: jnp.zeros(()) for at in part.pivots} | slopes
                slopes = {at: jnp.where(ok, e, 1.0 if at in part.pivots else 0.0) for at, e in slopes.items()}
                r_dot = [jnp.where(ok, r, 0.0) for r in r_dot]
            slopes = {at: jnp.broadcast_to(e, shape) for at, e in slopes.items()}
            change = part.solve(eq, slopes, [jnp.broadcast_to(r, shape) for r in r_dot])
            for c, d in zip(part.rows.columns, change, strict=True):
                x_dot[c] = -d
        return x_dot


def on_branch(
    eq: Equations, found: SolvedLanes, signs: Sequence[AnyArray] | Array, passing: ArrayLike = False
) -> Array:
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


def lane_tolerance(eq: Equations, x: Sequence[Array]) -> Array:
    """Largest residual of a pose that counts as a solution, lane by lane; as `newton.tolerance`."""
    least, largest = limits(eq.length, eq.rounded), jnp.zeros(())
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
    """Return true, which the compiler cannot know, not even where the design is constant in the program."""
    return lax.optimization_barrier(jnp.all(eq.length > 0.0))


def smallest(pivots: Sequence[Pivots]) -> Array:
    """Return the smallest over the largest pivot of all blocks, zero where rounding may have made it of zero."""
    if not pivots:
        return jnp.ones(())
    least = reduce(jnp.minimum, [p.least for p in pivots])
    most, grown = (reduce(jnp.maximum, parts) for parts in ([p.most for p in pivots], [p.grown for p in pivots]))
    # 100 times the last digit of the largest number met in the elimination
    return jnp.maximum(least - 100.0 * jnp.finfo(grown.dtype).eps * grown, 0.0) / most


def writes_out(plan: Plan) -> bool:
    """Say whether a plan is small enough to be written out element by element: beyond, compiling takes too long."""
    if plan.large or not 0 < len(plan.unknown) <= LARGEST_WRITTEN:
        return False
    # a program of 1000 multiplications takes XLA half a minute
    return sum(block.elimination.cost for block in kernel(plan).blocks) <= 1000


@with_owner
def kernel(plan: Plan) -> Kernel:
    """The kernel of a plan, written once."""
    return Kernel(plan)
