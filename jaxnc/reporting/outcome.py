"""Outcome of a motion, entered into a verdict: poses, extremes, expectations, a simulation, a suspension's numbers."""

import operator
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from jaxnc.errors import InputError
from jaxnc.io.drives import SweepArguments
from jaxnc.io.drives import unit_of as unit_in_radians
from jaxnc.kinematics.arc import circuit
from jaxnc.kinematics.diagnosis import Diagnosis, diagnose
from jaxnc.kinematics.inputs import METRES
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position, sweep
from jaxnc.mechanism import Mechanism
from jaxnc.reporting.checked import ZERO, Quantity, apart, extremes_of, quantities, unit_of
from jaxnc.reporting.transmission import transmission_quantities
from jaxnc.reporting.verdict import (
    Expectation,
    Extreme,
    Poses,
    Simulated,
    Verdict,
    Wheel,
    WheelNumber,
    number,
    parse_expectation,
)
from jaxnc.solvers.assembly import derive
from jaxnc.status import Status
from jaxnc.system.system import System, characteristic_length
from jaxnc.vehicle.hardpoints import RACK, usual
from jaxnc.vehicle.report import SuspensionReport, suspension_report
from jaxnc.viz.poses import poses
from jaxnc.viz.quantities import quantity

if TYPE_CHECKING:
    from jaxnc.dynamics.simulation import Simulation

_HOLDS = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
CROSSING = "Branches cross there: places are known to half of the digits, rates are not, and tables leave them blank."

_RACK_TRAVEL, _RACK_POSES = 60e-3, 41  # how far the rack is moved either way, metres, and in how many poses


def outputs_of(motion: Motion, named: Sequence[str] = ()) -> list[str]:
    """Choose what to report: what is named, else coordinates and markers, else points that move."""
    if named:
        return list(named)
    top, driven = motion.system.topology, motion.driven
    moving = [p for i, p in enumerate(top.points) if not all(top.fixed[i * top.dim : (i + 1) * top.dim])]
    chosen = [s for s in top.scalars if s not in driven] + [m.name for m in top.markers]
    return (chosen or moving)[:6]  # 6 quantities are reported where none is named


def idle(q: Quantity, scale: float) -> bool:
    """Tell whether a quantity is a rate that is always zero: then its position, which is constant, tells it all."""
    return q.rate and bool((np.abs(q.values[np.isfinite(q.values)]) <= ZERO * scale).all())


def scales_of(found: Sequence[Quantity]) -> dict[str, float]:
    """Find the largest number of each unit."""
    scales: dict[str, float] = {}
    for q in found:
        scales[q.unit] = max(scales.get(q.unit, q.scale), float(np.nanmax(np.abs(q.values), initial=0.0)))
    return scales


def inputs_at(motion: Motion, pose: float) -> dict[str, float]:
    """Find the inputs at a pose, or between two, in the units a person reads; the time where nothing is driven."""
    if not motion.driven and motion.time is not None:
        time = np.asarray(motion.time, float)
        return {"time": float(np.interp(pose, np.arange(len(time)), time))}
    at = {}
    for name in motion.driven:
        values = np.asarray(motion[name], float).reshape(-1) * unit_of(motion, name)[1]
        value = float(np.interp(pose, np.arange(len(values)), values))
        at[name] = 0.0 if abs(value) <= ZERO * np.ptp(values) else value
    return at


def extremes(motion: Motion, names: Sequence[str]) -> list[Extreme]:
    """Find where quantities are smallest and largest, and how large."""

    def tell(motion: Motion) -> list[Quantity]:
        return [q for q in quantities(motion, names) if q.label in told]

    found = quantities(motion, names)
    scales, out = scales_of(found), []
    found = [q for q in found if np.isfinite(q.values).any() and not idle(q, scales[q.unit])]
    told = {q.label for q in found}
    for q, ends in zip(found, extremes_of(motion, tell), strict=True):
        low, high = (0.0 if abs(e.value) <= ZERO * scales[q.unit] else e.value for e in ends)
        first, last = (inputs_at(motion, e.at) for e in ends)
        made = Extreme(quantity=q.label, unit=q.unit, smallest=low, smallest_at=first, largest=high, largest_at=last)
        out.append(made)
    return out


def carry_out(system: System, analysis: str, arguments: SweepArguments) -> Motion:
    """Move a system as the analysis of a run section asks; poses that failed have a status."""
    inputs = arguments["inputs"]
    if analysis != "circuit":
        return (solve_position if analysis == "solve_position" else sweep)(system, throw=False, **arguments)
    if len(inputs) != 1:
        raise InputError(f"a circuit is that of one input, got {', '.join(inputs)}: hold the others")
    name, values = next(iter(inputs.items()))  # nothing is driven along a circuit, so that it has no rates
    return circuit(system, name, (values[0], values[-1]), len(values), arguments["hold"])


def enter(verdict: Verdict, motion: Motion, outputs: Sequence[str]) -> None:
    """Enter the outcome of a motion: its poses, and its extremes."""
    top = motion.system.topology
    verdict.name, verdict.length_unit, verdict.angle_unit = top.name, top.length_unit, top.angle_unit
    status, good = np.asarray(motion.status).reshape(-1), np.asarray(motion.converged).reshape(-1)
    words = [Status(s).name.lower() for s in status.tolist()]
    numbers = motion.residual, motion.conditioning
    far, tight = (None if x is None or not good.any() else np.asarray(x).reshape(-1)[good] for x in numbers)
    verdict.poses = Poses(
        asked=len(status),
        found=int(good.sum()),
        status={word: words.count(word) for word in dict.fromkeys(words)},
        residual=None if far is None else number(far.max()),
        conditioning=None if tight is None else number(tight.min()),
        unit=top.length_unit,
    )
    verdict.assembles = bool(good.any()) or verdict.assembles
    verdict.moves = bool(good.sum() > 1) or verdict.moves
    crossed = crossings(motion)
    verdict.does = bool((good | crossed).all())
    if good.any():
        verdict.extremes = extremes(motion, outputs)
    for which, text, sentence in (
        (crossed, "are change points", CROSSING),
        (~good & ~crossed, "were not found", ""),
    ):
        if which.any():
            first = int(np.argmax(which))
            at = {name: float(np.asarray(v).reshape(-1)[first]) for name, v in motion.inputs.items()}
            in_reading_units = ", ".join(
                f"{n} = {v * unit_of(motion, n)[1]:.6g} {unit_of(motion, n)[0]}" for n, v in at.items()
            )
            text = f"{int(which.sum())} of {len(good)} poses {text}, the first at {in_reading_units}. "
            cause = Status.SINGULAR_START if Status.SINGULAR_START in status else Status(int(status[first]))
            text += sentence or cause.sentence
            code, level = ("singular", "warning") if sentence else ("not-found", "error")
            verdict.add(code, level, text, names=list(motion.driven))


def crossings(motion: Motion) -> np.ndarray:
    """Find the poses that are change points: singular, between two that were found on either side."""
    good, status = np.asarray(motion.converged).reshape(-1), np.asarray(motion.status).reshape(-1)
    out = np.zeros(len(good), bool)
    steps = [np.diff(np.asarray(values, float).reshape(-1)) for values in motion.inputs.values()]
    if len(good) > 2 and steps:
        onward = np.all([a[:-1] * a[1:] >= 0 for a in steps], axis=0)
        moved = np.any([a[:-1] * a[1:] > 0 for a in steps], axis=0)
        out[1:-1] = (status[1:-1] == Status.SINGULAR) & good[:-2] & good[2:] & onward & moved
    return out


def _first_failure(motion: Motion) -> int:
    """Find the first pose that was not found and is no change point."""
    return int(np.argmax((np.asarray(motion.status).reshape(-1) != 0) & ~crossings(motion)))


def stops(motion: Motion, asked: Mapping[str, np.ndarray]) -> bool:
    """Tell whether the first pose that failed is a dead point, at which the motion has all but arrived."""
    first = _first_failure(motion)
    size = float(characteristic_length(motion.system.parameters.points))
    # Where a motion stops, it is handed on as it stood: inputs that have all but arrived are at a dead point.
    gaps = [abs(float(motion[name][first]) - float(values[first])) for name, values in asked.items()]
    return int(motion.status[first]) == Status.SINGULAR and max(gaps) <= 1e-6 * min(1.0, size)


def why(verdict: Verdict, motion: Motion, asked: Mapping[str, np.ndarray], hold: Sequence[str]) -> Diagnosis | None:
    """Diagnose the first pose that was not found, and enter what would mend it; None at a dead point."""
    first = _first_failure(motion)
    begins = Status.SINGULAR_START in np.asarray(motion.status)
    if stops(motion, asked) and not begins:
        return None
    found = diagnose(motion.system, {name: float(values[first]) for name, values in asked.items()}, tuple(hold))
    if begins and not found.never_moves:
        return None
    if not found.assembles:
        if verdict.assembles is None:  # elsewhere it may
            verdict.assembles = diagnose(motion.system).assembles
        apart(verdict, found)
    return found


# -- what is expected -------------------------------------------------------------------------------------------------


def judge(verdict: Verdict, motion: Motion, texts: Sequence[str]) -> Iterator[str]:
    """Decide expectations, enter them, and say each in a line.

    Args:
        verdict: where they are entered; one that is not met is an error.
        motion: the motion, poses in a row.
        texts: each a quantity as `jaxnc.viz.plot` names it, or ``"transmission"`` (the least angle of all, degrees);
            its smallest or largest value, or the range between them; a comparison; a number in the quantity's unit.
            Without a word every pose has to hold it. Of a vector it is the length.

    Yields:
        The lines.
    """
    for text in texts:
        found = _decide(motion, text)
        verdict.expectations.append(found)
        value = "nothing was found" if found.value is None else f"it is {found.value:.6g} {found.unit}".rstrip()
        sentence = f"expected {found.text}: {value}"
        if not found.met:
            verdict.does = False
            verdict.add("expectation-missed", "error", sentence, names=[found.text.split()[0]])
        yield f"  {sentence}, {'met' if found.met else 'NOT met'}"


def check_expected(system: System, arguments: SweepArguments, texts: Sequence[str]) -> None:
    """Refuse expectations of quantities that there are not, by the first pose, before there are many.

    Args:
        system: the system.
        arguments: as of `jaxnc.io.drives.sweep_arguments`.
        texts: the expectations.
    """
    if not texts:
        return
    first = {name: np.asarray(values)[:1] for name, values in arguments["inputs"].items()}
    try:
        motion = solve_position(system, first, rates=arguments["rates"], hold=arguments["hold"], throw=False)
    except InputError:  # as the analysis itself will say
        return
    for text in texts:
        _expected_quantities(motion, text)


def _expected_quantities(motion: Motion, text: str) -> list[Quantity]:
    """Find the quantity that an expectation is about; after a least one those that it is the least of."""
    name, data = parse_expectation(text)[0], poses(motion)
    if name == "transmission":
        found = transmission_quantities(motion)
        if not found:
            raise InputError(f"--expect {text!r}: {motion.system.name!r} has no transmission angle that is known")
        return [Quantity(text, "deg", np.min([q.values for q in found], axis=0), 1.0), *found]
    try:
        q = quantity(data, name)
    except InputError as error:
        raise InputError(f"--expect {text!r}: {str(error).removeprefix('plot: ')}") from None
    unit = q.unit.replace("°", "deg")
    if q.values.ndim == 1:
        return [Quantity(text, unit, q.values, 1.0)]
    return [Quantity(text, unit, np.linalg.norm(q.values, axis=1), 1.0, rate=True, parts=q.values)]


def _decide(motion: Motion, text: str) -> Expectation:
    _, word, sign, limit = parse_expectation(text)

    q = _expected_quantities(motion, text)[0]
    if not np.isfinite(q.values).any():
        return Expectation(text=text, met=False, value=None, unit=q.unit)
    found = extremes_of(motion, lambda motion: _expected_quantities(motion, text))
    low, high = min(low.value for low, _ in found), found[0][1].value
    ends = {"smallest": low, "largest": high, "range": high - low}
    decides = float(ends[word or ("largest" if sign[0] == "<" else "smallest")])
    equal = abs(decides - limit) <= ZERO * abs(limit)
    met = sign in ("<=", ">=") if equal else _HOLDS[sign](decides, limit)
    return Expectation(text=text, met=bool(met), value=number(decides), unit=q.unit)


# -- a simulation -----------------------------------------------------------------------------------------------------


def in_radians(mechanism: Mechanism, values: dict[str, float]) -> dict[str, float]:
    """Bring values of a model's sections to radians and lengths."""
    return {name: value * unit_in_radians(mechanism, name) for name, value in values.items()}


def as_it_says(mechanism: Mechanism, system: System) -> "Simulation":
    """Simulate a mechanism as its section ``[simulate]`` says, which has a duration."""
    from jaxnc.dynamics.simulate import simulate

    section = mechanism.model.simulate
    t = np.linspace(0.0, section.duration or 0.0, section.times)
    start, rates = (in_radians(mechanism, values) or None for values in (section.start, section.rates))
    return simulate(system, t, start, rates, section.method, step=section.step, rtol=section.rtol, throw=False)


def enter_simulation(verdict: Verdict, run: "Simulation", asked_end: float | None = None) -> None:
    """Enter the outcome of a simulation."""
    top, status, energy = run.system.topology, np.asarray(run.status), np.asarray(run.energy)
    verdict.name, verdict.length_unit, verdict.angle_unit = top.name, top.length_unit, top.angle_unit
    made, rejected = map(int, run.steps)
    good, t = np.flatnonzero(status == 0), np.asarray(run.time)
    last = int(good[-1]) if len(good) else 0
    verdict.simulation = Simulated(
        start=float(t[0]),
        end=float(run.end),
        asked_end=float(t[-1]) if asked_end is None else asked_end,
        steps=made,
        rejected=rejected,
        energy_start=number(energy[0]),
        energy_end=number(energy[last]),
        balance_error=number(np.nanmax(np.abs(run.balance.error), initial=0.0)),
        violation=number(max(map(float, run.violation))),
    )
    verdict.assembles = verdict.moves = bool(len(good))
    verdict.does = not status.any()
    if status.any():
        why = Status(int(status[status != 0][0]))
        verdict.add("broke-off", "error", f"{int((status != 0).sum())} times not reached: {why.sentence}")


def energies(run: "Simulation") -> list[Quantity]:
    """List energy that is stored, and that came and went since the start; only what is not always zero."""
    found, unit = run.balance, run.system.topology.load_unit("energy")
    parts = {"stored": found.total, "work of inputs": found.inputs, "work of loads": found.loads}
    parts |= {"taken by dampers": found.dissipated, "taken by friction": found.friction}
    size = max(float(np.nanmax(np.abs(x), initial=0.0)) for x in parts.values())
    return [
        Quantity(name, unit, np.asarray(x), size) for name, x in parts.items() if np.nanmax(np.abs(x), initial=0.0) > 0
    ]


# -- a suspension -----------------------------------------------------------------------------------------------------


def suspension_reports(motion: Motion) -> list[SuspensionReport]:
    """Make reports over a sweep, and over the steering where a rack is held; none if it is no suspension."""
    top = motion.system.topology
    drawn = (*top.points, *top.vectors, *(marker.name for marker in top.markers))
    names = usual(drawn)
    suspended = top.dim == 3 and not top.large and names is not None and names.contact in drawn
    if not suspended or names is None or int(np.sum(motion.converged)) < 2:
        return []
    if not any(float(np.ptp(np.asarray(values))) > 0 for values in motion.inputs.values()):
        return []
    rack = RACK[names.wheel_centre]
    found = [suspension_report(motion)]
    if found[0].travels and rack in motion.held:
        middle = float(np.asarray(derive(motion.system).home)[top.position[rack]])
        far = _RACK_TRAVEL / METRES.get(top.length_unit, 1.0)
        hold = [*motion.driven, *(name for name in motion.held if name != rack)]
        asked = {rack: middle + far * np.linspace(-1.0, 1.0, _RACK_POSES)}
        steered = solve_position(motion.system, asked, hold=hold, throw=False)
        if int(np.sum(steered.converged)) > 1:
            found.append(suspension_report(steered))
    return found


def wheel(found: SuspensionReport) -> Wheel:
    """Write a report on a suspension as a part of a verdict."""
    rows = ({name: getattr(row, name) for name in WheelNumber.__struct_fields__} for row in found.rows)
    plain = ({k: x if isinstance(x, str) else number(x) for k, x in row.items()} for row in rows)
    numbers = msgspec.convert([*plain], list[WheelNumber])
    return Wheel(over=found.over, unit=found.unit, side=found.side, axle=found.axle, numbers=numbers)
