"""In which layer each plate lies: a search over all ways to stack them."""

from collections.abc import Iterator
from dataclasses import dataclass

_NODES = 30_000  # looked at for a shorter stack of pins, once there is one with the fewest layers
_MOST = 1_500_000  # looked at before the search is given up
_CORE = 60_000  # looked at to tell whether a rule can be left out of an explanation


@dataclass(frozen=True)
class Rule:
    """What a stack must not do."""

    # "parts": two parts are not in one layer; "pin and part": a part is not between two parts of a pin; "pins": two
    # pins do not pass through one space between layers.
    kind: str
    one: tuple[int, ...]  # parts that the rule is about: one part, or those of a pin
    other: tuple[int, ...]  # the other part, or those of the other pin
    pair: int  # number of the pair of things that come close; -1 of parts that share a pin

    def broken(self, level: dict[int, int]) -> bool:
        """Whether levels of some of the parts break it, whatever those of the others are."""
        mine = [level[p] for p in self.one if p in level]
        others = [level[p] for p in self.other if p in level]
        if not mine or not others:
            return False
        if self.kind == "parts":
            return mine == others
        if self.kind == "pin and part":
            return min(mine) < others[0] < max(mine)
        return max(min(mine), min(others)) < min(max(mine), max(others))


class TooMany(Exception):
    """The search was given up."""


@dataclass
class Search:
    """A search for levels of parts; part 0, the ground plate, is on level 0."""

    count: int  # number of parts, the ground included
    rules: list[Rule]  # what must not be
    pins: list[tuple[int, ...]]  # parts of each pin
    left: int = _MOST  # how many choices may still be looked at
    longest: int | None = None  # what pins must be shorter than together, layers

    def fewest(self, most: int) -> tuple[dict[int, int], int] | None:
        """Levels in as few layers as can be, and with the shortest pins of these; None if there are none."""
        for layers in range(1, most + 1):
            self.left = _MOST
            found = next(self.stacks(layers, self.rules), None)
            if found is None:
                continue
            self.left, self.longest = _NODES, self.length(found)
            try:
                for other in self.stacks(layers, self.rules):
                    found, self.longest = other, self.length(other)
            except TooMany:
                pass  # the best so far is a stack all the same
            finally:
                self.longest = None
            return found, layers
        return None

    def length(self, level: dict[int, int]) -> int:
        """Layers that all pins span together, as far as their parts have levels."""
        spans = ([level[p] for p in pin if p in level] for pin in self.pins)
        return sum(max(s) - min(s) for s in spans if s)

    def reasons(self, most: int) -> list[Rule]:
        """Rules that cannot be kept together, none of which can be left out."""
        kept = list(self.rules)
        for rule in self.rules:
            without = [r for r in kept if r is not rule]
            self.left = _CORE
            try:
                if next(self.stacks(most, without), None) is None:
                    kept = without
            except TooMany:
                continue  # not shown to be needless
        return kept

    def stacks(self, layers: int, rules: list[Rule]) -> Iterator[dict[int, int]]:
        """All levels that keep rules, of so many layers."""
        of: dict[int, list[Rule]] = {k: [] for k in range(self.count)}
        for rule in rules:
            for part in {*rule.one, *rule.other}:
                of[part].append(rule)
        order, rest = [0], set(range(1, self.count))
        while rest:  # next the one that has most to do with those before it
            met = {k: sum(any(p in order for p in (*r.one, *r.other)) for r in of[k]) for k in rest}
            order.append(max(rest, key=lambda k: (met[k], len(of[k]), -k)))
            rest.remove(order[-1])
        level = {0: 0}

        def place(at: int) -> Iterator[dict[int, int]]:
            if at == len(order):
                yield dict(level)
                return
            part = order[at]
            for layer in range(1, layers + 1):
                self.left -= 1
                if self.left < 0:
                    raise TooMany
                level[part] = layer
                longer = self.longest is not None and self.length(level) >= self.longest
                if not longer and not any(rule.broken(level) for rule in of[part]):
                    yield from place(at + 1)
                del level[part]

        return place(1)
