"""A plan as one straight-line program: its rows, their slopes, and the step of Newton where its blocks are small.

Where the diagonal blocks of the Jacobian have one or two rows, everything from the coordinates to the step is a few
hundred operations on whole lanes; a single lane goes through them as plain numbers.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxnc.reading import Builder, Program, function
from jaxnc.remembered import with_owner
from jaxnc.solvers.plan import Plan
from jaxnc.solvers.rows import Functions, Rows, guard_functions
from jaxnc.system.host import HostEquations
from jaxnc.system.structure import host_kind, readable
from jaxnc.system.topology import Topology

_UNKNOWNS = 40  # of a plan
_WIDE = np.dtype(np.float64)


class PlanNodes(NamedTuple):
    """Nodes of a program that a plan's rows are written into."""

    rows: list[int]  # the plan's rows
    # Their derivatives by the unknowns that can differ from zero, by row and column.
    matrix: dict[tuple[int, int], int]
    by_known: dict[tuple[int, int], int]  # the same by the driven coordinates
    guards: list[int]  # what is positive where nothing is met by a mirror image


def count_numbers(top: Topology) -> int:
    """Count the constants and scales of all instances, which are in the order of `HostEquations.numbers`."""
    return sum(block.count * (len(block.kind.constants) + len(block.kind.rows)) for block in top.blocks)


def write_rows(plan: Plan, b: Builder) -> PlanNodes:
    """Write a plan's rows and their derivatives into a program; the kinds must be readable.

    The first inputs of the program are all coordinates, then all constants and scales.
    """
    top, unknowns = plan.topology, len(plan.unknown)
    columns = [*plan.unknown.tolist(), *plan.known[: len(plan.driven)].tolist()]
    place, count = {}, len(top.coordinates)
    for k, block in enumerate(top.blocks):
        constants, scales = len(block.kind.constants), len(block.kind.rows)
        for i in range(block.count):
            place |= {("constant", k, i, j): count + j for j in range(constants)}
            place |= {("scale", k, i, j): count + constants + j for j in range(scales)}
            count += constants + scales

    def append(part: Functions, program: Program) -> list[int]:
        inputs = [*part.coordinates, *(place["constant", *c] for c in part.constants)]
        inputs += [place["scale", *s] for s in part.scales]
        at = b.append(program, [b.first[k] for k in inputs])
        return [at[k] for k in program.outputs]

    rows, guard = Rows(top, plan.rows.tolist(), columns), guard_functions(top)
    derived, places = rows.partials
    found = dict(zip(places, append(rows, derived), strict=True))
    return PlanNodes(
        append(rows, rows.program),
        {(r, c): k for (r, c), k in found.items() if c < unknowns},
        {(r, c - unknowns): k for (r, c), k in found.items() if c >= unknowns},
        append(guard, guard.program),
    )


class PlanProgram:
    """The programs of a plan, each written when it is asked for. Make it with `plan_program`, or `slope_program`.

    Attributes:
        parts: what there is to ask for, and how many numbers it is: ``"residual"`` of the rows, ``"step"`` of Newton,
            ``"slopes"`` of the unknowns by the driven coordinates, ``"determinants"`` of the blocks, ``"entries"`` of
            the matrix at `places` and ``"by_driven"`` at `driven`; ``"guards"``, which are positive where nothing is
            met by a mirror image; ``"solved"`` for other rows.
        places, driven: rows and columns of the entries of the matrix, and of the derivatives by the driven coordinates.
        whole: whether all rows are solved for, and no body can be mirrored.
    """

    def __init__(self, plan: Plan, solved: bool = True):
        top, self.plan = plan.topology, plan
        b = self._builder = Builder(len(top.coordinates) + count_numbers(top) + len(plan.rows))
        right = b.first[len(b.first) - len(plan.rows) :]
        rows, matrix, by_known, guards = write_rows(plan, b)
        self._matrix, driven = matrix, len(plan.driven)
        self.places, self.driven = (np.array([*x], int).reshape(-1, 2).T for x in (matrix, by_known))
        zero = b.number(0.0)
        self.parts: dict[str, list[int]] = {"residual": rows, "guards": guards}
        self.parts |= {"entries": [*matrix.values()], "by_driven": [*by_known.values()]}
        if not solved:
            return
        tangents = [self._solve(b, [by_known.get((r, k), zero) for r in range(len(rows))]) for k in range(driven)]
        self.parts |= {
            "step": self._solve(b, rows),
            "slopes": [b.op("neg", tangents[k][c]) for c in range(len(plan.unknown)) for k in range(driven)],
            "determinants": [self._determinant(b, r, c) for r, c in plan.sequence],
            "solved": self._solve(b, right),
        }
        self.whole = len(rows) == len(top.rows) and not any(block.kind.mirror for block in top.blocks)

    def _determinant(self, b: Builder, rows: np.ndarray, columns: np.ndarray) -> int:
        a = [self._matrix.get((int(r), int(c)), b.number(0.0)) for r in rows for c in columns]
        return a[0] if len(a) == 1 else b.op("sub", b.op("mul", a[0], a[3]), b.op("mul", a[1], a[2]))

    def _solve(self, b: Builder, right: Sequence[int]) -> list[int]:
        """Write the solution for right sides, block by block."""
        x: dict[int, int] = {}
        for rows, columns in self.plan.sequence:
            rest = [right[int(r)] for r in rows]
            for k, r in enumerate(int(r) for r in rows):
                for (i, c), slope in self._matrix.items():
                    if i == r and c in x:
                        rest[k] = b.op("sub", rest[k], b.op("mul", slope, x[c]))
            determinant = self._determinant(b, rows, columns)
            if len(rows) == 1:
                x[int(columns[0])] = b.op("div", rest[0], determinant)
                continue
            p, q, r, s = (self._matrix.get((int(i), int(c)), b.number(0.0)) for i in rows for c in columns)
            above = b.op("sub", b.op("mul", s, rest[0]), b.op("mul", q, rest[1]))
            below = b.op("sub", b.op("mul", p, rest[1]), b.op("mul", r, rest[0]))
            x[int(columns[0])], x[int(columns[1])] = (b.op("div", y, determinant) for y in (above, below))
        return [x[c] for c in range(len(self.plan.unknown))]

    @with_owner
    def _function(self, parts: tuple[str, ...], numbers: bool) -> Callable[[Sequence], tuple]:
        return function(self._builder.program([k for part in parts for k in self.parts[part]]), math if numbers else np)

    def run(self, parts: tuple[str, ...], eq: HostEquations, q: np.ndarray, right: Any = ()) -> list[np.ndarray]:
        """Evaluate some of the `parts`, each ``(numbers, lanes)``.

        Poses are ``(N, lanes)``; `right` are the rows that ``"solved"`` is asked for, ``(m, lanes)``.
        """
        values = None
        if _is_plain(eq, q):
            try:
                x = [*q[:, 0].tolist(), *eq.numbers, *(np.asarray(right).reshape(-1).tolist())]
                values = np.array(self._function(parts, True)(x))[:, None]
            except (ZeroDivisionError, ValueError, OverflowError):
                values = None  # what is not finite is told by arrays
        if values is None:
            found = self._function(parts, False)([*q, *eq.numbers, *right])
            values = np.empty((len(found), q.shape[1]), q.dtype)
            for k, value in enumerate(found):
                values[k] = value
        out, first = [], 0
        for part in parts:
            out.append(values[first : first + len(self.parts[part])])
            first += len(self.parts[part])
        return out

    def correct(
        self, eq: HostEquations, q: np.ndarray, weights: np.ndarray, fine: float, most: int
    ) -> np.ndarray | None:
        """Correct one pose ``(N, 1)`` by Newton in plain numbers, until a step is fine; None if that is for arrays.

        `weights` are factors that turn the unknowns into lengths, ``(n, 1)``; a step that is shorter than `fine`, of
        the mechanism's size, is the last.
        """
        if not _is_plain(eq, q):
            return None
        x, n, enough = [*q[:, 0].tolist(), *eq.numbers], len(q), fine * eq.length
        run, unknown = (
            self._function(("step",), True),
            [*zip(self.plan.unknown.tolist(), weights[:, 0].tolist(), strict=True)],
        )
        try:
            for _ in range(most):
                far = 0.0
                for (k, weight), change in zip(unknown, run(x), strict=True):
                    x[k] -= change
                    far = max(far, abs(change) * weight)
                if far <= enough:
                    break
        except (ZeroDivisionError, ValueError, OverflowError):
            return None
        found = np.array(x[:n])[:, None]
        return found if np.isfinite(found).all() else None


def _is_plain(eq: HostEquations, q: np.ndarray) -> bool:
    """Say whether poses are one of one design, which goes through a program as plain numbers."""
    return q.shape[1] == 1 and eq.designs is None and q.dtype == _WIDE


@with_owner
def plan_program(plan: Plan) -> PlanProgram | None:
    """Write the programs of a plan once; None if it has larger blocks, or kinds that cannot be read."""
    top = plan.topology
    if plan.large or not plan.square or not plan.sequence or len(plan.unknown) > _UNKNOWNS:
        return None
    if any(len(rows) > 2 for rows, _ in plan.sequence):  # rows of a block
        return None
    if not readable(top, ("residual", "guard")):
        return None
    return PlanProgram(plan)


@with_owner
def slope_program(plan: Plan) -> PlanProgram | None:
    """Write the program of a plan's rows and slopes alone, whatever its blocks are; None where it would be long."""
    if plan.large or len(plan.unknown) > _UNKNOWNS or not readable(plan.topology, ("residual", "guard")):
        return None
    return PlanProgram(plan, solved=False)


@with_owner
def read_kinds(plan: Plan) -> bool:
    """Read all that the host needs of a plan's kinds, so that it touches no JAX later; say whether that is possible."""
    if not readable(plan.topology, ("residual", "guard")):
        return False
    for kind in {block.kind for block in plan.topology.blocks}:
        for order in (1, 2, 3):
            host_kind(kind, plan.topology.dim).rates(order)
    plan_program(plan)
    return True
