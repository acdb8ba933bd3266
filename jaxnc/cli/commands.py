"""`jaxnc check`, `compare`, `export`, `report`, `synthesise` and `trace`; what one needs is loaded then."""

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import msgspec
import numpy as np

import jaxnc as nc
from jaxnc.cli.output import Task, list_files, write_files
from jaxnc.cli.question import Question, report_path
from jaxnc.errors import AssemblyError, InputError, counted, nearest
from jaxnc.io.source import SUFFIXES
from jaxnc.io.target import folder, remove_rest, stem, write
from jaxnc.progress import step_bar
from jaxnc.reporting import checked
from jaxnc.reporting.verdict import Design, Family, Search, Verdict, number

if TYPE_CHECKING:
    from jaxnc.synthesis.result import Result
    from jaxnc.synthesis.tracing.trace import TraceResult

_EXPORTS = {"mjcf": (".xml", "for MuJoCo"), "urdf": (".urdf", "for other simulators of robots")}


def do_check(question: Question, options: argparse.Namespace, importing: float) -> int:
    """Look at a model file without analysing it: 0 if it assembles and its run section can be carried out, else 1."""
    mechanism, verdict = question.mechanism, options.verdict
    system = mechanism.compile()
    model = mechanism.model
    print("  " + ", ".join(checked.parts(mechanism)))
    mobility = nc.mobility(system)
    checked.count(verdict, system, mobility)
    print("\n".join(f"  {line}" for line in str(mobility).partition(": ")[2].splitlines()))
    if mobility.conflicting:
        print("\n".join(f"  {line}" for line in str(checked.assembly(verdict, system)).splitlines()[1:]))
        print("  it does NOT assemble")
        return 1
    print(f"  it assembles: every constraint is met to {mobility.gap:.1e} {model.units.length}")
    if mobility.dof > 0:
        names = verdict.drivable
        most = 12  # names in one line
        print(f"  may be driven: {', '.join(names[:most])}" + (", …" if len(names) > most else ""))
    verdict.drives, verdict.hold = checked.drives(mechanism, model.run), list(model.run.hold)
    verdict.findings += (problems := checked.problems(mechanism, system))
    if not problems:
        for line in checked.travels(mechanism, system, verdict):
            print(f"  {line}")
    for warning in checked.oddities(system, mechanism):
        verdict.findings.append(warning)
        print(f"  warning: {warning.text}")
    for problem in verdict.errors:
        print(f"  problem: {problem.text}")
    if model.run.inputs:
        verdict.does = not verdict.errors
    if not verdict.errors:
        print("  good" + (": `jaxnc run` can carry it out" if model.run.inputs else ""))
    return 1 if verdict.errors else 0


def do_compare(question: Question, options: argparse.Namespace, importing: float) -> int:
    """Compare the families of coordinates on a model file: 0, or 1 if it does not assemble."""
    mechanism, model, verdict = question.mechanism, question.mechanism.model, options.verdict
    known = nc.families.FAMILIES
    wanted = [f.strip() for f in options.families.split(",")] if options.families else list(known)
    for family in wanted:
        if family not in known:
            raise InputError(f"--families {options.families}: no family {family!r}; {nearest(family, known)}")
    try:
        with step_bar(len(wanted)) as step:
            comparison = nc.families.compare(mechanism, wanted, (*model.run.inputs, *model.run.hold), progress=step)
    except AssemblyError:
        diagnosis = checked.assembly(verdict, mechanism.compile())
        if diagnosis.assembles:
            raise
        print(diagnosis)
        return 1
    verdict.assembles = verdict.does = True
    verdict.moves = any((row.g or 0) > 0 for row in comparison.families)
    verdict.families = [
        Family(
            family=row.family,
            variables=row.n,
            equations=row.r,
            freedoms=row.g,
            condition=number(row.condition),
            iterations=row.iterations,
            note=row.note,
        )
        for row in comparison.families
    ]
    print(comparison)

    def write_equations(path: Path) -> Path:
        chapters = [f"# {model.name}: constraint equations"]
        for name, f in comparison.formulations.items():
            chapters.append(f"## {name}: n = {f.n}, r = {f.r}, g = {f.g}\n\n{f.equations().markdown()}")
        return write(path, ("\n\n".join(chapters) + "\n").encode())

    tasks: list[Task] = [
        ("-families.csv", "the table", lambda p: write(p, comparison.to_csv().encode())),
        ("-families.json", "the same", lambda p: write(p, comparison.to_json().encode())),
        ("-equations.md", "the equations of every family", write_equations),
        ("-families.png", "the plot", lambda p: nc.viz.plot_families(comparison, p)),
    ]
    write_files(options, model.name, tasks, "tables, a plot and the equations")
    return 0


def do_export(question: Question, options: argparse.Namespace, importing: float) -> int:
    """Write a model file for a simulator of robots; 1 if it does not assemble, 0 also where something is left out."""
    mechanism, verdict = question.mechanism, options.verdict
    suffix, purpose = _EXPORTS[options.to]
    path = folder(options.out or Path()) / f"{stem(mechanism.name)}{suffix}"
    try:
        exported = mechanism.to_mjcf(path) if options.to == "mjcf" else mechanism.to_urdf(path)
    except AssemblyError:
        print(checked.assembly(verdict, mechanism.compile()))
        return 1
    verdict.assembles = verdict.does = True
    for text in exported.left_out:
        verdict.add("left-out", "warning", text)
    for text in exported.notes:
        verdict.add("left-out", "note", text)
    print("\n".join(str(exported).splitlines()[1:]))
    many = ((exported.links, "link"), (exported.joints, "joint"), (exported.loops, "loop"))
    counts = ", ".join(counted(len(some), noun) for some, noun in many)
    list_files([(path, f"{counts}, {purpose}")], verdict)
    return 0


def do_report(question: Question, options: argparse.Namespace, importing: float) -> int:
    """Look at a mechanism, say in short what there is, and write the page; 0 if it does all that was asked."""
    source = Path(options.file)
    text = source.read_text(encoding="utf-8") if source.suffix.lower() in SUFFIXES else ""
    path = report_path(options.out, question.mechanism.name)
    with step_bar(2) as step:
        step("looking at it")
        question.mechanism.model.run = question.run
        report = nc.report(question.mechanism, expect=options.expect, model_text=text)
        step("writing the page")
        report.to_html(path)
    options.verdict = report.verdict
    print("\n".join(str(report).splitlines()[1:]))
    if not report.verdict.errors:
        print(f"  {report.verdict.summary}")
    list_files([(path, "the page: opens in any browser, prints on A4")], options.verdict)
    return report.verdict.exit


def do_synthesise(question: Question, options: argparse.Namespace, importing: float) -> int:
    """Search for designs as a problem file says.

    The exit code is 1 if none without defects was found, and 130 if the search was interrupted: what it had found by
    then is printed and written all the same.
    """
    from jaxnc.io.problems import load_problem

    problem, search = load_problem(options.file)
    changed = {k: v for k in ("starts", "refine", "seconds", "key") if (v := getattr(options, k)) is not None}
    settings = msgspec.structs.asdict(search) | changed
    begin = time.perf_counter()
    settings["key"] = jax.random.key(settings["key"])
    result = nc.synthesis.solve(problem, **settings, checkpoint=options.checkpoint, resume=options.resume)
    _enter_search(options.verdict, result)
    print(result)
    print(f"  time       {time.perf_counter() - begin:.1f} s")
    print(f"  importing  {importing:.2f} s")
    files = []
    if options.out is not None:
        place = result.save(options.out)
        files = [(place / "designs.txt", "the table"), (place / "result.npz", "the numbers, for jaxnc.synthesis.load")]
        files += [(place / f"design_{k + 1}.toml", "a model file") for k in range(len(result.designs[:3]))]
    gallery = ("-designs.png", "the best designs", result.gallery)
    course = ("-convergence.png", "the best error over time", result.convergence)
    pictures = [gallery, course] if result.designs else []
    write_files(options, problem.system.name, pictures, "the designs as model files, and pictures", files)
    return _search_code(result, options)


def do_trace(question: Question, options: argparse.Namespace, importing: float) -> int:
    """Find linkages that trace a curve; 1 if none meets the conditions, 130 if the search was interrupted."""
    from jaxnc import synthesis as S

    if question.curve is None:
        return _show_trace_page(options)
    points, closed = question.curve
    more: dict[str, Any] = {"checkpoint": options.checkpoint, "resume": options.resume}
    if options.bars is not None:
        words = options.bars.split(",")
        if not all(word.strip().isdigit() for word in words):
            raise InputError(f"--bars {options.bars}: expected some of 4, 6 and 8, such as 4,6")
        more["bars"] = [int(word) for word in words]
    if options.transmission is not None:
        if not 0.0 <= options.transmission < 90.0:
            raise InputError(f"--transmission {options.transmission:g}: an angle from 0 to 90, in degrees")
        more["subject_to"] = [S.transmission_angle(float(np.radians(options.transmission)))]
    key, sliders = jax.random.key(options.key), not options.no_sliders
    result = S.trace(points, closed, seconds=options.seconds, key=key, sliders=sliders, **more)
    verdict = options.verdict
    designs = [Design(error=number(d.distance), defects=[], variables={"bars": float(d.bars)}) for d in result.designs]
    verdict.search = Search(
        screened=result.refined, refined=result.refined, stopped=result.stopped, unit="", designs=designs
    )
    verdict.assembles = verdict.moves = verdict.does = bool(designs)
    print(result)
    print(f"  importing  {importing:.2f} s")
    if not designs:
        verdict.add("no-design", "error", "no linkage meets the conditions")
        return _search_code(result, options)
    tasks: list[Task] = [(f"-{k}.toml", f"a model file: {d.name}", d.save) for k, d in enumerate(result.designs[:3], 1)]
    tasks.append(("-linkages.png", "the best linkages", result.plot))
    if options.out is not None:
        begin = folder(options.out) / stem(question.mechanism.name)
        remove_rest(begin.with_name(f"{begin.name}-{k}.toml") for k in range(1, 4))  # those of an earlier search
    write_files(options, question.mechanism.name, tasks, "the linkages as model files, and a picture")
    return _search_code(result, options)


def _show_trace_page(options: argparse.Namespace) -> int:
    """Write the page on which a curve is drawn, or serve it until it is interrupted."""
    from jaxnc.viz.pages.page import TraceServer, trace_page

    if options.page:
        path = trace_page(options.page)
        list_files([(path, f"a page that needs no Python, {path.stat().st_size / 1000:.0f} kB")], options.verdict)
        return 0
    with TraceServer(options.port) as server:
        print(f"  {server.url}  draw there; Ctrl-C ends it", flush=True)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            print("  ended")
    return 0


def _search_code(result: "Result | TraceResult", options: argparse.Namespace) -> int:
    """The exit code; of an interrupted search a line on stderr says what is kept of it."""
    if not result.interrupted:
        return int(not result.found)
    search = options.checkpoint or options.resume
    kept = [f"what was found so far is in {options.out}"] if options.out is not None else []
    if search is not None and Path(search).exists():
        kept.append(f"the search is in {search}, go on with --resume {search}")
    if not options.json:  # where the verdict says it
        lost = "nothing of it is kept in a file, which --out DIR and --checkpoint FILE do"
        print(f"jaxnc: interrupted; {'; '.join(kept) or lost}", file=sys.stderr)
    return 130


def _enter_search(verdict: Verdict, result: "Result") -> None:
    """Enter the designs that a search has found."""
    problem, top = result.problem, result.problem.system.topology
    verdict.name, verdict.length_unit, verdict.angle_unit = top.name, top.length_unit, top.angle_unit
    designs = [
        Design(
            error=number(d.error),
            defects=list(d.defects),
            variables={name: float(x) for name, x in zip(problem.names, d.x, strict=True)},
        )
        for d in result.designs
    ]
    verdict.search = Search(
        screened=result.screened,
        refined=result.refined,
        stopped=result.stopped,
        unit=problem.error_unit,
        designs=designs,
    )
    verdict.assembles = verdict.moves = bool(designs) or None
    verdict.does, verdict.summary = result.found, result.verdict
    if not result.found:
        verdict.add("no-design", "error", result.verdict)
