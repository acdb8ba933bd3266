"""`circuits`: all assemblies over the range of an input, joined up into branches and circuits.

A branch is what the input drives the mechanism along, from one dead point to another or to an end of the range. A
circuit is what can be reached without taking the mechanism apart: branches that meet at dead points within the range.
"""

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy.sparse.csgraph import connected_components

from jaxnc.calls import public
from jaxnc.doors import door
from jaxnc.errors import InputError, counted
from jaxnc.kinematics.host_solve import solve_lanes
from jaxnc.kinematics.inputs import check_inputs, check_system
from jaxnc.kinematics.modes import MOST, Design, Family, Targets, prepare, to_motion
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position
from jaxnc.notebooks import Reported
from jaxnc.process import one_thread
from jaxnc.solvers.host import HostView
from jaxnc.solvers.host.curve import turning_point
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.precision import widened
from jaxnc.system.system import System
from jaxnc.types import Inputs

_SAME = 1e-5  # of the mechanism's size: poses that are one


@public
@dataclasses.dataclass(frozen=True)
class Branch:
    """A part of a circuit along which the input goes one way.

    Attributes:
        circuit: which circuit it belongs to, from 0, the drawing's first.
        poses: its poses at the values of the input that it has, in their order.
        lower: smallest value of the input there: that of the dead point at its end, or an end of the range.
        upper: the largest one.
        dead: whether the lower and the upper end is a dead point.
        turns: whether the branch closes: the input turns on and on.
    """

    circuit: int
    poses: Motion
    lower: float
    upper: float
    dead: tuple[bool, bool]
    turns: bool


@public
@dataclasses.dataclass(frozen=True, repr=False)
class Circuits(Reported):
    """All assemblies over a range of an input; ``len()`` counts the circuits, ``print()`` says what they are.

    Attributes:
        name: the input.
        values: its values, ``(values,)``: those asked for, but for a part of a step where assemblies meet at one.
        branches: all branches, those of the drawing's circuit first.
        count: number of assemblies at each value, ``(values,)``.
        drawn: number of the drawing's circuit, 0; None if the drawing is on none of them.
        dead_points: values of the input at which branches meet, in ascending order.
        doubtful: number of values at which paths were lost, solutions are not isolated, or a branch ends alone.
        angle: whether the input is an angle.
    """

    name: str
    values: np.ndarray
    branches: tuple[Branch, ...]
    count: np.ndarray
    drawn: int | None
    dead_points: tuple[float, ...]
    doubtful: int
    angle: bool

    def __len__(self) -> int:
        return 1 + max((b.circuit for b in self.branches), default=-1)

    def circuit(self, number: int) -> tuple[Branch, ...]:
        """The branches of a circuit.

        Args:
            number: which one, from 0.

        Returns:
            The branches, in the order of their lower ends.

        Raises:
            InputError: there is no such circuit.
        """
        if not 0 <= number < len(self):
            raise InputError(f"circuit({number}): they are numbered from 0, and there are {len(self)}")
        return tuple(b for b in self.branches if b.circuit == number)

    def __str__(self) -> str:
        def told(value: float) -> str:
            return f"{math.degrees(value):.6g}°" if self.angle else f"{value:.6g}"

        lines = []
        for k in range(len(self)):
            parts = self.circuit(k)
            ends = sorted({b.lower for b in parts if b.dead[0]} | {b.upper for b in parts if b.dead[1]})
            whose = "the drawing's" if k == self.drawn else f"circuit {k}"
            text = f"{whose} has {counted(len(parts), 'branch', 'branches')}"
            if ends:
                where = ", ".join(map(told, ends))
                text += f", which {'meet' if len(parts) > 1 else 'ends'} at {self.name} = {where}"
            elif all(b.turns for b in parts):
                text += f", {self.name} turns fully"
            lines.append(text)
        least, most = (int(self.count.min()), int(self.count.max())) if len(self.count) else (0, 0)
        range_ = f"{self.name} from {told(self.values[0])} to {told(self.values[-1])}"
        number = counted(most, "assembly", "assemblies") if least == most else f"{least} to {most} assemblies"
        head = f"{counted(len(self), 'circuit')}; {'; '.join(lines)}" if lines else "no assembly"
        text = f"{head}. {range_}: {number}."
        if self.drawn is None and lines:
            text += " The drawing is on none of them."
        if self.doubtful:
            text += (
                f" At {counted(self.doubtful, 'value')} solutions are not isolated, paths were lost, or a branch ends "
                f"alone: take smaller steps there, or other values."
            )
        return text

    def draw(self, path: object = None, **options: Any):
        """Draw the branches over the input; see `jaxnc.viz.draw_circuits`."""
        return door("Circuits.draw")(self, path, **options)


@public
@widened
def circuits(
    system: System,
    inputs: Inputs,
    hold: Sequence[str] = (),
    unit: str | None = None,
    seed: int = 0,
    most: int = MOST,
) -> Circuits:
    """Find every assembly over a range of an input, and which can be reached from which without taking apart.

    Args:
        system: the system.
        inputs: values of one driven coordinate in ascending order, by name, and one number of every other one; radians
            and lengths. Two branches are told apart, and joined, from value to value: 2° of a crank is a good step.
        hold: free coordinates that keep the value they have in the drawing.
        unit: what angles are given in, ``"rad"`` or ``"deg"``.
        seed: as of `modes`.
        most: as of `modes`.

    Returns:
        Branches and circuits. A circuit that closes outside of the range only counts as several.

    Raises:
        InputError: no array or several, fewer than two values or not ascending ones, and what `modes` refuses.
    """
    one_thread("numpy")
    check_system(system, "circuits()")
    view, values, _ = check_inputs(system, inputs, hold, unit)
    names, values, shape = tuple(inputs), np.asarray(values, float), values.shape[:-1]
    moving = [n for n in names if np.ndim(inputs[n])]
    if len(moving) != 1 or len(shape) != 1 or shape[0] < 2:
        raise InputError(
            f"circuits() follows one input over its values, such as {{{(names or ('phi',))[0]!r}: "
            f"np.linspace(0, 2 * np.pi, 181)}}, and takes one number of every other; got "
            f"{len(moving)} arrays{f' of shape {shape}' if shape else ''}"
        )
    k = names.index(moving[0])
    if not (np.diff(values[:, k]) > 0.0).all():
        raise InputError(f"circuits(): the values of {moving[0]!r} must ascend, each one greater than the one before")
    design, family = prepare(system, tuple(map(int, view.driven)), tuple(map(int, view.held)), seed, most)
    angle = system.topology.is_angle(moving[0])
    range_ = _Range(view, design, family, values, k, seed).beside_crossings(angle)
    found = _join(range_, angle)
    motion = functools.partial(to_motion, system, view)
    return _report(system, range_, found, motion, moving[0], inputs, hold, angle)


class _Range(Targets):
    """A mechanism over the values of an input, the k-th one."""

    def __init__(self, view: Plan, design: Design, family: Family, values: np.ndarray, k: int, seed: int):
        super().__init__([design], family, tuple(map(int, view.driven)), values, seed)
        self.view, self.design, self.k = view, design, k
        # Ends of the range that were moved: side, place among the values, what was asked, and how many assemblies are
        # fewer behind it.
        self.ends: list[tuple[str, int, float, int]] = []

    @functools.cached_property
    def free(self) -> HostView:
        """The mechanism with nothing driven, and everything held that is given but the input."""
        top, given = self.design.reading.top, self.design.reading.inputs
        return HostView(plan(top, (), top.named(c for c in given if c != self.order[self.k])), self.design.host)

    def beside_crossings(self, angle: bool) -> "_Range":
        """Move values at which assemblies meet: there nobody can tell which is which, and beside them each is single.

        A range of whole turns is moved as a whole if its ends are such values.
        """
        part = 0.38  # of a step: crossings at round values are at round parts of it
        values, last = self.values[:, self.k], len(self.values) - 1
        doubtful = np.array([place.doubtful for place in self.places])
        turns = (values[last] - values[0]) / (2.0 * np.pi)
        if angle and abs(turns - round(turns)) < 1e-9 and (doubtful[0] or doubtful[last]):
            moved = self.values.copy()
            moved[:, self.k] += part * (values[1] - values[0])
            return _Range(self.view, self.design, self.family, moved, self.k, self.seed).beside_crossings(False)
        which = np.flatnonzero(doubtful)
        if len(which):
            step = part * np.where(which < last, np.append(np.diff(values), 0.0)[which], values[-2] - values[-1])
            beside = []
            for sign in (1.0, -1.0):
                moved = self.values[which]
                moved[:, self.k] += sign * step
                beside.append(_Range(self.view, self.design, self.family, moved, self.k, self.seed))
            for k, at in enumerate(which):
                place, behind = (some.places[k] for some in beside)
                if place.doubtful:
                    continue
                if at in (0, last):
                    fewer = place.w.shape[1] - behind.w.shape[1]
                    self.ends.append(("end" if at else "start", int(at), float(values[at]), fewer))
                self.values[at], self.places[at] = beside[0].values[k], place
        return self

    def connect(self) -> list[np.ndarray]:
        """For every value but the last: which assembly at the next each one becomes, -1 for none."""
        counts = [p.w.shape[1] for p in self.places[:-1]]
        step = np.repeat(np.arange(len(counts)), counts)
        if not len(step):
            return [step] * len(counts)
        start = np.concatenate([p.q for p in self.places[:-1]], axis=1)
        found = solve_lanes(self.view, self.design.host, start.T, self.values[step + 1], np.arange(len(step)))
        out = np.full(len(step), -1)
        for lane in np.flatnonzero(found.size <= self.free.least.close * self.free.eq.length):
            mode = self.mode_of(int(step[lane]) + 1, found.q[lane])
            out[lane] = -1 if mode is None else mode
        return np.split(out, np.cumsum(counts)[:-1])

    def mode_of(self, k: int, q: np.ndarray) -> int | None:
        """Say which of the assemblies at a value a pose ``(N,)`` is; None if it is none of them."""
        size, unit = self.design.reading.first, self.design.unit[:, None]
        apart = np.abs((self.places[k].q[:size] - q[:size, None]) / unit[:size]).max(axis=0, initial=0.0)
        return int(apart.argmin()) if len(apart) and apart.min() < _SAME else None

    def dead_point(self, low: float, high: float, one: np.ndarray, two: np.ndarray) -> tuple[float, float] | None:
        """Value of the input in a range at which two assemblies ``(N,)`` become one; None if they do not turn there.

        With it comes how far the pose there is from the middle between the two, against how far these are apart.
        """
        change, at = two - one, self.free.plan.unknown
        angles = self.design.reading.first + np.flatnonzero(self.design.reading.top.angles)
        change[angles] -= 2.0 * np.pi * np.round(change[angles] / (2.0 * np.pi))
        along, place = change[at] * self.free.inner, at.tolist().index(self.order[self.k])
        slack = 1e-6 * (high - low)
        for part in (0.5, 0.0, 1.0):  # from the middle, where it may be another one, from each of the two
            pose, left = turning_point(self.free, place, one + part * change, along / np.linalg.norm(along))
            value = float(pose[self.order[self.k]])
            if low - slack <= value <= high + slack and left <= self.free.least.close * self.free.eq.length:
                off = (pose - one)[: self.design.reading.first] - 0.5 * change[: self.design.reading.first]
                return value, float(np.linalg.norm(off) / np.linalg.norm(change[: self.design.reading.first]))
        return None


@dataclasses.dataclass
class _Strand:
    """Assemblies at values one after another that are one branch."""

    first: int
    modes: list[int]
    start: float | None = None  # the dead point at its begin, if there is one
    end: float | None = None
    turns: bool = False

    @property
    def last(self) -> int:
        return self.first + len(self.modes) - 1


def _join(range_: _Range, angle: bool) -> tuple[list[_Strand], list[int]]:
    """Strands, and which circuit each belongs to."""
    steps = range_.connect()
    strands: list[_Strand] = []
    joined: list[tuple[int, int]] = []

    def begin(first: int, mode: int) -> int:
        strands.append(_Strand(first, [mode]))
        return len(strands) - 1

    def meet(some: list[int], side: str, at: int, low: float, high: float, most: int) -> None:
        """Join strands that end, or begin, at one dead point: those between which it lies."""
        place = range_.places[at]
        modes = {s: strands[s].modes[at - strands[s].first] for s in some}
        pairs = itertools.combinations(some, 2)
        apart = {(a, b): np.abs(place.w[:, modes[a]] - place.w[:, modes[b]]).max(initial=0.0) for a, b in pairs}
        found = []
        for pair in sorted(apart, key=lambda pair: apart[pair])[: 3 * len(some)]:  # the nearest, if they are many
            point = range_.dead_point(low, high, *(place.q[:, modes[s]] for s in pair))
            if point is not None and point[1] < 1.0:
                found.append((point[1], pair, point[0]))
        left = {*some}
        for _, pair, value in sorted(found):
            if left >= {*pair} and most > 0:
                left -= {*pair}
                most -= 1
                joined.append(pair)
                for s in pair:
                    setattr(strands[s], side, value)

    here = {m: begin(0, m) for m in range(range_.places[0].w.shape[1])}
    for k, step in enumerate(steps):
        then: dict[int, int] = {}
        ended = []
        for mode, strand in here.items():
            to = int(step[mode])
            if to >= 0 and to not in then:
                then[to] = strand
                strands[strand].modes.append(to)
            else:
                ended.append(strand)
        begun = []
        for mode in range(range_.places[k + 1].w.shape[1]):
            if mode not in then:
                then[mode] = begin(k + 1, mode)
                begun.append(then[mode])
        low, high = range_.values[k : k + 2, range_.k]
        meet(ended, "end", k, low, high, len(ended))
        meet(begun, "start", k + 1, low, high, len(begun))
        here = then
    for side, at, asked, fewer in range_.ends:
        some = [k for k, s in enumerate(strands) if (s.first if side == "start" else s.last) == at]
        value = range_.values[at, range_.k]
        meet(some, side, at, min(asked, value), max(asked, value), fewer // 2)
    if angle:
        joined += _close(range_, strands)
    graph = np.zeros((len(strands), len(strands)))
    graph[tuple(np.array(joined, int).reshape(-1, 2).T)] = 1.0
    return strands, connected_components(graph, directed=False)[1].tolist()


def _close(range_: _Range, strands: list[_Strand]) -> Iterator[tuple[int, int]]:
    """Join what is a whole turn behind something to that: pairs of strands; and say which branches close."""
    values, turn = range_.values[:, range_.k], 2.0 * np.pi
    last = len(values) - 1
    strand_of = {(s.first + k, mode): number for number, s in enumerate(strands) for k, mode in enumerate(s.modes)}
    # A pose of each strand, amid those that the range has a turn earlier, and the value next to it there.
    amid = [[k for k in range(s.first, s.last + 1) if values[k] - turn >= values[0] - 1e-9] for s in strands]
    begun = [(number, some[len(some) // 2]) for number, some in enumerate(amid) if some]
    if not begun:
        return
    near = [int(np.abs(values - values[k] + turn).argmin()) for _, k in begun]
    start = np.stack([range_.places[k].q[:, strands[n].modes[k - strands[n].first]] for n, k in begun], axis=1)
    start[range_.order[range_.k]] -= turn
    found = solve_lanes(range_.view, range_.design.host, start.T, range_.values[near], np.arange(len(near)))
    for lane, ((number, _), k) in enumerate(zip(begun, near, strict=True)):
        mode = range_.mode_of(k, found.q[lane])
        if mode is not None:
            yield number, strand_of[k, mode]
    turned = (values[last] - values[0]) / turn
    if turned > 0.5 and abs(turned - round(turned)) < 1e-9:
        # A branch over the whole range turns if it goes on, a turn later, as one that turns.
        next_one: dict[int, int | None] = {}
        for number, s in enumerate(strands):
            if s.first == 0 and s.last == last and s.start is None and s.end is None:
                mode = range_.mode_of(0, range_.places[last].q[:, s.modes[-1]])
                next_one[number] = None if mode is None else strand_of[0, mode]
        while ended := [number for number, after in next_one.items() if after not in next_one]:
            for number in ended:
                del next_one[number]
        for number in next_one:
            strands[number].turns = True


def _report(system, range_: _Range, found, motion, name: str, inputs: Inputs, hold, angle: bool) -> Circuits:
    """Branches in order, the drawing's circuit first."""
    strands, roots = found
    drawn = _drawn(system, range_, strands, inputs, hold, angle)
    order: dict[int, int] = {} if drawn is None else {roots[drawn]: 0}
    for r in roots:
        order.setdefault(r, len(order))
    values, reading = range_.values[:, range_.k], range_.design.reading
    points: list[float] = []
    for point in sorted({s for strand in strands for s in (strand.start, strand.end) if s is not None}):
        # Found from several branches it is one dead point still.
        if not points or point - points[-1] > 1e-9 * (values[-1] - values[0]):
            points.append(point)

    def limit(value: Any, dead_point: float | None) -> float:
        return float(value if dead_point is None else min(points, key=lambda point: abs(point - dead_point)))

    branches = []
    for strand, r in zip(strands, roots, strict=True):
        which = range(strand.first, strand.last + 1)
        places = [(range_.places[k], m) for k, m in zip(which, strand.modes, strict=True)]
        q = np.stack([p.q[:, m] for p, m in places], axis=1)
        if angle:  # angles that only follow go on along a branch
            turning = np.concatenate([np.zeros(reading.first, bool), reading.top.angles]) & reading.follows
            q[turning] = np.unwrap(q[turning])
        gap, condition = (np.array([getattr(p, what)[m] for p, m in places]) for what in ("gap", "condition"))
        poses = motion(range_.values[strand.first : strand.last + 1], q, np.zeros(len(places), int), gap, condition)
        ends = limit(values[strand.first], strand.start), limit(values[strand.last], strand.end)
        dead = (strand.start is not None, strand.end is not None)
        turns = strand.turns and not any(dead)
        branches.append(Branch(order[r], poses, *ends, dead, turns))
    branches.sort(key=lambda b: (b.circuit, b.lower))
    count = np.array([p.w.shape[1] for p in range_.places])
    doubtful = sum(p.doubtful for p in range_.places)
    for s in strands:  # ends that found no other to meet: steps are too long there
        doubtful += (s.start is None and s.first > 0) + (s.end is None and s.last < len(values) - 1)
    return Circuits(name, values, tuple(branches), count, None if drawn is None else 0, tuple(points), doubtful, angle)


def _drawn(system: System, range_: _Range, strands: list[_Strand], inputs: Inputs, hold, angle: bool) -> int | None:
    """Which strand the drawing is on, when its input is brought to a value near it; None if on none."""
    drawn = range_.design.pose[range_.order[range_.k]]
    values = range_.values[:, range_.k]
    # A range may lie whole turns away from the drawing.
    away = angle and not values[0] <= drawn <= values[-1]
    turns = 2.0 * np.pi * np.round((values - drawn) / (2.0 * np.pi)) if away else np.zeros(len(values))
    near = np.argsort(np.abs(values - turns - drawn) + 1e-9 * np.abs(turns), kind="stable")
    for k in near[:4]:  # the nearest may be behind a dead point
        at = range_.values[k] - turns[k] * (np.arange(len(range_.values[k])) == range_.k)
        asked = {n: float(v) for n, v in zip(inputs, at, strict=True)}
        pose = solve_position(system, asked, hold=hold, throw=False)
        if int(pose.status) != 0:
            continue
        mode = range_.mode_of(int(k), np.asarray(pose.q, float))
        if mode is not None:
            return next(i for i, s in enumerate(strands) if s.first <= k <= s.last and s.modes[k - s.first] == mode)
    return None
