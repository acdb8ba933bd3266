"""`jaxnc parts`: drawings of a planar mechanism's parts for a workshop."""

import argparse
from pathlib import Path

from jaxnc.cli.analysis import analyse
from jaxnc.cli.question import Question
from jaxnc.cli.written import listing
from jaxnc.errors import AssemblyError, InputError, MechanismError
from jaxnc.io.files import blame
from jaxnc.workshop.shop import SIZES


def parts(asked: Question, options: argparse.Namespace, importing: float) -> int:
    """Make a mechanism of plates, print the table of parts and write their drawings; the exit code."""
    if not asked.run.inputs:
        raise InputError(f"{options.file} does not say over what motion parts must not collide; add [run.inputs] to it")
    try:
        motion = analyse(asked.mechanism, asked.run).motion
    except MechanismError as error:
        raise blame(options.file, error) from None
    except AssemblyError as error:
        raise AssemblyError(f"{error} `jaxnc check` says how far an input can go") from None
    options.verdict.assembles = options.verdict.moves = True
    sizes = {name: getattr(options, name) for name in SIZES if getattr(options, name) is not None}
    formats = (options.format,) if options.format else ("dxf", "svg")
    found = motion.to_parts(options.out, formats=formats, **sizes)
    options.verdict.does = True
    print(found)
    if options.out is None:
        print("  no files written; --out DIR writes drawings of the parts, and this table")
        return 0
    files = [(f"{d.name}.{ending}", f"{d.title}, at true scale") for d in found.drawings() for ending in formats]
    files += [("parts.csv", "the table of parts"), ("pins.csv", "what lies on each pin")]
    files += [("parts.txt", "both, to be read")]
    files += [("assembly.png", "a picture of the stack")]
    print(listing([(Path(options.out) / name, what) for name, what in files], options.verdict))
    return 0
