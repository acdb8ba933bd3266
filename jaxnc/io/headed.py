"""Tables in CSV whose header says what each column is and its unit, read back."""

import csv
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import ModelFileError, nearest
from jaxnc.io.tables import AXES, PER, SHORT, Table
from jaxnc.io.target import file_name
from jaxnc.status import Status

_HEADER = re.compile(r"(?:(?P<rate>[vaj])\((?P<inner>.+)\)|(?P<name>.+?)) \[(?P<unit>[^\[\]]*)\]")
_COUNTER = re.compile(r"pose|lane( \d+)?")
_AFTER = re.compile(r'[]]\s*"?([,;\t])')  # what stands between columns


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

    def numbered(label: str, cells: Sequence[str]) -> np.ndarray:
        """Numbers of a column, NaN where a cell is empty."""
        out = np.full(len(cells), np.nan)
        for k, cell in enumerate(cells):
            try:
                out[k] = float(cell.replace(point, ".")) if cell.strip() else np.nan
            except ValueError:
                raise ModelFileError(f"{path}, line {places[k]}, column {label!r}: {cell!r} is not a number") from None
        return out

    lanes = [label for label in header if _COUNTER.fullmatch(label)]
    counters = np.array([numbered(label, text.pop(label)) for label in lanes] or [np.arange(len(rows))])
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
        base = "deg" if base == "°" else base
        numbers = numbered(label, cells)[order].reshape(shape)
        orders[rate][name] = np.deg2rad(numbers) if base == "deg" else numbers
        read = "rad" if base == "deg" else base
        if read != (unit := units.setdefault(_place(name), "s" if name == "time" else read)):
            raise ModelFileError(f"{path}: column {label!r}: write {_place(name)!r} in one unit, here {unit}")
    time, residual = (orders[0].pop(name, None) for name in ("time", "residual"))
    first, second, third, fourth = (_joined(entries) for entries in orders)
    return Table(
        name=path.stem,
        driven=(),
        units={name: units[name] if name in units else units[_place(name)] for name in first},
        positions=first,
        velocities=second,
        accelerations=third,
        jerks=fourth,
        status=np.array([known[word] for word in words], dtype=int).reshape(shape),
        residual=np.full(shape, np.nan) if residual is None else residual,
        conditioning=None,
        time=time,
    )


def _place(name: str) -> str:
    """What a column is of: ``P`` of ``P.x``."""
    place, _, axis = name.rpartition(".")
    return place if place and axis in tuple(AXES) else name


def _joined(entries: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Places ``P`` ``(..., dim)`` in place of their columns ``P.x``, ``P.y``."""
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
