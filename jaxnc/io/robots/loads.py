"""Springs, dampers, stops and forces of a mechanism in MJCF."""

import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING

import numpy as np

from jaxnc.forces.kind import CATALOGUE
from jaxnc.solvers.assembly import derive
from jaxnc.system.topology import Topology

if TYPE_CHECKING:
    from jaxnc.io.robots.mjcf import Mjcf

_FAR = 1e29  # a stop that is farther away is none
_WRITTEN = {CATALOGUE[way + kind]: kind for kind in ("spring", "damper", "stop") for way in ("", "coordinate ")}


def add_loads(file: "Mjcf") -> None:
    """Write what MJCF has a place for, and name the rest."""
    grown, left = file.grown, file.tree.left_out
    top = grown.system.topology
    for block in top.loads.forces:
        for k, name in enumerate(block.names):
            values = _values(file, block, k)
            what = f"{block.kind.name} {name!r}"
            coordinate = top.coordinates[block.scalars[k][0]] if block.scalars[k] else ""
            points = [top.points[p] for p in block.points[k]]
            kind = _WRITTEN.get(block.kind, "")
            reading = file.tree.readings.get(coordinate)
            if not kind:
                left.append(f"{what}: MJCF has no forces that act by themselves; give it in ctrl or qfrc_applied")
            elif coordinate and reading is None:
                left.append(f"{what}: {coordinate!r} is no sum of joints")
            elif values.get("cubic") or values.get("quadratic"):
                left.append(f"{what}: it is not linear")
            elif reading is not None and len(reading.terms) == 1 and reading.ends is None:
                _on_joint(file, kind, reading, values)
            else:
                _on_tendon(file, kind, name, points, reading, values)
    for function in top.loads.functions:
        left.append(f"force {function.name!r}: a function of time and state; give it in ctrl or qfrc_applied")


def _values(file: "Mjcf", block, k: int) -> dict[str, float]:
    """The parameters of one force: given, or as drawn."""
    system, kind = file.grown.system, block.kind
    top: Topology = system.topology
    physical, dim = np.asarray(system.parameters.physical), top.dim
    given = {kind.parameters[p]: float(physical[at]) for i, p, at in block.given if i == k}
    if kind.drawn is None:
        return given
    drawing, first = np.asarray(derive(system).home), dim * len(top.points)
    found = kind.drawn(
        [drawing[dim * p : dim * p + dim] for p in block.points[k]],
        [drawing[first + dim * v : first + dim * v + dim] for v in block.vectors[k]],
        [drawing[s] for s in block.scalars[k]],
    )
    drawn = {p: float(v) for p, v in zip(kind.parameters, found, strict=True) if v is not None}
    return drawn | given


def _rest(values: dict[str, float]) -> float:
    """Where a spring is without force."""
    return values["free"] - (values["preload"] / values["stiffness"] if values.get("preload") else 0.0)


def _on_joint(file: "Mjcf", kind: str, reading, values: dict[str, float]) -> None:
    """A load on a coordinate that is one joint."""
    ((joint, factor),) = reading.terms.items()
    element = file.joints[joint]
    if kind == "spring":
        if element.get("stiffness"):
            file.tree.left_out.append(f"spring on joint {joint!r}: it has one already")
            return
        _set(element, "stiffness", values["stiffness"] * factor**2)
        _set(element, "springref", (_rest(values) - reading.home) / factor)
    elif kind == "damper":
        _set(element, "damping", float(element.get("damping", 0.0)) + values["damping"] * factor**2)
    else:
        _limit(file, element, [(values[k] - reading.home) / factor for k in ("lower", "upper")], values)


def _on_tendon(file: "Mjcf", kind: str, name: str, points: list[str], reading, values: dict[str, float]) -> None:
    """A load between two points, or on a coordinate that several joints make."""
    label, home = f"{kind} {name}", 0.0
    if points:
        file.string(label, points)
    elif reading.ends is not None:
        file.string(label, list(reading.ends))
    else:
        file.sum(label, reading.terms)
        home = reading.home
    element = next(t for t in file.tendons if t.get("name") == label)
    if kind == "spring":
        _set(element, "stiffness", values["stiffness"])
        _set(element, "springlength", _rest(values) - home)
    elif kind == "damper":
        _set(element, "damping", values["damping"])
    else:
        _limit(file, element, [values[k] - home for k in ("lower", "upper")], values)


def _limit(file: "Mjcf", element: ET.Element, ends: list[float], values: dict[str, float]) -> None:
    """A stop as a limit: where it is; how it yields is MuJoCo's."""
    low, high = sorted(ends)
    far = 1e3 * max(file.grown.size, 10.0)
    element.set("range", f"{max(low, -far)!r} {min(high, far)!r}")
    file.tree.notes.append(
        f"stop on {element.get('name')!r}: it is a limit of MuJoCo, with its own softness, not {values['stiffness']:g}"
    )


def _set(element: ET.Element, key: str, value: float) -> None:
    element.set(key, repr(float(value)))
