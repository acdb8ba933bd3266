"""All chains of turning pairs of one freedom with four, six and eight bars, counted, and which are chains of dyads.

A chain is put together from its links with three and more joints and from strings of links with two joints between
them. No part of it may be stiff: of k links and e joints, 3 (k - 1) - 2 e is the freedom.

Sources: T. S. Mruthyunjaya, Mech. Mach. Theory 38 (2003), for the counts: 1, 2, 16 chains and 1, 5, 71 inversions.
"""

import itertools
from collections.abc import Iterator
from typing import NamedTuple

from jaxnc.synthesis.tracing.chains import neighbours

Joints = tuple[tuple[int, int], ...]


class Census(NamedTuple):
    """How many there are with some number of bars."""

    chains: int
    inversions: int  # a chain with one of its links as the ground
    driven: int  # an inversion with one of the ground's neighbours as the crank
    traced: (
        int  # a driven one with the link on which the tracing point rides, a link that is no neighbour of the ground
    )
    dyadic: int  # those of the traced that are chains of dyads


def count_chains(bars: int) -> Census:
    """Count chains of turning pairs, what can be made of them, and what is left as chains of dyads."""
    chains = _chains(bars)
    inversions = driven = traced = dyadic = 0
    for joints in chains:
        group = _mappings(bars, joints, joints)
        meets = neighbours(bars, joints)
        inversions += len({min(g[link] for g in group) for link in range(bars)})
        pairs = [(a, b) for a in range(bars) for b in sorted(meets[a])]
        cranks = {min((g[a], g[b]) for g in group) for a, b in pairs}
        driven += len(cranks)
        with_tracer = [(a, b, c) for a, b in pairs for c in range(bars) if c not in (a, b) and c not in meets[a]]
        each = {min((g[a], g[b], g[c]) for g in group) for a, b, c in with_tracer}
        traced += len(each)
        dyadic += sum(_is_dyadic(bars, meets, *one) for one in each)
    return Census(len(chains), inversions, driven, traced, dyadic)


def _chains(bars: int) -> list[Joints]:
    """Find all chains, none of them twice: links with many joints first, then strings of links between them."""
    if bars == 4:
        return [((0, 1), (0, 3), (1, 2), (2, 3))]
    found: list[Joints] = []
    for quaternary in range((bars - 4) // 2 + 1):
        needs = [4] * quaternary + [3] * (bars - 4 - 2 * quaternary)
        fresh = bars - len(needs)
        for edges in _multigraphs(needs):
            for lengths in itertools.product(range(fresh + 1), repeat=len(edges)):
                if sum(lengths) == fresh:
                    chain = _spell_out(len(needs), edges, lengths)
                    alone = len(set(chain)) == len(chain) and _moves(bars, chain)
                    if alone and not any(_mappings(bars, chain, known) for known in found):
                        found.append(chain)
    return found


def _multigraphs(needs: list[int]) -> Iterator[tuple[tuple[int, int], ...]]:
    """Yield connections of links that use up the joints of each."""
    pairs = list(itertools.combinations(range(len(needs)), 2))

    def fill(k: int, left: list[int], chosen: tuple[tuple[int, int], ...]) -> Iterator[tuple[tuple[int, int], ...]]:
        if k == len(pairs):
            if not any(left):
                yield chosen
            return
        a, b = pairs[k]
        for times in range(min(left[a], left[b]) + 1):
            rest = list(left)
            rest[a] -= times
            rest[b] -= times
            yield from fill(k + 1, rest, chosen + (pairs[k],) * times)

    yield from fill(0, needs, ())


def _spell_out(many: int, edges: tuple[tuple[int, int], ...], lengths: tuple[int, ...]) -> Joints:
    joints, fresh = [], itertools.count(many)
    for (a, b), between in zip(edges, lengths, strict=True):
        string = [a, *(next(fresh) for _ in range(between)), b]
        joints += [(min(p), max(p)) for p in itertools.pairwise(string)]
    return tuple(sorted(joints))


def _moves(bars: int, joints: Joints) -> bool:
    """Say whether every part of a chain has a freedom."""
    for size in range(2, bars):
        for part in itertools.combinations(range(bars), size):
            inside = set(part)
            if 3 * (size - 1) - 2 * sum(a in inside and b in inside for a, b in joints) < 1:
                return False
    return True


def _mappings(bars: int, one: Joints, other: Joints) -> list[tuple[int, ...]]:
    """All ways to number the links of a chain that make its joints those of another one, or of itself."""
    meets, there, found = neighbours(bars, one), neighbours(bars, other), []

    def extend(image: list[int]) -> None:
        k = len(image)
        if k == bars:
            found.append(tuple(image))
            return
        for new in range(bars):
            fits = new not in image and len(there[new]) == len(meets[k])
            if fits and all((j in meets[k]) == (image[j] in there[new]) for j in range(k)):
                extend([*image, new])

    extend([])
    return found


def _is_dyadic(bars: int, meets: dict[int, set[int]], ground: int, crank: int, tracer: int) -> bool:
    """Say whether dyads can be hung up one after another, the last of them with the tracer, and none is idle."""
    placed, order = {ground, crank}, []
    while len(placed) < bars:
        free = [link for link in range(bars) if link not in placed]
        pair = next(
            (
                (a, b)
                for a, b in itertools.combinations(free, 2)
                if b in meets[a] and len(meets[a] & placed) == 1 and len(meets[b] & placed) == 1
            ),
            None,
        )
        if pair is None:
            return False
        order.append(pair)
        placed |= set(pair)
    needed = next(pair for pair in order if tracer in pair)
    carrying = set(needed)
    for pair in reversed(order):  # what the tracer's dyad hangs on, directly or not
        if set(pair) & carrying:
            for link in pair:
                carrying |= meets[link] & {x for p in order[: order.index(pair) + 1] for x in p}
    return set(needed) | {x for p in order if set(p) & carrying for x in p} | {ground, crank} == set(range(bars))
