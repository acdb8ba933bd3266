"""A wheel's numbers in poses that the host has found: read once as functions of one pose, nothing compiled."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.wheel import in_one_pose, tells
from jaxnc.kinematics.wheel_parts import What
from jaxnc.solvers import host
from jaxnc.solvers.assembly import derive
from jaxnc.solvers.plan import plan
from jaxnc.system.host import from_jax
from jaxnc.system.on_lanes import on_host, on_lanes


def suits(motion: Motion, radius: Any) -> bool:
    """Whether a wheel's numbers are told by the host: its poses were, and nothing is traced."""
    return not motion.system.topology.large and on_host(motion.poses, motion, radius)


def told(
    motion: Motion, what: What, names: tuple[str, ...], radius: Any, by: str | None = None
) -> dict[str, np.ndarray | None]:
    """The numbers of a wheel ``(...,)``, places ``(..., 3)``, in all poses; None where there is nothing to tell it by.

    The names are those of a `jaxnc.kinematics.Suspension`. With an input in `by` the numbers' derivatives by it are
    told instead, the other inputs held.
    """
    eq = derive(motion.system)
    q: Any = motion.poses
    state = np.concatenate([q, *(tangents(motion, {name: 1.0})[0] for name in what.inputs)], axis=-1)
    change = ()
    if by is not None:
        first, second = tangents(motion, {by: 1.0}, 2)
        change = (np.concatenate([first, *(_mixed(motion, by, second, name) for name in what.inputs)], axis=-1),)
    wanted = tuple(name for name in names if tells(what, name))
    given = (eq.home, eq.markers, np.asarray(np.nan if radius is None else radius, q.dtype))
    fixed = (motion.system.topology, what, wanted, radius is None)
    found = on_lanes(in_one_pose, fixed, state, change, given)
    out: dict[str, np.ndarray | None] = dict.fromkeys(names)
    for k, name in enumerate(wanted):
        out[name] = found[..., k:] if name == "contact" else found[..., k]
    return out


def _mixed(motion: Motion, by: str, second: np.ndarray, name: str) -> np.ndarray:
    """Second derivatives of all coordinates by two inputs, from those along the inputs and along their sum."""
    if name == by:
        return second
    return 0.5 * (tangents(motion, {by: 1.0, name: 1.0}, 2)[1] - second - tangents(motion, {name: 1.0}, 2)[1])


def tangents(motion: Motion, paces: Mapping[str, float], order: int = 1) -> np.ndarray:
    """Derivatives of all coordinates as inputs change at some paces, the others held; zero where a pose was not found.

    Returns:
        First to so many-th derivatives, ``(order, ..., N)``.
    """
    view = plan(motion.system.topology, motion.driven, motion.held, motion.system.degrees_of_freedom)
    inner = host.HostView(view, from_jax(derive(motion.system)))
    q: Any = motion.poses
    flat, good = q.reshape(-1, q.shape[-1]), np.asarray(motion.converged).reshape(-1)
    out = np.zeros((order, *flat.shape), q.dtype)
    if good.any():
        pace = np.array([paces.get(name, 0.0) for name in (*motion.driven, *motion.held)], q.dtype)
        pace = np.repeat(pace[:, None], good.sum(), axis=1)
        with np.errstate(all="ignore"):
            found = host.rates(inner, flat[good].T, [pace, *[np.zeros_like(pace)] * (order - 1)])
        out[:, good] = np.stack(found).transpose(0, 2, 1)
    return out.reshape(order, *q.shape)
