"""Block-triangular form of a sparse square matrix: a row for every column, and the order in which blocks are solved."""

from collections.abc import Sequence


def matching(rows: Sequence[Sequence[int]], count: int) -> list[int]:
    """For each column a row of its own, of those that it has an entry in; -1 for none."""
    owner, matched = [-1] * count, [-1] * len(rows)
    for column in range(len(rows)):
        # Augmenting path, breadth first: from the column over its rows to the columns that own them.
        came: dict[int, int] = {}
        queue = [column]
        for at in queue:
            free = -1
            for row in rows[at]:
                if row not in came:
                    came[row] = at
                    if owner[row] < 0:
                        free = row
                        break
                    queue.append(owner[row])
            if free >= 0:
                while free >= 0:
                    at = came[free]
                    owner[free] = at
                    matched[at], free = free, matched[at]
                break
    return matched


def strong_components(leads: Sequence[Sequence[int]]) -> list[list[int]]:
    """Strong components of a directed graph, each after all that it leads to (Tarjan, without recursion)."""
    number = [-1] * len(leads)
    low = [0] * len(leads)
    waiting: list[int] = []
    inside = [False] * len(leads)
    out: list[list[int]] = []
    next_number = 0
    for root in range(len(leads)):
        if number[root] >= 0:
            continue
        path = [(root, iter(leads[root]))]
        number[root] = low[root] = next_number
        next_number += 1
        waiting.append(root)
        inside[root] = True
        while path:
            node, rest = path[-1]
            for other in rest:
                if number[other] < 0:
                    number[other] = low[other] = next_number
                    next_number += 1
                    waiting.append(other)
                    inside[other] = True
                    path.append((other, iter(leads[other])))
                    break
                if inside[other]:
                    low[node] = min(low[node], number[other])
            else:
                path.pop()
                if path:
                    parent = path[-1][0]
                    low[parent] = min(low[parent], low[node])
                if low[node] == number[node]:
                    component = []
                    while True:
                        other = waiting.pop()
                        inside[other] = False
                        component.append(other)
                        if other == node:
                            break
                    out.append(sorted(component))
    return out
