"""Quantities that a page plots and does not calculate: energies, forces, and the numbers of a suspension."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from jaxnc.viz.numbers import packed
from jaxnc.viz.poses import Poses
from jaxnc.viz.quantities import ENERGIES, EXERTED, Quantity, attitudes, forces_of, quantity


def series(data: Poses, plots: str | Iterable[str] | None, forces: bool) -> dict[str, Any]:
    """``series``, what a page plots of a motion, and ``first``, which of them is shown at first, if one is looked at.

    The plots that are asked for come before those that suit the motion.
    """
    looked = attitudes(data)
    asked = () if plots is None else (plots,) if isinstance(plots, str) else tuple(plots)
    suited = (*ENERGIES, *(f"velocity {s}" for s in data.topology.scalars)) if data.run else looked
    names = dict.fromkeys((*asked, *suited, *(forces_of(data) if forces else ())))
    rows = [row for name in names for row in _rows(quantity(data, name), name in looked)]
    return {"series": rows} | ({"first": 0} if asked or looked else {})


def found(rows: Iterable[dict[str, Any]]) -> list[str]:
    """Names of the forces among what is plotted, which a page may find again."""
    return list(dict.fromkeys(row["name"] for row in rows if row["name"].partition(" ")[0] in EXERTED))


def _rows(found: Quantity, plain: bool) -> list[dict[str, Any]]:
    """A quantity as a page reads it; a vector as its size and its components."""
    turns = found.unit.startswith(("°", "rad")) and not plain
    values = np.radians(found.values) if turns and found.unit.startswith("°") else found.values
    unit = found.unit.removeprefix("°").removeprefix("rad") if turns else found.unit
    rows = [(found.label, values)]
    if values.ndim > 1:
        rows = [(found.label, np.linalg.norm(values, axis=1))] if found.kind == "vector" else []
        rows += [(f"{found.label}, {axis}", x) for axis, x in zip("xyz", values.T, strict=False)]
    out = []
    for text, x in rows:
        size = float(np.nanmax(np.abs(x), initial=0.0)) if np.isfinite(x).any() else 0.0
        quantum = float(10.0 ** np.floor(np.log10(size) - 6)) if size > 0 else 1.0
        said = {"per": unit} if turns else {"unit": unit}
        out.append({"symbol": text, "name": found.name, "angle": turns, "values": packed(x, quantum)} | said)
    return out
