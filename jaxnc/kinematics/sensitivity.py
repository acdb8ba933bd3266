"""How outputs of a mechanism depend on its design: exact derivatives with respect to all design variables at once."""

import csv
import dataclasses
import io
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import shapes_of
from jaxnc.errors import AssemblyError, InputError, list_first, nearest
from jaxnc.kinematics.design import DesignDerivatives, OutputSet, geometry_components, name_outputs, plan_of
from jaxnc.kinematics.inputs import angle_unit, check_system, dense_only
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position
from jaxnc.notebooks import Reported
from jaxnc.system.precision import widened
from jaxnc.system.system import System
from jaxnc.types import Inputs

if TYPE_CHECKING:
    from pathlib import Path

Output = str | Callable[[Motion], Any]
Outputs = Output | Sequence[str] | Mapping[str, Output]


@public
@dataclasses.dataclass(frozen=True, repr=False)
class Sensitivity(Reported):
    """Derivatives of outputs with respect to design variables; ``print()`` shows the largest of them.

    ``found["toe"]`` are the derivatives of an output with respect to every variable, ``(..., variables)``;
    ``found["toe", "2.y"]`` those with respect to one, ``(...)``; ``found["toe", "2"]`` those with respect to the place
    of a point, ``(..., 3)``.

    Attributes:
        name: the mechanism.
        variables: names of the design variables by component: ``"2.x"``, ``"v1.z"``, ``"coupler.B-C"``.
        derivatives: by output, ``(*poses, ..., variables)``; radians and the model's length unit. Zero in poses that
            were not found.
        values: the outputs themselves, ``(*poses, ...)``.
        units: by output: ``"rad"``, the length unit, or ``""`` where unknown or a plain number.
        variable_units: by variable: the length unit, ``"rad"`` for directions (a component tilts them), or ``""``.
        inputs: values of the driven coordinates, ``(*poses,)``.
        converged: which poses are right, ``(*poses,)``.
        exists: whether the mechanism still assembles when a variable alone is changed, ``(variables,)``; where not,
            there is no derivative and zeros stand in its place.
        angle_unit: how tables show angles.
        labels: what else points and vectors are called, by name, if an output knows; tables say it beside them.
    """

    name: str
    variables: tuple[str, ...]
    derivatives: Mapping[str, np.ndarray]
    values: Mapping[str, np.ndarray]
    units: Mapping[str, str]
    variable_units: tuple[str, ...]
    inputs: Mapping[str, np.ndarray]
    converged: np.ndarray
    exists: np.ndarray
    angle_unit: str
    labels: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def failures(self) -> int:
        """How many poses were not found; they have no derivatives."""
        return int(np.sum(~self.converged))

    def __getitem__(self, key: str | tuple[str, str]) -> np.ndarray:
        """Derivatives of an output, with respect to everything or to one variable or point."""
        output, variable = key if isinstance(key, tuple) else (key, None)
        if output not in self.derivatives:
            raise InputError(f"sensitivity: no output {output!r}; {nearest(output, self.derivatives)}")
        found = self.derivatives[output]
        if variable is None:
            return found
        if variable in self.variables:
            return found[..., self.variables.index(variable)]
        at = [k for k, name in enumerate(self.variables) if name in (f"{variable}.{axis}" for axis in "xyz")]
        if not at:
            raise InputError(f"sensitivity: no design variable {variable!r}; {nearest(variable, self.variables)}")
        return found[..., at]

    def table(self, output: str | None = None, unit: str | None = None, most: int | None = 12) -> str:
        """The derivatives of largest magnitude as text, sorted, lengths first and directions after them.

        Args:
            output: one of the outputs; all if not given.
            unit: what angles are shown in, ``"deg"`` or ``"rad"``; the mechanism's own unit if not given.
            most: how many variables per output and unit; None for all.

        Returns:
            A table per output: variable, derivative and unit; of several poses the one with the largest magnitude
            and, beside it, the range over all poses.

        Raises:
            InputError: an unknown output or unit.
        """
        unit = angle_unit(self.angle_unit if unit is None else unit)
        names = list(self.derivatives) if output is None else [output]
        lines = [f"{self.name}: sensitivity to {len(self.variables)} design variables"]
        if self.converged.ndim:
            lines[0] += f", {self.converged.size} poses"
        if self.failures:
            lines.append(f"  {self.failures} of {self.converged.size} poses were not found and are left out")
        if not self.exists.all():
            lost = [v for v, good in zip(self.variables, self.exists, strict=True) if not good]
            lines.append(
                f"  no derivative exists with respect to {list_first(lost, 8)}: changed alone, it does not assemble"
            )
        for name in names:
            for label, block in self._components(name):
                lines += self._block(label, name, block, unit, most)
        return "\n".join(lines)

    def _components(self, name: str) -> list[tuple[str, np.ndarray]]:
        """An output's derivatives as ``(poses, variables)``, component by component."""
        found, lead = self[name], self.converged.ndim
        inner = found.shape[lead:-1] if found.shape[:lead] == self.converged.shape else found.shape[:-1]
        flat = found.reshape(-1, int(np.prod(inner, dtype=int)), len(self.variables))
        if not inner:
            return [(name, flat[:, 0])]
        axes = "xyz" if inner in ((2,), (3,)) else [str(k) for k in range(flat.shape[1])]
        return [(f"{name}.{axes[k]}", flat[:, k]) for k in range(flat.shape[1])]

    def _block(self, label: str, name: str, block: np.ndarray, angle: str, most: int | None) -> list[str]:
        good = self.converged.reshape(-1)
        if len(block) == len(good):
            block = block[good]
        if not len(block):
            return [f"  d {label}: no pose was found"]
        lines = [f"  d {label}"]
        for unit in dict.fromkeys(self.variable_units):
            at = [k for k, u in enumerate(self.variable_units) if u == unit and self.exists[k]]
            if not at:
                continue
            factor, shown = _unit_scale(self.units[name], unit, angle)
            part = block[:, at] * factor + 0.0  # no negative zeros
            size = np.abs(part).max(axis=0)
            order = np.argsort(-size, kind="stable")
            # 1e-12 of the largest derivative: smaller ones are rounding
            order = order[size[order] > 1e-12 * size.max()]
            rest, order = order[most:] if most is not None else order[:0], order[:most]
            told = self._with_labels([self.variables[at[k]] for k in order])
            width = max([16, *map(len, told)])
            for k, name_of in zip(order, told, strict=True):
                worst = part[np.abs(part[:, k]).argmax(), k]
                spread = f"   {part[:, k].min():.4g} … {part[:, k].max():.4g}" if len(part) > 1 else ""
                lines.append(f"    {name_of:<{width}} {worst: .6g} {shown}{spread}")
            if len(rest):
                lines.append(f"    … {len(rest)} smaller ones, at most {size[rest[0]]:.2g} {shown}")
            if nothing := len(at) - len(order) - len(rest):
                lines.append(f"    … {nothing} without influence [{shown}]")
        return lines

    def _with_labels(self, variables: Sequence[str]) -> list[str]:
        """Name variables, and beside them what else their points are called."""
        width = max(map(len, variables), default=0)
        labels = [self.labels.get(variable.rpartition(".")[0], "") for variable in variables]
        return [f"{v:<{width}}  {label}" if label else v for v, label in zip(variables, labels, strict=True)]

    def to_csv(self, path: "str | Path") -> "Path":
        """Write all derivatives as a table: a row for every output and pose, a column for every design variable.

        Args:
            path: file name; missing folders are created.

        Returns:
            The path. Angles are in radians. Poses that were not found, and derivatives that do not exist, are empty.

        Raises:
            OutputError: the file cannot be written.
        """
        from jaxnc.io.target import write

        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        named = [f"{v} [{u}]" if u else v for v, u in zip(self.variables, self.variable_units, strict=True)]
        table.writerow(["output", "unit", "pose", *self.inputs, *named])
        good = self.converged.reshape(-1)
        inputs = [np.asarray(v).reshape(-1) for v in self.inputs.values()]
        for name in self.derivatives:
            for label, block in self._components(name):
                each = len(block) == len(good)
                for i, row in enumerate(block):
                    right = bool(good[i]) if each else True
                    cells = [f"{x:.17g}" if right and e else "" for x, e in zip(row, self.exists, strict=True)]
                    at = [f"{v[i]:.17g}" for v in inputs] if each else [""] * len(inputs)
                    table.writerow([label, self.units[name], i if each else "", *at, *cells])
        return write(path, text.getvalue().encode())

    def __str__(self) -> str:
        return self.table()


@public
@widened
def sensitivity(
    system: System | Motion,
    outputs: Outputs,
    inputs: Inputs | None = None,
    hold: Sequence[str] = (),
    variables: Sequence[str] | None = None,
    units: Mapping[str, str] | None = None,
    throw: bool | None = None,
) -> Sensitivity:
    """Differentiate outputs of a mechanism with respect to all of its design variables, exactly and in one call.

    The inputs keep their values, and held coordinates those of the start pose: the answer is how an output changes at
    the same input when the design is drawn differently.

    Args:
        system: the system; or a motion that is already solved, such as a sweep, and then no inputs.
        outputs: a name of a point, marker, vector or coordinate, or several; or a function of a motion that returns
            an array, a mapping of arrays, or a record such as `jaxnc.suspension` makes; or several functions by name.
            Names and `jaxnc.suspension` (with options by ``functools.partial``) compile nothing;
            a function of one's own is compiled.
        inputs: value or array of values of each driven coordinate, radians and lengths; each solved for on its own.
        hold: free coordinates that keep the value of the start pose.
        variables: names of the design variables (points, vectors, markers, explicit dimensions); all if not given.
        units: ``"rad"`` or another label by output, for tables; those of coordinates and of suspensions are known.
        throw: raise where a single pose is not found or a derivative does not exist, which is the default; True for any
            pose, False for none: they are flagged in ``converged`` and ``exists``.

    Returns:
        The derivatives; see `Sensitivity`. Poses that were not found are counted, and have zeros.

    Raises:
        InputError: unknown names, outputs that are not numbers, a motion of several designs.
        AssemblyError: a pose was not found, or a variable's change alone leaves an overconstrained mechanism no way to
            assemble, so that there is no derivative; by `throw`.
    """
    if isinstance(system, Motion):
        if inputs is not None or hold:
            raise InputError("sensitivity: a solved motion has its inputs already; leave inputs= and hold= out")
        if system._designs:
            raise InputError(
                "sensitivity: this motion is of several designs, and derivatives are of one; ask for each design's own "
                "poses, as nc.sensitivity(motion.pose(k), …)"
            )
        motion, system = system, system.system
        check_system(system, "sensitivity")
    else:
        check_system(system, "sensitivity")
        if inputs is None:
            raise InputError("sensitivity: give inputs={'phi': ...}, the values at which to differentiate")
        motion = solve_position(system, inputs, hold=hold, throw=False)
    if throw or (throw is None and not motion.status.shape):
        motion.check()
    top = system.topology
    dense_only(top, "sensitivity")
    output = OutputSet.of("sensitivity", outputs)
    for _, name in output.wanted:
        if isinstance(name, str):
            motion[name]  # an unknown name is refused here, with those that exist
    names, at, scales = design_components(system, variables)
    view = plan_of(motion)
    by_design = DesignDerivatives(view, motion, at)
    exists = np.ones(len(names), dtype=bool) if view.square else by_design.assemblable()
    if throw is not False and not exists.all():
        lost = [n for n, good in zip(names, exists, strict=True) if not good]
        kept = [n for n, good in zip(names, exists, strict=True) if good]
        raise AssemblyError(
            f"{top.name!r} is overconstrained: changed alone, {list_first(lost, 8)} "
            f"{'leaves' if len(lost) == 1 else 'leave'} it no way to assemble, so there is no derivative. "
            + (f"It exists for {list_first(kept, 8)}: ask for some with variables=. " if kept else "")
            + "throw=False flags them instead"
        )
    readers, labels = output.readers(), {}
    if readers is None:
        record = shapes_of(output, motion)
        values, derivatives = by_design.of_function(output)
    else:
        record = output(motion)
        readings = {label: read(motion) for label, read in readers.items()}
        values, derivatives = name_outputs(record), by_design.of_readings(readings)
        derivatives = {name: derivatives[name] for name in values}
        labels = {name: label for reading in readings.values() for name, label in reading.labels.items()}
    units = dict(units or {})
    for name in units:
        if name not in values:
            raise InputError(f"sensitivity: units for {name!r}, which is no output; {nearest(name, values)}")
    found = {}
    good = np.asarray(motion.converged)
    for name, jacobian in derivatives.items():
        jacobian = np.where(exists, np.asarray(jacobian), 0.0)
        if jacobian.shape[: good.ndim] == good.shape:
            jacobian = np.where(good.reshape(good.shape + (1,) * (jacobian.ndim - good.ndim)), jacobian, 0.0)
        found[name] = jacobian
    known = _known_units(motion, record, output)
    return Sensitivity(
        name=top.name,
        variables=names,
        derivatives=found,
        values={name: np.asarray(v) for name, v in values.items()},
        units={name: units.get(name, known.get(name, "")) for name in values},
        variable_units=scales,
        inputs={name: np.asarray(v) for name, v in motion.inputs.items()},
        converged=good,
        exists=exists,
        angle_unit=top.angle_unit,
        labels=labels,
    )


# -- what is asked for ----------------------------------------------------------------------------------------------


def _known_units(motion: Motion, found: object, output: OutputSet) -> dict[str, str]:
    """Find the units of outputs: of names, or, where all are functions, of what these have returned."""
    top = motion.system.topology
    names = {label: name for label, name in output.wanted if isinstance(name, str)}
    known = {label: "" if top.is_direction(name) else top.unit(name) for label, name in names.items()}
    if not names:
        if not isinstance(found, Mapping):
            return dict(getattr(found, "units", {}))
        for name, value in found.items():
            known |= {f"{name}.{sub}": unit for sub, unit in getattr(value, "units", {}).items()}
    return known


def design_components(
    system: System, variables: Sequence[str] | None
) -> tuple[tuple[str, ...], np.ndarray, tuple[str, ...]]:
    """Find the chosen design variables: their names by component, places in `geometry_vector`, and units."""
    names = geometry_components(system)
    chosen = range(len(names))
    if variables is not None:
        variables = [variables] if isinstance(variables, str) else list(variables)
        for name in variables:
            if name not in system.design_variables and name not in [c for _, c, _ in names]:
                try:
                    system[name]
                except InputError as error:
                    raise InputError(f"sensitivity: {error}") from None
        chosen = [k for k, (name, part, _) in enumerate(names) if name in variables or part in variables]
    at = np.array(list(chosen), dtype=int)
    return tuple(names[k][1] for k in at), at, tuple(names[k][2] for k in at)


# -- words ----------------------------------------------------------------------------------------------------------


def _unit_scale(output: str, variable: str, angle: str) -> tuple[float, str]:
    """Factor and label that show a derivative in the wanted unit of angle."""
    factor, above, below = 1.0, output or "1", variable or "1"
    if angle == "deg":
        factor *= 180.0 / np.pi if output == "rad" else 1.0
        factor *= np.pi / 180.0 if variable == "rad" else 1.0
        above, below = above.replace("rad", "deg"), below.replace("rad", "deg")
    return factor, f"{above}/{below}"
