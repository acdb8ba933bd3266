"""A wheel's numbers in poses that the host has found: read once as functions of one pose, nothing compiled."""

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


def told(motion: Motion, what: What, names: tuple[str, ...], radius: Any) -> dict[str, np.ndarray | None]:
    """The numbers of a wheel in all poses of a motion.

    Args:
        motion: the poses.
        what: what is asked.
        names: of the numbers: those of a `jaxnc.kinematics.Suspension`.
        radius: of the tyre, if it is not read off the drawing.

    Returns:
        Each number ``(...,)``, a place ``(..., 3)``; None where there is nothing to tell it by.
    """
    eq = derive(motion.system)
    q: Any = motion.poses
    state = np.concatenate([q, *(tangents(motion, name) for name in what.inputs)], axis=-1)
    wanted = tuple(name for name in names if tells(what, name))
    given = (eq.home, eq.markers, np.asarray(np.nan if radius is None else radius, q.dtype))
    found = on_lanes(in_one_pose, (motion.system.topology, what, wanted, radius is None), state, (), given)
    out: dict[str, np.ndarray | None] = dict.fromkeys(names)
    for k, name in enumerate(wanted):
        out[name] = found[..., k:] if name == "contact" else found[..., k]
    return out


def tangents(motion: Motion, name: str) -> np.ndarray:
    """Derivatives of all coordinates by one input, the others held, ``(..., N)``; zero where a pose was not found."""
    view = plan(motion.system.topology, motion.driven, motion.held, motion.system.degrees_of_freedom)
    inner = host.HostView(view, from_jax(derive(motion.system)))
    q: Any = motion.poses
    flat, good = q.reshape(-1, q.shape[-1]), np.asarray(motion.converged).reshape(-1)
    out = np.zeros_like(flat)
    if good.any():
        pace = np.array([float(name == other) for other in (*motion.driven, *motion.held)], q.dtype)
        with np.errstate(all="ignore"):
            (found,) = host.rates(inner, flat[good].T, [np.repeat(pace[:, None], good.sum(), axis=1)])
        out[good] = found.T
    return out.reshape(q.shape)
