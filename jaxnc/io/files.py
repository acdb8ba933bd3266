"""Model files: a mechanism read from TOML or JSON, and written to it.

A file holds what the methods of `Mechanism` take, table by table, and is read by calling them: the same checks, the
same messages. Lengths are in any one unit, which ``units.length`` names. Exactly these numbers are converted when they
are used: with ``units.angle = "deg"``, the drives of inputs that are angles (`from`, `to` and `rate` in
``[run.inputs]``). Everything else is taken as it stands; constants of relations between angles are in radians.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from jaxnc.calls import public
from jaxnc.errors import MechanismError, ModelFileError, nearest
from jaxnc.io.drives import check_run
from jaxnc.io.layout import json_text, toml
from jaxnc.io.loads import add_loads, check_savable
from jaxnc.io.schema import decode
from jaxnc.io.source import SUFFIXES, Source
from jaxnc.io.target import file_name, write
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.vehicle.hardpoints import trade_names

if TYPE_CHECKING:
    from jaxnc.constraints import Kind, RateKind


@public
def load(path: str | Path, kinds: "Mapping[str, Kind | RateKind] | None" = None) -> Mechanism:
    """Read a mechanism from a model file.

    Args:
        path: a file ending in ``.toml`` or ``.json``.
        kinds: constraint kinds of your own that the file uses, by name.

    Returns:
        The mechanism, ready to be compiled; its ``model.run`` says how the file wants it driven.

    Raises:
        ModelFileError: the file cannot be read, does not follow the schema or describes something that cannot be
            built. The message names file, line, entry, what was expected and what to try.
    """
    source = Source(file_name(path))
    return _rebuild(decode(source, record.Model), source, kinds or {})


def save(mechanism: Mechanism, path: str | Path, kinds: "Mapping[str, Kind | RateKind] | None" = None) -> Path:
    """Write a mechanism to a model file that `load` turns into an equal one; see `jaxnc.Mechanism.save`."""
    path = file_name(path)
    if path.suffix.lower() not in SUFFIXES:
        raise MechanismError(f"{path}: a model file ends in .toml or .json, this name ends in {path.suffix!r}")
    for name, constraint in mechanism.model.constraints.items():
        kind = constraint.kind
        if mechanism.kinds.get(kind) not in (_catalogue(kind), (kinds or {}).get(kind)):
            raise MechanismError(
                f"constraint {name!r} is of your own kind {kind!r}, which a file can only name: call "
                f"save(path, kinds={{{kind!r}: …}}), and give the same kinds to load()"
            )
    check_savable(mechanism)
    data = plain(mechanism.model)
    if path.suffix.lower() != ".toml":
        return write(path, json_text(data).encode())
    model = mechanism.model
    named = trade_names((*model.ground, *model.points, *model.ground_vectors, *model.vectors, *model.markers))
    return write(path, toml(data, named).encode())


def blame(path: str | Path, error: MechanismError) -> ModelFileError:
    """A complaint about the mechanism of a model file, with the line where its cause stands, to be raised instead."""
    source = Source(file_name(path))
    quoted = str(error).split("'")[1::2]
    for name in quoted:
        for table, entries in source.data.items():
            if isinstance(entries, dict) and name in entries:
                return source.fault(str(error), (table, name))
    return source.fault(str(error))


def _catalogue(name: str) -> "Kind | RateKind | None":
    from jaxnc.constraints import CATALOGUE, RATES, cable, relation

    if sized := re.fullmatch(r"(cable|relation) of ([1-9]\d?)", name):
        return {"cable": cable, "relation": relation}[sized[1]](int(sized[2]))
    return CATALOGUE.get(name) or RATES.get(name)


def plain(model: record.Model) -> dict[str, Any]:
    """A model as plain data: tables that say nothing left out, bodies that are only points as lists of them."""
    data = msgspec.to_builtins(model)
    for name, body in data.get("bodies", {}).items():
        if isinstance(body, dict) and set(body) == {"points"}:
            data["bodies"][name] = body["points"]
    for name, angle in data.get("angles", {}).items():
        data["angles"][name] = {k: angle[k] for k in ("at", *angle) if k in angle}
    name = {"name": model.name}
    return {**name, **{k: v for k, v in data.items() if v != {}}}


def _rebuild(model: record.Model, source: Source, kinds: "Mapping[str, Kind | RateKind]") -> Mechanism:
    """Call the builder for every record, in the order of the schema."""
    with source.blamed():
        m = Mechanism(model.name, model.dim, model.description, model.units.length, model.units.angle)
    for name, at in model.ground.items():
        with source.blamed(("ground", name)):
            m.ground(name, at)
    for name, point in model.points.items():
        with source.blamed(("points", name)):
            point = point if isinstance(point, record.Point) else record.Point(point)
            m.point(name, point.at, point.fixed)
    for name, direction in model.ground_vectors.items():
        with source.blamed(("ground_vectors", name)):
            m.ground_vector(name, direction)
    for name, direction in model.vectors.items():
        with source.blamed(("vectors", name)):
            m.vector(name, direction)
    for name, body in model.bodies.items():
        with source.blamed(("bodies", name)):
            body = body if isinstance(body, record.Body) else record.Body(body)
            lengths = {_ends(key, name): value for key, value in body.lengths.items()}
            m.body(
                name, body.points, lengths, body.local, body.form, body.along, body.vectors,
                body.mass, body.com, body.inertia, body.shape, body.size,
            )  # fmt: skip
    for name, marker in model.markers.items():
        with source.blamed(("markers", name)):
            m.marker(name, marker.on, marker.at, marker.direction)
    for name, a in model.angles.items():
        with source.blamed(("angles", name)):
            m.angle(name, a.at, a.to, a.start, a.form, a.about)
    for name, d in model.distances.items():
        with source.blamed(("distances", name)):
            m.distance(name, d.start, d.to, d.along, d.form)
    for name, joint in model.joints.items():
        with source.blamed(("joints", name)):
            m.add_joint(name, joint)
    for name, relation in model.relations.items():
        with source.blamed(("relations", name)):
            m.relation(name, relation.terms, relation.constant)
    for name, c in model.constraints.items():
        with source.blamed(("constraints", name)):
            kind = kinds.get(c.kind) or _catalogue(c.kind)
            if kind is None:
                raise _unknown_kind(name, c.kind, kinds)
            m.constrain(name, kind, c.points, c.vectors, c.scalars, c.constants)
    add_loads(m, model, source)
    check_run(m, model.run, source.blamed)
    m.model.run = model.run
    return m


def _ends(key: str, body: str) -> tuple[str, str]:
    ends = [end.strip() for end in key.split("-")]
    if len(ends) != 2 or not all(ends):
        raise MechanismError(f"body {body!r}: length {key!r}; write two of its points with a dash, as in 'B-C'")
    return ends[0], ends[1]


def _unknown_kind(name: str, kind: str, kinds: "Mapping[str, Kind | RateKind]") -> MechanismError:
    from jaxnc.constraints import CATALOGUE

    return MechanismError(
        f"constraint {name!r}: unknown kind {kind!r}; a kind of your own is given when loading, "
        f"load(path, kinds={{{kind!r}: …}}), and for those of the catalogue: {nearest(kind, [*CATALOGUE, *kinds])}"
    )
