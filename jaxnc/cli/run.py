"""`jaxnc run`, and what `jaxnc demo` shares with it."""

import argparse

from jaxnc.cli.analysis import analyse
from jaxnc.cli.printed import report
from jaxnc.cli.question import Question
from jaxnc.cli.written import listing, write_files
from jaxnc.errors import AssemblyError, MechanismError
from jaxnc.io.files import blame
from jaxnc.reporting.checked import drives
from jaxnc.reporting.expected import judge
from jaxnc.reporting.outcome import enter, outputs_of, suspension_reports, wheel


def run(asked: Question, options: argparse.Namespace, importing: float) -> int:
    """Analyse a model file; the exit code."""
    try:
        return carry_out(asked, options, importing)
    except MechanismError as error:
        raise blame(options.file, error) from None


def carry_out(asked: Question, options: argparse.Namespace, importing: float) -> int:
    """Analyse a mechanism, print the report and write the files; the exit code."""
    verdict = options.verdict
    try:
        analysis = analyse(asked.mechanism, asked.run, options.expect)
    except AssemblyError as error:
        raise AssemblyError(f"{error} `jaxnc check` says how far an input can go") from None
    motion, outputs = analysis.motion, outputs_of(analysis.motion, asked.run.outputs)
    verdict.drives, verdict.hold = drives(asked.mechanism, asked.run), list(asked.run.hold)
    enter(verdict, motion, outputs)
    suspensions = [] if asked.run.analysis == "circuit" else suspension_reports(motion)
    verdict.wheels = [wheel(found) for found in suspensions]
    for line in report(analysis, importing, suspensions, verdict):
        print(line, flush=True)
    for line in judge(verdict, motion, options.expect):
        print(line)
    if options.out is None:
        print("  no files written; --out DIR writes tables, pictures and a page")
    else:
        files = write_files(
            analysis,
            options.out,
            outputs,
            pictures=not options.no_pictures,
            page=not options.no_html,
            animation=options.animate,
            suspensions=suspensions,
        )
        print(listing(files, verdict))
    return int(bool(verdict.errors))
