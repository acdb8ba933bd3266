"""pylinkage: the closed form of each dyad, compiled by numba, along steps of the crank or for many designs."""

from collections.abc import Callable

import numpy as np
from pylinkage.actuators import Crank
from pylinkage.components import Ground
from pylinkage.dyads import RRRDyad
from pylinkage.population import Ensemble
from pylinkage.simulation import Linkage

from benchmarks.circles import FourBars


def linkage(bars: FourBars, start: float, step: float) -> Linkage:
    """A four-bar whose crank stands at `start` and turns by `step` before every pose."""
    origin, pivot = Ground(0.0, 0.0, name="A"), Ground(float(bars.ground), 0.0, name="D")
    crank = Crank(anchor=origin, radius=float(bars.crank), angular_velocity=step, initial_angle=start, name="B")  # pyright: ignore[reportArgumentType]
    x, y = bars.poses(np.asarray(start))[1]
    rocker = RRRDyad(
        anchor1=crank.output,
        anchor2=pivot,
        distance1=float(bars.coupler),
        distance2=float(bars.rocker),
        x=float(x),
        y=float(y),
        name="C",
    )
    return Linkage([origin, pivot, crank, rocker])


def step_fast(made: Linkage, count: int) -> np.ndarray:
    """Points C ``(count, 2)`` after each of `count` steps."""
    return made.step_fast(count)[:, -1]


def ensemble(bars: FourBars, start: float, step: float) -> Callable[[int], np.ndarray]:
    """A function of the number of steps: points C ``(designs, steps, 2)`` of many designs."""
    many = len(bars.crank)
    one = FourBars(*(getattr(bars, n)[0] for n in ("crank", "coupler", "rocker", "ground", "side", "home")))
    template = linkage(one, start, step)
    template.compile()
    angle = np.full(many, start)
    b, c = bars.poses(angle)
    ground = np.stack([bars.ground, np.zeros(many)], axis=-1)
    positions = np.stack([np.zeros((many, 2)), ground, b, c], axis=1)
    dimensions = np.column_stack([bars.crank, bars.coupler, bars.rocker])
    made = Ensemble(template, dimensions, positions)
    return lambda steps: made.simulate(steps, store=False)[:, :, -1]
