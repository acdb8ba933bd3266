"""`jaxnc modes`: every assembly of a model file, at its inputs or over the range of one."""

import argparse
import itertools
import operator
from pathlib import Path

import numpy as np

import jaxnc as nc
from jaxnc.cli.output import Task, write_files
from jaxnc.cli.question import Question
from jaxnc.errors import counted
from jaxnc.io.drives import unit_of as unit_in_radians
from jaxnc.io.tables import list_columns, to_csv
from jaxnc.io.target import csv_text, write
from jaxnc.kinematics.circuits import Circuits
from jaxnc.kinematics.modes import Modes
from jaxnc.notebooks import align_columns
from jaxnc.progress import step_bar
from jaxnc.reporting.checked import drives
from jaxnc.reporting.outcome import outputs_of
from jaxnc.reporting.quantity import quantities, shown_in, unit_of
from jaxnc.reporting.verdict import Assemblies, BranchEnds

_first = operator.itemgetter(0)


def do_modes(question: Question, options: argparse.Namespace, importing: float) -> int:
    """List all assemblies, or join them up over the range of an input; 1 if there is none."""
    mechanism, run, verdict = question.mechanism, question.run, options.verdict
    system = mechanism.compile()
    top = system.topology
    verdict.length_unit, verdict.angle_unit = top.length_unit, top.angle_unit
    verdict.drives, verdict.hold = drives(mechanism, run), list(run.hold)
    inputs = {}
    for name, drive in run.inputs.items():
        values = np.linspace(drive.start, drive.end, drive.poses) * unit_in_radians(mechanism, name)
        inputs[name] = values if drive.poses > 1 else values[0]
    common = {"hold": run.hold, "unit": "rad", "seed": options.seed, "most": options.most}
    with step_bar(1) as step:
        step("looking for all assemblies")
        if options.map is None:
            found = nc.modes(system, inputs, **common, prove=options.prove)
            tasks = _list_modes(found, question, options)
        else:
            found = nc.circuits(system, inputs, **common)
            tasks = _list_circuits(found, system, options)
    some = any(verdict.assemblies.count)
    verdict.assembles = verdict.does = some
    verdict.summary = verdict.assemblies.statement if some else ""
    if not verdict.assemblies.complete:
        verdict.add("not-known", "warning", "paths were lost or solutions are not isolated: there may be others")
    if not some:
        verdict.add("does-not-assemble", "error", f"{top.name!r} has no assembly there")
    else:
        write_files(options, mechanism.name, tasks, "a table and a picture")
    return int(not some)


def _list_modes(found: Modes, question: Question, options: argparse.Namespace) -> list[Task]:
    """Print the statement and a table of the assemblies, and enter them; returns what can be written."""
    options.verdict.assemblies = Assemblies(
        statement=found.statement, complete=found.complete, count=[len(found)], values=[], branches=[]
    )
    poses, inputs = found.poses, question.run.inputs
    at = ", ".join(f"{name} = {drive.start:g} {unit_of(poses, name)[0]}" for name, drive in inputs.items())
    print(f"  {counted(len(found), 'assembly', 'assemblies')}{at and f' at {at}'}")
    print("\n".join(f"  {line}." for line in found.statement.rstrip(".").split(". ")))
    if len(found):
        columns = quantities(poses, outputs_of(poses, question.run.outputs))
        unit = poses.system.topology.length_unit
        rows = [["", *(f"{q.label} [{q.unit}]" for q in columns), "conditioning", f"within [{unit}]"]]
        most = 40  # rows of the table
        for k, c in enumerate(found.certificates[:most]):
            proof = f"{c.radius:.1g}" if c.exact else "no proof"
            rows.append([str(k), *(f"{q.values[k]:.6g}" for q in columns), f"{c.conditioning:.2g}", proof])
        print("\n".join(align_columns(rows, (0,), "    ")))
        if len(found) > most:
            print(f"  … and {len(found) - most} more")
    return [
        ("-modes.csv", "every assembly, as a table", lambda p: to_csv(poses, p)),
        ("-modes.png", "all of them, side by side", found.draw),
    ]


def _list_circuits(found: Circuits, system: nc.System, options: argparse.Namespace) -> list[Task]:
    """Print circuits and their branches, and how many assemblies there are where; enter them."""
    unit, factor = shown_in(system.topology, found.name)
    values = found.values * factor
    options.verdict.assemblies = Assemblies(
        statement=str(found),
        complete=not found.doubtful,
        count=[int(n) for n in found.count],
        values=[float(v) for v in values],
        branches=[
            BranchEnds(
                circuit=b.circuit, lower=b.lower * factor, upper=b.upper * factor, dead=list(b.dead), turns=b.turns
            )
            for b in found.branches
        ],
    )
    print(f"  {found}")
    rows = [["branch", "circuit", f"from [{unit}]", "", f"to [{unit}]", ""]]
    for k, b in enumerate(found.branches):
        ends = ["turns" if b.turns else "dead point" if dead else "end of the range" for dead in b.dead]
        rows.append([str(k), str(b.circuit), f"{b.lower * factor:.6g}", ends[0], f"{b.upper * factor:.6g}", ends[1]])
    if found.branches:
        print("\n".join(align_columns(rows, (0,), "    ")))
    runs = [(n, [i for _, i in some]) for n, some in itertools.groupby(zip(found.count, values, strict=True), _first)]
    most = 12  # ranges with so many assemblies each, in one line
    told = [f"{n} from {some[0]:.6g} to {some[-1]:.6g}" for n, some in runs[:most]]
    more = f"; and {len(runs) - most} more ranges" if len(runs) > most else ""
    print(f"  number of assemblies over {found.name}: {'; '.join(told)}{more}")
    return [
        ("-circuits.csv", "every pose of every branch, as a table", lambda p: _write_branches(found, p)),
        ("-circuits.png", "the branches over the input", found.draw),
    ]


def _write_branches(found: Circuits, path: Path) -> None:
    """Write the poses of all branches as one table, their numbers and those of their circuits in front."""
    rows: list[list[object]] = []
    for k, branch in enumerate(found.branches):
        columns = list_columns(branch.poses, None, None, "a table").columns
        if not k:
            rows.append(["branch", "circuit", *(f"{name} [{unit}]" for name, (unit, _) in columns.items())])
        for row in zip(*(values.tolist() for _, values in columns.values()), strict=True):
            rows.append([k, branch.circuit, *(f"{x:.17g}" for x in row)])
    write(path, csv_text(rows))
