"""What an installation brings, what it does without, and files that say what the project is."""

import marshal
import multiprocessing
import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement
from places import ROOT

import jaxnc as nc

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
MEGABYTES = 20  # beside JAX and SciPy, with what Python compiles on import
WITHOUT = "import sys; sys.modules['matplotlib'] = sys.modules['PIL'] = None\n"  # as where they are not installed


def run(code: str, cwd: Path | None = None) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def required(name: str, seen: set[str] | None = None) -> set[str]:
    """A distribution and all that it needs without any extra, by names as PyPI writes them."""
    seen = set() if seen is None else seen
    name = re.sub(r"[-_.]+", "-", name).lower()
    if name in seen:
        return seen
    seen.add(name)
    needs = PROJECT["dependencies"] if name == "jaxnc" else metadata.requires(name) or ()
    for need in needs:
        found = Requirement(need)
        if found.marker is None or found.marker.evaluate({"extra": ""}):
            required(found.name, seen)
    return seen


def size(name: str) -> int:
    """Bytes of an installed distribution, with the bytecode that pip makes; of this one, with what it would make."""
    if name != "jaxnc":
        return sum(os.path.getsize(f.locate()) for f in metadata.files(name) or () if os.path.exists(f.locate()))
    files = [f for f in (ROOT / "jaxnc").rglob("*") if f.is_file() and "__pycache__" not in f.parts]
    code = [compile(f.read_bytes(), f.name, "exec") for f in files if f.suffix == ".py"]
    return sum(f.stat().st_size for f in files) + sum(len(marshal.dumps(one)) for one in code)


@pytest.mark.slow
def test_a_minimal_installation_adds_little_to_an_environment_that_has_jax():
    """JAX brings NumPy and SciPy; whatever else a plain installation brings is counted."""
    added = required("jaxnc") - required("jax") - required("jaxlib")
    assert added == {"jaxnc", "msgspec", "threadpoolctl", "tqdm"}
    sizes = {name: size(name) / 1e6 for name in added}
    assert sum(sizes.values()) <= MEGABYTES, sizes


def test_pictures_and_bars_are_imported_on_demand():
    out = run(
        "import sys, jax; jax.config.update('jax_enable_x64', True); import numpy as np, jaxnc as nc\n"
        "system = nc.library.four_bar().compile()\n"
        "nc.sweep(system, {'phi': np.linspace(0, 6, 61)}); nc.mobility(system); str(system); repr(system)\n"
        "print([name for name in ('matplotlib', 'PIL', 'tqdm') if name in sys.modules])"
    )
    assert out == "[]"


def test_what_needs_a_package_that_is_missing_says_which(tmp_path):
    """One sentence each, and everything that is no picture goes on."""
    out = run(
        WITHOUT + "import jax; jax.config.update('jax_enable_x64', True); import numpy as np, jaxnc as nc\n"
        "motion = nc.sweep(nc.library.four_bar().compile(), {'phi': np.linspace(0, 1, 5)})\n"
        "motion.to_csv('motion.csv')\n"
        "asked = motion.plot, motion.draw, motion.system.draw, lambda: motion.animate('a.gif'), lambda: nc.viz.plot\n"
        "for ask in asked:\n"
        "    try:\n"
        "        ask(); print('no error')\n"
        "    except nc.JaxncError as error:\n"
        "        print(error)\n"
        "print(motion._repr_html_(), motion.system._repr_html_())\n",
        tmp_path,
    )
    said = 'pictures need Matplotlib, which is not installed: pip install "jaxnc[plot]"'
    assert out.splitlines() == [*[said] * 5, "None None"] and (tmp_path / "motion.csv").stat().st_size > 100


def spawned(system):
    """What a process that shares nothing with this one makes of a system that it was sent."""
    return np.asarray(nc.sweep(system, {"phi": np.linspace(0.0, 1.0, 5)}).q)


def test_a_spawned_process_takes_a_system_and_gives_its_poses():
    """As processes are started on Windows and macOS."""
    system = nc.library.four_bar().compile()
    kept = os.environ.get("JAX_ENABLE_X64")
    os.environ["JAX_ENABLE_X64"] = "1"
    try:
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            found = pool.apply(spawned, (system,))
    finally:
        os.environ.pop("JAX_ENABLE_X64") if kept is None else os.environ.update(JAX_ENABLE_X64=kept)
    np.testing.assert_array_equal(found, spawned(system))


def test_texts_are_written_with_the_same_ends_of_lines_everywhere(tmp_path, monkeypatch):
    """As where a text is written with carriage returns unless told otherwise."""
    monkeypatch.setattr("os.linesep", "\r\n")
    mechanism = nc.library.four_bar()
    motion = nc.sweep(mechanism.compile(), {"phi": np.linspace(0, 1, 5)})
    mechanism.save(tmp_path / "m.toml")
    motion.to_csv(tmp_path / "m.csv")
    motion.to_html(tmp_path / "m.html")
    for name in ("m.toml", "m.html"):
        assert b"\r" not in (tmp_path / name).read_bytes(), name
    written = [f for f in (ROOT / "jaxnc").rglob("*.py") for line in f.read_text(encoding="utf-8").splitlines()
               if "write_text(" in line and 'newline="\\n"' not in line]  # fmt: skip
    assert not written


def test_the_citation_is_that_of_the_project():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    fields = dict(re.findall(r"^([\w-]+): *(.+)$", text, re.M))
    assert fields["version"] == nc.__version__ and fields["license"] == PROJECT["license"]
    assert (
        fields["cff-version"] == "1.2.0"
        and fields["type"] == "software"
        and fields["title"].strip('"').startswith("jaxnc")
    )
    assert {"message", "abstract"} <= set(fields) and "authors:" in text and "keywords:" in text


def test_the_recipe_asks_for_what_the_project_asks_for():
    text = (ROOT / "recipe" / "meta.yaml").read_text(encoding="utf-8")
    assert f'set version = "{nc.__version__}"' in text
    runs = re.search(r"^  run:\n((?:    .*\n)+)", text, re.M)[1]
    stated = {re.match(r"\s+- ([\w.-]+)(.*)", line).groups() for line in runs.splitlines()}
    wanted = {re.match(r"([\w.-]+)(.*)", need).groups() for need in PROJECT["dependencies"]}
    assert {(name, bound.strip()) for name, bound in stated if name != "python"} == wanted
    assert f"python {PROJECT['requires-python']}" in runs


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("conda-build") and not shutil.which("rattler-build"), reason="no conda-build here")
def test_the_recipe_builds(tmp_path):
    tool = ["conda-build", "--no-anaconda-upload", "--output-folder", str(tmp_path)]
    if not shutil.which("conda-build"):
        tool = ["rattler-build", "build", "--output-dir", str(tmp_path), "--recipe"]
    done = subprocess.run([*tool, str(ROOT / "recipe")], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
