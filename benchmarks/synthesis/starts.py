"""Stored tasks of `jaxnc.synthesis.path_four_bars` with all solutions, found from one random linkage by monodromy.

    python -m benchmarks.synthesis.starts [9-00 8-10 7-20 7-11 6-21 5-22]

A name is the number of points and how many coordinates of A and of D are given. A task is carried round closed ways
through random other ones; solutions come back as others. It is full when three rounds bring nothing new, and where a
pivot is held to a line a trace test says so too: while the line is shifted, the sum of the pivot's places over all
solutions moves straight on, and over a part of them it does not. What is stored is gone on with.

Source: A. J. Sommese, J. Verschelde and C. W. Wampler, Symmetric functions applied to decomposing solution sets of
polynomial systems, SIAM J. Numer. Anal. 40 (2002) 2026-2046, for trace tests.
"""

import dataclasses
import sys
import time
from pathlib import Path

import numpy as np

from jaxnc.synthesis.exact import precision_points
from jaxnc.synthesis.exact.bar_paths import mark_distinct
from jaxnc.synthesis.exact.precision_points import Task, follow_paths, polish, solution_keys

FILE = Path(precision_points.__file__).with_name("path_starts.npz")
DRY = 3


def linkage(count: int, rng) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A random complex linkage, and points that it passes: for each turn of the coupler two circles meet."""
    x, y, xx, yy, a, b, aa, bb = z = normal(rng, 8)
    points = []
    for turn in np.exp(2j * np.pi * rng.uniform(size=count - 1)):
        # Of each dyad: δ δ' + p δ + q δ' + r = 0.
        p = np.array([-aa - xx / turn, -bb - yy / turn])
        q = np.array([-a - turn * x, -b - turn * y])
        r = np.array([turn * x * aa + xx * a / turn - a * xx - x * aa, turn * y * bb + yy * b / turn - b * yy - y * bb])
        dp, dq, dr = p[0] - p[1], q[0] - q[1], r[0] - r[1]
        d = np.roots([-dp / dq, -dr / dq + p[0] - q[0] * dp / dq, r[0] - q[0] * dr / dq])[0]
        points.append((d, -(dp * d + dr) / dq))
    d, e = np.array(points).T
    return z, d, e


def normal(rng, *shape: int) -> np.ndarray:
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2.0)


def conditions(a: int, d: int, rng) -> np.ndarray:
    """Random conditions on the pivots: so many on (a, a') and on (b, b')."""
    matrix = np.zeros((a + d, 4), complex)
    matrix[:a, 0::2], matrix[a:, 1::2] = normal(rng, a, 2), normal(rng, d, 2)
    return matrix


def monodromy(name: str, seed: int, known: tuple[np.ndarray, Task] | None) -> tuple[np.ndarray, Task]:
    rng = np.random.default_rng(seed)
    count, a, d = (int(name[i]) for i in (0, 2, 3))
    if known is None:
        z, points, primed = linkage(count, rng)
        matrix = conditions(a, d, rng)
        known = z[:, None], Task(points, primed, matrix, matrix @ z[4:])
    found, home = polish(known[0], known[1])[0], known[1]
    dry = 0
    while dry < DRY:
        ways = [
            Task(normal(rng, count - 1), normal(rng, count - 1), conditions(a, d, rng), normal(rng, a + d))
            for _ in range(2)
        ]
        ends = found
        for start, end in zip([home, *ways], [*ways, home], strict=True):
            out = follow_paths(ends, start, end)
            ends = out.w[:, out.arrived]
        ends, last = polish(ends, home)
        before = found.shape[1]
        found = np.concatenate([found, ends[:, last < 1e-9]], axis=1)
        found = found[:, mark_distinct(found, lambda w: solution_keys(w, home))]
        print(f"{name}: {found.shape[1]} after {time.process_time():.0f} s", flush=True)
        dry = dry + 1 if before > 8 and found.shape[1] == before else 0
    return found, home


def traced(z: np.ndarray, task: Task, shift: complex = 0.01 - 0.02j) -> float:
    """Second difference over first of the sum of the pivot's places, as the line shifts that is the last condition."""
    pivot = 5 if task.matrix[-1, 1] else 4
    sums = [z[pivot].sum()]
    for sign in (-1.0, 1.0):
        right = task.right.copy()
        right[-1] += sign * shift
        moved = dataclasses.replace(task, right=right)
        out = follow_paths(z, task, moved)
        if not out.arrived.all():
            return np.inf
        sums.append(polish(out.w, moved)[0][pivot].sum())
    return float(abs(sums[1] + sums[2] - 2.0 * sums[0]) / abs(sums[2] - sums[1]))


def main() -> None:
    stored = dict(np.load(FILE)) if FILE.exists() else {}
    for name in sys.argv[1:] or ["5-22", "6-21", "7-20", "7-11", "8-10", "9-00"]:
        known = precision_points.stored_starts(name) if f"z {name}" in stored else None
        z, task = monodromy(name, 3 if known is None else known[0].shape[1], known)
        if name in ("6-21", "7-11", "8-10"):
            print(f"{name}: trace test {traced(z, task):.1e}")
        parts = {"d": task.d, "e": task.e, "matrix": task.matrix, "right": task.right}
        stored |= {f"z {name}": z[:8].astype(np.complex64)} | {f"{key} {name}": part for key, part in parts.items()}
        np.savez(FILE, **stored)  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
