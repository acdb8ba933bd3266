"""One pose in every lane: the diagonal blocks of a plan solved one after the other, in lockstep.

What a block needs is already solved when its turn comes, so a chain of dyads costs as much as its dyads. A block of
two rows, each a circle or a line in its two unknowns, has its solution in closed form, on the side that the branch has;
rows that are affine need one step; everything else takes Newton from a guess, by an elimination that was planned once.
"""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.remembered import with_owner
from jaxnc.solvers.elimination import Elimination, Factors, Pivots, eliminate, plan_elimination
from jaxnc.solvers.lanes import Lanes, Rows, guards
from jaxnc.solvers.plan import Plan, square_rows
from jaxnc.system.equations import Equations, pure_numbers
from jaxnc.system.precision import limits
from jaxnc.system.structure import curvature, jumps, steep
from jaxnc.types import Array

_ITERATIONS = 10  # the most of Newton on a block
_PLAIN = 2  # unknowns of an affine block that is solved where it stands
_LARGEST = 120  # unknowns that are written out
_MOST = 400  # multiplications of their eliminations: of 940, a program took XLA two minutes
_TOGETHER = 6  # unknowns of one block that are written out where derivatives or single steps are wanted
_ROUNDING = 100.0  # times the last digit of the largest number met in an elimination
_FEW = 2  # blocks that may be computed into each other


class Solved(NamedTuple):
    """What became of the lanes."""

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
        local = np.arange(len(rows))
        self.elimination: Elimination = plan_elimination([(local, local)], sample[np.ix_(rows, columns)])
        self.affine = all(
            curvature(top.blocks[one.block].kind, top.dim, one.moving)[k] == ()
            for one in self.rows.instances
            for k, r in enumerate(one.rows)
            if r >= 0
        )

    def factors(self, eq: Equations, x: Lanes) -> Factors:
        return self.eliminated(eq, self.rows.slopes(eq, x))

    def eliminated(self, eq: Equations, slopes: dict[tuple[int, int], Any]) -> Factors:
        """The elimination of the block's derivatives. Coordinates that are no lengths count times the size."""
        units = [eq.length if pure else 1.0 for pure in self._pure]
        return eliminate(self.elimination, slopes, units, limits(eq.length).fine)

    def circles(self, eq: Equations) -> tuple[Any, Any] | None:
        """Curvature of both rows, if the block is a pair of circles, or of a circle and a line."""
        if len(self.columns) != 2 or self.affine:
            return None
        bends = self.rows.bend(eq, 0), self.rows.bend(eq, 1)
        return None if any(b is None for b in bends) else bends

    def intersect(self, eq: Equations, x: Lanes, bends: tuple[Any, Any], sign: Any) -> list[Any]:
        """The intersection of two circles, or of a circle and a line, that has the given orientation."""
        first, second = self.rows.values(eq, x)
        s = self.rows.slopes(eq, x)
        a, b = ((s.get((r, 0), 0.0), s.get((r, 1), 0.0)) for r in range(2))
        flat = [isinstance(k, float) for k in bends]
        if flat[0]:
            line, offset, circle, value, bend, side = a, first, b, second, bends[1], sign
        elif flat[1]:
            line, offset, circle, value, bend, side = b, second, a, first, bends[0], -sign
        else:  # the radical axis
            line = tuple(bends[1] * a[k] - bends[0] * b[k] for k in range(2))
            offset = bends[1] * first - bends[0] * second
            circle, value, bend, side = a, first, bends[0], sign * jnp.sign(bends[0])
        along = (-line[1], line[0])
        square = line[0] * line[0] + line[1] * line[1]
        shift = -offset / square
        foot = (shift * line[0], shift * line[1])
        # value + circle · (foot + t along) + bend/2 |foot + t along|² = 0
        slope = circle[0] * along[0] + circle[1] * along[1]
        rest = value + circle[0] * foot[0] + circle[1] * foot[1]
        rest = rest + 0.5 * bend * (foot[0] * foot[0] + foot[1] * foot[1])
        twice = bend * square
        root = jnp.sqrt(jnp.maximum(slope * slope - 2.0 * twice * rest, 0.0))
        t = (side * root - slope) / twice
        return [x[c] + foot[k] + t * along[k] for k, c in enumerate(self.columns)]


class Kernel:
    """The blocks of a plan, ready to be written out. Make it with `kernel`."""

    def __init__(self, plan: Plan):
        self.plan = plan
        top = plan.topology
        chosen = square_rows(plan)
        self.blocks = [_Block(plan, rows, columns, chosen.sample) for rows, columns in chosen.sequence]
        self.everything = Rows(top, range(len(top.rows)))
        # What has no finite derivative with respect to an input is met, and yet no pose to go on from.
        pairs = zip(top.blocks, top.layout, strict=True)
        rows = [r for block, layout in pairs if steep(block.kind, top.dim) for r in layout.rows.flat]
        self.steep = Rows(top, rows, [int(c) for c in plan.known])
        self.jumps = jumping(plan)  # so that every step is looked at by its tangents

    def guessed(self, eq: Equations) -> list[int]:
        """Coordinates whose block needs a guess."""
        return [c for b in self.blocks if not b.affine and b.circles(eq) is None for c in b.columns]

    def closed(self, eq: Equations) -> bool:
        """Whether every block has a closed form, and no row jumps."""
        return not self.jumps and all(
            b.circles(eq) is not None or (b.affine and len(b.columns) <= _PLAIN) for b in self.blocks
        )

    def signs(self, eq: Equations, x: Lanes) -> tuple[Array, ...]:
        """Orientation of every block at a pose."""
        return tuple(jnp.sign(d) for d in self.determinants(eq, x))

    def determinants(self, eq: Equations, x: Lanes) -> tuple[Array, ...]:
        """Determinant of every block at a pose."""
        return tuple(b.factors(eq, x).determinants[0] for b in self.blocks)

    def solve(self, eq: Equations, x: Lanes, signs: Sequence[Any]) -> Solved:
        """Solve all lanes.

        Known coordinates are at their values, the others where to begin; signs are the orientation wanted of each
        block.
        """
        x, iterated = self.positions(eq, x, signs)
        return self.seen(eq, x, iterated)

    def positions(self, eq: Equations, x: Lanes, signs: Sequence[Any]) -> tuple[list[Any], dict[int, Factors]]:
        """All coordinates where they are solved, and the last eliminations of the blocks that took Newton."""
        x = list(x)
        iterated: dict[int, Factors] = {}
        for k, (block, sign) in enumerate(zip(self.blocks, signs, strict=True)):
            bends = block.circles(eq)
            if bends is not None:
                y = block.intersect(eq, x, bends, sign)
            elif block.affine and len(block.columns) <= _PLAIN:
                step = block.factors(eq, x).solve(block.rows.values(eq, x))
                y = [x[c] - d for c, d in zip(block.columns, step, strict=True)]
            else:
                y, iterated[k] = self._iterate(block, eq, x)
            if len(self.blocks) > _FEW and k not in iterated:
                y = apart(always(eq), lambda y: y, y)
            for c, v in zip(block.columns, y, strict=True):
                x[c] = v
        return x, iterated

    def seen(self, eq: Equations, x: list[Any], iterated: dict[int, Factors] | None = None) -> Solved:
        """What is to be said of poses."""
        factors = [(iterated or {}).get(k) or block.factors(eq, x) for k, block in enumerate(self.blocks)]
        found = tuple(f.determinants[0] for f in factors)
        return Solved(x, found, *self._seen(eq, x, factors))

    def evaluate(self, eq: Equations, x: Lanes) -> tuple[Any, Any, Any, Any]:
        """Largest residual, smallest over largest pivot, and whether upright and mirrored, of poses found elsewhere."""
        return self._seen(eq, x, [block.factors(eq, x) for block in self.blocks])

    def _seen(self, eq: Equations, x: Lanes, factors: Sequence[Factors]) -> tuple[Any, Any, Any, Any]:
        pivots = [p for f in factors for p in f.pivots]
        size = _reduced(jnp.maximum, [jnp.abs(r) for r in self.everything.values(eq, x)] or [jnp.zeros(())])
        rows, bodies = guards(self.plan.topology, eq, x)
        upright = _reduced(jnp.logical_and, [g > 0.0 for g in (*rows, *bodies)] or [jnp.array(True)])
        for slope in self.steep.slopes(eq, x).values():
            upright = upright & jnp.isfinite(slope)
        mirrored = _reduced(jnp.logical_or, [g <= 0.0 for g in bodies] or [jnp.array(False)])
        return size, smallest(pivots), upright, mirrored

    def _iterate(self, block: _Block, eq: Equations, x: list) -> tuple[Sequence[Any], Factors]:
        """Newton on a block, in all lanes until the last has it."""
        columns, pure = block.columns, pure_numbers(self.plan.topology)
        needed = {v for one in block.rows.instances for v in one.variables}
        shape = jnp.broadcast_shapes(*(jnp.shape(x[c]) for c in needed), jnp.shape(eq.length))
        one, go = jnp.ones(shape), always(eq)
        keys: list = []

        def evaluate(y):
            at = list(x)
            for c, v in zip(columns, y, strict=True):
                at[c] = v
            slopes = block.rows.slopes(eq, at)
            keys[:] = list(slopes)
            return [v * one for v in block.rows.values(eq, at)], [v * one for v in slopes.values()]

        def eliminated(values, slopes):
            factors = block.eliminated(eq, dict(zip(keys, slopes, strict=True)))
            seen = (*factors.pivots[0], factors.determinants[0])
            return factors.solve(values), [v * one for v in seen]

        def improve(state):
            i, y, *_ = state
            step, (*pivots, determinant) = apart(go, eliminated, *apart(go, evaluate, y))
            moved = [jnp.max(jnp.abs(d) / (1.0 if pure[c] else eq.length)) for d, c in zip(step, columns, strict=True)]
            y = tuple(v - d for v, d in zip(y, step, strict=True))
            return i + 1, y, Pivots(*pivots), determinant, jnp.max(jnp.stack(moved))

        start = tuple(jnp.broadcast_to(x[c], shape) for c in columns)
        state = (jnp.zeros((), int), start, Pivots(one, one, one), one, jnp.asarray(jnp.inf))
        most = 1 if block.affine else _ITERATIONS
        fine = limits(eq.length).fine
        _, y, pivots, determinant, _ = lax.while_loop(lambda st: (st[0] < most) & (st[4] > fine), improve, state)
        return y, Factors((), (), (pivots,), (determinant,))

    def tangent(
        self,
        eq: Equations,
        x: Lanes,
        x_dot: Sequence[Any | None],
        eq_dot: Equations | None = None,
        ok: Array | None = None,
    ) -> list[Any | None]:
        """How all coordinates change with the known ones (and with the equations), lane by lane.

        Changes are None where there is none; those of unknown coordinates are replaced. Where it is not `ok` the change
        is zero, and so are derivatives of it.
        """
        x_dot = list(x_dot)
        for c in self.plan.unknown:
            x_dot[c] = None
        for block in self.blocks:
            needed = {v for one in block.rows.instances for v in one.variables}
            moving = [c for c in sorted(needed) if x_dot[c] is not None]

            def rows(eq, *y, block=block, moving=moving):
                at = list(x)
                for c, v in zip(moving, y, strict=True):
                    at[c] = v
                return block.rows.values(eq, at)

            changes = [x_dot[c] for c in moving]
            at = [jnp.broadcast_to(x[c], jnp.asarray(d).shape) for c, d in zip(moving, changes, strict=True)]
            if eq_dot is not None:
                _, r_dot = jax.jvp(rows, (eq, *at), (eq_dot, *changes))
            elif moving:
                _, r_dot = jax.jvp(functools.partial(rows, eq), tuple(at), tuple(changes))
            else:
                continue
            slopes = block.rows.slopes(eq, x)
            if ok is not None:
                unit = set(zip(block.elimination.blocks[0].rows, block.elimination.blocks[0].columns, strict=True))
                slopes = {at: jnp.where(ok, e, 1.0 if at in unit else 0.0) for at, e in slopes.items()}
                r_dot = [jnp.where(ok, r, 0.0) for r in r_dot]
            factors = block.eliminated(eq, slopes)
            change = factors.solve(r_dot)
            if len(block.columns) > 2:
                # The order of the pivots is not that of this lane: refined once.
                rest = list(r_dot)
                for (i, j), e in slopes.items():
                    rest[i] = rest[i] - e * change[j]
                change = [a + b for a, b in zip(change, factors.solve(rest), strict=True)]
            for c, d in zip(block.columns, change, strict=True):
                x_dot[c] = -d
        return x_dot


def jumping(plan: Plan) -> bool:
    """Whether rows may jump: of a kind of a user's own."""
    return any(jumps(block.kind, plan.topology.dim) for block in plan.topology.blocks if block.kind.rows)


def apart(go: Array, f, *arguments):
    """The same as ``f(*arguments)``, its results made before anything that uses them.

    XLA on a CPU would otherwise compute what several others use once for each of them, and so on upwards.
    """
    f = jax.jit(f, inline=True)
    shapes = jax.eval_shape(f, *arguments)
    return lax.cond(go, f, lambda *_: jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes), *arguments)


def always(eq: Equations) -> Array:
    """True, which the compiler cannot know."""
    return jnp.all(eq.length > 0.0)


def smallest(pivots: Sequence[Pivots]) -> Any:
    """Smallest over largest pivot of all blocks, as far as it is not what rounding may have made of zero."""
    if not pivots:
        return jnp.ones(())
    least = _reduced(jnp.minimum, [p.least for p in pivots])
    most, grown = (_reduced(jnp.maximum, parts) for parts in ([p.most for p in pivots], [p.grown for p in pivots]))
    return jnp.maximum(least - _ROUNDING * jnp.finfo(grown.dtype).eps * grown, 0.0) / most


def _reduced(f, parts: Sequence[Any]) -> Any:
    return functools.reduce(f, parts)


def writes_out(plan: Plan) -> bool:
    """Say whether a plan is small enough to be written out element by element: beyond, compiling takes too long."""
    if plan.large or not 0 < len(plan.unknown) <= _LARGEST:
        return False
    return sum(block.elimination.cost for block in kernel(plan).blocks) <= _MOST


def writes_out_derivatives(plan: Plan) -> bool:
    """Whether a plan's derivatives, too, are written out: of larger blocks that compiles slowly and is no faster.

    Nothing keeps shared values apart there (see `apart`), so that XLA makes an elimination's many times.
    """
    return writes_out(plan) and max(len(block.columns) for block in kernel(plan).blocks) <= _TOGETHER


@with_owner
def kernel(plan: Plan) -> Kernel:
    """The kernel of a plan, written once."""
    return Kernel(plan)
