"""Following a motion by arc length, through dead points; limits of travel of an input."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.constraints import DISTANCE_BETWEEN
from jaxnc.errors import AssemblyError, InputError
from jaxnc.kinematics.inputs import check_parameters, check_system, make_plan
from jaxnc.kinematics.large import dense_only
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position, start_of
from jaxnc.solvers.assembly import derive
from jaxnc.solvers.curve import correct, first_tangent, turning_point
from jaxnc.solvers.newton import tolerance
from jaxnc.solvers.plan import Plan, plan
from jaxnc.status import Status
from jaxnc.system.equations import Equations, residual, weights
from jaxnc.system.precision import widened
from jaxnc.system.system import System

_LONGEST = 60.0  # sizes of the mechanism: a longer curve is taken for unbounded
_MOST = 20000  # steps


@dataclass
class _Curve:
    """Nodes of a traced curve: poses, tangents and arc length; whether it closed."""

    q: list[np.ndarray] = field(default_factory=list)
    t: list[np.ndarray] = field(default_factory=list)
    s: list[float] = field(default_factory=list)
    closed: bool = False

    def add(self, q, t, step: float) -> None:
        """Append a node `step` further along."""
        self.q.append(np.asarray(q))
        self.t.append(np.asarray(t))
        self.s.append(self.s[-1] + step)


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


@dataclass(frozen=True)
class Travel:
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
    """

    name: str
    lower: float
    upper: float
    turns: bool
    dead_points: tuple[DeadPoint, ...]
    closed: bool
    intervals: tuple[Interval, ...] = ()

    def __str__(self) -> str:
        if self.turns:
            return f"{self.name} turns fully: no dead point on its circuit"
        if not self.dead_points:
            return f"{self.name}: no dead point found within {_LONGEST:g} sizes of the mechanism along its motion"
        lines = [f"{self.name} travels from {self.lower:.12g} to {self.upper:.12g}"]
        lines += [f"  dead point, {d.kind} at {self.name} = {d.value:.15g}" for d in self.dead_points]
        if len({(round(i.lower, 9), round(i.upper, 9)) for i in self.intervals}) > 1:
            lines.append("  the circuit passes these intervals in turn, each as the next pose of the one before:")
            for k, one in enumerate(self.intervals, 1):
                drawn = ", the drawing's" if one.drawn else ""
                lines.append(f"    {k}: {self.name} from {one.lower:.12g} to {one.upper:.12g}{drawn}")
        if not self.closed:
            lines.append(f"  the circuit was not followed to its end (it is longer than {_LONGEST:g} sizes)")
        return "\n".join(lines)


@widened
def travel(
    system: System, name: str, hold: Sequence[str] = (), start: Motion | Mapping[str, Any] | None = None
) -> Travel:
    """Find the dead points and limits of travel of an input.

    The drawing's circuit is followed by arc length with nothing driven; where the input turns back, the dead point is
    solved for (to rounding), not bisected.

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
    view, eq, q = _prepare(system, (name,), hold, start)
    index = system.topology.position[name]
    place = int(np.flatnonzero(view.unknown == index)[0])
    forward = _trace(view, eq, q, first_tangent(view, eq, q), None)
    pieces = [(forward, 1.0)]
    if not forward.closed:
        pieces.append((_trace(view, eq, q, -first_tangent(view, eq, q), None), -1.0))
    found: list[DeadPoint] = []
    limits = {"maximum": np.inf, "minimum": -np.inf}
    steady = all(abs(c.t[0][place]) > 1e-9 for c, _ in pieces)
    ahead = 0  # how many of them lie ahead
    for curve, way in pieces:
        first = True
        for a in range(len(curve.s) - 1):
            ta, tb = curve.t[a][place], curve.t[a + 1][place]
            if ta == 0.0 or ta * tb >= 0.0:
                continue
            near = a if abs(ta) < abs(tb) else a + 1
            x, left = turning_point(view, index, eq, jnp.asarray(curve.q[near]), jnp.asarray(curve.t[near]))
            if float(left) > 1e-8 * float(eq.length):
                continue
            kind = "maximum" if ta > 0 else "minimum"
            value = float(x[index])
            found.append(DeadPoint(value, kind, _pose(system, (name,), hold, x)))
            if first and steady:
                limits[kind] = min(limits[kind], value) if kind == "maximum" else max(limits[kind], value)
            ahead += way > 0
            first = False
    if forward.closed and found:
        # Going round once meets the limit ahead first and the limit behind last.
        limits = {"maximum": np.inf, "minimum": -np.inf}
        for dead in (found[0], found[-1]):
            limits[dead.kind] = dead.value
    turns = not found and forward.closed
    positive = (
        system.topology.blocks[system.topology.measures[system.topology.scalars.index(name)][0]].kind
        is (DISTANCE_BETWEEN)
        if name in system.topology.scalars
        else False
    )
    if positive:  # the distance between two points: its mirror image on the negative side is no motion of it
        limits["minimum"] = max(limits["minimum"], 0.0)
    values = [(d.value, d.kind) for d in found]
    intervals = _intervals(values, ahead, forward.closed, 0.0 if positive else -np.inf)
    return Travel(name, limits["minimum"], limits["maximum"], turns, tuple(found), forward.closed, intervals)


def _intervals(dead: list[tuple[float, str]], ahead: int, closed: bool, least: float) -> tuple[Interval, ...]:
    """What lies between dead points, given as met: those ahead, then those behind the drawing, the nearest first."""

    def between(points: Sequence[tuple[float, str]], drawn: bool) -> Interval:
        lower = [value for value, kind in points if kind == "minimum"]
        upper = [value for value, kind in points if kind == "maximum"]
        return Interval(max(lower, default=least), min(upper, default=np.inf), drawn)

    if not dead:
        return ()
    if closed:
        return tuple(between((dead[k - 1], dead[k]), k == 0) for k in range(len(dead)))
    line = [*reversed(dead[ahead:]), *dead[:ahead]]
    behind = len(dead) - ahead
    ends = [line[max(k - 1, 0) : k + 1] for k in range(len(line) + 1)]
    return tuple(between(points, k == behind) for k, points in enumerate(ends))


@widened
def sweep_arc(
    system: System,
    names: Sequence[str],
    values: Any,
    rates: Any,
    hold: Sequence[str],
    start: Motion | Mapping[str, Any] | None,
) -> Motion:
    """The sweep of method ``"arc"``: from the first input value along the curve, through dead points.

    Poses are equally spaced in arc length, as many as the input array has values, from its first value until the curve
    closes or leaves the range of the values. Not differentiable; outside of traced code only.

    Raises:
        InputError: more than one input, rates, or traced values.
        AssemblyError: the first pose does not assemble.
    """
    if len(names) != 1:
        raise InputError(f"method='arc' follows one input, got {len(names)}: hold the others with hold=[...]")
    if rates is not None:
        raise InputError("method='arc' drives no input, so it has no rates; leave rates= out")
    if isinstance(values, Tracer):
        raise InputError("method='arc' works outside of traced code only (jit, vmap, grad); use 'continuation' there")
    values = np.asarray(values)[:, 0]
    name, total = names[0], len(values)
    if start is not None and not isinstance(start, Motion):
        first = solve_position(system, {name: values[0]}, guess=start, hold=hold, throw=True)
    else:
        first = solve_position(system, {name: values[0]}, hold=hold, throw=True)
    view, eq, q = _prepare(system, (name,), hold, first)
    index = system.topology.position[name]
    place = int(np.flatnonzero(view.unknown == index)[0])
    t = first_tangent(view, eq, q)
    ahead = np.sign(values[-1] - values[0]) or 1.0
    if float(t[place]) * ahead < 0:
        t = -t
    low, high = float(values.min()), float(values.max())
    curve = _trace(view, eq, q, t, (index, low, high))
    s = np.array(curve.s)
    wanted = np.linspace(0.0, s[-1], total)
    at = np.clip(np.searchsorted(s, wanted, side="right") - 1, 0, len(s) - 1)
    q_nodes, t_nodes = jnp.asarray(np.array(curve.q)), jnp.asarray(np.array(curve.t))
    poses = jax.vmap(lambda a, h: correct(view, eq, q_nodes[a], t_nodes[a], h)[0])(
        jnp.asarray(at), jnp.asarray(wanted - s[at])
    )
    return _pose(system, (name,), hold, poses)


def _prepare(system: System, names, hold, start) -> tuple[Plan, Equations, Any]:
    dense_only(system.topology, 'method="arc"')
    make_plan(system, names, hold)  # the same checks of names and counts as a sweep
    check_parameters(system)
    eq = derive(system)
    q = start_of(system, eq, start)
    held = (hold,) if isinstance(hold, str) else tuple(hold)
    view = plan(system.topology, (), held)
    size = float(jnp.max(jnp.abs(residual(eq, q)), initial=0.0))
    if size > 1e3 * float(tolerance(eq, q)):
        raise AssemblyError(
            f"{system.name!r}: the start pose does not assemble (gap {size:.3g}); jaxnc.diagnose(system) says why"
        )
    return view, eq, q


def _trace(view: Plan, eq: Equations, q: Any, t: Any, within: tuple[int, float, float] | None) -> _Curve:
    """Follow a curve until it closes, leaves a range of one coordinate, or grows too long."""
    top = eq.topology
    size = float(eq.length)
    points = len(top.points) * top.dim
    h, shortest = 0.02 * size, 1e-9 * size
    limit = float(tolerance(eq, q)) * 10
    curve = _Curve([np.asarray(q)], [np.asarray(t)], [0.0])
    w = np.asarray(weights(eq))[view.unknown]
    leaving = False
    for _ in range(_MOST):
        x, new, r, moved = correct(view, eq, q, t, jnp.asarray(h))
        turn = float(jnp.dot(t, new))
        if not (float(r) <= limit and float(moved) <= 0.2 * h and turn > 0.97):
            h *= 0.5
            if h < shortest:
                break
            continue
        was, now = np.asarray(q), np.asarray(x)
        if within is not None:
            index, low, high = within
            u, v = was[index], now[index]
            if ((v > high + 1e-12 or v < low - 1e-12) and len(curve.s) > 1) or (v < low - 1e-9 or v > high + 1e-9):
                edge = high if v > high else low
                reach = (edge - u) / (v - u) * h if v != u else 0.0
                for _ in range(6):  # secant steps to land on the edge of the range
                    x, new, *_ = correct(view, eq, q, t, jnp.asarray(reach))
                    slope = (float(x[index]) - u) / reach if reach > shortest else 0.0
                    reach = reach + (edge - float(x[index])) / slope if slope else reach
                if reach > shortest:
                    x, new, *_ = correct(view, eq, q, t, jnp.asarray(reach))
                    curve.add(x, new, reach)
                break
        begin = curve.q[0][:points]
        gap_now = np.linalg.norm(now[:points] - begin)
        if leaving and gap_now < 1.5 * h:
            # Close to the beginning: land on it exactly if the curve goes through it.
            back = (curve.q[0] - was)[view.unknown] * w
            is_scalar = view.unknown >= points
            angle = np.zeros(len(top.coordinates), dtype=bool)
            angle[len(top.coordinates) - len(top.scalars) :] = top.angles
            turns = angle[view.unknown] & is_scalar
            back[turns] -= 2 * np.pi * size * np.round(back[turns] / (2 * np.pi * size))
            reach = float(back @ np.asarray(t))
            if 0 <= reach <= 1.2 * h:
                y, ty, *_ = correct(view, eq, q, t, jnp.asarray(reach))
                if (
                    np.linalg.norm(np.asarray(y)[:points] - begin) < 1e-3 * size
                    and float(np.dot(np.asarray(ty), curve.t[0])) > 0.9
                ):
                    curve.add(y, ty, reach)
                    curve.closed = True
                    return curve
        leaving = leaving or gap_now > 3 * h
        q, t = x, new
        curve.add(now, new, h)
        if curve.s[-1] > _LONGEST * size:
            break
        h = min(1.4 * h, 0.05 * size)
    return curve


def _pose(system: System, names, hold, q: Any) -> Motion:
    """A motion of poses found without driving anything."""
    view = make_plan(system, names, hold)
    eq = derive(system)
    flat = jnp.reshape(q, (-1, q.shape[-1]))
    sizes = jax.vmap(lambda x: jnp.max(jnp.abs(residual(eq, x)), initial=0.0))(flat)
    pivots = jax.vmap(lambda x: view.conditioning(eq, view.linearise(eq, x)[1]))(flat)
    good = sizes <= jax.vmap(lambda x: tolerance(eq, x))(flat)
    status = jnp.where(good, int(Status.CONVERGED), int(Status.DID_NOT_ASSEMBLE))
    shape = q.shape[:-1]
    return Motion(
        system,
        tuple(names),
        view.held,
        q,
        (),
        q[..., np.array([system.topology.position[n] for n in names])],
        status.reshape(shape),
        sizes.reshape(shape),
        pivots.reshape(shape),
    )
