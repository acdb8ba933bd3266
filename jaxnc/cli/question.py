"""What a command was asked, read and checked before JAX is imported, which takes longer than all of this."""

import argparse
import math
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from jaxnc.cli.settings import names_of, settings
from jaxnc.errors import InputError, OutputError, nearest
from jaxnc.io.drives import check_run, is_angle
from jaxnc.io.files import load
from jaxnc.io.source import SUFFIXES, Source, decode
from jaxnc.io.statement import statement
from jaxnc.io.target import folder, stem
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.reporting.verdict import Entry, parse_expectation

PAGES = ".html", ".htm"


@dataclass(frozen=True)
class Question:
    """A mechanism, and what is to be done with it."""

    title: str  # first line of the report, printed at once; empty where it was printed already
    mechanism: Mechanism
    run: record.Run  # how it is to be driven


def demo(options: argparse.Namespace) -> Question | None:
    """A ready mechanism, driven as its library function says; None if only their list is wanted, which is printed."""
    from jaxnc.library.catalogue import CATALOGUE

    for text in options.expect:
        parse_expectation(text)
    if options.list:
        made = {name: make().model.description for name, make in CATALOGUE.items()}
        options.verdict.library = [Entry(name=name, description=said) for name, said in made.items()]
        width = max(map(len, CATALOGUE))
        for name, said in made.items():
            print(f"{name.ljust(width)}  {said}".rstrip())
        return None
    mechanism = ready(options.name)
    run = mechanism.model.run
    if options.poses is not None:
        drives = {n: msgspec.structs.replace(d, poses=options.poses) for n, d in run.inputs.items()}
        run = msgspec.structs.replace(run, inputs=drives)
    return _question(mechanism, run, options)


def ready(name: str) -> Mechanism:
    """A mechanism of the library by its name, or as it calls itself; in degrees."""
    from jaxnc.library.catalogue import CATALOGUE

    names = {stem(name).replace("_", "-"): name for name in CATALOGUE}
    wanted = stem(name).replace("_", "-")
    for known in [n for n in names if wanted.startswith(n)]:  # also as the mechanism calls itself
        names.setdefault(stem(CATALOGUE[names[known]]().name), names[known])
    if wanted not in names:
        raise InputError(f"no ready mechanism {name!r}; {nearest(wanted, names)} `jaxnc demo --list` has all")
    return in_degrees(CATALOGUE[names[wanted]]())


def in_degrees(mechanism: Mechanism) -> Mechanism:
    """The same mechanism, with its angles shown and its drives given in degrees."""
    model = mechanism.model
    if model.units.angle == "rad":
        drives = {}
        for name, drive in model.run.inputs.items():
            if is_angle(mechanism, name):
                rate = None if drive.rate is None else math.degrees(drive.rate)
                drive = record.Drive(math.degrees(drive.start), math.degrees(drive.end), drive.poses, rate)
            drives[name] = drive
        model.units = msgspec.structs.replace(model.units, angle="deg")
        model.run = msgspec.structs.replace(model.run, inputs=drives)
    return mechanism


def run(options: argparse.Namespace) -> Question:
    """A model file, with what the options change in its run section."""
    for text in options.expect:
        parse_expectation(text)
    mechanism = load(options.file)
    return _question(mechanism, settings(mechanism, options), options)


def report(options: argparse.Namespace) -> Question:
    """A model file, or a ready mechanism by its name, with what the options change in its run section if there is one.

    Its title is printed before forces are read, which bring JAX with them.
    """
    for text in options.expect:
        parse_expectation(text)
    page(options.out, "")
    path = Path(options.file)
    if path.suffix.lower() in SUFFIXES or path.exists() or "/" in options.file:
        said = decode(Source(path), record.Model)
        print(_title(said.name, said.description), flush=True)
        mechanism, title = load(path), ""
    else:
        mechanism = ready(options.file)
        title = _title(mechanism.name, mechanism.model.description)
    asked = (*options.input, *options.rate, *options.hold, options.poses, options.analysis)
    changed = bool(mechanism.model.run.inputs) or any(x is not None for x in asked)
    run = settings(mechanism, options) if changed else mechanism.model.run
    if options.output and not changed:
        run = msgspec.structs.replace(run, outputs=names_of(options.output))
        check_run(mechanism, run)
    return Question(title, mechanism, run)


def page(out: str | None, name: str) -> Path:
    """Where a report is written: a file that is a page, or one in the folder that is named, which is made."""
    path = Path(out or ".")
    if path.suffix.lower() in PAGES:
        folder(path.parent)
        return path
    if path.suffix and not path.is_dir():
        raise OutputError(f"{path}: a page is written as .html, and the name has {path.suffix!r}; end it in .html")
    return folder(path) / f"{stem(name)}-report.html"


def model(options: argparse.Namespace) -> Question:
    """A model file as it stands; what it is called is read alone, since forces bring JAX with them."""
    said = decode(Source(Path(options.file)), record.Model)
    print(_title(said.name, said.description), flush=True)
    mechanism = load(options.file)
    return replace(_question(mechanism, mechanism.model.run, options), title="")


check = simulate = compare = export = parts = model


def synthesise(options: argparse.Namespace) -> Question:
    """The model that a problem file is about."""
    said, source = statement(options.file)
    mechanism = load(source.path.parent / said.mechanism)
    found = _question(mechanism, mechanism.model.run, options)
    what = said.point or said.output or said.body or mechanism.name
    return Question(f"{Path(options.file).name}: {said.kind} of {what}, {mechanism.name}", found.mechanism, found.run)


def _question(mechanism: Mechanism, run: record.Run, options: argparse.Namespace) -> Question:
    if getattr(options, "out", None) is not None:
        folder(options.out)
    return Question(_title(mechanism.model.name, mechanism.model.description), mechanism, run)


def _title(name: str, description: str) -> str:
    return f"{name}: {description}" if description else name
