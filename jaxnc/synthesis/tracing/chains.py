"""Linkages that are chains of dyads: a crank, then pairs of links that hang on what is there.

A dyad adds two links and three joints of one freedom each: an outer joint, the inner one between the two links, and
another outer joint. Joints turn (R) or slide (P). Bodies are numbered: 0 is the ground, 1 the crank, and dyad d adds
bodies 2 + 2 d and 3 + 2 d. What a dyad hangs on are two earlier bodies. The point that traces rides on a link of the
last dyad, and every dyad carries something.

Sources: L. V. Assur's groups of class II; F. Freudenstein, L. Dobrjanskyj (1964) and T. S. Mruthyunjaya, Mech. Mach.
Theory 38 (2003), for the numbers of chains with turning pairs: 1, 2, 16 of four, six, eight bars, 1, 5, 71 inversions.
"""

import functools
import itertools
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from jaxnc.calls import public

KINDS = ("RRR", "RRP", "RPR", "PRP")  # PRR is RRP told from its other end
_SYMMETRIC = ("RRR", "RPR", "PRP")
GROUND, CRANK = 0, 1


@public
class Hung(NamedTuple):
    """A dyad: its joints from one outer one to the other, and the bodies on which its outer joints hang."""

    kind: str
    first: int
    second: int


@public
class Chain(NamedTuple):
    """A crank-driven linkage of dyads, and the body on which its tracing point rides."""

    dyads: tuple[Hung, ...]
    tracer: int

    @property
    def bars(self) -> int:
        """Number of links, the ground among them."""
        return 2 + 2 * len(self.dyads)

    @property
    def sliders(self) -> int:
        """Number of sliding pairs."""
        return sum(dyad.kind.count("P") for dyad in self.dyads)

    @property
    def edges(self) -> list[tuple[int, int, str]]:
        """Joints: the two bodies and ``"R"`` or ``"P"``, the crank's on the ground first."""
        out = [(GROUND, CRANK, "R")]
        for d, (kind, a, b) in enumerate(self.dyads):
            one, two = 2 + 2 * d, 3 + 2 * d
            out += [(a, one, kind[0]), (one, two, kind[1]), (b, two, kind[2])]
        return out

    @property
    def name(self) -> str:
        """The name that one recognises where it has one; otherwise its number of bars and its dyads."""
        known = _recognise(self)
        if known:
            return known
        told = " ".join(f"{kind}({a},{b})" for kind, a, b in self.dyads)
        return f"{ {4: 'four', 6: 'six', 8: 'eight'}[self.bars] }-bar {told}"


@functools.cache
def _recognise(chain: Chain) -> str:
    kinds = [dyad.kind for dyad in chain.dyads]
    if kinds == ["RRR"]:
        return "four-bar"
    if kinds == ["RRP"]:
        return "slider-crank" if chain.dyads[0].second == GROUND else "inverted slider-crank, sliding on the crank"
    if kinds == ["RPR"]:
        return "inverted slider-crank"
    if kinds == ["PRP"]:
        return "Scotch yoke"
    if kinds == ["RRR", "RRR"]:
        return _name_six_bar(chain)
    return "Jansen" if _canonical(*chain) == _canonical(*JANSEN) else ""


def _name_six_bar(chain: Chain) -> str:
    """Tell which of the five inversions of the chains by Watt and Stephenson it is."""
    meets = neighbours(chain.bars, ((a, b) for a, b, _ in chain.edges))
    one, two = (body for body, others in meets.items() if len(others) == 3)
    if two in meets[one]:
        return "Watt II" if GROUND in (one, two) else "Watt I"
    if GROUND in (one, two):
        return "Stephenson III"
    return "Stephenson I" if meets[GROUND] == {one, two} else "Stephenson II"


def neighbours(bars: int, joints: Iterable[tuple[int, int]]) -> dict[int, set[int]]:
    """Find the links to which each link is joined."""
    meets: dict[int, set[int]] = {link: set() for link in range(bars)}
    for a, b in joints:
        meets[a].add(b)
        meets[b].add(a)
    return meets


JANSEN = Chain((Hung("RRR", 0, 1), Hung("RRR", 0, 1), Hung("RRR", 2, 5)), 7)


def _orders(dyads: tuple[Hung, ...]) -> Iterator[tuple[int, ...]]:
    """Give the orders in which dyads can be hung up, each after those that it hangs on."""
    for order in itertools.permutations(range(len(dyads))):
        place = {d: k for k, d in enumerate(order)}
        if all(place[(x - 2) // 2] < place[d] for d in order for x in dyads[d][1:] if x > CRANK):
            yield order


def _canonical(dyads: tuple[Hung, ...], tracer: int) -> Chain:
    """Choose among the ways to number a chain's bodies the first in order."""
    turnable = [d for d, dyad in enumerate(dyads) if dyad.kind in _SYMMETRIC]
    ways = []
    for order in _orders(dyads):
        place = {old: new for new, old in enumerate(order)}
        for turned in itertools.product((False, True), repeat=len(turnable)):
            other_way = {d for d, t in zip(turnable, turned, strict=True) if t}

            def number(body: int, place: dict[int, int] = place, other_way: set[int] = other_way) -> int:
                d, end = divmod(body - 2, 2)
                return body if body <= CRANK else 2 + 2 * place[d] + (end ^ (d in other_way))

            new = []
            for d in order:
                kind, a, b = dyads[d]
                a, b = (b, a) if d in other_way else (a, b)
                new.append(Hung(kind, number(a), number(b)))
            ways.append(Chain(tuple(new), number(tracer)))
    return min(ways)


@functools.cache
def dyadic_chains(bars: int, sliders: bool = True) -> tuple[Chain, ...]:
    """List all chains of dyads with some number of bars, none of them twice.

    Left out are tracing links that turn about a point of the ground or slide along a line of it: their curves are
    circles and straight lines.

    Args:
        bars: number of links with the ground: 4, 6 or 8.
        sliders: sliding pairs too.
    """
    count, found = (bars - 2) // 2, set()
    kinds = KINDS if sliders else KINDS[:1]

    def grow(dyads: tuple[Hung, ...]) -> None:
        if len(dyads) == count:
            carrying = {(x - 2) // 2 for dyad in dyads for x in dyad[1:] if x > CRANK}
            if carrying >= set(range(count - 1)):
                found.update(_canonical(dyads, 2 * count + end) for end in (0, 1) if dyads[-1][1 + end] != GROUND)
            return
        for kind in kinds:
            pairs = itertools.combinations if kind in _SYMMETRIC else itertools.permutations
            for a, b in pairs(range(2 + 2 * len(dyads)), 2):
                grow((*dyads, Hung(kind, a, b)))

    grow(())
    return tuple(sorted(found))


class ChainArrays(NamedTuple):
    """Chains with the same number of dyads as arrays, so that one program serves all of them."""

    kind: np.ndarray  # indices in `KINDS`, (N, dyads)
    first: np.ndarray  # the bodies on which they hang, (N, dyads)
    second: np.ndarray
    tracer: np.ndarray  # (N,)

    @classmethod
    def of(cls, chains: tuple[Chain, ...]) -> "ChainArrays":
        """Write chains as arrays."""
        rows = [[(KINDS.index(kind), a, b) for kind, a, b in chain.dyads] for chain in chains]
        table = np.array(rows, dtype=np.int8)
        return cls(table[..., 0], table[..., 1], table[..., 2], np.array([c.tracer for c in chains], dtype=np.int8))

    def at(self, index: np.ndarray) -> "ChainArrays":
        """Select chains, with repetitions."""
        return ChainArrays(*(array[index] for array in self))
