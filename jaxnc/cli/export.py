"""`jaxnc export`: a model as a file of a robot simulator."""

import argparse
from pathlib import Path

from jaxnc.cli.question import Question, stem
from jaxnc.cli.written import listing
from jaxnc.errors import AssemblyError, MechanismError
from jaxnc.io.files import blame
from jaxnc.io.target import folder
from jaxnc.reporting.checked import assembly
from jaxnc.robots import to_mjcf, to_urdf

_FORMATS = {"mjcf": (".xml", to_mjcf, "for MuJoCo"), "urdf": (".urdf", to_urdf, "for other simulators of robots")}


def export(asked: Question, options: argparse.Namespace, importing: float) -> int:
    """Write a model file for a simulator of robots; 1 if it does not assemble, 0 also where something is left out."""
    suffix, write, what = _FORMATS[options.to]
    path = folder(options.out or Path()) / f"{stem(asked.mechanism.model.name)}{suffix}"
    verdict = options.verdict
    try:
        done = write(asked.mechanism, path)
    except MechanismError as error:
        raise blame(options.file, error) from None
    except AssemblyError:
        print(assembly(verdict, asked.mechanism.compile()))
        return 1
    verdict.assembles = verdict.does = True
    for said in done.left_out:
        verdict.add("left-out", "warning", said)
    for said in done.notes:
        verdict.add("left-out", "note", said)
    print("\n".join(str(done).splitlines()[1:]))
    print(
        listing(
            [(path, f"{len(done.links)} links, {len(done.joints)} joints, {len(done.loops)} loops, {what}")], verdict
        )
    )
    return 0
