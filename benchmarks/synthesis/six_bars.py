"""Six-bars through eight pairs of angles of random six-bars: are all found, and the one that made them?

    python -m benchmarks.synthesis.six_bars [--designs 3] [--newton 200000] ["Watt II" "Stephenson II" "Stephenson III"]

The first run makes the start sets, in some minutes each, and keeps them in the user's cache. Then Newton's method goes
from random complex starts to solutions of the stored task: those that it finds know nothing of the loops, so the share
of them that is in the set is a test of the set.
"""

import argparse
import time

import jax
import numpy as np

import jaxnc as nc
from jaxnc import synthesis as syn
from jaxnc.continuation.monodromy import is_new
from jaxnc.synthesis.exact.six_bars import (
    PAIRS,
    PLACES,
    AngleStarts,
    SixBarPaths,
    describe_six_bar,
    find_angle_starts,
)

RANGE = 1.2  # radians, of the input
FINITE = 1e4  # beside unknowns of size one: Newton's method goes astray to infinity too


def draw(kind: str, rng: np.random.Generator) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """A six-bar that passes the range: its joints, and eight pairs of angles."""
    while True:
        at = {name: np.array(p) + 0.25 * rng.normal(size=2) for name, p in PLACES[kind].items()}
        m = describe_six_bar(kind, at)
        start = np.arctan2(*(at["D"] - at["A"])[::-1])
        motion = nc.sweep(m.compile(), {"phi": start + np.linspace(0.0, RANGE, 57)})
        if np.asarray(motion.converged).all():
            return at, np.linspace(0.0, RANGE, 8), np.asarray(motion["psi"])[::8]


def try_newton(kind: str, starts: AngleStarts, count: int, rng: np.random.Generator) -> tuple[int, int]:
    """How many solutions of the stored task Newton's method finds, and how many of them are in the set."""
    paths, found = SixBarPaths(kind, starts.task, starts.task), starts.z[:, :0]
    for _ in range(-(-count // 500)):
        z = rng.normal(size=(8, 500)) + 1j * rng.normal(size=(8, 500))
        w, last = paths.polish(z, 40)
        new = w[:8, (last < 1e-12) & (np.abs(w).max(axis=0) < FINITE) & (np.abs(w[:8]).min(axis=0) > 1 / FINITE)]
        found = np.concatenate([found, new[:, is_new(found, new)]], axis=1)
    return found.shape[1], int(np.sum(~is_new(starts.z, found)))


def main() -> None:
    """Print a line for each design."""
    p = argparse.ArgumentParser(prog="python -m benchmarks.synthesis.six_bars", description=__doc__)
    p.add_argument("kinds", nargs="*", default=list(PAIRS))
    p.add_argument("--designs", type=int, default=3)
    p.add_argument("--newton", type=int, default=200000, help="random starts")
    options = p.parse_args()
    jax.config.update("jax_enable_x64", True)
    for kind in options.kinds:
        spent = time.process_time()
        starts = find_angle_starts(kind)
        print(f"{kind}: {starts.z.shape[1]} solutions, {time.process_time() - spent:.0f} CPU s", flush=True)
        found, known = try_newton(kind, starts, options.newton, np.random.default_rng(7))
        print(f"  Newton from {options.newton} random starts: {found} solutions, {known} of them known", flush=True)
        for seed in range(options.designs):
            at, x, y = draw(kind, np.random.default_rng(seed))
            given = {"B": at["B"]} if "B" in at else {"D": at["D"]}
            length = np.hypot(*(at["D"] - at["A"] if "B" in at else at["H"] - at["C"]))
            spent = time.process_time()
            designs = syn.precision_six_bars(kind, x, y, A=at["A"], C=at["C"], length=length, **given)
            spent = time.process_time() - spent
            gap = min(max(np.abs(np.subtract(d.points[name], p)).max() for name, p in at.items()) for d in designs)
            works = sum(not d.defects for d in designs)
            print(f"  {seed}: {designs.found} of {designs.expected}, missing {designs.missing}, {len(designs)} real, "
                  f"{sum(d.proved for d in designs)} proved, {works} without defects, routes {designs.routes}, "
                  f"its own within {gap:.0e}, {spent:.0f} CPU s", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
