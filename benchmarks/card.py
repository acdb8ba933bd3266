"""``python -m benchmarks.card``: mechanisms of every class where JAX runs, on a graphics card or on one core.

Times are wall time, medians of calls with new inputs: processor time would leave out what the card does. Poses count
as right where the public residual is met, and under ``jit`` where they are also those of the eager call. What other
devices gave stays in the file beside it.
"""

import argparse
import concurrent.futures
import functools
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
# The first three (dyads, a redundant block, a torn one) are run with other numbers of lanes too.
_CLASSES = {
    "four-bar": (2048, 100_000, 1_000_000),
    "macpherson": (2048, 100_000, 1_000_000),
    "robot ankle": (2048, 100_000, 1_000_000),
    "robot delta": (100_000,),
    "robot gripper": (100_000,),
    "rscr": (100_000,),
    "spherical-four-bar": (100_000,),
    "jansen-leg": (100_000,),
    "five-bar": (100_000,),
}
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
    from benchmarks.cases.classes import naive, value_and_gradient

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
        few = name == "naive" and jax.default_backend() == "cpu"
        some = case._replace(lanes=min(case.lanes, _FEW)) if few else case
        yield _Way(some, name, makers[name](), (lambda u: u) if name == "eager" else jnp.asarray)


def _measure(only: Sequence[str], on_core: bool) -> tuple[str, dict[str, Any]]:
    """Measure on the device that JAX has: compile everything side by side, then time one way after the other."""
    from benchmarks import machine

    cores = os.sched_getaffinity(0)
    if on_core:
        machine.pin()  # before JAX makes its threads
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    device = jax.devices("cpu")[0] if on_core else jax.devices()[0]
    os.sched_setaffinity(0, cores)
    import jaxnc as nc
    from benchmarks.cases.classes import every_class
    from jaxnc.solvers.assembly import derive

    classes = {one.name: one for one in every_class() if one.name in (only or _CLASSES)}
    cases = [_Case(classes[name], lanes) for lanes in _LANES for name in classes if lanes in _CLASSES[name]]
    cases = [case for case in cases if not on_core or case.lanes == _MAIN]
    rows = []
    with concurrent.futures.ThreadPoolExecutor(len(cores)) as threads:
        ways = [list(_ways(case)) for case in cases]
        concurrent.futures.wait([threads.submit(way.seconds, 0) for those in ways for way in those])
    if on_core:
        machine.pin()
    for case, those in zip(cases, ways, strict=True):
        size = float(derive(case.one.system).length)
        row: dict[str, Any] = {"name": case.one.name, "lanes": case.lanes, "times": {}}
        for way in those:
            row["times"][way.name] = statistics.median(way.seconds(k + 1) for k in range(_REPEATS)) / way.case.lanes
        u = case.draw(1)
        made = case.find(u)
        off = jax.vmap(functools.partial(lambda s, q: jnp.max(jnp.abs(nc.system.residual(s, q))), case.one.system))
        met = np.asarray(made.converged) & (np.asarray(off(made.q)) <= _MET * size)
        q, status = next(way for way in those if way.name == "jit").run(jnp.asarray(u))
        same = np.abs(np.asarray(q) - np.asarray(made.q)).max(axis=1) <= _SAME * size
        row["right"] = {"eager": float(met.mean()), "jit": float((met & same & (np.asarray(status) == 0)).mean())}
        rows.append(row)
        print(json.dumps(row), flush=True)
    name = f"One core of an {machine.describe()['cpu']}" if on_core else device.device_kind
    return name, {"jax": jax.__version__, "rows": rows}


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
        for row in sorted(part["rows"], key=lambda row: list(_CLASSES).index(row["name"])):
            times = row["times"]
            cells = ["" if (t := times.get(way)) is None else _in_ns(t) for way in _WAYS]
            cells.append(f"{times['naive'] / times['jit']:.3g}" if "naive" in times else "")
            right = min(row["right"].values())
            cells.append("all" if right == 1.0 else f"{right:.4%}")
            lines.append("| " + " | ".join([row["name"], f"{row['lanes']:,}", *cells]) + " |")
    path.write_text("\n".join(lines) + "\n")


def _in_ns(seconds: float) -> str:
    return f"{1e9 * seconds:.3g}" if seconds < 1e-6 else f"{1e9 * seconds:,.0f}"


def main() -> None:
    """Measure where JAX runs, and write the table."""
    p = argparse.ArgumentParser(prog="python -m benchmarks.card", description=__doc__)
    p.add_argument("--json", type=Path, default=_FOLDER / "card.json", metavar="FILE", help="where results go")
    p.add_argument("--only", nargs="+", default=[], metavar="NAME", choices=_CLASSES, help="these mechanisms")
    p.add_argument("--core", action="store_true", help="measure one core of the processor, not the device JAX chooses")
    p.add_argument("--report", action="store_true", help="measure nothing: write the table from the file")
    options = p.parse_args()
    found = json.loads(options.json.read_text()) if options.json.exists() else {}
    if not options.report:
        if options.core:
            os.environ["JAX_PLATFORMS"] = "cpu"
        device, part = _measure(options.only, options.core)
        found[device] = part
        options.json.write_text(json.dumps(found, indent=1) + "\n")
    _write(found, options.json.with_suffix(".md"))


if __name__ == "__main__":
    main()
