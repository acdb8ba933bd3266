"""Mechanisms other than four-bars: the problem files of the examples, and a leg."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np

import jaxnc as nc
from benchmarks.synthesis.case import Case
from jaxnc.io.problems import load_problem
from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.result import Result

S = nc.synthesis
_FOLDER = Path(__file__).parents[2] / "examples" / "problems"
_STANCE = (3.4, 5.6)  # radians of Jansen's crank in which the foot is on the ground


def largest(problem: Problem, unit: float = 1.0) -> float:
    """The largest error of the idea, offsets fitted."""
    x = problem.start
    errors = np.asarray(problem.errors(problem.move(x), problem.split(jnp.asarray(x))[1]))
    errors = problem.fitted(x[None], errors.reshape(1, -1) / problem.size)[1][0] * problem.size
    return float(np.max(np.abs(errors))) * unit


def _file(name: str, title: str, target: float, known: str, degrees: bool = False, keys=(0,)) -> Case:
    """The case of a problem file, judged by its largest error."""
    path, unit = _FOLDER / f"{name}.toml", 180.0 / np.pi if degrees else 1.0
    search = load_problem(path)[1]
    settings = {k: getattr(search, k) for k in ("starts", "refine", "iterations", "keep", "enough")}

    def error(result: Result) -> float:
        return result.designs[0].largest * unit

    return Case(title, lambda: load_problem(path)[0], settings, target, known, error, keys, lambda p: largest(p, unit))


def _foot():
    leg = nc.library.jansen_leg()
    system = leg.compile()
    phi = np.linspace(*_STANCE, 15)
    foot = np.asarray(nc.sweep(system, {"phi": phi}).check()["F"])
    step = float(foot[-1, 0] - foot[0, 0])

    def level(motion):
        height = motion["F"][:, 1]
        return height - jnp.mean(height)

    def pace(motion):
        return (motion["F"][-1, 0] - motion["F"][0, 0]) / step - 1.0

    places = {n: np.asarray(system[n]) for n in ("Z", "U", "V", "L", "K", "F")}
    bounds = {n: [(v - 0.08, v + 0.08) for v in at] for n, at in places.items()}
    return S.Objective(
        leg, level, phi, free=list(places), bounds=bounds, subject_to=[S.condition(pace, "length of the step")]
    )


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
        _file("dwell", "Stephenson III dwell [deg]", 0.5, "rest over 100 degrees of the crank", True),
        _file("watt", "Watt II function [deg]", 1e-6, exact, True),
        _file("geared_five_bar", "geared five-bar path", 1e-8, exact),
        _file("rssr", "RSSR function [deg]", 1e-6, exact, True),
        _file("spherical", "spherical four-bar function [deg]", 1e-6, exact, True),
        Case(
            "Jansen's leg, straighter foot",
            _foot,
            {"starts": 100, "refine": 12},
            0.001,
            "height of the foot over the stance, leg of 1 m",
            lambda r: r.designs[0].largest,
            start=largest,
        ),
    )
