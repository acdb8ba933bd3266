"""Commands that move a mechanism: `run`, `demo`, `parts`, `simulate` and `modes`.

`simulate` moves it under its forces, in parts between which its table is saved. `modes` lists every assembly of a model
file, at its inputs or over the range of one.
"""

import argparse
import itertools
import math
import operator
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import jax
import jax.numpy as jnp
import msgspec
import numpy as np

import jaxnc as nc
from jaxnc.cli.output import Analysis, Task, list_files, report_lines, write_files
from jaxnc.cli.question import Question, collect_named, read_number, read_pair
from jaxnc.dynamics.simulate import ADAPTIVE, check_steps, simulate
from jaxnc.dynamics.simulation import Simulation, join
from jaxnc.errors import AssemblyError, InputError, counted
from jaxnc.io.drives import SweepArguments, check_drive, check_driven, check_poses_asked, sweep_arguments
from jaxnc.io.drives import unit_of as unit_in_radians
from jaxnc.io.tables import list_columns, load_npz, to_csv, to_npz
from jaxnc.io.target import csv_text, stem, write
from jaxnc.kinematics.circuits import Circuits
from jaxnc.kinematics.modes import Modes
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.notebooks import align_columns
from jaxnc.progress import step_bar
from jaxnc.reporting.checked import drives, quantities, shown_in, unit_of
from jaxnc.reporting.outcome import (
    carry_out,
    check_expected,
    enter,
    enter_simulation,
    in_radians,
    judge,
    outputs_of,
    suspension_reports,
    wheel,
)
from jaxnc.reporting.verdict import Assemblies, BranchEnds
from jaxnc.system.system import System
from jaxnc.vehicle.report import SuspensionReport
from jaxnc.workshop.stock import SIZES

_first = operator.itemgetter(0)


def do_modes(question: Question, options: argparse.Namespace, importing: float) -> int:
    """List all assemblies, or join them up over the range of an input; 1 if there is none."""
    mechanism, run, verdict = question.mechanism, question.run, options.verdict
    system = mechanism.compile()
    verdict.drives, verdict.hold = drives(mechanism, run), list(run.hold)
    inputs = {}
    for name, drive in run.inputs.items():
        check_drive(name, drive)
        values = np.linspace(drive.start, drive.end, drive.poses) * unit_in_radians(mechanism, name)
        inputs[name] = values if drive.poses > 1 else values[0]
    common = {"hold": run.hold, "unit": "rad", "seed": options.seed, "most": options.most}
    with step_bar(1) as step:
        step("looking for all assemblies")
        if not options.map:
            found = nc.modes(system, inputs, **common, prove=options.prove)
            tasks = _list_modes(found, question, options)
        else:
            found = nc.circuits(system, inputs, **common)
            tasks = _list_circuits(found, system, options)
    some = any(verdict.assemblies.count)
    verdict.assembles = verdict.does = some
    verdict.summary = verdict.assemblies.statement if some else ""
    if not verdict.assemblies.complete:
        verdict.add("not-known", "warning", "paths were lost or solutions are not isolated: there may be others")
    if not some:
        verdict.add("does-not-assemble", "error", f"{mechanism.name!r} has no assembly there")
    else:
        write_files(options, mechanism.name, tasks, "a table and a picture")
    return int(not some)


def _list_modes(found: Modes, question: Question, options: argparse.Namespace) -> list[Task]:
    """Print the statement and a table of the assemblies, and enter them; returns what can be written."""
    options.verdict.assemblies = Assemblies(
        statement=found.statement, complete=found.complete, count=[len(found)], values=[], branches=[]
    )
    poses, inputs = found.poses, question.run.inputs
    at = ", ".join(f"{name} = {drive.start:g} {unit_of(poses, name)[0]}" for name, drive in inputs.items())
    print(f"  {counted(len(found), 'assembly', 'assemblies')}{at and f' at {at}'}")
    print("\n".join(f"  {line}." for line in found.statement.rstrip(".").split(". ")))
    if len(found):
        columns = quantities(poses, outputs_of(poses, question.run.outputs))
        unit = poses.system.topology.length_unit
        rows = [["", *(f"{q.label} [{q.unit}]" for q in columns), "conditioning", f"within [{unit}]"]]
        most = 40  # rows of the table
        for k, c in enumerate(found.certificates[:most]):
            proof = f"{c.radius:.1g}" if c.exact else "no proof"
            rows.append([str(k), *(f"{q.values[k]:.6g}" for q in columns), f"{c.conditioning:.2g}", proof])
        print("\n".join(align_columns(rows, (0,), "    ")))
        if len(found) > most:
            print(f"  … and {len(found) - most} more")
    return [
        ("-modes.csv", "every assembly, as a table", lambda p: to_csv(poses, p)),
        ("-modes.png", "all of them, side by side", found.draw),
    ]


def _list_circuits(found: Circuits, system: nc.System, options: argparse.Namespace) -> list[Task]:
    """Print circuits and their branches, and how many assemblies there are where; enter them."""
    unit, factor = shown_in(system.topology, found.name)
    values = found.values * factor
    options.verdict.assemblies = Assemblies(
        statement=str(found),
        complete=not found.doubtful,
        count=[int(n) for n in found.count],
        values=[float(v) for v in values],
        branches=[
            BranchEnds(
                circuit=b.circuit, lower=b.lower * factor, upper=b.upper * factor, dead=list(b.dead), turns=b.turns
            )
            for b in found.branches
        ],
    )
    print(f"  {found}")
    rows = [["branch", "circuit", f"from [{unit}]", "", f"to [{unit}]", ""]]
    for k, b in enumerate(found.branches):
        ends = ["turns" if b.turns else "dead point" if dead else "end of the range" for dead in b.dead]
        rows.append([str(k), str(b.circuit), f"{b.lower * factor:.6g}", ends[0], f"{b.upper * factor:.6g}", ends[1]])
    if found.branches:
        print("\n".join(align_columns(rows, (0,), "    ")))
    runs = [(n, [i for _, i in some]) for n, some in itertools.groupby(zip(found.count, values, strict=True), _first)]
    most = 12  # ranges with so many assemblies each, in one line
    told = [f"{n} from {some[0]:.6g} to {some[-1]:.6g}" for n, some in runs[:most]]
    more = f"; and {len(runs) - most} more ranges" if len(runs) > most else ""
    print(f"  number of assemblies over {found.name}: {'; '.join(told)}{more}")
    return [
        ("-circuits.csv", "every pose of every branch, as a table", lambda p: _write_branches(found, p)),
        ("-circuits.png", "the branches over the input", found.draw),
    ]


def _write_branches(found: Circuits, path: Path) -> None:
    """Write the poses of all branches as one table, their numbers and those of their circuits in front."""
    rows: list[list[object]] = []
    for k, branch in enumerate(found.branches):
        columns = list_columns(branch.poses, None, None, "a table").columns
        if not k:
            rows.append(["branch", "circuit", *(f"{name} [{unit}]" for name, (unit, _) in columns.items())])
        for row in zip(*(values.tolist() for _, values in columns.values()), strict=True):
            rows.append([k, branch.circuit, *(f"{x:.17g}" for x in row)])
    write(path, csv_text(rows))


# -- jaxnc simulate ----------------------------------------------------------------------------------------------------


_TABLE = "-simulation.npz"


def do_simulate(question: Question, options: argparse.Namespace, importing: float) -> int:
    """Move a model file under its forces; the exit code."""
    mechanism = question.mechanism
    section = _simulation_section(mechanism, options)
    assert section.duration is not None
    begin = time.perf_counter()
    system = mechanism.compile()
    first, earlier = 0.0, None
    state, rates = (in_radians(mechanism, values) or None for values in (section.start, section.rates))
    if options.resume:
        if options.rate:
            raise InputError(f"--rate {options.rate[0]} is a rate at the start, and --resume takes those of its table")
        earlier = _load_states(system, options.resume)
        state, rates = earlier.pose(-1), None
        first = float(np.asarray(earlier.time)[-1])
        if first >= section.duration:
            raise InputError(f"{options.resume} already goes to {first:g} s; give a longer --duration")
    t = np.linspace(first, section.duration, section.times)
    # The table is saved, and progress shown, between at most ten equal parts of the simulation.
    count = max(k for k in range(1, 11) if (len(t) - 1) % k == 0)
    width = (len(t) - 1) // count
    parts: list[Simulation] = []
    compiling = 0.0

    def whole() -> Motion:
        """The motion of an earlier table, and what was added to it."""
        run = join(parts)
        return run if earlier is None else _append_run(earlier, run)

    with step_bar(count) as step:
        for k in range(count):
            step(f"{t[k * width]:.3g} s")
            at = t[k * width : (k + 1) * width + 1]
            run = simulate(system, at, state, rates, section.method, step=section.step, rtol=section.rtol, throw=False)
            jax.block_until_ready(run.q)
            parts.append(run)
            compiling = compiling or time.perf_counter() - begin
            if options.out is not None:
                to_npz(whole(), Path(options.out) / (stem(mechanism.name) + _TABLE))
            if int(np.asarray(run.status)[-1]):
                break
            state, rates = run.pose(-1), None
    run = join(parts)
    seconds = time.perf_counter() - begin
    enter_simulation(options.verdict, run, section.duration)
    print(run.report())
    if earlier is not None:
        print(f"  taken up              at {first:g} s from {options.resume}; files hold what came before as well")
    print(f"  time                  {seconds:.2f} s, of which {compiling:.2f} s to compile and for the first part")
    print(f"  importing             {importing:.2f} s")
    write_files(options, mechanism.name, _simulation_files(mechanism, whole, options), "tables and pictures")
    return int(bool(np.asarray(run.status).any()))


def _load_states(system: System, path: str) -> Motion:
    """Read the states of a table that a simulation wrote, as far as they were reached; the last one resumes it."""
    top, table = system.topology, load_npz(path)
    names = (*top.points, *top.vectors, *top.scalars)
    orders = [found for found in (table.positions, table.velocities, table.accelerations) if found]
    if table.time is None or len(orders) < 2:
        raise InputError(f"{path}: this table carries no time or no velocities; resume from one that simulate wrote")
    if any(name not in found for name in names for found in orders):
        raise InputError(f"{path}: this table is of another mechanism than {top.name!r}")
    good = np.flatnonzero(table.status == 0)
    if not len(good):
        raise InputError(f"{path}: no time of it was reached")
    columns = ([found[name].reshape(len(table.status), -1) for name in names] for found in orders)
    q, *rates = (jnp.asarray(np.concatenate(x, axis=1)[good]) for x in columns)
    residual, time = (jnp.asarray(x[good]) for x in (table.residual, table.time))
    none, right = jnp.zeros((len(good), 0)), jnp.zeros(len(good), int)
    return Motion(system, (), (), q, tuple(rates), none, right, residual, None, time)


def _append_run(earlier: Motion, run: Motion) -> Motion:
    """Join an earlier motion and a run that begins where it ends."""
    orders = min(len(earlier.rates), len(run.rates))
    parts = [(m.q, m.rates[:orders], m.asked, m.status, m.residual, None, m.time) for m in (earlier, run)]
    q, rates, *rest = jax.tree.map(lambda a, b: jnp.concatenate([a, b[1:]]), *parts)
    return Motion(run.system, run.driven, (), q, rates, *rest)


def _simulation_section(mechanism: Mechanism, options: argparse.Namespace) -> record.Simulation:
    """The section [simulate] of a mechanism, changed as the options say."""
    section = mechanism.model.simulate
    if options.method is not None:  # the file's steps are its own method's, or those of one of the same sort
        section = msgspec.structs.replace(section, **{"step" if options.method in ADAPTIVE else "rtol": None})
    changed = {k: v for k in ("duration", "times", "method", "step", "rtol") if (v := getattr(options, k)) is not None}
    section = msgspec.structs.replace(section, **changed)
    check_steps(section.method, {"--step": options.step}, {"--rtol": options.rtol})
    check_steps(section.method, {"[simulate] step": section.step}, {"[simulate] rtol": section.rtol})
    rates = dict(section.rates)
    given = [read_pair(text, "--rate", "NAME=RATE, for instance phi=10 or phi=90deg") for text in options.rate]
    for name, value in collect_named("--rate", given).items():
        check_driven(mechanism, name, f"--rate {name}={value}")
        rates[name] = read_number(mechanism, name, value, f"--rate {name}={value}")
    section = msgspec.structs.replace(section, rates=rates)
    if section.duration is None:
        raise InputError(
            f"{mechanism.name!r} does not say how long; add --duration SECONDS, or a table [simulate] with duration = …"
        )
    if not (math.isfinite(section.duration) and section.duration > 0):
        raise InputError(f"--duration {section.duration}: seconds must be a positive number")
    check_poses_asked("--times", section.times)
    if section.times < 2:
        raise InputError(f"--times {section.times}: keep at least 2")
    return section


def _simulation_files(mechanism: Mechanism, whole: Callable[[], Motion], options: argparse.Namespace) -> Iterator[Task]:
    """Yield tables and pictures of a simulation, for `write_files`."""
    from jaxnc import viz

    run = whole()
    top = run.system.topology
    outputs = outputs_of(run, mechanism.model.run.outputs)
    trace = [name for name in outputs if name in (*top.points, *(m.name for m in top.markers))]
    yield "-simulation.csv", "every time kept, as a table", lambda p: to_csv(run, p)
    # The arrays were saved part by part.
    yield _TABLE, "the same as arrays; --resume goes on from its last state", lambda p: None
    yield "-energy.png", "energies over time", lambda p: viz.plot_energy(run, p)
    yield "-start.png", "the mechanism at the start", lambda p: viz.draw(run, pose=0, path=p, trace=trace)
    courses = f"{', '.join(outputs)} over time"
    yield "-simulation-plots.png", courses, lambda p: viz.plot(run, *outputs, against="time", path=p)
    if not (options.no_html or options.no_pictures):
        page = "a page where the motion is played, opens in any browser"
        yield "-simulation.html", page, lambda p: viz.to_html(run, p, trace=trace, model=mechanism)
    if options.animate:
        what = "the motion, in real time where that can be followed"
        yield "-simulation.gif", what, lambda p: viz.animate(run, p, trace=trace)


# -- jaxnc run, demo and parts -----------------------------------------------------------------------------------------


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
