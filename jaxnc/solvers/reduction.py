"""Elimination of a block-triangular matrix with small diagonal blocks, in as few rounds as its graph allows.

Solving block after block takes as many steps as the chain is long. But where the diagonal blocks alone decide whether
the matrix is regular, its blocks may be eliminated in any order: in every round an independent set of them, each
joining its predecessors to its successors. A chain of N loops is done in log2 N rounds, which is block cyclic
reduction; a tree or any other loose graph goes the same way. Everything is gathered, nothing is scattered; sizes halve
from round to round, so work and memory are linear.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.solvers import dense
from jaxnc.solvers.pattern import Pattern
from jaxnc.types import Array, Float

_LARGEST = 4  # unknowns of a diagonal block: with larger ones a general sparse factorisation does less work
_FILL = 24  # times the links of the graph: with more the blocks are too entangled for this way
_ROUNDS = 40  # a chain as long as a machine can hold needs fewer; more take long to compile
_CHEAP = 4  # links that may take the place of an eliminated block's


class Round(NamedTuple):
    """One round, by positions in the graph as it is when the round begins; link 0 is empty.

    Attributes:
        gone: blocks eliminated.
        kept: blocks that stay, in the order of the next round.
        order: place of every block in the sequence kept, gone.
        inflow: per kept block, ``(terms, kept)``: the links to it from eliminated ones, and which they are.
        outflow: per eliminated block, ``(terms, gone)``: its links from kept ones, and which they are (next positions).
        old: per link of the next round, the same link now, 0 if it is new.
        products: per link of the next round, ``(terms, links)``: the two links that it joins.
    """

    gone: np.ndarray
    kept: np.ndarray
    order: np.ndarray
    inflow: tuple[np.ndarray, np.ndarray]
    outflow: tuple[np.ndarray, np.ndarray]
    old: np.ndarray
    products: tuple[np.ndarray, np.ndarray]


class Reduced(NamedTuple):
    """A factorised matrix: what the rounds need, and what the diagonal blocks say.

    Attributes:
        inverses: of the diagonal blocks, ``(b, b, blocks)``.
        inflow: per round, the links' values, each ``(b, b, kept)``.
        outflow: per round, likewise ``(b, b, gone)``.
    """

    inverses: Array
    inflow: tuple[tuple[Array, ...], ...]
    outflow: tuple[tuple[Array, ...], ...]


@dataclass(frozen=True, eq=False)
class Reduction:
    """The plan of an elimination.

    Attributes:
        diagonal: places of the diagonal blocks in the numbers, ``(b, b, blocks)``; `count` is zero, ``count + 1`` one.
        links: places of the blocks beside the diagonal, ``(b, b, links)``, the first one empty.
        ends: per link, the block whose rows it is in.
        rows: per block, its rows, ``(b, blocks)``, m where it has fewer.
        slots: place of every unknown in the flattened blocks, ``(n,)``.
        rounds: the rounds.
        sizes: unknowns of each block.
    """

    diagonal: np.ndarray
    links: np.ndarray
    ends: np.ndarray
    rows: np.ndarray
    slots: np.ndarray
    rounds: tuple[Round, ...]
    sizes: np.ndarray

    @property
    def stored(self) -> int:
        """Numbers that a factorisation keeps."""
        b = len(self.diagonal)
        return b * b * (self.diagonal.shape[2] + sum(r.inflow[0].size + r.outflow[0].size for r in self.rounds))

    def blocks(self, data: Array) -> Float[Array, "b b blocks"]:
        """The diagonal blocks, smaller ones filled up with the identity."""
        return _taken(jnp.concatenate([data, jnp.array([0.0, 1.0])]), self.diagonal)

    def factorise(self, data: Array) -> Reduced:
        """Eliminate; nothing here is differentiated."""
        blocks = self.blocks(data)
        inverses = _inverses(blocks)
        padded = jnp.concatenate([data, jnp.zeros(1)])
        values = -_product(_taken(inverses, self.ends), _taken(padded, self.links))
        inflow, outflow = [], []
        for r in self.rounds:
            inflow.append(tuple(_taken(values, at) for at in r.inflow[0]))
            outflow.append(tuple(_taken(values, at) for at in r.outflow[0]))
            following = _taken(values, r.old)
            for a, b in zip(*r.products, strict=True):
                following = following + _product(_taken(values, a), _taken(values, b))
            values = following
        return Reduced(inverses, tuple(inflow), tuple(outflow))

    def solve(self, reduced: Reduced, right: Float[Array, " m"]) -> Float[Array, " n"]:
        """Solve for one right-hand side; linear in it, and transposable."""
        b = _taken(jnp.concatenate([right, jnp.zeros(1)]), self.rows)
        x = _applied(reduced.inverses, b)
        eliminated = []
        for r, inflow in zip(self.rounds, reduced.inflow, strict=True):
            eliminated.append(_taken(x, r.gone))
            following = _taken(x, r.kept)
            for link, at in zip(inflow, r.inflow[1], strict=True):
                following = following + _applied(link, _taken(x, at))
            x = following
        for r, outflow, own in reversed(list(zip(self.rounds, reduced.outflow, eliminated, strict=True))):
            for link, at in zip(outflow, r.outflow[1], strict=True):
                own = own + _applied(link, _taken(x, at))
            x = _taken(jnp.concatenate([x, own], axis=1), r.order)
        return _taken(x.reshape(-1), self.slots)


def _taken(x: Array, at: np.ndarray) -> Array:
    """Columns by number; without the wrapping of negative ones, which costs more to compile than the gathering."""
    return x.at[..., at].get(mode="promise_in_bounds", wrap_negative_indices=False)


def _applied(matrices: Array, vectors: Array) -> Array:
    return jnp.sum(matrices * vectors[None], axis=1)


def _product(left: Array, right: Array) -> Array:
    return jnp.sum(left[:, :, None] * right[None], axis=1)


def _inverses(blocks: Array) -> Array:
    if len(blocks) == 1:
        return 1.0 / blocks
    if len(blocks) == 2:
        (a, b), (c, d) = blocks
        return jnp.stack([jnp.stack([d, -b]), jnp.stack([-c, a])]) / (a * d - b * c)
    eye = jnp.eye(len(blocks))
    return jax.vmap(lambda x: dense.eliminate(x, eye)[0], in_axes=2, out_axes=2)(blocks)


def reduction(sequence: tuple, pattern: Pattern) -> Reduction | None:
    """Plan the elimination of a block-triangular matrix.

    Args:
        sequence: rows and columns of its diagonal blocks, in an order in which they can be solved.
        pattern: where its numbers are.

    Returns:
        The plan; None where the blocks are too large or too entangled for it.
    """
    sizes = np.array([len(columns) for _, columns in sequence])
    if not len(sizes) or sizes.max() > _LARGEST:
        return None
    b, count = int(sizes.max()), len(sizes)
    m, n = pattern.shape
    rows, columns = np.full((b, count), m), np.full((b, count), n)
    for k, (r, c) in enumerate(sequence):
        rows[: len(r), k], columns[: len(c), k] = r, c
    owner, place = np.zeros(m + 1, int), np.zeros(n + 1, int)
    owner[rows], place[columns] = np.arange(count), np.arange(count)
    slots = np.zeros(n + 1, int)
    slots[columns] = np.arange(b * count).reshape(b, count)

    def between(ends: np.ndarray, starts: np.ndarray) -> np.ndarray:
        r, c = np.broadcast_arrays(rows[:, None, ends], columns[None, :, starts])
        return np.where((r < m) & (c < n), pattern.place(np.minimum(r, m - 1), np.minimum(c, n - 1)), pattern.count)

    diagonal = between(np.arange(count), np.arange(count))
    spare = np.eye(b, dtype=bool)[:, :, None] & (rows == m)[None]
    diagonal = np.where(spare, pattern.count + 1, diagonal)
    pairs = np.stack([owner[pattern.rows], place[pattern.columns]], axis=1)
    pairs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)
    links = np.concatenate([np.full((b, b, 1), pattern.count), between(pairs[:, 0], pairs[:, 1])], axis=2)
    rounds = _rounds(count, [(int(i), int(j)) for i, j in pairs])
    if rounds is None:
        return None
    ends = np.concatenate([[0], pairs[:, 0]]).astype(int)
    return Reduction(diagonal, links, ends, rows, slots[:n], rounds, sizes)


def _rounds(count: int, links: list[tuple[int, int]]) -> tuple[Round, ...] | None:
    """Plan the rounds for blocks 0 … count - 1 and links (block, predecessor)."""
    most, spent, out = _FILL * (count + len(links)), 0, []
    while count:
        number = {link: k for k, link in enumerate(links, start=1)}
        before: list[list[int]] = [[] for _ in range(count)]
        after: list[list[int]] = [[] for _ in range(count)]
        for i, j in links:
            before[i].append(j)
            after[j].append(i)
        cost = [len(p) * len(s) for p, s in zip(before, after, strict=True)]
        limit = max(_CHEAP, min(cost))
        blocked, chosen = [False] * count, []
        for k in sorted(range(count), key=lambda k: (cost[k], k)):
            if cost[k] > limit:
                break
            if not blocked[k]:
                chosen.append(k)
                for other in (*before[k], *after[k]):
                    blocked[other] = True
        gone = np.zeros(count, dtype=bool)
        gone[chosen] = True
        kept = np.flatnonzero(~gone)
        position = np.zeros(count, dtype=int)
        position[kept] = np.arange(len(kept))
        inflow: list[list[tuple[int, int]]] = [[] for _ in kept]
        outflow = [[(number[k, p], int(position[p])) for p in before[k]] for k in chosen]
        joined: dict[tuple[int, int], list[tuple[int, int]]] = {
            link: [] for link in links if not gone[link[0]] and not gone[link[1]]
        }
        for k in chosen:
            for s in after[k]:
                inflow[position[s]].append((number[s, k], k))
                for p in before[k]:
                    joined.setdefault((s, p), []).append((number[s, k], number[k, p]))
        following = list(joined)
        terms = [_terms(x) for x in (inflow, outflow, [[], *joined.values()])]
        spent += sum(t[0].size for t in terms)
        if spent > most or len(out) >= _ROUNDS:
            return None
        order = np.argsort(np.concatenate([kept, chosen]), kind="stable")
        old = np.array([0, *(number.get(link, 0) for link in following)], dtype=int)
        out.append(Round(np.array(chosen, dtype=int), kept, order, terms[0], terms[1], old, terms[2]))
        links = [(int(position[s]), int(position[p])) for s, p in following]
        count = len(kept)
    return tuple(out)


def _terms(lists: list[list[tuple[int, int]]]) -> tuple[np.ndarray, np.ndarray]:
    """Lists of pairs as two arrays ``(longest, lists)``, filled up with the empty link 0."""
    out = np.zeros((2, max(map(len, lists), default=0), len(lists)), dtype=int)
    for k, pairs in enumerate(lists):
        for t, pair in enumerate(pairs):
            out[:, t, k] = pair
    return out[0], out[1]
