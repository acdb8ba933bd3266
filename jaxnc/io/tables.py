"""Tables of a motion: CSV for people, npz for programs, frames and data sets for pandas and xarray."""

import csv
import importlib
import io
import math
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc.calls import public
from jaxnc.dynamics.energy import kinetic_energy, potential_energy
from jaxnc.dynamics.simulation import Simulation
from jaxnc.errors import InputError, JaxncError, ModelFileError, nearest
from jaxnc.io.target import csv_text, file_name, read_archive, write
from jaxnc.kinematics.inputs import angle_unit, outside
from jaxnc.status import Status

if TYPE_CHECKING:
    import pandas
    import xarray

    from jaxnc.kinematics.motion import Motion
    from jaxnc.synthesis.result import Result


ORDERS = ("position", "velocity", "acceleration", "jerk")
SHORT = ("", "v", "a", "j")
PER = ("", "/s", "/s^2", "/s^3")
AXES = "xyz"
_RESERVED = "time", "residual"  # columns of tables with a unit, as those of coordinates have
_HEADER = re.compile(r"(?:(?P<rate>[vaj])\((?P<inner>.+)\)|(?P<name>.+?)) \[(?P<unit>[^\[\]]*)\]")
_COUNTER = re.compile(r"pose|lane( \d+)?")
_AFTER = re.compile(r'[]]\s*"?([,;\t])')  # what stands between columns


@public
@dataclass(frozen=True)
class Table:
    """Named arrays of a motion. Poses that failed are NaN in all arrays.

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

    def __contains__(self, name: object) -> bool:
        """Tell whether there is a quantity of this name."""
        return name in self.positions

    def __iter__(self) -> Iterator[str]:
        """Go through the names of the quantities."""
        return iter(self.positions)

    def __getitem__(self, name: str) -> np.ndarray:
        """Positions of a point or marker, or values of a coordinate."""
        if name not in self.positions:
            raise InputError(f"the table of {self.name!r} has no {name!r}; {nearest(name, self.names)}")
        return self.positions[name]


@dataclass(frozen=True)
class MotionColumns:
    """A motion as columns, one number for each pose."""

    places: np.ndarray  # numbers of lanes and poses, (axes, poses)
    # By label ("P.x", "v(phi)"), each with its unit and values (poses,). In poses that failed inputs are those asked
    # for, time is theirs, and all else is NaN.
    columns: dict[str, tuple[str, np.ndarray]]
    status: np.ndarray  # of each pose, (poses,)
    residual: np.ndarray  # of each pose, (poses,); NaN where it failed

    @property
    def axes(self) -> list[str]:
        """Names of the places."""
        lanes = len(self.places) - 1
        return [*(["lane"] if lanes == 1 else [f"lane {k + 1}" for k in range(lanes)]), "pose"]


def list_columns(motion: "Motion", names: Sequence[str] | None, unit: str | None, what: str) -> MotionColumns:
    """Return a motion as columns: time, inputs, places, coordinates, then their rates.

    Args:
        motion: the motion; any batch of poses of one design.
        names: points, vectors, markers and coordinates; all that moves if not given.
        unit: what angles are given in, ``"rad"`` or ``"deg"``; the mechanism's ``angle_unit`` if not given.
        what: what is asked for, for messages.
    """
    outside(motion, what)
    status = np.asarray(motion.status)
    places = np.indices(status.shape).reshape(status.ndim, -1) if status.ndim else np.zeros((1, 1), dtype=int)
    columns: dict[str, tuple[str, np.ndarray]] = {}
    if motion.time is not None:
        columns["time"] = "s", np.broadcast_to(np.asarray(motion.time, float), status.shape).reshape(-1)
    for order, name, own, array in read_quantities(motion, names, unit):
        for label, column in _columns_of(name, array, status.ndim):
            # An input "P.x" has been entered with the values asked for.
            if order or label == name or label not in motion.driven:
                columns[f"{SHORT[order]}({label})" if order else label] = own, column
    residual = np.where(status != 0, np.nan, np.asarray(motion.residual, float)).reshape(-1)
    return MotionColumns(places, columns, status.reshape(-1), residual)


def read_quantities(
    motion: "Motion", names: Sequence[str] | None, unit: str | None
) -> Iterator[tuple[int, str, str, np.ndarray]]:
    """Yield every quantity, inputs first, then its time derivatives: order, name, unit, and values in each pose.

    Angles are in what `unit` says. Where poses failed inputs are those asked for, and all else is NaN.
    """
    top, failed = motion.system.topology, np.asarray(motion.status) != 0
    angles = angle_unit(top.angle_unit if unit is None else unit)
    for order, entries in enumerate(arrays_of(motion, select_quantities(motion, names))):
        for name, array in entries.items():
            if order == 0 and name in motion.driven:
                array = np.asarray(motion.inputs[name], float)
            else:
                array[failed] = np.nan
            own = top.unit(name)
            turned = own == "rad" and angles == "deg"
            yield order, name, (angles if turned else own) + PER[order], np.rad2deg(array) if turned else array


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
    found = list_columns(motion, names, unit, "to_csv()")
    if taken := [name for name in motion.system.topology.scalars if name in found.columns and name in _RESERVED]:
        raise InputError(
            f"to_csv(): a table has a column {taken[0]!r} of its own, and a coordinate has this name; call the "
            f"coordinate otherwise, leave it out with names=, or use to_npz()"
        )
    columns = {**found.columns, "residual": (motion.system.topology.length_unit, found.residual)}
    header = [f"{label} [{own}]" for label, (own, _) in columns.items()]
    rows: list[list[Any]] = [[*found.axes, *header[:-1], "status", header[-1]]]
    failed = found.status != 0
    always = [label == "time" or label in motion.driven for label in columns]
    for i, status in enumerate(found.status.tolist()):
        numbers = [
            "" if failed[i] and not kept else f"{column[i]:.17g}"
            for kept, (_, column) in zip(always, columns.values(), strict=True)
        ]
        rows.append([*found.places[:, i].tolist(), *numbers[:-1], Status(status).name.lower(), numbers[-1]])
    return write(path, csv_text(rows))


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
    contents: dict[str, Any] = {**table_head(motion, motion.names), **table_arrays(motion, motion.names)}
    if motion.time is not None:
        contents["time"] = np.asarray(motion.time)
    raw = io.BytesIO()
    np.savez_compressed(raw, **contents)
    return write(path, raw.getvalue())


def table_head(motion: "Motion", names: Sequence[str]) -> dict[str, np.ndarray]:
    """Return what an npz table says of all its poses, as `load_npz` reads it."""
    units = [motion.system.topology.unit(name) for name in names]
    words = {"driven": motion.driven, "names": names, "units": units}
    return {"name": np.array(motion.system.name), **{key: np.array(v, dtype=np.str_) for key, v in words.items()}}


def table_arrays(motion: "Motion", names: Sequence[str]) -> dict[str, np.ndarray]:
    """Return the arrays of an npz table, NaN where a pose failed."""
    status = np.asarray(motion.status)
    residual = np.full(status.shape, np.nan) if motion.residual is None else np.asarray(motion.residual)
    out = {"status": status, "residual": residual}
    if motion.conditioning is not None:
        out["conditioning"] = np.asarray(motion.conditioning)
    for order, entries in zip(ORDERS, arrays_of(motion, names), strict=False):
        for name, array in entries.items():
            array[status != 0] = np.nan
            out[f"{order}/{name}"] = array
    return out


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
    arrays = read_archive(path, "a table that to_npz wrote", mmap)
    try:
        names = [str(n) for n in arrays["names"]]
        first, second, third, fourth = (
            {n: arrays[f"{order}/{n}"] for n in names if order == "position" or f"{order}/{n}" in arrays}
            for order in ORDERS
        )
        driven, units = tuple(map(str, arrays["driven"])), dict(zip(names, map(str, arrays["units"]), strict=True))
        outcome = arrays["status"], arrays["residual"], arrays.get("conditioning"), arrays.get("time")
        return Table(str(arrays["name"]), driven, units, first, second, third, fourth, *outcome)
    except (KeyError, ValueError, TypeError):
        raise ModelFileError(f"{path} is not a table that to_npz wrote, or is damaged; write it again") from None


@public
def load_csv(path: str | Path) -> Table:
    """Read what `to_csv` wrote, or any table whose header has units in the same way: ``P.x [m]``, ``v(phi) [deg/s]``.

    Args:
        path: the file; one column for each number, and ``pose`` and ``status`` as `to_csv` writes them, if it has them.
            What a spreadsheet made of it is read too: semicolons or tabs between columns, decimal commas, ``°``.

    Returns:
        Its arrays by name, angles in radians. A table does not say what was driven, so `Table.driven` is empty, and its
        name is that of the file.

    Raises:
        ModelFileError: the file is missing or not such a table; the message names line and column.
    """
    path = file_name(path)
    try:
        first, *_ = written = path.read_text(encoding="utf-8-sig").splitlines()
        found = _AFTER.search(first)
        between = found[1] if found else ","
        header, *lines = csv.reader(written, delimiter=between, skipinitialspace=True)
    except OSError as error:
        raise ModelFileError(f"{path} cannot be read ({error.strerror}); give a table that to_csv wrote") from None
    except (UnicodeDecodeError, ValueError, csv.Error):
        raise ModelFileError(f"{path} is not a table in CSV (UTF-8, a header in its first line)") from None
    header = [label.strip() for label in header]
    if twice := sorted({label for label in header if header.count(label) > 1}):
        raise ModelFileError(f"{path}: column {twice[0]!r} is there twice; names say which column is which")
    rows = [(number, line) for number, line in enumerate(lines, start=2) if any(cell.strip() for cell in line)]
    for number, line in rows:
        if len(line) != len(header):
            raise ModelFileError(f"{path}, line {number}: {len(line)} cells, and the header has {len(header)}")
    columns = zip(*(line for _, line in rows), strict=True) if rows else [()] * len(header)
    text = dict(zip(header, columns, strict=True))
    places, point = [number for number, _ in rows], "." if between == "," else ","

    def parse(label: str, cells: Sequence[str]) -> np.ndarray:
        """Read the numbers of a column, NaN where a cell is empty."""
        out = np.full(len(cells), np.nan)
        for k, cell in enumerate(cells):
            try:
                out[k] = float(cell.replace(point, ".")) if cell.strip() else np.nan
            except ValueError:
                raise ModelFileError(f"{path}, line {places[k]}, column {label!r}: {cell!r} is not a number") from None
        return out

    lanes = [label for label in header if _COUNTER.fullmatch(label)]
    counters = np.array([parse(label, text.pop(label)) for label in lanes] or [np.arange(len(rows))])
    shape = tuple(1 + int(max(last, -1)) for last in np.nan_to_num(counters).max(axis=1, initial=-1.0))
    order = np.lexsort(counters[::-1])  # lines may have been sorted by something else
    if math.prod(shape) != len(rows) or (counters[:, order] != np.indices(shape).reshape(len(shape), -1)).any():
        raise ModelFileError(f"{path}: {len(rows)} lines are no whole batch of {' × '.join(map(str, shape))} poses")
    words = np.array(text.pop("status", ["converged"] * len(rows)))[order].tolist()
    known = {s.name.lower(): int(s) for s in Status}
    if unknown := sorted(set(words) - set(known)):
        raise ModelFileError(f"{path}: status {unknown[0]!r}; {nearest(unknown[0], known)}")
    orders: list[dict[str, np.ndarray]] = [{}, {}, {}, {}]
    units: dict[str, str] = {}
    for label, cells in text.items():
        found = _HEADER.fullmatch(label)
        if not found:
            raise ModelFileError(f"{path}: column {label!r}; write a name and its unit, as in 'P.x [m]'")
        rate, own = SHORT.index(found["rate"] or ""), found["unit"]
        name = found["inner"] or found["name"]
        if rate and not own.endswith(PER[rate]):
            raise ModelFileError(f"{path}: column {label!r}: the unit of {found['rate']}(…) ends in {PER[rate]}")
        base = own.removesuffix(PER[rate])
        base = "deg" if base.lower() in ("°", "deg", "degree", "degrees") else base
        numbers = parse(label, cells)[order].reshape(shape)
        orders[rate][name] = np.deg2rad(numbers) if base == "deg" else numbers
        read = "rad" if base == "deg" else base
        if read != (unit := units.setdefault(_place_of(name), "s" if name == "time" else read)):
            raise ModelFileError(f"{path}: column {label!r}: write {_place_of(name)!r} in one unit, here {unit}")
    time, residual = (orders[0].pop(name, None) for name in ("time", "residual"))
    first, second, third, fourth = map(_join_axes, orders)
    units = {name: units[name] if name in units else units[_place_of(name)] for name in first}
    status = np.array([known[word] for word in words], dtype=int).reshape(shape)
    residual = np.full(shape, np.nan) if residual is None else residual
    return Table(path.stem, (), units, first, second, third, fourth, status, residual, None, time)


def _place_of(name: str) -> str:
    """Return what a column is of: ``P`` of ``P.x``."""
    place, _, axis = name.rpartition(".")
    return place if place and axis in tuple(AXES) else name


def _join_axes(entries: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Put places ``P`` ``(..., dim)`` in place of their columns ``P.x``, ``P.y``."""
    out: dict[str, np.ndarray] = {}
    for label, column in entries.items():
        name, _, axis = label.rpartition(".")
        if not name:
            out[label] = column
        elif axis == "x" and f"{name}.y" in entries:
            parts = [entries[f"{name}.{a}"] for a in AXES if f"{name}.{a}" in entries]
            out[name] = np.stack(parts, axis=-1)
        elif name not in out:
            out[label] = column
    return out


def select_quantities(motion: "Motion", names: Sequence[str] | None) -> tuple[str, ...]:
    """Return names of inputs, then of what is asked for: everything that moves, or the names given."""
    top = motion.system.topology
    places = (*top.points, *top.vectors)
    still = {p for i, p in enumerate(places) if all(top.fixed[i * top.dim : (i + 1) * top.dim])}
    still -= {name.partition(".")[0] for name in motion.driven}
    names = [n for n in motion.names if n not in still] if names is None else names
    return tuple(dict.fromkeys([*motion.driven, *([names] if isinstance(names, str) else names)]))


def arrays_of(motion: "Motion", names: Sequence[str]) -> list[Mapping[str, np.ndarray]]:
    """Return positions by name, and as many time derivatives as the motion carries."""
    if motion.system.parameters.points.ndim != 2:
        raise InputError(
            "a table is of one design, this motion is of a batch of them; take one, for instance the first: "
            "jax.tree.map(lambda x: x[0], motion)"
        )
    orders = (motion.__getitem__, motion.velocity, motion.acceleration, motion.jerk)
    return [{n: np.array(read(n)) for n in names} for read in orders[: 1 + len(motion.rates)]]


def _columns_of(name: str, array: np.ndarray, batch: int) -> list[tuple[str, np.ndarray]]:
    """Return the columns of a quantity: one for a coordinate, one an axis for a place."""
    if array.ndim == batch:
        return [(name, array.reshape(-1))]
    return [(f"{name}.{axis}", array[..., k].reshape(-1)) for k, axis in enumerate(AXES[: array.shape[-1]])]


# -- data frames and data sets -----------------------------------------------------------------------------------------


def to_frame(motion: "Motion", names: Sequence[str] | None = None, unit: str | None = None) -> "pandas.DataFrame":
    """Put a motion into a data frame: the columns of `jaxnc.io.tables.to_csv`, under the same names without units.

    Args:
        motion: the motion; any batch of poses, whose axes become levels of the index.
        names: points, vectors, markers and coordinates; all that moves if not given.
        unit: what angles are given in, ``"rad"`` or ``"deg"``; the mechanism's ``angle_unit`` if not given.

    Returns:
        One row for each pose. Of a simulation there are also ``"kinetic energy"`` and ``"potential energy"``.
        ``frame.attrs["units"]`` has the unit of each column, ``frame.attrs["name"]`` and ``["driven"]`` whose motion it
        is. A pose that failed has the inputs asked for and its status, else NaN. A coordinate that is called as one
        of these columns has a ``_`` behind its name.

    Raises:
        InputError: an unknown name or unit, or a batch of designs.
        JaxncError: pandas is not installed.
    """
    found = list_columns(motion, names, unit, "to_frame()")
    pandas = _package("pandas", "to_frame()")
    energies = _energies(motion)
    taken = {"status", "residual", *energies}
    columns = {f"{label}_" if label in taken else label: column for label, column in found.columns.items()}
    units = {label: own for label, (own, _) in columns.items()}
    data: dict[str, object] = {label: column for label, (_, column) in columns.items()}
    words = [Status(s).name.lower() for s in found.status.tolist()]
    data |= {"status": pandas.Categorical(words, [s.name.lower() for s in Status]), "residual": found.residual}
    top = motion.system.topology
    units["residual"] = top.length_unit
    for label, energy in energies.items():
        data[label], units[label] = np.where(found.status != 0, np.nan, energy.reshape(-1)), top.load_unit("energy")
    index: Any = pandas.RangeIndex(len(words), name="pose")
    if len(found.axes) > 1:
        index = pandas.MultiIndex.from_arrays(list(found.places), names=found.axes)
    frame = pandas.DataFrame(data, index=index)
    frame.attrs = {"name": motion.system.name, "driven": list(motion.driven), "units": units}
    return frame


def to_xarray(motion: "Motion", names: Sequence[str] | None = None, unit: str | None = None) -> "xarray.Dataset":
    """Put a motion into a data set with named dimensions, and the unit of each array in its ``attrs["units"]``.

    ``position`` is ``(pose, point, axis)``, and so are ``velocity``, ``acceleration`` and ``jerk`` if the motion has
    them; in space ``direction`` is ``(pose, vector, axis)``. Angles, distances and single coordinates are arrays
    ``(pose)`` under their own names, their rates under ``v(…)``, ``a(…)`` and ``j(…)``. Inputs and time are coordinates
    of the pose. Of a simulation there are also ``kinetic energy`` and ``potential energy``.

    Args:
        motion: the motion; any batch of poses, whose further axes are ``lane``, or ``lane 1``, ``lane 2``, …
        names: points, vectors, markers and coordinates; all that moves if not given.
        unit: what angles are given in, ``"rad"`` or ``"deg"``; the mechanism's ``angle_unit`` if not given.

    Returns:
        The data set. Poses that failed are NaN, but for the inputs, which are those asked for. A coordinate that is
        called as one of the arrays above has a ``_`` behind its name.

    Raises:
        InputError: an unknown name or unit, or a batch of designs.
        JaxncError: xarray is not installed.
    """
    outside(motion, "to_xarray()")
    xarray = _package("xarray", "to_xarray()")
    top = motion.system.topology
    status = np.asarray(motion.status)
    lanes = status.ndim - 1
    over = tuple(["lane"] if lanes == 1 else [f"lane {k + 1}" for k in range(lanes)]) + ("pose",) * (status.ndim > 0)
    axes = list(AXES[: top.dim])
    spread: dict[tuple[str, int], dict[str, np.ndarray]] = defaultdict(dict)  # by dimension and order
    numbers: dict[str, tuple] = {}
    inputs: dict[str, tuple] = {}
    for order, name, own, values in read_quantities(motion, names, unit):
        if values.ndim > status.ndim:
            spread["vector" if top.is_direction(name) else "point", order][name] = values
            continue
        attrs = {"units": own, "long_name": f"{ORDERS[order]} of {name}" if order else name}
        if order == 0 and name in motion.driven:
            inputs[name] = over, values, attrs
        else:
            numbers[f"{SHORT[order]}({name})" if order else name] = over, values, attrs
    arrays: dict[str, tuple] = {}
    more: dict[str, object] = {"axis": axes}
    for dimension, order in sorted(spread):
        own = top.length_unit if dimension == "point" else "1"
        noun = ORDERS[order] if dimension == "point" else f"{SHORT[order]}(direction)" if order else "direction"
        attrs = {"units": own + PER[order], "long_name": f"{ORDERS[order]} of each {dimension}"}
        arrays[noun] = (*over, dimension, "axis"), np.stack([*spread[dimension, order].values()], axis=-2), attrs
        more[dimension] = [*spread[dimension, order]]
    length = {"units": top.length_unit, "long_name": "largest residual of the constraints"}
    meanings = {"flag_values": [int(s) for s in Status], "flag_meanings": " ".join(s.name.lower() for s in Status)}
    arrays["status"] = over, status, meanings
    arrays["residual"] = over, np.where(status != 0, np.nan, np.asarray(motion.residual, float)), length
    if motion.conditioning is not None:
        attrs = {"units": "1", "long_name": "reciprocal condition number, estimated"}
        arrays["conditioning"] = over, np.asarray(motion.conditioning, float), attrs
    for label, energy in _energies(motion).items():
        arrays[label] = (
            over,
            np.where(status != 0, np.nan, energy),
            {"units": top.load_unit("energy"), "long_name": label},
        )
    if motion.time is not None:
        more["time"] = over, np.broadcast_to(np.asarray(motion.time, float), status.shape), {"units": "s"}
    for dimension, size in zip(over, status.shape, strict=True):
        more[dimension] = np.arange(size)
    taken = {*arrays, *more, "point", "vector"}

    def free(own: dict[str, tuple]) -> dict[str, tuple]:
        return {f"{label}_" if label in taken else label: entry for label, entry in own.items()}

    attrs = {"name": top.name, "driven": ", ".join(motion.driven)}
    return xarray.Dataset({**arrays, **free(numbers)}, {**more, **free(inputs)}, attrs)


def designs_to_frame(result: "Result") -> "pandas.DataFrame":
    """Put what a search has found into a data frame: a row for each design, best first, numbered from 1.

    Args:
        result: what was found.

    Returns:
        Its columns are error, largest, rms, type, transmission (radians), size, starts, converged, optimality,
        feasibility, defects, the unknowns under their names in the problem, and the lengths of links, ``"length B-C"``.
        ``frame.attrs["units"]`` has the unit of each.

    Raises:
        JaxncError: pandas is not installed.
    """
    pandas = _package("pandas", "to_frame()")
    problem = result.problem
    length = problem.system.topology.length_unit
    rows = []
    for d in result.designs:
        row: dict[str, object] = {"error": d.error, "largest": d.largest, "rms": d.rms, "type": d.type}
        row |= {"transmission": d.transmission}
        row |= {f"size {axis}": size for axis, size in zip(AXES, d.size, strict=False)}
        row |= {"starts": d.starts, "converged": d.converged, "optimality": d.optimality, "feasibility": d.feasibility}
        row |= {"defects": "; ".join(d.defects)}
        row |= {f"unknown {name}": float(x) for name, x in zip(problem.names, d.x, strict=True)}
        rows.append(row | {f"length {name}": value for name, value in d.lengths.items()})
    frame = pandas.DataFrame(rows, index=pandas.RangeIndex(1, len(rows) + 1, name="design"))
    units = {"error": problem.error_unit, "largest": problem.unit, "rms": problem.unit, "transmission": "rad"}
    units |= {label: length for label in frame.columns if label.startswith(("size ", "length "))}
    frame.attrs = {"name": problem.name, "units": units}
    return frame


def _energies(motion: "Motion") -> dict[str, np.ndarray]:
    """Return the energies of a simulation, by name."""
    if not isinstance(motion, Simulation):
        return {}
    found = {"kinetic energy": kinetic_energy, "potential energy": potential_energy}
    return {label: np.asarray(energy(motion), float) for label, energy in found.items()}


def _package(name: str, what: str) -> ModuleType:
    """Import a package that is installed only where it is wanted."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise JaxncError(f'{what} needs {name}: pip install "jaxnc[{name}]" (or pip install {name})') from None
