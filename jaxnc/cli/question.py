"""Questions: what a command is to do, read and checked before JAX is imported, which takes longer than all of this."""

import argparse
import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from jaxnc.errors import InputError, OutputError, nearest
from jaxnc.io.drives import check_driven, check_poses_asked, check_run
from jaxnc.io.files import load, rebuild
from jaxnc.io.source import SUFFIXES, Source, decode, statement
from jaxnc.io.target import folder, stem
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.reporting.verdict import Entry

PAGES = ".html", ".htm"


@dataclass(frozen=True)
class Question:
    """A mechanism, and what is to be done with it."""

    title: str  # first line of the report, printed at once; empty where it was printed already
    mechanism: Mechanism
    run: record.Run  # how it is to be driven
    file: str | Path | None = None  # the model file that it stands in, for the lines of what is wrong with it
    curve: tuple[np.ndarray, bool | None] | None = None  # to be traced: its points, and whether it is closed


def read_demo(options: argparse.Namespace) -> Question | None:
    """Find a ready mechanism, driven as its library function says; or print the list of them, and return None."""
    from jaxnc.library.catalogue import CATALOGUE

    if options.list:
        descriptions = {name: make().model.description for name, make in CATALOGUE.items()}
        options.verdict.library = [Entry(name=name, description=text) for name, text in descriptions.items()]
        width = max(map(len, CATALOGUE))
        for name, text in descriptions.items():
            print(f"{name.ljust(width)}  {text}".rstrip())
        return None
    mechanism = ready_mechanism(options.name)
    run = mechanism.model.run
    if options.poses is not None:
        drives = {n: msgspec.structs.replace(d, poses=options.poses) for n, d in run.inputs.items()}
        run = msgspec.structs.replace(run, inputs=drives)
    return _question(mechanism, run, options)


def ready_mechanism(name: str) -> Mechanism:
    """A mechanism of the library by its name, or as the mechanism calls itself; in degrees."""
    from jaxnc.library.catalogue import CATALOGUE

    names = {stem(name).replace("_", "-"): name for name in CATALOGUE}
    wanted = stem(name).replace("_", "-")
    for known in [n for n in names if wanted.startswith(n)]:
        names.setdefault(stem(CATALOGUE[names[known]]().name), names[known])
    if wanted not in names:
        raise InputError(f"no ready mechanism {name!r}; {nearest(wanted, names)} `jaxnc demo --list` has all")
    mechanism = CATALOGUE[names[wanted]]()
    _use_degrees(mechanism)
    return mechanism


def _use_degrees(mechanism: Mechanism) -> None:
    """Show the angles of a mechanism, and give its drives, in degrees."""
    model = mechanism.model
    if model.units.angle == "deg":
        return
    drives = {}
    for name, drive in model.run.inputs.items():
        if name in model.angle_names:
            rate = None if drive.rate is None else math.degrees(drive.rate)
            drive = record.Drive(math.degrees(drive.start), math.degrees(drive.end), drive.poses, rate)
        drives[name] = drive
    model.units = msgspec.structs.replace(model.units, angle="deg")
    model.run = msgspec.structs.replace(model.run, inputs=drives)


def read_run(options: argparse.Namespace) -> Question:
    """Read a model file, its run section changed as the options say."""
    mechanism = load(options.file)
    return _question(mechanism, run_settings(mechanism, options), options, options.file)


def read_model(options: argparse.Namespace) -> Question:
    """Read a model file as it stands, and print its title first: reading forces imports JAX."""
    mechanism = _load_after_title(Path(options.file))
    return replace(_question(mechanism, mechanism.model.run, options, options.file), title="")


def _load_after_title(path: Path) -> Mechanism:
    source = Source(path)
    model = decode(source, record.Model)
    print(_title(model.name, model.description), flush=True)
    return rebuild(model, source, {})


def read_report(options: argparse.Namespace) -> Question:
    """Read a model file, or find a ready mechanism by its name. Options change its run section, if there is one."""
    report_path(options.out, "")
    path = Path(options.file)
    file = options.file if path.suffix.lower() in SUFFIXES or path.exists() or "/" in options.file else None
    if file is not None:
        mechanism, title = _load_after_title(path), ""
    else:
        mechanism = ready_mechanism(options.file)
        title = _title(mechanism.name, mechanism.model.description)
    given = (*options.input, *options.rate, *options.hold, options.poses, options.analysis)
    changed = bool(mechanism.model.run.inputs) or any(x is not None for x in given)
    run = run_settings(mechanism, options) if changed else mechanism.model.run
    if options.output and not changed:
        run = msgspec.structs.replace(run, outputs=split_names(options.output))
        check_run(mechanism, run)
    return Question(title, mechanism, run, file)


def report_path(out: str | None, name: str) -> Path:
    """Where a report is written: in the page that is named, or in the folder that is named, which is made."""
    path = Path(out or ".")
    if path.suffix.lower() in PAGES:
        folder(path.parent)
        return path
    if path.suffix and not path.is_dir():
        raise OutputError(f"{path}: a page is written as .html, and the name has {path.suffix!r}; end it in .html")
    return folder(path) / f"{stem(name)}-report.html"


def read_problem(options: argparse.Namespace) -> Question:
    """Read the model that a problem file is about."""
    problem, source = statement(options.file)
    mechanism = load(source.path.parent / problem.mechanism)
    subject = problem.point or problem.output or problem.body or mechanism.name
    title = f"{Path(options.file).name}: {problem.kind} of {subject}, {mechanism.name}"
    return replace(_question(mechanism, mechanism.model.run, options), title=title)


def read_modes(options: argparse.Namespace) -> Question:
    """Read a model file, its inputs where they are to stand, or one over a range: the run section of the question.

    Inputs stand where the file's begin. Where one is named that the file does not drive, the file's are not driven.
    """
    question = read_model(options)
    mechanism, own = question.mechanism, question.mechanism.model.run
    form = "NAME=VALUE, for instance phi=60; a range is given as --map NAME=FROM:TO"
    at = collect_named("--input", [_read_drive(mechanism, text, "--input", form, most=1) for text in options.input])
    if len(options.map) > 1:
        raise InputError("--map: one input goes over a range; give the others one value each by --input")
    for text in options.map:
        form = "NAME=FROM:TO or NAME=FROM:TO:VALUES, for instance phi=0:360:181"
        name, drive = _read_drive(mechanism, text, "--map", form, poses=181)
        if name in at:
            raise InputError(f"--map {text}: {name!r} is given by --input too; leave one of the two out")
        if drive.poses < 2 or not drive.start < drive.end:
            raise InputError(f"--map {text}: write {form}, from the smaller to the larger, 2 values at least")
        at[name] = msgspec.structs.replace(drive, rate=None)
    if all(name in own.inputs for name in at):
        at = {name: record.Drive(drive.start, drive.start, 1) for name, drive in own.inputs.items()} | at
    outputs = split_names(options.output) or own.outputs
    run = record.Run(at, split_names(options.hold) or own.hold, outputs=outputs)
    check_run(mechanism, msgspec.structs.replace(run, inputs={}))
    return replace(question, run=run)


def read_curve(options: argparse.Namespace) -> Question:
    """Read the curve that is to be traced; the mechanism is an empty one that bears its name."""
    if options.page is not None and options.file is None:
        plain = {"seconds": 60.0, "key": 0, "no_sliders": False, "no_pictures": False}
        for name in ("bars", "transmission", "out", "checkpoint", "resume", "closed", *plain):
            if (given := getattr(options, name)) != plain.get(name):
                told = "open" if name == "closed" and not given else name.replace("_", "-")
                raise InputError(f"trace: --{told} is for a search of a FILE, and --page draws; leave one of them out")
        return replace(_question(Mechanism("trace"), record.Run(), options), title="a page to draw a curve on")
    if options.file is None or options.page is not None:
        more = "" if options.file is None else ", not both"
        raise InputError(f"trace: give the FILE of a curve, or --page to draw one{more}")
    from jaxnc.io.curve_files import load_curve

    points, closed = load_curve(options.file)
    closed = closed if options.closed is None else options.closed
    name = Path(options.file).stem
    question = _question(Mechanism(name), record.Run(), options)
    return replace(
        question, title=f"{Path(options.file).name}: a curve of {len(points)} points", curve=(points, closed)
    )


def _question(
    mechanism: Mechanism, run: record.Run, options: argparse.Namespace, file: str | Path | None = None
) -> Question:
    if getattr(options, "out", None) is not None:
        folder(options.out)
    return Question(_title(mechanism.model.name, mechanism.model.description), mechanism, run, file)


def _title(name: str, description: str) -> str:
    return f"{name}: {description}" if description else name


# -- options that change the run section ----------------------------------------------------------------------------


def run_settings(mechanism: Mechanism, options: argparse.Namespace) -> record.Run:
    """The run section of a mechanism, changed as the options say."""
    run = mechanism.model.run
    inputs = dict(run.inputs)
    if options.input:
        inputs = collect_named("--input", [_read_drive(mechanism, text) for text in options.input])
    given = [read_pair(text, "--rate", "NAME=RATE, for instance phi=360") for text in options.rate]
    for name, rate in collect_named("--rate", given).items():
        if name not in inputs:
            raise InputError(f"--rate {name}={rate}: {name!r} is not driven; {nearest(name, inputs)}")
        value = read_number(mechanism, name, rate, f"--rate {name}={rate}")
        inputs[name] = msgspec.structs.replace(inputs[name], rate=value)
    if options.poses is not None:
        inputs = {n: msgspec.structs.replace(drive, poses=options.poses) for n, drive in inputs.items()}
    for name, drive in inputs.items():
        check_poses_asked(f"input {name!r}", drive.poses)
    if not inputs:
        free = ", ".join(_free(mechanism)[:12])
        raise InputError(
            f"{mechanism.name!r} does not say what is driven; add --input NAME=FROM:TO, or a table [run.inputs] to the "
            f"file. What may be driven, if it moves: {free}"
            if free
            else f"{mechanism.name!r} has nothing that may be driven: no angle, no distance, no point that is not fixed"
        )
    changed = msgspec.structs.replace(
        run,
        inputs=inputs,
        hold=split_names(options.hold) or run.hold,
        outputs=split_names(options.output) or run.outputs,
        analysis=options.analysis or run.analysis,
    )
    if changed.analysis == "circuit" and options.rate:
        raise InputError("--rate: nothing is driven along a circuit, so there are no rates; leave one of the two out")
    check_run(mechanism, changed)
    return changed


def _read_drive(
    mechanism: Mechanism,
    text: str,
    option: str = "--input",
    form: str = "NAME=FROM:TO or NAME=FROM:TO:POSES, for instance phi=0:360:361",
    most: int = 3,
    poses: int | None = None,
) -> tuple[str, record.Drive]:
    """Name and drive of an option: at most so many numbers; so many `poses` where none are said, or as in the file."""
    name, rest = read_pair(text, option, form)
    check_driven(mechanism, name, f"{option} {text}")
    parts = [part.strip() for part in rest.split(":")]
    if len(parts) > most or not all(parts):
        raise InputError(f"{option} {text}: write {form}")
    numbers = [read_number(mechanism, name, part, f"{option} {text}") for part in parts[:2]]
    old = mechanism.model.run.inputs.get(name)
    poses = (poses or (old.poses if old else 361)) if len(parts) == 2 else 1
    if len(parts) == 3:
        if not parts[2].isdecimal():
            raise InputError(f"{option} {text}: the number of poses is a whole number, got {parts[2]!r}")
        poses = int(parts[2])
    rate = old.rate if old else None
    if rate is not None and numbers[-1] != numbers[0]:
        rate = math.copysign(rate, numbers[-1] - numbers[0])
    return name, record.Drive(numbers[0], numbers[-1], poses, rate)


def collect_named(option: str, given: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return what an option gives by name; a name that stands twice is refused."""
    found = dict(given)
    if len(found) < len(given):
        raise InputError(f"{option}: a coordinate is given twice; give each once")
    return found


def read_pair(text: str, option: str, form: str) -> tuple[str, str]:
    """Name and value of an option ``NAME=VALUE``."""
    name, _, value = (part.strip() for part in text.partition("="))
    if not name or not value:
        raise InputError(f"{option} {text}: write {form}")
    return name, value


def read_number(mechanism: Mechanism, name: str, text: str, what: str) -> float:
    """A number in the unit of the model, or an angle with its own unit, as in ``90deg``."""
    found = re.fullmatch(r"\s*(.*?)\s*(deg|rad)?\s*", text)
    digits, unit = found.groups() if found else (text, None)
    try:
        value = float(digits)
    except ValueError:
        raise InputError(f"{what}: {text!r} is not a number") from None
    if not math.isfinite(value):
        raise InputError(f"{what}: {text!r} must be a finite number")
    if unit and name not in mechanism.model.angle_names:
        raise InputError(f"{what}: {name!r} is not an angle; leave {unit!r} out")
    if unit is None or unit == mechanism.model.units.angle:
        return value
    return math.radians(value) if unit == "deg" else math.degrees(value)


def split_names(texts: list[str]) -> list[str]:
    """Names in options that may be repeated, each of several with commas between them."""
    return [name.strip() for text in texts for name in text.split(",") if name.strip()]


def _free(mechanism: Mechanism) -> list[str]:
    """Coordinates that are not fixed, angles and distances first."""
    points = mechanism.model.points
    fixed = {name: point.fixed if isinstance(point, record.Point) else "" for name, point in points.items()}
    loose = (f"{p}.{a}" for p in points for a in mechanism.axes if a not in fixed[p])
    return [*mechanism.scalar_names, *loose, *(f"{u}.{a}" for u in mechanism.model.vectors for a in mechanism.axes)]
