"""The lanes of one call shared out over devices. The library's own way goes here as soon as it has one."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

import jaxnc as nc

HOW = "jax.shard_map around solve_position"
Solver = Callable[[Any], tuple[Any, Any]]


def solver(system: nc.System, devices: Sequence[Any]) -> Solver:
    """A function of angles ``(N,)`` to points C ``(N, 2)`` and statuses, its lanes shared out over `devices`."""

    def part(phi):
        motion = nc.solve_position(system, {"phi": phi}, throw=False)
        return motion["C"], motion.status

    return shared(part, devices)


def shared(part: Solver, devices: Sequence[Any]) -> Solver:
    """Any function of lanes, each device doing its own."""
    if len(devices) == 1:
        return jax.jit(part)
    mesh, lanes = Mesh(np.array(devices), ("lanes",)), PartitionSpec("lanes")
    return jax.jit(jax.shard_map(part, mesh=mesh, in_specs=lanes, out_specs=lanes, check_vma=False))


def placed(values: np.ndarray, devices: Sequence[Any]) -> jax.Array:
    """Angles where the devices want them."""
    if len(devices) == 1:
        return jax.device_put(values, devices[0])
    return jax.device_put(values, NamedSharding(Mesh(np.array(devices), ("lanes",)), PartitionSpec("lanes")))
