"""Model files: a mechanism read from TOML or JSON, and written to it.

A file holds what the methods of `Mechanism` take, table by table, and is read by calling them: the same checks, the
same messages. Lengths are in any one unit, which ``units.length`` names. Exactly these numbers are converted when they
are used: with ``units.angle = "deg"``, the drives of inputs that are angles (`from`, `to` and `rate` in
``[run.inputs]``). Everything else is taken as it stands; constants of relations between angles are in radians.
"""

import json
import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from jaxnc.calls import public
from jaxnc.errors import InputError, MechanismError, ModelFileError, nearest
from jaxnc.io.drives import check_run
from jaxnc.io.source import SUFFIXES, Source, decode
from jaxnc.io.target import file_name, write
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.vehicle.hardpoints import trade_names

if TYPE_CHECKING:
    from jaxnc.constraints import Kind, RateKind
    from jaxnc.forces import ForceKind

    AnyKind = Kind | RateKind | ForceKind

_WIDTH = 100  # of a line in a file
_NO_COMMENTS: Mapping[str, str] = {}


@public
def load(path: str | Path, kinds: "Mapping[str, AnyKind] | None" = None) -> Mechanism:
    """Read a mechanism from a model file.

    Args:
        path: a file ending in ``.toml`` or ``.json``.
        kinds: kinds of constraints and forces of your own that the file uses, by name.

    Returns:
        The mechanism, ready to be compiled; its ``model.run`` says how the file wants it driven.

    Raises:
        ModelFileError: the file cannot be read, does not follow the schema or describes something that cannot be
            built. The message names file, line, entry, what was expected and what to try.
    """
    source = Source(file_name(path))
    return rebuild(decode(source, record.Model), source, kinds or {})


def save(mechanism: Mechanism, path: str | Path, kinds: "Mapping[str, AnyKind] | None" = None) -> Path:
    """Write a mechanism to a model file that `load` turns into an equal one; see `jaxnc.Mechanism.save`."""
    path = file_name(path)
    if path.suffix.lower() not in SUFFIXES:
        raise MechanismError(f"{path}: a model file ends in .toml or .json, this name ends in {path.suffix!r}")
    _check_savable(mechanism, kinds or {})
    model = mechanism.model
    return write(path, (model_toml(model) if path.suffix.lower() == ".toml" else json_text(plain(model))).encode())


def blame(path: str | Path, error: MechanismError) -> ModelFileError:
    """Find the line of a model file that a complaint about its mechanism is about; return an error to raise instead."""
    source = Source(file_name(path))
    quoted = str(error).split("'")[1::2]
    for name in quoted:
        for table, entries in source.data.items():
            if isinstance(entries, dict) and name in entries:
                return source.fault(str(error), (table, name))
    return source.fault(str(error))


def _catalogue(noun: str, name: str) -> "AnyKind | None":
    """Find one of the library's own kinds, of a constraint or of a force."""
    if noun == "force":
        from jaxnc.forces import CATALOGUE as FORCES  # and JAX with it, which a model without forces can do without

        return FORCES.get(name)
    from jaxnc.constraints import CATALOGUE, RATES, cable, relation

    if sized := re.fullmatch(r"(cable|relation) of ([1-9]\d?)", name):
        return {"cable": cable, "relation": relation}[sized[1]](int(sized[2]))
    return CATALOGUE.get(name) or RATES.get(name)


def plain(model: record.Model) -> dict[str, Any]:
    """Return a model as plain data: tables that say nothing left out, bodies that are only points as lists of them."""
    data = msgspec.to_builtins(model)
    for name, body in data.get("bodies", {}).items():
        if isinstance(body, dict) and set(body) == {"points"}:
            data["bodies"][name] = body["points"]
    for name, angle in data.get("angles", {}).items():
        data["angles"][name] = {k: angle[k] for k in ("at", *angle) if k in angle}
    name = {"name": model.name}
    return {**name, **{k: v for k, v in data.items() if v != {}}}


def rebuild(model: record.Model, source: Source, kinds: "Mapping[str, AnyKind]") -> Mechanism:
    """Call the builder for every record, in the order of the schema."""
    with source.blamed():
        m = Mechanism(model.name, model.dim, model.description, model.units.length, model.units.angle)

    def call(method: Callable) -> Callable[[str, Any], Any]:
        """Make of a method of the builder one that takes a record, whose fields are its arguments."""
        return lambda name, entry: method(name, **msgspec.structs.asdict(entry))

    def add_point(name: str, entry: Any) -> None:
        call(m.point)(name, entry if isinstance(entry, record.Point) else record.Point(entry))

    def add_body(name: str, entry: Any) -> None:
        body = msgspec.structs.asdict(entry if isinstance(entry, record.Body) else record.Body(entry))
        body["lengths"] = {_split_ends(key, name): value for key, value in body["lengths"].items()}
        m.body(name, **body)

    def find_kind(noun: str, name: str, called: str) -> Any:
        kind = kinds.get(called) or _catalogue(noun, called)
        if kind is None:
            raise _unknown_kind(noun, name, called, kinds)
        return kind

    def add_constraint(name: str, c: record.Constraint) -> None:
        m.constrain(name, find_kind("constraint", name, c.kind), c.points, c.vectors, c.scalars, c.constants)

    def add_force(name: str, f: record.Force) -> None:
        m.apply(name, find_kind("force", name, f.kind), f.points, f.vectors, f.scalars, f.parameters)

    def add_friction(name: str, entry: record.Friction) -> None:
        given = msgspec.structs.asdict(entry)
        m.friction(name, at=given.pop("point"), **given)

    with source.blamed(("gravity",)):
        m.gravity = model.gravity
    sections: dict[str, Callable[[str, Any], Any]] = {
        "ground": m.ground,
        "points": add_point,
        "ground_vectors": m.ground_vector,
        "vectors": m.vector,
        "bodies": add_body,
        "markers": call(m.marker),
        "angles": call(m.angle),
        "distances": call(m.distance),
        "joints": m.add_joint,
        "relations": call(m.relation),
        "constraints": add_constraint,
        "masses": call(m.point_mass),
        "forces": add_force,
        "friction": add_friction,
    }
    for section, add in sections.items():
        for name, entry in getattr(model, section).items():
            with source.blamed((section, name)):
                add(name, entry)
    _check_simulation(m, model.simulate, source)
    m.model.simulate = model.simulate
    check_run(m, model.run, source.blamed)
    m.model.run = model.run
    return m


def _check_simulation(m: Mechanism, section: record.Simulation, source: Source) -> None:
    names = (*m.all_points, *m.all_vectors, *m.scalar_names, *(f"{p}.{a}" for p in m.all_points for a in m.axes))
    for key, values in (("start", section.start), ("rates", section.rates)):
        for name, value in values.items():
            with source.blamed(("simulate", key, name)):
                if name not in names:
                    raise InputError(f"there is no coordinate {name!r}; {nearest(name, names)}")
                if not math.isfinite(value):
                    raise InputError(f"{key} of {name!r} must be a finite number")
    for key in ("duration", "step", "rtol"):
        value = getattr(section, key)
        with source.blamed(("simulate", key)):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise InputError(f"{key} = {value} must be a positive number")
    with source.blamed(("simulate", "times")):
        if section.times < 2:
            raise InputError(f"times = {section.times}; keep at least 2")


def _split_ends(key: str, body: str) -> tuple[str, str]:
    ends = [end.strip() for end in key.split("-")]
    if len(ends) != 2 or not all(ends):
        raise MechanismError(f"body {body!r}: length {key!r}; write two of its points with a dash, as in 'B-C'")
    return ends[0], ends[1]


def _unknown_kind(noun: str, name: str, kind: str, kinds: "Mapping[str, AnyKind]") -> MechanismError:
    if noun == "force":
        from jaxnc.forces import CATALOGUE
    else:
        from jaxnc.constraints import CATALOGUE
    return MechanismError(
        f"{noun} {name!r}: unknown kind {kind!r}; a kind of your own is given when loading in Python, "
        f"load(path, kinds={{{kind!r}: …}}), and for those of the catalogue: {nearest(kind, [*CATALOGUE, *kinds])}"
    )


def _check_savable(m: Mechanism, kinds: "Mapping[str, AnyKind]") -> None:
    """Refuse forces that are functions, and kinds of the user's own that are not given."""
    entries: list[tuple[str, str, str, AnyKind | None]] = [
        ("constraint", name, c.kind, m.kinds.get(c.kind)) for name, c in m.model.constraints.items()
    ]
    for name, f in m.model.forces.items():
        if f.kind.startswith("function: "):
            raise MechanismError(
                f"force {name!r} is a function, which a file cannot hold; save the mechanism without it, and add it "
                f"again after load()"
            )
        entries.append(("force", name, f.kind, m.force_kinds.get(f.kind)))
    for noun, name, called, kind in entries:
        if kind is not None and kind not in (_catalogue(noun, called), kinds.get(called)):
            raise MechanismError(
                f"{noun} {name!r} is of your own kind {called!r}, which a file can only name: call "
                f"save(path, kinds={{{called!r}: …}}), and give the same kinds to load()"
            )


# -- layout -----------------------------------------------------------------------------------------------------------


def toml(data: Mapping[str, object], comments: Mapping[str, str] = _NO_COMMENTS) -> str:
    """Lay out the data of a model as TOML: reading it gives the same data, floats bit for bit.

    Tables that are empty are left out; comments stand behind the points and vectors that they are on.
    """
    top = [f"{_toml_key(k)} = {_toml_value(v)}" for k, v in data.items() if not isinstance(v, dict)]
    parts = ["\n".join(top)]
    for name, table in data.items():
        if isinstance(table, dict) and table:
            inner = {k: v for k, v in table.items() if name == "run" and isinstance(v, dict)}
            rows = [_toml_entry(k, v) for k, v in table.items() if k not in inner]
            if name in ("ground", "points", "ground_vectors", "vectors", "markers"):
                rows = [f"{r}  # {comments[k]}" if k in comments else r for r, k in zip(rows, table, strict=True)]
            if rows:
                parts.append("\n".join([f"[{_toml_key(name)}]", *rows]))
            for key, entries in inner.items():
                rows = [_toml_entry(k, v) for k, v in entries.items()]
                parts.append("\n".join([f"[{_toml_key(name)}.{_toml_key(key)}]", *rows]))
    return "\n\n".join(p for p in parts if p) + "\n"


def model_toml(model: record.Model) -> str:
    """Lay out a model as TOML, with what the trade calls the hardpoints of a suspension beside them."""
    names = (*model.ground, *model.points, *model.ground_vectors, *model.vectors, *model.markers)
    return toml(plain(model), trade_names(names))


def json_text(data: Mapping[str, object]) -> str:
    """Lay out the data of a model as JSON: what fits on a line stays on it. Reading it gives the same data."""
    return _json_text({k: v for k, v in data.items() if v != {}}, "") + "\n"


def _json_text(value: object, indent: str) -> str:
    flat = json.dumps(value, ensure_ascii=False, allow_nan=False)
    if not isinstance(value, dict) or not value or (len(indent) >= 4 and len(flat) + len(indent) <= _WIDTH):
        return flat
    deeper = indent + "  "
    rows = [f"{deeper}{json.dumps(k, ensure_ascii=False)}: {_json_text(v, deeper)}" for k, v in value.items()]
    return "{\n" + ",\n".join(rows) + f"\n{indent}}}"


def _toml_entry(key: str, value: object, table: str = "") -> str:
    """Lay out an entry of a table, whose dotted name ends with a point; one that fills a line takes several."""
    name = table + _toml_key(key)
    row = f"{name} = {_toml_value(value)}"
    if len(row) <= _WIDTH or not isinstance(value, dict | list | tuple):
        return row
    if isinstance(value, dict):
        return "\n".join(_toml_entry(k, v, f"{name}.") for k, v in value.items())
    rows, line = [], "   "
    for item in map(_toml_value, value):
        if len(line) + len(item) + 2 > _WIDTH:
            rows.append(line)
            line = "   "
        line += f" {item},"
    return f"{name} = [\n" + "\n".join([*rows, line]) + "\n]"


def _toml_key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _toml_value(key)


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, dict):
        return (
            "{ " + ", ".join(f"{_toml_key(k)} = {_toml_value(v)}" for k, v in value.items()) + " }" if value else "{}"
        )
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    return _toml_number(value)


def _toml_number(value: float) -> str:
    """Write the shortest text that reads back as the same float: whole numbers without a point, -0.0 with its sign."""
    number = float(value)
    if number.is_integer() and abs(number) < 1e15 and (number or math.copysign(1.0, number) > 0):
        return str(int(number))
    return repr(number)
