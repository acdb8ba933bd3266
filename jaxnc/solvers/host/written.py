"""A plan's step of Newton as one straight-line program: all its constraints, their slopes and the solve of its blocks.

Where the diagonal blocks of the Jacobian have one or two rows, everything from the coordinates to the step is a few
hundred operations on whole lanes; a single lane goes through them as plain numbers.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jaxnc.reading import Builder, function
from jaxnc.remembered import with_owner
from jaxnc.solvers.linearised import given, linearised
from jaxnc.solvers.plan import Plan
from jaxnc.system.host import HostEquations
from jaxnc.system.structure import host_kind, readable

_LARGEST = 2  # rows of a block
_UNKNOWNS = 40  # of a plan
_WIDE = np.dtype(np.float64)


class Written:
    """The programs of a plan, each written when it is asked for. Make it with `written`, or `slopes`.

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
        b = self._builder = Builder(len(top.coordinates) + given(top) + len(plan.rows))
        right = b.first[len(b.first) - len(plan.rows) :]
        rows, matrix, by_known, guards = linearised(plan, b)
        self._matrix, driven = matrix, len(plan.driven)
        self.places, self.driven = (np.array([*x], int).reshape(-1, 2).T for x in (matrix, by_known))
        zero = b.number(0.0)
        self.parts: dict[str, list[int]] = {"residual": rows, "guards": guards}
        self.parts |= {"entries": [*matrix.values()], "by_driven": [*by_known.values()]}
        if not solved:
            return
        tangents = [self._solved(b, [by_known.get((r, k), zero) for r in range(len(rows))]) for k in range(driven)]
        self.parts |= {
            "step": self._solved(b, rows),
            "slopes": [b.op("neg", tangents[k][c]) for c in range(len(plan.unknown)) for k in range(driven)],
            "determinants": [self._determinant(b, r, c) for r, c in plan.sequence],
            "solved": self._solved(b, right),
        }
        self.whole = len(rows) == len(top.rows) and not any(block.kind.mirror for block in top.blocks)

    def _determinant(self, b: Builder, rows: np.ndarray, columns: np.ndarray) -> int:
        a = [self._matrix.get((int(r), int(c)), b.number(0.0)) for r in rows for c in columns]
        return a[0] if len(a) == 1 else b.op("sub", b.op("mul", a[0], a[3]), b.op("mul", a[1], a[2]))

    def _solved(self, b: Builder, right: Sequence[int]) -> list[int]:
        """The unknowns, block by block."""
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
    def _function(self, parts: tuple[str, ...], numbers: bool) -> Callable[[Sequence[Any]], tuple[Any, ...]]:
        return function(self._builder.program([k for part in parts for k in self.parts[part]]), math if numbers else np)

    def run(self, parts: tuple[str, ...], eq: HostEquations, q: np.ndarray, right: Any = ()) -> list[np.ndarray]:
        """Parts of what there is to ask for, each ``(numbers, lanes)``.

        Poses are ``(N, lanes)``; `right` are the rows that ``"solved"`` is asked for, ``(m, lanes)``.
        """
        values = None
        if _plain(eq, q):
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

    def corrected(
        self, eq: HostEquations, q: np.ndarray, weights: np.ndarray, fine: float, most: int
    ) -> np.ndarray | None:
        """One pose ``(N, 1)`` by Newton in plain numbers, until a step is fine; None if that is for arrays.

        `weights` are factors that turn the unknowns into lengths, ``(n, 1)``; a step that is shorter than `fine`, of
        the mechanism's size, is the last.
        """
        if not _plain(eq, q):
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


def _plain(eq: HostEquations, q: np.ndarray) -> bool:
    """Whether it is one pose of one design, which goes through a program as plain numbers."""
    return q.shape[1] == 1 and eq.designs is None and q.dtype == _WIDE


@with_owner
def written(plan: Plan) -> Written | None:
    """The programs of a plan, written once; None if it has larger blocks, or kinds that cannot be read."""
    top = plan.topology
    if plan.large or not plan.square or not plan.sequence or len(plan.unknown) > _UNKNOWNS:
        return None
    if any(len(rows) > _LARGEST for rows, _ in plan.sequence):
        return None
    if not readable(top, ("residual", "guard")):
        return None
    return Written(plan)


@with_owner
def slopes(plan: Plan) -> Written | None:
    """The program of a plan's rows and their slopes alone, whatever its blocks are; None where it would be long."""
    if plan.large or len(plan.unknown) > _UNKNOWNS or not readable(plan.topology, ("residual", "guard")):
        return None
    return Written(plan, solved=False)


@with_owner
def ready(plan: Plan) -> bool:
    """Read all that the host needs of a plan's kinds, so that it touches no JAX later; whether that is possible."""
    if not readable(plan.topology, ("residual", "guard")):
        return False
    for kind in {block.kind for block in plan.topology.blocks}:
        for order in (1, 2, 3):
            host_kind(kind, plan.topology.dim).rates(order)
    written(plan)
    return True
