"""Suspensions: camber, toe, steering axis, track, motion ratio, roll centre and the rest, read off a motion."""

import dataclasses
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.compiling import on_device
from jaxnc.constraints.elementary import ratio
from jaxnc.errors import InputError, nearest
from jaxnc.internals import outermost
from jaxnc.kinematics.design import Pose, PoseReading, read_poses
from jaxnc.kinematics.inputs import METRES, doubtful_size, one_number, outside
from jaxnc.kinematics.motion import Motion
from jaxnc.notebooks import Shown, align_columns
from jaxnc.records import record, static
from jaxnc.system.topology import Topology
from jaxnc.types import Array, ArrayLike, Float
from jaxnc.vehicle.hardpoints import RACK, USUAL, Line, Names, names_in, trade_names, usual

SIZES = (0.04, 8.0)
"""How wide a suspension may be, metres: of model cars to haul trucks."""
_ANGLES = ("camber", "toe", "steer", "caster", "kingpin_inclination", "brake_support_angle", "drive_support_angle")
_LENGTHS = (
    *("scrub_radius", "caster_trail", "wheel_travel", "half_track_change", "wheelbase_change", "roll_centre_height"),
    *("spring_length", "kingpin_offset", "caster_offset", "track", "swing_arm_length", "instant_centre_height"),
    *("side_swing_arm_length", "side_instant_centre_height"),
)
_PRINTED = (*_ANGLES[:5], *_LENGTHS[:7], "motion_ratio")
NUMBERS = (*_ANGLES, *_LENGTHS, "motion_ratio", "contact")
"""Names of the numbers of a `Suspension`, the contact centre last."""
ATTITUDE = dict.fromkeys(_ANGLES, "angle") | dict.fromkeys(_LENGTHS, "length")
"""Names of the angles and lengths of a `Suspension`, and which of both each is."""


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
        return {
            f.name: units[f.name]
            for f in dataclasses.fields(self)
            if f.name in units and getattr(self, f.name) is not None
        }

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
        header, columns = _table_columns(self)
        good = np.asarray(self.converged).reshape(-1)
        at = range(len(good))
        if rows is not None and len(good) > rows:
            at = np.unique(np.linspace(0, len(good) - 1, rows).round().astype(int)).tolist()
        lines = [[*header, ""]]
        lines += [[*(f"{c[i]:.4f}" if good[i] else "-" for c in columns), "" if good[i] else "not found"] for i in at]
        return "\n".join(align_columns(lines, (len(header),)))

    def to_csv(self, path: str | Path) -> Path:
        """Write all poses and all numbers as a table, units as in `table`; poses that failed have empty cells.

        Args:
            path: file name; missing folders are created.

        Raises:
            OutputError: the file cannot be written.
        """
        outside(self, "to_csv()")
        from jaxnc.io.target import csv_text, write

        header, columns = _table_columns(self, every=True)
        good = np.asarray(self.converged).reshape(-1)
        rows = ([f"{c[i]:.17g}" if good[i] else "" for c in columns] for i in range(len(good)))
        return write(path, csv_text([header, *rows]))

    def __repr__(self) -> str:
        shape = "×".join(map(str, self.camber.shape)) or "one"
        return f"Suspension({shape} pose{'s' * (shape != 'one')}: {', '.join(self.units)})"

    def __str__(self) -> str:
        if isinstance(self.camber, Tracer):
            return repr(self)
        failed = int(np.sum(~np.asarray(self.converged)))
        note = f"\n{failed} of {self.converged.size} poses were not found" if failed else ""
        return self.table(13) + note


class _TracedSuspension(Suspension):
    """A suspension in traced code: a number becomes a part of the program when it is asked for, others cost nothing."""

    def __init__(self, motion: Motion, layout: "Layout", radius: ArrayLike | None):
        vars(self).update(
            _of=(motion, layout, radius), converged=motion.converged, length_unit=motion.system.topology.length_unit
        )

    def __getattr__(self, name: str) -> Array:
        if name not in NUMBERS:
            raise AttributeError(f"a suspension has no number {name!r}")
        motion, layout, radius = vars(self)["_of"]
        if lack := layout.lacks(name):
            raise InputError(f"suspension: {motion.system.name!r} has no {name} that is known: {lack}")
        return wheel_numbers(motion, layout, (name,), radius)[name]

    def flatten(self) -> tuple[tuple, tuple]:
        """All numbers, and what is static: what a traced function returns is a `Suspension` like any other."""
        motion, layout, radius = vars(self)["_of"]
        found = wheel_numbers(motion, layout, NUMBERS, radius)
        names = [f.name for f in dataclasses.fields(Suspension) if f.name in NUMBERS]
        return (*(found[name] for name in names), self.converged), (self.length_unit,)


def _unflatten(rest: Any, parts: Any) -> Any:
    return Suspension(*parts, *rest)


jax.tree_util.register_pytree_node(_TracedSuspension, _TracedSuspension.flatten, _unflatten)


def _table_columns(record: Suspension, every: bool = False) -> tuple[list[str], list[np.ndarray]]:
    """List headers and columns of a table, wheel travel first."""
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
    side: str | None = None,
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
        side: ``"left"`` or ``"right"`` wheel. Default: where the wheel's centre is drawn.
        wheel_centre: point or marker. Default: ``wheel_centre``, or ``6`` in a MacPherson suspension of figure 42.
        spin_axis: direction of the wheel's axis, either way round: a unit vector or marker, or two points. Default:
            ``("wheel_centre", "spindle")``, ``spin_axis``, or ``v2``.
        steering_axis: two points of it (lower ball joint, upper ball joint or top mount). Default: ``("lower_ball",
            "upper_ball")``, or ``("2", "8")`` of figure 42. Without such points the instantaneous axis about which the
            carrier steers (multilink suspensions), the spring's length held where a spring is known, else the wheel's
            height.
        contact: a point or marker drawn where the wheel touches the road; its drawn distance from the wheel centre is
            the tyre's loaded radius. Default: ``contact``.
        radius: the loaded radius itself, a length, instead.
        spring: the spring or damper: a distance by name, or the two points of its ends. Default: ``damper``, or
            ``s`` of figure 42.
        bump: the input by which the wheel rises, driven or held. Default: the wheel centre's height, or else the
            spring's length, or else the first that does not steer and is no place along x or y.
        steer: for an instantaneous steering axis, that of the carrier: the input that steers. Default: the rack,
            ``tie_inner.y``, or ``10.y`` of figure 42.
        carrier: the wheel carrier, a body. Default: that on which `contact` rides, if it is a marker.
        axle: ``"front"`` or ``"rear"``: which way the wheelbase grows.

    Raises:
        InputError: a planar mechanism, a name that is not there, a wheel on the other side, or no tyre radius.

    Source: ISO 8855:2011, Road vehicles: vehicle dynamics and road-holding ability, vocabulary.
    """
    options = Options(side, wheel_centre, spin_axis, steering_axis, contact, radius, spring, bump, steer, carrier, axle)
    layout = resolve(motion, options)
    if not outermost():
        return _TracedSuspension(motion, layout, options.radius)
    found = on_device(wheel_numbers(motion, layout, NUMBERS, options.radius))
    return Suspension(**found, converged=motion.converged, length_unit=motion.system.topology.length_unit)


def _pose_reading(motion: Motion, **options: Any) -> PoseReading:
    """Say how NumPy reads a suspension with these options, for `jaxnc.sensitivity`."""
    given = Options(**options)
    return _wheel_reading(resolve(motion, given), NUMBERS, given.radius)._replace(labels=trade_names(motion.names))


vars(suspension)["pose_reading"] = _pose_reading


# -- what is asked ----------------------------------------------------------------------------------------------------


class Options(NamedTuple):
    """Options of `suspension`, as they are given."""

    side: str | None = None
    wheel_centre: str | None = None
    spin_axis: Line | None = None
    steering_axis: tuple[str, str] | None = None
    contact: str | None = None
    radius: float | Array | None = None
    spring: Line | None = None
    bump: str | None = None
    steer: str | None = None
    carrier: str | None = None
    axle: str = "front"


class Layout(NamedTuple):
    """A wheel and its suspension: all that decides how its numbers follow from its poses."""

    names: Names  # what its parts are called
    side: str | None  # "left" or "right"; None where the drawn place is traced, and each pose tells it
    bump: str  # the input by which the wheel rises
    screw: tuple[str, str] | None  # a carrier and the input that steers it, for an instantaneous steering axis
    axle: str  # "front" or "rear"
    carrier: str | None  # the body that carries the wheel; None if it is not known

    @property
    def inputs(self) -> tuple[str, ...]:
        """Inputs that are moved to see what follows."""
        return (self.bump,) if self.screw is None else (self.bump, self.screw[1])

    def lacks(self, name: str) -> str:
        """Say which part is not known that a number is told by; nothing if all are."""
        if name in _STEERED and self.screw is None and self.names.steering_axis is None:
            return "it needs steering_axis=, two points, or steer= (an input) and carrier="
        if name in _SIDE and self.carrier is None:
            return "it needs carrier=, a body"
        return "it needs spring=" if name in _SPRING and self.names.spring is None else ""


def resolve(motion: Motion, given: Options) -> Layout:
    """Find the parts of a suspension, by the names that are given or by the usual ones, and the inputs that move it."""
    said = "suspension(): radius, the tyre's loaded radius,"
    if not (given.radius is None or isinstance(given.radius, Tracer) or one_number(given.radius, said) > 0.0):
        raise InputError(f"{said} must be positive, got {given.radius}")
    if not isinstance(motion, Motion):
        raise InputError(f"suspension() takes a motion, of sweep() or motion(), got {type(motion).__name__}")
    top = motion.system.topology
    if top.dim != 3:
        raise InputError(f"suspension() is for motions of spatial mechanisms; {top.name!r} is planar")
    for name, value, allowed in (
        ("side", given.side or "left", ("left", "right")),
        ("axle", given.axle, ("front", "rear")),
    ):
        if value not in allowed:
            raise InputError(f"suspension: {name}={value!r}; use one of {', '.join(map(repr, allowed))}")
    if given.radius is not None and given.contact is not None:
        raise InputError("suspension: contact= and radius= both give the tyre's radius; leave one of them out")
    names = _part_names(motion, given)
    if given.radius is None and names.contact is None:
        raise InputError(
            "suspension: the tyre's radius is not known; give radius=, or contact=, a point or marker drawn "
            "where the wheel touches the road"
        )
    known, carrier = (*motion.driven, *motion.held), given.carrier
    if carrier is not None:
        motion._body(carrier)
    else:
        carrier = next((m.body for m in top.markers if m.name == names.contact), None)
    rack = RACK.get(names.wheel_centre, "tie_inner.y")
    steer = given.steer or (rack if rack in known and carrier is not None else None)
    screw = None
    if steer is not None and names.steering_axis is None:
        if carrier is None:
            raise InputError("suspension: an instantaneous steering axis needs carrier= (a body) besides steer=")
        if steer not in known:
            raise InputError(f"suspension: {steer!r} is not an input of this motion; {nearest(steer, known)}")
        screw = (carrier, steer)
    if doubt := doubtful_size(motion.system, "suspension", SIZES):
        warnings.warn(f"{top.name!r}: {doubt}", UserWarning, stacklevel=3)
    side, bump = _find_side(motion, given.side, names.wheel_centre), _bump_input(known, given.bump, names, steer)
    return Layout(names, side, bump, screw, given.axle, carrier)


_KINDS = {
    **dict.fromkeys(("wheel_centre", "contact"), "a point or marker"),
    "spin_axis": "a unit vector, or two points",
    "steering_axis": "two points of the axis",
    "spring": "a distance, or the two points of its ends",
}


def _part_names(motion: Motion, given: Options) -> Names:
    """Take the names given for the parts, or the usual ones where the mechanism has them."""
    top, known, centre = motion.system.topology, usual(motion.names), given.wheel_centre
    # Each name is looked up by itself; but the figure's numbers are those of its parts only where its wheel is.
    layouts = [n for n in (known, *USUAL) if n and (n is known or n.wheel_centre in (USUAL[0].wheel_centre, centre))]
    places, ways = ({m.name for m in top.markers if m.direction == way} for way in (False, True))
    places |= {*top.points}
    lengths = {name for name, angle in zip(top.scalars, top.angles, strict=True) if not angle}
    single = {"wheel_centre": places, "contact": places, "spin_axis": ways | {*top.vectors}, "spring": lengths}

    def fits(role: str, name: Any) -> bool:
        if isinstance(name, str):
            return name in single.get(role, ())
        return single.get(role) is not places and len(name) == len({*name}) == 2 and places.issuperset(name)

    found: list[Any] = []
    for role in Names._fields:
        name = getattr(given, role)
        if name is None:
            names = (getattr(layout, role) for layout in layouts)
            name = next((n for n in names if fits(role, n)), None)
            if name is None and role in ("wheel_centre", "spin_axis"):
                raise InputError(
                    f"suspension: {motion.system.name!r} has none of the usual names for its "
                    f"{role.replace('_', ' ')}; say which it is with {role}=, {_KINDS[role]}"
                )
        else:
            for part in names_in(name):
                if part not in motion.names:
                    hint = nearest(part, motion.names)
                    raise InputError(f"suspension: {role}={name!r}: no point, vector or coordinate {part!r}; {hint}")
            if not fits(role, name):
                raise InputError(f"suspension: {role}={name!r} must name {_KINDS[role]}")
        found.append(name if name is None or isinstance(name, str) else tuple(name))
    return Names(*found)


def _bump_input(known: Sequence[str], bump: str | None, names: Names, steer: str | None) -> str:
    if bump is None:
        if not known:
            raise InputError("suspension: nothing is driven in this motion, so the wheel does not rise")
        # Steered with the spring or the height held, the wheel rises by what is held.
        others = (name for name in known if name != steer and not name.endswith((".x", ".y")))
        return next(name for name in (f"{names.wheel_centre}.z", str(names.spring), *others, *known) if name in known)
    if bump not in known:
        raise InputError(f"suspension: bump={bump!r} is not an input of this motion; {nearest(bump, known)}")
    return bump


def _find_side(motion: Motion, side: str | None, name: str) -> str | None:
    """Find on which side the wheel is drawn, and refuse another one; None where that is traced and none is given."""
    system = motion.system
    if any(isinstance(x, Tracer) for x in jax.tree.leaves(system)):
        return side
    y = float(dataclasses.replace(system, parameters=system.parameters.in_numpy())[name][1])  # compiles nothing
    if side is None or y * (1.0 if side == "left" else -1.0) >= 0:
        return side or ("right" if y < 0 else "left")
    other = "right" if side == "left" else "left"
    raise InputError(
        f"suspension: side={side!r}, but {name!r} is drawn at y = {y:g}, on the {other}; ISO 8855 has y "
        f"to the left. Give side={other!r}"
    )


# -- a wheel in one pose ----------------------------------------------------------------------------------------------


_STEERED = ("caster", "kingpin_inclination", "scrub_radius", "caster_trail", "kingpin_offset", "caster_offset")
_SPRING = ("spring_length", "motion_ratio")
_FRONT = ("roll_centre_height", "swing_arm_length", "instant_centre_height")
_SIDE = ("brake_support_angle", "side_swing_arm_length", "side_instant_centre_height")


def wheel_numbers(
    motion: Motion, layout: Layout, names: tuple[str, ...], radius: ArrayLike | None, by: str | None = None
) -> dict[str, Any]:
    """Read numbers of a wheel ``(...,)``, places ``(..., 3)``, in all poses; None of what cannot be told.

    The names are those of a `Suspension`. With an input in `by` the numbers' derivatives by it are told instead, the
    other inputs held.
    """
    return dict.fromkeys(names) | read_poses(motion, _wheel_reading(layout, names, radius), by)


def _wheel_reading(layout: Layout, names: tuple[str, ...], radius: Any) -> PoseReading:
    told = tuple(name for name in names if not layout.lacks(name))
    own = np.nan if radius is None else radius if isinstance(radius, Tracer) else float(radius)
    return PoseReading(
        _read_wheel,
        (layout, told, radius is None),
        layout.inputs,
        (own,),
        tuple((name, 3 if name == "contact" else 0) for name in told),
    )


def _read_wheel(
    top: Topology,
    layout: Layout,
    names: tuple[str, ...],
    drawn_radius: bool,
    state: Array,
    home: Array,
    markers: Array,
    radius: Array,
) -> Float[Array, " numbers"]:
    """Numbers of a wheel in one pose, a pure function; see `jaxnc.kinematics.design.PoseReading`.

    The tyre's `radius` counts if it is not read off the drawing.
    """
    q, *rates = jnp.split(state, 1 + len(layout.inputs))
    moved = {name: Pose(top, markers, q, (rate,)) for name, rate in zip(layout.inputs, rates, strict=True)}
    wheel = _Wheel.of(layout, Pose(top, markers, q), Pose(top, markers, home), moved, None if drawn_radius else radius)
    numbers = {"contact": wheel.contact, **_lean(wheel), **_displacements(wheel)}
    for some, tell in ((_STEERED, _steering), (_SPRING, _spring), (_FRONT, _front_view), (_SIDE, _side_view)):
        if any(name in names for name in some):
            numbers |= tell(wheel)
    if "drive_support_angle" in names:
        numbers["drive_support_angle"] = wheel.forward * jnp.arctan2(wheel.lift[0], wheel.lift[2])
    return jnp.concatenate([jnp.atleast_1d(numbers[name]) for name in names])


class _Wheel(NamedTuple):
    """A wheel in one pose."""

    layout: Layout
    pose: Pose
    drawn: Pose  # the mechanism as drawn
    moved: dict[str, Pose]  # the pose, as one input moves at unit rate and the others stand
    radius: Array  # of the tyre
    centre: Array
    line: Array  # along the spin axis
    axis: Array  # unit vector along the spin axis, to the left on either side

    @staticmethod
    def of(layout: Layout, pose: Pose, drawn: Pose, moved: dict[str, Pose], radius: Array | None) -> "_Wheel":
        """Find the wheel in a pose; its tyre's radius is read off the drawing if it is not given."""
        names, line = layout.names, _direction(pose, layout.names.spin_axis)
        if radius is None:
            assert names.contact is not None
            radius = _vector_length(drawn[names.contact] - drawn[names.wheel_centre])
        axis = jnp.where(line[1] < 0, -1.0, 1.0) * line / _vector_length(line)
        return _Wheel(layout, pose, drawn, moved, jnp.asarray(radius, float), pose[names.wheel_centre], line, axis)

    @property
    def outward(self) -> Any:
        """Along y, away from the vehicle's centre plane."""
        if self.layout.side is None:
            return jnp.where(self.centre[1] < 0, -1.0, 1.0)
        return 1.0 if self.layout.side == "left" else -1.0

    @property
    def forward(self) -> float:
        """Along x, away from the other axle."""
        return 1.0 if self.layout.axle == "front" else -1.0

    @property
    def rising(self) -> Pose:
        """The pose as the wheel rises, which may be as its input falls."""
        pose = self.moved[self.layout.bump]
        falls = pose.velocity(self.layout.names.wheel_centre)[2] < 0
        return pose._replace(rates=(jnp.where(falls, -1.0, 1.0) * pose.rates[0],))

    def touch(self, centre: Array, line: Array) -> Array:
        """The contact centre, a function of the wheel's centre and spin axis."""
        axis = line / _vector_length(line)
        up = jnp.array([0.0, 0.0, 1.0]) - axis[2:] * axis
        return centre - self.radius * up / _vector_length(up)

    @property
    def contact(self) -> Array:
        """The contact centre."""
        return self.touch(self.centre, self.line)

    @property
    def steer(self) -> Array:
        """The steer angle, about the z axis."""
        return jnp.arctan2(-self.axis[0], self.axis[1])

    @property
    def lift(self) -> Array:
        """Velocity of the wheel centre as the wheel rises."""
        return self.rising.velocity(self.layout.names.wheel_centre)


def _lean(wheel: _Wheel) -> dict[str, Array]:
    """Angles of the wheel's plane."""
    axis = wheel.axis
    camber = -wheel.outward * jnp.arctan2(axis[2], jnp.hypot(axis[0], axis[1]))
    return {"camber": camber, "toe": -wheel.outward * wheel.steer, "steer": wheel.steer}


def _displacements(wheel: _Wheel) -> dict[str, Array]:
    """Places of the wheel's centre and of the contact centre, most of them from the drawn ones."""
    centre, names = wheel.drawn[wheel.layout.names.wheel_centre], wheel.layout.names
    start = wheel.touch(centre, _direction(wheel.drawn, names.spin_axis))
    return {
        "wheel_travel": (wheel.centre - centre)[2],
        "wheelbase_change": wheel.forward * (wheel.centre - centre)[0],
        "half_track_change": wheel.outward * (wheel.contact - start)[1],
        "track": 2.0 * wheel.outward * wheel.contact[1],
    }


def _steering(wheel: _Wheel) -> dict[str, Array]:
    """The steering axis, and where it is level with the road and with the wheel's centre."""
    layout, outward, axis = wheel.layout, wheel.outward, wheel.axis
    if layout.screw is not None:
        carrier, steer = layout.screw
        screw = _steered_alone(wheel, steer).screw_axis(carrier)
        base, way = screw.point, screw.direction
    else:
        assert layout.names.steering_axis is not None
        base, way = wheel.pose[layout.names.steering_axis[0]], _direction(wheel.pose, layout.names.steering_axis)
    way = jnp.where(way[2:] < 0, -1.0, 1.0) * way
    trace = jnp.stack([axis[1], -axis[0]]) / jnp.hypot(axis[0], axis[1])

    def offset(place: Array) -> tuple[Array, Array]:
        """From a place to where the axis is level with it, along the wheel's trace and across."""
        off = base + ratio((place - base)[2], way[2]) * way - place
        return off[0] * trace[0] + off[1] * trace[1], off[1] * trace[0] - off[0] * trace[1]

    at_road, at_centre = offset(wheel.contact), offset(wheel.centre)
    return {
        "caster": jnp.arctan2(-way[0], way[2]),
        "kingpin_inclination": jnp.arctan2(-outward * way[1], way[2]),
        "caster_trail": at_road[0],
        "scrub_radius": -outward * at_road[1],
        "caster_offset": at_centre[0],
        "kingpin_offset": -outward * at_centre[1],
    }


def _steered_alone(wheel: _Wheel, steer: str) -> Pose:
    """The pose as it is steered; where a spring is known, the wheel rises so that the spring keeps its length."""
    turning, rising, spring = wheel.moved[steer], wheel.rising, wheel.layout.names.spring
    if spring is None or steer == wheel.layout.bump:
        return turning
    by_turn, by_rise = (_spring_length(wheel.pose, spring, moved)[1] for moved in (turning, rising))
    rate = turning.rates[0] - ratio(by_turn, by_rise) * rising.rates[0]
    return turning._replace(rates=(rate,))


def _spring_length(pose: Pose, spring: Line, moved: Pose) -> tuple[Array, Array]:
    """Length of the spring in a pose, and its rate as the pose moves."""
    if isinstance(spring, str):
        return pose[spring], moved.velocity(spring)
    line = _direction(pose, spring)
    return jax.jvp(_vector_length, (line,), (_direction(moved, spring, rate=True),))


def _spring(wheel: _Wheel) -> dict[str, Array]:
    """The spring, and how it is shortened as the wheel rises."""
    spring = wheel.layout.names.spring
    assert spring is not None
    length, rate = _spring_length(wheel.pose, spring, wheel.rising)
    return {"spring_length": length, "motion_ratio": ratio(-rate, wheel.lift[2])}


def _front_view(wheel: _Wheel) -> dict[str, Array]:
    """The roll centre, and the centre about which the wheel's disc turns about x as the wheel rises."""
    line, turning = wheel.line, _direction(wheel.rising, wheel.layout.names.spin_axis, rate=True)
    path = jax.jvp(wheel.touch, (wheel.centre, line), (wheel.lift, turning))[1]  # of the contact centre
    tilt = jax.jvp(lambda d: jnp.arctan2(d[2], jnp.hypot(d[0], d[1])), (line,), (turning,))[1]
    rolling = jnp.where(line[1] < 0, -1.0, 1.0) * tilt * jnp.cos(wheel.steer)
    return {
        "roll_centre_height": wheel.contact[1] * ratio(path[1], path[2]),
        "swing_arm_length": wheel.outward * _centre_distance(path[2], rolling),
        "instant_centre_height": _centre_distance(path[1], rolling),
    }


def _side_view(wheel: _Wheel) -> dict[str, Array]:
    """The path of the contact centre with the wheel locked to its carrier, and the centre of the carrier's turning."""
    assert wheel.layout.carrier is not None
    spin = wheel.rising.angular_velocity(wheel.layout.carrier)
    locked = wheel.lift + jnp.cross(spin, wheel.contact - wheel.centre)
    return {
        "brake_support_angle": wheel.forward * jnp.arctan2(locked[0], locked[2]),
        "side_swing_arm_length": -wheel.forward * _centre_distance(locked[2], spin[1]),
        "side_instant_centre_height": -_centre_distance(locked[0], spin[1]),
    }


def _vector_length(v: Array) -> Array:
    return jnp.sqrt(jnp.sum(v * v, axis=-1))


def _centre_distance(velocity: Array, rate: Array) -> Array:
    """How far off a centre of rotation is; infinitely where nothing turns."""
    return jnp.where(rate == 0, jnp.inf, ratio(velocity, rate))


def _direction(pose: Pose, line: Line, rate: bool = False) -> Array:
    """A direction, or its time derivative."""
    read = pose.velocity if rate else pose.__getitem__
    if isinstance(line, str):
        return read(line)
    return read(line[1]) - read(line[0])
