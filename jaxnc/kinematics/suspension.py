"""What suspension designers read off a motion: camber, toe, steering axis, track, motion ratio, roll centre."""

import dataclasses
import inspect
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.compiling import on_device
from jaxnc.internals import outermost
from jaxnc.kinematics.hardpoints import Line, Names
from jaxnc.kinematics.inputs import one_number, outside
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.sizes import METRES
from jaxnc.kinematics.wheel import wheel_numbers
from jaxnc.kinematics.wheel_parts import What, asked
from jaxnc.notebooks import Shown
from jaxnc.records import record, static
from jaxnc.types import Array

if TYPE_CHECKING:
    from pathlib import Path

_ROWS = 13  # of a printed table
_BASIC_ANGLES = ("camber", "toe", "steer", "caster", "kingpin_inclination")
_BASIC_LENGTHS = (
    "scrub_radius",
    "caster_trail",
    "wheel_travel",
    "half_track_change",
    "wheelbase_change",
    "roll_centre_height",
    "spring_length",
)
_ANGLES = (*_BASIC_ANGLES, "brake_support_angle", "drive_support_angle")
_LENGTHS = (
    *_BASIC_LENGTHS,
    "kingpin_offset",
    "caster_offset",
    "track",
    "swing_arm_length",
    "instant_centre_height",
    "side_swing_arm_length",
    "side_instant_centre_height",
)
_PRINTED = (*_BASIC_ANGLES, *_BASIC_LENGTHS, "motion_ratio")
NUMBERS = (*_ANGLES, *_LENGTHS, "motion_ratio", "contact")
"""Names of all that it tells, the contact centre last."""
ATTITUDE = {**{str(name): "angle" for name in _ANGLES}, **{str(name): "length" for name in _LENGTHS}}
"""Names of what a `Suspension` tells, and whether it is an angle or a length."""


@public
@record
class Suspension(Shown):
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
        kingpin_offset: how far inboard of the wheel centre, at its height, the steering axis is, across the trace.
        caster_offset: how far ahead of the wheel centre, at its height, the steering axis is, along the trace.
        track: distance between the contact centres of this wheel and its mirror image.
        swing_arm_length: of the front view: how far inboard of the contact centre the instant centre is, about which
            the wheel's disc turns as it rises.
        instant_centre_height: height of that centre over the road.
        brake_support_angle: from the vertical to the path of the contact centre in the side view, the wheel locked to
            its carrier (a brake in the wheel): positive where braking lifts a front and lowers a rear (anti-dive,
            anti-lift).
        drive_support_angle: the same of the wheel centre (the differential on the body): positive where driving lowers
            a front and lifts a rear (anti-lift, anti-squat).
        side_swing_arm_length: of the side view: how far from the contact centre, towards the other axle, the instant
            centre of the carrier is.
        side_instant_centre_height: height of that centre over the road.
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
    kingpin_offset: Array | None
    caster_offset: Array | None
    track: Array
    swing_arm_length: Array
    instant_centre_height: Array
    brake_support_angle: Array | None
    drive_support_angle: Array
    side_swing_arm_length: Array | None
    side_instant_centre_height: Array | None
    converged: Array
    length_unit: str = static(default="m")

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
        """The usual numbers as text: degrees, and millimetres where the model's unit is a usual one.

        Args:
            rows: about how many poses to show, evenly chosen; all if not given.

        Returns:
            A table, one line a pose; poses that failed are marked.
        """
        outside(self, "table()")
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
        """Write all poses and all numbers as a table, units as in `table`; poses that failed have empty cells.

        Args:
            path: file name; missing folders are created.

        Raises:
            OutputError: the file cannot be written.
        """
        outside(self, "to_csv()")
        from jaxnc.io.target import write

        header, columns = _shown(self, every=True)
        good = np.asarray(self.converged).reshape(-1)
        lines = [",".join(header)]
        lines += [",".join(f"{c[i]:.17g}" if good[i] else "" for c in columns) for i in range(len(good))]
        return write(path, ("\n".join(lines) + "\n").encode())

    def __repr__(self) -> str:
        shape = "×".join(map(str, self.camber.shape)) or "one"
        return f"Suspension({shape} pose{'s' * (shape != 'one')}: {', '.join(self.units)})"

    def __str__(self) -> str:
        if isinstance(self.camber, Tracer):
            return repr(self)
        failed = int(np.sum(~np.asarray(self.converged)))
        note = f"\n{failed} of {self.converged.size} poses were not found" if failed else ""
        return self.table(_ROWS) + note


class _Traced(Suspension):
    """The same in traced code: a number becomes a part of the program when it is asked for, others cost nothing.

    It is not kept: it belongs to the trace that asked.
    """

    _of: tuple[Motion, What, Any]

    def __getattr__(self, name: str) -> Any:
        if name not in NUMBERS:
            raise AttributeError(f"a suspension has no number {name!r}")
        motion, what, radius = self._of
        return wheel_numbers(motion, what, (name,), radius)[name]

    def whole(self) -> tuple[tuple, tuple]:
        """All that a `Suspension` has: numbers, and what is static."""
        motion, what, radius = self._of
        found = wheel_numbers(motion, what, NUMBERS, radius)
        return (*(found[f.name] for f in _FIELDS), self.converged), (self.length_unit,)


_FIELDS = tuple(f for f in dataclasses.fields(Suspension) if f.name in NUMBERS)


def _returned(rest: Any, parts: Any) -> Any:
    """Outside of the trace it is a `Suspension` like any other."""
    return Suspension(*parts, *rest)


jax.tree_util.register_pytree_node(_Traced, _Traced.whole, _returned)


def _known(record: Suspension, name: str) -> bool:
    return getattr(record, name) is not None


def _shown(record: Suspension, every: bool = False) -> tuple[list[str], list[np.ndarray]]:
    """Headers and columns of the table, wheel travel first."""
    unit = record.length_unit
    factor, label = (METRES[unit] * 1e3, "mm") if unit in METRES else (1.0, unit)
    units = record.units
    names = ["wheel_travel", *(n for n in units if every or n in _PRINTED)]
    names = [n for k, n in enumerate(names) if n != "contact" and (not k or n != "wheel_travel")]
    header, columns = [], []
    for name in names:
        values = np.asarray(getattr(record, name)).reshape(-1)
        scale, shown = {"rad": (180.0 / np.pi, "deg"), "": (1.0, "")}.get(units[name], (factor, label))
        header.append(name.replace("_", " ") + (f" [{shown}]" if shown else ""))
        columns.append(values * scale)
    return header, columns


@public
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
            "upper_ball")``, or ``("2", "8")``; None if there are no such points. With `steer` given instead, the
            instantaneous axis about which the carrier steers (multilink suspensions).
        contact: a point or marker drawn where the wheel touches the road; its drawn distance from the wheel centre is
            the tyre's loaded radius. Default: ``contact``.
        radius: the loaded radius itself, a length, instead.
        spring: the spring or damper: a distance by name, or the two points of its ends. Default: ``damper`` or ``s``.
        bump: the input by which the wheel rises. Default: the wheel centre's height if that is driven, or else the
            first input.
        steer: for an instantaneous steering axis, that of the carrier: the input that steers.
        carrier: the wheel carrier, a body. Default: that on which `contact` rides, if it is a marker.
        axle: ``"front"`` or ``"rear"``: which way the wheelbase grows.

    Raises:
        InputError: a planar mechanism, a name that is not there, a wheel on the other side, or no tyre radius.

    Source: ISO 8855:2011, Road vehicles: vehicle dynamics and road-holding ability, vocabulary.
    """
    if radius is not None and not isinstance(radius, Tracer):
        radius = one_number(radius, "suspension(): radius, the tyre's loaded radius,")
    given = Names(wheel_centre, spin_axis, steering_axis, contact, spring)
    what = asked(motion, given, side, radius, bump, (carrier, steer), axle)
    rest = {"converged": motion.converged, "length_unit": motion.system.topology.length_unit}
    if outermost():
        return Suspension(**on_device(wheel_numbers(motion, what, NUMBERS, radius)), **rest)
    traced = object.__new__(_Traced)
    for name, value in (*rest.items(), ("_of", (motion, what, radius))):
        object.__setattr__(traced, name, value)
    return traced


def asked_by(motion: Motion, options: Mapping[str, Any]) -> tuple[What, Any]:
    """What a `suspension` with these options is asked, and the tyre's radius if it is given."""
    bound = inspect.signature(suspension).bind(motion, **options)
    bound.apply_defaults()
    o = bound.arguments
    given = Names(*(o[name] for name in Names._fields))
    return asked(motion, given, o["side"], o["radius"], o["bump"], (o["carrier"], o["steer"]), o["axle"]), o["radius"]


def attitude(motion: Motion, name: str) -> Array | None:
    """One number of a `Suspension` ``(...,)`` and nothing computed that it does not need; None if it cannot be told."""
    found = wheel_numbers(motion, asked(motion), (name,), None)
    return (on_device(found) if outermost() else found)[name]
