"""Output of commands: the report of an analysis, short and aligned, in the units of the model; files."""

import argparse
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from jaxnc.cli.question import Question
from jaxnc.errors import counted
from jaxnc.io.target import folder, stem
from jaxnc.kinematics.inputs import doubtful_size
from jaxnc.kinematics.motion import Motion
from jaxnc.notebooks import align_columns
from jaxnc.progress import step_bar
from jaxnc.reporting.checked import ZERO, ExtremeValue, Quantity, constant, extremes_of, quantities, unit_of
from jaxnc.reporting.outcome import (
    CROSSING,
    crossings,
    idle,
    inputs_at,
    outputs_of,
    scales_of,
    why,
)
from jaxnc.reporting.verdict import File, Verdict
from jaxnc.status import Status
from jaxnc.system.system import System
from jaxnc.vehicle.report import SuspensionReport

_WAYS = {
    "sweep": "in order along the branch",
    "solve_position": "every pose on its own",
    "circuit": "by arc length along the circuit, through dead points",
}


@dataclass(frozen=True)
class Analysis:
    """A motion and what is known about it."""

    question: Question  # the mechanism, and how it was driven
    system: System  # the mechanism, compiled
    inputs: Mapping[str, np.ndarray]  # values that were asked for, radians and lengths, each (T,)
    motion: Motion  # what came of it
    compiling: float  # seconds of compiling and the first call
    running: float | None  # seconds of a second call; None if there was none


def report_lines(
    analysis: Analysis, importing: float, suspensions: Sequence[SuspensionReport], verdict: Verdict
) -> Iterator[str]:
    """Report on an analysis, line by line below its title; the last lines may take a while."""
    motion = analysis.motion
    top, dof = analysis.system.topology, analysis.system.degrees_of_freedom
    n = len(top.unknown)
    yield (
        f"  {counted(n, 'coordinate')}, {counted(len(top.rows), 'constraint row')} of rank {n - dof}, "
        f"{counted(dof, 'degree')} of freedom"
    )
    for line in _drives(analysis):
        yield f"  {line}"
    if doubt := doubtful_size(analysis.system):
        yield f"  warning: {doubt}"
    good = np.asarray(motion.converged)
    for k, found in enumerate(suspensions):
        yield from ("", *(f"  {line}" for line in (found.text(all_of_it=not k)).splitlines()))
    if good.any():
        yield from ("", *_extremes_table(analysis), "", *_quality(motion, good))
    failed = ~good & ~crossings(motion)
    if not good.all():
        yield from _failures(analysis, failed)
    second = f"run {_duration(analysis.running)}" if analysis.running is not None else "not run a second time"
    yield f"  time: import {_duration(importing)}, compile {_duration(analysis.compiling)}, {second}"
    if failed.any():
        yield from _diagnosis(analysis, verdict)


def _diagnosis(analysis: Analysis, verdict: Verdict) -> list[str]:
    """Say why the first pose that failed was not found, in the model's angle unit."""
    motion = analysis.motion
    if analysis.question.run.analysis == "circuit":
        return []
    with step_bar(1) as step:
        step("finding out why")
        found = why(verdict, motion, analysis.inputs, analysis.question.run.hold)
    if found is None and np.asarray(motion.converged)[int(np.argmax(np.asarray(motion.status) != 0)) :].any():
        return ["  the first of them is a singular position, and the motion goes on from there: begin beside it"]
    if found is None:
        return ["  the first of them is a dead point, where the input can go no further: stop short of it"]
    if found.assembles and not found.never_moves:
        said = "the first of them exists, but the motion did not come to it"
        return [f"  {said}: try --analysis solve_position or --analysis circuit"]
    return [f"  {line}" for line in str(found).splitlines()]


def _drives(analysis: Analysis) -> Iterable[str]:
    for name, drive in analysis.question.run.inputs.items():
        unit, _ = unit_of(analysis.motion, name)
        rate = f" at {_format(drive.rate)} {unit}/s" if drive.rate is not None and analysis.motion.rates else ""
        way = f"from {_format(drive.start)} to {_format(drive.end)}" if drive.poses > 1 else f"to {_format(drive.end)}"
        yield (
            f"{name} driven {way} {unit}{rate}, {counted(drive.poses, 'pose')} {_WAYS[analysis.question.run.analysis]}"
        )
    if analysis.question.run.hold:
        yield f"held: {', '.join(analysis.question.run.hold)}"


def _extremes_table(analysis: Analysis) -> list[str]:
    """A table with a row for each quantity: smallest, largest, where, and the range between them."""
    motion, names = analysis.motion, outputs_of(analysis.motion, analysis.question.run.outputs)
    found = quantities(motion, names)
    scales = scales_of(found)
    told = {q.label for q in found if not idle(q, scales[q.unit])}

    def tell(motion: Motion) -> list[Quantity]:
        return [
            replace(q, values=np.where(np.abs(q.values) <= ZERO * scales[q.unit], 0.0, q.values))
            for q in quantities(motion, names)
            if q.label in told
        ]

    if len(motion.status) == 1:
        rows = [[f"{q.label} [{q.unit}]", _format(float(q.values[0]))] for q in found if q.label in told]
        return align_columns(rows, (0,), "  ")
    units = dict.fromkeys(unit_of(motion, name)[0] for name in motion.driven)
    where = f"{', '.join(motion.driven)} [{', '.join(units)}]"
    rows = [["", "smallest", f"at {where}", "largest", f"at {where}", "range"]]
    rows += [_extreme_row(motion, q, ends) for q, ends in zip(tell(motion), extremes_of(motion, tell), strict=True)]
    lines = align_columns(rows, (0,), "  ")
    if any("~" in cell for row in rows[1:] for cell in row):
        lines.append("  ~ between two poses; the others are at a pose")
    return lines


def _extreme_row(motion: Motion, q: Quantity, ends: tuple[ExtremeValue, ExtremeValue]) -> list[str]:
    label = f"{q.label} [{q.unit}]"
    if constant(q.values):
        return [label, _format(float(np.nanmean(q.values))), "everywhere", "", "", ""]
    cells, (low, high) = [label], ends
    for end in ends:
        at = ", ".join(_format(value, 5) for value in inputs_at(motion, end.at).values())
        cells += [_format(end.value), at + ("~" if end.refined else " ")]
    return [*cells, _format(high.value - low.value)]


def _quality(motion: Motion, good: np.ndarray) -> list[str]:
    """Say how many poses are right, and how right."""

    def name_input(i: int) -> str:
        return ", ".join(
            f"{name} = {_format(value, 5)} {unit_of(motion, name)[0]}" for name, value in inputs_at(motion, i).items()
        )

    residual = np.where(good, np.asarray(motion.residual), -1.0)
    conditioning = np.where(good, np.asarray(motion.conditioning), np.inf)
    worst, tight = int(residual.argmax()), int(conditioning.argmin())
    every = "all " if good.all() and len(good) > 1 else ""
    return [
        f"  {every}{counted(int(good.sum()), 'pose')} found; worst residual {residual[worst]:.1e} "
        f"{motion.system.topology.length_unit} at {name_input(worst)}",
        f"  smallest conditioning {conditioning[tight]:.2g} at {name_input(tight)} (0 is a singular position)",
    ]


def _failures(analysis: Analysis, failed: np.ndarray) -> list[str]:
    """Failed poses and change points in groups, with the sentence that says why."""
    status = np.asarray(analysis.motion.status)
    many, crossed = counted(len(status), "pose"), int((status[~failed] != 0).sum())
    lines = [f"  {int(failed.sum())} of {many} FAILED"] if failed.any() else []
    lines += [f"  {crossed} of {many} at change points"] if crossed else []
    edges = [0, *(np.flatnonzero(np.diff(status) | np.diff(failed)) + 1).tolist(), len(status)]
    groups = [(a, b) for a, b in itertools.pairwise(edges) if status[a]]
    most = 6  # of failed poses
    for a, b in groups[:most]:
        lines.append(
            f"    {_inputs_between(analysis, a, b - 1)}: {Status(int(status[a])).sentence if failed[a] else CROSSING}"
        )
    if len(groups) > most:
        lines.append(f"    … and {len(groups) - most} more groups of poses")
    return lines


def _inputs_between(analysis: Analysis, first: int, last: int) -> str:
    """Describe the inputs that were asked for at a group of poses."""
    if analysis.question.run.analysis == "circuit":
        return f"pose {first} … {last}"
    at = []
    for name, values in analysis.inputs.items():
        unit, factor = unit_of(analysis.motion, name)
        span = [_format(float(values[i]) * factor) for i in dict.fromkeys((first, last))]
        at.append(f"{name} = {' … '.join(span)} {unit}")
    return ", ".join(at)


def _format(value: float, digits: int = 6) -> str:
    return f"{value:.{digits}g}"


def _duration(seconds: float) -> str:
    return f"{seconds:.2f} s" if seconds >= 0.1 else f"{1e3 * seconds:.2g} ms"


# -- files ----------------------------------------------------------------------------------------------------------


Task = tuple[str, str, Callable[[Path], object]]
"""A file to be written: the end of its name, a description, and the function that writes it."""


def write_files(
    options: argparse.Namespace,
    name: str,
    tasks: Iterable[Task],
    what: str,
    written: Sequence[tuple[Path, str]] = (),
) -> None:
    """Write files where ``--out`` says, with a progress bar where someone is watching, and list them.

    Args:
        options: of the command; without ``--out`` nothing is written, with ``--no-pictures`` no picture.
        name: of the mechanism, with which every file name begins.
        tasks: the files.
        what: said of ``--out`` where it is not given.
        written: paths and descriptions of files that are there already, and are listed first.
    """
    if options.out is None:
        print(f"  no files written; --out DIR writes {what}")
        return
    chosen = [task for task in tasks if not (task[0].endswith(".png") and options.no_pictures)]
    base, files = folder(options.out) / stem(name), list(written)
    with step_bar(len(chosen)) as step:
        for ending, said, write in chosen:
            path = base.with_name(base.name + ending)
            step(f"writing {path.name}")
            write(path)
            files.append((path, said))
    list_files(files, options.verdict)


def list_files(files: Sequence[tuple[Path, str]], verdict: Verdict) -> None:
    """List the files that were written, one a line, and enter them into the verdict."""
    verdict.files += [File(path=str(path), what=what) for path, what in files]
    width = max(len(str(path)) for path, _ in files)
    print("\n".join(["  files:", *(f"    {str(path).ljust(width)}  {what}" for path, what in files)]))
