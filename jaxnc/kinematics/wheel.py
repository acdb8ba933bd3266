"""A wheel along a motion: its numbers, each computed when it is asked for, and what its parts are called."""

import dataclasses
import functools
import warnings
from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.core import Tracer

from jaxnc.compiling import jit
from jaxnc.constraints.kind import ratio
from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.rates import rates
from jaxnc.kinematics.sizes import doubtful_size
from jaxnc.solvers.assembly import derive
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.equations import Equations
from jaxnc.types import Array

Line = str | tuple[str, str]
"""A direction: the name of a unit vector or marker, or two points."""


class Names(NamedTuple):
    """What the parts of a suspension are called."""

    wheel_centre: Any = None  # a point or marker
    spin_axis: Any = None  # a `Line`
    steering_axis: tuple[str, str] | None = None
    contact: str | None = None
    spring: Line | None = None


_USUAL = (
    Names("wheel_centre", ("wheel_centre", "spindle"), ("lower_ball", "upper_ball"), "contact", "damper"),
    Names("wheel_centre", "spin_axis", ("lower_ball", "upper_ball"), "contact", "damper"),
    Names("6", "v2", ("2", "8"), "contact", "s"),  # figure 42
)
"""Names that are looked for where none are given: those of `jaxnc.library`."""


_NOTHING = Names()


def wheel_of(
    motion: Motion,
    given: Names = _NOTHING,
    side: str = "left",
    radius: float | Array | None = None,
    bump: str | None = None,
    steering: tuple[str | None, str | None] = (None, None),
    axle: str = "front",
) -> "_Wheel":
    """The wheel, from what `jaxnc.suspension` is given; `steering` is carrier and steer.

    Raises:
        InputError: see there.
    """
    top = motion.system.topology
    if top.dim != 3:
        raise InputError(f"suspension() is for spatial mechanisms; {top.name!r} is planar")
    for name, value, allowed in (("side", side, ("left", "right")), ("axle", axle, ("front", "rear"))):
        if value not in allowed:
            raise InputError(f"suspension: {name}={value!r}; use one of {', '.join(map(repr, allowed))}")
    carrier, steer = steering
    instantaneous = given.steering_axis is None and (carrier is not None or steer is not None)
    if radius is not None and given.contact is not None:
        raise InputError("suspension: contact= and radius= both give the tyre's radius; leave one of them out")
    names = _resolved(motion, given)
    if radius is None and names.contact is None:
        raise InputError(
            "suspension: the tyre's radius is not known; give radius=, or contact=, a point or marker drawn "
            "where the wheel touches the road"
        )
    if instantaneous and (carrier is None or steer is None):
        raise InputError(
            "suspension: an instantaneous steering axis needs both carrier= (a body) and steer= (an input)"
        )
    doubt = doubtful_size(motion.system, suspension=True)
    if doubt:
        warnings.warn(f"{top.name!r}: {doubt}", UserWarning, stacklevel=3)
    screw = (carrier, steer) if carrier is not None and steer is not None and instantaneous else None
    wheel = _Wheel(motion, names, side, radius, _bump(motion, bump, names.wheel_centre), screw, axle)
    if not isinstance(motion.system.parameters.points, Tracer):
        _on_side(wheel.drawn_centre, side, names.wheel_centre)
    return wheel


@dataclasses.dataclass(frozen=True)
class _Wheel:
    """The numbers of a `jaxnc.Suspension`, each computed when it is asked for."""

    motion: Motion
    names: Names
    side: str
    radius: float | Array | None
    bump: str
    screw: tuple[str, str] | None  # a carrier and the input that steers it
    axle: str

    @property
    def outward(self) -> float:
        return 1.0 if self.side == "left" else -1.0

    @functools.cached_property
    def equations(self) -> Equations:
        return derive(self.motion.system)

    @functools.cached_property
    def drawn(self) -> Motion:
        return _posed(self.motion, self.equations.home)

    @functools.cached_property
    def drawn_centre(self) -> Array:
        return self.drawn[self.names.wheel_centre]

    @functools.cached_property
    def rising(self) -> Motion:
        return _driven_by(self.motion, self.equations, self.bump)

    @functools.cached_property
    def centre(self) -> Array:
        return self.motion[self.names.wheel_centre]

    @functools.cached_property
    def line(self) -> Array:
        return _line(self.motion, self.names.spin_axis)

    @functools.cached_property
    def axis(self) -> Array:
        """Unit vector along the spin axis, to the left on either side."""
        return jnp.where(self.line[..., 1:2] < 0, -1.0, 1.0) * self.line / _length(self.line)[..., None]

    def touch(self, centre: Array, axis: Array) -> Array:
        """The contact centre, a function of the wheel's centre and axis."""
        r = self.radius
        if r is None:
            assert self.names.contact is not None
            r = _length(self.drawn[self.names.contact] - self.drawn_centre)
        axis = axis / _length(axis)[..., None]
        up = jnp.array([0.0, 0.0, 1.0]) - axis[..., 2:] * axis
        return centre - jnp.asarray(r, float) * up / _length(up)[..., None]

    @functools.cached_property
    def contact(self) -> Array:
        return self.touch(self.centre, self.line)

    @functools.cached_property
    def lift(self) -> Array:
        return self.rising.velocity(self.names.wheel_centre)

    @property
    def camber(self) -> Array:
        return -self.outward * jnp.arctan2(self.axis[..., 2], jnp.hypot(self.axis[..., 0], self.axis[..., 1]))

    @functools.cached_property
    def steer(self) -> Array:
        return jnp.arctan2(-self.axis[..., 0], self.axis[..., 1])

    @property
    def toe(self) -> Array:
        return -self.outward * self.steer

    @functools.cached_property
    def kingpin(self) -> tuple[Array, Array] | None:
        """A point of the steering axis and its direction, upwards."""
        if self.screw is not None:
            screw = _driven_by(self.motion, self.equations, self.screw[1]).screw_axis(self.screw[0])
            base, way = screw.point, screw.direction
        elif self.names.steering_axis is not None:
            base, way = self.motion[self.names.steering_axis[0]], _line(self.motion, self.names.steering_axis)
        else:
            return None
        return base, jnp.where(way[..., 2:] < 0, -1.0, 1.0) * way

    @property
    def caster(self) -> Array | None:
        return None if self.kingpin is None else jnp.arctan2(-self.kingpin[1][..., 0], self.kingpin[1][..., 2])

    @property
    def kingpin_inclination(self) -> Array | None:
        if self.kingpin is None:
            return None
        return jnp.arctan2(-self.outward * self.kingpin[1][..., 1], self.kingpin[1][..., 2])

    @functools.cached_property
    def offset(self) -> tuple[Array, Array] | None:
        """From the contact centre to where the steering axis meets the road, along the wheel's trace and across."""
        if self.kingpin is None:
            return None
        (base, way), axis = self.kingpin, self.axis
        off = base + ratio((self.contact - base)[..., 2], way[..., 2])[..., None] * way - self.contact
        trace = jnp.stack([axis[..., 1], -axis[..., 0]], axis=-1) / jnp.hypot(axis[..., 0], axis[..., 1])[..., None]
        along = off[..., 0] * trace[..., 0] + off[..., 1] * trace[..., 1]
        return along, off[..., 1] * trace[..., 0] - off[..., 0] * trace[..., 1]

    @property
    def caster_trail(self) -> Array | None:
        return None if self.offset is None else self.offset[0]

    @property
    def scrub_radius(self) -> Array | None:
        return None if self.offset is None else -self.outward * self.offset[1]

    @property
    def wheel_travel(self) -> Array:
        return (self.centre - self.drawn_centre)[..., 2]

    @property
    def half_track_change(self) -> Array:
        start = self.touch(self.drawn_centre, _line(self.drawn, self.names.spin_axis))
        return self.outward * (self.contact - start)[..., 1]

    @property
    def wheelbase_change(self) -> Array:
        moved = (self.centre - self.drawn_centre)[..., 0]
        return moved if self.axle == "front" else -moved

    @property
    def spring_length(self) -> Array | None:
        spring = self.names.spring
        if spring is None:
            return None
        return self.motion[spring] if isinstance(spring, str) else _length(_line(self.motion, spring))

    @property
    def motion_ratio(self) -> Array | None:
        spring = self.names.spring
        if spring is None:
            return None
        if isinstance(spring, str):
            rate = self.rising.velocity(spring)
        else:
            rate = jax.jvp(_length, (_line(self.motion, spring),), (_line(self.rising, spring, rate=True),))[1]
        return ratio(-rate, self.lift[..., 2])

    @property
    def roll_centre_height(self) -> Array:
        turning = _line(self.rising, self.names.spin_axis, rate=True)
        path = jax.jvp(self.touch, (self.centre, self.line), (self.lift, turning))[1]
        return self.contact[..., 1] * ratio(path[..., 1], path[..., 2])


# -- names ----------------------------------------------------------------------------------------------------------


def _parts(line: Line) -> Iterator[str]:
    yield from (line,) if isinstance(line, str) else line


def _has(motion: Motion, line: Line) -> bool:
    return all(name in motion.names for name in _parts(line))


def _resolved(motion: Motion, given: Names) -> Names:
    """The names given for the parts, or the usual ones where the mechanism has them."""
    usual = next((n for n in _USUAL if _has(motion, n.wheel_centre) and _has(motion, n.spin_axis)), None)
    found: list[Any] = []
    for role, name in zip(Names._fields, given, strict=True):
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
    return Names(*found)


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
