"""`jaxnc simulate`."""

import argparse
import math
import time
from pathlib import Path

import jax
import msgspec
import numpy as np

from jaxnc.cli.progress import progress
from jaxnc.cli.question import Question, stem
from jaxnc.cli.settings import number, pair
from jaxnc.cli.written import listing
from jaxnc.dynamics.simulate import simulate as integrate
from jaxnc.dynamics.simulation import Simulation, append_run, join, load_states
from jaxnc.errors import InputError, MechanismError
from jaxnc.io.drives import check_driven
from jaxnc.io.files import blame
from jaxnc.io.tables import to_csv, to_npz
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.reporting.outcome import enter_simulation, in_radians, outputs_of

_PARTS = 10  # of a simulation, between which progress is shown and the table is saved


def simulate(asked: Question, options: argparse.Namespace, importing: float) -> int:
    """Move a model file under its forces; the exit code."""
    mechanism = asked.mechanism
    section = _section(mechanism, options)
    begin = time.perf_counter()
    try:
        system = mechanism.compile()
    except MechanismError as error:
        raise blame(options.file, error) from None
    first, state, rates = (
        0.0,
        in_radians(mechanism, section.start) or None,
        in_radians(mechanism, section.rates) or None,
    )
    assert section.duration is not None
    earlier = None
    if options.resume:
        earlier = load_states(system, options.resume)
        state, rates = earlier.pose(-1), None
        first = float(np.asarray(earlier.time)[-1])
        if first >= section.duration:
            raise InputError(f"{options.resume} already goes to {first:g} s; give a longer --duration")
    t = np.linspace(first, section.duration, section.times)
    count = max(k for k in range(1, _PARTS + 1) if (len(t) - 1) % k == 0)
    width = (len(t) - 1) // count
    base = None if options.out is None else Path(options.out) / stem(mechanism.name)
    parts: list[Simulation] = []
    compiling = 0.0
    with progress(count) as step:
        for k in range(count):
            step(f"{t[k * width]:.3g} s")
            at = t[k * width : (k + 1) * width + 1]
            run = integrate(system, at, state, rates, section.method, step=section.step, rtol=section.rtol, throw=False)
            jax.block_until_ready(run.q)
            parts.append(run)
            compiling = compiling or time.perf_counter() - begin
            if base is not None:
                to_npz(_whole(earlier, parts), base.with_name(base.name + "-simulation.npz"))
            if int(np.asarray(run.status)[-1]):
                break
            state, rates = run.pose(-1), None
    run = join(parts)
    whole = time.perf_counter() - begin
    enter_simulation(options.verdict, run, section.duration)
    print(run.report())
    if earlier is not None:
        print(f"  taken up              at {first:g} s from {options.resume}; files hold what came before as well")
    print(f"  time                  {whole:.2f} s, of which {compiling:.2f} s to compile and for the first part")
    print(f"  importing             {importing:.2f} s")
    if base is None:
        print("  no files written; --out DIR writes tables and pictures")
    else:
        print(listing(_files(mechanism, _whole(earlier, parts), base, options), options.verdict))
    return int(bool(np.asarray(run.status).any()))


def _whole(earlier: Motion | None, parts: list[Simulation]) -> Motion:
    """All that is known: what a table held, and what was added to it."""
    run = join(parts)
    return run if earlier is None else append_run(earlier, run)


def _section(mechanism: Mechanism, options: argparse.Namespace) -> record.Simulation:
    section = mechanism.model.simulate
    changed = {k: v for k in ("duration", "times", "method", "step", "rtol") if (v := getattr(options, k)) is not None}
    section = msgspec.structs.replace(section, **changed)
    rates = dict(section.rates)
    for text in options.rate:
        name, value = pair(text, "--rate", "NAME=RATE, for instance phi=10 or phi=90deg")
        check_driven(mechanism, name, f"--rate {text}")
        rates[name] = number(mechanism, name, value, f"--rate {text}")
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


def _files(mechanism: Mechanism, run: Motion, base: Path, options: argparse.Namespace) -> list[tuple[Path, str]]:
    from jaxnc import viz

    top = run.system.topology
    outputs = outputs_of(run, mechanism.model.run.outputs)
    traced = [name for name in outputs if name in (*top.points, *(m.name for m in top.markers))]

    def at(ending: str) -> Path:
        return base.with_name(base.name + ending)

    files = [(to_csv(run, at("-simulation.csv")), "every time kept, as a table")]
    files.append((at("-simulation.npz"), "the same as arrays; --resume goes on from its last state"))
    if not options.no_pictures:
        viz.plot_energy(run, at("-energy.png"))
        files.append((at("-energy.png"), "energies over time"))
        viz.draw(run, pose=0, path=at("-start.png"), trace=traced)
        files.append((at("-start.png"), "the mechanism at the start"))
        viz.plot(run, *outputs, against="time", path=at("-simulation-plots.png"))
        files.append((at("-simulation-plots.png"), f"{', '.join(outputs)} over time"))
        if not options.no_html:
            viz.to_html(run, at("-simulation.html"), trace=traced, model=mechanism)
            files.append((at("-simulation.html"), "a page where the motion is played, opens in any browser"))
    if options.animate:
        viz.animate(run, at("-simulation.gif"), trace=traced)
        files.append((at("-simulation.gif"), "the motion, in real time where that can be followed"))
    return files
