"""Linear rows solved first: what is left of a family's equations, in as few unknowns as that gives.

Combinations of rows in which the quadratic parts cancel are linear; they are solved for some unknowns, and what is left
is looked at again. Which rows and unknowns these are is chosen once, for a generic member and a design together. A path
between two members is straight in the numbers of the rows that stay and in the map from the unknowns that stay to all:
its equations are polynomials of the path's parameter, of one degree higher than the numbers enter.
"""

import dataclasses

import numpy as np
import scipy.linalg

from jaxnc.continuation.quadratic import QuadraticPaths, fit_powers
from jaxnc.kinematics.polynomial import Member, Reading

_RANK = 1e-9  # of the largest: a singular value below counts as zero
_NOTHING = 1e-12  # a coefficient, beside rows of size one, that is rounding
_SAMPLES = 8  # of a path: enough for polynomials of degree seven


@dataclasses.dataclass(frozen=True)
class Stage:
    """A step of the elimination, by numbers of the rows and unknowns that the step before has left."""

    kept: np.ndarray  # rows whose quadratic parts are independent
    others: np.ndarray  # rows whose quadratic parts are combinations of these
    solved_rows: np.ndarray  # which of the others are solved
    solved: np.ndarray  # unknowns that they are solved for
    free: np.ndarray  # unknowns that stay


def _rank(matrix: np.ndarray) -> int:
    if not matrix.size:
        return 0
    values = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(values > _RANK * values[0])) if values[0] > 0 else 0


def _pivots(matrix: np.ndarray, rank: int) -> np.ndarray:
    """So many columns of a matrix that are well independent."""
    return np.sort(scipy.linalg.qr(matrix, mode="economic", pivoting=True)[2][:rank]) if rank else np.zeros(0, int)


def _upper(t: np.ndarray) -> np.ndarray:
    """Quadratic parts of rows ``(..., rows, 1 + n, 1 + n)`` as vectors."""
    i, j = np.triu_indices(t.shape[-1] - 1)
    return t[..., 1 + i, 1 + j]


def _normed(t: np.ndarray) -> np.ndarray:
    """Rows with largest coefficients of one; those of nothing but rounding are zero."""
    size = np.abs(t).max(axis=(1, 2), keepdims=True)
    return np.where(size > _NOTHING, t / np.where(size > _NOTHING, size, 1.0), 0.0)


class Reduction:
    """The elimination of a structure's linear rows, chosen for a generic member and a design."""

    def __init__(self, reading: Reading, generic: Member, design: Member, combine: str = "any"):
        self.reading, self.combine = reading, combine
        self.stages: list[Stage] = []
        pair = [_normed(reading.coefficients(m)[0]) for m in (generic, design)]
        wide = pair[0].shape[-1]
        rows, maps = np.arange(len(pair[0])), [np.eye(wide, dtype=complex)] * 2
        while rows.size:
            reduced = [_normed(m.T @ t[rows] @ m) for m, t in zip(maps, pair, strict=True)]
            stage = self._choose(*reduced)
            if stage is None:
                break
            self.stages.append(stage)
            maps = [m @ self._step(stage, r[None])[0] for m, r in zip(maps, reduced, strict=True)]
            rows = rows[stage.kept]
        self.rows = rows  # that stay, of all
        self.n = maps[0].shape[1] - 1
        self.mix = np.eye(len(rows))  # combinations of them that are solved

    def _choose(self, generic: np.ndarray, design: np.ndarray) -> Stage | None:
        quads = [_upper(t) for t in (generic, design)]
        quads = [np.where(np.abs(q) > _RANK, q, 0.0) for q in quads]
        rank = _rank(quads[0])
        same = _rank(quads[1]) == rank
        kept = _pivots(quads[1 if same else 0].T, rank)
        others = np.setdiff1d(np.arange(len(generic)), kept)
        if self.combine != "any" and len(others) and len(kept):
            factors = [np.linalg.lstsq(q[kept].T, q[others].T, rcond=None)[0] for q in quads]
            apart = np.abs(factors[0] - factors[1]).max(axis=0) > 1e-8
            if self.combine == "none":
                apart = np.abs(factors[0]).max(axis=0) > 1e-8
            kept, others = np.sort(np.append(kept, others[apart])), others[~apart]
        if not len(others):
            return None
        lines = [self._linear(t, kept, others)[:, 1:] for t in (generic, design)]
        rank = _rank(lines[0])
        if not rank and len(kept) == len(generic):
            return None
        best = lines[1] if _rank(lines[1]) == rank else lines[0]
        rows = _pivots(best.T, rank)
        solved = _pivots(best[rows], rank)
        return Stage(kept, others, rows, solved, np.setdiff1d(np.arange(generic.shape[-1] - 1), solved))

    @staticmethod
    def _linear(t: np.ndarray, kept: np.ndarray, others: np.ndarray) -> np.ndarray:
        """Combinations of rows ``(rows, 1 + n, 1 + n)`` that are linear, ``(others, 1 + n)``."""
        if len(kept):
            quads = _upper(t)
            factors = np.linalg.lstsq(quads[kept].T, quads[others].T, rcond=_RANK)[0].T
            left = t[others] - np.tensordot(factors, t[kept], 1)
        else:
            left = t[others]
        out = 2.0 * left[:, 0]
        out[:, 0] *= 0.5
        return out

    def _step(self, stage: Stage, t: np.ndarray) -> np.ndarray:
        """Maps from 1 and the unknowns that stay to 1 and those before, ``(samples, 1 + n, 1 + free)``."""
        samples, wide = t.shape[0], t.shape[-1]
        out = np.zeros((samples, wide, 1 + len(stage.free)), complex)
        out[:, 0, 0] = 1.0
        out[:, 1 + stage.free, 1 + np.arange(len(stage.free))] = 1.0
        if len(stage.solved):
            lines = np.stack([self._linear(one, stage.kept, stage.others)[stage.solved_rows] for one in t])
            right = np.concatenate([lines[:, :, :1], lines[:, :, 1 + stage.free]], axis=2)
            out[:, 1 + stage.solved] = -np.linalg.solve(lines[:, :, 1 + stage.solved], right)
        return out

    def maps(self, member: Member) -> np.ndarray:
        """Maps from 1 and the unknowns that stay to 1 and all of them, ``(samples, 1 + unknowns, 1 + n)``."""
        t = self.reading.coefficients(member)
        samples, _, wide, _ = t.shape
        out = np.broadcast_to(np.eye(wide, dtype=complex), (samples, wide, wide))
        rows = np.arange(t.shape[1])
        for stage in self.stages:
            reduced = np.matmul(np.swapaxes(out, 1, 2)[:, None], np.matmul(t[:, rows], out[:, None]))
            out = np.matmul(out, self._step(stage, reduced))
            rows = rows[stage.kept]
        return out

    def square_rows(self, generic: Member, x: np.ndarray, rng: np.random.Generator) -> int:
        """Choose as many combinations of the rows as unknowns, at a solution ``(unknowns,)`` of a generic member.

        Rows that depend on each other take part by random real combinations. Returns how many freedoms the solution has
        besides: 0 where it is isolated.
        """
        t = self.restricted(generic, self.maps(generic))[0]
        y = np.concatenate([[1.0], self.shorten(x[:, None])[:, 0]])
        jacobian = 2.0 * (t @ y)[:, 1:]
        jacobian = jacobian / np.maximum(np.abs(jacobian).max(axis=1, keepdims=True), 1e-300)
        rank = _rank(jacobian)
        if rank < self.n:
            return self.n - rank
        if rank < len(jacobian):
            left = np.linalg.svd(jacobian.conj())[0][:, rank:]
            tied = np.flatnonzero(np.abs(left).max(axis=1) > 1e-8)
            alone = np.setdiff1d(np.arange(len(jacobian)), tied)
            combined = rng.normal(size=(rank - len(alone), len(tied)))
            self.mix = np.zeros((rank, len(jacobian)))
            self.mix[np.arange(len(alone)), alone] = 1.0
            self.mix[len(alone) :, tied] = np.linalg.qr(combined.T)[0].T
        return 0

    def restricted(self, member: Member, maps: np.ndarray) -> np.ndarray:
        """Coefficients of the rows that stay, in the unknowns that stay."""
        t = self.reading.coefficients(member)[:, self.rows]
        return np.matmul(np.swapaxes(maps, 1, 2)[:, None], np.matmul(t, maps[:, None]))

    def shorten(self, x: np.ndarray) -> np.ndarray:
        """The unknowns that stay, ``(n, lanes)``, of all ``(unknowns, lanes)``."""
        for stage in self.stages:
            x = x[stage.free]
        return x

    def paths(self, start: Member, start_maps: np.ndarray, end: Member, end_maps: np.ndarray,
              target: np.ndarray | None = None) -> QuadraticPaths:  # fmt: skip
        """Paths from one member to one or several ones."""
        targets = end.known.shape[1]
        at = np.exp(2j * np.pi * np.arange(_SAMPLES) / _SAMPLES)
        t = self.reading.coefficients(_between(start, end, at))[:, self.rows]
        maps = start_maps + (end_maps - start_maps)[:, None] * at[:, None, None]  # (targets, samples, …)
        maps = maps.reshape(-1, *maps.shape[2:])
        t = np.matmul(np.swapaxes(maps, 1, 2)[:, None], np.matmul(t, maps[:, None]))
        t = np.tensordot(t, self.mix, ([1], [1])).transpose(0, 3, 1, 2).reshape(targets, _SAMPLES, *self._shape)
        t = t / np.abs(t).max(axis=(1, 3, 4), keepdims=True)
        return QuadraticPaths(np.moveaxis(fit_powers(np.moveaxis(t, 1, -1), at), 0, 1), target)

    @property
    def _shape(self) -> tuple[int, int, int]:
        return len(self.mix), self.n + 1, self.n + 1


def _between(start: Member, end: Member, at: np.ndarray) -> Member:
    """Members between one and several others, all parts of the way of the first, then of the second."""
    part, targets = np.tile(at, end.known.shape[1]), end.known.shape[1]
    again = Member(*(_repeated(v, len(at)) for v in (end.constants, end.known, end.turns, end.sizes)))
    wide = Member(*(_repeated(v, targets * len(at)) for v in (start.constants, start.known, start.turns, start.sizes)))
    return wide.mix(again, part)


def _repeated(value, count: int):
    return tuple(np.repeat(v, count, -1) for v in value) if isinstance(value, tuple) else np.repeat(value, count, -1)
