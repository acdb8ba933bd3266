"""Curves of files: a path of an SVG drawing, or a table of places."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jaxnc.errors import ModelFileError, counted
from jaxnc.io.svg import outline
from jaxnc.io.target import file_name

_SUFFIXES = (".svg", ".csv", ".txt", ".npy")


def load_curve(path: str | Path) -> tuple[np.ndarray, bool | None]:
    """Read a curve.

    Args:
        path: an SVG drawing, whose first path is taken; a table, ``.csv`` or ``.txt``, of x and y in the columns that
            its heading calls so, or in the first two; or an array ``(N, 2)``, ``.npy``.

    Returns:
        Its points, ``(N, 2)``, and whether it is closed; None where the file does not say.

    Raises:
        ModelFileError: the file cannot be read, or holds no curve.
    """
    path = file_name(path)
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise ModelFileError(f"{path}: a curve is read from {', '.join(_SUFFIXES[:-1])} or {_SUFFIXES[-1]}")
    if suffix == ".svg":
        found = outline(path, 400)  # points of a path
        return found.points, found.closed
    try:
        points = np.load(path) if suffix == ".npy" else read_numbers(path, 2)
    except (OSError, ValueError, EOFError) as error:
        raise ModelFileError(f"{path} cannot be read ({getattr(error, 'strerror', None) or error})") from None
    if np.iscomplexobj(points):
        raise ModelFileError(f"{path} holds complex numbers; save x and y as two columns of real ones")
    if points.ndim != 2 or points.shape[-1] < 2:
        raise ModelFileError(f"{path}: a curve needs x and y in each line; the file has the shape {points.shape}")
    return points[:, :2].astype(float), None


def read_numbers(path: Path, first: int | None = None) -> np.ndarray:
    """Read the numbers of a table, those of a curve or all; lines before the first numbers are headings.

    Columns have commas, semicolons, tabs or spaces between them; where they have semicolons or tabs, a comma is a
    decimal sign.

    Args:
        path: the file.
        first: so many columns of each line: those that a heading calls ``x``, ``y``, …, or ends so, as in ``P.x [m]``;
            else the first.

    Raises:
        ValueError: a line that is no row of numbers, or has another number of them; headings that name several curves;
            its message says which.
    """
    rows: list[list[float]] = []
    chosen = range(first or 0)  # none: all
    for number, line in enumerate(path.read_text(encoding="utf-8-sig").splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        between = ";" if ";" in line else "\t" if "\t" in line else ","
        words = [word.strip().strip('"') for word in line.strip().split(between)]
        numbers = [part for word in words for part in (word if between == "," else word.replace(",", ".")).split()]
        try:
            rows.append([float(numbers[k]) for k in (chosen or range(len(numbers))) if k < len(numbers)])
        except ValueError:
            if rows:
                raise ValueError(f"line {number}: {line.strip()[:40]!r} is not a row of numbers") from None
            chosen = _find_columns(words, first) if first else chosen
            continue
        if len(rows[-1]) != len(rows[0]) or len(rows[0]) < (first or 1):
            wanted = f"each line needs {first}" if first else "a table has as many in each row"
            raise ValueError(f"line {number}: {counted(len(rows[-1]), 'number')}, and {wanted}")
    return np.array(rows)


def _find_columns(heading: list[str], count: int) -> Sequence[int]:
    """Find the columns that a heading calls x, y and so on; the first ones where it names none."""
    names = [re.sub(r"\s*[\[(].*", "", word).lower() for word in heading]
    found = [[k for k, name in enumerate(names) if name == axis or name.endswith(f".{axis}")] for axis in "xyz"[:count]]
    if any(len(places) > 1 for places in found):
        raise ValueError(f"its columns are {', '.join(heading)}; leave x and y of one curve in it")
    return [places[0] for places in found] if all(found) else range(count)
