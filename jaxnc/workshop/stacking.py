"""The layer of each plate, found by a search over all ways to stack plates so that nothing collides over a motion."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jaxnc.errors import AssemblyError, InputError, nearest
from jaxnc.kinematics.inputs import outside
from jaxnc.kinematics.motion import Motion
from jaxnc.status import Status
from jaxnc.workshop.assembly import Assembly, Passing, check_formats
from jaxnc.workshop.clearances import Gaps, PartCourse, complex_points
from jaxnc.workshop.stock import SIZES, PartStock, Pin, Shop

_MOST = 1_500_000  # looked at before the search is given up


@dataclass(frozen=True)
class Rule:
    """Two things that a stack must not bring together, if they come close."""

    # "parts": two parts are not in one layer; "pin and part": a part is not between two parts of a pin; "pins": two
    # pins (their spacers) do not pass through one space between layers; "slot": pins in one slot, which do in any case.
    kind: str
    one: tuple[int, ...]  # parts that the rule is about: one part, or those of a pin
    other: tuple[int, ...]  # the other part, or those of the other pin
    pair: int  # number of the pair of things that come close; -1 of parts that share a pin
    names: tuple[str, str] = ("", "")  # what both things are called

    def broken(self, level: dict[int, int]) -> bool:
        """Tell whether levels of some of the parts break the rule, whatever those of the others are."""
        mine = [level[p] for p in self.one if p in level]
        others = [level[p] for p in self.other if p in level]
        if not mine or not others:
            return False
        if self.kind == "parts":
            return mine == others
        if self.kind == "pin and part":
            return min(mine) < others[0] < max(mine)
        return self.kind == "slot" or max(min(mine), min(others)) < min(max(mine), max(others))


class TooMany(Exception):
    """A search that was given up."""


@dataclass
class LayerSearch:
    """A search for levels of parts; part 0, the ground plate, is on level 0."""

    count: int  # number of parts, the ground included
    rules: list[Rule]  # what must not be
    pins: list[tuple[int, ...]]  # parts of each pin
    left: int = _MOST  # how many choices may still be looked at
    longest: int | None = None  # what pins must be shorter than together, layers

    def fewest(self, most: int) -> tuple[dict[int, int], int] | None:
        """Find levels in as few layers as can be, and with the shortest pins of these; None if there are none."""
        for layers in range(1, most + 1):
            self.left = _MOST
            found = next(self.stacks(layers, self.rules), None)
            if found is None:
                continue
            # 30_000 are looked at for a shorter stack of pins, once there is one with the fewest layers
            self.left, self.longest = 30_000, self.length(found)
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
        """Count the layers that all pins span together, as far as their parts have levels."""
        spans = ([level[p] for p in pin if p in level] for pin in self.pins)
        return sum(max(s) - min(s) for s in spans if s)

    def reasons(self, most: int) -> list[Rule]:
        """Find rules that cannot be kept together, none of which can be left out."""
        kept = list(self.rules)
        for rule in self.rules:
            without = [r for r in kept if r is not rule]
            self.left = 60_000  # 60_000 are looked at to tell whether a rule can be left out of an explanation
            try:
                if next(self.stacks(most, without), None) is None:
                    kept = without
            except TooMany:
                continue  # not shown to be needless
        return kept

    def stacks(self, layers: int, rules: list[Rule]) -> Iterator[dict[int, int]]:
        """Yield all levels that keep rules, of so many layers."""
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


def to_parts(
    motion: Motion, folder: str | Path | None = None, formats: Sequence[str] = ("dxf", "svg"), **sizes: Any
) -> Assembly:
    """Make a planar mechanism of plates, pins and spacers, stacked so that nothing collides over a motion.

    Links are plates of one thickness, rounded around their pins; a link with two pins is a bar, one with more the hull
    of them. A pin that slides does so in a slot; what slides without turning has a second pin in the slot. All stand on
    one side of a ground plate, layer 0. A pin is flush, and goes through all layers between its parts, with washers or
    spacers on it. Two parts in one layer, a part and a pin that goes through its layer, and spacers keep a clearance
    over the whole motion: between poses it is bounded by how far both leave straight lines, from twice their
    accelerations at both poses, and poses are added until it is certain.

    Args:
        motion: a motion of a planar mechanism, ``(T,)``; all of its poses must be right.
        folder: where drawings of the parts and their table are written, if anywhere.
        formats: ``"dxf"``, ``"svg"`` or both.
        **sizes: as of `Shop.of`.

    Returns:
        Parts, pins, layers, and the clearances that remain.

    Raises:
        InputError: a spatial mechanism, one pose, poses that failed, joints that plates do not make, sizes that leave
            no wall.
        AssemblyError: there is no such stack; the message names bodies and pins in the way.
    """
    outside(motion, "to_parts()")
    if unknown := [name for name in sizes if name not in SIZES]:
        raise InputError(f"to_parts(): there is no {unknown[0]}=; {nearest(unknown[0], SIZES)}")
    formats = check_formats(formats)
    if missing := [f"{name}=" for name in ("width", "pin", "thickness") if name not in sizes]:
        raise InputError(f"to_parts(): give {', '.join(missing)} in mm")
    _check_motion(motion)
    found = _Stacking(motion, Shop.of(motion.system.topology.length_unit, **sizes)).assembly()
    if folder is not None:
        found.save(folder, formats)
    return found


def _check_motion(motion: Motion) -> None:
    top, status = motion.system.topology, np.asarray(motion.status)
    if top.dim != 2:
        raise InputError(f"to_parts(): {top.name!r} is spatial; plates in layers are for planar mechanisms")
    if status.ndim != 1 or len(status) < 3 or motion.system.parameters.points.ndim != 2:
        raise InputError(
            f"to_parts(): poses of shape {status.shape}; give a sweep of one design, of three poses or more"
        )
    if status.any():
        bad = int(np.flatnonzero(status)[0])
        said = f"failed: {Status(int(status[bad])).sentence} Give a range that it goes through"
        if 0 < bad < len(status) - 1 and status[bad] == Status.SINGULAR and status[bad + 1] == Status.CONVERGED:
            said = "is a change point, where branches cross; give other poses, as one more or fewer, that miss it"
        raise InputError(f"to_parts(): pose {bad} of {top.name!r} {said}")


class _Stacking:
    """Parts and pins of a mechanism, how close they come over a motion, and how they are stacked."""

    def __init__(self, motion: Motion, shop: Shop):
        self.name, self.shop = motion.system.topology.name, shop
        self.z = complex_points(motion, shop.unit)
        stock = PartStock(motion, self.z, shop)
        self.parts, self.pins = stock.parts, stock.pins
        for pin in self.pins:
            pin.parts.sort()
        self.near, radii, shapes, rows = self._pairs()
        weights, constant = np.array([r[0] for r in rows]), np.array([r[1] for r in rows])
        self.gaps = Gaps(PartCourse.of(motion, weights, constant, shop.unit), np.array(radii), shapes)
        self.gaps.unsure = stock.unsure

    def _pairs(self) -> tuple[list[Rule], list[float], list[tuple[np.ndarray, np.ndarray]], list]:
        """List what might come close, the radii and corners of both, and all corners as functions of the points."""
        parts, pins, shop = self.parts, self.pins, self.shop
        rows, corners = [], []
        for frame, places in [*((p.frame, p.corners) for p in parts), *((parts[p.part].frame, [p.at]) for p in pins)]:
            corners.append(np.arange(len(rows), len(rows) + len(places)))
            rows += [frame.row(complex(w), self.z.shape[1]) for w in places]
        near, radii, shapes, moving = [], [], [], range(1, len(parts))
        things = [((k,), part.name) for k, part in enumerate(parts)]
        things += [(tuple(pin.parts), f"pin {pin.name}") for pin in pins]

        def add(kind: str, first: int, second: int, both: float) -> None:
            (one, name), (other, called) = things[first], things[second]
            near.append(Rule(kind, one, other, len(near), (name, called)))
            radii.append(both)
            shapes.append((corners[first], corners[second]))

        for i, j in itertools.combinations(moving, 2):
            if not self._shared_pin(i, j):
                add("parts", i, j, shop.width)
        for k, pin in enumerate(pins):
            for j in moving:
                if j not in pin.parts:
                    add("pin and part", len(parts) + k, j, 0.5 * (shop.spacer + shop.width))
        rigid = [{h.pin for h in part.holes} for part in parts]
        home = [rows[own[0]][0] @ self.z[0] + rows[own[0]][1] for own in corners[len(parts) :]]
        for k, m in itertools.combinations(range(len(pins)), 2):
            held = any({k, m} <= holes for holes in rigid)  # in holes of one part, always as far apart
            if not held or abs(home[k] - home[m]) < shop.spacer + shop.clearance:
                add("pins", len(parts) + k, len(parts) + m, shop.spacer)
        for slot in (slot for part in parts for slot in part.slots):
            for i, j in itertools.combinations(sorted(set(slot.pins)), 2):
                if not any({i, j} <= held for held in rigid):  # pins that slide, and are not in holes of one part
                    add("slot", len(parts) + i, len(parts) + j, shop.pin)
        return near, radii, shapes, rows

    def _shared_pin(self, i: int, j: int) -> Pin | None:
        """Find a pin that goes through two parts."""
        return next((p for p in self.pins if i in p.parts and j in p.parts), None)

    def assembly(self) -> Assembly:
        """Stack the parts."""
        parts, pins, gaps = self.parts, self.pins, self.gaps
        search = LayerSearch(len(parts), self._rules(), [tuple(p.parts) for p in pins])
        most = self.shop.layers or len(parts) - 1
        try:
            answer = search.fewest(min(most, len(parts) - 1))
        except TooMany:
            raise AssemblyError(
                f"to_parts(): no stack of {self.name!r} was found, nor is it shown that there is none"
            ) from None
        if answer is None:
            raise AssemblyError(self._impossible(search, most))
        level = answer[0]
        only = np.array([self._passes(rule, level) for rule in self.near], dtype=bool)
        low, poses = gaps.least(only, self.shop.clearance)
        passing = [
            Passing(*self.near[k].names, float(low[k]), float(poses[k]))
            for k in sorted(np.flatnonzero(only).tolist(), key=lambda k: low[k])
        ]
        count, levels = len(np.unique(gaps.course.s)), tuple(level[k] for k in range(len(parts)))
        return Assembly(
            self.name, self.shop, tuple(parts), tuple(pins), levels, tuple(passing), count, self.z, gaps.unsure
        )

    def _rules(self) -> list[Rule]:
        """List what a stack must not do."""
        rules = [
            Rule("parts", (i,), (j,), -1)
            for i, j in itertools.combinations(range(1, len(self.parts)), 2)
            if self._shared_pin(i, j)
        ]
        for k in np.flatnonzero(self.gaps.touching(self.shop.clearance)).tolist():
            rule = self.near[k]
            if rule.kind == "slot":
                one, other = rule.names
                raise AssemblyError(
                    f"to_parts(): {self.name!r}: {one} and {other} come too close in the slot that they share "
                    f"({self._closest(k)}); pins cannot pass each other there. Let it move less, or give one another "
                    f"guide"
                )
            rules.append(rule)
        return rules

    def _passes(self, rule: Rule, level: dict[int, int]) -> bool:
        """Tell whether two things are in one layer, or one space between layers."""
        if rule.kind == "pins" and {*rule.one} & {*rule.other}:
            return False  # nothing passes: they are in one part, and were drilled far enough from each other
        return rule.broken(level)

    def _closest(self, pair: int) -> str:
        """Say where two things are closest, and how far they are apart there if they are."""
        ends = self.gaps.ends[..., pair].reshape(-1)
        at = int(ends.argmin())
        apart = f", {ends[at]:.3g} mm apart" if ends[at] > 0 else ""
        return f"pose {self.gaps.course.s.reshape(-1)[at]:.4g}{apart}"

    def _impossible(self, search: LayerSearch, most: int) -> str:
        """Say why there is no stack, by the names of what is in the way."""
        shop, parts, needed = self.shop, self.parts, None
        if most < len(parts) - 1:
            try:
                needed = search.fewest(len(parts) - 1)
            except TooMany:
                needed = None
        said = [self._reason(rule) for rule in search.reasons(min(most, len(parts) - 1))]
        named = 6  # reasons that a message gives
        shown = "; ".join(said[:named]) + (f"; and {len(said) - named} more" if len(said) > named else "")
        start = f"to_parts(): {self.name!r}"
        if needed is not None:
            return f"{start} needs {needed[1]} layers above its ground plate, layers={most} is too few: {shown}"
        more = ""
        if self.gaps.unsure:
            more = " Between some poses it could not be looked at; a sweep with more poses may tell more."
        return (
            f"{start} cannot be stacked on one side of a ground plate: {shown}. Make links narrower or spacers thinner "
            f"(width={shop.width:g}, spacer={shop.spacer:g}, clearance={shop.clearance:g} mm), let it move less, or "
            f"move the points.{more}"
        )

    def _reason(self, rule: Rule) -> str:
        """Say what a rule keeps apart."""
        if rule.pair < 0:
            i, j = rule.one[0], rule.other[0]
            pin = self._shared_pin(i, j)
            assert pin is not None
            return f"{self.parts[i].name} and {self.parts[j].name} share pin {pin.name}"
        (one, other), where = rule.names, self._closest(rule.pair)
        if rule.kind == "parts":
            return f"{one} and {other} come too close ({where}) and cannot lie in one layer"
        if rule.kind == "pins":
            return f"the spacers of {one} and {other} come too close ({where})"
        between = " and ".join(self.parts[p].name for p in rule.one)
        return f"{one}, of {between}, is in the way of {other} ({where})"
