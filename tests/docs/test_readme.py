"""The Python blocks of the README and of all pages of the site run, in order, and print what they say they print."""

import contextlib
import io
import json
import re
import shlex
from importlib.util import find_spec

import numpy as np
import pytest
from places import DOCS, ROOT
from tracing import shorten

from jaxnc.synthesis.tracing import atlas

README = (ROOT / "README.md").read_text()
_DIGITS = 12  # as the library's own sentences have at most
NUMBER = re.compile(r"-?\d+\.\d+(?:e[+-]?\d+)?|-?\d+\.(?!\w)")


def blocks(text: str):
    """Pairs of a Python block and the text block right after it (or None)."""
    found = re.findall(r"```(python|text)\n(.*?)```", text, re.S)
    out = []
    for kind, body in found:
        if kind == "python":
            out.append([body, None])
        else:
            assert out and out[-1][1] is None, f"no block of Python prints this: {body}"
            out[-1][1] = body
    return out


def test_readme_is_short_and_links_lead_somewhere():
    assert len(README.splitlines()) <= 90
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert (ROOT / target).exists(), f"README links to {target}, which is not there"
    for name in re.findall(r"examples/\w+\.toml", README):
        assert (ROOT / name).exists()


def test_speeds_are_those_of_the_benchmarks():
    found = json.loads((ROOT / "benchmarks" / "results.json").read_text())
    known = {(row["case"], row["way"]): row["median_ns_per_lane"] for row in found["rows"]}
    table = README.partition("## How fast")[2].partition("\n## ")[0]
    rows = {
        "a million angles of a four-bar": ("four-bar", "jaxnc", "naive JAX, n = 2", "C Newton, 8 lanes, n = 4"),
        "a MacPherson strut of 29 coordinates": ("macpherson", "jaxnc", "naive JAX", ""),
        "2,048 poses of an ankle, two motors, from MJCF": (
            "class robot ankle, 2,048",
            "jaxnc: jit",
            "naive JAX, 8 steps",
            "",
        ),
    }
    lines = [[c.strip() for c in line.strip("|").split("|")] for line in table.splitlines() if line.startswith("| ")]
    said = {line[0]: line[1:] for line in lines if line[0]}
    assert list(said) == list(rows)
    for name, (case, *ways) in rows.items():
        for cell, way in zip(said[name], ways, strict=True):
            assert bool(cell) == bool(way), (name, way)
            if way:
                number, unit = re.match(r"([\d.,]+) (ns|µs)", cell).groups()
                scale = {"ns": 1.0, "µs": 1e3}[unit]
                digit = 10.0 ** -len(number.partition(".")[2])
                assert abs(float(number.replace(",", "")) - known[case, way] / scale) <= 0.51 * digit, (name, way)
    machine = found["machine"]
    assert all(machine["versions"][name] in table for name in ("jax",)) and machine["python"][:4] in table
    assert f"{known['single', 'jaxnc'] / 1e6:.1f} ms from Python" in table


def test_pages_print_digits_that_hold_on_every_machine():
    """The last ones of sixteen are those of one processor."""
    for page in PAGES:
        for printed in re.findall(r"```text\n(.*?)```", (ROOT / page).read_text(), re.S):
            long = [x for x in NUMBER.findall(printed) if len(re.sub(r"e.*|[-.]", "", x).lstrip("0")) > _DIGITS]
            assert not long, f"{page} prints {', '.join(long)}: round them"


def test_the_film_is_small():
    assert (DOCS / "descent.gif").stat().st_size <= 600_000


SLOW = {"docs/optimisers.md", "docs/synthesis.md", "docs/dynamics.md", "docs/stack.md", "docs/pytorch.md"}
NEEDS = {
    "docs/widget.md": "anywidget",
    "docs/robots.md": "mujoco",
    "docs/files.md": "xarray",
    "docs/stack.md": "optimistix",
    "docs/pytorch.md": "torch",
}
PAGES = ["README.md", *(f"docs/{p.name}" for p in sorted((DOCS).glob("*.md")))]


def marked(name: str):
    """A page with what its test needs; a page without code is none."""
    marks = [pytest.mark.slow] * (name in SLOW)
    if module := NEEDS.get(name):
        marks.append(pytest.mark.skipif(not find_spec(module), reason=f"no {module}"))
    return pytest.param(name, marks=marks, id=name)


def same(got: str, want: str) -> str:
    """What is wrong with a printed line; "" if it is as written: numbers to six digits, and … leaves the rest open."""
    ours, theirs = got.split(), want.split()
    if "…" in theirs:
        cut = theirs.index("…")
        ours, theirs = ours[:cut], theirs[:cut]
    if len(ours) != len(theirs):
        return f"printed {got!r}, written {want!r}"
    for a, b in zip(ours, theirs, strict=True):
        x, y = ([float(n) for n in NUMBER.findall(t)] for t in (a, b))
        if NUMBER.sub("#", a) != NUMBER.sub("#", b) or not np.allclose(x, y, rtol=1e-6, atol=1e-8):
            return f"printed {a!r}, written {b!r}, in {got!r}"
    return ""


def compare(printed: str, written: str) -> None:
    """Line by line; a line that is … alone stands for any number of lines."""
    got, want = ([line for line in text.splitlines() if line.strip()] for text in (printed, written))
    while want:
        line = want.pop(0)
        if line.strip() == "…":
            while got and (not want or same(got[0], want[0])):
                got.pop(0)
            continue
        assert got, f"not printed: {line!r}"
        wrong = same(got.pop(0), line)
        assert not wrong, f"{wrong}\n\nprinted:\n{printed}\nwritten:\n{written}"
    assert not got, f"printed, and not written: {got}"


@pytest.mark.parametrize("name", [marked(n) for n in PAGES if "```python" in (ROOT / n).read_text()])
def test_python_blocks_print_what_is_written(name, tmp_path, monkeypatch):
    """Of an atlas that a page has made four-bars are as many as it says, and none is larger."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(atlas, "BARS", (4,))
    shorten(monkeypatch)
    space: dict = {"__name__": "page"}
    for code, printed in blocks((ROOT / name).read_text()):
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(compile(code, name, "exec"), space)
        assert printed is not None or name != "README.md", "every block of the README shows its output"
        compare(out.getvalue(), printed or "")


def test_a_page_that_prints_something_else_is_found():
    compare("a 1.00000001\nb\nc\nd 2.5", "a 1.0\n…\nd 2.5")
    compare("x 1.25 y z\n", "x 1.25 …")
    for printed, written in (
        ("a 1.01", "a 1.0"),
        ("a\nb", "a"),
        ("a", "a\nb"),
        ("a 1.0 b", "a 1.0"),
        ("x 1.26 y", "x 1.25 …"),
        ("a\nc", "a\n…\nb"),
        ("1e-9", "1.0e-9 m"),
    ):
        with pytest.raises(AssertionError):
            compare(printed, written)


def test_commands_that_pages_name_are_understood():
    """Lines of shell blocks that call jaxnc: commands and options that there are, on example files that there are."""
    from jaxnc.cli.main import command_parser

    seen = 0
    for name in PAGES:
        for block in re.findall(r"```sh\n(.*?)```", (ROOT / name).read_text(), re.S):
            for line in re.findall(r"(?:^|&& )jaxnc (.*)", block, re.M):
                words = shlex.split(line, comments=True)
                command_parser().parse_args(words)
                for word in words:
                    assert not word.startswith("examples/") or (ROOT / word).exists(), f"{name}: {line}"
                seen += 1
    assert seen > 3


def test_the_model_file_of_the_guide_moves(tmp_path):
    import jaxnc as nc
    from jaxnc.io.drives import sweep_arguments

    text = (DOCS / "modelling.md").read_text()
    (tmp_path / "m.toml").write_text(re.search(r"```toml\n(.*?)```", text, re.S).group(1))
    m = nc.load(tmp_path / "m.toml")
    mo = nc.sweep(m.compile(), **sweep_arguments(m))
    assert int(mo.failures) == 0
