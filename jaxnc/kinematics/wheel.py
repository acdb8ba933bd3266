"""A wheel along a motion: its numbers, each computed when it is asked for."""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.compiling import jit
from jaxnc.constraints.elementary import ratio
from jaxnc.kinematics.hardpoints import Line, Names
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.rates import rates
from jaxnc.kinematics.screw import ScrewAxis, screw_axis
from jaxnc.kinematics.wheel_parts import What
from jaxnc.solvers import host
from jaxnc.solvers.assembly import derive, to_host
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.equations import Equations
from jaxnc.system.frames import along, marker_place, spins
from jaxnc.system.on_lanes import columns_on_lanes, needed_inputs, on_host
from jaxnc.system.topology import Topology
from jaxnc.types import Array, Float


class _Pose(NamedTuple):
    """One pose, with what is read off it; as a `Motion`, but of equations that may be traced."""

    topology: Topology  # the mechanism's
    markers: Array  # coefficients of its markers
    q: Array  # all coordinates, (N,)
    rates: tuple[Array, ...] = ()  # their time derivatives

    def __getitem__(self, name: str) -> Array:
        return self._pick(name, ())

    def velocity(self, name: str) -> Array:
        return self._pick(name, self.rates)

    def _pick(self, name: str, rates: tuple[Array, ...]) -> Array:
        top, x = self.topology, rates[-1] if rates else self.q
        if (*top.points, *top.vectors).count(name):
            first = (*top.points, *top.vectors).index(name) * top.dim
            return x[first : first + top.dim]
        if name in top.position:
            return x[top.position[name]]
        name, _, axis = name.partition(".")
        number = [m.name for m in top.markers].index(name)
        place = along(lambda q: marker_place(top, number, q, self.markers), self.q, rates)
        return place["xyz".index(axis)] if axis else place

    def angular_velocity(self, body: str) -> Array:
        found = next(b for b in self.topology.bodies if b.name == body)
        return spins(self.topology, found.segments, self.q, self.rates)

    def screw_axis(self, body: str) -> ScrewAxis:
        base = self.topology.points[next(b for b in self.topology.bodies if b.name == body).points[0]]
        return screw_axis(self[base], self.velocity(base), self.angular_velocity(body))


@dataclasses.dataclass(frozen=True)
class _Wheel:
    """The numbers of a `jaxnc.kinematics.Suspension`, each computed when it is asked for."""

    what: What  # what is asked
    motion: _Pose  # the pose
    drawn: _Pose  # the mechanism as drawn
    # The pose with the velocities that it has when one input moves at unit rate and the others stand.
    moved: Callable[[str], _Pose]
    radius: float | Array | None  # of the tyre, if it is not read off the drawing

    @property
    def names(self) -> Names:
        return self.what.names

    @property
    def outward(self) -> float:
        return 1.0 if self.what.side == "left" else -1.0

    @functools.cached_property
    def drawn_centre(self) -> Array:
        return self.drawn[self.names.wheel_centre]

    @functools.cached_property
    def rising(self) -> _Pose:
        return self.moved(self.what.bump)

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
        if self.what.screw is not None:
            carrier, steer = self.what.screw
            screw = self.moved(steer).screw_axis(carrier)
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

    def offset(self, place: Array) -> tuple[Array, Array] | None:
        """From a place to where the steering axis is level with it, along the wheel's trace and across."""
        if self.kingpin is None:
            return None
        (base, way), axis = self.kingpin, self.axis
        off = base + ratio((place - base)[..., 2], way[..., 2])[..., None] * way - place
        trace = jnp.stack([axis[..., 1], -axis[..., 0]], axis=-1) / jnp.hypot(axis[..., 0], axis[..., 1])[..., None]
        along = off[..., 0] * trace[..., 0] + off[..., 1] * trace[..., 1]
        return along, off[..., 1] * trace[..., 0] - off[..., 0] * trace[..., 1]

    @functools.cached_property
    def at_road(self) -> tuple[Array, Array] | None:
        return self.offset(self.contact)

    @functools.cached_property
    def at_centre(self) -> tuple[Array, Array] | None:
        return self.offset(self.centre)

    @property
    def caster_trail(self) -> Array | None:
        return None if self.at_road is None else self.at_road[0]

    @property
    def scrub_radius(self) -> Array | None:
        return None if self.at_road is None else -self.outward * self.at_road[1]

    @property
    def caster_offset(self) -> Array | None:
        return None if self.at_centre is None else self.at_centre[0]

    @property
    def kingpin_offset(self) -> Array | None:
        return None if self.at_centre is None else -self.outward * self.at_centre[1]

    @property
    def wheel_travel(self) -> Array:
        return (self.centre - self.drawn_centre)[..., 2]

    @property
    def half_track_change(self) -> Array:
        start = self.touch(self.drawn_centre, _line(self.drawn, self.names.spin_axis))
        return self.outward * (self.contact - start)[..., 1]

    @property
    def track(self) -> Array:
        return 2.0 * self.outward * self.contact[..., 1]

    @property
    def forward(self) -> float:
        """Along x, away from the other axle."""
        return 1.0 if self.what.axle == "front" else -1.0

    @property
    def wheelbase_change(self) -> Array:
        return self.forward * (self.centre - self.drawn_centre)[..., 0]

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

    @functools.cached_property
    def path(self) -> Array:
        """Velocity of the contact centre as the wheel rises."""
        return jax.jvp(self.touch, (self.centre, self.line), (self.lift, self.turning))[1]

    @functools.cached_property
    def turning(self) -> Array:
        return _line(self.rising, self.names.spin_axis, rate=True)

    @property
    def roll_centre_height(self) -> Array:
        return self.contact[..., 1] * ratio(self.path[..., 1], self.path[..., 2])

    @functools.cached_property
    def rolling(self) -> Array:
        """How fast the wheel's disc turns about x as the wheel rises."""
        tilt = jax.jvp(lambda d: jnp.arctan2(d[..., 2], jnp.hypot(d[..., 0], d[..., 1])), (self.line,), (self.turning,))
        way = jnp.where(self.line[..., 1] < 0, -1.0, 1.0)
        return way * tilt[1] * jnp.cos(self.steer)

    @property
    def swing_arm_length(self) -> Array:
        return self.outward * _far(self.path[..., 2], self.rolling)

    @property
    def instant_centre_height(self) -> Array:
        return _far(self.path[..., 1], self.rolling)

    @property
    def drive_support_angle(self) -> Array:
        return self.forward * jnp.arctan2(self.lift[..., 0], self.lift[..., 2])

    @functools.cached_property
    def locked(self) -> tuple[Array, Array] | None:
        """Velocity of the contact centre with the wheel locked to its carrier, and the carrier's turning about y."""
        if self.what.carrier is None:
            return None
        spin = self.rising.angular_velocity(self.what.carrier)
        return self.lift + jnp.cross(spin, self.contact - self.centre), spin[..., 1]

    @property
    def brake_support_angle(self) -> Array | None:
        if self.locked is None:
            return None
        return self.forward * jnp.arctan2(self.locked[0][..., 0], self.locked[0][..., 2])

    @property
    def side_swing_arm_length(self) -> Array | None:
        return None if self.locked is None else -self.forward * _far(self.locked[0][..., 2], self.locked[1])

    @property
    def side_instant_centre_height(self) -> Array | None:
        return None if self.locked is None else -_far(self.locked[0][..., 0], self.locked[1])


# -- one pose -----------------------------------------------------------------------------------------------------


_STEERED = ("caster", "kingpin_inclination", "scrub_radius", "caster_trail", "kingpin_offset", "caster_offset")
_SIDE = ("brake_support_angle", "side_swing_arm_length", "side_instant_centre_height")


def tells(what: What, name: str) -> bool:
    """Whether there is something to tell one of a wheel's numbers by."""
    if name in _STEERED:
        return what.screw is not None or what.names.steering_axis is not None
    if name in _SIDE:
        return what.carrier is not None
    return what.names.spring is not None or name not in ("spring_length", "motion_ratio")


def in_one_pose(
    top: Topology, what: What, names: tuple[str, ...], drawn: bool, state: Array, home: Array, markers: Array, r: Array
) -> Float[Array, " numbers"]:
    """Numbers of a wheel in one pose, a pure function; the contact centre, which has three, is the last.

    `state` is the pose, then its derivatives by each of ``what.inputs``, ``((1 + inputs) N,)``; `home` are the
    coordinates as drawn, ``(N,)``. If it is not read off the drawing, the tyre's radius is `r`.
    """
    q, *rates = jnp.split(state, 1 + len(what.inputs))
    moved = {name: _Pose(top, markers, q, (rate,)) for name, rate in zip(what.inputs, rates, strict=True)}
    wheel = _Wheel(what, _Pose(top, markers, q), _Pose(top, markers, home), moved.__getitem__, None if drawn else r)
    return jnp.concatenate([jnp.atleast_1d(getattr(wheel, name)) for name in names])


def within_pose(top: Topology, name: str, q: Array, markers: Array) -> Array:
    """A point, vector, marker or coordinate in one pose ``(N,)``, a pure function."""
    return _Pose(top, markers, q)[name]


# -- kinematics -----------------------------------------------------------------------------------------------------


def _length(v: Array) -> Array:
    return jnp.sqrt(jnp.sum(v * v, axis=-1))


def _far(velocity: Array, rate: Array) -> Array:
    """How far off a centre of rotation is; infinitely where nothing turns."""
    return jnp.where(rate == 0, jnp.inf, ratio(velocity, rate))


def _line(motion: _Pose, line: Line, rate: bool = False) -> Array:
    """A direction, or its time derivative."""
    read = motion.velocity if rate else motion.__getitem__
    if isinstance(line, str):
        return read(line)
    return read(line[1]) - read(line[0])


def wheel_numbers(
    motion: Motion, what: What, names: tuple[str, ...], radius: Any, by: str | None = None
) -> dict[str, Any]:
    """The numbers of a wheel ``(...,)``, places ``(..., 3)``, in all poses; None where there is nothing to tell it by.

    The names are those of a `jaxnc.kinematics.Suspension`. With an input in `by` the numbers' derivatives by it are
    told instead, the other inputs held. NumPy tells them, unless something is traced; then nothing is calculated that
    they do not need.
    """
    host = on_host(np.zeros(()), motion, radius)
    q: Any = np.asarray(motion.q) if host else motion.q
    wanted = tuple(name for name in names if tells(what, name))
    fixed = (motion.system.topology, what, wanted, radius is None)
    width, count = q.shape[-1], 1 + len(what.inputs)
    shapes = ((count * width,), (width,), motion.system.parameters.markers.shape, ())
    needs = np.zeros(sum(map(math.prod, shapes)), bool)
    needs[list(needed_inputs(in_one_pose, fixed, shapes))] = True
    rates = needs[width : count * width].any() or by is not None
    slopes = [tangents(motion, {name: 1.0})[0] if rates else 0.0 * q for name in what.inputs]
    state, change = [q, *slopes], []
    if by is not None:
        first, second = tangents(motion, {by: 1.0}, 2)
        change = [first, *(_mixed(motion, by, second, name) for name in what.inputs)]
    drawn: Any = derive(motion.system) if needs[count * width : -1].any() else None
    home, markers = (np.zeros(shapes[1]), np.zeros(shapes[2])) if drawn is None else (drawn.home, drawn.markers)
    given = (home, markers, np.asarray(np.nan, q.dtype) if radius is None else radius)
    columns = columns_on_lanes(in_one_pose, fixed, state, [change] if change else [], given)
    xp: Any = np if host else jnp
    out: dict[str, Any] = dict.fromkeys(names)
    for k, name in enumerate(wanted):
        out[name] = xp.stack(columns[k:], axis=-1) if name == "contact" else columns[k]
    return out


def _mixed(motion: Motion, by: str, second: Any, name: str) -> Any:
    """Second derivatives of all coordinates by two inputs, from those along the inputs and along their sum."""
    if name == by:
        return second
    return 0.5 * (tangents(motion, {by: 1.0, name: 1.0}, 2)[1] - second - tangents(motion, {name: 1.0}, 2)[1])


def tangents(motion: Motion, paces: Mapping[str, float], order: int = 1) -> Any:
    """Derivatives of all coordinates as inputs change at some paces, the others held; zero where a pose was not found.

    Returns:
        First to so many-th derivatives, ``(order, ..., N)``: NumPy's, unless something is traced.
    """
    view = plan(motion.system.topology, motion.driven, motion.held, motion.system.degrees_of_freedom)
    q, good = motion.q.reshape(-1, motion.q.shape[-1]), motion.converged.reshape(-1)
    pace = np.array([paces.get(name, 0.0) for name in (*motion.driven, *motion.held)], q.dtype)
    orders = (pace, *[np.zeros_like(pace)] * (order - 1))
    if not on_host(np.zeros(()), motion):
        return jnp.stack(_tangents(view, derive(motion.system), q, orders, good)).reshape(order, *motion.q.shape)
    flat, good = np.asarray(q), np.asarray(good)
    out = np.zeros((order, *flat.shape), flat.dtype)
    if good.any():
        inner = host.view_of(view, to_host(derive(motion.system)))
        lanes = [np.repeat(x[:, None], good.sum(), axis=1) for x in orders]
        with np.errstate(all="ignore"):
            out[:, good] = np.stack(host.pose_rates(inner, flat[good].T, lanes)).transpose(0, 2, 1)
    return out.reshape(order, *motion.q.shape)


@functools.partial(jit, static_argnums=0)
def _tangents(view: Plan, eq: Equations, q: Array, paces: tuple[Array, ...], ok: Array) -> list[Array]:
    return jax.vmap(lambda x, good: rates(view, eq, x, paces, good))(q, ok)
