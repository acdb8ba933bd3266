"""A mechanism as plates in layers: parts, pins, spacers, and the clearances that remain."""

import csv
import io
import itertools
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import AssemblyError, InputError
from jaxnc.io.target import folder, replacing, stem
from jaxnc.io.workshop import lists
from jaxnc.io.workshop.course import Course, points
from jaxnc.io.workshop.gaps import Gaps, Pair
from jaxnc.io.workshop.layers import Rule, Search, TooMany
from jaxnc.io.workshop.lists import mm
from jaxnc.io.workshop.shop import Shop
from jaxnc.io.workshop.stock import Part, Pin, Stock, stock
from jaxnc.kinematics.inputs import outside
from jaxnc.kinematics.motion import Motion
from jaxnc.status import Status

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NAMED = 6  # reasons that a message gives


@public
@dataclass(frozen=True)
class Passing:
    """Two things that pass each other in a layer.

    Attributes:
        one: the first.
        other: the second.
        clearance: what stays between them over the whole motion at least, mm, between its poses too.
        pose: number of the pose where they are closest; a fraction lies between two of them.
    """

    one: str
    other: str
    clearance: float
    pose: float


@public
@dataclass(frozen=True)
class Spacer:
    """A washer or spacer on a pin, between two parts.

    Attributes:
        pin: name of the pin.
        below: the part below it.
        above: the part above it.
        length: mm.
        washer: whether it lies between neighbouring layers.
    """

    pin: str
    below: str
    above: str
    length: float
    washer: bool


@public
@dataclass(frozen=True)
class Assembly:
    """A planar mechanism made of plates; ``print()`` shows its table.

    Attributes:
        name: of the mechanism.
        shop: the sizes.
        parts: plates, the ground first.
        pins: pins that join parts.
        levels: layer of each part, 0 the ground, counted upward.
        passing: what passes in one layer, the closest first.
        poses: how many poses were looked at.
        z: places of all points in all poses of the motion, complex, ``(T, points)``, mm.
        unsure: whether poses were too far apart somewhere: what might meet there is kept apart, and clearances may be
            larger than is said.
    """

    name: str
    shop: Shop
    parts: tuple[Part, ...]
    pins: tuple[Pin, ...]
    levels: tuple[int, ...]
    passing: tuple[Passing, ...]
    poses: int
    z: np.ndarray
    unsure: bool = False

    @property
    def layers(self) -> int:
        """How many layers there are above the ground plate."""
        return max(self.levels)

    @property
    def clearance(self) -> float:
        """What stays between all that passes in one layer at least, mm; infinite if nothing does."""
        return min((p.clearance for p in self.passing), default=np.inf)

    def span(self, pin: Pin) -> tuple[int, int]:
        """The lowest and the highest layer of a pin."""
        levels = [self.levels[p] for p in pin.parts]
        return min(levels), max(levels)

    def length(self, pin: Pin) -> float:
        """Of a pin, from the outer face of its lowest part to that of its highest, mm."""
        low, high = self.span(pin)
        return (high - low) * self.shop.pitch + self.shop.thickness

    @property
    def spacers(self) -> tuple[Spacer, ...]:
        """Washers and spacers, those of length zero left out."""
        out = []
        for pin in self.pins:
            for low, high in itertools.pairwise(sorted(pin.parts, key=lambda p: self.levels[p])):
                step = self.levels[high] - self.levels[low]
                length = step * self.shop.pitch - self.shop.thickness
                if length > 0:
                    names = self.parts[low].name, self.parts[high].name
                    out.append(Spacer(pin.name, *names, length, step == 1))
        return tuple(out)

    def size(self, part: Part) -> tuple[float, float]:
        """Length and width of a part, mm."""
        z = part.corners * lists.lying(part)
        return float(np.ptp(np.real(z))) + self.shop.width, float(np.ptp(np.imag(z))) + self.shop.width

    def places(self, part: Part, pose: int) -> tuple[complex, complex]:
        """Origin and direction of a part in a pose: a place w of it is at ``origin + w direction``."""
        z = self.z[pose : pose + 1]
        origin = 0.0 if part.frame.origin is None else complex(z[0, part.frame.origin])
        return complex(origin), complex(part.frame.direction(z)[0])

    # -- tables -------------------------------------------------------------------------------------------------

    def mass(self, part: Part) -> float:
        """Of a plate, g; nan without a density."""
        density = np.nan if self.shop.density is None else self.shop.density
        return 1e-6 * density * self.shop.thickness * lists.area(part, self.shop)

    def rows(self) -> list[list[str]]:
        """Everything that has to be made or bought, equal pins and spacers in one row, under a header with units."""
        return lists.materials(self)

    def stacks(self) -> list[list[str]]:
        """What lies on each pin, from the ground plate upward, under a header with units."""
        return lists.stacking(self)

    def __str__(self) -> str:
        from jaxnc.synthesis.result import align_columns

        counts = {"pin": len(self.pins)}
        counts |= {k: sum(s.washer == (k == "washer") for s in self.spacers) for k in ("washer", "spacer")}
        head = f"{lists.plain(self.name)}: {len(self.parts)} plates of {mm(self.shop.thickness)} mm in {self.layers} "
        head += f"layer{'s' * (self.layers != 1)} on the ground plate, "
        head += ", ".join(f"{n} {kind}{'s' * (n != 1)}" for kind, n in counts.items())
        if self.shop.density is not None:
            head += f"; the plates weigh {sum(map(self.mass, self.parts)):.4g} g"
        return "\n".join([head, self.said, "", align_columns(self.rows()), "", align_columns(self.stacks())])

    __repr__ = __str__

    @property
    def said(self) -> str:
        """The clearance that remains, in a sentence."""
        more = (
            "; poses are far apart, and more of them may need fewer layers, or show more clearance"
            if self.unsure
            else ""
        )
        if not self.passing:
            return f"nothing passes anything else in a layer ({self.poses} poses, and between them){more}"
        p = self.passing[0]
        return (
            f"{p.one} and {p.other} come closest: {mm(round(p.clearance, 2))} mm stay between them, near pose "
            f"{p.pose:.4g} ({self.poses} poses looked at; the number holds between them too){more}"
        )

    # -- files --------------------------------------------------------------------------------------------------

    def draw(self, path: str | Path | None = None, pose: int = 0) -> "Figure":
        """Draw the stack in plan and from the side; see `jaxnc.viz.plates.draw_plates`."""
        from jaxnc.viz.plates import draw_plates

        return draw_plates(self, path, pose)

    def save(self, where: str | Path, formats: Sequence[str] = ("dxf", "svg")) -> Path:
        """Write drawings of all parts and the table of parts into a folder.

        Args:
            where: the folder; created if it is not there.
            formats: ``"dxf"`` (needs ezdxf), ``"svg"``, or both.

        Returns:
            The folder. In it there are for each part a file of its name, ``parts`` with all of them side by side and
            their names beside them, ``assembly`` with all of them in the first pose, at true scale in mm; the table
            ``parts.csv``, what lies on each pin in ``pins.csv``, both in ``parts.txt``; and the picture
            ``assembly.png``. Names of parts that are no names of files are changed until they are.

        Raises:
            InputError: an unknown format.
            OutputError: a file cannot be written; then none is.
            JaxncError: ezdxf is not installed.
        """
        formats = asked_formats(formats)
        from jaxnc.io.workshop import dxf, vector

        files: dict[str, bytes] = {}
        for ending, write in (("dxf", dxf.written), ("svg", vector.written)):
            if ending in formats:
                files |= {
                    f"{n}.{ending}": write(self, placed, title, n == "parts") for n, title, placed in self.sheets()
                }
        for name, table in (("parts.csv", self.rows()), ("pins.csv", self.stacks())):
            text = io.StringIO()
            csv.writer(text, lineterminator="\n").writerows(table)
            files[name] = text.getvalue().encode()
        files["parts.txt"] = f"{self}\n".encode()
        where = folder(where)
        with ExitStack() as stack:  # nothing is put in place before everything is written
            for name, content in files.items():
                stack.enter_context(replacing(where / name)).write_bytes(content)
            self.draw(stack.enter_context(replacing(where / "assembly.png")))
        return where

    def sheets(self) -> list[tuple[str, str, list[tuple[Part, complex, complex]]]]:
        """Files by name, each with its title and its parts with their origins and directions."""
        out, taken = [], {"parts", "assembly"}
        for part in self.parts:
            name = base = stem(part.name, "part")
            for k in itertools.count(2):
                if name not in taken:
                    break
                name = f"{base}-{k}"
            taken.add(name)
            out.append((name, part.name, [(part, 0j, lists.lying(part))]))
        side, row = [], 0.0
        for part in self.parts:
            turn = lists.lying(part)
            z = part.corners * turn
            low = complex(np.real(z).min(), np.imag(z).min()) - 0.5 * self.shop.width * (1 + 1j)
            side.append((part, complex(-low.real, row - low.imag), turn))
            row += self.size(part)[1] + self.shop.width
        whole = [(part, *self.places(part, 0)) for part in self.parts]
        return [*out, ("parts", self.name, side), ("assembly", self.name, whole)]


def asked_formats(formats: object) -> tuple[str, ...]:
    """Formats of drawings as a tuple, checked."""
    given = (formats,) if isinstance(formats, str) else formats
    if not isinstance(given, Sequence) or not given or any(f not in ("dxf", "svg") for f in given):
        raise InputError(f"to_parts(): formats={formats!r}; give 'dxf', 'svg' or both")
    return tuple(given)


def assembly(motion: Motion, **sizes: Any) -> Assembly:
    """Make a planar mechanism of plates, pins and spacers, stacked so that nothing collides over a motion.

    Links are plates of one thickness, rounded around their pins; a link with two pins is a bar, one with more the hull
    of them. A pin that slides does so in a slot; what slides without turning has a second pin in the slot. All stand on
    one side of a ground plate, layer 0. A pin is flush, and goes through all layers between its parts, with washers or
    spacers on it. Two parts in one layer, a part and a pin that goes through its layer, and spacers keep a clearance
    over the whole motion: between poses it is bounded by how far both leave straight lines, from twice their
    accelerations at both poses, and poses are added until it is certain.

    Args:
        motion: a motion of a planar mechanism, ``(T,)``; all of its poses must be right.
        **sizes: as of `Shop.of`.

    Returns:
        Parts, pins, layers, and the clearances that remain.

    Raises:
        InputError: a spatial mechanism, one pose, poses that failed, joints that plates do not make, sizes that leave
            no wall.
        AssemblyError: there is no such stack; the message names bodies and pins in the way.
    """
    outside(motion, "to_parts()")
    top = motion.system.topology
    if top.dim != 2:
        raise InputError(f"to_parts(): {top.name!r} is spatial; plates in layers are for planar mechanisms")
    status = np.asarray(motion.status)
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
    shop = Shop.of(top.length_unit, **sizes)
    z = points(motion, shop.unit)
    found = stock(motion, z, shop)
    return _stacked(motion, z, shop, found)


def _stacked(motion: Motion, z: np.ndarray, shop: Shop, found: Stock) -> Assembly:
    name = motion.system.topology.name
    parts, pins = found.parts, [p for p in found.pins if len(p.parts) > 1]
    for pin in pins:
        pin.parts.sort()
    gaps = _gaps(motion, z, shop, parts, pins, _in_slots(found, pins))
    close = gaps.touching(shop.clearance)
    for k in np.flatnonzero(close).tolist():
        if gaps.pairs[k].kind == "slot":
            one, other = _named(gaps.pairs[k], parts, pins)
            raise AssemblyError(
                f"to_parts(): {name!r}: {one} and {other} come too close in the slot that they share "
                f"({_worst(gaps, k)}); pins cannot pass each other there. Let it move less, or give one another guide"
            )
    shared = [p.parts for p in pins]
    rules = [
        Rule("parts", (i,), (j,), -1)
        for i, j in itertools.combinations(range(1, len(parts)), 2)
        if any(i in s and j in s for s in shared)
    ]
    for k in np.flatnonzero(close).tolist():
        pair = gaps.pairs[k]
        one = (pair.one,) if pair.kind == "parts" else tuple(pins[pair.one].parts)
        rules.append(Rule(pair.kind, one, tuple(pins[pair.other].parts) if pair.kind == "pins" else (pair.other,), k))
    most = shop.layers or len(parts) - 1
    search = Search(len(parts), rules, [tuple(p.parts) for p in pins])
    try:
        answer = search.fewest(min(most, len(parts) - 1))
    except TooMany:
        raise AssemblyError(f"to_parts(): no stack of {name!r} was found, nor is it shown that there is none") from None
    if answer is None:
        raise AssemblyError(_impossible(motion, shop, parts, pins, gaps, search, most))
    level = answer[0]
    only = np.array([_passes(pair, level, pins) for pair in gaps.pairs], dtype=bool)
    low, poses = gaps.least(only, shop.clearance)
    passing = [
        Passing(*_named(gaps.pairs[k], parts, pins), float(low[k]), float(poses[k]))
        for k in sorted(np.flatnonzero(only).tolist(), key=lambda k: low[k])
    ]
    count = len(np.unique(gaps.course.s))
    levels = tuple(level[k] for k in range(len(parts)))
    return Assembly(name, shop, tuple(parts), tuple(pins), levels, tuple(passing), count, z, gaps.unsure)


def _in_slots(found: Stock, pins: list[Pin]) -> list[tuple[int, int]]:
    """Pins that slide in one slot, and are not in holes of one part."""
    number = {id(pin): k for k, pin in enumerate(pins)}
    rigid = [{h.pin for h in part.holes} for part in found.parts]
    return [
        (number[id(found.pins[i])], number[id(found.pins[j])])
        for part in found.parts
        for slot in part.slots
        for i, j in itertools.combinations(sorted(set(slot.pins)), 2)
        if not any({i, j} <= held for held in rigid)
    ]


def _gaps(
    motion: Motion, z: np.ndarray, shop: Shop, parts: list[Part], pins: list[Pin], sliding: list[tuple[int, int]]
) -> Gaps:
    """Everything that might come close, over the course of the motion."""
    rows, corners = [], []
    for frame, places in [*((p.frame, p.corners) for p in parts), *((parts[p.part].frame, [p.at]) for p in pins)]:
        corners.append(np.arange(len(rows), len(rows) + len(places)))
        rows += [frame.row(complex(w), z.shape[1]) for w in places]
    weights, constant = np.array([r[0] for r in rows]), np.array([r[1] for r in rows])
    moving = range(1, len(parts))
    pairs, shapes = [], []

    def add(kind: str, one: int, other: int, first: int, second: int, radii: float) -> None:
        pairs.append(Pair(kind, one, other, radii))
        shapes.append((corners[first], corners[second]))

    for i, j in itertools.combinations(moving, 2):
        if not any(i in p.parts and j in p.parts for p in pins):
            add("parts", i, j, i, j, shop.width)
    for k, pin in enumerate(pins):
        for j in moving:
            if j not in pin.parts:
                add("pin and part", k, j, len(parts) + k, j, 0.5 * (shop.spacer + shop.width))
    for k, m in itertools.combinations(range(len(pins)), 2):
        add("pins", k, m, len(parts) + k, len(parts) + m, shop.spacer)
    for k, m in sliding:
        add("slot", k, m, len(parts) + k, len(parts) + m, shop.pin)
    return Gaps.of(Course.of(motion, weights, constant, shop.unit), pairs, shapes)


def _passes(pair: Pair, level: dict[int, int], pins: list[Pin]) -> bool:
    """Whether two things are in one layer, or one space between layers."""
    if pair.kind == "parts":
        return level[pair.one] == level[pair.other]
    if pair.kind == "slot":
        return True
    if pair.kind == "pins" and {*pins[pair.one].parts} & {*pins[pair.other].parts}:
        return False  # nothing passes: they are in one part, and were drilled far enough from each other
    mine = [level[p] for p in pins[pair.one].parts]
    if pair.kind == "pin and part":
        return min(mine) < level[pair.other] < max(mine)
    others = [level[p] for p in pins[pair.other].parts]
    return max(min(mine), min(others)) < min(max(mine), max(others))


def _named(pair: Pair, parts: list[Part], pins: list[Pin]) -> tuple[str, str]:
    one = parts[pair.one].name if pair.kind == "parts" else f"pin {pins[pair.one].name}"
    return one, f"pin {pins[pair.other].name}" if pair.kind in ("pins", "slot") else parts[pair.other].name


def _worst(gaps: Gaps, pair: int) -> str:
    """Where two things are closest, and how far they are apart there if they are."""
    ends = gaps.ends[..., pair].reshape(-1)
    at = int(ends.argmin())
    apart = f", {ends[at]:.3g} mm apart" if ends[at] > 0 else ""
    return f"pose {gaps.course.s.reshape(-1)[at]:.4g}{apart}"


def _impossible(
    motion: Motion, shop: Shop, parts: list[Part], pins: list[Pin], gaps: Gaps, search: Search, most: int
) -> str:
    """Why there is no stack, by the names of what is in the way."""
    name, needed = motion.system.topology.name, None
    if most < len(parts) - 1:
        try:
            needed = search.fewest(len(parts) - 1)
        except TooMany:
            needed = None
    said = []
    for rule in search.reasons(min(most, len(parts) - 1)):
        if rule.pair < 0:
            one, other = parts[rule.one[0]].name, parts[rule.other[0]].name
            pin = next(p.name for p in pins if rule.one[0] in p.parts and rule.other[0] in p.parts)
            said.append(f"{one} and {other} share pin {pin}")
            continue
        pair = gaps.pairs[rule.pair]
        one, other = _named(pair, parts, pins)
        where = _worst(gaps, rule.pair)
        if rule.kind == "parts":
            said.append(f"{one} and {other} come too close ({where}) and cannot lie in one layer")
        elif rule.kind == "pins":
            said.append(f"the spacers of {one} and {other} come too close ({where})")
        else:
            between = " and ".join(parts[p].name for p in rule.one)
            said.append(f"{one}, of {between}, is in the way of {other} ({where})")
    shown = "; ".join(said[:_NAMED]) + (f"; and {len(said) - _NAMED} more" if len(said) > _NAMED else "")
    if needed is not None:
        return (
            f"to_parts(): {name!r} needs {needed[1]} layers above its ground plate, layers={most} is too few: {shown}"
        )
    more = ""
    if gaps.unsure:
        more = " Between some poses it could not be looked at; a sweep with more poses may tell more."
    return (
        f"to_parts(): {name!r} cannot be stacked on one side of a ground plate: {shown}. Make links narrower or "
        f"spacers thinner (width={shop.width:g}, spacer={shop.spacer:g}, clearance={shop.clearance:g} mm), let it move "
        f"less, or move the points.{more}"
    )
