"""What is said of a motion under forces."""

import numpy as np

from jaxnc.dynamics.simulate import simulate
from jaxnc.dynamics.simulation import Simulation
from jaxnc.io.drives import unit_of
from jaxnc.mechanism import Mechanism
from jaxnc.reporting.quantity import Quantity
from jaxnc.reporting.verdict import Simulated, Verdict, number
from jaxnc.status import Status
from jaxnc.system.system import System


def in_radians(mechanism: Mechanism, values: dict[str, float]) -> dict[str, float]:
    """Values of a model's sections in radians and lengths."""
    return {name: value * unit_of(mechanism, name) for name, value in values.items()}


def as_it_says(mechanism: Mechanism, system: System) -> Simulation:
    """Simulate a mechanism as its section ``[simulate]`` says, which has a duration."""
    section = mechanism.model.simulate
    t = np.linspace(0.0, section.duration or 0.0, section.times)
    start, rates = (in_radians(mechanism, values) or None for values in (section.start, section.rates))
    return simulate(system, t, start, rates, section.method, step=section.step, rtol=section.rtol, throw=False)


def enter_simulation(verdict: Verdict, run: Simulation, asked_end: float | None = None) -> None:
    """Enter what came of a simulation."""
    top, status, energy = run.system.topology, np.asarray(run.status), np.asarray(run.energy)
    verdict.name, verdict.length_unit, verdict.angle_unit = top.name, top.length_unit, top.angle_unit
    made, rejected = map(int, run.steps)
    good, t = np.flatnonzero(status == 0), np.asarray(run.time)
    last = int(good[-1]) if len(good) else 0
    verdict.simulation = Simulated(
        start=float(t[0]),
        end=float(run.end),
        asked_end=float(t[-1]) if asked_end is None else asked_end,
        steps=made,
        rejected=rejected,
        energy_start=number(energy[0]),
        energy_end=number(energy[last]),
        balance_error=number(np.nanmax(np.abs(run.balance.error), initial=0.0)),
        violation=number(max(map(float, run.violation))),
    )
    verdict.assembles = verdict.moves = bool(len(good))
    verdict.does = not status.any()
    if status.any():
        why = Status(int(status[status != 0][0]))
        verdict.add("broke-off", "error", f"{int((status != 0).sum())} times not reached: {why.sentence}")


def energies(run: Simulation) -> list[Quantity]:
    """What is stored, and what came and went since the start, J; only what is not always zero."""
    found = run.balance
    parts = {"stored": found.total, "work of inputs": found.inputs, "work of loads": found.loads}
    parts |= {"taken by dampers": found.dissipated, "taken by friction": found.friction}
    size = max(float(np.nanmax(np.abs(x), initial=0.0)) for x in parts.values())
    return [
        Quantity(name, "J", np.asarray(x), size) for name, x in parts.items() if np.nanmax(np.abs(x), initial=0.0) > 0
    ]
