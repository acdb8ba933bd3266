"""Simulations put together from parts, and taken up again from what was saved."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np

from jaxnc.dynamics.simulation import Simulation
from jaxnc.errors import InputError, ModelFileError
from jaxnc.kinematics.motion import Motion
from jaxnc.system.system import System


def joined(parts: list[Simulation]) -> Simulation:
    """One simulation of several, each of which begins where the one before ends."""
    first, last = parts[0], parts[-1]
    if len(parts) == 1:
        return first

    def together(of):
        return jnp.concatenate([of(p) if k == 0 else of(p)[1:] for k, p in enumerate(parts)])

    return Simulation(
        system=first.system,
        driven=first.driven,
        held=(),
        poses=together(lambda p: p.q),
        rates=tuple(together(lambda p, k=k: p.rates[k]) for k in range(2)),
        asked=together(lambda p: p.asked),
        status=together(lambda p: p.status),
        residual=together(lambda p: p.residual),
        conditioning=together(lambda p: p.conditioning),
        time=together(lambda p: p.time),
        multipliers=together(lambda p: p.multipliers),
        violation=tuple(max(float(p.violation[k]) for p in parts) for k in range(2)),
        correction=first.correction,
        steps=tuple(sum(int(p.steps[k]) for p in parts) for k in range(2)),
        end=last.end,
    )


def last_state(system: System, path: str | Path) -> tuple[float, Motion]:
    """The last state of a table that `Motion.to_npz` wrote: its time, and the pose with its rates.

    Raises:
        InputError: the table is of another mechanism, or carries no time or velocities.
        ModelFileError: it cannot be read.
    """
    top = system.topology
    try:
        with np.load(path) as table:
            data = dict(table)
    except (OSError, ValueError) as error:
        raise ModelFileError(f"{path}: no table of a simulation can be read there ({error})") from None
    names = (*top.points, *top.vectors, *top.scalars)
    orders = _orders(data)
    if "time" not in data or len(orders) < 2:
        raise InputError(f"{path}: this table carries no time or no velocities; resume from one that simulate wrote")
    if any(f"{order}/{n}" not in data for n in names for order in orders[:2]):
        raise InputError(f"{path}: this table is of another mechanism than {top.name!r}")
    good = np.flatnonzero(data["status"] == 0)
    if not len(good):
        raise InputError(f"{path}: no time of it was reached")
    k = int(good[-1])
    rows = [np.concatenate([np.asarray(data[f"{order}/{n}"])[k].reshape(-1) for n in names]) for order in orders[:2]]
    zero = jnp.zeros(())
    q, v = (jnp.asarray(r) for r in rows)
    return float(data["time"][k]), Motion(
        system, (), (), q, (v,), jnp.zeros(0), zero.astype(int), zero, zero + 1.0, jnp.asarray(data["time"][k])
    )


def _orders(data: dict) -> list[str]:
    """Folders of the table in the order of differentiation."""
    found = {k.split("/")[0] for k in data if "/" in k}
    return [o for o in ("position", "velocity", "acceleration") if o in found]
