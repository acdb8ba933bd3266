"""`jaxnc simulate`: a mechanism moved under its forces, in parts between which its table is saved."""

import argparse
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import jax
import jax.numpy as jnp
import msgspec
import numpy as np

from jaxnc.cli.output import Task, write_files
from jaxnc.cli.question import Question, read_number, read_pair
from jaxnc.dynamics.simulate import FIXED, simulate
from jaxnc.dynamics.simulation import Simulation, join
from jaxnc.errors import InputError
from jaxnc.io.drives import check_driven
from jaxnc.io.tables import load_npz, to_csv, to_npz
from jaxnc.io.target import stem
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.progress import step_bar
from jaxnc.reporting.outcome import enter_simulation, in_radians, outputs_of
from jaxnc.system.system import System

_TABLE = "-simulation.npz"


def do_simulate(question: Question, options: argparse.Namespace, importing: float) -> int:
    """Move a model file under its forces; the exit code."""
    mechanism = question.mechanism
    section = _simulation_section(mechanism, options)
    assert section.duration is not None
    begin = time.perf_counter()
    system = mechanism.compile()
    first, earlier = 0.0, None
    state, rates = (in_radians(mechanism, values) or None for values in (section.start, section.rates))
    if options.resume:
        earlier = _load_states(system, options.resume)
        state, rates = earlier.pose(-1), None
        first = float(np.asarray(earlier.time)[-1])
        if first >= section.duration:
            raise InputError(f"{options.resume} already goes to {first:g} s; give a longer --duration")
    t = np.linspace(first, section.duration, section.times)
    # The table is saved, and progress shown, between at most ten equal parts of the simulation.
    count = max(k for k in range(1, 11) if (len(t) - 1) % k == 0)
    width = (len(t) - 1) // count
    parts: list[Simulation] = []
    compiling = 0.0

    def whole() -> Motion:
        """The motion of an earlier table, and what was added to it."""
        run = join(parts)
        return run if earlier is None else _append_run(earlier, run)

    with step_bar(count) as step:
        for k in range(count):
            step(f"{t[k * width]:.3g} s")
            at = t[k * width : (k + 1) * width + 1]
            run = simulate(system, at, state, rates, section.method, step=section.step, rtol=section.rtol, throw=False)
            jax.block_until_ready(run.q)
            parts.append(run)
            compiling = compiling or time.perf_counter() - begin
            if options.out is not None:
                to_npz(whole(), Path(options.out) / (stem(mechanism.name) + _TABLE))
            if int(np.asarray(run.status)[-1]):
                break
            state, rates = run.pose(-1), None
    run = join(parts)
    seconds = time.perf_counter() - begin
    enter_simulation(options.verdict, run, section.duration)
    print(run.report())
    if earlier is not None:
        print(f"  taken up              at {first:g} s from {options.resume}; files hold what came before as well")
    print(f"  time                  {seconds:.2f} s, of which {compiling:.2f} s to compile and for the first part")
    print(f"  importing             {importing:.2f} s")
    write_files(options, mechanism.name, _simulation_files(mechanism, whole, options), "tables and pictures")
    return int(bool(np.asarray(run.status).any()))


def _load_states(system: System, path: str) -> Motion:
    """Read the states of a table that a simulation wrote, as far as they were reached; the last one resumes it."""
    top, table = system.topology, load_npz(path)
    names = (*top.points, *top.vectors, *top.scalars)
    orders = [found for found in (table.positions, table.velocities, table.accelerations) if found]
    if table.time is None or len(orders) < 2:
        raise InputError(f"{path}: this table carries no time or no velocities; resume from one that simulate wrote")
    if any(name not in found for name in names for found in orders):
        raise InputError(f"{path}: this table is of another mechanism than {top.name!r}")
    good = np.flatnonzero(table.status == 0)
    if not len(good):
        raise InputError(f"{path}: no time of it was reached")
    columns = ([found[name].reshape(len(table.status), -1) for name in names] for found in orders)
    q, *rates = (jnp.asarray(np.concatenate(x, axis=1)[good]) for x in columns)
    residual, time = (jnp.asarray(x[good]) for x in (table.residual, table.time))
    none, right = jnp.zeros((len(good), 0)), jnp.zeros(len(good), int)
    return Motion(system, (), (), q, tuple(rates), none, right, residual, None, time)


def _append_run(earlier: Motion, run: Motion) -> Motion:
    """Join an earlier motion and a run that begins where it ends."""
    orders = min(len(earlier.rates), len(run.rates))
    parts = [(m.q, m.rates[:orders], m.asked, m.status, m.residual, None, m.time) for m in (earlier, run)]
    q, rates, *rest = jax.tree.map(lambda a, b: jnp.concatenate([a, b[1:]]), *parts)
    return Motion(run.system, run.driven, (), q, rates, *rest)


def _simulation_section(mechanism: Mechanism, options: argparse.Namespace) -> record.Simulation:
    """The section [simulate] of a mechanism, changed as the options say."""
    section = mechanism.model.simulate
    changed = {k: v for k in ("duration", "times", "method", "step", "rtol") if (v := getattr(options, k)) is not None}
    section = msgspec.structs.replace(section, **changed)
    if options.rtol is not None and section.method in FIXED:
        raise InputError(f"--rtol is for steps that follow their errors; {section.method} has --step")
    rates = dict(section.rates)
    for text in options.rate:
        name, value = read_pair(text, "--rate", "NAME=RATE, for instance phi=10 or phi=90deg")
        check_driven(mechanism, name, f"--rate {text}")
        rates[name] = read_number(mechanism, name, value, f"--rate {text}")
    section = msgspec.structs.replace(section, rates=rates)
    if section.duration is None:
        raise InputError(
            f"{mechanism.name!r} does not say how long; add --duration SECONDS, or a table [simulate] with duration = …"
        )
    if not (math.isfinite(section.duration) and section.duration > 0):
        raise InputError(f"--duration {section.duration}: seconds must be a positive number")
    if section.times < 2:
        raise InputError(f"--times {section.times}: keep at least 2")
    return section


def _simulation_files(mechanism: Mechanism, whole: Callable[[], Motion], options: argparse.Namespace) -> Iterator[Task]:
    """Yield tables and pictures of a simulation, for `write_files`."""
    from jaxnc import viz

    run = whole()
    top = run.system.topology
    outputs = outputs_of(run, mechanism.model.run.outputs)
    trace = [name for name in outputs if name in (*top.points, *(m.name for m in top.markers))]
    yield "-simulation.csv", "every time kept, as a table", lambda p: to_csv(run, p)
    # The arrays were saved part by part.
    yield _TABLE, "the same as arrays; --resume goes on from its last state", lambda p: None
    yield "-energy.png", "energies over time", lambda p: viz.plot_energy(run, p)
    yield "-start.png", "the mechanism at the start", lambda p: viz.draw(run, pose=0, path=p, trace=trace)
    courses = f"{', '.join(outputs)} over time"
    yield "-simulation-plots.png", courses, lambda p: viz.plot(run, *outputs, against="time", path=p)
    if not (options.no_html or options.no_pictures):
        page = "a page where the motion is played, opens in any browser"
        yield "-simulation.html", page, lambda p: viz.to_html(run, p, trace=trace, model=mechanism)
    if options.animate:
        what = "the motion, in real time where that can be followed"
        yield "-simulation.gif", what, lambda p: viz.animate(run, p, trace=trace)
