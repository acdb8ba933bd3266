"""Curves of files: a path of an SVG drawing, or a table of places.

A path becomes points at equal distances along it. Path data and transformations are those of Scalable Vector Graphics 2
(W3C), chapters 8 and 9; arcs are brought to their centres as its appendix B.2.4 has it.
"""

import dataclasses
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.polynomial import polynomial

from jaxnc.calls import public
from jaxnc.errors import InputError, ModelFileError, counted, nearest
from jaxnc.io.target import file_name

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
_UNSEEN = {"defs", "clipPath", "mask", "marker", "pattern", "symbol"}
_SHAPES = ("circle", "ellipse", "rect", "line", "polyline", "polygon", "text", "use")
_PARTS = 64  # of a segment, when lengths along it are measured
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


@public
@dataclasses.dataclass(frozen=True)
class Outline:
    """Points along a curve.

    Attributes:
        points: ``(M, 2)``; of a closed curve the first is not repeated at the end.
        closed: whether the curve is closed.
        length: of the whole curve, in the unit of the points.
    """

    points: np.ndarray
    closed: bool
    length: float


@public
def outline(
    path: str | Path,
    count: int,
    id: str | None = None,
    piece: int | None = None,
    size: float | None = None,
    centre: tuple[float, float] | None = None,
    up: bool = True,
) -> Outline:
    """Read a path of an SVG file as points at equal distances along it.

    Args:
        path: the file; of its elements only ``<path>`` is read, with the transformations of the groups around it.
        count: how many points.
        id: of the path; the first one that is shown if not given.
        piece: number of the piece, from 0, of a path that lifts its pen.
        size: the larger one of width and height that the curve shall have; as drawn if not given.
        centre: where the middle of its width and height shall be; as drawn if not given.
        up: whether y shall point up; in the file it points down.

    Returns:
        The points. Corners lie between points unless they happen to be at a multiple of the distance.

    Raises:
        ModelFileError: the file cannot be read, has no such path, or path data that is not understood.
        InputError: a count below 3, a size that is not positive.
    """
    path = file_name(path)
    if count < 3:
        raise InputError(f"outline: count={count!r}; give at least 3 points")
    if size is not None and not 0 < size < np.inf:
        raise InputError(f"outline: size={size!r} must be positive")
    if centre is not None and (np.shape(centre) != (2,) or not np.isfinite(centre).all()):
        raise InputError(f"outline: centre={centre!r} must be two finite numbers (x, y)")
    data, matrix, label = _find_path(path, id)
    pieces = _read_path(data, f"{path}, {label}")
    if piece is None and len(pieces) > 1:
        raise ModelFileError(
            f"{path}, {label}: it has {len(pieces)} pieces, a curve is one; leave one in the drawing, or choose it in "
            f"Python: outline(…, piece=0 … {len(pieces) - 1})"
        )
    if not 0 <= (piece or 0) < len(pieces):
        raise ModelFileError(f"{path}, {label}: no piece {piece}; it has {len(pieces)}, counted from 0")
    segments, closed = pieces[piece or 0]
    flip = np.diag([1.0, -1.0 if up else 1.0])
    curve = _Path([s.map(flip @ matrix[:, :2], flip @ matrix[:, 2]) for s in segments], f"{path}, {label}")
    low, high = curve.box()
    factor = 1.0 if size is None else size / float(np.max(high - low))
    middle = 0.5 * (low + high)
    at = middle if centre is None else np.asarray(centre, dtype=float)
    found = at + factor * (curve.spread_points(count, closed) - middle)
    return Outline(found, closed, factor * curve.length)


# -- the file --------------------------------------------------------------------------------------------------------


def _find_path(path: Path, id: str | None) -> tuple[str, np.ndarray, str]:
    """Find data of a path, its transformation ``(2, 3)``, and what messages call it."""
    try:
        root = ElementTree.fromstring(path.read_bytes())
    except OSError as error:
        raise ModelFileError(f"{path} cannot be read ({error.strerror})") from None
    except ElementTree.ParseError as error:
        raise ModelFileError(f"{path} is not a drawing in SVG ({error})") from None
    if _tag(root) != "svg":
        raise ModelFileError(f"{path} is not a drawing in SVG: its first element is <{_tag(root)}>")
    every = [(e, m, shown) for e, m, shown in _elements(root, np.eye(2, 3), str(path)) if _tag(e) == "path"]
    found = [(e, m) for e, m, shown in every if shown or id is not None]
    if every and not found:
        raise ModelFileError(f"{path}: none of its paths is shown; give the id of one")
    if not found:
        others = sorted({_tag(e) for e in root.iter()} & set(_SHAPES))
        hint = f"; turn <{'>, <'.join(others)}> into paths in the drawing program" if others else ""
        raise ModelFileError(f"{path} has no <path>{hint}")
    if id is not None:
        names = [e.get("id", "") for e, _ in found]
        if id not in names:
            raise ModelFileError(f"{path} has no path with id {id!r}; {nearest(id, [n for n in names if n])}")
        found = [found[names.index(id)]]
    element, matrix = found[0]
    label = f"path {element.get('id')!r}" if element.get("id") else "its first path"
    return element.get("d", ""), matrix, label


def _elements(element: ElementTree.Element, matrix: np.ndarray, where: str, shown: bool = True) -> Iterator[tuple]:
    """Yield elements in the order in which they are drawn, each with its transformation and whether it is shown."""
    matrix = _combine(matrix, _transform(element.get("transform", ""), where))
    style = dict(re.findall(r"([\w-]+)\s*:\s*([\w-]+)", element.get("style", "")))
    shown = shown and style.get("display", element.get("display")) != "none"
    yield element, matrix, shown
    for child in element:
        if _tag(child) not in _UNSEEN:
            yield from _elements(child, matrix, where, shown)


def _tag(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def _combine(outer: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """Combine affine maps, each ``(2, 3)``, the inner one first."""
    return np.column_stack([outer[:, :2] @ inner[:, :2], outer[:, :2] @ inner[:, 2] + outer[:, 2]])


def _transform(text: str, where: str) -> np.ndarray:
    out = np.eye(2, 3)
    rest = re.sub(r"(\w+)\s*\(([^()]*)\)", "", text).strip(" ,\t\r\n")
    if rest:
        raise ModelFileError(f"{where}: transform={text!r} is not understood")
    for name, inside in re.findall(r"(\w+)\s*\(([^()]*)\)", text):
        v = [float(n) for n in _NUMBER.findall(inside)]
        match name, v:
            case "matrix", [a, b, c, d, e, f]:
                one = np.array([[a, c, e], [b, d, f]])
            case "translate", [x, *y] if len(y) < 2:
                one = np.array([[1.0, 0.0, x], [0.0, 1.0, y[0] if y else 0.0]])
            case "scale", [x, *y] if len(y) < 2:
                one = np.array([[x, 0.0, 0.0], [0.0, y[0] if y else x, 0.0]])
            case "rotate", [angle, *at] if len(at) in (0, 2):
                c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
                turn, at = np.array([[c, -s], [s, c]]), np.array(at or [0.0, 0.0])
                one = np.column_stack([turn, at - turn @ at])
            case "skewX", [angle]:
                one = np.array([[1.0, np.tan(np.radians(angle)), 0.0], [0.0, 1.0, 0.0]])
            case "skewY", [angle]:
                one = np.array([[1.0, 0.0, 0.0], [np.tan(np.radians(angle)), 1.0, 0.0]])
            case _:
                raise ModelFileError(f"{where}: transform {name}({inside}) is not understood")
        out = _combine(out, one)
    return out


# -- the path --------------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class _Segment:
    """A curve over t from 0 to 1: coefficients ``(n, 2)`` of powers of t, or of 1, cos and sin of an angle."""

    coefficients: np.ndarray
    angles: tuple[float, float] | None = None  # of an arc: where it begins, and how far it goes

    @classmethod
    def through(cls, *points: np.ndarray) -> "_Segment":
        """Make a Bézier curve of its control points."""
        degree = len(points) - 1
        return cls(np.array([math.comb(degree, k) * np.diff(points, k, axis=0)[0] for k in range(degree + 1)]))

    def map(self, matrix: np.ndarray, shift: np.ndarray) -> "_Segment":
        out = self.coefficients @ matrix.T
        out[0] += shift
        return dataclasses.replace(self, coefficients=out)

    def at(self, t: np.ndarray, order: int = 0) -> np.ndarray:
        """Return points ``(..., 2)``, or with an order of 1 their derivatives by t."""
        if self.angles is None:
            powers = polynomial.polyder(self.coefficients, order)
            return np.stack([t**k for k in range(len(powers))], axis=-1) @ powers
        angle, sweep = self.angles[0] + t * self.angles[1] + order * np.pi / 2, self.angles[1]
        basis = [np.full_like(t, 1 - order), sweep**order * np.cos(angle), sweep**order * np.sin(angle)]
        return np.stack(basis, axis=-1) @ self.coefficients


def _arc(a: np.ndarray, rx: float, ry: float, tilt: float, large: bool, forward: bool, b: np.ndarray) -> _Segment:
    """Make an arc between two points by its radii; a straight line if a radius is zero."""
    rx, ry = abs(rx), abs(ry)
    if rx == 0.0 or ry == 0.0:
        return _Segment.through(a, b)
    c, s = np.cos(np.radians(tilt)), np.sin(np.radians(tilt))
    turn = np.array([[c, -s], [s, c]])
    half = turn.T @ (a - b) / 2 / [rx, ry]  # where both ends lie on the unit circle about `middle`
    square = float(half @ half)
    grow = max(1.0, np.sqrt(square))  # radii that are too small for the distance are enlarged
    half, square = half / grow, min(square, 1.0)
    off = np.sqrt(max(1.0 / square - 1.0, 0.0)) * np.array([half[1], -half[0]])
    middle = off if large != forward else -off
    first, last = half - middle, -half - middle
    begin, end = np.arctan2(first[1], first[0]), np.arctan2(last[1], last[0])
    sweep = np.mod(end - begin, 2 * np.pi) if forward else -np.mod(begin - end, 2 * np.pi)
    axes = turn * (grow * np.array([rx, ry]))
    return _Segment(np.vstack([(a + b) / 2 + axes @ middle, axes.T]), (float(begin), float(sweep)))


def _commands(data: str, where: str) -> Iterator[tuple[str, list[float]]]:
    """Yield commands with their numbers, repeated ones written out."""
    for letter, inside in re.findall(r"([A-Za-z]|^[^A-Za-z]+)([^A-Za-z]*(?:[eE][+-]?\d[^A-Za-z]*)*)", data.strip()):
        if letter.upper() not in _COUNTS:
            raise ModelFileError(f"{where}: path data has {letter.strip()[:12]!r}; commands are {' '.join(_COUNTS)}")
        count, numbers = _COUNTS[letter.upper()], _command_numbers(letter, inside, where)
        if count == 0 and not numbers:
            yield letter, []
            continue
        if not numbers or count == 0 or len(numbers) % count:
            raise ModelFileError(f"{where}: {letter} takes {count} numbers each time, got {len(numbers)}")
        for k in range(0, len(numbers), count):
            yield letter, numbers[k : k + count]
            letter = {"M": "L", "m": "l"}[letter] if letter in "Mm" else letter


def _command_numbers(letter: str, text: str, where: str) -> list[float]:
    """Read numbers of a command; the two flags of an arc may stand without anything between them."""
    out, at = [], 0
    while True:
        at += len(text[at:]) - len(text[at:].lstrip(" ,\t\r\n"))
        if at == len(text):
            return out
        flag = letter in "Aa" and len(out) % 7 in (3, 4)
        found = re.compile(r"[01]").match(text, at) if flag else _NUMBER.match(text, at)
        if found is None:
            raise ModelFileError(
                f"{where}: {text[at : at + 12]!r} after {letter} is not {'a flag' if flag else 'a number'}"
            )
        out.append(float(found[0]))
        at = found.end()


def _read_path(data: str, where: str) -> list[tuple[list[_Segment], bool]]:
    """Read the segments of each piece of a path, and whether it is closed."""
    out: list[tuple[list[_Segment], bool]] = []
    here = start = np.zeros(2)
    control, before = here, ""
    some: list[_Segment] = []
    for letter, v in _commands(data, where):
        kind = letter.upper()
        if not before and kind != "M":
            raise ModelFileError(f"{where}: path data begins with {letter}; it must begin with M")
        base = here if letter.islower() else np.zeros(2)
        if kind == "M":
            out += _end_piece(some, start, here)
            some, here = [], base + v
            start = control = here
        elif kind == "Z":
            if np.any(here != start):
                some.append(_Segment.through(here, start))
            out += [(some, True)] if some else []
            some, here = [], start
            control = here
        else:
            # A smooth curve takes up the last control point of one of its own kind, mirrored.
            mirrored = 2 * here - control if before in {"S": "CS", "T": "QT"}.get(kind, "") else here
            if kind == "H":
                end = np.array([base[0] + v[0], here[1]])
            elif kind == "V":
                end = np.array([here[0], base[1] + v[0]])
            else:
                end = base + v[-2:]
            control = end
            if kind == "A":
                some.append(_arc(here, v[0], v[1], v[2], bool(v[3]), bool(v[4]), end))
            elif kind in "CSQT":
                inner = [base + v[k : k + 2] for k in range(0, len(v) - 2, 2)]
                inner = [mirrored, *inner] if kind in "ST" else inner
                some.append(_Segment.through(here, *inner, end))
                control = inner[-1]
            else:
                some.append(_Segment.through(here, end))
            here = end
        before = kind
    out += _end_piece(some, start, here)
    if not out:
        raise ModelFileError(f"{where}: its path data draws nothing")
    return out


def _end_piece(segments: list[_Segment], start: np.ndarray, end: np.ndarray) -> list[tuple[list[_Segment], bool]]:
    """List a piece, if anything was drawn; it is closed where its ends meet, but for the rounding of added steps."""
    size = np.max([np.abs(s.at(np.array(0.5)) - start) for s in segments], initial=0.0)
    return [(segments, bool(np.abs(end - start).max() <= 1e-6 * size))] if segments else []


class _Path:
    """Segments one after another, by the length along them."""

    def __init__(self, segments: list[_Segment], where: str):
        self.segments = segments
        edges = np.linspace(0.0, 1.0, _PARTS + 1)
        lengths = np.concatenate([_arc_length(s, edges[:-1], edges[1:]) for s in segments])
        self.along = np.concatenate([[0.0], np.cumsum(lengths)])
        self.length = float(self.along[-1])
        if not (np.isfinite(self.length) and self.length > 0):
            raise ModelFileError(f"{where}: its path has no length")

    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the lower left and the upper right corner, from many points."""
        some = np.concatenate([s.at(np.linspace(0.0, 1.0, 16 * _PARTS + 1)) for s in self.segments])
        return some.min(axis=0), some.max(axis=0)

    def spread_points(self, count: int, closed: bool) -> np.ndarray:
        """Return points at equal distances along the curve; the ends of an open one are among them."""
        wanted = self.length * np.arange(count) / (count if closed else count - 1)
        part = np.clip(np.searchsorted(self.along, wanted, side="right") - 1, 0, len(self.along) - 2)
        out = np.empty((count, 2))
        for k, (n, s) in enumerate(zip(part, wanted, strict=True)):
            segment, begin = self.segments[n // _PARTS], (n % _PARTS) / _PARTS
            low, high = begin, begin + 1.0 / _PARTS
            for _ in range(60):  # to the last digit by halving: the speed may be zero at an end
                t = 0.5 * (low + high)
                less = self.along[n] + _arc_length(segment, np.array([begin]), np.array([t]))[0] < s
                low, high = (t, high) if less else (low, t)
            out[k] = segment.at(np.array([0.5 * (low + high)]))[0]
        return out


def _arc_length(segment: _Segment, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Measure parts of a segment, by Gauss's rule."""
    half = 0.5 * (end - begin)
    t = begin[:, None] + half[:, None] * (_NODES + 1.0)
    return half * (np.linalg.norm(segment.at(t, 1), axis=-1) @ _WEIGHTS)


# -- curves of files ---------------------------------------------------------------------------------------------------


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
    if points.dtype.kind not in "iuf":
        raise ModelFileError(f"{path} holds values of the type {points.dtype}; save x and y as real numbers")
    if not points.size:
        raise ModelFileError(f"{path} holds no numbers; save x and y in each row")
    if points.ndim != 2 or points.shape[1] != 2:
        raise ModelFileError(
            f"{path}: a curve needs x and y in each row, shape (N, 2); the file has the shape {points.shape}: save "
            f"points.T if points are its columns, points[:, :2] if more than x and y stand in a row"
        )
    return points.astype(float), None


def read_numbers(path: Path, first: int | None = None) -> np.ndarray:
    """Read the numbers of a table, those of a curve or all; lines before them in which no cell is one are headings.

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
    chosen, heading = range(first or 0), list[str]()  # none: all
    for number, line in enumerate(path.read_text(encoding="utf-8-sig").splitlines(), 1):
        text = line.strip().rstrip(",; \t")
        if not text or text.startswith("#"):
            continue
        between = ";" if ";" in text else "\t" if "\t" in text else ","
        words = [word.strip().strip('"') for word in text.split(between)]
        words = words if between == "," else [word.replace(",", ".") for word in words]
        if not rows and not any(map(_is_numeric, words if len(words) > 1 else text.split())):
            # Names with spaces between them may stand in quotes, and have units in brackets behind them.
            apart = re.findall(r'"[^"]*"|[^\s\[("]+(?:\s*[\[(][^\])]*[\])])?', text)
            names = words if len(words) > 1 else [name.strip('"') for name in apart]
            heading = names if _find_columns(names, first or 0) else heading
            continue
        numbers = [part for word in words for part in word.split() or [""]]
        # A title is no heading: it has another number of words.
        if not rows and len(heading) == len(numbers):
            chosen = _find_columns(heading, first or 0) or chosen
        try:
            rows.append([float(numbers[k]) for k in (chosen or range(len(numbers))) if k < len(numbers)])
        except ValueError:
            told = f"{text[:40]!r} is not a row of numbers; a comment begins with #"
            raise ValueError(f"line {number}: {told}") from None
        if len(rows[-1]) != len(rows[0]) or len(rows[0]) < (first or 1):
            wanted = f"each line needs {first}" if first else "a table has as many in each row"
            raise ValueError(f"line {number}: {counted(len(rows[-1]), 'number')}, and {wanted}")
    return np.array(rows)


def _is_numeric(cell: str) -> bool:
    """Tell whether a cell holds a number, or several with spaces between them, and nothing else."""
    try:
        return bool([float(part) for part in cell.split()])
    except ValueError:
        return False


def _find_columns(heading: list[str], count: int) -> Sequence[int]:
    """Find the columns that a heading calls x, y and so on; none where it does not name them all."""
    names = [re.sub(r"\s*[\[(].*", "", word).lower() for word in heading]
    found = [[k for k, name in enumerate(names) if name == axis or name.endswith(f".{axis}")] for axis in "xyz"[:count]]
    if any(len(places) > 1 for places in found):
        raise ValueError(f"its columns are {', '.join(heading)}; leave x and y of one curve in it")
    return [places[0] for places in found] if all(found) else []
