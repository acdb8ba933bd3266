"""README.md of the benchmarks, written from the JSON of a run: ``python -m benchmarks --report``."""

import math
import re
from collections.abc import Sequence
from pathlib import Path

from benchmarks import plots, table
from benchmarks.ratios import NAIVE, classes
from benchmarks.record import OURS, Record, Row
from benchmarks.synthesis import table as synthesis

_PLOT = "growth.png"

_HEAD = """# Benchmarks

<!-- Written by `python -m benchmarks --report`. Do not edit: change benchmarks/report.py and run it again. -->

| command | what it does |
|---|---|
| `pip install -e ".[bench]"` | the peers; those that are missing are left out |
| `python -m benchmarks` | runs everything, prints the table, writes `benchmarks/results.json`, compares ratios |
| `python -m benchmarks --quick` | small sizes: does everything run, is everything right |
| `python -m benchmarks --case four-bar generic` | some cases only; `--list` names them |
| `python -m benchmarks --write-baseline` | makes the ratios of this run the baseline |
| `python -m benchmarks --report` | writes this page from `benchmarks/results.json` and `benchmarks/synthesis.json` |
| `python -m benchmarks.synthesis` | design by gradient: published cases and others, see below; `--list` names them |
| `python -m benchmarks.optimisers` | optax against the least-squares search: [optimisers.md](../docs/optimisers.md) |
| `python -m benchmarks.dynamics` | formulations, engines, problems of dynamics: [dynamics.md](dynamics.md) |
| `python -m benchmarks.modes` | all assemblies against PHCpack, where its program `phc` is: the same sets |
| `python -m benchmarks.card` | every class on a graphics card: [card.md](card.md); `--core` on one core |
| `python -m benchmarks.trace` | linkages for curves of many kinds: [trace.md](trace.md); `--quick` for four of each |

The command ends with 1 if a ratio is worse than in `benchmarks/baseline.json` by more than the tolerance written
there, or if a case fails. Ratios are of times of one run on one machine; absolute times are shown and never compared
with stored ones. There is a baseline for each kind of processor it was run on, since ratios to peers differ from one
to the next; on another kind the most lenient of them is taken, and the command says so. The fraction of right lanes
is compared too, and may not fall at all.

## How it is measured

- The process is bound to one core, so XLA has one thread. Only the case `devices` uses more.
- Times are processor time of the process. On one core that is what a clock on the wall shows where nothing else runs;
  neighbours on the same machine are not counted, though they still take their share of cache and memory. The case
  `devices` goes by the clock on the wall.
- Compilation is the first call less a later one, without a compilation cache. It is never part of a time per lane.
- The ways of one case are run in turn (A B C A B C …), each time with inputs that none of them has seen. The table
  has the median, and as spread the range between the 10th and the 90th percentile, relative to the median.
- A call ends when its results are there. Status, residual and branch check of every lane are inside every time of
  this library.
- Every lane of every timed call is compared with a closed form (the meeting of two circles), or, where there is none,
  with independent equations solved in NumPy: right means within 1e-9 of the mechanism's size and on the requested
  branch. Among random designs a lane behind a dead point is right if it is reported as failed.
- A way that would take too long runs on fewer lanes; the note says so. Times are per lane.
- The opponents have the same unknowns, tolerance (residual 1e-12 of the mechanism's size) and, where they are JAX,
  jit. Closed forms iterate nothing; pylinkage solves dyads in closed form and accumulates steps of its crank.
"""


_WHY = """## What was not reached, and why

What takes the time was measured with the profile of single calls (`jax.profiler`, one event for every generated
kernel).

- *Sweeps of many designs* (`designs`): a pose of a sequence costs about twice that of a batch of one design: its
  checks go from pose to pose, coordinates are turned to designs first, and the poses of the way to the first value are
  solved too. pylinkage keeps joint positions only and checks nothing.
- *One pose from Python* (`single`): a compiled function that does nothing takes a ninth of one from the pose before
  (see the rows). Of a pose from the drawing most is the way there, in steps.
- *Two devices* (`devices`): one device alone already uses 1.2 to 1.4 cores, since XLA starts small kernels that do not
  depend on each other; on two cores that leaves 1.6 to 1.8. The row beside it is the same by hand.
- *Rows of four-bars* (`rows`): of 10,000 coordinates a step takes as long as one of SciPy's sparse matrices, assembly
  included; of 100 it takes four times as long, most of it NumPy's calls.
- *Compilation*: each generated kernel costs 10 to 20 ms, however small; `jit(vmap(solve_position))` of a four-bar has
  65, value and gradient of a MacPherson strut's toe 376.
"""


_CLASSES = """## Every class of mechanism

The whole library, and robots that are read from files, each over a part of its range: beside eight Newton steps from
the drawing on the library's own residual, with `jacfwd` and `solve` under `vmap`. Those that gain least come first.
`gradient` is value and gradient by the design over the value alone; an overconstrained mechanism has none, since it
does not close where its points are moved, and of more than 60 unknowns it is left out: its program is compiled for
minutes. The last column says what of the naive steps' poses is right.
"""


def write(record: Record, folder: Path) -> None:
    """Write README.md and its plot into a folder."""
    parts = [_HEAD, _machine(record), _ratios(record), _WHY, _classes(record), _rows(record)]
    if plots.growth(record, folder / _PLOT):
        parts.append(_growth(record))
    parts += [synthesis.section(folder / "synthesis.json"), _missing(record)]
    (folder / "README.md").write_text("\n".join(p.strip("\n") + "\n" for p in parts if p))


def _machine(record: Record) -> str:
    m = record.machine
    versions = ", ".join(f"{name} {version}" for name, version in m["versions"].items())
    quick = " A quick run: sizes are small." if record.quick else ""
    busy = ""
    if m.get("load") and m["load"][1] > 1.5:
        low, high = m["load"]
        busy = (
            f"\nDisturbed: {low:g} to {high:g} processes at a time wanted a core while it ran. Shared caches and\n"
            f"memory slow down what streams through them most, so that absolute times are upper bounds.\n"
        )
    return (
        f"## Machine\n\n{m['cpu']}, {m['cores']} cores; 64-bit numbers; on a GPU: [card.md](card.md).{quick}\n"
        f"Python {m['python']}, {versions}.\n{busy}"
    )


def _markdown(head: Sequence[str], lines: Sequence[Sequence[str]], left: Sequence[int]) -> str:
    rule = [":--" if k in left else "--:" for k in range(len(head))]
    return "\n".join("| " + " | ".join(line) + " |" for line in (head, rule, *lines)) + "\n"


def _ratios(record: Record) -> str:
    shown = [r for r in record.ratios if not r.name.startswith("class ")]  # these have a table of their own
    with_target = [table.ratio_cells(r) for r in shown if r.target is not None]
    others = [table.ratio_cells(r)[:2] for r in shown if r.target is None]
    out = "## What it set out to reach\n\n" + _markdown(("", "value", "target", "met"), with_target, (0,))
    if others:
        out += "\nOther ratios:\n\n" + _markdown(("", "value"), others, (0,))
    return out


def _classes(record: Record) -> str:
    """Every class of mechanism beside naive steps, those that gain least first."""
    lines = []
    for case in classes(record):
        ways = {r.way: r for r in record.rows if r.case == case}
        ours, naive = [ways.get(name) for name in (OURS, f"{OURS}: jit")], ways.get(NAIVE)
        value, both = (ways.get(f"{OURS}: {name}") for name in ("value", "value and gradient"))
        rights = [r.correct for name, r in ways.items() if name.startswith(OURS) and r.correct is not None]
        gains = [_times(naive, r) for r in ours]
        cells = (
            *(case.removeprefix("class "), ours[0].note if ours[0] else ""),
            *("–" if r is None else table.per_lane(r.median_ns_per_lane) for r in (*ours, naive)),
            *("–" if x is None else f"{x:.3g}" for x in gains),
            "none" if both and both.correct is None else "–" if not both else f"{_times(both, value):.3g}",
            *(table.right(min(rights, default=None)), table.right(naive.correct if naive else None)),
        )
        lines.append((min((x for x in gains if x is not None), default=0.0), cells))
    if not lines:
        return ""
    head = "class, lanes", "what", "eager", "in jit", "naive", "naive / eager", "naive / jit", "gradient", "right"
    table_ = _markdown((*head, "naive right"), [cells for _, cells in sorted(lines, key=lambda x: x[0])], (0, 1))
    return f"{_CLASSES}\n{table_}"


def _times(above: Row | None, below: Row | None) -> float | None:
    return None if above is None or below is None else above.median_ns_per_lane / below.median_ns_per_lane


def _rows(record: Record) -> str:
    lines = [(*table.cells(r, record), r.note) for r in record.rows if not r.case.startswith(("growth", "class "))]
    head = (*table.HEAD, "note")
    return "## All times\n\nOne lane is one pose.\n\n" + _markdown(head, lines, (0, 2, 8))


def _slope(points: Sequence[tuple[float, float]]) -> str:
    """Exponent between the last two sizes."""
    (x0, y0), (x1, y1) = sorted(points)[-2:]
    return f"{math.log(y1 / y0) / math.log(x1 / x0):.2f}"


def _growth(record: Record) -> str:
    out = ["## How cost grows\n", f"![Time against batch size, unknowns and designs]({_PLOT})\n"]
    for title, case, unit in (("angles", "growth: batch", 1), ("designs", "growth: designs", 360)):
        rows = [r for r in record.rows if r.case == case]
        if rows:
            out.append(_one_growth(title, rows, [r.size // unit for r in rows]))
    found = [(r, re.fullmatch(r"growth: unknowns, (\d+)", r.case)) for r in record.rows]
    rows = [(r, int(m[1])) for r, m in found if m]
    if rows:
        out.append(_one_growth("unknowns", [r for r, _ in rows], [n for _, n in rows]))
    return "\n".join(out)


def _one_growth(title: str, rows: Sequence[Row], sizes: Sequence[int]) -> str:
    ways = list(dict.fromkeys(r.way for r in rows))
    steps = sorted(set(sizes))
    at = {(r.way, n): r for r, n in zip(rows, sizes, strict=True)}
    lines = [
        (f"{n:,}", *(table.per_lane(at[w, n].median_ns_per_lane) if (w, n) in at else "–" for w in ways)) for n in steps
    ]
    text = f"Time per pose against {title}:\n\n" + _markdown((title, *ways), lines, ())
    per_call = title != "unknowns"
    ours = [(float(n), at[OURS, n].median_ns_per_lane * (n if per_call else 1)) for n in steps if (OURS, n) in at]
    if len(ours) > 1:
        what, last = ("a whole call" if per_call else "a pose"), [f"{int(n):,}" for n, _ in ours[-2:]]
        text += (
            f"\nFrom {last[0]} to {last[1]} {title} the time of {what} of this library grows with the power "
            f"{_slope(ours)}; 1 is linear.\n"
        )
    return text


def _missing(record: Record) -> str:
    items = [*record.left_out, *(f"failed: {x}" for x in record.failed)]
    return "## Not measured\n\n" + "\n".join(f"- {x}" for x in items) if items else ""
