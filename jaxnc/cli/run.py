"""`jaxnc run`, and what `jaxnc demo` shares with it."""

import argparse

from jaxnc.cli.analysis import analyse
from jaxnc.cli.question import Question
from jaxnc.cli.report import outputs_of, report
from jaxnc.cli.suspension import suspension_reports
from jaxnc.cli.written import listing, write_files
from jaxnc.errors import AssemblyError, MechanismError
from jaxnc.io.files import blame


def run(asked: Question, options: argparse.Namespace, importing: float) -> int:
    """Analyse a model file.

    Args:
        asked: the mechanism, and how it is driven.
        options: where files go and which.
        importing: seconds that importing took.

    Returns:
        The exit code.
    """
    try:
        return carry_out(asked, options, importing)
    except MechanismError as error:
        raise blame(options.file, error) from None


def carry_out(asked: Question, options: argparse.Namespace, importing: float) -> int:
    """Analyse a mechanism, print the report and write the files.

    Args:
        asked: the mechanism, and how it is driven.
        options: where files go and which.
        importing: seconds that importing took.

    Returns:
        The exit code.
    """
    try:
        analysis = analyse(asked.mechanism, asked.run)
    except AssemblyError as error:
        raise AssemblyError(f"{error} `jaxnc check` says how far an input can go") from None
    suspensions = suspension_reports(analysis)
    for line in report(analysis, importing, suspensions):
        print(line, flush=True)
    if options.out is None:
        print("  no files written; --out DIR writes tables, pictures and a page")
    else:
        files = write_files(
            analysis,
            options.out,
            outputs_of(analysis),
            pictures=not options.no_pictures,
            page=not options.no_html,
            animation=options.animate,
            suspensions=suspensions,
        )
        print(listing(files))
    return int(bool(analysis.motion.failures))
