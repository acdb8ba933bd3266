"""What the variables of a joint in space are in a pose: from the frames of the two parts that it joins."""

from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp

from jaxnc.constraints.directions import about, unit
from jaxnc.families.shapes import angle
from jaxnc.families.turns import HOME, PARAMETERS, parameters
from jaxnc.system.frames import body_axes

Segments = tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class Between:
    """A variable of a joint between two parts, zero in the drawing (of orientation parameters: no rotation)."""

    how: str  # "about" an axis, "universal", "slide", or the name of orientation parameters
    part: int  # which of several
    parent: Segments  # the segments of the part before it, in the instance's numbers; none for the ground
    child: Segments  # those of the part
    axes: Segments  # the joint's axis on the first, and on the second: two points, or a vector (~k,)
    at: tuple[int, int]  # the joint's point on each

    @property
    def home(self) -> float:
        """Its value in the drawing."""
        return HOME[self.how][self.part] if self.how in HOME else 0.0

    def drawn(self, p: Any, v: Any) -> Any:
        """Both frames, the axes and the distance, as drawn."""
        frames = [_frame(x, p, v).reshape(-1) for x in (self.parent, self.child)]
        axes = [_direction(x, p, v) for x in self.axes] or [jnp.zeros(3)] * 2
        return tuple(jnp.concatenate([*frames, *axes, p[self.at[1]] - p[self.at[0]]]))

    def __call__(self, p: Any, v: Any, c: Any) -> Any:
        """The variable's value."""
        c = jnp.stack(list(c))
        parent, child = (
            _frame(x, p, v).T @ c[9 * k : 9 * k + 9].reshape(3, 3) for k, x in enumerate((self.parent, self.child))
        )
        turn, a, b = parent.T @ child, c[18:21], c[21:24]
        if self.how in PARAMETERS:
            return parameters(self.how, turn)[self.part]
        if self.how == "slide":
            return jnp.dot(parent.T @ (p[self.at[1]] - p[self.at[0]]) - c[24:27], a)
        if self.how == "about":
            return _turned(turn, a)
        first = angle(*about(a, b, turn @ b))
        if self.part == 0:
            return first
        # The rest of the rotation, after the first one is taken back, is about the second arm.
        return _turned(_rotation(a, -first) @ turn, b)


def _frame(segments: Segments, p: Any, v: Any) -> Any:
    return body_axes(segments, p, v) if segments else jnp.eye(3)


def _direction(line: tuple[int, ...], p: Any, v: Any) -> Any:
    return unit(p[line[1]] - p[line[0]] if len(line) == 2 else v[~line[0]])


def _turned(turn: Any, axis: Any) -> Any:
    """Angle of a rotation about a known axis."""
    axial = 0.5 * jnp.stack([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return angle(0.5 * (jnp.trace(turn) - 1.0), jnp.dot(axial, axis))


def _rotation(axis: Any, turn: Any) -> Any:
    x, y, z = axis
    skew = jnp.array([[0.0, 0.0, 0.0]] * 3).at[0, 1].set(-z).at[0, 2].set(y).at[1, 2].set(-x)
    skew = skew - skew.T
    return jnp.eye(3) + jnp.sin(turn) * skew + (1.0 - jnp.cos(turn)) * (skew @ skew)
