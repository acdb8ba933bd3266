"""``python -m benchmarks.optimisers``: when an optax optimiser beats the least-squares search, and when not.

Three problems, each from the same starts: a closed path through 25 points of free timing; a path through ever more
points that were measured with noise; a path that is to be good in spite of tolerances, drawn anew at every step. The
process is bound to one core; seconds are processor time, warm: what is compiled is told beside them.
"""

import argparse
import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import machine

_FILE = Path(__file__).with_suffix(".json")
_POINTS_STARTS = 32
_ABOVE = (2.0, 1.1, 1.01)  # times the best known value
_BEST_25 = 0.0364065  # Bulatovic's 25 points, lengths to 60
_SHARE = 1.01  # of the optimum's error: reached where measured points are many
_NOISE = 0.01  # of measured points, in lengths of 4 for the ground
_TOLERANCE = 0.03  # standard deviation of a joint's coordinate, in the same unit
_SAMPLES = 32  # of tolerances at a step
_FRESH = 8192  # of them by which designs are compared


def _timed(run: Callable[[], Any]) -> tuple[float, Any]:
    begin = time.process_time()
    out = run()
    return time.process_time() - begin, out


def _least_squares(problem: Any, starts: np.ndarray, iterations: int) -> list[tuple[float, float]]:
    """Seconds and best error after each round of Levenberg-Marquardt, and at the end of second order."""
    from jaxnc.synthesis.design import judge
    from jaxnc.synthesis.search.basins import bring_to_ends
    from jaxnc.synthesis.search.goal import Goal
    from jaxnc.synthesis.search.refine import Refinement

    goal = Goal.of(problem)
    behind = np.broadcast_to(goal.row[problem.count :], (len(starts), len(goal.row) - problem.count))
    run, begin, out = Refinement(goal, iterations, len(starts)), time.process_time(), []
    run.queue = list(np.concatenate([starts, behind], axis=1))
    while run.more():
        run.go(np.inf)
        out.append((time.process_time() - begin, problem.reported_error(run.best)))
    found = [x for _, x in sorted(run.found, key=lambda pair: pair[0])]
    if found:
        valleys = bring_to_ends(problem, goal, found, most=4, iterations=400, width=run.width)
        out.append((time.process_time() - begin, judge(problem, valleys)[0].error))
    return out


def _reached(seen: list[tuple[float, float]], value: float) -> float | None:
    """When a value was reached first."""
    return next((float(seconds) for seconds, error in seen if error <= value), None)


def _best(steps: Any) -> np.ndarray:
    """Best value of a design that meets its conditions, after each step."""
    value = np.where(steps.good & (steps.violation <= 1e-6), steps.value, np.inf)
    return np.minimum.accumulate(value.min(axis=1))


def points(quick: bool, picture: Path | None = None) -> list[dict[str, Any]]:
    """25 points, closed, free timing: seconds to values, from the same starts."""
    import jax
    import optax

    from benchmarks.synthesis.published import PUBLISHED
    from jaxnc.synthesis import descend
    from jaxnc.synthesis.descent import starting_designs

    problem = next(c for c in PUBLISHED if c.name.startswith("25 points")).state()
    starts = starting_designs(problem, np.random.default_rng(0), _POINTS_STARTS, 50 * _POINTS_STARTS)
    steps = 200 if quick else 10_000
    rows = []

    def told(name: str, first: float, seen: list[tuple[float, float]]) -> None:
        times = {f"to {a:g} times": _reached(seen, a * _BEST_25) for a in _ABOVE}
        after = {f"after {s:g} s": min((e for t, e in seen if t <= s), default=None) for s in (1, 3, 10)}
        rows.append({"way": name, "compiling": first, **after, **times, "end": seen[-1][1], "seconds": seen[-1][0]})
        print(rows[-1], flush=True)

    first, _ = _timed(lambda: _least_squares(problem, starts[:1], 20))
    told("least squares", first, _least_squares(problem, starts, 400))
    ways = {
        "adam(1e-2)": (optax.adam(1e-2), steps),
        "adam(1e-2), cosine": (optax.adam(optax.cosine_decay_schedule(1e-2, steps)), steps),
        "adabelief(1e-2), cosine": (optax.adabelief(optax.cosine_decay_schedule(1e-2, steps)), steps),
        "lbfgs()": (optax.lbfgs(), max(20, steps // 10)),
    }
    for name, (optimiser, count) in ways.items():
        first, _ = _timed(lambda: descend(problem, optimiser, steps=1, starts=starts, progress=False))  # noqa: B023
        used, found = _timed(
            lambda: descend(problem, optimiser, steps=count, starts=starts, gradient=1e-12, progress=False)  # noqa: B023
        )
        if picture is not None and name == "adam(1e-2), cosine":
            found.convergence(picture)
        best = _best(found.steps)
        told(name, first, [(used * (k + 1) / len(best), float(e)) for k, e in enumerate(best)])
    jax.clear_caches()
    return rows


def _measured(count: int) -> tuple[Any, Any, np.ndarray]:
    """A path through many points of a four-bar, measured with noise; the idea is beside it; and the inputs."""
    import jaxnc as nc
    from benchmarks.synthesis.published import four_bar

    inputs = np.linspace(0.0, 2 * np.pi, count, endpoint=False)
    true = four_bar().compile().replace({"B": (0.6, 0.9), "C": (3.2, 3.1), "P": (1.7, 3.4)})
    noise = np.random.default_rng(1).normal(size=(count, 2))
    measured = np.asarray(nc.sweep(true, {"phi": inputs})["P"]) + _NOISE * noise
    free = ["B", "C", "P", "D.x"]
    problem = nc.synthesis.PathGeneration(four_bar(), "P", measured, timing=inputs, offset=True, free=free)
    return problem, true, inputs


def targets(quick: bool) -> list[dict[str, Any]]:
    """Ever more measured points: seconds until the error is within one percent of the least."""
    import jax
    import optax

    from jaxnc.synthesis import descend

    rows = []
    for count in (100, 1000) if quick else (100, 1000, 10_000):
        problem, _, _ = _measured(count)
        rng = np.random.default_rng(0)
        near = problem.start + 0.05 * problem.scale * rng.normal(size=(4, problem.count)) * (problem.scale > 0)
        starts = np.concatenate([problem.start[None], near])
        first, _ = _timed(lambda: _least_squares(problem, starts[:1], 20))  # noqa: B023
        seen = _least_squares(problem, starts, 100)
        least = min(e for _, e in seen)
        rows.append(
            {"targets": count, "way": "least squares", "compiling": first, "seconds": _reached(seen, _SHARE * least)}
        )
        print(rows[-1], flush=True)
        ways = [("lbfgs(), all targets", None, None, 60)]
        ways += [("adam, all targets", None, optax.adam, 2000)] if count <= 1000 else []
        for name, batch, make, steps in [*ways, ("adam, 64 at a time", 64, optax.adam, 3000)]:
            optimiser = make(optax.cosine_decay_schedule(1e-2, steps)) if make else optax.lbfgs()
            go = lambda n: descend(problem, optimiser, steps=n, starts=starts, batch=batch, progress=False, keep=1)  # noqa: B023, E731
            first, _ = _timed(lambda: go(1))  # noqa: B023
            rest, _ = _timed(lambda: go(1))  # noqa: B023  # a step, and looking at what came out
            used, found = _timed(lambda: go(steps))  # noqa: B023
            used -= rest
            row = {"targets": count, "way": name, "compiling": first, "steps": steps}
            if batch is None:
                best = _best(found.steps)
                at = np.flatnonzero(best <= _SHARE * least)
                row["seconds"] = used * (at[0] + 1) / len(best) if len(at) else None
            else:
                row["seconds"] = used if found.error <= _SHARE * least else None
            row["error over least"] = found.error / least
            rows.append(row)
            print(row, flush=True)
        jax.clear_caches()
    return rows


def tolerances(quick: bool) -> list[dict[str, Any]]:
    """Five timed points, met exactly by many four-bars: which of them suffers least from inaccurate joints."""
    import jax
    import jax.numpy as jnp
    import optax

    import jaxnc as nc
    from benchmarks.synthesis.published import ARC, four_bar
    from jaxnc.compiling import jit

    S, idea = nc.synthesis, four_bar().compile()
    goal, timing = jnp.asarray(ARC), np.radians([30.0, 45.0, 60.0, 75.0, 90.0])
    free, box = ["D.x", "B", "C", "P"], {"A-B": (0.5, 10), "B-C": (0.5, 10), "C-D": (0.5, 10)}
    joints = ("A", "B", "C", "D", "P")

    def made(system: Any, key: Any) -> Any:
        """The squared error of a mechanism whose joints are a little beside where they were drawn."""
        off = _TOLERANCE * jax.random.normal(key, (len(joints), 2))
        other = system.replace({name: system[name] + off[k] for k, name in enumerate(joints)})
        motion = nc.sweep(other, {"phi": timing}, repair=False)
        square = jnp.sum((motion["P"] - goal) ** 2)
        return jnp.where(motion.failures == 0, square, 10.0)  # one that cannot be assembled costs as much

    def mean(system: Any, key: Any) -> Any:
        return jnp.mean(jax.vmap(lambda k: made(system, k))(jax.random.split(key, _SAMPLES)))

    def same(system: Any) -> Any:
        return mean(system, jax.random.key(7))

    fresh = jax.random.split(jax.random.key(1234), _FRESH)
    judge = jit(lambda system: jax.lax.map(lambda key: made(system, key), fresh, batch_size=256))
    rows = []

    def told(name: str, first: float, used: float, found: Any) -> None:
        every = np.asarray(judge(found.best))
        error, sure = every.mean(), every.std() / np.sqrt(len(every))
        rows.append({"way": name, "compiling": first, "seconds": used, "own error": found.error})
        rows[-1] |= {"error as made": float(error), "known to": float(sure)}
        print(rows[-1], flush=True)

    path = S.PathGeneration(four_bar(), "P", ARC, timing=timing, free=free, bounds=box)
    first, _ = _timed(lambda: S.solve(path, starts=200, refine=24, progress=False))
    used, nominal = _timed(
        lambda: S.solve(path, starts=3000, refine=48, keep=40, key=jax.random.key(1), progress=False)
    )
    told("least squares, as drawn", first, used, nominal)
    steps = 60 if quick else 8000
    starts = np.stack([d.x for d in nominal.designs if not d.defects][:8])
    random, fixed = (S.Loss(idea, f, free=free, bounds=box) for f in (mean, same))
    rate = optax.cosine_decay_schedule(1e-2, steps)
    ways = {
        f"adam, {_SAMPLES} fresh samples a step": (random, optax.adam(rate), steps),
        f"adam, the same {_SAMPLES} samples": (fixed, optax.adam(rate), steps),
        f"lbfgs(), the same {_SAMPLES} samples": (fixed, optax.lbfgs(), steps // 40),
    }
    for name, (problem, optimiser, count) in ways.items():
        go = lambda n: S.descend(problem, optimiser, steps=n, starts=starts, keep=1, progress=False)  # noqa: B023, E731
        first, _ = _timed(lambda: go(1))  # noqa: B023
        used, found = _timed(lambda: go(count))  # noqa: B023
        told(name, first, used, found)
    jax.clear_caches()
    return rows


def _shown(value: Any) -> str:
    return "-" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def main() -> int:
    """Measure, print tables, write JSON."""
    p = argparse.ArgumentParser(prog="python -m benchmarks.optimisers", description=__doc__)
    p.add_argument("--quick", action="store_true", help="few steps: does everything run")
    p.add_argument("--only", choices=("points", "targets", "tolerances"), help="one of the three; others are kept")
    p.add_argument("--picture", type=Path, metavar="FILE", help="of the points: Adam's way, every design")
    p.add_argument("--json", type=Path, default=_FILE, metavar="FILE", help="where results go")
    options = p.parse_args()
    machine.pin()
    os.environ["JAX_ENABLE_COMPILATION_CACHE"] = "0"
    import jax

    jax.config.update("jax_enable_x64", True)
    record = json.loads(options.json.read_text()) if options.json.exists() else {}
    for name, measure in (("points", points), ("targets", targets), ("tolerances", tolerances)):
        if options.only not in (None, name):
            continue
        more = {"picture": options.picture} if measure is points else {}
        record[name] = measure(options.quick, **more)
        record |= {"machine": machine.describe(), "date": time.strftime("%Y-%m-%d")}
        options.json.write_text(json.dumps(record, indent=1) + "\n")
        names = list(dict.fromkeys(key for row in record[name] for key in row))
        from jaxnc.synthesis.result import align_columns

        print(align_columns([names, *([_shown(row.get(key)) for key in names] for row in record[name])]))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
