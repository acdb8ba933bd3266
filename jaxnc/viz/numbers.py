"""What a page holds, as text that is short and cannot break out of it."""

import json
import math
from typing import Any

import numpy as np

from jaxnc.viz.style import Style

_DIGITS = 7
_ORDERS = 6  # beyond, differences of rounded values are noise


def embedded(content: Any) -> str:
    """JSON that is safe inside a script element, whatever names it carries."""
    text = json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    for character in "<>&\u2028\u2029":  # they only occur inside strings
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def rounded(values: np.ndarray, digits: int = _DIGITS) -> list:
    """Numbers of so many significant digits; None where there is none."""
    flat = [
        float(f"{v:.{digits}g}") if math.isfinite(v) else None for v in np.asarray(values, float).reshape(-1).tolist()
    ]
    flat = [int(v) if v is not None and v == int(v) and abs(v) < 1e7 else v for v in flat]
    if np.ndim(values) < 2:
        return flat
    width = np.shape(values)[-1]
    return [flat[i : i + width] for i in range(0, len(flat), width)]


def packed(values: np.ndarray, quantum: float) -> Any:
    """Values over the poses of a motion, short: differences of whole numbers of quanta, as a page unpacks them.

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
    for order in range(1, _ORDERS + 1):
        steps = [np.diff(np.concatenate([np.zeros(order, np.int64), run]), order) for good, run in runs if good]
        signed = [np.where(step < 0, -2 * step - 1, 2 * step) for step in steps]
        size = sum(int(np.sum(x >= 32**k)) for x in signed for k in range(1, 12))
        if best is None or size < best[0]:
            best = size, order, signed
    _, order, signed = best or (0, 1, [])
    rest = iter(signed)
    text = "".join("".join(map(_digits, next(rest).tolist())) if good else "!" * len(run) for good, run in runs)
    return {"quantum": quantum, "order": order, "steps": text}


def _digits(x: int) -> str:
    """A whole number, not negative, in digits of five bits."""
    text = ""
    while x >= 32:
        text += chr(95 + x % 32)
        x //= 32
    return text + chr(63 + x)


def quantum_of(places: np.ndarray) -> float:
    """What lengths are rounded to: a power of ten, about a ten millionth of the size of places ``(..., dim)``."""
    places = places.reshape(-1, places.shape[-1])
    places = places[np.isfinite(places).all(axis=1)]
    size = float(np.linalg.norm(np.ptp(places, axis=0))) if len(places) else 0.0
    return 10.0 ** (math.floor(math.log10(size or 1.0)) - 6)


def spaced(values: np.ndarray) -> Any:
    """Values over the poses of a motion, exactly: their ends where they are spaced evenly, otherwise all of them."""
    values = np.asarray(values, float)
    if np.isfinite(values).all() and len(values) > 2:
        even = np.linspace(values[0], values[-1], len(values))
        if np.max(np.abs(even - values)) <= 4e-16 * np.max(np.abs(values)):
            return {"from": float(values[0]), "to": float(values[-1])}
    return rounded(values, 16)


def written(style: Style) -> dict:
    """The style of a role, as a page reads it."""
    return {
        "stroke": style.stroke,
        "width": style.width,
        "fill": style.fill,
        "opacity": style.opacity,
        "dash": list(style.dash),
        "layer": style.layer,
        "fixed": style.fixed,
    }
