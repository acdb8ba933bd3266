"""Block-triangular systems whose diagonal blocks have one or two rows, solved in all lanes at once.

Blocks that need no other's solution stand in one level; level by level takes as many steps as a chain is long, but each
of them for all lanes.
"""

from typing import NamedTuple

import numpy as np

from jaxnc.remembered import with_owner
from jaxnc.solvers.large import LargePlan


class Level(NamedTuple):
    """Blocks that are solved together."""

    # `rows`, `columns`: of each block, (2, blocks); where it has one, the second are those behind all others
    rows: np.ndarray
    columns: np.ndarray
    own: np.ndarray  # places of its numbers, (2, 2, blocks), see `blocks_of_two`
    # rows, columns and places of the numbers that lead to columns of levels before; no row twice in one
    links: tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]


@with_owner
def blocks_of_two(plan: LargePlan) -> np.ndarray | None:
    """Places of the diagonal blocks' numbers, ``(2, 2, blocks)``; None if one is larger than two.

    Blocks of one are filled up with a zero and a one, which stand behind the numbers.
    """
    size = np.array([len(columns) for _, columns in plan.sequence], int)
    if not len(size) or size.max() > 2:
        return None
    p = plan.numbers
    rows, columns = (np.array([[block[k][0], block[k][-1]] for block in plan.sequence]).T for k in (0, 1))
    places = np.stack([np.stack([p.place(r, c) for c in columns]) for r in rows])
    places[:, :, size == 1] = np.array([[0, p.count], [p.count, p.count + 1]])[:, :, None]
    places[0, 0] = p.place(rows[0], columns[0])
    return places


def filled(matrix: np.ndarray) -> np.ndarray:
    """Numbers ``(lanes, nnz)`` with a zero and a one behind them, lanes last."""
    lanes, dtype = len(matrix), matrix.dtype
    return np.concatenate([matrix.T, np.zeros((1, lanes), dtype), np.ones((1, lanes), dtype)])


@with_owner
def levels(plan: LargePlan) -> tuple[Level, ...]:
    """The levels of a plan that has `blocks_of_two`."""
    p, own = plan.numbers, blocks_of_two(plan)
    assert own is not None
    (m, n), count = p.shape, len(plan.sequence)
    rows, columns, block_of = np.full((2, count), m), np.full((2, count), n), np.empty(n, int)
    for k, (r, c) in enumerate(plan.sequence):
        rows[: len(r), k], columns[: len(c), k], block_of[c] = r, c, k
    owner = np.empty(m, int)
    owner[rows[rows < m]] = np.broadcast_to(np.arange(count), (2, count))[rows < m]
    outside = np.flatnonzero(owner[p.rows] != block_of[p.columns])
    before: list[list[int]] = [[] for _ in range(count)]
    for e in outside:
        before[owner[p.rows[e]]].append(int(block_of[p.columns[e]]))
    level = np.zeros(count, int)
    for k in range(count):  # in an order in which they can be solved
        level[k] = 1 + max((level[j] for j in before[k]), default=-1)
    out = []
    for number in range(level.max() + 1):
        here = np.flatnonzero(level == number)
        links, left = [], outside[level[owner[p.rows[outside]]] == number]
        while len(left):
            first = np.unique(p.rows[left], return_index=True)[1]
            links.append((p.rows[left[first]], p.columns[left[first]], left[first]))
            left = np.delete(left, first)
        out.append(Level(rows[:, here], columns[:, here], own[:, :, here], tuple(links)))
    return tuple(out)


def solved(plan: LargePlan, matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solutions ``(lanes, n, c)`` for right-hand sides ``(lanes, m, c)``; not finite where a block is singular."""
    (m, n), (lanes, _, count) = plan.numbers.shape, right.shape
    numbers = filled(matrix)[:, None]
    rest, x = np.zeros((m + 1, count, lanes), matrix.dtype), np.zeros((n + 1, count, lanes), matrix.dtype)
    rest[:m] = np.moveaxis(right, 0, 2)
    for level in levels(plan):
        for row, column, place in level.links:
            rest[row] -= numbers[place] * x[column]
        (a, b), (c, d) = numbers[level.own]
        one, two = rest[level.rows]
        determinant = a * d - b * c
        x[level.columns[0]] = (d * one - b * two) / determinant
        x[level.columns[1]] = (a * two - c * one) / determinant
    return np.moveaxis(x[:n], 2, 0)
