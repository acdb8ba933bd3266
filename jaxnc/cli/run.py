"""`jaxnc run`, `jaxnc demo` and `jaxnc parts`: a mechanism is compiled and moved, and its motion looked at."""

import argparse
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import jax
import numpy as np

from jaxnc.cli.output import Analysis, Task, list_files, report_lines, write_files
from jaxnc.cli.question import Question
from jaxnc.errors import AssemblyError, InputError
from jaxnc.io.drives import SweepArguments, sweep_arguments
from jaxnc.io.tables import to_csv, to_npz
from jaxnc.io.target import stem
from jaxnc.kinematics.motion import Motion
from jaxnc.progress import step_bar
from jaxnc.reporting.checked import drives
from jaxnc.reporting.outcome import (
    carry_out,
    check_expected,
    enter,
    judge,
    outputs_of,
    suspension_reports,
    wheel,
)
from jaxnc.system.system import System
from jaxnc.vehicle.report import SuspensionReport
from jaxnc.workshop.shop import SIZES


def do_demo(question: Question, options: argparse.Namespace, importing: float) -> int:
    """Analyse a ready mechanism as its library function drives it, and say what to try next; the exit code."""
    code = do_run(question, options, importing)
    path = Path(options.out) / (stem(question.mechanism.name) + ".toml")
    if path.exists():
        print(f"  next: {path} was there already and is left as it is; `jaxnc run {path}` analyses it")
    else:
        question.mechanism.save(path)
        print(f"  next: the model is in {path}; change it, then `jaxnc run {path}`")
    return code


def do_run(question: Question, options: argparse.Namespace, importing: float) -> int:
    """Analyse a mechanism, print the report and write the files; the exit code."""
    verdict = options.verdict
    analysis = analyse(question, options.expect)
    motion, outputs = analysis.motion, outputs_of(analysis.motion, question.run.outputs)
    verdict.drives, verdict.hold = drives(question.mechanism, question.run), list(question.run.hold)
    enter(verdict, motion, outputs)
    suspensions = [] if question.run.analysis == "circuit" else suspension_reports(motion)
    verdict.wheels = [wheel(found) for found in suspensions]
    for line in report_lines(analysis, importing, suspensions, verdict):
        print(line, flush=True)
    for line in judge(verdict, motion, options.expect):
        print(line)
    tasks = _motion_files(analysis, outputs, suspensions, options)
    write_files(options, question.mechanism.name, tasks, "tables, pictures and a page")
    return int(bool(verdict.errors))


def do_parts(question: Question, options: argparse.Namespace, importing: float) -> int:
    """Make a mechanism of plates, print the table of parts and write their drawings; the exit code."""
    if not question.run.inputs:
        raise InputError(f"{options.file} does not say over what motion parts must not collide; add [run.inputs] to it")
    motion = analyse(question).motion
    options.verdict.assembles = options.verdict.moves = True
    sizes = {name: getattr(options, name) for name in SIZES if getattr(options, name) is not None}
    formats = (options.format,) if options.format else ("dxf", "svg")
    parts = motion.to_parts(options.out, formats=formats, **sizes)
    options.verdict.does = True
    print(parts)
    if options.out is None:
        print("  no files written; --out DIR writes drawings of the parts, and this table")
        return 0
    files = [(f"{d.name}.{ending}", f"{d.title}, at true scale") for d in parts.drawings() for ending in formats]
    files += [("parts.csv", "the table of parts"), ("pins.csv", "what lies on each pin")]
    files += [("parts.txt", "both, to be read"), ("assembly.png", "a picture of the stack")]
    list_files([(Path(options.out) / name, what) for name, what in files], options.verdict)
    return 0


def analyse(question: Question, expect: Sequence[str] = ()) -> Analysis:
    """Compile a mechanism and move it as its run section says. Poses that failed have a status.

    Names in `expect` (``--expect``) are read before the mechanism is moved.
    """
    arguments = sweep_arguments(question.mechanism, question.run)
    begin = time.perf_counter()
    running = None
    try:
        with step_bar(3) as step:
            step("compiling the mechanism")
            system = question.mechanism.compile()
            check_expected(system, arguments, expect)
            step("compiling its motion")
            motion = _move_mechanism(system, question.run.analysis, arguments)
            first = time.perf_counter()
            if first - begin < 30.0:  # one that takes longer is not repeated only to be timed
                step("moving it")
                motion = _move_mechanism(system, question.run.analysis, arguments)
                running = time.perf_counter() - first
    except AssemblyError as error:
        raise AssemblyError(f"{error} `jaxnc check` says how far an input can go") from None
    return Analysis(question, system, arguments["inputs"], motion, first - begin, running)


def _move_mechanism(system: System, analysis: str, arguments: SweepArguments) -> Motion:
    motion = carry_out(system, analysis, arguments)
    jax.block_until_ready((motion.q, motion.rates, motion.status))
    return motion


def _motion_files(
    analysis: Analysis, outputs: Sequence[str], suspensions: Sequence[SuspensionReport], options: argparse.Namespace
) -> Iterator[Task]:
    """Yield tables and pictures of an analysis, for `write_files`."""
    from jaxnc import viz

    motion, top = analysis.motion, analysis.system.topology
    trace = [name for name in outputs if name in (*top.points, *(m.name for m in top.markers))]
    good = np.flatnonzero(np.asarray(motion.converged))
    yield ".csv", "every pose, as a table", lambda p: to_csv(motion, p)
    yield ".npz", "the same as arrays, for numpy", lambda p: to_npz(motion, p)
    if suspensions:
        yield "-report.json", "camber, toe and the rest with gradients, as data", suspensions[0].to_json
    if len(good):
        pose = int(good[len(good) // 8])  # not the first: many mechanisms start where their bars lie in line
        yield ".png", "the mechanism, drawn", lambda p: viz.draw(motion, pose=pose, path=p, trace=trace)
    if len(good) < 2:
        return
    for found in suspensions:
        what = f"toe, camber, caster and the rest over {found.over}"
        yield "-plots.png" if found.travels else "-steering.png", what, found.plot
    if not suspensions:
        yield "-plots.png", f"{', '.join(outputs)} over the input", lambda p: viz.plot(motion, *outputs, path=p)
    if not (options.no_html or options.no_pictures):
        what, model = "a page where it is dragged and changed, opens in any browser", analysis.question.mechanism
        yield ".html", what, lambda p: viz.to_html(motion, p, trace=trace, model=model)
    if options.animate and not options.no_pictures:
        yield ".gif", "the motion", lambda p: viz.animate(motion, p, trace=trace)
