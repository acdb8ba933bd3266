"""What came of a motion: poses found, extremes, and why poses are missing."""

from collections.abc import Mapping, Sequence

import numpy as np

from jaxnc.kinematics.diagnosis import Diagnosis, diagnose
from jaxnc.kinematics.motion import Motion
from jaxnc.reporting.checked import apart
from jaxnc.reporting.quantity import Quantity, constant, course, extreme_of, quantities, unit_of
from jaxnc.reporting.verdict import Extreme, Poses, Verdict, number
from jaxnc.status import Status
from jaxnc.system.system import characteristic_length

ZERO = 1e-9
"""Of the largest number of its unit: what is smaller is shown as zero."""

CROSSING = "Branches cross there: places are known to half of the digits, rates are not, and tables leave them blank."

_MOST = 6  # quantities reported when nobody said which


def outputs_of(motion: Motion, named: Sequence[str] = ()) -> list[str]:
    """What to report: what is named, else coordinates and markers, else points that move."""
    if named:
        return list(named)
    top, driven = motion.system.topology, motion.driven
    moving = [p for i, p in enumerate(top.points) if not all(top.fixed[i * top.dim : (i + 1) * top.dim])]
    chosen = [s for s in top.scalars if s not in driven] + [m.name for m in top.markers]
    return (chosen or moving)[:_MOST]


def idle(q: Quantity, scale: float) -> bool:
    """Whether a quantity is a rate that is always zero: then its position, which is constant, says it all."""
    return q.rate and bool((np.abs(q.values[np.isfinite(q.values)]) <= ZERO * scale).all())


def scales_of(found: Sequence[Quantity]) -> dict[str, float]:
    """The largest number of each unit."""
    scales: dict[str, float] = {}
    for q in found:
        scales[q.unit] = max(scales.get(q.unit, q.scale), float(np.nanmax(np.abs(q.values), initial=0.0)))
    return scales


def inputs_at(motion: Motion, pose: float) -> dict[str, float]:
    """Values of the inputs at a pose, or between two, in the units a person reads; the time where nothing is driven."""
    if not motion.driven and motion.time is not None:
        time = np.asarray(motion.time, float)
        return {"time": float(np.interp(pose, np.arange(len(time)), time))}
    at = {}
    for name in motion.driven:
        values = np.asarray(motion[name], float).reshape(-1) * unit_of(motion, name)[1]
        value = float(np.interp(pose, np.arange(len(values)), values))
        at[name] = 0.0 if abs(value) <= ZERO * np.ptp(values) else value
    return at


def extremes(motion: Motion, found: Sequence[Quantity]) -> list[Extreme]:
    """Where quantities are smallest and largest, and how large."""
    way, scales, out = course(motion), scales_of(found), []
    for q in found:
        if idle(q, scales[q.unit]) or not np.isfinite(q.values).any():
            continue
        ends = [extreme_of(q, None if constant(q.values) else way, largest) for largest in (False, True)]
        low, high = (0.0 if abs(e.value) <= ZERO * scales[q.unit] else e.value for e in ends)
        first, last = (inputs_at(motion, e.at) for e in ends)
        made = Extreme(quantity=q.label, unit=q.unit, smallest=low, smallest_at=first, largest=high, largest_at=last)
        out.append(made)
    return out


def enter(verdict: Verdict, motion: Motion, outputs: Sequence[str]) -> None:
    """Enter what came of a motion: of its poses, and its extremes."""
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
    verdict.does = bool((good | crossings(motion)).all())
    if good.any():
        verdict.extremes = extremes(motion, quantities(motion, outputs))
    crossed = crossings(motion)
    for which, text, sentence in (
        (crossed, "are change points", CROSSING),
        (~good & ~crossed, "were not found", ""),
    ):
        if which.any():
            first = int(np.argmax(which))
            at = {name: float(np.asarray(v).reshape(-1)[first]) for name, v in motion.inputs.items()}
            shown = ", ".join(f"{n} = {v * unit_of(motion, n)[1]:.6g} {unit_of(motion, n)[0]}" for n, v in at.items())
            text = f"{int(which.sum())} of {len(good)} poses {text}, the first at {shown}. "
            text += sentence or Status(int(status[first])).sentence
            code, level = ("singular", "warning") if sentence else ("not-found", "error")
            verdict.add(code, level, text, names=list(motion.driven))


def crossings(motion: Motion) -> np.ndarray:
    """Which poses are change points: singular, between two that were found on either side."""
    good, status = np.asarray(motion.converged).reshape(-1), np.asarray(motion.status).reshape(-1)
    out = np.zeros(len(good), bool)
    steps = [np.diff(np.asarray(values, float).reshape(-1)) for values in motion.inputs.values()]
    if len(good) > 2 and steps:
        onward = np.all([a[:-1] * a[1:] >= 0 for a in steps], axis=0)
        moved = np.any([a[:-1] * a[1:] > 0 for a in steps], axis=0)
        out[1:-1] = (status[1:-1] == Status.SINGULAR) & good[:-2] & good[2:] & onward & moved
    return out


def _failed(motion: Motion) -> int:
    """The first pose that was not found and is no change point."""
    return int(np.argmax((np.asarray(motion.status).reshape(-1) != 0) & ~crossings(motion)))


def stops(motion: Motion, asked: Mapping[str, np.ndarray]) -> bool:
    """Whether the first pose that failed is a dead point, at which the motion has all but arrived."""
    first = _failed(motion)
    size = float(characteristic_length(motion.system.parameters.points))
    # Where a motion stops, it is handed on as it stood: inputs that have all but arrived are at a dead point.
    gaps = [abs(float(motion[name][first]) - float(values[first])) for name, values in asked.items()]
    return int(motion.status[first]) == Status.SINGULAR and max(gaps) <= 1e-6 * min(1.0, size)


def why(verdict: Verdict, motion: Motion, asked: Mapping[str, np.ndarray], hold: Sequence[str]) -> Diagnosis | None:
    """Diagnose the first pose that was not found, and enter what would mend it; None at a dead point."""
    first = _failed(motion)
    if stops(motion, asked):
        return None
    found = diagnose(motion.system, {name: float(values[first]) for name, values in asked.items()}, tuple(hold))
    if not found.assembles:
        if verdict.assembles is None:  # elsewhere it may
            verdict.assembles = diagnose(motion.system).assembles
        apart(verdict, shown(motion, found))
    return found


def shown(motion: Motion, found: Diagnosis) -> Diagnosis:
    """A diagnosis with its inputs in the units a person reads."""
    from dataclasses import replace

    def turned(inputs: Mapping[str, float]) -> dict[str, float]:
        return {name: value * unit_of(motion, name)[1] for name, value in inputs.items()}

    return replace(found, inputs=turned(found.inputs), reached=turned(found.reached))
