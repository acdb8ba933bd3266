"""The command line: what it prints, what it writes, how it ends, and one line for every mistake."""

import gc
import json
import os
import re
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from places import EXAMPLES

import jaxnc
import jaxnc as nc
from jaxnc.cli import main
from jaxnc.cli.main import command_process
from jaxnc.errors import JaxncError
from jaxnc.io.files import load
from jaxnc.io.tables import load_csv, load_npz
from jaxnc.library.catalogue import CATALOGUE
from jaxnc.reporting.checked import ExtremeValue, Quantity, extreme_of, extremes_of, quantities

FOUR_BAR = str(EXAMPLES / "four_bar.toml")
SWINGING = str(EXAMPLES / "swinging_four_bar.toml")
LIFT = str(EXAMPLES / "scissor_lift.toml")
FEW = ["--input", "phi=0:360:13"]


def said(capsys, *arguments: str, code: int = 0) -> str:
    """What a command prints that ends with `code` and complains about nothing."""
    assert main(arguments) == code
    out, err = capsys.readouterr()
    assert err == ""
    return out


def complaint(capsys, *arguments: str, code: int = 2) -> str:
    """The single line on stderr of a command that is refused."""
    assert main(arguments) == code
    out, err = capsys.readouterr()
    assert out.count("\n") <= 1 and not out.startswith(" ")  # the title, where the mechanism could be read
    assert err.startswith("jaxnc: ") and err.endswith("\n") and err.count("\n") == 1
    assert "Traceback" not in err and "site-packages" not in err
    return err


def edited(tmp_path: Path, *pairs: tuple[str, str], source: str = FOUR_BAR) -> str:
    text = Path(source).read_text(encoding="utf-8")
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / "model.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


# ---------------------------------------------------------------------------------------------------------------
# run


def test_run_reports(capsys):
    out = said(capsys, "run", FOUR_BAR, "--input", "phi= 0 : 360 : 361")
    assert out.startswith("four-bar: crank-rocker whose coupler point P draws a curve\n")
    assert "8 coordinates, 7 constraint rows of rank 7, 1 degree of freedom" in out
    assert "phi driven from 0 to 360 deg at 360 deg/s, 361 poses in order along the branch" in out
    assert "all 361 poses found; worst residual " in out and "smallest conditioning " in out
    assert re.search(r"time: import .* compile .* run .* m?s\n", out)
    assert "no files written; --out DIR" in out
    # The rocker is extreme where crank and coupler lie in line: cos ψ from the triangle of 4, 3 and l ± 1.
    coupler = np.hypot(3.3, 1.9)
    dead = [180 - np.degrees(np.arccos((16 + 9 - (coupler + s) ** 2) / 24)) for s in (1, -1)]
    row = next(line for line in out.splitlines() if line.startswith("  psi [deg]")).split()
    assert float(row[2]) == pytest.approx(dead[0], abs=1e-3) and row[3].endswith("~")
    assert float(row[4]) == pytest.approx(dead[1], abs=1e-3) and row[5].endswith("~")
    assert float(row[6]) == pytest.approx(dead[1] - dead[0], abs=1e-3)
    for label in ("v(psi) [deg/s]", "a(psi) [deg/s^2]", "P.x [m]", "P.y [m]", "|v(P)| [m/s]", "|a(P)| [m/s^2]"):
        assert f"\n  {label} " in out
    widths = {len(line) for line in out.splitlines()}
    assert max(widths) <= 110


def test_run_writes_tables(capsys, tmp_path):
    out = said(capsys, "run", FOUR_BAR, *FEW, "--no-pictures", "--out", str(tmp_path / "a" / "b"))
    files = sorted(p.name for p in (tmp_path / "a" / "b").iterdir())
    assert files == ["four-bar.csv", "four-bar.npz"]
    assert all(name in out for name in files)
    table = load_npz(tmp_path / "a" / "b" / "four-bar.npz")
    assert table["phi"].shape == (13,) and table["phi"][-1] == pytest.approx(2 * np.pi)
    assert table.velocities["phi"][0] == pytest.approx(2 * np.pi)


def test_run_writes_pictures_and_a_page(capsys, tmp_path):
    out = said(capsys, "run", FOUR_BAR, *FEW, "--out", str(tmp_path), "--animate")
    magic = {".png": b"\x89PNG", ".gif": b"GIF8", ".html": b"<!"}
    for name in ("four-bar.png", "four-bar-plots.png", "four-bar.html", "four-bar.gif"):
        assert (tmp_path / name).read_bytes().startswith(magic[Path(name).suffix]), name
        assert str(tmp_path / name) in out


def test_run_options_change_the_run(capsys, tmp_path):
    out = said(capsys, "run", FOUR_BAR, *FEW, "--poses", "7", "--rate", "phi=90deg", "--output", "psi,C.x")
    assert "phi driven from 0 to 360 deg at 90 deg/s, 7 poses" in out
    assert "\n  C.x [m] " in out and "P.x" not in out
    out = said(
        capsys, "run", FOUR_BAR, "--input", "psi=1.7rad:2rad:4", "--analysis", "solve_position", "--output", "phi"
    )
    assert "psi driven from 97.4028 to 114.592 deg, 4 poses every pose on its own" in out
    out = said(capsys, "run", FOUR_BAR, "--input", "phi=30", "--out", str(tmp_path), "--animate")
    assert "phi driven to 30 deg at 360 deg/s, 1 pose " in out and "\n  1 pose found" in out and "range" not in out
    assert sorted(p.suffix for p in tmp_path.iterdir()) == [".csv", ".npz", ".png"]  # one pose has no curve


def test_run_by_arc_length_has_no_rates(capsys):
    out = said(capsys, "run", FOUR_BAR, "--analysis", "circuit", "--input", "psi=95:140:9", "--output", "phi")
    assert "by arc length along the circuit, through dead points" in out and "v(phi)" not in out
    err = complaint(capsys, "run", FOUR_BAR, "--analysis", "circuit", "--input", "psi=95:140:9", "--rate", "psi=1")
    assert "--rate" in err and "leave one of the two out" in err


def test_run_says_where_and_why_poses_fail(capsys):
    out = said(capsys, "run", FOUR_BAR, "--input", "psi=100:150:11", "--output", "phi", code=1)
    assert "3 of 11 poses FAILED" in out
    assert "psi = 140 deg: A singular position: the motion stops here" in out
    assert "psi = 145 … 150 deg: Not reached" in out
    assert "does not assemble at psi = 140" in out and "it can be moved as far as psi = 135.49" in out
    assert "length A-B of crank" in out and "smallest change" in out


def test_run_stops_at_a_dead_point(capsys):
    out = said(capsys, "run", LIFT, "--input", "s=1.8:2.2:5", code=1)
    assert (
        "s = 2 m: A singular position: the motion stops here" in out
        and "is a dead point" in out
        and "stop short of it" in out
    )


def test_constant_outputs_and_two_inputs(capsys, tmp_path):
    out = said(capsys, "run", LIFT, "--poses", "5", "--output", "tilt,load")
    assert re.search(r"tilt \[deg\] +0  everywhere\n", out) and re.search(r"load.x \[m\] +1  everywhere\n", out)
    assert "v(tilt)" not in out and "|v(load)|" in out
    path = tmp_path / "arm.toml"
    path.write_text(
        'name = "arm"\n[ground]\nA = [0, 0]\n[points]\nB = [1, 0]\nC = [2, 1]\n'
        '[bodies]\na = ["A", "B"]\nb = ["B", "C"]\n[angles]\nf = { at = "A", to = "B" }\ng = { at = "B", to = "C" }\n'
        "[run.inputs]\nf = { from = 0, to = 1, poses = 3 }\ng = { from = 1, to = 0, poses = 3 }\n"
    )
    out = said(capsys, "run", str(path))
    assert "at f, g [rad]" in out and re.search(r"C\.y \[m\] .* 1, 0 ", out)
    err = complaint(capsys, "run", str(path), "--input", "f=0:1:3")
    assert "too few inputs" in err and "2 degrees of freedom" in err and "g" in err


# (what is wrong, options, what the line says)
WRONG = [
    ("input name", ["--input", "fi=0:1"], ["'fi'", "known names"]),
    ("input form", ["--input", "phi"], ["--input phi", "NAME=FROM:TO"]),
    ("input number", ["--input", "phi=0:x"], ["phi=0:x", "'x' is not a number"]),
    ("input nan", ["--input", "phi=0:nan"], ["'nan' must be a finite number"]),
    ("input poses", ["--input", "phi=0:1: 2.5"], ["whole number", "'2.5'"]),
    ("too many parts", ["--input", "phi=0:1:2:3"], ["NAME=FROM:TO:POSES"]),
    ("input twice", ["--input", "phi=0:1", "--input", "phi=0:2"], ["given twice"]),
    ("degrees of a length", ["--input", "B.x=0:1deg"], ["'B.x' is not an angle", "leave 'deg' out"]),
    ("too many inputs", ["--input", "phi=0:1:5", "--input", "psi=0:1:5"], ["too many inputs", "phi, psi", "Leave 1"]),
    ("too many poses", ["--poses", "2000000"], ["'phi'", "2000000 poses", "at most 1000000"]),
    ("no poses", ["--poses", "0"], ["poses = 0", "at least 1"]),
    ("poses of words", ["--poses", "many"], ["--poses", "'many'", "--help"]),
    ("rate of no input", ["--rate", "psi=3"], ["'psi' is not driven", "did you mean 'phi'"]),
    ("rate twice", ["--rate", "phi=1", "--rate", "phi=2"], ["--rate", "given twice"]),
    ("rate form", ["--rate", "phi"], ["--rate phi", "NAME=RATE"]),
    ("output", ["--output", "PP"], ["'PP'", "did you mean 'P'"]),
    ("hold", ["--hold", "fi"], ["'fi'", "to hold"]),
    ("analysis", ["--analysis", "arc"], ["--analysis", "'arc'", "circuit", "--help"]),
    ("option", ["--outputs", "P"], ["--outputs"]),
]


@pytest.mark.parametrize(("options", "says"), [pytest.param(*case[1:], id=case[0]) for case in WRONG])
def test_run_refuses(capsys, options, says):
    err = complaint(capsys, "run", FOUR_BAR, *options)
    assert all(piece in err for piece in says), err


def test_run_refuses_bad_files(capsys, tmp_path):
    assert "no such file; did you mean 'four_bar.toml'" in complaint(capsys, "run", str(EXAMPLES / "fourbar.toml"))
    assert (
        "line 19: " in (err := complaint(capsys, "run", edited(tmp_path, ("[1.8, 2.6]", "[1.8, nan]"))))
        and "'P'" in err
    )
    assert "unknown point 'Z'" in complaint(capsys, "check", edited(tmp_path, ('["A", "B"]', '["A", "Z"]')))
    err = complaint(capsys, "run", edited(tmp_path, ("B = [0, 1]", "B = [0, 0]")))
    assert "model.toml, line 22: body 'crank'" in err and "same place" in err and "move one" in err
    silent = edited(tmp_path, ("[run.inputs]", "[run.inputs] #"), ("phi = { from", "# phi = { from"))
    err = complaint(capsys, "run", silent)
    assert "'four-bar' does not say what is driven" in err and "--input" in err and "phi, psi, B.x" in err


def test_folders_that_cannot_be_written(capsys, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    err = complaint(capsys, "run", FOUR_BAR, *FEW, "--out", str(tmp_path / "file" / "out"))
    assert "cannot write" in err and "file/out" in err and "choose another folder" in err
    monkeypatch.setattr(os, "access", lambda *_: False)
    err = complaint(capsys, "demo", "--out", str(tmp_path / "locked"))
    assert "locked" in err and "permission denied" in err and "choose another folder" in err


def test_a_start_that_cannot_be_reached_by_arc_length(capsys):
    err = complaint(capsys, "run", FOUR_BAR, "--analysis", "circuit", "--input", "psi=0:140:9", code=1)
    assert "does not assemble" in err and "psi" in err and "jaxnc check" in err


# ---------------------------------------------------------------------------------------------------------------
# check


def test_check(capsys):
    out = said(capsys, "check", LIFT)
    assert out.startswith("scissor lift: two stages")
    assert "1 ground point, 8 points, 1 marker, 5 bodies, 1 joint, 2 angles, 2 distances" in out
    assert "degrees of freedom 1" in out and "it assembles" in out
    assert "may be driven: slope, tilt, s, height, S.x" in out
    assert "s can go from 0 to 2 m" in out
    assert "warning" not in out and "problem" not in out and "good: `jaxnc run` can carry it out" in out
    assert "phi turns fully" in said(capsys, "check", FOUR_BAR)


def test_check_of_what_does_not_assemble(capsys, tmp_path):
    out = said(capsys, "check", edited(tmp_path, ("C-D = 3 ", "C-D = 30 ")), code=1)
    assert "does NOT assemble" in out and "rocker" in out and "good" not in out
    assert "smallest change" in out


def test_check_warns(capsys, tmp_path):
    path = edited(
        tmp_path,
        ("C-D = 3 ", "C-D = 3.5 "),
        ("D = [4, 0]", "D = [4, 0]\nE = [9, 9]"),
        ("P = [1.8, 2.6]", "P = [1.8, 2.6]\nQ = { at = [5, 5], fixed = 'x' }"),
        ("phi = { from = 0", "# phi = { from = 0"),
    )
    out = said(capsys, "check", path)
    assert "warning: point 'Q' is in no body" in out
    assert "warning: nothing is attached to ground E" in out
    assert "warning: the drawing does not fit its dimensions" in out and "is moved by" in out
    assert "warning: it has no table [run.inputs]" in out and "--input" in out


def test_check_of_a_run_that_cannot_be(capsys, tmp_path):
    out = said(
        capsys, "check", edited(tmp_path, ("phi = { from = 0, to = 360", "psi = { from = 100, to = 170")), code=1
    )
    assert "problem: run.inputs: the last pose, psi = 170 deg, is not found" in out and "first pose" not in out
    out = said(
        capsys, "check", edited(tmp_path, ("phi = { from", "psi = { from = 90, to = 91 }\nphi = { from")), code=1
    )
    assert "problem: run.inputs: too many inputs" in out and "1 degree of freedom" in out


def test_check_of_a_structure(capsys, tmp_path):
    out = said(
        capsys, "check", edited(tmp_path, ('crank = ["A", "B"]', 'crank = ["A", "B"]\nstrut = ["A", "C"]')), code=1
    )
    assert "problem: run.inputs: phi cannot be driven, it has no degree of freedom" in out
    assert "warning: nothing moves: leave out a body or a joint" in out and "may be driven" not in out


# ---------------------------------------------------------------------------------------------------------------
# demo


def test_demo_writes_and_says_what_next(capsys, tmp_path):
    out = said(capsys, "demo", "slider_crank", "--poses", "13", "--no-pictures", "--out", str(tmp_path))
    assert out.startswith("slider-crank") and "phi driven from 0 to 360 deg" in out
    model = tmp_path / "slider-crank.toml"
    assert f"next: the model is in {model}" in out and f"`jaxnc run {model}`" in out
    assert load(model).model.run.inputs["phi"].end == 360.0
    model.write_text(model.read_text() + "\n# mine\n")
    out = said(capsys, "demo", "--poses", "13", "--no-pictures", "--out", str(tmp_path))
    assert "left as it is" in out and model.read_text().endswith("# mine\n")


def test_demo_has_a_list_and_offers_near_names(capsys):
    out = said(capsys, "demo", "--list")
    assert [line.split()[0] for line in out.splitlines()] == list(CATALOGUE)
    assert all(len(line.split()) > 3 for line in out.splitlines())
    err = complaint(capsys, "demo", "slider-cranc")
    assert "'slider-cranc'" in err and "did you mean 'slider-crank'" in err and "demo --list" in err


# ---------------------------------------------------------------------------------------------------------------
# the command itself


def test_help_and_version(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0 and capsys.readouterr().out == f"jaxnc {jaxnc.__version__}\n"
    assert main([]) == 2
    assert "jaxnc demo slider-crank" in capsys.readouterr().out
    for command in ("demo", "check", "run"):
        with pytest.raises(SystemExit):
            main([command, "--help"])
        assert f"usage: jaxnc {command}" in capsys.readouterr().out
    assert "'rum'" in (err := complaint(capsys, "rum")) and "did you mean 'run'" in err


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (KeyboardInterrupt(), 130, "jaxnc: interrupted\n"),
        (JaxncError("one\n  two"), 2, "jaxnc: one two\n"),
        (OSError(28, "No space left on device", "x.csv"), 2, "jaxnc: [Errno 28] No space left on device: 'x.csv'\n"),
    ],
)
def test_how_it_ends(capsys, monkeypatch, error, code, line):
    def fail(*_):
        raise error

    monkeypatch.setattr("jaxnc.cli.commands.do_check", fail)
    assert main(["check", FOUR_BAR]) == code
    assert capsys.readouterr().err == line


def test_a_bug_is_not_hidden(monkeypatch):
    def fail(*_):
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr("jaxnc.cli.commands.do_check", fail)
    with pytest.raises(ZeroDivisionError):
        main(["check", FOUR_BAR])


def jaxnc_process(*arguments: str, **options) -> subprocess.CompletedProcess:
    """The command in a process of its own, which does not know that the tests have 64-bit numbers on."""
    command = [sys.executable, "-W", "error", "-m", "jaxnc", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, **options)


def test_a_process_of_its_own(tmp_path):
    told = jaxnc_process("--help")
    assert told.returncode == 0 and "COMMAND" in told.stdout
    told = jaxnc_process("run", FOUR_BAR, "--poses", "5", cwd=tmp_path)
    assert told.returncode == 0 and told.stderr == ""
    assert "all 5 poses found; worst residual" in told.stdout
    assert float(re.search(r"worst residual (\S+)", told.stdout)[1]) < 1e-13  # so 64-bit numbers are on
    told = jaxnc_process("run", "nothing.toml", cwd=tmp_path)
    assert told.returncode == 2 and told.stdout == ""
    assert re.fullmatch(r"jaxnc: nothing\.toml: no such file; there are no model files in \.\n", told.stderr)


# The command in a process where importing JAX ends it.
BEFORE_JAX = """
import sys
class End:
    def find_spec(self, name, path=None, target=None):
        if name == "jax":
            sys.exit(77)
sys.meta_path.insert(0, End())
from jaxnc.cli import main
main(sys.argv[1:])
"""


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("demo", "macpherson-suspension", "--out", "."), "MacPherson suspension: Strut suspension of a"),
        (("run", FOUR_BAR), "four-bar: "),
        (("check", FOUR_BAR), "four-bar: "),
        (("compare", FOUR_BAR), "four-bar: "),
        (("modes", FOUR_BAR), "four-bar: "),
        (("export", FOUR_BAR, "--to", "urdf"), "four-bar: "),
        (("simulate", SWINGING), "swinging four-bar: "),  # with a spring
        (("synthesise", str(EXAMPLES / "problems" / "path.toml")), "path.toml: path of P, four-bar"),
    ],
)
def test_the_first_line_comes_before_jax_is_imported(tmp_path, arguments, line):
    """Importing JAX takes most of a second, and what follows some more."""
    command = [sys.executable, "-c", BEFORE_JAX, *arguments]
    told = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, cwd=tmp_path)
    assert told.returncode == 77 and told.stderr == ""
    assert told.stdout.startswith(line) and told.stdout.count("\n") == 1


def test_help_needs_no_jax():
    command = [sys.executable, "-c", BEFORE_JAX, "--help"]  # 0.05 s on an idle machine
    told = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert told.returncode == 0 and "COMMAND" in told.stdout


def test_a_reader_who_leaves_early(tmp_path):
    command = f'"{sys.executable}" -m jaxnc demo --list | head -1; exit ${{PIPESTATUS[0]}}'
    told = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=300)
    assert told.stderr == "" and told.stdout.count("\n") == 1


# ---------------------------------------------------------------------------------------------------------------
# modes


def test_modes_lists_all_assemblies(capsys, tmp_path):
    out = said(capsys, "modes", FOUR_BAR, "--input", "phi=60", "--output", "C", "--out", str(tmp_path))
    assert "2 assemblies at phi = 60 deg" in out and "(proved by total degree" in out
    rows = [line.split() for line in out.splitlines() if re.match(r" +[01] ", line)]
    crank, far = np.array([0.5, np.sqrt(0.75)]), np.array([4.0, 0.0])
    coupler = np.hypot(3.3, 1.9)  # as drawn
    for row in rows:
        c = np.array(row[1:3], float)
        assert np.linalg.norm(c - crank) == pytest.approx(coupler, rel=1e-5)
        assert np.linalg.norm(c - far) == pytest.approx(3.0, rel=1e-5)
    assert len(rows) == 2 and rows[0][1:3] != rows[1][1:3]
    table = load_csv(tmp_path / "four-bar-modes.csv")
    np.testing.assert_allclose(table["C"], np.array([row[1:3] for row in rows], float), rtol=1e-5)
    assert (tmp_path / "four-bar-modes.png").stat().st_size > 1000


def test_modes_maps_a_range(capsys, tmp_path):
    """A rocker-rocker: its crank turns between two dead points, which the law of cosines gives."""
    path = edited(tmp_path, ("C-D = 3", "C-D = 1"))
    out = said(capsys, "modes", path, "--map", "phi=-180deg:180:61", "--out", str(tmp_path), "--no-pictures")
    stretched = np.hypot(3.3, 1.9) + 1.0  # coupler and rocker in line
    dead = np.degrees(np.arccos((1 + 16 - stretched**2) / 8))
    ends = [float(x) for x in re.findall(r"(-?[\d.]+)  dead point", out)]
    np.testing.assert_allclose(sorted(ends), [-dead, -dead, dead, dead], atol=1e-3)
    assert "1 circuit; the drawing's has 2 branches" in out
    text = (tmp_path / "four-bar-circuits.csv").read_text().splitlines()
    assert text[0].startswith("branch,circuit,phi [deg],") and len(text) > 61
    assert not list(tmp_path.glob("*.png"))


def test_modes_for_machines(capsys):
    verdict = json.loads(said(capsys, "modes", FOUR_BAR, "--map", "phi=0:360:13", "--json"))
    found = verdict["assemblies"]
    assert found["count"] == [2] * 13 and found["values"][1] == pytest.approx(30) and verdict["good"]
    assert [(b["circuit"], b["turns"]) for b in found["branches"]] == [(0, True), (1, True)]
    none = json.loads(said(capsys, "modes", FOUR_BAR, "--input", "psi=9", "--json", code=1))
    assert none["assemblies"]["count"] == [0] and none["findings"][0]["code"] == "does-not-assemble"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--map", "phi=360:0"), "--map phi=360:0: write NAME=FROM:TO"),
        (("--map", "pi=0:360"), "no coordinate 'pi' to drive; did you mean"),
        (("--input", "phi=0:360"), "--input phi=0:360: write NAME=VALUE"),
        (("--input", "phi=1", "--map", "phi=0:9"), "'phi' is given by --input too"),
        (("--input", "psi=1", "--map", "phi=0:9"), "too many inputs"),
        (("--input", "psi=1", "--input", "psi=2"), "--input: a coordinate is given twice"),
        (("--map", "phi=0:9", "--map", "psi=0:9"), "--map: one input goes over a range"),
        (("--hold", "ps"), "no coordinate 'ps' to hold"),
        (("--map", "phi=0:360:100000000000"), "at most 1000000 fit"),
    ],
)
def test_modes_refuses(capsys, options, says):
    assert says in complaint(capsys, "modes", FOUR_BAR, *options)


# ---------------------------------------------------------------------------------------------------------------
# extremes


def extreme(y: np.ndarray, along: np.ndarray | None, largest: bool) -> ExtremeValue:
    return extreme_of(Quantity("y", "m", y, 1.0), along, largest)


def test_an_extreme_between_poses_is_the_vertex_of_a_parabola():
    u = np.array([0.0, 1.0, 2.5, 3.0, 4.0])
    y = 7.0 - 2.0 * (u - 2.2) ** 2
    found = extreme(y, u, largest=True)
    assert found.refined and found.value == pytest.approx(7.0, abs=1e-13)
    assert np.interp(found.at, np.arange(5), u) == pytest.approx(2.2, abs=1e-13)
    low = extreme(-y[::-1], -u[::-1], largest=False)
    assert low.refined and low.value == pytest.approx(-7.0) and low.at == pytest.approx(4 - found.at)


def test_a_speed_that_vanishes_between_poses_is_refined_by_its_square():
    u = np.linspace(0.0, 1.0, 6)
    q = Quantity("|v(P)|", "m/s", np.abs(u - 0.33), 1.0, rate=True, parts=u[:, None] - 0.33)
    found = extreme_of(q, u, largest=False)
    assert found.value == pytest.approx(0.0, abs=1e-7) and found.at / 5 == pytest.approx(0.33)


@pytest.mark.parametrize("poses", [13, 38])
def test_what_changes_its_sign_between_poses_has_been_zero(poses):
    """An offset slider stops where crank and coupler are in line; a parallelogram transmits nothing where flat."""
    m = nc.library.slider_crank(crank=0.3, conrod=0.8, offset=0.05)
    motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 6, poses)}, rates={"phi": 1.0})
    (speed,) = (one for one in nc.report(motion, outputs=["C"]).verdict.extremes if one.quantity == "|v(C)|")
    at = [np.arcsin(0.05 / 1.1), np.pi + np.arcsin(0.05 / 0.5)]
    assert speed.smallest == 0.0 and min(abs(speed.smallest_at["phi"] - x) for x in at) < 1e-6
    flat = nc.library.parallelogram(third=None)
    motion = nc.sweep(flat.compile(), {"phi": np.radians(np.linspace(33, 323, poses))})
    found = nc.report(motion, expect=["transmission > 0.001", "transmission largest > 80"]).verdict.expectations
    assert [one.met for one in found] == [False, True] and found[0].value == 0.0


@pytest.mark.parametrize("turns", [0.5, 1.0])
def test_a_point_that_reverses_between_two_poses_has_not_stopped(turns):
    m = nc.Mechanism("crank")
    m.ground("A", (0, 0)), m.point("B", (3, 4)), m.body("crank", ["A", "B"]), m.angle("phi", at="A", to="B")
    motion = nc.sweep(m.compile(), {"phi": 2 * np.pi * turns * np.arange(3)}, rates={"phi": 2.0})
    (speed,) = (one for one in nc.report(motion, outputs=["B"]).verdict.extremes if one.quantity == "|v(B)|")
    assert speed.smallest == pytest.approx(10.0)


def test_an_acceleration_that_jumps_over_zero_has_not_been_zero():
    m = nc.Mechanism("slider")
    m.ground("A", (0, 0)), m.point("B", (1, 0), fixed="y"), m.distance("s", "A", "B")
    t = np.linspace(0.0, 2.0, 8)  # driven up to speed, and braked from the middle on
    drive = (
        np.where(t < 1, 1 + t**2, 1 + 2 - (2 - t) ** 2),
        np.where(t < 1, 2 * t, 4 - 2 * t),
        np.where(t < 1, 2.0, -2.0),
    )
    motion = nc.motion(m.compile(), {"s": drive}, t)
    (size,) = (one for one in nc.report(motion, outputs=["B"]).verdict.extremes if one.quantity == "|a(B)|")
    assert size.smallest == pytest.approx(2.0)


@pytest.mark.parametrize("poses", [13, 361])
def test_an_extreme_between_poses_is_that_of_a_pose(poses):
    """Crank 12 and coupler 35: however many poses there are, A and C are 23 to 47 apart, and no more."""
    m = nc.Mechanism("crank-rocker", length_unit="mm")
    m.ground("A", (0, 0)), m.ground("D", (40, 0)), m.point("B", (6, 108**0.5)), m.point("C", (34, 29))
    m.body("crank", ["A", "B"]), m.body("coupler", ["B", "C"], lengths={("B", "C"): 35.0})
    m.body("rocker", ["C", "D"], lengths={("C", "D"): 30.0}), m.angle("phi", at="A", to="B"), m.distance("e", "A", "C")
    motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, poses)}, rates={"phi": 1.5})
    ((low, high),) = extremes_of(motion, lambda motion: [q for q in quantities(motion, ["e"]) if q.label == "e"])
    assert (low.value, high.value) == pytest.approx((23.0, 47.0), abs=1e-8)
    assert low.refined and high.refined
    (rate,) = extremes_of(motion, lambda motion: [q for q in quantities(motion, ["e"]) if q.label == "v(e)"])
    fine = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 7201)}, rates={"phi": 1.5}).velocity("e")
    assert [end.value for end in rate] == pytest.approx([float(fine.min()), float(fine.max())], rel=1e-5)
    for said, met in (("e largest <= 47", True), ("e largest < 47", False), ("e smallest >= 23.001", False)):
        verdict = nc.report(motion, expect=[said]).verdict
        assert [one.met for one in verdict.expectations] == [met]


@pytest.mark.parametrize("poses", [31, 37])
@pytest.mark.parametrize("faster", [0.0, 40.0])
def test_the_least_value_may_lie_in_another_valley_than_the_best_pose(poses, faster):
    system = nc.library.four_bar(coupler_point=(0.06, 0.05)).compile()

    def turn(n):
        inputs = {"phi": np.linspace(0.3, 6.9, n)}
        return nc.sweep(system, inputs, rates={"phi": 2.0}, accelerations={"phi": faster})

    wanted = np.linalg.norm(turn(20001).acceleration("P"), axis=1)
    found = nc.report(turn(poses), expect=["acceleration P smallest > 0", "acceleration P < 0"]).verdict.expectations
    assert [one.value for one in found] == pytest.approx([wanted.min(), wanted.max()], rel=1e-5)


def test_extremes_of_a_motion_in_time_are_of_places_that_it_passes():
    m = nc.library.four_bar(coupler_point=(0.06, 0.05))
    m.angle("psi", at="D", to="C")
    system = m.compile()

    def move(n):
        return nc.motion(system, {"phi": lambda t: 0.3 + 0.5 * t**2}, np.linspace(0, 3.3, n))

    few, fine = move(9), move(8001)
    place, rate = nc.report(few, expect=["psi < 0", "velocity psi < 0"]).verdict.expectations
    assert place.value == pytest.approx(float(fine["psi"].max()), abs=1e-6)
    assert rate.value == pytest.approx(float(few.velocity("psi").max()))


def test_extremes_of_a_simulation_with_an_input_are_read_off_its_times():
    m = nc.Mechanism("a bob on an arm")
    m.ground("O", (0, 0)), m.point("A", (1, 0)), m.point("B", (1, -1))
    m.body("arm", ["O", "A"], mass=1.0), m.body("bob", ["A", "B"], mass=1.0)
    m.angle("phi", at="O", to="A"), m.angle("psi", at="A", to="B")
    m.gravity = (0, -9.81)
    run = nc.simulate(m.compile(), np.linspace(0, 2, 121), inputs={"phi": lambda t: 2 * t})
    (psi,) = (one for one in nc.report(run).verdict.extremes if one.quantity == "psi")
    found = [psi.smallest, psi.largest]
    assert found == pytest.approx([float(run["psi"].min()), float(run["psi"].max())], abs=1e-2)


def test_an_extreme_at_an_end_or_beside_a_failed_pose_is_a_pose():
    u, y = np.arange(5.0), np.array([0.0, 1.0, 5.0, np.nan, 2.0])
    assert extreme(y, u, largest=True) == extreme(y, None, largest=True)
    assert extreme(y, u, largest=True).at == 2 and not extreme(y, u, largest=True).refined
    assert extreme(y, u, largest=False).at == 0
    assert not extreme(np.array([1.0, 2.0, 1.0]), np.array([0.0, 1.0, 2.0]), largest=True).refined
    assert not extreme(np.array([0.0, 2.0, 1.0]), np.array([0.0, 1.0, 0.5]), largest=True).refined  # turning back


# ---------------------------------------------------------------------------------------------------------------
# slips of the pen


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["synthesize", "x.toml"], ["no command 'synthesize'", "'synthesise'"]),
        (["chekc", FOUR_BAR], ["no command 'chekc'", "did you mean 'check'"]),
        (["run", FOUR_BAR, "--expct", "psi > 1"], ["no option '--expct'", "did you mean '--expect'"]),
        (["run", FOUR_BAR, "--analysis", "swep"], ["--analysis 'swep'", "'sweep'"]),
        (["run", FOUR_BAR, "--input", "ph=0deg:360deg"], ["--input ph=0deg:360deg", "no coordinate 'ph'", "'phi'"]),
        (["simulate", SWINGING, "--rate", "ph=10deg"], ["no coordinate 'ph'", "'phi'"]),
        (["simulate", SWINGING, "--rate", "phi=1", "--rate", "phi=2"], ["--rate", "given twice"]),
        (["simulate", SWINGING, "--step", ".1"], ["--step is for steps of fixed length", "not for 'dopri8'"]),
        (["simulate", SWINGING, "--method", "rk4", "--rtol", "1e-3"], ["--rtol is for", "not for 'rk4'"]),
        (["simulate", SWINGING, "--method", "rk4", "--step", "1e-30"], ["step=1e-30", "at most 1000000000 fit"]),
    ],
)
def test_what_is_meant_is_asked(capsys, words, parts):
    assert main(words) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and all(part in told for part in parts), told


@pytest.mark.parametrize(
    ("said", "options", "fixed"),
    [
        ('method = "rk4"\nstep = 0.002', (), True),
        ("step = 0.002", ("--method", "rk4"), True),
        ('method = "generalised alpha"\nstep = 0.002', ("--method", "rk4"), True),
        ('method = "rk4"\nstep = 0.002', ("--method", "dopri8"), False),
    ],
)
def test_the_steps_of_a_file_are_those_of_each_method_of_their_sort(capsys, tmp_path, said, options, fixed):
    model = tmp_path / "m.toml"
    model.write_text(re.sub(r"\[simulate\]", f"[simulate]\n{said}", Path(SWINGING).read_text()))
    short = ["--duration", "0.02", "--times", "3"]
    assert main(["simulate", str(model), *short, *options]) == 0
    taken = int(re.search(r"steps +(\d+)", capsys.readouterr().out)[1])
    assert (taken == 10) is fixed
    model.write_text(re.sub(r"\[simulate\]", "[simulate]\nstep = 0.002", Path(SWINGING).read_text()))
    assert main(["simulate", str(model), *short]) == 2
    assert "[simulate] step is for steps of fixed length" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["run", "report"])
def test_names_of_expectations_are_read_before_the_mechanism_is_moved(capsys, monkeypatch, tmp_path, command):
    from jaxnc.reporting import outcome

    def moved(*_, **__):
        raise AssertionError("moved before its expectations were read")

    monkeypatch.setattr(outcome, "sweep", moved)
    monkeypatch.chdir(tmp_path)
    assert main([command, FOUR_BAR, "--expect", "psii range > 3"]) == 2
    told = capsys.readouterr().err
    assert "psii range > 3" in told and "did you mean 'psi'" in told


# ---------------------------------------------------------------------------------------------------------------
# the process around a command


def test_a_warning_is_one_line_and_says_what_a_file_can_do(capsys, tmp_path):
    model = tmp_path / "m.toml"
    model.write_text(Path(FOUR_BAR).read_text().replace('angle = "deg"', 'angle = "rad"'))
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        main(["run", str(model), "--input", "phi=0:360"])
    told = capsys.readouterr().err
    assert told.startswith("jaxnc: warning: 'phi' goes in whole numbers from 0 to 360") and told.count("\n") == 1
    assert 'angle = "deg"' in told and "0deg:360deg" in told


def test_an_interruption_that_pythons_collector_swallows_comes_again():
    def once(*_):
        gc.callbacks.remove(once)
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with command_process(), pytest.raises(KeyboardInterrupt):
            gc.callbacks.append(once)
            gc.collect()
            for _ in range(1000):  # one long sleep would not be woken
                time.sleep(0.01)
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("arguments", [("check",), ("run", "--json")])
def test_streams_that_cannot_take_what_is_printed(arguments):
    command, *options = arguments
    words = f'"{sys.executable}" -m jaxnc {command} "{FOUR_BAR}" {" ".join(options)}'
    ascii_only = {**os.environ, "PYTHONIOENCODING": "ascii", "MPLBACKEND": "nonsense"}
    told = subprocess.run(["bash", "-c", words], capture_output=True, text=True, timeout=300, env=ascii_only)
    assert told.returncode == 0 and told.stderr == ""
    told = subprocess.run(["bash", "-c", f"{words} >/dev/full"], capture_output=True, text=True, timeout=300)
    assert told.returncode == 2 and told.stderr == "jaxnc: [Errno 28] No space left on device\n"
    told = subprocess.run(["bash", "-c", f"{words} >&-"], capture_output=True, text=True, timeout=300)
    assert told.returncode == 0 and told.stderr == ""


def test_a_device_that_is_not_there():
    there = {**os.environ, "JAX_PLATFORMS": "nonsense"}
    told = jaxnc_process("check", FOUR_BAR, env=there)
    assert told.returncode == 2 and "JAX_PLATFORMS=nonsense" in told.stderr and "set it to cpu" in told.stderr
    assert "Traceback" not in told.stderr


def test_the_wrong_kind_of_file(capsys):
    problem = str(EXAMPLES / "problems" / "path.toml")
    assert "this is a problem file, for `jaxnc synthesise`" in complaint(capsys, "run", problem)
    assert "this is a model file; a problem says" in complaint(capsys, "synthesise", FOUR_BAR)


def test_a_report_goes_into_a_folder(capsys, tmp_path):
    assert "end it in .html" in complaint(capsys, "report", "four-bar", "--out", str(tmp_path / "r.pdf"))
    assert main(["report", "four-bar", "--out", str(tmp_path / "new")]) == 0
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["four-bar-report.html"]


def test_a_transmission_angle_of_a_trace_is_in_degrees(capsys, tmp_path):
    (tmp_path / "egg.csv").write_text("x,y\n0,0\n1,0\n1,1\n0,1\n")
    assert "--transmission 95" in complaint(capsys, "trace", str(tmp_path / "egg.csv"), "--transmission", "95")


def test_what_does_not_move_is_compared_and_not_said_to_move(capsys, tmp_path):
    (tmp_path / "nobody.toml").write_text("[ground]\nA = [0, 0]\n")
    assert json.loads(said(capsys, "compare", str(tmp_path / "nobody.toml"), "--json"))["moves"] is False


@pytest.mark.parametrize("command", [("check",), ("compare", "--families", "natural"), ("export", "--to", "urdf")])
def test_a_verdict_says_in_what_its_numbers_are(command, capsys, tmp_path):
    where = () if "check" in command else ("--out", str(tmp_path))
    file = edited(tmp_path, ('length = "m"', 'length = "mm"'))
    verdict = json.loads(said(capsys, command[0], file, *command[1:], *where, "--json"))
    assert (verdict["length_unit"], verdict["angle_unit"]) == ("mm", "deg")


def test_a_ground_that_a_spring_ends_at_is_attached(capsys, tmp_path):
    m = nc.Mechanism("lamp")
    m.ground("A", (0, 0)), m.ground("G", (0, -1)), m.point("B", (1, 0))
    m.body("arm", ["A", "B"], mass=1.0), m.spring("s", "G", "B", stiffness=10.0), m.angle("phi", at="A", to="B")
    m.save(tmp_path / "lamp.toml")
    assert "nothing is attached" not in said(capsys, "check", str(tmp_path / "lamp.toml"))
