"""Linear rows solved first: what is left of a family's equations, in as few unknowns as that gives.

Combinations of rows in which the quadratic parts cancel are linear; they are solved for some unknowns, and what is left
is looked at again. Which rows and unknowns these are is chosen once, for a generic member and a design together. A
quadratic part that several rows have, in multiples which differ between members, is an unknown of its own: a body's
points beside the plane of its first three are so many times a cross product away from it, and linear in that.

A path between two members is straight in their numbers. Where linear rows are divided only by what is the same in all
members, what follows from them is a polynomial of the path's parameter, and the path stays in the family. Otherwise
what is solved goes straight from one end to the other instead: a driven pin, say, leaves its circle on the way.
"""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from jaxnc.continuation.tracker import FIT, QuadraticPaths, fit_powers
from jaxnc.kinematics.polynomial import RANK, Member, Reading
from jaxnc.solvers.host.view import solve_exactly

_NOTHING = 1e-12  # a coefficient, beside rows of size one, that is rounding
_EQUAL = 1e-9  # relative difference of a coefficient that is the same in all members

WAYS = ("straight", "determined")
"""What may go straight: all that is solved, or only unknowns that are determined altogether."""


@dataclasses.dataclass(frozen=True)
class Stage:
    """A step of the elimination, by numbers of the rows and unknowns that the step before has left."""

    kept: np.ndarray  # rows that stay
    rows: np.ndarray  # rows that are solved
    others: np.ndarray  # rows whose combinations are taken from these, so that the quadratic parts cancel
    factors: np.ndarray  # how often, (rows, others); the same in all members
    solved: np.ndarray  # unknowns that they are solved for
    free: np.ndarray  # unknowns that stay
    straight: bool  # whether what is solved goes straight on a path

    def lines(self, t: np.ndarray) -> np.ndarray:
        """The linear rows, ``(…, rows, 1 + n)``, of coefficients ``(…, all rows, 1 + n, 1 + n)``."""
        first = t[..., self.rows, 0, :] - np.matmul(self.factors, t[..., self.others, 0, :])
        return first * np.where(np.arange(t.shape[-1]) == 0, 1.0, 2.0)

    def solve(self, t: np.ndarray) -> np.ndarray:
        """What the unknowns that are solved are, ``(…, solved, 1 + free)``, by 1 and those that stay."""
        lines = self.lines(t)
        right = np.concatenate([lines[..., :1], lines[..., 1 + self.free]], axis=-1)
        return -solve_exactly(lines[..., 1 + self.solved], right)  # members that it divides by zero have no solution

    def expand(self, solution: np.ndarray) -> np.ndarray:
        """Map from 1 and the unknowns that stay to 1 and those before, ``(…, 1 + n, 1 + free)``."""
        out = np.zeros((*solution.shape[:-2], 1 + len(self.solved) + len(self.free), 1 + len(self.free)), complex)
        out[..., 0, 0] = 1.0
        out[..., 1 + self.free, 1 + np.arange(len(self.free))] = 1.0
        out[..., 1 + self.solved, :] = solution
        return out


class Products:
    """Quadratic parts that several rows share, in multiples which differ between members: each becomes an unknown.

    They are found in coefficients ``(2, rows, 1 + n, 1 + n)`` of a generic member and a design.
    """

    def __init__(self, pair: np.ndarray):
        count, wide = pair.shape[1], pair.shape[2]
        parts = pair[:, :, 1:, 1:].reshape(2, count, (wide - 1) ** 2)
        largest = np.abs(parts[0]).argmax(axis=1) if parts.size else np.zeros(count, int)
        often = np.take_along_axis(parts, largest[None, :, None], axis=2)[:, :, 0]
        shape = parts[0] / np.where(often[0] == 0.0, 1.0, often[0])[:, None]
        differs = np.abs(parts[1] - often[1][:, None] * shape).max(axis=1, initial=0.0)
        own = np.flatnonzero((often[0] != 0.0) & (differs <= _EQUAL * np.abs(parts).max(axis=(0, 2), initial=0.0)))
        rows: list[int] = []
        which: list[int] = []
        shapes: list[np.ndarray] = []
        while len(own):
            first = own[0]
            alike = np.abs(shape[own] - shape[first]).max(axis=1) <= _EQUAL
            group, own = own[alike], own[~alike]
            ratio = often[1, group] / often[0, group]
            if np.abs(ratio - ratio[0]).max() > _EQUAL * np.abs(ratio).max():
                rows += list(group)
                which += [len(shapes)] * len(group)
                shapes.append(shape[first].reshape(wide - 1, wide - 1))
        self.rows, self.which = np.array(rows, int), np.array(which, int)
        self.shapes = np.array(shapes, complex).reshape(-1, wide - 1, wide - 1)
        self.at = tuple(1 + k for k in np.divmod(largest[self.rows], max(1, wide - 1)))

    def name(self, t: np.ndarray) -> np.ndarray:
        """Coefficients with the products as the last unknowns, and with the rows that define them as the last rows."""
        count = len(self.shapes)
        if not count:
            return t
        samples, all_rows, wide, _ = t.shape
        out = np.zeros((samples, all_rows + count, wide + count, wide + count), complex)
        out[:, :all_rows, :wide, :wide] = t
        often = t[:, self.rows, *self.at]
        out[:, self.rows, 1:, 1:] = 0.0
        out[:, self.rows, 0, wide + self.which] = out[:, self.rows, wide + self.which, 0] = 0.5 * often
        new = np.arange(count)
        out[:, all_rows:, 1:wide, 1:wide] = self.shapes
        out[:, all_rows + new, 0, wide + new] = out[:, all_rows + new, wide + new, 0] = -0.5
        return out

    def extend(self, x: np.ndarray) -> np.ndarray:
        """Unknowns ``(unknowns, lanes)`` and, after them, the products."""
        return np.concatenate([x, np.einsum("il,kij,jl->kl", x, self.shapes, x)]) if len(self.shapes) else x


@dataclasses.dataclass(frozen=True)
class Placed:
    """Members in an elimination: maps to all unknowns, and what goes straight between members."""

    member: Member
    inner: np.ndarray  # from 1 and the unknowns that stay to 1, all and the products, (samples, 1 + all, 1 + n)
    products: int
    straight: tuple[np.ndarray, ...]  # of each stage that has it, (samples, solved, 1 + free)
    rows: np.ndarray  # coefficients of the rows that stay, in all unknowns and products

    @property
    def maps(self) -> np.ndarray:
        """Maps from 1 and the unknowns that stay to 1 and all, ``(samples, 1 + unknowns, 1 + n)``."""
        return self.inner[:, : self.inner.shape[1] - self.products]

    @functools.cached_property
    def restricted(self) -> np.ndarray:
        """Coefficients of the rows that stay, in the unknowns that stay."""
        return _congruent(self.inner, self.rows)

    @property
    def sound(self) -> np.ndarray:
        """Members whose elimination divides by nothing small, ``(samples,)``."""
        return np.abs(self.inner).max(axis=(1, 2)) < 1e5  # larger maps, beside 1, divide by next to nothing

    def choose(self, which: Sequence[int] | np.ndarray) -> "Placed":
        """Choose some of the members."""
        at = np.asarray(which, int)
        member = self.member.each(lambda v: v[..., at])
        return Placed(member, self.inner[at], self.products, tuple(s[at] for s in self.straight), self.rows[at])

    def meets_all(self, w: np.ndarray) -> np.ndarray:
        """Tell which solutions ``(n, lanes)`` of combinations of rows meet every row of the first member."""
        y = np.concatenate([np.ones((1, w.shape[1])), w])
        largest = np.abs(self.rows[0]).max(axis=(1, 2), keepdims=True)
        t = self.restricted[0] / np.where(largest > 0.0, largest, 1.0)
        rows = np.einsum("rij,is,js->rs", t, y, y)
        # A solution of combinations of rows meets each row if no residual is larger.
        return np.abs(rows).max(axis=0, initial=0.0) < 1e-8 * np.abs(y).max(axis=0) ** 2

    def lengthen(self, w: np.ndarray) -> np.ndarray:
        """All unknowns of the first member, ``(unknowns, lanes)``, by those that stay, ``(n, lanes)``."""
        return (self.maps[0] @ np.concatenate([np.ones((1, w.shape[1])), w]))[1:]


def _rank(matrix: np.ndarray) -> int:
    return int(np.linalg.matrix_rank(matrix, rtol=RANK)) if matrix.size else 0


def _pivots(matrix: np.ndarray, rank: int) -> np.ndarray:
    """So many columns of a matrix that are well independent."""
    left, found = np.array(matrix), []
    for _ in range(rank):
        size = np.linalg.norm(left, axis=0)
        found.append(int(np.argmax(size)))
        along = left[:, found[-1]] / size[found[-1]]
        left -= np.outer(along, along.conj() @ left)
    return np.sort(np.array(found, int))


def _congruent(maps: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Coefficients ``(samples, rows, …)`` in other unknowns."""
    return np.matmul(np.swapaxes(maps, 1, 2)[:, None], np.matmul(t, maps[:, None]))


class Reduction:
    """The elimination of a structure's linear rows, chosen for a generic member and a design; of none without a way."""

    def __init__(self, reading: Reading, generic: Member, design: Member, way: str | None = WAYS[0]):
        self.reading, self.way = reading, way
        self.stages: list[Stage] = []
        pair = np.stack([reading.coefficients(m)[0] for m in (generic, design)])
        self.products = Products(pair if way is not None else pair[:, :0])
        pair = self.products.name(pair)
        wide = pair.shape[-1]
        rows, maps = np.arange(pair.shape[1]), np.broadcast_to(np.eye(wide, dtype=complex), (2, wide, wide))
        while rows.size and way is not None:
            reduced = _congruent(maps, pair[:, rows])
            size = np.abs(pair[:, rows]).max(axis=(2, 3), keepdims=True)
            reduced = np.where(np.abs(reduced) > _NOTHING * size, reduced, 0.0)
            stage = self._choose(reduced)
            if stage is None:
                break
            self.stages.append(stage)
            maps = np.matmul(maps, stage.expand(stage.solve(reduced)))
            rows = rows[stage.kept]
        self.rows = rows  # that stay, of all
        self.n = maps.shape[2] - 1
        self.mix = np.eye(len(rows))  # combinations of them that are solved
        self.divides: np.ndarray | None = None  # rows that are no polynomials of a path's parameter

    def _choose(self, pair: np.ndarray) -> Stage | None:
        """The next stage for coefficients ``(2, rows, 1 + n, 1 + n)``; None if there is none."""
        count, n = pair.shape[1], pair.shape[2] - 1
        i, j = np.triu_indices(n)
        quads = pair[:, :, 1 + i, 1 + j]
        size = np.abs(quads).max(axis=2, keepdims=True, initial=0.0)
        quads = quads / np.where(size > 0.0, size, 1.0)
        rank = _rank(quads[0])
        basis = _pivots(quads[1 if _rank(quads[1]) == rank else 0].T, rank)
        others = np.setdiff1d(np.arange(count), basis)
        factors = np.zeros((2, len(others), len(basis)), complex)
        if rank and len(others):
            for k in range(2):
                factors[k] = np.linalg.lstsq(quads[k, basis].T, quads[k, others].T, rcond=RANK)[0].T
                factors[k] *= size[k, others] / np.where(size[k, basis].T > 0.0, size[k, basis].T, 1.0)
        same = np.abs(factors[0] - factors[1]).max(axis=1, initial=0.0) < _EQUAL * (
            1.0 + np.abs(factors[0]).max(initial=0.0)
        )
        others, factors = others[same], factors[0, same]
        factors = np.where(np.abs(factors) > _NOTHING, factors, 0.0)
        if not len(others):
            return None
        empty = np.zeros(0, int)
        every = Stage(empty, others, basis, factors, empty, np.arange(n), False)
        lines = every.lines(pair)
        # Combinations of nothing but rounding are rows without unknowns.
        scale = np.abs(pair[:, others]).max(axis=(2, 3))[:, :, None]
        lines = np.where(np.abs(lines) > 10 * _NOTHING * scale, lines, 0.0)
        left = lines[:, :, 1:]
        stays = np.setdiff1d(np.arange(count), others)
        idle = ~left.any(axis=(0, 2))
        picked, solved = _same_pivots(left)
        straight = not len(picked)
        if straight:
            rank = _rank(_scaled(left[0]))
            best = _scaled(left[1 if _rank(_scaled(left[1])) == rank else 0])
            picked = _pivots(best.T, rank)
            solved = _pivots(best[picked], rank)
            rest = empty
            if self.way == "determined":
                picked, solved = _determined(left, picked, solved)
                other = np.setdiff1d(np.arange(n), solved)  # linear rows may say something about other unknowns
                rest = np.setdiff1d(np.flatnonzero(left[:, :, other].any(axis=(0, 2))), picked)
        else:
            rest = np.setdiff1d(np.flatnonzero(~idle), picked)
        if not len(picked) and not idle.any():
            return None
        kept = np.sort(np.concatenate([stays, others[rest]]))
        if not len(picked) and len(kept) == count:
            return None
        free = np.setdiff1d(np.arange(n), solved)
        return Stage(kept, others[picked], basis, factors[picked], solved, free, straight)

    @np.errstate(all="ignore")
    def place(
        self, member: Member, straight: tuple[np.ndarray, ...] | None = None, known: np.ndarray | None = None
    ) -> Placed:
        """Solve the linear rows of members; `straight` are solutions that are given, `known` coefficients."""
        t = self.products.name(self.reading.coefficients(member) if known is None else known)
        samples, _, wide, _ = t.shape
        maps = np.broadcast_to(np.eye(wide, dtype=complex), (samples, wide, wide))
        rows, found = np.arange(t.shape[1]), []
        for stage in self.stages:
            if stage.straight and straight is not None:
                solution = straight[len(found)]
            else:
                used = np.union1d(stage.rows, stage.others)
                part = np.zeros((samples, len(rows), maps.shape[2], maps.shape[2]), complex)
                part[:, used] = _congruent(maps, t[:, rows[used]])
                solution = stage.solve(part)
            if stage.straight:
                found.append(solution)
            maps = np.matmul(maps, stage.expand(solution))
            rows = rows[stage.kept]
        return Placed(member, maps, len(self.products.shapes), tuple(found), t[:, rows])

    def square_rows(self, generic: Placed, x: np.ndarray, rng: np.random.Generator) -> int:
        """Choose as many combinations of the rows as unknowns, at a solution ``(unknowns,)`` of a generic member.

        Rows that depend on each other take part by random real combinations. Returns how many freedoms the solution has
        besides: 0 where it is isolated.
        """
        t = generic.restricted[0]
        y = np.concatenate([[1.0], self.shorten(x[:, None])[:, 0]])
        jacobian = 2.0 * (t @ y)[:, 1:]
        jacobian = _scaled(jacobian)
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

    @property
    def leads_out(self) -> bool:
        """True if paths between members may leave the family: linear rows are divided by what is not the same."""
        return self.way == WAYS[0] and any(stage.straight for stage in self.stages)

    def shorten(self, x: np.ndarray) -> np.ndarray:
        """The unknowns that stay, ``(n, lanes)``, of all ``(unknowns, lanes)``."""
        x = self.products.extend(x)
        for stage in self.stages:
            x = x[stage.free]
        return x

    def paths(self, start: Placed, end: Placed, each: int = 1) -> QuadraticPaths:
        """Paths from one member to one or several ones, or from several to as many, so many to each."""
        targets = end.member.known.shape[1]
        samples = 16  # of a path: enough for polynomials of degree fifteen
        at = np.exp(2j * np.pi * np.arange(samples) / samples)
        part = np.tile(at, targets)
        ends = end.member.each(lambda v: np.repeat(v, samples, axis=-1))
        alone = start.member.known.shape[1] == 1
        often = targets * samples if alone else samples
        between = start.member.each(lambda v: np.repeat(v, often, axis=-1)).mix(ends, part)
        straight = tuple(
            (a if alone else np.repeat(a, samples, 0)) * (1.0 - part[:, None, None])
            + np.repeat(b, samples, 0) * part[:, None, None]
            for a, b in zip(start.straight, end.straight, strict=True)
        )
        rows = self.reading.coefficients(between)
        # A row that divides by what changes on the way is no polynomial of it: its coefficients go straight themselves.
        divides = self.divides
        if divides is None:
            powers = fit_powers(np.moveaxis(rows[:samples], 0, -1), at)
            divides = np.abs(powers[samples // 2 :]).max(axis=(0, 2, 3), initial=0.0) > FIT * np.abs(rows).max()
            self.divides = divides
        if divides.any():
            first, last = (self.reading.coefficients(p.member)[:, divides] for p in (start, end))
            share = part[:, None, None, None]
            rows[:, divides] = np.repeat(first, often, 0) * (1.0 - share) + np.repeat(last, samples, 0) * share
        t = self.place(between, straight, rows).restricted
        t = np.tensordot(t, self.mix, ([1], [1])).transpose(0, 3, 1, 2)
        t = t.reshape(targets, samples, len(self.mix), self.n + 1, self.n + 1)
        t = t / np.abs(t).max(axis=(1, 3, 4), keepdims=True)
        return QuadraticPaths(np.moveaxis(fit_powers(np.moveaxis(t, 1, -1), at), 0, 1), each)


def _scaled(matrix: np.ndarray) -> np.ndarray:
    size = np.abs(matrix).max(axis=1, keepdims=True, initial=0.0)
    return matrix / np.where(size > 0.0, size, 1.0)


def _same_pivots(left: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of matrices ``(2, rows, n)`` whose block is the same in both, and regular."""
    scale = np.abs(left).max(axis=2, keepdims=True, initial=0.0)
    same = np.abs(left[0] - left[1]) <= _EQUAL * np.minimum(scale[0], scale[1])
    pivot = 0.05  # of a row's largest coefficient: what it may be divided by
    large = (np.abs(left) > pivot * scale).all(axis=0) & same
    rows: list[int] = []
    columns: list[int] = []
    for i in np.argsort((~same).sum(axis=1), kind="stable"):
        if not same[i, columns].all():
            continue
        for j in np.flatnonzero(large[i]):
            if j in columns or not same[rows, j].all():
                continue
            block = _scaled(left[0][np.ix_([*rows, int(i)], [*columns, int(j)])])
            if np.linalg.svd(block, compute_uv=False)[-1] > pivot:
                rows.append(int(i))
                columns.append(int(j))
                break
    order = np.argsort(columns)
    return np.array(rows, int)[order] if rows else np.zeros(0, int), np.sort(np.array(columns, int))


def _determined(left: np.ndarray, picked: np.ndarray, solved: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of rows that are solved for some unknowns those that determine them altogether."""
    lines = left[0, picked]
    steps = np.linalg.solve(lines[:, solved], lines)
    other = np.setdiff1d(np.arange(left.shape[2]), solved)
    alone = np.flatnonzero(np.abs(steps[:, other]).max(axis=1, initial=0.0) < _EQUAL)
    if not len(alone):
        return np.zeros(0, int), np.zeros(0, int)
    inside = solved[alone]
    outside = np.setdiff1d(np.arange(left.shape[2]), inside)
    rows = np.flatnonzero(~left[:, :, outside].any(axis=(0, 2)))
    rows = rows[_pivots(_scaled(left[0, rows][:, inside]).T, len(inside))] if len(rows) >= len(inside) else rows[:0]
    return (rows, inside) if len(rows) == len(inside) and len(rows) else (np.zeros(0, int), np.zeros(0, int))
