"""`jaxnc synthesise`."""

import argparse
import sys
import time
from pathlib import Path

import jax

from jaxnc.cli.question import Question, stem
from jaxnc.cli.written import listing
from jaxnc.io.problems import load_problem
from jaxnc.reporting.verdict import Design, Search, Verdict, number
from jaxnc.synthesis.result import Result
from jaxnc.synthesis.search.solve import solve


def synthesise(asked: Question, options: argparse.Namespace, importing: float) -> int:
    """Search for designs as a problem file says.

    The exit code is 1 if none without defects was found, and 130 if the search was interrupted: what it had found by
    then is printed and written all the same.
    """
    problem, search = load_problem(options.file)
    changed = {k: getattr(options, k) for k in ("starts", "refine", "seconds", "key")}
    settings = {
        "starts": search.starts,
        "refine": search.refine,
        "iterations": search.iterations,
        "keep": search.keep,
        "seconds": search.seconds,
        "enough": search.enough,
        "key": search.key,
    }
    settings |= {k: v for k, v in changed.items() if v is not None}
    begin = time.perf_counter()
    settings["key"] = jax.random.key(settings["key"])
    result = solve(problem, **settings, checkpoint=options.checkpoint, resume=options.resume)
    _enter(options.verdict, result)
    print(result)
    print(f"  time       {time.perf_counter() - begin:.1f} s")
    print(f"  importing  {importing:.2f} s")
    if options.out is None:
        print("  no files written; --out DIR writes the designs as model files, and pictures")
        return _code(result, options)
    place = Path(options.out)
    result.save(place)
    files = [(place / "designs.txt", "the table"), (place / "result.npz", "the numbers, for jaxnc.synthesis.load")]
    files += [(place / f"design_{k + 1}.toml", "a model file") for k in range(len(result.designs[:3]))]
    if result.designs and not options.no_pictures:
        base = place / stem(problem.system.name)
        result.gallery(base.with_name(base.name + "-designs.png"))
        files.append((base.with_name(base.name + "-designs.png"), "the best designs"))
        result.convergence(base.with_name(base.name + "-convergence.png"))
        files.append((base.with_name(base.name + "-convergence.png"), "the best error over time"))
    print(listing(files, options.verdict))
    return _code(result, options)


def _code(result: Result, options: argparse.Namespace) -> int:
    """The exit code; of an interrupted search a line on stderr says what is kept of it."""
    if not result.interrupted:
        return int(not result.found)
    search = options.checkpoint or options.resume
    kept = [f"what was found so far is in {options.out}"] if options.out is not None else []
    if search is not None and Path(search).exists():
        kept.append(f"the search is in {search}, go on with --resume {search}")
    if not options.json:  # where the verdict says it
        lost = "nothing of it is kept in a file, which --out DIR and --checkpoint FILE do"
        print(f"jaxnc: interrupted; {'; '.join(kept) or lost}", file=sys.stderr)
    return 130


def _enter(verdict: Verdict, result: Result) -> None:
    """Enter what a search has come to."""
    problem, top = result.problem, result.problem.system.topology
    verdict.name, verdict.length_unit, verdict.angle_unit = top.name, top.length_unit, top.angle_unit
    designs = [
        Design(
            error=number(d.error),
            defects=list(d.defects),
            variables={name: float(x) for name, x in zip(problem.names, d.x, strict=True)},
        )
        for d in result.designs
    ]
    verdict.search = Search(
        screened=result.screened,
        refined=result.refined,
        stopped=result.stopped,
        unit=problem.error_unit,
        designs=designs,
    )
    verdict.assembles = verdict.moves = bool(designs) or None
    verdict.does, verdict.summary = result.found, result.verdict
    if not result.found:
        verdict.add("no-design", "error", result.verdict)
