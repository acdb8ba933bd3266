"""A driven mechanism as a square system of second degree, and as a member of the family that its structure has.

Rows are polynomials in the unknown coordinates; their coefficients are read exactly, from the programs of the kinds.
An angle enters by its cosine and sine, two numbers of their own; where it is driven, and joins directions of constant
lengths, a second row tells it from its half turn. Angles and distances that only follow are left out and measured
afterwards. Combinations of rows that are linear are solved first.

A *member* of the family holds numbers for everything that may vary: constants of the rows, what is fixed and driven.
They may be complex. What is exactly zero in a design stays so in all members: it belongs to its structure.
"""

import copy
import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxnc.constraints import Kind
from jaxnc.reading import Builder, Program, function, partials, polynomials
from jaxnc.records import with_owner
from jaxnc.solvers.assembly import derive, settle, to_host
from jaxnc.system.equations import pure_numbers
from jaxnc.system.host import HostEquations
from jaxnc.system.identity import Owner
from jaxnc.system.precision import limits
from jaxnc.system.structure import formula, is_own, program, size
from jaxnc.system.system import System
from jaxnc.system.topology import Topology

RANK = 1e-9  # of the largest: a singular value below counts as zero
ZERO = 1e-10  # of the mechanism's size: a constant of a design below is zero by its structure

Function = Callable[[Sequence[Any]], tuple[Any, ...]]


def by_structure(constants: np.ndarray) -> np.ndarray:
    """Constants of a block ``(instances, constants, ...)`` that belong to the structure, not to a design; else NaN.

    These are the zeros, and the one of what is a copy of a single other, as of parallel unit vectors in a body.
    """
    zero = np.abs(constants) <= ZERO
    others = zero.shape[1] - 1
    one = (others > 0) & (zero.sum(axis=1, keepdims=True) == others) & (np.abs(np.abs(constants) - 1.0) <= ZERO)
    return np.where(zero, 0.0, np.where(one, np.sign(constants), np.nan))


# -- kinds -------------------------------------------------------------------------------------------------------------


class _Rows:
    """Rows of a kind as functions of variables, constants, and cosines and sines of its scalars."""

    def __init__(self, source: Program, variables: int, scalars: int):
        self.source, self.variables, self.per = source, variables, len(source.outputs)
        inputs, angles = {n.value for n in source.nodes if n.op == "input"}, source.inputs - 2 * scalars
        # Scalars of which a cosine or sine is used, by number.
        self.uses_cosine = frozenset(k for k in range(scalars) if {angles + 2 * k, angles + 2 * k + 1} & inputs)
        self.values = function(source)

    @functools.cached_property
    def _slope_program(self) -> tuple[Program, tuple[tuple[int, int], ...]]:
        return partials(self.source, range(self.variables))

    @functools.cached_property
    def _bend_program(self) -> tuple[Program, tuple[tuple[int, int], ...]]:
        return partials(self._slope_program[0], range(self.variables))

    @functools.cached_property
    def slopes(self) -> Function:
        """Their derivatives that are not zero, in the order of `slope_at`."""
        return function(self._slope_program[0])

    @property
    def slope_at(self) -> tuple[tuple[int, int], ...]:
        """Row and variable of each of the slopes."""
        return self._slope_program[1]

    @functools.cached_property
    def bends(self) -> Function:
        """Their second derivatives that are not zero, in the order of `bend_at`."""
        return function(self._bend_program[0])

    @functools.cached_property
    def bend_at(self) -> tuple[tuple[int, int, int], ...]:
        """Row and two variables of each of the bends."""
        return tuple((*self.slope_at[k], v) for k, v in self._bend_program[1])


def _generic(found: Program, kind: Kind, which: str, dim: int) -> Program:
    """Write a program anew, with cosines and sines of its scalars as inputs, and the first case of every choice.

    Of what is read off points that are drawn no constant is given beforehand. What a user's own kind does not read off
    them is what was given; and its numbers may be lengths, so it is given coordinates in their own unit: behind the
    constants its inputs are the unit of each variable, and what its rows are multiplied by.
    """
    variables, scalars, own = size(kind, dim), kind.scalars, is_own(kind)
    units = found.inputs
    factors = units + variables * own
    turns = factors + len(kind.rows) * own
    b = Builder(turns + 2 * scalars)

    def write_anew(given: bool) -> list[int]:
        at: list[int] = []
        for node in found.nodes:
            if node.op == "input" and node.value >= variables:
                at.append(b.first[node.value] if given else b.number(0.0))
            elif node.op == "input":
                x = b.first[node.value]
                at.append(b.op("mul", x, b.first[units + node.value]) if own else x)
            elif node.op == "number":
                at.append(b.number(node.value[1]))
            elif node.op in ("sin", "cos") and (of := found.nodes[node.of[0]]).op == "input" and of.value < variables:
                k = of.value - (variables - scalars)
                at.append(b.first[turns + 2 * k + (node.op == "sin")])
            elif node.op == "select":
                at.append(at[node.of[2 if b.known(at[node.of[0]]) is False else 1]])
            else:
                at.append(b.op(node.op, *(at[i] for i in node.of), value=node.value))
        return [at[k] for k in found.outputs]

    read_off = which == "drawn" and bool(kind.points + kind.vectors)
    out = write_anew(not read_off)
    if own and read_off:
        out = [a if b.known(a) is None else c for a, c in zip(out, write_anew(True), strict=True)]
    elif own and which == "residual":
        out = [b.op("mul", row, b.first[factors + r]) for r, row in enumerate(out)]
    return b.program(out)


@functools.lru_cache(maxsize=512)
def _rows_of(kind: Kind, which: str, dim: int) -> _Rows | None:
    """Read the rows of a kind, its guard, or its constants as drawn; None where nobody can read them."""
    found = program(kind, which, dim)
    return None if found is None else _Rows(_generic(found, kind, which, dim), size(kind, dim), kind.scalars)


@functools.lru_cache(maxsize=2048)
def _degree(kind: Kind, which: str, dim: int, moving: tuple[int, ...]) -> float:
    """Degree of the rows in what is moving; infinite if they are no polynomials."""
    rows = _rows_of(kind, which, dim)
    assert rows is not None
    found = polynomials(rows.source, moving)
    return max((np.inf if row.terms is None else max(map(len, row.terms), default=0) for row in found), default=0)


# -- members -----------------------------------------------------------------------------------------------------------


class Member(NamedTuple):
    """Numbers of a member of the family, in parts of the mechanism's size; each with a last axis of samples."""

    constants: tuple[np.ndarray, ...]  # per block (instances, constants, samples)
    known: np.ndarray  # all coordinates, those that are not known zero, (N, samples)
    turns: np.ndarray  # cosine and sine of each scalar, (scalars, 2, samples)
    sizes: np.ndarray  # right-hand sides of the rows that tell angles from their half turns, (pairs, samples)

    def each(self, f: Callable[..., np.ndarray], *others: "Member") -> "Member":
        """Apply a function to all arrays, and to those of other members beside them."""
        return jax.tree.map(f, self, *others)

    def mix(self, other: "Member", part: np.ndarray) -> "Member":
        """Members on the straight line to another one, `part` of the way, ``(samples,)``."""
        return self.each(lambda a, b: a + (b - a) * part, other)


@dataclasses.dataclass(frozen=True)
class Part:
    """Instances of a kind whose rows are used: one block's, or the guards that tell driven angles from half turns."""

    block: int
    instances: np.ndarray
    rows: _Rows
    sizes: np.ndarray | None = None  # numbers of the right-hand sides; None of ordinary rows


@dataclasses.dataclass(frozen=True)
class _Places:
    """How often each term, a value, slope or bend of a row, counts at each place of the coefficients."""

    shape: tuple[int, int]  # rows, and 1 and the unknowns
    terms: int
    of: np.ndarray  # terms, those of one place after the other
    counts: np.ndarray
    filled: np.ndarray  # places that have any
    begin: np.ndarray  # where each one's terms begin

    def sum(self, terms: np.ndarray) -> np.ndarray:
        """Sum terms ``(terms, samples)`` up to coefficients ``(samples, rows, 1 + unknowns, 1 + unknowns)``."""
        rows, wide = self.shape
        out = np.zeros((terms.shape[1], rows * wide * wide), complex)
        if len(self.filled):
            out[:, self.filled] = np.add.reduceat(terms[self.of] * self.counts[:, None], self.begin, axis=0).T
        return out.reshape(-1, rows, wide, wide)


class NotPolynomial(Exception):
    """Rows that are no polynomials of second degree: block, instance and why."""


class Reading:
    """A structure with its inputs, read as polynomials: which rows and unknowns there are."""

    def __init__(self, top: Topology, inputs: tuple[int, ...]):
        self.top, self.dim, self.inputs = top, top.dim, inputs
        self.first = len(top.coordinates) - len(top.scalars)
        self.known = np.array(top.fixed, bool)
        self.known[list(inputs)] = True
        self.follows = np.zeros(len(top.coordinates), bool)
        self.families: dict[Any, Any] = {}  # start sets, by what is zero in a design
        self.dropped: list[tuple[int, int]] = []  # measures of scalars that only follow: block and instance
        self.determined: list[tuple[int, int, int]] = []  # scalars that a row of known ones gives: its place there, too
        self._sort_scalars()
        self.unknown = np.flatnonzero(~self.known & ~self.follows)
        self.parts: list[Part] = []
        gone = {*self.dropped, *((b, i) for b, i, _ in self.determined)}
        for b, block in enumerate(top.blocks):
            which = np.array([i for i in range(block.count) if (b, i) not in gone], int)
            if block.kind.rows and len(which):
                self.parts.append(Part(b, which, self._checked(b, which)))

    def _sort_scalars(self) -> None:
        """Find out which scalars are given by known ones, and which only follow."""
        top, known = self.top, self.known
        at: dict[int, list[tuple[int, int]]] = {}
        for b, block in enumerate(top.blocks):
            for i, scalars in enumerate(block.scalars):
                for s in set(scalars):
                    at.setdefault(s, []).append((b, i))
        going = True
        while going:  # rows of scalars alone, of which one is open
            going = False
            for b, block in enumerate(top.blocks):
                if block.kind.points or block.kind.vectors or len(block.kind.rows) != 1:
                    continue
                rows = _rows_of(block.kind, "residual", top.dim)
                if rows is None or rows.uses_cosine:
                    continue
                for i, scalars in enumerate(block.scalars):
                    open_ = [k for k, s in enumerate(scalars) if not known[s]]
                    if len(open_) == 1 and all(open_[0] not in t[1:] for t in rows.bend_at):
                        known[scalars[open_[0]]] = True
                        self.determined.append((b, i, open_[0]))
                        going = True
        for k, measure in enumerate(top.measures):
            s = self.first + k
            if not known[s] and at.get(s, []) == [measure]:
                self.follows[s] = True
                self.dropped.append(measure)

    def _checked(self, b: int, which: np.ndarray) -> _Rows:
        """The rows of a block's instances; refused if they are no polynomials of second degree in the unknowns."""
        block, layout = self.top.blocks[b], self.top.layout[b]
        rows = _rows_of(block.kind, "residual", self.dim)
        if rows is None:
            raise NotPolynomial(b, int(which[0]), "its rows cannot be read as arithmetic")
        first = layout.variables.shape[1] - block.kind.scalars
        for i in which:
            moving = self._moving(b, i)
            if any(first + k in moving for k in rows.uses_cosine):
                raise NotPolynomial(b, int(i), "it has an angle that is neither an input nor only measured")
            if _degree(block.kind, "residual", self.dim, moving) > 2:
                raise NotPolynomial(b, int(i), "its rows are no polynomials of second degree in what is unknown")
        return rows

    def check_cases(self, x: np.ndarray, constants: Sequence[np.ndarray]) -> None:
        """Refuse rows in which something is chosen by a case, and another one holds for a design than was read."""
        y = (x + 0.1 * np.sin(1.0 + np.arange(len(x))))[:, None]
        turns = np.stack([np.cos(y[self.first :]), np.sin(y[self.first :])], axis=1)
        for part in self.parts:
            if part.sizes is None:
                inputs = self._inputs(part, y, constants, turns)
                kind = self.top.blocks[part.block].kind
                n = size(kind, self.dim)
                m = n + len(kind.constants)
                given, factors = inputs[:m], [1.0] * len(kind.rows)
                if is_own(kind):
                    given[:n] = [x * unit for x, unit in zip(given[:n], inputs[m : m + n], strict=True)]
                    factors = inputs[m + n : m + n + len(kind.rows)]
                plain = formula(kind, "residual", self.dim).on_lanes(given)
                plain = [row * factor for row, factor in zip(plain, factors, strict=True)]
                for one, two in zip(part.rows.values(inputs), plain, strict=True):
                    apart = np.abs(np.broadcast_to(one - two, (len(part.instances), 1)))[:, 0]
                    if not (apart < 1e-9 * (1.0 + np.abs(two).max())).all():
                        at = int(part.instances[np.argmax(apart)])
                        raise NotPolynomial(part.block, at, "its rows change with a case")

    def _moving(self, b: int, i: int) -> tuple[int, ...]:
        """Places of an instance's unknowns among its variables."""
        return tuple(int(k) for k in np.flatnonzero(~self.known[self.top.layout[b].variables[i]]))

    # -- values and coefficients -----------------------------------------------------------------------------------

    def _inputs(self, part: Part, x: np.ndarray, constants: Sequence[np.ndarray], turns: np.ndarray) -> list[Any]:
        """Variables, constants, cosines and sines of a part's instances, each ``(instances, samples)``."""
        block, layout = self.top.blocks[part.block], self.top.layout[part.block]
        out = list(x[layout.variables[part.instances].T])
        out += list(np.moveaxis(constants[part.block][part.instances], 1, 0))
        for k in range(block.kind.scalars):
            # A single coordinate of a point may stand in the place of a scalar; its cosine is used by no row.
            at = np.maximum(layout.scalars[part.instances, k] - self.first, 0)
            out += list(np.moveaxis(turns[at], 1, 0)) if len(turns) else [0.0, 0.0]
        return out

    def coefficients(self, member: Member) -> np.ndarray:
        """Symmetric coefficients of all rows, ``(samples, rows, 1 + unknowns, 1 + unknowns)``."""
        samples = member.known.shape[1]
        places, at = self._places, 0
        terms = np.empty((places.terms, samples), complex)
        for part in self.parts:
            x, count = self._inputs(part, member.known, member.constants, member.turns), len(part.instances)
            less = 0.0 if part.sizes is None else member.sizes[part.sizes]
            for value in (*(v - less for v in part.rows.values(x)), *part.rows.slopes(x), *part.rows.bends(x)):
                terms[at : at + count] = value
                at += count
        return places.sum(terms)

    @functools.cached_property
    def _places(self) -> "_Places":
        wide = 1 + len(self.unknown)
        place = np.zeros(len(self.top.coordinates), int)  # of each coordinate among 1 and the unknowns
        place[self.unknown] = 1 + np.arange(len(self.unknown))
        found: list[np.ndarray] = [np.zeros((3, 0))]
        first = terms = 0
        for part in self.parts:
            at = place[self.top.layout[part.block].variables[part.instances]]  # (instances, variables)
            none, row = np.zeros(len(at), int), first + np.arange(len(at)) * part.rows.per
            values = [(r, none, none, np.ones(len(at))) for r in range(part.rows.per)]
            slopes = [(r, none, at[:, v], 0.5 * (at[:, v] > 0)) for r, v in part.rows.slope_at]
            bends = [(r, at[:, u], at[:, v], 0.25 * (at[:, u] * at[:, v] > 0)) for r, u, v in part.rows.bend_at]
            for kind, each in ((0, values), (1, slopes), (1, bends)):
                for r, one, two, count in each:
                    term = terms + np.arange(len(at))
                    for a, b in ((one, two), (two, one))[: 1 + kind]:
                        found.append(np.stack([((row + r) * wide + a) * wide + b, term, count]))
                    terms += len(at)
            first += len(at) * part.rows.per
        places, of, counts = np.concatenate(found, axis=1)
        some = counts > 0.0
        order = np.flatnonzero(some)[np.argsort(places[some], kind="stable")]
        filled, begin = np.unique(places[order].astype(int), return_index=True)
        return _Places((first, wide), terms, of[order].astype(int), counts[order], filled, begin)

    def _linearise(self, parts: Sequence[Part], x: np.ndarray, constants: Sequence[np.ndarray], turns: np.ndarray):
        """Rows of some parts at a pose ``(N, 1)``, and their derivatives by all coordinates, ``(rows, N)``."""
        values, slopes = [np.zeros(0)], [np.zeros((0, len(x)))]
        for part in parts:
            inputs, at = self._inputs(part, x, constants, turns), self.top.layout[part.block].variables[part.instances]
            jacobian, shape = np.zeros((len(at), part.rows.per, len(x)), complex), (len(at), 1)
            for value in part.rows.values(inputs):
                values.append(np.broadcast_to(value, shape)[:, 0])
            for (r, v), value in zip(part.rows.slope_at, part.rows.slopes(inputs), strict=True):
                places: Any = np.arange(len(at)), r, at[:, v]
                np.add.at(jacobian, places, np.broadcast_to(value, shape)[:, 0])
            slopes.append(np.moveaxis(jacobian, 1, 0).reshape(-1, len(x)))
        return np.concatenate(values), np.concatenate(slopes)

    # -- angles ----------------------------------------------------------------------------------------------------

    def measure_turns(self, constants: Sequence[np.ndarray], x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cosine and sine of all angles in poses, ``(scalars, 2, samples)``, and the lengths' products they go with."""
        samples = x.shape[1]
        turns = np.zeros((len(self.top.scalars), 2, samples), complex)
        turns[:, 0] = 1.0
        sizes = np.zeros((len(self.top.scalars), samples), complex)
        for k, (b, i) in enumerate(self.top.measures):
            guard = self._guard(b)
            if guard is None or not self.top.angles[k]:
                continue
            one = Part(b, np.array([i]), guard)
            found = []
            for turn in ((1.0, 0.0), (0.0, 1.0)):
                every = np.broadcast_to(np.array(turn)[:, None], turns.shape)
                found.append(np.broadcast_to(guard.values(self._inputs(one, x, constants, every))[0], (1, samples))[0])
            sizes[k] = np.sqrt(found[0] ** 2 + found[1] ** 2)
            turns[k] = np.stack(found) / np.where(sizes[k] == 0.0, 1.0, sizes[k])
        return turns, sizes

    def _guard(self, b: int) -> _Rows | None:
        """The guard of an angle's kind, its cosine part; None where it has none such."""
        kind = self.top.blocks[b].kind
        rows = None if kind.guard is None else _rows_of(kind, "guard", self.dim)
        return rows if rows is not None and rows.uses_cosine and rows.per == 1 else None

    def paired(self, constants: Sequence[np.ndarray], x: np.ndarray) -> "Reading":
        """The reading with a second row of each driven angle between directions of constant length.

        It is the cosine part, less the product of the lengths. That is constant if the change of its square is a
        combination of the rows' in a generic pose of a member.
        """
        spread = np.arange(self.first)[~np.array(self.top.fixed[: self.first], bool)]
        turns, _ = self.measure_turns(constants, x)
        plain = [p for p in self.parts if not p.rows.uses_cosine]
        jacobian = self._linearise(plain, x, constants, turns)[1][:, spread]
        more: list[Part] = []
        count = 0
        for part in [p for p in self.parts if p.rows.uses_cosine]:
            guard, kept = self._guard(part.block), []
            for i in part.instances if guard is not None else ():
                assert guard is not None
                if _degree(self.top.blocks[part.block].kind, "guard", self.dim, self._moving(part.block, i)) > 2:
                    continue
                one, change = Part(part.block, np.array([i]), guard), np.zeros(len(spread), complex)
                for turn in ((1.0, 0.0), (0.0, 1.0)):
                    every = np.broadcast_to(np.array(turn)[:, None], turns.shape)
                    value, slope = self._linearise([one], x, constants, every)
                    change = change + value[0] * slope[0, spread]
                rest = change - np.linalg.lstsq(jacobian.T, change, rcond=RANK)[0] @ jacobian
                if np.abs(rest).max(initial=0.0) <= 1e-7 * max(np.abs(change).max(initial=0.0), 1e-300):
                    kept.append(i)
            if kept:
                assert guard is not None
                more.append(Part(part.block, np.array(kept), guard, count + np.arange(len(kept))))
                count += len(kept)
        out = copy.copy(self)
        out.parts = [*self.parts, *more]
        out.__dict__.pop("_places", None)
        return out

    def freedoms(self, constants: Sequence[np.ndarray], x: np.ndarray) -> int:
        """Number of freedoms of a pose ``(N, 1)``, before any input is held."""
        moves = np.flatnonzero(~np.array(self.top.fixed, bool) & ~self.follows)
        turns, _ = self.measure_turns(constants, x)
        rows = self._linearise([p for p in self.parts if not p.rows.uses_cosine], x, constants, turns)[1][:, moves]
        angles = sum(len(p.instances) for p in self.parts if p.rows.uses_cosine)
        return len(moves) - angles - (int(np.linalg.matrix_rank(rows, rtol=1e-8)) if rows.size else 0)

    def pair_sizes(self, sizes: np.ndarray) -> np.ndarray:
        """Right-hand sides of the second rows of driven angles, from the products of lengths of all angles."""
        at = [
            self.top.measures.index((part.block, int(i)))
            for part in self.parts
            if part.sizes is not None
            for i in part.instances
        ]
        return sizes[np.array(at, int)]

    # -- members ---------------------------------------------------------------------------------------------------

    def member_of(self, x: np.ndarray, constants: Sequence[np.ndarray]) -> Member:
        """The member that has a pose ``(N, samples)``, with the inputs of that pose."""
        turns, sizes = self.measure_turns(constants, x)
        return Member(tuple(constants), np.where(self.known[:, None], x, 0.0), turns, self.pair_sizes(sizes))

    def draw_member(
        self, x: np.ndarray, constants: Sequence[np.ndarray], rng: np.random.Generator
    ) -> tuple[tuple[np.ndarray, ...], np.ndarray] | None:
        """Draw a generic member: constants, and a complex pose ``(N, 1)`` that it has; None if none was found.

        The pose is somewhere about the real one ``(N,)`` that is given with the design's constants; constants that are
        so `by_structure` stay.
        """
        noise = rng.normal(size=(2, len(x)))
        z = (x + 0.35 * (noise[0] + 1j * noise[1]))[:, None]
        constants = [self._vary(b, c, rng) for b, c in enumerate(constants)]
        at = self._vectors  # of unit length, those of the ground too
        parts = [p for p in self.parts if not p.rows.uses_cosine and p.sizes is None]
        turns = np.zeros((len(self.top.scalars), 2, 1), complex)
        drawn = self.redraw(constants, z)
        steps = 60  # in which a generic member is drawn
        for k in range(steps):
            with np.errstate(all="ignore"):
                rows, jacobian = self._linearise(parts, z, drawn, turns)
                units = np.zeros((len(at), len(z)), complex)
                np.put_along_axis(units, at, z[at, 0], axis=1)
                rows = np.concatenate([rows, 0.5 * ((z[at, 0] ** 2).sum(axis=1) - 1.0)])
                jacobian = np.concatenate([jacobian, units])
            if not np.isfinite(rows).all() or not np.isfinite(jacobian).all():
                return None
            step = np.linalg.lstsq(jacobian, rows, rcond=RANK)[0] if len(rows) else np.zeros(len(z))
            z = z - step[:, None]
            if np.abs(step).max(initial=0.0) < 1e-13 * np.abs(z).max():
                ours = [c for c, block in zip(drawn, self.top.blocks, strict=True) if not is_own(block.kind)]
                sizes = [np.abs(a).max(initial=0.0) for a in (z, *ours)]
                # Larger numbers of a generic member, beside one, are badly conditioned.
                return (drawn, z) if max(sizes) < 50.0 and not self._has_collapsed(x, z[:, 0]) else None
            if k < steps - 10 and np.abs(step).max() > 1e-9:  # afterwards the constants stay
                drawn = self.redraw(constants, z)
        return None

    def _vary(self, b: int, given: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Vary the constants of a user's own kind, of which no pose may tell anything, but those of the structure."""
        kind = self.top.blocks[b].kind
        count = len(kind.constants)
        if not (is_own(kind) and count and kind.points + kind.vectors):
            return given
        noise = rng.normal(size=(2, *given[:, :count].shape))
        varied = given[:, :count] * (1.0 + 0.35 * (noise[0] + 1j * noise[1]))
        return np.concatenate([np.where(given[:, :count] == 0.0, 0.0, varied), given[:, count:]], axis=1)

    def _has_collapsed(self, x: np.ndarray, z: np.ndarray) -> bool:
        """Tell whether points of a pose are one that are apart in another: what meets rows that way is no member."""
        first, second = (
            np.abs(p[:, None] - p).max(axis=2, initial=0.0)
            for p in (y[: len(self.top.points) * self.dim].reshape(-1, self.dim) for y in (x, z))
        )
        return bool(((first > 1e-6) & (second < 1e-3)).any())

    def redraw(self, constants: Sequence[np.ndarray], z: np.ndarray) -> tuple[np.ndarray, ...]:
        """Constants as a pose has them, but those of the structure."""
        out = []
        for b, c in enumerate(constants):
            found = self._drawn(b, z, c)
            out.append(np.where(np.isnan(by_structure(c)), found if found is not None else c, c))
        return tuple(out)

    @functools.cached_property
    def _vectors(self) -> np.ndarray:
        """Coordinates of the unit vectors, ``(vectors, dim)``."""
        return (self.top.dim * len(self.top.points) + np.arange(self.top.dim * len(self.top.vectors))).reshape(
            len(self.top.vectors), self.top.dim
        )

    def _drawn(self, b: int, x: np.ndarray, given: np.ndarray) -> np.ndarray | None:
        """Constants of a block as a pose ``(N, samples)`` has them, ``(instances, constants, samples)``.

        Factors between scalars are not in a pose; they are those that are given.
        """
        block = self.top.blocks[b]
        if not block.kind.constants:
            return np.broadcast_to(given, (*given.shape[:2], x.shape[1]))
        drawn = _rows_of(block.kind, "drawn", self.dim)
        if drawn is None:
            return None
        inputs = list(x[self.top.layout[b].variables.T])
        inputs += [*np.moveaxis(given, 1, 0), *[0.0] * 2 * block.kind.scalars]
        with np.errstate(all="ignore"):
            found = drawn.values(inputs)
        shape = block.count, x.shape[1]
        rest = np.moveaxis(given[:, len(found) :], 1, 0)  # of a user's own kind: units and factors
        return np.stack([np.broadcast_to(v, shape) for v in (*found, *rest)], axis=1)

    @functools.cached_property
    def powers(self) -> tuple[np.ndarray, ...]:
        """By which power of the mechanism's size each constant grows, ``(instances, constants)`` per block."""
        rng = np.random.default_rng(1)
        x = rng.normal(size=(len(self.top.coordinates), 1)) + 1j * rng.normal(size=(len(self.top.coordinates), 1))
        lengths = ~pure_numbers(self.top)
        out = []
        for b, block in enumerate(self.top.blocks):
            none = np.zeros((block.count, len(block.kind.constants), 1))
            if is_own(block.kind):
                out.append(none[:, :, 0])
                continue
            if not block.kind.points + block.kind.vectors:
                out.append(self._powers_of_factors(b, lengths))
                continue
            one, two = self._drawn(b, x, none), self._drawn(b, np.where(lengths[:, None], 2.0 * x, x), none)
            if one is None or two is None:
                out.append(none[:, :, 0])
                continue
            with np.errstate(all="ignore"):
                power = np.log2(np.abs(two / one))[:, :, 0]
            out.append(np.where(np.isfinite(power), np.rint(power), 0.0))
        return tuple(out)

    def _powers_of_factors(self, b: int, lengths: np.ndarray) -> np.ndarray:
        """Powers of the constants of rows between scalars: factors make lengths of angles, where any is a length."""
        block, layout = self.top.blocks[b], self.top.layout[b]
        count = len(block.kind.constants)
        rows = _rows_of(block.kind, "residual", self.dim)
        if rows is None:
            return np.zeros((block.count, count))
        own = lengths[layout.variables]  # (instances, scalars)
        row = own.any(axis=1).astype(float)
        out = np.repeat(row[:, None], count, axis=1)
        given = np.random.default_rng(2).uniform(1.0, 2.0, own.shape[1] + count + 2 * block.kind.scalars)
        before = rows.slopes(list(given))
        for k in range(count):
            changed = given.copy()
            changed[own.shape[1] + k] *= 2.0
            for (_, v), one, two in zip(rows.slope_at, before, rows.slopes(list(changed)), strict=True):
                if one != two:
                    out[:, k] = row - own[:, v]
        return out

    def place_scalars(self, x: np.ndarray, constants: Sequence[np.ndarray]) -> None:
        """Give the scalars of a pose ``(N, samples)`` that rows of known ones determine."""
        for b, i, k in self.determined:
            rows = _rows_of(self.top.blocks[b].kind, "residual", self.dim)
            assert rows is not None
            at, part = self.top.blocks[b].scalars[i][k], Part(b, np.array([i]), rows)
            x[at] = 0.0
            inputs = self._inputs(part, x, constants, np.zeros((len(self.top.scalars), 2, x.shape[1])))
            slope = dict(zip((v for _, v in rows.slope_at), rows.slopes(inputs), strict=True))[k]
            x[at] = -np.broadcast_to(rows.values(inputs)[0], (1, x.shape[1]))[0] / slope


@dataclasses.dataclass(frozen=True)
class Design:
    """A system in parts of its size: what the family's equations are made from."""

    reading: Reading
    host: HostEquations
    unit: np.ndarray  # size of every coordinate
    shift: np.ndarray  # where the mechanism is if it is far from the origin, (N,)
    x: np.ndarray  # the assembled drawing, (N,)
    constants: tuple[np.ndarray, ...]  # per block (instances, constants, 1)
    owners: tuple[tuple[tuple[Owner, ...], ...], ...] = ()  # per block and instance, what it belongs to

    @property
    def isolated(self) -> float:
        """Reciprocal condition number below which a solution counts as singular."""
        return limits(self.host.home, self.host.rounded).isolated

    @property
    def pose(self) -> np.ndarray:
        """The assembled drawing in its own coordinates, ``(N,)``."""
        return self.x * self.unit + self.shift

    def at(self, values: np.ndarray, inputs: Sequence[int]) -> tuple[Member, np.ndarray]:
        """The members for values of the inputs ``(inputs, targets)``, and what is known of all coordinates."""
        targets = values.shape[1]
        x = np.repeat(self.x[:, None], targets, axis=1).astype(values.dtype)
        x[list(inputs)] = (values - self.shift[list(inputs), None]) / self.unit[list(inputs), None]
        constants = tuple(np.repeat(c, targets, axis=2) for c in self.constants)
        self.reading.place_scalars(x, constants)
        turns, sizes = self.reading.measure_turns(self.constants, self.x[:, None])
        turns = np.repeat(turns, targets, axis=2)
        for k, is_angle in enumerate(self.reading.top.angles):
            s = self.reading.first + k
            if is_angle and self.reading.known[s]:
                turns[k] = np.cos(x[s]), np.sin(x[s])
        sizes = np.repeat(self.reading.pair_sizes(sizes), targets, axis=1)
        return Member(constants, np.where(self.reading.known[:, None], x, 0.0), turns, sizes), x

    def drawn(self, inputs: Sequence[int]) -> Member:
        """The member for the values that the inputs have in the drawing."""
        return self.at(self.pose[list(inputs), None], inputs)[0]


def describe(system: System, reading: Reading) -> Design:
    """A system in parts of its size, about its middle."""
    eq = derive(system)
    host, top = to_host(eq), reading.top
    drawn = np.asarray(settle(eq, np.zeros(len(top.coordinates))).q, float)
    spread = drawn[: len(top.points) * top.dim].reshape(-1, top.dim)
    size = float(np.ptp(spread, axis=0).max(initial=0.0)) or 1.0
    unit = np.where(pure_numbers(top), 1.0, size)
    shift, middle = np.zeros(len(drawn)), np.mean(spread, axis=0) if len(spread) else np.zeros(top.dim)
    if np.abs(middle).max(initial=0.0) > 2.0 * size:  # farther off numbers of the mechanism are lost beside its place
        shift[: spread.size] = np.tile(middle, len(spread))
        if np.abs(host.residual((drawn - shift)[:, None])).max(initial=0.0) > 1e-9 * size:
            shift[:] = 0.0  # rows that know places, not only what lies between them
    constants = [(c / size**p)[:, :, None] for c, p in zip(host.constants, reading.powers, strict=True)]
    own = [b for b, block in enumerate(top.blocks) if is_own(block.kind)]
    slopes = np.abs(host.jacobian((drawn - shift)[:, None])[0] * unit) if own else np.zeros((0, 0))
    for b in own:
        at = top.layout[b]
        steepest = slopes[at.rows].max(axis=2, initial=0.0)
        factors = 1.0 / np.where(steepest > 0.0, steepest, 1.0)
        constants[b] = np.concatenate([constants[b][:, :, 0], unit[at.variables], factors], axis=1)[:, :, None]
    owners = tuple(block.owners for block in system.topology.blocks)
    return Design(reading, host, unit, shift, (drawn - shift) / unit, tuple(constants), owners)


@with_owner
def read_polynomials(top: Topology, inputs: tuple[int, ...]) -> Reading:
    """Read a structure with its inputs (driven and held); remembered with it."""
    return Reading(top, inputs)


def circuits_hint(system: Any, names: Sequence[str]) -> str:
    """A sentence that points to `jaxnc.circuits`, for a system of one freedom and its input, where that reads it."""
    top = system.topology
    if len(names) != 1 or system.degrees_of_freedom != 1 or names[0] not in top.position:
        return ""
    try:
        read_polynomials(top.structure, (top.position[names[0]],))
    except NotPolynomial:
        return ""
    return f"jaxnc.circuits(system, {{{names[0]!r}: values}}) lists all circuits and where their branches meet"
