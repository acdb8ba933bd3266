"""Tables of a motion: CSV for people and spreadsheets, npz for programs."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jaxnc.errors import InputError, ModelFileError, nearest
from jaxnc.io.archive import read
from jaxnc.io.target import write
from jaxnc.kinematics.inputs import angle_unit, outside
from jaxnc.status import Status

if TYPE_CHECKING:
    from jaxnc.kinematics.motion import Motion

ORDERS = ("position", "velocity", "acceleration", "jerk")
_SHORT = ("", "v", "a", "j")
_AXES = "xyz"


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

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities."""
        return tuple(self.positions)

    def __getitem__(self, name: str) -> np.ndarray:
        """Positions of a point or marker, or values of a coordinate."""
        if name not in self.positions:
            raise InputError(f"the table of {self.name!r} has no {name!r}; {nearest(name, self.names)}")
        return self.positions[name]


def to_csv(motion: "Motion", path: str | Path, names: Sequence[str] | None = None, unit: str | None = None) -> Path:
    """Write a motion as a table, one row a pose.

    Columns: pose, time if the motion has it, inputs, places of points (x, y, z), vectors and markers, coordinates, then
    their velocities ``v(…)`` and accelerations ``a(…)`` if the motion carries them, status, residual; units in the
    header. A pose that failed has the inputs asked for, its status, and no other numbers.

    Args:
        motion: the motion; any batch of poses (leading axes become columns ``lane``).
        path: file name; missing folders are created.
        names: points, vectors, markers and coordinates to write; if not given all but those of the ground.
        unit: what angles are written in, ``"rad"`` or ``"deg"``; the mechanism's ``angle_unit`` if not given.

    Returns:
        The path.

    Raises:
        InputError: an unknown name or unit, or a batch of designs.
        OutputError: the file cannot be written.
    """
    outside(motion, "to_csv()")
    top = motion.system.topology
    angles = angle_unit(top.angle_unit if unit is None else unit)
    values = arrays_of(motion, chosen(motion, names))
    status = np.asarray(motion.status)
    places = np.indices(status.shape).reshape(status.ndim, -1) if status.ndim else np.zeros((1, 1), dtype=int)
    header = [*(["lane"] if len(places) == 2 else [f"lane {k + 1}" for k in range(len(places) - 1)]), "pose"]
    columns: list[np.ndarray] = []
    if motion.time is not None:
        header.append("time [s]")
        columns.append(np.broadcast_to(np.asarray(motion.time), status.shape).reshape(-1))
    always = set(range(len(columns)))
    for order, entries in enumerate(values):
        for name, array in entries.items():
            unit = unit_of(motion, name)
            shown = np.rad2deg(array) if unit == "rad" and angles == "deg" else array
            unit = angles if unit == "rad" else unit
            unit += ("", "/s", "/s^2", "/s^3")[order]
            for label, column in _spread(name, shown, status.ndim):
                header.append((f"{_SHORT[order]}({label})" if order else label) + f" [{unit}]")
                if order == 0 and label in motion.driven:
                    always.add(len(columns))
                    asked = np.asarray(motion.inputs[label], float).reshape(-1)
                    column = np.rad2deg(asked) if unit == "deg" else asked
                columns.append(column)
    header += ["status", f"residual [{top.length_unit}]"]
    words = [Status(s).name.lower() for s in status.reshape(-1).tolist()]
    residual = np.asarray(motion.residual).reshape(-1)

    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(header)
    for i, word in enumerate(words):
        good = word == "converged"
        numbers = [f"{c[i]:.17g}" if good or k in always else "" for k, c in enumerate(columns)]
        table.writerow([*places[:, i].tolist(), *numbers, word, f"{residual[i]:.17g}" if good else ""])
    return write(path, text.getvalue().encode())


def to_npz(motion: "Motion", path: str | Path) -> Path:
    """Write all arrays of a motion; `load_npz` reads them back, and so does ``numpy.load``.

    Args:
        motion: the motion; any batch of poses.
        path: file name; missing folders are created. Angles are in radians.

    Returns:
        The path.

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
        "units": np.array([unit_of(motion, name) for name in motion.names], dtype=np.str_),
        "status": np.asarray(motion.status),
        "residual": np.asarray(motion.residual),
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


def unit_of(motion: "Motion", name: str) -> str:
    """Unit of a quantity: ``"rad"``, ``"1"`` or the mechanism's unit of length."""
    top = motion.system.topology
    if name in top.scalars and top.angles[top.scalars.index(name)]:
        return "rad"
    directions = (*top.vectors, *(m.name for m in top.markers if m.direction))
    return "1" if name.partition(".")[0] in directions else top.length_unit


def _spread(name: str, array: np.ndarray, batch: int) -> list[tuple[str, np.ndarray]]:
    """Columns of a quantity: one for a coordinate, one an axis for a place."""
    if array.ndim == batch:
        return [(name, array.reshape(-1))]
    return [(f"{name}.{axis}", array[..., k].reshape(-1)) for k, axis in enumerate(_AXES[: array.shape[-1]])]
