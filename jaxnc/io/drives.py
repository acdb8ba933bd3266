"""The run section of a model: checked, and turned into what `jaxnc.sweep` takes."""

import math
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import TypedDict

import numpy as np

from jaxnc.errors import InputError, nearest
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record


class SweepArguments(TypedDict):
    """Arguments of `jaxnc.sweep`."""

    inputs: dict[str, np.ndarray]  # radians and lengths
    rates: dict[str, float] | None  # per second; None if no input has one
    hold: tuple[str, ...]


def sweep_arguments(mechanism: Mechanism, run: record.Run | None = None) -> SweepArguments:
    """Return what `jaxnc.sweep` takes to do as a model's run section says.

    Args:
        mechanism: the mechanism.
        run: a run section; the mechanism's own if not given. With ``angle_unit="deg"`` its numbers for inputs that are
            angles are in degrees, and are converted here.

    Returns:
        Inputs, rates and what is held, for ``sweep(system, **sweep_arguments(mechanism))``.
    """
    run = mechanism.model.run if run is None else run
    if not run.inputs:
        raise InputError(f"{mechanism.name!r}: nothing is driven; say how one of its coordinates moves")
    for name, drive in run.inputs.items():
        check_drive(name, drive)
    _check_poses(run)
    inputs, rates = {}, {}
    for name, drive in run.inputs.items():
        factor = unit_of(mechanism, name)
        values = np.linspace(drive.start, drive.end, drive.poses)
        inputs[name] = values if factor == 1.0 else values * factor
        if drive.rate is not None:
            rates[name] = drive.rate * factor
    return {"inputs": inputs, "rates": rates or None, "hold": tuple(run.hold)}


def unit_of(mechanism: Mechanism, name: str) -> float:
    """Return one unit of a coordinate in a run section in radians or lengths: π/180 for angles in degrees."""
    model = mechanism.model
    return math.pi / 180 if model.units.angle == "deg" and name in model.angle_names else 1.0


def check_run(
    mechanism: Mechanism, run: record.Run, blamed: Callable[..., AbstractContextManager] = nullcontext
) -> None:
    """Check the names and numbers of a run section."""
    places, axes, scalars = (*mechanism.all_points, *mechanism.all_vectors), mechanism.axes, _scalars(mechanism)
    markers = [*mechanism.model.markers, *(f"{p}.{a}" for p in mechanism.model.markers for a in axes)]
    for name, drive in run.inputs.items():
        with blamed(("run", "inputs", name)):
            check_driven(mechanism, name)
            check_drive(name, drive)
    with blamed(("run", "inputs")):
        _check_poses(run)
    for name in run.hold:
        with blamed(("run", "hold")):
            _check_name(name, scalars, f"there is no coordinate {name!r} to hold")
    for name in run.outputs:
        with blamed(("run", "outputs")):
            everything = [*places, *scalars, *markers]
            noun = "point, marker" if mechanism.model.dim == 2 else "point, vector, marker"
            _check_name(name, everything, f"there is no {noun} or coordinate {name!r} to show")


def check_driven(mechanism: Mechanism, name: str, what: str = "") -> None:
    """Refuse a name that is no coordinate; `what` stands before the message."""
    _check_name(name, _scalars(mechanism), f"{what}{': ' if what else ''}there is no coordinate {name!r} to drive")


def _scalars(mechanism: Mechanism) -> list[str]:
    places = *mechanism.all_points, *mechanism.all_vectors
    return [*mechanism.scalar_names, *(f"{p}.{a}" for p in places for a in mechanism.axes)]


def _check_name(name: str, names: list[str], what: str) -> None:
    if name not in names:
        raise InputError(f"{what}; {nearest(name, names)}")


def check_poses_asked(what: str, count: int) -> None:
    """Refuse more poses or times than are kept in one run: so many are taken for a slip."""
    most = 1_000_000
    if count > most:
        raise InputError(f"{what}: {count} poses; at most {most} fit in one run")


def check_drive(name: str, drive: record.Drive) -> None:
    """Refuse a drive whose numbers are not finite, or whose number of poses makes no sense."""
    for key, value in (("from", drive.start), ("to", drive.end), ("rate", drive.rate)):
        if value is not None and not math.isfinite(value):
            raise InputError(f"input {name!r}: {key} = {value} must be a finite number")
    if drive.poses < 1:
        raise InputError(f"input {name!r}: poses = {drive.poses}; give at least 1")
    check_poses_asked(f"input {name!r}", drive.poses)
    if drive.poses == 1 and drive.start != drive.end:
        raise InputError(
            f"input {name!r}: poses = 1, but it goes from {drive.start:g} to {drive.end:g}; give at least 2"
        )


def _check_poses(run: record.Run) -> None:
    counts = {name: drive.poses for name, drive in run.inputs.items()}
    if len(set(counts.values())) > 1:
        shown = ", ".join(f"{name} has {poses}" for name, poses in counts.items())
        raise InputError(f"several inputs move together and need as many poses each; {shown}")
