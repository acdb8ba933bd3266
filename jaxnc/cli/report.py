"""`jaxnc report`: all that is known of a mechanism, on one page."""

import argparse
from pathlib import Path

from jaxnc.cli.progress import progress
from jaxnc.cli.question import Question, page
from jaxnc.cli.written import listing
from jaxnc.io.source import SUFFIXES
from jaxnc.reporting.study import report as studied


def report(asked: Question, options: argparse.Namespace, importing: float) -> int:
    """Look at a mechanism, say in short what there is, and write the page; 0 if it does all that was asked."""
    source = Path(options.file)
    said = source.read_text(encoding="utf-8") if source.suffix.lower() in SUFFIXES else ""
    path = page(options.out, asked.mechanism.name)
    with progress(2) as step:
        step("looking at it")
        asked.mechanism.model.run = asked.run
        found = studied(asked.mechanism, expect=options.expect, model_text=said)
        step("writing the page")
        found.to_html(path)
    options.verdict = found.verdict
    print("\n".join(str(found).splitlines()[1:]))
    if not found.verdict.errors:
        print(f"  {found.verdict.summary}")
    print(listing([(path, "the page: opens in any browser, prints on A4")], options.verdict))
    return found.verdict.exit
