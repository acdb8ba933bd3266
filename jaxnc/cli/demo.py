"""`jaxnc demo`: a ready mechanism, analysed and drawn."""

import argparse
from pathlib import Path

from jaxnc.cli.question import Question, stem
from jaxnc.cli.run import carry_out
from jaxnc.mechanism import Mechanism


def demo(asked: Question, options: argparse.Namespace, importing: float) -> int:
    """Analyse a ready mechanism as its library function drives it; the exit code."""
    code = carry_out(asked, options, importing)
    print(_next(asked.mechanism, Path(options.out) / (stem(asked.mechanism.name) + ".toml")))
    return code


def _next(mechanism: Mechanism, path: Path) -> str:
    """What to try next: the model itself, written where it does not replace one that was edited."""
    if path.exists():
        return f"  next: {path} was there already and is left as it is; `jaxnc run {path}` analyses it"
    mechanism.save(path)
    return f"  next: the model is in {path}; change it, then `jaxnc run {path}`"
