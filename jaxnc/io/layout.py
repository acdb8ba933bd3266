"""How model files are laid out: one entry a line, points and bodies in place, so that a person can edit them."""

import json
import math
import re
from collections.abc import Mapping
from typing import Any

_WIDTH = 100
_NONE: Mapping[str, str] = {}


def toml(data: Mapping[str, Any], comments: Mapping[str, str] = _NONE) -> str:
    """The data of a model as TOML: reading it gives the same data, floats bit for bit.

    Tables that are empty are left out; comments stand behind the points and vectors that they are on.
    """
    top = [f"{_key(k)} = {_value(v)}" for k, v in data.items() if not isinstance(v, dict)]
    parts = ["\n".join(top)]
    for name, table in data.items():
        if isinstance(table, dict) and table:
            inner = {k: v for k, v in table.items() if name == "run" and isinstance(v, dict)}
            rows = [_entry(k, v) for k, v in table.items() if k not in inner]
            if name in ("ground", "points", "ground_vectors", "vectors", "markers"):
                rows = [f"{r}  # {comments[k]}" if k in comments else r for r, k in zip(rows, table, strict=True)]
            if rows:
                parts.append("\n".join([f"[{_key(name)}]", *rows]))
            for key, entries in inner.items():
                rows = [_entry(k, v) for k, v in entries.items()]
                parts.append("\n".join([f"[{_key(name)}.{_key(key)}]", *rows]))
    return "\n\n".join(p for p in parts if p) + "\n"


def json_text(data: Mapping[str, Any]) -> str:
    """Lay out the data of a model as JSON: what fits on a line stays on it. Reading it gives the same data."""
    return _json({k: v for k, v in data.items() if v != {}}, "") + "\n"


def _json(value: Any, indent: str) -> str:
    flat = json.dumps(value, ensure_ascii=False, allow_nan=False)
    if not isinstance(value, dict) or not value or (len(indent) >= 4 and len(flat) + len(indent) <= _WIDTH):
        return flat
    deeper = indent + "  "
    rows = [f"{deeper}{json.dumps(k, ensure_ascii=False)}: {_json(v, deeper)}" for k, v in value.items()]
    return "{\n" + ",\n".join(rows) + f"\n{indent}}}"


def _entry(key: str, value: Any) -> str:
    row = f"{_key(key)} = {_value(value)}"
    if len(row) <= _WIDTH or not isinstance(value, dict | list | tuple):
        return row
    if isinstance(value, dict):
        return "\n".join(f"{_key(key)}.{_entry(k, v)}" for k, v in value.items())
    rows, line = [], "   "
    for item in map(_value, value):
        if len(line) + len(item) + 2 > _WIDTH:
            rows.append(line)
            line = "   "
        line += f" {item},"
    return f"{_key(key)} = [\n" + "\n".join([*rows, line]) + "\n]"


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _value(key)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + " }" if value else "{}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    return _number(value)


def _number(value: float) -> str:
    """The shortest text that reads back as the same float: whole numbers without a point, -0.0 with its sign."""
    number = float(value)
    if number.is_integer() and abs(number) < 1e15 and (number or math.copysign(1.0, number) > 0):
        return str(int(number))
    return repr(number)
