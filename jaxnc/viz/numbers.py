"""What a page holds, as text that is short and cannot break out of it."""

import json
import math
from typing import Any

import numpy as np

from jaxnc.viz.style import Style

_DIGITS = 7


def embedded(content: Any) -> str:
    """JSON that is safe inside a script element, whatever names it carries."""
    text = json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    for character in "<>&\u2028\u2029":  # they only occur inside strings
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def rounded(values: np.ndarray) -> list:
    """Numbers of seven significant digits; None where there is none."""
    flat = [
        float(f"{v:.{_DIGITS}g}") if math.isfinite(v) else None for v in np.asarray(values, float).reshape(-1).tolist()
    ]
    flat = [int(v) if v is not None and v == int(v) and abs(v) < 1e7 else v for v in flat]
    if np.ndim(values) < 2:
        return flat
    width = np.shape(values)[-1]
    return [flat[i : i + width] for i in range(0, len(flat), width)]


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
