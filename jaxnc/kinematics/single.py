"""One pose after the other from Python: each is a single step from the nearest pose that the same system had before.

What a user waits for here is the way into compiled code and back, so there is one call and nothing else. A step that is
not beyond doubt (the checks of a march) is left to the walk from the drawing.
"""

import dataclasses
import functools
from bisect import bisect_left
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.kinematics.motion import Motion
from jaxnc.solvers.kernel import kernel, writes_out
from jaxnc.solvers.march import FEEL, March, marcher, setting_out
from jaxnc.solvers.plan import Plan
from jaxnc.status import Status
from jaxnc.system.equations import Equations
from jaxnc.system.precision import limits
from jaxnc.system.system import System
from jaxnc.types import Array

_SPACING = 0.1  # of a radian or of the size: poses are kept so far apart
_MOST = 1024  # poses kept


class Earlier:
    """Poses of one system and one input that are known to be on the drawing's branch, sorted by the input."""

    def __init__(self, view: Plan, eq: Equations, start: Array):
        """Args: what is solved for; the equations; the start pose."""
        self.view, self.eq = view, eq
        # Flat, because the way into compiled code takes longer the more Python has to be asked what is in there.
        self.leaves, self.tree = jax.tree.flatten(eq)
        top, c = view.topology, int(view.known[0])
        scalar = c - (len(top.coordinates) - len(top.scalars))
        self.turning = scalar >= 0 and top.periodic[scalar]
        self.spacing = _SPACING * (1.0 if scalar >= 0 and top.angles[scalar] else float(eq.length))
        self.origin = float(start[c])
        self.short = FEEL * self.spacing
        self.inputs: list[float] = []
        self.poses: list[tuple[Array, Array, Array]] = []

    def near(self, value: float) -> float:
        """The value counted from the turn nearest to the start pose."""
        if not self.turning:
            return value
        return value - 2 * np.pi * round((value - self.origin) / (2 * np.pi))

    def nearest(self, value: float) -> int:
        """Place of the pose nearest to a value."""
        k = bisect_left(self.inputs, value)
        if k == len(self.inputs) or (k > 0 and value - self.inputs[k - 1] < self.inputs[k] - value):
            k -= 1
        return k

    def keep(self, value: float, q: Array) -> None:
        """Remember a pose, unless one is near."""
        k = self.nearest(value) if self.inputs else 0
        if self.inputs and (len(self.inputs) >= _MOST or abs(self.inputs[k] - value) < self.spacing):
            return
        facing, rise, good = _feel(self.view, self.tree, self.leaves, q, np.array([value, self.short]))
        if not bool(good):  # the branch ends here
            return
        k = bisect_left(self.inputs, value)
        self.inputs.insert(k, value)
        self.poses.insert(k, (q, facing, rise))


def quick(system: System, inputs: Any, hold: Sequence[str], redundancy: str) -> Motion | None:
    """The pose at one value of one input, if a step from an earlier pose gives it; None otherwise."""
    known = system.__dict__.get("_earlier")
    if known is None or type(inputs) is not dict or len(inputs) != 1:
        return None
    ((name, value),) = inputs.items()
    earlier = known.get((name, (hold,) if isinstance(hold, str) else tuple(hold or ()), redundancy))
    if earlier is None or not isinstance(value, (float, int, np.floating)) or not np.isfinite(value):
        return None
    near = earlier.near(float(value))
    if not earlier.inputs:
        return None
    k = earlier.nearest(near)
    at = np.array([earlier.inputs[k], near, value])
    q, asked, status, size, pivots = _step(earlier.view, earlier.tree, earlier.leaves, *earlier.poses[k], at)
    if np.asarray(status) != 0:  # int() of it would take three times as long
        return None
    if abs(earlier.inputs[k] - near) > earlier.spacing:
        earlier.keep(near, q)
    return _single(system, name, earlier.view.held, q, asked, status, size, pivots)


def remember(system: System, view: Plan, eq: Equations, start: Array, motion: Motion, key: tuple) -> None:
    """Keep a pose that was found from the drawing, for the next call."""
    if len(view.driven) != 1 or not writes_out(view):
        return
    if any(isinstance(x, Tracer) for x in jax.tree.leaves((eq, start, motion.asked, motion.q, motion.status))):
        return
    if motion.status.shape or int(motion.status) != 0:
        return
    known = system.__dict__.get("_earlier")
    if known is None:
        # Beside the fields: whatever is made from this system by JAX or by `replace` begins without it.
        known = {}
        object.__setattr__(system, "_earlier", known)
    if key not in known:
        if float(eq.misfit) > limits(start).misfit:
            return
        known[key] = Earlier(view, eq, start)
        known[key].keep(known[key].origin, start)
    value = known[key].near(float(motion.asked[0]))
    known[key].keep(value, motion.q)


def _single(system, name, held, q, asked, status, size, pivots) -> Motion:
    """``Motion(system, (name,), held, q, (), asked, status, size, pivots)`` without what its class checks each time."""
    out = object.__new__(Motion)
    fields = _REST | {"system": system, "driven": (name,), "held": held, "poses": q, "asked": asked}
    fields |= {"status": status, "residual": size, "conditioning": pivots}
    for field, value in fields.items():
        object.__setattr__(out, field, value)
    return out


_REST = {f.name: f.default for f in dataclasses.fields(Motion) if f.default is not dataclasses.MISSING} | {"rates": ()}


@functools.partial(jax.jit, static_argnums=(0, 1))
def _feel(view: Plan, tree: Any, leaves: list, q: Array, at: Array) -> tuple[Array, Array, Array]:
    """Determinants of the blocks at a pose, how they change with the input, and whether a short step was right.

    `at` has the input there, counted from the start pose's turn, and the length of the step.
    """
    core, eq = kernel(view), jax.tree.unflatten(tree, leaves)
    x = [q[k] for k in range(q.shape[0])]
    x[int(view.known[0])] = at[0]
    known = jnp.stack([x[int(k)] for k in view.known])
    step = marcher(core, eq, x, core.signs(eq, x))
    begin = setting_out(core, eq, x, ())
    end = step(begin, known.at[0].add(at[1]))
    facing, then = jnp.stack(begin.determinants), jnp.stack(end.determinants)
    return facing, (then - facing) / at[1], end.good


@functools.partial(jax.jit, static_argnums=(0, 1))
def _step(
    view: Plan, tree: Any, leaves: list, q: Array, facing: Array, rise: Array, at: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """A step from an earlier pose: `at` has its input, the wanted one counted from the same turn, and as asked for."""
    core, c, eq = kernel(view), int(view.known[0]), jax.tree.unflatten(tree, leaves)
    x = [q[k] for k in range(q.shape[0])]
    x[c] = at[0]  # counted from the start pose's turn, which the pose itself need not be
    places = [int(k) for k in (*view.unknown, *view.known)]
    none, way = jnp.zeros(()), [jnp.ones(()), *[jnp.zeros(())] * (len(view.known) - 1)]
    begin = March(tuple(x[k] for k in places), jnp.array(True), none, none, tuple(facing), tuple(rise), tuple(way))
    step = marcher(core, eq, x, [jnp.sign(d) for d in facing])
    out = step(begin, jnp.stack([at[1], *(x[int(k)] for k in view.known[1:])]))
    found = dict(zip(places, out.x, strict=True))
    found[c] = at[2]
    good = out.good & (out.pivots > limits(q).singular)
    status = jnp.where(good, int(Status.CONVERGED), int(Status.DID_NOT_ASSEMBLE))
    return jnp.stack([found.get(k, x[k]) for k in range(len(x))]), at[2:], status, out.size, out.pivots
