"""Conditions on how a mechanism stands: the direction of a line such as the ground's, and the circuit it is on."""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError, nearest
from jaxnc.synthesis.conditions import Condition, Seen, known
from jaxnc.synthesis.loops import four_bar_loop
from jaxnc.system.system import System
from jaxnc.types import Array

_SIDES = {"left": 1.0, "right": -1.0}


@dataclass(frozen=True)
class Direction(Condition):
    """The direction of a line from one point to another at the first target: a value, or between two."""

    start: str
    end: str
    low: float
    high: float
    equality: bool = False

    @property
    def name(self) -> str:
        return f"direction {self.start}-{self.end}"

    def prepared(self, system: System, driven: str) -> "Condition":
        _planar(system, "direction")
        known(system, self.name, self.start, self.end)
        return self

    def values(self, seen: Seen) -> Array:
        way = seen.motion[self.end][0] - seen.motion[self.start][0]
        middle = 0.5 * (self.low + self.high)
        along = jnp.cos(middle) * way[0] + jnp.sin(middle) * way[1]
        across = jnp.cos(middle) * way[1] - jnp.sin(middle) * way[0]
        if self.equality:
            return jnp.arctan2(across, along)[None]
        # Its cosine has no jump opposite to the middle.
        return (along / jnp.linalg.norm(way) - jnp.cos(0.5 * (self.high - self.low)))[None]


@dataclass(frozen=True)
class Circuit(Condition):
    """The joint of a dyad stays on one side of the line between the dyad's ends."""

    side: float
    joint: tuple[str, str, str] | None = None

    @property
    def name(self) -> str:
        return f"circuit {'left' if self.side > 0.0 else 'right'}"

    def prepared(self, system: System, driven: str) -> "Condition":
        _planar(system, "on_circuit")
        if self.joint is None:
            loop = four_bar_loop(system, driven)
            if loop is None:
                raise InputError(
                    f"on_circuit: {system.name!r} has no four-bar loop at {driven!r}; say which joint decides it: "
                    f"joint=(far point of one bar, joint, far point of the other)"
                )
            return replace(self, joint=loop.names(system)[1:])
        known(system, "on_circuit", *self.joint)
        return self

    def values(self, seen: Seen) -> Array:
        assert self.joint is not None
        a, joint, b = (seen.motion[name] for name in self.joint)
        p, q = a - joint, b - joint
        across = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
        return self.side * across / (jnp.linalg.norm(p, axis=1) * jnp.linalg.norm(q, axis=1))


@public
def direction(
    start: str, end: str, value: float | None = None, min: float | None = None, max: float | None = None
) -> Condition:
    """The direction of the line from one point to another, of fixed pivots the angle of the ground.

    Of points that move, at the first target.

    Args:
        start: a point.
        end: another one.
        value: of the angle from the x axis, radians; or
        min: its least value, and
        max: its largest, less than a turn above it.
    """
    what = f"direction {start}-{end}"
    if value is not None and min is None and max is None:
        low = high = _angle(value, f"{what}: its value")
    elif value is None and min is not None and max is not None:
        low, high = _angle(min, f"{what}: min"), _angle(max, f"{what}: max")
        if not 0.0 < high - low < 2 * np.pi:
            raise InputError(
                f"{what}: from min={low:g} to max={high:g} rad must be a way forwards of less than a turn; "
                f"add 2*pi to max to go through the negative x axis"
            )
    else:
        raise InputError(f"{what}: give a value, or min= and max= (of an angle neither says anything by itself)")
    return Direction(start, end, low, high, value is not None)


@public
def on_circuit(side: str, joint: tuple[str, str, str] | None = None) -> Condition:
    """The mechanism is assembled on one of its two circuits, in every pose through the targets.

    Args:
        side: ``"left"`` or ``"right"``: where the joint between coupler and rocker lies, seen along the line from the
            crank pin to the rocker's fixed pivot.
        joint: first end of another dyad, its joint, second end; those of the four-bar loop at the input if not given.
    """
    if side not in _SIDES:
        raise InputError(f"on_circuit: side={side!r}; {nearest(str(side), _SIDES)}")
    return Circuit(_SIDES[side], joint)


def _planar(system: System, what: str) -> None:
    if system.topology.dim != 2:
        raise InputError(f"{what}: {system.name!r} is spatial; this condition is of the plane")


def _angle(value: float, what: str) -> float:
    try:
        out = float(value)
    except (TypeError, ValueError, OverflowError):
        out = np.nan
    if not abs(out) <= 4 * np.pi:
        raise InputError(f"{what} must be an angle in radians (numpy.radians makes them of degrees), got {value!r}")
    return out
