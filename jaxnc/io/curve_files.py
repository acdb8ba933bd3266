"""Curves of files: a path of an SVG drawing, or a table of places."""

import re
from pathlib import Path

import numpy as np

from jaxnc.errors import ModelFileError
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
        points = np.load(path) if suffix == ".npy" else _read_table(path)
    except (OSError, ValueError, EOFError) as error:
        raise ModelFileError(f"{path} cannot be read ({getattr(error, 'strerror', None) or error})") from None
    if points.ndim != 2 or points.shape[-1] < 2:
        raise ModelFileError(f"{path}: a curve needs x and y in each line; the file has the shape {points.shape}")
    return points[:, :2].astype(float), None


def _read_table(path: Path) -> np.ndarray:
    """Read numbers line by line; lines before the first numbers are headings."""
    rows: list[list[float]] = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        words = [word for word in re.split(r"[,;\s]+", line.strip()) if word]
        if not words or line.lstrip().startswith("#"):
            continue
        try:
            rows.append([float(word) for word in words[:2]])
        except ValueError:
            if rows:
                raise ValueError(f"line {number}: {line.strip()[:40]!r} is no pair of numbers") from None
    if any(len(row) != 2 for row in rows):
        raise ValueError("each line needs two numbers, x and y")
    return np.array(rows, dtype=float).reshape(-1, 2)
