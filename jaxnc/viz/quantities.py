"""Quantities that can be plotted: positions, coordinates, rates, forces and energies by name, with their units."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxnc.dynamics.energy import energy, kinetic_energy, potential_energy
from jaxnc.errors import InputError, nearest
from jaxnc.forces import COUPLE
from jaxnc.kinematics.motion import Motion
from jaxnc.types import Numbers
from jaxnc.vehicle.report import LABELS
from jaxnc.vehicle.suspension import ATTITUDE, NUMBERS
from jaxnc.viz.poses import Poses
from jaxnc.viz.style import symbol

if TYPE_CHECKING:
    from jaxnc.dynamics.reactions import Reactions

_RATES = {"velocity": 1, "acceleration": 2, "jerk": 3}
_TURNS = {"orientation": 0, "angular velocity": 1, "angular acceleration": 2}
ENERGIES = {"energy": energy, "kinetic energy": kinetic_energy, "potential energy": potential_energy}
"""Of a mechanism with masses, and how they are found."""
EXERTED = ("effort", "load", "reaction", "support")
"""What acts on it, before a name."""
_PER = ("", "/s", "/s²", "/s³")


@dataclass(frozen=True)
class Quantity:
    """A quantity over the poses of a motion."""

    name: str  # as asked for
    label: str  # as written beside its curve
    dimension: str  # what an axis with such quantities is called: "angle", "velocity", …
    unit: str  # of the values
    values: np.ndarray  # (T,), or (T, dim) for a place or a vector; NaN where a pose is not right. Angles in the unit
    # "place" (a path in the plane), "components" (of a place or direction in space), "vector" (a rate, which has a
    # magnitude too) or "number"
    kind: str

    @property
    def axis(self) -> str:
        """Name and unit, for an axis."""
        return f"{self.dimension} [{self.unit}]" if self.unit else self.dimension


def quantity(poses: Poses, name: str) -> Quantity:
    """Look a quantity up.

    Args:
        poses: the motion.
        name: ``"P"``, ``"P.x"``, ``"phi"``, in space a unit vector ``"v"`` or ``"v.x"``, any of them after
            ``"velocity "``, ``"acceleration "`` or ``"jerk "``; a body after ``"orientation "``,
            ``"angular velocity "`` or ``"angular acceleration "``; ``"time"``; ``"energy"``, ``"kinetic energy"``,
            ``"potential energy"``; ``"effort phi"``, ``"load spring"``, ``"support A"``, ``"reaction B on coupler"``;
            of a suspension with the usual names ``"camber"``, ``"toe"`` and the other numbers of a `Suspension`.
    """
    motion, top = poses.motion, poses.topology
    if not isinstance(name, str):
        raise InputError(f"quantities are named by strings, plot('P', 'velocity P'), got {name!r}")
    nouns = (*_TURNS, *EXERTED, *_RATES)
    noun, what = next(((n, name.removeprefix(f"{n} ")) for n in nouns if name.startswith(f"{n} ")), ("", name))
    if noun in _TURNS:
        return _turning(poses, noun, _TURNS[noun], what)
    if name == "time" and name not in motion.names:
        if motion.time is None:
            raise InputError(f"{top.name!r}: this motion has no time; make it with motion(system, inputs, t)")
        return Quantity(name, "time", "time", "s", np.asarray(motion.time, float).reshape(-1), "number")
    if (number := _attitude(poses, name)) is not None:
        return number
    if name in ENERGIES:
        return _plain_quantity(poses, name, "energy", top.load_unit("energy"), ENERGIES[name](motion))
    if noun in EXERTED:
        return _force(poses, noun, what)
    return _coordinate(poses, name, _RATES.get(noun, 0), what)


def _coordinate(poses: Poses, name: str, order: int, what: str) -> Quantity:
    """Read a coordinate, place or direction, or a rate of one."""
    motion, top, axes = poses.motion, poses.topology, "xyz"[: poses.dim]
    scalar, angle = what in top.scalars, top.is_angle(what)
    stem, _, axis = (what, "", "") if scalar else what.partition(".")
    direction = stem in poses.directions
    named = (*poses.names, *poses.directions)
    if not scalar and (stem not in named or axis not in ("", *axes)):
        names = (*named, *(f"{p}.{axis}" for p in named for axis in axes), *top.scalars)
        raise InputError(f"plot: {top.name!r} has no quantity {name!r}; {nearest(what, names)}")
    read = (motion.__getitem__, motion.velocity, motion.acceleration, motion.jerk)[order]
    values = _right_values(poses, read(stem))
    if scalar or axis:
        values = values[:, axes.index(axis) if axis else 0]
    rate = ("", *_RATES)[order]
    kind = "number" if values.ndim == 1 else "vector" if order else "place" if poses.dim == 2 else "components"
    label = (f"{rate} of " if order else "") + symbol(what)
    if direction:
        noun = ("direction", "rate of direction", "second rate of direction", "third rate of direction")[order]
        return Quantity(name, label, noun, ("", "1/s", "1/s²", "1/s³")[order], values, kind)
    noun = ("angular " if angle else "") + rate if order else "angle" if angle else "length"
    return _in_units(poses, name, label, noun, order, angle, values, kind)


def _right_values(poses: Poses, values: Numbers) -> np.ndarray:
    """Bring values over the poses to the host, ``(T, n)``, NaN where a pose is not right."""
    return np.where(poses.good[:, None], np.asarray(values, float).reshape(poses.count, -1), np.nan)


def _plain_quantity(poses: Poses, name: str, dimension: str, unit: str, values: Numbers) -> Quantity:
    """Make a quantity of its own unit; a vector if it has components."""
    values = _right_values(poses, values)
    vector = values.shape[1] == poses.dim
    return Quantity(name, name, dimension, unit, values if vector else values[:, 0], "vector" if vector else "number")


def _force(poses: Poses, noun: str, what: str) -> Quantity:
    """Read a force: ``"effort phi"``, ``"load spring"``, ``"support A"``, ``"reaction B on coupler"``."""
    top, name = poses.topology, f"{noun} {what}"
    values = force_values(poses.reactions, name)
    if values.ndim > poses.motion.status.ndim and values.shape[-1] != poses.dim:
        raise InputError(f"plot: {name!r} acts on all coordinates, and is no curve; plot what it does to one of them")
    turns = noun == "effort" and top.is_angle(what)
    turns = turns or (noun == "load" and _couple(poses, what))
    dimension = ("torque", top.load_unit("moment")) if turns else ("force", top.load_unit("force"))
    return _plain_quantity(poses, name, *dimension, values)


def force_values(found: "Reactions", name: str) -> Any:
    """Read the numbers of a force by its name, such as ``"reaction B on coupler"``, ``(...,)``."""
    noun, _, what = name.partition(" ")
    if noun == "reaction":
        point, between, body = what.partition(" on ")
        if not between:
            raise InputError(f"plot: {name!r}: a reaction is of a point on a body, such as 'reaction B on coupler'")
        return found.at(point, on=body).force
    return {"support": found.support, "effort": found.effort, "load": lambda x: found.load(x).value}[noun](what)


def forces_of(poses: Poses) -> tuple[str, ...]:
    """List the names of forces: efforts of the inputs, loads, what passes through points and into the ground."""
    top, loads = poses.topology, poses.topology.loads
    out = [f"effort {name}" for name in poses.motion.driven]
    out += [f"load {name}" for block in loads.forces for name in block.names]
    out += [f"load {f.name}" for f in loads.functions if f.acts != "load"]
    for k, point in enumerate(top.points):
        on = [body.name for body in top.bodies if k in body.points]
        if all(top.fixed[top.dim * k : top.dim * (k + 1)]):
            out += [f"support {point}"] if on else []
        elif len(on) > 1:
            out.append(f"reaction {point} on {on[0]}")
    return tuple(out)


def attitudes(poses: Poses) -> tuple[str, ...]:
    """List the names of the numbers of a suspension with the usual names; none of anything else."""
    found = poses.wheel
    return () if found is None else tuple(n for n in LABELS if n in NUMBERS and getattr(found, n) is not None)


def _attitude(poses: Poses, name: str) -> Quantity | None:
    """Read a number of a suspension, angles in degrees as usual; None where there is no such number."""
    if name in poses.motion.names or name not in LABELS or name not in NUMBERS:
        return None
    found = poses.wheel
    if found is None or getattr(found, name) is None:
        return None
    values, kind = np.asarray(getattr(found, name), float).reshape(-1), ATTITUDE.get(name)
    unit = {"angle": "°", "length": found.length_unit}.get(kind or "", "")
    return _plain_quantity(poses, LABELS[name], LABELS[name], unit, np.degrees(values) if kind == "angle" else values)


def _couple(poses: Poses, load: str) -> bool:
    """Tell whether a load is a torque: a couple, or an effort on an angle."""
    top = poses.topology
    first = len(top.coordinates) - len(top.scalars)
    angles = {first + k for k, angle in enumerate(top.angles) if angle}
    for block in top.loads.forces:
        if load in block.names:
            at = block.scalars[block.names.index(load)] if block.scalars else ()
            return block.kind == COUPLE or (len(at) == 1 and int(at[0]) in angles)
    return any(f.name == load and f.acts == "effort" and f.at in angles for f in top.loads.functions)


def _turning(poses: Poses, noun: str, order: int, body: str) -> Quantity:
    motion = poses.motion
    if poses.dim == 3 and order == 0:
        raise InputError(
            f"plot: in space the orientation of {body!r} is a matrix, not a curve; plot 'angular velocity {body}', an "
            "angle, or the components of a unit vector of the body"
        )
    read = (motion.orientation, motion.angular_velocity, motion.angular_acceleration)[order]
    values = _right_values(poses, read(body))
    values, kind = (values[:, 0], "number") if poses.dim == 2 else (values, "vector")
    dimension = "angle" if order == 0 else noun
    return _in_units(poses, f"{noun} {body}", f"{noun} of {body}", dimension, order, True, values, kind)


def _in_units(poses: Poses, name, label, dimension, order, angle, values, kind) -> Quantity:
    top = poses.topology
    unit = (poses.angles if angle else top.length_unit) + _PER[order]
    if angle and poses.angles == "deg":
        unit = "°" if order == 0 else "°" + _PER[order]
        values = np.degrees(values)
    return Quantity(name, label, dimension, unit, values, kind)


def running(motion: Motion) -> str | None:
    """Choose the input that curves are drawn over: the only one, or the first that runs one way, if any."""
    if len(motion.driven) < 2:
        return next(iter(motion.driven), None)
    asked = np.asarray(motion.asked, float).reshape(-1, len(motion.driven))
    steps = zip(motion.driven, np.diff(asked, axis=0).T, strict=True)
    return next((name for name, d in steps if (d > 0).all() or (d < 0).all()), None)


def abscissa(poses: Poses, against: str | None) -> Quantity:
    """Choose what curves are drawn over: a quantity by name, time, an input, or the number of the pose.

    Of several inputs it is the first that runs one way: over one that goes to and fro, curves would be loops.

    Where poses are not right the inputs were not reached; the axis shows the values that were asked for, so that the
    failure has an extent.
    """
    motion = poses.motion
    if against is None:
        against = "time" if motion.time is not None else running(motion) or "pose"
    if against == "pose" and against not in motion.names:
        return Quantity("pose", "pose", "pose", "", np.arange(poses.count, dtype=float), "number")
    found = quantity(poses, against)
    if found.kind != "number":
        axes = [f"{against}.{axis}" for axis in "xyz"[: poses.dim]]
        raise InputError(
            f"against={against!r} is a point; give one number, {', '.join(map(repr, axes[:-1]))} or {axes[-1]!r}"
        )
    values = found.values
    if against in motion.driven:
        values = np.asarray(motion.inputs[against], float).reshape(-1)
        values = np.degrees(values) if found.unit == "°" else values
    dimension = found.dimension if against == "time" else found.label
    return Quantity(found.name, found.label, dimension, found.unit, values, "number")


def default_plots(data: Poses) -> tuple[str, ...]:
    """Choose what is plotted if nothing is named; of a point that goes straight its coordinates, not a line."""
    top = data.topology
    if free := tuple(s for s in top.scalars if s not in data.motion.driven):
        return free
    column = _looked_at_point(data)
    name, x = data.names[column], data.places[data.extent_poses, column]
    size = float(np.ptp(data.places[data.extent_poses], axis=(0, 1)).max())
    still = 1e-9  # of the size: what moves less stands still
    moving = [axis for axis, span in zip("xyz", np.ptp(x, axis=0), strict=False) if span > still * size]
    spread = np.linalg.svd(x - x.mean(axis=0), compute_uv=False)
    if not moving or (data.dim == 2 and spread[1] > still * spread[0]):
        return (name,)
    return tuple(f"{name}.{axis}" for axis in moving)


def _looked_at_point(data: Poses) -> int:
    """Choose the last point or marker that moves; if there is one, one that does not merely turn about the ground."""
    top, x = data.topology, data.places[data.extent_poses]
    ground = set(np.flatnonzero(np.ptp(x, axis=0).max(axis=-1) == 0.0).tolist())
    turning = {b.name for b in top.bodies if ground & set(b.points)}
    markers = {m.name: m.body for m in top.markers}
    moving = [k for k in range(len(data.names)) if k not in ground] or [len(data.names) - 1]
    turned = {k for b in top.bodies if b.name in turning for k in b.points}
    free = [k for k in moving if k not in turned and markers.get(data.names[k]) not in turning]
    return (free or moving)[-1]
