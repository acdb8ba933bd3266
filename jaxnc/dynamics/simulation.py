"""`Simulation`: a motion under forces, with its multipliers, its energy, and what the integration says of itself.

Simulations are put together from parts.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.compiling import on_device
from jaxnc.dynamics.energy import EnergyBalance, energy, energy_balance
from jaxnc.internals import outermost
from jaxnc.kinematics.inputs import check_parameters, outside
from jaxnc.kinematics.motion import Motion
from jaxnc.records import record
from jaxnc.status import Status
from jaxnc.types import Array, PyTree


@public
@record
class Simulation(Motion):
    """States of a mechanism that moves under forces: a `Motion` in time, and more.

    Attributes:
        multipliers: Lagrange multipliers of all rows, ``(T, rows)``, N (M q̈ + Φ_qᵀ λ + Bᵀ μ = Q), last those of
            rows on velocities.
        violation: largest residual of the constraints, and of their rates, over the run: two numbers.
        correction: how much the given start was changed to be consistent: pose (length) and rates.
        steps: steps made, and steps rejected; None where the integrator was not this library's.
        end: the time at which it ended, s.
    """

    multipliers: Array | None = None
    violation: Any = None
    correction: Any = None
    steps: Any = None
    end: Any = None

    @property
    def energy(self) -> Array:
        """Kinetic and potential energy at all times, J."""
        return energy(self)

    @property
    def drift(self) -> Array:
        """Largest change of the energy since the start, J. Of a conservative motion: the integrator's error."""
        found = self.energy
        if not isinstance(found, Tracer) and outermost():
            e = np.asarray(found)
            return on_device(np.max(np.where(np.asarray(self.converged), np.abs(e - e[..., :1]), 0.0)))
        return jnp.max(jnp.where(self.converged, jnp.abs(found - found[..., :1]), 0.0))

    @property
    def balance(self) -> EnergyBalance:
        """Where the energy comes from and goes to, and by how much the account is wrong; see `EnergyBalance`."""
        return energy_balance(self)

    def report(self) -> str:
        """Report on the integration, in a few lines."""
        outside(self, "report()")
        check_parameters(self.system)
        t, status = np.asarray(self.time), np.asarray(self.status)
        bad = int(np.sum(status != 0))
        first, second = (float(x) for x in self.violation)
        pose, rate = (float(x) for x in self.correction)
        lines = [f"{self.system.name}: {t[0]:g} s to {float(self.end):.9g} s, {len(t)} times kept"]
        if self.steps is not None:
            made, rejected = (int(x) for x in self.steps)
            lines.append(f"  steps                 {made}" + (f" and {rejected} rejected" if rejected else ""))
        lines += [
            *_balance_lines(self.balance),
            f"  constraints           met to {first:.3g}, their rates to {second:.3g}",
            f"  start corrected by    {pose:.3g} (pose), {rate:.3g} (rates)",
        ]
        if bad:
            lines.append(f"  {bad} times not reached: {Status(int(status[status != 0][0])).sentence}")
        return "\n".join(lines)

    def __repr__(self) -> str:
        try:
            times = f"{self.status.shape[-1]} times" if self.status.shape else "one time"
            failed = int(np.sum(np.asarray(self.status) != 0))
            return f"Simulation({self.system.name!r}: {times}, " + (
                f"{failed} not reached)" if failed else "all reached)"
            )
        except (jax.errors.TracerArrayConversionError, jax.errors.ConcretizationTypeError):
            return f"Simulation({self.system.name!r}: traced)"


def _balance_lines(found: EnergyBalance) -> list[str]:
    """Write the energy balance in lines: what is stored, what came and went, and the error."""
    last = np.flatnonzero(np.isfinite(found.error))[-1:]
    if not len(last):
        return []
    k = int(last[0])
    parts = {"inputs": found.inputs, "loads": found.loads}
    parts |= {"dampers": -found.dissipated, "friction": -found.friction}
    work = [f"{x[k]:.6g} {found.unit} by {name}" for name, x in parts.items() if np.nanmax(np.abs(x)) > 0]
    first, last = (f"{found.total[j]:.9g} {found.unit}" for j in (0, k))
    return [
        f"  energy                {first} at the start, {last} at the end",
        *([f"  work                  {', '.join(work)}"] if work else []),
        f"  energy balance        {found.sentence}",
    ]


def join_fields(
    parts: Sequence[Mapping[str, PyTree]], lengths: Sequence[int] | None = None, count: int = 0
) -> dict[str, PyTree]:
    """Join the fields of simulations, each of which begins where the one before ends.

    Args:
        parts: the fields by name.
        lengths: how many times of each part count; all if not given.
        count: so many times there are in the end: what was not reached holds the last state.
    """

    def together(*each: Any) -> Array:
        ends = lengths or [len(x) for x in each]
        whole = np.concatenate([np.asarray(x)[bool(k) : n] for k, (x, n) in enumerate(zip(each, ends, strict=True))])
        return on_device(np.concatenate([whole, np.repeat(whole[-1:], max(count - len(whole), 0), axis=0)]))

    def pairs(name: str) -> Any:
        return zip(*(jax.tree.map(np.asarray, part[name]) for part in parts), strict=True)

    names = ("poses", "rates", "asked", "status", "residual", "multipliers")
    return {name: jax.tree.map(together, *(part[name] for part in parts)) for name in names} | {
        "violation": tuple(on_device(np.max(x, axis=0)) for x in pairs("violation")),
        "correction": parts[0]["correction"],
        "steps": tuple(on_device(np.sum(x, axis=0, dtype=np.int32)) for x in pairs("steps")),
        "end": parts[-1]["end"],
    }


def join(parts: Sequence[Simulation]) -> Simulation:
    """Join simulations to one, each of which begins where the one before ends."""
    if len(parts) == 1:
        return parts[0]
    names = ("rates", "asked", "status", "residual", "multipliers", "violation", "correction", "steps", "end")
    fields = join_fields([{"poses": part.q, **{name: getattr(part, name) for name in names}} for part in parts])
    time = np.concatenate([np.asarray(part.time)[bool(k) :] for k, part in enumerate(parts)])
    return dataclasses.replace(parts[0], time=on_device(time), **fields)
