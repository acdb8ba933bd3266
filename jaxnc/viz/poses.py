"""Numbers of a motion on the host: where every point and marker is in every pose, and which poses are right.

Things that have no motion get one: a drawing as it was typed, and the range of a mechanism.
"""

import contextlib
import dataclasses
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeGuard

import jax
import numpy as np
from jax.core import Tracer

from jaxnc.errors import InputError, JaxncError, nearest
from jaxnc.kinematics.inputs import angle_unit
from jaxnc.kinematics.motion import Motion, drawn_motion
from jaxnc.kinematics.position import sweep
from jaxnc.mechanism import Mechanism
from jaxnc.status import Status
from jaxnc.system.assemble import assemble
from jaxnc.system.system import System, drivable, unheld
from jaxnc.system.topology import Block, Topology
from jaxnc.types import ArrayLike, Inputs
from jaxnc.vehicle.hardpoints import usual

if TYPE_CHECKING:
    from jaxnc.dynamics.reactions import Reactions
    from jaxnc.dynamics.simulation import Simulation
    from jaxnc.vehicle.suspension import Suspension


POSES = 181  # of a motion whose number of poses is not given


def draft(thing: Mechanism | System | Motion) -> Motion:
    """Make a motion of what is to be drawn: of a drawing one pose, with nothing compiled, driven or solved.

    Its angles and distances are its inputs.
    """
    if isinstance(thing, Motion):
        return thing
    system = assemble(thing) if isinstance(thing, Mechanism) else thing
    if not isinstance(system, System):
        raise InputError(f"only a Mechanism, a System or a Motion can be drawn; got {type(thing).__name__}")
    if np.ndim(system.parameters.points) > 2:
        raise InputError(f"{system.name!r}: a batch of designs is not drawn at once; index one")
    return drawn_motion(system, system.topology.scalars)


def caption(thing: Mechanism | System) -> str:
    """Describe a drawing: its freedoms and what may drive it, or what is still missing."""
    try:
        wide = jax.config.read("jax_enable_x64")  # freedoms are counted with 64 bits either way
        system = thing.compile(dtype=None if wide else "float32") if isinstance(thing, Mechanism) else thing
    except JaxncError as error:
        return f"not complete: {error}"
    count = system.degrees_of_freedom
    text = f"{count} degree{'' if count == 1 else 's'} of freedom"
    if count:
        names, named = drivable(system.topology), system.topology.scalars
        shown = min(max(count, sum(name in named for name in names)), 4)  # those that were given come first
        text += f"; {', '.join(names[:shown])}{', …' if len(names) > shown else ''} may be driven"
    return "; ".join([text, *unheld(system.topology)])


def default_motion(thing: Any, inputs: Inputs | None, options: dict[str, Any]) -> Motion:
    """Move a thing to look at it: a motion as it is, anything else driven as asked, or as far as it goes.

    If no inputs are given they are those of a model's run section, or the whole range of the coordinate that can be
    driven; of several freedoms, the pose that was drawn. `options` are further ones of `jaxnc.sweep`.
    """
    if isinstance(thing, Motion):
        if inputs is not None or options:
            raise InputError("widget: a motion has its inputs already; leave inputs=, rates= and hold= out")
        return thing
    from jaxnc.io.drives import sweep_arguments  # a first drawing goes without these

    if inputs is None and not options and isinstance(thing, Mechanism) and thing.model.run.inputs:
        return sweep(thing.compile(), **sweep_arguments(thing), throw=False)
    drawn = draft(thing)
    system = thing.compile() if isinstance(thing, Mechanism) else drawn.system
    if inputs is None:
        names = system.independent or drivable(system.topology)[: system.degrees_of_freedom]
        home = drawn.q[np.array([system.topology.position[name] for name in names], int)]
        inputs = {name: np.array([float(x)]) for name, x in zip(names, home, strict=True)}
        if len(names) == 1:  # as far as it goes from the drawing
            from jaxnc.kinematics.arc import travel

            with contextlib.suppress(JaxncError):
                found = travel(system, names[0])
                values = whole_range(system, names[0], float(home[0]), found.lower, found.upper)
                inputs = inputs if values is None else {names[0]: values}
    return sweep(system, inputs, throw=False, **options) if inputs else drawn


def whole_range(system: System, name: str, home: float, lower: float, upper: float) -> np.ndarray | None:
    """Choose the values of an input from one dead point to the other; without them a turn of an angle, or None."""
    if np.isfinite([lower, upper]).all():
        spare = 1e-3 * (upper - lower)  # a thousandth of the range is left before dead points
        return np.linspace(lower + spare, upper - spare, POSES)
    return home + np.linspace(0.0, 2 * np.pi, POSES) if system.topology.is_angle(name) else None


# -- numbers of a motion -----------------------------------------------------------------------------------------------


_CHORD, _BEND, _BETWEEN = 0.02, 0.08, 8  # of a path's extent, radians: chords that are drawn as so many


def evenly(x: np.ndarray, count: int = 9) -> np.ndarray:
    """Pick a few rows of an array, evenly spread."""
    return x[np.unique(np.linspace(0, len(x) - 1, count).astype(int))]


def is_simulation(thing: object) -> "TypeGuard[Simulation]":
    """Tell whether a thing is a simulation; nothing is where their module was never loaded, and it stays away."""
    module = sys.modules.get("jaxnc.dynamics.simulation")
    return module is not None and isinstance(thing, module.Simulation)


@dataclass(frozen=True)
class Poses:
    """Poses of a mechanism as NumPy arrays."""

    motion: Motion  # the motion they come from
    topology: Topology  # its topology
    names: tuple[str, ...]  # names of the columns: points, then markers
    places: np.ndarray  # position of every column, (T, columns, dim), lengths
    scalars: np.ndarray  # angles and distances, (T, scalars)
    status: np.ndarray  # `jaxnc.Status` of each pose, (T,)
    single: bool  # whether the motion is one pose, not a sequence
    directions: tuple[str, ...]  # names of unit vectors, then of markers that are directions; none in the plane
    axes: np.ndarray  # each of them, (T, directions, dim)
    angles: str  # what angles are shown in, "rad" or "deg"
    found: Any = None
    """Reactions of the motion, where they are known already."""

    @cached_property
    def reactions(self) -> "Reactions":
        """Reactions: what passes through the joints."""
        if self.found is None and len(self.motion.rates) < 2:
            self.motion.acceleration(self.topology.points[0])  # says what is missing
        from jaxnc.dynamics.reactions import reactions

        return reactions(self.motion if self.found is None else self.found)

    @cached_property
    def wheel(self) -> "Suspension | None":
        """The numbers of a suspension; None of what has not the usual names of one."""
        names = usual((*self.names, *self.directions)) if self.dim == 3 else None
        if names is None or names.contact not in self.names or not self.motion.driven:
            return None
        from jaxnc.vehicle.suspension import suspension

        return suspension(self.motion)

    def with_reactions(self, found: object) -> "Poses":
        """Add reactions that were found already."""
        from jaxnc.dynamics.reactions import Reactions

        if not isinstance(found, Reactions):
            expected = "True, or what inverse_dynamics() or reactions() found of this motion"
            raise InputError(f"forces={found!r:.80}: expected {expected}")
        if found.motion.names != self.motion.names or np.size(found.motion.status) != self.count:
            raise InputError(f"forces= are those of another motion: {found.motion!r}, not {self.motion!r}")
        return dataclasses.replace(self, found=found)

    @cached_property
    def every_column(self) -> np.ndarray:
        """All columns of all poses, places and then directions, ``(T, columns, dim)``."""
        return np.concatenate([self.places, self.axes], axis=1)

    def driven_scalars(self) -> Iterator[tuple[str, int, bool, Block, int]]:
        """List angles and distances that are driven: name, index, whether an angle, and where its rows are."""
        top = self.topology
        for name in self.motion.driven:
            if name in top.scalars:
                k = top.scalars.index(name)
                block, instance = top.measures[k]
                yield name, k, bool(top.angles[k]), top.blocks[block], instance

    @property
    def dim(self) -> int:
        """2 in the plane, 3 in space."""
        return self.topology.dim

    @property
    def count(self) -> int:
        """Number of poses."""
        return len(self.status)

    @property
    def good(self) -> np.ndarray:
        """Which poses are right, ``(T,)``."""
        finite = np.isfinite(self.places).all(axis=(1, 2)) & np.isfinite(self.axes).all(axis=(1, 2))
        return (self.status == 0) & finite

    @property
    def gaps(self) -> list[tuple[int, int]]:
        """Runs of poses that are not right, each from its first to after its last."""
        return true_runs(~self.good)

    @property
    def extent_poses(self) -> np.ndarray:
        """Indices of the poses that decide extents: the right ones, or all if none is."""
        return np.flatnonzero(self.good) if self.good.any() else np.arange(self.count)

    def column(self, name: str, what: str) -> int:
        """Find the column of a point or marker."""
        if name not in self.names:
            raise InputError(
                f"{what}: {self.topology.name!r} has no point or marker {name!r}; {nearest(name, self.names)}"
            )
        return self.names.index(name)

    def columns(self, names: str | Iterable[str], what: str) -> tuple[int, ...]:
        """Find the columns of several points or markers, given as names or as one name."""
        names = (names,) if isinstance(names, str) else tuple(names)
        return tuple(dict.fromkeys(self.column(name, what) for name in names))

    def pose(self, index: int) -> int:
        """Read an index of a pose, counted from the end if negative."""
        if not isinstance(index, (int, np.integer)) or not -self.count <= index < self.count:
            have = "one pose, number 0" if self.count == 1 else f"poses 0 to {self.count - 1}"
            raise InputError(f"pose={index!r}: this motion of {self.topology.name!r} has {have}")
        return int(index) % self.count

    def path(self, column: int) -> tuple[np.ndarray, np.ndarray]:
        """Find the path of a column to be drawn, ``(n, dim)``, and where each pose is on it, ``(T,)``.

        Where few poses would show chords, as near change points, it has further places between them.
        """
        x = np.where(self.good[:, None], self.places[:, column], np.nan)
        if not chords(x, self.size).any():
            return x, np.arange(self.count)
        places, at = self._between
        return places[:, column], at

    @cached_property
    def size(self) -> float:
        """Size of what is drawn over the motion, a length."""
        return float(np.linalg.norm(np.ptp(self.places[self.extent_poses].reshape(-1, self.dim), axis=0)))

    @cached_property
    def _between(self) -> tuple[np.ndarray, np.ndarray]:
        """Places of all columns in the poses and on the way from each to the next, and where the poses are there."""
        good, way = self.good, self._way()
        x = np.where(good[:, None, None], self.places, np.nan)
        if way is None:
            return x, np.arange(self.count)
        all_places, at = [], []
        for run in np.split(np.arange(self.count), np.flatnonzero(np.diff(good)) + 1):  # of poses alike right or not
            parts, places, own = run.astype(float), x[run], np.arange(len(run))
            for _ in range(2 if good[run[0]] else 0):
                coarse = np.any([chords(p, self.size) for p in np.swapaxes(places, 0, 1)], axis=0)
                if not coarse.any():
                    break
                ends = zip(parts[:-1], parts[1:], np.where(coarse, _BETWEEN, 1), strict=True)
                finer = np.concatenate([*(np.linspace(a, b, n, endpoint=False) for a, b, n in ends), parts[-1:]])
                there = np.concatenate([[0], np.cumsum(np.where(coarse, _BETWEEN, 1))])[own]
                found = way(finer)
                if found is None or np.abs(found[there] - x[run]).max() > 1e-6 * np.ptp(places):
                    break  # or on another branch
                parts, places, own = finer, found, there
            at.append(own + sum(map(len, all_places)))
            all_places.append(places)
        return np.concatenate(all_places), np.concatenate(at)

    def _way(self) -> Callable[[np.ndarray], np.ndarray | None] | None:
        """Make a function that finds places of all columns ``(n, columns, dim)`` between poses; None if there is none.

        What is driven is solved for: several inputs go from pose to pose smoothly, none beyond its values, or in time
        as their rates say. What was simulated is interpolated, with its velocities and accelerations.
        """
        motion, rates = self.motion, len(self.motion.rates)
        time = None if motion.time is None or rates < 2 else np.asarray(motion.time, float)
        if self.topology.large:
            return None
        if motion.conditioning is None or not motion.driven:
            if time is None or not is_simulation(motion):
                return None
            return lambda parts: _interpolate(parts, self.places, time, self.rates(1), self.rates(2))
        at = [self.topology.position[name] for name in motion.driven]
        known = [np.asarray(x, float).reshape(self.count, -1)[:, at] for x in motion.rates[:2]]
        asked = np.asarray(motion.asked, float).reshape(self.count, -1)

        def solve_between(parts: np.ndarray) -> np.ndarray | None:
            found = _ease_inputs(parts, asked) if time is None else _interpolate(parts, asked, time, *known)
            values = dict(zip(motion.driven, found.T, strict=True))
            try:
                start = motion.pose(int(parts[0]))
                there = poses(sweep(motion.system, values, hold=motion.held, start=start, throw=False))
            except InputError:  # poses that were put together elsewhere: these inputs do not move it
                return None
            return there.places if there.good.all() else None

        return solve_between

    def rates(self, order: int) -> np.ndarray:
        """Find the rates of all columns, ``(T, columns, dim)``, NaN where a pose is not right."""
        read = (self.motion.velocity, self.motion.acceleration, self.motion.jerk)[order - 1]
        if len(self.motion.rates) < order:
            read(self.topology.points[0])  # raises an error that tells what is missing
        x = _columns(self.motion, np.asarray(self.motion.rates[order - 1]).reshape(self.count, -1), read)
        return np.where(self.good[:, None, None], x, np.nan)

    def sentence(self, index: int) -> str:
        """Describe what became of a pose that is not right."""
        try:
            return Status(int(self.status[index])).sentence
        except ValueError:
            return "The pose is not right."

    @property
    def run(self) -> bool:
        """True of a simulation, whose energies are known."""
        return is_simulation(self.motion) and self.motion.multipliers is not None

    @property
    def pace(self) -> float:
        """Seconds of a motion in time that a second of its film shows: 1, unless it would be over at once, or never."""
        time = self.motion.time
        if time is None or self.single or self.count < 2:
            return 1.0
        span = float(np.ptp(np.asarray(time)[self.extent_poses]))
        if 1.0 <= span <= 60.0 or not span > 0:
            return 1.0
        return float(10.0 ** np.floor(np.log10(span if span < 1.0 else span / 6.0)))

    @property
    def closed(self) -> bool:
        """True where the last pose is the first one again, so that the motion can be repeated."""
        if self.count < 3 or not (self.good[0] and self.good[-1]):
            return False
        size = np.ptp(self.places[self.good].reshape(-1, self.dim), axis=0).max()
        return bool(np.abs(self.places[0] - self.places[-1]).max() <= 1e-6 * max(size, 1e-300))


def true_runs(x: np.ndarray) -> list[tuple[int, int]]:
    """Find the runs in which all of some truth values ``(T,)`` hold, each from its first to after its last."""
    edges = np.diff(np.concatenate([[0], x.astype(int), [0]]))
    return list(zip(np.flatnonzero(edges > 0).tolist(), np.flatnonzero(edges < 0).tolist(), strict=True))


def chords(x: np.ndarray, size: float) -> np.ndarray:
    """Find which steps of a path ``(T, dim)`` would be seen as chords in a drawing of a size, ``(T - 1,)``."""
    right = np.isfinite(x).all(axis=1)
    if right.sum() < 3:
        return np.zeros(max(len(x) - 1, 0), bool)
    way = np.diff(x, axis=0)
    step = np.linalg.norm(way, axis=1)
    with np.errstate(all="ignore"):
        cosine = np.sum(way[1:] * way[:-1], axis=1) / np.maximum(step[1:] * step[:-1], 1e-300)
    bends = np.concatenate([[False], cosine < np.cos(_BEND), [False]])
    # paths that are smaller than 0.1 of the drawing count as so large
    extent = max(float(np.linalg.norm(np.ptp(x[right], axis=0))), 0.1 * size)
    return (step > _CHORD * extent) & (bends[1:] | bends[:-1])


def _cubic(s: np.ndarray, a: np.ndarray, b: np.ndarray, v: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Interpolate between values a and b with slopes v and w, at shares s of the step."""
    return a + s * (b - a) + s * (1 - s) * ((1 - s) * (v - b + a) - s * (w - b + a))


def _ease_inputs(parts: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Interpolate values ``(T, inputs)`` at poses and parts of the way to the next, smoothly, and monotonely if so.

    Slopes are harmonic means of the steps (Fritsch & Butland 1984, SIAM J. Sci. Stat. Comput. 5:300): what moves one
    input after the other, or turns back, does so here too.
    """
    if x.shape[1] == 1:
        return np.interp(parts, np.arange(len(x)), x[:, 0])[:, None]
    step, slope = np.diff(x, axis=0), np.zeros_like(x)
    before, after = np.concatenate([step[:1], step]), np.concatenate([step, step[-1:]])
    np.divide(2 * before * after, before + after, out=slope, where=before * after > 0)
    k = np.minimum(parts.astype(int), len(x) - 2)
    return _cubic((parts - k)[:, None], x[k], x[k + 1], slope[k], slope[k + 1])


def _interpolate(
    parts: np.ndarray, x: np.ndarray, time: np.ndarray, first: np.ndarray, second: np.ndarray
) -> np.ndarray:
    """Interpolate values ``(T, ...)`` at poses and parts of the way to the next: of degree five, with rates in time.

    A step whose rates do not go with its ends, as of an impact, is straight.
    """
    k = np.minimum(parts.astype(int), int(parts[-1]) - 1)
    s, a, b = (parts - k).reshape(-1, *[1] * (x.ndim - 1)), x[k], x[k + 1]
    h = (time[k + 1] - time[k]).reshape(s.shape)
    (v, w), (p, q) = ((h**n * y[k], h**n * y[k + 1]) for n, y in ((1, first), (2, second)))
    lack, over = p - (6 * (b - a) - 4 * v - 2 * w), q - (2 * v + 4 * w - 6 * (b - a))  # of accelerations, of the cubic
    bow = s**2 * (1 - s) ** 2 * (lack * (1 - s) + over * s) / 2
    leaps = np.linalg.norm(first[k + 1] - first[k] - h * (second[k] + second[k + 1]) / 2, axis=-1, keepdims=True)
    most = np.nanmax(np.linalg.norm(first, axis=-1), initial=0.0)
    # At an impact, the speed changes by the largest speed more than accelerations account for.
    return np.where(leaps > most, a + s * (b - a), _cubic(s, a, b, v, w) + bow)


def poses(motion: Motion | System | Mechanism, unit: str | None = None) -> Poses:
    """Bring a motion to the host; of a system or a mechanism its drawing. Angles have its own unit if none is given."""
    motion = draft(motion)
    if isinstance(motion.q, Tracer) or isinstance(motion.status, Tracer):
        raise InputError("inside jit, vmap or grad a motion has no numbers to show; return it and draw it outside")
    top = motion.system.topology
    status = np.asarray(motion.status)
    designs = np.ndim(motion.system.parameters.points) > 2
    if designs or status.ndim > 1:
        way = "index one: jax.tree.map(lambda x: x[0], motion)" if designs else "take one with motion.pose(0)"
        noun = "designs" if designs else "poses"
        raise InputError(f"{top.name!r}: a batch of {noun} of shape {status.shape} is not drawn at once; {way}")
    if status.size == 0:
        raise InputError(f"{top.name!r}: this motion has no poses to draw")
    q = np.asarray(motion.q).reshape(status.size, -1)
    return Poses(
        motion=motion,
        topology=top,
        names=(*top.points, *(m.name for m in top.markers if not m.direction)),
        places=_columns(motion, q, motion.__getitem__),
        scalars=q[:, len(top.coordinates) - len(top.scalars) :],
        status=status.reshape(-1),
        single=status.ndim == 0,
        directions=(*top.vectors, *(m.name for m in top.markers if m.direction)),
        axes=_columns(motion, q, motion.__getitem__, directions=True),
        angles=angle_unit(unit or top.angle_unit),
    )


def _columns(motion: Motion, x: np.ndarray, read: Callable[[str], ArrayLike], directions: bool = False) -> np.ndarray:
    """Read places of points and markers, or directions of unit vectors and markers, ``(T, columns, dim)``.

    Those of points and vectors are in the coordinates ``(T, coordinates)``, or rates of them.
    """
    top = motion.system.topology
    points, both = len(top.points), len(top.points) + len(top.vectors)
    own = x[:, points * top.dim : both * top.dim] if directions else x[:, : points * top.dim]
    names = [m.name for m in top.markers if m.direction == directions]
    found = [np.asarray(read(name), float).reshape(len(x), 1, top.dim) for name in names]
    return np.concatenate([own.reshape(len(x), -1, top.dim), *found], axis=1)
