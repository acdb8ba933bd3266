"""What suspension designers read off a motion: camber, toe, steering axis, track, motion ratio, roll centre."""

import dataclasses
import functools
import warnings
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.compiling import jit
from jaxnc.constraints.kind import ratio
from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.rates import rates
from jaxnc.kinematics.sizes import METRES, doubtful_size
from jaxnc.solvers.assembly import derive
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.equations import Equations
from jaxnc.types import Array

if TYPE_CHECKING:
    from pathlib import Path

Line = str | tuple[str, str]
"""A direction: the name of a unit vector or marker, or two points."""

_ROWS = 13  # of a printed table
_ANGLES = ("camber", "toe", "steer", "caster", "kingpin_inclination")
_LENGTHS = (
    "scrub_radius",
    "caster_trail",
    "wheel_travel",
    "half_track_change",
    "wheelbase_change",
    "roll_centre_height",
    "spring_length",
)
ATTITUDE = {**{str(name): "angle" for name in _ANGLES}, **{str(name): "length" for name in _LENGTHS}}
"""Names of what a `Suspension` tells, and whether it is an angle or a length."""


class _Names(NamedTuple):
    """What the parts of a suspension are called."""

    wheel_centre: str
    spin_axis: Line
    steering_axis: tuple[str, str] | None
    contact: str | None
    spring: Line | None


_USUAL = (
    _Names("wheel_centre", ("wheel_centre", "spindle"), ("lower_ball", "upper_ball"), "contact", "damper"),
    _Names("wheel_centre", "spin_axis", ("lower_ball", "upper_ball"), "contact", "damper"),
    _Names("6", "v2", ("2", "8"), "contact", "s"),  # figure 42
)
"""Names that are looked for where none are given: those of `jaxnc.library`."""


class Suspension(eqx.Module):
    """A wheel's attitude along a motion, by the sign conventions of ISO 8855; ``print()`` shows degrees and mm.

    Every array has the shape of the motion's poses ``(...,)``; angles in radians, lengths in the model's unit. What
    cannot be told, because no steering axis or no spring is known, is None.

    Attributes:
        camber: from the vertical to the wheel plane, positive if the top of the wheel leans outward.
        toe: toe-in, from the x axis to the wheel's trace on the road, positive if the front of the wheel points inward.
        steer: the same angle counted about the z axis: positive to the left on either side.
        caster: from the z axis to the steering axis, seen along y, positive if its top leans to the rear.
        kingpin_inclination: the same seen along x (steering-axis inclination), positive if its top leans inward.
        scrub_radius: how far inboard of the contact centre the steering axis meets the road, across the wheel's trace
            (kingpin offset at ground).
        caster_trail: how far ahead of the contact centre it meets the road, along the wheel's trace.
        wheel_travel: rise of the wheel centre over its drawn place.
        half_track_change: displacement of the contact centre from its drawn place, positive outward.
        wheelbase_change: displacement of the wheel centre from its drawn place, positive where the wheelbase grows.
        spring_length: length of the spring or damper.
        motion_ratio: shortening of the spring per rise of the wheel centre, the other inputs held.
        roll_centre_height: height over the road of the point of the vehicle's centre plane (y = 0) that lies on the
            normal to the contact centre's path in the front view; left and right wheel taken as mirror images.
        contact: contact centre, the lowest point of the wheel's disc, ``(..., 3)``.
        converged: which poses are right; numbers of the others mean nothing.
        length_unit: the model's.
    """

    camber: Array
    toe: Array
    steer: Array
    caster: Array | None
    kingpin_inclination: Array | None
    scrub_radius: Array | None
    caster_trail: Array | None
    wheel_travel: Array
    half_track_change: Array
    wheelbase_change: Array
    spring_length: Array | None
    motion_ratio: Array | None
    roll_centre_height: Array
    contact: Array
    converged: Array
    length_unit: str = eqx.field(static=True, default="m")

    @property
    def units(self) -> dict[str, str]:
        """The unit of every number that is known: ``"rad"``, the model's length unit, or ``""`` for a ratio."""
        units = dict.fromkeys(_ANGLES, "rad") | dict.fromkeys(_LENGTHS, self.length_unit)
        units |= {"motion_ratio": "", "contact": self.length_unit}
        return {f.name: units[f.name] for f in dataclasses.fields(self) if f.name in units and _known(self, f.name)}

    def degrees(self) -> dict[str, Array]:
        """The known numbers by name, angles in degrees, lengths in the model's unit, one number a pose."""
        return {
            name: jnp.degrees(getattr(self, name)) if unit == "rad" else getattr(self, name)
            for name, unit in self.units.items()
            if name != "contact"
        }

    def table(self, rows: int | None = None) -> str:
        """The numbers as text: degrees, and millimetres where the model's unit is a usual one.

        Args:
            rows: about how many poses to show, evenly chosen; all if not given.

        Returns:
            A table, one line a pose; poses that failed are marked.
        """
        header, columns = _shown(self)
        good = np.asarray(self.converged).reshape(-1)
        at = range(len(good))
        if rows is not None and len(good) > rows:
            at = np.unique(np.linspace(0, len(good) - 1, rows).round().astype(int)).tolist()
        lines = [header] + [
            [f"{c[i]:.4f}" if good[i] else "-" for c in columns] + ([] if good[i] else ["not found"]) for i in at
        ]
        widths = [max(map(len, c)) for c in zip(*[line[: len(header)] for line in lines], strict=True)]
        return "\n".join(
            "  ".join([*(c.rjust(w) for c, w in zip(line, widths, strict=False)), *line[len(widths) :]])
            for line in lines
        )

    def to_csv(self, path: "str | Path") -> "Path":
        """Write all poses as a table, with the columns of `table`; poses that failed have empty cells.

        Args:
            path: file name; missing folders are created.

        Returns:
            The path.

        Raises:
            OutputError: the file cannot be written.
        """
        from jaxnc.io.target import write

        header, columns = _shown(self)
        good = np.asarray(self.converged).reshape(-1)
        lines = [",".join(header)]
        lines += [",".join(f"{c[i]:.17g}" if good[i] else "" for c in columns) for i in range(len(good))]
        return write(path, ("\n".join(lines) + "\n").encode())

    def __repr__(self) -> str:
        shape = "×".join(map(str, self.camber.shape)) or "one"
        return f"Suspension({shape} poses: {', '.join(self.units)})"

    def __str__(self) -> str:
        if isinstance(self.camber, Tracer):
            return repr(self)
        failed = int(np.sum(~np.asarray(self.converged)))
        note = f"\n{failed} of {self.converged.size} poses were not found" if failed else ""
        return self.table(_ROWS) + note


def _known(record: Suspension, name: str) -> bool:
    return getattr(record, name) is not None


def _shown(record: Suspension) -> tuple[list[str], list[np.ndarray]]:
    """Headers and columns of the table, wheel travel first."""
    unit = record.length_unit
    factor, label = (METRES[unit] * 1e3, "mm") if unit in METRES else (1.0, unit)
    units = record.units
    names = ["wheel_travel", *(n for n in units if n not in ("wheel_travel", "contact"))]
    header, columns = [], []
    for name in names:
        values = np.asarray(getattr(record, name)).reshape(-1)
        scale, shown = {"rad": (180.0 / np.pi, "deg"), "": (1.0, "")}.get(units[name], (factor, label))
        header.append(name.replace("_", " ") + (f" [{shown}]" if shown else ""))
        columns.append(values * scale)
    return header, columns


def suspension(
    motion: Motion,
    side: str = "left",
    wheel_centre: str | None = None,
    spin_axis: Line | None = None,
    steering_axis: tuple[str, str] | None = None,
    contact: str | None = None,
    radius: float | Array | None = None,
    spring: Line | None = None,
    bump: str | None = None,
    steer: str | None = None,
    carrier: str | None = None,
    axle: str = "front",
) -> Suspension:
    """Camber, toe, caster, kingpin inclination and the rest along a motion of a suspension.

    The axes are those of ISO 8855: x forward, y to the left with y = 0 in the vehicle's centre plane, z up; the road is
    horizontal, and the wheel a thin disc. Displacements count from the drawing. Rates are exact: they follow from the
    constraints' derivatives in every pose, also where the motion itself carries none. Pure JAX and differentiable.

    Args:
        motion: any poses of a spatial mechanism: a sweep, a grid, a single pose.
        side: ``"left"`` or ``"right"`` wheel.
        wheel_centre: point or marker. Default: ``wheel_centre``, or ``6`` in a MacPherson suspension of figure 42.
        spin_axis: direction of the wheel's axis, either way round: a unit vector or marker, or two points. Default:
            ``("wheel_centre", "spindle")``, ``spin_axis``, or ``v2``.
        steering_axis: two points of it (lower ball joint, upper ball joint or top mount). Default: ``("lower_ball",
            "upper_ball")``, or ``("2", "8")``; None if there are no such points. With `carrier` and `steer` given
            instead, the instantaneous axis about which the carrier steers (multilink suspensions).
        contact: a point or marker drawn where the wheel touches the road; its drawn distance from the wheel centre is
            the tyre's loaded radius. Default: ``contact``.
        radius: the loaded radius itself, a length, instead.
        spring: the spring or damper: a distance by name, or the two points of its ends. Default: ``damper`` or ``s``.
        bump: the input by which the wheel rises. Default: the wheel centre's height if that is driven, or else the
            first input.
        steer: for an instantaneous steering axis: the input that steers.
        carrier: for an instantaneous steering axis: the wheel carrier, a body.
        axle: ``"front"`` or ``"rear"``: which way the wheelbase grows.

    Returns:
        The numbers; see `Suspension`.

    Raises:
        InputError: a planar mechanism, a name that is not there, a wheel on the other side, or no tyre radius.

    Source: ISO 8855:2011, Road vehicles: vehicle dynamics and road-holding ability, vocabulary.
    """
    top = motion.system.topology
    if top.dim != 3:
        raise InputError(f"suspension() is for spatial mechanisms; {top.name!r} is planar")
    for name, value, allowed in (("side", side, ("left", "right")), ("axle", axle, ("front", "rear"))):
        if value not in allowed:
            raise InputError(f"suspension: {name}={value!r}; use one of {', '.join(map(repr, allowed))}")
    instantaneous = steering_axis is None and (carrier is not None or steer is not None)
    if radius is not None and contact is not None:
        raise InputError("suspension: contact= and radius= both give the tyre's radius; leave one of them out")
    names = _resolved(motion, wheel_centre, spin_axis, steering_axis, contact, spring)
    if radius is None and names.contact is None:
        raise InputError(
            "suspension: the tyre's radius is not known; give radius=, or contact=, a point or marker drawn "
            "where the wheel touches the road"
        )

    eq = derive(motion.system)
    drawn = _posed(motion, eq.home)
    doubt = doubtful_size(motion.system, suspension=True)
    if doubt:
        warnings.warn(f"{top.name!r}: {doubt}", UserWarning, stacklevel=2)
    outward = 1.0 if side == "left" else -1.0
    centre_drawn = drawn[names.wheel_centre]
    _on_side(centre_drawn, side, names.wheel_centre)
    if radius is None and names.contact is not None:
        radius = _length(drawn[names.contact] - centre_drawn)
    r = jnp.asarray(radius, float)

    # What is read off the wheel is a function of its centre and its axis in space.
    rising = _driven_by(motion, eq, _bump(motion, bump, names.wheel_centre))
    centre, lift = motion[names.wheel_centre], rising.velocity(names.wheel_centre)
    axis, axis_rate = _line(motion, names.spin_axis), _line(rising, names.spin_axis, rate=True)
    leftward = jnp.where(axis[..., 1:2] < 0, -1.0, 1.0)

    def touch(centre, axis):
        axis = axis / _length(axis)[..., None]
        up = jnp.array([0.0, 0.0, 1.0]) - axis[..., 2:] * axis
        return centre - r * up / _length(up)[..., None]

    place, path = jax.jvp(touch, (centre, axis), (lift, axis_rate))
    start = touch(centre_drawn, _line(drawn, names.spin_axis))
    axis = leftward * axis / _length(axis)[..., None]  # to the left on either side
    turn = jnp.arctan2(-axis[..., 0], axis[..., 1])

    caster = inclination = scrub = trail = None
    if instantaneous:
        if carrier is None or steer is None:
            raise InputError(
                "suspension: an instantaneous steering axis needs both carrier= (a body) and steer= (an input)"
            )
        screw = _driven_by(motion, eq, steer).screw_axis(carrier)
        base, kingpin = screw.point, screw.direction
    elif names.steering_axis is not None:
        base, kingpin = motion[names.steering_axis[0]], _line(motion, names.steering_axis)
    else:
        base = kingpin = None
    if base is not None and kingpin is not None:
        kingpin = jnp.where(kingpin[..., 2:] < 0, -1.0, 1.0) * kingpin
        caster = jnp.arctan2(-kingpin[..., 0], kingpin[..., 2])
        inclination = jnp.arctan2(-outward * kingpin[..., 1], kingpin[..., 2])
        drop = ratio((place - base)[..., 2], kingpin[..., 2])
        offset = base + drop[..., None] * kingpin - place
        heading = jnp.stack([axis[..., 1], -axis[..., 0]], axis=-1) / jnp.hypot(axis[..., 0], axis[..., 1])[..., None]
        trail = offset[..., 0] * heading[..., 0] + offset[..., 1] * heading[..., 1]
        scrub = -outward * (offset[..., 1] * heading[..., 0] - offset[..., 0] * heading[..., 1])

    length = motion_ratio = None
    if names.spring is not None:
        if isinstance(names.spring, str):
            length, shortening = motion[names.spring], -rising.velocity(names.spring)
        else:
            a, b = names.spring
            span, closing = motion[b] - motion[a], rising.velocity(b) - rising.velocity(a)
            length, rate = jax.jvp(_length, (span,), (closing,))
            shortening = -rate
        motion_ratio = ratio(shortening, lift[..., 2])
    moved = centre - centre_drawn
    return Suspension(
        camber=-outward * jnp.arctan2(axis[..., 2], jnp.hypot(axis[..., 0], axis[..., 1])),
        toe=-outward * turn,
        steer=turn,
        caster=caster,
        kingpin_inclination=inclination,
        scrub_radius=scrub,
        caster_trail=trail,
        wheel_travel=moved[..., 2],
        half_track_change=outward * (place - start)[..., 1],
        wheelbase_change=moved[..., 0] if axle == "front" else -moved[..., 0],
        spring_length=length,
        motion_ratio=motion_ratio,
        roll_centre_height=place[..., 1] * ratio(path[..., 1], path[..., 2]),
        contact=place,
        converged=motion.converged,
        length_unit=top.length_unit,
    )


# -- names ----------------------------------------------------------------------------------------------------------


def _parts(line: Line) -> Iterator[str]:
    yield from (line,) if isinstance(line, str) else line


def _has(motion: Motion, line: Line) -> bool:
    return all(name in motion.names for name in _parts(line))


def _resolved(motion: Motion, *given: Line | None) -> _Names:
    """The names given for the parts, or the usual ones where the mechanism has them."""
    usual = next((n for n in _USUAL if _has(motion, n.wheel_centre) and _has(motion, n.spin_axis)), None)
    found: list[Any] = []
    for role, name in zip(_Names._fields, given, strict=True):
        if name is None:
            name = getattr(usual, role, None)
            name = name if name is not None and _has(motion, name) else None
            if name is None and role in ("wheel_centre", "spin_axis"):
                kind = "a unit vector, or two points" if role == "spin_axis" else "a point or marker"
                raise InputError(
                    f"suspension: {motion.system.name!r} has none of the usual names for its "
                    f"{role.replace('_', ' ')}; say which it is with {role}=, {kind}"
                )
        else:
            for part in _parts(name):
                if part not in motion.names:
                    hint = nearest(part, motion.names)
                    raise InputError(f"suspension: {role}={name!r}: no point, vector or coordinate {part!r}; {hint}")
        found.append(name)
    return _Names(*found)


def _bump(motion: Motion, bump: str | None, wheel_centre: str) -> str:
    known = (*motion.driven, *motion.held)
    if bump is None:
        height = f"{wheel_centre}.z"
        if not known:
            raise InputError("suspension: nothing is driven in this motion, so the wheel does not rise")
        return height if height in known else known[0]
    if bump not in known:
        raise InputError(f"suspension: bump={bump!r} is not an input of this motion; {nearest(bump, known)}")
    return bump


def _on_side(centre: Array, side: str, name: str) -> None:
    if isinstance(centre, Tracer) or float(centre[1]) * (1.0 if side == "left" else -1.0) >= 0:
        return
    other = "right" if side == "left" else "left"
    raise InputError(
        f"suspension: side={side!r}, but {name!r} is drawn at y = {float(centre[1]):g}, on the {other}; ISO 8855 has y "
        f"to the left. Give side={other!r}"
    )


# -- kinematics -----------------------------------------------------------------------------------------------------


def _length(v: Array) -> Array:
    return jnp.sqrt(jnp.sum(v * v, axis=-1))


def _line(motion: Motion, line: Line, rate: bool = False) -> Array:
    """A direction, or its time derivative."""
    look = motion.velocity if rate else motion.__getitem__
    if isinstance(line, str):
        return look(line)
    return look(line[1]) - look(line[0])


def _posed(motion: Motion, q: Array) -> Motion:
    """A single pose as a motion."""
    return dataclasses.replace(motion, poses=q, rates=(), time=None)


def _driven_by(motion: Motion, eq: Equations, name: str) -> Motion:
    """The poses with the velocities that they have when one input moves at unit rate and the others stand still."""
    known = (*motion.driven, *motion.held)
    if name not in known:
        raise InputError(f"suspension: {name!r} is not an input of this motion; {nearest(name, known)}")
    view = plan(motion.system.topology, motion.driven, motion.held, motion.system.degrees_of_freedom)
    flat = motion.q.reshape(-1, motion.q.shape[-1])
    pace = jnp.array([float(name == other) for other in known])
    found = _tangents(view, eq, flat, pace, motion.converged.reshape(-1))
    return dataclasses.replace(motion, rates=(found.reshape(motion.q.shape),), time=None)


@functools.partial(jit, static_argnums=0)
def _tangents(view: Plan, eq: Equations, q: Array, pace: Array, ok: Array) -> Array:
    return jax.vmap(lambda x, good: rates(view, eq, x, (pace,), good)[0])(q, ok)
