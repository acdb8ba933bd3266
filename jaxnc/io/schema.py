"""What the schema of a model file has to say about a file that does not follow it, in the file's own words."""

import re
from functools import cache
from typing import Any, TypeVar

import msgspec
import msgspec.inspect as kinds_of

from jaxnc.errors import nearest
from jaxnc.io.source import Place, Source
from jaxnc.mechanism.model import Model

T = TypeVar("T")


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
    """A model file where a problem file is asked for, and the reverse, are told by their first keys."""
    keys = set(source.data) if isinstance(source.data, dict) else set()
    if record is Model and {"mechanism", "kind"} <= keys:
        raise source.fault(f"this is a problem file, for `jaxnc synthesise`; its model is {source.data['mechanism']!r}")
    if record is not Model and "mechanism" not in keys and {"ground", "points"} & keys:
        raise source.fault(
            f"this is a model file; a problem says what is wanted of one: mechanism = {source.path.name!r}, kind = "
            f"'path', target = …, as in examples/problems"
        )


def _explain(message: str, data: Any, record: type) -> tuple[Place, str]:
    """The entry that an error of msgspec is about, and what is wrong with it."""
    fault, _, path = message.partition(" - at `$")
    place = _resolve(re.findall(r"\.(\w+)|\[(\.\.\.|\d+)\]", path), data, message)
    expected: Any = _shape(record)
    value = data
    for key in place:
        expected, value = _inner(expected, key, value), value[key]
    if isinstance(value, dict) and (axis := {"x", "y", "z"} & set(value)):
        # TOML reads  B.x = …  as a table B with an entry x.
        return place, f'a name with a dot is written in quotes: "{place[-1] if place else ""}.{min(axis)}" = …'
    name = fault.partition("`")[2].rstrip("`")
    if fault.startswith("Object contains unknown field"):
        noun = "field" if place else "table or field"
        return (*place, name), f"unknown {noun}; {nearest(name, _fields(expected, value))}"
    if fault.startswith("Object missing required field"):
        return place, f"{name!r} is missing; it is {_words(_inner(expected, name, value))}"
    if place == ("dim",):
        return place, f"mechanisms are planar, dim = 2, or spatial, dim = 3; got {value!r}"
    if fault.startswith("Invalid"):
        choices = [str(v) for t in _alternatives(expected) if isinstance(t, kinds_of.LiteralType) for v in t.values]
        return place, f"{value!r} is not {_words(expected)}; {nearest(str(value), choices)}"
    if fault.startswith("Number out of range"):
        return place, "the number is too large"
    return place, f"expected {_words(expected)}, got {_seen(value)}"


def _resolve(tokens: list[tuple[str, str]], data: Any, message: str) -> Place:
    """The keys that a path stands for: an unnamed one is the key that, alone in its table, is still refused."""
    place: Place = ()
    for name, index in tokens:
        node = data
        for key in place:
            node = node[key]
        if name or index != "...":
            place += (name or int(index),)
            continue
        for key in node:
            try:
                msgspec.convert(_replaced(data, place, {key: node[key]}), Model)
            except msgspec.ValidationError as error:
                if str(error) == message:
                    place += (key,)
                    break
        else:
            return place
    return place


def _replaced(data: Any, place: Place, value: Any) -> Any:
    if not place:
        return value
    return {**data, place[0]: _replaced(data[place[0]], place[1:], value)}


@cache
def _shape(record: type) -> Any:
    return kinds_of.type_info(record)


def _alternatives(expected: Any) -> tuple[Any, ...]:
    types = expected.types if isinstance(expected, kinds_of.UnionType) else (expected,)
    return tuple(t for t in types if not isinstance(t, kinds_of.NoneType))


def _struct(expected: Any, value: Any) -> Any:
    """The record that a table is meant to be; among joints the one that its tag names."""
    structs = [t for t in _alternatives(expected) if isinstance(t, kinds_of.StructType)]
    tagged = [t for t in structs if isinstance(value, dict) and t.tag is not None and t.tag == value.get(t.tag_field)]
    return (tagged or structs or [None])[0]


def _inner(expected: Any, key: str | int, value: Any) -> Any:
    """The shape of one entry of something of a known shape."""
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


def _fields(expected: Any, value: Any) -> list[str]:
    struct = _struct(expected, value)
    names = [f.encode_name for f in struct.fields] if struct is not None else []
    return [*names, struct.tag_field] if struct is not None and struct.tag_field else names


def _words(expected: Any) -> str:
    """What is expected, as a phrase."""
    phrases = []
    for t in _alternatives(expected):
        if isinstance(t, kinds_of.FloatType):
            phrases.append("a number")
        elif isinstance(t, kinds_of.IntType):
            phrases.append("a whole number")
        elif isinstance(t, kinds_of.BoolType):
            phrases.append("true or false")
        elif isinstance(t, kinds_of.LiteralType):
            phrases.append("one of " + ", ".join(repr(v) for v in t.values))
        elif isinstance(t, kinds_of.TupleType):
            phrases.append(f"a list of {len(t.item_types)} {_plural(t.item_types[0])}")
        elif isinstance(t, kinds_of.ListType | kinds_of.VarTupleType):
            phrases.append(f"a list of {_plural(t.item_type)}")
        elif isinstance(t, kinds_of.StructType):
            needed = [f.encode_name for f in t.fields if f.required]
            phrase = "a table" + (f" with {', '.join(needed)}" if needed else "")
            phrases.append(phrase if t.tag is None else "a table with joint = …")
        elif isinstance(t, kinds_of.DictType):
            phrases.append("a table")
        else:
            phrases.append("a name in quotes")
    return " or ".join(dict.fromkeys(phrases))


def _plural(item: Any) -> str:
    return "numbers" if isinstance(item, kinds_of.FloatType) else "names"


def _seen(value: Any) -> str:
    """What was found instead, as a phrase."""
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
