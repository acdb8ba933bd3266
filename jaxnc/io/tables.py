"""Tables of a motion: CSV for people and spreadsheets, npz for programs."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError, ModelFileError, nearest
from jaxnc.io.archive import read
from jaxnc.io.target import write
from jaxnc.kinematics.inputs import angle_unit, outside
from jaxnc.status import Status

if TYPE_CHECKING:
    from jaxnc.kinematics.motion import Motion

ORDERS = ("position", "velocity", "acceleration", "jerk")
SHORT = ("", "v", "a", "j")
PER = ("", "/s", "/s^2", "/s^3")
AXES = "xyz"
_RESERVED = "time", "residual"  # columns of tables with a unit, as those of coordinates have


@public
@dataclass(frozen=True)
class Table:
    """Named arrays of a motion. Poses that failed are NaN in all of them.

    Attributes:
        name: the mechanism.
        driven: names of the inputs.
        units: unit of each quantity, ``"rad"``, ``"1"`` (unit vectors) or the length unit; rates are per second.
        positions: places ``(..., dim)`` of points and markers, directions of vectors, values ``(...,)`` of angles
            (radians) and distances.
        velocities: their time derivatives; empty if the motion carries none.
        accelerations: their second time derivatives.
        jerks: their third time derivatives.
        status: `jaxnc.Status` of each pose, ``(...,)``.
        residual: largest residual of each pose, a length, ``(...,)``.
        conditioning: estimate of each pose's reciprocal condition number, ``(...,)``; None if the motion has none.
        time: time of each pose, seconds; None if the motion is not one in time.
    """

    name: str
    driven: tuple[str, ...]
    units: dict[str, str]
    positions: dict[str, np.ndarray]
    velocities: dict[str, np.ndarray]
    accelerations: dict[str, np.ndarray]
    jerks: dict[str, np.ndarray]
    status: np.ndarray
    residual: np.ndarray
    conditioning: np.ndarray | None
    time: np.ndarray | None = None

    def __repr__(self) -> str:
        shape, failed = " × ".join(map(str, self.status.shape)) or "1", int(np.count_nonzero(self.status))
        held = self.velocities, self.accelerations, self.jerks
        rates = [noun for noun, rate in zip(ORDERS[1:], held, strict=True) if rate]
        said = f"{self.name}: {shape} pose{'s' * (shape != '1')}" + (f", {failed} of them failed" if failed else "")
        said += f", with {', '.join(rates)}" if rates else ""
        return f"{said}; " + ", ".join(f"{name} [{self.units[name]}]" for name in self.names)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities."""
        return tuple(self.positions)

    def __getitem__(self, name: str) -> np.ndarray:
        """Positions of a point or marker, or values of a coordinate."""
        if name not in self.positions:
            raise InputError(f"the table of {self.name!r} has no {name!r}; {nearest(name, self.names)}")
        return self.positions[name]


@dataclass(frozen=True)
class Listed:
    """A motion as columns, one number for each pose."""

    places: np.ndarray  # numbers of lanes and poses, (axes, poses)
    # By label ("P.x", "v(phi)"), each with its unit and values (poses,). In poses that failed inputs are those asked
    # for, time is theirs, and all else is NaN.
    columns: dict[str, tuple[str, np.ndarray]]
    status: np.ndarray  # of each pose, (poses,)
    residual: np.ndarray  # of each pose, (poses,); NaN where it failed

    @property
    def axes(self) -> list[str]:
        """What the places are called."""
        lanes = len(self.places) - 1
        return [*(["lane"] if lanes == 1 else [f"lane {k + 1}" for k in range(lanes)]), "pose"]


def listed(motion: "Motion", names: Sequence[str] | None, unit: str | None, what: str) -> Listed:
    """A motion as columns: time, inputs, places, coordinates, then their rates.

    Args:
        motion: the motion; any batch of poses of one design.
        names: points, vectors, markers and coordinates; all that moves if not given.
        unit: what angles are given in, ``"rad"`` or ``"deg"``; the mechanism's ``angle_unit`` if not given.
        what: what is asked for, for messages.
    """
    outside(motion, what)
    angles = angle_unit(motion.system.topology.angle_unit if unit is None else unit)
    status = np.asarray(motion.status)
    failed = status.reshape(-1) != 0
    places = np.indices(status.shape).reshape(status.ndim, -1) if status.ndim else np.zeros((1, 1), dtype=int)
    columns: dict[str, tuple[str, np.ndarray]] = {}
    if motion.time is not None:
        columns["time"] = "s", np.broadcast_to(np.asarray(motion.time, float), status.shape).reshape(-1)
    for order, entries in enumerate(arrays_of(motion, chosen(motion, names))):
        for name, array in entries.items():
            own = motion.system.topology.unit(name)
            turned = own == "rad" and angles == "deg"
            own = (angles if own == "rad" else own) + PER[order]
            for label, column in _spread(name, np.rad2deg(array) if turned else array, status.ndim):
                if order == 0 and label in motion.driven:
                    asked = np.asarray(motion.inputs[label], float).reshape(-1)
                    columns[label] = own, np.rad2deg(asked) if turned else asked
                else:
                    columns[f"{SHORT[order]}({label})" if order else label] = own, np.where(failed, np.nan, column)
    residual = np.where(failed, np.nan, np.asarray(motion.residual, float).reshape(-1))
    return Listed(places, columns, status.reshape(-1), residual)


def to_csv(motion: "Motion", path: str | Path, names: Sequence[str] | None = None, unit: str | None = None) -> Path:
    """Write a motion as a table, one row a pose; `jaxnc.io.load_csv` reads it back.

    Columns: pose, time if the motion has it, inputs, places of points (x, y, z), vectors and markers, coordinates, then
    their velocities ``v(…)`` and accelerations ``a(…)`` if the motion carries them, status, residual; units in the
    header. A pose that failed has the inputs asked for, its status, and no other numbers.

    Args:
        motion: the motion; any batch of poses (leading axes become columns ``lane``).
        path: file name; missing folders are created.
        names: points, vectors, markers and coordinates to write; if not given all but those of the ground.
        unit: what angles are written in, ``"rad"`` or ``"deg"``; the mechanism's ``angle_unit`` if not given.

    Raises:
        InputError: an unknown name or unit, or a batch of designs.
        OutputError: the file cannot be written.
    """
    found = listed(motion, names, unit, "to_csv()")
    if taken := [name for name in motion.system.topology.scalars if name in found.columns and name in _RESERVED]:
        raise InputError(
            f"to_csv(): a table has a column {taken[0]!r} of its own, and a coordinate has this name; call the "
            f"coordinate otherwise, leave it out with names=, or use to_npz()"
        )
    columns = {**found.columns, "residual": (motion.system.topology.length_unit, found.residual)}
    header = [f"{label} [{own}]" for label, (own, _) in columns.items()]
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*found.axes, *header[:-1], "status", header[-1]])
    failed = found.status != 0
    always = [label == "time" or label in motion.driven for label in columns]
    for i, status in enumerate(found.status.tolist()):
        numbers = [
            "" if failed[i] and not kept else f"{column[i]:.17g}"
            for kept, (_, column) in zip(always, columns.values(), strict=True)
        ]
        table.writerow([*found.places[:, i].tolist(), *numbers[:-1], Status(status).name.lower(), numbers[-1]])
    return write(path, text.getvalue().encode())


def to_npz(motion: "Motion", path: str | Path) -> Path:
    """Write all arrays of a motion; `load_npz` reads them back, and so does ``numpy.load``.

    Args:
        motion: the motion; any batch of poses.
        path: file name; missing folders are created. Angles are in radians.

    Raises:
        InputError: a batch of designs.
        OutputError: the file cannot be written.
    """
    outside(motion, "to_npz()")
    top = motion.system.topology
    failed = np.asarray(motion.status) != 0
    contents = {
        "name": np.array(top.name),
        "driven": np.array(motion.driven, dtype=np.str_),
        "names": np.array(motion.names, dtype=np.str_),
        "units": np.array([motion.system.topology.unit(name) for name in motion.names], dtype=np.str_),
        "status": np.asarray(motion.status),
        "residual": np.full(failed.shape, np.nan) if motion.residual is None else np.asarray(motion.residual),
    }
    if motion.conditioning is not None:
        contents["conditioning"] = np.asarray(motion.conditioning)
    if motion.time is not None:
        contents["time"] = np.asarray(motion.time)
    for order, entries in zip(ORDERS, arrays_of(motion, motion.names), strict=False):
        for name, array in entries.items():
            array[failed] = np.nan
            contents[f"{order}/{name}"] = array
    raw = io.BytesIO()
    np.savez_compressed(raw, **contents)
    return write(path, raw.getvalue())


@public
def load_npz(path: str | Path, mmap: bool = False) -> Table:
    """Read what `to_npz` or `jaxnc.stream` wrote.

    Args:
        path: the file.
        mmap: leave the arrays in the file and map them into memory, read-only, so that only what is looked at is read.
            Those that `to_npz` has compressed are read all the same.

    Returns:
        Its arrays by name.

    Raises:
        ModelFileError: the file is missing, damaged or not such a table.
    """
    arrays = read(path, "a table that to_npz wrote", mmap)
    try:
        names = [str(n) for n in arrays["names"]]
        pose, first, second, third = (
            {n: arrays[f"{order}/{n}"] for n in names if order == "position" or f"{order}/{n}" in arrays}
            for order in ORDERS
        )
        return Table(
            name=str(arrays["name"]),
            driven=tuple(str(n) for n in arrays["driven"]),
            units={n: str(u) for n, u in zip(names, arrays["units"], strict=True)},
            positions=pose,
            velocities=first,
            accelerations=second,
            jerks=third,
            status=arrays["status"],
            residual=arrays["residual"],
            conditioning=arrays.get("conditioning"),
            time=arrays.get("time"),
        )
    except (KeyError, ValueError, TypeError):
        raise ModelFileError(f"{path} is not a table that to_npz wrote, or is damaged; write it again") from None


def chosen(motion: "Motion", names: Sequence[str] | None) -> tuple[str, ...]:
    """Inputs first, then what is asked for: everything that moves, or the names given."""
    top = motion.system.topology
    places = (*top.points, *top.vectors)
    still = {p for i, p in enumerate(places) if all(top.fixed[i * top.dim : (i + 1) * top.dim])}
    still -= {name.partition(".")[0] for name in motion.driven}
    names = [n for n in motion.names if n not in still] if names is None else names
    return tuple(dict.fromkeys([*motion.driven, *([names] if isinstance(names, str) else names)]))


def arrays_of(motion: "Motion", names: Sequence[str]) -> list[Mapping[str, np.ndarray]]:
    """Positions by name, and as many time derivatives as the motion carries."""
    if motion.system.parameters.points.ndim != 2:
        raise InputError(
            "a table is of one design, this motion is of a batch of them; take one, for instance the first: "
            "jax.tree.map(lambda x: x[0], motion)"
        )
    orders = (motion.__getitem__, motion.velocity, motion.acceleration, motion.jerk)
    return [{n: np.array(read(n)) for n in names} for read in orders[: 1 + len(motion.rates)]]


def _spread(name: str, array: np.ndarray, batch: int) -> list[tuple[str, np.ndarray]]:
    """Columns of a quantity: one for a coordinate, one an axis for a place."""
    if array.ndim == batch:
        return [(name, array.reshape(-1))]
    return [(f"{name}.{axis}", array[..., k].reshape(-1)) for k, axis in enumerate(AXES[: array.shape[-1]])]
