"""What a suspension is asked: names of its parts, given or usual, and the inputs that move it."""

import dataclasses
import warnings
from typing import Any, NamedTuple

import numpy as np
from jax.core import Tracer

from jaxnc.errors import InputError, nearest
from jaxnc.kinematics.hardpoints import Line, Names, parts, usual
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.sizes import doubtful_size
from jaxnc.solvers.assembly import derive
from jaxnc.types import Array


class What(NamedTuple):
    """What a suspension is asked: all that decides how its numbers follow from its poses."""

    names: Names  # what its parts are called
    side: str  # "left" or "right"
    bump: str  # the input by which the wheel rises
    screw: tuple[str, str] | None  # a carrier and the input that steers it, for an instantaneous steering axis
    axle: str  # "front" or "rear"
    carrier: str | None = None  # the body that carries the wheel; None if it is not known

    @property
    def inputs(self) -> tuple[str, ...]:
        """Inputs that are moved to see what follows."""
        return (self.bump,) if self.screw is None else (self.bump, self.screw[1])


_NOTHING = Names()


def asked(
    motion: Motion,
    given: Names = _NOTHING,
    side: str = "left",
    radius: float | Array | None = None,
    bump: str | None = None,
    steering: tuple[str | None, str | None] = (None, None),
    axle: str = "front",
) -> What:
    """What is asked, from what `jaxnc.suspension` is given; `steering` is carrier and steer."""
    if not isinstance(motion, Motion):
        raise InputError(f"suspension() takes a motion, of sweep() or motion(), got {type(motion).__name__}")
    top = motion.system.topology
    if top.dim != 3:
        raise InputError(f"suspension() is for motions of spatial mechanisms; {top.name!r} is planar")
    for name, value, allowed in (("side", side, ("left", "right")), ("axle", axle, ("front", "rear"))):
        if value not in allowed:
            raise InputError(f"suspension: {name}={value!r}; use one of {', '.join(map(repr, allowed))}")
    carrier, steer = steering
    if radius is not None and given.contact is not None:
        raise InputError("suspension: contact= and radius= both give the tyre's radius; leave one of them out")
    names = _resolved(motion, given)
    if radius is None and names.contact is None:
        raise InputError(
            "suspension: the tyre's radius is not known; give radius=, or contact=, a point or marker drawn "
            "where the wheel touches the road"
        )
    known = (*motion.driven, *motion.held)
    if carrier is not None:
        motion._body(carrier)
    else:
        carrier = next((m.body for m in top.markers if m.name == names.contact), None)
    screw = None
    if steer is not None and given.steering_axis is None:
        if carrier is None:
            raise InputError("suspension: an instantaneous steering axis needs carrier= (a body) besides steer=")
        if steer not in known:
            raise InputError(f"suspension: {steer!r} is not an input of this motion; {nearest(steer, known)}")
        screw = (carrier, steer)
    doubt = doubtful_size(motion.system, suspension=True)
    if doubt:
        warnings.warn(f"{top.name!r}: {doubt}", UserWarning, stacklevel=3)
    what = What(names, side, _bump(motion, bump, names.wheel_centre), screw, axle, carrier)
    if not isinstance(motion.system.parameters.points, Tracer):
        home: Any = derive(motion.system).home
        home = home if isinstance(home, Tracer) else np.asarray(home)
        _on_side(posed(motion, home)[names.wheel_centre], side, names.wheel_centre)
    return what


def posed(motion: Motion, q: Array) -> Motion:
    """A single pose as a motion."""
    return dataclasses.replace(motion, poses=q, rates=(), time=None)


def _has(motion: Motion, line: Line) -> bool:
    return all(name in motion.names for name in parts(line))


def _resolved(motion: Motion, given: Names) -> Names:
    """The names given for the parts, or the usual ones where the mechanism has them."""
    known = usual(motion.names)
    found: list[Any] = []
    for role, name in zip(Names._fields, given, strict=True):
        if name is None:
            name = getattr(known, role, None)
            name = name if name is not None and _has(motion, name) else None
            if name is None and role in ("wheel_centre", "spin_axis"):
                kind = "a unit vector, or two points" if role == "spin_axis" else "a point or marker"
                raise InputError(
                    f"suspension: {motion.system.name!r} has none of the usual names for its "
                    f"{role.replace('_', ' ')}; say which it is with {role}=, {kind}"
                )
        else:
            for part in parts(name):
                if part not in motion.names:
                    hint = nearest(part, motion.names)
                    raise InputError(f"suspension: {role}={name!r}: no point, vector or coordinate {part!r}; {hint}")
        found.append(name if name is None or isinstance(name, str) else tuple(name))
    return Names(*found)


def _bump(motion: Motion, bump: str | None, wheel_centre: str) -> str:
    known = (*motion.driven, *motion.held)
    if bump is None:
        height = f"{wheel_centre}.z"
        if not known:
            raise InputError("suspension: nothing is driven in this motion, so the wheel does not rise")
        return height if height in known else known[0]
    if bump not in known:
        raise InputError(f"suspension: bump={bump!r} is not an input of this motion; {nearest(bump, known)}")
    return bump


def _on_side(centre: Array, side: str, name: str) -> None:
    if isinstance(centre, Tracer):
        return
    y = float(np.asarray(centre)[1])
    if y * (1.0 if side == "left" else -1.0) >= 0:
        return
    other = "right" if side == "left" else "left"
    raise InputError(
        f"suspension: side={side!r}, but {name!r} is drawn at y = {y:g}, on the {other}; ISO 8855 has y "
        f"to the left. Give side={other!r}"
    )
