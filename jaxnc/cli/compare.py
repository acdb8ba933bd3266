"""`jaxnc compare`: one mechanism in every family of coordinates."""

import argparse
from pathlib import Path

from jaxnc.cli.progress import progress
from jaxnc.cli.question import Question, stem
from jaxnc.cli.written import listing
from jaxnc.errors import AssemblyError, InputError, MechanismError, nearest
from jaxnc.families.compare import compare as compared
from jaxnc.families.formulate import FAMILIES
from jaxnc.io.files import blame
from jaxnc.io.target import write
from jaxnc.reporting.checked import assembly
from jaxnc.reporting.verdict import Family, number


def compare(asked: Question, options: argparse.Namespace, importing: float) -> int:
    """Compare the families of coordinates on a model file: 0, or 1 if it does not assemble."""
    mechanism = asked.mechanism
    wanted = [f.strip() for f in options.families.split(",")] if options.families else list(FAMILIES)
    for family in wanted:
        if family not in FAMILIES:
            raise InputError(f"--families {options.families}: no family {family!r}; {nearest(family, FAMILIES)}")
    model, verdict = mechanism.model, options.verdict
    try:
        with progress(len(wanted)) as step:
            found = compared(mechanism, wanted, (*model.run.inputs, *model.run.hold), progress=step)
    except MechanismError as error:
        raise blame(options.file, error) from None
    except AssemblyError:
        found = assembly(verdict, mechanism.compile())
        if found.assembles:
            raise
        print(found)
        return 1
    verdict.assembles = verdict.moves = verdict.does = True
    verdict.families = [
        Family(
            family=row.family,
            variables=row.n,
            equations=row.r,
            freedoms=row.g,
            condition=number(row.condition),
            iterations=row.iterations,
            note=row.note,
        )
        for row in found.families
    ]
    print(found)
    if options.out is None:
        print("  no files written; --out DIR writes tables, a plot and the equations")
        return 0
    base = Path(options.out) / stem(model.name)
    files = []

    def add(suffix: str, text: str, what: str) -> None:
        path = base.with_name(base.name + suffix)
        files.append((write(path, text.encode()), what))

    add("-families.csv", found.to_csv(), "the table")
    add("-families.json", found.to_json(), "the same")
    chapters = [f"# {model.name}: constraint equations"]
    for name, f in found.formulations.items():
        chapters.append(f"## {name}: n = {f.n}, r = {f.r}, g = {f.g}\n\n{f.equations().markdown()}")
    add("-equations.md", "\n\n".join(chapters) + "\n", "the equations of every family")
    if not options.no_pictures:
        from jaxnc.viz.studies import plot_families

        path = base.with_name(base.name + "-families.png")
        plot_families(found, path)
        files.append((path, "the plot"))
    print(listing(files, options.verdict))
    return 0
