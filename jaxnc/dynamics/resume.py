"""Simulations put together from parts, and taken up again from what was saved."""

from pathlib import Path

import jax
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
        conditioning=None,
        time=together(lambda p: p.time),
        multipliers=together(lambda p: p.multipliers),
        violation=tuple(max(float(p.violation[k]) for p in parts) for k in range(2)),
        correction=first.correction,
        steps=tuple(sum(int(p.steps[k]) for p in parts) for k in range(2)),
        end=last.end,
    )


def saved(system: System, path: str | Path) -> Motion:
    """The states in a table that `Motion.to_npz` wrote, as far as they were reached.

    Returns:
        Poses with their rates and times; accelerations too, if the table has them. The last one resumes the motion.
    """
    top = system.topology
    try:
        with np.load(path) as table:
            data = dict(table)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or "it is no npz file"
        raise ModelFileError(f"{path}: no table of a simulation can be read there ({why})") from None
    names = (*top.points, *top.vectors, *top.scalars)
    orders = _orders(data)
    if "time" not in data or len(orders) < 2:
        raise InputError(f"{path}: this table carries no time or no velocities; resume from one that simulate wrote")
    if any(f"{order}/{n}" not in data for n in names for order in orders):
        raise InputError(f"{path}: this table is of another mechanism than {top.name!r}")
    good = np.flatnonzero(data["status"] == 0)
    if not len(good):
        raise InputError(f"{path}: no time of it was reached")
    count = len(data["status"])
    q, *rates = (
        jnp.asarray(np.concatenate([data[f"{order}/{n}"].reshape(count, -1) for n in names], axis=1)[good])
        for order in orders
    )
    zero, residual, time = jnp.zeros(len(good)), *(jnp.asarray(data[k])[good] for k in ("residual", "time"))
    none = jnp.zeros((len(good), 0))
    return Motion(system, (), (), q, tuple(rates), none, zero.astype(int), residual, None, time)


def after(earlier: Motion, run: Motion) -> Motion:
    """One motion of an earlier one and of what begins where that ends."""
    orders = min(len(earlier.rates), len(run.rates))
    residual = None if earlier.residual is None else run.residual
    both = (earlier, earlier.residual), (run, residual)
    parts = [(m.q, m.rates[:orders], m.asked, m.status, size, None, m.time) for m, size in both]
    q, rates, *rest = jax.tree.map(lambda a, b: jnp.concatenate([a, b[1:]]), *parts)
    return Motion(run.system, run.driven, (), q, rates, *rest)


def _orders(data: dict) -> list[str]:
    """Folders of the table in the order of differentiation."""
    found = {k.split("/")[0] for k in data if "/" in k}
    return [o for o in ("position", "velocity", "acceleration") if o in found]
