"""Text of a page: its parts, and numbers that are short and cannot break out of a script element."""

import json
import math
import re
from collections.abc import Callable
from importlib.resources import files
from typing import Any

import numpy as np

# Parts that hold others, the outer before the inner.
_NESTED = ("PROGRAM", "CLOCK", "STAGE", "CHARTS", "LIVE", "SOLVER", "MORPHING", "HANDLING", "SIZING", "SHAPING", "MORE")


def page_part(name: str) -> str:
    """Read a part of the page, a file beside this module."""
    return files("jaxnc.viz.pages").joinpath(name).read_text(encoding="utf-8")


def fill_template(text: str, parts: dict[str, str]) -> str:
    """Put parts into a text. Parts that hold no others are put in once: a title may look like the name of a part."""
    for name in _NESTED:
        text = text.replace(f"{{{{{name}}}}}", parts.get(name, ""))
    return re.sub(r"\{\{([A-Z]+)\}\}", lambda name: parts[name[1]], text)


def input_names(*arrays: tuple[str, int | None]) -> Callable[[int], str]:
    """Name inputs that lie in several arrays behind one another; one whose size is None is a number."""
    names = [
        letter if size is None else f"{letter}[{k}]"
        for letter, size in arrays
        for k in range(1 if size is None else size)
    ]
    return names.__getitem__


def embed_json(content: object) -> str:
    """Write JSON that is safe inside a script element, whatever names it carries."""
    text = json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    for character in "<>&\u2028\u2029":  # they only occur inside strings
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def round_numbers(values: np.ndarray, digits: int = 7) -> list:
    """Round numbers to so many significant digits; None where there is none."""
    flat = [
        float(f"{v:.{digits}g}") if math.isfinite(v) else None for v in np.asarray(values, float).reshape(-1).tolist()
    ]
    flat = [int(v) if v is not None and v == int(v) and abs(v) < 1e7 else v for v in flat]
    if np.ndim(values) < 2:
        return flat
    width = np.shape(values)[-1]
    return [flat[i : i + width] for i in range(0, len(flat), width)]


def pack(values: np.ndarray, quantum: float) -> Any:
    """Write values over the poses of a motion in short, as differences of whole numbers of quanta.

    A number where all values are the same. Otherwise differences of that order of which the text is shortest, each in
    digits of five bits, the lowest first and a sixth bit where another follows; ``"!"`` stands where there is no value,
    and the differences begin anew.
    """
    values = np.asarray(values, float)
    known = np.isfinite(values)
    if known.all() and np.ptp(values) <= quantum:
        return float(f"{values[0]:.12g}")
    whole = np.rint(np.where(known, values, 0.0) / quantum).astype(np.int64)
    edges = np.flatnonzero(np.diff(known)) + 1
    runs = [(bool(part[0]), rest) for part, rest in zip(np.split(known, edges), np.split(whole, edges), strict=True)]
    best = None
    for order in range(1, 7):  # beyond the sixth order, differences of rounded values are noise
        steps = [np.diff(np.concatenate([np.zeros(order, np.int64), run]), order) for good, run in runs if good]
        signed = [np.where(step < 0, -2 * step - 1, 2 * step) for step in steps]
        size = sum(int(np.sum(x >= 32**k)) for x in signed for k in range(1, 12))
        if best is None or size < best[0]:
            best = size, order, signed
    _, order, signed = best or (0, 1, [])
    rest = iter(signed)
    text = "".join("".join(map(_base32, next(rest).tolist())) if good else "!" * len(run) for good, run in runs)
    return {"quantum": quantum, "order": order, "steps": text}


def pack_places(x: np.ndarray, quantum: float) -> dict[str, object]:
    """Write places over the poses of a motion ``(T, dim)`` in short, axis by axis."""
    return {axis: pack(row, quantum) for axis, row in zip("xyz", x.T, strict=False)}


def _base32(x: int) -> str:
    """Write a whole number, not negative, in digits of five bits."""
    text = ""
    while x >= 32:
        text += chr(95 + x % 32)
        x //= 32
    return text + chr(63 + x)


def quantum_of(places: np.ndarray) -> float:
    """Choose the power of ten that lengths are rounded to: a ten millionth of the size of places ``(..., dim)``."""
    places = places.reshape(-1, places.shape[-1])
    places = places[np.isfinite(places).all(axis=1)]
    size = float(np.linalg.norm(np.ptp(places, axis=0))) if len(places) else 0.0
    return 10.0 ** (math.floor(math.log10(size or 1.0)) - 6)


def pack_exactly(values: np.ndarray) -> Any:
    """Write values over the poses of a motion to the last digit: their ends where they are spaced evenly, else all."""
    values = np.asarray(values, float)
    if np.isfinite(values).all() and len(values) > 2:
        even = np.linspace(values[0], values[-1], len(values))
        if np.max(np.abs(even - values)) <= 4e-16 * np.max(np.abs(values)):
            return {"from": float(values[0]), "to": float(values[-1])}
    return round_numbers(values, 16)
