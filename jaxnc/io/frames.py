"""Motions as data frames and data sets, for pandas and xarray."""

import importlib
from collections import defaultdict
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc.dynamics.energy import kinetic_energy, potential_energy
from jaxnc.dynamics.simulation import Simulation
from jaxnc.errors import JaxncError
from jaxnc.io.tables import AXES, ORDERS, PER, SHORT, list_columns, read_quantities
from jaxnc.kinematics.inputs import outside
from jaxnc.status import Status

if TYPE_CHECKING:
    import pandas
    import xarray

    from jaxnc.kinematics.motion import Motion
    from jaxnc.synthesis.result import Result


def to_frame(motion: "Motion", names: Sequence[str] | None = None, unit: str | None = None) -> "pandas.DataFrame":
    """Put a motion into a data frame: the columns of `jaxnc.io.tables.to_csv`, under the same names without units.

    Args:
        motion: the motion; any batch of poses, whose axes become levels of the index.
        names: points, vectors, markers and coordinates; all that moves if not given.
        unit: what angles are given in, ``"rad"`` or ``"deg"``; the mechanism's ``angle_unit`` if not given.

    Returns:
        One row for each pose. Of a simulation there are also ``"kinetic energy"`` and ``"potential energy"``.
        ``frame.attrs["units"]`` has the unit of each column, ``frame.attrs["name"]`` and ``["driven"]`` whose motion it
        is. A pose that failed has the inputs asked for and its status, else NaN.

    Raises:
        InputError: an unknown name or unit, or a batch of designs.
        JaxncError: pandas is not installed.
    """
    found = list_columns(motion, names, unit, "to_frame()")
    pandas = _package("pandas", "to_frame()")
    units = {label: own for label, (own, _) in found.columns.items()}
    data: dict[str, object] = {label: column for label, (_, column) in found.columns.items()}
    words = [Status(s).name.lower() for s in found.status.tolist()]
    data |= {"status": pandas.Categorical(words, [s.name.lower() for s in Status]), "residual": found.residual}
    units["residual"] = motion.system.topology.length_unit
    for label, energy in _energies(motion).items():
        data[label], units[label] = np.where(found.status != 0, np.nan, energy.reshape(-1)), "J"
    index: Any = pandas.RangeIndex(len(words), name="pose")
    if len(found.axes) > 1:
        index = pandas.MultiIndex.from_arrays(list(found.places), names=found.axes)
    frame = pandas.DataFrame(data, index=index)
    frame.attrs = {"name": motion.system.name, "driven": list(motion.driven), "units": units}
    return frame


def to_xarray(motion: "Motion", names: Sequence[str] | None = None, unit: str | None = None) -> "xarray.Dataset":
    """Put a motion into a data set with named dimensions, and the unit of each array in its ``attrs["units"]``.

    ``position`` is ``(pose, point, axis)``, and so are ``velocity``, ``acceleration`` and ``jerk`` if the motion has
    them; in space ``direction`` is ``(pose, vector, axis)``. Angles, distances and single coordinates are arrays
    ``(pose)`` under their own names, their rates under ``v(…)``, ``a(…)`` and ``j(…)``. Inputs and time are coordinates
    of the pose. Of a simulation there are also ``kinetic energy`` and ``potential energy``.

    Args:
        motion: the motion; any batch of poses, whose further axes are ``lane``, or ``lane 1``, ``lane 2``, …
        names: points, vectors, markers and coordinates; all that moves if not given.
        unit: what angles are given in, ``"rad"`` or ``"deg"``; the mechanism's ``angle_unit`` if not given.

    Returns:
        The data set. Poses that failed are NaN, but for the inputs, which are those asked for. A coordinate that is
        called as one of the arrays above has a ``_`` behind its name.

    Raises:
        InputError: an unknown name or unit, or a batch of designs.
        JaxncError: xarray is not installed.
    """
    outside(motion, "to_xarray()")
    xarray = _package("xarray", "to_xarray()")
    top = motion.system.topology
    status = np.asarray(motion.status)
    lanes = status.ndim - 1
    over = tuple(["lane"] if lanes == 1 else [f"lane {k + 1}" for k in range(lanes)]) + ("pose",) * (status.ndim > 0)
    axes = list(AXES[: top.dim])
    spread: dict[tuple[str, int], dict[str, np.ndarray]] = defaultdict(dict)  # by dimension and order
    numbers: dict[str, tuple] = {}
    inputs: dict[str, tuple] = {}
    for order, name, own, values in read_quantities(motion, names, unit):
        if values.ndim > status.ndim:
            spread["vector" if top.is_direction(name) else "point", order][name] = values
            continue
        attrs = {"units": own, "long_name": f"{ORDERS[order]} of {name}" if order else name}
        if order == 0 and name in motion.driven:
            inputs[name] = over, values, attrs
        else:
            numbers[f"{SHORT[order]}({name})" if order else name] = over, values, attrs
    arrays: dict[str, tuple] = {}
    more: dict[str, object] = {"axis": axes}
    for dimension, order in sorted(spread):
        own = top.length_unit if dimension == "point" else "1"
        noun = ORDERS[order] if dimension == "point" else f"{SHORT[order]}(direction)" if order else "direction"
        attrs = {"units": own + PER[order], "long_name": f"{ORDERS[order]} of each {dimension}"}
        arrays[noun] = (*over, dimension, "axis"), np.stack([*spread[dimension, order].values()], axis=-2), attrs
        more[dimension] = [*spread[dimension, order]]
    length = {"units": top.length_unit, "long_name": "largest residual of the constraints"}
    meanings = {"flag_values": [int(s) for s in Status], "flag_meanings": " ".join(s.name.lower() for s in Status)}
    arrays["status"] = over, status, meanings
    arrays["residual"] = over, np.where(status != 0, np.nan, np.asarray(motion.residual, float)), length
    if motion.conditioning is not None:
        attrs = {"units": "1", "long_name": "reciprocal condition number, estimated"}
        arrays["conditioning"] = over, np.asarray(motion.conditioning, float), attrs
    for label, energy in _energies(motion).items():
        arrays[label] = over, np.where(status != 0, np.nan, energy), {"units": "J", "long_name": label}
    if motion.time is not None:
        more["time"] = over, np.broadcast_to(np.asarray(motion.time, float), status.shape), {"units": "s"}
    for dimension, size in zip(over, status.shape, strict=True):
        more[dimension] = np.arange(size)
    taken = {*arrays, *more, "point", "vector"}

    def free(own: dict[str, tuple]) -> dict[str, tuple]:
        return {f"{label}_" if label in taken else label: entry for label, entry in own.items()}

    attrs = {"name": top.name, "driven": ", ".join(motion.driven)}
    return xarray.Dataset({**arrays, **free(numbers)}, {**more, **free(inputs)}, attrs)


def designs_to_frame(result: "Result") -> "pandas.DataFrame":
    """Put what a search has found into a data frame: a row for each design, best first, numbered from 1.

    Args:
        result: what was found.

    Returns:
        Its columns are error, largest, rms, type, transmission (radians), size, starts, converged, optimality,
        feasibility, defects, the unknowns under their names in the problem, and the lengths of links, ``"length B-C"``.
        ``frame.attrs["units"]`` has the unit of each.

    Raises:
        JaxncError: pandas is not installed.
    """
    pandas = _package("pandas", "to_frame()")
    problem = result.problem
    length = problem.system.topology.length_unit
    rows = []
    for d in result.designs:
        row: dict[str, object] = {"error": d.error, "largest": d.largest, "rms": d.rms, "type": d.type}
        row |= {"transmission": d.transmission}
        row |= {f"size {axis}": size for axis, size in zip(AXES, d.size, strict=False)}
        row |= {"starts": d.starts, "converged": d.converged, "optimality": d.optimality, "feasibility": d.feasibility}
        row |= {"defects": "; ".join(d.defects)}
        row |= {f"unknown {name}": float(x) for name, x in zip(problem.names, d.x, strict=True)}
        rows.append(row | {f"length {name}": value for name, value in d.lengths.items()})
    frame = pandas.DataFrame(rows, index=pandas.RangeIndex(1, len(rows) + 1, name="design"))
    units = {"error": problem.error_unit, "largest": problem.unit, "rms": problem.unit, "transmission": "rad"}
    units |= {label: length for label in frame.columns if label.startswith(("size ", "length "))}
    frame.attrs = {"name": problem.name, "units": units}
    return frame


def _energies(motion: "Motion") -> dict[str, np.ndarray]:
    """Return the energies of a simulation, by name."""
    if not isinstance(motion, Simulation):
        return {}
    found = {"kinetic energy": kinetic_energy, "potential energy": potential_energy}
    return {label: np.asarray(energy(motion), float) for label, energy in found.items()}


def _package(name: str, what: str) -> ModuleType:
    """Import a package that is installed only where it is wanted."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise JaxncError(f'{what} needs {name}: pip install "jaxnc[{name}]" (or pip install {name})') from None
