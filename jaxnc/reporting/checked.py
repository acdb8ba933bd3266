"""Checks of a mechanism before it is moved: whether it assembles, what may be driven and how far, what is odd.

Quantities of a motion are in the units that a person reads; with where they are extreme, and the forces that it takes.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import AssemblyError, InputError, counted
from jaxnc.io.drives import sweep_arguments
from jaxnc.io.drives import unit_of as unit_in_radians
from jaxnc.kinematics.arc import travel
from jaxnc.kinematics.diagnosis import Diagnosis, diagnose
from jaxnc.kinematics.freedoms import explain_lock, undriven_freedoms
from jaxnc.kinematics.inputs import doubtful_size
from jaxnc.kinematics.mobility import IDLE, Mobility
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position, sweep
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.reporting.verdict import Change, Counts, Drive, Finding, Reach, Verdict, number
from jaxnc.solvers.assembly import derive, free_plan, rank_of, sample_poses, settle
from jaxnc.status import Status
from jaxnc.system.identity import Thing
from jaxnc.system.system import System, characteristic_length, drivable
from jaxnc.system.topology import Topology
from jaxnc.types import Numbers

ZERO = 1e-9
"""Of the largest number of its kind: what is smaller is rounding, and is shown as zero."""


@public
@dataclass(frozen=True)
class Quantity:
    """A number in every pose.

    Attributes:
        label: what it is called.
        unit: its unit.
        values: its values, NaN where a pose failed, ``(T,)``.
        scale: how large such a quantity naturally is in this mechanism: what is far smaller is rounding.
        rate: whether it is a time derivative.
        parts: of a size the signed numbers that vanish where it does, ``(T, parts)``; its square is smooth there.
    """

    label: str
    unit: str
    values: np.ndarray
    scale: float
    rate: bool = False
    parts: np.ndarray | None = None


@dataclass(frozen=True)
class ExtremeValue:
    """A largest or smallest value."""

    value: float
    at: float  # pose at which it occurs, as a number that may lie between two poses
    refined: bool  # whether it lies between two poses


def quantities(motion: Motion, names: Sequence[str]) -> list[Quantity]:
    """List coordinates with their rates; of places coordinates and the sizes of velocity and acceleration."""
    good = np.asarray(motion.status) == 0
    found = []
    paces = [np.max(np.abs(motion.velocity(name))) / _natural(motion, name) for name in motion.driven if motion.rates]
    pace = float(max(paces, default=0.0))
    orders = [(motion.velocity, "v"), (motion.acceleration, "a")][: len(motion.rates)]
    for name in names:
        values, unit, factor = np.asarray(motion[name]), *unit_of(motion, name)
        scale = factor * _natural(motion, name)
        rates = [(np.asarray(read(name)), letter) for read, letter in orders]
        if values.ndim > 1:
            axes = "xyz"[: values.shape[-1]]
            found += [Quantity(f"{name}.{axis}", unit, values[:, k], scale) for k, axis in enumerate(axes)]
            sizes = [(np.linalg.norm(rate, axis=-1), f"|{letter}({name})|", rate) for rate, letter in rates]
        else:
            found.append(Quantity(name, unit, values * factor, scale))
            sizes = [(rate * factor, f"{letter}({name})", None) for rate, letter in rates]
        for (size, label, parts), per in zip(sizes, ("/s", "/s^2"), strict=False):
            scale *= pace
            found.append(Quantity(label, unit + per, size, scale, rate=True, parts=parts))
    return [replace(q, values=np.where(good, q.values, np.nan)) for q in found]


def unit_of(motion: Motion, name: str) -> tuple[str, float]:
    """Find the unit of a motion's quantity, and its factor; see `shown_in`."""
    return shown_in(motion.system.topology, name)


def shown_in(top: Topology, name: str) -> tuple[str, float]:
    """Find the unit in which a quantity is shown, and the factor that brings it there."""
    degrees = top.is_angle(name) and top.angle_unit == "deg"
    return ("deg", 180.0 / np.pi) if degrees else (top.unit(name), 1.0)


def course(motion: Motion) -> np.ndarray | None:
    """Find the numbers that poses are in order of, to refine between them: a single input, or else the time."""
    if len(motion.driven) == 1:
        return np.asarray(motion[motion.driven[0]], float).reshape(-1)
    return None if motion.time is None else np.asarray(motion.time, float).reshape(-1)


def extremes_of(
    motion: Motion, read: Callable[[Motion], Sequence[Quantity]]
) -> list[tuple[ExtremeValue, ExtremeValue]]:
    """Find the smallest and the largest value of each quantity that is read off a motion, between its poses too.

    Poses are solved where parabolas through three poses have their vertices, of each valley that may be the deepest,
    and again through the nearest poses there are by then; and where the parts of a size seem to go through zero. Where
    a motion is not driven by one input the vertex is all that is known; where it is not driven steadily, rates are
    those of its own poses. The least of a size whose parts go through zero between two poses is zero.
    """
    found, at, way = read(motion), np.arange(float(len(motion.status))), course(motion)
    lost = np.isin(np.asarray(motion.status), (0, Status.SINGULAR), invert=True)  # a motion goes on past change points
    for _ in range(6):
        vertices = [v for q in found for largest in (False, True) for v in _vertices_of(q, way, largest)]
        between = np.unique(
            [
                *np.interp(vertices, np.arange(len(at)), at).tolist(),
                *(zero for q in found if (zero := _way_through_zero(q, at, lost, guess=True)) is not None),
            ]
        )
        more = _solve_between(motion, between) if len(between) else None
        beyond = None if more is None else course(more)
        if more is None or way is None or beyond is None:
            break
        order = np.argsort(np.append(at, between), kind="stable")
        at, way = np.append(at, between)[order], np.append(way, beyond)[order]
        found = [_add_poses(q, new, order) for q, new in zip(found, read(more), strict=True)]
    added = len(at) > len(motion.status)  # then extreme values are those of poses
    ends = [[extreme_of(q, None if added else way, largest) for largest in (False, True)] for q in found]
    if added:
        ends = [[replace(e, at=float(at[int(e.at)]), refined=at[int(e.at)] % 1 > 0) for e in pair] for pair in ends]
    steady = added and _runs_steadily(motion)
    for q, pair in zip(found, ends, strict=True):  # a rate may jump where it is not driven steadily
        zero = _way_through_zero(q, at, lost) if steady or not q.rate else None
        pair[0] = pair[0] if zero is None else ExtremeValue(0.0, zero, True)
    return [(low, high) for low, high in ends]


def _add_poses(q: Quantity, more: Quantity, order: np.ndarray) -> Quantity:
    """Add poses to a quantity, in order."""
    values = np.append(q.values, more.values)[order]
    both = None if q.parts is None or more.parts is None else np.append(q.parts, more.parts, axis=0)[order]
    return replace(q, values=values, parts=both)


def _way_through_zero(q: Quantity, at: np.ndarray, lost: np.ndarray, guess: bool = False) -> float | None:
    """Find where the parts of a quantity go through zero between two poses, as a number of poses; None if nowhere.

    One part changes its sign. Of several the straight way from one pose to the next leads through zero, beside it.

    Args:
        q: the quantity.
        at: its poses, in order; they may lie between those of the motion.
        lost: whether the motion was lost at a pose of its own: nothing is known of the way past it.
        guess: find where several parts may go through zero, to look there.
    """
    known = np.isfinite(q.values)
    if q.parts is None or not known.any():
        return None
    parts, at = q.parts[known], at[known]
    largest = np.abs(parts).max(axis=0)
    parts = parts[:, largest > ZERO * largest.max()]
    a, step, size = parts[:-1], np.diff(parts, axis=0), np.linalg.norm(parts, axis=1)
    along = -(a * step).sum(axis=1) / np.maximum((step * step).sum(axis=1), 1e-300)
    through = (along > 0.0) & (along < 1.0) & (np.diff(np.searchsorted(np.flatnonzero(lost), at)) == 0)
    near, beside = np.linalg.norm(a + along[:, None] * step, axis=1), np.minimum(size[:-1], size[1:])
    if guess:
        through &= (near < 0.1 * beside) & (parts.shape[1] > 1)  # in a direction, to a tenth
    elif parts.shape[1] > 1:
        through &= (near <= ZERO * size.max()) & (beside <= 1e-3 * size.max())
    if not through.any():
        return None
    k = int(np.where(through, beside, np.inf).argmin())
    return float(at[k] + along[k] * (at[k + 1] - at[k]))


def _runs_steadily(motion: Motion) -> bool:
    """Tell whether the rates of a motion's one input are the same in all poses that were found."""
    at, good = motion.system.topology.position[motion.driven[0]], np.asarray(motion.converged)
    own = [np.asarray(rate)[good, at] for rate in motion.rates]
    return bool(good.any()) and all(np.ptp(rate) <= 1e-9 * np.max(np.abs(rate)) for rate in own)


def _solve_between(motion: Motion, at: np.ndarray) -> Motion | None:
    """Solve poses between those of a motion, ``(K,)``; None if it is not driven by one input.

    Rates that are not known between them, as they are where it is driven steadily, are NaN.
    """
    if len(motion.driven) != 1 or np.ndim(motion.status) != 1 or motion.conditioning is None:
        return None  # in a simulation forces move what the input leaves free
    (name,), poses, drive = motion.driven, np.arange(len(motion.status)), {}
    if motion.rates and _runs_steadily(motion):
        given = zip(("rates", "accelerations"), (motion.velocity, motion.acceleration), motion.rates, strict=False)
        drive = {order: {name: float(read(name)[0])} for order, read, _ in given}
    start, values = motion.pose(np.round(at).astype(int)), np.interp(at, poses, np.asarray(motion[name], float))
    found = solve_position(
        motion.system, {name: values}, start=start, hold=motion.held, throw=False, unit="rad", **drive
    )
    lacking = [np.full(found.q.shape, np.nan) for _ in motion.rates[len(found.rates) :]]
    return replace(found, rates=(*found.rates, *lacking))


def _vertices_of(q: Quantity, along: np.ndarray | None, largest: bool) -> list[float]:
    """Find where a quantity may be larger, or smaller, than in all poses, as numbers of poses.

    That is at the vertex of a parabola through a pose that exceeds its neighbours, or the first or last three poses,
    if twice as much as it exceeds these would make it the extreme one: parabolas tell that so well.
    """
    if along is None or len(along) < 3 or constant(q.values):
        return []
    height = _height(q, largest)
    y = np.where(np.isfinite(height), height, -np.inf)
    tops = 1 + np.flatnonzero((y[1:-1] >= y[:-2]) & (y[1:-1] >= y[2:]))
    out, tops = [], tops[np.argsort(-y[tops], kind="stable")][:16]  # of rounding alone there are many
    for k in {1, len(y) - 2, *tops.tolist()}:
        found = _vertex(height, along, k)
        if found is not None and 2.0 * found.value - y[k - 1 : k + 2].max() > y.max():
            out.append(found.at)
    return out


def _height(q: Quantity, largest: bool) -> np.ndarray:
    """Turn a quantity so that its extreme value is on top; a size squared, as it is smooth then where it vanishes."""
    return (1.0 if largest else -1.0) * (q.values if q.parts is None else q.values**2)


def extreme_of(q: Quantity, along: np.ndarray | None, largest: bool) -> ExtremeValue:
    """Find the largest or smallest of a quantity's values, NaN where a pose failed; not all of them.

    It is refined by a parabola over the input, or the time, if that is given as `along`, of a size by one through its
    squares; otherwise it is that of a pose.
    """
    height = _height(q, largest)
    k = int(np.nanargmax(height))
    found = ExtremeValue(float(height[k]), k, False)
    if along is not None and not constant(q.values) and 0 < k < len(height) - 1:
        found = _vertex(height, along, k) or found
    value = found.value if largest else -found.value
    return replace(found, value=value if q.parts is None else max(value, 0.0) ** 0.5)


def _vertex(y: np.ndarray, along: np.ndarray, k: int) -> ExtremeValue | None:
    """Find the top of the parabola through a pose and its neighbours, if it lies between these, not in a pose."""
    u, step = along[k - 1 : k + 2] - along[k], y[k - 1 : k + 2] - y[k]
    # The parabola b u + c u² through the neighbours of a pose that is put at the origin.
    width = u[0] * u[2] * (u[0] - u[2])
    if not (np.isfinite(step).all() and u[0] * u[2] < 0):
        return None
    b = (step[2] * u[0] ** 2 - step[0] * u[2] ** 2) / width
    c = (step[0] * u[2] - step[2] * u[0]) / width
    if not c < 0.0:
        return None
    vertex = -b / (2.0 * c)
    if np.abs(vertex - u).min() < 1e-6 * abs(u[2] - u[0]) or not min(u[0], u[2]) < vertex < max(u[0], u[2]):
        return None
    at = k + float(vertex / (u[2] if vertex * u[2] > 0 else -u[0]))
    return ExtremeValue(float(y[k] - b * b / (4.0 * c)), at, True)


def constant(values: np.ndarray) -> bool:
    """Tell whether a quantity does not vary, up to rounding."""
    return float(np.nanmax(values) - np.nanmin(values)) <= ZERO * float(np.nanmax(np.abs(values)))


def _natural(motion: Motion, name: str) -> float:
    """Choose the natural size of a coordinate: a radian, a unit vector, or the size of the mechanism."""
    top = motion.system.topology
    if top.is_angle(name) or top.is_direction(name):
        return 1.0
    return float(characteristic_length(motion.system.parameters.points))


# -- forces -----------------------------------------------------------------------------------------------------------


@public
@dataclass(frozen=True)
class Peak:
    """The largest force or moment that something exerts on a body.

    Attributes:
        on: the body.
        by: what exerts it.
        force: its largest size, N.
        moment: the largest moment about the body's centre of mass.
        pose: where the force is largest.
    """

    on: str
    by: str
    force: float
    moment: float
    pose: int


@public
@dataclass(frozen=True)
class Forces:
    """Forces of a motion.

    Attributes:
        motion: with the rates that they are of.
        resting: whether no rates were given, so that every pose is held at rest.
        efforts: of the inputs, one each.
        power: of all of them together; None at rest, and where nothing is driven.
        peaks: the largest first.
    """

    motion: Motion
    resting: bool
    efforts: tuple[Quantity, ...]
    power: Quantity | None
    peaks: tuple[Peak, ...]


def forces(motion: Motion) -> Forces | None:
    """Find efforts and reactions of a sweep; None where nothing has a mass, or no pose was found.

    Without rates every pose is held at rest: gravity, springs and the like alone act.
    """
    good = np.asarray(motion.converged)
    if not motion.system.topology.loads.inertias or not good.any() or motion.system.topology.rates:
        return None
    resting = len(motion.rates) < 2
    if resting:
        still = dict.fromkeys(motion.driven, 0.0)
        motion = sweep(motion.system, dict(motion.inputs), rates=still, hold=motion.held, throw=False)
    from jaxnc.dynamics.reactions import inverse_dynamics

    found = inverse_dynamics(motion.system, motion)
    top = motion.system.topology

    def make(label: str, kind: str, values: Numbers) -> Quantity:
        values = np.where(good, np.asarray(values), np.nan)
        return Quantity(label, top.load_unit(kind), values, float(np.nanmax(np.abs(values))))

    columns = zip((*motion.driven, *motion.held), np.asarray(found.efforts).T, strict=True)
    efforts = tuple(
        make(f"effort {name}", "moment" if top.is_angle(name) else "force", values) for name, values in columns
    )
    power = make("power", "power", found.power) if efforts and not resting else None
    peaks = sorted(_peaks(found.reactions.all(), good), key=lambda p: -p.force)
    return Forces(motion, resting, efforts, power, tuple(peaks[:24]))  # peaks of forces that are listed


def _peaks(wrenches: dict, good: np.ndarray) -> Iterator[Peak]:
    """Find the largest of every wrench over the poses that were found."""
    found = []
    for body, some in wrenches.items():
        for by, wrench in some.items():
            if by == "weight":
                continue
            force = np.where(good, np.linalg.norm(np.asarray(wrench.force), axis=-1), 0.0)
            moment = np.asarray(wrench.moment)
            moment = np.abs(moment) if moment.ndim == 1 else np.linalg.norm(moment, axis=-1)
            turns = float(np.where(good, moment, 0.0).max())
            found.append(Peak(body, by, float(force.max()), turns, int(force.argmax())))
    size = max((p.force for p in found), default=0.0)
    most = max((p.moment for p in found), default=0.0)
    yield from (p for p in found if p.force > ZERO * size or p.moment > ZERO * most)


# -- checks ------------------------------------------------------------------------------------------------------------


def parts(mechanism: Mechanism) -> Iterator[str]:
    """List the parts of a mechanism, kind by kind."""
    m = mechanism.model
    for many, noun, plural in (
        (len(m.ground), "ground point", ""),
        (len(m.points), "point", ""),
        (len(m.ground_vectors), "ground vector", ""),
        (len(m.vectors), "vector", ""),
        (len(m.markers), "marker", ""),
        (len(m.bodies), "body", "bodies"),
        (len(m.joints), "joint", ""),
        (len(m.angles), "angle", ""),
        (len(m.distances), "distance", ""),
        (len(m.relations), "relation", ""),
        (len(m.constraints), "own constraint", ""),
    ):
        if many:
            yield counted(many, noun, plural)


def count(verdict: Verdict, system: System, found: Mobility) -> None:
    """Enter the mobility of a mechanism: its counts and freedoms."""
    top = system.topology
    verdict.name, verdict.length_unit, verdict.angle_unit = top.name, top.length_unit, top.angle_unit
    verdict.counts = Counts(
        points=len(top.points),
        bodies=len(top.bodies),
        joints=len(top.joints),
        unknowns=found.n,
        equations=found.rows,
        rank=found.rank,
        freedoms=found.dof,
        grubler=found.grubler,
        redundant=list(found.redundant),
        overconstrained=found.overconstrained,
    )
    verdict.assembles = not found.conflicting
    verdict.drivable = list(drivable(top)) if found.dof > 0 and verdict.assembles else []
    if found.conflicting:
        return
    verdict.moves = found.dof > 0
    if found.overconstrained:
        verdict.add(
            "overconstrained",
            "note",
            f"overconstrained: {found.overconstrained} of its rows fit together only for its special dimensions",
            names=list(found.redundant),
        )
    elif found.redundant:
        verdict.add("redundant", "note", "rows that follow from others", names=list(found.redundant))
    for name in found.idle:
        verdict.add("loose", "warning", f"{name} {IDLE}", names=[name])
    for text in found.loose if top.dim == 3 else ():  # in the plane `oddities` finds it
        verdict.add("loose", "note", text)
    if found.momentary:
        verdict.add("singular", "note", "the drawn pose is singular: further rows lose their independence there")


def apart(verdict: Verdict, found: Diagnosis) -> None:
    """Enter why a mechanism does not assemble, and what would mend it."""
    at = (found.system and found.system.topology.write_values(found.inputs)) or "its drawing"
    verdict.add(
        "does-not-assemble",
        "error",
        f"{found.name} does not assemble at {at}; the closest pose leaves a gap of {found.gap:.3g}",
        names=[v.row for v in found.violations],
        remedies=[Change(dimension=r.dimension, value=r.value, becomes=r.value + r.change) for r in found.remedies],
    )


def assembly(verdict: Verdict, system: System) -> Diagnosis:
    """Diagnose the drawing of a mechanism, and enter whether it assembles and if not why."""
    found = diagnose(system)
    verdict.assembles = found.assembles
    if not found.assembles:
        apart(verdict, found)
        verdict.does = False
    return found


def locking_parts(system: System) -> list[str]:
    """Find bodies and joints of a structure without one of which it could move, by name."""
    if system.topology.large:
        return []
    top, view = system.topology, free_plan(system.topology)
    best = max(sample_poses(system, 1), key=lambda sample: sample.rank)
    owners = [top.row_owners[i] for i in view.rows]
    out = []
    for owner in sorted({o for some in owners for o in some if o.thing is not Thing.COORDINATE}):
        kept = np.array([set(some) != {owner} for some in owners])
        if not kept.all() and rank_of(np.asarray(best.jacobian)[kept])[0] < len(view.unknown):
            out.append(top.called(owner))
    return out


def problems(mechanism: Mechanism, system: System) -> list[Finding]:
    """Find what keeps the run section from being carried out: inputs that do not fit, ends that are out of reach."""
    if not mechanism.model.run.inputs:
        return []
    asked = list(mechanism.model.run.inputs)
    if system.degrees_of_freedom == 0:
        text = f"run.inputs: {', '.join(asked)} cannot be driven, it has no degree of freedom"
        return [Finding(code="cannot-be-driven", level="error", text=text, names=asked)]
    arguments = sweep_arguments(mechanism)
    ends = {name: values[[0, -1]] for name, values in arguments["inputs"].items()}
    try:
        found = solve_position(system, ends, hold=arguments["hold"], throw=False)
    except InputError as error:
        return [Finding(code="cannot-be-driven", level="error", text=f"run.inputs: {error}", names=asked)]
    out = []
    for i, end in enumerate(("first", "last")):
        status = Status(int(found.status[i]))
        if status:
            at = ", ".join(
                f"{name} = {values[i] / unit_in_radians(mechanism, name):.6g} {_unit(mechanism, name)}"
                for name, values in ends.items()
            )
            text = f"run.inputs: the {end} pose, {at}, is not found. {status.sentence}"
            out.append(Finding(code="not-found", level="error", text=text, names=asked))
    return out


def reach(system: System, name: str, hold: Sequence[str]) -> Reach:
    """Find how far an input goes from the drawing, in the mechanism's unit."""
    found = travel(system, name, tuple(hold))
    unit, factor = shown_in(system.topology, name)
    return Reach(
        name=name,
        unit=unit,
        lower=None if found.turns else number(found.lower * factor),
        upper=None if found.turns else number(found.upper * factor),
        turns=found.turns,
        dead_points=sorted({round(d.value * factor, 12) for d in found.dead_points}),
        followed=found.followed,
    )


def travels(mechanism: Mechanism, system: System, verdict: Verdict) -> Iterator[str]:
    """Enter how far a single input of the run section can go, an error if the run asks for more, and describe it."""
    run = mechanism.model.run
    if len(run.inputs) != 1:
        return
    name = next(iter(run.inputs))
    try:
        found = reach(system, name, run.hold)
    except (AssemblyError, InputError) as error:
        text = f"limits of {name} are not known: {error}"
        verdict.add("not-known", "note", text, names=[name])
        yield text
        return
    verdict.reach.append(found)
    if found.turns:
        yield f"{name} turns fully, without a dead point"
    if found.turns or (found.lower is None and found.upper is None):
        return
    limits = [found.no_limit if v is None else f"{v:.10g}" for v in (found.lower, found.upper)]
    yield f"{name} can go from {limits[0]} to {limits[1]} {found.unit}, limits being dead points"
    if run.analysis == "circuit":
        return
    drive = run.inputs[name]
    slack = 1e-9 * abs(drive.end - drive.start)
    low = -np.inf if found.lower is None else found.lower
    high = np.inf if found.upper is None else found.upper
    if min(drive.start, drive.end) < low - slack or max(drive.start, drive.end) > high + slack:
        asked = f"{drive.start:g} to {drive.end:g}"
        text = f"run.inputs: {name} is asked for from {asked}, beyond these limits; the run will stop there"
        verdict.add("beyond-limits", "error", text, names=[name])


def drives(mechanism: Mechanism, run: record.Run) -> list[Drive]:
    """List the inputs that a run section drives."""
    return [
        Drive(name=n, unit=_unit(mechanism, n), first=d.start, last=d.end, poses=d.poses, rate=d.rate)
        for n, d in run.inputs.items()
    ]


def oddities(system: System, mechanism: Mechanism | None = None) -> Iterator[Finding]:
    """Find what is allowed but probably not meant."""
    top = system.topology
    if doubt := doubtful_size(system):
        yield Finding(code="doubtful-size", level="warning", text=doubt)
    blocks = (*top.blocks, *top.loads.forces)
    tied = {p for block in blocks for points in block.points for p in points}
    used = {v for block in blocks for vectors in block.vectors for v in vectors}
    places = np.array(top.fixed[: len(top.coordinates) - len(top.scalars)]).reshape(-1, top.dim)
    fixed = np.logical_and.reduce(places, axis=1)
    still = () if mechanism is None else mechanism.model.ground_vectors
    held = [*(i in tied for i in range(len(top.points))), *(i in used for i in range(len(top.vectors)))]
    for i, name in enumerate((*top.points, *top.vectors)):
        if not held[i] and not fixed[i] and name not in still:
            noun = "point" if i < len(top.points) else "vector"
            text = f"{noun} {name!r} is in no body, joint, coordinate or force; nothing holds it"
            yield Finding(code="loose", level="warning", text=text, names=[name])
    # Such as the centre of a spherical linkage, and a line whose direction a body keeps.
    tied |= {p for body in top.bodies for p in (*body.points, *(k for s in body.segments for k in s))}
    ground = {name for i, name in enumerate(top.points) if fixed[i] and i not in tied}
    if ground := sorted(ground if mechanism is None else ground & set(mechanism.model.ground)):
        text = f"nothing is attached to ground {', '.join(ground)}"
        yield Finding(code="unused", level="warning", text=text, names=ground)
    pose, home = np.asarray(settle(derive(system), np.zeros(len(top.coordinates))).q), np.asarray(derive(system).home)
    moved = np.abs(pose - home)[: len(top.points) * top.dim].reshape(-1, top.dim).max(axis=1)
    # 0.02 of the mechanism's size: a drawing that is moved further to assemble is worth a warning
    if moved.max(initial=0.0) > 0.02 * float(characteristic_length(system.parameters.points)):
        name = top.points[int(moved.argmax())]
        text = (
            f"the drawing does not fit its dimensions: to assemble, {name!r} is moved by {moved.max():.3g} "
            f"{top.length_unit}; draw it there, or check the lengths"
        )
        yield Finding(code="drawing-does-not-fit", level="warning", text=text, names=[name])
    if system.degrees_of_freedom == 0:
        text = "nothing moves: leave out a body or a joint, or do not fix a point, if it should"
        yield Finding(code="does-not-move", level="warning", text="; ".join([text, *explain_lock(system)]))
    elif mechanism is not None and not mechanism.model.run.inputs:
        text = "it has no table [run.inputs], so `jaxnc run` needs --input"
        yield Finding(code="nothing-driven", level="warning", text=text)
        for text in undriven_freedoms(system):
            yield Finding(code="loose", level="warning", text=text)


def _unit(mechanism: Mechanism, name: str) -> str:
    units = mechanism.model.units
    return units.angle if name in mechanism.model.angle_names else units.length
