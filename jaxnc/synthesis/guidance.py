"""Motion generation: a body goes through poses."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.inputs import positive
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.synthesis import given
from jaxnc.synthesis.conditions import Condition
from jaxnc.synthesis.path import PathGeneration
from jaxnc.synthesis.problem import Extras, namespace
from jaxnc.synthesis.statement import compiled
from jaxnc.system.frames import quaternions
from jaxnc.system.system import System
from jaxnc.types import Array


@public
@dataclasses.dataclass(frozen=True, eq=False, init=False, repr=False)
class MotionGeneration(PathGeneration):
    """A frame that rides on a body goes through poses; where and how it sits on the body is free.

    Attributes:
        body: name of the body.
        turns: orientations wanted: angles ``(M,)`` in the plane, rotations ``(M, 3, 3)`` in space.
        reach: length by which an error of an angle counts as much as one of a place.
    """

    by_target = ("target", "weights", "turns")
    body: str
    turns: np.ndarray
    reach: float
    _least = 2  # poses

    def __init__(
        self,
        mechanism: Mechanism | System,
        body: str,
        point: str,
        places: Any,
        orientations: Any,
        timing: Any = None,
        input: str | None = None,
        free: Sequence[str] | None = None,
        bounds: Mapping[str, Any] | None = None,
        subject_to: Sequence[Condition] = (),
        hold: Sequence[str] = (),
        travel: tuple[float, float] | None = None,
        offset: bool = False,
        weights: Any = None,
        reach: float | None = None,
        minimax: bool = False,
    ):
        """State the problem.

        Args:
            mechanism: the starting idea, as a `Mechanism` or compiled.
            body: name of the body that is guided.
            point: a point or marker on it, the origin of the frame that is guided.
            places: where the origin should be, ``(M, dim)``.
            orientations: of the frame: angles ``(M,)``, radians; in space rotation matrices ``(M, 3, 3)``. How the
                frame is turned against the body is free.
            timing: values of the input at the poses; free, in order, if not given.
            input: name of the driven coordinate.
            free: names of what may change; all if not given.
            bounds: as in `PathGeneration`.
            subject_to: conditions.
            hold: free coordinates that keep their start values.
            travel: as in `PathGeneration`.
            offset: as in `PathGeneration`.
            weights: of the poses.
            reach: length that turns an error of an angle into one of a place; the extent of the places if not given.
            minimax: make the largest error small rather than the sum of squares.

        Raises:
            InputError: unknown names, numbers that are not finite or do not match each other.
        """
        what = "MotionGeneration"
        top = compiled(what, mechanism).topology
        dim = top.dim
        goal = given.points(places, dim, what, self._least)
        shape = (len(goal),) if dim == 2 else (len(goal), 3, 3)
        try:
            turns = np.asarray(orientations, dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise InputError(f"{what}: orientations must be numbers, shape {shape}, got {orientations!r}") from None
        if turns.shape != shape or not np.isfinite(turns).all():
            raise InputError(f"{what}: orientations must be finite, shape {shape}; got shape {turns.shape}")
        if dim == 3 and not np.allclose(turns @ np.swapaxes(turns, 1, 2), np.eye(3), atol=1e-6):
            raise InputError(f"{what}: orientations must be rotation matrices; these are not orthonormal")
        if dim == 2:
            given.radians(turns, f"{what}: orientations", 2 * np.pi, "leave out whole turns")
        bodies = {b.name: [top.points[i] for i in b.points] for b in top.bodies}
        for marker in top.markers:
            bodies.get(marker.body, []).append(marker.name)
        if body not in bodies:
            raise InputError(f"{what}: {top.name!r} has no body {body!r}; {nearest(body, bodies)}")
        if point not in bodies[body] and any(point in names for names in bodies.values()):
            raise InputError(
                f"{what}: point {point!r} is not on body {body!r}, whose frame it is to be the origin of; its points "
                f"are {', '.join(bodies[body])}, and markers can be put on it: mechanism.marker(…)"
            )
        if reach is not None:
            positive(reach, f"{what}: reach, a length that turns angles into lengths,")
            reach = float(reach)
        settings = {"timing": timing, "input": input, "free": free, "bounds": bounds, "subject_to": subject_to}
        settings |= {"hold": hold, "travel": travel, "offset": offset, "weights": weights, "minimax": minimax}
        own = {"body": body, "turns": turns, "reach": float(reach or np.max(np.ptp(goal, axis=0)))}
        for name, value in own.items():
            object.__setattr__(self, name, value)
        super().__init__(mechanism, point, goal, **settings)

    def _frame(self, dim: int) -> Extras:
        names = ("turn of the frame",) if dim == 2 else tuple(f"turn of the frame about {axis}" for axis in "xyz")
        box = np.full(len(names), np.inf)
        return Extras(names, np.zeros(len(names)), -box, box)

    @property
    def error_shape(self) -> tuple[int, ...]:
        return len(self.target), (3 if self.system.topology.dim == 2 else 12)

    @property
    def own_turns(self) -> int:
        """How many unknowns say how the frame is turned."""
        return 1 if self.system.topology.dim == 2 else 3

    def inputs(self, extra: Any) -> Any:
        return super().inputs(extra[: -self.own_turns])

    def own(self, extra: Array) -> Array:
        return super().own(extra[: -self.own_turns])

    def misses(self, motion: Motion, extra: Array) -> Array:
        place = motion[self.point] - self.target
        found = motion.orientation(self.body)
        if self.system.topology.dim == 2:
            turn = 2.0 * jnp.sin(0.5 * (found - extra[-1] - self.turns))[:, None]
        else:
            turn = (found @ rotation(extra[-3:]) - self.turns).reshape(-1, 9) / np.sqrt(2.0)
        return jnp.concatenate([place, self.reach * turn], axis=1)

    def guesses(self, rng: np.random.Generator, count: int) -> np.ndarray:
        turn = rng.uniform(-np.pi, np.pi, (count, self.own_turns))
        return np.concatenate([self.timings(rng, count), turn], axis=1)


def rotation(v: Any) -> Any:
    """Rotation by a vector (Rodrigues), smooth at zero; NumPy's by NumPy's."""
    of = namespace(v)
    square = of.sum(v * v)
    small = square < 1e-8
    angle = of.sqrt(of.where(small, 1.0, square))
    a = of.where(small, 1.0 - square / 6.0, of.sin(angle) / angle)
    b = of.where(small, 0.5 - square / 24.0, (1.0 - of.cos(angle)) / of.where(small, 1.0, square))
    k = of.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return of.eye(3) + a * k + b * (k @ k)


def vector(r: np.ndarray) -> np.ndarray:
    """The vectors ``(…, 3)`` whose `rotation` matrices are ``(…, 3, 3)``."""
    p = np.asarray(quaternions(r))
    p = np.where(p[..., :1] < 0.0, -p, p)
    w, v = p[..., 0], p[..., 1:]
    long = np.linalg.norm(v, axis=-1)
    return v * np.where(long > 1e-12, 2.0 * np.arctan2(long, w) / np.maximum(long, 1e-300), 2.0)[..., None]
