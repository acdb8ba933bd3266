"""Classical quantities of planar mechanisms: transmission angle, Grashof type."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import on_device
from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.inputs import check_system
from jaxnc.kinematics.motion import Motion
from jaxnc.solvers.assembly import derive, settle
from jaxnc.system.on_lanes import on_host
from jaxnc.system.precision import on_host as with_numbers
from jaxnc.system.system import System
from jaxnc.types import Array


@public
@dataclass(frozen=True)
class Grashof:
    """Type of a four-bar linkage; ``str()`` is a sentence.

    Attributes:
        type: crank-rocker, rocker-crank, double-crank, double-rocker, triple-rocker or change-point.
        margin: (sum of the other two) - (shortest + longest), a length: positive if some bar turns fully.
        lengths: ground, input, coupler and output.
    """

    type: str
    margin: float
    lengths: tuple[float, float, float, float]

    def __str__(self) -> str:
        return f"{self.type}, Grashof margin {self.margin:.6g}"

    __repr__ = __str__


@public
def grashof_type(ground: float, crank: float, coupler: float, rocker: float) -> Grashof:
    """Classify a four-bar linkage by its lengths (Grashof; Barker's names of the types).

    Args:
        ground: distance of the fixed pivots.
        crank: length of the input bar.
        coupler: length of the coupler.
        rocker: length of the output bar.

    Returns:
        Type and margin.

    Raises:
        InputError: a length that is not positive and finite, or four lengths that do not close.
    """
    lengths = (float(ground), float(crank), float(coupler), float(rocker))
    for name, x in zip(("ground", "crank", "coupler", "rocker"), lengths, strict=True):
        if not (math.isfinite(x) and x > 0):
            raise InputError(f"Grashof type: length {name!r} must be positive, got {x}")
    ordered = sorted(lengths)
    if ordered[3] > sum(ordered[:3]):
        name = ("ground", "crank", "coupler", "rocker")[lengths.index(ordered[3])]
        raise InputError(
            f"Grashof type: the loop does not close, {name!r} = {ordered[3]:g} exceeds the other three together"
        )
    margin = ordered[1] + ordered[2] - ordered[0] - ordered[3]
    if abs(margin) <= 1e-12 * ordered[3]:
        kind = "change-point"
    elif margin < 0:
        kind = "triple-rocker"
    else:
        kind = ("double-crank", "crank-rocker", "double-rocker", "rocker-crank")[lengths.index(ordered[0])]
    return Grashof(kind, margin, lengths)


@public
@with_numbers
def grashof(system: System, crank: str, coupler: str, rocker: str) -> Grashof:
    """Classify the four-bar loop of three bodies and the ground in a system.

    Args:
        system: the system.
        crank: name of the input body.
        coupler: name of the coupler body.
        rocker: name of the output body.

    Returns:
        Type and margin, from the assembled drawing.

    Raises:
        InputError: unknown body, or bodies that do not form a loop with two ground pivots.
    """
    check_system(system, "grashof()")
    top = system.topology
    names = [b.name for b in top.bodies]
    for name in (crank, coupler, rocker):
        if name not in names:
            raise InputError(f"{top.name!r} has no body {name!r}; {nearest(name, names)}")
    sets = {b.name: set(b.points) for b in top.bodies}
    fixed = {i for i in range(len(top.points)) if all(top.fixed[i * top.dim : (i + 1) * top.dim])}

    def shared(a: set[int], b: set[int], what: str) -> int:
        both = a & b
        if len(both) != 1:
            raise InputError(f"Grashof type: {what} must share exactly one point, they share {len(both)}")
        return both.pop()

    joints = [
        shared(sets[crank], fixed, f"{crank!r} and the ground"),
        shared(sets[crank], sets[coupler], f"{crank!r} and {coupler!r}"),
        shared(sets[coupler], sets[rocker], f"{coupler!r} and {rocker!r}"),
        shared(sets[rocker], fixed, f"{rocker!r} and the ground"),
    ]
    eq = derive(system)
    q = np.asarray(settle(eq, np.zeros(len(top.coordinates))).q)
    p = [q[i * top.dim : (i + 1) * top.dim] for i in joints]
    a, b, c = (float(np.linalg.norm(p[k + 1] - p[k])) for k in range(3))
    return grashof_type(float(np.linalg.norm(p[3] - p[0])), a, b, c)


def _numeric(motion: Motion, *given: Array) -> tuple[Any, Sequence[Any]]:
    """NumPy and its arrays, so that nothing is compiled, if a motion was found on the host; else JAX."""
    return (np, [np.asarray(x) for x in given]) if on_host(motion.poses, given) else (jnp, given)


def _as_jax(x: Any) -> Array:
    return on_device(x) if isinstance(x, np.ndarray | np.generic) else x


@public
def transmission_angle(motion: Motion, start: str, joint: str, end: str) -> Array:
    """Transmission angle at a joint: the acute angle between the bars that meet there.

    Args:
        motion: the motion.
        start: the far point of the coupler.
        joint: the joint of coupler and driven bar.
        end: the far point of the driven bar.

    Returns:
        Angle in 0 … π/2, radians, ``(...,)``.
    """
    numeric, (a, b, c) = _numeric(motion, motion[start], motion[joint], motion[end])
    d, w = a - b, c - b
    cosine = abs((d * w).sum(axis=-1))
    sine = abs(d[..., 0] * w[..., 1] - d[..., 1] * w[..., 0])
    return _as_jax(numeric.arctan2(sine, cosine))
