"""``python -m benchmarks.dynamics``: engines side by side, formulations, benchmark problems, batches; tables, JSON."""

import argparse
import inspect
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

_FOLDER = Path(__file__).parent
_PAGE = """# Dynamics measured

<!-- Written by `python -m benchmarks.dynamics`. Do not edit: change benchmarks/dynamics.py and run it again. -->

Processor time of one core, the median of the calls after the first; compilation is the first call less a later one,
without a compilation cache. A call begins with names and numbers and ends with states in NumPy. Drift is the largest
change of the energy since the start. The machine was shared while this ran: compare within a table.

{machine}
"""


def _timed(f: Callable[[float], Any], repeats: int = 12, patience: float = 5.0) -> tuple[Any, float, float]:
    """Result at the nominal speed, median seconds of the later calls, and of the first one more than that."""
    times, out = [], None
    for k in range(repeats):
        start = time.process_time()
        out = f(OMEGA * (1.0 + 1e-14 * k))
        times.append(time.process_time() - start)
        if sum(times[1:]) > patience:
            break
    usual = float(np.median(times[1:] or times))
    return out, usual, max(times[0] - usual, 0.0)


OMEGA = 10.0


def _four_bar():
    import jax.numpy as jnp

    import jaxnc as nc
    from benchmarks.peers import moving_four_bar as hand

    a, b = (np.asarray(x) for x in hand.places(jnp.asarray(hand.THETA)))
    far = (hand.LENGTHS[3], 0.0)
    u = (b - a) / hand.LENGTHS[1]
    middle = a + hand.CENTRE[0] * u + hand.CENTRE[1] * np.array([-u[1], u[0]])
    m = nc.Mechanism("four-bar")
    m.ground("O", (0, 0))
    m.ground("D", far)
    m.point("A", a)
    m.point("B", b)
    places = (a / 2, middle, (b + np.array(far)) / 2)
    for name, ends, mass, inertia, com in zip(
        ("crank", "coupler", "rocker"), ("OA", "AB", "BD"), hand.MASSES, hand.INERTIAS, places, strict=True
    ):
        m.body(name, list(ends), mass=mass, com=com, inertia=inertia)
    m.gravity = (0, -hand.G)
    return m.compile()


def _run(system, t, omega: float, **options):
    import jaxnc as nc
    from benchmarks.peers import moving_four_bar as hand

    across = hand.LENGTHS[0] * np.array([-np.sin(hand.THETA), np.cos(hand.THETA)])
    rates = {"A.x": omega * across[0], "A.y": omega * across[1]}
    return nc.simulate(system, t, rates=rates, throw=False, **options)


def _turned(run) -> tuple[np.ndarray, np.ndarray]:
    """The crank's angle and speed."""
    a, v = np.asarray(run["A"]), np.asarray(run.velocity("A"))
    return np.unwrap(np.arctan2(a[:, 1], a[:, 0])), (a[:, 0] * v[:, 1] - a[:, 1] * v[:, 0]) / np.sum(a * a, axis=1)


def formulations(quick: bool) -> list[dict]:
    """Every formulation on one four-bar, 2 s, against its crank's angle alone solved to 1e-13."""
    from benchmarks.peers import moving_four_bar as hand

    system, t = _four_bar(), np.linspace(0, 2, 41)
    reference = hand.by_hand(t, 1e-13)(OMEGA)[0]
    ways: list[tuple[str, dict]] = [
        (method, {"method": method, "step": h})
        for method in ("rk4", "generalised alpha")
        for h in ((2e-3,) if quick else (2e-3, 5e-4))
    ]
    adaptive = ("dopri8",) if quick else ("dopri8", "kvaerno5")
    ways += [(m, {"method": m, "rtol": r, "atol": 1e-2 * r}) for m in adaptive for r in (1e-6, 1e-9)]
    out = []
    for name, options in ways:
        run, seconds, compiling = _timed(lambda w, o=options: _ended(_run(system, t, w, **o)))
        theta, omega = _turned(run)
        energy = np.asarray(hand.energy(theta, omega))
        steps = int(sum(int(x) for x in run.steps))
        out.append(
            {
                "formulation": name,
                "setting": f"h = {options['step']:g} s" if "step" in options else f"rtol = {options['rtol']:g}",
                "error": float(np.abs(theta - reference).max()),
                "drift": float(np.abs(energy - energy[0]).max()),
                "position": float(run.violation[0]),
                "velocity": float(run.violation[1]),
                "steps": steps,
                "per step": seconds / steps,
                "seconds": seconds,
                "compile": compiling,
            }
        )
        print(f"  {name} {out[-1]['setting']}: error {out[-1]['error']:.2g}, {seconds:.3g} s", file=sys.stderr)
    return out


def _ended(run):
    np.asarray(run.q)
    return run


def engines(quick: bool) -> list[dict]:
    """A four-bar for 10 s in several engines, each at the cheapest of some settings that keeps the energy to 1e-7 J."""
    from benchmarks.peers import moving_four_bar as hand

    system, t = _four_bar(), np.linspace(0, 10, 201)
    reference = hand.by_hand(t, 1e-13)(OMEGA)[0]

    def ours(t, tolerance):
        return lambda w: _turned(_run(system, t, w, rtol=tolerance, atol=1e-2 * tolerance))

    def compiled(t, tolerance):
        import jax

        def states(w):
            run = _run(system, t, w, rtol=tolerance, atol=1e-2 * tolerance)
            return run["A"], run.velocity("A")

        f = jax.jit(states)

        def run(w):
            a, v = (np.asarray(x) for x in f(w))
            speed = (a[:, 0] * v[:, 1] - a[:, 1] * v[:, 0]) / np.sum(a * a, axis=1)
            return np.unwrap(np.arctan2(a[:, 1], a[:, 0])), speed

        return run

    def marched(t, step):
        return lambda w: _turned(_run(system, t, w, method="rk4", step=step))

    loose, tight = (1e-7, 1e-8, 1e-9, 1e-10), (5e-4, 2.5e-4, 1.25e-4)
    ways = [
        ("jaxnc, dopri8", ours, loose, "rtol"),
        ("jaxnc, dopri8 inside jit", compiled, loose, "rtol"),
        ("jaxnc, rk4", marched, tight, "h"),
        ("diffrax by hand, angle alone", hand.by_hand, loose, "rtol"),
        ("diffrax by hand, natural coordinates", hand.natural_by_hand, loose, "rtol"),
        ("Pinocchio", hand.pinocchio, tight, "h"),
        ("MuJoCo", hand.mujoco, (*tight, 4e-5, 1e-5), "h"),
        ("Exudyn", hand.exudyn, (*tight, 2e-5, 1e-5), "h"),
    ]
    out: list[dict] = []
    for name, make, settings, word in ways:
        row: dict[str, Any] = {}
        for setting in settings[:1] if quick else settings:
            try:
                (theta, omega), seconds, compiling = _timed(make(t, setting))
            except ImportError as error:
                row = {"engine": name, "note": f"not installed: {error}"}
                break
            energy = np.asarray(hand.energy(theta, omega))
            row = {
                "engine": name,
                "setting": f"{word} = {setting:g}",
                "error": float(np.abs(theta - reference).max()),
                "drift": float(np.abs(energy - energy[0]).max()),
                "seconds": seconds,
                "compile": compiling,
            }
            print(f"  {name} {setting:g}: drift {row['drift']:.2g}, {seconds:.3g} s", file=sys.stderr)
            if row["drift"] <= 1e-7:
                break
        else:
            row["note"] = "does not keep the energy to 1e-7 J at these settings" if not quick else ""
        out.append(row)
    for row in out:
        row["ratio"] = row["seconds"] / out[0]["seconds"] if "seconds" in row else None
    return out


PROBLEMS: dict[str, tuple[dict, float, int, dict]] = {
    # name: arguments, seconds simulated, times kept, options
    "pendulum": ({}, 10.0, 101, {"rtol": 1e-10, "atol": 1e-12}),
    "double-pendulum": ({}, 10.0, 101, {"rtol": 1e-10, "atol": 1e-12}),
    "n-four-bar": ({"loops": 2}, 10.0, 101, {"method": "rk4", "step": 1e-3, "singular": True}),
    "andrews": ({}, 0.05, 501, {"rtol": 1e-10, "atol": 1e-12}),
    "bricard": ({}, 10.0, 101, {"rtol": 1e-10, "atol": 1e-12}),
    "flyball-governor": ({}, 10.0, 2001, {"method": "generalised alpha", "step": 1e-3}),
    "spatial-slider-crank": ({}, 5.0, 101, {"rtol": 1e-10, "atol": 1e-12}),
    "heavy-top": ({}, 2.0, 101, {"method": "rk4", "step": 2e-4}),
    "n-four-bar, 40 loops": ({"loops": 40}, 10.0, 101, {"method": "rk4", "step": 5e-3, "singular": True}),
}


def _expected(name: str, arguments: dict, t: np.ndarray) -> tuple[str, Callable[[Any], np.ndarray]] | None:
    """What a problem is held against, and the largest difference of a run from it."""
    import jax
    import jax.numpy as jnp

    from tests.independent import lagrange

    def points(expected, point):
        return lambda run: np.abs(np.asarray(run[point]) - expected).max()

    if name == "pendulum":
        z, _ = lagrange.motion(lambda z, dz: 0.5 * dz[0] ** 2 - lagrange.G * jnp.sin(z[0]), [np.pi], [0.0], t)
        return "place of P [m]", points(np.column_stack([np.cos(z[:, 0]), np.sin(z[:, 0])]), "P")
    if name == "double-pendulum":
        z, _ = lagrange.motion(lagrange.double_pendulum, [0.0, 0.0], [0.0, 0.0], t)
        return "place of Q [m]", points(np.column_stack([np.cos(z).sum(axis=1), np.sin(z).sum(axis=1)]), "Q")
    if name == "n-four-bar":
        z, _ = lagrange.motion(lagrange.n_four_bar(arguments["loops"]), [0.0], [1.0], t)
        return "place of B0 [m]", points(np.column_stack([np.sin(z[:, 0]), np.cos(z[:, 0])]), "B0")
    if name == "andrews":
        file = json.loads((_FOLDER.parent / "tests/reference/a03_andrews_squeezer.json").read_text())["reference"]
        known = dict(zip(file["t"], np.array(file["angles"])[:, 0], strict=True))
        more = file["continuation_to_0_05"]
        known |= dict(zip(more["t"], more["beta"], strict=True))
        at = [(k, known[x]) for x in known for k in np.flatnonzero(np.abs(t - x) < 1e-12)]
        return "angle of the crank [rad]", lambda run: max(abs(float(run["beta"][k]) - beta) for k, beta in at)
    if name == "bricard":
        file = json.loads((_FOLDER.parent / "tests/reference/a04_bricard.json").read_text())["reference"]
        at = [(k, p) for x, p in zip(file["t"], file["P3"], strict=True) for k in np.flatnonzero(np.abs(t - x) < 1e-12)]
        return "place of P2 [m]", lambda run: max(np.abs(np.asarray(run["P2"][k]) - p).max() for k, p in at)
    if name == "flyball-governor":
        lagrangian, loss, start = lagrange.flyball_governor()
        z, _ = lagrange.motion(lagrangian, start, [2 * np.pi, 0.0, 0.0], t, loss, "Radau", 1e-11, 1e-12)
        return "height of the slider [m]", lambda run: np.abs(np.asarray(run["S"])[:, 2] - z[:, 2]).max()
    if name == "spatial-slider-crank":
        lagrangian, slider = lagrange.spatial_slider_crank()
        z, _ = lagrange.motion(lagrangian, [0.0], [6.0], t)
        return "place of the slider [m]", points(np.asarray(jax.vmap(slider)(z[:, 0])), "C")
    if name == "heavy-top":
        z, _ = lagrange.motion(lagrange.heavy_top, [0.0, np.pi / 2, 0.0], [0.0, -4.61538, 150.0], t)
        s, c = np.sin(z), np.cos(z)
        return "its axis [m]", points(np.column_stack([c[:, 1], s[:, 1] * c[:, 0], s[:, 1] * s[:, 0]]), "C")
    return None


def _balance(run) -> np.ndarray:
    """Energy less the work that springs, stops and weights do not account for: constant where all is right."""
    import jax
    from scipy.interpolate import CubicSpline

    from jaxnc.dynamics.model import forces, potential
    from jaxnc.dynamics.reactions import states_of

    dyn, t, q, v, _ = states_of(run)
    power = jax.vmap(lambda t, q, v: v @ (forces(dyn, t, q, v) + jax.grad(potential, argnums=1)(dyn, q)))(t, q, v)
    work = CubicSpline(np.asarray(t), np.asarray(power)).antiderivative()(np.asarray(t))
    return np.asarray(run.energy) - work


def problems(quick: bool, only: list[str] | None = None) -> list[dict]:
    """The benchmark problems of the library, each at one setting that its precision asks for.

    Error: the largest difference, at the times kept, from the reference (Andrews, Bricard) or from Lagrange's
    equations in independent coordinates, integrated by SciPy to 1e-12 (others; the governor, which is stiff, to 1e-11).
    Drift: of the energy, less the work of motors and dampers.
    """
    import jaxnc as nc
    from jaxnc.library.benchmarks import BENCHMARKS

    out = []
    for name, (arguments, duration, kept, options) in PROBLEMS.items():
        if name not in (only or PROBLEMS) or (quick and "40" in name):
            continue
        short = name.partition(",")[0]
        m = BENCHMARKS[short](**arguments)
        system, start = m.compile(), m.model.simulate
        t = np.linspace(0, duration / (20 if quick else 1), kept)

        def once(_, system=system, t=t, start=start, options=options):
            return _ended(nc.simulate(system, t, rates=start.rates or None, throw=False, **options))

        run, seconds, compiling = _timed(once, 4, 5.0)
        expected = _expected(short, arguments, t)
        balance = _balance(run)
        row: dict[str, Any] = {
            "problem": name,
            "duration": float(t[-1]),
            "method": ", ".join(f"{k} {v}" for k, v in ({"method": "dopri8"} | options).items() if k != "singular"),
            "unknowns": len(system.topology.unknown),
            "rows": len(system.topology.rows),
            "steps": int(run.steps[0]),
            "error": None if expected is None else float(expected[1](run)),
            "of": "–" if expected is None else expected[0],
            "energy": float(np.ptp(np.asarray(nc.dynamics.kinetic_energy(run)))),
            "drift": float(np.abs(balance - balance[0]).max()),
            "position": float(run.violation[0]),
            "reached": float(np.mean(np.asarray(run.status) == 0)),
            "seconds": seconds,
            "compile": compiling,
        }
        print(f"  {name}: error {row['error']}, drift {row['drift']:.2g}, {row['seconds']:.3g} s", file=sys.stderr)
        out.append(row)
    return out


def batches(quick: bool) -> list[dict]:
    """A thousand slider-cranks at once, each at its own speed: steps of RK4 (1e-3 s), positions and rates projected.

    On one host device and on two, lanes shared out by `jax.shard_map`; the median of ten calls of 100 steps. By the
    wall clock, which other processes slow down, and by the processor's time, which they do not.
    """
    from benchmarks import fresh

    out = []
    for way, name in (("jaxnc", "jaxnc"), ("by-hand", "the crank's angle alone, by hand")):
        found = fresh.measure(
            f"marching:{way}:{200 if quick else 1000}", {"XLA_FLAGS": "--xla_force_host_platform_device_count=2"}
        )
        for devices in ("1", "2"):
            one = found[devices]
            out.append(
                {
                    "way": name,
                    "devices": int(devices),
                    "wall": one["by wall"] / 1e6,
                    "processor": one["by processor"] / 1e6,
                    "drift": one["drift"],
                    "energy": one["energy"],
                }
            )
            print(f"  {name}, {devices}: {out[-1]['wall']:.3g} million steps a second", file=sys.stderr)
    return out


def _number(value: Any) -> str:
    if value is None or value == "":
        return "–"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def table(rows: list[dict], columns: dict[str, str]) -> str:
    """Rows as a Markdown table."""
    lines = ["| " + " | ".join(columns.values()) + " |", "|" + " --- |" * len(columns)]
    lines += ["| " + " | ".join(_number(r.get(k)) for k in columns) + " |" for r in rows]
    return "\n".join(lines)


def page(found: dict[str, Any]) -> str:
    """The page of a run."""
    m = found["machine"]
    versions = ", ".join(f"{k} {v}" for k, v in m["versions"].items())
    parts = [_PAGE.format(machine=f"{m['cpu']}; Python {m['python']}, {versions}.")]
    if "formulations" in found:
        columns = {"formulation": "formulation", "setting": "setting", "error": "error [rad]", "drift": "drift [J]",
                   "position": "Φ", "velocity": "dΦ/dt", "steps": "steps", "per step": "s/step", "seconds": "s",
                   "compile": "compile [s]"}  # fmt: skip
        parts += ["## Formulations\n", f"{formulations.__doc__}\n", table(found["formulations"], columns) + "\n"]
    if "engines" in found:
        columns = {"engine": "engine", "setting": "setting", "error": "error [rad]", "drift": "drift [J]",
                   "seconds": "s", "ratio": "× first line", "compile": "compile [s]", "note": "note"}  # fmt: skip
        parts += ["## Engines\n", f"{engines.__doc__}\n", table(found["engines"], columns) + "\n"]
    if "problems" in found:
        columns = {"problem": "problem", "duration": "simulated [s]", "method": "method", "unknowns": "n",
                   "rows": "rows", "steps": "steps", "error": "error", "of": "of",
                   "energy": "kinetic energy varies by [J]",
                   "drift": "drift [J]", "position": "Φ", "reached": "reached",
                   "seconds": "s", "compile": "compile [s]"}  # fmt: skip
        parts += ["## Benchmark problems\n", f"{inspect.cleandoc(problems.__doc__ or '')}\n"]
        parts.append(table(found["problems"], columns) + "\n")
    if "batches" in found:
        columns = {"way": "way", "devices": "devices", "wall": "million steps/s by the wall",
                   "processor": "per second of processor time", "drift": "drift [J]",
                   "energy": "energy, up to [J]"}  # fmt: skip
        text = inspect.cleandoc(batches.__doc__ or "")
        parts += ["## Batches\n", f"{text}\n", table(found["batches"], columns) + "\n"]
    return "\n".join(parts)


PARTS: dict[str, Callable[..., list[dict]]] = {
    "engines": engines,
    "formulations": formulations,
    "problems": problems,
    "batches": batches,
}


def main() -> int:
    """Run the parts that are asked for; others are kept from the last run."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.dynamics", description=__doc__)
    parser.add_argument("--part", nargs="+", choices=tuple(PARTS))
    parser.add_argument("--quick", action="store_true", help="short runs, printed and not kept: does everything work")
    parser.add_argument("--only", nargs="+", choices=tuple(PROBLEMS), help="of the problems; the others are kept")
    options = parser.parse_args()
    from benchmarks import machine

    machine.pin()
    import jax

    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_enable_compilation_cache", False)
    path = _FOLDER / "dynamics.json"
    found = json.loads(path.read_text()) if path.exists() and not options.quick else {}
    found["machine"] = machine.describe()
    wanted = options.part or list(PARTS)
    for part, measure in PARTS.items():
        if part == "problems" and part in wanted and options.only:
            new = {row["problem"]: row for row in problems(options.quick, options.only)}
            old = {row["problem"]: row for row in found.get(part, [])}
            found[part] = [(old | new)[name] for name in PROBLEMS if name in old | new]
        elif part in wanted:
            found[part] = measure(options.quick)
        if part in wanted and not options.quick:
            path.write_text(json.dumps(found, indent=1) + "\n")
            (_FOLDER / "dynamics.md").write_text(page(found))
    print(page(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
