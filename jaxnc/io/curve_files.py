"""Curves of files: a path of an SVG drawing, or a table of places."""

import re
from pathlib import Path

import numpy as np

from jaxnc.errors import ModelFileError, counted
from jaxnc.io.svg import outline
from jaxnc.io.target import file_name

_SUFFIXES = (".svg", ".csv", ".txt", ".npy")


def load_curve(path: str | Path) -> tuple[np.ndarray, bool | None]:
    """Read a curve.

    Args:
        path: an SVG drawing, whose first path is taken; a table of x and y in its first two columns, ``.csv`` or
            ``.txt``; or an array ``(N, 2)``, ``.npy``.

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
    if points.ndim != 2 or points.shape[-1] < 2:
        raise ModelFileError(f"{path}: a curve needs x and y in each line; the file has the shape {points.shape}")
    return points[:, :2].astype(float), None


def read_numbers(path: Path, first: int | None = None) -> np.ndarray:
    """Read the numbers of a table, the `first` of each line or all; lines before the first numbers are headings.

    Raises:
        ValueError: a line that is no row of numbers, or has another number of them; its message says which.
    """
    rows: list[list[float]] = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        words = [word for word in re.split(r"[,;\s]+", line.strip()) if word]
        if not words or line.lstrip().startswith("#"):
            continue
        try:
            rows.append([float(word) for word in words[:first]])
        except ValueError:
            if rows:
                raise ValueError(f"line {number}: {line.strip()[:40]!r} is not a row of numbers") from None
            continue
        if len(rows[-1]) != len(rows[0]) or len(rows[0]) < (first or 1):
            wanted = f"each line needs {first}" if first else "a table has as many in each row"
            raise ValueError(f"line {number}: {counted(len(rows[-1]), 'number')}, and {wanted}")
    return np.array(rows)
