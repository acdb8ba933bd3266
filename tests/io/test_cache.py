"""Compiled programs kept on disk: found again by the next process, without a word, out of the way when not wanted."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from places import EXAMPLES, ROOT

import jaxnc as nc
from jaxnc.cli.main import trim
from jaxnc.errors import OutputError
from jaxnc.process import cache_folder

SWINGING = str(EXAMPLES / "swinging_four_bar.toml")
# A command, and how often it found a program in the cache or did not.
COMMAND = """
import sys, jax
seen = {"hits": 0, "misses": 0}
def listen(event, **_):
    for kind in seen:
        seen[kind] += event == f"/jax/compilation_cache/cache_{kind}"
jax.monitoring.register_event_listener(listen)
from jaxnc.cli import main
code = main(["simulate", sys.argv[1], "--duration", "0.01", "--times", "2", "--method", "rk4"])
print(code, seen["hits"], seen["misses"])
"""
# What a command does before its work, and work that takes no time.
LITTLE = """
import sys, jax
from jaxnc.cli.main import configure
configure(sys.argv[1:] == ["--no-cache"])
jax.jit(lambda x: x + 1)(1.0)
"""


def told(code: str, folder: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess:
    """What a process says that knows of no cache but by these variables, and has its home in a folder."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("JAX", "XDG"))}
    command = [sys.executable, "-W", "error", "-c", code, *arguments]
    environment = {**clean, "HOME": str(folder), "LOCALAPPDATA": str(folder), **variables}
    environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), environment.get("PYTHONPATH", "")])
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, env=environment, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done


def files(folder: Path) -> set[str]:
    return {p.name for p in folder.rglob("*-cache")}


@pytest.mark.slow
def test_the_second_command_compiles_nothing(tmp_path):
    first = told(COMMAND, tmp_path, SWINGING)
    kept = files(tmp_path / cache_folder({"HOME": str(tmp_path), "LOCALAPPDATA": str(tmp_path)}, sys.platform, None))
    code, hits, misses = map(int, first.stdout.split()[-3:])
    assert code == 0 and first.stderr == "" and misses > 2 and len(kept) == misses, first.stdout
    second = told(COMMAND, tmp_path, SWINGING)
    assert list(map(int, second.stdout.split()[-3:])) == [0, hits + misses, 0] and second.stderr == ""
    assert files(tmp_path) == kept


def test_where_it_is_and_how_it_is_turned_off(tmp_path):
    for arguments, variables in ((["--no-cache"], {}), ([], {"JAXNC_CACHE": "off"})):
        for jax_folder in ({}, {"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "jax")}):
            assert told(LITTLE, tmp_path, *arguments, **variables, **jax_folder).stderr == ""
            assert list(tmp_path.iterdir()) == []
    assert told(LITTLE, tmp_path, JAXNC_CACHE="~/mine", JAX_COMPILATION_CACHE_DIR=str(tmp_path / "jax")).stderr == ""
    assert [p.name for p in tmp_path.iterdir()] == ["mine"] and files(tmp_path)


def test_the_setting_of_jax_is_respected(tmp_path):
    zero = {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    assert told(LITTLE, tmp_path, JAX_COMPILATION_CACHE_DIR=str(tmp_path / "jax"), **zero).stderr == ""
    assert [p.name for p in tmp_path.iterdir()] == ["jax"] and files(tmp_path)


def test_a_folder_that_cannot_be_written_costs_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    err = told(LITTLE, tmp_path, JAXNC_CACHE=str(tmp_path / "file" / "cache")).stderr
    assert err.count("\n") == 1 and err.startswith("jaxnc: warning: compiled programs are not kept: cannot write ")
    assert "file/cache" in err and "a part of the path is a file" in err
    assert "JAXNC_CACHE=FOLDER" in err and "--no-cache" in err


# A script that imports jax first, as scripts do, and is told what it found in the cache and how loud JAX is.
SCRIPT = """
import logging, sys, jax, jaxnc as nc
def level():
    return logging.getLogger("jax").level, logging.getLogger("jax").handlers[:], jax.config.jax_logging_level
hits, before = [], level()
jax.monitoring.register_event_listener(lambda e, **_: hits.append(e) if e == "/jax/compilation_cache/cache_hits" else 0)
print(nc.cache(*sys.argv[1:]))
jax.jit(lambda x: jax.numpy.sin(x) @ x)(jax.numpy.ones(7))
print(len(hits) > 0, level() == before)
"""


def test_a_script_asks_for_it_in_one_call_and_nothing_is_said(tmp_path):
    """XLA prints ten lines of 1.7 kB for each program that is read, if it is left to."""
    for found in ("False", "True"):
        # Neither the tests' own quietness nor their flags: what a user's process says.
        run = told(SCRIPT, tmp_path, str(tmp_path / "kept"), TF_CPP_MIN_LOG_LEVEL="1", XLA_FLAGS="")
        assert run.stderr == "" and run.stdout.split() == [str(tmp_path / "kept"), found, "True"]
    assert told(SCRIPT, tmp_path, JAXNC_CACHE="off").stdout.split() == ["None", "False", "True"]
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"file/kept.*a part of the path is a file"):
        nc.cache(tmp_path / "file" / "kept")


HOME = {"HOME": "/home/ann"}


@pytest.mark.parametrize(
    ("environment", "platform", "told", "where"),
    [
        (HOME, "linux", None, "/home/ann/.cache/jaxnc"),
        ({**HOME, "XDG_CACHE_HOME": "/big"}, "linux", None, "/big/jaxnc"),
        ({**HOME, "XDG_CACHE_HOME": "not/absolute"}, "linux", None, "/home/ann/.cache/jaxnc"),
        (HOME, "darwin", None, "/home/ann/Library/Caches/jaxnc"),
        ({**HOME, "LOCALAPPDATA": "/local"}, "win32", None, "/local/jaxnc"),
        (HOME, "linux", "/jax", "/jax"),
        ({**HOME, "JAXNC_CACHE": "/mine"}, "linux", "/jax", "/mine"),
        ({**HOME, "JAXNC_CACHE": "OFF"}, "linux", "/jax", None),
        ({**HOME, "JAXNC_CACHE": "0"}, "linux", None, None),
        ({**HOME, "JAXNC_CACHE": ""}, "linux", None, "/home/ann/.cache/jaxnc"),
    ],
)
def test_places(environment, platform, told, where):
    assert cache_folder(environment, platform, told) == (where if where is None or where == told else Path(where))


def test_what_was_not_used_for_longest_goes_first(tmp_path):
    for k in range(10):
        file = tmp_path / f"jit_{k}-cache"
        file.write_bytes(bytes(100))
        os.utime(file, (k, k))
    (tmp_path / "letter.txt").write_bytes(bytes(10_000))
    trim(tmp_path, 1000)
    assert len(files(tmp_path)) == 10, "not too much yet"
    trim(tmp_path, 999)
    assert files(tmp_path) == {f"jit_{k}-cache" for k in range(6, 10)} and (tmp_path / "letter.txt").exists()
    trim(tmp_path / "none", 0)
