"""A case: a problem, how long to search, what is to be reached; and what came of it."""

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import jax

from jaxnc.synthesis.problem import Problem
from jaxnc.synthesis.result import Result
from jaxnc.synthesis.search.solve import solve

_NOTHING = 1e-18  # of the size, squared: an error that is rounding


@dataclasses.dataclass(frozen=True)
class Case:
    """One problem.

    Attributes:
        name: what the table calls it.
        state: makes the problem.
        search: settings of `jaxnc.synthesis.solve`.
        target: the error to be reached.
        known: where the target comes from.
        error: the error of a result, in the unit of the target.
        keys: of the random numbers, one search each.
        start: the error of the idea, if it is worth telling.
    """

    name: str
    state: Callable[[], Problem]
    search: dict[str, Any]
    target: float
    known: str
    error: Callable[[Result], float] = lambda result: result.error
    keys: tuple[int, ...] = (0,)
    start: Callable[[Problem], float] | None = None


class Compiling:
    """Seconds on the wall that JAX has spent on tracing and compiling."""

    def __init__(self):
        self.seconds = 0.0
        jax.monitoring.register_event_duration_secs_listener(self._heard)

    def _heard(self, event: str, seconds: float, **_: Any) -> None:
        if event.startswith("/jax/core/compile/"):
            self.seconds += seconds


def run(case: Case, compiling: Compiling) -> list[dict[str, Any]]:
    """Search from every key; the first one compiles what the others use.

    Returns:
        A row for each key; ``polish`` is the part of the error that SciPy's solvers still took away.
    """
    from benchmarks.synthesis.polish import polished  # with SciPy, which a first search is to wait for itself

    rows, problem = [], None
    for key in case.keys:
        wall, cpu, compiled = time.perf_counter(), time.process_time(), compiling.seconds
        problem = problem or case.state()
        result = solve(problem, **case.search, key=jax.random.key(key), progress=False)
        used = time.process_time() - cpu
        row = {
            "case": case.name,
            "key": key,
            "error": case.error(result) if result.designs else None,
            "target": case.target,
            "found": result.found,
            "defects": "; ".join(result.designs[0].defects) if result.designs else result.verdict,
            "processor_s": used,
            "wall_s": time.perf_counter() - wall,
            "compile_s": compiling.seconds - compiled,
            "screened": result.screened,
            "refined": result.refined,
            "not_finite": result.broken,
            "known": case.known,
        }
        row["converged"] = bool(result.designs and result.designs[0].converged)
        if result.designs and not problem.minimax and result.error > _NOTHING * problem.size**2:
            x = result.designs[0].x
            row["polish"] = max(polished(problem, x, method).gain for method in ("SLSQP", "least_squares"))
        if case.start is not None:
            row["start"] = case.start(problem)
        row["met"] = row["error"] is not None and row["found"] and row["error"] <= case.target
        rows.append(row)
    jax.clear_caches()
    return rows
