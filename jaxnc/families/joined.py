"""Which parts share a point or a vector already by the joints of a tree, and which equations that leaves."""

from collections.abc import Mapping, Sequence

Joined = dict[int, dict[int, int]]
"""For every point (vector) a forest over the parts that hold it: the part before each, or itself."""


def apart(holders: Mapping[int, Sequence[int]]) -> Joined:
    """Nothing joined yet."""
    return {item: {k: k for k in parts} for item, parts in holders.items()}


def root(group: Mapping[int, int] | list[int], k: int) -> int:
    """The representative of a group."""
    while group[k] != k:
        k = group[k]
    return k


def join(group: dict[int, int], first: int, second: int) -> None:
    """Make one group of two."""
    group[root(group, second)] = root(group, first)


def closures(joined: Joined) -> list[tuple[int, int, int]]:
    """What parts still have to share: ``(item, part, part)``."""
    out = []
    for item, group in joined.items():
        group = dict(group)
        first, *others = group or {-1: -1}
        for k in others:
            if root(group, first) != root(group, k):
                join(group, first, k)
                out.append((item, first, k))
    return out
