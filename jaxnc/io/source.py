"""The text of a model file: parsed into plain data and records; errors name the line of what is wrong.

The records of problem files of `jaxnc synthesise` stand here too; `jaxnc.io.problems` makes a problem of them.
"""

import functools
import json
import operator
import re
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec
import msgspec.inspect as kinds_of

from jaxnc.errors import InputError, MechanismError, ModelFileError, nearest, writable
from jaxnc.io.target import file_name
from jaxnc.mechanism.model import Model

SUFFIXES = (".toml", ".json")
Place = tuple[str | int, ...]
"""Keys from the top of a file down to an entry."""
T = TypeVar("T")


class Source:
    """A model file that was read."""

    def __init__(self, path: Path):
        self.path = path  # where it is
        self.suffix = path.suffix.lower()
        self.text = _read_text(path)  # what it says
        self._lines: dict[Place, int] = {}  # of the entries of a JSON text
        self.data = self._parse()  # the same as nested dictionaries and lists
        self._check(self.data)

    # -- where -------------------------------------------------------------------------------------------------

    def line(self, place: Place) -> int | None:
        """Return the line number of an entry, or of the nearest table around it that has one."""
        for end in range(len(place), 0, -1):
            found = _toml_line(self.text, place[:end]) if self.suffix == ".toml" else self._lines.get(place[:end])
            if found:
                return found
        return None

    def fault(self, what: str, place: Place = (), line: int | None = None, column: int = 0) -> ModelFileError:
        """Make an error that names the file, the line if it is known, and what is wrong there."""
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

    # -- what --------------------------------------------------------------------------------------------------

    def _parse(self) -> dict:
        try:
            return tomllib.loads(self.text) if self.suffix == ".toml" else self._parse_json()
        except (tomllib.TOMLDecodeError, json.JSONDecodeError) as error:
            raise self._syntax_fault(error) from None
        except RecursionError:
            raise self.fault("it is nested too deeply to be a model") from None
        except ModelFileError:
            raise
        except ValueError:  # int() refuses thousands of digits
            raise self.fault("it contains a number with too many digits") from None

    def _check(self, data: object) -> None:
        """Refuse what parses and yet can be no model: tables in tables without end, text that cannot be written."""
        left: list[tuple[Any, Place]] = [(data, ())]
        while left:
            value, place = left.pop()
            if len(place) > 50:  # a model has five tables in tables
                raise self.fault("it is nested too deeply to be a model")
            if isinstance(value, dict):
                left += [(key, place) for key in value]
                left += [(inner, (*place, key)) for key, inner in value.items()]
            elif isinstance(value, list):
                left += [(inner, (*place, k)) for k, inner in enumerate(value)]
            elif isinstance(value, str) and not writable(value):
                raise self.fault(f"{value!r} holds half of a character (a lone surrogate); type it anew", place)

    def _parse_json(self) -> dict:
        data = json.loads(self.text)
        for place, line in _json_lines(self.text):
            if place in self._lines:
                raise self.fault(f"{str(place[-1])!r} is given twice; keep one of them", line=line)
            self._lines[place] = line
        return data

    def _syntax_fault(self, error: ValueError) -> ModelFileError:
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


def _read_text(path: Path) -> str:
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


def _toml_line(text: str, place: Place) -> int | None:
    """Return the line where the statement of a TOML text begins that is the first to give an entry."""
    rows, first = text.split("\n"), 1
    for count in range(1, len(rows) + 1):
        try:
            data = tomllib.loads("\n".join(rows[:count]))
        except tomllib.TOMLDecodeError:
            continue  # in the midst of a statement
        with suppress(KeyError, IndexError, TypeError):
            _entry(data, place)
            return first
        first = count + 1
    return None


def _entry(data: Any, place: Place) -> Any:
    return functools.reduce(operator.getitem, place, data)


def _json_lines(text: str) -> Iterator[tuple[Place, int]]:
    """Yield entries of a JSON text that parses, and their lines; a key given twice comes twice."""
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
                key, inside = decoder.raw_decode(text, inside)
                inside = skip(inside)
            yield (*place, key), line
            inside = skip((yield from walk(inside, (*place, key))))
            number += 1
        return inside + 1

    yield from walk(skip(0), ())


# -- records ----------------------------------------------------------------------------------------------------------


def decode(source: Source, record: type[T]) -> T:
    """Turn the data of a file into records."""
    _not_the_other(source, record)
    try:
        return msgspec.convert(source.data, record)
    except msgspec.ValidationError as error:
        place, what = _explain(str(error), source.data, record)
    where = ".".join(map(str, place))
    raise source.fault(f"{where}: {what}" if where else what, place)


def _not_the_other(source: Source, record: type) -> None:
    """Tell a model file from a problem file by their first keys, and refuse the one for the other."""
    keys = set(source.data) if isinstance(source.data, dict) else set()
    if record is Model and {"mechanism", "kind"} <= keys:
        raise source.fault(f"this is a problem file, for `jaxnc synthesise`; its model is {source.data['mechanism']!r}")
    if record is not Model and "mechanism" not in keys and {"ground", "points"} & keys:
        raise source.fault(
            f"this is a model file; a problem says what is wanted of one: mechanism = {source.path.name!r}, kind = "
            f"'path', target = …, as in examples/problems"
        )


def _explain(message: str, data: Any, record: type) -> tuple[Place, str]:
    """Find the entry that an error of msgspec is about, and what is wrong with it."""
    fault, _, path = message.partition(" - at `$")
    place = _resolve(re.findall(r"\.(\w+)|\[(\.\.\.|\d+)\]", path), data, message)
    expected: Any = inspect_record(record)
    value = data
    for key in place:
        expected, value = _entry_type(expected, key, value), value[key]
    if isinstance(value, dict) and (axis := {"x", "y", "z"} & set(value)):
        # TOML reads  B.x = …  as a table B with an entry x.
        return place, f'a name with a dot is written in quotes: "{place[-1] if place else ""}.{min(axis)}" = …'
    name = fault.partition("`")[2].rstrip("`")
    if fault.startswith("Object contains unknown field"):
        noun = "field" if place else "table or field"
        return (*place, name), f"unknown {noun}; {nearest(name, _field_names(expected, value), cutoff=0.8)}"
    if fault.startswith("Object missing required field"):
        return place, f"{name!r} is missing; it is {describe(_entry_type(expected, name, value))}"
    if place == ("dim",):
        return place, f"mechanisms are planar, dim = 2, or spatial, dim = 3; got {value!r}"
    if fault.startswith("Invalid"):
        choices = [str(v) for t in _alternatives(expected) if isinstance(t, kinds_of.LiteralType) for v in t.values]
        hint = nearest(str(value), choices)  # which lists them, as they are listed already, where none is like it
        return place, f"{value!r} is not {describe(expected)}" + f"; {hint}" * hint.startswith("did you mean")
    if fault.startswith("Number out of range"):
        return place, "the number is too large"
    return place, f"expected {describe(expected)}, got {_describe_value(value)}"


def _resolve(tokens: list[tuple[str, str]], data: Any, message: str) -> Place:
    """Find the keys that a path stands for: an unnamed one is the key that, alone in its table, is still refused."""
    place: Place = ()
    for name, index in tokens:
        if name or index != "...":
            place += (name or int(index),)
            continue
        node = _entry(data, place)
        for key in node:
            try:
                msgspec.convert(_replace(data, place, {key: node[key]}), Model)
            except msgspec.ValidationError as error:
                if str(error) == message:
                    place += (key,)
                    break
        else:
            return place
    return place


def _replace(data: Any, place: Place, value: Any) -> Any:
    if not place:
        return value
    return {**data, place[0]: _replace(data[place[0]], place[1:], value)}


@cache
def inspect_record(record: type) -> msgspec.inspect.Type:
    """Return the fields of a record and their types, as msgspec has them."""
    return kinds_of.type_info(record)


def _alternatives(expected: object) -> tuple[Any, ...]:
    types = expected.types if isinstance(expected, kinds_of.UnionType) else (expected,)
    return tuple(t for t in types if not isinstance(t, kinds_of.NoneType))


def _struct(expected: msgspec.inspect.Type, value: object) -> msgspec.inspect.StructType | None:
    """Find the record that a table is meant to be; among joints the one that its tag names."""
    structs = [t for t in _alternatives(expected) if isinstance(t, kinds_of.StructType)]
    tagged = [t for t in structs if isinstance(value, dict) and t.tag is not None and t.tag == value.get(t.tag_field)]
    return (tagged or structs or [None])[0]


def _entry_type(expected: Any, key: str | int, value: object) -> Any:
    """Return the shape of one entry of something of a known shape."""
    struct = _struct(expected, value)
    if struct is not None and isinstance(key, str):
        if key == struct.tag_field:
            return kinds_of.LiteralType(tuple(t.tag for t in _alternatives(expected)))
        return next((f.type for f in struct.fields if f.encode_name == key), kinds_of.AnyType())
    for t in _alternatives(expected):
        if isinstance(t, kinds_of.DictType):
            return t.value_type
        if isinstance(t, kinds_of.ListType | kinds_of.VarTupleType):
            return t.item_type
        if isinstance(t, kinds_of.TupleType):
            return t.item_types[0]
    return kinds_of.AnyType()


def _field_names(expected: msgspec.inspect.Type, value: object) -> list[str]:
    struct = _struct(expected, value)
    names = [f.encode_name for f in struct.fields] if struct is not None else []
    return [*names, struct.tag_field] if struct is not None and struct.tag_field else names


# Plain types, as messages call one value of them and the entries of a list.
_ONE_AND_MANY = {
    kinds_of.FloatType: ("a number", "numbers"),
    kinds_of.IntType: ("a whole number", "numbers"),
    kinds_of.BoolType: ("true or false", "values"),
    kinds_of.DictType: ("a table", "values"),
    kinds_of.StrType: ("a name in quotes", "names"),
}


def describe(expected: msgspec.inspect.Type, many: bool = False) -> str:
    """Say what is expected, as a phrase; with `many` of the entries of a list."""
    phrases = []
    for t in _alternatives(expected):
        if isinstance(t, kinds_of.TupleType | kinds_of.ListType | kinds_of.VarTupleType):
            each = t.item_types if isinstance(t, kinds_of.TupleType) else (t.item_type,)
            of = "lists of" if many else f"a list of {len(each)}" if isinstance(t, kinds_of.TupleType) else "a list of"
            phrases.append(f"{of} {describe(each[0], many=True)}")
        elif isinstance(t, kinds_of.StructType) and not many:
            needed = [f.encode_name for f in t.fields if f.required]
            phrase = "a table" + (f" with {', '.join(needed)}" if needed else "")
            phrases.append(phrase if t.tag is None else "a table with joint = …")
        elif isinstance(t, kinds_of.LiteralType) and not many:
            phrases.append("one of " + ", ".join(repr(v) for v in t.values))
        elif isinstance(t, kinds_of.StructType):
            phrases.append("tables")
        else:
            phrases.append(_ONE_AND_MANY.get(type(t), ("a name in quotes", "values"))[many])
    return " or ".join(dict.fromkeys(phrases))


def _describe_value(value: object) -> str:
    """Say what was found instead, as a phrase."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        inside = ", ".join(repr(v) for v in value[:4]) + (", …" if len(value) > 4 else "")
        return f"a list of {len(value)}: [{inside}]"
    if value is None:
        return "nothing (null)"
    return f"the text {value!r}" if isinstance(value, str) else f"{value}"


# -- problem files -----------------------------------------------------------------------------------------------------


class _Record(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    pass


class ConditionEntry(_Record):
    """An entry of ``[[conditions]]``; which fields there are depends on its type."""

    type: Literal[
        "crank turns",
        "transmission angle",
        "length",
        "equal",
        "symmetric",
        "within",
        "local",
        "size",
        "stock",
        "integer",
        "direction",
        "circuit",
        "clear of",
        "clear links",
        "no flip",
        "only circuit",
    ]
    kind: Literal["crank-rocker", "double-crank"] | None = None
    margin: float = 0.0
    min: float | None = None
    max: float | None = None
    joint: tuple[str, str, str] | None = None
    points: list[str] = []
    other: list[str] = []
    value: float | None = None
    about: list | None = None
    variable: str | None = None
    sizes: list[float] | None = None
    step: float = 1.0
    side: Literal["left", "right"] | None = None
    point: str | None = None
    x: tuple[float | None, float | None] | None = None
    y: tuple[float | None, float | None] | None = None
    z: tuple[float | None, float | None] | None = None
    region: list[tuple[float, float]] | None = None
    links: list[str] | None = None
    layers: dict[str, int] | list[str] | None = None
    width: float = 0.0
    distance: float | None = None
    input: float | None = None
    stops: dict[str, tuple[float | None, float | None]] | None = None


class SvgTarget(_Record):
    """A target that is a path of an SVG file; see `jaxnc.io.curve_files.outline`."""

    svg: str
    points: int
    id: str | None = None
    piece: int | None = None
    size: float | None = None
    centre: tuple[float, float] | None = None
    up: bool = True


class SearchOptions(_Record):
    """How long to search; see `jaxnc.synthesis.solve`."""

    starts: int = 20_000
    refine: int = 192
    iterations: int = 400
    keep: int = 10
    key: int = 0
    seconds: float | None = None
    enough: float = 0.0


class ProblemFile(_Record):
    """A problem file."""

    mechanism: str
    kind: Literal["path", "function", "motion"]
    target: str | list[float | list[float]] | SvgTarget
    point: str | None = None
    output: str | None = None
    body: str | None = None
    input: str | None = None
    timing: list[float] | None = None
    values: list[float] | None = None
    orientations: list[float | list[float]] | None = None
    start_timing: list[float] | None = None
    ordered: bool = True
    closed: bool | None = None
    offset: bool = False
    either_sense: bool = False
    input_offset: bool = False
    output_offset: bool = False
    minimax: bool = False
    free: list[str] | None = None
    hold: list[str] = []
    travel: tuple[float, float] | None = None
    weights: list[float] | None = None
    bounds: dict[str, list] = {}
    conditions: list[ConditionEntry] = []
    search: SearchOptions = msgspec.field(default_factory=SearchOptions)


def statement(path: str | Path) -> tuple[ProblemFile, Source]:
    """Read what a problem file says, without making a problem of it; that takes JAX."""
    source = Source(file_name(path))
    return decode(source, ProblemFile), source
