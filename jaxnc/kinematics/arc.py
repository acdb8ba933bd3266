"""Following a motion by arc length, through dead points; limits of travel of an input."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from jaxnc.calls import public
from jaxnc.constraints import DISTANCE_BETWEEN
from jaxnc.errors import AssemblyError, InputError
from jaxnc.kinematics.inputs import (
    check_system,
    dense_only,
    doubt_degrees,
    finite_array,
    in_radians,
    make_plan,
    whole,
)
from jaxnc.kinematics.motion import Motion, motion_of
from jaxnc.kinematics.polynomial import circuits_hint
from jaxnc.kinematics.position import solve_position, start_of
from jaxnc.notebooks import Reported
from jaxnc.solvers.assembly import derive, meets
from jaxnc.solvers.host import HostView
from jaxnc.solvers.host.curve import LONGEST, TracedCurve, first_tangent, step_along, trace_curve, turns_along
from jaxnc.solvers.plan import plan
from jaxnc.status import Status
from jaxnc.system.host import from_jax
from jaxnc.system.precision import widened
from jaxnc.system.system import System
from jaxnc.types import Inputs


@public
@dataclass(frozen=True)
class DeadPoint:
    """A pose in which an input turns back.

    Attributes:
        value: value of the input there.
        kind: ``"maximum"`` or ``"minimum"`` of the input.
        pose: the pose.
    """

    value: float
    kind: str
    pose: Motion


@public
@dataclass(frozen=True)
class Interval:
    """A part of a circuit between two dead points, or an end that was not reached.

    Attributes:
        lower: smallest value of the input there, or -inf.
        upper: largest value, or inf.
        drawn: whether the drawing lies in it.
    """

    lower: float
    upper: float
    drawn: bool


@public
@dataclass(frozen=True, repr=False)
class Travel(Reported):
    """How far an input can go from the drawing, along the drawing's circuit; ``str()`` is a report.

    Between two dead points the input goes one way; where a circuit has several such intervals, `lower` and `upper` are
    those of the drawing's, and `intervals` says which the others are.

    Attributes:
        name: the input.
        lower: its smallest value before it must turn back, or -inf.
        upper: its largest value before it must turn back, or inf.
        turns: whether it comes round to the same pose without turning back (a crank).
        dead_points: every dead point of the circuit, in the order in which they are met.
        closed: whether the whole circuit was followed.
        intervals: all of them, in the order in which the circuit passes them, the drawing's first; where it was not
            followed to its end, from one end to the other.
        system: the system, for its drawing.
        ends: its values where the motion ends without turning back, since rows have no derivative there.
    """

    name: str
    lower: float
    upper: float
    turns: bool
    dead_points: tuple[DeadPoint, ...]
    closed: bool
    intervals: tuple[Interval, ...] = ()
    system: System | None = field(default=None, repr=False, compare=False)
    ends: tuple[float, ...] = ()

    @property
    def followed(self) -> bool:
        """Tell whether the motion was followed until it came round, or to both of its ends."""
        return self.closed or len(self.ends) > 1

    def _write(self, value: float, digits: int = 12) -> str:
        if self.system is None:
            return f"{value:.{digits}g}"
        return self.system.topology.write_value(self.name, value, digits)

    def __str__(self) -> str:
        if self.turns:
            return f"{self.name} turns fully: no dead point on its circuit"
        if not self.dead_points and not self.ends:
            return f"{self.name}: no dead point found within {LONGEST:g} sizes of the mechanism along its motion"
        digits = 9 if self.ends else 12  # an end is found by ever shorter steps
        write = self._write
        lines = [f"{self.name} travels from {write(self.lower, digits)} to {write(self.upper, digits)}"]
        lines += [f"  dead point, {d.kind} at {self.name} = {write(d.value)}" for d in self.dead_points]
        lines += [f"  ends at {self.name} = {write(end, 9)}: rows have no derivative there" for end in self.ends]
        if len({(round(i.lower, 9), round(i.upper, 9)) for i in self.intervals}) > 1:
            lines.append("  the circuit passes these intervals in turn, each as the next pose of the one before:")
            for k, one in enumerate(self.intervals, 1):
                drawn = ", the drawing's" if one.drawn else ""
                lines.append(f"    {k}: {self.name} from {write(one.lower)} to {write(one.upper)}{drawn}")
        if not self.followed:
            lines.append(f"  the circuit was not followed to its end (it is longer than {LONGEST:g} sizes)")
        if self.system is not None and (hint := circuits_hint(self.system, [self.name])):
            lines.append(f"  {hint}")
        return "\n".join(lines)


@public
@widened
def travel(system: System, name: str, hold: Sequence[str] = (), start: Motion | Inputs | None = None) -> Travel:
    """Find the dead points and limits of travel of an input.

    The drawing's circuit is followed by arc length with nothing driven; where the input turns back, the dead point is
    solved for, to rounding.

    Args:
        system: a system of one freedom once `hold` is applied.
        name: the input.
        hold: coordinates that keep their start value.
        start: an earlier pose, or places by name, instead of the drawing.

    Returns:
        Limits and dead points.

    Raises:
        InputError: unknown name, or a number of inputs that does not fit.
        AssemblyError: the start pose does not assemble.
    """
    check_system(system, "travel")
    dense_only(system.topology, "travel")
    view, q = _prepare(system, (name,), hold, start)
    index = system.topology.position[name]
    place = int(np.flatnonzero(view.plan.unknown == index)[0])
    curve = _whole_curve(view, q)
    drawn = curve.s.index(0.0)
    values = np.array([q[index] for q in curve.q])
    if np.ptp(values) <= 1e-9 * (1.0 if system.topology.mark(system.topology.angles)[index] else view.eq.length):
        raise InputError(f"travel: {name!r} of {system.name!r} stays {values[0]:.6g} along the whole motion")
    back = turns_along(view, curve, place)
    line = [(float(x), "maximum" if up else "minimum") for x, up in zip(back.q[index], back.rising, strict=True)]
    behind = int(np.sum(back.s < 0.0))  # how many of them lie behind the drawing
    turns = not line and curve.closed
    top, least = system.topology, -np.inf
    if name in top.scalars and top.blocks[top.measures[top.scalars.index(name)][0]].kind is DISTANCE_BETWEEN:
        least = 0.0  # of two points' distance: its mirror image is no motion of it
    (first, rising), (last, on) = ((float(curve.q[k][index]), curve.t[k][place] > 0) for k in (0, -1))
    begin = [(first, "minimum" if rising else "maximum")] * curve.stuck[0]
    end = [(last, "maximum" if on else "minimum")] * curve.stuck[1]
    intervals = _intervals([*begin, *line, *end], behind + len(begin), curve.closed, least)
    # What lies behind an end is none.
    intervals = intervals[len(begin) : len(intervals) - len(end)]
    steady = abs(curve.t[drawn][place]) > 1e-9
    own = next((i for i in intervals if i.drawn), None) if steady or curve.closed else None
    lower, upper = (least, np.inf) if own is None else (own.lower, own.upper)
    all_poses = _pose(system, (name,), hold, back.q.T) if line else None
    met = [k for k in (*range(behind, len(line)), *range(behind - 1, -1, -1)) if line[k][0] >= least]
    found = [DeadPoint(*line[k], all_poses.pose(k)) for k in met] if all_poses is not None else []
    ends = tuple(value for value, _ in (*begin, *end))
    return Travel(name, lower, upper, turns, tuple(found), curve.closed, intervals, system, ends)


def _intervals(dead: list[tuple[float, str]], behind: int, closed: bool, least: float) -> tuple[Interval, ...]:
    """List the intervals between dead points in their order, of which so many lie behind the drawing."""

    def between(points: Sequence[tuple[float, str]], drawn: bool) -> Interval:
        lower = [value for value, kind in points if kind == "minimum"]
        upper = [value for value, kind in points if kind == "maximum"]
        return Interval(max([least, *lower]), min(upper, default=np.inf), drawn)

    if not dead:
        return ()
    if closed:
        return tuple(between((dead[k - 1], dead[k]), k == 0) for k in range(len(dead)))
    ends = [dead[max(k - 1, 0) : k + 1] for k in range(len(dead) + 1)]
    return tuple(between(points, k == behind) for k, points in enumerate(ends))


@public
@widened
def circuit(
    system: System,
    name: str,
    between: tuple[float, float] | None = None,
    poses: int = 361,
    hold: Sequence[str] = (),
    start: Motion | Inputs | None = None,
    unit: str | None = None,
) -> Motion:
    """Follow the circuit of a mechanism of one freedom through its dead points, by arc-length continuation.

    Nothing is driven: the motion's input is a result, and turns back at dead points. The mechanism goes round until the
    circuit closes; one that does not is followed both ways, to sixty sizes of the mechanism.

    Args:
        system: a system of one freedom once `hold` is applied.
        name: a coordinate that is shown as the input.
        between: values of it, an angle or a length: followed from the pose at the first one, in the direction of the
            second, until the circuit closes or leaves the range; the whole circuit of the start pose if not given.
        poses: how many, equally spaced in arc length.
        hold: coordinates that keep their start value.
        start: an earlier pose, or places by name, instead of the drawing.
        unit: what angles are given in, ``"rad"`` or ``"deg"``.

    Returns:
        The poses, in order. Not differentiable.

    Raises:
        InputError: unknown name, another number of freedoms, a range that is none, or fewer than two poses.
        AssemblyError: the first pose does not assemble.
    """
    check_system(system, "circuit()")
    dense_only(system.topology, "circuit()")
    poses = whole(poses, "circuit(): poses=, how many are wanted,", 2, 10**8)
    given = {} if between is None else {name: finite_array(between, "circuit(): between")}
    if any(ends.shape != (2,) for ends in given.values()):
        raise InputError(f"circuit(): between={between!r}; give the input's first and last value, such as (0.2, 1.4)")
    doubt_degrees(system, unit, given, start)
    ends, start = in_radians(system, unit, given, start)
    if between is None:
        view, q = _prepare(system, (name,), hold, start)
        nodes = _whole_curve(view, q)
    else:
        first, last = map(float, ends[name])
        begin = solve_position(system, {name: first}, start=start, hold=hold, throw=False, unit="rad")
        if int(begin.status) not in (Status.CONVERGED, Status.SINGULAR):  # it may begin at a dead point
            solve_position(system, {name: first}, start=start, hold=hold, throw=True, unit="rad")
        view, q = _prepare(system, (name,), hold, begin)
        index = system.topology.position[name]
        t = first_tangent(view, q)
        if t[np.flatnonzero(view.plan.unknown == index)[0]] * (np.sign(last - first) or 1.0) < 0:
            t = -t
        nodes = trace_curve(view, q, t, (index, min(first, last), max(first, last)))
    s = np.array(nodes.s)
    wanted = np.linspace(s[0], s[-1], poses)
    at = np.clip(np.searchsorted(s, wanted, side="right") - 1, 0, len(s) - 1)
    found = step_along(view, np.array(nodes.q)[at].T, np.array(nodes.t)[at].T, wanted - s[at]).q.T
    return _pose(system, (name,), hold, np.ascontiguousarray(found))


def _whole_curve(view: HostView, q: np.ndarray) -> TracedCurve:
    """All of the curve through a pose; one that does not close, from one end to the other."""
    t = first_tangent(view, q)
    ahead = trace_curve(view, q, t)
    if ahead.closed:
        return ahead
    behind = trace_curve(view, q, -t)
    s, turned = [-s for s in behind.s[:0:-1]] + ahead.s, [-t for t in behind.t[:0:-1]]
    stuck = behind.stuck[1], ahead.stuck[1]
    return TracedCurve(behind.q[:0:-1] + ahead.q, turned + ahead.t, s, stuck=stuck)


def _prepare(system: System, names, hold, start) -> tuple[HostView, np.ndarray]:
    make_plan(system, names, hold)  # the same checks of names and counts as a sweep
    eq = derive(system)
    held = (hold,) if isinstance(hold, str) else tuple(hold)
    q = np.asarray(start_of(system, eq, start, held))
    view = HostView(plan(system.topology, (), held), from_jax(eq))
    size = float(np.max(np.abs(view.eq.residual(q[:, None])), initial=0.0))
    if not meets(eq, q, size):
        raise AssemblyError(
            f"{system.name!r}: the start pose does not assemble (gap {size:.3g}); jaxnc.diagnose(system) says why"
        )
    return view, q


def _pose(system: System, names, hold, q: np.ndarray) -> Motion:
    """A motion of poses ``(T, N)`` found without driving anything."""
    inner = HostView(make_plan(system, names, hold), from_jax(derive(system)))
    sizes = np.max(np.abs(inner.eq.residual(q.T)), axis=0, initial=0.0)
    status = np.where(sizes <= inner.tolerance(q.T), int(Status.CONVERGED), int(Status.DID_NOT_ASSEMBLE))
    return motion_of(system, inner.plan, q, q[:, inner.plan.driven], status, sizes, inner.conditioning(q.T))
