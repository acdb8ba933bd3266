"""``python -m benchmarks.card``: mechanisms of every class where JAX runs, on a graphics card or on one core.

Times are wall time, medians of calls with new inputs: processor time would leave out what the card does. Poses count
as right where the public residual is met, and under ``jit`` where they are also those of the eager call. What other
devices gave stays in the file beside it.
"""

import argparse
import concurrent.futures
import json
import os
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from benchmarks.cases.classes import Class

_WAYS = ("eager", "jit", "naive", "value and gradient")
_MAIN = 100_000
_LANES = {_MAIN: _WAYS, 1_000_000: _WAYS[:2], 2048: _WAYS[:3]}
# Run with other numbers of lanes too: dyads, a redundant block, a torn one.
_VARIED = ("four-bar", "macpherson", "robot ankle")
_ON_HOST = ("robot stewart",)  # solved pose by pose where it is not narrow: tens of seconds
_TOGETHER = 16  # classes that are compiled side by side, before they are timed
_REPEATS = 5
_FEW = 10_000  # lanes of naive steps on a core: as long a time for each as of more
_MET = 1e-9  # of the size: a residual that is larger is no solution
_SAME = 1e-8  # of the size: poses that are farther apart are two
_FOLDER = Path(__file__).parent


class _Case(NamedTuple):
    """A mechanism and so many lanes."""

    one: "Class"
    lanes: int

    def draw(self, seed: int) -> np.ndarray:
        """Draw inputs."""
        u = np.random.default_rng([seed, 7]).uniform(size=(self.lanes, len(self.one.driven)))
        return self.one.low + (self.one.high - self.one.low) * u

    def find(self, u: np.ndarray) -> Any:
        """Find poses outside of traced code."""
        import jaxnc as nc

        columns = {c: np.ascontiguousarray(u[:, k]) for k, c in enumerate(self.one.driven)}
        return nc.solve_position(self.one.system, columns, hold=self.one.hold)


class _Way(NamedTuple):
    """A way to find a case's poses, and how its first call went."""

    case: _Case
    name: str
    run: Callable[[Any], Any]
    takes: Callable[[np.ndarray], Any]

    def seconds(self, seed: int) -> float:
        """Time one call."""
        import jax

        given = jax.block_until_ready(self.takes(self.case.draw(seed)))
        begin = time.perf_counter()
        jax.block_until_ready(self.run(given))
        return time.perf_counter() - begin


def _ways(case: _Case) -> Iterator[_Way]:
    import jax
    import jax.numpy as jnp

    import jaxnc as nc
    from benchmarks.cases.classes import WIDE, naive, value_and_gradient

    one = case.one

    def pose(u: Any) -> Any:
        made = nc.solve_position(one.system, dict(zip(one.driven, u, strict=True)), hold=one.hold)
        return made.q, made.status

    makers: dict[str, Callable[[], Callable]] = {
        "eager": lambda: lambda u: case.find(u).poses,
        "jit": lambda: jax.jit(jax.vmap(pose)),
        "naive": lambda: naive(one),
        "value and gradient": lambda: value_and_gradient(one)[1].run,
    }
    for name in _LANES[case.lanes]:
        if name == "value and gradient" and len(one.system.topology.unknown) > WIDE:
            continue
        few = name == "naive" and jax.default_backend() == "cpu"
        some = case._replace(lanes=min(case.lanes, _FEW)) if few else case
        yield _Way(some, name, makers[name](), (lambda u: u) if name == "eager" else jnp.asarray)


def _measure(only: Sequence[str], on_core: bool) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Measure on the device that JAX has, and yield its name, the version of JAX, and a row of each case."""
    from benchmarks import machine

    cores = os.sched_getaffinity(0)
    if on_core:
        machine.pin()  # before JAX makes its threads
    import jax

    jax.config.update("jax_enable_x64", True)
    device = jax.devices("cpu")[0] if on_core else jax.devices()[0]
    from benchmarks.cases.classes import every_class

    chosen = [one for one in every_class() if (one.name in only if only else one.name not in _ON_HOST)]
    lanes = [_MAIN] if on_core else list(_LANES)
    cases = [_Case(one, n) for one in chosen for n in lanes if n == _MAIN or one.name in _VARIED]
    name = f"One core of an {machine.describe()['cpu']}" if on_core else device.device_kind
    for first in range(0, len(cases), _TOGETHER):
        some = cases[first : first + _TOGETHER]
        os.sched_setaffinity(0, cores)
        with concurrent.futures.ThreadPoolExecutor(len(cores)) as threads:
            ways = [list(_ways(case)) for case in some]
            compiled = [[threads.submit(way.seconds, 0) for way in those] for those in ways]
        if on_core:
            machine.pin()
        for case, those, calls in zip(some, ways, compiled, strict=True):
            failed = [
                f"{way.name}: {call.exception()}" for way, call in zip(those, calls, strict=True) if call.exception()
            ]
            if failed:
                print(f"left out: {case.one.name}, {case.lanes:,}: {'; '.join(failed)}", flush=True)
            else:
                yield name, jax.__version__, _time(case, those)
        jax.clear_caches()


def _time(case: _Case, ways: Sequence[_Way]) -> dict[str, Any]:
    """Time the ways of a case one after the other, and compare their poses."""
    import jax
    import jax.numpy as jnp

    import jaxnc as nc
    from jaxnc.solvers.assembly import derive

    size = float(derive(case.one.system).length)
    times = {way.name: statistics.median(way.seconds(k + 1) for k in range(_REPEATS)) / way.case.lanes for way in ways}
    u = case.draw(1)
    made = case.find(u)
    off = jax.vmap(lambda q: jnp.max(jnp.abs(nc.system.residual(case.one.system, q))))(made.q)
    met = np.asarray(made.converged) & (np.asarray(off) <= _MET * size)
    q, status = next(way for way in ways if way.name == "jit").run(jnp.asarray(u))
    same = np.abs(np.asarray(q) - np.asarray(made.q)).max(axis=1) <= _SAME * size
    right = {"eager": float(met.mean()), "jit": float((met & same & (np.asarray(status) == 0)).mean())}
    return {"name": case.one.name, "lanes": case.lanes, "times": times, "right": right}


def _write(found: dict[str, Any], path: Path) -> None:
    """Write the table."""
    lines = [
        "# On a graphics card, and on one core\n",
        "Written by `python -m benchmarks.card`: nanoseconds a pose, 64 bits. The eager call takes arrays of the host, "
        "`jit` has them on the device. Naive are eight Newton steps in plain JAX on the library's own public residual, "
        f"on a core for {_FEW:,} lanes at most; value and gradient are of a weighted sum of all points, by the design.",
    ]
    for device, part in found.items():
        head = ["mechanism", "lanes", *_WAYS, "naive / jit", "right"]
        lines += [f"\n## {device}, JAX {part['jax']}\n", "| " + " | ".join(head) + " |"]
        lines.append("|:--" + "|--:" * (len(head) - 1) + "|")
        for row in sorted(part["rows"], key=lambda row: (row["lanes"] != _MAIN, row["lanes"], row["name"])):
            times = row["times"]
            cells = ["" if (t := times.get(way)) is None else _in_ns(t) for way in _WAYS]
            cells.append(f"{times['naive'] / times['jit']:.3g}" if "naive" in times else "")
            right = min(row["right"].values())
            cells.append("all" if right == 1.0 else f"{right:.4%}")
            name = f"{row['name']} ({row['note']})" if "note" in row else row["name"]
            lines.append("| " + " | ".join([name, f"{row['lanes']:,}", *cells]) + " |")
    path.write_text("\n".join(lines) + "\n")


def _in_ns(seconds: float) -> str:
    return f"{1e9 * seconds:.3g}" if seconds < 1e-6 else f"{1e9 * seconds:,.0f}"


def main() -> None:
    """Measure where JAX runs, and write the table."""
    p = argparse.ArgumentParser(prog="python -m benchmarks.card", description=__doc__)
    p.add_argument("--json", type=Path, default=_FOLDER / "card.json", metavar="FILE", help="where results go")
    p.add_argument("--only", nargs="+", default=[], metavar="NAME", help="these mechanisms")
    p.add_argument("--core", action="store_true", help="measure one core of the processor, not the device JAX chooses")
    p.add_argument("--report", action="store_true", help="measure nothing: write the table from the file")
    options = p.parse_args()
    found = json.loads(options.json.read_text()) if options.json.exists() else {}
    if not options.report:
        if options.core:
            os.environ["JAX_PLATFORMS"] = "cpu"
        for device, version, row in _measure(options.only, options.core):
            part = found.setdefault(device, {"jax": version, "rows": []})
            part["jax"] = version
            part["rows"] = [old for old in part["rows"] if (old["name"], old["lanes"]) != (row["name"], row["lanes"])]
            part["rows"].append(row)
            options.json.write_text(json.dumps(found, indent=1) + "\n")
            print(json.dumps(row), flush=True)
    _write(found, options.json.with_suffix(".md"))


if __name__ == "__main__":
    main()
