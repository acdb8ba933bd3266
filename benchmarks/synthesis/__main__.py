"""``python -m benchmarks.synthesis``: run the cases of design by gradient, print the table, write JSON."""

import argparse
import dataclasses
import json
import os
import time
from pathlib import Path

_FILE = Path(__file__).parent.parent / "synthesis.json"


def main() -> int:
    """Run; 1 if an error is larger than its target, or a gradient was not finite."""
    p = argparse.ArgumentParser(prog="python -m benchmarks.synthesis", description=__doc__)
    p.add_argument("--case", nargs="+", metavar="NAME", help="only these cases; others are kept from the JSON file")
    p.add_argument("--keys", type=int, default=3, help="searches of each published case (default: 3)")
    p.add_argument("--json", type=Path, default=_FILE, metavar="FILE", help="where results go")
    p.add_argument("--list", action="store_true", help="name the cases and stop")
    p.add_argument("--table", action="store_true", help="run nothing: print the table of the JSON file")
    options = p.parse_args()
    os.environ["JAX_ENABLE_COMPILATION_CACHE"] = "0"
    import jax

    jax.config.update("jax_enable_x64", True)
    from benchmarks import machine
    from benchmarks.synthesis import gradients, table
    from benchmarks.synthesis.beyond import beyond
    from benchmarks.synthesis.case import Compiling, run
    from benchmarks.synthesis.published import PUBLISHED

    cases = {c.name: c for c in (*PUBLISHED, *beyond())}
    names = [*cases, "gradients"]
    if options.list:
        print("\n".join(names))
        return 0
    wanted = options.case or names
    for name in wanted:
        if name not in names:
            p.error(f"no case {name!r}; --list names them")
    record = json.loads(options.json.read_text()) if options.json.exists() else {}
    if options.table:
        print(table.text(record))
        return 0
    compiling, loads = Compiling(), []
    for name in names:
        if name not in wanted:
            continue
        if name == "gradients":
            rows = gradients.run()
        else:
            keys = tuple(range(options.keys)) if cases[name] in PUBLISHED else cases[name].keys
            rows = run(dataclasses.replace(cases[name], keys=keys), compiling)
        loads = machine.load(loads)
        record.setdefault("cases", {})[name] = rows
        record["cases"] = {n: record["cases"][n] for n in names if n in record["cases"]}
        record |= {"machine": machine.describe(), "load": loads, "date": time.strftime("%Y-%m-%d")}
        options.json.write_text(json.dumps(record, indent=1) + "\n")
        print(table.text({"cases": {name: rows}}, head=False), flush=True)
    print(table.text(record))
    every = [r for rows in record["cases"].values() for r in rows]
    return int(any(not r.get("met", True) or r["not_finite"] for r in every))


if __name__ == "__main__":
    raise SystemExit(main())
