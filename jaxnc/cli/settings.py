"""What the options of `jaxnc run` change in a model's run section."""

import argparse
import math
import re

import msgspec

from jaxnc.errors import InputError, nearest
from jaxnc.io.drives import check_driven, check_run, is_angle
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record

_MANY = 1_000_000  # poses: more are taken for a slip
_POSES = 361


def settings(mechanism: Mechanism, options: argparse.Namespace) -> record.Run:
    """The run section of a mechanism, with what the command line changes in it."""
    run = mechanism.model.run
    inputs = dict(run.inputs)
    if options.input:
        given = [_drive(mechanism, text) for text in options.input]
        inputs = dict(given)
        if len(inputs) < len(given):
            raise InputError("--input: a coordinate is given twice; give each once")
    for text in options.rate:
        name, rate = pair(text, "--rate", "NAME=RATE, for instance phi=360")
        if name not in inputs:
            raise InputError(f"--rate {text}: {name!r} is not driven; {nearest(name, inputs)}")
        value = number(mechanism, name, rate, f"--rate {text}")
        inputs[name] = msgspec.structs.replace(inputs[name], rate=value)
    if options.poses is not None:
        inputs = {n: msgspec.structs.replace(drive, poses=options.poses) for n, drive in inputs.items()}
    for name, drive in inputs.items():
        if drive.poses > _MANY:
            raise InputError(f"input {name!r}: {drive.poses} poses; at most {_MANY} fit in one run")
    if not inputs:
        raise InputError(
            f"{mechanism.name!r} does not say what is driven; add --input NAME=FROM:TO, or a table [run.inputs] to the "
            f"file. What may be driven: {', '.join(_free(mechanism)[:12])}"
        )
    changed = msgspec.structs.replace(
        run,
        inputs=inputs,
        hold=names_of(options.hold) or run.hold,
        outputs=names_of(options.output) or run.outputs,
        analysis=options.analysis or run.analysis,
    )
    if changed.analysis == "circuit" and options.rate:
        raise InputError("--rate: nothing is driven along a circuit, so there are no rates; leave one of the two out")
    check_run(mechanism, changed)
    return changed


def _drive(mechanism: Mechanism, text: str) -> tuple[str, record.Drive]:
    form = "NAME=FROM:TO or NAME=FROM:TO:POSES, for instance phi=0:360:361"
    name, rest = pair(text, "--input", form)
    check_driven(mechanism, name, f"--input {text}")
    parts = rest.split(":")
    if len(parts) > 3 or not all(parts):
        raise InputError(f"--input {text}: write {form}")
    numbers = [number(mechanism, name, part, f"--input {text}") for part in parts[:2]]
    old = mechanism.model.run.inputs.get(name)
    poses = (old.poses if old else _POSES) if len(parts) == 2 else 1
    if len(parts) == 3:
        if not parts[2].isdecimal():
            raise InputError(f"--input {text}: the number of poses is a whole number, got {parts[2]!r}")
        poses = int(parts[2])
    rate = old.rate if old else None
    if rate is not None and numbers[-1] != numbers[0]:
        rate = math.copysign(rate, numbers[-1] - numbers[0])
    return name, record.Drive(numbers[0], numbers[-1], poses, rate)


def pair(text: str, option: str, form: str) -> tuple[str, str]:
    """Name and value of an option ``NAME=VALUE``."""
    name, _, value = (part.strip() for part in text.partition("="))
    if not name or not value:
        raise InputError(f"{option} {text}: write {form}")
    return name, value


def number(mechanism: Mechanism, name: str, text: str, what: str) -> float:
    """A number in the unit of the model, or an angle with its own unit, as in ``90deg``."""
    found = re.fullmatch(r"\s*(.*?)\s*(deg|rad)?\s*", text)
    digits, unit = found.groups() if found else (text, None)
    try:
        value = float(digits)
    except ValueError:
        raise InputError(f"{what}: {text!r} is not a number") from None
    if not math.isfinite(value):
        raise InputError(f"{what}: {text!r} must be a finite number")
    if unit and not is_angle(mechanism, name):
        raise InputError(f"{what}: {name!r} is not an angle; leave {unit!r} out")
    if unit is None or unit == mechanism.model.units.angle:
        return value
    return math.radians(value) if unit == "deg" else math.degrees(value)


def names_of(texts: list[str]) -> list[str]:
    """Names in options that may be repeated, each of several with commas between them."""
    return [name.strip() for text in texts for name in text.split(",") if name.strip()]


def _free(mechanism: Mechanism) -> list[str]:
    """Coordinates that are not fixed, angles and distances first."""
    points = mechanism.model.points
    fixed = {name: point.fixed if isinstance(point, record.Point) else "" for name, point in points.items()}
    loose = (f"{p}.{a}" for p in points for a in mechanism.axes if a not in fixed[p])
    return [*mechanism.scalar_names, *loose, *(f"{u}.{a}" for u in mechanism.model.vectors for a in mechanism.axes)]
