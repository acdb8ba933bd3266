"""Inputs as the user gives them, checked and brought into one form, and doubted where a unit looks wrong."""

import dataclasses
import itertools
import math
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeGuard

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.compiling import refuse_fork
from jaxnc.constraints.coordinates import DISTANCE_BETWEEN
from jaxnc.errors import InputError, WrongCount, brief, nearest
from jaxnc.kinematics.freedoms import explain_lock, loose_motions
from jaxnc.records import by_identity
from jaxnc.solvers.assembly import derive, evaluate, meets, settle, to_host
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.equations import Equations
from jaxnc.system.host import HostEquations
from jaxnc.system.precision import active, limits
from jaxnc.system.system import System
from jaxnc.system.topology import LARGE, Topology
from jaxnc.types import Array, ArrayLike, Inputs
from jaxnc.validate import as_array, as_traceable

METRES = {"m": 1.0, "dm": 0.1, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
"""What the usual length units are in metres."""

NEVER_MOVES = (
    "{} as input determines no motion, in the drawing or near it: what never changes, or "
    "follows from the other inputs, drives nothing"
)
"""What is said of inputs that are singular in every pose."""

_MACHINE = (1e-3, 300.0)  # metres: watches to bucket-wheel excavators
_USUAL = (0.04, 8.0)  # metres: sizes that a unit is proposed for


def array(value: object, what: str) -> Any:
    """An array of a number, list or array, of the active type; traced values pass through."""
    if _is_large(value) and value.dtype == active() and not value.weak_type:
        return value
    return as_traceable(value, what, active())


def _is_large(value: object) -> TypeGuard[jax.Array]:
    """Tell whether a value is an array of JAX that is too large to be worth having on the host."""
    return isinstance(value, jax.Array) and value.size > 65_536


def finite(value: ArrayLike, what: str) -> None:
    """Refuse NaN and infinity in values that are known."""
    if not isinstance(value, Tracer) and not np.all(np.isfinite(value)):
        bad = int(np.sum(~np.isfinite(value)))
        raise InputError(f"{what}: {bad} of {np.size(value)} values are NaN or infinite")


def finite_array(value: object, what: str) -> Any:
    """An array as `array` makes it, of numbers that are `finite`."""
    found = array(value, what)
    finite(found, what)
    return found


def positive(value: Any, what: str, zero: bool = False) -> None:
    """Refuse what is no positive finite number, among values that are known."""
    if isinstance(value, Tracer):
        return
    try:
        number = np.nan if isinstance(value, str) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = np.nan
    if not np.isfinite(number) or number < 0 or (number == 0 and not zero):
        raise InputError(f"{what} must be a {'number from 0 on' if zero else 'positive number'}, got {value!r}")


def one_number(value: ArrayLike, what: str) -> float:
    """A single finite number; anything else is refused."""
    found = as_array(value, what)
    if found.shape != () or not np.isfinite(found):
        raise InputError(f"{what} must be one finite number, got {brief(value)}")
    return float(found)


def whole(value: float, what: str, least: int = 1, most: int = 2**31 - 1) -> int:  # more are taken for a slip
    """A whole number in a range; anything else is refused."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        near = f"; write {int(value)}" if isinstance(value, float) and value.is_integer() and abs(value) < most else ""
        raise InputError(f"{what} must be a whole number, got {brief(value)}{near}")
    if not least <= value <= most:
        bound = f"at least {least}" if value < least else f"at most {most}"
        raise InputError(f"{what} must be {bound}, got {brief(value)}")
    return int(value)


def check_system(system: object, what: str, several: bool = False) -> None:
    """Refuse anything but a compiled system of finite numbers outside of traced code, before it fails further down."""
    if not isinstance(system, System):
        kind = type(system).__name__
        hint = "call its compile() first" if kind == "Mechanism" else "m.compile() makes one"
        raise InputError(f"{what} needs a compiled System, got {kind}; {hint}")
    outside(system.parameters.points, what)
    check_parameters(system, several)


def outside(value: object, what: str) -> None:
    """Refuse traced values, of any pytree, where an answer is made on the host."""
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(value)):
        raise InputError(
            f"{what} works outside of traced code only (not inside jit, vmap or grad), where there are numbers: return "
            f"what it is asked of, and ask there"
        )


REDUNDANCY = ("least squares", "independent rows")


def make_plan(system: System, driven: Sequence[str], hold: Sequence[str], redundancy: str = REDUNDANCY[0]) -> Plan:
    """The plan of a system for names of inputs; see `jaxnc.solvers.plan.plan` for its errors."""
    if not isinstance(system, System):
        check_system(system, "an analysis")
    hold = (hold,) if isinstance(hold, str) else () if hold is None else tuple(hold)
    for name in (*driven, *hold):
        if not isinstance(name, str):
            raise InputError(f"inputs are named by strings such as 'phi'; got {name!r}")
    if redundancy not in REDUNDANCY:
        raise InputError(f"redundancy={redundancy!r}; {nearest(redundancy, REDUNDANCY)}")
    independent = redundancy == REDUNDANCY[1]
    try:
        return plan(system.topology, tuple(driven), hold, system.degrees_of_freedom, independent)
    except WrongCount as error:
        known = (
            not system.topology.large
            and not isinstance(system.parameters.points, Tracer)
            and system.parameters.points.ndim == 2
        )
        notes = _notes(system, (*driven, *hold)) if known else []
        raise InputError(f"{error}. Note: {'; '.join(notes)}" if notes else str(error)) from None


def _notes(system: System, asked: tuple[str, ...]) -> list[str]:
    """Say what there is to know of a system for which there are too few or too many inputs."""
    notes = loose_motions(system, asked) if len(asked) < system.degrees_of_freedom else explain_lock(system)
    eq = derive(system)
    q, gap, _ = settle(eq, np.zeros(len(system.topology.coordinates)))
    if not meets(eq, q, float(gap)):
        notes.append(f"its drawing does not assemble, {worst_rows(system, eq, q)}; jaxnc.diagnose(system) says why")
    return notes


def worst_rows(system: System, eq: Equations, q: np.ndarray) -> str:
    """The constraints that a pose violates most, by name, with how much."""
    r = np.abs(np.asarray(evaluate(eq, jnp.asarray(q))[0]))
    order = np.array([int(i) for i in np.argsort(-r)[:3] if r[i] > limits(eq.length).close * float(eq.length)], int)
    gaps = row_gaps(to_host(eq), np.asarray(q), order)
    said = ", ".join(f"{system.topology.rows[i]} is off by {gap:.3g}" for i, gap in zip(order, gaps, strict=True))
    (upright,), (mirrored,) = to_host(eq).guards(np.asarray(q)[:, None])
    rest = "a body is its mirror image" if mirrored else "the rows depend on each other and are met roughly only"
    return said or f"no constraint is violated, but {rest if upright or mirrored else 'an angle is off by half a turn'}"


def meeting_ends(system: System, q: np.ndarray) -> str:
    """Say in a sentence which distances are zero in a pose, where they have no derivative; empty if none is."""
    top = system.topology
    first, size = len(top.coordinates) - len(top.scalars), float(derive(system).length)
    zero = [
        name
        for k, (name, (block, _)) in enumerate(zip(top.scalars, top.measures, strict=True))
        if top.blocks[block].kind is DISTANCE_BETWEEN and abs(q[first + k]) <= 1e-5 * size
    ]
    if not zero:
        return ""
    return f" The ends of {zero[0]!r} meet there, which stops the motion: measure it along= a line, or leave it out."


def row_gaps(eq: HostEquations, q: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Lengths by which rows are missed: how far a point has to move, straight at what its row asks for, to meet it.

    Of a bar this is what its length lacks. Rows that bend more than squares do are taken for squares.
    """
    top, out = eq.topology, np.abs(eq.residual(q[:, None])[rows, 0])
    if top.large or not len(rows):
        return out
    scalars, step = len(q) - len(top.scalars), 1e-2 * float(eq.length)  # of a difference that is exact for squares
    ends = [*range(0, scalars, top.dim), *range(scalars, len(q) + 1)]
    groups = [np.arange(a, b) for a, b in itertools.pairwise(ends)]  # coordinates of a point, a vector or a scalar
    for k, slopes in enumerate(eq.jacobian(q[:, None])[0][rows] / eq.weights):
        along = max(groups, key=lambda group: float(np.linalg.norm(slopes[group])))
        slope = float(np.linalg.norm(slopes[along]))
        if slope > 0.0:
            way = np.zeros(len(q))
            way[along] = slopes[along] / slope / eq.weights[along]
            before, now, after = eq.residual(q[:, None] + way[:, None] * [-step, 0.0, step])[rows[k]]
            first, second = (after - before) / (2 * step), (after - 2 * now + before) / step**2
            root = math.sqrt(max(first**2 - 2.0 * second * now, 0.0))  # zero where no place meets the row
            out[k] = abs(2.0 * now / (abs(first) + root))
    return out


def check_parameters(system: System, several: bool = False) -> None:
    """Refuse a system whose parameters are known and not finite, and `several` designs in one unless they are meant."""
    refuse_fork()
    if system.parameters.points.ndim > 2 and not several:
        raise InputError(
            f"{system.name!r}: these are {math.prod(system.parameters.points.shape[:-2])} designs in one, and this is "
            f"for a single one: take x[0] of its leaves, or map it, jax.vmap(lambda design: …)(designs)"
        )
    _check_parameters(system)


@by_identity
def _check_parameters(system: System) -> None:
    top, par = system.topology, system.parameters
    for leaf, names in (
        (par.points, top.points),
        (par.vectors, top.vectors),
        (par.markers, [m.name for m in top.markers]),
        (par.dimensions, top.dimensions),
        (par.physical, top.loads.physical),
    ):
        if isinstance(leaf, Tracer) or leaf.ndim != (1 if leaf is par.dimensions or leaf is par.physical else 2):
            continue
        bad = ~np.isfinite(np.asarray(leaf))
        for i in np.flatnonzero(bad.reshape(len(names), -1).any(axis=1)) if bad.any() else ():
            raise InputError(f"{top.name!r}: design variable {names[i]!r} is NaN or infinite")
    for own, force in zip(par.own, top.loads.functions, strict=False):
        for leaf in jax.tree.leaves(own):
            if not isinstance(leaf, Tracer) and not np.all(np.isfinite(np.asarray(leaf))):
                raise InputError(f"{top.name!r}: a parameter of the force {force.name!r} is NaN or infinite")


ANGLES = ("rad", "deg")
"""What ``unit=`` may be: of angles that are given, and of those that plots and tables show."""


def angle_unit(unit: str | None) -> str:
    """A unit of angles, checked; radians if none is given."""
    if unit is None:
        return ANGLES[0]
    if not isinstance(unit, str) or unit not in ANGLES:
        raise InputError(f"unit={brief(unit)}: angles are given in 'rad' or 'deg'")
    return unit


def in_radians(system: System, unit: str | None, *given: object) -> tuple[Any, ...]:
    """Mappings from names to values of inputs or their rates, those of angles in radians.

    Given are mappings to numbers, arrays, sequences of them, or functions of time; anything else is left alone. `unit`
    is what angles are given in, ``"rad"`` (also if it is None) or ``"deg"``.
    """
    if angle_unit(unit) == "rad" or not isinstance(system, System):  # what is no system is refused further down
        return given
    top = system.topology
    angles = {name for name, angle in zip(top.scalars, top.angles, strict=True) if angle}

    def one(mapping: object) -> Any:
        if not isinstance(mapping, Mapping):
            return mapping
        return {n: _to_radians(n, x) if n in angles else x for n, x in mapping.items()}

    return tuple(one(mapping) for mapping in given)


def _to_radians(name: str, value: float) -> Any:
    if callable(value):
        return _InRadians(value)
    if isinstance(value, tuple):
        return tuple(_to_radians(name, x) for x in value)
    return array(value, f"{name!r}") * (math.pi / 180.0)


@dataclasses.dataclass(frozen=True)
class _InRadians:
    """A function of time in degrees as one in radians; equal where its function is, so that nothing is traced anew."""

    function: Callable

    def __call__(self, t: Array) -> Array:
        return self.function(t) * (math.pi / 180.0)


def doubt_degrees(system: System, unit: str | None, *given: object) -> None:
    """Warn where angles that are taken in radians look like degrees; not where `unit` says what they are.

    Beyond a turn nobody writes radians in whole numbers, or steps over more than half a turn at a time, or through a
    dozen turns in strides of half a radian. Fractions of turns, in whole degrees, are radians that were converted.

    Args:
        system: the system.
        unit: what the user said; None if nothing.
        *given: mappings from names to values; functions, traced values and what is no angle are left alone.
    """
    if unit is not None or not isinstance(system, System):
        return
    for name, value in ((n, x) for mapping in given if isinstance(mapping, Mapping) for n, x in mapping.items()):
        if type(value) is float and abs(value) <= 2.0 * math.pi:  # one pose, as it is asked often
            continue
        x = value[0] if isinstance(value, tuple) and len(value) > 2 else value  # of (u, u̇, ü) the first
        if not isinstance(name, str) or not system.topology.is_angle(name) or callable(x):
            continue
        if isinstance(x, Tracer) or _is_large(x):
            continue
        why = _like_degrees(x)
        if why:
            shown = " (angle_unit= says how they are shown)" if system.topology.angle_unit == "deg" else ""
            warnings.warn(
                f"{name!r} {why}: angles are in radians here{shown}; for degrees unit='deg', in a file "
                f"units = {{ angle = \"deg\" }}, on the command line 0deg:360deg; for radians unit='rad'",
                UserWarning,
                stacklevel=_levels(),
            )


def _like_degrees(value: object) -> str:
    """Say what makes numbers look like degrees; "" if they do not, or are no numbers."""
    try:
        x = np.asarray(value)
        x = x.astype(float) if x.dtype.kind in "iuf" else np.zeros(0)
    except (TypeError, ValueError):
        return ""
    # 1000 values show how large steps are; nobody means a million degrees, and floats that are huge are all whole
    some = np.abs(x if x.size < 2000 else x.flat[:: x.size // 1000])
    if not 2.0 * math.pi < some.max(initial=0.0) < 1e6 or not np.isfinite(x).all():
        return ""
    if x.flat[0] == round(x.flat[0]) and np.all(x == np.round(x)):
        return f"is {x.flat[0]:g}" if x.size == 1 else f"goes in whole numbers from {x.min():g} to {x.max():g}"
    turns = float(np.ptp(x)) / (2.0 * math.pi)
    # Half of the steps are as long as the median: what is looked for below goes through a dozen turns, or they do.
    if x.ndim != 1 or turns < min(12.0, 0.25 * (x.size - 1)) or x.size < 2:
        return ""
    steps = np.diff(x)
    step = float(np.median(np.abs(steps)))
    far = step > math.pi and abs(steps.sum()) == np.abs(steps).sum()
    if not far and not (turns >= 12.0 and 0.45 <= step <= 5.1 and x.size >= 24):
        return ""
    degrees = math.degrees(step)
    if abs(degrees - round(degrees)) < 1e-6:
        return ""
    return f"runs through {turns:.0f} turn{'s' * (round(turns) != 1)} in steps of {step:.3g} rad"


def doubtful_size(system: System, noun: str = "mechanism", sizes: tuple[float, float] = _MACHINE) -> str:
    """Write a sentence on a drawing whose size is absurd in its length unit, with the remedy; empty if it is not.

    Its numbers are taken in the `length_unit` of its mechanism. Sizes are the least and the largest, in metres, of what
    the noun names.
    """
    points, unit = system.parameters.points, system.topology.length_unit
    if isinstance(points, Tracer) or np.ndim(points) != 2 or unit not in METRES or not len(points):
        return ""
    size = float(np.max(np.ptp(np.asarray(points), axis=0)))
    metres = size * METRES[unit]
    if size == 0.0 or sizes[0] <= metres <= sizes[1]:
        return ""
    fits = [u for u in ("mm", "m", "in", "cm") if u != unit and _USUAL[0] <= size * METRES[u] <= _USUAL[1]]
    text = f"the drawing is {size:.3g} {unit} wide, which is hardly meant for a {noun}"
    if not fits:
        return f"{text}: check its numbers and its length unit, {unit!r}"
    return f"{text}: its numbers look like {fits[0]}; set the length unit to {fits[0]!r} or convert the numbers"


def _levels() -> int:
    """Count the calls between the caller and the user's own line."""
    frame, levels = sys._getframe(1), 1
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith("jaxnc."):
        frame, levels = frame.f_back, levels + 1
    return levels


def check_inputs(
    system: System,
    inputs: Inputs,
    hold: Sequence[str],
    unit: str | None,
    start: object = None,
    redundancy: str = REDUNDANCY[0],
    several: bool = False,
) -> tuple[Plan, Array, Any]:
    """Check the inputs of an analysis of a design, or of `several` in one, and bring them into one form.

    Returns:
        What is to be solved for; values of the inputs in radians and lengths ``(*batch, k)``; the start in radians.
    """
    doubt_degrees(system, unit, inputs, start)
    inputs, start = in_radians(system, unit, inputs, start)
    if not isinstance(inputs, Mapping):
        raise InputError(f"inputs are given by name, such as {{'phi': 0.3}}; got {type(inputs).__name__}")
    view = make_plan(system, tuple(inputs), hold, redundancy)
    values = _zip_inputs(inputs)
    check_parameters(system, several)
    return view, values, start


def _zip_inputs(inputs: Inputs) -> Any:
    """Put the values of inputs into one array, ``(*batch, k)``; several arrays zip."""
    if all(type(v) is float and math.isfinite(v) for v in inputs.values()):  # one pose, as it is asked often
        return np.array([*inputs.values()], active())
    values = [finite_array(v, f"input {n!r}") for n, v in inputs.items()]
    if len(values) == 1 and type(values[0]) is np.ndarray:
        return np.array(values[0][..., None])  # a copy that nobody else has
    try:
        shape = np.broadcast_shapes(*(v.shape for v in values))
    except ValueError:
        shapes = ", ".join(f"{n}: {v.shape}" for n, v in zip(inputs, values, strict=True))
        raise InputError(f"several inputs move together and need one shape; got {shapes}") from None
    # What NumPy can put together compiles nothing.
    xp = jnp if any(isinstance(v, jax.Array) for v in values) else np
    return xp.stack([xp.broadcast_to(v, shape) for v in values], axis=-1)


def rate_values(rates: Inputs, names: Sequence[str], shape: tuple[int, ...], what: str) -> Any:
    """Rates of the inputs, ``(*batch, k)``; inputs without one stand still."""
    if not isinstance(rates, Mapping):
        raise InputError(f"{what} are given by name, such as {{'phi': 10.0}}; got {rates!r}")
    for name in rates:
        if name not in names:
            raise InputError(f"{what}: {name!r} is not one of the inputs; {nearest(name, names)}")
    columns = []
    for name in names:
        value = finite_array(rates.get(name, 0.0), f"{what} of {name!r}")
        try:
            if np.broadcast_shapes(value.shape, shape) != shape:
                raise ValueError
        except ValueError:
            raise InputError(f"{what} of {name!r} has shape {value.shape}, the inputs have {shape}") from None
        columns.append(value)
    xp = jnp if any(isinstance(x, jax.Array) for x in columns) else np  # as of `_zip_inputs`
    return xp.stack([xp.broadcast_to(x, shape) for x in columns], axis=-1) if columns else np.zeros((*shape, 0))


def dense_only(topology: Topology, what: str) -> None:
    """Refuse an analysis that forms dense matrices, for a system whose matrices are kept sparse."""
    if topology.large:
        raise InputError(
            f"{what} forms dense matrices, and those of {topology.name!r} with its {len(topology.unknown)} unknowns "
            f"are kept sparse; solve_position, sweep, motion, their rates and gradients, and mobility work. "
            f"compile(sparse=False) makes them dense whatever the size, sensible up to a few times {LARGE} unknowns"
        )
