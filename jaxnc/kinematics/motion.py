"""`Motion`: solved poses with their rates, what became of each, and ways to look at them; `Columns` of many poses."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.compiling import filter_jit, jit, on_device
from jaxnc.doors import door
from jaxnc.errors import AssemblyError, InputError, brief, nearest
from jaxnc.kinematics.host_solve import never_moves
from jaxnc.kinematics.inputs import NEVER_MOVES, dense_only, meeting_ends, outside
from jaxnc.kinematics.instant import ScrewAxis, as_jax, body_of, relative_state, screw_axis, without_noise
from jaxnc.kinematics.polynomial import circuits_hint
from jaxnc.notebooks import Drawn
from jaxnc.records import record, static
from jaxnc.solvers import dense
from jaxnc.solvers.assembly import derive
from jaxnc.solvers.host import HostView
from jaxnc.solvers.plan import Plan, plan
from jaxnc.status import Status
from jaxnc.system.equations import derived
from jaxnc.system.frames import angle_along, marker_along, marker_in_lanes, quaternions, spins, turns
from jaxnc.system.host import from_jax
from jaxnc.system.on_lanes import on_host
from jaxnc.system.precision import numbers
from jaxnc.system.system import System
from jaxnc.system.topology import BodyIndex, Topology
from jaxnc.types import AnyArray, Array, ArrayLike, Coordinates, Float

if TYPE_CHECKING:
    from pathlib import Path

    import pandas
    import xarray

    from jaxnc.system.equations import Equations
    from jaxnc.workshop import Assembly


@public
@record
class Columns:
    """Coordinates of many poses of one design or several, one by one as they are solved, put together on demand.

    Attributes:
        rest: a pose with the coordinates that do not change, ``(N,)``; with the first of the poses' axes, ``(..., N)``,
            where they are of several designs.
        lanes: those that were solved for, an array ``(...,)`` each.
        driven: those that were driven, ``(..., driven)``.
        places: which coordinates these are, first the lanes.
    """

    rest: Coordinates
    lanes: tuple[Array, ...]
    driven: Float[Array, "... driven"]
    places: tuple[int, ...] = static()

    def column(self, coordinate: int) -> Array:
        """A coordinate of all poses."""
        if coordinate not in self.places:
            return jnp.broadcast_to(self._rest()[..., coordinate], self.driven.shape[:-1])
        k = self.places.index(coordinate)
        return self.lanes[k] if k < len(self.lanes) else self.driven[..., k - len(self.lanes)]

    def _rest(self) -> Float[Array, "... N"]:
        """The pose that holds what does not change, to be broadcast to all poses."""
        lead, more = self.rest.shape[:-1], self.driven.ndim - self.rest.ndim
        return self.rest.reshape(*lead, *[1] * more, self.rest.shape[-1]) if lead else self.rest

    def whole(self) -> Float[Array, "... N"]:
        """All coordinates of all poses."""
        return _stack_all(self)

    def with_axes(self, shape: tuple[int, ...]) -> "Columns":
        """Give the poses other leading axes."""
        if shape == self.driven.shape[:-1]:
            return self
        lanes = tuple(x.reshape(shape) for x in self.lanes)
        return Columns(self.rest, lanes, self.driven.reshape(*shape, self.driven.shape[-1]), self.places)

    def __getitem__(self, index: object) -> "Columns":
        """Some of the poses: any index of the leading axes."""
        lanes, driven = jax.tree.map(lambda x: x[index], (self.lanes, self.driven))
        rest = self.rest
        if rest.ndim > 1:
            rest = jnp.broadcast_to(self._rest(), (*self.driven.shape[:-1], rest.shape[-1]))[index]
        return Columns(rest, lanes, driven, self.places)


def coordinates_of(top: Topology, name: str) -> slice | int | None:
    """Find where a point, a vector or a single coordinate stands among all coordinates; None of other names."""
    spread = (*top.points, *top.vectors)
    if name in spread:
        first = spread.index(name) * top.dim
        return slice(first, first + top.dim)
    return top.position.get(name)


@jit
def _stack_all(columns: Columns) -> Array:
    return jnp.stack([columns.column(c) for c in range(columns.rest.shape[-1])], axis=-1)


@public
@record
class Motion(Drawn):
    """Poses of a mechanism: one pose, a sweep, or any batch of them, as a pytree.

    ``motion["P"]`` is where a point or marker is ``(..., dim)``, ``motion["u"]`` a unit vector ``(..., 3)``,
    ``motion["phi"]`` an angle or distance ``(...,)``, ``motion["P.x"]`` a single coordinate.

    Attributes:
        system: the system that moved.
        driven: names of the inputs.
        held: names of held coordinates.
        poses: what `q` is made from: all coordinates, ``(..., N)``, or, of a large batch, one array for each.
        rates: time derivatives of q that were asked for: velocity, acceleration, jerk, each ``(..., N)``.
        asked: values asked for of the driven coordinates, ``(..., driven)``; see `inputs`.
        status: `jaxnc.Status` of each pose as an integer, ``(...,)``.
        residual: largest residual of each pose, a length, ``(...,)``; of the attempt, where a pose was not found;
            None of poses that were not solved for, such as a drawing.
        conditioning: estimate of each pose's reciprocal condition number, which has no derivative; zero at a singular
            position, ``(...,)``; None of poses that were not solved for their inputs, such as those of a simulation.
        time: time of each pose if the inputs were functions of time, ``(...,)``.
    """

    system: System
    driven: tuple[str, ...] = static()
    held: tuple[str, ...] = static()
    poses: Float[Array, "... N"] | Columns
    rates: tuple[Float[Array, "... N"], ...]
    asked: Float[Array, "... driven"]
    status: Array
    residual: Array | None
    conditioning: Array | None
    time: Array | None = None

    @property
    def q(self) -> Float[Array, "... N"]:
        """All coordinates. Where a pose was not found: the last pose on the branch, or the closest one."""
        return self.poses.whole() if isinstance(self.poses, Columns) else as_jax(self.poses)

    @property
    def _q(self) -> Any:
        """The poses as they were found, ``(..., N)``: NumPy's, if on the host."""
        found: Any = self.q if isinstance(self.poses, Columns) else self.poses
        return np.asarray(found) if on_host(found) else found

    @property
    def converged(self) -> Array:
        """Which poses are right, ``(...,)`` of booleans."""
        return as_jax(self.status == int(Status.CONVERGED))

    @property
    def inputs(self) -> dict[str, Array]:
        """The values asked for of every driven coordinate, also where the pose was not found."""
        return {name: as_jax(self.asked[..., k]) for k, name in enumerate(self.driven)}

    def pose(self, index: int | slice | tuple[int | slice, ...] | ArrayLike) -> "Motion":
        """Take a pose of a sweep, or a part of it: any index of the leading axes."""
        if isinstance(index, int) and not -(count := (*self.status.shape, 0)[0]) <= index < count:
            count = count if self.status.shape else "no axis of"
            raise InputError(f"pose({index}): this motion of {self.system.name!r} has {count} poses")
        arrays = (self.rates, self.asked, self.status, self.residual, self.conditioning, self.time)
        try:
            rates, asked, status, residual, conditioning, time = jax.tree.map(lambda x: x[index], arrays)
        except (IndexError, TypeError, ValueError, OverflowError):
            raise InputError(
                f"pose(index): the poses of {self.system.name!r} have the shape {self.status.shape}; an index is a "
                f"whole number, a slice, or whole numbers, one for each axis; got {brief(index)}"
            ) from None
        poses, system, lead = self.poses[index], self.system, self._designs
        if lead:  # poses of several designs, of each its own
            at = index[:lead] if isinstance(index, tuple) else index
            system = jax.tree.map(lambda x: x[at], system)
        return Motion(system, self.driven, self.held, poses, rates, asked, status, residual, conditioning, time)

    @property
    def names(self) -> tuple[str, ...]:
        """Names that `__getitem__` understands, besides single coordinates such as ``"P.x"``."""
        top = self.system.topology
        return (*top.points, *top.vectors, *(m.name for m in top.markers), *top.scalars)

    @property
    def _designs(self) -> int:
        """How many of the leading axes are those of designs, as ``jax.vmap`` over systems gives them."""
        return self.system.parameters.points.ndim - 2

    def _pick(self, order: int, name: str) -> Array:
        """A quantity's values (order 0) or time derivative."""
        top = self.system.topology
        if not isinstance(name, str):
            raise InputError(f"points and coordinates are named by strings; got {name!r}. Poses: motion.pose({name!r})")
        if self._designs and any(name.startswith(m.name) for m in top.markers):
            return jax.vmap(lambda motion: motion._pick(order, name))(self)
        if not order and isinstance(self.poses, Columns):
            found = self._columns(self.poses, name)
            if found is not None:
                return found
        if (at := coordinates_of(top, name)) is not None:
            return as_jax((self.rates[order - 1] if order else self._q)[..., at])
        point, _, axis = name.partition(".")
        markers = [m.name for m in top.markers]
        if point in markers and (not axis or axis in "xyz"[: top.dim]):
            with numbers(self.system.parameters.points):
                place = marker_along(derive(self.system), markers.index(point), self._q, self.rates[:order])
            place = self.still_where_failed(place)
            return as_jax(place if not axis else place[..., "xyz".index(axis)])
        raise InputError(f"{top.name!r} has no point, marker or coordinate {name!r}; {nearest(name, self.names)}")

    def still_where_failed(self, values: AnyArray) -> AnyArray:
        """Take the derivatives from numbers ``(..., …)`` that follow the design, in poses that were not found."""
        status = self.status
        if not isinstance(values, Tracer) or not (isinstance(status, Tracer) or np.any(np.asarray(status))):
            return values
        good = jnp.asarray(status == 0).reshape(*status.shape, *(1,) * (values.ndim - status.ndim))
        return jnp.where(good, values, jax.lax.stop_gradient(values))

    def _columns(self, poses: Columns, name: str) -> Array | None:
        """A point, vector, marker or coordinate of a large batch, without putting the others together."""
        top = self.system.topology
        markers = [m.name for m in top.markers]
        if name in markers:
            every = [poses.column(c) for c in range(poses.rest.shape[-1])]
            with numbers(self.system.parameters.points):
                return self.still_where_failed(marker_in_lanes(derive(self.system), markers.index(name), every))
        at = coordinates_of(top, name)
        if isinstance(at, slice):
            return jnp.stack([poses.column(c) for c in range(at.start, at.stop)], axis=-1)
        return None if at is None else poses.column(at)

    def __contains__(self, name: object) -> bool:
        """Tell whether there is a point, marker, vector or coordinate of this name."""
        known = isinstance(name, str) and coordinates_of(self.system.topology, name) is not None
        return known or name in self.names

    def __getitem__(self, name: str) -> Array:
        """Positions of a point or marker, directions of a vector, or values of a coordinate."""
        return self._pick(0, name)

    def _require(self, order: int, noun: str) -> None:
        if len(self.rates) < order:
            have = "no rates" if not self.rates else f"{len(self.rates)} time derivatives"
            extra = "pass rates={'" + (self.driven[0] if self.driven else "phi") + "': ...}"
            hint = extra if order < 3 else extra + " and jerk=True"
            raise InputError(f"this motion carries {have}, so it has no {noun}; {hint} when you make it")

    def _rate(self, order: int, noun: str, name: str) -> Array:
        self._require(order, noun)
        return self._pick(order, name)

    def velocity(self, name: str) -> Array:
        """Velocity of a point, vector or marker, ``(..., dim)``, or rate of a coordinate, ``(...,)``."""
        return self._rate(1, "velocity", name)

    def acceleration(self, name: str) -> Array:
        """Acceleration of a point or marker, or second rate of a coordinate."""
        return self._rate(2, "acceleration", name)

    def jerk(self, name: str) -> Array:
        """Jerk of a point or marker, or third rate of a coordinate (ask for it with ``jerk=True``)."""
        return self._rate(3, "jerk", name)

    # -- bodies -------------------------------------------------------------------------------------------------

    def _body(self, body: str) -> BodyIndex:
        """A body that knows its orientation."""
        top, found = self.system.topology, body_of(self.system.topology, body)
        if not found.segments:
            raise InputError(f"body {body!r} has one point and keeps the ground's orientation; it does not turn")
        if top.dim == 3 and len(found.segments) == 1:
            raise InputError(
                f"body {body!r} is a bar that does not know its rotation about its own line, so it has no orientation; "
                f"give it a point or vector across the line"
            )
        return found

    def position(self, body: str) -> Array:
        """Where a body's reference point is, its first one, ``(..., dim)``."""
        top = self.system.topology
        return self[top.points[body_of(top, body).points[0]]]

    def orientation(self, body: str) -> Array:
        """Orientation of a body.

        Args:
            body: its name; in space one that knows all its orientation.

        Returns:
            In the plane the angle of its first segment from the x axis, unwrapped along a sweep, radians, ``(...,)``.
            In space its rotation from the drawing as a matrix ``(..., 3, 3)``: a direction fixed in the body that is
            drawn as w points along ``R @ w``.

        Raises:
            InputError: unknown body, or one whose orientation is not known.
        """
        found, top = self._body(body), self.system.topology
        if top.dim == 3:
            with numbers(self.system.parameters.points):
                return as_jax(turns(top, found.segments, derive(self.system).home, self._q))
        assert found.base is not None
        foot, tip = (self._q[..., 2 * k : 2 * k + 2] for k in found.base)
        return as_jax(angle_along(tip - foot))

    def quaternion(self, body: str) -> Array:
        """Rotation of a body of a spatial mechanism from its drawing as Euler parameters ``(..., 4)``, scalar first.

        The sign, which the rotation leaves open, is kept along a sweep; its first pose has a positive scalar part.
        """
        if self.system.topology.dim != 3:
            raise InputError("quaternion() is for spatial mechanisms; in the plane orientation() is the angle")
        rotation: Any = self.orientation(body)
        rotation = np.asarray(rotation) if on_host(self.poses, rotation) else rotation
        return as_jax(quaternions(rotation))

    def angular_velocity(self, body: str) -> Array:
        """Angular velocity of a body, rad/s: anticlockwise ``(...,)``, in space in the ground's axes ``(..., 3)``."""
        self._require(1, "angular velocity")
        return self._spin(body, 1)

    def angular_acceleration(self, body: str) -> Array:
        """Angular acceleration of a body, rad/s²; as `angular_velocity`."""
        self._require(2, "angular acceleration")
        return self._spin(body, 2)

    def _spin(self, body: str, order: int) -> Array:
        found = self._body(body)
        with numbers(self.system.parameters.points):
            return as_jax(spins(self.system.topology, found.segments, self._q, self.rates[:order]))

    def screw_axis(self, body: str, relative_to: str = "ground") -> "ScrewAxis":
        """The instantaneous screw axis of a body's motion, of a spatial mechanism; see `ScrewAxis`.

        Args:
            body: name of a body that knows its orientation.
            relative_to: name of the body that it is seen from, or ``"ground"``.

        Returns:
            The axis, in the axes of the ground.

        Raises:
            InputError: unknown body, one without an orientation, a planar mechanism, or a motion without rates.
        """
        if self.system.topology.dim != 3:
            raise InputError("screw_axis() is for spatial mechanisms; in the plane see jaxnc.instant_centre")
        return as_jax(screw_axis(*without_noise(relative_state(self, body, relative_to))))

    # -- honesty ------------------------------------------------------------------------------------------------

    @property
    def failures(self) -> Array:
        """How many poses failed."""
        failed: Any = (self.status != int(Status.CONVERGED)).sum()
        return as_jax(failed)

    def check(self) -> "Motion":
        """Raise if any pose failed, on the host.

        Returns:
            The motion itself.

        Raises:
            AssemblyError: naming how many poses failed, how, and the first input at which one did.
            InputError: inside of traced code, where nothing is known.
        """
        outside(self.status, "check()")
        status = np.asarray(self.status).reshape(-1)
        if not status.any():
            return self
        bad, known = np.flatnonzero(status), jax.lax.stop_gradient(self)  # a gradient may be asked for
        kinds = [f"{int(np.sum(status == s))} × {Status(s).sentence}" for s in np.unique(status[bad]).tolist()]
        inputs, write = [], self.system.topology.write_value
        for name in self.driven:
            value = float(np.asarray(known.inputs[name]).reshape(-1)[bad[0]])
            got = float(np.asarray(known[name]).reshape(-1)[bad[0]])
            inputs.append(f"{name} = {write(name, value)} (the motion got to {write(name, got)})")
        where = f"; the first is pose {bad[0]}, {', '.join(inputs)}" if inputs else ""
        if Status.SINGULAR_START in status and not self._designs:
            view = plan(self.system.topology, self.driven, self.held, self.system.degrees_of_freedom)
            if never_moves(known.system, view, derive(known.system)):
                raise AssemblyError(f"{self.system.name!r}: {NEVER_MOVES.format(', '.join(self.driven))}")
        ended = bool({int(Status.SINGULAR), int(Status.DID_NOT_ASSEMBLE)} & {*status[bad].tolist()})
        hint = circuits_hint(self.system, self.driven) if ended and not self._designs else ""
        zero = ""
        if ended and not self._designs:
            zero = meeting_ends(self.system, np.asarray(known.q).reshape(len(status), -1)[bad[0]])
        raise AssemblyError(
            f"{self.system.name!r}: {len(bad)} of {len(status)} poses failed{where}. {' '.join(kinds)}"
            f"{hint and f' {hint}.'}{zero}"
        )

    def singular_values(self) -> Float[Array, "... n"]:
        """Singular values of every pose's Jacobian with respect to the unknowns, largest first.

        They have first derivatives; where two are equal each of them has those of a part of the pair.
        """
        dense_only(self.system.topology, "singular_values()")
        if self._designs:
            return jax.vmap(Motion.singular_values)(self)
        view = plan(self.system.topology, self.driven, self.held, self.system.degrees_of_freedom)
        q: Any = self._q
        flat = q.reshape(-1, q.shape[-1])
        with numbers(self.system.parameters.points):
            if on_host(q, self.system):
                inner = HostView(view, from_jax(derive(self.system)))
                values = on_device(np.linalg.svd(inner.matrices(flat.T)[0], compute_uv=False))
            else:
                values = _singular_values(view, derived(self.system, differentiate_scales=True), flat)
        return as_jax(self.still_where_failed(values.reshape(*q.shape[:-1], values.shape[-1])))

    # -- looking ------------------------------------------------------------------------------------------------

    def plot(self, *names: "str | Sequence[str]", **options: object):
        """Plot quantities over the input, or the path of a point; see `jaxnc.viz.plot`."""
        return door("Motion.plot")(self, *names, **options)

    def polygon(self, kind: str = "velocity", **options: object):
        """Draw the velocity or the ``"acceleration"`` polygon of a planar mechanism; see `jaxnc.viz.polygon`."""
        return door("Motion.polygon")(self, kind, **options)

    def animate(self, path: "str | Path", **options: object) -> "Path":
        """Write a GIF of the motion; see `jaxnc.viz.animate`."""
        return door("Motion.animate")(self, path, **options)

    def to_html(self, path: "str | Path", **options: object) -> "Path":
        """Write a self-contained page in which the mechanism is dragged and changed; see `jaxnc.viz.to_html`."""
        return door("Motion.to_html")(self, path, **options)

    def to_csv(self, path: "str | Path", names: Sequence[str] | None = None, unit: str | None = None) -> "Path":
        """Write a table of inputs, positions, rates and status; see `jaxnc.io.tables.to_csv`."""
        return door("Motion.to_csv")(self, path, names, unit)

    def to_npz(self, path: "str | Path") -> "Path":
        """Write all arrays; `jaxnc.io.tables.load_npz` reads them back."""
        return door("Motion.to_npz")(self, path)

    def to_parts(
        self, folder: "str | Path | None" = None, formats: Sequence[str] = ("dxf", "svg"), **sizes: object
    ) -> "Assembly":
        """Make a planar mechanism of plates, ``width=``, ``pin=``, ``thickness=`` in mm, in layers without collisions.

        Args:
            folder: where drawings of the parts and their table are written, if anywhere.
            formats: ``"dxf"`` (``pip install "jaxnc[dxf]"``), ``"svg"`` or both.
            **sizes: ``width``, ``pin``, ``thickness``, and ``clearance``, ``play``, ``washer``, ``spacer``, ``unit``,
                ``layers``, ``density``, as `jaxnc.workshop.Shop.of` says.

        Returns:
            Parts, pins, layers and the clearances that remain.
        """
        return door("Motion.to_parts")(self, folder, formats, **sizes)

    def to_frame(self, names: Sequence[str] | None = None, unit: str | None = None) -> "pandas.DataFrame":
        """A pandas data frame, one row a pose; see `jaxnc.io.tables.to_frame`."""
        return door("Motion.to_frame")(self, names, unit)

    def to_xarray(self, names: Sequence[str] | None = None, unit: str | None = None) -> "xarray.Dataset":
        """An xarray data set with dimensions pose, point and axis; see `jaxnc.io.tables.to_xarray`."""
        return door("Motion.to_xarray")(self, names, unit)

    def __repr__(self) -> str:
        shape = self.status.shape
        poses = "one pose" if not shape else f"{'×'.join(map(str, shape))} poses"
        try:
            failed = int(np.sum(np.asarray(self.status) != 0))
            state = "all converged" if not failed else f"{failed} failed"
        except (jax.errors.TracerArrayConversionError, jax.errors.ConcretizationTypeError):
            state = "traced"
        return f"Motion({self.system.name!r}: {poses} driven by {', '.join(self.driven) or 'nothing'}, {state})"


def motion_of(
    system: System,
    view: Plan,
    poses: AnyArray,
    asked: AnyArray,
    *outcome: AnyArray,
    rates: tuple = (),
    time: Array | None = None,
) -> Motion:
    """Make a motion of poses found by a plan; the outcome is status, largest residual and conditioning of each."""
    driven, held = (system.topology.named(at) for at in (view.driven, view.held))
    return Motion(system, driven, held, poses, rates, asked, *outcome, time=time)


def drawn_motion(
    system: System, driven: tuple[str, ...], held: tuple[str, ...] = (), coordinates: np.ndarray | None = None
) -> Motion:
    """Make a motion of one pose, the drawing if no `coordinates` ``(N,)`` are given; nothing is solved or compiled."""
    q: Any = np.asarray(derive(system).home) if coordinates is None else coordinates
    asked, good = q[np.array([system.topology.position[name] for name in driven], int)], np.array(int(Status.CONVERGED))
    return Motion(system, driven, held, q, (), asked, cast(Any, good), None, None)


@filter_jit
def _singular_values(view, eq: "Equations", q: Array) -> Array:
    return jax.vmap(lambda x: dense.singular_values(view.linearise(eq, x)[1]))(q)
