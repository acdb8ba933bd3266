"""What is asked of a simulation: all that a program of it is traced for, and all numbers that it depends on."""

import dataclasses
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from jaxnc.dynamics.extended import extended
from jaxnc.dynamics.flow import Flow
from jaxnc.dynamics.model import dynamics
from jaxnc.remembered import with_owner
from jaxnc.system.system import Parameters, System
from jaxnc.system.topology import Topology, interned
from jaxnc.types import Array


class Asked(NamedTuple):
    """What is asked for, but for numbers."""

    topology: Topology  # the system's
    degrees_of_freedom: int  # and its count
    independent: tuple[str, ...]  # coordinates that the others follow from
    method: str  # the integrator
    drives: tuple[tuple[str, Callable], ...]  # driven coordinates, functions of time
    singular: bool  # whether rows may become redundant
    steps: int  # between two times, of a method of fixed step
    event: Callable | None  # what ends the motion
    places: tuple[int, ...] | None  # of rates that were given by name

    def system(self, parameters: Parameters) -> System:
        """The system with some parameters."""
        return System(self.topology, parameters, self.degrees_of_freedom, self.independent)

    def nameless(self) -> "Asked":
        """The same of the mechanism without names; as it is, where functions of the user's ask by name."""
        bare = nameless(self.topology)
        if self.event is not None or bare is self.topology:
            return self

        def called(names: Iterable[str]) -> tuple[str, ...]:
            return bare.named(self.topology.position[name] for name in names)

        functions = [f for _, f in self.drives]
        drives = tuple(zip(called(name for name, _ in self.drives), functions, strict=True))
        return self._replace(topology=bare, independent=called(self.independent), drives=drives)


class Numbers(NamedTuple):
    """All numbers that a simulation depends on."""

    parameters: Parameters  # of the system
    state: Any  # a pose (N,), values by name, or None for the drawing
    rates: Any  # of all coordinates of the system (N,), of those in `places`, or None
    t: Array  # times
    event: Any  # parameters of the event
    more: tuple[tuple[Array, ...], ...]  # further arguments of the drives' functions
    control: Any  # how long steps are, a `Control`; not differentiated


@with_owner
def nameless(top: Topology) -> Topology:
    """A mechanism's structure with its loads, without names: what its motion is traced for.

    As it is, where forces are functions, which ask by name, or where reactions are needed for friction.
    """
    loads = top.loads
    if loads.functions or loads.friction:
        return top
    numbers = {f"{body.name} across": f"b{k} across" for k, body in enumerate(top.bodies)}
    bare = top.structure
    return interned(
        dataclasses.replace(
            bare,
            bodies=tuple(dataclasses.replace(body, name=f"b{k}") for k, body in enumerate(bare.bodies)),
            loads=dataclasses.replace(
                loads,
                physical=tuple(f"n{k}" for k in range(len(loads.physical))),
                inertias=tuple(tuple(dataclasses.replace(i, body="") for i in group) for group in loads.inertias),
                forces=tuple(dataclasses.replace(f, names=("",) * len(f.names)) for f in loads.forces),
                hidden=tuple(numbers[name] for name in loads.hidden),
            ),
            rates=tuple(dataclasses.replace(b, owners=((),) * b.count) for b in top.rates),
            extended=None if top.extended is None else nameless(top.extended),
        )
    )


def flow_of(asked: Asked, system: System) -> Flow:
    """The motion of a system."""
    return Flow.of(dynamics(extended(system)), asked.degrees_of_freedom, asked.drives, asked.singular)


def without_names(flow: Flow, asked: Asked) -> Flow:
    """The motion of the same design as one without names: `asked` is nameless."""
    inner = asked.topology.extended or asked.topology
    system = dataclasses.replace(flow.dyn.system, topology=inner, independent=())
    return dataclasses.replace(flow, dyn=dataclasses.replace(flow.dyn, system=system), drives=asked.drives)
