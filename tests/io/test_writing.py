"""A full disk leaves the good old file as it was, and nothing beside it, whoever writes."""

import contextlib
import json
import os
import resource
import sys

import numpy as np
import pytest
from mechanisms import four_bar, four_bar_mechanism
from processes import full_disk

import jaxnc as nc
from jaxnc.io import target
from jaxnc.io.target import PartialTable, read_archive


@pytest.fixture(scope="module")
def swept():
    return nc.sweep(four_bar(), {"phi": np.linspace(0.6, 0.8, 4)}, rates={"phi": 1.0})


def stream_parts(motion, path):
    """What `stream` does when all poses are found."""
    parts = PartialTable(path, {"question": 1})
    if not parts.index.rows:
        with no_limit():
            parts.append({"x": np.arange(100.0)}, {}, {})
    parts.finish({})


@contextlib.contextmanager
def no_limit():
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def a_plot(motion, path):
    from jaxnc.viz.picture import Picture, finish

    figure = Picture(figsize=(2, 2))
    figure.subplots().plot(np.asarray(motion["P"])[:, 0])
    return finish(figure, path)


WRITERS = {
    "m.toml": lambda motion, path: four_bar_mechanism().save(path),
    "m.json": lambda motion, path: four_bar_mechanism().save(path),
    "t.csv": lambda motion, path: motion.to_csv(path),
    "t.npz": lambda motion, path: motion.to_npz(path),
    "s.npz": stream_parts,
    "p.html": lambda motion, path: motion.to_html(path),
    "p.png": a_plot,
    "p.svg": a_plot,
    "a.gif": lambda motion, path: motion.animate(path, frames=2, size=(1.5, 1.2)),
}


@pytest.mark.skipif(sys.platform == "win32", reason="sizes of files are not limited there")
@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_leaves_the_old_file(swept, tmp_path, name):
    path, write = tmp_path / name, WRITERS[name]
    write(swept, path)
    assert os.listdir(tmp_path) == [name]
    good = path.read_bytes()
    assert len(good) > 100
    with full_disk(), pytest.raises(nc.OutputError) as caught:
        write(swept, path)
    said = str(caught.value)
    assert str(path) in said and "file too large" in said.lower() and "ulimit -f" in said and "\n" not in said
    assert path.read_bytes() == good
    left = set(os.listdir(tmp_path)) - {name}
    assert left == ({"s.npz.part"} if name == "s.npz" else set())  # with it `stream` goes on
    write(swept, path)
    assert os.listdir(tmp_path) == [name] and len(path.read_bytes()) > 100


def test_an_interruption_leaves_the_old_file(tmp_path):
    path = target.write(tmp_path / "x.txt", b"old")
    with pytest.raises(KeyboardInterrupt), target.replacing(path) as new:
        new.write_bytes(b"ne")
        raise KeyboardInterrupt
    assert path.read_bytes() == b"old" and os.listdir(tmp_path) == ["x.txt"]


def test_links_permissions_and_devices_stay(tmp_path):
    real = target.write(tmp_path / "real.txt", b"old")
    real.chmod(0o600)
    (tmp_path / "link.txt").symlink_to(real)
    target.write(tmp_path / "link.txt", b"new")
    assert (tmp_path / "link.txt").is_symlink() and real.read_bytes() == b"new"
    assert real.stat().st_mode & 0o777 == 0o600
    assert target.write("/dev/null", b"new").is_char_device()
    other = target.write(tmp_path / "other.txt", b"x")
    mask = os.umask(0)
    os.umask(mask)
    assert other.stat().st_mode & 0o777 == 0o666 & ~mask


def test_damaged_archives_are_refused_in_one_line(swept, tmp_path):
    """Bytes changed at random, cut and swapped: an archive is read as it was, or refused."""
    whole = swept.to_npz(tmp_path / "good.npz").read_bytes()
    good = nc.io.load_npz(tmp_path / "good.npz")
    rng, path, refused = np.random.default_rng(3), tmp_path / "bad.npz", 0
    for k in range(400):
        raw = bytearray(whole)
        for at in rng.integers(0, len(raw), 1 + k % 3):
            raw[at] = rng.integers(256)
        path.write_bytes(raw[: rng.integers(len(raw))] if k % 10 == 0 else raw)
        try:
            table = nc.io.load_npz(path, mmap=bool(k % 2))
        except nc.ModelFileError as error:
            refused += 1
            assert str(error).startswith(f"{path} ") and "\n" not in str(error)
        else:
            assert set(table.names) == set(good.names)
    assert refused > 200


@pytest.mark.parametrize(("at", "value"), [(8, 99), (8, 12), (6, 1)])
def test_other_compressions_and_passwords(swept, tmp_path, at, value):
    """What zipfile does not do it says by NotImplementedError (a method) and RuntimeError (a password)."""
    raw = bytearray(swept.to_npz(tmp_path / "x.npz").read_bytes())
    for start, shift in ((b"PK\x03\x04", 0), (b"PK\x01\x02", 2)):
        raw[raw.index(start) + at + shift] = value
    (tmp_path / "x.npz").write_bytes(raw)
    with pytest.raises(nc.ModelFileError, match=r"x\.npz.*damaged \(.+\).*write"):
        read_archive(tmp_path / "x.npz", "a table of mine")


def test_keys_of_many_parts(tmp_path):
    (tmp_path / "deep.toml").write_text(".".join(["a"] * 3_000) + " = 1\n")
    (tmp_path / "lists.json").write_text('{"a": ' + "[" * 60 + "]" * 60 + "}")
    for name in ("deep.toml", "lists.json"):
        with pytest.raises(nc.ModelFileError, match=rf"{name}.*nested too deeply"):
            nc.load(tmp_path / name)


def test_half_a_character(tmp_path):
    for text in ('{"name": "m\\ud800"}', '{"name": "m", "points": {\n"P\\udfff": [0, 1]}}'):
        (tmp_path / "m.json").write_text(text)
        with pytest.raises(nc.ModelFileError, match=r"m\.json, line \d.*half.*type it anew"):
            nc.load(tmp_path / "m.json")
    assert json.loads('"\\ud83d\\ude00"') == "😀"  # two halves are one
    (tmp_path / "whole.json").write_text('{"name": "\\ud83d\\ude00", "ground": {"A": [0, 0]}}')
    assert nc.load(tmp_path / "whole.json").name == "😀"
    m = nc.Mechanism("four-bar")
    for add in (
        lambda: nc.Mechanism("m\ud800"),
        lambda: nc.Mechanism("m", description="\udfff"),
        lambda: m.ground("A\ud800", (0, 0)),
        lambda: m.body("rod\ud800", ["A", "B"]),
    ):
        with pytest.raises(nc.MechanismError, match=r"\\ud[8f][0f][0f].*half.*type it anew"):
            add()
    for use in (lambda path: m.save(path), nc.load):
        with pytest.raises(nc.JaxncError, match=r"m\\ud800\.toml"):
            use(tmp_path / "m\ud800.toml")
