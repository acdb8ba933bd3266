"""Measurements that need a process of their own: ``python -m benchmarks.fresh NAME`` prints one line of JSON."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

_ENOUGH = 60.0  # seconds after which a slow measurement is not repeated


def measure(name: str, env: Mapping[str, str] | None = None, timeout: float = 600.0) -> dict[str, Any]:
    """Run a measurement in a fresh process without a compilation cache.

    Args:
        name: name in `MEASUREMENTS`, with arguments after colons.
        env: environment variables on top.
        timeout: seconds after which to give up.

    Raises:
        RuntimeError: with the end of what it said, if it failed.
    """
    # Modules are compiled to bytecode by pip, or once by Python: that is not waited for again by anybody.
    apart = ("JAX_", "XLA_FLAGS", "PYTHONDONTWRITEBYTECODE")
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(apart)}
    inherited |= {"JAX_ENABLE_X64": "1", "JAX_ENABLE_COMPILATION_CACHE": "0", **(env or {})}
    command = [sys.executable, "-m", "benchmarks.fresh", name]
    done = subprocess.run(
        command, capture_output=True, text=True, env=inherited, timeout=timeout, cwd=Path(__file__).parents[1]
    )
    if done.returncode:
        lines = done.stderr.strip().splitlines()
        raise RuntimeError(lines[-1][:300] if lines else f"exit status {done.returncode}")
    return json.loads(done.stdout.strip().splitlines()[-1])


def _first_call(mechanism: str) -> dict[str, Any]:
    """Seconds of the first and of a later batched call, and of everything before it."""
    start = time.process_time()
    import jax
    import numpy as np

    import jaxnc as nc
    from benchmarks.circles import FourBars
    from benchmarks.mechanisms import four_bar

    imported = time.process_time()
    if mechanism == "four-bar":
        system = four_bar(FourBars.default()).compile()
        sets = [({"phi": np.linspace(0.1 * k, 6.0, 4000)}, ()) for k in range(3)]
    else:
        system = nc.library.macpherson().compile()
        home = np.asarray(system["10"])[1]
        sets = [
            ({"6.z": np.linspace(250.0 + k, 370.0, 1000), "10.y": home + np.linspace(-20.0, 20.0, 1000)}, ("7.x",))
            for k in range(3)
        ]
    built = time.process_time()
    seconds = []
    for inputs, hold in sets:
        begin = time.process_time()
        motion = jax.block_until_ready(nc.solve_position(system, inputs, hold=hold, throw=False))
        seconds.append(time.process_time() - begin)
    return {
        "import_s": imported - start,
        "build_s": built - imported,
        "first_s": seconds[0],
        "later_s": min(seconds[1:]),
        "lanes": int(motion.status.size),
        "converged": float(np.mean(np.asarray(motion.converged))),
    }


class _Waited:
    """Seconds that a person waits for things done one after the other."""

    def __init__(self):
        self.seconds: dict[str, float] = {}
        begin = time.perf_counter()
        import numpy  # noqa: F401

        self.seconds["import numpy"] = time.perf_counter() - begin
        import jax  # noqa: F401

    def __call__(self, name: str, do: Callable[[], Any]) -> Any:
        begin = time.perf_counter()
        found = do()
        self.seconds[name] = time.perf_counter() - begin
        return found


def _first_answers(mechanism: str) -> dict[str, Any]:
    """Seconds until a mechanism is compiled, swept, swept with other numbers, and again."""
    waited = _Waited()
    import numpy as np

    import jaxnc as nc

    def ask(system: nc.System, count: int) -> nc.Motion:
        if mechanism == "MacPherson":
            inputs, rates, hold = {"6.z": np.linspace(270.0, 350.0, count)}, {"6.z": 1.0}, ("10.y", "7.x")
        else:
            inputs, rates, hold = {"phi": np.linspace(0.0, 2 * np.pi, count)}, {"phi": 10.0}, ()
        motion = nc.sweep(system, inputs, rates=rates, hold=hold)
        np.asarray(motion.velocity(system.topology.points[-1]))
        return motion

    made = {"four-bar": nc.library.four_bar, "Jansen": nc.library.jansen_leg, "MacPherson": nc.library.macpherson}
    drawn = made[mechanism]()
    system = waited("compile", drawn.compile)
    found = [waited("first sweep", lambda: ask(system, 361)), waited("another number", lambda: ask(system, 200))]
    found.append(waited("second sweep", lambda: ask(system, 361)))
    point = next(n for n in system.topology.points if n in drawn.model.points)
    moved = system.replace({point: np.asarray(system[point]) * 1.001})
    found.append(waited("another design", lambda: ask(moved, 361)))
    at = {"6.z": 300.0} if mechanism == "MacPherson" else {"phi": 1.0}
    hold = ("10.y", "7.x") if mechanism == "MacPherson" else ()
    found.append(waited("first pose", lambda: nc.solve_position(system, at, hold=hold)))
    return {"seconds": waited.seconds, "right": min(float(np.mean(np.asarray(m.converged))) for m in found)}


def _search(kind: str) -> dict[str, Any]:
    """Seconds until the first design of a search, and of a second problem with other numbers."""
    waited = _Waited()
    from pathlib import Path

    import jax
    import numpy as np

    from benchmarks.synthesis.beyond import FOLDER
    from benchmarks.synthesis.published import PUBLISHED
    from jaxnc.io.problems import load_problem
    from jaxnc.synthesis import Result, solve

    traced: list[str] = []
    jax.monitoring.register_event_duration_secs_listener(lambda event, duration_secs, **_: traced.append(event))
    case = {"path": 1, "function": -1, "suspension": None}[kind]

    def search(key: int) -> Result:
        if case is None:
            problem, settings = load_problem(Path(FOLDER) / "bump_steer.toml")
            return solve(problem, settings.starts, settings.refine, key=jax.random.key(key), progress=False)
        one = PUBLISHED[case]
        return solve(one.state(), **one.search, key=jax.random.key(key), progress=False)

    found = [waited("first search", lambda: search(0))]
    before = len(traced)
    found.append(waited("second search", lambda: search(1)))
    assert not any("compile" in name or "trace" in name for name in traced[before:])
    return {"seconds": waited.seconds, "right": float(np.mean([r.found for r in found]))}


def _linkages(count: str) -> dict[str, Any]:
    """Seconds for different linkages one after the other: rows of parallel four-bars with bodies of random shape."""
    waited = _Waited()
    import numpy as np

    import jaxnc as nc

    rng = np.random.default_rng(7)

    def one(number: int) -> float:
        m = nc.Mechanism(f"linkage {number}")
        m.ground("G0", (0.0, 0.0))
        m.point("P0", (0.3, 0.4))
        m.body("crank", ["G0", "P0"])
        for k in range(1 + number % 4):
            x = 2.0 * (k + 1) + rng.uniform(-0.2, 0.2)
            m.ground(f"G{k + 1}", (x, rng.uniform(-0.2, 0.2)))
            m.point(f"P{k + 1}", (x + 0.4, 2.0 + rng.uniform(-0.2, 0.2)))
            m.point(f"Q{k}", (x - 1.0, 1.5 + rng.uniform(-0.3, 0.3)))
            ternary = [f"P{k}", f"P{k + 1}", f"Q{k}"][: 2 + (number + k) % 2]
            m.body(f"coupler {k}", ternary)
            m.body(f"rocker {k}", [f"G{k + 1}", f"P{k + 1}"])
            if len(ternary) == 2:
                m.body(f"arm {k}", [f"G{k + 1}", f"P{k + 1}", f"Q{k}"])
        m.angle("phi", at="G0", to="P0")
        motion = nc.sweep(m.compile(), {"phi": np.linspace(0.93, 1.5, 91)})
        return float(np.mean(np.asarray(motion.converged)))

    right = waited("all", lambda: [one(number) for number in range(int(count))])
    return {"seconds": waited.seconds, "right": min(right)}


def _row(way: str, loops: str) -> dict[str, Any]:
    """Seconds of single poses of a row of four-bars, each at another angle."""
    import jax
    import numpy as np

    import jaxnc as nc
    from benchmarks.circles import RELATIVE
    from benchmarks.mechanisms import row_of_loops
    from benchmarks.peers import sparse_row

    count = int(loops)
    home = float(np.arctan2(sparse_row.FIRST[1], sparse_row.FIRST[0]))
    size = float(np.hypot(*sparse_row.FIRST))
    feet = np.stack([np.arange(1, count + 1), np.zeros(count)], axis=1)
    seconds, rights, steps, step_seconds = [], [], 0, []
    system = row_of_loops(count).compile() if way == "jaxnc" else None
    for k in range(6):
        if len(seconds) > 2 and sum(seconds) > _ENOUGH:
            break
        phi = home + 0.01 * (k + 1)
        start = time.process_time()
        if system is not None:
            motion = jax.block_until_ready(nc.solve_position(system, {"phi": phi}))
            seconds.append(time.process_time() - start)
            # The points come in the order they were added: G0, P0, G1, P1, ...
            names = {name: i for i, name in enumerate(system.topology.points)}
            places = np.asarray(motion.q)[: 2 * len(names)].reshape(-1, 2)
            tips = places[[names[f"P{i}"] for i in range(1, count + 1)]]
        else:
            found = sparse_row.solve(count, phi)
            seconds.append(time.process_time() - start)
            tips, steps = found.tips, found.steps
            step_seconds.append(found.seconds_per_step)
        wanted = feet + size * np.array([np.cos(phi), np.sin(phi)])
        rights.append(float(np.mean(np.abs(tips - wanted).max(axis=1) <= RELATIVE * count)))
    out: dict[str, Any] = {"seconds": seconds[1:], "right": rights, "steps": steps, "step_seconds": step_seconds}
    if system is not None:
        out["compile_s"] = max(0.0, seconds[0] - seconds[1])
    return out


def _devices(way: str, lanes: str, cores: str = "all") -> dict[str, Any]:
    """Seconds of the four-bar's lanes on one and on two devices, in turn; on one core only those of one device."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, range(os.cpu_count() or 1) if cores == "all" else [0])
    numbers = (1, 2) if cores == "all" else (1,)
    import jax
    import numpy as np

    from benchmarks import sharing
    from benchmarks.circles import FourBars, fraction
    from benchmarks.mechanisms import four_bar
    from benchmarks.peers import hand_written

    bars, count = FourBars.default(), int(lanes)
    all_devices = jax.devices()[:2]
    if way == "jaxnc":
        system, how = four_bar(bars).compile(), sharing.HOW
        runs = {n: sharing.solver(system, all_devices[:n]) for n in numbers}
    else:
        kernel, how = hand_written.kernel(bars, 2), "jax.shard_map around the kernel"

        def part(phi):
            x, y, _, status = kernel(phi)
            return jax.numpy.stack([x, y], axis=-1), status

        runs = {n: sharing.shared(part, all_devices[:n]) for n in numbers}
    out: dict[str, Any] = {"how": how, **{str(n): {"seconds": [], "right": []} for n in runs}}
    for k in range(7):
        phi = np.linspace(0.0, 2 * np.pi, count) + 0.01 * k
        for n, run in runs.items():
            here = sharing.placed(phi, all_devices[:n])
            start = time.perf_counter()
            c, status = jax.block_until_ready(run(here))
            out[str(n)]["seconds"].append(time.perf_counter() - start)
            wanted = bars.poses(phi)[1]
            out[str(n)]["right"].append(fraction(np.asarray(c), wanted, float(bars.ground), np.asarray(status) == 0))
    for n in runs:
        first, second, *_ = out[str(n)]["seconds"]
        out[str(n)] |= {"compile_s": max(0.0, first - second), "seconds": out[str(n)]["seconds"][2:]}
    return out


def _marching(way: str, lanes: str) -> dict[str, Any]:
    """Steps per second of slider-cranks under gravity on one device bound to one core, or on two, in turn."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, range(os.cpu_count() or 1))
    import jax
    import numpy as np

    from benchmarks import sharing
    from benchmarks.cases import dynamics

    def part(speeds):
        energies = (dynamics._natural if way == "jaxnc" else dynamics._by_hand)(speeds)
        return energies[:, 0], energies[:, -1]

    dynamics._system()
    count, all_devices = int(lanes), jax.devices()[:2]
    runs = {n: sharing.shared(part, all_devices[:n]) for n in (1, 2)}
    out: dict[str, Any] = {str(n): {"rates": [], "drift": 0.0} for n in runs}
    for k in range(12):
        speeds = np.random.default_rng(k).uniform(0.2, 0.6, count)
        for n, run in runs.items():
            here = sharing.placed(speeds, all_devices[:n])
            wall, cpu = time.perf_counter(), time.process_time()
            first, last = (np.asarray(x) for x in run(here))
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            found = out[str(n)]
            found["drift"] = max(found["drift"], float(np.abs(last - first).max()))
            found["energy"] = float(np.abs(first).max())
            if k > 1:
                found["rates"].append([count * dynamics.STEPS / wall, count * dynamics.STEPS / cpu])
    for found in out.values():
        found["by wall"], found["by processor"] = np.median(found.pop("rates"), axis=0).tolist()
    return out


MEASUREMENTS: dict[str, Callable[..., dict[str, Any]]] = {
    "first-answers": _first_answers,
    "linkages": _linkages,
    "search": _search,
    "first-call": _first_call,
    "row": _row,
    "devices": _devices,
    "marching": _marching,
}


if __name__ == "__main__":
    _name, *_arguments = sys.argv[1].split(":")
    print(json.dumps(MEASUREMENTS[_name](*_arguments)))
