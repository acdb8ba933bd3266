"""What a command was asked, read and checked before JAX is imported, which takes longer than all of this."""

import argparse
import math
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from jaxnc.cli.settings import settings
from jaxnc.errors import InputError, nearest
from jaxnc.io.drives import is_angle
from jaxnc.io.files import load
from jaxnc.io.schema import decode
from jaxnc.io.source import Source
from jaxnc.io.statement import statement
from jaxnc.io.target import folder, stem
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record


@dataclass(frozen=True)
class Question:
    """A mechanism, and what is to be done with it.

    Attributes:
        title: first line of the report, printed at once; empty where it was printed already.
        mechanism: the mechanism.
        run: how it is to be driven.
    """

    title: str
    mechanism: Mechanism
    run: record.Run


def demo(options: argparse.Namespace) -> Question | None:
    """A ready mechanism, driven as its library function says; None if only their list is wanted, which is printed."""
    from jaxnc.library.catalogue import CATALOGUE

    if options.list:
        width = max(map(len, CATALOGUE))
        for name, make in CATALOGUE.items():
            print(f"{name.ljust(width)}  {make().model.description}".rstrip())
        return None
    names = {stem(name).replace("_", "-"): name for name in CATALOGUE}
    wanted = stem(options.name).replace("_", "-")
    for name in [n for n in names if wanted.startswith(n)]:  # also as the mechanism calls itself
        names.setdefault(stem(CATALOGUE[names[name]]().name), names[name])
    if wanted not in names:
        raise InputError(f"no ready mechanism {options.name!r}; {nearest(wanted, names)} `jaxnc demo --list` has all")
    mechanism = in_degrees(CATALOGUE[names[wanted]]())
    run = mechanism.model.run
    if options.poses is not None:
        drives = {n: msgspec.structs.replace(d, poses=options.poses) for n, d in run.inputs.items()}
        run = msgspec.structs.replace(run, inputs=drives)
    return _question(mechanism, run, options)


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
    mechanism = load(options.file)
    return _question(mechanism, settings(mechanism, options), options)


def model(options: argparse.Namespace) -> Question:
    """A model file as it stands; what it is called is read alone, since forces bring JAX with them."""
    said = decode(Source(Path(options.file)))
    print(_title(said.name, said.description), flush=True)
    mechanism = load(options.file)
    return replace(_question(mechanism, mechanism.model.run, options), title="")


check = simulate = compare = model


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
