"""A mechanism as it was typed: one pose, the drawing itself, with nothing compiled, driven or solved."""

import jax
import numpy as np

from jaxnc.errors import InputError, JaxncError
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.solvers.assembly import derive
from jaxnc.status import Status
from jaxnc.system.assemble import assemble
from jaxnc.system.system import System, drivable, unheld

_TOLD = 4  # names, at most, of what may be driven


def typed(thing: Mechanism | System | Motion) -> Motion:
    """What is to be drawn as a motion: of a drawing, its angles and distances are its inputs."""
    if isinstance(thing, Motion):
        return thing
    system = assemble(thing) if isinstance(thing, Mechanism) else thing
    if not isinstance(system, System):
        raise InputError(f"only a Mechanism, a System or a Motion can be drawn; got {type(thing).__name__}")
    if np.ndim(system.parameters.points) > 2:
        raise InputError(f"{system.name!r}: a batch of designs is not drawn at once; index one")
    top = system.topology
    q = np.asarray(derive(system).home)
    asked = q[[top.position[name] for name in top.scalars]]
    good = np.array(int(Status.CONVERGED))
    return Motion(system, top.scalars, (), q, (), asked, good, None, None)  # pyright: ignore[reportArgumentType]


def caption(thing: Mechanism | System) -> str:
    """What is to be said of a drawing: its freedoms and what may drive it, or what is still missing."""
    try:
        wide = jax.config.read("jax_enable_x64")  # freedoms are counted with 64 bits either way
        system = thing.compile(dtype=None if wide else "float32") if isinstance(thing, Mechanism) else thing
    except JaxncError as error:
        return f"not complete: {error}"
    count = system.degrees_of_freedom
    said = f"{count} degree{'' if count == 1 else 's'} of freedom"
    if count:
        names, named = drivable(system.topology), system.topology.scalars
        told = min(max(count, sum(name in named for name in names)), _TOLD)  # names that were given come first
        said += f"; {', '.join(names[:told])}{', …' if len(names) > told else ''} may be driven"
    return "; ".join([said, *unheld(system.topology)])
