"""Reports on suspensions: static values, their gradients, and their range over wheel travel or steering."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from jaxnc.calls import public
from jaxnc.doors import door
from jaxnc.errors import InputError, counted, nearest
from jaxnc.kinematics.inputs import METRES, one_number, outside
from jaxnc.kinematics.motion import Motion, drawn_motion
from jaxnc.notebooks import align_columns
from jaxnc.vehicle.hardpoints import RACK, trade_names
from jaxnc.vehicle.suspension import ATTITUDE, NUMBERS, Layout, Options, resolve, suspension, wheel_numbers

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

LABELS = {
    "toe": "toe-in",
    "steer": "steer angle",
    "camber": "camber",
    "caster": "caster",
    "kingpin_inclination": "kingpin inclination",
    "scrub_radius": "scrub radius",
    "caster_trail": "mechanical trail",
    "kingpin_offset": "kingpin offset at centre",
    "caster_offset": "caster offset at centre",
    "track": "track",
    "half_track_change": "half-track change",
    "wheelbase_change": "wheelbase change",
    "roll_centre_height": "roll centre height",
    "swing_arm_length": "front-view swing arm",
    "instant_centre_height": "front-view centre height",
    "brake_support_angle": "brake support angle",
    "drive_support_angle": "drive support angle",
    "side_swing_arm_length": "side-view swing arm",
    "side_instant_centre_height": "side-view centre height",
    "spring_length": "spring length",
    "motion_ratio": "motion ratio",
    "toe_out_in_turns": "toe-out in turns",
    "ackermann": "Ackermann",
}
"""What the trade calls the numbers of a suspension."""
_SUPPORT = {"front": ("anti-dive angle", "anti-lift angle"), "rear": ("anti-lift angle", "anti-squat angle")}
_NOT_OVER_TRAVEL = ("steer",)
_NOT_OVER_STEERING = (
    *("toe", "motion_ratio", "spring_length", "brake_support_angle", "drive_support_angle", "roll_centre_height"),
    *("swing_arm_length", "instant_centre_height", "side_swing_arm_length", "side_instant_centre_height"),
)
_DIGITS = {"deg": 3, "mm": 2, "": 4, "%": 1}
_NOTHING = 1e-9  # of millimetres and degrees: rounding, shown as zero
SIGNS = (
    "signs of ISO 8855: toe + front inward, camber + top outward, caster + top to the rear, kingpin + top inward,",
    "steer + to the left; lengths + outward, forward or up as docs/spatial.md says",
)
"""What the signs of the usual angles mean."""


@public
@dataclass(frozen=True)
class SuspensionRow:
    """A number of a suspension.

    Attributes:
        name, label, unit: its name in a `Suspension`, what the trade calls it, and its unit.
        static: its value as drawn.
        gradient, gradient_unit: its exact derivative there, by wheel travel or the steering input, and the unit.
        smallest, smallest_at, largest, largest_at: its range over the motion, and where.
    """

    name: str
    label: str
    unit: str
    static: float
    gradient: float
    gradient_unit: str
    smallest: float
    smallest_at: float
    largest: float
    largest_at: float


@public
@dataclass(frozen=True)
class SuspensionReport:
    """A suspension over wheel travel or steering; ``print()`` shows it, in degrees and millimetres.

    Attributes:
        name, side, axle: the mechanism, and which wheel it is.
        over: what the numbers are told over: ``"wheel travel"``, or the steering input with what the trade calls it.
        unit: of that.
        along: its values, from the drawn place, ``(T,)``.
        curves: every number over it, ``(T,)``; NaN where a pose was not found.
        rows: static value, gradient and range of each.
        hardpoints: what the trade calls points, and where they are drawn, by name.
        vehicle: what follows from the wheelbase and the height of the centre of mass.
    """

    name: str
    side: str
    axle: str
    over: str
    unit: str
    along: np.ndarray
    curves: Mapping[str, np.ndarray]
    rows: tuple[SuspensionRow, ...]
    hardpoints: Mapping[str, tuple[str, tuple[float, ...]]]
    vehicle: Mapping[str, float]

    def __getitem__(self, name: str) -> SuspensionRow:
        """The row of a number by its name."""
        rows = {row.name: row for row in self.rows}
        if name not in rows:
            raise InputError(f"suspension_report: over {self.over} it has no {name!r}; {nearest(name, rows)}")
        return rows[name]

    @property
    def travels(self) -> bool:
        """Say whether the numbers are told over wheel travel."""
        return self.over == "wheel travel"

    @property
    def title(self) -> str:
        """The mechanism and the wheel."""
        return f"{self.name}, {self.axle} {self.side} wheel"

    def __str__(self) -> str:
        return self.text()

    __repr__ = __str__

    def text(self, all_of_it: bool = True) -> str:
        """The report as lines; without the hardpoints and what the signs mean, if not all of it."""
        low, high = float(np.nanmin(self.along)), float(np.nanmax(self.along))
        ends = (" (rebound)", " (bump)") if self.travels else ("", "")
        first = f"{self.title}: {counted(len(self.along), 'pose')} over {self.over}, "
        first += f"{low:.4g}{ends[0]} to {high:.4g}{ends[1]}"
        head = ["", "static", "gradient", "", "smallest", f"at [{self.unit}]", "largest", f"at [{self.unit}]"]
        table = [head, *(_row_cells(row) for row in self.rows)]
        lines = [f"{first} {self.unit}", *align_columns(table, (0, 3), "  ")]
        if failed := int(np.isnan(next(iter(self.curves.values()))).sum()):
            lines.append(f"  {failed} of {len(self.along)} poses were not found")
        lines += [f"  {name} {value:.4g} %" for name, value in self.vehicle.items()]
        if not all_of_it:
            return "\n".join(lines)
        if self.hardpoints:
            points = [[n, trade, *(f"{v + 0.0:.2f}" for v in at)] for n, (trade, at) in self.hardpoints.items()]
            lines += align_columns([["", f"hardpoints as drawn [{self.length}]", "x", "y", "z"], *points], (0, 1), "  ")
        return "\n".join([*lines, *(f"  {line}" for line in SIGNS)])

    @property
    def length(self) -> str:
        """The unit of lengths."""
        return next(row.unit for row in self.rows if ATTITUDE.get(row.name) == "length")

    def data(self) -> dict[str, str]:
        """All of it as dictionaries, lists and numbers; None where a number is not finite."""
        arrays = {"along": self.along.tolist(), "curves": {k: v.tolist() for k, v in self.curves.items()}}
        return msgspec.json.decode(msgspec.json.encode(asdict(self) | arrays))  # what is not finite as null

    def to_json(self, path: "str | Path") -> "Path":
        """Write `data` to a file.

        Args:
            path: file name; missing folders are created.

        Raises:
            OutputError: the file cannot be written.
        """
        from jaxnc.io.target import write

        return write(path, (json.dumps(self.data(), ensure_ascii=False, indent=1) + "\n").encode())

    def plot(self, path: "str | Path | None" = None, names: Sequence[str] = (), **options: object) -> "Figure":
        """Draw each number over wheel travel or steering in axes of its own, the static value marked.

        Args:
            path: file to write as well: PNG, SVG, PDF or JPG.
            names: which numbers; the usual ones if not given.
            **options: ``size=``: width of the figure, inches, with the height that it needs; or width and height.

        Raises:
            InputError: an unknown number.
            OutputError: the file cannot be written.
        """
        return door("SuspensionReport.plot")(self, path, names, **options)


@public
def suspension_report(
    motion: Motion,
    wheelbase: float | None = None,
    mass_height: float | None = None,
    brake_share: float | None = None,
    drive_share: float | None = None,
    **options: Any,
) -> SuspensionReport:
    """Static values, gradients and extremes of a suspension over a sweep of wheel travel or of steering.

    Static values and gradients are those of the drawing, exact; the extremes are those of the poses.

    Args:
        motion: a sweep, in which the wheel rises or an input steers.
        wheelbase: a length: gives the Ackermann percentage over steering.
        mass_height: height of the vehicle's centre of mass over the road; with `wheelbase` and the shares it gives the
            percentages of anti-dive, anti-lift and anti-squat.
        brake_share: the part of the braking force that this axle takes.
        drive_share: the part of the driving force that this axle takes.
        **options: as `jaxnc.suspension` takes them.

    Raises:
        InputError: as `jaxnc.suspension`, or a motion that is no sweep.

    Source: ISO 8855:2011; W. F. Milliken and D. L. Milliken, Race Car Vehicle Dynamics, chapters 17 and 19.
    """
    outside(motion, "suspension_report()")
    lengths, shares = {"wheelbase": wheelbase, "mass_height": mass_height}, (brake_share, drive_share)
    for name, value in (lengths | dict(zip(("brake_share", "drive_share"), shares, strict=True))).items():
        if value is None:
            continue
        size = one_number(value, f"suspension_report: {name}")
        if not (size > 0.0 if name in lengths else 0.0 <= size <= 1.0):
            bound = "positive" if name in lengths else "a part of the force, from 0 to 1"
            raise InputError(f"suspension_report: {name}={value} must be {bound}")
    if motion.status.ndim != 1 or len(motion.status) < 2:
        raise InputError("suspension_report: give a sweep, poses in a row over wheel travel or steering")
    found = suspension(motion, **options)
    given = Options(**options)
    layout, still = resolve(motion, given), drawn_motion(motion.system, motion.driven, motion.held)
    by, along, travels = _report_axis(motion, layout, still)
    static, slopes = (
        {name: float(v) for name, v in found.items() if v is not None and name != "contact"}
        for found in (wheel_numbers(still, layout, NUMBERS, given.radius, by=to) for to in (None, by))
    )
    per = slopes["wheel_travel"] if travels else 1.0
    known = found.length_unit in METRES
    mm, unit = (METRES[found.length_unit] * 1e3, "mm") if known else (1.0, found.length_unit)
    # An input that is an angle is told in degrees, and angles over wheel travel per metre of it.
    turns = not travels and motion.system.topology.is_angle(by)
    step, told = (math.degrees(1.0), "deg") if turns else (mm, unit)
    far, metre = ("m", 1e3) if travels and known else (told, 1.0)
    along, good = along * step, np.asarray(motion.converged)
    curves: dict[str, np.ndarray] = {}
    rows: list[SuspensionRow] = []
    for name in LABELS:
        if name not in static or name in (_NOT_OVER_TRAVEL if travels else _NOT_OVER_STEERING):
            continue
        kind = ATTITUDE.get(name, "")
        factor, shown = {"angle": (180.0 / math.pi, "deg"), "length": (mm, unit)}.get(kind, (1.0, ""))
        values = np.where(good, np.asarray(getattr(found, name), float) * factor, np.nan)
        curves[name] = np.where(np.abs(values) < _NOTHING, 0.0, values)
        slope = slopes[name] / per * factor / step
        slope, below = (slope, told) if kind == "length" else (slope * metre, far)
        label = _number_label(name, layout.axle)
        drawn = static[name] * factor
        rows.append(_report_row(name, label, shown, drawn, slope, f"{shown or 1}/{below}", curves[name], along))
    if not travels:
        turned = (curves["steer"] - math.degrees(static["steer"])) * (1.0 if layout.side == "left" else -1.0)
        differences = _turn_differences(turned, along, static["track"] * mm, wheelbase, mm)
        curves |= differences
        for name, values in differences.items():
            shown = "%" if name == "ackermann" else "deg"
            rows.append(_report_row(name, LABELS[name], shown, math.nan, math.nan, "", values, along))
    called = f"rack travel, {by}" if by in RACK.values() else by
    return SuspensionReport(
        name=motion.system.name,
        side=str(layout.side),
        axle=layout.axle,
        over="wheel travel" if travels else called,
        unit=told,
        along=along,
        curves=curves,
        rows=tuple(rows),
        hardpoints=_drawn_hardpoints(still, mm),
        vehicle=_anti_percentages(static, layout.axle, wheelbase, mass_height, shares),
    )


def _report_axis(motion: Motion, layout: Layout, still: Motion) -> tuple[str, np.ndarray, bool]:
    """The input that moves, how far it is (or the wheel centre) from where it is drawn, and whether the wheel rises."""
    moving = [name for name in motion.driven if float(np.ptp(np.asarray(motion.inputs[name]))) > 0]
    if not moving:
        raise InputError("suspension_report: no input of this motion moves; sweep the wheel's height or the steering")
    travels = layout.bump in moving and layout.bump not in RACK.values()
    by = layout.bump if travels else moving[0]
    look = f"{layout.names.wheel_centre}.z" if travels else by
    values = motion.inputs[by] if look == by else np.where(motion.converged, motion[look], np.nan)
    return by, np.asarray(values, float) - float(still[look]), travels


def _number_label(name: str, axle: str) -> str:
    if name in ("brake_support_angle", "drive_support_angle"):
        brake = name == "brake_support_angle"
        return f"{_SUPPORT[axle][not brake]}, {'braking' if brake else 'driving'}"
    return LABELS[name]


def _report_row(
    name: str, label: str, unit: str, static: float, slope: float, per: str, values: np.ndarray, along: np.ndarray
) -> SuspensionRow:
    """A number with its range over the poses that were found."""
    low, high = math.nan, math.nan
    at = [math.nan, math.nan]
    if np.isfinite(values).any():
        ends = int(np.nanargmin(values)), int(np.nanargmax(values))
        low, high = (float(values[k]) for k in ends)
        at = [float(along[k]) for k in ends]
    static, slope = (0.0 if abs(v) < _NOTHING else v for v in (static, slope))
    return SuspensionRow(name, label, unit, static, slope, per, low, at[0], high, at[1])


def _turn_differences(
    turned: np.ndarray, along: np.ndarray, track: float, wheelbase: float | None, mm: float
) -> dict[str, np.ndarray]:
    """How much more the inner wheel steers than the outer, its mirror image, where the sweep goes as far either way.

    `turned` is how far this wheel is steered outward from where it is drawn, degrees. The other wheel does at the one
    end of the rack what this one does at the other. The Ackermann percentage compares that with wheels whose axes meet
    on the line of the other axle: cot δo = cot δi + track / wheelbase.
    """
    if np.abs(along + along[::-1]).max() > 1e-6 * np.abs(along).max():
        return {}
    turned = np.where(np.abs(turned) < _NOTHING, 0.0, turned)
    inner = np.maximum(turned, turned[::-1])
    out = {"toe_out_in_turns": turned + turned[::-1]}
    if wheelbase is not None:
        with np.errstate(all="ignore"):
            a = np.radians(inner)
            ideal = np.degrees(a - np.arctan2(np.sin(a), np.cos(a) + track / (wheelbase * mm) * np.sin(a)))
            out["ackermann"] = np.where(inner > 0, 100.0 * out["toe_out_in_turns"] / ideal, np.nan)
    return out


def _anti_percentages(
    static: Mapping[str, float], axle: str, wheelbase: float | None, height: float | None, shares: tuple
) -> dict[str, float]:
    """Which part of the load transfer the suspension takes up in braking and driving, percent."""
    if wheelbase is None or height is None:
        return {}
    out = {}
    for name, label, share in zip(("brake", "drive"), _SUPPORT[axle], shares, strict=True):
        angle = static.get(f"{name}_support_angle")
        if share is not None and angle is not None:
            verb = "braking" if name == "brake" else "driving"
            out[f"{label.removesuffix(' angle')}, {verb}"] = 100.0 * share * math.tan(angle) * wheelbase / height
    return out


def _drawn_hardpoints(still: Motion, mm: float) -> dict[str, tuple[str, tuple[float, ...]]]:
    """Points with what the trade calls them, and where they are drawn."""
    trade = trade_names(still.names, every=True)
    top = still.system.topology
    points = {*top.points, *(m.name for m in top.markers if not m.direction)}
    return {p: (called, tuple((np.asarray(still[p]) * mm).tolist())) for p, called in trade.items() if p in points}


# -- words ------------------------------------------------------------------------------------------------------------


def _format_number(value: float, digits: int) -> str:
    return f"{value + 0.0:.{digits}f}" if math.isfinite(value) else "-" if math.isnan(value) else f"{value}"


def _row_cells(row: SuspensionRow) -> list[str]:
    digits = _DIGITS.get(row.unit, 2)
    ends = [_format_number(v, d) for v, d in ((row.smallest, digits), (row.smallest_at, 1), (row.largest, digits))]
    unit = f" [{row.unit}]" if row.unit else ""
    slope = f"{row.gradient:.4g}" if math.isfinite(row.gradient) else "-"
    return [
        row.label + unit,
        _format_number(row.static, digits),
        slope,
        row.gradient_unit,
        *ends,
        _format_number(row.largest_at, 1),
    ]
