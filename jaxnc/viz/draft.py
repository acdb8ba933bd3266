"""Motions of things that have none: a drawing as it was typed, and the range of a mechanism without a motion."""

import contextlib
from typing import Any

import jax
import numpy as np

from jaxnc.errors import InputError, JaxncError
from jaxnc.kinematics.motion import Motion, drawn_motion
from jaxnc.kinematics.position import sweep
from jaxnc.mechanism import Mechanism
from jaxnc.system.assemble import assemble
from jaxnc.system.system import System, drivable, unheld
from jaxnc.types import Inputs

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
