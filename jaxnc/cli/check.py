"""`jaxnc check`: does a model assemble, what may be driven, what looks wrong."""

import argparse
from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

from jaxnc.cli.question import Question
from jaxnc.cli.report import counted
from jaxnc.errors import AssemblyError, InputError, MechanismError
from jaxnc.io.drives import is_angle, sweep_arguments, unit_of
from jaxnc.io.files import blame
from jaxnc.kinematics.arc import travel
from jaxnc.kinematics.diagnosis import diagnose
from jaxnc.kinematics.mobility import mobility
from jaxnc.kinematics.position import solve_position
from jaxnc.kinematics.sizes import doubtful_size
from jaxnc.mechanism import Mechanism
from jaxnc.solvers.assembly import derive, settle
from jaxnc.status import Status
from jaxnc.system.system import System, characteristic_length, drivable

_MANY = 12  # names shown in a list
_FAR = 0.02  # of the mechanism's size: a drawing that is moved further to assemble is worth a warning


def check(asked: Question, options: argparse.Namespace, importing: float) -> int:
    """Look at a model file without analysing it.

    Args:
        asked: the mechanism.
        options: what was asked for.
        importing: seconds that importing took; not reported.

    Returns:
        0 if the model assembles and its run section can be carried out, else 1.
    """
    mechanism = asked.mechanism
    try:
        system = mechanism.compile()
    except MechanismError as error:
        raise blame(options.file, error) from None
    model = mechanism.model
    print("  " + ", ".join(_counts(mechanism)))
    count = mobility(system)
    print("\n".join(f"  {line}" for line in str(count).partition(": ")[2].splitlines()))
    if count.conflicting:
        found = diagnose(system)
        print("\n".join(f"  {line}" for line in str(found).splitlines()[1:]))
        print("  it does NOT assemble")
        return 1
    print(f"  it assembles: every constraint is met to {count.gap:.1e} {model.units.length}")
    names = drivable(system.topology)
    if count.dof > 0:
        print(f"  may be driven: {', '.join(names[:_MANY])}" + (", …" if len(names) > _MANY else ""))
    problems = list(_run_problems(mechanism, system))
    if not problems:
        for line in _travels(mechanism, system, problems):
            print(f"  {line}")
    for warning in _warnings(mechanism, system):
        print(f"  warning: {warning}")
    for problem in problems:
        print(f"  problem: {problem}")
    if not problems:
        print("  good" + (": `jaxnc run` can carry it out" if model.run.inputs else ""))
    return 1 if problems else 0


def _counts(mechanism: Mechanism) -> Iterator[str]:
    m = mechanism.model
    for number, noun, plural in (
        (len(m.ground), "ground point", ""),
        (len(m.points), "point", ""),
        (len(m.ground_vectors), "ground vector", ""),
        (len(m.vectors), "vector", ""),
        (len(m.markers), "marker", ""),
        (len(m.bodies), "body", "bodies"),
        (len(m.joints), "joint", ""),
        (len(m.angles), "angle", ""),
        (len(m.distances), "distance", ""),
        (len(m.relations), "relation", ""),
        (len(m.constraints), "own constraint", ""),
    ):
        if number:
            yield counted(number, noun, plural)


def _run_problems(mechanism: Mechanism, system: System) -> Iterator[str]:
    """What keeps the run section from being carried out: inputs that do not fit, ends that are out of reach."""
    if not mechanism.model.run.inputs:
        return
    if system.degrees_of_freedom == 0:
        yield f"run.inputs: {', '.join(mechanism.model.run.inputs)} cannot be driven, it has no degree of freedom"
        return
    arguments = sweep_arguments(mechanism)
    ends = {name: values[[0, -1]] for name, values in arguments["inputs"].items()}
    try:
        found = solve_position(system, ends, hold=arguments["hold"], throw=False)
    except InputError as error:
        yield f"run.inputs: {error}"
        return
    for i, end in enumerate(("first", "last")):
        status = Status(int(found.status[i]))
        if status:
            at = ", ".join(_value(mechanism, name, values[i]) for name, values in ends.items())
            yield f"run.inputs: the {end} pose, {at}, is not found. {status.sentence}"


def _travels(mechanism: Mechanism, system: System, problems: list[str]) -> Iterator[str]:
    """How far the input of the run section can go, if there is a single one; a problem if the run asks for more."""
    run = mechanism.model.run
    if len(run.inputs) != 1:
        return
    name = next(iter(run.inputs))
    try:
        found = travel(system, name, tuple(run.hold))
    except (AssemblyError, InputError) as error:
        yield f"limits of {name} are not known: {error}"
        return
    ends = [v / unit_of(mechanism, name) for v in (found.lower, found.upper)]
    if found.turns:
        yield f"{name} turns fully, without a dead point"
    elif np.isfinite(ends).any():
        limits = [f"{v:.10g}" if np.isfinite(v) else "no limit" for v in ends]
        yield f"{name} can go from {limits[0]} to {limits[1]} {_unit(mechanism, name)}, limits being dead points"
        drive = run.inputs[name]
        slack = 1e-9 * abs(drive.end - drive.start)
        if run.analysis != "circuit" and (
            min(drive.start, drive.end) < ends[0] - slack or max(drive.start, drive.end) > ends[1] + slack
        ):
            asked = f"{drive.start:g} to {drive.end:g}"
            problems.append(
                f"run.inputs: {name} is asked for from {asked}, beyond these limits; the run will stop there"
            )


def _warnings(mechanism: Mechanism, system: System) -> Iterator[str]:
    """What is allowed but probably not meant."""
    top, model = system.topology, mechanism.model
    if doubt := doubtful_size(system):
        yield doubt
    tied = {p for block in top.blocks for points in block.points for p in points}
    for i, name in enumerate(top.points):
        if i not in tied and not all(top.fixed[top.dim * i : top.dim * (i + 1)]):
            yield f"point {name!r} is in no body, joint or coordinate; nothing holds it"
    used = {v for block in top.blocks for vectors in block.vectors for v in vectors}
    for i, name in enumerate(top.vectors):
        if i not in used and name not in model.ground_vectors:
            yield f"vector {name!r} is in no body, joint or coordinate; nothing holds it"
    ground = set(model.ground) - {top.points[i] for i in tied}
    if ground:
        yield f"nothing is attached to ground {', '.join(sorted(ground))}"
    equations = derive(system)
    pose = settle(equations, np.zeros(len(top.coordinates))).q
    first = len(top.points) * top.dim
    moved = np.asarray(jnp.abs(pose - equations.home))[:first].reshape(-1, top.dim).max(axis=1)
    size = float(characteristic_length(system.parameters.points))
    if moved.max() > _FAR * size:
        name = top.points[int(moved.argmax())]
        yield (
            f"the drawing does not fit its dimensions: to assemble, {name!r} is moved by {moved.max():.3g} "
            f"{model.units.length}; draw it there, or check the lengths"
        )
    if system.degrees_of_freedom == 0:
        yield "nothing moves: leave out a body or a joint, or do not fix a point, if it should"
    elif not model.run.inputs:
        yield "it has no table [run.inputs], so `jaxnc run` needs --input"


def _value(mechanism: Mechanism, name: str, value: float) -> str:
    return f"{name} = {value / unit_of(mechanism, name):.6g} {_unit(mechanism, name)}"


def _unit(mechanism: Mechanism, name: str) -> str:
    units = mechanism.model.units
    return units.angle if is_angle(mechanism, name) else units.length
