"""Every notebook runs from top to bottom, and shows what it is stored with."""

import importlib.util
import json
import re
import subprocess
import sys

import matplotlib as mpl
import pytest
from places import ROOT

FOLDER = ROOT / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
NUMBER = re.compile(r"-?\d+\.\d*(?:e[+-]?\d+)?|-?\d+e[+-]?\d+")
RELATIVE, ABSOLUTE = 1e-6, 1e-8  # of numbers printed with all digits, and of what is zero but for rounding

_spec = importlib.util.spec_from_file_location("notebooks_run", FOLDER / "run.py")
assert _spec and _spec.loader
runner = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(runner)


def read(path):
    return json.loads(path.read_text(encoding="utf-8"))


def valid(notebook):
    """Its import takes 2 s: of the one worker that has these tests, not of all that collect them."""
    import nbformat

    nbformat.validate(notebook)


def codes(notebook):
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def near(a: str, b: str) -> bool:
    """Whether two printed numbers agree: to one of the last digit, which rounding may turn."""
    digits = len(a.partition("e")[0].partition(".")[2])
    last = 10.0 ** (int(a.partition("e")[2] or 0) - digits)
    x, y = float(a), float(b)
    return abs(x - y) <= max(1.01 * last if digits < 9 else 0.0, RELATIVE * abs(x), ABSOLUTE)


def differs(stored: str, fresh: str) -> str:
    """Where two texts differ, "" if nowhere."""
    old, new = stored.split(), fresh.split()
    for a, b in zip(old, new, strict=False):
        x, y = NUMBER.findall(a), NUMBER.findall(b)
        if NUMBER.sub("#", a) != NUMBER.sub("#", b) or not all(map(near, x, y)):
            return f"stored {a!r}, now {b!r}"
    return "" if len(old) == len(new) else f"stored {len(old)} words, now {len(new)}: {new[len(old) :]}"


def texts(outputs):
    """What a cell prints, and what its results are in words where they are no pictures."""
    for out in outputs:
        if out["output_type"] == "stream":
            yield "".join(out["text"])
        elif set(out["data"]) == {"text/plain"}:
            yield "".join(out["data"]["text/plain"])


def pictures(outputs):
    return [set(out["data"]) for out in outputs if len(out.get("data", ())) > 1]


def test_what_differs_is_found():
    for old, new in (
        ("a 1.234", "a 1.235"),
        ("3.1e-16 m", "-2.0e-17 m"),
        ("1.23456789012", "1.23456789100"),
        ("[1.25, 2.5]", "[1.26, 2.5]"),
    ):
        assert not differs(old, new)
    for old, new in (
        ("a 1.234", "a 1.236"),
        ("1.23456789012", "1.23457789012"),
        ("a 7", "a 8"),
        ("a", "a b"),
        ("1e-3", "3e-3"),
        ("a 1.0", "b 1.0"),
    ):
        assert differs(old, new), (old, new)


def test_notebooks_are_listed_and_small():
    listed = re.findall(r"\]\((\w+\.ipynb)\)", (FOLDER / "README.md").read_text(encoding="utf-8"))
    assert listed == [path.name for path in NOTEBOOKS]
    assert sum(path.stat().st_size for path in NOTEBOOKS) < 4_000_000


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebook_is_stored_with_what_it_shows(path):
    notebook = read(path)
    valid(notebook)
    head, *_, end = ("".join(c["source"]) for c in notebook["cells"])
    assert head.startswith(f"# {int(path.name[:2])}. ")
    assert "**Afterwards you can** " in head and re.search(r"\*\*Runs in\*\* about \d+ s", head)
    assert end.startswith("## Exercise")
    outputs = [out for cell in codes(notebook) for out in cell["outputs"]]
    assert any("image/png" in out.get("data", {}) for out in outputs), "pictures are shown"
    assert all(cell["execution_count"] == k for k, cell in enumerate(codes(notebook), 1))
    assert not [out for out in outputs if out["output_type"] == "error" or out.get("name") == "stderr"]


@pytest.mark.notebook
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebook_shows_again_what_is_stored(path, monkeypatch):
    notebook = read(path)
    monkeypatch.chdir(FOLDER)
    if "jax_num_cpu_devices" in path.read_text(encoding="utf-8"):  # which is asked for before anything else is done
        alone = [sys.executable, FOLDER / "run.py", "--show", path.name]
        fresh = json.loads(subprocess.run(alone, check=True, capture_output=True, timeout=600).stdout)
    else:
        with mpl.rc_context():
            mpl.rcdefaults()
            fresh = runner.run(notebook, path.name)
    for number, (cell, outputs) in enumerate(zip(codes(notebook), fresh, strict=True), 1):
        where = f"{path.name}, cell {number}, differs from what python notebooks/run.py {path.name} stored"
        assert pictures(outputs) == pictures(cell["outputs"]), where
        if "varies" not in cell["metadata"].get("tags", ()):  # times
            wrong = differs("\n".join(texts(cell["outputs"])), "\n".join(texts(outputs)))
            assert not wrong, f"{where}: {wrong}"


def test_what_a_cell_shows_is_stored(tmp_path):
    source = "print('a')\nimport matplotlib.pyplot as plt\nplt.plot([1, 2]);\n", "1 + 1", "x = 3;", "display({})"
    cells = [{"cell_type": "code", "metadata": {"time": 1}, "source": s, "outputs": []} for s in source]
    path = tmp_path / "a.ipynb"
    path.write_text(json.dumps({"cells": [{"cell_type": "markdown", "metadata": {}, "source": ["# a"]}, *cells]}))
    runner.store(path)
    first = path.read_bytes()
    valid(read(path))
    kinds = [[o["output_type"] for o in c["outputs"]] for c in codes(read(path))]
    assert kinds == [["stream", "display_data"], ["display_data"], [], ["display_data"]]
    runner.store(path)
    assert path.read_bytes() == first
    cells[0]["source"] = "import sys\nprint('no', file=sys.stderr)"
    with pytest.raises(RuntimeError, match=r"cell 1 wrote to stderr: no"):
        runner.run({"cells": cells})
    cells[0]["source"] = "1 / 0"
    with pytest.raises(ZeroDivisionError) as error:
        runner.run({"cells": cells})
    assert "cell 1" in error.value.__notes__[0]
