"""``python -m benchmarks``: run the cases, print the table, write JSON, compare ratios with the baseline."""

import argparse
import dataclasses
import os
import sys
import time
import traceback
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from benchmarks.record import Record

_FOLDER = Path(__file__).parent


def _arguments() -> argparse.Namespace:
    p = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    p.add_argument("--quick", action="store_true", help="small sizes: see that everything runs and is right")
    p.add_argument("--case", nargs="+", metavar="NAME", help="only these cases; others are kept from the JSON file")
    p.add_argument("--only", nargs="+", metavar="NAME", help="of the classes, these: five-bar, 'robot ankle'")
    p.add_argument(
        "--json",
        type=Path,
        metavar="FILE",
        help="where results go (default: results.json beside this file; out/ for quick runs)",
    )
    p.add_argument("--baseline", type=Path, metavar="FILE", help="the baseline (default: baseline.json)")
    p.add_argument("--write-baseline", action="store_true", help="make this run's ratios the baseline")
    p.add_argument("--list", action="store_true", help="name the cases and stop")
    p.add_argument("--no-peers", action="store_true", help="this library only")
    p.add_argument("--report", action="store_true", help="run nothing: write README.md and plots from the JSON file")
    return p.parse_args()


def _save(record: "Record", old: "Record | None", path: Path) -> "Record":
    """Write what there is so far, with the cases of an earlier run that are not in this one."""
    from benchmarks.ratios import ratios

    whole = dataclasses.replace(record)
    if old is not None and old.quick == record.quick:
        whole.keep(old)
    whole.ratios = ratios(whole)
    whole.write(path)
    return whole


def main() -> int:
    """Run the suite; 1 if a ratio has become worse than the baseline allows, or a case failed."""
    options = _arguments()
    from benchmarks import baseline, machine

    machine.pin()  # before JAX starts its threads
    os.environ["JAX_ENABLE_COMPILATION_CACHE"] = "0"
    import jax

    jax.config.update("jax_enable_x64", True)
    from benchmarks import table
    from benchmarks.cases import CASES
    from benchmarks.cases.classes import every_class
    from benchmarks.record import Record
    from benchmarks.suite import Suite

    if options.list:
        print(table.aligned([("case", "what"), *((name, what) for name, (_, what) in CASES.items())], left=(0, 1)))
        return 0
    path = options.json or (Path("out/benchmarks-quick.json") if options.quick else _FOLDER / "results.json")
    if options.report:
        from benchmarks import report

        report.write(Record.read(path), _FOLDER)
        return 0
    names = options.case or list(CASES)
    for name in names:
        if name not in CASES:
            print(f"no case {name!r}; there are: {', '.join(CASES)}", file=sys.stderr)
            return 2
    classes = [one.name for one in every_class()] if options.only else []
    for name in options.only or ():
        if name not in classes:
            print(f"no class {name!r}; there are: {', '.join(classes)}", file=sys.stderr)
            return 2
    record = Record(machine.describe(), options.quick)
    suite = Suite(record, options.quick, not options.no_peers, tuple(options.only or ()))
    old = Record.read(path) if options.case and path.exists() else None
    if old is not None and old.machine["cpu"] != record.machine["cpu"]:
        if options.json is None:
            path = Path("out") / path.name  # rows of two processors make no table, and ratios of them no sense
        print(f"the results kept are of {old.machine['cpu']}: these cases go by themselves to {path}", file=sys.stderr)
        old = None
    for name in names:
        start = time.perf_counter()
        print(f"{name} …", end=" ", file=sys.stderr, flush=True)
        try:
            CASES[name][0](suite)
            print(f"{time.perf_counter() - start:.0f} s", file=sys.stderr)
        except Exception as error:  # one broken case must not hide the others
            traceback.print_exc()
            record.failed.append(f"{name}: {type(error).__name__}: {str(error)[:300]}")
        jax.clear_caches()
        record.machine["load"] = machine.load(record.machine.get("load", []))
        _save(record, old, path)
    record = _save(record, old, path)
    print(table.text(record))
    base = options.baseline or baseline.DEFAULT
    if options.write_baseline:
        baseline.write(record, base)
        print(f"\nbaseline written: {base.name}")
        return 1 if record.failed else 0
    worse, compared, which = baseline.regressions(record, base)
    print(f"\n{compared} ratios compared with {which}, {len(worse)} worse than it allows")
    for line in worse:
        print(f"  {line}")
    return 1 if worse or record.failed else 0


if __name__ == "__main__":
    sys.exit(main())
