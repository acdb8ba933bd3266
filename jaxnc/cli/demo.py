"""`jaxnc demo`: a ready mechanism, analysed and drawn."""

import argparse
import math
from pathlib import Path

import msgspec

from jaxnc.cli.run import carry_out
from jaxnc.cli.written import stem
from jaxnc.errors import InputError, nearest
from jaxnc.io.drives import is_angle
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record


def demo(options: argparse.Namespace, importing: float) -> int:
    """Analyse a ready mechanism as its library function drives it.

    Args:
        options: what was asked for.
        importing: seconds that importing took.

    Returns:
        The exit code.
    """
    from jaxnc.library.catalogue import CATALOGUE

    if options.list:
        width = max(map(len, CATALOGUE))
        for name, make in CATALOGUE.items():
            print(f"{name.ljust(width)}  {make().model.description}".rstrip())
        return 0
    names = {stem(name).replace("_", "-"): name for name in CATALOGUE}
    wanted = stem(options.name).replace("_", "-")
    if wanted not in names:
        raise InputError(f"no ready mechanism {options.name!r}; {nearest(wanted, names)} `jaxnc demo --list` has all")
    mechanism = in_degrees(CATALOGUE[names[wanted]]())
    section = mechanism.model.run
    if options.poses is not None:
        drives = {n: msgspec.structs.replace(d, poses=options.poses) for n, d in section.inputs.items()}
        section = msgspec.structs.replace(section, inputs=drives)
    code = carry_out(mechanism, section, options, importing)
    print(_next(mechanism, Path(options.out) / (stem(mechanism.name) + ".toml")))
    return code


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


def _next(mechanism: Mechanism, path: Path) -> str:
    """What to try next: the model itself, written where it does not replace one that was edited."""
    if path.exists():
        return f"  next: {path} was there already and is left as it is; `jaxnc run {path}` analyses it"
    mechanism.save(path)
    return f"  next: the model is in {path}; change it, then `jaxnc run {path}`"
