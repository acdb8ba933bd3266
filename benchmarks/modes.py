"""All assemblies against PHCpack, ``python -m benchmarks.modes``: the same sets, complex ones too, and times.

The equations that PHCpack solves are written here by hand: lengths of bars, a platform by the cosine and sine of its
turn. It is the program `phc` (Debian: phcpack); where there is none the comparison is left out.

Source: J. Verschelde, Algorithm 795: PHCpack, ACM Trans. Math. Softw. 25 (1999) 251-276.
"""

import argparse
import dataclasses
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

import jaxnc as nc

PHC = shutil.which("phc")
NEAR = 1e-8  # of the mechanism's size: two solutions that are one

_NUMBER = re.compile(r"^\s*(\w+) = (\S+) ([+-]) (\S+)\*I,", re.MULTILINE)
Places = Mapping[str, Any]


@dataclasses.dataclass(frozen=True)
class Case:
    """A mechanism with its inputs, and its equations as polynomials of a few unknowns."""

    mechanism: nc.Mechanism
    inputs: dict[str, float]
    equations: tuple[str, ...]
    read: Callable[[dict[str, complex]], np.ndarray]  # places of points, of the unknowns
    points: str  # which


def _build(name: str, ground: Places, points: Places, bodies: Sequence[str]) -> nc.Mechanism:
    m = nc.Mechanism(name)
    for point, at in ground.items():
        m.ground(point, at)
    for point, at in points.items():
        m.point(point, at)
    for body in bodies:
        m.body(body, list(body))
    return m


def _square(x: str, y: str, length: float) -> str:
    return f"({x})^2 + ({y})^2 - {length**2:.17g}"


def _off(symbol: str, at: float) -> str:
    """Write a coordinate less a number."""
    return f"{symbol} - ({at:.17g})"


def _on_plate(x: str, y: str, local: np.ndarray, at: np.ndarray) -> tuple[str, str]:
    """Write the way from a place to a point of a plate that is at x, y and turned by c, s."""
    a, b = local
    return f"{x} + ({a:.17g})*c - ({b:.17g})*s - ({at[0]:.17g})", f"{y} + ({b:.17g})*c + ({a:.17g})*s - ({at[1]:.17g})"


def four_bar(rng: np.random.Generator) -> Case:
    """A four-bar: its joint C on two circles."""
    p = {
        k: np.array(v) + 0.3 * rng.normal(size=2) for k, v in {"B": (0.5, 1.1), "C": (2.9, 1.9), "D": (3, 0.2)}.items()
    }
    m = _build("four-bar", {"A": (0, 0), "D": p["D"]}, {n: p[n] for n in "BC"}, ["AB", "BC", "CD"])
    m.angle("phi", at="A", to="B")
    phi = rng.uniform(-3.0, 3.0)
    b = np.hypot(*p["B"]) * np.array([np.cos(phi), np.sin(phi)])
    rows = tuple(
        _square(_off("x", q[0]), _off("y", q[1]), np.hypot(*(p["C"] - p[n]))) for n, q in (("B", b), ("D", p["D"]))
    )
    return Case(m, {"phi": phi}, rows, lambda z: np.array([z["x"], z["y"]]), "C")


def platform(rng: np.random.Generator) -> Case:
    """A planar platform on three legs: its corner A and its turn."""
    base = {k: np.array(v) + rng.normal(size=2) for k, v in {"a": (0, 0), "b": (16, 0), "c": (0, 10)}.items()}
    p = {k: np.array(v) + rng.normal(size=2) for k, v in {"A": (3, 4), "B": (16, 5), "C": (6, 20)}.items()}
    m = _build("3-RPR", base, p, ["ABC"])
    rows = ["c^2 + s^2 - 1"]
    legs = {}
    for leg, corner in zip("abc", "ABC", strict=True):
        m.distance(f"L{leg}", leg, corner)
        legs[f"L{leg}"] = float(np.hypot(*(p[corner] - base[leg]))) + rng.normal()
        rows.append(_square(*_on_plate("x", "y", p[corner] - p["A"], base[leg]), legs[f"L{leg}"]))

    def read(z: dict[str, complex]) -> np.ndarray:
        a = np.array([z["x"], z["y"]])
        turn = np.array([[z["c"], -z["s"]], [z["s"], z["c"]]])
        return np.concatenate([a + turn @ (p[n] - p["A"]) for n in "ABC"])

    return Case(m, legs, tuple(rows), read, "ABC")


def stephenson(rng: np.random.Generator) -> Case:
    """Stephenson's third six-bar, driven at its outer dyad: the joint B and the turn of the plate BCE."""
    ground = {"A": np.zeros(2), "D": np.array([3, 0.2]), "G": np.array([4.8, 1.5])}
    p = {"B": (0.5, 1.1), "C": (2.9, 1.9), "E": (1.9, 2.9), "F": (4.1, 2.8)}
    p = {k: np.array(v) + 0.2 * rng.normal(size=2) for k, v in p.items()}
    m = _build("Stephenson III", ground, p, ["AB", "BCE", "DC", "EF", "GF"])
    m.angle("phi", at="G", to="F")
    phi = rng.uniform(-3.0, 3.0)
    f = ground["G"] + np.hypot(*(p["F"] - ground["G"])) * np.array([np.cos(phi), np.sin(phi)])
    ways = (("C", ground["D"], np.hypot(*(p["C"] - ground["D"]))), ("E", f, np.hypot(*(p["E"] - p["F"]))))
    rows = [
        "c^2 + s^2 - 1",
        _square("x", "y", np.hypot(*p["B"])),
        *(_square(*_on_plate("x", "y", p[n] - p["B"], at), long) for n, at, long in ways),
    ]

    def read(z: dict[str, complex]) -> np.ndarray:
        b = np.array([z["x"], z["y"]])
        turn = np.array([[z["c"], -z["s"]], [z["s"], z["c"]]])
        return np.concatenate([b, *(b + turn @ (p[n] - p["B"]) for n in "CE")])

    return Case(m, {"phi": phi}, tuple(rows), read, "BCE")


CASES = {"four-bar": four_bar, "3-RPR": platform, "Stephenson III": stephenson}


def solve_by_phc(case: Case) -> np.ndarray:
    """Places of the points in all solutions that PHCpack finds, ``(solutions, …)``."""
    assert PHC is not None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "system"
        file.write_text(f"{len(case.equations)}\n" + "".join(f"{row};\n" for row in case.equations))
        for words in (["-b", "-t1", "-0", "system", "out"], ["-z", "system", "list"]):
            subprocess.run([PHC, *words], cwd=folder, check=True, stdin=subprocess.DEVNULL, capture_output=True)
        text = (Path(folder) / "list").read_text()
    found = []
    for part in text.split("time =")[1:]:
        z = {n: complex(float(a), float(sign + b)) for n, a, sign, b in _NUMBER.findall(part)}
        found.append(case.read(z))
    return np.array(found)


def solve_by_modes(case: Case, system: nc.System) -> np.ndarray:
    """The same by `jaxnc.modes`: real ones, mirrored and complex."""
    found = nc.modes(system, case.inputs, unit="rad")
    at = [system.topology.coordinates.index(f"{p}.{axis}") for p in case.points for axis in "xy"]
    every = np.concatenate([np.asarray(found.poses.q), np.asarray(found.mirrored.q), found.complex])
    return every[:, at]


def count_same(one: np.ndarray, other: np.ndarray) -> int:
    """How many solutions of one set are in the other, each once."""
    if not len(one) or not len(other):
        return 0
    far = np.abs(one[:, None] - other).max(axis=2) / max(1.0, np.abs(other).max())
    return len({int(k) for k, row in zip(far.argmin(axis=1), far, strict=True) if row.min() < NEAR})


def main() -> int:
    """Compare both on random designs; 1 if any set is another one."""
    p = argparse.ArgumentParser(prog="python -m benchmarks.modes", description=__doc__)
    p.add_argument("--designs", type=int, default=20, metavar="N", help="of each mechanism (20)")
    options = p.parse_args()
    if PHC is None:
        print("benchmarks.modes: there is no program phc to compare with: apt-get install phcpack", file=sys.stderr)
        return 0
    jax.config.update("jax_enable_x64", True)
    os.environ["JAXNC_CACHE"] = "off"
    print(f"{'':16s}{'solutions':>10s}{'same sets':>12s}{'PHCpack':>12s}{'jaxnc':>12s}   (CPU ms each, median)")
    wrong = 0
    for name, make in CASES.items():
        same, sizes, times = 0, set(), []
        for seed in range(options.designs):
            case = make(np.random.default_rng(seed))
            system = case.mechanism.compile()
            begin = resource.getrusage(resource.RUSAGE_CHILDREN)
            theirs = solve_by_phc(case)
            end, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.process_time()
            ours = solve_by_modes(case, system)
            spent = end.ru_utime + end.ru_stime - begin.ru_utime - begin.ru_stime
            times.append((spent, time.process_time() - start))
            same += len(ours) == len(theirs) == count_same(ours, theirs)
            sizes.add(len(theirs))
        wrong += options.designs - same
        phc, own = 1e3 * np.median(times, axis=0)
        told = ", ".join(map(str, sorted(sizes)))
        print(f"{name:16s}{told:>10s}{f'{same} of {options.designs}':>12s}{phc:12.1f}{own:12.1f}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
