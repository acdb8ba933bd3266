"""The page docs/equations.md: every equation of the source text, who writes it here and what checks it.

Made of the `source=` of kinds, of docstrings, of the equations as printed and of the table of errata:
``python tests/equation_table.py`` writes it again, and a test compares.
"""

import inspect
import re

from places import DOCS
from printed import COMPARED, COUNTS, FIGURES, GROUPS, VARIED, Group

import jaxnc as nc
from jaxnc.constraints import CATALOGUE, Kind
from jaxnc.families.program import EQUAL, PROJECTION

ERRATA = (DOCS / "sources.md").read_text(encoding="utf-8").partition("## Errata")[2]
LAST = 201  # and (42b)
CITED = re.compile(r"\((\d{1,3})(b?)\)(?:\s*-\s*\((\d{1,3})\))?")
Number = tuple[int, str]
HEAD = """\
# From equation to function

Every equation of the [source text](sources.md), (1)-(201): how it reads, with the names that the library's mechanisms
have; the kinds of `nc.constraints.CATALOGUE` that write it or replace it, with their forms; the functions that use it
(`m.` is `nc.Mechanism`, `library.` is `nc.library`); the [erratum](sources.md#errata) where computing showed one.
r1 is the vector of point 1, x1 its component, L12 the length drawn between 1 and 2, [ ]x a component of a vector
product, c and Greek letters without a variable's name constants of the drawing.

Each is checked as it reads by `tests/docs/test_printed.py`, at poses of the library's mechanism or of bodies displaced
by hand: it vanishes, and the printed equations together have the same rank as those written here and admit the same
motions, also where ours look different. Each erratum has a test of its number in `tests/docs/test_sources.py`.
This page is made by `python tests/equation_table.py`.
"""


def cited(text: str | None) -> set[Number]:
    """Equations that a text cites: ``(128)-(130)`` and ``(42b)``."""
    found = set()
    for first, letter, last in CITED.findall(text or ""):
        found |= {(n, letter) for n in range(int(first), int(last or first) + 1) if 1 <= n <= LAST}
    return found


def source(function) -> str:
    """What a docstring says of its source; of a builder's method without one, all of it."""
    doc = inspect.getdoc(function) or ""
    _, _, said = doc.partition("Source:")
    return said or (doc if function.__qualname__.startswith("Mechanism.") else "")


def index() -> dict[Number, tuple[list[str], list[str]]]:
    """For every equation the kinds that write it, and the functions that use it."""
    found = {(n, ""): ([], []) for n in range(1, LAST + 1)} | {(42, "b"): ([], [])}
    kinds: list[Kind] = [*CATALOGUE.values(), PROJECTION, EQUAL]
    for kind in kinds:
        # Kinds over directions are listed once for all forms of these.
        name = re.sub(r"(?: of| with)? (?:[pv]{1,4}|[23])(?=,|$)", "", kind.name)
        for n in cited(kind.source):
            if name not in found[n][0]:
                found[n][0].append(name)
    called = {f"nc.{n}": getattr(nc, n) for n in ("formulate", "mobility")}
    called |= {f"m.{n}": f for n, f in inspect.getmembers(nc.Mechanism, inspect.isfunction) if n[0] != "_"}
    called |= {f"library.{f.__name__}": f for f in nc.library.CATALOGUE.values()}
    for name, function in called.items():
        for n in cited(source(function)):
            found[n][1].append(name)
    return found


def errata() -> dict[Number, list[str]]:
    """The errata of each equation, from the table of docs/sources.md."""
    found: dict[Number, list[str]] = {}
    for number, equations in re.findall(r"^\| (\d+) \| ([^|]+) \|", ERRATA, re.M):
        for n in cited(equations):
            found.setdefault(n, []).append(number)
    return found


def kinds_of(names: list[str]) -> str:
    forms: dict[str, list[str]] = {}
    for name in names:
        base, _, form = name.partition(", ")
        forms.setdefault(base, []).append(form or "exact")
    return "; ".join(base + (f" ({', '.join(f)})" if f != ["exact"] else "") for base, f in forms.items())


def rows(reads: dict[int | str, str]) -> list[str]:
    """A table; consecutive equations that differ in nothing but a component's letter stay apart."""
    known, wrong = index(), errata()
    lines = ["| | equation | kinds | functions | erratum |", "|---|---|---|---|---|"]
    for number, text in reads.items():
        at = (42, "b") if number == "42b" else (int(number), "")
        kinds, functions = known[at]
        called = ", ".join(f"`{f}`" for f in functions)
        lines.append(f"| ({number}) | `{text}` | {kinds_of(kinds)} | {called} | {', '.join(wrong.get(at, []))} |")
    return lines


def span(numbers: list[int | str]) -> str:
    return f"({numbers[0]})" + (f"-({numbers[-1]})" if len(numbers) > 1 else "")


def section(name: str, group: Group) -> list[str]:
    numbers = list(group.rows)
    lines = [f"## {span(numbers)} {group.name[0].upper()}{group.name[1:]}, {FIGURES[int(numbers[0])]}", ""]
    lines += rows({n: row.reads for n, row in group.rows.items()})
    written = nc.formulate(group.mechanism, "mixed")
    count = f"n = {written.n}, g = {written.g}"
    return [*lines, "", f"As written here ({count}):", "", "```text", *str(written.equations()).splitlines(), "```", ""]


def page() -> str:
    """The whole page."""
    lines = [HEAD, "## (1), (22), (88) Counts, §2, §3.1, §4.1", ""]
    lines += [*rows(dict(COUNTS)), ""]
    lines += ["## (2)-(12) Relative coordinates and reference points, fig. 3 and 4", ""]
    lines += [*rows({n: row.reads for n, row in COMPARED.items()}), ""]
    lines += ["`nc.formulate` writes both from the mechanism of fig. 6; see [families.md](families.md).", ""]
    for name, group in GROUPS.items():
        lines += section(name, group)
        if 38 in group.rows:
            lines += ["## (40) Where the cosine is blind, §3.3.1", "", *rows(dict(VARIED)), ""]
    return "\n".join(lines).rstrip() + "\n"


if __name__ == "__main__":
    import jax

    jax.config.update("jax_enable_x64", True)
    (DOCS / "equations.md").write_text(page(), encoding="utf-8")
