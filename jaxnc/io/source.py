"""The text of a model file: parsed into plain data, and able to say on which line an entry stands."""

import json
import re
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from json.decoder import scanstring  # pyright: ignore[reportAttributeAccessIssue]
from pathlib import Path
from typing import Any

from jaxnc.errors import InputError, MechanismError, ModelFileError, nearest, writable

SUFFIXES = (".toml", ".json")
_DEEPEST = 50  # tables in tables; a model has five
Place = tuple[str | int, ...]
"""Keys from the top of a file down to an entry."""


class Source:
    """A model file that was read."""

    def __init__(self, path: Path):
        self.path = path  # where it is
        self.suffix = path.suffix.lower()
        self.text = _read(path)  # what it says
        self.data = self._parse()  # the same as nested dictionaries and lists
        self._check(self.data)

    # -- where -------------------------------------------------------------------------------------------------

    def line(self, place: Place) -> int | None:
        """Line number of an entry, or of the nearest table around it that has one."""
        for end in range(len(place), 0, -1):
            if place[:end] in self._lines:
                return self._lines[place[:end]]
        return None

    def fault(self, what: str, place: Place = (), line: int | None = None, column: int = 0) -> ModelFileError:
        """An error that names the file, the line if it is known, and what is wrong there."""
        line = line or self.line(place)
        where = f", line {line}" if line else ""
        where += f", column {column}" if column else ""
        return ModelFileError(f"{self.path}{where}: {what}")

    @contextmanager
    def blamed(self, place: Place = ()) -> Iterator[None]:
        """Turn complaints about a description into a fault of the entry that it comes from."""
        try:
            yield
        except (MechanismError, InputError) as error:
            raise self.fault(str(error), place) from None

    @cached_property
    def _lines(self) -> dict[Place, int]:
        return dict(_toml_lines(self.text) if self.suffix == ".toml" else _json_lines(self.text))

    # -- what --------------------------------------------------------------------------------------------------

    def _parse(self) -> Any:
        try:
            return tomllib.loads(self.text) if self.suffix == ".toml" else self._parse_json()
        except (tomllib.TOMLDecodeError, json.JSONDecodeError) as error:
            raise self._malformed(error) from None
        except RecursionError:
            raise self.fault("it is nested too deeply to be a model") from None
        except ModelFileError:
            raise
        except ValueError:  # int() refuses thousands of digits
            raise self.fault("it contains a number with too many digits") from None

    def _check(self, data: Any) -> None:
        """Refuse what parses and yet can be no model: tables in tables without end, text that cannot be written."""
        left: list[tuple[Any, Place]] = [(data, ())]
        while left:
            value, place = left.pop()
            if len(place) > _DEEPEST:
                raise self.fault("it is nested too deeply to be a model")
            if isinstance(value, dict):
                left += [(key, place) for key in value]
                left += [(inner, (*place, key)) for key, inner in value.items()]
            elif isinstance(value, list):
                left += [(inner, (*place, k)) for k, inner in enumerate(value)]
            elif isinstance(value, str) and not writable(value):
                raise self.fault(f"{value!r} holds half of a character (a lone surrogate); type it anew", place)

    def _parse_json(self) -> Any:
        data = json.loads(self.text)
        seen = set()
        for place, line in _json_lines(self.text):
            if place in seen:
                raise self.fault(f"{str(place[-1])!r} is given twice; keep one of them", line=line)
            seen.add(place)
        return data

    def _malformed(self, error: ValueError) -> ModelFileError:
        language = self.suffix[1:].upper()
        if isinstance(error, json.JSONDecodeError):
            what, line, column = error.msg, error.lineno, error.colno
            at_end = error.pos >= len(self.text.rstrip())
        else:
            what, _, where = str(error).rpartition(" (at ")
            spot = re.match(r"line (\d+), column (\d+)", where)
            at_end = spot is None
            line, column = (int(spot[1]), int(spot[2])) if spot else (self.text.rstrip().count("\n") + 1, 0)
        if at_end:
            return self.fault(f"{what}: the {language} ends too early; is the file cut short?", line=line)
        if what.startswith(("Cannot overwrite", "Cannot declare", "Duplicate", "Cannot mutate")):
            key = self.text.split("\n")[line - 1].split("=")[0].strip(" []\t")
            return self.fault(f"{key!r} is given twice; keep one of them ({what})", line=line)
        return self.fault(f"{what}; this is not valid {language}", line=line, column=column)


def _read(path: Path) -> str:
    if path.is_dir():
        raise ModelFileError(f"{path} is a folder; name a model file in it")
    if path.suffix.lower() not in SUFFIXES:
        raise ModelFileError(f"{path}: a model file ends in .toml or .json, this name ends in {path.suffix!r}")
    try:
        raw = path.read_bytes()
    except ValueError:  # a zero byte, half of a character
        raise ModelFileError(f"{str(path)!r} is no name of a file; check its letters") from None
    except (FileNotFoundError, NotADirectoryError):
        files = path.parent.iterdir() if path.parent.is_dir() else ()
        beside = [p.name for p in files if p.suffix in SUFFIXES and p.name != "pyproject.toml"]
        hint = nearest(path.name, beside) if beside else f"there are no model files in {path.parent}"
        raise ModelFileError(f"{path}: no such file; {hint}") from None
    except OSError as error:
        raise ModelFileError(f"{path} cannot be read ({error.strerror}); check its permissions") from None
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise ModelFileError(f"{path}, line {line}: this is not text in UTF-8 (byte {error.start})") from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise ModelFileError(f"{path}, line {line}: this is not text (it contains a zero byte)")
    text = text.replace("\r\n", "\n")
    if not text.strip():
        raise ModelFileError(f"{path} is empty; a model has at least the tables ground, points and bodies")
    return text


def _toml_lines(text: str) -> Iterator[tuple[Place, int]]:
    """Entries of a TOML text and their lines: statement by statement, a statement being what parses on its own."""
    rows = text.split("\n")
    table: Place = ()
    seen: set[Place] = set()
    first = 0
    while first < len(rows):
        for last in range(first, len(rows)):
            try:
                data = tomllib.loads("\n".join(rows[first : last + 1]))
                break
            except tomllib.TOMLDecodeError:
                continue
        else:
            return
        header = rows[first].lstrip().startswith("[")
        prefix: Place = () if header else table
        for keys in _keys(data):
            if header:
                table = keys
            if prefix + keys not in seen:
                seen.add(prefix + keys)
                yield prefix + keys, first + 1
        first = last + 1


def _keys(data: Any) -> Iterator[Place]:
    if isinstance(data, dict):
        for key, value in data.items():
            yield (key,)
            for rest in _keys(value):
                yield (key, *rest)


def _json_lines(text: str) -> Iterator[tuple[Place, int]]:
    """Entries of a JSON text that parses, and their lines; a key given twice comes twice."""
    decoder = json.JSONDecoder()
    space = re.compile(r"[\s:,]*")
    known = [0, 1]  # an offset and its line number; offsets only grow

    def line_at(i: int) -> int:
        known[:] = i, known[1] + text.count("\n", known[0], i)
        return known[1]

    def skip(i: int) -> int:
        found = space.match(text, i)
        return found.end() if found else i

    def walk(i: int, place: Place) -> Iterator[tuple[Place, int]]:
        """Yield what is inside the value at `i`; return where it ends."""
        if text[i] not in "{[":
            return decoder.raw_decode(text, i)[1]
        inside, number = skip(i + 1), 0
        while text[inside] not in "}]":
            line = line_at(inside)
            key: str | int = number
            if text[i] == "{":
                key, inside = scanstring(text, inside + 1, True)
                inside = skip(inside)
            yield (*place, key), line
            inside = skip((yield from walk(inside, (*place, key))))
            number += 1
        return inside + 1

    yield from walk(skip(0), ())
