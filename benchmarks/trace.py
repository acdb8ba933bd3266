"""``python -m benchmarks.trace``: curves of many kinds, traced; writes trace.json and trace.md beside this file.

Targets: letters and digits as outlines of a free font (DejaVu Sans, which comes with matplotlib) and as single strokes
of our own, open ones open; curves of random linkages that the atlas has not seen; feet of walking legs. Distances are
in units of the target's root mean square distance from its centre: CD, the mean distance from points to the other
polyline, both ways added, 2,000 points by arc length; points, the same from point to point, which no curve brings to
zero; OD, the root mean square distance at the best cyclic shift; clear, how far all links stay from a floor a quarter
of the size below the target, negative where they run into it.

Beside it the CD of less: what the atlas has, before anything is refined; four-bars only; and, for as many seconds, a
search that begins at designs of the atlas taken at random, where the other begins at those that are alike. Of closed
curves also, for as many seconds of a processor, pylinkage's search over topologies and lengths, where pymoo is there.
``--quick`` takes four targets of a kind, chosen by a seed, and 20 s for each: half an hour for the whole table.
``--curves FILE`` traces the closed curves of an array ``(curves, points, 2)`` instead, as LInK keeps its test sets.
What has conditions or curves of its own is printed, and written to no file.
"""

import argparse
import json
import statistics
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers import co_optimisation

HERE = Path(__file__).parent
OUTLINES = "CILMNSTUVWZ12357"  # glyphs of one contour
STROKES = {  # corners of single strokes
    "C": [(1, 0.8), (0.5, 1), (0.1, 0.75), (0, 0.5), (0.1, 0.25), (0.5, 0), (1, 0.2)],
    "L": [(0, 1), (0, 0), (0.6, 0)],
    "M": [(0, 0), (0, 1), (0.5, 0.3), (1, 1), (1, 0)],
    "N": [(0, 0), (0, 1), (0.7, 0), (0.7, 1)],
    "S": [(1, 0.85), (0.5, 1), (0.05, 0.75), (0.5, 0.5), (0.95, 0.25), (0.5, 0), (0, 0.15)],
    "U": [(0, 1), (0, 0.35), (0.1, 0.1), (0.35, 0), (0.6, 0.1), (0.7, 0.35), (0.7, 1)],
    "V": [(0, 1), (0.4, 0), (0.8, 1)],
    "Z": [(0, 1), (0.8, 1), (0, 0), (0.8, 0)],
    "2": [(0, 0.75), (0.3, 1), (0.65, 0.75), (0.5, 0.45), (0, 0), (0.7, 0)],
    "3": [(0, 0.9), (0.35, 1), (0.65, 0.78), (0.3, 0.55), (0.7, 0.27), (0.35, 0), (0, 0.1)],
    "7": [(0, 1), (0.65, 1), (0.2, 0)],
}


Row = tuple[str, str, np.ndarray, bool, dict[str, Any]]


def targets(per_kind: int, seed: int = 20_000) -> Iterator[Row]:
    """Yield kind, name, points, whether the curve is closed, and what is asked beside it; of each kind some."""
    rng = np.random.default_rng(seed)
    kinds = dict.fromkeys(("outline", "stroke", "4-bar", "6-bar", "8-bar", "foot", "published"))
    for kind in kinds:
        every = list(of_kind(kind, per_kind, seed))
        for k in np.sort(rng.permutation(len(every))[:per_kind]):
            yield every[k]


def from_file(path: str, most: int) -> Iterator[Row]:
    """Yield the curves of a file, the first ones."""
    for k, points in enumerate(np.load(path)[:most]):
        yield Path(path).stem, str(k), np.asarray(points, float), True, {}


def of_kind(kind: str, count: int, seed: int) -> Iterator[Row]:
    """Yield the targets of a kind; of linkages, which never end, so many."""
    from matplotlib.textpath import TextPath

    import jaxnc as nc
    from benchmarks.synthesis import published
    from jaxnc.synthesis.tracing.atlas import ChainDesign, make

    if kind == "outline":
        for letter in OUTLINES:
            (corners,) = TextPath((0, 0), letter, size=1.0).to_polygons()
            yield kind, letter, np.asarray(corners)[:-1], True, {}
    elif kind == "stroke":
        for letter, corners in STROKES.items():
            yield kind, letter, np.asarray(corners, float), False, {}
    elif kind == "foot":
        for name, make_leg in (("Jansen", nc.library.jansen_leg), ("Klann", nc.library.klann_leg)):
            leg = make_leg()
            drive = next(iter(leg.model.run.inputs))
            foot = leg.model.run.outputs[0]
            motion = nc.sweep(leg.compile(), {drive: np.linspace(0.0, 2 * np.pi, 120, endpoint=False)})
            yield kind, name, np.asarray(motion[foot]), True, {}
    elif kind == "published":  # points of path generation, as corners of a curve
        yield kind, "Yu 20", np.array(published.YU), True, {}
        yield kind, "MKH 25", np.array(published.MKH_25), True, {}
        yield kind, "ellipse 9", np.array(published.ELLIPSE[:-1]), True, {}
        yield kind, "arch 6", np.array(published.ARCH), False, {}
        yield kind, "line 6", np.array(published.SIX), False, {}
    else:
        bars = int(kind[0])
        shelf = make(bars, np.random.default_rng((seed, bars)))
        plain = [k for k, c in enumerate(shelf.chain) if not shelf.chains[c].sliders and shelf.sine[k] > 0.03]
        for k in plain[:count]:
            chain = shelf.chains[shelf.chain[k]]
            design = ChainDesign(
                chain, shelf.sign[k].astype(float), shelf.design[k].astype(float), 0j, 1 + 0j, 0.1, 6.0
            )
            z = design.trace(np.linspace(0.1, 2 * np.pi + 0.1, 60, endpoint=False))
            fewer = tuple(b for b in (4, 6, 8) if b <= bars)
            yield kind, f"{chain.name} {k}", np.stack([z.real, z.imag], axis=1), True, {"bars": fewer}


def forget_likeness(atlas: Any) -> Any:
    """Make of an atlas one that answers with designs taken at random."""
    from jaxnc.synthesis.tracing.atlas import Atlas, Candidates

    class Random(Atlas):
        def find(self, target: Any, closed: bool, bars: int, count: int, allowed: Any = None) -> Candidates:
            rng, shelf = np.random.default_rng(bars), self.shelves[bars]
            may = np.array([allowed is None or allowed(chain) for chain in shelf.chains])
            chosen = rng.permutation(np.flatnonzero(may[shelf.chain]))[:count]
            turn = rng.uniform(0.0, 2.0 * np.pi, len(chosen))
            return Candidates(shelf.at(chosen), np.ones(len(chosen)), turn, rng.uniform(size=len(chosen)) < 0.5)

    return Random(atlas.shelves)


def distances(found: np.ndarray, goal: np.ndarray, closed: bool, size: float) -> tuple[float, float, float]:
    """CD, the distance from point to point, and OD, divided by the target's size."""
    from jaxnc.synthesis.tracing.trace import curve_distance, space_evenly

    a, b = (space_evenly(line, 401)[: -1 if closed else None] for line in (found, goal))
    apart = np.linalg.norm(a[:, None] - b, axis=-1)
    points = apart.min(axis=0).mean() + apart.min(axis=1).mean()
    ways = [np.roll(w, k, axis=0) for w in (a, a[::-1]) for k in (range(len(a)) if closed else (0,))]
    od = min(float(np.sqrt(np.mean(np.sum((w - b) ** 2, axis=1)))) for w in ways)
    return curve_distance(found, goal) / size, float(points) / size, od / size


def floor_below(points: np.ndarray, size: float) -> np.ndarray:
    """A box below a curve: what it stands on."""
    (left, low), (right, _) = points.min(axis=0), points.max(axis=0)
    middle = 0.5 * (left + right)
    return np.array([[middle - 20 * size, low - 10.25 * size], [middle + 20 * size, low - 0.25 * size]])


def main() -> None:
    """Trace the targets and write what came out."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.trace", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="for each target (60)")
    parser.add_argument("--most", type=int, default=100, metavar="N", help="targets of a kind")
    parser.add_argument("--curves", metavar="FILE", help="closed curves to trace, .npy, (curves, points, 2)")
    parser.add_argument("--kinds", nargs="+", metavar="KIND", help="outline, stroke, 4-bar, 6-bar, 8-bar, foot")
    parser.add_argument("--least-transmission", type=float, metavar="DEG", help="smallest transmission angle asked for")
    parser.add_argument("--floor", action="store_true", help="ask that all links keep clear of the floor")
    parser.add_argument("--quick", action="store_true", help="20 s for each target, 4 targets of a kind")
    parser.add_argument("--alone", action="store_true", help="without the CD of less")
    options = parser.parse_args()
    seconds, most = (20.0, 4) if options.quick else (options.seconds, options.most)
    import jax

    jax.config.update("jax_enable_x64", True)
    import jaxnc as nc
    from jaxnc.synthesis.tracing.trace import Curve

    nc.cache()
    atlas = nc.synthesis.atlas()
    less = {} if options.alone else {
        "lookup": {"source": atlas, "seconds": 1e-3},
        "four-bars": {"source": atlas, "bars": (4,), "seconds": min(seconds, 10.0)},
        "random starts": {"source": forget_likeness(atlas), "seconds": seconds},
    }  # fmt: skip
    # What is compiled at first use is none of the first target's time.
    for seconds_for, bars in ((1.0, (4,)), (1.0, (6,)), (1.0, (8,)), (8.0, (4, 6, 8))):
        nc.synthesis.trace(np.array(STROKES["S"]), False, None, bars, (), seconds_for, source=atlas, progress=False)
    asked = []
    if options.least_transmission:
        asked = [nc.synthesis.transmission_angle(float(np.radians(options.least_transmission)))]
    rows = []
    evolution = co_optimisation.is_there() and not options.alone
    every = from_file(options.curves, most) if options.curves else targets(most)
    for kind, name, points, closed, more in every:
        if options.kinds and kind not in options.kinds:
            continue
        curve = Curve.of(points, closed)
        floor, begun = floor_below(curve.given, curve.size), time.perf_counter()
        wanted = [*asked, nc.synthesis.clear_of(floor)] if options.floor else asked
        more = {"subject_to": wanted, "progress": False, "source": atlas, "seconds": seconds, **more}
        found = nc.synthesis.trace(points, closed, **more)
        took = time.perf_counter() - begun
        if not found.found:
            print(f"{kind:8} {name:24} nothing meets the conditions", flush=True)
            continue
        best = found.best
        others = {
            what: result.best.distance if result.found else None
            for what, own in less.items()
            for result in [nc.synthesis.trace(points, closed, **{**more, **own})]
        }
        if evolution and closed:
            others["pylinkage"] = co_optimisation.trace_by_evolution(curve.given, seconds)
        cd, pointwise, od = distances(best.line, curve.line, closed, curve.size)
        row = {
            "kind": kind, "name": name, "cd": cd, "points": pointwise, "od": od, "bars": best.bars, "exact": best.exact,
            "linkage": best.name, "transmission": float(np.degrees(best.transmission)), "turns": best.turns,
            "clear": best.clearance(floor) / curve.size,
            "seconds": took, "less": others,
        }  # fmt: skip
        rows.append(row)
        print(
            f"{kind:8} {name:24} CD {cd:.4f} OD {od:.4f} {best.bars} bars {row['seconds']:.0f} s {best.name}",
            flush=True,
        )
    text = table(rows, seconds)
    print(text)
    if asked or options.floor or options.curves or options.kinds:
        return
    (HERE / "trace.json").write_text(json.dumps(rows, indent=1) + "\n")
    (HERE / "trace.md").write_text(text)


def table(rows: list[dict[str, Any]], seconds: float) -> str:
    """The page: by kind, then every target."""
    lines = [
        "# Curves, traced",
        "",
        f"Written by `python -m benchmarks.trace`, {seconds:g} s for each target; what the columns mean is said in "
        "[trace.py](trace.py).",
        "",
        "| kind | targets | mean CD | median CD | largest CD | exact | clear | median s | mean CD of lookup "
        "| of four-bars | of random starts | of pylinkage |",
        "|:--|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for kind in dict.fromkeys(row["kind"] for row in rows):
        own = [row for row in rows if row["kind"] == kind]
        cds, times = [row["cd"] for row in own], [row["seconds"] for row in own]
        lines.append(
            f"| {kind} | {len(own)} | {statistics.mean(cds):.4f} | {statistics.median(cds):.4f} | {max(cds):.4f} | "
            f"{sum(row['exact'] for row in own)} | {sum(row['clear'] >= 0.0 for row in own)} | "
            f"{statistics.median(times):.0f} | "
            + " | ".join(
                f"{statistics.mean(known):.4f}" if (known := [c for r in own if (c := r["less"].get(what))]) else ""
                for what in ("lookup", "four-bars", "random starts", "pylinkage")
            )
            + " |"
        )
    lines += [
        "",
        "| target | CD | from point to point | OD | bars | transmission | clear | linkage |",
        "|:--|--:|--:|--:|--:|--:|--:|:--|",
    ]
    lines += [
        f"| {row['kind']} {row['name']} | {row['cd']:.4f}{' =' if row['exact'] else ''} | {row['points']:.4f} | "
        f"{row['od']:.4f} | {row['bars']} | {row['transmission']:.0f}° | "
        f"{row['clear']:.2f} | {row['linkage']} |"
        for row in rows
    ]
    return "\n".join([*lines, "", "= meets all points that were given.", ""])


if __name__ == "__main__":
    main()
