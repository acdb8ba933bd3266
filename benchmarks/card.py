"""``python -m benchmarks.card``: mechanisms of every class on a graphics card, beside one core of the same machine.

Times are wall time, medians of calls with new inputs: processor time would leave out what the card does. Poses are
counted as right where the public residual is met and the other device found the same place.
"""

import argparse
import functools
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

_LANES = (100_000, 1_000_000, 2048)
_NAMES = (
    "four-bar",
    "macpherson",
    "robot ankle",
    "robot stewart",
    "robot gripper",
    "robot delta",
    "generic-mechanism",
    "rscr",
    "spherical-four-bar",
    "jansen-leg",
    "double-wishbone",
)
_MANY = ("four-bar", "macpherson", "robot ankle")  # run with the most lanes too
_REPEATS = 5
_SAMPLE = 512  # poses that are compared between the devices
_SAME = 1e-8  # of the size: poses that are farther apart are two
_FOLDER = Path(__file__).parent


def _median(run: Callable[[int], Any]) -> tuple[float, float]:
    """Time a call: seconds of the first one, and the median of others."""
    import jax

    def seconds(seed: int) -> float:
        given = run(seed)
        begin = time.perf_counter()
        jax.block_until_ready(given())
        return time.perf_counter() - begin

    first = seconds(0)
    return first, statistics.median(seconds(k + 1) for k in range(_REPEATS))


def _measure(seconds: float, only: list[str]) -> dict[str, Any]:
    """Measure on this process's device until the seconds are over."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    jax.config.update("jax_enable_x64", True)
    import jaxnc as nc
    from benchmarks.cases.classes import every_class, gradients, naive
    from jaxnc.solvers.assembly import derive

    begun, rows, poses = time.perf_counter(), [], {}
    classes = {one.name: one for one in every_class()}
    for lanes in _LANES:
        for name in _NAMES if lanes <= 100_000 else _MANY:
            one = classes[name]
            if (only and name not in only) or time.perf_counter() - begun > seconds:
                continue

            def draw(seed: int, one=one, lanes=lanes) -> np.ndarray:
                u = np.random.default_rng([seed, 7]).uniform(size=(lanes, len(one.driven)))
                return one.low + (one.high - one.low) * u

            def found(u: Any, one=one) -> nc.Motion:
                columns = {c: np.ascontiguousarray(u[:, k]) for k, c in enumerate(one.driven)}
                return nc.solve_position(one.system, columns, hold=one.hold)

            def pose(u: Any, one=one) -> Any:
                made = nc.solve_position(one.system, dict(zip(one.driven, u, strict=True)), hold=one.hold)
                return made.q, made.status

            compiled, steps = jax.jit(jax.vmap(pose)), naive(one)
            ways: dict[str, Callable[[Any], Any]] = {
                "eager": lambda u, found=found: found(u).poses,
                "jit": compiled,
                "naive": steps,
            }
            if lanes == 100_000:
                value = gradients(one)[1]
                ways["value and gradient"] = value.run
            row: dict[str, Any] = {"name": name, "lanes": lanes, "unknowns": len(one.system.topology.unknown)}
            for way, run in ways.items():
                if lanes > 100_000 and way == "naive":
                    continue

                def given(seed: int, run=run, way=way, draw=draw) -> Callable[[], Any]:
                    u = draw(seed) if way == "eager" else jax.block_until_ready(jnp.asarray(draw(seed)))
                    return functools.partial(run, u)

                try:
                    first, later = _median(given)
                except Exception as error:  # what breaks on a device is a result too
                    row[way] = f"{type(error).__name__}: {str(error)[:300]}"
                    print(name, lanes, way, row[way], flush=True)
                    continue
                row[way] = {"first": first, "lane": later / lanes}
                print(name, lanes, way, f"{first:.2f} s, {later / lanes * 1e6:.4f} us", flush=True)
            u = draw(1)
            made = found(u)
            off = jax.vmap(lambda q, s=one.system: jnp.max(jnp.abs(nc.system.residual(s, q))))(made.q)
            met = np.asarray(made.converged) & (np.asarray(off) <= 1e-9 * float(derive(one.system).length))
            row["right"] = float(met.mean())
            poses[f"{name}, {lanes}"] = np.where(met[:, None], np.asarray(made.q), np.nan)[:_SAMPLE].tolist()
            q, status = compiled(jnp.asarray(u))
            agree = np.abs(np.asarray(q) - np.asarray(made.q)).max(axis=1) <= _SAME * float(derive(one.system).length)
            row["jit right"] = float((met & agree & (np.asarray(status) == 0)).mean())
            rows.append(row)
            jax.clear_caches()
    return {"device": jax.devices()[0].device_kind, "jax": jax.__version__, "rows": rows, "poses": poses}


def main() -> None:
    """Measure both devices, one process each, and write the table."""
    p = argparse.ArgumentParser(prog="python -m benchmarks.card", description=__doc__)
    p.add_argument("--seconds", type=float, default=1e9, help="that each device gets")
    p.add_argument("--out", type=Path, default=_FOLDER / "card.json")
    p.add_argument("--here", action="store_true", help="measure the device of this process only")
    p.add_argument("--only", nargs="+", default=[], metavar="NAME", help="of the classes, these")
    options = p.parse_args()
    if options.here:
        options.out.write_text(json.dumps(_measure(options.seconds, options.only)))
        return
    found = {}
    for platform in ("cuda", "cpu"):
        place = options.out.with_suffix(f".{platform}.json")
        command = [sys.executable, "-m", "benchmarks.card", "--here", "--seconds", str(options.seconds)]
        pinned = ["taskset", "-c", "1"] if platform == "cpu" else []
        subprocess.run([*pinned, *command, "--out", str(place)], check=True, env={**os.environ, "JAX_PLATFORMS": platform})
        found[platform] = json.loads(place.read_text())
    options.out.write_text(json.dumps(found))


if __name__ == "__main__":
    main()
