"""`jaxnc synthesise`."""

import argparse
import time
from pathlib import Path

import jax

from jaxnc.cli.question import Question, stem
from jaxnc.cli.written import listing
from jaxnc.io.problems import load_problem
from jaxnc.synthesis.search import solve


def synthesise(asked: Question, options: argparse.Namespace, importing: float) -> int:
    """Search for designs as a problem file says.

    Args:
        asked: the mechanism.
        options: what was asked for.
        importing: seconds that importing took.

    Returns:
        The exit code: 1 if no design without defects was found.
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
    print(result)
    print(f"  time       {time.perf_counter() - begin:.1f} s")
    print(f"  importing  {importing:.2f} s")
    if options.out is None:
        print("  no files written; --out DIR writes the designs as model files, and pictures")
        return int(not result.found)
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
    print(listing(files))
    return int(not result.found)
