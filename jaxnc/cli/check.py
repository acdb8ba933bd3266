"""`jaxnc check`: does a model assemble, what may be driven, what looks wrong."""

import argparse

from jaxnc.cli.question import Question
from jaxnc.errors import MechanismError
from jaxnc.io.files import blame
from jaxnc.kinematics.mobility import mobility
from jaxnc.reporting.checked import assembly, count, drives, oddities, parts, problems, travels

_MANY = 12  # names shown in a list


def check(asked: Question, options: argparse.Namespace, importing: float) -> int:
    """Look at a model file without analysing it: 0 if it assembles and its run section can be carried out, else 1."""
    mechanism, verdict = asked.mechanism, options.verdict
    try:
        system = mechanism.compile()
    except MechanismError as error:
        raise blame(options.file, error) from None
    model = mechanism.model
    print("  " + ", ".join(parts(mechanism)))
    found = mobility(system)
    count(verdict, system, found)
    print("\n".join(f"  {line}" for line in str(found).partition(": ")[2].splitlines()))
    if found.conflicting:
        print("\n".join(f"  {line}" for line in str(assembly(verdict, system)).splitlines()[1:]))
        print("  it does NOT assemble")
        return 1
    print(f"  it assembles: every constraint is met to {found.gap:.1e} {model.units.length}")
    if found.dof > 0:
        names = verdict.drivable
        print(f"  may be driven: {', '.join(names[:_MANY])}" + (", …" if len(names) > _MANY else ""))
    verdict.drives, verdict.hold = drives(mechanism, model.run), list(model.run.hold)
    verdict.findings += (wrong := problems(mechanism, system))
    if not wrong:
        for line in travels(mechanism, system, verdict):
            print(f"  {line}")
    for warning in oddities(system, mechanism):
        verdict.findings.append(warning)
        print(f"  warning: {warning.text}")
    for problem in verdict.errors:
        print(f"  problem: {problem.text}")
    if model.run.inputs:
        verdict.does = not verdict.errors
    if not verdict.errors:
        print("  good" + (": `jaxnc run` can carry it out" if model.run.inputs else ""))
    return 1 if verdict.errors else 0
