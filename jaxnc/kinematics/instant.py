"""Motion at an instant: instant centres, screw axes and what they run along, inflection circles, curvature of paths.

A body is seen from the ground or from another body. All is a function of positions, velocities and accelerations; what
lies at infinity, or is not defined because nothing moves, is said by flags, and every number is finite.
"""

import itertools
from collections.abc import Mapping
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.compiling import in_one_program, on_device
from jaxnc.errors import InputError, nearest
from jaxnc.system.on_lanes import on_host
from jaxnc.system.topology import BodyIndex, Topology
from jaxnc.types import AnyArray, Array, Numbers, PyTree

if TYPE_CHECKING:
    from jaxnc.kinematics.motion import Motion

GROUND = "ground"
"""What is no body, and no body may be called."""


@public
class InstantMotion(NamedTuple):
    """The motion of a planar body at an instant, over the ground or over another body.

    A point X of the body at ρ = X - `centre` moves with velocity `rate` · Jρ (J: a quarter turn anticlockwise), and its
    path's centre of curvature is X - ρ ρ²/(ρ² - ρ·D), with D = `inflection` (Euler-Savary): ρ² = ρ·D is the inflection
    circle. The points without tangential acceleration lie on ρ² = ρ·JD `rate`²/`angular_acceleration`.

    Attributes:
        centre: instant centre of rotation, ``(..., 2)``, lengths; the body's reference point where not `finite`.
        direction: unit vector to where the centre lies, across the velocity of the reference point, ``(..., 2)``; the
            direction of a centre at infinity (either sign of it is the same). Zero where that point stands still.
        rate: angular velocity, rad/s, ``(...,)``; zero where not `finite`.
        finite: whether there is a centre in the finite, ``(...,)`` of booleans: whether it turns.
        moving: whether it moves at all, ``(...,)``; a centre that is neither finite nor moving is not defined.
        angular_acceleration: rad/s², ``(...,)``; None if the motion carries no accelerations, as all that follows.
        pole_velocity: velocity of the centre along the centrodes, ``(..., 2)``: along their common tangent.
        inflection: diameter of the inflection circle, from `centre` to the inflection pole, ``(..., 2)``, lengths.
        acceleration_pole: the point without acceleration, ``(..., 2)``; the reference point where not `accelerating`.
        accelerating: whether there is one in the finite, ``(...,)``.
    """

    centre: Array
    direction: Array
    rate: Array
    finite: Array
    moving: Array
    angular_acceleration: Array | None = None
    pole_velocity: AnyArray = None
    inflection: Array | None = None
    acceleration_pole: Array | None = None
    accelerating: AnyArray = None


@public
class PathCurvature(NamedTuple):
    """How a path bends, in the plane or in space.

    Attributes:
        curvature: 1/length, ``(...,)``; in the plane positive where the path bends to the left of its direction.
        centre: centre of curvature, ``(..., dim)``; the point itself where not `bent`.
        tangent: unit vector along the velocity, ``(..., dim)``; zero where not `moving`.
        bent: whether the centre is in the finite, ``(...,)`` of booleans: not at an inflection or on a straight line.
        moving: whether the point moves, ``(...,)``; where it rests (at a cusp) a curvature is not defined, and is zero.
    """

    curvature: Array
    centre: Array
    tangent: Array
    bent: Array
    moving: Array


@public
class Centrodes(NamedTuple):
    """The curves that the instant centre runs along: the moving one rolls on the fixed one.

    Attributes:
        fixed: on the ground or on the other body, as it lies in one pose, ``(T, 2)``.
        moving: on the body, as it lies in that pose, ``(T, 2)``; there the two touch.
        finite: whether the centre is in the finite, ``(T,)``; where not, the places are those of a reference point.
    """

    fixed: Array
    moving: Array
    finite: Array


@public
class ScrewAxis(NamedTuple):
    """A body's velocity as a rotation about a line and a translation along it.

    Attributes:
        point: the point of the axis closest to the body's reference point, ``(..., 3)``; the reference point itself
            where the body does not rotate.
        direction: unit vector of the axis, along the angular velocity, ``(..., 3)``; along the velocity where the body
            does not rotate, zero where it stands still.
        rate: rotation about the axis, rad/s, ``(...,)``.
        advance: velocity along the axis, length/s, ``(...,)``.
        pitch: ``advance / rate``, a length per radian, ``(...,)``; infinite for a pure translation, 0 at rest.
    """

    point: Array
    direction: Array
    rate: Array
    advance: Array
    pitch: Array


@public
class Axodes(NamedTuple):
    """The ruled surfaces that the instantaneous screw axis makes: the moving one rolls on the fixed one, and slides.

    Attributes:
        fixed: the axes on the ground or on the other body, as it lies in one pose, each ``(T, ...)``.
        moving: the axes on the body, as it lies in that pose; there the two touch along a line.
    """

    fixed: ScrewAxis
    moving: ScrewAxis


class BodyState(NamedTuple):
    """A body's reference point and its turning: positions and rates, and how large a rate is none."""

    place: AnyArray  # (..., dim)
    velocity: AnyArray  # (..., dim)
    spin: AnyArray  # angular velocity, (...,), in space (..., 3)
    acceleration: AnyArray  # (..., dim), or None
    turning: AnyArray  # angular acceleration, as `spin`, or None
    speed: AnyArray  # sum of the speeds that the velocity is a difference of, (...,)
    pull: AnyArray  # the same of accelerations, (...,)
    size: AnyArray  # of the mechanism, a length, by which angles are measured


def _library_of(*given: object) -> ModuleType:
    return np if all(isinstance(x, np.ndarray | np.generic) for x in given if x is not None) else jnp


def _vector_norm(x: Numbers) -> AnyArray:
    """Length of vectors, with a finite derivative at zero."""
    numeric, square = _library_of(x), (x * x).sum(axis=-1)
    return numeric.where(square > 0, numeric.sqrt(numeric.where(square > 0, square, 1.0)), 0.0)


def _safe_ratio(a: Numbers, b: Numbers, sound: Numbers) -> AnyArray:
    """``a / b``, zero where not `sound`."""
    numeric = _library_of(a, b)
    return numeric.where(sound, a / numeric.where(sound, b, 1.0), 0.0)


def quarter(x: Numbers) -> AnyArray:
    """Vectors of the plane ``(..., 2)`` turned by a quarter, anticlockwise."""
    return _library_of(x).stack([-x[..., 1], x[..., 0]], axis=-1)


def cross_spin(spin: Numbers, arm: Numbers) -> Numbers:
    """Angular velocity × arm, of the plane or of space."""
    return spin[..., None] * quarter(arm) if arm.shape[-1] == 2 else _library_of(spin, arm).cross(spin, arm)


def _rounding_share(x: Numbers) -> float:
    """Which share of rates is rounding."""
    return float(np.finfo(x.dtype).eps) ** (2 / 3)  # a relative rate below this power of the rounding unit is none


@in_one_program
def instant_of(state: BodyState) -> InstantMotion:
    """The motion of a planar body at an instant, from positions and rates."""
    p, velocity, spin, acceleration, turning, speed, pull, size = state
    numeric, tiny = _library_of(p, velocity, spin), _rounding_share(velocity)
    run, whirl = _vector_norm(velocity), abs(spin) * size
    finite = whirl > tiny * speed
    moving = finite | (run > tiny * speed)
    spin = numeric.where(finite, spin, 0.0)
    across = quarter(velocity)
    running = run > tiny * speed
    sense = numeric.where(spin < 0, -1.0, 1.0)
    direction = sense[..., None] * _safe_ratio(across, run[..., None], running[..., None])
    arm = _safe_ratio(across, spin[..., None], finite[..., None])
    centre = p + arm
    if acceleration is None:
        return InstantMotion(centre, direction, spin, finite, moving)
    at_centre = acceleration + turning[..., None] * quarter(arm) - (spin * spin)[..., None] * arm
    diameter = _safe_ratio(at_centre, (spin * spin)[..., None], finite[..., None])
    pole_velocity = _safe_ratio(quarter(at_centre), spin[..., None], finite[..., None])
    accelerating = (spin * spin + abs(turning)) * size > tiny * pull
    square = spin**4 + turning**2
    lift = (spin * spin)[..., None] * acceleration + turning[..., None] * quarter(acceleration)
    pole = p + _safe_ratio(lift, square[..., None], (accelerating & (square > 0))[..., None])
    return InstantMotion(
        centre, direction, spin, finite, moving, turning, pole_velocity, diameter, pole, accelerating & (square > 0)
    )


@in_one_program
def without_noise(state: BodyState) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Place, velocity and angular velocity of a body in space, rates set to zero where they are only rounding."""
    numeric, tiny = _library_of(state.velocity, state.spin), _rounding_share(state.velocity)
    turns = (_vector_norm(state.spin) * state.size > tiny * state.speed)[..., None]
    moves = turns | (_vector_norm(state.velocity) > tiny * state.speed)[..., None]
    return state.place, numeric.where(moves, state.velocity, 0.0), numeric.where(turns, state.spin, 0.0)


@in_one_program
def screw_axis(place: Numbers, velocity: Numbers, spin: Numbers) -> ScrewAxis:
    """Find the screw of a rigid velocity field: of a point of the body, its velocity and spin, all ``(..., 3)``."""
    numeric = _library_of(place, velocity, spin)
    square, speed2 = (spin * spin).sum(axis=-1), (velocity * velocity).sum(axis=-1)
    turning, moving = square > 0, speed2 > 0
    rate, speed = _vector_norm(spin), _vector_norm(velocity)
    along, size = numeric.where(turning[..., None], spin, velocity), numeric.where(turning, rate, speed)
    direction = along * _safe_ratio(numeric.ones_like(rate), size, size != 0)[..., None]
    advance = (velocity * direction).sum(axis=-1)
    offset = numeric.cross(spin, velocity) * _safe_ratio(numeric.ones_like(square), square, turning)[..., None]
    pitch = numeric.where(turning, _safe_ratio(advance, rate, turning), numeric.where(moving, np.inf, 0.0))
    return ScrewAxis(place + offset, direction, rate, advance, pitch)


@in_one_program
def curvature_of(state: BodyState) -> PathCurvature:
    """How the path of a point bends, from its position, velocity and acceleration."""
    p, velocity, _, acceleration, _, speed, pull, size = state
    numeric, tiny = _library_of(p, velocity, acceleration), _rounding_share(velocity)
    run = _vector_norm(velocity)
    moving = run > tiny * speed
    tangent = _safe_ratio(velocity, run[..., None], moving[..., None])
    across = acceleration - (acceleration * tangent).sum(axis=-1)[..., None] * tangent
    bend = _safe_ratio(across, (run * run)[..., None], moving[..., None])
    size_of = _vector_norm(bend)
    # What is left of an acceleration that has no part across the path is rounding.
    bent = moving & (size_of * run * run > tiny * pull) & (size_of * size > tiny)
    centre = p + _safe_ratio(bend, (size_of * size_of)[..., None], bent[..., None])
    curvature = numeric.where(bent, size_of, 0.0)
    if p.shape[-1] == 2:
        curvature = numeric.where((quarter(tangent) * bend).sum(axis=-1) < 0, -curvature, curvature)
    return PathCurvature(curvature, centre, tangent, bent, moving)


@in_one_program
def seen_from(state: BodyState, other: BodyState) -> BodyState:
    """A body's state as it is seen from another body, in the axes of the ground."""
    arm, spin = state.place - other.place, other.spin
    carried = cross_spin(spin, arm)
    velocity = state.velocity - other.velocity - carried
    speed = state.speed + other.speed + _vector_norm(carried)
    relative = state.spin - spin
    if state.acceleration is None or other.acceleration is None:
        return BodyState(state.place, velocity, relative, None, None, speed, None, state.size)
    led = other.acceleration + cross_spin(other.turning, arm) + cross_spin(spin, carried)
    coriolis = 2 * cross_spin(spin, velocity)
    turning = state.turning - other.turning
    if arm.shape[-1] == 3:
        turning = turning - cross_spin(spin, state.spin)
    pull = state.pull + other.pull + _vector_norm(led) + _vector_norm(coriolis)
    return BodyState(
        state.place, velocity, relative, state.acceleration - led - coriolis, turning, speed, pull, state.size
    )


# -- of a motion ------------------------------------------------------------------------------------------------------


def body_of(top: Topology, body: str) -> BodyIndex:
    """A body by its name."""
    names = [b.name for b in top.bodies]
    if body not in names:
        raise InputError(f"{top.name!r} has no body {body!r}; {nearest(body, names)}")
    return top.bodies[names.index(body)]


def state_of(motion: "Motion", body: str | None = None, point: str | None = None) -> BodyState:
    """Position and rates of a body's reference point, its first one, and how it turns.

    If no body is named it is that of a point by itself; a point may stand for the reference point.

    Returns:
        The state, seen from the ground: NumPy's of a motion that the host has found, otherwise JAX's.
    """
    top = motion.system.topology
    found = None if body is None else body_of(top, body)
    name = point or top.points[found.points[0] if found else 0]
    second = len(motion.rates) > 1
    given: list[AnyArray] = [motion[name], motion.velocity(name), motion.acceleration(name) if second else None]
    turns = found is not None and (top.dim == 3 or bool(found.segments))  # or keeps the ground's orientation
    if turns and body:
        given += [motion.angular_velocity(body), motion.angular_acceleration(body) if second else None]
    drawn: AnyArray = motion.system.parameters.points
    # Of a large batch, whose poses are JAX's arrays, nothing is compiled either, unless it is traced.
    if on_host(np.zeros(()), given, drawn):
        given, drawn = [None if x is None else np.asarray(x) for x in given], np.asarray(drawn)
    rates: list[AnyArray] = [rate[..., : len(top.points) * top.dim] for rate in motion.rates[: 2 if second else 1]]
    rates = [np.asarray(rate) if on_host(np.zeros(()), rate) else rate for rate in rates]
    return _with_noise(drawn, rates, *given)


@in_one_program
def _with_noise(
    drawn: Numbers,
    rates: list[AnyArray],
    place: Numbers,
    velocity: Numbers,
    acceleration: Numbers | None,
    spin: Numbers | None = None,
    turning: Numbers | None = None,
) -> BodyState:
    """Complete the state of a body by the size of the drawing, and by the rates that others are compared with."""
    dim, second = velocity.shape[-1], acceleration is not None
    if spin is None:
        spin = 0.0 * (velocity if dim == 3 else velocity[..., 0])
        turning = spin if second else None
    size = _vector_norm(drawn.max(axis=-2) - drawn.min(axis=-2))
    size = _library_of(size).where(size > 0, size, 1.0)
    if size.ndim:  # of several designs, each with its own poses
        size = size.reshape(*size.shape, *[1] * (velocity.ndim - 1 - size.ndim))
    # The largest rate of any point: rounding in the others is a share of it.
    fastest = [_vector_norm(rate.reshape(*rate.shape[:-1], rate.shape[-1] // dim, dim)).max(axis=-1) for rate in rates]
    whirl = abs(spin) if dim == 2 else _vector_norm(spin)
    speed, pull = fastest[0] + whirl * size, None
    if turning is not None:
        rise: AnyArray = abs(turning) if dim == 2 else _vector_norm(turning)
        pull = fastest[1] + (whirl * whirl + rise) * size
    return BodyState(place, velocity, spin, acceleration, turning, speed, pull, size)


def as_jax(found: PyTree) -> PyTree:
    """Turn NumPy's arrays in a pytree into JAX's; nothing is compiled for them."""
    return jax.tree.map(lambda x: on_device(x) if isinstance(x, np.ndarray | np.generic) else x, found)


def _require_plane(motion: "Motion", what: str, instead: str) -> None:
    if motion.system.topology.dim != 2:
        raise InputError(f"{what} is for planar mechanisms; in space see {instead}")


def relative_state(motion: "Motion", body: str, relative_to: str) -> BodyState:
    """`state_of` a body, or of the ground, as it is seen from the ground or another body."""
    names = {body, relative_to} - {GROUND} or {body}
    return _relate({name: state_of(motion, name) for name in names}, body, relative_to)


def _relate(states: Mapping[str, BodyState], body: str, relative_to: str) -> BodyState:
    """Relate the states of two bodies, one of which may be the ground, that they have as seen from the ground."""
    if relative_to == GROUND:
        return states[body]
    other = states[relative_to]
    ground = jax.tree.map(lambda x: 0.0 * x, other)._replace(place=other.place, size=other.size)
    return seen_from(ground if body == GROUND else states[body], other)


@public
def instant_motion(motion: "Motion", body: str, relative_to: str = GROUND) -> InstantMotion:
    """Instant centre, inflection circle and pole of accelerations of a planar body.

    Args:
        motion: a motion with rates; with accelerations too for what follows from those.
        body: name of the body.
        relative_to: name of the body that it is seen from, or ``"ground"``.

    Returns:
        See `InstantMotion`, with the leading axes of the motion. Where a pose was not found, nothing moves.

    Raises:
        InputError: unknown body, a spatial mechanism, or a motion without rates.

    Source:
        Hartenberg & Denavit, Kinematic Synthesis of Linkages, ch. 7; Bottema & Roth, Theoretical Kinematics, ch. VIII.
    """
    _require_plane(motion, "instant_motion()", "motion.screw_axis()")
    return as_jax(instant_of(relative_state(motion, body, relative_to)))


@public
def instant_centres(motion: "Motion") -> dict[tuple[str, str], InstantMotion]:
    """The instant centres of every pair of bodies, and of every body and the ground, in either order.

    Args:
        motion: a motion with rates, of a planar mechanism.

    Returns:
        `instant_motion` of the first over the second, by the two names, one of which may be ``"ground"``. Centres of
        three bodies lie on one line (Kennedy, Aronhold), pairs at rest relative to each other have none.

    Raises:
        InputError: a spatial mechanism, or a motion without rates.
    """
    _require_plane(motion, "instant_centres()", "motion.screw_axis()")
    states = {b.name: state_of(motion, b.name) for b in motion.system.topology.bodies}
    pairs = itertools.permutations((GROUND, *states), 2)
    return as_jax({pair: instant_of(_relate(states, *pair)) for pair in pairs})


@public
def instant_centre(motion: "Motion", body: str, relative_to: str = GROUND) -> Array:
    """Instant centre of rotation of a body, relative to the ground or to another body.

    Args:
        motion: a motion with rates.
        body: name of the body, or ``"ground"``.
        relative_to: name of the other body, or ``"ground"``.

    Returns:
        Its place, ``(..., 2)``, lengths; infinite where the bodies do not turn relative to each other. See
        `jaxnc.kinematics.instant_motion` for its direction there, and all else of that instant.

    Raises:
        InputError: unknown body, a spatial mechanism, or a motion without rates.
    """
    _require_plane(motion, "instant_centre()", "motion.screw_axis()")
    found = instant_of(relative_state(motion, body, relative_to))
    return as_jax(_library_of(*found[:2]).where(found.finite[..., None], found.centre, np.inf))


def _check_place(motion: "Motion", name: str, what: str) -> None:
    if motion[name].ndim == motion.status.ndim:
        raise InputError(f"{what} is of points and markers, and {name!r} is a single number")


@public
def path_curvature(motion: "Motion", point: str, relative_to: str = GROUND) -> PathCurvature:
    """Curvature of a point's path and its centre.

    Args:
        motion: a motion with velocities and accelerations.
        point: name of a point or marker.
        relative_to: the body in which the path is drawn, or ``"ground"``.

    Returns:
        See `PathCurvature`, with the leading axes of the motion.

    Raises:
        InputError: unknown name, or a motion without velocities and accelerations.
    """
    _check_place(motion, point, "path_curvature()")
    motion.acceleration(point)  # says what is missing
    state = state_of(motion, point=point)
    if relative_to != GROUND:
        state = seen_from(state, state_of(motion, relative_to))
    return as_jax(curvature_of(state))


def _lay_in_pose(motion: "Motion", body: str, pose: int, places: AnyArray, *directions: AnyArray) -> list[AnyArray]:
    """Places and directions ``(T, dim)`` that ride on a body, each in its own pose, as they lie in one pose."""
    motion.pose(pose)  # says which there are
    top = motion.system.topology
    base = body_of(top, body).base
    given = [motion.position(body), places, *directions]
    turns = [motion.orientation(body)] if top.dim == 3 else [motion[top.points[k]] for k in base or ()]
    if on_host(np.zeros(()), [*given, *turns]):
        given, turns = ([np.asarray(x) for x in some] for some in (given, turns))
    own, *rest = given
    if not turns:  # it keeps the ground's orientation
        return [own[pose] + (rest[0] - own), *rest[1:]]
    turn = turns[-1]
    if top.dim == 2:
        turn = turns[1] - turns[0]
        length = _vector_norm(turn)[..., None]
        along = _safe_ratio(turn, length, length > 0)
        turn = _library_of(along).stack([along, quarter(along)], axis=-1)
    back = turn[pose] @ turn.swapaxes(-1, -2)
    arm, *turned = ((back @ x[..., None])[..., 0] for x in (rest[0] - own, *rest[1:]))
    return [own[pose] + arm, *turned]


@public
def centrodes(motion: "Motion", body: str, relative_to: str = GROUND, pose: int = 0) -> Centrodes:
    """Fixed and moving centrode of a body over a motion.

    Args:
        motion: a sequence of poses with rates, of a planar mechanism.
        body: name of the body.
        relative_to: name of the body that it is seen from, or ``"ground"``.
        pose: the pose in which the curves are shown; there they touch.

    Raises:
        InputError: unknown body, a spatial mechanism, a motion without rates, or not one sequence of poses.

    Source:
        Hartenberg & Denavit, Kinematic Synthesis of Linkages, ch. 7.
    """
    _require_plane(motion, "centrodes()", "axodes()")
    sequence(motion, "centrodes()")
    found = instant_of(relative_state(motion, body, relative_to))
    fixed, moving = (
        found.centre if name == GROUND else _lay_in_pose(motion, name, pose, found.centre)[0]
        for name in (relative_to, body)
    )
    return as_jax(Centrodes(fixed, moving, found.finite))


@public
def axodes(motion: "Motion", body: str, relative_to: str = "ground", pose: int = 0) -> Axodes:
    """Fixed and moving axode of a body over a motion in space.

    Args:
        motion: a sequence of poses with rates, of a spatial mechanism.
        body: name of a body that knows its orientation.
        relative_to: name of the body that it is seen from, or ``"ground"``.
        pose: the pose in which the surfaces are shown; there they touch.

    Returns:
        See `Axodes`; where the body does not turn, the direction is that of its velocity, and its rate is zero.

    Raises:
        InputError: unknown body, one without an orientation, a planar mechanism, a motion without rates, or not one
            sequence of poses.

    Source:
        Bottema & Roth, Theoretical Kinematics, ch. VI.
    """
    sequence(motion, "axodes()")
    found = motion.screw_axis(body, relative_to)
    fixed, moving = (
        (found.point, found.direction)
        if name == GROUND
        else _lay_in_pose(motion, name, pose, found.point, found.direction)
        for name in (relative_to, body)
    )
    axodes = (found._replace(point=point, direction=direction) for point, direction in (fixed, moving))
    return as_jax(Axodes(*axodes))


def sequence(motion: "Motion", what: str) -> None:
    """Raise unless a motion is one sequence of poses."""
    if motion.status.ndim != 1 or motion.system.parameters.points.ndim != 2:
        shape = tuple(motion.status.shape)
        raise InputError(f"{what} wants one sequence of poses, (T,), as nc.sweep() gives it; these are {shape}")


@public
def transmission_angle(motion: "Motion", start: str, joint: str, end: str) -> Array:
    """Transmission angle at a joint: the acute angle between the bars that meet there.

    Args:
        motion: the motion.
        start: the far point of the coupler.
        joint: the joint of coupler and driven bar.
        end: the far point of the driven bar.

    Returns:
        Angle in 0 … π/2, radians, ``(...,)``.

    Raises:
        InputError: a name that is not of a point or marker.
    """
    for name in (start, joint, end):
        _check_place(motion, name, "transmission_angle()")
    places: list[AnyArray] = [motion[start], motion[joint], motion[end]]
    if on_host(motion.poses, places):
        places = [np.asarray(x) for x in places]
    a, b, c = places
    d, w = a - b, c - b
    cosine = abs((d * w).sum(axis=-1))
    numeric, flat = _library_of(d), d.shape[-1] == 2
    sine = abs(d[..., 0] * w[..., 1] - d[..., 1] * w[..., 0]) if flat else _vector_norm(numeric.cross(d, w))
    return as_jax(motion.still_where_failed(numeric.arctan2(sine, cosine)))
