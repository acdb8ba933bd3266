"""One analysis: the mechanism compiled and moved, with the time that each part took."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from jaxnc.cli.progress import progress
from jaxnc.errors import InputError
from jaxnc.io.drives import sweep_arguments
from jaxnc.kinematics.arc import circuit
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position, sweep
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.reporting.expected import check_expected
from jaxnc.system.system import System

_LONG = 30.0  # seconds: a first call that takes longer is not repeated only to be timed


@dataclass(frozen=True)
class Analysis:
    """A motion and what is known about it."""

    mechanism: Mechanism  # what was described
    system: System  # the same, compiled
    run: record.Run  # how it was driven
    asked: Mapping[str, np.ndarray]  # values of the inputs that were asked for, radians and lengths, each (T,)
    motion: Motion  # what came of it
    compiling: float  # seconds of compiling and the first call
    running: float | None  # seconds of a second call; None if there was none


def analyse(mechanism: Mechanism, run: record.Run, expect: Sequence[str] = ()) -> Analysis:
    """Compile a mechanism and move it as a run section says; poses that failed have a status.

    What is expected of it (``--expect``) is read before it is moved.
    """
    arguments = sweep_arguments(mechanism, run)
    begin = time.perf_counter()
    running = None
    with progress(3) as step:
        step("compiling the mechanism")
        system = mechanism.compile()
        check_expected(system, arguments, expect)
        step("compiling its motion")
        motion = _timed(system, run, arguments)
        first = time.perf_counter()
        if first - begin < _LONG:
            step("moving it")
            motion = _timed(system, run, arguments)
            running = time.perf_counter() - first
    return Analysis(mechanism, system, run, arguments["inputs"], motion, first - begin, running)


def _timed(system: System, run: record.Run, arguments: Mapping[str, Any]) -> Motion:
    if run.analysis == "circuit":
        motion = _around(system, **arguments)
    elif run.analysis == "solve_position":
        motion = solve_position(system, throw=False, **arguments)
    else:
        motion = sweep(system, **arguments)
    jax.block_until_ready((motion.q, motion.rates, motion.status))
    return motion


def _around(system: System, inputs: Mapping[str, np.ndarray], rates: Any, hold: tuple[str, ...]) -> Motion:
    """The poses of a circuit in the range of the only input; nothing is driven there, so that it has no rates."""
    if len(inputs) != 1:
        raise InputError(f"a circuit is that of one input, got {', '.join(inputs)}: hold the others")
    name, values = next(iter(inputs.items()))
    return circuit(system, name, (values[0], values[-1]), len(values), hold)
