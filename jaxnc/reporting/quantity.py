"""Quantities of a motion in the units a person reads, where they are extreme, and the forces that it takes."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jaxnc.calls import public
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import sweep
from jaxnc.system.system import characteristic_length
from jaxnc.system.topology import Topology

ZERO = 1e-9
"""Of the largest number of its kind: what is smaller is rounding, and is shown as zero."""


@public
@dataclass(frozen=True)
class Quantity:
    """A number in every pose.

    Attributes:
        label: what it is called.
        unit: its unit.
        values: its values, NaN where a pose failed, ``(T,)``.
        scale: how large such a quantity naturally is in this mechanism: what is far smaller is rounding.
        rate: whether it is a time derivative.
        size: whether it is the size of a vector, whose square is smooth where it vanishes.
    """

    label: str
    unit: str
    values: np.ndarray
    scale: float
    rate: bool = False
    size: bool = False


@dataclass(frozen=True)
class ExtremeValue:
    """A largest or smallest value."""

    value: float
    at: float  # pose at which it occurs, as a number that may lie between two poses
    refined: bool  # whether it is the vertex of the parabola through three poses


def quantities(motion: Motion, names: Sequence[str]) -> list[Quantity]:
    """List coordinates with their rates; of places coordinates and the sizes of velocity and acceleration."""
    good = np.asarray(motion.status) == 0
    found = []
    paces = [np.max(np.abs(motion.velocity(name))) / _natural(motion, name) for name in motion.driven if motion.rates]
    pace = float(max(paces, default=0.0))
    orders = [(motion.velocity, "v"), (motion.acceleration, "a")][: len(motion.rates)]
    for name in names:
        values, unit, factor = np.asarray(motion[name]), *unit_of(motion, name)
        scale = factor * _natural(motion, name)
        rates = [(np.asarray(read(name)), letter) for read, letter in orders]
        if values.ndim > 1:
            axes = "xyz"[: values.shape[-1]]
            found += [Quantity(f"{name}.{axis}", unit, values[:, k], scale) for k, axis in enumerate(axes)]
            sizes = [(np.linalg.norm(rate, axis=-1), f"|{letter}({name})|") for rate, letter in rates]
        else:
            found.append(Quantity(name, unit, values * factor, scale))
            sizes = [(rate * factor, f"{letter}({name})") for rate, letter in rates]
        for (size, label), per in zip(sizes, ("/s", "/s^2"), strict=False):
            scale *= pace
            found.append(Quantity(label, unit + per, size, scale, rate=True, size=values.ndim > 1))
    return [replace(q, values=np.where(good, q.values, np.nan)) for q in found]


def unit_of(motion: Motion, name: str) -> tuple[str, float]:
    """Find the unit of a motion's quantity, and its factor; see `shown_in`."""
    return shown_in(motion.system.topology, name)


def shown_in(top: Topology, name: str) -> tuple[str, float]:
    """Find the unit in which a quantity is shown, and the factor that brings it there."""
    degrees = top.is_angle(name) and top.angle_unit == "deg"
    return ("deg", 180.0 / np.pi) if degrees else (top.unit(name), 1.0)


def course(motion: Motion) -> np.ndarray | None:
    """Find the numbers that poses are in order of, to refine between them: a single input, or else the time."""
    if len(motion.driven) == 1:
        return np.asarray(motion[motion.driven[0]], float).reshape(-1)
    return None if motion.time is None else np.asarray(motion.time, float).reshape(-1)


def extreme_of(q: Quantity, along: np.ndarray | None, largest: bool) -> ExtremeValue:
    """Find the largest or smallest of a quantity's values; that of a size by its square. See `extreme`."""
    if not q.size:
        return extreme(q.values, along, largest)
    found = extreme(q.values**2, along, largest)
    return replace(found, value=max(found.value, 0.0) ** 0.5)


def extreme(values: np.ndarray, along: np.ndarray | None, largest: bool) -> ExtremeValue:
    """Find the largest or smallest of some values.

    There is a number for each pose, NaN where it failed; not all of them. It is refined by a parabola over the input,
    or the time, if that is given as `along`; otherwise it is that of a pose.
    """
    i = int(np.nanargmax(values) if largest else np.nanargmin(values))
    of_pose = ExtremeValue(float(values[i]), i, False)
    if along is None or not 0 < i < len(values) - 1:
        return of_pose
    u, y = along[i - 1 : i + 2] - along[i], values[i - 1 : i + 2] - values[i]
    # The parabola y = b u + c u² through the neighbours of a pose that is put at the origin.
    width = u[0] * u[2] * (u[0] - u[2])
    if not (np.isfinite(y).all() and u[0] * u[2] < 0):
        return of_pose
    b = (y[2] * u[0] ** 2 - y[0] * u[2] ** 2) / width
    c = (y[0] * u[2] - y[2] * u[0]) / width
    vertex = -b / (2.0 * c) if c else 0.0
    if abs(vertex) < 1e-6 * abs(u[2] - u[0]):
        return of_pose
    at = i + float(vertex / (u[2] if vertex * u[2] > 0 else -u[0]))
    return ExtremeValue(float(values[i] - b * b / (4.0 * c)), at, True)


def constant(values: np.ndarray) -> bool:
    """Tell whether a quantity does not vary, up to rounding."""
    return float(np.nanmax(values) - np.nanmin(values)) <= ZERO * float(np.nanmax(np.abs(values)))


def _natural(motion: Motion, name: str) -> float:
    """Choose the natural size of a coordinate: a radian, a unit vector, or the size of the mechanism."""
    top = motion.system.topology
    if top.is_angle(name) or top.is_direction(name):
        return 1.0
    return float(characteristic_length(motion.system.parameters.points))


# -- forces -----------------------------------------------------------------------------------------------------------


@public
@dataclass(frozen=True)
class Peak:
    """The largest force or moment that something exerts on a body.

    Attributes:
        on: the body.
        by: what exerts it.
        force: its largest size, N.
        moment: the largest moment about the body's centre of mass, N m.
        pose: where the force is largest.
    """

    on: str
    by: str
    force: float
    moment: float
    pose: int


@public
@dataclass(frozen=True)
class Forces:
    """Forces of a motion.

    Attributes:
        motion: with the rates that they are of.
        resting: whether no rates were given, so that every pose is held at rest.
        efforts: of the inputs, one each.
        power: of all of them together; None at rest, and where nothing is driven.
        peaks: the largest first.
    """

    motion: Motion
    resting: bool
    efforts: tuple[Quantity, ...]
    power: Quantity | None
    peaks: tuple[Peak, ...]


def forces(motion: Motion) -> Forces | None:
    """Find efforts and reactions of a sweep; None where nothing has a mass, or no pose was found.

    Without rates every pose is held at rest: gravity, springs and the like alone act.
    """
    good = np.asarray(motion.converged)
    if not motion.system.topology.loads.inertias or not good.any() or motion.system.topology.rates:
        return None
    resting = len(motion.rates) < 2
    if resting:
        still = dict.fromkeys(motion.driven, 0.0)
        motion = sweep(motion.system, dict(motion.inputs), rates=still, hold=motion.held, throw=False)
    from jaxnc.dynamics.reactions import inverse_dynamics

    found = inverse_dynamics(motion.system, motion)
    top = motion.system.topology
    efforts = []
    for k, name in enumerate((*motion.driven, *motion.held)):
        angle = top.is_angle(name)
        values = np.where(good, np.asarray(found.efforts)[..., k], np.nan)
        efforts.append(Quantity(f"effort {name}", "N m" if angle else "N", values, float(np.nanmax(np.abs(values)))))
    power = None
    if efforts and not resting:
        values = np.where(good, np.asarray(found.power), np.nan)
        power = Quantity("power", "W", values, float(np.nanmax(np.abs(values))))
    peaks = sorted(_peaks(found.reactions.all(), good), key=lambda p: -p.force)
    return Forces(motion, resting, tuple(efforts), power, tuple(peaks[:24]))  # peaks of forces that are listed


def _peaks(wrenches: dict, good: np.ndarray) -> Iterator[Peak]:
    """Find the largest of every wrench over the poses that were found."""
    found = []
    for body, some in wrenches.items():
        for by, wrench in some.items():
            if by == "weight":
                continue
            force = np.where(good, np.linalg.norm(np.asarray(wrench.force), axis=-1), 0.0)
            moment = np.asarray(wrench.moment)
            moment = np.abs(moment) if moment.ndim == 1 else np.linalg.norm(moment, axis=-1)
            turns = float(np.where(good, moment, 0.0).max())
            found.append(Peak(body, by, float(force.max()), turns, int(force.argmax())))
    size = max((p.force for p in found), default=0.0)
    most = max((p.moment for p in found), default=0.0)
    yield from (p for p in found if p.force > ZERO * size or p.moment > ZERO * most)
