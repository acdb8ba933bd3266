"""Study of a mechanism: `jaxnc.report` looks at it once, and collects all that there is to know."""

import contextlib
import hashlib
import platform
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxnc.calls import public
from jaxnc.dynamics.simulation import Simulation
from jaxnc.errors import AssemblyError, InputError, MechanismError
from jaxnc.exports import version
from jaxnc.io.drives import sweep_arguments
from jaxnc.io.files import json_text, plain
from jaxnc.kinematics.diagnosis import Diagnosis
from jaxnc.kinematics.inputs import make_plan
from jaxnc.kinematics.mobility import Mobility, mobility
from jaxnc.kinematics.motion import Motion
from jaxnc.kinematics.position import solve_position, sweep
from jaxnc.kinematics.sensitivity import Sensitivity, sensitivity
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.notebooks import Reported
from jaxnc.reporting.checked import (
    ZERO,
    Forces,
    Quantity,
    assembly,
    count,
    drives,
    forces,
    locking_parts,
    oddities,
    quantities,
    reach,
    shown_in,
    unit_of,
)
from jaxnc.reporting.outcome import (
    as_it_says,
    carry_out,
    check_expected,
    enter,
    enter_simulation,
    inputs_at,
    judge,
    outputs_of,
    suspension_reports,
    wheel,
    why,
)
from jaxnc.reporting.transmission import Transmission, transmissions
from jaxnc.reporting.verdict import Derivative, Drive, Verdict
from jaxnc.solvers.assembly import derive
from jaxnc.system.assemble import assemble
from jaxnc.system.precision import on_host
from jaxnc.system.system import System
from jaxnc.vehicle.report import SuspensionReport
from jaxnc.viz.poses import POSES, whole_range


@public
@dataclass(frozen=True, repr=False)
class Report(Reported):
    """All that is known of a mechanism: ``print()`` is short, `to_html` writes the page, `verdict` is for machines.

    Attributes:
        name, description: of the mechanism.
        verdict: does it assemble, does it move, does it do what was asked, what is wrong.
        mechanism: what was described; None of a system or a motion.
        system: compiled; None where that is not possible.
        mobility: counts; None where there is no system.
        diagnosis: why it does not assemble, or not where it was asked to; None if it does.
        motion: what came of it; None where it does not move.
        outputs: names of what is looked at.
        quantities: these and their rates over the motion.
        sensitivity: exact derivatives of the outputs with respect to all design variables; None where there are none.
        transmissions: transmission angles of a planar mechanism.
        forces: efforts and reactions; None where nothing has a mass.
        suspensions: reports on a suspension.
        model_text: the text of the model file.
    """

    name: str
    description: str
    verdict: Verdict
    mechanism: Mechanism | None = None
    system: System | None = None
    mobility: Mobility | None = None
    diagnosis: Diagnosis | None = None
    motion: Motion | None = None
    outputs: tuple[str, ...] = ()
    quantities: tuple[Quantity, ...] = ()
    sensitivity: Sensitivity | None = None
    transmissions: tuple[Transmission, ...] = ()
    forces: Forces | None = None
    suspensions: tuple[SuspensionReport, ...] = ()
    model_text: str = field(default="", repr=False)

    def __str__(self) -> str:
        v = self.verdict
        lines = [v.summary if v.summary.startswith(self.name) else f"{self.name}: {v.summary}"]
        if v.counts:
            c = v.counts
            lines.append(
                f"  {c.unknowns} unknowns, {c.equations} equations of rank {c.rank}, freedoms {c.freedoms}, "
                f"redundant {len(c.redundant)}"
            )
        for r in v.reach:
            lower, upper = (r.no_limit if x is None else f"{x:.6g}" for x in (r.lower, r.upper))
            limits = f"from {lower} to {upper} {r.unit}"
            limits = "turns fully" if r.turns else "no dead point was found" if r.lower is r.upper is None else limits
            lines.append(f"  {r.name}: {limits}")
        lines += [f"  {e.quantity}: {e.smallest:.6g} to {e.largest:.6g} {e.unit}".rstrip() for e in v.extremes]
        lines += [f"  {f.level}: {f.text}" for f in v.findings]
        return "\n".join(lines)

    def to_html(self, path: str | Path) -> Path:
        """Write the page: one file that needs no network, for screens and for paper.

        Args:
            path: file ending in ``.html``; missing folders are created.

        Raises:
            OutputError: the file cannot be written.
        """
        from jaxnc.reporting.page import write_page

        return write_page(self, path)


@public
@on_host
def report(
    thing: Mechanism | System | Motion,
    path: str | Path | None = None,
    expect: str | Sequence[str] = (),
    outputs: str | Sequence[str] = (),
    model_text: str = "",
) -> Report:
    """Look at a mechanism once, and say everything: counts, range, extremes, sensitivities, forces, what is wrong.

    Nothing is raised where a mechanism fails: the report says why, and what would mend it.

    Args:
        thing: a mechanism, which moves as its run section says; a system; or a sweep. A mechanism of which nobody says
            how it moves is simulated where it has a section ``[simulate]``, or goes as far as its first free
            coordinate goes, other freedoms as drawn.
        path: where the page is written, a file ending in ``.html``; nowhere if not given.
        expect: what is to hold, such as ``"psi range > 30"``, see `jaxnc.reporting.outcome.judge`.
        outputs: points, markers and coordinates to look at; those of the run section, or what is not driven.
        model_text: the text of the model file, to be shown as it stands.

    Raises:
        InputError: a thing that is none of these, names that do not exist, expectations that cannot be read.
        OutputError: the page cannot be written.
    """
    expect, outputs = ((x,) if isinstance(x, str) else tuple(x) for x in (expect, outputs))
    mechanism = thing if isinstance(thing, Mechanism) else None
    run = record.Run() if mechanism is None else mechanism.model.run
    verdict = Verdict(command="report", name=str(getattr(thing, "name", "")))
    if mechanism is not None:
        verdict.length_unit, verdict.angle_unit = mechanism.model.units.length, mechanism.model.units.angle
    known: dict[str, Any] = {"mechanism": mechanism, "model_text": model_text}
    try:
        system = thing.compile() if isinstance(thing, Mechanism) else _system(thing)
    except MechanismError as error:
        verdict.add("incomplete", "error", str(error))
        system = None
        if mechanism is not None:
            with contextlib.suppress(MechanismError):  # the drawing, if there is enough of it
                known["system"] = assemble(mechanism)
    if system is not None:
        given = thing if isinstance(thing, Motion) else None
        known |= {"system": system} | _study(verdict, system, mechanism, given, run, expect, outputs)
    name = system.name if system is not None else verdict.name
    motion = known.get("motion")
    verdict.origin = _origin(mechanism, motion, model_text)
    verdict.close(1 if verdict.errors else 0)
    made = Report(name, "" if mechanism is None else mechanism.model.description, verdict, **known)
    if path is not None:
        made.to_html(path)
    return made


def _system(thing: object) -> System:
    system = thing.system if isinstance(thing, Motion) else thing
    if not isinstance(system, System):
        raise InputError(f"report() is of a Mechanism, a System or a Motion; got {type(thing).__name__}")
    if np.ndim(system.parameters.points) > 2 or (isinstance(thing, Motion) and thing.status.ndim > 1):
        raise InputError(f"report(): {system.name!r} is a batch; give one design and one sweep of it")
    if isinstance(thing, Motion) and not thing.status.size:
        raise InputError(f"report(): this motion of {system.name!r} has no poses")
    return system


def _study(
    verdict: Verdict,
    system: System,
    mechanism: Mechanism | None,
    given: Motion | None,
    run: record.Run,
    expect: Sequence[str],
    outputs: Sequence[str],
) -> dict[str, Any]:
    """Study a system; returns what is known of it, by the attributes of a report."""
    found = mobility(system)
    count(verdict, system, found)
    known: dict[str, Any] = {"mobility": found}
    if found.conflicting:
        return known | {"diagnosis": assembly(verdict, system)}
    verdict.findings += [f for f in oddities(system) if f.code != "does-not-move"]
    if not found.dof:
        parts = locking_parts(system)
        text = "nothing moves: it has no degree of freedom"
        if parts:
            text += f"; without any one of {', '.join(parts[:8])} it would move"
        verdict.add("does-not-move", "error", text, names=parts)
        verdict.does = False
        return known
    if given is not None:
        one = {name: np.asarray(values, float).reshape(-1) for name, values in given.inputs.items()}
        motion = given if given.status.ndim else solve_position(system, one, hold=given.held, throw=False)
        verdict.drives = [_drive(motion, name) for name in motion.driven]
        _reaches(verdict, system, motion.driven, motion.held)
    else:
        if mechanism is not None and run.inputs:
            check_expected(system, sweep_arguments(mechanism, run), expect)
        try:
            motion = _move(verdict, system, mechanism, run)
        except (InputError, AssemblyError) as error:
            verdict.add("cannot-be-driven", "error", str(error), names=list(run.inputs))
            verdict.does = False
            return known
    names = outputs_of(motion, outputs or run.outputs)
    enter(verdict, motion, names)
    free = isinstance(motion, Simulation)  # what is driven in it follows from forces with the rest
    if free:
        asked_end = None if mechanism is None or given is not None else mechanism.model.simulate.duration
        enter_simulation(verdict, motion, asked_end)
    elif not verdict.errors and given is None and not run.inputs:
        verdict.does = True if expect else None  # nobody asked for anything
    asked = {name: np.asarray(values, float).reshape(-1) for name, values in motion.inputs.items()}
    if verdict.errors and run.analysis != "circuit" and not free:
        known["diagnosis"] = why(verdict, motion, asked, motion.held)
    for _ in judge(verdict, motion, expect):
        pass
    known |= {"motion": motion, "outputs": tuple(names)}
    if not np.asarray(motion.converged).any():
        return known
    known |= {
        "quantities": tuple(quantities(motion, names)),
        "transmissions": tuple(transmissions(motion)) if motion.driven else (),
        "forces": None if run.analysis == "circuit" else forces(motion),
        "suspensions": () if run.analysis == "circuit" else tuple(suspension_reports(motion)),
    }
    known["sensitivity"] = None if free else _sensitive(verdict, motion, names)
    if free:
        text = "no sensitivities: they are of poses, and this motion follows from forces; jax.grad of a function of "
        verdict.add("not-known", "note", text + "nc.simulate gives derivatives of it (docs/dynamics.md)")
    verdict.wheels = [wheel(one) for one in known["suspensions"]]
    return known


def _drive(motion: Motion, name: str) -> Drive:
    unit, factor = unit_of(motion, name)
    values = np.asarray(motion.inputs[name], float) * factor
    return Drive(name=name, unit=unit, first=float(values[0]), last=float(values[-1]), poses=len(values))


def _move(verdict: Verdict, system: System, mechanism: Mechanism | None, run: record.Run) -> Motion:
    """Move a system as a run section asks, else a section on simulation; else as far as something free goes."""
    if mechanism is not None and run.inputs:
        verdict.drives, verdict.hold = drives(mechanism, run), list(run.hold)
        arguments = sweep_arguments(mechanism, run)
        _reaches(verdict, system, tuple(run.inputs), tuple(run.hold))
        return carry_out(system, run.analysis, arguments)
    if mechanism is not None and mechanism.model.simulate.duration is not None:
        return as_it_says(mechanism, system)
    name, *held = system.independent or verdict.drivable[: system.degrees_of_freedom]
    make_plan(system, (name,), held)
    _reaches(verdict, system, (name,), held)
    home = float(np.asarray(derive(system).home)[system.topology.position[name]])
    motion = sweep(system, {name: _range(verdict, system, name, home)}, hold=held, throw=False)
    verdict.drives, verdict.hold = [_drive(motion, name)], list(held)
    kept = f"; {', '.join(held)} stay{'s' * (len(held) == 1)} as drawn" if held else ""
    verdict.add("nothing-driven", "note", f"nobody said what is driven: {name} is moved as far as it goes{kept}")
    return motion


def _range(verdict: Verdict, system: System, name: str, home: float) -> np.ndarray:
    """Choose the values of an input from one dead point to the other, round a turn, or a little either way."""
    _, factor = shown_in(system.topology, name)
    ends = (verdict.reach[-1].lower, verdict.reach[-1].upper) if verdict.reach else (None, None)
    lower, upper = (np.nan if end is None else end / factor for end in ends)
    values = whole_range(system, name, home, lower, upper)
    return home + 0.1 * float(derive(system).length) * np.linspace(-1.0, 1.0, POSES) if values is None else values


def _reaches(verdict: Verdict, system: System, names: Sequence[str], held: Sequence[str]) -> None:
    """Enter how far each input goes where the others stay as they are drawn."""
    if system.topology.large:
        return
    for name in names:
        try:
            verdict.reach.append(reach(system, name, [*held, *(n for n in names if n != name)]))
        except (AssemblyError, InputError) as error:
            verdict.add("not-known", "note", f"how far {name} goes is not known: {error}", names=[name])


def _sensitive(verdict: Verdict, motion: Motion, names: Sequence[str]) -> Sensitivity | None:
    """Find derivatives of the outputs at some of the poses, and enter the largest."""
    if motion.system.topology.large:
        return None
    good = np.flatnonzero(np.asarray(motion.converged))
    # derivatives are taken at 73 poses at most
    chosen = good[np.unique(np.linspace(0, len(good) - 1, min(73, len(good))).astype(int))]
    some = motion.pose(chosen)
    try:
        found = sensitivity(some, list(names), throw=False)
    except (AssemblyError, InputError) as error:
        verdict.add("not-known", "note", f"sensitivities are not known: {error}")
        return None
    for name in names:
        unit, factor = unit_of(motion, name)
        block = found[name].reshape(len(chosen), -1, len(found.variables))
        size = np.linalg.norm(block, axis=1) if block.shape[1] > 1 else np.abs(block[:, 0])
        most = size.max(axis=0)
        # 12 derivatives of an output are listed
        for k in [int(k) for k in np.argsort(-most, kind="stable") if most[k] > ZERO * most.max()][:12]:
            pose = int(size[:, k].argmax())
            below = found.variable_units[k]
            angle = below == "rad" and motion.system.topology.angle_unit == "deg"
            per = factor * (np.pi / 180.0 if angle else 1.0)
            value = float(size[pose, k] if block.shape[1] > 1 else block[pose, 0, k]) * per
            label = f"|{name}|" if block.shape[1] > 1 else name
            below = "deg" if angle else below
            verdict.sensitivities.append(
                Derivative(
                    output=label,
                    variable=found.variables[k],
                    value=value,
                    unit=f"{unit}/{below}" if below else unit,
                    at=inputs_at(motion, int(chosen[pose])),
                )
            )
    return found


def _origin(mechanism: Mechanism | None, motion: Motion | None, model_text: str) -> dict[str, str]:
    """Collect versions, digests and settings, by which another run can be compared."""
    out = {"jaxnc": version()}
    for name in ("jax", "jaxlib", "numpy", "scipy"):
        try:
            out[name] = installed(name)
        except PackageNotFoundError:
            out[name] = "not known"
    out["python"] = f"{platform.python_version()} ({platform.python_implementation()})"
    out["platform"] = platform.platform()
    out["numbers"] = "64 bit" if jax.config.jax_enable_x64 else "32 bit"  # pyright: ignore[reportAttributeAccessIssue]
    if mechanism is not None:
        canonical = json_text(plain(mechanism.model)).encode()
        out["model, SHA-256"] = hashlib.sha256(canonical).hexdigest()
    if model_text:
        out["file, SHA-256"] = hashlib.sha256(model_text.encode()).hexdigest()
    if motion is not None and motion.status.ndim == 1:
        good = np.asarray(motion.converged)
        out["poses"] = (
            f"{len(good)}, each corrected by Newton's method until its residual is rounding; no random numbers"
        )
        if good.any() and motion.residual is not None:
            out["worst residual"] = (
                f"{np.asarray(motion.residual)[good].max():.3g} {motion.system.topology.length_unit}"
            )
    out["seeds"] = "fixed: 7 and 8 (poses near the drawing, for the rank), 3 (a general change of its dimensions)"
    return out
