"""A motion to be looked at, of a mechanism of which nobody has said how it moves: as far as it goes."""

from typing import Any

import numpy as np

from jaxnc.errors import InputError, JaxncError
from jaxnc.io.drives import sweep_arguments
from jaxnc.kinematics.arc import travel
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import sweep
from jaxnc.mechanism import Mechanism
from jaxnc.system.system import System, drivable
from jaxnc.types import Inputs
from jaxnc.viz.typed import typed

_POSES = 181


def ranged(thing: Any, inputs: Inputs | None, driving: dict[str, Any]) -> Motion:
    """The motion of a thing: a motion as it is, anything else driven as asked, or as far as it goes.

    If no inputs are given they are those of a model's run section, or the whole range of the coordinate that can be
    driven; of several freedoms, the pose that was drawn. `driving` is more for `jaxnc.sweep`.
    """
    if isinstance(thing, Motion):
        if inputs is not None or driving:
            raise InputError("widget: a motion has its inputs already; leave inputs=, rates= and hold= out")
        return thing
    if inputs is None and not driving and isinstance(thing, Mechanism) and thing.model.run.inputs:
        return sweep(thing.compile(), **sweep_arguments(thing), throw=False)
    drawn = typed(thing)
    system = thing.compile() if isinstance(thing, Mechanism) else drawn.system
    if inputs is None:
        names = system.independent or drivable(system.topology)[: system.degrees_of_freedom]
        home = drawn.q[np.array([system.topology.position[name] for name in names], int)]
        inputs = {name: np.array([float(x)]) for name, x in zip(names, home, strict=True)}
        if len(names) == 1:
            inputs = {names[0]: _range(system, names[0], float(home[0]))}
    return sweep(system, inputs, throw=False, **driving) if inputs else drawn


def _range(system: System, name: str, home: float) -> np.ndarray:
    """As far as an input goes from the drawing: round, or from one dead point to the other."""
    try:
        found = travel(system, name)
        low, high = found.lower, found.upper
    except JaxncError:
        return np.array([home])
    if not np.isfinite([low, high]).all():
        angle = name in system.topology.scalars and system.topology.angles[system.topology.scalars.index(name)]
        return home + np.linspace(0.0, 2 * np.pi, _POSES) if angle else np.array([home])
    spare = 1e-3 * (high - low)
    return np.linspace(low + spare, high - spare, _POSES)
