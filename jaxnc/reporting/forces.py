"""What a motion takes: efforts of the inputs, and the largest forces in the joints."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from jaxnc.calls import public
from jaxnc.dynamics.inverse import inverse_dynamics
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import sweep
from jaxnc.reporting.quantity import Quantity

_MOST = 24  # peaks that are listed
_NOTHING = 1e-9  # of the largest force


@public
@dataclass(frozen=True)
class Peak:
    """The largest force or moment that something exerts on a body.

    Attributes:
        on: the body.
        by: what exerts it.
        force: its largest size, N.
        moment: the largest moment about the body's centre of mass, N m.
        pose: where the force is largest.
    """

    on: str
    by: str
    force: float
    moment: float
    pose: int


@public
@dataclass(frozen=True)
class Forces:
    """Forces of a motion.

    Attributes:
        motion: with the rates that they are of.
        resting: whether nothing was said of rates, so that every pose is held at rest.
        efforts: of the inputs, one each.
        power: of all of them together; None at rest, and where nothing is driven.
        peaks: the largest first.
    """

    motion: Motion
    resting: bool
    efforts: tuple[Quantity, ...]
    power: Quantity | None
    peaks: tuple[Peak, ...]


def forces(motion: Motion) -> Forces | None:
    """Efforts and reactions of a sweep; None where nothing has a mass, or no pose was found.

    Without rates every pose is held at rest: gravity, springs and the like alone act.
    """
    good = np.asarray(motion.converged)
    if not motion.system.topology.loads.inertias or not good.any() or motion.system.topology.rates:
        return None
    resting = len(motion.rates) < 2
    if resting:
        still = dict.fromkeys(motion.driven, 0.0)
        motion = sweep(motion.system, dict(motion.inputs), rates=still, hold=motion.held, throw=False)
    found = inverse_dynamics(motion.system, motion)
    top = motion.system.topology
    efforts = []
    for k, name in enumerate((*motion.driven, *motion.held)):
        angle = top.is_angle(name)
        values = np.where(good, np.asarray(found.efforts)[..., k], np.nan)
        efforts.append(Quantity(f"effort {name}", "N m" if angle else "N", values, float(np.nanmax(np.abs(values)))))
    power = None
    if efforts and not resting:
        values = np.where(good, np.asarray(found.power), np.nan)
        power = Quantity("power", "W", values, float(np.nanmax(np.abs(values))))
    peaks = sorted(_peaks(found.reactions.all(), good), key=lambda p: -p.force)
    return Forces(motion, resting, tuple(efforts), power, tuple(peaks[:_MOST]))


def _peaks(wrenches: dict, good: np.ndarray) -> Iterator[Peak]:
    """The largest of every wrench over the poses that were found."""
    found = []
    for body, some in wrenches.items():
        for by, wrench in some.items():
            if by == "weight":
                continue
            force = np.where(good, np.linalg.norm(np.asarray(wrench.force), axis=-1), 0.0)
            moment = np.asarray(wrench.moment)
            moment = np.abs(moment) if moment.ndim == 1 else np.linalg.norm(moment, axis=-1)
            turns = float(np.where(good, moment, 0.0).max())
            found.append(Peak(body, by, float(force.max()), turns, int(force.argmax())))
    size = max((p.force for p in found), default=0.0)
    most = max((p.moment for p in found), default=0.0)
    yield from (p for p in found if p.force > _NOTHING * size or p.moment > _NOTHING * most)
