"""Inputs as the user gives them, checked and brought into one form."""

import dataclasses
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.asking import numbers
from jaxnc.compiling import refuse_fork
from jaxnc.errors import InputError, WrongCount, nearest
from jaxnc.kinematics.loose import loose_motions
from jaxnc.solvers.assembly import by_identity, derive, evaluate, meets, settle
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.equations import Equations
from jaxnc.system.precision import active, limits
from jaxnc.system.system import System
from jaxnc.types import Array, Inputs

_SMALL = 65_536  # numbers that are worth having on the host
_FEW = 1000  # values that show how large steps are


def array(value: Any, what: str) -> Any:
    """An array of a number, list or array, of the active type; traced values pass through."""
    if isinstance(value, Tracer):
        return jax.lax.convert_element_type(value, active())
    if isinstance(value, jax.Array) and value.size > _SMALL and value.dtype == active() and not value.weak_type:
        return value
    return numbers(value, what, active())


def finite(value: Any, what: str) -> None:
    """Refuse NaN and infinity in values that are known."""
    if not isinstance(value, Tracer) and not np.all(np.isfinite(value)):
        bad = int(np.sum(~np.isfinite(value)))
        raise InputError(f"{what}: {bad} of {np.size(value)} values are NaN or infinite")


def positive(value: Any, what: str, zero: bool = False) -> None:
    """Refuse what is no positive finite number, among values that are known."""
    if isinstance(value, Tracer):
        return
    try:
        number = np.nan if isinstance(value, str) else float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not np.isfinite(number) or number < 0 or (number == 0 and not zero):
        raise InputError(f"{what} must be a {'number from 0 on' if zero else 'positive number'}, got {value!r}")


def check_system(system: Any, what: str) -> None:
    """Refuse anything but a compiled system outside of traced code, before it fails further down."""
    if not isinstance(system, System):
        kind = type(system).__name__
        hint = "call its compile() first" if kind == "Mechanism" else "m.compile() makes one"
        raise InputError(f"{what} needs a compiled System, got {kind}; {hint}")
    outside(system.parameters.points, what)


def outside(value: Any, what: str) -> None:
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
    hold = (hold,) if isinstance(hold, str) else tuple(hold or ())
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
    """What there is to know of a system for which there are too few or too many inputs."""
    notes = loose_motions(system, asked) if len(asked) < system.degrees_of_freedom else []
    eq = derive(system)
    q, gap, _ = settle(eq, np.zeros(len(system.topology.coordinates)))
    if not meets(eq, q, float(gap)):
        notes.append(f"its drawing does not assemble, {worst_rows(system, eq, q)}; jaxnc.diagnose(system) says why")
    return notes


def worst_rows(system: System, eq: Equations, q: Any, most: int = 3) -> str:
    """The constraints that a pose violates most, by name, with how much."""
    r = np.abs(np.asarray(evaluate(eq, jnp.asarray(q))[0]))
    order = [int(i) for i in np.argsort(-r)[:most] if r[i] > limits(eq.length).close * float(eq.length)]
    return ", ".join(f"{system.topology.rows[i]} is off by {r[i]:.3g}" for i in order) or "no constraint is violated"


def check_parameters(system: System) -> None:
    """Refuse a system whose parameters are known and not finite."""
    refuse_fork()
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


def angle_unit(unit: Any) -> str:
    """A unit of angles, checked."""
    if unit not in ANGLES:
        raise InputError(f"unit={unit!r}: angles are given in 'rad' or 'deg'")
    return unit


def in_radians(system: System, unit: str, *given: Any) -> tuple[Any, ...]:
    """Mappings from names to values of inputs or their rates, those of angles in radians.

    Given are mappings to numbers, arrays, sequences of them, or functions of time; anything else is left alone. `unit`
    is what angles are given in, ``"rad"`` or ``"deg"``.
    """
    if angle_unit(unit) == "rad" or not isinstance(system, System):  # what is no system is refused further down
        return given
    top = system.topology
    angles = {name for name, angle in zip(top.scalars, top.angles, strict=True) if angle}

    def one(mapping: Any) -> Any:
        if not isinstance(mapping, Mapping):
            return mapping
        return {n: _turned(n, x) if n in angles else x for n, x in mapping.items()}

    return tuple(one(mapping) for mapping in given)


def _turned(name: str, value: Any) -> Any:
    if callable(value):
        return _InRadians(value)
    if isinstance(value, tuple):
        return tuple(_turned(name, x) for x in value)
    return array(value, f"{name!r}") * (math.pi / 180.0)


@dataclasses.dataclass(frozen=True)
class _InRadians:
    """A function of time in degrees as one in radians; equal where its function is, so that nothing is traced anew."""

    function: Callable

    def __call__(self, t: Any) -> Any:
        return self.function(t) * (math.pi / 180.0)


def doubt_degrees(system: System, names: Sequence[str], values: Any) -> None:
    """Warn where an angle runs through many turns in steps of about one radian: degrees, most likely."""
    if isinstance(values, Tracer) or len(values) < 24:
        return
    top = system.topology
    for k, name in enumerate(names):
        if not top.is_angle(name):
            continue
        x = np.asarray(values)[:, k]
        if not 0.4 <= _step(x[:_FEW]) <= 6.0:  # soon said of very many
            continue
        turns = float(np.ptp(x)) / (2.0 * math.pi)
        if turns >= 12.0 and 0.45 <= (step := _step(x)) <= 5.1:
            said = f"{name!r} runs through {turns:.0f} turns in steps of {step:.3g} rad: angles are in radians here"
            told = "for degrees unit='deg', in a file units = { angle = \"deg\" }, on the command line 0deg:360deg"
            warnings.warn(f"{said}; {told}", UserWarning, stacklevel=4)


def _step(x: np.ndarray) -> float:
    return float(np.median(np.abs(np.diff(x))))


def named(inputs: Inputs, what: str = "input") -> tuple[str, ...]:
    """Names of a mapping of inputs."""
    if not isinstance(inputs, Mapping):
        raise InputError(f"{what}s are given by name, such as {{'phi': 0.3}}; got {type(inputs).__name__}")
    return tuple(inputs)


def stack(inputs: Inputs, what: str = "input") -> tuple[tuple[str, ...], Array, tuple[int, ...]]:
    """Names, values ``(*batch, k)`` and batch shape of a mapping of inputs; several arrays zip."""
    names = named(inputs, what)
    if names and all(type(v) is float and math.isfinite(v) for v in inputs.values()):  # one pose, as it is asked often
        return names, np.array([*inputs.values()], active()), ()  # pyright: ignore[reportReturnType]
    values = [array(v, f"{what} {n!r}") for n, v in inputs.items()]
    for name, value in zip(names, values, strict=True):
        finite(value, f"{what} {name!r}")
    try:
        shape = np.broadcast_shapes(*(v.shape for v in values))
    except ValueError:
        shapes = ", ".join(f"{n}: {v.shape}" for n, v in zip(names, values, strict=True))
        raise InputError(f"several inputs move together and need one shape; got {shapes}") from None
    if not names:
        return names, np.zeros(0, active()), ()  # pyright: ignore[reportReturnType]
    if any(isinstance(v, jax.Array) for v in values):
        return names, jnp.stack([jnp.broadcast_to(v, shape) for v in values], axis=-1), shape
    return names, np.stack([np.broadcast_to(v, shape) for v in values], axis=-1), shape  # pyright: ignore[reportReturnType]


def rate_values(rates: Inputs | None, names: Sequence[str], shape: tuple[int, ...], what: str) -> Any:
    """Rates of the inputs, ``(*batch, k)``; inputs without one stand still."""
    if rates is None:
        return None
    if not isinstance(rates, Mapping):
        raise InputError(f"{what} are given by name, such as {{'phi': 10.0}}; got {rates!r}")
    for name in rates:
        if name not in names:
            raise InputError(f"{what}: {name!r} is not one of the inputs; {nearest(name, names)}")
    columns = []
    for name in names:
        value = array(rates.get(name, 0.0), f"{what} of {name!r}")
        finite(value, f"{what} of {name!r}")
        try:
            if np.broadcast_shapes(value.shape, shape) != shape:
                raise ValueError
        except ValueError:
            raise InputError(f"{what} of {name!r} has shape {value.shape}, the inputs have {shape}") from None
        columns.append(value)
    # What NumPy can put together compiles nothing.
    xp = jnp if any(isinstance(x, jax.Array) for x in columns) else np
    return xp.stack([xp.broadcast_to(x, shape) for x in columns], axis=-1) if columns else np.zeros((*shape, 0))
