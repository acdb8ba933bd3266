"""Mechanisms other than four-bars: the problem files of the examples."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np

from benchmarks.synthesis.case import Case
from jaxnc.io.problems import load_problem
from jaxnc.io.source import ProblemFile, Source, decode
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.result import Result

FOLDER = Path(__file__).parents[2] / "examples" / "problems"


def largest(problem: Problem, unit: float = 1.0) -> float:
    """The largest error of the idea, offsets fitted."""
    x = problem.start
    errors = np.asarray(problem.errors(problem.move(x), problem.split(jnp.asarray(x))[1]))
    errors = problem.fit(x[None], errors.reshape(1, -1) / problem.size)[1][0] * problem.size
    return float(np.max(np.abs(errors))) * unit


def _file(name: str, title: str, target: float, known: str, degrees: bool = False, keys=(0,)) -> Case:
    """The case of a problem file, judged by its largest error."""
    path, unit = FOLDER / f"{name}.toml", 180.0 / np.pi if degrees else 1.0
    search = decode(Source(path), ProblemFile).search
    settings = {k: getattr(search, k) for k in ("starts", "refine", "iterations", "keep", "enough")}

    def error(result: Result) -> float:
        return float(np.max(result.designs[0].errors)) * unit  # with weights, as the idea's

    return Case(title, lambda: load_problem(path)[0], settings, target, known, error, keys, lambda p: largest(p, unit))


def beyond() -> tuple[Case, ...]:
    """All cases."""
    exact = "made by a linkage of the same type, to be recovered"
    return (
        _file(
            "bump_steer", "double wishbone, toe [deg]", 0.01, "±40 mm of travel, two coordinates of the tie rod", True
        ),
        _file("camber", "MacPherson strut, camber [deg]", 1e-6, exact, True),
        _file("slider", "slider-crank function", 1e-8, exact),
        _file("stephenson", "Stephenson I path", 1e-8, exact),
        _file("watt", "Watt II function [deg]", 1e-6, exact, True),
        _file("geared_five_bar", "geared five-bar path", 1e-8, exact),
        _file("rssr", "RSSR function [deg]", 1e-6, exact, True),
        _file("spherical", "spherical four-bar function [deg]", 1e-6, exact, True),
        _file("spherical_motion", "spherical four-bar, five poses", 1e-8, exact),
        _file(
            "dwell", "Stephenson III dwell [deg]", 0.6, "100 degrees of the crank, transmission angle 20 degrees", True
        ),
        _file("jansen", "Jansen's leg, height of the foot", 1e-3, "170 degrees of the crank; a leg of about 1 m"),
    )
