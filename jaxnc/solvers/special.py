"""What is special about a design: which rows are redundant in it, and which derivatives hardly differ from zero.

Rows and pivots are chosen by the structure alone, at a pose and with constants that are made up, and by these two
things: so a choice depends on nothing that was compiled before, and designs that differ in numbers only share it.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from jaxnc.remembered import with_owner
from jaxnc.system.equations import places
from jaxnc.system.structure import host_kind, program
from jaxnc.system.topology import Special, Topology

_SMALL = 1e-3  # of the largest derivative of its row, in the drawing, where sweeps begin, or nearby
_ENOUGH = 0.1  # of the largest row that is left: the first row that is as independent as this is taken


def noted(top: Topology, jacobians: Sequence[np.ndarray] | np.ndarray, rank: int) -> Topology:
    """A topology that knows what is special about a design.

    `jacobians` are those of all rows with respect to all coordinates ``(rows, N)``, every coordinate a length, in poses
    of the design; the last one has the largest rank.
    """
    size = np.abs(jacobians)
    where = structural(top)
    held = np.flatnonzero(where[:, top.unknown].any(axis=1))
    free = np.zeros(where.shape[1], bool)
    free[top.unknown] = True
    small = where & free & (size <= _SMALL * size.max(axis=2, initial=0.0, keepdims=True)).any(axis=0)
    rows = None
    if rank < len(held):
        rows = tuple(int(held[k]) for k in _independent(jacobians[-1][np.ix_(held, top.unknown)], rank))
    return dataclasses.replace(top, special=Special(rows, tuple((int(r), int(c)) for r, c in np.argwhere(small))))


def structural(top: Topology) -> np.ndarray:
    """Which derivatives can differ from zero, ``(rows, N)``."""
    row, column, nonzero = places(top)
    out = np.zeros((len(top.rows), len(top.coordinates)), bool)
    out[row[nonzero], column[nonzero]] = True
    return out


@with_owner
def sizes(top: Topology) -> np.ndarray:
    """Sizes of the derivatives ``(rows, N)`` to choose pivots by: those of a made-up pose, hardly any where small."""
    rng = np.random.default_rng(1)
    q = rng.uniform(0.4, 1.6, len(top.coordinates)) * rng.choice([-1.0, 1.0], len(top.coordinates))
    out = np.zeros((len(top.rows), len(q)))
    for block, layout in zip(top.blocks, top.layout, strict=True):
        constants = rng.uniform(0.4, 1.6, (len(block.kind.constants), block.count))
        if program(block.kind, "residual", top.dim) is None or not block.kind.rows:
            continue
        read = host_kind(block.kind, top.dim)
        with np.errstate(all="ignore"):
            found = read.slopes([*q[layout.variables.T], *constants])
        for (r, v), slope in zip(read.places, found, strict=True):
            np.add.at(out, (layout.rows[:, r], layout.variables[:, v]), slope)
    out = np.abs(out)
    out = np.where(structural(top), np.where(np.isfinite(out) & (out > 0), out, rng.uniform(0.5, 1.0, out.shape)), 0.0)
    for r, c in top.special.small if top.special else ():
        out[r, c] = 1e-300  # still a place where elimination may write
    return out


def _independent(matrix: np.ndarray, rank: int) -> list[int]:
    """As many independent rows, the earliest that will do: which they are depends on rounding in no ordinary design."""
    left, chosen = matrix.copy(), []
    for _ in range(rank):
        lengths = np.linalg.norm(left, axis=1)
        k = int(np.argmax(lengths >= _ENOUGH * lengths.max()))
        chosen.append(k)
        way = left[k] / lengths[k]
        left = left - np.outer(left @ way, way)
        left[chosen] = 0.0
    return sorted(chosen)


def independent_coordinates(jacobian: np.ndarray, freedom: int, first: np.ndarray) -> list[int]:
    """Coordinates (columns) that the others follow from.

    The jacobian is that of the rows with respect to the unknowns, ``(m, n)``, every coordinate a length; `first` has
    columns in the order in which they are preferred.
    """
    if not freedom:
        return []
    free = np.linalg.svd(jacobian)[2][jacobian.shape[1] - freedom :].T if jacobian.size else np.eye(jacobian.shape[1])
    return [int(first[k]) for k in _independent(free[first], freedom)]
