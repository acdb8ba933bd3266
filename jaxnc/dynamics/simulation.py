"""`Simulation`: a motion under forces, with its multipliers, its energy, and what the integration says of itself."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.calls import public
from jaxnc.compiling import on_device
from jaxnc.dynamics.balance import EnergyBalance, energy_balance
from jaxnc.dynamics.energy import energy
from jaxnc.internals import outermost
from jaxnc.kinematics.inputs import outside
from jaxnc.kinematics.motion import Motion
from jaxnc.records import record
from jaxnc.status import Status
from jaxnc.types import Array


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
        """What the integration says of itself, in a few lines."""
        outside(self, "report()")
        t, status = np.asarray(self.time), np.asarray(self.status)
        bad = int(np.sum(status != 0))
        first, second = (float(x) for x in self.violation)
        pose, rate = (float(x) for x in self.correction)
        lines = [f"{self.system.name}: {t[0]:g} s to {float(self.end):.9g} s, {len(t)} times kept"]
        if self.steps is not None:
            made, rejected = (int(x) for x in self.steps)
            lines.append(f"  steps                 {made}" + (f" and {rejected} rejected" if rejected else ""))
        lines += [
            *_account(self.balance),
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


def _account(found: EnergyBalance) -> list[str]:
    """The energy balance in lines: what is stored, what came and went, and the error."""
    last = np.flatnonzero(np.isfinite(found.error))[-1:]
    if not len(last):
        return []
    k = int(last[0])
    parts = {"inputs": found.inputs, "loads": found.loads}
    parts |= {"dampers": -found.dissipated, "friction": -found.friction}
    work = [f"{x[k]:.6g} J by {name}" for name, x in parts.items() if np.nanmax(np.abs(x)) > 0]
    return [
        f"  energy                {found.total[0]:.9g} J at the start, {found.total[k]:.9g} J at the end",
        *([f"  work                  {', '.join(work)}"] if work else []),
        f"  energy balance        {found.sentence}",
    ]
