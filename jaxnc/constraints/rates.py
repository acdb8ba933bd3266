"""Constraints on velocities that no constraint on positions stands for (nonholonomic): skates, wheels, rolling discs.

Positions are free of them: they take away freedoms of the motion from moment to moment, and none of the places that the
mechanism can be brought to. So they are a kind of row of their own, linear in the rates.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from jaxnc.calls import public
from jaxnc.constraints.directions import cross3, triple
from jaxnc.constraints.elementary import ratio, stacked
from jaxnc.constraints.kind import Kind, RowFunction, cross, dot, norm
from jaxnc.pickling import Remade, register_by_name


@public
@dataclass(frozen=True)
class RateKind(Remade):
    """One kind of constraint that is linear in velocities, ``B(q) q̇ = b(q)``.

    Points, vectors, scalars and constants are those of one instance, as in `Kind`; ``dp, dv, ds`` are their rates. B is
    derived from `rate`, which is to be linear in the rates (a part without rates is b).

    Args:
        name: unique name, used in reports and messages.
        rate: ``(p, v, s, dp, dv, ds, c) -> rows``, scalars that vanish when the constraint is met, m/s.
        rows: a short label for each row.
        points: how many points an instance takes.
        vectors: how many unit vectors.
        scalars: how many scalar coordinates.
        constants: names of its constants.
        drawn: ``(p, v, s, c) -> constants`` as read off the drawing, as in `Kind`.
        source: where the equation comes from.
    """

    name: str
    rate: Callable[..., Any]
    rows: tuple[str, ...] = ("",)
    points: int = 0
    vectors: int = 0
    scalars: int = 0
    constants: tuple[str, ...] = ()
    drawn: RowFunction | None = None
    source: str = ""

    def __post_init__(self):
        if self.constants and self.drawn is None:
            raise ValueError(f"kind {self.name!r} has constants {self.constants} but no `drawn` to read them off")


def _slip(p, v, s, dp, dv, ds, c):
    d = p[2] - p[1]
    return (ratio(cross(d, dp[0]), norm(d)),)


SKATE = RateKind(
    "skate",
    _slip,
    rows=("side slip",),
    points=3,
    source="S. A. Chaplygin, on the motion of nonholonomic systems (1911): a knife edge moves along its heading only",
)
"""A point that moves along the direction from a second point to a third one only."""


def _height(p, v):
    return dot(p[0] - p[1], v[-1])


def _radius(p, v, s, c):
    return (ratio(_height(p, v), norm(stacked(cross3(v[0], v[-1])))),)


def _touching(p, v, s, c):
    across = stacked(cross3(v[0], v[1]))
    height = _height(p, v)
    return (height * height - c[0] * c[0] * dot(across, across),)


TOUCHING = Kind(
    "touching",
    _touching,
    rows=("contact",),
    powers=(2,),
    points=2,
    vectors=2,
    constants=("radius",),
    drawn=_radius,
    guard=lambda p, v, s, c: (c[0] * _height(p, v),),  # stays on its side
    source="the rim of a disc touches a plane: its centre is r sin(lean) above it",
)
"""A disc (centre; a point of the plane; its axis, the plane's normal) whose rim touches a plane."""


def _rolling(p, v, s, dp, dv, ds, c):
    u, w, n = v
    du, dw = dv[0], dv[1]
    lean = dot(n, u)
    sine = norm(stacked(cross3(u, n)))
    up = stacked([ratio(n[k] - lean * u[k], sine) for k in range(3)])  # from the contact to the centre
    # ω × up, from the rates of two directions of the disc: up = α u + β w + γ u × w.
    h = stacked(cross3(u, w))
    square = dot(h, h)
    beta, gamma = ratio(dot(up, w), square), ratio(dot(up, h), square)
    alpha = -beta * dot(u, w)
    dh = [a + b for a, b in zip(cross3(du, w), cross3(u, dw), strict=True)]
    slip = stacked([dp[0][k] - c[0] * (alpha * du[k] + beta * dw[k] + gamma * dh[k]) for k in range(3)])
    along = stacked([ratio(x, sine) for x in cross3(u, n)])
    return dot(slip, along), triple(slip, n, along)


ROLLING_DISC = RateKind(
    "rolling disc",
    _rolling,
    rows=("slip along", "slip across"),
    points=2,
    vectors=3,
    constants=("radius",),
    drawn=_radius,
    source="E. J. Routh, Advanced Rigid Dynamics, on the rolling of a disc",
)
"""A disc (centre; a point of the plane; its axis, another of its directions, the plane's normal) that does not slip."""

RATES: dict[str, RateKind] = {kind.name: kind for kind in (SKATE, ROLLING_DISC)}
"""Every kind of constraint on velocities that the library knows, by name."""
register_by_name(__name__, RATES.values())
