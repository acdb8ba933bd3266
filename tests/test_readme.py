"""The Python blocks of the README and of the guides run, in order, and print what they say they print."""

import contextlib
import io
import re
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
NUMBER = re.compile(r"-?\d+\.\d+(?:e[+-]?\d+)?|-?\d+\.(?!\w)")


def blocks(text: str):
    """Pairs of a Python block and the text block right after it (or None)."""
    found = re.findall(r"```(python|text)\n(.*?)```", text, re.S)
    out = []
    for kind, body in found:
        if kind == "python":
            out.append([body, None])
        else:
            assert out and out[-1][1] is None, "a text block follows its Python block"
            out[-1][1] = body
    return out


def test_readme_is_short_and_links_lead_somewhere():
    assert len(README.splitlines()) <= 120
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert (ROOT / target).exists(), f"README links to {target}, which is not there"
    for name in re.findall(r"examples/\w+\.toml", README):
        assert (ROOT / name).exists()


@pytest.mark.parametrize(
    "name",
    [
        "README.md",
        "docs/batches.md",
        "docs/exact_synthesis.md",
        "docs/tolerance.md",
        "docs/sources.md",
        "docs/families.md",
        pytest.param("docs/optimisers.md", marks=pytest.mark.slow),
        "docs/files.md",
        "docs/pages.md",
        "docs/report.md",
        "docs/instant.md",
        pytest.param("docs/robots.md", marks=pytest.mark.skipif(not find_spec("mujoco"), reason="no mujoco")),
        pytest.param("docs/widget.md", marks=pytest.mark.skipif(not find_spec("anywidget"), reason="no anywidget")),
    ],
)
def test_python_blocks_print_what_is_written(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    space: dict = {}
    pairs = blocks((ROOT / name).read_text())
    assert len(pairs) >= 2
    for code, printed in pairs:
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(compile(code, name, "exec"), space)
        assert printed is not None or name != "README.md", "every block of the README shows its output"
        got, want = out.getvalue().split(), (printed or "").split()
        assert len(got) == len(want), f"\nprinted:\n{out.getvalue()}\nwritten:\n{printed}"
        for a, b in zip(got, want, strict=True):
            if NUMBER.search(a):
                x, y = (np.array(NUMBER.findall(t), float) for t in (a, b))
                np.testing.assert_allclose(x, y, rtol=1e-6, atol=1e-8, err_msg=f"{a} for {b}")
                assert NUMBER.sub("#", a) == NUMBER.sub("#", b)
            else:
                assert a == b, f"printed {a!r}, written {b!r}"


def test_the_model_file_of_the_guide_moves(tmp_path):
    import jaxnc as nc
    from jaxnc.io.drives import sweep_arguments

    text = (ROOT / "docs" / "modelling.md").read_text()
    (tmp_path / "m.toml").write_text(re.search(r"```toml\n(.*?)```", text, re.S).group(1))
    m = nc.load(tmp_path / "m.toml")
    mo = nc.sweep(m.compile(), **sweep_arguments(m))
    assert int(mo.failures) == 0
