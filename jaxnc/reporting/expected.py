"""Expectations of a motion, such as ``"psi range > 30"`` or ``"P.y largest <= 0.2"``, and whether they are met."""

import operator
from collections.abc import Iterator, Sequence

import numpy as np

from jaxnc.errors import InputError
from jaxnc.io.drives import SweepArguments
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position
from jaxnc.reporting.quantity import constant, course, extreme
from jaxnc.reporting.transmission import transmissions
from jaxnc.reporting.verdict import Expectation, Verdict, number, parse_expectation
from jaxnc.system.system import System
from jaxnc.viz.poses import poses
from jaxnc.viz.quantities import quantity

_HOLDS = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}


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
        _values(motion, text)


def _values(motion: Motion, text: str) -> tuple[np.ndarray, str]:
    """Find the values that an expectation is about, one for each pose, and their unit."""
    name, data = parse_expectation(text)[0], poses(motion)
    if name == "transmission":
        found = [t.values for t in transmissions(motion)]
        if not found:
            raise InputError(f"--expect {text!r}: {motion.system.name!r} has no transmission angle that is known")
        values, unit = np.nanmin(found, axis=0), "deg"
    else:
        try:
            q = quantity(data, name)
        except InputError as error:
            raise InputError(f"--expect {text!r}: {str(error).removeprefix('plot: ')}") from None
        values, unit = (q.values if q.values.ndim == 1 else np.linalg.norm(q.values, axis=1)), q.unit
        unit = unit.replace("°", "deg")
    return values, unit


def _decide(motion: Motion, text: str) -> Expectation:
    _, word, sign, limit = parse_expectation(text)
    values, unit = _values(motion, text)
    if not np.isfinite(values).any():
        return Expectation(text=text, met=False, value=None, unit=unit)
    way = None if constant(values) else course(motion)
    low, high = (extreme(values, way, largest).value for largest in (False, True))
    ends = {"smallest": low, "largest": high, "range": high - low}
    decides = float(ends[word or ("largest" if sign[0] == "<" else "smallest")])
    return Expectation(text=text, met=bool(_HOLDS[sign](decides, limit)), value=number(decides), unit=unit)
